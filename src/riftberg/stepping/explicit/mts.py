"""Multiple-time-step velocity Verlet: slow half kick, sub-steps of the bonds, slow half kick (equations 6.4)."""

from __future__ import annotations

from typing import NamedTuple

from riftberg.compiled.kernels import borrower, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Ints
from riftberg.stepping.explicit.beams import take_substeps_of_beams
from riftberg.stepping.explicit.implicit_substep import implicit_kick
from riftberg.stepping.explicit.outer_kick import (
    OuterWorkspace,
    allocate_outer_workspace,
    begin_substeps,
    end_substeps,
    first_half_kick,
    second_half_kick,
)
from riftberg.stepping.explicit.springs import (
    Workspace,
    accumulate_floor_impulse,
    add_collisions,
    drift,
    drift_near_pole,
    floor_rates,
    kick,
    publish_all_velocities,
    publish_velocities,
    reaches_pole,
    spring_accelerations,
    store_inner,
)
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.explicit.threads import WORTH_THREADS, take_substeps_in_threads
from riftberg.stepping.forces.interactions import Partners, pair_law
from riftberg.stepping.forces.media import Surroundings, find_surroundings
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import break_after_step


class StepReport(NamedTuple):
    """Bonds broken in the long step and passes of the contact iteration (-1: it did not settle)."""

    broken: int
    iterations: int


@stage
def _start_inner(el, fields, implicit_ground):
    """Take the accelerations just found as those before the first sub-step, so that it has its first half kick.

    What the sea floor does in that half kick is kept with what it does in the sub-steps.
    """
    motion, kicks = el.motion, el.kicks
    for e in range(motion.u.size):
        rate = 0.0 if implicit_ground else fields.active[e] * fields.ground_rate[e]
        kicks.ax_fast[e] = fields.active[e] * fields.accel_x[e] - rate * motion.u[e]
        kicks.ay_fast[e] = fields.active[e] * fields.accel_y[e] - rate * motion.v[e]
        fields.floor_impulse_x[e] -= 0.5 * rate * motion.u[e]
        fields.floor_impulse_y[e] -= 0.5 * rate * motion.v[e]


@stage
def _drift(el, fields, dt, near_pole, p):
    """Positions of the sub-step, on the tangent plane if an element may be near the pole."""
    q1 = p.swapped_implicit_velocity and not p.explicit_substeps
    if near_pole:
        drift_near_pole(el, fields.active, dt, p.earth_radius, q1)
    else:
        drift(el, fields.active, dt, p.latlon, p.earth_radius, q1)


@stage
def _kick(el, fields, dt, floor_acts, implicit_ground):
    """Update the velocities and show them, and keep what the sea floor did to them where it acts."""
    if floor_acts and not implicit_ground:
        accumulate_floor_impulse(el, fields)
    kick(el, fields, dt, implicit_ground)
    if floor_acts and implicit_ground:
        accumulate_floor_impulse(el, fields)
    publish_velocities(el, fields.active)


@stage
def _outer_kick(
    el: Elements, bonds: Bonds, partners: Partners, work: OuterWorkspace, sizes: Sizes, around: Surroundings, plan: StepPlan,
    p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Apply the slow forces; returns what `StepReport` holds."""
    find_surroundings(el, sizes, around, p)
    if plan.skip_outer:
        return 0, 1
    iterations = second_half_kick(el, plan.dt, around, partners, work, sizes, pair_law(p), plan.starting, p)
    if iterations < 0 or plan.sync_only:
        return 0, iterations
    broken = 0
    if plan.break_after:
        broken = break_after_step(el, bonds, p.normal_strength, p.shear_strength, plan.time)
    first_half_kick(el, plan.dt, sizes, p)
    return broken, iterations


def take_long_step(
    el: Elements, bonds: Bonds, work: Workspace, outer: Partners, inner: Partners, sizes: Sizes, around: Surroundings,
    rank: Ints, plan: StepPlan, p: KernelParameters,
) -> StepReport:  # fmt: skip
    """Apply the slow forces and take the sub-steps of a long step; cells, environment and conglomerates are the caller's.

    One call for both, for to hand the state to compiled code takes some 40 us; and one kernel, for what is compiled by
    itself and again within another takes twice as long. Where bergs take different numbers of sub-steps, the slow forces
    are applied to all at once (``plan.apply_inner`` false), and each batch moves for itself (``plan.apply_outer`` false).
    """
    outer_work = allocate_outer_workspace(el.size, outer)
    if p.dem and plan.apply_inner and plan.threads > 1 and el.size >= WORTH_THREADS:
        outer_only = plan._replace(apply_inner=False)
        broken, iterations = _step_of_beams(el, bonds, work, outer, outer_work, sizes, around, rank, outer_only, p)
        if iterations >= 0:
            broken += take_substeps_in_threads(el, bonds, work, sizes, around, rank, plan, p)
        return StepReport(broken, iterations)
    if p.dem:
        return StepReport(*_step_of_beams(el, bonds, work, outer, outer_work, sizes, around, rank, plan, p))
    inner_work = allocate_outer_workspace(el.size, inner)
    return StepReport(*_step_of_springs(el, bonds, work, outer, outer_work, inner, inner_work, sizes, around, plan, p))


@stage
def _take_substeps_of_springs(
    el: Elements, bonds: Bonds, work: Workspace, inner: Partners, inner_work: OuterWorkspace, sizes: Sizes, around: Surroundings,
    plan: StepPlan, p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps, with bonds as springs; returns the passes of the iteration, as `StepReport` does."""
    pairs, fields, law = work.pairs, work.fields, pair_law(p)
    floor_acts, floor_varies = begin_substeps(el, around, fields, sizes, plan.dt / plan.substeps, p)
    near_pole = p.latlon and reaches_pole(el.place.lat)
    iterations = 1
    explicit = p.explicit_substeps
    # With a proper start, one evaluation without moving stands before the first sub-step.
    for n in range(-1 if plan.starting and p.bonds_on else 0, plan.substeps):
        moving = n >= 0
        dt = plan.dt / plan.substeps if moving else 0.0
        if moving:
            _drift(el, fields, dt, near_pole, p)
        if explicit or not moving:
            spring_accelerations(el, inner, p.constant_size, fields, sizes, law)
            add_collisions(pairs, bonds, el, sizes, law, fields, p.max_bonds, dt)
        if floor_varies:
            floor_rates(el, fields, dt)
        if not moving:
            _start_inner(el, fields, p.ground_implicit)
            continue
        if explicit:
            _kick(el, fields, dt, floor_acts, p.ground_implicit)
        else:
            iterations = implicit_kick(el, dt, around, inner, inner_work, sizes, law, fields, p)
            if iterations < 0:
                return iterations
            publish_velocities(el, fields.active)
        if p.iterate and not explicit:
            store_inner(el)
    if p.iterate:
        store_inner(el)
    if floor_acts:
        end_substeps(around, fields, plan.substeps)
    publish_all_velocities(el, el.motion.u, el.motion.v)
    return iterations


@borrower
def _step_of_beams(
    el: Elements, bonds: Bonds, work: Workspace, outer: Partners, outer_work: OuterWorkspace, sizes: Sizes, around: Surroundings,
    rank: Ints, plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Return what `StepReport` holds; see `riftberg.compiled.kernels` why no named tuple.

    Beams and springs have a kernel each: together they take half as long again to compile, and a run needs one of them.
    """
    broken, iterations = 0, 1
    if plan.apply_outer:
        broken, iterations = _outer_kick(el, bonds, outer, outer_work, sizes, around, plan, p)
    if plan.apply_inner and iterations >= 0:
        broken += take_substeps_of_beams(el, bonds, work, sizes, around, rank, plan, p)
        iterations = 1
    return broken, iterations


@borrower
def _step_of_springs(
    el: Elements, bonds: Bonds, work: Workspace, outer: Partners, outer_work: OuterWorkspace, inner: Partners,
    inner_work: OuterWorkspace, sizes: Sizes, around: Surroundings, plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """As `_step_of_beams`."""
    broken, iterations = 0, 1
    if plan.apply_outer:
        broken, iterations = _outer_kick(el, bonds, outer, outer_work, sizes, around, plan, p)
    if plan.apply_inner and iterations >= 0:
        iterations = _take_substeps_of_springs(el, bonds, work, inner, inner_work, sizes, around, plan, p)
    return broken, iterations
