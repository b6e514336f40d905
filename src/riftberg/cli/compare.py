"""``riftberg compare`` and ``rerun``: runs side by side, beside what was observed, and a run again with a change."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from riftberg.cli.options import (
    Data,
    Days,
    Every,
    Map,
    NumericsName,
    Quiet,
    Settings,
    Without,
    check_folder,
    output_folder,
    results_folder,
    words_without,
)
from riftberg.cli.terminal import console, reported, say
from riftberg.errors import InputError
from riftberg.system.input_files import check_file, is_folder

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.diagnostics.compare import Comparison, Known


PICTURES: Final = ("comparison.json", "tracks.png")
"""Files that a comparison may write into its folder."""


@reported
def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN RUN ...", help="Folders that 'riftberg run' made; sweep.nc#3 is member 3 of a sweep."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for comparison.json and tracks.png.")
    ] = None,
    observed: Annotated[
        Path | None,
        typer.Option("--observed", help="Observed positions (CSV).  [default: those of A68a, for its runs]"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare runs: how far apart they are by time, break-ups, bonds, and the distance from observed positions."""
    import json

    if output is not None:
        check_folder(output, PICTURES)
    result = comparison(runs, names_of(runs), observed)
    if as_json:
        typer.echo(json.dumps(result.as_dict(), indent=1))
    else:
        show(result)
    if output is not None:
        from riftberg.viz.score import draw_compared

        with results_folder(output, PICTURES, taken=PICTURES):
            written = [
                result.write(output / PICTURES[0]), draw_compared(result.runs, result.fixes, output / PICTURES[1])
            ]  # fmt: skip
        say("Written: " + ", ".join(str(path) for path in written))


def names_of(runs: Sequence[Path]) -> list[str]:
    """Return short names that differ: of the folders, or the paths where these are the same."""
    short = [run.name if member_of(run) else folder_of(run).name for run in runs]
    return short if all(short) and len(set(short)) == len(short) else [str(run) for run in runs]


def member_of(run: Path) -> tuple[Path, int] | None:
    """Return the sweep and the number of a member, such as of ``sweep.nc#3``; None for a run."""
    path, mark, number = str(run).rpartition("#")
    if not mark or run.exists() or not Path(path).exists():
        return None
    if not number.isdecimal():
        raise InputError(
            f"no member {number}", where=str(run), remedy="They are counted from 0: sweep.nc#3 is the fourth"
        )
    return Path(path), int(number)


def folder_of(run: Path) -> Path:
    """Return the folder of a run, which may be named by its run file."""
    if not is_folder(run) and run.suffix == ".nc" and run.name != "run.nc":
        raise InputError(
            "not the run.nc of a run", where=str(run), remedy="Name folders that 'riftberg run' made, with summary.json"
        )
    return run if is_folder(run) or run.suffix != ".nc" else run.parent


def comparison(runs: Sequence[Path], names: Sequence[str], observed: Path | None = None) -> Comparison:
    """Read runs and members of sweeps, and put them side by side."""
    from riftberg.diagnostics.compare import compare, member_compared, read_compared

    for run in runs:
        if not member_of(run):
            check_file(folder_of(run) / "run.nc", missing="no run.nc", remedy="Name folders that 'riftberg run' made")
    known = _known(opened(runs[0]), observed)
    found = [
        member_compared(opened(run), name, known.fixes)
        if member_of(run)
        else read_compared(folder_of(run), name, known.fixes)
        for run, name in zip(runs, names, strict=True)
    ]
    begin, end = (pick(pick(run.course.times) for run in found) for pick in (min, max))
    meant = known.within(begin, end)
    if observed is not None and not meant.fixes:
        raise InputError(
            "no position during the runs", where=f"--observed {observed}",
            remedy=f"They go from {str(begin)[:16].replace('T', ' ')} to {str(end)[:16].replace('T', ' ')}",
        )  # fmt: skip
    return compare(found, meant)


def opened(run: Path) -> xr.Dataset:
    """Return a run, or a member of a sweep."""
    import numpy as np

    from riftberg.ensembles.result import open_sweep
    from riftberg.runs.run_file import open_run

    member = member_of(run)
    if member is None:
        return open_run(folder_of(run))
    sweep = open_sweep(member[0])
    if member[1] not in sweep["member"].values:
        count = sweep.sizes["member"]
        raise InputError(f"no member {member[1]}", where=str(run), remedy=f"It has {count}, counted from 0")
    one = sweep.sel(member=member[1])
    if "start" in sweep.coords and "comment" in sweep["time"].attrs:  # times are those of member 0
        one["time"] = one["time"] + (
            np.datetime64(str(one["start"].item())) - np.datetime64(str(sweep["start"].values[0]))
        )
    return one


def _known(first: xr.Dataset, observed: Path | None) -> Known:
    """Return what is known of the event that the first run is about."""
    from riftberg.diagnostics.compare import Known, with_hours
    from riftberg.diagnostics.observed import Fix, read_observed
    from riftberg.experiments.a68a import A68A_OBSERVED, PARTIAL, PUBLISHED, SEEN

    experiment = str(first.attrs.get("experiment", ""))
    start = first["time"].values[0].astype("datetime64[s]").item()
    fixes: list[Fix] = []
    if observed is not None:
        fixes = with_hours(read_observed(observed).fixes, start.hour + start.minute / 60.0)
        if not fixes:
            raise InputError("no positions", where=f"--observed {observed}", remedy="Outlines: see riftberg score")
    elif experiment.startswith("a68a"):
        fixes = [
            Fix("A68A", datetime(2020, 12, o.day, 13), False, o.lon, o.lat, o.azimuth, o.area * 1e6)
            for o in A68A_OBSERVED
            if o.day not in PARTIAL
        ]
    if not experiment.startswith("a68a"):
        return Known(fixes=fixes)
    return Known(dict(PUBLISHED), dict(SEEN), fixes)


def show(result: Comparison) -> None:
    """Print the tables: what the runs came to, and how far apart they are."""
    from rich.table import Table

    first, *others = (run.name for run in result.runs)
    tables = [(result.columns, result.rows)]
    if others:
        tables.append((["apart", first, *(f"{name} from {first}" for name in others)], result.apart_rows()))
    for columns, rows in tables:
        table = Table()
        for k, name in enumerate(columns):
            table.add_column(name, overflow="fold", no_wrap=k == 0)
        for label, cells in rows:
            table.add_row(label, *cells)
        console(40 + 34 * (len(columns) - 1)).print(table, highlight=False)


@reported
def rerun(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN", help="Folder that 'riftberg run' made, or its run.nc; sweep.nc#3 is member 3 of a sweep."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-2]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: NumericsName = None,
    every: Every = None,
    map_: Map = True,
    quiet: Quiet = False,
) -> None:
    """Repeat a run from the experiment file that it keeps, with other parameters or another length."""
    from riftberg.runs.run_file import open_run

    member = member_of(run)
    if member is None:
        with open_run(run) as dataset:
            kept, own = dict(dataset.attrs), list[str]()
    else:
        run, kept, own = member[0], *_kept_of_member(run)
    name = Path(str(kept["experiment"])).stem
    folder = output_folder(output, name if member is None else f"{name}-member-{member[1]}")
    more = [part for option, values in (("--set", [*own, *(settings or ())]), ("--without", without)) for value in values or ()
            for part in (option, value)]  # fmt: skip
    more += [word for word, wanted in (("--no-map", not map_), ("--quiet", quiet)) if wanted]
    single = {"--days": days, "--numerics": numerics, "--every": every}
    run_again(run, kept, folder, more, {option: str(v) for option, v in single.items() if v is not None}, data)


def run_again(
    run: Path, kept: Mapping[str, str], folder: Path, more: Sequence[str], single: Mapping[str, str],
    data: Path | None = None,
) -> None:  # fmt: skip
    """Run what a run, or a sweep, keeps of its experiment into a folder.

    ``kept``: attributes of its file; ``more``: options beside those of its command; ``single``: those that stand once, by
    name; ``data``: folder of data files, by default where they were.
    """
    from riftberg.cli.main import app
    from riftberg.runs.layout import COMMAND, FILE, PLACE

    if COMMAND not in kept:
        raise InputError(
            "keeps no experiment",
            where=str(run),
            remedy="Name what 'riftberg run' or 'riftberg sweep' made, by this version or a later one",
        )
    _, command, experiment, *words = shlex.split(kept[COMMAND])
    home = run if run.is_dir() else run.parent
    if folder.resolve() == home.resolve():
        raise InputError(
            "the run that is repeated would be lost", where=f"--output {folder}", remedy="Name another folder"
        )
    if data is None and PLACE in kept:
        data = Path(os.path.normpath(home / kept[PLACE]))
    single = {**single, "--output": str(folder), **({} if data is None else {"--data": str(data)})}
    words = [*words_without(words, *single), *more, *(part for pair in single.items() for part in pair)]
    file = folder / experiment
    there = FILE in kept and file.exists()
    if there and file.read_text("utf-8", errors="replace") != kept[FILE]:
        raise InputError("another experiment has this file", where=str(file), remedy="Name another folder by --output")
    with results_folder(folder):
        if FILE in kept:
            file.write_text(kept[FILE], encoding="utf-8")
            experiment = str(file)
        try:
            say("riftberg " + shlex.join([command, experiment, *words]))
            code = app([command, experiment, *words], standalone_mode=False)
            if code:
                raise typer.Exit(code)
        except BaseException:
            # A run that was stopped on its way goes on from the file.
            if FILE in kept and not there and not (folder / "run.nc").exists():
                file.unlink(missing_ok=True)
            raise
        if FILE in kept and not there:  # it lacks what was changed, and the run file keeps both
            file.unlink(missing_ok=True)


def _kept_of_member(run: Path) -> tuple[dict[str, str], list[str]]:
    """Return what a sweep keeps of its command, and what is set for one of its members."""
    from riftberg.ensembles.result import values_of
    from riftberg.experiments.changes import setting

    one = opened(run)
    return dict(one.attrs), [setting(name, value) for name, value in values_of(one).items()]
