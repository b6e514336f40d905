"""Interpolation to points of a model grid: space, land, time, gaps, directions, depths."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from products.probe import at_points
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import ModelGrid, Run
from riftberg.ocean.files_schema import FileForcing

LON, LAT = np.arange(-42.0, -34.0, 0.5), np.arange(-60.0, -52.0, 0.5)


def plane(a: float = 0.1, b: float = -0.2, days: int = 1, name: str = "uo") -> xr.Dataset:
    """Return a field linear in longitude, latitude and days."""
    space = a * LON[None, :] + b * LAT[:, None]
    time = np.datetime64("2020-12-01", "ns") + np.arange(days) * np.timedelta64(86400, "s")
    values = space[None] + np.arange(days)[:, None, None]
    return xr.Dataset({name: (("time", "lat", "lon"), values)}, coords={"time": time, "lat": LAT, "lon": LON})


def still(days: int = 1, name: str = "uo") -> xr.Dataset:
    """Return a field that is 1 everywhere."""
    ds = plane(0.0, 0.0, days, name)
    ds[name][:] = 1.0
    return ds


@settings(max_examples=50, deadline=None)
@given(lon=st.floats(-42.0, -34.5), lat=st.floats(-60.0, -52.5), hour=st.integers(0, 48))
def test_linear_fields_come_back_exactly(lon: float, lat: float, hour: int) -> None:
    moment = np.datetime64("2020-12-01", "ns") + np.timedelta64(hour, "h")
    ds = plane(0.01, -0.02, days=3)
    found = at_points(ds, np.array([lon]), np.array([lat]), [moment])
    assert found["uo"].values[0, 0, 0] == pytest.approx(0.01 * lon - 0.02 * lat + hour / 24.0, abs=1e-9)


def test_two_dimensional_targets_and_other_branch() -> None:
    lon, lat = np.meshgrid(np.array([322.1, 322.6]), np.array([-56.2, -55.9, -55.1]))
    found = at_points(plane(0.01, -0.02), lon, lat)
    np.testing.assert_allclose(found["uo"].values[0], 0.01 * (lon - 360.0) - 0.02 * lat)


def test_weights_are_renormalised_over_wet_points() -> None:
    ds = still()
    ds["uo"].loc[dict(lon=-38.0)] = np.nan
    found = at_points(ds, np.array([-38.4, -38.25, -38.1]), np.array([-56.2]))
    np.testing.assert_allclose(found["uo"].values, 1.0)


def test_inland_points_take_the_nearest_wet_value_within_the_limit() -> None:
    ds = still()
    ds["uo"].loc[dict(lon=slice(-40.0, -34.0))] = np.nan
    found = at_points(ds, np.array([-40.0, -39.6, -38.0]), np.array([-56.0]))
    np.testing.assert_array_equal(found["uo"].values[0, 0], [1.0, 1.0, np.nan])


def test_nothing_lies_beyond_the_known_values() -> None:
    ds = plane(0.01, -0.02, days=2)
    rng = np.random.default_rng(5)
    ds["uo"] = ds["uo"].where(rng.random(ds["uo"].shape) > 0.6)
    found = at_points(ds, np.arange(-41.0, -35.0, 0.3), np.arange(-59.0, -53.0, 0.3), ["2020-12-01T06:00"])["uo"]
    known = ds["uo"].values[np.isfinite(ds["uo"].values)]
    assert np.isfinite(found.values).mean() > 0.99
    assert known.min() - 1e-9 <= float(found.min())
    assert float(found.max()) <= known.max() + 1e-9


def test_a_missing_record_is_bridged_but_not_two() -> None:
    ds = plane(0.01, -0.02, days=4)
    ds = xr.concat([ds, (ds - 3.0).assign_coords(time=ds["time"] + np.timedelta64(4, "D"))], "time").isel(
        time=slice(0, 7)
    )
    once = ds.isel(time=[0, 1, 3, 4, 5, 6])
    at = (np.array([-38.0]), np.array([-56.0]))
    value = at_points(once, *at, ["2020-12-03"])["uo"].values[0, 0, 0]
    assert value == pytest.approx(at_points(ds, *at, ["2020-12-03"])["uo"].values[0, 0, 0])
    twice = ds.isel(time=[0, 1, 4, 5, 6])
    with pytest.raises(ForcingError, match=r"gap of 3 days between 2020-12-02T00:00 and 2020-12-05T00:00"):
        at_points(twice, *at, ["2020-12-03"])
    assert np.isfinite(at_points(twice.assign_attrs(max_gap_seconds=4 * 86400.0), *at, ["2020-12-03"])["uo"]).all()
    # Dates outside the gap are served, however long it is.
    assert at_points(twice, *at, ["2020-12-05T12:00"]).sizes["time"] == 1


def test_dates_outside_the_records_are_refused_unless_held() -> None:
    at = (np.array([-38.0]), np.array([-56.0]))
    ds = plane(0.01, -0.02, days=2)
    with pytest.raises(ForcingError, match=r"2020-11-30T23:00 lies outside the records"):
        at_points(ds, *at, ["2020-11-30T23:00"])
    held = at_points(ds.assign_attrs(hold_seconds=3600.0), *at, ["2020-11-30T23:00"])
    assert held["uo"].values[0, 0, 0] == pytest.approx(0.01 * -38.0 + 0.02 * 56.0)


def test_targets_outside_the_data_are_refused() -> None:
    with pytest.raises(
        ForcingError, match=r"1 points of the model grid lie outside the data, the first at 56.00 S, 30.00 W"
    ):
        at_points(plane(0.01, -0.02), np.array([-38.0, -30.0]), np.array([-56.0]))


def test_waves_from_350_and_10_degrees_come_from_north() -> None:
    ds = still(name="wave_direction")
    ds["wave_direction"][:] = 350.0
    ds["wave_direction"].loc[dict(lon=-38.0)] = 10.0
    found = at_points(ds, np.array([-38.25]), np.array([-56.0]))
    assert found["wave_x"].values[0, 0, 0] == pytest.approx(0.0, abs=1e-9)
    assert found["wave_y"].values[0, 0, 0] < -0.9


def test_shore_shoals_to_zero_depth() -> None:
    depth = np.where(LON < -38.0, 100.0, np.nan)
    values = np.broadcast_to(depth, (LAT.size, LON.size)).copy()
    ds = xr.Dataset({"depth_below_surface": (("lat", "lon"), values)}, coords={"lat": LAT, "lon": LON})
    found = at_points(ds, np.array([-38.5, -38.25, -38.0, -37.0]), np.array([-56.0]))
    np.testing.assert_allclose(found["depth_below_surface"].values[0, 0], [100.0, 50.0, 0.0, 0.0])


def on_grid(ds: xr.Dataset, spacing: float) -> tuple[ModelGrid, np.ndarray]:
    """Return a model grid in the middle of a dataset, and the only field of it at the corners."""
    asked = FileForcing(
        kind="files", files=["x.nc"], longitude=(-39.9, -36.3), latitude=(-57.9, -54.3), spacing=spacing
    )
    run = Run.of(datetime(2020, 12, 1), 1.0, np.array([200.0]), 850.0)
    grid = ModelGrid.of(asked, [ds], run)
    part = grid.part(ds, run)
    [name] = [name for name in part.records.names if name != "wave_y"]
    return grid, part.records.field(name, 0.0).before[0]


def test_fine_soundings_are_averaged_not_skipped() -> None:
    lon, lat = np.arange(-40.3, -36.0, 0.01) + 0.005, np.arange(-58.3, -54.0, 0.01) + 0.005
    values = np.full((lat.size, lon.size), 1000.0)
    values[200:210, 200:210] = 100.0
    ds = xr.Dataset({"depth_below_surface": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon})
    _, depth = on_grid(ds, 0.1)
    assert (1000.0 - depth).sum() == pytest.approx(900.0, rel=1e-3)


def test_fine_directions_are_averaged_as_vectors() -> None:
    lon, lat = np.arange(-41.0, -35.0, 0.05), np.arange(-59.0, -53.0, 0.05)
    values = np.broadcast_to(np.where(np.arange(lon.size) % 2, 350.0, 10.0), (lat.size, lon.size))
    ds = xr.Dataset({"wave_direction": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon})
    _, east = on_grid(ds, 0.2)
    np.testing.assert_allclose(east, 0.0, atol=1e-9)


def test_land_of_the_floor_is_land_of_the_grid() -> None:
    values = np.broadcast_to(np.where(LON < -38.0, 100.0, np.nan), (LAT.size, LON.size)).copy()
    ds = xr.Dataset({"depth_below_surface": (("lat", "lon"), values)}, coords={"lat": LAT, "lon": LON})
    grid, _ = on_grid(ds, 0.3)
    cells = grid.grid.arrays.mask[grid.grid.domain]
    middles = 0.5 * (grid.lon[:-1] + grid.lon[1:])
    np.testing.assert_array_equal(cells, np.broadcast_to(middles < -38.0, cells.shape))


def test_global_source_is_joined_at_its_seam() -> None:
    lon = np.arange(-180.0, 180.0, 10.0)
    lat = np.arange(-90.0, 91.0, 10.0)
    values = np.broadcast_to(np.cos(np.deg2rad(lon)), (lat.size, lon.size))
    ds = xr.Dataset({"ssh": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon})
    target = np.arange(-180.0, 180.0, 5.0)
    found = at_points(ds, target, np.array([-56.0]))
    np.testing.assert_allclose(found["ssh"].values[0, 0], np.cos(np.deg2rad(target)), atol=5e-3)


def test_real_fields_on_their_own_grid_come_back(shared: Path) -> None:
    path = shared / "data" / "a68a" / "a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc"
    ds = open_product(path)
    found = at_points(ds, ds["lon"].values, ds["lat"].values)
    wet = np.isfinite(ds["uo"].values)
    np.testing.assert_allclose(found["uo"].values.reshape(wet.shape)[wet], ds["uo"].values[wet], rtol=0, atol=1e-12)


def test_global_sea_level_on_the_a68a_grid(shared: Path) -> None:
    ds = open_product(shared / "data" / "samples" / "nrt_global_allsat_phy_l4_20190223_20190226.nc")
    lon, lat = np.arange(-49.5625, -20.6, 0.125), np.arange(-65.5625, -46.6, 0.125)
    found = at_points(ds, lon, lat, ["2019-02-23"])
    assert found["ssh"].shape == (1, 152, 232)
    near = ds["ssh"].sel(lon=-38.125, lat=-56.125).values[0]
    i, j = int(np.argmin(np.abs(lon + 38.125))), int(np.argmin(np.abs(lat + 56.125)))
    assert abs(found["ssh"].values[0, j, i] - near) < 0.05
    assert float(np.isfinite(found["ssh"]).mean()) > 0.9


def test_records_are_read_in_blocks_not_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A month of hours was read chunk by chunk for every hour: 60 s instead of 1 s."""
    pytest.importorskip("dask")
    from xarray.backends.netCDF4_ import NetCDF4ArrayWrapper

    hours = xr.concat([plane(0.01, -0.02)] * 200, dim="time").assign_coords(
        time=np.datetime64("2020-12-01", "ns") + np.arange(200) * np.timedelta64(1, "h")
    )
    hours["uo"].attrs = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}
    hours["lat"].attrs, hours["lon"].attrs = {"units": "degrees_north"}, {"units": "degrees_east"}
    hours.to_netcdf(tmp_path / "hours.nc")
    reads = []
    fetch = NetCDF4ArrayWrapper._getitem

    def counted(self: NetCDF4ArrayWrapper, key: object) -> np.ndarray:
        reads.append(self.variable_name)
        return fetch(self, key)

    ds = open_product(tmp_path / "hours.nc")
    monkeypatch.setattr(NetCDF4ArrayWrapper, "_getitem", counted)
    start = datetime(2020, 12, 1)
    times = [start + timedelta(minutes=30 * k) for k in range(398)]
    at_points(ds, np.array([-38.2]), np.array([-56.1]), times)
    assert 1 <= reads.count("uo") <= 5  # blocks of 48 records


def test_levels_are_kept() -> None:
    ds = plane(0.01, -0.02).expand_dims(depth=[5.0, 50.0]).transpose("time", "depth", "lat", "lon")
    found = at_points(ds, np.array([-38.0]), np.array([-56.0]), ["2020-12-01"])
    assert found["uo"].dims == ("time", "depth", "y", "x")
    np.testing.assert_allclose(found["depth"], [5.0, 50.0])


def test_ice_that_comes_between_records_keeps_the_known_value() -> None:
    ds = still(days=2, name="ice_thickness")
    ds["ice_thickness"][1] = np.nan
    found = at_points(ds, np.array([-38.0]), np.array([-56.0]), ["2020-12-01T12:00"])
    assert found["ice_thickness"].values[0, 0, 0] == 1.0
