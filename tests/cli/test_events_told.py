"""What a run prints and writes of itself: the order of its events, runs in metres and runs of seconds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import A68A_2022
from riftberg.cli.main import app
from riftberg.cli.run import short_summary
from riftberg.compiled import kernels
from riftberg.config.units import quantity_text
from riftberg.experiments import Info


def invoked(model: FakeModel, info: Info, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Any:
    """Run the command line with an experiment that is this model."""
    monkeypatch.setattr("riftberg.experiments.build", lambda name, options=None: (model, info))
    monkeypatch.setattr(kernels, "is_warm", lambda: True)
    return CliRunner().invoke(app, ["run", info.name, "-o", "out", *arguments])


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_events_of_runs_in_metres_name_x_before_y(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: y came first, unnamed, in metres that looked like degrees."""
    result = invoked(FakeModel(latlon=False), Info("metres", days=2.0, output_every_hours=6.0), monkeypatch, "--no-map")
    assert re.search(r"54 km2 broke off aground \(3 bonds\) at x -?[\d.]+ km, y -?[\d.]+ km\n", result.stdout)
    assert re.search(r"Berg: 24 elements, 216 km2 in 1 piece at x -?[\de.-]+ m, y -?[\de.-]+ m", result.stderr)
    told = CliRunner().invoke(app, ["why", "out", "--no-figure"])
    assert told.exit_code == 0, told.output
    assert re.search(r"the first at x -?[\d.]+ k?m, y -?[\d.]+ k?m", told.stdout.replace("\n", " "))


def test_a_run_of_seconds_tells_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    model = FakeModel(2, 1, parameters=A68A_2022.changed(stepping={"time_step": 1.0}))
    model.elements.length[:] = model.elements.width[:] = 0.5
    model.parameters = model.parameters.changed(earth={"latlon": False})
    result = invoked(
        model, Info("short", days=10.0 / 86_400.0, output_every_hours=1.0 / 3600.0), monkeypatch, "--no-map"
    )
    assert result.exit_code == 0, result.output
    assert re.search(
        r"^short: 10 s, 2 elements, 0 of 1 bonds broken, [\d.e-]+ s of computing$", result.stdout, re.MULTILINE
    )
    assert "in one piece (0.5 m2)" in result.stdout
    assert "per day" not in result.stderr


def summary_of(**entries: Any) -> dict[str, Any]:
    """Return the summary of a day of two elements in which nothing happened, but for some entries."""
    nothing = {
        "experiment": "", "end": "2020-12-10T00:00:00", "days": 1.0, "elements": 2, "bonds_broken": 0, "bonds_total": 1,
        "seconds_per_day": None, "wall_seconds": None, "breakups": [], "fragments": 1, "areas_km2": [3.0],
        "largest_km2": 3.0, "numerics": {"earth": {"latlon": True}},
    }  # fmt: skip
    return nothing | entries


@pytest.mark.parametrize(
    ("days", "told"),
    [(17.0, "17 days"), (1.0, "1 day"), (0.347222, "8.33 h"), (0.01, "14.4 min"), (10.0 / 86_400.0, "10 s")],
)
def test_the_length_of_a_run_is_written_in_a_unit_that_suits_it(days: float, told: str) -> None:
    assert re.split(" to |,", short_summary(summary_of(days=days))[0])[0] == f"run: {told}"


def test_areas_and_places_are_written_in_units_that_suit_them() -> None:
    def told(area: float, lon: float, lat: float, latlon: bool) -> str:
        event = {
            "time": "2020-12-09T13:00:00",
            "area_km2": area / 1e6,
            "bonds": 1,
            "grounded": False,
            "lon": lon,
            "lat": lat,
        }
        return short_summary(summary_of(breakups=[event], numerics={"earth": {"latlon": latlon}}))[1][20:]

    assert told(4.248e9, -37.56, -54.93, True) == "4248 km2 broke off afloat (1 bond) at 54.930 S, 37.560 W"
    assert told(4.2e6, 63e3, 60e3, False) == "4.2 km2 broke off afloat (1 bond) at x 63 km, y 60 km"
    assert told(2e4, 350.0, 60.0, False) == "0.02 km2 broke off afloat (1 bond) at x 350 m, y 60 m"
    assert [told(area, 0.0, 0.0, True).split(" broke")[0] for area in (7.25, 0.0)] == ["7.25 m2", "0 km2"]


def test_numbers_are_written_in_units_that_suit_them() -> None:
    pairs = [
        (16000.0, "Pa"),
        (9e9, "Pa"),
        (-500.0, "Pa"),
        (5e4, "m"),
        (0.0, "m"),
        (259200.0, "s"),
        (1234567.0, "kg"),
        (0.3, "1"),
    ]
    assert [quantity_text(*pair) for pair in pairs] == [
        "16 kPa", "9000 MPa", "-500 Pa", "50 km", "0 m", "3 day", "1.23457e+06 kg", "0.3",
    ]  # fmt: skip


def test_a_summary_without_a_clock_is_told_too() -> None:
    summary = summary_of(end="2020-12-09T13:00:10", days=1e-4)
    assert short_summary(summary) == ["run: 8.64 s, 2 elements, 0 of 1 bonds broken", "  1 fragment at the end: 3 km2"]


def test_events_are_told_by_date() -> None:
    """Bug: all break-ups came before the collisions that they followed from."""

    def event(hour: int, **what: Any) -> dict[str, Any]:
        return {"time": f"2020-12-09T{hour:02}:00:00", "lon": -37.0, "lat": -55.0, **what}

    def broke(hour: int) -> dict[str, Any]:
        return event(hour, area_km2=9.0, bonds=1, grounded=False)

    def met(hour: int) -> dict[str, Any]:
        return event(hour, bergs=["A", "B"], speed=0.1)

    summary = summary_of(breakups=[broke(3), broke(9)], collisions=[met(1), met(4)])
    lines = short_summary(summary)[1:5]
    assert [line[2:18] for line in lines] == [f"2020-12-09 {hour:02}:00" for hour in (1, 3, 4, 9)]
    assert ["met" in line for line in lines] == [True, False, True, False]
    more = short_summary({**summary, "breakups": [broke(3)] * 12, "collisions": [met(4)] * 11})
    assert "  and 2 more break-ups, see summary.json" in more
    assert "  and 1 more collisions, see summary.json" in more
