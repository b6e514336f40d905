"""Picture of a bending beam: its shape, its deflection against theory, and how it came to rest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from riftberg.diagnostics.beam import BentBeam
from riftberg.runs.scene import Scene
from riftberg.viz import colours, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


WIDE: Final = 9.9
"""Width (inches) of the panel of the shape."""

BELOW: Final = 4.1
"""What stands below that panel, inches."""


def draw_beam(run: xr.Dataset, beam: BentBeam, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw a bent beam against theory."""
    style.check_format(path)
    scene = Scene(run)
    corners = np.concatenate([scene.polygons(0), scene.polygons(len(scene.times) - 1)]).reshape(-1, 2)
    across, along = corners.max(axis=0) - corners.min(axis=0)
    # A beam that hardly bends takes a flat panel.
    shape = float(np.clip(WIDE * (along / across + 0.08) / 1.08, 1.0, 3.2))
    height = shape + BELOW + 0.9
    figure = style.new_figure(11.0, height, dpi)
    style.put_title(figure, title or "Beam", left=0.8)
    upper = figure.add_axes((0.075, BELOW / height, WIDE / 11.0, shape / height))
    left, right = (figure.add_axes((x, 0.65 / height, w, 2.5 / height)) for x, w in ((0.075, 0.42), (0.575, 0.4)))
    _shape(upper, run, beam)
    _deflection(left, beam)
    _history(right, beam)
    for k, ax in enumerate((upper, left, right)):
        style.letter(ax, k)
    style.save_figure(figure, path)
    return Path(path)


def _shape(ax: Axes, run: xr.Dataset, beam: BentBeam) -> None:
    """Draw the elements at the start and at the end in their true shape, and the line of theory."""
    from matplotlib.collections import PolyCollection

    scene = Scene(run)
    start = scene.polygons(0)
    origin = np.array([scene.x[0].min(), float(scene.y[0].reshape(beam.case.columns, -1)[0].mean())])
    unit = _unit(beam.case.length)
    for record, face, label in ((0, colours.ICE, "start"), (-1, colours.MODEL, "model, at the end")):
        shown = (scene.polygons(record % len(scene.times)) - origin) / unit
        ax.add_collection(
            PolyCollection(list(shown), facecolors=face, edgecolors=(0.0, 0.0, 0.0, 0.4), linewidths=0.4, label=label)
        )
    ax.plot(
        beam.theory_along / unit, -beam.theory_down / unit, color=colours.OBSERVED, lw=1.8, label="theory, centre line"
    )
    corners = np.concatenate([start, scene.polygons(len(scene.times) - 1)]).reshape(-1, 2)
    low, high = (corners.min(axis=0) - origin) / unit, (corners.max(axis=0) - origin) / unit
    margin = 0.04 * (high - low).max()
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)
    ax.set_aspect("equal")
    ax.set_xlabel(f"x from the first column ({_name(beam.case.length)})", fontsize=9)
    ax.set_ylabel(f"y ({_name(beam.case.length)})", fontsize=9)
    ax.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
    ax.tick_params(labelsize=8)


def _deflection(ax: Axes, beam: BentBeam) -> None:
    """Draw the deflection of the centre line."""
    across, down = _unit(beam.case.length), _unit(beam.expected)
    ax.plot(beam.theory_along / across, -beam.theory_down / down, color=colours.OBSERVED, lw=1.8, label="theory")
    ax.plot(beam.along / across, -beam.down / down, "o", color=colours.MODEL, mec="black", mew=0.5, ms=5, label="model")
    ax.set_xlabel(f"x from the first column ({_name(beam.case.length)})", fontsize=9)
    ax.set_ylabel(f"deflection ({_name(beam.expected)})", fontsize=9)
    ax.set_title(f"{100.0 * beam.error:+.1f} % from theory", fontsize=9, loc="right")
    _with_legend(ax)


def _history(ax: Axes, beam: BentBeam) -> None:
    """Draw how the deflection came to rest."""
    down = _unit(beam.expected)
    name, size = ("s", 1.0) if beam.seconds[-1] <= 180.0 else ("h", 3600.0)
    ax.axhline(-beam.expected / down, color=colours.OBSERVED, lw=1.8, label="theory")
    ax.plot(beam.seconds / size, -beam.history / down, color=colours.MODEL, lw=2.0, label="model")
    ax.set_xlabel(f"time since the load ({name})", fontsize=9)
    where = "middle" if beam.case.held == "supported" else "end"
    ax.set_ylabel(f"deflection of the {where} ({_name(beam.expected)})", fontsize=9)
    _with_legend(ax)


def _with_legend(ax: Axes) -> None:
    style.plain_axes(ax)
    ax.legend(fontsize=8, loc="best", frameon=False)


def _unit(length: float) -> float:
    return 1e3 if length >= 3e3 else 1.0


def _name(length: float) -> str:
    return "km" if length >= 3e3 else "m"
