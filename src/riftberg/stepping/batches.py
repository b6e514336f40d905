"""Bergs that take the same number of sub-steps go through them together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.state import Ints
from riftberg.state.population import cut_out, put_back
from riftberg.stepping.media import Surroundings
from riftberg.stepping.partners import Neighbourhood
from riftberg.stepping.run_state import RunState
from riftberg.stepping.substep import allocate_room


class Batch:
    """Bergs that take the same number of sub-steps: all of a run, or a copy of some of them."""

    def __init__(self, run: RunState, rows: Ints | None) -> None:
        self.rows = rows
        self._bond_rows: Ints = np.zeros(0, np.int64)
        self.near = Neighbourhood()
        self.take(run)
        self.room = allocate_room(self.elements, self.bonds)

    def take(self, run: RunState) -> None:
        """Take the state of a run."""
        if self.rows is None:
            self.elements, self.bonds = run.elements, run.bonds
        else:
            self.elements, self.bonds, self._bond_rows = cut_out(run.elements, run.bonds, self.rows)

    def surroundings(self, of_all: Surroundings) -> Surroundings:
        """Return what acts on its elements."""
        if self.rows is None:
            return of_all
        return Surroundings(
            **{name: values if name == "acts" else values[self.rows] for name, values in of_all._asdict().items()}
        )

    def give(self, run: RunState, around: Surroundings, of_all: Surroundings) -> None:
        """Give the state, and the forces that were applied, back to the run."""
        if self.rows is not None:
            put_back(run.elements, run.bonds, self.rows, self._bond_rows, self.elements, self.bonds)
            of_all.applied[self.rows] = around.applied

    def of_all(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of its elements."""
        return values if self.rows is None or values.size == 0 else values[self.rows]
