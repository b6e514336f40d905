"""Numbers of bergs and cells made dense, 0, 1, ...: what sums by number need."""

from __future__ import annotations

import numpy as np

from riftberg.compiled.kernels import kernel
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
