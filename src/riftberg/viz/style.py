"""Files, titles, moments, axes in degrees, scale bars and labels that keep out of each other's way."""

from __future__ import annotations

import functools
import inspect
import math
import re
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, Final, Literal, ParamSpec, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import InputError
from riftberg.system.atomic_files import replacing
from riftberg.viz import colours

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")

DIRECTIONS: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
"""In which a label may stand from its point, best first."""

PLACES: Final = tuple(
    (
        reach * x / math.hypot(x, y),
        reach * y / math.hypot(x, y),
        ("center", "left", "right")[x],
        ("center", "bottom", "top")[y],
    )
    for reach in (9.0, 20.0, 36.0, 54.0)
    for x, y in DIRECTIONS
)
"""Where a label may stand beside its point: offset in points and alignment, best first."""

LED: Final = 11.0
"""Distance (points) from which on a line joins a label to its point: between two marks it would belong to either."""

EDITABLE: Any = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "riftberg"}
"""Settings of vector files: letters stay letters, which journals ask for, and two files of a picture are alike."""

UNDATED: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
"""Entries without which two files of one picture differ."""


def check_format(path: str | Path) -> str:
    """Return the format that the ending of a picture's name says, empty where it has none."""
    from matplotlib.backend_bases import FigureCanvasBase

    ending = Path(path).suffix.removeprefix(".").lower()
    formats = FigureCanvasBase.get_supported_filetypes()
    if ending and ending not in formats:
        raise InputError(
            f"no picture can be written as .{ending}",
            where=str(path),
            remedy=f"Use one of {', '.join(sorted(formats))}",
        )
    return ending


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure into a file that is whole or not there; the ending of its name gives the format."""
    from matplotlib import rc_context

    ending = check_format(path)
    with replacing(path) as temporary:
        if ending in ("pdf", "ps", "eps", "svg"):
            with rc_context(EDITABLE):
                figure.savefig(temporary, format=ending, metadata=UNDATED.get(ending))
        else:
            figure.savefig(temporary, format=ending or None)
    return Path(path)


class Picture(Protocol[P]):
    """Drawing of a run: a file where a path is given, else a figure."""

    @overload
    def __call__(self, run: xr.Dataset, path: str | Path, *args: P.args, **kwargs: P.kwargs) -> Path: ...
    @overload
    def __call__(self, run: xr.Dataset, path: None = None, *args: P.args, **kwargs: P.kwargs) -> Figure: ...


def saved_or_shown(draw: Callable[Concatenate[xr.Dataset, P], Figure]) -> Picture[P]:
    """Return a function that draws a run with an argument ``path`` more: with it the figure is written."""

    @functools.wraps(draw)
    def drawn(run: xr.Dataset, path: str | Path | None = None, *args: P.args, **kwargs: P.kwargs) -> Path | Figure:
        if path is not None:
            check_format(path)
        figure = draw(run, *args, **kwargs)
        return figure if path is None else save_figure(figure, path)

    signature = inspect.signature(draw)
    first, *others = signature.parameters.values()
    path = inspect.Parameter(
        "path", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation="str | Path | None"
    )
    drawn.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[first, path, *others], return_annotation="Path | Figure"
    )
    return drawn  # type: ignore[return-value]


def new_figure(width: float, height: float, dpi: int) -> Figure:
    """Return a figure (inches) that needs no display and arranges its parts automatically."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class Shown(Figure):
        """Figure that a notebook shows, also where pyplot, which usually sees to that, was never imported."""

        def _repr_png_(self) -> bytes:
            content = BytesIO()
            self.savefig(content, format="png")
            return content.getvalue()

    figure = Shown(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def lay_out(figure: Figure) -> None:
    """Arrange a figure now and for good: labels and widths of lines are fitted to where its axes stand."""
    engine = figure.get_layout_engine()
    assert engine is not None
    # Maps keep their shape, which leaves room beside them; margins are found as if they had none, or labels are cut off.
    aspects = [(ax, ax.get_aspect()) for ax in figure.axes]
    for ax, _ in aspects:
        ax.set_aspect("auto")
    engine.execute(figure)
    for ax, aspect in aspects:
        ax.set_aspect(aspect)
        if aspect != "auto":
            ax.apply_aspect()  # now, not when the figure is drawn: labels find their places on the map as it will be
    # Not "none", which leaves an engine that does nothing: with any engine a figure is drawn twice when it is written.
    figure.set_layout_engine(None)


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

    (west, east), (south, north) = ax.get_xlim(), ax.get_ylim()
    # Of a map in metres kilometres, or on a small one metres, from a round kilometre where that is far from the origin.
    factor = 1e3 if max(east - west, north - south) > 4e3 else 1.0
    origins = [
        1e3 * round(5e-4 * (low + high)) if factor == 1.0 and abs(low + high) > 2e4 else 0.0
        for low, high in ((west, east), (south, north))
    ]
    for axis, names, origin in ((ax.xaxis, "EW", origins[0]), (ax.yaxis, "NS", origins[1])):
        axis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
        if latlon:
            tick_values = axis.get_major_locator().tick_values(*axis.get_view_interval())
            # As many decimals as the ticks are apart, so that no two read alike.
            decimals = max(0, -math.floor(math.log10(float(np.diff(tick_values).min())) + 1e-9))
            axis.set_major_formatter(FuncFormatter(lambda v, _, n=names, d=decimals: degree_label(v, n[0], n[1], d)))
        else:
            axis.set_major_formatter(FuncFormatter(lambda v, _, o=origin, f=factor: f"{(v - o) / f:.10g}"))
    if not latlon and labels:
        for axis, name, origin in ((ax.xaxis, "x", origins[0]), (ax.yaxis, "y", origins[1])):
            start = f" \u2212 {origin / 1e3:,.0f} km" if origin else ""
            axis.set_label_text(f"{name}{start} ({'km' if factor > 1.0 else 'm'})", fontsize=8)
            axis.labelpad = 2
    ax.tick_params(labelsize=8, length=3)


def plain_axes(ax: Axes) -> None:
    """Give the axes of a curve a faint grid below it, small numbers and no frame above and on the right."""
    ax.grid(color=colours.GRID, lw=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=8)
    ax.spines[["top", "right"]].set_visible(False)


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
        first, last = sorted(num2date(limit).year for limit in limits())  # type: ignore[no-untyped-call]
        return f"{first}" if first == last else f"{first} to {last}"

    class Dates(ConciseDateFormatter):
        """Dates such as 9 Dec."""

        def format_ticks(self, values: Any) -> list[str]:
            texts = super().format_ticks(values)  # type: ignore[no-untyped-call]
            return [text[1:] if text[:1] == "0" and " " in text else text for text in texts]

        def get_offset(self) -> str:
            return years() if which == "x" else ""

    # Its largest steps are 30 min, 12 h and 6 months: six of them reach the three hours, days and years of the next kind.
    few = {} if which == "x" else {"minticks": 3, "maxticks": 7}
    locator = AutoDateLocator(**few)  # type: ignore[no-untyped-call]
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

    def avoid_box(self, box: Any) -> None:
        """Keep labels off a rectangle of the picture, pixels."""
        self._taken.append(box)

    def prefer_off(self, x: float, y: float, points: float = 2.0) -> None:
        """Keep labels off a point of a line where there is another place for them."""
        self._better_free.append(self._mark(x, y, points))

    def prefer_off_line(self, x: Any, y: Any) -> None:
        """Keep labels off some sixty points along a line; it has gaps where a point is not finite."""
        length = max(2, 60 // max(1, len(x) - 1)) + 1
        for fraction in np.linspace(0.0, 1.0, length)[:-1]:
            between = (fraction * v[1:] + (1.0 - fraction) * v[:-1] for v in (x, y))
            for point in zip(*(v[:: max(1, len(v) // 60)] for v in between), strict=True):
                if math.isfinite(sum(point)):
                    self.prefer_off(*map(float, point))

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
        from matplotlib.patheffects import withStroke

        label = self.ax.annotate(
            text, (x, y), (0, 0), textcoords="offset points", zorder=10,
            path_effects=[withStroke(linewidth=2.5, foreground="white")], **{"fontsize": 8, **style},
        )  # fmt: skip
        frame, free = self.ax.bbox, []
        # All places are tried: one off the lines may come after one on them.
        for anchor in PLACES:
            label.set(position=anchor[:2], ha=anchor[2], va=anchor[3])
            box = label.get_window_extent().padded(0.03 * self.ax.figure.dpi)
            inside = all(map(frame.containsx, (box.x0, box.x1))) and all(map(frame.containsy, (box.y0, box.y1)))
            if inside and not any(map(box.overlaps, self._taken)):
                free.append((any(map(box.overlaps, self._better_free)), anchor, box))
        if not free:
            label.remove()
            return False
        _, anchor, box = min(
            free, key=lambda candidate: candidate[0]
        )  # the first of those off the lines, else the first
        label.set(position=anchor[:2], ha=anchor[2], va=anchor[3])
        self._taken.append(box)
        if math.hypot(*anchor[:2]) > LED:
            self.ax.annotate(
                "", (x, y), anchor[:2], textcoords="offset points", zorder=6.5,
                arrowprops={"arrowstyle": "-", "lw": 0.8, "color": colours.STRENGTH, "shrinkA": 0.0, "shrinkB": 3.0},
            )  # fmt: skip
        return True


def insert_gaps(x: Any, y: Any, area: Any) -> tuple[Any, Any]:
    """Return a track with gaps where its berg lost more than a hundredth of its area at once: there its centroid jumps."""
    with np.errstate(invalid="ignore"):
        jumps = np.flatnonzero(np.diff(area) < -0.01 * area[:-1]) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)


def colour_bar(axes: Sequence[Axes], shades: Any, label: str, **options: Any) -> Any:
    """Draw the scale of colours beside axes, by default below.

    ``options``: as matplotlib's ``colorbar`` takes them.
    """
    placed = {"location": "bottom", "shrink": 0.6, "aspect": 45, "pad": 0.02, **options}
    bar = axes[0].figure.colorbar(shades, ax=axes, **placed)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=8, length=2)
    return bar


def legend_above(ax: Axes, **options: Any) -> None:
    """Put the legend of curves above the right end of their axes, if any has a name."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderaxespad=0.1, **options)


def legend_below(figure: Any, handles: Sequence[Any], *, columns: int) -> None:
    """Put a legend below all axes of a figure, in as many columns as its width holds, at most ``columns``."""
    for count in range(columns, 0, -1):
        legend = figure.legend(handles=handles, fontsize=8, loc="outside lower left", ncols=count, frameon=False)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def letters(axes: Sequence[Axes]) -> None:
    """Name the panels of a figure by letters, each above its left end; a single one needs none."""
    for name, ax in zip("abcdefghijklmnopqrstuvwxyz", axes, strict=False):
        if len(axes) > 1:
            ax.set_title(f"({name})", loc="left", fontsize=10, fontweight="bold", pad=4)


def outer_names(axes: Sequence[Axes], columns: int) -> None:
    """Name x and y at the left and the lower panels of a table of panels alone; between panels they would collide."""
    for k, ax in enumerate(axes):
        if k % columns:
            ax.set_ylabel("")
        if k + columns < len(axes):
            ax.set_xlabel("")


_UNIT = r"(?:[kcm]?m|km²|m/s|[kMG]?Pa|kg|Gt|°C?|h|s|days?|degrees?|[NSEW]|[A-Z][a-z]{2})(?![\w-])"
"""Units, points of the compass and months, as they follow a number in titles."""


def put_title(figure: Figure, text: str, *, size: float = 12.0) -> None:
    """Put a title at the top left of a figure, in as many lines as it takes."""
    width, text = figure.get_figwidth(), text.replace(" km2", " km²")
    figure.suptitle("\n".join(wrap_text(text, width - 0.4, size=size)), x=0.1 / width, ha="left", fontsize=size)


def wrap_text(text: str, width: float, *, size: float) -> list[str]:
    """Break the lines of a text so that they fit into a width (inches) at a size of letters (points).

    A number stays with its unit.
    """
    from textwrap import wrap

    letters = max(20, int(width * 72.0 / (0.56 * size)))  # mean letter: 0.56 of the size
    bound = re.sub(rf"(?<=\d) (?={_UNIT})", "\u00a0", text)
    return [row for line in bound.split("\n") for row in wrap(line, letters)]


Times = NDArray[np.datetime64]

SHORT: Final = 6.0 * 3600.0
"""Runs up to this length (s) show the time since their start: minutes of a date say nothing of ten seconds."""

UNITS: Final = (("s", 1.0, 180.0), ("min", 60.0, 3.0 * 3600.0), ("h", 3600.0, math.inf))
"""Name, seconds, and the longest run that is shown in it."""


def run_length(times: Times) -> float:
    """Return the length of a run, s."""
    return float((times[-1] - times[0]) / np.timedelta64(1, "ms")) / 1e3


def is_short(times: Times) -> bool:
    """Return whether moments of a run are shown as the time since its start."""
    return run_length(times) <= SHORT


def day_text(moment: np.datetime64, *, year: bool = False, hour: bool = True) -> str:
    """Return a date such as ``17 Dec 13:00``."""
    when = moment.astype("datetime64[s]").item()
    text = f"{when.day} {when:%b}" + (f" {when.year}" if year else "")
    return text + (f" {when:%H:%M}" if hour else "")


def spell_name(name: str) -> str:
    """Return the name of an input or result as words, such as ``start east`` for ``start.east``."""
    words = re.sub(r"[._]", " ", name)
    return re.sub(r"\blat\b", "latitude", re.sub(r"\blon\b", "longitude", words))


def reword_dates(text: str) -> str:
    """Return a text with its ISO date as in all other places of a picture, such as ``17 Dec 2020 13:00``."""
    return re.sub(r"\d{4}-\d\d-\d\d", lambda match: day_text(np.datetime64(match[0]), year=True, hour=False), text)


def moment_text(times: Times, moment: np.datetime64, *, year: bool = False) -> str:
    """Return a moment of a run with these records: its date, or in a short run the time since the start."""
    if not is_short(times):
        return day_text(moment, year=year)
    name, size, _ = next(unit for unit in UNITS if run_length(times) <= unit[2])
    steps = np.diff(times) / np.timedelta64(1, "ms") / 1e3 / size
    least = float(steps.min()) if len(steps) else 1.0
    # As many decimals as distinguish neighbouring records.
    decimals = min(3, max(0, math.ceil(-math.log10(max(least, 1e-9)) - 1e-9)))
    since = float((moment - times[0]) / np.timedelta64(1, "ms")) / 1e3 / size
    return f"{since:.{decimals}f} {name}"


def moment_texts(times: Times, records: Sequence[int], *, hour: bool = True) -> list[str]:
    """Return the moments of records as texts that all differ: days, hours or seconds, as much as that needs."""
    moments = [times[record] for record in records]
    if is_short(times):
        return [moment_text(times, moment) for moment in moments]
    dates = [moment.astype("datetime64[s]").item() for moment in moments]
    forms = ("%b", "%b %H:%M", "%b %H:%M:%S")
    tried = [[f"{date.day} {date:{form}}" for date in dates] for form in forms[bool(hour) :]]
    return next((texts for texts in tried if len(set(texts)) == len(set(moments))), tried[-1])


def span_text(times: Times) -> str:
    """Return from when to when a run goes, or how long it is."""
    if is_short(times):
        return moment_text(times, times[-1])
    hour = run_length(times) < 2.0 * SECONDS_PER_DAY
    same_year = times[0].astype("datetime64[Y]") == times[-1].astype("datetime64[Y]")
    # The hour would stand between day and year.
    begin, end = (day_text(times[k], year=k != 0 or hour or not same_year, hour=hour) for k in (0, -1))
    return f"{begin} to {end}"
