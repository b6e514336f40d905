"""Figure of a sensitivity: what each input does to each result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from riftberg.viz import colours, style


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
