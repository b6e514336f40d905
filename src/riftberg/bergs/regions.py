"""Outlines and masks as plane regions, and the positions of their elements on the sphere.

The model measures the distance of two elements with the cosine of their mean latitude (equations 2.2). A berg whose
longitudes are laid out with each element's own latitude (the rule of the reference, files 8.3) therefore starts with
stretched bonds. Here a lattice is brought to the sphere with an equal-area map of the tangent plane, and then moved
by the smallest displacements (decimetres) that make bonded distances equal to their rest length. On a curved surface
this succeeds exactly for square packing, whose cells may shear a little, and nearly for hexagonal packing, which is
rigid: there 150 km x 50 km keep 3e-6, and 150 km x 150 km keep 3e-5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from riftberg.bergs.bonding import Metric, separations
from riftberg.bergs.bonding import pieces as connected
from riftberg.bergs.lattice import Booleans, Lattice, Region, lattice_points
from riftberg.bergs.raster import Raster, reproject, unbroken
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.physics.elementary import cos, cos_array, sin
from riftberg.plane import EqualAreaPlane
from riftberg.state import Floats, Ints

# Planes: from metres to degrees and back, and the strain which that causes.


@dataclass(frozen=True)
class ReferencePlane:
    """The rule of the reference (files 8.3 and 8.3.8): one latitude on the way in, each element's own on the way out."""

    west: float  # Longitude and latitude (degrees) of the origin
    south: float  # Longitude and latitude (degrees) of the origin
    reference_latitude: float  # Latitude (degrees) whose cosine scales longitudes on the way in
    earth_radius: float  # Radius of the sphere, m

    def forward(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return x, y (m) of points (degrees)."""
        scale = DEGREE * self.earth_radius
        return scale * cos(self.reference_latitude * DEGREE) * (lon - self.west), scale * (lat - self.south)

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude (degrees) of points (m)."""
        scale = np.pi / 180 * self.earth_radius
        lat = self.south + y / scale
        return self.west + x / (scale * cos_array(np.radians(lat))), lat

    def moved(self, dlon: float, dlat: float) -> ReferencePlane:
        """Return the same map moved by some degrees."""
        return ReferencePlane(self.west + dlon, self.south + dlat, self.reference_latitude + dlat, self.earth_radius)


FillingPlane = EqualAreaPlane | ReferencePlane
"""A plane (m) that a berg is filled in, and its map to the sphere (degrees)."""


def filling_plane(
    bounds: tuple[float, float, float, float], centroid: tuple[float, float], conformal: bool, earth_radius: float
) -> FillingPlane:
    """Return the plane in which a figure of these bounds and centroid (degrees) is filled."""
    if conformal:
        return EqualAreaPlane(*centroid, earth_radius)
    west, south, _, north = bounds
    return ReferencePlane(west, south, 0.5 * (south + north), earth_radius)


def move_centroid(
    plane: FillingPlane,
    centroid: tuple[float, float],
    placement: tuple[float, float] | None,
    shift: tuple[float, float],
) -> FillingPlane:
    """Return the plane after a move of the centroid (degrees) to ``placement`` and by ``shift``."""
    target = centroid if placement is None else placement
    return plane.moved(target[0] - centroid[0] + shift[0], target[1] - centroid[1] + shift[1])


def turned(x: Floats, y: Floats, degrees: float) -> tuple[Floats, Floats]:
    """Turn points counter-clockwise about the origin."""
    c, s = cos(degrees * DEGREE), sin(degrees * DEGREE)
    return c * x - s * y, s * x + c * y


ROUNDS = 5
"""Gauss-Newton rounds at most; the elongations are small, so two or three are enough."""

ITERATIONS = 600
"""Iterations of conjugate gradients in a round at most."""


def relax(lon: Floats, lat: Floats, first: Ints, second: Ints, rest: Floats, metric: Metric) -> tuple[Floats, Floats]:
    """Move elements by the least displacements that bring bonded distances to their rest length.

    Gauss-Newton rounds on the sum of squared elongations; each round solves for the displacements of least norm with
    conjugate gradients (CGLS), so translation and rotation of the berg are untouched.

    ``lon``, ``lat``: positions, degrees; ``rest``: rest length of each bond, m; returns ``lon, lat``: new positions,
    degrees.
    """
    scale = DEGREE * metric.radius
    for _ in range(ROUNDS):
        x, y = separations(metric, lon[first], lat[first], lon[second], lat[second])
        length = np.hypot(x, y)
        if np.max(np.abs(rest - length), initial=0.0) < 1e-6:
            break
        dx, dy = _least_squares(x / length, y / length, first, second, rest - length, len(lon))
        lon, lat = lon + dx / (scale * cos_array(lat * DEGREE)), lat + dy / scale
    return lon, lat


def _least_squares(
    nx: Floats, ny: Floats, first: Ints, second: Ints, missing: Floats, size: int
) -> tuple[Floats, Floats]:
    """Displacements of least norm whose bond elongations fit ``missing`` (m) best: CGLS, started from zero."""

    def gathered(r: Floats) -> Floats:
        out = np.empty((2, size))
        for k, n in enumerate((nx, ny)):
            out[k] = np.bincount(first, n * r, size) - np.bincount(second, n * r, size)
        return out

    move, residual = np.zeros((2, size)), missing.copy()
    gradient = gathered(residual)
    direction, norm = gradient, float((gradient * gradient).sum())
    # Below 1e-8 m per element only round-off is left, and a rigid (hexagonal) lattice would follow it astray.
    target = max(1e-14 * norm, 1e-16 * size)
    for _ in range(ITERATIONS):
        if norm <= target:
            break
        stretch = nx * (direction[0, first] - direction[0, second]) + ny * (direction[1, first] - direction[1, second])
        step = norm / float((stretch * stretch).sum())
        move += step * direction
        residual -= step * stretch
        gradient = gathered(residual)
        norm, old_norm = float((gradient * gradient).sum()), norm
        direction = gradient + norm / old_norm * direction
    return move[0], move[1]


# Regions: outlines and masks on such a plane.


def outline_region(geometry: Any, plane: FillingPlane) -> Region:
    """Return an outline (shapely, longitude and latitude in degrees) as a region of a plane."""
    flat = shapely.transform(geometry, plane.forward, interleaved=False)
    shapely.prepare(flat)
    centroid = (flat.centroid.x, flat.centroid.y)
    polygons = list(getattr(flat, "geoms", [flat]))

    def piece(x: Floats, y: Floats) -> Ints:
        number = np.zeros(np.shape(x), dtype=np.int64)
        for k, polygon in enumerate(polygons, start=1):
            number[shapely.contains_xy(polygon, x, y)] = k
        return number

    return Region(flat.bounds, flat.area, centroid, lambda x, y: shapely.contains_xy(flat, x, y), piece, len(polygons))


def ice_cells(mask: Raster, threshold: float) -> Booleans:
    """Return the cells whose values are above a threshold."""
    above: Booleans = np.nan_to_num(mask.values) > threshold
    return above


@dataclass(frozen=True)
class IceMask:
    """A mask as fractions of ice."""

    fraction: Raster  # From 0 to 1, without gaps, on longitudes and latitudes that no seam cuts
    level: float  # There is ice where the bilinear fraction is above this

    @classmethod
    def of(cls, mask: Raster, threshold: float) -> IceMask:
        """Return the ice of a mask, of a fraction or of a thickness.

        Values from 0 to 1 with a positive threshold are fractions, and the edge of the ice lies where they reach the
        threshold. All others are ice or not, cell by cell, and the edge lies half way between: the bilinear values of
        a thickness of 200 m beside nothing would exceed any small threshold almost a whole cell outside the ice.
        """
        values, is_ice = np.nan_to_num(mask.values), ice_cells(mask, threshold)
        if not is_ice.any():
            raise BergError(
                f"no value above {threshold:g}; the largest is {values.max():g}",
                where=mask.name,
                remedy="Lower threshold= or choose another variable",
            )
        if threshold > 0.0 and values.min() >= 0.0 and values.max() <= 1.0 + 1e-9:
            fraction, level = replace(mask, values=values), threshold
        else:
            fraction, level = replace(mask, values=is_ice.astype(np.float64)), 0.5
        return cls(unbroken(fraction, is_ice) if mask.crs is None else reproject(fraction, is_ice), level)

    @property
    def there(self) -> Booleans:
        """Cells of ice."""
        above: Booleans = self.fraction.values > self.level
        return above

    def pieces(self) -> Floats:
        """Return the numbers (from 1) of the separate pieces of ice, NaN without ice.

        Cells that only touch at a corner are separate: there the bilinear fraction of two full cells is 0.5, which is
        not above the level, and a corner has no cross-section that could carry a bond.
        """
        is_ice = self.there
        cell = np.full(is_ice.shape, -1, dtype=np.int64)
        cell[is_ice] = np.arange(is_ice.sum())
        beside, above = is_ice[:, :-1] & is_ice[:, 1:], is_ice[:-1] & is_ice[1:]
        first = np.concatenate([cell[:, :-1][beside], cell[:-1][above]])
        second = np.concatenate([cell[:, 1:][beside], cell[1:][above]])
        numbers = np.full(is_ice.shape, np.nan)
        numbers[is_ice] = connected(int(is_ice.sum()), first, second)
        return numbers


def mask_region(
    ice: IceMask, plane_at: Callable[[tuple[float, float, float, float], tuple[float, float]], FillingPlane]
) -> tuple[Region, FillingPlane, tuple[float, float]]:
    """Return a mask as a region of the plane that suits it, the plane, and the mask's centroid in degrees.

    ``plane_at``: makes a plane from bounds and centroid (degrees).
    """
    mask, is_ice = ice.fraction, ice.there
    width, height = mask.cells()
    lon, lat = np.meshgrid(mask.lon, mask.lat)
    cell = np.outer(height, width) * cos_array(lat * DEGREE)
    weight = np.where(is_ice, cell, 0.0)
    centroid = (float((weight * lon).sum() / weight.sum()), float((weight * lat).sum() / weight.sum()))
    west, east = (lon - 0.5 * width)[is_ice].min(), (lon + 0.5 * width)[is_ice].max()
    south, north = (lat - 0.5 * height[:, None])[is_ice].min(), (lat + 0.5 * height[:, None])[is_ice].max()
    plane = plane_at((west, south, east, north), centroid)
    fraction = np.linspace(0.0, 1.0, 33)
    along, up = west + fraction * (east - west), south + fraction * (north - south)
    edges_x, edges_y = plane.forward(
        np.concatenate([along, along, np.full(33, west), np.full(33, east)]),
        np.concatenate([np.full(33, south), np.full(33, north), up, up]),
    )
    bounds = (float(edges_x.min()), float(edges_y.min()), float(edges_x.max()), float(edges_y.max()))
    # The area (m2) of one square degree at the equator, from the plane's own scale along the meridian.
    x, y = plane.forward(np.full(2, centroid[0]), np.array([centroid[1] - 1e-3, centroid[1] + 1e-3]))
    area = float((mask.values * cell).sum()) * float((np.hypot(x[1] - x[0], y[1] - y[0]) / 2e-3) ** 2)

    def inside(x: Floats, y: Floats) -> Booleans:
        ice_there: Booleans = np.nan_to_num(mask.sample(*plane.inverse(x, y))) > ice.level
        return ice_there

    numbers = ice.pieces()
    numbered = replace(mask, values=numbers)

    def piece(x: Floats, y: Floats) -> Ints:
        return np.nan_to_num(numbered.of_largest_weight(*plane.inverse(x, y))).astype(np.int64)

    x, y = plane.forward(lon[is_ice], lat[is_ice])
    middle = (float(np.average(x, weights=cell[is_ice])), float(np.average(y, weights=cell[is_ice])))
    return Region(bounds, area, middle, inside, piece, int(np.nanmax(numbers))), plane, centroid


def makeberg_lattice(
    mask: Raster,
    radius: float,
    packing: Packing,
    *,
    spacing: float = 500.0,
    reference_latitude: float | None = None,
    threshold: float = 0.5,
    shift: tuple[float, float] = (0.0, 0.0),
    earth_radius: float,
) -> tuple[Lattice, ReferencePlane]:
    """Return the elements of a mask as the reference's script places them, and the map to the sphere.

    Equations 10.5; thermodynamics 8.2, 8.3. The published A68a run starts from the result of these rules. Two of their habits are
    deliberate copies: the mask is counted from its first point while positions are measured from half a cell further
    south-west, and every longitude uses its element's own latitude.

    ``mask``: ice where positive; ``radius``, ``packing``: radius (m) and packing of the elements; ``spacing``: spacing
    (m) of the plane grid on which the mask is resampled; ``reference_latitude``: latitude (degrees) that scales the
    longitudes of the mask; ``earth_radius``: radius of the sphere, m.
    """
    if mask.crs is not None:
        raise BergError(
            "a projected mask", where=mask.name, remedy='rules="makeberg" needs a grid of longitude and latitude'
        )
    lon = mask.lon + shift[0]
    lon = lon + 360 if lon[0] < 0 else lon
    lat = mask.lat + shift[1]
    fraction = (np.nan_to_num(mask.values) > 0).astype(np.float64)
    reference = float(lat.mean()) if reference_latitude is None else reference_latitude
    scale = np.pi / 180 * earth_radius
    x, y = scale * cos_array(np.radians(reference)) * lon, scale * lat
    grid = Raster(x, y, fraction, "mask")
    fine_x, fine_y = np.arange(x[0], x[-1], spacing), np.arange(y[0], y[-1], spacing)
    fine = grid.sample(*np.meshgrid(fine_x, fine_y))
    bounds = (0.0, 0.0, x[-1] - x[0] + (x[1] - x[0]), y[-1] - y[0] + (y[1] - y[0]))
    lattice = lattice_points(bounds, radius, packing)
    i, j = (lattice.x // spacing).astype(int), (lattice.y // spacing).astype(int)
    inside = (i < fine.shape[1]) & (j < fine.shape[0])
    lattice = lattice.where(inside)
    lattice = lattice.where(fine[j[inside], i[inside]] > threshold)
    west, south = lon[0] - 0.5 * (lon[1] - lon[0]), lat[0] - 0.5 * (lat[1] - lat[0])
    return lattice, ReferencePlane(float(west), float(south), reference, earth_radius)
