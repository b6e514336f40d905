"""The best pairs of two lists, where a pair can be forbidden and anything may stay alone."""

from __future__ import annotations

import numpy as np

from riftberg.state import Floats


def best_pairs(cost: Floats, alone: float) -> list[tuple[int, int]]:
    """Return the pairs of the least total cost, where each row that stays alone costs ``alone``.

    ``cost``: cost of each pair, not negative (shape (rows, columns)); returns row and column of each pair, by row.
    """
    rows, columns = cost.shape
    # Loaded here: it takes a third of a second, and few commands need it.
    from scipy.optimize import linear_sum_assignment

    # Each row gets a column of its own on which it stays alone.
    table = np.full((rows, columns + rows), np.inf)
    table[:, :columns] = cost
    table[np.arange(rows), columns + np.arange(rows)] = alone
    pairs = zip(*linear_sum_assignment(table), strict=True)
    return [(int(row), int(column)) for row, column in pairs if column < columns]
