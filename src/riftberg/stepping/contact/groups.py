"""Groups of bergs that may come into contact: only within a group may one result depend on another (explicit schemes)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.state.numbering import numbered
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.run_state import RunState

NO_PAIRS: Final = (np.zeros(0, np.int64), np.zeros(0, np.int64))
"""Elements of no pairs."""

CONTACT_STEP: Final = 0.4
"""Longest sub-step times the frequency of a contact: below what damped contact is stable with (0.57)."""


def group_substeps(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the number of sub-steps of each element in a long step.

    Bergs that may come into contact go through the sub-steps together, in the largest number that one of them needs, or
    that the stiffest of their contacts does.
    """
    el, alone = run.elements, run.elements.body.substeps
    if first.size == 0:
        return alone
    needed = contact_substeps(run, sizes, first, second)
    numbers, berg = numbered(el.berg)
    group = connected_parts(numbers.size, berg[first], berg[second], np.zeros(first.size, np.int64))[berg]
    most = np.zeros(int(group.max()) + 1, np.int64)
    np.maximum.at(most, group, alone)
    np.maximum.at(most, group[first], needed)
    return most[group]


def contact_substeps(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the number of sub-steps that the contact of each pair needs in a long step.

    A power of 2, so that few groups differ, and one pair hardly changes its number from step to step.
    """
    c, rest = run.constants, sizes.radius[first] + sizes.radius[second]
    stiffness = np.full(first.size, c.contact_spring) if c.contact_spring >= 0.0 else c.modulus / rest**2
    needed = run.parameters.stepping.time_step * np.sqrt(stiffness) / CONTACT_STEP
    return np.asarray(2.0 ** np.ceil(np.log2(np.maximum(needed, 1.0)))).astype(np.int64)


def contact_rows(el: Elements, pairs: PairList, sizes: Sizes, p: KernelParameters) -> tuple[Ints, Ints]:
    """Elements of the pairs of a list that are within reach of contact, each pair once."""
    if pairs.partner.size == 0:
        return NO_PAIRS
    shown = el.shown
    near = _in_reach(shown.lon_pair, shown.lat_pair, sizes.radius, pairs, p)
    first = np.repeat(np.arange(el.size), np.diff(pairs.start))
    once = near & (first < pairs.partner)
    return first[once], pairs.partner[once]


def concatenate_pairs(pairs: Sequence[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """Return the pairs of several lists as one."""
    filled = [pair for pair in pairs if pair[0].size]
    if not filled:
        return NO_PAIRS
    return np.concatenate([pair[0] for pair in filled]), np.concatenate([pair[1] for pair in filled])


def contact_groups(el: Elements, collisions: PairList, radius: Floats, p: KernelParameters) -> Ints:
    """Number the groups of bergs that are within reach of each other, directly or by way of others; ``radius`` in m."""
    if (el.body.berg == el.body.berg[:1]).all():
        return np.zeros(0, np.int64)
    numbers, berg = numbered(el.body.berg)
    shown = el.shown
    near = _in_reach(shown.lon_pair, shown.lat_pair, radius, collisions, p)
    owner = np.repeat(np.arange(el.size), np.diff(collisions.start))[near]
    first, second = berg[owner], berg[collisions.partner[near]]
    return connected_parts(numbers.size, first, second, np.zeros(first.size, np.int64))[berg]


@kernel
def _in_reach(x: Floats, y: Floats, radius: Floats, pairs: PairList, p: KernelParameters) -> NDArray[np.bool_]:
    """Whether the elements of each pair of the list are as near as forces between bergs reach (equations 5.2)."""
    near = np.zeros(pairs.partner.size, np.bool_)
    for e in range(pairs.start.size - 1):
        for k in range(pairs.start[e], pairs.start[e + 1]):
            c = pairs.partner[k]
            rx, ry = separation(x[e], y[e], x[c], y[c], p.latlon, p.earth_radius, p.period)
            reach = max(radius[e] + radius[c], p.contact_distance)
            near[k] = rx * rx + ry * ry < reach * reach
    return near
