"""Triangles through the centres of the cells and nodes on the outline, and which bonds hold their edges.

A cell is the ice around one element. Its node is its centre; it owns the nodes of the outline to which it is nearest, and they
rotate with it. The triangles (Delaunay) fill the outline, whatever the packing and the direction of the lattice.

A bond that breaks frees the edges that belong to it:

- both ends owned by one cell: an inner edge, which never breaks;
- owned by bonded neighbours A and B: it belongs to the bond AB;
- owned by cells A and C that are no neighbours (diagonals of squares, pairs along the outline): a tie, which holds while an
  unbroken path A-B-C of two bonds is left. Where A and C have no common neighbour, their shortest path counts instead.

So any set of broken bonds that parts two pieces frees all edges between them: it cuts every path.

`ElasticCells` says which cell is which element of a run. The mesh of a berg is made once, on a plane of its own, and never
changes: `CellMesh` is the ice without strain. Elements and bonds are known by their identifiers, so that melt, births and
renumbered rows leave it alone; a bond that is gone is broken.

Their stiffness and stress with their present bonds: `riftberg.engines.quasi_static.lattice.cell_stiffness`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from riftberg.bergs.bonding import RADII_FACTOR
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts, find_bridges
from riftberg.engines.common.lattices import ice_on_plane, laid_flat, lattices
from riftberg.errors import BergError, RunError
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows

Booleans = NDArray[np.bool_]

OUTLINE_TOLERANCE = 0.02
"""Detail of an outline (in distances of cells) that is left out: a curve of many short sides would fill up with nodes."""

MAX_SPLITS = 12
"""How often sides of the outline are halved until all of them are edges of triangles; in narrow inlets a few times."""

INWARDS = math.radians(45.0)
"""Turn of the outline from which on it is the corner of a bend or the root of a finger, not the edge of a piece."""

REACH, MOST_STEPS = 0.35, 16
"""Length over which the direction of the outline counts, in distances of cells that a tie joins, and the nodes on it at most."""

NEARER = 0.6
"""Distance of a third cell from the outline between two, in parts of theirs, below which it parts them: 0.45 in a row of squares,
0.58 in a bend of hexagons."""


class CellMesh(NamedTuple):
    """Triangles of one piece of ice as it was without broken bonds. Edge ``i`` of a triangle lies opposite its vertex ``i``."""

    cells: int  # Nodes 0 to cells - 1 are the centres of the cells, the others lie on the outline
    bonds: int
    ties: int
    xy: Floats  # m; shape (nodes, 2)
    owner: Ints  # Cell with which a node rotates; shape (nodes,)
    triangle: Ints  # Nodes, counter-clockwise; shape (triangles, 3)
    weight: Floats  # 1/2 where both diagonals of four squares are taken, else 1; shape (triangles,)
    area: Floats  # Without the weight, m2; shape (triangles,)
    edge_bond: Ints  # Bond to which an edge belongs, -1 for none; shape (triangles, 3)
    edge_tie: Ints  # Tie to which an edge belongs, -1 for none; shape (triangles, 3)
    path_tie: Ints  # Tie that a path holds; shape (paths,)
    path_bonds: Ints  # Bonds of a path, filled up with -1; shape (paths, longest path)


def cell_mesh(
    centres: Floats, first: Ints, second: Ints, outline: shapely.Polygon, spacing: float, *, both_diagonals: bool
) -> CellMesh:
    """Fill an outline (m) with triangles through the centres of the cells and nodes on the outline.

    ``centres``: m, shape (cells, 2); ``first``, ``second``: ends of all bonds, broken ones too; ``spacing``: distance of
    bonded centres, m; ``both_diagonals``: for squares, which one diagonal alone would make stiffer in one direction.
    """
    ends = (np.asarray(end, np.int64).tobytes() for end in (first, second))
    return _cell_mesh(np.asarray(centres, np.float64).tobytes(), *ends, outline, spacing, both_diagonals)


@lru_cache(maxsize=4)  # the members of a sweep begin with the same berg
def _cell_mesh(
    centre_bytes: bytes, firsts: bytes, seconds: bytes, outline: shapely.Polygon, spacing: float, both_diagonals: bool
) -> CellMesh:
    """Make the mesh, or take one that was made before."""
    centres = np.frombuffer(centre_bytes).reshape(-1, 2)
    first, second = (np.frombuffer(ends, np.int64) for ends in (firsts, seconds))
    xy, triangle = _triangulation(centres, outline, spacing)
    owner = _owners(centres, xy[len(centres) :], outline)
    bond_of = {(min(a, b), max(a, b)): k for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True))}
    weight = np.ones(len(triangle))
    if both_diagonals:
        triangle, weight = _add_second_diagonals(triangle, len(centres), bond_of)
    area = _areas(xy, triangle)

    # Edges by the owners of their ends: inner, of a bond, or a tie.
    ends = np.sort(owner[np.stack([triangle[:, [1, 2, 0]], triangle[:, [2, 0, 1]]], axis=2)], axis=2)
    pairs, pair_of_edge = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    pair_bond, pair_tie = np.full(len(pairs), -1), np.full(len(pairs), -1)
    neighbours = _neighbours(len(centres), first, second)
    paths: list[tuple[int, list[int]]] = []
    ties = 0
    for k, (a, c) in enumerate(pairs.tolist()):
        if a == c:
            continue
        if (a, c) in bond_of:
            pair_bond[k] = bond_of[a, c]
            continue
        pair_tie[k] = ties
        common = sorted(neighbours[a].keys() & neighbours[c].keys())
        if common:
            paths += [(ties, [neighbours[a][b], neighbours[c][b]]) for b in common]
        else:
            shortest = _shortest_path(neighbours, a, c)
            paths += [(ties, shortest)] if shortest else []  # without any path the edge is free from the start
        ties += 1
    longest = max((len(bonds) for _, bonds in paths), default=1)
    path_bonds = np.array([bonds + [-1] * (longest - len(bonds)) for _, bonds in paths], np.int64).reshape(-1, longest)
    path_tie = np.array([tie for tie, _ in paths], np.int64)
    edge_bond, edge_tie = (of_pair[pair_of_edge].reshape(-1, 3).astype(np.int64) for of_pair in (pair_bond, pair_tie))
    return CellMesh(
        len(centres), first.size, ties, xy, owner, triangle, weight, area, edge_bond, edge_tie, path_tie, path_bonds
    )


def lone_cell(xy: Floats) -> CellMesh:
    """Return a mesh of one cell without triangles, for ice that has no bonds."""
    no_triangles, no_edges = np.zeros(0), np.zeros((0, 3), np.int64)
    owner, no_paths = np.zeros(1, np.int64), np.zeros((0, 1), np.int64)
    return CellMesh(1, 0, 0, xy, owner, no_edges, no_triangles, no_triangles, no_edges, no_edges, owner[:0], no_paths)


def join_meshes(meshes: list[CellMesh]) -> CellMesh:
    """Return several meshes as one: cells, bonds and ties are numbered on, and nodes on outlines follow all cells."""
    offset = np.cumsum([[0, 0, 0, 0], *((m.cells, m.bonds, m.ties, m.owner.size - m.cells) for m in meshes)], axis=0)
    longest = max(m.path_bonds.shape[1] for m in meshes)
    centres, outer, triangles = [], [], []
    for m, (cells, bonds, ties, nodes) in zip(meshes, offset, strict=False):
        number = np.arange(m.owner.size) + np.where(
            np.arange(m.owner.size) < m.cells, cells, offset[-1, 0] + nodes - m.cells
        )
        path_bonds = np.full((len(m.path_tie), longest), -1)
        path_bonds[:, : m.path_bonds.shape[1]] = np.where(m.path_bonds >= 0, m.path_bonds + bonds, -1)
        centres.append((m.xy[: m.cells], m.owner[: m.cells] + cells))
        outer.append((m.xy[m.cells :], m.owner[m.cells :] + cells))
        edge_bond, edge_tie = (
            np.where(edge_number >= 0, edge_number + start, -1)
            for edge_number, start in ((m.edge_bond, bonds), (m.edge_tie, ties))
        )
        triangles.append((number[m.triangle], m.weight, m.area, edge_bond, edge_tie, m.path_tie + ties, path_bonds))
    nodes_of = (np.concatenate(arrays) for arrays in zip(*centres, *outer, strict=True))
    total_cells, total_bonds, total_ties, _ = offset[-1].tolist()
    return CellMesh(
        total_cells, total_bonds, total_ties, *nodes_of, *(np.concatenate(arrays) for arrays in zip(*triangles, strict=True))
    )  # fmt: skip


def held_ties(mesh: CellMesh, broken: Booleans) -> Booleans:
    """Return which ties a path of intact bonds holds, shape (ties,); ``broken``: of each bond."""
    is_intact = np.append(~broken, True)  # the last one stands for -1
    return np.asarray(np.bincount(mesh.path_tie, is_intact[mesh.path_bonds].all(axis=1), mesh.ties) > 0)


def freed_edges(mesh: CellMesh, broken: Booleans) -> Booleans:
    """Return which edges the broken bonds have freed, shape (triangles, 3); ``broken``: of each bond."""
    is_intact = np.append(~broken, True)  # the last one stands for -1, as in the next line
    is_held = np.append(held_ties(mesh, broken), True)
    return np.asarray(~(is_intact[mesh.edge_bond] & is_held[mesh.edge_tie]))


class MeshOutline(NamedTuple):
    """How the cells of a mesh meet along its outline, whatever has broken."""

    tie: Ints  # See `_outline_ties`; shape (ties,)
    tie_cells: Ints  # shape (ties, 2)
    face_from: Ints  # See `_faces_across`; shape (bonds,)
    face_shift: Floats
    face_length: Floats


def find_outline(mesh: CellMesh) -> MeshOutline:
    """Find how the cells of a mesh meet along its outline."""
    ends = mesh.triangle[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
    _, at, count = np.unique(np.sort(ends, axis=1), axis=0, return_index=True, return_counts=True)
    edges = ends, at[count == 1]
    tie, tie_cells = _outline_ties(mesh, edges)
    face_from, face_shift, face_length = _faces_across(mesh, edges)
    return MeshOutline(tie, tie_cells, face_from, face_shift, face_length)


def _outline_ties(mesh: CellMesh, edges: tuple[Ints, Ints]) -> tuple[Ints, Ints]:
    """Return the ties by which ice that hangs by one bond meets the rest along the outline, and their cells, shape (ties, 2).

    By one bond as the mesh was made: ice that a crack has left hanging by one bond hangs by it alone. Cells do not meet
    where the ice of a third one parts them, as along a row, or where the outline turns inwards: in the bend of a row, or at the
    root of a finger, they touch in a point. ``edges``: ends of all edges of the triangles, and which lie on the outline.
    """
    ends, at = edges
    start, end = ends[at].T  # the outline, with the ice on its left
    following, leading = np.zeros((2, mesh.owner.size), np.int64)
    following[start], leading[end] = end, start
    tie = mesh.edge_tie.ravel()[at]
    start, end, tie = start[tie >= 0], end[tie >= 0], tie[tie >= 0]
    position, cells = mesh.xy, mesh.owner[np.column_stack([start, end])]
    first_centre, second_centre = position[cells].swapaxes(0, 1)
    reach = REACH * _distances(second_centre, first_centre)
    along = position[end] - position[start]
    incoming, outgoing = (
        position[start] - position[_farther(leading, position, start, reach)],
        position[_farther(following, position, end, reach)] - position[end],
    )
    turns = _turns(incoming, along), _turns(along, outgoing)
    inwards = np.min([*turns, turns[0] + turns[1]], axis=0) < -INWARDS

    middle = _parting_points(position, start, end, cells)
    nearest = cKDTree(mesh.xy[: mesh.cells]).query(middle)[0]
    bond_cell = np.column_stack([np.repeat(mesh.edge_bond.ravel(), 2), mesh.owner[ends].ravel()])
    first, second = np.unique(bond_cell[bond_cell[:, 0] >= 0], axis=0)[:, 1].reshape(-1, 2).T.copy()
    hangs = np.zeros(first.size, np.int64)
    hangs[find_bridges(first, second, np.arange(first.size), mesh.cells).bond] = 1
    block = connected_parts(mesh.cells, first, second, hangs)[cells]
    meet = (block[:, 0] != block[:, 1]) & ~inwards & (nearest > NEARER * _distances(middle, first_centre))
    tie, first = np.unique(tie[meet], return_index=True)
    return tie, cells[meet][first]


def _faces_across(mesh: CellMesh, edges: tuple[Ints, Ints]) -> tuple[Ints, Floats, Floats]:
    """Return how the faces of bonds lie that reach from outline to outline: the cell from which a bond counts, -1 for others.

    And by how much the middle of the face lies to the left of that of the bond, and its length, in parts of the distance of
    the cells; shape (bonds,) each. ``edges``: as of `_outline_ties`.
    """
    ends, at = edges
    bond = mesh.edge_bond.ravel()[at]
    at, bond = at[bond >= 0], bond[bond >= 0]
    order = np.argsort(bond, kind="stable")
    at, bond = at[order], bond[order]
    once = np.flatnonzero(np.bincount(bond, minlength=mesh.bonds) == 2)
    pair = np.searchsorted(bond, once)[:, None] + [0, 1]
    start, end = np.moveaxis(ends[at[pair]], -1, 0)
    cells = np.sort(mesh.owner[ends[at[pair]]], axis=-1)
    left, right = _parting_points(mesh.xy, start, end, cells).swapaxes(0, 1)
    first, second = mesh.xy[cells[:, 0]].swapaxes(0, 1)
    across, offset, distance = second - first, left + right - first - second, _distances(second, first)
    from_cell, shift, length = np.full(mesh.bonds, -1), np.zeros(mesh.bonds), np.zeros(mesh.bonds)
    from_cell[once], length[once] = cells[:, 0, 0], _distances(left, right) / distance
    shift[once] = 0.5 * (across[:, 0] * offset[:, 1] - across[:, 1] * offset[:, 0]) / distance**2
    return from_cell, shift, length


def _distances(a: Floats, b: Floats) -> Floats:
    """Distances (m) between points; shape without the last axis."""
    return np.asarray(np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]))


def _turns(a: Floats, b: Floats) -> Floats:
    """Angles (rad) from vectors to others, to the left."""
    left, ahead = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]
    return np.asarray(np.arctan2(left, ahead))


def _parting_points(position: Floats, start: Ints, end: Ints, cells: Ints) -> Floats:
    """Points of the outline, between nodes, at equal distances from the centres of two cells."""
    first, second = position[cells[..., 0]], position[cells[..., 1]]
    at_start, at_end = (
        abs(_distances(position[n], first) ** 2 - _distances(position[n], second) ** 2) for n in (start, end)
    )
    share = at_start / np.where(at_start + at_end > 0.0, at_start + at_end, 1.0)
    return np.asarray(position[start] + (position[end] - position[start]) * share[..., None])


def _farther(step: Ints, position: Floats, start: Ints, reach: Floats) -> Ints:
    """Nodes that are at least so far (m) from others, by steps along the outline."""
    node = step[start]
    for _ in range(MOST_STEPS):
        node = np.where(_distances(position[node], position[start]) < reach, step[node], node)
    return node


def _triangulation(centres: Floats, outline: shapely.Polygon, spacing: float) -> tuple[Floats, Ints]:
    """Nodes (centres first) and triangles that fill the outline."""
    outline = outline.simplify(OUTLINE_TOLERANCE * spacing)
    rings = [_divide_ring(ring, spacing) for ring in (outline.exterior, *outline.interiors)]
    for _ in range(MAX_SPLITS):
        xy = np.vstack([centres, *rings])
        # Triangles across bays are left out. Those without area stand on three nodes of one side.
        triangle = np.asarray(Delaunay(xy).simplices, np.int64)
        area = _areas(xy, triangle)
        triangle = np.where((area < 0.0)[:, None], triangle[:, ::-1], triangle)
        middle = xy[triangle].mean(axis=1)
        triangle = triangle[(abs(area) > 1e-9 * spacing**2) & shapely.contains_xy(outline, middle)]
        edges = {frozenset(e) for a in (0, 1, 2) for e in triangle[:, [a, a - 1]].tolist()}
        # Triangles may cross the outline at sides that are none of their edges: these get another node.
        start, complete = len(centres), True
        for n, ring in enumerate(rings):
            count = len(ring)
            missing = [frozenset((start + k, start + (k + 1) % count)) not in edges for k in range(count)]
            start += count
            if any(missing):
                complete = False
                side = np.flatnonzero(missing)
                rings[n] = np.insert(ring, side + 1, 0.5 * (ring[side] + np.roll(ring, -1, axis=0)[side]), axis=0)
        if complete:
            return xy, triangle
    raise BergError(
        "the outline cannot be filled with triangles",
        remedy="Look for sides that nearly touch each other, or give smaller elements",
    )


def _divide_ring(ring: shapely.LinearRing, spacing: float) -> Floats:
    """Nodes at each corner and between corners at the equal spacing nearest to ``spacing`` (m)."""
    corner = np.asarray(ring.coords)[:, :2]
    nodes = []
    for a, b in pairwise(corner):
        segments = max(1, round(float(np.hypot(*(b - a))) / spacing))
        nodes.append(a + (b - a) * (np.arange(segments) / segments)[:, None])
    return np.vstack(nodes)


def _owners(centres: Floats, nodes: Floats, outline: shapely.Polygon) -> Ints:
    """Cell of each node: the centre for itself; of nodes on the outline the nearest cell that no water parts from it."""
    count = min(8, len(centres))
    distance, candidates = cKDTree(centres).query(nodes, [*range(1, count + 1)])
    # Among equally near cells the first in the numbering, so that round-off does not decide.
    is_nearest = distance <= distance[:, :1] * (1.0 + 1e-9)
    rank = np.lexsort((candidates, ~is_nearest), axis=1) if count > 1 else np.zeros_like(candidates)
    candidates = np.take_along_axis(candidates, rank, axis=1)
    owner = candidates[:, 0].copy()
    if outline.area < outline.convex_hull.area * (1.0 - 1e-9):
        ice = outline.buffer(1e-6 * math.sqrt(outline.area))
        segments = np.stack([np.broadcast_to(nodes[:, None], (len(nodes), count, 2)), centres[candidates]], axis=2)
        over_ice = shapely.covers(ice, shapely.linestrings(segments))
        owner = np.take_along_axis(candidates, np.argmax(over_ice, axis=1)[:, None], axis=1)[:, 0]
    return np.concatenate([np.arange(len(centres)), owner])


def _areas(xy: Floats, triangle: Ints) -> Floats:
    """Area of each triangle (m2), negative where its nodes go round clockwise."""
    a, b, c = xy[triangle[:, 0]], xy[triangle[:, 1]], xy[triangle[:, 2]]
    return 0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


def _add_second_diagonals(triangle: Ints, cells: int, bond_of: dict[tuple[int, int], int]) -> tuple[Ints, Floats]:
    """Take both pairs of triangles of every four squares around a corner, with weight 1/2."""
    bonded = [
        [(min(t[i - 2], t[i - 1]), max(t[i - 2], t[i - 1])) in bond_of for i in range(3)] for t in triangle.tolist()
    ]
    diagonal: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for n, (t, of) in enumerate(zip(triangle.tolist(), bonded, strict=True)):
        if max(t) < cells and sum(of) == 2:
            apex = of.index(False)  # opposite the edge that is no bond
            a, c = t[apex - 2], t[apex - 1]
            diagonal.setdefault((min(a, c), max(a, c)), []).append((n, apex))
    weight, added = np.ones(len(triangle)), []
    for halves in diagonal.values():
        if len(halves) == 2:
            (n, i), (m, j) = halves
            weight[[n, m]] = 0.5
            b, d = int(triangle[n, i]), int(triangle[m, j])
            # The first triangle goes b, x, y counter-clockwise with x, y the ends of its diagonal, so d lies beyond it.
            x, y = int(triangle[n, i - 2]), int(triangle[n, i - 1])
            added += [(b, x, d), (b, d, y)]
    if added:
        triangle = np.vstack([triangle, np.array(added, np.int64)])
    return triangle, np.concatenate([weight, np.full(len(added), 0.5)])


def _neighbours(cells: int, first: Ints, second: Ints) -> list[dict[int, int]]:
    """Neighbours of each cell, and the bonds to them."""
    neighbours: list[dict[int, int]] = [{} for _ in range(cells)]
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        neighbours[a][b] = neighbours[b][a] = k
    return neighbours


def _shortest_path(neighbours: list[dict[int, int]], a: int, c: int) -> list[int]:
    """Bonds of the shortest path between two cells, the first one in the order of numbers; empty where there is none."""
    previous: dict[int, int] = {a: a}
    waiting = deque([a])
    while waiting:
        cell = waiting.popleft()
        if cell == c:
            break
        for neighbour in sorted(neighbours[cell]):
            if neighbour not in previous:
                previous[neighbour] = cell
                waiting.append(neighbour)
    path, cell = [], c
    while cell != a and cell in previous:
        path.append(neighbours[cell][previous[cell]])
        cell = previous[cell]
    return path


NEVER = -1
"""Stands for the identifier of a bond between neighbours that were never bonded."""

MOST_MESHES = 4
"""Meshes that are made of a lattice, each with ice where the one before had left a bond without."""


class ElasticCells(NamedTuple):
    """The mesh of all bergs, and the elements and bonds it stands for."""

    mesh: CellMesh
    element: Ints  # Identifiers of the elements; shape (cells,)
    bond: Ints  # Identifiers of the bonds; shape (bonds,)
    outline: MeshOutline

    @classmethod
    def of(cls, mesh: CellMesh, element: Ints, bond: Ints) -> ElasticCells:
        """Take elements and bonds to be those of a mesh."""
        return cls(mesh, element, bond, find_outline(mesh))


CELL_NAMES = tuple(f"cells_{name}" for name in (*CellMesh._fields[3:], "element", "bond"))
"""Names in a restart file."""


def cells_to_arrays(cells: ElasticCells) -> dict[str, Any]:
    """Return the arrays of the cells for a restart file."""
    mesh = cells.mesh
    return dict(zip(CELL_NAMES, (*mesh[3:], cells.element, cells.bond), strict=True))


def cells_from_arrays(saved: Mapping[str, Any]) -> ElasticCells:
    """Return the cells of a restart file."""
    *arrays, element, bond = (np.asarray(saved[name]) for name in CELL_NAMES)
    ties = 1 + max(int(saved[name].max(initial=-1)) for name in ("cells_edge_tie", "cells_path_tie"))
    mesh = CellMesh(element.size, bond.size, ties, *arrays)
    return ElasticCells.of(mesh, element, bond)


def add_new_cells(
    cells: ElasticCells | None, el: Elements, bonds: Bonds, outlines: Sequence[Any], p: KernelParameters
) -> ElasticCells:
    """Return the cells, with new ones for new elements.

    ``outlines``: polygons (shapely) in the coordinates of positions, each of which its elements fill. Ice without one ends
    where its elements do.
    """
    has_cell = np.zeros(el.size, bool) if cells is None else find_rows(cells.element, el.body.id)[1]
    if cells is not None and has_cell.all():
        return cells
    if (has_cell[bonds.first] != has_cell[bonds.second]).any():
        raise RunError(
            "new elements are bonded to older ones, which elastic cells cannot follow (stepping.scheme: mts can)"
        )
    radius = interaction_sizes(el, p).bond_radius
    meshes = [] if cells is None else [cells.mesh]
    element = [] if cells is None else [cells.element]
    bond = [] if cells is None else [cells.bond]
    for rows, outline in lattices(el, bonds, ~has_cell, outlines):
        mesh, ids = _make_mesh(el, bonds, rows, radius[rows], outline, p)
        meshes.append(mesh)
        element.append(el.body.id[rows])
        bond.append(ids)
    return ElasticCells.of(join_meshes(meshes), np.concatenate(element), np.concatenate(bond))


def _widen_ice(ice: Any, lines: Any, facet: float) -> Any:
    """Return ice that reaches a facet to either side of lines."""
    return shapely.unary_union([ice, *shapely.buffer(lines, facet, cap_style="flat")]) if lines.size else ice


def _make_mesh(
    el: Elements, bonds: Bonds, rows: Ints, radius: Floats, outline: Any, p: KernelParameters
) -> tuple[CellMesh, Ints]:
    """Mesh of some elements on a plane of their own, and the identifiers of its bonds."""
    plane, xy = laid_flat(el, rows, p)
    if rows.size == 1:
        return lone_cell(xy), np.zeros(0, np.int64)

    # Neighbours without a bond are parted: as if one had broken between them.
    row_in_mesh = np.full(el.size, -1)
    row_in_mesh[rows] = np.arange(rows.size)
    selected = np.flatnonzero((row_in_mesh[bonds.first] >= 0) & (row_in_mesh[bonds.second] >= 0))
    ends = np.sort(np.column_stack([row_in_mesh[bonds.first[selected]], row_in_mesh[bonds.second[selected]]]), axis=1)
    nearby = np.sort(cKDTree(xy).query_pairs(2.0 * RADII_FACTOR * float(radius.max()), output_type="ndarray"), axis=1)
    distance = np.hypot(*(xy[nearby[:, 0]] - xy[nearby[:, 1]]).T)
    nearby = nearby[distance < RADII_FACTOR * (radius[nearby[:, 0]] + radius[nearby[:, 1]])]
    unbonded = np.array(sorted({*map(tuple, nearby.tolist())} - {*map(tuple, ends.tolist())}), np.int64).reshape(-1, 2)
    pairs = np.vstack([ends, unbonded])
    ids = np.concatenate([bonds.id[selected], np.full(len(unbonded), NEVER)])

    hexagonal, spacing = bool(el.body.sides[rows[0]] == 6), 2.0 * float(radius.mean())
    ice = ice_on_plane(plane, xy, radius, outline, xy[pairs[0, 1]] - xy[pairs[0, 0]], hexagonal=hexagonal)
    # Bonded cells are joined by ice, also where the outline has a narrow inlet between them or they lie a little apart.
    segments = shapely.linestrings(xy[ends])
    facet = float(radius.mean()) * (1.0 / np.sqrt(3.0) if hexagonal else 1.0)
    ice = _widen_ice(ice, segments[~shapely.covers(ice, segments)], facet)
    if ice.geom_type != "Polygon":
        raise BergError(
            "a berg whose elements do not touch each other has no elastic cells",
            where="bonds", remedy="Place elements two radii apart, or set stepping.scheme = 'mts', whose bonds may be longer",
        )  # fmt: skip
    missing = np.zeros(0, np.int64)
    for _ in range(MOST_MESHES):
        # A line within the ice may still pass so near to its edge that no edge of a triangle joins the cells.
        ice = _widen_ice(ice, segments[missing], facet)
        mesh = cell_mesh(xy, pairs[:, 0], pairs[:, 1], ice, spacing, both_diagonals=not hexagonal)
        missing = np.setdiff1d(np.arange(len(ends)), mesh.edge_bond)
        if not missing.size:
            break
    if missing.size:
        a, b = el.body.id[rows[ends[missing[0]]]]
        raise BergError(
            f"no ice joins the elements {a} and {b}, which are bonded",
            where="bonds",
            remedy="Leave more room between the element and the outline, or set stepping.scheme = 'mts', which needs no outline",
        )  # fmt: skip
    return mesh, ids
