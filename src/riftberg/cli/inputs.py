"""``riftberg sensitivity`` and ``riftberg calibrate``: which inputs matter, and which agree with observations."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.ensembles import open_store, run_members
from riftberg.cli.options import (
    AzimuthError,
    BergInFile,
    Broken,
    DefaultErrors,
    EnsembleOptions,
    ExperimentToRun,
    Figure,
    Hour,
    PositionError,
    VaryDrawn,
    WholeUntil,
    announce_compilation,
    check_folder,
    check_positive,
    check_range,
    load_observed,
    make_options,
    output_folder,
    report_errors,
    results_folder,
    say,
    tell,
    with_ensemble_options,
)
from riftberg.errors import InputError, RunError
from riftberg.system.input_files import allow_large
from riftberg.verification.scores import AZIMUTH_ERROR, USUAL_ERROR

if TYPE_CHECKING:
    from riftberg.ensembles.sweep import Plan


RESULTS = ("sweep.nc", "sweep.json", "sensitivity.csv", "sensitivity.png")
"""Files that the command writes into its folder, beside the folder ``members``."""


@report_errors
@with_ensemble_options
def sensitivity(
    context: typer.Context,
    experiment: ExperimentToRun = None,
    method: Annotated[
        str, typer.Option("--method", help="morris: effects, for a first look at many inputs; sobol: parts of the variance.")
    ] = "morris",
    draws: Annotated[
        int | None,
        typer.Option("--draws", min=2, help="Draws of one run for each input and one (morris) or two (sobol) more.  "
                     "[default: 16 for morris, 64 for sobol]"),
    ] = None,
    vary: VaryDrawn = None,
    default_errors: DefaultErrors = True,
    at_day: Annotated[
        list[float] | None,
        typer.Option("--at-day", help="Day by which the berg is broken or aground. May be repeated.  "
                     "[default: middle and end of the runs]"),
    ] = None,
    observed: Annotated[
        Path | None, typer.Option("--observed", metavar="FILE", help="Outlines or positions: the error of the drift too.")
    ] = None,
    berg: BergInFile = None,
    figure: Figure = True,
    *,
    shared: EnsembleOptions,
) -> None:  # fmt: skip
    """Show which input matters: Morris effects or Sobol' indices of stress, break-up, grounding, area and drift."""
    from riftberg.ensembles.forecast import forecast_errors
    from riftberg.ensembles.sensitivity import METHODS, USUAL_DRAWS, Result, indices, select_results
    from riftberg.ensembles.sweep import make_plan, read_draws
    from riftberg.system.atomic_files import write_text
    from riftberg.verification.sightings import drift_error, during, select_sightings

    if method not in METHODS:
        raise InputError(f"{method!r} is no method", where="--method", remedy=f"Use {' or '.join(METHODS)}")
    seen = None if observed is None else load_observed(observed)

    def make(experiment: str) -> Plan:
        errors = forecast_errors(experiment, vary or [], defaults=default_errors)
        drawn = read_draws({"members": draws or USUAL_DRAWS[method], "plan": METHODS[method], "seed": shared.seed})
        return make_plan(experiment, errors, shared.checked(), None, None, drawn)

    with allow_large(shared.large):
        announce_compilation(shared.quiet)
        store = open_store(context, "sensitivity", experiment, make, RESULTS, shared, draws)
        plan = store.plan
        if seen is not None:  # refused before the runs, not after them
            if not plan.first.parameters.earth.latlon:
                raise InputError(
                    "runs in metres", where="--observed", remedy="Observations need longitude and latitude"
                )
            end = plan.start + timedelta(days=plan.days)
            during(*select_sightings(seen, berg, plan.start, None), plan.start, end, str(observed))
        for day in at_day or ():
            check_positive(day, "--at-day", "days", most=plan.days)
        if not shared.quiet:
            say(
                f"{len(plan.members)} runs of {plan.days:g} days: {plan.draws.number} draws by the plan {plan.draws.plan}"
            )
        with results_folder(store.folder, RESULTS):
            ds = run_members(store, "sensitivity", shared)
            if not (ds["status"] == 0).any():
                raise RunError("no run came to its end")
            results = select_results(ds, at_day or ())
            if seen is not None:
                results["drift error"] = Result(drift_error(ds, seen, berg=berg), "km")
            sensitivities = indices(ds, results)
            write_text(store.folder / "sensitivity.csv", sensitivities.to_dataframe().to_csv(lineterminator="\n"))
            if figure:
                from riftberg.viz.ensemble import draw_sensitivity

                draw_sensitivity(
                    sensitivities, store.folder / "sensitivity.png", title=f"{plan.named}, {len(plan.members)} runs"
                )
        for line in summary_lines(sensitivities):
            tell(line)
        if note := sensitivities.attrs["note"]:
            tell(f"  {note}")
        tell(f"Written to {store.folder}: {', '.join(RESULTS if figure else RESULTS[:-1])}")


def summary_lines(sensitivities: Any) -> list[str]:
    """Return the inputs that matter most for each result, a line each."""
    lines = []
    for name in sensitivities["result"].values:
        row = sensitivities.sel(result=name)
        key = next((key for key in ("effect", "total") if key in row and row[key].notnull().any()), "correlation")
        if not float(row["spread"]) > 0.0 and key != "correlation":
            lines.append(f"  {name}: the same in all runs")
            continue
        if key not in row or not row[key].notnull().any():
            lines.append(f"  {name}: too few members have it")
            continue
        values, low, high = (row[f"{key}{end}"].values for end in ("", "_low", "_high"))
        best = sorted(range(values.size), key=lambda k: -abs(values[k]))[:4]
        inputs_text = ", ".join(
            f"{row['input'].values[k]} {values[k]:.2g} ({low[k]:.2g} to {high[k]:.2g})" for k in best
        )
        share = f", of the {100 * float(row['share']):.0f} % that have one" if key == "correlation" else ""
        unit = f" {row['unit'].item()}" if key == "effect" and row["unit"].item() != "1" else ""
        word = {"effect": "mean change", "total": "total index", "correlation": "rank correlation"}[key]
        lines.append(f"  {name} ({word}{unit}{share}): {inputs_text}")
    return lines


CALIBRATION = ("calibration.nc", "calibration.csv", "posterior.png", "predictive.png")
"""Files that the command writes into its folder, beside one folder for each wave."""

WHERE = ("output", "scheduler", "workers", "member_time", "resume", "figure", "quiet", "large", "verbose")
"""Parameters of the command that do not say what is calibrated."""

ASKED = "calibration.json"
"""File that says what is calibrated, for `--resume`."""


@report_errors
@with_ensemble_options
def calibrate(
    context: typer.Context,
    experiment: ExperimentToRun = None,
    observed: Annotated[Path | None, typer.Argument(metavar="[OBSERVED]", help="Outlines or positions.")] = None,
    vary: VaryDrawn = None,
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
    figure: Figure = True,
    *,
    shared: EnsembleOptions,
) -> None:  # fmt: skip
    """Find inputs that agree with observed positions, headings and break-up, and say how well they are known."""
    from riftberg.config.values import parse_date
    from riftberg.runs.progress import SweepBar
    from riftberg.system.atomic_files import write_text
    from riftberg.verification.calibrate import Errors
    from riftberg.verification.calibrate import calibrate as calibrated

    check_range(error, "--error", 0.01, 1000.0)
    check_range(azimuth_error, "--azimuth-error", 0.1, 90.0)
    check_range(model_error, "--model-error", 0.0, 1000.0)
    check_range(hour, "--hour", 0.0, 24.0)
    # What is calibrated, as it was given; where and how it runs may be another when it goes on.
    request: dict[str, Any] = {
        name: str(value.absolute()) if isinstance(value, Path) else value
        for name, value in context.params.items() if name not in WHERE
    }  # fmt: skip
    if shared.resume is not None:
        if experiment is not None:
            raise InputError(
                "a calibration that goes on stays what it is", where="--resume", remedy="Name its folder alone"
            )
        request, folder = _stored_request(shared.resume), shared.resume
    elif experiment is None:
        raise InputError("no experiment is named", where="calibrate", remedy="Name one, or give --resume FOLDER")
    else:
        folder = output_folder(shared.output, f"{Path(experiment).stem}-calibration", ASKED)
        if (folder / ASKED).exists():
            raise InputError(
                "holds a calibration already",
                where=str(folder),
                remedy="Go on with it by --resume, or name another folder",
            )
    names = CALIBRATION if figure else CALIBRATION[:2]
    check_folder(folder, names)
    options = make_options(request["settings"], request["days"], None if request["data"] is None else Path(request["data"]),
                        request["without"], request["numerics"])  # fmt: skip
    breaks = ("broken", "whole_until", "one_break_until", "second_break")
    dates: dict[str, Any] = {
        name: None if request[name] is None else parse_date(request[name], where=f"--{name.replace('_', '-')}")[0]
        for name in breaks
    }  # fmt: skip
    errors = Errors(request["error"], request["azimuth_error"], request["model_error"])
    seen = None if request["observed"] is None else load_observed(request["observed"])
    same = {name: request[name] for name in ("days", "berg", "hour", "waves", "members", "data", "numerics")}
    with allow_large(shared.large), results_folder(folder, names):
        announce_compilation(shared.quiet)

        def bar(name: str, count: int) -> SweepBar | None:
            if name == "wave-1":  # all that can be refused has been
                write_text(folder / ASKED, json.dumps(request, indent=1) + "\n")
            if shared.quiet:
                return None
            wave_title = name.replace("-firm", ", the same with ice that does not break").replace("-", " ")
            say(f"{wave_title.capitalize()}: {count} runs")
            return SweepBar(count)

        try:
            calibration = calibrated(
                str(request["experiment"]), seen, request["vary"] or [], errors=errors, output=folder,
                resume=shared.resume is not None, bar=bar, changes=options.changes, without=request["without"] or (),
                seed=request["seed"], scheduler=shared.scheduler, workers=shared.workers,
                member_time=shared.member_time, **same, **dates,
            )  # fmt: skip
        except (KeyboardInterrupt, SystemExit):
            if (folder / ASKED).exists():
                say(f"What is done stays. Go on with: riftberg calibrate --resume {folder}")
            raise
        write_results(calibration, folder, figure=figure)
    for line in calibration_lines(calibration, errors):
        tell(line)
    tell(f"Written to {folder}: {', '.join(names)}")


def _stored_request(folder: Path) -> dict[str, Any]:
    """Return the options of the calibration in a folder."""
    from riftberg.system.input_files import check_file, reading

    remedy = "Name a folder that 'riftberg calibrate' made"
    file = check_file(folder / ASKED, remedy=remedy, missing="holds no calibration")
    with reading(file, "not what a calibration is", remedy):
        request: dict[str, Any] = dict(json.loads(file.read_text("utf-8")))
        request["experiment"], request["vary"], request["waves"], request["numerics"]
    return request


def write_results(calibration: Any, folder: Path, *, figure: bool = True) -> None:
    """Write a calibration: its numbers, the table of its inputs, and the pictures."""
    from riftberg.system.atomic_files import write_text
    from riftberg.system.netcdf_lock import write_dataset

    write_dataset(calibration, folder / CALIBRATION[0])
    columns = ["unit", *(f"{when}_{end}" for when in ("prior", "posterior") for end in ("low", "median", "high")), "narrowed",
               "known", "likeliest"]  # fmt: skip
    table = calibration[columns].to_dataframe()
    table.loc[~table["known"], ["likeliest"]] = float("nan")  # what the data cannot tell is no number
    write_text(folder / CALIBRATION[1], table.to_csv(lineterminator="\n"))
    if figure:
        from riftberg.viz.ensemble import draw_posterior, draw_predictive

        draw_posterior(calibration, folder / CALIBRATION[2])
        draw_predictive(calibration, folder / CALIBRATION[3])


def calibration_lines(calibration: Any, errors: Any) -> list[str]:
    """Return a calibration in a few lines."""
    from riftberg.verification.calibrate import MODEL_ERROR, UNKNOWN

    lines = [
        f"Errors: observed {errors.position:g} km, {errors.azimuth:g} degrees; model {errors.model:g} km, "
        f"{MODEL_ERROR['degree']:g} degrees, margin {100 * MODEL_ERROR['log']:g} %"
    ]
    for k, left in enumerate(calibration["wave_left"].values.tolist()):
        lines.append(
            f"  wave {k + 1}, {int(calibration['wave_members'][k])} members: {100 * left:.3g} % of the distributions are left"
        )
    for name in calibration["parameter"].values:
        row = calibration.sel(parameter=name)
        unit = "" if row["unit"].item() == "1" else f" {row['unit'].item()}"
        prior = f"{float(row['prior_low']):.4g} to {float(row['prior_high']):.4g}{unit}"
        if not bool(row["known"]):
            few = (
                f", or too few members count ({calibration.attrs['effective_members']:.0f})"
                if float(row["narrowed"]) < UNKNOWN
                else ""
            )
            lines.append(f"  {name}: unknown; the data leave {prior} nearly as it was{few}")
            continue
        after = f"{float(row['posterior_low']):.4g} to {float(row['posterior_high']):.4g}{unit}"
        lines.append(f"  {name}: {float(row['posterior_median']):.4g}{unit} ({after}), likeliest {float(row['likeliest']):.4g}; "
                     f"before {prior}")  # fmt: skip
    names, correlations = calibration["parameter"].values.tolist(), calibration["correlation"].values
    for i in range(len(names)):
        for j in range(i):
            if abs(correlations[i, j]) > 0.5 and (calibration["known"].values[i] or calibration["known"].values[j]):
                lines.append(f"  {names[j]} and {names[i]} go together: correlation {correlations[i, j]:+.2f}")
    lines.append(
        f"  {calibration.attrs['effective_members']:.0f} of {calibration.sizes['member']} members count (effective number)"
    )
    return lines
