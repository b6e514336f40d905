"""Bergs that take the same number of sub-steps go through them together."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.state import Bonds, Elements, Ints
from riftberg.state.population import cut_out, put_back
from riftberg.stepping.bond_rows import BondRows, allocate_rows
from riftberg.stepping.breaking import ContactPairs, allocate_pairs
from riftberg.stepping.media import Surroundings
from riftberg.stepping.partners import Neighbourhood
from riftberg.stepping.run_state import RunState
from riftberg.stepping.substep import Scratch, allocate_scratch


class Room(NamedTuple):
    """Room for the sub-steps of some bergs."""

    rows: BondRows
    pairs: ContactPairs
    scratch: Scratch


def _room_for(elements: Elements, bonds: Bonds) -> Room:
    pairs = allocate_pairs(max(bonds.first.size, 1))
    return Room(allocate_rows(bonds, elements.size), pairs, allocate_scratch(elements.size))


class Batch:
    """Bergs that take the same number of sub-steps: all of a run, or a copy of some of them."""

    def __init__(self, run: RunState, rows: Ints | None) -> None:
        self.rows = rows
        self._bond_rows: Ints = np.zeros(0, np.int64)
        self.near = Neighbourhood()
        self.take(run)
        self.room = _room_for(self.elements, self.bonds)

    def take(self, run: RunState) -> None:
        """Take the state of a run."""
        self.population_version = run.population.version
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
