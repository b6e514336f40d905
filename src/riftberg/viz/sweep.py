"""The picture of a sweep: where the largest pieces went, when they broke, and what was left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from riftberg.config.units import area_text
from riftberg.config.values import required
from riftberg.errors import InputError
from riftberg.viz import style
from riftberg.viz.panels import Map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray[Any, Any]

SHADES: Final = (0.05, 0.92)
"""Part of the viridis scale that is used: its ends are too dark and too light for thin lines."""


def draw_sweep(result: xr.Dataset, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw a sweep: tracks of the largest pieces, dates of the break-ups, and the size of the largest piece.

    Parameters
    ----------
    result : xarray.Dataset
        From `riftberg.sweep` or `riftberg.open_sweep`.
    path : path
        Picture to write; the ending decides on the format.
    dpi : int, optional
        Resolution.

    Returns
    -------
    pathlib.Path
        The picture.

    Raises
    ------
    InputError
        If no member is done.
    """
    required(result, xr.Dataset, "what riftberg.sweep or riftberg.open_sweep returns", where="draw_sweep")
    if "status" not in result or not (result["status"] == 0).any():
        raise InputError("no member of this sweep is done", where="draw_sweep", remedy="Look at its messages")
    style.check_format(path)
    done, missing = result.isel(member=(result["status"] == 0).values), int((result["status"] != 0).sum())
    figure = style.new_figure(13.5, 7.2, dpi)
    axes = figure.subplot_mosaic([["tracks", "dates"], ["tracks", "sizes"]], width_ratios=(0.55, 0.45))
    names = [str(name) for name in done.coords if "parameter" in done[name].attrs]
    x, label, words = _scale(done, names[0])
    # A second parameter is shown by colour; with one alone the colour shows that one.
    shade, shade_label, shade_words = _scale(done, names[min(1, len(names) - 1)])
    shades, bar = _colour_bar(figure.colorbar, list(axes.values()), shade)
    bar.set_label(shade_label, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    if shade_words:
        bar.set_ticks(range(len(shade_words)), labels=shade_words)
    chart, ice = _draw_tracks(axes["tracks"], done, shades)
    distinct = np.unique(x)
    spread = x
    if len(names) > 1 and len(distinct) > 1:  # members of one value stand side by side, so that all are seen
        spread = x + (bar.norm(shade) - 0.5) * 0.35 * float(np.diff(distinct).min())
    _draw_breakups(axes["dates"], done, spread, shades)
    area = done["largest_area"].values / 1e6
    axes["sizes"].scatter(spread, area, s=26, c=shades, ec="white", lw=0.5)
    axes["sizes"].set_ylim(0.0, 1.08 * float(np.nanmax(area)))
    axes["sizes"].set_ylabel("area (km²)", fontsize=9)
    axes["sizes"].set_title("Largest piece at the end", fontsize=10, pad=6)
    axes["sizes"].set_xlabel(label, fontsize=9)
    margin = 0.08 * (float(np.ptp(x)) or 1.0)
    for name in ("dates", "sizes"):
        style.plain_axes(axes[name])
        axes[name].set_xlim(float(x.min()) - margin, float(x.max()) + margin)
        if words:
            axes[name].set_xticks(range(len(words)), words)
    for k, ax in enumerate(axes.values()):
        style.letter(ax, k)
    note = f"{done.sizes['member']} runs" + (f", {missing} more failed or not yet run" if missing else "")
    style.put_title(figure, f"{str(done.attrs.get('title', 'Sweep')).split(':')[0]}, {note}", size=13.0)
    style.lay_out(figure)
    chart.draw_place(*ice)
    return style.save_figure(figure, path)


def _colour_bar(colorbar: Any, axes: list[Axes], values: Array) -> tuple[Array, Any]:
    """Draw the scale of the colours beside axes; return the colour of each value, and the bar."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    low, high = float(values.min()), float(values.max())
    scale = ScalarMappable(
        Normalize(low, high if high > low else low + 1.0),
        ListedColormap(colormaps["viridis"](np.linspace(*SHADES, 256))),
    )
    return np.asarray(scale.to_rgba(values)), colorbar(scale, ax=axes, aspect=50, pad=0.02)


def _draw_tracks(ax: Axes, done: xr.Dataset, shades: Array) -> tuple[Map, tuple[Array, Array]]:
    """Draw where the pieces of each member were at each time, the largest one full; return the map and what is on it."""
    latlon = "lat" in done
    x_name, y_name = ("lon", "lat") if latlon else ("x", "y")
    lon, lat, area = (done[name].values for name in (x_name, y_name, "area"))
    chart = Map.around(ax, lon, lat, latlon=latlon)
    x, y = chart.placed(lon, lat)
    for k, colour in enumerate(shades):
        # The largest at any time: at the end it may have melted away or broken up.
        largest = int(np.argmax(np.nanmax(np.nan_to_num(area[k]), axis=1)))
        for piece in range(x.shape[1]):
            main = piece == largest
            ax.plot(
                *style.gapped(x[k, piece], y[k, piece], area[k, piece]), color=colour, lw=1.4 if main else 0.6,
                ls="-" if main else (0, (3, 1.5)), alpha=0.9 if main else 0.6, solid_capstyle="round", zorder=5,
            )  # fmt: skip
        born = done["fragment_parent"].values[k] > 0
        births = chart.placed(*(done[f"fragment_{name}"].values[k][born] for name in (x_name, y_name)))
        ax.plot(*births, ls="", marker="*", ms=7, mec="white", mew=0.4, color=colour, zorder=6)
    chart.draw_scale()
    ax.set_title("Tracks; a star where a piece broke off", fontsize=10, pad=6)
    return chart, (x, y)


def _draw_breakups(ax: Axes, done: xr.Dataset, x: Array, shades: Array) -> None:
    """Draw the dates of the break-ups of each member, larger for larger pieces."""
    # One without a parent is a whole berg, and broke off nothing.
    births, broke = done["fragment_birth_time"].values, done["fragment_parent"].values > 0
    sizes = done["fragment_area"].values / 1e6
    most = float(sizes[broke].max(initial=0.0)) or 1.0
    for k, colour in enumerate(shades):
        size = 12.0 + 120.0 * sizes[k][broke[k]] / most
        ax.scatter(np.full(broke[k].sum(), x[k]), births[k][broke[k]], s=size, color=colour, ec="white", lw=0.5)
    times = done["time"].values
    ax.set_ylim(times[0], times[-1])
    style.date_axis(ax, "y")
    largest = f"largest dot {area_text(1e6 * most, squared='²')}" if broke.any() else "none broke"
    ax.set_title(f"Break-ups ({largest})", fontsize=10, pad=6)


def _scale(done: xr.Dataset, name: str) -> tuple[Array, str, list[str]]:
    """Return a parameter as numbers for an axis, the label of that axis, and its words where it has no numbers."""
    variable = done[name]
    title = str(variable.attrs["parameter"])
    if variable.dtype.kind in "OUST":
        words = list(dict.fromkeys(str(value) for value in variable.values))
        return np.array([words.index(str(value)) for value in variable.values], dtype=float), title, words
    values, unit = np.asarray(variable.values, dtype=float), str(variable.attrs.get("units", "1"))
    largest = np.abs(values).max()
    if unit == "Pa" and largest >= 1e3:
        factor, unit = next(pair for pair in ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")) if largest >= pair[0])
        values = values / factor
    return values, title if unit in ("1", "") else f"{title} ({unit})", []
