"""Bending of floating ice at its edges, by closed forms of a beam on water: reported, not a criterion.

With ``lambda = (4 D / k)^(1/4)``, ``D = E H^3 / 12 (1 - nu^2)``, ``k = rho_w g``, ``y`` the distance from the edge over lambda,
and ``q = rho_i / rho_w``:

- The water presses on a **front** less than the weight of its ice, and deeper: a moment at the edge,
  ``M_0 = -rho_i g H^3 [1/6 - q (1/2 - q/3)] / 2``, which is above zero and has the top in tension; inland
  ``M = M_0 e^-y (cos y + sin y)`` (Reeh 1968).
- A **foot** that juts out by ``f`` below the water lifts the edge by ``V = (rho_w - rho_i) g q H f`` at ``f / 2`` before it:
  ``M = -e^-y [V lambda sin y + V f / 2 (cos y + sin y)]`` has the base in tension.

Strips have two edges; their moment is that of a beam of their width. Convex corners raise it by factors of a plate, measured
by finite elements. The stress is ``6 M / H^2``, beside the pre-stress and what the loads in the plane add. Cold surfaces can
turn the sign of the moment of a front (Buck 2024).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.constants import GRAVITY, RHO_SEAWATER
from riftberg.physics.seabed import POISSON, bending_length

CORNERS: Final = (30.0, 45.0, 60.0, 90.0, 180.0, 270.0)
"""Angles of the ice at a corner, degrees."""

FRONT_AT_CORNER: Final = (0.0, 0.0, 10.0, 5.0, 0.0, 0.0)
FOOT_AT_CORNER: Final = (120.0, 60.0, 40.0, 15.0, 0.0, 6.0)
"""Percent by which the largest moment at a corner exceeds the moment of a straight edge."""

WIDE: Final = 12.0
"""Width of a strip in lambda from which on its edges do not feel each other."""


def flexural_length(youngs: float, thickness: float) -> float:
    """Return lambda (m) of ice with a Young's modulus (Pa) and a thickness (m): 1273 m for 9 GPa and 200 m."""
    return math.sqrt(2.0) * bending_length(youngs, POISSON, thickness)


def front_moment(thickness: float, rho_ice: float) -> float:
    """Return ``M_0`` of a front, N: 6.25e8 for 200 m (thickness, m) and 850 kg m-3; the top is in tension."""
    q = rho_ice / RHO_SEAWATER
    return -0.5 * rho_ice * GRAVITY * thickness**3 * (1.0 / 6.0 - q * (0.5 - q / 3.0))


def foot_moment(
    foot: float, thickness: float, rho_ice: float, length: float, width: float = math.inf
) -> tuple[float, float]:
    """Return the largest moment (N, base in tension) that feet on both sides of a strip make, and how far inland (m) it is.

    Parameters
    ----------
    foot : float
        How far the feet jut out, m.
    thickness : float
        m.
    rho_ice : float
        kg m-3.
    length : float
        `flexural_length`, m.
    width : float
        Of the strip, m.
    """
    lift = (RHO_SEAWATER - rho_ice) * GRAVITY * rho_ice / RHO_SEAWATER * thickness * foot
    half = 0.5 * min(width / length, WIDE)
    # M = P sinh y sin y + Q cosh y cos y about the middle; at the edges the couple and, as its slope, the lift.
    s, c, sh, ch = math.sin(half), math.cos(half), math.sinh(half), math.cosh(half)
    edges = np.array([[sh * s, ch * c], [ch * s + sh * c, sh * c - ch * s]])
    p, q = np.linalg.solve(edges, [0.5 * lift * foot, -lift * length])
    y = np.linspace(0.0, half, 601)
    moment = p * np.sinh(y) * np.sin(y) + q * np.cosh(y) * np.cos(y)
    largest = int(moment.argmax())
    return float(moment[largest]), float((half - y[largest]) * length)


def corner_factor(excess: tuple[float, ...], angle: float) -> float:
    """Return the moment at a corner over the moment of a straight edge; ``angle`` of the ice, degrees."""
    return 1.0 + float(np.interp(angle, CORNERS, excess)) / 100.0


def surface_stress(moment: float, thickness: float) -> float:
    """Return the tension (Pa) that a moment (N) makes at a surface: ``6 M / H^2``."""
    return 6.0 * moment / thickness**2
