"""Where positions lie between the points of a data product: on axes, on a curvilinear grid, or among scattered nodes.

`window` cuts out the part of a dataset that a run needs: a box in longitude, latitude and time, and one point and record more.

Elements, corners of model grids, staggered components and the positions that the doctor looks at are all located here.
A place is a cell of four points and the coordinates in it, (0, 0) at its first point and (1, 1) at the opposite one. Places
up to half a step beyond the outermost points count as on the edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.config.units import box_text
from riftberg.config.values import moment, nanoseconds
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.errors import ForcingError
from riftberg.physics.geometry import inverse_bilinear
from riftberg.plane import unit_vectors
from riftberg.products.place import EAST, NORTH, goes_round, nominal_axes, on_branch, to_degrees, to_projection
from riftberg.products.records import cover_of
from riftberg.state import Floats, Ints

POLAR = 85.0
"""Latitude (degrees) beyond which longitudes no longer serve as coordinates of a plane."""

BEYOND = 0.5
"""How far beyond the outermost points a place still counts as on the edge, in steps."""

FARTHEST = 3.0
"""How far from the nearest node of an unstructured product a place may lie, in usual distances of nodes."""

FOR_PLANE = 9
"""Nodes through which a plane is laid where a slope is asked for."""

FOR_MEAN = 3
"""Nodes whose weighted mean counts where a field must not have steps: on a model grid, and for the other component."""


class ProductPoints(NamedTuple):
    """Points of a product, degrees, shape (rows, columns); NaN where there is none."""

    lon: Floats  # Positions
    lat: Floats  # Positions
    columns: int  # Columns after which the first follows again, where the product goes round the globe; else 0


class Places(NamedTuple):
    """Cells and coordinates in them of many places."""

    row: Ints  # First point of the cell; row -1 outside of the product
    column: Ints  # First point of the cell; row -1 outside of the product
    next_row: Ints  # Opposite point of the cell
    next_column: Ints  # Opposite point of the cell
    xi: Floats  # Coordinates in the cell along the columns and along the rows, 0 to 1
    eta: Floats  # Coordinates in the cell along the columns and along the rows, 0 to 1


def build_mesh(ds: xr.Dataset | xr.DataArray) -> Mesh:
    """Return the mesh of a canonical dataset, or of a field that has been placed."""
    if {"y", "x"} <= set(ds.dims):
        ds = ds.transpose(..., "y", "x")
    at = {name: np.asarray(ds[name].values, np.float64) for name in ("lon", "lat", "x", "y") if name in ds.coords}
    # Axes first: they are exact and quick. Scattered points come last, since any grid could be read so.
    if {"lat", "lon"} <= set(ds.dims):  # the axis may jump from 180 to -180
        return AxesMesh(np.unwrap(at["lon"], period=360.0), at["lat"])
    if {"y", "x"} <= set(ds.dims) and "crs_wkt" in ds.attrs:
        crs = ds.attrs["crs_wkt"]
        return ProjectedMesh(
            at["x"], at["y"], to_degrees(crs, *np.meshgrid(at["x"], at["y"])), partial(to_projection, crs)
        )
    if {"y", "x"} <= set(ds.dims) and {"lat", "lon"} <= at.keys():
        return CurvilinearMesh(at["lon"], at["lat"])
    if "node" in ds.dims and {"lat", "lon"} <= at.keys():
        return NodeMesh(at["lon"], at["lat"])
    raise ForcingError(
        f"its points cannot be placed on the globe (dimensions {', '.join(map(str, ds.dims))})",
        where=str(ds.attrs.get("source", "forcing")),
        remedy="Give latitudes and longitudes of all points",
    )


class Located:
    """Positions (degrees, of any shape) and where they lie on a mesh."""

    def __init__(self, mesh: Mesh, lon: Floats, lat: Floats) -> None:
        self.mesh, self.shape = mesh, np.shape(lon)
        self.lon, self.lat = (np.ascontiguousarray(q, np.float64).ravel() for q in (lon, lat))
        self.places = mesh.locate(self.lon, self.lat)

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Which positions lie outside of the mesh."""
        return np.asarray((self.places.row < 0).reshape(self.shape))

    def take(self, field: Floats) -> Floats:
        """Return a field (..., rows, columns) at the positions; NaN outside and where none of the points around knows it.

        Bilinear over the known points of the cell, their weights brought to a sum of 1; the nearest nodes of scattered ones.
        """
        row, column, next_row, next_column, xi, eta = self.places
        if isinstance(self.mesh, NodeMesh):
            result = np.where(row < 0, np.nan, self.mesh.smooth(field[..., 0, :], self.lon, self.lat))
            return np.asarray(result.reshape(*field.shape[:-2], *self.shape))
        total, share = np.zeros((2, *field.shape[:-2], row.size))
        next_row, next_column = np.minimum(next_row, field.shape[-2] - 1), np.minimum(next_column, field.shape[-1] - 1)
        for j, across in ((row, 1.0 - eta), (next_row, eta)):
            for i, along in ((column, 1.0 - xi), (next_column, xi)):
                value = field[..., j, i]
                finite = np.isfinite(value)
                total += np.where(finite, value, 0.0) * (across * along)
                share += finite * (across * along)
        # A share below this is rounding of a weight that ought to be zero.
        inside = (row >= 0) & (share > 1e-9)
        result = np.divide(total, share, out=np.full(total.shape, np.nan), where=inside)
        return np.asarray(result.reshape(*field.shape[:-2], *self.shape))


@kernel
def bracket(axis: Floats, at: float, near: int) -> tuple[int, float]:
    """Return the lower neighbour of a position on a monotonic axis and the fraction of the way to the next; NaN outside.

    ``near``: a guess of that neighbour, which is looked at first.
    """
    last = axis.size - 1
    if last == 0:
        return 0, 0.0 if abs(at - axis[0]) <= 1e-8 + 1e-5 * abs(axis[0]) else math.nan
    descends = axis[0] > axis[last]
    # Bisection in ascending order; the last point belongs to the cell before it.
    lower, upper = 0, last
    guess = last - 1 - near if descends else near
    if at >= axis[last - guess if descends else guess] and at < axis[last - guess - 1 if descends else guess + 1]:
        lower, upper = guess, guess + 1
    while upper - lower > 1:
        middle = (lower + upper) // 2
        if at < axis[last - middle if descends else middle]:
            upper = middle
        else:
            lower = middle
    first, second = (axis[last - lower], axis[last - lower - 1]) if descends else (axis[lower], axis[lower + 1])
    fraction = (at - first) / (second - first)
    # Half a step beyond the last point lies within the last cell of the product.
    if not -BEYOND <= fraction <= 1.0 + BEYOND:
        fraction = math.nan
    fraction = min(max(fraction, 0.0), 1.0) if fraction == fraction else fraction
    return (last - 1 - lower, 1.0 - fraction) if descends else (lower, fraction)


@borrower
def find_on_axes(x_axis: Floats, y_axis: Floats, wrap: int, x: Floats, y: Floats, cells: Places) -> None:
    """Find the cell around each position on two axes; ``wrap``: columns after which the first follows again, or 0."""
    row, column = 0, 0
    for n in range(x.size):
        column, xi = bracket(x_axis, x[n], column)
        row, eta = bracket(y_axis, y[n], row)
        inside = xi == xi and eta == eta
        cells.row[n], cells.column[n] = row if inside else -1, column
        cells.next_row[n] = min(row + 1, y_axis.size - 1)
        cells.next_column[n] = (column + 1) % wrap if wrap > 0 else min(column + 1, x_axis.size - 1)
        cells.xi[n], cells.eta[n] = xi, eta


def _on_axes(x_axis: Floats, y_axis: Floats, wrap: int, x: Floats, y: Floats) -> Places:
    """Return the cells around positions on two axes."""
    cells = Places(*np.empty((4, x.size), np.int64), *np.empty((2, x.size)))
    find_on_axes(x_axis, y_axis, wrap, x, y, cells)
    return cells


class AxesMesh:
    """Points on axes of longitude (degrees, ascending) and latitude."""

    def __init__(self, lon: Floats, lat: Floats) -> None:
        repeated = abs(lon[-1] - lon[0] - 360.0) < 1e-6  # the first meridian stands at the end once more
        wrap = lon.size - repeated if goes_round(lon) else 0
        self._lat = np.ascontiguousarray(lat)
        self._lon = np.append(lon, lon[0] + 360.0) if wrap == lon.size else np.ascontiguousarray(lon)
        self.points = ProductPoints(*np.meshgrid(lon, lat), wrap)

    def locate(self, lon: Floats, lat: Floats) -> Places:
        """Return the places of positions."""
        middle = 0.5 * (self._lon[0] + self._lon[-1])
        # On the branch about the middle of the axis: half a turn either way.
        shifted = lon - 360.0 * np.floor((lon - middle + 180.0) / 360.0)
        return _on_axes(self._lon, self._lat, self.points.columns, shifted, np.ascontiguousarray(lat, np.float64))


class ProjectedMesh:
    """Points on the axes of a map projection (m).

    ``positions``: longitudes and latitudes of the points, degrees ((n, m)).
    """

    def __init__(
        self,
        x: Floats,
        y: Floats,
        positions: tuple[Floats, Floats],
        project: Callable[[Floats, Floats], tuple[Floats, Floats]],
    ) -> None:
        self._x, self._y, self._project = np.ascontiguousarray(x), np.ascontiguousarray(y), project
        self.points = ProductPoints(np.ascontiguousarray(positions[0]), np.ascontiguousarray(positions[1]), 0)

    def locate(self, lon: Floats, lat: Floats) -> Places:
        """Return the places of positions."""
        x, y = (np.ascontiguousarray(q, np.float64) for q in self._project(lon, lat))
        return _on_axes(self._x, self._y, 0, x, y)


def goes_round_in_x(points: Floats) -> bool:
    """Tell whether the last column of points (rows, columns, 3) is a neighbour of the first."""
    if points.shape[1] < 4:
        return False
    steps = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    seams = np.linalg.norm(points[:, -1] - points[:, 0], axis=-1)
    if np.isnan(steps).all() or np.isnan(seams).all():
        return False
    # Medians: rows at a fold or a pole have seams of any width.
    step, seam = np.nanmedian(steps), np.nanmedian(seams)
    return bool(0.2 * step < seam < 1.5 * step)


class CurvilinearMesh:
    """Points at the corners of quadrilaterals; NaN where there is none.

    ``lon``, ``lat``: positions, degrees ((n, m)).
    """

    def __init__(self, lon: Floats, lat: Floats) -> None:
        valid = np.isfinite(lon) & np.isfinite(lat)
        lon, lat = (np.ascontiguousarray(np.where(valid, q, np.nan)) for q in (lon, lat))
        wrap = lon.shape[1] if goes_round_in_x(unit_vectors(lon, lat)) else 0
        self.points = ProductPoints(lon, lat, wrap)
        self._known = np.flatnonzero(valid)

    @cached_property
    def _nodes(self) -> NodeMesh:
        return NodeMesh(self.points.lon.ravel()[self._known], self.points.lat.ravel()[self._known])

    def locate(self, lon: Floats, lat: Floats) -> Places:
        """Return the places of positions: the cell around, among those near the nearest point."""
        nearest = self._known[self._nodes.nearest(lon, lat)[1]]
        row, column = np.divmod(nearest, self.points.lon.shape[1])
        xi, eta = np.empty(lon.size), np.empty(lon.size)
        find_quadrilaterals(lon, lat, self.points, row, column, xi, eta)
        following = (column + 1) % self.points.columns if self.points.columns else column + 1
        return Places(row, column, row + 1, following, xi, eta)


class NodeMesh:
    """Scattered points without cells: a place belongs to the nearest.

    ``lon``, ``lat``: positions, degrees.
    """

    def __init__(self, lon: Floats, lat: Floats) -> None:
        from scipy.spatial import cKDTree

        self.points = ProductPoints(lon[None, :], lat[None, :], 0)
        self._tree = cKDTree(unit_vectors(lon, lat))
        # Five hundred nodes tell the usual distance as well as millions.
        sample = np.linspace(0, lon.size - 1, min(lon.size, 500)).astype(int)
        distances = self._tree.query(unit_vectors(lon[sample], lat[sample]), k=min(2, lon.size))[0]
        self._usual = float(np.median(distances[:, -1])) if lon.size > 1 else np.inf

    def nearest(self, lon: Floats, lat: Floats) -> tuple[Floats, Ints]:
        """Return distance (in radii of the Earth) and number of the node nearest to each position."""
        distance, number = self._tree.query(np.nan_to_num(unit_vectors(lon, lat)))
        return np.asarray(distance, np.float64), np.asarray(number, np.int64)

    def locate(self, lon: Floats, lat: Floats) -> Places:
        """Return the places of positions."""
        distance, node = self.nearest(lon, lat)
        row, zero = np.where(distance > FARTHEST * self._usual, -1, 0), np.zeros(lon.size)
        return Places(row, node, np.zeros_like(node), node, zero, zero)

    def smooth(self, values: Floats, lon: Floats, lat: Floats) -> Floats:
        """Return a field (..., nodes) at positions: the known of the nearest nodes, weighted by distance**-2."""
        distance, nodes = self._tree.query(np.nan_to_num(unit_vectors(lon, lat)), k=min(FOR_MEAN, values.shape[-1]))
        distance, nodes = distance.reshape(lon.size, -1), nodes.reshape(lon.size, -1)
        weight = np.where(np.isnan(values[..., nodes]), 0.0, 1.0 / np.maximum(distance, 1e-9) ** 2)
        total, share = (np.nan_to_num(values[..., nodes]) * weight).sum(axis=-1), weight.sum(axis=-1)
        return np.asarray(np.divide(total, share, out=np.full(total.shape, np.nan), where=share > 0.0))

    def spacing(self) -> Floats:
        """Return the usual distance (degrees of arc) of each node to its nearest neighbours."""
        lon, lat = self.points.lon[0], self.points.lat[0]
        distance = self._tree.query(unit_vectors(lon, lat), k=min(FOR_MEAN + 1, lon.size))[0].reshape(lon.size, -1)
        return np.rad2deg(distance[:, 1:].mean(axis=1)) if lon.size > 1 else np.zeros(1)

    def slopes(self, values: Floats, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return the slope to the east and north (per m) of a field at positions: of the plane through the nodes near by.

        ``lon``, ``lat``: positions, degrees.
        """
        _, nodes = self._tree.query(unit_vectors(lon, lat), k=min(FOR_PLANE, values.size))
        turn = (self.points.lon[0][nodes] - lon[:, None] + 180.0) % 360.0 - 180.0
        east = EARTH_RADIUS_A68 * np.deg2rad(turn) * np.cos(np.deg2rad(lat[:, None]))
        north = EARTH_RADIUS_A68 * np.deg2rad(self.points.lat[0][nodes] - lat[:, None])
        # Nodes without a value, such as those on land, take no part: their rows are 0 on both sides.
        finite = np.isfinite(values[nodes])
        count = np.maximum(finite.sum(axis=1, keepdims=True), 1)
        means = [np.where(finite, q, 0.0).sum(axis=1, keepdims=True) / count for q in (east, north, values[nodes])]
        x, y, level = (
            np.where(finite, q - mean, 0.0) for q, mean in zip((east, north, values[nodes]), means, strict=True)
        )
        # Across nodes that lie on one line, or nearly, the slope is 0: a few beside land must not tell it from noise.
        slope = np.linalg.pinv(np.stack([x, y], axis=-1), rcond=0.05) @ level[..., None]
        return slope[:, 0, 0], slope[:, 1, 0]


@kernel
def beside(lon: float, lat: float, lon0: float, lat0: float) -> tuple[float, float]:
    """Return how far (rad) a point lies to the east and north of another one.

    ``(dlon cos(lat0), dlat)``; beyond `POLAR`, where meridians meet, in the plane that touches the sphere there.
    """
    return beside_parallel(lon, lat, lon0, lat0, math.cos(lat0 * DEGREE))


@kernel
def beside_parallel(lon: float, lat: float, lon0: float, lat0: float, cosine: float) -> tuple[float, float]:
    """Return the same as `beside`, given the cosine of ``lat0``: of many points beside one it is taken once."""
    turn = lon - lon0
    turn -= 360.0 * math.floor((turn + 180.0) / 360.0)
    y, y0 = lat * DEGREE, lat0 * DEGREE
    if abs(lat0) < POLAR:
        return turn * DEGREE * cosine, y - y0
    east = math.cos(y) * math.sin(turn * DEGREE)
    return east, math.sin(y) * cosine - math.cos(y) * math.sin(y0) * math.cos(turn * DEGREE)


@kernel
def find_quadrilaterals(
    lon: Floats, lat: Floats, points: ProductPoints, row: Ints, column: Ints, xi: Floats, eta: Floats
) -> None:
    """Find the quadrilateral around each place.

    ``lon``, ``lat``: places, degrees.
    """
    x, y, wrap = points.lon, points.lat, points.columns
    rows, columns = x.shape
    for n in range(lon.size):
        near_row, near_column = row[n], column[n]
        # Of several quadrilaterals that hold the place, or nearly, the one in which it lies deepest.
        row[n], best = -1, BEYOND + 1e-9
        # The nearest point is a corner of the cell in question, or of one beside it in a skewed grid.
        first = near_column - 2 if wrap > 0 else max(near_column - 2, 0)
        behind = near_column + 2 if wrap > 0 else min(near_column + 2, columns - 1)
        for j in range(max(near_row - 2, 0), min(near_row + 2, rows - 1)):
            for candidate in range(first, behind):
                i = candidate % columns
                right = (i + 1) % columns
                x1, y1 = beside(x[j, i], y[j, i], lon[n], lat[n])
                x2, y2 = beside(x[j, right], y[j, right], lon[n], lat[n])
                x3, y3 = beside(x[j + 1, right], y[j + 1, right], lon[n], lat[n])
                x4, y4 = beside(x[j + 1, i], y[j + 1, i], lon[n], lat[n])
                # In units of the cell, so that the tolerances of the inversion hold for cells of any size.
                across = abs(x1 - x3) + abs(y1 - y3)
                if not (across > 0.0 and across < np.inf):
                    continue
                s, t = inverse_bilinear(
                    0.0, 0.0, 0.0, (x1 / across, y1 / across), (x2 / across, y2 / across),
                    (x3 / across, y3 / across), (x4 / across, y4 / across),
                )  # fmt: skip
                beyond = max(max(-s, s - 1.0), max(-t, t - 1.0))
                if beyond < best:
                    row[n], column[n], best = j, i, max(beyond, 0.0)
                    xi[n], eta[n] = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)


Mesh = AxesMesh | ProjectedMesh | CurvilinearMesh | NodeMesh
"""Points of a product, and the search among them."""

Span = tuple[float, float]

REACH = 1.5
"""Scattered points up to this many usual distances outside of a box are kept."""


def utc(value: Any) -> np.datetime64:
    """Return a moment as ``datetime64[ns]`` in UTC; text, `datetime` (naive means UTC) and ``datetime64`` are taken."""
    plain = value if isinstance(value, np.datetime64) else moment(value, where="date")
    dated: np.datetime64 = nanoseconds([plain], where="date", kind=ForcingError)[0]
    return dated


def window(
    ds: xr.Dataset, lon: Span, lat: Span, time: tuple[Any, Any] | None = None, margin: float = 0.0
) -> xr.Dataset:
    """Return the part of a canonical dataset in a box, lazily, with one more point and record on each side.

    ``lon``: west and east (degrees, any convention); ``lat``: south and north (degrees); ``margin``: width added to the
    box on each side (degrees).
    """
    west, east = lon[0] - margin, (lon[1] if lon[1] >= lon[0] else lon[1] + 360.0) + margin
    south, north = lat[0] - margin, lat[1] + margin
    if "crs_wkt" in ds.attrs:  # the rectangle of the map that holds the box
        # The sides of a box are bent on a map; 73 points a side miss less than a cell of any product.
        box = np.meshgrid(np.linspace(west, east, 73), np.linspace(max(south, -90.0), min(north, 90.0), 73))
        x, y = to_projection(ds.attrs["crs_wkt"], *box)
        columns = slice_around(ds["x"].values, np.nanmin(x), np.nanmax(x))
        subset = ds.isel(y=slice_around(ds["y"].values, np.nanmin(y), np.nanmax(y)), x=columns)
    elif "node" in ds.dims:
        subset = _scattered(ds, west, east, south, north)
    elif "y" in ds.dims:
        subset = _curvilinear(ds, west, east, south, north)
    else:
        shifted = longitudes_near(ds, west, east)
        columns = slice_around(shifted["lon"].values, west, east)
        subset = shifted.isel(lat=slice_around(shifted["lat"].values, south, north), lon=columns)
    if not all(subset.sizes[name] for name in ("lat", "lon", "y", "x", "node") if name in subset.dims):
        raise ForcingError(
            f"nothing lies in {box_text(west, east, south, north)}: the data cover {extent_text(ds)}{nominal_axes(ds)}",
            where=str(ds.attrs.get("source", "")),
            remedy="Give a file that covers the box; check the sign of west longitudes",
        )
    if "crs_wkt" in ds.attrs and not {"lat", "lon"} <= set(subset.variables):
        x, y = np.meshgrid(subset["x"].values, subset["y"].values)
        degrees = to_degrees(ds.attrs["crs_wkt"], x, y)
        subset = subset.assign_coords(lon=(("y", "x"), degrees[0], EAST), lat=(("y", "x"), degrees[1], NORTH))
    return window_in_time(subset, time) if time is not None and "time" in subset.dims else subset


def slice_around(axis: Floats, low: float, high: float) -> slice:
    """Return the part of an ascending axis around ``low..high``, one point more on each side; empty if outside."""
    if high < axis[0] or low > axis[-1]:
        return slice(0, 0)
    start = max(int(np.searchsorted(axis, low, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(axis, high, side="left")) + 1, axis.size)
    return slice(start, stop)


def longitudes_near(ds: xr.Dataset, west: float, east: float) -> xr.Dataset:
    """Return the dataset with its longitudes on the branch where they meet ``west..east`` best."""
    if goes_round(ds["lon"].values):
        # The seam goes where nothing is needed: half of what is left on either side of the box.
        spare = max(0.0, 360.0 - (east - west))
        return on_branch(ds, west - 0.5 * spare)
    axis = ds["lon"].values
    turns = [turn for turn in (-720.0, -360.0, 0.0, 360.0, 720.0)]
    overlap = [min(east, axis[-1] + turn) - max(west, axis[0] + turn) for turn in turns]
    return ds.assign_coords(lon=("lon", axis + turns[int(np.argmax(overlap))], ds["lon"].attrs))


def _scattered(ds: xr.Dataset, west: float, east: float, south: float, north: float) -> xr.Dataset:
    """Keep the scattered points of a box and those around it, with longitudes on the branch of the box."""
    middle = 0.5 * (west + east)
    lon, lat = (ds["lon"].values - middle + 180.0) % 360.0 - 180.0 + middle, ds["lat"].values
    spacing = REACH * NodeMesh(lon, lat).spacing()
    # Towards the pole a degree of longitude is short; 0.02 keeps it finite there.
    beyond = spacing / np.maximum(np.cos(np.deg2rad(lat)), 0.02)
    inside = (lat >= south - spacing) & (lat <= north + spacing) & (lon >= west - beyond) & (lon <= east + beyond)
    shifted = ds.assign_coords(lon=("node", lon, ds["lon"].attrs))
    return shifted.isel(node=np.flatnonzero(inside))


def _curvilinear(ds: xr.Dataset, west: float, east: float, south: float, north: float) -> xr.Dataset:
    """Cut a curvilinear grid to the box; where rows and columns follow latitude and longitude there, name them so."""
    lat = ds["lat"].values
    lon = (ds["lon"].values - west) % 360.0 + west
    inside = (lat >= south) & (lat <= north) & (lon <= east)
    if not inside.any():  # the box lies in one of the cells, or outside
        middle = np.array([0.5 * (west + east)]), np.array([0.5 * (south + north)])
        if Located(CurvilinearMesh(lon, lat), *middle).outside.any():
            return ds.isel(y=slice(0, 0))
        off = np.linalg.norm(unit_vectors(lon, lat) - unit_vectors(*middle), axis=-1)
        inside = off == np.nanmin(off)
    rows, columns = np.nonzero(inside.any(axis=1))[0], np.nonzero(inside.any(axis=0))[0]
    # Columns in running order, one more on each side, even if they pass the seam of the grid.
    gaps = np.diff(columns)
    cut = int(np.argmax(gaps)) + 1 if gaps.size and gaps.max() > 0.5 * lon.shape[1] else 0
    ordered = np.concatenate([columns[cut:], columns[:cut]])
    first, last = max(int(ordered[0]) - 1, 0), min(int(ordered[-1]) + 1, lon.shape[1] - 1)
    running = np.array(list(dict.fromkeys([first, *ordered.tolist(), last])), dtype=np.int64)
    return _straightened(ds.isel(y=slice(max(rows[0] - 1, 0), rows[-1] + 2), x=running), west, east)


def _straightened(ds: xr.Dataset, west: float, east: float) -> xr.Dataset:
    """Turn two-dimensional positions into axes where each varies along one dimension only (Mercator part of a grid)."""
    middle = 0.5 * (west + east)
    lat = ds["lat"].values
    lon = (ds["lon"].values - middle + 180.0) % 360.0 - 180.0 + middle
    if not (np.ptp(lat, axis=1).max() <= 1e-3 and np.ptp(lon, axis=0).max() <= 1e-3):  # also where positions are NaN
        return ds.assign_coords(lon=(ds["lon"].dims, lon, ds["lon"].attrs))
    order = np.unique(np.round(lon.mean(axis=0), 5), return_index=True)[1]
    ds = ds.isel(x=order).drop_vars(["lat", "lon"]).rename(y="lat", x="lon")
    return ds.assign_coords(lat=("lat", lat.mean(axis=1), NORTH), lon=("lon", lon.mean(axis=0)[order], EAST))


def extent_text(ds: xr.Dataset) -> str:
    """Return the extent of a canonical dataset in space, in words."""
    if "lat" not in ds.coords:
        return "a projected grid without positions"
    lat, lon = ds["lat"].values, ds["lon"].values
    west, east = (-180.0, 180.0) if "lat" in ds.dims and goes_round(lon) else (np.nanmin(lon), np.nanmax(lon))
    return box_text(float(west), float(east), float(np.nanmin(lat)), float(np.nanmax(lat)))


def window_in_time(ds: xr.Dataset, time: tuple[Any, Any], margin: float = 0.0) -> xr.Dataset:
    """Return the records of a time, widened by a margin (s), and one more on each side; `ForcingError` if there is none."""
    spare = np.timedelta64(round(margin), "s")
    first, last = (
        utc(moment).astype("datetime64[us]") + sign * spare for moment, sign in zip(time, (-1, 1), strict=True)
    )
    records = ds["time"].values.astype(first.dtype)
    begins, ends = cover_of(ds)
    if last < begins or first > ends:
        raise ForcingError(
            f"no record lies in {first.astype('M8[m]')}..{last.astype('M8[m]')}: the data run from "
            f"{records[0].astype('M8[m]')} to {records[-1].astype('M8[m]')}",
            where=str(ds.attrs.get("source", "")),
            remedy="Give files of these dates",
        )
    start = max(int(np.searchsorted(records, first, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(records, last, side="left")) + 1, records.size)
    return ds.isel(time=slice(min(start, records.size - 1), max(stop, 1)))
