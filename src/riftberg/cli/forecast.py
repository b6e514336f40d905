"""``riftberg forecast``: an ensemble with errors of all that is uncertain, its probabilities and its picture."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import (
    Data,
    Days,
    Members,
    NumericsName,
    PlanName,
    Quiet,
    Seed,
    Settings,
    Without,
    check_folder,
    make_options,
    output_folder,
    positive,
    results_folder,
)
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.errors import InputError, RunError
from riftberg.system.limits import allow_large

if TYPE_CHECKING:
    import xarray as xr

RESULTS = ("forecast.nc", "sweep.json", "forecast.png")
"""Files that a forecast writes into its folder, beside the folder ``members``."""


@reported
def forecast(
    experiment: Annotated[
        str | None, typer.Argument(help="A built-in experiment or a YAML file; not needed with --resume.")
    ] = None,
    members: Members = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary", metavar="GROUP.NAME~DISTRIBUTION",
            help="What else is uncertain, or instead of a default error: 'start.thickness~lognormal(1, 10 %)', "
            "'current_error.speed=0.2 m/s'. May be repeated.",
        ),
    ] = None,
    default_errors: Annotated[
        bool, typer.Option("--default-errors/--no-default-errors", help="Take the errors of the table in the documentation.")
    ] = True,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-forecast]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: NumericsName = None,
    every: Annotated[
        float | None,
        typer.Option("--every", help="Hours of model time between positions.  [default: 6, or the length of the runs]"),
    ] = None,
    plan: PlanName = None,
    seed: Seed = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers run the members.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option("--workers", help="Processes on this machine; 0 to run in this process.  [default: 0]"),
    ] = 0,
    resume: Annotated[
        Path | None, typer.Option("--resume", metavar="FOLDER", help="Continue the forecast in a folder.")
    ] = None,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw forecast.png.")] = True,
    quiet: Quiet = False,
    large: Annotated[bool, typer.Option("--allow-large", help="Allow more members and larger runs.")] = False,
) -> None:  # fmt: skip
    """Forecast how likely a berg breaks, grounds and where it drifts: an ensemble with errors in all inputs."""
    from riftberg.cli.sweep import resumed
    from riftberg.ensembles.forecast import errors_line, forecast_plan
    from riftberg.ensembles.sweep import Store, draws_of, run_sweep
    from riftberg.runs.progress import SweepBar

    with allow_large(large):
        if workers is not None and workers < 0:
            raise InputError(f"{workers} processes", where="--workers", remedy="Give 0 or more")
        positive(every, "--every", "hours", most=1e6)
        announce_compilation(quiet)
        if resume is not None:
            kept = {
                "--vary": vary, "--plan": plan, "--seed": seed, "--output": output, "--set": settings, "--days": days,
                "--data": data, "--without": without, "--numerics": numerics, "--every": every,
                "--no-default-errors": None if default_errors else True,
            }  # fmt: skip
            store = resumed(resume, experiment, members, kept, "forecast")
        elif experiment is None:
            raise InputError("no experiment is named", where="forecast", remedy="Name one, or give --resume FOLDER")
        elif numerics == "both":
            raise InputError("one kind of numerics is needed", where="--numerics", remedy="Use own or reference")
        else:
            options = make_options(settings, days, data, without, numerics)
            draws = draws_of({"members": members, "plan": plan, "seed": seed})
            made = forecast_plan(experiment, vary or [], options, every, draws, defaults=default_errors)
            folder = output_folder(output, f"{Path(experiment).stem}-forecast", "sweep.json")
            check_folder(folder, RESULTS)
            store = Store(folder, made, resume=False)
        if not quiet:
            if default_errors:
                say(errors_line(store.plan.named, store.plan.options.data))
            if map_:
                store.look = partial(first_picture, path=store.folder / "forecast.png")
            for v in store.plan.varied:
                if v.distribution is not None and v.distribution.cut_off >= 5e-5:
                    say(f"  {v.told()}")
        bar = None if quiet else SweepBar(len(store.plan.members) + 1)
        with results_folder(store.folder, RESULTS):
            try:
                result = run_sweep(store, scheduler=scheduler, workers=workers, bar=bar)
            except (KeyboardInterrupt, SystemExit):
                say(f"{len(store.done)} of {len(store.plan.members) + 1} runs are done. "
                    f"Go on with: riftberg forecast --resume {store.folder}")  # fmt: skip
                raise
        files = ["forecast.nc", "sweep.json"]
        if not (result["status"] == 0).any():
            message = next((str(text) for text in result["message"].values if text), "")
            raise RunError(f"no member came to its end{': ' if message else ''}{message}")
        if map_ and "presence" in result:
            from riftberg.ensembles.probability import notes
            from riftberg.viz.forecast import draw_forecast

            draw_forecast(result, store.folder / "forecast.png", notes=notes(result))
            files.append("forecast.png")
        from riftberg.ensembles.probability import told

        for line in told(result):
            typer.echo(line)
        typer.echo(f"Written to {store.folder}: {', '.join(files)}")


def first_picture(result: xr.Dataset, path: Path) -> None:
    """Draw the members that are done while others still run."""
    if "presence" in result:
        from riftberg.ensembles.probability import notes
        from riftberg.viz.forecast import draw_forecast

        draw_forecast(result, path, notes=notes(result))
        say(f"{path}: a first picture, of {int((result['status'] == 0).sum())} members")
