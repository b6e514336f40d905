"""The loops of a sub-step over one tile (equations 5.3, 5.4; 6.4, part 3, with bonds as beams).

Over a tile of bonds: fetch the ends, apply the beam law, sum over the first ends. Over a tile of elements: sum over the bonds,
kick, and drift to the positions of the next sub-step; all that happens to an element between two evaluations of the bonds
happens while its tile is in the cache. A loop takes ``bond``, ``shape``, ``elem``, ``ends``, ``sums`` and ``scratch``: tiles as
`riftberg.engines.explicit.tiles` lays them out; of bonds, ``ends`` are the first ones.

Each loop has no branches and becomes vector instructions. Many short loops are faster than one long one: a processor works at
several turns of a loop at once, as many as fit into its window, and the law in one loop is a chain of some 300 cycles.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.engines.explicit import tiles as tile
from riftberg.engines.explicit.substeps import drifted, floor_drag_rate, kicked, mid_step_velocity
from riftberg.engines.explicit.tiles import Indices
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import (
    advance_slip,
    along_and_across,
    bending_torque,
    bond_overlap,
    bond_section,
    normal_force,
    shear_stiffness,
    shear_stress_of,
    slip_speed,
    tensile_stress,
    torque_of,
)
from riftberg.physics.geometry import SMALL_ANGLE, cos_near, fast_sin, move, same_axes, sin_small
from riftberg.state import Floats


@kernel
def gather_second_ends(scratch: Floats, second: Indices, ends: Floats) -> None:
    """Copy the inputs of the law at the second ends into the scratch tile, one by one; all loads stand before all stores."""
    for k in range(tile.LANES):
        at = second[k]
        x, y, u, v = ends[at + tile.X], ends[at + tile.Y], ends[at + tile.U], ends[at + tile.V]
        spin, angle = ends[at + tile.SPIN], ends[at + tile.ANGLE]
        scratch[tile.X + k], scratch[tile.Y + k], scratch[tile.U + k], scratch[tile.V + k] = x, y, u, v
        scratch[tile.SPIN + k], scratch[tile.ANGLE + k] = spin, angle


@kernel
def shift_second_ends(scratch: Floats, ends: Floats) -> None:
    """As `gather_second_ends` where each second end is the element after the first; ``ends`` holds the next tile too."""
    for k in range(tile.LANES - 1):
        scratch[tile.X + k], scratch[tile.Y + k] = ends[tile.X + 1 + k], ends[tile.Y + 1 + k]
        scratch[tile.U + k], scratch[tile.V + k] = ends[tile.U + 1 + k], ends[tile.V + 1 + k]
        scratch[tile.SPIN + k], scratch[tile.ANGLE + k] = ends[tile.SPIN + 1 + k], ends[tile.ANGLE + 1 + k]
    # The second end of the last bond stands at the head of the next tile.
    last = tile.LANES - 1
    scratch[tile.X + last], scratch[tile.Y + last] = (ends[tile.END_TILE + tile.X], ends[tile.END_TILE + tile.Y])
    scratch[tile.U + last], scratch[tile.V + last] = (ends[tile.END_TILE + tile.U], ends[tile.END_TILE + tile.V])
    scratch[tile.SPIN + last], scratch[tile.ANGLE + last] = (
        ends[tile.END_TILE + tile.SPIN],
        ends[tile.END_TILE + tile.ANGLE],
    )


@kernel
def _wrap(scratch: Floats, ends: Floats, period: float) -> None:
    """Bring second ends to the image nearest to the first in a periodic domain."""
    turns = 1.0 / period
    for k in range(tile.LANES):
        scratch[tile.X + k] += period * np.floor((ends[tile.X + k] - scratch[tile.X + k]) * turns + 0.5)


@kernel
def find_sections(
    bond: Floats, shape: Floats, scratch: Floats, ends: Floats, latlon: bool, flat: bool, earth_radius: float
) -> None:
    """Find direction, length, overlap, width and thickness of the bonds."""
    per_unit = DEGREE * earth_radius if latlon else 1.0
    to_radians = DEGREE if latlon else 0.0
    curved = 0.0 if flat or not latlon else 1.0 / earth_radius
    for k in range(tile.LANES):
        y1, y2, r1, r2 = (ends[tile.Y + k], scratch[tile.Y + k], shape[tile.RADIUS1 + k], shape[tile.RADIUS2 + k])
        dx, sine = ends[tile.X + k] - scratch[tile.X + k], bond[tile.METRES_SIN + k]
        # Metres of a degree from those at a latitude near by: a few multiplications, where a cosine would be a call.
        from_reference = to_radians * (0.5 * (y1 + y2) - bond[tile.Y_REFERENCE + k])
        rx, ry = dx * cos_near(bond[tile.METRES_COS + k], sine, from_reference), (y1 - y2) * per_unit
        # One division serves direction, width and thickness: divisions are the slowest of these instructions.
        length = math.sqrt(rx * rx + ry * ry)
        inverse = 1.0 / length
        half = bond_overlap(shape[tile.REST + k], length)
        width, thickness = bond_section(
            min(r1, r2), abs(r1 - r2), shape[tile.THICKNESS_SMALL + k], shape[tile.THICKNESS_GAP + k], half, inverse
        )
        scratch[tile.NX + k], scratch[tile.NY + k], scratch[tile.TURN + k] = (
            rx * inverse,
            ry * inverse,
            dx * sine * curved,
        )
        scratch[tile.LENGTH + k], scratch[tile.HALF + k] = length, half
        scratch[tile.WIDTH + k], scratch[tile.THICKNESS + k] = width, thickness


@kernel
def _large_angles(bond: Floats, scratch: Floats, ends: Floats) -> int:
    """Number of bonds whose angle is too large for the short sine; a whole number, so that the loop vectorises."""
    large = 0
    for k in range(tile.LANES):
        angle = abs(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])
        large += 1 if (angle > SMALL_ANGLE) & (bond[tile.INTACT + k] > 0.0) else 0
    return large


@kernel
def sines(bond: Floats, scratch: Floats, ends: Floats, linear_bending: bool) -> None:
    """Find the sine of the angle between both ends, or the angle itself."""
    if linear_bending:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = ends[tile.ANGLE + k] - scratch[tile.ANGLE + k]
    # Decided for the tile as a whole: a choice lane by lane would take both ways for every bond.
    elif _large_angles(bond, scratch, ends) == 0:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = sin_small(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])
    else:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = fast_sin(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])


@kernel
def forces(
    bond: Floats, shape: Floats, scratch: Floats, ends: Floats, dt: float, poisson: float, objective: bool, no_shear: bool,
) -> None:  # fmt: skip
    """Advance shear displacements over ``dt`` (s); find forces on the first ends, torques on both, and stresses.

    The objective damper acts on the slip at the contact, so its force there has a moment about both centres. The largest tensile
    stress of each bond in this long step is kept.
    """
    shear_on = 0.0 if no_shear else 1.0
    slip_part = 1.0 if objective else 0.0
    for k in range(tile.LANES):
        nx, ny, half, sine = scratch[tile.NX + k], scratch[tile.NY + k], scratch[tile.HALF + k], scratch[tile.SINE + k]
        width, thickness, intact = (scratch[tile.WIDTH + k], scratch[tile.THICKNESS + k], bond[tile.INTACT + k] > 0.0)
        modulus, damping, peak = (shape[tile.MODULUS + k], shape[tile.DAMPING + k], bond[tile.PEAK_STRESS + k])
        spin1, spin2 = ends[tile.SPIN + k], scratch[tile.SPIN + k]
        u1, v1, u2, v2 = ends[tile.U + k], ends[tile.V + k], scratch[tile.U + k], scratch[tile.V + k]
        du, dv = same_axes(u1 - u2, v1 - v2, 0.5 * (u1 + u2), 0.5 * (v1 + v2), scratch[tile.TURN + k])
        parting, across = along_and_across(du, dv, nx, ny)
        sliding = slip_speed(
            across, (shape[tile.RADIUS1 + k] - half) * spin1 + (shape[tile.RADIUS2 + k] - half) * spin2
        )
        slip = advance_slip(bond[tile.SLIP + k], sliding, dt)
        push = normal_force(modulus, width, thickness, half) - damping * parting
        shear = -shear_on * shear_stiffness(modulus, poisson, width, thickness) * slip
        damper = -damping * (sliding if objective else across)
        at_contact, drag = shear + slip_part * damper, shear + damper
        bending = bending_torque(modulus, width, thickness, sine) - damping * (spin1 - spin2)
        stress = tensile_stress(modulus, half, sine, width)
        fx, fy = push * nx - drag * ny, push * ny + drag * nx
        torque1 = torque_of(shape[tile.LEVER1 + k] - half, at_contact) + bending
        torque2 = torque_of(shape[tile.LEVER2 + k] - half, at_contact) - bending
        bond[tile.SLIP + k] = slip
        # Where there is no bond, what stands in the lane may be no number.
        bond[tile.FX + k], bond[tile.FY + k] = fx if intact else 0.0, fy if intact else 0.0
        scratch[tile.TORQUE1 + k], bond[tile.TORQUE2 + k] = torque1 if intact else 0.0, torque2 if intact else 0.0
        scratch[tile.NORMAL_STRESS + k] = stress
        scratch[tile.SHEAR_STRESS + k] = shear_on * shear_stress_of(modulus, poisson, abs(slip))
        bond[tile.PEAK_STRESS + k] = stress if stress > peak else peak


@kernel
def apply_bond_law(
    bond: Floats, shape: Floats, scratch: Floats, ends: Floats, dt: float, p: KernelParameters, period: float
) -> None:
    """Apply the beam law to a tile of bonds, whose second ends have been fetched, over ``dt`` seconds.

    Writes forces on the first ends, torques on both ends, stresses, lengths and the new shear displacements.
    """
    if period > 0.0:
        _wrap(scratch, ends, period)
    find_sections(bond, shape, scratch, ends, p.latlon, p.flat_relative_velocity, p.earth_radius)
    sines(bond, scratch, ends, p.linear_bending)
    forces(bond, shape, scratch, ends, dt, p.poisson, p.objective_damping, p.no_shear)


@kernel
def accumulate_first_ends(bond: Floats, scratch: Floats, sums: Floats) -> None:
    """Add the loads of a tile of bonds to the sums of their first ends."""
    for k in range(tile.LANES):
        sums[tile.SUM_X + k] += bond[tile.FX + k]
        sums[tile.SUM_Y + k] += bond[tile.FY + k]
        sums[tile.SUM_TORQUE + k] += scratch[tile.TORQUE1 + k]


@kernel
def drift_tile(elem: Floats, ends: Floats, rotation: Floats, dt: float, latlon: bool, radius: float, q1: bool) -> None:
    """Move elements by their mid-step velocity, as pair forces see them, and add up how far they turn (equations 6.4).

    ``q1``: see `mid_step_velocity`.
    """
    half = 0.5 * dt
    step = dt * (1.0 / (DEGREE * radius if latlon else 1.0))
    to_degrees = 1.0 if latlon else 0.0
    for k in range(tile.LANES):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax, ay = elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k], elem[tile.AX + k], elem[tile.AY + k]
        bx, by, x, y = elem[tile.BX + k], elem[tile.BY + k], ends[tile.X + k], ends[tile.Y + k]
        u_seen, v_seen, turned = ends[tile.U + k], ends[tile.V + k], rotation[k]
        moves, spin = elem[tile.ACTIVE + k] > 0.0, ends[tile.SPIN + k]
        wu, wv, seen = mid_step_velocity(u, v, ax, ay, bx, by, half, q1)
        new_x, new_y = drifted(x, y, wu, wv, step, to_degrees)
        ends[tile.X + k], ends[tile.Y + k] = new_x if moves else x, new_y if moves else y
        ends[tile.U + k], ends[tile.V + k] = wu if moves else u_seen, seen if moves else v_seen
        rotation[k] = turned + spin * dt


@kernel
def drift_tile_near_pole(elem: Floats, ends: Floats, rotation: Floats, dt: float, radius: float, q1: bool) -> None:
    """As `drift_tile`, on the tangent plane where latitude is above 89 degrees."""
    for k in range(tile.LANES):
        rotation[k] += ends[tile.SPIN + k] * dt
        if elem[tile.ACTIVE + k] == 0.0:
            continue
        wu, wv, seen = mid_step_velocity(
            elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k], elem[tile.AX + k], elem[tile.AY + k],
            elem[tile.BX + k], elem[tile.BY + k], 0.5 * dt, q1,
        )  # fmt: skip
        ends[tile.X + k], ends[tile.Y + k] = move(ends[tile.X + k], ends[tile.Y + k], wu, wv, dt, True, radius)
        ends[tile.U + k], ends[tile.V + k] = wu, seen


@kernel
def sum_over_bonds(scratch: Floats, sums: Floats, slots: Indices, bond: Floats) -> None:
    """Sum forces (N) and torques (N m) over the bonds of a tile of elements into the scratch tile.

    First those that begin there, which ``sums`` holds and is cleared of, then those that end there, in the order of the
    slots.
    """
    for k in range(slots.shape[0]):
        sum_x, sum_y, sum_torque = sums[tile.SUM_X + k], sums[tile.SUM_Y + k], sums[tile.SUM_TORQUE + k]
        # The order of addition is that of the slots, whatever the order of the tiles: the sums are the same bit for bit.
        for n in range(slots.shape[1]):
            at = slots[k, n]
            sum_x -= bond[at + tile.FX]
            sum_y -= bond[at + tile.FY]
            sum_torque += bond[at + tile.TORQUE2]
        scratch[tile.SUM_X + k], scratch[tile.SUM_Y + k], scratch[tile.SUM_TORQUE + k] = sum_x, sum_y, sum_torque
    for k in range(tile.SUM_TILE):
        sums[k] = 0.0


@kernel
def floor_rates(elem: Floats, dt: float) -> None:
    """Find the rates of the sea floor's drag at the velocities now, where it grows with the speed."""
    for k in range(tile.LANES):
        u, v = elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k]
        rate = floor_drag_rate(elem[tile.FLOOR_LINEAR + k], elem[tile.FLOOR_QUADRATIC + k], u, v)
        elem[tile.FLOOR_RATE + k], elem[tile.DECAY + k] = rate, 1.0 / (1.0 + rate * dt)


@kernel
def accumulate_floor_impulse(elem: Floats) -> None:
    """Add the accelerations by the sea floor in this sub-step: before an explicit kick, after an implicit one."""
    for k in range(tile.LANES):
        rate = elem[tile.ACTIVE + k] * elem[tile.FLOOR_RATE + k]
        elem[tile.FLOOR_IMPULSE_X + k] -= rate * elem[tile.VELOCITY_X + k]
        elem[tile.FLOOR_IMPULSE_Y + k] -= rate * elem[tile.VELOCITY_Y + k]


@kernel
def start_tile(elem: Floats, ends: Floats, scratch: Floats, dt: float, implicit_floor: bool) -> None:
    """Take the accelerations just found as those before the first sub-step of ``dt`` seconds.

    So it has its first half kick; what the sea floor does in that half kick is added to what it does in the sub-steps. Spin is
    brought half a sub-step and angle one sub-step ahead of the positions, where the leapfrog of `kick_tile` has them:
    the angle at hand in a sub-step is that which its bonds see; with that of the start the run would be of first order.
    """
    for k in range(tile.LANES):
        # Factors of 0 or 1 stand for conditions, which would keep the loop from vectorising.
        active, per_mass = elem[tile.ACTIVE + k], elem[tile.PER_MASS + k]
        rate = 0.0 if implicit_floor else active * elem[tile.FLOOR_RATE + k]
        u, v = elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k]
        force_x = scratch[tile.SUM_X + k] + elem[tile.LOAD_X + k]
        force_y = scratch[tile.SUM_Y + k] * elem[tile.FREE_Y + k] + elem[tile.LOAD_Y + k]
        ax, ay = elem[tile.CONTACT_X + k] + force_x * per_mass, elem[tile.CONTACT_Y + k] + force_y * per_mass
        spin_rate = active * (scratch[tile.SUM_TORQUE + k] * elem[tile.PER_INERTIA + k])
        elem[tile.AX + k], elem[tile.AY + k] = active * ax - rate * u, active * ay - rate * v
        elem[tile.FLOOR_IMPULSE_X + k] -= 0.5 * rate * u
        elem[tile.FLOOR_IMPULSE_Y + k] -= 0.5 * rate * v
        elem[tile.SPIN_RATE + k] = spin_rate
        ends[tile.SPIN + k] += active * 0.5 * dt * spin_rate
        ends[tile.ANGLE + k] += active * dt * ends[tile.SPIN + k]


@kernel
def kick_tile(elem: Floats, ends: Floats, scratch: Floats, dt: float, implicit_floor: bool) -> None:
    """Update velocities, spins and angles of elements whose forces are summed in the scratch tile (equations 5.3, 6.4).

    `kicked` has the formulae. Spins leap by the whole sub-step, so they belong to its middle.
    """
    half = 0.5 * dt
    for k in range(tile.LANES):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax_old, ay_old = (
            elem[tile.VELOCITY_X + k],
            elem[tile.VELOCITY_Y + k],
            elem[tile.AX + k],
            elem[tile.AY + k],
        )
        active, rate, decay, per_mass = (
            elem[tile.ACTIVE + k], elem[tile.FLOOR_RATE + k], elem[tile.DECAY + k], elem[tile.PER_MASS + k],
        )  # fmt: skip
        spin, angle, moves = ends[tile.SPIN + k], ends[tile.ANGLE + k], active > 0.0
        force_x = scratch[tile.SUM_X + k] + elem[tile.LOAD_X + k]
        force_y = scratch[tile.SUM_Y + k] * elem[tile.FREE_Y + k] + elem[tile.LOAD_Y + k]
        ax, ay = elem[tile.CONTACT_X + k] + force_x * per_mass, elem[tile.CONTACT_Y + k] + force_y * per_mass
        new_u, new_v, ax, ay = kicked(u, v, ax_old, ay_old, ax, ay, rate, decay, half, implicit_floor)
        spin_rate = active * (scratch[tile.SUM_TORQUE + k] * elem[tile.PER_INERTIA + k])
        new_spin = (spin + dt * spin_rate) * elem[tile.SPIN_DECAY + k]
        elem[tile.VELOCITY_X + k], elem[tile.VELOCITY_Y + k] = new_u if moves else u, new_v if moves else v
        elem[tile.AX + k], elem[tile.AY + k] = ax if moves else ax_old, ay if moves else ay_old
        elem[tile.SPIN_RATE + k] = spin_rate
        ends[tile.SPIN + k] = new_spin if moves else spin
        ends[tile.ANGLE + k] = angle + active * dt * new_spin
