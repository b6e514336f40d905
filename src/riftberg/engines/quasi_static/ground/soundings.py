"""Soundings: how deep and how steep the floor is in tiles that are fixed in the world, each of them sounded once.

What lies around a fragment is looked up in the tiles within its reach. So a survey costs what there is of new floor, however
wide or thin the berg is, and however far it goes in a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.engines.quasi_static.ground.pads import place_points
from riftberg.physics.elementary import asin, cos, sin
from riftberg.state import Floats, Ints

SPACING: Final = 300.0
"""Distance between soundings, m: about that of the points of pads at which the floor is asked."""

SOUNDINGS: Final = 16
"""Along each side of a tile."""

MOST_TILES: Final = 4096
"""Around one fragment; where more are in reach, tiles are twice as wide, or four times, with as many soundings."""

MOST_KNOWN: Final = 1 << 18
"""Tiles after which all are forgotten."""

BATCH: Final = 1 << 10
"""Tiles for which the depth is asked at once."""

BETWEEN: Final = 1.5
"""Part of the largest difference of neighbouring soundings by which the floor may rise between them: so a bell with a standard
deviation of two thirds of their distance, or a point of a bilinear chart of one and a half of it, is higher nowhere."""

ROWS: Final = 1 << 26
"""Rows and columns of tiles that keys can tell apart."""

DepthSampler = Callable[[Floats, Floats], Floats]


class Floor(NamedTuple):
    """The floor around a fragment, by tiles."""

    x: Floats  # Middles of the tiles in the frame of the fragment, m
    y: Floats
    half: float  # How far from its middle a tile reaches, m
    least: Floats  # Depth, m
    slope: Floats  # Steepest


@kernel
def _columns(row: int, height: float) -> int:
    """Tiles around the earth in a row, counted from the south pole, of a height in degrees."""
    low, high = row * height - 90.0, (row + 1) * height - 90.0
    widest = 0.0 if low < 0.0 < high else min(abs(low), abs(high))
    return max(1, math.ceil(360.0 * cos(widest * DEGREE) / height))


@kernel
def _key(doubled: int, row: int, column: int) -> int:
    """Number of a tile; ``doubled``: how often its side was."""
    return (doubled * ROWS + row + ROWS // 2) * ROWS + column + ROWS // 2


@kernel
def _is_within(x: float, y: float, box: Floats, reach: float) -> bool:
    """Whether a point is less than ``reach`` m from a box, along either axis."""
    return bool(max(box[0] - x, x - box[2], box[1] - y, y - box[3]) < reach)


# Many arguments: arrays that it fills.
@kernel
def _list_tiles(
    pose: Floats, box: Floats, reach: float, doubled: int, tile: float, latlon: bool, radius: float, key: Ints, x: Floats,
    y: Floats,
) -> int:  # fmt: skip
    """List the tiles within ``reach`` m of a box in the frame of a fragment; returns their number, -1 for no room.

    ``box``: least x and y, and largest; ``tile``: side, m.
    """
    tiles, half = 0, 0.71 * tile
    middle_x, middle_y = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    search_radius = math.hypot(box[2] - middle_x, box[3] - middle_y) + 1.5 * (reach + half)
    if (2.0 * search_radius / tile) ** 2 > 16.0 * key.size:
        return -1
    lon, lat = place_points(middle_x, middle_y, pose, latlon, radius)
    height, angle, wide, west, south = tile, search_radius, search_radius, 0.0, 0.0
    if latlon:
        height, angle, west, south = tile / radius / DEGREE, min(search_radius / radius / DEGREE, 180.0), -180.0, -90.0
        # The meridians that touch the circle of that angle; all of them where it holds a pole.
        wide = asin(sin(angle * DEGREE) / cos(lat * DEGREE)) / DEGREE if abs(lat) + angle < 90.0 else 180.0
    low, high = math.floor((lat - angle - south) / height), math.floor((lat + angle - south) / height) + 1
    if latlon:
        low, high = max(low, 0), min(high, math.ceil(180.0 / height))
    for row in range(low, high):
        columns = _columns(row, height) if latlon else ROWS
        width = 360.0 / columns if latlon else tile
        first, end = math.floor((lon - wide - west) / width), math.floor((lon + wide - west) / width) + 1
        phi = min((row + 0.5) * height - 90.0, 90.0) * DEGREE if latlon else 0.0
        across, c = cos(phi), sin(phi)
        for column in range(first, min(end, first + columns)):
            if latlon:
                theta = ((column + 0.5) * width - 180.0) * DEGREE
                a, b = across * cos(theta), across * sin(theta)
                w = 1.0 + pose[0, 2] * a + pose[1, 2] * b + pose[2, 2] * c
                if w < 0.1:  # nearly on the other side of the earth
                    continue
                u = 2.0 * radius * (pose[0, 0] * a + pose[1, 0] * b + pose[2, 0] * c) / w
                v = 2.0 * radius * (pose[0, 1] * a + pose[1, 1] * b + pose[2, 1] * c) / w
            else:
                dx, dy = (column + 0.5) * tile - pose[0, 2], (row + 0.5) * tile - pose[1, 2]
                u, v = pose[0, 0] * dx + pose[1, 0] * dy, pose[0, 1] * dx + pose[1, 1] * dy
            if not _is_within(u, v, box, reach + half):
                continue
            if tiles == key.size:
                return -1
            key[tiles], x[tiles], y[tiles] = _key(doubled, row, column % columns if latlon else column), u, v
            tiles += 1
    return tiles


@kernel
def _write_soundings(key: Ints, tile: float, latlon: bool, radius: float, lon: Floats, lat: Floats) -> None:
    """Write where tiles are sounded, each of them along its rows."""
    at, height = 0, tile / radius / DEGREE
    for k in key:
        row, column = k // ROWS % ROWS - ROWS // 2, k % ROWS - ROWS // 2
        high = wide = tile
        south, west = row * tile, column * tile
        if latlon:
            high, wide = height, 360.0 / _columns(row, height)
            south, west = row * high - 90.0, column * wide - 180.0
        for j in range(SOUNDINGS):
            for i in range(SOUNDINGS):
                lon[at], lat[at] = west + (i + 0.5) / SOUNDINGS * wide, south + (j + 0.5) / SOUNDINGS * high
                if latlon:
                    lat[at] = min(lat[at], 90.0)
                at += 1


@kernel
def _fill_tiles(depth: Floats, spacing: float, least: Floats, slope: Floats) -> None:
    """Find the least depth (m) that each tile can have, and its steepest slope, by the soundings."""
    for n in range(least.size):
        first, lowest, drop = n * SOUNDINGS * SOUNDINGS, math.inf, 0.0
        for j in range(SOUNDINGS):
            for i in range(SOUNDINGS):
                at = first + j * SOUNDINGS + i
                lowest = min(lowest, depth[at])
                if i > 0:
                    drop = max(drop, abs(depth[at] - depth[at - 1]))
                if j > 0:
                    drop = max(drop, abs(depth[at] - depth[at - SOUNDINGS]))
        least[n], slope[n] = lowest - BETWEEN * drop, 2.0 * drop / spacing + 1e-3


@kernel
def _look_up(sorted_keys: Ints, floor: Floats, key: Ints, values: Floats, unknown: Ints) -> int:
    """Take least depths and slopes of tiles from those that were sounded; lists the others, and returns how many there are."""
    count, at = 0, 0
    for n in range(key.size):
        if at == sorted_keys.size or sorted_keys[at] != key[n]:  # else it follows the last one in both lists
            at = np.searchsorted(sorted_keys, key[n])
        if at < sorted_keys.size and sorted_keys[at] == key[n]:
            values[0, n], values[1, n] = floor[0, at], floor[1, at]
            at += 1
        else:
            unknown[count] = key[n]
            count += 1
    return count


class Soundings:
    """Tiles of the floor that have been sounded."""

    def __init__(self, depth: DepthSampler, latlon: bool, radius: float) -> None:
        self._depth, self._latlon, self._radius = depth, latlon, radius
        self._key, self._floor = np.zeros(0, np.int64), np.zeros((2, 0))  # Sorted; least depth and steepest slope

    def find_tiles(self, pose: Floats, box: Floats, reach: float) -> Floor:
        """Return the tiles within ``reach`` m of a box (least x and y, and largest) in the frame of a fragment."""
        key, x, y = np.empty(MOST_TILES, np.int64), np.empty(MOST_TILES), np.empty(MOST_TILES)
        for doubled in count():
            tile = SOUNDINGS * SPACING * 2.0**doubled
            tiles = _list_tiles(pose, box, reach, doubled, tile, self._latlon, self._radius, key, x, y)
            if tiles >= 0:
                break
        key, x, y = key[:tiles], x[:tiles], y[:tiles]
        if self._key.size > MOST_KNOWN:
            self._key, self._floor = self._key[:0], self._floor[:, :0]
        least_and_slope, unknown = np.empty((2, tiles)), np.empty_like(key)
        if missing := _look_up(self._key, self._floor, key, least_and_slope, unknown):
            self._sound(unknown[:missing], tile)
            _look_up(self._key, self._floor, key, least_and_slope, unknown)
        return Floor(x, y, 0.71 * tile, *least_and_slope)

    def _sound(self, key: Ints, tile: float) -> None:
        """Sound tiles that are not known yet."""
        floor, each = np.empty((2, key.size)), SOUNDINGS * SOUNDINGS
        for first in range(0, key.size, BATCH):
            batch = key[first : first + BATCH]
            lon, lat = np.empty(each * batch.size), np.empty(each * batch.size)
            _write_soundings(batch, tile, self._latlon, self._radius, lon, lat)
            _fill_tiles(self._depth(lon, lat), tile / SOUNDINGS, *floor[:, first : first + BATCH])
        keys = np.concatenate([self._key, key])
        order = np.argsort(keys, kind="stable")
        self._key, self._floor = keys[order], np.concatenate([self._floor, floor], axis=1)[:, order]
