"""``riftberg sweep``: many runs side by side, one result and its picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import (
    EnsembleOptions,
    EveryPosition,
    ExperimentToRun,
    Members,
    PlanName,
    check_folder,
    output_folder,
    positive,
    results_folder,
    with_ensemble_options,
)
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.config.units import duration_text, quantity_text
from riftberg.errors import InputError, RunError
from riftberg.system.limits import allow_large

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import xarray as xr

    from riftberg.ensembles.sweep import Plan, Store

RESULTS = ("sweep.nc", "sweep.json", "sweep.png")
"""Files that a sweep writes into its folder, beside the folder ``members``."""


@reported
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
    part: Annotated[
        str | None,
        typer.Option("--part", metavar="K/N", help="Run one part of N, as in job arrays; bring them together by --join."),
    ] = None,
    join: Annotated[
        Path | None, typer.Option("--join", metavar="FOLDER", help="Make one result of the parts in a folder.")
    ] = None,
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
    from riftberg.ensembles.sweep import draws_of, join_parts, planned
    from riftberg.ensembles.vary import Draws, read_design

    with allow_large(shared.large):
        positive(every, "--every", "hours", most=1e6)
        announce_compilation(shared.quiet)
        if join is not None:
            if options_given(context, *KEPT, "experiment", "resume", "part", "members"):
                raise InputError("parts are joined as they are", where="--join", remedy="Give --join FOLDER alone")
            missing = join_parts(join)
            store = resumed(join)
            if missing:
                parts = ", ".join(map(str, missing[:10])) + (", ..." if len(missing) > 10 else "")
                say(f"Missing: part{'s' if len(missing) > 1 else ''} {parts}; {len(store.waiting())} members wait")
            store.own = []
            _run(store, replace(shared, workers=0), draw=map_)
            return
        if shared.resume is not None and part is not None:
            raise InputError(
                "a part goes on by itself", where="--resume", remedy="Name the folder of the part, without --part"
            )

        def make(experiment: str) -> Plan:
            draws = draws_of({"members": members, "plan": plan, "seed": shared.seed})
            if design is not None and (vary or draws != Draws()):
                raise InputError(
                    "a design says itself what varies", where="--design",
                    remedy="Leave --vary, --members, --plan and --seed out",
                )  # fmt: skip
            what = (vary or []) if design is None else read_design(design)
            return planned(experiment, what, shared.checked(), every, cells, draws, design=design is not None)

        store = opened(context, "sweep", experiment, make, RESULTS, shared, members, _part(part))
        _run(store, shared, draw=map_)


def opened(
    context: typer.Context, command: str, experiment: str | None, make: Callable[[str], Plan], results: Sequence[str],
    shared: EnsembleOptions, members: int | None, part: tuple[int, int] | None = None,
) -> Store:  # fmt: skip
    """Return an ensemble at its start, checked, or one that goes on in its folder (see `resumed`)."""
    from riftberg.ensembles.sweep import Store

    if shared.resume is not None:
        if changed := options_given(context, *KEPT):
            raise InputError(
                "a sweep that goes on stays what it is, in its folder", where="--resume",
                remedy=f"Leave out {', '.join(changed)}",
            )  # fmt: skip
        return resumed(shared.resume, experiment, members, "forecast" if command == "forecast" else "sweep")
    if experiment is None:
        raise InputError(
            "no experiment is named", where=command, remedy="Name one, or go on with one by --resume FOLDER"
        )
    plan = make(experiment)
    folder = output_folder(shared.output, f"{Path(experiment).stem}-{command}", "sweep.json")
    check_folder(folder, results)
    return Store(folder, plan, resume=False, part=part)


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
    """Return those of the parameters of a command that were given on the command line, as they stand there."""
    sources = {p: context.get_parameter_source(str(p.name)) for p in context.command.params if p.name in names}
    return [(p.secondary_opts or p.opts)[0] for p, source in sources.items() if source and source.name == "COMMANDLINE"]


def resumed(folder: Path, experiment: str | None = None, members: int | None = None, kind: str = "sweep") -> Store:
    """Return the sweep in a folder with what is done; members that are drawn may be more than before."""
    from riftberg.ensembles.sweep import Store, draws_of, planned, read_plan
    from riftberg.experiments.registry import Options

    known = read_plan(folder)
    found = "forecast" if known.get("forecast") else "sweep"
    if found != kind:
        raise InputError(f"holds a {found}", where=f"--resume {folder}", remedy=f"Go on by 'riftberg {found} --resume'")
    if experiment is not None and Path(experiment).stem != Path(known["experiment"]).stem:
        raise InputError(f"a sweep of {known['experiment']}, not of {experiment}", where=f"--resume {folder}")
    if members is not None and known.get("design"):
        raise InputError(
            "its members are the rows of a table", where=f"--resume {folder}, --members", remedy="Leave --members out"
        )
    options = Options(
        changes=known["changes"], days=known["days"], data=None if known["data"] is None else Path(known["data"]),
        without=frozenset(known["without"]), numerics=known["numerics"],
    )  # fmt: skip
    every = known["every"] / 3600.0
    draws = draws_of({"members": members or known.get("members"), "plan": known.get("plan"), "seed": known.get("seed")})
    plan = planned(known["experiment"], known["vary"], options, every, known.get("cells"), draws,
                   forecast=bool(known.get("forecast")), design=bool(known.get("design")))  # fmt: skip
    return Store(folder, plan, resume=True)


def _run(store: Store, shared: EnsembleOptions, *, draw: bool) -> None:
    """Run the members that are not done, and write and print the result."""
    if not shared.quiet:
        say(_size(store))
    with results_folder(store.folder, RESULTS):
        result = run_members(store, "sweep", shared)
    files = ["sweep.nc", "sweep.json", *(["cells/"] if store.plan.cells is not None else [])]
    if draw and (result["status"] == 0).any():
        from riftberg.viz.ensemble import draw_sweep

        draw_sweep(result, store.folder / "sweep.png")
        files.append("sweep.png")
    for line in summary_lines(result):
        typer.echo(line)
    typer.echo(f"Written to {store.folder}: {', '.join(files)}")
    if store.own and not (result["status"] == 0).any():
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


def _size(store: Store) -> str:
    plan = store.plan
    varied = ", ".join(v.told() for v in plan.varied)
    done = f", {len(store.done)} are done" if store.done else ""
    return f"{len(plan.members)} members ({varied}), {duration_text(plan.days)} each{done}"


def summary_lines(result: xr.Dataset) -> list[str]:
    """Return a sweep in a few lines: what came of each member, and what failed."""
    from riftberg.ensembles.probability import fates

    names = [str(name) for name in result.coords if "parameter" in result[name].attrs]
    lines = []
    for k in range(min(result.sizes["member"], 20)):
        member = result.isel(member=k)
        said = ", ".join(f"{member[name].attrs['parameter']} {_value(member[name])}" for name in names)
        if int(member["status"]) == 0:
            pieces, area = (float(member[name]) for name in ("pieces", "largest_area"))
            end = (
                f"in one piece, {area / 1e6:.0f} km2"
                if pieces == 1
                else f"{pieces:.0f} pieces, largest {area / 1e6:.0f} km2"
            )
            date = str(member["first_breakup"].values)[:16]
            lines.append(f"  {said}: {end}" + ("" if date == "NaT" else f", first break-up {date.replace('T', ' ')}"))
        else:
            how = {1: f"failed: {member['message'].item()}", 3: member["message"].item()}
            lines.append(f"  {said}: {how.get(int(member['status']), 'waits')}")
    if result.sizes["member"] > 20:
        lines.append(f"  and {result.sizes['member'] - 20} more, see sweep.nc")
    return [f"{result.attrs['title']}, {fates(result)}", *lines]


def _value(value: xr.DataArray) -> str:
    item = value.item()
    return quantity_text(item, value.attrs.get("units", "1")) if isinstance(item, float) else str(item)
