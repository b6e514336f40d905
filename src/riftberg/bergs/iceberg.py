"""The iceberg that a run starts from, and the ways to make one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from typing import Any, Final, Literal, Unpack

import numpy as np
import shapely
import shapely.affinity

from riftberg.bergs import outline as outlines
from riftberg.bergs.bonded import BondedBerg, check_seed, join
from riftberg.bergs.bonding import (
    BondRule,
    Metric,
    form_bonds,
    make_elements,
    number_pieces,
    refuse_overlap,
    sample_thickness,
    separations,
    turn_rigidly,
    within_pieces,
)
from riftberg.bergs.keys import (
    BergOptions,
    CloudOfBergs,
    CloudOptions,
    FieldOfBergs,
    FieldOptions,
    LatticeRows,
    PointOptions,
    Rectangle,
    ShapeOptions,
    TableOptions,
    berg_options,
)
from riftberg.bergs.lattice import (
    Lattice,
    Region,
    cells_region,
    element_area,
    expand_rows,
    fill,
    is_lone,
    lone_element,
    rectangle_region,
)
from riftberg.bergs.raster import Raster, check_on_globe, read_raster, unbroken
from riftberg.bergs.regions import (
    FillingPlane,
    IceMask,
    ReferencePlane,
    filling_plane,
    ice_cells,
    makeberg_lattice,
    mask_region,
    move_centroid,
    outline_region,
    relax,
    turned,
)
from riftberg.config.values import check_place, flag, given, moment, native, number, numbers
from riftberg.constants import DEGREE
from riftberg.errors import BergError, InputError, placed_in
from riftberg.plane import EqualAreaPlane, near
from riftberg.state import Floats
from riftberg.system.input_files import check_elements, value_shown


@dataclass(frozen=True, repr=False, eq=False)
class Iceberg(BondedBerg):
    """A lattice of ice columns joined by bonds, made from an outline, a mask, a table, points or a rectangle.

    Attributes
    ----------
    elements : Elements
        The elements at the start.
    bonds : Bonds
        The bonds at the start.
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
    bergs : tuple of (str, int)
        Name and number of elements of each berg, in the order of the rows; empty for one without a name.
    outlines : tuple of shapely polygons
        Outline of the ice in the coordinates of the elements, where one is known; elastic cells fill it.
    dates : tuple of datetime
        Date (UTC) at which each berg of a cloud comes into being; empty for bergs that are there at the start.

    Examples
    --------
    >>> Iceberg.rectangle("60 km", "20 km", thickness="200 m", placement=(-37.0, -56.0))
    <Iceberg: 147 square elements of radius 1428.57 m, 1200 km2, 204 Gt, 266 bonds, 1 piece, at 56.000 S, 37.000 W>
    """

    @classmethod
    def from_outline(
        cls,
        source: Any,
        *,
        thickness: Any,
        feature: int | str | None = None,
        date: str | None = None,
        crs: str | None = None,
        repair: bool = False,
        **options: Unpack[ShapeOptions],
    ) -> Iceberg:
        """Fill an outline with elements.

        Elements in different pieces of an outline (polygons of a MultiPolygon) are not bonded to each other, also where
        the gap between them is narrower than an element.

        Parameters
        ----------
        source : path, geometry, dict or array_like
            GeoJSON, shapefile, CSV (columns lon and lat; optionally date, id, ring), KML; a shapely geometry; an array
            (n, 2) of longitude and latitude. See `riftberg.bergs.outline.read_features`.
        thickness : float, path, DataArray or Raster
            Ice thickness, m; a map is sampled where the outline was drawn, before rotation and shift. Zeros and gaps of a
            map are left out of the bilinear mean.
        feature, date : optional
            Which outline of a file that holds several: number or property value; date as text.
        crs : str, optional
            Coordinate system of projected coordinates, for example ``"EPSG:3031"``.
        repair : bool
            Mend an outline that crosses itself instead of refusing it.
        **options
            Radius, packing, density, velocity, spin, radius of the sphere; rotation, shift, placement, offset, lattice_angle,
            conformal (`riftberg.bergs.keys.BergOptions`). The report gives areas on the sphere, not on the
            ellipsoid of a chart (0.7 % less at 55 S for the radius of the A68a experiment).

        Raises
        ------
        BergError
            If the outline cannot be read, chosen or filled.
        """
        settings = berg_options(options, ShapeOptions, thickness)
        where = str(source) if isinstance(source, str) or hasattr(source, "__fspath__") else type(source).__name__
        chosen = outlines.select_outline(outlines.read_features(source, crs), where=where, feature=feature, date=date)
        geometry = outlines.check_outline(chosen.geometry, where=f"{where} ({chosen.label()})", repair=repair)
        plane: FillingPlane = filling_plane(
            geometry.bounds, (geometry.centroid.x, geometry.centroid.y), settings.conformal, settings.earth_radius
        )
        region = outline_region(geometry, plane)
        flat = shapely.transform(geometry, plane.forward, interleaved=False)
        report = {"source": where, "feature": chosen.label()}
        centroid = (geometry.centroid.x, geometry.centroid.y)
        return cls._filling(region, plane, centroid, settings, settings.thickness, report, flat)

    @classmethod
    def from_mask(
        cls,
        source: Any,
        *,
        thickness: Any = None,
        variable: str | None = None,
        threshold: float | None = None,
        date: str | None = None,
        rules: Literal["lattice", "makeberg"] = "lattice",
        reference_latitude: float | None = None,
        spacing: float = 500.0,
        **options: Unpack[ShapeOptions],
    ) -> Iceberg:
        """Fill a gridded mask or a gridded thickness with elements.

        Elements in different pieces of the mask are not bonded to each other, also where the gap between them is narrower
        than an element; cells that touch at a corner only belong to different pieces (see `riftberg.bergs.regions.IceMask`).
        ``rules="makeberg"`` bonds all neighbours, as the reference does.

        Parameters
        ----------
        source : path, DataArray, Dataset or Raster
            Grid with one-dimensional longitude and latitude, or a GeoTIFF, also in a map projection (`read_raster`).
        thickness : float, path, DataArray or Raster, optional
            Ice thickness, m. By default the values of ``source`` itself are thicknesses.
        variable, date : str, optional
            Which variable and time of the file.
        threshold : float, optional
            Value above which there is ice; 0.5 for masks, 0 where ``source`` is a thickness. In masks of fractions the
            edge lies where bilinear values reach it, in others half way between cells of ice and others.
        rules : {"lattice", "makeberg"}
            ``"makeberg"``: exactly the elements of the reference's script (equations 10.5); it implies ``conformal=False``,
            longitudes from 0 to 360, and neither rotation, placement nor offset.
        reference_latitude, spacing : float
            For ``"makeberg"``: latitude that scales longitudes, and spacing (m) of the resampled mask.
        **options
            As in `from_outline`.
        """
        # Without a thickness the values of the source are thicknesses.
        settings = berg_options(options, ShapeOptions, 0.0 if thickness is None else thickness)
        threshold = None if threshold is None else number(threshold, "1", where="threshold", kind=BergError)
        mask = source if isinstance(source, Raster) else read_raster(source, variable, date=date)
        check_on_globe(mask)
        threshold = (0.0 if thickness is None else 0.5) if threshold is None else threshold
        if rules == "makeberg":
            lattice, plane = makeberg_lattice(
                mask, settings.radius, settings.packing, spacing=spacing, reference_latitude=reference_latitude,
                threshold=threshold, shift=settings.shift, earth_radius=settings.earth_radius,
            )  # fmt: skip
            # The script pairs mask points with positions half a cell further south-west; thickness follows the mask.
            lon, lat = plane.inverse(lattice.x, lattice.y)
            lon, lat = lon - settings.shift[0], lat - settings.shift[1]
            heights = sample_thickness(mask if thickness is None else settings.thickness, lon, lat, read_raster)
            report: dict[str, Any] = {"source": mask.name, "rules": "makeberg"}
            settings = settings.model_copy(update={"thickness": heights, "conformal": False})
            return cls._placed(lattice.x, lattice.y, plane, settings, report)
        ice = IceMask.of(mask, threshold)
        region, plane_of, centroid = mask_region(
            ice, lambda b, c: filling_plane(b, c, settings.conformal, settings.earth_radius)
        )
        ice_itself = unbroken(mask, ice_cells(mask, threshold)).above(threshold) if thickness is None else None
        source_of_heights = settings.thickness if ice_itself is None else ice_itself
        return cls._filling(region, plane_of, centroid, settings, source_of_heights, {"source": mask.name})

    @classmethod
    def from_table(
        cls,
        rows: list[tuple[int, int, int]],
        *,
        thickness: Any,
        placement: tuple[float, float],
        table_radius: float = 1500.0,
        **options: Unpack[TableOptions],
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
        thickness, **options
            Packing, density, velocity, spin, rotation, offset, lattice_angle, conformal, latlon, earth_radius, as in
            `from_outline`; ``thickness`` may be one value per element.
        """
        settings = berg_options(options, TableOptions, thickness, placement=placement)
        table_radius = given(table_radius, LatticeRows, "cell_radius", where="table_radius", kind=BergError)
        rows = given(rows, LatticeRows, "rows", kind=BergError)
        if options.get("radius") is None:
            settings = settings.model_copy(update={"radius": table_radius})
        column, row = expand_rows(rows)
        region = cells_region(column, row, 2.0 * table_radius)
        centre = (2.0 * table_radius * (column.mean() + 0.5), 2.0 * table_radius * (row.mean() + 0.5))
        west, south = 2.0 * table_radius * column - centre[0], 2.0 * table_radius * row - centre[1]
        cells = shapely.union_all(shapely.box(west, south, west + 2.0 * table_radius, south + 2.0 * table_radius))
        return cls._about(region, centre, settings, "table of lattice rows", cells)

    @classmethod
    def rectangle(
        cls,
        length: float,
        width: float,
        *,
        thickness: Any,
        placement: tuple[float, float] = (0.0, 0.0),
        **options: Unpack[TableOptions],
    ) -> Iceberg:
        """Build an idealised rectangular berg.

        Parameters
        ----------
        length, width : float
            Extents (m) along x (east) and y (north) before rotation.
        placement : tuple of float
            Longitude and latitude (x and y in m if not ``latlon``) of the centre.
        thickness, **options
            Radius, packing, density, velocity, spin, rotation, offset, lattice_angle, conformal, latlon, earth_radius, as in
            `from_outline`; ``thickness`` may be one value per element.
        """
        settings = berg_options(options, TableOptions, thickness, placement=placement)
        length = given(length, Rectangle, "length", kind=BergError)
        width = given(width, Rectangle, "width", kind=BergError)
        region = rectangle_region(length, width)
        berg = cls._about(
            region, (0.0, 0.0), settings, f"rectangle {length:g} m x {width:g} m", shapely.box(*region.bounds)
        )
        lone = "radius" not in options and berg.elements.size == 1
        return berg._with_sides(np.array([length]), np.array([width])) if lone else berg

    @classmethod
    def from_points(
        cls,
        lon: Any,
        lat: Any,
        *,
        thickness: Any,
        length: Any = None,
        width: Any = None,
        static: Any = False,
        bond_length: float | None = None,
        period: float | None = None,
        outline: Any = None,
        overlap: bool = False,
        **options: Unpack[PointOptions],
    ) -> Iceberg:
        """Build a berg from the positions of its elements, or lone bergs of given length and width; they stay where they are.

        Parameters
        ----------
        lon, lat : array_like
            Positions, degrees (m if not ``latlon``).
        thickness : float or array_like
            Thickness, m.
        length, width : float or array_like, optional
            Plan sizes (m) of lone bergs, of which each is one element and none is bonded, instead of a radius; a berg without a
            width is a square. The longer side counts as the length.
        static : bool or array_like
            Elements that never move.
        bond_length : float, optional
            Bond elements closer than this (m) instead of closer than 1.25 (R1 + R2).
        period : float, optional
            Zonal period in degrees (m if not ``latlon``); 0 if there is none. By default 360 degrees, and none in metres.
        outline : geometry, dict or array_like, optional
            Outline of the ice (polygon) in the coordinates of the elements, which elastic cells fill.
        overlap : bool, optional
            Lone bergs may lie on each other; they run without contact alone (``stepping.interactions: false``).
        **options
            Radius, packing, density, velocity, spin, earth_radius, latlon, pieces (`riftberg.bergs.keys.BergOptions`); radius,
            velocity and spin may be arrays (spins are then of elements about themselves, and not of their berg), and
            elements of different pieces are not bonded, however close they are.

        Examples
        --------
        >>> bergs = Iceberg.from_points([-37.0, -36.9], -56.0, length=[300.0, 800.0], width=200.0, thickness=100.0)
        >>> bergs.elements.length, bergs.bonds.first.size
        (array([300., 800.]), 0)
        """
        if length is not None or width is not None:
            return cls._lone_bergs(
                lon, lat, length, width, thickness, {"static": static, "period": period, **options},
                {"bond_length": bond_length, "outline": outline}, overlap=overlap,
            )  # fmt: skip
        if overlap:
            raise BergError(
                "overlap of elements that may be bonded",
                where="Iceberg.from_points",
                remedy="Give length: of lone bergs",
            )
        settings = berg_options(options, PointOptions, thickness)
        if bond_length is not None:
            bond_length = number(bond_length, "m", where="bond_length", kind=BergError)
        lon, lat, period = _positions(lon, lat, period, settings.latlon)
        berg = cls._of_points(
            lon, lat, settings, static=static, rule=BondRule(bond_length, settings.packing), period=period
        )
        if outline is None:
            return berg
        ice = outlines.select_outline(outlines.read_features(outline), where="outline").geometry
        return replace(berg, outlines=tuple(getattr(ice, "geoms", [ice])))

    @classmethod
    def join(cls, bergs: Sequence[Iceberg] | Mapping[str, Iceberg], names: Sequence[str] | None = None) -> Iceberg:
        """Return several bergs as one start of a run; they may differ in size, thickness, elements and packing.

        Bergs are not bonded to each other. Each keeps its name: counts, maps, files and messages use it, and call a piece
        that breaks off berg A the fragment A.1.

        Parameters
        ----------
        bergs : sequence of Iceberg, or mapping of str to Iceberg
            In any order, or by name; those that were joined before count as the bergs that they are.
        names : sequence of str, optional
            One for each, instead of their own (`named`); bergs without one are called ``berg 1``, ``berg 2``, ...

        Raises
        ------
        BergError
            If they overlap, or disagree on coordinates, the radius of the sphere or the density of ice, or if two have
            the same name.

        Examples
        --------
        >>> large = Iceberg.rectangle(20e3, 10e3, thickness=250.0, placement=(-37.0, -56.0)).named("A")
        >>> small = Iceberg.rectangle(800.0, 800.0, thickness=80.0, placement=(-36.5, -56.0), radius=100.0)
        >>> Iceberg.join([large, small], names=["A", "B"]).names
        ('A', 'B')
        """
        return join(bergs, names)

    @classmethod
    def field(
        cls,
        n: int,
        area: tuple[float, float, float, float],
        *,
        sizes: Any = "gladstone",
        seed: int | None = None,
        thickness: Any = None,
        gap: float = 0.0,
        between: tuple[float, float] = (0.1e6, 10e6),
        **options: Unpack[FieldOptions],
    ) -> Iceberg:
        """Return a field of ``n`` bergs of one element each, at random places that do not overlap.

        Parameters
        ----------
        n : int
            Number of bergs.
        area : tuple of float
            West, east, south and north, degrees (m if not ``latlon``).
        sizes : {"gladstone", "tournadre"} or array_like
            Distribution of the sizes: the ten classes of Gladstone et al. (2001), 1.5 times as long as wide; or squares: the
            power law of areas of Tournadre et al. (2016), or areas (m2) to draw from. See `riftberg.bergs.iceberg`.
        seed : int, optional
            The same seed gives the same field. One is drawn if none is given; the report names it.
        thickness : float or array_like, optional
            m; by default that which goes with the size.
        gap : float
            Least distance between bergs, m.
        between : tuple of float
            Least and largest area of the power law, m2.
        **options
            density, velocity, latlon, earth_radius: as for `from_points`.

        Examples
        --------
        >>> field = Iceberg.field(100, (-40.0, -36.0, -58.0, -56.0), seed=1)
        >>> field.elements.size, len(field.bonds.first)
        (100, 0)
        """
        n = given(n, FieldOfBergs, "number", where="n", kind=BergError)
        check_elements(n, kind=BergError)
        gap = given(gap, FieldOfBergs, "gap", kind=BergError)
        between = given(between, FieldOfBergs, "between", kind=BergError)
        area = checked_area(area, latlon=flag(options.get("latlon", True), where="latlon", kind=BergError))
        seed = check_seed(seed)
        random = np.random.default_rng(seed)
        plan = areas(n, sizes, random, between)
        heights = usual_thickness(plan) if thickness is None else thickness
        settings = berg_options(options, FieldOptions, heights)
        # The length over the width of bergs of a distribution: the classes are of long bergs, all others of squares.
        aspect = ASPECT if isinstance(sizes, str) and sizes == "gladstone" else 1.0
        # Rectangles of any turn keep clear of each other where their corners do.
        reach = np.sqrt(0.25 * (aspect + 1.0 / aspect) * plan)
        metric = Metric(settings.latlon, settings.earth_radius, 360.0 if settings.latlon else 0.0)
        box = checked_box(area)
        x, y = place_discs(reach, lambda: _draw_point(*box, metric.latlon, random), gap, metric, where="Iceberg.field")
        berg = cls.from_points(
            x, y, thickness=heights, radius=0.5 * np.sqrt(plan), pieces=np.arange(n), **options
        )  # fmt: skip
        berg.elements.length[:] *= np.sqrt(aspect)
        berg.elements.width[:] /= np.sqrt(aspect)
        report = {"source": f"field of {n} bergs", "sizes": sizes if isinstance(sizes, str) else "given", "seed": seed}
        return replace(berg, report=report, bergs=tuple((f"{k + 1}", 1) for k in range(n)))

    @classmethod
    def cloud(
        cls,
        n: int,
        placement: tuple[float, float],
        radius: float,
        *,
        thickness: Any = None,
        sizes: Any = "gladstone",
        seed: int | None = None,
        **options: Unpack[CloudOptions],
    ) -> Iceberg:
        """Return ``n`` bergs of one element each around a place, which do not touch each other unless asked.

        Parameters
        ----------
        n : int
            Number of bergs.
        placement : tuple of float
            Longitude and latitude (x and y in m if not ``latlon``) of the middle.
        radius : float
            Distance (m) from the middle within which the bergs' centres lie, each square metre as likely as any other.
        thickness, sizes, seed
            As for `field`.
        **options
            ``length`` and ``width`` (m) of each berg, in place of sizes that are drawn; a berg without a width is a square.
            ``overlap``: places are drawn without a look at the other bergs, each stands for one that may be there; for runs
            with ``stepping.interactions: false``, in which bergs do not act on each other. ``dates`` (UTC): when the bergs come
            into being, one date for all, the first and the last, between which they come evenly, or one for each; a berg comes
            at the end of the time step that reaches its date, and where bergs act on each other once its place is free.
            ``gap``, ``between``, ``density``, ``velocity``, ``latlon``, ``earth_radius``: as for `field`.

        Raises
        ------
        BergError
            If so many bergs have no room there, or dates do not rise.

        Examples
        --------
        >>> cloud = Iceberg.cloud(50, (-37.0, -56.0), 10e3, length=300.0, width=200.0, thickness=100.0, seed=1)
        >>> cloud.elements.size, round(float(cloud.mass) / 50)
        (50, 5100000000)
        """
        rest: dict[str, Any] = dict(options)
        length, width = rest.pop("length", None), rest.pop("width", None)
        overlap = flag(rest.pop("overlap", False), where="overlap", kind=BergError)
        dates = rest.pop("dates", None)
        n = given(n, CloudOfBergs, "number", where="n", kind=BergError)
        check_elements(n, kind=BergError)
        radius = given(radius, CloudOfBergs, "radius", kind=BergError)
        gap = given(rest.pop("gap", 0.0), CloudOfBergs, "gap", kind=BergError)
        between = given(rest.pop("between", (0.1e6, 10e6)), CloudOfBergs, "between", kind=BergError)
        seed = check_seed(seed)
        random = np.random.default_rng(seed)
        if length is None and width is None:
            plan = areas(n, sizes, random, between)
            aspect = ASPECT if isinstance(sizes, str) and sizes == "gladstone" else 1.0
            long, wide = np.sqrt(aspect * plan), np.sqrt(plan / aspect)
        else:
            long, wide = _sides(length, width, n)
        heights = usual_thickness(long * wide) if thickness is None else thickness
        settings = berg_options(rest, CloudOptions, heights, placement=placement)
        assert settings.placement is not None
        middle = settings.placement
        metric = Metric(settings.latlon, settings.earth_radius, 360.0 if settings.latlon else 0.0)
        plane = EqualAreaPlane(*middle, settings.earth_radius) if settings.latlon else None

        def drawn() -> tuple[float, float]:
            distance, turn = radius * np.sqrt(random.random()), 2.0 * np.pi * random.random()
            east, north = distance * np.cos(turn), distance * np.sin(turn)
            if plane is None:
                return middle[0] + east, middle[1] + north
            lon, lat = plane.inverse(np.array([east]), np.array([north]))
            return float(lon[0]), float(lat[0])

        if overlap:
            x, y = (np.array(coordinate) for coordinate in zip(*(drawn() for _ in range(n)), strict=True))
        else:  # rectangles of any turn keep clear of each other where their corners do
            x, y = place_discs(0.5 * np.hypot(long, wide), drawn, gap, metric, where="Iceberg.cloud")
        berg = cls._lone_bergs(x, y, long, wide, heights, rest, {}, overlap=overlap)
        return replace(berg, report={"source": f"cloud of {n} bergs", "seed": seed}, dates=berg_dates(dates, n))

    @classmethod
    def _lone_bergs(
        cls, lon: Any, lat: Any, length: Any, width: Any, thickness: Any, options: dict[str, Any], idle: dict[str, Any],
        *, overlap: bool = False,
    ) -> Iceberg:  # fmt: skip
        """Return bergs of one element each; ``idle``: options that they cannot have, by name."""
        extra = [*(name for name, value in idle.items() if value is not None), *({"radius", "pieces"} & options.keys())]
        if extra:
            raise BergError(
                f"{extra[0]} beside length and width", where="Iceberg.from_points",
                remedy="Each berg of given length and width is one element, which is bonded to none: leave it out",
            )  # fmt: skip
        count = max(np.size(lon), np.size(lat))
        lon, lat = (
            np.broadcast_to(np.atleast_1d(coordinate), count) if np.size(coordinate) == 1 else coordinate
            for coordinate in (lon, lat)
        )
        long, wide = _sides(length, width, count)
        packing = options.get("packing", "square")
        radius = np.sqrt(long * wide / element_area(1.0, packing))
        static, period = options.pop("static", False), options.pop("period", None)
        sized = {**options, "radius": radius if count != 1 else float(radius[0]), "pieces": np.arange(count)}
        settings = berg_options(sized, PointOptions, thickness)
        lon, lat, period = _positions(lon, lat, period, settings.latlon)
        unbonded = BondRule(SHORTEST, settings.packing)
        berg = cls._of_points(lon, lat, settings, static=static, rule=unbonded, period=period, overlap=overlap)
        names = tuple((f"{k + 1}", 1) for k in range(count)) if count > 1 else berg.bergs
        return replace(berg, report={"source": "points"}, bergs=names)._with_sides(long, wide)

    def _with_sides(self, length: Floats, width: Floats) -> Iceberg:
        """Return lone bergs with their length and width (m), of which the longer one counts as the length."""
        self.elements.length[:], self.elements.width[:] = np.maximum(length, width), np.minimum(length, width)
        return self

    @classmethod
    def _of_points(
        cls, lon: Floats, lat: Floats, settings: BergOptions, *, static: Any = False, rule: BondRule | None = None,
        period: float = 0.0, overlap: bool = False,
    ) -> Iceberg:  # fmt: skip
        """Return the elements at these positions and the bonds between them."""
        elements = make_elements(lon, lat, settings, static=static)
        metric = Metric(settings.latlon, settings.earth_radius, period)
        if not overlap:
            refuse_overlap(elements, settings.packing, metric)
        bonds = form_bonds(elements, rule or BondRule(packing=settings.packing), metric)
        if settings.pieces is not None:
            bonds = within_pieces(bonds, np.broadcast_to(np.asarray(settings.pieces, dtype=np.int64), lon.shape))
        number_pieces(elements, bonds)
        if settings.latlon:
            # Across the date line on one branch, as berg by berg their centres, rifts and maps are found.
            _, first, piece = np.unique(elements.berg, return_index=True, return_inverse=True)
            elements.lon[:] = elements.lon_pair[:] = near(elements.lon, elements.lon[first][piece])
        if np.ndim(settings.spin):
            elements.spin[:] = settings.spin  # each element about itself
        elif settings.spin:
            turn_rigidly(elements, settings.spin, metric)
        return cls(
            elements, bonds, settings.packing, float(np.mean(settings.radius)), {"source": "points"}, settings.latlon,
            settings.earth_radius, settings.density,
        )  # fmt: skip

    @classmethod
    def _filling(
        cls, region: Region, plane: FillingPlane, centroid: tuple[float, float], settings: BergOptions, thickness: Any,
        report: dict[str, Any], outline: Any = None,
    ) -> Iceberg:  # fmt: skip
        """Fill a region of a plane, turn it about its centroid (degrees) and place it; ``outline``: of the ice, on the plane."""
        with placed_in(report["source"]):
            lattice, radius = _fitting_lattice(region, settings)
        # Of a map where the ice was drawn, before it is turned and moved.
        heights = sample_thickness(thickness, *plane.inverse(lattice.x, lattice.y), read_raster)
        cx, cy = plane.forward(np.array([centroid[0]]), np.array([centroid[1]]))
        x, y = turned(lattice.x - cx, lattice.y - cy, settings.rotation)
        if outline is not None:
            outline = shapely.affinity.rotate(outline, settings.rotation, origin=(float(cx[0]), float(cy[0])))
        moved = move_centroid(plane, centroid, settings.placement, settings.shift)
        settings = settings.model_copy(
            update={"radius": radius, "thickness": heights, "pieces": region.piece_numbers(lattice)}
        )
        report = {**report, "outline_area": region.area, "outline_pieces": region.pieces}
        return cls._placed(x + cx, y + cy, moved, settings, report, outline)

    @classmethod
    def _about(
        cls, region: Region, centre: tuple[float, float], settings: BergOptions, source: str, outline: Any
    ) -> Iceberg:
        """Fill a region in metres and place its centre; ``outline``: of the ice about the centre."""
        lattice, radius = _fitting_lattice(region, settings)
        x, y = turned(lattice.x - centre[0], lattice.y - centre[1], settings.rotation)
        settings = settings.model_copy(update={"radius": radius})
        assert settings.placement is not None
        outline = shapely.affinity.rotate(outline, settings.rotation, origin=(0.0, 0.0))
        report = {"source": source, "outline_area": region.area}
        if not settings.latlon:
            east, north = settings.placement
            berg = cls._of_points(x + east, y + north, settings)
            return berg._reported(report)._within(outline, lambda a, b: (a + east, b + north))
        plane: FillingPlane = EqualAreaPlane(*settings.placement, settings.earth_radius)
        if not settings.conformal:
            plane = ReferencePlane(*settings.placement, settings.placement[1], settings.earth_radius)
        return cls._placed(x, y, plane, settings, report, outline)

    @classmethod
    def _placed(
        cls, x: Floats, y: Floats, plane: FillingPlane, settings: BergOptions, report: dict[str, Any],
        outline: Any = None,
    ) -> Iceberg:  # fmt: skip
        """Bring plane points to the sphere, without strain if ``settings.conformal``."""
        lon, lat = plane.inverse(x, y)
        berg = cls._of_points(lon, lat, settings)
        if settings.conformal and len(berg.bonds.first):
            rest = np.full(len(berg.bonds.first), 2.0 * berg.radius)
            # Bonds are known only once the points are placed; then these move until no bond is strained.
            lon, lat = relax(lon, lat, berg.bonds.first, berg.bonds.second, rest, Metric(True, settings.earth_radius))
            berg = cls._of_points(lon, lat, settings)
        return berg._reported(report)._within(outline, plane.inverse)

    def _within(self, outline: Any, placed: Callable[[Floats, Floats], tuple[Floats, Floats]]) -> Iceberg:
        """Return the berg with its outline on a plane (m), brought to the coordinates of the elements."""
        if outline is None:
            return self
        # Straight sides of the plane are none in longitude and latitude: they get points as dense as the elements.
        shape = shapely.transform(shapely.segmentize(outline, 2.0 * self.radius), placed, interleaved=False)
        return replace(self, outlines=tuple(getattr(shape, "geoms", [shape])))


def _fitting_lattice(region: Region, settings: BergOptions) -> tuple[Lattice, float]:
    """Return the elements of a region and their radius (m): without a radius one, if the berg is smaller than the default."""
    if "radius" not in settings.model_fields_set and is_lone(region, settings.radius, settings.packing):
        return lone_element(region, settings.packing)
    return fill(region, settings.radius, settings.packing, settings.offset, settings.lattice_angle)


LONGEST: Final = 1e6
"""Greatest length of a lone berg, m."""

SHORTEST: Final = 1e-6
"""Distance (m) within which lone bergs would be bonded: none lie as close."""


def _positions(lon: Any, lat: Any, period: Any, latlon: bool) -> tuple[Floats, Floats, float]:
    """Return positions of elements and the zonal period (degrees; m if not ``latlon``), by default the period of the globe."""
    unit = "degree" if latlon else "m"
    period = (360.0 if latlon else 0.0) if period is None else number(period, unit, where="period", kind=BergError)
    lon = np.atleast_1d(numbers(lon, unit, where="lon", kind=BergError))
    lat = np.atleast_1d(numbers(lat, unit, where="lat", kind=BergError))
    if lon.shape != lat.shape or lon.ndim != 1:
        raise BergError(f"lon has shape {lon.shape}, lat {lat.shape}", remedy="Give two lists of equal length")
    return lon, lat, period


def _sides(length: Any, width: Any, count: int) -> tuple[Floats, Floats]:
    """Return length and width (m) of so many bergs, or refuse impossible ones."""
    if length is None:
        raise BergError("a width without a length", where="width", remedy="Give length too")
    sides = []
    for name, value in (("length", length), ("width", length if width is None else width)):
        side = numbers(value, "m", where=name, kind=BergError)
        if side.shape not in ((), (1,), (count,)):
            raise BergError(
                f"{side.size} values for {count} bergs", where=name, remedy="Give one number, or one for each"
            )
        if not (np.isfinite(side) & (side > 0.0) & (side <= LONGEST)).all():
            raise BergError(
                f"a {name} that no berg has", where=name, remedy=f"Give metres above 0, at most {LONGEST:g}"
            )
        sides.append(np.broadcast_to(side, count).astype(np.float64))
    return sides[0], sides[1]


# ---- fields of many small bergs: sizes from a distribution of the literature, places drawn without overlap ---------------

# "gladstone" has the ten classes of length, thickness and frequency of Gladstone, Bigg and Nicholls (2001, JGR Oceans
# 106, 19903, table 1) as most models of iceberg drift use them. "tournadre" has areas by the power law of Tournadre
# et al. (2016, JGR Oceans 121, 327), who find the exponent -1.52 (+-0.32) for areas of 0.1 to 10 000 km2 around Antarctica,
# near the -3/2 of brittle fragmentation. Thickness follows the length as in the classes of Gladstone et al.

LENGTHS: Final = np.array([60.0, 100.0, 200.0, 350.0, 500.0, 700.0, 900.0, 1200.0, 1600.0, 2200.0])
"""Lengths of the classes, m."""

THICKNESSES: Final = np.array([40.0, 67.0, 133.0, 175.0, 250.0, 250.0, 250.0, 250.0, 250.0, 250.0])
"""Thicknesses of the classes, m."""

SHARES: Final = np.array([0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02])
"""Parts of the number of bergs in the classes; they are scaled to 1."""

ASPECT: Final = 1.5
"""Length over width of the bergs of these classes."""

EXPONENT: Final = 1.52
"""Exponent of the power law of areas."""

TRIES: Final = 2000
"""Places that are tried for a berg before the area counts as full."""

SIZES: Final = ("gladstone", "tournadre")


def berg_dates(dates: Any, count: int) -> tuple[datetime, ...]:
    """Return the date (UTC) at which each of some bergs comes: one for all, first and last, or one for each; none for None.

    Examples
    --------
    >>> [str(date) for date in berg_dates(("2020-12-09", "2020-12-11"), 3)]
    ['2020-12-09 00:00:00', '2020-12-10 00:00:00', '2020-12-11 00:00:00']
    """
    if dates is None:
        return ()
    given_dates = list(dates) if isinstance(dates, list | tuple | np.ndarray) else [dates]
    try:
        moments = [moment(date, where="dates") for date in given_dates]
    except InputError as error:
        raise BergError(str(error)) from error
    if len(moments) not in (1, 2, count):
        raise BergError(
            f"{len(moments)} dates for {count} bergs",
            where="dates",
            remedy="Give one, the first and the last, or one for each",
        )
    if any(late < early for early, late in pairwise(moments)):
        raise BergError("dates do not rise", where="dates", remedy="Give them in their order")
    if len(moments) == count:
        return tuple(moments)
    span = moments[-1] - moments[0]
    return tuple(moments[0] + span * (k / max(1, count - 1)) for k in range(count))


def areas(count: int, sizes: Any, random: np.random.Generator, between: tuple[float, float]) -> Floats:
    """Return plan areas of bergs, m2.

    ``sizes``: the distribution, or areas (m2) to draw from; ``between``: least and largest area (m2) of the power law.
    """
    if isinstance(sizes, str):
        if sizes == "gladstone":
            length = random.choice(LENGTHS, count, p=SHARES / SHARES.sum())
            return np.asarray(length * length / ASPECT)
        if sizes == "tournadre":
            return power_law(random.random(count), *between)
        raise BergError(f"sizes {sizes!r}", where="Iceberg.field", remedy=f"Use {', '.join(SIZES)}, or areas in m2")
    choices = numbers(sizes, "m2", where="sizes", kind=BergError).ravel()
    if choices.size == 0 or not (np.isfinite(choices) & (choices > 0.0)).all():
        raise BergError("sizes that are no areas", where="Iceberg.field", remedy="Give areas in m2, above 0")
    return np.asarray(random.choice(choices, count))


def checked_area(area: Any, *, latlon: bool) -> tuple[float, float, float, float]:
    """Return west, east, south and north of a field (degrees; m if not ``latlon``), or refuse an impossible box."""
    if latlon:
        west, east, south, north = given(area, FieldOfBergs, "area", kind=BergError)
        for latitude in (south, north):
            check_place((0.5 * (west + east), latitude), where="area", kind=BergError)
        return west, east, south, north
    metres = numbers(native(area), "m", where="area", kind=BergError)
    if metres.shape != (4,):
        raise BergError(
            f"{value_shown(area)} is no area", where="area", remedy="Give west, east, south and north in metres"
        )
    return tuple(metres.tolist())


def power_law(share: Floats, least: float, largest: float, exponent: float = EXPONENT) -> Floats:
    """Return the areas below which these shares (0 to 1) of a power law between two areas lie: its inverse distribution."""
    if not 0.0 < least < largest:
        raise BergError(
            f"areas between {least:g} and {largest:g} m2",
            where="Iceberg.field",
            remedy="Give a smaller one above 0 first",
        )
    a, b = least ** (1.0 - exponent), largest ** (1.0 - exponent)
    return np.asarray((a + share * (b - a)) ** (1.0 / (1.0 - exponent)))


def usual_thickness(area: Floats) -> Floats:
    """Return the thickness (m) that goes with plan areas (m2), by the length of bergs of the usual aspect."""
    return np.asarray(np.interp(np.sqrt(ASPECT * area), LENGTHS, THICKNESSES), np.float64)


def checked_box(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return west, east, south and north, or refuse them in another order."""
    west, east, south, north = box
    if not (west < east and south < north and all(np.isfinite(box))):
        raise BergError(
            f"area {list(box)}", where="Iceberg.field", remedy="Give west, east, south and north, the smaller one first"
        )
    return box


def place_discs(
    radius: Floats, drawn: Callable[[], tuple[float, float]], gap: float, metric: Metric, *, where: str
) -> tuple[Floats, Floats]:
    """Return places at which discs of these radii (m) keep a gap (m), the largest first placed.

    ``radius``: half of the greatest extent of each berg, m; ``drawn`` draws a place; ``gap``: least distance of the rims, m.
    """
    # The largest first: they find no place once small ones stand everywhere.
    order = np.argsort(-radius, kind="stable")
    lon, lat = np.full(radius.size, np.nan), np.full(radius.size, np.nan)
    for n, k in enumerate(order):
        placed = order[:n]
        for _ in range(TRIES):
            x, y = drawn()
            dx, dy = separations(metric, lon[placed], lat[placed], np.asarray(x), np.asarray(y))
            if n == 0 or (np.hypot(dx, dy) > radius[placed] + radius[k] + gap).all():
                lon[k], lat[k] = x, y
                break
        else:
            raise BergError(
                f"no place is left for berg {n + 1} of {radius.size}", where=where,
                remedy="Take a larger area, fewer bergs, or a smaller gap",
            )  # fmt: skip
    return lon, lat


def _draw_point(
    west: float, east: float, south: float, north: float, latlon: bool, random: np.random.Generator
) -> tuple[float, float]:
    """Return a point of a box, each square metre as likely as any other."""
    x, share = west + (east - west) * random.random(), random.random()
    if not latlon:
        return x, south + (north - south) * share
    # The area of a belt grows with the sine of latitude.
    low, high = np.sin(south * DEGREE), np.sin(north * DEGREE)
    return x, float(np.arcsin(low + (high - low) * share) / DEGREE)
