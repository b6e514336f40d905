"""Pack ice around a berg: what it can bear, how much of it there is to drag, and the waves that it leaves.

Concentration A, thickness h of the ice (not of the cell) and velocity of the pack are those at the berg. Drag and waves follow
Lichey & Hellmer (2001, J. Glaciol. 47, 452-460); the strength is that of Hibler (1979, J. Phys. Oceanogr. 9, 815-846).
"""

from __future__ import annotations

from riftberg.compiled.kernels import kernel
from riftberg.physics.elementary import exp

NO_CAPTURE, LIMITED, LOCKED, OF_REFERENCE = 0, 1, 2, 3
"""What a pack does beside its drag: nothing, hold a berg by as much as it bears, or carry it along. The last is the law of the
explicit schemes, which knows no concentration."""


@kernel
def pack_depth(thickness: float, fraction: float, least: float) -> float:
    """Mean depth ``h A`` (m) of sea ice beside a berg; 0 below the concentration ``least``, where floes give way.

    ``thickness``: of the ice, m; ``fraction``: concentration A, 0 to 1.
    """
    return thickness * fraction if fraction >= least else 0.0


@kernel
def pack_strength(thickness: float, fraction: float, strength: float, decay: float) -> float:
    """What a pack bears before it is crushed, ``P = P* h exp(-C (1 - A))``, N per metre of front.

    ``strength``: P*, Pa; ``decay``: C; ``thickness``: of the ice, m; ``fraction``: A.
    """
    return strength * thickness * exp(-decay * (1.0 - fraction))


@kernel
def open_share(fraction: float, least: float) -> float:
    """Share ``1 - A`` of the sides that waves reach; 1 below the concentration ``least``."""
    return 1.0 - fraction if fraction >= least else 1.0


@kernel
def yield_rate(limit: float, speed: float, yield_speed: float) -> float:
    """Rate (s-1) of the hold ``min(k |du|, limit)`` of a pack per speed through it, with ``k = limit / yield_speed``.

    ``limit``: largest deceleration, m s-2; ``speed``, ``yield_speed``: m s-1.
    """
    return limit / max(speed, yield_speed)
