"""Ice that bends: fragments as elastic plates on water, by finite elements of some pads each.

Around the pads that overlap the floor the ice is a Kirchhoff plate with free edges on water, by bicubic elements (Bogner, Fox and
Schmit 1965) with sides of about ``lambda``. Integrals over an element are sums over its pads, by area and centroid of the ice in
each. So edges and corners lie where the outline has them, whatever their direction, and a uniform or a linear pressure lifts the
plate without bending it, exactly. A plate hangs on pads, bending length and the elements that overlap the floor, and on nothing
else, so that a restarted run has the same one; it is made anew where one of these changes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.ground.pads import Pads
from riftberg.physics.elementary import exp2, log2
from riftberg.physics.geometry import solve
from riftberg.physics.seabed import SIDES_PER_LAMBDA, WATER_STIFFNESS
from riftberg.state import Floats, Ints

REACH: Final = 3.0
"""How far around pads that overlap the floor the ice bends, over ``lambda``; what lies beyond counts 0.3 % of the stiffness."""

MOST_NODES: Final = 300
"""Nodes of a plate; of more, elements with sides of 2, 4, ... ``lambda`` are taken."""

LENGTH_RUNGS: Final = 256.0
"""A plate has a bending length rounded to this root of 2, so that melt changes it seldom."""

EMPTY_SQUARE: Final = 1e-6
"""Part of a square that is taken as ice where there is none, so that each node is borne."""

WHOLE: Final = 1e-6
"""Part of a square that may miss where it counts as whole."""


class Plates(NamedTuple):
    """Plates of some fragments, one after the other.

    Unknowns of a node are its rise, its slopes and its mixed derivative, over the side of the elements (m).
    """

    element_start: Ints  # Where the elements of each fragment begin
    loaded: NDArray[np.bool_]  # Whether loads may act on them; rows and columns of a raster
    node_start: Ints  # Where the nodes of each fragment begin
    node: Ints  # Their numbers, -1 for those beyond the plate; rows and columns of a raster
    per_side: Ints  # Squares along the side of an element of each fragment; none before its plate is made
    columns: Ints  # Of nodes
    unknowns: Ints  # Their number
    width: Ints  # Of the band of the factor
    length: Floats  # Bending length for which it was made, m
    start: Ints  # Where the factor of each fragment begins
    factor: Floats  # Cholesky's, of the stiffness; each row from the diagonal on; (unknowns, width) of each fragment
    rigid: Floats  # Compliance of whole fragments against heave and tilts by their water plane; shape (fragments, 3, 3)


def unmade_plates(pads: Pads) -> Plates:
    """Return plates of the fragments of some pads that are still to be made."""
    count, elements = pads.side.size, (pads.shape - 1) // int(SIDES_PER_LAMBDA) + 1
    nodes = (elements + 1).prod(axis=1)
    element_start, node_start = (np.concatenate([[0], np.cumsum(size)]) for size in (elements.prod(axis=1), nodes))
    per_side, columns, unknowns, width = np.zeros((4, count), np.int64)
    # Room for all that may ever bend: memory is taken up by what is written.
    widest = 4 * (elements.min(axis=1) + 3)
    start = np.concatenate([[0], np.cumsum(4 * np.minimum(nodes, MOST_NODES) * widest)])
    plates = Plates(
        element_start, np.zeros(element_start[-1], np.bool_), node_start, np.empty(node_start[-1], np.int64),
        per_side, columns, unknowns, width, np.zeros(count), start, np.empty(start[-1]), np.empty((count, 3, 3)),
    )  # fmt: skip
    for b in range(count):
        _fill_rigid(pads, b, plates.rigid[b])
    return plates


@kernel
def cubics(t: float, derivative: int, out: Floats) -> None:
    """Hermite's cubics on the unit interval, or a derivative: of value and slope at 0, then at 1."""
    if derivative == 0:
        out[0], out[1] = (2.0 * t - 3.0) * t * t + 1.0, ((t - 2.0) * t + 1.0) * t
        out[2], out[3] = (3.0 - 2.0 * t) * t * t, (t - 1.0) * t * t
    elif derivative == 1:
        out[0], out[1] = 6.0 * (t - 1.0) * t, (3.0 * t - 4.0) * t + 1.0
        out[2], out[3] = 6.0 * (1.0 - t) * t, (3.0 * t - 2.0) * t
    else:
        out[0], out[1], out[2], out[3] = 12.0 * t - 6.0, 6.0 * t - 4.0, 6.0 - 12.0 * t, 6.0 * t - 2.0


@kernel
def list_unknowns(node: Ints, columns: int, j: int, i: int, out: Ints) -> None:
    """Numbers of the 16 unknowns of the element in row ``j`` and column ``i``, as products of its cubics by x and y come."""
    for a in range(4):
        for b in range(4):
            out[4 * a + b] = 4 * node[(j + b // 2) * columns + i + a // 2] + 2 * (a % 2) + b % 2


@kernel
def _mark_around(
    pads: Pads, b: int, loaded: NDArray[np.bool_], per: int, reach: int, marked: NDArray[np.bool_]
) -> None:
    """Mark the elements with ice within ``reach`` elements of loaded ones."""
    rows, columns = marked.shape
    first, high, wide = pads.square_start[b], pads.shape[b, 0], pads.shape[b, 1]
    band = np.zeros((rows, columns), np.bool_)
    for j in range(rows):
        for i in range(columns):
            if loaded[j, i]:
                band[j, max(i - reach, 0) : i + reach + 1] = True
    for j in range(rows):
        for i in range(columns):
            marked[j, i] = False
            if band[max(j - reach, 0) : j + reach + 1, i].any():
                for row in range(per * j, min(per * (j + 1), high)):
                    for column in range(per * i, min(per * (i + 1), wide)):
                        marked[j, i] = marked[j, i] or pads.ice[first + row * wide + column, 0] > 0.0


@kernel
def _number_nodes(marked: NDArray[np.bool_], node: Ints) -> tuple[int, int]:
    """Number the nodes of marked elements, along the shorter side of what they cover.

    Returns how many there are, and by how much the numbers of an element differ at most.
    """
    rows, columns = marked.shape
    low_j, high_j, low_i, high_i = rows, -1, columns, -1
    for j in range(rows):
        for i in range(columns):
            if marked[j, i]:
                low_j, high_j, low_i, high_i = min(low_j, j), max(high_j, j), min(low_i, i), max(high_i, i)
    by_column, count, span = high_j - low_j < high_i - low_i, 0, 0
    for k in range(node.size):
        j, i = (k % (rows + 1), k // (rows + 1)) if by_column else (k // (columns + 1), k % (columns + 1))
        node[j * (columns + 1) + i] = -1
        for n in range(max(j - 1, 0), min(j + 1, rows)):
            for m in range(max(i - 1, 0), min(i + 1, columns)):
                if marked[n, m]:
                    node[j * (columns + 1) + i] = count
        count += node[j * (columns + 1) + i] == count
    for j in range(rows):
        for i in range(columns):
            if marked[j, i]:
                span = max(span, node[(j + 1) * (columns + 1) + i + 1] - node[j * (columns + 1) + i])
    return count, span


@borrower
def _number_loaded_last(loaded: NDArray[np.bool_], count: int, node: Ints) -> None:
    """Number ``count`` nodes the other way round if loaded ones come first: a load goes through the nodes after it."""
    rows, columns = loaded.shape
    total = elements = 0
    for j in range(rows):
        for i in range(columns):
            if loaded[j, i]:
                total += node[j * (columns + 1) + i] + node[(j + 1) * (columns + 1) + i + 1]
                elements += 1
    if total < elements * (count - 1):
        for n in range(node.size):
            if node[n] >= 0:
                node[n] = count - 1 - node[n]


@kernel
def _place_points(ice: Floats, side: float, points: Floats) -> int:
    """Place the points by which integrals over the ice of a square are summed up; returns their number, 0 without ice.

    One in the middle of a whole square, of a cut one four, with the second moments of its ice.
    """
    full = side * side
    if ice[0] <= EMPTY_SQUARE * full:
        return 0
    points[0, 0], points[0, 1] = ice[1], ice[2]
    if ice[0] > (1.0 - WHOLE) * full:
        return 1
    # Of the factors of the variances: a bar of ice a few metres wide bends across as little as along.
    xx = math.sqrt(max(ice[3], 0.0))
    xy = ice[4] / xx if xx > 0.0 else 0.0
    yy = math.sqrt(max(ice[5] - xy * xy, 0.0))
    for p in range(4):
        a, c = (-1.0 if p < 2 else 1.0), (-1.0 if p % 2 == 0 else 1.0)
        points[p, 0], points[p, 1] = ice[1] + a * xx, ice[2] + a * xy + c * yy
    return 4


@kernel
def _fill_element(pads: Pads, b: int, j: int, i: int, per: int, slope: float, poisson: float, out: Floats) -> None:
    """Sum up the stiffness of ice and water (N m-1) over the squares of an element; ``slope``: (length / side)^4."""
    side, first, high, wide = pads.side[b], pads.square_start[b], pads.shape[b, 0], pads.shape[b, 1]
    x, y, shape, points = np.empty((3, 4)), np.empty((3, 4)), np.empty((4, 16)), np.empty((4, 2))
    out[:] = 0.0
    for row in range(per * j, per * (j + 1)):
        for column in range(per * i, per * (i + 1)):
            count = 0
            if row < high and column < wide:
                count = _place_points(pads.ice[first + row * wide + column], side, points)
            if count == 0:
                area, count = EMPTY_SQUARE * side * side, 1
                points[0, 0] = pads.low[b, 0] + (column + 0.5) * side
                points[0, 1] = pads.low[b, 1] + (row + 0.5) * side
            else:
                area = pads.ice[first + row * wide + column, 0] / count
            for p in range(count):
                s = (points[p, 0] - pads.low[b, 0]) / (per * side) - i
                t = (points[p, 1] - pads.low[b, 1]) / (per * side) - j
                for d in range(3):
                    cubics(s, d, x[d])
                    cubics(t, d, y[d])
                for k in range(16):
                    shape[0, k], shape[1, k] = x[0, k // 4] * y[0, k % 4], x[2, k // 4] * y[0, k % 4]
                    shape[2, k], shape[3, k] = x[0, k // 4] * y[2, k % 4], x[1, k // 4] * y[1, k % 4]
                for k in range(16):
                    bending_x = shape[1, k] + poisson * shape[2, k]
                    bending_y = shape[2, k] + poisson * shape[1, k]
                    twist = 2.0 * (1.0 - poisson) * shape[3, k]
                    for n in range(16):
                        bending = bending_x * shape[1, n] + bending_y * shape[2, n] + twist * shape[3, n]
                        out[k, n] += WATER_STIFFNESS * area * (shape[0, k] * shape[0, n] + slope * bending)


@kernel
def _assemble(
    pads: Pads, b: int, marked: NDArray[np.bool_], node: Ints, per: int, length: float, poisson: float, matrix: Floats
) -> None:  # fmt: skip
    """Sum up the stiffness (N m-1) of the marked elements; each row of ``matrix`` begins on the diagonal."""
    which, stiffness, slope = np.empty(16, np.int64), np.empty((16, 16)), (length / (per * pads.side[b])) ** 4
    for j in range(marked.shape[0]):
        for i in range(marked.shape[1]):
            if not marked[j, i]:
                continue
            _fill_element(pads, b, j, i, per, slope, poisson, stiffness)
            list_unknowns(node, marked.shape[1] + 1, j, i, which)
            for k in range(16):
                for n in range(16):
                    if which[n] >= which[k]:
                        matrix[which[k], which[n] - which[k]] += stiffness[k, n]


@kernel
def _factorise(matrix: Floats) -> None:
    """Find Cholesky's factor in place; each row of the matrix begins on the diagonal.

    Row by row, so that all that a row takes from those below it goes through the processor at once.
    """
    n, width = matrix.shape
    for k in range(n):
        row, end = matrix[k], min(width, n - k)
        root = math.sqrt(row[0])
        for t in range(end):
            row[t] /= root
        for m in range(1, end):
            factor, below = row[m], matrix[k + m]
            if factor != 0.0:
                for t in range(end - m):
                    below[t] -= factor * row[m + t]


@kernel
def bend_plate(plates: Plates, b: int, shape: Floats, which: Ints, out: Floats) -> None:
    """Find the rise of the plate at some places by a load of 1 N at each of them (m N-1), heave and tilts included.

    ``which``: numbers of the unknowns around each place, ``shape``: their shares in the rise there; shape (places, 16).
    """
    n, width = plates.unknowns[b], plates.width[b]
    factor = plates.factor[plates.start[b] : plates.start[b] + n * width].reshape(n, width)
    places = len(which)
    first = np.empty(places, np.int64)
    for i in range(places):
        first[i] = which[i].min()
    # What a load does is found from its first unknown on, and there for all later loads: the inverse is symmetric.
    order = np.argsort(first, kind="mergesort")
    begun, rise = np.searchsorted(first[order], np.arange(n), side="right"), np.zeros((n, places))
    for r in range(places):
        i = order[r]
        for a in range(16):
            rise[which[i, a], r] = shape[i, a]
    for k in range(first.min(), n):
        row, loads = rise[k], begun[k]
        for r in range(loads):
            row[r] /= factor[k, 0]
        for m in range(1, min(width, n - k)):
            entry, below = factor[k, m], rise[k + m]
            if entry != 0.0:
                for r in range(loads):
                    below[r] -= entry * row[r]
    for k in range(n - 1, first.min() - 1, -1):
        row, loads = rise[k], begun[k]
        for m in range(1, min(width, n - k)):
            entry, below = factor[k, m], rise[k + m]
            if entry != 0.0:
                for r in range(loads):
                    row[r] -= entry * below[r]
        for r in range(loads):
            row[r] /= factor[k, 0]
    values = np.empty(places)
    for s in range(places):
        j = order[s]
        values[: s + 1] = 0.0
        for a in range(16):
            weight, row = shape[j, a], rise[which[j, a]]
            for r in range(s + 1):
                values[r] += weight * row[r]
        for r in range(s + 1):
            out[j, order[r]] = out[order[r], j] = values[r]


@kernel
def _fill_rigid(pads: Pads, b: int, out: Floats) -> None:
    """Find the compliance of a whole fragment against heave and tilts by its water plane."""
    first, squares = pads.square_start[b], pads.shape[b, 0] * pads.shape[b, 1]
    moments, points = np.zeros((3, 3)), np.empty((4, 2))
    for s in range(first, first + squares):
        # By the points of the plate: what this takes from its compliance must not be more than it has.
        count = _place_points(pads.ice[s], pads.side[b], points)
        for p in range(count):
            area, x, y = WATER_STIFFNESS * pads.ice[s, 0] / count, points[p, 0], points[p, 1]
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


@kernel
def fit_plate(
    pads: Pads, plates: Plates, b: int, polygons: Ints, merged: int, length: float, poisson: float
) -> None:  # fmt: skip
    """Make the plate of a fragment with loads on ``polygons``, unless it is the one that is there.

    ``merged``: squares along the side of a group that bends as one; elements are no smaller.
    """
    rounded, per = exp2(math.floor(LENGTH_RUNGS * log2(length) + 0.5) / LENGTH_RUNGS), int(SIDES_PER_LAMBDA)
    first = plates.element_start[b]
    while per < merged:
        per *= 2
    while True:
        rows, columns = (pads.shape[b, 0] - 1) // per + 1, (pads.shape[b, 1] - 1) // per + 1
        loaded, marked = np.zeros((rows, columns), np.bool_), np.empty((rows, columns), np.bool_)
        for k in polygons:
            loaded[pads.square[k, 0] // per, pads.square[k, 1] // per] = True
        previous_loaded = plates.loaded[first : first + rows * columns].reshape(rows, columns)
        same = plates.per_side[b] == per and plates.length[b] == rounded
        if same and np.array_equal(previous_loaded, loaded):
            return
        reach = math.floor(math.sqrt(2.0) * REACH * rounded / (per * pads.side[b]) + 0.5)
        _mark_around(pads, b, loaded, per, max(reach, 1), marked)
        node = np.empty((rows + 1) * (columns + 1), np.int64)
        count, span = _number_nodes(marked, node)
        if count <= MOST_NODES:
            break
        per *= 2
    _number_loaded_last(loaded, count, node)
    width = 4 * span + 4
    matrix = plates.factor[plates.start[b] : plates.start[b] + 4 * count * width].reshape(4 * count, width)
    matrix[:] = 0.0
    _assemble(pads, b, marked, node, per, rounded, poisson, matrix)
    _factorise(matrix)
    plates.node[plates.node_start[b] : plates.node_start[b] + node.size] = node
    previous_loaded[:, :] = loaded
    plates.per_side[b], plates.columns[b], plates.unknowns[b], plates.width[b] = per, columns + 1, 4 * count, width
    plates.length[b] = rounded
