"""Figure of a verification: errors by lead time beside the baselines, coverage, ranks, and the probability of break-up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from riftberg.viz import style


def draw_verification(result: dict[str, Any], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw what `riftberg.verification.forecast.report` returns."""
    style.check_format(path)
    figure = style.new_figure(11.5, 7.5, dpi)
    axes = figure.subplot_mosaic([["score", "coverage"], ["ranks", "broken"]])
    rows = result["with_error"]
    days = [row["lead_days"] for row in rows]

    a = axes["score"]
    for key, label in (
        ("energy_km", "energy score"),
        ("crps_along_km", "CRPS along"),
        ("crps_across_km", "CRPS across"),
    ):
        a.plot(days, [row.get(key, np.nan) for row in rows], marker="o", ms=4, label=label)
    for name, others in result["baselines"].items():
        score = [other.get("energy_km", other["error_of_mean_km"]) for other in others]
        a.plot([other["lead_days"] for other in others], score, ls="--", lw=1.2, label=name)
    a.set(xlabel="days after the start", ylabel="km", ylim=(0.0, None))
    a.set_title("Score of the position (small is good)", fontsize=10)
    a.legend(fontsize=8)

    a = axes["coverage"]
    for level, colour in (("50%", "tab:blue"), ("90%", "tab:orange")):
        a.plot(
            days,
            [row.get(f"inside_{level}", np.nan) for row in rows],
            "o-",
            ms=4,
            color=colour,
            label=f"in the {level} area",
        )
        a.axhline(float(level[:-1]) / 100.0, color=colour, ls=":", lw=1.0)
    a.plot(days, [row.get("spread_over_error", np.nan) for row in rows], "k.-", lw=1.0, label="spread / error")
    a.axhline(1.0, color="black", ls=":", lw=1.0)
    a.set(xlabel="days after the start", ylim=(0.0, None))
    a.set_title("Coverage and spread (dotted: reliable)", fontsize=10)
    a.legend(fontsize=8)

    a = axes["ranks"]
    for k, axis in enumerate(("along", "across")):
        counts = [row[f"ranks_{axis}"] for row in rows if f"ranks_{axis}" in row]
        if counts and len({len(row) for row in counts}) == 1:
            total = np.sum(counts, axis=0)
            place = (np.arange(len(total)) + 0.3 + 0.4 * k) / len(total)
            a.bar(place, total, 0.38 / len(total), label=axis)
            a.axhline(total.mean(), color="black", ls=":", lw=1.0)
    a.set(xlabel="part of the members below the observation", ylabel="observations", xlim=(0.0, 1.0))
    a.set_title("Ranks (dotted: reliable)", fontsize=10)
    if a.patches:
        a.legend(fontsize=8)

    a = axes["broken"]
    a.set(xlabel="days after the start", ylabel="probability", ylim=(-0.03, 1.03))
    a.set_title("Broken", fontsize=10)
    for one in result["forecasts"]:
        if one["broken"]:
            day = np.array([row["day"] for row in one["broken"]])
            p = np.array([row["probability"] for row in one["broken"]])
            low, high = np.array([row["interval"] for row in one["broken"]]).T
            (line,) = a.plot(day, p, "o-", ms=4, label=one["berg"])
            a.fill_between(day, low, high, color=line.get_color(), alpha=0.2, lw=0)
            a.plot(day, [float(row["occurred"]) for row in one["broken"]], "x", color=line.get_color())
    if a.lines:
        a.legend(fontsize=8, title="crosses: observed", title_fontsize=8)
    else:
        a.text(0.5, 0.5, "not asked for (--broken, --whole-until)", ha="center", transform=a.transAxes, fontsize=9)
    for a in axes.values():
        style.plain_axes(a)
    return style.save_figure(figure, path)
