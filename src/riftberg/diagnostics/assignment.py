"""The best pairs of two lists, where a pair can be forbidden and anything may stay alone.

SciPy has `scipy.optimize.linear_sum_assignment`, but Riftberg runs without SciPy (only its tests need it, and compare
both), and a day has a few pieces, not thousands.
"""

from __future__ import annotations

import numpy as np

from riftberg.state import Floats


def best_pairs(cost: Floats, alone: float) -> list[tuple[int, int]]:
    """Return the pairs of the least total cost, where each row that stays alone costs ``alone``.

    Parameters
    ----------
    cost : array, shape (rows, columns)
        Cost of each pair, not negative; infinite where it must not be.
    alone : float
        Cost of a row without a partner; columns without one cost nothing.

    Returns
    -------
    list of (int, int)
        Row and column of each pair, by row.
    """
    rows, columns = cost.shape
    # Each row gets a column of its own on which it stays alone; no column is ever closed to all.
    far = 1.0 + alone * (rows + 1) + float(cost[np.isfinite(cost)].sum())
    table = np.full((rows, columns + rows), far)
    table[:, :columns] = np.where(np.isfinite(cost), cost, far)
    table[np.arange(rows), columns + np.arange(rows)] = alone
    chosen = _assign(table)
    return [(row, column) for row, column in enumerate(chosen) if column < columns]


def _assign(cost: Floats) -> list[int]:
    """Return the column of each row in the assignment of the least sum; needs at least as many columns as rows.

    Rows join one by one along the cheapest path of changes to those placed before (Kuhn and Munkres, with potentials as
    in Jonker and Volgenant 1987, doi:10.1007/BF02278710).
    """
    rows, columns = cost.shape
    row_price, column_price = np.zeros(rows), np.zeros(columns)
    holder = np.full(columns, -1)
    for new in range(rows):
        best, before, done = np.full(columns, np.inf), np.full(columns, -1), np.zeros(columns, np.bool_)
        row, last, reached = new, -1, 0.0
        while True:
            through = reached + cost[row] - row_price[row] - column_price
            better = ~done & (through < best)
            best[better], before[better] = through[better], last
            last = int(np.argmin(np.where(done, np.inf, best)))
            reached = float(best[last])
            if holder[last] < 0:
                break
            done[last], row = True, int(holder[last])
        row_price[new] += reached
        for column in np.flatnonzero(done):
            row_price[holder[column]] += reached - best[column]
            column_price[column] -= reached - best[column]
        while last >= 0:
            previous = int(before[last])
            holder[last] = holder[previous] if previous >= 0 else new
            last = previous
    found = np.empty(rows, np.int64)
    found[holder[holder >= 0]] = np.flatnonzero(holder >= 0)
    return [int(column) for column in found]
