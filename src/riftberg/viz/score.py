"""Figures of comparisons: of a run with observations, of several runs on one map, and of an ensemble with observations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.units import area_text, minute_text
from riftberg.diagnostics.cut import Breakup, FirstBond
from riftberg.diagnostics.score import Match, Score
from riftberg.diagnostics.whole import WholeBerg
from riftberg.diagnostics.why import Reasons
from riftberg.state import Floats
from riftberg.viz import colours, style
from riftberg.viz.colours import MODEL, OBSERVED, PAIRING
from riftberg.viz.panels import Map, PolarWater, Water, depth_bar
from riftberg.viz.style import date_axis, day_text, new_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from riftberg.diagnostics.compare import ComparedRun
    from riftberg.diagnostics.observed import Fix


MARK: Final[dict[str, Any]] = {"ms": 4.5, "mec": "black", "mew": 0.5}
"""Marks of curves; the edge makes light colours stand out."""


TRACKS: Final = 0.83
"""Width over height of the map of the tracks."""

LEAST: Final = 2e4
"""Least height (m) of a map of tracks: a berg that hardly moved is not blown up to metres."""


def draw_score(score: Score, path: str | Path, *, title: str = "", water: Water | None = None, dpi: int = 150) -> Path:
    """Draw a score.

    Parameters
    ----------
    score : Score
    path : path
        Picture.
    title : str, optional
        Heading; its second line may name the forcing.
    water : Forcing or StoredWater, optional
        Gives the sea floor behind the tracks, such as `riftberg.runs.background.stored_water` of the run.
    dpi : int, optional
    """
    style.check_format(path)
    figure = new_figure(12.5, 7.6, dpi)
    rows = [(day.time, berg) for day in score.days if (berg := day.berg) is not None]
    times = np.array([time for time, _ in rows], dtype="datetime64[s]")
    matches = [match for _, match in rows]
    # Positions alone have no overlap.
    curves = _CURVES if any(match.iou is not None for match in matches) else _CURVES[:-1]
    grid = figure.add_gridspec(len(curves), 2, width_ratios=(1.0, 1.15))
    tracks = figure.add_subplot(grid[:, 0])
    axes: list[Any] = []
    for k, (label, draw) in enumerate(curves):
        axes.append(figure.add_subplot(grid[k, 1], sharex=axes[0] if axes else None))
        draw(axes[k], times, matches)
        axes[k].set_ylabel(label, fontsize=9)
        plain_axes(axes[k])
        axes[k].tick_params(labelbottom=k == len(curves) - 1)
    date_axis(axes[-1])
    style.letters([tracks, *axes])
    style.put_title(figure, title or f"Run against {score.observed}")
    _draw_tracks(figure, tracks, score, water)
    return style.save_figure(figure, path)


def _match_values(matches: Sequence[Match], name: str) -> Floats:
    return np.array([np.nan if getattr(m, name) is None else getattr(m, name) for m in matches], np.float64)


def _draw_distance(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    ax.plot(times, _match_values(berg, "distance_km"), "o-", color=MODEL, **MARK)
    ax.set_ylim(bottom=0.0)


def _draw_azimuth(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    """Draw both headings without jumps at 180 degrees, each followed from day to day, the model's from near the observed one."""
    seen, off = _match_values(berg, "azimuth_observed"), _match_values(berg, "azimuth_difference")
    is_seen = np.isfinite(seen)
    modelled = seen + off if is_seen.any() else _match_values(berg, "azimuth")
    for values, look, colour in ((seen, "s-", OBSERVED), (modelled, "o-", MODEL)):
        finite = np.isfinite(values)
        ax.plot(times[finite], np.unwrap(values[finite], period=180.0), look, color=colour, **MARK)


def _draw_area(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    ax.plot(times, _match_values(berg, "area_observed_km2"), "s-", color=OBSERVED, **MARK)
    ax.plot(times, _match_values(berg, "area_km2"), "o-", color=MODEL, **MARK)
    ax.set_ylim(0.0, 1.1 * ax.get_ylim()[1])


def _draw_overlap(ax: Axes, times: Any, berg: Sequence[Match]) -> None:
    values = _match_values(berg, "iou")
    ax.plot(times, values, "o-", color=MODEL, **MARK)
    ax.set_ylim(0.0, 1.0)


_CURVES: Final = (
    ("distance of\ncentroids (km)", _draw_distance),
    ("long axis\n(degrees from N)", _draw_azimuth),
    ("area (km²)", _draw_area),
    ("overlap (IoU)", _draw_overlap),
)


def _draw_tracks(figure: Figure, ax: Axes, score: Score, water: Water | None) -> None:
    """Draw the centroids of all pieces, model and observed, joined day by day."""
    berg = [(day.time, m) for day in score.days if (m := day.berg) is not None]
    matches = [(m, m is not day.berg) for day in score.days for m in day.matches]
    ends = [(m.lon_observed, m.lat_observed) for m, _ in matches]
    ends += [(m.lon, m.lat) for m, _ in matches if m.lon is not None and m.lat is not None]
    chart = Map.around(ax, *_columns(ends), shape=TRACKS, margin=0.08, least=LEAST, ticks=6)
    for m, other in matches:
        look: dict[str, Any] = {"ms": 3 if other else 5, "alpha": 0.5 if other else 1.0, "zorder": 5}
        seen_at = chart.placed(m.lon_observed, m.lat_observed)
        ax.plot(*seen_at, "s", color=OBSERVED, **look)
        if m.lon is not None and m.lat is not None:
            made_at = chart.placed(m.lon, m.lat)
            ax.plot([seen_at[0], made_at[0]], [seen_at[1], made_at[1]], "-", color=PAIRING, lw=0.9, zorder=4)
            ax.plot(*made_at, "o", color=MODEL, mec="black", mew=0.5, **look)
    seen = chart.placed(*_columns((m.lon_observed, m.lat_observed) for _, m in berg))
    model_positions = ((math.nan, math.nan) if m.lon is None or m.lat is None else (m.lon, m.lat) for _, m in berg)
    modelled = chart.placed(*_columns(model_positions))
    ax.plot(*seen, "s-", color=OBSERVED, ms=5, lw=1.4, label="observed", zorder=5)
    ax.plot(*modelled, "o-", color=MODEL, ms=5.5, lw=1.4, mec="black", mew=0.5, label="model", zorder=5)
    style.legend_above(ax, ncols=2)
    chart.draw_floor(water if chart.plane is None or water is None else PolarWater(water, chart.plane), shaded=True)
    chart.draw_scale()
    depth_bar(chart)
    note = "grey lines join model and observation" + (
        "; small: other pieces" if any(other for _, other in matches) else ""
    )
    ax.set_xlabel(note, fontsize=8)
    style.lay_out(figure)
    labels = style.Labels(ax)
    for line in (seen, modelled):
        for x, y in zip(*line, strict=True):
            if math.isfinite(x + y):
                labels.avoid(x, y)
        labels.prefer_off_line(*line)
    x, y = (np.concatenate([seen[k], modelled[k]]) for k in (0, 1))
    chart.draw_place(x, y, labels)
    for k in range(0, len(berg), max(1, len(berg) // 8)):
        labels.put(day_text(np.datetime64(berg[k][0]), hour=False), float(seen[0][k]), float(seen[1][k]), fontsize=8)


def draw_suite(result: Sequence[dict[str, Any]], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the tables of a suite: mean errors by lead, and below how far the reference is from staying put.

    ``result``: from `riftberg.verification.suite.tables`.
    """
    style.check_format(path)
    figure = style.new_figure(max(5.0, 4.2 * len(result)), 7.0, dpi)
    axes = figure.subplots(2, len(result), squeeze=False, sharex="col", height_ratios=(2.0, 1.0))
    for (above, below), case in zip(axes.T, result, strict=True):
        rows = [row for row in case["rows"] if row["subset"] == "all" and row["starts"]]
        days, reference = [row["lead_days"] for row in rows], case["reference"]
        for k, name in enumerate(rows[0]["entrants"] if rows else ()):
            scores, ours = [row["entrants"][name] for row in rows], name == reference
            look = (
                {"color": MODEL, "lw": 2.5, "zorder": 4}
                if ours
                else {"color": f"C{k % 10}", "ls": ("-", "--", ":")[k // 10 % 3]}
            )
            (line,) = above.plot(days, [value["mean_km"] for value in scores], marker="o", ms=3, label=name, **look)
            if name == reference and all(value["interval_km"] for value in scores):
                above.fill_between(
                    days,
                    *zip(*(value["interval_km"] for value in scores), strict=True),
                    color=line.get_color(),
                    alpha=0.2,
                )
            if name == "staying put" and name != reference:
                below.plot(days, [value["reference_minus_this_km"] for value in scores], "o-", ms=3, color=OBSERVED)
                if all(value["difference_interval_km"] for value in scores):
                    ends = zip(*(value["difference_interval_km"] for value in scores), strict=True)
                    below.fill_between(days, *ends, color=OBSERVED, alpha=0.15)
        below.axhline(0.0, color=colours.ZERO, lw=1.0)
        above.set(ylim=(0.0, None), ylabel="mean error, km")
        below.set(xlabel="days after the start", ylabel=f"{reference} minus\nstaying put, km")
        above.set_title(case["name"], fontsize=10)
        for ax in (above, below):
            plain_axes(ax)
            ax.set_xticks(days, [f"{day:.3g}" for day in days])
        above.legend(fontsize=6, framealpha=0.6)
    return style.save_figure(figure, path)


def draw_verification(result: dict[str, Any], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the result of `riftberg.verification.forecast.report`."""
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
        a.plot([other["lead_days"] for other in others], score, ".--", lw=1.2, label=name)
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
            position = (np.arange(len(total)) + 0.3 + 0.4 * k) / len(total)
            a.bar(position, total, 0.38 / len(total), label=axis)
            a.axhline(total.mean(), color="black", ls=":", lw=1.0)
    a.set(xlabel="part of the members below the observation", ylabel="observations", xlim=(0.0, 1.0))
    a.set_title("Ranks (dotted: reliable)", fontsize=10)
    if a.patches:
        a.legend(fontsize=8)
    else:
        a.text(0.5, 0.5, "too few members", ha="center", transform=a.transAxes, fontsize=9)

    a = axes["broken"]
    a.set(xlabel="days after the start", ylabel="probability", ylim=(-0.03, 1.03))
    a.set_title("Broken", fontsize=10)
    for forecast in result["forecasts"]:
        if forecast["broken"]:
            day = np.array([row["day"] for row in forecast["broken"]])
            p = np.array([row["probability"] for row in forecast["broken"]])
            low, high = np.array([row["interval"] for row in forecast["broken"]]).T
            (line,) = a.plot(day, p, "o-", ms=4, label=forecast["berg"])
            a.fill_between(day, low, high, color=line.get_color(), alpha=0.2, lw=0)
            a.plot(day, [float(row["occurred"]) for row in forecast["broken"]], "x", color=line.get_color())
    if a.lines:
        a.legend(fontsize=8, title="crosses: observed", title_fontsize=8)
    else:
        a.text(0.5, 0.5, "not asked for (--broken, --whole-until)", ha="center", transform=a.transAxes, fontsize=9)
    for a in axes.values():
        style.plain_axes(a)
    for name in ("score", "coverage"):
        axes[name].set_xlim(0.0, max(days) + 0.5)
    return style.save_figure(figure, path)


def draw_compared(runs: Sequence[ComparedRun], fixes: Sequence[Fix], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the tracks, with the dates of the first run, the places of break-ups, and the observed track."""
    style.check_format(path)
    first = runs[0].course
    figure = style.new_figure(7.0, 8.2, dpi)
    ax = figure.subplots()
    seen_at = _columns((fix.lon, fix.lat) for fix in fixes)
    x, y = (
        np.concatenate(columns)
        for columns in zip(*((run.course.x, run.course.y) for run in runs), seen_at, strict=True)
    )
    panel = Map.around(
        ax, x, y, latlon=first.latlon, radius=first.radius, shape=0.95, margin=0.08, least=LEAST, ticks=6
    )  # fmt: skip
    lines = [panel.placed(run.course.x, run.course.y) for run in runs]
    births = [panel.placed(*_columns((e["lon"], e["lat"]) for e in run.course.births)) for run in runs]
    seen = panel.placed(*seen_at)
    for k, (run, (east, north), born) in enumerate(zip(runs, lines, births, strict=True)):
        colour = colours.FRAGMENTS[k % len(colours.FRAGMENTS)]
        ax.plot(*style.insert_gaps(east, north, run.course.area), color=colour, lw=2.0, zorder=7, label=run.name)
        ax.plot(east[-1], north[-1], "s", color=colour, mec="black", ms=6, zorder=8)
        ax.plot(*born, "*", color=colour, mec="black", ms=12, ls="", zorder=9)
    labels = style.Labels(ax)
    records = [k for k in np.linspace(0, first.times.size - 1, min(6, first.times.size)).astype(int)]
    ax.plot(*(a[records] for a in lines[0]), "o", mfc="white", mec="black", ms=5, ls="", zorder=8,
            label=f"dates of {runs[0].name}")  # fmt: skip
    ax.plot([], [], "s", color="white", mec="black", ms=6, ls="", label="end")
    if any(born[0].size for born in births):
        ax.plot([], [], "*", color="white", mec="black", ms=11, ls="", label="place of a break-up")
    if seen[0].size:
        ax.plot(*seen, "x:", color=colours.OBSERVED, ms=6, lw=1.0, zorder=7.5, label="observed")
    panel.draw_scale()
    figure.legend(fontsize=8, loc="outside lower left", ncols=3, frameon=False)
    berg = f"{first.berg}: " if first.berg else ""
    style.put_title(figure, f"{berg}{', '.join(run.name for run in runs)}\n{style.span_text(first.times)}")
    style.lay_out(figure)
    labels.prefer_off_line(*lines[0])
    for x, y in (position for born in births for position in zip(*born, strict=True)):
        labels.avoid(float(x), float(y), 7.0)
    x, y = (np.concatenate([line[k] for line in (*lines, seen)]) for k in (0, 1))
    panel.draw_place(x, y, labels)
    for k, text in zip(records, style.moment_texts(first.times, records, hour=False), strict=True):
        labels.put(text, float(lines[0][0][k]), float(lines[0][1][k]), fontsize=9)
    return style.save_figure(figure, path)


def _columns(positions: Iterable[tuple[float, float]]) -> tuple[Floats, Floats]:
    pairs = np.array(list(positions), np.float64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


SHOWN: Final = 4
"""Break-ups in one picture."""

SIDES: Final = ("fragment", "rest")
"""The two parts that the cut parts."""


def draw_reasons(reasons: Reasons, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw one row of panels for each of the first `SHOWN` break-ups.

    Parameters
    ----------
    reasons : Reasons
        From `riftberg.explain`.
    path : path
        Picture; the ending decides on the format.
    dpi : int, optional
        Resolution.
    """
    style.check_format(path)
    drawn, whole_berg = reasons.breakups[:SHOWN], reasons.whole
    figure = new_figure(15.0, 4.3 * len(drawn) + 1.5 if drawn else 7.5, dpi)
    if drawn:
        grid = figure.subplots(len(drawn), 3, squeeze=False, width_ratios=(0.9, 1.2, 1.0))
        for axes, breakup in zip(grid, drawn, strict=True):
            for ax, draw in zip(axes, (_draw_forces, _draw_load, _draw_first_bonds), strict=True):
                draw(ax, breakup)
        style.letters(list(grid.flat))
        _legend(figure, drawn)
    elif whole_berg is not None:
        _draw_whole(figure, whole_berg)
    forcing = f"\nForcing: {reasons.forcing}" if reasons.forcing else ""
    melted = "".join(f"\n{line}" for line in reasons.melt[:1])
    why = "why it broke" if drawn else "why it stayed whole, what drove and braked it"
    style.put_title(figure, f"{reasons.experiment or 'Iceberg'}: {why}{forcing}{melted}")
    return save_figure(figure, path)


def _draw_whole(figure: Figure, berg: WholeBerg) -> None:
    """Draw how near a berg came to breaking, how fast it went, and the forces on it, over time; red where it was aground."""
    axes = list(figure.subplots(3 if berg.used else 2, 1, sharex=True, squeeze=False)[:, 0])
    times, moments = (np.array(texts, "datetime64[s]") for texts in (berg.times, berg.moments))
    stress, speed, forces = axes if berg.used else (None, *axes)
    if stress is not None and berg.nearest is not None:
        ratio = berg.nearest.stress / berg.nearest.strength if berg.nearest.strength else 0.0
        stress.plot(times, berg.used, color=colours.STRESS_LINE, lw=1.4, label="of the bond nearest to breaking")
        stress.plot(
            np.datetime64(berg.nearest.time), ratio, "o", color=colours.STRESS_LINE, mec="black", label="nearest"
        )
        stress.axhline(1.0, color=colours.STRENGTH, ls="--", lw=1.0, label="strength")
        stress.set_ylabel("largest tensile stress\nover strength", fontsize=9)
        style.legend_above(stress, ncols=3)
    speed.plot(moments, berg.speed, color=MODEL, **MARK)
    speed.set_ylabel("speed (m s$^{-1}$)", fontsize=9)
    shades = colours.force_colours(berg.forces)
    for name, sizes in berg.forces.items():
        if any(sizes):
            forces.plot(moments, np.array(sizes) / 1e9, color=shades[name], lw=1.5, label=name)
    forces.set_ylabel("force (GN)", fontsize=9)
    # A berg that stands still moves by micrometres: the scale does not blow them up.
    speed.set_ylim(top=max(0.01, 1.05 * max(berg.speed, default=0.0)))
    for ax in axes:
        ax.set_ylim(bottom=0.0)
        # The last force holds until the end of the run.
        ax.fill_between([*moments, times[-1]], 0, 1, where=np.array([*berg.aground, berg.aground[-1]]) > 0,
                        color=colours.GROUND, alpha=0.12, lw=0, transform=ax.get_xaxis_transform(),
                        label="aground" if any(berg.aground) else None)  # fmt: skip
        plain_axes(ax)
    style.legend_above(forces, ncols=8)
    date_axis(axes[-1])
    style.letters(axes)


def _legend(figure: Figure, breakups: Sequence[Breakup]) -> None:
    """Explain colours and lines once, below all panels."""
    from matplotlib.lines import Line2D

    shades = _shades(breakups[0])
    acting = [n for n in shades if any(math.hypot(*b.budgets[k].forces[n]) > 0.0 for b in breakups for k in SIDES)]
    handles = [Line2D([], [], color=shades[name], lw=2.4, label=name) for name in acting]
    handles += [
        Line2D([], [], color="black", lw=2.4, label="all forces (curves)"),
        Line2D([], [], color=colours.REST, lw=2.4, label="the other part of the berg, through the cut (arrows)"),
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
            vectors.append((budget.residual, colours.REST))
        # On the rest as much of them as acts on a mass like the fragment: else its arrows would hide the others.
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
    ax.set_title(f"load of the whole cut of {b.decisive.cut_km:.3g} km, by force", fontsize=9)
    ax.set_ylabel("nominal stress, as of a beam (kPa)", fontsize=9)
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
        ax.plot([], [], lw=0.8, ls=":", color="black", label="at the outputs")
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, title="bonds, by time of failure",
              title_fontsize=7)  # fmt: skip
    which = "largest tensile stress between outputs (kPa)" if b.first_bonds[0].peak else "tensile stress (kPa)"
    ax.set_ylabel(which, fontsize=9)
    ax.set_title("the first bonds to fail", fontsize=9)
    ax.set_xlabel(f"hours from {minute_text(b.time)}", fontsize=9)
    ax.tick_params(labelsize=8)


def _differs(bond: FirstBond) -> bool:
    """Whether the stress at the records differs from the largest between them, as in ringing ice."""
    return bool(bond.peak) and not np.allclose(bond.peak, bond.tension, rtol=0.02, atol=0.01 * bond.strength)


def _failures(times: Sequence[str]) -> list[str]:
    """Return the times at which bonds failed, to the second where minutes are alike; of bonds that failed at once one entry."""
    minutes = [minute_text(time)[5:] for time in times]
    texts = (
        minutes
        if len(set(minutes)) == len(times)
        else [str(np.datetime64(t, "s"))[5:].replace("T", " ") for t in times]
    )
    counts = {text: texts.count(text) for text in texts}
    return [
        f"{text} ({counts[text]} bonds)"
        if counts[text] > 1 and text not in texts[:k]
        else "_" * (text in texts[:k]) + text
        for k, text in enumerate(texts)
    ]


def _hours(text: str, end: str) -> float:
    return float((np.datetime64(text) - np.datetime64(end)) / np.timedelta64(1, "s")) / 3600.0
