"""Sub-steps of bodies that meet: each island goes through the long step by itself.

Leapfrog steps are as short as the stiffest contact at hand asks, and as long as none is near. What a sub-step needs are
three numbers a body; water, air, ice and floor are those of the start of the long step, at the velocities of the moment:

    M dq = H (G(q) - S dq / 2 - L (q + dq) + B^T (F - C B (q + dq / 2)))

with the forces G by the media, S minus their derivative, the drag L of the sea floor, springs F and damping C of contact.
H is the mean of the steps before and after. Impulses of contact are equal and opposite, so they conserve momentum.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.physics.geometry import separation
from riftberg.state import Floats, Ints
from riftberg.stepping.bodies.dynamics import Loading, add_forces, add_totals_and_slopes, drag_and_slope
from riftberg.stepping.contact.impulses import (
    MeetingRoom,
    allocate_meeting_room,
    find_contacts,
    half_way,
    kick_bodies,
    lever,
    lever_speed,
)
from riftberg.stepping.forces.interactions import PairLaw
from riftberg.stepping.forces.media import CORIOLIS, MEDIA, SEA_FLOOR

FRESH: Final = 1.0 / 32.0
"""Part of the step after which forces of the media are found anew at the velocities of the moment; between, they are linear."""


@kernel
def cross_islands(
    start: Ints, row_start: Ints, own: Ints, first: Ints, second: Ints, pair_start: Ints, motion: Floats, load: Loading,
    inertia: Floats, mobility: Floats, floor: Floats, rate: Floats, bonded: NDArray[np.bool_], x1: Floats, y1: Floats,
    x2: Floats, y2: Floats, radii: Floats, smaller: Floats, span: float, law: PairLaw,
) -> tuple[NDArray[np.bool_], Floats, Floats, Floats, Floats, Floats, Floats, float]:  # fmt: skip
    """Take all islands through the step and return what makes a `riftberg.stepping.contact.islands.Meeting`.

    Returns ``moved, after``: paths (m, m, rad) and velocities at the end; returns ``applied``: changes of velocity by
    all forces but contact, m s-1; returns ``shortest``: shortest sub-step, s.
    """
    touched, apart = np.zeros(first.size, np.bool_), np.empty((first.size, 2))
    for k in range(first.size):
        apart[k, 0], apart[k, 1] = separation(x1[k], y1[k], x2[k], y2[k], law.latlon, law.earth_radius, law.period)
    moved, after = np.zeros(rate.shape), rate.copy()
    applied = np.zeros((own.size, load.media.shape[1] + 1, 2))
    force, turn, spin = np.zeros((own.size, 3)), motion[:, 9:11].copy(), np.zeros(rate.shape[0])
    shortest = span
    for k in range(start.size - 1):
        b, e, n = (
            slice(start[k], start[k + 1]),
            slice(row_start[k], row_start[k + 1]),
            slice(pair_start[k], pair_start[k + 1]),
        )
        some = Loading(
            load.media[e], load.coriolis[e], load.mass[e], load.inertia[e], load.floor[e], load.floor_spin[e],
            load.aground[e], load.spinning[e], load.water_spin[e], load.push_x[e], load.push_y[e], load.surrounded,
            load.touches,
        )  # fmt: skip
        short = _cross(
            own[e], motion[e], some, inertia[b], mobility[b], floor[b], bonded[b], first[n], second[n], apart[n], radii[n],
            smaller[n], span, law, after[b], moved[b], touched[n], applied[e], force[e], turn[e], spin[b],
        )  # fmt: skip
        shortest = min(shortest, short)
    return touched, moved, after, applied, force, turn, spin, shortest


@kernel
def _cross(
    own: Ints, motion: Floats, load: Loading, inertia: Floats, mobility: Floats, floor: Floats, bonded: NDArray[np.bool_],
    first: Ints, second: Ints, apart: Floats, radii: Floats, smaller: Floats, span: float, law: PairLaw, rate: Floats,
    moved: Floats, touched: NDArray[np.bool_], applied: Floats, blow: Floats, turn: Floats, spin: Floats,
) -> float:  # fmt: skip
    """Take one island through the step; returns its shortest sub-step (s), -1 where velocities did not settle.

    From ``rate`` on the arguments are changed in place: velocities, paths (m, m, rad), which pairs touched, changes of
    velocity by the forces, and the heaviest load of each bonded body as in `Blow`.
    """
    count = rate.shape[0]
    room = allocate_meeting_room(count, first.size, own.size)
    heaviest, change = np.zeros(count), np.zeros((count, 3))
    acted, force = np.zeros((own.size, load.media.shape[1] + 1, 2)), np.zeros((own.size, 3))
    given, slope, total = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3))
    for e in range(own.size):
        room.arm[own[e]] = max(room.arm[own[e]], math.hypot(motion[e, 2], motion[e, 5]))
    known, way = rate.copy(), np.zeros((count, 3))
    return _take_substeps(
        own, motion, load, inertia, mobility, floor, bonded, first, second, apart, radii, smaller, span, law, rate, moved,
        touched, applied, blow, turn, spin, heaviest, change, acted, force, given, slope, total, known, way, room,
    )  # fmt: skip


@borrower
def _take_substeps(
    own: Ints, motion: Floats, load: Loading, inertia: Floats, mobility: Floats, floor: Floats, bonded: NDArray[np.bool_],
    first: Ints, second: Ints, apart: Floats, radii: Floats, smaller: Floats, span: float, law: PairLaw, rate: Floats,
    moved: Floats, touched: NDArray[np.bool_], applied: Floats, blow: Floats, turn: Floats, spin: Floats, heaviest: Floats,
    change: Floats, acted: Floats, force: Floats, given: Floats, slope: Floats, total: Floats, known: Floats, way: Floats,
    room: MeetingRoom,
) -> float:  # fmt: skip
    """Take the sub-steps of an island in the room that `_cross` has made; the same is returned."""
    left, before, shortest, since = span, 0.0, span, np.inf
    while True:
        if since >= FRESH * span or left <= 0.0:
            _keep(own, motion, load, known, way, since, applied)
            given[:, :], slope[:, :, :], way[:, :], since = 0.0, 0.0, 0.0, 0.0
            for b in range(rate.shape[0]):
                for i in range(3):
                    known[b, i] = rate[b, i]
            add_totals_and_slopes(own, motion, rate, load, room.everybody, given, slope)
            total[:, :] = 0.0
            add_forces(own, motion, rate, load, acted, force, total)
        _linear(given, slope, floor, rate, known, total)
        found, ahead = find_contacts(
            own, motion, inertia, mobility, total, first, second, apart, radii, smaller, law, rate, moved, touched, room
        )  # fmt: skip
        step = 0.0
        if left > 0.0:
            # Parts of one length, so that the last is no shorter than needs be.
            step = left / math.ceil(left / ahead - 1e-9) if ahead < left else left
            shortest = min(shortest, step)
        h = 0.5 * (before + step)
        if not kick_bodies(
            own, inertia, mobility, floor, slope, total, first, second, motion, found, before, step, rate, change, room
        ):
            return -1.0
        _remember(
            own, motion, load, bonded, first, second, found, force, rate, change, moved, heaviest, blow, turn, spin, room
        )  # fmt: skip
        _move(rate, change, h, step, way, moved)
        since += h
        _slow(own, motion, load, rate, h, applied)
        if left <= 0.0:
            _keep(own, motion, load, known, way, since, applied)
            return shortest
        left -= step
        if left < 1e-9 * span:
            left = 0.0
        before = step


@stage
def _move(rate: Floats, change: Floats, h: float, step: float, way: Floats, moved: Floats) -> None:
    """Give the bodies their new velocities and let them go on by a step with these; ``way`` is that of the velocities alone."""
    for b in range(rate.shape[0]):
        for i in range(3):
            way[b, i] += h * (rate[b, i] + 0.5 * change[b, i])
            rate[b, i] += change[b, i]
            moved[b, i] += step * rate[b, i]


@borrower
def _keep(own: Ints, motion: Floats, load: Loading, known: Floats, way: Floats, time: float, applied: Floats) -> None:
    """Add what the media did in ``time`` s in which the bodies went ``way``, linear about the velocities ``known``."""
    if not 0.0 < time < np.inf:
        return
    for e in range(own.size):
        m, q, p = motion[e], known[own[e]], way[own[e]]
        u, v = m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]
        du = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] - time * u
        dv = m[3] * p[0] + m[4] * p[1] + m[5] * p[2] - time * v
        if load.surrounded:
            applied[e, CORIOLIS, 0] += load.coriolis[e] * (time * v + dv)
            applied[e, CORIOLIS, 1] -= load.coriolis[e] * (time * u + du)
        for k in range(len(MEDIA)):
            if load.surrounded or (k == SEA_FLOOR and load.touches):
                ax, ay, xx, xy, yy = drag_and_slope(load.media[e, k], u, v)
                applied[e, k, 0] += time * ax - xx * du - xy * dv
                applied[e, k, 1] += time * ay - xy * du - yy * dv


@stage
def _linear(given: Floats, slope: Floats, floor: Floats, rate: Floats, known: Floats, total: Floats) -> None:
    """Forces on the bodies at the velocities ``rate``, from those that were found at the velocities ``known``."""
    for b in range(rate.shape[0]):
        for i in range(3):
            total[b, i] = given[b, i]
            for j in range(3):
                total[b, i] -= slope[b, i, j] * (rate[b, j] - known[b, j]) + floor[b, i, j] * rate[b, j]


@stage
def _remember(
    own: Ints, motion: Floats, load: Loading, bonded: NDArray[np.bool_], first: Ints, second: Ints, found: int, force: Floats,
    rate: Floats, change: Floats, moved: Floats, heaviest: Floats, blow: Floats, turn: Floats, spin: Floats, room: MeetingRoom,
) -> None:  # fmt: skip
    """Keep the loads of the bonded bodies that are pressed harder than before in this step."""
    if found == 0:
        return
    size, push, near, pairs, some = room.size, room.push, room.near, room.pairs, False
    size[:] = 0.0
    push[:, :] = 0.0
    for k in range(found):
        i, j, t = first[near[k]], second[near[k]], pairs[k]
        a, b = own[i], own[j]
        if not (bonded[a] or bonded[b]):
            continue
        wx, wy = lever_speed(lever(motion[j], t[7], t[8]), half_way(rate[b], change[b]))
        ux, uy = lever_speed(lever(motion[i], t[5], t[6]), half_way(rate[a], change[a]))
        fx = t[0] + t[2] * (wx - ux) + t[3] * (wy - uy)
        fy = t[1] + t[3] * (wx - ux) + t[4] * (wy - uy)
        push[i, 0] += fx
        push[i, 1] += fy
        push[j, 0] -= fx
        push[j, 1] -= fy
        for c in (a, b):
            size[c] += math.sqrt(fx * fx + fy * fy)
            some = some or (bonded[c] and size[c] > heaviest[c])
    if not some:
        return
    for e in range(own.size):
        b = own[e]
        if not (bonded[b] and size[b] > heaviest[b]):
            continue
        m, q = motion[e], rate[b]
        mass = load.mass[e] * load.floor[e]
        u, v = m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]
        w = m[6] * q[0] + m[7] * q[1] + m[8] * q[2]
        blow[e, 0], blow[e, 1] = force[e, 0] + push[e, 0] - mass * u, force[e, 1] + push[e, 1] - mass * v
        blow[e, 2] = force[e, 2] - load.inertia[e] * load.floor_spin[e] * w
        c, s = math.cos(moved[b, 2]), math.sin(moved[b, 2])
        turn[e, 0], turn[e, 1] = motion[e, 9] * c - motion[e, 10] * s, motion[e, 10] * c + motion[e, 9] * s
        spin[b] = q[2]
    for b in range(size.size):
        heaviest[b] = max(heaviest[b], size[b])


@stage
def _slow(own: Ints, motion: Floats, load: Loading, rate: Floats, h: float, applied: Floats) -> None:
    """Add what the linear drag of the sea floor did in ``h`` s that ended with ``rate``."""
    for e in range(own.size):
        if load.floor[e] > 0.0:
            m, q, f = motion[e], rate[own[e]], h * load.floor[e]
            applied[e, SEA_FLOOR, 0] -= f * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2])
            applied[e, SEA_FLOOR, 1] -= f * (m[3] * q[0] + m[4] * q[1] + m[5] * q[2])
