"""The table of A68a on finer and finer lattices in docs/explanation/numerics.md is what benchmarks/radii.py gets now."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from scripts import loaded, table_rows

SCRIPT = loaded("benchmarks/radii.py")
ROW = 45.0
"""One row of elements of 1.5 km across the neck of the finger (15 km), km2."""


def rows() -> list[tuple[str, ...]]:
    """Return the rows of the page below the head."""
    return table_rows(SCRIPT.PAGE, "radii")


def areas(cell: str, days: str) -> list[float]:
    """Return the areas (km2) of the large pieces that come off on some days, in words of a pattern."""
    return [float(area) for area in re.findall(rf"(\d+) km² (?:{days})\. ", cell)]


def test_the_page_has_all_lattices() -> None:
    names = [f"{packing}, radius {1e-3 * radius:g} km" for packing, radius in SCRIPT.LATTICES]
    assert [row[0] for row in rows()] == names


def test_the_finger_of_the_page_is_one_piece_for_all_lattices() -> None:
    """Within one row of that of the finest square lattice, on both floors; the coarsest squares within two."""
    for floor in (4, 6):
        fingers = {row[0]: areas(row[floor], r"19|2\d") for row in rows()}
        truth = fingers["square, radius 0.5 km"][0]
        coarsest = fingers.pop("square, radius 1.5 km")
        assert len(coarsest) == 1
        assert abs(coarsest[0] - truth) <= 2.2 * ROW
        assert all(len(found) == 1 and abs(found[0] - truth) <= ROW for found in fingers.values())


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_the_stress_at_the_finger_does_not_rise_with_the_resolution(packing: str) -> None:
    stress = [float(row[2].split()[0]) for row in rows() if row[0].startswith(packing)]
    assert stress == pytest.approx([stress[-1]] * len(stress), rel=0.15)


def test_on_a_floor_that_takes_hold_gradually_the_tip_is_one_piece_too() -> None:
    """Square lattices; within a row and a half, and its stress tends to a limit. Where the floor holds at once it falls."""
    square = [row for row in rows() if row[0].startswith("square")]
    tips = [areas(row[6], r"1\d") for row in square]
    assert all(len(tip) == 1 and abs(tip[0] - tips[0][0]) <= 1.5 * ROW for tip in tips)
    assert all(abs(tip[0] - tips[0][0]) <= 9.0 for tip in tips[:-1])
    sudden, gradual = ([float(row[column].split()[0]) for row in square] for column in (3, 5))
    steps = -np.diff(gradual)
    assert (np.diff(steps) < 0.0).all(), "each refinement changes the stress less"
    assert abs(steps[-1]) < 0.07 * gradual[-1]
    assert gradual[0] < 1.5 * gradual[-1]
    assert sudden[-1] < 0.4 * sudden[0]
    assert all(fine < coarse for coarse, fine in itertools.pairwise(sudden)), "it falls and falls"


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(SCRIPT.LATTICES)))
def test_a_lattice_tells_what_the_page_says(k: int) -> None:
    assert rows()[k] == SCRIPT.row(*SCRIPT.LATTICES[k])
