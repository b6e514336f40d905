"""The time step that a run takes where none is given."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import riftberg
from riftberg import Exchange, Forcing, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.runs.layout import run_parameters

SEA = Forcing.uniform((0.2, 0.0))


def berg(length: str = "12 km", place: tuple[float, float] = (-37.0, -56.0)) -> Iceberg:
    return Iceberg.rectangle(length, "6 km", thickness="200 m", placement=place)


def step_of(*bergs: Iceberg, forcing: Forcing = SEA, **stepping: Any) -> float:
    ice = bergs[0] if len(bergs) == 1 else Iceberg.join(list(bergs))
    return Model(ice, forcing, Parameters(stepping=stepping)).parameters.time_step or 0.0


@pytest.mark.parametrize(("length", "step"), [("9 km", 1800.0), ("12 km", 3600.0), ("90 km", 3600.0)])
def test_bergs_of_ten_kilometres_and_more_take_one_hour(length: str, step: float) -> None:
    assert step_of(berg(length)) == step


def test_the_shortest_berg_decides() -> None:
    assert step_of(berg(), berg("9 km", (-38.0, -56.0))) == 1800.0
    assert step_of(berg(), berg("15 km", (-38.0, -56.0))) == 3600.0
    lone = Iceberg.from_points([-38.0], [-56.0], length=11e3, width=5e3, thickness=150.0)
    assert step_of(lone) == 3600.0


def test_bergs_that_come_later_count_when_the_step_is_fitted_to_records() -> None:
    """Bug: the step was chosen anew by the bergs that were there, and became one hour with a small berg to come."""
    cloud = Iceberg.from_points(
        [-37.0, -38.0], [-56.0, -56.0], length=[12e3, 300.0], width=[6e3, 200.0], thickness=150.0
    )
    coming = replace(cloud, dates=(datetime(2020, 12, 1), datetime(2020, 12, 2)))
    model = Model(coming, SEA, start="2020-12-01")
    model.run(days=0.25, every_hours=3.0)
    assert model.parameters.time_step == 1800.0


def test_a_step_that_is_given_is_taken_as_given() -> None:
    assert step_of(berg(), time_step=1200.0) == 1200.0
    model = Model(berg(), SEA, Parameters(stepping={"time_step": 1700.0}))
    model.run(days=0.2, every_hours=1.5)
    assert model.parameters.time_step == 1700.0


def test_the_explicit_engine_takes_half_an_hour() -> None:
    assert step_of(berg(), scheme="mts") == 1800.0


def test_the_step_follows_tides_and_records() -> None:
    assert step_of(berg(), forcing=SEA + Forcing.tide(0.1, period="12.42 h")) == 3600.0
    assert step_of(berg(), forcing=SEA + Forcing.tide(0.1, period="6.2 h")) == 1800.0
    half_hourly = Forcing.along(np.arange(9) * 1800.0, uo=np.full(9, 0.2), vo=np.zeros(9), start="2020-12-01")
    assert step_of(berg(), forcing=half_hourly) == 1800.0


@pytest.mark.parametrize(("hours", "step"), [(0.5, 1800.0), (1.5, 2700.0), (1.0, 3600.0), (3.0, 3600.0), (0.25, 900.0)])
def test_the_step_divides_the_interval_of_the_records(hours: float, step: float) -> None:
    model = Model(berg(), SEA)
    run = model.run(days=0.25, every_hours=hours)
    assert model.parameters.time_step == step
    seconds = np.diff(run["time"].values) / np.timedelta64(1, "s")
    np.testing.assert_allclose(seconds, 3600.0 * hours)


def test_a_run_shorter_than_the_step_takes_a_shorter_one() -> None:
    model = Model(berg(), SEA)
    model.advance("20 min")
    assert (model.time, model.step_number) == (1200.0, 1)


def test_an_ocean_is_followed_by_whole_steps() -> None:
    lon, lat = np.meshgrid(np.arange(-38.0, -36.0, 0.25), np.arange(-57.0, -55.0, 0.25))
    grid = ocean_grid(lon, lat)
    for ocean_step, step in ((900.0, 900.0), (5400.0, 2700.0), (7200.0, 3600.0)):
        exchange = Exchange(Model(berg(), OceanForcing(grid, grid.fields())), ocean_step)
        assert exchange.model.parameters.time_step == step


def test_the_number_stands_in_files_and_goes_on_with_the_run(tmp_path: Path) -> None:
    model = Model(berg(), SEA, start="2020-12-01")
    model.run(days=0.25, every_hours=1.5, output=tmp_path / "run.nc")
    model.save(tmp_path / "a.restart.nc")
    resumed = Model.resume(tmp_path / "a.restart.nc", SEA)
    resumed.run(days=0.25, every_hours=1.0)  # a run keeps its step, whatever is recorded
    with riftberg.open_run(tmp_path / "run.nc") as run:
        assert run_parameters(run).stepping.time_step == 2700.0
    assert resumed.parameters.time_step == 2700.0


def test_members_take_the_step_of_the_first() -> None:
    def drifting(length: float) -> Model:
        return Model(berg(f"{length:g} km"), SEA, start="2020-12-01")

    for lengths, step in (([9.0, 15.0], 1800.0), ([15.0, 9.0], 3600.0)):
        result = riftberg.sweep(drifting, {"length": lengths}, days=0.25, every_hours=1, workers=0)
        for length, track in zip(lengths, result["lon"].values, strict=True):
            model = Model(berg(f"{length:g} km"), SEA, Parameters(stepping={"time_step": step}), start="2020-12-01")
            model.advance(0.25)
            assert np.ravel(track)[-1] == pytest.approx(
                np.average(model.elements.lon, weights=model.elements.mass), abs=1e-6
            )


def test_a_member_says_that_its_step_is_that_of_the_first() -> None:
    member = Model(berg(), SEA)
    member.take_time_step(1800.0, "it is that of the first member")
    assert "time step of 1800 s: it is that of the first member" in member.describe()


def test_the_model_says_which_step_it_takes_and_why() -> None:
    assert "time step of 3600 s: one hour serves bergs of 10 km or more" in Model(berg(), SEA).describe()
    tide = SEA + Forcing.tide(0.1, period="6 h")
    assert "time step of 1800 s: it follows a tide with a period of 6 h" in Model(berg(), tide).describe()
    assert "time step of" not in Model(berg(), SEA, Parameters(stepping={"time_step": 1800.0})).describe()


@pytest.mark.parametrize("length", ["12 km", "60 km"])
def test_one_hour_errs_by_less_than_a_hundredth_of_the_way(length: str) -> None:
    sea = SEA + Forcing.eddy((-37.0, -56.0), 40e3, 0.4)

    def end(step: float) -> tuple[float, float]:
        model = Model(berg(length), sea, Parameters(stepping={"time_step": step}))
        model.advance(2.0)
        e = model.elements
        return float(np.average(e.lon, weights=e.mass)), float(np.average(e.lat, weights=e.mass))

    (x, y), (fine_x, fine_y) = end(3600.0), end(450.0)
    east, north = (x - fine_x) * 62e3, (y - fine_y) * 111e3
    assert np.hypot(east, north) < 0.01 * np.hypot((fine_x + 37.0) * 62e3, (fine_y + 56.0) * 111e3)
