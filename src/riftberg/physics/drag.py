"""Drag of ocean, air and sea ice (equations 4.1; Stern et al. 2017, A1 to A3), and rotational drag of the water.

A drag is ``-c |u - U| (u - U)`` per unit mass; the functions here give c in m-1.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel
from riftberg.constants import (
    AIR_DRAG_SIDE,
    AIR_DRAG_TOP,
    OCEAN_DRAG_BASE,
    OCEAN_DRAG_SIDE,
    RHO_AIR,
    RHO_SEA_ICE,
    RHO_SEAWATER,
    SEA_ICE_DRAG_SIDE,
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
    mass: float, length: float, width: float, side: float, draft_open: float, exposed: float, scale: float
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
    """
    return (
        (RHO_SEAWATER / mass)
        * scale
        * (0.5 * OCEAN_DRAG_SIDE * exposed * side * draft_open + OCEAN_DRAG_BASE * width * length)
    )


@kernel
def air_drag(mass: float, length: float, width: float, side: float, freeboard: float, exposed: float) -> float:
    """``c_a = rho_a / M (0.5 C_av phi W F + C_ah W L)``, m-1; sizes in m, mass in kg."""
    return (RHO_AIR / mass) * (0.5 * AIR_DRAG_SIDE * exposed * side * freeboard + AIR_DRAG_TOP * width * length)


@kernel
def sea_ice_drag(
    mass: float, side: float, ice_thickness: float, exposed: float, ui: float, vi: float, frozen_quirk: bool
) -> float:
    """``c_i = rho_si / M 0.5 C_iv phi W h_i``, m-1; vertical faces only (Q33).

    With ``frozen_quirk`` motionless sea ice exerts no drag (Q36).
    """
    if ice_thickness == 0.0 or (frozen_quirk and abs(ui) + abs(vi) == 0.0):
        return 0.0
    return (RHO_SEA_ICE / mass) * (0.5 * SEA_ICE_DRAG_SIDE * exposed * side * ice_thickness)


@kernel
def spin_drag(inertia: float, radius: float, scale: float) -> float:
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
    """
    return (2.0 * math.pi / 5.0) * RHO_SEAWATER * OCEAN_DRAG_BASE * scale * radius**5 / inertia
