"""One map panel and what can be drawn on it: water, sea floor, ice, bonds, observed outlines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.errors import InputError
from riftberg.ocean.forcing import Forcing
from riftberg.runs.background import StoredWater
from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import style
from riftberg.viz.coast import draw_coast

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

Water = Forcing | StoredWater

NO_WATER: Final = "#D9D9D9"
"""Under the currents: shows where there are none."""

ISOBATHS: Final = (50, 100, 200, 300, 500, 1000, 2000, 3000, 4000, 5000)


def stress_map() -> Colormap:
    """Return the colours of tensile stress: nearly white, yellow, red; the same as in the replay."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list(
        "stress", ["#fbfdff", "#fff0c9", "#fdc377", "#f47b4a", "#cf2a27", "#7a0018"]
    )


def damage_map() -> Colormap:
    """Return the colours of damage: nearly white to violet; the same as in the replay."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("damage", ["#fbfdff", "#dccbe9", "#a478c2", "#63308f", "#240a3f"])


def root_scale(top: float) -> Normalize:
    """Return a scale by the square root: a berg at rest has a tenth of its strength, and few bonds most of the damage."""
    from matplotlib.colors import PowerNorm

    return PowerNorm(0.5, 0.0, top)


def day_text(moment: np.datetime64, *, year: bool = False, hour: bool = True) -> str:
    """Return a date such as ``17 Dec 13:00``."""
    when = moment.astype("datetime64[s]").item()
    text = f"{when.day} {when:%b}" + (f" {when.year}" if year else "")
    return text + (f" {when:%H:%M}" if hour else "")


class Panel:
    """A map on given axes.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    scene : Scene
    box : Box
        Extent.
    water : Forcing or StoredWater, optional
        Gives currents and depth.
    ticks : int, optional
        About how many ticks an axis has.
    labels : bool, optional
        Axes say what they are.
    """

    def __init__(
        self, ax: Axes, scene: Scene, box: Box, water: Water | None = None, *, ticks: int = 4, labels: bool = False
    ) -> None:
        self.ax, self.scene, self.box, self.water = ax, scene, box, water
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        ax.set_aspect(scene.stretch(0.5 * (box.south + box.north)))
        style.geographic_axes(ax, latlon=scene.latlon, ticks=ticks, labels=labels)
        ax.set_facecolor("#F4F7FA")
        draw_coast(ax, box, latlon=scene.latlon)

    def _mesh(self, points: int) -> tuple[Floats, Floats]:
        b = self.box
        x, y = np.meshgrid(np.linspace(b.west, b.east, points), np.linspace(b.south, b.north, points))
        return x, y

    def fastest(self, record: int) -> float:
        """Return the largest current speed in the panel, m s-1; 0 where there is no current."""
        if self.water is None:
            return 0.0
        speed = np.hypot(*self.water.currents(*self._mesh(40), float(self.scene.seconds[record])))
        return float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0

    def draw_currents(self, record: int, top: float, *, arrows: int = 13, steps: int | None = None) -> None:
        """Draw speed as colour up to ``top`` (m s-1), smooth or in a number of steps, and arrows."""
        if self.water is None:
            return
        time = float(self.scene.seconds[record])
        x, y = self._mesh(70)
        speed = np.hypot(*self.water.currents(x, y, time))
        if not np.isfinite(speed).any():
            return
        b = self.box
        self.ax.set_facecolor(NO_WATER)
        self.ax.imshow(
            np.ma.masked_invalid(speed), cmap=style.speed_map(steps), vmin=0.0, vmax=top, interpolation="bilinear",
            extent=(b.west, b.east, b.south, b.north), origin="lower", aspect=self.ax.get_aspect(), zorder=0,
        )  # fmt: skip
        margin_x, margin_y = (b.east - b.west) / arrows / 2, (b.north - b.south) / arrows / 2
        ax, ay = np.meshgrid(
            np.linspace(b.west + margin_x, b.east - margin_x, arrows),
            np.linspace(b.south + margin_y, b.north - margin_y, arrows),
        )
        u, v = self.water.currents(ax, ay, time)
        self.ax.quiver(
            ax, ay, u, v, angles="uv", scale=1.05 * arrows * top, width=0.036 / arrows, headwidth=3.4, headlength=3.8,
            headaxislength=3.4, minshaft=1.6, color="#35506B", minlength=0.4, zorder=2,
        )  # fmt: skip

    def draw_floor(self, *, isobaths: bool = True) -> bool:
        """Draw isobaths and hatch what the keel touches; returns whether there is such a place."""
        if self.water is None:
            return False
        x, y = self._mesh(260)
        depth = self.water.depth(x, y)
        if not np.isfinite(depth).any() or float(np.nanmin(depth)) == float(np.nanmax(depth)):
            return False
        low, high = float(np.nanmin(depth)), float(np.nanmax(depth))
        levels = [d for d in ISOBATHS if low < d < high]
        # A floor of steps, such as a zone that is simply declared dry, has no isobaths.
        if isobaths and levels and len(np.unique(depth[np.isfinite(depth)])) >= 50:
            lines = self.ax.contour(x, y, depth, levels=levels, colors="#8A8A8A", linewidths=0.6, zorder=2)
            self.ax.clabel(lines, fmt="%d m", fontsize=6)
        draft = self.scene.draft()
        if not low < draft:
            return False
        filled = self.ax.contourf(x, y, depth, levels=[-1e9, draft], colors="none", hatches=["////"], zorder=3)
        filled.set_edgecolor(style.GROUND_COLOUR)
        filled.set_linewidth(0.0)
        self.ax.contour(x, y, depth, levels=[draft], colors=style.GROUND_COLOUR, linewidths=1.2, zorder=6)
        return True

    def draw_ice(
        self, record: int, colours: dict[int, str], *, alpha: float = 1.0, zorder: float = 5.0
    ) -> PolyCollection:
        """Draw the elements in the colours of their fragments."""
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import to_rgba

        numbers = self.scene.berg[record]
        faces = [to_rgba(colours.get(int(n), style.SMALL_COLOUR), alpha) for n in numbers]
        thin = 0.2 if len(numbers) < 2500 else 0.0
        ice = PolyCollection(
            list(self.scene.polygons(record)),
            facecolors=faces,
            edgecolors=(0, 0, 0, 0.4 * alpha),
            linewidths=thin,
            zorder=zorder,
        )
        self.ax.add_collection(ice)
        return ice

    def draw_bonds(
        self, record: int, values: Floats, colours: Colormap, scale: Normalize, points: float
    ) -> LineCollection:
        """Draw unbroken bonds in the colour of their values, broken ones dashed dark."""
        from matplotlib.collections import LineCollection, PolyCollection

        scene, run = self.scene, self.scene.run
        first, second = run["first"].values, run["second"].values
        ends = np.stack([np.stack([scene.x[record][k], scene.y[record][k]], axis=-1) for k in (first, second)], axis=1)
        broken = ~scene.unbroken[record]
        self.ax.add_collection(
            PolyCollection(
                list(scene.polygons(record)), facecolors="#E3E8EC", edgecolors="#B8C2CA", linewidths=0.2, zorder=4
            )
        )
        # The largest values on top.
        order = np.argsort(values[~broken])
        lines = LineCollection(list(ends[~broken][order]), array=values[~broken][order], cmap=colours,
                               norm=scale, linewidths=points, capstyle="butt", zorder=5)  # fmt: skip
        self.ax.add_collection(lines)
        near = broken & (
            np.hypot(*(ends[:, 1] - ends[:, 0]).T) < 2.5 * np.median(np.hypot(*(ends[:, 1] - ends[:, 0]).T))
        )
        self.ax.add_collection(
            LineCollection(list(ends[near]), colors="black", linewidths=0.7 * points, linestyles=":", zorder=6)
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
            self.ax.plot(*closed, **{"color": "black", "lw": 1.2, "zorder": 7, **look})

    def draw_scale(self, part: float = 0.3) -> None:
        """Draw a scale bar of about ``part`` of the width."""
        y = self.box.south + 0.055 * (self.box.north - self.box.south)
        unit = self.scene.units_per_km() * self.scene.stretch(y)
        style.scale_bar(
            self.ax, km=style.round_length(part * (self.box.east - self.box.west) / unit), units_per_km=unit
        )


def fragment_colours(scene: Scene) -> dict[int, str]:
    """Return a colour for each named fragment."""
    return dict(zip(scene.numbers, style.FRAGMENT_COLOURS, strict=False))


def fragment_name(scene: Scene, number: int) -> str:
    """Return what a fragment is, in a few words."""
    area, birth = scene.area_of(number) / 1e6, scene.birth(number)
    size = f"{area:,.0f} km²" if area >= 10.0 else f"{area:.2g} km²"
    if birth is None:
        return f"{scene.name(number)}: {size} at the end"
    return f"{scene.name(number)}: {size}, off on {day_text(birth[0])}" + (", aground" if birth[1] else ", afloat")


def speed_top(panels: Sequence[Panel], records: Sequence[int]) -> float:
    """Return the end of the speed scale of panels at these records, m s-1; still water has one too."""
    return max(0.05, *(panel.fastest(record) for panel, record in zip(panels, records, strict=True)))


def speed_bar(figure: Figure, place: tuple[float, float, float, float], top: float) -> None:
    """Draw the scale of the speed of the currents, as `Panel.draw_currents` colours it, at a place of a figure."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    ax = figure.add_axes(place)
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, top), style.speed_map()), cax=ax, orientation="horizontal")
    bar.set_label("speed of the current (m s$^{-1}$)", fontsize=8)
    bar.ax.tick_params(labelsize=8, length=2)
    long = place[2] * figure.get_figwidth()
    bar.ax.xaxis.set_major_locator(MaxNLocator(4 if long < 4.0 else 6, steps=[1, 2, 5, 10]))


def common_boxes(scene: Scene, records: Sequence[int], *, margin: float = 0.12) -> list[Box]:
    """Return square extents of one size, each centred on the named fragments of its record."""
    single = [scene.grown(scene.box(record), margin) for record in records]
    stretch = scene.stretch(0.5 * (single[0].south + single[0].north))
    half = 0.5 * max(max(b.north - b.south, (b.east - b.west) / stretch) for b in single)
    return [_centred(b, scene, half) for b in single]


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
