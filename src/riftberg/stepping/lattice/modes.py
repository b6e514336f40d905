"""The fastest mode of a lattice of bonds, which decides how long a sub-step of an explicit scheme may be.

In generalised coordinates X (displacement and rotation of every element) and velocities V the linearised sub-step is
``V' = V - h M^-1 (K X + C V)``, ``X' = X + h V'``: leapfrog with the damping at the half-kicked velocity. With symmetric,
non-negative K and C each eigenvector sees Rayleigh quotients k and c, and all its factors stay within the unit circle
exactly while ``4 - 2 h c - h^2 k > 0``. At the limit ``4 M - 2 h C - h^2 K`` is singular, that is an eigenvalue is -1, so
the bound is sharp, however K and C are combined. With ``K = S S^T`` and ``mu = 1 / h`` the limit is the largest eigenvalue
of the symmetric matrix::

    [ 0      S^T / 2 ]
    [ S / 2  C / 2   ]

(mass-weighted), which a few dozen Lanczos steps give.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from riftberg.parameters import Parameters
from riftberg.physics.bonds import beam_parts, isotropic_parts
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.diagonals import diagonal_lengths, find_diagonals

ACCURACY = 0.01
"""Relative accuracy of the largest eigenvalue: far less than the margin of ``stepping.safety``."""


def _directions(p: Parameters, elements: Elements, first: Ints, second: Ints) -> tuple[Floats, Floats]:
    """Unit vectors from the second to the first elements (equations 2.2)."""
    dx, dy = elements.lon[first] - elements.lon[second], elements.lat[first] - elements.lat[second]
    if p.earth.period > 0.0:
        dx -= p.earth.period * np.floor(dx / p.earth.period + 0.5)
    if p.earth.latlon:
        dx *= np.cos(np.radians(0.5 * (elements.lat[first] + elements.lat[second])))
    length = np.hypot(dx, dy)
    return dx / length, dy / length


def _dem_stiffness(
    p: Parameters,
    radii: tuple[Floats, Floats],
    thickness: Floats,
    parts: tuple[Floats, Floats, Floats],
    i: Ints,
    j: Ints,
) -> tuple[Floats, Floats, Floats]:
    """Normal, shear (N m-1) and bending (N m) stiffness of undeformed bonds (equations 5.4); ``parts``: `_parts`."""
    r1, r2 = radii
    rest = r1 + r2
    reach = np.minimum(r1, r2) / rest
    width = 2.0 * (np.minimum(r1, r2) + reach * np.abs(r1 - r2))
    of_smaller, of_larger = np.where(r2 <= r1, (thickness[j], thickness[i]), (thickness[i], thickness[j]))
    height = of_smaller + reach * (of_larger - of_smaller)
    if p.compatibility.bond_thickness_of_second:
        height = np.maximum(thickness[i], thickness[j]) + reach * np.abs(thickness[i] - thickness[j])
    beam = p.bonds.youngs_modulus * height * width / rest
    of_normal, of_shear, facet = parts
    shear = 0.0 * beam if p.bonds.no_shear else beam * of_shear
    return beam * of_normal, shear, beam * facet**3 * width**2 / 12.0


def _parts(p: Parameters, sides: Ints, diagonal: Ints) -> tuple[Floats, Floats, Floats]:
    """Stiffness of bonds as parts of that of a beam, by the sides of their elements: see `isotropic_parts`."""
    nu = p.bonds.poisson
    of = [isotropic_parts(s, d, nu) if p.bonds.elasticity == "isotropic" else beam_parts(nu) for s, d in zip(
        sides.tolist(), diagonal.tolist(), strict=True)]  # fmt: skip
    normal, shear, facet = np.array(of).reshape(-1, 3).T
    return normal, shear, facet


def _radii_when_formed(p: Parameters, rest: Floats, r1: Floats, r2: Floats) -> tuple[Floats, Floats]:
    """Radii (m) of both ends as the bond knows them; it keeps the shape with which it formed."""
    formed = np.where(np.isnan(rest) | p.compatibility.rest_length_from_sizes, 1.0, rest / (r1 + r2))
    return r1 * formed, r2 * formed


def _dem_damping(p: Parameters, sizes: Sizes, i: Ints, j: Ints) -> Floats:
    """Damping constant of the bonds, kg s-1 (equations 5.4)."""
    plane = 2.0 * p.bonds.youngs_modulus / (3.0 * (1.0 - p.bonds.poisson**2))
    m1, m2 = sizes.bond_mass[i], sizes.bond_mass[j]
    return np.asarray(p.bonds.damping * np.sqrt(plane * m1 * m2 / (m1 + m2)))


def _spring_stiffness(p: Parameters, rest: Floats) -> Floats:
    """Stiffness (s-2) of spring bonds of some rest lengths (m): as given, or that of the ice (equations 5.2; Riftberg)."""
    if p.bonds.spring is None:
        return np.asarray(p.kernel_values().spring_modulus / rest**2)
    return np.full(rest.shape, p.bonds.spring)


def _spring_damping(p: Parameters, stiffness: Floats) -> tuple[Floats, Floats]:
    """Radial and tangential damping (s-1) of spring bonds; 0 where it is quadratic and has no linear part (equations 5.2)."""
    c, one = p.contact, np.ones_like(stiffness)
    if p.compatibility.damping_by_speed:
        return 0.0 * one, 0.0 * one
    if not c.critical_damping:
        return c.radial_damping * one, c.tangential_damping * one
    full = 2.0 * stiffness**0.5
    return full, full / 4.0 if c.tangential_critical_damping else c.tangential_damping * one


def substep_matrix(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> Any:
    """Return the sparse matrix whose largest eigenvalue is the inverse of the longest stable sub-step (s-1).

    The intact bonds are linearised about the present positions, without strain.
    """
    # SciPy's sparse matrices take a third of a second to import, which runs with a given number of sub-steps do not need.
    from scipy.sparse import bmat, csr_matrix, diags

    on, count = bonds.status == 0, elements.mass.size
    kernel = p.kernel_values()
    diagonals = find_diagonals(elements, bonds, kernel)
    i, j = np.append(bonds.first[on], diagonals.first), np.append(bonds.second[on], diagonals.second)
    rest = np.append(bonds.rest_length[on], diagonal_lengths(diagonals.way, bonds.rest_length))
    diagonal = np.arange(i.size) >= on.sum()
    nothing, one = np.zeros(i.size), np.ones(i.size)
    r1, r2 = _radii_when_formed(p, rest, sizes.bond_radius[i], sizes.bond_radius[j])
    nx, ny = _directions(p, elements, i, j)
    if p.bonds.law == "dem":
        sides = np.where(elements.body.sides > 0, elements.body.sides, kernel.max_sides)[i]
        normal, shear, bending = _dem_stiffness(p, (r1, r2), elements.thickness, _parts(p, sides, diagonal), i, j)
        damper = np.where(diagonal, 0.0, _dem_damping(p, sizes, i, j))
        damp_slip, damp_tangent = (damper, nothing) if p.bonds.objective_damping else (nothing, damper)
        damp_normal = damp_spin = damper
    else:
        least = np.minimum(sizes.bond_mass[i], sizes.bond_mass[j])
        stiffness = _spring_stiffness(p, r1 + r2)
        normal, shear, bending = stiffness * least, nothing, nothing
        radial, tangential = _spring_damping(p, stiffness)
        damp_normal, damp_slip, damp_tangent, damp_spin = radial * least, nothing, tangential * least, nothing

    moves = np.where(elements.static < 0.5, 1.0, 0.0)
    weight = moves / np.sqrt(sizes.bond_mass)
    spin_weight = moves / (np.sqrt(0.5 * sizes.bond_mass) * sizes.bond_radius)
    columns = np.stack([i, i + count, i + 2 * count, j, j + count, j + 2 * count], axis=1)

    def strain(*coefficients: Floats) -> Any:
        """Operator from mass-weighted velocities (u, v, spin of all elements) to a rate of strain of all bonds."""
        matrix = csr_matrix(
            (np.stack(coefficients, axis=1).ravel(), columns.ravel(), np.arange(0, columns.size + 1, 6)),
            shape=(i.size, 3 * count),
        )
        return matrix @ diags(np.concatenate([weight, weight, spin_weight]))

    along = strain(nx, ny, nothing, -nx, -ny, nothing)
    tangent = strain(ny, -nx, nothing, -ny, nx, nothing)
    slip = strain(ny, -nx, r1, -ny, nx, r2)
    bend = strain(nothing, nothing, one, nothing, nothing, -one)
    springs = bmat([[diags(np.sqrt(k)) @ b] for k, b in ((normal, along), (shear, slip), (bending, bend))])
    dampers = ((damp_normal, along), (damp_slip, slip), (damp_tangent, tangent), (damp_spin, bend))
    damping = sum(b.T @ diags(c) @ b for c, b in dampers)
    return bmat([[None, 0.5 * springs], [0.5 * springs.T, 0.5 * damping]]).tocsr()


def largest_eigenvalue(matrix: Any) -> float:
    """Return an upper estimate of the largest eigenvalue (s-1) of a symmetric matrix; not a number where it overflows.

    The residual of the Ritz vector is added to the Ritz value, so that the estimate errs to the safe side by at most some
    `ACCURACY`; no estimate is above the largest sum over a row.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, eigsh

    bound = float(abs(matrix).sum(axis=1).max())
    if not 0.0 < bound < np.inf:
        return 0.0 if bound == 0.0 else np.nan
    scaled = matrix / bound  # of the order of 1, so that no square overflows
    start = np.random.default_rng(1).standard_normal(matrix.shape[0])  # fixed: the same lattice, the same sub-step
    try:
        (value,), vector = eigsh(scaled, k=1, which="LA", tol=ACCURACY, v0=start)
    except ArpackNoConvergence:
        return bound
    residual = float(np.linalg.norm(scaled @ vector[:, 0] - value * vector[:, 0]))
    return bound * min(float(value) + residual, 1.0)
