"""``riftberg kid``: run a folder of KID or iKID as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.compilation import announce_compilation
from riftberg.cli.failures import reported


@reported
def kid(
    case: Annotated[Path, typer.Argument(help="Folder with input.nml and the restart files that it names.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Trajectory file or folder.  [default: riftberg-out/NAME]")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> None:
    """Run a case of KID or iKID from its namelist, and write its trajectory, restart and bond files."""
    from riftberg.cli.progress import ProgressRecorder
    from riftberg.kid.run import load_case, run_kid

    announce_compilation(quiet)
    clock = load_case(case).clock
    if output is None:
        output = Path("riftberg-out") / case.resolve().name
        output.mkdir(parents=True, exist_ok=True)
    progress = ProgressRecorder(clock.steps * clock.dt / 86400.0, quiet=quiet)
    typer.echo(run_kid(case, output, progress=progress).describe())
