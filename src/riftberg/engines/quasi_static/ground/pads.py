"""Pads: the footprints of fragments, cut by squares that are fixed in the ice, with the floor asked at their corners and middles.

They hang on elements, bonds and outline alone, so that a restarted run has the same; where the berg lies, and how deep, changes
with every step. Melt of the sides moves their corners towards the middle of each element.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.constants import DEGREE
from riftberg.engines.common.bed import Bed
from riftberg.engines.quasi_static.lattice.crack_cuts import area_and_centroid
from riftberg.engines.quasi_static.lattice.footprints import BodyFootprint
from riftberg.physics.elementary import atan2, exp2, log2
from riftberg.physics.seabed import SIDES_PER_LAMBDA, WATER_STIFFNESS, add_moments, bending_length, cut
from riftberg.state import Floats, Ints

CLEAR: Final = 2.0
"""Water (m) under a keel beyond which the floor is not asked for in sub-steps."""

RUNGS: Final = 8.0
"""Sides of pads grow by this root of 2 from one to the next, so that melt changes them seldom."""

CORNERS: Final = 64
"""Room for the corners of a polygon beside those that it has."""

SNAP: Final = 1e-12
"""Part of a pad by which round-off takes corners from its sides."""

SHORT: Final = 0.25 * math.pi
"""Length of a fragment over ``lambda`` up to which it does not bend (Hetenyi's short beams)."""

RIGID: Final = 1e40
"""Stiffness against tilt (N m) of a fragment that takes none."""


class Pads(NamedTuple):
    """Pads of some fragments; coordinates (m) from the centroid of the footprint of each, along its axes."""

    rows: Ints  # Elements, one fragment after the other
    row_start: Ints  # Where those of each fragment begin; shape (fragments + 1,)
    element: Floats  # Places of the elements; shape (rows, 2)
    moments: Floats  # Area of each element, its moments by x and y, second moments xx, xy, yy; shape (rows, 6)

    origin: Floats  # Centroid of each footprint in its fragment; shape (fragments, 2)
    side: Floats  # Of its pads, m; shape (fragments,)
    low: Floats  # Where its squares begin; shape (fragments, 2)
    shape: Ints  # How many rows and columns there are; shape (fragments, 2)
    square_start: Ints  # Where they begin in ``ice``; shape (fragments,)
    # Of each square: area (m2), centroid and variances xx, xy, yy (m2) of the ice in it; shape (squares, 6)
    ice: Floats

    polygon_start: Ints  # Where the polygons of each fragment begin; shape (fragments + 1,)
    owner: Ints  # Place in ``rows`` of the element of each polygon
    square: Ints  # Row and column of its square; shape (polygons, 2)
    centre: Floats  # Its centroid; shape (polygons, 2)
    radius: Floats  # Of its farthest corner from there; shape (polygons,)
    start: Ints  # Where its corners begin; shape (polygons + 1,)
    corner: Floats  # shape (corners, 2)


@kernel
def choose_pad_sides(modulus: float, poisson: float, thickness: Floats) -> Floats:
    """Sides of the pads (m) of fragments of some thickness (m): a part of ``lambda``, rounded down to one of a few."""
    side = np.empty(thickness.size)
    for b in range(side.size):
        target = math.sqrt(2.0) * bending_length(modulus, poisson, thickness[b]) / SIDES_PER_LAMBDA
        side[b] = exp2(math.floor(RUNGS * log2(target)) / RUNGS)
    return side


@kernel
def _reach_strips(points: Floats, size: int, column: int, low: float, side: float, strips: int) -> tuple[int, int]:
    """The first of the strips into which points reach, and the one behind the last."""
    least, largest = math.inf, -math.inf
    for n in range(size):
        least, largest = min(least, points[n, column]), max(largest, points[n, column])
    return max(math.floor((least - low) / side), 0), min(math.floor((largest - low) / side) + 1, strips)


@kernel
def _cut_strip(polygon: Floats, size: int, column: int, low: float, high: float, room: Floats, out: Floats) -> int:
    """Cut a polygon to where a coordinate lies between two values; returns the corners that are left."""
    count = int(cut(room, cut(polygon, size, column, low, 1.0, room), column, high, -1.0, out))
    for n in range(count):  # corners on the lines stand there to the last digit, as those of the polygons beside
        if out[n, column] - low < SNAP * (high - low):
            out[n, column] = low
        elif high - out[n, column] < SNAP * (high - low):
            out[n, column] = high
    return count


@borrower
def _find_whole_columns(band: Floats, size: int, bottom: float, top: float, low: float, side: float) -> tuple[int, int]:
    """The first of the squares between two lines that a polygon cut by these covers as a whole, and the one behind the last.

    All edges that run down lie west of them and all that run up east of them; those along the lines do not count.
    """
    west, east = -math.inf, math.inf
    for n in range(size):
        o = n + 1 if n + 1 < size else 0
        rise, level = band[o, 1] - band[n, 1], band[n, 1]
        if rise == 0.0 and level in (bottom, top):
            continue
        if rise <= 0.0:
            west = max(west, band[n, 0], band[o, 0])
        if rise >= 0.0:
            east = min(east, band[n, 0], band[o, 0])
    if not west < east < math.inf:
        return 0, 0
    return math.ceil((west - low) / side), math.floor((east - low) / side)


@kernel
def _find_extents(fragment: Ints, start: Ints, corner: Floats, origin: Floats, low: Floats, high: Floats) -> None:
    """Find the centroids of fragments from their polygons, and how far these reach from them."""
    total = np.zeros(len(origin))
    for k in range(fragment.size):
        b, (area, x, y) = fragment[k], area_and_centroid(corner, start[k], start[k + 1])
        total[b] += area
        origin[b, 0] += area * x
        origin[b, 1] += area * y
    for b in range(len(origin)):
        for i in range(2):
            origin[b, i] /= total[b]
            low[b, i], high[b, i] = math.inf, -math.inf
    for k in range(fragment.size):
        b = fragment[k]
        for n in range(start[k], start[k + 1]):
            for i in range(2):
                low[b, i] = min(low[b, i], corner[n, i] - origin[b, i])
                high[b, i] = max(high[b, i], corner[n, i] - origin[b, i])


@kernel
def _lengthen(corners: Floats, size: int) -> Floats:
    """Return a list of corners with more room."""
    out = np.empty((size, 2))
    for n in range(len(corners)):
        out[n, 0], out[n, 1] = corners[n, 0], corners[n, 1]
    return out


# Many arguments: the polygons come as flat lists, without an object for each.
@kernel
def _cut_by_squares(
    order: Ints, first: Ints, start: Ints, corner: Floats, most: int, origin: Floats, side: Floats, low: Floats, shape: Ints,
    piece_start: Ints, polygons: Ints, square: Ints, corner_start: Ints,
) -> Floats:  # fmt: skip
    """Cut polygons, in ``order`` and of each fragment from ``first`` on, by the squares; ``most``: room for corners of one.

    Returns the corners of all pieces. Fills where the pieces of each fragment begin, and of each piece the polygon, row and
    column of its square, and where its corners begin.
    """
    polygon, band, room, piece = np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2))
    count, corners = 0, np.empty((5 * polygons.size + most, 2))  # most pieces are squares
    corner_start[0] = piece_start[0] = 0
    for b in range(first.size - 1):
        for at in range(first[b], first[b + 1]):
            k = order[at]
            size = start[k + 1] - start[k]
            for n in range(size):
                polygon[n, 0] = corner[start[k] + n, 0] - origin[b, 0]
                polygon[n, 1] = corner[start[k] + n, 1] - origin[b, 1]
            lowest, end = _reach_strips(polygon, size, 1, low[b, 1], side[b], shape[b, 0])
            for j in range(lowest, end):
                y = low[b, 1] + j * side[b], low[b, 1] + (j + 1) * side[b]
                band_size = _cut_strip(polygon, size, 1, y[0], y[1], room, band)
                if band_size < 3:
                    continue
                leftmost, end_column = _reach_strips(band, band_size, 0, low[b, 0], side[b], shape[b, 1])
                whole, end_whole = _find_whole_columns(band, band_size, y[0], y[1], low[b, 0], side[b])
                for i in range(leftmost, end_column):
                    x = low[b, 0] + i * side[b], low[b, 0] + (i + 1) * side[b]
                    if whole <= i < end_whole:
                        piece_size = 4
                        piece[0, 0], piece[1, 0], piece[2, 0], piece[3, 0] = x[0], x[1], x[1], x[0]
                        piece[0, 1], piece[1, 1], piece[2, 1], piece[3, 1] = y[0], y[0], y[1], y[1]
                    else:
                        piece_size = _cut_strip(band, band_size, 0, x[0], x[1], room, piece)
                    # Round-off leaves slivers along the lines of the raster.
                    if piece_size < 3 or area_and_centroid(piece, 0, piece_size)[0] < 1e-9 * side[b] * side[b]:
                        continue
                    end_corner = corner_start[count] + piece_size
                    if end_corner > len(corners):
                        corners = _lengthen(corners, 2 * end_corner)
                    for n in range(piece_size):
                        c = corner_start[count] + n
                        corners[c, 0], corners[c, 1] = piece[n, 0], piece[n, 1]
                    polygons[count], square[count, 0], square[count, 1] = k, j, i
                    count += 1
                    corner_start[count] = end_corner
        piece_start[b + 1] = count
    return corners


@kernel
def _sum_up_ice(pads: Pads, most: int) -> None:
    """Find the centroids of polygons, the ice of each square, and the moments of each element; ``most``: room for corners."""
    ice, room, sums = pads.ice, np.ones((most, 3)), np.zeros(10)
    for b in range(pads.side.size):
        full = pads.side[b] * pads.side[b]
        for k in range(pads.polygon_start[b], pads.polygon_start[b + 1]):
            first, size = pads.start[k], pads.start[k + 1] - pads.start[k]
            area, x, y = area_and_centroid(pads.corner, first, first + size)
            s = pads.square_start[b] + pads.square[k, 0] * pads.shape[b, 1] + pads.square[k, 1]
            pads.centre[k, 0], pads.centre[k, 1] = x, y
            if area > (1.0 - SNAP) * full:  # most are whole squares
                pads.radius[k] = math.sqrt(0.5 * full)
                xx, xy, yy = area * (x * x + full / 12.0), area * x * y, area * (y * y + full / 12.0)
            else:
                for n in range(size):
                    room[n, 0], room[n, 1] = pads.corner[first + n, 0], pads.corner[first + n, 1]
                    pads.radius[k] = max(pads.radius[k], math.hypot(room[n, 0] - x, room[n, 1] - y))
                sums[:] = 0.0
                add_moments(room, size, 0.0, 1.0, sums)
                xx, xy, yy = sums[6], sums[7], sums[8]
            for moments in (ice[s], pads.moments[pads.owner[k]]):
                moments[0] += area
                moments[1] += area * x
                moments[2] += area * y
                moments[3] += xx
                moments[4] += xy
                moments[5] += yy
    for s in range(len(ice)):
        if ice[s, 0] > 0.0:
            for n in range(1, 6):
                ice[s, n] /= ice[s, 0]
            ice[s, 3] -= ice[s, 1] * ice[s, 1]
            ice[s, 4] -= ice[s, 1] * ice[s, 2]
            ice[s, 5] -= ice[s, 2] * ice[s, 2]


def cut_into_pads(footprint: BodyFootprint, body: Ints, xy: Floats, side: Floats) -> Pads:
    """Cut the footprints of fragments into pads.

    ``body``: fragment of each of the elements ``footprint.rows``, which come one fragment after the other; ``xy``: their places
    in it (m); ``side``: of the pads of each fragment, m.
    """
    start, corner, fragment = footprint.start, footprint.corner, body[footprint.owner]
    order, numbers = np.argsort(fragment, kind="stable"), np.arange(side.size + 1)
    origin, low, high = np.zeros((3, side.size, 2))
    _find_extents(fragment, start, corner, origin, low, high)
    low -= 0.25 * side[:, None]  # a berg that is smaller than a pad lies in one square
    shape = np.floor((high - low) / side[:, None]).astype(np.int64)[:, ::-1] + 1
    square_start = np.concatenate([[0], np.cumsum(shape.prod(axis=1))])
    most, first = 2 * int(np.diff(start).max()) + CORNERS, np.searchsorted(fragment[order], numbers)
    # Each polygon gives a piece at most in each square that its bounds reach.
    extent = np.maximum.reduceat(corner, start[:-1]) - np.minimum.reduceat(corner, start[:-1])
    pieces = int((np.floor(extent / side[fragment, None]) + 2.0).prod(axis=1).sum())
    polygon_start, polygon = np.empty(side.size + 1, np.int64), np.empty(pieces, np.int64)
    square, corner_start = np.empty((pieces, 2), np.int64), np.empty(pieces + 1, np.int64)
    corners = _cut_by_squares(
        order, first, start, corner, most, origin, side, low, shape, polygon_start, polygon, square, corner_start
    )
    count = polygon_start[-1]
    pads = Pads(
        rows=footprint.rows, row_start=np.searchsorted(body, numbers), element=xy - origin[body],
        moments=np.zeros((body.size, 6)), origin=origin, side=side, low=low, shape=shape, square_start=square_start[:-1],
        ice=np.zeros((square_start[-1], 6)), polygon_start=polygon_start,
        owner=footprint.owner[polygon[:count]], square=square[:count], centre=np.empty((count, 2)), radius=np.zeros(count),
        start=corner_start[: count + 1], corner=corners[: corner_start[count]],
    )  # fmt: skip
    _sum_up_ice(pads, most)
    return pads


def melt_pads(pads: Pads, fraction: Floats) -> Pads:
    """Return pads whose elements (``pads.rows``) have melted to a part of their width."""
    if (fraction == 1.0).all():
        return pads
    corner_owner = np.repeat(pads.owner, np.diff(pads.start))

    def shrunk(points: Floats, owner: Ints) -> Any:
        return pads.element[owner] + (points - pads.element[owner]) * fraction[owner, None]

    moments = pads.moments * fraction[:, None] ** 2
    return pads._replace(
        corner=shrunk(pads.corner, corner_owner),
        centre=shrunk(pads.centre, pads.owner),
        moments=moments,
        radius=pads.radius * fraction[pads.owner],
    )


@kernel
def measure_ice_share(pads: Pads, b: int, x: float, y: float, reach: float) -> float:
    """Part of the surroundings of a point, within ``reach`` m, that is ice, for `riftberg.physics.seabed.bending_stress`."""
    side, total = pads.side[b], 0.0
    row, column = math.floor((y - pads.low[b, 1]) / side), math.floor((x - pads.low[b, 0]) / side)
    n, rows, columns = int(reach / side) + 2, pads.shape[b, 0], pads.shape[b, 1]
    for j in range(max(row - n, 0), min(row + n + 1, rows)):
        for i in range(max(column - n, 0), min(column + n + 1, columns)):
            s = pads.square_start[b] + j * columns + i
            if pads.ice[s, 0] > 0.0:
                r = ((pads.ice[s, 1] - x) ** 2 + (pads.ice[s, 2] - y) ** 2) / (reach * reach)
                if r < 1.0:
                    total += pads.ice[s, 0] * (1.0 - r) ** 2
    return total / (math.pi * reach * reach / 3.0)


@kernel
def fill_hulls(
    pads: Pads, thickness: Floats, draft: Floats, bed: Bed, hull: Floats, mean: Floats, length: Floats
) -> None:  # fmt: skip
    """Find the stiffness (3, 3) of each fragment afloat against heave and both tilts, its mean thickness and bending length (m).

    ``thickness``: of all elements, ``draft``: of the elements ``pads.rows``, m. Pieces that are narrower than their thickness, or
    nearly unstable, take no tilt, and these and short ones do not bend (length 0).
    """
    for b in range(mean.size):
        sums, lean, ice = np.zeros(6), 0.0, 0.0
        for e in range(pads.row_start[b], pads.row_start[b + 1]):
            for n in range(6):
                sums[n] += pads.moments[e, n]
            # Distance of the centres of mass and of buoyancy, by the volume of water.
            thick = thickness[pads.rows[e]]
            lean += pads.moments[e, 0] * draft[e] * 0.5 * (thick - draft[e])
            ice += pads.moments[e, 0] * thick
        area, mean[b] = sums[0], ice / sums[0]
        # Melted pads lie a little aside of the centroid of the whole ones.
        xx, xy, yy = sums[3] - sums[1] ** 2 / area, sums[4] - sums[1] * sums[2] / area, sums[5] - sums[2] ** 2 / area
        least = 0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        hull[b, :, :] = 0.0
        hull[b, 0, 0], hull[b, 1, 1], hull[b, 2, 2], length[b] = WATER_STIFFNESS * area, RIGID, RIGID, 0.0
        if 12.0 * least / area >= mean[b] ** 2 and least - lean > 0.5 * least:
            hull[b, 1, 1], hull[b, 2, 2] = WATER_STIFFNESS * (yy - lean), WATER_STIFFNESS * (xx - lean)
            hull[b, 1, 2] = hull[b, 2, 1] = -WATER_STIFFNESS * xy
            extent = pads.side[b] * max(pads.shape[b, 0], pads.shape[b, 1])
            bending = bending_length(bed.modulus, bed.poisson, mean[b])
            if extent > SHORT * math.sqrt(2.0) * bending:
                length[b] = bending


@kernel
def place_points(
    x: float, y: float, pose: Floats, latlon: bool, radius: float
) -> tuple[float, float]:  # fmt: skip
    """Position (degrees, or m) of a point of a fragment, given on its tangent plane (m)."""
    if not latlon:
        return pose[0, 2] + pose[0, 0] * x + pose[0, 1] * y, pose[1, 2] + pose[1, 0] * x + pose[1, 1] * y
    s, t = 0.5 * x / radius, 0.5 * y / radius
    square = s * s + t * t
    k = 1.0 / (1.0 + square)
    u, v, w = 2.0 * s * k, 2.0 * t * k, (1.0 - square) * k
    east = pose[0, 0] * u + pose[0, 1] * v + pose[0, 2] * w
    north = pose[1, 0] * u + pose[1, 1] * v + pose[1, 2] * w
    up = pose[2, 0] * u + pose[2, 1] * v + pose[2, 2] * w
    return atan2(north, east) / DEGREE, atan2(up, math.sqrt(east * east + north * north)) / DEGREE
