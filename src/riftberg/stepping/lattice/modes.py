"""The fastest mode of a lattice of bonds, which decides how long a sub-step may be.

In generalised coordinates X (displacement and rotation of every element) and velocities V the linearised sub-step is
``V' = V - h M^-1 (K X + C V)``, ``X' = X + h V'``: leapfrog with the damping at the half-kicked velocity. With symmetric,
non-negative K and C each eigenvector sees Rayleigh quotients k and c, and all its factors stay within the unit circle
exactly while ``4 - 2 h c - h^2 k > 0``. At the limit ``4 M - 2 h C - h^2 K`` is singular, that is an eigenvalue is -1, so
the bound is sharp, however K and C are combined. With ``K = S S^T`` and ``mu = 1 / h`` the limit is the largest eigenvalue
of the symmetric matrix::

    [ 0      S^T / 2 ]
    [ S / 2  C / 2   ]

(mass-weighted), which a few dozen Lanczos steps give without the matrix ever being built.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.forces.sizes import Sizes

ACCURACY = 0.01
"""Relative accuracy of the largest eigenvalue."""

MOST_STEPS = 400


@dataclass(frozen=True)
class BondOperator:
    """Stiffness and damping of all unbroken bonds, mass-weighted, applied without building matrices."""

    ends: Ints  # First, then second elements of the bonds; shape (2 n,)
    count: int  # Number of elements
    nx: Floats  # Direction from the second to the first element; shape (n,)
    ny: Floats  # Direction from the second to the first element; shape (n,)
    lever1: Floats  # m
    lever2: Floats  # m
    normal: Floats  # Square roots of the stiffnesses (N m-1, N m-1, N m)
    shear: Floats  # Square roots of the stiffnesses (N m-1, N m-1, N m)
    bending: Floats  # Square roots of the stiffnesses (N m-1, N m-1, N m)
    # Damping of approach, of slip at the contact, of tangential relative velocity of the centres (kg s-1) and of
    # relative spin (kg m2 s-1)
    damp_normal: Floats
    # Damping of approach, of slip at the contact, of tangential relative velocity of the centres (kg s-1) and of
    # relative spin (kg m2 s-1)
    damp_slip: Floats
    # Damping of approach, of slip at the contact, of tangential relative velocity of the centres (kg s-1) and of
    # relative spin (kg m2 s-1)
    damp_tangent: Floats
    # Damping of approach, of slip at the contact, of tangential relative velocity of the centres (kg s-1) and of
    # relative spin (kg m2 s-1)
    damp_spin: Floats
    root_mass: Floats  # ``1 / sqrt(m)`` and ``1 / sqrt(I)``; 0 for elements that never move; shape (count,)
    root_inertia: Floats  # ``1 / sqrt(m)`` and ``1 / sqrt(I)``; 0 for elements that never move; shape (count,)

    @property
    def size(self) -> int:
        """Length of the vectors that `apply` takes."""
        return 3 * self.nx.size + 3 * self.count

    def apply(self, vector: Floats, image: Floats | None = None) -> Floats:
        """Multiply by the symmetric matrix whose largest eigenvalue is the inverse of the longest stable sub-step."""
        image = np.zeros(self.size) if image is None else image
        multiply: Any = _multiply  # takes all fields as they stand
        multiply(*vars(self).values(), vector, image)
        return image


@kernel
def _multiply(
    ends: Ints, count: int, nx: Floats, ny: Floats, lever1: Floats, lever2: Floats, normal: Floats, shear: Floats,
    bending: Floats, damp_normal: Floats, damp_slip: Floats, damp_tangent: Floats, damp_spin: Floats, root_mass: Floats,
    root_inertia: Floats, vector: Floats, image: Floats,
) -> None:  # fmt: skip
    """Fill ``image`` with the matrix of a `BondOperator` times ``vector``, bond by bond."""
    bonds = nx.size
    z1, z2, z3 = vector[:bonds], vector[bonds : 2 * bonds], vector[2 * bonds : 3 * bonds]
    to1, to2, to3 = image[:bonds], image[bonds : 2 * bonds], image[2 * bonds : 3 * bonds]
    u, v, turn = vector[3 * bonds :][:count], vector[3 * bonds + count :][:count], vector[3 * bonds + 2 * count :]
    fx, fy, torque = image[3 * bonds :][:count], image[3 * bonds + count :][:count], image[3 * bonds + 2 * count :]
    image[3 * bonds :] = 0.0
    for b in range(bonds):
        i, j = ends[b], ends[bonds + b]
        du, dv = u[i] * root_mass[i] - u[j] * root_mass[j], v[i] * root_mass[i] - v[j] * root_mass[j]
        turn1, turn2 = turn[i] * root_inertia[i], turn[j] * root_inertia[j]
        along, across, bend = nx[b] * du + ny[b] * dv, ny[b] * du - nx[b] * dv, turn1 - turn2
        slip = across + lever1[b] * turn1 + lever2[b] * turn2
        along_force = normal[b] * z1[b] + damp_normal[b] * along
        slip_force = shear[b] * z2[b] + damp_slip[b] * slip
        across_force = slip_force + damp_tangent[b] * across
        moment = bending[b] * z3[b] + damp_spin[b] * bend
        x, y = nx[b] * along_force + ny[b] * across_force, ny[b] * along_force - nx[b] * across_force
        to1[b], to2[b], to3[b] = 0.5 * normal[b] * along, 0.5 * shear[b] * slip, 0.5 * bending[b] * bend
        fx[i] += x
        fx[j] -= x
        fy[i] += y
        fy[j] -= y
        torque[i] += lever1[b] * slip_force + moment
        torque[j] += lever2[b] * slip_force - moment
    for e in range(count):
        fx[e] *= 0.5 * root_mass[e]
        fy[e] *= 0.5 * root_mass[e]
        torque[e] *= 0.5 * root_inertia[e]


@kernel
def _lanczos_step(vector: Floats, before: Floats, beside: float, image: Floats) -> tuple[float, float]:
    """Take out of ``image`` what lies along the two latest vectors; returns the part along ``vector`` and the size of the rest.

    ``before`` is overwritten with the rest, of length 1: the next vector.
    """
    part = 0.0
    for k in range(vector.size):
        image[k] -= beside * before[k]
        part += image[k] * vector[k]
    square = 0.0
    for k in range(vector.size):
        image[k] -= part * vector[k]
        square += image[k] * image[k]
    size = math.sqrt(square)
    scale = 1.0 / size if size > 0.0 else 0.0
    for k in range(vector.size):
        before[k] = scale * image[k]
    return part, size


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
    p: Parameters, radii: tuple[Floats, Floats], thickness: Floats, i: Ints, j: Ints
) -> tuple[Floats, Floats, Floats]:
    """Normal, shear (N m-1) and bending (N m) stiffness of undeformed bonds (equations 5.4)."""
    r1, r2 = radii
    rest = r1 + r2
    reach = np.minimum(r1, r2) / rest
    width = 2.0 * (np.minimum(r1, r2) + reach * np.abs(r1 - r2))
    small, other = np.where(r2 <= r1, (thickness[j], thickness[i]), (thickness[i], thickness[j]))
    height = small + reach * (other - small)
    if p.compatibility.bond_thickness_of_second:
        height = np.maximum(thickness[i], thickness[j]) + reach * np.abs(thickness[i] - thickness[j])
    normal = p.bonds.youngs_modulus * height * width / rest
    shear = 0.0 * normal if p.bonds.no_shear else normal / (2.0 * (1.0 + p.bonds.poisson))
    return normal, shear, normal * width**2 / 12.0


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
        return np.asarray(p.bonds.youngs_modulus / (p.ice.density * rest**2))
    return np.full(rest.shape, p.bonds.spring)


def _spring_damping(p: Parameters, stiffness: Floats) -> tuple[Floats, Floats]:
    """Radial and tangential damping (s-1) of spring bonds; 0 where it is quadratic and has no linear part (equations 5.2)."""
    c, one = p.contact, np.ones_like(stiffness)
    if c.damping_by_speed:
        return 0.0 * one, 0.0 * one
    if not c.critical_damping:
        return c.radial_damping * one, c.tangential_damping * one
    full = 2.0 * stiffness**0.5
    return full, full / 4.0 if c.tangential_critical_damping else c.tangential_damping * one


def bond_operator(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> BondOperator:
    """Linearise the unbroken bonds about the present positions, without strain."""
    on = bonds.status == 0
    i, j = bonds.first[on], bonds.second[on]
    nothing = np.zeros(i.size)
    radii = _radii_when_formed(p, bonds.rest_length[on], sizes.bond_radius[i], sizes.bond_radius[j])
    moves = np.where(elements.static < 0.5, 1.0, 0.0)
    if p.bonds.law == "dem":
        normal, shear, bending = _dem_stiffness(p, radii, elements.thickness, i, j)
        damper = _dem_damping(p, sizes, i, j)
        by_slip = (damper, nothing) if p.bonds.objective_damping else (nothing, damper)
        dampers = (damper, by_slip[0], by_slip[1], damper)
    else:
        least = np.minimum(sizes.bond_mass[i], sizes.bond_mass[j])
        stiffness = _spring_stiffness(p, radii[0] + radii[1])
        normal, shear, bending = stiffness * least, nothing, nothing
        radial, tangential = _spring_damping(p, stiffness)
        dampers = (radial * least, nothing, tangential * least, nothing)
    return BondOperator(
        np.concatenate([i, j]),
        elements.mass.size,
        *_directions(p, elements, i, j),
        *radii,
        np.sqrt(normal),
        np.sqrt(shear),
        np.sqrt(bending),
        *dampers,
        moves / np.sqrt(sizes.bond_mass),
        moves / (np.sqrt(0.5 * sizes.bond_mass) * sizes.bond_radius),
    )


def largest_eigenvalue(operator: BondOperator, accuracy: float = ACCURACY) -> float:
    """Return an upper estimate of the largest eigenvalue, s-1, by Lanczos steps from a fixed random vector.

    The residual of the Ritz vector is added to the Ritz value, so that the estimate errs to the safe side by at most
    ``accuracy``.
    """
    vector = np.random.default_rng(1).standard_normal(operator.size)
    vector /= np.linalg.norm(vector)
    before, image = np.zeros_like(vector), np.zeros_like(vector)
    diagonal: list[float] = []
    beside: list[float] = []
    for step in range(1, MOST_STEPS + 1):
        operator.apply(vector, image)
        part, rest = _lanczos_step(vector, before, beside[-1] if beside else 0.0, image)
        diagonal.append(part)
        beside.append(rest)
        # A vanishing remainder means that the vectors so far hold all of the matrix.
        exhausted = rest <= 1e-12 * max(map(abs, diagonal))
        if exhausted or step % 8 == 0 or step == MOST_STEPS:
            value, residual = _top(diagonal, beside)
            if exhausted or residual < accuracy * value:
                break
        vector, before = before, vector
    return value + residual


def _top(diagonal: list[float], beside: list[float]) -> tuple[float, float]:
    """Largest eigenvalue of the tridiagonal matrix and the residual of its Ritz vector."""
    matrix = np.diag(diagonal) + np.diag(beside[:-1], 1) + np.diag(beside[:-1], -1)
    values, vectors = np.linalg.eigh(matrix)
    return float(values[-1]), float(beside[-1] * abs(vectors[-1, -1]))
