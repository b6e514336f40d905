"""Static equilibrium of the lattices of all fragments under their loads, inertia included.

For each bond with direction n (from the second end to the first), length l, section w H and rest length l_0:

    extension  e = n . (d1 - d2)                          k_n = E H w / l_0
    slip       s = t . (d1 - d2) + r1 th1 + r2 th2        k_s = k_n / (2 (1 + nu)),  t = (n_y, -n_x),  r1 + r2 = l
    bend       b = th1 - th2                              k_b = k_n w^2 / 12

``K d = b`` with the loads b in balance. The matrix is singular by the rigid motions of each fragment, so three springs
hold one element of each: as the loads are in balance they carry nothing, which is the check of every solve. Turns are
measured as paths at the rim of the element (m), so that all unknowns are of one size.

The matrix is factored by blocks of one element (`riftberg.stepping.lattice.block_ldl`).
A bond that breaks takes three columns off it. The factors are kept and corrected for it (Woodbury's formula);
springs that hold a piece that parts are columns of the same kind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import bond_section, overlap, shear_stress_of, tensile_stress
from riftberg.state import Bonds, Floats, Ints
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.block_ldl import BlockFactors

BALANCE = 1e-5
"""Largest force on a holding spring, as a part of the largest load, before a solve counts as failed."""

NO_GIVE = 1e-9
"""A spring that gives less than this (m) carries nothing but round-off: a berg that goes with the water has no loads."""


class ElasticLattice(NamedTuple):
    """Bonds as springs between elements; all arrays have one row for each bond of the state, broken ones too.

    ``rows`` are the 3 x 6 matrices that give extension, slip and bend of a bond from the displacements of its ends;
    ``stiffness`` its three springs; ``nx``, ``ny`` its direction in the frame of its fragment; ``length``, ``rest``,
    ``width``, ``thickness`` in metres; ``radius`` of the elements (m) scales their turns, ``arm_first`` and
    ``arm_second`` (m) are the slip by a turn of either end.
    """

    first: Ints
    second: Ints
    nx: Floats
    ny: Floats
    length: Floats
    rest: Floats
    width: Floats
    thickness: Floats
    rows: Floats
    stiffness: Floats
    radius: Floats
    arm_first: Floats
    arm_second: Floats


def find_lattice(bonds: Bonds, flat: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters) -> ElasticLattice:
    """Describe all bonds as springs, at the places ``flat`` (m) of the elements in their fragments.

    Section and levers are those of the bond law of the sub-steps (`riftberg.stepping.explicit.tile_kernels`): of the sizes
    with which a bond formed. Levers of sides that melt since would not add up to its length, and its shear would turn
    the berg.
    """
    rest = sizes.bond_radius[bonds.first] + sizes.bond_radius[bonds.second]
    if not p.rest_length_from_sizes:
        rest = np.where(np.isnan(bonds.rest_length), rest, bonds.rest_length)
    return ElasticLattice(*_find_lattice(bonds.first, bonds.second, rest, flat, thickness, sizes, p))


@kernel
def _find_lattice(
    first: Ints, second: Ints, rest: Floats, flat: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters
) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    """Return the fields of `ElasticLattice`; see `riftberg.compiled.kernels` why no named tuple."""
    count = first.size
    nx, ny, length = np.zeros(count), np.zeros(count), np.zeros(count)
    width, height = np.zeros(count), np.zeros(count)
    rows, stiffness = np.zeros((count, 3, 6)), np.zeros((count, 3))
    arm_first, arm_second = np.zeros(count), np.zeros(count)
    radius = sizes.bond_radius
    for b in range(count):
        i, j = first[b], second[b]
        formed = rest[b] / (radius[i] + radius[j])
        r1, r2, t1, t2 = formed * radius[i], formed * radius[j], thickness[i], thickness[j]
        rx, ry = flat[i, 0] - flat[j, 0], flat[i, 1] - flat[j, 1]
        length[b] = np.sqrt(rx * rx + ry * ry)
        nx[b], ny[b] = rx / length[b], ry / length[b]
        half = overlap(rest[b], length[b])
        small, other = (t1, t2) if r1 <= r2 else (t2, t1)
        width[b], height[b] = bond_section(min(r1, r2), abs(r1 - r2), small, other - small, half, 1.0 / length[b])
        arm_first[b], arm_second[b] = r1 - half, r2 - half
        m = rows[b]
        m[0, 0], m[0, 1], m[0, 3], m[0, 4] = nx[b], ny[b], -nx[b], -ny[b]
        m[1, 0], m[1, 1], m[1, 3], m[1, 4] = ny[b], -nx[b], -ny[b], nx[b]
        m[1, 2], m[1, 5] = arm_first[b] / radius[i], arm_second[b] / radius[j]
        m[2, 2], m[2, 5] = 1.0 / radius[i], -1.0 / radius[j]
        stiffness[b, 0] = p.youngs_modulus * height[b] * width[b] / rest[b]
        stiffness[b, 1] = stiffness[b, 0] * 0.5 / (1.0 + p.poisson)
        stiffness[b, 2] = stiffness[b, 0] * width[b] ** 2 / 12.0
    return first, second, nx, ny, length, rest, width, height, rows, stiffness, radius, arm_first, arm_second


@kernel
def _blocks(lattice: ElasticLattice, alive: Ints, free: Floats, held: Floats) -> tuple[Floats, Floats]:
    """Blocks of the matrix: of the elements, and of the bonds that hold in the row of the first and the column of the second end.

    Freedoms that are not free stand alone with the stiffness of their bonds; ``held`` is added to the diagonal.
    """
    diagonal, between = np.zeros((free.size // 3, 3, 3)), np.zeros((alive.size, 3, 3))
    for x in range(free.size):
        diagonal[x // 3, x % 3, x % 3] = held[x]
    for k in range(alive.size):
        b = alive[k]
        m, at = lattice.rows[b], (3 * lattice.first[b], 3 * lattice.second[b])
        for a in range(6):
            x = at[a // 3] + a % 3
            for c in range(6):
                y = at[c // 3] + c % 3
                value = 0.0
                for s in range(3):
                    value += lattice.stiffness[b, s] * m[s, a] * m[s, c]
                value *= free[x] * free[y] if x != y else 1.0
                if a // 3 == c // 3:
                    diagonal[x // 3, a % 3, c % 3] += value
                elif a < 3:
                    between[k, a, c - 3] = value
    return diagonal, between


@kernel
def deformed(lattice: ElasticLattice, bend: Floats, b: int) -> tuple[float, float, float]:
    """Extension, slip (m) and bend (rad) of a bond, with turns of the ends in rad."""
    i, j = lattice.first[b], lattice.second[b]
    nx, ny, x, y = lattice.nx[b], lattice.ny[b], bend[i, 0] - bend[j, 0], bend[i, 1] - bend[j, 1]
    s = ny * x - nx * y
    s += lattice.arm_first[b] * bend[i, 2] + lattice.arm_second[b] * bend[j, 2]
    return nx * x + ny * y, s, bend[i, 2] - bend[j, 2]


def bond_stresses(lattice: ElasticLattice, alive: Ints, bend: Floats, p: KernelParameters) -> Floats:
    """Tensile and shear stress (Pa) of the bonds that hold, shape (bonds that hold, 2)."""
    return deformations_and_stresses(lattice, alive, bend, p)[1]


def deformations_and_stresses(
    lattice: ElasticLattice, alive: Ints, bend: Floats, p: KernelParameters
) -> tuple[Floats, Floats]:
    """Extension, slip (m) and bend (rad) of the bonds that hold, and their tensile and shear stress (Pa), a row for each."""
    deformation, stress = np.empty((alive.size, 3)), np.empty((alive.size, 2))
    # Two numbers instead of all parameters: these take as long to hand over as the stresses of a small berg.
    _stresses(lattice, alive, bend, p.youngs_modulus, p.poisson, deformation, stress)
    return deformation, stress


@borrower
def _stresses(
    lattice: ElasticLattice,
    alive: Ints,
    bend: Floats,
    youngs: float,
    poisson: float,
    deformation: Floats,
    stress: Floats,
) -> None:
    """Fill what `deformations_and_stresses` returns."""
    for k in range(alive.size):
        b = alive[k]
        e, s, angle = deformed(lattice, bend, b)
        deformation[k, 0], deformation[k, 1], deformation[k, 2] = e, s, angle
        stress[k, 0] = tensile_stress(youngs / lattice.rest[b], -0.5 * e, angle, lattice.width[b])
        stress[k, 1] = shear_stress_of(youngs / lattice.rest[b], poisson, abs(s))


@kernel
def balanced_loads(
    body: Ints, flat: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats, spin: Floats
) -> Floats:
    """Loads on the lattice in the axes of its fragment: forces less those that move it as a rigid body.

    ``body``:  (shape (elements,)); ``flat``: places in the fragment, m (shape (elements, 2)); ``turn``: cosine and sine
    of the angle of the fragment's axis against local east (shape (elements, 2)); ``force``: east, north (N) and torque
    (N m) (shape (elements, 3)); ``mass``, ``inertia``:  (shape (elements,)); ``spin``: rad s-1 (shape (fragments,));
    returns n, N and N m.
    """
    load, rate = np.empty((body.size, 3)), np.zeros((spin.size, 3))
    rate[:, 2] = spin
    balance_loads(body, flat, turn, 0, force, mass, inertia, rate, np.empty((spin.size, 7)), load)
    return load


@kernel
def balance_loads(
    body: Ints, flat: Floats, turn: Floats, column: int, force: Floats, mass: Floats, inertia: Floats, rate: Floats,
    sums: Floats, load: Floats,
) -> None:  # fmt: skip
    """Fill what `balanced_loads` returns.

    ``turn`` stands in two columns from ``column`` on, the spin in the last one of ``rate``; ``sums`` (fragments, 7) is
    room.
    """
    # Columns: sums of the loads (3), centre of mass (2), mass, moment of inertia.
    sums[:, :] = 0.0
    for e in range(body.size):
        b, c, s = body[e], turn[e, column], turn[e, column + 1]
        fx, fy = force[e, 0], force[e, 1]
        load[e, 0], load[e, 1], load[e, 2] = c * fx + s * fy, c * fy - s * fx, force[e, 2]
        sums[b, 5] += mass[e]
        for i in range(2):
            sums[b, 3 + i] += mass[e] * flat[e, i]
            sums[b, i] += load[e, i]
    for b in range(sums.shape[0]):
        for i in range(2):
            sums[b, 3 + i] /= sums[b, 5]
            sums[b, i] /= sums[b, 5]
    for e in range(body.size):
        b = body[e]
        x, y = flat[e, 0] - sums[b, 3], flat[e, 1] - sums[b, 4]
        sums[b, 6] += mass[e] * (x * x + y * y) + inertia[e]
        sums[b, 2] += x * load[e, 1] - y * load[e, 0] + load[e, 2]
    for b in range(sums.shape[0]):
        sums[b, 2] /= sums[b, 6]
    for e in range(body.size):
        b, m = body[e], mass[e]
        x, y = flat[e, 0] - sums[b, 3], flat[e, 1] - sums[b, 4]
        turning, square = sums[b, 2], rate[b, 2] ** 2
        load[e, 0] -= m * (sums[b, 0] - turning * y - square * x)
        load[e, 1] -= m * (sums[b, 1] + turning * x - square * y)
        load[e, 2] -= inertia[e] * turning


class Holds:
    """Freedoms that supports hold, and those that springs hold so that the matrix can be solved.

    ``free``: 0 where a support holds the freedom, else 1 (shape (3 elements,)).
    """

    def __init__(self, static: Floats, free_y: Floats) -> None:
        free = np.ones((static.size, 3))
        free[static >= 0.5] = 0.0
        free[free_y < 0.5, 1] = 0.0
        self.free = free.ravel()
        self._supported = (free < 1.0).any(axis=1)
        self.any = bool(self._supported.any())

    def springs(self, body: Ints, flat: Floats) -> Ints:
        """Freedoms to hold by springs: of each fragment those that its supports leave to it as a rigid body.

        Those of the element nearest to the middle of the fragment; with supports, of the first supported one.
        """
        count = int(body.max()) + 1
        far = np.hypot(flat[:, 0], flat[:, 1])
        order = np.lexsort((far, body))
        middle = order[np.searchsorted(body[order], np.arange(count))]
        held = np.ones(count, bool)
        chosen: list[int] = []
        for b in np.unique(body[self._supported]):
            held[b] = False
            inside = np.flatnonzero((body == b) & self._supported)
            chosen += self._left(inside, flat)
        plain = (3 * middle[held][:, None] + np.arange(3)).ravel()
        return np.sort(np.concatenate([plain, np.array(chosen, np.int64)])).astype(np.int64)

    def _left(self, inside: Ints, flat: Floats) -> list[int]:
        """Freedoms of the first supported element that the supports of this fragment do not settle."""
        rows = [rigid_row(flat[e], k) for e in inside for k in range(3) if self.free[3 * e + k] == 0.0]
        chosen: list[int] = []
        for k in range(3):
            trial = [*rows, rigid_row(flat[inside[0]], k)]
            if self.free[3 * inside[0] + k] > 0.0 and _rank(trial) > _rank(rows):
                chosen.append(int(3 * inside[0] + k))
                rows = trial
        return chosen

    def modes(self, inside: Ints, flat: Floats) -> Floats:
        """Rigid motions (columns: east, north, turn) that the supports of one fragment allow."""
        rows = [rigid_row(flat[e], k) for e in inside for k in range(3) if self.free[3 * e + k] == 0.0]
        if not rows:
            return np.eye(3)
        scaled = np.array(rows)
        length = max(float(np.abs(scaled[:, 2]).max()), 1.0)
        _, size, axes = np.linalg.svd(scaled / [1.0, 1.0, length])
        rank = int((size > 1e-9 * size[0]).sum())
        return np.asarray(axes[rank:].T / np.array([1.0, 1.0, length])[:, None])


def rigid_row(place: Floats, freedom: int) -> Floats:
    """How a freedom of an element at a place (m) moves with a rigid motion (east, north, turn)."""
    return np.array([[1.0, 0.0, -place[1]], [0.0, 1.0, place[0]], [0.0, 0.0, 1.0]][freedom])


def _rank(rows: list[Floats]) -> int:
    if not rows:
        return 0
    a = np.array(rows)
    return int(np.linalg.matrix_rank(a / np.maximum(np.abs(a).max(axis=0), 1.0), tol=1e-9))


class Factors:
    """Factors of the stiffness matrix, with corrections for bonds that have broken since."""

    def __init__(self, lattice: ElasticLattice, alive: Ints, holds: Holds, springs: Ints) -> None:
        self._lattice, self._free = lattice, holds.free
        self.spring = float(lattice.stiffness[alive, 0].mean()) if alive.size else 1.0
        held = np.where(holds.free > 0.0, 0.0, self.spring)
        held[springs] += self.spring
        # An element without bonds has nothing else to hold it.
        lone = np.ones(holds.free.size // 3, bool)
        lone[lattice.first[alive]] = lone[lattice.second[alive]] = False
        held[np.repeat(lone, 3)] = self.spring
        # What it carries is rounding, which is all that there is where every element stands alone.
        self._springs = springs[~lone[springs // 3]]
        diagonal, between = _blocks(lattice, alive, holds.free, held)
        self._factors = BlockFactors(lattice.first[alive], lattice.second[alive], diagonal, between)
        self._columns: list[Floats] = []
        self._solved: list[Floats] = []
        self._signs: list[float] = []

    @property
    def corrections(self) -> int:
        """Columns by which the factors are corrected."""
        return len(self._columns)

    @property
    def memory(self) -> int:
        """Bytes of the factors, which a solve reads twice."""
        return self._factors.memory

    def without(self, bond: int) -> None:
        """Take a bond out."""
        i, j = self._lattice.first[bond], self._lattice.second[bond]
        at = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
        for s in range(3):
            column = np.zeros(self._free.size)
            column[at] = np.sqrt(self._lattice.stiffness[bond, s]) * self._lattice.rows[bond, s]
            self._add(column * self._free, -1.0)

    def hold(self, freedom: int) -> None:
        """Hold a freedom by a spring."""
        column = np.zeros(self._free.size)
        column[freedom] = np.sqrt(self.spring)
        self._springs = np.append(self._springs, freedom)
        self._add(column, 1.0)

    def _add(self, column: Floats, sign: float) -> None:
        self._columns.append(column)
        self._solved.append(self._factors.solve(column))
        self._signs.append(sign)

    def solve(self, load: Floats) -> Floats:
        """Displacements (m, m, rad), shape (elements, 3), under loads in balance (N, N, N m)."""
        bend = np.empty(load.shape)
        size = self._factors.solve_scaled(load, self._lattice.radius, self._free, bend)
        if self._columns:
            self._correct(bend)
        self._check(float(give_of(bend, self._springs)), size, load)
        bend[:, 2] /= self._lattice.radius
        return bend

    def _correct(self, bend: Floats) -> None:
        """Take account of the bonds that have broken, in place (Woodbury)."""
        x = bend.reshape(-1)
        w, a = np.array(self._columns), np.array(self._solved)
        small = np.diag(self._signs) + w @ a.T
        x -= a.T @ np.linalg.solve(small, w @ x)

    def _check(self, give: float, size: float, load: Floats) -> None:
        force = give * self.spring
        if not (force <= BALANCE * size or give <= NO_GIVE):
            unknown = np.flatnonzero(~np.isfinite(load).all(axis=1))
            if unknown.size:
                raise RunError(
                    f"element {unknown[0] + 1} has no finite load: the water, air, floor or ice there is not a number"
                )
            raise RunError(
                f"the lattice is not in equilibrium: a freedom that should be free carries {force:.3g} N of loads of up to "
                f"{size:.3g} N; bonds without shear stiffness or a mechanism cannot be held (stepping.scheme: mts can)"
            )


@borrower
def give_of(bend: Floats, springs: Ints) -> float:
    """Largest displacement (m) of the freedoms that springs hold; not a number where one is none."""
    most = 0.0
    for n in range(springs.size):
        x = abs(bend[springs[n] // 3, springs[n] % 3])
        if not x <= most:
            most = x
            if x != x:
                break
    return most


def elastic_energy(bend: Floats, load: Floats) -> float:
    """Energy (J) that the lattice stores: half the work of its loads."""
    return 0.5 * float((bend * load).sum())
