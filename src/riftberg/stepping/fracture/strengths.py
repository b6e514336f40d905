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
from riftberg.stepping.lattice.equilibrium import ElasticLattice, deformed

BISECTIONS = 30
"""Halvings of the step in the search for the moment of a break: to a millionth of a second."""


class Limits(NamedTuple):
    """Tensile and shear stress (Pa) at which the bonds that hold break."""

    normal: Floats
    shear: Floats


def limits_of(bonds: Bonds, alive: Ints, p: KernelParameters) -> Limits:
    """Strengths that the bonds have left."""
    return Limits(*_limits_of(bonds.strength, bonds.damage, alive, p.normal_strength, p.shear_strength))


@kernel
def _limits_of(
    strength: Floats, damage: Floats, alive: Ints, normal_strength: float, shear_strength: float
) -> tuple[Floats, Floats]:
    """Return the fields of `Limits`; see `riftberg.compiled.kernels` why no named tuple."""
    normal, shear = np.empty(alive.size), np.empty(alive.size)
    for k in range(alive.size):
        b = alive[k]
        normal[k], shear[k] = limits_left(normal_strength, shear_strength, strength[b], damage[b])
    return normal, shear


@kernel
def most_overloaded(stress: Floats, limits: Limits) -> tuple[int, float]:
    """Row of the bond whose stress is highest over its strength, and that ratio; above 1 it breaks (-1 without bonds)."""
    worst, highest = -1, -np.inf
    for k in range(stress.shape[0]):
        ratio = overload(stress[k, 0], stress[k, 1], limits.normal[k], limits.shear[k])
        if ratio > highest:
            worst, highest = k, ratio
    return worst, highest


@kernel
def overload(normal: float, shear: float, normal_limit: float, shear_limit: float) -> float:
    """Stress over strength; a bond without strength fails under the smallest stress."""
    a = normal / normal_limit if normal_limit > 0.0 else (np.inf if normal > 0.0 else 0.0)
    b = shear / shear_limit if shear_limit > 0.0 else (np.inf if shear > 0.0 else 0.0)
    return a if a >= b else b


@kernel
def _deformation(lattice: ElasticLattice, alive: Ints, bend: Floats) -> Floats:
    """Extension, slip and bend of the bonds that hold, shape (bonds, 3)."""
    deformation = np.empty((alive.size, 3))
    for k in range(alive.size):
        deformation[k, 0], deformation[k, 1], deformation[k, 2] = deformed(lattice, bend, alive[k])
    return deformation


@kernel
def first_break(
    lattice: ElasticLattice, alive: Ints, before: Floats, after: Floats, limits: Limits, p: KernelParameters
) -> tuple[int, float]:
    """Row of the bond that fails first between two equilibria, and the part of the step at which it does (1: none).

    ``before``, ``after``: displacements at both ends of the step (shape (elements, 3)).
    """
    one, two = _deformation(lattice, alive, before), _deformation(lattice, alive, after)
    return first_overload(one, two, limits, False, lattice, alive, p)


@kernel
def first_overload(
    one: Floats, two: Floats, limits: Limits, averaged: bool, lattice: ElasticLattice, alive: Ints, p: KernelParameters
) -> tuple[int, float]:
    """Row of the place that is overloaded first, and the part of the step at which it is (1: none), by bisection.

    ``one``, ``two``: what goes evenly from one end of the step to the other: extension, slip and bend of each bond, or
    an averaged tensor (shape (places, 3)).
    """
    worst, earliest = -1, 1.0
    for k in range(one.shape[0]):
        b, low, high = alive[k], 0.0, earliest
        if not _fails(one[k], two[k], high, limits.normal[k], limits.shear[k], averaged, lattice, b, p):
            continue
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if _fails(one[k], two[k], middle, limits.normal[k], limits.shear[k], averaged, lattice, b, p):
                high = middle
            else:
                low = middle
        worst, earliest = k, high
    return worst, earliest


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
def wear(bonds: Bonds, alive: Ints, ratios: Floats, dt: float, p: KernelParameters) -> None:
    """Let the damage of the bonds grow over ``dt`` s by their stress over strength in the middle of the step."""
    for k in range(alive.size):
        b = alive[k]
        rate = damage_rate(ratios[k], p.damage_threshold, p.damage_time, p.damage_exponent)
        bonds.damage[b] = grown_damage(bonds.damage[b], rate, dt)


def store_stresses(
    bonds: Bonds, lattice: ElasticLattice, alive: Ints, deformation: Floats, stress: Floats, motion: Floats
) -> None:
    """Write stresses and deformations of the bonds that hold to the state; ``motion`` as in `riftberg.stepping.bodies.pose`."""
    _store_stresses(
        bonds.normal_stress, bonds.shear_stress, bonds.peak_stress, bonds.bond_length, bonds.shear_x, bonds.shear_y,
        bonds.relative_rotation, lattice.first, lattice.nx, lattice.ny, lattice.length, alive, deformation, stress, motion,
    )  # fmt: skip


@borrower
def _store_stresses(
    normal: Floats, shear: Floats, peak: Floats, length: Floats, shear_x: Floats, shear_y: Floats, rotation: Floats,
    first: Ints, nx: Floats, ny: Floats, loose: Floats, alive: Ints, deformation: Floats, stress: Floats, motion: Floats,
) -> None:  # fmt: skip
    """Fill variables of `riftberg.state.Bonds`; see `store_stresses`."""
    for k in range(alive.size):
        b = alive[k]
        e, s, i = deformation[k, 0], deformation[k, 1], first[b]
        tx, ty, c, d = ny[b], -nx[b], motion[i, 9], motion[i, 10]
        normal[b], shear[b], peak[b] = stress[k, 0], stress[k, 1], max(peak[b], stress[k, 0])
        length[b] = loose[b] + e
        shear_x[b] = s * (c * tx - d * ty)
        shear_y[b] = s * (d * tx + c * ty)
        rotation[b] = deformation[k, 2]


@kernel
def keep_peaks(peak: Floats, alive: Ints, stress: Floats) -> None:
    """Keep the largest tensile stress (Pa) of each bond that holds, in place."""
    for k in range(alive.size):
        peak[alive[k]] = max(peak[alive[k]], stress[k, 0])


@kernel
def limits_left(normal_strength: float, shear_strength: float, strength: float, damage: float) -> tuple[float, float]:
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)
