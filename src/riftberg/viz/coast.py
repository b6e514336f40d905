"""Coastlines of Natural Earth on a map, where cartopy is installed and has them on this machine; nothing is downloaded.

Cartopy keeps the shapefiles in its data folder (``cartopy.config["data_dir"]``) once a program or its own download
script (``cartopy_feature_download``) has fetched them. The maps stay plain longitude-latitude maps; cartopy finds and
reads the shapes.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.runs.scene import Box
from riftberg.viz.colours import LAND, SHELF, SHORE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RESOLUTIONS: Final = (("10m", 0.0), ("50m", 2.0), ("110m", 10.0))
"""Scales of Natural Earth (1:10 million and so on), finest first, and the least height of a map (degrees) for each: a
coarse coastline on a close map, kilometres off, is worse than none."""

FILLED: Final = (("land", LAND), ("minor_islands", LAND), ("antarctic_ice_shelves_polys", SHELF))
"""Layers of areas."""

SHORES: Final = ("coastline", "minor_islands_coastline")
"""Layers of lines; unlike the edges of the areas, they have no seam along the date line."""


def draw_coast(ax: Axes, box: Box, *, latlon: bool = True, zorder: float = 3.6) -> bool:
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
        ax.add_collection(PathCollection(paths, facecolors=colour, edgecolors="none", zorder=zorder), autolim=False)
    shore = LineCollection(
        [np.asarray(line.coords)[:, :2] for line in lines], colors=SHORE, linewidths=0.8, zorder=zorder
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
