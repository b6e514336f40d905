"""Physical constants of the reference model, each with its source.

Sources are sections of docs/explanation/equations.md ("equations 0.1");
the numbers are those of KID/iKID so that parity runs agree to round-off.
"""

from __future__ import annotations

import math
from typing import Final

PI: Final = 3.14159265358979323846
DEGREE: Final = math.pi / 180.0
"""One degree in radians."""

EARTH_ROTATION: Final = 7.292e-5
"""Rotation rate of the Earth, s-1 (equations 0.1)."""

GRAVITY: Final = 9.8
"""Acceleration of gravity, m s-2 (equations 0.1)."""

RHO_SEAWATER: Final = 1025.0
"""Density of sea water, kg m-3 (equations 0.1)."""

RHO_AIR: Final = 1.1
"""Density of air, kg m-3 (equations 0.1)."""

RHO_SEA_ICE: Final = 916.7
"""Density used in the sea-ice drag, kg m-3 (equations 0.1, quirk Q33)."""

OCEAN_DRAG_SIDE: Final = 0.9
"""Ocean drag coefficient of vertical faces, in KID and its experiments (equations 0.1)."""

OCEAN_DRAG_BASE: Final = 0.0012
"""Ocean drag coefficient of the horizontal base, in KID and its experiments (equations 0.1)."""

AIR_DRAG_SIDE: Final = 1.3
"""Air drag coefficient of vertical faces, in KID and its experiments (equations 0.1)."""

AIR_DRAG_TOP: Final = 0.0055
"""Air drag coefficient of the horizontal top, in KID and its experiments (equations 0.1)."""

SEA_ICE_DRAG_SIDE: Final = 0.9
"""Sea-ice drag coefficient of vertical faces, in KID and its experiments (equations 0.1)."""

WAVE_RADIATION_MAX: Final = 0.06
"""Largest wave-radiation coefficient (equations 0.1)."""

STRESS_INVERSION_DRAG: Final = 0.0015
"""Drag coefficient that turns a wind stress into a wind speed (equations 0.1, 3.1)."""

EARTH_RADIUS_KID: Final = 6_360_000.0
"""Default radius of the sphere in KID, m (equations 0.1)."""

EARTH_RADIUS_A68: Final = 6_363_827.0
"""Radius of the sphere in the A68a experiment, m (equations 10.5)."""

SECONDS_PER_DAY: Final = 86_400.0

LATENT_HEAT: Final = 3.335e5
"""Latent heat of fusion, J kg-1, in the law of the base (files, 1.5) and in all budgets of heat."""

LATENT_HEAT_KID: Final = 3.34e5
"""The same in the heat that KID gives to the ocean (files, 0.1 HLF)."""
