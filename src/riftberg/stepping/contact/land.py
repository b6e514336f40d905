"""Land stops a berg as a whole, together with all that it would be pushed into (equations 8.1; Riftberg's own).

Land is looked for at the end of a long step. By then an element may have gone hundreds of metres too far, and goes back to a
twentieth of a cell inside the water. Taken for itself it is pulled out of the lattice that it is bonded to, or lands deep inside
the berg behind it. The springs of ice give that back as metres a second: 43 m s-1 for a berg that a current of 0.3 m s-1
carried ashore. So the way back is that of all ice that is in the way: nothing is strained, and nothing pushed into another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.ocean.cells import settle_elements
from riftberg.plane import unit_vectors
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import near_pairs
from riftberg.stepping.contact.broad_phase import NEWBORN_CHILD
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts

if TYPE_CHECKING:
    from riftberg.ocean.grid_arrays import GridArrays
    from riftberg.parameters import KernelParameters

STOPPED: Final = 1e-6
"""Way (m) from which on an element counts as stopped by land; less is round-off."""

DEEPER: Final = 1e-3
"""Way (m) that two bergs may be pushed into each other before the second one goes back too."""

PASSES: Final = 8
"""Ways back after each other, where one of them leads onto other land."""


def metric_of(c: KernelParameters) -> Metric:
    """Return how positions become metres."""
    return Metric(c.latlon, c.earth_radius, c.period)


def ways_back(el: Elements, lon: Floats, lat: Floats, c: KernelParameters) -> Floats:
    """Return how far (m east, m north) land has moved each element from the positions ``lon``, ``lat``."""
    changed = np.flatnonzero((el.lon != lon) | (el.lat != lat))
    back = np.zeros((el.size, 2))
    back[changed] = np.stack(
        separations(metric_of(c), el.lon[changed], el.lat[changed], lon[changed], lat[changed]), axis=-1
    )
    back[np.hypot(back[:, 0], back[:, 1]) < STOPPED] = 0.0
    return back


def leaders(el: Elements, lon: Floats, lat: Floats, back: Floats, part: Ints, c: KernelParameters) -> Ints:
    """Return for each part of the ice the element whose way back it shares; -1 for parts that stay.

    Of the elements of a part that with the longest way leads. Parts that this would push into each other, or farther into each
    other, go together.

    ``back``: see `ways_back` (shape (elements, 2)).
    """
    way = np.hypot(back[:, 0], back[:, 1])
    count = int(part.max()) + 1
    lead = _longest(way, part, count)
    first, second, reach = _neighbours(el, lon, lat, part, float(way.max()), c)
    if first.size == 0:
        return lead
    dx, dy = separations(metric_of(c), lon[first], lat[first], lon[second], lat[second])
    apart = np.minimum(np.hypot(dx, dy), reach)
    together = np.arange(count)
    while True:
        goes = np.where(lead[:, None] >= 0, back[lead], 0.0)[part]
        to = np.hypot(dx + goes[first, 0] - goes[second, 0], dy + goes[first, 1] - goes[second, 1])
        pushed = (to < apart - DEEPER) & (lead[part[first]] != lead[part[second]])
        if not pushed.any():
            return lead
        one, other = together[part[first[pushed]]], together[part[second[pushed]]]
        together = connected_parts(count, one, other, np.zeros(one.size, np.int64))[together]
        lead = _longest(way, together[part], count)[together]


def _longest(way: Floats, part: Ints, count: int) -> Ints:
    """Return the element of each part that goes farthest, -1 where none goes."""
    lead = np.full(count, -1, np.int64)
    gone = np.flatnonzero(way > 0.0)
    # The longest of each part comes last, and stays; of equal ones the first row.
    gone = gone[np.lexsort((-gone, way[gone]))]
    lead[part[gone]] = gone
    return lead


def _neighbours(
    el: Elements, lon: Floats, lat: Floats, part: Ints, farthest: float, c: KernelParameters
) -> tuple[Ints, Ints, Floats]:
    """Pairs of elements of different parts that a way of ``farthest`` metres may bring into contact, and its reach (m)."""
    none = np.zeros(0, np.int64)
    if not c.interactions or part.max() == 0 or farthest == 0.0:
        return none, none, np.zeros(0)
    radius = interaction_sizes(el, c).radius
    touching = np.maximum(radius, 0.5 * c.contact_distance)
    # Elements that are held do not go back, and a child of footloose calving lies on its parent until it has drifted off.
    some = np.flatnonzero((el.static < 0.5) & (el.life.fl_k != NEWBORN_CHILD))
    first, second = near_pairs(
        lon[some], lat[some], part[some], touching[some] + farthest, c.latlon, c.earth_radius, c.period
    )
    first, second = some[first], some[second]
    return first, second, np.maximum(radius[first] + radius[second], c.contact_distance)


def settle_bergs(el: Elements, bonds: Bonds, grid: GridArrays, c: KernelParameters) -> None:
    """Find the cells of all elements at the end of a step; where land stops one, its berg goes back with it.

    Velocities are untouched, as in the reference. An element that touches nothing is stopped as there.
    """
    part = None
    for _ in range(PASSES):
        lon, lat = el.lon.copy(), el.lat.copy()
        settle_elements(el, grid, c)
        back = ways_back(el, lon, lat, c)
        if not back.any() or not (c.interactions or c.bonds_on):
            return
        if part is None:
            part = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
        lead = leaders(el, lon, lat, back, part, c)[part]
        follows = np.flatnonzero((lead >= 0) & (lead != np.arange(el.size)) & (el.static < 0.5))
        if follows.size == 0:
            return
        _go_along(el, lon, lat, follows, lead[follows], c)


def _go_along(el: Elements, lon: Floats, lat: Floats, rows: Ints, lead: Ints, c: KernelParameters) -> None:
    """Move elements from ``lon``, ``lat`` as land has moved those that lead them."""
    if not c.latlon:
        x, y = lon[rows] + _nearest(el.lon[lead] - lon[lead], c.period), lat[rows] + (el.lat[lead] - lat[lead])
    else:
        start, end = unit_vectors(lon[lead], lat[lead]), unit_vectors(el.lon[lead], el.lat[lead])
        to = turned_along(start, end, unit_vectors(lon[rows], lat[rows]))
        x, y = (
            np.degrees(np.arctan2(to[:, 1], to[:, 0])),
            np.degrees(np.arctan2(to[:, 2], np.hypot(to[:, 0], to[:, 1]))),
        )
    # On the branch of the cell in which it stands.
    el.lon[rows], el.lat[rows] = el.lon[rows] + _nearest(x - el.lon[rows], c.period), y


def turned_along(start: Floats, end: Floats, points: Floats) -> Floats:
    """Turn vectors by the rotations of the sphere that carry ``start`` along a great circle to ``end`` (Rodrigues)."""
    axis, cosine = np.cross(start, end), np.sum(start * end, axis=-1, keepdims=True)
    along = np.sum(axis * points, axis=-1, keepdims=True)
    return np.asarray(cosine * points + np.cross(axis, points) + axis * along / (1.0 + cosine))


def led(pose: Floats, el: Elements, lon: Floats, lat: Floats, lead: Ints, c: KernelParameters) -> Floats:
    """Frames of bodies (`riftberg.stepping.bodies.pose`) after each has gone as land moved its leader from ``lon``, ``lat``."""
    new, some = pose.copy(), np.flatnonzero(lead >= 0)
    e = lead[some]
    if not c.latlon:
        new[some, 0, 2] += _nearest(el.lon[e] - lon[e], c.period)
        new[some, 1, 2] += el.lat[e] - lat[e]
        return new
    start, end = unit_vectors(lon[e], lat[e]), unit_vectors(el.lon[e], el.lat[e])
    for k in range(3):
        new[some, :, k] = turned_along(start, end, pose[some, :, k])
    return new


def _nearest(difference: Floats, period: float) -> Floats:
    """Bring differences of longitudes to their nearest image."""
    return difference - period * np.round(difference / period) if period > 0.0 else difference
