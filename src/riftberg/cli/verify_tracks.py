"""``riftberg verify-tracks``: drift models on the observed tracks of giant bergs, beside forecasts that cost nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import PositionError, dates, results_folder, within
from riftberg.cli.terminal import console, reported, say, table
from riftberg.errors import InputError
from riftberg.system.input_files import value_shown
from riftberg.verification.positions import USUAL_ERROR

if TYPE_CHECKING:
    from riftberg.verification.tracks import Case, DriftModel

FILES = ("cases.csv", "tracks.json")
"""Files that the command writes."""


@reported
def verify_tracks(
    tracks: Annotated[Path, typer.Argument(metavar="TRACKS", help="Folder of the tables of BYU and NIC, one CSV a berg.")],
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="MODULE:FUNCTION", help="Drift model in Python: a function of start and dates."),
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
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for cases.csv and tracks.json.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the tables.")] = False,
) -> None:  # fmt: skip
    """Score drift models on observed tracks of giant bergs, beside staying put and constant velocity."""
    import json

    from riftberg.verification.tracks import read_cases, write_cases

    within(error, "--error", 0.0, 100.0)
    if bergs not in ("all", "held-out", "training"):
        raise InputError(f"{value_shown(bergs)} is not known", where="--bergs", remedy="Use all, held-out or training")
    cases = _between(read_cases(tracks, _leads(leads)), between)
    models = _models(model, forecasts)
    result = _scored(models, cases, bergs, error)
    if as_json:
        typer.echo(json.dumps(result, indent=1))
    else:
        _show(result)
    if output is not None:
        from riftberg.system.atomic_files import write_json

        with results_folder(output, FILES, taken=FILES):
            chosen = [case for case in cases if bergs == "all" or case.held_out is (bergs == "held-out")]
            written = [write_cases(chosen, output / "cases.csv"), write_json(result, output / "tracks.json")]
        say("Written: " + ", ".join(str(path) for path in written))


def _leads(text: str) -> list[int]:
    try:
        return sorted({int(part) for part in text.split(",")})
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} are no days", where="--leads", remedy="For example --leads 1,3,7"
        ) from error


def _between(cases: list[Case], text: str | None) -> list[Case]:
    """Return the cases within dates, each with the lead times that end within them."""
    from dataclasses import replace
    from datetime import datetime, timedelta

    span = dates(text, "--between")
    if span is None:
        return cases
    first, last = (datetime.fromisoformat(part) for part in span)
    kept = []
    for case in cases:
        seen = {lead: place for lead, place in case.seen.items() if case.start.date + timedelta(days=lead) <= last}
        if seen and case.start.date >= first:
            kept.append(replace(case, seen=seen))
    if not kept:
        raise InputError("no case", where=f"--between {text}", remedy="Give dates between which a berg was seen twice")
    return kept


def _models(model: str | None, forecasts: Path | None) -> dict[str, DriftModel]:
    """Return the models that are to be scored, by name."""
    from riftberg.verification.tracks import BASELINES, read_forecasts

    models = dict(BASELINES)
    if model is not None:
        models[model] = _imported(model)
    if forecasts is not None:
        models[forecasts.name] = read_forecasts(forecasts)
    return models


def _imported(name: str) -> Any:
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
        found = getattr(importlib.import_module(module), function)
    except (Exception, SystemExit) as error:  # whatever the module does when it is imported
        known = isinstance(error, (ImportError, AttributeError))
        what = str(error) if known else f"{type(error).__name__}: {error}"
        raise InputError(what, where=f"--model {name}", remedy=remedy) from error
    finally:
        sys.path.pop(0)
    if not callable(found):
        raise InputError(f"{function} is no function", where=f"--model {name}", remedy=remedy)
    return found


def _scored(models: dict[str, DriftModel], cases: list[Case], bergs: str, error: float) -> dict[str, Any]:
    """Return the tables of all models: errors on the bergs chosen, and scores of ensembles on those held out."""
    from riftberg.verification.tracks import BASELINES, Dressed, ensemble_table, errors_of, forecast, table

    held, training = ([case for case in cases if case.held_out is wanted] for wanted in (True, False))
    chosen = {"all": cases, "held-out": held, "training": training}[bergs]
    if not chosen:
        raise InputError("no case of these bergs", where=f"--bergs {bergs}", remedy="Use all, or other dates")
    result: dict[str, Any] = {"bergs": bergs, "error_km": error, "errors": {}, "ensembles": {}, "tuned": {}}
    for name, model in models.items():
        rows = errors_of(model, chosen)
        result["errors"][name] = table(rows)
        tuned = [row for row in rows if row.tuned]
        result["tuned"][name] = {"bergs": sorted({row.berg for row in tuned}), "starts": len(tuned)}
        if not held or not (training or name not in BASELINES):
            continue
        many = name not in BASELINES and len(next(iter(forecast(model, held[0]).values()))) > 1 if held else False
        if not many and not training:
            continue
        ensemble = model if many else Dressed(model, training)
        shown = name if many else f"{name}, dressed"
        result["ensembles"][shown] = {
            "without": ensemble_table(ensemble, held, 0.0),
            "with": ensemble_table(ensemble, held, error),
        }
    return result


def _show(result: dict[str, Any]) -> None:
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
                model if k == 0 else "", f"{row['lead_days']}", f"{row['energy_km']:.1f} ({bare['energy_km']:.1f})",
                f"{interval[0]:.1f} to {interval[1]:.1f}" if interval else "",
                *(f"{row[key]:.0%} ({bare[key]:.0%})" if key in row else "" for key in ("inside_50%", "inside_90%")),
                f"{row['spread_over_error']:.2f}" if "spread_over_error" in row else "",
            )  # fmt: skip
    out.print(scores)
