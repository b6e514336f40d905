"""Polygons of two footprints that may meet: their positions, the gap between them, and their overlap."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_newton import NewtonWorkspace
from riftberg.engines.quasi_static.contact.islands import Island, element_path
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import gap, overlap
from riftberg.state import Floats, Ints

Box = tuple[float, float, float, float]
"""Least and largest coordinates of a polygon: west, south, east, north, m."""


class Faces(NamedTuple):
    """Convex polygons of the footprints, about the centres of their elements at the start of the step."""

    first: Ints  # Polygons of the candidate pairs; shape (pairs,)
    second: Ints
    ring: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # East and north of the element, m; shape (corners, 2)
    reach: Floats  # Farthest corner of each element, m
    thickness: Floats  # Of each element, m


class PairWorkspace(NamedTuple):
    """Both polygons of a pair in their positions, and their overlap."""

    corners_1: Floats  # m; shape (corners of the largest polygon, 2)
    corners_2: Floats
    cut: Floats  # Corners of the overlap; see `riftberg.physics.geometry.overlap`


@kernel
def allocate_pair(ring: Ints) -> PairWorkspace:
    """Return a workspace for any two polygons."""
    corners = 0
    for p in range(ring.size - 1):
        corners = max(corners, ring[p + 1] - ring[p])
    return PairWorkspace(np.empty((corners, 2)), np.empty((corners, 2)), np.empty((2, 4 * corners, 3)))


class CrushingWorkspace(NamedTuple):
    """Workspace of the sub-steps of one island."""

    acceleration: Floats  # shape (bodies, 3)
    arm: Floats  # shape (bodies,)
    alone: Floats  # Where the whole step takes the bodies, m, m, rad; shape (bodies, 3)
    compliance: Floats  # shape (bodies, 3, 3)
    new: Floats  # Twists at the end of the sub-step; shape (bodies, 3)
    middle: Floats  # Paths at its predicted middle; shape (bodies, 3)
    path_twist: Floats  # Twists by which the bodies go through it; shape (bodies, 3)
    stiffness: Floats  # Of its faces over its mass, s-2; shape (bodies,)
    size: Floats  # Sum of the forces on its faces, N; shape (bodies,)
    peak: Floats  # shape (bodies,)
    travelled: Floats  # Way of the points of each body since the start, at most, m; shape (bodies,)
    speed: Floats  # The same of their speed, m s-1, and of their acceleration, m s-2; shape (bodies, 2)
    measured: Floats  # Gap of each pair when last measured, and how far both bodies had travelled, m; shape (pairs, 2)
    gap: Floats  # Of each pair, m; 0 where they overlap, infinite where far apart; shape (pairs,)
    bound: Floats  # Speed at which it closes at most, m s-1; shape (pairs,)
    changed: Ints  # Sweep in which each body's velocities changed last; shape (bodies,)
    active: Ints  # Pairs that overlap in the middle, as places among the candidates; shape (pairs,)
    # Of these: normal (2), depth without force (m), its change by closing speed (s), two rows of levers for both bodies (12),
    # mobilities across and along (kg-1), offsets of the common point from both centres (4, m), sliding and
    # closing speed (m s-1), force across and along (N) in the last sub-step, changes of the velocities of both bodies by a unit
    # impulse along each of the two rows (12)
    face: Floats  # shape (pairs, 38)
    accelerations: Floats  # By each force, m s-2; shape (elements, forces, 2)
    drag_rate: Floats  # Of `ForceTerms`; shape (elements, 3)
    force: Floats
    net_force: Floats
    contact_force: Floats  # On the elements, N, N, N m; shape (elements, 3)
    everyone: NDArray[np.bool_]
    impacted: NDArray[np.bool_]  # Whether an impact loads a body now; shape (bodies,)
    pair: PairWorkspace
    scratch: Floats  # shape (4, 3, 3)
    dissipated: Floats  # Plastic work and friction so far, J; shape (1,)
    floor_force: Floats  # Of `riftberg.engines.quasi_static.contact.anchors.find_grip`; shape (bodies, 3)
    floor_drag: Floats  # shape (bodies, 3, 3)
    guess: Floats  # Twists of the turn before; shape (bodies, 3)
    floor: Ints  # Whether the floor holds a body or brakes it (`anchors`); shape (bodies,)
    stop: Floats  # Time in which bodies that slide would stop, s; shape (bodies,)
    newton: NewtonWorkspace


@kernel
def find_near_faces(
    first: Ints, second: Ints, separation: Floats, turn: Floats, within: Floats, begin: Ints, ring: Ints, corner: Floats
) -> tuple[Ints, Floats]:
    """Find the pairs of polygons of pairs of elements that are at most ``within`` m from each other.

    Returns the place of the pair of elements in the list and both polygons, shape (pairs, 3), and the gap (m), below 0 where
    they overlap, with its normal from first to second; shape (pairs, 3). ``separation``, ``turn``: of the pairs of elements,
    as in `Island`; ``begin``: where the polygons of each element begin; ``ring``, ``corner``: as in `Faces`.
    """
    pair, size, count = allocate_pair(ring), 0, 0
    for k in range(first.size):
        size += (begin[first[k] + 1] - begin[first[k]]) * (begin[second[k] + 1] - begin[second[k]])
    near, gaps = np.empty((size, 3), np.int64), np.empty((size, 3))
    for k in range(first.size):
        c, s = turn[k, 0], turn[k, 1]
        for p in range(begin[first[k]], begin[first[k] + 1]):
            one, box = _place(ring, corner, p, separation[k, 0], separation[k, 1], c, s, pair.corners_1)
            for q in range(begin[second[k]], begin[second[k] + 1]):
                two, other = _place(ring, corner, q, 0.0, 0.0, c, -s, pair.corners_2)
                g, nx, ny = _find_gap(one, box, two, other, within[k])
                if g <= within[k]:
                    near[count, 0], near[count, 1], near[count, 2] = k, p, q
                    gaps[count, 0], gaps[count, 1], gaps[count, 2] = g, nx, ny
                    count += 1
    return near[:count], gaps[:count]


@borrower
def find_pair_gap(
    island: Island, faces: Faces, path: Floats, k: int, work: CrushingWorkspace
) -> tuple[float, float, float]:
    """Gap (m) between the polygons of a pair with the bodies moved by ``path``, below 0 where they overlap, and its normal."""
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    one, box = _place(faces.ring, faces.corner, faces.first[k], x1, y1, ca, sa, work.pair.corners_1)
    two, other = _place(faces.ring, faces.corner, faces.second[k], x2, y2, cb, sb, work.pair.corners_2)
    return _find_gap(one, box, two, other, np.inf)


@borrower
def _find_gap(one: Floats, box: Box, two: Floats, other: Box, within: float) -> tuple[float, float, float]:
    """Gap (m) between two polygons in their boxes, and its normal; if it is wider than ``within``, perhaps that of the boxes."""
    # Polygons are no nearer than their boxes, the strip between which may be wider than that along any edge.
    east, north = max(box[0] - other[2], other[0] - box[2]), max(box[1] - other[3], other[1] - box[3])
    g, nx, ny = max(east, north), 0.0, 0.0
    if g <= within:
        width, ux, uy = gap(one, two)
        if width >= g:
            return width, ux, uy
    if east >= north:
        nx = 1.0 if other[0] > box[2] else -1.0
    else:
        ny = 1.0 if other[1] > box[3] else -1.0
    return g, nx, ny


@borrower
def find_pair_overlap(
    island: Island, faces: Faces, path: Floats, k: int, skin_x: float, skin_y: float, work: CrushingWorkspace
) -> tuple[float, float, float, float, float]:
    """Area (m2), first moments (m3) and chord (m) of the overlap of a pair, with the bodies moved by ``path`` and the skin (m).

    The skin brings each towards the other, so that neither is the first one. It takes the whole workspace, as `find_pair_gap`:
    with few arguments LLVM no longer takes these into their callers, and a sub-step costs a third more.
    """
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    one, box = _place(faces.ring, faces.corner, faces.first[k], x1 + skin_x, y1 + skin_y, ca, sa, work.pair.corners_1)
    two, other = _place(
        faces.ring, faces.corner, faces.second[k], x2 - skin_x, y2 - skin_y, cb, sb, work.pair.corners_2
    )
    if box[0] > other[2] or other[0] > box[2] or box[1] > other[3] or other[1] > box[3]:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    return overlap(one, two, work.pair.cut)


@borrower
def locate_pair(island: Island, path: Floats, k: int) -> tuple[float, float, float, float, float, float, float, float]:
    """Cosine and sine of the rotation of both elements of a pair, and their positions (m), with bodies moved by ``path``.

    Rotations from the axes of each element at the start to those half-way between both (`Island.turn`).
    """
    i, j = island.first[k], island.second[k]
    a, b, c, s = island.body_of[i], island.body_of[j], island.turn[k, 0], island.turn[k, 1]
    ca, sa, cb, sb = cos(path[a, 2]), sin(path[a, 2]), cos(path[b, 2]), sin(path[b, 2])
    px, py = element_path(island.levers[i], path[a], ca, sa)
    qx, qy = element_path(island.levers[j], path[b], cb, sb)
    return (
        c * ca - s * sa, s * ca + c * sa, c * cb + s * sb, c * sb - s * cb,
        island.separation[k, 0] + c * px - s * py, island.separation[k, 1] + s * px + c * py, c * qx + s * qy, c * qy - s * qx,
    )  # fmt: skip


@kernel
def _place(
    ring: Ints, corner: Floats, p: int, x: float, y: float, c: float, s: float, out: Floats
) -> tuple[Floats, Box]:
    """Place a polygon whose element stands at (x, y) and has turned by cosine and sine; returns its corners and its box."""
    begin, end = ring[p], ring[p + 1]
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for n in range(begin, end):
        px, py = corner[n, 0], corner[n, 1]
        u, v = x + c * px - s * py, y + s * px + c * py
        out[n - begin, 0], out[n - begin, 1] = u, v
        west, south, east, north = min(west, u), min(south, v), max(east, u), max(north, v)
    return out[: end - begin], (west, south, east, north)
