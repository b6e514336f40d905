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

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.common.forces.media import (
    LINEAR,
    MEDIA,
    PUSH_X,
    PUSH_Y,
    QUADRATIC,
    Surroundings,
    U,
    V,
    record_applied,
)
from riftberg.engines.common.forces.pair_law import (
    ContactTable,
    Mover,
    NeighbourLists,
    PairLaw,
    PairView,
    Terms,
    contact_terms,
    interaction_terms,
)
from riftberg.state import Elements, Floats, Ints

WITH_SURROUNDINGS, INTERACTIONS_ONLY = 0, 1
"""Whether media and Coriolis force act beside the partners."""


@kernel
def mean_speed(u1: float, v1: float, u0: float, v0: float, uk: float, vk: float) -> float:
    """Half the sum of the speeds relative to a medium (uk, vk) of the current iterate and of the start, m s-1."""
    return 0.5 * (
        math.sqrt((u1 - uk) * (u1 - uk) + (v1 - vk) * (v1 - vk))
        + math.sqrt((u0 - uk) * (u0 - uk) + (v0 - vk) * (v0 - vk))
    )


@kernel
def solve_two_by_two(a11: float, a12: float, a21: float, a22: float, rx: float, ry: float) -> tuple[float, float]:
    """Solve a 2 x 2 system by Cramer's rule."""
    inverse = 1.0 / (a11 * a22 - a12 * a21)
    return inverse * (a22 * rx - a12 * ry), inverse * (a11 * ry - a21 * rx)


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


class Solve(NamedTuple):
    """How the equation is solved for all elements."""

    scheme: SolveScheme
    mode: int  # `WITH_SURROUNDINGS` or `INTERACTIONS_ONLY`
    dt: float  # s


class ElementState(NamedTuple):
    """Position and velocities of one element before the solve; numbers alone, so that no references are counted."""

    x: float  # Degrees or m
    y: float
    u_star: float  # Velocity with the explicit half kick, m s-1
    v_star: float
    u0: float  # At the start of the step
    v0: float
    us: float  # Of the stage (Runge-Kutta); elsewhere that at the start
    vs: float


class ExplicitTerms(NamedTuple):
    """What acts on one element whatever its new velocity."""

    media_x: float  # Pushes of the media, m s-2
    media_y: float
    push_x: float  # With the springs of the partners and the explicit Coriolis force
    push_y: float
    cu: float  # Velocity at which that is taken, m s-1
    cv: float
    f: float  # Coriolis parameter, s-1


class Solution(NamedTuple):
    """Result of the solve for one element."""

    total_x: float  # Acceleration A, m s-2
    total_y: float
    a_x: float  # Its explicit part a, m s-2
    a_y: float
    b_x: float  # Its implicit remainder b, m s-2
    b_y: float
    damping_x: float  # Acceleration by the damping of the partners, m s-2
    damping_y: float


@kernel
def _stage_speed(u1: float, v1: float, us: float, vs: float, uk: float, vk: float) -> float:
    """Speed of the mean of iterate and stage velocity relative to a medium (Runge-Kutta without predictor-corrector)."""
    du, dv = 0.5 * (u1 + us) - uk, 0.5 * (v1 + vs) - vk
    return float((du * du + dv * dv) ** 0.5)


@kernel
def drags(
    e: int, w: ElementState, u1: float, v1: float, media: Floats, rates: Floats, acts: NDArray[np.bool_], mean_speeds: bool
) -> tuple[float, float, float]:  # fmt: skip
    """Sum the drags of the media that act: deceleration at (u_star, v_star), m s-2, and rate, s-1; store each rate.

    ``u1``, ``v1``: iterate, at which quadratic drags take the speed.
    """
    drag_x = drag_y = total = 0.0
    for m in range(len(MEDIA)):
        if not acts[m]:
            continue
        uk, vk, rate = media[e, m, U], media[e, m, V], media[e, m, LINEAR]
        if media[e, m, QUADRATIC] != 0.0:
            speed = mean_speed(u1, v1, w.u0, w.v0, uk, vk) if mean_speeds else _stage_speed(u1, v1, w.us, w.vs, uk, vk)
            rate += media[e, m, QUADRATIC] * speed
        rates[e, m] = rate
        drag_x += rate * (w.u_star - uk)
        drag_y += rate * (w.v_star - vk)
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
    e: int, w: ElementState, x: ExplicitTerms, t: Terms, u1: float, v1: float, media: Floats, rates: Floats,
    acts: NDArray[np.bool_], how: Solve,
) -> tuple[float, float]:  # fmt: skip
    """Solve for the acceleration (m s-2) with the drag at the iterate (u1, v1)."""
    theta, dt = how.scheme.theta, how.dt
    damp_x = t.p11 * w.u_star + t.p12 * w.v_star - t.px
    damp_y = t.p12 * w.u_star + t.p22 * w.v_star - t.py
    if how.mode == INTERACTIONS_ONLY:
        rx, ry = 0.5 * t.ix - theta * damp_x, 0.5 * t.iy - theta * damp_y
        rate = turn = 0.0
    else:
        drag_x, drag_y, rate = drags(e, w, u1, v1, media, rates, acts, how.scheme.mean_speeds)
        rx = how.scheme.explicit_weight * x.push_x - theta * (drag_x + damp_x)
        ry = how.scheme.explicit_weight * x.push_y - theta * (drag_y + damp_y)
        turn = how.scheme.coriolis_implicitness * x.f
    # The matrix is 1 + theta dt (rate + P) with the Coriolis force, which turns: it stands with opposite signs.
    a11 = 1.0 + theta * dt * (rate + t.p11)
    a22 = 1.0 + theta * dt * (rate + t.p22)
    a12 = theta * dt * (t.p12 - turn)
    a21 = theta * dt * (t.p12 + turn)
    return solve_two_by_two(a11, a12, a21, a22, rx, ry)


@stage
def solve_velocity(
    e: int, w: ElementState, surroundings: Surroundings, how: Solve, partners: NeighbourLists, plain: bool, bond_size: bool,
    view: PairView, law: PairLaw,
) -> Solution:  # fmt: skip
    """Solve for the acceleration of element ``e``."""
    scheme, dt = how.scheme, how.dt
    isolated = is_isolated(e, partners.bonded.start, partners.same_berg.start, partners.collision.start)
    t = Terms(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not isolated:
        ud, vd = (w.u0, w.v0) if scheme.from_start else (w.us, w.vs)
        t = interaction_terms(e, Mover(w.x, w.y, w.u0, w.v0, ud, vd), partners, plain, bond_size, view, law)
    # Runge-Kutta evaluates the explicit Coriolis force at the stage, Verlet at the half-kicked velocity.
    cu, cv = (w.u_star, w.v_star) if scheme.explicit_weight < 1.0 else (w.us, w.vs)
    f = surroundings.coriolis[e]
    media_x, media_y = pushes(e, surroundings.media, surroundings.acts)
    x = ExplicitTerms(media_x, media_y, media_x + t.ix + f * cv, media_y + t.iy - f * cu, cu, cv, f)
    ud, vd = (w.u0, w.v0) if scheme.from_start and scheme.mean_speeds else (w.us, w.vs)
    ax, ay = solve_once(e, w, x, t, ud, vd, surroundings.media, surroundings.rate, surroundings.acts, how)
    if not isolated:
        ud, vd = w.u_star + dt * ax, w.v_star + dt * ay
        if scheme.from_start and not scheme.mean_speeds:
            ud, vd = 0.5 * (ud + w.us), 0.5 * (vd + w.vs)
        t = interaction_terms(e, Mover(w.x, w.y, w.u0, w.v0, ud, vd), partners, plain, bond_size, view, law)
    return _second_solve(e, w, x, t, ax, ay, surroundings, how)


@stage
def solve_in_contact(
    e: int, w: ElementState, surroundings: Surroundings, how: Solve, table: ContactTable, u_shown: Floats, v_shown: Floats,
    by_speed: bool,
) -> Solution:  # fmt: skip
    """Solve as `solve_velocity` for an outer half kick, with contacts whose geometry has been found (`ContactTable`)."""
    u, v = w.u_star, w.v_star
    t = contact_terms(e, u, v, u, v, table, u_shown, v_shown, by_speed)
    f = surroundings.coriolis[e]
    media_x, media_y = pushes(e, surroundings.media, surroundings.acts)
    x = ExplicitTerms(media_x, media_y, media_x + t.ix + f * v, media_y + t.iy - f * u, u, v, f)
    ax, ay = solve_once(e, w, x, t, u, v, surroundings.media, surroundings.rate, surroundings.acts, how)
    t = contact_terms(e, u, v, u + how.dt * ax, v + how.dt * ay, table, u_shown, v_shown, by_speed)
    return _second_solve(e, w, x, t, ax, ay, surroundings, how)


@stage
def _second_solve(
    e: int, w: ElementState, x: ExplicitTerms, t: Terms, ax: float, ay: float, surroundings: Surroundings, how: Solve
) -> Solution:
    """Solve with the forces at the velocity of the first solution, and split the acceleration."""
    scheme, dt = how.scheme, how.dt
    u1, v1 = w.u_star + dt * ax, w.v_star + dt * ay
    du, dv = (u1, v1) if scheme.centred else (w.u0, w.v0)
    # Springs stay those of the first solution: only the damping of the partners is taken at the new velocity.
    at_first = ElementState(w.x, w.y, w.u_star, w.v_star, du, dv, w.us, w.vs)
    ax, ay = solve_once(e, at_first, x, t, u1, v1, surroundings.media, surroundings.rate, surroundings.acts, how)
    u1, v1 = w.u_star + dt * ax, w.v_star + dt * ay
    if how.mode == INTERACTIONS_ONLY:
        a_x, a_y = t.ix, t.iy
    elif scheme.explicit_weight < 1.0:
        a_x, a_y = x.media_x + t.ix + x.f * v1, x.media_y + t.iy - x.f * u1
    else:
        a_x, a_y = 0.0, 0.0
    if how.mode == WITH_SURROUNDINGS:
        # The velocity at which the Coriolis force acted, explicit and implicit part together.
        ahead = 2.0 * scheme.theta * scheme.coriolis_implicitness * dt
        turning_u, turning_v = x.cu + ahead * ax, x.cv + ahead * ay
        record_applied(
            e,
            u1,
            v1,
            turning_u,
            turning_v,
            surroundings.media,
            surroundings.rate,
            surroundings.acts,
            x.f,
            surroundings.applied,
        )
    b_x, b_y = (ax - 0.5 * a_x) / scheme.theta, (ay - 0.5 * a_y) / scheme.theta
    damping_x, damping_y = t.px - t.p11 * u1 - t.p12 * v1, t.py - t.p12 * u1 - t.p22 * v1
    return Solution(ax, ay, a_x, a_y, b_x, b_y, damping_x, damping_y)


@kernel
def record_current_forces(el: Elements, surroundings: Surroundings) -> None:
    """Record the forces of a moment: those that act at the velocities of the elements, without a step."""
    place, motion, media, rates, acts = el.place, el.motion, surroundings.media, surroundings.rate, surroundings.acts
    applied, coriolis = surroundings.applied, surroundings.coriolis
    for e in range(motion.u.size):
        u, v = motion.u[e], motion.v[e]
        drags(e, ElementState(place.lon[e], place.lat[e], u, v, u, v, u, v), u, v, media, rates, acts, True)
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
