"""The elements of a lattice in blocks, as they go through the sub-steps (equations 6.4, part 3, with bonds as beams).

What an element has for itself stands beside that of its neighbours, quantity by quantity, as its bonds do
(`riftberg.stepping.explicit.bond_blocks`); what the others see of it, place, angle and spin with it, stands in ``ends``
and nowhere else. So all that happens to an element between two evaluations of the bonds happens while its block is at
hand: the sum over its bonds, the kick, and the drift of the sub-step that follows. The state gets it back at the end of
the long step, and before contact, which looks there.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.physics.geometry import fast_cos_latitude, move
from riftberg.state import Elements, Floats
from riftberg.stepping.explicit import bond_blocks as row
from riftberg.stepping.explicit.bond_rows import BondRows
from riftberg.stepping.forces.scratch import Scratch


@kernel
def _lay_out(blocks, width, quantity, source):
    """Copy the values of all elements to a quantity of their blocks, which are ``width`` numbers long."""
    for b in range(row.blocks_of(source.size)):
        some = source[b * row.LANES : min((b + 1) * row.LANES, source.size)]
        block = blocks[b * width + quantity : b * width + quantity + row.LANES]
        for k in range(some.size):
            block[k] = some[k]


@kernel
def _bring_back(target, blocks, width, quantity):
    """Copy back what `_lay_out` has copied."""
    for b in range(row.blocks_of(target.size)):
        some = target[b * row.LANES : min((b + 1) * row.LANES, target.size)]
        block = blocks[b * width + quantity : b * width + quantity + row.LANES]
        for k in range(some.size):
            some[k] = block[k]


@kernel
def _lay_out_motion(rows, shown, motion, kicks):
    """Place, motion and accelerations; those that do not move show what they showed before."""
    own, ends = rows.own, rows.ends
    _lay_out(ends, row.ENDS, row.X, shown.lon_pair)
    _lay_out(ends, row.ENDS, row.Y, shown.lat_pair)
    _lay_out(ends, row.ENDS, row.U, shown.u_pair)
    _lay_out(ends, row.ENDS, row.V, shown.v_pair)
    _lay_out(ends, row.ENDS, row.SPIN, motion.spin)
    _lay_out(ends, row.ENDS, row.ANGLE, motion.rotation)
    _lay_out(own, row.OWN, row.OWN_U, motion.u)
    _lay_out(own, row.OWN, row.OWN_V, motion.v)
    _lay_out(own, row.OWN, row.AX, kicks.ax_fast)
    _lay_out(own, row.OWN, row.AY, kicks.ay_fast)
    _lay_out(own, row.OWN, row.BX, kicks.bx_fast)
    _lay_out(own, row.OWN, row.BY, kicks.by_fast)
    _lay_out(own, row.OWN, row.SPIN_RATE, kicks.spin_rate)


@kernel
def _lay_out_bodies(own, body, scratch):
    """What elements are, in this long step, and what the floor does to them."""
    _lay_out(own, row.OWN, row.ACTIVE, scratch.active)
    _lay_out(own, row.OWN, row.PER_MASS, scratch.per_mass)
    _lay_out(own, row.OWN, row.PER_INERTIA, scratch.per_inertia)
    _lay_out(own, row.OWN, row.LOAD_X, body.load_x)
    _lay_out(own, row.OWN, row.LOAD_Y, body.load_y)
    _lay_out(own, row.OWN, row.FREE_Y, body.free_y)
    _lay_out(own, row.OWN, row.RATE, scratch.ground_rate)
    _lay_out(own, row.OWN, row.LINEAR, scratch.ground_linear)
    _lay_out(own, row.OWN, row.QUADRATIC, scratch.ground_quadratic)
    _lay_out(own, row.OWN, row.LEAVES, scratch.ground_decay)
    _lay_out(own, row.OWN, row.LEAVES_SPIN, scratch.ground_spin_decay)


@stage
def load_elements(rows: BondRows, el: Elements, scratch: Scratch) -> None:
    """Lay out the elements for the sub-steps of a long step."""
    rows.own[:] = 0.0
    rows.sums[:] = 0.0
    rows.turned[:] = 0.0
    _lay_out_motion(rows, el.shown, el.motion, el.kicks)
    _lay_out_bodies(rows.own, el.body, scratch)


@kernel
def show_elements(rows: BondRows, el: Elements) -> None:
    """Write to the state what contact reads there: places, velocities, and those shown."""
    shown, motion, own, ends = el.shown, el.motion, rows.own, rows.ends
    _bring_back(shown.lon_pair, ends, row.ENDS, row.X)
    _bring_back(shown.lat_pair, ends, row.ENDS, row.Y)
    _bring_back(shown.u_pair, ends, row.ENDS, row.U)
    _bring_back(shown.v_pair, ends, row.ENDS, row.V)
    _bring_back(motion.u, own, row.OWN, row.OWN_U)
    _bring_back(motion.v, own, row.OWN, row.OWN_V)


@kernel
def take_contact(rows: BondRows, ax: Floats, ay: Floats) -> None:
    """Take up the accelerations (m s-2) by contact."""
    _lay_out(rows.own, row.OWN, row.CONTACT_X, ax)
    _lay_out(rows.own, row.OWN, row.CONTACT_Y, ay)


@stage
def store_elements(rows: BondRows, el: Elements, scratch: Scratch) -> None:
    """Give back to the state, and to the scratch rows of the floor, what the sub-steps have changed."""
    place, motion, kicks, own, ends = el.place, el.motion, el.kicks, rows.own, rows.ends
    show_elements(rows, el)
    _bring_back(place.lon, ends, row.ENDS, row.X)
    _bring_back(place.lat, ends, row.ENDS, row.Y)
    _bring_back(motion.spin, ends, row.ENDS, row.SPIN)
    _bring_back(motion.rotation, ends, row.ENDS, row.ANGLE)
    _bring_back(kicks.ax_fast, own, row.OWN, row.AX)
    _bring_back(kicks.ay_fast, own, row.OWN, row.AY)
    _bring_back(kicks.spin_rate, own, row.OWN, row.SPIN_RATE)
    _bring_back(scratch.floor_impulse_x, own, row.OWN, row.STOPPED_X)
    _bring_back(scratch.floor_impulse_y, own, row.OWN, row.STOPPED_Y)


@kernel
def drift_block(own, ends, turned, dt: float, latlon: bool, radius: float, q1: bool) -> None:
    """Move elements by their mid-step velocity and show it, and note how far they turn (equations 6.4, 3a).

    With ``q1`` the northward mid-step velocity uses the eastward implicit acceleration, as the reference does (Q1).
    """
    half = 0.5 * dt
    per_metre = 1.0 / (DEGREE * radius if latlon else 1.0)
    to_degrees = 1.0 if latlon else 0.0
    for k in range(row.LANES):
        u, v, ax, ay, bx, by = (
            own[row.OWN_U + k],
            own[row.OWN_V + k],
            own[row.AX + k],
            own[row.AY + k],
            own[row.BX + k],
            own[row.BY + k],
        )
        x, y, u_shown, v_shown = ends[row.X + k], ends[row.Y + k], ends[row.U + k], ends[row.V + k]
        moves, spin, turn = own[row.ACTIVE + k] > 0.0, ends[row.SPIN + k], turned[k]
        wu, wv = u + half * (ax + bx), v + half * (ay + by)
        seen = v + half * (ay + (bx if q1 else by))
        step = dt * per_metre
        new_x, new_y = x + step * (wu / fast_cos_latitude(to_degrees * y)), y + step * wv
        ends[row.X + k], ends[row.Y + k] = new_x if moves else x, new_y if moves else y
        ends[row.U + k], ends[row.V + k] = wu if moves else u_shown, seen if moves else v_shown
        turned[k] = turn + spin * dt


@kernel
def drift_block_near_pole(own, ends, turned, dt: float, radius: float, q1: bool) -> None:
    """As `drift_block`, on the tangent plane where latitude is above 89 degrees."""
    for k in range(row.LANES):
        turned[k] += ends[row.SPIN + k] * dt
        if own[row.ACTIVE + k] == 0.0:
            continue
        bx, by = own[row.BX + k], own[row.BY + k]
        wu = own[row.OWN_U + k] + 0.5 * dt * (own[row.AX + k] + bx)
        wv = own[row.OWN_V + k] + 0.5 * dt * (own[row.AY + k] + by)
        ends[row.X + k], ends[row.Y + k] = move(ends[row.X + k], ends[row.Y + k], wu, wv, dt, True, radius)
        ends[row.U + k] = wu
        ends[row.V + k] = own[row.OWN_V + k] + 0.5 * dt * (own[row.AY + k] + bx) if q1 else wv


@kernel
def sum_over_bonds(sheet, sums, slot, block) -> None:
    """Sum forces (N) and torques (N m) over the bonds of a block of elements into the sheet.

    First those that begin there, which ``sums`` holds and is cleared of, then those that end there, in the order of the
    slots.
    """
    for k in range(slot.shape[0]):
        sum_x, sum_y, sum_torque = sums[row.SUM_X + k], sums[row.SUM_Y + k], sums[row.SUM_TORQUE + k]
        for n in range(slot.shape[1]):
            at = slot[k, n]
            sum_x -= block[at + row.FX]
            sum_y -= block[at + row.FY]
            sum_torque += block[at + row.TORQUE2]
        sheet[row.SUM_X + k], sheet[row.SUM_Y + k], sheet[row.SUM_TORQUE + k] = sum_x, sum_y, sum_torque
    for k in range(row.SUMS):
        sums[k] = 0.0


@kernel
def rates_of_floor(own, dt: float) -> None:
    """Find the rates of the sea floor's drag at the velocities now, where it grows with the speed."""
    for k in range(row.LANES):
        u, v = own[row.OWN_U + k], own[row.OWN_V + k]
        rate = own[row.LINEAR + k] + own[row.QUADRATIC + k] * math.sqrt(u * u + v * v)
        own[row.RATE + k], own[row.LEAVES + k] = rate, 1.0 / (1.0 + rate * dt)


@kernel
def stopped_by_floor(own) -> None:
    """Add the accelerations by the sea floor in this sub-step: before an explicit kick, after an implicit one."""
    for k in range(row.LANES):
        rate = own[row.ACTIVE + k] * own[row.RATE + k]
        own[row.STOPPED_X + k] -= rate * own[row.OWN_U + k]
        own[row.STOPPED_Y + k] -= rate * own[row.OWN_V + k]


@kernel
def start_block(own, ends, sheet, dt: float, implicit_ground: bool) -> None:
    """Take the accelerations just found as those before the first sub-step of ``dt`` seconds.

    So it has its first half kick; what the sea floor does in that half kick is kept with what it does in the sub-steps. Spin is
    brought half a sub-step and angle one sub-step ahead of the positions, where the leapfrog of `kick_block` has them:
    the angle at hand in a sub-step is that which its bonds see; with that of the start the run would be of first order.
    """
    for k in range(row.LANES):
        active = own[row.ACTIVE + k]
        rate = 0.0 if implicit_ground else active * own[row.RATE + k]
        ax = own[row.CONTACT_X + k] + (sheet[row.SUM_X + k] + own[row.LOAD_X + k]) * own[row.PER_MASS + k]
        ay = (
            own[row.CONTACT_Y + k]
            + (sheet[row.SUM_Y + k] * own[row.FREE_Y + k] + own[row.LOAD_Y + k]) * own[row.PER_MASS + k]
        )
        spin_rate = active * (sheet[row.SUM_TORQUE + k] * own[row.PER_INERTIA + k])
        own[row.AX + k], own[row.AY + k] = (
            active * ax - rate * own[row.OWN_U + k],
            active * ay - rate * own[row.OWN_V + k],
        )
        own[row.STOPPED_X + k] -= 0.5 * rate * own[row.OWN_U + k]
        own[row.STOPPED_Y + k] -= 0.5 * rate * own[row.OWN_V + k]
        own[row.SPIN_RATE + k] = spin_rate
        ends[row.SPIN + k] += active * 0.5 * dt * spin_rate
        ends[row.ANGLE + k] += active * dt * ends[row.SPIN + k]


@kernel
def kick_block(own, ends, sheet, dt: float, implicit_ground: bool) -> None:
    """Update velocities, spins and angles of elements whose forces are summed in the sheet (equations 5.3; 6.4, 3b and 3c).

    Velocities get half the old and half the new fast acceleration. The drag of the sea floor is explicit (part of the fast
    acceleration, at the velocity before the sub-step) or implicit: the new velocity is divided by ``1 + rate dt``,
    which is stable for any rate. Near the pole the reference turns velocity and acceleration to the tangent plane and
    back with one longitude, which changes nothing.
    """
    half = 0.5 * dt
    explicit = 0.0 if implicit_ground else 1.0
    for k in range(row.LANES):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax_old, ay_old = own[row.OWN_U + k], own[row.OWN_V + k], own[row.AX + k], own[row.AY + k]
        active, rate, decay, per_mass = (
            own[row.ACTIVE + k],
            own[row.RATE + k],
            own[row.LEAVES + k],
            own[row.PER_MASS + k],
        )
        spin, angle = ends[row.SPIN + k], ends[row.ANGLE + k]
        moves = active > 0.0
        factor = decay if implicit_ground else 1.0
        ax = own[row.CONTACT_X + k] + (sheet[row.SUM_X + k] + own[row.LOAD_X + k]) * per_mass - explicit * rate * u
        ay = (
            own[row.CONTACT_Y + k]
            + (sheet[row.SUM_Y + k] * own[row.FREE_Y + k] + own[row.LOAD_Y + k]) * per_mass
            - explicit * rate * v
        )
        spin_rate = active * (sheet[row.SUM_TORQUE + k] * own[row.PER_INERTIA + k])
        new_u, new_v = (u + half * ax_old + half * ax) * factor, (v + half * ay_old + half * ay) * factor
        new_spin = (spin + dt * spin_rate) * own[row.LEAVES_SPIN + k]
        own[row.OWN_U + k], own[row.OWN_V + k] = new_u if moves else u, new_v if moves else v
        own[row.AX + k], own[row.AY + k] = ax if moves else ax_old, ay if moves else ay_old
        own[row.SPIN_RATE + k] = spin_rate
        ends[row.SPIN + k] = new_spin if moves else spin
        ends[row.ANGLE + k] = angle + active * dt * new_spin
