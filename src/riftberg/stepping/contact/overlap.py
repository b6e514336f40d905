"""Narrow phase of contact by faces: where two convex polygons overlap, or how far apart they are.

Polygons are given by their corners (m) counter-clockwise. Those of one element add up: area and chord of an element that is cut
into several are the sums of theirs, as the edges between them cancel.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats


@kernel
def _inside(ax: float, ay: float, bx: float, by: float, polygon: Floats) -> tuple[float, float]:
    """Which part of the way from a to b lies in a convex polygon: from and to, as parts of one; the same where none does."""
    enter, leave, n = 0.0, 1.0, polygon.shape[0]
    for k in range(n):
        px, py = polygon[k, 0], polygon[k, 1]
        j = k + 1 if k + 1 < n else 0
        ex, ey = polygon[j, 0] - px, polygon[j, 1] - py
        start, end = ex * (ay - py) - ey * (ax - px), ex * (by - py) - ey * (bx - px)
        if start < 0.0 and end < 0.0:
            return 0.0, 0.0
        if start < 0.0:
            enter = max(enter, start / (start - end))
        elif end < 0.0:
            leave = min(leave, start / (start - end))
    return (enter, leave) if leave > enter else (0.0, 0.0)


@kernel
def overlap(one: Floats, two: Floats) -> tuple[float, float, float, float, float]:
    """Area (m2) of the overlap of two convex polygons, its first moments (m3), and its chord (m; along the face of ``one``).

    By Green's theorem over its outline: the parts of the edges of each that lie in the other. The chord is the sum of those
    of ``one`` as vectors, so its normal to the right points out of ``one``.
    """
    area = mx = my = cx = cy = 0.0
    # About a corner of the first: coordinates of kilometres would cost the digits of a thin overlap.
    ox, oy = one[0, 0], one[0, 1]
    for side in range(2):
        edges, other = (one, two) if side == 0 else (two, one)
        n = edges.shape[0]
        for k in range(n):
            j = k + 1 if k + 1 < n else 0
            ax, ay, bx, by = edges[k, 0], edges[k, 1], edges[j, 0], edges[j, 1]
            enter, leave = _inside(ax, ay, bx, by, other)
            if leave <= enter:
                continue
            px, py = ax + enter * (bx - ax) - ox, ay + enter * (by - ay) - oy
            qx, qy = ax + leave * (bx - ax) - ox, ay + leave * (by - ay) - oy
            twice = px * qy - py * qx
            area += 0.5 * twice
            mx += twice * (px + qx) / 6.0
            my += twice * (py + qy) / 6.0
            if side == 0:
                cx += qx - px
                cy += qy - py
    return area, mx + area * ox, my + area * oy, cx, cy


@kernel
def gap(one: Floats, two: Floats) -> tuple[float, float, float]:
    """Widest strip (m) between two convex polygons, and its normal out of ``one``; negative where they overlap.

    Along this normal no point of one can reach the other before the strip is crossed.
    """
    widest, nx, ny = -math.inf, 1.0, 0.0
    for side in range(2):
        edges, other = (one, two) if side == 0 else (two, one)
        n = edges.shape[0]
        for k in range(n):
            j = k + 1 if k + 1 < n else 0
            ex, ey = edges[j, 0] - edges[k, 0], edges[j, 1] - edges[k, 1]
            size = math.sqrt(ex * ex + ey * ey)
            if size == 0.0:
                continue
            ux, uy, least = ey / size, -ex / size, math.inf
            for i in range(other.shape[0]):
                least = min(least, ux * (other[i, 0] - edges[k, 0]) + uy * (other[i, 1] - edges[k, 1]))
            if least > widest:
                widest = least
                nx, ny = (ux, uy) if side == 0 else (-ux, -uy)
    return widest, nx, ny
