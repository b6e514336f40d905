"""The table of stress against long step in docs/evidence/stress-and-step.md is what benchmarks/convergence.py gets now."""

from __future__ import annotations

import math

import pytest

from scripts import loaded, table_rows

SCRIPT = loaded("benchmarks/convergence.py")


def rows() -> list[tuple[str, ...]]:
    """Return the rows of the page below the head."""
    return table_rows(SCRIPT.PAGE, "convergence")


def test_the_page_has_all_runs_and_the_figure() -> None:
    runs = [(SCRIPT.NAMES[scheme], f"{step:.0f} s") for scheme, steps in SCRIPT.STEPS.items() for step in steps]
    truth = (SCRIPT.NAMES[SCRIPT.QUASI_STATIC], f"{SCRIPT.TRUTH:.0f} s")
    assert [row[:2] for row in rows()] == [*runs, truth]
    assert SCRIPT.FIGURE.is_file()


def test_both_schemes_tend_to_the_same_stress_as_their_long_step_gets_shorter() -> None:
    apart = {row[:2]: float(row[2].removesuffix(" %")) for row in rows()}
    for scheme, steps in SCRIPT.STEPS.items():
        values = [apart[SCRIPT.NAMES[scheme], f"{step:.0f} s"] for step in steps]
        assert values == sorted(values, reverse=True)
    assert apart[SCRIPT.NAMES[SCRIPT.QUASI_STATIC], "1800 s"] < 0.01 * apart[SCRIPT.NAMES[SCRIPT.EXPLICIT], "150 s"]


def test_the_strengths_that_follow_from_toughness_are_those_of_theory() -> None:
    """A crack of 3 km in a large plate."""
    found = table_rows(SCRIPT.PAGE.with_name("strength.md"), "toughness")
    assert [row[0] for row in found] == ["50 kPa m½", "100 kPa m½", "150 kPa m½", "400 kPa m½"]
    for name, *cells in found:
        assert cells == [f"{float(name.split()[0]) / math.sqrt(math.pi * 1.5e3):.2g} kPa"]


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "step"), [("quasi_static", 3600.0), ("mts", 1800.0)])
def test_a_row_is_what_comes_now(scheme: str, step: float) -> None:
    truth = SCRIPT.loaded(SCRIPT.QUASI_STATIC, SCRIPT.TRUTH)
    assert tuple(SCRIPT.row(scheme, step, SCRIPT.loaded(scheme, step), truth)) in rows()
