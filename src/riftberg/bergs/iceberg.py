"""The iceberg that a run starts from, and the ways to make one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Unpack

import numpy as np

from riftberg.bergs import outline as outlines
from riftberg.bergs.bonded import BondedBerg, join
from riftberg.bergs.bonding import BondRule
from riftberg.bergs.keys import (
    CloudOptions,
    FieldOptions,
    LatticeRows,
    PointOptions,
    Rectangle,
    ShapeOptions,
    TableOptions,
    berg_options,
)
from riftberg.bergs.lone_bergs import make_lone_bergs, set_sides
from riftberg.bergs.placement import bond_points, check_positions
from riftberg.bergs.populations import draw_cloud, draw_field
from riftberg.bergs.raster import Raster, check_on_globe, read_raster
from riftberg.bergs.shapes import copy_makeberg, fill_mask, fill_outline, fill_rectangle, fill_table
from riftberg.config.values import given, number
from riftberg.errors import BergError


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
        return cls._of(fill_outline(source, settings, feature=feature, date=date, crs=crs, repair=repair))

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
        of_ice = thickness is None
        if rules == "makeberg":
            return cls._of(copy_makeberg(mask, settings, threshold, of_ice, reference_latitude, spacing))
        return cls._of(fill_mask(mask, settings, threshold, of_ice))

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
        return cls._of(fill_table(rows, table_radius, settings))

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
        berg = fill_rectangle(length, width, settings)
        lone = "radius" not in options and berg.elements.size == 1
        return cls._of(set_sides(berg, np.array([length]), np.array([width])) if lone else berg)

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
            sized = {"static": static, "period": period, **options}
            idle = {"bond_length": bond_length, "outline": outline}
            return cls._of(make_lone_bergs(lon, lat, length, width, thickness, sized, idle, overlap=overlap))
        if overlap:
            raise BergError(
                "overlap of elements that may be bonded",
                where="Iceberg.from_points",
                remedy="Give length: of lone bergs",
            )
        settings = berg_options(options, PointOptions, thickness)
        if bond_length is not None:
            bond_length = number(bond_length, "m", where="bond_length", kind=BergError)
        lon, lat, period = check_positions(lon, lat, period, settings.latlon)
        rule = BondRule(bond_length, settings.packing)
        berg = cls._of(bond_points(lon, lat, settings, static=static, rule=rule, period=period))
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
            power law of areas of Tournadre et al. (2016), or areas (m2) to draw from. See `riftberg.bergs.populations`.
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
        return cls._of(draw_field(n, area, sizes, seed, thickness, gap, between, {**options}))

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
        return cls._of(draw_cloud(n, placement, radius, thickness, sizes, seed, {**options}))

    @classmethod
    def _of(cls, berg: BondedBerg) -> Iceberg:
        """Return a berg that has been put together."""
        return cls(**vars(berg))
