"""Pictures of inputs: what each does to the results, and what a calibration makes of them beside what was seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from riftberg.state import Floats
from riftberg.viz import colours, style

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
    for row in range(count):
        for column in range(count):
            ax = grid[row, column]
            if column > row:
                ax.axis("off")
                ax.text(0.5, 0.5, f"{float(ds['correlation'][row, column]):+.2f}", ha="center", va="center",
                        fontsize=9, color=colours.STRENGTH, transform=ax.transAxes)  # fmt: skip
                continue
            ends = np.array([members[:, column].min(), members[:, column].max()])
            ax.set_xlim(*ends)
            if row == column:
                _one(ax, ds, row, samples[:, row], weight, ends)
            else:
                ax.set_ylim(members[:, row].min(), members[:, row].max())
                ax.plot(members[out, column], members[out, row], ".", ms=3, color=colours.ZERO, label="ruled out")
                ax.plot(
                    members[~out, column], members[~out, row], ".", ms=4, color=colours.MODEL, label="not ruled out"
                )
                chosen = np.random.default_rng(1).choice(len(weight), 300, p=weight)
                ax.plot(
                    samples[chosen, column],
                    samples[chosen, row],
                    ".",
                    ms=2,
                    alpha=0.6,
                    color=colours.STRESS_LINE,
                    label="after",
                )
            unit = "" if units[column] == "1" else f", {units[column]}"
            if row == count - 1:
                ax.set_xlabel(f"{names[column]}{unit}", fontsize=8)
            if column == 0 and row > 0:
                ax.set_ylabel(names[row] + ("" if units[row] == "1" else f", {units[row]}"), fontsize=8)
            ax.tick_params(labelsize=7)
            style.plain_axes(ax)
    if count > 1:
        grid[1, 0].legend(fontsize=6, loc="best", markerscale=2.0)
    left = f"{100 * float(ds['wave_left'].values[-1]):.3g} % of the distributions are not ruled out"
    style.put_title(figure, f"{ds.attrs['title']}: {left}")
    style.lay_out(figure)
    return style.save_figure(figure, path)


def _one(ax: Any, ds: xr.Dataset, k: int, values: Floats, weight: Floats, ends: Floats) -> None:
    """Draw one input: its distribution as drawn in the first wave, that after, and the likeliest value."""
    edges = np.linspace(float(ends[0]), float(ends[1]), BINS + 1)
    first = ds["member_value"].values[ds["member_wave"].values == 1, k]
    ax.hist(first, edges, density=True, color=colours.ICE, label="before")
    known = bool(ds["known"][k])
    ax.hist(values, edges, weights=weight, density=True, histtype="step", lw=1.4,
            color=colours.STRESS_LINE if known else colours.STRENGTH, label="after")  # fmt: skip
    if known:
        ax.axvline(float(ds["likeliest"][k]), color=colours.OBSERVED, lw=0.8, ls="--", label="likeliest")
    else:
        ax.set_title("unknown", fontsize=8)
    ax.set_yticks([])
    if k == 0:
        ax.legend(fontsize=6, loc="upper right")


def draw_predictive(ds: xr.Dataset, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw what was observed (0, with its error) beside the members of the first wave and what follows from the inputs after."""
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
        place = np.arange(len(rows))
        spread = ds["member_result"].values[first][:, rows]
        ax.plot(np.tile(place, (len(spread), 1)).T, spread.T, color=colours.ZERO, lw=0.6, marker=".", ms=3)
        low, middle, high = (ds[f"predicted_{end}"].values[rows] for end in ("low", "median", "high"))
        ax.errorbar(place - 0.08, middle, np.maximum([middle - low, high - middle], 0.0), fmt="o", ms=4, capsize=3,
                    color=colours.STRESS_LINE, label="after, 90 %")  # fmt: skip
        ax.errorbar(place + 0.08, np.zeros(len(rows)), 1.645 * ds["error"].values[rows], fmt="s", ms=4, capsize=3,
                    color=colours.OBSERVED, label="observed, with the error of observation and model")  # fmt: skip
        shown = np.r_[low, high, 3.0 * ds["error"].values[rows], -3.0 * ds["error"].values[rows]]
        ax.set_ylim(1.1 * shown.min() - 0.1, 1.1 * shown.max() + 0.1)
        labels = [names[k].partition(",")[0].removesuffix(f" {word}").removesuffix(" 00:00") for k in rows]
        ax.set_xticks(place, [label[5:] if label[:2] == "20" else label for label in labels], fontsize=7)
        ax.set_xlim(-0.5, len(rows) - 0.5)
        ax.set_ylabel(heads[word], fontsize=8)
        style.plain_axes(ax)
    axes[0].legend(fontsize=7, loc="upper left")
    style.put_title(figure, f"{ds.attrs['title']}; grey: members of the first wave")
    style.lay_out(figure)
    return style.save_figure(figure, path)


def draw_sensitivity(found: xr.Dataset, path: str | Path, *, title: str = "", dpi: int = 150) -> Path:
    """Draw what `riftberg.ensembles.sensitivity.indices` returns: one panel for each result, one bar for each input."""
    style.check_format(path)
    names = found["result"].values.tolist()
    inputs = found["input"].values.tolist()
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = style.new_figure(4.0 + 2.9 * columns, rows * (1.2 + 0.24 * len(inputs)) + 0.5, dpi)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    place = np.arange(len(inputs))
    for k, ax in enumerate(grid.flat):
        if k >= len(names):
            ax.axis("off")
            continue
        row = found.isel(result=k)
        unit = "" if row["unit"].item() == "1" else f", {row['unit'].item()}"
        label, head = f"mean change{unit}", names[k]
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
                ax.barh(place, value, 0.7 if word != "alone" else 0.4, color=colour, label=word or None)
                ax.errorbar(value, place, xerr=reach, fmt="none", ecolor=colours.OBSERVED, elinewidth=0.8)
        if len(keys) > 1 and k == 0:
            ax.legend(fontsize=7, loc="lower right")
        ax.axvline(0.0, color=colours.ZERO, lw=0.8)
        ax.set_title(head, fontsize=9)
        ax.set_xlabel(label, fontsize=8)
        ax.set_yticks(place, inputs)
        ax.set_ylim(len(inputs) - 0.4, -0.6)
        style.plain_axes(ax)
    style.put_title(figure, f"{title}; lines: 90 % intervals" if title else "Lines: 90 % intervals")
    style.lay_out(figure)
    return style.save_figure(figure, path)
