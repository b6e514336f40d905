"""``riftberg kid``: run a folder of KID or iKID as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.compilation import announce_compilation
from riftberg.cli.failures import reported
from riftberg.cli.output import check_folder, check_output, results_folder
from riftberg.input_files import is_folder
from riftberg.limits import allow_large


@reported
def kid(
    case: Annotated[Path, typer.Argument(help="Folder with input.nml and the restart files that it names.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Trajectory file or folder.  [default: riftberg-out/NAME]")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
    large: Annotated[
        bool, typer.Option("--allow-large", help="Allow more elements and steps than a slip asks for.")
    ] = False,
) -> None:
    """Run a case of KID or iKID from its namelist, and write its trajectory, restart and bond files."""
    from riftberg.kid.run import load_case, run_kid
    from riftberg.runs.progress import ProgressRecorder

    with allow_large(large):
        folder = output.parent if output is not None and not is_folder(output) else output
        if folder is not None:
            check_folder(folder)
        announce_compilation(quiet)
        clock = load_case(case).clock
        folder = folder or Path("riftberg-out") / case.resolve().name
        output = output or folder
        if not is_folder(output):
            check_output(output, inputs=[case / "input.nml", *case.glob("*/*.nc")])
        with results_folder(folder):
            progress = ProgressRecorder(clock.steps * clock.dt / 86400.0, quiet=quiet)
            typer.echo(run_kid(case, output, progress=progress).describe())
