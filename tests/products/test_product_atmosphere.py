"""ERA5, NCEP R1 and R2, JRA-55: real samples where there are any, published headers, else documentation (said so)."""

from __future__ import annotations

import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from products import product_files as files
from products.test_odd_files import AIR, plain, refused, written
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import open_all, recognise


def test_era5_old_store_equals_raw_times_scale_plus_offset(shared: Path) -> None:
    path = shared / "data" / "samples" / "ERA5_NA_2012.nc"
    ds = open_product(path)
    assert ds.attrs["product"] == "era5"
    with netCDF4.Dataset(path) as raw:
        raw.set_auto_maskandscale(False)
        u10, sst = raw["u10"], raw["sst"]
        expected = u10[:][:, ::-1] * u10.scale_factor + u10.add_offset
        warm = sst[:][:, ::-1] * sst.scale_factor + sst.add_offset - 273.15
        missing = sst[:][:, ::-1] == sst._FillValue
    np.testing.assert_allclose(ds["ua"].values, expected, rtol=0, atol=2e-5)
    np.testing.assert_array_equal(np.isnan(ds["sst"].values), missing)
    np.testing.assert_allclose(ds["sst"].values[~missing], warm[~missing], rtol=0, atol=1e-4)
    assert ds["sst"].attrs["units"] == "degree_Celsius"
    assert -3.0 < float(ds["sst"].min()) < float(ds["sst"].max()) < 35.0


def test_era5_old_store_axes_and_dates(shared: Path) -> None:
    ds = open_product(shared / "data" / "samples" / "ERA5_NA_2012.nc")
    np.testing.assert_array_equal(ds["time"].values, np.array(["2012-01-01", "2013-01-01"], dtype="datetime64[ns]"))
    assert ds["lat"].values[0] == 20.0
    assert ds["lat"].values[-1] == 80.0
    assert np.all(np.diff(ds["lon"].values) == pytest.approx(0.25))


def test_era5_new_store_valid_time_number_and_text_version(tmp_path: Path) -> None:
    ds = open_product(files.era5_new(tmp_path))
    assert list(ds.data_vars) == ["ua", "va"]
    assert set(ds.coords) == {"time", "lat", "lon"}
    np.testing.assert_array_equal(
        ds["time"].values, np.array(["2020-12-16T00:00", "2020-12-16T01:00"], dtype="datetime64[ns]")
    )
    # Rows of the file run southward.
    np.testing.assert_allclose(ds["ua"].values[0, -1], [0.0, 1.0, 2.0, 3.0])
    assert np.isnan(ds["ua"].values[1, 0, 3])
    assert ds["ua"].attrs["standard_name"] == "eastward_wind"


def test_era5_two_versions_are_joined(tmp_path: Path) -> None:
    """Old store, last three months: dimension expver, each hour filled in one version only. Documentation only."""
    values = np.full((2, 2, 2, 2), files.FILL_INT16, dtype=np.int16)
    values[0, 0], values[1, 1] = 100, 200
    field = ("i2", ("time", "expver", "latitude", "longitude"), values)
    packing = {"_FillValue": np.int16(files.FILL_INT16), "units": "m s**-1", "scale_factor": 0.01, "add_offset": 1.0}
    path = files.write(
        tmp_path / "era5t.nc",
        {"time": 2, "expver": 2, "latitude": 2, "longitude": 2},
        {
            "time": ("i4", ("time",), [1060080, 1060081], {"units": "hours since 1900-01-01", "calendar": "gregorian"}),
            "expver": ("i4", ("expver",), [1, 5], {}),
            "latitude": ("f4", ("latitude",), [-56.0, -56.25], {"units": "degrees_north"}),
            "longitude": ("f4", ("longitude",), [-38.0, -37.75], {"units": "degrees_east"}),
            "u10": (*field, packing),
        },
        history="grib_to_netcdf",
    )
    ds = open_product(path)
    np.testing.assert_allclose(ds["ua"].values[:, 0, 0], [2.0, 3.0])


def test_era5_waves_say_from_where_they_come(tmp_path: Path) -> None:
    """Wave file of the new store. Documentation only."""
    field = ("f4", ("valid_time", "latitude", "longitude"))
    path = files.write(
        tmp_path / "data_stream-wave_stepType-instant.nc",
        {"valid_time": 1, "latitude": 2, "longitude": 2},
        {
            "valid_time": ("i8", ("valid_time",), [1608076800], {"units": "seconds since 1970-01-01"}),
            "latitude": ("f8", ("latitude",), [-56.0, -56.5], {"units": "degrees_north"}),
            "longitude": ("f8", ("longitude",), [-38.0, -37.5], {"units": "degrees_east"}),
            "swh": (*field, [[[3, 3], [4, 4]]], {"units": "m"}),
            "mwp": (*field, [[[9, 9], [9, 9]]], {"units": "s"}),
            "mwd": (*field, [[[270, 270], [270, 270]]], {"units": "Degree true"}),
        },
    )
    ds = open_product(path)
    assert ds["wave_direction"].values[0, 0, 0] == 270.0
    assert "FROM" in ds["wave_direction"].attrs["positive_means"]
    assert ds["wave_height"].values[0, 0, 0] == 4.0
    both = [path, files.era5_new(tmp_path)]
    assert [part.sizes["lat"] for part in open_all(both)] == [2, 3]
    with pytest.raises(ForcingError, match="2 datasets"):
        open_product(both)


def test_era5_arco_zarr_store(tmp_path: Path) -> None:
    """ARCO layout (long names, latitude 90..-90, longitude 0..359.75). Documentation only."""
    pytest.importorskip("zarr")
    lat, lon = np.arange(90.0, -91.0, -45.0), np.arange(0.0, 360.0, 90.0)
    wind = np.arange(20.0).reshape(1, 5, 4)
    dims = ("time", "latitude", "longitude")
    store = xr.Dataset(
        {"10m_u_component_of_wind": (dims, wind), "10m_v_component_of_wind": (dims, -wind)},
        coords={"time": np.array(["2020-12-16"], dtype="M8[ns]"), "latitude": lat, "longitude": lon},
    )
    store["time"].encoding["units"] = "hours since 1900-01-01"
    store.to_zarr(tmp_path / "era5.zarr", consolidated=True, zarr_format=2)
    ds = open_product(tmp_path / "era5.zarr")
    np.testing.assert_allclose(ds["lon"], [-180.0, -90.0, 0.0, 90.0])
    # The last row of the file is the south pole: 16 at 0 E, 18 at 180.
    np.testing.assert_allclose(ds["ua"].values[0, 0], [18.0, 19.0, 16.0, 17.0])


def test_ncep_r1_published_header(tmp_path: Path) -> None:
    ds = open_product([files.ncep_r1(tmp_path), files.ncep_r1(tmp_path, "vwnd")])
    assert ds.attrs["product"] == "ncep-r1"
    assert ds["time"].values[0] == np.datetime64("1800-01-01T00") + np.timedelta64(1936512, "h")
    np.testing.assert_allclose(ds["lat"], [-58.0940, -56.1893, -54.2846], atol=1e-6)
    np.testing.assert_allclose(ds["lon"], [-40.3125, -38.4375, -36.5625, -34.6875])
    assert np.isnan(ds["ua"].values[0, -1, 0])
    np.testing.assert_allclose(ds["ua"].values[0, 0], [8.0, 9.0, 10.0, 11.0])
    np.testing.assert_allclose(ds["va"].values, -ds["ua"].values)


def test_ncep_r1_real_file_with_its_variable_renamed(tmp_path: Path, shared: Path) -> None:
    """The real sample is air temperature on the grid of uwnd.10m.gauss: renamed, it is a wind file of real layout."""
    sample = shared / "data" / "samples" / "r1_v2014_air.2m.gauss.1960.nc"
    assert recognise(sample).name == "ncep-r1"
    with pytest.raises(ForcingError, match="it has air"):
        open_product(sample)
    path = Path(shutil.copy(sample, tmp_path / "uwnd.10m.gauss.1960.nc"))
    path.chmod(0o644)
    with netCDF4.Dataset(path, "a") as raw:
        raw.renameVariable("air", "uwnd")
        raw["uwnd"].setncatts({"units": "m/s", "long_name": "4xDaily u-wind at 10 m"})
        raw.set_auto_maskandscale(False)
        values = raw["uwnd"][:]
    ds = open_product(path)
    assert ds["time"].values[0] == np.datetime64("1960-01-01T00:00")
    assert np.all(np.diff(ds["time"].values) == np.timedelta64(6, "h"))
    assert ds["lat"].values[0] == pytest.approx(-86.6531)
    assert ds["lon"].values[0] == pytest.approx(-180.0)
    assert ds["lon"].values[-1] == pytest.approx(178.125)
    np.testing.assert_array_equal(ds["ua"].values[:, ::-1, 96:], values[:, :, :96])


def test_ncep_old_calendar_has_no_two_day_slip(tmp_path: Path) -> None:
    """Files before 2014 count hours since 1-1-1 on the mixed calendar: 17067072 is 1948-01-01. Documentation only."""
    path = files.ncep_r1(tmp_path, start=17067072.0)
    with netCDF4.Dataset(path, "a") as raw:
        raw["time"].units = "hours since 1-1-1 00:00:0.0"
    assert open_product(path)["time"].values[0] == np.datetime64("1948-01-01T00:00")


def test_ncep_r2_level_and_packing(tmp_path: Path) -> None:
    """R2: singleton level, packed int16, missing 32766. Documentation only."""
    raw = np.array([[[[-12000, 32766]], [[5000, 0]]]], dtype=np.int16).reshape(1, 1, 2, 2)
    path = files.write(
        tmp_path / "uwnd.10m.gauss.2020.nc",
        {"time": 1, "level": 1, "lat": 2, "lon": 2},
        {
            "time": ("f8", ("time",), [1936512.0], {"units": "hours since 1800-1-1 00:00:0.0"}),
            "level": ("f4", ("level",), [10.0], {"units": "m"}),
            "lat": ("f4", ("lat",), [-54.0, -56.0], {"units": "degrees_north"}),
            "lon": ("f4", ("lon",), [320.0, 322.0], {"units": "degrees_east"}),
            "uwnd": (
                "i2",
                ("time", "level", "lat", "lon"),
                raw,
                {
                    "missing_value": np.int16(32766),
                    "scale_factor": np.float32(0.01),
                    "add_offset": np.float32(202.66),
                    "units": "m/s",
                    "long_name": "6-Hourly Forecast of U-wind at 10 m",
                },
            ),
        },
        title="6-hourly NCEP/DOE AMIP-II Reanalysis (Reanalysis-2)",
    )
    ds = open_product(path)
    assert ds.attrs["product"] == "ncep-r2"
    assert ds["ua"].dims == ("time", "lat", "lon")
    assert ds["ua"].values[0, 1, 0] == pytest.approx(-120.0 + 202.66, abs=1e-4)
    assert np.isnan(ds["ua"].values[0, 1, 1])


def test_ncep_wind_on_a_sigma_level_is_refused(tmp_path: Path) -> None:
    path = files.ncep_r1(tmp_path)
    with netCDF4.Dataset(path, "a") as raw:
        raw["uwnd"].long_name = "4xDaily u-wind at sigma level 995"
    with pytest.raises(ForcingError, match="not the wind at 10 m"):
        open_product(path)


def test_jra55_from_grib_by_ncl(tmp_path: Path) -> None:
    """NCL names and axes of JRA-55. Documentation only."""
    wind = np.arange(4, dtype=np.float32).reshape(1, 2, 2)
    dims = ("initial_time0_hours", "g4_lat_1", "g4_lon_2")
    path = files.write(
        tmp_path / "anl_surf.033_ugrd.reg_tl319.2020120100_2020123118.nc",
        dict(zip(dims, wind.shape, strict=True)),
        {
            "initial_time0_hours": ("f8", dims[:1], [1936512.0], {"units": "hours since 1800-01-01 00:00"}),
            "g4_lat_1": ("f4", dims[1:2], [-55.9, -56.5], {"units": "degrees_north", "GridType": "Gaussian"}),
            "g4_lon_2": ("f4", dims[2:], [321.75, 322.3125], {"units": "degrees_east"}),
            "UGRD_GDS4_HTGL": ("f4", dims, wind, {"units": "m s-1", "_FillValue": np.float32(1e20)}),
        },
    )
    ds = open_product(path)
    assert ds.attrs["product"] == "jra55"
    np.testing.assert_allclose(ds["ua"].values[0], [[2.0, 3.0], [0.0, 1.0]])
    assert ds["lon"].values[0] == pytest.approx(-38.25)


@pytest.mark.parametrize("kind", ["isobaricInhPa", "hybrid", "isobaricInPa"])
def test_a_wind_that_grib_puts_on_a_pressure_or_model_level_is_refused(tmp_path: Path, kind: str) -> None:
    ds = plain(names=AIR)
    for name in AIR:
        ds[name].attrs["GRIB_typeOfLevel"] = kind
    refused(written(tmp_path, ds), f"on a pressure or model level ({kind.lower()})")
