"""``riftberg compare``: runs side by side, beside what was published and observed."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from riftberg.cli.options import check_folder, results_folder
from riftberg.cli.terminal import console, reported, say
from riftberg.errors import InputError
from riftberg.system.input_files import check_file, is_folder, reading

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.diagnostics.compare import Comparison, Known


PICTURES: Final = ("comparison.json", "comparison.png", "tracks.png")
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
        Path | None, typer.Option("--output", "-o", help="Folder for comparison.json, comparison.png and tracks.png.")
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
            written = [result.write(output / PICTURES[0]), *joined_maps(runs, output / PICTURES[1])]
            written.append(draw_compared(result.runs, result.fixes, output / PICTURES[2]))
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
    from riftberg.experiments.a68a_observed import A68A_OBSERVED, PARTIAL, PUBLISHED, SEEN

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


def joined_maps(runs: Sequence[Path], path: Path) -> list[Path]:
    """Put the maps of runs below each other; nothing where a run has none.

    Returns
    -------
    list of Path
        The picture, if there is one.
    """
    import numpy as np
    from matplotlib.image import imread, imsave

    maps = [folder_of(run) / "map.png" for run in runs if not member_of(run)]
    if not maps or not all(one.is_file() for one in maps):
        return []
    pictures = []
    for one in maps:
        with reading(one, "no picture that can be read", "Make the run again, or remove the file"):
            pictures.append(imread(one)[..., :3])
    width = min(picture.shape[1] for picture in pictures)
    imsave(path, np.concatenate([picture[:, :width] for picture in pictures]))
    return [path]
