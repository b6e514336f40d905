"""What the commands that draw have in common: the run, the observations, dates, and where the picture goes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.errors import InputError

if TYPE_CHECKING:
    import numpy as np

Run = Annotated[Path, typer.Argument(metavar="RUN.nc", help="Run file, or the folder that 'riftberg run' made.")]
ObservedFile = Annotated[
    Path | None,
    typer.Option(
        "--observed",
        help="Observed outlines: GeoJSON, KML, shapefile, mask in NetCDF, or CSV with date, vertex, lat, lon.",
    ),
]
Dates = Annotated[
    list[str] | None,
    typer.Option("--date", "-d", help="A date to show, for example 2020-12-17T13:00; may be repeated."),
]


def beside(run: Path, given: Path | None, name: str) -> Path:
    """Return where a picture goes: where it was asked for, else beside the run."""
    folder = run if run.is_dir() else run.parent
    return given if given is not None else folder / name


def outlines(path: Path | None) -> dict[str, list[Any]]:
    """Return observed outlines by day, empty where no file was named."""
    if path is None:
        return {}
    from riftberg.diagnostics.observed import read_observed

    found = read_observed(path)
    if not found.outlines:
        raise InputError(
            "no outlines, only positions", where=f"--observed {path}", remedy="Use them with riftberg score"
        )
    return found.rings_by_day()


def moments(dates: list[str] | None) -> list[np.datetime64]:
    """Return dates from the command line; a day alone means its noon."""
    import numpy as np

    from riftberg.diagnostics.dates import parse_date

    found = []
    for text in dates or ():
        when, day_only = parse_date(text, where="--date")
        found.append(np.datetime64(when.isoformat()) + np.timedelta64(12 if day_only else 0, "h"))
    return found
