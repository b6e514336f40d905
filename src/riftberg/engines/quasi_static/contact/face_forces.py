"""Forces between faces that crush each other, over one sub-step of an island (`riftberg.physics.contact`).

    M (V1 - V0) = h (G(V) - sum J^T F(V1))

with the media G as in `riftberg.engines.quasi_static.contact.islands`, and the forces F of the faces: at rest at the depth to
which the new velocities lead, in an impact at that to which the mean of old and new leads in the middle. Normals, lever arms
and overlaps are taken at the predicted middle, at one common point for both bodies, so momentum and angular momentum hold to
rounding. The law is monotone, so sweeps over the faces find the velocities, and Newton's method where they are slow
(`riftberg.engines.quasi_static.contact.face_newton`).

A sub-step goes through this file from top to bottom: velocities without contact, the faces that overlap, their forces, the
crushing by these, and the loads of the hardest push.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.anchors import HELD
from riftberg.engines.quasi_static.contact.face_newton import (
    CLOSING_NOW,
    CRUSHING,
    DRAG,
    LOADING,
    LOADING_RATE,
    MOST_ITERATIONS,
    NEXT_CLOSING,
    NEXT_SLIDING,
    PUSH,
    SHEAR_RATE,
    SLIDING_NOW,
    STICKING,
    UNLOADING,
    UNLOADING_RATE,
    add_face,
    allocate_newton,
    approach_solution,
    begin_system,
    find_pieces,
    solve_system,
)
from riftberg.engines.quasi_static.contact.face_overlaps import find_overlaps
from riftberg.engines.quasi_static.contact.face_pairs import (
    CrushingWorkspace,
    Faces,
    PairWorkspace,
    locate_pair,
)
from riftberg.engines.quasi_static.contact.face_states import (
    APART,
    CHORD,
    CLOSING_SPEED,
    CRUSHED,
    FORCE,
    FRICTION,
    IMPACT,
    PHASE,
    PUSH_X,
    PUSH_Y,
    REST,
    SINCE,
    SPEED,
    TORQUE_1,
    TORQUE_2,
    TOUCHED,
    set_apart,
)
from riftberg.engines.quasi_static.contact.islands import Island, IslandResult, record_loads, spin_lever
from riftberg.engines.quasi_static.keel_friction import allocate_patches
from riftberg.physics.contact import crushing_force, face_stiffness, sliding_force
from riftberg.physics.geometry import solve
from riftberg.state import Floats

SLOW: Final = 2e-3
"""Speed (m s-1) up to which faces touch without an impact."""

STRUCK_AT_REST: Final = 10e-3
"""Closing speed (m s-1) at which rest becomes an impact, if it has doubled within a sub-step: something struck."""

IMPACT_OVER: Final = 0.02
"""Part of the speed of touching below which an impact comes to rest, `SETTLING_TIME` over the frequency after touching."""

SETTLING_TIME: Final = 3.0
"""Time after touching, over the frequency of the faces, from which on an impact may have come to rest: about half a period."""

LONGEST_IMPACT: Final = 10.0
"""An impact takes at most this time over its frequency: it loads for half of pi of it. A longer push is driven, as at rest."""

SEAT: Final = 0.05
"""Depth (m) beyond that of loading to which faces at rest dent each other as they rock: the elastic depth of a small berg
would be too shallow a seat for sub-steps of a minute."""

LEAST_CHORD: Final = 1e-6
"""Square of the chord of an overlap over its area, below which one face lies wholly in the other.

Round-off leaves some 1e-30; an overlap that opens to one side has 1 and more until it is deeper than wide.
"""

LEAST_FACE: Final = 1.0
"""Chord (m) from which on faces can stand on each other."""

MAX_SWEEPS: Final = 400
"""Sweeps over the faces; impulses are equal and opposite after each of them, so momentum does not depend on their number."""

SWEEPS_BY_NEWTON: Final = 10
"""Sweeps after which Newton's method takes all faces at once; those that follow say whether these are the forces, or find them.
It is tried once: the cone of friction moves with the forces, so that it may end beside the solution, to which sweeps lead."""

SWEEP_RTOL: Final = 1e-6
"""Change of the velocities in a sweep, as a part of the largest, at which the sweeps end: some 1e-7 m/s. Momentum holds whatever
this is; with 1e-8 steps of shattered bergs cost a tenth more."""

SHEAR_OVER_CRUSHING: Final = 10.0
"""Stiffness of a face along it over that of loading across it. Chosen: with 1 a brief impact would meet hardly any friction, and
with 100 faces nearly in line load the ice between them against each other (3 % more tension head on, rigid ones 3.3 times)."""


class CrushingLaw(NamedTuple):
    """Numbers of the law of faces."""

    strength: float  # Pa
    depth: float  # Over which it is reached, m
    ratio: float  # Stiffness of unloading over stiffness of loading
    friction: float


NX, NY, AREA, AREA_PER_SPEED, ROW_N, ROW_T = 0, 1, 2, 3, 4, 10
MOBILITY_N, MOBILITY_T, OFFSET, SLIDING, CLOSING = 16, 17, 18, 22, 23
LAST_FORCE, LAST_FRICTION, KICK_N, KICK_T = 24, 25, 26, 32
"""Columns of ``face``."""


@kernel
def allocate_crushing(island: Island, room: int, pair: PairWorkspace) -> CrushingWorkspace:
    """Return a workspace for an island with ``room`` for faces; ``pair``: of `allocate_pair`."""
    bodies, pairs, rows = island.bonded.size, island.first.size, island.body_of.size
    return CrushingWorkspace(
        np.empty((bodies, 3)), np.zeros(bodies), np.empty((bodies, 3)), np.empty((bodies, 3, 3)), np.empty((bodies, 3)),
        np.empty((bodies, 3)), np.empty((bodies, 3)), np.empty(bodies), np.empty(bodies), np.zeros(bodies), np.zeros(bodies),
        np.empty((bodies, 2)), np.full((pairs, 2), -np.inf), np.empty(pairs), np.zeros((pairs, 2)), np.empty(pairs),
        np.empty(bodies, np.int64), np.full(room, -1, np.int64), np.empty(room, np.int64), np.empty(room, np.int64),
        np.empty((room, 38)),
        np.zeros((rows, island.forcing.media.shape[1] + 1, 2)), np.zeros((rows, 3)), np.zeros((rows, 3)), np.zeros((bodies, 3)),
        np.zeros((rows, 3)), np.ones(bodies, np.bool_), np.zeros(bodies, np.bool_),
        pair,
        np.empty((4, 3, 3)), np.zeros(1), np.zeros((bodies, 3)), np.zeros((bodies, 3, 3)), np.empty((rows, 3, 3)),
        allocate_patches(), np.empty((bodies, 3)), np.zeros(bodies, np.int64), np.full(bodies, np.inf),
        allocate_newton(bodies, room),
    )  # fmt: skip


@kernel
def unloading_rate(thickness: float, law: CrushingLaw) -> float:
    """Force (N m-2) that a face loses with its overlap as it is unloaded; ``thickness`` (m): of the thinner element."""
    return law.ratio * law.strength * thickness / law.depth


@kernel
def shear_stiffness(thickness: float, chord: float, law: CrushingLaw) -> float:
    """Stiffness (N m-1) along a face of a chord (m); ``thickness`` (m): of the thinner element."""
    return SHEAR_OVER_CRUSHING * face_stiffness(law.strength, thickness, chord, law.depth)


@borrower
def find_free_motion(island: Island, jacobian: Floats, h: float, twist: Floats, work: CrushingWorkspace) -> None:
    """Velocities at the end of a sub-step without contact, and the compliance of each body with its media and the floor."""
    mobility, compliance = island.matrices.mobility, work.compliance
    matrix, x = work.scratch[0], work.scratch[1, 0]
    for b in range(twist.shape[0]):
        for i in range(3):
            for j in range(3):
                matrix[i, j] = 1.0 if i == j else 0.0
                for k in range(3):
                    drag = 0.5 * jacobian[b, k, j] + work.floor_drag[b, k, j]
                    matrix[i, j] += h * mobility[b, i, k] * drag
        for j in range(3):
            for i in range(3):
                x[i] = mobility[b, i, j]
            compliance[b, 0, j], compliance[b, 1, j], compliance[b, 2, j] = solve(matrix, x)
        for i in range(3):
            work.new[b, i] = twist[b, i]
            for j in range(3):
                work.new[b, i] += h * compliance[b, i, j] * (work.net_force[b, j] + work.floor_force[b, j])


@borrower
def find_faces(
    island: Island, faces: Faces, face_state: Floats, result: IslandResult, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> int:  # fmt: skip
    """Find the faces that overlap at the predicted middle, and begin or end their contact; returns their number."""
    count, path, twist = 0, work.middle, result.twist
    for k in range(island.first.size):
        if work.gap[k] > 0.5 * h * work.bound[k]:
            continue
        i, j = island.first[k], island.second[k]
        a, b = island.body_of[i], island.body_of[j]
        find_overlaps(island, faces, face_state, path, k, work)
        standing, rested = work.skin[k, 0] != 0.0 or work.skin[k, 1] != 0.0, _longest_rest(faces, face_state, k)
        for n in range(faces.start[k], faces.start[k + 1]):
            state, overlap = face_state[n], work.pair.overlap[n - faces.start[k]]
            area, chord = overlap[0], math.hypot(overlap[3], overlap[4])
            if standing and chord < LEAST_FACE and state[PHASE] == APART:  # a corner, until it is in the other face
                continue
            if not (area > 0.0 and chord * chord > LEAST_CHORD * area):
                set_apart(state)
                if area > 0.0:
                    # One lies wholly in the other: its chord closes to nothing but round-off, and nothing says which way is
                    # out. It is no limit to the sub-steps.
                    state[SPEED] = -np.inf
                continue
            row = work.face[count]
            _fill_levers(row, island, path, k, overlap, chord)
            closing = _speed(row, ROW_N, twist[a], twist[b])
            if state[PHASE] == APART:
                # Faces meet where they stand at the start of the sub-step: ice crushed earlier is rubble that fills the gap.
                # Where one is at rest, another is no impact, and bears load as long.
                state[PHASE] = IMPACT if closing > (STRUCK_AT_REST if standing or rested > 0.0 else SLOW) else REST
                state[TOUCHED] = max(area - 0.5 * h * closing * chord, 0.0)
                state[CRUSHED] = state[TOUCHED]
                state[SINCE] = rested if state[PHASE] == REST else 0.0
                state[SPEED], state[FORCE], state[FRICTION] = closing, 0.0, 0.0
            state[CHORD] = chord
            row[SLIDING], row[CLOSING] = _speed(row, ROW_T, twist[a], twist[b]), closing
            row[LAST_FORCE], row[LAST_FRICTION] = state[FORCE], state[FRICTION]
            # The old velocity leads to this middle; at rest the new one takes its place, in an impact the mean of both.
            row[AREA] = area - (0.5 if state[PHASE] == REST else 0.25) * h * closing * chord
            if _mobility_along(row, ROW_N, work.compliance[a], work.compliance[b]) > 0.0:  # else both are held
                work.active[count], work.active_pair[count] = n, k
                count += 1
    return count


@kernel
def _longest_rest(faces: Faces, face_state: Floats, k: int) -> float:
    """Time (s) for which faces of a pair have been at rest at most."""
    longest = 0.0
    for n in range(faces.start[k], faces.start[k + 1]):
        if face_state[n, PHASE] == REST:
            longest = max(longest, face_state[n, SINCE])
    return longest


@borrower
def _fill_levers(row: Floats, island: Island, path: Floats, k: int, overlap: Floats, chord: float) -> None:
    """Find the normal of a face of a pair, and the levers of both bodies at its middle."""
    m, n = island.levers[island.first[k]], island.levers[island.second[k]]
    ca, sa, cb, sb, x1, y1, x2, y2 = locate_pair(island, path, k)
    area, moment_x, moment_y, chord_x, chord_y = overlap[0], overlap[1], overlap[2], overlap[3], overlap[4]
    nx, ny, x, y = chord_y / chord, -chord_x / chord, moment_x / area, moment_y / area
    mx, my = spin_lever(m, ca, sa)
    qx, qy = spin_lever(n, cb, sb)
    c, s = island.turn[k, 0], island.turn[k, 1]
    _fill_row(row, ROW_N, 1.0, m, mx, my, c, s, x - x1, y - y1, nx, ny)
    _fill_row(row, ROW_N + 3, -1.0, n, qx, qy, c, -s, x - x2, y - y2, nx, ny)
    _fill_row(row, ROW_T, 1.0, m, mx, my, c, s, x - x1, y - y1, -ny, nx)
    _fill_row(row, ROW_T + 3, -1.0, n, qx, qy, c, -s, x - x2, y - y2, -ny, nx)
    row[NX], row[NY], row[OFFSET], row[OFFSET + 1] = nx, ny, x - x1, y - y1
    row[OFFSET + 2], row[OFFSET + 3] = x - x2, y - y2


@borrower
def find_mobilities(
    island: Island, faces: Faces, face_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> None:  # fmt: skip
    """Find how the bodies give way to the faces that overlap."""
    for f in range(count):
        n, k, row = work.active[f], work.active_pair[f], work.face[f]
        i, j, chord = island.first[k], island.second[k], face_state[n, CHORD]
        compliance_1, compliance_2 = work.compliance[island.body_of[i]], work.compliance[island.body_of[j]]
        _fill_kick(row, ROW_N, KICK_N, compliance_1, compliance_2)
        _fill_kick(row, ROW_T, KICK_T, compliance_1, compliance_2)
        row[MOBILITY_N] = row[MOBILITY_T] = 0.0
        for c in range(6):
            row[MOBILITY_N] += row[ROW_N + c] * row[KICK_N + c]
            row[MOBILITY_T] += row[ROW_T + c] * row[KICK_T + c]
        row[AREA_PER_SPEED] = 0.25 * h * chord
        if face_state[n, PHASE] == REST:
            stiffness = face_stiffness(law.strength, min(faces.thickness[i], faces.thickness[j]), chord, law.depth)
            row[AREA_PER_SPEED] = chord * (h + 2.0 / math.sqrt(stiffness * row[MOBILITY_N]))


# Many arguments: a tuple of them would be made for each row.
@kernel
def _fill_row(
    row: Floats, column: int, sign: float, m: Floats, mx: float, my: float, c: float, s: float, ox: float, oy: float, ux: float,
    uy: float,
) -> None:  # fmt: skip
    """Levers of a point at (ox, oy) from an element, along (ux, uy), of three freedoms.

    (mx, my): lever of the spin. ``c``, ``s``: cosine and sine of the angle from these axes to those of the levers ``m``.
    """
    vx, vy = c * ux + s * uy, c * uy - s * ux
    turning = ox * uy - oy * ux
    row[column] = sign * (vx * m[0] + vy * m[3] + turning * m[6])
    row[column + 1] = sign * (vx * m[1] + vy * m[4] + turning * m[7])
    row[column + 2] = sign * (ux * mx + uy * my + turning * m[8])


@kernel
def _fill_kick(row: Floats, column: int, kick: int, compliance_1: Floats, compliance_2: Floats) -> None:
    """Find the changes of the velocities of both bodies by a unit impulse along a row."""
    for i in range(3):
        row[kick + i] = row[kick + 3 + i] = 0.0
        for j in range(3):
            row[kick + i] += compliance_1[i, j] * row[column + j]
            row[kick + 3 + i] += compliance_2[i, j] * row[column + 3 + j]


@kernel
def _mobility_along(row: Floats, column: int, compliance_1: Floats, compliance_2: Floats) -> float:
    """Change of the speed along a row by a unit impulse along it, kg-1."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += (
                row[column + i] * compliance_1[i, j] * row[column + j]
                + row[column + 3 + i] * compliance_2[i, j] * row[column + 3 + j]
            )
    return total


@kernel
def _speed(row: Floats, column: int, v: Floats, w: Floats) -> float:
    """Speed (m s-1) along a row of levers of both bodies."""
    return float(
        row[column] * v[0]
        + row[column + 1] * v[1]
        + row[column + 2] * v[2]
        + row[column + 3] * w[0]
        + row[column + 4] * w[1]
        + row[column + 5] * w[2]
    )


@borrower
def sweep_faces(
    island: Island, faces: Faces, face_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> None:
    """Find the forces of the faces and the velocities that they lead to (projected Gauss-Seidel)."""
    scale = 1e-9
    for f in range(count):
        k, row = work.active_pair[f], work.face[f]
        a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
        scale = max(scale, abs(_speed(row, ROW_N, work.new[a], work.new[b])), abs(row[SLIDING]))
    copy_twists(work.new, work.newton.free)
    _push_all(island, face_state, count, h, work)  # the forces of the sub-step before are a first guess
    work.changed[:] = 0
    for sweep in range(1, MAX_SWEEPS + 1):
        if sweep == SWEEPS_BY_NEWTON and work.newton.right.shape[0] > 0:
            _solve_for_forces(island, faces, face_state, count, h, law, work)
            work.changed[:] = sweep
        largest_change = 0.0
        for f in range(count):
            n, k, row = work.active[f], work.active_pair[f], work.face[f]
            i, j = island.first[k], island.second[k]
            a, b, state = island.body_of[i], island.body_of[j], face_state[n]
            # Where neither body has changed since its last turn, a face has nothing to add: clusters converge each by itself.
            if max(work.changed[a], work.changed[b]) < sweep - 1:
                continue
            largest = 0.0
            v, w = work.new[a], work.new[b]
            thickness = min(faces.thickness[i], faces.thickness[j])
            mobility = h * row[MOBILITY_N]
            free = _speed(row, ROW_N, v, w) + mobility * state[FORCE]
            force = crushing_force(
                row[AREA] + row[AREA_PER_SPEED] * free, state[TOUCHED], state[CRUSHED], law.strength * thickness / law.depth,
                law.ratio, law.strength * thickness * state[CHORD], row[AREA_PER_SPEED] * mobility,
            )  # fmt: skip
            change = force - state[FORCE]
            state[FORCE] = force
            _push(row, KICK_N, h * change, v, w)
            largest = max(largest, abs(mobility * change))
            if law.friction > 0.0:
                mobility = h * row[MOBILITY_T]
                free = _speed(row, ROW_T, v, w) + mobility * state[FRICTION]
                stiffness = shear_stiffness(thickness, state[CHORD], law)
                slide = sliding_force(row[LAST_FRICTION], h * free, stiffness, h * mobility, law.friction * force)
                change = slide - state[FRICTION]
                state[FRICTION] = slide
                _push(row, KICK_T, h * change, v, w)
                largest = max(largest, abs(mobility * change))
            if largest > SWEEP_RTOL * scale:
                work.changed[a] = work.changed[b] = sweep
            largest_change = max(largest_change, largest)
        if largest_change <= SWEEP_RTOL * scale:
            return


@borrower
def _solve_for_forces(
    island: Island, faces: Faces, face_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace
) -> None:  # fmt: skip
    """Find the forces of all faces at once, by Newton's method from the present velocities."""
    newton, share = work.newton, 0.0
    for f in range(count):
        n, k, row = work.active[f], work.active_pair[f], work.face[f]
        _set_law(
            newton.law[f],
            row,
            face_state[n],
            min(faces.thickness[island.first[k]], faces.thickness[island.second[k]]),
            h,
            law,
        )
        newton.course[f, PUSH], newton.course[f, DRAG] = face_state[n, FORCE], face_state[n, FRICTION]
        newton.piece[f, 0] = newton.piece[f, 1] = -1
    _find_speeds(island, count, work, newton.course, CLOSING_NOW, SLIDING_NOW)
    for _ in range(MOST_ITERATIONS):
        if not find_pieces(newton, count, law.friction) and share == 1.0:
            break
        begin_system(newton)
        for f in range(count):
            k, row = work.active_pair[f], work.face[f]
            a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
            add_face(newton, f, row[ROW_N : ROW_N + 12], row[KICK_N : KICK_N + 12], a, b, h)
        solve_system(newton, work.new)
        _find_speeds(island, count, work, newton.course, NEXT_CLOSING, NEXT_SLIDING)
        share = approach_solution(newton, count, law.friction)
        if share == 0.0:
            break
    for f in range(count):
        state = face_state[work.active[f]]
        state[FORCE] = max(newton.course[f, PUSH], 0.0)
        most = law.friction * state[FORCE]
        state[FRICTION] = min(max(newton.course[f, DRAG], -most), most)
    copy_twists(newton.free, work.new)
    _push_all(island, face_state, count, h, work)


@kernel
def _set_law(out: Floats, row: Floats, state: Floats, thickness: float, h: float, law: CrushingLaw) -> None:
    """Write down the law of a face by its closing and sliding speed."""
    loading, unloading = law.strength * thickness / law.depth, unloading_rate(thickness, law)
    out[UNLOADING], out[UNLOADING_RATE] = unloading * (row[AREA] - state[CRUSHED]), unloading * row[AREA_PER_SPEED]
    out[LOADING], out[LOADING_RATE] = loading * (row[AREA] - state[TOUCHED]), loading * row[AREA_PER_SPEED]
    out[CRUSHING] = law.strength * thickness * state[CHORD]
    out[STICKING], out[SHEAR_RATE] = row[LAST_FRICTION], h * shear_stiffness(thickness, state[CHORD], law)


@borrower
def _find_speeds(island: Island, count: int, work: CrushingWorkspace, out: Floats, closing: int, sliding: int) -> None:
    """Put the closing and the sliding speed of each face into two columns."""
    for f in range(count):
        k, row = work.active_pair[f], work.face[f]
        v, w = work.new[island.body_of[island.first[k]]], work.new[island.body_of[island.second[k]]]
        out[f, closing], out[f, sliding] = _speed(row, ROW_N, v, w), _speed(row, ROW_T, v, w)


@borrower
def _push_all(island: Island, face_state: Floats, count: int, h: float, work: CrushingWorkspace) -> None:
    """Change the velocities by the forces of all faces."""
    for f in range(count):
        n, k, row = work.active[f], work.active_pair[f], work.face[f]
        a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
        _push(row, KICK_N, h * face_state[n, FORCE], work.new[a], work.new[b])
        _push(row, KICK_T, h * face_state[n, FRICTION], work.new[a], work.new[b])


@kernel
def copy_twists(twist: Floats, out: Floats) -> None:
    """Copy the twists of all bodies; without a loop numba would make an array between them."""
    for b in range(twist.shape[0]):
        for i in range(3):
            out[b, i] = twist[b, i]


@kernel
def _push(row: Floats, column: int, impulse: float, v: Floats, w: Floats) -> None:
    """Change the velocities of both bodies by an impulse against a row; ``column``: of their kicks by a unit impulse."""
    for i in range(3):
        v[i] -= impulse * row[column + i]
        w[i] -= impulse * row[column + 3 + i]


@borrower
def find_path_twists(island: Island, face_state: Floats, count: int, twist: Floats, work: CrushingWorkspace) -> None:
    """Find the twists by which bodies go through a sub-step: the mean of old and new; the new one of bodies at rest or held.

    At rest (pressed, and in no impact) a body then stands where its overlap says. By the mean, one that rocks would come in a
    little with each swing, and rock on. One that the sea floor holds stands where its anchors say.
    """
    for b in range(twist.shape[0]):
        for i in range(3):
            work.path_twist[b, i] = 0.5 * (twist[b, i] + work.new[b, i])
    for phase in (REST, IMPACT):
        for f in range(count):
            n, k = work.active[f], work.active_pair[f]
            if face_state[n, FORCE] > 0.0 and face_state[n, PHASE] == phase:
                for b in (island.body_of[island.first[k]], island.body_of[island.second[k]]):
                    for i in range(3):
                        work.path_twist[b, i] = (
                            work.new[b, i] if phase == REST else 0.5 * (twist[b, i] + work.new[b, i])
                        )
    for b in range(twist.shape[0]):
        if work.floor[b] == HELD:
            for i in range(3):
                work.path_twist[b, i] = work.new[b, i]


@borrower
def update_faces(
    island: Island, faces: Faces, face_state: Floats, count: int, h: float, law: CrushingLaw, work: CrushingWorkspace,
    result: IslandResult,
) -> None:  # fmt: skip
    """Crush the faces by their forces, pass on from impact to rest, or apart, and add up their impulses on the bodies."""
    for f in range(count):
        n, k, row = work.active[f], work.active_pair[f], work.face[f]
        i, j = island.first[k], island.second[k]
        a, b, state = island.body_of[i], island.body_of[j], face_state[n]
        unloading = unloading_rate(min(faces.thickness[i], faces.thickness[j]), law)
        closing = _speed(row, ROW_N, work.new[a], work.new[b])
        state[CLOSING_SPEED] = closing
        approach_speed = _speed(row, ROW_N, work.path_twist[a], work.path_twist[b])
        area = row[AREA] + (h if state[PHASE] == REST else 0.25 * h) * closing * state[CHORD]
        force, slide = state[FORCE], state[FRICTION]
        result.touched[k] = result.touched[k] or force > 0.0
        for c in range(3):
            result.impulse[a, c] -= h * (force * row[ROW_N + c] + slide * row[ROW_T + c])
            result.impulse[b, c] -= h * (force * row[ROW_N + 3 + c] + slide * row[ROW_T + 3 + c])
        crushed = area - force / unloading
        if closing <= 0.0:
            # Opening faces bear less than the elastic force, as that is damped, and are not crushed by it.
            crushed = min(crushed, _crushed_by_loading(state, area, unloading, law) + SEAT * state[CHORD] / law.ratio)
        if force > 0.0 and crushed > state[CRUSHED]:
            stored = 0.5 * (force * force - row[LAST_FORCE] * row[LAST_FORCE]) / (unloading * state[CHORD])
            work.dissipated[0] += max(h * force * approach_speed - stored, 0.0)
            state[CRUSHED] = crushed
        if state[PHASE] == REST and force > 0.0:
            # The overlap followed the new velocity, and a body in an impact as well goes by the mean of old and new: the
            # difference must not become a force when the next sub-step is shorter.
            drift = h * (approach_speed - closing) * state[CHORD]
            state[TOUCHED] += drift
            state[CRUSHED] += drift
        sliding = _speed(row, ROW_T, work.path_twist[a], work.path_twist[b])
        stiffness = shear_stiffness(min(faces.thickness[i], faces.thickness[j]), state[CHORD], law)
        stored = 0.5 * (slide * slide - row[LAST_FRICTION] * row[LAST_FRICTION]) / stiffness
        work.dissipated[0] += max(h * slide * sliding - stored, 0.0)
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
            if closing > max(STRUCK_AT_REST, 2.0 * row[CLOSING]):
                state[PHASE], state[SINCE] = IMPACT, 0.0
        else:
            # Faces that were unloaded and are struck again begin a new impact.
            if force > 0.0 and row[LAST_FORCE] == 0.0 and row[CLOSING] > STRUCK_AT_REST and state[SINCE] > h:
                state[SINCE], state[SPEED] = h, row[CLOSING]
            since = state[SINCE] * math.sqrt(max(work.stiffness[a] + work.stiffness[b], 0.0))
            slow = closing < max(IMPACT_OVER * state[SPEED], SLOW)
            if (slow and since > SETTLING_TIME) or (force > 0.0 and since > LONGEST_IMPACT):
                state[PHASE], state[SPEED] = REST, closing


@kernel
def _crushed_by_loading(state: Floats, area: float, unloading: float, law: CrushingLaw) -> float:
    """Overlap (m2) to which a face is crushed that has been loaded to ``area``; ``unloading``: see `unloading_rate`."""
    loading = unloading / law.ratio
    return float(area - min(loading * (area - state[TOUCHED]), loading * law.depth * state[CHORD]) / unloading)


@borrower
def record_peak(
    island: Island, face_state: Floats, count: int, time: float, result: IslandResult, work: CrushingWorkspace
) -> None:
    """Record the loads of the bonded bodies that contact presses harder, ``time`` s from the start, than before in the step."""
    if count == 0:
        return
    body_of, harder = island.body_of, False
    _find_loaded_by_impact(island, face_state, count, work.impacted, work)
    work.size[:] = 0.0
    for f in range(count):
        n, k = work.active[f], work.active_pair[f]
        size = math.hypot(face_state[n, PUSH_X], face_state[n, PUSH_Y])
        for b in (body_of[island.first[k]], body_of[island.second[k]]):
            work.size[b] += size if work.impacted[b] else 0.0
            harder = harder or (island.bonded[b] and work.size[b] > work.peak[b])
    if not harder:
        return
    work.contact_force[:, :] = 0.0
    for f in range(count):
        n, k = work.active[f], work.active_pair[f]
        i, j, x, y = island.first[k], island.second[k], face_state[n, PUSH_X], face_state[n, PUSH_Y]
        work.contact_force[i, 0] -= x
        work.contact_force[i, 1] -= y
        work.contact_force[i, 2] += face_state[n, TORQUE_1]
        work.contact_force[j, 0] += x
        work.contact_force[j, 1] += y
        work.contact_force[j, 2] += face_state[n, TORQUE_2]
    record_loads(island, work.size, work.peak, work.new, work.middle, work.force, work.contact_force, time, result)


@borrower
def _find_loaded_by_impact(
    island: Island, face_state: Floats, count: int, impacted: NDArray[np.bool_], work: CrushingWorkspace
) -> None:
    """Find the bodies that bear an impact: on a face of their own, or by way of others that press them at rest.

    A body driven into another faster than `STRUCK_AT_REST` strikes it, however long that lasts. All others are at rest, where
    loads change slowly: the loads at the end of the step stand for them.
    """
    impacted[:], has_spread = False, True
    while has_spread:
        has_spread = False
        for f in range(count):
            n, k = work.active[f], work.active_pair[f]
            a, b = island.body_of[island.first[k]], island.body_of[island.second[k]]
            if face_state[n, FORCE] <= 0.0 or (impacted[a] and impacted[b]):
                continue
            strikes = face_state[n, PHASE] == IMPACT or face_state[n, SPEED] > STRUCK_AT_REST
            if strikes or impacted[a] or impacted[b]:
                impacted[a] = impacted[b] = has_spread = True
