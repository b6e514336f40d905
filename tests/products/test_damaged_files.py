"""Damaged and unusual files: words instead of tracebacks, and nothing read that is not there."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from products import product_files as files
from products.test_any_layout import START, Layout, elements, written
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_all

KINDS = (files.oscar_v1, files.oscar_v2, files.era5_new, files.ncep_r1)


def met_in_words(path: Path) -> None:
    """Open a file as the doctor and as a run do: only a `ForcingError` may come of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what libraries say of broken attributes
        assert doctor(path).text()
        # Values that the library itself cannot give, after a sound header, are told by the doctor above.
        with contextlib.suppress(ForcingError, OSError, RuntimeError):
            for ds in open_all(path):
                ds.load()


@pytest.mark.quick(1)
@pytest.mark.parametrize("make", KINDS)
def test_no_traceback_for_flipped_bytes(make: object, tmp_path: Path) -> None:
    path = make(tmp_path)  # type: ignore[operator]
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    for number in range(12):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), 1 + number % 4):
            data[place] = int(rng.integers(0, 256))
        path.write_bytes(bytes(data))
        met_in_words(path)


@pytest.mark.quick(1)
@pytest.mark.parametrize("make", KINDS)
def test_no_traceback_for_lost_attributes_and_variables(make: object, tmp_path: Path) -> None:
    path = make(tmp_path)  # type: ignore[operator]
    with netCDF4.Dataset(path) as file:
        known = [(name, key) for name, variable in file.variables.items() for key in variable.ncattrs()]
        names = list(file.variables)
    whole = path.read_bytes()
    for name, key in known[::2]:
        path.write_bytes(whole)
        with netCDF4.Dataset(path, "a") as file:
            if key != "_FillValue":
                file[name].delncattr(key)
        met_in_words(path)
    with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as ds:
        ds = ds.load()
    for name in names:
        path.unlink()
        ds.drop_vars(name).to_netcdf(path, format="NETCDF4_CLASSIC" if "expver" not in ds else "NETCDF4")
        met_in_words(path)


@pytest.mark.quick(5)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("form", ["NETCDF4", "NETCDF3_CLASSIC", "NETCDF3_64BIT", "NETCDF3_64BIT_DATA"])
def test_a_file_cut_short_is_told_and_never_read_as_zeros(form: str, share: float, tmp_path: Path) -> None:
    """Beyond its end a classic file reads as zeros: a run went on calm water without a word."""
    whole = written(tmp_path, Layout())
    with xr.open_dataset(whole) as ds:
        ds = ds.load()
    path = tmp_path / "cut.nc"
    ds.to_netcdf(path, format=form, engine="netcdf4")
    assert open_all(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data)) - 1])
    with pytest.raises(ForcingError, match=r"cut\.nc: (the file is cut short|cannot be opened|this is not a netCDF)"):
        open_all(path)
    if share >= 0.5:
        assert "cut short" in doctor(path).text()


def three_ice_fields(path: Path, *names: str, told: str = "sea_ice_area_fraction") -> Path:
    lat, lon = np.arange(-60.0, -50.0), np.arange(-45.0, -30.0)
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    fields = {
        name: (("lat", "lon"), np.full((lat.size, lon.size), 0.1 * (k + 1)), {"units": "1", "standard_name": told})
        for k, name in enumerate(names)
    }
    xr.Dataset(fields, axes).to_netcdf(path / "ice.nc")
    return path / "ice.nc"


def test_of_three_ice_fields_the_usual_one_is_taken_and_the_others_are_named(tmp_path: Path) -> None:
    path = three_ice_fields(tmp_path, "ice_upper", "siconc", "ice_lower")
    text = doctor(path, needed=("ice_fraction",)).text()
    assert "from siconc" in text
    assert "ice_upper, ice_lower could be it too" in text or "ice_lower, ice_upper could be it too" in text
    [ds] = open_all(path)
    np.testing.assert_allclose(ds["ice_fraction"], 0.2)


def test_of_three_unusual_ice_fields_a_choice_is_asked_for(tmp_path: Path) -> None:
    path = three_ice_fields(tmp_path, "ice_a", "ice_b", "ice_c")
    with pytest.raises(
        ForcingError, match=r"3 variables could be ice_fraction .*ice_a, ice_b, ice_c.* Name the right one"
    ):
        open_all(path)
    assert "3 variables could be ice_fraction" in doctor(path).text()


def test_an_analysis_and_forecast_is_not_called_a_reanalysis(tmp_path: Path) -> None:
    path = written(tmp_path, Layout())
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    path.unlink()
    ds = ds.rename(a="uo", b="vo").assign_attrs(
        title="daily mean fields, Global Ocean Physics Analysis and Forecast", source="MERCATOR PSY4QV3R1"
    )
    ds.to_netcdf(path)
    text = doctor(path, needed=("uo", "vo")).text()
    assert "mercator-forecast" in text
    assert "no reanalysis" in text
    ds.attrs = {"title": "regional model, near real time"}
    ds.to_netcdf(tmp_path / "nrt.nc")
    assert "near real time, no reanalysis" in doctor(tmp_path / "nrt.nc", needed=("uo", "vo")).text()


def test_fields_that_only_sound_alike_are_not_taken(tmp_path: Path) -> None:
    """A tidal current called uo, a Stokes drift, an anomaly of sea level: their standard names say that they are not it."""
    path = three_ice_fields(tmp_path, "uo", told="eastward_sea_water_velocity_due_to_tides")
    with pytest.raises(ForcingError, match="not recognised"):
        open_all(path)


def test_dates_as_plain_numbers_and_in_the_heading_are_read(tmp_path: Path) -> None:
    lat, lon = np.arange(-60.0, -50.0), np.arange(-45.0, -30.0)
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    field = (
        ("lat", "lon"),
        np.zeros((lat.size, lon.size)),
        {"units": "m", "standard_name": "sea_surface_height_above_geoid"},
    )
    plain = xr.Dataset({"zos": field}, axes)
    heading = plain.assign_attrs(time_coverage_start="2020-12-16T00:00:00Z", time_coverage_end="2020-12-17T00:00:00Z")
    for name, ds in (("number", plain.assign_coords(date=20201216)), ("heading", heading)):
        ds.to_netcdf(tmp_path / f"{name}.nc")
        [found] = open_all(tmp_path / f"{name}.nc")
        assert found["time"].values[0].astype("M8[D]") == np.datetime64("2020-12-16")
    forecast = plain.assign_coords(
        forecast_reference_time=np.datetime64("2020-12-15T00", "ns"), step=((), 36, {"units": "hours"})
    )
    forecast.to_netcdf(tmp_path / "forecast.nc")
    [found] = open_all(tmp_path / "forecast.nc")
    assert found["time"].values[0] == np.datetime64("2020-12-16T12:00")


def test_values_that_a_damaged_file_does_not_give_up_are_told_by_a_run(tmp_path: Path) -> None:
    path = written(tmp_path, Layout())
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    ds.to_netcdf(tmp_path / "sum.nc", encoding={name: {"fletcher32": True, "chunksizes": (1, 13, 17)} for name in "ab"})
    data = bytearray((tmp_path / "sum.nc").read_bytes())
    place = data.find(ds["a"].values[1].tobytes())
    assert place > 0
    data[place + 40] ^= 0xFF
    (tmp_path / "sum.nc").write_bytes(bytes(data))
    asked = FileForcing(kind="files", files=["sum.nc"], longitude=(-41, -37), latitude=(-57.5, -53.5), hold=24)
    e = elements(-39.0)
    with pytest.raises(ForcingError, match="values of a cannot be read"):
        forcing_from_files(asked, tmp_path, Run.of(START, 0.2, e.thickness, 850.0)).sample(e, 3600.0)
    assert "cannot be read" in doctor(tmp_path / "sum.nc", needed=("uo", "vo")).text()
