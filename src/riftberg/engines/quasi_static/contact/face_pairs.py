"""Footprints of two elements that may meet: their positions, the gap between them, and their overlap."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_newton import NewtonWorkspace
from riftberg.engines.quasi_static.contact.islands import Island, element_path
from riftberg.physics.geometry import gap, overlap
from riftberg.state import Floats, Ints


class Faces(NamedTuple):
    """Footprints of elements as convex polygons, about their centres at the start of the step."""

    begin: Ints  # Where the polygons of each element begin among all; shape (elements,)
    end: Ints  # and end
    ring: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # East and north of the element, m; shape (corners, 2)
    reach: Floats  # Farthest corner of each element, m
    thickness: Floats  # m


class PairWorkspace(NamedTuple):
    """Polygons of a pair in their positions, and the overlap of both."""

    corners_1: Floats  # Corners of a polygon in its place, m
    corners_2: Floats
    cut: Floats  # Corners of the overlap; see `riftberg.physics.geometry.overlap`


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
    # closing speed (m s-1), force across and along (N) in the last sub-step
    face: Floats  # shape (pairs, 26)
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
def face_gaps(first: Ints, second: Ints, separation: Floats, faces: Faces) -> Floats:
    """Gap (m) between the faces of each pair, below 0 where they overlap, and its normal from first to second; shape (pairs, 3).

    ``separation``: from the second to the first element, m.
    """
    most = most_corners(faces)
    corners_1, corners_2, gaps = np.empty((most, 2)), np.empty((most, 2)), np.full((first.size, 3), np.inf)
    for k in range(first.size):
        i, j = first[k], second[k]
        for p in range(faces.begin[i], faces.end[i]):
            count_1 = _place(faces, p, separation[k, 0], separation[k, 1], 1.0, 0.0, corners_1)
            for q in range(faces.begin[j], faces.end[j]):
                count_2 = _place(faces, q, 0.0, 0.0, 1.0, 0.0, corners_2)
                g, nx, ny = gap(corners_1[:count_1], corners_2[:count_2])
                if g < gaps[k, 0]:
                    gaps[k, 0], gaps[k, 1], gaps[k, 2] = g, nx, ny
    return gaps


@borrower
def find_pair_gap(
    island: Island, faces: Faces, path: Floats, k: int, work: CrushingWorkspace
) -> tuple[float, float, float]:
    """Gap (m) between the faces of a pair with the bodies moved by ``path``, below 0 where they overlap, and its normal."""
    i, j = island.first[k], island.second[k]
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    nearest, nx, ny = np.inf, 1.0, 0.0
    for p in range(faces.begin[i], faces.end[i]):
        count_1 = _place(faces, p, x1, y1, ca, sa, work.pair.corners_1)
        for q in range(faces.begin[j], faces.end[j]):
            count_2 = _place(faces, q, x2, y2, cb, sb, work.pair.corners_2)
            g, gx, gy = gap(work.pair.corners_1[:count_1], work.pair.corners_2[:count_2])
            if g < nearest:
                nearest, nx, ny = g, gx, gy
    return nearest, nx, ny


@borrower
def find_pair_overlap(
    island: Island, faces: Faces, path: Floats, k: int, skin_x: float, skin_y: float, work: CrushingWorkspace
) -> tuple[float, float, float, float, float]:
    """Area (m2), first moments (m3) and chord (m) of the overlap of a pair, with the bodies moved by ``path`` and the skin (m).

    The skin brings each towards the other, so that neither is the first one. It takes the whole workspace, as `find_pair_gap`:
    with few arguments LLVM no longer takes these into their callers, and a sub-step costs a third more.
    """
    i, j = island.first[k], island.second[k]
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    x1, y1, x2, y2 = x1 + skin_x, y1 + skin_y, x2 - skin_x, y2 - skin_y
    area = moment_x = moment_y = chord_x = chord_y = 0.0
    for p in range(faces.begin[i], faces.end[i]):
        count_1 = _place(faces, p, x1, y1, ca, sa, work.pair.corners_1)
        for q in range(faces.begin[j], faces.end[j]):
            count_2 = _place(faces, q, x2, y2, cb, sb, work.pair.corners_2)
            overlap_area, tx, ty, cx, cy = overlap(
                work.pair.corners_1[:count_1], work.pair.corners_2[:count_2], work.pair.cut
            )
            area += overlap_area
            moment_x += tx
            moment_y += ty
            chord_x += cx
            chord_y += cy
    return area, moment_x, moment_y, chord_x, chord_y


@borrower
def locate_pair(island: Island, path: Floats, k: int) -> tuple[float, float, float, float, float, float, float, float]:
    """Cosine and sine of the rotation of both bodies of a pair, and places (m) of its elements, with bodies moved by ``path``."""
    i, j = island.first[k], island.second[k]
    a, b = island.body_of[i], island.body_of[j]
    ca, sa, cb, sb = math.cos(path[a, 2]), math.sin(path[a, 2]), math.cos(path[b, 2]), math.sin(path[b, 2])
    px, py = element_path(island.levers[i], path[a], ca, sa)
    qx, qy = element_path(island.levers[j], path[b], cb, sb)
    return ca, sa, cb, sb, island.separation[k, 0] + px, island.separation[k, 1] + py, qx, qy


@kernel
def _place(faces: Faces, polygon: int, x: float, y: float, c: float, s: float, out: Floats) -> int:
    """Corners of a polygon whose element stands at (x, y) and has turned by cosine and sine; returns their number."""
    begin, n = faces.ring[polygon], faces.ring[polygon + 1] - faces.ring[polygon]
    for k in range(n):
        px, py = faces.corner[begin + k, 0], faces.corner[begin + k, 1]
        out[k, 0], out[k, 1] = x + c * px - s * py, y + s * px + c * py
    return int(n)


@kernel
def most_corners(faces: Faces) -> int:
    """Largest number of corners of a polygon."""
    most = 0
    for k in range(faces.ring.size - 1):
        most = max(most, faces.ring[k + 1] - faces.ring[k])
    return most
