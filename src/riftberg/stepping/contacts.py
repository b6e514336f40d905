"""Contact between bergs as events: who met whom, when, where and how fast."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Ints
from riftberg.stepping.fragments import FragmentTree

APART: Final = 6.0 * 3600.0
"""Time (s) after which bergs that touch again have met anew."""


@dataclass(frozen=True)
class Meeting:
    """One meeting of two bergs or fragments.

    Attributes
    ----------
    first, second : int
        Their numbers.
    time, end : float
        Start of the long step in which they first touched, and end of that in which they last did, s since the start.
    lon, lat : float
        Where they first touched, degrees (m on a Cartesian grid).
    speed : float
        Relative speed before they touched, m s-1.
    """

    first: int
    second: int
    time: float
    end: float
    lon: float
    lat: float
    speed: float


class ContactLog:
    """All meetings of a run.

    A piece and what it broke off touch from its birth on; that is no meeting before they have been `APART`.

    Parameters
    ----------
    rows : list of Meeting, optional
        Meetings so far.
    quiet : dict, optional
        When pairs last touched that are no meeting.
    """

    def __init__(self, rows: list[Meeting] | None = None, quiet: dict[tuple[int, int], float] | None = None) -> None:
        self._rows: list[Meeting] = list(rows or [])
        self._ends = [row.end for row in self._rows]
        self.quiet: dict[tuple[int, int], float] = dict(quiet or {})
        self._latest = {(row.first, row.second): k for k, row in enumerate(self._rows)}

    @property
    def rows(self) -> list[Meeting]:
        """All meetings, in order of time."""
        # Hundreds of pieces touch in each step: their ends are kept as numbers, and told when somebody asks.
        for k, (row, end) in enumerate(zip(self._rows, self._ends, strict=True)):
            if row.end != end:
                self._rows[k] = replace(row, end=end)
        return self._rows

    def saved(self) -> ContactLog:
        """Return a copy to go back to; made before each long step, so that nothing is looked for anew."""
        copy = ContactLog()
        copy._rows, copy._ends = self._rows.copy(), self._ends.copy()
        copy.quiet, copy._latest = self.quiet.copy(), self._latest.copy()
        return copy

    def update(
        self,
        before: Elements,
        pairs: tuple[Ints, Ints],
        began: float,
        ended: float,
        tree: FragmentTree,
        p: KernelParameters,
    ) -> None:
        """Take note of the pairs of elements that touched in a long step.

        Parameters
        ----------
        before : Elements
            The state before the step: speeds, places, and numbers of the bergs, which may break when they meet.
        pairs : tuple of array
            Rows of the elements of each pair.
        began, ended : float
            Of the long step, s.
        tree : FragmentTree
        p : KernelParameters
        """
        first, second = pairs
        if first.size == 0:
            return
        berg = before.body.berg
        one, other = np.minimum(berg[first], berg[second]), np.maximum(berg[first], berg[second])
        apart = np.flatnonzero(one != other)
        one, other = one[apart], other[apart]
        each = np.unique(one * (int(other.max(initial=0)) + 1) + other, return_index=True)[1]
        for key, k in zip(zip(one[each].tolist(), other[each].tolist()), apart[each].tolist(), strict=True):
            if self._goes_on(key, began, ended, tree):
                continue
            self._latest[key] = len(self._rows)
            self._rows.append(_meeting(before, key, int(first[k]), int(second[k]), began, ended, p))
            self._ends.append(ended)

    def _goes_on(self, key: tuple[int, int], began: float, ended: float, tree: FragmentTree) -> bool:
        """Extend the contact of a pair that touched not long ago; True if that is so."""
        k = self._latest.get(key)
        if k is not None and began - self._ends[k] < APART:
            self._ends[k] = ended
            return True
        if (key in self.quiet and began - self.quiet[key] < APART) or self._by_birth(key, began, tree):
            self.quiet[key] = ended
            return True
        return False

    def _by_birth(self, key: tuple[int, int], began: float, tree: FragmentTree) -> bool:
        """Whether a pair touches because one of it has just broken off: from the other, or from what touched that."""
        for own, other in (key, key[::-1]):
            row = tree.rows[own - 1] if 0 < own <= len(tree.rows) else None
            if row is None or row.parent <= 0 or began - row.birth_time >= APART:
                continue
            family = (min(row.parent, other), max(row.parent, other))
            sibling = tree.rows[other - 1].parent if 0 < other <= len(tree.rows) else 0
            k = self._latest.get(family)
            met = k is not None and began - self._ends[k] < APART
            if row.parent in (other, sibling) or met or began - self.quiet.get(family, -np.inf) < APART:
                return True
        return False


def _meeting(
    el: Elements, key: tuple[int, int], i: int, j: int, began: float, ended: float, p: KernelParameters
) -> Meeting:
    """Return the meeting of two bergs at the elements in rows i and j."""
    place, motion = el.place, el.motion
    speed = float(np.hypot(motion.u[i] - motion.u[j], motion.v[i] - motion.v[j]))
    east = place.lon[i] - place.lon[j]
    if p.period > 0.0:  # half way between both, also across the seam
        east -= p.period * np.round(east / p.period)
    return Meeting(
        *key, began, ended, float(place.lon[i] - 0.5 * east), float(0.5 * (place.lat[i] + place.lat[j])), speed
    )
