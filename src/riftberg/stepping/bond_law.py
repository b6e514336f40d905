"""The loops of a sub-step over bonds: gather the ends, apply the DEM law to whole rows, sum per element (equations 5.3, 5.4)."""

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


@kernel
def gather_ends(rows, count, el):
    """Bring the differences between both ends of each bond into contiguous rows."""
    shown, motion = el.shown, el.motion
    for r in range(count):
        i, j = rows.first[r], rows.second[r]
        rows.dx[r] = shown.lon_pair[i] - shown.lon_pair[j]
        rows.dy[r] = shown.lat_pair[i] - shown.lat_pair[j]
        rows.y_mean[r] = 0.5 * (shown.lat_pair[i] + shown.lat_pair[j])
        rows.du[r] = shown.u_pair[i] - shown.u_pair[j]
        rows.dv[r] = shown.v_pair[i] - shown.v_pair[j]
        rows.u_mean[r] = 0.5 * (shown.u_pair[i] + shown.u_pair[j])
        rows.v_mean[r] = 0.5 * (shown.v_pair[i] + shown.v_pair[j])
        rows.spin1[r], rows.spin2[r] = motion.spin[i], motion.spin[j]
        rows.angle[r] = motion.rotation[i] - motion.rotation[j]


@kernel
def unwrap_ends(rows, count, period):
    """Take the nearest image of the other end in a zonally periodic domain."""
    inverse = 1.0 / period
    for r in range(count):
        rows.dx[r] -= period * np.floor(rows.dx[r] * inverse + 0.5)


@kernel
def bond_forces(rows, count, dt, latlon, earth_radius, youngs, poisson, objective, no_shear, linear_bending):
    """Apply the DEM law to rows 0 ... count - 1.

    Reads the gathered differences; writes forces on the first ends, torques on both ends, stresses, lengths and the new
    shear displacements. ``dt`` is the sub-step, s.
    """
    per_unit = DEGREE * earth_radius if latlon else 1.0
    to_degrees = 1.0 if latlon else 0.0
    shear_on = 0.0 if no_shear else 1.0
    slip_part = 1.0 if objective else 0.0
    for r in range(count):
        rx = rows.dx[r] * (per_unit * fast_cos_latitude(to_degrees * rows.y_mean[r]))
        ry = rows.dy[r] * per_unit
        length = math.sqrt(rx * rx + ry * ry)
        inverse = 1.0 / length
        nx, ny = rx * inverse, ry * inverse
        half = overlap(rows.rest[r], length)
        lever1, lever2 = rows.lever1[r] - half, rows.lever2[r] - half
        width, thickness = bond_section(
            rows.radius_small[r], rows.radius_gap[r], rows.thickness_small[r], rows.thickness_gap[r], half, length
        )
        fn = normal_force(youngs, width, thickness, rows.rest[r], half)
        spins = (rows.radius1[r] - half) * rows.spin1[r] + (rows.radius2[r] - half) * rows.spin2[r]
        du, dv = same_axes(rows.du[r], rows.dv[r], rows.u_mean[r], rows.v_mean[r], rx, rows.convergence[r])
        cx, cy = contact_velocity(du, dv, nx, ny, spins)
        sx, sy = advance_shear(rows.sx[r], rows.sy[r], nx, ny, cx, cy, dt)
        stiffness = shear_on * shear_stiffness(youngs, poisson, width, thickness, rows.rest[r])
        tx, ty = -stiffness * sx, -stiffness * sy
        angle = rows.angle[r] if linear_bending else fast_sin(rows.angle[r])
        bending = bending_torque(youngs, width, thickness, rows.rest[r], angle)
        c = rows.damping[r]
        # The objective damper acts on the slip at the contact, so its force there has a moment about both centres.
        bx = -c * (cx if objective else du)
        by = -c * (cy if objective else dv)
        spin_damping = -c * (rows.spin1[r] - rows.spin2[r])
        lx, ly = tx + slip_part * bx, ty + slip_part * by
        rows.nx[r], rows.ny[r] = nx, ny
        rows.sx[r], rows.sy[r] = sx, sy
        rows.fx[r] = rows.alive[r] * (fn * nx + tx + bx)
        rows.fy[r] = rows.alive[r] * (fn * ny + ty + by)
        rows.torque1[r] = rows.alive[r] * (torque_of(lever1, nx, ny, lx, ly) + bending + spin_damping)
        rows.torque2[r] = rows.alive[r] * (torque_of(lever2, nx, ny, lx, ly) - bending - spin_damping)
        rows.normal_stress[r] = tensile_stress(youngs, rows.rest[r], half, angle, width)
        slip = math.sqrt(sx * sx + sy * sy)
        rows.shear_stress[r] = shear_on * shear_stress_of(youngs, poisson, rows.rest[r], slip)
        rows.length[r] = length
        rows.relative_rotation[r] += (rows.spin1[r] - rows.spin2[r]) * dt


@kernel
def keep_peaks(rows, count):
    """Keep the largest tensile stress (Pa) of each row in this long step; a loop of its own, which vectorises."""
    stress, peak = rows.normal_stress, rows.peak_stress
    for r in range(count):
        peak[r] = stress[r] if stress[r] > peak[r] else peak[r]


@kernel
def sum_over_bonds(rows, fx, fy, torque):
    """Sum forces (N) and torques (N m) over the bonds of each element, in order of slot."""
    slots, count = rows.slot.shape
    fx[:] = 0.0
    fy[:] = 0.0
    torque[:] = 0.0
    for k in range(slots):
        slot, sign, torque_slot = rows.slot[k], rows.sign[k], rows.torque_slot[k]
        for e in range(count):
            fx[e] += sign[e] * rows.fx[slot[e]]
            fy[e] += sign[e] * rows.fy[slot[e]]
            torque[e] += rows.torque[torque_slot[e]]
