"""The figures of the documentation: each PNG holds the data that it was drawn from, and today's code draws the same."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from scripts import loaded

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"

OF_THEIR_SCRIPTS = {
    "stress-and-long-step": "benchmarks/convergence.py",
    "growth": "benchmarks/growth.py",
}  # fmt: skip
"""Figures of what was measured, and the script that measures and draws."""

QUICK = ("house", "life-of-an-element", "keel-and-floor")


def drawn(names: tuple[str, ...], folder: Path) -> Any:
    """Draw figures again and return the data that they show, as a file holds them."""
    data = loaded("docs/figures.py").DRAWN[names](*(folder / f"{name}.png" for name in names))
    return json.loads(json.dumps(data))


def same(names: tuple[str, ...], folder: Path) -> None:
    figures = loaded("docs/figures.py")
    kept = [figures.shown_in(FIGURES / f"{name}.png") for name in names]
    if all(data is None for data in kept):
        pytest.skip(f"{names[0]} was drawn before figures held their data: python docs/build.py --figures {names[0]}")
    data = drawn(names, folder)
    assert kept == [data] * len(names), f"python docs/build.py --figures {names[0]}"


@pytest.mark.parametrize("name", QUICK)
def test_a_figure_shows_what_the_code_says_today(name: str, tmp_path: Path) -> None:
    """Bug once: the picture of the packages gave numbers of lines that were out of date by a factor of two."""
    same((name,), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [names for names in loaded("docs/figures.py").DRAWN if names[0] not in QUICK], ids=lambda n: n[0]
)
def test_a_figure_of_a_run_shows_that_run(names: tuple[str, ...], tmp_path: Path) -> None:
    same(names, tmp_path)


def test_every_figure_has_a_command_that_draws_it() -> None:
    by_one = {name for names in loaded("docs/figures.py").DRAWN for name in names}
    assert {path.stem for path in FIGURES.glob("*.png")} == by_one | set(OF_THEIR_SCRIPTS)
    for name, script in OF_THEIR_SCRIPTS.items():
        text = (ROOT / script).read_text("utf-8")
        assert name in text or name.partition("-")[2] in text, script


def test_other_data_are_noticed(tmp_path: Path) -> None:
    """A figure with other data in it is no figure of today, and one without data says so."""
    figures = loaded("docs/figures.py")
    data = figures.house(tmp_path / "house.png")
    assert figures.shown_in(tmp_path / "house.png") is None
    figures.stamp(tmp_path / "house.png", [*data[:-1], ("constants", "another purpose")])
    assert figures.shown_in(tmp_path / "house.png") != json.loads(json.dumps(data))
    assert not [text for _, text in data if re.search(r"\d,?\d{2} lines", text)]
