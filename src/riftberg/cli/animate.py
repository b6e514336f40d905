"""``riftberg animate``: a film of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from riftberg.cli.options import Quiet, positive
from riftberg.cli.pictures import ObservedFile, Run, outlines, picture_path
from riftberg.cli.terminal import reported
from riftberg.errors import InputError
from riftberg.system.limits import refuse_large


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
        int | None, typer.Option("--fps", min=1, max=60, help="Frames per second.  [default: 20, GIF 10]")
    ] = None,
    dpi: Annotated[
        int | None, typer.Option("--dpi", min=30, max=400, help="Resolution.  [default: 110, GIF 80]")
    ] = None,
    observed: ObservedFile = None,
    quiet: Quiet = False,
) -> None:
    """Write a film of a run."""
    from riftberg.runs.run_file import open_run
    from riftberg.viz.animate import default_ending

    positive(hours, "--hours", "hours", most=1e6)
    shown = outlines(observed)
    with (
        open_run(run) as dataset,
        picture_path(run, output, "film" + default_ending(), observed=observed) as goal,
    ):
        check_frames(dataset["time"].values, hours)
        path = _filmed(dataset, goal, hours, fps, dpi, shown, quiet)
    typer.echo(path)


MOST_FRAMES = 20_000
"""Frames of a film: a quarter of an hour at 20 a second."""


def check_frames(times: Any, hours: float | None) -> None:
    """Refuse a film of more frames than anybody will look at."""
    if hours is not None:
        length = float((times[-1] - times[0]).astype("timedelta64[s]").astype(float)) / 3600.0
        refuse_large(
            length / hours, MOST_FRAMES, "frames", where="--hours", remedy="Give more hours between frames",
            kind=InputError,
        )  # fmt: skip


def _filmed(
    dataset: Any, goal: Path, hours: float | None, fps: int | None, dpi: int | None, shown: Any, quiet: bool
) -> Path:
    from rich.console import Console
    from rich.progress import Progress

    from riftberg.viz.animate import write_film

    with Progress(console=Console(stderr=True), disable=quiet) as bar:
        task = bar.add_task("frames", total=None)
        return write_film(
            dataset, goal, hours=hours, fps=fps, dpi=dpi, observed=shown,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip
