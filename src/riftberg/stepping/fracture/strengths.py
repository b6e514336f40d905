"""Breaking in equilibrium: when within a step the first bond fails, and how far a crack runs at once.

Loads change linearly between both ends of a step, and so do extension, slip and bend of each bond; the moment at which
the first bond reaches its strength is found by bisection. There the most overloaded bond breaks, the equilibrium without
it is found, and so on until none is overloaded: a crack that runs does so at one time, under the loads of that time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.averaging import principal
from riftberg.physics.bonds import shear_stress_of, tensile_stress
from riftberg.physics.damage import damage_rate, grown_damage
from riftberg.state import Bonds, Floats, Ints
from riftberg.stepping.lattice.equilibrium import ElasticLattice, bond_deformation

BISECTIONS = 30
"""Halvings of the step in the search for the moment of a break: to a millionth of a second."""


class Strengths(NamedTuple):
    """Tensile and shear stress (Pa) at which the bonds that hold break."""

    normal: Floats
    shear: Floats


def residual_strengths(bonds: Bonds, intact: Ints, p: KernelParameters) -> Strengths:
    """Strengths that the bonds have left."""
    return Strengths(*_residual_strengths(bonds.strength, bonds.damage, intact, p.normal_strength, p.shear_strength))


@kernel
def _residual_strengths(
    strength: Floats, damage: Floats, intact: Ints, normal_strength: float, shear_strength: float
) -> tuple[Floats, Floats]:
    """Return the fields of `Strengths`; see `riftberg.compiled.kernels` why no named tuple."""
    normal, shear = np.empty(intact.size), np.empty(intact.size)
    for k in range(intact.size):
        b = intact[k]
        normal[k], shear[k] = residual_strength(normal_strength, shear_strength, strength[b], damage[b])
    return normal, shear


@kernel
def most_overloaded(stress: Floats, strengths: Strengths) -> tuple[int, float]:
    """Row of the bond whose stress is highest over its strength, and that ratio; above 1 it breaks (-1 without bonds)."""
    most_critical, highest = -1, -np.inf
    for k in range(stress.shape[0]):
        ratio = overload(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
        if ratio > highest:
            most_critical, highest = k, ratio
    return most_critical, highest


@kernel
def overload(normal: float, shear: float, normal_limit: float, shear_limit: float) -> float:
    """Stress over strength; a bond without strength fails under the smallest stress."""
    a = normal / normal_limit if normal_limit > 0.0 else (np.inf if normal > 0.0 else 0.0)
    b = shear / shear_limit if shear_limit > 0.0 else (np.inf if shear > 0.0 else 0.0)
    return a if a >= b else b


@kernel
def _deformation(lattice: ElasticLattice, intact: Ints, displacement: Floats) -> Floats:
    """Extension, slip and bend of the bonds that hold, shape (bonds, 3)."""
    deformation = np.empty((intact.size, 3))
    for k in range(intact.size):
        deformation[k, 0], deformation[k, 1], deformation[k, 2] = bond_deformation(lattice, displacement, intact[k])
    return deformation


@kernel
def first_failure(
    lattice: ElasticLattice, intact: Ints, before: Floats, after: Floats, strengths: Strengths, p: KernelParameters
) -> tuple[int, float]:
    """Row of the bond that fails first between two equilibria, and the part of the step at which it does (1: none).

    ``before``, ``after``: displacements at both ends of the step (shape (elements, 3)).
    """
    one, two = _deformation(lattice, intact, before), _deformation(lattice, intact, after)
    return first_overload(one, two, strengths, False, lattice, intact, p)


@kernel
def first_overload(
    one: Floats,
    two: Floats,
    strengths: Strengths,
    averaged: bool,
    lattice: ElasticLattice,
    intact: Ints,
    p: KernelParameters,
) -> tuple[int, float]:
    """Row of the place that is overloaded first, and the part of the step at which it is (1: none), by bisection.

    ``one``, ``two``: what goes evenly from one end of the step to the other: extension, slip and bend of each bond, or
    an averaged tensor (shape (places, 3)).
    """
    most_critical, earliest = -1, 1.0
    for k in range(one.shape[0]):
        b, low, high = intact[k], 0.0, earliest
        if not _fails(one[k], two[k], high, strengths.normal[k], strengths.shear[k], averaged, lattice, b, p):
            continue
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if _fails(one[k], two[k], middle, strengths.normal[k], strengths.shear[k], averaged, lattice, b, p):
                high = middle
            else:
                low = middle
        most_critical, earliest = k, high
    return most_critical, earliest


@kernel
def _fails(
    one: Floats, two: Floats, share: float, normal_limit: float, shear_limit: float, averaged: bool, lattice: ElasticLattice,
    b: int, p: KernelParameters,
) -> bool:  # fmt: skip
    """Whether a place is overloaded at a part of the step."""
    x = one[0] + share * (two[0] - one[0])
    y = one[1] + share * (two[1] - one[1])
    z = one[2] + share * (two[2] - one[2])
    if averaged:
        normal, shear = principal(x, y, z)
    else:
        normal = tensile_stress(p.youngs_modulus / lattice.rest[b], -0.5 * x, z, lattice.width[b])
        shear = shear_stress_of(p.youngs_modulus / lattice.rest[b], p.poisson, abs(y))
    return bool(normal > normal_limit or shear > shear_limit)


@kernel
def grow_damage(bonds: Bonds, intact: Ints, damage_drive: Floats, dt: float, p: KernelParameters) -> None:
    """Let the damage of the bonds grow over ``dt`` s by their stress over strength in the middle of the step."""
    for k in range(intact.size):
        b = intact[k]
        rate = damage_rate(damage_drive[k], p.damage_threshold, p.damage_time, p.damage_exponent)
        bonds.damage[b] = grown_damage(bonds.damage[b], rate, dt)


def store_stresses(
    bonds: Bonds, lattice: ElasticLattice, intact: Ints, deformation: Floats, stress: Floats, motion: Floats
) -> None:
    """Write stresses and deformations of the bonds that hold to the state; ``motion`` as in `riftberg.stepping.bodies.pose`."""
    _store_stresses(
        bonds.normal_stress, bonds.shear_stress, bonds.peak_stress, bonds.bond_length, bonds.shear_x, bonds.shear_y,
        bonds.relative_rotation, lattice.first, lattice.nx, lattice.ny, lattice.length, intact, deformation, stress, motion,
    )  # fmt: skip


@borrower
def _store_stresses(
    normal: Floats, shear: Floats, peak: Floats, length: Floats, shear_x: Floats, shear_y: Floats, rotation: Floats,
    first: Ints, nx: Floats, ny: Floats, loose: Floats, intact: Ints, deformation: Floats, stress: Floats, motion: Floats,
) -> None:  # fmt: skip
    """Fill variables of `riftberg.state.Bonds`; see `store_stresses`."""
    for k in range(intact.size):
        b = intact[k]
        e, s, i = deformation[k, 0], deformation[k, 1], first[b]
        tx, ty, c, d = ny[b], -nx[b], motion[i, 9], motion[i, 10]
        normal[b], shear[b], peak[b] = stress[k, 0], stress[k, 1], max(peak[b], stress[k, 0])
        length[b] = loose[b] + e
        shear_x[b] = s * (c * tx - d * ty)
        shear_y[b] = s * (d * tx + c * ty)
        rotation[b] = deformation[k, 2]


@kernel
def record_peak_stress(peak: Floats, intact: Ints, stress: Floats) -> None:
    """Keep the largest tensile stress (Pa) of each bond that holds, in place."""
    for k in range(intact.size):
        peak[intact[k]] = max(peak[intact[k]], stress[k, 0])


@kernel
def residual_strength(
    normal_strength: float, shear_strength: float, strength: float, damage: float
) -> tuple[float, float]:
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)
