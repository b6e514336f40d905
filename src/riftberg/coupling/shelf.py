"""Shares of elements in the cells of an ocean grid, and a bonded berg that has the mass of an ice shelf on such cells.

The berg fills the cells of the mask. An element gets the mean thickness of the ice under it, weighted by the areas that it
shares with the cells, so that a slope of the shelf is a slope of the berg. One factor for each piece then makes the mass of
the elements equal to the mass of the cells; it is the misfit of the lattice to the outline, and near 1. Spread back over the
cells the berg weighs as much as the shelf did inside of it; cells at its rim differ, for elements stick out of the mask or
leave a part of it bare. `riftberg.coupling.exchange.Exchange.calve_shelf` lets that rest settle, so that the ocean meets no
jump anywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
import xarray as xr

from riftberg.bergs.iceberg import Iceberg
from riftberg.bergs.lattice import Booleans, fill
from riftberg.bergs.raster import Raster, projection, read_raster, unbroken
from riftberg.bergs.regions import outline_region
from riftberg.compiled.kernels import kernel
from riftberg.config.values import number
from riftberg.errors import BergError, InputError
from riftberg.ocean.grid import Grid
from riftberg.parameters import Packing, Parameters
from riftberg.physics.geometry import separation
from riftberg.physics.spreading import HEXAGON, RECTANGLE, Cells, ElementShapes, add_shares, cover_all, lattice_angle
from riftberg.plane import EqualAreaPlane
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.variables import THICKEST
from riftberg.system.input_files import value_shown


@dataclass(frozen=True)
class Shares:
    """Shares of elements in cells, pair by pair."""

    first: Ints  # Place of the first pair of each element; shape (elements + 1,)
    cells: Ints  # Flat index of the cell in arrays with halo
    shares: Floats  # Part of the element in it; those of an element sum to one
    grid: Grid

    def sum(self, amount: Floats) -> Floats:
        """Return the amount of the elements in each cell of the domain, shape (nj, ni)."""
        area = self.grid.arrays.area
        out = np.zeros(area.size)
        add_shares(self.first, self.cells, self.shares, np.ascontiguousarray(amount, dtype=float), out)
        return out.reshape(area.shape)[self.grid.domain]

    def per_area(self, amount: Floats) -> Floats:
        """Return the amount over the area of each cell."""
        return np.asarray(self.sum(amount) / self.grid.arrays.area[self.grid.domain])

    def mean(self, values: Floats) -> Floats:
        """Return the mean of values of the cells, shape (nj, ni), over each element."""
        flat = self.grid.extended(values, outside="zero").ravel()[self.cells]
        return np.asarray(np.add.reduceat(flat * self.shares, self.first[:-1]))

    def taken(self, rows: Ints) -> Shares:
        """Return the shares of some elements, in that order."""
        counts = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        where = np.repeat(self.first[rows] - first[:-1], counts) + np.arange(first[-1])
        return Shares(first, self.cells[where], self.shares[where], self.grid)


def element_axes(elements: Elements, bonds: Bonds, p: Parameters) -> Floats:
    """Return the axis of each element, rad from east: of its lattice where it has bonds, else its own rotation."""
    earth = p.earth
    unbroken = np.flatnonzero(bonds.status == 0)
    a, b = bonds.first[unbroken], bonds.second[unbroken]
    dx, dy = _apart(elements.lon, elements.lat, a, b, earth.latlon, earth.radius, earth.period)
    angle = np.empty(elements.size)
    folds = 6 if p.bonds.packing == "hexagonal" else 4
    sums = np.zeros((2, elements.size))
    lattice_angle(a, b, bonds.status[unbroken], dx, dy, folds, sums, elements.motion.rotation, angle)
    return angle


@kernel
def _apart(
    lon: Floats, lat: Floats, first: Ints, second: Ints, latlon: bool, radius: float, period: float
) -> tuple[Floats, Floats]:
    """Return the way (m) from the first to the second end of each bond."""
    dx, dy = np.empty(first.size), np.empty(first.size)
    for k in range(first.size):
        a, b = first[k], second[k]
        dx[k], dy[k] = separation(lon[b], lat[b], lon[a], lat[a], latlon, radius, period)
    return dx, dy


def compute_shares(elements: Elements, bonds: Bonds, grid: Grid, p: Parameters) -> Shares:
    """Return the exact shares of all elements: elements of a hexagonal lattice are hexagons, all others rectangles."""
    g, place, body = grid.arrays, elements.place, elements.body
    shape = HEXAGON if p.bonds.packing == "hexagonal" and p.bonds.law != "none" else RECTANGLE
    angle = element_axes(elements, bonds, p)
    bergs = ElementShapes(place.lon, place.lat, place.cell_i, place.cell_j, shape, body.length, body.width, angle)
    on = Cells(g.lon, g.lat, g.mask, g.ni, g.nj, g.halo, g.latlon, g.cyclic, grid.earth_radius, g.period)
    room = 2 * elements.size + 64  # most elements lie in one cell or two; if these are too few, they are counted
    while True:
        first = np.zeros(elements.size + 1, np.int64)
        cells, shares = np.zeros(room, np.int64), np.zeros(room)
        count = cover_all(bergs, on, first, cells, shares)
        if count <= room:
            return Shares(first, cells[:count], shares[:count], grid)
        room = math.ceil(1.2 * count)


HALF: Final = 0.5
"""Cells of which more than this part is ice belong to the outline; the mass counts all parts."""

WHOLE: Final = 0.995
"""Cells of which ice and elements cover more than this part lie inside of the berg."""

_FINE: Final = 0.05
"""Sides of cells are cut to this length (degrees) before they are laid flat: parallels are bent there."""


@dataclass(frozen=True)
class IceShelf:
    """Ice of a shelf on cells, as far as it calves; make one with `IceShelf.of` or `IceShelf.from_raster`.

    Attributes
    ----------
    grid : Grid
        The cells.
    part : array, shape (nj, ni)
        Part of each cell that is ice which calves, 0 to 1.
    thickness : array, shape (nj, ni)
        Of that ice, m; 0 where there is none.
    density : float
        Of ice, kg m-3, as in the run.

    Examples
    --------
    >>> import numpy as np
    >>> from riftberg import ocean_grid
    >>> lon, lat = np.meshgrid(np.linspace(-62.0, -58.0, 41), np.linspace(-69.0, -67.0, 41))
    >>> mask = np.zeros((40, 40))
    >>> mask[10:30, 12:28] = 1.0
    >>> shelf = IceShelf.of(ocean_grid(lon, lat), mask, 250.0)
    >>> berg = shelf.berg(radius=2000.0)
    >>> abs(float(berg.elements.mass.sum() / shelf.mass.sum()) - 1.0) < 1e-13
    True
    """

    grid: Grid
    part: Floats
    thickness: Floats
    density: float = 850.0

    @classmethod
    def of(cls, grid: Grid, mask: Any, thickness: Any, density: float = 850.0) -> IceShelf:
        """Return the shelf on a grid.

        Parameters
        ----------
        grid : Grid
            Cells (`riftberg.coupling.exchange.ocean_grid`); whether they are ocean or land does not matter.
        mask : array, shape (nj, ni)
            Part of each cell that is ice which calves, 0 to 1, or true and false.
        thickness : float or array, shape (nj, ni)
            m; may be anything outside of the mask.
        density : float, optional
            Of ice, kg m-3.

        Raises
        ------
        InputError
            If shapes or values cannot be, naming the cell.
        """
        shape = grid.arrays.nj, grid.arrays.ni
        fraction, height = _on_cells(mask, "mask", shape), _on_cells(thickness, "thickness", shape)
        _check(fraction, height)
        fraction = np.nan_to_num(fraction)
        return cls(grid, fraction, np.where(fraction > 0.0, height, 0.0), number(density, "kg m-3", where="density"))

    @classmethod
    def from_raster(
        cls, thickness: Any, mask: Any = None, *, variable: str | None = None, mask_variable: str | None = None,
        date: str | None = None, crs: str | None = None, density: float = 850.0, earth_radius: float | None = None,
    ) -> IceShelf:  # fmt: skip
        """Return the shelf of a map of thickness and a mask, on longitudes and latitudes or in a map projection.

        Parameters
        ----------
        thickness : path, DataArray, Dataset or Raster
            Map, m; values stand in the middle of their cells.
        mask : path, DataArray, Dataset or Raster, optional
            Part of each cell that calves, on the same grid. Without it all cells with a thickness above 0.
        variable, mask_variable, date : str, optional
            Which variables and time of files that hold several.
        crs : str, optional
            Coordinate system of x and y in m, such as ``"EPSG:3031"``; a GeoTIFF says its own.
        density : float, optional
            Of ice, kg m-3.
        earth_radius : float, optional
            Of the sphere, m; by default as in the A68a experiment.
        """
        height = _raster(thickness, variable, date)
        if crs is not None:
            height = replace(height, crs=crs)
        fraction = replace(height, values=(height.values > 0.0).astype(float))
        if mask is not None:
            fraction = replace(_raster(mask, mask_variable, date), crs=height.crs)
            if height.values.shape != fraction.values.shape or not (
                np.allclose(height.lon, fraction.lon) and np.allclose(height.lat, fraction.lat)
            ):
                raise InputError(
                    f"another grid than that of the thickness ({height.name})", where=fraction.name,
                    remedy="Bring mask and thickness to the same cells",
                )  # fmt: skip
        icy = np.nan_to_num(fraction.values) > 0.0
        if not icy.any():
            raise InputError("no ice: the mask is 0 everywhere", where=fraction.name)
        # Both maps are cut around the ice that calves, with a ring of cells, their longitudes in one go.
        height, fraction = unbroken(height, icy), unbroken(fraction, icy)
        calves = np.nonzero(np.nan_to_num(fraction.values) > 0.0)
        rows, columns = (slice(max(int(k.min()) - 1, 0), int(k.max()) + 2) for k in calves)
        height, fraction = (
            replace(map_, lon=map_.lon[columns], lat=map_.lat[rows], values=map_.values[rows, columns])
            for map_ in (height, fraction)
        )
        return cls.of(_cells(height, earth_radius), fraction.values, height.values, density)

    @property
    def mass(self) -> Floats:
        """Ice of each cell, kg."""
        return self.density * self.part * self.thickness * self.grid.arrays.area[self.grid.domain]

    def berg(
        self, *, radius: float = 1500.0, packing: Packing = "square", velocity: tuple[float, float] = (0.0, 0.0)
    ) -> Iceberg:
        """Return a berg of bonded elements with the mass of the shelf; pieces that do not touch are not bonded.

        Its report says by which factors thicknesses were changed to that end (``thickness_factor``), and by how much the mass on
        cells that lie wholly under it differs from the shelf, relative to it (``misfit_inside``; `misfit` for all cells).

        Parameters
        ----------
        radius : float
            Half the width of an element, m.
        packing : {"square", "hexagonal"}
        velocity : tuple of float
            m s-1; a shelf is at rest.

        Raises
        ------
        BergError
            If a piece is smaller than an element.
        """
        marked = self.part > HALF
        if not marked.any():
            raise BergError("no cell is more than half of ice that calves", where="ice shelf, mask")
        geometry = self._outline(marked)
        options: Any = {"radius": radius, "packing": packing, "velocity": velocity, "density": self.density}
        berg = self._filled(geometry, options)
        shares = self._shares(berg, self.part > 0.0)
        # Thickness by the cells under each element first, then one factor for each piece, so that the mass is right.
        mean = shares.mean(self.thickness)
        piece, factor = self._weighed(berg.elements, mean, geometry)
        elements = berg.elements.copy()
        elements.body.thickness[:] = factor[piece] * mean
        area = elements.body.length * elements.body.width
        elements.body.mass[:] = self.density * elements.body.thickness * area
        finished = replace(berg, elements=elements)
        per_area = self.mass / self.grid.arrays.area[self.grid.domain]
        # Cells at the edge are left out: there the lattice cannot follow the outline.
        inside = (self.part > WHOLE) & (self._shares(berg, self.part >= 0.0).per_area(area) > WHOLE)
        off = np.abs(self.misfit(finished)[inside]) / per_area[inside]
        report = {
            **berg.report, "source": "ice shelf", "shelf_mass": float(self.mass.sum()),
            "thickness_factor": factor.tolist(), "misfit_inside": float(off.max(initial=0.0)),
        }  # fmt: skip
        return replace(finished, report=report)

    def misfit(self, berg: Iceberg) -> Floats:
        """Return the excess of the berg, spread over the cells, over the shelf on each, kg m-2; its sum by area is 0."""
        spread = self._shares(berg, np.ones(self.part.shape, bool)).sum(berg.elements.body.mass)
        return np.asarray((spread - self.mass) / self.grid.arrays.area[self.grid.domain])

    def _outline(self, marked: Booleans) -> Any:
        """Return the union of cells; longitudes are near the first cell."""
        g = self.grid.arrays
        j, i = (k + g.halo for k in np.nonzero(marked))
        # Rings are closed: the first corner stands at the end again.
        corners = [(j - 1, i - 1), (j - 1, i), (j, i), (j, i - 1), (j - 1, i - 1)]
        ring = np.stack([np.stack([g.lon[at], g.lat[at]], axis=-1) for at in corners], axis=1)
        if g.period > 0.0:
            ring[..., 0] -= g.period * np.round((ring[:, :1, 0] - ring[0, 0, 0]) / g.period)
        outline = shapely.union_all(shapely.polygons(ring), grid_size=1e-9 if g.latlon else 1e-6)
        return shapely.segmentize(outline, _FINE) if g.latlon else outline

    def _filled(self, geometry: Any, options: dict[str, Any]) -> Iceberg:
        """Return elements in the outline, of one thickness."""
        height = float(self.thickness.max())
        if self.grid.arrays.latlon:
            return Iceberg.from_outline(geometry, thickness=height, earth_radius=self.grid.earth_radius, **options)
        region = outline_region(geometry, EqualAreaPlane(0.0, 0.0, self.grid.earth_radius, False))
        lattice, radius = fill(region, options["radius"], options["packing"])
        options = {**options, "radius": radius}
        return Iceberg.from_points(
            lattice.x, lattice.y, thickness=height, latlon=False, pieces=region.piece_numbers(lattice), **options
        )

    def _shares(self, berg: Iceberg, marked: Booleans) -> Shares:
        """Return the shares of elements in some of the cells."""
        # Shares fall on marked cells alone: ice goes back to cells of the shelf, not to the sea beside it.
        mask = self.grid.extended(marked.astype(float), outside="zero")
        cells = Grid(self.grid.arrays._replace(mask=mask), self.grid.earth_radius)
        cells.bergs_on_land = True
        elements = berg.elements.copy()
        cells.locate(elements)
        p = Parameters(bonds={"packing": berg.packing}, earth={"latlon": berg.latlon, "radius": berg.earth_radius})
        return compute_shares(elements, berg.bonds, cells, p)

    def _weighed(self, elements: Elements, mean: Floats, geometry: Any) -> tuple[Ints, Floats]:
        """Return the piece of each element, and for each piece the factor that gives it the mass of its cells."""
        count = len(getattr(geometry, "geoms", [geometry]))
        body, place, g, domain = elements.body, elements.place, self.grid.arrays, self.grid.domain
        nearest = self._nearest_piece(place.lon, place.lat, geometry)
        has = np.bincount(nearest, self.density * mean * body.length * body.width, count)
        if (has == 0.0).any():
            raise BergError(
                f"piece {int(np.argmin(has)) + 1} of {count} of the ice shelf is smaller than an element",
                where="ice shelf, mask", remedy="Give a smaller radius, or leave that piece out of the mask",
            )  # fmt: skip
        # Cells with little ice lie outside of the outline; they count to the nearest piece.
        ice = self.part > 0.0
        piece = self._nearest_piece(g.lon_centre[domain][ice], g.lat_centre[domain][ice], geometry)
        return nearest, np.bincount(piece, self.mass[ice], count) / has

    def _nearest_piece(self, lon: Floats, lat: Floats, geometry: Any) -> Ints:
        """Return the number of the piece, from 0, that is nearest to each point."""
        if self.grid.arrays.period > 0.0:
            turns = np.round((lon - geometry.centroid.x) / self.grid.arrays.period)
            lon = lon - turns * self.grid.arrays.period
        points = shapely.points(lon, lat)
        distances = [shapely.distance(points, piece) for piece in getattr(geometry, "geoms", [geometry])]
        return np.asarray(np.argmin(distances, axis=0), np.int64)


def _on_cells(values: Any, name: str, shape: tuple[int, int]) -> Floats:
    try:
        array = np.asarray(values, dtype=float)
        return np.array(np.broadcast_to(array, shape))
    except (TypeError, ValueError) as error:
        fault = f"shape {np.shape(values)}" if np.ndim(values) else value_shown(values)
        raise InputError(
            f"{fault}, where the grid has {shape[0]} x {shape[1]} cells",
            where=f"ice shelf, {name}",
            remedy="Give one number for each cell",
        ) from error


def _check(fraction: Floats, thickness: Floats) -> None:
    """Refuse parts and thicknesses that cannot be."""
    marked = np.nan_to_num(fraction) > 0.0
    with np.errstate(invalid="ignore"):
        odd = np.isfinite(fraction) & ((fraction < 0.0) | (fraction > 1.0)) | np.isinf(fraction)
        thin = marked & ~((thickness > 0.0) & (thickness <= THICKEST))
    for bad, values, name, remedy in (
        (odd, fraction, "mask", "Give the part of the cell that calves, from 0 to 1"),
        (thin, thickness, "thickness", f"Give metres, above 0 and up to {THICKEST:g}, in all cells of the mask"),
    ):
        if bad.any():
            j, i = np.argwhere(bad)[0]
            raise InputError(
                f"{name} is {values[j, i]:g} in cell ({i + 1}, {j + 1}) ({int(bad.sum())} such cells)",
                where="ice shelf", remedy=remedy,
            )  # fmt: skip
    if not marked.any():
        raise InputError("no ice: the mask is 0 everywhere", where="ice shelf, mask")


def _raster(source: Any, variable: str | None, date: str | None) -> Raster:
    if not isinstance(source, Raster | str | Path | xr.DataArray | xr.Dataset):
        raise InputError(
            f"{value_shown(source)} is no map", where="ice shelf",
            remedy="Give a file, a DataArray or a Dataset; or arrays on a grid to IceShelf.of",
        )  # fmt: skip
    return source if isinstance(source, Raster) else read_raster(source, variable, date=date)


def _edges(middle: Floats) -> Floats:
    """Return the edges between values that stand in the middle of their cells."""
    half = 0.5 * np.diff(middle)
    return np.concatenate([[middle[0] - half[0]], middle[:-1] + half, [middle[-1] + half[-1]]])


def _cells(raster: Raster, earth_radius: float | None) -> Grid:
    """Return the cells of a map as a grid of longitude and latitude."""
    x, y = np.meshgrid(_edges(raster.lon), _edges(raster.lat))
    if raster.crs is not None:
        x, y = projection(raster.crs).transform(x, y, direction="INVERSE")
    elif np.abs(raster.lat).max() > 90.0:
        raise InputError(
            f"latitude {raster.lat[np.argmax(np.abs(raster.lat))]:g}",
            where=raster.name,
            remedy="Name the coordinate system of x and y in m with crs, such as EPSG:3031",
        )
    if raster.crs is not None:
        # Round a pole longitudes jump along rows and along columns.
        x = np.unwrap(np.unwrap(x, period=360.0, axis=1), period=360.0, axis=0)
    options: Any = {} if earth_radius is None else {"radius_for_metrics": earth_radius}
    return Grid.from_corners(x, y, regular=raster.crs is None, includes_southwest=True, cyclic=False, **options)
