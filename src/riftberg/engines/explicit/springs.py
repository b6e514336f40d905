"""The sub-steps of a long step with KID's bonds as springs, or without bonds (docs/explanation/equations.md, 6.4).

Explicit sub-steps kick by the forces at the positions reached. Implicit ones (explicit_inner_mts off) solve for the damping
at the new velocities, and repeat that until the velocities of each group of bergs settle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.constants import DEGREE
from riftberg.engines.common.forces.implicit_velocity import (
    INTERACTIONS_ONLY,
    OUTER_KICK_UNCENTRED,
    ElementState,
    Solve,
    solve_velocity,
)
from riftberg.engines.common.forces.media import Surroundings
from riftberg.engines.common.forces.pair_law import (
    Mover,
    NeighbourLists,
    PairLaw,
    PairView,
    interaction_terms,
    pair_law,
    pair_view,
)
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.explicit.contact import add_contacts
from riftberg.engines.explicit.substeps import (
    OuterWorkspace,
    StepPlan,
    SubstepFields,
    Workspace,
    begin_substeps,
    drifted,
    end_substeps,
    floor_drag_rate,
    is_any_set,
    kicked,
    mark_converged,
    mid_step_velocity,
    publish_all_velocities,
    publish_velocities,
    reaches_pole,
    store_inner,
)
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import add_velocity, move
from riftberg.state import Bonds, Elements, Floats, Ints


@stage
def take_substeps_of_springs(
    el: Elements, bonds: Bonds, work: Workspace, inner: NeighbourLists, inner_work: OuterWorkspace, sizes: Sizes,
    surroundings: Surroundings, plan: StepPlan, p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps; returns the iterations of the last implicit one (-1: it did not converge), or 1."""
    pairs, fields, law, explicit = work.pairs, work.fields, pair_law(p), p.explicit_substeps
    floor_acts, floor_varies = begin_substeps(el, surroundings, fields, sizes, plan.dt / plan.substeps, p)
    near_pole = p.latlon and reaches_pole(el.place.lat)
    q1 = p.swapped_implicit_velocity and not explicit
    iterations = 1
    # With a proper start, one evaluation without moving stands before the first sub-step.
    for n in range(-1 if plan.starting and p.bonds_on else 0, plan.substeps):
        moving = n >= 0
        dt = plan.dt / plan.substeps if moving else 0.0
        if moving and near_pole:
            _drift_near_pole(el, fields.active, dt, p.earth_radius, q1)
        elif moving:
            _drift(el, fields.active, dt, p.latlon, p.earth_radius, q1)
        if explicit or not moving:
            _accelerations(el, inner, p.constant_size, fields, sizes, law)
            if pairs.used[0] > 0:
                add_contacts(
                    pairs, bonds.status, el, sizes, law, fields.accel_x, fields.accel_y, False, p.max_bonds, dt
                )
        if floor_varies:
            _floor_rates(el, fields, dt)
        if not moving:
            _start(el, fields, p.ground_implicit)
            continue
        if explicit:
            # The floor stops an element at the velocity that its drag is taken at: the old one, or the new one if implicit.
            if floor_acts and not p.ground_implicit:
                _accumulate_floor_impulse(el, fields)
            _kick(el, fields, dt, p.ground_implicit)
            if floor_acts and p.ground_implicit:
                _accumulate_floor_impulse(el, fields)
        else:
            iterations = _implicit_kick(el, dt, surroundings, inner, inner_work, sizes, law, fields, p)
            if iterations < 0:
                return iterations
        publish_velocities(el, fields.active)
        if p.iterate and not explicit:
            store_inner(el)
    if p.iterate:
        store_inner(el)
    if floor_acts:
        end_substeps(surroundings, fields, plan.substeps)
    publish_all_velocities(el, el.motion.u, el.motion.v)
    return iterations


@kernel
def _drift(el: Elements, active: Floats, dt: float, latlon: bool, radius: float, q1: bool) -> None:
    """Move the elements by their mid-step velocity and let pair forces see both (equations 6.4)."""
    place, shown, motion, kicks = el.place, el.shown, el.motion, el.kicks
    half = 0.5 * dt
    step = dt * (1.0 / (DEGREE * radius if latlon else 1.0))
    to_degrees = 1.0 if latlon else 0.0
    for e in range(el.place.lon.size):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax, ay = motion.u[e], motion.v[e], kicks.ax_fast[e], kicks.ay_fast[e]
        bx, by, lon, lat = kicks.bx_fast[e], kicks.by_fast[e], place.lon[e], place.lat[e]
        u_shown, v_shown, moves = shown.u_pair[e], shown.v_pair[e], active[e] > 0.0
        wu, wv, seen = mid_step_velocity(u, v, ax, ay, bx, by, half, q1)
        new_lon, new_lat = drifted(lon, lat, wu, wv, step, to_degrees)
        lon, lat = new_lon if moves else lon, new_lat if moves else lat
        place.lon[e], place.lat[e] = lon, lat
        shown.lon_pair[e], shown.lat_pair[e] = lon, lat
        shown.u_pair[e] = wu if moves else u_shown
        shown.v_pair[e] = seen if moves else v_shown


@stage
def _drift_near_pole(el: Elements, active: Floats, dt: float, radius: float, q1: bool) -> None:
    """As `_drift`, on the tangent plane where latitude is above 89 degrees."""
    place, shown, motion, kicks = el.place, el.shown, el.motion, el.kicks
    for e in range(el.place.lon.size):
        if active[e] == 0.0:
            continue
        wu, wv, seen = mid_step_velocity(
            motion.u[e],
            motion.v[e],
            kicks.ax_fast[e],
            kicks.ay_fast[e],
            kicks.bx_fast[e],
            kicks.by_fast[e],
            0.5 * dt,
            q1,
        )
        place.lon[e], place.lat[e] = move(place.lon[e], place.lat[e], wu, wv, dt, True, radius)
        shown.lon_pair[e], shown.lat_pair[e] = place.lon[e], place.lat[e]
        shown.u_pair[e], shown.v_pair[e] = wu, seen


@kernel
def _accelerations(
    el: Elements, partners: NeighbourLists, bond_size: bool, fields: SubstepFields, sizes: Sizes, law: PairLaw
) -> None:
    """Accelerations (m s-2) by KID's bonds and contact inside the berg (equations 5.3 without DEM)."""
    place, shown, motion = el.place, el.shown, el.motion
    view = pair_view(el, sizes)
    for e in range(place.lon.size):
        lon, lat, u, v = place.lon[e], place.lat[e], motion.u[e], motion.v[e]
        ix, iy, p11, p12, p22, px, py = interaction_terms(
            e, Mover(lon, lat, u, v, u, v), partners, False, bond_size, view, law
        )
        uw, vw = shown.u_pair[e], shown.v_pair[e]
        fields.accel_x[e] = ix + px - p11 * uw - p12 * vw
        fields.accel_y[e] = iy + py - p12 * uw - p22 * vw


@kernel
def _floor_rates(el: Elements, fields: SubstepFields, dt: float) -> None:
    """Find the rates of the sea floor's drag at the velocities now, where it grows with the speed."""
    motion = el.motion
    for e in range(el.place.lon.size):
        rate = floor_drag_rate(fields.floor_linear[e], fields.floor_quadratic[e], motion.u[e], motion.v[e])
        fields.floor_rate[e], fields.floor_decay[e] = rate, 1.0 / (1.0 + rate * dt)


@stage
def _start(el: Elements, fields: SubstepFields, implicit_floor: bool) -> None:
    """Take the accelerations just found as those before the first sub-step, so that it has its first half kick.

    The impulse of the sea floor in that half kick is added to its impulse in the sub-steps.
    """
    motion, kicks = el.motion, el.kicks
    for e in range(motion.u.size):
        active = fields.active[e]
        rate = 0.0 if implicit_floor else active * fields.floor_rate[e]
        kicks.ax_fast[e] = active * fields.accel_x[e] - rate * motion.u[e]
        kicks.ay_fast[e] = active * fields.accel_y[e] - rate * motion.v[e]
        fields.floor_impulse_x[e] -= 0.5 * rate * motion.u[e]
        fields.floor_impulse_y[e] -= 0.5 * rate * motion.v[e]


@kernel
def _accumulate_floor_impulse(el: Elements, fields: SubstepFields) -> None:
    """Add the accelerations by the sea floor in this sub-step: before an explicit kick, after an implicit one."""
    motion = el.motion
    for e in range(el.place.lon.size):
        rate = fields.active[e] * fields.floor_rate[e]
        fields.floor_impulse_x[e] -= rate * motion.u[e]
        fields.floor_impulse_y[e] -= rate * motion.v[e]


@kernel
def _kick(el: Elements, fields: SubstepFields, dt: float, implicit_floor: bool) -> None:
    """Update velocities by half the old and half the new inner acceleration (docs/explanation/equations.md, 6.4)."""
    motion, kicks = el.motion, el.kicks
    half = 0.5 * dt
    for e in range(el.place.lon.size):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax_old, ay_old = motion.u[e], motion.v[e], kicks.ax_fast[e], kicks.ay_fast[e]
        rate, decay, moves = fields.floor_rate[e], fields.floor_decay[e], fields.active[e] > 0.0
        new_u, new_v, ax, ay = kicked(
            u, v, ax_old, ay_old, fields.accel_x[e], fields.accel_y[e], rate, decay, half, implicit_floor
        )
        motion.u[e] = new_u if moves else u
        motion.v[e] = new_v if moves else v
        kicks.ax_fast[e] = ax if moves else ax_old
        kicks.ay_fast[e] = ay if moves else ay_old


@stage
def _implicit_kick(
    el: Elements, dt: float, surroundings: Surroundings, partners: NeighbourLists, work: OuterWorkspace, sizes: Sizes,
    law: PairLaw, fields: SubstepFields, p: KernelParameters,
) -> int:  # fmt: skip
    """Kick the velocities implicitly, repeating until they settle if ``p.iterate``; returns the iterations, or -1.

    ``ax`` ... ``by`` hold the inner accelerations of the sub-step before (`store_inner`).
    """
    view = pair_view(el, sizes)
    unconverged, first_norm, change, norm = work.unconverged, work.norm_before, work.change, work.norm
    unconverged[:] = True
    _solve_all(el, dt, surroundings, partners, unconverged, view, law, fields, p)
    if not p.iterate:
        return 1
    _norms(el, partners.group, change, first_norm, fields)
    iterations = 1
    while is_any_set(unconverged):
        if iterations >= p.max_iterations:
            return -1
        _rewind(el, dt, partners.group, unconverged, fields)
        _solve_all(el, dt, surroundings, partners, unconverged, view, law, fields, p)
        iterations += 1
        _norms(el, partners.group, change, norm, fields)
        mark_converged(unconverged, change, norm, first_norm, p.tolerance)
    return iterations


@borrower
def _solve_all(
    el: Elements, dt: float, surroundings: Surroundings, partners: NeighbourLists, unconverged: NDArray[np.bool_],
    view: PairView, law: PairLaw, fields: SubstepFields, p: KernelParameters,
) -> None:  # fmt: skip
    """Kick all moving elements of unconverged groups once, with the velocities of the others as they were."""
    place, motion, kicks = el.place, el.motion, el.kicks
    half = 0.5 * dt
    how, group, one_group = Solve(OUTER_KICK_UNCENTRED, INTERACTIONS_ONLY, dt), partners.group, partners.group.size == 0
    for e in range(motion.u.size):
        if fields.active[e] == 0.0 or not unconverged[0 if one_group else group[e]]:
            continue
        u0, v0 = motion.u[e], motion.v[e]
        # The first half of the kick is that of the sub-step before; the new forces are solved for its second half.
        us, vs = u0 + half * (kicks.ax_fast[e] + kicks.bx_fast[e]), v0 + half * (kicks.ay_fast[e] + kicks.by_fast[e])
        w = ElementState(place.lon[e], place.lat[e], us, vs, u0, v0, u0, v0)
        s = solve_velocity(e, w, surroundings, how, partners, False, p.constant_size, view, law)
        motion.u[e], motion.v[e] = add_velocity(place.lon[e], place.lat[e], us, vs, s.total_x, s.total_y, dt, p.latlon)
        kicks.ax_fast[e], kicks.ay_fast[e], kicks.bx_fast[e], kicks.by_fast[e] = s.a_x, s.a_y, s.b_x, s.b_y


@kernel
def _norms(el: Elements, group: Ints, change: Floats, norm: Floats, fields: SubstepFields) -> None:
    """Squared change since the last iterate, and squared velocity, summed over the moving elements of each group."""
    shown, motion = el.shown, el.motion
    change[:] = 0.0
    norm[:] = 0.0
    for e in range(motion.u.size):
        if fields.active[e] > 0.0:
            # Without groups all elements settle as one.
            g = 0 if group.size == 0 else group[e]
            change[g] += (motion.u[e] - shown.u_pair[e]) ** 2 + (motion.v[e] - shown.v_pair[e]) ** 2
            norm[g] += motion.u[e] ** 2 + motion.v[e] ** 2


@stage
def _rewind(el: Elements, dt: float, group: Ints, unconverged: NDArray[np.bool_], fields: SubstepFields) -> None:
    """Let pair forces see this iterate, and go back to the velocity before the kick (docs/explanation/equations.md, 6.4)."""
    shown, motion, kicks = el.shown, el.motion, el.kicks
    half = 0.5 * dt
    for e in range(motion.u.size):
        if fields.active[e] == 0.0 or not unconverged[0 if group.size == 0 else group[e]]:
            continue
        shown.u_pair[e], shown.v_pair[e] = motion.u[e], motion.v[e]
        # The kick was half by the accelerations of before, half by those just solved for: both are taken back.
        motion.u[e] -= half * (kicks.ax_fast[e] + kicks.bx_fast[e]) + half * (kicks.ax[e] + kicks.bx[e])
        motion.v[e] -= half * (kicks.ay_fast[e] + kicks.by_fast[e]) + half * (kicks.ay[e] + kicks.by[e])
        kicks.ax_fast[e], kicks.ay_fast[e] = kicks.ax[e], kicks.ay[e]
        kicks.bx_fast[e], kicks.by_fast[e] = kicks.bx[e], kicks.by[e]
