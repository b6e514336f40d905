"""Figures of a run: the berg at chosen dates beside observations, bond stress, and the life of its fragments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.diagnostics.summary import melt_lines
from riftberg.errors import InputError
from riftberg.runs.layout import run_heading
from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.panels import (
    NO_FLOOR,
    Panel,
    Projection,
    Water,
    arrow_key,
    common_boxes,
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
from riftberg.viz.style import date_axis, day_text, is_short, moment_texts, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO day to rings of shape (n, 2), longitude and latitude."""

IMPACT = 0.1
"""A break came by an impact where no bond had this part of the strength at the record before."""

WHILE_IT_CRACKS = "off the scale: the last bonds of a crack bear its load"

CRACK = 1.3
"""Largest stress of the scale, as a part of the strength; the figure says where stresses go beyond."""


def figure_title(run: xr.Dataset, subject: str, records: Sequence[int] = ()) -> str:
    """Return the title of a figure, with the years of the records that it shows; its second line names the forcing."""
    note, times = str(run.attrs.get("forcing_title", "")).strip(), run["time"].values
    years = [] if is_short(times) else sorted({str(times[record])[:4] for record in records})
    dated = ", ".join([subject, *([" to ".join(dict.fromkeys([years[0], years[-1]]))] if years else [])])
    return f"{run_heading(run)}: {dated}" + (f"\nForcing: {note}" if note else "")


def choose_records(scene: Scene, dates: Sequence[np.datetime64] | None, most: int = 6) -> list[int]:
    """Return the records of dates; by default the start, the large break-ups and evenly spaced days."""
    if dates:
        return sorted({nearest_record(scene, date) for date in dates})
    return telling_records(scene, most)


def draw_dates(
    run: xr.Dataset,
    path: str | Path,
    *,
    dates: Sequence[np.datetime64] | None = None,
    observed: Outlines | None = None,
    projection: Projection = "auto",
    dpi: int = 150,
) -> Path:
    """Draw the berg at chosen dates in the currents of these dates, with the outlines observed on these days.

    With outlines, a first panel shows the observations alone, as figure 1 of Huth et al. (2022); the others are as its
    figure 2.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or from `Model.run`.
    path : path
        Picture; the ending decides on the format.
    dates : sequence of numpy.datetime64, optional
        By default the start, the large break-ups and evenly spaced days.
    observed : mapping, optional
        Observed outlines by ISO day.
    projection : {"auto", "polar", "degrees"}, optional
        As in `riftberg.draw_map`.
    dpi : int, optional
        Resolution.
    """
    from matplotlib.lines import Line2D

    scene, water = project_run(run, projection)
    records = choose_records(scene, dates)
    days = [str(scene.times[record])[:10] for record in records]
    seen = {day: observed[day] for day in days if observed and day in observed}
    count = len(records) + bool(seen)
    columns = count if count <= 4 else math.ceil(count / 2)
    rows = math.ceil(count / columns)
    figure = new_figure(4.3 * columns + 0.6, 4.3 * rows + 1.8, dpi)
    panel_axes = [figure.add_subplot(rows, columns, k + 1) for k in range(count)]
    panels = make_panels(panel_axes[bool(seen) :], scene, water, records)
    top, flows = speed_scale(panels, records)
    style.letters(panel_axes)
    style.outer_names(panel_axes, columns)
    palette = fragment_colours(scene)
    handles: list[Any] = [
        *fragment_patches(scene),
        *next(filter(None, (panel.ground_patches() for panel in panels)), []),
    ]
    if seen:
        handles.append(Line2D([], [], color=colours.OBSERVED, lw=1.4, label="observed outline of the day"))
    figure.legend(handles=handles, fontsize=8, loc="outside lower left", ncols=columns, frameon=False)
    if flows:
        speed_bar(panel_axes, top)
    subject = "model and observed outlines" if seen else "position and shape"
    style.put_title(figure, figure_title(run, subject, records))
    if seen:
        _observed_panel(
            panel_axes[0], scene, [r for r, day in zip(records, days, strict=True) if day in seen], seen, water, top
        )
    style.lay_out(figure)
    for k, (panel, record, day) in enumerate(zip(panels, records, days, strict=True)):
        quiver = panel.draw_date(record, top, palette, seen.get(day, ()), lw=1.4)
        if quiver is not None and flows and k == 0:
            arrow_key(quiver, top)
    return style.save_figure(figure, path)


def _observed_panel(
    ax: Axes, scene: Scene, records: Sequence[int], seen: Outlines, water: Water | None, top: float
) -> None:
    """Draw all outlines over the currents of the middle one of their records."""
    x, y = scene.placed(*np.concatenate([ring for day in seen.values() for ring in day]).T)
    box = Box(float(x.min()), float(x.max()), float(y.min()), float(y.max()))
    panel = Panel(ax, scene, widen_box(box, scene.latlon, 1.0, margin=0.06), water)
    middle = records[len(records) // 2]
    panel.draw_currents(middle, top, arrows=15)
    panel.draw_ground()
    for k, (day, drawn) in enumerate(seen.items()):
        colour = colours.OBSERVED_DAYS[k % len(colours.OBSERVED_DAYS)]
        panel.draw_outlines(drawn, color=colour, lw=1.6)
        ax.plot([], [], color=colour, lw=1.6, label=day_text(np.datetime64(day), hour=False))
    panel.draw_scale()
    ax.legend(fontsize=7, loc="upper right", framealpha=0.85, handlelength=1.2)
    ax.set_title(f"Observed; currents of {day_text(scene.times[middle], hour=False)}", fontsize=10, pad=4)


@style.saved_or_shown
def draw_stress(
    run: xr.Dataset, *, dates: Sequence[np.datetime64] | None = None, projection: Projection = "auto", dpi: int = 150
) -> Figure:
    """Draw the bonds in the colour of their tensile stress; by default just before the large break-ups.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or from `Model.run`.
    path : path, optional
        Picture to write; the ending decides on the format.
    dates : sequence of numpy.datetime64, optional
        Dates of the panels.
    projection : {"auto", "polar", "degrees"}, optional
        As in `riftberg.draw_map`.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path or matplotlib.figure.Figure
        The picture if ``path`` is given, else the figure.
    """
    scene, water = project_run(run, projection)
    if not run.sizes["bond"]:
        raise InputError("the run has no bonds, so no stress in them", where="stress", remedy="Draw another kind")
    records = choose_records(scene, dates) if dates else _before_breakups(scene)
    fracture = scene.parameters.fracture
    stress = scene.bonds.tension()
    name, unit = stress_unit(max(float(np.nanmax(stress[r], initial=0.0)) for r in records))
    tension = {r: stress[r] / unit for r in records}
    top = max(1.0 / unit, *(float(np.nanmax(values, initial=0.0)) for values in tension.values()))
    strength = scene.bonds.strength / unit
    beyond = fracture.enabled and top >= strength
    text = f"; strength {scene.bonds.strength / 1e3:.4g} kPa" if fracture.enabled else ""
    return _bond_maps(
        scene, water, tension, shades=colours.stress_map(), top=strength if beyond else top, beyond=beyond,
        label=f"largest tensile stress at a bond ({name}){text}{_line_name(scene, records)}", subject="stress in the bonds",
        dpi=dpi,
    )  # fmt: skip


@style.saved_or_shown
def draw_damage(
    run: xr.Dataset, *, dates: Sequence[np.datetime64] | None = None, projection: Projection = "auto", dpi: int = 150
) -> Figure:
    """Draw the bonds in the colour of their damage; by default just before the large break-ups and at the end.

    Parameters
    ----------
    run, path, dates, projection, dpi
        As in `draw_dates`.
    """
    scene, water = project_run(run, projection)
    damage = scene.bonds.damage()
    if damage is None:
        raise InputError("the run has no damage", where="damage", remedy="Run with --set damage.enabled=true")
    records = choose_records(scene, dates) if dates else sorted({*_before_breakups(scene), len(scene.times) - 1})
    values = {r: damage[r] for r in records}
    top = max(0.01, *(float(np.nanmax(of_record, initial=0.0)) for of_record in values.values()))
    return _bond_maps(
        scene, water, values, shades=colours.damage_map(), top=top, label=f"damage of a bond{_line_name(scene, values)}",
        subject="damage of the bonds", dpi=dpi,
    )  # fmt: skip


def _bond_maps(
    scene: Scene, water: Water | None, values: Mapping[int, Floats], *, shades: Colormap, top: float, label: str,
    subject: str, dpi: int, beyond: bool = False,
) -> Figure:  # fmt: skip
    """Draw the bonds at each record in the colour of their values, with a scale up to ``top`` below, open if ``beyond``."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm
    from matplotlib.ticker import FixedLocator, FuncFormatter

    figure, records = new_figure(5.2 * len(values) + 0.8, 6.6, dpi), list(values)
    axes = list(figure.subplots(1, len(values), squeeze=False).flat)
    panels = make_panels(axes, scene, water, records, margin=0.05, largest=1.1, texts=_spans(scene, records))
    style.letters(axes)
    style.outer_names(axes, len(axes))
    # By the square root: a berg at rest has a tenth of its strength, and few bonds have most of the damage.
    scale = PowerNorm(0.5, 0.0, top)
    ground = [f"; hatched: {patch.get_label()}" for panel in panels for patch in panel.ground_patches()][:1]
    text = f"{label}{''.join(ground)}; square-root scale"
    lines = style.wrap_text(text, figure.get_figwidth() - 0.8, size=9)
    bar = style.colour_bar(
        axes,
        ScalarMappable(scale, shades),
        "\n".join(lines),
        shrink=0.8,
        aspect=50,
        extend="max" if beyond else "neither",
    )
    small, large = style.round_length(top / 16.0), style.round_length(top / 2.5)
    bar.ax.xaxis.set_major_locator(FixedLocator([0.0, small, *np.arange(large, top * (1.0 + 1e-9), large)]))
    bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.3g}" if v < 1e3 else f"{v:,.0f}"))
    bar.ax.xaxis.set_minor_locator(FixedLocator([]))
    style.put_title(figure, figure_title(scene.run, subject, records))
    style.lay_out(figure)
    for panel, record in zip(panels, records, strict=True):
        panel.draw_ground()
        panel.draw_bonds(record, values[record], shades, scale)
        panel.draw_scale()
    return figure


def _spans(scene: Scene, records: Sequence[int]) -> list[str]:
    """Return the dates of records and of the break-ups beside them: the values are the largest since the record before."""
    births = [birth[0] for n in scene.numbers if (birth := scene.birth(n)) is not None]
    texts = []
    for record in records:
        previous, following = (scene.times[min(max(record + k, 0), len(scene.times) - 1)] for k in (-1, 1))
        record_time = scene.times[record]
        broke = next((birth for birth in births if previous < birth <= following), None)
        when = [previous, record_time] if broke is not None and broke <= record_time else [record_time]
        text = " to ".join(moment_texts(scene.times, [int(np.searchsorted(scene.times, date)) for date in when]))
        break_text = "" if broke is None else f"; breaks {style.moment_text(scene.times, broke)}"
        texts.append(text + break_text)
    return texts


def _line_name(scene: Scene, records: Iterable[int]) -> str:
    """Return the name of the black lines: cracks where the run knows lines, else broken bonds; nothing where none broke."""
    if all(scene.bonds.unbroken[record].all() for record in records):
        return ""
    return "; black: cracks" if scene.crack_lines(0) else "; black: broken bonds"


def stress_unit(top: float) -> tuple[str, float]:
    """Return the unit of a scale of stress up to ``top`` (Pa), and its size in Pa."""
    return ("MPa", 1e6) if top >= 1e7 else ("Pa", 1.0) if top < 100.0 else ("kPa", 1e3)


def _before_breakups(scene: Scene) -> list[int]:
    """Return the last records before the large break-ups; without any, the record of the largest stress.

    A berg that breaks on impact bears nothing at the record before: then it is the record after, whose largest stress is
    that since the one before.
    """
    births = sorted(birth[0] for n in scene.numbers if (birth := scene.birth(n)) is not None)
    records = {max(0, int(np.searchsorted(scene.times, birth)) - 1) for birth in births[:4]}
    stress = scene.bonds.tension().max(axis=1, initial=0.0)
    if not records:
        return [int(np.argmax(stress))]
    calm = IMPACT * scene.bonds.strength
    last = len(stress) - 1
    return sorted({r + 1 if r < last and stress[r] < calm <= stress[r + 1] else r for r in records})


@style.saved_or_shown
def draw_melt(
    run: xr.Dataset, *, date: np.datetime64 | None = None, projection: Projection = "auto", dpi: int = 150
) -> Figure:
    """Draw the melt: the ice in the colour of the thickness that it has lost, and the melt water by process over time.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or from `Model.run`; of a model with ``melt``.
    path : path, optional
        Picture to write; the ending decides on the format.
    date : numpy.datetime64, optional
        Date of the map; by default the end.
    projection : {"auto", "polar", "degrees"}, optional
        As in `riftberg.draw_map`.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path or matplotlib.figure.Figure
        The picture if ``path`` is given, else the figure.
    """
    scene, water = project_run(run, projection)
    if not melts(run):
        raise InputError("nothing melts in this run", where="melt", remedy="Run with --set melt.enabled=true")
    record = len(scene.times) - 1 if date is None else nearest_record(scene, date)
    lost = thickness_lost(scene)[record]
    figure = new_figure(12.0, 6.4, dpi)
    ax, curves = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    (box,) = common_boxes(scene, [record], margin=0.05)
    panel = Panel(ax, scene, box, water, labels=not scene.latlon)
    low, top = float(np.nanmin(lost, initial=np.inf)), float(np.nanmax(lost, initial=0.0))
    # The pattern shows where all lose about the same.
    scale = melt_bar([ax], low if 0.5 * top < low < 0.99 * top else 0.0, top)
    ax.set_title(moment_texts(scene.times, [record])[0], fontsize=10, pad=4)
    # The melt water by process, one upon the other, so that the upper edge is all of it.
    melted = scene.run["melt_water"].transpose("process", "time") / 1e12
    names = [str(name) for name in melted["process"].values]
    processes = [k for k in range(len(names)) if float(melted[k, -1]) > 0.0]
    times: Any = scene.times
    stacked = curves.stackplot(
        times, *(melted[k].values for k in processes), colors=[colours.FRAGMENTS[k] for k in processes], alpha=0.8
    )
    for area, k in zip(stacked, processes, strict=True):
        area.set_label(f"{names[k].replace('_', ' ')}: {float(melted[k, -1]):.3g} Gt")
    style.plain_axes(curves)
    date_axis(curves)
    curves.set_ylim(bottom=0.0)
    curves.set_ylabel("melt water since the start (Gt)", fontsize=9)
    curves.legend(fontsize=8, loc="upper left", frameon=False, reverse=True)
    style.letters([ax, curves])
    style.put_title(figure, "\n".join([figure_title(run, "thickness lost, melt water"), *melt_lines(run)[:1]]))
    style.lay_out(figure)
    panel.draw_ground()
    panel.draw_values(record, lost, colours.melt_map(), scale)
    panel.draw_scale()
    return figure


@style.saved_or_shown
def draw_fragments(run: xr.Dataset, *, dpi: int = 150) -> Figure:
    """Draw areas and births of the fragments, the largest tensile stress and the ice aground, over time.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or from `Model.run`.
    path : path, optional
        Picture to write; the ending decides on the format.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path or matplotlib.figure.Figure
        The picture if ``path`` is given, else the figure.
    """
    scene = Scene(run)
    figure = new_figure(11.0, 7.4, dpi)
    ground = scene.aground().sum(axis=1) if knows_floor(scene) else np.zeros(len(scene.times))
    bonded = run.sizes["bond"] > 0
    heights = [3.0 if len(scene.numbers) > 1 else 1.2, *([1.6] if bonded else []), *([1.0] if ground.any() else [])]
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    length, lower = style.run_length(scene.times), axes[-1]
    times: Any = scene.times
    if is_short(scene.times):
        unit, seconds, _ = next(unit for unit in style.UNITS if length <= unit[2])
        times = (scene.seconds - scene.seconds[0]) / seconds
        lower.set_xlabel(f"time since the start ({unit})")
    else:
        date_axis(lower)
    _areas(axes[0], scene, times)
    if bonded:
        _peak_stress(axes[1], scene, times)
    if ground.any():
        lower.fill_between(times, ground, step="post", color=colours.GROUND, alpha=0.6, lw=0.0)
        lower.set_ylabel("elements\naground", fontsize=9)
        lower.yaxis.get_major_locator().set_params(integer=True)
        lower.set_ylim(0.0, 1.15 * float(ground.max()))
    for ax in axes:
        style.plain_axes(ax)
    style.letters(list(axes))
    if len(times) > 1:
        lower.set_xlim(times[0], times[-1])
    style.put_title(figure, figure_title(run, "fragments"))
    return figure


def knows_floor(scene: Scene) -> bool:
    """Return whether the run has a sea floor: a depth of 0 everywhere, with the sea level on top, is none."""
    depth = scene.run["depth"].values
    return bool(np.nanmax(depth, initial=0.0) > min(scene.draft(), NO_FLOOR))


def _areas(ax: Axes, scene: Scene, times: Any) -> None:
    """Draw the area of each named fragment; a break-up is a step of the parent and a dot where the fragment begins."""
    unit = 1e6 if float(scene.area.sum()) >= 1e4 else 1.0
    for rank, (number, colour) in enumerate(fragment_colours(scene).items()):
        area = np.where(scene.berg == number, scene.areas, 0.0).sum(axis=1) / unit
        exists = area > 0.0
        # Lower ranks are thinner by more than a point: else the second of two equal bergs would hide the first.
        ax.step(times[exists], area[exists], where="post", color=colour, lw=max(1.4, 4.8 - 1.2 * rank),
                label=fragment_name(scene, number))  # fmt: skip
        if scene.birth(number) is not None and exists.any():
            ax.axvline(times[exists][0], color=colours.PAIRING, lw=0.8, ls=":")
            ax.plot(times[exists][0], area[exists][0], "o", color=colour, mec="black", ms=7, zorder=5)
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("area (km²)" if unit == 1e6 else "area (m²)", fontsize=9)
    style.legend_above(ax, ncols=2)


def _peak_stress(ax: Axes, scene: Scene, times: Any) -> None:
    """Draw the largest tension between records and, thinner, at them: the difference is ringing and impact."""
    peak = scene.bonds.tension().max(axis=1, initial=0.0) / 1e3
    ax.plot(times, peak, color=colours.STRESS_LINE, lw=1.3, label="largest between outputs")
    if "peak_stress" in scene.run:
        stress = np.where(scene.bonds.unbroken, scene.run["normal_stress"].transpose("time", "bond").values, 0.0)
        at_records = stress.max(axis=1, initial=0.0) / 1e3
        ax.plot(times, at_records, color=colours.STRENGTH, lw=0.8, label="at the outputs")
    if scene.parameters.fracture.enabled:
        strength = scene.bonds.strength / 1e3
        ax.axhline(strength, color=colours.STRENGTH, ls="--", lw=1.0)
        ax.text(0.005, strength, "strength", fontsize=8, va="bottom", transform=ax.get_yaxis_transform())
    lowest = scene.bonds.lowest_strength()
    if lowest is not None:
        ax.plot(times, lowest / 1e3, color=colours.DAMAGE_LINE, ls="--", lw=1.2, label="lowest strength left by damage")
    ax.set_ylim(bottom=0.0)  # after all lines: they set the upper end
    if scene.parameters.fracture.enabled:
        _cut_off_cracks(ax, times, peak, CRACK * scene.bonds.strength / 1e3)
    style.legend_above(ax, ncols=3)
    ax.set_ylabel("largest tensile\nstress (kPa)", fontsize=9)


def _cut_off_cracks(ax: Axes, times: Any, peak: Any, highest: float) -> None:
    """End the scale at a stress (kPa) and say so: the last bonds of a crack bear all of its load for a moment."""
    beyond = peak > highest
    if not beyond.any():
        return
    ax.set_ylim(top=highest)
    starts = np.flatnonzero(beyond & ~np.concatenate([[False], beyond[:-1]]))
    ends = np.flatnonzero(beyond & ~np.concatenate([beyond[1:], [False]])) + 1
    for begin, end in zip(starts, ends, strict=True):
        k = begin + int(np.argmax(peak[begin:end]))
        late = k > 0.7 * len(times)  # the words would leave the picture
        ax.annotate(
            WHILE_IT_CRACKS, (times[k], highest), (-4 if late else 4, -3), textcoords="offset points",
            fontsize=7, va="top", ha="right" if late else "left", color=colours.STRESS_LINE,
        )  # fmt: skip
