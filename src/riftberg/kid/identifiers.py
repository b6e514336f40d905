"""KID's 64-bit identifiers of elements: a counter and the cell of creation (specification of files, section 0.4)."""

from __future__ import annotations

import numpy as np

from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Ints

_LOW = 0xFFFFFFFF


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


def new_identifiers(elements: Elements, grid: Grid) -> Ints:
    """Return identifiers for elements that have none: a count per cell, in the order of the elements."""
    ine, jne = cell_indices(elements, grid)
    cell = ine + grid.arrays.ni * (jne - 1)
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    counter = np.empty(len(cell), dtype=np.int64)
    sizes = np.diff(np.append(starts, len(cell)))
    counter[order] = np.arange(len(cell)) - np.repeat(starts, sizes) + 1
    return join_id(counter, cell)
