"""One map panel and what can be drawn on it: water, sea floor, ice, bonds, observed outlines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.places import area_text
from riftberg.errors import InputError
from riftberg.ocean.forcing import Forcing
from riftberg.runs.background import KeptWater, StoredWater
from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.coast import draw_coast
from riftberg.viz.floor import NO_FLOOR, SeaFloor
from riftberg.viz.moments import is_short, moment_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

Water = Forcing | StoredWater | KeptWater

DOT: Final = 3.0
"""Size (points) below which a fragment is drawn as a dot."""

FEWEST: Final = 4.0
"""A panel is at least so many elements wide: one that a single element fills shows nothing of the water."""

LARGE_BOX: Final = 1.6
"""Panels share one extent where it is at most so many times that of the largest berg."""


def root_scale(top: float) -> Normalize:
    """Return a scale by the square root: a berg at rest has a tenth of its strength, and few bonds most of the damage."""
    from matplotlib.colors import PowerNorm

    return PowerNorm(0.5, 0.0, top)


class Panel:
    """A map on given axes."""

    def __init__(
        self, ax: Axes, scene: Scene, box: Box, water: Water | None = None, *, ticks: int = 4, labels: bool = False
    ) -> None:
        self.ax, self.scene, self.box, self.water = ax, scene, box, water
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        ax.set_aspect(scene.stretch(0.5 * (box.south + box.north)))
        style.geographic_axes(ax, latlon=scene.latlon, ticks=ticks, labels=labels)
        ax.set_facecolor(colours.SEA)
        self.shaded = False
        draw_coast(ax, box, latlon=scene.latlon)

    def _mesh(self, points: int) -> tuple[Floats, Floats]:
        b = self.box
        x, y = np.meshgrid(np.linspace(b.west, b.east, points), np.linspace(b.south, b.north, points))
        return x, y

    def fastest(self, record: int) -> float:
        """Return the largest current speed in the panel, m s-1; 0 where there is no current."""
        return self.speeds(record)[1]

    def speeds(self, record: int) -> tuple[float, float]:
        """Return the smallest and the largest current speed in the panel, m s-1; 0 where there is no current."""
        if self.water is None:
            return 0.0, 0.0
        speed = np.hypot(*self.water.currents(*self._mesh(40), float(self.scene.seconds[record])))
        return (float(np.nanmin(speed)), float(np.nanmax(speed))) if np.isfinite(speed).any() else (0.0, 0.0)

    def draw_currents(self, record: int, top: float, *, arrows: int = 13, steps: int | None = None) -> Quiver | None:
        """Draw speed as colour up to ``top`` (m s-1), smooth or in a number of steps, and arrows; return the arrows."""
        if self.water is None:
            return None
        time = float(self.scene.seconds[record])
        x, y = self._mesh(70)
        speed = np.hypot(*self.water.currents(x, y, time))
        if not np.isfinite(speed).any():
            return None
        b = self.box
        self.ax.set_facecolor(colours.NO_WATER)
        self.ax.imshow(
            np.ma.masked_invalid(speed), cmap=colours.speed_map(steps), vmin=0.0, vmax=top, interpolation="bilinear",
            extent=(b.west, b.east, b.south, b.north), origin="lower", aspect=self.ax.get_aspect(), zorder=0,
        )  # fmt: skip
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

    def draw_floor(self, *, isobaths: bool = True, shaded: bool = False, labels: bool = True) -> bool:
        """Draw the sea floor: steps of depth as colour, isobaths, and hatched what the keel touches."""
        if self.water is None:
            return False
        draft = self.scene.draft()
        floor = SeaFloor(self.box, self.water, least=min(draft, NO_FLOOR))
        if not floor.known:
            return False
        self.shaded = shaded and floor.shade(self.ax)
        if isobaths:
            floor.draw_isobaths(self.ax, labels=labels)
        low, high = floor.span
        if not low < draft or not self.scene.has_floor:
            return False
        mesh = floor.x, floor.y, floor.depth
        filled = self.ax.contourf(*mesh, levels=[-1e9, draft], colors="none", hatches=["////"], zorder=3)
        filled.set_edgecolor(colours.GROUND)
        filled.set_linewidth(0.0)
        if draft < high:  # else all that is shown is too shallow
            self.ax.contour(*mesh, levels=[draft], colors=colours.GROUND, linewidths=1.2, zorder=6)
        return True

    def draw_ice(
        self, record: int, shown: dict[int, str], *, alpha: float = 1.0, zorder: float = 5.0
    ) -> PolyCollection:
        """Draw the elements in the colours of their fragments."""
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import to_rgba

        numbers = self.scene.berg[record]
        faces = [to_rgba(shown.get(int(n), colours.SMALL), alpha) for n in numbers]
        thin = 0.2 if len(numbers) < 2500 else 0.0
        ice = PolyCollection(
            list(self.scene.polygons(record)),
            facecolors=faces,
            edgecolors=(0, 0, 0, 0.4 * alpha),
            linewidths=thin,
            zorder=zorder,
        )
        self.ax.add_collection(ice)
        self._mark_small(record, shown, alpha, zorder)
        return ice

    def _mark_small(self, record: int, shown: dict[int, str], alpha: float, zorder: float) -> None:
        """Draw a dot for each fragment that would be smaller than one: bergs of a field are not seen otherwise."""
        scene, b = self.scene, self.box
        points = 72.0 * self.ax.get_window_extent().height / float(self.ax.figure.dpi) / (b.north - b.south)
        size = np.sqrt(scene.area_at(record)) / 1e3 * scene.units_per_km() * points
        numbers = scene.berg[record]
        for number in np.unique(numbers[(numbers > 0) & (size < DOT)]):
            own = numbers == number
            if math.sqrt(float((size[own] ** 2).sum())) < DOT:
                place = scene.x[record][own].mean(), scene.y[record][own].mean()
                colour = shown.get(int(number), colours.SMALL)
                self.ax.plot(*place, "o", ms=DOT, color=colour, mec="black", mew=0.3, alpha=alpha, zorder=zorder)

    def draw_bonds(
        self, record: int, values: Floats, shades: Colormap, scale: Normalize, points: Floats
    ) -> LineCollection:
        """Draw unbroken bonds in the colour of their values, each so many points wide, broken ones dashed dark."""
        from matplotlib.collections import LineCollection, PolyCollection

        scene, run = self.scene, self.scene.run
        first, second = run["first"].values, run["second"].values
        ends = np.stack([np.stack([scene.x[record][k], scene.y[record][k]], axis=-1) for k in (first, second)], axis=1)
        broken = ~scene.unbroken[record]
        self.ax.add_collection(
            PolyCollection(
                list(scene.polygons(record)),
                facecolors=colours.ICE,
                edgecolors=colours.ICE_EDGE,
                linewidths=0.2,
                zorder=4,
            )
        )
        # The largest values on top.
        order = np.argsort(values[~broken])
        lines = LineCollection(list(ends[~broken][order]), array=values[~broken][order], cmap=shades,
                               norm=scale, linewidths=points[~broken][order], capstyle="butt", zorder=5)  # fmt: skip
        self.ax.add_collection(lines)
        near = broken & (
            np.hypot(*(ends[:, 1] - ends[:, 0]).T) < 2.5 * np.median(np.hypot(*(ends[:, 1] - ends[:, 0]).T))
        )
        self.ax.add_collection(
            LineCollection(
                list(ends[near]),
                colors="black",
                linewidths=np.minimum(1.8, 0.7 * points[near]),
                linestyles=":",
                zorder=6,
            )
        )
        return lines

    def draw_outlines(self, rings: Sequence[Floats], **look: Any) -> None:
        """Draw observed outlines (longitude, latitude)."""
        for ring in rings:
            x = ring[:, 0]
            if self.scene.latlon:
                middle = 0.5 * (self.box.west + self.box.east)
                x = x - 360.0 * np.round((x - middle) / 360.0)
            closed = np.append(x, x[0]), np.append(ring[:, 1], ring[0, 1])
            self.ax.plot(*closed, **{"color": colours.OBSERVED, "lw": 1.2, "zorder": 7, **look})

    def draw_scale(self, part: float = 0.3) -> None:
        """Draw a scale bar of about ``part`` of the width."""
        y = self.box.south + 0.055 * (self.box.north - self.box.south)
        unit = self.scene.units_per_km() * self.scene.stretch(y)
        style.scale_bar(
            self.ax, km=style.round_length(part * (self.box.east - self.box.west) / unit), units_per_km=unit
        )


def fragment_colours(scene: Scene) -> dict[int, str]:
    """Return a colour for each named fragment."""
    return dict(zip(scene.numbers, colours.FRAGMENTS, strict=False))


def fragment_name(scene: Scene, number: int) -> str:
    """Return what a fragment is, in a few words."""
    size, birth = area_text(scene.area_of(number), squared="²"), scene.birth(number)
    if birth is None:
        return f"{scene.name(number)}: {size} at the end"
    when = moment_text(scene.times, birth[0])
    off = f"off after {when}" if is_short(scene.times) else f"off on {when}"
    return f"{scene.name(number)}: {size}, {off}" + (", aground" if birth[1] else ", afloat")


def speed_top(panels: Sequence[Panel], records: Sequence[int]) -> float:
    """Return the end of the speed scale of panels at these records, m s-1; still water has one too.

    A current of one speed everywhere stands in the middle of its scale, so that it is not all dark under arrows and ice.
    """
    speeds = [panel.speeds(record) for panel, record in zip(panels, records, strict=True)]
    least, most = min(low for low, _ in speeds), max(high for _, high in speeds)
    return max(0.05, 2.0 * most if least > 0.9 * most else most)


def speed_bar(figure: Figure, place: tuple[float, float, float, float], top: float) -> None:
    """Draw the scale of the speed of the currents, as `Panel.draw_currents` colours it, at a place of a figure."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    ax = figure.add_axes(place)
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, top), colours.speed_map()), cax=ax, orientation="horizontal")
    bar.set_label("speed of the current (m s$^{-1}$)", fontsize=8)
    bar.ax.tick_params(labelsize=8, length=2)
    long = place[2] * figure.get_figwidth()
    bar.ax.xaxis.set_major_locator(MaxNLocator(4 if long < 4.0 else 6, steps=[1, 2, 5, 10]))


def arrow_key(quiver: Quiver, figure: Figure, x: float, y: float, top: float) -> None:
    """Draw an arrow of a round speed of up to ``top`` (m s-1) beside that speed, from a place of a figure (its parts) on."""
    speed = style.round_length(0.75 * top)
    axes: Any = quiver.axes
    key = axes.quiverkey(
        quiver, x, y, speed, f"{speed:g} m s$^{{-1}}$", coordinates="figure", labelpos="E", labelsep=0.06,
        fontproperties={"size": 8}, color=colours.ARROW,
    )  # fmt: skip
    key.set_in_layout(False)  # it stands outside of its panel


def common_boxes(scene: Scene, records: Sequence[int], *, margin: float = 0.12) -> list[Box]:
    """Return square extents for panels that are compared: one for all, or of one size where the berg goes far.

    Where the berg stays about where it is, all panels show the same place; else each is centred on the named fragments of
    its record.
    """
    single = [scene.grown(scene.box(record), margin) for record in records]
    stretch = scene.stretch(0.5 * (single[0].south + single[0].north))
    side = math.sqrt(float(scene.area.max())) / 1e3 * scene.units_per_km()
    half = max(0.5 * FEWEST * side, *(_half(box, stretch) for box in single))
    together = Box(
        min(b.west for b in single), max(b.east for b in single),
        min(b.south for b in single), max(b.north for b in single),
    )  # fmt: skip
    if _half(together, stretch) <= LARGE_BOX * half:
        return [_centred(together, scene, max(half, _half(together, stretch)))] * len(single)
    return [_centred(b, scene, half) for b in single]


def _half(box: Box, stretch: float) -> float:
    """Return half of the longer side of a box, in units of y."""
    return 0.5 * max(box.north - box.south, (box.east - box.west) / stretch)


def widened(box: Box, scene: Scene, shape: float) -> Box:
    """Return the box widened to a shape (width over height on the ground), so that a map fills its place."""
    stretch = scene.stretch(0.5 * (box.south + box.north))
    half = 0.5 * max(box.north - box.south, (box.east - box.west) / stretch / shape)
    return _centred(box, scene, half, shape)


def _centred(box: Box, scene: Scene, half: float, shape: float = 1.0) -> Box:
    """Return the box around the same centre that reaches ``half`` (units of y) north and south."""
    x, y = 0.5 * (box.west + box.east), 0.5 * (box.south + box.north)
    wide = half * shape * scene.stretch(y)
    return Box(x - wide, x + wide, y - half, y + half)


def nearest_record(scene: Scene, moment: np.datetime64) -> int:
    """Return the record nearest to a date; refuses one more than an hour, or half a step of the records, outside of the run."""
    apart = np.abs(scene.times - moment)
    nearest = int(np.argmin(apart))
    steps = np.diff(scene.times)
    if apart[nearest] > max(np.timedelta64(1, "h"), 0.51 * steps.max() if len(steps) else np.timedelta64(0, "h")):
        first, last = (scene.times[k].astype("datetime64[m]") for k in (0, -1))
        raise InputError(
            f"{moment.astype('datetime64[m]')} is not in the run", where="--date",
            remedy=f"The run goes from {first} to {last}",
        )  # fmt: skip
    return nearest
