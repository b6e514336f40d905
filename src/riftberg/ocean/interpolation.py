"""Fields at the elements: bilinear currents and wind, slope of the sea surface, depth, drift near land (equations 3.2)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.physics.geometry import Point, bilinear, inverse_bilinear, wrap_around
from riftberg.state import Elements, Floats, Ints, Place

if TYPE_CHECKING:
    from riftberg.ocean.cells import Fields, GridArrays

DEPTH_OF_CELL = 0
"""Depth rule: one depth for the whole cell (quirk Q19)."""

DEPTH_BIQUADRATIC = 1
"""Depth rule: biquadratic in 3 x 3 cells (quirk Q20)."""

DEPTH_ZONE = 2
"""Depth rule: nothing but a dry quadrant north-east of a point (quirk Q18)."""

ZONE_DEPTH = 1000.0
"""Depth outside the dry quadrant, m (equations 3.2)."""


@kernel
def _face_slope(before: float, after: float, wet: float, span: float) -> float:
    """Slope at a face between two cells; exactly 0 next to land, whatever stands there."""
    return 2.0 * (after - before) / span * wet if wet != 0.0 else 0.0


@kernel
def _slope_x(ssh: Floats, mask: Floats, dx: Floats, i: int, j: int) -> float:
    """Slope at the east face of a cell."""
    span = 0.5 * (dx[j, i] + dx[j - 1, i]) + 0.5 * (dx[j, i + 1] + dx[j - 1, i + 1])
    return _face_slope(ssh[j, i], ssh[j, i + 1], mask[j, i + 1] * mask[j, i], span)


@kernel
def _slope_y(ssh: Floats, mask: Floats, dy: Floats, i: int, j: int) -> float:
    """Slope at the north face of a cell."""
    span = 0.5 * (dy[j, i] + dy[j, i - 1]) + 0.5 * (dy[j + 1, i] + dy[j + 1, i - 1])
    return _face_slope(ssh[j, i], ssh[j + 1, i], mask[j + 1, i] * mask[j, i], span)


@kernel
def sea_surface_slope(
    ssh: Floats, mask: Floats, dx: Floats, dy: Floats, i: int, j: int, xi: float, eta: float
) -> tuple[float, float]:
    """Return the slope of the sea surface along the axes of the grid (equations 3.2).

    Slopes at cell faces, 0 where the face touches land, are interpolated to (xi, eta).
    """
    # Faces lie at the middles of the sides: the point is between those of its own row of cells and of the next.
    row = j if eta >= 0.5 else j - 1
    north = eta - 0.5 if eta >= 0.5 else eta + 0.5
    east_x = north * _slope_x(ssh, mask, dx, i, row + 1) + (1.0 - north) * _slope_x(ssh, mask, dx, i, row)
    west_x = north * _slope_x(ssh, mask, dx, i - 1, row + 1) + (1.0 - north) * _slope_x(ssh, mask, dx, i - 1, row)
    column = i if xi >= 0.5 else i - 1
    east = xi - 0.5 if xi >= 0.5 else xi + 0.5
    north_y = east * _slope_y(ssh, mask, dy, column + 1, j) + (1.0 - east) * _slope_y(ssh, mask, dy, column, j)
    south_y = east * _slope_y(ssh, mask, dy, column + 1, j - 1) + (1.0 - east) * _slope_y(ssh, mask, dy, column, j - 1)
    return xi * east_x + (1.0 - xi) * west_x, eta * north_y + (1.0 - eta) * south_y


@kernel
def _stencil_start(index: int, halo: int, position: float, even_parity: bool) -> int:
    """First of three cells of the depth stencil along one axis; anchors are odd cells of the reference (quirk Q20)."""
    parity = 0 if even_parity else 1
    # Cells of the reference are counted from 1, without halo.
    if (index - halo + 1) % 2 == parity:
        return index if position >= 0.5 else index - 2
    return index - 1


@kernel
def _lagrange(s: float) -> tuple[float, float, float]:
    return 0.5 * s * (s - 1.0), (1.0 + s) * (1.0 - s), 0.5 * s * (s + 1.0)


@kernel
def _stencil_position(
    x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, boxes: bool, period: float
) -> tuple[float, float]:
    """Position in [-1, 1]2 between the centres of the outer cells of the stencil that starts at (i, j)."""
    if boxes:
        width, height = abs(lon[j + 2, i + 2] - lon[j + 2, i]), abs(lat[j + 2, i + 2] - lat[j, i + 2])
        xc, yc = lon[j + 2, i + 2] - 0.5 * width, lat[j + 2, i + 2] - 0.5 * height
        xi = (wrap_around(x, xc, period) - xc) / width + 0.5
        eta = (y - yc) / height + 0.5
    else:
        xi, eta = inverse_bilinear(
            x, y, period, (lon[j, i], lat[j, i]), (lon[j, i + 2], lat[j, i + 2]),
            (lon[j + 2, i + 2], lat[j + 2, i + 2]), (lon[j + 2, i], lat[j + 2, i]),
        )  # fmt: skip
    return 2.0 * xi - 1.0, 2.0 * eta - 1.0


@kernel
def biquadratic_depth(
    depth: Floats, ssh: Floats, lon: Floats, lat: Floats, boxes: bool, period: float, anchor: tuple[int, bool],
    point: Point, cell: tuple[int, int], place: Point,
) -> float:  # fmt: skip
    """Return the biquadratic depth of water (m) at a point: sea floor plus sea level (equations 3.2).

    ``depth``, ``ssh``: depth of the floor and sea level at cell centres, m; ``lon``, ``lat``: cell centres, degrees or m;
    ``anchor``: width of the halo in cells, and whether stencils are anchored at even cells; ``cell``: column and row of the
    point, ``place``: its position there, 0 to 1.
    """
    halo, even_parity = anchor
    i0 = _stencil_start(cell[0], halo, place[0], even_parity)
    j0 = _stencil_start(cell[1], halo, place[1], even_parity)
    s, t = _stencil_position(point[0], point[1], i0, j0, lon, lat, boxes, period)
    a0, a1, a2 = _lagrange(s)
    b0, b1, b2 = _lagrange(t)
    total = 0.0
    for row in range(3):
        j = j0 + row
        south = a0 * (depth[j, i0] + ssh[j, i0])
        middle = a1 * (depth[j, i0 + 1] + ssh[j, i0 + 1])
        line = south + middle + a2 * (depth[j, i0 + 2] + ssh[j, i0 + 2])
        total += (b0 if row == 0 else (b1 if row == 1 else b2)) * line
    return total


@kernel
def zone_depth(x: float, y: float, zone_lon: float, zone_lat: float, latlon: bool) -> float:
    """Return 0 in the quadrant north-east of (zone_lon, zone_lat), else 1000 m (equations 3.2, quirk Q18).

    The reference compares with ``zone_lon + 360``; here the image of ``zone_lon`` next to ``x`` is taken, which is
    the same for a grid in 0 ... 360 degrees and right for one in -180 ... 180.
    """
    east_of = wrap_around(zone_lon, x, 360.0) if latlon else zone_lon
    return 0.0 if x > east_of and y > zone_lat else ZONE_DEPTH


@kernel
def coastal_increment(mask: Floats, i: int, j: int, speed: float) -> tuple[float, float]:
    """Return the current (m s-1) that drives an element in cell (i, j) away from neighbouring land (equations 3.2)."""
    here = mask[j, i]
    return speed * (mask[j, i + 1] - mask[j, i - 1]) * here, speed * (mask[j + 1, i] - mask[j - 1, i]) * here


@kernel
def corner_vorticity(u: Floats, v: Floats, dx: Floats, dy: Floats, i: int, j: int, xi: float, eta: float) -> float:
    """Return dv/dx - du/dy (s-1) of a corner field at (xi, eta) of a cell."""
    north = (v[j, i] - v[j, i - 1]) / dx[j, i]
    south = (v[j - 1, i] - v[j - 1, i - 1]) / dx[j - 1, i]
    east = (u[j, i] - u[j - 1, i]) / dy[j, i]
    west = (u[j, i - 1] - u[j - 1, i - 1]) / dy[j, i - 1]
    return (north * eta + south * (1.0 - eta)) - (east * xi + west * (1.0 - xi))


@kernel
def _finite_or_zero(x: float) -> float:
    return 0.0 if math.isnan(x) else x


@kernel
def _find_turns(
    i: Ints, j: Ints, xi: Floats, eta: Floats, cos: Floats, sin: Floats, mirrored: bool, c: Floats, s: Floats
) -> None:
    """Find cosine and sine of the angle by which the grid is turned at all elements."""
    for n in range(i.size):
        x, y = (1.0 - xi[n], 1.0 - eta[n]) if mirrored else (xi[n], eta[n])
        c[n], s[n] = bilinear(cos, i[n], j[n], x, y), bilinear(sin, i[n], j[n], x, y)


@kernel
def _fill_vectors(
    place: Place, u: Floats, v: Floats, c: Floats, s: Floats, mask: Floats, drift: float, mirrored: bool, east: Floats,
    north: Floats,
) -> None:  # fmt: skip
    """Interpolate a corner field to all elements, add the drift away from land, turn it to east and north."""
    i, j, xi, eta = place.cell_i, place.cell_j, place.xi, place.eta
    for n in range(i.size):
        column, row = i[n], j[n]
        x, y = (1.0 - xi[n], 1.0 - eta[n]) if mirrored else (xi[n], eta[n])
        along, across = bilinear(u, column, row, x, y), bilinear(v, column, row, x, y)
        # Land is seen along the rows of the grid, so the drift is added before the vector is turned.
        if drift > 0.0:
            du, dv = coastal_increment(mask, column, row, drift)
            along, across = along + du, across + dv
        east[n], north[n] = c[n] * along + s[n] * across, c[n] * across - s[n] * along


@kernel
def _fill_slopes(
    place: Place, ssh: Floats, mask: Floats, dx: Floats, dy: Floats, c: Floats, s: Floats, east: Floats, north: Floats
) -> None:
    i, j, xi, eta = place.cell_i, place.cell_j, place.xi, place.eta
    for n in range(i.size):
        along, across = sea_surface_slope(ssh, mask, dx, dy, i[n], j[n], xi[n], eta[n])
        # Beside gaps in the sea level the surface counts as flat.
        east[n] = _finite_or_zero(c[n] * along + s[n] * across)
        north[n] = _finite_or_zero(c[n] * across - s[n] * along)


@kernel
def _fill_vorticity(
    i: Ints, j: Ints, xi: Floats, eta: Floats, u: Floats, v: Floats, dx: Floats, dy: Floats, out: Floats
) -> None:
    for n in range(i.size):
        out[n] = corner_vorticity(u, v, dx, dy, i[n], j[n], xi[n], eta[n])


@kernel
def _fill_from_cells(i: Ints, j: Ints, field: Floats, out: Floats) -> None:
    for n in range(i.size):
        out[n] = field[j[n], i[n]]


class Points(NamedTuple):
    """Points on a grid."""

    x: Floats  # Degrees or m
    y: Floats
    i: Ints  # Array column and row of the cell
    j: Ints
    xi: Floats  # Position in the cell
    eta: Floats


class DepthAtPoint(NamedTuple):
    """How the depth at a point follows from that of cells."""

    rule: int  # `DEPTH_OF_CELL`, `DEPTH_BIQUADRATIC` or `DEPTH_ZONE`
    zone_lon: float  # South-west point of the dry quadrant, degrees, for `DEPTH_ZONE`
    zone_lat: float
    even_parity: bool  # Anchors of the stencil are even cells, for `DEPTH_BIQUADRATIC`


@kernel
def fill_depth(points: Points, grid: GridArrays, depth: Floats, ssh: Floats, how: DepthAtPoint, out: Floats) -> None:
    """Fill the depth of water (m) at many points by one of the three rules (equations 3.2); ``i`` < 0 is left alone."""
    # Out of the tuples before the loop, where each access would count references.
    x, y, i, j, xi, eta = points
    rule, zone_lon, zone_lat, even_parity = how
    lon, lat, boxes = grid.lon_centre, grid.lat_centre, grid.regular and not grid.latlon
    period, halo, latlon = grid.period, grid.halo, grid.latlon
    for n in range(i.size):
        if i[n] < 0:
            continue
        if rule == DEPTH_ZONE:
            out[n] = zone_depth(x[n], y[n], zone_lon, zone_lat, latlon)
        elif rule == DEPTH_BIQUADRATIC:
            out[n] = biquadratic_depth(
                depth, ssh, lon, lat, boxes, period, (halo, even_parity), (x[n], y[n]), (i[n], j[n]), (xi[n], eta[n])
            )
        else:
            out[n] = depth[j[n], i[n]] + ssh[j[n], i[n]]


@kernel
def sample_gridded(
    elements: Elements, grid: GridArrays, fields: Fields, how: DepthAtPoint, coastal_drift: float, mirrored: bool
) -> None:
    """Fill the environment of all elements, ``uo`` to ``vorticity`` (equations 3.2).

    ``coastal_drift``: speed of the drift away from land, m s-1.
    """
    # Each part is a loop of its own over bare arrays: handing the tuples of arrays to a helper for every element would
    # count references to seventy arrays each time.
    place, environment, f, g = elements.place, elements.environment, fields, grid
    i, j, xi, eta = place.cell_i, place.cell_j, place.xi, place.eta
    c, s = np.empty(i.size), np.empty(i.size)
    _find_turns(i, j, xi, eta, g.cos_angle, g.sin_angle, mirrored, c, s)
    _fill_vectors(place, f.uo, f.vo, c, s, g.mask, coastal_drift, mirrored, environment.uo, environment.vo)
    _fill_vectors(place, f.ui, f.vi, c, s, g.mask, coastal_drift, mirrored, environment.ui, environment.vi)
    _fill_vectors(place, f.ua, f.va, c, s, g.mask, 0.0, mirrored, environment.ua, environment.va)
    _fill_slopes(place, f.ssh, g.mask, g.dx, g.dy, c, s, environment.slope_x, environment.slope_y)
    _fill_vorticity(i, j, xi, eta, f.uo, f.vo, g.dx, g.dy, environment.vorticity)
    _fill_from_cells(i, j, f.sst, environment.sst)
    _fill_from_cells(i, j, f.sss, environment.sss)
    _fill_from_cells(i, j, f.ice_fraction, environment.ice_fraction)
    _fill_from_cells(i, j, f.ice_thickness, environment.ice_thickness)
    fill_depth(Points(place.lon, place.lat, i, j, xi, eta), g, f.depth, f.ssh, how, environment.depth)


@kernel
def blend_around(
    cell_i: Ints, cell_j: Ints, margin: int, first: Fields, second: Fields, weights: Floats, out: Fields
) -> None:
    """Blend two states in time into ``out``, only in the box of cells around the elements."""
    rows, columns = first.uo.shape
    south, north, west, east = 0, rows, 0, columns
    if cell_i.size > 0:
        south, north = max(cell_j.min() - margin, 0), min(cell_j.max() + margin + 1, rows)
        west, east = max(cell_i.min() - margin, 0), min(cell_i.max() + margin + 1, columns)
    for k in range(len(first)):
        w = weights[k]
        # Held until the next record, or the same array in both.
        if w < 0.0:
            continue
        before, after, between = first[k], second[k], out[k]
        for j in range(south, north):
            for i in range(west, east):
                between[j, i] = (1.0 - w) * before[j, i] + w * after[j, i]


@kernel
def points_from_corners(
    u: Floats, v: Floats, i: Ints, j: Ints, xi: Floats, eta: Floats, grid: GridArrays, east: Floats, north: Floats
) -> None:
    """Fill eastward and northward values of a corner field at many points; points with ``i`` < 0 are left alone."""
    for n in range(i.size):
        if i[n] >= 0:
            c = bilinear(grid.cos_angle, i[n], j[n], xi[n], eta[n])
            s = bilinear(grid.sin_angle, i[n], j[n], xi[n], eta[n])
            along, across = bilinear(u, i[n], j[n], xi[n], eta[n]), bilinear(v, i[n], j[n], xi[n], eta[n])
            east[n], north[n] = c * along + s * across, c * across - s * along
