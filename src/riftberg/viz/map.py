"""The map of a run: where the berg went, how it turned and broke, in which water."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, overload

import numpy as np
import xarray as xr

from riftberg.config.values import required
from riftberg.diagnostics.summary import melt_lines
from riftberg.errors import InputError
from riftberg.runs.groundings import title_lines
from riftberg.runs.layout import run_heading
from riftberg.runs.scene import Scene
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.panels import (
    SEAM,
    Panel,
    Projection,
    Water,
    arrow_key,
    common_boxes,
    depth_bar,
    fragment_colours,
    fragment_name,
    fragment_patches,
    make_panels,
    melt_bar,
    melts,
    project_run,
    speed_bar,
    speed_scale,
    thickness_lost,
    widen_box,
)
from riftberg.viz.records import nearest_record, telling_records

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from riftberg.viz.panels import Panel

Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO date to rings of shape (n, 2), longitude and latitude."""

NEAR = 8.0
"""Marks on the track that are nearer than this (points) share one date."""

OVERVIEW: Final = 0.95
"""Least width over height of the overview in the figure of a map."""

WIDE: Final = 1.6
"""Width over height from which on the overview stands above the panels, not beside them."""

UPRIGHT: Final = 1.2
"""Largest width over height of the overview beside the panels: it fills the height that they have."""

WIDEST: Final = 4.5
"""Largest width over height of the overview."""

MARGIN: Final = 0.05
"""Margin of the overview, as part of its longer side."""


@overload
def draw_map(
    run: xr.Dataset, path: str | Path, *, forcing: Water | None = None, title: str = "", dates: int = 6,
    observed: Outlines | None = None, projection: Projection = "auto", dpi: int = 150,
) -> Path: ...  # fmt: skip
@overload
def draw_map(
    run: xr.Dataset, path: None = None, *, ax: Axes, date: Any = None, forcing: Water | None = None,
    observed: Outlines | None = None, projection: Projection = "auto",
) -> Axes: ...  # fmt: skip
@overload
def draw_map(
    run: xr.Dataset, path: None = None, *, forcing: Water | None = None, title: str = "", dates: int = 6,
    observed: Outlines | None = None, projection: Projection = "auto", dpi: int = 150,
) -> Figure: ...  # fmt: skip
def draw_map(
    run: xr.Dataset,
    path: str | Path | None = None,
    *,
    ax: Axes | None = None,
    date: Any = None,
    forcing: Water | None = None,
    title: str = "",
    dates: int = 6,
    observed: Outlines | None = None,
    projection: Projection = "auto",
    dpi: int = 150,
) -> Path | Axes | Figure:
    """Draw the map of a run: into a file, into axes of one's own, or as a figure.

    The figure has on the left, or above where the drift is wide, the tracks of the fragments, with the berg at the first
    and the last date; beside that the berg at up to ``dates`` dates, after its break-ups and between them, in the currents
    of these dates. Elements are drawn in their true size, shape and orientation. A track has a gap where the fragment
    broke: there its centroid jumps.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run` or from `Model.run`.
    path : path, optional
        Picture to write; the ending decides on the format: ``.png``, ``.pdf``, ``.svg`` and others of matplotlib.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into, instead of a figure: the tracks, or the berg at ``date``. Tracks and signs carry labels, so that
        ``ax.legend()`` explains them; x and y are degrees (metres in a Cartesian run, and with ``projection="polar"``).
    date : str or numpy.datetime64 or datetime, optional
        With ``ax``: draw the berg at this date, in the current of this date.
    forcing : Forcing or StoredWater, optional
        Gives currents and depth of water; by default as stored in the run file, or the forcing of a run in memory.
    title : str, optional
        First line of the title; by default the experiment. The second line names the forcing.
    dates : int, optional
        Number of dates, 2 to 6.
    observed : mapping, optional
        Observed outlines by ISO date, drawn on the dates that they belong to.
    projection : {"auto", "polar", "degrees"}, optional
        ``"auto"`` is polar stereographic where the middle of the run is beyond 60 degrees, and degrees elsewhere and on ``ax``.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path, matplotlib.axes.Axes or matplotlib.figure.Figure
        The picture if ``path`` is given, ``ax`` if that is, else the figure.

    Examples
    --------
    >>> figure, (left, right) = plt.subplots(1, 2)                          # doctest: +SKIP
    >>> draw_map(run, ax=left)                                              # doctest: +SKIP
    >>> draw_map(run, ax=right, date="2020-12-17T13:00")                    # doctest: +SKIP
    >>> figure.savefig("berg.pdf")                                          # doctest: +SKIP
    """
    required(run, xr.Dataset, "a run, as Model.run or riftberg.open_run return it", where="draw_map")
    if ax is not None and projection == "auto":
        projection = "degrees"
    scene, water = project_run(run, projection, forcing)
    outlines = observed or {}
    if ax is not None:
        if path is not None:
            raise InputError("both a file and axes", where="draw_map", remedy="Give path or ax; save the figure of ax")
        return _draw_on_axes(ax, scene, water, outlines, date)
    if path is not None:
        style.check_format(path)
    figure = _draw_figure(scene, water, outlines, dates, _title(run, scene, title), dpi)
    return figure if path is None else style.save_figure(figure, path)


@style.saved_or_shown
def draw_tracks(run: xr.Dataset, *, title: str = "", projection: Projection = "auto", dpi: int = 150) -> Figure:
    """Draw the tracks of bergs and fragments on one map, with the ice at the first and the last date.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or from `Model.run`.
    path : path, optional
        Picture to write; the ending decides on the format.
    title : str, optional
        First line of the title; by default the experiment.
    projection : {"auto", "polar", "degrees"}, optional
        As in `draw_map`.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path or matplotlib.figure.Figure
        The picture if ``path`` is given, else the figure.
    """
    required(run, xr.Dataset, "a run, as Model.run or riftberg.open_run return it", where="draw_tracks")
    scene, water = project_run(run, projection)
    figure = style.new_figure(7.0, 8.4, dpi)
    overview = Overview(figure.subplots(), scene, water, OVERVIEW)
    depth_bar(overview.panel)
    style.legend_below(figure, overview.handles("dates"), columns=2)
    style.put_title(figure, _title(run, scene, title))
    style.lay_out(figure)
    overview.draw(telling_records(scene, 6))
    return figure


def _title(run: xr.Dataset, scene: Scene, title: str) -> str:
    """Return a title that names the run, its dates, its forcing and its melt."""
    first = title or run_heading(run, "Iceberg drift")
    second = str(run.attrs.get("forcing_title", "")).strip()
    more = "".join(f"\n{line.rstrip('.')}" for line in [*title_lines(scene.stays), *melt_lines(run)[:1]])
    return f"{first}, {style.span_text(scene.times)}" + (f"\nForcing: {second}" if second else "") + more


def _draw_figure(scene: Scene, water: Water | None, observed: Outlines, dates: int, title: str, dpi: int) -> Figure:
    """Draw the overview on the left, or above where it is wide, and beside it the berg at some dates."""
    shape = max(OVERVIEW, min(scene.shape(MARGIN), WIDEST))
    records = telling_records(scene, dates)
    wide = shape > WIDE
    if wide:
        columns = max(4, len(records))
        heights = 13.5 / shape + 1.8, 13.5 / columns + 1.4
        figure = style.new_figure(15.5, sum(heights), dpi)
        subfigures: Any = figure.subfigures(2, 1, height_ratios=heights)
    else:
        shape, columns = min(shape, UPRIGHT), (len(records) + 1) // 2
        figure = style.new_figure(15.5, 7.8, dpi)
        subfigures = figure.subfigures(1, 2, width_ratios=(0.4, 0.6))
    overview = Overview(subfigures[0].subplots(), scene, water, shape, observed)
    depth_bar(overview.panel)
    style.legend_below(subfigures[0], overview.handles("dates of the panels"), columns=6 if wide else 2)
    style.put_title(figure, title, size=11.0)
    panel_axes = list(subfigures[1].subplots(1 if wide else 2, columns, squeeze=False).flat)
    for unused in panel_axes[len(records) :]:
        unused.remove()
    panel_axes = panel_axes[: len(records)]
    panels = make_panels(panel_axes, scene, water, records, margin=0.08)
    # One scale of speed for all dates, so that they can be compared.
    top, flows = speed_scale(panels, records)
    style.letters([overview.ax, *panel_axes])
    style.outer_names(panel_axes, columns)
    if flows:
        speed_bar(panel_axes, top)
    # The colours of fragments tell several pieces apart; those of a single one are free for its loss of ice.
    lost = thickness_lost(scene) if len(scene.numbers) == 1 and melts(scene.run) else None
    scale = None if lost is None else melt_bar(panel_axes, 0.0, float(np.nanmax(lost[records], initial=0.0)))
    style.lay_out(figure)
    # Only now, for labels find their places by where the axes came to lie.
    overview.draw(records)
    for k, (panel, record) in enumerate(zip(panels, records, strict=True)):
        rings = observed.get(str(scene.times[record])[:10], ())
        melted = None if lost is None or scale is None else (lost[record], scale)
        quiver = panel.draw_date(record, top, overview.colours, rings, arrows=9, depths=False, melted=melted)
        if quiver is not None and flows and k == 0:
            arrow_key(quiver, top)
    return figure


def _draw_on_axes(ax: Axes, scene: Scene, water: Water | None, observed: Outlines, date: Any) -> Axes:
    """Draw the tracks, or the berg at a date, into axes of the user's."""
    if not hasattr(ax, "get_position"):
        raise InputError(
            f"{type(ax).__name__} is no axes of matplotlib",
            where="draw_map",
            remedy="Give one of them, such as axes[0]",
        )
    if getattr(ax, "name", "rectilinear") != "rectilinear":
        raise InputError(
            f"axes of the projection {ax.name!r}",
            where="draw_map",
            remedy="Give plain axes; x and y are those of the run",
        )
    # As the user laid them out, before an equal aspect shrank them.
    frame = ax.get_position(original=True)
    shape = float(ax.figure.bbox.width * frame.width / (ax.figure.bbox.height * frame.height))
    if date is None:
        Overview(ax, scene, water, shape, observed).draw(telling_records(scene, 6))
        return ax
    record = nearest_record(scene, np.datetime64(date))
    (box,) = common_boxes(scene, [record])
    panel = Panel(ax, scene, widen_box(box, scene.latlon, shape), water, labels=True)
    (top, flows), palette = speed_scale([panel], [record]), fragment_colours(scene)
    quiver = panel.draw_date(record, top, palette, observed.get(str(scene.times[record])[:10], ()), depths=False)
    if quiver is not None and flows:
        arrow_key(quiver, top)
    ax.set_title(style.moment_text(scene.times, scene.times[record], year=True), fontsize=10, pad=4, loc="left")
    for number, colour in palette.items():
        if (scene.berg[record] == number).any():
            ax.plot([], [], "s", color=colour, mec="black", mew=0.5, label=fragment_name(scene, number))
    return ax


class Overview:
    """The drift of the berg on given axes: tracks, first and last position, break-ups and the sea floor."""

    def __init__(
        self, ax: Axes, scene: Scene, water: Water | None, shape: float, observed: Outlines | None = None
    ) -> None:
        self.ax, self.scene, self.observed = ax, scene, observed or {}
        self.colours = fragment_colours(scene)
        box = widen_box(scene.box(), scene.latlon, shape, margin=MARGIN)
        self.panel = Panel(ax, scene, box, water, ticks=6, labels=True)
        self.panel.draw_ground(shaded=True)

    def draw(self, records: list[int]) -> None:
        """Draw ice, tracks and labels, once the axes have their place; the records are marked on the track."""
        # The first position lies pale below the last, for both may overlap.
        self.panel.draw_ice(records[0], self.colours, alpha=0.35, zorder=2.6)
        self.panel.draw_ice(records[-1], self.colours, zorder=2.8)
        labels = style.Labels(self.ax)
        for touch in self.touches():
            self.ax.plot(*touch, "v", ms=9, mfc=colours.GROUND, mec="black", mew=0.8, zorder=9)
            labels.avoid(*touch, 6.0)
        ends = {}
        for number in self.colours:
            x, y, _ = self.scene.track(number)
            ends[number] = float(x[-1]), float(y[-1])
            if self.scene.birth(number) is not None:
                self.ax.plot(x[0], y[0], "*", ms=13, mfc=self.colours[number], mec="black", zorder=9)
                labels.avoid(x[0], y[0], 8.0)
        # Smaller pieces first, so that the track of the largest lies on top.
        for number in reversed(list(self.colours)):
            self._draw_track(number, labels)
        self.panel.draw_place(*self._covered(records), labels)
        self._draw_dates(labels, records)
        for position in ends.values():
            labels.prefer_off(
                *position, points=10.0
            )  # a name beside the end of another track would be taken for its name
        for number, position in ends.items():
            if len(ends) > 1:
                labels.put(self.scene.name(number), *position, fontsize=8, style="italic")
        self.panel.draw_scale()

    def _draw_track(self, number: int, labels: style.Labels) -> None:
        from matplotlib.patheffects import Normal, withStroke

        x, y = self.scene.track_line(number)
        self.ax.plot(x, y, color=self.colours[number], lw=2.0, zorder=7, label=fragment_name(self.scene, number),
                     path_effects=[withStroke(linewidth=3.6, foreground="black"), Normal()])  # fmt: skip
        labels.prefer_off_line(x, y)

    def _draw_dates(self, labels: style.Labels, records: list[int]) -> None:
        """Mark and label the chosen dates on the track of the largest fragment, before its birth on that of its parent."""
        largest = self.scene.numbers[0]
        positions = []
        for record in records:
            x, y, track_records = self.scene.track(self.scene.ancestor(largest, record))
            # A track may miss this very record: the nearest one stands for it.
            row = int(np.argmin(np.abs(track_records - record)))
            positions.append((float(x[row]), float(y[row])))
        self.ax.plot(*zip(*positions, strict=True), "o", ms=6.5, mfc="white", mec="black", mew=1.3, zorder=8)
        for position in positions:
            labels.avoid(*position)
        # Of dates at which the berg was in about the same place the first is labelled, and the last.
        order = [0, len(positions) - 1, *range(1, len(positions) - 1)]
        texts = style.moment_texts(self.scene.times, records, hour=False)
        labelled: list[tuple[float, float]] = []
        for k in order:
            if all(labels.apart(positions[k], other) > NEAR for other in labelled):
                labels.put(texts[k], *positions[k], fontsize=9, fontweight="bold")
                labelled.append(positions[k])

    def _covered(self, records: list[int]) -> tuple[Floats, Floats]:
        """Return points that the view of the Earth should leave free: corners of the ice that is drawn, and tracks."""
        corners = [self.scene.polygons(records[k]).reshape(-1, 2) for k in (0, -1)]
        tracks = [np.stack(self.scene.track(number)[:2], axis=-1) for number in self.colours]
        x, y = np.concatenate([*corners, *tracks]).T
        return x, y

    def touches(self) -> list[tuple[float, float]]:
        """Return where bergs and fragments touched the sea floor, on the map."""
        rows = [stay.event for stay in self.scene.stays]
        x, y = self.panel.placed(np.array([row.lon for row in rows]), np.array([row.lat for row in rows]))
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def handles(self, marks: str) -> list[Any]:
        """Return the entries of fragments and signs in a legend."""
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        handles: list[Any] = list(fragment_patches(self.scene))
        if not np.isin(self.scene.berg[[0, -1]], [0, *self.colours]).all():
            handles.append(Patch(fc=colours.SMALL, ec="black", lw=0.5, label="smaller bergs and pieces"))
        broke = any(self.scene.birth(n) for n in self.colours)
        track = f"track (with gaps at break-ups) and {marks}" if broke else f"track and {marks}"
        handles.append(Line2D([], [], color="black", marker="o", mfc="white", lw=2, label=track))
        if broke:
            handles.append(
                Line2D([], [], ls="", marker="*", ms=11, mfc="white", mec="black", label="where it broke off")
            )
        if self.scene.stays:
            handles.append(
                Line2D(
                    [],
                    [],
                    ls="",
                    marker="v",
                    ms=8,
                    mfc=colours.GROUND,
                    mec="black",
                    label="where it touched the sea floor",
                )
            )
        handles += [
            Patch(fc=colour, ec=colours.SHORE, lw=0.8, label=name)
            for colour, name in ((colours.LAND, "land"), (colours.SHELF, "ice shelf")) if colour in self.panel.coast
        ]  # fmt: skip
        handles += self.panel.ground_patches()
        if self.panel.seams:
            handles.append(Line2D([], [], label="edge of the periodic channel", **SEAM))
        if self.observed:
            handles.append(Line2D([], [], color=colours.OBSERVED, lw=1.1, label="observed outline"))
        return handles
