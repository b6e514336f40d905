"""``riftberg forecast``: an ensemble with errors of all that is uncertain; ``product-errors``: how large one of them is."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import (
    AllowMore,
    Data,
    Days,
    DefaultErrors,
    EveryPosition,
    ExperimentToRun,
    Members,
    OneNumerics,
    PlanName,
    Quiet,
    Resume,
    Scheduler,
    Seed,
    Settings,
    Without,
    Workers,
    make_options,
    pair,
    positive,
    results_folder,
)
from riftberg.cli.sweep import opened, run_members
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.errors import RunError
from riftberg.system.limits import allow_large

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.ensembles.sweep import Plan

RESULTS = ("forecast.nc", "sweep.json", "control.nc", "forecast.png")
"""Files that a forecast writes into its folder, beside the folder ``members``."""


@reported
def forecast(
    experiment: ExperimentToRun = None,
    members: Members = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary", metavar="GROUP.NAME~DISTRIBUTION",
            help="What else is uncertain, or instead of a default error: 'start.thickness~lognormal(1, 10 %)', "
            "'current_error.speed=0.2 m/s'. May be repeated.",
        ),
    ] = None,
    default_errors: DefaultErrors = True,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-forecast]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: OneNumerics = None,
    every: EveryPosition = None,
    plan: PlanName = None,
    seed: Seed = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    resume: Resume = None,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw forecast.png.")] = True,
    quiet: Quiet = False,
    large: AllowMore = False,
) -> None:  # fmt: skip
    """Forecast how likely a berg breaks, grounds and where it drifts: an ensemble with errors in all inputs."""
    from riftberg.ensembles.forecast import errors_line, forecast_plan
    from riftberg.ensembles.probability import notes, told
    from riftberg.ensembles.sweep import draws_of

    def make(experiment: str) -> Plan:
        options = make_options(settings, days, data, without, numerics)
        draws = draws_of({"members": members, "plan": plan, "seed": seed})
        return forecast_plan(experiment, vary or [], options, every, draws, defaults=default_errors)

    with allow_large(large):
        positive(every, "--every", "hours", most=1e6)
        announce_compilation(quiet)
        kept = {
            "--vary": vary, "--plan": plan, "--seed": seed, "--output": output, "--set": settings, "--days": days,
            "--data": data, "--without": without, "--numerics": numerics, "--every": every,
            "--no-default-errors": None if default_errors else True,
        }  # fmt: skip
        store = opened("forecast", experiment, make, output, RESULTS, resume, members, kept)
        if not quiet:
            say(errors_line(store.plan.varied))
            if map_:
                store.look = partial(first_picture, path=store.folder / "forecast.png")
            for v in store.plan.varied:
                if v.distribution is not None and v.distribution.cut_off >= 5e-5:
                    say(f"  {v.told()}")
        with results_folder(store.folder, RESULTS):
            result = run_members(store, "forecast", scheduler, workers, quiet=quiet)
        files = list(RESULTS[:-1])
        if not (result["status"] == 0).any():
            message = next((str(text) for text in result["message"].values if text), "")
            raise RunError(f"no member came to its end{': ' if message else ''}{message}")
        if map_ and "presence" in result:
            from riftberg.viz.ensemble import draw_forecast

            draw_forecast(result, store.folder / "forecast.png", notes=notes(result))
            files.append("forecast.png")
        for line in told(result):
            typer.echo(line)
        typer.echo(f"Written to {store.folder}: {', '.join(files)}")


def first_picture(result: xr.Dataset, path: Path) -> None:
    """Draw the members that are done while others still run."""
    if "presence" in result:
        from riftberg.ensembles.probability import notes
        from riftberg.viz.ensemble import draw_forecast

        draw_forecast(result, path, notes=notes(result))
        say(f"{path}: a first picture, of {int((result['status'] == 0).sum())} members")


@reported
def product_errors(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="File of a product with currents.")],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="File of another one, of the same days and area.")],
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Box.  [default: what both cover]")] = None,
    lat: Annotated[str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Box.")] = None,
) -> None:  # fmt: skip
    """Estimate the error of the current by the differences of two products: size, length, time."""
    from riftberg.ensembles.product_errors import estimated

    found = estimated(first, second, longitude=pair(lon, "--lon"), latitude=pair(lat, "--lat"))
    typer.echo(f"{found.points} points, {found.records} dates; half of the squared difference, if both err alike:")
    typer.echo("  " + " ".join(f"--vary '{text}'" for text in found.vary))
    typer.echo("  A lower bound: errors that both products share are not in their difference.")
