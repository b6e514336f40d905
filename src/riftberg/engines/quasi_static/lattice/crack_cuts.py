"""Convex polygons that the line of a crack divides into convex pieces.

A geometry library gives pieces of any shape, which would have to be laid out in triangles, and promises no order of its sums:
where pieces strike each other the last digit of a corner decides which bonds break next.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.physics.geometry import find_shared_way
from riftberg.state import Floats

LEAST: Final = 1e-9
"""Longest part of a crack in a polygon that divides nothing, over the size of the polygon: round-off leaves some 1e-12."""


def divide_polygon(corner: Floats, line: Floats) -> list[Floats]:
    """Divide a convex polygon along a line into convex pieces; what ends within it does not divide it.

    ``corner``: anticlockwise, m; ``line``: its points, m; shape (points, 2) each.
    """
    pieces = [corner]
    for start, end in _crossings(corner, line):
        divided: list[Floats] = []
        for piece in pieces:
            # Only the pieces that the segment itself crosses: its continuation divides those alone, which stay convex.
            divided += _cut(piece, start, end) if crosses(piece, start, end) else [piece]
        pieces = divided
    return pieces


def _crossings(corner: Floats, line: Floats) -> list[tuple[Floats, Floats]]:
    """Return the segments of a line from where it enters a convex polygon to where it leaves it."""
    crossings: list[tuple[Floats, Floats]] = []
    path: list[tuple[Floats, Floats]] = []
    begins_inside = False
    for n, (start, end) in enumerate(pairwise(line)):
        enters, leaves = clip(corner, start, end)
        if path and (enters > 0.0 or enters >= leaves):  # it has left the polygon where two segments meet
            crossings += [] if begins_inside else path
            path = []
        if enters >= leaves:
            continue
        if not path:
            begins_inside = n == 0 and enters == 0.0
        path.append((start + enters * (end - start), start + leaves * (end - start)))
        if leaves < 1.0:
            crossings += [] if begins_inside else path
            path = []
    return crossings


def _cut(corner: Floats, start: Floats, end: Floats) -> list[Floats]:
    """Cut a convex polygon along the straight line through two points."""
    along = end - start
    side = along[0] * (corner[:, 1] - start[1]) - along[1] * (corner[:, 0] - start[0])
    halves: tuple[list[Floats], list[Floats]] = ([], [])
    for n in range(len(corner)):
        here, there = side[n], side[(n + 1) % len(corner)]
        for half, sign in zip(halves, (1.0, -1.0), strict=True):
            if sign * here >= 0.0:
                half.append(corner[n])
            if here * there < 0.0:
                half.append(corner[n] + here / (here - there) * (corner[(n + 1) % len(corner)] - corner[n]))
    return [np.array(half) for half in halves if len(half) > 2]


@kernel
def clip(corner: Floats, start: Floats, end: Floats) -> tuple[float, float]:
    """Return between which shares of a segment it lies within a convex polygon; from 1 to 0 where it does not."""
    first, last = 0.0, 1.0
    for n in range(len(corner)):
        m = (n + 1) % len(corner)
        nx, ny = corner[m, 1] - corner[n, 1], corner[n, 0] - corner[m, 0]  # outwards
        outside = nx * (start[0] - corner[n, 0]) + ny * (start[1] - corner[n, 1])
        growth = nx * (end[0] - start[0]) + ny * (end[1] - start[1])
        if growth > 0.0:
            last = min(last, -outside / growth)
        elif growth < 0.0:
            first = max(first, -outside / growth)
        elif outside >= 0.0:
            return 1.0, 0.0
    return (first, last) if last > first else (1.0, 0.0)


@kernel
def crosses(corner: Floats, start: Floats, end: Floats) -> bool:
    """Whether a part of a segment lies within a convex polygon."""
    first, last = clip(corner, start, end)
    size = 0.0
    for n in range(1, len(corner)):
        size = max(size, np.hypot(corner[n, 0] - corner[0, 0], corner[n, 1] - corner[0, 1]))
    return bool((last - first) * np.hypot(end[0] - start[0], end[1] - start[1]) > LEAST * size)


@kernel
def touches_line(corner: Floats, line: Floats) -> bool:
    """Whether a part of a line lies within a convex polygon."""
    touches = False
    for n in range(len(line) - 1):
        touches = touches or crosses(corner, line[n], line[n + 1])
    return touches


@kernel
def count_crossings(start: Floats, end: Floats, line: Floats) -> int:
    """Return how often a line crosses a segment."""
    count = 0
    for n in range(len(line) - 1):
        px, py, qx, qy = line[n, 0], line[n, 1], line[n + 1, 0], line[n + 1, 1]
        # A point on the line counts as one on its left, so that a way through a corner crosses once.
        a = (qx - px) * (start[1] - py) - (qy - py) * (start[0] - px) >= 0.0
        b = (qx - px) * (end[1] - py) - (qy - py) * (end[0] - px) >= 0.0
        c = (end[0] - start[0]) * (py - start[1]) - (end[1] - start[1]) * (px - start[0]) >= 0.0
        d = (end[0] - start[0]) * (qy - start[1]) - (end[1] - start[1]) * (qx - start[0]) >= 0.0
        count += int(a != b and c != d)
    return count


@kernel
def distances_to_line(point: Floats, line: Floats) -> Floats:
    """Return the distances of points from a line, m."""
    distance = np.full(len(point), np.inf)
    for k in range(len(point)):
        for n in range(len(line) - 1):
            dx, dy = line[n + 1, 0] - line[n, 0], line[n + 1, 1] - line[n, 1]
            x, y, size = point[k, 0] - line[n, 0], point[k, 1] - line[n, 1], dx * dx + dy * dy
            share = (x * dx + y * dy) / size if size > 0.0 else 0.0
            share = min(max(share, 0.0), 1.0)
            distance[k] = min(distance[k], np.hypot(x - share * dx, y - share * dy))
    return distance


@kernel
def shared_side(one: Floats, two: Floats, gap: float) -> float:
    """Return the length (m) along which two anticlockwise polygons lie side by side, up to a ``gap`` (m) between them."""
    total, ends = 0.0, np.empty((2, 2))
    for n in range(len(one)):
        for m in range(len(two)):
            total += find_shared_way((one[n - 1], one[n]), (two[m - 1], two[m]), gap, ends)
    return total


@kernel
def area_and_centroid(corner: Floats, first: int, end: int) -> tuple[float, float, float]:
    """Area (m2) and centroid (m) of a polygon, the corners ``first`` to ``end``."""
    area = mx = my = 0.0
    x0, y0 = corner[first, 0], corner[first, 1]
    for n in range(first + 1, end - 1):
        ux, uy, vx, vy = corner[n, 0] - x0, corner[n, 1] - y0, corner[n + 1, 0] - x0, corner[n + 1, 1] - y0
        triangle = 0.5 * (ux * vy - vx * uy)
        area += triangle
        mx += triangle * (ux + vx) / 3.0
        my += triangle * (uy + vy) / 3.0
    return (area, x0 + mx / area, y0 + my / area) if area > 0.0 else (0.0, x0, y0)
