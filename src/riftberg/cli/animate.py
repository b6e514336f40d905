"""``riftberg animate``: a film of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.failures import reported
from riftberg.cli.pictures import ObservedFile, Run, beside, outlines


@reported
def animate(
    run: Run,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="MP4 or GIF.  [default: film.mp4 beside the run, film.gif without ffmpeg]"),
    ] = None,
    hours: Annotated[
        float | None, typer.Option("--hours", help="Hours between frames.  [default: a film of 20 s]")
    ] = None,
    fps: Annotated[
        int | None, typer.Option("--fps", min=1, max=60, help="Frames a second.  [default: 20, GIF 10]")
    ] = None,
    dpi: Annotated[
        int | None, typer.Option("--dpi", min=30, max=400, help="Resolution.  [default: 110, GIF 80]")
    ] = None,
    observed: ObservedFile = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> None:
    """Write a film of a run."""
    from rich.console import Console
    from rich.progress import Progress

    from riftberg.runs.run_file import open_run
    from riftberg.viz.animate import default_ending, write_film

    shown = outlines(observed)
    with open_run(run) as dataset, Progress(console=Console(stderr=True), disable=quiet) as bar:
        task = bar.add_task("frames", total=None)
        path = write_film(
            dataset, beside(run, output, "film" + default_ending()), hours=hours, fps=fps, dpi=dpi, observed=shown,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip
    typer.echo(path)
