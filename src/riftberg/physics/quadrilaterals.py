"""Plane geometry of cells: images in a periodic domain, sides of edges, bilinear maps and their inverse.

Source: equations 2.3, 2.4, 2.5, 3.2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE

Floats = NDArray[np.float64]


Point = tuple[float, float]
"""Longitude and latitude (degrees), or x and y (m)."""


@kernel
def wrap_around(x: float, centre: float, period: float) -> float:
    """Return the image of ``x`` within half a period of ``centre``; ``x`` itself if ``period`` <= 0 (equations 2.4)."""
    if period <= 0.0:
        return x
    west = centre - 0.5 * period
    distance = x - west
    # The remainder of a number already in range is that number, bit for bit; it is only slow to compute.
    if distance < 0.0 or distance >= period:
        distance = distance % period
    return distance + west


@kernel
def edge_sign(x: float, y: float, xa: float, ya: float, xb: float, yb: float, on_line: float) -> float:
    """Return +1 right and -1 left of the edge a -> b, and ``on_line`` on it (equations 2.5)."""
    side = (x - xa) * (yb - ya) - (y - ya) * (xb - xa)
    if side > 0.0:
        return 1.0
    if side < 0.0:
        return -1.0
    return on_line


@kernel
def in_pentagon(x: float, y: float, period: float, a: Point, b: Point, c: Point, d: Point, e: Point) -> bool:
    """Whether a point lies in a polygon of five corners, longitudes taken around the first corner (equations 2.5)."""
    x0, x1, x2 = wrap_around(a[0], a[0], period), wrap_around(b[0], a[0], period), wrap_around(c[0], a[0], period)
    x3, x4 = wrap_around(d[0], a[0], period), wrap_around(e[0], a[0], period)
    x = wrap_around(x, a[0], period)
    p0 = edge_sign(x, y, x0, a[1], x1, b[1], 0.0)
    p1 = edge_sign(x, y, x1, b[1], x2, c[1], 0.0)
    p2 = edge_sign(x, y, x2, c[1], x3, d[1], 0.0)
    p3 = edge_sign(x, y, x3, d[1], x4, e[1], 0.0)
    p4 = edge_sign(x, y, x4, e[1], x0, a[1], 0.0)
    return abs(p0) + abs(p1) + abs(p2) + abs(p3) + abs(p4) - abs(p0 + p1 + p2 + p3 + p4) < 0.5


@kernel
def inverse_bilinear(x: float, y: float, period: float, sw: Point, se: Point, ne: Point, nw: Point) -> Point:
    """Return (xi, eta) of a point in the quadrilateral with these corners (equations 2.5).

    The roots are those of equations 2.5, evaluated so that nearly parallel edges and rotated cells lose no digits.
    """
    x1, y1 = sw
    alpha, delta = se[0] - x1, se[1] - y1
    beta, epsilon = nw[0] - x1, nw[1] - y1
    gamma, kappa = (ne[0] - x1) - (alpha + beta), (ne[1] - y1) - (delta + epsilon)
    dx, dy = wrap_around(x, x1, period) - x1, y - y1
    a = kappa * beta - gamma * epsilon
    b = (delta * beta - alpha * epsilon) - (kappa * dx - gamma * dy)
    c = alpha * dy - delta * dx
    # The equations ask for 1e-12 whatever the units; in cells of some metres, in degrees, that is no small number.
    if abs(a) > 1e-12 * min(1.0, abs(b)):
        # Far outside a cell the lines eta = const need not reach the point; the nearest one then points the way.
        root = math.sqrt(max(0.25 * b * b - a * c, 0.0))
        q = -(0.5 * b + root) if b >= 0.0 else -(0.5 * b - root)
        first = q / a
        second = c / q if q != 0.0 else first
        eta, other = (first, second) if abs(first - 0.5) < abs(second - 0.5) else (second, first)
        # In a cell whose northern corners are one point (the pole) the other root is always that point.
        if abs(alpha + gamma * eta) + abs(delta + kappa * eta) < 1e-9 * (abs(alpha) + abs(delta)):
            eta = other
    else:
        eta = -c / b if b != 0.0 else 0.0
    along_x, along_y = alpha + gamma * eta, delta + kappa * eta
    if along_x != 0.0 and abs(along_x) >= abs(along_y):
        return (dx - beta * eta) / along_x, eta
    if along_y != 0.0:
        return (dy - epsilon * eta) / along_y, eta
    across = (epsilon * alpha - beta * delta) + (epsilon * gamma - beta * kappa) * eta
    return ((epsilon * dx - beta * dy) / across if across != 0.0 else 0.5), eta


@kernel
def polar_plane(lon: float, lat: float) -> tuple[float, float]:
    """Return a point as (x, y) in the plane around the north pole, in degrees of latitude (equations 2.5)."""
    distance = 90.0 - lat
    return distance * math.cos(lon * DEGREE), distance * math.sin(lon * DEGREE)


@kernel
def blend_corners(ne: float, nw: float, se: float, sw: float, xi: float, eta: float) -> float:
    """Return the bilinear value at (xi, eta) of four corner values (equations 3.2)."""
    return (ne * xi + nw * (1.0 - xi)) * eta + (se * xi + sw * (1.0 - xi)) * (1.0 - eta)


@kernel
def bilinear(q: Floats, i: int, j: int, xi: float, eta: float) -> float:
    """Return the bilinear value at (xi, eta) of corner values, in the operation order of equations 3.2."""
    return blend_corners(q[j, i], q[j, i - 1], q[j - 1, i], q[j - 1, i - 1], xi, eta)
