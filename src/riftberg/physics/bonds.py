"""DEM bond between two elements: normal, shear and bending stiffness with damping (equations 5.4; Wang 2020, Huth et al. 2022).

Element 1 is the first of the pair; n points from 2 to 1; forces are those on element 1. All functions are free of
branches where it matters, so that the loop over bonds becomes vector instructions. ``E / l_0`` stands first in each
formula, so that the compiler divides once for all of them.
"""

from __future__ import annotations

import math

from riftberg.kernels import kernel


@kernel
def overlap(rest_length: float, length: float) -> float:
    """Half the shortening of the bond, m: ``(l_0 - l) / 2``, positive in compression."""
    return 0.5 * (rest_length - length)


@kernel
def bond_section(
    radius_small: float,
    radius_gap: float,
    thickness_small: float,
    thickness_gap: float,
    half_overlap: float,
    length: float,
) -> tuple[float, float]:
    """Width w and thickness H (m) of the bond at the point of contact.

    ``w = 2 (R_m + (R_m - d/2) |R_1 - R_2| / l)``, ``H = T_m + (R_m - d/2) dT / l``: linear between the two centres.
    ``thickness_gap`` is |T_1 - T_2| as in the reference (Q11), or T_other - T_m, which is right.
    """
    reach = (radius_small - half_overlap) / length
    return 2.0 * (radius_small + reach * radius_gap), thickness_small + reach * thickness_gap


@kernel
def normal_force(
    youngs_modulus: float, width: float, thickness: float, rest_length: float, half_overlap: float
) -> float:
    """Force along n on element 1, N: ``E H (2 d/2) w / l_0``; positive pushes apart."""
    return (youngs_modulus / rest_length) * thickness * 2.0 * half_overlap * width


@kernel
def advance_shear(sx: float, sy: float, nx: float, ny: float, cx: float, cy: float, dt: float) -> tuple[float, float]:
    """Turn the shear displacement (m) into the new tangent, keep its size, and add the slip of this sub-step.

    ``s' = s - (s.n) n`` rescaled to |s|; ``s = s' + dt (c - (c.n) n)`` with the contact velocity c (m s-1).
    """
    along = sx * nx + sy * ny
    tx = sx - along * nx
    ty = sy - along * ny
    projected = tx * tx + ty * ty
    ratio = math.sqrt((sx * sx + sy * sy) / (projected if projected > 0.0 else 1.0))
    ratio = ratio if projected > 0.0 else 0.0
    slip = cx * nx + cy * ny
    return tx * ratio + dt * (cx - slip * nx), ty * ratio + dt * (cy - slip * ny)


@kernel
def shear_stiffness(youngs_modulus: float, poisson: float, width: float, thickness: float, rest_length: float) -> float:
    """``K_s = w H E / (l_0 2 (1 + nu))``, N m-1; the shear force on element 1 is -K_s s."""
    return (youngs_modulus / rest_length) * width * thickness * (0.5 / (1.0 + poisson))


@kernel
def shear_stress_of(youngs_modulus: float, poisson: float, rest_length: float, slip: float) -> float:
    """Shear stress, Pa: the shear force K_s |s| over the section w H; ``slip`` is |s|, m."""
    return (youngs_modulus / rest_length) * (0.5 / (1.0 + poisson)) * slip


@kernel
def bending_torque(youngs_modulus: float, width: float, thickness: float, rest_length: float, angle: float) -> float:
    """Torque on element 1, N m: ``-E w^3 H theta / (12 l_0)``; the opposite acts on element 2."""
    return -(youngs_modulus / rest_length) * width * width * width * thickness * angle * (1.0 / 12.0)


@kernel
def tensile_stress(youngs_modulus: float, rest_length: float, half_overlap: float, angle: float, width: float) -> float:
    """Largest tensile stress, Pa: ``E / l_0 (-2 d/2 + |theta w / 2|)``; bending always adds tension (Q15)."""
    return (youngs_modulus / rest_length) * (-2.0 * half_overlap + abs(angle * width / 2.0))


@kernel
def damping_constant(youngs_modulus: float, poisson: float, damping: float, mass1: float, mass2: float) -> float:
    """``c_d = gamma sqrt(K_d m_1 m_2 / (m_1 + m_2))``, K_d = 2 E / (3 (1 - nu^2)); kg s-1 per metre of thickness (Q12)."""
    stiffness = 2.0 * youngs_modulus / (3.0 * (1.0 - poisson * poisson))
    return damping * math.sqrt(stiffness * mass1 * mass2 / (mass1 + mass2))


@kernel
def contact_velocity(du: float, dv: float, nx: float, ny: float, lever_spin: float) -> tuple[float, float]:
    """Relative velocity (m s-1) of the two sides at the point of contact; ``lever_spin`` = rho_1 w_1 + rho_2 w_2."""
    return du + lever_spin * ny, dv - lever_spin * nx


@kernel
def torque_of(lever: float, nx: float, ny: float, fx: float, fy: float) -> float:
    """Torque (N m) on an element of a force at the contact, ``-rho (n x F)``; F is the force on element 1 for both ends."""
    return -lever * (nx * fy - ny * fx)
