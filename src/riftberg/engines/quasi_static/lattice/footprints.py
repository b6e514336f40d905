"""Footprints: the polygon of ice that each element stands for, cut by the outline of the berg.

The ice inside of an outline belongs to the nearest element, so the footprints fill it whatever the lattice, and a straight
front lands along its whole length. They are made once, on a plane of their own, and known by the identifiers of the elements,
so that births and melt leave them alone.

A crack is a line of its own (`riftberg.engines.quasi_static.fracture.crack_paths`). Where it has parted two fragments it
divides the ice between them. Along the sides of cells both would interlock by teeth that the lattice alone makes, and bear on
them as they slide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.engines.common.forces.sizes import count_sides, interaction_sizes
from riftberg.engines.common.lattices import laid_flat, lattices, outline_cells
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.lattice.crack_cuts import (
    area_and_centroid,
    count_crossings,
    distances_to_line,
    divide_polygon,
    shared_side,
    touches_line,
)
from riftberg.engines.quasi_static.lattice.frames import fit_rotations
from riftberg.parameters import KernelParameters
from riftberg.physics.elementary import atan2, cos_array, sin_array
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows


class Footprints(NamedTuple):
    """Polygons of the elements, on the plane on which each berg was first laid flat."""

    element: Ints  # Identifiers; shape (elements,)
    centre: Floats  # m; shape (elements, 2)
    size: Floats  # Plan area of the element then, m2; shape (elements,)
    east: Floats  # Angle (rad) on the plane at which the axes of its fragment lay then; shape (elements,)
    owner: Ints  # Place in ``element`` of the element of each polygon; shape (polygons,)
    start: Ints  # Where the corners of the polygons begin; shape (polygons + 1,)
    corner: Floats  # m; shape (corners, 2)
    cracked: Ints  # Identifiers of the bonds across which cracks have divided them; shape (bonds,)


FOOTPRINT_NAMES = tuple(f"footprint_{name}" for name in Footprints._fields)
"""Names in a restart file."""


NO_BONDS: Final = np.zeros(0, np.int64)

NEAREST_CRACK: Final = 0.1
"""Part of the way between two elements by which a crack stays clear of both: each keeps the ice under its centre."""

ONWARD: Final = 2.0
"""Way straight on beyond the last crossing of a crack, over the side of an element: to the outline, or to the face of another."""

SHORTEST_EDGE: Final = 1e-5
"""Shortest edge of a footprint, as a part of the radius: a few times the edges that the moved centres leave at a corner."""

SEAM: Final = 1e-4
"""Gap between polygons that counts as none, over the side of an element: ten edges of the shortest kind."""

SHORTEST_SHARED: Final = 20.0
"""Shortest side, over such a gap, along which two polygons adjoin: corners that meet share none."""

NO_AREA: Final = 1e-9
"""Area of a polygon, over the square of the radius, that is none."""

MOST_GROUPS: Final = 3
"""Groups in which the elements of a run are stepped."""


def add_new_footprints(
    footprints: Footprints | None, el: Elements, bonds: Bonds, outlines: Sequence[Any], p: KernelParameters
) -> Footprints:
    """Return the footprints, with new ones for new elements.

    ``outlines``: polygons (shapely) in the coordinates of positions, each of which its elements fill. Ice without one ends
    where its elements do.
    """
    has_footprint = np.zeros(el.size, bool) if footprints is None else find_rows(footprints.element, el.body.id)[1]
    if footprints is not None and has_footprint.all():
        return footprints
    radius = interaction_sizes(el, p).radius
    footprint_sets = [] if footprints is None else [footprints]
    is_lone = ~has_footprint
    is_lone[bonds.first] = is_lone[bonds.second] = False
    for outline in outlines:
        is_lone &= ~shapely.contains_xy(outline, el.lon, el.lat)
    if is_lone.any():
        has_footprint |= is_lone
        footprint_sets.append(_make_lone_footprints(el, np.flatnonzero(is_lone), radius[is_lone], p))
    for lattice_rows, outline in lattices(el, bonds, ~has_footprint, outlines):
        rows = lattice_rows[~has_footprint[lattice_rows]]
        footprint_sets.append(_make_footprints(el, bonds, rows, float(radius[rows].mean()), outline, p))
    return _join_footprints(footprint_sets)


def _make_lone_footprints(el: Elements, rows: Ints, radius: Floats, p: KernelParameters) -> Footprints:
    """Footprints of bergs of one element, all at once: squares or hexagons about circles of ``radius`` (m)."""
    kinds, kind = np.unique(el.body.sides[rows], return_inverse=True)
    sides = np.array([6 if count_sides(int(number), p) == 6 else 4 for number in kinds])[kind]
    owner = np.repeat(np.arange(rows.size), sides)
    start = np.concatenate([[0], np.cumsum(sides)]).astype(np.int64)
    angle = (np.arange(owner.size) - start[owner] + 0.5) * (2.0 * np.pi / sides[owner])
    distance = (radius / cos_array(np.pi / sides))[owner]
    size = el.body.length[rows] * el.body.width[rows]
    corner = np.column_stack([distance * cos_array(angle), distance * sin_array(angle)])
    centre, east = np.zeros((rows.size, 2)), np.zeros(rows.size)
    return Footprints(el.body.id[rows], centre, size, east, np.arange(rows.size), start, corner, NO_BONDS)


def _make_footprints(
    el: Elements, bonds: Bonds, rows: Ints, radius: float, outline: Any, p: KernelParameters
) -> Footprints:
    """Footprints of some elements on a plane of their own."""
    plane, xy = laid_flat(el, rows, p)
    if outline is None:
        index = np.full(el.size, -1)
        index[rows] = np.arange(rows.size)
        bonded = np.flatnonzero((index[bonds.first] >= 0) & (index[bonds.second] >= 0))
        along = xy[index[bonds.second[bonded[0]]]] - xy[index[bonds.first[bonded[0]]]] if bonded.size else (1.0, 0.0)
        hexagonal = count_sides(int(el.body.sides[rows[0]]), p) == 6
        packing = "hexagonal" if hexagonal else "square"
        ice = outline_cells(xy, radius, packing, atan2(along[1], along[0]))
    else:
        ice = shapely.transform(outline, plane.forward, interleaved=False)
    size, berg = el.body.length[rows] * el.body.width[rows], np.unique(el.berg[rows], return_inverse=True)[1]
    # The axes of a fragment are those at its centre of mass (`riftberg.engines.quasi_static.bodies.pose.bodies_from_elements`).
    mass = np.bincount(berg, el.body.mass[rows])
    x, y = (np.bincount(berg, el.body.mass[rows] * way) / mass for way in xy.T)
    east = plane.eastward(*plane.inverse(x, y))[berg]
    return Footprints(el.body.id[rows], xy, size, east, *_divide_ice(xy.tobytes(), ice, radius), NO_BONDS)


@lru_cache(maxsize=4)  # the members of a sweep begin with the same berg
def _divide_ice(centres: bytes, ice: Any, radius: float) -> tuple[Ints, Ints, Floats]:
    """Divide ice among centres: owner of each convex part, where its corners begin, and the corners (m)."""
    xy = np.frombuffer(centres).reshape(-1, 2)
    owner, rings = [], []
    for k, cell in enumerate(_nearest_regions(xy, ice, radius)):
        for ring in _convex_rings(shapely.intersection(cell, ice), radius):
            rings.append(ring)
            owner.append(k)
    start = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])]).astype(np.int64)
    return np.array(owner, np.int64), start, np.vstack(rings) if rings else np.zeros((0, 2))


def _convex_rings(ice: Any, radius: float) -> list[Floats]:
    """Divide polygons into convex ones; returns the corners of each (m), anticlockwise."""
    rings = []
    for polygon in shapely.get_parts(ice):
        if polygon.geom_type != "Polygon" or polygon.area < NO_AREA * radius * radius:
            continue
        # A hole is no part of a ring of corners, and contact needs convex faces: other polygons are laid out in triangles.
        convex = shapely.convex_hull(polygon).area <= (1.0 + 1e-12) * polygon.area
        pieces = [polygon] if convex else shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        for piece in pieces:
            ring = _without_short_edges(np.asarray(shapely.orient_polygons(piece).exterior.coords)[:-1, :2], radius)
            if len(ring) > 2:
                rings.append(ring)
    return rings


def _without_short_edges(ring: Floats, radius: float) -> Floats:
    """Return the corners of a polygon without edges of millimetres, which round-off and the moved centres leave at corners.

    They say not which way a face looks: the depth of an overlap that is cut by one would be a micrometre off, one way or the
    other. None are left of a needle that is no wider, as a crack along a side leaves it: it would stand in the ice of others.
    """
    edge = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T)
    is_needle = 2.0 * area_and_centroid(ring, 0, len(ring))[0] < SHORTEST_EDGE * radius * edge.sum()
    return np.asarray(ring[(edge > SHORTEST_EDGE * radius) & ~is_needle])


def _nearest_regions(xy: Floats, ice: Any, spacing: float) -> list[Any]:
    """Return for each centre the region that is nearer to it than to any other."""
    west, south, east, north = ice.bounds
    frame = shapely.box(west - 1.0, south - 1.0, east + 1.0, north + 1.0)
    if len(xy) == 1:
        return [frame]
    # Four centres of a square lattice lie on one circle, and round-off then crosses the sides of regions: moved by a
    # millionth of the lattice they do not.
    moved = xy + 1e-6 * spacing * np.random.default_rng(0).uniform(-1.0, 1.0, xy.shape)
    return list(shapely.get_parts(shapely.voronoi_polygons(shapely.multipoints(moved), extend_to=frame, ordered=True)))


def _join_footprints(sets: list[Footprints]) -> Footprints:
    """Return several sets of footprints as one."""
    elements = np.cumsum([0, *(footprints.element.size for footprints in sets)])
    corners = np.cumsum([0, *(len(footprints.corner) for footprints in sets)])
    start = [footprints.start[:-1] + n for footprints, n in zip(sets, corners, strict=False)]
    return Footprints(
        np.concatenate([footprints.element for footprints in sets]), np.vstack([footprints.centre for footprints in sets]),
        np.concatenate([footprints.size for footprints in sets]), np.concatenate([footprints.east for footprints in sets]),
        np.concatenate([footprints.owner + n for footprints, n in zip(sets, elements, strict=False)]),
        np.concatenate([*start, corners[-1:]]), np.vstack([footprints.corner for footprints in sets]),
        np.concatenate([footprints.cracked for footprints in sets]),
    )  # fmt: skip


def divide_by_cracks(footprints: Footprints, el: Elements, bonds: Bonds) -> Footprints:
    """Return the footprints, divided along the lines of cracks that have parted fragments since the last time.

    The ice beyond a line goes to the nearest element there that it adjoins.
    """
    crossed = np.flatnonzero(bonds.crack > 0)
    parted = crossed[el.berg[bonds.first[crossed]] != el.berg[bonds.second[crossed]]]
    if parted.size == 0 or (new := parted[~np.isin(bonds.id[parted], footprints.cracked)]).size == 0:
        return footprints
    rings: list[list[Floats]] = [[] for _ in footprints.element]
    for owner, (first, end) in zip(footprints.owner.tolist(), pairwise(footprints.start.tolist()), strict=True):
        rings[owner].append(footprints.corner[first:end])
    berg = np.zeros(footprints.element.size, np.int64)  # 0: melted away
    rows, is_present = find_rows(el.body.id, footprints.element)
    berg[is_present] = el.berg[rows[is_present]]
    for crack in np.unique(bonds.crack[new]).tolist():
        rows = parted[bonds.crack[parted] == crack]
        rows = rows[np.argsort(bonds.crack_order[rows])]
        for run in np.split(rows, np.flatnonzero(np.diff(bonds.crack_order[rows]) != 1) + 1):
            parts_now = np.isin(run, new)
            if run.size > 1 and parts_now.any():  # a line of one crossing has no direction
                i, j = (find_rows(footprints.element, el.body.id[ends[run]])[0] for ends in (bonds.first, bonds.second))
                # Those that the crack has parted earlier have moved on since: ice passed on between them would overlap.
                divided = np.isin(berg, berg[np.union1d(i[parts_now], j[parts_now])])
                _divide(rings, footprints, berg, i, j, bonds.crack_part[run], divided)
    all_rings = [ring for element_rings in rings for ring in element_rings]
    return footprints._replace(
        owner=np.repeat(np.arange(len(rings)), [len(element_rings) for element_rings in rings]),
        start=np.concatenate([[0], np.cumsum([len(ring) for ring in all_rings])]).astype(np.int64),
        corner=np.vstack(all_rings), cracked=np.concatenate([footprints.cracked, bonds.id[new]]),
    )  # fmt: skip


# Many arguments: the crack, and who is divided by it.
def _divide(
    rings: list[list[Floats]], footprints: Footprints, berg: Ints, i: Ints, j: Ints, fraction: Floats, divided: NDArray[np.bool_]
) -> None:  # fmt: skip
    """Divide polygons along a crack, which crosses the lines from the elements ``i`` to ``j`` at a fraction of each.

    ``divided``: elements of the fragments that it parts now.
    """
    centre = footprints.centre
    fraction = np.clip(fraction, NEAREST_CRACK, 1.0 - NEAREST_CRACK)[:, None]
    crossing = (1.0 - fraction) * centre[i] + fraction * centre[j]
    side, ends = math.sqrt(float(footprints.size[i].mean())), crossing[[0, -1]] - crossing[[1, -2]]
    ends = crossing[[0, -1]] + ONWARD * side * ends / np.hypot(*ends.T)[:, None]
    line = np.vstack([ends[:1], crossing, ends[1:]])
    neighbours = np.flatnonzero(divided)
    neighbours = neighbours[distances_to_line(centre[neighbours], line) <= 2.0 * side]
    scraps: list[tuple[float, int, Floats, Ints]] = []
    for e in neighbours.tolist():
        polygons = rings[e]
        if not any(touches_line(polygon, line) for polygon in polygons):
            continue
        pieces = _cut(polygons, centre[e], line, side)
        if not pieces:
            continue
        # It keeps the largest on the side of its centre; where a line passes or ends at the centre there may be none.
        beside = [piece for piece in pieces if piece.crossings == 0] or pieces
        kept = max(beside, key=attrgetter("area"))
        rings[e] = [kept.ring]
        for piece in pieces:
            if piece is kept:
                continue
            # Beyond the crack, or else beside it: a bend may part it from the largest piece, which has it where they adjoin.
            others = neighbours[(berg[neighbours] == berg[e]) == (piece.crossings % 2 == 0)]
            others = others[np.argsort(np.hypot(*(centre[others] - piece.middle).T))]
            scraps.append((piece.area, e, piece.ring, np.append(e, others) if piece.crossings == 0 else others))
    # The largest first: needles lie beside what an element has got.
    scraps.sort(key=lambda scrap: -scrap[0])
    while scraps:
        lonely = []
        for scrap in scraps:
            _, _, ring, others = scrap
            if (target := _find_neighbour(ring, rings, others, SEAM * side)) < 0:
                lonely.append(scrap)
            else:
                rings[target].append(ring)
        if len(lonely) == len(scraps):  # it adjoins nobody there
            for _, e, ring, _ in lonely:
                rings[e].append(ring)
            break
        scraps = lonely


class _Piece(NamedTuple):
    """What a crack leaves of a polygon of an element."""

    ring: Floats
    area: float  # m2
    middle: Floats  # m
    crossings: int  # How often the crack lies between it and the centre of its element


def _cut(polygons: list[Floats], centre: Floats, line: Floats, side: float) -> list[_Piece]:
    """Cut the polygons of an element along the line of a crack, without what is left of edges by round-off."""
    pieces = []
    for piece in (piece for polygon in polygons for piece in divide_polygon(polygon, line)):
        ring, (area, x, y) = _without_short_edges(piece, side), area_and_centroid(piece, 0, len(piece))
        if len(ring) >= 3:
            middle = np.array([x, y])
            pieces.append(_Piece(ring, area, middle, count_crossings(middle, centre, line)))
    return pieces


def _find_neighbour(ring: Floats, rings: list[list[Floats]], others: Ints, gap: float) -> int:
    """Return the first of other elements that shares a side with a polygon, -1 where none does."""
    for e in others.tolist():
        if sum(shared_side(ring, polygon, gap) for polygon in rings[e]) > SHORTEST_SHARED * gap:
            return int(e)
    return -1


class BodyFootprint(NamedTuple):
    """The footprints of the elements of fragments, in the coordinates of these."""

    rows: Ints  # Elements
    owner: Ints  # Place in ``rows`` of the element of each polygon
    start: Ints  # Where the corners of the polygons begin; shape (polygons + 1,)
    corner: Floats  # m; shape (corners, 2)


def body_footprint(
    footprints: Footprints, el: Elements, rows: Ints, xy: Floats, body: Ints | None = None, *, shrinks: bool = True
) -> BodyFootprint:
    """Lay footprints into the frames of fragments, in which the elements stand at ``xy`` (all elements, m).

    ``body``: fragment of each of the elements ``rows``; one where none is given. ``shrinks``: whether they have melted from the
    sides since they were made.
    """
    footprint_row, has_footprint = find_rows(footprints.element, el.body.id[rows])
    assert has_footprint.all()
    body = np.zeros(rows.size, np.int64) if body is None else body
    count = int(body.max(initial=0)) + 1
    # A fragment has turned from the plane of its footprints by the angle that fits the centres best; one of a single element
    # by the angle of the fragment of the start, as axes are carried along where a fragment parts.
    old_centre, centre, east = footprints.centre[footprint_row], xy[rows], footprints.east[footprint_row]
    fit = fit_rotations(body, count, old_centre, centre)[body]
    several = fit.any(axis=1)
    c, s = np.where(several, fit[:, 0], cos_array(east)), np.where(several, fit[:, 1], -sin_array(east))
    new_row = np.full(footprints.element.size, -1)
    new_row[footprint_row] = np.arange(rows.size)
    polygons = np.flatnonzero(new_row[footprints.owner] >= 0)
    owner, corners = new_row[footprints.owner[polygons]], np.diff(footprints.start)[polygons]
    start = np.concatenate([[0], np.cumsum(corners)]).astype(np.int64)
    index = np.arange(start[-1]) - np.repeat(start[:-1] - footprints.start[polygons], corners)
    corner_row = np.repeat(owner, corners)
    # Melt from the sides of an element leaves it smaller about its centre.
    shrunk = (
        np.sqrt(el.body.length[rows] * el.body.width[rows] / footprints.size[footprint_row])
        if shrinks
        else np.ones(rows.size)
    )
    offset = footprints.corner[index] - old_centre[corner_row]
    c, s, x, y = (c * shrunk)[corner_row], (s * shrunk)[corner_row], offset[:, 0], offset[:, 1]
    corner = centre[corner_row] + np.column_stack([c * x - s * y, s * x + c * y])
    return BodyFootprint(rows, owner, start, corner)


class FootprintBook:
    """The footprints of a run, which grow with its elements: one for all laws that need them.

    ``divided``: how often cracks have divided them. Results from the footprints of the same elements hold
    until it changes.
    """

    def __init__(self, model: RunState) -> None:
        self._footprints: Footprints | None = None
        # Elements and bonds that they hold for: of the groups that a population is stepped in.
        self._followed: list[tuple[bytes, ...]] = []
        self.divided = 0
        if model.step_number == 0:
            self.begin_step(model)

    def begin_step(self, model: RunState) -> None:
        """Bring them up to date, so that all of a time step sees the same footprints, and a resumed run too."""
        # Without contact, a bed of sediment and bonds nothing asks for them.
        if model.constants.interactions or model.parameters.grounding.law == "seabed" or model.bonds.first.size:
            self.follow(model)

    def follow(self, model: RunState) -> Footprints:
        """Make the footprints of elements that are new, and divide them by cracks."""
        el, bonds = model.elements, model.bonds
        key = tuple(array.tobytes() for array in (el.body.id, el.berg, bonds.id, bonds.crack))
        if self._footprints is not None and key in self._followed:
            return self._footprints
        footprints = add_new_footprints(self._footprints, el, bonds, model.outlines, model.constants)
        self._footprints = divide_by_cracks(footprints, el, bonds)
        self.divided += self._footprints is not footprints
        self._followed = [*self._followed[-MOST_GROUPS:], key]
        return self._footprints

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        return {} if self._footprints is None else dict(zip(FOOTPRINT_NAMES, self._footprints, strict=True))

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`."""
        if all(name in saved for name in FOOTPRINT_NAMES):
            self._footprints, self._followed = Footprints(*(np.array(saved[name]) for name in FOOTPRINT_NAMES)), []
            self.divided += 1
