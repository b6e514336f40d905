"""Ice that bends: fragments as elastic plates on water, by finite elements of some pads each.

Around the pads that may touch the floor the ice is a Kirchhoff plate with free edges on water, by bicubic elements (Bogner, Fox
and Schmit 1965) with sides of about ``lambda``. Integrals over an element are sums over its pads, by area and centroid of the ice
in each. So edges and corners lie where the outline has them, whatever their direction, and a uniform or a linear pressure lifts
the plate without bending it, exactly. A plate hangs on pads, bending length and which elements are near the floor, and on nothing
else, so that a restarted run has the same one.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.physics.geometry import solve
from riftberg.physics.seabed import WATER_STIFFNESS
from riftberg.state import Floats, Ints
from riftberg.stepping.ground.pads import LOW_X, LOW_Y, SIDE, SIDES_PER_LAMBDA, Pads

REACH: Final = 3.0
"""How far around pads that may touch the floor the ice bends, over ``lambda``; what lies beyond counts 0.3 % of the stiffness."""

MOST_NODES: Final = 300
"""Nodes of a plate; of more, elements with sides of 2, 4, ... ``lambda`` are taken."""

SHORT: Final = 0.25 * math.pi
"""Length of a fragment over ``lambda`` up to which it is rigid (Hetenyi's short beams)."""

LENGTH_RUNGS: Final = 256.0
"""A plate has a bending length rounded to this root of 2, so that melt changes it seldom."""

EMPTY_SQUARE: Final = 1e-6
"""Part of a square that is taken as ice where there is none, so that each node is borne."""


class Plates(NamedTuple):
    """Plates of some fragments, one after the other.

    Unknowns of a node are its rise, its slopes and its mixed derivative, over the side of the elements (m).
    """

    node_start: Ints  # Where the raster of nodes of each fragment begins
    node: Ints  # Numbers of the nodes of elements near the floor, else -1; rows and columns of a raster
    shape: (
        Ints  # Of each fragment: squares along the side of an element, columns of nodes, unknowns; shape (fragments, 3)
    )
    start: Ints  # Where the compliance of each fragment begins
    compliance: Floats  # m N-1; (unknowns, unknowns) of each fragment
    rigid: (
        Floats  # Compliance of each whole fragment against heave and tilts by its water plane; shape (fragments, 3, 3)
    )


PER_SIDE, COLUMNS, UNKNOWNS = range(3)
"""Columns of `Plates.shape`; a fragment without unknowns is rigid."""


@kernel
def cubics(t: float, derivative: int, out: Floats) -> None:
    """Hermite's cubics on the unit interval, or a derivative: of value and slope at 0, then at 1."""
    if derivative == 0:
        out[0], out[1] = (2.0 * t - 3.0) * t * t + 1.0, ((t - 2.0) * t + 1.0) * t
        out[2], out[3] = (3.0 - 2.0 * t) * t * t, (t - 1.0) * t * t
    elif derivative == 1:
        out[0], out[1], out[2], out[3] = (
            6.0 * (t - 1.0) * t,
            (3.0 * t - 4.0) * t + 1.0,
            6.0 * (1.0 - t) * t,
            (3.0 * t - 2.0) * t,
        )
    else:
        out[0], out[1], out[2], out[3] = 12.0 * t - 6.0, 6.0 * t - 4.0, 6.0 - 12.0 * t, 6.0 * t - 2.0


@kernel
def unknowns_of(node: Ints, columns: int, j: int, i: int, out: Ints) -> None:
    """Numbers of the 16 unknowns of the element in row ``j`` and column ``i``, as products of its cubics by x and y come."""
    for a in range(4):
        for b in range(4):
            out[4 * a + b] = 4 * node[(j + b // 2) * columns + i + a // 2] + 2 * (a % 2) + b % 2


@kernel
def _mark_elements(
    pads: Pads, b: int, polygons: Ints, per: int, reach: int, near: NDArray[np.bool_], marked: NDArray[np.bool_]
) -> None:  # fmt: skip
    """Mark the elements with polygons as near, and those with ice within ``reach`` elements of them."""
    rows, columns = marked.shape
    first, high, wide = pads.raster[b, 0], pads.raster[b, 1], pads.raster[b, 2]
    near[:, :], band = False, np.zeros((rows, columns), np.bool_)
    for k in polygons:
        near[pads.square[k, 0] // per, pads.square[k, 1] // per] = True
    for j in range(rows):
        for i in range(columns):
            if near[j, i]:
                for n in range(max(i - reach, 0), min(i + reach + 1, columns)):
                    band[j, n] = True
    for j in range(rows):
        for i in range(columns):
            wanted = ice = False
            for n in range(max(j - reach, 0), min(j + reach + 1, rows)):
                wanted = wanted or band[n, i]
            if wanted:
                for row in range(per * j, min(per * (j + 1), high)):
                    for column in range(per * i, min(per * (i + 1), wide)):
                        ice = ice or pads.ice[first + row * wide + column, 0] > 0.0
            marked[j, i] = ice


@kernel
def _number_nodes(marked: NDArray[np.bool_], node: Ints) -> int:
    """Number the nodes of marked elements, along the shorter side of the raster; returns how many there are."""
    rows, columns = marked.shape
    count = 0
    for k in range(node.size):
        j, i = (k % (rows + 1), k // (rows + 1)) if rows < columns else (k // (columns + 1), k % (columns + 1))
        node[j * (columns + 1) + i] = -1
        borne = False
        for n in range(max(j - 1, 0), min(j + 1, rows)):
            for m in range(max(i - 1, 0), min(i + 1, columns)):
                borne = borne or marked[n, m]
        if borne:
            node[j * (columns + 1) + i] = count
            count += 1
    return count


@kernel
def _assemble(
    pads: Pads, b: int, marked: NDArray[np.bool_], node: Ints, per: int, length: float, poisson: float, matrix: Floats
) -> None:  # fmt: skip
    """Sum up the stiffness of ice and water (N m-1) over the squares of the marked elements."""
    side, first, high, wide = pads.frame[b, SIDE], pads.raster[b, 0], pads.raster[b, 1], pads.raster[b, 2]
    h, which = per * side, np.empty(16, np.int64)
    x, y, shape, slope = np.empty((3, 4)), np.empty((3, 4)), np.empty((4, 16)), (length / (per * side)) ** 4
    for j in range(marked.shape[0]):
        for i in range(marked.shape[1]):
            if not marked[j, i]:
                continue
            unknowns_of(node, marked.shape[1] + 1, j, i, which)
            for row in range(per * j, per * (j + 1)):
                for column in range(per * i, per * (i + 1)):
                    area, s, t = EMPTY_SQUARE * side * side, (column + 0.5) / per - i, (row + 0.5) / per - j
                    if row < high and column < wide:
                        ice = pads.ice[first + row * wide + column]
                        if ice[0] > area:
                            area, s, t = (
                                ice[0],
                                (ice[1] - pads.frame[b, LOW_X]) / h - i,
                                (ice[2] - pads.frame[b, LOW_Y]) / h - j,
                            )
                    for d in range(3):
                        cubics(s, d, x[d])
                        cubics(t, d, y[d])
                    for k in range(16):
                        shape[0, k], shape[1, k] = x[0, k // 4] * y[0, k % 4], x[2, k // 4] * y[0, k % 4]
                        shape[2, k], shape[3, k] = x[0, k // 4] * y[2, k % 4], x[1, k // 4] * y[1, k % 4]
                    for k in range(16):
                        bending_x, bending_y = shape[1, k] + poisson * shape[2, k], shape[2, k] + poisson * shape[1, k]
                        twist = 2.0 * (1.0 - poisson) * shape[3, k]
                        for n in range(16):
                            bending = bending_x * shape[1, n] + bending_y * shape[2, n] + twist * shape[3, n]
                            matrix[which[k], which[n]] += (
                                WATER_STIFFNESS * area * (shape[0, k] * shape[0, n] + slope * bending)
                            )


@kernel
def _invert(matrix: Floats, rows: Ints, out: Floats) -> None:
    """Find some rows of the inverse of a symmetric, positive definite matrix, by Cholesky's factors within its envelope.

    Overwrites the lower half of the matrix; ``out``: takes the rows, which are in rising order, at their own columns.
    """
    n = len(matrix)
    first, y = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        first[i] = i
        for j in range(i - 1, -1, -1):
            if matrix[i, j] != 0.0:
                first[i] = j
        for j in range(first[i], i + 1):
            value = matrix[i, j]
            for k in range(max(first[i], first[j]), j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(value) if i == j else value / matrix[j, j]
    for r in range(rows.size):
        c = rows[r]
        for i in range(c, n):
            value = 1.0 if i == c else 0.0
            for k in range(max(first[i], c), i):
                value -= matrix[i, k] * y[k]
            y[i] = value / matrix[i, i]
        for i in range(n - 1, c - 1, -1):
            y[i] /= matrix[i, i]
            for k in range(max(first[i], c), i):
                y[k] -= matrix[i, k] * y[i]
        for s in range(r, rows.size):
            out[r, s] = out[s, r] = y[rows[s]]


@kernel
def _rigid_compliance(pads: Pads, b: int, out: Floats) -> None:
    """Compliance of a whole fragment against heave and tilts by its water plane."""
    first, count = pads.raster[b, 0], pads.raster[b, 1] * pads.raster[b, 2]
    moments = np.zeros((3, 3))
    for s in range(first, first + count):
        area, x, y = WATER_STIFFNESS * pads.ice[s, 0], pads.ice[s, 1], pads.ice[s, 2]
        moments[0, 0] += area
        moments[0, 1] += area * y
        moments[0, 2] -= area * x
        moments[1, 1] += area * y * y
        moments[1, 2] -= area * x * y
        moments[2, 2] += area * x * x
    moments[1, 0], moments[2, 0], moments[2, 1] = moments[0, 1], moments[0, 2], moments[1, 2]
    unit = np.eye(3)
    for k in range(3):
        out[0, k], out[1, k], out[2, k] = solve(moments, unit[k])


class PlateBook:
    """Plates of the fragments of some pads, made anew where other elements come near the floor."""

    def __init__(self, pads: Pads, poisson: float) -> None:
        self._pads, self._poisson = pads, poisson
        self._extent = pads.frame[:, SIDE] * pads.raster[:, 1:].max(axis=1)
        self._key: dict[int, tuple[float, int, bytes]] = {}
        self._arrays: dict[int, tuple[Ints, Floats, Floats]] = {}
        self._plates: Plates | None = None

    def look_up(self, polygons: Ints, start: Ints, length: Floats, tilts: NDArray[np.bool_]) -> Plates:
        """Return the plates of fragments.

        ``polygons``: those that may touch the floor, from ``start`` on for each fragment; ``length``: of bending, m; ``tilts``:
        which fragments tilt.
        """
        reach = math.sqrt(2.0) * length
        bends = np.flatnonzero(tilts & (self._extent > SHORT * reach) & (length > 0.0) & (np.diff(start) > 0)).tolist()
        changed = self._plates is None or bends != list(self._key)
        for b in bends:
            changed |= self._follow(b, polygons[start[b] : start[b + 1]], float(length[b]))
        if changed:
            self._key = {b: self._key[b] for b in bends}
            self._arrays = {b: self._arrays[b] for b in bends}
            self._plates = self._pack()
        assert self._plates is not None
        return self._plates

    def _follow(self, b: int, polygons: Ints, length: float) -> bool:
        """Make the plate of a fragment, if it is not the one that is there; returns whether it was made."""
        pads, per = self._pads, int(SIDES_PER_LAMBDA)
        length = 2.0 ** (round(LENGTH_RUNGS * math.log2(length)) / LENGTH_RUNGS)
        while True:
            rows, columns = (-(-pads.raster[b, 1:] // per)).tolist()
            near, marked = np.empty((2, rows, columns), np.bool_)
            node, inner = np.empty((2, (rows + 1) * (columns + 1)), np.int64)
            around = round(REACH * math.sqrt(2.0) * length / (per * pads.frame[b, SIDE]))
            _mark_elements(pads, b, polygons, per, max(around, 1), near, marked)
            count = _number_nodes(marked, node)
            if count <= MOST_NODES:
                break
            per *= 2
        key = length, per, near.tobytes()
        if self._key.get(b) == key:
            return False
        kept = 4 * _number_nodes(near, inner)
        matrix, compliance, rigid = np.zeros((4 * count, 4 * count)), np.empty((kept, kept)), np.empty((3, 3))
        _assemble(pads, b, marked, node, per, length, self._poisson, matrix)
        _invert(matrix, (4 * np.sort(node[inner >= 0])[:, None] + np.arange(4)).ravel(), compliance)
        _rigid_compliance(pads, b, rigid)
        self._key[b], self._arrays[b] = key, (inner, compliance, rigid)
        return True

    def _pack(self) -> Plates:
        """Put the plates of all fragments into one."""
        count = len(self._pads.frame)
        shape, rigid, sizes = (
            np.zeros((count, 3), np.int64),
            np.zeros((count, 3, 3)),
            np.zeros((2, count + 1), np.int64),
        )
        for b, (node, compliance, of_whole) in self._arrays.items():
            per = self._key[b][1]
            shape[b] = per, -(-self._pads.raster[b, 2] // per) + 1, len(compliance)
            rigid[b], sizes[:, b + 1] = of_whole, (node.size, compliance.size)
        node_start, start = np.cumsum(sizes, axis=1)
        arrays = [self._arrays[b] for b in sorted(self._arrays)]
        return Plates(
            node_start, np.concatenate([np.zeros(0, np.int64), *(one[0] for one in arrays)]), shape, start,
            np.concatenate([np.zeros(0), *(one[1].ravel() for one in arrays)]), rigid,
        )  # fmt: skip
