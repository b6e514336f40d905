"""Elements and bonds that come and go: arrays with spare capacity, and identifiers that are never used twice.

An element is its ``id``, a bond its ``id``; the row in which it lies changes when others before it are removed. So
`Population.elements` and `Population.bonds` are views that hold until the next append or remove: take them anew then.
Rows keep their order, and the newly born come last.

Numbers of bergs and cells are made dense (0, 1, ...) for sums by number, and rows are found by identifier. The reference goes
through its elements by a sorted list in each cell of the grid (equations 1.6).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.errors import InputError
from riftberg.state import Bonds, Elements, Ints, build_elements, new_bonds
from riftberg.state.variables import Floats


class Saved(NamedTuple):
    """A population as it stood at one moment."""

    elements: Elements
    bonds: Bonds
    next_element: int
    next_bond: int
    version: int
    stepped_only: bool
    columns: tuple[Ints, ...]  # The copies, as whole numbers of the same bits


class Population:
    """Elements and bonds of a run."""

    def __init__(self, elements: Elements, bonds: Bonds, next_element: int = 0, next_bond: int = 0) -> None:
        self.version = 0
        # What `saved` copies, all of it or what a step changes: a checkpoint with it would keep rows that are gone.
        self._columns: dict[bool, tuple[Ints, ...]] = {}
        self._elements, self._bonds = elements, bonds
        self._room, self._bond_room = elements.arrays(), bonds.arrays()
        self.next_element = max(next_element, _above(elements.body.id))
        self.next_bond = max(next_bond, _above(bonds.id))

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy; ``_columns`` points into these arrays."""
        return {**self.__dict__, "_columns": {}}

    @property
    def elements(self) -> Elements:
        """The elements, by row; see the top of this file for how long they hold."""
        return self._elements

    @property
    def bonds(self) -> Bonds:
        """The bonds, by row."""
        return self._bonds

    def rows(self, ids: Any) -> Ints:
        """Return the rows of elements."""
        requested = np.atleast_1d(np.asarray(ids, np.int64))
        row, exists = find_rows(self._elements.body.id, requested)
        if not exists.all():
            raise InputError(
                f"no element has the identifier {requested[~exists][0]}",
                where="population",
                remedy="Take identifiers from elements.id; those of removed elements are not used again",
            )
        return row

    def append(self, elements: Elements, bonds: Bonds | None = None, *, ids: Ints | None = None) -> Ints:
        """Add elements and bonds between them."""
        if ids is None:
            ids = np.arange(self.next_element, self.next_element + elements.size)
        elif np.isin(ids, self._elements.body.id).any() or np.unique(ids).size != elements.size:
            raise InputError(
                f"one of the identifiers {ids.tolist()[:5]} is in use, or stands twice",
                where="population",
                remedy="Give each newly born an identifier of its own",
            )
        self.next_element = max(self.next_element, _above(ids))
        old_size = self._elements.size
        self._room = _extended(self._room, old_size, {**elements.arrays(), "id": ids})
        self._show(old_size + elements.size, self._bonds.first.size)
        if bonds is not None and bonds.first.size:
            self._add_bonds({**bonds.arrays(), "first": bonds.first + old_size, "second": bonds.second + old_size})
        self.version += 1
        return ids

    def join(self, first: Any, second: Any) -> Ints:
        """Form unbroken bonds between elements by their identifiers; returns the identifiers of the bonds."""
        new = new_bonds(self.rows(first), self.rows(second))
        self.version += 1
        return self._add_bonds(new.arrays())

    def remove(self, ids: Any) -> None:
        """Take elements out, with all bonds that end in them."""
        stays = np.ones(self._elements.size, bool)
        stays[self.rows(ids)] = False
        # New row of each element that stays.
        row = np.cumsum(stays) - 1
        bonds = self._bonds.taken(stays[self._bonds.first] & stays[self._bonds.second])
        bonds.first[:], bonds.second[:] = row[bonds.first], row[bonds.second]
        self._hold(self._elements.taken(stays), bonds)

    def compact(self) -> None:
        """Give back the spare capacity."""
        self._hold(self._elements.copy(), self._bonds.copy())

    def saved(self, *, stepped_only: bool = False, into: Saved | None = None) -> Saved:
        """Return a copy to which `restore` goes back; in the memory of one that is done with, where the rows are the same."""
        if into is not None and (into.version, into.stepped_only) == (self.version, stepped_only):
            _copy_columns(self._columns[stepped_only], into.columns)
            return into
        copies = (
            (self._elements.copy_stepped(), self._bonds.copy_stepped())
            if stepped_only
            else (self._elements.copy(), self._bonds.copy())
        )
        pairs = [
            (array.view(np.int64), copy.view(np.int64))
            for current, copied_group in zip((*self._elements, self._bonds), (*copies[0], copies[1]), strict=True)
            for array, copy in zip(current, copied_group, strict=True)
            if array is not copy
        ]
        self._columns[stepped_only], columns = zip(*pairs, strict=True)
        return Saved(*copies, self.next_element, self.next_bond, self.version, stepped_only, columns)

    def restore(self, saved: Saved) -> None:
        """Go back to a saved population; in place where no row has come or gone since."""
        # Rows have come or gone: the views of that moment are taken up again, with their numbers.
        if self.version != saved.version:
            self._hold(saved.elements, saved.bonds)
            self.next_element, self.next_bond = saved.next_element, saved.next_bond
            return
        for current, saved_group in ((self._elements, saved.elements), (self._bonds, saved.bonds)):
            for name, array in current.arrays().items():
                array[:] = getattr(saved_group, name)

    def _hold(self, elements: Elements, bonds: Bonds) -> None:
        self._room, self._bond_room = elements.arrays(), bonds.arrays()
        self._show(elements.size, bonds.first.size)
        self.version += 1

    def _show(self, elements: int, bonds: int) -> None:
        """Make the views of the rows in use."""
        self._columns = {}
        self._elements = build_elements({name: array[:elements] for name, array in self._room.items()})
        self._bonds = Bonds(**{name: array[:bonds] for name, array in self._bond_room.items()})

    def _add_bonds(self, arrays: dict[str, NDArray[Any]]) -> Ints:
        count, old_size = arrays["first"].size, self._bonds.first.size
        ids = np.arange(self.next_bond, self.next_bond + count)
        self.next_bond += count
        self._bond_room = _extended(self._bond_room, old_size, {**arrays, "id": ids})
        self._show(self._elements.size, old_size + count)
        return ids


@borrower
def _copy_columns(source: tuple[Ints, ...], target: tuple[Ints, ...]) -> None:
    """Copy arrays, all of them in one call: there are some fifty, which for a small berg cost NumPy more than their numbers.

    What has not changed is not written: zeros that never were written take no memory.
    """
    for k in range(len(source)):
        from_column, to_column, changed = source[k], target[k], 0
        for n in range(from_column.size):
            changed |= from_column[n] ^ to_column[n]
        if changed != 0:
            for n in range(from_column.size):
                to_column[n] = from_column[n]


def _above(ids: Ints) -> int:
    return int(ids.max()) + 1 if ids.size else 1


def _extended(room: dict[str, NDArray[Any]], used: int, new: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Write new rows behind those in use; where they do not fit, into arrays of twice the capacity."""
    needed = used + next(iter(new.values())).size
    capacity = next(iter(room.values())).size
    if needed > capacity:
        # Twice as much each time, so that many births cost no more than one copy of each row.
        bigger = {name: np.zeros(max(needed, 2 * capacity), array.dtype) for name, array in room.items()}
        for name, array in room.items():
            bigger[name][:used] = array[:used]
        room = bigger
    for name, array in room.items():
        array[used:needed] = new[name]
    return room


def cut_out(elements: Elements, bonds: Bonds, rows: Ints, block: slice | None = None) -> tuple[Elements, Bonds, Ints]:
    """Return some elements and a copy of the bonds between them, and the rows of these bonds."""
    position = np.full(elements.size, -1, np.int64)
    position[rows] = np.arange(rows.size)
    inside = np.flatnonzero((position[bonds.first] >= 0) & (position[bonds.second] >= 0))
    inner_bonds = bonds.taken(inside)
    inner_bonds.first[:], inner_bonds.second[:] = position[inner_bonds.first], position[inner_bonds.second]
    return elements.taken(rows) if block is None else elements.view_rows(block), inner_bonds, inside


def put_back(
    elements: Elements, bonds: Bonds, rows: Ints, bond_rows: Ints, piece: Elements, piece_bonds: Bonds,
    block: slice | None = None,
) -> None:  # fmt: skip
    """Write a piece that `cut_out` gave, with its changes since, back into its rows."""
    for name, array in piece.arrays().items() if block is None else ():
        getattr(elements, name)[rows] = array
    for name, array in piece_bonds.arrays().items():
        if name not in ("first", "second"):
            getattr(bonds, name)[bond_rows] = array


SPARSE = 8
"""Largest number over how many there are up to which a table of all numbers is quicker than sorting."""


def numbered(values: Ints) -> tuple[Ints, Ints]:
    """Return the different values, rising, and for each value its place among them: `numpy.unique` with its inverse.

    Numbers of bergs are small and whole, so that a table takes the place of a sort wherever it is not too long.
    """
    if values.size == 0 or values.min() < 0 or (top := int(values.max())) > SPARSE * values.size:
        numbers, position = np.unique(values, return_inverse=True)
        return numbers, np.asarray(position, np.int64)
    table = np.zeros(top + 1, np.int64)
    table[values] = 1
    numbers = np.flatnonzero(table)
    table[numbers] = np.arange(numbers.size)
    return numbers, table[values]


def summed(numbers_before: Ints, sums: Floats, values: Ints, amounts: Floats) -> tuple[Ints, Floats]:
    """Return sums by number with amounts added, in the order in which they stand."""
    numbers, position = numbered(np.concatenate([numbers_before, values]))
    out = np.zeros((len(amounts), numbers.size))
    _add_columns(position[: numbers_before.size], np.ascontiguousarray(sums, dtype=float), out)
    _add_columns(position[numbers_before.size :], amounts, out)
    return numbers, out


@kernel
def _add_columns(column: Ints, amounts: Floats, sums: Floats) -> None:
    """Add amounts to the columns of their numbers, in their order."""
    for k in range(amounts.shape[0]):
        for n in range(column.size):
            sums[k, column[n]] += amounts[k, n]


def changed_rows(
    ids: Ints, values: tuple[Floats, ...], ids_before: Ints, values_before: tuple[Floats, ...]
) -> NDArray[np.bool_]:
    """Return which elements have other values than before; the newly born count as changed."""
    if ids_before.size == 0:
        return np.ones(ids.size, bool)
    row, existed = find_rows(ids_before, ids)
    changed = ~existed
    for current, old in zip(values, values_before, strict=True):
        changed |= current != old[row]
    return changed


def by_identifier(ids: Ints, values: Floats, requested: Ints) -> Floats:
    """Return rows of values in the order of other identifiers; zeros for those that have none."""
    ordered = np.zeros((requested.size, *values.shape[1:]))
    row, exists = find_rows(ids, requested)
    ordered[exists] = values[row[exists]]
    return ordered


def find_rows(ids: Ints, requested: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the row of each wanted identifier, any one where it is not there, and whether it is there."""
    if ids.size == 0:
        return np.zeros(requested.size, np.int64), np.zeros(requested.size, np.bool_)
    if np.array_equal(ids, requested):  # as in most steps: then there is nothing to sort
        return np.arange(ids.size), np.ones(ids.size, np.bool_)
    order = np.argsort(ids, kind="stable")
    # Beyond the last identifier the last row is taken, and found to be another one.
    row = order[np.minimum(np.searchsorted(ids[order], requested), ids.size - 1)]
    return row, ids[row] == requested


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
