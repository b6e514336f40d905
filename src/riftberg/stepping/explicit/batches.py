"""Bergs that take the same number of sub-steps go through them together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.state import Ints
from riftberg.state.population import cut_out, put_back
from riftberg.stepping.contact.broad_phase import NeighbourSearch
from riftberg.stepping.explicit.breaking import OTHER_BERGS, TOUCHED, allocate_pairs
from riftberg.stepping.explicit.substeps import allocate_workspace
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.run_state import RunState


class Batch:
    """Bergs that take the same number of sub-steps: all of a run, or a copy of some of them."""

    def __init__(self, run: RunState, rows: Ints | None) -> None:
        self.rows = rows
        # Rows that follow one another are views into the state; others are copied out and back.
        self._block = None if rows is None or rows[-1] - rows[0] + 1 != rows.size else slice(rows[0], rows[-1] + 1)
        self._bond_rows: Ints = np.zeros(0, np.int64)
        self.near = NeighbourSearch()
        self._inside = 0
        self.gather(run)
        self.work = allocate_workspace(self.elements, self.bonds, run.constants)

    def gather(self, run: RunState) -> None:
        """Copy its elements and bonds from the state of a run."""
        if self.rows is None:
            self.elements, self.bonds = run.elements, run.bonds
        else:
            self.elements, self.bonds, self._bond_rows = cut_out(run.elements, run.bonds, self.rows, self._block)

    def surroundings(self, of_all: Surroundings) -> Surroundings:
        """Return what acts on its elements."""
        if self.rows is None:
            return of_all
        rows = self.rows if self._block is None else self._block
        return Surroundings(
            **{name: values if name == "acts" else values[rows] for name, values in of_all._asdict().items()}
        )

    def scatter(self, run: RunState, around: Surroundings, of_all: Surroundings) -> None:
        """Copy its elements and bonds, and the forces that were applied, back to the run."""
        if self.rows is not None:
            put_back(run.elements, run.bonds, self.rows, self._bond_rows, self.elements, self.bonds, self._block)
            if self._block is None:
                of_all.applied[self.rows] = around.applied

    def add_candidates(self, first: Ints, second: Ints) -> None:
        """List the pairs of different bergs that may come into contact, behind those inside bergs."""
        pairs = self.work.pairs
        used = int(pairs.used[0])
        self._inside = used
        if self.rows is not None:
            place = np.full(int(max(self.rows.max(), first.max(initial=0), second.max(initial=0))) + 1, -1, np.int64)
            place[self.rows] = np.arange(self.rows.size)
            inside = place[first] >= 0
            first, second = place[first[inside]], place[second[inside]]
        if first.size == 0:
            return
        # Bonds that break in the sub-steps are listed behind them.
        if used + first.size + self.bonds.first.size > pairs.first.size:
            bigger = allocate_pairs(2 * (used + first.size + self.bonds.first.size))
            for old, new in zip(pairs[:3], bigger[:3], strict=True):
                new[:used] = old[:used]
            self.work = self.work._replace(pairs=bigger)
            pairs = bigger
        block = slice(used, used + first.size)
        pairs.first[block], pairs.second[block], pairs.bond[block] = first, second, OTHER_BERGS
        pairs.used[0] = used + first.size

    def touched(self) -> tuple[Ints, Ints]:
        """Return the rows (of the run) of the pairs of different bergs that have touched in the sub-steps."""
        pairs = self.work.pairs
        count = int(pairs.used[0])
        k = np.flatnonzero(pairs.bond[self._inside : count] == TOUCHED) + self._inside
        first, second = pairs.first[k], pairs.second[k]
        return (first, second) if self.rows is None else (self.rows[first], self.rows[second])

    def of_all(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of its elements."""
        return values if self.rows is None or values.size == 0 else values[self.rows]
