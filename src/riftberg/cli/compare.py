"""``riftberg compare``: runs side by side, beside what was published and observed."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import check_folder, results_folder
from riftberg.cli.terminal import reported, say
from riftberg.errors import InputError
from riftberg.system.input_files import check_file, is_folder, reading

if TYPE_CHECKING:
    from riftberg.diagnostics.compare import Comparison, Known


@reported
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN ...", help="Folders that 'riftberg run' made.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for comparison.json and comparison.png.")
    ] = None,
    observed: Annotated[
        Path | None,
        typer.Option("--observed", help="Observed positions (CSV).  [default: those of A68a, for its runs]"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare runs: break-ups, bonds, and the daily distance from the observed positions."""
    import json

    if output is not None:
        check_folder(output, ("comparison.json", "comparison.png"))
    result = comparison(runs, names_of(runs), observed)
    if as_json:
        typer.echo(json.dumps(result.as_dict(), indent=1))
    else:
        show(result)
    if output is not None:
        names = ("comparison.json", "comparison.png")
        with results_folder(output, names, taken=names):
            written = [result.write(output / "comparison.json"), *joined_maps(runs, output / "comparison.png")]
        say("Written: " + ", ".join(str(path) for path in written))


def names_of(runs: Sequence[Path]) -> list[str]:
    """Return short names that differ: of the folders, or the paths where these are the same."""
    short = [folder_of(run).name for run in runs]
    return short if all(short) and len(set(short)) == len(short) else [str(run) for run in runs]


def folder_of(run: Path) -> Path:
    """Return the folder of a run, which may be named by its run file."""
    if not is_folder(run) and run.suffix == ".nc" and run.name != "run.nc":
        raise InputError(
            "not the run.nc of a run", where=str(run), remedy="Name folders that 'riftberg run' made, with summary.json"
        )
    return run if is_folder(run) or run.suffix != ".nc" else run.parent


def comparison(runs: Sequence[Path], names: Sequence[str], observed: Path | None = None) -> Comparison:
    """Read runs and put them side by side."""
    from riftberg.diagnostics.compare import compare, read_compared

    folders = [folder_of(run) for run in runs]
    for folder in folders:
        check_file(folder / "run.nc", missing="no run.nc", remedy="Name folders that 'riftberg run' made")
    known = _known(folders[0], observed)
    return compare([read_compared(f, n, known.fixes) for f, n in zip(folders, names, strict=True)], known)


def _known(folder: Path, observed: Path | None) -> Known:
    """Return what is known of the event that the first run is about."""
    from riftberg.diagnostics.compare import Known, with_hours
    from riftberg.diagnostics.observed import Fix, read_observed
    from riftberg.experiments.a68a_observed import A68A_OBSERVED, PARTIAL, PUBLISHED, SEEN
    from riftberg.runs.run_file import open_run

    with open_run(folder) as dataset:
        experiment = str(dataset.attrs.get("experiment", ""))
        start = datetime.fromisoformat(str(dataset.attrs["start"]))
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
    """Print the table."""
    from rich.console import Console
    from rich.table import Table

    table = Table(show_lines=False)
    for k, name in enumerate(result.columns):
        table.add_column(name, overflow="fold", no_wrap=k == 0)
    for label, cells in result.rows:
        table.add_row(label, *cells)
    console = Console()
    # A file or a pipe has no width of its own.
    if not console.is_terminal:
        console = Console(width=40 + 34 * (len(result.columns) - 1))
    console.print(table, highlight=False)


def joined_maps(runs: Sequence[Path], path: Path) -> list[Path]:
    """Put the maps of runs below each other; nothing where a run has none.

    Returns
    -------
    list of Path
        The picture, if there is one.
    """
    import numpy as np
    from matplotlib.image import imread, imsave

    maps = [folder_of(run) / "map.png" for run in runs]
    if not all(one.is_file() for one in maps):
        return []
    pictures = []
    for one in maps:
        with reading(one, "no picture that can be read", "Make the run again, or remove the file"):
            pictures.append(imread(one)[..., :3])
    width = min(picture.shape[1] for picture in pictures)
    imsave(path, np.concatenate([picture[:, :width] for picture in pictures]))
    return [path]
