"""Twin of the stress criterion of equations 7."""

from __future__ import annotations


def breaks(normal_stress, shear_stress, normal_strength, shear_strength, strength):
    """Strictly above either strength."""
    return normal_stress > strength * normal_strength or shear_stress > strength * shear_strength
