"""Groups of bergs that can meet: only within a group may one result depend on another (own numerics)."""

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

NOBODY: Final = (np.zeros(0, np.int64), np.zeros(0, np.int64))
"""Rows of no pairs."""

CONTACT_STEP: Final = 0.4
"""Longest sub-step times the frequency of a contact: below what damped contact is stable with (0.57)."""


def substeps_of_meeting(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the sub-steps that each element takes in a long step: those of its berg, or of the bergs it may meet.

    Bergs that may meet go through the sub-steps together, in the largest number that one of them needs, or that the
    stiffest of their contacts does.
    """
    el, own = run.elements, run.elements.body.substeps
    if first.size == 0:
        return own
    needed = substeps_of_contact(run, sizes, first, second)
    numbers, berg = numbered(el.berg)
    group = connected_parts(numbers.size, berg[first], berg[second], np.zeros(first.size, np.int64))[berg]
    most = np.zeros(int(group.max()) + 1, np.int64)
    np.maximum.at(most, group, own)
    np.maximum.at(most, group[first], needed)
    return most[group]


def substeps_of_contact(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the sub-steps that a long step must have for the contact of each pair: a power of 2.

    So groups of like numbers go together, and hardly two meetings of one pair have different ones.
    """
    c, rest = run.constants, sizes.radius[first] + sizes.radius[second]
    stiffness = np.full(first.size, c.contact_spring) if c.contact_spring >= 0.0 else c.modulus / rest**2
    needed = run.parameters.stepping.time_step * np.sqrt(stiffness) / CONTACT_STEP
    return np.asarray(2.0 ** np.ceil(np.log2(np.maximum(needed, 1.0)))).astype(np.int64)


def touching_rows(el: Elements, pairs: PairList, sizes: Sizes, p: KernelParameters) -> tuple[Ints, Ints]:
    """Rows of the pairs of a list, each once, that are in reach of contact."""
    if pairs.partner.size == 0:
        return NOBODY
    shown = el.shown
    near = _in_reach(shown.lon_pair, shown.lat_pair, sizes.radius, pairs, p)
    first = np.repeat(np.arange(el.size), np.diff(pairs.start))
    kept = near & (first < pairs.partner)
    return first[kept], pairs.partner[kept]


def joined(pairs: Sequence[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """Return the pairs of several lists as one."""
    some = [pair for pair in pairs if pair[0].size]
    if not some:
        return NOBODY
    return np.concatenate([pair[0] for pair in some]), np.concatenate([pair[1] for pair in some])


def meeting_groups(el: Elements, collisions: PairList, radius: Floats, p: KernelParameters) -> Ints:
    """Number the groups of bergs that are in reach of each other, directly or by way of others.

    ``radius``: of the elements, m.
    """
    if (el.body.berg == el.body.berg[:1]).all():
        return np.zeros(0, np.int64)
    numbers, berg = numbered(el.body.berg)
    shown = el.shown
    near = _in_reach(shown.lon_pair, shown.lat_pair, radius, collisions, p)
    owner = np.repeat(np.arange(el.size), np.diff(collisions.start))[near]
    one, other = berg[owner], berg[collisions.partner[near]]
    return connected_parts(numbers.size, one, other, np.zeros(one.size, np.int64))[berg]


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
