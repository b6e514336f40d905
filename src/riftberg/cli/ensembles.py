"""Commands of ensembles: ``sweep``, ``forecast``, ``update`` by sightings, ``hazard`` for others at sea, ``product-errors``."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import (
    AzimuthError,
    BergInFile,
    Broken,
    DefaultErrors,
    EnsembleOptions,
    EveryPosition,
    ExperimentToRun,
    Hour,
    Join,
    Members,
    PartOfMany,
    PlanName,
    PositionError,
    Quiet,
    VaryDrawn,
    WholeUntil,
    Workers,
    announce_compilation,
    check_folder,
    check_positive,
    check_range,
    load_observed,
    output_folder,
    pair,
    report_errors,
    results_folder,
    say,
    tell,
    with_ensemble_options,
)
from riftberg.config.units import duration_text, quantity_text
from riftberg.errors import InputError, RunError
from riftberg.system.input_files import allow_large
from riftberg.verification.scores import AZIMUTH_ERROR, USUAL_ERROR

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import xarray as xr

    from riftberg.ensembles.sweep import Plan, Store

SWEEP_FILES = ("sweep.nc", "sweep.json", "sweep.png")
"""Files that a sweep writes into its folder, beside the folder ``members``."""


@report_errors
@with_ensemble_options
def sweep(
    context: typer.Context,
    experiment: ExperimentToRun = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary", metavar="GROUP.NAME=VALUES",
            help="Parameter to vary: fracture.normal_strength=14..24kPa:11 for eleven values, or 14,18,24kPa; or a distribution, "
            "'fracture.normal_strength~lognormal(18 kPa, 20 %)', with --members. May be repeated.",
        ),
    ] = None,
    design: Annotated[
        Path | None,
        typer.Option("--design", metavar="FILE.csv", help="Plan of another tool: names in the first line, then a member a line."),
    ] = None,
    part: PartOfMany = None,
    join: Join = None,
    members: Members = None,
    plan: PlanName = None,
    every: EveryPosition = None,
    cells: Annotated[
        float | None,
        typer.Option(
            "--cells", help="Write fresh water, heat and mass of each member on cells of this width (degrees), in folder cells."
        ),
    ] = None,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw sweep.png.")] = True,
    *,
    shared: EnsembleOptions,
) -> None:  # fmt: skip
    """Run an ensemble: an experiment for every combination of parameter values, collected in one result."""
    from riftberg.ensembles.sweep import make_plan, read_draws
    from riftberg.ensembles.vary import Draws, read_design

    with allow_large(shared.large):
        check_positive(every, "--every", "hours", most=1e6)
        announce_compilation(shared.quiet)
        if join is not None:
            _run(join_store(context, join, "sweep"), replace(shared, workers=0), draw=map_)
            return

        def make(experiment: str) -> Plan:
            draws = read_draws({"members": members, "plan": plan, "seed": shared.seed})
            if design is not None and (vary or draws != Draws()):
                raise InputError(
                    "a design says itself what varies", where="--design",
                    remedy="Leave --vary, --members, --plan and --seed out",
                )  # fmt: skip
            variations = (vary or []) if design is None else read_design(design)
            return make_plan(experiment, variations, shared.checked(), every, cells, draws, design=design is not None)

        store = open_store(context, "sweep", experiment, make, SWEEP_FILES, shared, members, part)
        _run(store, shared, draw=map_)


def open_store(
    context: typer.Context, command: str, experiment: str | None, make: Callable[[str], Plan], results: Sequence[str],
    shared: EnsembleOptions, members: int | None, part: str | None = None,
) -> Store:  # fmt: skip
    """Return an ensemble at its start, checked, or one that goes on in its folder (see `resume_store`)."""
    from riftberg.ensembles.sweep import Store

    of_many = _part(part)
    if shared.resume is not None:
        if part is not None:
            raise InputError(
                "a part goes on by itself", where="--resume", remedy="Name the folder of the part, without --part"
            )
        if changed := options_given(context, *KEPT):
            raise InputError(
                "a sweep that goes on stays what it is, in its folder", where="--resume",
                remedy=f"Leave out {', '.join(changed)}",
            )  # fmt: skip
        return resume_store(shared.resume, experiment, members, "forecast" if command == "forecast" else "sweep")
    if experiment is None:
        raise InputError(
            "no experiment is named", where=command, remedy="Name one, or go on with one by --resume FOLDER"
        )
    plan = make(experiment)
    folder = output_folder(shared.output, f"{Path(experiment).stem}-{command}", "sweep.json")
    check_folder(folder, results)
    return Store(folder, plan, resume=False, part=of_many)


def join_store(context: typer.Context, folder: Path, kind: str) -> Store:
    """Return the parts of a sweep or forecast in a folder as one that has nothing left to run; say what is missing."""
    from riftberg.ensembles.sweep import join_parts

    if options_given(context, *KEPT, "experiment", "resume", "part", "members"):
        raise InputError("parts are joined as they are", where="--join", remedy="Give --join FOLDER alone")
    missing = join_parts(folder)
    store = resume_store(folder, kind=kind)
    if missing:
        numbers = ", ".join(map(str, missing[:10])) + (", ..." if len(missing) > 10 else "")
        say(f"Missing: part{'s' if len(missing) > 1 else ''} {numbers}; {len(store.waiting())} members wait")
    store.assigned = []
    return store


def _part(text: str | None) -> tuple[int, int] | None:
    """Read ``3/40``."""
    if text is None:
        return None
    first, slash, second = text.partition("/")
    if not (slash and first.strip().isdigit() and second.strip().isdigit() and 1 <= int(first) <= int(second)):
        raise InputError(f"{text!r} is no part", where="--part", remedy="Give its number and how many there are: 3/40")
    return int(first), int(second)


KEPT = ("vary", "design", "plan", "seed", "output", "settings", "days", "data", "without", "numerics", "every", "cells",
        "default_errors")  # fmt: skip
"""Parameters of the commands that say what a sweep is, and stay as they are when it goes on."""


def options_given(context: typer.Context, *names: str) -> list[str]:
    """Return the parameters of a command that were given on the command line, as written there."""
    sources = {p: context.get_parameter_source(str(p.name)) for p in context.command.params if p.name in names}
    return [(p.secondary_opts or p.opts)[0] for p, source in sources.items() if source and source.name == "COMMANDLINE"]


def resume_store(folder: Path, experiment: str | None = None, members: int | None = None, kind: str = "sweep") -> Store:
    """Return the sweep in a folder with the members that are done; more members may be drawn than before."""
    from riftberg.ensembles.sweep import Store, make_plan, read_draws, read_plan
    from riftberg.experiments.registry import Options

    stored = read_plan(folder)
    held_kind = "forecast" if stored.get("forecast") else "sweep"
    if held_kind != kind:
        raise InputError(
            f"holds a {held_kind}", where=f"--resume {folder}", remedy=f"Go on by 'riftberg {held_kind} --resume'"
        )
    if experiment is not None and Path(experiment).stem != Path(stored["experiment"]).stem:
        raise InputError(f"a sweep of {stored['experiment']}, not of {experiment}", where=f"--resume {folder}")
    if members is not None and stored.get("design"):
        raise InputError(
            "its members are the rows of a table", where=f"--resume {folder}, --members", remedy="Leave --members out"
        )
    options = Options(
        changes=stored["changes"], days=stored["days"], data=None if stored["data"] is None else Path(stored["data"]),
        without=frozenset(stored["without"]), numerics=stored["numerics"],
    )  # fmt: skip
    every = stored["every"] / 3600.0
    draws = read_draws(
        {"members": members or stored.get("members"), "plan": stored.get("plan"), "seed": stored.get("seed")}
    )
    plan = make_plan(stored["experiment"], stored["vary"], options, every, stored.get("cells"), draws,
                   forecast=bool(stored.get("forecast")), design=bool(stored.get("design")))  # fmt: skip
    return Store(folder, plan, resume=True)


def _run(store: Store, shared: EnsembleOptions, *, draw: bool) -> None:
    """Run the members that are not done, and write and print the result."""
    from riftberg.ensembles.vary import order_line

    if not shared.quiet:
        plan = store.plan
        varied = ", ".join(v.told() for v in plan.varied)
        done_text = f", {len(store.done)} are done" if store.done else ""
        say(f"{len(plan.members)} members ({varied}), {duration_text(plan.days)} each{done_text}")
        if note := order_line([v.name for v in plan.varied]):
            say(note)
    with results_folder(store.folder, SWEEP_FILES):
        result = run_members(store, "sweep", shared)
    files = ["sweep.nc", "sweep.json", *(["cells/"] if store.plan.cells is not None else [])]
    if draw and (result["status"] == 0).any():
        from riftberg.viz.ensemble import draw_sweep

        draw_sweep(result, store.folder / "sweep.png")
        files.append("sweep.png")
    for line in summary_lines(result):
        tell(line)
    tell(f"Written to {store.folder}: {', '.join(files)}")
    if store.assigned and not (result["status"] == 0).any():
        raise RunError("no member came to its end")


def run_members(store: Store, command: str, shared: EnsembleOptions) -> xr.Dataset:
    """Run the members that are not done; say how an ensemble that is stopped goes on."""
    from riftberg.ensembles.sweep import run_sweep
    from riftberg.runs.progress import SweepBar

    number = len(store.plan.members) + store.plan.forecast  # a forecast has its control beside the members
    try:
        bar = None if shared.quiet else SweepBar(number)
        return run_sweep(
            store, scheduler=shared.scheduler, workers=shared.workers, member_time=shared.member_time, bar=bar
        )
    except (KeyboardInterrupt, SystemExit):
        say(f"{len(store.done)} of {number} members are done. "
            f"Go on with: riftberg {command} --resume {store.folder}")  # fmt: skip
        raise


def summary_lines(result: xr.Dataset) -> list[str]:
    """Return a sweep in a few lines: the result of each member, and the failures."""
    from riftberg.ensembles.probability import fates, reasons

    names = [str(name) for name in result.coords if "parameter" in result[name].attrs]
    lines = []
    for k in range(min(result.sizes["member"], 20)):
        member = result.isel(member=k)
        settings_text = ", ".join(f"{member[name].attrs['parameter']} {_value(member[name])}" for name in names)
        if int(member["status"]) == 0:
            pieces, area = (float(member[name]) for name in ("pieces", "largest_area"))
            end = (
                f"in one piece, {area / 1e6:.0f} km2"
                if pieces == 1
                else f"{pieces:.0f} pieces, largest {area / 1e6:.0f} km2"
            )
            date = str(member["first_breakup"].values)[:16]
            lines.append(
                f"  {settings_text}: {end}" + ("" if date == "NaT" else f", first break-up {date.replace('T', ' ')}")
            )
        else:
            how = {1: f"failed: {member['message'].item()}", 3: member["message"].item()}
            lines.append(f"  {settings_text}: {how.get(int(member['status']), 'waits')}")
    if result.sizes["member"] > 20:
        lines += [f"  and {result.sizes['member'] - 20} more, see sweep.nc", *reasons(result)]
    return [f"{result.attrs['title']}, {fates(result)}", *lines]


def _value(value: xr.DataArray) -> str:
    item = value.item()
    return quantity_text(item, value.attrs.get("units", "1")) if isinstance(item, float) else str(item)


FORECAST_FILES = ("forecast.nc", "sweep.json", "control.nc", "forecast.png")
"""Files that a forecast writes into its folder, beside the folder ``members``."""


@report_errors
@with_ensemble_options
def forecast(
    context: typer.Context,
    experiment: ExperimentToRun = None,
    members: Members = None,
    vary: VaryDrawn = None,
    default_errors: DefaultErrors = True,
    every: EveryPosition = None,
    plan: PlanName = None,
    part: PartOfMany = None,
    join: Join = None,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw forecast.png.")] = True,
    *,
    shared: EnsembleOptions,
) -> None:  # fmt: skip
    """Forecast how likely a berg breaks, grounds and where it drifts: an ensemble with errors in all inputs."""
    from riftberg.ensembles.forecast import errors_line, forecast_plan
    from riftberg.ensembles.probability import notes, told
    from riftberg.ensembles.sweep import WEIGHTS, read_draws
    from riftberg.ensembles.vary import order_line

    def make(experiment: str) -> Plan:
        draws = read_draws({"members": members, "plan": plan, "seed": shared.seed})
        return forecast_plan(experiment, vary or [], shared.checked(), every, draws, defaults=default_errors)

    with allow_large(shared.large):
        check_positive(every, "--every", "hours", most=1e6)
        announce_compilation(shared.quiet)
        if join is not None:
            store, shared = join_store(context, join, "forecast"), replace(shared, workers=0)
        else:
            store = open_store(context, "forecast", experiment, make, FORECAST_FILES, shared, members, part)
        if not shared.quiet:
            say(errors_line(store.plan.varied))
            if note := order_line([text.partition("~")[0].partition("=")[0] for text in vary or ()]):
                say(note)
            if map_:
                store.look = partial(first_picture, path=store.folder / "forecast.png")
            for v in store.plan.varied:
                if v.distribution is not None and v.distribution.cut_off >= 5e-5:
                    say(f"  {v.told()}")
        with results_folder(store.folder, FORECAST_FILES):
            result = run_members(store, "forecast", shared)
        if (store.folder / WEIGHTS).exists() and not store.weights():
            say("Weights of earlier sightings do not hold for members that were added: use riftberg update once more")
        files = [name for name in FORECAST_FILES[:-1] if (store.folder / name).exists()]
        some_done = bool((result["status"] == 0).any())
        if store.assigned and not some_done:
            message = next((str(text) for text in result["message"].values if text), "")
            raise RunError(f"no member came to its end{': ' if message else ''}{message}")
        if map_ and "presence" in result:
            from riftberg.viz.ensemble import draw_forecast

            draw_forecast(result, store.folder / "forecast.png", notes=notes(result))
            files.append("forecast.png")
        for line in told(result) if some_done else ():
            tell(line)
        tell(f"Written to {store.folder}: {', '.join(files)}")


def first_picture(result: xr.Dataset, path: Path) -> None:
    """Draw the members that are done while others still run."""
    if "presence" in result:
        from riftberg.ensembles.probability import notes
        from riftberg.viz.ensemble import draw_forecast

        draw_forecast(result, path, notes=notes(result))
        say(f"{path}: a first picture, of {int((result['status'] == 0).sum())} members")


@report_errors
def product_errors(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="File of a product with currents.")],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="File of another one, of the same days and area.")],
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Box.  [default: what both cover]")] = None,
    lat: Annotated[str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Box.")] = None,
) -> None:  # fmt: skip
    """Estimate the error of the current by the differences of two products: size, length, time."""
    from riftberg.ensembles.uncertain import estimate_errors

    estimate = estimate_errors(first, second, longitude=pair(lon, "--lon"), latitude=pair(lat, "--lat"))
    tell(f"{estimate.points} points, {estimate.records} dates; half of the squared difference, if both err alike:")
    tell("  " + " ".join(f"--vary '{text}'" for text in estimate.vary))
    tell("  A lower bound: errors that both products share are not in their difference.")


@report_errors
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
    import numpy as np

    from riftberg.config.values import parse_date
    from riftberg.ensembles.probability import told
    from riftberg.ensembles.result import open_sweep
    from riftberg.ensembles.sweep import Store, make_plan, read_plan, run_sweep
    from riftberg.runs.progress import SweepBar
    from riftberg.verification.sightings import FEWEST, log_likelihood, redraw_members, weighted

    check_range(error, "--error", 0.01, 1000.0)
    check_range(azimuth_error, "--azimuth-error", 0.1, 90.0)
    check_range(doubt, "--doubt", 0.01, 50.0)
    check_range(hour, "--hour", 0.0, 24.0)
    if not read_plan(folder).get("forecast"):
        raise InputError("holds a sweep, no forecast", where=str(folder), remedy="Name a folder of 'riftberg forecast'")
    store = resume_store(folder, kind="forecast")
    new = output or folder.with_name(f"{folder.name}-updated")
    seen = None if observed is None else load_observed(observed)
    dates = {
        name: None if text is None else parse_date(text, where=option)[0]
        for name, text, option in (("broken", broken, "--broken"), ("whole_until", whole_until, "--whole-until"))
    }

    def count_finite(likelihood: Any) -> int:
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
    log_likelihoods = likelihood(store)
    if output is not None:
        check_folder(new, ("sweep.json", "forecast.nc"))  # before anything is written
    weight, number = weighted(store, log_likelihoods, about)
    completed = count_finite(log_likelihoods)
    say(f"{number:.1f} of {completed} members count (effective number)")
    if number < FEWEST * completed and resample:
        check_folder(new, ("sweep.json", "forecast.nc"))
        announce_compilation(quiet)
        columns, base, parents = redraw_members(store.plan, weight, log_likelihoods)
        plan = store.plan
        again = make_plan(plan.experiment, columns, replace(plan.options, days=plan.days), plan.every / 3600.0,
                        forecast=True, design=True)  # fmt: skip
        store = Store(new, again, resume=False)
        bar = None if quiet else SweepBar(len(again.members) + 1)
        run_sweep(store, workers=workers, bar=bar).close()
        store.set_base(base)
        log_likelihoods = likelihood(store)
        _, number = weighted(store, log_likelihoods, about)
        origin_text = (
            f"around {parents} of the old ones" if parents > 1 else "around a single one, with its random fields"
        )
        say(f"New members {origin_text}: {number:.1f} of {count_finite(log_likelihoods)} count")
    for line in told(open_sweep(store.file)):
        tell(line)
    tell(f"Written to {store.folder}: {store.file.name}, weights.json")


HAZARDS = ("hazard.geojson", "hazard.kml", "hazard.nc", "hazard.csv", "near.csv")
"""Files of a folder of hazards; the last one where a place is named."""


@report_errors
def hazard(
    folder: Annotated[Path, typer.Argument(help="Folder of a forecast, or its forecast.nc.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files.  [default: folder hazard of the forecast]")
    ] = None,
    near: Annotated[
        Path | None,
        typer.Option("--near", metavar="FILE", help="Points, routes or areas (GeoJSON, shapefile, KML) that ice may come near."),
    ] = None,
    near_by: Annotated[
        str, typer.Option("--within", metavar="DISTANCE", help="How near: 5nm are nautical miles; 10km.")
    ] = "5nm",
) -> None:  # fmt: skip
    """Write limits of ice, positions with error radius and probabilities of a forecast as GeoJSON, KML, netCDF and CSV."""
    from riftberg.ensembles import hazard as products
    from riftberg.ensembles.result import open_sweep
    from riftberg.system.atomic_files import write_text
    from riftberg.system.netcdf_lock import write_dataset

    result = open_sweep(folder)
    if "cone_lon" not in result:
        raise InputError("holds no forecast in degrees with members that are done", where=str(folder),
                         remedy="Name a folder that 'riftberg forecast' made")  # fmt: skip
    distance = _distance(near_by)
    targets = [] if near is None else _read_targets(near)
    out = output or (folder if folder.is_dir() else folder.parent) / "hazard"
    check_folder(out, HAZARDS)
    with results_folder(out, HAZARDS, locked=HAZARDS):
        limits = products.ice_limits(result)
        features = products.geojson(result, limits)
        write_text(out / "hazard.geojson", json.dumps(features) + "\n")
        write_text(out / "hazard.kml", products.kml(features))
        write_text(out / "hazard.csv", _table(products.positions(result)))
        gridded = products.gridded(result)
        encoding: dict[str, Any] = {str(n): {"zlib": True} for n, v in gridded.data_vars.items() if v.ndim > 1}
        # Coordinates have no missing values, and so no number that stands for one (CF, 2.5.1).
        encoding |= {str(n): {"_FillValue": None} for n in gridded.coords}
        write_dataset(gridded, out / "hazard.nc", encoding=encoding)
        files = list(HAZARDS[:-1])
        for limit in limits:
            if limit.date is None and limit.percent is None:
                tell(f"range of all ice of the members, whole time: {products.area_km2(limit.line):.0f} km2; "
                     "too few members count for limits of ice")  # fmt: skip
            elif limit.date is None:
                tell(f"{limit.percent} % limit of ice, whole time: {products.area_km2(limit.line):.0f} km2, "
                           f"all ice of {100 * limit.inside:.0f} % of the members inside")  # fmt: skip
        if targets:
            rows = []
            for name, shape in targets:
                closest = products.approach(result, name, shape, distance)
                tell(closest.told())
                rows += closest.rows()
            write_text(out / "near.csv", _table(rows))
            files.append("near.csv")
        tell(f"Not covered: {result.attrs.get('not_covered', 'ice smaller than an element')}")
        tell(f"Written to {out}: {', '.join(files)}")


def _distance(text: str) -> float:
    from riftberg.config.values import number

    match = re.fullmatch(r"\s*([-+.\deE]*\d\.?)\s*(.*?)\s*", text)
    if match is None or not match[2]:
        raise InputError(
            "no distance with a unit", where=f"--within {text}", remedy="Give a distance, such as 5nm or 10km"
        )
    # A ship's nm is the nautical mile; nanometres come near nothing.
    unit = "nmi" if match[2].lower() == "nm" else match[2]
    metres = number(f"{match[1]} {unit}", "m", where=f"--within {text}")
    if not 0.0 <= metres < 2e7:
        raise InputError(f"{metres:g} m", where=f"--within {text}", remedy="Give a distance, such as 5nm or 10km")
    return metres


def _read_targets(path: Path) -> list[tuple[str, Any]]:
    """Return names and shapes (degrees) of a file."""
    from riftberg.bergs.outline import read_features
    from riftberg.errors import BergError
    from riftberg.system.input_files import check_file

    remedy = "Give points, lines or areas in longitude and latitude as GeoJSON, shapefile or KML"
    check_file(path, remedy=remedy)
    try:
        features = read_features(path, lines=True)
    except BergError as error:
        raise InputError(error.what, where=str(path), remedy=remedy) from error
    targets = [(str(feature.properties.get("name") or ""), feature.geometry) for feature in features]
    if any(shape.is_empty for _, shape in targets):
        raise InputError("holds an empty shape", where=str(path), remedy=remedy)
    for _, shape in targets:
        west, south, east, north = shape.bounds
        if south < -90.0 or north > 90.0 or west < -360.0 or east > 540.0:
            raise InputError("positions are no degrees", where=str(path), remedy=remedy)
    return [(name or f"{path.stem} {k + 1}", shape) for k, (name, shape) in enumerate(targets)]


def _table(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    columns = dict.fromkeys(
        name for row in rows for name in row
    )  # places have their own: shares of arrivals, or their ends
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
