"""Sizes and masses of elements in interactions (equations 1.4)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints


class Sizes(NamedTuple):
    """Radius (m), mass (kg) and area (m2) of each element, own and as bonds see it (constant_interaction_LW)."""

    radius: Floats
    mass: Floats
    bond_radius: Floats
    bond_mass: Floats
    bond_area: Floats


def slice_sizes(sizes: Sizes, rows: slice) -> Sizes:
    """Return the sizes of a block of rows, in the same memory."""
    return Sizes(*(array[rows] for array in sizes))


@kernel
def interaction_radius(area: float, hexagonal: bool, bonded: bool) -> float:
    """Radius (m) of an element: inscribed circle of a hexagon or square, or the disc of an unbonded one."""
    if hexagonal:
        return math.sqrt(area / (2.0 * math.sqrt(3.0)))
    if bonded:
        return 0.5 * math.sqrt(area)
    return math.sqrt(area / math.pi)


@kernel
def rectangle_inertia(mass: float, length: float, width: float) -> float:
    """Moment of inertia (kg m2) of an element of a rigid body about its own centre, by its plan sizes (m)."""
    return mass * (length * length + width * width) / 12.0


@kernel
def disc_inertia(mass: float, radius: float) -> float:
    """Moment of inertia (kg m2) of an element that sub-steps turn: the disc of the reference."""
    return 0.5 * mass * radius * radius


@kernel
def count_sides(sides: int, p: KernelParameters) -> int:
    """Number of sides of an element; where it states none, the number of the packing in the parameters."""
    return sides if sides > 0 else p.max_sides


def interaction_sizes(elements: Elements, p: KernelParameters) -> Sizes:
    """Compute the sizes of all elements; a constant size of 0 is one that is not given."""
    body = elements.body
    constant = p.constant_length * p.constant_width
    # Only what it needs: to hand the whole state to compiled code takes longer than the loop.
    radius, bond_radius, bond_mass, bond_area = _interaction_sizes(
        body.length, body.width, body.thickness, body.mass, body.bond_area, p.constant_size, constant, p.rho_ice,
        body.sides, p.max_sides, p.bonds_on,
    )  # fmt: skip
    return Sizes(radius, body.mass, bond_radius, bond_mass, bond_area)


# Many arguments: six arrays of the state and five values of the parameters. To hand over the whole state takes longer
# than the loop.
@kernel
def _interaction_sizes(
    length: Floats, width: Floats, thickness: Floats, mass: Floats, known_area: Floats, constant_size: bool,
    constant_area: float, rho_ice: float, sides: Ints, usual_sides: int, bonds_on: bool,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """Return radius, and radius, mass and area in bonds; see `riftberg.compiled.kernels` why no named tuple."""
    count = mass.size
    radius, bond_radius = np.empty(count), np.empty(count)
    bond_mass, bond_area = np.empty(count), np.empty(count)
    for e in range(count):
        area = length[e] * width[e]
        hexagonal = (sides[e] if sides[e] > 0 else usual_sides) == 6
        radius[e] = interaction_radius(area, hexagonal, bonds_on)
        # Not yet known where a state is looked at before a model has taken it.
        constant = known_area[e] if known_area[e] > 0.0 else constant_area
        if constant_size and constant > 0.0:
            bond_area[e] = constant
            bond_mass[e] = bond_area[e] * thickness[e] * rho_ice
        else:
            bond_area[e] = area
            bond_mass[e] = mass[e]
        bond_radius[e] = interaction_radius(bond_area[e], hexagonal, True)
    return radius, bond_radius, bond_mass, bond_area
