"""Fields of data products on a grid, made when a record of them is needed."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.ocean.grid import Grid
from riftberg.ocean.grid_arrays import CORNER_FIELDS, Fields
from riftberg.ocean.loading import wind_from_stress
from riftberg.ocean.over_draft import DraftCurrents
from riftberg.places import latitude, longitude
from riftberg.products.axes import step_of
from riftberg.products.canonical import QUANTITIES
from riftberg.products.interpolate import to_grid
from riftberg.products.records import named
from riftberg.state import Floats

NAMES = {"depth_below_surface": "depth"}
"""Fields whose canonical name is not that of the model."""

LARGEST = 1000
"""Cells along a side of a product's own grid; finer products are averaged to that."""

METRES_PER_DEGREE = 111e3

BLOCK_BYTES = 64e6
"""Fields that are made at once, about: many records together take little longer than one."""


class Mesh(NamedTuple):
    """Axes of a grid (degrees, ascending): all lines of corners, and the centres between them."""

    corners: tuple[Floats, Floats]
    centres: tuple[Floats, Floats]

    def grid(self, mask: Floats | None = None) -> Grid:
        """Return the grid; ``mask`` is 1 over water, on the cells."""
        return Grid.from_corners(*np.meshgrid(*self.corners), mask=mask, includes_southwest=True)


def even_mesh(longitude: tuple[float, float], latitude: tuple[float, float], spacing: float) -> Mesh:
    """Return a mesh of equal cells (degrees) from the south-western corner of a box."""
    axes = []
    for low, high in (longitude, latitude):
        count = max(1, round((high - low) / spacing))
        axes.append(np.asarray(low + spacing * np.arange(count + 1), np.float64))
    return Mesh((axes[0], axes[1]), (_between(axes[0]), _between(axes[1])))


def own_mesh(ds: xr.Dataset, *, at: str) -> Mesh:
    """Return the mesh whose corners or centres (``at``) are the points of a dataset, or nearly so.

    Grids without axes of longitude and latitude get equal cells of their spacing, and very fine ones larger cells.
    """
    if not {"lat", "lon"} <= set(ds.dims) or max(ds.sizes["lat"], ds.sizes["lon"]) > LARGEST:
        return _like(ds)
    lon, lat = (np.asarray(ds[name].values, np.float64) for name in ("lon", "lat"))
    if at == "corner":
        return Mesh((lon, lat), (_between(lon), _between(lat)))
    around = tuple(_around(axis) for axis in (lon, lat))
    return Mesh((around[0], around[1]), (lon, lat))


def _between(axis: Floats) -> Floats:
    return np.asarray(0.5 * (axis[:-1] + axis[1:]))


def _around(axis: Floats) -> Floats:
    """Lines half-way between points, and as far beyond the outermost points."""
    middle = _between(axis)
    return np.concatenate([[2.0 * axis[0] - middle[0]], middle, [2.0 * axis[-1] - middle[-1]]])


def _like(ds: xr.Dataset) -> Mesh:
    """Equal cells over the place of a dataset, about as large as its own."""
    lon, lat = (np.asarray(ds[name].values, np.float64) for name in ("lon", "lat"))
    west, east, south, north = (float(value) for value in (lon.min(), lon.max(), lat.min(), lat.max()))
    if lat.ndim == 1:
        spacing = max(step_of(lat), step_of(lon))
    elif "crs_wkt" in ds.attrs and "y" in ds.coords:
        spacing = step_of(np.asarray(ds["y"].values, np.float64)) / METRES_PER_DEGREE
    else:
        spacing = float(np.median(np.abs(np.diff(lat, axis=0))))
    spacing = max(spacing, (north - south) / LARGEST, (east - west) / LARGEST)
    return even_mesh((west, east), (south, north), spacing)


class FieldMaker:
    """Makes the fields of one record when it is needed.

    Parameters
    ----------
    mesh : Mesh
        Where the fields are wanted.
    datasets : sequence of xarray.Dataset
        Canonical datasets; of those that give the same field the last counts.
    moments : sequence of datetime
        Times of the records.
    known : str
        Field whose cells without a value count as land; the depth, if there is one, decides anyway.

    Attributes
    ----------
    grid : Grid
    over_draft : DraftCurrents or None
        Where the currents come from instead, if set.
    """

    def __init__(
        self, mesh: Mesh, datasets: Sequence[xr.Dataset], moments: Sequence[datetime], known: str = ""
    ) -> None:
        self.mesh, self.datasets, self.moments = mesh, datasets, moments
        self._moving = [ds for ds in datasets if "time" in ds.dims]
        still = self._fields([ds for ds in datasets if "time" not in ds.dims], None)
        self._static = {name: values[0] for name, values in still.items()}
        depth = self._static.get("depth")
        mask = None if depth is None else np.where(depth > 0.0, 1.0, 0.0)
        self.grid = mesh.grid(self._mask_of(known) if mask is None and known else mask)
        self.over_draft: DraftCurrents | None = None
        cells = self.grid.arrays.mask.size
        self._length = int(np.clip(BLOCK_BYTES / (8 * cells * len(Fields._fields)), 1, 48))
        self._first, self._block = -1, dict[str, Floats]()

    def __call__(self, record: int) -> Fields:
        """Return the fields of a record."""
        first = record // self._length * self._length
        if first != self._first:
            self._first = first
            self._block = self._fields(self._moving, self.moments[first : first + self._length])
        moving = {name: values[record - first] for name, values in self._block.items()}
        if self.over_draft is not None:
            moving["uo"], moving["vo"] = self.over_draft.at_nominal(record)
        return self.grid.fields(**{**self._static, **moving})

    def _mask_of(self, name: str) -> Floats | None:
        """1 where a field is known at the first moment."""
        for ds in self.datasets:
            if name in ds.data_vars:
                times = [self.moments[0]] if "time" in ds.dims else None
                origin = to_grid(ds[[name]].assign_attrs(ds.attrs), *self.mesh.centres, times)[f"{name}_origin"]
                return np.where(origin.squeeze(drop=True).values > 0, 1.0, 0.0)
        return None

    def _fields(self, datasets: Sequence[xr.Dataset], moments: Sequence[datetime] | None) -> dict[str, Floats]:
        """Return the fields at some moments, one after another along the first axis; one for fields without time."""
        found: dict[str, Floats] = {}
        for ds in datasets:
            for at, axes in (("corner", self.mesh.corners), ("centre", self.mesh.centres)):
                wanted = [n for n in map(str, ds.data_vars) if belongs(n) == at]
                if wanted:
                    values = to_grid(ds[wanted].assign_attrs(ds.attrs), *axes, moments)
                    shape = (-1, axes[1].size, axes[0].size)
                    made = {n: np.asarray(values[n].values, np.float64).reshape(shape) for n in wanted}
                    for n in wanted:
                        check_believable(n, made[n], axes, ds, moments)
                    found |= made
        if "taux" in found and "ua" not in found:
            found["ua"], found["va"] = wind_from_stress(found["taux"], found["tauy"])
        named = {NAMES.get(name, name): value for name, value in found.items()}
        return {name: value for name, value in named.items() if name in Fields._fields}


def check_believable(
    name: str, values: Floats, axes: tuple[Floats, Floats], ds: xr.Dataset, moments: Sequence[datetime] | None
) -> None:
    """Raise `ForcingError` where values (record, lat, lon) of a field are too large to be true."""
    quantity = QUANTITIES[name]
    wrong = np.argwhere(np.abs(values) > quantity.limit)
    if wrong.size:
        record, j, i = (int(k) for k in wrong[0])
        when = f"{moments[record]:%Y-%m-%d %H:%M}, " if moments is not None else ""
        place = f"{latitude(axes[1][j], 3)}, {longitude(axes[0][i], 3)}"
        raise ForcingError(
            f"{name} is {values[record, j, i]:.3g} {quantity.units} at {when}{place}; "
            f"beyond {quantity.limit:g} it is not believable",
            where=named(ds),
            remedy="Is it a missing value that the file does not declare, or another unit? Correct the file's attributes",
        )


def belongs(name: str) -> str:
    """Whether a canonical field is needed at corners or at centres of the cells, or not at all."""
    if name in CORNER_FIELDS or name in ("taux", "tauy"):
        return "corner"
    return "centre" if NAMES.get(name, name) in Fields._fields else ""
