"""Which row of the run file belongs to which element and bond, also when elements come and go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from riftberg.state import Bonds, Elements, Floats, Ints

GONE: Final = 2
"""Status of a bond that is no more."""


class Layout:
    """Rows of a run file: all elements and bonds that the run has had, in order of birth."""

    def __init__(self) -> None:
        self.ids: Ints = np.zeros(0, np.int64)
        self.bond_ids: Ints = np.zeros(0, np.int64)
        self.gaps = self.outgrown = False
        self.moving: list[str] = []
        self.shape: dict[str, Floats] = {}
        self.latest: dict[str, NDArray[Any]] = {}
        self._begun = False

    def written(self) -> None:
        """Take note that a file has been laid out like this."""
        self.outgrown = False

    def taken_up(
        self, shape: dict[str, Floats], latest: dict[str, NDArray[Any]], *, gaps: bool, moving: list[str]
    ) -> None:
        """Take up the rows (``ids``, ``bond_ids``) of a file that goes on, with what it knows of them."""
        self.shape, self.latest, self.gaps, self.moving, self._begun = shape, latest, gaps, moving, True

    def follow(self, elements: Elements, bonds: Bonds, shape: Sequence[str], latest: Sequence[str]) -> None:
        """Take in the elements and bonds of a record, and see whether their shape has changed."""
        same = np.array_equal(elements.id, self.ids) and np.array_equal(bonds.id, self.bond_ids)
        if not same:
            self.gaps = self.gaps or self._begun
            self._add(elements, bonds, shape)
        row = slice(None) if same else _rows_of(elements.id, self.ids)
        for name in shape:
            if name not in self.moving and not np.array_equal(self.shape[name][row], getattr(elements, name)):
                self.moving.append(name)
                self.outgrown = True
        if not same:
            self.refresh(elements, bonds, latest)
        self._begun = True

    def _add(self, elements: Elements, bonds: Bonds, shape: Sequence[str]) -> None:
        born, formed = ~np.isin(elements.id, self.ids), ~np.isin(bonds.id, self.bond_ids)
        self.ids = np.concatenate([self.ids, elements.id[born]])
        self.bond_ids = np.concatenate([self.bond_ids, bonds.id[formed]])
        for name in shape:
            self.shape[name] = np.concatenate([self.shape.get(name, np.zeros(0)), getattr(elements, name)[born]])
        self.outgrown = True

    def refresh(self, elements: Elements, bonds: Bonds, names: Sequence[str]) -> None:
        """Take the present state of the bonds; of those that are no more, the last known one is kept."""
        row, end = _rows_of(bonds.id, self.bond_ids), _rows_of(elements.id, self.ids)
        known = row < self.bond_ids.size
        for name in names:
            values = getattr(bonds, name)
            table = np.zeros(self.bond_ids.size, values.dtype)
            before = self.latest.get(name, table[:0])
            table[: before.size] = before
            if name == "status":
                table[: before.size] = GONE
            table[row[known]] = (end[values] if name in ("first", "second") else values)[known]
            self.latest[name] = table


def _rows_of(ids: Ints, rows: Ints) -> Ints:
    """Return the rows in which identifiers stand; one behind the last where they do not."""
    if np.array_equal(ids, rows):
        return np.arange(rows.size)
    order = np.argsort(rows, kind="stable")
    place = np.searchsorted(rows[order], ids)
    row = np.append(order, rows.size)[np.minimum(place, rows.size)]
    there = np.append(rows, -1)[row] == ids
    return np.where(there, row, rows.size).astype(np.int64)


def placed(ids: Ints, values: NDArray[Any], rows: Ints, missing: float) -> NDArray[Any]:
    """Return values by the rows of other identifiers; ``missing`` where there is no value."""
    if np.array_equal(ids, rows):
        return values
    row = _rows_of(ids, rows)
    column = np.full(rows.size, missing, values.dtype)
    column[row[row < rows.size]] = values[row < rows.size]
    return column
