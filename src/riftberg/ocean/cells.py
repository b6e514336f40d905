"""The cells of a grid: which one holds a point, how elements move between them, and the fields at the elements.

Land stops elements, and periodic ends join. Currents and wind are bilinear; the slope of the sea surface, the depth and the drift
near land have rules of their own (equations 3.2).

Array indices are used throughout: the north-east corner of cell ``(i, j)`` is ``lon[j, i]``, its south-west corner
``lon[j - 1, i - 1]``. Row 0 and column 0 hold corners only. Source: equations 2.4, 2.5, 8.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.elementary import atan2, cos
from riftberg.physics.geometry import (
    Point,
    bilinear,
    blend_corners,
    edge_sign,
    in_pentagon,
    inverse_bilinear,
    polar_plane,
    wrap_around,
)
from riftberg.state import Elements, Floats, Ints, Place

if TYPE_CHECKING:
    from riftberg.parameters import KernelParameters


class GridArrays(NamedTuple):
    """What compiled code reads of a grid; 2-D arrays of shape (nj + 2 halo, ni + 2 halo)."""

    lon: Floats  # North-east corners, degrees or m
    lat: Floats  # North-east corners, degrees or m
    lon_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    lat_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    dx: Floats  # Length of the north edge, m
    dy: Floats  # Length of the east edge, m
    area: Floats  # Area of the cell, m2
    mask: Floats  # 1 ocean, 0 land
    cos_angle: Floats  # Turn of the grid at the corners: eastward = cos u + sin v, northward = cos v - sin u
    sin_angle: Floats
    ni: int  # Cells of the domain from west to east
    nj: int  # and from south to north
    halo: int  # Cells around it
    latlon: bool  # Whether positions are in degrees, not in m
    regular: bool  # Whether edges lie along the axes
    cyclic: bool  # Whether western and eastern end are joined
    # Zonal period of the coordinate, 0 or less if none. A regional grid in degrees has 360 without being cyclic
    period: float


class Fields(NamedTuple):
    """One state of ocean, air and ice on the grid; float64 arrays of the grid's full shape.

    ``uo vo ui vi ua va`` (m s-1) are values at north-east corners along the axes of the grid, the others of cells:
    ``ssh`` (m), ``sst`` (degree Celsius), ``sss`` (1e-3), ``ice_fraction`` (1), ``ice_thickness`` (m),
    ``depth`` of the sea floor below the geoid (m).
    """

    uo: Floats
    vo: Floats
    ui: Floats
    vi: Floats
    ua: Floats
    va: Floats
    ssh: Floats
    sst: Floats
    sss: Floats
    ice_fraction: Floats
    ice_thickness: Floats
    depth: Floats


CORNER_FIELDS = ("uo", "vo", "ui", "vi", "ua", "va")
"""Fields at north-east corners; all others are values of cells."""

ZERO_OUTSIDE = ("ua", "va", "ssh")
"""Fields that are 0 beyond a closed boundary (quirk Q23); the others repeat the outermost value."""

POLAR_LATITUDE = 89.999
"""Corners at or beyond this latitude (degrees) make a cell polar (equations 2.5)."""

BOX_MARGIN = 0.1
"""Margin in x, degrees or metres, of the quick box test (equations 2.5)."""

MAX_CELLS = 4
"""Cells that an element may cross in one long step (equations 8.1, quirk Q42)."""


@kernel
def _in_box(x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, period: float) -> bool:
    south = min(min(lat[j - 1, i - 1], lat[j - 1, i]), min(lat[j, i], lat[j, i - 1]))
    north = max(max(lat[j - 1, i - 1], lat[j - 1, i]), max(lat[j, i], lat[j, i - 1]))
    if y < south or y > north:
        return False
    x0 = wrap_around(lon[j - 1, i - 1], x, period)
    x1 = wrap_around(lon[j - 1, i], x, period)
    x2 = wrap_around(lon[j, i], x, period)
    x3 = wrap_around(lon[j, i - 1], x, period)
    if x < min(min(x0, x1), min(x2, x3)) - BOX_MARGIN:
        return False
    return x <= max(max(x0, x1), max(x2, x3)) + BOX_MARGIN


@kernel
def _in_quadrilateral(x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, period: float) -> bool:
    centre = lon[j - 1, i - 1]
    x0 = wrap_around(centre, centre, period)
    x1 = wrap_around(lon[j - 1, i], centre, period)
    x2 = wrap_around(lon[j, i], centre, period)
    x3 = wrap_around(lon[j, i - 1], centre, period)
    x = wrap_around(x, centre, period)
    y0, y1, y2, y3 = lat[j - 1, i - 1], lat[j - 1, i], lat[j, i], lat[j, i - 1]
    p0 = edge_sign(x, y, x0, y0, x1, y1, -0.5)
    p1 = edge_sign(x, y, x1, y1, x2, y2, 0.5)
    p2 = edge_sign(x, y, x2, y2, x3, y3, 0.5)
    p3 = edge_sign(x, y, x3, y3, x0, y0, -0.5)
    return abs(p0) + abs(p1) + abs(p2) + abs(p3) == abs(p0 + p1 + p2 + p3)


@kernel
def _in_polar_cell(x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, period: float) -> bool:
    """Cell test where a corner is the pole: that corner becomes a stretch of its parallel (equations 2.5)."""
    sw, se = (lon[j - 1, i - 1], lat[j - 1, i - 1]), (lon[j - 1, i], lat[j - 1, i])
    ne, nw = (lon[j, i], lat[j, i]), (lon[j, i - 1], lat[j, i - 1])
    if ne[1] > POLAR_LATITUDE:
        return in_pentagon(x, y, period, sw, se, (se[0], ne[1]), (nw[0], ne[1]), nw)
    if nw[1] > POLAR_LATITUDE:
        return in_pentagon(x, y, period, sw, se, ne, (ne[0], nw[1]), (sw[0], nw[1]))
    if sw[1] > POLAR_LATITUDE:
        return in_pentagon(x, y, period, (nw[0], sw[1]), (se[0], sw[1]), se, ne, nw)
    return in_pentagon(x, y, period, sw, (sw[0], se[1]), (ne[0], se[1]), ne, nw)


@kernel
def _northernmost(i: int, j: int, lat: Floats) -> float:
    return max(max(lat[j - 1, i - 1], lat[j - 1, i]), max(lat[j, i], lat[j, i - 1]))


@kernel
def contains(x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, latlon: bool, period: float) -> bool:
    """Whether a point lies in a cell; south and west edges belong to the cell, north and east do not (equations 2.5).

    ``x``, ``y``: longitude and latitude (degrees) or Cartesian position (m), any image of it.
    """
    if not _in_box(x, y, i, j, lon, lat, period):
        return False
    if latlon and _northernmost(i, j, lat) > POLAR_LATITUDE:
        return _in_polar_cell(x, y, i, j, lon, lat, period)
    return _in_quadrilateral(x, y, i, j, lon, lat, period)


@kernel
def _position_in_polar_cell(
    x: float, y: float, i: int, j: int, inside: bool, lon: Floats, lat: Floats
) -> tuple[float, float, bool]:
    sw, se = polar_plane(lon[j - 1, i - 1], lat[j - 1, i - 1]), polar_plane(lon[j - 1, i], lat[j - 1, i])
    ne, nw = polar_plane(lon[j, i], lat[j, i]), polar_plane(lon[j, i - 1], lat[j, i - 1])
    x, y = polar_plane(x, y)
    xi, eta = inverse_bilinear(x, y, 0.0, sw, se, ne, nw)
    if inside and (xi < 0.0 or xi >= 1.0 or eta < 0.0 or eta >= 1.0):
        # A parallel is an arc in the plane, the cell's edge a chord: points between them are drawn into the cell.
        shrink = max(1.0, 2.1 * max(abs(xi - 0.5), abs(eta - 0.5)))
        xi, eta = (xi - 0.5) / shrink + 0.5, (eta - 0.5) / shrink + 0.5
    return xi, eta, inside


@kernel
def locate_in_cell(
    x: float, y: float, i: int, j: int, lon: Floats, lat: Floats, latlon: bool, regular: bool, period: float
) -> tuple[float, float, bool]:
    """Body of `position_in_cell` on bare arrays: handing a tuple of arrays on counts references to each of them."""
    inside = contains(x, y, i, j, lon, lat, latlon, period)
    if regular and not latlon:
        height, width = abs(lat[j, i] - lat[j - 1, i]), abs(lon[j, i] - lon[j, i - 1])
        xc, yc = lon[j, i] - 0.5 * width, lat[j, i] - 0.5 * height
        return (wrap_around(x, xc, period) - xc) / width + 0.5, (y - yc) / height + 0.5, inside
    if latlon and _northernmost(i, j, lat) >= POLAR_LATITUDE:
        return _position_in_polar_cell(x, y, i, j, inside, lon, lat)
    xi, eta = inverse_bilinear(
        x, y, period,
        (lon[j - 1, i - 1], lat[j - 1, i - 1]), (lon[j - 1, i], lat[j - 1, i]),
        (lon[j, i], lat[j, i]), (lon[j, i - 1], lat[j, i - 1]),
    )  # fmt: skip
    return xi, eta, inside


@kernel
def position_in_cell(x: float, y: float, i: int, j: int, grid: GridArrays) -> tuple[float, float, bool]:
    """Return (xi, eta, inside): coordinates of a point in a cell, 0 at the south-west corner (equations 2.5).

    Points outside get coordinates outside [0, 1) that show in which direction they lie.
    """
    return locate_in_cell(x, y, i, j, grid.lon, grid.lat, grid.latlon, grid.regular, grid.period)


@kernel
def position_from_cell(xi: float, eta: float, i: int, j: int, grid: GridArrays) -> tuple[float, float]:
    """Return the point (x, y) at (xi, eta) in a cell: bilinear in the corner coordinates (equations 3.2, 8.1).

    In a polar cell the corners are blended in the polar plane, because the longitude of the pole means nothing.
    """
    lon, lat = grid.lon, grid.lat
    if not (grid.latlon and _northernmost(i, j, lat) >= POLAR_LATITUDE):
        return bilinear(lon, i, j, xi, eta), bilinear(lat, i, j, xi, eta)
    x1, y1 = polar_plane(lon[j - 1, i - 1], lat[j - 1, i - 1])
    x2, y2 = polar_plane(lon[j - 1, i], lat[j - 1, i])
    x3, y3 = polar_plane(lon[j, i], lat[j, i])
    x4, y4 = polar_plane(lon[j, i - 1], lat[j, i - 1])
    x, y = blend_corners(x3, x4, x2, x1, xi, eta), blend_corners(y3, y4, y2, y1, xi, eta)
    real = lon[j, i] if lat[j - 1, i - 1] >= POLAR_LATITUDE else lon[j - 1, i - 1]
    return wrap_around(atan2(y, x) / DEGREE, real, 360.0), 90.0 - math.hypot(x, y)


@kernel
def _step_index(position: float, index: int, last: int, behind: float, ahead: float) -> tuple[int, bool]:
    """Next index along one axis, and whether land is in the way; ``behind`` and ``ahead`` are masks."""
    if position < 0.0 and index > 0:
        if behind > 0.0:
            # Row and column 0 hold corners only, so the first cell has index 1.
            return max(index - 1, 1), False
        return index, True
    if position >= 1.0 and index < last:
        if ahead > 0.0:
            return index + 1, False
        return index, True
    return index, False


@kernel
def _neighbour(mask: Floats, i: int, j: int) -> float:
    if i < 0 or j < 0 or j >= mask.shape[0] or i >= mask.shape[1]:
        return 0.0
    return mask[j, i]


@kernel
def _inset_position(position: float, inset: float) -> float:
    if position >= 1.0:
        return 1.0 - inset
    return inset if position < 0.0 else position


@kernel
def adjust_cell(
    x: float, y: float, i: int, j: int, grid: GridArrays, inset: float
) -> tuple[float, float, int, int, float, float, bool]:
    """Move a point that may have left its cell into the right one; land stops it, velocity is untouched (equations 8.1).

    ``x``, ``y``: new position, degrees or m; ``inset``: how far inside the water land puts it back, as part of a cell.
    """
    xi, eta, inside = position_in_cell(x, y, i, j, grid)
    if inside:
        return x, y, i, j, xi, eta, False
    mask, bounced = grid.mask, False
    for _ in range(MAX_CELLS):
        last_j, last_i = mask.shape[0] - 1, mask.shape[1] - 1
        i, hit_x = _step_index(xi, i, last_i, _neighbour(mask, i - 1, j), _neighbour(mask, i + 1, j))
        j, hit_y = _step_index(eta, j, last_j, _neighbour(mask, i, j - 1), _neighbour(mask, i, j + 1))
        bounced = bounced or hit_x or hit_y
        if bounced:
            # After land was met the point goes back into the cell before the next one is looked for, as in the
            # reference.
            xi, eta = _inset_position(xi, inset), _inset_position(eta, inset)
            x, y = position_from_cell(xi, eta, i, j, grid)
        xi, eta, inside = position_in_cell(x, y, i, j, grid)
        if inside:
            break
    if inside and not bounced and mask[j, i] > 0.0:
        return x, y, i, j, xi, eta, False
    xi = _inset_position(xi, inset)
    # The reference compares eta otherwise than xi: exactly 1 stays, exactly 0 does not.
    eta = 1.0 - inset if eta > 1.0 else (inset if eta <= 0.0 else eta)
    x, y = position_from_cell(xi, eta, i, j, grid)
    xi, eta, inside = position_in_cell(x, y, i, j, grid)
    return x, y, i, j, xi, eta, bounced


@kernel
def settle_elements(elements: Elements, grid: GridArrays, params: KernelParameters) -> int:
    """Find the cell of every element at the end of a step, stop it at land, and wrap it in a periodic grid (equations 8).

    Elements with ``static`` >= 0.5 stay untouched. An element that left a cyclic domain comes back on the other side:
    ``lon`` and ``lon_pair`` change by exactly one period.
    """
    place, static, shown_x = elements.place, elements.body.static, elements.shown.lon_pair
    px, py, cell_i, cell_j, along, across = place.lon, place.lat, place.cell_i, place.cell_j, place.xi, place.eta
    stopped = 0
    lon, lat, latlon, regular, period = grid.lon, grid.lat, grid.latlon, grid.regular, grid.period
    first, behind = grid.halo, grid.halo + grid.ni
    for n in range(px.size):
        if static[n] >= 0.5:
            continue
        along[n], across[n], inside = locate_in_cell(
            px[n], py[n], cell_i[n], cell_j[n], lon, lat, latlon, regular, period
        )
        if inside:
            continue
        x, y, i, j, xi, eta, bounced = adjust_cell(px[n], py[n], cell_i[n], cell_j[n], grid, params.land_inset)
        stopped += bounced
        if grid.cyclic and (i < first or i >= behind):
            shift = grid.period if i < first else -grid.period
            i += grid.ni if i < first else -grid.ni
            x += shift
            # What other elements see of it moves by the same period, or the pair would be a world apart for one step.
            shown_x[n] += shift
        px[n], py[n], cell_i[n], cell_j[n], along[n], across[n] = x, y, i, j, xi, eta
    return stopped


@kernel
def round_trip(elements: Elements, grid: GridArrays) -> None:
    """Pass all positions through cell coordinates, with the round-off of the reference (equations 8.2, quirk Q40).

    ``lon`` and ``lat`` become the bilinear position at (``xi``, ``eta``), ``lon_pair`` and ``lat_pair`` change by the
    same amount, and (``xi``, ``eta``) are computed anew.
    """
    place, shown = elements.place, elements.shown
    for n in range(place.lon.size):
        i, j = place.cell_i[n], place.cell_j[n]
        x, y = position_from_cell(place.xi[n], place.eta[n], i, j, grid)
        shown.lon_pair[n] = x - (place.lon[n] - shown.lon_pair[n])
        shown.lat_pair[n] = y - (place.lat[n] - shown.lat_pair[n])
        place.lon[n], place.lat[n] = x, y
        place.xi[n], place.eta[n], _ = position_in_cell(x, y, i, j, grid)


COARSE = 16
"""Every so many cells stand in for the whole grid when a search looks for a place to start."""

MAX_WALK = 64
"""Steps after which a search gives up walking."""


@kernel
def _into_domain(i: int, grid: GridArrays) -> int:
    if grid.cyclic:
        return grid.halo + (i - grid.halo) % grid.ni
    return min(max(i, grid.halo), grid.halo + grid.ni - 1)


@kernel
def _guess_cell(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Cell that a point would have if the grid were evenly spaced; always inside the domain."""
    h, ni, nj = grid.halo, grid.ni, grid.nj
    west, south = grid.lon[h - 1, h - 1], grid.lat[h - 1, h - 1]
    width = (grid.lon[h - 1, h + ni - 1] - west) / ni
    height = (grid.lat[h + nj - 1, h - 1] - south) / nj
    # Limited, for a point far outside would overflow the whole numbers.
    column = min(max((wrap_around(x, west + 0.5 * width * ni, grid.period) - west) / width, -1e6), 1e6)
    row = min(max((y - south) / height, -1e6), 1e6)
    return _into_domain(h + math.floor(column), grid), min(max(h + math.floor(row), h), h + nj - 1)


@kernel
def _nearest_coarse_cell(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Cell whose centre is nearest to a point, among every `COARSE`-th cell in both directions."""
    h, lon, lat = grid.halo, grid.lon_centre, grid.lat_centre
    narrowing = cos(y * DEGREE) if grid.latlon else 1.0
    best, best_i, best_j = np.inf, h, h
    for j in range(h + min(COARSE, grid.nj) // 2, h + grid.nj, COARSE):
        for i in range(h + min(COARSE, grid.ni) // 2, h + grid.ni, COARSE):
            dx = (wrap_around(x, lon[j, i], grid.period) - lon[j, i]) * narrowing
            distance = dx * dx + (y - lat[j, i]) ** 2
            if distance < best:
                best, best_i, best_j = distance, i, j
    return best_i, best_j


@kernel
def _walk(x: float, y: float, i: int, j: int, stride: float, grid: GridArrays) -> tuple[int, int, bool]:
    """Follow the cell coordinates from cell to cell, at most ``stride`` cells at once, until the point is inside."""
    lon, lat, latlon, regular, period = grid.lon, grid.lat, grid.latlon, grid.regular, grid.period
    south, north = grid.halo, grid.halo + grid.nj - 1
    for _ in range(MAX_WALK):
        xi, eta, inside = locate_in_cell(x, y, i, j, lon, lat, latlon, regular, period)
        if inside:
            return i, j, True
        if math.isnan(xi) or math.isnan(eta):
            break
        next_i = _into_domain(i + math.floor(min(max(xi, -stride), stride)), grid)
        next_j = min(max(j + math.floor(min(max(eta, -stride), stride)), south), north)
        if next_i == i and next_j == j:
            break
        i, j = next_i, next_j
    return i, j, False


@kernel
def search_nearby(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Return the cell that holds a point as `find_cell` does, but (-1, -1) if walking through the grid fails.

    Starts from the cell of an evenly spaced grid, then from the nearest of a coarse choice of cells.
    """
    i, j = _guess_cell(x, y, grid)
    # First in one stride, which is exact on a regular grid; on a bent one from a place that is near, in small ones.
    i, j, cell = _walk(x, y, i, j, 1e6, grid)
    if not cell:
        i, j = _nearest_coarse_cell(x, y, grid)
        i, j, cell = _walk(x, y, i, j, 4.0, grid)
    return (i, j) if cell else (-1, -1)


@kernel
def find_cell(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Return array column and row of the domain's cell (no halo) that holds a point, or (-1, -1) (equations 2.5).

    Walks through the grid, and scans all cells if that fails.
    """
    i, j = search_nearby(x, y, grid)
    if i >= 0:
        return i, j
    h, lon, lat, latlon, period = grid.halo, grid.lon, grid.lat, grid.latlon, grid.period
    for row in range(h, h + grid.nj):
        for column in range(h, h + grid.ni):
            if contains(x, y, column, row, lon, lat, latlon, period):
                return column, row
    return -1, -1


@kernel
def locate_points(
    lon: Floats, lat: Floats, grid: GridArrays, thorough: bool, cell_i: Ints, cell_j: Ints, xi: Floats, eta: Floats
) -> None:
    """Fill cell and coordinates in the cell of many points; ``cell_i`` = -1 for points outside the domain."""
    h = grid.halo
    # Most points outside are seen by the box of the domain, which spares the search of all cells.
    domain = grid.lat[h - 1 : h + grid.nj, h - 1 : h + grid.ni]
    south, north = domain.min(), domain.max()
    columns = grid.lon[h - 1 : h + grid.nj, h - 1 : h + grid.ni]
    west, east = columns.min(), columns.max()
    # Around the pole cells lie at longitudes between those of their corners.
    all_longitudes = grid.cyclic or (grid.latlon and north > POLAR_LATITUDE)
    for n in range(lon.size):
        x, y = wrap_around(lon[n], 0.5 * (west + east), grid.period), lat[n]
        cell_i[n], cell_j[n], xi[n], eta[n] = -1, -1, np.nan, np.nan
        if not (south <= y <= north) or not (all_longitudes or west <= x <= east):
            continue
        i, j = find_cell(x, y, grid) if thorough else search_nearby(x, y, grid)
        if i >= 0:
            cell_i[n], cell_j[n] = i, j
            xi[n], eta[n], _ = position_in_cell(x, y, i, j, grid)


# Fields at the elements.

DEPTH_OF_CELL = 0
"""Depth rule: one depth for the whole cell (quirk Q19)."""

DEPTH_BIQUADRATIC = 1
"""Depth rule: biquadratic in 3 x 3 cells (quirk Q20)."""

DEPTH_ZONE = 2
"""Depth rule: nothing but a dry quadrant north-east of a point (quirk Q18)."""

ZONE_DEPTH = 1000.0
"""Depth outside the dry quadrant, m (equations 3.2)."""


@kernel
def _face_slope(first: float, second: float, wet: float, span: float) -> float:
    """Slope at a face between two cells; exactly 0 next to land, whatever stands there."""
    return 2.0 * (second - first) / span * wet if wet != 0.0 else 0.0


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
    point: Point, cell: tuple[int, int], position: Point,
) -> float:  # fmt: skip
    """Return the biquadratic depth of water (m) at a point: sea floor plus sea level (equations 3.2).

    ``depth``, ``ssh``: depth of the floor and sea level at cell centres, m; ``lon``, ``lat``: cell centres, degrees or m;
    ``anchor``: width of the halo in cells, and whether stencils are anchored at even cells; ``cell``: column and row of the
    point, ``position``: its position there, 0 to 1.
    """
    halo, even_parity = anchor
    i0 = _stencil_start(cell[0], halo, position[0], even_parity)
    j0 = _stencil_start(cell[1], halo, position[1], even_parity)
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
    """How the depth at a point follows from the depths of cells."""

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
        earlier, later, between = first[k], second[k], out[k]
        for j in range(south, north):
            for i in range(west, east):
                between[j, i] = (1.0 - w) * earlier[j, i] + w * later[j, i]


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
