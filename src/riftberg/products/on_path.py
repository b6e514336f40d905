"""What a dataset holds at positions of a berg, by the rule of the runs: water around, nearest water, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.products.axes import goes_round
from riftberg.products.cells import curvilinear
from riftberg.products.stencil import INTERPOLATED, MISSING, Stencil

Floats = NDArray[np.float64]
Span = tuple[float, float]

FILL_CELLS = 2
"""Cells inland that the nearest water is used, as in a run (`riftberg.ocean.at_elements.REACH`)."""

EDGE_POINTS = 25


class OnPath(NamedTuple):
    """Positions of the berg at which a field has no water around, those of them without near water, those off the data."""

    missing: int
    unfilled: int
    outside: int


def stencil_at(ds: xr.Dataset | xr.DataArray, lon: Floats, lat: Floats, crs: str | None) -> Stencil | None:
    """Return where positions (degrees) lie between the points of a dataset; None for scattered points."""
    if crs is not None:
        from riftberg.products.projected import to_projection

        return Stencil.bilinear(ds["x"].values, ds["y"].values, *to_projection(crs, lon, lat))
    if "node" in ds.dims:
        return None
    if not {"lat", "lon"} <= set(ds.dims):
        return curvilinear(np.asarray(ds["lon"].values), np.asarray(ds["lat"].values), lon, lat)
    axis = np.asarray(ds["lon"].values, float)
    turn = 360.0 if goes_round(axis) else 0.0
    if not turn:  # the branch of the data: the turn that puts a position nearest to their middle
        middle = 0.5 * (axis[0] + axis[-1])
        lon = (lon - middle + 180.0) % 360.0 + middle - 180.0
    return Stencil.bilinear(axis, ds["lat"].values, lon, lat, turn=turn)


def on_path(data: xr.DataArray, path: Sequence[Span] | None, crs: str | None) -> OnPath:
    """Count what positions of the berg lack in any of the records; of levels the uppermost is looked at."""
    if not path:
        return OnPath(0, 0, 0)
    positions = np.asarray(path, float)
    stencil = stencil_at(data, positions[:, 0], positions[:, 1], crs)
    if stencil is None:
        return OnPath(0, 0, 0)
    surface = data.isel(depth=0) if "depth" in data.dims else data
    plane = ("y", "x") if "y" in data.dims else ("lat", "lon")
    _, origin = stencil.wet(surface.transpose(..., *plane).values, FILL_CELLS)
    origin, outside = origin.reshape(-1, len(positions)), stencil.outside
    dry = (origin != INTERPOLATED).any(axis=0) & ~outside
    return OnPath(int(dry.sum()), int((dry & (origin == MISSING).any(axis=0)).sum()), int(outside.sum()))


def box_share_outside(ds: xr.Dataset, lon: Span, lat: Span, crs: str | None) -> float:
    """Return the share of a box (degrees) that lies outside of the points of a dataset; 0 for scattered points."""
    east = lon[1] if lon[1] >= lon[0] else lon[1] + 360.0
    lons, lats = np.meshgrid(np.linspace(lon[0], east, EDGE_POINTS), np.linspace(*lat, EDGE_POINTS))
    stencil = stencil_at(ds, lons, lats, crs)
    return 0.0 if stencil is None else float(stencil.outside.mean())
