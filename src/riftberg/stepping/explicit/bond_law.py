"""The loops of a sub-step over a block of bonds: gather the ends, apply the DEM law, sum per element (equations 5.3, 5.4).

Each loop here goes over one block of rows (`riftberg.stepping.explicit.tiles`), has no branches and becomes vector
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
from riftberg.stepping.explicit import tiles as tile


@kernel
def gather_second_ends(scratch, second, ends):
    """Bring what the law needs of the second ends into the sheet, one by one; all loads stand before all stores."""
    for k in range(tile.LANES):
        at = second[k]
        x, y, u, v = ends[at + tile.X], ends[at + tile.Y], ends[at + tile.U], ends[at + tile.V]
        spin, angle = ends[at + tile.SPIN], ends[at + tile.ANGLE]
        scratch[tile.X + k], scratch[tile.Y + k], scratch[tile.U + k], scratch[tile.V + k] = x, y, u, v
        scratch[tile.SPIN + k], scratch[tile.ANGLE + k] = spin, angle


@kernel
def shift_second_ends(scratch, ends):
    """As `gather_second_ends` where each second end is the element after the first; ``ends`` holds the next tile too."""
    for k in range(tile.LANES - 1):
        scratch[tile.X + k], scratch[tile.Y + k] = ends[tile.X + 1 + k], ends[tile.Y + 1 + k]
        scratch[tile.U + k], scratch[tile.V + k] = ends[tile.U + 1 + k], ends[tile.V + 1 + k]
        scratch[tile.SPIN + k], scratch[tile.ANGLE + k] = ends[tile.SPIN + 1 + k], ends[tile.ANGLE + 1 + k]
    last = tile.LANES - 1
    scratch[tile.X + last], scratch[tile.Y + last] = (
        ends[tile.END_TILE + tile.X],
        ends[tile.END_TILE + tile.Y],
    )
    scratch[tile.U + last], scratch[tile.V + last] = (
        ends[tile.END_TILE + tile.U],
        ends[tile.END_TILE + tile.V],
    )
    scratch[tile.SPIN + last], scratch[tile.ANGLE + last] = (
        ends[tile.END_TILE + tile.SPIN],
        ends[tile.END_TILE + tile.ANGLE],
    )


@kernel
def _wrap(scratch, ends, period):
    """Bring second ends to the image nearest to the first in a periodic domain."""
    turns = 1.0 / period
    for k in range(tile.LANES):
        scratch[tile.X + k] += period * np.floor((ends[tile.X + k] - scratch[tile.X + k]) * turns + 0.5)


@kernel
def find_sections(bond, scratch, ends, latlon, flat, earth_radius):
    """Find direction, length, overlap, width and thickness of the bonds."""
    per_unit = DEGREE * earth_radius if latlon else 1.0
    to_radians = DEGREE if latlon else 0.0
    curved = 0.0 if flat or not latlon else 1.0 / earth_radius
    for k in range(tile.LANES):
        y1, y2, r1, r2 = (
            ends[tile.Y + k],
            scratch[tile.Y + k],
            bond[tile.RADIUS1 + k],
            bond[tile.RADIUS2 + k],
        )
        dx, sine = ends[tile.X + k] - scratch[tile.X + k], bond[tile.METRES_SIN + k]
        away = to_radians * (0.5 * (y1 + y2) - bond[tile.Y_REFERENCE + k])
        rx, ry = dx * cos_near(bond[tile.METRES_COS + k], sine, away), (y1 - y2) * per_unit
        length = math.sqrt(rx * rx + ry * ry)
        inverse = 1.0 / length
        half = overlap(bond[tile.REST + k], length)
        width, thickness = bond_section(
            min(r1, r2),
            abs(r1 - r2),
            bond[tile.THICKNESS_SMALL + k],
            bond[tile.THICKNESS_GAP + k],
            half,
            inverse,
        )
        scratch[tile.NX + k], scratch[tile.NY + k], scratch[tile.TURN + k] = (
            rx * inverse,
            ry * inverse,
            dx * sine * curved,
        )
        scratch[tile.LENGTH + k], scratch[tile.HALF + k] = length, half
        scratch[tile.WIDTH + k], scratch[tile.THICKNESS + k] = width, thickness


@kernel
def _large_angles(bond, scratch, ends):
    """Number of bonds whose angle is too large for the short sine; a whole number, so that the loop vectorises."""
    large = 0
    for k in range(tile.LANES):
        angle = abs(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])
        large += 1 if (angle > SMALL_ANGLE) & (bond[tile.INTACT + k] > 0.0) else 0
    return large


@kernel
def sines(bond, scratch, ends, linear_bending):
    """Find the sine of the angle between both ends, or the angle itself."""
    if linear_bending:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = ends[tile.ANGLE + k] - scratch[tile.ANGLE + k]
    elif _large_angles(bond, scratch, ends) == 0:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = sin_small(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])
    else:
        for k in range(tile.LANES):
            scratch[tile.SINE + k] = fast_sin(ends[tile.ANGLE + k] - scratch[tile.ANGLE + k])


@kernel
def forces(bond, scratch, ends, dt, poisson, objective, no_shear):
    """Advance shear displacements over ``dt`` (s); find forces on the first ends, torques on both, and stresses.

    The objective damper acts on the slip at the contact, so its force there has a moment about both centres. The largest tensile
    stress of each row in this long step is kept.
    """
    shear_on = 0.0 if no_shear else 1.0
    slip_part = 1.0 if objective else 0.0
    for k in range(tile.LANES):
        nx, ny, half, sine = scratch[tile.NX + k], scratch[tile.NY + k], scratch[tile.HALF + k], scratch[tile.SINE + k]
        width, thickness, intact = (
            scratch[tile.WIDTH + k],
            scratch[tile.THICKNESS + k],
            bond[tile.INTACT + k] > 0.0,
        )
        modulus, damping, peak = (
            bond[tile.MODULUS + k],
            bond[tile.DAMPING + k],
            bond[tile.PEAK_STRESS + k],
        )
        spin1, spin2 = ends[tile.SPIN + k], scratch[tile.SPIN + k]
        u1, v1, u2, v2 = ends[tile.U + k], ends[tile.V + k], scratch[tile.U + k], scratch[tile.V + k]
        du, dv = same_axes(u1 - u2, v1 - v2, 0.5 * (u1 + u2), 0.5 * (v1 + v2), scratch[tile.TURN + k])
        parting, across = along_and_across(du, dv, nx, ny)
        sliding = slip_speed(across, (bond[tile.RADIUS1 + k] - half) * spin1 + (bond[tile.RADIUS2 + k] - half) * spin2)
        slip = advance_slip(bond[tile.SLIP + k], sliding, dt)
        push = normal_force(modulus, width, thickness, half) - damping * parting
        shear = -shear_on * shear_stiffness(modulus, poisson, width, thickness) * slip
        damper = -damping * (sliding if objective else across)
        at_contact, drag = shear + slip_part * damper, shear + damper
        bending = bending_torque(modulus, width, thickness, sine) - damping * (spin1 - spin2)
        stress = tensile_stress(modulus, half, sine, width)
        fx, fy = push * nx - drag * ny, push * ny + drag * nx
        torque1 = torque_of(bond[tile.LEVER1 + k] - half, at_contact) + bending
        torque2 = torque_of(bond[tile.LEVER2 + k] - half, at_contact) - bending
        bond[tile.SLIP + k] = slip
        # Where there is no bond, what stands in the row may be no number.
        bond[tile.FX + k], bond[tile.FY + k] = fx if intact else 0.0, fy if intact else 0.0
        scratch[tile.TORQUE1 + k], bond[tile.TORQUE2 + k] = torque1 if intact else 0.0, torque2 if intact else 0.0
        scratch[tile.NORMAL_STRESS + k] = stress
        scratch[tile.SHEAR_STRESS + k] = shear_on * shear_stress_of(modulus, poisson, abs(slip))
        bond[tile.PEAK_STRESS + k] = stress if stress > peak else peak


@kernel
def apply_bond_law(
    bond, scratch, ends, dt, poisson, objective, no_shear, linear_bending, flat, latlon, earth_radius, period
):  # fmt: skip
    """Apply the DEM law to a block of bonds, whose ends are at hand, over a sub-step of ``dt`` seconds.

    Writes forces on the first ends, torques on both ends, stresses, lengths and the new shear displacements.
    """
    if period > 0.0:
        _wrap(scratch, ends, period)
    find_sections(bond, scratch, ends, latlon, flat, earth_radius)
    sines(bond, scratch, ends, linear_bending)
    forces(bond, scratch, ends, dt, poisson, objective, no_shear)


@kernel
def accumulate_first_ends(bond, scratch, sums):
    """Add the loads of a block of bonds to those of their first ends."""
    for k in range(tile.LANES):
        sums[tile.SUM_X + k] += bond[tile.FX + k]
        sums[tile.SUM_Y + k] += bond[tile.FY + k]
        sums[tile.SUM_TORQUE + k] += scratch[tile.TORQUE1 + k]
