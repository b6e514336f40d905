"""``riftberg kid``: run a folder of KID or iKID as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.options import check_folder, check_output, results_folder
from riftberg.cli.terminal import announce_compilation, reported, say
from riftberg.errors import InputError
from riftberg.system.input_files import is_folder
from riftberg.system.limits import allow_extreme, allow_large


@reported
def kid(
    case: Annotated[Path, typer.Argument(help="Folder with input.nml and the restart files named in it.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Trajectory file or folder.  [default: riftberg-out/NAME]")
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Show neither progress nor the list of namelist entries.")
    ] = False,
    large: Annotated[
        bool, typer.Option("--allow-large", help="Allow very large numbers of elements and steps.")
    ] = False,
    extreme: Annotated[
        bool,
        typer.Option(
            "--allow-extreme", help="Accept unphysical currents, wind and sea level, and ice speeds up to 1000 m/s."
        ),
    ] = False,
    ranks: Annotated[
        str,
        typer.Option(
            "--ranks",
            help="Processors of the KID run to reproduce, such as 2x2: footloose random numbers depend on them.",
        ),
    ] = "1x1",
) -> None:
    """Run a KID or iKID case from its namelist; write trajectory, restart and bond files."""
    from riftberg.kid.run import load_case, run_kid
    from riftberg.runs.progress import ProgressRecorder

    parts = ranks.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() and 1 <= int(part) <= 1000 for part in parts):
        raise InputError(f"{ranks!r} is no layout of processes", where="--ranks", remedy="For example 2x2")
    layout = int(parts[0]), int(parts[1])
    with allow_large(large), allow_extreme(extreme):
        folder = output.parent if output is not None and not is_folder(output) else output
        if folder is not None:
            check_folder(folder)
        announce_compilation(quiet)
        loaded = load_case(case, layout)
        folder = folder or Path("riftberg-out") / case.resolve().name
        output = output or folder
        if not is_folder(output):
            check_output(output, inputs=[case / "input.nml", *case.glob("*/*.nc")])
        with results_folder(folder):
            for note in loaded.notes:
                say(f"Notice: {note}")
            clock = loaded.clock
            progress = ProgressRecorder(clock.steps * clock.dt / 86400.0, quiet=quiet)
            typer.echo(run_kid(loaded, output, progress=progress).describe(entries=not quiet))
