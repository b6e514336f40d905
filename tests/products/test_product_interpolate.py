"""Interpolation to the model grid: space, land, time, gaps, directions, depths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg.errors import ForcingError
from riftberg.products import open_product
from riftberg.products.axes import tidy_longitude
from riftberg.products.interpolate import to_grid

LON, LAT = np.arange(-42.0, -34.0, 0.5), np.arange(-60.0, -52.0, 0.5)


def plane(a: float = 0.1, b: float = -0.2, days: int = 1, name: str = "uo") -> xr.Dataset:
    """Return a field linear in longitude, latitude and days."""
    space = a * LON[None, :] + b * LAT[:, None]
    time = np.datetime64("2020-12-01", "ns") + np.arange(days) * np.timedelta64(86400, "s")
    values = space[None] + np.arange(days)[:, None, None]
    return xr.Dataset({name: (("time", "lat", "lon"), values)}, coords={"time": time, "lat": LAT, "lon": LON})


@settings(max_examples=50, deadline=None)
@given(lon=st.floats(-42.0, -34.5), lat=st.floats(-60.0, -52.5), hour=st.integers(0, 48))
def test_linear_fields_come_back_exactly(lon: float, lat: float, hour: int) -> None:
    moment = np.datetime64("2020-12-01", "ns") + np.timedelta64(hour, "h")
    grid = to_grid(plane(days=3), np.array([lon]), np.array([lat]), [moment])
    assert grid["uo"].values[0, 0, 0] == pytest.approx(0.1 * lon - 0.2 * lat + hour / 24.0, abs=1e-9)
    assert grid["uo_origin"].values[0, 0, 0] == 1


def test_two_dimensional_targets_and_other_branch() -> None:
    lon, lat = np.meshgrid(np.array([322.1, 322.6]), np.array([-56.2, -55.9, -55.1]))
    grid = to_grid(plane(), lon, lat)
    assert grid["uo"].dims == ("time", "y", "x")
    np.testing.assert_allclose(grid["uo"].values[0], 0.1 * (lon - 360.0) - 0.2 * lat)


def test_weights_are_renormalised_over_wet_points() -> None:
    ds = plane(a=0.0, b=0.0)
    ds["uo"][:] = 3.0
    ds["uo"].loc[dict(lon=-38.0)] = np.nan
    grid = to_grid(ds, np.array([-38.4, -38.25, -38.1]), np.array([-56.2]))
    np.testing.assert_allclose(grid["uo"].values, 3.0)
    assert np.all(grid["uo_origin"].values == 1)


def test_inland_points_take_the_nearest_wet_value_within_the_limit() -> None:
    ds = plane(a=0.0, b=0.0)
    ds["uo"][:] = 3.0
    ds["uo"].loc[dict(lon=slice(-40.0, -34.0))] = np.nan
    grid = to_grid(ds, np.array([-40.0, -39.6, -38.0]), np.array([-56.0]), fill_cells=2)
    np.testing.assert_array_equal(grid["uo_origin"].values[0, 0], [2, 2, 0])
    np.testing.assert_allclose(grid["uo"].values[0, 0], [3.0, 3.0, 0.0])
    bare = to_grid(ds, np.array([-40.0]), np.array([-56.0]), fill_cells=0)
    assert bare["uo_origin"].values[0, 0, 0] == 0


def test_nothing_is_missing_after_interpolation() -> None:
    ds = plane(days=2)
    rng = np.random.default_rng(5)
    ds["uo"] = ds["uo"].where(rng.random(ds["uo"].shape) > 0.6)
    grid = to_grid(ds, np.arange(-41.0, -35.0, 0.3), np.arange(-59.0, -53.0, 0.3), ["2020-12-01T06:00"])
    assert np.isfinite(grid["uo"].values).all()
    known = ds["uo"].values[np.isfinite(ds["uo"].values)]
    found = grid["uo"].values[grid["uo_origin"].values > 0]
    assert known.min() - 1e-9 <= found.min()
    assert found.max() <= known.max() + 1e-9


def test_a_missing_record_is_bridged_but_not_two() -> None:
    ds = plane(days=7)
    once = ds.isel(time=[0, 1, 3, 4, 5, 6])
    at = (np.array([-38.0]), np.array([-56.0]))
    value = to_grid(once, *at, ["2020-12-03"])["uo"].values[0, 0, 0]
    assert value == pytest.approx(to_grid(ds, *at, ["2020-12-03"])["uo"].values[0, 0, 0])
    twice = ds.isel(time=[0, 1, 4, 5, 6])
    with pytest.raises(ForcingError, match=r"gap of 3 days between 2020-12-02T00:00 and 2020-12-05T00:00"):
        to_grid(twice, *at, ["2020-12-03"])
    longer = to_grid(twice, *at, ["2020-12-03"], max_gap=np.timedelta64(4, "D"))
    assert longer["uo"].values[0, 0, 0] == pytest.approx(value)
    # Dates outside the gap are served, however long it is.
    assert to_grid(twice, *at, ["2020-12-05T12:00"]).sizes["time"] == 1


def test_dates_outside_the_records_are_refused_unless_held() -> None:
    at = (np.array([-38.0]), np.array([-56.0]))
    with pytest.raises(ForcingError, match=r"2 of 3 dates, the first 2020-11-30T23:00"):
        to_grid(plane(days=2), *at, ["2020-11-30T23:00", "2020-12-01T12:00", "2020-12-02T01:00"])
    held = to_grid(plane(days=2), *at, ["2020-11-30T23:00"], hold=3600.0)
    assert held["uo"].values[0, 0, 0] == pytest.approx(0.1 * -38.0 + 0.2 * 56.0)


def test_targets_outside_the_data_are_refused_or_masked() -> None:
    lon, lat = np.array([-38.0, -30.0]), np.array([-56.0])
    with pytest.raises(ForcingError, match=r"1 points lie outside the data, the first at -30 E -56 N"):
        to_grid(plane(), lon, lat)
    masked = to_grid(plane(), lon, lat, outside="mask")
    np.testing.assert_array_equal(masked["uo_origin"].values[0, 0], [1, 0])
    assert masked["uo"].values[0, 0, 1] == 0.0


def test_waves_from_350_and_10_degrees_come_from_north() -> None:
    ds = plane(a=0.0, b=0.0, name="wave_direction")
    ds["wave_direction"][:] = 350.0
    ds["wave_direction"].loc[dict(lon=-38.0)] = 10.0
    grid = to_grid(ds, np.array([-38.25]), np.array([-56.0]))
    direction = grid["wave_direction"].values[0, 0, 0]
    assert min(direction, 360.0 - direction) == pytest.approx(0.0, abs=1e-6)
    assert grid["wave_direction_origin"].values[0, 0, 0] == 1


def test_shore_shoals_to_zero_depth() -> None:
    depth = np.where(LON < -38.0, 100.0, np.nan)
    values = np.broadcast_to(depth, (LAT.size, LON.size)).copy()
    ds = xr.Dataset({"depth_below_surface": (("lat", "lon"), values)}, coords={"lat": LAT, "lon": LON})
    grid = to_grid(ds, np.array([-38.5, -38.25, -38.0, -37.0]), np.array([-56.0]))
    np.testing.assert_allclose(grid["depth_below_surface"].values[0], [100.0, 50.0, 0.0, 0.0])


def test_fine_soundings_are_averaged_not_skipped() -> None:
    lon, lat = np.arange(-40.0, -36.0, 0.01) + 0.005, np.arange(-58.0, -54.0, 0.01) + 0.005
    values = np.full((lat.size, lon.size), 1000.0)
    values[200:210, 200:210] = 100.0
    ds = xr.Dataset({"depth_below_surface": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon})
    target_lon, target_lat = np.arange(-39.95, -36.2, 0.1), np.arange(-57.95, -54.2, 0.1)
    grid = to_grid(ds, target_lon, target_lat)
    missed = 1000.0 - grid["depth_below_surface"].values
    assert missed.sum() == pytest.approx(900.0, rel=1e-6)


def test_global_source_is_joined_at_its_seam() -> None:
    lon = np.arange(0.0, 360.0, 10.0)
    lat = np.arange(-90.0, 91.0, 10.0)
    values = np.broadcast_to(np.cos(np.deg2rad(lon)), (lat.size, lon.size))
    ds = tidy_longitude(xr.Dataset({"ssh": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon}))
    target = np.arange(-180.0, 180.0, 5.0)
    grid = to_grid(ds, target, np.array([-56.0]))
    np.testing.assert_allclose(grid["ssh"].values[0], np.cos(np.deg2rad(target)), atol=5e-3)


def test_real_fields_on_their_own_grid_come_back(shared: Path) -> None:
    path = shared / "data" / "a68a" / "a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc"
    ds = open_product(path)
    grid = to_grid(ds, ds["lon"].values, ds["lat"].values)
    wet = np.isfinite(ds["uo"].values)
    np.testing.assert_allclose(grid["uo"].values[wet], ds["uo"].values[wet], rtol=0, atol=1e-12)
    assert np.all(grid["uo_origin"].values[wet] == 1)
    assert np.all(grid["uo_origin"].values[~wet] != 1)


def test_global_sea_level_on_the_a68a_grid(shared: Path) -> None:
    ds = open_product(shared / "data" / "samples" / "nrt_global_allsat_phy_l4_20190223_20190226.nc")
    lon, lat = np.arange(-49.5625, -20.6, 0.125), np.arange(-65.5625, -46.6, 0.125)
    grid = to_grid(ds, lon, lat, ["2019-02-23"])
    assert grid["ssh"].shape == (1, 152, 232)
    near = ds["ssh"].sel(lon=-38.125, lat=-56.125).values[0]
    i, j = int(np.argmin(np.abs(lon + 38.125))), int(np.argmin(np.abs(lat + 56.125)))
    assert abs(grid["ssh"].values[0, j, i] - near) < 0.05
    share = float((grid["ssh_origin"].values == 1).mean())
    assert share > 0.9


def test_records_are_read_in_blocks_not_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A month of hours was read chunk by chunk for every hour: 60 s instead of 1 s."""
    pytest.importorskip("dask")
    from xarray.backends.netCDF4_ import NetCDF4ArrayWrapper

    hours = xr.concat([plane()] * 200, dim="time").assign_coords(
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
    times = np.datetime64("2020-12-01") + np.arange(398) * np.timedelta64(30, "m")
    to_grid(ds, np.array([-38.2]), np.array([-56.1]), times)
    assert 1 <= reads.count("uo") <= 4


def test_levels_are_kept() -> None:
    ds = plane().expand_dims(depth=[5.0, 50.0]).transpose("time", "depth", "lat", "lon")
    grid = to_grid(ds, np.array([-38.0]), np.array([-56.0]), ["2020-12-01"])
    assert grid["uo"].dims == ("time", "depth", "lat", "lon")
    np.testing.assert_allclose(grid["depth"], [5.0, 50.0])


def test_ice_that_comes_between_records_keeps_the_known_value() -> None:
    ds = plane(a=0.0, b=0.0, days=2)
    ds["uo"][1] = np.nan
    grid = to_grid(ds, np.array([-38.0]), np.array([-56.0]), ["2020-12-01T12:00"])
    assert grid["uo"].values[0, 0, 0] == 0.0
    assert grid["uo_origin"].values[0, 0, 0] == 1
