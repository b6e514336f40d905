"""When a bond breaks (equations 7; paper, equation for the stress criterion)."""

from __future__ import annotations

from riftberg.compiled.kernels import kernel


@kernel
def exceeds(
    normal_stress: float, shear_stress: float, normal_strength: float, shear_strength: float, strength: float
) -> bool:
    """Whether either stress (Pa) is above its strength; ``strength`` scales both for this bond (1 = nominal)."""
    return normal_stress > normal_strength * strength or shear_stress > shear_strength * strength
