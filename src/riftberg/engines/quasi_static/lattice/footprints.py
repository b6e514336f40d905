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
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.ops import split

from riftberg.engines.common.forces.sizes import count_sides, interaction_sizes
from riftberg.engines.common.lattices import laid_flat, lattices, outline_cells
from riftberg.engines.common.run_state import RunState
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows


class Footprints(NamedTuple):
    """Polygons of the elements, on the plane on which each berg was first laid flat."""

    element: Ints  # Identifiers; shape (elements,)
    centre: Floats  # m; shape (elements, 2)
    size: Floats  # Plan area of the element then, m2; shape (elements,)
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
"""Shortest edge of a footprint, as a part of the radius: a few times what moving the centres makes of a corner."""


def with_new_footprints(
    footprints: Footprints | None, el: Elements, bonds: Bonds, outlines: Sequence[Any], p: KernelParameters
) -> Footprints:
    """Return the footprints with those of elements that are new.

    ``outlines``: polygons (shapely) in the coordinates of positions, each of which its elements fill. Ice without one ends
    where its elements do.
    """
    known = np.zeros(el.size, bool) if footprints is None else find_rows(footprints.element, el.body.id)[1]
    if footprints is not None and known.all():
        return footprints
    radius = interaction_sizes(el, p).radius
    parts = [] if footprints is None else [footprints]
    alone = ~known
    alone[bonds.first] = alone[bonds.second] = False
    for outline in outlines:
        alone &= ~shapely.contains_xy(outline, el.lon, el.lat)
    if alone.any():
        known |= alone
        parts.append(_footprints_of_lone(el, np.flatnonzero(alone), radius[alone], p))
    for whole, outline in lattices(el, bonds, ~known, outlines):
        rows = whole[~known[whole]]
        parts.append(_footprints_of(el, bonds, rows, float(radius[rows].mean()), outline, p))
    return _joined(parts)


def _footprints_of_lone(el: Elements, rows: Ints, radius: Floats, p: KernelParameters) -> Footprints:
    """Footprints of bergs of one element, all at once: squares or hexagons about circles of ``radius`` (m)."""
    kinds, kind = np.unique(el.body.sides[rows], return_inverse=True)
    sides = np.array([6 if count_sides(int(number), p) == 6 else 4 for number in kinds])[kind]
    owner = np.repeat(np.arange(rows.size), sides)
    start = np.concatenate([[0], np.cumsum(sides)]).astype(np.int64)
    angle = (np.arange(owner.size) - start[owner] + 0.5) * (2.0 * np.pi / sides[owner])
    away = (radius / np.cos(np.pi / sides))[owner]
    size = el.body.length[rows] * el.body.width[rows]
    corner = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    return Footprints(el.body.id[rows], np.zeros((rows.size, 2)), size, np.arange(rows.size), start, corner, NO_BONDS)


def _footprints_of(
    el: Elements, bonds: Bonds, rows: Ints, radius: float, outline: Any, p: KernelParameters
) -> Footprints:
    """Footprints of some elements on a plane of their own."""
    plane, xy = laid_flat(el, rows, p)
    if outline is None:
        place = np.full(el.size, -1)
        place[rows] = np.arange(rows.size)
        bonded = np.flatnonzero((place[bonds.first] >= 0) & (place[bonds.second] >= 0))
        along = xy[place[bonds.second[bonded[0]]]] - xy[place[bonds.first[bonded[0]]]] if bonded.size else (1.0, 0.0)
        hexagonal = count_sides(int(el.body.sides[rows[0]]), p) == 6
        packing = "hexagonal" if hexagonal else "square"
        ice = outline_cells(xy, radius, packing, float(np.arctan2(along[1], along[0])))
    else:
        ice = shapely.transform(outline, plane.forward, interleaved=False)
    size = el.body.length[rows] * el.body.width[rows]
    return Footprints(el.body.id[rows], xy, size, *_parts_of_ice(xy.tobytes(), ice, radius), NO_BONDS)


@lru_cache(maxsize=4)  # the members of a sweep begin with the same berg
def _parts_of_ice(centres: bytes, ice: Any, radius: float) -> tuple[Ints, Ints, Floats]:
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
        if polygon.geom_type != "Polygon" or polygon.area < 1e-9 * radius * radius:
            continue
        # A hole is no part of a ring of corners, and contact needs convex faces: other polygons are laid out in triangles.
        convex = shapely.convex_hull(polygon).area <= (1.0 + 1e-12) * polygon.area
        pieces = [polygon] if convex else shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        for piece in pieces:
            # An edge of millimetres, which the round-off and the moved centres leave at corners, says not which way a face
            # looks: the depth of an overlap that is cut by it would be a micrometre off, one way or the other.
            ring = np.asarray(shapely.orient_polygons(piece).exterior.coords)[:-1, :2]
            edge = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T)
            if np.count_nonzero(edge > SHORTEST_EDGE * radius) > 2:
                rings.append(ring[edge > SHORTEST_EDGE * radius])
    return rings


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


def _joined(parts: list[Footprints]) -> Footprints:
    """Return several as one."""
    elements = np.cumsum([0, *(part.element.size for part in parts)])
    corners = np.cumsum([0, *(len(part.corner) for part in parts)])
    start = [part.start[:-1] + n for part, n in zip(parts, corners, strict=False)]
    return Footprints(
        np.concatenate([part.element for part in parts]), np.vstack([part.centre for part in parts]),
        np.concatenate([part.size for part in parts]),
        np.concatenate([part.owner + n for part, n in zip(parts, elements, strict=False)]),
        np.concatenate([*start, corners[-1:]]), np.vstack([part.corner for part in parts]),
        np.concatenate([part.cracked for part in parts]),
    )  # fmt: skip


def divided_by_cracks(footprints: Footprints, el: Elements, bonds: Bonds) -> Footprints:
    """Return the footprints, divided along the lines of cracks that have parted fragments since the last time.

    The ice beyond a line goes to the nearest element there.
    """
    parted = np.flatnonzero((bonds.crack > 0) & (el.berg[bonds.first] != el.berg[bonds.second]))
    new = parted[~np.isin(bonds.id[parted], footprints.cracked)]
    if new.size == 0:
        return footprints
    rings: list[list[Floats]] = [[] for _ in footprints.element]
    for owner, ring in zip(footprints.owner, np.split(footprints.corner, footprints.start[1:-1]), strict=True):
        rings[owner].append(ring)
    berg = np.zeros(footprints.element.size, np.int64)  # 0: melted away
    rows, known = find_rows(el.body.id, footprints.element)
    berg[known] = el.berg[rows[known]]
    for crack in np.unique(bonds.crack[new]).tolist():
        rows = parted[bonds.crack[parted] == crack]
        rows = rows[np.argsort(bonds.crack_order[rows])]
        for run in np.split(rows, np.flatnonzero(np.diff(bonds.crack_order[rows]) != 1) + 1):
            if run.size > 1 and np.isin(run, new).any():  # a line of one crossing has no direction
                i, j = (find_rows(footprints.element, el.body.id[ends[run]])[0] for ends in (bonds.first, bonds.second))
                _divide(rings, footprints, berg, i, j, bonds.crack_part[run])
    every = [ring for of in rings for ring in of]
    return footprints._replace(
        owner=np.repeat(np.arange(len(rings)), [len(of) for of in rings]),
        start=np.concatenate([[0], np.cumsum([len(ring) for ring in every])]).astype(np.int64),
        corner=np.vstack(every), cracked=np.concatenate([footprints.cracked, bonds.id[new]]),
    )  # fmt: skip


def _divide(rings: list[list[Floats]], footprints: Footprints, berg: Ints, i: Ints, j: Ints, part: Floats) -> None:
    """Divide polygons along a crack, which crosses the lines between the elements ``i`` and ``j`` at a part of each way."""
    centre = footprints.centre
    part = np.clip(part, NEAREST_CRACK, 1.0 - NEAREST_CRACK)[:, None]
    way = (1.0 - part) * centre[i] + part * centre[j]
    side, ends = math.sqrt(float(footprints.size[i].mean())), way[[0, -1]] - way[[1, -2]]
    ends = way[[0, -1]] + ONWARD * side * ends / np.hypot(*ends.T)[:, None]
    crack = shapely.LineString([ends[0], *way, ends[1]])
    beside = np.flatnonzero(np.isin(berg, berg[np.union1d(i, j)]))
    beside = beside[shapely.dwithin(shapely.points(centre[beside]), crack, 2.0 * side)]

    def lies_beyond(place: Floats, e: int) -> bool:
        """Whether the crack runs between a place and an element."""
        crossings = shapely.intersection(shapely.LineString([place, centre[e]]), crack)
        return bool(shapely.get_num_coordinates(crossings) % 2)

    given: dict[int, list[Floats]] = {}
    for e in beside.tolist():
        polygons = [shapely.Polygon(ring) for ring in rings[e]]
        if not shapely.intersects(polygons, crack).any():
            continue
        rings[e] = []
        for piece in (piece for polygon in polygons for piece in split(polygon, crack).geoms):
            middle, to = np.array(piece.centroid.coords[0]), e
            if lies_beyond(middle, e):
                others = beside[berg[beside] != berg[e]]
                nearest = others[np.argsort(np.hypot(*(centre[others] - middle).T))].tolist()
                to = next((other for other in nearest if not lies_beyond(middle, other)), e)
            (rings[e] if to == e else given.setdefault(to, [])).extend(_convex_rings(piece, side))
    for e, more in given.items():
        rings[e].extend(more)


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
    at, known = find_rows(footprints.element, el.body.id[rows])
    assert known.all()
    body = np.zeros(rows.size, np.int64) if body is None else body
    count, number = int(body.max(initial=0)) + 1, np.bincount(body)
    # A fragment has turned from the plane of its footprints by the angle that fits the centres best.
    before, now = footprints.centre[at] @ (1.0, 1.0j), xy[rows] @ (1.0, 1.0j)

    def total(values: Any) -> Any:
        return np.bincount(body, values.real, count) + 1j * np.bincount(body, values.imag, count)

    size = np.maximum(number, 1)
    away, there = before - (total(before) / size)[body], now - (total(now) / size)[body]
    turn = total(away.conj() * there)
    turn = np.where(abs(turn) > 0.0, turn, 1.0)
    turn = (turn / abs(turn))[body]
    place = np.full(footprints.element.size, -1)
    place[at] = np.arange(rows.size)
    mine = np.flatnonzero(place[footprints.owner] >= 0)
    owner, corners = place[footprints.owner[mine]], np.diff(footprints.start)[mine]
    start = np.concatenate([[0], np.cumsum(corners)]).astype(np.int64)
    index = np.arange(start[-1]) - np.repeat(start[:-1] - footprints.start[mine], corners)
    of = np.repeat(owner, corners)
    # What melts from the sides of an element leaves it smaller about its centre.
    shrunk = (
        np.sqrt(el.body.length[rows] * el.body.width[rows] / footprints.size[at]) if shrinks else np.ones(rows.size)
    )
    corner = now[of] + (footprints.corner[index] @ (1.0, 1.0j) - before[of]) * (turn * shrunk)[of]
    return BodyFootprint(rows, owner, start, np.column_stack([corner.real, corner.imag]))


class FootprintBook:
    """The footprints of a run, which grow with its elements: one for all laws that need them.

    ``divided``: how often cracks have divided them. What is made of the footprints of known elements holds as long as it stays.
    """

    def __init__(self, model: RunState) -> None:
        self._footprints: Footprints | None = None
        self.divided = 0
        if model.step_number == 0:
            self.begin_step(model)

    def begin_step(self, model: RunState) -> None:
        """Bring them up to date: all of a time step sees the same, whoever asks first, and a resumed run those of the other."""
        # Without contact, a bed of sediment and bonds nothing asks for them.
        if model.constants.interactions or model.parameters.grounding.law == "seabed" or model.bonds.first.size:
            self.follow(model)

    def follow(self, model: RunState) -> Footprints:
        """Make the footprints of elements that are new, and divide them by cracks."""
        whole = with_new_footprints(self._footprints, model.elements, model.bonds, model.outlines, model.constants)
        self._footprints = divided_by_cracks(whole, model.elements, model.bonds)
        self.divided += self._footprints is not whole
        return self._footprints

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        return {} if self._footprints is None else dict(zip(FOOTPRINT_NAMES, self._footprints, strict=True))

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave."""
        # Earlier versions did not divide footprints by cracks.
        arrays = [np.array(saved[name]) for name in FOOTPRINT_NAMES if name in saved]
        if len(arrays) >= len(FOOTPRINT_NAMES) - 1:
            self._footprints = Footprints._make([*arrays, NO_BONDS][: len(FOOTPRINT_NAMES)])
            self.divided += 1
