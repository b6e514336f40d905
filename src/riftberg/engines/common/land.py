"""Constraint of land: it stops a berg as a whole, together with all ice in its way (equations 8.1; Riftberg's own).

Land is looked for at the end of a step. By then an element may have gone hundreds of metres too far, and is put back to the
shore. Put back alone it would be pulled out of its lattice, or end deep inside the berg behind it, and the springs of ice
would return that as metres a second: 43 m s-1 for a berg that a current of 0.3 m s-1 carried ashore. So the same correction
moves all ice that is in the way: nothing is strained, and nothing pushed into another. All of it loses the velocity into the
land at which it arrived.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.engines.common.broad_phase import NEWBORN_CHILD, NO_PAIRS
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.ocean.cells import settle_elements
from riftberg.physics.elementary import atan2_array
from riftberg.plane import unit_vectors
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import near_pairs

if TYPE_CHECKING:
    from riftberg.ocean.cells import GridArrays
    from riftberg.parameters import KernelParameters

MIN_CORRECTION: Final = 1e-6
"""Correction (m) from which on an element counts as stopped by land; less is round-off."""

MAX_OVERLAP_GROWTH: Final = 1e-3
"""Distance (m) by which a correction may push two bergs into each other before it moves the second one too."""

MAX_PASSES: Final = 8
"""Corrections in a row, where one of them leads onto other land."""


def kernel_metric(c: KernelParameters) -> Metric:
    """Return how positions become metres."""
    return Metric(c.latlon, c.earth_radius, c.period)


def land_corrections(el: Elements, lon: Floats, lat: Floats, c: KernelParameters) -> Floats:
    """Return how far (m east, m north) land has moved each element from the positions ``lon``, ``lat``."""
    changed = np.flatnonzero((el.lon != lon) | (el.lat != lat))
    correction = np.zeros((el.size, 2))
    correction[changed] = np.stack(
        separations(kernel_metric(c), el.lon[changed], el.lat[changed], lon[changed], lat[changed]), axis=-1
    )
    correction[np.hypot(correction[:, 0], correction[:, 1]) < MIN_CORRECTION] = 0.0
    return correction


class NearPairs(NamedTuple):
    """Elements of different bergs that are near each other."""

    first: Ints
    second: Ints
    gap: Floats  # Between their edges, m; below 0 where they overlap
    normal: Floats  # Across the gap, from the first to the second; shape (pairs, 2)


FindNear = Callable[[float], NearPairs]
"""Finds the pairs whose edges are no farther from each other than some metres, by the law of contact of the run."""


def leading_elements(correction: Floats, component: Ints, find_near: FindNear) -> Ints:
    """Return for each part of the ice the element whose correction it shares; -1 for parts that stay.

    It is the largest correction of the elements of a part. Parts that this would push into each other, or farther into each
    other, move together.
    """
    distance = np.hypot(correction[:, 0], correction[:, 1])
    count = int(component.max()) + 1
    leader = _largest_correction(distance, component, count)
    if count == 1:
        return leader
    first, second, gap, normal = find_near(2.0 * float(distance.max()))
    cluster, room = np.arange(count), np.maximum(gap, 0.0) + MAX_OVERLAP_GROWTH
    while True:
        shift = np.where(leader[:, None] >= 0, correction[leader], 0.0)[component]
        closed = np.sum((shift[first] - shift[second]) * normal, axis=1)
        pushed = (closed > room) & (leader[component[first]] != leader[component[second]])
        if not pushed.any():
            return leader
        pushing, pushed_into = cluster[component[first[pushed]]], cluster[component[second[pushed]]]
        cluster = connected_parts(count, pushing, pushed_into, np.zeros(pushing.size, np.int64))[cluster]
        leader = _largest_correction(distance, cluster[component], count)[cluster]


def _largest_correction(distance: Floats, component: Ints, count: int) -> Ints:
    """Return the element of each part with the largest correction, -1 where none has one."""
    leader = np.full(count, -1, np.int64)
    moving = np.flatnonzero(distance > 0.0)
    # The longest of each part comes last, and stays; of equal ones the first row.
    moving = moving[np.lexsort((-moving, distance[moving]))]
    leader[component[moving]] = moving
    return leader


def find_near_circles(
    el: Elements, lon: Floats, lat: Floats, component: Ints, c: KernelParameters, within: float
) -> NearPairs:
    """Find near pairs of different parts, at ``lon``, ``lat``, by the circles that the springs of contact act between."""
    if not c.interactions:
        return NearPairs(*NO_PAIRS, np.zeros(0), np.zeros((0, 2)))
    radius = interaction_sizes(el, c).radius
    touching = np.maximum(radius, 0.5 * c.contact_distance)
    free = movable(el)
    reach = touching[free] + 0.5 * within
    first, second = near_pairs(lon[free], lat[free], component[free], reach, c.latlon, c.earth_radius, c.period)
    first, second = free[first], free[second]
    offset = np.stack(separations(kernel_metric(c), lon[second], lat[second], lon[first], lat[first]), axis=-1)
    distance = np.hypot(offset[:, 0], offset[:, 1])
    gap = distance - np.maximum(radius[first] + radius[second], c.contact_distance)
    return NearPairs(first, second, gap, offset / np.where(distance > 0.0, distance, 1.0)[:, None])


def movable(el: Elements) -> Ints:
    """Elements that others may push: not static ones, nor a child of footloose calving, which lies on its parent at first."""
    return np.flatnonzero((el.static < 0.5) & (el.life.fl_k != NEWBORN_CHILD))


def apply_land_constraint(el: Elements, bonds: Bonds, grid: GridArrays, c: KernelParameters) -> None:
    """Find the cells of all elements at the end of a step; where land stops one, its berg is stopped and put back with it."""
    component = None
    for _ in range(MAX_PASSES):
        lon, lat = el.lon.copy(), el.lat.copy()
        settle_elements(el, grid, c)
        correction = land_corrections(el, lon, lat, c)
        if not correction.any():
            return
        if component is None:
            component = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
        leader = leading_elements(correction, component, partial(find_near_circles, el, lon, lat, component, c))[
            component
        ]
        moved = np.flatnonzero((leader >= 0) & (el.static < 0.5))
        # The mean over all that moves together: what bonds oscillate by is no motion into the land, and would be taken from all
        # in one direction alone.
        group, mass = leader[moved], el.mass[moved]
        of_group = np.bincount(group, mass, el.size)[group]
        for u, v in ((el.u, el.v), (el.u_sync, el.v_sync)):
            mean_u, mean_v = (np.bincount(group, mass * w[moved], el.size)[group] / of_group for w in (u, v))
            u[moved], v[moved] = stopped_by_land(u[moved], v[moved], mean_u, mean_v, correction[group])
        followers = moved[leader[moved] != moved]
        if followers.size == 0:
            return
        _apply_correction(el, lon, lat, followers, leader[followers], c)


def stopped_by_land(
    u: Floats, v: Floats, u_ashore: Floats, v_ashore: Floats, correction: Floats
) -> tuple[Floats, Floats]:
    """Return velocities less the part of that of the ice ashore that goes into the land, against its correction."""
    out = correction / np.hypot(correction[:, :1], correction[:, 1:])
    into = np.minimum(u_ashore * out[:, 0] + v_ashore * out[:, 1], 0.0)
    return u - into * out[:, 0], v - into * out[:, 1]


def _apply_correction(el: Elements, lon: Floats, lat: Floats, rows: Ints, leader: Ints, c: KernelParameters) -> None:
    """Move elements from ``lon``, ``lat`` as land has moved their leading elements."""
    if not c.latlon:
        x, y = lon[rows] + _nearest(el.lon[leader] - lon[leader], c.period), lat[rows] + (el.lat[leader] - lat[leader])
    else:
        start, end = unit_vectors(lon[leader], lat[leader]), unit_vectors(el.lon[leader], el.lat[leader])
        to = rotate_along(start, end, unit_vectors(lon[rows], lat[rows]))
        x, y = (
            np.degrees(atan2_array(to[:, 1], to[:, 0])),
            np.degrees(atan2_array(to[:, 2], np.hypot(to[:, 0], to[:, 1]))),
        )
    # On the branch of the cell in which it stands.
    el.lon[rows], el.lat[rows] = el.lon[rows] + _nearest(x - el.lon[rows], c.period), y


def rotate_along(start: Floats, end: Floats, points: Floats) -> Floats:
    """Rotate vectors as the sphere turns that carries ``start`` along a great circle to ``end`` (Rodrigues)."""
    axis, cosine = np.cross(start, end), np.sum(start * end, axis=-1, keepdims=True)
    along = np.sum(axis * points, axis=-1, keepdims=True)
    return np.asarray(cosine * points + np.cross(axis, points) + axis * along / (1.0 + cosine))


def corrected_poses(pose: Floats, el: Elements, lon: Floats, lat: Floats, leader: Ints, c: KernelParameters) -> Floats:
    """Poses of bodies after each has moved as land moved its leading element from ``lon``, ``lat``."""
    new, moved = pose.copy(), np.flatnonzero(leader >= 0)
    e = leader[moved]
    if not c.latlon:
        new[moved, 0, 2] += _nearest(el.lon[e] - lon[e], c.period)
        new[moved, 1, 2] += el.lat[e] - lat[e]
        return new
    start, end = unit_vectors(lon[e], lat[e]), unit_vectors(el.lon[e], el.lat[e])
    for k in range(3):
        new[moved, :, k] = rotate_along(start, end, pose[moved, :, k])
    return new


def _nearest(difference: Floats, period: float) -> Floats:
    """Bring differences of longitudes to their nearest image."""
    return difference - period * np.round(difference / period) if period > 0.0 else difference
