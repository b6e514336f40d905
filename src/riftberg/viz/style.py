"""Colours, axes in degrees, scale bars and labels that keep out of each other's way."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from riftberg.whole_files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

FRAGMENT_COLOURS = ("#E69F00", "#009E73", "#CC79A7", "#D55E00", "#F0E442", "#8C510A")
"""Largest fragment first; colours of Okabe and Ito that are told apart with any colour vision, and from blue water."""

PLACES = (
    (7, 5, "left", "bottom"),
    (7, -5, "left", "top"),
    (-7, 5, "right", "bottom"),
    (-7, -5, "right", "top"),
    (0, 10, "center", "bottom"),
    (0, -10, "center", "top"),
)
"""Where a label may stand beside its point: offset in points and alignment, best first."""

SMALL_COLOUR = "#666666"
"""Fragments too small to be named."""

GROUND_COLOUR = "#A50026"
"""Sea floor that the keel touches."""


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure into a file that is whole or not there; the ending of its name says the format."""
    with replacing(path) as part:
        figure.savefig(part, format=Path(path).suffix.removeprefix(".") or None)


def new_figure(width: float, height: float, dpi: int) -> Figure:
    """Return a figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def speed_map(steps: int | None = None) -> Colormap:
    """Return the colours of current speed: white to a middle blue, light enough for arrows and ice on top.

    They are smooth, or so many steps.
    """
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    smooth = LinearSegmentedColormap.from_list("speed", colormaps["Blues"](np.linspace(0.0, 0.68, 64)))
    return smooth if steps is None else smooth.resampled(steps)


def degree_label(value: float, positive: str, negative: str, decimals: int) -> str:
    """Return a geographic label such as ``38.5°W``; longitudes may be given from 0 to 360."""
    value = (value + 180.0) % 360.0 - 180.0
    text = f"{abs(value):.{decimals}f}°"
    if float(f"{abs(value):.{decimals}f}") == 0.0:
        return text
    return text + (positive if value > 0.0 else negative)


def geographic_axes(ax: Axes, *, latlon: bool, ticks: int = 6, labels: bool = True) -> None:
    """Label the axes in degrees, or in km where positions are metres."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    for axis, names in ((ax.xaxis, "EW"), (ax.yaxis, "NS")):
        axis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
        if latlon:
            places = axis.get_major_locator().tick_values(*axis.get_view_interval())
            decimals = max(0, -math.floor(math.log10(float(np.diff(places).min())) + 1e-9))
            axis.set_major_formatter(FuncFormatter(lambda v, _, n=names, d=decimals: degree_label(v, n[0], n[1], d)))
        else:
            axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v / 1e3:g}"))
    if not latlon and labels:
        ax.set_xlabel("x (km)")
        ax.set_ylabel("y (km)")
    ax.tick_params(labelsize=8, length=3)


def round_length(most: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... not above ``most``."""
    power = 10.0 ** math.floor(math.log10(most))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= most)


def date_axis(ax: Axes) -> None:
    """Label the axis of time with dates, as short as can be."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator()  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def scale_bar(ax: Axes, *, km: float, units_per_km: float) -> None:
    """Draw a bar of ``km`` kilometres in the lower left corner; ``units_per_km`` along x."""
    from matplotlib.patheffects import withStroke

    (west, east), (south, north) = ax.get_xlim(), ax.get_ylim()
    x, y = west + 0.05 * (east - west), south + 0.055 * (north - south)
    halo = [withStroke(linewidth=4.5, foreground="white")]
    ax.plot(
        [x, x + km * units_per_km], [y, y], color="black", lw=2.2, solid_capstyle="butt", path_effects=halo, zorder=9
    )
    ax.annotate(
        f"{km:g} km", (x + 0.5 * km * units_per_km, y), (0, 3), textcoords="offset points", ha="center", va="bottom",
        fontsize=8, path_effects=[withStroke(linewidth=2.5, foreground="white")], zorder=9,
    )  # fmt: skip


class Labels:
    """Text beside points, placed so that no two overlap; a label that finds no room is left out."""

    def __init__(self, ax: Axes) -> None:
        self.ax = ax
        self._taken: list[Any] = []

    def avoid(self, x: float, y: float, points: float = 5.0) -> None:
        """Keep labels off a mark at a point."""
        from matplotlib.transforms import Bbox

        px, py = self.ax.transData.transform((x, y))
        self._taken.append(Bbox.from_bounds(px - points, py - points, 2.0 * points, 2.0 * points))

    def put(self, text: str, x: float, y: float, **style: Any) -> bool:
        """Place a label; returns whether there was room."""
        from matplotlib.patheffects import withStroke

        renderer = self.ax.figure.canvas.get_renderer()  # type: ignore[attr-defined]
        for dx, dy, ha, va in PLACES:
            label = self.ax.annotate(
                text, (x, y), (dx, dy), textcoords="offset points", ha=ha, va=va, zorder=10,
                path_effects=[withStroke(linewidth=2.5, foreground="white")], **{"fontsize": 8, **style},
            )  # fmt: skip
            box = label.get_window_extent(renderer).expanded(1.03, 1.1)
            inside = self.ax.bbox.fully_containsx(box.x0) and self.ax.bbox.fully_containsx(box.x1)
            inside = inside and self.ax.bbox.fully_containsy(box.y0) and self.ax.bbox.fully_containsy(box.y1)
            if inside and not any(box.overlaps(other) for other in self._taken):
                self._taken.append(box)
                return True
            label.remove()
        return False


def wrapped(text: str, width: float, *, size: float) -> list[str]:
    """Break the lines of a text so that they fit into a width (inches) at a size of letters (points)."""
    from textwrap import wrap

    letters = max(20, int(width * 72.0 / (0.56 * size)))  # mean letter: 0.56 of the size
    return [part for line in text.split("\n") for part in wrap(line, letters)]
