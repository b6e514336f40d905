"""``riftberg rerun``: a run again from the experiment file and the options that its run file keeps, with changes."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.compare import member_of, opened
from riftberg.cli.options import Data, Days, NumericsName, Quiet, Settings, Without, output_folder, results_folder
from riftberg.cli.terminal import reported, say
from riftberg.errors import InputError


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
    every: Annotated[float | None, typer.Option("--every", help="Hours of model time between records.")] = None,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw map.png.")] = True,
    quiet: Quiet = False,
) -> None:
    """Repeat a run from the experiment file that it keeps, with other parameters or another length."""
    from riftberg.cli.main import app
    from riftberg.cli.run import words_without
    from riftberg.runs.layout import COMMAND, FILE, PLACE
    from riftberg.runs.run_file import open_run

    member = member_of(run)
    if member is None:
        with open_run(run) as dataset:
            kept, own = dict(dataset.attrs), list[str]()
    else:
        run, kept, own = member[0], *_kept_of_member(run)
    if COMMAND not in kept:
        raise InputError(
            "keeps no experiment",
            where=str(run),
            remedy="Name what 'riftberg run' or 'riftberg sweep' made, by this version or a later one",
        )
    _, command, experiment, *words = shlex.split(kept[COMMAND])
    name = Path(str(kept["experiment"])).stem
    folder = output_folder(output, name if member is None else f"{name}-member-{member[1]}")
    if folder.resolve() == (run if run.is_dir() else run.parent).resolve():
        raise InputError(
            "the run that is repeated would be lost", where=f"--output {folder}", remedy="Name another folder"
        )
    if data is None and PLACE in kept:
        data = Path(os.path.normpath((run if run.is_dir() else run.parent) / kept[PLACE]))
    more = [part for option, values in (("--set", [*own, *(settings or ())]), ("--without", without)) for value in values or ()
            for part in (option, value)]  # fmt: skip
    single = {"--days": days, "--numerics": numerics, "--every": every, "--output": folder, "--data": data}
    for option, given in single.items():
        if given is not None:
            words, more = words_without(words, option), [*more, option, str(given)]
    more += [word for word, wanted in (("--no-map", not map_), ("--quiet", quiet)) if wanted]
    file = folder / experiment
    there = FILE in kept and file.exists()
    if there and file.read_text("utf-8", errors="replace") != kept[FILE]:
        raise InputError("another experiment has this file", where=str(file), remedy="Name another folder by --output")
    with results_folder(folder):
        if FILE in kept:
            file.write_text(kept[FILE], encoding="utf-8")
            experiment = str(file)
        try:
            say("riftberg " + shlex.join([command, experiment, *words, *more]))
            code = app([command, experiment, *words, *more], standalone_mode=False)
            if code:
                raise typer.Exit(code)
        except BaseException:
            if FILE in kept and not there and not (folder / "run.nc").exists():
                file.unlink(missing_ok=True)
            raise


def _kept_of_member(run: Path) -> tuple[dict[str, str], list[str]]:
    """Return what a sweep keeps of its command, and what is set for one of its members."""
    from riftberg.ensembles.result import values_of
    from riftberg.experiments.changes import setting

    one = opened(run)
    return dict(one.attrs), [setting(name, value) for name, value in values_of(one).items()]
