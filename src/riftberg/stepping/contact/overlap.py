"""Narrow phase of contact by faces: where two convex polygons overlap, or how far apart they are.

Polygons are given by their corners (m) counter-clockwise. Those of one element add up: area and chord of an element that is cut
into several are the sums of theirs, as the edges between them cancel.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats


@kernel
def overlap(one: Floats, two: Floats, scratch: Floats) -> tuple[float, float, float, float, float]:
    """Area (m2) of the overlap of two convex polygons, its first moments (m3), and its chord (m; along the face of ``one``).

    ``one`` is cut by each edge of ``two`` in turn (Sutherland and Hodgman), so what is left is closed whatever the round-off:
    pieces of edges that are found each for itself end decimetres apart where edges cross at a flat angle, and such a gap in the
    outline of a face of kilometres counts as metres of depth. The chord is the sum of the edges of ``one`` as vectors, so its
    normal to the right points out of ``one``. ``scratch``: room for all corners, shape (2, 2 (corners of both), 3).
    """
    n, count, now = one.shape[0], one.shape[0], 0
    for k in range(n):
        # East and north, and whether the edge that begins here is one of the first polygon.
        scratch[0, k, 0], scratch[0, k, 1], scratch[0, k, 2] = one[k, 0], one[k, 1], 1.0
    for k in range(two.shape[0]):
        j = k + 1 if k + 1 < two.shape[0] else 0
        px, py, ex, ey = two[k, 0], two[k, 1], two[j, 0] - two[k, 0], two[j, 1] - two[k, 1]
        old, new, kept = scratch[now], scratch[1 - now], 0
        for i in range(count):
            after = i + 1 if i + 1 < count else 0
            x, y, u, v = old[i, 0], old[i, 1], old[after, 0], old[after, 1]
            here, there = ex * (y - py) - ey * (x - px), ex * (v - py) - ey * (u - px)
            if here >= 0.0:
                new[kept, 0], new[kept, 1], new[kept, 2] = x, y, old[i, 2]
                kept += 1
            if (here >= 0.0) != (there >= 0.0):
                part = here / (here - there)
                new[kept, 0], new[kept, 1] = x + part * (u - x), y + part * (v - y)
                new[kept, 2] = 0.0 if here >= 0.0 else old[i, 2]
                kept += 1
        count, now = kept, 1 - now
        if count < 3:
            return 0.0, 0.0, 0.0, 0.0, 0.0
    area = mx = my = cx = cy = 0.0
    ring = scratch[now]
    # About one of its corners: coordinates of kilometres would cost the digits of a thin overlap.
    ox, oy = ring[0, 0], ring[0, 1]
    for i in range(count):
        after = i + 1 if i + 1 < count else 0
        px, py, qx, qy = ring[i, 0] - ox, ring[i, 1] - oy, ring[after, 0] - ox, ring[after, 1] - oy
        twice = px * qy - py * qx
        area += 0.5 * twice
        mx += twice * (px + qx) / 6.0
        my += twice * (py + qy) / 6.0
        if ring[i, 2] > 0.0:
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
