"""Where points lie on grids that are not straight: in cells between two-dimensional positions, or near scattered points.

Positions become unit vectors, so that poles and the date line are places like any other. The nearest point of the grid
is found with a k-d tree; of the cells around it the one that holds the target is taken, and its bilinear coordinates
by Newton's method in the plane that touches the earth at the target.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from riftberg.plane import unit_vectors
from riftberg.products.stencil import Stencil

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BEYOND = 0.5
"""Cells beyond the outermost points at which the outermost value is still taken."""

REACH = 1.5
"""Usual distances between scattered points within which the nearest ones are taken."""

NEIGHBOURS = 3
_ROUNDING = 1e-6
_BLOCK = 200_000


def _tree(points: Floats) -> tuple[Any, Integers]:
    """Return a k-d tree of the finite points (n, 3) and their numbers."""
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    return cKDTree(points[known]), known


def goes_round_in_x(points: Floats) -> bool:
    """Tell whether the last column of points (rows, columns, 3) is a neighbour of the first."""
    if points.shape[1] < 4:
        return False
    steps, seams = (
        np.linalg.norm(np.diff(points, axis=1), axis=-1),
        np.linalg.norm(points[:, -1] - points[:, 0], axis=-1),
    )
    if np.isnan(steps).all() or np.isnan(seams).all():
        return False
    step, seam = np.nanmedian(steps), np.nanmedian(seams)
    return bool(0.2 * step < seam < 1.5 * step)


def curvilinear(lon: Floats, lat: Floats, to_lon: Floats, to_lat: Floats) -> Stencil:
    """Place targets on a grid with two-dimensional positions.

    ``lon``, ``lat``: positions of the grid (degrees, any branch) ((rows, columns)).
    """
    points = unit_vectors(lon, lat)
    rows, columns = points.shape[:2]
    round_x = goes_round_in_x(points)
    tree, known = _tree(points.reshape(-1, 3))
    targets = unit_vectors(np.ravel(to_lon), np.ravel(to_lat))
    nearest = known[tree.query(np.nan_to_num(targets))[1]]
    index, weight = np.zeros((4, len(targets)), np.int64), np.full((4, len(targets)), np.nan)
    for start in range(0, len(targets), _BLOCK):
        part = slice(start, start + _BLOCK)
        index[:, part], weight[:, part] = _in_cells(points, targets[part], nearest[part], round_x)
    where = np.stack([nearest // columns, nearest % columns])
    return Stencil(index, weight, where, np.shape(to_lon), (rows, columns), round_x)


def _in_cells(points: Floats, targets: Floats, nearest: Integers, round_x: bool) -> tuple[Integers, Floats]:
    """Return corners and weights of the cell around each target; NaN weights where there is none."""
    rows, columns = points.shape[:2]
    j0, i0 = nearest // columns, nearest % columns
    best = np.full(len(targets), np.inf)
    corner, s, t = np.zeros((4, len(targets)), np.int64), np.zeros(len(targets)), np.zeros(len(targets))
    near = [(dj, di) for dj in (-1, 0) for di in (-1, 0)]
    far = [(dj, di) for dj in (-2, -1, 0, 1) for di in (-2, -1, 0, 1) if (dj, di) not in near]
    for dj, di in near + far:
        open_ = np.flatnonzero(best > _ROUNDING)
        j, i = j0[open_] + dj, i0[open_] + di
        i = i % columns if round_x else i
        inside = (j >= 0) & (j < rows - 1) & (i >= 0) & (i < (columns if round_x else columns - 1))
        open_, j, i = open_[inside], j[inside], i[inside]
        if not open_.size:
            continue
        right = (i + 1) % columns
        flat = np.stack([j * columns + i, j * columns + right, (j + 1) * columns + i, (j + 1) * columns + right])
        a, b = _cell_coordinates(points.reshape(-1, 3)[flat], targets[open_])
        off = np.maximum.reduce([-a, a - 1.0, -b, b - 1.0, np.zeros(a.size)])
        off = np.where(np.isfinite(off), off, np.inf)
        better = off < best[open_]
        chosen = open_[better]
        best[chosen], s[chosen], t[chosen] = off[better], a[better], b[better]
        corner[:, chosen] = flat[:, better]
    s, t = np.clip(s, 0.0, 1.0), np.clip(t, 0.0, 1.0)
    weight = np.stack([(1 - t) * (1 - s), (1 - t) * s, t * (1 - s), t * s])
    return corner, np.where(best <= BEYOND, weight, np.nan)


def _cell_coordinates(corners: Floats, targets: Floats) -> tuple[Floats, Floats]:
    """Return bilinear coordinates of targets (n, 3) in cells of four corners (4, n, 3), along rows and columns."""
    pole = np.where(np.abs(targets[:, 2:3]) > 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    east = np.cross(pole, targets)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(targets, east)
    x, y = (np.einsum("knc,nc->kn", corners, along) for along in (east, north))
    s, t = np.full(len(targets), 0.5), np.full(len(targets), 0.5)
    with np.errstate(all="ignore"):
        for _ in range(8):
            fx, fy = (q[0] + (q[1] - q[0]) * s + (q[2] - q[0]) * t + _twist(q) * s * t for q in (x, y))
            xs, ys = (q[1] - q[0] + _twist(q) * t for q in (x, y))
            xt, yt = (q[2] - q[0] + _twist(q) * s for q in (x, y))
            area = xs * yt - xt * ys
            s, t = s - (fx * yt - fy * xt) / area, t - (fy * xs - fx * ys) / area
    return s, t


def _twist(q: Floats) -> Floats:
    return np.asarray(q[0] - q[1] - q[2] + q[3])


def spacing_of_points(lon: Floats, lat: Floats) -> Floats:
    """Return the usual distance (degrees of arc) of each scattered point to its nearest neighbours."""
    points = unit_vectors(lon, lat)
    tree, known = _tree(points)
    count = min(NEIGHBOURS + 1, known.size)
    spacing = np.full(len(points), np.nan)
    distances = tree.query(points[known], k=count)[0].reshape(known.size, -1)
    spacing[known] = np.rad2deg(distances[:, 1:].mean(axis=1)) if count > 1 else 0.0
    return spacing


def scattered(lon: Floats, lat: Floats, to_lon: Floats, to_lat: Floats) -> Stencil:
    """Place targets among scattered points: the three nearest, weighted by the inverse square of their distance.

    ``lon``, ``lat``: positions of the source (degrees).
    """
    points, targets = unit_vectors(lon, lat), unit_vectors(np.ravel(to_lon), np.ravel(to_lat))
    tree, known = _tree(points)
    count = min(NEIGHBOURS, known.size)
    distance, number = (a.reshape(len(targets), count) for a in tree.query(np.nan_to_num(targets), k=count))
    index, weight = np.zeros((4, len(targets)), np.int64), np.zeros((4, len(targets)))
    inverse = 1.0 / np.maximum(distance, 1e-9) ** 2
    index[:count] = known[number].T
    weight[:count] = (inverse / inverse.sum(axis=1, keepdims=True)).T
    far = ~np.isfinite(targets).all(axis=1) | (
        np.rad2deg(distance[:, 0]) > REACH * spacing_of_points(lon, lat)[index[0]]
    )
    weight[:, far] = np.nan
    nearest = np.stack([np.zeros(len(targets), np.int64), index[0]])
    return Stencil(index, weight, nearest, np.shape(to_lon), (1, len(points)), rings=False)
