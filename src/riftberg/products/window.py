"""The part of a dataset that a run needs: a box in longitude, latitude and time, and one point and record more."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from riftberg.config.units import box_text
from riftberg.config.values import moment, nanoseconds
from riftberg.errors import ForcingError
from riftberg.plane import unit_vectors
from riftberg.products.mesh import CurvilinearMesh, Located, NodeMesh
from riftberg.products.place import EAST, NORTH, goes_round, on_branch, to_degrees, to_projection
from riftberg.products.records import cover_of
from riftberg.state import Floats

Span = tuple[float, float]

REACH = 1.5
"""Scattered points up to this many usual distances outside of a box are kept."""


def utc(value: Any) -> np.datetime64:
    """Return a moment as ``datetime64[ns]`` in UTC; text, `datetime` (naive means UTC) and ``datetime64`` are taken."""
    plain = value if isinstance(value, np.datetime64) else moment(value, where="date")
    dated: np.datetime64 = nanoseconds([plain], where="date", kind=ForcingError)[0]
    return dated


def window(
    ds: xr.Dataset, lon: Span, lat: Span, time: tuple[Any, Any] | None = None, margin: float = 0.0
) -> xr.Dataset:
    """Return the part of a canonical dataset in a box, lazily, with one more point and record on each side.

    ``lon``: west and east (degrees, any convention); ``lat``: south and north (degrees); ``margin``: width added to the
    box on each side (degrees).
    """
    west, east = lon[0] - margin, (lon[1] if lon[1] >= lon[0] else lon[1] + 360.0) + margin
    south, north = lat[0] - margin, lat[1] + margin
    if "crs_wkt" in ds.attrs:  # the rectangle of the map that holds the box
        # The sides of a box are bent on a map; 73 points a side miss less than a cell of any product.
        box = np.meshgrid(np.linspace(west, east, 73), np.linspace(max(south, -90.0), min(north, 90.0), 73))
        x, y = to_projection(ds.attrs["crs_wkt"], *box)
        columns = slice_around(ds["x"].values, np.nanmin(x), np.nanmax(x))
        part = ds.isel(y=slice_around(ds["y"].values, np.nanmin(y), np.nanmax(y)), x=columns)
    elif "node" in ds.dims:
        part = _scattered(ds, west, east, south, north)
    elif "y" in ds.dims:
        part = _curvilinear(ds, west, east, south, north)
    else:
        near = longitudes_near(ds, west, east)
        columns = slice_around(near["lon"].values, west, east)
        part = near.isel(lat=slice_around(near["lat"].values, south, north), lon=columns)
    if not all(part.sizes[name] for name in ("lat", "lon", "y", "x", "node") if name in part.dims):
        raise ForcingError(
            f"nothing lies in {box_text(west, east, south, north)}: the data cover {extent_text(ds)}",
            where=str(ds.attrs.get("source", "")),
            remedy="Give a file that covers the box; check the sign of west longitudes",
        )
    if "crs_wkt" in ds.attrs and not {"lat", "lon"} <= set(part.variables):
        x, y = np.meshgrid(part["x"].values, part["y"].values)
        degrees = to_degrees(ds.attrs["crs_wkt"], x, y)
        part = part.assign_coords(lon=(("y", "x"), degrees[0], EAST), lat=(("y", "x"), degrees[1], NORTH))
    return window_in_time(part, time) if time is not None and "time" in part.dims else part


def slice_around(axis: Floats, low: float, high: float) -> slice:
    """Return the part of an ascending axis around ``low..high``, one point more on each side; empty if outside."""
    if high < axis[0] or low > axis[-1]:
        return slice(0, 0)
    start = max(int(np.searchsorted(axis, low, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(axis, high, side="left")) + 1, axis.size)
    return slice(start, stop)


def longitudes_near(ds: xr.Dataset, west: float, east: float) -> xr.Dataset:
    """Return the dataset with its longitudes on the branch where they meet ``west..east`` best."""
    if goes_round(ds["lon"].values):
        # The seam goes where nothing is needed: half of what is left on either side of the box.
        spare = max(0.0, 360.0 - (east - west))
        return on_branch(ds, west - 0.5 * spare)
    axis = ds["lon"].values
    turns = [turn for turn in (-720.0, -360.0, 0.0, 360.0, 720.0)]
    overlap = [min(east, axis[-1] + turn) - max(west, axis[0] + turn) for turn in turns]
    return ds.assign_coords(lon=("lon", axis + turns[int(np.argmax(overlap))], ds["lon"].attrs))


def _scattered(ds: xr.Dataset, west: float, east: float, south: float, north: float) -> xr.Dataset:
    """Keep the scattered points of a box and those around it, with longitudes on the branch of the box."""
    middle = 0.5 * (west + east)
    lon, lat = (ds["lon"].values - middle + 180.0) % 360.0 - 180.0 + middle, ds["lat"].values
    spacing = REACH * NodeMesh(lon, lat).spacing()
    # Towards the pole a degree of longitude is short; 0.02 keeps it finite there.
    beyond = spacing / np.maximum(np.cos(np.deg2rad(lat)), 0.02)
    near = (lat >= south - spacing) & (lat <= north + spacing) & (lon >= west - beyond) & (lon <= east + beyond)
    part = ds.assign_coords(lon=("node", lon, ds["lon"].attrs))
    return part.isel(node=np.flatnonzero(near))


def _curvilinear(ds: xr.Dataset, west: float, east: float, south: float, north: float) -> xr.Dataset:
    """Cut a curvilinear grid to the box; where rows and columns follow latitude and longitude there, name them so."""
    lat = ds["lat"].values
    lon = (ds["lon"].values - west) % 360.0 + west
    inside = (lat >= south) & (lat <= north) & (lon <= east)
    if not inside.any():  # the box lies in one of the cells, or outside
        middle = np.array([0.5 * (west + east)]), np.array([0.5 * (south + north)])
        if Located(CurvilinearMesh(lon, lat), *middle).outside.any():
            return ds.isel(y=slice(0, 0))
        off = np.linalg.norm(unit_vectors(lon, lat) - unit_vectors(*middle), axis=-1)
        inside = off == np.nanmin(off)
    rows, columns = np.nonzero(inside.any(axis=1))[0], np.nonzero(inside.any(axis=0))[0]
    # Columns in running order, one more on each side, even if they pass the seam of the grid.
    gaps = np.diff(columns)
    cut = int(np.argmax(gaps)) + 1 if gaps.size and gaps.max() > 0.5 * lon.shape[1] else 0
    ordered = np.concatenate([columns[cut:], columns[:cut]])
    first, last = max(int(ordered[0]) - 1, 0), min(int(ordered[-1]) + 1, lon.shape[1] - 1)
    running = np.array(list(dict.fromkeys([first, *ordered.tolist(), last])), dtype=np.int64)
    return _straightened(ds.isel(y=slice(max(rows[0] - 1, 0), rows[-1] + 2), x=running), west, east)


def _straightened(ds: xr.Dataset, west: float, east: float) -> xr.Dataset:
    """Turn two-dimensional positions into axes where each varies along one dimension only (Mercator part of a grid)."""
    middle = 0.5 * (west + east)
    lat = ds["lat"].values
    lon = (ds["lon"].values - middle + 180.0) % 360.0 - 180.0 + middle
    if not (np.ptp(lat, axis=1).max() <= 1e-3 and np.ptp(lon, axis=0).max() <= 1e-3):  # also where positions are NaN
        return ds.assign_coords(lon=(ds["lon"].dims, lon, ds["lon"].attrs))
    order = np.unique(np.round(lon.mean(axis=0), 5), return_index=True)[1]
    ds = ds.isel(x=order).drop_vars(["lat", "lon"]).rename(y="lat", x="lon")
    return ds.assign_coords(lat=("lat", lat.mean(axis=1), NORTH), lon=("lon", lon.mean(axis=0)[order], EAST))


def extent_text(ds: xr.Dataset) -> str:
    """Return what a canonical dataset covers in space, in words."""
    if "lat" not in ds.coords:
        return "a projected grid without positions"
    lat, lon = ds["lat"].values, ds["lon"].values
    west, east = (-180.0, 180.0) if "lat" in ds.dims and goes_round(lon) else (np.nanmin(lon), np.nanmax(lon))
    return box_text(float(west), float(east), float(np.nanmin(lat)), float(np.nanmax(lat)))


def window_in_time(ds: xr.Dataset, time: tuple[Any, Any], margin: float = 0.0) -> xr.Dataset:
    """Return the records of a time, widened by a margin (s), and one more on each side; `ForcingError` if there is none."""
    spare = np.timedelta64(round(margin), "s")
    first, last = (
        utc(moment).astype("datetime64[us]") + way * spare for moment, way in zip(time, (-1, 1), strict=True)
    )
    records = ds["time"].values.astype(first.dtype)
    begins, ends = cover_of(ds)
    if last < begins or first > ends:
        raise ForcingError(
            f"no record lies in {first.astype('M8[m]')}..{last.astype('M8[m]')}: the data run from "
            f"{records[0].astype('M8[m]')} to {records[-1].astype('M8[m]')}",
            where=str(ds.attrs.get("source", "")),
            remedy="Give files of these dates",
        )
    start = max(int(np.searchsorted(records, first, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(records, last, side="left")) + 1, records.size)
    return ds.isel(time=slice(min(start, records.size - 1), max(stop, 1)))
