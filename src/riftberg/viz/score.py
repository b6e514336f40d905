"""Figure of a score: tracks side by side, and distance, heading, area and overlap by day."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.diagnostics.score import Match, Score
from riftberg.runs.scene import Box
from riftberg.state import Floats
from riftberg.viz import style
from riftberg.viz.coast import draw_coast
from riftberg.viz.style import date_axis, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MODEL: Final = "#D55E00"
OBSERVED: Final = "#222222"


def draw_score(score: Score, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw a score.

    Parameters
    ----------
    score : Score
    path : path
        Picture.
    title : str, optional
        Heading; its second line may say what the forcing is.
    dpi : int, optional
    """
    figure = new_figure(12.5, 7.6, dpi)
    grid = figure.add_gridspec(
        4, 2, left=0.07, right=0.97, top=0.875, bottom=0.075, wspace=0.2, hspace=0.16, width_ratios=(1.0, 1.15)
    )
    _draw_tracks(figure.add_subplot(grid[:, 0]), score)
    rows = [(day.time, berg) for day in score.days if (berg := day.berg) is not None]
    times = np.array([time for time, _ in rows], dtype="datetime64[s]")
    matches = [match for _, match in rows]
    axes: list[Any] = []
    for k, (label, draw) in enumerate(_CURVES):
        axes.append(figure.add_subplot(grid[k, 1], sharex=axes[0] if axes else None))
        draw(axes[k], times, matches)
        axes[k].set_ylabel(label, fontsize=9)
        axes[k].grid(color="#DDDDDD", lw=0.6)
        axes[k].tick_params(labelsize=8, labelbottom=k == len(_CURVES) - 1)
        axes[k].spines[["top", "right"]].set_visible(False)
    date_axis(axes[-1])
    figure.suptitle(title or f"Run against {score.observed}", x=0.05, ha="left", fontsize=12)
    style.save_figure(figure, path)
    return Path(path)


def _match_values(matches: Sequence[Match], name: str) -> Floats:
    return np.array([np.nan if getattr(m, name) is None else getattr(m, name) for m in matches], np.float64)


def _draw_distance(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    ax.plot(times, _match_values(berg, "distance_km"), "o-", color=MODEL, ms=4)
    ax.set_ylim(bottom=0.0)


def _draw_azimuth(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    """Draw both headings without jumps at 180 degrees, each followed from day to day, the model's from near the observed one."""
    seen, off = _match_values(berg, "azimuth_observed"), _match_values(berg, "azimuth_difference")
    known = np.isfinite(seen)
    made = seen + off if known.any() else _match_values(berg, "azimuth")
    for values, look, colour in ((seen, "s-", OBSERVED), (made, "o-", MODEL)):
        there = np.isfinite(values)
        ax.plot(times[there], np.unwrap(values[there], period=180.0), look, color=colour, ms=4)


def _draw_area(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    ax.plot(times, _match_values(berg, "area_observed_km2"), "s-", color=OBSERVED, ms=4)
    ax.plot(times, _match_values(berg, "area_km2"), "o-", color=MODEL, ms=4)
    ax.set_ylim(0.0, 1.1 * ax.get_ylim()[1])


def _draw_overlap(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    values = _match_values(berg, "iou")
    ax.plot(times, values, "o-", color=MODEL, ms=4)
    ax.set_ylim(0.0, 1.0)
    if not np.isfinite(values).any():
        ax.text(0.5, 0.5, "positions only, no outlines", transform=ax.transAxes, ha="center", va="center", fontsize=9)


_CURVES: Final = (
    ("distance of\ncentroids (km)", _draw_distance),
    ("long axis\n(degrees from N)", _draw_azimuth),
    ("area (km²)", _draw_area),
    ("overlap (IoU)", _draw_overlap),
)


def _draw_tracks(ax: Axes, score: Score) -> None:
    """Draw the centroids of all pieces, model and observed, joined day by day."""
    ends: list[tuple[float, float]] = []
    labels = style.Labels(ax)
    berg = [(day.time, m) for day in score.days if (m := day.berg) is not None]
    for day in score.days:
        for m in day.matches:
            ends.append((m.lon_observed, m.lat_observed))
            other = m is not day.berg
            ax.plot(
                m.lon_observed, m.lat_observed, "s", color=OBSERVED, ms=3 if other else 5, alpha=0.5 if other else 1.0
            )
            if m.lon is not None and m.lat is not None:
                ends.append((m.lon, m.lat))
                ax.plot([m.lon_observed, m.lon], [m.lat_observed, m.lat], "-", color="#999999", lw=0.9, zorder=1)
                ax.plot(m.lon, m.lat, "o", color=MODEL, ms=3 if other else 5, alpha=0.5 if other else 1.0)
    seen = np.array([(m.lon_observed, m.lat_observed) for _, m in berg]).reshape(-1, 2)
    made = np.array([(m.lon, m.lat) for _, m in berg], np.float64).reshape(-1, 2)
    ax.plot(*seen.T, "s-", color=OBSERVED, ms=5, lw=1.4, label="observed")
    ax.plot(*made.T, "o-", color=MODEL, ms=5, lw=1.4, label="model")
    middle = float(np.mean([lat for _, lat in ends]))
    ax.set_aspect(1.0 / np.cos(np.radians(middle)), adjustable="datalim")
    ax.margins(0.08)
    ax.apply_aspect()
    (west, east), (south, north) = ax.get_xlim(), ax.get_ylim()
    draw_coast(ax, Box(west, east, south, north), zorder=0.5)
    style.geographic_axes(ax, latlon=True)
    ax.grid(color="#E3E3E3", lw=0.6)
    ax.legend(fontsize=9)
    others = any(m is not day.berg for day in score.days for m in day.matches)
    ax.set_title("centroids; grey: of the same time" + ("; small: other pieces" if others else ""), fontsize=10)
    for x, y in (*seen, *made):
        labels.avoid(x, y)
    for k in range(0, len(berg), max(1, len(berg) // 8)):
        when = np.datetime64(berg[k][0]).astype("datetime64[s]").item()
        labels.put(f"{when.day} {when:%b}", *seen[k], fontsize=8)
