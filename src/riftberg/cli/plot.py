"""``riftberg plot``: figures of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import OutputBeside
from riftberg.cli.output import results_folder
from riftberg.cli.pictures import Dates, Format, ObservedFile, Run, check_picture_format, folder_beside, moments, seen
from riftberg.cli.terminal import reported
from riftberg.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

KINDS = ("map", "dates", "stress", "timeline", "damage", "story")


@reported
def plot(
    run: Run,
    output: OutputBeside = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            "--kind", "-k",
            help=f"{', '.join(KINDS)}.  [default: dates, stress, timeline, damage where it is on; story of test cases]",
        ),
    ] = None,
    date: Dates = None,
    observed: ObservedFile = None,
    picture: Format = "png",
    dpi: Annotated[int, typer.Option("--dpi", min=30, max=1200, help="Resolution.")] = 150,
) -> None:  # fmt: skip
    """Draw maps at chosen dates with observed outlines, stress and damage of the bonds, and the history of the fragments."""
    from riftberg.runs.run_file import open_run

    for name in kind or ():
        if name not in KINDS:
            raise InputError(f"{name!r} is not known", where="--kind", remedy=f"Use {', '.join(KINDS)}")
    check_picture_format(picture)
    observations = seen(observed)
    with open_run(run) as dataset:
        kinds = kind or usual_kinds(dataset)
        files = [f"{name}.{picture}" for name in dict.fromkeys(kinds)]
        when = moments(date, dataset, observations)
        shown = observations.rings_by_day()
        with results_folder(folder_beside(run, output), files, taken=files) as folder:
            for name in kinds:
                typer.echo(_drawn(name, dataset, folder / f"{name}.{picture}", when, shown, dpi))


def usual_kinds(run: xr.Dataset) -> list[str]:
    """Return the kinds of figures that a run has something for."""
    from riftberg.experiments.registry import story_of

    if story_of(run) is not None:
        return ["story", "stress"]
    bonds = ["stress"] if run.sizes["bond"] else []
    return ["dates", *bonds, "timeline", *(["damage"] if "damage" in run else [])]


def _drawn(
    name: str, run: xr.Dataset, path: Path, when: list[np.datetime64], shown: dict[str, list[Any]], dpi: int
) -> Path:
    """Draw one figure."""
    from riftberg.viz import map as maps
    from riftberg.viz import plots

    if name == "story":
        return _story(run, path, dpi)
    if name == "map":
        return maps.draw_map(run, path, observed=shown, dpi=dpi)
    if name == "timeline":
        return plots.draw_timeline(run, path, dpi=dpi)
    if name == "dates":
        return plots.draw_dates(run, path, dates=when, observed=shown, dpi=dpi)
    draw = plots.draw_stress if name == "stress" else plots.draw_damage
    return draw(run, path, dates=when, dpi=dpi)


def _story(run: xr.Dataset, path: Path, dpi: int) -> Path:
    from riftberg.experiments.registry import story_of

    story = story_of(run)
    if story is None:
        raise InputError(
            "the run is none of the beams or collisions that come with Riftberg",
            where="--kind story",
            remedy="Draw another kind",
        )
    return story.draw(run, path, dpi)
