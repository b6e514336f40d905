"""The fastest mode of a lattice of bonds, which decides how long a sub-step of an explicit scheme may be.

In generalised coordinates X (displacement and rotation of every element) and velocities V the linearised sub-step is
``V' = V - h M^-1 (K X + C V)``, ``X' = X + h V'``: leapfrog with the damping at the half-kicked velocity. With symmetric,
non-negative K and C each eigenvector sees Rayleigh quotients k and c, and all its factors stay within the unit circle
exactly while ``4 - 2 h c - h^2 k > 0``. At the limit ``4 M - 2 h C - h^2 K`` is singular, that is an eigenvalue is -1, so
the bound is sharp, however K and C are combined. With ``K = S S^T`` and ``mu = 1 / h`` the limit is the largest eigenvalue
of the symmetric matrix::

    [ 0      S^T / 2 ]
    [ S / 2  C / 2   ]

(mass-weighted), which a few dozen Lanczos steps give. The matrix is never written down: of a million elements it would take
gigabytes.
"""

from __future__ import annotations

import numpy as np

from riftberg.parameters import Parameters
from riftberg.physics.bonds import beam_parts, isotropic_parts
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.diagonals import diagonal_lengths, find_diagonals

ACCURACY = 1e-3
"""Relative accuracy of the largest eigenvalue: far less than the margin of ``stepping.safety``."""

MOST_STEPS = 400
"""Lanczos steps at most; some 30 to 80 are usual."""


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
    nu, kinds = p.bonds.poisson, np.stack([sides, diagonal], axis=-1)
    pairs, of = np.unique(kinds, axis=0, return_inverse=True)
    parts = [
        isotropic_parts(s, bool(d), nu) if p.bonds.elasticity == "isotropic" else beam_parts(nu)
        for s, d in pairs.tolist()
    ]
    normal, shear, facet = np.array(parts).reshape(-1, 3)[of.ravel()].T
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


class SubstepMatrix:
    """The matrix whose largest eigenvalue is the inverse of the longest stable sub-step (s-1), as the product with a vector.

    The intact bonds are linearised about the present positions, without strain. A vector holds the three strains of all bonds
    (extension, slip, bend), then the mass-weighted velocities (u, v, spin) of all elements.
    """

    def __init__(self, p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> None:
        on, kernel = bonds.status == 0, p.kernel_values()
        diagonals = find_diagonals(elements, bonds, kernel)
        i, j = np.append(bonds.first[on], diagonals.first), np.append(bonds.second[on], diagonals.second)
        rest = np.append(bonds.rest_length[on], diagonal_lengths(diagonals.way, bonds.rest_length))
        diagonal = np.arange(i.size) >= on.sum()
        nothing = np.zeros(i.size)
        r1, r2 = _radii_when_formed(p, rest, sizes.bond_radius[i], sizes.bond_radius[j])
        if p.bonds.law == "dem":
            sides = np.where(elements.body.sides > 0, elements.body.sides, kernel.max_sides)[i]
            stiffness = _dem_stiffness(p, (r1, r2), elements.thickness, _parts(p, sides, diagonal), i, j)
            damper = np.where(diagonal, 0.0, _dem_damping(p, sizes, i, j))
            slip, tangent = (damper, nothing) if p.bonds.objective_damping else (nothing, damper)
            self._damping = damper, slip, tangent, damper
        else:
            least = np.minimum(sizes.bond_mass[i], sizes.bond_mass[j])
            spring = _spring_stiffness(p, r1 + r2)
            stiffness = spring * least, nothing, nothing
            radial, tangential = _spring_damping(p, spring)
            self._damping = radial * least, nothing, tangential * least, nothing
        moves = np.where(elements.static < 0.5, 1.0, 0.0)
        weight = moves / np.sqrt(sizes.bond_mass)
        self._weight = np.stack([weight, weight, moves / (np.sqrt(0.5 * sizes.bond_mass) * sizes.bond_radius)])
        self._i, self._j, self._r1, self._r2, self._count = i, j, r1, r2, elements.size
        self._nx, self._ny = _directions(p, elements, i, j)
        self._root = tuple(np.sqrt(k) for k in stiffness)
        self.size = 3 * (i.size + elements.size)

    def __matmul__(self, vector: Floats) -> Floats:
        """Return the product with a vector."""
        i, j, nx, ny, r1, r2 = self._i, self._j, self._nx, self._ny, self._r1, self._r2
        strain, (u, v, spin) = vector[: 3 * i.size].reshape(3, -1), vector[3 * i.size :].reshape(3, -1) * self._weight
        du, dv = u[i] - u[j], v[i] - v[j]
        tangent = ny * du - nx * dv
        rates = nx * du + ny * dv, tangent + r1 * spin[i] + r2 * spin[j], spin[i] - spin[j]
        (normal, shear, bend), (c_normal, c_slip, c_tangent, c_spin) = self._root, self._damping
        out = np.empty(self.size)
        for row, root, rate in zip(out[: 3 * i.size].reshape(3, -1), self._root, rates, strict=True):
            row[:] = 0.5 * root * rate
        # The transposed product: what the strains and their rates do to the elements at both ends.
        along = normal * strain[0] + c_normal * rates[0]
        slip = shear * strain[1] + c_slip * rates[1]
        turning = bend * strain[2] + c_spin * rates[2]
        across = slip + c_tangent * tangent
        forces = out[3 * i.size :].reshape(3, -1)
        fx, fy = nx * along + ny * across, ny * along - nx * across
        for row, one, other in zip(forces, (fx, fy, r1 * slip + turning), (-fx, -fy, r2 * slip - turning), strict=True):
            row[:] = np.bincount(i, one, self._count) + np.bincount(j, other, self._count)
        forces *= 0.5 * self._weight
        return out


def largest_eigenvalue(matrix: SubstepMatrix) -> float:
    """Return an upper estimate of the largest eigenvalue (s-1) of a symmetric matrix; not a number where it overflows.

    By Lanczos' method, of which the largest eigenvalue needs no more than the last two vectors. The residual of the Ritz vector
    is added to the Ritz value, so that the estimate errs to the safe side by at most `ACCURACY`.
    """
    vector = np.random.default_rng(1).standard_normal(matrix.size)  # fixed: the same lattice, the same sub-step
    vector /= np.linalg.norm(vector)
    before, beta, value, residual = vector, 0.0, 0.0, 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    with np.errstate(over="ignore", invalid="ignore"):
        for n in range(1, MOST_STEPS + 1):
            new = matrix @ vector
            diagonal.append(float(new @ vector))
            new -= diagonal[-1] * vector + beta * before
            beta = float(np.linalg.norm(new))
            if not np.isfinite(beta):
                return np.nan
            ended = beta <= 1e-10 * max(map(abs, diagonal))  # nothing is left that the vectors so far do not span
            if ended or n % 5 == 0:
                values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, -1))  # reads the lower half
                value, residual = float(values[-1]), beta * abs(float(vectors[-1, -1]))
            if ended or (n % 5 == 0 and residual <= ACCURACY * value):
                break
            beside.append(beta)
            before, vector = vector, new / beta
    return value + residual
