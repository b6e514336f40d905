"""Results by berg: the group ``tracks`` of a run file, and ``run.riftberg``."""

from __future__ import annotations

import math
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from fakes import FakeModel
from riftberg import Parameters, open_run
from riftberg.engines.common.fragments.tree import equivalent_rectangles
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.runs.tracks import Shapes, berg_position

RADIUS = 6_363_827.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two days of a berg that loses a piece after one."""
    path = tmp_path_factory.mktemp("tracks") / "run.nc"
    FakeModel().advance(2, recorders=[RunWriter(path, every_hours=3)])
    return path


def test_the_group_is_a_contiguous_ragged_array(path: Path) -> None:
    with xr.open_dataset(path, group="tracks") as tracks:
        assert tracks["rowsize"].values.tolist() == [17, 9]
        assert tracks["rowsize"].attrs["sample_dimension"] == "index"
        assert tracks["trajectory"].attrs["cf_role"] == "trajectory_id"
        # TrajAn takes the one data variable of the trajectories as the sizes of the rows.
        assert [name for name, v in tracks.data_vars.items() if v.dims == ("trajectory",)] == ["rowsize"]
        assert {name for name in tracks.coords if tracks[name].dims == ("trajectory",)} >= {"parent", "birth", "name"}
        assert tracks["parent"].values.tolist() == [0, 1]
        assert tracks["birth"].values[1] == np.datetime64("2020-12-10T13:00")
        assert tracks["time"].values[17] == np.datetime64("2020-12-10T13:00")
        assert (np.diff(tracks["time"].values[:17]) > np.timedelta64(0)).all()
        assert set(tracks["area"].values[:8]) == {24 * 9e6}
        assert set(tracks["area"].values[17:]) == {6 * 9e6}
        assert all(tracks[name].attrs["units"] for name in ("u", "v", "spin", "mass", "length", "azimuth"))
        assert "second moments" in tracks["length"].attrs["long_name"]
    with netCDF4.Dataset(path) as file:
        rows = [v for v in file["tracks"].variables.values() if v.dimensions == ("index",) and v.name != "time"]
        assert {v.name for v in rows if v.coordinates == "time"} >= {"lon", "lat", "u", "v", "area", "mass", "aground"}
        assert [v.name for v in rows if v.coordinates != "time"] == []


def test_trajan_and_clouddrift_open_it(path: Path) -> None:
    pytest.importorskip("trajan")
    ragged = pytest.importorskip("clouddrift.ragged")
    with xr.open_dataset(path, group="tracks") as tracks:
        by_berg = tracks.traj
        assert dict(by_berg.ds.sizes) == {"trajectory": 2, "index": 17}
        assert np.isfinite(by_berg.ds["lon"].values).sum(axis=1).tolist() == [17, 9]
        assert by_berg.ds["time"].values[1, 0] == np.datetime64("2020-12-10T13:00")
        means = ragged.apply_ragged(np.mean, [tracks["lon"].values], tracks["rowsize"].values)
        assert means[1] == pytest.approx(tracks["lon"].values[17:].mean())


def test_a_reader_finds_the_same_from_the_elements(path: Path) -> None:
    with open_run(path) as run, xr.open_dataset(path, group="tracks") as tracks:
        xr.testing.assert_identical(run.riftberg.tracks.dataset, tracks.load())


def test_a_file_without_the_group_has_tracks_too(path: Path) -> None:
    """A run that was killed has no group yet, and a part of a run has its own tracks."""
    with open_run(path) as run:
        first = run.isel(time=slice(0, 8)).riftberg.tracks
        assert first["rowsize"].values.tolist() == [8]
        np.testing.assert_array_equal(first["lon"].values, run.riftberg.tracks["lon"].values[:8])


@pytest.mark.slow
def test_blocks_and_resuming_give_the_same_tracks(path: Path, tmp_path: Path) -> None:
    model, whole = FakeModel(), tmp_path / "run.nc"
    model.remembered = {}
    writer = RunWriter(whole, every_hours=3, flush_seconds=0)
    writer.start(model)
    for _ in range(60):
        model.step()
        writer.record(model)
    writer._taken.give_back()  # killed: the file ends at a record, without the group
    with netCDF4.Dataset(whole) as file:
        assert "tracks" not in file.groups
    again = RunWriter(whole, every_hours=3, flush_seconds=0, goes_on=True)
    again.start(model)
    for _ in range(36):
        model.step()
        again.record(model)
    again.finish(model)
    with xr.open_dataset(whole, group="tracks") as resumed, xr.open_dataset(path, group="tracks") as tracks:
        xr.testing.assert_identical(resumed.load(), tracks.load())


@pytest.mark.parametrize(("lon", "lat"), [(-39.0, -55.0), (179.99, -75.0), (10.0, 89.0), (30.0, 0.0)])
def test_a_rigid_body_has_its_velocity_spin_and_sides(lon: float, lat: float) -> None:
    """A rectangle of 60 km x 20 km that moves and turns as one, laid anywhere on the sphere."""
    east, north = (a.ravel() for a in np.meshgrid(np.arange(-28.5e3, 30e3, 3e3), np.arange(-8.5e3, 10e3, 3e3)[:7]))
    turned, spin, drift = math.radians(30.0), 2e-6, np.array([0.3, -0.1])
    x, y = east * math.cos(turned) - north * math.sin(turned), east * math.sin(turned) + north * math.cos(turned)
    x, y = x - x.mean(), y - y.mean()
    # Places and velocities of a body in space: a point of contact, a plane there, and unit vectors at each element.
    a, b = math.radians(lon), math.radians(lat)
    up = np.array([math.cos(b) * math.cos(a), math.cos(b) * math.sin(a), math.sin(b)])
    e0, n0 = np.array([-math.sin(a), math.cos(a), 0.0]), None
    n0 = np.cross(up, e0)
    place = np.sqrt(RADIUS**2 - x**2 - y**2)[:, None] * up + x[:, None] * e0 + y[:, None] * n0
    speed = (drift[0] - spin * y)[:, None] * e0 + (drift[1] + spin * x)[:, None] * n0
    phi, lam = np.arcsin(place[:, 2] / RADIUS), np.arctan2(place[:, 1], place[:, 0])
    e = np.stack([-np.sin(lam), np.cos(lam), 0 * lam], axis=-1)
    n = np.cross(place / RADIUS, e)
    u, v = (speed * e).sum(axis=1), (speed * n).sum(axis=1)
    side = np.full(x.size, 3e3)
    s = Shapes.of_one(np.degrees(lam), np.degrees(phi), side * side, latlon=True, radius=RADIUS)
    found = [float(value[0]) for value in s.motion(u, v, np.full(x.size, spin), side * side / 6.0)]
    assert found == pytest.approx([*drift, spin], rel=1e-4)
    assert (s.lon[0] - lon + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-6)
    assert s.azimuth[0] == pytest.approx(60.0, abs=1e-3)
    length, width = s.sides(side, side, side * side / 6.0)
    assert (length[0], width[0]) == pytest.approx((60e3, 21e3), rel=1e-4)


def test_sides_are_those_of_the_drag() -> None:
    """The same rectangle as drag knows it, for two bergs at once, one of a single element."""
    rng = np.random.default_rng(1)
    lon, lat = np.append(rng.uniform(-39.5, -38.5, 40), -30.0), np.append(rng.uniform(-55.2, -55.0, 40), -54.0)
    length, width = rng.uniform(1e3, 3e3, 41), rng.uniform(1e3, 3e3, 41)
    berg = np.append(np.zeros(40, np.int64), 1)
    shapes = Shapes(lon, lat, length * width, berg, 2, latlon=True, radius=RADIUS)
    found = shapes.sides(length, width, (length**2 + width**2) / 12.0)
    expected = equivalent_rectangles(lon, lat, length, width, berg, 2, True, RADIUS, 360.0)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_shapes_are_those_of_one_berg_at_a_time() -> None:
    rng = np.random.default_rng(2)
    lon, lat, area = rng.uniform(179.0, 181.0, 60), rng.uniform(-70.0, -69.0, 60), rng.uniform(1e6, 9e6, 60)
    berg = rng.integers(0, 3, 60)
    together = Shapes((lon + 180.0) % 360.0 - 180.0, lat, area, berg, 3, latlon=True)
    for k in range(3):
        alone = berg_position(lon[berg == k], lat[berg == k], area[berg == k])
        assert (together.lon[k] - alone.lon + 180.0) % 360.0 == pytest.approx(180.0)
        assert (together.lat[k], together.azimuth[k], together.area[k]) == pytest.approx(
            (alone.lat, alone.azimuth, alone.area)
        )


def test_the_accessor_has_tables_that_a_person_can_use(path: Path) -> None:
    with open_run(path) as run:
        frame = run.riftberg.tracks.to_dataframe()
        assert frame.index.names == ["berg", "time"]
        assert frame.loc["fragment 2"].index[0] == np.datetime64("2020-12-10T13:00")
        assert len(frame) == 26
        assert {"lon", "lat", "u", "v", "area", "azimuth", "stress_over_strength", "aground"} <= set(frame.columns)
        births = run.riftberg.fragments.to_dataframe()
        assert births.loc[2, ["parent", "elements"]].tolist() == [1, 6]
        elements = run.riftberg.elements
        np.testing.assert_array_equal(elements["u"], run["u"])
        assert elements["u"].dims == ("element", "time")
        assert not any("bond" in elements[name].dims for name in elements.data_vars)


@pytest.mark.quick(1)
@pytest.mark.parametrize("kind", ["tracks", "fragments", "elements"])
def test_each_table_has_a_picture_by_one_call(path: Path, tmp_path: Path, kind: str) -> None:
    with open_run(path) as run:
        table = getattr(run.riftberg, kind)
        assert table.plot(tmp_path / "picture.png", dpi=30).stat().st_size > 3000
        assert len(table.plot().axes) >= 1


@pytest.mark.slow
def test_a_berg_that_a_bed_of_sediment_carries_is_aground(tmp_path: Path) -> None:
    """Every reader of a run called it afloat: the bed carries a tip of it, over water deeper than its draft."""
    model = FakeModel(parameters=Parameters(grounding={"law": "seabed"}))
    model.elements.keel.floor_load[3] = 1e9
    model.advance(0.25, recorders=[RunWriter(tmp_path / "run.nc", every_hours=3)])
    FakeModel().advance(0.25, recorders=[RunWriter(tmp_path / "drag.nc", every_hours=3)])
    with open_run(tmp_path / "run.nc") as run, xr.open_dataset(tmp_path / "run.nc", group="tracks") as written:
        assert written["aground"].values.all()
        assert run.riftberg.tracks["aground"].values.all()
        assert Scene(run).aground().sum(axis=1).tolist() == [1] * run.sizes["time"]
        assert Scene(run).aground([1])[0].nonzero()[0].tolist() == [3]
        assert Scene(run).has_floor
    with open_run(tmp_path / "drag.nc") as run:
        assert "floor_load" not in run
        assert not run.riftberg.tracks["aground"].values.any()


def test_tables_follow_a_run_whose_variables_are_replaced(path: Path) -> None:
    """Bug: the tracks that were made first stayed, whatever the run held afterwards."""
    with open_run(path) as dataset:
        run = dataset.load()
    before = run.riftberg.tracks
    assert run.riftberg.tracks is before  # made once
    assert "area" in run.riftberg.fragments
    run["lon"] = run["lon"] + 1.0
    run["fragment_area"] = 2.0 * run["fragment_area"]
    np.testing.assert_allclose(run.riftberg.tracks["lon"], before["lon"] + 1.0, atol=1e-9)
    np.testing.assert_allclose(run.riftberg.fragments["area"][0], 2 * 24 * 9e6)
    np.testing.assert_array_equal(run.riftberg.elements["lon"], run["lon"])
