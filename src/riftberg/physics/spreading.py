"""How an element covers the cells of an ocean grid: shares of its mass and area, exact or by the rules of the reference.

A footprint is a point, a rectangle or a hexagon that lies any way round. Its share of a cell is the area of their
intersection over the area of the footprint, in the plane that touches the Earth at the element. What falls on land or
beyond a closed end goes to the wet cells that the footprint covers, so that the shares always sum to one. The rules of
the reference (files 4.2, 4.3) know a berg by its place in its own cell alone, and give to the eight cells around it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.elementary import atan2, cos, sin
from riftberg.physics.geometry import metres_per_unit, nearest_image

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

POINT = 0
RECTANGLE = 1
HEXAGON = 2


class Cells(NamedTuple):
    """Cells of a grid, as footprints need them; `riftberg.ocean.cells.GridArrays` says more."""

    lon: Floats  # North-east corners with halo, degrees or m
    lat: Floats
    mask: Floats  # 1 ocean, 0 land
    ni: int
    nj: int
    halo: int
    latlon: bool
    cyclic: bool
    radius: float  # Of the sphere, m
    period: float


class ElementShapes(NamedTuple):
    """Where elements lie, and their shapes."""

    lon: Floats  # Centre, degrees or m
    lat: Floats
    i: Ints  # Its cell, array column and row
    j: Ints
    shape: int  # `POINT`, `RECTANGLE` or `HEXAGON`, of all
    length: Floats  # Sides, m
    width: Floats
    angle: Floats  # From east to the axis, counter-clockwise, rad


POLAR_LATITUDE = 80.0
"""Latitude (degrees) beyond which parallels curve across a berg and meridians converge."""

_ROOM = 16
"""Corners that an intersection of a quadrilateral and a hexagon may have, and some to spare."""


@kernel
def footprint(shape: int, length: float, width: float, angle: float, px: Floats, py: Floats) -> int:
    """Write the corners of a footprint around the origin, counter-clockwise; return their number.

    A rectangle has ``length`` along its axis; a hexagon has the area ``length * width`` and one flat side across its axis.

    Parameters
    ----------
    shape : int
        `POINT`, `RECTANGLE` or `HEXAGON`.
    length, width : float
        Sides of the element, m.
    angle : float
        From east to the axis, counter-clockwise, rad.
    px, py : ndarray
        Room for six corners, m.
    """
    if shape == POINT:
        return 0
    c, s = cos(angle), sin(angle)
    if shape == RECTANGLE:
        for k in range(4):
            along = 0.5 * length if k == 0 or k == 3 else -0.5 * length
            across = 0.5 * width if k < 2 else -0.5 * width
            px[k], py[k] = c * along - s * across, s * along + c * across
        return 4
    corner = _corner_of_hexagon(length * width)
    for k in range(6):
        turn = angle + (k + 0.5) * math.pi / 3.0
        px[k], py[k] = corner * cos(turn), corner * sin(turn)
    return 6


@kernel
def _corner_of_hexagon(area: float) -> float:
    """How far the corners of a hexagon lie from its middle, m."""
    return math.sqrt(area / (1.5 * math.sqrt(3.0)))


@kernel
def _farthest(shape: int, length: float, width: float) -> float:
    """How far the corners of a footprint lie from the element, m."""
    if shape == RECTANGLE:
        return 0.5 * math.sqrt(length * length + width * width)
    return _corner_of_hexagon(length * width)


@kernel
def polygon_area(x: Floats, y: Floats, n: int) -> float:
    """Area of a polygon by the sum of its cross products, about its first corner; positive counter-clockwise."""
    total = 0.0
    for k in range(1, n - 1):
        total += (x[k] - x[0]) * (y[k + 1] - y[0]) - (x[k + 1] - x[0]) * (y[k] - y[0])
    return 0.5 * total


@kernel
def _cut(x: Floats, y: Floats, n: int, ax: float, ay: float, bx: float, by: float, out_x: Floats, out_y: Floats) -> int:
    """Keep the part of a polygon that lies left of the line a -> b; return its number of corners."""
    kept = 0
    for k in range(n):
        k2 = k + 1 if k + 1 < n else 0
        here = (bx - ax) * (y[k] - ay) - (by - ay) * (x[k] - ax)
        there = (bx - ax) * (y[k2] - ay) - (by - ay) * (x[k2] - ax)
        if here >= 0.0:
            out_x[kept], out_y[kept] = x[k], y[k]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            part = here / (here - there)
            out_x[kept], out_y[kept] = x[k] + part * (x[k2] - x[k]), y[k] + part * (y[k2] - y[k])
            kept += 1
    return kept


@kernel
def overlap_area(qx: Floats, qy: Floats, px: Floats, py: Floats, corners: int, room: Floats) -> float:
    """Area (m2) that a quadrilateral and a convex footprint have in common.

    The quadrilateral is cut along each side of the footprint in turn (Sutherland and Hodgman 1974); it may have any
    shape, since edges that the cutting leaves twice enclose no area.

    Parameters
    ----------
    qx, qy : ndarray
        Four corners of the cell, either way round.
    px, py : ndarray
        Corners of the footprint, counter-clockwise.
    corners : int
        How many.
    room : ndarray, shape (4, 16)
        Scratch.
    """
    n = 4
    for k in range(4):
        room[0, k], room[1, k] = qx[k], qy[k]
    a = 0
    for k in range(corners):
        k2 = k + 1 if k + 1 < corners else 0
        b = 2 - a
        n = _cut(room[a], room[a + 1], n, px[k], py[k], px[k2], py[k2], room[b], room[b + 1])
        a = b
        if n < 3:
            return 0.0
    return abs(polygon_area(room[a], room[a + 1], n))


@kernel
def _in_plane(
    lon: float, lat: float, lon0: float, lat0: float, latlon: bool, radius: float, period: float
) -> tuple[float, float]:
    """Place (m) of a point in the plane that touches the Earth at another."""
    # Orthographic near the poles. Elsewhere parallels are straight: cells may be wide, and their sides are drawn as chords.
    if latlon and abs(lat0) > POLAR_LATITUDE:
        east, north, north0 = (lon - lon0) * DEGREE, lat * DEGREE, lat0 * DEGREE
        c, s = cos(north), sin(north)
        y = cos(north0) * s - sin(north0) * c * cos(east)
        return radius * (c * sin(east)), radius * y
    mx, my = metres_per_unit(lat0, latlon, radius)
    return nearest_image(lon - lon0, period) * mx, (lat - lat0) * my


@kernel
def _cell_corners(i: int, j: int, g: Cells, lon0: float, lat0: float, qx: Floats, qy: Floats) -> None:
    """Write the corners of a cell (m) in the plane that touches the Earth at (lon0, lat0), counter-clockwise."""
    for k in range(4):
        row, column = (j - 1 if k < 2 else j), (i if k == 1 or k == 2 else i - 1)
        qx[k], qy[k] = _in_plane(g.lon[row, column], g.lat[row, column], lon0, lat0, g.latlon, g.radius, g.period)


@kernel
def _lies_within(lon0: float, lat0: float, i: int, j: int, g: Cells, reach: float) -> bool:
    """Whether a cell, its corners numbered as usual, surely holds all that is within ``reach`` (m) of a point.

    A cheap answer for most bergs, which are small: yes only where the cell is straight along meridians and parallels and the
    berg lies clear of its edges. What is no may be yes to a closer look.
    """
    lon, lat = g.lon, g.lat
    west, east, south, north = lon[j, i - 1], lon[j, i], lat[j - 1, i], lat[j, i]
    straight = (
        lon[j - 1, i - 1] == west and lon[j - 1, i] == east and lat[j - 1, i - 1] == south and lat[j, i - 1] == north
    )
    # Near the poles meridians are not parallel.
    if not straight or (g.latlon and abs(lat0) > POLAR_LATITUDE):
        return False
    mx, my = metres_per_unit(lat0, g.latlon, g.radius)
    far = 1.000001 * reach  # clear of the edges by more than round-off
    return (
        nearest_image(west - lon0, g.period) * mx < -far
        and nearest_image(east - lon0, g.period) * mx > far
        and (south - lat0) * my < -far
        and (north - lat0) * my > far
    )


@kernel
def _inside(qx: Floats, qy: Floats, reach: float) -> bool:
    """Whether the origin lies inside a convex cell, farther than ``reach`` from all of its sides."""
    turn = 1.0 if polygon_area(qx, qy, 4) > 0.0 else -1.0
    for k in range(4):
        k2 = (k + 1) % 4
        dx, dy = qx[k2] - qx[k], qy[k2] - qy[k]
        if turn * (dy * qx[k] - dx * qy[k]) <= reach * math.sqrt(dx * dx + dy * dy):
            return False
    return True


@kernel
def _ring(r: int, k: int) -> tuple[int, int]:
    """Offset (columns, rows) of cell number k of the square ring of cells at distance r."""
    if r == 0:
        return 0, 0
    side, step = k // (2 * r), k % (2 * r)
    if side == 0:
        return step - r, -r
    if side == 1:
        return r, step - r
    if side == 2:
        return r - step, r
    return -r, r - step


@kernel
def cover(berg: ElementShapes, e: int, g: Cells, cells: Ints, shares: Floats, start: int, scratch: Floats) -> int:
    """Find the cells under one footprint and its shares of them; return how many there are.

    Cells are looked at ring by ring around that of the centre, until a ring has nothing of the footprint. The shares are
    areas over the area on wet cells; what round-off leaves of one is added to the largest. A footprint without a wet
    cell stays whole in the cell of its centre.

    Parameters
    ----------
    berg : Footprints
        All footprints.
    e : int
        Number of this one.
    g : Cells
        The grid.
    cells, shares : ndarray
        Written from ``start`` on as far as they reach: flat indices into the arrays of the grid, and shares.
    start : int
        First place to write.
    scratch : ndarray, shape (8, 16)
        Room for corners.
    """
    lon0, lat0, i0, j0, columns = berg.lon[e], berg.lat[e], berg.i[e], berg.j[e], g.lon.shape[1]
    shape, length, width = berg.shape, berg.length[e], berg.width[e]
    if shape == POINT or _lies_within(lon0, lat0, i0, j0, g, _farthest(shape, length, width)):
        if start < cells.size:
            cells[start], shares[start] = j0 * columns + i0, 1.0
        return 1
    px, py, qx, qy, room = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4:8]
    n = footprint(shape, length, width, berg.angle[e], px, py)
    _cell_corners(i0, j0, g, lon0, lat0, qx, qy)
    reach = 0.0
    for k in range(n):
        reach = max(reach, math.sqrt(px[k] * px[k] + py[k] * py[k]))
    if n == 0 or _inside(qx, qy, reach):
        if start < cells.size:
            cells[start], shares[start] = j0 * columns + i0, 1.0
        return 1
    found, wet, largest, largest_area = 0, 0.0, start, 0.0
    for r in range(max(g.ni, g.nj)):
        any_here = 0.0
        for k in range(max(1, 8 * r)):
            di, dj = _ring(r, k)
            i, j = i0 + di, j0 + dj
            if g.cyclic:
                # A ring wider than the circle would meet cells a second time from the other side.
                if 2 * abs(di) > g.ni or (2 * abs(di) == g.ni and di < 0):
                    continue
                i = g.halo + (i - g.halo) % g.ni
            if j < g.halo or j >= g.halo + g.nj or i < g.halo or i >= g.halo + g.ni:
                continue
            _cell_corners(i, j, g, lon0, lat0, qx, qy)
            area = overlap_area(qx, qy, px, py, n, room)
            any_here += area
            if area <= 0.0 or g.mask[j, i] < 0.5:
                continue
            place = start + found
            if place < cells.size:
                cells[place], shares[place] = j * columns + i, area
                if area > largest_area:
                    largest, largest_area = place, area
            wet += area
            found += 1
        if any_here <= 0.0 and r > 0:
            break
    if found == 0 or wet <= 0.0:
        if start < cells.size:
            cells[start], shares[start] = j0 * columns + i0, 1.0
        return 1
    if start + found <= cells.size:
        total = 0.0
        for place in range(start, start + found):
            shares[place] /= wet
            total += shares[place]
        shares[largest] += 1.0 - total
    return found


@kernel
def cover_all(bergs: ElementShapes, grid: Cells, first: Ints, cells: Ints, shares: Floats) -> int:
    """Find cells and shares of many footprints, see `cover`; return how many pairs there are.

    ``first`` gets the place of the first pair of each footprint. Where ``cells`` is too short the number is right all
    the same: call again with that much room.
    """
    scratch = np.zeros((8, _ROOM))
    total = 0
    for e in range(bergs.lon.size):
        first[e] = total
        total += cover(bergs, e, grid, cells, shares, total, scratch)
    first[bergs.lon.size] = total
    return total


@kernel
def add_shares(first: Ints, cells: Ints, shares: Floats, amount: Floats, out: Floats) -> None:
    """Add an amount of each footprint to the cells that it covers; ``out`` is flat. Sums run in the order of the elements."""
    for e in range(amount.size):
        for k in range(first[e], first[e + 1]):
            out[cells[k]] += shares[k] * amount[e]


@kernel
def lattice_angle(
    first: Ints,
    second: Ints,
    status: Ints,
    dx: Floats,
    dy: Floats,
    folds: int,
    sums: Floats,
    own: Floats,
    angle: Floats,
) -> None:
    """Write the axis of each element (rad) from the directions of its unbroken bonds, alike after a turn by 2 pi / folds.

    ``angle = atan2(sum sin(n a), sum cos(n a)) / n`` with the directions ``a`` of the partners and ``n`` folds: a mean
    that knows no seam, of any bonds of a lattice. Elements without a bond keep ``own``.

    Parameters
    ----------
    first, second, status : ndarray
        Ends and state of the bonds.
    dx, dy : ndarray
        From the first to the second end, m.
    folds : int
        4 for squares, 6 for hexagons.
    sums : ndarray, shape (2, elements)
        Zeroed scratch.
    own : ndarray
        Axis of an element without bonds, rad.
    angle : ndarray
        Written.
    """
    for b in range(first.size):
        if status[b] == 0:
            # folds is even, so that the direction from the other end counts the same.
            turn = folds * atan2(dy[b], dx[b])
            c, s = cos(turn), sin(turn)
            for e in (first[b], second[b]):
                sums[0, e] += c
                sums[1, e] += s
    for e in range(angle.size):
        c, s = sums[0, e], sums[1, e]
        angle[e] = atan2(s, c) / folds if c * c + s * s > 1e-12 else own[e]


@kernel
def side_shares(x: float, reach: float) -> tuple[float, float, float]:
    """Shares of a berg to the west of its cell, in it and to the east of it, by the reference (files 4.2).

    Parameters
    ----------
    x : float
        Place in the cell, 0 to 1.
    reach : float
        Side of the berg in cells, at most 1.
    """
    left = min(0.5, max(0.0, 0.5 - x / reach))
    right = min(0.5, max(0.0, x / reach + (0.5 - 1.0 / reach)))
    return left, max(0.0, 1.0 - (left + right)), right


@kernel
def rectangle_shares(x: float, y: float, reach: float, mask: Floats, i: int, j: int, w: Floats) -> None:
    """Write the nine shares of a rectangular berg by the reference (files 4.2): row by row from the south-west.

    What is bound for land stays in the cell of the centre.
    """
    left, middle, right = side_shares(x, reach)
    down, centre, up = side_shares(y, reach)
    w[0] = down * left * mask[j - 1, i - 1]
    w[1] = down * middle * mask[j - 1, i]
    w[2] = down * right * mask[j - 1, i + 1]
    w[3] = centre * left * mask[j, i - 1]
    w[5] = centre * right * mask[j, i + 1]
    w[6] = up * left * mask[j + 1, i - 1]
    w[7] = up * middle * mask[j + 1, i]
    w[8] = up * right * mask[j + 1, i + 1]
    w[4] = 1.0 - (((w[0] + w[8]) + (w[2] + w[6])) + ((w[3] + w[5]) + (w[1] + w[7])))


@kernel
def quadrant_areas(
    apothem: float, x: float, y: float, degrees: float, scratch: Floats
) -> tuple[float, float, float, float, float]:
    """Areas of a hexagon in the quadrants (+, +), (-, +), (-, -), (+, -) of the origin, and its whole area.

    The hexagon has corners at ``(+-S, 0), (+-H / sqrt 3, +-H)``, turned clockwise by an angle, and its centre at (x, y)
    (files 4.3). The four areas sum to the whole.

    Parameters
    ----------
    apothem : float
        Radius H of the inscribed circle.
    x, y : float
        Centre.
    degrees : float
        Turn, clockwise.
    scratch : ndarray, shape (8, 16)
        Room for corners.
    """
    side = 2.0 * apothem / math.sqrt(3.0)
    c, s = cos(degrees * DEGREE), sin(degrees * DEGREE)
    hx, hy = scratch[0], scratch[1]
    for k in range(6):
        p, q = side * cos(k * math.pi / 3.0), side * sin(k * math.pi / 3.0)
        hx[k], hy[k] = (p * c + q * s) + x, (-p * s + q * c) + y
    whole = polygon_area(hx, hy, 6)
    areas = (
        _quadrant(hx, hy, 1.0, 1.0, scratch),
        _quadrant(hx, hy, -1.0, 1.0, scratch),
        _quadrant(hx, hy, -1.0, -1.0, scratch),
        _quadrant(hx, hy, 1.0, -1.0, scratch),
    )
    return areas[0], areas[1], areas[2], areas[3], whole


@kernel
def _quadrant(hx: Floats, hy: Floats, right: float, upper: float, scratch: Floats) -> float:
    """Area of a hexagon in one quadrant."""
    cx, cy, dx, dy = scratch[2], scratch[3], scratch[4], scratch[5]
    n = _cut(hx, hy, 6, 0.0, right, 0.0, -right, cx, cy)  # keeps x of the sign of `right`
    n = _cut(cx, cy, n, -upper, 0.0, upper, 0.0, dx, dy)
    return abs(polygon_area(dx, dy, n)) if n > 2 else 0.0


@kernel
def hexagon_shares(x: float, y: float, apothem: float, degrees: float, w: Floats, scratch: Floats) -> None:
    """Write the nine shares of a hexagonal berg by the reference (files 4.3): to the cells at its nearest corner.

    Land is not looked at here: see `wet_part`.

    Parameters
    ----------
    x, y : float
        Place in the cell, 0 to 1.
    apothem : float
        Radius of the inscribed circle, in cells.
    degrees : float
        Turn, clockwise.
    w : ndarray, shape (9,)
        Written, row by row from the south-west.
    scratch : ndarray, shape (8, 16)
        Room for corners.
    """
    east, north = (0 if x < 0.5 else 1), (0 if y < 0.5 else 1)
    q1, q2, q3, q4, whole = quadrant_areas(apothem, x - east, y - north, degrees, scratch)
    for k in range(9):
        w[k] = 0.0
    # The cell south-west of the corner is this one where the corner is the north-east one.
    sw = 3 * north + east
    w[sw], w[sw + 1], w[sw + 3], w[sw + 4] = q3 / whole, q4 / whole, q2 / whole, q1 / whole


@kernel
def wet_part(w: Floats, mask: Floats, i: int, j: int) -> float:
    """Part of a hexagonal berg over water by the reference, which divides by it (files 4.3).

    The cell of the centre counts with a power of its mask instead of a product: all of it on land (quirk T19).
    """
    total = 0.0
    for k in range(9):
        if k != 4:
            total += w[k] * mask[j + k // 3 - 1, i + k % 3 - 1]
    return total + w[4] ** mask[j, i]
