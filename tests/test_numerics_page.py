"""The tables of docs/explanation/numerics.md are what benchmarks/convergence.py and benchmarks/landing.py get now."""

from __future__ import annotations

import pytest

from scripts import loaded, table_rows

SCRIPT = loaded("benchmarks/convergence.py")
LANDING = loaded("benchmarks/landing.py")


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


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "step"), [("quasi_static", 3600.0), ("mts", 1800.0)])
def test_a_row_is_what_comes_now(scheme: str, step: float) -> None:
    truth = SCRIPT.loaded(SCRIPT.QUASI_STATIC, SCRIPT.TRUTH)
    assert tuple(SCRIPT.row(scheme, step, SCRIPT.loaded(scheme, step), truth)) in rows()


def test_the_page_tells_all_landings_and_what_it_says_of_them() -> None:
    """From two parts on the quasi-static load is one; explicit in stiff ice it is at most twice that; speeds agree to 2 %."""
    told = {row[0]: (float(row[1].split()[0]), float(row[2].split()[0])) for row in table_rows(LANDING.PAGE, "landing")}
    assert list(told) == [run.name for run in LANDING.LANDINGS]
    load, speed = told[LANDING.LANDINGS[2].name]
    for run in LANDING.LANDINGS[1:5]:
        assert told[run.name] == pytest.approx((load, speed), rel=0.02)
    stiff, after = told[LANDING.LANDINGS[5].name]
    assert load < stiff < 2.0 * load
    assert after == pytest.approx(speed, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("run", LANDING.LANDINGS, ids=lambda run: run.name)
def test_a_landing_is_what_comes_now(run) -> None:
    assert LANDING.landing(run) in table_rows(LANDING.PAGE, "landing")
