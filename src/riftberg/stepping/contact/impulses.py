"""Contact in one sub-step of bodies that meet: who touches, how long the step may be, what it does to the velocities.

The bodies are those of one island (`riftberg.stepping.contact.islands`); for the equation see
`riftberg.stepping.contact.island_step`. First `find_contacts`, then `kick_bodies` with what it found.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.state import Floats, Ints
from riftberg.stepping.bodies.dynamics import solve_three
from riftberg.stepping.forces.interactions import COLLISION, PairLaw, pair_terms, stiffness_and_reach

CONTACT_PHASE: Final = 1.0
"""Largest sub-step times frequency of the springs of contact, rad."""

ENTRY: Final = 0.1
"""Part of a sub-step by which bodies may get into each other before contact is seen: damping sets in at once."""

GENTLE: Final = 2e-3
"""Speed, m s-1: ten times as fast, bodies touch within that part of a sub-step, as fast or slower within a whole one."""

ACTS: Final = 10
"""Column of the pairs from which on spring and damping stand as they act over a kick."""

MOST_SWEEPS: Final = 1000
"""Sweeps over the bodies of an island after which their damping is given up; some ten are usual."""

SETTLED: Final = 1e-13
"""Change of the velocities, as a part of the largest, at which sweeps end."""


class MeetingRoom(NamedTuple):
    """Room for the sub-steps of one island.

    For each body: sums of the stiffness of its contacts, accelerations, cosine and sine of its turn, arm from its centre to
    its farthest element, forces, matrices, answers to a force, places of its contacts in a list, and that list: the other
    body, and how its change of velocity makes one of its own; loads. For each pair: which touch, their numbers
    (`find_contacts`), and whether it has touched before. For each element: the push of contact. ``everybody`` marks all
    bodies.
    """

    stiff: Floats
    pace: Floats
    angle: Floats
    arm: Floats
    right: Floats
    block: Floats
    held: Floats
    begin: Ints
    place: Ints
    other: Ints
    coupled: Floats
    size: Floats
    near: Ints
    pairs: Floats
    was: NDArray[np.bool_]
    push: Floats
    everybody: NDArray[np.bool_]
    small: Floats


@kernel
def allocate_meeting_room(bodies: int, pairs: int, elements: int) -> MeetingRoom:
    """Return room for an island."""
    return MeetingRoom(
        np.empty(bodies), np.empty((bodies, 3)), np.empty((bodies, 2)), np.zeros(bodies), np.empty((bodies, 3)),
        np.empty((bodies, 3, 3)), np.empty((bodies, 3, 3)), np.empty(bodies + 1, np.int64), np.empty(bodies, np.int64),
        np.empty(2 * pairs, np.int64), np.empty((2 * pairs, 3, 3)), np.empty(bodies), np.empty(pairs, np.int64),
        np.empty((pairs, 15)), np.zeros(pairs, np.bool_), np.empty((elements, 2)), np.ones(bodies, np.bool_),
        np.empty((4, 3, 3)),
    )  # fmt: skip


@kernel
def _swung(m: Floats, c: float, s: float) -> tuple[float, float]:
    """How the spin moves an element whose body has turned since ``m`` was found, m; by cosine and sine of the angle."""
    return m[2] * c - m[5] * s, m[5] * c + m[2] * s


@kernel
def _moved(m: Floats, path: Floats, c: float, s: float) -> tuple[float, float]:
    """Path (m) of an element whose body has gone ``path`` since ``m`` was found; cosine and sine are those of its turn."""
    return (
        m[0] * path[0] + m[1] * path[1] + m[2] * s + m[5] * (c - 1.0),
        m[3] * path[0] + m[4] * path[1] + m[5] * s - m[2] * (c - 1.0),
    )


@borrower
def _bound(rate: Floats, arm: Floats) -> float:
    """Largest speed (m s-1) with which two elements could approach each other; or of accelerations."""
    most = u = v = 0.0
    for b in range(rate.shape[0]):
        u += rate[b, 0] / rate.shape[0]
        v += rate[b, 1] / rate.shape[0]
    for b in range(rate.shape[0]):
        most = max(most, math.hypot(rate[b, 0] - u, rate[b, 1] - v) + arm[b] * abs(rate[b, 2]))
    return 2.02 * most  # distances on the sphere are not quite those of the plane


@kernel
def _resolved(stiff: float, mass: float) -> float:
    """Longest step (s) that resolves springs of ``stiff`` (N m-1) on a body of a mass (kg)."""
    return CONTACT_PHASE / math.sqrt(2.0 * stiff / mass) if stiff > 0.0 else np.inf


@stage
def find_contacts(
    own: Ints, motion: Floats, inertia: Floats, mobility: Floats, total: Floats, first: Ints, second: Ints, apart: Floats,
    radii: Floats, smaller: Floats, law: PairLaw, rate: Floats, moved: Floats, touched: NDArray[np.bool_], room: MeetingRoom,
) -> tuple[int, float]:  # fmt: skip
    """Find the pairs that touch now, and how long a sub-step may be.

    ``room.near`` takes their places in the list, ``room.pairs`` the spring on the first (N), the damping (xx, xy, yy;
    kg s-1), how the spins of both bodies move the two elements (m), and whether they have touched a sub-step before.

    Returns ``ahead``: longest step (s): the springs at hand are resolved, and no pair gets deep into another on the
    way.
    """
    found, ahead = 0, np.inf
    stiff, pace, angle, near, pairs = room.stiff, room.pace, room.angle, room.near, room.pairs
    for b in range(rate.shape[0]):
        stiff[b] = 0.0
        pace[b, :] = 0.0
        angle[b, 0], angle[b, 1] = math.cos(moved[b, 2]), math.sin(moved[b, 2])
        for i in range(3):
            for j in range(3):
                pace[b, i] += mobility[b, i, j] * total[b, j]
    fastest, quickest = _bound(rate, room.arm), _bound(pace, room.arm)
    for k in range(first.size):
        m, n = motion[first[k]], motion[second[k]]
        a, b = own[first[k]], own[second[k]]
        p, q, v, w = moved[a], moved[b], rate[a], rate[b]
        x1, y1 = _moved(m, p, angle[a, 0], angle[a, 1])
        x2, y2 = _moved(n, q, angle[b, 0], angle[b, 1])
        rx, ry = apart[k, 0] + x1 - x2, apart[k, 1] + y1 - y2
        stiffness, reach = stiffness_and_reach(COLLISION, radii[k], law)
        d = rx * rx + ry * ry
        if d >= reach * reach:
            room.was[k] = False
        if d > (reach + ahead * (fastest + 0.5 * ahead * quickest)) ** 2:
            continue  # it cannot be the first to touch
        d = math.sqrt(d)
        mx, my = _swung(m, angle[a, 0], angle[a, 1])
        nx, ny = _swung(n, angle[b, 0], angle[b, 1])
        du = n[0] * w[0] + n[1] * w[1] + nx * w[2] - (m[0] * v[0] + m[1] * v[1] + mx * v[2])
        dv = n[3] * w[0] + n[4] * w[1] + ny * w[2] - (m[3] * v[0] + m[4] * v[1] + my * v[2])
        if d < reach:
            touched[k] = True
            stiff[a] += stiffness * smaller[k]
            stiff[b] += stiffness * smaller[k]
            ahead = min(ahead, _resolved(stiffness * smaller[k], min(inertia[a, 0, 0], inertia[b, 0, 0])))
            fx, fy, c11, c12, c22 = pair_terms(COLLISION, rx, ry, radii[k], smaller[k], du, dv, du, dv, law)
            near[found] = k
            t = pairs[found]
            t[0], t[1], t[2], t[3], t[4] = fx, fy, c11, c12, c22
            t[5], t[6], t[7], t[8], t[9] = mx, my, nx, ny, (1.0 if room.was[k] else 0.0)
            room.was[k] = True
            found += 1
            continue
        # Bodies that close in on each other, or are driven together, reach each other no sooner than this.
        closing = max((rx * du + ry * dv) / d, 0.0)
        v, w = pace[a], pace[b]
        au = n[0] * w[0] + n[1] * w[1] + nx * w[2] - (m[0] * v[0] + m[1] * v[1] + mx * v[2])
        av = n[3] * w[0] + n[4] * w[1] + ny * w[2] - (m[3] * v[0] + m[4] * v[1] + my * v[2])
        gap, driven = d - reach, math.sqrt(au * au + av * av)
        pressed = closing + math.sqrt(closing * closing + 2.0 * driven * gap)
        resolved = _resolved(stiffness * smaller[k], min(inertia[a, 0, 0], inertia[b, 0, 0]))
        if pressed > 0.0:
            entry = min(1.0, max(ENTRY, GENTLE / pressed)) * resolved
            ahead = min(ahead, max(2.0 * gap / pressed, entry))
    for b in range(rate.shape[0]):
        ahead = min(ahead, _resolved(stiff[b], inertia[b, 0, 0]))
    return found, ahead


@stage
def kick_bodies(
    own: Ints, inertia: Floats, mobility: Floats, floor: Floats, slope: Floats, total: Floats, first: Ints, second: Ints,
    motion: Floats, found: int, before: float, step: float, rate: Floats, change: Floats, room: MeetingRoom,
) -> bool:  # fmt: skip
    """Solve for the change of the velocities over half the steps before and after, in place; returns whether it settled.

    Elements that have just touched did not do so in the step before: their contact acts over half the next one. Damping
    couples bodies that touch. Their equations are met by sweeps (Gauss-Seidel), in the order of the bodies.
    """
    count = rate.shape[0]
    right, block, begin, near, pairs = room.right, room.block, room.begin, room.near, room.pairs
    h = 0.5 * (before + step)
    begin[0] = 0
    for b in range(count):
        begin[b + 1] = 0
        for i in range(3):
            right[b, i] = total[b, i]
            for j in range(3):
                block[b, i, j] = 0.5 * slope[b, i, j] + floor[b, i, j]
    for k in range(found):
        i, j = first[near[k]], second[near[k]]
        a, b, t = own[i], own[j], pairs[k]
        begin[a + 1] += 1
        begin[b + 1] += 1
        m, n = lever(motion[i], t[5], t[6]), lever(motion[j], t[7], t[8])
        share = 0.5 * (before * t[9] + step) / h
        for c in range(5):
            t[ACTS + c] = share * t[c]
        du, dv = lever_speed(n, rate[b]), lever_speed(m, rate[a])
        wx, wy = du[0] - dv[0], du[1] - dv[1]
        fx = t[ACTS] + t[ACTS + 2] * wx + t[ACTS + 3] * wy
        fy = t[ACTS + 1] + t[ACTS + 3] * wx + t[ACTS + 4] * wy
        for c in range(3):
            right[a, c] += m[c] * fx + m[3 + c] * fy
            right[b, c] -= n[c] * fx + n[3 + c] * fy
        _add_damping(block[a], m, t)
        _add_damping(block[b], n, t)
    for b in range(count):
        begin[b + 1] += begin[b]
    _lone_changes(mobility, h, change, room)
    return found == 0 or _sweep(own, inertia, first, second, motion, found, h, rate, change, room)


@stage
def _lone_changes(mobility: Floats, h: float, change: Floats, room: MeetingRoom) -> None:
    """Change of the velocities of each body by itself, and what it answers to a force with where it touches others."""
    right, block, begin, held = room.right, room.block, room.begin, room.held
    matrix, used, x = room.small[0], room.small[1], room.small[2, 0]
    for b in range(change.shape[0]):
        for i in range(3):
            for j in range(3):
                matrix[i, j] = 1.0 if i == j else 0.0
                for k in range(3):
                    matrix[i, j] += h * mobility[b, i, k] * block[b, k, j]
        if begin[b] == begin[b + 1]:
            for i in range(3):
                x[i] = h * (
                    mobility[b, i, 0] * right[b, 0] + mobility[b, i, 1] * right[b, 1] + mobility[b, i, 2] * right[b, 2]
                )
            change[b, 0], change[b, 1], change[b, 2] = solve_three(matrix, x)
            continue
        for j in range(3):
            for i in range(3):
                x[i] = mobility[b, i, j]
                for k in range(3):
                    used[i, k] = matrix[i, k]
            held[b, 0, j], held[b, 1, j], held[b, 2, j] = solve_three(used, x)
        for i in range(3):
            change[b, i] = h * (held[b, i, 0] * right[b, 0] + held[b, i, 1] * right[b, 1] + held[b, i, 2] * right[b, 2])


@kernel
def lever(m: Floats, sx: float, sy: float) -> tuple[float, float, float, float, float, float]:
    """How an element moves with its body, with the part of the spin as it is now."""
    return m[0], m[1], sx, m[3], m[4], sy


@kernel
def lever_speed(
    m: tuple[float, float, float, float, float, float], q: Floats | tuple[float, float, float]
) -> tuple[float, float]:
    """Velocity (m s-1) of an element that moves by ``m`` (`lever`) with its body's velocity ``q``."""
    return m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]


@kernel
def half_way(q: Floats, change: Floats) -> tuple[float, float, float]:
    """Velocity of a body half-way through a change of it."""
    return q[0] + 0.5 * change[0], q[1] + 0.5 * change[1], q[2] + 0.5 * change[2]


@borrower
def _add_damping(block: Floats, m: tuple[float, float, float, float, float, float], t: Floats) -> None:
    """Add half of B^T C B, which damps the change by half of it."""
    for i in range(3):
        x, y = t[ACTS + 2] * m[i] + t[ACTS + 3] * m[3 + i], t[ACTS + 3] * m[i] + t[ACTS + 4] * m[3 + i]
        for j in range(3):
            block[i, j] += 0.5 * (x * m[j] + y * m[3 + j])


@stage
def _sweep(
    own: Ints, inertia: Floats, first: Ints, second: Ints, motion: Floats, found: int, h: float, rate: Floats,
    change: Floats, room: MeetingRoom,
) -> bool:  # fmt: skip
    """Sweep over the bodies that touch until the change of their velocities has settled; see `kick_bodies`."""
    count, begin, base, block, other, size = rate.shape[0], room.begin, room.right, room.coupled, room.other, room.size
    _couple(own, first, second, motion, found, h, room)
    scale = 0.0
    for b in range(count):
        size[b] = math.sqrt(inertia[b, 2, 2] / inertia[b, 0, 0])
        scale = max(scale, abs(rate[b, 0]), abs(rate[b, 1]), size[b] * abs(rate[b, 2]))
        scale = max(scale, abs(change[b, 0]), abs(change[b, 1]), size[b] * abs(change[b, 2]))
        for i in range(3):
            base[b, i] = change[b, i]
    for _ in range(MOST_SWEEPS):
        most = 0.0
        for b in range(count):
            if begin[b] == begin[b + 1]:
                continue
            x, y, w = base[b, 0], base[b, 1], base[b, 2]
            for n in range(begin[b], begin[b + 1]):
                d, q = block[n], change[other[n]]
                x += d[0, 0] * q[0] + d[0, 1] * q[1] + d[0, 2] * q[2]
                y += d[1, 0] * q[0] + d[1, 1] * q[1] + d[1, 2] * q[2]
                w += d[2, 0] * q[0] + d[2, 1] * q[1] + d[2, 2] * q[2]
            most = max(most, abs(x - change[b, 0]), abs(y - change[b, 1]), size[b] * abs(w - change[b, 2]))
            change[b, 0], change[b, 1], change[b, 2] = x, y, w
        if most <= SETTLED * scale:
            return True
    return False


@stage
def _couple(
    own: Ints, first: Ints, second: Ints, motion: Floats, found: int, h: float, room: MeetingRoom
) -> None:  # fmt: skip
    """List for each body its contacts: the other body, and by which matrix its change of velocity makes one of its own."""
    pairs, place, block, held = room.pairs, room.place, room.coupled, room.held
    for b in range(place.size):
        place[b] = room.begin[b]
    for k in range(found):
        i, j, t = first[room.near[k]], second[room.near[k]], pairs[k]
        one, two = lever(motion[i], t[5], t[6]), lever(motion[j], t[7], t[8])
        for end in range(2):
            b, mine, theirs = (own[i], one, two) if end == 0 else (own[j], two, one)
            n = place[b]
            place[b], room.other[n] = n + 1, own[j] if end == 0 else own[i]
            for c in range(3):
                # By a velocity of one in direction c of the other body: the force of damping, half of it over a kick.
                fx = 0.5 * (t[ACTS + 2] * theirs[c] + t[ACTS + 3] * theirs[3 + c])
                fy = 0.5 * (t[ACTS + 3] * theirs[c] + t[ACTS + 4] * theirs[3 + c])
                x, y, w = mine[0] * fx + mine[3] * fy, mine[1] * fx + mine[4] * fy, mine[2] * fx + mine[5] * fy
                for r in range(3):
                    block[n, r, c] = h * (held[b, r, 0] * x + held[b, r, 1] * y + held[b, r, 2] * w)
