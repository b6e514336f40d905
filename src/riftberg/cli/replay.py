"""``riftberg replay``: a run as one web page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.options import within
from riftberg.cli.pictures import ObservedFile, Run, outlines, picture_path
from riftberg.cli.terminal import reported
from riftberg.errors import InputError


@reported
def replay(
    run: Run,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Page.  [default: replay.html beside the run]")
    ] = None,
    title: Annotated[str, typer.Option("--title", help="Heading.")] = "",
    observed: ObservedFile = None,
    largest: Annotated[float, typer.Option("--largest", min=0.5, help="MB above which records are left out.")] = 10.0,
    show: Annotated[bool, typer.Option("--show", help="Open it in the browser.")] = False,
) -> None:
    """Write a run as one web page that needs no network: play, scrub, zoom."""
    from riftberg.runs.run_file import open_run
    from riftberg.viz.replay import write_replay

    within(largest, "--largest", 0.5, 1000.0)
    if output is not None and output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{output.name[:60]!r} is no name of a web page", where="--output", remedy="Name it PAGE.html")
    shown = outlines(observed)
    with (
        open_run(run) as dataset,
        picture_path(run, output, "replay.html", observed=observed) as goal,
    ):
        path = write_replay(dataset, goal, title=title, observed=shown, largest=largest * 1e6)
    typer.echo(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    if show:
        typer.launch(str(path))
