"""Axes, windows and branches of longitude."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg.errors import ForcingError
from riftberg.products import window
from riftberg.products.levels import depths
from riftberg.products.mesh import Located, build_mesh, utc
from riftberg.products.place import goes_round, tidy_axes, tidy_longitude


def globe(step: float = 10.0, first: float = 0.0) -> xr.Dataset:
    """Return a global field whose value is its true longitude, -180..180."""
    lon = first + np.arange(0.0, 360.0, step)
    lat = np.arange(-90.0, 91.0, 10.0)
    true = (lon + 180.0) % 360.0 - 180.0
    values = np.broadcast_to(true, (lat.size, lon.size))
    return xr.Dataset({"uo": (("lat", "lon"), values)}, coords={"lat": lat, "lon": lon})


def test_global_field_is_rolled_with_its_values() -> None:
    ds = tidy_longitude(globe())
    assert (ds["lon"].values[0], ds["lon"].values[-1]) == (-180.0, 170.0)
    np.testing.assert_allclose(ds["uo"].values[0], ds["lon"].values)


def test_region_across_the_date_line_stays_ascending() -> None:
    ds = globe().isel(lon=slice(17, 21))
    np.testing.assert_allclose(tidy_longitude(ds)["lon"], [170.0, 180.0, 190.0, 200.0])


@settings(max_examples=60, deadline=None)
@given(
    west=st.floats(-360.0, 360.0),
    width=st.floats(0.0, 300.0),
    first=st.sampled_from([0.0, -180.0, 20.0, 5.0]),
)
def test_window_holds_the_box_on_its_branch(west: float, width: float, first: float) -> None:
    east = west + width
    ds = window(tidy_longitude(globe(first=first)), (west, east), (-60.0, -50.0))
    lon = ds["lon"].values
    assert np.all(np.diff(lon) > 0.0)
    assert lon[0] <= west + 1e-6
    assert lon[-1] >= east - 1e-6 or lon[-1] - lon[0] >= 349.0
    np.testing.assert_allclose(ds["uo"].values[0], (lon + 180.0) % 360.0 - 180.0, atol=1e-9)


@pytest.mark.parametrize("width", [330.0, 345.0, 359.0])
def test_a_window_almost_around_the_globe_lacks_nothing(width: float) -> None:
    lon = window(tidy_longitude(globe(1.0)), (-170.0, -170.0 + width), (-60.0, -50.0))["lon"].values
    assert np.all(np.diff(lon) == 1.0)
    assert lon[0] <= -170.0
    assert lon[-1] >= -170.0 + width


def test_longitudes_that_jump_go_round_from_their_largest_gap_on() -> None:
    """Also where a gap in the middle of a region is larger than its steps."""
    ds = xr.Dataset({"uo": ("lon", [0.0, 1.0, 2.0, 3.0])}, coords={"lon": [170.0, 180.0, -170.0, -100.0]})
    tidy = tidy_longitude(ds)
    np.testing.assert_allclose(tidy["lon"], [170.0, 180.0, 190.0, 260.0])
    np.testing.assert_allclose(tidy["uo"], [0.0, 1.0, 2.0, 3.0])


@given(at=st.floats(-60.0, -50.0), turned=st.booleans())
@settings(max_examples=40, deadline=None)
def test_a_place_between_rows_is_found_whichever_way_they_run(at: float, turned: bool) -> None:
    lat, lon = np.array([-60.0, -58.0, -55.0, -54.5, -50.0]), np.array([-41.0, -40.0, -38.0])
    ds = xr.Dataset({"uo": (("lat", "lon"), np.broadcast_to(lat[:, None], (5, 3)))}, {"lat": lat, "lon": lon})
    ds = ds.isel(lat=slice(None, None, -1)) if turned else ds
    found = Located(build_mesh(ds), np.array([-39.0]), np.array([at])).take(ds["uo"].values)
    assert found[0] == pytest.approx(at)


def levels(units: str | None) -> xr.DataArray:
    return xr.DataArray([0.5, 1.0], dims="depth", name="depth", attrs={} if units is None else {"units": units})


@pytest.mark.parametrize(("units", "factor"), [("m", 1.0), (None, 1.0), ("km", 1000.0), ("cm", 0.01), ("Meters", 1.0)])
def test_levels_are_turned_into_metres(units: str | None, factor: float) -> None:
    """Levels in km were taken as metres: the keel was below all of them."""
    np.testing.assert_allclose(depths(levels(units), where="file.nc"), [0.5 * factor, factor])


@pytest.mark.parametrize(
    "attributes",
    [{"standard_name": "air_pressure"}, {"units": "hPa"}, {"units": "level"}, {"standard_name": "model_level_number"}],
)
def test_levels_that_count_something_else_are_no_depths(attributes: dict[str, str]) -> None:
    """Whatever else would speak for depths: the name, or no numbers of rows."""
    axis = xr.DataArray([0.5, 10.0, 30.0], dims="depth", name="depth", attrs=attributes)
    if attributes == {"standard_name": "model_level_number"}:
        axis = axis.copy(data=[1.0, 2.0, 3.0])
    with pytest.raises(ForcingError, match=r"the levels depth = .* are no depths in metres"):
        depths(axis, where="file.nc")


def test_levels_in_unknown_units_are_refused() -> None:
    with pytest.raises(ForcingError, match=r"file.nc, axis depth: units 'dbar' are not known .* Convert it to m "):
        depths(levels("dbar"), where="file.nc")


def test_dates_that_the_ordinary_calendar_lacks_are_refused() -> None:
    """30 February of a calendar of 360 days was a traceback."""
    cftime = pytest.importorskip("cftime")
    time = [cftime.Datetime360Day(2020, 2, day) for day in (29, 30)]
    ds = globe().expand_dims(time=xr.DataArray(time, dims="time"))
    with pytest.raises(ForcingError, match=r"2020-02-30.*360_day.*does not exist.*convert_calendar"):
        tidy_axes(ds, where="file.nc")
    kept = tidy_axes(ds.isel(time=[0]), where="file.nc")
    assert kept["time"].values[0] == np.datetime64("2020-02-29")


def test_window_in_the_other_convention() -> None:
    ds = tidy_longitude(globe().isel(lon=slice(30, 35)))
    np.testing.assert_allclose(ds["lon"], [-60.0, -50.0, -40.0, -30.0, -20.0])
    np.testing.assert_allclose(window(ds, (318.0, 332.0), (-60.0, -50.0))["lon"], [310.0, 320.0, 330.0, 340.0])


def test_window_takes_one_record_more_on_each_side() -> None:
    days = np.arange("2020-12-01", "2020-12-11", dtype="datetime64[D]").astype("datetime64[ns]")
    ds = globe().expand_dims(time=days)
    part = window(ds, (-10.0, 10.0), (-10.0, 10.0), ("2020-12-03T12:00", "2020-12-04T06:00"))
    assert list(part["time"].values.astype("M8[D]").astype(str)) == ["2020-12-03", "2020-12-04", "2020-12-05"]
    with pytest.raises(ForcingError, match="no record lies in"):
        window(ds, (-10.0, 10.0), (-10.0, 10.0), ("2021-01-01", "2021-01-02"))


def test_a_gap_of_one_step_is_not_a_whole_circle() -> None:
    assert goes_round(np.arange(0.0, 360.0, 0.25))
    assert not goes_round(np.arange(0.0, 355.0, 0.25))


def test_moments_with_a_time_zone_become_utc() -> None:
    from datetime import datetime, timedelta, timezone

    east = datetime(2020, 12, 9, 15, tzinfo=timezone(timedelta(hours=2)))
    assert utc(east) == np.datetime64("2020-12-09T13:00")
    assert utc("2020-12-09T13:00Z") == np.datetime64("2020-12-09T13:00")
