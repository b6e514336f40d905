"""Twin of the cell geometry, equations 2.4, 2.5, 8.1, with the own indices of the reference, counted from 1."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass
class PlainGrid:
    """A grid addressed as in the equations: ``at("lon", i, j)`` is lon(i, j)."""

    data: dict
    halo: int
    latlon: bool
    regular: bool
    period: float

    @classmethod
    def of(cls, arrays):
        """Wrap the arrays of a grid under test."""
        data = {name: value for name, value in arrays._asdict().items() if isinstance(value, np.ndarray)}
        return cls(data, arrays.halo, arrays.latlon, arrays.regular, arrays.period)

    def at(self, name, i, j):
        """Value of a grid array at (i, j)."""
        return self.of_field(self.data[name], i, j)

    def of_field(self, field, i, j):
        """Value of any array at (i, j)."""
        return float(field[j - 1 + self.halo, i - 1 + self.halo])

    def limits(self):
        """Return i_sd, i_ed, j_sd, j_ed of the data domain."""
        rows, columns = self.data["lon"].shape
        return 1 - self.halo, columns - self.halo, 1 - self.halo, rows - self.halo

    def corners(self, i, j):
        """SW, SE, NE, NW as (x, y)."""
        where = [(i - 1, j - 1), (i, j - 1), (i, j), (i - 1, j)]
        return [(self.at("lon", a, b), self.at("lat", a, b)) for a, b in where]


def modulo(x, y, length):
    """mod_L(x; y), equations 2.4."""
    return ((x - (y - length / 2)) % length) + (y - length / 2) if length > 0 else x


def in_cell(grid, x, y, i, j):
    """is_point_in_cell, equations 2.5."""
    corners = grid.corners(i, j)
    xs = [modulo(cx, x, grid.period) for cx, _ in corners]
    ys = [cy for _, cy in corners]
    if not (min(xs) - 0.1 <= x <= max(xs) + 0.1 and min(ys) <= y <= max(ys)):
        return False
    polar = [k for k in (2, 3, 0, 1) if grid.latlon and ys[k] > 89.999]
    if polar:
        k = polar[0]
        before, after = corners[k - 1], corners[(k + 1) % 4]
        corners = [*corners[:k], (before[0], ys[k]), (after[0], ys[k]), *corners[k + 1 :]]
    on_line = [0.0] * 5 if polar else [-0.5, 0.5, 0.5, -0.5]
    centre = corners[0][0]
    points = [(modulo(cx, centre, grid.period), cy) for cx, cy in corners]
    x = modulo(x, centre, grid.period)
    p = []
    for k, (xk, yk) in enumerate(points):
        xn, yn = points[(k + 1) % len(points)]
        side = (x - xk) * (yn - yk) - (y - yk) * (xn - xk)
        p.append(on_line[k] if side == 0.0 else math.copysign(1.0, side))
    return sum(map(abs, p)) - abs(sum(p)) < 0.5 if polar else sum(map(abs, p)) == abs(sum(p))


def inverse_bilinear(x, y, corners, period):
    """(xi, eta) by the formulas of equations 2.5 as they stand."""
    (x1, y1), (x2, y2), (x3, y3), (x4, y4) = corners
    alpha, delta, beta, epsilon = x2 - x1, y2 - y1, x4 - x1, y4 - y1
    gamma, kappa = (x3 - x1) - (alpha + beta), (y3 - y1) - (delta + epsilon)
    dx, dy = modulo(x, x1, period) - x1, y - y1
    a, c = kappa * beta - gamma * epsilon, alpha * dy - delta * dx
    b = (delta * beta - alpha * epsilon) - (kappa * dx - gamma * dy)
    if abs(a) > 1e-12:
        root = math.sqrt(b * b / 4 - a * c)
        roots = [-(b / 2 + root) / a, -(b / 2 - root) / a]
        # Not in the equations: eta = 1 solves every triangle with its tip in the north, and is then not wanted.
        if math.hypot(x4 - x3, y4 - y3) == 0.0:
            roots.remove(min(roots, key=lambda value: abs(value - 1.0)))
        eta = min(roots, key=lambda value: abs(value - 0.5))
    else:
        eta = -c / b if b != 0 else 0.0
    a2, b2 = alpha + gamma * eta, delta + kappa * eta
    if a2 != 0:
        return (dx - beta * eta) / a2, eta
    if b2 != 0:
        return (dy - epsilon * eta) / b2, eta
    return (epsilon * dx - beta * dy) / ((epsilon * alpha - beta * delta) + (epsilon * gamma - beta * kappa) * eta), eta


def plane(lon, lat):
    """Map to the plane (90 - lat)(cos lon, sin lon) of equations 2.5."""
    return (90 - lat) * math.cos(math.radians(lon)), (90 - lat) * math.sin(math.radians(lon))


def position(grid, x, y, i, j):
    """pos_within_cell, equations 2.5: (xi, eta, flag)."""
    flag, corners = in_cell(grid, x, y, i, j), grid.corners(i, j)
    if grid.regular and not grid.latlon:
        hx = abs(grid.at("lon", i, j) - grid.at("lon", i - 1, j))
        hy = abs(grid.at("lat", i, j) - grid.at("lat", i, j - 1))
        xc, yc = grid.at("lon", i, j) - hx / 2, grid.at("lat", i, j) - hy / 2
        return (modulo(x, xc, grid.period) - xc) / hx + 0.5, (y - yc) / hy + 0.5, flag
    if not (grid.latlon and max(cy for _, cy in corners) >= 89.999):
        return (*inverse_bilinear(x, y, corners, grid.period), flag)
    xi, eta = inverse_bilinear(*plane(x, y), [plane(*c) for c in corners], 0.0)
    if flag and not (0 <= xi < 1 and 0 <= eta < 1):
        shrink = max(1, 2.1 * max(abs(xi - 0.5), abs(eta - 0.5)))
        xi, eta = (xi - 0.5) / shrink + 0.5, (eta - 0.5) / shrink + 0.5
    return xi, eta, flag


def bilinear(grid, field, i, j, xi, eta):
    """Bilinear value of a corner field, equations 3.2."""
    ne, nw = grid.of_field(field, i, j), grid.of_field(field, i - 1, j)
    se, sw = grid.of_field(field, i, j - 1), grid.of_field(field, i - 1, j - 1)
    return (ne * xi + nw * (1 - xi)) * eta + (se * xi + sw * (1 - xi)) * (1 - eta)


def clipped(value):
    """5 % inside where outside."""
    return 0.95 if value >= 1 else 0.05 if value < 0 else value


def adjust(grid, x, y, i, j):
    """adjust_index_and_ground, equations 8.1: (x, y, i, j, xi, eta, bounced)."""
    xi, eta, flag = position(grid, x, y, i, j)
    if flag:
        return x, y, i, j, xi, eta, False
    west, east, south, north = grid.limits()
    bounced = False
    for _ in range(4):
        if xi < 0 and i > west:
            if grid.at("mask", i - 1, j) > 0:
                i -= 1 if i > west + 1 else 0
            else:
                bounced = True
        elif xi >= 1 and i < east:
            if grid.at("mask", i + 1, j) > 0:
                i += 1
            else:
                bounced = True
        if eta < 0 and j > south:
            if grid.at("mask", i, j - 1) > 0:
                j -= 1 if j > south + 1 else 0
            else:
                bounced = True
        elif eta >= 1 and j < north:
            if grid.at("mask", i, j + 1) > 0:
                j += 1
            else:
                bounced = True
        if bounced:
            xi, eta = clipped(xi), clipped(eta)
            x, y = (bilinear(grid, grid.data[q], i, j, xi, eta) for q in ("lon", "lat"))
        xi, eta, flag = position(grid, x, y, i, j)
        if flag:
            break
    if flag and not bounced and grid.at("mask", i, j) > 0:
        return x, y, i, j, xi, eta, False
    xi = clipped(xi)
    eta = 0.95 if eta > 1 else 0.05 if eta <= 0 else eta
    x, y = (bilinear(grid, grid.data[q], i, j, xi, eta) for q in ("lon", "lat"))
    return (x, y, i, j, *position(grid, x, y, i, j)[:2], bounced)


def scan(grid, x, y, ni, nj):
    """All cells of the domain that hold a point."""
    return [(i, j) for j in range(1, nj + 1) for i in range(1, ni + 1) if in_cell(grid, x, y, i, j)]


def great_circle(lon1, lat1, lon2, lat2, radius):
    """Distance by the angle between two unit vectors, not by the haversine."""
    a, b = (
        np.array([math.cos(p) * math.cos(q), math.cos(p) * math.sin(q), math.sin(p)])
        for p, q in ((math.radians(lat1), math.radians(lon1)), (math.radians(lat2), math.radians(lon2)))
    )
    return radius * math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
