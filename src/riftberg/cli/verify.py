"""``riftberg verify`` and ``riftberg verify-tracks``: ensembles and drift models against observations."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import (
    Hour,
    PositionError,
    check_folder,
    check_range,
    console,
    dates,
    load_observed,
    report_errors,
    results_folder,
    say,
    table,
    tell,
)
from riftberg.config.units import minute_text
from riftberg.errors import InputError
from riftberg.system.input_files import value_shown
from riftberg.verification.scores import USUAL_ERROR

if TYPE_CHECKING:
    from riftberg.verification.tracks import Case, DriftModel


FILES = ("verification.json", "verification.png")
"""Files that the command writes."""


@report_errors
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

    from riftberg.ensembles.result import open_sweep
    from riftberg.system.atomic_files import write_json
    from riftberg.system.input_files import is_folder
    from riftberg.verification.forecast import report, verified
    from riftberg.verification.sightings import read_pieces

    check_range(error, "--error", 0.0, 100.0)
    check_range(hour, "--hour", 0.0, 24.0)
    if len(pairs) % 2:
        raise InputError(f"{len(pairs)} paths", where="verify", remedy="Give FOLDER OBSERVED, both for each forecast")
    count = len(pairs) // 2
    folder = output or (pairs[0] if is_folder(pairs[0]) else pairs[0].parent)
    names = FILES if figure else FILES[:1]
    check_folder(folder, names)
    seen_broken, seen_whole = _dates(broken, "--broken", count), _dates(whole_until, "--whole-until", count)
    dressed = None if tracks is None else _dress_baselines(tracks)
    forecasts = [
        verified(
            open_sweep(pairs[2 * k]), load_observed(pairs[2 * k + 1]), berg=berg, broken=seen_broken[k],
            whole_until=seen_whole[k], hour=hour, dressed=dressed, outline=_outline(pairs[2 * k]),
            pieces=partial(read_pieces, pairs[2 * k]),
        )
        for k in range(count)
    ]  # fmt: skip
    result = report(forecasts, error)
    if as_json:
        tell(json.dumps(result, indent=1))
    else:
        _show(result)
    with results_folder(folder, names, locked=names):
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


def _dress_baselines(tracks: Path) -> Callable[[str], dict[str, Any]]:
    """Return a function that gives the baselines, with their errors on training bergs, for the name of a berg."""
    from riftberg.verification.tracks import LEADS, dressed_without, read_cases

    return partial(dressed_without, read_cases(tracks, sorted({*LEADS, 10, 14})))


def _outline(ensemble: Path) -> Any:
    """Return the outline of the berg at the start, from the control of a forecast; None where there is none."""
    from riftberg.ensembles.member import CONTROL_RUN
    from riftberg.verification.sightings import read_first_outline

    file = (ensemble if ensemble.is_dir() else ensemble.parent) / CONTROL_RUN
    return read_first_outline(file) if file.exists() else None


SHOWN = {
    "error of mean": ("error_of_mean_km", ".1f"), "CRPS along": ("crps_along_km", ".1f"), "across": ("crps_across_km", ".1f"),
    "energy score": ("energy_km", ".1f"), "in 50 %": ("inside_50%", ".0%"), "in 90 %": ("inside_90%", ".0%"),
    "own 50 %": ("own_50%", ".0%"), "own 90 %": ("own_90%", ".0%"), "spread / error": ("spread_over_error", ".2f"),
}  # fmt: skip
"""Columns of the table of scores: key and form of each."""


def _both(row: dict[str, Any], bare: dict[str, Any], key: str, form: str) -> str:
    """Return a score with the error of the observation, and in brackets without."""
    return "" if key not in row else f"{row[key]:{form}} ({bare[key]:{form}})"


def _show(result: dict[str, Any]) -> None:
    page = console(150)
    for forecast in result["forecasts"]:
        failed = f", {forecast['failed']} failed or unfinished" if forecast["failed"] else ""
        page.print(
            f"{forecast['berg']}, start {minute_text(forecast['start'])}: {forecast['members']} members{failed}; "
            f"axes: {forecast['axes']}"
        )
    rows = table(
        f"Positions, km; error of the observation {result['error_km']:g} km added, without in brackets",
        ("days", "seen", *SHOWN, *result["baselines"]),
    )
    for row, bare in zip(result["with_error"], result["without_error"], strict=True):
        others = []
        for baseline in result["baselines"].values():
            same_lead: dict[str, Any] = next(
                (other for other in baseline if other["lead_days"] == row["lead_days"]), {}
            )
            score = same_lead.get("energy_km", same_lead.get("error_of_mean_km"))
            others.append("" if score is None else f"{score:.1f}")
        cells = (_both(row, bare, *columns) for columns in SHOWN.values())
        rows.add_row(f"{row['lead_days']}", f"{row['starts']}", *cells, *others)
    page.print(rows)
    page.print(
        "Baselines: distance of a single forecast, energy score of one that is dressed; compare with the energy score."
    )
    for row, bare in zip(result["with_error"], result["without_error"], strict=True):
        if "overlap" in row:
            page.print(
                f"Outlines, day {row['lead_days']}: overlap {row['overlap']:.2f} ({bare['overlap']:.2f}), squared error of the "
                f"probability of ice {row['area_km2']:,.0f} km2 ({bare['area_km2']:,.0f}); outlines of "
                f"{row['known']:.0%} of the members",
                highlight=False,
            )
    for forecast in result["forecasts"]:
        if forecast["liu_weisberg"]:
            scores_text = ", ".join(f"{name} {value:.2f}" for name, value in forecast["liu_weisberg"].items())
            page.print(f"Skill of Liu and Weisberg, {forecast['berg']}: {scores_text}")
        for day in forecast["broken"]:
            page.print(
                f"Broken by day {day['day']}: {day['probability']:.0%} ({day['interval'][0]:.0%} to {day['interval'][1]:.0%}), "
                f"{'it was' if day['occurred'] else 'it was whole'}; fair Brier score {day['fair_brier']:.3f}",
                highlight=False,
            )
    words = {row["verdict"] for row in result["with_error"]}
    bergs = max((row["bergs"] for row in result["with_error"]), default=0)
    page.print(
        f"Spread against error over {bergs} bergs: {', '.join(sorted(words))}." if words != {"undecided"}
        else f"{bergs} berg{'s say' if bergs > 1 else ' says'} nothing of the spread; pool forecasts of five or more."
    )  # fmt: skip


TRACK_FILES = ("cases.csv", "tracks.json")
SUITE_FILES = ("cases.csv", "suite.json", "suite.md", "suite.png")
"""Files that the command writes, for tracks and for a suite."""


@report_errors
def verify_tracks(
    tracks: Annotated[
        Path | None, typer.Argument(metavar="[TRACKS]", help="Folder of the tables of BYU and NIC, one CSV a berg.")
    ] = None,
    suite: Annotated[
        Path | None, typer.Option("--suite", metavar="FOLDER", help="Folder of cases with their forcing, instead of TRACKS.")
    ] = None,
    entrants: Annotated[
        str | None,
        typer.Option("--entrants", metavar="LIST",
                     help="Of a suite, by commas: staying put, constant velocity, current, current x 0.5, "
                     "riftberg group.name=value ..., forecasts FILE.csv, names of case.yaml, or NAME: one of these."),
    ] = None,
    reference: Annotated[
        str, typer.Option("--reference", metavar="ENTRANT", help="Of a suite, with which the others are paired.")
    ] = "riftberg",
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="MODULE:FUNCTION",
                     help="Drift model in Python: a function of start and dates, and of the forcing of a suite."),
    ] = None,
    forecasts: Annotated[
        Path | None,
        typer.Option("--forecasts", metavar="FILE.csv", help="Forecasts that any program made for the starts of cases.csv."),
    ] = None,
    leads: Annotated[str, typer.Option("--leads", help="Lead times, days.")] = "1,3,5,7",
    bergs: Annotated[
        str, typer.Option("--bergs", help="'all', 'held-out' (A38, B17, C19: tune on none of them) or 'training'.")
    ] = "all",
    between: Annotated[
        str | None, typer.Option("--between", metavar="FIRST,LAST", help="Dates that must hold start and end.")
    ] = None,
    error: PositionError = USUAL_ERROR,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for cases.csv and the tables.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the tables.")] = False,
) -> None:  # fmt: skip
    """Score drift models on observed tracks, beside staying put and constant velocity: of BYU and NIC, or of a suite."""
    import json

    from riftberg.verification.tracks import BASELINES, read_cases, read_forecasts, write_cases

    check_range(error, "--error", 0.0, 100.0)
    if (tracks is None) == (suite is None):
        raise InputError("no tracks" if suite is None else "tracks and a suite", where="verify-tracks",
                         remedy="Give TRACKS, or --suite FOLDER")  # fmt: skip
    if tracks is None:
        assert suite is not None
        models = {} if model is None else {model: _import_function(model)}
        models |= {} if forecasts is None else {forecasts.name: read_forecasts(forecasts, complete=False)}
        _verify_suite(suite, entrants, models, reference, output, as_json=as_json)
        return
    if bergs not in ("all", "held-out", "training"):
        raise InputError(f"{value_shown(bergs)} is not known", where="--bergs", remedy="Use all, held-out or training")
    cases = _between(read_cases(tracks, _leads(leads)), between)
    models = dict(BASELINES)
    if model is not None:
        models[model] = _import_function(model)
    if forecasts is not None:
        models[forecasts.name] = read_forecasts(forecasts)
    result = _score_models(models, cases, bergs, error)
    if as_json:
        tell(json.dumps(result, indent=1))
    else:
        _show_tracks(result)
    if output is not None:
        from riftberg.system.atomic_files import write_json

        with results_folder(output, TRACK_FILES, locked=TRACK_FILES):
            chosen = [case for case in cases if bergs == "all" or case.held_out is (bergs == "held-out")]
            written = [write_cases(chosen, output / "cases.csv"), write_json(result, output / "tracks.json")]
        say("Written: " + ", ".join(str(path) for path in written))


def _verify_suite(
    folder: Path, entrants: str | None, models: dict[str, DriftModel], reference: str, output: Path | None, *, as_json: bool
) -> None:  # fmt: skip
    """Score entrants on a suite, print the tables and write them."""
    import json

    from riftberg.verification.suite import as_markdown, read_suite, tables
    from riftberg.verification.tracks import write_cases

    entrant_names = [text.strip() for text in (entrants or "").split(",") if text.strip()]
    cases = read_suite(folder)
    result = tables(cases, entrant_names, models=models, reference=reference)
    tell(json.dumps(result, indent=1) if as_json else as_markdown(result))
    if output is not None:
        from riftberg.system.atomic_files import write_json, write_text
        from riftberg.viz.score import draw_suite

        with results_folder(output, SUITE_FILES, locked=SUITE_FILES):
            starts, numbers, page, picture = (output / name for name in SUITE_FILES)
            names = [case.file.name for case in cases for _ in case.cases]
            write_cases([start for case in cases for start in case.cases], starts, names)
            write_json({"cases": result}, numbers)
            write_text(page, as_markdown(result))
            draw_suite(result, picture)
        say("Written: " + ", ".join(str(output / name) for name in SUITE_FILES))


def _leads(text: str) -> list[int]:
    try:
        return sorted({int(word) for word in text.split(",")})
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} are no days", where="--leads", remedy="For example --leads 1,3,7"
        ) from error


def _between(cases: list[Case], text: str | None) -> list[Case]:
    """Return the cases within dates, each with the lead times that end within them."""
    from dataclasses import replace

    span = dates(text, "--between")
    if span is None:
        return cases
    first, last = span
    cases_within = []
    for case in cases:
        seen = {
            lead: position for lead, position in case.seen.items() if case.start.date + timedelta(days=lead) <= last
        }
        if seen and case.start.date >= first:
            cases_within.append(replace(case, seen=seen))
    if not cases_within:
        raise InputError("no case", where=f"--between {text}", remedy="Give dates between which a berg was seen twice")
    return cases_within


def _import_function(name: str) -> Any:
    """Return a function by ``module:function``; modules of the working folder too."""
    import importlib
    import os
    import sys

    module, colon, function = name.partition(":")
    remedy = "Write MODULE:FUNCTION, with MODULE.py in the working folder or installed"
    if not colon or not module or not function:
        raise InputError(f"{value_shown(name)} names no function", where="--model", remedy=remedy)
    sys.path.insert(0, os.getcwd())
    try:
        target = getattr(importlib.import_module(module), function)
    except (Exception, SystemExit) as error:  # whatever the module does when it is imported
        is_import_error = isinstance(error, (ImportError, AttributeError))
        problem = str(error) if is_import_error else f"{type(error).__name__}: {error}"
        raise InputError(problem, where=f"--model {name}", remedy=remedy) from error
    finally:
        sys.path.pop(0)
    if not callable(target):
        raise InputError(f"{function} is no function", where=f"--model {name}", remedy=remedy)
    return target


def _score_models(models: dict[str, DriftModel], cases: list[Case], bergs: str, error: float) -> dict[str, Any]:
    """Return the tables of all models: errors on the bergs chosen, and scores of ensembles on those held out."""
    from riftberg.verification.tracks import BASELINES, Dressed, compute_errors, ensemble_table, forecast, table

    held_out, training = ([case for case in cases if case.held_out is is_held_out] for is_held_out in (True, False))
    chosen = {"all": cases, "held-out": held_out, "training": training}[bergs]
    if not chosen:
        raise InputError("no case of these bergs", where=f"--bergs {bergs}", remedy="Use all, or other dates")
    result: dict[str, Any] = {"bergs": bergs, "error_km": error, "errors": {}, "ensembles": {}, "tuned": {}}
    for name, model in models.items():
        rows = compute_errors(model, chosen)
        result["errors"][name] = table(rows)
        tuned = [row for row in rows if row.tuned]
        result["tuned"][name] = {"bergs": sorted({row.berg for row in tuned}), "starts": len(tuned)}
        many = bool(held_out) and name not in BASELINES and len(next(iter(forecast(model, held_out[0]).values()))) > 1
        if not held_out or not (many or training):
            continue
        ensemble = model if many else Dressed(model, training)
        title = name if many else f"{name}, dressed"
        result["ensembles"][title] = {
            "without": ensemble_table(ensemble, held_out, 0.0),
            "with": ensemble_table(ensemble, held_out, error),
        }
    return result


def _show_tracks(result: dict[str, Any]) -> None:
    out = console(120)
    errors = table(
        f"Distance from the observed position, km ({result['bergs']} bergs)",
        ("model", "days", "bergs", "starts", "median", "90 % interval", "90th percentile"), texts=("model",),
    )  # fmt: skip
    for model, rows in result["errors"].items():
        for k, row in enumerate(rows):
            interval = "too few" if row["low_km"] is None else f"{row['low_km']:.0f} to {row['high_km']:.0f}"
            errors.add_row(
                model if k == 0 else "", f"{row['lead_days']}", f"{row['bergs']}", f"{row['starts']}",
                f"{row['median_km']:.1f}", interval, f"{row['p90_km']:.0f}",
            )  # fmt: skip
    out.print(errors)
    out.print("The intervals come from drawing bergs; starts of one berg repeat each other.")
    first = next(iter(result["tuned"].values()))
    if first["starts"]:
        out.print(
            f"{', '.join(first['bergs'])} ({first['starts']} rows): an ocean of Riftberg was fitted to this drift, so no model "
            "of it is tested there."
        )
    if not result["ensembles"]:
        return
    scores = table(
        f"Ensembles on held-out bergs; error of the observation {result['error_km']:g} km added, without in brackets",
        ("ensemble", "days", "energy score, km", "90 % interval", "in 50 % area", "in 90 % area", "spread / error"),
        texts=("ensemble",),
    )
    for model, tables in result["ensembles"].items():
        for k, (row, bare) in enumerate(zip(tables["with"], tables["without"], strict=True)):
            interval = row.get("energy_km_interval")
            scores.add_row(
                model if k == 0 else "", f"{row['lead_days']}", _both(row, bare, "energy_km", ".1f"),
                f"{interval[0]:.1f} to {interval[1]:.1f}" if interval else "",
                *(_both(row, bare, key, ".0%") for key in ("inside_50%", "inside_90%")),
                f"{row['spread_over_error']:.2f}" if "spread_over_error" in row else "",
            )  # fmt: skip
    out.print(scores)
