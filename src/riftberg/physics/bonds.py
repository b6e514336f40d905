"""DEM bond between two elements: stiffness with damping, when it breaks, and the strength that it loses before.

Equations 5.4 and 7; Wang 2020, Huth et al. 2022. Element 1 is the first of the pair; n points from 2 to 1; forces are those
on element 1. All functions are free of branches where it matters, so that the loop over bonds becomes vector instructions.
``modulus_per_metre`` is ``E / l_0``, Pa m-1, which does not change while a bond holds; t is n turned by 90 degrees to the
left.

Damage is strength lost by the history of stress, after Kachanov (1958) and Rabotnov. The idea is that of continuum damage
mechanics as used for ice (Duddu and Waisman 2012, Krug et al. 2014): a scalar D from 0 (whole) to 1 (nothing left) grows
with the stress that acts on what is left. Here it is written for the strength of a bond instead of the stiffness of a
continuum; none of its constants is calibrated for icebergs.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel


@kernel
def bond_overlap(rest_length: float, length: float) -> float:
    """Half the shortening of the bond, m: ``(l_0 - l) / 2``, positive in compression."""
    return 0.5 * (rest_length - length)


@kernel
def bond_section(
    radius_small: float,
    radius_gap: float,
    thickness_small: float,
    thickness_gap: float,
    half_overlap: float,
    per_length: float,
) -> tuple[float, float]:
    """Width w and thickness H (m) of the bond at the point of contact.

    ``w = 2 (R_m + (R_m - d/2) |R_1 - R_2| / l)``, ``H = T_m + (R_m - d/2) dT / l``: linear between the two centres.
    ``thickness_gap`` is |T_1 - T_2| as in the reference (Q11), or T_other - T_m, which is right.
    ``per_length`` is 1 / l, m-1.
    """
    reach = (radius_small - half_overlap) * per_length
    return 2.0 * (radius_small + reach * radius_gap), thickness_small + reach * thickness_gap


@kernel
def normal_force(modulus_per_metre: float, width: float, thickness: float, half_overlap: float) -> float:
    """Force along n on element 1, N: ``E H (2 d/2) w / l_0``; positive pushes apart."""
    return modulus_per_metre * thickness * 2.0 * half_overlap * width


@kernel
def advance_slip(slip: float, slip_speed: float, dt: float) -> float:
    """Add the slip of this sub-step to the shear displacement along t, m: ``q + dt c.t``.

    The spec turns the vector s into the new tangent, keeps its size, and adds ``dt (c - (c.n) n)``. In the plane a tangent
    is one line, so that what turning leaves is the signed length ``q = s.t``: no root and no division are needed.
    """
    return slip + dt * slip_speed


@kernel
def signed_slip(sx: float, sy: float, nx: float, ny: float) -> float:
    """Shear displacement along t, m: the size of s with the sign of s.t; 0 for a vector along n."""
    along = sy * nx - sx * ny
    size = math.sqrt(sx * sx + sy * sy)
    return size if along > 0.0 else (-size if along < 0.0 else 0.0)


@kernel
def shear_stiffness(modulus_per_metre: float, poisson: float, width: float, thickness: float) -> float:
    """``K_s = w H E / (2 (1 + nu) l_0)``, N m-1; the force on element 1 is -K_s q along t."""
    return modulus_per_metre * width * thickness * (0.5 / (1.0 + poisson))


@kernel
def shear_stress_of(modulus_per_metre: float, poisson: float, slip: float) -> float:
    """Shear stress, Pa, of a beam: the shear force K_s |q| over the section w H; ``slip`` is |q|, m."""
    return modulus_per_metre * (0.5 / (1.0 + poisson)) * slip


@kernel
def bending_torque(modulus_per_metre: float, width: float, thickness: float, angle: float) -> float:
    """Torque on element 1, N m: ``-E w^3 H theta / (12 l_0)``; the opposite acts on element 2."""
    return -modulus_per_metre * width * width * width * thickness * angle * (1.0 / 12.0)


@kernel
def tensile_stress(modulus_per_metre: float, half_overlap: float, angle: float, width: float) -> float:
    """Largest tensile stress, Pa: ``E / l_0 (-2 d/2 + |theta w / 2|)``; bending always adds tension (Q15)."""
    return modulus_per_metre * (-2.0 * half_overlap + abs(angle * width / 2.0))


@kernel
def damping_constant(youngs_modulus: float, poisson: float, damping: float, mass1: float, mass2: float) -> float:
    """``c_d = gamma sqrt(K_d m_1 m_2 / (m_1 + m_2))``, K_d = 2 E / (3 (1 - nu^2)); kg s-1 per metre of thickness (Q12)."""
    stiffness = 2.0 * youngs_modulus / (3.0 * (1.0 - poisson * poisson))
    return damping * math.sqrt(stiffness * mass1 * mass2 / (mass1 + mass2))


@kernel
def along_and_across(x: float, y: float, nx: float, ny: float) -> tuple[float, float]:
    """Parts of a vector along n and along t."""
    return x * nx + y * ny, y * nx - x * ny


@kernel
def slip_speed(across: float, lever_spin: float) -> float:
    """Speed along t (m s-1) with which the two sides slip at the point of contact.

    ``across`` is the part along t of the difference of both velocities, ``lever_spin`` = rho_1 w_1 + rho_2 w_2. Spin moves a
    side along t alone.
    """
    return across - lever_spin


@kernel
def torque_of(lever: float, across: float) -> float:
    """Torque (N m) on an element of a force at the contact, ``-rho (n x F) = -rho F.t``; F acts on element 1, for both ends."""
    return -lever * across


LARGEST_DAMAGE = 1.0 - 1e-6
"""Damage stops here, so that what is left of a strength stays positive."""


@kernel
def exceeds(
    normal_stress: float, shear_stress: float, normal_strength: float, shear_strength: float, strength: float
) -> bool:
    """Whether either stress (Pa) is above its strength; ``strength`` scales both for this bond (1 = nominal)."""
    return normal_stress > normal_strength * strength or shear_stress > shear_strength * strength


@kernel
def stress_ratio(normal_stress: float, shear_stress: float, normal_limit: float, shear_limit: float) -> float:
    """Larger of both stresses (Pa) over its strength (Pa), above 1 where the bond breaks; infinite without any strength."""
    normal = normal_stress / normal_limit if normal_limit > 0.0 else (math.inf if normal_stress > 0.0 else 0.0)
    shear = shear_stress / shear_limit if shear_limit > 0.0 else (math.inf if shear_stress > 0.0 else 0.0)
    return normal if normal >= shear else shear


@kernel
def damage_rate(ratio: float, threshold: float, time_scale: float, exponent: float) -> float:
    """``dD/dt = <(r / (1 - D) - r0) / (1 - r0)>^m / tau``, s-1, with ``<x>`` = max(0, x).

    Parameters
    ----------
    ratio : float
        ``r / (1 - D)``: stress over the strength that is left. From 1 on, where the bond breaks, the rate is ``1 / tau``.
    threshold : float
        ``r0`` in [0, 1), below which nothing happens.
    time_scale : float
        ``tau``, s.
    exponent : float
        ``m`` > 0.
    """
    over = (ratio - threshold) / (1.0 - threshold)
    if not over > 0.0:
        return 0.0
    return (over**exponent if over < 1.0 else 1.0) / time_scale


@kernel
def grown_damage(damage: float, rate: float, dt: float) -> float:
    """Damage after ``dt`` seconds (explicit Euler): never less than before, and never as much as 1."""
    return max(damage, min(damage + dt * rate, LARGEST_DAMAGE))


@kernel
def residual_strength(
    normal_strength: float, shear_strength: float, strength: float, damage: float
) -> tuple[float, float]:
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)


@kernel
def principal(xx: float, yy: float, xy: float) -> tuple[float, float]:
    """Largest tensile and largest shear stress (Pa) over all directions, of a plane stress tensor.

    ``tau = sqrt(((xx - yy) / 2)^2 + xy^2)``, ``sigma = (xx + yy) / 2 + tau``.
    """
    shear = math.sqrt((0.5 * (xx - yy)) ** 2 + xy * xy)
    return 0.5 * (xx + yy) + shear, shear
