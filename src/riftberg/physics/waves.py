"""Forces of the sea surface: wave radiation (equations 4.1; Stern et al. 2017, A4 and A5) and the slope (equations 4.1)."""

from __future__ import annotations

import math
from typing import NamedTuple

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY, RHO_SEAWATER, WAVE_RADIATION_MAX


class Waves(NamedTuple):
    """Given waves at an element.

    Significant height (m; negative: none are given), mean period (s; 0: not known), and the eastward and northward part of
    the direction in which they travel, together of any length.
    """

    height: float
    period: float
    x: float
    y: float


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
    push = radiation(amplitude, 0.32 * q, mass, freeboard, length, width)
    return push * ua / wind, push * va / wind


@kernel
def given_wave_acceleration(
    waves: Waves, mass: float, freeboard: float, length: float, width: float
) -> tuple[float, float]:
    """Acceleration by waves that are given, m s-2, along their own direction; 0 without a height or a direction.

    The published amplitude is half of the significant height of a wind sea, ``H_s = 0.02025 q``, so that given waves have
    ``a = H_s / 2``. Their length is that of deep water, ``g T^2 / (2 pi)``; without a period that of a wind sea as high,
    ``0.32 q = (0.32 / 0.02025) H_s``.
    """
    size = math.sqrt(waves.x * waves.x + waves.y * waves.y)
    if size == 0.0 or waves.height == 0.0:
        return 0.0, 0.0
    wave_length = 0.32 / 0.02025 * waves.height
    if waves.period > 0.0:
        wave_length = GRAVITY * waves.period * waves.period / (2.0 * math.pi)
    push = radiation(0.5 * waves.height, wave_length, mass, freeboard, length, width)
    return push * waves.x / size, push * waves.y / size


@kernel
def radiation(
    amplitude: float, wave_length: float, mass: float, freeboard: float, length: float, width: float
) -> float:
    """Acceleration (m s-2) by waves of an amplitude and a length (m)."""
    cutoff = 0.125 * wave_length
    top = 0.25 * wave_length
    ramp = (length - cutoff) / ((top - cutoff) + 1e-30)
    coefficient = WAVE_RADIATION_MAX * min(max(0.0, ramp), 1.0)
    force = 0.5 * (RHO_SEAWATER / mass) * coefficient * GRAVITY * amplitude * min(amplitude, freeboard)
    return force * ((2.0 * width * length) / (width + length))


@kernel
def slope_acceleration(slope_x: float, slope_y: float) -> tuple[float, float]:
    """Acceleration -g grad(eta), m s-2, down the slope of the sea surface (slopes are dimensionless)."""
    return -GRAVITY * slope_x, -GRAVITY * slope_y
