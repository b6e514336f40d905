"""Fourth-order Runge-Kutta (equations 6.3).

All elements go through a stage together, because the forcing is sampled at the positions of the stage; partners are
seen where they were at the start of the step, so this changes nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import metres_per_unit, move
from riftberg.state import Elements, Floats
from riftberg.stepping.forces.implicit_velocity import INTERACTIONS_ONLY, WITH_SURROUNDINGS, is_isolated, solve_velocity
from riftberg.stepping.forces.interactions import Partners, pair_law, pair_view
from riftberg.stepping.forces.media import Surroundings, find_surroundings
from riftberg.stepping.forces.sizes import Sizes


class Stages(NamedTuple):
    """Start of the step and the four stages: arrays of shape (n,) and (4, n)."""

    x0: Floats
    y0: Floats
    u0: Floats
    v0: Floats
    rate_x: Floats
    rate_y: Floats
    u: Floats
    v: Floats
    total_x: Floats
    total_y: Floats
    a_x: Floats
    a_y: Floats


def allocate_stages(count: int) -> Stages:
    """Return room for ``count`` elements."""
    flat, deep = [np.zeros(count) for _ in range(4)], [np.zeros((4, count)) for _ in range(8)]
    return Stages(*flat, *deep)


FRACTION = (0.5, 0.5, 1.0, 1.0)
"""Part of the step that the semi-implicit solve of each stage spans."""

WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
"""Part of each stage in the acceleration of the step."""

AHEAD = (0.0, 0.5, 0.5, 1.0)
"""Place of each stage in the step."""


@kernel
def begin(el: Elements, stages: Stages) -> None:
    """Remember the start of the step; it is also the first stage."""
    motion = el.motion
    stages.x0[:], stages.y0[:], stages.u0[:], stages.v0[:] = el.place.lon, el.place.lat, motion.u, motion.v
    stages.u[0, :], stages.v[0, :] = motion.u, motion.v


@borrower
def evaluate(
    el: Elements, stages: Stages, stage: int, fraction: float, partners: Partners, sizes: Sizes,
    around: Surroundings, dt: float, mean_speeds: bool, p: KernelParameters,
) -> None:  # fmt: skip
    """Find the accelerations of a stage; ``el.lon``, ``el.lat`` hold its positions, ``stages.u[stage]`` its velocity."""
    place, shown, kicks, body = el.place, el.shown, el.kicks, el.body
    view, law = pair_view(el, sizes), pair_law(p)
    mode = INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS
    span = fraction * dt
    find_surroundings(el, sizes, around, p)
    media, rates, acts, coriolis, applied = around.media, around.rate, around.acts, around.coriolis, around.applied
    bonded, same, other = partners.bonded.start, partners.same_berg.start, partners.collision.start
    for e in range(el.motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u0, v0 = stages.u0[e], stages.v0[e]
        us, vs = stages.u[stage, e], stages.v[stage, e]
        half_u, half_v = u0 + 0.5 * span * kicks.ax[e], v0 + 0.5 * span * kicks.ay[e]
        s = solve_velocity(
            e, shown.lon_pair[e], shown.lat_pair[e], half_u, half_v, u0, v0, us, vs, media, rates, acts, coriolis,
            applied, 1.0, 1.0, mean_speeds, p.stages_from_start, False, mode, span, body.mass[e],
            is_isolated(e, bonded, same, other), partners, p.plain_kid_branch, False, view, law,
        )  # fmt: skip
        stages.total_x[stage, e], stages.total_y[stage, e] = s.total_x, s.total_y
        stages.a_x[stage, e], stages.a_y[stage, e] = s.a_x, s.a_y
        mx, my = metres_per_unit(place.lat[e], p.latlon, p.earth_radius)
        stages.rate_x[stage, e], stages.rate_y[stage, e] = us / mx, vs / my


def keep_velocity(stages: Stages, stage: int) -> None:
    """Let nothing accelerate the elements in a stage."""
    for values in (stages.total_x, stages.total_y, stages.a_x, stages.a_y):
        values[stage] = 0.0


@borrower
def go_to_stage(el: Elements, stages: Stages, stage: int, part: float, dt: float, p: KernelParameters) -> None:
    """Place the elements at stage 1, 2 or 3: ``part`` of a step from the start with the slopes of the stage before."""
    place, body = el.place, el.body
    for e in range(el.motion.u.size):
        if body.static[e] >= 0.5:
            continue
        span = part * dt
        if p.latlon and stages.y0[e] > 89.0:
            place.lon[e], place.lat[e] = move(
                stages.x0[e], stages.y0[e], stages.u[stage - 1, e], stages.v[stage - 1, e], span, True, p.earth_radius
            )
        else:
            place.lon[e] = stages.x0[e] + span * stages.rate_x[stage - 1, e]
            place.lat[e] = stages.y0[e] + span * stages.rate_y[stage - 1, e]
        stages.u[stage, e] = stages.u0[e] + span * stages.total_x[stage - 1, e]
        stages.v[stage, e] = stages.v0[e] + span * stages.total_y[stage - 1, e]


@kernel
def _weighted(values, e):
    """Mean of four stages with weights 1, 2, 2, 1."""
    return (values[0, e] + values[3, e] + 2.0 * (values[1, e] + values[2, e])) / 6.0


@borrower
def finish(el: Elements, stages: Stages, dt: float, p: KernelParameters) -> None:
    """Combine the stages into the new position, velocity and accelerations."""
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        if p.latlon and stages.y0[e] > 89.0:
            u, v = _weighted(stages.u, e), _weighted(stages.v, e)
            place.lon[e], place.lat[e] = move(stages.x0[e], stages.y0[e], u, v, dt, True, p.earth_radius)
        else:
            place.lon[e] = stages.x0[e] + dt * _weighted(stages.rate_x, e)
            place.lat[e] = stages.y0[e] + dt * _weighted(stages.rate_y, e)
        total_x, total_y = _weighted(stages.total_x, e), _weighted(stages.total_y, e)
        motion.u[e], motion.v[e] = stages.u0[e] + dt * total_x, stages.v0[e] + dt * total_y
        motion.u_sync[e], motion.v_sync[e] = motion.u[e], motion.v[e]
        kicks.ax[e], kicks.ay[e] = _weighted(stages.a_x, e), _weighted(stages.a_y, e)
        kicks.bx[e], kicks.by[e] = total_x - 0.5 * kicks.ax[e], total_y - 0.5 * kicks.ay[e]
