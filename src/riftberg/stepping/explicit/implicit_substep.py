"""Implicit sub-step of the multiple-time-step scheme with KID's bonds (equations 6.4, part 3 with explicit_inner_mts off)."""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import add_velocity
from riftberg.state import Elements
from riftberg.stepping.explicit.outer_kick import OuterWorkspace, any_of
from riftberg.stepping.explicit.springs import SubstepFields
from riftberg.stepping.forces.implicit_velocity import INTERACTIONS_ONLY, is_isolated, solve_velocity
from riftberg.stepping.forces.interactions import PairLaw, Partners, pair_view
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.sizes import Sizes


@kernel
def _solve_all(el, dt, around, partners, unconverged, view, law, fields, p):
    """Kick all moving elements of unsettled groups once with velocities of the others frozen."""
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    half = 0.5 * dt
    bonded, same, other = partners.bonded.start, partners.same_berg.start, partners.collision.start
    media, rates, acts, coriolis, applied = around.media, around.rate, around.acts, around.coriolis, around.applied
    group, one = partners.group, partners.group.size == 0
    for e in range(motion.u.size):
        if fields.active[e] == 0.0 or not unconverged[0 if one else group[e]]:
            continue
        u0, v0 = motion.u[e], motion.v[e]
        us, vs = u0 + half * (kicks.ax_fast[e] + kicks.bx_fast[e]), v0 + half * (kicks.ay_fast[e] + kicks.by_fast[e])
        s = solve_velocity(
            e, place.lon[e], place.lat[e], us, vs, u0, v0, u0, v0, media, rates, acts, coriolis, applied, 0.5, 0.5, True, False,
            False, INTERACTIONS_ONLY, dt, body.mass[e], is_isolated(e, bonded, same, other), partners, False, p.constant_size,
            view, law,
        )  # fmt: skip
        motion.u[e], motion.v[e] = add_velocity(place.lon[e], place.lat[e], us, vs, s.total_x, s.total_y, dt, p.latlon)
        kicks.ax_fast[e], kicks.ay_fast[e], kicks.bx_fast[e], kicks.by_fast[e] = s.a_x, s.a_y, s.b_x, s.b_y


@kernel
def _norms(el, group, change, norm, fields):
    """Squared difference between velocities and those shown, and squared velocity, over the moving elements of a group."""
    shown, motion = el.shown, el.motion
    change[:] = 0.0
    norm[:] = 0.0
    for e in range(motion.u.size):
        if fields.active[e] > 0.0:
            g = 0 if group.size == 0 else group[e]
            change[g] += (motion.u[e] - shown.u_pair[e]) ** 2 + (motion.v[e] - shown.v_pair[e]) ** 2
            norm[g] += motion.u[e] ** 2 + motion.v[e] ** 2


@stage
def _rewind(el, dt, group, unconverged, fields):
    """Show this iterate to the others and go back to the velocity before the kick (equations 6.4, 3b)."""
    shown, motion, kicks = el.shown, el.motion, el.kicks
    half = 0.5 * dt
    for e in range(motion.u.size):
        if fields.active[e] == 0.0 or not unconverged[0 if group.size == 0 else group[e]]:
            continue
        shown.u_pair[e], shown.v_pair[e] = motion.u[e], motion.v[e]
        motion.u[e] -= half * (kicks.ax_fast[e] + kicks.bx_fast[e]) + half * (kicks.ax[e] + kicks.bx[e])
        motion.v[e] -= half * (kicks.ay_fast[e] + kicks.by_fast[e]) + half * (kicks.ay[e] + kicks.by[e])
        kicks.ax_fast[e], kicks.ay_fast[e], kicks.bx_fast[e], kicks.by_fast[e] = (
            kicks.ax[e],
            kicks.ay[e],
            kicks.bx[e],
            kicks.by[e],
        )


@stage
def implicit_kick(
    el: Elements, dt: float, around: Surroundings, partners: Partners, work: OuterWorkspace, sizes: Sizes, law: PairLaw,
    fields: SubstepFields, p: KernelParameters,
) -> int:  # fmt: skip
    """Kick the velocities implicitly, repeating until they settle if ``p.iterate``.

    ``ax`` ... ``by`` hold the fast accelerations of the sub-step before (copied by the caller).
    """
    view = pair_view(el, sizes)
    unconverged, before, change, norm = work.unconverged, work.norm_before, work.change, work.norm
    unconverged[:] = True
    _solve_all(el, dt, around, partners, unconverged, view, law, fields, p)
    if not p.iterate:
        return 1
    _norms(el, partners.group, change, before, fields)
    iterations = 1
    while any_of(unconverged):
        if iterations >= p.max_iterations:
            return -1
        _rewind(el, dt, partners.group, unconverged, fields)
        _solve_all(el, dt, around, partners, unconverged, view, law, fields, p)
        iterations += 1
        _norms(el, partners.group, change, norm, fields)
        for g in range(unconverged.size):
            scale = math.sqrt(before[g]) + math.sqrt(norm[g])
            if scale == 0.0 or 2.0 * math.sqrt(change[g]) / scale < p.tolerance:
                unconverged[g] = False
            before[g] = norm[g]
    return iterations
