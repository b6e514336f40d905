"""When a bond breaks (equations 7; paper, equation for the stress criterion), and the strength that it loses before.

Damage is strength lost by the history of stress, after Kachanov (1958) and Rabotnov. The idea is that of continuum damage
mechanics as used for ice (Duddu and Waisman 2012, Krug et al. 2014): a scalar D from 0 (whole) to 1 (nothing left) grows with the
stress that acts on what is left. Here it is written for the strength of a bond instead of the stiffness of a continuum; none of
its constants is calibrated for icebergs.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel

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
