"""Pictures of test cases with a known answer: a beam against theory, and two bergs that collide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from riftberg.diagnostics.cases import Approach, BeamCase, BentBeam, approach, bent_beam
from riftberg.runs.background import water_of
from riftberg.runs.scene import Scene
from riftberg.viz import colours, style
from riftberg.viz.panels import Panel, arrow_key, common_boxes, fragment_colours, speed_bar, speed_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# ---- beams ------------------------------------------------------------------------------------------------------------


def draw_beam(run: xr.Dataset, path: str | Path, *, case: BeamCase, title: str = "", dpi: int = 150) -> Path:
    """Draw a beam: its shape, its deflection against theory, and how it came to rest.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`, or what `Model.run` returns.
    path : path
        Picture; the ending decides on the format.
    case : riftberg.diagnostics.cases.BeamCase
        How the beam is made, held and loaded.
    title : str, optional
        Heading.
    dpi : int, optional
        Resolution.
    """
    style.check_format(path)
    scene, beam = Scene(run), bent_beam(run, case)
    figure = style.new_figure(11.0, 7.2, dpi)
    axes = figure.subplot_mosaic([["shape", "shape"], ["deflection", "history"]])
    for k, ax in enumerate(axes.values()):
        style.letter(ax, k)
    _draw_shape(axes["shape"], scene, beam)
    across, down = _unit(case.length), _unit(beam.expected)
    ax = axes["deflection"]
    ax.plot(beam.theory_along / across[1], -beam.theory_down / down[1], color=colours.OBSERVED, lw=1.8, label="theory")
    ax.plot(
        beam.along / across[1], -beam.down / down[1], "o", color=colours.MODEL, mec="black", mew=0.5, ms=5,
        label="model",
    )  # fmt: skip
    ax.set_xlabel(f"x from the first column ({across[0]})", fontsize=9)
    ax.set_ylabel(f"deflection ({down[0]})", fontsize=9)
    ax.set_title(f"{100.0 * beam.error:+.1f} % from theory", fontsize=9, loc="right")
    ax = axes["history"]
    time, seconds = ("s", 1.0) if beam.seconds[-1] <= 180.0 else ("h", 3600.0)
    ax.axhline(-beam.expected / down[1], color=colours.OBSERVED, lw=1.8, label="theory")
    ax.plot(beam.seconds / seconds, -beam.history / down[1], color=colours.MODEL, lw=2.0, label="model")
    ax.set_xlabel(f"time since the load ({time})", fontsize=9)
    ax.set_ylabel(f"deflection of the {'middle' if case.held == 'supported' else 'end'} ({down[0]})", fontsize=9)
    for name in ("deflection", "history"):
        style.plain_axes(axes[name])
        axes[name].legend(fontsize=8, loc="best", frameon=False)
    style.put_title(figure, title or "Beam")
    return style.save_figure(figure, path)


def _draw_shape(ax: Axes, scene: Scene, beam: BentBeam) -> None:
    """Draw the elements at the start and at the end in their true shape, and the line of theory."""
    from matplotlib.collections import PolyCollection

    origin = np.array([scene.x[0].min(), float(scene.y[0].reshape(beam.case.columns, -1)[0].mean())])
    name, unit = _unit(beam.case.length)
    for record, face, label in ((0, colours.ICE, "start"), (len(scene.times) - 1, colours.MODEL, "model, at the end")):
        elements = list((scene.polygons(record) - origin) / unit)
        ax.add_collection(
            PolyCollection(elements, facecolors=face, edgecolors=(0.0, 0.0, 0.0, 0.4), linewidths=0.4, label=label)
        )
    ax.plot(
        beam.theory_along / unit, -beam.theory_down / unit, color=colours.OBSERVED, lw=1.8, label="theory, centre line"
    )
    ax.set_aspect("equal")
    ax.margins(0.04)
    ax.autoscale_view()
    ax.set_xlabel(f"x from the first column ({name})", fontsize=9)
    ax.set_ylabel(f"y ({name})", fontsize=9)
    style.legend_above(ax, ncols=3)
    ax.tick_params(labelsize=8)


def _unit(length: float) -> tuple[str, float]:
    """Return the unit in which a length (m) is drawn, and its metres."""
    return ("km", 1e3) if length >= 3e3 else ("m", 1.0)


# ---- two bergs --------------------------------------------------------------------------------------------------------


def draw_approach(run: xr.Dataset, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw two bergs that collide: where they are before, at and after the contact, and their distance over time.

    Parameters
    ----------
    run, path, title, dpi
        As in `draw_beam`.
    """
    style.check_format(path)
    scene, contact = Scene(run), approach(run)
    figure = style.new_figure(12.0, 8.6, dpi)
    upper, lower = style.parts(figure, 2, 1, height_ratios=(0.62, 0.38))
    records = contact_records(contact)
    places = list(upper.subplots(1, len(records), squeeze=False).flat)
    boxes = common_boxes(scene, records)
    panels = [Panel(ax, scene, box, water_of(run), labels=True) for ax, box in zip(places, boxes, strict=True)]
    for ax, text in zip(places, style.moment_texts(scene.times, records), strict=True):
        ax.set_title(text, fontsize=10, pad=4)
    style.outer_names(places, len(records))
    top, flows = speed_scale(panels, records)
    if flows:
        speed_bar(places, top)
    curves = list(lower.subplots(1, 2))
    _draw_distance(curves[0], contact)
    _draw_closing(curves[1], contact)
    for ax in curves:
        ax.set_xlabel("hours since the start", fontsize=9)
        style.plain_axes(ax)
        style.legend_above(ax, ncols=2)
    for k, ax in enumerate((*places, *curves)):
        style.letter(ax, k)
    style.put_title(figure, title or "Two bergs collide")
    style.lay_out(figure)
    for k, (panel, record) in enumerate(zip(panels, records, strict=True)):
        quiver = panel.draw_date(record, top, fragment_colours(scene))
        if quiver is not None and flows and k == 0:
            arrow_key(quiver, top)
    return style.save_figure(figure, path)


def contact_records(contact: Approach) -> list[int]:
    """Return three records: the first, the one of the closest contact, and one after the bergs have separated."""
    count = len(contact.apart)
    if not contact.touching.any():
        return sorted({0, int(np.argmin(contact.apart)), count - 1})
    begin = int(np.argmax(contact.touching))
    ends = np.flatnonzero(~contact.touching[begin:])
    end = begin + int(ends[0]) if len(ends) else count
    nearest = begin + int(np.argmin(contact.apart[begin:end]))
    return sorted({0, nearest, min(count - 1, nearest + max(1, (end - nearest) * 2))})


def _draw_distance(ax: Axes, contact: Approach) -> None:
    ax.axhline(contact.reach / 1e3, color=colours.GROUND, ls="--", lw=1.0, label="contact below")
    ax.plot(contact.seconds / 3600.0, contact.apart / 1e3, color="black", lw=1.8, label="nearest elements")
    ax.set_ylabel("distance of centres (km)", fontsize=9)
    ax.set_ylim(bottom=0.0)


def _draw_closing(ax: Axes, contact: Approach) -> None:
    hours = contact.seconds / 3600.0
    ax.fill_between(hours, 0.0, 1.0, where=contact.touching, step="mid", transform=ax.get_xaxis_transform(), lw=0.0,
                    color=colours.GROUND, alpha=0.15, label="in contact")  # fmt: skip
    ax.axhline(0.0, color=colours.STRENGTH, lw=0.8)
    ax.plot(hours, contact.closing, color="black", lw=1.8, label="closing speed of the centroids")
    ax.set_ylabel("closing speed (m s$^{-1}$)", fontsize=9)
