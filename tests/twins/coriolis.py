"""Twin of equations 2.6."""

from __future__ import annotations

import numpy as np


def parameter(latitude, latlon, f_plane, reference_latitude):
    """Twice the vertical part of the rotation vector of the Earth."""
    used = latitude if latlon and not f_plane else reference_latitude
    return 2 * 7.292e-5 * np.sin(np.radians(used))
