"""What water, air, sea ice and waves do to ice: drag, rotational drag, wave radiation and the slope of the sea surface.

Equations 4.1; Stern et al. 2017, A1 to A5. A drag is ``-c |u - U| (u - U)`` per unit mass; its functions give c in m-1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from riftberg.compiled.kernels import kernel
from riftberg.constants import (
    GRAVITY,
    RHO_AIR,
    RHO_SEA_ICE,
    RHO_SEAWATER,
    WAVE_RADIATION_MAX,
)


@kernel
def exposed_sides(bond_count: int, max_sides: int, by_bonds: bool) -> float:
    """Fraction of the sides of an element that no bond covers; 1 if drag is not reduced by bonds."""
    return (max_sides - bond_count) / max_sides if by_bonds else 1.0


@kernel
def side_width(length: float, width: float, by_radius: bool) -> float:
    """Width (m) of the side face that drag sees: W, or the diameter of a hexagon (option radius_based)."""
    return 2.0 * math.sqrt(length * width / (2.0 * math.sqrt(3.0))) if by_radius else width


@kernel
def ocean_drag(
    mass: float,
    length: float,
    width: float,
    side: float,
    draft_open: float,
    exposed: float,
    scale: float,
    on_side: float,
    on_base: float,
) -> float:
    """``c_o = rho_w / M s_o (0.5 C_wv phi W D_h + C_wh W L)``, m-1.

    Parameters
    ----------
    mass : float
        kg.
    length, width, side : float
        Plan sizes and width of the side face, m.
    draft_open : float
        Draft below the sea ice, m.
    exposed : float
        Fraction of sides without bonds.
    scale : float
        Factor on both coefficients.
    on_side, on_base : float
        Coefficients C_wv of the sides and C_wh of the base.
    """
    return (RHO_SEAWATER / mass) * scale * (0.5 * on_side * exposed * side * draft_open + on_base * width * length)


@kernel
def outline_drag(draft_open: float, scale: float, on_side: float) -> float:
    """``0.25 rho_w C_wv s_o D``, kg m-2: drag of the water on the outline of a berg, by length of it and (normal speed)^2.

    C_wv is of the section across the flow: the pressure on the face that looks into it and the suction behind the one that looks
    away are both in it. So each of these two faces bears half, and a square broadside on has ``0.5 rho_w C_wv D W u^2``.
    ``draft_open``: draft D below the sea ice, m; ``scale``: factor s_o; ``on_side``: coefficient C_wv.
    """
    return 0.25 * RHO_SEAWATER * on_side * scale * draft_open


@kernel
def air_drag(
    mass: float,
    length: float,
    width: float,
    side: float,
    freeboard: float,
    exposed: float,
    on_side: float,
    on_top: float,
) -> float:
    """``c_a = rho_a / M (0.5 C_av phi W F + C_ah W L)``, m-1; sizes in m, mass in kg, ``on_side`` C_av, ``on_top`` C_ah."""
    return (RHO_AIR / mass) * (0.5 * on_side * exposed * side * freeboard + on_top * width * length)


@kernel
def sea_ice_drag(
    mass: float,
    side: float,
    ice_thickness: float,
    exposed: float,
    ui: float,
    vi: float,
    frozen_quirk: bool,
    on_side: float,
) -> float:
    """``c_i = rho_si / M 0.5 C_iv phi W h_i``, m-1, with ``on_side`` C_iv; vertical faces only (Q33).

    With ``frozen_quirk`` motionless sea ice exerts no drag (Q36).
    """
    if ice_thickness == 0.0 or (frozen_quirk and abs(ui) + abs(vi) == 0.0):
        return 0.0
    return (RHO_SEA_ICE / mass) * (0.5 * on_side * exposed * side * ice_thickness)


@kernel
def spin_drag(inertia: float, radius: float, scale: float, on_base: float) -> float:
    """Rotational drag of the water under a disc, rad-1: the spin changes at -c |w - z/2| (w - z/2).

    A disc that turns at w relative to the water below (whose rotation is half its vorticity z) moves at ``w r`` at
    radius r; the base drag ``rho_w C_wh s_o (w r)^2`` times the lever r, integrated over the disc, is
    ``(2 pi / 5) rho_w C_wh s_o R^5 w^2``. The reference has no such term.

    Parameters
    ----------
    inertia : float
        Moment of inertia, kg m2.
    radius : float
        Radius of the disc, m.
    scale : float
        Factor on the ocean drag coefficient.
    on_base : float
        Coefficient C_wh of the base.
    """
    return (2.0 * math.pi / 5.0) * RHO_SEAWATER * on_base * scale * radius**5 / inertia


@kernel
def side_spin_drag(
    inertia: float, length: float, width: float, draft_open: float, scale: float, on_side: float
) -> float:
    """Rotational drag of the water on the sides of a rectangle, rad-1; it adds to `spin_drag`.

    A side of length L that turns about its middle at w relative to the water meets it at ``w x``; the drag
    ``0.5 rho_w C_wv s_o D (w x)^2`` times the lever x, integrated over both halves, is ``rho_w C_wv s_o D L^4 w^2 / 64``.
    Each pair of opposite sides counts once, as in `outline_drag`, which bonded elements have in its place. The reference has no
    such term.

    Parameters
    ----------
    inertia : float
        Moment of inertia, kg m2.
    length, width : float
        Plan sizes, m.
    draft_open : float
        Draft D below the sea ice, m.
    scale : float
        Factor s_o on the ocean drag coefficients.
    on_side : float
        Coefficient C_wv of the sides.
    """
    return RHO_SEAWATER * on_side * scale * draft_open * (length**4 + width**4) / (64.0 * inertia)


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
