"""Numbers made dense, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.state.population import numbered


@pytest.mark.parametrize("values", [[], [3, 3, 1], [0], [-1, 5, 5], [10**9, 2], [7, 0, 7, 2]])
def test_numbers_and_places_are_those_of_unique(values: list[int]) -> None:
    numbers, place = numbered(np.array(values, np.int64))
    theirs, inverse = np.unique(np.array(values, np.int64), return_inverse=True)
    np.testing.assert_array_equal(numbers, theirs)
    np.testing.assert_array_equal(place, inverse)


def test_random_numbers_of_bergs() -> None:
    values = np.random.default_rng(1).integers(1, 500, 300)
    for mine, theirs in zip(numbered(values), np.unique(values, return_inverse=True), strict=True):
        np.testing.assert_array_equal(mine, theirs)
