"""The tables of docs/evidence/strength.md are what benchmarks/strength.py gets now, and reach what was asked."""

from __future__ import annotations

import pytest

from scripts import loaded, table_rows

SCRIPT, QUIET = loaded("benchmarks/strength.py"), loaded("benchmarks/quiet_years.py")


@pytest.mark.parametrize("name", SCRIPT.TABLES)
def test_a_table_is_what_comes_now(name: str) -> None:
    lines = SCRIPT.TABLES[name]().splitlines()[2:]
    assert [tuple(cell.strip() for cell in line[1:-1].split("|")) for line in lines] == table_rows(SCRIPT.PAGE, name)


@pytest.mark.parametrize(("name", "count"), [("reserves", 42), ("rifts", 20)])
def test_the_reserve_is_what_was_asked(name: str, count: int) -> None:
    """To 0.1 kPa, or to the last digit asked."""
    pairs = [cell.split(";") for row in table_rows(SCRIPT.PAGE, name) for cell in row[1:] if ";" in cell]
    assert len(pairs) == count
    for asked, reached in pairs:
        whole = "." not in asked.strip()
        assert float(reached) == pytest.approx(float(asked), abs=1.01 if whole else 0.11)


def test_fronts_strips_and_feet_are_what_was_asked() -> None:
    assert all(asked == reached for _, asked, reached in table_rows(SCRIPT.PAGE, "fronts"))
    asked, reached = table_rows(SCRIPT.PAGE, "strips")
    assert asked[1:] == reached[1:]
    for _, asked, reached, _ in table_rows(SCRIPT.PAGE, "feet"):
        for a, b in zip(asked.replace(" m", "").split(","), reached.replace(" m", "").split(","), strict=True):
            assert float(b) == pytest.approx(float(a), rel=0.015)


def test_giants_live_through_five_quiet_years() -> None:
    """Three bergs in three seas, none of which breaks, though one comes near to what it bears."""
    rows = table_rows(SCRIPT.PAGE, "quiet years")
    assert [row[0] for row in rows] == [giant.name for giant in QUIET.GIANTS for _ in QUIET.CASES]
    shares = [float(largest.split()[0]) / float(bears.split()[0]) for *_, bears, largest, _ in rows]
    assert {row[-1] for row in rows} == {"nothing"}
    assert 0.5 < max(shares) < 1.0


@pytest.mark.slow
def test_a_giant_lives_as_the_page_says() -> None:
    (row,) = [row for row in table_rows(SCRIPT.PAGE, "quiet years") if row[0] == "D28"][:1]
    assert QUIET.lived(QUIET.GIANTS[1], *QUIET.CASES[0]) == row
