"""Picture of two bergs that meet: where they are before, at and after the contact, and how far apart over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.diagnostics.approach import Approach
from riftberg.runs.background import water_of
from riftberg.runs.scene import Scene
from riftberg.viz import colours, style
from riftberg.viz.moments import moment_texts
from riftberg.viz.panels import Panel, arrow_key, common_boxes, fragment_colours, speed_bar, speed_top

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_approach(run: xr.Dataset, meeting: Approach, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw two bergs that meet."""
    style.check_format(path)
    scene, water = Scene(run), water_of(run)
    figure = style.new_figure(12.0, 8.6, dpi)
    above = style.put_title(figure, title or "Two bergs meet", left=0.8)
    records = telling(meeting)
    grid = figure.add_gridspec(
        1, len(records), left=0.07, right=0.985, top=1.0 - (above + 0.4) / 8.6, bottom=0.485, wspace=0.2
    )
    places = [figure.add_subplot(grid[0, k]) for k in range(len(records))]
    panels = [
        Panel(ax, scene, box, water, labels=True) for ax, box in zip(places, common_boxes(scene, records), strict=True)
    ]
    top = speed_top(panels, records)
    arrows: list[Any] = []
    for panel, record, text in zip(panels, records, moment_texts(scene.times, records), strict=True):
        arrows.append(panel.draw_currents(record, top))
        panel.draw_ice(record, fragment_colours(scene))
        panel.draw_scale()
        panel.ax.set_title(text, fontsize=10, pad=4)
    style.outer_names(places, len(records))
    for ax in places:
        ax.set_xlabel("x (km)", fontsize=8, labelpad=2)
    if arrows[0] is not None:
        speed_bar(figure, (0.3, 0.435, 0.35, 0.012), top)
        arrow_key(arrows[0], figure, 0.71, 0.441, top)
    lower = figure.add_axes((0.07, 0.065, 0.4, 0.27)), figure.add_axes((0.575, 0.065, 0.41, 0.27))
    _distance(lower[0], meeting)
    _closing(lower[1], meeting)
    for k, ax in enumerate((*places, *lower)):
        style.letter(ax, k)
    style.save_figure(figure, path)
    return Path(path)


def telling(meeting: Approach) -> list[int]:
    """Return three records: the first, the nearest of the first contact, and one after the bergs have parted."""
    count = len(meeting.apart)
    if not meeting.touching.any():
        return sorted({0, int(np.argmin(meeting.apart)), count - 1})
    begin = int(np.argmax(meeting.touching))
    ends = np.flatnonzero(~meeting.touching[begin:])
    end = begin + int(ends[0]) if len(ends) else count
    nearest = begin + int(np.argmin(meeting.apart[begin:end]))
    return sorted({0, nearest, min(count - 1, nearest + max(1, (end - nearest) * 2))})


def _distance(ax: Axes, meeting: Approach) -> None:
    hours = meeting.seconds / 3600.0
    ax.axhline(meeting.reach / 1e3, color=colours.GROUND, ls="--", lw=1.0, label="contact below")
    ax.plot(hours, meeting.apart / 1e3, color="black", lw=1.8, label="nearest elements")
    ax.set_ylabel("distance of centres (km)", fontsize=9)
    ax.set_ylim(bottom=0.0)
    _over_hours(ax)


def _closing(ax: Axes, meeting: Approach) -> None:
    hours = meeting.seconds / 3600.0
    ax.fill_between(hours, 0.0, 1.0, where=meeting.touching, step="mid", transform=ax.get_xaxis_transform(), lw=0.0,
                    color=colours.GROUND, alpha=0.15, label="in contact")  # fmt: skip
    ax.axhline(0.0, color=colours.STRENGTH, lw=0.8)
    ax.plot(hours, meeting.closing, color="black", lw=1.8, label="closing speed of the centroids")
    ax.set_ylabel("closing speed (m s$^{-1}$)", fontsize=9)
    _over_hours(ax)


def _over_hours(ax: Axes) -> None:
    ax.set_xlabel("hours since the start", fontsize=9)
    style.plain_axes(ax)
    ax.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, borderaxespad=0.1)
