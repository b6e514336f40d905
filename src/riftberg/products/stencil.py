"""Where target points lie between the points of a source grid, and what the points around give them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MISSING, INTERPOLATED, NEAREST = 0, 1, 2
"""Origin of a value: none (0 was put), bilinear over wet points, nearest wet point."""


@dataclass(frozen=True)
class Stencil:
    """Four source points and weights for every target point."""

    index: Integers  # Flat source index (row-major ``y, x``) of the corners
    weight: Floats  # Bilinear weights, sum 1; NaN for targets outside the source
    nearest: Integers  # Row and column of the nearest source point
    shape: tuple[int, ...]  # Shape of the targets
    source: tuple[int, int]  # Rows and columns of the source
    periodic: bool = False  # Whether the source goes round in ``x``
    rings: bool = True  # Whether neighbours in rows and columns are neighbours in space (not so among scattered points)

    @classmethod
    def bilinear(cls, x: Floats, y: Floats, to_x: Floats, to_y: Floats, *, turn: float = 0.0) -> Stencil:
        """Place targets on a source with ascending axes."""
        shape = np.shape(to_x)
        to_x, to_y = np.ravel(to_x).astype(float), np.ravel(to_y).astype(float)
        if turn:
            to_x = (to_x - x[0]) % turn + x[0]
            x = np.append(x, x[0] + turn)
        columns, fx = brackets(x, to_x)
        rows, fy = brackets(y, to_y)
        nx = x.size - 1 if turn else x.size
        right, up = np.minimum(columns + 1, x.size - 1), np.minimum(rows + 1, y.size - 1)
        corners = [(rows, columns), (rows, right), (up, columns), (up, right)]
        index = np.stack([row * nx + column % nx for row, column in corners])
        weight = np.stack([(1 - fy) * (1 - fx), (1 - fy) * fx, fy * (1 - fx), fy * fx])
        nearest = np.stack([np.where(fy > 0.5, up, rows), np.where(fx > 0.5, right, columns) % nx])
        return cls(index, weight, nearest, shape, (y.size, nx), bool(turn))

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Targets that lie outside the source, in the shape of the targets."""
        beyond: NDArray[np.bool_] = np.isnan(self.weight[0]).reshape(self.shape)
        return beyond

    def plain(self, field: Floats) -> Floats:
        """Interpolate ``field`` (..., y, x); NaN outside and wherever a corner with weight is NaN."""
        flat = self._flat(field)
        total = np.zeros((flat.shape[0], self.index.shape[1]))
        for index, weight in zip(self.index, self.weight, strict=True):
            total += np.where(weight == 0.0, 0.0, flat[:, index] * weight)
        return total.reshape(*np.shape(field)[:-2], *self.shape)

    def wet(self, field: Floats, fill_cells: int) -> tuple[Floats, NDArray[np.int8]]:
        """Interpolate over the wet (not NaN) points only, then fill from near wet points."""
        flat = self._flat(field)
        total = np.zeros((flat.shape[0], self.index.shape[1]))
        share = np.zeros_like(total)
        for index, weight in zip(self.index, np.nan_to_num(self.weight), strict=True):
            corner = flat[:, index]
            known = np.isfinite(corner)
            total += np.where(known, corner, 0.0) * weight
            share += known * weight
        # A share below this is rounding of a weight that ought to be zero.
        inside = share > 1e-9
        values = np.divide(total, share, out=np.zeros_like(total), where=inside)
        origin = np.where(inside, INTERPOLATED, MISSING).astype(np.int8)
        self._fill(flat, values, origin, fill_cells)
        shape = (*np.shape(field)[:-2], *self.shape)
        return values.reshape(shape), origin.reshape(shape)

    def _fill(self, flat: Floats, values: Floats, origin: NDArray[np.int8], reach: int) -> None:
        """Give targets without wet corners the value of the nearest wet point within ``reach`` cells."""
        rows, columns = self.source
        inside = ~np.isnan(self.weight[0])
        for dj, di in offsets_by_distance(reach if self.rings else 0):
            wanted, target = np.nonzero((origin == MISSING) & inside)
            if target.size == 0:
                return
            row, column = self.nearest[0, target] + dj, self.nearest[1, target] + di
            column = column % columns if self.periodic else column
            valid = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            wanted, target, row, column = wanted[valid], target[valid], row[valid], column[valid]
            nearest_values = flat[wanted, row * columns + column]
            known = np.isfinite(nearest_values)
            values[wanted[known], target[known]] = nearest_values[known]
            origin[wanted[known], target[known]] = NEAREST

    def _flat(self, field: Floats) -> Floats:
        return np.asarray(field, float).reshape(-1, self.source[0] * self.source[1])


def offsets_by_distance(reach: int) -> list[tuple[int, int]]:
    """Return offsets (rows, columns) within ``reach`` cells, the nearest first."""
    span = range(-reach, reach + 1)
    offsets = [(dj, di) for dj in span for di in span if dj * dj + di * di <= reach * reach]
    return sorted(offsets, key=lambda offset: (offset[0] ** 2 + offset[1] ** 2, offset))


def brackets(axis: Floats, at: Floats) -> tuple[Integers, Floats]:
    """Return the lower neighbour of each position and the fraction of the way to the next; NaN outside."""
    if axis.size == 1:
        return np.zeros(at.size, dtype=np.int64), np.where(np.isclose(at, axis[0]), 0.0, np.nan)
    lower = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
    fraction = (at - axis[lower]) / (axis[lower + 1] - axis[lower])
    outside = (fraction < -0.5) | (fraction > 1.5)
    return lower, np.where(outside, np.nan, np.clip(fraction, 0.0, 1.0))
