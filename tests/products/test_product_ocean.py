"""DUACS, GLORYS, ORAS5, GlobCurrent, the A68a experiment and plain CF files."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from products import product_files as files
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import keel_mean, recognise, window

A68A = "a68_experiment_{}_dec2020_ll_p125.nc"


def test_duacs_real_global_file_around_south_georgia(shared: Path) -> None:
    path = shared / "data" / "samples" / "nrt_global_allsat_phy_l4_20190223_20190226.nc"
    ds = open_product(path)
    assert ds.attrs["product"] == "duacs"
    assert list(ds.data_vars) == ["ssh"]
    assert (ds["lon"].values[0], ds["lon"].values[-1]) == (-179.875, 179.875)
    box = window(ds, (-41.0, -33.0), (-58.0, -54.0))
    with netCDF4.Dataset(path) as raw:
        raw.set_auto_maskandscale(False)
        j, i = 126, 1286
        assert (raw["latitude"][j], raw["longitude"][i]) == (-58.375 + 0.0, 321.625)
        expected = raw["adt"][0, j, i] * 1e-4
    value = ds["ssh"].sel(lat=-58.375, lon=321.625 - 360.0).values[0]
    assert value == pytest.approx(expected, abs=1e-6)
    assert not np.isnan(box["ssh"].values).any()
    assert -2.0 < float(box["ssh"].min()) < float(box["ssh"].max()) < 0.5


def test_duacs_land_is_missing_and_geostrophic_currents_only_on_demand(shared: Path) -> None:
    path = shared / "data" / "samples" / "nrt_global_allsat_phy_l4_20190223_20190226.nc"
    ds = open_product(path)
    assert np.isnan(ds["ssh"].sel(lat=-85.0, lon=0.0, method="nearest").values[0])
    currents = window(open_product(path, product="duacs-geostrophic"), (-41.0, -33.0), (-58.0, -54.0))
    assert float(np.hypot(currents["uo"], currents["vo"]).max()) == pytest.approx(0.49, abs=0.02)


def test_duacs_eighth_degree_layout(tmp_path: Path) -> None:
    """1/8 degree, -179.9375..179.9375 (here a strip). Documentation only."""
    lon = -179.9375 + 0.125 * np.arange(2880)
    raw = np.zeros((1, 2, 2880), dtype=np.int32)
    raw[0, 1, :] = 12345
    path = files.write(
        tmp_path / "dt_global_allsat_phy_l4_20201216_20210726.nc",
        {"time": 1, "latitude": 2, "longitude": 2880},
        {
            "time": ("f4", ("time",), [25917.0], {"units": "days since 1950-01-01 00:00:00", "calendar": "gregorian"}),
            "latitude": ("f4", ("latitude",), [-56.0625, -55.9375], {"units": "degrees_north"}),
            "longitude": ("f4", ("longitude",), lon, {"units": "degrees_east"}),
            "adt": (
                "i4",
                ("time", "latitude", "longitude"),
                raw,
                {"_FillValue": np.int32(-2147483647), "scale_factor": 1e-4, "units": "m"},
            ),
        },
        title="DT merged all satellites Global Ocean Gridded SSALTO/DUACS Sea Surface Height L4 product",
    )
    ds = open_product(path)
    assert ds["time"].values[0] == np.datetime64("2020-12-16")
    assert ds["ssh"].values[0, 1, 7] == pytest.approx(1.2345)
    across = window(ds, (179.0, -179.0), (-56.0, -55.9))
    assert np.all(np.diff(across["lon"].values) == pytest.approx(0.125))
    assert across["lon"].values[0] <= 179.0
    assert across["lon"].values[-1] >= 181.0


def test_glorys_native_packed_with_depth(shared: Path) -> None:
    path = shared / "data" / "samples" / "GLORYS_NA_20120101.nc"
    ds = open_product(path)
    assert ds.attrs["product"] == "glorys"
    assert ds["uo"].dims == ("time", "depth", "lat", "lon")
    assert ds["ssh"].dims == ("time", "lat", "lon")
    assert ds["time"].values[0] == np.datetime64("2012-01-01T12:00")
    assert np.all(np.diff(ds["depth"].values) > 0)
    with netCDF4.Dataset(path) as raw:
        raw.set_auto_maskandscale(False)
        packed, fill = raw["uo"][:], raw["uo"]._FillValue
        expected = packed * raw["uo"].scale_factor + raw["uo"].add_offset
        warm = raw["thetao"][0, 0] * raw["thetao"].scale_factor + raw["thetao"].add_offset
    wet = packed != fill
    np.testing.assert_array_equal(np.isnan(ds["uo"].values), ~wet)
    np.testing.assert_allclose(ds["uo"].values[wet], expected[wet], rtol=0, atol=1e-6)
    np.testing.assert_allclose(ds["sst"].values[0][wet[0, 0]], warm[wet[0, 0]], atol=1e-4)
    deep = open_product(path, levels=True)["sst"]
    assert deep.dims == ("time", "depth", "lat", "lon")
    np.testing.assert_array_equal(deep.isel(depth=0), ds["sst"])


def test_glorys_subset_stamped_at_midnight_is_put_at_noon(tmp_path: Path) -> None:
    """Toolbox subset: float32, NaN, seconds since 1970, scalar time. Documentation only."""
    path = files.write(
        tmp_path / "glorys_subset.nc",
        {"depth": 2, "latitude": 2, "longitude": 2},
        {
            "time": ("i8", (), 1608076800, {"units": "seconds since 1970-01-01", "standard_name": "time"}),
            "depth": ("f4", ("depth",), [0.5, 10.0], {"units": "m", "positive": "down", "standard_name": "depth"}),
            "latitude": ("f4", ("latitude",), [-56.0, -55.9167], {"units": "degrees_north"}),
            "longitude": ("f4", ("longitude",), [-38.0, -37.9167], {"units": "degrees_east"}),
            "uo": ("f4", ("depth", "latitude", "longitude"), np.full((2, 2, 2), 0.5), {"units": "m s-1"}),
            "zos": ("f4", ("latitude", "longitude"), [[-1.0, np.nan], [-1.1, -1.2]], {"units": "m"}),
        },
        title="daily mean fields from Global Ocean Physics Analysis and Forecast updated Daily",
        source="MERCATOR GLORYS12V1",
    )
    ds = open_product(path)
    assert ds["time"].values[0] == np.datetime64("2020-12-16T12:00")
    assert ds["ssh"].dims == ("time", "lat", "lon")
    assert np.isnan(ds["ssh"].values[0, 0, 1])
    assert keel_mean(ds, 10.0)["uo"].values[0, 0, 0] == pytest.approx(0.5)


def test_oras5_native_grid_becomes_plain_axes_in_the_south(tmp_path: Path) -> None:
    """NEMO layout with 2-D positions, seam inside the box. Documentation only."""
    x = np.array([-36.25, -36.0, 60.0, 120.0, -36.75, -36.5])
    lat = np.array([-56.0, -55.8, -55.6])
    nav_lon, nav_lat = np.meshgrid(x, lat)
    u = np.arange(18, dtype=np.float32).reshape(1, 3, 6)
    dims = ("time_counter", "y", "x")
    path = files.write(
        tmp_path / "sossheig_control_monthly_highres_2D_202012_OPER_v0.1.nc",
        {"time_counter": 1, "y": 3, "x": 6},
        {
            "nav_lon": ("f4", ("y", "x"), nav_lon, {"units": "degrees_east"}),
            "nav_lat": ("f4", ("y", "x"), nav_lat, {"units": "degrees_north"}),
            "time_counter": ("f8", ("time_counter",), [0.0], {"units": "seconds since 2020-12-01"}),
            "sossheig": ("f4", dims, u, {"units": "m"}),
        },
    )
    ds = open_product(path)
    assert ds["time"].values[0] == np.datetime64("2020-12-16T12:00")
    box = window(ds, (-36.8, -35.9), (-55.9, -55.7), margin=0.05)
    assert box["ssh"].dims == ("time", "lat", "lon")
    np.testing.assert_allclose(box["lon"].values[:4], [-36.75, -36.5, -36.25, -36.0], atol=1e-5)
    np.testing.assert_allclose(box["ssh"].values[0, 1, :4], [10.0, 11.0, 6.0, 7.0])


def test_globcurrent_with_unit_for_units(shared: Path) -> None:
    name = "20030101000000-GLOBCURRENT-L4-CUReul_hs-ALT_SUM-v02.0-fv01.0.nc"
    ds = open_product(shared / "data" / "samples" / name)
    assert ds.attrs["product"] == "globcurrent"
    assert ds["time"].values[0] == np.datetime64("1900-01-01") + np.timedelta64(37620, "D")
    assert ds["uo"].values[0, 0, 0] == pytest.approx(0.22216076)
    assert ds["uo"].attrs["units"] == "m s-1"


def test_a68a_monthly_files_land_and_positions(shared: Path) -> None:
    folder = shared / "data" / "a68a"
    ocean = open_product(folder / A68A.format("ocean_surf_and_mean_vel_fixed_oras5"))
    level = open_product(folder / A68A.format("ssh_oras5"))
    wind = open_product(folder / A68A.format("wind_vel_jra55"))
    stress = open_product(folder / A68A.format("wind_stress_oras5"))
    assert int(np.isnan(ocean["uo"].values).sum()) == 7
    assert ocean["lon"].values[0] == -49.5
    assert level["lon"].values[0] == -49.5625
    near = dict(lon=slice(-41, -33), lat=slice(-58, -54))
    speed = np.hypot(ocean["uo"], ocean["vo"]).sel(near)
    assert float(speed.max()) == pytest.approx(0.49, abs=0.01)
    assert 4.0 < float(wind["ua"].sel(near).mean()) < 6.0
    assert float(wind["va"].sel(near).mean()) < 0.0
    assert -1.7 < float(level["ssh"].sel(near).mean()) < -1.2
    assert 0.0 < float(stress["taux"].sel(near).mean()) < 0.2
    assert "time" not in ocean.dims


def test_a68a_mean_over_the_keel_is_a_product_of_its_own(shared: Path) -> None:
    path = shared / "data" / "a68a" / A68A.format("ocean_surf_and_mean_vel_fixed_oras5")
    near = dict(lon=slice(-41, -33), lat=slice(-58, -54))
    deep = open_product(path, product="a68a-keel-mean")
    assert float(np.hypot(deep["uo"], deep["vo"]).sel(near).max()) == pytest.approx(0.46, abs=0.01)


def test_a68a_bare_hourly_files_get_dates_and_positions(shared: Path) -> None:
    folder = shared / "reference" / "a68_synthetic" / "data"
    ocean = open_product(folder / "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc")
    level = open_product(folder / "a68_experiment_ssh_duacs_dec2020_HOURLY_ll_p125.nc")
    wind = open_product(folder / "a68_experiment_wind_vel_ncep_10m_dec2020_HOURLY_ll_p125.nc")
    # Record 206 counted from 1 is 9 December 13:00, the start of the paper's run.
    assert ocean["time"].values[205] == np.datetime64("2020-12-09T13:00")
    assert (ocean.sizes["time"], wind.sizes["time"]) == (744, 739)
    assert ocean["lon"].values[0] - level["lon"].values[0] == pytest.approx(0.0625)


def test_a68a_packed_slack_water_is_not_taken_for_land(shared: Path) -> None:
    ds = open_product(
        shared / "reference" / "a68_story" / "data" / "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc"
    )
    assert not np.isnan(ds["uo"].isel(time=slice(0, 30)).values).any()


def test_a68a_bare_file_without_its_grid_says_what_to_do(tmp_path: Path) -> None:
    path = files.write(
        tmp_path / "ocean_dec2020_HOURLY.nc",
        {"time": 2, "lat": 2, "lon": 2},
        {"uo": ("f8", ("time", "lat", "lon"), np.ones((2, 2, 2)), {})},
    )
    with pytest.raises(ForcingError, match=r"Put the experiment's grid file \*_grid\.nc in the same folder"):
        open_product(path)


def test_cf_file_is_taken_at_its_word(tmp_path: Path) -> None:
    path = files.write(
        tmp_path / "model.nc",
        {"t": 1, "j": 2, "i": 2},
        {
            "t": ("f8", ("t",), [12.0], {"units": "hours since 2020-12-16", "standard_name": "time"}),
            "j": ("f8", ("j",), [-56.0, -55.0], {"units": "degrees_north"}),
            "i": ("f8", ("i",), [-38.0, -37.0], {"units": "degrees_east"}),
            "U": (
                "f8",
                ("t", "j", "i"),
                [[[50.0, 60.0], [70.0, 80.0]]],
                {"units": "cm/s", "standard_name": "eastward_sea_water_velocity"},
            ),
        },
    )
    ds = open_product(path)
    assert recognise(path).name == "cf"
    np.testing.assert_allclose(ds["uo"].values[0], [[0.5, 0.6], [0.7, 0.8]])
    assert ds["time"].values[0] == np.datetime64("2020-12-16T12:00")


def test_unknown_units_are_an_error_with_the_variable_named(tmp_path: Path) -> None:
    path = files.write(
        tmp_path / "model.nc",
        {"lat": 2, "lon": 2},
        {
            "lat": ("f8", ("lat",), [-56.0, -55.0], {"units": "degrees_north"}),
            "lon": ("f8", ("lon",), [-38.0, -37.0], {"units": "degrees_east"}),
            "uo": ("f8", ("lat", "lon"), np.ones((2, 2)), {"units": "furlongs"}),
        },
    )
    with pytest.raises(ForcingError, match=r"variable uo: units 'furlongs' are not known"):
        open_product(path)
