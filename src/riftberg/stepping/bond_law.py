"""The loops of a sub-step over bonds: gather the ends, apply the DEM law to whole rows, sum per element (equations 5.3, 5.4).

Each loop here goes over one block of rows (`riftberg.stepping.bond_blocks`), has no branches and becomes vector instructions;
`apply_bond_law` runs them block by block. Many short loops are faster than one long one: a processor works at several turns of a
loop at once, as many as fit into its window, and the law in one loop is a chain of some 300 cycles.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.constants import DEGREE
from riftberg.kernels import kernel
from riftberg.physics.bonds import (
    advance_shear,
    bending_torque,
    bond_section,
    contact_velocity,
    normal_force,
    overlap,
    shear_stiffness,
    shear_stress_of,
    tensile_stress,
    torque_of,
)
from riftberg.physics.geometry import fast_cos_latitude, fast_sin, same_axes
from riftberg.stepping import bond_blocks as row


@kernel
def gather_ends(block, first, second, x, y, u, v, spin, rotation):
    """Bring what the law needs of both ends of each bond into its block."""
    for k in range(row.LANES):
        i, j = first[k], second[k]
        block[row.DX + k] = x[i] - x[j]
        block[row.DY + k] = y[i] - y[j]
        block[row.Y_MEAN + k] = 0.5 * (y[i] + y[j])
        block[row.DU + k] = u[i] - u[j]
        block[row.DV + k] = v[i] - v[j]
        block[row.U_MEAN + k] = 0.5 * (u[i] + u[j])
        block[row.V_MEAN + k] = 0.5 * (v[i] + v[j])
        block[row.SPIN1 + k] = spin[i]
        block[row.SPIN2 + k] = spin[j]
        block[row.ANGLE + k] = rotation[i] - rotation[j]


@kernel
def bonds_in_metres(block, latlon, earth_radius, period):
    """Turn the differences of the ends into metres, to the nearest image where the domain is periodic (period above 0)."""
    per_unit = DEGREE * earth_radius if latlon else 1.0
    to_degrees = 1.0 if latlon else 0.0
    turns = 1.0 / period if period > 0.0 else 0.0
    whole = period if period > 0.0 else 0.0
    for k in range(row.LANES):
        dx = block[row.DX + k]
        dx -= whole * np.floor(dx * turns + 0.5)
        block[row.RX + k] = dx * (per_unit * fast_cos_latitude(to_degrees * block[row.Y_MEAN + k]))
        block[row.RY + k] = block[row.DY + k] * per_unit


@kernel
def sines(block, linear_bending):
    """Find the sine of the angle between both ends, or the angle itself."""
    if linear_bending:
        for k in range(row.LANES):
            block[row.SINE + k] = block[row.ANGLE + k]
    else:
        for k in range(row.LANES):
            block[row.SINE + k] = fast_sin(block[row.ANGLE + k])


@kernel
def sections(block):
    """Find length, direction, overlap, width and thickness of the bonds."""
    for k in range(row.LANES):
        rx, ry = block[row.RX + k], block[row.RY + k]
        length = math.sqrt(rx * rx + ry * ry)
        inverse = 1.0 / length
        half = overlap(block[row.REST + k], length)
        width, thickness = bond_section(
            block[row.RADIUS_SMALL + k],
            block[row.RADIUS_GAP + k],
            block[row.THICKNESS_SMALL + k],
            block[row.THICKNESS_GAP + k],
            half,
            length,
        )
        block[row.NX + k], block[row.NY + k] = rx * inverse, ry * inverse
        block[row.LENGTH + k], block[row.HALF + k] = length, half
        block[row.WIDTH + k], block[row.THICKNESS + k] = width, thickness


@kernel
def slips(block, dt, objective):
    """Advance shear displacement and turn over ``dt`` (s), and find the damping force.

    The objective damper acts on the slip at the contact, so its force there has a moment about both centres.
    """
    for k in range(row.LANES):
        nx, ny, half, c = (
            block[row.NX + k],
            block[row.NY + k],
            block[row.HALF + k],
            block[row.DAMPING + k],
        )
        spin1, spin2 = block[row.SPIN1 + k], block[row.SPIN2 + k]
        spins = (block[row.RADIUS1 + k] - half) * spin1 + (block[row.RADIUS2 + k] - half) * spin2
        du, dv = same_axes(
            block[row.DU + k],
            block[row.DV + k],
            block[row.U_MEAN + k],
            block[row.V_MEAN + k],
            block[row.RX + k],
            block[row.CONVERGENCE + k],
        )
        cx, cy = contact_velocity(du, dv, nx, ny, spins)
        sx, sy = advance_shear(block[row.SX + k], block[row.SY + k], nx, ny, cx, cy, dt)
        block[row.SX + k], block[row.SY + k] = sx, sy
        block[row.DAMP_X + k] = -c * (cx if objective else du)
        block[row.DAMP_Y + k] = -c * (cy if objective else dv)
        block[row.RELATIVE_ROTATION + k] += (spin1 - spin2) * dt


@kernel
def forces(block, youngs, poisson, objective, no_shear):
    """Find forces on the first ends and torques on both ends."""
    shear_on = 0.0 if no_shear else 1.0
    slip_part = 1.0 if objective else 0.0
    for k in range(row.LANES):
        nx, ny, half, rest = (
            block[row.NX + k],
            block[row.NY + k],
            block[row.HALF + k],
            block[row.REST + k],
        )
        width, thickness, alive = block[row.WIDTH + k], block[row.THICKNESS + k], block[row.ALIVE + k]
        bx, by = block[row.DAMP_X + k], block[row.DAMP_Y + k]
        lever1, lever2 = block[row.LEVER1 + k] - half, block[row.LEVER2 + k] - half
        fn = normal_force(youngs, width, thickness, rest, half)
        stiffness = shear_on * shear_stiffness(youngs, poisson, width, thickness, rest)
        tx, ty = -stiffness * block[row.SX + k], -stiffness * block[row.SY + k]
        bending = bending_torque(youngs, width, thickness, rest, block[row.SINE + k])
        spin_damping = -block[row.DAMPING + k] * (block[row.SPIN1 + k] - block[row.SPIN2 + k])
        lx, ly = tx + slip_part * bx, ty + slip_part * by
        block[row.FX + k] = alive * (fn * nx + tx + bx)
        block[row.FY + k] = alive * (fn * ny + ty + by)
        block[row.TORQUE1 + k] = alive * (torque_of(lever1, nx, ny, lx, ly) + bending + spin_damping)
        block[row.TORQUE2 + k] = alive * (torque_of(lever2, nx, ny, lx, ly) - bending - spin_damping)


@kernel
def stresses(block, youngs, poisson, no_shear):
    """Find tensile and shear stress (Pa), and keep the largest tensile stress of each row in this long step."""
    shear_on = 0.0 if no_shear else 1.0
    for k in range(row.LANES):
        sx, sy, rest, peak = (
            block[row.SX + k],
            block[row.SY + k],
            block[row.REST + k],
            block[row.PEAK_STRESS + k],
        )
        stress = tensile_stress(youngs, rest, block[row.HALF + k], block[row.SINE + k], block[row.WIDTH + k])
        slip = math.sqrt(sx * sx + sy * sy)
        block[row.NORMAL_STRESS + k] = stress
        block[row.SHEAR_STRESS + k] = shear_on * shear_stress_of(youngs, poisson, rest, slip)
        block[row.PEAK_STRESS + k] = stress if stress > peak else peak


@kernel
def apply_bond_law(rows, count, el, dt, p):
    """Gather the ends of rows 0 ... count - 1 and apply the DEM law to them over a sub-step of ``dt`` seconds.

    Writes forces on the first ends, torques on both ends, stresses, lengths and the new shear displacements.
    """
    x, y, u, v = el.shown.lon_pair, el.shown.lat_pair, el.shown.u_pair, el.shown.v_pair
    spin, rotation = el.motion.spin, el.motion.rotation
    for b in range(row.blocks_of(count)):
        # A view of one block: LLVM sees that no index in it is negative, which an offset from outside would hide.
        block = rows.block[b * row.BLOCK : (b + 1) * row.BLOCK]
        first, second = (
            rows.first[b * row.LANES : (b + 1) * row.LANES],
            rows.second[b * row.LANES : (b + 1) * row.LANES],
        )
        gather_ends(block, first, second, x, y, u, v, spin, rotation)
        bonds_in_metres(block, p.latlon, p.earth_radius, p.period)
        sines(block, p.linear_bending)
        sections(block)
        slips(block, dt, p.objective_damping)
        forces(block, p.youngs_modulus, p.poisson, p.objective_damping, p.no_shear)
        stresses(block, p.youngs_modulus, p.poisson, p.no_shear)


@kernel
def sum_over_bonds(rows, fx, fy, torque):
    """Sum forces (N) and torques (N m) over the bonds of each element, in order of slot."""
    block, slot, sign, torque_slot = rows.block, rows.slot, rows.sign, rows.torque_slot
    for e in range(fx.size):
        sum_x = sum_y = sum_torque = 0.0
        for k in range(slot.shape[1]):
            at, s = slot[e, k], sign[e, k]
            sum_x += s * block[at + row.FX]
            sum_y += s * block[at + row.FY]
            sum_torque += block[torque_slot[e, k]]
        fx[e], fy[e], torque[e] = sum_x, sum_y, sum_torque
