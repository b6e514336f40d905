"""Twin of the grounding drag of equations 4.1, 6.4 (3b) and the rotational one of 6.4 (3c)."""

from __future__ import annotations

import numpy as np


def fraction(depth, draft, ramp_height):
    """Part of the grounding drag that acts."""
    if ramp_height > 0:
        return float(np.interp(depth - draft, [0.0, ramp_height], [1.0, 0.0]))
    return 1.0 if draft > depth else 0.0


def rate(coefficient, area, mass, chi):
    """Linear drag rate, s-1."""
    return 0.0 if chi == 0 else coefficient * chi * area / mass


def quadratic(coefficient, area, mass, depth, draft):
    """Coefficient of the quadratic drag, m-1: nothing while the keel is clear of the floor."""
    return coefficient * area * (draft - depth) / mass if draft > depth else 0.0


def spin_rate(coefficient, radius, mass, chi):
    """Rotational drag rate, s-1: the disc's area instead of the element's."""
    return rate(coefficient, np.pi * radius**2, mass, chi)
