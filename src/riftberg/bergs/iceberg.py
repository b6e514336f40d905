"""The iceberg that a run starts from: elements, the bonds between them, and a report of how it was made."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from riftberg.bergs import outline as outlines
from riftberg.bergs import report as reports
from riftberg.bergs import rifts
from riftberg.bergs.assembly import make_elements, radius_of, refuse_overlap, thickness_at
from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.bergs.lattice import cells_of_rows, cells_region, fill, rectangle_region
from riftberg.bergs.makeberg import makeberg_lattice
from riftberg.bergs.placement import Plane, ReferencePlane, TangentPlane, relax, turned
from riftberg.bergs.raster import Raster, read_raster
from riftberg.bergs.regions import mask_region, outline_region
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.state import Bonds, Elements, copy_state


@dataclass(frozen=True)
class Iceberg:
    """A lattice of ice columns joined by bonds.

    Attributes
    ----------
    elements, bonds : Elements, Bonds
        The state at the start.
    packing : {"square", "hexagonal"}
        Packing of the lattice.
    radius : float
        Radius of the inscribed circle of an element (mean), m.
    report : dict
        How the berg was made: source, outline area (m2), relative error of the lattice's area, seeds.
    latlon : bool
        Whether positions are degrees.
    earth_radius : float
        Radius of the sphere, m.
    density : float
        Ice density, kg m-3.
    """

    elements: Elements
    bonds: Bonds
    packing: Packing
    radius: float
    report: dict[str, Any] = field(default_factory=dict)
    latlon: bool = True
    earth_radius: float = EARTH_RADIUS_A68
    density: float = 850.0

    @classmethod
    def from_outline(
        cls,
        source: Any,
        *,
        thickness: Any,
        radius: float = 1500.0,
        packing: Packing = "square",
        density: float = 850.0,
        velocity: tuple[float, float] = (0.0, 0.0),
        spin: float = 0.0,
        feature: int | str | None = None,
        date: str | None = None,
        crs: str | None = None,
        rotation: float = 0.0,
        shift: tuple[float, float] = (0.0, 0.0),
        placement: tuple[float, float] | None = None,
        offset: tuple[float, float] | None = None,
        conformal: bool = True,
        repair: bool = False,
        earth_radius: float = EARTH_RADIUS_A68,
    ) -> Iceberg:
        """Fill an outline with elements.

        Parameters
        ----------
        source : path, geometry, dict or array_like
            GeoJSON, shapefile, CSV (columns lon and lat; optionally date, id, ring), KML; a shapely geometry; an array
            (n, 2) of longitude and latitude. See `riftberg.bergs.outline.read_features`.
        thickness : float, path, DataArray or Raster
            Ice thickness, m; a map is sampled where the outline was drawn, before rotation and shift.
        radius : float
            Radius of the inscribed circle of an element, m.
        packing : {"square", "hexagonal"}
            Packing.
        density : float
            Ice density, kg m-3.
        velocity : tuple of float
            Eastward and northward velocity, m s-1.
        spin : float
            Angular velocity, rad s-1, counter-clockwise.
        feature, date : optional
            Which outline of a file that holds several: number or property value; date as text.
        crs : str, optional
            Coordinate system of projected coordinates, for example ``"EPSG:3031"``.
        rotation : float
            Degrees by which the finished berg is turned counter-clockwise about its centroid.
        shift : tuple of float
            Degrees of longitude and latitude by which it is moved.
        placement : tuple of float, optional
            Longitude and latitude of the outline's centroid, instead of where it was drawn.
        offset : tuple of float, optional
            Shift of the lattice as parts of its pitch; by default that with the smallest error of area.
        conformal : bool
            Lay the lattice out so that bonds start without strain; False is the rule of the reference (spec 8.3.8).
        repair : bool
            Mend an outline that crosses itself instead of refusing it.
        earth_radius : float
            Radius of the sphere, m. The report gives areas on this sphere, not on the ellipsoid of a chart
            (0.7 % less at 55 S for the radius of the A68a experiment).

        Raises
        ------
        BergError
            If the outline cannot be read, chosen or filled.
        """
        where = str(source) if isinstance(source, str) or hasattr(source, "__fspath__") else type(source).__name__
        chosen = outlines.select_outline(outlines.read_features(source, crs), where=where, feature=feature, date=date)
        geometry = outlines.check_outline(chosen.geometry, where=f"{where} ({chosen.label()})", repair=repair)
        plane: Plane = _plane(geometry.bounds, (geometry.centroid.x, geometry.centroid.y), conformal, earth_radius)
        region = outline_region(geometry, plane)
        lattice = fill(region, radius, packing, offset)
        centre = plane.forward(np.array([geometry.centroid.x]), np.array([geometry.centroid.y]))
        heights = thickness_at(thickness, *plane.inverse(lattice.x, lattice.y), read_raster)
        moved = _moved(plane, (geometry.centroid.x, geometry.centroid.y), placement, shift)
        x, y = turned(lattice.x - centre[0], lattice.y - centre[1], rotation)
        report = {"source": where, "feature": chosen.label(), "outline_area": region.area}
        return cls._placed(
            x + centre[0],
            y + centre[1],
            moved,
            radius=radius,
            packing=packing,
            thickness=heights,
            density=density,
            velocity=velocity,
            spin=spin,
            conformal=conformal,
            earth_radius=earth_radius,
            report=report,
        )

    @classmethod
    def from_mask(
        cls,
        source: Any,
        *,
        thickness: Any = None,
        variable: str | None = None,
        threshold: float | None = None,
        date: str | None = None,
        radius: float = 1500.0,
        packing: Packing = "square",
        density: float = 850.0,
        velocity: tuple[float, float] = (0.0, 0.0),
        spin: float = 0.0,
        rotation: float = 0.0,
        shift: tuple[float, float] = (0.0, 0.0),
        placement: tuple[float, float] | None = None,
        offset: tuple[float, float] | None = None,
        conformal: bool = True,
        rules: Literal["lattice", "makeberg"] = "lattice",
        reference_latitude: float | None = None,
        spacing: float = 500.0,
        earth_radius: float = EARTH_RADIUS_A68,
    ) -> Iceberg:
        """Fill a gridded mask or a gridded thickness with elements.

        Parameters
        ----------
        source : path, DataArray, Dataset or Raster
            Grid with one-dimensional longitude and latitude.
        thickness : float, path, DataArray or Raster, optional
            Ice thickness, m. By default the values of ``source`` itself are thicknesses.
        variable, date : str, optional
            Which variable and time of the file.
        threshold : float, optional
            Bilinear value above which a point is ice; 0.5 for masks, 0 where ``source`` is a thickness.
        rules : {"lattice", "makeberg"}
            ``"makeberg"``: exactly the elements of the reference's script (spec 10.5); it implies ``conformal=False``,
            longitudes from 0 to 360, and neither rotation, placement nor offset.
        reference_latitude, spacing : float
            For ``"makeberg"``: latitude that scales longitudes, and spacing (m) of the resampled mask.
        radius, packing, density, velocity, spin, rotation, shift, placement, offset, conformal, earth_radius
            As in `from_outline`.
        """
        mask = source if isinstance(source, Raster) else read_raster(source, variable, date=date)
        threshold = (0.0 if thickness is None else 0.5) if threshold is None else threshold
        if rules == "makeberg":
            lattice, plane = makeberg_lattice(
                mask,
                radius,
                packing,
                spacing=spacing,
                reference_latitude=reference_latitude,
                threshold=threshold,
                shift=shift,
                earth_radius=earth_radius,
            )
            # The script pairs mask points with positions half a cell further south-west; thickness follows the mask.
            lon, lat = plane.inverse(lattice.x, lattice.y)
            heights = thickness_at(
                mask if thickness is None else thickness, lon - shift[0], lat - shift[1], read_raster
            )
            return cls._placed(
                lattice.x,
                lattice.y,
                plane,
                radius=radius,
                packing=packing,
                thickness=heights,
                density=density,
                velocity=velocity,
                spin=spin,
                conformal=False,
                earth_radius=earth_radius,
                report={"source": mask.name, "rules": "makeberg"},
            )
        region, plane_of, centroid = mask_region(mask, threshold, lambda b, c: _plane(b, c, conformal, earth_radius))
        lattice = fill(region, radius, packing, offset)
        heights = thickness_at(
            mask if thickness is None else thickness, *plane_of.inverse(lattice.x, lattice.y), read_raster
        )
        cx, cy = plane_of.forward(np.array([centroid[0]]), np.array([centroid[1]]))
        x, y = turned(lattice.x - cx, lattice.y - cy, rotation)
        return cls._placed(
            x + cx,
            y + cy,
            _moved(plane_of, centroid, placement, shift),
            radius=radius,
            packing=packing,
            thickness=heights,
            density=density,
            velocity=velocity,
            spin=spin,
            conformal=conformal,
            earth_radius=earth_radius,
            report={"source": mask.name, "outline_area": region.area},
        )

    @classmethod
    def from_table(
        cls,
        rows: list[tuple[int, int, int]],
        *,
        thickness: Any,
        placement: tuple[float, float],
        table_radius: float = 1500.0,
        radius: float | None = None,
        packing: Packing = "square",
        density: float = 850.0,
        velocity: tuple[float, float] = (0.0, 0.0),
        spin: float = 0.0,
        rotation: float = 0.0,
        conformal: bool = True,
        latlon: bool = True,
        earth_radius: float = EARTH_RADIUS_A68,
    ) -> Iceberg:
        """Build a berg from the rows of a square lattice.

        Parameters
        ----------
        rows : list of tuple of int
            (row, first column, last column), rows from south to north, columns from west to east; a row may be split.
        placement : tuple of float
            Longitude and latitude (x and y in m if not ``latlon``) of the centroid.
        table_radius : float
            Half the side (m) of a cell of the table.
        radius : float, optional
            Radius of the elements, m; another than ``table_radius`` fills the union of the table's cells anew.
        thickness, packing, density, velocity, spin, rotation, conformal, latlon, earth_radius
            As in `from_outline`; ``thickness`` may be one value per element.
        """
        radius = table_radius if radius is None else radius
        column, row = cells_of_rows(rows)
        region = cells_region(column, row, 2.0 * table_radius)
        lattice = fill(region, radius, packing)
        centre = (2.0 * table_radius * (column.mean() + 0.5), 2.0 * table_radius * (row.mean() + 0.5))
        x, y = turned(lattice.x - centre[0], lattice.y - centre[1], rotation)
        return cls._about(
            x,
            y,
            placement,
            radius=radius,
            packing=packing,
            thickness=thickness,
            density=density,
            velocity=velocity,
            spin=spin,
            conformal=conformal,
            latlon=latlon,
            earth_radius=earth_radius,
            report={"source": "table of lattice rows", "outline_area": region.area},
        )

    @classmethod
    def rectangle(
        cls,
        length: float,
        width: float,
        *,
        thickness: Any,
        placement: tuple[float, float] = (0.0, 0.0),
        radius: float = 1500.0,
        packing: Packing = "square",
        density: float = 850.0,
        velocity: tuple[float, float] = (0.0, 0.0),
        spin: float = 0.0,
        rotation: float = 0.0,
        offset: tuple[float, float] | None = None,
        conformal: bool = True,
        latlon: bool = True,
        earth_radius: float = EARTH_RADIUS_A68,
    ) -> Iceberg:
        """Build an idealised rectangular berg.

        Parameters
        ----------
        length, width : float
            Extents (m) along x (east) and y (north) before rotation.
        placement : tuple of float
            Longitude and latitude (x and y in m if not ``latlon``) of the centre.
        thickness, radius, packing, density, velocity, spin, rotation, offset, conformal, latlon, earth_radius
            As in `from_outline`; ``thickness`` may be one value per element.
        """
        region = rectangle_region(length, width)
        lattice = fill(region, radius, packing, offset)
        x, y = turned(lattice.x, lattice.y, rotation)
        return cls._about(
            x,
            y,
            placement,
            radius=radius,
            packing=packing,
            thickness=thickness,
            density=density,
            velocity=velocity,
            spin=spin,
            conformal=conformal,
            latlon=latlon,
            earth_radius=earth_radius,
            report={"source": f"rectangle {length:g} m x {width:g} m", "outline_area": region.area},
        )

    @classmethod
    def from_points(
        cls,
        lon: Any,
        lat: Any,
        *,
        thickness: Any,
        radius: Any = 1500.0,
        packing: Packing = "square",
        density: float = 850.0,
        velocity: tuple[Any, Any] = (0.0, 0.0),
        spin: float = 0.0,
        static: Any = False,
        bond_length: float | None = None,
        latlon: bool = True,
        period: float = 0.0,
        earth_radius: float = EARTH_RADIUS_A68,
    ) -> Iceberg:
        """Build a berg from the positions of its elements, which stay exactly where they are.

        Parameters
        ----------
        lon, lat : array_like
            Positions, degrees (m if not ``latlon``).
        thickness, radius : float or array_like
            Thickness and radius, m.
        velocity : tuple of float or array_like
            Eastward and northward velocity, m s-1.
        static : bool or array_like
            Elements that never move.
        bond_length : float, optional
            Bond elements closer than this (m) instead of closer than 1.25 (R1 + R2).
        period : float
            Zonal period in degrees (m if not ``latlon``); 0 if there is none.
        packing, density, spin, latlon, earth_radius
            As in `from_outline`.
        """
        lon, lat = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (lon, lat))
        if lon.shape != lat.shape or lon.ndim != 1:
            raise BergError(f"lon has shape {lon.shape}, lat {lat.shape}", remedy="Give two lists of equal length")
        elements = make_elements(
            lon,
            lat,
            radius=radius,
            packing=packing,
            thickness=thickness,
            density=density,
            velocity=velocity,
            spin=spin,
            static=static,
            latlon=latlon,
        )
        metric = Metric(latlon, earth_radius, period)
        refuse_overlap(elements, packing, metric)
        bonds = form_bonds(elements, BondRule(bond_length, packing), metric)
        rifts.number_pieces(elements, bonds)
        return cls(
            elements, bonds, packing, float(np.mean(radius)), {"source": "points"}, latlon, earth_radius, density
        )

    @classmethod
    def _about(
        cls,
        x: Any,
        y: Any,
        placement: tuple[float, float],
        *,
        conformal: bool,
        latlon: bool,
        earth_radius: float,
        **body: Any,
    ) -> Iceberg:
        """Place points given about the origin around a centre."""
        if not latlon:
            report = body.pop("report")
            berg = cls.from_points(x + placement[0], y + placement[1], latlon=False, earth_radius=earth_radius, **body)
            return berg._reported(report)
        plane: Plane = TangentPlane(*placement, earth_radius)
        if not conformal:
            plane = ReferencePlane(*placement, placement[1], earth_radius)
        return cls._placed(x, y, plane, conformal=conformal, earth_radius=earth_radius, **body)

    @classmethod
    def _placed(
        cls, x: Any, y: Any, plane: Plane, *, conformal: bool, earth_radius: float, report: dict[str, Any], **body: Any
    ) -> Iceberg:
        """Bring plane points to the sphere, without strain if ``conformal``."""
        lon, lat = plane.inverse(x, y)
        berg = cls.from_points(lon, lat, earth_radius=earth_radius, **body)
        if conformal and len(berg.bonds.first):
            rest = np.full(len(berg.bonds.first), 2.0 * berg.radius)
            lon, lat = relax(lon, lat, berg.bonds.first, berg.bonds.second, rest, Metric(True, earth_radius))
            berg = cls.from_points(lon, lat, earth_radius=earth_radius, **body)
        return berg._reported(report)

    def _reported(self, report: dict[str, Any]) -> Iceberg:
        """Return the berg with this report, completed by the error of its area."""
        full = dict(report)
        if "outline_area" in report:
            full["area_error"] = self.area / report["outline_area"] - 1.0
        return replace(self, report=full)

    @property
    def area(self) -> float:
        """Area of all elements, m2."""
        return float(np.sum(self.elements.length * self.elements.width))

    @property
    def mass(self) -> float:
        """Mass of all elements, kg."""
        return float(self.elements.mass.sum())

    @property
    def centroid(self) -> tuple[float, float]:
        """Mass-weighted mean longitude and latitude (degrees; m if not ``latlon``)."""
        share = self.elements.mass / self.elements.mass.sum()
        return float(share @ self.elements.lon), float(share @ self.elements.lat)

    @property
    def initial_strain(self) -> float:
        """Largest elongation or shortening of a bond relative to R1 + R2 (negative if shortening is larger)."""
        intact = self.bonds.status == 0
        if not intact.any():
            return 0.0
        radius = radius_of(self.elements, self.packing)
        rest = (radius[self.bonds.first] + radius[self.bonds.second])[intact]
        strain = self.bonds.bond_length[intact] / rest - 1.0
        return float(strain[np.argmax(np.abs(strain))])

    def describe(self) -> str:
        """Return what the berg is, in plain words."""
        return reports.describe(self)

    def with_rifts(
        self, rift: Any, *, strength: float = 0.0, broken: bool = False, crs: str | None = None, threshold: float = 0.5
    ) -> Iceberg:
        """Return the berg with weakened or removed bonds along rifts.

        Parameters
        ----------
        rift : array_like, list of array_like, path, geometry, DataArray or Raster
            Lines as arrays (n, 2) of longitude and latitude, a file or geometry of lines, or a gridded mask.
        strength : float
            Factor from 0 to 1 on the strength of the crossed bonds.
        broken : bool
            Remove the crossed bonds instead; their ``break_time`` stays NaN, for they never existed in the run.
        crs : str, optional
            Coordinate system of projected lines.
        threshold : float
            Value of a mask above which there is a rift.

        Raises
        ------
        BergError
            If no bond is crossed.
        """
        elements, bonds = copy_state(self.elements, self.bonds)
        crossed = rifts.crossed_by(elements, bonds, rift, latlon=self.latlon, crs=crs, threshold=threshold)
        rifts.weaken(elements, bonds, crossed, strength=strength, broken=broken)
        made = {"crossed": int(crossed.sum()), "broken": broken, "strength": 0.0 if broken else strength}
        report = {**self.report, "rifts": [*self.report.get("rifts", []), made]}
        return replace(self, elements=elements, bonds=bonds, report=report)

    def with_strength(
        self,
        distribution: rifts.Distribution = "weibull",
        *,
        shape: float | None = None,
        spread: float | None = None,
        seed: int | None = None,
    ) -> Iceberg:
        """Return the berg with scattered bond strengths of mean 1; see `riftberg.bergs.rifts.scatter`.

        Parameters
        ----------
        distribution : {"weibull", "normal", "uniform"}
            Distribution.
        shape, spread : float, optional
            Weibull modulus; standard deviation or half width.
        seed : int, optional
            Seed. One is drawn if none is given; the report names it, so that every berg can be made again.
        """
        seed = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
        elements, bonds = copy_state(self.elements, self.bonds)
        bonds.strength[:] *= rifts.scatter(len(bonds.first), distribution, shape=shape, spread=spread, seed=seed)
        made = {"distribution": distribution, "shape": shape, "spread": spread, "seed": seed}
        return replace(self, elements=elements, bonds=bonds, report={**self.report, "scatter": made})


def _plane(
    bounds: tuple[float, float, float, float], centroid: tuple[float, float], conformal: bool, earth_radius: float
) -> Plane:
    """Return the plane in which a figure of these bounds and centroid (degrees) is filled."""
    if conformal:
        return TangentPlane(*centroid, earth_radius)
    west, south, _, north = bounds
    return ReferencePlane(west, south, 0.5 * (south + north), earth_radius)


def _moved(
    plane: Plane, centroid: tuple[float, float], placement: tuple[float, float] | None, shift: tuple[float, float]
) -> Plane:
    """Return the plane after a move of the centroid (degrees) to ``placement`` and by ``shift``."""
    target = centroid if placement is None else placement
    return plane.moved(target[0] - centroid[0] + shift[0], target[1] - centroid[1] + shift[1])
