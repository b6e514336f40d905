"""Sub-steps of bodies in contact: each island goes through the step by itself.

Leapfrog sub-steps are as short as the stiffest contact demands, and as long as the step where none is near. They work on
three numbers a body; the media and the sea floor are those of the start of the step, at the velocities of the moment:

    M dq = H (G(q) - S dq / 2 - L (q + dq) + B^T (F - C B (q + dq / 2)))

with the forces G by the media, S minus their derivative, the drag L of the sea floor, springs F and damping C of contact.
H is the mean of the sub-steps before and after. Impulses of contact are equal and opposite, so they conserve momentum.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.state import Floats
from riftberg.stepping.bodies.dynamics import (
    add_forces,
    assemble_force_and_jacobian,
    drag_and_jacobian,
    element_velocity,
)
from riftberg.stepping.contact.impulses import (
    Island,
    IslandResult,
    Islands,
    IslandWorkspace,
    allocate_island_workspace,
    allocate_result,
    find_contacts,
    island_part,
    lever,
    lever_velocity,
    midpoint_twist,
    result_part,
    solve_kick,
)
from riftberg.stepping.forces.media import CORIOLIS, MEDIA, SEA_FLOOR
from riftberg.stepping.forces.pair_law import PairLaw

REFRESH_FRACTION: Final = 1.0 / 32.0
"""Part of the step after which the forces of the media are evaluated anew; between, they are linear in the velocities.

Media change over hours and velocities by contact within minutes: 32 times a step of half an hour is once a minute.
"""


REFRESH_SPEED: Final = 2e-3
"""Change of a body's velocity (m s-1) up to which the linear media stay: their error is its square times the drag."""


class Linearisation(NamedTuple):
    """The forces of the media, linear about the twists at which they were evaluated last."""

    twist: Floats  # shape (bodies, 3)
    force: Floats  # G at these; shape (bodies, 3)
    jacobian: Floats  # S; shape (bodies, 3, 3)
    twist_integral: Floats  # Integral of the twists over the time since, m, m, rad; shape (bodies, 3)


@kernel
def integrate_islands(
    lists: Islands, whole: Island, twist: Floats, dt: float, law: PairLaw
) -> tuple[Floats, Floats, NDArray[np.bool_], Floats, Floats, Floats, Floats, float]:
    """Take all islands, ``whole``, through a step of ``dt`` s.

    Returns what `IslandResult` has, and the shortest sub-step (s; not positive where velocities did not converge).
    """
    r, shortest = allocate_result(whole, twist), dt
    for k in range(lists.start.size - 1):
        island, result = island_part(lists, k, whole), result_part(lists, k, r)
        bodies, rows = island.bonded.size, island.body_of.size
        work = allocate_island_workspace(bodies, island.first.size, rows, whole.forcing.media.shape[1] + 1)
        for i in range(rows):
            m, a = island.levers[i], island.body_of[i]
            work.arm[a] = max(work.arm[a], math.hypot(m[2], m[5]))
        about = allocate_linearisation(result.twist)
        shortest = min(shortest, _integrate_island(island, result, about, dt, law, work))
    return r.twist, r.path, r.touched, r.applied, r.peak_force, r.peak_axes, r.peak_spin, shortest


@borrower
def _integrate_island(
    island: Island, result: IslandResult, about: Linearisation, dt: float, law: PairLaw, work: IslandWorkspace
) -> float:
    """Take one island through the step; returns its shortest sub-step (s), -1 where velocities did not converge."""
    twist = result.twist
    left, before, shortest, elapsed = dt, 0.0, dt, np.inf
    while True:
        if left <= 0.0 or elapsed >= REFRESH_FRACTION * dt:
            accumulate_impulse(island, about, elapsed, result.applied)
            evaluate_media(island, twist, about, work.everyone, work.accelerations, work.force)
            elapsed = 0.0
        linearised_force(about, island.matrices.floor_drag, twist, work.net_force)
        count, max_dt = find_contacts(island, law, twist, result.path, result.touched, work)
        step = 0.0
        if left > 0.0:
            # The rest in equal parts, so that the last one is no shorter than it must be.
            step = left / math.ceil(left / max_dt - 1e-9) if max_dt < left else left
            shortest = min(shortest, step)
        # Leapfrog: a kick over half the steps before and after, then the drift. The first kick has no step before it, the
        # last one none after, and ends the loop.
        h = 0.5 * (before + step)
        if not solve_kick(island, about.jacobian, count, before, step, twist, work):
            return -1.0
        _record_peak_load(island, count, result, work)
        for b in range(twist.shape[0]):
            for i in range(3):
                about.twist_integral[b, i] += h * (twist[b, i] + 0.5 * work.increment[b, i])
                twist[b, i] += work.increment[b, i]
                result.path[b, i] += step * twist[b, i]
        elapsed += h
        accumulate_floor_impulse(island, twist, h, result.applied)
        if left <= 0.0:
            accumulate_impulse(island, about, elapsed, result.applied)
            return shortest
        left -= step
        if left < 1e-9 * dt:
            left = 0.0
        before = step


@kernel
def allocate_linearisation(twist: Floats) -> Linearisation:
    """Return one that nothing has been evaluated for."""
    bodies = twist.shape[0]
    return Linearisation(twist.copy(), np.zeros((bodies, 3)), np.zeros((bodies, 3, 3)), np.zeros((bodies, 3)))


@borrower
def evaluate_media(
    island: Island, twist: Floats, about: Linearisation, everyone: NDArray[np.bool_], accelerations: Floats, force: Floats
) -> None:  # fmt: skip
    """Evaluate the media at ``twist``; ``force`` takes what acts on the elements (N, N, N m)."""
    forcing = island.forcing
    about.force[:, :], about.jacobian[:, :, :], about.twist_integral[:, :] = 0.0, 0.0, 0.0
    for b in range(twist.shape[0]):
        for i in range(3):
            about.twist[b, i] = twist[b, i]
    add_forces(island.body_of, island.levers, twist, forcing, accelerations, force, about.force)
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
    """Add what the media did in the ``time`` s since they were evaluated, by the integral of the twists since."""
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
            if forcing.media_act or (k == SEA_FLOOR and forcing.floor_acts):
                ax, ay, xx, xy, yy = drag_and_jacobian(forcing.media[e, k], u, v)
                applied[e, k, 0] += time * ax - xx * du - xy * dv
                applied[e, k, 1] += time * ay - xy * du - yy * dv


@stage
def linearised_force(about: Linearisation, floor_drag: Floats, twist: Floats, net_force: Floats) -> None:
    """Find the forces on the bodies at ``twist``, with the linear drag of the sea floor and without contact."""
    for b in range(twist.shape[0]):
        for i in range(3):
            net_force[b, i] = about.force[b, i]
            for j in range(3):
                net_force[b, i] -= (
                    about.jacobian[b, i, j] * (twist[b, j] - about.twist[b, j]) + floor_drag[b, i, j] * twist[b, j]
                )


@stage
def _record_peak_load(island: Island, count: int, result: IslandResult, work: IslandWorkspace) -> None:
    """Record the loads of the bonded bodies that contact presses harder in this kick than before in the step."""
    if count == 0:
        return
    body_of, levers, bonded, twist = island.body_of, island.levers, island.bonded, result.twist
    size, contact_force, active, peak, harder = work.size, work.contact_force, work.active, work.peak, False
    size[:] = 0.0
    contact_force[:, :] = 0.0
    for k in range(count):
        i, j, t, s = island.first[active[k]], island.second[active[k]], work.law[k], work.spin_levers[k]
        a, b = body_of[i], body_of[j]
        if not (bonded[a] or bonded[b]):
            continue
        wx, wy = lever_velocity(lever(levers[j], s[2], s[3]), midpoint_twist(twist[b], work.increment[b]))
        ux, uy = lever_velocity(lever(levers[i], s[0], s[1]), midpoint_twist(twist[a], work.increment[a]))
        fx = t[0] + t[2] * (wx - ux) + t[3] * (wy - uy)
        fy = t[1] + t[3] * (wx - ux) + t[4] * (wy - uy)
        contact_force[i, 0] += fx
        contact_force[i, 1] += fy
        contact_force[j, 0] -= fx
        contact_force[j, 1] -= fy
        for c in (a, b):
            size[c] += math.sqrt(fx * fx + fy * fy)
            harder = harder or (bonded[c] and size[c] > peak[c])
    if not harder:
        return
    record_loads(island, size, peak, twist, result.path, work.force, contact_force, result)


@borrower
def record_loads(
    island: Island, size: Floats, peak: Floats, twist: Floats, path: Floats, force: Floats, contact_force: Floats,
    result: IslandResult,
) -> None:  # fmt: skip
    """Record the loads of the bonded bodies on which the forces of contact add up to more, ``size``, than so far, ``peak`` (N).

    ``twist``, ``path``: of the bodies now; ``force``, ``contact_force``: on the elements by media and by contact (N, N, N m).
    """
    body_of, forcing = island.body_of, island.forcing
    for e in range(body_of.size):
        b = body_of[e]
        if not (island.bonded[b] and size[b] > peak[b]):
            continue
        m, q = island.levers[e], twist[b]
        floor = forcing.mass[e] * forcing.floor_rate[e]
        u, v, w = element_velocity(m, q)
        result.peak_force[e, 0] = force[e, 0] + contact_force[e, 0] - floor * u
        result.peak_force[e, 1] = force[e, 1] + contact_force[e, 1] - floor * v
        result.peak_force[e, 2] = (
            force[e, 2] + contact_force[e, 2] - forcing.inertia[e] * forcing.floor_spin_rate[e] * w
        )
        c, s = math.cos(path[b, 2]), math.sin(path[b, 2])
        result.peak_axes[e, 0], result.peak_axes[e, 1] = m[9] * c - m[10] * s, m[10] * c + m[9] * s
        result.peak_spin[b] = q[2]
    for b in range(size.size):
        peak[b] = max(peak[b], size[b])


@stage
def accumulate_floor_impulse(island: Island, twist: Floats, h: float, applied: Floats) -> None:
    """Add what the linear drag of the sea floor did in ``h`` s: it is implicit, so at the velocities that it ended with."""
    forcing = island.forcing
    for e in range(island.body_of.size):
        if forcing.floor_rate[e] > 0.0:
            m, q, f = island.levers[e], twist[island.body_of[e]], h * forcing.floor_rate[e]
            applied[e, SEA_FLOOR, 0] -= f * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2])
            applied[e, SEA_FLOOR, 1] -= f * (m[3] * q[0] + m[4] * q[1] + m[5] * q[2])
