"""The Coriolis parameter (equations 2.6), and the semi-implicit velocity equation of one element (equations 4.2, 4.3).

Unknown is the acceleration A with U_new = u* + dt A. Drag and damping are taken implicitly at the new velocity, half of
the Coriolis force explicitly and half implicitly.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE, EARTH_ROTATION


@kernel
def coriolis_parameter(latitude: float, latlon: bool, f_plane: bool, reference_latitude: float) -> float:
    """Return f = 2 Omega sin(latitude), s-1; of the reference latitude on an f-plane or a Cartesian grid.

    Parameters
    ----------
    latitude, reference_latitude : float
        Degrees.
    """
    phi = latitude if latlon and not f_plane else reference_latitude
    return 2.0 * EARTH_ROTATION * math.sin(phi * DEGREE)


@kernel
def mean_speed(u1: float, v1: float, u0: float, v0: float, uk: float, vk: float) -> float:
    """Half the sum of the speeds relative to a medium (uk, vk) of the current iterate and of the start, m s-1."""
    return 0.5 * (
        math.sqrt((u1 - uk) * (u1 - uk) + (v1 - vk) * (v1 - vk))
        + math.sqrt((u0 - uk) * (u0 - uk) + (v0 - vk) * (v0 - vk))
    )


@kernel
def solve_two_by_two(a11: float, a12: float, a21: float, a22: float, rx: float, ry: float) -> tuple[float, float]:
    """Solve a 2 x 2 system by Cramer's rule."""
    inverse = 1.0 / (a11 * a22 - a12 * a21)
    return inverse * (a22 * rx - a12 * ry), inverse * (a11 * ry - a21 * rx)
