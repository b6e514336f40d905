"""Semi-implicit velocity of one element under external forces and partners (equations 4.2, 4.3).

The acceleration A over a step of length dt solves, with J (u, v) = (v, -u),

    A = w (F + I + f J c)  -  theta [r (u* + dt A - V) + P (u* + dt A) - P u_p]  +  theta kappa f dt J A

u* is the velocity with the explicit half kick; F the pushes of the media and I the springs of the partners; r the rates of the
media's drag and V their velocities; P the damping tensor of the partners and u_p their velocities; f the Coriolis parameter
and c the velocity at which its explicit part is taken. Rates and damping depend on the velocity, so the equation is solved
twice: with those at the start, and with those at the velocity that the first solution gives.

KID's files keep A in two parts, A = a / 2 + theta b: a are the explicit accelerations at the new velocity, with which the next
step begins, and b is what then is left, b = (A - a / 2) / theta.

`SolveScheme` has the weights by which the schemes differ.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.momentum import mean_speed, solve_two_by_two
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.forces.media import LINEAR, MEDIA, PUSH_X, PUSH_Y, QUADRATIC, Surroundings, U, V, record_applied
from riftberg.stepping.forces.pair_law import (
    ContactTable,
    NeighbourLists,
    PairLaw,
    PairView,
    Terms,
    contact_terms,
    interaction_terms,
)

WITH_SURROUNDINGS, INTERACTIONS_ONLY = 0, 1
"""Whether media and Coriolis force act beside the partners."""


class SolveScheme(NamedTuple):
    """Weights of the solve in one scheme."""

    theta: float  # Weight of drag and damping: 1 in single steps, 1/2 where the result acts in two half kicks
    explicit_weight: float  # Weight w of the explicit accelerations; what is left of them is a / 2 of the next step
    coriolis_implicitness: float  # kappa: how much of the change of the Coriolis force is implicit
    mean_speeds: bool  # Drag by the mean of the speeds at start and iterate, not by the speed of the mean velocity
    from_start: bool  # First guess is the velocity at the start of the step, not that of the stage (Runge-Kutta)
    centred: bool  # The second solve takes the speed in the drag at the new velocity alone


VERLET: Final = SolveScheme(1.0, 0.5, 0.5, True, False, False)
"""Velocity Verlet: half of a is in u* already."""

OUTER_KICK: Final = SolveScheme(0.5, 0.5, 1.0, True, False, True)
"""The outer half kicks, centred: after the kick of both half kicks the Coriolis force is that of the mean velocity."""

OUTER_KICK_UNCENTRED: Final = SolveScheme(0.5, 0.5, 0.5, True, False, False)
"""The outer half kicks as the reference has them, of first order; its implicit sub-steps too."""


@kernel
def runge_kutta_scheme(mean_speeds: bool, from_start: bool) -> SolveScheme:
    """Stages of Runge-Kutta: all of the explicit accelerations, none of the Coriolis force implicit."""
    return SolveScheme(1.0, 1.0, 0.0, mean_speeds, from_start, False)


class Solution(NamedTuple):
    """Result of the solve for one element."""

    total_x: float  # Acceleration A, m s-2
    total_y: float
    a_x: float  # Its explicit part a, m s-2
    a_y: float
    b_x: float  # Its implicit remainder b, m s-2
    b_y: float
    damping_x: float  # Damping force of the partners, N
    damping_y: float


@kernel
def _stage_speed(u1: float, v1: float, us: float, vs: float, uk: float, vk: float) -> float:
    """Speed of the mean of iterate and stage velocity relative to a medium (Runge-Kutta without predictor-corrector)."""
    du, dv = 0.5 * (u1 + us) - uk, 0.5 * (v1 + vs) - vk
    return float((du * du + dv * dv) ** 0.5)


@kernel
def drags(
    e: int, u_star: float, v_star: float, media: Floats, rates: Floats, acts: NDArray[np.bool_], mean_speeds: bool,
    u1: float, v1: float, u0: float, v0: float, us: float, vs: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Sum the drags of the media that act: deceleration at (u_star, v_star), m s-2, and rate, s-1; store each rate."""
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
def pushes(e: int, media: Floats, acts: NDArray[np.bool_]) -> tuple[float, float]:
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
    push_x: float, push_y: float, f: float, media: Floats, rates: Floats, acts: NDArray[np.bool_], t: Terms,
    scheme: SolveScheme, mode: int, dt: float,
) -> tuple[float, float]:  # fmt: skip
    """Solve for the acceleration (m s-2) with the drag at the iterate (u1, v1).

    ``push_x``, ``push_y``: explicit accelerations, those of springs and of the Coriolis force included, m s-2.
    """
    theta = scheme.theta
    damp_x = t.p11 * u_star + t.p12 * v_star - t.px
    damp_y = t.p12 * u_star + t.p22 * v_star - t.py
    if mode == INTERACTIONS_ONLY:
        rx, ry = 0.5 * t.ix - theta * damp_x, 0.5 * t.iy - theta * damp_y
        rate = turn = 0.0
    else:
        drag_x, drag_y, rate = drags(e, u_star, v_star, media, rates, acts, scheme.mean_speeds, u1, v1, u0, v0, us, vs)
        rx = scheme.explicit_weight * push_x - theta * (drag_x + damp_x)
        ry = scheme.explicit_weight * push_y - theta * (drag_y + damp_y)
        turn = scheme.coriolis_implicitness * f
    a11 = 1.0 + theta * dt * (rate + t.p11)
    a22 = 1.0 + theta * dt * (rate + t.p22)
    a12 = theta * dt * (t.p12 - turn)
    a21 = theta * dt * (t.p12 + turn)
    return solve_two_by_two(a11, a12, a21, a22, rx, ry)


@stage
def solve_velocity(
    e: int, x: float, y: float, u_star: float, v_star: float, u0: float, v0: float, us: float, vs: float, media: Floats,
    rates: Floats, acts: NDArray[np.bool_], coriolis: Floats, applied: Floats, scheme: SolveScheme, mode: int,
    dt: float, mass: float, isolated: bool, partners: NeighbourLists, plain: bool, bond_size: bool, view: PairView,
    law: PairLaw,
) -> Solution:  # fmt: skip
    """Solve for the acceleration of element ``e`` over ``dt`` seconds.

    ``x``, ``y``: position, degrees or m; ``u_star``, ``v_star``: velocity with the explicit half kick, ``u0``, ``v0`` that at the
    start of the step, ``us``, ``vs`` that of the stage (elsewhere that at the start), m s-1.
    """
    t = Terms(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not isolated:
        ud, vd = (u0, v0) if scheme.from_start else (us, vs)
        t = interaction_terms(e, x, y, u0, v0, ud, vd, partners, plain, bond_size, view, law)
    # Runge-Kutta evaluates the explicit Coriolis force at the stage, Verlet at the half-kicked velocity.
    cu, cv = (u_star, v_star) if scheme.explicit_weight < 1.0 else (us, vs)
    f = coriolis[e]
    media_x, media_y = pushes(e, media, acts)
    push_x = media_x + t.ix + f * cv
    push_y = media_y + t.iy - f * cu
    ud, vd = (u0, v0) if scheme.from_start and scheme.mean_speeds else (us, vs)
    ax, ay = solve_once(
        e, u_star, v_star, u0, v0, us, vs, ud, vd, push_x, push_y, f, media, rates, acts, t, scheme, mode, dt
    )
    if not isolated:
        ud, vd = u_star + dt * ax, v_star + dt * ay
        if scheme.from_start and not scheme.mean_speeds:
            ud, vd = 0.5 * (ud + us), 0.5 * (vd + vs)
        t = interaction_terms(e, x, y, u0, v0, ud, vd, partners, plain, bond_size, view, law)
    return _second_solve(
        e, t, ax, ay, u_star, v_star, u0, v0, us, vs, cu, cv, media_x, media_y, push_x, push_y, f, media, rates, acts,
        applied, scheme, mode, dt, mass,
    )  # fmt: skip


@stage
def solve_in_contact(
    e: int, u: float, v: float, media: Floats, rates: Floats, acts: NDArray[np.bool_], coriolis: Floats,
    applied: Floats, scheme: SolveScheme, mode: int, dt: float, mass: float, table: ContactTable, u_shown: Floats,
    v_shown: Floats, by_speed: bool,
) -> Solution:  # fmt: skip
    """Solve as `solve_velocity` for an outer half kick, with contacts whose geometry has been found (`ContactTable`).

    ``u``, ``v``: velocity of the element, m s-1.
    """
    t = contact_terms(e, u, v, u, v, table, u_shown, v_shown, by_speed)
    f = coriolis[e]
    media_x, media_y = pushes(e, media, acts)
    push_x = media_x + t.ix + f * v
    push_y = media_y + t.iy - f * u
    ax, ay = solve_once(e, u, v, u, v, u, v, u, v, push_x, push_y, f, media, rates, acts, t, scheme, mode, dt)
    t = contact_terms(e, u, v, u + dt * ax, v + dt * ay, table, u_shown, v_shown, by_speed)
    return _second_solve(
        e, t, ax, ay, u, v, u, v, u, v, u, v, media_x, media_y, push_x, push_y, f, media, rates, acts, applied, scheme,
        mode, dt, mass,
    )  # fmt: skip


@stage
def _second_solve(
    e: int, t: Terms, ax: float, ay: float, u_star: float, v_star: float, u0: float, v0: float, us: float, vs: float,
    cu: float, cv: float, media_x: float, media_y: float, push_x: float, push_y: float, f: float, media: Floats,
    rates: Floats, acts: NDArray[np.bool_], applied: Floats, scheme: SolveScheme, mode: int, dt: float, mass: float,
) -> Solution:  # fmt: skip
    """Solve with what acts at the velocity that the first solution gives, and split the acceleration."""
    u1, v1 = u_star + dt * ax, v_star + dt * ay
    du, dv = (u1, v1) if scheme.centred else (u0, v0)
    # Springs stay those of the first solution: only the damping of the partners is taken at the new velocity.
    ax, ay = solve_once(
        e, u_star, v_star, du, dv, us, vs, u1, v1, push_x, push_y, f, media, rates, acts, t, scheme, mode, dt
    )
    u1, v1 = u_star + dt * ax, v_star + dt * ay
    if mode == INTERACTIONS_ONLY:
        a_x, a_y = t.ix, t.iy
    elif scheme.explicit_weight < 1.0:
        a_x, a_y = media_x + t.ix + f * v1, media_y + t.iy - f * u1
    else:
        a_x, a_y = 0.0, 0.0
    if mode == WITH_SURROUNDINGS:
        # The velocity at which the Coriolis force acted, explicit and implicit part together.
        ahead = 2.0 * scheme.theta * scheme.coriolis_implicitness * dt
        record_applied(e, u1, v1, cu + ahead * ax, cv + ahead * ay, media, rates, acts, f, applied)
    b_x, b_y = (ax - 0.5 * a_x) / scheme.theta, (ay - 0.5 * a_y) / scheme.theta
    damping_x, damping_y = mass * (t.px - t.p11 * u1 - t.p12 * v1), mass * (t.py - t.p12 * u1 - t.p22 * v1)
    return Solution(ax, ay, a_x, a_y, b_x, b_y, damping_x, damping_y)


@kernel
def apply_at_velocities(el: Elements, around: Surroundings) -> None:
    """Record the forces of a moment: those that act at the velocities of the elements, without a step."""
    motion, media, rates, acts = el.motion, around.media, around.rate, around.acts
    applied, coriolis = around.applied, around.coriolis
    for e in range(motion.u.size):
        u, v = motion.u[e], motion.v[e]
        drags(e, u, v, media, rates, acts, True, u, v, u, v, u, v)
        record_applied(e, u, v, u, v, media, rates, acts, coriolis[e], applied)


@kernel
def is_isolated(e: int, bonded: Ints, same: Ints, other: Ints) -> bool:
    """Whether an element has no partner of any kind; the arrays are the ``start`` of the lists of `NeighbourLists`."""
    return bool(bonded[e + 1] == bonded[e] and same[e + 1] == same[e] and other[e + 1] == other[e])


@kernel
def find_isolated(partners: NeighbourLists, isolated: NDArray[np.bool_]) -> None:
    """Find whether each element has no partner of any kind."""
    bonded, same, other = partners.bonded.start, partners.same_berg.start, partners.collision.start
    for e in range(isolated.size):
        isolated[e] = is_isolated(e, bonded, same, other)
