"""Elastic cells of a run: which cell is which element.

The mesh of a berg is made once, on a plane of its own, and never changes: `CellMesh` is the ice without strain. Elements and
bonds are known by their identifiers, so that melt, births and renumbered rows leave it alone; a bond that is gone is broken.

Their stiffness and stress as they are bonded now: `riftberg.stepping.lattice.cell_stiffness`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from riftberg.bergs.bonding import RADII_FACTOR
from riftberg.errors import BergError, RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import nearest_image
from riftberg.plane import ConformalPlane
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import rows_of
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.lattice.cells import (
    CellMesh,
    cell_mesh,
    joined,
    lone_cell,
    outline_of_cells,
)

NEVER = -1
"""Stands for the identifier of a bond between neighbours that were never bonded."""

DISC = 0.2
"""Part of its radius by which the ice reaches beyond the centre of a cell at least, also where the outline does not."""


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
    known = np.zeros(el.size, bool) if cells is None else rows_of(cells.element, el.body.id)[1]
    if cells is not None and known.all():
        return cells
    if (known[bonds.first] != known[bonds.second]).any():
        raise RunError(
            "new elements are bonded to older ones, which elastic cells cannot follow (bonds.elasticity: bonds can)"
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


def lattices(el: Elements, bonds: Bonds, new: NDArray[np.bool_], outlines: Sequence[Any]) -> list[tuple[Ints, Any]]:
    """Return the rows of each lattice that has ``new`` elements, and the outline that it fills; None where none is known."""
    # An outline holds its elements, bonded or not; all others hang together by bonds, also by those that have broken.
    group = connected_parts(el.size, bonds.first, bonds.second, np.zeros(bonds.first.size, np.int64))
    ring: dict[int, Any] = {}
    rows = np.flatnonzero(new)
    for outline in outlines:
        inside = rows[shapely.contains_xy(outline, el.lon[rows], el.lat[rows])]
        if inside.size:
            joins = np.isin(group, group[inside])
            group[joins] = group[inside[0]]
            ring[int(group[inside[0]])] = outline
    order = np.argsort(group, kind="stable")
    numbers, begin = np.unique(group[order], return_index=True)
    of = dict(zip(numbers.tolist(), np.split(order, begin[1:]), strict=True))
    return [(of[number], ring.get(number)) for number in dict.fromkeys(group[rows].tolist())]


def laid_flat(el: Elements, rows: Ints, p: KernelParameters) -> tuple[ConformalPlane, Floats]:
    """Return a plane at the first of some elements, and their places (m) on it."""
    lon, lat = el.lon[rows].copy(), el.lat[rows]
    if not p.latlon:
        lon = np.array([lon[0] + nearest_image(x - lon[0], p.period) for x in lon])
    plane = ConformalPlane(float(lon[0]), float(lat[0]), p.earth_radius, p.latlon)
    return plane, np.column_stack(plane.forward(lon, lat))


def ice_on_plane(
    plane: ConformalPlane, xy: Floats, radius: Floats, outline: Any, along: Floats, *, hexagonal: bool
) -> Any:
    """Return the ice (shapely) of a lattice on its plane: its outline, or the cells themselves where none is known.

    ``along``: from a cell to a neighbour, m.
    """
    if outline is None:
        angle = float(np.arctan2(along[1], along[0]))
        return outline_of_cells(xy, float(radius.mean()), "hexagonal" if hexagonal else "square", angle)
    ice = shapely.transform(outline, plane.forward, interleaved=False)
    discs = shapely.buffer(shapely.points(xy), DISC * radius, quad_segs=2)
    outside = ~shapely.covers(ice, discs)
    return shapely.unary_union([ice, *discs[outside]])


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
            where="bonds.elasticity", remedy="Set it to 'bonds', or place elements two radii apart",
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
            where="bonds.elasticity", remedy="Set it to 'bonds', or leave more room between the element and the outline",
        )  # fmt: skip
    return mesh, ids
