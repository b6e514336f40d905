"""The picture of a forecast: where the ice will be, how likely it breaks and grounds, and where it breaks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.errors import InputError
from riftberg.plane import ellipses
from riftberg.viz import colours, style
from riftberg.viz.panels import Map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BROKEN, GROUND = colours.STRESS_LINE, colours.FRAGMENTS[5]
"""Colours of the probabilities of a break-up and of the ground."""


def draw_forecast(result: xr.Dataset, path: str | Path, *, notes: Sequence[str] = (), dpi: int = 150) -> Path:
    """Draw a forecast: presence and tracks with the control, probabilities by date, cracks in the berg.

    ``notes``: lines above the cracks, such as the likeliest scenarios.
    """
    if "presence" not in result:
        raise InputError("no forecast in degrees", where="draw_forecast", remedy="Give the result of riftberg forecast")
    style.check_format(path)
    figure = style.new_figure(14.0, 8.0, dpi)
    axes = figure.subplot_mosaic([["map", "dates"], ["map", "cracks"]], width_ratios=(0.56, 0.44))
    shown, finish = _draw_map(axes["map"], result)
    bar = figure.colorbar(shown, ax=axes["map"], orientation="horizontal", aspect=45, pad=0.03, shrink=0.9)
    bar.set_label("probability that ice passes over", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    _draw_dates(axes["dates"], result)
    cracks = _draw_cracks(axes["cracks"], result, notes)
    bar = figure.colorbar(cracks, ax=axes["cracks"], aspect=25, pad=0.02)
    bar.set_label("probability of a crack", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    for k, ax in enumerate(axes.values()):
        style.letter(ax, k)
    done = int((result["status"] == 0).sum())
    name = Path(str(result.attrs.get("experiment", "Forecast"))).stem
    style.put_title(figure, f"{name}: {done} members, {style.span_text(result['time'].values)}", size=13.0)
    style.lay_out(figure)
    finish()
    return style.save_figure(figure, path)


def _draw_map(ax: Axes, result: xr.Dataset) -> tuple[Any, Callable[[], None]]:
    """Draw where ice passes, tracks of the largest pieces, the control, ellipses; return the shades, and what comes last."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    cells = np.meshgrid(result["cell_lon"].values, result["cell_lat"].values)
    chart = Map.around(ax, *cells, margin=0.04)
    shades = ListedColormap(colormaps["YlOrRd"](np.linspace(0.05, 0.85, 10)))
    image = ax.pcolormesh(
        *chart.placed(*cells), np.ma.masked_less(result["passes"].values, 0.005), cmap=shades, vmin=0.0, vmax=1.0,
        zorder=1.5,
    )  # fmt: skip
    shown = np.flatnonzero(result["status"].values == 0)[:200]
    tracks = [result[name].isel(fragment=0, member=shown).values for name in ("lon", "lat")]
    for n, track in enumerate(zip(*tracks, strict=True)):
        label = "members" if n == 0 else None
        ax.plot(*chart.placed(*track), color=colours.STRENGTH, lw=0.4, alpha=0.5, zorder=4, label=label)
    if "control_lon" in result:
        control = (result[f"control_{name}"].values[0] for name in ("lon", "lat"))
        ax.plot(*chart.placed(*control), color="black", lw=1.8, zorder=6, label="control")
    in_hours = float(result["lead"].values[-1]) < 96.0  # else two of the ellipses would have one day
    lines = ellipses(result, 0.9)
    steps = np.unique(np.linspace(0, result.sizes["time"] - 1, 5).astype(int))[1:]
    leads: list[tuple[str, float, float]] = []
    for n, k in enumerate(steps):
        x, y = chart.placed(*lines[k].T)
        ax.plot(x, y, color=colours.ARROW, lw=1.2, zorder=5, label="90 % of positions" if n == 0 else None)
        lead = result["lead"].values[k]
        east = int(np.argmax(x))  # the tracks run through the middle
        leads.append((f"{lead:.0f} h" if in_hours else f"{lead / 24:.0f} d", float(x[east]), float(y[east])))
    style.legend_above(ax, ncols=3)
    chart.draw_scale()

    def finish() -> None:
        """Draw what finds its place by where the axes came to lie."""
        labels = style.Labels(ax)
        ice = result["passes"].values > 0.005
        chart.draw_place(*chart.placed(*(axis[ice] for axis in cells)), labels)
        for lead in leads:
            labels.put(*lead, fontsize=8, color=colours.ARROW)

    return image, finish


def _draw_dates(ax: Axes, result: xr.Dataset) -> None:
    """Draw the probability of a break-up and of the ground by date, with intervals and the control."""
    time = result["time"].values
    for name, colour, word in (("p_broken", BROKEN, "broken up"), ("p_aground", GROUND, "been aground")):
        ax.fill_between(time, 100 * result[f"{name}_low"], 100 * result[f"{name}_high"], color=colour, alpha=0.18, lw=0)
        ax.plot(time, 100 * result[name], color=colour, lw=1.8, label=word)
    if "control_first_breakup" in result and not np.isnat(result["control_first_breakup"].values):
        at = result["control_first_breakup"].values
        ax.plot([at, at], [0.0, 100.0], color="black", lw=1.0, ls="--", label="control breaks up")
    ax.set_ylim(0.0, 100.0)
    ax.set_xlim(time[0], time[-1])
    ax.set_ylabel("probability (%)", fontsize=9)
    style.plain_axes(ax)
    style.date_axis(ax, "x")
    ax.legend(fontsize=8, loc="upper left")
    ax.set_title("Until then it has ... (shade: 90 % interval)", fontsize=10, pad=6)


def _draw_cracks(ax: Axes, result: xr.Dataset, notes: Sequence[str]) -> Any:
    """Draw the probability of a crack on the berg at the start."""
    x, y = result["own_x"].values / 1e3, result["own_y"].values / 1e3
    ax.contourf(x, y, result["ice"].values, levels=[0.5, 1.5], colors=[colours.ICE], zorder=1)
    share = np.ma.masked_less(result["crack_probability"].values, 0.005)
    image = ax.pcolormesh(x, y, share, cmap="magma_r", vmin=0.0, vmax=max(0.1, float(share.max() or 0.1)), zorder=2)
    ax.set_aspect("equal")
    style.plain_axes(ax)
    ax.set_xlabel("km east of the middle at the start", fontsize=9)
    ax.set_ylabel("km north", fontsize=9)
    ax.set_title("\n".join(["Where it breaks", *notes]), fontsize=8.5, pad=6)
    return image
