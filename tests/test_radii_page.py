"""The table of A68a on finer and finer lattices in docs/explanation/numerics.md is what benchmarks/radii.py gets now."""

from __future__ import annotations

import re

import pytest

from scripts import loaded, table_rows

SCRIPT = loaded("benchmarks/radii.py")
ROW = 45.0
"""One row of elements of 1.5 km across the neck of the finger (15 km), km2."""


def rows() -> list[tuple[str, ...]]:
    """Return the rows of the page below the head."""
    return table_rows(SCRIPT.PAGE, "radii")


def finger(cell: str) -> float:
    """Return the area (km2) of what comes off from 19 December on."""
    areas = re.findall(r"(\d+) km² (?:19|2\d)\. ", cell)
    assert len(areas) == 1, cell
    return float(areas[0])


def test_the_page_has_all_lattices() -> None:
    names = [f"{packing}, radius {1e-3 * radius:g} km" for packing, radius in SCRIPT.LATTICES]
    assert [row[0] for row in rows()] == names


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_the_finger_of_the_page_is_one_piece_for_all_sizes_of_elements(packing: str) -> None:
    """Within one row of that of the finest lattice, on both floors; its stress within a sixth."""
    found = [row for row in rows() if row[0].startswith(packing)]
    for floor in (4, 6):
        areas = [finger(row[floor]) for row in found]
        assert max(abs(area - areas[-1]) for area in areas) <= ROW
    stress = [float(row[2].split()[0]) for row in found]
    assert stress == pytest.approx([stress[-1]] * len(stress), rel=0.16)


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(SCRIPT.LATTICES)))
def test_a_lattice_tells_what_the_page_says(k: int) -> None:
    assert rows()[k] == SCRIPT.row(*SCRIPT.LATTICES[k])
