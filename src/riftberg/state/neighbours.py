"""Which elements are near each other: a uniform hash grid of cells as wide as the reach of the forces.

The reference searches the cells of the ocean grid; the forces act only within their reach, so any search that finds all
pairs within it gives the same forces. Here it does not depend on an ocean grid.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.geometry import fast_cos_latitude, nearest_image, separation
from riftberg.state import Floats, Ints

ANY, SAME_BERG, OTHER_BERG = 0, 1, 2
_MAX_COLUMNS = 4096
_FEWEST_CELLS, _CELLS_PER_ELEMENT = 1024, 4
_FEW = 16
"""Others in the bin of an element, on average, that are not worth classes of reach."""

_FEW_BERGS = 16
"""Bergs up to which each has a box: more boxes cost as much as the search that they spare."""


class PairList(NamedTuple):
    """Partners of each element; element e has ``partner[start[e]:start[e + 1]]``."""

    start: Ints
    partner: Ints


def no_pairs(count: int) -> PairList:
    """Return a list of ``count`` elements without partners."""
    return PairList(np.zeros(count + 1, np.int64), np.zeros(0, np.int64))


@kernel
def _extremes(values: Floats) -> tuple[float, float]:
    """Smallest and largest of some values: a loop compiles in no time, NumPy's own take a third of a second each."""
    low, high = np.inf, -np.inf
    for value in values:
        low, high = min(low, value), max(high, value)
    return low, high


@kernel
def _covered(x: Floats, period: float) -> tuple[float, float]:
    """Where the elements begin on the circle, and how much of it they cover: the whole, or from one of two cuts less."""
    low, low_across = np.inf, np.inf
    high, high_across = -np.inf, -np.inf
    for at in x:
        along = at - period * np.floor(at / period)
        across = along - period if along >= 0.5 * period else along
        low, high = min(low, along), max(high, along)
        low_across, high_across = min(low_across, across), max(high_across, across)
    if high_across - low_across < high - low:
        return low_across, high_across - low_across
    return low, high - low


@kernel
def _hash_columns(
    x: Floats, y: Floats, reach: float, latlon: bool, radius: float, period: float
) -> tuple[float, float, int, int, float, float, bool]:
    """Width of a column and a row in units of x and y, their numbers, the origin, and whether the last meets the first.

    On a circle only the part is binned that the elements cover, where the gap is wider than their reach.
    """
    (x0, x1), (y0, y1) = _extremes(x), _extremes(y)
    high = max(abs(y0), abs(y1))
    per_unit = np.pi / 180.0 * radius if latlon else 1.0
    # The largest cosine deficit makes columns wide enough everywhere; near the pole one column holds all.
    cosine = max(fast_cos_latitude(min(high + reach / per_unit, 90.0)), 1e-3) if latlon else 1.0
    width_x, width_y = reach / (per_unit * cosine), reach / per_unit
    span, closed = x1 - x0, period > 0.0
    if closed:
        begin, covered = _covered(x, period)
        closed = not covered + 3.0 * width_x < period
        # Half a column before the first, so that round-off does not carry it once around.
        x0, span = (0.0, period) if closed else (begin - 0.5 * width_x, covered + width_x)
    # Bergs far apart must not make a grid of mostly empty cells that costs more than the search.
    most = max(_FEWEST_CELLS, _CELLS_PER_ELEMENT * x.size)
    across = min(max(span / width_x, 1.0), _MAX_COLUMNS)
    rows = int(min(max((y1 - y0) / width_y + 1.0, 1.0), min(max(math.sqrt(most), most / across), _MAX_COLUMNS)))
    columns = int(min(across, max(most // rows, 1)))
    width_x = span / columns if closed else max(width_x, span / columns)
    if not closed:
        columns = min(columns + 1, _MAX_COLUMNS + 1)
    return width_x, max(width_y, (y1 - y0) / rows), columns, rows + 1, x0, y0, closed


@kernel
def _bin(
    x: Floats, y: Floats, width_x: float, width_y: float, columns: int, rows: int, x0: float, y0: float, period: float
) -> tuple[Ints, Ints, Ints]:
    """Sort elements into bins: start of each bin, and the elements of all bins in turn."""
    count = x.size
    cell = np.empty(count, np.int64)
    start = np.zeros(columns * rows + 1, np.int64)
    for e in range(count):
        along = x[e] - x0
        if period > 0.0:
            along -= period * np.floor(along / period)
        # A run that goes wrong has positions too large for whole numbers; they must not lead out of the bins.
        column = min(max(int(along / width_x), 0), columns - 1)
        row = min(max(int((y[e] - y0) / width_y), 0), rows - 1)
        cell[e] = row * columns + column
        start[cell[e] + 1] += 1
    for c in range(columns * rows):
        start[c + 1] += start[c]
    slot = start[:-1].copy()
    member = np.empty(count, np.int64)
    for e in range(count):
        member[slot[cell[e]]] = e
        slot[cell[e]] += 1
    return cell, start, member


def find_pairs(
    x: Floats, y: Floats, berg: Ints, reach: float, rule: int, latlon: bool, radius: float, period: float
) -> PairList:
    """Find all partners of each element within ``reach``.

    ``x``, ``y``: positions, degrees or m (shape (n,)); ``berg``: number of the conglomerate of each element (shape
    (n,)); ``reach``: distance, m.
    """
    if rule != OTHER_BERG:
        return PairList(*_find_pairs(x, y, berg, reach, rule, latlon, radius, period))
    # Most elements of the pieces of a broken berg lie far from all other pieces: they need not be binned. Half of the reach
    # for each of a pair, with something for round-off.
    candidates = _near_other_boxes(x, y, berg, np.full(x.size, 0.5001 * reach), latlon, radius, period)
    if candidates.size < 2:
        return no_pairs(x.size)
    start, partner = _find_pairs(x[candidates], y[candidates], berg[candidates], reach, rule, latlon, radius, period)
    count = np.zeros(x.size + 1, np.int64)
    count[candidates + 1] = np.diff(start)
    return PairList(np.cumsum(count), candidates[partner])


@kernel
def _find_pairs(
    x: Floats, y: Floats, berg: Ints, reach: float, rule: int, latlon: bool, radius: float, period: float
) -> tuple[Ints, Ints]:
    """Return ``start`` and ``partner`` of `find_pairs`; see `riftberg.compiled.kernels` why no named tuple."""
    count = x.size
    start = np.zeros(count + 1, np.int64)
    if count == 0:
        return start, np.zeros(0, np.int64)
    width_x, width_y, columns, rows, x0, y0, closed = _hash_columns(x, y, reach, latlon, radius, period)
    cell, bin_start, member = _bin(x, y, width_x, width_y, columns, rows, x0, y0, period)
    partner = np.empty(8 * count, np.int64)
    total = 0
    side = 1 if columns > 2 else 0
    for e in range(count):
        row, column = cell[e] // columns, cell[e] % columns
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for shift in range(-side if side else 0, (side + 1) if side else columns):
                c = column + shift if side else shift
                if closed:
                    c %= columns
                elif c < 0 or c >= columns:
                    continue
                for k in range(bin_start[r * columns + c], bin_start[r * columns + c + 1]):
                    f = member[k]
                    same = berg[e] == berg[f]
                    if f == e or (rule == SAME_BERG and not same) or (rule == OTHER_BERG and same):
                        continue
                    rx, ry = separation(x[e], y[e], x[f], y[f], latlon, radius, period)
                    if rx * rx + ry * ry < reach * reach:
                        if total == partner.size:
                            partner = _longer(partner)
                        partner[total] = f
                        total += 1
        start[e + 1] = total
        _sort(partner, start[e], total)
    return start, partner[:total].copy()


@kernel
def _crowded(start: Ints) -> bool:
    """Whether elements share their bins with more than `_FEW` others, on average."""
    shared = 0
    for c in range(start.size - 1):
        inside = start[c + 1] - start[c]
        shared += inside * (inside - 1)
    return bool(shared > _FEW * start[start.size - 1])


@kernel
def _binned(
    x: Floats, y: Floats, reach: float, latlon: bool, radius: float, period: float
) -> tuple[int, int, bool, Ints, Ints, Ints]:
    """Columns and rows of the bins for a reach (m), whether the last column meets the first, and the result of `_bin`."""
    width_x, width_y, columns, rows, x0, y0, closed = _hash_columns(x, y, reach, latlon, radius, period)
    cell, start, member = _bin(x, y, width_x, width_y, columns, rows, x0, y0, period)
    return columns, rows, closed, cell, start, member


def near_pairs(
    x: Floats, y: Floats, berg: Ints, reach: Floats, latlon: bool, radius: float, period: float
) -> tuple[Ints, Ints]:
    """Find the pairs of different bergs that are nearer than the sum of their own reaches (m); each once, in order."""
    # Most elements of the pieces of a broken berg lie far from all other pieces: they need not be binned.
    candidates = _near_other_boxes(x, y, berg, reach, latlon, radius, period)
    if candidates.size == x.size:
        return _near_pairs(x, y, berg, reach, latlon, radius, period)
    if candidates.size < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    first, second = _near_pairs(
        x[candidates], y[candidates], berg[candidates], reach[candidates], latlon, radius, period
    )
    return candidates[first], candidates[second]


@kernel
def _near_other_boxes(
    x: Floats, y: Floats, berg: Ints, reach: Floats, latlon: bool, radius: float, period: float
) -> Ints:
    """Return the elements whose reach enters the box around another berg's; all of them where there are many bergs."""
    count = x.size
    everyone = np.arange(count)
    name, box = np.empty(_FEW_BERGS, np.int64), np.empty((4, _FEW_BERGS))  # west, east, south, north
    at = np.empty(count, np.int64)  # number of each element's box
    along = np.empty(count)  # counted from the first element, so that the seam of a circle lies far away
    high = 0.0
    for lat in y:
        high = max(high, abs(lat))
    per_unit = DEGREE * radius if latlon else 1.0
    cosine = max(fast_cos_latitude(min(high + _extremes(reach)[1] / per_unit, 90.0)), 1e-3) if latlon and count else 1.0
    boxes = 0
    for e in range(count):
        along[e] = x[e] - x[0]
        if period > 0.0:
            along[e] -= period * np.round(along[e] / period)
            if not abs(along[e]) + reach[e] / (per_unit * cosine) < 0.25 * period:
                return everyone
        wide, tall = reach[e] / (per_unit * cosine), reach[e] / per_unit
        b = 0
        while b < boxes and name[b] != berg[e]:
            b += 1
        if b == boxes:
            if boxes == _FEW_BERGS:
                return everyone
            name[b], boxes = berg[e], boxes + 1
            box[0, b], box[1, b], box[2, b], box[3, b] = np.inf, -np.inf, np.inf, -np.inf
        at[e] = b
        box[0, b], box[1, b] = min(box[0, b], along[e] - wide), max(box[1, b], along[e] + wide)
        box[2, b], box[3, b] = min(box[2, b], y[e] - tall), max(box[3, b], y[e] + tall)
    candidates = 0
    for e in range(count):
        wide, tall = reach[e] / (per_unit * cosine), reach[e] / per_unit
        for b in range(boxes):
            inside = along[e] + wide > box[0, b] and along[e] - wide < box[1, b]
            if b != at[e] and inside and y[e] + tall > box[2, b] and y[e] - tall < box[3, b]:
                everyone[candidates] = e
                candidates += 1
                break
    return everyone[:candidates]


@kernel
def _near_pairs(
    x: Floats, y: Floats, berg: Ints, reach: Floats, latlon: bool, radius: float, period: float
) -> tuple[Ints, Ints]:
    """Return the pairs of `near_pairs` by a search of bins.

    Elements are searched by classes of reach, each twice as wide as the next: a few that reach far make the search for
    the many others no dearer.
    """
    count = x.size
    if count == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    level = np.zeros(count, np.int64)
    # Where even the widest reach meets few others, one class is enough, and each class costs a look at all.
    columns, rows, closed, cell, bin_start, member = _binned(x, y, 2.0 * _extremes(reach)[1], latlon, radius, period)
    crowded = _crowded(bin_start)
    if crowded:
        least = _extremes(reach)[0]
        for e in range(count):
            level[e] = int(np.log2(reach[e] / least))
    first, second = np.empty(4 * count, np.int64), np.empty(4 * count, np.int64)
    total = 0
    per_unit, widest, high = DEGREE * radius if latlon else 1.0, 0, 0.0
    for e in range(count):
        widest, high = max(widest, level[e]), max(high, abs(y[e]))
    # No metric of a pair has a smaller cosine.
    least_cosine = fast_cos_latitude(min(high, 90.0)) if latlon else 1.0
    searched = np.empty(count, np.int64)
    for k in range(widest, -1, -1):
        number, far = 0, -1.0
        for e in range(count):
            if level[e] <= k:
                searched[number] = e
                number += 1
            if level[e] == k:
                far = max(far, 2.0 * reach[e])
        if far < 0.0:
            continue
        if crowded:
            active = searched[:number]
            columns, rows, closed, cell, bin_start, member = _binned(
                _gathered_rows(x, active), _gathered_rows(y, active), far, latlon, radius, period
            )
        for place_in_search in range(number):
            e = searched[place_in_search]
            if level[e] != k:
                continue
            row, column = cell[place_in_search] // columns, cell[place_in_search] % columns
            # The bins of a row stand beside each other; only round the seam of a circle they are taken one by one.
            wraps = closed and columns > 2
            low, high = (max(column - 1, 0), min(column + 2, columns)) if columns > 2 else (0, columns)
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for shift in range(3 if wraps else 1):
                    if wraps:
                        low = (column + shift - 1) % columns
                        high = low + 1
                    for n in range(bin_start[r * columns + low], bin_start[r * columns + high]):
                        f = searched[member[n]]
                        # Two of one class meet twice.
                        if berg[e] == berg[f] or (level[f] == k and f <= e):
                            continue
                        far = reach[e] + reach[f]
                        east, north = abs(nearest_image(x[e] - x[f], period)), abs(y[e] - y[f])
                        # Most are told without a cosine of their own.
                        if max(north, east * least_cosine) * per_unit > 1.000001 * far:
                            continue
                        rx, ry = separation(x[e], y[e], x[f], y[f], latlon, radius, period)
                        if rx * rx + ry * ry < far * far:
                            if total == first.size:
                                first, second = _longer(first), _longer(second)
                            first[total], second[total] = min(e, f), max(e, f)
                            total += 1
    # Sorted by both ends: the order must not depend on how the bins were gone through.
    for n in range(total):
        first[n] = first[n] * count + second[n]
    _sort(first, 0, total)
    for n in range(total):
        first[n], second[n] = first[n] // count, first[n] % count
    return first[:total].copy(), second[:total].copy()


@kernel
def _gathered_rows(values: Floats, rows: Ints) -> Floats:
    """Return the values of some rows."""
    gathered = np.empty(rows.size)
    for k in range(rows.size):
        gathered[k] = values[rows[k]]
    return gathered


@kernel
def _longer(values: Ints) -> Ints:
    """Return the values at the beginning of an array twice as long."""
    bigger = np.empty(2 * values.size, np.int64)
    for k in range(values.size):
        bigger[k] = values[k]
    return bigger


@kernel
def _sort(values: Ints, first: int, behind: int) -> None:
    """Sort some of the values in place, by Shell's method: NumPy's own sort takes seconds to compile."""
    # The gaps 1, 4, 13, 40, ... of Knuth.
    gap = 1
    while gap < (behind - first) // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(first + gap, behind):
            value, at = values[k], k
            while at >= first + gap and values[at - gap] > value:
                values[at] = values[at - gap]
                at -= gap
            values[at] = value
        gap //= 3


def adjacency(first: Ints, second: Ints, status: Ints, count: int) -> tuple[PairList, Ints]:
    """Partners of each element over unbroken bonds, in order of bond number, and the bonds themselves."""
    start, partner, bond = partners_over_bonds(first, second, status, count)
    return PairList(start, partner), bond


@kernel
def partners_over_bonds(first: Ints, second: Ints, status: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Return ``start``, ``partner`` and ``bond`` of `adjacency`."""
    start = np.zeros(count + 1, np.int64)
    for b in range(first.size):
        if status[b] == 0:
            start[first[b] + 1] += 1
            start[second[b] + 1] += 1
    for e in range(count):
        start[e + 1] += start[e]
    slot = start[:-1].copy()
    partner = np.empty(start[count], np.int64)
    bond = np.empty(start[count], np.int64)
    for b in range(first.size):
        if status[b] == 0:
            i, j = first[b], second[b]
            partner[slot[i]], bond[slot[i]] = j, b
            slot[i] += 1
            partner[slot[j]], bond[slot[j]] = i, b
            slot[j] += 1
    return start, partner, bond
