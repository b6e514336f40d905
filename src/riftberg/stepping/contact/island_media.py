"""The media in the sub-steps of an island, and what they leave: impulses on the elements, loads at the largest force of contact.

Media and sea floor are those of the start of the step, linear about the velocities at which they were evaluated last:

    M dq = H (G(q) - S dq / 2 - L (q + dq) + contact)

with the forces G by the media, S minus their derivative, and the drag L of the sea floor.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.state import Floats
from riftberg.stepping.bodies.dynamics import (
    add_forces,
    assemble_force_and_jacobian,
    drag_and_jacobian,
    element_velocity,
)
from riftberg.stepping.contact.islands import Island, IslandResult
from riftberg.stepping.forces.media import CORIOLIS, MEDIA, SEA_FLOOR

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


@borrower
def linearised_force(about: Linearisation, floor_drag: Floats, twist: Floats, net_force: Floats) -> None:
    """Find the forces on the bodies at ``twist``, with the linear drag of the sea floor and without contact."""
    for b in range(twist.shape[0]):
        for i in range(3):
            net_force[b, i] = about.force[b, i]
            for j in range(3):
                net_force[b, i] -= (
                    about.jacobian[b, i, j] * (twist[b, j] - about.twist[b, j]) + floor_drag[b, i, j] * twist[b, j]
                )


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


@borrower
def accumulate_floor_impulse(island: Island, twist: Floats, h: float, applied: Floats) -> None:
    """Add what the linear drag of the sea floor did in ``h`` s: it is implicit, so at the velocities that it ended with."""
    forcing = island.forcing
    for e in range(island.body_of.size):
        if forcing.floor_rate[e] > 0.0:
            m, q, f = island.levers[e], twist[island.body_of[e]], h * forcing.floor_rate[e]
            applied[e, SEA_FLOOR, 0] -= f * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2])
            applied[e, SEA_FLOOR, 1] -= f * (m[3] * q[0] + m[4] * q[1] + m[5] * q[2])
