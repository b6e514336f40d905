"""Twin of the drag coefficients of equations 4.1, and of Riftberg's rotational drag by summing rings of the base."""

from __future__ import annotations

import numpy as np

RHO_WATER, RHO_AIR, RHO_SEA_ICE = 1025.0, 1.1, 916.7


def draft(thickness, rho_ice):
    """Archimedes."""
    return rho_ice / RHO_WATER * thickness


def exposed(bond_count, max_sides, by_bonds):
    """Sides without a bond over all sides."""
    return (max_sides - bond_count) / max_sides if by_bonds else 1.0


def side(length, width, by_radius):
    """Width of the side face: that of the element, or the diameter of the hexagon's inscribed circle."""
    return 2 * np.sqrt(length * width / (2 * np.sqrt(3))) if by_radius else width


def face_and_base(density, mass, coefficients, face_area, base_area):
    """Quadratic drag of a vertical face and a horizontal base, per mass."""
    face_drag, base_drag = coefficients
    return density * (0.5 * face_drag * face_area + base_drag * base_area) / mass


def ocean(mass, length, width, side_width, draft_open, exposed_part, scale, on_side, on_base):
    """Ocean drag, m-1."""
    face = exposed_part * side_width * draft_open
    return scale * face_and_base(RHO_WATER, mass, (on_side, on_base), face, width * length)


def air(mass, length, width, side_width, freeboard, exposed_part, on_side, on_top):
    """Air drag, m-1."""
    return face_and_base(RHO_AIR, mass, (on_side, on_top), exposed_part * side_width * freeboard, width * length)


def sea_ice(mass, side_width, ice_thickness, exposed_part, ui, vi, frozen_quirk, on_side):
    """Sea-ice drag, m-1: no base term; nothing from motionless ice where the quirk is kept."""
    if ice_thickness == 0 or (frozen_quirk and abs(ui) + abs(vi) == 0):
        return 0.0
    return face_and_base(RHO_SEA_ICE, mass, (on_side, 0.0), exposed_part * side_width * ice_thickness, 0.0)


def spin(inertia, radius, scale, on_base):
    """Torque of the base drag at unit spin over the inertia: rings of width dr at lever r, Gauss-Legendre in r."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    r = radius * (nodes + 1) / 2
    dr = radius * weights / 2
    stress = RHO_WATER * on_base * scale * (1.0 * r) ** 2
    return np.sum(stress * r * 2 * np.pi * r * dr) / inertia


def side_spin(inertia, length, width, draft, scale, on_side):
    """Torque on the four sides of a rectangle at unit spin over the inertia: panels of pairs of sides, each pair once."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    torque = 0.0
    for side in (length, width):
        x = side / 2 * (nodes + 1) / 2
        pressure = 0.5 * RHO_WATER * on_side * scale * (1.0 * x) ** 2
        torque += 2 * np.sum(pressure * draft * x * side / 4 * weights)
    return torque / inertia
