"""Loads of fragments in equilibrium, inertia included (D'Alembert), and the bonds that they strain.

The ice of the elements bears the loads (`riftberg.engines.quasi_static.lattice.cell_stiffness`); the strain of a bond
follows from the displacements d of its ends. With its direction n (from the second end to the first) and length l:

    extension  e = n . (d1 - d2)
    slip       s = t . (d1 - d2) + r1 th1 + r2 th2        t = (n_y, -n_x),  r1 + r2 = l
    bend       b = th1 - th2
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.quasi_static.lattice.dense import find_null_space, multiply, solve_dense
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import bond_overlap, bond_section
from riftberg.state import Bonds, Floats, Ints


class ElasticLattice(NamedTuple):
    """Bonds between the elements of fragments; a row for each bond of the state, broken ones too."""

    first: Ints  # First end; shape (bonds,)
    second: Ints  # Second end; shape (bonds,)
    nx: Floats  # Direction from the second end to the first, in the frame of the fragment; shape (bonds,)
    ny: Floats  # shape (bonds,)
    length: Floats  # Without load, m; shape (bonds,)
    rest: Floats  # Rest length, m; shape (bonds,)
    width: Floats  # Of the section, m; shape (bonds,)
    thickness: Floats  # Of the section, m; shape (bonds,)
    stiffness: Floats  # Against extension, N m-1; shape (bonds,)
    radius: Floats  # Of the elements, which scales their rotations, m; shape (elements,)
    arm_first: Floats  # Slip by a rotation of the first end, m; shape (bonds,)
    arm_second: Floats  # Slip by a rotation of the second end, m; shape (bonds,)


def find_lattice(bonds: Bonds, xy: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters) -> ElasticLattice:
    """Describe all bonds, with the elements at their reference coordinates ``xy`` (m)."""
    # Section and levers are of the sizes with which a bond formed, as in the explicit schemes. Levers of sides that have
    # melted since would not add up to its length, and its shear would turn the berg.
    rest = sizes.bond_radius[bonds.first] + sizes.bond_radius[bonds.second]
    if not p.rest_length_from_sizes:
        rest = np.where(np.isnan(bonds.rest_length), rest, bonds.rest_length)
    return ElasticLattice(*_find_lattice(bonds.first, bonds.second, rest, xy, thickness, sizes, p))


@kernel
def _find_lattice(
    first: Ints, second: Ints, rest: Floats, xy: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters
) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    """Return the fields of `ElasticLattice` (no named tuple: see `riftberg.compiled.kernels`)."""
    count = first.size
    nx, ny, length = np.zeros(count), np.zeros(count), np.zeros(count)
    width, height = np.zeros(count), np.zeros(count)
    stiffness, arm_first, arm_second = np.zeros(count), np.zeros(count), np.zeros(count)
    radius = sizes.bond_radius
    for b in range(count):
        i, j = first[b], second[b]
        formed = rest[b] / (radius[i] + radius[j])
        r1, r2, t1, t2 = formed * radius[i], formed * radius[j], thickness[i], thickness[j]
        rx, ry = xy[i, 0] - xy[j, 0], xy[i, 1] - xy[j, 1]
        length[b] = np.sqrt(rx * rx + ry * ry)
        nx[b], ny[b] = rx / length[b], ry / length[b]
        half = bond_overlap(rest[b], length[b])
        small, other = (t1, t2) if r1 <= r2 else (t2, t1)
        width[b], height[b] = bond_section(min(r1, r2), abs(r1 - r2), small, other - small, half, 1.0 / length[b])
        arm_first[b], arm_second[b] = r1 - half, r2 - half
        stiffness[b] = p.youngs_modulus * height[b] * width[b] / rest[b]
    return first, second, nx, ny, length, rest, width, height, stiffness, radius, arm_first, arm_second


@kernel
def bond_deformation(lattice: ElasticLattice, b: int, displacement: Floats) -> tuple[float, float, float]:
    """Extension, slip (m) and bend (rad) of a bond by the displacements of the elements."""
    i, j, nx, ny = lattice.first[b], lattice.second[b], lattice.nx[b], lattice.ny[b]
    x, y = displacement[i, 0] - displacement[j, 0], displacement[i, 1] - displacement[j, 1]
    slip = ny * x - nx * y
    slip += lattice.arm_first[b] * displacement[i, 2] + lattice.arm_second[b] * displacement[j, 2]
    return nx * x + ny * y, slip, displacement[i, 2] - displacement[j, 2]


@kernel
def bond_deformations(lattice: ElasticLattice, intact: Ints, displacement: Floats) -> Floats:
    """Extension, slip (m) and bend (rad) of the intact bonds, shape (intact bonds, 3)."""
    deformation = np.empty((intact.size, 3))
    for k in range(intact.size):
        e, s, bend = bond_deformation(lattice, intact[k], displacement)
        deformation[k, 0], deformation[k, 1], deformation[k, 2] = e, s, bend
    return deformation


@kernel
def balanced_loads(
    body: Ints, xy: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats, spin: Floats
) -> Floats:
    """Loads on the lattice in the axes of its fragment: forces less those that move it as a rigid body (D'Alembert).

    ``xy``: reference coordinates, m; ``turn``: cosine and sine of the angle of the fragment's axis from local east (elements,
    2); ``force``: N, N, N m (elements, 3); ``mass``, ``inertia``: kg, kg m2; ``spin``: rad s-1 (fragments,).
    """
    load, twist = np.empty((body.size, 3)), np.zeros((spin.size, 3))
    for b in range(spin.size):  # an assignment of whole arrays takes seconds to compile
        twist[b, 2] = spin[b]
    balance_loads(body, xy, turn, 0, force, mass, inertia, twist, np.empty((spin.size, 7)), load)
    return load


@kernel
def balance_loads(
    body: Ints, xy: Floats, turn: Floats, column: int, force: Floats, mass: Floats, inertia: Floats, twist: Floats,
    sums: Floats, load: Floats,
) -> None:  # fmt: skip
    """Find `balanced_loads`, with ``turn`` in two columns from ``column`` on and the spin in the last one of ``twist``."""
    # Columns of sums: acceleration of the centre (2), angular acceleration, centre of mass (2), mass, moment of inertia.
    sums[:, :] = 0.0
    for e in range(body.size):
        b, c, s = body[e], turn[e, column], turn[e, column + 1]
        fx, fy = force[e, 0], force[e, 1]
        load[e, 0], load[e, 1], load[e, 2] = c * fx + s * fy, c * fy - s * fx, force[e, 2]
        sums[b, 5] += mass[e]
        for i in range(2):
            sums[b, 3 + i] += mass[e] * xy[e, i]
            sums[b, i] += load[e, i]
    for b in range(sums.shape[0]):
        for i in range(2):
            sums[b, 3 + i] /= sums[b, 5]
            sums[b, i] /= sums[b, 5]
    for e in range(body.size):
        b = body[e]
        x, y = xy[e, 0] - sums[b, 3], xy[e, 1] - sums[b, 4]
        sums[b, 6] += mass[e] * (x * x + y * y) + inertia[e]
        sums[b, 2] += x * load[e, 1] - y * load[e, 0] + load[e, 2]
    for b in range(sums.shape[0]):
        sums[b, 2] /= sums[b, 6]
    for e in range(body.size):
        b, m = body[e], mass[e]
        x, y = xy[e, 0] - sums[b, 3], xy[e, 1] - sums[b, 4]
        turning, square = sums[b, 2], twist[b, 2] ** 2
        load[e, 0] -= m * (sums[b, 0] - turning * y - square * x)
        load[e, 1] -= m * (sums[b, 1] + turning * x - square * y)
        load[e, 2] -= inertia[e] * turning


class Supports:
    """Freedoms that supports take from the elements, and where gauge springs go so that K can be factored.

    ``free``: 0 where a support takes the freedom, else 1 (3 elements,).
    """

    def __init__(self, static: Floats, free_y: Floats) -> None:
        free = np.ones((static.size, 3))
        free[static >= 0.5] = 0.0
        free[free_y < 0.5, 1] = 0.0
        self.free = free.ravel()
        self._supported = (free < 1.0).any(axis=1)
        self.any = bool(self._supported.any())

    def gauge_springs(self, body: Ints, xy: Floats) -> Ints:
        """Freedoms for gauge springs: of each fragment as many as it has rigid motions left.

        Of the element nearest to its centre; with supports, of the first supported element.
        """
        count = int(body.max()) + 1
        distance = np.hypot(xy[:, 0], xy[:, 1])
        order = np.lexsort((distance, body))
        central = order[np.searchsorted(body[order], np.arange(count))]
        unsupported = np.ones(count, bool)
        chosen: list[int] = []
        for b in np.unique(body[self._supported]):
            unsupported[b] = False
            inside = np.flatnonzero((body == b) & self._supported)
            rows = [rigid_mode_row(xy[e], k) for e in inside for k in range(3) if self.free[3 * e + k] == 0.0]
            for k in range(3):
                # A spring on a motion that the supports take already is left out: it would carry load.
                trial = [*rows, rigid_mode_row(xy[inside[0]], k)]
                if self.free[3 * inside[0] + k] > 0.0 and _rank(trial) > _rank(rows):
                    chosen.append(int(3 * inside[0] + k))
                    rows = trial
        unsupported_freedoms = (3 * central[unsupported][:, None] + np.arange(3)).ravel()
        return np.sort(np.concatenate([unsupported_freedoms, np.array(chosen, np.int64)])).astype(np.int64)

    def rigid_modes(self, inside: Ints, xy: Floats) -> Floats:
        """Rigid motions (columns; rows: east, north, rotation) that the supports of one fragment allow."""
        rows = [rigid_mode_row(xy[e], k) for e in inside for k in range(3) if self.free[3 * e + k] == 0.0]
        if not rows:
            return np.eye(3)
        scaled = np.array(rows)
        length = max(float(np.abs(scaled[:, 2]).max()), 1.0)
        scale = np.array([1.0, 1.0, length])
        return np.asarray(find_null_space(scaled / scale, 1e-9) / scale[:, None])


def find_mobility(inertia: Floats, z: Floats) -> Floats:
    """Return the velocities by a unit of each force (kg-1) of a body that moves by the motions ``z`` (columns) alone."""
    return multiply(z, solve_dense(multiply(z.T, multiply(inertia, z)), z.T)) if z.size else np.zeros(inertia.shape)


def rigid_mode_row(position: Floats, freedom: int) -> Floats:
    """Displacement of a freedom of an element at a position (m) by a unit of each rigid motion (east, north, rotation)."""
    return np.array([[1.0, 0.0, -position[1]], [0.0, 1.0, position[0]], [0.0, 0.0, 1.0]][freedom])


def _rank(rows: list[Floats]) -> int:
    if not rows:
        return 0
    a = np.array(rows)
    return int(np.linalg.matrix_rank(a / np.maximum(np.abs(a).max(axis=0), 1.0), tol=1e-9))


def supported_loads(
    inside: Ints, z: Floats, xy: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats
) -> Floats:
    """Loads on a fragment with supports: forces less the inertia of the rigid motions ``z`` that they allow."""
    c, s, f, m = turn[inside, 0], turn[inside, 1], force[inside], mass[inside]
    load = np.column_stack([c * f[:, 0] + s * f[:, 1], c * f[:, 1] - s * f[:, 0], f[:, 2]])
    if not z.size:
        return load
    x, y = xy[inside].T
    ones, zeros = np.ones(inside.size), np.zeros(inside.size)
    rows = np.stack([np.array([ones, zeros, -y]), np.array([zeros, ones, x]), np.array([zeros, zeros, ones])])
    weight = np.stack([m, m, inertia[inside]])
    matrix = np.einsum("ran,rn,rbn->ab", rows, weight, rows)
    sums = np.einsum("ran,nr->a", rows, load)
    acceleration = multiply(find_mobility(matrix, z), sums)
    return np.asarray(load - (weight * np.einsum("ran,a->rn", rows, acceleration)).T)


def elastic_energy(displacement: Floats, load: Floats) -> float:
    """Energy (J) that the lattice stores: half the work of its loads."""
    return 0.5 * float((displacement * load).sum())


def released_energy(old: Floats, old_load: Floats, new: Floats, new_load: Floats) -> float:
    """Energy (J) that a crack releases: stored energy and work of the loads, on the way to the equilibrium with the crack.

    With U = d.f / 2 it is ``U(old) - U(new) + f(new).(d(new) - d(old))``, which is never negative; under constant
    loads it is half of their work, and the lattice stores the other half. Where a piece parts, the new loads act on the
    pieces, each balanced by its own inertia: they do no work as the pieces move apart.
    """
    return elastic_energy(old, old_load - new_load) + elastic_energy(new - old, new_load)
