"""``riftberg verify``: ensembles against what was observed afterwards."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from riftberg.cli.options import Hour, PositionError, check_folder, results_folder, within
from riftberg.cli.terminal import reported, say
from riftberg.errors import InputError
from riftberg.verification.positions import USUAL_ERROR

FILES = ("verification.json", "verification.png")
"""Files that the command writes."""


@reported
def verify(
    pairs: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER OBSERVED ...",
                       help="A sweep or forecast, and what was observed; more pairs are pooled."),
    ],
    berg: Annotated[str | None, typer.Option("--berg", help="Name of the berg, where a file has several.")] = None,
    broken: Annotated[
        list[str] | None,
        typer.Option("--broken", metavar="DATE",
                     help="When it was first seen broken; for several pairs one each, or 'never'."),
    ] = None,
    whole_until: Annotated[
        list[str] | None,
        typer.Option("--whole-until", metavar="DATE",
                     help="When it was last seen whole; for several pairs one each, or 'never'."),
    ] = None,
    error: PositionError = USUAL_ERROR,
    hour: Hour = None,
    tracks: Annotated[
        Path | None,
        typer.Option("--tracks", metavar="FOLDER", help="Tracks of BYU and NIC, whose errors the baselines get."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the results.  [default: beside the first ensemble]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the tables.")] = False,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw verification.png.")] = True,
) -> None:  # fmt: skip
    """Score an ensemble against observations: CRPS, energy score, coverage, ranks, spread, probability of break-up."""
    import json

    from riftberg.diagnostics.observed import read_observed
    from riftberg.ensembles.result import open_sweep
    from riftberg.system.atomic_files import write_json
    from riftberg.system.input_files import is_folder
    from riftberg.verification.forecast import report, verified

    within(error, "--error", 0.0, 100.0)
    within(hour, "--hour", 0.0, 24.0)
    if len(pairs) % 2:
        raise InputError(f"{len(pairs)} paths", where="verify", remedy="Give FOLDER OBSERVED, both for each forecast")
    count = len(pairs) // 2
    folder = output or (pairs[0] if is_folder(pairs[0]) else pairs[0].parent)
    names = FILES if figure else FILES[:1]
    check_folder(folder, names)
    seen_broken, seen_whole = _dates(broken, "--broken", count), _dates(whole_until, "--whole-until", count)
    dressed = None if tracks is None else _dressed(tracks)
    forecasts = [
        verified(
            open_sweep(pairs[2 * k]), read_observed(pairs[2 * k + 1]), berg=berg, broken=seen_broken[k],
            whole_until=seen_whole[k], hour=hour, dressed=dressed, outline=_outline(pairs[2 * k]),
        )
        for k in range(count)
    ]  # fmt: skip
    result = report(forecasts, error)
    if as_json:
        typer.echo(json.dumps(result, indent=1))
    else:
        _show(result)
    with results_folder(folder, names, taken=names):
        written = [write_json(result, folder / FILES[0])]
        if figure:
            from riftberg.viz.score import draw_verification

            written.append(draw_verification(result, folder / FILES[1]))
    say("Written: " + ", ".join(str(path) for path in written))


def _dates(texts: list[str] | None, option: str, count: int) -> list[datetime | None]:
    from riftberg.config.values import parse_date

    if texts is None:
        return [None] * count
    if len(texts) != count:
        raise InputError(f"{len(texts)} dates for {count} forecasts", where=option, remedy="Give one each, or 'never'")
    return [None if text == "never" else parse_date(text, where=option)[0] for text in texts]


def _dressed(tracks: Path) -> Callable[[str], dict[str, Any]]:
    """Return what gives the baselines with their errors on training bergs, for the name of the berg that is verified."""
    from riftberg.verification.tracks import LEADS, dressed_without, read_cases

    return partial(dressed_without, read_cases(tracks, sorted({*LEADS, 10, 14})))


def _outline(ensemble: Path) -> Any:
    """Return the outline of the berg at the start, from the control of a forecast; None where there is none."""
    from riftberg.ensembles.member import CONTROL_RUN
    from riftberg.verification.sightings import outline_of_run

    file = (ensemble if ensemble.is_dir() else ensemble.parent) / CONTROL_RUN
    return outline_of_run(file) if file.exists() else None


def _show(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:  # a file or a pipe has no width of its own
        console = Console(width=150)
    for one in result["forecasts"]:
        failed = f", {one['failed']} failed" if one["failed"] else ""
        console.print(
            f"{one['berg']}, start {one['start'][:16].replace('T', ' ')}: {one['members']} members{failed}; axes: {one['axes']}"
        )
    table = Table(title=f"Positions, km; error of the observation {result['error_km']:g} km added, without in brackets")
    for name in ("days", "seen", "error of mean", "CRPS along", "across", "energy score", "in 50 %", "in 90 %",
                 "own 50 %", "own 90 %", "spread / error",
                 *(name for name in result["baselines"])):  # fmt: skip
        table.add_column(name, justify="right")
    keys = (
        "error_of_mean_km",
        "crps_along_km",
        "crps_across_km",
        "energy_km",
        "inside_50%",
        "inside_90%",
        "own_50%",
        "own_90%",
        "spread_over_error",
    )
    for row, bare in zip(result["with_error"], result["without_error"], strict=True):
        cells = []
        for key in keys:
            form = ".0%" if key.endswith("%") else ".2f" if "over" in key else ".1f"
            cells.append("" if key not in row else f"{row[key]:{form}} ({bare[key]:{form}})")
        others = []
        for rows in result["baselines"].values():
            found: dict[str, Any] = next((other for other in rows if other["lead_days"] == row["lead_days"]), {})
            score = found.get("energy_km", found.get("error_of_mean_km"))
            others.append("" if score is None else f"{score:.1f}")
        table.add_row(f"{row['lead_days']}", f"{row['starts']}", *cells, *others)
    console.print(table)
    console.print(
        "Baselines: distance of a single forecast, energy score of one that is dressed; compare with the energy score."
    )
    for row, bare in zip(result["with_error"], result["without_error"], strict=True):
        if "overlap" in row:
            console.print(
                f"Outlines, day {row['lead_days']}: overlap {row['overlap']:.2f} ({bare['overlap']:.2f}), squared error of the "
                f"probability of ice {row['area_km2']:,.0f} km2 ({bare['area_km2']:,.0f}); {row['whole']:.0%} of the members, "
                "those still whole",
                highlight=False,
            )
    for one in result["forecasts"]:
        if one["liu_weisberg"]:
            parts = ", ".join(f"{name} {value:.2f}" for name, value in one["liu_weisberg"].items())
            console.print(f"Skill of Liu and Weisberg, {one['berg']}: {parts}")
        for day in one["broken"]:
            console.print(
                f"Broken by day {day['day']}: {day['probability']:.0%} ({day['interval'][0]:.0%} to {day['interval'][1]:.0%}), "
                f"{'it was' if day['occurred'] else 'it was whole'}; fair Brier score {day['fair_brier']:.3f}",
                highlight=False,
            )
    words = {row["verdict"] for row in result["with_error"]}
    bergs = max((row["bergs"] for row in result["with_error"]), default=0)
    console.print(
        f"Spread against error over {bergs} bergs: {', '.join(sorted(words))}." if words != {"undecided"}
        else f"{bergs} berg{'s say' if bergs > 1 else ' says'} nothing of the spread; pool forecasts of five or more."
    )  # fmt: skip
