"""Figures of a run: the berg at chosen dates beside what was observed, bond stress, and the life of its fragments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.errors import InputError
from riftberg.runs.background import water_of
from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.floor import NO_FLOOR
from riftberg.viz.moments import day_text, is_short, length_of, moment_texts
from riftberg.viz.panels import (
    Panel,
    Water,
    arrow_key,
    common_boxes,
    fragment_colours,
    fragment_name,
    nearest_record,
    root_scale,
    speed_bar,
    speed_top,
    widened,
)
from riftberg.viz.style import date_axis, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO day to rings of shape (n, 2), longitude and latitude."""

IMPACT = 0.1
"""A break came by an impact where no bond had this part of the strength at the record before."""

CRACK = 2.0
"""Largest stress of the scale, as a part of the strength; what is beyond is written."""


def figure_title(run: xr.Dataset, what: str) -> str:
    """Return the title of a figure; its second line says what the forcing is."""
    name = str(run.attrs.get("experiment") or "Iceberg")
    note = str(run.attrs.get("forcing_title", "")).strip()
    return f"{name}: {what}" + (f"\nForcing: {note}" if note else "")


def chosen(scene: Scene, dates: Sequence[np.datetime64] | None, most: int = 6) -> list[int]:
    """Return the records of dates; by default the start, the large break-ups and evenly spaced days."""
    if dates:
        return sorted({nearest_record(scene, date) for date in dates})
    return scene.telling_records(most)


def draw_dates(
    run: xr.Dataset,
    path: str | Path,
    *,
    dates: Sequence[np.datetime64] | None = None,
    observed: Outlines | None = None,
    water: Water | None = None,
    dpi: int = 150,
) -> Path:
    """Draw the berg at chosen dates in the currents of these dates, with the outlines observed on these days.

    With outlines, a first panel shows what was observed alone, as figure 1 of Huth et al. (2022); the others are as its
    figure 2.
    """
    scene, observed = Scene(run), observed or {}
    water = water or water_of(run)
    records = chosen(scene, dates)
    shown = {day: observed[day] for r in records if (day := str(scene.times[r])[:10]) in observed}
    count = len(records) + bool(shown)
    columns = min(4, count) if count <= 4 else math.ceil(count / 2)
    rows = math.ceil(count / columns)
    # The legend takes a line for each column's width of fragments.
    entries = math.ceil((len(fragment_colours(scene)) + bool(shown)) / columns)
    named = 0.0 if scene.latlon else 0.2  # axes in metres say what they are
    figure = new_figure((4.1 + named) * columns + 0.8, (4.05 + named) * rows + 1.8 + 0.17 * entries, dpi)
    places = [figure.add_subplot(rows, columns, k + 1) for k in range(count)]
    boxes = common_boxes(scene, records)
    panels = [
        Panel(ax, scene, box, water, labels=not scene.latlon)
        for ax, box in zip(places[bool(shown) :], boxes, strict=True)
    ]
    top = speed_top(panels, records)
    texts = moment_texts(scene.times, records)
    arrows = [_date_panel(*each, top, shown) for each in zip(panels, records, texts, strict=True)]
    if shown:
        _observed_panel(places[0], scene, records, shown, water, top)
    for k, ax in enumerate(places):
        if count > 1:
            style.letter(ax, k)
    style.outer_names(places, columns)
    flowing = top if any(p.fastest(record) for p, record in zip(panels, records, strict=True)) else 0.0
    below = _legend(figure, scene, bool(shown), flowing, next((a for a in arrows if a is not None), None))
    height = figure.get_figheight()
    title = figure_title(run, "model and observed outlines" if shown else "position and shape")
    left, right = (0.7 + named) / figure.get_figwidth(), 1.0 - 0.25 / figure.get_figwidth()
    above = 0.4 + style.put_title(figure, title)
    figure.subplots_adjust(
        left=left, right=right, top=1.0 - above / height, bottom=(below + named) / height, wspace=0.22 + 0.3 * named,
        hspace=0.14 + 0.3 * named,
    )  # fmt: skip
    style.save_figure(figure, path)
    return Path(path)


def _date_panel(panel: Panel, record: int, text: str, top: float, shown: Outlines) -> Any:
    scene = panel.scene
    quiver = panel.draw_currents(record, top)
    panel.draw_floor(shaded=quiver is None)
    panel.draw_ice(record, fragment_colours(scene))
    panel.draw_outlines(shown.get(str(scene.times[record])[:10], ()), lw=1.4)
    panel.draw_scale()
    panel.ax.set_title(text, fontsize=10, pad=4)
    return quiver


def _observed_panel(
    ax: Axes, scene: Scene, records: Sequence[int], shown: Outlines, water: Water | None, top: float
) -> None:
    """Draw all outlines over the currents of the one in the middle of their days."""
    rings = np.concatenate([ring for day in shown.values() for ring in day])
    west, east, south, north = (f(rings[:, k]) for k in (0, 1) for f in (np.min, np.max))
    around = Box(float(west), float(east), float(south), float(north))
    box = widened(scene.grown(around, 0.06), scene, 1.0)
    panel = Panel(ax, scene, box, water)
    seen = [record for record in records if str(scene.times[record])[:10] in shown]
    middle = seen[len(seen) // 2]
    panel.draw_currents(middle, top, arrows=15)
    panel.draw_floor()
    for k, (day, drawn) in enumerate(shown.items()):
        colour = colours.OBSERVED_DAYS[k % len(colours.OBSERVED_DAYS)]
        panel.draw_outlines(drawn, color=colour, lw=1.6)
        ax.plot([], [], color=colour, lw=1.6, label=day_text(np.datetime64(day), hour=False))
    panel.draw_scale()
    ax.legend(fontsize=7, loc="upper right", framealpha=0.85, handlelength=1.2)
    ax.set_title(f"Observed; currents of {day_text(scene.times[middle], hour=False)}", fontsize=10, pad=4)


def _legend(figure: Figure, scene: Scene, observed: bool, top: float, arrows: Any = None) -> float:
    """Explain the fragments, and above that the colours and arrows of the current; return the height of all (inches)."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(fc=colour, ec="black", lw=0.5, label=fragment_name(scene, number))
        for number, colour in fragment_colours(scene).items()
    ]
    if observed:
        handles.append(Line2D([], [], color=colours.OBSERVED, lw=1.4, label="observed outline of the day"))
    width, height = figure.get_figwidth(), figure.get_figheight()
    columns = max(1, min(len(handles), int((width - 0.5) / 4.1)))
    high = 0.17 * math.ceil(len(handles) / columns) + 0.16
    figure.legend(
        handles=handles, fontsize=8, loc="lower left", bbox_to_anchor=(0.45 / width, 0.0), ncols=columns, frameon=False
    )
    if top > 0.0:
        long = min(4.2, width - 2.0)
        speed_bar(figure, (0.62 / width, (high + 0.4) / height, long / width, 0.1 / height), top)
        if arrows is not None:
            arrow_key(arrows, figure, (0.62 + long + 0.4) / width, (high + 0.45) / height, top)
        high += 0.5
    return high + 0.4


def draw_stress(
    run: xr.Dataset, path: str | Path, *, dates: Sequence[np.datetime64] | None = None, water: Water | None = None,
    dpi: int = 150,
) -> Path:  # fmt: skip
    """Draw the bonds in the colour of their tensile stress; by default just before the large break-ups.

    Parameters
    ----------
    run, path, dates, water, dpi
        As in `draw_dates`.
    """
    scene = Scene(run)
    if not run.sizes["bond"]:
        raise InputError("the run has no bonds, so no stress in them", where="stress", remedy="Draw another kind")
    records = chosen(scene, dates) if dates else _before_breakups(scene)
    fracture = scene.parameters.fracture
    stress = scene.tension()
    name, unit = stress_unit(max(float(np.nanmax(stress[r], initial=0.0)) for r in records))
    tension = {r: stress[r] / unit for r in records}
    top = max(1.0 / unit, *(float(np.nanmax(values, initial=0.0)) for values in tension.values()))
    strength = fracture.normal_strength / unit
    beyond = fracture.enabled and top >= strength
    text = f"; strength {fracture.normal_strength / 1e3:g} kPa" if fracture.enabled else ""
    title = figure_title(run, "stress in the bonds")
    figure = _bond_maps(
        scene, tension, colours.stress_map(), root_scale(strength if beyond else top),
        f"largest tensile stress of a bond ({name}){text}; dotted: broken", title, water=water or water_of(run),
        beyond=beyond, dpi=dpi,
    )  # fmt: skip
    style.save_figure(figure, path)
    return Path(path)


def draw_damage(
    run: xr.Dataset, path: str | Path, *, dates: Sequence[np.datetime64] | None = None, water: Water | None = None,
    dpi: int = 150,
) -> Path:  # fmt: skip
    """Draw the bonds in the colour of their damage; by default just before the large break-ups and at the end."""
    scene = Scene(run)
    damage = scene.bond_damage()
    if damage is None:
        raise InputError("the run has no damage", where="damage", remedy="Run with --set damage.enabled=true")
    records = chosen(scene, dates) if dates else sorted({*_before_breakups(scene), len(scene.times) - 1})
    shown = {r: damage[r] for r in records}
    top = max(0.01, *(float(np.nanmax(values, initial=0.0)) for values in shown.values()))
    figure = _bond_maps(
        scene, shown, colours.damage_map(), root_scale(top), "damage of a bond; dotted: broken",
        figure_title(run, "damage of the bonds"), water=water or water_of(run), dpi=dpi,
    )  # fmt: skip
    style.save_figure(figure, path)
    return Path(path)


def _bond_maps(
    scene: Scene,
    values: Mapping[int, Floats],
    shades: Colormap,
    scale: Normalize,
    label: str,
    title: str,
    *,
    dpi: int,
    water: Water | None = None,
    beyond: bool = False,
) -> Figure:
    """Draw the bonds at each record in the colour of their values, with a scale below; ``beyond`` marks its upper end as open."""
    width = 5.2 * len(values) + 0.8
    figure = new_figure(width, 6.4, dpi)
    above = style.put_title(figure, title)
    figure.set_size_inches(width, 6.0 + above)
    boxes = common_boxes(scene, list(values), margin=0.05)
    texts = moment_texts(scene.times, list(values))
    for k, (record, box, text) in enumerate(zip(values, boxes, texts, strict=True)):
        panel = Panel(figure.add_subplot(1, len(values), k + 1), scene, box, water, labels=not scene.latlon)
        points = 72.0 * 0.8 * 5.2 / 1e3 * scene.units_per_km() / (box.north - box.south)  # in a metre
        panel.draw_floor(shaded=True)
        panel.draw_bonds(record, values[record], shades, scale, points=np.maximum(0.6, points * _bond_widths(scene)))
        panel.draw_scale()
        panel.ax.set_title(text, fontsize=10, pad=4)
        if len(values) > 1:
            style.letter(panel.ax, k)
            style.outer_names(figure.axes, len(values))
    height = figure.get_figheight()
    figure.subplots_adjust(
        left=0.75 / width, right=1.0 - 0.12 / width, top=1.0 - (above + 0.4) / height, bottom=1.05 / height, wspace=0.2
    )
    style.put_title(figure, title)
    _bond_bar(figure, shades, scale, label, beyond)
    return figure


def _bond_widths(scene: Scene) -> Floats:
    """Return how wide each bond is drawn, m: those of hexagons cross at 60 degrees and are slimmer."""
    first = scene.run["first"].values
    return np.asarray(np.sqrt(scene.area[first]) * np.where(scene.sides[first] == 6, 0.34, 0.62))


def _bond_bar(figure: Figure, shades: Colormap, scale: Normalize, label: str, beyond: bool) -> None:
    """Draw the scale of the values of bonds; on a scale by the square root, a small tick beside the round ones."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.ticker import FixedLocator, FuncFormatter

    width, height = figure.get_size_inches()
    long = min(6.5, width - 1.6)
    place = figure.add_axes((0.5 - 0.5 * long / width, 0.52 / height, long / width, 0.11 / height))
    bar = figure.colorbar(
        ScalarMappable(scale, shades), cax=place, orientation="horizontal", extend="max" if beyond else "neither"
    )
    top = float(scale.vmax or 1.0)
    small, large = style.round_length(top / 16.0), style.round_length(top / 2.5)
    bar.ax.xaxis.set_major_locator(FixedLocator([0.0, small, *np.arange(large, top * (1.0 + 1e-9), large)]))
    bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.3g}" if v < 1e3 else f"{v:,.0f}"))
    bar.ax.xaxis.set_minor_locator(FixedLocator([]))
    bar.ax.tick_params(labelsize=8)
    bar.set_label(label, fontsize=9)


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
    stress = scene.tension().max(axis=1, initial=0.0)
    if not records:
        return [int(np.argmax(stress))]
    calm = IMPACT * scene.parameters.fracture.normal_strength
    last = len(stress) - 1
    return sorted({r + 1 if r < last and stress[r] < calm <= stress[r + 1] else r for r in records})


def draw_timeline(run: xr.Dataset, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw areas and births of the fragments, the largest tensile stress and what is aground, over time.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`.
    path : path
        Picture.
    dpi : int, optional
    """
    scene = Scene(run)
    figure = new_figure(11.0, 7.4, dpi)
    ground = scene.aground().sum(axis=1) if knows_floor(scene) else np.zeros(len(scene.times))
    bonded = run.sizes["bond"] > 0
    heights = [3.0, *([1.6] if bonded else []), *([1.0] if ground.any() else [])]
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    times, lower = _times_shown(scene), axes[-1]
    _areas(axes[0], scene, times)
    if bonded:
        _peak_stress(axes[1], scene, times)
    if ground.any():
        lower.fill_between(times, ground, step="post", color=colours.GROUND, alpha=0.6, lw=0.0)
        lower.set_ylabel("elements\naground", fontsize=9)
        lower.yaxis.get_major_locator().set_params(integer=True)
        lower.set_ylim(0.0, 1.15 * float(ground.max()))
    for k, ax in enumerate(axes):
        style.plain_axes(ax)
        ax.text(0.0, 1.02, f"({'abc'[k]})", transform=ax.transAxes, fontsize=10, fontweight="bold", va="bottom")
    if is_short(scene.times):
        lower.set_xlabel(f"time since the start ({_unit_of_time(scene)[0]})")
    else:
        date_axis(lower)
    if len(times) > 1:
        lower.set_xlim(times[0], times[-1])
    above = style.put_title(figure, figure_title(run, "fragments"), left=0.08 * 11.0)
    above += 0.2 * max(0, math.ceil(len(fragment_colours(scene)) / 2) - 2)  # lines of the legend
    bottom = 0.55 if is_short(scene.times) else 0.48
    figure.subplots_adjust(left=0.08, right=0.97, top=1.0 - (above + 0.45) / 7.4, bottom=bottom / 7.4, hspace=0.2)
    style.save_figure(figure, path)
    return Path(path)


def knows_floor(scene: Scene) -> bool:
    """Return whether the run has a sea floor: a depth of 0 everywhere, with the sea level on top, is none."""
    depth = scene.run["depth"].values
    return bool(np.nanmax(depth, initial=0.0) > min(scene.draft(), NO_FLOOR))


def _times_shown(scene: Scene) -> Any:
    """Return the records along the axis of time: dates, or in a short run seconds, minutes or hours since its start."""
    if not is_short(scene.times):
        return scene.times
    return (scene.seconds - scene.seconds[0]) / _unit_of_time(scene)[1]


def _unit_of_time(scene: Scene) -> tuple[str, float]:
    """Return the unit of the axis of time of a short run, and its seconds."""
    length = length_of(scene.times)
    if length <= 180.0:
        return "s", 1.0
    return ("min", 60.0) if length <= 10800.0 else ("h", 3600.0)


def _areas(ax: Axes, scene: Scene, times: Any) -> None:
    """Draw the area of each named fragment; a break-up is a step of the parent and a dot where the child begins."""
    unit = 1e6 if float(scene.area.sum()) >= 1e4 else 1.0
    for rank, (number, colour) in enumerate(fragment_colours(scene).items()):
        area = np.where(scene.berg == number, scene.area, 0.0).sum(axis=1) / unit
        there = area > 0.0
        ax.step(times[there], area[there], where="post", color=colour, lw=max(1.4, 4.8 - 1.2 * rank),
                label=fragment_name(scene, number))  # fmt: skip
        if scene.birth(number) is not None and there.any():
            ax.axvline(times[there][0], color=colours.PAIRING, lw=0.8, ls=":")
            ax.plot(times[there][0], area[there][0], "o", color=colour, mec="black", ms=7, zorder=5)
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("area (km²)" if unit == 1e6 else "area (m²)", fontsize=9)
    ax.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)


def _peak_stress(ax: Axes, scene: Scene, times: Any = None) -> None:
    """Draw the largest tension between records and, thinner, at the records: what is between both is ringing and impact."""
    times = scene.times if times is None else times
    peak = scene.tension().max(axis=1, initial=0.0)
    ax.plot(times, peak / 1e3, color=colours.STRESS_LINE, lw=1.3, label="between records")
    if "peak_stress" in scene.run:
        at_records = np.where(scene.unbroken, scene.run["normal_stress"].transpose("time", "bond").values, 0.0)
        ax.plot(
            times, at_records.max(axis=1, initial=0.0) / 1e3, color=colours.STRENGTH, lw=0.8, label="at the records"
        )
    fracture = scene.parameters.fracture
    if fracture.enabled:
        ax.axhline(fracture.normal_strength / 1e3, color=colours.STRENGTH, ls="--", lw=1.0)
        ax.text(
            0.005,
            fracture.normal_strength / 1e3,
            "strength",
            fontsize=8,
            va="bottom",
            transform=ax.get_yaxis_transform(),
        )
    lowest = scene.lowest_strength()
    if lowest is not None:
        ax.plot(times, lowest / 1e3, color=colours.DAMAGE_LINE, ls="--", lw=1.2, label="lowest strength left by damage")
    ax.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, frameon=False)
    ax.set_ylim(bottom=0.0)
    if fracture.enabled:
        _cut_off_cracks(ax, times, peak / 1e3, CRACK * fracture.normal_strength / 1e3)
    ax.set_ylabel("largest tensile\nstress (kPa)", fontsize=9)


def _cut_off_cracks(ax: Axes, times: Any, peak: Any, highest: float) -> None:
    """End the scale at a stress (kPa) and write what goes beyond: the last bonds of a crack bear all of its load for a moment."""
    beyond = peak > highest
    if not beyond.any():
        return
    ax.set_ylim(top=highest)
    starts = np.flatnonzero(beyond & ~np.concatenate([[False], beyond[:-1]]))
    ends = np.flatnonzero(beyond & ~np.concatenate([beyond[1:], [False]])) + 1
    for begin, end in zip(starts, ends, strict=True):
        k = begin + int(np.argmax(peak[begin:end]))
        ax.annotate(
            f"{peak[k]:.0f} kPa in the crack", (times[k], highest), (4, -3), textcoords="offset points", fontsize=7,
            va="top", color=colours.STRESS_LINE,
        )  # fmt: skip
