"""KID's restart of calving: ice in the stores of the size classes (files 6.4), and counters of what was born in each cell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final, Self

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError
from riftberg.kid.ncfile import checksum, opened_dataset, unpacked
from riftberg.kid.restart import join_id, split_id
from riftberg.life.calving import Stores
from riftberg.ocean.grid import Grid
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import replacing
from riftberg.system.netcdf_lock import open_netcdf

CALVING_FILE: Final = "calving.res.nc"
"""Restart file of calving; it keeps the counters of the cells too."""

AXES: Final = {"xaxis_1": "X", "yaxis_1": "Y", "zaxis_1": "Z", "Time": "T"}
"""Dimensions of the file with their CF axis."""


def read_stores(path: Path, grid: Grid, classes: int) -> Stores | None:
    """Return what the file holds; None without a file."""
    if not path.is_file():
        return None
    shape = grid.arrays.nj, grid.arrays.ni
    counter = read_counter(path, grid)
    with opened_dataset(path) as dataset:

        def read(name: str, *size: int) -> Floats:
            return _field(dataset, path, name, size)

        def maybe(name: str) -> Floats | None:
            return read(name, *shape) if name in dataset.variables else None

        heat = maybe("stored_heat")
        return Stores(
            read("stored_ice", classes, *shape), np.zeros(shape) if heat is None else heat, counter,
            maybe("rmean_calving"), maybe("rmean_calving_hflx"), begun=True,
        )  # fmt: skip


def read_counter(path: Path, grid: Grid) -> Ints:
    """Return how many bergs were born in each cell; 0 where the file does not count them."""
    shape, name = (grid.arrays.nj, grid.arrays.ni), "iceberg_counter_grd"
    with opened_dataset(path) as dataset:
        if name not in dataset.variables:
            return np.zeros(shape, np.int64)
        counter = _field(dataset, path, name, shape)
    if not ((counter >= 0.0) & (counter < 2.0**31) & (counter == np.floor(counter))).all():
        raise InputError(
            "a count below 0, or no whole number", where=f"{path}, variable {name}", remedy="Correct the file"
        )
    return counter.astype(np.int64)


def _field(dataset: netCDF4.Dataset, path: Path, name: str, size: tuple[int, ...]) -> Floats:
    """Return a field of one moment, finite, and for ice not negative."""
    values = unpacked(dataset, path, name)
    if values.size != math.prod(size) or values.shape[-len(size) :] != size:
        raise InputError(
            f"shape {values.shape}, expected {size}{', size classes first' if len(size) == 3 else ''}",
            where=f"{path}, variable {name}",
            remedy="Give the file of a run on the same grid",
        )
    values = values.reshape(size)
    bad = ~np.isfinite(values) | ((values < 0.0) if name == "stored_ice" else False)
    if bad.any():
        at = tuple(int(k[0]) for k in np.nonzero(bad))
        raise InputError(
            f"values that are negative or no numbers, the first {values[at]:g} in row {at[-2] + 1}, column {at[-1] + 1}",
            where=f"{path}, variable {name}",
            remedy="Correct the file",
        )
    return values


def write_stores(path: Path, stores: Stores) -> None:
    """Write stores in the layout of the reference."""
    classes, nj, ni = stores.ice.shape
    plane = ("Time", "yaxis_1", "xaxis_1")
    columns: list[tuple[str, str, tuple[str, ...], NDArray[Any]]] = [
        ("stored_ice", "f8", ("Time", "zaxis_1", "yaxis_1", "xaxis_1"), stores.ice),
        ("stored_heat", "f8", plane, stores.heat),
        ("iceberg_counter_grd", "i4", plane, stores.counter),
    ]
    if stores.mean_flux is not None and stores.mean_heat is not None:
        columns += [
            ("rmean_calving", "f8", plane, stores.mean_flux),
            ("rmean_calving_hflx", "f8", plane, stores.mean_heat),
        ]
    with replacing(path, to_disk=True) as part, open_netcdf(part, "w", format="NETCDF3_64BIT_OFFSET") as dataset:
        for name, size in (("xaxis_1", ni), ("yaxis_1", nj), ("zaxis_1", classes), ("Time", None)):
            dataset.createDimension(name, size)
        for name, kind, dimensions, values in columns:
            variable = dataset.createVariable(name, kind, dimensions)
            variable.setncatts({"long_name": name.upper(), "units": "none", "checksum": checksum(values).strip()})
        for name, axis in AXES.items():
            variable = dataset.createVariable(name, "f8", (name,))
            units = "time level" if name == "Time" else "none"
            variable.setncatts({"long_name": name, "units": units, "cartesian_axis": axis})
        for name, _, _, values in columns:
            dataset.variables[name][0] = values
        for name, size in (("xaxis_1", ni), ("yaxis_1", nj), ("zaxis_1", classes), ("Time", 1)):
            dataset.variables[name][:] = np.arange(1.0, size + 1.0)


class IdentifierCounter:
    """Identifiers for what is born in a run: each cell counts its own (files 0.4).

    ``counts``: of the domain, without the halo (shape (rows, columns)).
    """

    def __init__(self, grid: Grid, counts: Ints) -> None:
        self._grid, self.counts = grid, counts

    @classmethod
    def beside(cls, restarts: Path, grid: Grid, identifiers: Ints) -> Self:
        """Return the counters of a folder of restarts, or 0 in every cell; never below those of elements that exist."""
        g = grid.arrays
        counts = np.zeros((g.nj, g.ni), np.int64)
        path = restarts / CALVING_FILE
        if path.is_file():
            counts[:] = read_counter(path, grid)
        counter, cell = split_id(identifiers)
        inside = (cell >= 1) & (cell <= counts.size)
        # A file of counters may be older than the elements beside it; an identifier must not come twice.
        np.maximum.at(counts.ravel(), cell[inside] - 1, counter[inside])
        return cls(grid, counts)

    def take(self, cell_i: int, cell_j: int) -> int:
        """Return the next identifier of a cell, by its array column and row."""
        g = self._grid.arrays
        i, j = cell_i - g.halo, cell_j - g.halo
        self.counts[j, i] += 1
        # Cells of the reference are counted from 1, row by row.
        return int(join_id(self.counts[j : j + 1, i], np.array([i + 1 + g.ni * j]))[0])
