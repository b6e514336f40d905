"""Sub-steps of islands whose bodies crush each other's faces: their length, and the course of each.

Free bodies go as far as most of their gap. An impact takes some 25 sub-steps, whatever the length of the time step. At rest a
sub-step takes up to a minute, the depth follows the new velocity alone (backward Euler), and the force is damped as much as lets
it come to its value without a swing: faces of a crack begin without force, though the ice bore it a moment before.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.anchors import (
    MOST_TURNS,
    add_floor_force,
    agree,
    drag_anchors,
    find_grip,
    find_stop,
    guess_stop,
    longest_sliding_step,
    rim_speed,
)
from riftberg.engines.quasi_static.contact.face_forces import (
    SLOW,
    CrushingLaw,
    allocate_crushing,
    copy_twists,
    find_faces,
    find_free_motion,
    find_mobilities,
    find_path_twists,
    record_peak,
    sweep_faces,
    unloading_rate,
    update_faces,
)
from riftberg.engines.quasi_static.contact.face_overlaps import find_overlaps
from riftberg.engines.quasi_static.contact.face_pairs import (
    CrushingWorkspace,
    Faces,
    Seams,
    allocate_pair,
    find_pair_gap,
    locate_pair,
)
from riftberg.engines.quasi_static.contact.face_states import (
    APART,
    AREA_AT_END,
    CHORD,
    CLOSING_SPEED,
    CRUSHED,
    FORCE,
    IMPACT,
    PHASE,
    REST,
    SKIN_X,
    SKIN_Y,
    SPEED,
    TOUCHED,
    set_apart,
)
from riftberg.engines.quasi_static.contact.islands import (
    Island,
    IslandResult,
    Islands,
    Linearisation,
    accumulate_floor_impulse,
    accumulate_impulse,
    allocate_linearisation,
    approach_bound,
    evaluate_media,
    is_stale,
    linearised_force,
    select_island,
    select_result,
    spin_lever,
)
from riftberg.physics.contact import face_stiffness
from riftberg.state import Floats

IMPACT_PHASE: Final = 0.1
"""Sub-step of an impact times its angular frequency, rad."""

UNLOADING_PHASE: Final = 0.3
"""The same from where it turns, by the frequency of unloading: with both the restitution is 0.101 in place of 0.100."""

ENTRY_PHASE: Final = 0.06
"""The same just before touching, for a face that is entered unseen."""

GAP_PART: Final = 0.9
"""Part of the gap that is crossed at most in a sub-step."""

SKIN: Final = 0.01
"""Gap (m) up to which faces stand on each other. The faces of a crack do, and meet a force at once when driven together."""

UNSEEN, UNSEEN_OF_SIZE = 0.1, 5e-4
"""Way by which faces that part in one place may close in another within a sub-step: in m, and as a part of their size.

Chosen: the longer the way, the fewer sub-steps. With 0.1 m alone A68a breaks into the same pieces at the same minutes.
"""

REST_STEP: Final = 60.0
"""Longest sub-step of faces that overlap, s."""

REST_WAY: Final = 0.5
"""Way (m) by which they are driven into each other at most within it: a small part of the depth of crushing."""


@kernel
def integrate_faces(
    lists: Islands,
    all_islands: Island,
    results: IslandResult,
    faces: Faces,
    face_state: Floats,
    dt: float,
    law: CrushingLaw,
) -> tuple[float, float]:
    """Take all islands through a step of ``dt`` s; returns the shortest sub-step (s) and the energy dissipated (J).

    ``results``, and ``face_state`` with a row for each face, are changed in place.
    """
    shortest, dissipated, pair = dt, 0.0, allocate_pair(faces)
    for k in range(lists.start.size - 1):
        e, pairs = slice(lists.row_start[k], lists.row_start[k + 1]), (lists.pair_start[k], lists.pair_start[k + 1])
        first, end = faces.start[pairs[0]], faces.start[pairs[1]]
        island, result = select_island(lists, k, all_islands), select_result(lists, k, results)
        work = allocate_crushing(island, end - first, pair)
        seams = Seams(faces.seams.begin[e], faces.seams.end[e], faces.seams.polygon, faces.seams.point)
        island_faces = Faces(
            faces.begin[e], faces.end[e], faces.ring, faces.corner, faces.reach[e], faces.thickness[e], seams,
            faces.start[pairs[0] : pairs[1] + 1] - first,
        )  # fmt: skip
        for i in range(island.body_of.size):
            m, a = island.levers[i], island.body_of[i]
            work.arm[a] = max(work.arm[a], math.hypot(m[2], m[5]) + island_faces.reach[i])
        media = allocate_linearisation(result.twist)
        shortest = min(
            shortest, _integrate_island(island, island_faces, face_state[first:end], result, media, dt, law, work)
        )
        dissipated += work.dissipated[0]
    return shortest, dissipated


@borrower
def _integrate_island(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, media: Linearisation, dt: float, law: CrushingLaw,
    work: CrushingWorkspace,
) -> float:  # fmt: skip
    """Take one island through the step; returns its shortest sub-step, s."""
    twist = result.twist
    remaining, shortest, elapsed, h = dt, dt, np.inf, np.inf
    _align(island, faces, face_state, result, law, work)
    while True:
        if remaining <= 0.0 or is_stale(media, twist, work.arm, elapsed, dt):
            accumulate_impulse(island, media, elapsed, result.applied)
            if remaining <= 0.0:
                _remember_depths(island, faces, face_state, result, work)
                _find_close_pairs(island, faces, result, work)
                return shortest
            evaluate_media(island, twist, media, work.everyone, work.accelerations, work.drag_rate, work.force)
            elapsed = 0.0
        linearised_force(media, twist, work.net_force)
        add_floor_force(result.anchors, island.body_of, island.levers, work.net_force)
        if remaining == dt:
            _find_undisturbed_path(island, twist, dt, work)
            guess_stop(
                result.anchors, island.body_of, island.matrices.mobility, work.net_force, twist, work.arm, work.stop,
                work.patches, work.scratch,
            )  # fmt: skip
        sliding = longest_sliding_step(result.anchors, island.body_of, twist, work.arm, work.stop, h)
        h = _longest_substep(island, faces, face_state, result, min(remaining, sliding), h, law, work)
        if remaining - h < 1e-9 * dt:
            h = remaining
        shortest = min(shortest, h)
        overlaps = _find_velocities(island, faces, face_state, result, media.jacobian, h, law, work)
        find_path_twists(island, face_state, overlaps, twist, work)
        update_faces(island, faces, face_state, overlaps, h, law, work, result)
        drag_anchors(
            result.anchors, island.body_of, island.levers, h, work.grip, work.new, work.path_twist, result.rubbed, work.scratch
        )  # fmt: skip
        find_stop(work.floor, h, twist, work.new, work.arm, work.stop)
        record_peak(island, face_state, overlaps, dt - remaining + h, result, work)
        for b in range(twist.shape[0]):
            for i in range(3):
                media.twist_integral[b, i] += 0.5 * h * (twist[b, i] + work.new[b, i])
                result.path[b, i] += h * work.path_twist[b, i]
                twist[b, i] = work.new[b, i]
            work.travelled[b] += h * rim_speed(work.path_twist[b], work.arm[b])
        accumulate_floor_impulse(island, result.anchors, h, result.applied)
        elapsed += h
        remaining = remaining - h if remaining > h else 0.0


@borrower
def _find_velocities(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, jacobian: Floats, h: float, law: CrushingLaw,
    work: CrushingWorkspace,
) -> int:  # fmt: skip
    """Find the twists at the end of a sub-step and the forces of the faces that overlap; returns how many do.

    By turns: the grip of the floor at the last twists, and the forces of the faces with it.
    """
    twist, count = result.twist, 0
    for b in range(twist.shape[0]):
        for i in range(3):
            work.middle[b, i] = result.path[b, i] + 0.5 * h * twist[b, i]
            work.new[b, i] = twist[b, i]
    for turn in range(MOST_TURNS):
        copy_twists(work.new, work.guess)
        aground = find_grip(
            result.anchors, island.body_of, island.levers, h, twist, work.guess, work.floor, work.floor_force, work.floor_drag,
            work.grip, work.patches, work.scratch,
        )  # fmt: skip
        find_free_motion(island, jacobian, h, twist, work)
        if turn == 0:
            count = find_faces(island, faces, face_state, result, h, law, work)
        find_mobilities(island, faces, face_state, count, h, law, work)
        sweep_faces(island, faces, face_state, count, h, law, work)
        if not aground or agree(work.guess, work.new, work.arm):
            break
    return count


@borrower
def _align(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, law: CrushingLaw, work: CrushingWorkspace
) -> None:
    """Take the faces on from where the last step saw them: no force from an overlap that has changed without a motion.

    A sub-step moves bodies on a plane of its own, a step on the sphere: that shifts faces by millimetres, of which unloading
    would make the force of an impact. The overlap that a sub-step predicts for its end is wrong by less, but an impact that
    is cut there would lose a part of its force for a moment.
    """
    for k in range(island.first.size):
        if not _is_in_contact(faces, face_state, k):
            continue
        for n in range(faces.start[k], faces.start[k + 1]):
            if face_state[n, PHASE] != APART:
                work.face_of[n] = n - faces.start[k]
                work.skin[k, 0], work.skin[k, 1] = face_state[n, SKIN_X], face_state[n, SKIN_Y]
        find_overlaps(island, faces, face_state, result.path, k, work)
        thickness = min(faces.thickness[island.first[k]], faces.thickness[island.second[k]])
        for n in range(faces.start[k], faces.start[k + 1]):
            state, area = face_state[n], work.pair.overlap[n - faces.start[k], 0]
            if state[PHASE] != APART:
                shift = area - state[AREA_AT_END]
                state[TOUCHED] += shift
                state[CRUSHED] += shift
                if state[PHASE] == IMPACT and state[FORCE] > 0.0:
                    state[CRUSHED] = area - state[FORCE] / unloading_rate(thickness, law)


@borrower
def _remember_depths(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, work: CrushingWorkspace
) -> None:
    """Note how deep the faces are at the end of a step, and the skin with which they overlap."""
    for k in range(island.first.size):
        if _is_in_contact(faces, face_state, k):
            find_overlaps(island, faces, face_state, result.path, k, work)
            for n in range(faces.start[k], faces.start[k + 1]):
                face_state[n, AREA_AT_END] = work.pair.overlap[n - faces.start[k], 0]
                face_state[n, SKIN_X], face_state[n, SKIN_Y] = work.skin[k, 0], work.skin[k, 1]


@kernel
def _is_in_contact(faces: Faces, face_state: Floats, k: int) -> bool:
    """Whether any face of a pair is in contact."""
    in_contact = False
    for n in range(faces.start[k], faces.start[k + 1]):
        in_contact = in_contact or face_state[n, PHASE] != APART
    return in_contact


@kernel
def _find_undisturbed_path(island: Island, twist: Floats, dt: float, work: CrushingWorkspace) -> None:
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
        deviation = math.hypot(dx, dy) + (abs(alone[a, 2] - path[a, 2]) + abs(alone[b, 2] - path[b, 2])) * reach
        _, _, _, _, x1, y1, x2, y2 = locate_pair(island, path, k)
        if not result.touched[k] and math.hypot(x1 - x2, y1 - y2) < reach + deviation:
            result.close[k] = find_pair_gap(island, faces, path, k, work)[0] < deviation


@borrower
def _longest_substep(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, longest: float, last_step: float, law: CrushingLaw,
    work: CrushingWorkspace,
) -> float:  # fmt: skip
    """Find the longest sub-step (s): by the gaps of the bodies that may meet, and by the frequency of those that do.

    ``longest``: limit by all else, s; ``last_step``: the previous sub-step, s.
    """
    twist, mobility, limit = result.twist, island.matrices.mobility, longest
    for b in range(twist.shape[0]):
        work.stiffness[b] = 0.0
        for i in range(3):
            work.acceleration[b, i] = 0.0
            for j in range(3):
                work.acceleration[b, i] += mobility[b, i, j] * work.net_force[b, j]
        work.speed[b, 0] = rim_speed(twist[b], work.arm[b])
        work.speed[b, 1] = rim_speed(work.acceleration[b], work.arm[b])
    fastest, quickest = approach_bound(twist, work.arm), approach_bound(work.acceleration, work.arm)
    for k in range(island.first.size):
        rests = strikes = False
        for n in range(faces.start[k], faces.start[k + 1]):
            rests = rests or face_state[n, PHASE] == REST
            strikes = strikes or face_state[n, PHASE] == IMPACT
        if not (rests or strikes):
            work.skin[k, 0] = work.skin[k, 1] = 0.0
        if (strikes or not rests) and not _stays_apart(island, k, limit, work):
            far = faces.reach[island.first[k]] + faces.reach[island.second[k]]
            far += limit * (fastest + 0.5 * limit * quickest)
            limit = _limit_substep(island, faces, face_state, result, k, far, limit, last_step, law, work)
        if rests:
            # Whether they still overlap shows in the middle; the forces of the sub-step before are the first guess.
            work.gap[k], work.bound[k], limit = 0.0, 0.0, min(limit, REST_STEP, 2.0 * last_step)
            for n in range(faces.start[k], faces.start[k + 1]):
                if face_state[n, PHASE] == REST and face_state[n, SPEED] * limit > REST_WAY:
                    limit = REST_WAY / face_state[n, SPEED]
    # Impacts share the stiffness of their bodies, so that it is known once all pairs have been seen.
    for k in range(island.first.size):
        i, j = island.first[k], island.second[k]
        frequency = math.sqrt(work.stiffness[island.body_of[i]] + work.stiffness[island.body_of[j]])
        for n in range(faces.start[k], faces.start[k + 1]):
            state = face_state[n]
            if state[PHASE] == IMPACT and state[FORCE] > 0.0 and frequency > 0.0:
                depth = state[FORCE] / face_stiffness(
                    law.strength, min(faces.thickness[i], faces.thickness[j]), state[CHORD], law.depth
                )
                limit = min(limit, IMPACT_PHASE / frequency)
                if state[CLOSING_SPEED] < IMPACT_PHASE * frequency * depth:  # it turns, or opens
                    limit = min(limit, UNLOADING_PHASE / (frequency * math.sqrt(law.ratio)))
    return limit


@borrower
def _stays_apart(island: Island, k: int, limit: float, work: CrushingWorkspace) -> bool:
    """Whether a pair cannot have crossed its gap since measured, nor can within ``limit`` s: it need not be measured again."""
    a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
    least_gap = work.measured[k, 0] - (work.travelled[a] + work.travelled[b] - work.measured[k, 1])
    if least_gap <= SKIN:
        return False
    closing, driven = work.speed[a, 0] + work.speed[b, 0], work.speed[a, 1] + work.speed[b, 1]
    work.gap[k], work.bound[k] = least_gap, closing + driven * limit
    return _crossing_time(least_gap, closing, driven)[0] >= limit


# Many arguments: the bounds of all pairs, which the caller has found.
@borrower
def _limit_substep(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, k: int, far: float, limit: float, last_step: float,
    law: CrushingLaw, work: CrushingWorkspace,
) -> float:  # fmt: skip
    """Measure the gap of a pair that does not rest alone; returns the longest sub-step (s) that it allows, at most ``limit``.

    ``far``: distance (m) from which on the elements cannot meet within ``limit``.
    """
    twist, path, mobility = result.twist, result.path, island.matrices.mobility
    i, j = island.first[k], island.second[k]
    m, n, a, b = island.levers[i], island.levers[j], island.body_of[i], island.body_of[j]
    work.gap[k] = np.inf
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    rx, ry = x1 - x2, y1 - y2
    if math.hypot(rx, ry) > far:
        _set_pair_apart(faces, face_state, k)
        return limit
    nearest, nx, ny = find_pair_gap(island, faces, path, k, work)
    work.measured[k, 0], work.measured[k, 1] = nearest, work.travelled[a] + work.travelled[b]

    # Closing speed and acceleration. They meet in a point of the smaller one; two of equal size meet about the middle.
    # Two bodies that turn together do not meet.
    mx, my = spin_lever(m, ca, sa)
    ox, oy = spin_lever(n, cb, sb)
    weight_1, weight_2 = faces.reach[i] ** 4, faces.reach[j] ** 4
    share, smaller = weight_1 / (weight_1 + weight_2), min(faces.reach[i], faces.reach[j])
    du, dv = _relative_velocity(m, twist[a], n, twist[b], mx, my, ox, oy, rx, ry, share)
    closing = max(nx * du + ny * dv, 0.0) + abs(twist[a, 2] - twist[b, 2]) * smaller
    acceleration_1, acceleration_2 = work.acceleration[a], work.acceleration[b]
    au, av = _relative_velocity(m, acceleration_1, n, acceleration_2, mx, my, ox, oy, rx, ry, share)
    driven = math.hypot(au, av) + abs(acceleration_1[2] - acceleration_2[2]) * smaller
    thickness, inverse = min(faces.thickness[i], faces.thickness[j]), 0.0
    for body in (a, b):
        inverse += max(mobility[body, 0, 0], mobility[body, 1, 1])
    if inverse == 0.0:  # both are held
        return limit
    # Without contact the length of the face is unknown: take the length of an element.
    entry = ENTRY_PHASE / math.sqrt(face_stiffness(law.strength, thickness, smaller, law.depth) * inverse)

    free, parting = not _is_in_contact(faces, face_state, k), False
    for f in range(faces.start[k], faces.start[k + 1]):
        parting = parting or face_state[f, SPEED] < 0.0
    if nearest <= SKIN and free and (closing <= SLOW or parting):
        # They stand on each other, or part: whatever drives them together, the force of the sub-step answers.
        work.gap[k], work.bound[k] = 0.0, 0.0
        work.skin[k, 0], work.skin[k, 1] = 0.5 * SKIN * nx, 0.5 * SKIN * ny
        if closing > SLOW:  # they part where they stand on each other, and turn into each other beside it
            limit = min(limit, max(max(UNSEEN, UNSEEN_OF_SIZE * smaller) / closing, entry))
        return min(limit, REST_STEP)
    if nearest > 2.0 * math.hypot(work.skin[k, 0], work.skin[k, 1]):
        _set_pair_apart(faces, face_state, k)
        work.gap[k], work.bound[k] = nearest, closing + driven * limit
        crossed, meets = _crossing_time(nearest, closing, driven)
        return min(limit, max(crossed, entry if meets > SLOW else REST_STEP))
    work.gap[k], work.bound[k] = 0.0, 0.0
    if free:
        return min(limit, entry)
    limit = min(limit, REST_STEP, 2.0 * last_step)  # the forces of the sub-step before are the first guess
    mobility_1, mobility_2 = (
        _point_mobility(mobility[a], m, mx, my, nx, ny),
        _point_mobility(mobility[b], n, ox, oy, nx, ny),
    )
    unloaded = False
    for f in range(faces.start[k], faces.start[k + 1]):
        unloaded = unloaded or (face_state[f, PHASE] == IMPACT and face_state[f, FORCE] <= 0.0)
    if unloaded:
        find_overlaps(island, faces, face_state, path, k, work)
    for f in range(faces.start[k], faces.start[k + 1]):
        state = face_state[f]
        if state[PHASE] == IMPACT:
            # An impact off the centre turns the body, too: it gives way by up to four times as much.
            stiffness = face_stiffness(law.strength, thickness, state[CHORD], law.depth)
            work.stiffness[a] += stiffness * mobility_1
            work.stiffness[b] += stiffness * mobility_2
            if state[FORCE] <= 0.0:
                # Unloaded, but closing: nothing happens before the depth to which the faces are crushed.
                to_go = max(state[CRUSHED] - work.pair.overlap[f - faces.start[k], 0], 0.0) / state[CHORD]
                limit = min(limit, max(_crossing_time(to_go, closing, driven)[0], entry))
    return limit


@kernel
def _set_pair_apart(faces: Faces, face_state: Floats, k: int) -> None:
    """End the contact of all faces of a pair."""
    for n in range(faces.start[k], faces.start[k + 1]):
        set_apart(face_state[n])


@kernel
def _crossing_time(distance: float, closing: float, driven: float) -> tuple[float, float]:
    """Time (s) in which no more than `GAP_PART` of a way (m) is crossed, and the speed (m s-1) at its end.

    The way is crossed no sooner than after the smallest root t of way = closing t + driven t^2 / 2.
    """
    meets = math.sqrt(closing * closing + 2.0 * driven * distance)
    return GAP_PART * 2.0 * distance / (closing + meets) if meets > 0.0 else math.inf, meets


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


@kernel
def _point_mobility(mobility: Floats, m: Floats, mx: float, my: float, nx: float, ny: float) -> float:
    """Change of the velocity of an element along a normal by a unit impulse there, kg-1."""
    r0, r1, r2 = nx * m[0] + ny * m[3], nx * m[1] + ny * m[4], nx * mx + ny * my
    return float(
        r0 * (mobility[0, 0] * r0 + mobility[0, 1] * r1 + mobility[0, 2] * r2)
        + r1 * (mobility[1, 0] * r0 + mobility[1, 1] * r1 + mobility[1, 2] * r2)
        + r2 * (mobility[2, 0] * r0 + mobility[2, 1] * r1 + mobility[2, 2] * r2)
    )
