"""The elements of a lattice in blocks, as they go through the sub-steps (equations 6.4, part 3, with bonds as beams).

What an element has for itself stands beside that of its neighbours, quantity by quantity, as its bonds do
(`riftberg.stepping.explicit.tiles`); what the others see of it, place, angle and spin with it, stands in ``ends``
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
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.explicit.bond_rows import BondTiles
from riftberg.stepping.explicit.springs import SubstepFields


@kernel
def _pack(blocks, width, quantity, source):
    """Copy the values of all elements to a quantity of their blocks, which are ``width`` numbers long."""
    for b in range(tile.tile_count(source.size)):
        some = source[b * tile.LANES : min((b + 1) * tile.LANES, source.size)]
        bond = blocks[b * width + quantity : b * width + quantity + tile.LANES]
        for k in range(some.size):
            bond[k] = some[k]


@kernel
def _unpack(target, blocks, width, quantity):
    """Copy back what `_pack` has copied."""
    for b in range(tile.tile_count(target.size)):
        some = target[b * tile.LANES : min((b + 1) * tile.LANES, target.size)]
        bond = blocks[b * width + quantity : b * width + quantity + tile.LANES]
        for k in range(some.size):
            some[k] = bond[k]


@kernel
def _pack_motion(tiles, shown, motion, kicks):
    """Place, motion and accelerations; those that do not move show what they showed before."""
    elem, ends = tiles.elem, tiles.ends
    _pack(ends, tile.END_TILE, tile.X, shown.lon_pair)
    _pack(ends, tile.END_TILE, tile.Y, shown.lat_pair)
    _pack(ends, tile.END_TILE, tile.U, shown.u_pair)
    _pack(ends, tile.END_TILE, tile.V, shown.v_pair)
    _pack(ends, tile.END_TILE, tile.SPIN, motion.spin)
    _pack(ends, tile.END_TILE, tile.ANGLE, motion.rotation)
    _pack(elem, tile.ELEMENT_TILE, tile.VELOCITY_X, motion.u)
    _pack(elem, tile.ELEMENT_TILE, tile.VELOCITY_Y, motion.v)
    _pack(elem, tile.ELEMENT_TILE, tile.AX, kicks.ax_fast)
    _pack(elem, tile.ELEMENT_TILE, tile.AY, kicks.ay_fast)
    _pack(elem, tile.ELEMENT_TILE, tile.BX, kicks.bx_fast)
    _pack(elem, tile.ELEMENT_TILE, tile.BY, kicks.by_fast)
    _pack(elem, tile.ELEMENT_TILE, tile.SPIN_RATE, kicks.spin_rate)


@kernel
def _pack_bodies(elem, body, fields):
    """What elements are, in this long step, and what the floor does to them."""
    _pack(elem, tile.ELEMENT_TILE, tile.ACTIVE, fields.active)
    _pack(elem, tile.ELEMENT_TILE, tile.PER_MASS, fields.per_mass)
    _pack(elem, tile.ELEMENT_TILE, tile.PER_INERTIA, fields.per_inertia)
    _pack(elem, tile.ELEMENT_TILE, tile.LOAD_X, body.load_x)
    _pack(elem, tile.ELEMENT_TILE, tile.LOAD_Y, body.load_y)
    _pack(elem, tile.ELEMENT_TILE, tile.FREE_Y, body.free_y)
    _pack(elem, tile.ELEMENT_TILE, tile.FLOOR_RATE, fields.ground_rate)
    _pack(elem, tile.ELEMENT_TILE, tile.FLOOR_LINEAR, fields.ground_linear)
    _pack(elem, tile.ELEMENT_TILE, tile.FLOOR_QUADRATIC, fields.ground_quadratic)
    _pack(elem, tile.ELEMENT_TILE, tile.DECAY, fields.ground_decay)
    _pack(elem, tile.ELEMENT_TILE, tile.SPIN_DECAY, fields.ground_spin_decay)


@stage
def pack_elements(tiles: BondTiles, el: Elements, fields: SubstepFields) -> None:
    """Lay out the elements for the sub-steps of a long step."""
    tiles.elem[:] = 0.0
    tiles.sums[:] = 0.0
    tiles.rotation[:] = 0.0
    _pack_motion(tiles, el.shown, el.motion, el.kicks)
    _pack_bodies(tiles.elem, el.body, fields)


@kernel
def unpack_pair_state(tiles: BondTiles, el: Elements) -> None:
    """Write to the state what contact reads there: places, velocities, and those shown."""
    shown, motion, elem, ends = el.shown, el.motion, tiles.elem, tiles.ends
    _unpack(shown.lon_pair, ends, tile.END_TILE, tile.X)
    _unpack(shown.lat_pair, ends, tile.END_TILE, tile.Y)
    _unpack(shown.u_pair, ends, tile.END_TILE, tile.U)
    _unpack(shown.v_pair, ends, tile.END_TILE, tile.V)
    _unpack(motion.u, elem, tile.ELEMENT_TILE, tile.VELOCITY_X)
    _unpack(motion.v, elem, tile.ELEMENT_TILE, tile.VELOCITY_Y)


@kernel
def pack_contact(tiles: BondTiles, ax: Floats, ay: Floats) -> None:
    """Take up the accelerations (m s-2) by contact."""
    _pack(tiles.elem, tile.ELEMENT_TILE, tile.CONTACT_X, ax)
    _pack(tiles.elem, tile.ELEMENT_TILE, tile.CONTACT_Y, ay)


@stage
def unpack_elements(tiles: BondTiles, el: Elements, fields: SubstepFields) -> None:
    """Give back to the state, and to the scratch rows of the floor, what the sub-steps have changed."""
    place, motion, kicks, elem, ends = el.place, el.motion, el.kicks, tiles.elem, tiles.ends
    unpack_pair_state(tiles, el)
    _unpack(place.lon, ends, tile.END_TILE, tile.X)
    _unpack(place.lat, ends, tile.END_TILE, tile.Y)
    _unpack(motion.spin, ends, tile.END_TILE, tile.SPIN)
    _unpack(motion.rotation, ends, tile.END_TILE, tile.ANGLE)
    _unpack(kicks.ax_fast, elem, tile.ELEMENT_TILE, tile.AX)
    _unpack(kicks.ay_fast, elem, tile.ELEMENT_TILE, tile.AY)
    _unpack(kicks.spin_rate, elem, tile.ELEMENT_TILE, tile.SPIN_RATE)
    _unpack(fields.floor_impulse_x, elem, tile.ELEMENT_TILE, tile.FLOOR_IMPULSE_X)
    _unpack(fields.floor_impulse_y, elem, tile.ELEMENT_TILE, tile.FLOOR_IMPULSE_Y)


@kernel
def drift_tile(elem, ends, rotation, dt: float, latlon: bool, radius: float, q1: bool) -> None:
    """Move elements by their mid-step velocity and show it, and note how far they turn (equations 6.4, 3a).

    With ``q1`` the northward mid-step velocity uses the eastward implicit acceleration, as the reference does (Q1).
    """
    half = 0.5 * dt
    per_metre = 1.0 / (DEGREE * radius if latlon else 1.0)
    to_degrees = 1.0 if latlon else 0.0
    for k in range(tile.LANES):
        u, v, ax, ay, bx, by = (
            elem[tile.VELOCITY_X + k],
            elem[tile.VELOCITY_Y + k],
            elem[tile.AX + k],
            elem[tile.AY + k],
            elem[tile.BX + k],
            elem[tile.BY + k],
        )
        x, y, u_shown, v_shown = (
            ends[tile.X + k],
            ends[tile.Y + k],
            ends[tile.U + k],
            ends[tile.V + k],
        )
        moves, spin, turn = elem[tile.ACTIVE + k] > 0.0, ends[tile.SPIN + k], rotation[k]
        wu, wv = u + half * (ax + bx), v + half * (ay + by)
        seen = v + half * (ay + (bx if q1 else by))
        step = dt * per_metre
        new_x, new_y = x + step * (wu / fast_cos_latitude(to_degrees * y)), y + step * wv
        ends[tile.X + k], ends[tile.Y + k] = new_x if moves else x, new_y if moves else y
        ends[tile.U + k], ends[tile.V + k] = wu if moves else u_shown, seen if moves else v_shown
        rotation[k] = turn + spin * dt


@kernel
def drift_tile_near_pole(elem, ends, rotation, dt: float, radius: float, q1: bool) -> None:
    """As `drift_tile`, on the tangent plane where latitude is above 89 degrees."""
    for k in range(tile.LANES):
        rotation[k] += ends[tile.SPIN + k] * dt
        if elem[tile.ACTIVE + k] == 0.0:
            continue
        bx, by = elem[tile.BX + k], elem[tile.BY + k]
        wu = elem[tile.VELOCITY_X + k] + 0.5 * dt * (elem[tile.AX + k] + bx)
        wv = elem[tile.VELOCITY_Y + k] + 0.5 * dt * (elem[tile.AY + k] + by)
        ends[tile.X + k], ends[tile.Y + k] = move(ends[tile.X + k], ends[tile.Y + k], wu, wv, dt, True, radius)
        ends[tile.U + k] = wu
        ends[tile.V + k] = elem[tile.VELOCITY_Y + k] + 0.5 * dt * (elem[tile.AY + k] + bx) if q1 else wv


@kernel
def sum_over_bonds(scratch, sums, slots, bond) -> None:
    """Sum forces (N) and torques (N m) over the bonds of a block of elements into the sheet.

    First those that begin there, which ``sums`` holds and is cleared of, then those that end there, in the order of the
    slots.
    """
    for k in range(slots.shape[0]):
        sum_x, sum_y, sum_torque = (
            sums[tile.SUM_X + k],
            sums[tile.SUM_Y + k],
            sums[tile.SUM_TORQUE + k],
        )
        for n in range(slots.shape[1]):
            at = slots[k, n]
            sum_x -= bond[at + tile.FX]
            sum_y -= bond[at + tile.FY]
            sum_torque += bond[at + tile.TORQUE2]
        scratch[tile.SUM_X + k], scratch[tile.SUM_Y + k], scratch[tile.SUM_TORQUE + k] = sum_x, sum_y, sum_torque
    for k in range(tile.SUM_TILE):
        sums[k] = 0.0


@kernel
def floor_rates(elem, dt: float) -> None:
    """Find the rates of the sea floor's drag at the velocities now, where it grows with the speed."""
    for k in range(tile.LANES):
        u, v = elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k]
        rate = elem[tile.FLOOR_LINEAR + k] + elem[tile.FLOOR_QUADRATIC + k] * math.sqrt(u * u + v * v)
        elem[tile.FLOOR_RATE + k], elem[tile.DECAY + k] = rate, 1.0 / (1.0 + rate * dt)


@kernel
def accumulate_floor_impulse(elem) -> None:
    """Add the accelerations by the sea floor in this sub-step: before an explicit kick, after an implicit one."""
    for k in range(tile.LANES):
        rate = elem[tile.ACTIVE + k] * elem[tile.FLOOR_RATE + k]
        elem[tile.FLOOR_IMPULSE_X + k] -= rate * elem[tile.VELOCITY_X + k]
        elem[tile.FLOOR_IMPULSE_Y + k] -= rate * elem[tile.VELOCITY_Y + k]


@kernel
def start_tile(elem, ends, scratch, dt: float, implicit_ground: bool) -> None:
    """Take the accelerations just found as those before the first sub-step of ``dt`` seconds.

    So it has its first half kick; what the sea floor does in that half kick is kept with what it does in the sub-steps. Spin is
    brought half a sub-step and angle one sub-step ahead of the positions, where the leapfrog of `kick_tile` has them:
    the angle at hand in a sub-step is that which its bonds see; with that of the start the run would be of first order.
    """
    for k in range(tile.LANES):
        active = elem[tile.ACTIVE + k]
        rate = 0.0 if implicit_ground else active * elem[tile.FLOOR_RATE + k]
        ax = elem[tile.CONTACT_X + k] + (scratch[tile.SUM_X + k] + elem[tile.LOAD_X + k]) * elem[tile.PER_MASS + k]
        ay = (
            elem[tile.CONTACT_Y + k]
            + (scratch[tile.SUM_Y + k] * elem[tile.FREE_Y + k] + elem[tile.LOAD_Y + k]) * elem[tile.PER_MASS + k]
        )
        spin_rate = active * (scratch[tile.SUM_TORQUE + k] * elem[tile.PER_INERTIA + k])
        elem[tile.AX + k], elem[tile.AY + k] = (
            active * ax - rate * elem[tile.VELOCITY_X + k],
            active * ay - rate * elem[tile.VELOCITY_Y + k],
        )
        elem[tile.FLOOR_IMPULSE_X + k] -= 0.5 * rate * elem[tile.VELOCITY_X + k]
        elem[tile.FLOOR_IMPULSE_Y + k] -= 0.5 * rate * elem[tile.VELOCITY_Y + k]
        elem[tile.SPIN_RATE + k] = spin_rate
        ends[tile.SPIN + k] += active * 0.5 * dt * spin_rate
        ends[tile.ANGLE + k] += active * dt * ends[tile.SPIN + k]


@kernel
def kick_tile(elem, ends, scratch, dt: float, implicit_ground: bool) -> None:
    """Update velocities, spins and angles of elements whose forces are summed in the sheet (equations 5.3; 6.4, 3b and 3c).

    Velocities get half the old and half the new fast acceleration. The drag of the sea floor is explicit (part of the fast
    acceleration, at the velocity before the sub-step) or implicit: the new velocity is divided by ``1 + rate dt``,
    which is stable for any rate. Near the pole the reference turns velocity and acceleration to the tangent plane and
    back with one longitude, which changes nothing.
    """
    half = 0.5 * dt
    explicit = 0.0 if implicit_ground else 1.0
    for k in range(tile.LANES):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax_old, ay_old = (
            elem[tile.VELOCITY_X + k],
            elem[tile.VELOCITY_Y + k],
            elem[tile.AX + k],
            elem[tile.AY + k],
        )
        active, rate, decay, per_mass = (
            elem[tile.ACTIVE + k],
            elem[tile.FLOOR_RATE + k],
            elem[tile.DECAY + k],
            elem[tile.PER_MASS + k],
        )
        spin, angle = ends[tile.SPIN + k], ends[tile.ANGLE + k]
        moves = active > 0.0
        factor = decay if implicit_ground else 1.0
        ax = (
            elem[tile.CONTACT_X + k]
            + (scratch[tile.SUM_X + k] + elem[tile.LOAD_X + k]) * per_mass
            - explicit * rate * u
        )
        ay = (
            elem[tile.CONTACT_Y + k]
            + (scratch[tile.SUM_Y + k] * elem[tile.FREE_Y + k] + elem[tile.LOAD_Y + k]) * per_mass
            - explicit * rate * v
        )
        spin_rate = active * (scratch[tile.SUM_TORQUE + k] * elem[tile.PER_INERTIA + k])
        new_u, new_v = (u + half * ax_old + half * ax) * factor, (v + half * ay_old + half * ay) * factor
        new_spin = (spin + dt * spin_rate) * elem[tile.SPIN_DECAY + k]
        elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k] = (
            new_u if moves else u,
            new_v if moves else v,
        )
        elem[tile.AX + k], elem[tile.AY + k] = ax if moves else ax_old, ay if moves else ay_old
        elem[tile.SPIN_RATE + k] = spin_rate
        ends[tile.SPIN + k] = new_spin if moves else spin
        ends[tile.ANGLE + k] = angle + active * dt * new_spin
