"""Twin of the interpolation to elements, equations 3.2, one element at a time, with the own indices of the reference."""

from __future__ import annotations

import math

import numpy as np

from twins.cells import bilinear, inverse_bilinear, modulo


def slopes(grid, ssh, i, j, xi, eta):
    """Slope of the sea surface along the axes of the grid."""

    def at(name, a, b):
        return grid.at(name, a, b)

    def sx(a, b):
        d0, d1 = ((at("dx", c, b) + at("dx", c, b - 1)) / 2 for c in (a, a + 1))
        rise = grid.of_field(ssh, a + 1, b) - grid.of_field(ssh, a, b)
        return 2 * rise / (d0 + d1) * at("mask", a + 1, b) * at("mask", a, b)

    def sy(a, b):
        e0, e1 = ((at("dy", a, c) + at("dy", a - 1, c)) / 2 for c in (b, b + 1))
        rise = grid.of_field(ssh, a, b + 1) - grid.of_field(ssh, a, b)
        return 2 * rise / (e0 + e1) * at("mask", a, b + 1) * at("mask", a, b)

    def h(a):
        if eta >= 0.5:
            return (eta - 0.5) * sx(a, j + 1) + (1.5 - eta) * sx(a, j)
        return (eta + 0.5) * sx(a, j) + (0.5 - eta) * sx(a, j - 1)

    def k(b):
        if xi >= 0.5:
            return (xi - 0.5) * sy(i + 1, b) + (1.5 - xi) * sy(i, b)
        return (xi + 0.5) * sy(i, b) + (0.5 - xi) * sy(i - 1, b)

    return xi * h(i) + (1 - xi) * h(i - 1), eta * k(j) + (1 - eta) * k(j - 1)


def stencil(index, position, odd):
    """First index of the three cells: anchored at odd cells (even cells if not ``odd``)."""
    if index % 2 == odd:
        return index if position >= 0.5 else index - 2
    return index - 1


def depth(grid, field, x, y, i, j, xi, eta, odd=1):
    """Biquadratic Lagrange interpolation of a cell field."""
    i0, j0 = stencil(i, xi, odd), stencil(j, eta, odd)
    quad = [(i0, j0), (i0 + 2, j0), (i0 + 2, j0 + 2), (i0, j0 + 2)]
    corners = [(grid.at("lon_centre", a, b), grid.at("lat_centre", a, b)) for a, b in quad]
    if grid.regular and not grid.latlon:
        (x3, y3), (x4, _), (_, y2) = corners[2], corners[3], corners[1]
        wide, high = abs(x3 - x4), abs(y3 - y2)
        s = (modulo(x, x3 - wide / 2, grid.period) - (x3 - wide / 2)) / wide + 0.5
        t = (y - (y3 - high / 2)) / high + 0.5
    else:
        s, t = inverse_bilinear(x, y, corners, grid.period)
    s, t = 2 * s - 1, 2 * t - 1
    bs, bt = (np.array([q * (q - 1) / 2, (1 + q) * (1 - q), q * (q + 1) / 2]) for q in (s, t))
    values = np.array([[grid.of_field(field, i0 + a, j0 + b) for a in range(3)] for b in range(3)])
    return float(bt @ values @ bs)


def sample(
    grid, fields, x, y, i, j, xi, eta, *, coastal=0.0, tidal=(0.0, 0.0), mirrored=False, rule=0, zone=(0, 0), odd=1
):
    """Return all environment variables of one element as a dictionary."""
    wx, wy = (1 - xi, 1 - eta) if mirrored else (xi, eta)
    f = {name: bilinear(grid, getattr(fields, name), i, j, wx, wy) for name in ("uo", "vo", "ui", "vi", "ua", "va")}
    cos, sin = (bilinear(grid, grid.data[q], i, j, wx, wy) for q in ("cos_angle", "sin_angle"))

    def m(a, b):
        return grid.at("mask", a, b)

    rx, ry = tidal
    du = coastal * (m(i + 1, j) - m(i - 1, j)) * m(i, j)
    dv = coastal * (m(i, j + 1) - m(i, j - 1)) * m(i, j)
    du += (min(0, rx) * m(i - 1, j) + max(0, rx) * m(i + 1, j)) * (1 - m(i, j - 1) * m(i, j + 1)) * m(i, j)
    dv += (min(0, ry) * m(i, j - 1) + max(0, ry) * m(i, j + 1)) * (1 - m(i - 1, j) * m(i + 1, j)) * m(i, j)
    sx, sy = slopes(grid, fields.ssh, i, j, xi, eta)
    pairs = {
        ("uo", "vo"): (f["uo"] + du, f["vo"] + dv), ("ui", "vi"): (f["ui"] + du, f["vi"] + dv),
        ("ua", "va"): (f["ua"], f["va"]), ("slope_x", "slope_y"): (sx, sy),
    }  # fmt: skip
    out = {}
    for (east, north), (u, v) in pairs.items():
        out[east], out[north] = cos * u + sin * v, cos * v - sin * u
    for name in ("sst", "sss", "ice_fraction", "ice_thickness"):
        out[name] = grid.of_field(getattr(fields, name), i, j)
    water = fields.depth + fields.ssh
    if rule == 0:
        out["depth"] = grid.of_field(water, i, j)
    elif rule == 1:
        out["depth"] = depth(grid, water, x, y, i, j, xi, eta, odd)
    else:
        out["depth"] = 0.0 if x > zone[0] + 360 and y > zone[1] else 1000.0
    return out


def seed(i, j, ssh):
    """Seed of a cell for the tidal drift."""
    return i + 10000 * j + int(16384 * abs(math.sin(262144 * ssh)))


def mersenne_words(start, count):
    """Return the first 32-bit words of MT19937 seeded with one integer, from the published algorithm."""
    state = [start & 0xFFFFFFFF]
    for k in range(1, 624):
        state.append((1812433253 * (state[-1] ^ (state[-1] >> 30)) + k) & 0xFFFFFFFF)
    for k in range(624):
        y = (state[k] & 0x80000000) | (state[(k + 1) % 624] & 0x7FFFFFFF)
        state[k] = state[(k + 397) % 624] ^ (y >> 1) ^ (0x9908B0DF if y & 1 else 0)
    words = []
    for y in state[:count]:
        y ^= y >> 11
        y ^= (y << 7) & 0x9D2C5680
        y ^= (y << 15) & 0xEFC60000
        words.append(y ^ (y >> 18))
    return words
