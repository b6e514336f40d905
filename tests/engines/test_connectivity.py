"""Connected parts against a flood fill; bonds that break after a step or are forgotten."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg.engines.common.fragments.connectivity import (
    break_after_step,
    connected_parts,
    drop_broken_bonds,
    drop_parted_bonds,
)
from riftberg.state import new_bonds, new_elements


def flood(count, first, second, status):
    """Number of each element's part, by walking from element to element."""
    near = {e: set() for e in range(count)}
    for i, j, s in zip(first, second, status, strict=True):
        if s == 0:
            near[i].add(j)
            near[j].add(i)
    number = [-1] * count
    parts = 0
    for start in range(count):
        if number[start] >= 0:
            continue
        front = [start]
        while front:
            e = front.pop()
            if number[e] < 0:
                number[e] = parts
                front.extend(near[e])
        parts += 1
    return number


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 40), links=st.integers(0, 60))
def test_connected_parts_equal_a_flood_fill(seed, count, links):
    """Also the numbering. Bug once: a bond of an element with itself read beyond the list of partners."""
    r = np.random.default_rng(seed)
    first, second = r.integers(0, count, (2, links))
    status = r.integers(0, 3, links)
    assert connected_parts(count, first, second, status).tolist() == flood(count, first, second, status)


def some_bonds():
    """Four elements in a row, three bonds."""
    el, bonds = new_elements(4), new_bonds(np.array([0, 1, 2]), np.array([1, 2, 3]))
    el.bond_count[:] = [1, 2, 2, 1]
    return el, bonds


def test_breaking_after_the_step():
    """Spec 7.1: strictly above either threshold, by the strength of the bond; both ends lose a bond."""
    el, bonds = some_bonds()
    bonds.normal_stress[:] = [20e3, 18e3, -50e3]
    bonds.shear_stress[:] = [0.0, 0.0, 101e3]
    assert break_after_step(el, bonds, 18e3, 100e3, 77.0) == 2
    assert (bonds.status != 0).tolist() == [True, False, True]
    assert el.bond_count.tolist() == [0, 1, 1, 0]
    assert bonds.break_time[[0, 2]].tolist() == [77.0, 77.0]
    assert np.isnan(bonds.break_time[1])


def test_thresholds_of_zero_or_less_never_break_after_the_step():
    """Spec 7.1; in line they do (Q8)."""
    el, bonds = some_bonds()
    bonds.normal_stress[:] = bonds.shear_stress[:] = 1e9
    assert break_after_step(el, bonds, 0.0, -1.0, 0.0) == 0
    assert break_after_step(el, bonds, 0.0, 100e3, 0.0) == 3


def test_broken_bonds_are_forgotten_when_their_ends_part():
    """Spec 1.5: a broken bond inside one part stays as a contact pair."""
    _, bonds = some_bonds()
    bonds.status[:] = [1, 1, 0]
    drop_parted_bonds(bonds, np.array([0, 0, 1, 1]))
    assert bonds.status.tolist() == [1, 2, 0]
    drop_broken_bonds(bonds)
    assert bonds.status.tolist() == [2, 2, 0]
