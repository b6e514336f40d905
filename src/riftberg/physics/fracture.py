"""When a bond breaks (equations 7; paper, equation for the stress criterion), and the strength that it loses before.

At the tip of a crack the stress grows without bound, so in a lattice it grows with the resolution and a strength that is
tested bond by bond breaks finer lattices sooner. The theory of critical distances (Taylor 2007, *The Theory of Critical
Distances*, chapter 2) tests the mean over a length ``l`` ahead of the tip instead. With ``sigma = K / sqrt(2 pi r)``

    mean over l = K sqrt(2 / (pi l)),    so that    K_Ic = sigma_c sqrt(pi l / 2)

Here the mean is over a disc, which needs no direction of the crack. Its weight is ``1 - (r / R)^2``, and R is chosen so
that its mean is that over ``l``: ``R = (pi / 2) DISC^2 l``, about half of ``l``.

Damage is strength lost by the history of stress, after Kachanov (1958) and Rabotnov. The idea is that of continuum damage
mechanics as used for ice (Duddu and Waisman 2012, Krug et al. 2014): a scalar D from 0 (whole) to 1 (nothing left) grows with the
stress that acts on what is left. Here it is written for the strength of a bond instead of the stiffness of a continuum; none of
its constants is calibrated for icebergs.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel

DISC = 0.5604
"""Largest principal stress averaged over a disc near the tip of a crack in mode I, as a multiple of ``K / sqrt(R)``.

The integral of the field of the tip (Williams 1957) over the disc, at the place ahead of the tip where it is largest."""

LEAST_SPACINGS = 1.75
"""Smallest radius of the disc in spacings of the lattice: with fewer elements a mean says little."""

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
def disc_weight(distance: float, radius: float) -> float:
    """Weight of an element at a distance (m) from the middle of the disc: ``1 - (r / R)^2``, 0 outside."""
    return max(0.0, 1.0 - (distance / radius) ** 2)


@kernel
def principal(xx: float, yy: float, xy: float) -> tuple[float, float]:
    """Largest tensile and largest shear stress (Pa) over all directions, of a plane stress tensor.

    ``tau = sqrt(((xx - yy) / 2)^2 + xy^2)``, ``sigma = (xx + yy) / 2 + tau``.
    """
    shear = math.sqrt((0.5 * (xx - yy)) ** 2 + xy * xy)
    return 0.5 * (xx + yy) + shear, shear


def disc_radius(distance: float) -> float:
    """Radius (m) of the disc whose mean at a crack is that over ``distance`` (m) ahead of it."""
    return 0.5 * math.pi * DISC**2 * distance


def critical_toughness(distance: float, strength: float) -> float:
    """Toughness K_Ic (Pa m^(1/2)) that a strength (Pa) over a distance (m) amounts to: ``sigma_c sqrt(pi l / 2)``."""
    return strength * math.sqrt(0.5 * math.pi * distance)


def disc_of_lattice(distance: float, spacing: float) -> tuple[float, float]:
    """Radius (m) of the disc on a lattice, and the factor on the strength there.

    A lattice whose elements are wider than the distance cannot resolve it. The disc is then as small as the lattice
    allows, and the strength lower, so that the toughness is the same: cracks run at the right load, and ice without
    cracks breaks as if it held one of the size of its elements.

    Parameters
    ----------
    distance : float
        Characteristic distance, m.
    spacing : float
        Distance of neighbouring elements, m.
    """
    wanted = disc_radius(distance)
    radius = max(wanted, LEAST_SPACINGS * spacing)
    return radius, math.sqrt(wanted / radius)
