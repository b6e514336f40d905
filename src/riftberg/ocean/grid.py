"""The grid of the ocean: corners, halo, metrics, land, periodicity; and the fields that live on it.

Arrays have shape (nj + 2 halo, ni + 2 halo) and are indexed [j, i]; cell (i, j) of the reference (counted from 1)
is ``[j - 1 + halo, i - 1 + halo]``. The corner with the index of a cell is its north-east corner. Source: equations 2.1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from riftberg.compiled.kernels import kernel
from riftberg.config.units import box_text, place_text
from riftberg.constants import EARTH_RADIUS_A68, STRESS_INVERSION_DRAG
from riftberg.errors import BergError, InputError
from riftberg.ocean.cells import CORNER_FIELDS, ZERO_OUTSIDE, Fields, GridArrays, locate_points
from riftberg.ocean.needs import DEFAULTS
from riftberg.physics.elementary import atan2_array, cos_array, sin_array
from riftberg.state import Elements, Floats


def _put(values: Floats, ni: int, nj: int, halo: int) -> tuple[Floats, slice, slice]:
    """Place given values in an array with halo; return it with the rows and columns that are known."""
    full = np.full((nj + 2 * halo, ni + 2 * halo), np.nan)
    # Cells alone; with the outermost south and west corners; with one ring; with the whole halo.
    for lines_before, lines_after in ((0, 0), (1, 0), (1, 1), (halo, halo)):
        if values.shape == (nj + lines_before + lines_after, ni + lines_before + lines_after):
            rows = slice(halo - lines_before, halo + nj + lines_after)
            columns = slice(halo - lines_before, halo + ni + lines_after)
            full[rows, columns] = values
            return full, rows, columns
    raise InputError(
        f"array of shape {values.shape} does not fit a grid of {nj} x {ni} cells",
        remedy=f"Give ({nj}, {ni}), ({nj + 1}, {ni + 1}) with the outermost south and west line first, "
        f"({nj + 2}, {ni + 2}) with one ring, or {full.shape} with the halo",
    )


def _join_ends(full: Floats, ni: int, halo: int, period: float = 0.0) -> None:
    """Fill the western and eastern halo of a cyclic grid with copies, shifted by the period."""
    columns = np.arange(full.shape[1]) - halo
    turns = columns // ni
    full[:] = full[:, halo + columns - turns * ni] + turns * period


def _extrapolate_columns(full: Floats, columns: slice) -> None:
    for i in range(columns.start - 1, -1, -1):
        full[:, i] = 2.0 * full[:, i + 1] - full[:, i + 2]
    for i in range(columns.stop, full.shape[1]):
        full[:, i] = 2.0 * full[:, i - 1] - full[:, i - 2]


def _halo_corners(
    lon: Floats, lat: Floats, rows: slice, columns: slice, wrap: Callable[[Floats, float], None] | None, period: float
) -> None:
    """Fill halo corners: copied in cyclic directions, linear elsewhere; the south keeps its longitudes (equations 2.1)."""
    for j in range(rows.start - 1, -1, -1):
        # The south before the ends are joined, the north after: the other order gives other corners (equations 2.1).
        lon[j], lat[j] = lon[j + 1], 2.0 * lat[j + 1] - lat[j + 2]
    if wrap is not None:
        wrap(lon, period)
        wrap(lat, 0.0)
    else:
        _extrapolate_columns(lon, columns)
        _extrapolate_columns(lat, columns)
    for j in range(rows.stop, lon.shape[0]):
        lon[j], lat[j] = 2.0 * lon[j - 1] - lon[j - 2], 2.0 * lat[j - 1] - lat[j - 2]


def _centres(q: Floats) -> Floats:
    centre = q.copy()
    centre[1:, 1:] = 0.25 * ((q[1:, 1:] + q[:-1, :-1]) + (q[1:, :-1] + q[:-1, 1:]))
    return centre


def _closes(lon: Floats, ni: int, halo: int, period: float) -> bool:
    """Whether the domain spans one period, judged on its middle row to a half cell."""
    if period <= 0.0:
        return False
    row = lon[lon.shape[0] // 2, halo : halo + ni]
    spacing = (row[-1] - row[0]) / (ni - 1)
    # The last corner and one more spacing make a full circle, or nearly: grids in single precision miss it by
    # round-off.
    return bool(abs(row[-1] + spacing - row[0] - period) < 0.5 * abs(spacing))


class GridTurn(TypedDict, total=False):
    """Cosine and sine of the angle by which a grid is turned at its north-east corners; None for not at all."""

    cos_angle: ArrayLike | None
    sin_angle: ArrayLike | None


class Grid:
    """Grid of the ocean with its halo; make one with `Grid.cartesian` or `Grid.from_corners`.

    ``earth_radius``: radius of the sphere that gave the metrics, m.
    """

    def __init__(self, arrays: GridArrays, earth_radius: float) -> None:
        self.arrays = arrays
        self.earth_radius = earth_radius
        self.bergs_on_land = False

    @classmethod
    def cartesian(
        cls, ni: int, nj: int, spacing: float, *, period: float = 0.0, offset: float = 0.0,
        mask: ArrayLike | None = None, halo: int = 4,
    ) -> Grid:  # fmt: skip
        """Return a grid of square cells in metres, as in the test cases of the reference (equations 10.1).

        ``spacing``: side of a cell, m; ``period``: zonal period, m; ``offset``: added to all corner coordinates, m.
        """
        x, y = np.meshgrid(spacing * np.arange(1, ni + 1) + offset, spacing * np.arange(1, nj + 1) + offset)
        grid = cls.from_corners(x, y, latlon=False, regular=True, period=period, mask=mask, halo=halo)
        # Differences of shifted coordinates are off by round-off; the lengths are known exactly.
        grid.arrays.dx[:], grid.arrays.dy[:], grid.arrays.area[:] = spacing, spacing, spacing**2
        return grid

    @classmethod
    def from_corners(
        cls, lon2d: ArrayLike, lat2d: ArrayLike, *, latlon: bool = True, regular: bool = True, period: float = 360.0,
        radius_for_metrics: float = EARTH_RADIUS_A68, mask: ArrayLike | None = None, halo: int = 4,
        includes_southwest: bool = False, cyclic: bool | None = None, **turn: Unpack[GridTurn],
    ) -> Grid:  # fmt: skip
        """Return the grid with the given cell corners.

        ``lon2d``, ``lat2d``: north-east corners of the cells, shape (nj, ni), degrees or m; ``radius_for_metrics``:
        radius of the sphere for lengths and areas, m.
        """
        cos_angle, sin_angle = turn.get("cos_angle"), turn.get("sin_angle")
        lon_given, lat_given = np.asarray(lon2d, dtype=np.float64), np.asarray(lat2d, dtype=np.float64)
        _check_corners(lon_given, lat_given, halo)
        _check_orientation(lon_given, lat_given, latlon)
        nj, ni = (n - includes_southwest for n in lon_given.shape)
        lon, rows, columns = _put(lon_given, ni, nj, halo)
        lat, _, _ = _put(lat_given, ni, nj, halo)
        joined = _closes(lon, ni, halo, period) if cyclic is None else cyclic

        def wrap(full: Floats, shift: float = 0.0) -> None:
            _join_ends(full, ni, halo, shift)

        _halo_corners(lon, lat, rows, columns, wrap if joined else None, period)
        # (dx, dy): lengths (m) of the north and the east edge of each cell; shape of the corners.
        if latlon:
            north = haversine(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:], radius_for_metrics)
            east = haversine(lon[:-1], lat[:-1], lon[1:], lat[1:], radius_for_metrics)
        else:
            north = np.hypot(np.diff(lon, axis=1), np.diff(lat, axis=1))
            east = np.hypot(np.diff(lon, axis=0), np.diff(lat, axis=0))
        dx, dy = np.concatenate([north[:, :1], north], axis=1), np.concatenate([east[:1], east], axis=0)
        # Row 0 and column 0 hold corners only and have no cell.
        area = np.zeros_like(lon)
        area[1:, 1:] = cell_areas(lon, lat, radius_for_metrics, latlon)
        empty = np.zeros_like(lon)
        arrays = GridArrays(
            lon, lat, _centres(lon), _centres(lat), dx, dy, area, empty, empty, empty,
            ni, nj, halo, latlon, regular, joined, float(period),
        )  # fmt: skip
        grid = cls(arrays, radius_for_metrics)
        grid.arrays = arrays._replace(
            mask=grid.extended(1.0 if mask is None else np.asarray(mask, dtype=np.float64), outside="zero"),
            cos_angle=grid.extended(1.0 if cos_angle is None else cos_angle),
            sin_angle=grid.extended(0.0 if sin_angle is None else sin_angle),
        )
        return grid

    def extended(self, values: ArrayLike, outside: str = "nearest") -> Floats:
        """Return values of cells or north-east corners on the full shape of the grid, as a new float64 array."""
        g = self.arrays
        field = np.asarray(values, dtype=np.float64)
        if field.ndim == 0:
            field = np.broadcast_to(field, (g.nj, g.ni))
        full, rows, columns = _put(field, g.ni, g.nj, g.halo)
        if outside not in ("nearest", "zero"):
            raise InputError(f"outside = {outside!r}", remedy="Use 'nearest' or 'zero'")
        inner = full[rows, columns]
        width = [(s.start, n - s.stop) for s, n in zip((rows, columns), full.shape, strict=True)]
        full = np.pad(inner, width, mode="edge") if outside == "nearest" else np.pad(inner, width)
        if g.cyclic:
            _join_ends(full, g.ni, g.halo)
        return np.ascontiguousarray(full)

    def fields(self, **given: ArrayLike) -> Fields:
        """Return `Fields` from numbers or arrays (shapes as in `extended`); fields not given are at rest or absent.

        Wind and sea level are 0 beyond closed ends, as in the reference (equations 3.1); others repeat their last value.

        Examples
        --------
        >>> grid = Grid.cartesian(20, 20, 1000.0, period=20000.0)
        >>> float(grid.fields(uo=0.2, depth=1000.0).uo[10, 10])
        0.2

        """
        unknown = sorted(set(given) - set(Fields._fields))
        if unknown:
            raise InputError(f"unknown field {unknown[0]!r}", remedy=f"Fields are {', '.join(Fields._fields)}")
        values: dict[str, Any] = {name: given.get(name, DEFAULTS.get(name, 0.0)) for name in Fields._fields}
        return Fields(
            **{name: self.extended(v, "zero" if name in ZERO_OUTSIDE else "nearest") for name, v in values.items()}
        )

    def locate(self, elements: Elements) -> None:
        """Set cell and coordinates in the cell of all elements, at the start of a run (equations 2.5).

        Longitudes that are whole periods off the grid's are brought to the grid's, together with ``lon_pair``.
        """
        e, g = elements, self.arrays
        locate_points(e.lon, e.lat, g, True, e.cell_i, e.cell_j, e.xi, e.eta)
        outside = np.flatnonzero(e.cell_i < 0)
        if outside.size:
            raise _misplaced(e, int(outside[0]), self.arrays.latlon, "outside the grid", self._extent())
        land = np.flatnonzero(g.mask[e.cell_j, e.cell_i] < 0.5)
        if land.size and not self.bergs_on_land:
            raise _misplaced(
                e, int(land[0]), self.arrays.latlon, "on land", "Move the berg, or correct the land mask there."
            )
        if g.period > 0.0:
            turns = np.round((e.lon - g.lon_centre[e.cell_j, e.cell_i]) / g.period)
            e.lon[:] -= turns * g.period
            e.lon_pair[:] -= turns * g.period

    def has_in_domain(self, elements: Elements) -> NDArray[np.bool_]:
        """Return which elements lie in a cell of the domain, not in the halo."""
        g, i, j = self.arrays, elements.place.cell_i, elements.place.cell_j
        return np.asarray((i >= g.halo) & (i < g.halo + g.ni) & (j >= g.halo) & (j < g.halo + g.nj))

    def check_cells(self, elements: Elements) -> None:
        """Refuse cells of elements that are not on the grid; a restart indexes memory by them from its first step on."""
        g, i, j = self.arrays, elements.cell_i, elements.cell_j
        rows, columns = g.mask.shape
        outside = np.flatnonzero((i < 0) | (i >= columns) | (j < 0) | (j >= rows))
        if outside.size:
            e = int(outside[0])
            raise _misplaced(
                elements, e, self.arrays.latlon,
                f"said to be in cell ({i[e]}, {j[e]}) of a grid of {columns} by {rows}",
                "Go on with the forcing of the run that wrote the restart; if it is that, the restart is damaged.",
            )  # fmt: skip

    def _extent(self) -> str:
        (west, east), (south, north) = self.bounds()
        return f"The grid covers {box_text(west, east, south, north, latlon=self.arrays.latlon)}"

    def _unit(self) -> str:
        return "degrees" if self.arrays.latlon else "m"

    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return ((west, east), (south, north)) of the domain without halo, degrees or m."""
        g = self.arrays
        box = np.s_[g.halo - 1 : g.halo + g.nj, g.halo - 1 : g.halo + g.ni]
        lon, lat = g.lon[box], g.lat[box]
        return (float(lon.min()), float(lon.max())), (float(lat.min()), float(lat.max()))

    @property
    def domain(self) -> tuple[slice, slice]:
        """Slices of rows and columns that cut the halo off."""
        g = self.arrays
        return np.s_[g.halo : g.halo + g.nj, g.halo : g.halo + g.ni]

    def __repr__(self) -> str:
        return f"<Grid: {self.describe()}>"

    def describe(self) -> str:
        """Return size, extent, spacing, land and periodicity in plain words."""
        g = self.arrays
        dx, dy, mask = g.dx[self.domain], g.dy[self.domain], g.mask[self.domain]
        kind = "regular" if g.regular else "general"
        ends = f"cyclic, period {g.period:g} {self._unit()}" if g.cyclic else "closed"
        (west, east), (south, north) = self.bounds()
        return (
            f"{g.ni} x {g.nj} cells, {kind}, {'longitude and latitude' if g.latlon else 'Cartesian'}, {ends}\n"
            f"  from {box_text(west, east, south, north, latlon=g.latlon)}\n"
            f"  cells {dx.min():.6g} to {dx.max():.6g} m wide, {dy.min():.6g} to {dy.max():.6g} m high\n"
            f"  {100.0 * float((mask < 0.5).mean()):.1f} % land"
        )


def _check_corners(lon: NDArray[np.float64], lat: NDArray[np.float64], halo: int) -> None:
    if lon.ndim != 2 or lon.shape != lat.shape or min(lon.shape) < 2:
        raise InputError(
            f"corner arrays of shapes {lon.shape} and {lat.shape}",
            remedy="Give two 2-D arrays of one shape, at least 2 x 2",
        )
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise InputError("corner coordinates are not all finite", remedy="Fill the gaps of the grid's coordinates")
    if halo < 2:
        raise InputError(f"halo = {halo}", remedy="The interpolation of depth needs a halo of at least 2 cells")


INSIDE_OUT: Final = 0.1
"""Part of the cells of a grid that may lie inside out: the rows along the fold of a tripolar grid are there twice."""


def _check_orientation(lon: Floats, lat: Floats, latlon: bool) -> None:
    """Refuse corners that run westward or southward, or in no order: every cell would lie inside out."""
    x, y, z = lon, lat, np.ones_like(lon)
    if latlon:  # on the sphere, where neither pole nor date line is special
        east, north = np.radians(lon), np.radians(lat)
        x, y, z = cos_array(north) * cos_array(east), cos_array(north) * sin_array(east), sin_array(north)
    points = np.stack([x, y, z], axis=-1)
    # Half the cross product of the diagonals is the area of a quadrilateral, with the sign of its sense.
    a, b = points[1:, 1:] - points[:-1, :-1], points[1:, :-1] - points[:-1, 1:]
    up = points[1:, 1:] if latlon else np.array([0.0, 0.0, 1.0])
    area = (np.cross(a, b) * up).sum(axis=-1)
    wrong = area < 0.0
    if wrong.mean() > INSIDE_OUT:
        j, i = (int(k[0]) for k in np.nonzero(wrong))
        raise InputError(
            f"{int(wrong.sum())} of {wrong.size} cells lie inside out, the first in row {j + 1}, column {i + 1} at "
            f"{lon[j, i]:g}, {lat[j, i]:g}",
            where="corners of the grid",
            remedy="Eastward must be the last axis and northward the first: turn the axis that falls",
        )


def _misplaced(elements: Elements, row: int, latlon: bool, how: str, remedy: str) -> BergError:
    position = place_text(float(elements.lon[row]), float(elements.lat[row]), latlon=latlon)
    return BergError(f"element {elements.id[row]} at {position} lies {how}", where="berg", remedy=remedy)


def haversine(
    lon1: Floats | float, lat1: Floats | float, lon2: Floats | float, lat2: Floats | float, radius: float
) -> Floats:
    """Return great-circle distances.

    ``lon1``, ``lat1``, ``lon2``, ``lat2``: ends, degrees; ``radius``: radius of the sphere, m; returns distances, m: R
    2 atan2(sqrt a, sqrt(1 - a)), a = sin2(dlat/2) + cos lat1 cos lat2 sin2(dlon/2) (equations 10.5).
    """
    phi1, phi2 = np.radians(lat1), np.radians(lat2)
    across = sin_array(0.5 * np.radians(np.subtract(lon2, lon1))) ** 2
    a = sin_array(0.5 * (phi2 - phi1)) ** 2 + cos_array(phi1) * cos_array(phi2) * across
    return np.asarray(2.0 * radius * atan2_array(np.sqrt(a), np.sqrt(np.maximum(1.0 - a, 0.0))))


def cell_areas(lon: Floats, lat: Floats, radius: float, latlon: bool) -> Floats:
    """Return areas (m2) of the cells between corners of shape (n + 1, m + 1); shape (n, m).

    On the sphere edges are straight in longitude and latitude, so that cells of a regular grid have the exact area
    R2 dlon |sin lat_n - sin lat_s| (equations 10.5).
    """
    corners = [(q[:-1, :-1], q[:-1, 1:], q[1:, 1:], q[1:, :-1]) for q in (lon, lat)]
    total = np.zeros_like(corners[0][0])
    for k in range(4):
        x1, x2 = corners[0][k], corners[0][(k + 1) % 4]
        y1, y2 = corners[1][k], corners[1][(k + 1) % 4]
        if latlon:
            # The integral of sin(lat) dlon along an edge that is straight in longitude and latitude; its mean over an edge
            # from y1 to y2 by sinc, which keeps edges along a parallel, 0 / 0, exact.
            turn, half = np.radians((x2 - x1 + 180.0) % 360.0 - 180.0), np.radians(0.5 * (y2 - y1))
            total += turn * sin_array(np.radians(0.5 * (y1 + y2))) * np.sinc(half / np.pi)
        else:
            # About the first corner, so that large coordinates cost no digits.
            total += 0.5 * ((x1 - corners[0][0]) * (y2 - corners[1][0]) - (x2 - corners[0][0]) * (y1 - corners[1][0]))
    return np.abs(total) * (radius**2 if latlon else 1.0)


Staggering = Literal["A", "B", "C"]

ZERO_ON_LAND = (*CORNER_FIELDS, "sst", "sss", "ice_fraction", "ice_thickness")
"""Fields set to 0 in (or at the north-east corner of) land cells (docs/explanation/equations.md, 3.1)."""

KELVIN_ABOVE = 120.0
"""A sea-surface temperature above this, in whatever unit, is taken as kelvin."""


def _shifted(q: Floats, rows: int, columns: int) -> Floats:
    """Value of the cell that many rows north and columns east; beyond the array the last value is repeated."""
    return np.pad(q, ((0, rows), (0, columns)), mode="edge")[rows:, columns:]


def at_corners(u: Floats, v: Floats, grid: Grid, staggering: Staggering) -> tuple[Floats, Floats]:
    """Return a vector field at north-east corners (B-grid) from any of the usual staggerings (equations 3.1)."""
    if staggering == "B":
        return u.copy(), v.copy()
    # 1 at north-east corners that no land cell touches (rule 1).
    mask = grid.arrays.mask
    wet = np.minimum.reduce((mask, _shifted(mask, 0, 1), _shifted(mask, 1, 0), _shifted(mask, 1, 1)))
    if staggering == "C":
        return wet * (0.5 * (u + _shifted(u, 1, 0))), wet * (0.5 * (v + _shifted(v, 0, 1)))
    mean_u, mean_v = (0.25 * ((q + _shifted(q, 1, 1)) + (_shifted(q, 0, 1) + _shifted(q, 1, 0))) for q in (u, v))
    return wet * mean_u, wet * mean_v


def wind_from_stress(tau_x: Floats, tau_y: Floats) -> tuple[Floats, Floats]:
    """Return the wind (m s-1) that the reference makes of a stress: tau / sqrt(0.0015 |tau|) (equations 3.1, quirk Q24)."""
    scale = np.sqrt(STRESS_INVERSION_DRAG * np.sqrt(tau_x**2 + tau_y**2))
    safe = np.where(scale > 0.0, scale, 1.0)
    return np.where(scale > 0.0, tau_x / safe, 0.0), np.where(scale > 0.0, tau_y / safe, 0.0)


def celsius(sst: Floats, mask: Floats) -> Floats:
    """Return a sea-surface temperature in degree Celsius; kelvin is recognised by its size."""
    wet = sst[(mask > 0.5) & np.isfinite(sst)]
    kelvin = wet.size > 0 and float(wet.max()) > KELVIN_ABOVE
    return sst - 273.15 if kelvin else sst.copy()


@kernel
def _is_clean(values: Floats, mask: Floats, zero_on_land: bool) -> bool:
    for j in range(values.shape[0]):
        for i in range(values.shape[1]):
            q = values[j, i]
            if q != q or (zero_on_land and mask[j, i] < 0.5 and q != 0.0):
                return False
    return True


@kernel
def first_gap(values: Floats, mask: Floats, halo: int) -> tuple[int, int]:
    """Return (i, j) of the first cell of the domain, array indices, that is water but holds NaN; else (-1, -1)."""
    for j in range(halo, values.shape[0] - halo):
        for i in range(halo, values.shape[1] - halo):
            if values[j, i] != values[j, i] and mask[j, i] >= 0.5:
                return i, j
    return -1, -1


def usable(values: Floats, mask: Floats, zero_on_land: bool) -> Floats:
    """Return a field as the kernels need it: float64, contiguous, writeable, no NaN, 0 on land where asked.

    The array itself comes back if it is already so.
    """
    q: Floats = np.require(values, dtype=np.float64, requirements=["C", "W"])
    if _is_clean(q, mask, zero_on_land):
        return q
    q = np.where(np.isnan(q), 0.0, q)
    if zero_on_land:
        q[mask < 0.5] = 0.0
    return q
