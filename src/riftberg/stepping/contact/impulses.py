"""Contact in one sub-step of an island: which pairs touch, how long the step may be, what it does to the velocities.

`find_contacts` is the narrow phase: it finds the pairs in contact and the longest step that resolves them. `solve_kick` then
solves for the change of the velocities. For the equation see `riftberg.stepping.contact.island_step`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.state import Floats, Ints
from riftberg.stepping.bodies.dynamics import BodyMatrices, ElementForcing
from riftberg.stepping.forces.pair_law import COLLISION, PairLaw, pair_terms, stiffness_and_reach
from riftberg.stepping.mat3 import solve

CONTACT_PHASE: Final = 1.0
"""Largest sub-step times angular frequency of the contact springs, rad: well below 2, where leapfrog becomes unstable."""

MAX_PENETRATION: Final = 0.1
"""Part of a resolving step for which a fast body may enter another unseen: damping sets in at once, not gradually."""

SOFT_IMPACT_SPEED: Final = 2e-3
"""Speed (m s-1) up to which that part is a whole step; it shrinks with the speed, to `MAX_PENETRATION` at ten times this."""

MAX_SWEEPS: Final = 1000
"""Sweeps over the bodies of an island after which a kick is given up; some ten are usual."""

SWEEP_RTOL: Final = 1e-13
"""Change of the velocities in a sweep, as a part of the largest, at which the sweeps end."""


class Islands(NamedTuple):
    """Bodies that may touch each other, island by island; those of island k from ``start[k]`` to ``start[k + 1]``."""

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
    levers: Floats  # See `riftberg.stepping.bodies.pose.fill_levers`; shape (elements, 11)
    forcing: ElementForcing  # On the elements
    matrices: BodyMatrices  # Of the bodies
    bonded: NDArray[np.bool_]  # Whether a body has more than one element; shape (bodies,)
    first: Ints  # Elements of the candidate pairs
    second: Ints
    separation: Floats  # From the second to the first element at the start, east and north, m; shape (pairs, 2)
    sum_radii: Floats  # m; shape (pairs,)
    pair_mass: Floats  # The smaller of both masses, kg; shape (pairs,)


class IslandResult(NamedTuple):
    """What the sub-steps change: for one island the arrays are views of those of all."""

    twist: Floats  # Now; shape (bodies, 3)
    path: Floats  # Since the start, m, m, rad; shape (bodies, 3)
    touched: NDArray[np.bool_]  # Candidate pairs that touched; shape (pairs,)
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (elements, forces, 2)
    peak_force: Floats  # On the elements when contact pressed their body hardest, N, N, N m; shape (elements, 3)
    peak_axes: Floats  # Cosine and sine of the axis of their fragment then; shape (elements, 2)
    peak_spin: Floats  # Of the bodies then, rad s-1; shape (bodies,)


class IslandWorkspace(NamedTuple):
    """Workspace of the sub-steps of one island."""

    stiffness_sum: Floats  # Of the contacts of each body, N m-1; shape (bodies,)
    acceleration: Floats  # By all forces but contact; shape (bodies, 3)
    rotation: Floats  # Cosine and sine of the angle through which each body has turned; shape (bodies, 2)
    arm: Floats  # From the centre to the farthest element, m; shape (bodies,)
    right: Floats  # Right-hand sides; shape (bodies, 3)
    block: Floats  # S / 2 + L + B^T C B / 2; shape (bodies, 3, 3)
    compliance: Floats  # Change of velocity by an impulse, with all damping; shape (bodies, 3, 3)
    begin: Ints  # Where the contacts of each body begin in ``other``; shape (bodies + 1,)
    fill: Ints  # How far its list is filled; shape (bodies,)
    other: Ints  # The other body of each contact; shape (2 pairs,)
    coupling: Floats  # Change of velocity of a body by that of the other; shape (2 pairs, 3, 3)
    size: Floats  # A number for each body; shape (bodies,)
    active: Ints  # The pairs in contact, as places among the candidates; shape (pairs,)
    # Of the pairs in contact: spring on the first (N, N) and damping (xx, xy, yy; kg s-1), now and as they act over a kick
    law: Floats  # shape (pairs, 5)
    kick_law: Floats  # shape (pairs, 5)
    spin_levers: Floats  # How the spins of both bodies move the two elements, m; shape (pairs, 4)
    is_old: NDArray[np.bool_]  # Whether a pair in contact was so a sub-step before; shape (pairs,)
    was_active: NDArray[np.bool_]  # The same for the candidates; shape (pairs,)
    contact_force: Floats  # On the elements, N, N, N m; shape (elements, 3)
    increment: Floats  # Of the twists in a kick; shape (bodies, 3)
    peak: Floats  # Largest sum of contact forces so far, N; shape (bodies,)
    accelerations: Floats  # By each force; shape (elements, forces, 2)
    force: Floats  # On the elements without contact, N, N, N m; shape (elements, 3)
    net_force: Floats  # On the bodies without contact, N, N, N m; shape (bodies, 3)
    everyone: NDArray[np.bool_]  # All bodies; shape (bodies,)
    scratch: Floats  # shape (4, 3, 3)


@kernel
def island_part(lists: Islands, k: int, whole: Island) -> Island:
    """Return island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n, f, m = slice(lists.pair_start[k], lists.pair_start[k + 1]), whole.forcing, whole.matrices
    forcing = ElementForcing(
        f.media[e], f.coriolis[e], f.mass[e], f.inertia[e], f.floor_rate[e], f.floor_spin_rate[e], f.aground[e],
        f.spin_drag[e], f.water_spin[e], f.push_x[e], f.push_y[e], f.media_act, f.floor_acts,
    )  # fmt: skip
    return Island(
        whole.body_of[e], whole.levers[e], forcing, BodyMatrices(m.inertia[b], m.mobility[b], m.floor_drag[b]),
        whole.bonded[b], whole.first[n], whole.second[n], whole.separation[n], whole.sum_radii[n], whole.pair_mass[n],
    )  # fmt: skip


@kernel
def allocate_result(whole: Island, twist: Floats) -> IslandResult:
    """Return the results of all islands at the start of the step."""
    bodies, rows = twist.shape[0], whole.body_of.size
    return IslandResult(
        twist.copy(), np.zeros((bodies, 3)), np.zeros(whole.first.size, np.bool_),
        np.zeros((rows, whole.forcing.media.shape[1] + 1, 2)), np.zeros((rows, 3)), whole.levers[:, 9:11].copy(),
        np.zeros(bodies),
    )  # fmt: skip


@kernel
def result_part(lists: Islands, k: int, r: IslandResult) -> IslandResult:
    """Return the results of island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n = slice(lists.pair_start[k], lists.pair_start[k + 1])
    return IslandResult(
        r.twist[b], r.path[b], r.touched[n], r.applied[e], r.peak_force[e], r.peak_axes[e], r.peak_spin[b]
    )


@kernel
def allocate_island_workspace(bodies: int, pairs: int, elements: int, forces: int) -> IslandWorkspace:
    """Return a workspace for an island."""
    return IslandWorkspace(
        np.empty(bodies), np.empty((bodies, 3)), np.empty((bodies, 2)), np.zeros(bodies), np.empty((bodies, 3)),
        np.empty((bodies, 3, 3)), np.empty((bodies, 3, 3)), np.empty(bodies + 1, np.int64), np.empty(bodies, np.int64),
        np.empty(2 * pairs, np.int64), np.empty((2 * pairs, 3, 3)), np.empty(bodies), np.empty(pairs, np.int64),
        np.empty((pairs, 5)), np.empty((pairs, 5)), np.empty((pairs, 4)), np.zeros(pairs, np.bool_),
        np.zeros(pairs, np.bool_), np.empty((elements, 3)), np.zeros((bodies, 3)), np.zeros(bodies),
        np.zeros((elements, forces, 2)), np.zeros((elements, 3)), np.zeros((bodies, 3)), np.ones(bodies, np.bool_),
        np.empty((4, 3, 3)),
    )  # fmt: skip


@kernel
def spin_lever(m: Floats, c: float, s: float) -> tuple[float, float]:
    """How the spin moves an element now, m; ``m`` are its levers at the start, cosine and sine those of the turn since."""
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


@kernel
def _resolving_dt(stiffness: float, mass: float) -> float:
    """Longest step (s) that resolves springs of a stiffness (N m-1) between bodies of which the lighter has a mass (kg)."""
    return CONTACT_PHASE / math.sqrt(2.0 * stiffness / mass) if stiffness > 0.0 else np.inf


@stage
def find_contacts(
    island: Island, law: PairLaw, twist: Floats, path: Floats, touched: NDArray[np.bool_], work: IslandWorkspace
) -> tuple[int, float]:
    """Find the pairs in contact now, and how long a sub-step may be; returns their number and the longest step (s).

    The step resolves the springs in contact, and ends before any other pair gets deep into each other.
    """
    count, max_dt = 0, np.inf
    body_of, levers, inertia, pair_mass = island.body_of, island.levers, island.matrices.inertia, island.pair_mass
    stiffness_sum, acceleration, rotation = work.stiffness_sum, work.acceleration, work.rotation
    for b in range(twist.shape[0]):
        stiffness_sum[b] = 0.0
        acceleration[b, :] = 0.0
        rotation[b, 0], rotation[b, 1] = math.cos(path[b, 2]), math.sin(path[b, 2])
        for i in range(3):
            for j in range(3):
                acceleration[b, i] += island.matrices.mobility[b, i, j] * work.net_force[b, j]
    fastest, quickest = approach_bound(twist, work.arm), approach_bound(acceleration, work.arm)
    for k in range(island.first.size):
        i, j = island.first[k], island.second[k]
        m, n, a, b = levers[i], levers[j], body_of[i], body_of[j]
        p, q, v, w = path[a], path[b], twist[a], twist[b]
        x1, y1 = element_path(m, p, rotation[a, 0], rotation[a, 1])
        x2, y2 = element_path(n, q, rotation[b, 0], rotation[b, 1])
        rx, ry = island.separation[k, 0] + x1 - x2, island.separation[k, 1] + y1 - y2
        stiffness, reach = stiffness_and_reach(COLLISION, island.sum_radii[k], law)
        d = rx * rx + ry * ry
        if d >= reach * reach:
            work.was_active[k] = False
        if d > (reach + max_dt * (fastest + 0.5 * max_dt * quickest)) ** 2:
            continue  # too far to touch within the longest step so far
        d = math.sqrt(d)
        mx, my = spin_lever(m, rotation[a, 0], rotation[a, 1])
        nx, ny = spin_lever(n, rotation[b, 0], rotation[b, 1])
        du = n[0] * w[0] + n[1] * w[1] + nx * w[2] - (m[0] * v[0] + m[1] * v[1] + mx * v[2])
        dv = n[3] * w[0] + n[4] * w[1] + ny * w[2] - (m[3] * v[0] + m[4] * v[1] + my * v[2])
        resolving = _resolving_dt(stiffness * pair_mass[k], min(inertia[a, 0, 0], inertia[b, 0, 0]))
        if d < reach:
            touched[k] = True
            stiffness_sum[a] += stiffness * pair_mass[k]
            stiffness_sum[b] += stiffness * pair_mass[k]
            max_dt = min(max_dt, resolving)
            fx, fy, c11, c12, c22 = pair_terms(
                COLLISION, rx, ry, island.sum_radii[k], pair_mass[k], du, dv, du, dv, law
            )
            work.active[count] = k
            t, levers_now = work.law[count], work.spin_levers[count]
            t[0], t[1], t[2], t[3], t[4] = fx, fy, c11, c12, c22
            levers_now[0], levers_now[1], levers_now[2], levers_now[3] = mx, my, nx, ny
            work.is_old[count] = work.was_active[k]
            work.was_active[k] = True
            count += 1
            continue
        # Time to contact. A pair that closes in at speed c and is driven together with acceleration g at most crosses its
        # gap no sooner than the smallest root t of gap = c t + g t^2 / 2, that is
        #     t = (sqrt(c^2 + 2 g gap) - c) / g = 2 gap / (c + sqrt(c^2 + 2 g gap)),
        # written without a difference so that it holds for g = 0 and loses no digits for small g.
        closing = max((rx * du + ry * dv) / d, 0.0)
        v, w = acceleration[a], acceleration[b]
        au = n[0] * w[0] + n[1] * w[1] + nx * w[2] - (m[0] * v[0] + m[1] * v[1] + mx * v[2])
        av = n[3] * w[0] + n[4] * w[1] + ny * w[2] - (m[3] * v[0] + m[4] * v[1] + my * v[2])
        gap, driven = d - reach, math.sqrt(au * au + av * av)
        impact = closing + math.sqrt(closing * closing + 2.0 * driven * gap)  # closing speed plus speed at contact
        if impact > 0.0:
            # Without a least step the sub-steps would become ever shorter before a contact that is never reached. So a
            # body may enter another for a part of the step that resolves their contact: a tenth, as the damping force sets
            # in at once with the speed; up to all of it where the speed, and so that force, is small.
            entry = min(1.0, max(MAX_PENETRATION, SOFT_IMPACT_SPEED / impact)) * resolving
            max_dt = min(max_dt, max(2.0 * gap / impact, entry))
    for b in range(twist.shape[0]):
        max_dt = min(max_dt, _resolving_dt(stiffness_sum[b], inertia[b, 0, 0]))
    return count, max_dt


@stage
def solve_kick(
    island: Island, jacobian: Floats, count: int, before: float, step: float, twist: Floats, work: IslandWorkspace
) -> bool:
    """Solve for ``work.increment`` of the twists over half the steps before and after; returns whether it converged.

    Damping couples bodies in contact; their equations are solved by Gauss-Seidel sweeps, in the order of the bodies.
    """
    bodies, body_of, levers = twist.shape[0], island.body_of, island.levers
    right, block, begin, active = work.right, work.block, work.begin, work.active
    h = 0.5 * (before + step)
    begin[0] = 0
    for b in range(bodies):
        begin[b + 1] = 0
        for i in range(3):
            right[b, i] = work.net_force[b, i]
            for j in range(3):
                block[b, i, j] = 0.5 * jacobian[b, i, j] + island.matrices.floor_drag[b, i, j]
    for k in range(count):
        i, j = island.first[active[k]], island.second[active[k]]
        a, b, t, s = body_of[i], body_of[j], work.kick_law[k], work.spin_levers[k]
        begin[a + 1] += 1
        begin[b + 1] += 1
        m, n = lever(levers[i], s[0], s[1]), lever(levers[j], s[2], s[3])
        # A pair that has just come into contact was not so in the step before: it acts over half the next step alone.
        share = 0.5 * (before * (1.0 if work.is_old[k] else 0.0) + step) / h
        for c in range(5):
            t[c] = share * work.law[k, c]
        du, dv = lever_velocity(n, twist[b]), lever_velocity(m, twist[a])
        wx, wy = du[0] - dv[0], du[1] - dv[1]
        fx = t[0] + t[2] * wx + t[3] * wy
        fy = t[1] + t[3] * wx + t[4] * wy
        for c in range(3):
            right[a, c] += m[c] * fx + m[3 + c] * fy
            right[b, c] -= n[c] * fx + n[3 + c] * fy
        _add_damping(block[a], m, t)
        _add_damping(block[b], n, t)
    for b in range(bodies):
        begin[b + 1] += begin[b]
    _solve_uncoupled(island.matrices.mobility, h, work)
    return count == 0 or _gauss_seidel(island, count, h, twist, work)


@stage
def _solve_uncoupled(mobility: Floats, h: float, work: IslandWorkspace) -> None:
    """Increment of each body by itself, and its compliance where it touches others."""
    right, block, begin, compliance, increment = work.right, work.block, work.begin, work.compliance, work.increment
    matrix, used, x = work.scratch[0], work.scratch[1], work.scratch[2, 0]
    for b in range(increment.shape[0]):
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
            increment[b, 0], increment[b, 1], increment[b, 2] = solve(matrix, x)
            continue
        for j in range(3):
            for i in range(3):
                x[i] = mobility[b, i, j]
                for k in range(3):
                    used[i, k] = matrix[i, k]
            compliance[b, 0, j], compliance[b, 1, j], compliance[b, 2, j] = solve(used, x)
        for i in range(3):
            increment[b, i] = h * (
                compliance[b, i, 0] * right[b, 0]
                + compliance[b, i, 1] * right[b, 1]
                + compliance[b, i, 2] * right[b, 2]
            )


@kernel
def lever(m: Floats, sx: float, sy: float) -> tuple[float, float, float, float, float, float]:
    """Levers of an element for its velocity (two rows of B), with the column of the spin as it is now."""
    return m[0], m[1], sx, m[3], m[4], sy


@kernel
def lever_velocity(
    m: tuple[float, float, float, float, float, float], q: Floats | tuple[float, float, float]
) -> tuple[float, float]:
    """Velocity (m s-1) of an element with levers ``m`` (`lever`) by the twist of its body."""
    return m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]


@kernel
def midpoint_twist(q: Floats, increment: Floats) -> tuple[float, float, float]:
    """Twist of a body halfway through an increment."""
    return q[0] + 0.5 * increment[0], q[1] + 0.5 * increment[1], q[2] + 0.5 * increment[2]


@borrower
def _add_damping(block: Floats, m: tuple[float, float, float, float, float, float], t: Floats) -> None:
    """Add ``B^T C B / 2``, as damping acts at the midpoint of the kick; C stands in the columns 2 to 4 of ``t``."""
    for i in range(3):
        x, y = t[2] * m[i] + t[3] * m[3 + i], t[3] * m[i] + t[4] * m[3 + i]
        for j in range(3):
            block[i, j] += 0.5 * (x * m[j] + y * m[3 + j])


@stage
def _gauss_seidel(island: Island, count: int, h: float, twist: Floats, work: IslandWorkspace) -> bool:
    """Sweep over the bodies in contact until their increments no longer change; see `solve_kick`."""
    bodies, begin, base, increment = twist.shape[0], work.begin, work.right, work.increment
    coupling, other, size = work.coupling, work.other, work.size
    _assemble_coupling(island, count, h, work)
    scale = 0.0
    for b in range(bodies):
        size[b] = math.sqrt(island.matrices.inertia[b, 2, 2] / island.matrices.inertia[b, 0, 0])  # radius of gyration
        scale = max(scale, abs(twist[b, 0]), abs(twist[b, 1]), size[b] * abs(twist[b, 2]))
        scale = max(scale, abs(increment[b, 0]), abs(increment[b, 1]), size[b] * abs(increment[b, 2]))
        for i in range(3):
            base[b, i] = increment[b, i]
    for _ in range(MAX_SWEEPS):
        most = 0.0
        for b in range(bodies):
            if begin[b] == begin[b + 1]:
                continue
            x, y, w = base[b, 0], base[b, 1], base[b, 2]
            for n in range(begin[b], begin[b + 1]):
                d, q = coupling[n], increment[other[n]]
                x += d[0, 0] * q[0] + d[0, 1] * q[1] + d[0, 2] * q[2]
                y += d[1, 0] * q[0] + d[1, 1] * q[1] + d[1, 2] * q[2]
                w += d[2, 0] * q[0] + d[2, 1] * q[1] + d[2, 2] * q[2]
            most = max(most, abs(x - increment[b, 0]), abs(y - increment[b, 1]), size[b] * abs(w - increment[b, 2]))
            increment[b, 0], increment[b, 1], increment[b, 2] = x, y, w
        if most <= SWEEP_RTOL * scale:
            return True
    return False


@stage
def _assemble_coupling(island: Island, count: int, h: float, work: IslandWorkspace) -> None:
    """List for each body its contacts: the other body, and the matrix from its increment to one of this body."""
    fill, coupling, compliance, body_of = work.fill, work.coupling, work.compliance, island.body_of
    for b in range(fill.size):
        fill[b] = work.begin[b]
    for k in range(count):
        i, j = island.first[work.active[k]], island.second[work.active[k]]
        t, s = work.kick_law[k], work.spin_levers[k]
        one, two = lever(island.levers[i], s[0], s[1]), lever(island.levers[j], s[2], s[3])
        for end in range(2):
            b, here, there = (body_of[i], one, two) if end == 0 else (body_of[j], two, one)
            n = fill[b]
            fill[b], work.other[n] = n + 1, body_of[j] if end == 0 else body_of[i]
            for c in range(3):
                # By an increment of 1 in direction c of the other body: half the force of damping, as in `_add_damping`.
                fx = 0.5 * (t[2] * there[c] + t[3] * there[3 + c])
                fy = 0.5 * (t[3] * there[c] + t[4] * there[3 + c])
                x, y, w = here[0] * fx + here[3] * fy, here[1] * fx + here[4] * fy, here[2] * fx + here[5] * fy
                for r in range(3):
                    coupling[n, r, c] = h * (
                        compliance[b, r, 0] * x + compliance[b, r, 1] * y + compliance[b, r, 2] * w
                    )
