"""The picture of a sweep: where the largest pieces went, when they broke, and what was left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.config.values import required
from riftberg.errors import InputError
from riftberg.runs.scene import Box
from riftberg.viz import colours, style
from riftberg.viz.coast import draw_coast

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    figure = style.new_figure(13.5, 7.2, dpi)
    _SweepFigure(figure, result.isel(member=(result["status"] == 0).values)).draw(int((result["status"] != 0).sum()))
    style.save_figure(figure, path)
    return Path(path)


class _SweepFigure:
    """One figure in the making; `done` holds the members that are done."""

    def __init__(self, figure: Figure, done: xr.Dataset) -> None:
        self.figure, self.done = figure, done
        self.names = [str(name) for name in done.coords if "parameter" in done[name].attrs]
        self.latlon = "lat" in done
        self.values, self.label, self.words = _scale(done, self.names[0])
        # A second parameter is shown by colour; with one alone the colour shows that one.
        self.shade, self.shade_label, self.shade_words = _scale(done, self.names[min(1, len(self.names) - 1)])

    def draw(self, missing: int) -> None:
        """Draw all panels."""
        from matplotlib import colormaps
        from matplotlib.colors import Normalize

        low, high = float(self.shade.min()), float(self.shade.max())
        self.norm = Normalize(low, high if high > low else low + 1.0)
        self.colours = colormaps["viridis"].resampled(256)
        left = self.figure.add_axes((0.06, 0.10, 0.40, 0.74))
        top, bottom = self.figure.add_axes((0.56, 0.53, 0.33, 0.31)), self.figure.add_axes((0.56, 0.10, 0.33, 0.31))
        self._tracks(left)
        self._dates(top)
        self._sizes(bottom)
        for k, ax in enumerate((left, top, bottom)):
            style.letter(ax, k)
        self._key()
        count = self.done.sizes["member"]
        note = f"{count} runs" + (f", {missing} more failed or not yet run" if missing else "")
        title = str(self.done.attrs.get("title", "Sweep")).split(":")[0]
        self.figure.text(0.06, 0.955, f"{title}, {note}", fontsize=13, ha="left", va="top")

    def _colour(self, k: int) -> Any:
        return self.colours(0.05 + 0.87 * float(self.norm(self.shade[k])))

    def _tracks(self, ax: Axes) -> None:
        """Draw where the largest piece of each member was at each time."""
        x_name, y_name = ("lon", "lat") if self.latlon else ("x", "y")
        x, y, area = (self.done[name].values for name in (x_name, y_name, "area"))
        first = float(x[np.isfinite(x)][0])
        x = _near(x, first, self.latlon)
        box = _box(x, y, self.latlon)
        ax.set_xlim(box.west, box.east)
        ax.set_ylim(box.south, box.north)
        ax.set_aspect(1.0 / np.cos(np.radians(0.5 * (box.south + box.north))) if self.latlon else 1.0)
        style.geographic_axes(ax, latlon=self.latlon, ticks=5)
        ax.set_facecolor(colours.SEA)
        draw_coast(ax, box, latlon=self.latlon)
        for k in range(len(x)):
            for place in range(x.shape[1]):
                main = place == int(np.argmax(np.nanmax(np.nan_to_num(area[k]), axis=1)))
                ax.plot(
                    x[k, place], y[k, place], color=self._colour(k), lw=1.4 if main else 0.6,
                    ls="-" if main else (0, (3, 1.5)), alpha=0.9 if main else 0.6, solid_capstyle="round",
                )  # fmt: skip
            ends = self.done["fragment_parent"].values[k] > 0
            births = [self.done[f"fragment_{name}"].values[k][ends] for name in (x_name, y_name)]
            ax.plot(
                _near(births[0], first, self.latlon),
                births[1],
                ls="",
                marker="*",
                ms=7,
                mec="white",
                mew=0.4,
                color=self._colour(k),
            )
        unit = (1.0 / 111.2 if self.latlon else 1e3) * ax.get_aspect()  # type: ignore[operator]
        style.scale_bar(ax, km=style.round_length(0.25 * (box.east - box.west) / unit), units_per_km=unit)
        ax.set_title("Tracks; a star where a piece broke off", fontsize=10, pad=6)

    def _spread(self) -> np.ndarray[Any, Any]:
        """Return the first parameter, members of equal value moved apart a little so that all are seen."""
        distinct = np.unique(self.values)
        if len(self.names) < 2 or len(distinct) < 2:
            return self.values
        gap = float(np.diff(distinct).min())
        inner = (self.norm(self.shade) - 0.5) * 0.35 * gap
        return np.asarray(self.values + inner)

    def _dates(self, ax: Axes) -> None:
        """Draw the dates of the break-ups of each member, larger for larger pieces."""
        x = self._spread()
        births, parents = self.done["fragment_birth_time"].values, self.done["fragment_parent"].values
        sizes = self.done["fragment_area"].values / 1e6
        most = np.nanmax(np.where(parents > 0, sizes, np.nan)) if (parents > 0).any() else 1.0
        for k in range(len(x)):
            broke = parents[k] > 0
            size = 12.0 + 120.0 * sizes[k][broke] / most
            ax.scatter(np.full(broke.sum(), x[k]), births[k][broke], s=size, color=self._colour(k), ec="white", lw=0.5)
        times = self.done["time"].values
        ax.set_ylim(times[0], times[-1])
        style.date_axis(ax, "y")
        some = f"largest dot {most:.3g} km²" if (parents > 0).any() else "none broke"
        ax.set_title(f"Break-ups ({some})", fontsize=10, pad=6)
        self._axis(ax, named=False)

    def _sizes(self, ax: Axes) -> None:
        """Draw the area of the largest piece at the end of each member."""
        x, area = self._spread(), self.done["largest_area"].values / 1e6
        ax.scatter(x, area, s=26, c=[self._colour(k) for k in range(len(x))], ec="white", lw=0.5)
        ax.set_ylim(0.0, 1.08 * float(np.nanmax(area)))
        ax.set_ylabel("area (km²)", fontsize=9)
        ax.set_title("Largest piece at the end", fontsize=10, pad=6)
        self._axis(ax, named=True)

    def _axis(self, ax: Axes, *, named: bool) -> None:
        span = float(np.ptp(self.values)) or 1.0
        ax.set_xlim(float(self.values.min()) - 0.08 * span, float(self.values.max()) + 0.08 * span)
        if self.words:
            ax.set_xticks(range(len(self.words)), self.words)
        if named:
            ax.set_xlabel(self.label, fontsize=9)
        ax.grid(color=colours.GRID, lw=0.5)
        ax.set_axisbelow(True)
        ax.tick_params(labelsize=8)

    def _key(self) -> None:
        """Draw the key of the colours."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import ListedColormap

        shown = ListedColormap(self.colours(np.linspace(0.05, 0.92, 256)))
        ax = self.figure.add_axes((0.92, 0.10, 0.013, 0.74))
        bar = self.figure.colorbar(ScalarMappable(self.norm, shown), cax=ax)
        bar.set_label(self.shade_label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
        if self.shade_words:
            bar.set_ticks(range(len(self.shade_words)), labels=self.shade_words)


def _scale(done: xr.Dataset, name: str) -> tuple[np.ndarray[Any, Any], str, list[str]]:
    """Return a parameter as numbers for an axis, the label of that axis, and its words where it has no numbers."""
    variable = done[name]
    title = str(variable.attrs["parameter"])
    if variable.dtype.kind in "OUST":
        words = list(dict.fromkeys(str(value) for value in variable.values))
        return np.array([words.index(str(value)) for value in variable.values], dtype=float), title, words
    values, unit = np.asarray(variable.values, dtype=float), str(variable.attrs.get("units", "1"))
    if unit == "Pa" and np.abs(values).max() >= 1e3:
        factor, unit = (
            (1e9, "GPa")
            if np.abs(values).max() >= 1e9
            else (1e6, "MPa")
            if np.abs(values).max() >= 1e6
            else (1e3, "kPa")
        )
        values = values / factor
    return values, title if unit in ("1", "") else f"{title} ({unit})", []


def _near(x: np.ndarray[Any, Any], first: float, latlon: bool) -> np.ndarray[Any, Any]:
    """Put longitudes on one branch, so that no track runs around the globe at its seam."""
    return np.asarray(x - 360.0 * np.round((x - first) / 360.0)) if latlon else x


def _box(x: np.ndarray[Any, Any], y: np.ndarray[Any, Any], latlon: bool) -> Box:
    """Return the extent of all tracks with a margin, of a shape that fills its panel."""
    west, east, south, north = np.nanmin(x), np.nanmax(x), np.nanmin(y), np.nanmax(y)
    stretch = np.cos(np.radians(0.5 * (south + north))) if latlon else 1.0
    wide, high = max((east - west) * stretch, 1e-9), max(north - south, 1e-9)
    wide, high = max(wide, 0.85 * high), max(high, 0.95 * wide)
    half_x, half_y = 0.56 * wide / stretch, 0.56 * high
    x0, y0 = 0.5 * (west + east), 0.5 * (south + north)
    return Box(x0 - half_x, x0 + half_x, y0 - half_y, y0 + half_y)
