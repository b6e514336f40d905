"""Land, ice shelves and coastlines of Natural Earth (public domain) on any map, without a network.

``coast.npz`` beside this module holds the coast of the polar oceans to 0.02 degrees (``docs/coast.py`` makes it). Where cartopy
is installed and has the layers at 1:10 million in its data folder, these are drawn instead; nothing is downloaded.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.units import place_text
from riftberg.plane import EqualAreaPlane
from riftberg.runs.scene import Box
from riftberg.state import Floats
from riftberg.viz import colours
from riftberg.viz.colours import LAND, SHELF, SHORE

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from riftberg.plane import ConformalPlane

FILLED: Final = (("land", LAND), ("minor_islands", LAND), ("antarctic_ice_shelves_polys", SHELF))
"""Layers of areas of Natural Earth."""

COAST: Final = 3.6
"""Height of the coast in the drawing: above currents and shoals, below ice and tracks."""

SHORES: Final = ("coastline", "minor_islands_coastline")
"""Layers of lines; unlike the edges of the areas, they have no seam along the date line."""

CUTS: Final = (-35.0, 40.0, -89.99)
"""Parallels at which the areas of the package are cut, and the pole: no coasts."""

UNITS: Final = 1000.0
"""Stored units in a degree."""

UNKNOWN_DEPTH: Final = 9000.0
"""A floor that is this deep (m) all over is the deep water of a run that knows no sea floor."""

RIM: Final = {-1: 35.0, 1: 40.0}
"""Latitude at which the view of a hemisphere ends: the coast of the package goes no further."""

SIZE: Final = 0.24
"""Side of the view over the side of the map."""

CORNERS: Final = ((1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.13))
"""Where it may stand, best first; in the fourth corner above the scale bar."""


def draw_coast(ax: Axes, box: Box, *, plane: ConformalPlane | None = None) -> set[str]:
    """Draw land, ice shelves and coastlines; return the colours of those that are on the map.

    ``box``: degrees (longitude on any branch), or metres of the plane of a polar map.
    """
    from matplotlib.collections import LineCollection, PathCollection

    areas, lines = clip_coast(box) if plane is None else project_coast(box, plane)
    for colour in (LAND, SHELF):
        paths = [polygon_path(polygon) for polygon, fill in areas if fill == colour]
        # The run sets the extent of the map, not the continent.
        ax.add_collection(PathCollection(paths, facecolors=colour, edgecolors="none", zorder=COAST), autolim=False)
    shore = LineCollection(
        [np.asarray(line.coords)[:, :2] for line in lines], colors=SHORE, linewidths=0.8, zorder=COAST
    )
    ax.add_collection(shore, autolim=False)
    # A little outside of the map is cut too.
    return {
        colour for area, colour in areas
        if (w := area.bounds)[0] < box.east and w[2] > box.west and w[1] < box.north and w[3] > box.south
    }  # fmt: skip


def draw_place(ax: Axes, box: Box, plane: ConformalPlane | None, x: Floats, y: Floats) -> Axes | None:
    """Draw where on the hemisphere a map lies, in the corner where it hides the fewest points, then land.

    ``x``, ``y``: ice and tracks on the map. Returns the axes of the view; none where no coast is known.
    """
    import shapely
    from matplotlib.collections import PathCollection
    from matplotlib.patches import Circle

    lon, lat = 0.5 * (box.west + box.east), 0.5 * (box.south + box.north)
    if plane is not None:
        lon, lat = (float(v) for v in plane.inverse(np.array(lon), np.array(lat)))
    side = 1 if lat > 0.0 else -1
    if abs(lat) < RIM[side] + 2.0:
        return None
    frame = ax.get_window_extent()
    wide = SIZE * min(1.0, frame.height / frame.width)
    high = wide * frame.width / frame.height
    corners = [(0.015 + a * (0.97 - wide), 0.015 + b * (0.97 - high)) for a, b in CORNERS]
    x, y = (x - box.west) / (box.east - box.west), (y - box.south) / (box.north - box.south)
    areas, _ = clip_coast(box) if plane is None else project_coast(box, plane)

    def hidden(corner: tuple[float, float]) -> tuple[int, bool]:
        left, low = corner
        points = (x > left - 0.05) & (x < left + wide + 0.05) & (y > low - 0.05) & (y < low + high + 0.05)
        west, south = box.west + left * (box.east - box.west), box.south + low * (box.north - box.south)
        east, north = west + wide * (box.east - box.west), south + high * (box.north - box.south)
        return int(points.sum()), any(area.intersects(shapely.box(west, south, east, north)) for area, _ in areas)

    left, low = min(corners, key=hidden)
    inset = ax.inset_axes((left, low, wide, high), zorder=11)
    view = EqualAreaPlane(0.0, 90.0 * side, 1.0)
    rim = float(np.hypot(*view.forward(np.array(0.0), np.array(side * RIM[side]))))
    disc = Circle((0.0, 0.0), rim, fc=colours.SEA, ec=colours.STRENGTH, lw=0.8)
    inset.add_patch(disc)
    for paths, colour in _view(side):
        land = PathCollection(paths, facecolors=colour, edgecolors=colour, linewidths=0.3)
        inset.add_collection(land)
        land.set_clip_path(disc)
    inset.plot(*view.forward(np.array(lon), np.array(lat)), "s", ms=5, mfc="none", mec=colours.GROUND, mew=1.6)
    inset.set(xlim=(-1.02 * rim, 1.02 * rim), ylim=(-1.02 * rim, 1.02 * rim), aspect="equal")
    inset.axis("off")
    return inset


@lru_cache(maxsize=2)
def _view(side: int) -> list[tuple[list[Any], str]]:
    """Return land and ice shelves of a hemisphere on its view, coarsely."""
    import shapely

    plane = EqualAreaPlane(0.0, 90.0 * side, 1.0)
    layers = []
    for shapes, colour in packaged_coast():
        on_side = [shape for shape in shapes if side * shape.centroid.y > 0.0]
        laid = shapely.transform(
            shapely.segmentize(on_side, 1.0), lambda xy: np.stack(plane.forward(xy[:, 0], xy[:, 1]), axis=-1)
        )
        # About 15 km, less than a tenth of a point of the view; smaller land is left out.
        coarse = shapely.simplify(laid, 0.0025)
        large = coarse[shapely.area(coarse) > 2e-6]
        layers.append(([polygon_path(p) for shape in large for p in getattr(shape, "geoms", [shape])], colour))
    return layers


def ice_over_land(run: xr.Dataset) -> str:
    """Return a sentence on the first ice of a run that floats over land; empty where none does.

    Where a run knows no sea floor, or one of coarse cells, bergs drift across islands without a word.
    """
    import shapely

    if "lat" not in run or "depth" not in run:
        return ""
    records = np.unique(np.linspace(0, run.sizes["time"] - 1, 60).astype(int))
    sample = run[["lon", "lat", "depth", "thickness"]].isel(time=records).transpose("time", ...)
    lon, lat, depth, thickness = (sample[name].values for name in ("lon", "lat", "depth", "thickness"))
    if not np.isfinite(lat).any():
        return ""
    west, east, south, north = (float(f(v)) for v in (lon, lat) for f in (np.nanmin, np.nanmax))
    box = Box(west - 0.01, east + 0.01, south - 0.01, north + 0.01)  # a row of elements has no height
    afloat = (depth > thickness) & np.isfinite(lat)
    dry = np.zeros(lat.shape, np.bool_)
    for area, colour in clip_coast(box)[0]:
        if colour == LAND:
            shapely.prepare(area)
            dry |= shapely.contains_xy(area, lon, lat)
    cells = np.argwhere(dry & afloat)
    if not len(cells):
        return ""
    k, n = cells[0]
    date = str(sample["time"].values[k].astype("datetime64[m]")).replace("T", " ")
    position = place_text(float(lon[k, n]), float(lat[k, n]), latlon=True, digits=1)
    floor = f"its sea floor is {depth[k, n]:.0f} m deep there" if depth[k, n] < UNKNOWN_DEPTH else "it has no sea floor"
    return (
        f"from {date} on ice of this run floats over land of the map, at {position}: {floor}. Add one to the forcing, such as "
        "that of 'riftberg fetch gebco'"
    )


@lru_cache(maxsize=16)
def project_coast(box: Box, plane: ConformalPlane) -> tuple[list[tuple[Any, str]], list[Any]]:
    """Return areas with their colours, and lines, on the plane of a polar map."""
    import shapely

    x, y = np.meshgrid(np.linspace(box.west, box.east, 80), np.linspace(box.south, box.north, 80))
    lon, lat = plane.inverse(x, y)
    low, high, west, east = float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max())
    if box.west < 0.0 < box.east and box.south < 0.0 < box.north:  # the pole is on the map
        low, high = (low, 90.0) if plane.lat0 > 0.0 else (-90.0, high)
        west, east = plane.lon0 - 179.99, plane.lon0 + 179.99
    areas, lines = clip_coast(Box(west, east, low, high))

    def laid(shape: Any) -> Any:
        # Cuts run along parallels and meridians, which are bent on the plane.
        return shapely.transform(
            shapely.segmentize(shape, 0.5), lambda xy: np.stack(plane.forward(xy[:, 0], xy[:, 1]), axis=-1)
        )

    return [(laid(area), colour) for area, colour in areas], [laid(line) for line in lines]


@lru_cache(maxsize=64)
def clip_coast(box: Box) -> tuple[list[tuple[Any, str]], list[Any]]:
    """Return areas with their colours, and lines, within and just around an extent."""
    finer = any(natural_earth(name) for name in ("land", "coastline"))
    layers = [(_shapes(natural_earth(name)), colour) for name, colour in FILLED] if finer else packaged_coast()
    areas = [
        (piece, colour) for shapes, colour in layers for piece in _clip(shapes, box) if piece.geom_type == "Polygon"
    ]
    lines = [piece for name in SHORES for piece in _clip(_shapes(natural_earth(name)), box)] if finer else []
    if not finer:
        lines = [piece for shapes, _ in layers for piece in _clip(shapes, box, edges=True)]
    lines = [piece for piece in lines if piece.geom_type == "LineString"]
    if finer and not lines:
        lines = [ring for polygon, _ in areas for ring in (polygon.exterior, *polygon.interiors)]
    return areas, lines


@lru_cache(maxsize=1)
def packaged_coast() -> list[tuple[list[Any], str]]:
    """Return the land and the ice shelves that come with the package."""
    import shapely

    layers = []
    with np.load(Path(__file__).with_name("coast.npz")) as file:
        for name, colour in (("land", LAND), ("shelf", SHELF)):
            sizes, rings = file[f"{name}_sizes"], file[f"{name}_rings"]
            change = np.stack([file[f"{name}_x"], file[f"{name}_y"]], axis=-1).astype(np.int64)
            begins = np.cumsum(sizes) - sizes
            path = np.cumsum(change, axis=0)
            # Each ring begins with its own first point, and goes on with differences.
            offset = path[begins] - change[begins]
            points = (path - np.repeat(offset, sizes, axis=0)) / UNITS
            shores = shapely.linearrings(points, indices=np.repeat(np.arange(sizes.size), sizes))
            layers.append((list(shapely.polygons(shores, indices=np.repeat(np.arange(rings.size), rings))), colour))
    return layers


def natural_earth(name: str) -> Path | None:
    """Return the shapefile of a layer of Natural Earth at 1:10 million if cartopy has it on this machine."""
    try:
        from cartopy import config
        from cartopy.io import Downloader
    except ImportError:
        return None
    # Cartopy's own path() downloads missing files; these two only say where it would be.
    finder = Downloader.from_config(("shapefiles", "natural_earth", "10m", "physical", name))
    request = {"config": config, "category": "physical", "name": name, "resolution": "10m"}
    candidates = (finder.pre_downloaded_path(request), finder.target_path(request))
    return next(
        (Path(candidate) for candidate in candidates if candidate is not None and Path(candidate).is_file()), None
    )


@lru_cache(maxsize=16)
def _shapes(path: Path | None) -> list[Any]:
    if path is None:
        return []
    from cartopy.io.shapereader import Reader

    return list(Reader(str(path)).geometries())


def _clip(shapes: list[Any], box: Box, *, edges: bool = False) -> list[Any]:
    """Return the parts of shapes around a box, or of their ``edges`` without cuts, on the branch of its longitudes."""
    import shapely

    # Cut a little outside of the map, so that the cuts are not seen on it.
    wide, high = 0.05 * (box.east - box.west), 0.05 * (box.north - box.south)
    pieces: list[Any] = []
    for turn in (-360.0, 0.0, 360.0):
        bounds = box.west - wide - turn, box.south - high, box.east + wide - turn, box.north + high
        for shape in shapes:
            west, south, east, north = shape.bounds
            if east < bounds[0] or west > bounds[2] or north < bounds[1] or south > bounds[3]:
                continue
            # Shapes of coarse layers may cross themselves; buffering by nothing mends areas.
            sound = shape if shape.is_valid or "Polygon" not in shape.geom_type else shape.buffer(0.0)
            moved = shapely.transform(
                shapely.clip_by_rect(_edges(shape) if edges else sound, *bounds),
                lambda xy, turn=turn: xy + np.array([turn, 0.0]),
            )
            pieces += [piece for piece in getattr(moved, "geoms", [moved]) if not piece.is_empty]
    return pieces


def _edges(polygon: Any) -> Any:
    """Return the edges of a polygon of the package that are coasts, not cuts along parallels, the date line or the pole."""
    import shapely

    segments = []
    for ring in (polygon.exterior, *polygon.interiors):
        points: Floats = np.asarray(ring.coords)
        begin, end = points[:-1], points[1:]
        seam = (np.abs(begin[:, 0]) > 179.99) & (np.abs(end[:, 0]) > 179.99)
        for cut in CUTS:
            beside = (np.abs(a[:, 1] - cut) < 0.02 for a in (begin, end))
            seam |= np.logical_and(*beside)
        runs = np.split(np.arange(len(seam)), np.flatnonzero(np.diff(seam)) + 1)
        segments += [points[k[0] : k[-1] + 2] for k in runs if len(k) and not seam[k[0]]]
    return shapely.MultiLineString(segments)


def polygon_path(polygon: Any) -> Any:
    """Return a polygon with its holes as a path of matplotlib."""
    from matplotlib.path import Path as Curve

    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return Curve.make_compound_path(*(Curve(ring, closed=True) for ring in rings))
