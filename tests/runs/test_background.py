"""Currents and sea floor that a run file keeps for maps."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from fakes import FakeForcing, FakeModel
from riftberg import Forcing, Iceberg, Model, open_run
from riftberg.errors import ForcingError
from riftberg.runs.background import find_water, stored_water
from riftberg.runs.run_file import RunWriter, memory_run

GROUP = "background"


class Turning(FakeForcing):
    """Current that turns with time and grows to the north."""

    def currents(self, lon: Any, lat: Any, time: float) -> tuple[Any, Any]:
        """Return the current at points."""
        return 1e-6 * time + 0.0 * lon, 0.01 * (lat + 55.0) + 0.0 * lon


def finished(tmp_path: Path, forcing: Any, days: float = 2.0, **how: Any) -> Path:
    """Run and return the file."""
    model = FakeModel(**how)
    model.forcing = forcing
    model.advance(days, recorders=[RunWriter(tmp_path / "run.nc", every_hours=6)])
    return tmp_path / "run.nc"


def test_currents_come_back_between_times_and_points(tmp_path: Path) -> None:
    water = stored_water(finished(tmp_path, Turning()))
    assert water is not None
    lon, lat = np.array([-39.0, -38.7, 321.2]), np.array([-55.0, -54.93, -55.1])
    for time in (0.0, 10_000.0, 172_800.0):
        u, v = water.currents(lon, lat, time)
        np.testing.assert_allclose(u, 1e-6 * time, atol=6e-4)
        np.testing.assert_allclose(v, 0.01 * (lat + 55.0), atol=6e-4)


def test_outside_of_the_stored_box_nothing_is_known(tmp_path: Path) -> None:
    water = stored_water(finished(tmp_path, Turning()))
    assert water is not None
    assert np.isnan(water.currents(np.array([-20.0]), np.array([-55.0]), 0.0)).all()
    assert np.isnan(water.depth(np.array([-39.0]), np.array([-70.0]))).all()


def test_the_main_group_stays_a_plain_trajectory_file(tmp_path: Path) -> None:
    path = finished(tmp_path, Turning())
    with xr.open_dataset(path) as ds:
        assert set(ds.sizes) == {"trajectory", "time", "bond", "fragment", "contact", "grounding", "rift_tip"}
    assert path.stat().st_size < 400_000
    assert not list(tmp_path.glob(".*.part"))


def test_the_water_of_an_open_run_is_found(tmp_path: Path) -> None:
    path = finished(tmp_path, FakeForcing())
    with open_run(path) as run:
        water = stored_water(run)
    assert water is not None
    assert float(water.depth(np.array([-38.9]), np.array([-55.0]))[0]) == pytest.approx(250.0, abs=0.2)


def test_a_run_in_metres_has_its_water_in_metres(tmp_path: Path) -> None:
    class Plain(FakeForcing):
        def depth(self, lon: Any, lat: Any) -> Any:
            return 300.0 + 0.001 * lon

    water = stored_water(finished(tmp_path, Plain(), latlon=False))
    assert water is not None
    np.testing.assert_allclose(water.depth(np.array([0.0, 5e3]), np.array([0.0, 0.0])), [300.0, 305.0], atol=0.1)
    np.testing.assert_allclose(water.currents(np.array([0.0]), np.array([0.0]), 0.0), [[0.2], [0.05]], atol=1e-3)


def test_a_forcing_that_cannot_be_asked_leaves_the_run_as_it_is(tmp_path: Path) -> None:
    class Silent(FakeForcing):
        def currents(self, lon: Any, lat: Any, time: float) -> tuple[Any, Any]:
            raise ForcingError("no records at this time")

    path = finished(tmp_path, Silent())
    assert stored_water(path) is None
    assert open_run(path).sizes["time"] == 9


def test_a_run_in_memory_does_without(tmp_path: Path) -> None:
    with memory_run(None, 6.0) as writer:
        FakeModel().advance(1, recorders=[writer])
        assert stored_water(writer.dataset()) is None


def test_bilinear_is_exact_for_bilinear_fields_and_blind_outside(tmp_path: Path) -> None:
    class Hollow(FakeForcing):
        def depth(self, lon: Any, lat: Any) -> Any:
            return 1000.0 + 500.0 * (1.0 + 1e-4 * lon) * (2.0 - 1e-4 * lat)

    water = stored_water(path := finished(tmp_path, Hollow(), latlon=False))
    assert water is not None
    with xr.open_dataset(path, group=GROUP) as box:
        edges = box["floor_x"].values[[0, -1]], box["floor_y"].values[[-1, 0]]
    x, y = (
        np.append(a, b)
        for a, b in zip(([123.0, 2000.0, -1500.0, 2e6], [700.0, 1000.0, -1234.0, 0.0]), edges, strict=True)
    )
    expected = Hollow().depth(x, y)
    expected[3] = np.nan
    np.testing.assert_allclose(water.depth(x, y), expected, atol=0.06)  # of slopes of 0.1 m a metre; kept to 0.1 m


def test_a_run_in_memory_knows_its_water(tmp_path: Path) -> None:
    """Maps of a run that was never a file had no current and no sea floor unless the forcing was given again."""
    sea = Forcing.uniform(current=(0.1, 0.0), depth=300.0, slope=(0.0, 0.0))
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    run = Model(berg, sea).run(steps=1)
    for known in (run, run.copy(deep=True), run.isel(time=slice(0, 1))):
        water = find_water(known)
        assert water is not None
        assert water.currents(np.array([-37.0]), np.array([-56.0]), 0.0)[0] == 0.1
        assert water.depth(np.array([-37.0]), np.array([-56.0])) == 300.0
    passed = find_water(pickle.loads(pickle.dumps(run)))
    assert passed is not None
    assert np.isnan(passed.depth(np.zeros(2), np.zeros(2))).all()  # the forcing stays behind
    run.isel(time=slice(0, 1)).to_netcdf(tmp_path / "copy.nc")  # bug: xarray warned of the length of texts
    assert find_water(open_run(tmp_path / "copy.nc")) is None


def test_a_forcing_that_cannot_be_asked_leaves_the_map_without_water(monkeypatch: pytest.MonkeyPatch) -> None:
    sea = Forcing.uniform(current=(0.1, 0.0), depth=300.0, slope=(0.0, 0.0))
    run = Model(Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0)), sea).run(steps=1)

    def silent(*_: Any) -> Any:
        raise ForcingError("no records at this time")

    monkeypatch.setattr(type(sea), "currents", silent)
    monkeypatch.setattr(type(sea), "depth", silent)
    water = find_water(run)
    assert water is not None
    assert np.isnan(water.currents(np.zeros(3), np.zeros(3), 0.0)).all()
    assert np.isnan(water.depth(np.zeros(3), np.zeros(3))).all()


def test_a_run_does_not_check_its_own_values_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[Path] = []
    monkeypatch.setattr("riftberg.runs.layout._check_values", lambda run, file: checked.append(file))
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    path = tmp_path / "run.nc"
    Model(berg, Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0))).run(steps=1, output=path).close()
    assert not checked
    open_run(path).close()
    assert checked == [path]


@pytest.mark.quick(1)
@pytest.mark.parametrize("size", [(2, 8), (8, 2), (4, 4)])
def test_the_box_of_the_water_is_centred_on_the_track_and_twice_as_wide_as_high(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    """For a berg that lies along its way or across it."""
    path = finished(tmp_path, Turning(), 2.2, nx=size[0], ny=size[1], latlon=False, turn_per_day=0.0, break_time=np.inf)
    with xr.open_dataset(path) as run, xr.open_dataset(path, group=GROUP) as water:
        for axis in ("x", "y"):
            track, box = run[axis].values, water[axis].values
            assert 0.5 * (box[0] + box[-1]) == pytest.approx(0.5 * (track.min() + track.max()), abs=1.0)
            extent = np.ptp(track, axis=0 if track.shape[0] == run.sizes["trajectory"] else 1).max()
            assert track.min() - box[0] > 0.1 * extent
        assert np.ptp(water["x"].values) >= 1.999 * np.ptp(water["y"].values)


def test_a_run_that_begins_late_has_water_every_six_hours_too(tmp_path: Path) -> None:
    model = FakeModel()
    model.forcing = Turning()
    model.advance(1.0)
    model.advance(1.0, recorders=[RunWriter(tmp_path / "run.nc", every_hours=6)])
    with xr.open_dataset(tmp_path / "run.nc", group=GROUP, decode_times=False) as water:
        np.testing.assert_allclose(np.diff(water["time"].values), 21_600.0)


@pytest.mark.parametrize("lat", [0.0, -60.0, 75.0])
def test_on_the_sphere_the_box_is_twice_as_wide_as_high_in_kilometres(lat: float, tmp_path: Path) -> None:
    path = finished(tmp_path, Turning(), 1.0, nx=2, ny=8, lat=lat, turn_per_day=0.0, break_time=np.inf)
    with xr.open_dataset(path, group=GROUP) as water:
        x, y = water["x"].values, water["y"].values
    assert np.ptp(x) * np.cos(np.radians(0.5 * (y[0] + y[-1]))) == pytest.approx(2.0 * np.ptp(y), rel=1e-6)
