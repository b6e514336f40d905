"""The map of a run: where the berg went, how it turned and broke, in which water."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.runs.scene import Scene
from riftberg.state import Floats
from riftberg.viz import style
from riftberg.viz.panels import (
    Panel,
    Water,
    common_boxes,
    day_text,
    fragment_colours,
    fragment_name,
    speed_bar,
    speed_top,
    widened,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO date to rings of shape (n, 2), longitude and latitude."""


def draw_map(
    run: xr.Dataset,
    path: str | Path,
    *,
    forcing: Water | None = None,
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
    forcing : Forcing or StoredWater, optional
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
    scene = Scene(run)
    records = scene.telling_records(dates)
    figure = style.new_figure(15.5, 8.6, dpi)
    _MapFigure(figure, scene, forcing, observed or {}).draw(records, _title(run, title))
    style.save_figure(figure, path)
    return Path(path)


def _title(run: xr.Dataset, title: str) -> str:
    """Title that says which run and which currents these are."""
    first = title or str(run.attrs.get("experiment") or "Iceberg drift")
    begin, end = (day_text(run["time"].values[k], year=True, hour=False) for k in (0, -1))
    second = str(run.attrs.get("forcing_title", "")).strip()
    return f"{first}, {begin} to {end}" + (f"\nForcing: {second}" if second else "")


class _MapFigure:
    """One figure in the making."""

    def __init__(self, figure: Figure, scene: Scene, water: Water | None, observed: Outlines) -> None:
        self.figure, self.scene, self.water, self.observed = figure, scene, water, observed
        self.colours = fragment_colours(scene)

    def draw(self, records: list[int], title: str) -> None:
        """Draw all panels."""
        columns = (len(records) + 1) // 2
        left = self.figure.add_gridspec(1, 1, left=0.045, right=0.40, bottom=0.165, top=0.885)
        right = self.figure.add_gridspec(
            2, columns, left=0.445, right=0.985, bottom=0.135, top=0.865, wspace=0.24, hspace=0.17
        )
        places = [self.figure.add_subplot(right[k // columns, k % columns]) for k in range(len(records))]
        boxes = common_boxes(self.scene, records, margin=0.08)
        panels = [Panel(ax, self.scene, box, self.water) for ax, box in zip(places, boxes, strict=True)]
        top = speed_top(panels, records)
        for panel, record in zip(panels, records, strict=True):
            self._date(panel, record, top)
        self._overview(self.figure.add_subplot(left[0]), records)
        if any(panel.fastest(record) > 0.0 for panel, record in zip(panels, records, strict=True)):
            speed_bar(self.figure, (0.53, 0.05, 0.37, 0.013), top)
        self.figure.text(0.045, 0.975, title, ha="left", va="top", fontsize=13, linespacing=1.35)

    def _date(self, panel: Panel, record: int, top: float) -> None:
        """Draw the berg at one date in the current of that date."""
        panel.draw_currents(record, top, arrows=12)
        panel.draw_floor(isobaths=False)
        panel.draw_ice(record, self.colours)
        panel.draw_outlines(self.observed.get(str(self.scene.times[record])[:10], ()))
        panel.draw_scale()
        panel.ax.set_title(day_text(self.scene.times[record]), fontsize=10, pad=4)

    def _overview(self, ax: Axes, records: list[int]) -> None:
        """Draw tracks, first and last position, break-ups and the sea floor."""
        place, size = ax.get_position(), self.figure.get_size_inches()
        shape = place.width * size[0] / (place.height * size[1])
        box = widened(self.scene.grown(self.scene.box(), 0.05), self.scene, shape)
        panel = Panel(ax, self.scene, box, self.water, ticks=6, labels=True)
        grounded = panel.draw_floor()
        panel.draw_ice(records[0], self.colours, alpha=0.35, zorder=2.6)
        panel.draw_ice(records[-1], self.colours, zorder=2.8)
        labels = style.Labels(ax)
        self._draw_breakups(ax, labels)
        for number in reversed(list(self.colours)):
            self._draw_track(ax, number)
        self._draw_dates(ax, labels, records)
        panel.draw_scale(0.25)
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
        days = [day_text(self.scene.times[record], hour=False) for record in records]
        for record, place, day in zip(records, places, days, strict=True):
            text = day if days.count(day) == 1 else day_text(self.scene.times[record])
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
            handles.append(Patch(fc=colour, ec="black", lw=0.5, label=fragment_name(self.scene, number)))
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
        below = -0.05 if self.scene.latlon else -0.075  # the axis of a run in metres has a name
        ax.legend(handles=handles, fontsize=8, loc="upper left", bbox_to_anchor=(-0.02, below), ncols=2, frameon=False,
                  borderpad=0.2, columnspacing=1.4, handlelength=1.8)  # fmt: skip
