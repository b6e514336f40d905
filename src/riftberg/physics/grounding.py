"""Drag of the sea floor (equations 4.1, 6.4; paper, methods)."""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel


@kernel
def grounded_fraction(depth: float, draft: float, ramp_height: float) -> float:
    """How far an element is aground, 0 to 1: ``clip(1 - (depth - draft) / h_g, 0, 1)``, or a step if h_g = 0.

    Parameters
    ----------
    depth, draft : float
        Depth of water and of the keel, m.
    ramp_height : float
        Clearance over which the drag sets in, m.
    """
    if ramp_height > 0.0:
        return min(max(1.0 - (depth - draft) / ramp_height, 0.0), 1.0)
    return 1.0 if draft > depth else 0.0


@kernel
def grounding_rate(coefficient: float, area: float, mass: float, fraction: float) -> float:
    """Rate (s-1) at which the sea floor slows an element: ``c_g A chi / m``. Linear in velocity."""
    return coefficient * area * fraction / mass


@kernel
def quadratic_grounding(coefficient: float, area: float, mass: float, excess: float) -> float:
    """Coefficient (m-1) of the quadratic grounding drag: ``k_g A (D - d) / m``, so that the force is ``-k_g A (D - d) |u| u``.

    A keel that is pressed into the floor by more of its draft ploughs more of it aside, as a dense fluid.

    Parameters
    ----------
    coefficient : float
        ``k_g``, kg m-4.
    area, mass : float
        Base (m2) and mass (kg) of the element.
    excess : float
        Draft in excess of the depth of water, ``D - d``, m; nothing acts where it is not positive.
    """
    return coefficient * area * max(excess, 0.0) / mass


@kernel
def grounding_spin_rate(coefficient: float, radius: float, mass: float, fraction: float) -> float:
    """Rate (s-1) at which the sea floor slows rotation in the reference: ``c_g chi pi R^2 / m`` (equations 6.4, 3c)."""
    return coefficient * fraction * math.pi * radius * radius / mass
