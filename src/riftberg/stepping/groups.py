"""Groups of bergs that can meet: only within a group may one result depend on another (own numerics)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.stepping.conglomerates import connected_parts


def meeting_groups(el: Elements, collisions: PairList, radius: Floats, p: KernelParameters) -> Ints:
    """Number the groups of bergs that are in reach of each other, directly or by way of others.

    Parameters
    ----------
    el : Elements
    collisions : PairList
        Partners of other bergs, in reach or farther away: how far was searched may depend on bergs elsewhere.
    radius : array of float
        Of the elements, m.
    p : KernelParameters

    Returns
    -------
    array of int
        Group of each element, 0 ...; empty where all belong to one.
    """
    if (el.body.berg == el.body.berg[:1]).all():
        return np.zeros(0, np.int64)
    numbers, berg = np.unique(el.body.berg, return_inverse=True)
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
