"""Shares that the elements have in the cells of an ocean grid, and sums over them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.physics.geometry import separation
from riftberg.physics.spreading import HEXAGON, RECTANGLE, add_shares, cover_all, lattice_angle
from riftberg.state import Bonds, Elements, Floats, Ints


@dataclass(frozen=True)
class Shares:
    """Shares of elements in cells, pair by pair."""

    first: Ints  # Place of the first pair of each element; shape (elements + 1,)
    cells: Ints  # Flat index of the cell in arrays with halo
    shares: Floats  # Part of the element in it; those of an element sum to one
    grid: Grid

    def sum(self, amount: Floats) -> Floats:
        """Return the amount of the elements in each cell of the domain, shape (nj, ni)."""
        area = self.grid.arrays.area
        out = np.zeros(area.size)
        add_shares(self.first, self.cells, self.shares, np.ascontiguousarray(amount, dtype=float), out)
        return out.reshape(area.shape)[self.grid.domain]

    def per_area(self, amount: Floats) -> Floats:
        """Return the amount over the area of each cell."""
        return np.asarray(self.sum(amount) / self.grid.arrays.area[self.grid.domain])

    def mean(self, values: Floats) -> Floats:
        """Return the mean of values of the cells, shape (nj, ni), over each element."""
        flat = self.grid.extended(values, outside="zero").ravel()[self.cells]
        return np.asarray(np.add.reduceat(flat * self.shares, self.first[:-1]))

    def taken(self, rows: Ints) -> Shares:
        """Return the shares of some elements, in that order."""
        counts = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        where = np.repeat(self.first[rows] - first[:-1], counts) + np.arange(first[-1])
        return Shares(first, self.cells[where], self.shares[where], self.grid)


def element_axes(elements: Elements, bonds: Bonds, p: Parameters) -> Floats:
    """Return the axis of each element, rad from east: of its lattice where it has bonds, else what it has turned by."""
    earth = p.earth
    unbroken = np.flatnonzero(bonds.status == 0)
    a, b = bonds.first[unbroken], bonds.second[unbroken]
    dx, dy = _apart(elements.lon, elements.lat, a, b, earth.latlon, earth.radius, earth.period)
    angle = np.empty(elements.size)
    folds = 6 if p.bonds.packing == "hexagonal" else 4
    sums = np.zeros((2, elements.size))
    lattice_angle(a, b, bonds.status[unbroken], dx, dy, folds, sums, elements.motion.rotation, angle)
    return angle


@kernel
def _apart(
    lon: Floats, lat: Floats, first: Ints, second: Ints, latlon: bool, radius: float, period: float
) -> tuple[Floats, Floats]:
    """Return the way (m) from the first to the second end of each bond."""
    dx, dy = np.empty(first.size), np.empty(first.size)
    for k in range(first.size):
        a, b = first[k], second[k]
        dx[k], dy[k] = separation(lon[b], lat[b], lon[a], lat[a], latlon, radius, period)
    return dx, dy


def shares_of(elements: Elements, bonds: Bonds, grid: Grid, p: Parameters) -> Shares:
    """Return the exact shares of all elements: elements of a hexagonal lattice are hexagons, all others rectangles."""
    g, place, body = grid.arrays, elements.place, elements.body
    shape = HEXAGON if p.bonds.packing == "hexagonal" and p.bonds.law != "none" else RECTANGLE
    angle = element_axes(elements, bonds, p)
    room = 2 * elements.size + 64
    while True:
        first = np.zeros(elements.size + 1, np.int64)
        cells, shares = np.zeros(room, np.int64), np.zeros(room)
        count = cover_all(
            place.lon, place.lat, place.cell_i, place.cell_j, shape, body.length, body.width, angle, g.lon, g.lat, g.mask,
            g.ni, g.nj, g.halo, g.latlon, g.cyclic, grid.earth_radius, g.period, first, cells, shares,
        )  # fmt: skip
        if count <= room:
            return Shares(first, cells[:count], shares[:count], grid)
        room = math.ceil(1.2 * count)
