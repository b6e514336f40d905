"""Reading of trajectory, bond and restart files, and pairing of their records."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

EARTH = 6_363_827.0
"""Radius of the sphere of the A68a cases, m."""

Table = dict[str, NDArray[Any]]


class Variable(NamedTuple):
    """Layout of one variable: name, type, dimensions and attributes (without the checksum of its values)."""

    name: str
    dtype: str
    dimensions: tuple[str, ...]
    attributes: dict[str, Any]


def read(path: Path) -> Table:
    """Return all variables of records of a file; of trajectories also ``second``, the stamp in whole seconds."""
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)
        table = {name: variable[...] for name, variable in dataset.variables.items() if variable.dimensions}
    if "day" in table:
        table["second"] = np.round(table["day"] * 86400.0).astype(np.int64)
    return table


def layout(path: Path) -> list[Variable]:
    """Return the layout of a file, in its order.

    The scalar ``i`` with which KID's restarts begin is left out: the files of the reference were saved without it.
    """
    with netCDF4.Dataset(path) as dataset:
        return [
            Variable(v.name, str(v.dtype), v.dimensions, {k: v.getncattr(k) for k in v.ncattrs() if k != "checksum"})
            for v in dataset.variables.values()
            if v.dimensions
        ]


def checksums(path: Path) -> dict[str, str]:
    """Return the checksum that each variable of a restart carries, without the blanks at its end."""
    with netCDF4.Dataset(path) as dataset:
        return {name: v.checksum.rstrip() for name, v in dataset.variables.items() if v.dimensions}


def select(table: Table, rows: NDArray[Any]) -> Table:
    """Return some rows of all variables."""
    return {name: values[rows] for name, values in table.items()}


def paired(ours: Table, theirs: Table, keys: tuple[str, ...]) -> tuple[Table, Table]:
    """Return both tables in one order, ours cut to the stamps of theirs.

    Raises
    ------
    AssertionError
        If the records do not name the same things.
    """
    if "second" in keys:
        ours = select(ours, np.isin(ours["second"], theirs["second"]))
    a, b = (select(q, np.lexsort([q[k] for k in reversed(keys)])) for q in (ours, theirs))
    for key in keys:
        np.testing.assert_array_equal(a[key], b[key], err_msg=f"{key} of the records")
    return a, b


def offset(ours: Table, theirs: Table, latlon: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Differences of position in metres, east and north."""
    dx, dy = ours["lon"] - theirs["lon"], ours["lat"] - theirs["lat"]
    if not latlon:
        return dx, dy
    return np.radians(dx) * EARTH * np.cos(np.radians(theirs["lat"])), np.radians(dy) * EARTH


def largest(ours: Table, theirs: Table, names: tuple[str, ...], rows: NDArray[np.bool_]) -> float:
    """Largest difference in some rows of some variables; NaN if the file has none of them."""
    found = [np.abs(ours[n][rows] - theirs[n][rows]).max(initial=0.0) for n in names if n in theirs]
    return float(max(found)) if found else np.nan
