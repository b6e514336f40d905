"""Strength over a distance: stress averaged over a disc, and what the toughness of the ice says of it.

At the tip of a crack the stress grows without bound, so in a lattice it grows with the resolution and a strength that is
tested bond by bond breaks finer lattices sooner. The theory of critical distances (Taylor 2007, *The Theory of Critical
Distances*, chapter 2) tests the mean over a length ``l`` ahead of the tip instead. With ``sigma = K / sqrt(2 pi r)``

    mean over l = K sqrt(2 / (pi l)),    so that    K_Ic = sigma_c sqrt(pi l / 2)

Here the mean is over a disc, which needs no direction of the crack. Its weight is ``1 - (r / R)^2``, and R is chosen so
that its mean is that over ``l``: ``R = (pi / 2) DISC^2 l``, about half of ``l``.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel

DISC = 0.5604
"""Largest principal stress averaged over a disc near the tip of a crack in mode I, as a multiple of ``K / sqrt(R)``.

The integral of the field of the tip (Williams 1957) over the disc, at the place ahead of the tip where it is largest."""

LEAST_SPACINGS = 1.75
"""Smallest radius of the disc in spacings of the lattice: with fewer elements a mean says little."""


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
