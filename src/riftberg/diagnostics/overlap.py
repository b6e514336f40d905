"""Outlines laid on each other: overlap, centroids, axes, and which fragments make up which observed piece."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from shapely.affinity import translate

from riftberg.plane import ConformalPlane
from riftberg.runs.track import principal_azimuth
from riftberg.state import Floats

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


def best_pairs(cost: Floats, alone: float) -> list[tuple[int, int]]:
    """Return the pairs of the least total cost, where each row that stays alone costs ``alone``.

    ``cost``: cost of each pair, not negative (shape (rows, columns)); returns row and column of each pair, by row.
    """
    rows, columns = cost.shape
    # Loaded here: it takes a third of a second, and few commands need it.
    from scipy.optimize import linear_sum_assignment

    # Each row gets a column of its own on which it stays alone.
    table = np.full((rows, columns + rows), np.inf)
    table[:, :columns] = cost
    table[np.arange(rows), columns + np.arange(rows)] = alone
    pairs = zip(*linear_sum_assignment(table), strict=True)
    return [(int(row), int(column)) for row, column in pairs if column < columns]


TWINS: Final = 0.8
"""Two outlines of a day that overlap more than this (intersection over union) are one piece drawn twice."""

REACH: Final = 3.0
"""Mean diameters between the centroids beyond which a fragment and a piece that do not overlap are not the same."""

LARGEST_RATIO: Final = 4.0
"""Ratio of areas beyond which a fragment is not the piece."""

KEPT: Final = 0.5
"""Part of its cost that a pair has if it held the time before: a fragment does not change its name without need."""

WORST: Final = 3.0
"""Cost of a pair that may just be, and of a piece that stays without a fragment."""


def group_fragments(
    shapes: dict[int, BaseGeometry], pieces: Sequence[BaseGeometry], before: Mapping[int, int] | None = None
) -> list[list[int]]:
    """Return which fragments make up each observed piece.

    Each piece gets at most one fragment first, all pieces together in the best way (`pair_cost`). A fragment that is
    left joins the piece whose overlap, centroid on centroid, it makes better.
    """
    union = shapely.union_all
    numbers, before = list(shapes), before or {}
    cost = np.empty((len(pieces), len(numbers)))
    for (k, piece), (i, number) in product(enumerate(pieces), enumerate(numbers)):
        same = KEPT if before.get(k) == number else 1.0
        cost[k, i] = same * pair_cost(shapes[number], piece, main=i == k == 0)
    groups: list[list[int]] = [[] for _ in pieces]
    free = dict(shapes)
    for k, column in best_pairs(cost, alone=WORST):
        groups[k] = [numbers[column]]
        del free[numbers[column]]
    for number, shape in free.items():
        gains = [
            aligned_overlap(union([shapes[n] for n in (*group, number)]), piece)
            - aligned_overlap(union([shapes[n] for n in group]), piece)
            if group
            else 0.0
            for group, piece in zip(groups, pieces, strict=True)
        ]
        if max(gains, default=0.0) > 0.0 and shape.area > 0.0:
            groups[int(np.argmax(gains))].append(number)
    return groups


def same_pieces(earlier: Sequence[BaseGeometry], pieces: Sequence[BaseGeometry]) -> dict[int, int]:
    """Return which piece (by its index) is which one of an earlier time, all in the best way."""
    cost = np.empty((len(pieces), len(earlier)))
    for (k, piece), (i, other) in product(enumerate(pieces), enumerate(earlier)):
        cost[k, i] = pair_cost(other, piece)
    return dict(best_pairs(cost, alone=WORST))


def pair_cost(shape: BaseGeometry, piece: BaseGeometry, *, main: bool = False) -> float:
    """Return how badly a fragment answers to an observed piece, 0 to `WORST`; infinite where it is not that piece.

    The cost is the sum of three parts from 0 to 1: what the overlap (intersection over union) lacks, the distance of the
    centroids as a part of the largest that may be, and the logarithm of the ratio of areas as a part of that of
    `LARGEST_RATIO`. A fragment is not the piece if it has more than `LARGEST_RATIO` times its area; or if they do not overlap
    and it has less than that part of it, or lies further away than `REACH` times the mean diameter of both (of circles of
    their areas).

    ``shape``, ``piece``: outlines of the fragment and the piece, m.
    """
    if min(shape.area, piece.area) <= 0.0:
        return math.inf
    iou, ratio = intersection_over_union(shape, piece), float(shape.area / piece.area)
    diameters = [2.0 * math.sqrt(a.area / math.pi) for a in (shape, piece)]
    away = float(shape.centroid.distance(piece.centroid)) / (REACH * 0.5 * sum(diameters))
    unlike = abs(math.log(ratio)) / math.log(LARGEST_RATIO)
    if ratio > LARGEST_RATIO or (iou == 0.0 and (unlike > 1.0 or (away > 1.0 and not main))):
        return math.inf
    return 1.0 - iou + min(away, 1.0) + min(unlike, 1.0)


def intersection_over_union(a: BaseGeometry, b: BaseGeometry) -> float:
    """Return the intersection over the union of two outlines."""
    common = float(a.intersection(b).area)
    whole = float(a.area) + float(b.area) - common
    return common / whole if whole > 0.0 else 0.0


def aligned_overlap(a: BaseGeometry, b: BaseGeometry) -> float:
    """Return the intersection over the union of two outlines whose centroids are laid on each other."""
    here, there = a.centroid, b.centroid
    return intersection_over_union(translate(a, there.x - here.x, there.y - here.y), b)


def axis_difference(first: float, second: float) -> float:
    """Return the angle between two axes, first minus second, degrees in [-90, 90)."""
    return (first - second + 90.0) % 180.0 - 90.0


def polygon_moments(ring: Floats) -> tuple[float, float, float]:
    """Return the centroid of a polygon and the azimuth of its axis of the largest second moment.

    ``ring``: corners, m east and north, closed or not (shape (n, 2)); returns ``x, y``: centroid, m.
    """
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    xn, yn = np.roll(x, -1), np.roll(y, -1)
    cross = x * yn - xn * y
    area = 0.5 * cross.sum()
    cx, cy = ((x + xn) * cross).sum() / (6.0 * area), ((y + yn) * cross).sum() / (6.0 * area)
    xx = ((x * x + x * xn + xn * xn) * cross).sum() / (12.0 * area) - cx * cx
    yy = ((y * y + y * yn + yn * yn) * cross).sum() / (12.0 * area) - cy * cy
    xy = ((x * yn + 2.0 * x * y + 2.0 * xn * yn + xn * y) * cross).sum() / (24.0 * area) - cx * cy
    return float(cx + ring[0, 0]), float(cy + ring[0, 1]), principal_azimuth(float(xx), float(yy), float(xy))


def polygon_on(plane: ConformalPlane, ring: Floats) -> BaseGeometry:
    """Return an outline on the plane; one that crosses itself is made valid and its largest part kept."""
    x, y = plane.forward(ring[:, 0], ring[:, 1])
    polygon: BaseGeometry = shapely.Polygon(np.column_stack([x, y]))
    if not polygon.is_valid:
        # Parts may be collections themselves, and lines where the outline runs back along itself.
        parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(polygon)))
        polygon = max(parts, key=lambda part: part.area)
    return polygon


def without_twins(pieces: list[tuple[str, BaseGeometry]]) -> list[tuple[str, BaseGeometry]]:
    """Return the pieces largest first, without those drawn twice."""
    kept: list[tuple[str, BaseGeometry]] = []
    for name, piece in sorted(pieces, key=lambda p: -p[1].area):
        if not any(intersection_over_union(piece, other) > TWINS for _, other in kept):
            kept.append((name, piece))
    return kept
