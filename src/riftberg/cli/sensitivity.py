"""``riftberg sensitivity``: which input matters, as a table and a figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import (
    AllowMore,
    Data,
    Days,
    DefaultErrors,
    ExperimentToRun,
    OneNumerics,
    Quiet,
    Resume,
    Scheduler,
    Seed,
    Settings,
    Without,
    Workers,
    make_options,
    positive,
    results_folder,
)
from riftberg.cli.sweep import opened, run_members
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.errors import InputError, RunError
from riftberg.system.limits import allow_large

if TYPE_CHECKING:
    from riftberg.ensembles.sweep import Plan

RESULTS = ("sweep.nc", "sweep.json", "sensitivity.csv", "sensitivity.png")
"""Files that the command writes into its folder, beside the folder ``members``."""


@reported
def sensitivity(
    experiment: ExperimentToRun = None,
    method: Annotated[
        str, typer.Option("--method", help="morris: effects, for a first look at many inputs; sobol: parts of the variance.")
    ] = "morris",
    draws: Annotated[
        int | None,
        typer.Option("--draws", min=2, help="Draws of one run for each input and one (morris) or two (sobol) more.  "
                     "[default: 16 for morris, 64 for sobol]"),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="GROUP.NAME~DISTRIBUTION",
                     help="Input beside, or instead of, the errors of a forecast: 'drag.ocean_scale~lognormal(1, 20 %)'. "
                     "May be repeated."),
    ] = None,
    default_errors: DefaultErrors = True,
    at_day: Annotated[
        list[float] | None,
        typer.Option("--at-day", help="Day by which the berg is broken or aground. May be repeated.  "
                     "[default: middle and end of the runs]"),
    ] = None,
    observed: Annotated[
        Path | None, typer.Option("--observed", metavar="FILE", help="Outlines or positions: the error of the drift too.")
    ] = None,
    berg: Annotated[str | None, typer.Option("--berg", help="Name of the berg in that file, where it has several.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-sensitivity]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: OneNumerics = None,
    seed: Seed = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    resume: Resume = None,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw sensitivity.png.")] = True,
    quiet: Quiet = False,
    large: AllowMore = False,
) -> None:  # fmt: skip
    """Show which input matters: Morris effects or Sobol' indices of stress, break-up, grounding, area and drift."""
    from riftberg.diagnostics.observed import read_observed
    from riftberg.ensembles.forecast import forecast_errors
    from riftberg.ensembles.sensitivity import METHODS, USUAL_DRAWS, Result, indices, results_of
    from riftberg.ensembles.sweep import draws_of, planned
    from riftberg.system.atomic_files import write_text

    if method not in METHODS:
        raise InputError(f"{method!r} is no method", where="--method", remedy=f"Use {' or '.join(METHODS)}")
    seen = None if observed is None else read_observed(observed)

    def make(experiment: str) -> Plan:
        options = make_options(settings, days, data, without, numerics)
        errors = forecast_errors(experiment, vary or [], defaults=default_errors)
        drawn = draws_of({"members": draws or USUAL_DRAWS[method], "plan": METHODS[method], "seed": seed})
        return planned(experiment, errors, options, None, None, drawn)

    with allow_large(large):
        announce_compilation(quiet)
        kept = {
            "--vary": vary, "--output": output, "--seed": seed, "--set": settings, "--days": days, "--data": data,
            "--without": without, "--numerics": numerics, "--no-default-errors": None if default_errors else True,
        }  # fmt: skip
        store = opened("sensitivity", experiment, make, output, RESULTS, resume, draws, kept)
        plan = store.plan
        for day in at_day or ():
            positive(day, "--at-day", "days", most=plan.days)
        if not quiet:
            say(
                f"{len(plan.members)} runs of {plan.days:g} days: {plan.draws.number} draws by the plan {plan.draws.plan}"
            )
        with results_folder(store.folder, RESULTS):
            ds = run_members(store, "sensitivity", scheduler, workers, quiet=quiet)
            if not (ds["status"] == 0).any():
                raise RunError("no run came to its end")
            results = results_of(ds, at_day or ())
            if seen is not None:
                from riftberg.verification.sightings import drift_error

                results["drift error"] = Result(drift_error(ds, seen, berg=berg), "km")
            found = indices(ds, results)
            write_text(store.folder / "sensitivity.csv", found.to_dataframe().to_csv(lineterminator="\n"))
            if figure:
                from riftberg.viz.ensemble import draw_sensitivity

                draw_sensitivity(
                    found, store.folder / "sensitivity.png", title=f"{plan.named}, {len(plan.members)} runs"
                )
        for line in summary_lines(found):
            typer.echo(line)
        typer.echo(f"Written to {store.folder}: {', '.join(RESULTS if figure else RESULTS[:-1])}")


def summary_lines(found: Any) -> list[str]:
    """Return the inputs that matter most for each result, a line each."""
    lines = []
    for name in found["result"].values:
        row = found.sel(result=name)
        key = next((key for key in ("effect", "total") if key in row and row[key].notnull().any()), "correlation")
        if not float(row["spread"]) > 0.0 and key != "correlation":
            lines.append(f"  {name}: the same in all runs")
            continue
        if key not in row or not row[key].notnull().any():
            lines.append(f"  {name}: too few members have it")
            continue
        values, low, high = (row[f"{key}{end}"].values for end in ("", "_low", "_high"))
        best = sorted(range(values.size), key=lambda k: -abs(values[k]))[:4]
        said = ", ".join(f"{row['input'].values[k]} {values[k]:.2g} ({low[k]:.2g} to {high[k]:.2g})" for k in best)
        share = f", of the {100 * float(row['share']):.0f} % that have one" if key == "correlation" else ""
        unit = f" {row['unit'].item()}" if key == "effect" and row["unit"].item() != "1" else ""
        word = {"effect": "mean change", "total": "total index", "correlation": "rank correlation"}[key]
        lines.append(f"  {name} ({word}{unit}{share}): {said}")
    return lines
