"""Files, titles, axes in degrees, scale bars and labels that keep out of each other's way."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from riftberg.errors import InputError
from riftberg.system.atomic_files import replacing
from riftberg.viz import colours

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLACES = (
    (7, 5, "left", "bottom"),
    (7, -5, "left", "top"),
    (-7, 5, "right", "bottom"),
    (-7, -5, "right", "top"),
    (0, 10, "center", "bottom"),
    (0, -10, "center", "top"),
    (12, 14, "left", "bottom"),
    (12, -14, "left", "top"),
    (-12, 14, "right", "bottom"),
    (-12, -14, "right", "top"),
)
"""Where a label may stand beside its point: offset in points and alignment, best first."""

EDITABLE: Any = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "riftberg"}
"""Settings of vector files: letters stay letters, which journals ask for, and two files of a picture are alike."""

UNDATED: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
"""Entries without which two files of one picture differ."""


def check_format(path: str | Path) -> str:
    """Return the format that the ending of a picture's name says, empty where it has none."""
    from matplotlib.backend_bases import FigureCanvasBase

    ending = Path(path).suffix.removeprefix(".").lower()
    known = FigureCanvasBase.get_supported_filetypes()
    if ending and ending not in known:
        raise InputError(
            f"no picture can be written as .{ending}", where=str(path), remedy=f"Use one of {', '.join(sorted(known))}"
        )
    return ending


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure into a file that is whole or not there; the ending of its name says the format."""
    from matplotlib import rc_context

    ending = check_format(path)
    with replacing(path) as part:
        if ending in ("pdf", "ps", "eps", "svg"):
            with rc_context(EDITABLE):
                figure.savefig(part, format=ending, metadata=UNDATED.get(ending))
        else:
            figure.savefig(part, format=ending or None)


def new_figure(width: float, height: float, dpi: int) -> Figure:
    """Return a figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def degree_label(value: float, positive: str, negative: str, decimals: int) -> str:
    """Return a geographic label such as ``38.5°W``; longitudes may be given from 0 to 360."""
    value = (value + 180.0) % 360.0 - 180.0
    text = f"{abs(value):.{decimals}f}°"
    if float(f"{abs(value):.{decimals}f}") in (0.0, 180.0):
        return text
    return text + (positive if value > 0.0 else negative)


def geographic_axes(ax: Axes, *, latlon: bool, ticks: int = 6, labels: bool = True) -> None:
    """Label the axes in degrees, or in km where positions are metres."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    factor = metres_factor(ax)
    for axis, names in ((ax.xaxis, "EW"), (ax.yaxis, "NS")):
        axis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
        if latlon:
            places = axis.get_major_locator().tick_values(*axis.get_view_interval())
            decimals = max(0, -math.floor(math.log10(float(np.diff(places).min())) + 1e-9))
            axis.set_major_formatter(FuncFormatter(lambda v, _, n=names, d=decimals: degree_label(v, n[0], n[1], d)))
        else:
            axis.set_major_formatter(FuncFormatter(lambda v, _, f=factor: f"{v / f:.10g}"))
    if not latlon and labels:
        unit = "km" if factor > 1.0 else "m"
        ax.set_xlabel(f"x ({unit})", fontsize=8, labelpad=2)
        ax.set_ylabel(f"y ({unit})", fontsize=8, labelpad=2)
    ax.tick_params(labelsize=8, length=3)


def plain_axes(ax: Axes) -> None:
    """Give the axes of a curve a faint grid below it, small numbers and no frame above and on the right."""
    ax.grid(color=colours.GRID, lw=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=8)
    ax.spines[["top", "right"]].set_visible(False)


def metres_factor(ax: Axes) -> float:
    """Return the metres in the unit of the axes of a map in metres: those of a kilometre, or 1 on a small map."""
    (west, east), (south, north) = ax.get_xlim(), ax.get_ylim()
    return 1e3 if max(east - west, north - south) > 4e3 else 1.0


def round_length(most: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... not above ``most``."""
    power = 10.0 ** math.floor(math.log10(most))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= most)


def date_axis(ax: Axes, which: Literal["x", "y"] = "x") -> None:
    """Label the axis of time with dates as in all other places of a picture, and the year, or years, once.

    The year stands at the end of a horizontal axis, and in the name of a vertical one.
    """
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, num2date

    axis, limits = (ax.xaxis, ax.get_xlim) if which == "x" else (ax.yaxis, ax.get_ylim)

    def years() -> str:
        first, last = sorted(num2date(place).year for place in limits())  # type: ignore[no-untyped-call]
        return f"{first}" if first == last else f"{first} to {last}"

    class Dates(ConciseDateFormatter):
        """Dates such as 9 Dec."""

        def format_ticks(self, values: Any) -> list[str]:
            texts = super().format_ticks(values)  # type: ignore[no-untyped-call]
            return [text[1:] if text[:1] == "0" and " " in text else text for text in texts]

        def get_offset(self) -> str:
            return years() if which == "x" else ""

    locator = AutoDateLocator(maxticks=None if which == "x" else 6)  # type: ignore[no-untyped-call]
    axis.set_major_locator(locator)
    axis.set_major_formatter(
        Dates(  # type: ignore[no-untyped-call]
            locator,
            formats=["%Y", "%b", "%d %b", "%H:%M", "%H:%M", "%S.%f"],
            zero_formats=["", "%Y", "%d %b", "%d %b", "%H:%M", "%H:%M"],
            offset_formats=["", "", "%Y", "%Y", "%Y", "%Y"],
        )
    )
    if which == "y":
        ax.set_ylabel(f"date, {years()}", fontsize=9)


def scale_bar(ax: Axes, *, km: float, units_per_km: float, place: tuple[float, float] | None = None) -> None:
    """Draw a bar of ``km`` kilometres from a place on, by default the lower left corner; ``units_per_km`` along x."""
    from matplotlib.patheffects import withStroke

    (west, east), (south, north) = ax.get_xlim(), ax.get_ylim()
    x, y = place or (west + 0.05 * (east - west), south + 0.055 * (north - south))
    halo = [withStroke(linewidth=4.5, foreground="white")]
    ax.plot(
        [x, x + km * units_per_km], [y, y], color="black", lw=2.2, solid_capstyle="butt", path_effects=halo, zorder=9
    )
    ax.annotate(
        f"{km:g} km" if km >= 0.9 else f"{1e3 * km:g} m", (x + 0.5 * km * units_per_km, y), (0, 3),
        textcoords="offset points", ha="center", va="bottom", fontsize=8,
        path_effects=[withStroke(linewidth=2.5, foreground="white")], zorder=9,
    )  # fmt: skip


class Labels:
    """Text beside points, placed so that no two overlap; a label that finds no room is left out."""

    def __init__(self, ax: Axes) -> None:
        self.ax = ax
        self._taken: list[Any] = []
        self._better_free: list[Any] = []

    def avoid(self, x: float, y: float, points: float = 5.0) -> None:
        """Keep labels off a mark at a point."""
        self._taken.append(self._mark(x, y, points))

    def prefer_off(self, x: float, y: float, points: float = 2.0) -> None:
        """Keep labels off a point of a line where there is another place for them."""
        self._better_free.append(self._mark(x, y, points))

    def apart(self, first: tuple[float, float], second: tuple[float, float]) -> float:
        """Return the distance of two places on the picture, points."""
        (x0, y0), (x1, y1) = self.ax.transData.transform([first, second])
        return math.hypot(x1 - x0, y1 - y0) * 72.0 / float(self.ax.figure.dpi)

    def _mark(self, x: float, y: float, points: float) -> Any:
        from matplotlib.transforms import Bbox

        px, py = self.ax.transData.transform((x, y))
        pixels = points * self.ax.figure.dpi / 72.0
        return Bbox.from_bounds(px - pixels, py - pixels, 2.0 * pixels, 2.0 * pixels)

    def put(self, text: str, x: float, y: float, **style: Any) -> bool:
        """Place a label; returns whether there was room."""
        spare = None
        for place in PLACES:
            label, box = self._tried(text, x, y, place, style)
            if not self._inside(box) or any(box.overlaps(other) for other in self._taken):
                label.remove()
            elif not any(box.overlaps(other) for other in self._better_free):
                if spare is not None:
                    spare[0].remove()
                self._taken.append(box)
                return True
            elif spare is None:
                spare = label, box
            else:
                label.remove()
        if spare is not None:
            self._taken.append(spare[1])
        return spare is not None

    def _tried(self, text: str, x: float, y: float, place: tuple[int, int, str, str], style: Any) -> tuple[Any, Any]:
        from matplotlib.patheffects import withStroke

        dx, dy, ha, va = place
        label = self.ax.annotate(
            text, (x, y), (dx, dy), textcoords="offset points", ha=ha, va=va, zorder=10,
            path_effects=[withStroke(linewidth=2.5, foreground="white")], **{"fontsize": 8, **style},
        )  # fmt: skip
        return label, label.get_window_extent().padded(0.03 * self.ax.figure.dpi)

    def _inside(self, box: Any) -> bool:
        frame = self.ax.bbox
        return all((frame.containsx(box.x0), frame.containsx(box.x1), frame.containsy(box.y0), frame.containsy(box.y1)))


def letter(ax: Axes, number: int) -> None:
    """Name a panel by a letter, above its left end."""
    ax.set_title(f"({'abcdefghijklmnopqrstuvwxyz'[number % 26]})", loc="left", fontsize=10, fontweight="bold", pad=4)


def outer_names(axes: Sequence[Axes], columns: int) -> None:
    """Name x and y at the left and the lower panels of a table of panels alone; between panels they would collide."""
    for k, ax in enumerate(axes):
        if k % columns:
            ax.set_ylabel("")
        if k + columns < len(axes):
            ax.set_xlabel("")


_UNIT = r"(?:[kcm]?m|km²|m/s|[kMG]?Pa|kg|Gt|°C?|h|s|days?|degrees?|[NSEW]|[A-Z][a-z]{2})(?![\w-])"
"""Units, points of the compass and months, as they follow a number in titles."""


def title_lines(figure: Figure, text: str, *, size: float = 12.0, left: float = 0.3) -> list[str]:
    """Return the lines in which a title fits on a figure that begins ``left`` inches from its edge."""
    return wrapped(text, figure.get_figwidth() - left - 0.3, size=size)


def put_title(figure: Figure, text: str, *, size: float = 12.0, left: float = 0.3) -> float:
    """Put a title at the top left of a figure, in as many lines as it takes; returns the height it takes, inches."""
    lines = title_lines(figure, text, size=size, left=left)
    width, height = figure.get_size_inches()
    figure.suptitle("\n".join(lines), x=left / width, y=1.0 - 0.1 / height, va="top", ha="left", fontsize=size)
    return 0.1 + len(lines) * size * 1.25 / 72.0


def wrapped(text: str, width: float, *, size: float) -> list[str]:
    """Break the lines of a text so that they fit into a width (inches) at a size of letters (points).

    A number stays with its unit.
    """
    from textwrap import wrap

    letters = max(20, int(width * 72.0 / (0.56 * size)))  # mean letter: 0.56 of the size
    held = re.sub(rf"(?<=\d) (?={_UNIT})", "\u00a0", text)
    return [part for line in held.split("\n") for part in wrap(line, letters)]
