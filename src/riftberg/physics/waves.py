"""Wave radiation force (equations 4.1; Stern et al. 2017, A4 and A5)."""

from __future__ import annotations

import math

from riftberg.constants import GRAVITY, RHO_SEAWATER, WAVE_RADIATION_MAX
from riftberg.kernels import kernel


@kernel
def wave_acceleration(
    ua: float, va: float, uo: float, vo: float, mass: float, freeboard: float, length: float, width: float
) -> tuple[float, float]:
    """Acceleration by waves, m s-2, along the wind; 0 without wind. Not reduced for interior elements (Q34).

    ``q = |u_a - u_o|^2``, amplitude ``a = 0.5 * 0.02025 q``, wave length ``0.32 q``;
    ``Cr = 0.06 clip((L - L_c) / (L_t - L_c), 0, 1)`` with ``L_c = 0.125 * 0.32 q``, ``L_t = 0.25 * 0.32 q``;
    ``F = 0.5 rho_w / M Cr g a min(a, freeboard) 2 W L / (W + L)``.

    Parameters
    ----------
    ua, va, uo, vo : float
        Wind and ocean current, m s-1.
    mass : float
        Mass of the element, kg.
    freeboard, length, width : float
        Metres.
    """
    wind = math.sqrt(ua * ua + va * va)
    if wind == 0.0:
        return 0.0, 0.0
    q = (ua - uo) ** 2 + (va - vo) ** 2
    amplitude = 0.5 * 0.02025 * q
    wave_length = 0.32 * q
    cutoff = 0.125 * wave_length
    top = 0.25 * wave_length
    ramp = (length - cutoff) / ((top - cutoff) + 1e-30)
    coefficient = WAVE_RADIATION_MAX * min(max(0.0, ramp), 1.0)
    force = 0.5 * (RHO_SEAWATER / mass) * coefficient * GRAVITY * amplitude * min(amplitude, freeboard)
    force *= (2.0 * width * length) / (width + length)
    return force * ua / wind, force * va / wind
