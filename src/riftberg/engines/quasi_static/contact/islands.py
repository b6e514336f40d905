"""Fragments that may touch within a step: the islands that they form, and the result of contact for each.

Bodies that may touch each other in a step, directly or by way of others, form an island, and each island goes through the step
by itself, in sub-steps (`riftberg.engines.quasi_static.contact.crushing_step`). Bodies that touch nothing on the way keep the
result of the whole step, as if alone, unless it would take them into each other: a long step swings about the speed that a
small berg takes up within minutes, and goes another way than the sub-steps. The others get their twist from the sub-steps,
corrected here for the forces of the media at the end of the step.

In the sub-steps media are taken at the start of the step, linear about the velocities at which they were evaluated
last:

    M (V1 - V0) = h (G(V0) - S (V1 - V0) / 2 + floor + contact)

with the twists V0 and V1 of the bodies before and after a sub-step of h s, the forces G by the media, S minus their derivative,
and the friction of the sea floor by the loads that it carries at the start (`riftberg.engines.quasi_static.contact.anchors`).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.constants import DEGREE
from riftberg.engines.common.forces.media import CORIOLIS, FORCES, MEDIA, SEA_FLOOR, WATER
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.quasi_static.bodies.dynamics import (
    BodyMatrices,
    BodyOperators,
    ElementForcing,
    add_forces,
    assemble_force_and_jacobian,
    drag_and_jacobian,
    outline_force,
    take_elements,
)
from riftberg.engines.quasi_static.keel_friction import STIFFNESS, floor_force
from riftberg.parameters import KernelParameters
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import multiply, nearest_image, solve, times
from riftberg.state import Floats, Ints

REFRESH_FRACTION: Final = 1.0 / 32.0
"""Part of the step after which the forces of the media are evaluated anew; between, they are linear in the velocities.

Media change over hours and velocities by contact within minutes: 32 times a step of half an hour is once a minute.
"""

REFRESH_SPEED: Final = 2e-3
"""Change of a body's velocity (m s-1) up to which the linear media stay: their error is its square times the drag."""


class Islands(NamedTuple):
    """Bodies that may touch each other, island by island; island k holds those from ``start[k]`` to ``start[k + 1]``."""

    members: Ints  # Bodies
    start: Ints  # Where the islands begin in ``members``
    rows: Ints  # Elements of the bodies
    row_start: Ints  # Where the islands begin in ``rows``
    body_of: Ints  # Place of each element's body in its island; shape (rows,)
    first: Ints  # Candidate pairs, as places in the rows of their island
    second: Ints
    pair_start: Ints  # Where the islands begin among the pairs
    order: Ints  # Places of the pairs in the list that was given


class Island(NamedTuple):
    """The bodies and candidate pairs of one island, or of all, at the start of the step; bodies are numbered within each."""

    body_of: Ints  # Body of each element
    levers: Floats  # See `riftberg.engines.quasi_static.bodies.pose.fill_levers`; shape (elements, 11)
    forcing: ElementForcing  # On the elements
    matrices: BodyMatrices  # Of the bodies
    bonded: NDArray[np.bool_]  # Whether a body has more than one element; shape (bodies,)
    first: Ints  # Elements of the candidate pairs
    second: Ints
    # Along axes half-way between both elements, with which those of each lie at an angle, as meridians converge:
    separation: Floats  # From the second to the first element at the start, m; shape (pairs, 2)
    turn: Floats  # Cosine and sine of the angle from axes half-way to those of the first; shape (pairs, 2)


class IslandResult(NamedTuple):
    """Arrays that the sub-steps change: one island has views into the arrays of all."""

    twist: Floats  # Now; shape (bodies, 3)
    path: Floats  # Since the start, m, m, rad; shape (bodies, 3)
    touched: NDArray[np.bool_]  # Candidate pairs that touched; shape (pairs,)
    # Those that did not, but might overlap where the whole step takes their bodies; shape (pairs,)
    close: NDArray[np.bool_]
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (elements, forces, 2)
    peak_force: Floats  # On the elements when contact pressed their body hardest, N, N, N m; shape (elements, 3)
    peak_axes: Floats  # Cosine and sine of the axis of their fragment then; shape (elements, 2)
    peak_spin: Floats  # Of the bodies then, rad s-1; shape (bodies,)
    peak_time: Floats  # When that was, s since the start of the step; shape (bodies,)
    impulse: Floats  # Given to the bodies by contact, N s, N s, N m s; shape (bodies, 3)
    anchors: Floats  # See `riftberg.engines.quasi_static.keel_friction`; shape (elements, columns)
    rubbed: Floats  # Work of friction on the sea floor, J; shape (bodies,)


class PeakContactLoad(NamedTuple):
    """The loads of each bonded fragment in the sub-step in which contact pressed it hardest."""

    rows: Ints  # Elements of these fragments
    force: Floats  # N, N, N m; shape (rows, 3)
    axes: Floats  # Cosine and sine of the fragment's axis from local east then; shape (rows, 2)
    bodies: Ints  # The fragments
    spin: Floats  # Theirs then, rad s-1; shape (bodies,)
    time: Floats  # When that was, s since the start of the step; shape (bodies,)


class SubcycledMotion(NamedTuple):
    """Result of the sub-steps of a step, for the bodies that went through them: they touched others, or the floor."""

    bodies: Ints
    rows: Ints  # Their elements
    mean: Floats  # Twists on the way; shape (bodies, 3)
    twist: Floats  # Twists at the end; shape (bodies, 3)
    impulse: Floats  # Given to them by others, N s, N s, N m s; shape (bodies, 3)
    anchors: Floats  # On the sea floor, of their elements; shape (rows, columns)
    rubbed: Floats  # Work of friction on the sea floor, J; shape (bodies,)
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (rows, forces, 2)
    first: Ints  # Elements of the pairs that touched, each once
    second: Ints
    shortest_substep: float  # s
    peak_load: PeakContactLoad


def find_islands(body: Ints, count: int, first: Ints, second: Ints) -> Islands:
    """Find the islands among ``count`` bodies: connected components by the candidate pairs of elements, each given once.

    Within an island the pairs keep their order.
    """
    component = connected_parts(count, body[first], body[second], np.zeros(first.size, np.int64))
    island = _numbered_islands(component, body, first, second)
    members, start, in_island = _sort_by_group(island)
    rows, row_start, row_in_island = _sort_by_group(island[body])
    order, pair_start, _ = _sort_by_group(island[body[first]])
    return Islands(
        members, start, rows, row_start, in_island[body[rows]], row_in_island[first[order]], row_in_island[second[order]],
        pair_start, order,
    )  # fmt: skip


@kernel
def _numbered_islands(component: Ints, body: Ints, first: Ints, second: Ints) -> Ints:
    """Number the parts that a pair is in, in order of their first body; returns the number for each body, -1 for none."""
    involved = np.zeros(component.size, np.bool_)
    for k in range(first.size):
        involved[body[first[k]]] = involved[body[second[k]]] = True
    number, island, islands = np.full(component.size, -1, np.int64), np.full(component.size, -1, np.int64), 0
    for b in range(component.size):
        if involved[b]:
            if number[component[b]] < 0:
                number[component[b]] = islands
                islands += 1
            island[b] = number[component[b]]
    return island


@kernel
def _sort_by_group(group: Ints) -> tuple[Ints, Ints, Ints]:
    """Sort entries by their group, in their order within it; those below 0 are in none.

    Returns the entries, where each group begins, with the end of the last, and the place of each entry in its group.
    """
    groups = 0
    for g in group:
        groups = max(groups, g + 1)
    start, rank = np.zeros(groups + 1, np.int64), np.zeros(group.size, np.int64)
    for n in range(group.size):
        if group[n] >= 0:
            rank[n] = start[group[n] + 1]
            start[group[n] + 1] += 1
    for g in range(groups):
        start[g + 1] += start[g]
    entries = np.empty(start[groups], np.int64)
    for n in range(group.size):
        if group[n] >= 0:
            entries[start[group[n]] + rank[n]] = n
    return entries, start, rank


@kernel
def pair_separations(lon: Floats, lat: Floats, first: Ints, second: Ints, p: KernelParameters) -> tuple[Floats, Floats]:
    """Find vectors from the second to the first element of each pair, and cosine and sine of the angle between their axes.

    Vectors are east and north half-way between both, m, from where the axes of the first lie at that angle, and those of the
    second at minus it; two arrays of shape (pairs, 2). ``lon``, ``lat``: of the elements.
    """
    separations, turn, period = np.empty((first.size, 2)), np.zeros((first.size, 2)), 360.0 if p.latlon else p.period
    for k in range(first.size):
        i, j = first[k], second[k]
        dx, dy, turn[k, 0] = nearest_image(lon[i] - lon[j], period), lat[i] - lat[j], 1.0
        if p.latlon:
            metre, angle = DEGREE * p.earth_radius, 0.5 * DEGREE * dx * sin(0.5 * DEGREE * (lat[i] + lat[j]))
            turn[k, 0], turn[k, 1] = cos(angle), sin(angle)
            dx, dy = dx * (metre * cos(0.5 * (lat[i] + lat[j]) * DEGREE)), dy * metre
        separations[k, 0], separations[k, 1] = dx, dy
    return separations, turn


def gather_islands(
    op: BodyOperators, first: Ints, second: Ints, separation: Floats, turn: Floats
) -> tuple[Islands, Island]:
    """Return the islands of the candidate pairs of elements, and the arrays of all of them for compiled code."""
    count = op.matrices.mobility.shape[0]
    islands = find_islands(op.body, count, first, second)
    rows = islands.rows
    return islands, Island(
        islands.body_of, op.levers[rows], select_forcing(rows, op.forcing),
        BodyMatrices(*(m[islands.members] for m in op.matrices)), np.bincount(op.body, minlength=count)[islands.members] > 1,
        islands.first, islands.second, separation[islands.order], turn[islands.order],
    )  # fmt: skip


def subcycled_motion(
    op: BodyOperators, islands: Islands, first: Ints, second: Ints, result: IslandResult, shortest: float, dt: float
) -> SubcycledMotion | None:
    """Return the motion by the sub-steps of all islands, of the bodies that touched others; None where no pair did.

    ``first``, ``second``: elements of the candidate pairs, as they were given.
    """
    first, second = first[islands.order], second[islands.order]
    after, path, touched, close, applied, force, axes, spin, time, impulse, anchors, rubbed = result
    met = touched | close
    if not met.any():
        return None
    count = op.matrices.mobility.shape[0]
    is_included = np.zeros(count, bool)
    is_included[op.body[first[met]]] = is_included[op.body[second[met]]] = True
    members, rows = is_included[islands.members], is_included[op.body[islands.rows]]
    loaded = np.zeros(count, bool)
    pressed = np.bincount(op.body[islands.rows], np.abs(force).sum(axis=1), count)[islands.members] > 0.0
    loaded[islands.members[members & pressed]] = True
    loaded_rows = loaded[op.body[islands.rows]]
    peak = PeakContactLoad(
        islands.rows[loaded_rows],
        force[loaded_rows],
        axes[loaded_rows],
        islands.members[members & pressed],
        spin[members & pressed],
        time[members & pressed],
    )
    return SubcycledMotion(
        islands.members[members], islands.rows[rows], path[members] / dt, after[members], impulse[members], anchors[rows],
        rubbed[members], applied[rows], first[touched], second[touched], shortest, peak,
    )  # fmt: skip


def trapezoidal_correction(
    contact: SubcycledMotion, start: BodyOperators, end: BodyOperators, twist: Floats, dt: float
) -> tuple[Floats, SubcycledMotion]:
    """Put the twists of bodies in contact into ``twist``, with half the difference that the media at the end make.

    In the sub-steps the media are taken at the start; with this correction they act by the trapezoidal rule.
    """
    end_twist, applied = contact.twist.copy(), contact.applied.copy()
    _correct_by_media(contact.bodies, contact.rows, start, end, 0.5 * dt, end_twist, applied)
    twist[contact.bodies] = end_twist
    return twist, contact._replace(twist=end_twist, applied=applied)


@kernel
def _correct_by_media(
    bodies: Ints, rows: Ints, start: BodyOperators, end: BodyOperators, half_dt: float, twist: Floats, applied: Floats
) -> None:
    """Solve ``V - V1 = h/2 M^-1 (G_end(V) - G_start(V1))`` from ``twist`` V1, and add the difference to ``applied``."""
    # Of the elements of bodies in contact alone: among a thousand bergs they are few.
    number = np.zeros(end.matrices.mobility.shape[0], np.int64)
    for k in range(bodies.size):
        number[bodies[k]] = k
    body, levers, forcing = number[end.body[rows]], end.levers[rows], take_elements(end.forcing, rows)
    everyone, shape = np.ones(bodies.size, np.bool_), (rows.size, len(FORCES), 2)
    rate, force = np.empty((rows.size, 3)), np.empty((rows.size, 3))
    at_start, at_end, net_start = np.zeros(shape), np.zeros(shape), np.zeros(twist.shape)
    add_forces(body, start.levers[rows], twist, take_elements(start.forcing, rows), at_start, rate, force, net_start)
    first, matrix, right = twist.copy(), np.empty((3, 3)), np.empty(3)
    net, jacobian = np.empty(twist.shape), np.empty((bodies.size, 3, 3))
    for _ in range(2):  # Newton's method from a guess that is nearly right: two iterations leave round-off
        net[:, :], jacobian[:, :, :] = -net_start, 0.0
        assemble_force_and_jacobian(body, levers, twist, forcing, everyone, net, jacobian)
        for k in range(bodies.size):
            mobility = end.matrices.mobility[bodies[k]]
            multiply(mobility, jacobian[k], matrix)
            kick = times(mobility, net[k])
            for i in range(3):
                right[i] = half_dt * kick[i] + first[k, i] - twist[k, i]
                for j in range(3):
                    matrix[i, j] = (1.0 if i == j else 0.0) + half_dt * matrix[i, j]
            change = solve(matrix, right)
            for i in range(3):
                twist[k, i] += change[i]
    net[:, :] = 0.0
    add_forces(body, levers, twist, forcing, at_end, rate, force, net)
    for e in range(rows.size):
        for k in range(len(FORCES)):
            for i in range(2):
                applied[e, k, i] += half_dt * (at_end[e, k, i] - at_start[e, k, i])


def select_forcing(rows: Ints, forcing: ElementForcing) -> ElementForcing:
    """Return the forcing of some elements, each once; if they are all elements, the same object."""
    if rows.size == forcing.mass.size and (np.diff(rows) > 0).all():
        return forcing
    return forcing._replace(
        **{name: values[rows] for name, values in forcing._asdict().items() if not isinstance(values, bool)}
    )


def scatter_peak_load(peak: PeakContactLoad, elements: int, bodies: int) -> tuple[Floats, Floats, Floats]:
    """Force (N, N, N m) and axes of all elements, and spins of all bodies (rad s-1); 0 where contact pressed nothing."""
    force, axes, spin = np.zeros((elements, 3)), np.zeros((elements, 2)), np.zeros(bodies)
    force[peak.rows], axes[peak.rows], spin[peak.bodies] = peak.force, peak.axes, peak.spin
    return force, axes, spin


@kernel
def select_island(lists: Islands, k: int, all_islands: Island) -> Island:
    """Return island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n, m = slice(lists.pair_start[k], lists.pair_start[k + 1]), all_islands.matrices
    return Island(
        all_islands.body_of[e], all_islands.levers[e], take_elements(all_islands.forcing, e),
        BodyMatrices(m.inertia[b], m.mobility[b]), all_islands.bonded[b], all_islands.first[n], all_islands.second[n],
        all_islands.separation[n], all_islands.turn[n],
    )  # fmt: skip


def allocate_result(all_islands: Island, twist: Floats, anchors: Floats) -> IslandResult:
    """Return the results of all islands at the start of the step: ``twist`` of the bodies and ``anchors``, which are changed."""
    bodies, rows = twist.shape[0], all_islands.body_of.size
    return IslandResult(
        twist, np.zeros((bodies, 3)), np.zeros(all_islands.first.size, np.bool_), np.zeros(all_islands.first.size, np.bool_),
        np.zeros((rows, all_islands.forcing.media.shape[1] + 1, 2)), np.zeros((rows, 3)), all_islands.levers[:, 9:11].copy(),
        np.zeros(bodies), np.zeros(bodies), np.zeros((bodies, 3)), anchors, np.zeros(bodies),
    )  # fmt: skip


@kernel
def select_result(lists: Islands, k: int, r: IslandResult) -> IslandResult:
    """Return the results of island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n = slice(lists.pair_start[k], lists.pair_start[k + 1])
    return IslandResult(
        r.twist[b],
        r.path[b],
        r.touched[n],
        r.close[n],
        r.applied[e],
        r.peak_force[e],
        r.peak_axes[e],
        r.peak_spin[b],
        r.peak_time[b],
        r.impulse[b],
        r.anchors[e],
        r.rubbed[b],
    )


@kernel
def spin_lever(m: Floats, c: float, s: float) -> tuple[float, float]:
    """Lever (m) of the spin on an element now, from its levers ``m`` at the start and cosine and sine of the rotation since."""
    return m[2] * c - m[5] * s, m[5] * c + m[2] * s


@kernel
def element_path(m: Floats, path: Floats, c: float, s: float) -> tuple[float, float]:
    """Path (m) of an element whose body has gone ``path`` since the levers ``m`` were found and turned by cosine and sine."""
    return (
        m[0] * path[0] + m[1] * path[1] + m[2] * s + m[5] * (c - 1.0),
        m[3] * path[0] + m[4] * path[1] + m[5] * s - m[2] * (c - 1.0),
    )


@borrower
def approach_bound(twist: Floats, arm: Floats) -> float:
    """Upper bound of the speed (m s-1) at which two elements could approach each other; or of their accelerations."""
    most = u = v = 0.0
    for b in range(twist.shape[0]):
        u += twist[b, 0] / twist.shape[0]
        v += twist[b, 1] / twist.shape[0]
    for b in range(twist.shape[0]):
        most = max(most, math.hypot(twist[b, 0] - u, twist[b, 1] - v) + arm[b] * abs(twist[b, 2]))
    return 2.02 * most  # both together, and 1 % more: distances on the sphere are not quite those of the plane


# ---- media in the sub-steps, and their results: impulses on the elements, loads at the largest force of contact ----


class Linearisation(NamedTuple):
    """The forces of the media, linear about the twists at which they were evaluated last."""

    twist: Floats  # shape (bodies, 3)
    force: Floats  # G at these; shape (bodies, 3)
    jacobian: Floats  # S; shape (bodies, 3, 3)
    twist_integral: Floats  # Integral of the twists over the time since, m, m, rad; shape (bodies, 3)


@kernel
def allocate_linearisation(twist: Floats) -> Linearisation:
    """Return one that nothing has been evaluated for."""
    bodies = twist.shape[0]
    return Linearisation(twist.copy(), np.zeros((bodies, 3)), np.zeros((bodies, 3, 3)), np.zeros((bodies, 3)))


@borrower
def evaluate_media(
    island: Island, twist: Floats, about: Linearisation, everyone: NDArray[np.bool_], accelerations: Floats, drag_rate: Floats,
    force: Floats,
) -> None:  # fmt: skip
    """Evaluate the media at ``twist``; ``force`` takes the forces on the elements (N, N, N m)."""
    forcing = island.forcing
    about.force[:, :], about.jacobian[:, :, :], about.twist_integral[:, :] = 0.0, 0.0, 0.0
    for b in range(twist.shape[0]):
        for i in range(3):
            about.twist[b, i] = twist[b, i]
    add_forces(island.body_of, island.levers, twist, forcing, accelerations, drag_rate, force, about.force)
    about.force[:, :] = 0.0
    assemble_force_and_jacobian(island.body_of, island.levers, twist, forcing, everyone, about.force, about.jacobian)


@borrower
def is_stale(about: Linearisation, twist: Floats, arm: Floats, elapsed: float, dt: float) -> bool:
    """Whether the media must be evaluated anew, ``elapsed`` s after the last time."""
    if elapsed < REFRESH_FRACTION * dt:
        return False
    change = 0.0
    for b in range(twist.shape[0]):
        u, v, w = twist[b, 0] - about.twist[b, 0], twist[b, 1] - about.twist[b, 1], twist[b, 2] - about.twist[b, 2]
        change = max(change, math.hypot(u, v) + arm[b] * abs(w))
    return elapsed == np.inf or change > REFRESH_SPEED


@borrower
def accumulate_impulse(island: Island, about: Linearisation, time: float, applied: Floats) -> None:
    """Add the impulses of the media over the ``time`` s since they were evaluated, by the integral of the twists since."""
    if not 0.0 < time < np.inf:
        return
    forcing = island.forcing
    for e in range(island.body_of.size):
        m, q, p = island.levers[e], about.twist[island.body_of[e]], about.twist_integral[island.body_of[e]]
        u, v = m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]
        du = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] - time * u
        dv = m[3] * p[0] + m[4] * p[1] + m[5] * p[2] - time * v
        if forcing.media_act:
            applied[e, CORIOLIS, 0] += forcing.coriolis[e] * (time * v + dv)
            applied[e, CORIOLIS, 1] -= forcing.coriolis[e] * (time * u + du)
        for k in range(len(MEDIA)):
            if forcing.media_act:
                ax, ay, xx, xy, yy, _ = drag_and_jacobian(forcing.media[e, k], u, v)
                applied[e, k, 0] += time * ax - xx * du - xy * dv
                applied[e, k, 1] += time * ay - xy * du - yy * dv
        if forcing.side_drag[e] > 0.0:
            w = m[6] * q[0] + m[7] * q[1] + m[8] * q[2]
            dw = m[6] * p[0] + m[7] * p[1] + m[8] * p[2] - time * w
            fx, fy, _, xx, xy, yy, xw, yw, _ = outline_force(forcing, e, m[9], m[10], u, v, w)
            applied[e, WATER, 0] += (time * fx - xx * du - xy * dv - xw * dw) / forcing.mass[e]
            applied[e, WATER, 1] += (time * fy - xy * du - yy * dv - yw * dw) / forcing.mass[e]


@borrower
def linearised_force(about: Linearisation, twist: Floats, net_force: Floats) -> None:
    """Find the forces of the media on the bodies at ``twist``."""
    for b in range(twist.shape[0]):
        for i in range(3):
            net_force[b, i] = about.force[b, i]
            for j in range(3):
                net_force[b, i] -= about.jacobian[b, i, j] * (twist[b, j] - about.twist[b, j])


@borrower
def record_loads(
    island: Island, size: Floats, peak: Floats, twist: Floats, path: Floats, force: Floats, contact_force: Floats, time: float,
    result: IslandResult,
) -> None:  # fmt: skip
    """Record the loads of the bonded bodies on which the forces of contact add up to more, ``size``, than so far, ``peak`` (N).

    ``twist``, ``path``: of the bodies now; ``force``, ``contact_force``: on the elements by media and by contact (N, N, N m);
    ``time``: since the start of the step, s.
    """
    body_of = island.body_of
    for e in range(body_of.size):
        b = body_of[e]
        if not (island.bonded[b] and size[b] > peak[b]):
            continue
        m, q = island.levers[e], twist[b]
        x, y, torque = floor_force(result.anchors[e])
        result.peak_force[e, 0] = force[e, 0] + contact_force[e, 0] + x
        result.peak_force[e, 1] = force[e, 1] + contact_force[e, 1] + y
        result.peak_force[e, 2] = force[e, 2] + contact_force[e, 2] + torque
        c, s = cos(path[b, 2]), sin(path[b, 2])
        result.peak_axes[e, 0], result.peak_axes[e, 1] = m[9] * c - m[10] * s, m[10] * c + m[9] * s
        result.peak_spin[b] = q[2]
    for b in range(size.size):
        if size[b] > peak[b]:
            peak[b], result.peak_time[b] = size[b], time


@borrower
def accumulate_floor_impulse(island: Island, anchors: Floats, h: float, applied: Floats) -> None:
    """Add the impulses of the sea floor over ``h`` s, by its forces at their end."""
    for e in range(island.body_of.size):
        a = anchors[e]
        if a[STIFFNESS] > 0.0:
            x, y, _ = floor_force(a)
            applied[e, SEA_FLOOR, 0] += h * x / island.forcing.mass[e]
            applied[e, SEA_FLOOR, 1] += h * y / island.forcing.mass[e]
