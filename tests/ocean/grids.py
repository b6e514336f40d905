"""Grids on which the tests of this folder work."""

from __future__ import annotations

import numpy as np

from riftberg import Grid
from riftberg.state import new_elements


def square_lakes(rng, land=0.2):
    """Periodic Cartesian grid with random land."""
    return Grid.cartesian(11, 9, 1000.0, period=11_000.0, mask=(rng.random((9, 11)) > land) * 1.0)


def bent(rng, land=0.2):
    """General quadrilaterals in metres, closed, turned by half a radian, with random land."""
    x, y = np.meshgrid(np.arange(11.0), np.arange(10.0))
    x, y = x + rng.uniform(-0.2, 0.2, x.shape), y + rng.uniform(-0.2, 0.2, y.shape)
    c, s = np.full((9, 10), np.cos(0.5)), np.full((9, 10), np.sin(0.5))
    return Grid.from_corners(
        2000.0 * (np.cos(0.5) * x - np.sin(0.5) * y), 2000.0 * (np.sin(0.5) * x + np.cos(0.5) * y),
        latlon=False, regular=False, period=0.0, mask=(rng.random((9, 10)) > land) * 1.0,
        includes_southwest=True, cos_angle=c, sin_angle=s,
    )  # fmt: skip


def degrees(rng, land=0.2):
    """Eighth-degree grid in longitude and latitude, period 360, not cyclic, as in the A68a run."""
    lon, lat = np.meshgrid(322.0 + 0.125 * np.arange(12), -56.0 + 0.125 * np.arange(10))
    return Grid.from_corners(lon, lat, regular=False, mask=(rng.random((10, 12)) > land) * 1.0)


def cap(rng, land=0.0):
    """Round the north pole: 12 x 5 cells of 30 x 2 degrees, cyclic."""
    lon, lat = np.meshgrid(-180.0 + 30.0 * np.arange(1, 13), 80.0 + 2.0 * np.arange(1, 6))
    return Grid.from_corners(lon, lat, regular=False, mask=(rng.random((5, 12)) >= land) * 1.0)


ALL = (square_lakes, bent, degrees)
"""Grids on which every rule but the polar ones holds."""


def random_fields(grid, rng):
    """Random fields on all of a grid, halo included (copies in cyclic halos)."""
    shape = (grid.arrays.nj, grid.arrays.ni)
    return grid.fields(**{name: rng.normal(size=shape) for name in grid.fields()._fields})


def scattered(grid, count, rng, wet=True):
    """Elements at random places in (ocean) cells, located."""
    a = grid.arrays
    rows, columns = np.nonzero(a.mask[grid.domain] > (0.5 if wet else -1.0))
    pick = rng.integers(rows.size, size=count)
    e = new_elements(count)
    e.cell_i[:], e.cell_j[:] = columns[pick] + a.halo, rows[pick] + a.halo
    e.xi[:], e.eta[:] = rng.random(count), rng.random(count)
    i, j, x, y = e.cell_i, e.cell_j, e.xi, e.eta
    for q, out in ((a.lon, e.lon), (a.lat, e.lat)):
        out[:] = (q[j, i] * x + q[j, i - 1] * (1 - x)) * y + (q[j - 1, i] * x + q[j - 1, i - 1] * (1 - x)) * (1 - y)
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    return e
