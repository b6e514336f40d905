"""What the commands that draw have in common: the run, the observations, dates, and where the picture goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.output import check_output
from riftberg.errors import InputError
from riftberg.system.atomic_files import only_writer
from riftberg.system.input_files import is_folder

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from riftberg.diagnostics.observed import Observations

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
    typer.Option(
        "--date",
        "-d",
        help="A date to show, for example 2020-12-17T13:00; may be repeated. A day alone means the time of its observed outline, "
        "else the hour of the start, as in score.",
    ),
]

FORMATS = ("png", "pdf", "svg")

Format = Annotated[
    str, typer.Option("--format", "-f", metavar="FORMAT", help="png, pdf or svg; text in pdf and svg remains editable.")
]


def check_picture_format(name: str) -> None:
    """Refuse a format of pictures that is not offered."""
    if name not in FORMATS:
        raise InputError(f"{name!r} is not known", where="--format", remedy=f"Use {', '.join(FORMATS)}")


def folder_beside(run: Path, wished: Path | None) -> Path:
    """Return the folder where results go: the one asked for, else that of the run."""
    return wished if wished is not None else run if is_folder(run) else run.parent


@contextmanager
def picture_path(run: Path, wished: Path | None, name: str, *, observed: Path | None = None) -> Iterator[Path]:
    """Give where a picture goes: where it was asked for, else beside the run; refused where it cannot be written."""
    path = wished if wished is not None else folder_beside(run, None) / name
    check_output(path, inputs=[run, run / "run.nc", observed])
    path.parent.mkdir(parents=True, exist_ok=True)
    with only_writer(path):
        yield path


def seen(path: Path | None) -> Observations:
    """Return observed outlines, none where no file was named."""
    from riftberg.diagnostics.observed import Observations, read_observed

    if path is None:
        return Observations("")
    observations = read_observed(path)
    if not observations.outlines:
        raise InputError(
            "no outlines, only positions", where=f"--observed {path}", remedy="Use them with riftberg score"
        )
    return observations


def outlines(path: Path | None) -> dict[str, list[Any]]:
    """Return observed outlines by day, empty where no file was named."""
    return seen(path).rings_by_day()


def moments(dates: list[str] | None, run: xr.Dataset, observed: Observations) -> list[np.datetime64]:
    """Return dates from the command line.

    A day alone means the time of its observed outline; where that has none, the hour of the start of the run, as in
    ``riftberg score``.
    """
    import numpy as np

    from riftberg.diagnostics.dates import parse_date

    start = run["time"].values[0]
    hour = start - start.astype("datetime64[D]")
    days = []
    for text in dates or ():
        when, day_only = parse_date(text, where="--date")
        timed = sorted(o.when for o in observed.outlines if not o.day_only and o.when.date() == when.date())
        moment = np.datetime64((timed[0] if day_only and timed else when).isoformat())
        days.append(moment + hour if day_only and not timed else moment)
    return days
