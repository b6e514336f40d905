"""Melt water by fragment: what the elements of each fragment lost while they belonged to it, by process."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Final

import numpy as np

from riftberg.errors import InputError
from riftberg.life.ledger import PROCESSES
from riftberg.state import Floats, Ints
from riftberg.state.numbering import summed

KEPT: Final = "melt_by_fragment"
"""Name under which a restart keeps the table: a row for each fragment, its number and the water (kg) by process."""


def add_melt(remembered: MutableMapping[str, Floats], fragment: Ints, water: Floats) -> None:
    """Add a step.

    ``fragment``: number of the fragment of each element (shape (elements,)); ``water``: kg (shape (processes,
    elements)).
    """
    table = _table(remembered)
    numbers, sums = summed(table[:, 0].astype(np.int64), table[:, 1:].T, fragment, water)
    remembered[KEPT] = np.stack([numbers.astype(float), *sums], axis=1)


def melt_of(remembered: Mapping[str, Floats], numbers: Ints) -> Floats:
    """Return the melt water (kg) of some fragments, shape (fragments, processes)."""
    table = _table(remembered)
    out = np.zeros((len(numbers), len(PROCESSES)))
    if len(table) and len(numbers):
        place = np.minimum(np.searchsorted(table[:, 0], numbers), len(table) - 1)
        known = table[place, 0] == numbers
        out[known] = table[place[known], 1:]
    return out


def _table(remembered: Mapping[str, Floats]) -> Floats:
    """Return the table so far."""
    table = np.asarray(remembered.get(KEPT, np.zeros((0, 1 + len(PROCESSES)))))
    if table.ndim != 2 or table.shape[1] != 1 + len(PROCESSES) or table.dtype.kind not in "fiu":
        raise InputError(
            f"a table of shape {table.shape} and type {table.dtype}", where=f"restart file, extra/{KEPT}",
            remedy="Name a restart file that Riftberg wrote",
        )  # fmt: skip
    return table.astype(float)
