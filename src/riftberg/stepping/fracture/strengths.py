"""Strengths of bonds and what stress does to them: overload, damage, and what the state keeps of both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.fracture import damage_rate, grown_damage, stress_ratio
from riftberg.state import Bonds, Floats, Ints
from riftberg.stepping.lattice.equilibrium import ElasticLattice

NORMAL, SHEAR, FLEXURAL = 1, 2, 3
"""Values of ``break_strength``: which strength a bond exceeded when it broke."""


class Strengths(NamedTuple):
    """Stresses at which the intact bonds break."""

    normal: Floats  # Pa; shape (intact bonds,)
    shear: Floats  # Pa; shape (intact bonds,)


def residual_strengths(bonds: Bonds, intact: Ints, p: KernelParameters) -> Strengths:
    """Strengths that damage has left to the intact bonds."""
    return Strengths(*_residual_strengths(bonds.strength, bonds.damage, intact, p.normal_strength, p.shear_strength))


@kernel
def _residual_strengths(
    strength: Floats, damage: Floats, intact: Ints, normal_strength: float, shear_strength: float
) -> tuple[Floats, Floats]:
    """Return the fields of `Strengths` (no named tuple: see `riftberg.compiled.kernels`)."""
    normal, shear = np.empty(intact.size), np.empty(intact.size)
    for k in range(intact.size):
        b = intact[k]
        normal[k], shear[k] = residual_strength(normal_strength, shear_strength, strength[b], damage[b])
    return normal, shear


@kernel
def most_overloaded(stress: Floats, strengths: Strengths) -> tuple[int, float]:
    """Row of the bond whose stress is highest over its strength, and that ratio; -1 without bonds."""
    row, highest = -1, -np.inf
    for k in range(stress.shape[0]):
        ratio = stress_ratio(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
        if ratio > highest:
            row, highest = k, ratio
    return row, highest


@kernel
def overloads(stress: Floats, strengths: Strengths) -> Floats:
    """Stress over strength of each intact bond."""
    ratios = np.empty(stress.shape[0])
    for k in range(stress.shape[0]):
        ratios[k] = stress_ratio(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
    return ratios


@kernel
def grow_damage(bonds: Bonds, intact: Ints, damage_drive: Floats, dt: float, p: KernelParameters) -> None:
    """Let the damage of the intact bonds grow over ``dt`` s; ``damage_drive`` is stress over strength in the middle."""
    for k in range(intact.size):
        b = intact[k]
        rate = damage_rate(damage_drive[k], p.damage_threshold, p.damage_time, p.damage_exponent)
        bonds.damage[b] = grown_damage(bonds.damage[b], rate, dt)


def store_stresses(
    bonds: Bonds, lattice: ElasticLattice, intact: Ints, deformation: Floats, stress: Floats, levers: Floats
) -> None:
    """Write stresses and deformations of the intact bonds to the state; ``levers``: `riftberg.stepping.bodies.pose`."""
    _store_stresses(
        bonds.normal_stress, bonds.shear_stress, bonds.peak_stress, bonds.bond_length, bonds.shear_x, bonds.shear_y,
        bonds.relative_rotation, lattice.first, lattice.nx, lattice.ny, lattice.length, intact, deformation, stress, levers,
    )  # fmt: skip


# Many arguments: seven arrays of the bonds are written and four of the lattice read, each taken out of its table
# before the loop, inside which numba would count references at each access.
@borrower
def _store_stresses(
    normal: Floats, shear: Floats, peak: Floats, length: Floats, shear_x: Floats, shear_y: Floats, rotation: Floats,
    first: Ints, nx: Floats, ny: Floats, unstrained: Floats, intact: Ints, deformation: Floats, stress: Floats, levers: Floats,
) -> None:  # fmt: skip
    """Fill the variables of `riftberg.state.Bonds`."""
    for k in range(intact.size):
        b = intact[k]
        e, s, i = deformation[k, 0], deformation[k, 1], first[b]
        tx, ty, c, d = ny[b], -nx[b], levers[i, 9], levers[i, 10]
        normal[b], shear[b], peak[b] = stress[k, 0], stress[k, 1], max(peak[b], stress[k, 0])
        length[b] = unstrained[b] + e
        shear_x[b] = s * (c * tx - d * ty)
        shear_y[b] = s * (d * tx + c * ty)
        rotation[b] = deformation[k, 2]


@kernel
def record_peak_stress(peak: Floats, intact: Ints, stress: Floats) -> None:
    """Record the largest tensile stress (Pa) of each intact bond."""
    for k in range(intact.size):
        peak[intact[k]] = max(peak[intact[k]], stress[k, 0])


@kernel
def residual_strength(
    normal_strength: float, shear_strength: float, strength: float, damage: float
) -> tuple[float, float]:
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)
