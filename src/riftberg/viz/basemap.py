"""Maps on given axes: extent, coast, sea floor and scale bar.

Coastlines are those of Natural Earth, where cartopy is installed and has them on this machine; nothing is downloaded. Cartopy
keeps the shapefiles in its data folder (``cartopy.config["data_dir"]``) once a program or its own download script
(``cartopy_feature_download``) has fetched them. The maps stay plain longitude-latitude maps; cartopy finds and reads the
shapes.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.runs.scene import Box
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.colours import LAND, SHELF, SHORE

if TYPE_CHECKING:
    from matplotlib.axes import Axes


RESOLUTIONS: Final = (("10m", 0.0), ("50m", 2.0), ("110m", 10.0))
"""Scales of Natural Earth (1:10 million and so on), finest first, and the least height of a map (degrees) for each: a
coarse coastline on a close map, kilometres off, is worse than none."""

FILLED: Final = (("land", LAND), ("minor_islands", LAND), ("antarctic_ice_shelves_polys", SHELF))
"""Layers of areas."""

COAST: Final = 3.6
"""Height of the coast among what is drawn: above currents and shoals, below ice and tracks."""

SHORES: Final = ("coastline", "minor_islands_coastline")
"""Layers of lines; unlike the edges of the areas, they have no seam along the date line."""


ISOBATHS: Final = (50, 100, 200, 300, 500, 1000, 2000, 3000, 4000, 5000)

DEPTHS: Final = (0, *ISOBATHS, 7000, 12000)
"""Edges (m) of the steps in which the sea floor is shaded."""

UNKNOWN_DEPTH: Final = 9000.0
"""A floor that is this deep (m) all over is the deep water of a run that knows no sea floor."""

NO_FLOOR: Final = 20.0
"""A floor nowhere deeper than this (m) is none: a depth of 0, and the sea level on top of it."""

FLOOR_POINTS: Final = 260
"""Points of the depth along each side of a map."""

STEPPED: Final = 50
"""A floor of fewer depths than this has steps, such as a zone that is simply declared dry, and no isobaths."""


class KnownDepth(Protocol):
    """What knows the depth of water."""

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""


def stretch(y: float, latlon: bool) -> float:
    """Return the units of x for one unit of y that make the same distance at ``y``."""
    return 1.0 / max(0.05, math.cos(math.radians(y))) if latlon else 1.0


def widened(box: Box, latlon: bool, shape: float, *, margin: float = 0.0, least: float = 0.0) -> Box:
    """Return a box with a margin (part of its longer side), widened to a shape so that a map fills its axes.

    ``shape``: width over height on the ground; ``least``: smallest side, in units of y.
    """
    x, y = 0.5 * (box.west + box.east), 0.5 * (box.south + box.north)
    wide = (box.east - box.west) / stretch(y, latlon)
    more = 2.0 * margin * max(wide, box.north - box.south)
    half = 0.5 * max(box.north - box.south + more, (wide + more) / shape, least)
    half_x = half * shape * stretch(y, latlon)
    return Box(x - half_x, x + half_x, y - half, y + half)


class Map:
    """A map on given axes; positions are degrees, or metres where ``latlon`` is false."""

    def __init__(
        self, ax: Axes, box: Box, *, latlon: bool = True, radius: float = EARTH_RADIUS_A68, ticks: int = 4,
        labels: bool = False,
    ) -> None:  # fmt: skip
        self.ax, self.box, self.latlon = ax, box, latlon
        self.units_per_km = 1e3 / (DEGREE * radius) if latlon else 1e3  # along y
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        self.stretch = stretch(0.5 * (box.south + box.north), latlon)
        ax.set_aspect(self.stretch)
        style.geographic_axes(ax, latlon=latlon, ticks=ticks, labels=labels)
        ax.set_facecolor(colours.SEA)
        self.shaded = False
        draw_coast(ax, box, latlon=latlon)

    def mesh(self, points: int) -> tuple[Floats, Floats]:
        """Return points on an even mesh over the map."""
        b = self.box
        x, y = np.meshgrid(np.linspace(b.west, b.east, points), np.linspace(b.south, b.north, points))
        return x, y

    def draw_floor(
        self, water: KnownDepth | None, *, shaded: bool = False, labels: bool = True, draft: float | None = None,
        hatched: bool = False,
    ) -> bool:  # fmt: skip
        """Draw the sea floor: depth in steps of colour if ``shaded``, isobaths, and if ``hatched`` what is above ``draft`` (m).

        Returns whether anything is hatched.
        """
        from matplotlib.colors import BoundaryNorm

        if water is None:
            return False
        x, y = self.mesh(FLOOR_POINTS)
        depth = np.ma.masked_invalid(water.depth(x, y))
        if depth.mask.all() or float(depth.max()) <= min(NO_FLOOR, NO_FLOOR if draft is None else draft):
            return False
        low, high = float(depth.min()), float(depth.max())
        self.shaded = shaded and low < UNKNOWN_DEPTH
        if self.shaded:
            shades = colours.depth_map()
            norm = BoundaryNorm(DEPTHS, shades.N)
            self.ax.contourf(x, y, depth, levels=DEPTHS, cmap=shades, norm=norm, zorder=0.5, antialiased=True)
        levels = [d for d in ISOBATHS if low < d < high]
        if levels and len(np.unique(depth.compressed())) >= STEPPED:
            lines = self.ax.contour(x, y, depth, levels=levels, colors=colours.ISOBATH, linewidths=0.6, zorder=2)
            if labels:
                self.ax.clabel(lines, fmt="%d m", fontsize=6)
        if not hatched or draft is None or not low < draft:
            return False
        filled = self.ax.contourf(x, y, depth, levels=[-1e9, draft], colors="none", hatches=["////"], zorder=3)
        filled.set_edgecolor(colours.GROUND)
        filled.set_linewidth(0.0)
        if draft < high:  # else the whole map is too shallow
            self.ax.contour(x, y, depth, levels=[draft], colors=colours.GROUND, linewidths=1.2, zorder=6)
        return True

    def draw_scale(self) -> None:
        """Draw a scale bar of about a quarter of the width."""
        y = self.box.south + 0.055 * (self.box.north - self.box.south)
        unit = self.units_per_km * stretch(y, self.latlon)
        km = style.round_length(0.25 * (self.box.east - self.box.west) / unit)
        style.scale_bar(self.ax, km=km, units_per_km=unit)


def draw_coast(ax: Axes, box: Box, *, latlon: bool = True) -> bool:
    """Draw land and coastlines; leave the map as it is where they are not to be had.

    ``ax``: longitude (on any branch) and latitude, degrees; ``latlon``: false for runs in metres, which have no coast.
    """
    from matplotlib.collections import LineCollection, PathCollection

    if not latlon:
        return False
    areas, lines = coast_in(box)
    for colour in (LAND, SHELF):
        paths = [_polygon_path(polygon) for polygon, shown in areas if shown == colour]
        # The extent of the map is that of the run, not of the continent.
        ax.add_collection(PathCollection(paths, facecolors=colour, edgecolors="none", zorder=COAST), autolim=False)
    shore = LineCollection(
        [np.asarray(line.coords)[:, :2] for line in lines], colors=SHORE, linewidths=0.8, zorder=COAST
    )
    ax.add_collection(shore, autolim=False)
    return bool(areas or lines)


@lru_cache(maxsize=64)
def coast_in(box: Box) -> tuple[list[tuple[Any, str]], list[Any]]:
    """Return areas with their colours, and lines, within and just around an extent."""
    resolution = _resolution(box.north - box.south)
    if resolution is None:
        return [], []
    areas = [
        (part, colour)
        for name, colour in FILLED
        for part in _clipped(natural_earth(resolution, name), box)
        if part.geom_type == "Polygon"
    ]
    lines = [part for name in SHORES for part in _clipped(natural_earth(resolution, name), box)]
    lines = [part for part in lines if part.geom_type == "LineString"]
    if not lines:
        lines = [ring for polygon, _ in areas for ring in (polygon.exterior, *polygon.interiors)]
    return areas, lines


def _resolution(height: float) -> str | None:
    """Return the finest scale that is there and fine enough for a map of ``height`` degrees."""
    for resolution, least in RESOLUTIONS:
        if height >= least and any(natural_earth(resolution, name) for name in ("land", "coastline")):
            return resolution
    return None


def natural_earth(resolution: str, name: str) -> Path | None:
    """Return the shapefile of a layer of Natural Earth if cartopy has it on this machine."""
    try:
        from cartopy import config
        from cartopy.io import Downloader
    except ImportError:
        return None
    # Cartopy's own path() downloads what it does not find; these two only tell where it would be.
    finder = Downloader.from_config(("shapefiles", "natural_earth", resolution, "physical", name))
    request = {"config": config, "category": "physical", "name": name, "resolution": resolution}
    places = (finder.pre_downloaded_path(request), finder.target_path(request))
    return next((Path(place) for place in places if place is not None and Path(place).is_file()), None)


@lru_cache(maxsize=16)
def _shapes(path: Path) -> list[Any]:
    from cartopy.io.shapereader import Reader

    return list(Reader(str(path)).geometries())


def _clipped(path: Path | None, box: Box) -> list[Any]:
    """Return the parts of the shapes of a file around a box, on the branch of its longitudes."""
    if path is None:
        return []
    import shapely

    # Cut a little outside of the map, so that the cuts are not seen on it.
    wide, high = 0.05 * (box.east - box.west), 0.05 * (box.north - box.south)
    pieces: list[Any] = []
    for turn in (-360.0, 0.0, 360.0):
        bounds = box.west - wide - turn, box.south - high, box.east + wide - turn, box.north + high
        for shape in _shapes(path):
            west, south, east, north = shape.bounds
            if east < bounds[0] or west > bounds[2] or north < bounds[1] or south > bounds[3]:
                continue
            # Shapes of the coarse layers may cross themselves; buffering by nothing mends areas.
            sound = shape if shape.is_valid or "Polygon" not in shape.geom_type else shape.buffer(0.0)
            moved = shapely.transform(
                shapely.clip_by_rect(sound, *bounds), lambda xy, turn=turn: xy + np.array([turn, 0.0])
            )
            pieces += [part for part in getattr(moved, "geoms", [moved]) if not part.is_empty]
    return pieces


def _polygon_path(polygon: Any) -> Any:
    """Return a polygon with its holes as a path of matplotlib."""
    from matplotlib.path import Path as Curve

    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return Curve.make_compound_path(*(Curve(ring, closed=True) for ring in rings))
