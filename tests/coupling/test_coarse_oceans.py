"""The table of the page on coarse oceans is that of its script."""

from __future__ import annotations

import pytest

from scripts import ROOT, loaded, table_rows

ROWS = table_rows(ROOT / "docs" / "explanation" / "coarse-oceans.md", "coarse")


def test_a_small_berg_in_cells_of_a_degree_is_as_far_off_as_the_page_says() -> None:
    script = loaded("docs/examples/coarse_oceans.py")
    small = script.bergs()["1 km"]
    track = script.in_formula(small)
    off = script.apart(script.in_cells(small, 1.0), track)
    said = [f"{off[day - 1]:.1f}" for day in script.DAYS]
    assert ("1 km", "1°", *said) in ROWS
    # Two thirds of the drift itself.
    share = off[[day - 1 for day in script.DAYS]] / script.travelled(track, small)[[day - 1 for day in script.DAYS]]
    assert ((share > 0.6) & (share < 0.7)).all()


@pytest.mark.slow
def test_the_table_is_that_of_the_script() -> None:
    assert loaded("docs/examples/coarse_oceans.py").table() == ROWS
