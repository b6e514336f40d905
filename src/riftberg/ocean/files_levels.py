"""Currents on levels of depth, from files to the draft of each element."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
import xarray as xr

from riftberg.ocean.grid import Grid
from riftberg.ocean.loading import usable
from riftberg.ocean.over_draft import Columns
from riftberg.products.interpolate import to_grid
from riftberg.products.keel import keel_integral, layer_limits
from riftberg.state import Floats

INTEGRALS = ("uo_integral", "vo_integral", "wet_thickness")


def has_levels(ds: xr.Dataset) -> bool:
    """Whether a dataset has currents on more than one level."""
    return "uo" in ds.data_vars and ds["uo"].sizes.get("depth", 0) > 1


def without_levels(ds: xr.Dataset, *, surface: bool) -> xr.Dataset:
    """Return a dataset without levels: the currents of the uppermost one, or no currents."""
    if "depth" not in ds.dims:
        return ds
    if surface:
        return ds.isel(depth=0, drop=True)
    return ds.drop_vars([name for name in ds.data_vars if "depth" in ds[name].dims])


class LevelColumns:
    """Makes the integrals over depth of one record when they are needed.

    Parameters
    ----------
    ds : xarray.Dataset
        Canonical dataset with ``uo`` and ``vo`` on ``depth``.
    corners : tuple of (1-D) array
        Longitudes and latitudes of the corners of the model grid.
    moments : sequence of datetime
        Times of the records.
    keel : float
        Deepest draft (m); deeper layers are not read.

    Attributes
    ----------
    limits : ndarray
        Depths (m) of the integrals.
    """

    def __init__(
        self, ds: xr.Dataset, corners: tuple[Floats, Floats], moments: Sequence[datetime], keel: float
    ) -> None:
        limits = layer_limits(ds["depth"].values)
        layers = int(np.clip(np.searchsorted(limits, keel, side="left"), 1, limits.size - 1))
        # One level more than is needed: the lower limit of the last layer depends on it.
        self._ds = ds[["uo", "vo"]].isel(depth=slice(0, layers + 1))
        self.limits = limits[: layers + 1]
        self._corners, self._moments = corners, moments
        self.grid: Grid | None = None

    def __call__(self, record: int) -> Columns:
        """Return the integrals of a record on the full shape of the grid; `grid` must have been set."""
        assert self.grid is not None
        summed = keel_integral(self._ds).isel(draft=slice(0, self.limits.size))
        # Columns without any water are unknown, so that those near the shore take the nearest water.
        summed = summed.where(summed["wet_thickness"].isel(draft=-1) > 0.0)
        times = [self._moments[record]] if "time" in summed.dims else None
        values = to_grid(summed.assign_attrs(self._ds.attrs), *self._corners, times)
        mask = self.grid.arrays.mask
        u, v, wet = (self._full(values[name].squeeze(drop=True).transpose("draft", ...).values) for name in INTEGRALS)
        return Columns(u, v, np.stack([usable(level, mask, True) for level in wet]))

    def _full(self, levels: Floats) -> Floats:
        assert self.grid is not None
        return np.stack([self.grid.extended(level) for level in levels])
