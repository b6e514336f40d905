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

Their stiffness and stress as they are bonded now: `riftberg.engines.quasi_static.lattice.cell_stiffness`.
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
    places: bytes, firsts: bytes, seconds: bytes, outline: shapely.Polygon, spacing: float, both_diagonals: bool
) -> CellMesh:
    """Make the mesh, or take one that was made before."""
    centres = np.frombuffer(places).reshape(-1, 2)
    first, second = (np.frombuffer(ends, np.int64) for ends in (firsts, seconds))
    xy, triangle = _triangulation(centres, outline, spacing)
    owner = _owners(centres, xy[len(centres) :], outline)
    bond_of = {(min(a, b), max(a, b)): k for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True))}
    weight = np.ones(len(triangle))
    if both_diagonals:
        triangle, weight = _with_both_diagonals(triangle, len(centres), bond_of)
    area = _areas(xy, triangle)

    # Edges by the owners of their ends: inner, of a bond, or a tie.
    ends = np.sort(owner[np.stack([triangle[:, [1, 2, 0]], triangle[:, [2, 0, 1]]], axis=2)], axis=2)
    pairs, which = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
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
    edge_bond, edge_tie = (of_pair[which].reshape(-1, 3).astype(np.int64) for of_pair in (pair_bond, pair_tie))
    return CellMesh(
        len(centres), first.size, ties, xy, owner, triangle, weight, area, edge_bond, edge_tie, path_tie, path_bonds
    )


def lone_cell(xy: Floats) -> CellMesh:
    """Return a mesh of one cell without triangles, for ice that has no bonds."""
    none, no_edges = np.zeros(0), np.zeros((0, 3), np.int64)
    one, no_paths = np.zeros(1, np.int64), np.zeros((0, 1), np.int64)
    return CellMesh(1, 0, 0, xy, one, no_edges, none, none, no_edges, no_edges, one[:0], no_paths)


def joined(meshes: list[CellMesh]) -> CellMesh:
    """Return several meshes as one: cells, bonds and ties are numbered on, and nodes on outlines follow all cells."""
    before = np.cumsum([[0, 0, 0, 0], *((m.cells, m.bonds, m.ties, m.owner.size - m.cells) for m in meshes)], axis=0)
    longest = max(m.path_bonds.shape[1] for m in meshes)
    centres, outer, parts = [], [], []
    for m, (cells, bonds, ties, nodes) in zip(meshes, before, strict=False):
        number = np.arange(m.owner.size) + np.where(
            np.arange(m.owner.size) < m.cells, cells, before[-1, 0] + nodes - m.cells
        )
        path_bonds = np.full((len(m.path_tie), longest), -1)
        path_bonds[:, : m.path_bonds.shape[1]] = np.where(m.path_bonds >= 0, m.path_bonds + bonds, -1)
        centres.append((m.xy[: m.cells], m.owner[: m.cells] + cells))
        outer.append((m.xy[m.cells :], m.owner[m.cells :] + cells))
        of_bonds, of_ties = (
            np.where(of >= 0, of + start, -1) for of, start in ((m.edge_bond, bonds), (m.edge_tie, ties))
        )
        parts.append((number[m.triangle], m.weight, m.area, of_bonds, of_ties, m.path_tie + ties, path_bonds))
    nodes_of = (np.concatenate(arrays) for arrays in zip(*centres, *outer, strict=True))
    total_cells, total_bonds, total_ties, _ = before[-1].tolist()
    return CellMesh(
        total_cells, total_bonds, total_ties, *nodes_of, *(np.concatenate(of) for of in zip(*parts, strict=True))
    )


def held_ties(mesh: CellMesh, broken: Booleans) -> Booleans:
    """Return which ties a path of intact bonds holds, shape (ties,); ``broken``: of each bond."""
    whole = np.append(~broken, True)  # the last one stands for -1
    return np.asarray(np.bincount(mesh.path_tie, whole[mesh.path_bonds].all(axis=1), mesh.ties) > 0)


def freed_edges(mesh: CellMesh, broken: Booleans) -> Booleans:
    """Return which edges the broken bonds have freed, shape (triangles, 3); ``broken``: of each bond."""
    whole, held = np.append(~broken, True), np.append(held_ties(mesh, broken), True)  # the last ones stand for -1
    return np.asarray(~(whole[mesh.edge_bond] & held[mesh.edge_tie]))


def outline_ties(mesh: CellMesh) -> tuple[Ints, Ints]:
    """Return the ties by which what hangs by one bond meets the rest along the outline, and their cells, shape (ties, 2).

    By one bond as the mesh was made: what a crack has left hanging by one hangs by that alone. Cells do not meet where the ice
    of a third one parts them, as along a row, or where the outline turns inwards: in the bend of a row, or at the root of a
    finger, they touch in a point.
    """
    ends = mesh.triangle[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
    _, at, count = np.unique(np.sort(ends, axis=1), axis=0, return_index=True, return_counts=True)
    start, end = ends[at[count == 1]].T  # the outline, with the ice on its left
    following, leading = np.zeros((2, mesh.owner.size), np.int64)
    following[start], leading[end] = end, start
    tie = mesh.edge_tie.ravel()[at[count == 1]]
    start, end, tie = start[tie >= 0], end[tie >= 0], tie[tie >= 0]
    place, cells = mesh.xy @ np.array([1.0, 1.0j]), mesh.owner[np.column_stack([start, end])]
    one, other = place[cells].T
    reach = REACH * abs(other - one)
    along = place[end] - place[start]
    before, after = (
        place[start] - place[_farther(leading, place, start, reach)],
        place[_farther(following, place, end, reach)] - place[end],
    )
    turns = np.angle(along * before.conj()), np.angle(after * along.conj())
    inwards = np.min([*turns, turns[0] + turns[1]], axis=0) < -INWARDS

    # Where the outline is as far from the one as from the other.
    off, beyond = (abs(abs(place[n] - one) ** 2 - abs(place[n] - other) ** 2) for n in (start, end))
    middle = place[start] + along * (off / np.where(off + beyond > 0.0, off + beyond, 1.0))
    nearest = cKDTree(mesh.xy[: mesh.cells]).query(np.column_stack([middle.real, middle.imag]))[0]
    of_bond = np.column_stack([np.repeat(mesh.edge_bond.ravel(), 2), mesh.owner[ends].ravel()])
    first, second = np.unique(of_bond[of_bond[:, 0] >= 0], axis=0)[:, 1].reshape(-1, 2).T.copy()
    hangs = np.zeros(first.size, np.int64)
    hangs[find_bridges(first, second, np.arange(first.size), mesh.cells).bond] = 1
    block = connected_parts(mesh.cells, first, second, hangs)[cells]
    meet = (block[:, 0] != block[:, 1]) & ~inwards & (nearest > NEARER * abs(middle - one))
    tie, first = np.unique(tie[meet], return_index=True)
    return tie, cells[meet][first]


def _farther(step: Ints, place: Any, start: Ints, reach: Floats) -> Ints:
    """Nodes that are at least so far (m) from others, by steps along the outline."""
    node = step[start]
    for _ in range(MOST_STEPS):
        node = np.where(abs(place[node] - place[start]) < reach, step[node], node)
    return node


def _triangulation(centres: Floats, outline: shapely.Polygon, spacing: float) -> tuple[Floats, Ints]:
    """Nodes (centres first) and triangles that fill the outline."""
    outline = outline.simplify(OUTLINE_TOLERANCE * spacing)
    rings = [_nodes_of_ring(ring, spacing) for ring in (outline.exterior, *outline.interiors)]
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
                after = np.flatnonzero(missing)
                rings[n] = np.insert(ring, after + 1, 0.5 * (ring[after] + np.roll(ring, -1, axis=0)[after]), axis=0)
        if complete:
            return xy, triangle
    raise BergError(
        "the outline cannot be filled with triangles",
        remedy="Look for sides that nearly touch each other, or give smaller elements",
    )


def _nodes_of_ring(ring: shapely.LinearRing, spacing: float) -> Floats:
    """Nodes at each corner and between corners at the equal spacing nearest to ``spacing`` (m)."""
    corner = np.asarray(ring.coords)[:, :2]
    nodes = []
    for a, b in pairwise(corner):
        parts = max(1, round(float(np.hypot(*(b - a))) / spacing))
        nodes.append(a + (b - a) * (np.arange(parts) / parts)[:, None])
    return np.vstack(nodes)


def _owners(centres: Floats, nodes: Floats, outline: shapely.Polygon) -> Ints:
    """Cell of each node: the centre for itself; of nodes on the outline the nearest cell that no water parts from it."""
    count = min(8, len(centres))
    distance, near = cKDTree(centres).query(nodes, [*range(1, count + 1)])
    # Between equally near ones the first in the numbering, so that round-off does not decide.
    equal = distance <= distance[:, :1] * (1.0 + 1e-9)
    rank = np.lexsort((near, ~equal), axis=1) if count > 1 else np.zeros_like(near)
    near = np.take_along_axis(near, rank, axis=1)
    owner = near[:, 0].copy()
    if outline.area < outline.convex_hull.area * (1.0 - 1e-9):
        ice = outline.buffer(1e-6 * math.sqrt(outline.area))
        ways = np.stack([np.broadcast_to(nodes[:, None], (len(nodes), count, 2)), centres[near]], axis=2)
        over_ice = shapely.covers(ice, shapely.linestrings(ways))
        owner = np.take_along_axis(near, np.argmax(over_ice, axis=1)[:, None], axis=1)[:, 0]
    return np.concatenate([np.arange(len(centres)), owner])


def _areas(xy: Floats, triangle: Ints) -> Floats:
    """Area of each triangle (m2), negative where its nodes go round clockwise."""
    a, b, c = xy[triangle[:, 0]], xy[triangle[:, 1]], xy[triangle[:, 2]]
    return 0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


def _with_both_diagonals(triangle: Ints, cells: int, bond_of: dict[tuple[int, int], int]) -> tuple[Ints, Floats]:
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
    near: list[dict[int, int]] = [{} for _ in range(cells)]
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        near[a][b] = near[b][a] = k
    return near


def _shortest_path(neighbours: list[dict[int, int]], a: int, c: int) -> list[int]:
    """Bonds of the shortest path between two cells, the first one in the order of numbers; empty where there is none."""
    before: dict[int, int] = {a: a}
    waiting = deque([a])
    while waiting:
        here = waiting.popleft()
        if here == c:
            break
        for there in sorted(neighbours[here]):
            if there not in before:
                before[there] = here
                waiting.append(there)
    path, here = [], c
    while here != a and here in before:
        path.append(neighbours[here][before[here]])
        here = before[here]
    return path


NEVER = -1
"""Stands for the identifier of a bond between neighbours that were never bonded."""

MOST_MESHES = 4
"""Meshes that are made of a lattice, each with ice where the one before had left a bond without."""


class ElasticCells(NamedTuple):
    """The mesh of all bergs, and whose cells and bonds its are."""

    mesh: CellMesh
    element: Ints  # Identifiers of the elements; shape (cells,)
    bond: Ints  # Identifiers of the bonds; shape (bonds,)


CELL_NAMES = tuple(f"cells_{name}" for name in (*CellMesh._fields[3:], "element", "bond"))
"""Names in a restart file."""


def cells_to_arrays(cells: ElasticCells) -> dict[str, Any]:
    """Return what a restart file must hold of the cells."""
    mesh = cells.mesh
    return dict(zip(CELL_NAMES, (*mesh[3:], cells.element, cells.bond), strict=True))


def cells_from_arrays(saved: Mapping[str, Any]) -> ElasticCells:
    """Return the cells of a restart file."""
    *arrays, element, bond = (np.asarray(saved[name]) for name in CELL_NAMES)
    ties = 1 + max(int(saved[name].max(initial=-1)) for name in ("cells_edge_tie", "cells_path_tie"))
    mesh = CellMesh(element.size, bond.size, ties, *arrays)
    return ElasticCells(mesh, element, bond)


def with_new_cells(
    cells: ElasticCells | None, el: Elements, bonds: Bonds, outlines: Sequence[Any], p: KernelParameters
) -> ElasticCells:
    """Return the cells with those of elements that are new.

    ``outlines``: polygons (shapely) in the coordinates of positions, each of which its elements fill. Ice without one ends
    where its elements do.
    """
    known = np.zeros(el.size, bool) if cells is None else find_rows(cells.element, el.body.id)[1]
    if cells is not None and known.all():
        return cells
    if (known[bonds.first] != known[bonds.second]).any():
        raise RunError(
            "new elements are bonded to older ones, which elastic cells cannot follow (stepping.scheme: mts can)"
        )
    radius = interaction_sizes(el, p).bond_radius
    meshes = [] if cells is None else [cells.mesh]
    element = [] if cells is None else [cells.element]
    bond = [] if cells is None else [cells.bond]
    for rows, outline in lattices(el, bonds, ~known, outlines):
        mesh, ids = _mesh_of(el, bonds, rows, radius[rows], outline, p)
        meshes.append(mesh)
        element.append(el.body.id[rows])
        bond.append(ids)
    return ElasticCells(joined(meshes), np.concatenate(element), np.concatenate(bond))


def _widened(ice: Any, lines: Any, facet: float) -> Any:
    """Return ice that reaches a facet to either side of lines."""
    return shapely.unary_union([ice, *shapely.buffer(lines, facet, cap_style="flat")]) if lines.size else ice


def _mesh_of(
    el: Elements, bonds: Bonds, rows: Ints, radius: Floats, outline: Any, p: KernelParameters
) -> tuple[CellMesh, Ints]:
    """Mesh of some elements on a plane of their own, and the identifiers of its bonds."""
    plane, xy = laid_flat(el, rows, p)
    if rows.size == 1:
        return lone_cell(xy), np.zeros(0, np.int64)

    # Neighbours without a bond are parted: as if one had broken between them.
    place = np.full(el.size, -1)
    place[rows] = np.arange(rows.size)
    of_these = np.flatnonzero((place[bonds.first] >= 0) & (place[bonds.second] >= 0))
    ends = np.sort(np.column_stack([place[bonds.first[of_these]], place[bonds.second[of_these]]]), axis=1)
    near = np.sort(cKDTree(xy).query_pairs(2.0 * RADII_FACTOR * float(radius.max()), output_type="ndarray"), axis=1)
    apart = np.hypot(*(xy[near[:, 0]] - xy[near[:, 1]]).T)
    near = near[apart < RADII_FACTOR * (radius[near[:, 0]] + radius[near[:, 1]])]
    unbonded = np.array(sorted({*map(tuple, near.tolist())} - {*map(tuple, ends.tolist())}), np.int64).reshape(-1, 2)
    pairs = np.vstack([ends, unbonded])
    ids = np.concatenate([bonds.id[of_these], np.full(len(unbonded), NEVER)])

    hexagonal, spacing = bool(el.body.sides[rows[0]] == 6), 2.0 * float(radius.mean())
    ice = ice_on_plane(plane, xy, radius, outline, xy[pairs[0, 1]] - xy[pairs[0, 0]], hexagonal=hexagonal)
    # Bonded cells are joined by ice, also where the outline has a narrow inlet between them or they lie a little apart.
    across = shapely.linestrings(xy[ends])
    facet = float(radius.mean()) * (1.0 / np.sqrt(3.0) if hexagonal else 1.0)
    ice = _widened(ice, across[~shapely.covers(ice, across)], facet)
    if ice.geom_type != "Polygon":
        raise BergError(
            "a berg whose elements do not touch each other has no elastic cells",
            where="bonds", remedy="Place elements two radii apart, or set stepping.scheme = 'mts', whose bonds may be longer",
        )  # fmt: skip
    without = np.zeros(0, np.int64)
    for _ in range(MOST_MESHES):
        # A line within the ice may still pass so near to its edge that no edge of a triangle joins the cells.
        ice = _widened(ice, across[without], facet)
        mesh = cell_mesh(xy, pairs[:, 0], pairs[:, 1], ice, spacing, both_diagonals=not hexagonal)
        without = np.setdiff1d(np.arange(len(ends)), mesh.edge_bond)
        if not without.size:
            break
    if without.size:
        a, b = el.body.id[rows[ends[without[0]]]]
        raise BergError(
            f"no ice joins the elements {a} and {b}, which are bonded",
            where="bonds",
            remedy="Leave more room between the element and the outline, or set stepping.scheme = 'mts', which needs no outline",
        )  # fmt: skip
    return mesh, ids
