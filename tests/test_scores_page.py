"""The script that writes docs/evidence/scores.md: its figures, and the observations it takes."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from scripts import loaded


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """Return benchmarks/scores.py as a module."""
    return loaded("benchmarks/scores.py")


def test_numbers_are_written_with_a_true_minus_and_nought_without_sign(script: ModuleType) -> None:
    values = (None, float("nan"), -0.3, 0.2, -87.4, 12.0)
    assert [script.number(v, "+.0f") for v in values] == ["", "", "0", "0", "−87", "+12"]
    assert [script.counted(n, "bond") for n in (0, 1, 2)] == ["0 bonds", "1 bond", "2 bonds"]


def test_the_page_has_the_block_that_the_script_writes(script: ModuleType) -> None:
    text = script.PAGE.read_text("utf-8")
    block = text.partition(script.BEGIN)[2].partition(script.END)[0]
    for heading in ("All runs", "a68a by day", "a68a-oras5 by day", "Positions of BYU", "mask of 9 December"):
        assert heading in block, "run: python benchmarks/scores.py --write"


def test_the_pieces_are_named_by_their_areas_and_the_berg_is_there_on_every_day(
    script: ModuleType, shared: Path
) -> None:
    found = script.piece_outlines(shared / "data")
    days: dict[int, list[str]] = {}
    for outline in found.outlines:
        days.setdefault(outline.when.day, []).append(outline.name)
    assert {day: names.count("A68a") >= 1 for day, names in days.items()} == dict.fromkeys(
        (17, 21, 23, 24, 25, 26), True
    )
    for day in (23, 24, 25, 26):
        assert sorted(days[day]) == ["A68a", "finger (A68E)", "fragment (A68F)", "tip (A68D)"]
    assert {f.name for f in script.byu_positions(shared / "data").fixes} == set(script.TRACKED)
    assert not {o.when.day for o in script.daily_outlines(shared / "data").outlines if o.when.month == 12} & {10, 24}


@pytest.mark.slow
def test_the_reference_rules_give_the_published_berg_in_the_table(script: ModuleType, shared: Path) -> None:
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in script.mask_table(shared / "data").splitlines()
    ]
    published, made, _, rules = rows[2:6]
    assert 'rules="makeberg", reference_latitude=-55.2' in rules[0]
    assert script.mask_table(shared / "data") in script.PAGE.read_text("utf-8"), "run: benchmarks/scores.py --write"
    assert published[1:5] == rules[1:5] == ["472", "874", "4248", "722.2"]
    assert rules[5:] == ["0", "0", "0", "1.000", "1.000"]
    assert 0 < float(made[5]) < 2121  # half a diagonal of an element
    assert float(made[9]) > 0.92
