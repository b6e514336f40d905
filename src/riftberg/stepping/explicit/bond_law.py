"""The loops of a sub-step over a block of bonds: gather the ends, apply the DEM law, sum per element (equations 5.3, 5.4).

Each loop here goes over one block of rows (`riftberg.stepping.explicit.bond_blocks`), has no branches and becomes vector
instructions. A function takes ``block``, the rows; ``sheet``, what is needed of them in this sub-step; ``ends``, their first
ends. Many short loops are faster than one long one: a processor works at several turns of a loop at once, as many as fit into
its window, and the law in one loop is a chain of some 300 cycles.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.bonds import (
    advance_slip,
    along_and_across,
    bending_torque,
    bond_section,
    normal_force,
    overlap,
    shear_stiffness,
    shear_stress_of,
    slip_speed,
    tensile_stress,
    torque_of,
)
from riftberg.physics.geometry import SMALL_ANGLE, cos_near, fast_sin, same_axes, sin_small
from riftberg.stepping.explicit import bond_blocks as row


@kernel
def gather_ends(sheet, second, ends):
    """Bring what the law needs of the second ends into the sheet, one by one; all loads stand before all stores."""
    for k in range(row.LANES):
        at = second[k]
        x, y, u, v = ends[at + row.X], ends[at + row.Y], ends[at + row.U], ends[at + row.V]
        spin, angle = ends[at + row.SPIN], ends[at + row.ANGLE]
        sheet[row.X + k], sheet[row.Y + k], sheet[row.U + k], sheet[row.V + k] = x, y, u, v
        sheet[row.SPIN + k], sheet[row.ANGLE + k] = spin, angle


@kernel
def next_ends(sheet, ends):
    """As `gather_ends` where each second end is the element after the first; ``ends`` goes on into the block that follows."""
    for k in range(row.LANES - 1):
        sheet[row.X + k], sheet[row.Y + k] = ends[row.X + 1 + k], ends[row.Y + 1 + k]
        sheet[row.U + k], sheet[row.V + k] = ends[row.U + 1 + k], ends[row.V + 1 + k]
        sheet[row.SPIN + k], sheet[row.ANGLE + k] = ends[row.SPIN + 1 + k], ends[row.ANGLE + 1 + k]
    last = row.LANES - 1
    sheet[row.X + last], sheet[row.Y + last] = ends[row.ENDS + row.X], ends[row.ENDS + row.Y]
    sheet[row.U + last], sheet[row.V + last] = ends[row.ENDS + row.U], ends[row.ENDS + row.V]
    sheet[row.SPIN + last], sheet[row.ANGLE + last] = ends[row.ENDS + row.SPIN], ends[row.ENDS + row.ANGLE]


@kernel
def _wrap(sheet, ends, period):
    """Bring second ends to the image nearest to the first in a periodic domain."""
    turns = 1.0 / period
    for k in range(row.LANES):
        sheet[row.X + k] += period * np.floor((ends[row.X + k] - sheet[row.X + k]) * turns + 0.5)


@kernel
def find_sections(block, sheet, ends, latlon, flat, earth_radius):
    """Find direction, length, overlap, width and thickness of the bonds."""
    per_unit = DEGREE * earth_radius if latlon else 1.0
    to_radians = DEGREE if latlon else 0.0
    curved = 0.0 if flat or not latlon else 1.0 / earth_radius
    for k in range(row.LANES):
        y1, y2, r1, r2 = ends[row.Y + k], sheet[row.Y + k], block[row.RADIUS1 + k], block[row.RADIUS2 + k]
        dx, sine = ends[row.X + k] - sheet[row.X + k], block[row.METRES_SIN + k]
        away = to_radians * (0.5 * (y1 + y2) - block[row.Y_LOADED + k])
        rx, ry = dx * cos_near(block[row.METRES_COS + k], sine, away), (y1 - y2) * per_unit
        length = math.sqrt(rx * rx + ry * ry)
        inverse = 1.0 / length
        half = overlap(block[row.REST + k], length)
        width, thickness = bond_section(
            min(r1, r2), abs(r1 - r2), block[row.THICKNESS_SMALL + k], block[row.THICKNESS_GAP + k], half, inverse
        )
        sheet[row.NX + k], sheet[row.NY + k], sheet[row.TURN + k] = rx * inverse, ry * inverse, dx * sine * curved
        sheet[row.LENGTH + k], sheet[row.HALF + k] = length, half
        sheet[row.WIDTH + k], sheet[row.THICKNESS + k] = width, thickness


@kernel
def _large_angles(block, sheet, ends):
    """Number of bonds whose angle is too large for the short sine; a whole number, so that the loop vectorises."""
    large = 0
    for k in range(row.LANES):
        angle = abs(ends[row.ANGLE + k] - sheet[row.ANGLE + k])
        large += 1 if (angle > SMALL_ANGLE) & (block[row.ALIVE + k] > 0.0) else 0
    return large


@kernel
def sines(block, sheet, ends, linear_bending):
    """Find the sine of the angle between both ends, or the angle itself."""
    if linear_bending:
        for k in range(row.LANES):
            sheet[row.SINE + k] = ends[row.ANGLE + k] - sheet[row.ANGLE + k]
    elif _large_angles(block, sheet, ends) == 0:
        for k in range(row.LANES):
            sheet[row.SINE + k] = sin_small(ends[row.ANGLE + k] - sheet[row.ANGLE + k])
    else:
        for k in range(row.LANES):
            sheet[row.SINE + k] = fast_sin(ends[row.ANGLE + k] - sheet[row.ANGLE + k])


@kernel
def forces(block, sheet, ends, dt, poisson, objective, no_shear):
    """Advance shear displacements over ``dt`` (s); find forces on the first ends, torques on both, and stresses.

    The objective damper acts on the slip at the contact, so its force there has a moment about both centres. The largest tensile
    stress of each row in this long step is kept.
    """
    shear_on = 0.0 if no_shear else 1.0
    slip_part = 1.0 if objective else 0.0
    for k in range(row.LANES):
        nx, ny, half, sine = sheet[row.NX + k], sheet[row.NY + k], sheet[row.HALF + k], sheet[row.SINE + k]
        width, thickness, alive = sheet[row.WIDTH + k], sheet[row.THICKNESS + k], block[row.ALIVE + k] > 0.0
        modulus, damping, peak = block[row.MODULUS + k], block[row.DAMPING + k], block[row.PEAK_STRESS + k]
        spin1, spin2 = ends[row.SPIN + k], sheet[row.SPIN + k]
        u1, v1, u2, v2 = ends[row.U + k], ends[row.V + k], sheet[row.U + k], sheet[row.V + k]
        du, dv = same_axes(u1 - u2, v1 - v2, 0.5 * (u1 + u2), 0.5 * (v1 + v2), sheet[row.TURN + k])
        parting, across = along_and_across(du, dv, nx, ny)
        sliding = slip_speed(across, (block[row.RADIUS1 + k] - half) * spin1 + (block[row.RADIUS2 + k] - half) * spin2)
        slip = advance_slip(block[row.SLIP + k], sliding, dt)
        push = normal_force(modulus, width, thickness, half) - damping * parting
        shear = -shear_on * shear_stiffness(modulus, poisson, width, thickness) * slip
        damper = -damping * (sliding if objective else across)
        at_contact, drag = shear + slip_part * damper, shear + damper
        bending = bending_torque(modulus, width, thickness, sine) - damping * (spin1 - spin2)
        stress = tensile_stress(modulus, half, sine, width)
        fx, fy = push * nx - drag * ny, push * ny + drag * nx
        torque1 = torque_of(block[row.LEVER1 + k] - half, at_contact) + bending
        torque2 = torque_of(block[row.LEVER2 + k] - half, at_contact) - bending
        block[row.SLIP + k] = slip
        # Where there is no bond, what stands in the row may be no number.
        block[row.FX + k], block[row.FY + k] = fx if alive else 0.0, fy if alive else 0.0
        sheet[row.TORQUE1 + k], block[row.TORQUE2 + k] = torque1 if alive else 0.0, torque2 if alive else 0.0
        sheet[row.NORMAL_STRESS + k] = stress
        sheet[row.SHEAR_STRESS + k] = shear_on * shear_stress_of(modulus, poisson, abs(slip))
        block[row.PEAK_STRESS + k] = stress if stress > peak else peak


@kernel
def apply_bond_law(
    block, sheet, ends, dt, poisson, objective, no_shear, linear_bending, flat, latlon, earth_radius, period
):  # fmt: skip
    """Apply the DEM law to a block of bonds, whose ends are at hand, over a sub-step of ``dt`` seconds.

    Writes forces on the first ends, torques on both ends, stresses, lengths and the new shear displacements.
    """
    if period > 0.0:
        _wrap(sheet, ends, period)
    find_sections(block, sheet, ends, latlon, flat, earth_radius)
    sines(block, sheet, ends, linear_bending)
    forces(block, sheet, ends, dt, poisson, objective, no_shear)


@kernel
def add_to_first(block, sheet, sums):
    """Add the loads of a block of bonds to those of their first ends."""
    for k in range(row.LANES):
        sums[row.SUM_X + k] += block[row.FX + k]
        sums[row.SUM_Y + k] += block[row.FY + k]
        sums[row.SUM_TORQUE + k] += sheet[row.TORQUE1 + k]
