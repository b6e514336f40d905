"""Where in the world a map lies: a small polar view in a corner of it."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.plane import EqualAreaPlane
from riftberg.viz import colours, style
from riftberg.viz.coast import coast_in, coast_on, packaged, polygon_path

if TYPE_CHECKING:
    from riftberg.viz.panels import Panel

RIM: Final = {-1: 35.0, 1: 40.0}
"""Latitude at which the view ends: the coast of the package goes no further."""

SIZE: Final = 0.24
"""Side of the view over that of the map."""

CORNERS: Final = ((1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.13))
"""Where it may stand, best first; in the fourth corner above the scale bar."""


def draw_place(panel: Panel, labels: style.Labels) -> None:
    """Draw the view in the corner where it hides the least ice and track, then land; nothing where no coast is known."""
    import shapely
    from matplotlib.collections import PathCollection
    from matplotlib.patches import Circle

    ax, scene = panel.ax, panel.scene
    degrees = getattr(scene, "degrees", scene)
    lon, lat = (0.5 * float(v.min() + v.max()) for v in (degrees.x, degrees.y))
    side = 1 if lat > 0.0 else -1
    if not degrees.latlon or abs(lat) < RIM[side] + 2.0:
        return
    frame, box = ax.get_window_extent(), panel.box
    wide = SIZE * min(1.0, frame.height / frame.width)
    high = wide * frame.width / frame.height
    places = [(0.015 + a * (0.97 - wide), 0.015 + b * (0.97 - high)) for a, b in CORNERS]
    x, y = (scene.x - box.west) / (box.east - box.west), (scene.y - box.south) / (box.north - box.south)
    areas, _ = coast_in(box) if scene.plane is None else coast_on(box, scene.plane)

    def hidden(place: tuple[float, float]) -> tuple[int, bool]:
        left, low = place
        ice = (x > left - 0.05) & (x < left + wide + 0.05) & (y > low - 0.05) & (y < low + high + 0.05)
        west, south = box.west + left * (box.east - box.west), box.south + low * (box.north - box.south)
        east, north = west + wide * (box.east - box.west), south + high * (box.north - box.south)
        return int(ice.sum()), any(area.intersects(shapely.box(west, south, east, north)) for area, _ in areas)

    left, low = min(places, key=hidden)
    inset = ax.inset_axes((left, low, wide, high), zorder=11)
    plane = EqualAreaPlane(0.0, 90.0 * side, 1.0)
    rim = float(np.hypot(*plane.forward(np.array(0.0), np.array(side * RIM[side]))))
    disc = Circle((0.0, 0.0), rim, fc=colours.SEA, ec=colours.STRENGTH, lw=0.8)
    inset.add_patch(disc)
    for paths, colour in _view(side):
        land = PathCollection(paths, facecolors=colour, edgecolors=colour, linewidths=0.3)
        inset.add_collection(land)
        land.set_clip_path(disc)
    inset.plot(*plane.forward(np.array(lon), np.array(lat)), "s", ms=5, mfc="none", mec=colours.GROUND, mew=1.6)
    inset.set_xlim(-1.02 * rim, 1.02 * rim)
    inset.set_ylim(-1.02 * rim, 1.02 * rim)
    inset.set_aspect("equal")
    inset.axis("off")
    labels.avoid_box(inset.get_window_extent())


@lru_cache(maxsize=2)
def _view(side: int) -> list[tuple[list[Any], str]]:
    """Return land and ice shelves of a hemisphere on its view, coarsely."""
    import shapely

    plane = EqualAreaPlane(0.0, 90.0 * side, 1.0)
    layers = []
    for shapes, colour in packaged():
        near = [shape for shape in shapes if side * shape.centroid.y > 0.0]
        laid = shapely.transform(
            shapely.segmentize(near, 1.0), lambda xy: np.stack(plane.forward(xy[:, 0], xy[:, 1]), axis=-1)
        )
        # About 15 km, less than a tenth of a point of the view; what is smaller is no land of it.
        coarse = shapely.simplify(laid, 0.0025)
        kept = coarse[shapely.area(coarse) > 2e-6]
        layers.append(([polygon_path(p) for shape in kept for p in getattr(shape, "geoms", [shape])], colour))
    return layers
