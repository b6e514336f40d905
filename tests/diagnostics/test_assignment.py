"""The best pairs, against all ways there are."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from riftberg.runs.accessor import best_pairs


@pytest.mark.parametrize("seed", range(12))
def test_pairs_may_be_forbidden_and_rows_stay_alone(seed: int) -> None:
    """Against every way to give columns, or none (-1), to three rows."""
    rng = np.random.default_rng(seed)
    cost = rng.random((3, int(rng.integers(0, 5)))) * 3.0
    cost[rng.random(cost.shape) < 0.3] = np.inf
    alone = 1.2

    def total(columns: tuple[int, ...]) -> float:
        return sum(alone if c < 0 else float(cost[r, c]) for r, c in enumerate(columns))

    ways = [
        w
        for w in product(range(-1, cost.shape[1]), repeat=3)
        if len({c for c in w if c >= 0}) == sum(c >= 0 for c in w)
    ]
    pairs = best_pairs(cost, alone)
    got = dict(pairs)
    assert total(tuple(got.get(row, -1) for row in range(3))) == pytest.approx(min(map(total, ways)))
    assert all(np.isfinite(cost[pair]) and cost[pair] <= 3.0 for pair in pairs)
