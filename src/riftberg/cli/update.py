"""``riftberg update``: a forecast after new sightings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from riftberg.cli.options import (
    AzimuthError,
    BergInFile,
    Broken,
    Hour,
    PositionError,
    Quiet,
    WholeUntil,
    Workers,
    check_folder,
    within,
)
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.verification.positions import AZIMUTH_ERROR, USUAL_ERROR


@reported
def update(
    folder: Annotated[Path, typer.Argument(help="Folder of a forecast.")],
    observed: Annotated[
        Path | None, typer.Argument(metavar="[OBSERVED]", help="Outlines or positions; those during the forecast count.")
    ] = None,
    berg: BergInFile = None,
    error: PositionError = USUAL_ERROR,
    azimuth_error: AzimuthError = AZIMUTH_ERROR,
    hour: Hour = None,
    broken: Broken = None,
    whole_until: WholeUntil = None,
    doubt: Annotated[
        float, typer.Option("--doubt", help="Probability that it was wrongly seen broken or whole, %.")
    ] = 5.0,
    resample: Annotated[
        bool,
        typer.Option("--resample/--no-resample", help="Run new members around those that count where these are too few."),
    ] = True,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the new members.  [default: FOLDER-updated]")
    ] = None,
    workers: Workers = None,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Weight the members of a forecast by new sightings; where too few of them count, run new ones around these."""
    from dataclasses import replace

    import numpy as np

    from riftberg.cli.sweep import resumed
    from riftberg.config.values import parse_date
    from riftberg.diagnostics.observed import read_observed
    from riftberg.ensembles.probability import told
    from riftberg.ensembles.result import open_sweep
    from riftberg.ensembles.sweep import Store, planned, read_plan, run_sweep
    from riftberg.errors import InputError
    from riftberg.runs.progress import SweepBar
    from riftberg.verification.update import FEWEST, drawn_anew, log_likelihood, weighted

    within(error, "--error", 0.01, 1000.0)
    within(azimuth_error, "--azimuth-error", 0.1, 90.0)
    within(doubt, "--doubt", 0.01, 50.0)
    within(hour, "--hour", 0.0, 24.0)
    if not read_plan(folder).get("forecast"):
        raise InputError("holds a sweep, no forecast", where=str(folder), remedy="Name a folder of 'riftberg forecast'")
    store = resumed(folder, None, None, {}, "forecast")
    new = output or folder.with_name(f"{folder.name}-updated")
    seen = None if observed is None else read_observed(observed)
    dates = {
        name: None if text is None else parse_date(text, where=option)[0]
        for name, text, option in (("broken", broken, "--broken"), ("whole_until", whole_until, "--whole-until"))
    }

    def count_of(likelihood: Any) -> int:
        return int(np.isfinite(likelihood).sum())  # those that did not fail, however little they weigh

    def likelihood(of: Store) -> Any:
        ds = open_sweep(of.file, tracks=False)
        try:
            return log_likelihood(
                ds, seen, error=error, berg=berg, hour=hour, doubt=doubt / 100.0, azimuth_error=azimuth_error, **dates
            )
        finally:
            ds.close()

    about = ", ".join(str(text) for text in (observed, broken, whole_until) if text is not None)
    known = likelihood(store)
    if output is not None:
        check_folder(new, ("sweep.json", "forecast.nc"))  # before anything is written
    weight, number = weighted(store, known, about)
    done = count_of(known)
    say(f"{number:.1f} of {done} members count (effective number)")
    if number < FEWEST * done and resample:
        check_folder(new, ("sweep.json", "forecast.nc"))
        announce_compilation(quiet)
        columns, base = drawn_anew(store.plan, weight, known)
        plan = store.plan
        again = planned(plan.experiment, columns, replace(plan.options, days=plan.days), plan.every / 3600.0,
                        forecast=True, design=True)  # fmt: skip
        store = Store(new, again, resume=False)
        bar = None if quiet else SweepBar(len(again.members) + 1)
        run_sweep(store, workers=workers, bar=bar).close()
        store.set_base(base)
        known = likelihood(store)
        _, number = weighted(store, known, about)
        say(f"New members: {number:.1f} of {count_of(known)} count")
    for line in told(open_sweep(store.file)):
        typer.echo(line)
    typer.echo(f"Written to {store.folder}: {store.file.name}, weights.json")
