"""Implicit sub-step of the multiple-time-step scheme with KID's bonds (spec 6.4, part 3 with explicit_inner_mts off)."""

from __future__ import annotations

import math

from riftberg.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import add_velocity
from riftberg.state import Elements
from riftberg.stepping.interactions import PairLaw, Partners, pair_view
from riftberg.stepping.media import Surroundings
from riftberg.stepping.sizes import Sizes
from riftberg.stepping.substep import Scratch
from riftberg.stepping.velocity import INTERACTIONS_ONLY, lone_elements, solve_velocity


@kernel
def _solve_all(el, dt, around, partners, view, law, scratch, p):
    """Kick all moving elements once with velocities of the others frozen."""
    half = 0.5 * dt
    alone = lone_elements(partners)
    for e in range(el.u.size):
        if scratch.active[e] == 0.0:
            continue
        u0, v0 = el.u[e], el.v[e]
        us, vs = u0 + half * (el.ax_fast[e] + el.bx_fast[e]), v0 + half * (el.ay_fast[e] + el.by_fast[e])
        s = solve_velocity(
            e, el.lon[e], el.lat[e], us, vs, u0, v0, u0, v0, around, 0.5, 0.5, True, False, INTERACTIONS_ONLY, dt,
            el.mass[e], alone[e], partners, False, p.constant_size, view, law,
        )  # fmt: skip
        el.u[e], el.v[e] = add_velocity(el.lon[e], el.lat[e], us, vs, s.total_x, s.total_y, dt, p.latlon)
        el.ax_fast[e], el.ay_fast[e], el.bx_fast[e], el.by_fast[e] = s.a_x, s.a_y, s.b_x, s.b_y


@kernel
def _norms(el, scratch):
    """Squared difference between velocities and those shown, and squared velocity, over the moving elements."""
    change = norm = 0.0
    for e in range(el.u.size):
        if scratch.active[e] > 0.0:
            change += (el.u[e] - el.u_pair[e]) ** 2 + (el.v[e] - el.v_pair[e]) ** 2
            norm += el.u[e] ** 2 + el.v[e] ** 2
    return change, norm


@stage
def _rewind(el, dt, scratch):
    """Show this iterate to the others and go back to the velocity before the kick (spec 6.4, 3b)."""
    half = 0.5 * dt
    for e in range(el.u.size):
        if scratch.active[e] == 0.0:
            continue
        el.u_pair[e], el.v_pair[e] = el.u[e], el.v[e]
        el.u[e] -= half * (el.ax_fast[e] + el.bx_fast[e]) + half * (el.ax[e] + el.bx[e])
        el.v[e] -= half * (el.ay_fast[e] + el.by_fast[e]) + half * (el.ay[e] + el.by[e])
        el.ax_fast[e], el.ay_fast[e], el.bx_fast[e], el.by_fast[e] = el.ax[e], el.ay[e], el.bx[e], el.by[e]


@stage
def implicit_kick(
    el: Elements, dt: float, around: Surroundings, partners: Partners, sizes: Sizes, law: PairLaw, scratch: Scratch,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Kick the velocities implicitly, repeating until they settle if ``p.iterate``.

    ``ax`` ... ``by`` hold the fast accelerations of the sub-step before (copied by the caller).

    Returns
    -------
    int
        Passes needed; -1 if the iteration did not settle.
    """
    view = pair_view(el, sizes)
    _solve_all(el, dt, around, partners, view, law, scratch, p)
    if not p.iterate:
        return 1
    _, before = _norms(el, scratch)
    passes = 1
    while True:
        if passes >= p.max_iterations:
            return -1
        _rewind(el, dt, scratch)
        _solve_all(el, dt, around, partners, view, law, scratch, p)
        passes += 1
        change, norm = _norms(el, scratch)
        scale = math.sqrt(before) + math.sqrt(norm)
        if scale == 0.0 or 2.0 * math.sqrt(change) / scale < p.tolerance:
            return passes
        before = norm
