"""Static equilibrium of the lattices of all fragments under their loads, inertia included (D'Alembert).

For each bond with direction n (from the second end to the first), length l, section w H and rest length l_0:

    extension  e = n . (d1 - d2)                          k_n = E H w / l_0
    slip       s = t . (d1 - d2) + r1 th1 + r2 th2        k_s = k_n / (2 (1 + nu)),  t = (n_y, -n_x),  r1 + r2 = l
    bend       b = th1 - th2                              k_b = k_n w^2 / 12

With the strain operator B of a bond, which gives (e, s, b) from the displacements of its ends, the stiffness matrix is
``K = sum B^T diag(k_n, k_s, k_b) B``, and ``K d = b`` under balanced loads b. K is singular by the rigid motions of each
fragment, so three gauge springs fix one element of each: as the loads are in balance they carry nothing, and what they
carry is the residual of every solve. Rotations are measured as paths at the rim of the element (m), so that all unknowns
are of one size.

K is factored by blocks of one element (`riftberg.stepping.lattice.block_ldl`). A bond that breaks takes three columns off
it: the factors are kept, and corrected for these (a downdate of low rank by Woodbury's formula).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import bond_overlap, bond_section, shear_stress_of, tensile_stress
from riftberg.state import Bonds, Floats, Ints
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.block_ldl import BlockLDL

EQUILIBRIUM_RTOL = 1e-5
"""Largest force on a gauge spring, as a part of the largest load, before a solve counts as failed."""

GAUGE_ATOL = 1e-9
"""Displacement (m) of a gauge spring that counts as round-off: a berg that moves with the water has no loads to compare with."""


ROUND_OFF = 1e-10
"""The same as a part of the largest displacement: two pieces on their last bond move far, and round-off with them."""


class ElasticLattice(NamedTuple):
    """Bonds as springs between elements; a row for each bond of the state, broken ones too."""

    first: Ints  # First end; shape (bonds,)
    second: Ints  # Second end; shape (bonds,)
    nx: Floats  # Direction from the second end to the first, in the frame of the fragment; shape (bonds,)
    ny: Floats  # shape (bonds,)
    length: Floats  # Without load, m; shape (bonds,)
    rest: Floats  # Rest length, m; shape (bonds,)
    width: Floats  # Of the section, m; shape (bonds,)
    thickness: Floats  # Of the section, m; shape (bonds,)
    strain_operator: Floats  # B: extension, slip and bend by the displacements of both ends; shape (bonds, 3, 6)
    stiffness: Floats  # Of extension and slip (N m-1) and of bend (N m); shape (bonds, 3)
    radius: Floats  # Of the elements, which scales their rotations, m; shape (elements,)
    arm_first: Floats  # Slip by a rotation of the first end, m; shape (bonds,)
    arm_second: Floats  # Slip by a rotation of the second end, m; shape (bonds,)


def find_lattice(bonds: Bonds, xy: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters) -> ElasticLattice:
    """Describe all bonds as springs, with the elements at their reference coordinates ``xy`` (m)."""
    # Section and levers are of the sizes with which a bond formed, as in the explicit schemes. Levers of sides that have
    # melted since would not add up to its length, and its shear would turn the berg.
    rest = sizes.bond_radius[bonds.first] + sizes.bond_radius[bonds.second]
    if not p.rest_length_from_sizes:
        rest = np.where(np.isnan(bonds.rest_length), rest, bonds.rest_length)
    return ElasticLattice(*_find_lattice(bonds.first, bonds.second, rest, xy, thickness, sizes, p))


@kernel
def _find_lattice(
    first: Ints, second: Ints, rest: Floats, xy: Floats, thickness: Floats, sizes: Sizes, p: KernelParameters
) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    """Return the fields of `ElasticLattice` (no named tuple: see `riftberg.compiled.kernels`)."""
    count = first.size
    nx, ny, length = np.zeros(count), np.zeros(count), np.zeros(count)
    width, height = np.zeros(count), np.zeros(count)
    strain_operator, stiffness = np.zeros((count, 3, 6)), np.zeros((count, 3))
    arm_first, arm_second = np.zeros(count), np.zeros(count)
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
        m = strain_operator[b]
        m[0, 0], m[0, 1], m[0, 3], m[0, 4] = nx[b], ny[b], -nx[b], -ny[b]
        m[1, 0], m[1, 1], m[1, 3], m[1, 4] = ny[b], -nx[b], -ny[b], nx[b]
        m[1, 2], m[1, 5] = arm_first[b] / radius[i], arm_second[b] / radius[j]
        m[2, 2], m[2, 5] = 1.0 / radius[i], -1.0 / radius[j]
        stiffness[b, 0] = p.youngs_modulus * height[b] * width[b] / rest[b]
        stiffness[b, 1] = stiffness[b, 0] * 0.5 / (1.0 + p.poisson)
        stiffness[b, 2] = stiffness[b, 0] * width[b] ** 2 / 12.0
    return first, second, nx, ny, length, rest, width, height, strain_operator, stiffness, radius, arm_first, arm_second


@kernel
def _blocks(lattice: ElasticLattice, intact: Ints, free: Floats, added: Floats) -> tuple[Floats, Floats]:
    """Blocks of K: of the elements, and of the intact bonds in the row of their first and the column of their second end.

    ``added`` goes on the diagonal. Freedoms that are not ``free`` are uncoupled: they keep their diagonal alone.
    """
    diagonal, between = np.zeros((free.size // 3, 3, 3)), np.zeros((intact.size, 3, 3))
    for x in range(free.size):
        diagonal[x // 3, x % 3, x % 3] = added[x]
    for k in range(intact.size):
        b = intact[k]
        m, at = lattice.strain_operator[b], (3 * lattice.first[b], 3 * lattice.second[b])
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
def bond_deformation(lattice: ElasticLattice, displacement: Floats, b: int) -> tuple[float, float, float]:
    """Extension, slip (m) and bend (rad) of a bond, with turns of the ends in rad."""
    i, j = lattice.first[b], lattice.second[b]
    nx, ny, x, y = (
        lattice.nx[b],
        lattice.ny[b],
        displacement[i, 0] - displacement[j, 0],
        displacement[i, 1] - displacement[j, 1],
    )
    s = ny * x - nx * y
    s += lattice.arm_first[b] * displacement[i, 2] + lattice.arm_second[b] * displacement[j, 2]
    return nx * x + ny * y, s, displacement[i, 2] - displacement[j, 2]


def deformations_and_stresses(
    lattice: ElasticLattice, intact: Ints, displacement: Floats, p: KernelParameters
) -> tuple[Floats, Floats]:
    """Extension, slip (m) and bend (rad) of the intact bonds, and their tensile and shear stress (Pa), a row for each."""
    deformation, stress = np.empty((intact.size, 3)), np.empty((intact.size, 2))
    # Two numbers instead of all parameters: to pass those takes as long as the stresses of a small berg.
    _stresses(lattice, intact, displacement, p.youngs_modulus, p.poisson, deformation, stress)
    return deformation, stress


@borrower
def _stresses(
    lattice: ElasticLattice,
    intact: Ints,
    displacement: Floats,
    youngs: float,
    poisson: float,
    deformation: Floats,
    stress: Floats,
) -> None:
    """Fill what `deformations_and_stresses` returns."""
    for k in range(intact.size):
        b = intact[k]
        e, s, angle = bond_deformation(lattice, displacement, b)
        deformation[k, 0], deformation[k, 1], deformation[k, 2] = e, s, angle
        stress[k, 0] = tensile_stress(youngs / lattice.rest[b], -0.5 * e, angle, lattice.width[b])
        stress[k, 1] = shear_stress_of(youngs / lattice.rest[b], poisson, abs(s))


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

        Those of the element nearest to its centre; with supports, those of the first supported element.
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
                # A spring that would take nothing beyond what the supports take is left out: it would carry load.
                trial = [*rows, rigid_mode_row(xy[inside[0]], k)]
                if self.free[3 * inside[0] + k] > 0.0 and _rank(trial) > _rank(rows):
                    chosen.append(int(3 * inside[0] + k))
                    rows = trial
        whole = (3 * central[unsupported][:, None] + np.arange(3)).ravel()
        return np.sort(np.concatenate([whole, np.array(chosen, np.int64)])).astype(np.int64)

    def rigid_modes(self, inside: Ints, xy: Floats) -> Floats:
        """Rigid motions (columns; rows: east, north, rotation) that the supports of one fragment allow."""
        rows = [rigid_mode_row(xy[e], k) for e in inside for k in range(3) if self.free[3 * e + k] == 0.0]
        if not rows:
            return np.eye(3)
        scaled = np.array(rows)
        length = max(float(np.abs(scaled[:, 2]).max()), 1.0)
        _, size, axes = np.linalg.svd(scaled / [1.0, 1.0, length])
        rank = int((size > 1e-9 * size[0]).sum())
        return np.asarray(axes[rank:].T / np.array([1.0, 1.0, length])[:, None])


def rigid_mode_row(place: Floats, freedom: int) -> Floats:
    """Displacement of a freedom of an element at a place (m) by a unit of each rigid motion (east, north, rotation)."""
    return np.array([[1.0, 0.0, -place[1]], [0.0, 1.0, place[0]], [0.0, 0.0, 1.0]][freedom])


def _rank(rows: list[Floats]) -> int:
    if not rows:
        return 0
    a = np.array(rows)
    return int(np.linalg.matrix_rank(a / np.maximum(np.abs(a).max(axis=0), 1.0), tol=1e-9))


def supported_loads(
    inside: Ints, z: Floats, xy: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats
) -> Floats:
    """Loads on a fragment with supports: forces less what moves it in the rigid motions ``z`` that they allow."""
    c, s, f, m = turn[inside, 0], turn[inside, 1], force[inside], mass[inside]
    load = np.column_stack([c * f[:, 0] + s * f[:, 1], c * f[:, 1] - s * f[:, 0], f[:, 2]])
    if not z.size:
        return load
    x, y = xy[inside].T
    one, none = np.ones(inside.size), np.zeros(inside.size)
    rows = np.stack([np.array([one, none, -y]), np.array([none, one, x]), np.array([none, none, one])])
    weight = np.stack([m, m, inertia[inside]])
    matrix = np.einsum("ran,rn,rbn->ab", rows, weight, rows)
    sums = np.einsum("ran,nr->a", rows, load)
    acceleration = z @ np.linalg.solve(z.T @ matrix @ z, z.T @ sums)
    return np.asarray(load - (weight * np.einsum("ran,a->rn", rows, acceleration)).T)


class StiffnessSolver:
    """Solves ``K d = b`` with factors of K, corrected for bonds that have broken since."""

    def __init__(self, lattice: ElasticLattice, intact: Ints, supports: Supports, gauge_springs: Ints) -> None:
        self._take(lattice, intact, supports.free, lattice.radius, gauge_springs)
        diagonal, between = _blocks(lattice, intact, supports.free, self._added)
        self._ldl = BlockLDL(lattice.first[intact], lattice.second[intact], diagonal, between)

    def _take(self, lattice: ElasticLattice, intact: Ints, free: Floats, radius: Floats, gauge_springs: Ints) -> None:
        """Note which freedoms there are (``free``, ``radius``: of all unknowns and nodes), and find what is added to K."""
        self._lattice, self._free, self._radius = lattice, free, radius
        # Three kinds of springs are added on the diagonal, all of the mean stiffness of the bonds: soft ones would let
        # round-off in the loads move a fragment far, stiff ones would worsen the condition of K.
        #
        # Freedoms that supports take: uncoupled and without load, so their displacement is 0 and any stiffness will do.
        # Gauge springs: carry nothing where the loads are in balance, which `solve` checks.
        # Elements without bonds: nothing else couples them, so each gets a spring for all three freedoms. What these springs
        # carry is the imbalance of the load of one element, which is round-off; in a berg of single elements there are no
        # other loads to compare it with, so the check leaves them out.
        self.gauge_stiffness = float(lattice.stiffness[intact, 0].mean()) if intact.size else 1.0
        self._added = np.where(free[: 3 * lattice.radius.size] > 0.0, 0.0, self.gauge_stiffness)
        self._added[gauge_springs] += self.gauge_stiffness
        bondless = np.ones(lattice.radius.size, bool)
        bondless[lattice.first[intact]] = bondless[lattice.second[intact]] = False
        self._added[np.repeat(bondless, 3)] = self.gauge_stiffness
        self._gauge = gauge_springs[~bondless[gauge_springs // 3]]
        self._columns: list[Floats] = []  # w of K + sum of -w w^T
        self._solved: list[Floats] = []  # K^-1 w
        self._correction: tuple[Floats, Floats, Floats] | None = None  # W, A and W A - 1 of `_corrected`

    @property
    def update_rank(self) -> int:
        """Rank of the correction for broken bonds."""
        return len(self._columns)

    def downdate(self, bond: int) -> None:
        """Take a bond out of K."""
        for column in self._columns_of(bond) * self._free:
            self._columns.append(column)
            self._solved.append(self._ldl.solve(column))
        self._correction = None

    def _columns_of(self, bond: int) -> Floats:
        """Return w of what a bond holds of K, sum of w w^T, in rows."""
        i, j = self._lattice.first[bond], self._lattice.second[bond]
        at = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
        columns = np.zeros((3, self._free.size))
        columns[:, at] = np.sqrt(self._lattice.stiffness[bond])[:, None] * self._lattice.strain_operator[bond]
        return columns

    def solve(self, load: Floats) -> Floats:
        """Displacements (m, m, rad), shape (elements, 3), under balanced loads (N, N, N m)."""
        displacement, largest = self._displaced(load)
        self._check_residual(displacement, largest, load)
        displacement[:, 2] /= self._radius
        return displacement

    def _displaced(self, load: Floats) -> tuple[Floats, float]:
        """Displacements as lengths (m), and the largest load (N)."""
        displacement = np.empty(load.shape)
        largest = self._ldl.solve_scaled(load, self._radius, self._free, displacement)
        self._corrected(displacement.reshape(-1))
        return displacement, largest

    def _corrected(self, d: Floats) -> Floats:
        """Correct d = K^-1 b in place for bonds that have broken since."""
        if self._columns:
            # Woodbury: (K - W^T W)^-1 b = d + A (1 - W A)^-1 W d, with A = K^-1 W^T.
            if self._correction is None:
                w, a = np.array(self._columns), np.array(self._solved)
                self._correction = w, a, w @ a.T - np.eye(len(w))
            w, a, matrix = self._correction
            d -= a.T @ np.linalg.solve(matrix, w @ d)
        return d

    def _check_residual(self, displacement: Floats, largest: float, load: Floats) -> None:
        give = float(max_gauge_displacement(displacement, self._gauge))
        force = give * self.gauge_stiffness
        if not (
            force <= EQUILIBRIUM_RTOL * largest or give <= GAUGE_ATOL or give <= ROUND_OFF * abs(displacement).max()
        ):
            unknown = np.flatnonzero(~np.isfinite(load).all(axis=1))
            if unknown.size:
                raise RunError(
                    f"element {unknown[0] + 1} has no finite load: the water, air, floor or ice there is not a number"
                )
            raise RunError(
                f"the lattice is not in equilibrium: a freedom that should be free carries {force:.3g} N of loads of up to "
                f"{largest:.3g} N; bonds without shear stiffness or a mechanism cannot be held (stepping.scheme: mts can)"
            )


@borrower
def max_gauge_displacement(displacement: Floats, gauge_springs: Ints) -> float:
    """Largest displacement (m) of the freedoms with gauge springs; not a number where one of them is none."""
    most = 0.0
    for n in range(gauge_springs.size):
        x = abs(displacement[gauge_springs[n] // 3, gauge_springs[n] % 3])
        if not x <= most:
            most = x
            if x != x:
                break
    return most


def elastic_energy(displacement: Floats, load: Floats) -> float:
    """Energy (J) that the lattice stores: half the work of its loads."""
    return 0.5 * float((displacement * load).sum())


def released_energy(before: Floats, load_before: Floats, after: Floats, load_after: Floats) -> float:
    """Energy (J) that a crack releases: what the lattice stores and its loads do on the way to the equilibrium with the crack.

    With U = d.f / 2 it is ``U(before) - U(after) + f(after).(d(after) - d(before))``, which is never negative; under loads that
    stay it is half of what they do, and the lattice stores as much more. Where a piece parts, the loads after are those of the
    pieces, each balanced by its own inertia: they do nothing as the pieces move apart.
    """
    return elastic_energy(before, load_before - load_after) + elastic_energy(after - before, load_after)
