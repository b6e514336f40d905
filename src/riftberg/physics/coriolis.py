"""Coriolis parameter (equations 2.6)."""

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
