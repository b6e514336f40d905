"""Overlaps of two elements that may meet: a face for each that hangs together.

Footprints are cut into convex polygons, and the overlap of two elements is made of those of their polygons. These are one face
where the ice of both goes on from one to the other, through seams, the sides that two polygons of an element share. Ice that is
hooked around a neighbour overlaps it in two places, which push it in two directions: these are two faces.

A face has the number of the first two polygons that overlap in it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_pairs import (
    CrushingWorkspace,
    Faces,
    PairWorkspace,
    Seams,
    find_corners,
    locate_pair,
    place_polygons,
)
from riftberg.engines.quasi_static.contact.face_states import APART, COLUMNS, PHASE, add_share
from riftberg.engines.quasi_static.contact.islands import Island
from riftberg.physics.geometry import find_shared_way, overlap
from riftberg.state import Floats, Ints

FLUSH: Final = 1e-4
"""Way, as a part of the reach of an element, by which two of its polygons may lie apart along a seam: ten times the edges that
are left out of footprints."""

OPEN: Final = 2.0
"""Way (m) by which both elements may stand apart at a seam where overlaps hang together, a tenth of the depth of crushing.

Faces of a crack with a bend open by centimetres, which rubble fills. With 0.7 to 20 m the same breaks in a converging current,
and with 0.7 to 5 m ice that is hooked around other ice stays as shallow.
"""


@kernel
def find_seams(begin: Ints, ring: Ints, corner: Floats, reach: Floats) -> tuple[Ints, Ints, Ints, Floats]:
    """Return the fields of `Seams` of all elements.

    ``begin``: where the polygons of each begin, and the last end; others as in `Faces`.
    """
    room = 0
    for e in range(reach.size):
        for p in range(begin[e], begin[e + 1]):
            room += (ring[p + 1] - ring[p]) * (ring[begin[e + 1]] - ring[p + 1])
    start, count = np.zeros(reach.size + 1, np.int64), 0
    polygon, point = np.empty((room, 2), np.int64), np.empty((2 * room, 2))
    for e in range(reach.size):
        for p in range(begin[e], begin[e + 1]):
            for q in range(p + 1, begin[e + 1]):
                for k in range(ring[p], ring[p + 1]):
                    side = corner[k], corner[k + 1 if k + 1 < ring[p + 1] else ring[p]]
                    for n in range(ring[q], ring[q + 1]):
                        other = corner[n], corner[n + 1 if n + 1 < ring[q + 1] else ring[q]]
                        if find_shared_way(side, other, FLUSH * reach[e], point[2 * count : 2 * count + 2]) > 0.0:
                            polygon[count, 0], polygon[count, 1] = p - begin[e], q - begin[e]
                            count += 1
        start[e + 1] = count
    return start[:-1], start[1:], polygon[:count], point[: 2 * count]


@borrower
def find_overlaps(
    island: Island, faces: Faces, face_state: Floats, path: Floats, k: int, work: CrushingWorkspace
) -> None:
    """Find the overlaps of a pair, with the bodies moved by ``path`` and the skin, and hand its faces' states to them.

    The skin brings each towards the other, so that neither is the first one.
    """
    i, j, pair, first, last = island.first[k], island.second[k], work.pair, faces.start[k], faces.start[k + 1]
    face_of = work.face_of[first:last]
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    x1, y1, x2, y2 = x1 + work.skin[k, 0], y1 + work.skin[k, 1], x2 - work.skin[k, 0], y2 - work.skin[k, 1]
    place_polygons(faces, i, x1, y1, ca, sa, pair.corners_1, pair.box_1)
    place_polygons(faces, j, x2, y2, cb, sb, pair.corners_2, pair.box_2)
    n, overlaps = 0, 0
    for p in range(faces.end[i] - faces.begin[i]):
        begin, end = find_corners(faces, i, p)
        one, box = pair.corners_1[begin:end], pair.box_1[p]
        for q in range(faces.end[j] - faces.begin[j]):
            other, size = pair.box_2[q], pair.overlap[n]
            size[0] = size[1] = size[2] = size[3] = size[4] = 0.0
            pair.last_face[n], face_of[n] = face_of[n], -1
            if not (box[0] > other[2] or other[0] > box[2] or box[1] > other[3] or other[1] > box[3]):
                begin, end = find_corners(faces, j, q)
                size[0], size[1], size[2], size[3], size[4] = overlap(one, pair.corners_2[begin:end], pair.cut)
                if size[0] != 0.0 or size[3] != 0.0 or size[4] != 0.0:
                    face_of[n] = n
                    overlaps += 1
            pair.area[n] = size[0]
            n += 1
    if overlaps > 1:
        _find_roots(faces, i, j, x1, y1, ca, sa, x2, y2, cb, sb, pair)
        _join_overlaps(face_of, pair)
    if n > 1:
        _hand_on_states(face_state[first:last], face_of, pair)


# Many arguments: where both elements stand; a tuple of them would be made for each pair.
@borrower
def _find_roots(
    faces: Faces, i: int, j: int, x1: float, y1: float, ca: float, sa: float, x2: float, y2: float, cb: float, sb: float,
    pair: PairWorkspace,
) -> None:  # fmt: skip
    """Find which pairs of polygons of two elements hang together: those between which a seam of one comes near the other."""
    seams, root = faces.seams, pair.root
    polygons_1, polygons_2 = faces.end[i] - faces.begin[i], faces.end[j] - faces.begin[j]
    for n in range(polygons_1 * polygons_2):
        root[n] = n
    for m in range(seams.begin[i], seams.end[i]):
        for q in range(polygons_2):
            begin, end = find_corners(faces, j, q)
            if _seam_is_near(seams, m, x1, y1, ca, sa, pair.corners_2[begin:end]):
                _join_roots(root, seams.polygon[m, 0] * polygons_2 + q, seams.polygon[m, 1] * polygons_2 + q)
    for m in range(seams.begin[j], seams.end[j]):
        for p in range(polygons_1):
            begin, end = find_corners(faces, i, p)
            if _seam_is_near(seams, m, x2, y2, cb, sb, pair.corners_1[begin:end]):
                _join_roots(root, p * polygons_2 + seams.polygon[m, 0], p * polygons_2 + seams.polygon[m, 1])
    for n in range(polygons_1 * polygons_2):
        root[n] = root[root[n]]  # the lower one has been led to the lowest before


@kernel
def _join_roots(root: Ints, n: int, m: int) -> None:
    """Let two pairs of polygons, and all that hang together with them, have the lower root of both."""
    while root[n] != n:
        n = root[n]
    while root[m] != m:
        m = root[m]
    root[max(n, m)] = min(n, m)


@kernel
def _seam_is_near(seams: Seams, m: int, x: float, y: float, c: float, s: float, ring: Floats) -> bool:
    """Whether a seam of an element that stands at (x, y), turned by cosine and sine, comes within `OPEN` of a convex polygon."""
    px, py, qx, qy = seams.point[2 * m, 0], seams.point[2 * m, 1], seams.point[2 * m + 1, 0], seams.point[2 * m + 1, 1]
    px, py, qx, qy = x + c * px - s * py, y + s * px + c * py, x + c * qx - s * qy, y + s * qx + c * qy
    low, high = 0.0, 1.0
    for k in range(ring.shape[0]):
        n = k + 1 if k + 1 < ring.shape[0] else 0
        ex, ey = ring[n, 0] - ring[k, 0], ring[n, 1] - ring[k, 1]
        outside = OPEN * math.sqrt(ex * ex + ey * ey)
        here = ex * (py - ring[k, 1]) - ey * (px - ring[k, 0]) + outside
        there = ex * (qy - ring[k, 1]) - ey * (qx - ring[k, 0]) + outside
        if here < 0.0 and there < 0.0:
            return False
        if here < 0.0:
            low = max(low, here / (here - there))
        elif there < 0.0:
            high = min(high, here / (here - there))
    return low < high


@borrower
def _join_overlaps(face_of: Ints, pair: PairWorkspace) -> None:
    """Add the overlaps that hang together up to the first of them."""
    for n in range(face_of.size):
        pair.first[n] = -1
    for n in range(face_of.size):
        if face_of[n] >= 0:
            if pair.first[pair.root[n]] < 0:
                pair.first[pair.root[n]] = n
            else:
                face_of[n] = pair.first[pair.root[n]]
                for c in range(5):
                    pair.overlap[face_of[n], c] += pair.overlap[n, c]
                    pair.overlap[n, c] = 0.0


@borrower
def _hand_on_states(state: Floats, face_of: Ints, pair: PairWorkspace) -> None:
    """Hand the states of the faces of a pair to the overlaps that have their polygons now.

    A face that parts is divided by area, and faces that join are added. One that goes over to other polygons in a sub-step goes
    on as the first overlap that comes from none.
    """
    has_changed = False
    for n in range(face_of.size):
        last = pair.last_face[n]
        has_left = last >= 0 and state[last, PHASE] != APART and face_of[n] >= 0 and face_of[n] != last
        has_changed = has_changed or has_left or (state[n, PHASE] != APART and face_of[n] != n)
    if not has_changed:
        return
    for n in range(face_of.size):
        for c in range(COLUMNS):
            pair.last_state[n, c], state[n, c] = state[n, c], 0.0
    for f in range(face_of.size):
        total = 0.0 if pair.last_state[f, PHASE] == APART else _find_shares(f, face_of, pair)
        if total > 0.0:
            for n in range(face_of.size):
                if pair.share[n] > 0.0:
                    add_share(state[n], pair.last_state[f], pair.share[n] / total)
            pair.last_state[f, PHASE] = APART
    for f in range(face_of.size):
        if pair.last_state[f, PHASE] != APART:
            for n in range(face_of.size):
                if face_of[n] == n and state[n, PHASE] == APART:
                    add_share(state[n], pair.last_state[f], 1.0)
                    break


@kernel
def _find_shares(face: int, face_of: Ints, pair: PairWorkspace) -> float:
    """Find the areas (m2) of the polygons of a face in the overlaps that have them now; returns their sum."""
    total = 0.0
    for n in range(face_of.size):
        pair.share[n] = 0.0
    for n in range(face_of.size):
        if pair.last_face[n] == face and pair.area[n] > 0.0:
            pair.share[face_of[n]] += pair.area[n]
            total += pair.area[n]
    return total
