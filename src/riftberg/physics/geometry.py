"""Metres and degrees on a sphere, the tangent plane near the pole, the Coriolis parameter, fast sine and cosine, plane geometry.

Source: equations 2.2 to 2.5 and 3.2. The sine and cosine here are polynomials without branches: unlike calls of the C
library they let loops over bonds become vector instructions. Their error is below 3e-16.

At the end stands the linear algebra of 3 by 3 matrices, written out: one for each fragment or pair of elements, too small
for a library. Sums run in a fixed order, so results do not depend on the compiler.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE, EARTH_ROTATION

Floats = NDArray[np.float64]

_INVERSE_PI = 1.0 / math.pi
# pi in three parts; the first two have 33 bits, so that their products with up to a million half turns are exact.
_PI_HIGH = 3.1415926534682512
_PI_MIDDLE = 1.2154201012607932e-10
_PI_LOW = 4.044532497591901e-21


@kernel
def fast_sin(angle: float) -> float:
    """Sine of an angle (rad) by range reduction and a Taylor polynomial of degree 21."""
    # Half turns, and what is left of them in [-pi/2, pi/2]; odd ones change the sign.
    turns = np.floor(angle * _INVERSE_PI + 0.5)
    x = ((angle - turns * _PI_HIGH) - turns * _PI_MIDDLE) - turns * _PI_LOW
    sign = 1.0 - 2.0 * (turns - 2.0 * np.floor(0.5 * turns))
    return sign * _sin_reduced(x, x * x)


SMALL_ANGLE: Final = 0.1
"""Up to this angle (rad) `sin_small` is the sine to the last digit or two."""


@kernel
def sin_small(angle: float) -> float:
    """Sine of a small angle (rad, up to `SMALL_ANGLE`) by a Taylor polynomial of degree 9."""
    q = angle * angle
    # Horner's scheme written out: a loop over coefficients would not be unrolled before the loop over bonds
    # vectorises.
    s = 1.0 / 362880.0
    s = -1.0 / 5040.0 + q * s
    s = 1.0 / 120.0 + q * s
    s = -1.0 / 6.0 + q * s
    return angle + angle * (q * s)


@kernel
def _sin_reduced(x: float, q: float) -> float:
    """Sine for abs(x) <= pi/2; ``q`` is x squared."""
    # Horner's scheme, from 1/21! down, written out as in `sin_small`.
    s = 1.0 / 51090942171709440000.0
    s = -1.0 / 121645100408832000.0 + q * s
    s = 1.0 / 355687428096000.0 + q * s
    s = -1.0 / 1307674368000.0 + q * s
    s = 1.0 / 6227020800.0 + q * s
    s = -1.0 / 39916800.0 + q * s
    s = 1.0 / 362880.0 + q * s
    s = -1.0 / 5040.0 + q * s
    s = 1.0 / 120.0 + q * s
    s = -1.0 / 6.0 + q * s
    return x + x * (q * s)


@kernel
def fast_cos_latitude(degrees: float) -> float:
    """Cosine of a latitude in degrees, -90 to 90, by a Taylor polynomial of degree 22."""
    x = degrees * DEGREE
    q = x * x
    # Horner's scheme, from 1/22! down, written out as in `sin_small`.
    c = -1.0 / 1124000727777607680000.0
    c = 1.0 / 2432902008176640000.0 + q * c
    c = -1.0 / 6402373705728000.0 + q * c
    c = 1.0 / 20922789888000.0 + q * c
    c = -1.0 / 87178291200.0 + q * c
    c = 1.0 / 479001600.0 + q * c
    c = -1.0 / 3628800.0 + q * c
    c = 1.0 / 40320.0 + q * c
    c = -1.0 / 720.0 + q * c
    c = 1.0 / 24.0 + q * c
    c = -0.5 + q * c
    return 1.0 + q * c


@kernel
def cos_near(cosine: float, sine: float, turn: float) -> float:
    """Cosine of an angle ``turn`` (rad, below 0.02) away from one whose cosine and sine are known, to 1e-13."""
    q = turn * turn
    return cosine * (1.0 - q * (0.5 - q * (1.0 / 24.0))) - sine * (turn * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0))))


@kernel
def metres_per_unit(latitude: float, latlon: bool, radius: float) -> tuple[float, float]:
    """Metres per unit of x and of y at a latitude (equations 2.2); 1 and 1 on a Cartesian grid.

    Parameters
    ----------
    latitude : float
        Degrees.
    latlon : bool
        Units are degrees.
    radius : float
        Radius of the sphere, m.
    """
    if not latlon:
        return 1.0, 1.0
    per_degree = DEGREE * radius
    return per_degree * math.cos(latitude * DEGREE), per_degree


@kernel
def same_axes(du: float, dv: float, u_mean: float, v_mean: float, turn: float) -> tuple[float, float]:
    """Difference of two velocities (m s-1) given in their own local axes, in common axes between them.

    ``(du - a v, dv + a u)`` with the angle a (rad) by which east at the first place is turned against east at the second,
    ``dlon sin(lat)``: without it a rigid berg that turns seems to slip along its bonds.
    """
    return du - turn * v_mean, dv + turn * u_mean


@kernel
def nearest_image(difference: float, period: float) -> float:
    """Bring a difference of two zonal coordinates into [-period/2, period/2); unchanged if period <= 0 (equations 8.2)."""
    if period > 0.0:
        return difference - period * np.floor(difference / period + 0.5)
    return difference


@kernel
def separation(
    x1: float, y1: float, x2: float, y2: float, latlon: bool, radius: float, period: float
) -> tuple[float, float]:
    """Vector in metres from point 2 to point 1, with the metric of the mean latitude (equations 2.2, 5.2)."""
    mx, my = metres_per_unit(0.5 * (y1 + y2), latlon, radius)
    return nearest_image(x1 - x2, period) * mx, (y1 - y2) * my


@kernel
def to_tangent_plane(lon: float, lat: float, radius: float) -> tuple[float, float]:
    """Position (m) on the plane that touches the sphere at the North Pole (equations 2.3)."""
    r = radius * (90.0 - lat) * DEGREE
    return r * math.cos(lon * DEGREE), r * math.sin(lon * DEGREE)


@kernel
def from_tangent_plane(x: float, y: float, radius: float) -> tuple[float, float]:
    """Longitude in (-180, 180] and latitude (degrees) of a point on the polar plane (equations 2.3)."""
    r = math.sqrt(x * x + y * y)
    lat = 90.0 - r / radius / DEGREE
    # Round-off may leave the cosine beyond 1, where the arc is no number.
    lon = 0.0 if r == 0.0 else math.acos(min(1.0, max(-1.0, x / r))) / DEGREE
    return (lon if y >= 0.0 else -lon), lat


@kernel
def vector_to_plane(lon: float, u: float, v: float) -> tuple[float, float]:
    """Turn an (east, north) vector into polar-plane components (equations 2.3)."""
    c, s = math.cos(lon * DEGREE), math.sin(lon * DEGREE)
    return -s * u - c * v, c * u - s * v


@kernel
def vector_from_plane(lon: float, x: float, y: float) -> tuple[float, float]:
    """Turn polar-plane components into an (east, north) vector (equations 2.3)."""
    c, s = math.cos(lon * DEGREE), math.sin(lon * DEGREE)
    return -s * x + c * y, -c * x - s * y


@kernel
def move(lon: float, lat: float, u: float, v: float, dt: float, latlon: bool, radius: float) -> tuple[float, float]:
    """Position after ``dt`` seconds at velocity (u, v), m s-1 (equations 6.2, 6.4; tangent plane north of 89 degrees)."""
    if latlon and lat > 89.0:
        x, y = to_tangent_plane(lon, lat, radius)
        px, py = vector_to_plane(lon, u, v)
        new_lon, new_lat = from_tangent_plane(x + dt * px, y + dt * py, radius)
        # Keep the branch of the longitude, so that a berg that crosses 180 degrees does not jump.
        return lon + nearest_image(new_lon - lon, 360.0), new_lat
    mx, my = metres_per_unit(lat, latlon, radius)
    return lon + dt * (u / mx), lat + dt * (v / my)


@kernel
def add_velocity(
    lon: float, lat: float, u: float, v: float, ax: float, ay: float, dt: float, latlon: bool
) -> tuple[float, float]:
    """Velocity (u, v) + dt (ax, ay); on the polar plane north of 89 degrees, with the current longitude (equations 2.3).

    The rotation to the plane and back is linear and uses one longitude, so it is an identity up to round-off; it is
    kept because the reference does so.
    """
    if latlon and lat > 89.0:
        px, py = vector_to_plane(lon, u, v)
        qx, qy = vector_to_plane(lon, ax, ay)
        return vector_from_plane(lon, px + dt * qx, py + dt * qy)
    return u + dt * ax, v + dt * ay


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


@kernel
def overlap(one: Floats, two: Floats, scratch: Floats) -> tuple[float, float, float, float, float]:
    """Area (m2) of the overlap of two convex polygons, its first moments (m3), and its chord (m; along the face of ``one``).

    Both are given by their corners (m), counter-clockwise. Those of one element add up: area and chord of an element that is cut
    into several are the sums of theirs, as the edges between them cancel.

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


@kernel
def find_shared_way(side: tuple[Floats, Floats], other: tuple[Floats, Floats], tolerance: float, ends: Floats) -> float:
    """Length (m) along which two sides of opposite senses lie on each other within ``tolerance`` (m), 0 for none; fill its ends.

    ``side``, ``other``: where each begins and ends, m.
    """
    x, y = side[0][0], side[0][1]
    ux, uy = side[1][0] - x, side[1][1] - y
    length = math.sqrt(ux * ux + uy * uy)
    if length <= tolerance:
        return 0.0
    ux, uy = ux / length, uy / length
    px, py, qx, qy = other[1][0] - x, other[1][1] - y, other[0][0] - x, other[0][1] - y
    begin, end, offset = ux * px + uy * py, ux * qx + uy * qy, ux * py - uy * px
    low, high = max(begin, 0.0), min(end, length)
    if high - low <= tolerance:
        return 0.0
    slope = (ux * qy - uy * qx - offset) / (end - begin)
    if max(abs(offset + slope * (low - begin)), abs(offset + slope * (high - begin))) > tolerance:
        return 0.0
    ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = x + low * ux, y + low * uy, x + high * ux, y + high * uy
    return float(high - low)


@kernel
def coriolis_parameter(latitude: float, latlon: bool, f_plane: bool, reference_latitude: float) -> float:
    """Return f = 2 Omega sin(latitude), s-1 (equations 2.6); of the reference latitude on an f-plane or a Cartesian grid.

    Parameters
    ----------
    latitude, reference_latitude : float
        Degrees.
    """
    phi = latitude if latlon and not f_plane else reference_latitude
    return 2.0 * EARTH_ROTATION * math.sin(phi * DEGREE)


@kernel
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Set ``out = a b``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def subtract_product(out: Floats, a: Floats, b: Floats) -> None:
    """Set ``out -= a b^T``."""
    for i in range(3):
        for j in range(3):
            out[i, j] -= a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@kernel
def times(a: Floats, x: Floats) -> tuple[float, float, float]:
    """Return ``a x``."""
    return (
        a[0, 0] * x[0] + a[0, 1] * x[1] + a[0, 2] * x[2],
        a[1, 0] * x[0] + a[1, 1] * x[1] + a[1, 2] * x[2],
        a[2, 0] * x[0] + a[2, 1] * x[1] + a[2, 2] * x[2],
    )


@kernel
def solve(a: Floats, x: Floats) -> tuple[float, float, float]:
    """Solve ``a z = x`` by elimination with pivots."""
    # In numbers and not in arrays, which would be written and read again at each exchange of rows.
    one = a[0, 0], a[0, 1], a[0, 2], x[0]
    two = a[1, 0], a[1, 1], a[1, 2], x[1]
    three = a[2, 0], a[2, 1], a[2, 2], x[2]
    if abs(three[0]) > max(abs(one[0]), abs(two[0])):
        one, three = three, one
    elif abs(two[0]) > abs(one[0]):
        one, two = two, one
    f, g = two[0] / one[0], three[0] / one[0]
    four = two[1] - f * one[1], two[2] - f * one[2], two[3] - f * one[3]
    five = three[1] - g * one[1], three[2] - g * one[2], three[3] - g * one[3]
    if abs(five[0]) > abs(four[0]):
        four, five = five, four
    f = five[0] / four[0]
    z = (five[2] - f * four[2]) / (five[1] - f * four[1])
    y = (four[2] - four[1] * z) / four[0]
    return (one[3] - one[1] * y - one[2] * z) / one[0], y, z


@kernel
def invert_matrix(a: Floats, out: Floats, unit: Floats) -> None:
    """Invert a matrix of 3 by 3; ``unit`` has room for one of its rows."""
    for j in range(3):
        for i in range(3):
            unit[i] = 1.0 if i == j else 0.0
        out[0, j], out[1, j], out[2, j] = solve(a, unit)


@kernel
def invert(matrices: Floats, out: Floats, scratch: Floats) -> None:
    """Invert each matrix of a stack; ``scratch`` has room for one of them."""
    for b in range(matrices.shape[0]):
        invert_matrix(matrices[b], out[b], scratch[0, 0])


@kernel
def invert_symmetric(a: Floats, out: Floats) -> None:
    """Invert a symmetric matrix by its cofactors."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    scale = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
    out[0, 0] = scale * c00
    out[0, 1] = out[1, 0] = scale * c01
    out[0, 2] = out[2, 0] = scale * c02
    out[1, 1] = scale * (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2])
    out[1, 2] = out[2, 1] = scale * (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2])
    out[2, 2] = scale * (a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1])
