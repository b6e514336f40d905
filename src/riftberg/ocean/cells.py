"""Where a point lies in a cell, which cell holds it, and how elements move between cells: land stops them, periodic ends join.

Array indices are used throughout: the north-east corner of cell ``(i, j)`` is ``lon[j, i]``, its south-west corner
``lon[j - 1, i - 1]``. Row 0 and column 0 hold corners only. Source: equations 2.4, 2.5, 8.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.geometry import (
    bilinear,
    blend_corners,
    edge_sign,
    in_pentagon,
    inverse_bilinear,
    polar_plane,
    wrap_around,
)
from riftberg.state import Elements, Floats, Ints

if TYPE_CHECKING:
    from riftberg.parameters import KernelParameters


class GridArrays(NamedTuple):
    """What compiled code reads of a grid; 2-D arrays of shape (nj + 2 halo, ni + 2 halo)."""

    lon: Floats  # North-east corners, degrees or m
    lat: Floats  # North-east corners, degrees or m
    lon_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    lat_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    dx: Floats  # Length of the north edge and of the east edge, m
    dy: Floats  # Length of the north edge and of the east edge, m
    area: Floats  # Area of the cell, m2
    mask: Floats  # 1 ocean, 0 land
    cos_angle: Floats  # Turn of the grid at the corners: eastward = cos u + sin v, northward = cos v - sin u
    sin_angle: Floats  # Turn of the grid at the corners: eastward = cos u + sin v, northward = cos v - sin u
    ni: int  # Cells of the domain and width of the halo around it
    nj: int  # Cells of the domain and width of the halo around it
    halo: int  # Cells of the domain and width of the halo around it
    latlon: bool  # Degrees or metres; edges along the axes; western and eastern end joined
    regular: bool  # Degrees or metres; edges along the axes; western and eastern end joined
    cyclic: bool  # Degrees or metres; edges along the axes; western and eastern end joined
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
"""Fields that are 0 beyond a closed boundary (equations 3.1 rule 2, quirk Q23); the others repeat the outermost value."""

FIELD_DEFAULTS = {"sss": -1.0, "depth": 1e4, "wave_height": -1.0}
"""Values of fields that are not given, where not 0 (equations 3.1 rule 4)."""


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
    return wrap_around(math.atan2(y, x) / DEGREE, real, 360.0), 90.0 - math.hypot(x, y)


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
def _pulled_in(position: float, inset: float) -> float:
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
            xi, eta = _pulled_in(xi, inset), _pulled_in(eta, inset)
            x, y = position_from_cell(xi, eta, i, j, grid)
        xi, eta, inside = position_in_cell(x, y, i, j, grid)
        if inside:
            break
    if inside and not bounced and mask[j, i] > 0.0:
        return x, y, i, j, xi, eta, False
    xi = _pulled_in(xi, inset)
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
def _nearest_of_some(x: float, y: float, grid: GridArrays) -> tuple[int, int]:
    """Cell whose centre is nearest to a point, among every `COARSE`-th cell in both directions."""
    h, lon, lat = grid.halo, grid.lon_centre, grid.lat_centre
    narrowing = math.cos(y * DEGREE) if grid.latlon else 1.0
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
        i, j = _nearest_of_some(x, y, grid)
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
    for n in range(lon.size):
        x, y = wrap_around(lon[n], 0.5 * (west + east), grid.period), lat[n]
        cell_i[n], cell_j[n], xi[n], eta[n] = -1, -1, np.nan, np.nan
        if not (south <= y <= north) or (not grid.cyclic and not (west <= x <= east)):
            continue
        i, j = find_cell(x, y, grid) if thorough else search_nearby(x, y, grid)
        if i >= 0:
            cell_i[n], cell_j[n] = i, j
            xi[n], eta[n], _ = position_in_cell(x, y, i, j, grid)
