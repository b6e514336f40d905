"""``riftberg calibrate``: which inputs of an experiment agree with what was observed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from riftberg.cli.options import (
    AllowMore,
    AzimuthError,
    BergInFile,
    Broken,
    Data,
    Days,
    ExperimentToRun,
    Hour,
    OneNumerics,
    PositionError,
    Quiet,
    Resume,
    Scheduler,
    Seed,
    Settings,
    WholeUntil,
    Without,
    Workers,
    check_folder,
    make_options,
    output_folder,
    results_folder,
    within,
)
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.errors import InputError
from riftberg.system.limits import allow_large
from riftberg.verification.positions import AZIMUTH_ERROR, USUAL_ERROR

RESULTS = ("calibration.nc", "calibration.csv", "posterior.png", "predictive.png")
"""Files that the command writes into its folder, beside one folder for each wave."""

ASKED = "calibration.json"
"""File that says what is calibrated, for `--resume`."""


@reported
def calibrate(
    experiment: ExperimentToRun = None,
    observed: Annotated[Path | None, typer.Argument(metavar="[OBSERVED]", help="Outlines or positions.")] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="GROUP.NAME~DISTRIBUTION",
                     help="What is to be found: 'start.strength~lognormal(1, 40 %)'. May be repeated."),
    ] = None,
    broken: Broken = None,
    whole_until: WholeUntil = None,
    one_break_until: Annotated[
        str | None, typer.Option("--one-break-until", metavar="DATE", help="When it was last seen broken only once.")
    ] = None,
    second_break: Annotated[
        str | None, typer.Option("--second-break", metavar="DATE", help="When it was first seen broken a second time.")
    ] = None,
    berg: BergInFile = None,
    hour: Hour = None,
    error: PositionError = USUAL_ERROR,
    azimuth_error: AzimuthError = AZIMUTH_ERROR,
    model_error: Annotated[
        float, typer.Option("--model-error", help="Error of the model's own position along each axis, km.")
    ] = 3.0,
    waves: Annotated[int, typer.Option("--waves", min=1, max=10, help="Waves of members.")] = 3,
    members: Annotated[
        int | None, typer.Option("--members", min=1, help="Members of a wave.  [default: ten for each input]")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-calibration]")
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
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw posterior.png and predictive.png.")] = True,
    quiet: Quiet = False,
    large: AllowMore = False,
) -> None:  # fmt: skip
    """Find inputs that agree with observed positions, headings and break-up, and say how well they are known."""
    from riftberg.diagnostics.dates import parse_date
    from riftberg.diagnostics.observed import read_observed
    from riftberg.runs.progress import SweepBar
    from riftberg.system.atomic_files import write_text
    from riftberg.verification.calibrate import Errors
    from riftberg.verification.calibrate import calibrate as calibrated

    within(error, "--error", 0.01, 1000.0)
    within(azimuth_error, "--azimuth-error", 0.1, 90.0)
    within(model_error, "--model-error", 0.0, 1000.0)
    within(hour, "--hour", 0.0, 24.0)
    asked: dict[str, Any] = {
        "experiment": experiment, "observed": None if observed is None else str(observed.absolute()), "vary": vary or [],
        "broken": broken, "whole_until": whole_until, "one_break_until": one_break_until,
        "second_break": second_break, "berg": berg, "hour": hour, "error": error,
        "azimuth_error": azimuth_error, "model_error": model_error, "waves": waves, "members": members,
        "settings": settings or [], "days": days, "data": None if data is None else str(data.absolute()),
        "without": without or [], "numerics": numerics, "seed": seed,
    }  # fmt: skip
    if resume is not None:
        if experiment is not None:
            raise InputError(
                "a calibration that goes on stays what it is", where="--resume", remedy="Name its folder alone"
            )
        asked, folder = _asked(resume), resume
    elif experiment is None:
        raise InputError("no experiment is named", where="calibrate", remedy="Name one, or give --resume FOLDER")
    else:
        folder = output_folder(output, f"{Path(experiment).stem}-calibration", ASKED)
        if (folder / ASKED).exists():
            raise InputError(
                "holds a calibration already",
                where=str(folder),
                remedy="Go on with it by --resume, or name another folder",
            )
    names = RESULTS if figure else RESULTS[:2]
    check_folder(folder, names)
    made = make_options(asked["settings"], asked["days"], None if asked["data"] is None else Path(asked["data"]),
                        asked["without"], asked["numerics"])  # fmt: skip
    # A calibration of an earlier version has no second break-up.
    dates = {name: None if asked.get(name) is None else parse_date(asked[name], where=f"--{name.replace('_', '-')}")[0]
             for name in ("broken", "whole_until", "one_break_until", "second_break")}  # fmt: skip
    errors = Errors(asked["error"], asked["azimuth_error"], asked["model_error"])
    with allow_large(large), results_folder(folder, names):
        announce_compilation(quiet)

        def bar(name: str, count: int) -> SweepBar | None:
            if name == "wave-1":  # all that can be refused has been
                write_text(folder / ASKED, json.dumps(asked, indent=1) + "\n")
            if quiet:
                return None
            said = name.replace("-firm", ", the same with ice that does not break").replace("-", " ")
            say(f"{said.capitalize()}: {count} runs")
            return SweepBar(count)

        try:
            found = calibrated(
                str(asked["experiment"]), None if asked["observed"] is None else read_observed(asked["observed"]), asked["vary"],
                days=asked["days"], errors=errors, berg=asked["berg"], hour=asked["hour"], waves=asked["waves"],
                members=asked["members"], output=folder, resume=resume is not None, bar=bar, changes=made.changes,
                data=asked["data"], without=asked["without"], numerics=asked["numerics"], seed=asked["seed"] or 1,
                scheduler=scheduler, workers=workers, **dates,
            )  # fmt: skip
        except (KeyboardInterrupt, SystemExit):
            if (folder / ASKED).exists():
                say(f"What is done stays. Go on with: riftberg calibrate --resume {folder}")
            raise
        write_results(found, folder, figure=figure)
    for line in told(found, errors):
        typer.echo(line)
    typer.echo(f"Written to {folder}: {', '.join(names)}")


def _asked(folder: Path) -> dict[str, Any]:
    """Return what the calibration in a folder is."""
    from riftberg.system.input_files import check_file, reading

    remedy = "Name a folder that 'riftberg calibrate' made"
    file = check_file(folder / ASKED, remedy=remedy, missing="holds no calibration")
    with reading(file, "not what a calibration is", remedy):
        asked: dict[str, Any] = dict(json.loads(file.read_text("utf-8")))
        asked["experiment"], asked["vary"], asked["waves"], asked["numerics"]
    return asked


def write_results(found: Any, folder: Path, *, figure: bool = True) -> None:
    """Write a calibration: its numbers, the table of its inputs, and the pictures."""
    from riftberg.system.atomic_files import write_text
    from riftberg.system.netcdf_lock import write_dataset

    write_dataset(found, folder / RESULTS[0])
    columns = ["unit", *(f"{when}_{end}" for when in ("prior", "posterior") for end in ("low", "median", "high")), "narrowed",
               "known", "likeliest"]  # fmt: skip
    table = found[columns].to_dataframe()
    table.loc[~table["known"], ["likeliest"]] = float("nan")  # what the data cannot tell is no number
    write_text(folder / RESULTS[1], table.to_csv(lineterminator="\n"))
    if figure:
        from riftberg.viz.inputs import draw_posterior, draw_predictive

        draw_posterior(found, folder / RESULTS[2])
        draw_predictive(found, folder / RESULTS[3])


def told(found: Any, errors: Any) -> list[str]:
    """Return a calibration in a few lines."""
    from riftberg.verification.calibrate import MODEL_ERROR, UNKNOWN

    lines = [
        f"Errors: observed {errors.position:g} km, {errors.azimuth:g} degrees; model {errors.model:g} km, "
        f"{MODEL_ERROR['degree']:g} degrees, margin {100 * MODEL_ERROR['log']:g} %"
    ]
    for k, left in enumerate(found["wave_left"].values.tolist()):
        lines.append(
            f"  wave {k + 1}, {int(found['wave_members'][k])} members: {100 * left:.3g} % of the distributions are left"
        )
    for name in found["parameter"].values:
        row = found.sel(parameter=name)
        unit = "" if row["unit"].item() == "1" else f" {row['unit'].item()}"
        before = f"{float(row['prior_low']):.4g} to {float(row['prior_high']):.4g}{unit}"
        if not bool(row["known"]):
            few = (
                f", or too few members count ({found.attrs['effective_members']:.0f})"
                if float(row["narrowed"]) < UNKNOWN
                else ""
            )
            lines.append(f"  {name}: unknown; the data leave {before} nearly as it was{few}")
            continue
        after = f"{float(row['posterior_low']):.4g} to {float(row['posterior_high']):.4g}{unit}"
        lines.append(f"  {name}: {float(row['posterior_median']):.4g}{unit} ({after}), likeliest {float(row['likeliest']):.4g}; "
                     f"before {before}")  # fmt: skip
    names, both = found["parameter"].values.tolist(), found["correlation"].values
    for i in range(len(names)):
        for j in range(i):
            if abs(both[i, j]) > 0.5 and (found["known"].values[i] or found["known"].values[j]):
                lines.append(f"  {names[j]} and {names[i]} go together: correlation {both[i, j]:+.2f}")
    lines.append(
        f"  {found.attrs['effective_members']:.0f} of {found.sizes['member']} members count (effective number)"
    )
    return lines
