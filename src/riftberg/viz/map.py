"""The map of a run: where the berg went, how it turned and broke, in which water."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import style
from riftberg.viz.coast import draw_coast

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from riftberg.ocean.forcing import Forcing

Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO date to rings of shape (n, 2), longitude and latitude."""


def draw_map(
    run: xr.Dataset,
    path: str | Path,
    *,
    forcing: Forcing | None = None,
    title: str = "",
    dates: int = 6,
    observed: Outlines | None = None,
    dpi: int = 150,
) -> Path:
    """Draw the map of a run.

    On the left the tracks of the fragments, with the berg at the first and the last date; on the right the berg at
    ``dates`` dates, after its break-ups and between them, in the currents of these dates. Elements are drawn in their
    true size, shape and orientation.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`.
    path : path
        Picture to write; the ending decides on the format.
    forcing : Forcing, optional
        Gives currents and depth of water.
    title : str, optional
        First line of the title; by default the experiment. The second line says what the forcing is.
    dates : int, optional
        Number of dates, 2 to 6.
    observed : mapping, optional
        Observed outlines by ISO date, drawn on the dates that they belong to.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path
        The picture.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = Scene(run)
    records = scene.telling_records(dates)
    figure = Figure(figsize=(15.5, 8.6), dpi=dpi)
    FigureCanvasAgg(figure)
    _MapFigure(figure, scene, forcing, observed or {}).draw(records, _title(run, title))
    style.save_figure(figure, path)
    return Path(path)


def _title(run: xr.Dataset, title: str) -> str:
    """Title that says which run and which currents these are."""
    first = title or str(run.attrs.get("experiment") or "Iceberg drift")
    begin, end = (_day(run["time"].values[k], year=True) for k in (0, -1))
    second = str(run.attrs.get("forcing_title", "")).strip()
    return f"{first}, {begin} to {end}" + (f"\nForcing: {second}" if second else "")


def _day(moment: np.datetime64, *, year: bool = False, hour: bool = False) -> str:
    when = moment.astype("datetime64[s]").item()
    text = f"{when.day} {when:%b}" + (f" {when.year}" if year else "")
    return text + (f" {when:%H:%M}" if hour else "")


class _MapFigure:
    """One figure in the making."""

    def __init__(self, figure: Figure, scene: Scene, forcing: Forcing | None, observed: Outlines) -> None:
        self.figure, self.scene, self.forcing, self.observed = figure, scene, forcing, observed
        self.colours = dict(zip(scene.numbers, style.FRAGMENT_COLOURS, strict=False))
        self.fastest = 0.0

    def draw(self, records: list[int], title: str) -> None:
        """Draw all panels."""
        columns = (len(records) + 1) // 2
        left = self.figure.add_gridspec(1, 1, left=0.045, right=0.40, bottom=0.165, top=0.885)
        right = self.figure.add_gridspec(
            2, columns, left=0.445, right=0.985, bottom=0.135, top=0.865, wspace=0.24, hspace=0.17
        )
        boxes = self._common_boxes(records)
        water = [self._water(box, record) for box, record in zip(boxes, records, strict=True)]
        self.fastest = max((float(np.nanmax(w[4])) for w in water if w is not None), default=0.0)
        for k, (record, box) in enumerate(zip(records, boxes, strict=True)):
            ax = self.figure.add_subplot(right[k // columns, k % columns])
            self._panel(ax, record, box, water[k])
        overview = self.figure.add_subplot(left[0])
        self._overview(overview, records)
        self._speed_bar()
        self.figure.text(0.045, 0.975, title, ha="left", va="top", fontsize=13, linespacing=1.35)

    def _common_boxes(self, records: list[int]) -> list[Box]:
        """Return extents of one size, each centred on the fragments of its date."""
        single = [self.scene.box(record).grown(0.08) for record in records]
        stretch = self.scene.stretch(0.5 * (single[0].south + single[0].north))
        half = 0.5 * max(max(b.north - b.south, (b.east - b.west) / stretch) for b in single)
        centres = [(0.5 * (b.west + b.east), 0.5 * (b.south + b.north)) for b in single]
        return [Box(x - half * self.scene.stretch(y), x + half * self.scene.stretch(y), y - half, y + half)
                for x, y in centres]  # fmt: skip

    def _frame(self, ax: Axes, box: Box, ticks: int) -> None:
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        ax.set_aspect(self.scene.stretch(0.5 * (box.south + box.north)))
        style.geographic_axes(ax, latlon=self.scene.latlon, ticks=ticks, labels=ticks > 4)
        draw_coast(ax, box, latlon=self.scene.latlon, zorder=4.2)

    def _bar(self, ax: Axes, box: Box, part: float) -> None:
        y = box.south + 0.055 * (box.north - box.south)
        unit = self.scene.units_per_km() * self.scene.stretch(y)
        style.scale_bar(ax, km=style.round_length(part * (box.east - box.west) / unit), units_per_km=unit)

    # --- water -----------------------------------------------------------------------------------------------------

    def _water(self, box: Box, record: int, points: int = 60) -> tuple[Floats, Floats, Floats, Floats, Floats] | None:
        """Return positions, current and speed on a fine mesh; None where the forcing knows none."""
        if self.forcing is None:
            return None
        x, y = np.meshgrid(np.linspace(box.west, box.east, points), np.linspace(box.south, box.north, points))
        u, v = self.forcing.currents(x, y, float(self.scene.seconds[record]))
        speed = np.hypot(u, v)
        return (x, y, u, v, speed) if np.isfinite(speed).any() else None

    def _draw_water(self, ax: Axes, water: tuple[Floats, Floats, Floats, Floats, Floats]) -> None:
        x, y, u, v, speed = water
        top = speed_top(self.fastest)
        ax.set_facecolor("#D9D9D9")
        ax.pcolormesh(x, y, speed, cmap=style.speed_map(), vmin=0.0, vmax=top, shading="gouraud", rasterized=True)
        some = np.linspace(3, len(x) - 4, 12).round().astype(int)
        pick = np.ix_(some, some)
        ax.quiver(x[pick], y[pick], u[pick], v[pick], angles="uv", scale=13.0 * top, width=0.0045, headwidth=4.0,
                  color="#35506B", zorder=2)  # fmt: skip

    def _draw_floor(self, ax: Axes, box: Box) -> bool:
        """Hatch where the sea floor is shallower than the draft; returns whether there is such a place."""
        depth = self._depth(box)
        if depth is None:
            return False
        x, y, water, draft = *depth, self.scene.draft()
        if not (np.nanmin(water) < draft):
            return False
        ax.contourf(x, y, water, levels=[-1e9, draft], colors="none", hatches=["////"], zorder=4)
        for collection in ax.collections[-1:]:
            collection.set_edgecolor(style.GROUND_COLOUR)
            collection.set_linewidth(0.0)
        ax.contour(x, y, water, levels=[draft], colors=style.GROUND_COLOUR, linewidths=1.3, zorder=6)
        return True

    def _depth(self, box: Box, points: int = 240) -> tuple[Floats, Floats, Floats] | None:
        if self.forcing is None:
            return None
        x, y = np.meshgrid(np.linspace(box.west, box.east, points), np.linspace(box.south, box.north, points))
        water = self.forcing.depth(x, y)
        return (x, y, water) if np.isfinite(water).any() else None

    def _draw_isobaths(self, ax: Axes, box: Box) -> None:
        depth = self._depth(box)
        if depth is None:
            return
        x, y, water = depth
        if len(np.unique(water[np.isfinite(water)])) < 50:
            return  # a floor of steps, such as a zone that is simply declared dry, has no isobaths
        low, high = float(np.nanmin(water)), float(np.nanmax(water))
        levels = [d for d in (50, 100, 200, 300, 500, 1000, 2000, 3000, 4000, 5000) if low < d < high]
        if levels:
            lines = ax.contour(x, y, water, levels=levels, colors="#8A8A8A", linewidths=0.6, zorder=1)
            ax.clabel(lines, fmt="%d m", fontsize=7)

    # --- ice -------------------------------------------------------------------------------------------------------

    def _draw_berg(self, ax: Axes, record: int, *, alpha: float = 1.0, zorder: float = 5.0) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import to_rgba

        numbers = self.scene.berg[record]
        colours = [to_rgba(self.colours.get(int(n), style.SMALL_COLOUR), alpha) for n in numbers]
        width = 0.25 if len(numbers) < 2500 else 0.0
        edge = (0.0, 0.0, 0.0, 0.45 * alpha)
        shapes = list(self.scene.polygons(record))
        ax.add_collection(PolyCollection(shapes, facecolors=colours, edgecolors=edge, linewidths=width, zorder=zorder))

    def _panel(self, ax: Axes, record: int, box: Box, water: Any) -> None:
        """Draw the berg at one date in the current of that date."""
        self._frame(ax, box, ticks=4)
        if water is not None:
            self._draw_water(ax, water)
        self._draw_floor(ax, box)
        self._draw_berg(ax, record)
        for ring in self.observed.get(str(self.scene.times[record])[:10], ()):
            ax.plot(ring[:, 0], ring[:, 1], color="black", lw=1.1, zorder=7)
        self._bar(ax, box, 0.3)
        ax.set_title(_day(self.scene.times[record], hour=True), fontsize=10, pad=4)

    def _overview(self, ax: Axes, records: list[int]) -> None:
        """Draw tracks, first and last position, break-ups and the sea floor."""
        box = _fitted(self.scene.box().grown(0.05), self.scene, ax)
        self._frame(ax, box, ticks=6)
        ax.set_facecolor("#F4F7FA")
        self._draw_isobaths(ax, box)
        grounded = self._draw_floor(ax, box)
        self._draw_berg(ax, records[0], alpha=0.35, zorder=3.0)
        self._draw_berg(ax, records[-1], zorder=3.5)
        labels = style.Labels(ax)
        self._draw_breakups(ax, labels)
        for number in reversed(self.scene.numbers[: len(style.FRAGMENT_COLOURS)]):
            self._draw_track(ax, number)
        self._draw_dates(ax, labels, records)
        self._bar(ax, box, 0.25)
        self._legend(ax, grounded)

    def _draw_track(self, ax: Axes, number: int) -> None:
        from matplotlib.patheffects import Normal, withStroke

        x, y, _ = self.scene.track(number)
        ax.plot(x, y, color=self.colours[number], lw=2.0, zorder=7,
                path_effects=[withStroke(linewidth=3.6, foreground="black"), Normal()])  # fmt: skip

    def _draw_dates(self, ax: Axes, labels: style.Labels, records: list[int]) -> None:
        """Mark and label the chosen dates on the track of the largest fragment, and before its birth of what it was part of."""
        largest = self.scene.numbers[0]
        places = []
        for record in records:
            x, y, there = self.scene.track(self.scene.ancestor(largest, record))
            row = int(np.argmin(np.abs(there - record)))
            places.append((float(x[row]), float(y[row])))
        ax.plot(*zip(*places, strict=True), "o", ms=6.5, mfc="white", mec="black", mew=1.3, zorder=8)
        for place in places:
            labels.avoid(*place)
        days = [_day(self.scene.times[record]) for record in records]
        for record, place, day in zip(records, places, days, strict=True):
            text = day if days.count(day) == 1 else _day(self.scene.times[record], hour=True)
            labels.put(text, *place, fontsize=9, fontweight="bold")

    def _draw_breakups(self, ax: Axes, labels: style.Labels) -> None:
        for number in self.scene.numbers:
            x, y, _ = self.scene.track(number)
            if self.scene.birth(number) is not None:
                ax.plot(x[0], y[0], "*", ms=15, mfc=self.colours.get(number, style.SMALL_COLOUR), mec="black", zorder=9)
                labels.avoid(x[0], y[0], 8.0)

    def _legend(self, ax: Axes, grounded: bool) -> None:
        """Explain fragments and signs below the overview."""
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        handles: list[Any] = []
        for number, colour in self.colours.items():
            handles.append(Patch(fc=colour, ec="black", lw=0.5, label=self._name(number)))
        handles.append(
            Line2D([], [], color="black", marker="o", mfc="white", lw=2, label="track and dates of the panels")
        )
        if any(self.scene.birth(n) for n in self.scene.numbers):
            handles.append(
                Line2D([], [], ls="", marker="*", ms=11, mfc="white", mec="black", label="place of a break-up")
            )
        if grounded:
            handles.append(Patch(fc="white", ec=style.GROUND_COLOUR, hatch="////",
                                 label=f"shallower than the keel ({self.scene.draft():.0f} m)"))  # fmt: skip
        if self.observed:
            handles.append(Line2D([], [], color="black", lw=1.1, label="observed outline"))
        ax.legend(handles=handles, fontsize=8, loc="upper left", bbox_to_anchor=(-0.02, -0.05), ncols=2, frameon=False,
                  borderpad=0.2, columnspacing=1.4, handlelength=1.8)  # fmt: skip

    def _name(self, number: int) -> str:
        area = f"{self.scene.area_of(number) / 1e6:,.3g} km²" if self.scene.area_of(number) < 1e8 else ""
        area = area or f"{self.scene.area_of(number) / 1e6:,.0f} km²"
        birth = self.scene.birth(number)
        if birth is None:
            return f"berg {number}: {area} at the end"
        return f"fragment {number}: {area}, off on {_day(birth[0], hour=True)}" + (", aground" if birth[1] else "")

    def _speed_bar(self) -> None:
        """Draw the scale of the current speeds below the panels."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        if self.fastest <= 0.0:
            return
        top = speed_top(self.fastest)
        ax = self.figure.add_axes((0.53, 0.05, 0.37, 0.013))
        norm = Normalize(0.0, top)
        bar = self.figure.colorbar(ScalarMappable(norm, style.speed_map()), cax=ax, orientation="horizontal")
        bar.ax.tick_params(labelsize=8, length=2)
        ax.set_title("speed of the current (m s$^{-1}$)", fontsize=9, pad=3)


def speed_top(fastest: float) -> float:
    """Return the end of the speed scale, m s-1; still water has one too."""
    return max(fastest, 0.05)


def _fitted(box: Box, scene: Scene, ax: Axes) -> Box:
    """Return the box widened to the shape of the axes, so that the map fills its place."""
    place, size = ax.get_position(), ax.figure.get_size_inches()  # type: ignore[union-attr]
    shape = place.width * size[0] / (place.height * size[1])
    x, y = 0.5 * (box.west + box.east), 0.5 * (box.south + box.north)
    stretch = scene.stretch(y)
    half = 0.5 * max(box.north - box.south, (box.east - box.west) / stretch / shape)
    return Box(x - half * shape * stretch, x + half * shape * stretch, y - half, y + half)
