"""Twin of the pressure gradient of equations 4.1."""

from __future__ import annotations

import numpy as np


def acceleration(slope):
    """Minus g times the slope."""
    return -9.8 * np.asarray(slope, dtype=float)
