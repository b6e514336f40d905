"""Numbers of bergs and cells made dense, 0, 1, ...: what sums by number need."""

from __future__ import annotations

import numpy as np

from riftberg.state.variables import Ints

SPARSE = 8
"""Largest number over how many there are up to which a table of all numbers is quicker than sorting."""


def numbered(values: Ints) -> tuple[Ints, Ints]:
    """Return the different values, rising, and for each value its place among them: `numpy.unique` with its inverse.

    Numbers of bergs are small and whole, so that a table takes the place of a sort wherever it is not too long.

    Parameters
    ----------
    values : array of int
        Of any sign and size.
    """
    if values.size == 0 or values.min() < 0 or values.max() > SPARSE * values.size:
        numbers, place = np.unique(values, return_inverse=True)
        return numbers, np.asarray(place, np.int64)
    there = np.zeros(int(values.max()) + 1, bool)
    there[values] = True
    return np.flatnonzero(there), (np.cumsum(there) - 1)[values]
