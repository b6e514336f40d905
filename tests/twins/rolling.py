"""Twin of the rolling rules of files 1.11."""

from __future__ import annotations

import numpy as np


def roll(thickness, width, length, scheme, tip, rho):
    """Thickness, width, length after rolling or not."""
    q = rho / 1025.0
    if scheme == 3:
        if max(width, length) >= np.sqrt(0.92 * (q * thickness) ** 2 + 58.32 * q * thickness):
            return thickness, width, length
    else:
        width, length = sorted((width, length))
        if scheme == 1:
            limit = (tip if tip > 0.0 else np.sqrt(6.0 * q * (1.0 - q))) * thickness
        else:
            inside = 6.0 * q * (1.0 - q) * thickness**2 - 72.0 * q * thickness
            limit = np.sqrt(inside) if inside > 0.0 else -1.0
        if limit <= width:
            return thickness, width, length
    return width, *sorted((thickness, length))
