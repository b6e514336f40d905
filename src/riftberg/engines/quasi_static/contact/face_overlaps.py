"""Overlaps of two elements that may meet: a face for each that hangs together, and what it passes on as it parts or joins.

Footprints are cut into convex polygons, and the overlap of two elements is made of those of their polygons. These are one face
where they meet along a side that two polygons of an element share: such sides are not there in the ice. Ice that is hooked
around a neighbour has two overlaps apart, which push it in two directions, and so two faces.

A face has the number of the first two polygons that overlap in it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_pairs import (
    CrushingWorkspace,
    Faces,
    find_corners,
    locate_pair,
    place_polygons,
)
from riftberg.engines.quasi_static.contact.face_states import pass_states_on
from riftberg.engines.quasi_static.contact.islands import Island
from riftberg.physics.geometry import overlap
from riftberg.state import Floats, Ints

SEAM: Final = 1e-4
"""Way, as a part of the reach of an element, by which two of its polygons may lie apart along a side that they share, and by
which that side is drawn out at its ends: ten times the edges that are left out of footprints."""

import os
NEAR = float(os.environ.get("NEAR", "0"))


@kernel
def find_seams(begin: Ints, ring: Ints, corner: Floats, reach: Floats) -> tuple[Ints, Ints, Floats]:
    """Find the sides that two polygons of an element share.

    Returns where those of each element begin (elements + 1), the numbers of both polygons in their element (sides, 2), and the
    ends (m; 2 sides, 2).
    """
    elements, room = reach.size, 0
    for e in range(elements):
        for p in range(begin[e], begin[e + 1]):
            room += (ring[p + 1] - ring[p]) * (ring[begin[e + 1]] - ring[p + 1])
    start, polygon, seam, count = (
        np.zeros(elements + 1, np.int64),
        np.empty((room, 2), np.int64),
        np.empty((2 * room, 2)),
        0,
    )
    for e in range(elements):
        for p in range(begin[e], begin[e + 1]):
            for q in range(p + 1, begin[e + 1]):
                for k in range(ring[p], ring[p + 1]):
                    for n in range(ring[q], ring[q + 1]):
                        side = corner[k], corner[k + 1 if k + 1 < ring[p + 1] else ring[p]]
                        other = corner[n], corner[n + 1 if n + 1 < ring[q + 1] else ring[q]]
                        if _find_shared_side(side, other, SEAM * reach[e], seam[2 * count : 2 * count + 2]):
                            polygon[count, 0], polygon[count, 1] = p - begin[e], q - begin[e]
                            count += 1
        start[e + 1] = count
    return start, polygon[:count], seam[: 2 * count]


@kernel
def _find_shared_side(
    side: tuple[Floats, Floats], other: tuple[Floats, Floats], tolerance: float, shared: Floats
) -> bool:
    """Find the way along which two sides, of polygons with opposite senses, lie on each other within ``tolerance`` (m)."""
    x, y = side[0][0], side[0][1]
    ux, uy = side[1][0] - x, side[1][1] - y
    length = np.sqrt(ux * ux + uy * uy)
    if length <= tolerance:
        return False
    ux, uy = ux / length, uy / length
    from_along, from_across = (
        ux * (other[1][0] - x) + uy * (other[1][1] - y),
        ux * (other[1][1] - y) - uy * (other[1][0] - x),
    )
    to_along, to_across = (
        ux * (other[0][0] - x) + uy * (other[0][1] - y),
        ux * (other[0][1] - y) - uy * (other[0][0] - x),
    )
    low, high = max(from_along, 0.0), min(to_along, length)
    if high - low <= tolerance:
        return False
    slope = (to_across - from_across) / (to_along - from_along)
    for along in (low, high):
        if abs(from_across + slope * (along - from_along)) > tolerance:
            return False
    low, high = low - tolerance, high + tolerance
    shared[0, 0], shared[0, 1], shared[1, 0], shared[1, 1] = x + low * ux, y + low * uy, x + high * ux, y + high * uy
    return True


@borrower
def find_overlaps(
    island: Island, faces: Faces, face_state: Floats, path: Floats, k: int, work: CrushingWorkspace
) -> None:
    """Find the overlaps of a pair, with the bodies moved by ``path`` and the skin, and pass on to them the states of its faces.

    The skin brings each towards the other, so that neither is the first one.
    """
    i, j, pair = island.first[k], island.second[k], work.pair
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    x1, y1, x2, y2 = x1 + work.skin[k, 0], y1 + work.skin[k, 1], x2 - work.skin[k, 0], y2 - work.skin[k, 1]
    place_polygons(faces, i, x1, y1, ca, sa, pair.corners_1, pair.box_1)
    place_polygons(faces, j, x2, y2, cb, sb, pair.corners_2, pair.box_2)
    n, overlaps = faces.face[k], 0
    for p in range(faces.end[i] - faces.begin[i]):
        begin, end = find_corners(faces, i, p)
        one, box = pair.corners_1[begin:end], pair.box_1[p]
        for q in range(faces.end[j] - faces.begin[j]):
            other, size = pair.box_2[q], work.overlap[n]
            work.last_holder[n], work.holder[n], work.polygon_area[n] = work.holder[n], -1, 0.0
            size[0] = size[1] = size[2] = size[3] = size[4] = 0.0
            if not (box[0] > other[2] or other[0] > box[2] or box[1] > other[3] or other[1] > box[3]):
                begin, end = find_corners(faces, j, q)
                size[0], size[1], size[2], size[3], size[4] = overlap(one, pair.corners_2[begin:end], pair.cut)
                if size[0] != 0.0 or size[3] != 0.0 or size[4] != 0.0:
                    work.holder[n], work.polygon_area[n] = n, size[0]
                    overlaps += 1
            n += 1
    if overlaps > 1:
        _join_along_seams(faces, i, j, faces.face[k], x1, y1, ca, sa, x2, y2, cb, sb, work)
    if n - faces.face[k] > 1:
        pass_states_on(face_state, faces.face[k], n, work)


# Many arguments: the places of both elements; a tuple of them would be made for each pair.
@borrower
def _join_along_seams(
    faces: Faces, i: int, j: int, begin: int, x1: float, y1: float, ca: float, sa: float, x2: float, y2: float, cb: float,
    sb: float, work: CrushingWorkspace,
) -> None:  # fmt: skip
    """Join the overlaps of polygons of two elements that meet along a side shared by two polygons, and add them up."""
    root, polygons_1, polygons_2 = work.root, faces.end[i] - faces.begin[i], faces.end[j] - faces.begin[j]
    end = begin + polygons_1 * polygons_2
    for n in range(begin, end):
        root[n] = n
    for m in range(faces.seam_begin[i], faces.seam_end[i]):
        one, two = begin + faces.seam_polygon[m, 0] * polygons_2, begin + faces.seam_polygon[m, 1] * polygons_2
        for q in range(polygons_2):
            first, last = find_corners(faces, j, q)
            if _passes_through(faces.seam, m, x1, y1, ca, sa, work.pair.corners_2[first:last]):
                _join(root, one + q, two + q)
    for m in range(faces.seam_begin[j], faces.seam_end[j]):
        for p in range(polygons_1):
            one = begin + p * polygons_2 + faces.seam_polygon[m, 0]
            two = begin + p * polygons_2 + faces.seam_polygon[m, 1]
            first, last = find_corners(faces, i, p)
            if _passes_through(faces.seam, m, x2, y2, cb, sb, work.pair.corners_1[first:last]):
                _join(root, one, two)
    for n in range(begin, end):
        root[n] = root[root[n]]  # that of a lower number, which has been led to its first one already
        work.first[n] = -1
    for n in range(begin, end):
        if work.holder[n] >= 0:
            if work.first[root[n]] < 0:
                work.first[root[n]] = n
            else:
                work.holder[n] = work.first[root[n]]
                for c in range(5):
                    work.overlap[work.holder[n], c] += work.overlap[n, c]
                    work.overlap[n, c] = 0.0


@kernel
def _join(holder: Ints, one: int, two: int) -> None:
    """Join two overlaps: the first of both holds all."""
    while holder[one] != one:
        one = holder[one]
    while holder[two] != two:
        two = holder[two]
    holder[max(one, two)] = min(one, two)


@kernel
def _passes_through(seam: Floats, m: int, x: float, y: float, c: float, s: float, ring: Floats) -> bool:
    """Whether a shared side of an element at (x, y), turned by cosine and sine, passes through a convex polygon."""
    px, py, qx, qy = seam[2 * m, 0], seam[2 * m, 1], seam[2 * m + 1, 0], seam[2 * m + 1, 1]
    px, py, qx, qy = x + c * px - s * py, y + s * px + c * py, x + c * qx - s * qy, y + s * qx + c * qy
    low, high = 0.0, 1.0
    for k in range(ring.shape[0]):
        n = k + 1 if k + 1 < ring.shape[0] else 0
        ex, ey = ring[n, 0] - ring[k, 0], ring[n, 1] - ring[k, 1]
        slack = NEAR * np.sqrt(ex * ex + ey * ey)
        here = ex * (py - ring[k, 1]) - ey * (px - ring[k, 0]) + slack
        there = ex * (qy - ring[k, 1]) - ey * (qx - ring[k, 0]) + slack
        if here < 0.0 and there < 0.0:
            return False
        if here < 0.0:
            low = max(low, here / (here - there))
        elif there < 0.0:
            high = min(high, here / (here - there))
    return low < high
