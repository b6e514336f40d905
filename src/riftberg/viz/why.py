"""Figure of the reasons of a break-up: forces on the parts, load across the cut over time, first bonds to fail."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.units import area_text, minute_text
from riftberg.diagnostics.cut import Breakup, FirstBond
from riftberg.diagnostics.why import Reasons
from riftberg.viz import colours, style
from riftberg.viz.style import new_figure, save_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN: Final = 4
"""Break-ups in one picture."""

SIDES: Final = ("fragment", "rest")
"""The two parts that the cut parts."""


def draw_reasons(reasons: Reasons, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw one row of panels for each of the first `SHOWN` break-ups.

    Parameters
    ----------
    reasons : Reasons
        From `riftberg.diagnostics.why.explain`.
    path : path
        Picture; the ending decides on the format.
    dpi : int, optional
        Resolution.
    """
    style.check_format(path)
    shown = reasons.breakups[:SHOWN]
    figure = new_figure(15.0, 4.3 * len(shown) + 1.5 if shown else 2.2, dpi)
    if shown:
        grid = figure.subplots(len(shown), 3, squeeze=False, width_ratios=(0.9, 1.2, 1.0))
        for axes, breakup in zip(grid, shown, strict=True):
            for ax, draw in zip(axes, (_draw_forces, _draw_load, _draw_first_bonds), strict=True):
                draw(ax, breakup)
        style.letters(list(grid.flat))
        _legend(figure, shown)
    else:
        figure.text(0.5, 0.3, "nothing broke off", ha="center", fontsize=12)
    forcing = f"\nForcing: {reasons.forcing}" if reasons.forcing else ""
    melted = "".join(f"\n{line}" for line in reasons.melt[:1])
    style.put_title(figure, f"{reasons.experiment or 'Iceberg'}: why it broke{forcing}{melted}")
    return save_figure(figure, path)


def _legend(figure: Figure, shown: Sequence[Breakup]) -> None:
    """Explain colours and lines once, below all panels."""
    from matplotlib.lines import Line2D

    shades = _shades(shown[0])
    acting = [n for n in shades if any(math.hypot(*b.budgets[k].forces[n]) > 0.0 for b in shown for k in SIDES)]
    handles = [Line2D([], [], color=shades[name], lw=2.4, label=name) for name in acting]
    handles += [
        Line2D([], [], color="black", lw=2.4, label="other part of the berg (arrows), all forces (curves)"),
        Line2D([], [], color=colours.STRENGTH, lw=2.4, label="arrow: on the fragment"),
        Line2D([], [], color=colours.STRENGTH, lw=1.2, ls="--", label="arrow: on an equal mass of the rest"),
    ]
    figure.legend(handles=handles, fontsize=8, loc="outside lower left", ncols=6, frameon=False)


def _shades(b: Breakup) -> dict[str, str]:
    """Return one colour for each force, the same in all panels."""
    return colours.force_colours(b.budgets["fragment"].forces)


def _draw_forces(ax: Axes, b: Breakup) -> None:
    """Draw the forces on fragment and rest as arrows from one point each."""
    shades, reach = _shades(b), 0.0
    for k, name in enumerate(SIDES):
        budget = b.budgets[name]
        vectors: list[tuple[Any, str]] = [(f, shades[n]) for n, f in budget.forces.items() if math.hypot(*f) > 0.0]
        if budget.residual is not None:
            vectors.append((budget.residual, "black"))
        # On the rest as much of them as acts on a mass like that of the fragment: else its arrows would hide the others.
        share = b.budgets["fragment"].mass / budget.mass / 1e9
        drawn = [(np.array(force) * share, colour) for force, colour in vectors]
        reach = max(reach, *(float(np.hypot(*v)) for v, _ in drawn))
        for vector, colour in drawn:
            ax.annotate("", xy=(vector[0], vector[1]), xytext=(0.0, 0.0),
                        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.4 if k == 0 else 1.2,
                                    "ls": "-" if k == 0 else "--", "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    reach = 1.15 * (reach or 1.0)
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal", adjustable="box")
    ax.axhline(0.0, color=colours.GRID, lw=0.6, zorder=0)
    ax.axvline(0.0, color=colours.GRID, lw=0.6, zorder=0)
    ax.set_title(f"forces at {minute_text(b.decisive.time)}", fontsize=9)
    size = area_text(1e6 * b.area_km2, squared="²")
    ax.set_ylabel(f"{b.name or f'fragment {b.fragment}'}, {size}\nforce to the north (GN)", fontsize=9)
    ax.set_xlabel("force to the east (GN)", fontsize=9)
    ax.tick_params(labelsize=7)


def _draw_load(ax: Axes, b: Breakup) -> None:
    """Draw the shares of the forces in the nominal stress of the cut, until the break."""
    hours = [_hours(load.time, b.time) for load in b.history]
    for name, shade in _shades(b).items():
        values = np.array([load.stress[name] for load in b.history]) / 1e3
        if np.abs(values).max() > 0.0:
            ax.plot(hours, values, color=shade, lw=1.5, label=name)
    ax.plot(hours, [load.nominal / 1e3 for load in b.history], color="black", lw=2.2, label="all")
    ax.axvline(_hours(b.first_break, b.time), color=colours.GROUND, ls=":", lw=1.2)
    ax.text(_hours(b.first_break, b.time), 0.98, "first bond ", color=colours.GROUND, fontsize=7, ha="right", va="top",
            transform=ax.get_xaxis_transform())  # fmt: skip
    ax.axhline(0.0, color=colours.ZERO, lw=0.6)
    ax.set_title(f"load of the cut of {b.decisive.cut_km:.3g} km, by force", fontsize=9)
    ax.set_ylabel("nominal stress (kPa)", fontsize=9)
    ax.set_xlabel(f"hours from {minute_text(b.time)}", fontsize=9)
    ax.tick_params(labelsize=8)


def _draw_first_bonds(ax: Axes, b: Breakup) -> None:
    """Draw the stress of the first bonds to fail until they fail."""
    strength = b.first_bonds[0].strength / 1e3
    names = _failures([bond.time for bond in b.first_bonds])
    for k, bond in enumerate(b.first_bonds):
        end = _hours(bond.time, b.time)
        hours = [*(end + h for h in bond.hours), end]
        stress = [*(s / 1e3 for s in bond.peak or bond.tension), bond.strength / 1e3]
        ax.plot(hours, stress, lw=1.4, color=str(0.12 + 0.15 * k), label=names[k])
        if _differs(bond):
            ax.plot(hours[:-1], [s / 1e3 for s in bond.tension], lw=0.8, ls=":", color=str(0.12 + 0.15 * k))
        ax.plot(end, bond.strength / 1e3, "x", color=colours.GROUND, ms=7, mew=1.8)
    ax.axhline(strength, color=colours.STRENGTH, ls="--", lw=1.0)
    ax.text(0.01, strength, "strength", fontsize=7, va="bottom", transform=ax.get_yaxis_transform())
    if any(map(_differs, b.first_bonds)):
        ax.plot([], [], lw=0.8, ls=":", color="black", label="at the records")
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, title="bonds, by time of failure",
              title_fontsize=7)  # fmt: skip
    which = "largest tensile stress between records (kPa)" if b.first_bonds[0].peak else "tensile stress (kPa)"
    ax.set_ylabel(which, fontsize=9)
    ax.set_title("the first bonds to fail", fontsize=9)
    ax.set_xlabel(f"hours from {minute_text(b.time)}", fontsize=9)
    ax.tick_params(labelsize=8)


def _differs(bond: FirstBond) -> bool:
    """Whether the stress at the records is another than the largest between them, as it is where it rings."""
    return bool(bond.peak) and not np.allclose(bond.peak, bond.tension, rtol=0.02, atol=0.01 * bond.strength)


def _failures(times: Sequence[str]) -> list[str]:
    """Return the times at which bonds failed: to the second where minutes are alike, and the order where seconds are too."""
    minutes = [minute_text(time)[5:] for time in times]
    if len(set(minutes)) == len(times):
        return minutes
    seconds = [str(np.datetime64(time, "s"))[5:].replace("T", " ") for time in times]
    return seconds if len(set(seconds)) == len(times) else [f"{k + 1}: {text}" for k, text in enumerate(seconds)]


def _hours(text: str, end: str) -> float:
    return float((np.datetime64(text) - np.datetime64(end)) / np.timedelta64(1, "s")) / 3600.0
