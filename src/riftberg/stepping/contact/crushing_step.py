"""Sub-steps of an island whose bodies crush each other's faces (`riftberg.physics.contact`).

    M (V1 - V0) = h (G(V) - sum J^T F(V1))

with the media G as in `riftberg.stepping.contact.islands`, and the forces F of the faces at the depth that the new
velocities lead to. Normals, lever arms and overlaps are those of the predicted middle, at one common point for both bodies, so
momentum and angular momentum hold to rounding. The law is monotone, so sweeps over the faces find the velocities.

Free bodies go as far as most of their gap. An impact takes some 75 sub-steps, whatever the length of the time step. At rest a
sub-step takes up to a minute, the depth follows the new velocity alone (backward Euler), and the force is damped as much as lets
it come to its value without a swing: faces of a crack begin without force, though the ice bore it a moment before.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.physics.contact import crushing_force, face_stiffness, sliding_force
from riftberg.physics.geometry import gap, overlap, solve
from riftberg.state import Floats, Ints
from riftberg.stepping.contact.islands import (
    Island,
    IslandResult,
    Islands,
    Linearisation,
    accumulate_floor_impulse,
    accumulate_impulse,
    allocate_linearisation,
    allocate_result,
    approach_bound,
    element_path,
    evaluate_media,
    is_stale,
    island_part,
    linearised_force,
    record_loads,
    result_part,
    spin_lever,
)

TOUCHED, CRUSHED, CHORD, SINCE, SPEED, FORCE, FRICTION, PHASE, PUSH_X, PUSH_Y, TORQUE_1, TORQUE_2, SEEN = range(13)
"""Columns of a pair of faces: depths at which they touched and to which they are crushed (m), longest chord (m), time
since touching (s), closing speed then (m s-1), forces across and along (N), phase; force on the second element (N), torques
(N m); depth at the end of the last step (m). At rest, and of faces that overlap and part, the closing speed now."""

COLUMNS: Final = 13

APART, IMPACT, REST = 0.0, 1.0, 2.0
"""Phases of contact of two faces."""

IMPACT_PHASE: Final = 0.03
"""Sub-step of an impact times its angular frequency, rad: at this the restitution is 0.09 in place of 0.10."""

ENTRY_PHASE: Final = 0.06
"""The same just before touching, for a face that is entered unseen."""

GAP_PART: Final = 0.9
"""Part of the gap that is crossed at most in a sub-step."""

SLOW: Final = 2e-3
"""Speed (m s-1) up to which faces touch without an impact."""

AGAIN: Final = 10e-3
"""Closing speed (m s-1) at which rest becomes an impact, if it has doubled within a sub-step: something struck."""

IMPACT_OVER: Final = 0.02
"""Part of the speed of touching below which an impact comes to rest, `SETTLING` over the frequency after touching."""

SETTLING: Final = 3.0

LASTS: Final = 10.0
"""An impact takes at most this time over its frequency: it loads for half of pi of it. What goes on is driven, as at rest."""

LEAST_CHORD: Final = 1e-6
"""Square of the chord of an overlap over its area, below which one face lies wholly in the other.

Round-off leaves some 1e-30; an overlap that opens to one side has 1 and more until it is deeper than wide.
"""

SKIN: Final = 0.01
"""Gap (m) up to which faces stand on each other. Those of a crack do, and what drives them together meets a force at once."""

LEAST_FACE: Final = 1.0
"""Chord (m) from which on faces can stand on each other."""

UNSEEN, UNSEEN_PART = 0.1, 5e-4
"""Way by which faces that part in one place may close in another within a sub-step: in m, and as a part of their size.

Chosen: the longer the way, the fewer sub-steps. With 0.1 m alone A68a breaks into the same pieces at the same minutes.
"""

REST_STEP: Final = 60.0
"""Longest sub-step of faces that overlap, s."""

REST_WAY: Final = 0.5
"""Way (m) by which they are driven into each other at most within it: a small part of the depth of crushing."""

MAX_SWEEPS: Final = 400
"""Sweeps over the faces; impulses are equal and opposite after each of them, so momentum does not depend on their number."""

SWEEP_RTOL: Final = 1e-11
"""Change of the velocities in a sweep, as a part of the largest, at which the sweeps end."""


class CrushingLaw(NamedTuple):
    """Numbers of the law of faces."""

    strength: float  # Pa
    depth: float  # Over which it is reached, m
    ratio: float  # Stiffness of unloading over that of loading
    friction: float


class Faces(NamedTuple):
    """Footprints of elements as convex polygons, about their centres at the start of the step."""

    begin: Ints  # Where the polygons of each element begin among all; shape (elements,)
    end: Ints  # and end
    ring: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # East and north of the element, m; shape (corners, 2)
    reach: Floats  # Farthest corner of each element, m
    thickness: Floats  # m


class CrushingWorkspace(NamedTuple):
    """Workspace of the sub-steps of one island."""

    acceleration: Floats  # shape (bodies, 3)
    arm: Floats  # shape (bodies,)
    alone: Floats  # Where the whole step takes the bodies, m, m, rad; shape (bodies, 3)
    compliance: Floats  # shape (bodies, 3, 3)
    new: Floats  # Twists at the end of the sub-step; shape (bodies, 3)
    middle: Floats  # Paths at its predicted middle; shape (bodies, 3)
    stiffness: Floats  # Of its faces over its mass, s-2; shape (bodies,)
    size: Floats  # Sum of the forces on its faces, N; shape (bodies,)
    peak: Floats  # shape (bodies,)
    travelled: Floats  # Way of the points of each body since the start, at most, m; shape (bodies,)
    speed: Floats  # The same of their speed, m s-1, and of their acceleration, m s-2; shape (bodies, 2)
    measured: Floats  # Gap of each pair when last measured, and how far both bodies had travelled, m; shape (pairs, 2)
    gap: Floats  # Of each pair, m; 0 where they overlap, infinite where far apart; shape (pairs,)
    bound: Floats  # Speed at which it closes at most, m s-1; shape (pairs,)
    skin: Floats  # Way (m) of each of a pair towards the other at which faces that stand on each other overlap; shape (pairs, 2)
    changed: Ints  # Sweep in which each body's velocities changed last; shape (bodies,)
    active: Ints  # Pairs that overlap in the middle, as places among the candidates; shape (pairs,)
    # Of these: normal (2), depth without force (m), its change by closing speed (s), two rows of levers for both bodies (12),
    # mobilities across and along (kg-1), offsets of the common point from both centres (4, m), sliding and
    # closing speed (m s-1) and force across (N) before
    face: Floats  # shape (pairs, 25)
    accelerations: Floats  # By each force, m s-2; shape (elements, forces, 2)
    force: Floats
    net_force: Floats
    contact_force: Floats  # On the elements, N, N, N m; shape (elements, 3)
    everyone: NDArray[np.bool_]
    one: Floats  # Corners of a polygon in its place, m
    two: Floats
    cut: Floats  # Corners of what is left of one within the other; see `riftberg.physics.geometry.overlap`
    scratch: Floats  # shape (4, 3, 3)
    dissipated: Floats  # Plastic work and friction so far, J; shape (1,)


NX, NY, DEPTH, FOLLOW, ROW_N, ROW_T, GIVE_N, GIVE_T, OFFSET, SLIDING, CLOSING, BEFORE = (
    0,
    1,
    2,
    3,
    4,
    10,
    16,
    17,
    18,
    22,
    23,
    24,
)
"""Columns of ``face``."""


@kernel
def integrate_faces(
    lists: Islands, whole: Island, twist: Floats, faces: Faces, pair_state: Floats, dt: float, law: CrushingLaw
) -> tuple[Floats, Floats, NDArray[np.bool_], NDArray[np.bool_], Floats, Floats, Floats, Floats, Floats, float, float]:
    """Take all islands, ``whole``, through a step of ``dt`` s.

    ``pair_state``: one row for each pair, changed in place. Returns what `IslandResult` has, the shortest sub-step (s) and the
    energy dissipated (J).
    """
    r, shortest, dissipated, most = allocate_result(whole, twist), dt, 0.0, _most_corners(faces)
    for k in range(lists.start.size - 1):
        e = slice(lists.row_start[k], lists.row_start[k + 1])
        island, result = island_part(lists, k, whole), result_part(lists, k, r)
        bodies, pairs, rows = island.bonded.size, island.first.size, island.body_of.size
        work = CrushingWorkspace(
            np.empty((bodies, 3)), np.zeros(bodies), np.empty((bodies, 3)), np.empty((bodies, 3, 3)),
            np.empty((bodies, 3)), np.empty((bodies, 3)),
            np.empty(bodies), np.empty(bodies), np.zeros(bodies), np.zeros(bodies), np.empty((bodies, 2)),
            np.full((pairs, 2), -np.inf), np.empty(pairs), np.empty(pairs),
            np.empty((pairs, 2)), np.empty(bodies, np.int64), np.empty(pairs, np.int64), np.empty((pairs, 25)),
            np.zeros((rows, whole.forcing.media.shape[1] + 1, 2)),
            np.zeros((rows, 3)), np.zeros((bodies, 3)), np.zeros((rows, 3)), np.ones(bodies, np.bool_),
            np.empty((most, 2)), np.empty((most, 2)), np.empty((2, 4 * most, 3)), np.empty((4, 3, 3)), np.zeros(1),
        )  # fmt: skip
        of_rows = Faces(faces.begin[e], faces.end[e], faces.ring, faces.corner, faces.reach[e], faces.thickness[e])
        for i in range(rows):
            m, a = island.levers[i], island.body_of[i]
            work.arm[a] = max(work.arm[a], math.hypot(m[2], m[5]) + of_rows.reach[i])
        of_pairs = pair_state[lists.pair_start[k] : lists.pair_start[k + 1]]
        about = allocate_linearisation(result.twist)
        shortest = min(shortest, _integrate_island(island, of_rows, of_pairs, result, about, dt, law, work))
        dissipated += work.dissipated[0]
    return (
        r.twist, r.path, r.touched, r.close, r.applied, r.peak_force, r.peak_axes, r.peak_spin, r.impulse, shortest, dissipated,
    )  # fmt: skip


@kernel
def _most_corners(faces: Faces) -> int:
    """Largest number of corners of a polygon."""
    most = 0
    for k in range(faces.ring.size - 1):
        most = max(most, faces.ring[k + 1] - faces.ring[k])
    return most


@borrower
def _integrate_island(
    island: Island, faces: Faces, pair_state: Floats, result: IslandResult, about: Linearisation, dt: float, law: CrushingLaw,
    work: CrushingWorkspace,
) -> float:  # fmt: skip
    """Take one island through the step; returns its shortest sub-step, s."""
    twist = result.twist
    left, shortest, elapsed, h = dt, dt, np.inf, np.inf
    work.skin[:, :] = 0.0
    _align(island, faces, pair_state, result, work)
    while True:
        if left <= 0.0 or is_stale(about, twist, work.arm, elapsed, dt):
            accumulate_impulse(island, about, elapsed, result.applied)
            if left <= 0.0:
                work.skin[:, :] = 0.0
                _remember_depths(island, faces, pair_state, result, work)
                _find_close_pairs(island, faces, result, work)
                return shortest
            evaluate_media(island, twist, about, work.everyone, work.accelerations, work.force)
            elapsed = 0.0
        linearised_force(about, island.matrices.floor_drag, twist, work.net_force)
        if left == dt:
            _go_alone(island, twist, dt, work)
        h = _longest_substep(island, faces, pair_state, result, left, h, law, work)
        if left - h < 1e-9 * dt:
            h = left
        shortest = min(shortest, h)
        _free_motion(island, about.jacobian, h, twist, work)
        for b in range(twist.shape[0]):
            for i in range(3):
                work.middle[b, i] = result.path[b, i] + 0.5 * h * twist[b, i]
        count = _find_faces(island, faces, pair_state, result, h, law, work)
        _sweep(island, faces, pair_state, count, h, law, work)
        _update_faces(island, faces, pair_state, count, h, law, work, result)
        _record_peak(island, pair_state, count, result, work)
        for b in range(twist.shape[0]):
            for i in range(3):
                work.middle[b, i] = 0.5 * (twist[b, i] + work.new[b, i])
                about.twist_integral[b, i] += h * work.middle[b, i]
                result.path[b, i] += h * work.middle[b, i]
                twist[b, i] = work.new[b, i]
            work.travelled[b] += h * _speed_bound(work.middle[b], work.arm[b])
        accumulate_floor_impulse(island, twist, h, result.applied)
        elapsed += h
        left = left - h if left > h else 0.0


@kernel
def _go_alone(island: Island, twist: Floats, dt: float, work: CrushingWorkspace) -> None:
    """Find where the whole step takes the bodies: by the half kick of its start."""
    for b in range(twist.shape[0]):
        for i in range(3):
            work.alone[b, i] = dt * twist[b, i]
            for j in range(3):
                work.alone[b, i] += 0.5 * dt * dt * island.matrices.mobility[b, i, j] * work.net_force[b, j]


@borrower
def _find_close_pairs(island: Island, faces: Faces, result: IslandResult, work: CrushingWorkspace) -> None:
    """Mark the pairs that did not touch, but are nearer than the whole step and the sub-steps are from each other."""
    path, alone = result.path, work.alone
    for k in range(island.first.size):
        i, j = island.first[k], island.second[k]
        a, b, reach = island.body_of[i], island.body_of[j], faces.reach[i] + faces.reach[j]
        dx = alone[a, 0] - path[a, 0] - alone[b, 0] + path[b, 0]
        dy = alone[a, 1] - path[a, 1] - alone[b, 1] + path[b, 1]
        other = math.hypot(dx, dy) + (abs(alone[a, 2] - path[a, 2]) + abs(alone[b, 2] - path[b, 2])) * reach
        _, _, _, _, x1, y1, x2, y2 = _places_of_pair(island, path, k)
        if not result.touched[k] and math.hypot(x1 - x2, y1 - y2) < reach + other:
            result.close[k] = _gap_of_pair(island, faces, path, k, work)[0] < other


@borrower
def _gap_of_pair(
    island: Island, faces: Faces, path: Floats, k: int, work: CrushingWorkspace
) -> tuple[float, float, float]:
    """Gap (m) between the faces of a pair with the bodies moved by ``path``, below 0 where they overlap, and its normal."""
    i, j = island.first[k], island.second[k]
    ca, sa, cb, sb, x1, y1, x2, y2 = _places_of_pair(island, path, k)
    nearest, nx, ny = np.inf, 1.0, 0.0
    for p in range(faces.begin[i], faces.end[i]):
        corners = _place(faces, p, x1, y1, ca, sa, work.one)
        for q in range(faces.begin[j], faces.end[j]):
            others = _place(faces, q, x2, y2, cb, sb, work.two)
            g, gx, gy = gap(work.one[:corners], work.two[:others])
            if g < nearest:
                nearest, nx, ny = g, gx, gy
    return nearest, nx, ny


@kernel
def _place(faces: Faces, polygon: int, x: float, y: float, c: float, s: float, out: Floats) -> int:
    """Corners of a polygon whose element stands at (x, y) and has turned by cosine and sine; returns their number."""
    begin, n = faces.ring[polygon], faces.ring[polygon + 1] - faces.ring[polygon]
    for k in range(n):
        px, py = faces.corner[begin + k, 0], faces.corner[begin + k, 1]
        out[k, 0], out[k, 1] = x + c * px - s * py, y + s * px + c * py
    return int(n)


@kernel
def _set_apart(state: Floats) -> None:
    """End the contact of a pair."""
    state[PHASE], state[FORCE], state[FRICTION], state[SPEED] = APART, 0.0, 0.0, 0.0


@borrower
def _places_of_pair(
    island: Island, path: Floats, k: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """Cosine and sine of the rotation of both bodies of a pair, and places (m) of its elements, with bodies moved by ``path``."""
    i, j = island.first[k], island.second[k]
    a, b = island.body_of[i], island.body_of[j]
    ca, sa, cb, sb = math.cos(path[a, 2]), math.sin(path[a, 2]), math.cos(path[b, 2]), math.sin(path[b, 2])
    px, py = element_path(island.levers[i], path[a], ca, sa)
    qx, qy = element_path(island.levers[j], path[b], cb, sb)
    return ca, sa, cb, sb, island.separation[k, 0] + px, island.separation[k, 1] + py, qx, qy


@borrower
def _overlap_of_pair(
    island: Island, faces: Faces, path: Floats, k: int, work: CrushingWorkspace
) -> tuple[float, float, float, float, float]:
    """Area (m2), first moments (m3) and chord (m) of the overlap of a pair, with the bodies moved by ``path`` and the skin."""
    i, j = island.first[k], island.second[k]
    ca, sa, cb, sb, x1, y1, x2, y2 = _places_of_pair(island, path, k)
    # Half of the skin to each, so that neither is the first one.
    x1, y1, x2, y2 = x1 + work.skin[k, 0], y1 + work.skin[k, 1], x2 - work.skin[k, 0], y2 - work.skin[k, 1]
    area = moment_x = moment_y = chord_x = chord_y = 0.0
    for p in range(faces.begin[i], faces.end[i]):
        corners = _place(faces, p, x1, y1, ca, sa, work.one)
        for q in range(faces.begin[j], faces.end[j]):
            others = _place(faces, q, x2, y2, cb, sb, work.two)
            part, tx, ty, cx, cy = overlap(work.one[:corners], work.two[:others], work.cut)
            area += part
            moment_x += tx
            moment_y += ty
            chord_x += cx
            chord_y += cy
    return area, moment_x, moment_y, chord_x, chord_y


@kernel
def face_gaps(first: Ints, second: Ints, apart: Floats, faces: Faces) -> Floats:
    """Gap (m) between the faces of each pair, below 0 where they overlap, and its normal from first to second; shape (pairs, 3).

    ``apart``: from the second to the first element, m.
    """
    most = _most_corners(faces)
    one, two, out = np.empty((most, 2)), np.empty((most, 2)), np.full((first.size, 3), np.inf)
    for k in range(first.size):
        i, j = first[k], second[k]
        for p in range(faces.begin[i], faces.end[i]):
            corners = _place(faces, p, apart[k, 0], apart[k, 1], 1.0, 0.0, one)
            for q in range(faces.begin[j], faces.end[j]):
                others = _place(faces, q, 0.0, 0.0, 1.0, 0.0, two)
                g, nx, ny = gap(one[:corners], two[:others])
                if g < out[k, 0]:
                    out[k, 0], out[k, 1], out[k, 2] = g, nx, ny
    return out


@borrower
def _align(island: Island, faces: Faces, pair_state: Floats, result: IslandResult, work: CrushingWorkspace) -> None:
    """Take the pairs on from where the last step saw them: no force from a depth that has changed without a motion.

    A sub-step moves bodies on a plane of its own, a step on the sphere: that shifts faces by millimetres, of which unloading
    would make the force of an impact.
    """
    for k in range(island.first.size):
        if pair_state[k, PHASE] != APART:
            area, _, _, _, _ = _overlap_of_pair(island, faces, result.path, k, work)
            shift = area / pair_state[k, CHORD] - pair_state[k, SEEN]
            pair_state[k, TOUCHED] += shift
            pair_state[k, CRUSHED] += shift


@borrower
def _remember_depths(
    island: Island, faces: Faces, pair_state: Floats, result: IslandResult, work: CrushingWorkspace
) -> None:
    """Note how deep the faces are at the end of a step."""
    for k in range(island.first.size):
        if pair_state[k, PHASE] != APART:
            area, _, _, _, _ = _overlap_of_pair(island, faces, result.path, k, work)
            pair_state[k, SEEN] = area / pair_state[k, CHORD]


# Many arguments: levers and twists of both, which the caller has at hand; a tuple of them would be made for each pair.
@kernel
def _relative_velocity(
    m: Floats, v: Floats, n: Floats, w: Floats, mx: float, my: float, qx: float, qy: float, rx: float, ry: float,
    share: float,
) -> tuple[float, float]:  # fmt: skip
    """Velocity (m s-1) of the first body relative to the second, by a share of the way from the first element to the second.

    r: from the second to the first element, m.
    """
    spin = share * v[2] + (1.0 - share) * w[2]
    return (
        m[0] * v[0] + m[1] * v[1] + mx * v[2] - (n[0] * w[0] + n[1] * w[1] + qx * w[2]) + spin * ry,
        m[3] * v[0] + m[4] * v[1] + my * v[2] - (n[3] * w[0] + n[4] * w[1] + qy * w[2]) - spin * rx,
    )


@borrower
def _longest_substep(
    island: Island, faces: Faces, pair_state: Floats, result: IslandResult, left: float, before: float, law: CrushingLaw,
    work: CrushingWorkspace,
) -> float:  # fmt: skip
    """Find the longest sub-step (s): by the gaps of the bodies that may meet, and by the frequency of those that do."""
    twist, path, mobility, limit = result.twist, result.path, island.matrices.mobility, left
    for b in range(twist.shape[0]):
        work.stiffness[b] = 0.0
        for i in range(3):
            work.acceleration[b, i] = 0.0
            for j in range(3):
                work.acceleration[b, i] += mobility[b, i, j] * work.net_force[b, j]
    fastest, quickest = approach_bound(twist, work.arm), approach_bound(work.acceleration, work.arm)
    for b in range(twist.shape[0]):
        work.speed[b, 0] = _speed_bound(twist[b], work.arm[b])
        work.speed[b, 1] = _speed_bound(work.acceleration[b], work.arm[b])
    impact = False
    for k in range(island.first.size):
        i, j = island.first[k], island.second[k]
        m, n, a, b = island.levers[i], island.levers[j], island.body_of[i], island.body_of[j]
        work.skin[k, 0] = work.skin[k, 1] = 0.0
        if pair_state[k, PHASE] == REST:
            # Whether they still overlap shows in the middle; the forces of the sub-step before are the first guess.
            work.gap[k], work.bound[k], limit = 0.0, 0.0, min(limit, REST_STEP, 2.0 * before)
            if pair_state[k, SPEED] * limit > REST_WAY:
                limit = REST_WAY / pair_state[k, SPEED]
            continue
        # A gap that both cannot have crossed since it was measured, nor can within the sub-step, need not be measured again.
        least = work.measured[k, 0] - (work.travelled[a] + work.travelled[b] - work.measured[k, 1])
        if least > SKIN:
            closing, driven = work.speed[a, 0] + work.speed[b, 0], work.speed[a, 1] + work.speed[b, 1]
            if _most_of_way(least, closing, driven)[0] >= limit:
                work.gap[k], work.bound[k] = least, closing + driven * limit
                continue
        work.gap[k] = np.inf
        ca, sa, cb, sb, x1, y1, x2, y2 = _places_of_pair(island, path, k)
        far, reach = math.hypot(x1 - x2, y1 - y2), faces.reach[i] + faces.reach[j]
        if far > reach + limit * (fastest + 0.5 * limit * quickest):
            _set_apart(pair_state[k])
            continue
        nearest, nx, ny = _gap_of_pair(island, faces, path, k, work)
        work.measured[k, 0], work.measured[k, 1] = nearest, work.travelled[a] + work.travelled[b]
        mx, my = spin_lever(m, ca, sa)
        ox, oy = spin_lever(n, cb, sb)
        rx, ry = x1 - x2, y1 - y2
        # They meet in a point of the smaller one, of two of one size about the middle. Two bodies that turn together do not meet.
        this, that = faces.reach[i] ** 4, faces.reach[j] ** 4
        share, smaller = this / (this + that), min(faces.reach[i], faces.reach[j])
        du, dv = _relative_velocity(m, twist[a], n, twist[b], mx, my, ox, oy, rx, ry, share)
        closing = max(nx * du + ny * dv, 0.0) + abs(twist[a, 2] - twist[b, 2]) * smaller
        thickness, inverse = min(faces.thickness[i], faces.thickness[j]), 0.0
        for body in (a, b):
            inverse += max(mobility[body, 0, 0], mobility[body, 1, 1])
        if inverse == 0.0:
            continue
        # Where no contact says how long the face is, that of an element.
        stiffness = face_stiffness(law.strength, thickness, smaller, law.depth)
        entry = ENTRY_PHASE / math.sqrt(stiffness * inverse)
        one, two = work.acceleration[a], work.acceleration[b]
        au, av = _relative_velocity(m, one, n, two, mx, my, ox, oy, rx, ry, share)
        driven = math.hypot(au, av) + abs(one[2] - two[2]) * smaller
        free, parting = pair_state[k, PHASE] == APART, pair_state[k, SPEED] < 0.0
        if nearest <= SKIN and free and (closing <= SLOW or parting):
            # They stand on each other, or part: whatever drives them together, the force of the sub-step answers.
            work.gap[k], work.bound[k], limit = 0.0, 0.0, min(limit, REST_STEP)
            work.skin[k, 0], work.skin[k, 1] = 0.5 * SKIN * nx, 0.5 * SKIN * ny
            if closing > SLOW:  # they part where they stand on each other, and turn into each other beside it
                limit = min(limit, max(max(UNSEEN, UNSEEN_PART * smaller) / closing, entry))
            continue
        if nearest <= 0.0:
            work.gap[k], work.bound[k], limit = 0.0, 0.0, min(limit, entry if free else REST_STEP)
            if pair_state[k, PHASE] != APART:
                limit = min(limit, 2.0 * before)  # the forces of the sub-step before are the first guess
            if pair_state[k, PHASE] == IMPACT:
                stiffness = face_stiffness(law.strength, thickness, pair_state[k, CHORD], law.depth)
                # An impact off the centre turns the body, too: it gives way by up to four times as much.
                work.stiffness[a] += stiffness * _give(mobility[a], m, mx, my, nx, ny)
                work.stiffness[b] += stiffness * _give(mobility[b], n, ox, oy, nx, ny)
            if pair_state[k, PHASE] == IMPACT and pair_state[k, FORCE] > 0.0:
                impact = True
            elif pair_state[k, PHASE] == IMPACT:
                # Unloaded, but closing: nothing happens before the depth to which the faces are crushed.
                area, _, _, _, _ = _overlap_of_pair(island, faces, path, k, work)
                to_go = max(pair_state[k, CRUSHED] - area / pair_state[k, CHORD], 0.0)
                limit = min(limit, max(_most_of_way(to_go, closing, driven)[0], entry))
            continue
        _set_apart(pair_state[k])
        work.gap[k], work.bound[k] = nearest, closing + driven * limit
        crossed, meets = _most_of_way(nearest, closing, driven)
        limit = min(limit, max(crossed, entry if meets > SLOW else REST_STEP))
    if impact:
        most = 0.0
        for k in range(island.first.size):
            if pair_state[k, PHASE] == IMPACT and pair_state[k, FORCE] > 0.0:
                most = max(
                    most,
                    work.stiffness[island.body_of[island.first[k]]] + work.stiffness[island.body_of[island.second[k]]],
                )
        if most > 0.0:
            limit = min(limit, IMPACT_PHASE / math.sqrt(most))
    return limit


@kernel
def _speed_bound(twist: Floats, arm: float) -> float:
    """Upper bound of the speed (m s-1) of the points of a body; or of their acceleration (m s-2)."""
    return float(math.hypot(twist[0], twist[1]) + arm * abs(twist[2]))


@kernel
def _most_of_way(way: float, closing: float, driven: float) -> tuple[float, float]:
    """Time (s) in which no more than `GAP_PART` of a way (m) is crossed, and the speed (m s-1) at its end.

    The way is crossed no sooner than after the smallest root t of way = closing t + driven t^2 / 2.
    """
    meets = math.sqrt(closing * closing + 2.0 * driven * way)
    return GAP_PART * 2.0 * way / (closing + meets) if meets > 0.0 else math.inf, meets


@kernel
def _give(mobility: Floats, m: Floats, mx: float, my: float, nx: float, ny: float) -> float:
    """Change of the velocity of an element along a normal by a unit impulse there, kg-1."""
    r0, r1, r2 = nx * m[0] + ny * m[3], nx * m[1] + ny * m[4], nx * mx + ny * my
    return float(
        r0 * (mobility[0, 0] * r0 + mobility[0, 1] * r1 + mobility[0, 2] * r2)
        + r1 * (mobility[1, 0] * r0 + mobility[1, 1] * r1 + mobility[1, 2] * r2)
        + r2 * (mobility[2, 0] * r0 + mobility[2, 1] * r1 + mobility[2, 2] * r2)
    )


@borrower
def _free_motion(island: Island, jacobian: Floats, h: float, twist: Floats, work: CrushingWorkspace) -> None:
    """Velocities at the end of a sub-step without contact, and the compliance of each body with its media."""
    mobility, compliance = island.matrices.mobility, work.compliance
    matrix, used, x = work.scratch[0], work.scratch[1], work.scratch[2, 0]
    for b in range(twist.shape[0]):
        for i in range(3):
            for j in range(3):
                matrix[i, j] = 1.0 if i == j else 0.0
                for k in range(3):
                    drag = 0.5 * jacobian[b, k, j] + island.matrices.floor_drag[b, k, j]
                    matrix[i, j] += h * mobility[b, i, k] * drag
        for j in range(3):
            for i in range(3):
                x[i] = mobility[b, i, j]
                for k in range(3):
                    used[i, k] = matrix[i, k]
            compliance[b, 0, j], compliance[b, 1, j], compliance[b, 2, j] = solve(used, x)
        for i in range(3):
            f = work.net_force[b]
            work.new[b, i] = twist[b, i] + h * (
                compliance[b, i, 0] * f[0] + compliance[b, i, 1] * f[1] + compliance[b, i, 2] * f[2]
            )


@kernel
def _fill_row(
    row: Floats, at: int, sign: float, m: Floats, mx: float, my: float, ox: float, oy: float, ux: float, uy: float
) -> None:
    """Levers of a point at (ox, oy) from an element, along (ux, uy), of three freedoms."""
    row[at] = sign * (ux * (m[0] - oy * m[6]) + uy * (m[3] + ox * m[6]))
    row[at + 1] = sign * (ux * (m[1] - oy * m[7]) + uy * (m[4] + ox * m[7]))
    row[at + 2] = sign * (ux * (mx - oy * m[8]) + uy * (my + ox * m[8]))


@kernel
def _speed(row: Floats, at: int, v: Floats, w: Floats) -> float:
    """Speed (m s-1) along a row of levers of both bodies."""
    return float(
        row[at] * v[0]
        + row[at + 1] * v[1]
        + row[at + 2] * v[2]
        + row[at + 3] * w[0]
        + row[at + 4] * w[1]
        + row[at + 5] * w[2]
    )


@kernel
def _mobility_along(row: Floats, at: int, one: Floats, two: Floats) -> float:
    """Change of the speed along a row by a unit impulse along it, kg-1."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += row[at + i] * one[i, j] * row[at + j] + row[at + 3 + i] * two[i, j] * row[at + 3 + j]
    return total


@borrower
def _find_faces(
    island: Island, faces: Faces, pair_state: Floats, result: IslandResult, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> int:  # fmt: skip
    """Find the faces that overlap at the predicted middle, and begin or end their contact; returns their number."""
    count, path, twist = 0, work.middle, result.twist
    for k in range(island.first.size):
        if work.gap[k] > 0.5 * h * work.bound[k]:
            continue
        i, j = island.first[k], island.second[k]
        m, n, a, b = island.levers[i], island.levers[j], island.body_of[i], island.body_of[j]
        ca, sa, cb, sb, x1, y1, x2, y2 = _places_of_pair(island, path, k)
        area, moment_x, moment_y, chord_x, chord_y = _overlap_of_pair(island, faces, path, k, work)
        chord = math.hypot(chord_x, chord_y)
        skin = 2.0 * math.hypot(work.skin[k, 0], work.skin[k, 1])
        if skin > 0.0 and chord < LEAST_FACE:  # a corner, until it is in the other face
            continue
        if not (area > 0.0 and chord * chord > LEAST_CHORD * area):
            _set_apart(pair_state[k])
            if area > 0.0:
                # One lies wholly in the other: its chord closes to nothing but round-off, and nothing says which way is out.
                # It is no limit to the sub-steps.
                pair_state[k, SPEED] = -np.inf
            continue
        nx, ny, x, y = chord_y / chord, -chord_x / chord, moment_x / area, moment_y / area
        row = work.face[count]
        mx, my = spin_lever(m, ca, sa)
        qx, qy = spin_lever(n, cb, sb)
        _fill_row(row, ROW_N, 1.0, m, mx, my, x - x1, y - y1, nx, ny)
        _fill_row(row, ROW_N + 3, -1.0, n, qx, qy, x - x2, y - y2, nx, ny)
        _fill_row(row, ROW_T, 1.0, m, mx, my, x - x1, y - y1, -ny, nx)
        _fill_row(row, ROW_T + 3, -1.0, n, qx, qy, x - x2, y - y2, -ny, nx)
        closing = _speed(row, ROW_N, twist[a], twist[b])
        state = pair_state[k]
        if state[PHASE] == APART:
            # Faces meet where they stand: what was crushed before is rubble that fills the gap.
            state[TOUCHED] = area / chord - skin
            state[PHASE] = IMPACT if closing > (AGAIN if skin > 0.0 else SLOW) else REST
            if state[PHASE] == REST:
                state[TOUCHED] -= 0.5 * h * closing
            state[CRUSHED] = state[TOUCHED]
            state[CHORD], state[SINCE], state[SPEED], state[FORCE], state[FRICTION] = chord, 0.0, closing, 0.0, 0.0
        # A chord that shrinks while the load is released would make energy.
        state[CHORD] = max(state[CHORD], chord)
        row[NX], row[NY], row[OFFSET], row[OFFSET + 1] = nx, ny, x - x1, y - y1
        row[OFFSET + 2], row[OFFSET + 3] = x - x2, y - y2
        row[GIVE_N] = _mobility_along(row, ROW_N, work.compliance[a], work.compliance[b])
        row[GIVE_T] = _mobility_along(row, ROW_T, work.compliance[a], work.compliance[b])
        row[SLIDING], row[CLOSING], row[BEFORE] = _speed(row, ROW_T, twist[a], twist[b]), closing, state[FORCE]
        if row[GIVE_N] <= 0.0:
            continue
        depth = area / state[CHORD] - skin
        if state[PHASE] == REST:
            stiffness = face_stiffness(
                law.strength, min(faces.thickness[i], faces.thickness[j]), state[CHORD], law.depth
            )
            row[DEPTH], row[FOLLOW] = depth - 0.5 * h * closing, h + 2.0 / math.sqrt(stiffness * row[GIVE_N])
        else:
            row[DEPTH], row[FOLLOW] = depth, 0.5 * h
        work.active[count] = k
        count += 1
    return count


@kernel
def _push(row: Floats, at: int, impulse: float, one: Floats, two: Floats, v: Floats, w: Floats) -> None:
    """Change the velocities of both bodies by an impulse against a row."""
    for i in range(3):
        for j in range(3):
            v[i] -= impulse * one[i, j] * row[at + j]
            w[i] -= impulse * two[i, j] * row[at + 3 + j]


@borrower
def _sweep(
    island: Island, faces: Faces, pair_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> None:
    """Find the forces of the faces and the velocities that they lead to (projected Gauss-Seidel)."""
    scale = 1e-9
    for f in range(count):
        k, row = work.active[f], work.face[f]
        a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
        scale = max(scale, abs(_speed(row, ROW_N, work.new[a], work.new[b])), abs(row[SLIDING]))
        # The forces of the sub-step before are a first guess.
        _push(row, ROW_N, h * pair_state[k, FORCE], work.compliance[a], work.compliance[b], work.new[a], work.new[b])
        _push(row, ROW_T, h * pair_state[k, FRICTION], work.compliance[a], work.compliance[b], work.new[a], work.new[b])
    work.changed[:] = 0
    for sweep in range(1, MAX_SWEEPS + 1):
        most = 0.0
        for f in range(count):
            k, row = work.active[f], work.face[f]
            i, j = island.first[k], island.second[k]
            a, b, state = island.body_of[i], island.body_of[j], pair_state[k]
            # Where neither body has changed since its last turn, a face has nothing to add: clusters converge each by itself.
            if max(work.changed[a], work.changed[b]) < sweep - 1:
                continue
            largest = 0.0
            one, two, v, w = work.compliance[a], work.compliance[b], work.new[a], work.new[b]
            thickness = min(faces.thickness[i], faces.thickness[j])
            stiffness = face_stiffness(law.strength, thickness, state[CHORD], law.depth)
            give = h * row[GIVE_N]
            free = _speed(row, ROW_N, v, w) + give * state[FORCE]
            force = crushing_force(
                row[DEPTH] + row[FOLLOW] * free, state[TOUCHED], state[CRUSHED], stiffness, law.ratio,
                stiffness * law.depth, row[FOLLOW] * give,
            )  # fmt: skip
            change = force - state[FORCE]
            state[FORCE] = force
            _push(row, ROW_N, h * change, one, two, v, w)
            largest = max(largest, abs(give * change))
            if law.friction > 0.0:
                give = h * row[GIVE_T]
                slide = sliding_force(state[FRICTION] + _speed(row, ROW_T, v, w) / give, force, law.friction)
                change = slide - state[FRICTION]
                state[FRICTION] = slide
                _push(row, ROW_T, h * change, one, two, v, w)
                largest = max(largest, abs(give * change))
            if largest > SWEEP_RTOL * scale:
                work.changed[a] = work.changed[b] = sweep
            most = max(most, largest)
        if most <= SWEEP_RTOL * scale:
            return


@borrower
def _update_faces(
    island: Island, faces: Faces, pair_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace,
    result: IslandResult,
) -> None:  # fmt: skip
    """Crush the faces as far as their forces say, and pass on from impact to rest, or apart; add up what they give the bodies."""
    for f in range(count):
        k, row = work.active[f], work.face[f]
        i, j = island.first[k], island.second[k]
        a, b, state = island.body_of[i], island.body_of[j], pair_state[k]
        thickness = min(faces.thickness[i], faces.thickness[j])
        stiffness = face_stiffness(law.strength, thickness, state[CHORD], law.depth)
        closing = _speed(row, ROW_N, work.new[a], work.new[b])
        sliding = 0.5 * (row[SLIDING] + _speed(row, ROW_T, work.new[a], work.new[b]))
        depth = row[DEPTH] + (h if state[PHASE] == REST else 0.5 * h) * closing
        force, slide = state[FORCE], state[FRICTION]
        result.touched[k] = result.touched[k] or force > 0.0
        for n in range(3):
            result.impulse[a, n] -= h * (force * row[ROW_N + n] + slide * row[ROW_T + n])
            result.impulse[b, n] -= h * (force * row[ROW_N + 3 + n] + slide * row[ROW_T + 3 + n])
        crushed = depth - force / (law.ratio * stiffness)
        if force > 0.0 and crushed > state[CRUSHED]:
            stored = 0.5 * (force * force - row[BEFORE] * row[BEFORE]) / (law.ratio * stiffness)
            work.dissipated[0] += max(0.5 * h * force * (row[CLOSING] + closing) - stored, 0.0)
            state[CRUSHED] = crushed
        if state[PHASE] == REST and force > 0.0:
            # At rest the depth follows the new velocity, and the place the mean of old and new: what lies between must not
            # become a force when the next sub-step is shorter.
            drift = 0.5 * h * (row[CLOSING] - closing)
            state[TOUCHED] += drift
            state[CRUSHED] += drift
        work.dissipated[0] += max(h * slide * sliding, 0.0)
        state[SINCE] += h
        nx, ny = row[NX], row[NY]
        fx, fy = force * nx - slide * ny, force * ny + slide * nx
        state[PUSH_X], state[PUSH_Y] = fx, fy
        state[TORQUE_1] = -(row[OFFSET] * fy - row[OFFSET + 1] * fx)
        state[TORQUE_2] = row[OFFSET + 2] * fy - row[OFFSET + 3] * fx
        if force == 0.0 and closing <= 0.0:
            state[PHASE], state[SPEED] = APART, closing
        elif state[PHASE] == REST:
            state[SPEED] = closing
            if closing > max(AGAIN, 2.0 * row[CLOSING]):
                state[PHASE], state[SINCE] = IMPACT, 0.0
        else:
            # What was unloaded and is struck again is an impact of its own.
            if force > 0.0 and row[BEFORE] == 0.0 and row[CLOSING] > AGAIN and state[SINCE] > h:
                state[SINCE], state[SPEED] = h, row[CLOSING]
            since = state[SINCE] * math.sqrt(max(work.stiffness[a] + work.stiffness[b], 0.0))
            slow = closing < max(IMPACT_OVER * state[SPEED], SLOW)
            if (slow and since > SETTLING) or (force > 0.0 and since > LASTS):
                state[PHASE], state[SPEED] = REST, closing


@borrower
def _record_peak(island: Island, pair_state: Floats, count: int, result: IslandResult, work: CrushingWorkspace) -> None:
    """Record the loads of the bonded bodies that contact presses harder in this sub-step than before in the step."""
    if count == 0:
        return
    body_of, bonded, harder = island.body_of, island.bonded, False
    work.size[:] = 0.0
    for f in range(count):
        k = work.active[f]
        size, impact = math.hypot(pair_state[k, PUSH_X], pair_state[k, PUSH_Y]), pair_state[k, PHASE] == IMPACT
        for b in (body_of[island.first[k]], body_of[island.second[k]]):
            work.size[b] += size
            # At rest loads change slowly, and are those of the end of the step.
            harder = harder or (bonded[b] and impact and work.size[b] > work.peak[b])
    if not harder:
        return
    work.contact_force[:, :] = 0.0
    for f in range(count):
        k = work.active[f]
        i, j, x, y = island.first[k], island.second[k], pair_state[k, PUSH_X], pair_state[k, PUSH_Y]
        work.contact_force[i, 0] -= x
        work.contact_force[i, 1] -= y
        work.contact_force[i, 2] += pair_state[k, TORQUE_1]
        work.contact_force[j, 0] += x
        work.contact_force[j, 1] += y
        work.contact_force[j, 2] += pair_state[k, TORQUE_2]
    record_loads(island, work.size, work.peak, work.new, work.middle, work.force, work.contact_force, result)
