"""Search for pairs against a look at all pairs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg.compiled.kernels import plain
from riftberg.state.neighbours import (
    ANY,
    OTHER_BERG,
    SAME_BERG,
    _hash_columns,
    _near_other_boxes,
    adjacency,
    find_pairs,
    near_pairs,
)
from twins import geometry

RADIUS = 6_363_827.0


def all_pairs(x, y, berg, reach, rule, latlon, period):
    """Partners of each element by looking at every pair."""
    n = len(x)

    def joined(e, c):
        if e == c or (rule == SAME_BERG and berg[e] != berg[c]) or (rule == OTHER_BERG and berg[e] == berg[c]):
            return False
        r = geometry.separation((x[e], y[e]), (x[c], y[c]), latlon, RADIUS, period)
        return np.linalg.norm(r) < reach

    return [[c for c in range(n) if joined(e, c)] for e in range(n)]


def listed(pairs, x, y, reach, latlon, period):
    """Partners of each element from the list, less those that stand in it though they are beyond reach."""
    n = pairs.start.size - 1
    found = []
    for e in range(n):
        mine = pairs.partner[pairs.start[e] : pairs.start[e + 1]].tolist()
        assert mine == sorted(set(mine))
        near = [
            c
            for c in mine
            if np.linalg.norm(geometry.separation((x[e], y[e]), (x[c], y[c]), latlon, RADIUS, period)) < reach
        ]
        found.append(near)
    return found


@pytest.mark.compiled
@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 40),
    reach=st.floats(10, 8000),
    rule=st.sampled_from([ANY, SAME_BERG, OTHER_BERG]),
    period=st.sampled_from([0.0, 20_000.0]),
)
def test_all_pairs_are_found_on_a_plane(seed, count, reach, rule, period):
    """Cartesian, with and without a period; positions beyond the period too."""
    r = np.random.default_rng(seed)
    x, y = r.uniform(-3e3, 23e3, count), r.uniform(0, 15e3, count)
    berg = r.integers(0, 3, count)
    pairs = find_pairs(x, y, berg, reach, rule, False, RADIUS, period)
    assert listed(pairs, x, y, reach, False, period) == all_pairs(x, y, berg, reach, rule, False, period)


@pytest.mark.compiled
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 40), middle=st.sampled_from([0.0, -60.0, -79.0, 85.0, 89.3]))
def test_all_pairs_are_found_on_the_sphere(seed, count, middle):
    """Around the seam of longitudes and at high latitudes."""
    r = np.random.default_rng(seed)
    y = middle + r.uniform(-0.3, 0.3, count)
    x = 359.7 + r.uniform(-0.5, 0.5, count) / np.cos(np.radians(middle))
    x = np.where(r.random(count) < 0.5, x, x % 360.0)
    berg = r.integers(0, 2, count)
    reach = r.uniform(1e3, 2e4)
    pairs = find_pairs(x, y, berg, reach, ANY, True, RADIUS, 360.0)
    assert listed(pairs, x, y, reach, True, 360.0) == all_pairs(x, y, berg, reach, ANY, True, 360.0)


@pytest.mark.parametrize("start", [10.0, 178.0, 359.5, -0.5, 719.0])
def test_of_a_circle_only_the_part_is_binned_that_the_elements_cover(start):
    """A field of bergs 3 degrees wide was searched in bins around the whole earth; the list of pairs is the same."""
    r = np.random.default_rng(7)
    x, y = start + r.uniform(0.0, 3.0, 200), -58.0 + r.uniform(0.0, 1.5, 200)
    wrapped = np.where(r.random(200) < 0.5, x, (x + 180.0) % 360.0 - 180.0)
    open_ended, circle = (find_pairs(x, y, np.arange(200), 8e3, ANY, True, RADIUS, period) for period in (0.0, 360.0))
    across = find_pairs(wrapped, y, np.arange(200), 8e3, ANY, True, RADIUS, 360.0)
    assert open_ended.partner.size > 200
    for found in (circle, across):
        np.testing.assert_array_equal(found.start, open_ended.start)
        np.testing.assert_array_equal(found.partner, open_ended.partner)
    columns = [
        plain(_hash_columns)(at, y, 8e3, True, RADIUS, p)[2] for at, p in ((x, 0.0), (x, 360.0), (wrapped, 360.0))
    ]
    assert max(columns) <= columns[0] + 2
    around = plain(_hash_columns)(np.linspace(0.0, 359.9, 3600), np.full(3600, -58.0), 8e3, True, RADIUS, 360.0)
    assert around[6]  # and bergs all around the pole meet across the ends


@pytest.mark.parametrize("count", [1, 2])
def test_one_place_and_few_elements(count):
    """Elements in one point, which no bin can part."""
    x = y = np.full(count, 5.0)
    pairs = find_pairs(x, y, np.zeros(count, np.int64), 1.0, ANY, False, RADIUS, 0.0)
    assert pairs.partner.tolist() == ([] if count == 1 else [1, 0])


def test_adjacency_lists_unbroken_bonds_of_both_ends_in_order():
    """Bonds of status 1 or 2 do not join."""
    first, second = np.array([0, 2, 1, 0]), np.array([1, 0, 3, 3])
    pairs, bond = adjacency(first, second, np.array([0, 0, 1, 0]), 5)
    lists = [pairs.partner[pairs.start[e] : pairs.start[e + 1]].tolist() for e in range(5)]
    bonds = [bond[pairs.start[e] : pairs.start[e + 1]].tolist() for e in range(5)]
    assert lists == [[1, 2, 3], [0], [0], [0], []]
    assert bonds == [[0, 1, 3], [0], [1], [3], []]


@pytest.mark.parametrize("period", [360.0, 0.0])
def test_positions_of_a_run_gone_wrong_do_not_lead_out_of_the_bins(period):
    """A run with verlet and too long a step once ended in a segmentation fault instead of an error."""
    x = np.array([-37.0, 1e200, -1e300, -37.01, 5.0])
    y = np.array([-56.0, 1e150, -56.0, -56.0, -1e250])
    found = find_pairs(x, y, np.arange(5), 5e3, ANY, True, 6.371e6, period)
    assert found.start[-1] == found.partner.size
    assert 3 in found.partner[found.start[0] : found.start[1]]


@pytest.mark.compiled
@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 60),
    case=st.sampled_from(["plane", "ring", "sphere", "pole"]),
    far=st.booleans(),
    bergs=st.sampled_from([2, 3, 20]),
)
def test_pairs_with_a_reach_of_their_own_are_found_each_once_and_in_order(seed, count, case, far, bergs):
    """Reaches over three orders of magnitude: in several classes where elements crowd, in one where they are far apart."""
    r = np.random.default_rng(seed)
    wide = 40.0 if far and case in ("plane", "sphere") else 1.0
    latlon, period = case in ("sphere", "pole"), {"plane": 0.0, "ring": 20_000.0}.get(case, 360.0)
    if latlon:
        y = (-89.3 if case == "pole" else -62.0) + wide * r.uniform(-0.3, 0.3, count)
        x = 359.7 + wide * r.uniform(-0.5, 0.5, count) / np.cos(np.radians(y))
        x = np.where(r.random(count) < 0.5, x, x % 360.0)
    else:
        x, y = wide * r.uniform(-3e3, 23e3, count), wide * r.uniform(0, 15e3, count)
    berg, reach = r.integers(0, bergs, count), 10.0 ** r.uniform(1.0, 4.0, count)
    if bergs < 20:  # few bergs lie in part beside each other, in boxes of their own
        y = y + berg * (0.3 if latlon else 8e3) * (-1.0 if case == "sphere" else 1.0)
    first, second = near_pairs(x, y, berg, reach, latlon, RADIUS, period)
    wanted = []
    for e in range(count):
        for c in range(e + 1, count):
            apart = np.linalg.norm(geometry.separation((x[e], y[e]), (x[c], y[c]), latlon, RADIUS, period))
            if berg[e] != berg[c] and apart < reach[e] + reach[c]:
                wanted.append((e, c))
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == wanted


def test_elements_far_from_every_other_berg_do_not_enter_the_search() -> None:
    """Two rows of elements 1 m apart, whose ends are 2 m apart: with a reach of 0.7 m none, with one of 1.1 m the ends."""
    x, berg = np.append(np.arange(5.0), np.arange(6.0, 11.0)), np.repeat([1, 2], 5)
    near = _near_other_boxes(x, np.zeros(10), berg, np.full(10, 0.7), False, 0.0, 0.0)
    assert near.tolist() == []
    near = _near_other_boxes(x, np.zeros(10), berg, np.full(10, 1.1), False, 0.0, 0.0)
    assert near.tolist() == [4, 5]
