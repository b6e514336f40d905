"""The outline of each berg of many elements as its sides melt, and the length of it along which each element melts.

Sides that melt move the outline inwards. How much ice that takes is a property of the outline, whatever the lattice in it:
each element loses the part of its cell that the outline passes over. A cell is the ice nearest to the centre of an element
(Voronoi). Cells and outlines lie on the plane of a lattice as it was when its melt began, so that they need not follow the
motion of the pieces.

Every time the outline has moved by a small part of an element it is drawn anew: without the ice that is nearer to it than
the retreat since then (Huygens), which may differ along it. Moved inwards once more by a small distance, it says what each
element will lose next; divided by that distance, this is the length of the front that the element bears until then.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Voronoi

from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.lattices import ice_on_plane, laid_flat, lattices
from riftberg.errors import InputError
from riftberg.parameters import KernelParameters
from riftberg.physics.elementary import cos_array, sin_array
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows, numbered

REACH: Final = 0.05
"""Retreat after which the outline is drawn anew, in parts of the size of an element."""

EARTH_AROUND: Final = 4.1e7
"""m"""

DETAIL: Final = 1e-4
"""Detail of the outline that is left out, in parts of the size of an element."""

ALONE: Final = -1.0
"""Front of an element that is a berg by itself: it melts as a block, on all its sides."""

SHAPES, OF_SHAPES, CELLS, SIZES = KEPT = "front_shapes", "front_bergs", "front_elements", "front_sizes"
"""Names under which a restart keeps outlines and cells: as bytes (WKB), outlines first; numbers of the fragments of the
outlines; identifier and fragment of the element of each cell; area (m2) of the element, and of its cell, at the start."""


class IceFronts(NamedTuple):
    """Outlines and cells on the planes of their lattices, m."""

    berg: Ints  # Fragments
    ice: Any  # Shapely geometries, one for each fragment
    element: Ints  # Identifiers of the elements of fragments of several
    fragment: Ints  # Of each element
    area: Floats  # Of each element at the start, m2
    cell_area: Floats  # Of each cell at the start, m2
    cell: Any  # Shapely polygons; those at the edge reach beyond the ice


def follow_outlines(
    el: Elements, bonds: Bonds, outlines: Sequence[Any], p: KernelParameters, remembered: MutableMapping[str, Any]
) -> None:
    """Set the front of each element (`Life.front`), and draw the outlines anew that have moved far enough or changed.

    ``outlines``: of lattices that are new (shapely, in the coordinates of positions), where they are known.
    """
    number, index = numbered(el.body.berg)
    many = (np.bincount(index, minlength=number.size)[index] > 1) & (el.body.berg > 0)
    rows = np.flatnonzero(many)
    el.life.front[~many] = ALONE
    ids, berg = el.body.id[rows], el.body.berg[rows]
    recorded = np.asarray(remembered.get(CELLS, np.zeros((0, 2), np.int64)))
    if np.array_equal(recorded, np.column_stack([ids, berg])) and (
        (el.life.retreat[rows] < REACH * np.sqrt(np.asarray(remembered[SIZES])[:, 0])).all() if rows.size else True
    ):
        return
    fronts = _add_lattices(_read_fronts(remembered), el, bonds, many, outlines, p)
    row, present = find_rows(el.body.id, fronts.element)
    index, _ = find_rows(fronts.element, ids)
    size = np.sqrt(fronts.area)

    ices, cell_groups = [], []
    for source in np.unique(fronts.fragment[index]).tolist():
        source_cells = np.flatnonzero(fronts.fragment == source)
        left = source_cells[present[source_cells]]
        retreat = el.life.retreat[row[left]]
        ice = fronts.ice[np.flatnonzero(fronts.berg == source)[0]]
        pieces = np.unique(el.body.berg[row[left]]).tolist()
        stays = pieces == [source] and left.size == source_cells.size and bool((retreat < REACH * size[left]).all())
        if not stays:
            ice = _moved_inwards(ice, fronts.cell[left], retreat, float(size[left].mean()))
            el.life.retreat[row[left]] = 0.0
        for piece in pieces:
            cells = index[berg == piece]
            cells = cells[fronts.fragment[cells] == source]
            if cells.size == 0:  # an element alone
                continue
            rest = (
                ice
                if stays
                else _remove_cells(ice, fronts, np.setdiff1d(left, cells), source_cells[~present[source_cells]])
            )
            if not stays:
                el.life.front[row[cells]] = _front(
                    rest, fronts, cells, el.body.length[row[cells]] * el.body.width[row[cells]]
                )
            ices.append((piece, rest))
            cell_groups.append(cells)
    cells = np.concatenate([*cell_groups, np.zeros(0, np.int64)])
    cells = cells[np.argsort(row[cells], kind="stable")]
    fragment = el.body.berg[row[cells]]
    fronts = IceFronts(
        np.array([piece for piece, _ in ices], np.int64), np.array([ice for _, ice in ices], object),
        fronts.element[cells], fragment, fronts.area[cells], fronts.cell_area[cells], fronts.cell[cells],
    )  # fmt: skip
    shapes = shapely.to_wkb(shapely.GeometryCollection([*fronts.ice, *fronts.cell]))
    remembered.update({
        SHAPES: np.frombuffer(shapes, np.uint8), OF_SHAPES: fronts.berg,
        CELLS: np.column_stack([fronts.element, fronts.fragment]), SIZES: np.column_stack([fronts.area, fronts.cell_area]),
    })  # fmt: skip


def hand_on_feet(el: Elements, gone: NDArray[np.bool_]) -> None:
    """Give feet and footloose bits of elements that have melted away to those along the fronts that are left of their bergs."""
    life, berg = el.life, el.body.berg
    giving = gone & (life.front >= 0.0)
    for number in np.unique(berg[giving]):
        left = (berg == number) & ~gone & (life.front > 0.0) & (life.fl_k >= 0.0)
        from_these = giving & (berg == number)
        if left.any():
            share = life.front[left] / life.front[left].sum()
            for stock in (life.fl_k, life.mass_of_fl_bits, life.mass_of_fl_bergy_bits):
                stock[left] += stock[from_these].sum() * share
                stock[from_these] = 0.0


def _add_lattices(
    fronts: IceFronts, el: Elements, bonds: Bonds, many: Any, outlines: Sequence[Any], p: KernelParameters
) -> IceFronts:
    """Return the fronts with the lattices that have elements not met before, each as one piece with a number below zero."""
    new = many & ~find_rows(fronts.element, el.body.id)[1]
    if not new.any():
        return fronts
    radius = interaction_sizes(el, p).bond_radius
    all_fronts = [fronts]
    for n, (rows, outline) in enumerate(lattices(el, bonds, new, outlines)):
        plane, xy = laid_flat(el, rows, p)
        where = np.full(el.size, -1)
        where[rows] = np.arange(rows.size)
        joined = np.flatnonzero((where[bonds.first] >= 0) & (where[bonds.second] >= 0))
        along = np.array([1.0, 0.0])
        if joined.size:
            along = xy[where[bonds.second[joined[0]]]] - xy[where[bonds.first[joined[0]]]]
        ice = ice_on_plane(plane, xy, radius[rows], outline, along, hexagonal=bool(el.body.sides[rows[0]] == 6))
        # Cell of each point (m): the plane nearer to it than to all others, far beyond the outermost points too.
        middle = xy.mean(axis=0)
        far = 10.0 * (float(np.ptp(xy, axis=0).max()) + 1.0)
        angle = np.arange(8) * (np.pi / 4.0) + 0.1
        voronoi = Voronoi(np.vstack([xy - middle, far * np.column_stack([cos_array(angle), sin_array(angle)])]))
        regions = [voronoi.regions[voronoi.point_region[k]] for k in range(len(xy))]
        cell = np.array([shapely.Polygon(voronoi.vertices[region] + middle) for region in regions], object)
        cell_area = np.asarray(shapely.area(shapely.intersection(cell, ice)))
        area = el.body.length[rows] * el.body.width[rows]
        berg_number = np.full(rows.size, -(n + 1))
        all_fronts.append(
            IceFronts(berg_number[:1], np.array([ice], object), el.body.id[rows], berg_number, area, cell_area, cell)
        )
    old = ~np.isin(fronts.element, np.concatenate([lattice_fronts.element for lattice_fronts in all_fronts[1:]]))
    all_fronts[0] = fronts._replace(**{name: getattr(fronts, name)[old] for name in IceFronts._fields[2:]})
    return IceFronts(*(np.concatenate(arrays) for arrays in zip(*all_fronts, strict=True)))


def _moved_inwards(ice: Any, cell: Any, retreat: Floats, size: float) -> Any:
    """Return the ice that lies farther from its edge than the retreat (m) of the nearest element."""
    if not retreat.any() or ice.is_empty:
        return ice
    sides = []
    for ring in shapely.get_parts(shapely.segmentize(ice.boundary, size)):
        corner = shapely.get_coordinates(ring)
        sides.append(np.stack([corner[:-1], corner[1:]], axis=1))
    side = np.concatenate(sides)
    nearest = shapely.STRtree(cell).query_nearest(shapely.points(side.mean(axis=1)), all_matches=False)[1]
    gone = shapely.union_all(shapely.buffer(shapely.linestrings(side), retreat[nearest], quad_segs=4))
    return shapely.simplify(shapely.difference(ice, gone), DETAIL * size)


def _remove_cells(ice: Any, fronts: IceFronts, others: Ints, lost: Ints) -> Any:
    """Return the ice of a piece, without the cells of others and of elements lost not by melt, which leaves less than half."""
    if lost.size:
        overlap = shapely.area(shapely.intersection(fronts.cell[lost], ice))
        lost = lost[overlap > 0.5 * fronts.cell_area[lost]]
    removed = np.concatenate([others, lost])
    return shapely.difference(ice, shapely.union_all(fronts.cell[removed])) if removed.size else ice


def _front(ice: Any, fronts: IceFronts, cells: Ints, area: Floats) -> Floats:
    """Length of the outline (m) along which each element of a piece melts; ``area``: of the elements now, m2.

    The sum is the length of the outline. The remaining part of a cell sets that of its element, so that elements larger
    or smaller than their cells (a lattice does not fill its outline exactly) are gone when the outline has passed them.
    """
    reach = REACH * float(np.sqrt(fronts.area[cells]).mean())
    inner = shapely.buffer(ice, -reach)
    shapely.prepare(inner)
    front = np.zeros(cells.size)
    edge = np.flatnonzero(~shapely.contains(inner, fronts.cell[cells]))
    left = shapely.area(shapely.intersection(fronts.cell[cells[edge]], inner))
    due = area[edge] - fronts.area[cells[edge]] * left / fronts.cell_area[cells[edge]]
    due = np.maximum(due, 0.0) if (due > 0.0).any() else area[edge]
    total = (ice.area - inner.area) / reach
    if total <= 0.0:  # the outline has closed before the last of its elements
        return np.full(cells.size, ALONE)
    front[edge] = total * due / due.sum()
    return front


def _read_fronts(remembered: Mapping[str, Any]) -> IceFronts:
    """Return the outlines and cells so far, none before the first step."""
    if SHAPES not in remembered:
        none, no_shape = np.zeros(0, np.int64), np.zeros(0, object)
        return IceFronts(none, no_shape, none, none, np.zeros(0), np.zeros(0), no_shape)
    berg, cells, sizes = (np.asarray(remembered[name]) for name in (OF_SHAPES, CELLS, SIZES))
    try:
        shape = shapely.get_parts(shapely.from_wkb(np.asarray(remembered[SHAPES], np.uint8).tobytes()))
    except shapely.errors.ShapelyError:
        shape = np.zeros(0, object)
    # A coordinate of which a byte has changed may still be a number; none is farther away than the Earth is round.
    far = np.abs(shapely.get_coordinates(shape)) > EARTH_AROUND
    if len(shape) != berg.size + len(cells) or not np.isin(cells[:, 1], berg).all() or far.any():
        raise InputError(
            "outlines that cannot be read", where=f"restart file, extra/{SHAPES}",
            remedy="Name a restart file that Riftberg wrote",
        )  # fmt: skip
    return IceFronts(
        berg, shape[: berg.size], cells[:, 0], cells[:, 1], sizes[:, 0], sizes[:, 1], shape[berg.size :]
    )  # fmt: skip
