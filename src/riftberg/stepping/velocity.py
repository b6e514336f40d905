"""Semi-implicit velocity of one element under external forces and partners (spec 4.2, 4.3).

One routine serves the schemes, which differ in the share s of drag and damping that acts: 1 in single steps, 1/2 where
the result is applied as two half kicks of the long step.
"""

from __future__ import annotations

from typing import NamedTuple

from riftberg.kernels import kernel
from riftberg.physics.momentum import mean_speed, solve_two_by_two
from riftberg.stepping.interactions import interaction_terms

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
def solve_velocity(
    e, x, y, u_star, v_star, u0, v0, us, vs, around, share, explicit_part, mean_speeds, mode, dt, partners, plain,
    bond_size, view, law,
):  # fmt: skip
    """Solve for the acceleration of element ``e`` over ``dt`` seconds.

    Parameters
    ----------
    e : int
    x, y : float
        Position, degrees or m.
    u_star, v_star : float
        Velocity with the explicit half kick, m s-1.
    u0, v0 : float
        Velocity at the start of the step.
    us, vs : float
        Velocity of the Runge-Kutta stage; (u0, v0) otherwise.
    around : Surroundings
    share : float
        1 for single steps, 1/2 for two half kicks.
    explicit_part : float
        Part of the explicit acceleration in this solve: 1/2 in Verlet schemes, 1 in Runge-Kutta stages, which also
        take the Coriolis force fully explicit.
    mean_speeds : bool
        Drag by the mean of the speeds at start and iterate; else by the speed of the mean velocity.
    mode : int
        `WITH_SURROUNDINGS` or `INTERACTIONS_ONLY`.
    dt : float
        s.
    partners, plain, bond_size, view, law
        See `riftberg.stepping.interactions.interaction_terms`.

    Returns
    -------
    Solution
    """
    ix, iy, p11, p12, p22, px, py = interaction_terms(
        e, x, y, u0, v0, us, vs, partners, plain, bond_size, view, law
    )
    implicit_coriolis = 0.5 * around.coriolis if explicit_part < 1.0 else 0.0
    # Runge-Kutta evaluates the explicit Coriolis force at the stage, Verlet at the half-kicked velocity.
    cu, cv = (u_star, v_star) if explicit_part < 1.0 else (us, vs)
    ex = around.push_x + ix + around.coriolis * cv
    ey = around.push_y + iy - around.coriolis * cu
    u1, v1 = us, vs
    ax = ay = 0.0
    for iteration in range(2):
        if iteration == 1:
            ix, iy, p11, p12, p22, px, py = interaction_terms(
                e, x, y, u0, v0, u1, v1, partners, plain, bond_size, view, law
            )
        damp_x = p11 * u_star + p12 * v_star - px
        damp_y = p12 * u_star + p22 * v_star - py
        if mode == INTERACTIONS_ONLY:
            rx, ry = 0.5 * ix - share * damp_x, 0.5 * iy - share * damp_y
            rate = turn = 0.0
        else:
            if mean_speeds:
                do = around.drag_ocean * mean_speed(u1, v1, u0, v0, around.uo, around.vo)
                da = around.drag_air * mean_speed(u1, v1, u0, v0, around.ua, around.va)
                di = around.drag_ice * mean_speed(u1, v1, u0, v0, around.ui, around.vi)
            else:
                do = around.drag_ocean * _stage_speed(u1, v1, us, vs, around.uo, around.vo)
                da = around.drag_air * _stage_speed(u1, v1, us, vs, around.ua, around.va)
                di = around.drag_ice * _stage_speed(u1, v1, us, vs, around.ui, around.vi)
            dg = around.grounding
            drag_x = do * (u_star - around.uo) + da * (u_star - around.ua) + di * (u_star - around.ui) + dg * u_star
            drag_y = do * (v_star - around.vo) + da * (v_star - around.va) + di * (v_star - around.vi) + dg * v_star
            rx = explicit_part * ex - share * (drag_x + damp_x)
            ry = explicit_part * ey - share * (drag_y + damp_y)
            rate = do + da + di + dg
            turn = implicit_coriolis
        a11 = 1.0 + share * dt * (rate + p11)
        a22 = 1.0 + share * dt * (rate + p22)
        a12 = share * dt * (p12 - turn)
        a21 = share * dt * (p12 + turn)
        ax, ay = solve_two_by_two(a11, a12, a21, a22, rx, ry)
        u1, v1 = u_star + dt * ax, v_star + dt * ay
    if mode == INTERACTIONS_ONLY:
        a_x, a_y = ix, iy
    elif explicit_part < 1.0:
        a_x = around.push_x + ix + around.coriolis * v1
        a_y = around.push_y + iy - around.coriolis * u1
    else:
        a_x = a_y = 0.0
    mass = view.mass[e]
    return Solution(
        ax,
        ay,
        a_x,
        a_y,
        (ax - 0.5 * a_x) / share,
        (ay - 0.5 * a_y) / share,
        mass * (px - p11 * u1 - p12 * v1),
        mass * (py - p12 * u1 - p22 * v1),
    )
