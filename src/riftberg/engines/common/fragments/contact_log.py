"""Contact between bergs as events: which bergs, when, where and how fast."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Ints

SEPARATION_TIME: Final = 6.0 * 3600.0
"""Time (s) without contact after which the next contact of two bergs is a new event."""

_HALF: Final = 32
_OTHER: Final = (1 << _HALF) - 1
"""The numbers of both bergs of a pair stand in one whole number, half each."""


@dataclass(frozen=True)
class ContactEvent:
    """One contact of two bergs or fragments."""

    first: int  # Number of one
    second: int  # Number of the other, which is larger
    time: float  # Start of the long step in which they first touched, s since the start of the run
    end: float  # End of the long step in which they last touched, s since the start of the run
    lon: float  # Where they first touched, degrees (m on a Cartesian grid)
    lat: float
    speed: float  # Relative speed before they touched, m s-1


class ContactLog:
    """All contact events of a run.

    A piece touches what it broke off from its birth on; that is suppressed until they have been apart for `SEPARATION_TIME`.
    """

    def __init__(
        self, rows: list[ContactEvent] | None = None, suppressed: dict[tuple[int, int], float] | None = None
    ) -> None:
        self._rows: list[ContactEvent] = list(rows or [])
        suppressed = suppressed or {}
        # When each contact last was: those of events first, then suppressed ones. Hundreds of pieces touch in each step, most
        # of them those of the step before, so arrays and not dictionaries are searched.
        self._last = np.array([row.end for row in self._rows] + list(suppressed.values()), np.float64)
        self._count = self._last.size
        self._of_row = list(range(len(self._rows)))
        self._latest = {(row.first, row.second): k for k, row in enumerate(self._rows)}
        self._suppressed = {key: len(self._rows) + k for k, key in enumerate(suppressed)}
        self._touching: tuple[Ints, Ints] = np.zeros(0, np.int64), np.zeros(0, np.int64)

    @property
    def rows(self) -> list[ContactEvent]:
        """All events, in order of time."""
        for k, (row, end) in enumerate(zip(self._rows, self._last[self._of_row].tolist(), strict=True)):
            if row.end != end:
                self._rows[k] = replace(row, end=end)
        return self._rows

    @property
    def suppressed(self) -> dict[tuple[int, int], float]:
        """When pairs last touched whose contact is no event."""
        return {key: float(self._last[k]) for key, k in self._suppressed.items()}

    def saved(self) -> ContactLog:
        """Return a checkpoint; one is made before each long step, so nothing is computed anew for it."""
        copy = object.__new__(ContactLog)  # what `__init__` finds out is known
        copy._rows, copy._of_row, copy._last = self._rows.copy(), self._of_row.copy(), self._last.copy()
        copy._suppressed, copy._latest, copy._touching = self._suppressed.copy(), self._latest.copy(), self._touching
        copy._count = self._count
        return copy

    def update(
        self,
        previous: Elements,
        pairs: tuple[Ints, Ints],
        began: float,
        ended: float,
        tree: FragmentTree,
        p: KernelParameters,
    ) -> None:
        """Record the pairs of elements that touched in a long step from ``began`` to ``ended``, s."""
        first, second = pairs
        if first.size == 0:
            return
        berg = previous.body.berg
        lower, higher = np.minimum(berg[first], berg[second]), np.maximum(berg[first], berg[second])
        different = np.flatnonzero(lower != higher)
        # One row of each pair of bergs, the first in the order of the elements: it gives place and speed of the
        # event.
        keys, each = np.unique((lower[different] << _HALF) | higher[different], return_index=True)
        contact = self._extended(keys, began, ended)
        for n in np.flatnonzero(contact < 0).tolist():
            key, k = (int(keys[n]) >> _HALF, int(keys[n]) & _OTHER), int(different[each[n]])
            event = self._continued_contact(key, began, tree)
            if event < 0:
                event = self._latest[key] = self._new()
                self._of_row.append(event)
                self._rows.append(_describe_contact(previous, key, int(first[k]), int(second[k]), began, ended, p))
            contact[n], self._last[event] = event, ended
        self._touching = keys, contact

    def _extended(self, keys: Ints, began: float, ended: float) -> Ints:
        """Extend the contacts of pairs that touched when last any did; the number of each contact, or -1."""
        previous_keys, contact = self._touching
        if previous_keys.size == 0:
            return np.full(keys.size, -1)
        # Most pairs are those of the step before, which stand in the same order.
        position = np.minimum(np.searchsorted(previous_keys, keys), previous_keys.size - 1)
        continues = (previous_keys[position] == keys) & (began - self._last[contact[position]] < SEPARATION_TIME)
        self._last[contact[position[continues]]] = ended
        return np.where(continues, contact[position], -1)

    def _continued_contact(self, key: tuple[int, int], began: float, tree: FragmentTree) -> int:
        """Return the contact of a pair that touched not long ago, or is suppressed; -1 for a new event."""
        k = self._latest.get(key, -1)
        if k >= 0 and began - self._last[k] < SEPARATION_TIME:
            return k
        k = self._suppressed.get(key, -1)
        if k >= 0 and began - self._last[k] < SEPARATION_TIME:
            return k
        if not self._by_birth(key, began, tree):
            return -1
        if k < 0:
            k = self._suppressed[key] = self._new()
        return k

    def _new(self) -> int:
        """Return the number of a new contact."""
        if self._count == self._last.size:  # twice the room, so that thousands may begin in one step
            self._last = np.append(self._last, np.full(max(self._last.size, 64), -np.inf))
        self._count += 1
        return self._count - 1

    def _by_birth(self, key: tuple[int, int], began: float, tree: FragmentTree) -> bool:
        """Whether a pair touches because one of it has just broken off: from the other, or from a piece that touched that one."""
        # Either of the two may be the newborn piece.
        for newborn, other in (key, key[::-1]):
            row = tree.rows[newborn - 1] if 0 < newborn <= len(tree.rows) else None
            if row is None or row.parent <= 0 or began - row.birth_time >= SEPARATION_TIME:
                continue
            family = (min(row.parent, other), max(row.parent, other))
            sibling = tree.rows[other - 1].parent if 0 < other <= len(tree.rows) else 0
            if row.parent in (other, sibling) or self._near_in_time(family, began):
                return True
        return False

    def _near_in_time(self, key: tuple[int, int], began: float) -> bool:
        """Whether a pair touched not long ago."""
        contacts = (self._latest.get(key, -1), self._suppressed.get(key, -1))
        return any(k >= 0 and began - self._last[k] < SEPARATION_TIME for k in contacts)


def _describe_contact(
    el: Elements, key: tuple[int, int], i: int, j: int, began: float, ended: float, p: KernelParameters
) -> ContactEvent:
    """Return the event of two bergs that touch at the elements in rows i and j."""
    place, motion = el.place, el.motion
    speed = float(np.hypot(motion.u[i] - motion.u[j], motion.v[i] - motion.v[j]))
    east = place.lon[i] - place.lon[j]
    if p.period > 0.0:  # half way between both, also across the seam
        east -= p.period * np.round(east / p.period)
    return ContactEvent(
        *key, began, ended, float(place.lon[i] - 0.5 * east), float(0.5 * (place.lat[i] + place.lat[j])), speed
    )
