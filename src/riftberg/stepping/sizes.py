"""Sizes and masses of elements in interactions (equations 1.4)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats


class Sizes(NamedTuple):
    """Radius (m), mass (kg) and area (m2) of each element, own and as bonds see it (constant_interaction_LW)."""

    radius: Floats
    mass: Floats
    bond_radius: Floats
    bond_mass: Floats
    bond_area: Floats


@kernel
def radius_of(area: float, hexagonal: bool, bonded: bool) -> float:
    """Radius (m) of an element: inscribed circle of a hexagon or square, or the disc of an unbonded one."""
    if hexagonal:
        return math.sqrt(area / (2.0 * math.sqrt(3.0)))
    if bonded:
        return 0.5 * math.sqrt(area)
    return math.sqrt(area / math.pi)


@kernel
def sides_of(sides: int, p: KernelParameters) -> int:
    """Sides of an element; where it does not say, those of the packing that the parameters name."""
    return sides if sides > 0 else p.max_sides


def interaction_sizes(elements: Elements, p: KernelParameters) -> Sizes:
    """Compute the sizes of all elements; a constant size of 0 is one that is not given."""
    radius, bond_radius, bond_mass, bond_area = _interaction_sizes(elements, p)
    return Sizes(radius, elements.body.mass, bond_radius, bond_mass, bond_area)


@kernel
def _interaction_sizes(elements: Elements, p: KernelParameters) -> tuple[Floats, Floats, Floats, Floats]:
    """Return radius, and radius, mass and area in bonds; see `riftberg.kernels` why no named tuple."""
    body = elements.body
    count = body.mass.size
    radius, bond_radius = np.empty(count), np.empty(count)
    bond_mass, bond_area = np.empty(count), np.empty(count)
    for e in range(count):
        area = body.length[e] * body.width[e]
        hexagonal = sides_of(body.sides[e], p) == 6
        radius[e] = radius_of(area, hexagonal, p.bonds_on)
        # Not yet known where a state is looked at before a model has taken it.
        constant = body.bond_area[e] if body.bond_area[e] > 0.0 else p.constant_length * p.constant_width
        if p.constant_size and constant > 0.0:
            bond_area[e] = constant
            bond_mass[e] = bond_area[e] * body.thickness[e] * p.rho_ice
        else:
            bond_area[e] = area
            bond_mass[e] = body.mass[e]
        bond_radius[e] = radius_of(bond_area[e], hexagonal, True)
    return radius, bond_radius, bond_mass, bond_area
