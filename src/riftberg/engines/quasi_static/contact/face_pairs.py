"""Footprints of two elements that may meet: their positions, and the gap between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_newton import NewtonWorkspace
from riftberg.engines.quasi_static.contact.face_states import COLUMNS
from riftberg.engines.quasi_static.contact.islands import Island, element_path
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import gap
from riftberg.state import Floats, Ints


class Seams(NamedTuple):
    """Sides that two polygons of an element share, which are not there in the ice."""

    begin: Ints  # Where those of each element begin; shape (elements,)
    end: Ints  # and end
    polygon: Ints  # Numbers of both polygons in their element; shape (seams, 2)
    point: Floats  # Both ends, from the centre of the element, m; shape (2 seams, 2)


class Faces(NamedTuple):
    """Footprints of elements as convex polygons, about their centres at the start of the step."""

    begin: Ints  # Where the polygons of each element begin among all; shape (elements,)
    end: Ints  # and end
    ring: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # East and north of the element, m; shape (corners, 2)
    reach: Floats  # Farthest corner of each element, m
    thickness: Floats  # m
    seams: Seams
    start: (
        Ints  # Where the faces of each candidate pair begin: room for one between any two polygons; shape (pairs + 1,)
    )


class PairWorkspace(NamedTuple):
    """Polygons of both elements of a pair in their positions, and their overlaps; n goes through all pairs of polygons."""

    corners_1: Floats  # Of all polygons of an element, one after the other, m
    corners_2: Floats
    box_1: Floats  # Least and largest coordinates of each polygon: west, south, east, north, m
    box_2: Floats
    cut: Floats  # Corners of an overlap; see `riftberg.physics.geometry.overlap`
    overlap: Floats  # Area (m2), first moments (m3), chord (m); in the end of the face of which they are the first; shape (n, 5)
    area: Floats  # Of the overlap of polygons, m2; shape (n,)
    last_face: Ints  # Face that they were in, -1 for none; shape (n,)
    root: Ints  # Lower pair of polygons that they hang together with, in the end the lowest; shape (n,)
    first: Ints  # First of those with this root that overlap; shape (n,)
    share: Floats  # Of a face that parts; shape (n,)
    last_state: Floats  # Of the faces; shape (n, columns)


@kernel
def allocate_pair(faces: Faces) -> PairWorkspace:
    """Return a workspace for the polygons of any two elements."""
    corners, polygons = 0, 0
    for e in range(faces.begin.size):
        corners = max(corners, faces.ring[faces.end[e]] - faces.ring[faces.begin[e]])
        polygons = max(polygons, faces.end[e] - faces.begin[e])
    most = polygons * polygons
    return PairWorkspace(
        np.empty((corners, 2)), np.empty((corners, 2)), np.empty((polygons, 4)), np.empty((polygons, 4)),
        np.empty((2, 4 * corners, 3)), np.empty((most, 5)), np.empty(most), np.empty(most, np.int64), np.empty(most, np.int64),
        np.empty(most, np.int64), np.empty(most), np.empty((most, COLUMNS)),
    )  # fmt: skip


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
    skin: Floats  # Way (m) of each towards the other with which elements that stood on each other overlap; shape (pairs, 2)
    bound: Floats  # Speed at which it closes at most, m s-1; shape (pairs,)
    changed: Ints  # Sweep in which each body's velocities changed last; shape (bodies,)
    face_of: (
        Ints  # Face in which two polygons overlap, as its place among those of its pair, -1 for none; shape (faces,)
    )
    active: Ints  # Faces that overlap in the middle; shape (faces,)
    active_pair: Ints  # and their places among the candidate pairs
    # Of these: normal (2), depth without force (m), its change by closing speed (s), two rows of levers for both bodies (12),
    # mobilities across and along (kg-1), offsets of the common point from both centres (4, m), sliding and
    # closing speed (m s-1), force across and along (N) in the last sub-step, changes of the velocities of both bodies by a unit
    # impulse along each of the two rows (12)
    face: Floats  # shape (faces, 38)
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
    grip: Floats  # Of the anchors; shape (elements, 3, 3)
    patches: Floats  # Of `riftberg.engines.quasi_static.keel_friction.allocate_patches`
    guess: Floats  # Twists of the turn before; shape (bodies, 3)
    floor: Ints  # Whether the floor holds a body or brakes it (`anchors`); shape (bodies,)
    stop: Floats  # Time in which bodies that slide would stop, s; shape (bodies,)
    newton: NewtonWorkspace


@kernel
def face_gaps(first: Ints, second: Ints, separation: Floats, turn: Floats, faces: Faces) -> Floats:
    """Gap (m) between the faces of each pair, below 0 where they overlap, and its normal from first to second; shape (pairs, 3).

    ``separation``, ``turn``: of the pairs, as in `Island`.
    """
    pair, gaps = allocate_pair(faces), np.empty((first.size, 3))
    for k in range(first.size):
        i, j = first[k], second[k]
        c, s = turn[k, 0], turn[k, 1]
        place_polygons(faces, i, separation[k, 0], separation[k, 1], c, s, pair.corners_1, pair.box_1)
        place_polygons(faces, j, 0.0, 0.0, c, -s, pair.corners_2, pair.box_2)
        gaps[k, 0], gaps[k, 1], gaps[k, 2] = _find_least_gap(faces, i, j, pair)
    return gaps


@borrower
def find_pair_gap(
    island: Island, faces: Faces, path: Floats, k: int, work: CrushingWorkspace
) -> tuple[float, float, float]:
    """Gap (m) between the faces of a pair with the bodies moved by ``path``, below 0 where they overlap, and its normal."""
    i, j, pair = island.first[k], island.second[k], work.pair
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    place_polygons(faces, i, x1, y1, ca, sa, pair.corners_1, pair.box_1)
    place_polygons(faces, j, x2, y2, cb, sb, pair.corners_2, pair.box_2)
    return _find_least_gap(faces, i, j, pair)


@borrower
def _find_least_gap(faces: Faces, i: int, j: int, pair: PairWorkspace) -> tuple[float, float, float]:
    """Least gap (m) between the polygons of two elements in their positions, and its normal."""
    nearest, nx, ny = np.inf, 1.0, 0.0
    for p in range(faces.end[i] - faces.begin[i]):
        begin, end = find_corners(faces, i, p)
        one, box = pair.corners_1[begin:end], pair.box_1[p]
        for q in range(faces.end[j] - faces.begin[j]):
            other = pair.box_2[q]
            # Polygons are no nearer than their boxes, the strip between which may be wider than that along any edge.
            east, north = max(box[0] - other[2], other[0] - box[2]), max(box[1] - other[3], other[1] - box[3])
            if max(east, north) >= max(nearest, 0.0):
                continue
            begin, end = find_corners(faces, j, q)
            g, gx, gy = gap(one, pair.corners_2[begin:end])
            if max(east, north) > g:
                g, gx, gy = max(east, north), 0.0, 0.0
                if east >= north:
                    gx = 1.0 if other[0] > box[2] else -1.0
                else:
                    gy = 1.0 if other[1] > box[3] else -1.0
            if g < nearest:
                nearest, nx, ny = g, gx, gy
    return nearest, nx, ny


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
def place_polygons(faces: Faces, e: int, x: float, y: float, c: float, s: float, out: Floats, box: Floats) -> None:
    """Place the polygons of an element that stands at (x, y) and has turned by cosine and sine, and find their boxes."""
    begin = faces.ring[faces.begin[e]]
    for p in range(faces.begin[e], faces.end[e]):
        west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
        for n in range(faces.ring[p], faces.ring[p + 1]):
            px, py = faces.corner[n, 0], faces.corner[n, 1]
            u, v = x + c * px - s * py, y + s * px + c * py
            out[n - begin, 0], out[n - begin, 1] = u, v
            west, south, east, north = min(west, u), min(south, v), max(east, u), max(north, v)
        k = p - faces.begin[e]
        box[k, 0], box[k, 1], box[k, 2], box[k, 3] = west, south, east, north


@kernel
def find_corners(faces: Faces, e: int, number: int) -> tuple[int, int]:
    """Return where the corners of one polygon of an element begin and end among those of all of them."""
    p, begin = faces.begin[e] + number, faces.ring[faces.begin[e]]
    return faces.ring[p] - begin, faces.ring[p + 1] - begin
