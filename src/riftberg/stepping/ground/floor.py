"""The sea floor as a raster of cells, with the gouges in it, and footprints cut by the cells.

Cells lie in blocks of `BLOCK` by `BLOCK`: on a plane in rows and columns of the side ``cell``, on the sphere in rows of latitude
of that height, with as many columns in all rows of a block as make them that wide; so also along a plane that is periodic.
Depth is asked once, at the corners; in a cell it is the plane that fits them. A block that is one plane to a millimetre, and that
nothing has gouged, counts as one cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.seabed import cut
from riftberg.plane import near
from riftberg.state import Floats, Ints
from riftberg.stepping.lattice.footprints import BodyFootprint

Booleans = NDArray[np.bool_]

BLOCK: Final = 8
"""Cells along the side of a block."""

FLAT: Final = 1e-3
"""Largest distance (m) of the corners of cells from the plane of a block that counts as one cell."""

OPEN_DEPTH: Final = 1e4
"""Depth (m) where none is known."""

WIDE: Final = 8 * BLOCK
"""Cells along the side of the squares whose least depth is looked at before that of blocks."""

STEEPEST: Final = 0.5
"""Largest slope of the floor that the search for what may come near it reckons with."""

REACH: Final = 2.0
"""Clearance (m) up to which cells are kept for the search of the balance: a tilt may press on them."""

SHIFT: Final = 1 << 31
"""Rows of blocks are this far apart in the numbering of blocks."""

CORNERS: Final = 64
"""Most corners of a polygon between two cuts; those of an outline may have more, before the first cut."""


class Patches(NamedTuple):
    """Polygons of the keels of one fragment above single cells, with a linear overlap each."""

    start: Ints  # Where the corners begin; shape (polygons + 1,)
    corner: Floats  # x, y of the fragment (m), and overlap without heave (m); shape (corners, 3)
    owner: Ints  # Element, as a place in the fragment; shape (polygons,)
    gradient: Floats  # Of the depth, east and north; shape (polygons, 2)
    cell: Ints  # Block (its place in the store), row and column in it, -1 and -1 for a whole block; shape (polygons, 3)


class Keels(NamedTuple):
    """Footprints of the elements of one fragment, and which of them are looked at."""

    start: Ints  # Where the corners begin; shape (footprints + 1,)
    corner: Floats  # x, y (m), nothing, longitude (x on a plane), latitude (y) in cells; shape (corners, 5)
    owner: Ints  # Element, as a place in the fragment; shape (footprints,)
    draft: Floats  # Of the elements, m
    looked_at: Booleans  # Of the elements


class FloorCells(NamedTuple):
    """How cells lie."""

    cell: float  # Side, m
    latlon: bool
    radius: float  # Of the Earth, m
    period: float  # After which columns repeat, degrees or m; 0 where they do not


class Blocks(NamedTuple):
    """Blocks of the floor that are known; the arrays behind ``slot`` by their places in the store."""

    key: Ints  # Numbers, sorted
    slot: Ints  # Places in the store
    depth: Floats  # At the corners of cells, m; shape (places, BLOCK + 1, BLOCK + 1)
    gouge: Floats  # m; shape (places, BLOCK, BLOCK)
    plane: Floats  # Depth in the middle, its change by a cell eastward and northward, least depth; shape (places, 4)
    flat: Booleans  # One plane to `FLAT`


class Survey:
    """Least depths of squares of the floor that have been asked for that alone: most are too deep to be cut."""

    def __init__(self, side: int, margin: float) -> None:
        self.side, self.margin = side, margin  # Cells; m, that the floor may rise above what is known
        self.key = np.zeros(0, np.int64)  # Sorted
        self.least = np.zeros(0)

    def take(self, keys: Ints, least: Floats) -> None:
        """Take some squares into the store."""
        at = np.searchsorted(self.key, keys)
        self.key, self.least = np.insert(self.key, at, keys), np.insert(self.least, at, least)


class Floor:
    """Depths of the blocks that keels have come near to, and gouges by place."""

    def __init__(
        self, cell: float, depth: Callable[[Floats, Floats], Floats], latlon: bool, radius: float, middle: float = 0.0,
        period: float = 0.0,
    ) -> None:  # fmt: skip
        self.cell, self.latlon, self.radius = cell, latlon, radius
        self._raster = FloorCells(cell, latlon, radius, 360.0 if latlon else max(period, 0.0))
        # Longitude about which depths are asked for: a floor of one's own may know no other branch.
        self.middle = middle
        self._depth = depth
        # Wide squares are sampled at other places than blocks, less than a cell away.
        self._surveys = (Survey(WIDE, STEEPEST * cell), Survey(BLOCK, 0.0))
        self.gouges: dict[int, Floats] = {}  # By the number of the block; shape (BLOCK, BLOCK), m
        self._key = np.zeros(0, np.int64)  # Sorted
        self._slot = np.zeros(0, np.int64)
        # By slot; longer than what they hold, so that new blocks seldom copy all others
        self._corner = np.zeros((0, BLOCK + 1, BLOCK + 1))
        self._gouge = np.zeros((0, BLOCK, BLOCK))
        self._plane = np.zeros((0, 4))  # Depth in the middle, its change by a cell eastward and northward, least depth
        self._flat = np.zeros(0, np.bool_)
        self._room = 1024

    def near(
        self, body: BodyFootprint, lon: Floats, lat: Floats, draft: Floats, some: Booleans, level: float, way: float
    ) -> Booleans:
        """Which of ``some`` elements may come within `REACH` of the floor on a way of some metres, by least depths of blocks."""
        corner = self._coordinates(body, lon, lat)
        for survey in self._surveys:
            some = self._in_reach(survey, Keels(body.start, corner, body.owner, draft, some), level, way)
            if not some.any():
                break
        return some

    def _in_reach(self, survey: Survey, keels: Keels, level: float, way: float) -> Booleans:
        """Which elements that are looked at have a square of a survey within `REACH`."""
        raster = self._raster
        while True:
            near = np.zeros(keels.draft.size, np.bool_)
            missing = np.empty(self._room * BLOCK**2 // survey.side**2, np.int64)  # as many cells of either
            absent = squares_in_reach(
                keels,
                level,
                REACH + survey.margin,
                way / self.cell,
                raster,
                survey.side,
                survey.key,
                survey.least,
                near,
                missing,
            )
            if not absent:
                return near
            keys = np.unique(missing[:absent])
            survey.take(keys, self._depths(keys, survey.side).min(axis=(1, 2)))

    def _coordinates(self, body: BodyFootprint, lon: Floats, lat: Floats) -> Floats:
        """Corners for the kernels: x, y, nothing, longitude (x on a plane), latitude (y) in cells."""
        corner = np.empty((len(lon), 5))
        corner[:, :2], corner[:, 2], corner[:, 3] = body.corner, 0.0, lon
        corner[:, 4] = (DEGREE * self.radius if self.latlon else 1.0) * lat / self.cell
        if self.latlon:  # in one piece also where longitudes jump by a turn
            corner[:, 3] = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
        elif self._raster.period > 0.0:
            self.middle = float(lon[0])  # a formula knows no period: it is asked where the keel is, as elements ask it
        return corner

    def patches(
        self, body: BodyFootprint, lon: Floats, lat: Floats, draft: Floats, near: Booleans, level: float
    ) -> Patches:
        """Cut the footprints by the cells; ``lon``, ``lat`` are the positions of their corners.

        ``draft`` (m) and ``near`` (whether it is looked at) are those of the elements of the fragment.
        """
        keels = Keels(body.start, self._coordinates(body, lon, lat), body.owner, draft, near)
        raster = self._raster
        while True:
            room = self._room
            start, out = np.zeros(room + 1, np.int64), np.empty((8 * room, 3))
            owner, gradient, cell = np.empty(room, np.int64), np.empty((room, 2)), np.empty((room, 3), np.int64)
            missing = np.empty(room, np.int64)
            blocks = Blocks(self._key, self._slot, self._corner, self._gouge, self._plane, self._flat)
            found = Patches(start, out, owner, gradient, cell)
            count, absent = cut_by_cells(keels, level, raster, blocks, found, missing)
            if count < 0:
                self._room *= 2
            elif absent:
                self._add_blocks(np.unique(missing[:absent]))
            else:
                return Patches(start[: count + 1], out[: start[count]], owner[:count], gradient[:count], cell[:count])

    def _depths(self, keys: Ints, side: int = BLOCK) -> Floats:
        """Ask the depth at the corners of the cells of some blocks, or of squares of another ``side`` (cells)."""
        rows, columns = (keys + SHIFT // 2) // SHIFT, (keys + SHIFT // 2) % SHIFT - SHIFT // 2
        step = np.arange(side + 1)
        y = (rows[:, None, None] * side + step[None, :, None]) * self.cell
        x = columns[:, None, None] * side + step[None, None, :]
        per_degree = np.array([columns_of(row, side, self._raster) for row in rows])
        lon = np.broadcast_to(x / per_degree[:, None, None], (keys.size, side + 1, side + 1))
        lat = np.broadcast_to(y / (DEGREE * self.radius if self.latlon else 1.0), lon.shape)
        if self._raster.period > 0.0:
            lon = near(lon, self.middle, self._raster.period)
        return np.asarray(self._depth(lon.ravel(), lat.ravel()), float).reshape(lon.shape)

    def _add_blocks(self, keys: Ints) -> None:
        """Take some blocks into the store."""
        depth, step = self._depths(keys), np.arange(BLOCK + 1)
        # The plane that fits the corners of the block best.
        away = step - 0.5 * BLOCK
        weight = (BLOCK + 1) * (away * away).sum()
        mean, east = depth.mean(axis=(1, 2)), (depth * away).sum(axis=(1, 2)) / weight
        north = (depth * away[:, None]).sum(axis=(1, 2)) / weight
        fitted = mean[:, None, None] + east[:, None, None] * away + north[:, None, None] * away[:, None]
        gouged = np.isin(keys, list(self.gouges))
        flat = (abs(depth - fitted).max(axis=(1, 2)) < FLAT) & ~gouged
        gouge = np.zeros((keys.size, BLOCK, BLOCK))
        for n in np.flatnonzero(gouged).tolist():
            gouge[n] = self.gouges[int(keys[n])]
        known = self._key.size
        slot = known + np.arange(keys.size)
        if known + keys.size > len(self._flat):
            more = known + 2 * keys.size
            for name in ("_corner", "_gouge", "_plane", "_flat"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]), old.dtype)]))
        self._corner[slot], self._gouge[slot], self._flat[slot] = depth, gouge, flat
        self._plane[slot] = np.column_stack([mean, east, north, depth.min(axis=(1, 2))])
        at = np.searchsorted(self._key, keys)
        self._key, self._slot = np.insert(self._key, at, keys), np.insert(self._slot, at, slot)

    def keys_of(self, slots: Ints) -> Ints:
        """Numbers of blocks by their places in the store."""
        by_slot = np.empty(self._key.size, np.int64)
        by_slot[self._slot] = self._key
        return np.asarray(by_slot[slots])

    def plough(self, patches: Patches, excess: Floats) -> float:
        """Deepen the gouges by the volume (m3, of each polygon) in which the overlap exceeds what the bed bears; returns it all.

        A whole block that yields is from then on looked at by cells: these are deepened the next time.
        """
        gouging = np.flatnonzero(excess > 0.0)
        if not gouging.size:
            return 0.0
        keys, area = self.keys_of(patches.cell[gouging, 0]), self.cell * self.cell
        for key, (slot, j, i), volume in zip(
            keys.tolist(), patches.cell[gouging].tolist(), excess[gouging].tolist(), strict=True
        ):
            gouge = self._gouge[slot]
            if j >= 0:
                gouge[j, i] += volume / area
            self.gouges[key] = gouge.copy()
            self._flat[slot] = False
        return float(excess[gouging][patches.cell[gouging, 1] >= 0].sum())

    def settle(self, patches: Patches) -> None:
        """Deepen the gouges to where the keels are, so that nothing presses; whole blocks are looked at by cells from then on."""
        deepest = np.maximum.reduceat(patches.corner[:, 2], patches.start[:-1])
        deeper = np.zeros_like(self._gouge)
        for n in np.flatnonzero(deepest > 0.0).tolist():
            slot, j, i = patches.cell[n].tolist()
            self._flat[slot] = False
            if j >= 0:  # several elements may stand over a cell
                deeper[slot, j, i] = max(deeper[slot, j, i], deepest[n])
        self._gouge += deeper
        for slot in np.unique(patches.cell[deepest > 0.0, 0]).tolist():
            self.gouges[int(self.keys_of(np.array(slot)))] = self._gouge[slot].copy()

    def checkpoint(self) -> dict[int, Floats]:
        """Copy the gouges."""
        return {key: gouge.copy() for key, gouge in self.gouges.items()}

    def rollback(self, gouges: dict[int, Floats]) -> None:
        """Return to gouges that were copied before."""
        if not self.gouges:
            return
        slots = dict(zip(self._key.tolist(), self._slot.tolist(), strict=True))
        for key in self.gouges.keys() | gouges.keys():
            slot, before = slots.get(key, -1), gouges.get(key)
            if slot >= 0:
                self._gouge[slot] = 0.0 if before is None else before
                self._flat[slot] = before is None and self._is_flat(slot)
        self.gouges = {key: gouge.copy() for key, gouge in gouges.items()}

    def _is_flat(self, slot: int) -> bool:
        mean, east, north, _ = self._plane[slot]
        away = np.arange(BLOCK + 1) - 0.5 * BLOCK
        return bool(abs(self._corner[slot] - (mean + east * away + north * away[:, None])).max() < FLAT)

    def to_arrays(self) -> dict[str, Any]:
        """Return what a restart file must hold: blocks that have yielded."""
        keys = sorted(self.gouges)
        depth = np.stack([self.gouges[key] for key in keys]) if keys else np.zeros((0, BLOCK, BLOCK))
        return {"gouge_block": np.array(keys, np.int64), "gouge_depth": depth}

    def take_up(self, block: Ints, depth: Floats) -> None:
        """Go on from what `to_arrays` gave."""
        self.gouges = {int(key): np.array(gouge, np.float64) for key, gouge in zip(block, depth, strict=True)}


@kernel
def columns_of(row: int, side: int, raster: FloorCells) -> float:
    """Columns of cells per degree of longitude (per metre on a plane) in a row of blocks, of ``side`` cells each."""
    cell, latlon, radius, period = raster
    if period <= 0.0:
        return 1.0 / cell
    around = 2.0 * math.pi * radius * max(math.cos((row + 0.5) * side * cell / radius), 0.0) if latlon else period
    blocks = max(1.0, math.floor(around / (side * cell) + 0.5))
    return blocks * side / period


@kernel
def place_of(keys: Ints, key: int, at: int, before: int) -> int:
    """Where ``key`` stands among sorted numbers, or would; ``at``: of the one looked for ``before``, -1 for the first one.

    Neighbours of a row stand behind each other, so a step or two replaces a search.
    """
    if at < 0 or key < before:
        at = int(np.searchsorted(keys, key))
    while at < keys.size and keys[at] < key:
        at += 1
    return at


@kernel
def squares_in_reach(
    keels: Keels, level: float, reach: float, way: float, raster: FloorCells, side: int, keys: Ints, least: Floats,
    near: Booleans, missing: Ints,
) -> int:  # fmt: skip
    """Set which elements have a square within ``reach`` (m) on a ``way`` (cells); returns how many squares are missing.

    ``side``: of the squares, cells; ``keys``, ``least``: their numbers, sorted, and least depths (m).
    """
    start, corner, owner, draft, some = keels
    absent = 0
    for k in range(owner.size):
        e = owner[k]
        if near[e] or not some[e]:
            continue
        west, south = corner[start[k], 3], corner[start[k], 4]
        east, north = west, south
        for n in range(start[k], start[k + 1]):
            west, east = min(west, corner[n, 3]), max(east, corner[n, 3])
            south, north = min(south, corner[n, 4]), max(north, corner[n, 4])
        for jb in range(math.floor((south - way) / side), math.floor((north + way) / side) + 1):
            if near[e]:
                break
            per_degree = columns_of(jb, side, raster)
            around = round(per_degree * raster.period / side)
            first = math.floor((west * per_degree - way) / side)
            last = math.floor((east * per_degree + way) / side)
            at, before = -1, 0
            for ib in range(first, last + 1):
                # Numbers of columns go round once.
                key = jb * SHIFT + (ib % around if around > 0 else ib)
                at, before = place_of(keys, key, at, before), key
                if at >= keys.size or keys[at] != key:
                    if absent < missing.size:
                        missing[absent] = key
                        absent += 1
                elif least[at] + level - draft[e] <= reach:
                    near[e] = True
                    break
    return absent


@kernel
def cut_by_cells(
    keels: Keels, level: float, raster: FloorCells, blocks: Blocks, found: Patches, missing: Ints
) -> tuple[int, int]:
    """Write the polygons of `Patches`; returns how many there are (-1 where they do not fit) and how many blocks are missing."""
    start, corner, owner, draft, near = keels
    cell, latlon, radius = raster.cell, raster.latlon, raster.radius
    keys, slots, depths, gouges, planes, flat = blocks
    longest = 0
    for k in range(start.size - 1):
        longest = max(longest, start[k + 1] - start[k])
    most = 2 * longest + CORNERS
    row, block, line, piece, room = (
        np.empty((most, 5)), np.empty((most, 5)), np.empty((most, 5)), np.empty((most, 5)), np.empty((most, 5))
    )  # fmt: skip
    count, absent = 0, 0
    for k in range(owner.size):
        e = owner[k]
        if not near[e]:
            continue
        whole = corner[start[k] : start[k + 1]]
        low, high = whole[0, 4], whole[0, 4]
        for n in range(len(whole)):
            low, high = min(low, whole[n, 4]), max(high, whole[n, 4])
        for jb in range(math.floor(low / BLOCK), math.floor(high / BLOCK) + 1):
            size = cut(whole, len(whole), 4, jb * BLOCK, 1.0, room)
            size = cut(room, size, 4, (jb + 1) * BLOCK, -1.0, row)
            if size < 3:
                continue
            per_degree = columns_of(jb, BLOCK, raster)
            around = round(per_degree * raster.period / BLOCK)
            west, east = row[0, 3], row[0, 3]
            for n in range(size):
                west, east = min(west, row[n, 3]), max(east, row[n, 3])
            at, before = -1, 0
            for ib in range(math.floor(west * per_degree / BLOCK), math.floor(east * per_degree / BLOCK) + 1):
                # Numbers of columns go round once.
                key = jb * SHIFT + (ib % around if around > 0 else ib)
                at, before = place_of(keys, key, at, before), key
                if at >= keys.size or keys[at] != key:
                    if absent < missing.size:
                        missing[absent] = key
                        absent += 1
                    continue
                slot = slots[at]
                if planes[slot, 3] + level - draft[e] > REACH:
                    continue
                c = cut(row, size, 3, ib * BLOCK / per_degree, 1.0, room)
                c = cut(room, c, 3, (ib + 1) * BLOCK / per_degree, -1.0, block)
                if c < 3:
                    continue
                across = (
                    per_degree * 360.0 / (2.0 * math.pi * radius * math.cos((jb + 0.5) * BLOCK * cell / radius))
                    if latlon
                    else per_degree
                )
                if flat[slot]:
                    if count + 1 >= found.start.size or found.start[count] + c > len(found.corner):
                        return -1, 0
                    x0, y0 = (ib + 0.5) * BLOCK, (jb + 0.5) * BLOCK
                    count = _write(
                        block, c, e, draft[e] - level - planes[slot, 0], planes[slot, 1], planes[slot, 2], x0, y0,
                        per_degree, across, 1.0 / cell, slot, -1, -1, count, found,
                    )  # fmt: skip
                    continue
                bottom, top = block[0, 4], block[0, 4]
                for n in range(c):
                    bottom, top = min(bottom, block[n, 4]), max(top, block[n, 4])
                for j in range(max(math.floor(bottom) - jb * BLOCK, 0), min(math.floor(top) - jb * BLOCK + 1, BLOCK)):
                    s = cut(block, c, 4, jb * BLOCK + j, 1.0, room)
                    s = cut(room, s, 4, jb * BLOCK + j + 1, -1.0, line)
                    if s < 3:
                        continue
                    left, right = line[0, 3], line[0, 3]
                    for n in range(s):
                        left, right = min(left, line[n, 3]), max(right, line[n, 3])
                    first = max(math.floor(left * per_degree) - ib * BLOCK, 0)
                    last = min(math.floor(right * per_degree) - ib * BLOCK, BLOCK - 1)
                    for i in range(first, last + 1):
                        d00, d01 = depths[slot, j, i], depths[slot, j, i + 1]
                        d10, d11 = depths[slot, j + 1, i], depths[slot, j + 1, i + 1]
                        sunk = gouges[slot, j, i]
                        if min(d00, d01, d10, d11) + sunk + level - draft[e] > REACH:
                            continue
                        s2 = cut(line, s, 3, (ib * BLOCK + i) / per_degree, 1.0, room)
                        s2 = cut(room, s2, 3, (ib * BLOCK + i + 1) / per_degree, -1.0, piece)
                        if s2 < 3:
                            continue
                        if count + 1 >= found.start.size or found.start[count] + s2 > len(found.corner):
                            return -1, 0
                        count = _write(
                            piece, s2, e, draft[e] - level - 0.25 * (d00 + d01 + d10 + d11) - sunk,
                            0.5 * (d01 + d11 - d00 - d10), 0.5 * (d10 + d11 - d00 - d01), ib * BLOCK + i + 0.5,
                            jb * BLOCK + j + 0.5, per_degree, across, 1.0 / cell, slot, j, i, count, found,
                        )  # fmt: skip
    return count, absent


# Many arguments: the innermost step of `cut_by_cells`, which has most of it at hand as numbers and makes no object of
# them.
@kernel
def _write(
    piece: Floats, size: int, e: int, overlap: float, by_column: float, by_row: float, x0: float, y0: float,
    per_degree: float, across: float, along: float, slot: int, j: int, i: int, count: int, found: Patches,
) -> int:  # fmt: skip
    """Write a polygon above one cell, with ``overlap`` in the middle of the cell; returns how many there are now.

    ``across``, ``along``: cells per metre east and north.
    """
    at, out = found.start[count], found.corner
    for n in range(size):
        out[at + n, 0], out[at + n, 1] = piece[n, 0], piece[n, 1]
        out[at + n, 2] = overlap - by_column * (piece[n, 3] * per_degree - x0) - by_row * (piece[n, 4] - y0)
    found.start[count + 1] = at + size
    found.owner[count] = e
    found.gradient[count, 0], found.gradient[count, 1] = by_column * across, by_row * along
    found.cell[count, 0], found.cell[count, 1], found.cell[count, 2] = slot, j, i
    return count + 1
