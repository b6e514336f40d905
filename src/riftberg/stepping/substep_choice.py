"""How long a sub-step may be: from stiffness, mass and damping of the bonds (Riftberg's own; the reference is set by hand).

Each bond is looked at alone, with the share 1 / (number of its bonds) of the mass and moment of inertia of each end. The
highest frequency of the lattice is at most the highest of any such bond, as for assembled finite elements.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Floats
from riftberg.stepping.sizes import Sizes


def _bond_rates(p: Parameters, bonds: Bonds, sizes: Sizes, thickness: Floats) -> tuple[Floats, Floats]:
    """Bounds on the squared frequency (s-2) and the damping rate (s-1) of each unbroken bond."""
    on = bonds.status == 0
    i, j = bonds.first[on], bonds.second[on]
    count = np.bincount(np.concatenate([i, j]), minlength=sizes.mass.size).astype(float)
    m1, m2 = sizes.bond_mass[i] / count[i], sizes.bond_mass[j] / count[j]
    if p.bonds.law == "spring":
        least = np.minimum(sizes.bond_mass[i], sizes.bond_mass[j])
        return p.bonds.spring * least * (1 / m1 + 1 / m2), np.zeros(i.size)
    r1, r2 = sizes.bond_radius[i], sizes.bond_radius[j]
    rest, width = r1 + r2, 2.0 * np.maximum(r1, r2)
    height = np.maximum(thickness[i], thickness[j])
    inertia1, inertia2 = 0.5 * m1 * r1**2, 0.5 * m2 * r2**2
    normal = p.bonds.youngs_modulus * height * width / rest
    shear = normal / (2.0 * (1.0 + p.bonds.poisson)) * (0.0 if p.bonds.no_shear else 1.0)
    bending = p.bonds.youngs_modulus * width**3 * height / (12.0 * rest)
    translation = 1 / m1 + 1 / m2
    with_spin = translation + r1**2 / inertia1 + r2**2 / inertia2
    squared = np.maximum(normal * translation, shear * with_spin + bending * (1 / inertia1 + 1 / inertia2))
    plane = 2.0 * p.bonds.youngs_modulus / (3.0 * (1.0 - p.bonds.poisson**2))
    full1, full2 = sizes.bond_mass[i], sizes.bond_mass[j]
    damper = p.bonds.damping * np.sqrt(plane * full1 * full2 / (full1 + full2))
    return squared, damper * (with_spin if p.bonds.objective_damping else translation)


def stable_substep(p: Parameters, bonds: Bonds, sizes: Sizes, thickness: Floats) -> float:
    """Largest stable sub-step in seconds; infinite without bonds.

    For ``x'' + c x' + w^2 x = 0`` stepped as here (damping at the half-kicked velocity) the limit is
    ``dt <= (sqrt(c^2 + 4 w^2) - c) / w^2``, which is 2 / w without damping.

    Parameters
    ----------
    p : Parameters
    bonds : Bonds
    sizes : Sizes
    thickness : array of float
        Ice thickness, m.
    """
    if p.bonds.law == "none" or not np.any(bonds.status == 0):
        return math.inf
    squared, damping = _bond_rates(p, bonds, sizes, thickness)
    limit = (np.sqrt(damping**2 + 4.0 * squared) - damping) / np.maximum(squared, 1e-300)
    return float(limit.min())


def choose_substeps(p: Parameters, bonds: Bonds, sizes: Sizes, thickness: Floats) -> int:
    """Number of sub-steps in a long step: as given (and checked), or the smallest that keeps the safety factor.

    Raises
    ------
    InputError
        If the given number makes the sub-step longer than the stable one; not in runs with the reference's quirks,
        which must run as they stand.
    """
    dt, stable = p.stepping.time_step, stable_substep(p, bonds, sizes, thickness)
    least = max(1, math.ceil(dt / (p.stepping.safety * stable) - 1e-9)) if math.isfinite(stable) else 1
    given = p.stepping.substeps
    if given is None:
        return least
    if dt / given > stable and not p.compatibility.zero_start and p.stepping.explicit_substeps:
        raise InputError(
            f"sub-step of {dt / given:.3g} s ({given} in {dt:g} s) is longer than the stable {stable:.3g} s "
            "of these bonds",
            where="stepping.substeps",
            remedy=f"Set it to {least} or more, or leave it out to have it chosen",
        )
    return given
