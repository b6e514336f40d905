"""Axes, windows and branches of longitude."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg import DatasetForcing, open_product
from riftberg.errors import ForcingError
from riftberg.products import window
from riftberg.state import new_elements


def globe(step: float = 10.0, first: float = 0.0) -> xr.Dataset:
    """Return a global field whose value is its true longitude, -180..180, in thousandths."""
    return current(first + np.arange(0.0, 360.0, step), np.arange(-90.0, 91.0, 10.0))


def current(lon: np.ndarray, lat: np.ndarray) -> xr.Dataset:
    """Return a current (m s-1) of a thousandth of the longitude, -180..180, to the east and of the latitude to the north."""
    x, y = np.meshgrid((lon + 180.0) % 360.0 - 180.0, lat)
    return xr.Dataset(
        {
            name: (("lat", "lon"), 1e-3 * values, {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"})
            for name, values, way in (("uo", x, "eastward"), ("vo", y, "northward"))
        },
        {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})},
    )


@pytest.fixture(scope="module")
def tidy(tmp_path_factory: pytest.TempPathFactory) -> Callable[[xr.Dataset], xr.Dataset]:
    """Write a dataset to a file and open it as a product."""
    folder, numbers = tmp_path_factory.mktemp("axes"), count()

    def opened(ds: xr.Dataset) -> xr.Dataset:
        ds.to_netcdf(path := folder / f"file{next(numbers)}.nc")
        return open_product(path)

    return opened


Tidy = Callable[[xr.Dataset], xr.Dataset]


def test_global_field_is_rolled_with_its_values(tidy: Tidy) -> None:
    ds = tidy(globe())
    assert (ds["lon"].values[0], ds["lon"].values[-1]) == (-180.0, 170.0)
    np.testing.assert_allclose(ds["uo"].values[0], 1e-3 * ds["lon"].values)


def test_region_across_the_date_line_stays_ascending(tidy: Tidy) -> None:
    ds = globe().isel(lon=slice(17, 21))
    np.testing.assert_allclose(tidy(ds)["lon"], [170.0, 180.0, 190.0, 200.0])


FIRST = (0.0, -180.0, 20.0, 5.0)
"""Where global axes begin."""


@pytest.fixture(scope="module")
def globes(tidy: Tidy) -> dict[float, xr.Dataset]:
    return {first: tidy(globe(first=first)) for first in FIRST}


@settings(max_examples=60, deadline=None)
@given(
    west=st.floats(-360.0, 360.0),
    width=st.floats(0.0, 300.0),
    first=st.sampled_from(FIRST),
)
def test_window_holds_the_box_on_its_branch(
    globes: dict[float, xr.Dataset], west: float, width: float, first: float
) -> None:
    east = west + width
    ds = window(globes[first], (west, east), (-60.0, -50.0))
    lon = ds["lon"].values
    assert np.all(np.diff(lon) > 0.0)
    assert lon[0] <= west + 1e-6
    assert lon[-1] >= east - 1e-6 or lon[-1] - lon[0] >= 349.0
    np.testing.assert_allclose(1e3 * ds["uo"].values[0], (lon + 180.0) % 360.0 - 180.0, atol=1e-9)


@pytest.mark.parametrize("width", [330.0, 345.0, 359.0])
def test_a_window_almost_around_the_globe_lacks_nothing(tidy: Tidy, width: float) -> None:
    lon = window(tidy(globe(1.0)), (-170.0, -170.0 + width), (-60.0, -50.0))["lon"].values
    assert np.all(np.diff(lon) == 1.0)
    assert lon[0] <= -170.0
    assert lon[-1] >= -170.0 + width


def test_longitudes_that_jump_go_round_from_their_largest_gap_on(tidy: Tidy) -> None:
    """Also where a gap in the middle of a region is larger than its steps."""
    ds = tidy(current(np.array([170.0, 180.0, -170.0, -100.0]), np.array([-60.0, -55.0])))
    np.testing.assert_allclose(ds["lon"], [170.0, 180.0, 190.0, 260.0])
    np.testing.assert_allclose(1e3 * ds["uo"].values[0], [170.0, -180.0, -170.0, -100.0])


def met(ds: xr.Dataset, lon: float, lat: float) -> tuple[float, float]:
    """Return the current that an element meets."""
    element = new_elements(1)
    element.place.lon[:], element.place.lat[:] = lon, lat
    DatasetForcing.from_xarray(ds, "2020-12-09", sea_level="none").sample(element, 0.0)
    return float(element.uo[0]), float(element.vo[0])


@given(at=st.floats(-60.0, -50.0), turned=st.booleans())
@settings(max_examples=40, deadline=None)
def test_a_place_between_rows_is_found_whichever_way_they_run(at: float, turned: bool) -> None:
    ds = current(np.array([-41.0, -40.0, -38.0]), np.array([-60.0, -58.0, -55.0, -54.5, -50.0]))
    ds = ds.isel(lat=slice(None, None, -1)) if turned else ds
    assert met(ds, -39.0, at) == pytest.approx((-0.039, 1e-3 * at))


def levels(values: list[float], attributes: dict[str, str]) -> xr.Dataset:
    """Return a current on levels."""
    ds = current(np.array([-41.0, -40.0, -38.0]), np.array([-60.0, -58.0]))
    return ds.expand_dims(depth=len(values)).assign_coords(depth=("depth", values, attributes))


@pytest.mark.parametrize(("units", "factor"), [("m", 1.0), (None, 1.0), ("km", 1000.0), ("cm", 0.01), ("Meters", 1.0)])
def test_levels_are_turned_into_metres(tidy: Tidy, units: str | None, factor: float) -> None:
    """Levels in km were taken as metres: the keel was below all of them."""
    first, second = 0.5 / max(factor, 1.0), 1.0 / max(factor, 1.0)  # those of a current begin near the surface
    ds = tidy(levels([first, second], {} if units is None else {"units": units}))
    np.testing.assert_allclose(ds["depth"], [first * factor, second * factor])


@pytest.mark.parametrize(
    "attributes",
    [{"standard_name": "air_pressure"}, {"units": "hPa"}, {"units": "level"}, {"standard_name": "model_level_number"}],
)
def test_levels_that_count_something_else_are_no_depths(tidy: Tidy, attributes: dict[str, str]) -> None:
    """Whatever else would speak for depths: the name, or no numbers of rows."""
    numbered = attributes == {"standard_name": "model_level_number"}
    with pytest.raises(ForcingError, match=r"the levels depth = .* are no depths in metres"):
        tidy(levels([1.0, 2.0, 3.0] if numbered else [0.5, 10.0, 30.0], attributes))


def test_levels_in_unknown_units_are_refused(tidy: Tidy) -> None:
    with pytest.raises(ForcingError, match=r"file\d+.nc, axis depth: units 'dbar' are not known .* Convert it to m "):
        tidy(levels([0.5, 1.0], {"units": "dbar"}))


def test_dates_that_the_ordinary_calendar_lacks_are_refused(tidy: Tidy) -> None:
    """30 February of a calendar of 360 days was a traceback."""
    cftime = pytest.importorskip("cftime")
    time = [cftime.Datetime360Day(2020, 2, day) for day in (29, 30)]
    ds = globe().expand_dims(time=xr.DataArray(time, dims="time"))
    with pytest.raises(ForcingError, match=r"2020-02-30.*360_day.*does not exist.*convert_calendar"):
        tidy(ds)
    assert tidy(ds.isel(time=[0]))["time"].values[0] == np.datetime64("2020-02-29")


def test_window_in_the_other_convention(tidy: Tidy) -> None:
    ds = tidy(globe().isel(lon=slice(30, 35)))
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
    lat = np.array([-60.0, -50.0])
    assert met(current(np.arange(0.0, 360.0, 0.25), lat), 359.9, -55.0)[0] == pytest.approx(-1e-4)
    with pytest.raises(ForcingError, match="outside of the data"):
        met(current(np.arange(0.0, 359.75, 0.25), lat), 359.75, -55.0)
