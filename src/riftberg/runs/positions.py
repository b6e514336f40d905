"""Positions of a run for maps: without gaps, on one branch of longitude, and in the proportions of the ground."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from riftberg.state import Floats

if TYPE_CHECKING:
    import xarray as xr


def stretch(y: float, latlon: bool) -> float:
    """Return the units of x for one unit of y that make the same distance at ``y``."""
    return 1.0 / max(0.05, math.cos(math.radians(y))) if latlon else 1.0


def filled_forward(values: Floats) -> Floats:
    """Fill the records (rows) before an element is there with its first value, and those after its end with its last."""
    has_value = np.isfinite(values)
    if has_value.all():
        return values
    records = np.arange(len(values))[:, None]
    # Number of the last known record up to each record; -1 before the first.
    last = np.maximum.accumulate(np.where(has_value, records, -1), axis=0)
    first = np.argmax(has_value, axis=0)[None, :]
    filled: Floats = np.take_along_axis(values, np.where(last < 0, first, last), axis=0)
    return filled


def unwrap_positions(x: Floats, present: NDArray[np.bool_], period: float, *, goes_on: bool = False) -> Floats:
    """Put zonal positions on one branch: no element jumps by a period, and none stands a period away from the others.

    ``x``: positions without gaps (shape (time, trajectory)); ``present``: whether the element is there (shape (time,
    trajectory)); ``goes_on``: whether the positions of an element do not jump; returns positions that differ from those
    given by whole periods.
    """
    if period <= 0.0 or not x.size:
        return x
    path: Floats = x.copy() if goes_on else np.unwrap(x, period=period, axis=0)
    born = np.argmax(present, axis=0)
    path[:, born == 0] -= period * np.round((path[0, born == 0] - path[0, 0]) / period)
    # In order of birth: each newborn is put beside those that are there already.
    for record in np.unique(born[born > 0]):
        new = born == record
        others = path[record, present[record] & (born < record)]
        home = float(others.mean()) if len(others) else float(path[record, 0])
        path[:, new] -= period * np.round((path[record, new] - home) / period)
    return path


def read_thickness(run: xr.Dataset) -> Floats:
    """Return the thickness (m) of the elements, (time, trajectory); of one record alone where it does not change."""
    thickness = filled_forward(run["thickness"].transpose("time", "trajectory").values.astype(np.float64))
    return thickness[:1] if (thickness == thickness[:1]).all() else thickness
