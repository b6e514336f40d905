"""Stiffness and stress of elastic cells with their present bonds.

For an equilibrium the triangles of the mesh (`ElasticCells`) are laid into the frames of the fragments: the centres
of the cells stand where the elements do, and all else of a triangle keeps its place relative to them. Nodes on the outline bear
neither mass nor loads. They are unknowns of the stiffness matrix, and their displacements follow from the cells'.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.fragments.connectivity import Bridges, bridge_moments, find_bridges
from riftberg.engines.quasi_static.lattice.block_ldl import BlockLDL, Factors, solve_factored
from riftberg.engines.quasi_static.lattice.cells import (
    Booleans,
    ElasticCells,
    freed_edges,
    held_ties,
)
from riftberg.engines.quasi_static.lattice.dense import factor_semidefinite
from riftberg.engines.quasi_static.lattice.equilibrium import ElasticLattice
from riftberg.engines.quasi_static.lattice.frames import fit_rotations
from riftberg.engines.quasi_static.lattice.triangles import (
    ClosingFaces,
    FaceTables,
    LaidTriangles,
    Neighbourhoods,
    Triangles,
    find_gap_shares,
    find_triangles,
    freedoms,
    mean_stresses,
    put_closed_stress,
    triangle_stresses,
    volumes,
)
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import principal
from riftberg.physics.elementary import exp, exp_array
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows

NEGLIGIBLE = 1e-12
"""Pivots of the loss of stiffness by a break, in parts of the stiffness before, that count as round-off."""


class CellTopology:
    """Which triangles hang together how: all that stays the same while elements, bonds and fragments do, though the ice melts.

    Node ``e`` is the centre of the element in row ``e``; nodes on the outlines follow, and last the cells that have melted away.
    """

    def __init__(self, cells: ElasticCells, el: Elements, bonds: Bonds, body: Ints) -> None:
        self._made_for = self._key(cells, el, bonds, body)
        mesh, self.elements = cells.mesh, el.size
        self.row, self.living = row, living = find_rows(el.body.id, cells.element)
        on_outline = mesh.owner.size - mesh.cells
        number = np.arange(el.size - mesh.cells, el.size + on_outline)
        number[: mesh.cells] = row
        number[: mesh.cells][~living] = el.size + on_outline + np.arange((~living).sum())
        self.nodes = int(number.max()) + 1
        self.static = np.zeros(self.nodes, bool)
        self.static[number] = living[mesh.owner] & (el.static[row[mesh.owner]] >= 0.5)

        # A bond that is gone is broken, and edges at ice that has melted away are free.
        self.bond_number = find_rows(cells.bond, bonds.id)[0]
        self.broken = np.ones(mesh.bonds, bool)
        self.broken[self.bond_number[bonds.status == 0]] = False
        lost = ~living[mesh.owner[mesh.triangle]]
        lost = lost[:, [1, 2, 0]] | lost[:, [2, 0, 1]]
        has_held_edge = ~(freed_edges(mesh, self.broken) | lost).all(axis=1)
        fields = ("triangle", "weight", "area", "edge_bond", "edge_tie")
        self.number = np.flatnonzero(has_held_edge)
        self.mesh = mesh._replace(**{name: getattr(mesh, name)[has_held_edge] for name in fields})
        self.lost = lost[has_held_edge]
        outline = cells.outline
        is_living = living[outline.tie_cells].all(axis=1)
        self.outline_tie, self.on_outline = outline.tie[is_living], row[outline.tie_cells[is_living]]
        self.face_from = np.where(outline.face_from >= 0, row[outline.face_from], -1)
        self.face_shift, self.face_length = outline.face_shift, outline.face_length
        self.freed = freed_edges(self.mesh, self.broken) | self.lost
        vertex = self.mesh.triangle
        self.at = freedoms(number[vertex], number[mesh.owner[vertex]])
        self._find_blocks()
        self._find_areas()
        # The side along which two cells meet: hexagons touch along less than their width.
        self.facet = np.where(el.body.sides == 6, 1.0 / np.sqrt(3.0), 1.0)
        self.held: Booleans = np.asarray((el.static >= 0.5) | (el.free_y < 0.5))
        # The triangles as they were laid last, and what `CrackPaths` has found at the tips in them.
        self.laid: LaidTriangles | None = None
        self.at_tips: dict[str, tuple[Floats, Any]] = {}

    @staticmethod
    def _key(cells: ElasticCells, el: Elements, bonds: Bonds, body: Ints) -> tuple[ElasticCells, list[bytes]]:
        arrays = (el.body.id, el.static, el.free_y, bonds.id, bonds.status, body)
        return cells, [array.tobytes() for array in arrays]

    def holds(self, cells: ElasticCells, el: Elements, bonds: Bonds, body: Ints) -> bool:
        """Whether elements, bonds and fragments are those for which this was found."""
        mesh, key = self._key(cells, el, bonds, body)
        return mesh is self._made_for[0] and key == self._made_for[1]

    def crack_normals(self, bonds: Bonds) -> Floats:
        """Normals of the crack lines at the bonds that they have crossed, on the plane of the mesh; 0 elsewhere.

        By the segment of the line that leads to the bond from the start of its crack. Shape (bonds of the mesh + 1, 2).
        """
        cell = np.zeros(self.elements, np.int64)
        cell[self.row[self.living]] = np.flatnonzero(self.living)
        rows = np.flatnonzero((bonds.crack > 0) & (bonds.status != 0))
        rows = rows[np.lexsort((bonds.crack_order[rows], bonds.crack[rows]))]
        first, second = self.mesh.xy[cell[bonds.first[rows]]], self.mesh.xy[cell[bonds.second[rows]]]
        crossing = first + bonds.crack_part[rows, None] * (second - first)
        along, same_crack = np.diff(crossing, axis=0), (np.diff(bonds.crack[rows]) == 0)[:, None]
        incoming, outgoing = (
            np.vstack([np.zeros((1, 2)), along * same_crack]),
            np.vstack([along * same_crack, np.zeros((1, 2))]),
        )
        line = np.where(
            (bonds.crack_order[rows] > 0)[:, None] | ~outgoing.any(axis=1, keepdims=True), incoming, outgoing
        )
        size = np.hypot(*line.T)
        normal = np.zeros((self.broken.size + 1, 2))  # the last one stands for -1
        normal[self.bond_number[rows]] = (
            np.column_stack([-line[:, 1], line[:, 0]]) / np.where(size > 0.0, size, 1.0)[:, None]
        )
        return normal

    def _find_blocks(self) -> None:
        """Find the pairs of nodes that the stiffness matrix couples, sorted, and where the pairs of each first node start."""
        triangle_nodes = np.concatenate([self.at[:, 0:6:2], self.at[:, 6:9]], axis=1) // 3
        first_corner, second_corner = np.triu_indices(6, 1)
        a, b = triangle_nodes[:, first_corner].ravel(), triangle_nodes[:, second_corner].ravel()
        numbers = np.minimum(a, b) * self.nodes + np.maximum(a, b)
        self.first, self.second = np.divmod(np.unique(numbers[a != b]), self.nodes)
        self.start = np.searchsorted(self.first, np.arange(self.nodes + 1))

    def _find_areas(self) -> None:
        """Find over which triangles the stress is averaged at bonds, and at nodes on the outline beside them."""
        mesh, numbers = self.mesh, np.arange(len(self.mesh.triangle))
        at_edge, of_edge = np.tile(numbers, (3, 1)).T.ravel(), mesh.edge_bond.ravel()
        self.at_bond = Neighbourhoods.of_pairs(mesh, of_edge, at_edge)
        in_triangle = mesh.triangle.ravel(), np.repeat(numbers, 3)
        outer = mesh.triangle.ravel() >= mesh.cells
        node, outer_node = np.unique(in_triangle[0][outer], return_inverse=True)
        self.outer_nodes = node.size
        self.at_node = Neighbourhoods.of_pairs(mesh, outer_node.ravel(), in_triangle[1][outer])
        # Each bond has the nodes at both ends of its edges that lie on the outline.
        end = mesh.triangle[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
        bond = np.repeat(of_edge, 2)
        on_outline = (bond >= 0) & (end.ravel() >= mesh.cells)
        pairs = np.unique(np.column_stack([bond[on_outline], np.searchsorted(node, end.ravel()[on_outline])]), axis=0)
        self.bond_beside, self.node_beside = pairs.T.copy()


class OutlineNodes(NamedTuple):
    """Nodes on the outline, which bear no loads: they stand where the ice around them is in equilibrium.

    Of pairs of an element and a node on the outline: both, and their block of the stiffness matrix.
    """

    element: Ints
    node: Ints
    pull: Floats
    free: Floats  # 0 where a node cannot move, else 1; shape (nodes on the outline, 3)
    factors: Factors  # Of the stiffness of these nodes
    radius: Floats  # 1 m, as all unknowns here are lengths; shape (nodes on the outline,)
    all_free: Floats  # 1 for each unknown; shape (3 nodes on the outline,)


def outline_nodes(topology: CellTopology, diagonal: Floats, between: Floats) -> OutlineNodes:
    """Factor the stiffness of the nodes on the outline, by the blocks of `stiffness_blocks`."""
    inner = topology.elements
    can_move = (np.einsum("nii->ni", diagonal[inner:]) > 0.0) & ~topology.static[inner:, None]
    can_move[:, 2] = False  # they rotate with their cells
    free = can_move.astype(np.float64)
    outer = topology.first >= inner
    first, second = topology.first[outer] - inner, topology.second[outer] - inner
    blocks = diagonal[inner:] * free[:, :, None] * free[:, None, :]
    blocks[:, range(3), range(3)] += 1.0 - free
    factors = BlockLDL(
        first, second, blocks, between[outer] * free[first][:, :, None] * free[second][:, None, :]
    ).factors
    mixed = ~outer & (topology.second >= inner)
    element, node = topology.first[mixed], topology.second[mixed] - inner
    return OutlineNodes(element, node, between[mixed], free, factors, np.ones(len(blocks)), np.ones(3 * len(blocks)))


@kernel
def node_displacements(outline: OutlineNodes, of_elements: Floats) -> Floats:
    """Displacements of all nodes (m, m, rad) by the displacements of the elements; shape (nodes, 3)."""
    element, node, pull, free, elements = outline.element, outline.node, outline.pull, outline.free, len(of_elements)
    displacement, load = np.zeros((elements + len(free), 3)), np.zeros(free.shape)
    for e in range(elements):  # an assignment of whole arrays takes seconds to compile
        for i in range(3):
            displacement[e, i] = of_elements[e, i]
    for n in range(element.size):
        e, k = element[n], node[n]
        for i in range(2):
            for j in range(3):
                load[k, i] -= pull[n, j, i] * of_elements[e, j] * free[k, i]
    solve_factored(outline.factors, load, outline.radius, outline.all_free, displacement[elements:])
    return displacement


class StressTables(NamedTuple):
    """Tables for the stress of the ice by displacements and loads, for some intact bonds."""

    at: Ints  # Freedoms of the triangles; shape (triangles, 9)
    by_displacement: Floats  # Their stress by these; shape (triangles, 3, 9)
    faces: FaceTables  # Of triangles whose faces may close
    at_bond: Neighbourhoods  # Triangles by number of the bond in the mesh
    at_node: Neighbourhoods  # Triangles by node on the outline
    number: Ints  # Of each intact bond in the mesh
    beside: Ints  # Intact bonds and nodes on the outline beside them; shape (2, pairs)
    counts: tuple[int, int]  # Bonds of the mesh, nodes on the outline
    bridges: Bridges
    lattice: tuple[Ints, Ints, Ints, Floats, Booleans]  # First and second ends, intact bonds, coordinates, supports
    shift: Floats  # Of the middle of the face from that of each intact bond, to its left, in parts of its length
    modulus: Floats  # Of the section of each intact bond, times 6, m3


@kernel
def find_stresses(t: StressTables, displacement: Floats, load: Floats, tensor: Floats, stress: Floats) -> Floats:
    """Return the stress (Pa; xx, yy, xy) of the triangles, and fill that of intact bonds: as tensor, tension and shear.

    ``displacement``: of all nodes (m, m, rad); ``load``: of the elements (N, N, N m).

    Bonds lie inside the ice, so the stress at nodes of the outline beside them counts where it is larger. Bridges bear
    6 M / (H w^2) at the end of the facet in addition, as in a beam as high as the facet is long (w): the mean stress of a bond
    knows nothing of the moment M that it bears. Where the outline cuts the facet at both ends, M and w are those of what it
    leaves.
    """
    triangle = triangle_stresses(t.at, t.by_displacement, displacement)
    if t.faces.row.size > 0:
        put_closed_stress(t.faces, displacement, triangle)
    at_bond, number, beside = mean_stresses(t.at_bond, triangle, t.counts[0]), t.number, t.beside
    for k in range(number.size):
        for i in range(3):
            tensor[k, i] = at_bond[number[k], i]
        stress[k, 0], stress[k, 1] = principal(tensor[k, 0], tensor[k, 1], tensor[k, 2])
    at_node = principal_stresses(mean_stresses(t.at_node, triangle, t.counts[1]))
    for n in range(beside.shape[1]):
        for i in range(2):
            stress[beside[0, n], i] = max(stress[beside[0, n], i], at_node[beside[1, n], i])
    bridge = t.bridges.bond
    if bridge.size > 0:
        moment = bridge_moments(t.bridges, *t.lattice[:4], load, t.lattice[4], t.shift)
        for n in range(bridge.size):
            stress[bridge[n], 0] += 6.0 * abs(moment[n]) / t.modulus[bridge[n]]
    return triangle


class CellStresses(NamedTuple):
    """Stress (Pa) of elastic cells, and the displacements by which it was found."""

    displacement: Floats  # Of all nodes, m, m, rad
    triangle: Floats  # xx, yy, xy; shape (triangles, 3)
    tensor: Floats  # Of the ice at the intact bonds: xx, yy, xy; shape (intact bonds, 3)
    bond: Floats  # Largest tension and shear of the ice at the bonds; shape (intact bonds, 2)
    bridge: Ints  # Rows of intact bonds that are the last between two parts


@kernel
def stiffness_blocks(at: Ints, stiffness: Floats, start: Ints, second: Ints) -> tuple[Floats, Floats]:
    """Add up the stiffness of triangles: blocks of the nodes, and of the pairs of nodes that `CellTopology` lists."""
    nodes = start.size - 1
    diagonal, between = np.zeros((nodes, 3, 3)), np.zeros((second.size, 3, 3))
    node, pair = np.empty(9, np.int64), np.empty((9, 9), np.int64)
    for t in range(at.shape[0]):
        for a in range(9):
            node[a] = at[t, a] // 3
        for a in range(9):
            for b in range(9):
                pair[a, b] = -1
                if node[a] < node[b]:
                    n = start[node[a]]
                    while second[n] != node[b]:
                        n += 1
                    pair[a, b] = n
        for a in range(9):
            for b in range(9):
                if node[a] == node[b]:
                    diagonal[node[a], at[t, a] % 3, at[t, b] % 3] += stiffness[t, a, b]
                elif pair[a, b] >= 0:
                    between[pair[a, b], at[t, a] % 3, at[t, b] % 3] += stiffness[t, a, b]
    return diagonal, between


class NearTriangles(NamedTuple):
    """Some triangles of a fragment, in its frame."""

    row: Ints
    vertex: Floats  # m; shape (triangles, 3, 2)
    node: Ints  # Shape (triangles, 3)
    area: Floats  # With its weight, m2
    whole: Booleans  # Those without a freed edge


class CellStiffness:
    """Triangles in the frames of the fragments, with the stiffness and the stress that broken bonds have left to them.

    ``topology``: of an earlier time, used as long as it still holds.
    """

    def __init__(
        self, cells: ElasticCells, el: Elements, bonds: Bonds, body: Ints, xy: Floats, p: KernelParameters,
        topology: CellTopology | None = None,
    ) -> None:  # fmt: skip
        earlier = None if topology is None else topology.laid
        if topology is None or not topology.holds(cells, el, bonds, body):
            topology = CellTopology(cells, el, bonds, body)
        self.topology, self._mesh, self._at = topology, topology.mesh, topology.at
        self._p, self._xy, self.facet, self._bonds = p, xy, topology.facet, bonds
        self.elastic = p.youngs_modulus, p.poisson
        self._freed, self._broken = topology.freed, topology.broken.copy()
        living, row = topology.living, topology.row
        self._vertex = self._in_frames(np.where(living, row, -1), body, xy)
        laid = LaidTriangles.find(topology.number, self._vertex, self._freed, *self.elastic, earlier)
        if topology.laid is not laid:  # else ice has melted, and no more
            topology.laid, topology.at_tips = laid, {}
        self.at_tips = topology.at_tips
        self.volume = volumes(self._mesh, np.where(living, el.thickness[row], np.nan))
        # Of these triangles with their volume; further breaks change them.
        stiffness, stress = laid.matrices
        self._triangles = Triangles(stiffness * self.volume[:, None, None], stress.copy())
        self._whole: Booleans = np.asarray(~self._freed.any(axis=1))  # triangles without a freed edge
        self._tables: tuple[Ints, StressTables] | None = None  # of some intact bonds
        self._blocks: tuple[Floats, Floats] | None = None
        self._outline: OutlineNodes | None = None
        self._faces: ClosingFaces | None = None

    def _in_frames(self, row: Ints, body: Ints, xy: Floats) -> Floats:
        """Positions of the vertices of all triangles in the frames of their fragments (m); ``row``: of each cell, -1 for none."""
        mesh, living = self._mesh, np.flatnonzero(row >= 0)
        # Each fragment has turned from the plane of its mesh by the angle that fits the centres best.
        fragment, count = body[row[living]], int(body.max()) + 1
        turn = fit_rotations(fragment, count, mesh.xy[living], xy[row[living]])
        turn[~turn.any(axis=1), 0] = 1.0

        # A triangle belongs to the fragment of an edge that is not free. Vertices of that fragment stand at the centres of
        # their cells, or in their place beside them; others keep their place relative to the ends of that edge.
        triangle = mesh.triangle
        end = np.take_along_axis(triangle, (np.argmin(self._freed, axis=1)[:, None] + 1) % 3, axis=1)
        triangle_body = body[row[mesh.owner[end]]]
        self._of_body = triangle_body[:, 0]
        in_fragment = (row[mesh.owner[triangle]] >= 0) & (body[row[mesh.owner[triangle]]] == triangle_body)
        # Faces may close between centres of cells of one fragment; the rim of half a cell along the outline stays open.
        self._within: Booleans = np.asarray((in_fragment & (triangle < mesh.cells)).all(axis=1))
        anchor = np.where(in_fragment, mesh.owner[triangle], mesh.owner[end])
        offset = mesh.xy[triangle] - mesh.xy[anchor]
        c, s = turn[triangle_body, 0], turn[triangle_body, 1]
        turned = np.stack([c * offset[..., 0] - s * offset[..., 1], s * offset[..., 0] + c * offset[..., 1]], axis=2)
        vertex = np.asarray(xy[row[anchor]] + turned)
        self._middle = vertex.mean(axis=1)
        return vertex

    def blocks(self) -> tuple[Floats, Floats]:
        """Blocks of the stiffness of all nodes, for displacements (m) and rotations (rad): see `stiffness_blocks`."""
        if self._blocks is None:
            topology = self.topology
            self._blocks = stiffness_blocks(self._at, self._triangles.stiffness, topology.start, topology.second)
        return self._blocks

    def break_bond(self, bond: int, scale: Floats) -> Floats:
        """Free the edges of a bond (row of the state); returns w in rows: the stiffness falls by the sum of w w^T.

        ``scale`` turns all unknowns into lengths, in which the stiffness is taken.
        """
        old_freed, stiffness = self._freed, self._triangles.stiffness
        self._broken[self.topology.bond_number[bond]] = True
        self._freed = freed_edges(self._mesh, self._broken) | self.topology.lost
        self._whole = np.asarray(~self._freed.any(axis=1))
        changed = np.flatnonzero((self._freed != old_freed).any(axis=1))
        new = find_triangles(self._vertex[changed], self._freed[changed], self._p.youngs_modulus, self._p.poisson)
        new_stiffness = new.stiffness * self.volume[changed, None, None]
        at, index = np.unique(self._at[changed], return_inverse=True)
        index, reduction = index.reshape(-1, 9), np.zeros((at.size, at.size))
        np.add.at(reduction, (index[:, :, None], index[:, None, :]), stiffness[changed] - new_stiffness)
        least = NEGLIGIBLE * float((stiffness[changed] * scale[self._at[changed]][:, None, :] ** 2).max(initial=0.0))
        stiffness[changed], self._triangles.stress[changed] = new_stiffness, new.stress
        self._blocks = self._faces = self._tables = None
        if (at >= 3 * self.topology.elements).any():  # nodes on the outline have lost some hold
            self._outline = None
        self.at_tips = {}
        rows = factor_semidefinite(reduction * np.outer(scale[at], scale[at]), least)
        columns = np.zeros((len(rows), scale.size))
        columns[:, at] = rows
        return columns

    def displacements(self, of_elements: Floats) -> Floats:
        """Displacements of all nodes (m, m, rad) by the displacements of the elements; shape (nodes, 3)."""
        return node_displacements(self._nodes_on_outline(), of_elements)

    def _nodes_on_outline(self) -> OutlineNodes:
        if self._outline is None:
            # Of the triangles at the outline: no others touch these nodes.
            topology, rows = self.topology, np.flatnonzero((self._at >= 3 * self.topology.elements).any(axis=1))
            blocks = stiffness_blocks(self._at[rows], self._triangles.stiffness[rows], topology.start, topology.second)
            self._outline = outline_nodes(topology, *blocks)
        return self._outline

    @property
    def faces(self) -> ClosingFaces:
        """Faces of broken bonds that may close."""
        if self._faces is None:
            mesh, bond = self._mesh, self._mesh.edge_bond
            faces = (bond >= 0) & self._broken[bond] & self._freed & self._within[:, None]
            row = np.flatnonzero(faces.any(axis=1) & ~self._freed.all(axis=1))
            normal = self.topology.crack_normals(self._bonds)[bond[row]]
            # As it lies on the plane of the mesh, where all of a crack is in one place.
            across = find_gap_shares(mesh.xy[mesh.triangle[row]], self._freed[row], faces[row], normal)
            youngs, poisson = self._p.youngs_modulus, self._p.poisson
            self._faces = ClosingFaces(
                row, self._at[row], self._vertex[row], self._freed[row], across, self.volume[row], youngs, poisson
            )
        return self._faces

    def stresses(self, lattice: ElasticLattice, rows: Ints, of_elements: Floats, load: Floats) -> CellStresses:
        """Stress at intact bonds (rows of the state) and in all triangles, by displacements of the elements and their loads."""
        if self._tables is None or self._tables[0] is not rows:  # nearly always the rows of the previous step
            self._tables = rows, self._stress_tables(lattice, rows)
        tables, tensor, stress = self._tables[1], np.empty((rows.size, 3)), np.empty((rows.size, 2))
        displacement = self.displacements(of_elements)
        triangle = find_stresses(tables, displacement, load, tensor, stress)
        return CellStresses(displacement, triangle, tensor, stress, tables.bridges.bond)

    def _stress_tables(self, lattice: ElasticLattice, rows: Ints) -> StressTables:
        topology, number = self.topology, self.topology.bond_number[rows]
        row = np.full(self._broken.size, -1)
        row[number] = np.arange(rows.size)
        beside = np.stack([row[topology.bond_beside], topology.node_beside])
        first = lattice.first[rows]
        turned = np.where(topology.face_from[number] == first, 1.0, -1.0)
        is_across = topology.face_from[number] >= 0
        width = lattice.width[rows] * np.where(is_across, topology.face_length[number], self.facet[first])
        return StressTables(
            self._at, self._triangles.stress, self.faces.tables,
            topology.at_bond.exclude_freed(self._whole), topology.at_node.exclude_freed(self._whole), number,
            beside[:, beside[0] >= 0], (self._broken.size, topology.outer_nodes), self._bridges(lattice, rows),
            (lattice.first, lattice.second, rows, self._xy, topology.held), turned * topology.face_shift[number],
            lattice.thickness[rows] * width**2,
        )  # fmt: skip

    def _bridges(self, lattice: ElasticLattice, rows: Ints) -> Bridges:
        """Find the bonds by which alone some ice hangs: no held tie joins it to the rest along the outline."""
        topology = self.topology
        beside = topology.on_outline[held_ties(self._mesh, self._broken)[topology.outline_tie]]
        first, second = np.append(lattice.first, beside[:, 0]), np.append(lattice.second, beside[:, 1])
        joints = np.append(rows, lattice.first.size + np.arange(len(beside)))
        return find_bridges(first, second, joints, topology.elements)

    def facet_area(self, lattice: ElasticLattice, bond: int) -> float:
        """Area (m2) along which the cells of a bond meet."""
        return float(lattice.width[bond] * self.facet[lattice.first[bond]] * lattice.thickness[bond])

    def triangles_near(self, body: int, point: Floats, radius: float) -> NearTriangles:
        """Return the triangles of a fragment whose middle lies within a radius (m) of a point."""
        rows = np.flatnonzero((self._of_body == body) & (np.hypot(*(self._middle - point).T) <= radius))
        area = (self._mesh.weight * self._mesh.area)[rows]
        return NearTriangles(rows, self._vertex[rows], self._at[rows, 0:6:2] // 3, area, self._whole[rows])

    def mean_ahead(
        self, stress: Floats, body: int, point: Floats, direction: Floats, radius: float
    ) -> tuple[Floats, float]:
        """Stress (Pa; xx, yy, xy) of the ice ahead of a point in a fragment, and how much of the disc around it is ice.

        Weighted by area and by exp(-d^2 / 2 r^2), up to 3 r (after Wells and Sluys 2001, Int. J. Numer. Methods Eng. 50).
        """
        offset = self._middle - point
        square = (offset**2).sum(axis=1)
        weight = self._mesh.weight * self._mesh.area * exp_array(-0.5 * square / radius**2)
        weight *= (self._of_body == body) & (square <= 9.0 * radius**2)
        filled = float(weight.sum()) / (2.0 * math.pi * radius**2 * (1.0 - exp(-4.5)))
        weight *= offset[:, 0] * direction[0] + offset[:, 1] * direction[1] > 0.0
        total = float(weight.sum())
        return (np.asarray((weight[:, None] * stress).sum(axis=0) / total) if total > 0.0 else np.zeros(3)), filled


@kernel
def principal_stresses(tensor: Floats) -> Floats:
    """Largest tension and shear (Pa) of each tensor (xx, yy, xy), shape (places, 2)."""
    extremes = np.empty((tensor.shape[0], 2))
    for k in range(tensor.shape[0]):
        extremes[k, 0], extremes[k, 1] = principal(tensor[k, 0], tensor[k, 1], tensor[k, 2])
    return extremes
