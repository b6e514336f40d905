"""KID's 64-bit identifiers of elements: a counter and the cell of creation (files 0.4)."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Self

import numpy as np

from riftberg.kid.calving_file import read_counter
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Ints

_LOW = 0xFFFFFFFF

CALVING_FILE: Final = "calving.res.nc"
"""Restart file of calving; it keeps the counters of the cells too."""


def join_id(counter: Ints, cell: Ints) -> Ints:
    """Return identifiers from their two 32-bit components."""
    return (np.asarray(counter, dtype=np.int64) << 32) | (np.asarray(cell, dtype=np.int64) & _LOW)


def split_id(identifiers: Ints) -> tuple[Ints, Ints]:
    """Return the signed 32-bit components (``id_cnt``, ``id_ij``) of identifiers."""
    ids = np.asarray(identifiers, dtype=np.int64)
    return (ids >> 32) & _LOW, (ids & _LOW).astype(np.uint32).astype(np.int32).astype(np.int64)


def cell_indices(elements: Elements, grid: Grid) -> tuple[Ints, Ints]:
    """Return the cells of elements as KID counts them, from 1 (``ine``, ``jne``)."""
    halo = grid.arrays.halo
    return elements.cell_i - halo + 1, elements.cell_j - halo + 1


def new_identifiers(elements: Elements, grid: Grid, seam: bool = False) -> Ints:
    """Return identifiers for elements that have none: a count per cell, in the order of the elements."""
    ine, jne = cell_indices(elements, grid)
    if seam:
        ine, jne = np.ones_like(ine), np.where(elements.eta == 0.0, jne - 1, jne)
    cell = ine + grid.arrays.ni * (jne - 1)
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    counter = np.empty(len(cell), dtype=np.int64)
    sizes = np.diff(np.append(starts, len(cell)))
    counter[order] = np.arange(len(cell)) - np.repeat(starts, sizes) + 1
    return join_id(counter, cell)


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
        np.maximum.at(counts.ravel(), cell[inside] - 1, counter[inside])
        return cls(grid, counts)

    def take(self, cell_i: int, cell_j: int) -> int:
        """Return the next identifier of a cell, by its array column and row."""
        g = self._grid.arrays
        i, j = cell_i - g.halo, cell_j - g.halo
        self.counts[j, i] += 1
        return int(join_id(self.counts[j : j + 1, i], np.array([i + 1 + g.ni * j]))[0])
