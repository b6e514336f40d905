"""The outlines of fragments as points with normals, at which the water drags on their sides.

The outline of a fragment encloses the footprints of its elements. A crack runs between footprints, in steps where it crosses
the lattice; `SMOOTHING` makes it a line, for pressure knows the way of a side and not the steps of its cells. Each element bears
the force on the stretch of outline that is nearest to its centre, at two points of Gauss's rule: the integral over a straight
side of (normal speed)^2 and of its lever is exact as long as the speed keeps its sign.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import shapely
from scipy.spatial import cKDTree

from riftberg.bergs.seams import join_polygons, join_tiles
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.lattice.footprints import MOST_GROUPS, FootprintBook, Footprints, body_footprint
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import find_rows

SMOOTHING: Final = 0.95
"""Detail of an outline, in distances of elements, that is left out: the steps of a lattice are as high as one at most."""

SHARE_OF_SIZE: Final = 0.25
"""And in parts of the root of the area of the fragment: pieces of a few elements keep their corners."""

SEAM: Final = 1e-3
"""Gaps between footprints that count as none, in distances of elements."""

MOST_FRAGMENTS: Final = 10_000
"""Outlines that are remembered: some kB each."""


class FragmentSides:
    """The outlines of the bonded fragments under a run."""

    def __init__(self, footprints: FootprintBook) -> None:
        self._footprints = footprints
        self._fragments: dict[tuple[bytes, ...], tuple[Ints, Floats]] = {}
        # Of the groups that a population is stepped in. Their keys are compared, which is quicker than to hash them.
        self._latest: list[tuple[tuple[int, bytes, bytes, bytes], Floats]] = []

    def find(self, model: RunState, body: Ints, xy: Floats) -> Floats:
        """Return the points of all elements as `riftberg.engines.quasi_static.bodies.dynamics.ElementForcing` has them.

        ``body``: fragment of each element; ``xy``: where they stand in it without load, m.
        """
        el = model.elements
        # A piece that a crack has divided has the elements that it had, and another outline.
        key = self._footprints.divided, el.body.id.tobytes(), body.tobytes(), xy.tobytes()
        for latest_key, sides in self._latest:
            if latest_key == key:
                return sides
        sides = self._find_sides(model, body, xy)
        self._latest = [*self._latest[1 - MOST_GROUPS :], (key, sides)]
        return sides

    def _find_sides(self, model: RunState, body: Ints, xy: Floats) -> Floats:
        """Find the points, of fragments that are new alone."""
        el = model.elements
        bonded = np.flatnonzero(np.bincount(body)[body] > 1)
        if not bonded.size:
            return np.zeros((el.size, 0, 4))
        order = bonded[np.argsort(body[bonded], kind="stable")]
        footprints = self._footprints.follow(model)
        row = find_rows(footprints.element, el.body.id)[0]
        bounds = footprints.start[np.searchsorted(footprints.owner, [row, row + 1])]
        owners, points = [], []
        if len(self._fragments) > MOST_FRAGMENTS:
            self._fragments.clear()
        for rows in np.split(order, np.flatnonzero(np.diff(body[order])) + 1):
            first, number = bounds[0, rows], bounds[1, rows] - bounds[0, rows]
            corners = np.arange(number.sum()) + np.repeat(first - np.cumsum(number) + number, number)
            key = el.body.id[rows].tobytes(), xy[rows].tobytes(), footprints.corner[corners].tobytes()
            fragment = self._fragments.get(key) or _find_points(footprints, el, rows, row[rows], xy)
            self._fragments[key] = fragment
            owners.append(rows[fragment[0]])
            points.append(fragment[1])
        owner, point = np.concatenate(owners), np.vstack(points)
        order = np.argsort(owner, kind="stable")
        owner, point, number = owner[order], point[order], np.bincount(owner, minlength=el.size)
        sides = np.zeros((el.size, int(number.max()), 4))
        sides[owner, np.arange(owner.size) - np.repeat(np.cumsum(number) - number, number)] = point
        return sides


def _find_points(
    footprints: Footprints, el: Elements, rows: Ints, footprint_rows: Ints, xy: Floats
) -> tuple[Ints, Floats]:  # fmt: skip
    """Points on the outline of one fragment, and of which of its elements they are."""
    size = np.sqrt(footprints.size[footprint_rows])
    spacing = float(size.mean())
    ends = []
    ice = _union(body_footprint(footprints, el, rows, xy, shrinks=False), spacing)
    for ring in _outlines(ice, spacing):
        corner = np.asarray(shapely.segmentize(ring, 1.001 * spacing).coords)[:, :2]
        ends.append(np.stack([corner[:-1], corner[1:]], axis=1))
    start, along = np.concatenate(ends)[:, 0], np.diff(np.concatenate(ends), axis=1)[:, 0]
    length, centre = np.hypot(*along.T), xy[rows]
    owner = np.asarray(cKDTree(centre).query(start + 0.5 * along)[1], np.int64)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]  # the ice lies on the left
    # Elements are equal, their footprints are not: their centre is moved to that of the ice, or a current would turn it.
    middle = np.average(centre, axis=0, weights=size**2) - np.array(ice.centroid.coords[0])
    points = []
    for fraction in (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)):
        offset = start + middle + fraction * along - centre[owner]
        arm = offset[:, 0] * normal[:, 1] - offset[:, 1] * normal[:, 0]
        points.append(np.column_stack([normal, arm, 0.5 * length / size[owner]]))
    return np.tile(owner, 2), np.vstack(points)


def _union(footprint: Any, spacing: float) -> Any:
    """Ice (shapely) of a fragment, along its axes (m)."""
    polygon = np.repeat(np.arange(footprint.start.size - 1), np.diff(footprint.start) + 1)
    corner = np.insert(footprint.corner, footprint.start[1:], footprint.corner[footprint.start[:-1]], axis=0)
    if (ice := join_tiles(corner, polygon, SEAM * spacing)) is not None:
        return ice
    return join_polygons(shapely.polygons(shapely.linearrings(corner, indices=polygon)), SEAM * spacing)


def _outlines(ice: Any, spacing: float) -> list[Any]:
    """Return the outer rings (shapely, counter-clockwise) of a fragment without the steps of its lattice."""
    detail = min(SMOOTHING * spacing, SHARE_OF_SIZE * math.sqrt(ice.area))
    rings = []
    for polygon in shapely.get_parts(shapely.orient_polygons(ice)):
        corner, middle = np.asarray(polygon.exterior.coords)[:-1, :2], np.array(polygon.centroid.coords[0])
        # The first point of a ring stays: that farthest out is a corner, and not one within a side.
        corner = np.roll(corner, -int(np.argmax(np.hypot(*(corner - middle).T))), axis=0)
        rings += [simple.exterior for simple in shapely.get_parts(shapely.simplify(shapely.Polygon(corner), detail))]
    return [ring for ring in rings if not ring.is_empty]
