"""Axes of a canonical dataset: found by CF metadata, named alike, ascending, on one branch, with real UTC dates."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.values import nanoseconds
from riftberg.errors import ForcingError
from riftberg.products.product import noted
from riftberg.products.quantities import QUANTITIES, conversion

Floats = NDArray[np.float64]

_OTHER_YEARS = (
    "Leave out the other records, or put model years on dates of the run, in Python: ds.assign_coords(time=dates)"
)


def tidy_axes(ds: xr.Dataset, *, where: str) -> xr.Dataset:
    """Sort the axes, put longitudes on one branch and dates on the standard calendar, and order the dimensions."""
    if "time" in ds.variables:
        ds = tidy_time(ds, where=where)
    if "depth" in ds.dims:  # in metres, positive down; without units they are taken as metres
        depth = ds["depth"]
        units = next((str(depth.attrs[key]) for key in ("units", "Units", "Unit", "unit") if key in depth.attrs), "m")
        factor, _ = conversion(QUANTITIES["depth_below_surface"], units, where=f"{where}, axis depth")
        attributes = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
        values = np.abs(depth.values.astype(float)) * factor
        ds = _ascending(ds.assign_coords(depth=("depth", values, attributes)), "depth")
    if "lat" in ds.dims and "lon" in ds.dims:
        attributes = {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}
        ds = tidy_longitude(_ascending(ds.assign_coords(lat=("lat", _degrees(ds["lat"].values), attributes)), "lat"))
    for axis in ("y", "x"):
        if axis in ds.dims and axis in ds.coords:
            ds = _ascending(ds, axis)
    order = [name for name in ("time", "depth", "lat", "lon", "y", "x", "node") if name in ds.dims]
    return ds.transpose(*order, ...)


def tidy_time(ds: xr.Dataset, *, where: str) -> xr.Dataset:
    """Return the dataset with ``time`` as ``datetime64[ns]``.

    Dates of other calendars are taken by their label (year, month, day, ...): products that state a Julian calendar
    write the ordinary date.
    """
    time = ds["time"]
    if time.dtype == object:
        stamps = [_by_label(date, where) for date in np.atleast_1d(time.values)]
        values = np.array(stamps, dtype="datetime64[us]").reshape(time.shape)
    elif np.issubdtype(time.dtype, np.datetime64):
        values = time.values
    else:
        raise ForcingError(
            f"time has no units that say since when it counts (it reads {time.attrs.get('units', '')!r})",
            where=where,
            remedy="Write units such as 'hours since 2020-12-01 00:00:00' on the time coordinate",
        )
    values = nanoseconds(values, where=where, kind=ForcingError, remedy=_OTHER_YEARS)
    if np.isnat(values).any():
        raise ForcingError(
            f"{int(np.isnat(values).sum())} of {values.size} dates are missing",
            where=where,
            remedy="Correct the time axis",
        )
    ds = ds.assign_coords(time=(time.dims, values, {"standard_name": "time", "axis": "T", "long_name": "time (UTC)"}))
    if "time" not in ds.dims:
        ds = ds.expand_dims("time")
    ds = ds.sortby("time") if np.any(np.diff(ds["time"].values) < np.timedelta64(0)) else ds
    _, first = np.unique(ds["time"].values, return_index=True)
    if first.size == ds.sizes["time"]:
        return ds
    lost = ds.sizes["time"] - first.size
    return noted(ds.isel(time=first), doubt=f"{lost} record(s) repeat a date: the first of each is taken")


def _by_label(date: Any, where: str) -> np.datetime64:
    """Return the date of another calendar that is written the same; refuse one that the ordinary calendar lacks."""
    try:
        return np.datetime64(date.isoformat(), "us")
    except ValueError as error:
        calendar = str(getattr(date, "calendar", "")) or "another"
        raise ForcingError(
            f"the date {date.isoformat()} of its calendar ({calendar}) does not exist",
            where=where,
            remedy="Convert the file to the standard calendar, for example with xarray's convert_calendar('standard')",
        ) from error


def _degrees(values: NDArray[Any]) -> Floats:
    """Return axis values in double precision; single-precision ones lose the noise beyond their sixth decimal."""
    return np.round(values.astype(float), 6) if values.dtype == np.float32 else values.astype(float)


def _ascending(ds: xr.Dataset, name: str) -> xr.Dataset:
    values = ds[name].values
    return ds.isel({name: slice(None, None, -1)}) if values.size > 1 and values[0] > values[-1] else ds


def step_of(values: Floats) -> float:
    """Return the median spacing of an axis; 0 for a single value."""
    return float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 0.0


def goes_round(lon: Floats) -> bool:
    """Tell whether ascending longitudes (degrees) cover the whole circle."""
    step = step_of(lon)
    return bool(lon.size > 1 and lon[-1] - lon[0] + 1.5 * step >= 360.0)


def tidy_longitude(ds: xr.Dataset) -> xr.Dataset:
    """Sort longitudes, drop columns that repeat a meridian (OSCAR v1 runs 20..420) and shift them to -180..180."""
    attributes = {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}
    ds = _ascending(ds.assign_coords(lon=("lon", _degrees(ds["lon"].values), attributes)), "lon")
    lon = ds["lon"].values
    if lon.size > 1 and not np.all(np.diff(lon) > 0.0):
        # They jump (177..180, -180..-177): round the globe from the largest gap on, each meridian once.
        turned, first = np.unique(np.round(lon % 360.0, 9) % 360.0, return_index=True)
        gaps = np.diff(np.append(turned, turned[0] + 360.0))
        start = (int(np.argmax(gaps)) + 1) % turned.size
        lon = np.roll(turned, -start)
        lon = np.where(lon < lon[0], lon + 360.0, lon)
        ds = ds.isel(lon=np.roll(first, -start)).assign_coords(lon=("lon", lon, attributes))
    # Columns that repeat a meridian are left out before the branch is chosen.
    return on_branch(ds.isel(lon=slice(0, int((lon < lon[0] + 360.0 - 1e-6).sum()))), -180.0)


def on_branch(ds: xr.Dataset, west: float) -> xr.Dataset:
    """Return the dataset with ascending longitudes that start at or east of ``west`` (degrees).

    A field that goes round the earth is rolled so that it begins at ``west``; a regional one is only shifted by whole
    turns and may therefore reach beyond ``west + 360``.
    """
    lon = ds["lon"].values
    attributes = ds["lon"].attrs
    if not goes_round(lon):
        turns = 360.0 * np.floor((lon[0] - west + 1e-9) / 360.0)
        return ds.assign_coords(lon=("lon", lon - turns, attributes))
    # Whole turns are subtracted (a remainder would add rounding that differs from branch to branch).
    wrapped = lon - 360.0 * np.floor((lon - west + 1e-9) / 360.0)
    order = np.argsort(wrapped, kind="stable")
    if not np.array_equal(order, np.arange(order.size)):
        ds = ds.isel(lon=order)
    return ds.assign_coords(lon=("lon", wrapped[order], attributes))
