"""Single-step velocity Verlet (equations 6.2)."""

from __future__ import annotations

from riftberg.compiled.kernels import borrower
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import add_velocity, move
from riftberg.state import Elements
from riftberg.stepping.forces.implicit_velocity import INTERACTIONS_ONLY, WITH_SURROUNDINGS, is_isolated, solve_velocity
from riftberg.stepping.forces.interactions import Partners, pair_law, pair_view
from riftberg.stepping.forces.media import Surroundings, find_surroundings
from riftberg.stepping.forces.sizes import Sizes


@borrower
def update_velocities(
    el: Elements, partners: Partners, sizes: Sizes, around: Surroundings, dt: float, p: KernelParameters
) -> None:
    """Update velocities and accelerations at the current positions; the others are seen as they were before.

    ``u_sync`` receives the reference's diagnostic u - dt/2 b of the velocity before the update.
    """
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    view, law = pair_view(el, sizes), pair_law(p)
    mode = INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS
    find_surroundings(el, sizes, around, p)
    media, rates, acts, coriolis, applied = around.media, around.rate, around.acts, around.coriolis, around.applied
    bonded, same, other = partners.bonded.start, partners.same_berg.start, partners.collision.start
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u, v = motion.u[e], motion.v[e]
        motion.u_sync[e], motion.v_sync[e] = u - 0.5 * dt * kicks.bx[e], v - 0.5 * dt * kicks.by[e]
        us, vs = u + 0.5 * dt * kicks.ax[e], v + 0.5 * dt * kicks.ay[e]
        s = solve_velocity(
            e, place.lon[e], place.lat[e], us, vs, u, v, u, v, media, rates, acts, coriolis, applied, 1.0, 0.5, True,
            False, False, mode, dt, body.mass[e], is_isolated(e, bonded, same, other), partners, p.plain_kid_branch, False,
            view, law,
        )  # fmt: skip
        motion.u[e], motion.v[e] = add_velocity(place.lon[e], place.lat[e], us, vs, s.total_x, s.total_y, dt, p.latlon)
        kicks.ax[e], kicks.ay[e], kicks.bx[e], kicks.by[e] = s.a_x, s.a_y, s.b_x, s.b_y


@borrower
def impose_velocity(el: Elements, u: float, v: float) -> None:
    """Give all moving elements one velocity (m s-1) and no acceleration."""
    motion, kicks, body = el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] < 0.5:
            motion.u[e], motion.v[e] = u, v
            kicks.ax[e] = kicks.ay[e] = kicks.bx[e] = kicks.by[e] = 0.0


@borrower
def update_positions(el: Elements, dt: float, p: KernelParameters) -> None:
    """Move by the new velocity and half kick: x += dt (u + dt/2 (a + b))."""
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u = motion.u[e] + 0.5 * dt * kicks.ax[e] + 0.5 * dt * kicks.bx[e]
        v = motion.v[e] + 0.5 * dt * kicks.ay[e] + 0.5 * dt * kicks.by[e]
        place.lon[e], place.lat[e] = move(place.lon[e], place.lat[e], u, v, dt, p.latlon, p.earth_radius)
