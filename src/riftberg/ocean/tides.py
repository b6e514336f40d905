"""Random current near land, with the random numbers of the reference (equations 3.2)."""

from __future__ import annotations

import math

import numpy as np

from riftberg.ocean.grid_arrays import GridArrays
from riftberg.state import Elements, Floats, Ints


def cell_seed(i: int, j: int, ssh: float, halo: int) -> int:
    """Return the seed of a cell: i + 10000 j + int(16384 |sin(262144 ssh)|), i and j counted from 1 in the domain.

    ``ssh``: sea level in the cell, m.
    """
    return (i - halo + 1) + 10_000 * (j - halo + 1) + int(16384.0 * abs(math.sin(262144.0 * ssh)))


def _draws(cell_i: Ints, cell_j: Ints, ssh: Floats, halo: int, order: Ints | None = None) -> tuple[Floats, Floats]:
    """Two numbers in [-1, 1] per element; those of a cell draw as ``order`` says, or the last row first (equations 1.6)."""
    east, north = np.empty(cell_i.size), np.empty(cell_i.size)
    members: dict[tuple[int, int], list[int]] = {}
    for row in range(cell_i.size - 1, -1, -1) if order is None else order.tolist():
        members.setdefault((int(cell_j[row]), int(cell_i[row])), []).append(row)
    for (j, i), rows in members.items():
        stream = np.random.RandomState(cell_seed(i, j, float(ssh[j, i]), halo) % 2**32)
        # The reference makes each number of one 32-bit word; RandomState.random_sample would use two.
        words = stream.randint(0, 2**32, size=2 * len(rows), dtype=np.uint32)
        numbers = 2.0 * (words.astype(np.float64) / (2.0**32 - 1.0)) - 1.0
        east[rows], north[rows] = numbers[0::2], numbers[1::2]
    return east, north


def tidal_increment(mask: Floats, i: Ints, j: Ints, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return the current in cells (i, j) per unit of amplitude, for draws in [-1, 1]; 0 away from land (equations 3.2)."""
    to_west, to_east, to_south, to_north = mask[j, i - 1], mask[j, i + 1], mask[j - 1, i], mask[j + 1, i]
    along = np.minimum(0.0, east) * to_west + np.maximum(0.0, east) * to_east
    across = np.minimum(0.0, north) * to_south + np.maximum(0.0, north) * to_north
    here = mask[j, i]
    return along * (1.0 - to_south * to_north) * here, across * (1.0 - to_west * to_east) * here


def _at_elements(q: Floats, e: Elements, mirrored: bool) -> Floats:
    i, j, xi, eta = e.place.cell_i, e.place.cell_j, e.place.xi, e.place.eta
    x, y = (1.0 - xi, 1.0 - eta) if mirrored else (xi, eta)
    return (q[j, i] * x + q[j, i - 1] * (1.0 - x)) * y + (q[j - 1, i] * x + q[j - 1, i - 1] * (1.0 - x)) * (1.0 - y)


def add_tidal_drift(
    elements: Elements,
    grid: GridArrays,
    ssh: Floats,
    amplitude: float,
    mirrored: bool = False,
    order: Ints | None = None,
) -> None:
    """Add the random current near land to sampled currents ``uo vo ui vi`` (equations 3.2 tidal drift).

    ``ssh``: sea level, which seeds the random numbers of each cell, m; ``amplitude``: largest current added, m s-1.
    """
    e = elements
    east, north = _draws(e.cell_i, e.cell_j, ssh, grid.halo, order)
    along, across = (amplitude * q for q in tidal_increment(grid.mask, e.cell_i, e.cell_j, east, north))
    c, s = _at_elements(grid.cos_angle, e, mirrored), _at_elements(grid.sin_angle, e, mirrored)
    du, dv = c * along + s * across, c * across - s * along
    e.uo[:] += du
    e.ui[:] += du
    e.vo[:] += dv
    e.vi[:] += dv
