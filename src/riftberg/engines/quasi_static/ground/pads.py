"""Pads: the footprints of fragments, cut by squares that are fixed in the ice, with the floor asked at their corners and middles.

They hang on elements, bonds and outline alone, so that a restarted run has the same; where the berg lies, and how deep, changes
with every step. Melt of the sides moves their corners towards the middle of each element.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.engines.quasi_static.lattice.footprints import BodyFootprint
from riftberg.physics.seabed import SIDES_PER_LAMBDA, WATER_STIFFNESS, add_moments, bending_length, cut
from riftberg.state import Floats, Ints

RUNGS: Final = 8.0
"""Sides of pads grow by this root of 2 from one to the next, so that melt changes them seldom."""

CORNERS: Final = 64
"""Room for the corners of a polygon beside those that it has."""

SHORT: Final = 0.25 * math.pi
"""Length of a fragment over ``lambda`` up to which it does not bend (Hetenyi's short beams)."""

RIGID: Final = 1e40
"""Stiffness against tilt (N m) of a fragment that takes none."""


class Pads(NamedTuple):
    """Pads of some fragments; coordinates (m) from the centroid of the footprint of each, along its axes."""

    rows: Ints  # Elements, one fragment after the other
    row_start: Ints  # Where those of each fragment begin; shape (fragments + 1,)
    polygon_start: Ints  # Where its polygons begin
    start: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # shape (corners, 2)
    centre: Floats  # Centroids of the polygons; shape (polygons, 2)
    owner: Ints  # Place in ``rows`` of the element of each polygon
    square: Ints  # Row and column of its square; shape (polygons, 2)
    raster: (
        Ints  # Of each fragment: where its squares begin in ``ice``, and their rows and columns; shape (fragments, 3)
    )
    ice: (
        Floats  # Of each square: area (m2), centroid and variances xx, xy, yy (m2) of the ice in it; shape (squares, 6)
    )
    frame: Floats  # Of each fragment the columns below; shape (fragments, 5)
    element: Floats  # Places of the elements; shape (rows, 2)
    moments: Floats  # Area of each element, its moments by x and y, second moments xx, xy, yy; shape (rows, 6)


ORIGIN_X, ORIGIN_Y, SIDE, LOW_X, LOW_Y = range(5)
"""Columns of `Pads.frame`: the centroid in the fragment, side of the pads, and where the raster begins."""


@kernel
def choose_pad_sides(modulus: float, poisson: float, thickness: Floats) -> Floats:
    """Sides of the pads (m) of fragments of some thickness (m): a part of ``lambda``, rounded down to one of a few."""
    side = np.empty(thickness.size)
    for b in range(side.size):
        target = math.sqrt(2.0) * bending_length(modulus, poisson, thickness[b]) / SIDES_PER_LAMBDA
        side[b] = 2.0 ** (math.floor(RUNGS * math.log2(target)) / RUNGS)
    return side


@kernel
def _centroid(corner: Floats, a: int, z: int) -> tuple[float, float, float]:
    """Area and centroid of a polygon, the corners ``a`` to ``z``."""
    area = mx = my = 0.0
    x0, y0 = corner[a, 0], corner[a, 1]
    for n in range(a + 1, z - 1):
        ux, uy, vx, vy = corner[n, 0] - x0, corner[n, 1] - y0, corner[n + 1, 0] - x0, corner[n + 1, 1] - y0
        triangle = 0.5 * (ux * vy - vx * uy)
        area += triangle
        mx += triangle * (ux + vx) / 3.0
        my += triangle * (uy + vy) / 3.0
    return (area, x0 + mx / area, y0 + my / area) if area > 0.0 else (0.0, x0, y0)


# Many arguments: the polygons come and go as flat lists, without an object for each.
@kernel
def _cut_by_squares(
    order: Ints, first: Ints, start: Ints, corner: Floats, frame: Floats, raster: Ints, out_start: Ints, out: Floats,
    origin: Ints, square: Ints, polygon_start: Ints,
) -> int:  # fmt: skip
    """Cut polygons, in ``order`` and of each fragment from ``first`` on, by the squares; returns their number, -1 for no room."""
    count, most = 0, CORNERS
    for k in range(start.size - 1):
        most = max(most, 2 * (start[k + 1] - start[k]) + CORNERS)
    polygon, band, room, piece = np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2))
    for b in range(first.size - 1):
        side, polygon_start[b] = frame[b, SIDE], count
        for at in range(first[b], first[b + 1]):
            k = order[at]
            size, low, high = start[k + 1] - start[k], math.inf, -math.inf
            for n in range(size):
                polygon[n, 0] = corner[start[k] + n, 0] - frame[b, ORIGIN_X]
                polygon[n, 1] = corner[start[k] + n, 1] - frame[b, ORIGIN_Y]
                low, high = min(low, polygon[n, 1]), max(high, polygon[n, 1])
            y0, x0 = frame[b, LOW_Y], frame[b, LOW_X]
            for j in range(
                max(math.floor((low - y0) / side), 0), min(math.floor((high - y0) / side) + 1, raster[b, 1])
            ):
                band_size = cut(
                    room, cut(polygon, size, 1, y0 + j * side, 1.0, room), 1, y0 + (j + 1) * side, -1.0, band
                )
                if band_size < 3:
                    continue
                left, right = math.inf, -math.inf
                for n in range(band_size):
                    left, right = min(left, band[n, 0]), max(right, band[n, 0])
                for i in range(
                    max(math.floor((left - x0) / side), 0), min(math.floor((right - x0) / side) + 1, raster[b, 2])
                ):
                    corners = cut(
                        room, cut(band, band_size, 0, x0 + i * side, 1.0, room), 0, x0 + (i + 1) * side, -1.0, piece
                    )
                    if count + 1 >= out_start.size or out_start[count] + corners > len(out):
                        return -1
                    # Round-off leaves slivers along the lines of the raster.
                    if corners < 3 or _centroid(piece, 0, corners)[0] < 1e-9 * side * side:
                        continue
                    for n in range(corners):
                        out[out_start[count] + n, 0], out[out_start[count] + n, 1] = piece[n, 0], piece[n, 1]
                    out_start[count + 1], origin[count] = out_start[count] + corners, k
                    square[count, 0], square[count, 1] = j, i
                    count += 1
    polygon_start[first.size - 1] = count
    return count


@kernel
def _fill_squares(
    polygon_start: Ints, start: Ints, corner: Floats, owner: Ints, square: Ints, raster: Ints, centre: Floats, ice: Floats,
    moments: Floats,
) -> None:  # fmt: skip
    """Find the centroids of polygons, the ice of each square, and the moments of each element."""
    variances = ice[:, 3:]
    room = np.ones((CORNERS, 3))
    for b in range(polygon_start.size - 1):
        for k in range(polygon_start[b], polygon_start[b + 1]):
            area, centre[k, 0], centre[k, 1] = _centroid(corner, start[k], start[k + 1])
            s = raster[b, 0] + square[k, 0] * raster[b, 2] + square[k, 1]
            ice[s, 0] += area
            ice[s, 1] += area * centre[k, 0]
            ice[s, 2] += area * centre[k, 1]
            size, sums = start[k + 1] - start[k], np.zeros(10)
            if size > len(room):
                room = np.ones((size, 3))
            for n in range(size):
                room[n, 0], room[n, 1] = corner[start[k] + n, 0], corner[start[k] + n, 1]
            add_moments(room, size, 0.0, 1.0, sums)
            for n in range(6):
                moments[owner[k], n] += sums[3 + n]
            for n in range(3):
                variances[s, n] += sums[6 + n]
    for s in range(len(ice)):
        if ice[s, 0] > 0.0:
            for n in range(1, 6):
                ice[s, n] /= ice[s, 0]
            variances[s, 0] -= ice[s, 1] * ice[s, 1]
            variances[s, 1] -= ice[s, 1] * ice[s, 2]
            variances[s, 2] -= ice[s, 2] * ice[s, 2]


def cut_into_pads(footprint: BodyFootprint, body: Ints, count: int, xy: Floats, side: Floats) -> Pads:
    """Cut the footprints of ``count`` fragments into pads.

    ``body``: fragment of each of the elements ``footprint.rows``, which come one fragment after the other; ``xy``: their places
    in it (m); ``side``: of the pads of each fragment, m.
    """
    start, corner, fragment = footprint.start, footprint.corner, body[footprint.owner]
    order = np.argsort(fragment, kind="stable")
    first = np.searchsorted(fragment[order], np.arange(count + 1))
    corner_fragment = np.repeat(fragment, np.diff(start))
    frame = np.empty((count, 5))
    box = np.full((2, count, 2), math.inf)
    sums = np.zeros((count, 3))
    for k in range(fragment.size):
        area, x, y = _centroid(corner, start[k], start[k + 1])
        sums[fragment[k]] += area, area * x, area * y
    frame[:, :2], frame[:, SIDE] = sums[:, 1:] / sums[:, :1], side
    offset = corner - frame[corner_fragment, :2]
    np.minimum.at(box[0], corner_fragment, offset)
    np.minimum.at(box[1], corner_fragment, -offset)
    # A berg that is smaller than a pad lies in one square.
    frame[:, LOW_X:] = box[0] - 0.25 * side[:, None]
    shape = np.floor((-box[1] - frame[:, LOW_X:]) / side[:, None]).astype(np.int64)[:, ::-1] + 1
    squares = np.concatenate([[0], np.cumsum(shape.prod(axis=1))])
    raster = np.column_stack([squares[:-1], shape])
    room = 3 * squares[-1] + 4 * fragment.size + CORNERS
    while True:
        out_start, out, origin = np.zeros(room + 1, np.int64), np.empty((6 * room, 2)), np.empty(room, np.int64)
        square, polygon_start = np.empty((room, 2), np.int64), np.zeros(count + 1, np.int64)
        polygons = _cut_by_squares(
            order, first, start, corner, frame, raster, out_start, out, origin, square, polygon_start
        )
        if polygons >= 0:
            break
        room *= 2
    start, corner = out_start[: polygons + 1].copy(), out[: out_start[polygons]].copy()
    centre, ice, square = np.zeros((polygons, 2)), np.zeros((squares[-1], 6)), square[:polygons].copy()
    owner, moments = footprint.owner[origin[:polygons]], np.zeros((body.size, 6))
    _fill_squares(polygon_start, start, corner, owner, square, raster, centre, ice, moments)
    return Pads(
        footprint.rows, np.searchsorted(body, np.arange(count + 1)), polygon_start, start, corner, centre, owner, square, raster,
        ice, frame, xy - frame[body, :2], moments,
    )  # fmt: skip


def melt_pads(pads: Pads, fraction: Floats) -> Pads:
    """Return pads whose elements (``pads.rows``) have melted to a part of their width."""
    if (fraction == 1.0).all():
        return pads
    corner_owner = np.repeat(pads.owner, np.diff(pads.start))

    def shrunk(points: Floats, owner: Ints) -> Any:
        return pads.element[owner] + (points - pads.element[owner]) * fraction[owner, None]

    moments = pads.moments * fraction[:, None] ** 2
    return pads._replace(
        corner=shrunk(pads.corner, corner_owner), centre=shrunk(pads.centre, pads.owner), moments=moments
    )


@kernel
def measure_ice_share(pads: Pads, b: int, x: float, y: float, reach: float) -> float:
    """Part of the surroundings of a point, within ``reach`` m, that is ice, for `riftberg.physics.seabed.bending_stress`."""
    side, total = pads.frame[b, SIDE], 0.0
    row, column = math.floor((y - pads.frame[b, LOW_Y]) / side), math.floor((x - pads.frame[b, LOW_X]) / side)
    n, rows, columns = int(reach / side) + 2, pads.raster[b, 1], pads.raster[b, 2]
    for j in range(max(row - n, 0), min(row + n + 1, rows)):
        for i in range(max(column - n, 0), min(column + n + 1, columns)):
            s = pads.raster[b, 0] + j * columns + i
            if pads.ice[s, 0] > 0.0:
                r = ((pads.ice[s, 1] - x) ** 2 + (pads.ice[s, 2] - y) ** 2) / (reach * reach)
                if r < 1.0:
                    total += pads.ice[s, 0] * (1.0 - r) ** 2
    return total / (math.pi * reach * reach / 3.0)


@kernel
def fill_hulls(
    pads: Pads, thickness: Floats, draft: Floats, modulus: float, poisson: float, hull: Floats, mean: Floats, length: Floats
) -> None:  # fmt: skip
    """Find the stiffness (3, 3) of each fragment afloat against heave and both tilts, its mean thickness and bending length (m).

    ``thickness``, ``draft``: of the elements ``pads.rows``, m; ``modulus`` (Pa): 0 for ice that does not bend. Pieces that are
    narrower than their thickness, or nearly unstable, take no tilt, and these and short ones do not bend (length 0).
    """
    for b in range(mean.size):
        sums, lean, ice = np.zeros(6), 0.0, 0.0
        for e in range(pads.row_start[b], pads.row_start[b + 1]):
            for n in range(6):
                sums[n] += pads.moments[e, n]
            # Distance of the centres of mass and of buoyancy, by the volume of water.
            lean += pads.moments[e, 0] * draft[e] * 0.5 * (thickness[e] - draft[e])
            ice += pads.moments[e, 0] * thickness[e]
        area, mean[b] = sums[0], ice / sums[0]
        # Melted pads lie a little aside of the centroid of the whole ones.
        xx, xy, yy = sums[3] - sums[1] ** 2 / area, sums[4] - sums[1] * sums[2] / area, sums[5] - sums[2] ** 2 / area
        least = 0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        hull[b, :, :] = 0.0
        hull[b, 0, 0], hull[b, 1, 1], hull[b, 2, 2], length[b] = WATER_STIFFNESS * area, RIGID, RIGID, 0.0
        if 12.0 * least / area >= mean[b] ** 2 and least - lean > 0.5 * least:
            hull[b, 1, 1], hull[b, 2, 2] = WATER_STIFFNESS * (yy - lean), WATER_STIFFNESS * (xx - lean)
            hull[b, 1, 2] = hull[b, 2, 1] = -WATER_STIFFNESS * xy
            extent, bending = (
                pads.frame[b, SIDE] * max(pads.raster[b, 1], pads.raster[b, 2]),
                bending_length(modulus, poisson, mean[b]),
            )
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
    return math.atan2(north, east) / DEGREE, math.atan2(up, math.sqrt(east * east + north * north)) / DEGREE
