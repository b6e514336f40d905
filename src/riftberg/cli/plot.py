"""``riftberg plot``: figures of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.failures import reported
from riftberg.cli.pictures import Dates, ObservedFile, Run, moments, seen
from riftberg.errors import InputError

KINDS = ("dates", "stress", "timeline", "damage")


@reported
def plot(
    run: Run,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder.  [default: beside the run]")] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option("--kind", "-k", help=f"{', '.join(KINDS)}.  [default: all, damage where it is on]"),
    ] = None,
    date: Dates = None,
    observed: ObservedFile = None,
    dpi: Annotated[int, typer.Option("--dpi", min=30, max=1200, help="Resolution.")] = 150,
) -> None:
    """Draw maps at chosen dates beside observed outlines, the stress and damage in the bonds, and the life of the fragments."""
    from riftberg.runs.run_file import open_run
    from riftberg.viz.plots import draw_damage, draw_dates, draw_stress, draw_timeline

    for name in kind or ():
        if name not in KINDS:
            raise InputError(f"{name!r} is not known", where="--kind", remedy=f"Use {', '.join(KINDS)}")
    observations = seen(observed)
    shown = observations.rings_by_day()
    folder = output or (run if run.is_dir() else run.parent)
    folder.mkdir(parents=True, exist_ok=True)
    with open_run(run) as dataset:
        when = moments(date, dataset, observations)
        kinds = kind or [name for name in KINDS if name != "damage" or "damage" in dataset]
        if "dates" in kinds:
            typer.echo(draw_dates(dataset, folder / "dates.png", dates=when, observed=shown, dpi=dpi))
        if "stress" in kinds:
            typer.echo(draw_stress(dataset, folder / "stress.png", dates=when, dpi=dpi))
        if "timeline" in kinds:
            typer.echo(draw_timeline(dataset, folder / "timeline.png", dpi=dpi))
        if "damage" in kinds:
            typer.echo(draw_damage(dataset, folder / "damage.png", dates=when, dpi=dpi))
