"""Fragments that meet in a quasi-static step: sub-steps of their motion alone, island by island.

Bodies that may touch each other in a step, directly or by way of others, make an island. Each island goes through the step
by itself, with leapfrog steps as short as the stiffest contact at hand asks, and as long as none is near. What a sub-step
needs are three numbers a body; water, air, ice and floor are those of the start of the step, at the velocities of the
moment:

    M dq = H (G(q) - S dq / 2 - L (q + dq) + B^T (F - C B (q + dq / 2)))

with the forces G by the media, S minus their derivative, the drag L of the sea floor, springs F and damping C of contact.
H is the mean of the steps before and after. Impulses of contact are equal and opposite, so they conserve momentum. Bodies
that touch nothing on the way take the long step as if nobody were near.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.kernels import borrower, kernel, plain
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.conglomerates import connected_parts
from riftberg.stepping.interactions import COLLISION, PairLaw, pair_law, pair_terms, stiffness_and_reach
from riftberg.stepping.media import CORIOLIS, FORCES, MEDIA, SEA_FLOOR
from riftberg.stepping.rigid_bodies import (
    BodyMotion,
    Loading,
    add_forces,
    add_totals_and_slopes,
    drag_and_slope,
    solve_three,
)
from riftberg.stepping.sizes import Sizes

CONTACT_PHASE: Final = 1.0
"""Largest sub-step times frequency of the springs of contact, rad."""

ENTRY: Final = 0.1
"""Part of a sub-step by which bodies may get into each other before contact is seen: damping sets in at once."""

GENTLE: Final = 2e-3
"""Speed, m s-1: ten times as fast, bodies touch within that part of a sub-step, as fast or slower within a whole one."""

FRESH: Final = 1.0 / 32.0
"""Part of the step after which forces of the media are found anew at the velocities of the moment; between, they are linear."""

ACTS: Final = 10
"""Column of the pairs from which on spring and damping stand as they act over a kick."""

MOST_SWEEPS: Final = 1000
"""Sweeps over the bodies of an island after which their damping is given up; some ten are usual."""

SETTLED: Final = 1e-13
"""Change of the velocities, as a part of the largest, at which sweeps end."""


class Room(NamedTuple):
    """Room for the sub-steps of one island.

    For each body: sums of the stiffness of its contacts, accelerations, cosine and sine of its turn, arm from its centre to
    its farthest element, forces, matrices, answers to a force, places of its contacts in a list and that list, loads. For
    each pair: which touch, their numbers (`_touch`), and whether it has touched before. For each element: the push of contact.
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
    listed: Ints
    size: Floats
    near: Ints
    pairs: Floats
    was: NDArray[np.bool_]
    push: Floats
    small: Floats


@kernel
def _allocate_room(bodies: int, pairs: int, elements: int) -> Room:
    """Return room for an island."""
    return Room(
        np.empty(bodies), np.empty((bodies, 3)), np.empty((bodies, 2)), np.zeros(bodies), np.empty((bodies, 3)),
        np.empty((bodies, 3, 3)), np.empty((bodies, 3, 3)), np.empty(bodies + 1, np.int64), np.empty(bodies, np.int64),
        np.empty(2 * pairs, np.int64), np.empty(bodies), np.empty(pairs, np.int64), np.empty((pairs, 15)),
        np.zeros(pairs, np.bool_), np.empty((elements, 2)), np.empty((4, 3, 3)),
    )  # fmt: skip


class Islands(NamedTuple):
    """Bodies that may meet, island by island.

    ``members`` are bodies, those of island k from ``start[k]`` to ``start[k + 1]``; ``rows`` their elements, from
    ``row_start[k]``; ``own`` the place of each element's body in its island. ``first`` and ``second`` are places in the rows
    of the island of the pairs that may meet, those of island k from ``pair_start[k]``; ``order`` are their places in the list
    that was given.
    """

    members: Ints
    start: Ints
    rows: Ints
    row_start: Ints
    own: Ints
    first: Ints
    second: Ints
    pair_start: Ints
    order: Ints


class Blow(NamedTuple):
    """The heaviest load by contact that each bonded fragment bore in a step, on its elements ``rows`` (N, N, N m).

    ``turn`` are cosine and sine of the fragment's axis against east then, for each row; ``spin`` is that of each of
    ``bodies`` (rad s-1).
    """

    rows: Ints
    force: Floats
    turn: Floats
    bodies: Ints
    spin: Floats


class Meeting(NamedTuple):
    """What contact made of a step, for the ``bodies`` that touched others and their elements ``rows``.

    Attributes
    ----------
    mean, rate : array of float, shape (bodies, 3)
        Velocities on the way and at the end.
    applied : array of float, shape (rows, forces, 2)
        Changes of velocity by all forces but contact, m s-1.
    first, second : array of int
        Elements of the pairs that touched, each once.
    shortest : float
        Shortest sub-step, s.
    blow : Blow
    """

    bodies: Ints
    rows: Ints
    mean: Floats
    rate: Floats
    applied: Floats
    first: Ints
    second: Ints
    shortest: float
    blow: Blow


def find_islands(body: Ints, count: int, first: Ints, second: Ints) -> Islands:
    """Find the islands among ``count`` bodies by the pairs of elements that may meet, each once."""
    part = connected_parts(count, body[first], body[second], np.zeros(first.size, np.int64))
    some = np.zeros(count, bool)
    some[body[first]] = some[body[second]] = True
    members = np.flatnonzero(some)
    members = members[np.argsort(part[members], kind="stable")]
    numbers, start = np.unique(part[members], return_index=True)
    place = np.zeros(count, np.int64)
    place[members] = np.arange(members.size) - np.repeat(start, np.diff(np.append(start, members.size)))
    rows = np.flatnonzero(some[body])
    rows = rows[np.argsort(part[body[rows]], kind="stable")]
    row_start = np.searchsorted(part[body[rows]], numbers)
    at = np.zeros(body.size, np.int64)
    at[rows] = np.arange(rows.size) - np.repeat(row_start, np.diff(np.append(row_start, rows.size)))
    island = part[body[first]]
    # Within an island in the order of the rows: what happens elsewhere has no say.
    order = np.lexsort((second, first, island))
    return Islands(
        members, np.append(start, members.size), rows, np.append(row_start, rows.size), place[body[rows]],
        at[first[order]], at[second[order]], np.append(np.searchsorted(island[order], numbers), order.size), order,
    )  # fmt: skip


def meet(
    el: Elements, motion: BodyMotion, rate: Floats, first: Ints, second: Ints, span: float, sizes: Sizes,
    p: KernelParameters,
) -> Meeting | None:  # fmt: skip
    """Take the bodies that may meet through ``span`` s.

    Parameters
    ----------
    el : Elements
        Places at the start; not changed.
    motion : BodyMotion
        At the start.
    rate : array of float, shape (bodies, 3)
        Velocities at the start.
    first, second : array of int
        Elements of different bodies that may come into contact, each pair once.
    span : float
        s.
    sizes : Sizes
    p : KernelParameters

    Returns
    -------
    Meeting or None
        None where nothing touches.

    Raises
    ------
    FloatingPointError
        If the velocities of bodies in contact do not settle.
    """
    if first.size == 0:
        return None
    count = motion.mobility.shape[0]
    i = find_islands(motion.body, count, first, second)
    one, other = first[i.order], second[i.order]
    members, rows = i.members, i.rows
    of_elements = {name: part[rows] for name, part in motion.load._asdict().items() if not isinstance(part, bool)}
    load = motion.load._replace(**of_elements)
    bonded = np.bincount(motion.body, minlength=count)[members] > 1
    shown = el.shown
    touched, moved, after, applied, force, turn, spin, shortest = _meet(
        i.start, i.row_start, i.own, i.first, i.second, i.pair_start, motion.elements[rows], load,
        motion.inertia[members], motion.mobility[members], motion.floor[members], rate[members], bonded,
        shown.lon_pair[one], shown.lat_pair[one], shown.lon_pair[other], shown.lat_pair[other],
        sizes.radius[one] + sizes.radius[other], np.minimum(sizes.mass[one], sizes.mass[other]), span,
        plain(pair_law)(p),
    )  # fmt: skip
    if not shortest > 0.0:
        raise FloatingPointError
    if not touched.any():
        return None
    took_part = np.zeros(count, bool)
    took_part[motion.body[one[touched]]] = took_part[motion.body[other[touched]]] = True
    mine, inside = took_part[members], took_part[motion.body[rows]]
    struck = mine & bonded
    hit = np.zeros(count, bool)
    hit[members[struck]] = True
    beaten = hit[motion.body[rows]]
    blow = Blow(rows[beaten], force[beaten], turn[beaten], members[struck], spin[struck])
    return Meeting(
        members[mine], rows[inside], moved[mine] / span, after[mine], applied[inside], one[touched], other[touched],
        shortest, blow,
    )  # fmt: skip


@kernel
def _meet(
    start: Ints, row_start: Ints, own: Ints, first: Ints, second: Ints, pair_start: Ints, motion: Floats, load: Loading,
    inertia: Floats, mobility: Floats, floor: Floats, rate: Floats, bonded: NDArray[np.bool_], x1: Floats, y1: Floats,
    x2: Floats, y2: Floats, radii: Floats, smaller: Floats, span: float, law: PairLaw,
) -> tuple[NDArray[np.bool_], Floats, Floats, Floats, Floats, Floats, Floats, float]:  # fmt: skip
    """Take all islands through the step and return what makes a `Meeting`; a shortest sub-step of -1 did not settle."""
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
    room = _allocate_room(count, first.size, own.size)
    heaviest, change = np.zeros(count), np.zeros((count, 3))
    acted, force = np.zeros((own.size, load.media.shape[1] + 1, 2)), np.zeros((own.size, 3))
    given, slope, total = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3))
    for e in range(own.size):
        room.arm[own[e]] = max(room.arm[own[e]], math.hypot(motion[e, 2], motion[e, 5]))
    known, way, since = rate.copy(), np.zeros((count, 3)), np.inf
    left, before, shortest = span, 0.0, span
    while True:
        if since >= FRESH * span or left <= 0.0:
            _keep(own, motion, load, known, way, since, applied)
            given[:, :], slope[:, :, :], way[:, :], known[:, :], since = 0.0, 0.0, 0.0, rate, 0.0
            add_totals_and_slopes(own, motion, rate, load, given, slope)
            total[:, :] = 0.0
            add_forces(own, motion, rate, load, acted, force, total)
        _linear(given, slope, floor, rate, known, total)
        found, ahead = _touch(
            own, motion, inertia, mobility, total, first, second, apart, radii, smaller, law, rate, moved, touched, room
        )  # fmt: skip
        step = 0.0
        if left > 0.0:
            # Parts of one length, so that the last is no shorter than needs be.
            step = left / math.ceil(left / ahead - 1e-9) if ahead < left else left
            shortest = min(shortest, step)
        h = 0.5 * (before + step)
        if not _kick(
            own, inertia, mobility, floor, slope, total, first, second, motion, found, before, step, rate, change, room
        ):
            return -1.0
        _remember(
            own, motion, load, bonded, first, second, found, force, rate, change, moved, heaviest, blow, turn, spin, room
        )  # fmt: skip
        way += h * (rate + 0.5 * change)
        since += h
        rate += change
        _slow(own, motion, load, rate, h, applied)
        if left <= 0.0:
            _keep(own, motion, load, known, way, since, applied)
            return shortest
        moved += step * rate
        left -= step
        if left < 1e-9 * span:
            left = 0.0
        before = step


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


@kernel
def _linear(given: Floats, slope: Floats, floor: Floats, rate: Floats, known: Floats, total: Floats) -> None:
    """Forces on the bodies at the velocities ``rate``, from those that were found at the velocities ``known``."""
    for b in range(rate.shape[0]):
        for i in range(3):
            total[b, i] = given[b, i]
            for j in range(3):
                total[b, i] -= slope[b, i, j] * (rate[b, j] - known[b, j]) + floor[b, i, j] * rate[b, j]


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


@borrower
def _touch(
    own: Ints, motion: Floats, inertia: Floats, mobility: Floats, total: Floats, first: Ints, second: Ints, apart: Floats,
    radii: Floats, smaller: Floats, law: PairLaw, rate: Floats, moved: Floats, touched: NDArray[np.bool_], room: Room,
) -> tuple[int, float]:  # fmt: skip
    """Find the pairs that touch now, and how long a sub-step may be.

    ``room.near`` takes their places in the list, ``room.pairs`` the spring on the first (N), the damping (xx, xy, yy;
    kg s-1), how the spins of both bodies move the two elements (m), and whether they have touched a sub-step before.

    Returns
    -------
    found : int
        Pairs that touch.
    ahead : float
        Longest step (s): the springs at hand are resolved, and no pair gets deep into another on the way.
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


@borrower
def _kick(
    own: Ints, inertia: Floats, mobility: Floats, floor: Floats, slope: Floats, total: Floats, first: Ints, second: Ints,
    motion: Floats, found: int, before: float, step: float, rate: Floats, change: Floats, room: Room,
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
        m, n = _lever(motion[i], t[5], t[6]), _lever(motion[j], t[7], t[8])
        share = 0.5 * (before * t[9] + step) / h
        for c in range(5):
            t[ACTS + c] = share * t[c]
        du, dv = _speed(n, rate[b]), _speed(m, rate[a])
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


@borrower
def _lone_changes(mobility: Floats, h: float, change: Floats, room: Room) -> None:
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
def _lever(m: Floats, sx: float, sy: float) -> tuple[float, float, float, float, float, float]:
    """How an element moves with its body, with the part of the spin as it is now."""
    return m[0], m[1], sx, m[3], m[4], sy


@kernel
def _speed(m: tuple[float, float, float, float, float, float], q: Floats) -> tuple[float, float]:
    """Velocity of an element (m s-1)."""
    return m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]


@borrower
def _add_damping(block: Floats, m: tuple[float, float, float, float, float, float], t: Floats) -> None:
    """Add half of B^T C B, which damps the change by half of it."""
    for i in range(3):
        x, y = t[ACTS + 2] * m[i] + t[ACTS + 3] * m[3 + i], t[ACTS + 3] * m[i] + t[ACTS + 4] * m[3 + i]
        for j in range(3):
            block[i, j] += 0.5 * (x * m[j] + y * m[3 + j])


@borrower
def _sweep(
    own: Ints, inertia: Floats, first: Ints, second: Ints, motion: Floats, found: int, h: float, rate: Floats,
    change: Floats, room: Room,
) -> bool:  # fmt: skip
    """Sweep over the bodies that touch until the change of their velocities has settled; see `_kick`."""
    count = rate.shape[0]
    right, held, begin, near, pairs = room.right, room.held, room.begin, room.near, room.pairs
    listed, place, size, scale = room.listed, room.place, room.size, 0.0
    for b in range(count):
        place[b] = begin[b]
    for k in range(found):
        i, j = own[first[near[k]]], own[second[near[k]]]
        listed[place[i]] = listed[place[j]] = k
        place[i] += 1
        place[j] += 1
    for b in range(count):
        size[b] = math.sqrt(inertia[b, 2, 2] / inertia[b, 0, 0])
        scale = max(scale, abs(rate[b, 0]), abs(rate[b, 1]), size[b] * abs(rate[b, 2]))
        scale = max(scale, abs(change[b, 0]), abs(change[b, 1]), size[b] * abs(change[b, 2]))
    rest, new = room.small[0, 0], room.small[0, 1]
    for _ in range(MOST_SWEEPS):
        most = 0.0
        for b in range(count):
            if begin[b] == begin[b + 1]:
                continue
            for c in range(3):
                rest[c] = right[b, c]
            for n in range(begin[b], begin[b + 1]):
                t, i, j = pairs[listed[n]], first[near[listed[n]]], second[near[listed[n]]]
                one, two = _lever(motion[i], t[5], t[6]), _lever(motion[j], t[7], t[8])
                mine, theirs = (one, two) if own[i] == b else (two, one)
                du, dv = _speed(theirs, change[own[j] if own[i] == b else own[i]])
                fx, fy = (
                    0.5 * (t[ACTS + 2] * du + t[ACTS + 3] * dv),
                    0.5 * (t[ACTS + 3] * du + t[ACTS + 4] * dv),
                )
                for c in range(3):
                    rest[c] += mine[c] * fx + mine[3 + c] * fy
            for c in range(3):
                new[c] = h * (held[b, c, 0] * rest[0] + held[b, c, 1] * rest[1] + held[b, c, 2] * rest[2])
            most = max(
                most, abs(new[0] - change[b, 0]), abs(new[1] - change[b, 1]), size[b] * abs(new[2] - change[b, 2])
            )
            for c in range(3):
                change[b, c] = new[c]
        if most <= SETTLED * scale:
            return True
    return False


@kernel
def _remember(
    own: Ints, motion: Floats, load: Loading, bonded: NDArray[np.bool_], first: Ints, second: Ints, found: int, force: Floats,
    rate: Floats, change: Floats, moved: Floats, heaviest: Floats, blow: Floats, turn: Floats, spin: Floats, room: Room,
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
        wx, wy = _speed(_lever(motion[j], t[7], t[8]), rate[b] + 0.5 * change[b])
        ux, uy = _speed(_lever(motion[i], t[5], t[6]), rate[a] + 0.5 * change[a])
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


@kernel
def _slow(own: Ints, motion: Floats, load: Loading, rate: Floats, h: float, applied: Floats) -> None:
    """Add what the linear drag of the sea floor did in ``h`` s that ended with ``rate``."""
    for e in range(own.size):
        if load.floor[e] > 0.0:
            m, q, f = motion[e], rate[own[e]], h * load.floor[e]
            applied[e, SEA_FLOOR, 0] -= f * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2])
            applied[e, SEA_FLOOR, 1] -= f * (m[3] * q[0] + m[4] * q[1] + m[5] * q[2])


def caught_up(
    meeting: Meeting, before: BodyMotion, after: BodyMotion, rate: Floats, span: float
) -> tuple[Floats, Meeting]:
    """Give bodies that met their velocities, with half of what the media at the end of the step make different.

    Held media are those of the start; with this, they are taken by the trapezoidal rule.

    Parameters
    ----------
    meeting : Meeting
    before, after : BodyMotion
        At both ends of the step.
    rate : array of float, shape (bodies, 3)
        Velocities at the end of the bodies that did not meet; of all in return.
    span : float
        Length of the step, s.

    Returns
    -------
    rate : array of float, shape (bodies, 3)
    meeting : Meeting
        With these velocities, and the changes that media made.
    """
    some, half = meeting.bodies, 0.5 * span
    rate[some] = meeting.rate
    (old, was), (acted, now) = _forces(before, rate), _forces(after, rate)
    for _ in range(2):  # Newton's method, from what is nearly right
        unused, slope = np.zeros(rate.shape), np.zeros((*rate.shape, 3))
        add_totals_and_slopes(after.body, after.elements, rate, after.load, unused, slope)
        matrix = np.eye(3) + half * after.mobility[some] @ slope[some]
        pushed = half * after.mobility[some] @ (now - was)[some][:, :, None]
        rate[some] += np.linalg.solve(matrix, pushed + (meeting.rate - rate[some])[:, :, None])[:, :, 0]
        acted, now = _forces(after, rate)
    applied = meeting.applied + half * (acted - old)[meeting.rows]
    return rate, meeting._replace(rate=rate[some], applied=applied)


def _forces(motion: BodyMotion, rate: Floats) -> tuple[Floats, Floats]:
    """Accelerations of the elements by each medium, and the forces on the bodies, at these velocities."""
    count = motion.body.size
    acted, force, total = np.zeros((count, len(FORCES), 2)), np.empty((count, 3)), np.zeros(rate.shape)
    add_forces(motion.body, motion.elements, rate, motion.load, acted, force, total)
    return acted, total


def blow_on_all(blow: Blow, elements: int, bodies: int) -> tuple[Floats, Floats, Floats]:
    """Force (N, N, N m) on all elements, cosine and sine of their axes, and spins of all bodies (rad s-1); 0 where no blow is."""
    force, turn, spin = np.zeros((elements, 3)), np.zeros((elements, 2)), np.zeros(bodies)
    force[blow.rows], turn[blow.rows], spin[blow.bodies] = blow.force, blow.turn, blow.spin
    return force, turn, spin
