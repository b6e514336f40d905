"""Polar stereographic maps: what maps ask of a run and of its water, on a plane that touches a pole.

Meridians meet near the poles, so a map in degrees is stretched from its lower to its upper edge there. Maps beyond
60 degrees take this plane by themselves; everything that draws on them draws metres.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from riftberg.errors import InputError
from riftberg.plane import ConformalPlane
from riftberg.runs.background import water_of
from riftberg.runs.scene import Scene
from riftberg.state import Floats
from riftberg.viz import colours
from riftberg.viz.style import degree_label

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from riftberg.runs.scene import Box

Projection = Literal["auto", "polar", "degrees"]

PROJECTIONS: Final[tuple[Projection, ...]] = ("auto", "polar", "degrees")

POLAR: Final = 60.0
"""Maps whose middle is nearer to a pole than this latitude are polar stereographic."""

STEPS: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0)
"""Degrees between meridians, and between parallels."""


def plane_at(lon: float, lat: float, radius: float) -> ConformalPlane:
    """Return the polar stereographic plane whose lengths are true at a place, with its meridian upright."""
    true = 0.5 * (1.0 + math.sin(math.radians(abs(lat))))
    return ConformalPlane(lon, math.copysign(90.0, lat), true * radius)


class PolarScene(Scene):
    """A run on the plane of its pole: ``x`` and ``y`` are metres, true at the middle latitude."""

    def __init__(self, run: xr.Dataset) -> None:
        super().__init__(run)
        self.degrees = Scene(run)
        lon, lat = (0.5 * float(v.min() + v.max()) for v in (self.x, self.y))
        self.pole = self.plane = plane_at(lon, lat, self.radius)
        self.x, self.y = self.pole.forward(self.x, self.y)
        self.latlon = False

    def polygons(self, record: int) -> Floats:
        """Return the corners of all elements at a record, shape (elements, corners, 2)."""
        return np.stack(self.pole.forward(*np.moveaxis(self.degrees.polygons(record), -1, 0)), axis=-1)

    def placed(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return a place, given in degrees, on the map."""
        return self.pole.forward(lon, lat)


class PolarWater:
    """The water of a run on the plane of a map."""

    def __init__(self, water: Any, plane: ConformalPlane) -> None:
        self.water, self.plane = water, plane

    def currents(self, x: Floats, y: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) along x and y."""
        lon, lat = self.plane.inverse(x, y)
        u, v = self.water.currents(lon, lat, time)
        turn = self.plane.eastward(lon, lat)
        return u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)

    def depth(self, x: Floats, y: Floats) -> Floats:
        """Return the depth of water, m."""
        depth: Floats = self.water.depth(*self.plane.inverse(x, y))
        return depth


def on_a_map(run: xr.Dataset, projection: Projection = "auto", water: Any = None) -> tuple[Scene, Any]:
    """Return a run and its water as maps draw them, in degrees or on the plane of a pole; ``water``: of the caller's."""
    if projection not in PROJECTIONS:
        raise InputError(f"{projection!r} is not known", where="projection", remedy=f"Use {', '.join(PROJECTIONS)}")
    scene = Scene(run)
    water = water or water_of(run)
    middle = 0.5 * float(scene.y.min() + scene.y.max())
    if projection == "polar" and (not scene.latlon or middle == 0.0):
        raise InputError(
            "no polar map of this run", where="projection", remedy="Its positions must be degrees, off the equator"
        )
    if not scene.latlon or projection == "degrees" or (projection == "auto" and abs(middle) < POLAR):
        return scene, water
    polar = PolarScene(run)
    return polar, None if water is None else PolarWater(water, polar.pole)


def draw_graticule(ax: Axes, box: Box, plane: ConformalPlane, *, lines: int) -> None:
    """Draw meridians and parallels, about so many of each, with their degrees where they cross the lower and the left edge."""
    mesh = plane.inverse(*np.meshgrid(np.linspace(box.west, box.east, 60), np.linspace(box.south, box.north, 60)))
    edges = {
        "x": plane.inverse(np.linspace(box.west, box.east, 400), np.full(400, box.south)),
        "y": plane.inverse(np.full(400, box.west), np.linspace(box.south, box.north, 400)),
    }
    for which, values, names in (("x", 0, "EW"), ("y", 1, "NS")):
        low, high = float(mesh[values].min()), float(mesh[values].max())
        along = np.unwrap(edges[which][values], period=360.0) if which == "x" else edges[which][values]
        shown = float(np.ptp(along)) if which == "x" else high - low
        step = next((step for step in STEPS if shown <= step * lines), STEPS[-1])
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        degrees = step * np.arange(math.floor(low / step), math.ceil(high / step) + 1)
        for value in degrees:
            if which == "x":
                line = np.full(200, value), np.linspace(mesh[1].min(), mesh[1].max(), 200)
            else:
                line = np.linspace(plane.lon0 - 180.0, plane.lon0 + 180.0, 721), np.full(721, value)
            ax.plot(
                *plane.forward(*line), color=colours.ISOBATH, lw=0.5, alpha=0.6, zorder=1.2, scalex=False, scaley=False
            )
        here = np.linspace(*((box.west, box.east) if which == "x" else (box.south, box.north)), 400)
        ticks = [(float(here[k]), value) for value in degrees for k in np.flatnonzero(np.diff(np.sign(along - value)))]
        axis = ax.xaxis if which == "x" else ax.yaxis
        axis.set_ticks(
            [place for place, _ in ticks], [degree_label(value, names[0], names[1], decimals) for _, value in ticks]
        )
    ax.tick_params(labelsize=8, length=3)
