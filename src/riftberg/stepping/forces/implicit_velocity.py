"""Semi-implicit velocity of one element under external forces and partners (equations 4.2, 4.3).

One routine serves the schemes, which differ in the share s of drag and damping that acts: 1 in single steps, 1/2 where
the result is applied as two half kicks of the long step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.momentum import mean_speed, solve_two_by_two
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.forces.interactions import Partners, Terms, interaction_terms
from riftberg.stepping.forces.media import LINEAR, MEDIA, PUSH_X, PUSH_Y, QUADRATIC, Surroundings, U, V, keep_applied
from riftberg.stepping.forces.touching import contact_terms

WITH_SURROUNDINGS, INTERACTIONS_ONLY = 0, 1


class Solution(NamedTuple):
    """Acceleration A, its explicit part a and implicit remainder b (m s-2), and the damping force (N) of partners."""

    total_x: float
    total_y: float
    a_x: float
    a_y: float
    b_x: float
    b_y: float
    damping_x: float
    damping_y: float


@kernel
def _stage_speed(u1, v1, us, vs, uk, vk):
    """Speed of the mean of iterate and stage velocity relative to a medium (Runge-Kutta without predictor-corrector)."""
    du, dv = 0.5 * (u1 + us) - uk, 0.5 * (v1 + vs) - vk
    return (du * du + dv * dv) ** 0.5


@kernel
def drags(e, u_star, v_star, media, rates, acts, mean_speeds, u1, v1, u0, v0, us, vs):
    """Sum the drags of the media that act: deceleration at (u_star, v_star), m s-2, and rate, s-1; keep each rate."""
    drag_x = drag_y = total = 0.0
    for m in range(len(MEDIA)):
        if not acts[m]:
            continue
        uk, vk, rate = media[e, m, U], media[e, m, V], media[e, m, LINEAR]
        if media[e, m, QUADRATIC] != 0.0:
            speed = mean_speed(u1, v1, u0, v0, uk, vk) if mean_speeds else _stage_speed(u1, v1, us, vs, uk, vk)
            rate += media[e, m, QUADRATIC] * speed
        rates[e, m] = rate
        drag_x += rate * (u_star - uk)
        drag_y += rate * (v_star - vk)
        total += rate
    return drag_x, drag_y, total


@kernel
def pushes(e, media, acts):
    """Sum of the pushes of the media that act on element ``e``, m s-2."""
    push_x = push_y = 0.0
    for m in range(len(MEDIA)):
        if acts[m]:
            push_x += media[e, m, PUSH_X]
            push_y += media[e, m, PUSH_Y]
    return push_x, push_y


@kernel
def solve_once(
    e: int, u_star: float, v_star: float, u0: float, v0: float, us: float, vs: float, u1: float, v1: float,
    push_x: float, push_y: float, f: float, media: Floats, rates: Floats, acts: NDArray[np.bool_], t: Terms, share: float,
    explicit_part: float, mean_speeds: bool, turn_part: float, mode: int, dt: float,
) -> tuple[float, float]:  # fmt: skip
    """One pass of the solve: acceleration (m s-2) with drag at the iterate (u1, v1).

    ``push_x`` and ``push_y`` are the explicit accelerations, springs included; ``turn_part`` is the part of the
    change of the Coriolis force that is implicit; other arguments as in `solve_velocity`.
    """
    damp_x = t.p11 * u_star + t.p12 * v_star - t.px
    damp_y = t.p12 * u_star + t.p22 * v_star - t.py
    if mode == INTERACTIONS_ONLY:
        rx, ry = 0.5 * t.ix - share * damp_x, 0.5 * t.iy - share * damp_y
        rate = turn = 0.0
    else:
        drag_x, drag_y, rate = drags(e, u_star, v_star, media, rates, acts, mean_speeds, u1, v1, u0, v0, us, vs)
        rx = explicit_part * push_x - share * (drag_x + damp_x)
        ry = explicit_part * push_y - share * (drag_y + damp_y)
        turn = turn_part * f
    a11 = 1.0 + share * dt * (rate + t.p11)
    a22 = 1.0 + share * dt * (rate + t.p22)
    a12 = share * dt * (t.p12 - turn)
    a21 = share * dt * (t.p12 + turn)
    return solve_two_by_two(a11, a12, a21, a22, rx, ry)


@kernel
def explicit_acceleration(
    u1: float, v1: float, push_x: float, push_y: float, f: float, t: Terms, explicit_part: float, mode: int
) -> tuple[float, float]:
    """Explicit acceleration (m s-2) to carry to the next step: springs, slope, waves and Coriolis at the new velocity."""
    if mode == INTERACTIONS_ONLY:
        return t.ix, t.iy
    if explicit_part < 1.0:
        return push_x + t.ix + f * v1, push_y + t.iy - f * u1
    return 0.0, 0.0


@kernel
def apply_at_velocities(el: Elements, around: Surroundings) -> None:
    """Keep the forces of a moment: those that act at the velocities of the elements, without a step."""
    motion, media, rates, acts = el.motion, around.media, around.rate, around.acts
    applied, coriolis = around.applied, around.coriolis
    for e in range(motion.u.size):
        u, v = motion.u[e], motion.v[e]
        drags(e, u, v, media, rates, acts, True, u, v, u, v, u, v)
        keep_applied(e, u, v, u, v, media, rates, acts, coriolis[e], applied)


@stage
def solve_velocity(
    e, x, y, u_star, v_star, u0, v0, us, vs, media, rates, acts, coriolis, applied, share, explicit_part, mean_speeds,
    from_start, centred, mode, dt, mass, isolated, partners, plain, bond_size, view, law,
):  # fmt: skip
    """Solve for the acceleration of element ``e`` over ``dt`` seconds.

    ``x``, ``y``: position, degrees or m; ``u_star``, ``v_star``: velocity with the explicit half kick, m s-1.
    """
    t = Terms(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not isolated:
        ud, vd = (u0, v0) if from_start else (us, vs)
        t = interaction_terms(e, x, y, u0, v0, ud, vd, partners, plain, bond_size, view, law)
    # Runge-Kutta evaluates the explicit Coriolis force at the stage, Verlet at the half-kicked velocity.
    cu, cv = (u_star, v_star) if explicit_part < 1.0 else (us, vs)
    f = coriolis[e]
    media_x, media_y = pushes(e, media, acts)
    push_x = media_x + t.ix + f * cv
    push_y = media_y + t.iy - f * cu
    # The matrix adds what the change of velocity adds to the Coriolis force: all, half, or nothing in Runge-Kutta stages.
    turn_part = 1.0 if centred else (0.5 if explicit_part < 1.0 else 0.0)
    ud, vd = (u0, v0) if from_start and mean_speeds else (us, vs)
    ax, ay = solve_once(
        e, u_star, v_star, u0, v0, us, vs, ud, vd, push_x, push_y, f, media, rates, acts, t, share, explicit_part,
        mean_speeds, turn_part, mode, dt,
    )  # fmt: skip
    if not isolated:
        ud, vd = u_star + dt * ax, v_star + dt * ay
        if from_start and not mean_speeds:
            ud, vd = 0.5 * (ud + us), 0.5 * (vd + vs)
        t = interaction_terms(e, x, y, u0, v0, ud, vd, partners, plain, bond_size, view, law)
    return _corrected(
        e, t, ax, ay, u_star, v_star, u0, v0, us, vs, cu, cv, media_x, media_y, push_x, push_y, f, media, rates, acts,
        applied, share, explicit_part, mean_speeds, centred, turn_part, mode, dt, mass,
    )  # fmt: skip


@stage
def solve_in_contact(
    e, u, v, media, rates, acts, coriolis, applied, centred, mode, dt, mass, touching, u_shown, v_shown, by_speed
):  # fmt: skip
    """Solve as `solve_velocity` for a slow half kick, with contacts whose geometry has been found (`Touching`).

    ``u``, ``v``: velocity of the element, m s-1.
    """
    t = contact_terms(e, u, v, u, v, touching, u_shown, v_shown, by_speed)
    f = coriolis[e]
    media_x, media_y = pushes(e, media, acts)
    push_x = media_x + t.ix + f * v
    push_y = media_y + t.iy - f * u
    turn_part = 1.0 if centred else 0.5
    ax, ay = solve_once(
        e, u, v, u, v, u, v, u, v, push_x, push_y, f, media, rates, acts, t, 0.5, 0.5, True, turn_part, mode, dt
    )
    t = contact_terms(e, u, v, u + dt * ax, v + dt * ay, touching, u_shown, v_shown, by_speed)
    return _corrected(
        e, t, ax, ay, u, v, u, v, u, v, u, v, media_x, media_y, push_x, push_y, f, media, rates, acts, applied, 0.5, 0.5,
        True, centred, turn_part, mode, dt, mass,
    )  # fmt: skip


@stage
def _corrected(
    e, t, ax, ay, u_star, v_star, u0, v0, us, vs, cu, cv, media_x, media_y, push_x, push_y, f, media, rates, acts, applied,
    share, explicit_part, mean_speeds, centred, turn_part, mode, dt, mass,
):  # fmt: skip
    """Solve for the second time, with what acts at the velocity that the first pass found; see `solve_velocity`."""
    u1, v1 = u_star + dt * ax, v_star + dt * ay
    du, dv = (u1, v1) if centred else (u0, v0)
    ax, ay = solve_once(
        e, u_star, v_star, du, dv, us, vs, u1, v1, push_x, push_y, f, media, rates, acts, t, share, explicit_part,
        mean_speeds, turn_part, mode, dt,
    )  # fmt: skip
    u1, v1 = u_star + dt * ax, v_star + dt * ay
    a_x, a_y = explicit_acceleration(u1, v1, media_x, media_y, f, t, explicit_part, mode)
    if mode == WITH_SURROUNDINGS:
        ahead = 2.0 * share * turn_part * dt
        keep_applied(e, u1, v1, cu + ahead * ax, cv + ahead * ay, media, rates, acts, f, applied)
    return Solution(
        ax,
        ay,
        a_x,
        a_y,
        (ax - 0.5 * a_x) / share,
        (ay - 0.5 * a_y) / share,
        mass * (t.px - t.p11 * u1 - t.p12 * v1),
        mass * (t.py - t.p12 * u1 - t.p22 * v1),
    )


@kernel
def is_isolated(e: int, bonded: Ints, same: Ints, other: Ints) -> bool:
    """Whether an element has no partner of any kind; the arrays are the ``start`` of the lists of `Partners`."""
    return bonded[e + 1] == bonded[e] and same[e + 1] == same[e] and other[e + 1] == other[e]


@kernel
def find_isolated(partners: Partners, isolated: NDArray[np.bool_]) -> None:
    """Find whether each element has no partner of any kind."""
    bonded, same, other = partners.bonded.start, partners.same_berg.start, partners.collision.start
    for e in range(isolated.size):
        isolated[e] = is_isolated(e, bonded, same, other)
