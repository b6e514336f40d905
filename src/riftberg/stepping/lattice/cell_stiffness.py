"""Stiffness and stress of elastic cells as they are bonded now, and the solver for their displacements.

For an equilibrium the triangles of the mesh (`ElasticCells`) are laid into the frames of the fragments: the centres
of the cells stand where the elements do, and all else of a triangle keeps its place relative to them. Nodes on the outline bear
neither mass nor loads. They are unknowns of the stiffness matrix, and their displacements follow from those of the cells.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.averaging import principal
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.numbering import rows_of
from riftberg.stepping.lattice.block_ldl import BlockLDL
from riftberg.stepping.lattice.bridges import bridge_moments
from riftberg.stepping.lattice.cells import Booleans, freed_edges
from riftberg.stepping.lattice.elastic_cells import ElasticCells
from riftberg.stepping.lattice.equilibrium import ElasticLattice, StiffnessSolver, Supports
from riftberg.stepping.lattice.triangles import (
    Neighbourhoods,
    Triangles,
    find_triangles,
    freedoms,
    mean_stresses,
    stiffness_matrix,
    triangle_stresses,
    volumes,
)

NEGLIGIBLE = 1e-12
"""Eigenvalues of what a break takes off the stiffness, in parts of the stiffness before, that are round-off."""


@lru_cache(maxsize=2)
def _triangles(vertices: bytes, freed: bytes, youngs: float, poisson: float) -> Triangles:
    """Find triangles, or those that were found last: ice that melts has others in each step, of the same matrices per volume."""
    places = np.frombuffer(vertices).reshape(-1, 3, 2)
    return find_triangles(places, np.frombuffer(freed, bool).reshape(-1, 3), youngs, poisson)


class CellStiffness:
    """Triangles in the frames of the fragments, with the stiffness and the stress that broken bonds have left to them.

    Node ``e`` is the centre of the element in row ``e``; nodes on the outlines follow, and last what has melted away.
    """

    def __init__(
        self, cells: ElasticCells, el: Elements, bonds: Bonds, body: Ints, xy: Floats, p: KernelParameters
    ) -> None:
        mesh, self._p, self._elements, self._xy = cells.mesh, p, el.size, xy
        row, living = rows_of(el.body.id, cells.element)
        on_outline = mesh.owner.size - mesh.cells
        number = np.arange(el.size - mesh.cells, el.size + on_outline)
        number[: mesh.cells] = row
        number[: mesh.cells][~living] = el.size + on_outline + np.arange((~living).sum())
        self.nodes = int(number.max()) + 1
        self.static = np.zeros(self.nodes, bool)
        self.static[number] = living[mesh.owner] & (el.static[row[mesh.owner]] >= 0.5)

        # A bond that is gone is broken, and edges at ice that has melted away are free.
        self._bond_number = rows_of(cells.bond, bonds.id)[0]
        self._broken = np.ones(mesh.bonds, bool)
        self._broken[self._bond_number[bonds.status == 0]] = False
        lost = ~living[mesh.owner[mesh.triangle]]
        self._lost = lost[:, [1, 2, 0]] | lost[:, [2, 0, 1]]
        kept = ~(freed_edges(mesh, self._broken) | self._lost).all(axis=1)
        of_kept = ("triangle", "weight", "area", "edge_bond", "edge_tie")
        self._mesh = mesh._replace(**{name: getattr(mesh, name)[kept] for name in of_kept})
        self._lost = self._lost[kept]
        self._freed = freed_edges(self._mesh, self._broken) | self._lost

        self._vertex = self._in_frames(np.where(living, row, -1), body, xy)
        self._volume = volumes(self._mesh, np.where(living, el.thickness[row], np.nan))
        found = _triangles(self._vertex.tobytes(), self._freed.tobytes(), p.youngs_modulus, p.poisson)
        # Of these triangles as they are: with their volume, and with what breaks free from now on.
        self._triangles = Triangles(found.stiffness * self._volume[:, None, None], found.stress.copy())
        vertex = self._mesh.triangle
        self._at = freedoms(number[vertex], number[mesh.owner[vertex]])
        self._areas_of(row, living, bonds)
        # The side along which two cells meet: hexagons touch along less than their width.
        self.facet = np.where(el.body.sides == 6, 1.0 / np.sqrt(3.0), 1.0)
        self._held = (el.static >= 0.5) | (el.free_y < 0.5)
        self._whole: Booleans = np.asarray(~self._freed.any(axis=1))  # triangles without a freed edge
        self._unbridged: Ints | None = None  # intact bonds none of which is the last between two parts
        self._outline: tuple[Ints, csr_matrix, Any] | None = None

    def _in_frames(self, row: Ints, body: Ints, xy: Floats) -> Floats:
        """Places of the vertices of all triangles in the frames of their fragments (m); ``row``: of each cell, -1 for none."""
        mesh, living = self._mesh, np.flatnonzero(row >= 0)
        # Each fragment has turned from the plane of its mesh by the angle that fits the centres best.
        of, count = body[row[living]], int(body.max()) + 1
        before, now = (places[:, 0] + 1j * places[:, 1] for places in (mesh.xy[living], xy[row[living]]))
        size = np.bincount(of, minlength=count)
        for places in (before, now):
            mean = np.bincount(of, places.real, count) + 1j * np.bincount(of, places.imag, count)
            places -= (mean / np.maximum(size, 1))[of]
        product = before.conj() * now
        turn = np.bincount(of, product.real, count) + 1j * np.bincount(of, product.imag, count)
        turn = np.where(turn == 0.0, 1.0, turn) / np.where(turn == 0.0, 1.0, abs(turn))

        # A triangle belongs to the fragment of an edge that is not free. Vertices of that fragment stand at the centres of
        # their cells, or in their place beside them; others keep their place relative to the ends of that edge.
        triangle = mesh.triangle
        end = np.take_along_axis(triangle, (np.argmin(self._freed, axis=1)[:, None] + 1) % 3, axis=1)
        own = body[row[mesh.owner[end]]]
        self._of_body = own[:, 0]
        ours = (row[mesh.owner[triangle]] >= 0) & (body[row[mesh.owner[triangle]]] == own)
        anchor = np.where(ours, mesh.owner[triangle], mesh.owner[end])
        away = mesh.xy[triangle] - mesh.xy[anchor]
        c, s = turn.real[own], turn.imag[own]
        turned = np.stack([c * away[..., 0] - s * away[..., 1], s * away[..., 0] + c * away[..., 1]], axis=2)
        vertex = np.asarray(xy[row[anchor]] + turned)
        self._middle = vertex.mean(axis=1)
        return vertex

    def matrix(self) -> csr_matrix:
        """Stiffness of all nodes: displacements (m) and rotation (rad) of each."""
        return stiffness_matrix(self._at, self._triangles.stiffness, self.nodes)

    def break_bond(self, bond: int, scale: Floats) -> Floats:
        """Free the edges of a bond (row of the state); returns w in rows: the stiffness falls by the sum of w w^T.

        ``scale`` turns all unknowns into lengths, in which the stiffness is taken.
        """
        before, old = self._freed, self._triangles.stiffness
        self._broken[self._bond_number[bond]] = True
        self._freed = freed_edges(self._mesh, self._broken) | self._lost
        self._whole = np.asarray(~self._freed.any(axis=1))
        changed = np.flatnonzero((self._freed != before).any(axis=1))
        new = find_triangles(self._vertex[changed], self._freed[changed], self._p.youngs_modulus, self._p.poisson)
        left = new.stiffness * self._volume[changed, None, None]
        at, place = np.unique(self._at[changed], return_inverse=True)
        place, less = place.reshape(-1, 9), np.zeros((at.size, at.size))
        np.add.at(less, (place[:, :, None], place[:, None, :]), old[changed] - left)
        least = NEGLIGIBLE * float((old[changed] * scale[self._at[changed]][:, None, :] ** 2).max(initial=0.0))
        old[changed], self._triangles.stress[changed] = left, new.stress
        self._outline = None
        value, vector = np.linalg.eigh(less * np.outer(scale[at], scale[at]))
        columns = np.zeros((int((value > least).sum()), scale.size))
        columns[:, at] = (vector[:, value > least] * np.sqrt(value[value > least])).T
        return columns

    def displacements(self, of_elements: Floats) -> Floats:
        """Displacements of all nodes (m, m, rad) by those of the elements; shape (nodes, 3).

        Nodes on the outline bear no loads: they stand where the ice around them is in equilibrium.
        """
        every = np.zeros((self.nodes, 3))
        every[: self._elements] = of_elements
        if self._outline is None:
            beside = (self._at[:, :6] >= 3 * self._elements).any(axis=1)
            k = stiffness_matrix(self._at[beside], self._triangles.stiffness[beside], self.nodes)
            outer = 3 * np.arange(self._elements, self.nodes)[~self.static[self._elements :]][:, None] + np.arange(2)
            free = outer.ravel()[k.diagonal()[outer.ravel()] > 0.0]
            self._outline = (
                free,
                k[free][:, : 3 * self._elements],
                splu(k[free][:, free].tocsc()) if free.size else None,
            )
        free, coupling, factors = self._outline
        if factors is not None:
            every.ravel()[free] = factors.solve(-(coupling @ np.ascontiguousarray(of_elements).ravel()))
        return every

    def _areas_of(self, row: Ints, living: Booleans, bonds: Bonds) -> None:
        """Find over which triangles the stress is averaged at bonds, at nodes on the outline beside them, and in cells."""
        mesh, numbers = self._mesh, np.arange(len(self._mesh.triangle))
        at_edge, of_edge = np.tile(numbers, (3, 1)).T.ravel(), mesh.edge_bond.ravel()
        self._at_bond = Neighbourhoods.of_pairs(mesh, of_edge, at_edge)
        in_triangle = mesh.triangle.ravel(), np.repeat(numbers, 3)
        owner = mesh.owner[mesh.triangle].ravel()
        self._in_cell = Neighbourhoods.of_pairs(mesh, np.where(living[owner], row[owner], -1), in_triangle[1])
        outer = mesh.triangle.ravel() >= mesh.cells
        node, place = np.unique(in_triangle[0][outer], return_inverse=True)
        self._outer_nodes = node.size
        self._at_node = Neighbourhoods.of_pairs(mesh, place.ravel(), in_triangle[1][outer])
        # Each bond has the nodes at both ends of its edges that lie on the outline.
        end = mesh.triangle[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
        bond = np.repeat(of_edge, 2)
        beside = (bond >= 0) & (end.ravel() >= mesh.cells)
        pairs = np.unique(np.column_stack([bond[beside], np.searchsorted(node, end.ravel()[beside])]), axis=0)
        self._bond_beside, self._node_beside = pairs.T.copy()

    def triangle_stresses(self, of_elements: Floats) -> Floats:
        """Stress (Pa; xx, yy, xy) of each triangle by the displacements of the elements."""
        return triangle_stresses(self._at, self._triangles, self.displacements(of_elements))

    def bond_tensors(self, stress: Floats, rows: Ints) -> Floats:
        """Stress (Pa; xx, yy, xy) of the ice at intact bonds (rows of the state); ``stress``: of the triangles."""
        return self._mean(self._at_bond, stress, self._broken.size)[self._bond_number[rows]]

    def cell_tensors(self, stress: Floats) -> Floats:
        """Stress (Pa; xx, yy, xy) of the ice in the cells of the elements, with all triangles at their nodes."""
        every = np.ones(len(stress), bool)
        return mean_stresses(*self._in_cell, every, stress, self._elements)

    def bridges(self, lattice: ElasticLattice, rows: Ints, load: Floats) -> tuple[Booleans, Floats]:
        """Find which intact bonds are the last between two parts, and their stress (Pa) by bending, 0 for all others.

        6 M / (H w^2) at the end of the facet, as in a beam as high as the facet is long (w): the mean stress of a bond
        knows nothing of the moment M that it bears.
        """
        if (
            self._unbridged is rows
        ):  # as nearly always: bonds that are the same have no bridges under other loads either
            return np.zeros(rows.size, bool), np.zeros(rows.size)
        width = lattice.width[rows] * self.facet[lattice.first[rows]]
        bridge, moment = bridge_moments(lattice.first, lattice.second, rows, self._xy, load, self._held)
        if not bridge.any():
            self._unbridged = rows
        return bridge, np.asarray(6.0 * abs(moment) / (lattice.thickness[rows] * width**2))

    def bond_stresses(self, stress: Floats, tensor: Floats, rows: Ints) -> Floats:
        """Largest tension and shear (Pa) of the ice at intact bonds, shape (bonds, 2); ``tensor``: `bond_tensors`.

        Bonds lie inside the ice, so the stress at nodes of the outline beside them counts where it is larger.
        """
        strongest = np.full((self._broken.size, 2), -np.inf)
        of_nodes = principal_stresses(self._mean(self._at_node, stress, self._outer_nodes))
        np.maximum.at(strongest, self._bond_beside, of_nodes[self._node_beside])
        largest = np.maximum(principal_stresses(tensor), strongest[self._bond_number[rows]])
        return np.asarray(largest)

    def _mean(self, near: Neighbourhoods, stress: Floats, places: int) -> Floats:
        return mean_stresses(*near, self._whole, stress, places)

    def row_distance(self, element: int, spacing: float) -> float:
        """Distance (m) of the rows of a lattice: of the elements in squares, sqrt(3) / 2 of it in hexagons."""
        return spacing if self.facet[element] == 1.0 else 0.5 * np.sqrt(3.0) * spacing

    def facet_area(self, lattice: ElasticLattice, bond: int) -> float:
        """Area (m2) along which the cells of a bond meet."""
        return float(lattice.width[bond] * self.facet[lattice.first[bond]] * lattice.thickness[bond])

    def mean_ahead(
        self, stress: Floats, body: int, place: Floats, direction: Floats, radius: float
    ) -> tuple[Floats, float]:
        """Stress (Pa; xx, yy, xy) of the ice ahead of a place in a fragment, and how much of the disc around it is ice.

        Weighted by area and by exp(-d^2 / 2 r^2), up to 3 r (after Wells and Sluys 2001, Int. J. Numer. Methods Eng. 50).
        """
        away = self._middle - place
        square = (away**2).sum(axis=1)
        weight = self._mesh.weight * self._mesh.area * np.exp(-0.5 * square / radius**2)
        weight *= (self._of_body == body) & (square <= 9.0 * radius**2)
        filled = float(weight.sum()) / (2.0 * math.pi * radius**2 * (1.0 - math.exp(-4.5)))
        weight *= away @ direction > 0.0
        total = float(weight.sum())
        return (np.asarray(weight @ stress / total) if total > 0.0 else np.zeros(3)), filled


@kernel
def principal_stresses(tensor: Floats) -> Floats:
    """Largest tension and shear (Pa) of each tensor (xx, yy, xy), shape (places, 2)."""
    extremes = np.empty((tensor.shape[0], 2))
    for k in range(tensor.shape[0]):
        extremes[k, 0], extremes[k, 1] = principal(tensor[k, 0], tensor[k, 1], tensor[k, 2])
    return extremes


class CellSolver(StiffnessSolver):
    """Solves for the displacements of the elements, with those of the nodes on the outline as further unknowns."""

    def __init__(
        self, cells: CellStiffness, lattice: ElasticLattice, intact: Ints, supports: Supports, gauge_springs: Ints
    ) -> None:
        self._cells, elements = cells, lattice.radius.size
        radius, free = np.ones(cells.nodes), np.ones((cells.nodes, 3))
        radius[:elements], free[:elements] = lattice.radius, supports.free.reshape(-1, 3)
        free[elements:, :2][cells.static[elements:]] = 0.0
        self._scale = np.column_stack([np.ones((cells.nodes, 2)), 1.0 / radius]).ravel()
        self._take(lattice, intact, free.ravel(), radius, gauge_springs)
        scale = diags(self._scale)
        blocks = (scale @ cells.matrix() @ scale).tobsr((3, 3))
        row, column = np.repeat(np.arange(cells.nodes), np.diff(blocks.indptr)), blocks.indices.astype(np.int64)
        data = blocks.data * free[row][:, :, None] * free[column][:, None, :]
        diagonal = np.zeros((cells.nodes, 3, 3))
        diagonal[row[row == column]] = data[row == column]
        # Unknowns without any stiffness: rotations of nodes on the outline, ice that has melted away, supported freedoms.
        added = np.zeros(3 * cells.nodes)
        added[: self._added.size] = self._added
        added[np.einsum("nii->ni", diagonal).ravel() == 0.0] = self.gauge_stiffness
        diagonal[:, range(3), range(3)] += added.reshape(-1, 3)
        upper = row < column
        self._ldl = BlockLDL(row[upper], column[upper], diagonal, np.ascontiguousarray(data[upper]))

    def _columns_of(self, bond: int) -> Floats:
        return self._cells.break_bond(bond, self._scale)

    def solve(self, load: Floats) -> Floats:
        """See `StiffnessSolver.solve`; the nodes on the outline bear no loads."""
        every = np.zeros((self._radius.size, 3))
        every[: len(load)] = load
        return super().solve(every)[: len(load)]
