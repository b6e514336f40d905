"""Force of a sloping sea surface (equations 4.1)."""

from __future__ import annotations

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY


@kernel
def slope_acceleration(slope_x: float, slope_y: float) -> tuple[float, float]:
    """Acceleration -g grad(eta), m s-2, down the slope of the sea surface (slopes are dimensionless)."""
    return -GRAVITY * slope_x, -GRAVITY * slope_y
