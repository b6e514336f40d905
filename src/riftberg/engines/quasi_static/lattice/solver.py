"""Displacements of the elements under balanced loads: the stiffness of their cells, factored and corrected for broken bonds.

``K d = b`` with K the stiffness of the triangles of all cells, and d the displacements of the elements and of the nodes on the
outline. K is singular by the rigid motions of each fragment, so three gauge springs fix one element of each: as the loads are in
balance they carry nothing, and any force on them is the residual of the solve. Rotations are measured as paths at the rim of the
element (m), so that all unknowns are of one size.

K is factored by blocks of one node (`riftberg.engines.quasi_static.lattice.block_ldl`). A bond that breaks takes some
columns off it: the factors are kept, and corrected for these (a downdate of low rank by Woodbury's formula).
"""

from __future__ import annotations

import numpy as np

from riftberg.compiled.kernels import borrower
from riftberg.engines.quasi_static.lattice.block_ldl import BlockLDL
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellStiffness
from riftberg.engines.quasi_static.lattice.cells import Booleans
from riftberg.engines.quasi_static.lattice.dense import multiply_rows, multiply_sparse, solve_dense
from riftberg.engines.quasi_static.lattice.equilibrium import ElasticLattice, Supports
from riftberg.errors import RunError
from riftberg.state import Floats, Ints

EQUILIBRIUM_RTOL = 1e-5
"""Largest force on a gauge spring, as a part of the largest load, before a solve counts as failed."""

GAUGE_ATOL = 1e-9
"""Displacement (m) of a gauge spring that counts as round-off: a berg that moves with the water has no loads to compare with."""

ROUND_OFF = 1e-10
"""The same as a part of the largest displacement: two pieces on their last bond move far, and round-off with them."""

MOST_ROUNDS = 20
"""Rounds of the search for closed faces after which none opens again."""

MOST_KEPT = 16
"""Sets of closed faces whose corrections are kept: the same few come again from solve to solve."""


class StiffnessSolver:
    """Solves ``K d = b`` with factors of K, corrected for bonds that have broken since.

    The displacements of the nodes on the outline are further unknowns.
    """

    def __init__(
        self, cells: CellStiffness, lattice: ElasticLattice, intact: Ints, supports: Supports, gauge_springs: Ints
    ) -> None:
        self._cells, topology, elements = cells, cells.topology, lattice.radius.size
        radius, free = np.ones(topology.nodes), np.ones((topology.nodes, 3))
        radius[:elements], free[:elements] = lattice.radius, supports.free.reshape(-1, 3)
        free[elements:, :2][topology.static[elements:]] = 0.0
        self._radius, self._free = radius, free.ravel()
        self._scale = np.column_stack([np.ones((topology.nodes, 2)), 1.0 / radius]).ravel()
        diagonal, between = cells.blocks()
        scaling = self._scale.reshape(-1, 3) * free
        diagonal = diagonal * scaling[:, :, None] * scaling[:, None, :]
        between = between * scaling[topology.first][:, :, None] * scaling[topology.second][:, None, :]
        # Springs are added on the diagonal, all of the mean stiffness of the bonds: soft ones would let round-off in the loads
        # move a fragment far, stiff ones would worsen the condition of K.
        #
        # Unknowns without any stiffness (supported freedoms, rotations of nodes on the outline, ice that has melted away) are
        # uncoupled and without load, so their displacement is 0 and any stiffness will do.
        # Gauge springs carry nothing where the loads are in balance, which `solve` checks.
        # Elements without bonds: nothing else couples them, so each gets a spring for all three freedoms. These springs
        # carry the imbalance of the load of one element, which is round-off, so the check leaves them out.
        self.gauge_stiffness = float(lattice.stiffness[intact].mean())
        spring = np.zeros((topology.nodes, 3))
        spring.reshape(-1)[gauge_springs] = self.gauge_stiffness
        bondless = np.ones(elements, bool)
        bondless[lattice.first[intact]] = bondless[lattice.second[intact]] = False
        spring[:elements][bondless] = self.gauge_stiffness
        spring[np.einsum("nii->ni", diagonal) == 0.0] = self.gauge_stiffness
        self._gauge = gauge_springs[~bondless[gauge_springs // 3]]
        diagonal[:, range(3), range(3)] += spring
        self._ldl = BlockLDL(topology.first, topology.second, diagonal, between)
        # Of K - sum of w w^T: W with the rows w, A^T with A = K^-1 W^T, and W A - 1.
        no_rows = np.zeros((0, self._free.size))
        self._lost = no_rows, no_rows, np.zeros((0, 0))
        # By which faces are closed, with W the rows w of K + sum of w w^T and A = K^-1 W^T: A^T, and (1 + W A)^-1 W.
        self._pressed: dict[bytes, tuple[Floats, Floats]] = {}

    @property
    def update_rank(self) -> int:
        """Rank of the correction for broken bonds."""
        return len(self._lost[0])

    def downdate(self, bond: int) -> None:
        """Take a bond out of K."""
        self._pressed.clear()
        new_w = self._cells.break_bond(bond, self._scale) * self._free
        new_a = np.array([self._ldl.solve(w) for w in new_w]).reshape(new_w.shape)
        old_w, old_a, old_matrix = self._lost
        w, a = np.vstack([old_w, new_w]), np.vstack([old_a, new_a])
        new_rows = multiply_sparse(new_w, a) - np.eye(len(new_w), len(w), len(old_w))
        self._lost = w, a, np.vstack([np.hstack([old_matrix, multiply_sparse(old_w, new_a)]), new_rows])

    def solve(self, load: Floats) -> Floats:
        """Displacements (m, m, rad), shape (elements, 3), under balanced loads (N, N, N m); outlines bear none."""
        displacement, largest = self._find_displacements(load)
        self._check_residual(displacement, largest, load)
        of_elements = displacement[: len(load)]
        of_elements[:, 2] /= self._radius[: len(load)]
        return of_elements

    def _find_displacements(self, load: Floats) -> tuple[Floats, float]:
        """Displacements as lengths (m), and the largest load (N): faces that would pass through each other press.

        Newton's method for a convex energy that is quadratic in pieces: each round takes the faces that the displacements of
        the round before close, until these are the same. That takes a few rounds; faces that have closed after
        `MOST_ROUNDS` do not open again, so it ends in any case.
        """
        open_displacement = np.empty((self._radius.size, 3))
        largest = self._ldl.solve_scaled(load, self._radius, self._free, open_displacement)
        self._correct_displacement(open_displacement.reshape(-1))
        faces, displacement = self._cells.faces, open_displacement
        if faces.tables.row.size == 0:
            return displacement, largest
        scale, previous = self._scale.reshape(-1, 3), np.zeros(faces.tables.row.size, bool)
        for n in range(2 * faces.tables.row.size + MOST_ROUNDS):
            closed = faces.closed(displacement * scale)
            closed = closed if n < MOST_ROUNDS else closed | previous
            if np.array_equal(closed, previous):
                break
            previous, displacement = closed, self._close_faces(open_displacement, closed)
        return displacement, largest

    def _close_faces(self, displacement: Floats, closed: Booleans) -> Floats:
        """Displacements with some faces closed, by those with all of them open; a correction as for broken bonds."""
        key = closed.tobytes()
        if key not in self._pressed:
            if len(self._pressed) >= MOST_KEPT:
                self._pressed.clear()
            faces = self._cells.faces
            at, columns = faces.at[closed], faces.columns[closed]
            w = np.zeros((len(at), self._free.size))
            np.put_along_axis(w, at, columns * self._scale[at] * self._free[at], axis=1)
            a = np.array([self._correct_displacement(self._ldl.solve(column)) for column in w]).reshape(w.shape)
            matrix = multiply_sparse(w, a) + np.eye(len(w))
            self._pressed[key] = a, solve_dense(matrix, w)
        a, pressing = self._pressed[key]
        pressed = multiply_rows(a, multiply_sparse(pressing, displacement.reshape(1, -1)))
        return np.asarray(displacement - pressed.reshape(-1, 3))

    def _correct_displacement(self, d: Floats) -> Floats:
        """Correct d = K^-1 b in place for bonds that have broken since."""
        w, a, matrix = self._lost
        if len(w):  # Woodbury: (K - W^T W)^-1 b = d + A (1 - W A)^-1 W d
            d -= multiply_rows(a, solve_dense(matrix, multiply_sparse(w, d[None])))[:, 0]
        return d

    def _check_residual(self, displacement: Floats, largest: float, load: Floats) -> None:
        gauge_displacement = float(max_gauge_displacement(displacement, self._gauge))
        force = gauge_displacement * self.gauge_stiffness
        if not (
            force <= EQUILIBRIUM_RTOL * largest
            or gauge_displacement <= GAUGE_ATOL
            or gauge_displacement <= ROUND_OFF * abs(displacement).max()
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
    largest = 0.0
    for n in range(gauge_springs.size):
        x = abs(displacement[gauge_springs[n] // 3, gauge_springs[n] % 3])
        if not x <= largest:
            largest = x
            if x != x:
                break
    return largest
