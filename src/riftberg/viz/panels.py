"""One map panel and its layers: extent and coast, water, sea floor, ice, bonds, observed outlines, scale bar.

Beyond 60 degrees maps are polar stereographic, on a plane that touches a pole: meridians meet there, so a map in degrees is
stretched from its lower to its upper edge. Everything that draws on them draws metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from riftberg.config.units import area_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.engines.common.rift_tips import tip_label
from riftberg.errors import InputError
from riftberg.ocean.forcing import Forcing
from riftberg.plane import ConformalPlane, near
from riftberg.runs.background import KeptWater, StoredWater, find_water
from riftberg.runs.positions import filled_forward, stretch
from riftberg.runs.scene import Box, Scene
from riftberg.runs.tracks import is_channel
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.coast import UNKNOWN_DEPTH, draw_coast, draw_place
from riftberg.viz.style import degree_label, is_short, moment_text

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.patches import Patch
    from matplotlib.quiver import Quiver


Projection = Literal["auto", "polar", "degrees"]

PROJECTIONS: Final[tuple[Projection, ...]] = ("auto", "polar", "degrees")

POLAR: Final = 60.0
"""Maps whose middle is nearer to a pole than this latitude are polar stereographic."""

STEPS: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0)
"""Degrees between meridians, and between parallels."""


def polar_plane(lon: float, lat: float, radius: float) -> ConformalPlane:
    """Return the polar stereographic plane whose lengths are true at a place, with its meridian upright."""
    true = 0.5 * (1.0 + math.sin(math.radians(abs(lat))))
    return ConformalPlane(lon, math.copysign(90.0, lat), true * radius)


class PolarScene(Scene):
    """A run on the plane of its pole: ``x`` and ``y`` are metres, true at the middle latitude."""

    def __init__(self, run: xr.Dataset) -> None:
        super().__init__(run)
        self.degrees = Scene(run)
        lon, lat = (0.5 * float(v.min() + v.max()) for v in (self.x, self.y))
        self.pole = self.plane = polar_plane(lon, lat, self.radius)
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


def project_run(run: xr.Dataset, projection: Projection = "auto", water: Any = None) -> tuple[Scene, Any]:
    """Return a run and its water as maps draw them, in degrees or on the plane of a pole; ``water``: of the caller's."""
    if projection not in PROJECTIONS:
        raise InputError(f"{projection!r} is not known", where="projection", remedy=f"Use {', '.join(PROJECTIONS)}")
    scene = Scene(run)
    water = water or find_water(run)
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
        extent = float(np.ptp(along)) if which == "x" else high - low
        step = next((step for step in STEPS if extent <= step * lines), STEPS[-1])
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
            [position for position, _ in ticks],
            [degree_label(value, names[0], names[1], decimals) for _, value in ticks],
        )
    ax.tick_params(labelsize=8, length=3)


ISOBATHS: Final = (50, 100, 200, 300, 500, 1000, 2000, 3000, 4000, 5000)

DEPTHS: Final = (0, *ISOBATHS, 7000, 12000)
"""Edges (m) of the steps in which a sea floor from shelf to deep sea is shaded."""

FEW_STEPS: Final = 4
"""A map with fewer of them has even steps between its own depths."""

NO_FLOOR: Final = 20.0
"""A floor nowhere deeper than this (m) is none: a depth of 0, and the sea level on top of it."""

FLOOR_POINTS: Final = 260
"""Points of the depth along each side of a map."""

STEPPED: Final = 50
"""A floor of fewer depths than this has steps, such as a zone that is simply declared dry, and no isobaths."""


def depth_steps(low: float, high: float) -> list[float]:
    """Return the edges (m) of the steps of a scale that shows the depths of a map; none where they are all about the same."""
    from matplotlib.ticker import MaxNLocator

    if high - low < max(1.0, 0.01 * high):
        return []
    first, last = np.searchsorted(DEPTHS, low, side="right") - 1, np.searchsorted(DEPTHS, min(high, DEPTHS[-1]))
    if last - first >= FEW_STEPS:
        return [float(depth) for depth in DEPTHS[first : last + 1]]
    return [float(depth) for depth in MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)]


def is_zone(depth: Floats) -> bool:
    """Whether a part is declared dry, and no depths are known."""
    return len(np.unique(depth)) < STEPPED and float(depth.min()) <= 0.0 < float(depth.max())


def widen_box(box: Box, latlon: bool, shape: float, *, margin: float = 0.0, least: float = 0.0) -> Box:
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
        labels: bool = False, plane: ConformalPlane | None = None,
    ) -> None:  # fmt: skip
        self.ax, self.box, self.latlon, self.plane = ax, box, latlon, plane
        self.units_per_km = 1e3 / (DEGREE * radius) if latlon else 1e3  # along y
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        self.stretch = stretch(0.5 * (box.south + box.north), latlon)
        ax.set_aspect(self.stretch)
        if plane is None:
            style.geographic_axes(ax, latlon=latlon, ticks=ticks, labels=labels)
        else:
            draw_graticule(ax, box, plane, lines=ticks)
        ax.set_facecolor(colours.SEA)
        self.depth_steps: list[float] = []  # Of the scale in which the sea floor is shaded
        # Runs in metres that are no place on the Earth have no coast.
        self.coast = draw_coast(ax, box, plane=plane) if latlon or plane is not None else set()

    @classmethod
    def around(
        cls, ax: Axes, x: Floats, y: Floats, *, latlon: bool = True, radius: float = EARTH_RADIUS_A68, shape: float = 1.0,
        margin: float = 0.06, least: float = 0.0, ticks: int = 5,
    ) -> Map:  # fmt: skip
        """Return a map around positions of an ensemble or of several runs; beyond 60 degrees it is polar stereographic.

        ``x``, ``y``: degrees, longitudes on any branch, or metres; values that are not finite do not count. ``least``: smallest
        side, m.
        """
        finite = np.isfinite(x) & np.isfinite(y)
        x, y = x[finite], y[finite]
        plane = None
        if latlon:
            x = near(x, x[0])
            lon, lat = (0.5 * float(v.min() + v.max()) for v in (x, y))
            if abs(lat) > POLAR:
                plane = polar_plane(lon, lat, radius)
                x, y = plane.forward(x, y)
        latlon = latlon and plane is None
        box = Box(float(x.min()), float(x.max()), float(y.min()), float(y.max()))
        smallest = max(least / (DEGREE * radius) if latlon else least, 1e-9)
        box = widen_box(box, latlon, shape, margin=margin, least=smallest)
        return cls(ax, box, latlon=latlon, radius=radius, ticks=ticks, plane=plane, labels=not latlon)

    def placed(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return positions of a run on the map: on its plane, or on the branch of its longitudes."""
        if self.plane is not None:
            return self.plane.forward(np.asarray(x, np.float64), np.asarray(y, np.float64))
        middle = 0.5 * (self.box.west + self.box.east)
        return (near(x, middle) if self.latlon else x), y

    def draw_place(self, x: Floats, y: Floats, labels: style.Labels | None = None) -> Axes | None:
        """Draw where on the Earth the map lies, off points of it, once the axes have their place; labels keep off."""
        if not self.latlon and self.plane is None:
            return None
        inset = draw_place(self.ax, self.box, self.plane, x, y)
        if inset is not None and labels is not None:
            labels.avoid_box(inset.get_window_extent())
        return inset

    def mesh(self, points: int) -> tuple[Floats, Floats]:
        """Return points on an even mesh over the map."""
        b = self.box
        x, y = np.meshgrid(np.linspace(b.west, b.east, points), np.linspace(b.south, b.north, points))
        return x, y

    def draw_floor(
        self, water: Water | None, *, shaded: bool = False, labels: bool = True, draft: float | None = None,
        hatched: bool = False,
    ) -> None:  # fmt: skip
        """Draw the sea floor: isobaths, if ``shaded`` steps of colour, and if ``hatched`` the floor above ``draft``, m.

        A shaded floor needs its `depth_bar`.
        """
        from matplotlib.colors import BoundaryNorm
        from matplotlib.patheffects import withStroke

        if water is None:
            return
        x, y = self.mesh(FLOOR_POINTS)
        depth = np.ma.masked_invalid(water.depth(x, y))
        if depth.mask.all() or float(depth.max()) <= min(NO_FLOOR, NO_FLOOR if draft is None else draft):
            return
        low, high = float(depth.min()), float(depth.max())
        stepped, zone = len(np.unique(depth.compressed())) < STEPPED, is_zone(depth.compressed())
        if shaded and low < UNKNOWN_DEPTH and not zone:
            self.depth_steps = depth_steps(max(low, 0.0), high)
        if self.depth_steps:
            shades = colours.depth_map()
            norm = BoundaryNorm(self.depth_steps, shades.N)
            self.ax.contourf(x, y, depth, levels=self.depth_steps, cmap=shades, norm=norm, zorder=0.5, antialiased=True)
        levels = [d for d in ISOBATHS if low < d < high]
        if levels and not stepped:
            lines = self.ax.contour(x, y, depth, levels=levels, colors=colours.ISOBATH, linewidths=0.6, zorder=2)
            if labels and not self.depth_steps:  # the scale of a shaded floor names them
                for name in self.ax.clabel(lines, fmt="%d m", fontsize=6, zorder=7):
                    name.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        if not hatched or draft is None or not low < draft:
            return
        filled = self.ax.contourf(
            x, y, depth, levels=[-1e9, draft], colors="none", hatches=["/" if zone else "////"], zorder=3
        )
        filled.set_edgecolor(colours.GROUND)
        filled.set_linewidth(0.0)
        if draft < high:  # else the whole map is too shallow
            self.ax.contour(x, y, depth, levels=[draft], colors=colours.GROUND, linewidths=1.2, zorder=6)

    def draw_scale(self) -> None:
        """Draw a scale bar of about a quarter of the width."""
        y = self.box.south + 0.055 * (self.box.north - self.box.south)
        unit = self.units_per_km * stretch(y, self.latlon)
        km = style.round_length(0.25 * (self.box.east - self.box.west) / unit)
        style.scale_bar(self.ax, km=km, units_per_km=unit)


Water = Forcing | StoredWater | KeptWater | PolarWater

SEAM: Final[dict[str, Any]] = {"color": "black", "lw": 1.0, "ls": (0, (6, 4))}
"""Look of the ends of a periodic channel."""

DOT: Final = 3.0
"""Size (points) below which a fragment is drawn as a dot."""

FEWEST: Final = 4.0
"""A panel is at least so many elements wide: one that a single element fills shows nothing of the water."""

LARGE_BOX: Final = 1.6
"""Panels share one extent where it is at most so many times the extent of the largest berg."""


class Panel(Map):
    """A map of a run on given axes."""

    def __init__(
        self, ax: Axes, scene: Scene, box: Box, water: Water | None = None, *, ticks: int = 4, labels: bool = False
    ) -> None:
        super().__init__(
            ax, box, latlon=scene.latlon, radius=scene.radius, ticks=ticks, labels=labels, plane=scene.plane
        )
        self.scene, self.water = scene, water
        # A periodic channel goes on: its ends stand where one passes into the next.
        period, self.seams = scene.parameters.earth.period, []
        if is_channel(scene.parameters):
            self.seams = [period * k for k in range(math.ceil(box.west / period), math.floor(box.east / period) + 1)]
        for x in self.seams:
            ax.axvline(x, zorder=3.5, **SEAM)

    def speeds(self, record: int) -> tuple[float, float]:
        """Return the smallest and the largest current speed in the panel, m s-1; 0 where there is no current."""
        if self.water is None:
            return 0.0, 0.0
        speed = np.hypot(*self.water.currents(*self.mesh(40), float(self.scene.seconds[record])))
        return (float(np.nanmin(speed)), float(np.nanmax(speed))) if np.isfinite(speed).any() else (0.0, 0.0)

    def draw_date(
        self, record: int, top: float, palette: dict[int, str], rings: Sequence[Floats] = (), *, arrows: int = 13,
        steps: int | None = None, depths: bool = True, melted: tuple[Floats, Normalize] | None = None, **look: Any,
    ) -> Quiver | None:  # fmt: skip
        """Draw a record: currents, sea floor, ice, observed outlines and a scale bar.

        ``melted``: thickness that the elements have lost (m) and its scale, which then colours the ice. Returns the arrows
        of the currents.
        """
        quiver = self.draw_currents(record, top, arrows=arrows, steps=steps)
        self.draw_ground(labels=depths)
        if melted is None:
            self.draw_ice(record, palette)
        else:
            self.draw_values(record, melted[0], colours.melt_map(), melted[1])
        self.draw_outlines(rings, **look)
        if record == len(self.scene.times) - 1:
            self.draw_rift_tips()
        self.draw_scale()
        return quiver

    def draw_rift_tips(self) -> None:
        """Mark the tips of rifts that stand at the end of the run, and say how near to their toughness they are."""
        for tip in self.scene.rift_tips:
            x, y = self.placed(np.array([tip.lon]), np.array([tip.lat]))
            self.ax.plot(x, y, "D", ms=4, mfc="white", mec="black", mew=0.8, zorder=9)
            self.ax.annotate(
                tip_label(tip, self.scene.parameters), (x[0], y[0]), (5, 5), textcoords="offset points", fontsize=7, zorder=9,
                annotation_clip=True,
            )  # fmt: skip

    def draw_currents(self, record: int, top: float, *, arrows: int = 13, steps: int | None = None) -> Quiver | None:
        """Draw speed as colour up to ``top`` (m s-1), smooth or in a number of steps, and arrows; return the arrows."""
        if self.water is None:
            return None
        time = float(self.scene.seconds[record])
        x, y = self.mesh(70)
        speed = np.hypot(*self.water.currents(x, y, time))
        if not np.isfinite(speed).any():
            return None
        b = self.box
        self.ax.set_facecolor(colours.NO_WATER)
        self.ax.imshow(
            np.ma.masked_invalid(speed), cmap=colours.speed_map(steps), vmin=0.0, vmax=top, interpolation="bilinear",
            extent=(b.west, b.east, b.south, b.north), origin="lower", aspect=self.ax.get_aspect(), zorder=0,
        )  # fmt: skip
        # Arrows in the middle of equal boxes, none on the frame.
        margin_x, margin_y = (b.east - b.west) / arrows / 2, (b.north - b.south) / arrows / 2
        ax, ay = np.meshgrid(
            np.linspace(b.west + margin_x, b.east - margin_x, arrows),
            np.linspace(b.south + margin_y, b.north - margin_y, arrows),
        )
        u, v = self.water.currents(ax, ay, time)
        return self.ax.quiver(
            ax, ay, u, v, angles="uv", scale=1.05 * arrows * top, width=0.036 / arrows, headwidth=3.4, headlength=3.8,
            headaxislength=3.4, minshaft=1.6, color=colours.ARROW, minlength=0.4, zorder=2,
        )  # fmt: skip

    def draw_ground(self, *, shaded: bool = False, labels: bool = True) -> None:
        """Draw the sea floor, hatched where the keel touches it and it acts on the ice."""
        scene = self.scene
        self.draw_floor(self.water, shaded=shaded, labels=labels, draft=scene.draft(), hatched=scene.has_floor)

    def ground_patches(self) -> list[Patch]:
        """Return the entry of the hatching by `draw_ground` in a legend; none where it hatches nothing."""
        from matplotlib.patches import Patch

        draft = self.scene.draft()
        depth = np.full(1, np.nan) if self.water is None else self.water.depth(*self.mesh(FLOOR_POINTS))
        finite = depth[np.isfinite(depth)]
        if not (self.scene.has_floor and finite.size and finite.min() < draft and finite.max() > min(NO_FLOOR, draft)):
            return []
        hatch, label = "////", f"shallower than the keel ({draft:.0f} m)"
        if is_zone(finite):
            hatch, label = "//", "grounds here by the set-up; no depths"
        return [Patch(fc="white", ec=colours.GROUND, hatch=hatch, label=label)]

    def points_per_metre(self) -> float:
        """Return the size (points) of a metre on the picture, once its axes have their place."""
        inches = self.ax.get_window_extent().height / float(self.ax.figure.dpi)
        return 72.0 * inches / (self.box.north - self.box.south) * self.units_per_km / 1e3

    def draw_ice(self, record: int, palette: dict[int, str], *, alpha: float = 1.0, zorder: float = 5.0) -> None:
        """Draw the elements in the colours of their fragments."""
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import to_rgba

        scene, numbers = self.scene, self.scene.berg[record]
        faces = [to_rgba(palette.get(int(n), colours.SMALL), alpha) for n in numbers]
        thin = 0.2 if len(numbers) < 2500 else 0.0
        self.ax.add_collection(
            PolyCollection(
                list(scene.polygons(record)), facecolors=faces, edgecolors=(0, 0, 0, 0.4 * alpha), linewidths=thin,
                zorder=zorder,
            )
        )  # fmt: skip
        # Fragments smaller than a dot get one: bergs of a field would not be seen otherwise.
        size = np.sqrt(scene.areas[record]) * self.points_per_metre()
        for number in np.unique(numbers[(numbers > 0) & (size < DOT)]):
            members = numbers == number
            if math.sqrt(float((size[members] ** 2).sum())) < DOT:
                centre = scene.x[record][members].mean(), scene.y[record][members].mean()
                colour = palette.get(int(number), colours.SMALL)
                # Those without a name lie below the berg that they may come from.
                on_top = zorder if int(number) in palette else zorder - 0.1
                self.ax.plot(*centre, "o", ms=DOT, color=colour, mec="black", mew=0.3, alpha=alpha, zorder=on_top)

    def draw_values(self, record: int, values: Floats, shades: Colormap, scale: Normalize) -> None:
        """Draw the elements in the colour of their values."""
        from matplotlib.collections import PolyCollection

        present = self.scene.there[record]
        ice = PolyCollection(
            list(self.scene.polygons(record)[present]), array=values[present], cmap=shades, norm=scale,
            edgecolors=colours.ICE_EDGE, linewidths=0.2, zorder=4,
        )  # fmt: skip
        self.ax.add_collection(ice)

    def draw_bonds(self, record: int, values: Floats, shades: Colormap, scale: Normalize) -> None:
        """Draw unbroken bonds in the colour of their values, cracks as lines, and broken bonds without one dotted."""
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.colors import to_rgba

        scene, run = self.scene, self.scene.run
        first, second = run["bond_first"].values, run["bond_second"].values
        ends = np.stack([np.stack([scene.x[record][k], scene.y[record][k]], axis=-1) for k in (first, second)], axis=1)
        # Bonds of hexagons cross at 60 degrees and are drawn slimmer.
        width = np.sqrt(scene.areas[record][first]) * np.where(scene.sides[first] == 6, 0.34, 0.62)
        points = np.maximum(0.6, self.points_per_metre() * width)
        intact = np.flatnonzero(scene.bonds.unbroken[record])
        intact = intact[np.argsort(values[intact])]  # the largest values on top
        # Between its bonds an element has the mean of their colours, or the map would be a grid of gaps.
        bonded = np.concatenate([first[intact], second[intact]])
        bonds = np.bincount(bonded, minlength=len(scene.area))
        mean = np.bincount(bonded, np.tile(values[intact], 2), minlength=len(scene.area)) / np.maximum(bonds, 1)
        faces = np.where(bonds[:, None] > 0, shades(scale(mean)), to_rgba(colours.ICE))
        self.ax.add_collection(PolyCollection(list(scene.polygons(record)), facecolors=faces, linewidths=0.0, zorder=4))
        self.ax.add_collection(
            LineCollection(
                list(ends[intact]), array=values[intact], cmap=shades, norm=scale, linewidths=points[intact],
                capstyle="butt", zorder=5,
            )
        )  # fmt: skip
        length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        close = ~scene.bonds.unbroken[record] & (
            length < 2.5 * np.median(length)
        )  # not across to a piece that drifted off
        for rows, line in scene.crack_lines(record):
            visible = np.where(close[rows][:, None], line, np.nan)
            self.ax.plot(*visible.T, color="black", lw=1.6, solid_capstyle="round", zorder=6)
            close[rows] = False
        self.ax.add_collection(
            LineCollection(
                list(ends[close]), colors="black", linewidths=np.minimum(1.8, 0.7 * points[close]), linestyles=":",
                zorder=6,
            )
        )  # fmt: skip

    def draw_outlines(self, rings: Sequence[Floats], **look: Any) -> None:
        """Draw observed outlines (longitude, latitude)."""
        for ring in rings:
            x, y = self.placed(ring[:, 0], ring[:, 1])
            closed = np.append(x, x[0]), np.append(y, y[0])
            self.ax.plot(*closed, **{"color": colours.OBSERVED, "lw": 1.2, "zorder": 7, **look})


def fragment_colours(scene: Scene) -> dict[int, str]:
    """Return a colour for each named fragment."""
    return dict(zip(scene.numbers, colours.FRAGMENTS, strict=False))


def fragment_patches(scene: Scene) -> list[Patch]:
    """Return the entries of the fragments in a legend."""
    from matplotlib.patches import Patch

    palette = fragment_colours(scene).items()
    return [Patch(fc=colour, ec="black", lw=0.5, label=fragment_name(scene, number)) for number, colour in palette]


def fragment_name(scene: Scene, number: int) -> str:
    """Return a description of a fragment, in a few words."""
    size, birth = area_text(scene.final_area(number), squared="²"), scene.birth(number)
    if birth is None:
        return f"{scene.name(number)}: {size} at the end"
    when = moment_text(scene.times, birth[0])
    off = f"off after {when}" if is_short(scene.times) else f"off on {when}"
    return f"{scene.name(number)}: {size}, {off}" + (", aground" if birth[1] else ", afloat")


def speed_scale(panels: Sequence[Panel], records: Sequence[int]) -> tuple[float, bool]:
    """Return the end of the speed scale of panels at these records, m s-1, and whether the water flows in any.

    A current of one speed everywhere stands in the middle of its scale, so that it is not all dark under arrows and ice.
    """
    speeds = [panel.speeds(record) for panel, record in zip(panels, records, strict=True)]
    least, most = min(low for low, _ in speeds), max(high for _, high in speeds)
    return max(0.05, 2.0 * most if least > 0.9 * most else most), most > 0.0


def speed_bar(axes: Sequence[Axes], top: float) -> None:
    """Draw the scale of the speed of the currents, as `Panel.draw_currents` colours it, below axes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    mappable = ScalarMappable(Normalize(0.0, top), colours.speed_map())
    bar = style.colour_bar(axes, mappable, "speed of the current (m s$^{-1}$)")
    bar.ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))


def melts(run: xr.Dataset) -> bool:
    """Whether any ice of a run has melted."""
    return "melt_water" in run and float(run["melt_water"].isel(time=-1).sum()) > 0.0


def thickness_lost(scene: Scene) -> Floats:
    """Return the thickness (m) that elements have lost since the start, or since they were born, (time, element)."""
    thickness = filled_forward(scene.run["thickness"].transpose("time", "trajectory").values)
    return np.asarray(thickness[0] - thickness)


def melt_bar(axes: Sequence[Axes], low: float, top: float) -> Normalize:
    """Draw the scale of the thickness lost (m) below axes, and return it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = Normalize(low, max(0.01, top))
    style.colour_bar(axes, ScalarMappable(scale, colours.melt_map()), "thickness lost since the start (m)")
    return scale


def depth_bar(panel: Map) -> None:
    """Draw the scale of depth below a map whose sea floor is shaded."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm

    if not panel.depth_steps:
        return
    shades = colours.depth_map()
    scale = ScalarMappable(BoundaryNorm(panel.depth_steps, shades.N), shades)
    ticks = panel.depth_steps[:: 1 + len(panel.depth_steps) // 9]
    style.colour_bar([panel.ax], scale, "depth of the sea floor (m)", shrink=0.7, aspect=40, ticks=ticks)


def arrow_key(quiver: Quiver, top: float) -> None:
    """Draw an arrow of a round speed of up to ``top`` (m s-1) inside the upper right corner of its panel."""
    from matplotlib.patheffects import withStroke

    speed = style.round_length(0.75 * top)
    axes: Any = quiver.axes
    scale: Any = quiver.scale
    key = axes.quiverkey(
        quiver, 0.97 - speed / scale, 0.94, speed, f"{speed:g} m s$^{{-1}}$", labelpos="W", labelsep=0.06,
        color=colours.ARROW, fontproperties={"size": 8}, zorder=10,
    )  # fmt: skip
    key.text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def common_boxes(
    scene: Scene, records: Sequence[int], *, margin: float = 0.12, largest: float = LARGE_BOX
) -> list[Box]:
    """Return square extents for panels that are compared: one for all, or of one size where the berg goes far.

    Where the berg stays about where it is (all of it within ``largest`` times its extent), all panels show the same place;
    else each is centred on the named fragments of its record.
    """
    least = FEWEST * math.sqrt(float(scene.area.max())) / 1e3 * scene.units_per_km()
    single = [widen_box(scene.box(record), scene.latlon, 1.0, margin=margin, least=least) for record in records]
    side = max(box.north - box.south for box in single)
    union = Box(
        min(b.west for b in single), max(b.east for b in single),
        min(b.south for b in single), max(b.north for b in single),
    )  # fmt: skip
    shared = widen_box(union, scene.latlon, 1.0)
    if shared.north - shared.south <= largest * side:
        return [shared] * len(single)
    return [widen_box(box, scene.latlon, 1.0, least=side) for box in single]


def make_panels(
    axes: Sequence[Axes], scene: Scene, water: Water | None, records: Sequence[int], *, margin: float = 0.12,
    largest: float = LARGE_BOX, texts: Sequence[str] | None = None,
) -> list[Panel]:  # fmt: skip
    """Return maps of records on axes of one row or table, under their moments or other texts."""
    boxes = common_boxes(scene, records, margin=margin, largest=largest)
    panels = [Panel(ax, scene, box, water, labels=not scene.latlon) for ax, box in zip(axes, boxes, strict=True)]
    for panel, text in zip(panels, texts or style.moment_texts(scene.times, records), strict=True):
        panel.ax.set_title(text, fontsize=10, pad=4)
    return panels
