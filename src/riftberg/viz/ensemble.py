"""Pictures of ensembles: a sweep, a forecast, the effects of inputs, and their calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from riftberg.config.units import area_text, count_text
from riftberg.config.values import required
from riftberg.errors import InputError
from riftberg.plane import ellipses, ranges
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.panels import Map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ---- sweeps: where the largest pieces went, when they broke, and the rest ----------------------------------------------

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
    finished, missing = result.isel(member=(result["status"] == 0).values), int((result["status"] != 0).sum())
    figure = style.new_figure(13.5, 7.2, dpi)
    axes = figure.subplot_mosaic([["tracks", "dates"], ["tracks", "sizes"]], width_ratios=(0.55, 0.45))
    names = [str(name) for name in finished.coords if "parameter" in finished[name].attrs]
    x, label, words = _scale(finished, names[0])
    # A second parameter is shown by colour; with one alone the colour shows that one.
    shade, shade_label, shade_words = _scale(finished, names[min(1, len(names) - 1)])
    scale = _colour_scale(shade)
    shades = np.asarray(scale.to_rgba(shade))
    bar = style.colour_bar(list(axes.values()), scale, shade_label, location="right", shrink=1.0, aspect=50)
    if shade_words:
        bar.set_ticks(range(len(shade_words)), labels=shade_words)
    chart, ice = _draw_members(axes["tracks"], finished, shades)
    distinct = np.unique(x)
    spread = x
    if len(names) > 1 and len(distinct) > 1:  # members of one value stand side by side, so that all are seen
        spread = x + (bar.norm(shade) - 0.5) * 0.35 * float(np.diff(distinct).min())
    _draw_breakups(axes["dates"], finished, spread, shades)
    area = finished["largest_area"].values / 1e6
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
    style.letters(list(axes.values()))
    note = f"{finished.sizes['member']} runs" + (
        f", {missing} more failed, unfinished or not yet run" if missing else ""
    )
    style.put_title(figure, f"{str(finished.attrs.get('title', 'Sweep')).split(':')[0]}, {note}", size=13.0)
    style.lay_out(figure)
    chart.draw_place(*ice)
    return style.save_figure(figure, path)


def _colour_scale(values: Array) -> Any:
    """Return the scale of colours of values."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    low, high = float(values.min()), float(values.max())
    shades = ListedColormap(colormaps["viridis"](np.linspace(*SHADES, 256)))
    return ScalarMappable(Normalize(low, high if high > low else low + 1.0), shades)


def _draw_members(ax: Axes, finished: xr.Dataset, shades: Array) -> tuple[Map, tuple[Array, Array]]:
    """Draw where the pieces of each member were at each time, the largest one full; return the map and the positions on it."""
    latlon = "lat" in finished
    x_name, y_name = ("lon", "lat") if latlon else ("x", "y")
    lon, lat, area = (finished[name].values for name in (x_name, y_name, "area"))
    chart = Map.around(ax, lon, lat, latlon=latlon)
    x, y = chart.placed(lon, lat)
    for k, colour in enumerate(shades):
        # The largest at any time: at the end it may have melted away or broken up.
        largest = int(np.argmax(np.nanmax(np.nan_to_num(area[k]), axis=1)))
        for piece in range(x.shape[1]):
            main = piece == largest
            ax.plot(
                *style.insert_gaps(x[k, piece], y[k, piece], area[k, piece]), color=colour, lw=1.4 if main else 0.6,
                ls="-" if main else (0, (3, 1.5)), alpha=0.9 if main else 0.6, solid_capstyle="round", zorder=5,
            )  # fmt: skip
        born = finished["fragment_parent"].values[k] > 0
        births = chart.placed(*(finished[f"fragment_{name}"].values[k][born] for name in (x_name, y_name)))
        ax.plot(*births, ls="", marker="*", ms=7, mec="white", mew=0.4, color=colour, zorder=6)
    chart.draw_scale()
    ax.set_title("Tracks (dashed: of fragments, from a star where they broke off)", fontsize=10, pad=6)
    return chart, (x, y)


def _draw_breakups(ax: Axes, finished: xr.Dataset, x: Array, shades: Array) -> None:
    """Draw the dates of the break-ups of each member, larger for larger pieces."""
    # One without a parent is a whole berg, and broke off nothing.
    births, broke = finished["fragment_birth_time"].values, finished["fragment_parent"].values > 0
    sizes = finished["fragment_area"].values / 1e6
    most = float(sizes[broke].max(initial=0.0)) or 1.0
    for k, colour in enumerate(shades):
        size = 12.0 + 120.0 * sizes[k][broke[k]] / most
        ax.scatter(np.full(broke[k].sum(), x[k]), births[k][broke[k]], s=size, color=colour, ec="white", lw=0.5)
    times = finished["time"].values
    # Where the start is varied, the dates belong to member 0.
    after = finished["start_after"].values if "start_after" in finished.coords else np.zeros(1)
    first, last = (np.timedelta64(round(1e9 * float(end)), "ns") for end in (after.min(), after.max()))
    ax.set_ylim(times[0] + first, times[-1] + last)
    style.date_axis(ax, "y")
    largest = f"largest dot {area_text(1e6 * most, squared='²')}" if broke.any() else "none broke"
    ax.set_title(f"Break-ups ({largest})", fontsize=10, pad=6)


def _scale(finished: xr.Dataset, name: str) -> tuple[Array, str, list[str]]:
    """Return a parameter as numbers for an axis, the label of that axis, and its words where it has no numbers."""
    variable = finished[name]
    title = style.spell_name(str(variable.attrs["parameter"]))
    if variable.dtype.kind in "OUST":
        words = list(dict.fromkeys(str(value) for value in variable.values))
        return np.array([words.index(str(value)) for value in variable.values], dtype=float), title, words
    values, unit = np.asarray(variable.values, dtype=float), str(variable.attrs.get("units", "1"))
    largest = np.abs(values).max()
    if unit == "Pa" and largest >= 1e3:
        factor, unit = next(pair for pair in ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")) if largest >= pair[0])
        values = values / factor
    return values, title if unit in ("1", "") else f"{title} ({unit})", []


# ---- forecasts: where the ice will be, how likely it breaks and grounds, and where it breaks ------------------------------

BROKEN, GROUND = colours.STRESS_LINE, colours.FRAGMENTS[5]
"""Colours of the probabilities of a break-up and of the ground."""


MOST_TRACKS: Final = 200
"""Members of a forecast whose tracks are shown, evenly over all; probabilities are of all."""

LEAST_WEIGHT: Final = 0.01
"""Members with less than this part of the largest weight are not drawn: sightings speak against them."""


def choose_tracks(result: xr.Dataset) -> Array:
    """Return the members of a forecast whose tracks are drawn."""
    weight = np.where(result["status"].values == 0, result["weight"].values, 0.0)
    count = np.flatnonzero(weight > LEAST_WEIGHT * weight.max())
    chosen: Array = count[np.unique(np.linspace(0, count.size - 1, min(count.size, MOST_TRACKS)).astype(int))]
    return chosen


def draw_forecast(result: xr.Dataset, path: str | Path, *, notes: Sequence[str] = (), dpi: int = 150) -> Path:
    """Draw a forecast: presence and tracks with the control, probabilities by date, cracks in the berg.

    ``notes``: lines above the cracks, such as the likeliest scenarios.
    """
    if "presence" not in result:
        raise InputError("no forecast in degrees", where="draw_forecast", remedy="Give the result of riftberg forecast")
    style.check_format(path)
    figure = style.new_figure(14.0, 8.0, dpi)
    axes = figure.subplot_mosaic([["map", "dates"], ["map", "cracks"]], width_ratios=(0.56, 0.44))
    shades, finish = _draw_presence(axes["map"], result)
    style.colour_bar([axes["map"]], shades, "probability that ice passes over", shrink=0.9)
    _draw_dates(axes["dates"], result)
    cracks = _draw_cracks(axes["cracks"], result, notes)
    style.colour_bar([axes["cracks"]], cracks, "probability of a crack", location="right", shrink=1.0, aspect=25)
    style.letters(list(axes.values()))
    finished, count = int((result["status"] == 0).sum()), float(result.attrs.get("effective_members", np.inf))
    members = count_text(finished, "member") + (f", {count:.1f} of them count" if count < 0.995 * finished else "")
    unfinished = int((result["status"] == 3).sum())
    members += f", {unfinished} more unfinished" if unfinished else ""
    name = Path(str(result.attrs.get("experiment", "Forecast"))).stem
    style.put_title(figure, f"{name}: {members}, {style.span_text(result['time'].values)}", size=13.0)
    style.lay_out(figure)
    finish()
    return style.save_figure(figure, path)


def _draw_presence(ax: Axes, result: xr.Dataset) -> tuple[Any, Callable[[], None]]:
    """Draw where ice passes, tracks of the largest pieces, the control, ellipses; return shades, and a last step to draw."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    cells = np.meshgrid(result["cell_lon"].values, result["cell_lat"].values)
    chart = Map.around(ax, *cells, margin=0.04)
    shades = ListedColormap(colormaps["YlOrRd"](np.linspace(0.05, 0.85, 10)))
    image = ax.pcolormesh(
        *chart.placed(*cells), np.ma.masked_less(result["passes"].values, 0.005), cmap=shades, vmin=0.0, vmax=1.0,
        zorder=1.5,
    )  # fmt: skip
    tracks = [result[name].isel(fragment=0, member=choose_tracks(result)).values for name in ("lon", "lat")]
    width = min(1.0, max(0.4, 20.0 / max(1, len(tracks[0]))))  # a few tracks are seen, hundreds hide no ice
    for n, track in enumerate(zip(*tracks, strict=True)):
        label = "members" if n == 0 else None
        ax.plot(*chart.placed(*track), color=colours.STRENGTH, lw=width, alpha=0.7, zorder=4, label=label)
    if "control_lon" in result:
        control = (result[f"control_{name}"].values[0] for name in ("lon", "lat"))
        ax.plot(*chart.placed(*control), color="black", lw=1.8, zorder=6, label="control")
    in_hours = float(result["lead"].values[-1]) < 96.0  # else two of the ellipses would have one day
    lines, word = ellipses(result, 0.9), "90 % of positions"
    if not any(np.isfinite(line).all() for line in lines) and "members_west" in result:  # too few members count
        lines, word = ranges(result), "range of the members"
    steps = np.unique(np.linspace(0, result.sizes["time"] - 1, 5).astype(int))[1:]
    leads: list[tuple[str, float, float]] = []
    for n, k in enumerate(k for k in steps if np.isfinite(lines[k]).all()):
        x, y = chart.placed(*lines[k].T)
        ax.plot(x, y, color=colours.ARROW, lw=1.2, zorder=5, label=word if n == 0 else None)
        lead = result["lead"].values[k]
        east = int(np.argmax(x))  # the tracks run through the middle
        leads.append((f"{lead:.0f} h" if in_hours else f"{lead / 24:.0f} d", float(x[east]), float(y[east])))
    style.legend_above(ax, ncols=3)
    chart.draw_scale()

    def finish() -> None:
        """Draw the parts whose positions depend on the layout of the axes."""
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
    ax.set_aspect("equal", adjustable="datalim")  # a slim berg leaves no empty picture
    style.plain_axes(ax)
    ax.set_xlabel("km east of the middle at the start", fontsize=9)
    ax.set_ylabel("km north", fontsize=9)
    ax.set_title("\n".join(["Where it breaks", *notes]).replace(" km2", " km²"), fontsize=8.5, pad=6)
    return image


# ---- inputs: the effect of each on the results, and their calibration beside observations ----------------------------------

BINS = 20


def draw_posterior(ds: xr.Dataset, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw each input before and after, and each pair of them with the members of the waves."""
    style.check_format(path)
    names, units = ds["parameter"].values.tolist(), ds["unit"].values.tolist()
    count = len(names)
    figure = style.new_figure(1.2 + 2.1 * count, 1.4 + 2.0 * count, dpi)
    grid = figure.subplots(count, count, squeeze=False)
    samples, weight = ds["sample_value"].values, ds["sample_weight"].values
    members = ds["member_value"].values
    out = ds["ruled_out"].values
    chosen = np.random.default_rng(1).choice(len(weight), 300, p=weight)
    for row in range(count):
        for column in range(count):
            ax = grid[row, column]
            if column > row:
                ax.axis("off")
                ax.text(0.5, 0.5, f"r = {float(ds['correlation'][row, column]):+.2f}", ha="center", va="center",
                        fontsize=9, color=colours.STRENGTH, transform=ax.transAxes)  # fmt: skip
                continue
            ends = np.array([members[:, column].min(), members[:, column].max()])
            ax.set_xlim(*ends)
            if row == column:
                _draw_input(ax, ds, row, samples[:, row], weight, ends)
            else:
                ax.set_ylim(members[:, row].min(), members[:, row].max())
                for rows, size, colour, word in (
                    (out, 3, colours.ZERO, "ruled out"),
                    (~out, 4, colours.MODEL, "not ruled out"),
                ):
                    ax.plot(*members[rows][:, [column, row]].T, ".", ms=size, color=colour, label=word)
                ax.plot(
                    *samples[chosen][:, [column, row]].T, ".", ms=2, alpha=0.6, color=colours.STRESS_LINE, label="after"
                )
            unit = "" if units[column] == "1" else f", {units[column]}"
            if row == count - 1:
                ax.set_xlabel(f"{style.spell_name(names[column])}{unit}", fontsize=8)
            if column == 0 and row > 0:
                ax.set_ylabel(
                    style.spell_name(names[row]) + ("" if units[row] == "1" else f", {units[row]}"), fontsize=8
                )
            ax.tick_params(labelsize=7)
            style.plain_axes(ax)
    if count > 1:
        grid[1, 0].legend(fontsize=6, loc="best", markerscale=2.0)
    left = f"{100 * float(ds['wave_left'].values[-1]):.3g} % of the distributions are not ruled out"
    style.put_title(figure, f"{ds.attrs['title']}: {left}")
    style.lay_out(figure)
    return style.save_figure(figure, path)


def _draw_input(ax: Any, ds: xr.Dataset, k: int, values: Floats, weight: Floats, ends: Floats) -> None:
    """Draw one input: its distribution as drawn in the first wave, that after, and the likeliest value."""
    edges = np.linspace(float(ends[0]), float(ends[1]), BINS + 1)
    first = ds["member_value"].values[ds["member_wave"].values == 1, k]
    ax.hist(first, edges, density=True, color=colours.ICE, label="before")
    informed = bool(ds["known"][k])
    ax.hist(values, edges, weights=weight, density=True, histtype="step", lw=1.4,
            color=colours.STRESS_LINE if informed else colours.STRENGTH, label="after")  # fmt: skip
    if informed:
        ax.axvline(float(ds["likeliest"][k]), color=colours.OBSERVED, lw=0.8, ls="--", label="likeliest")
    else:
        ax.set_title("not told by what was seen", fontsize=7)
    ax.set_yticks([])
    if k == 0:
        ax.legend(fontsize=6, loc="upper right")


def draw_predictive(ds: xr.Dataset, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw observations (0, with their error) beside the members of the first wave and predictions of the inputs after."""
    style.check_format(path)
    names = ds["target"].values.tolist()
    kinds = {
        word: [k for k, name in enumerate(names) if word in name] for word in ("east", "north", "azimuth", "log margin")
    }
    kinds = {word: rows for word, rows in kinds.items() if rows}
    figure = style.new_figure(8.0, 0.6 + 2.1 * len(kinds), dpi)
    axes = figure.subplots(len(kinds), 1, squeeze=False)[:, 0]
    first = ds["member_wave"].values == 1
    heads = {"east": "model east of observed, km", "north": "model north of observed, km",
             "azimuth": "azimuth, model minus observed, degrees", "log margin": "log of the margin; 0: breaks"}  # fmt: skip
    for ax, (word, rows) in zip(axes, kinds.items(), strict=True):
        position = np.arange(len(rows))
        spread = ds["member_result"].values[first][:, rows]
        ax.plot(np.tile(position, (len(spread), 1)).T, spread.T, color=colours.ZERO, lw=0.6, marker=".", ms=3)
        low, middle, high = (ds[f"predicted_{end}"].values[rows] for end in ("low", "median", "high"))
        ax.errorbar(position - 0.08, middle, np.maximum([middle - low, high - middle], 0.0), fmt="o", ms=4, capsize=3,
                    color=colours.STRESS_LINE, label="after, 90 %")  # fmt: skip
        limits = np.r_[low, high, 3.0 * ds["error"].values[rows], -3.0 * ds["error"].values[rows]]
        ends = 1.1 * limits.min() - 0.1, 1.1 * limits.max() + 0.1
        ax.set_ylim(*ends)
        labels = [names[k].partition(",")[0].removesuffix(f" {word}").removesuffix(" 00:00") for k in rows]
        observed = {"color": colours.OBSERVED, "label": "observed, with the error of observation and model"}
        if word == "log margin":  # a berg that was whole had any margin below 0, one that was broken any above it
            for x, label in zip(position, labels, strict=True):
                ax.plot([x + 0.08] * 2, [0.0, ends[0] if label.startswith("whole") else ends[1]], lw=3.0, **observed)
        else:
            error = 1.645 * ds["error"].values[rows]
            ax.errorbar(position + 0.08, np.zeros(len(rows)), error, fmt="s", ms=4, capsize=3, **observed)
        ax.set_xticks(position, [style.reword_dates(label) for label in labels], fontsize=7)
        ax.set_xlim(-0.5, len(rows) - 0.5)
        ax.set_ylabel(heads[word], fontsize=8)
        style.plain_axes(ax)
    axes[0].legend(fontsize=7, loc="upper left")
    style.put_title(figure, f"{ds.attrs['title']}; grey: members of the first wave")
    style.lay_out(figure)
    return style.save_figure(figure, path)


def draw_sensitivity(sensitivities: xr.Dataset, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw the result of `riftberg.ensembles.sensitivity.indices`: one panel for each result, one bar for each input."""
    style.check_format(path)
    names = sensitivities["result"].values.tolist()
    inputs = sensitivities["input"].values.tolist()
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = style.new_figure(4.0 + 2.9 * columns, rows * (1.2 + 0.24 * len(inputs)) + 0.5, dpi)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    position = np.arange(len(inputs))
    for k, ax in enumerate(grid.flat):
        if k >= len(names):
            ax.axis("off")
            continue
        row = sensitivities.isel(result=k)
        unit = "" if row["unit"].item() == "1" else f", {row['unit'].item()}"
        label, head = f"mean change{unit}", style.spell_name(names[k])
        if "effect" in row and row["effect"].notnull().any():
            keys = [("effect", colours.MODEL, "")]
        elif "total" in row and row["total"].notnull().any():
            label, keys = "part of the variance", [("total", colours.ICE, "total"), ("first", colours.MODEL, "alone")]
            ax.set_xlim(0.0, max(1.0, 1.05 * float(row["total_high"].max())))
        else:
            label, keys = "rank correlation", [("correlation", colours.STRENGTH, "")]
            head += f"\nof the {100 * float(row['share']):.0f} % that have one"
            ax.set_xlim(-1.0, 1.0)
        for key, colour, word in keys:
            if key in row:
                value, low, high = (row[f"{key}{end}"].values for end in ("", "_low", "_high"))
                reach = np.maximum([value - low, high - value], 0.0)
                ax.barh(position, value, 0.7 if word != "alone" else 0.4, color=colour, label=word or None)
                ax.errorbar(value, position, xerr=reach, fmt="none", ecolor=colours.OBSERVED, elinewidth=0.8)
        if len(keys) > 1 and k == 0:
            ax.legend(fontsize=7, loc="lower right")
        ax.axvline(0.0, color=colours.ZERO, lw=0.8)
        ax.set_title(head, fontsize=9)
        ax.set_xlabel(label, fontsize=8)
        ax.set_yticks(position, [style.spell_name(name) for name in inputs])
        ax.set_ylim(len(inputs) - 0.4, -0.6)
        style.plain_axes(ax)
    head, note = (
        f"{title}; lines: 90 % intervals" if title else "Lines: 90 % intervals",
        sensitivities.attrs.get("note"),
    )
    style.put_title(figure, f"{head}\n{note}" if note else head)
    style.lay_out(figure)
    return style.save_figure(figure, path)
