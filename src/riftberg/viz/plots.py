"""Figures of a run: the berg at chosen dates beside what was observed, bond stress, and the life of its fragments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.errors import InputError
from riftberg.runs.background import stored_water
from riftberg.runs.scene import Box, Scene
from riftberg.state import Floats
from riftberg.viz import style
from riftberg.viz.panels import (
    Panel,
    Water,
    common_boxes,
    damage_map,
    day_text,
    fragment_colours,
    fragment_name,
    nearest_record,
    root_scale,
    speed_bar,
    speed_top,
    stress_map,
    widened,
)
from riftberg.viz.style import date_axis, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

Outlines = Mapping[str, Sequence[Floats]]
"""Observed outlines: ISO day to rings of shape (n, 2), longitude and latitude."""

OBSERVED_COLOURS = ("#332288", "#117733", "#AA4499", "#88CCEE", "#999933", "#882255")


def heading(run: xr.Dataset, what: str) -> str:
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

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`.
    path : path
        Picture.
    dates : sequence of numpy.datetime64, optional
        Dates of the panels.
    observed : mapping, optional
        Outlines by ISO day.
    water : Forcing or StoredWater, optional
        Currents and sea floor; by default those that the run file keeps.
    dpi : int, optional
    """
    scene, observed = Scene(run), observed or {}
    water = water or stored_water(run)
    records = chosen(scene, dates)
    shown = {day: observed[day] for r in records if (day := str(scene.times[r])[:10]) in observed}
    count = len(records) + bool(shown)
    columns = min(4, count) if count <= 4 else math.ceil(count / 2)
    rows = math.ceil(count / columns)
    # The legend takes a line for each column's width of fragments.
    entries = math.ceil((len(fragment_colours(scene)) + bool(shown)) / columns)
    figure = new_figure(4.1 * columns + 0.6, 4.3 * rows + 1.8 + 0.17 * entries, dpi)
    places = [figure.add_subplot(rows, columns, k + 1) for k in range(count)]
    boxes = common_boxes(scene, records)
    panels = [Panel(ax, scene, box, water) for ax, box in zip(places[bool(shown) :], boxes, strict=True)]
    top = speed_top(panels, records)
    for panel, record in zip(panels, records, strict=True):
        _date_panel(panel, record, top, shown)
    if shown:
        _observed_panel(places[0], scene, records, shown, water, top)
    flowing = top if any(p.fastest(records[0]) for p in panels) else 0.0
    below = _legend(figure, scene, bool(shown), flowing)
    height = figure.get_figheight()
    title = heading(run, "model" + (" and observed outlines" if shown else ""))
    lines = style.wrapped(title, figure.get_figwidth() - 0.6, size=12)
    left, right = 0.62 / figure.get_figwidth(), 1.0 - 0.08 / figure.get_figwidth()
    above = 0.45 + 0.2 * len(lines)
    figure.subplots_adjust(
        left=left, right=right, top=1.0 - above / height, bottom=below / height, wspace=0.22, hspace=0.2
    )
    figure.suptitle(
        "\n".join(lines), x=0.3 / figure.get_figwidth(), y=1.0 - 0.1 / height, va="top", ha="left", fontsize=12
    )
    style.save_figure(figure, path)
    return Path(path)


def _date_panel(panel: Panel, record: int, top: float, shown: Outlines) -> None:
    scene = panel.scene
    panel.draw_currents(record, top)
    panel.draw_floor()
    panel.draw_ice(record, fragment_colours(scene))
    panel.draw_outlines(shown.get(str(scene.times[record])[:10], ()), lw=1.4)
    panel.draw_scale()
    panel.ax.set_title(day_text(scene.times[record]), fontsize=10, pad=4)


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
        colour = OBSERVED_COLOURS[k % len(OBSERVED_COLOURS)]
        panel.draw_outlines(drawn, color=colour, lw=1.6)
        ax.plot([], [], color=colour, lw=1.6, label=day_text(np.datetime64(day), hour=False))
    panel.draw_scale()
    ax.legend(fontsize=7, loc="upper right", framealpha=0.85, handlelength=1.2)
    ax.set_title(f"Observed; currents of {day_text(scene.times[middle], hour=False)}", fontsize=10, pad=4)


def _legend(figure: Figure, scene: Scene, observed: bool, top: float) -> float:
    """Explain the fragments, and above that draw the scale of the current; return the height of both with the ticks (inches)."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(fc=colour, ec="black", lw=0.5, label=fragment_name(scene, number))
        for number, colour in fragment_colours(scene).items()
    ]
    if observed:
        handles.append(Line2D([], [], color="black", lw=1.4, label="observed outline of the day"))
    width, height = figure.get_figwidth(), figure.get_figheight()
    columns = max(1, min(len(handles), int((width - 0.5) / 4.1)))
    high = 0.17 * math.ceil(len(handles) / columns) + 0.16
    figure.legend(
        handles=handles, fontsize=8, loc="lower left", bbox_to_anchor=(0.45 / width, 0.0), ncols=columns, frameon=False
    )
    if top > 0.0:
        long = min(4.2, width - 1.2)
        speed_bar(figure, (0.62 / width, (high + 0.4) / height, long / width, 0.1 / height), top)
        high += 0.5
    return high + 0.4


def draw_stress(
    run: xr.Dataset, path: str | Path, *, dates: Sequence[np.datetime64] | None = None, dpi: int = 150
) -> Path:
    """Draw the bonds in the colour of their tensile stress; by default just before the large break-ups.

    Parameters
    ----------
    run, path, dates, dpi
        As in `draw_dates`.
    """
    scene = Scene(run)
    records = chosen(scene, dates) if dates else _before_breakups(scene)
    fracture = scene.parameters.fracture
    stress = scene.tension()
    tension = {r: stress[r] / 1e3 for r in records}
    top = max(1e-3, *(float(np.nanmax(values, initial=0.0)) for values in tension.values()))
    strength = fracture.normal_strength / 1e3
    beyond = fracture.enabled and top >= strength
    text = f"; strength {strength:g} kPa" if fracture.enabled else ""
    figure = _bond_maps(
        scene, tension, stress_map(), root_scale(strength if beyond else top),
        f"largest tensile stress of a bond (kPa){text}; dotted: broken", beyond=beyond, dpi=dpi,
    )  # fmt: skip
    return _titled(figure, heading(run, "stress in the bonds"), path)


def draw_damage(
    run: xr.Dataset, path: str | Path, *, dates: Sequence[np.datetime64] | None = None, dpi: int = 150
) -> Path:
    """Draw the bonds in the colour of their damage; by default just before the large break-ups and at the end.

    Parameters
    ----------
    run, path, dates, dpi
        As in `draw_dates`.

    Raises
    ------
    InputError
        If the run has no damage.
    """
    scene = Scene(run)
    damage = scene.bond_damage()
    if damage is None:
        raise InputError("the run has no damage", where="damage", remedy="Run with --set damage.enabled=true")
    records = chosen(scene, dates) if dates else sorted({*_before_breakups(scene), len(scene.times) - 1})
    shown = {r: damage[r] for r in records}
    top = max(0.01, *(float(np.nanmax(values, initial=0.0)) for values in shown.values()))
    figure = _bond_maps(scene, shown, damage_map(), root_scale(top), "damage of a bond; dotted: broken", dpi=dpi)
    return _titled(figure, heading(run, "damage of the bonds"), path)


def _titled(figure: Figure, title: str, path: str | Path) -> Path:
    """Put the title on a figure and write it."""
    figure.suptitle(title, x=0.05, ha="left", fontsize=12)
    style.save_figure(figure, path)
    return Path(path)


def _bond_maps(
    scene: Scene,
    values: Mapping[int, Floats],
    colours: Colormap,
    scale: Normalize,
    label: str,
    *,
    dpi: int,
    beyond: bool = False,
) -> Figure:
    """Draw the bonds at each record in the colour of their values, with a scale below; ``beyond`` marks its upper end as open."""
    from matplotlib.cm import ScalarMappable

    figure = new_figure(5.2 * len(values) + 0.8, 6.3, dpi)
    boxes = common_boxes(scene, list(values), margin=0.05)
    for k, (record, box) in enumerate(zip(values, boxes, strict=True)):
        panel = Panel(figure.add_subplot(1, len(values), k + 1), scene, box)
        inches = (
            0.8 * 5.2 * float(np.sqrt(np.median(scene.area))) / 1e3 * scene.units_per_km() / (box.north - box.south)
        )
        panel.draw_bonds(record, values[record], colours, scale, points=max(0.6, 72.0 * inches * 0.62))
        panel.draw_scale()
        panel.ax.set_title(day_text(scene.times[record], year=True), fontsize=10, pad=4)
    figure.subplots_adjust(left=0.06, right=0.98, top=0.86, bottom=0.17, wspace=0.18)
    place = figure.add_axes((0.25, 0.085, 0.5, 0.018))
    extend = "max" if beyond else "neither"
    bar = figure.colorbar(ScalarMappable(scale, colours), cax=place, orientation="horizontal", extend=extend)
    bar.set_label(label, fontsize=9)
    return figure


def _before_breakups(scene: Scene) -> list[int]:
    """Return the last records before the large break-ups; without any, the record of the largest stress."""
    births = sorted(birth[0] for n in scene.numbers if (birth := scene.birth(n)) is not None)
    records = {max(0, int(np.searchsorted(scene.times, birth)) - 1) for birth in births[:4]}
    if not records:
        stress = scene.tension()
        records = {int(np.argmax(stress.max(axis=1)))} if stress.size else {0}
    return sorted(records)


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
    upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3.0, 1.6, 1.0))
    _areas(upper, scene)
    _peak_stress(middle, scene)
    lower.fill_between(scene.times, scene.aground().sum(axis=1), step="post", color=style.GROUND_COLOUR, alpha=0.6)
    lower.set_ylabel("elements\naground", fontsize=9)
    lower.yaxis.get_major_locator().set_params(integer=True)
    for ax in (upper, middle, lower):
        ax.grid(color="#DDDDDD", lw=0.6)
        ax.tick_params(labelsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    date_axis(lower)
    lower.set_xlim(scene.times[0], scene.times[-1])
    figure.subplots_adjust(left=0.08, right=0.97, top=0.89, bottom=0.07, hspace=0.1)
    return _titled(figure, heading(run, "fragments"), path)


def _areas(ax: Axes, scene: Scene) -> None:
    """Draw the area of each named fragment; a break-up is a step of the parent and a dot where the child begins."""
    for number, colour in fragment_colours(scene).items():
        area = np.where(scene.berg == number, scene.area, 0.0).sum(axis=1) / 1e6
        there = area > 0.0
        ax.step(scene.times[there], area[there], where="post", color=colour, lw=2.2, label=fragment_name(scene, number))
        birth = scene.birth(number)
        if birth is not None:
            ax.axvline(birth[0], color="#999999", lw=0.8, ls=":")  # type: ignore[arg-type]
            ax.plot(birth[0], area[there][0], "o", color=colour, mec="black", ms=7, zorder=5)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("area (km²)", fontsize=9)
    ax.legend(fontsize=8, loc="best", framealpha=0.9)


def _peak_stress(ax: Axes, scene: Scene) -> None:
    """Draw the largest tension between records and, thinner, at the records: what is between both is ringing and impact."""
    peak = scene.tension().max(axis=1, initial=0.0)
    ax.plot(scene.times, peak / 1e3, color="#CF2A27", lw=1.3, label="between records")
    if "peak_stress" in scene.run:
        at_records = np.where(scene.unbroken, scene.run["normal_stress"].transpose("time", "bond").values, 0.0)
        ax.plot(scene.times, at_records.max(axis=1, initial=0.0) / 1e3, color="#555555", lw=0.8, label="at the records")
    fracture = scene.parameters.fracture
    if fracture.enabled:
        ax.axhline(fracture.normal_strength / 1e3, color="#555555", ls="--", lw=1.0)
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
        ax.plot(scene.times, lowest / 1e3, color="#63308F", ls="--", lw=1.2, label="lowest strength left by damage")
    ax.legend(fontsize=8, loc="best", framealpha=0.9)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("largest tensile\nstress (kPa)", fontsize=9)
