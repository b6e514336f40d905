"""Numbers of bergs and cells made dense, 0, 1, ..., for sums by number; rows found by identifier; the reference's order.

The reference goes through its elements by a sorted list in each cell of the grid (equations 1.6).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.state import Elements
from riftberg.state.variables import Floats, Ints

SPARSE = 8
"""Largest number over how many there are up to which a table of all numbers is quicker than sorting."""


def numbered(values: Ints) -> tuple[Ints, Ints]:
    """Return the different values, rising, and for each value its place among them: `numpy.unique` with its inverse.

    Numbers of bergs are small and whole, so that a table takes the place of a sort wherever it is not too long.
    """
    if values.size == 0 or values.min() < 0 or (top := int(values.max())) > SPARSE * values.size:
        numbers, place = np.unique(values, return_inverse=True)
        return numbers, np.asarray(place, np.int64)
    table = np.zeros(top + 1, np.int64)
    table[values] = 1
    numbers = np.flatnonzero(table)
    table[numbers] = np.arange(numbers.size)
    return numbers, table[values]


def summed(known: Ints, sums: Floats, values: Ints, amounts: Floats) -> tuple[Ints, Floats]:
    """Return sums by number with amounts added, in the order in which they stand."""
    numbers, place = numbered(np.concatenate([known, values]))
    out = np.zeros((len(amounts), numbers.size))
    _add_columns(place[: known.size], np.ascontiguousarray(sums, dtype=float), out)
    _add_columns(place[known.size :], amounts, out)
    return numbers, out


@kernel
def _add_columns(place: Ints, amounts: Floats, sums: Floats) -> None:
    """Add amounts to the columns of their numbers, in their order."""
    for k in range(amounts.shape[0]):
        for n in range(place.size):
            sums[k, place[n]] += amounts[k, n]


def changed_rows(
    ids: Ints, values: tuple[Floats, ...], ids_before: Ints, before: tuple[Floats, ...]
) -> NDArray[np.bool_]:
    """Return which elements have other values than before; the newly born count as changed."""
    if ids_before.size == 0:
        return np.ones(ids.size, bool)
    changed: NDArray[np.bool_]
    if np.array_equal(ids, ids_before):  # as in most steps: then there is nothing to sort
        changed = np.zeros(ids.size, bool)
        for now, then in zip(values, before, strict=True):
            changed |= now != then
        return changed
    row, known = rows_of(ids_before, ids)
    changed = ~known
    for now, then in zip(values, before, strict=True):
        changed |= now != then[row]
    return changed


def by_identifier(ids: Ints, values: Floats, wanted: Ints) -> Floats:
    """Return rows of values in the order of other identifiers; zeros for those that have none."""
    taken = np.zeros((wanted.size, *values.shape[1:]))
    row, known = rows_of(ids, wanted)
    taken[known] = values[row[known]]
    return taken


def rows_of(ids: Ints, wanted: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the row of each wanted identifier, any one where it is not there, and whether it is there."""
    if ids.size == 0:
        return np.zeros(wanted.size, np.int64), np.zeros(wanted.size, np.bool_)
    order = np.argsort(ids, kind="stable")
    # Beyond the last identifier the last row is taken, and found to be another one.
    row = order[np.minimum(np.searchsorted(ids[order], wanted), ids.size - 1)]
    return row, ids[row] == wanted


def listed(el: Elements, cell_i: Ints | None = None, cell_j: Ints | None = None) -> Ints:
    """Return the rows of all elements in the order of the reference's lists.

    Row by row and column by column of the grid; in a cell by date, mass and place of origin, and of equals the one that came
    into the cell last goes first.
    """
    place, life = el.place, el.life
    columns, rows = (place.cell_i, place.cell_j) if cell_i is None or cell_j is None else (cell_i, cell_j)
    keys = life.start_lat, life.start_lon, life.start_mass, life.start_day, life.start_year, columns, rows
    return np.asarray(np.lexsort((-np.arange(el.size), -place.entered, *keys)), np.int64)


def enter_cells(el: Elements, cell_i: Ints, cell_j: Ints) -> None:
    """Note which elements have come into another cell since they stood in the cells (``cell_i``, ``cell_j``)."""
    place = el.place
    moved = (place.cell_i != cell_i) | (place.cell_j != cell_j)
    if not moved.any():
        return
    old, new = np.lexsort((np.arange(el.size), place.entered)), listed(el, cell_i, cell_j)
    place.entered[np.concatenate([old[~moved[old]], new[moved[new]]])] = np.arange(el.size)
