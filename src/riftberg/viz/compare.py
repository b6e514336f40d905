"""Map of several runs: the track of the same berg in each, and where it was seen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from riftberg.plane import ConformalPlane
from riftberg.runs.scene import Box
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.panels import Map, widened
from riftberg.viz.polar import POLAR

if TYPE_CHECKING:
    from riftberg.diagnostics.compare import ComparedRun
    from riftberg.diagnostics.observed import Fix


def draw_compared(runs: Sequence[ComparedRun], fixes: Sequence[Fix], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the tracks, with the dates of the first run, the places of break-ups, and the observed track."""
    style.check_format(path)
    first = runs[0].course
    points = [(run.course.x, run.course.y) for run in runs]
    points += [_columns((e["lon"], e["lat"]) for e in run.course.births) for run in runs]
    points.append(_columns((fix.lon, fix.lat) for fix in fixes))
    if first.latlon:  # all on the branch of the first
        middle = float(first.x.mean())
        points = [(x - 360.0 * np.round((x.mean() - middle) / 360.0) if x.size else x, y) for x, y in points]
    latitude, plane = float(first.y.mean()), None
    if first.latlon and abs(latitude) > POLAR:
        true = 0.5 * (1.0 + math.sin(math.radians(abs(latitude))))
        plane = ConformalPlane(float(first.x.mean()), math.copysign(90.0, latitude), true * first.radius)
        points = [plane.forward(*pair) for pair in points]
    lines, births, seen = points[: len(runs)], points[len(runs) : -1], points[-1]
    x, y = (np.concatenate([line[k] for line in (*lines, seen)]) for k in (0, 1))
    latlon = first.latlon and plane is None
    least = 0.2 if latlon else 2e4
    box = widened(Box(x.min(), x.max(), y.min(), y.max()), latlon, 0.95, margin=0.08, least=least)

    figure = style.new_figure(7.0, 8.2, dpi)
    ax = figure.subplots()
    panel = Map(ax, box, latlon=latlon, radius=first.radius, ticks=6, labels=True, plane=plane)
    for k, (run, (east, north), born) in enumerate(zip(runs, lines, births, strict=True)):
        colour = colours.FRAGMENTS[k % len(colours.FRAGMENTS)]
        ax.plot(east, north, color=colour, lw=2.0, zorder=7, label=run.name)
        ax.plot(east[-1], north[-1], "s", color=colour, mec="black", ms=6, zorder=8)
        ax.plot(*born, "*", color=colour, mec="black", ms=12, ls="", zorder=9)
    labels = style.Labels(ax)
    records = [k for k in np.linspace(0, first.times.size - 1, min(6, first.times.size)).astype(int)]
    ax.plot(*(a[records] for a in lines[0]), "o", mfc="white", mec="black", ms=5, ls="", zorder=8,
            label=f"dates of {runs[0].name}")  # fmt: skip
    ax.plot([], [], "s", color="white", mec="black", ms=6, ls="", label="end")
    if any(born[0].size for born in births):
        ax.plot([], [], "*", color="white", mec="black", ms=11, ls="", label="place of a break-up")
    if seen[0].size:
        ax.plot(*seen, "x:", color=colours.OBSERVED, ms=6, lw=1.0, zorder=7.5, label="observed")
    panel.draw_scale()
    figure.legend(fontsize=8, loc="outside lower left", ncols=3, frameon=False)
    berg = f"{first.berg}: " if first.berg else ""
    style.put_title(figure, f"{berg}{', '.join(run.name for run in runs)}\n{style.span_text(first.times)}")
    style.lay_out(figure)
    for x, y in zip(*(a[:: max(1, a.size // 60)] for a in lines[0]), strict=True):
        labels.prefer_off(float(x), float(y))
    for x, y in (place for born in births for place in zip(*born, strict=True)):
        labels.avoid(float(x), float(y), 7.0)
    for k, text in zip(records, style.moment_texts(first.times, records, hour=False), strict=True):
        labels.put(text, float(lines[0][0][k]), float(lines[0][1][k]), fontsize=9)
    return style.save_figure(figure, path)


def _columns(places: Iterable[tuple[float, float]]) -> tuple[Floats, Floats]:
    pairs = np.array(list(places), np.float64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
