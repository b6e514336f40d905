"""The search for the cell that holds a point (equations 2.5)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.ocean.cells import contains, locate_in_cell, position_in_cell
from riftberg.physics.quadrilaterals import wrap_around
from riftberg.state import Floats, Ints

if TYPE_CHECKING:
    from riftberg.ocean.grid_arrays import GridArrays

COARSE = 16
"""Every so many cells stand in for the whole grid when a search looks for a place to start."""

MAX_WALK = 64
"""Steps after which a search gives up walking."""


@kernel
def _into_domain(i: int, grid: GridArrays) -> int:
    if grid.cyclic:
        return grid.halo + (i - grid.halo) % grid.ni
    return min(max(i, grid.halo), grid.halo + grid.ni - 1)


@kernel
def _guess_cell(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Cell that a point would have if the grid were evenly spaced; always inside the domain."""
    h, ni, nj = grid.halo, grid.ni, grid.nj
    west, south = grid.lon[h - 1, h - 1], grid.lat[h - 1, h - 1]
    width = (grid.lon[h - 1, h + ni - 1] - west) / ni
    height = (grid.lat[h + nj - 1, h - 1] - south) / nj
    column = min(max((wrap_around(x, west + 0.5 * width * ni, grid.period) - west) / width, -1e6), 1e6)
    row = min(max((y - south) / height, -1e6), 1e6)
    return _into_domain(h + math.floor(column), grid), min(max(h + math.floor(row), h), h + nj - 1)


@kernel
def _nearest_of_some(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Cell whose centre is nearest to a point, among every `COARSE`-th cell in both directions."""
    h, lon, lat = grid.halo, grid.lon_centre, grid.lat_centre
    narrowing = math.cos(y * DEGREE) if grid.latlon else 1.0
    best, best_i, best_j = np.inf, h, h
    for j in range(h + min(COARSE, grid.nj) // 2, h + grid.nj, COARSE):
        for i in range(h + min(COARSE, grid.ni) // 2, h + grid.ni, COARSE):
            dx = (wrap_around(x, lon[j, i], grid.period) - lon[j, i]) * narrowing
            distance = dx * dx + (y - lat[j, i]) ** 2
            if distance < best:
                best, best_i, best_j = distance, i, j
    return best_i, best_j


@kernel
def _walk(x: float, y: float, i: int, j: int, stride: float, grid: GridArrays) -> tuple[int, int, bool]:
    """Follow the cell coordinates from cell to cell, at most ``stride`` cells at once, until the point is inside."""
    lon, lat, latlon, regular, period = grid.lon, grid.lat, grid.latlon, grid.regular, grid.period
    south, north = grid.halo, grid.halo + grid.nj - 1
    for _ in range(MAX_WALK):
        xi, eta, inside = locate_in_cell(x, y, i, j, lon, lat, latlon, regular, period)
        if inside:
            return i, j, True
        if math.isnan(xi) or math.isnan(eta):
            break
        next_i = _into_domain(i + math.floor(min(max(xi, -stride), stride)), grid)
        next_j = min(max(j + math.floor(min(max(eta, -stride), stride)), south), north)
        if next_i == i and next_j == j:
            break
        i, j = next_i, next_j
    return i, j, False


@kernel
def search_nearby(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Return the cell that holds a point as `find_cell` does, but (-1, -1) if walking through the grid fails.

    Starts from the cell of an evenly spaced grid, then from the nearest of a coarse choice of cells.
    """
    i, j = _guess_cell(x, y, grid)
    i, j, cell = _walk(x, y, i, j, 1e6, grid)
    if not cell:
        i, j = _nearest_of_some(x, y, grid)
        i, j, cell = _walk(x, y, i, j, 4.0, grid)
    return (i, j) if cell else (-1, -1)


@kernel
def find_cell(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Return array column and row of the domain's cell (no halo) that holds a point, or (-1, -1) (equations 2.5).

    Walks through the grid, and scans all cells if that fails.
    """
    i, j = search_nearby(x, y, grid)
    if i >= 0:
        return i, j
    h, lon, lat, latlon, period = grid.halo, grid.lon, grid.lat, grid.latlon, grid.period
    for row in range(h, h + grid.nj):
        for column in range(h, h + grid.ni):
            if contains(x, y, column, row, lon, lat, latlon, period):
                return column, row
    return -1, -1


@kernel
def locate_points(
    lon: Floats, lat: Floats, grid: GridArrays, thorough: bool, cell_i: Ints, cell_j: Ints, xi: Floats, eta: Floats
) -> None:
    """Fill cell and coordinates in the cell of many points; ``cell_i`` = -1 for points outside the domain."""
    h = grid.halo
    domain = grid.lat[h - 1 : h + grid.nj, h - 1 : h + grid.ni]
    south, north = domain.min(), domain.max()
    columns = grid.lon[h - 1 : h + grid.nj, h - 1 : h + grid.ni]
    west, east = columns.min(), columns.max()
    for n in range(lon.size):
        x, y = wrap_around(lon[n], 0.5 * (west + east), grid.period), lat[n]
        cell_i[n], cell_j[n], xi[n], eta[n] = -1, -1, np.nan, np.nan
        if not (south <= y <= north) or (not grid.cyclic and not (west <= x <= east)):
            continue
        i, j = find_cell(x, y, grid) if thorough else search_nearby(x, y, grid)
        if i >= 0:
            cell_i[n], cell_j[n] = i, j
            xi[n], eta[n], _ = position_in_cell(x, y, i, j, grid)
