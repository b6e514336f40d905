"""``riftberg doctor``: what forcing files are, and what a run still lacks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.failures import reported
from riftberg.errors import InputError

EXIT_LACKING = 1


@reported
def doctor(
    files: Annotated[list[str], typer.Argument(metavar="FILES...", help="Files, patterns in quotes, or Zarr stores.")],
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Longitudes of the experiment.")] = None,
    lat: Annotated[
        str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Latitudes of the experiment.")
    ] = None,
    time: Annotated[str | None, typer.Option("--time", metavar="FIRST,LAST", help="Dates of the experiment.")] = None,
    need: Annotated[
        list[str] | None, typer.Option("--need", help="A field that the run needs, for example depth_below_surface.")
    ] = None,
    run: Annotated[
        Path | None, typer.Option("--along", metavar="RUN.nc", help="A run whose path the files must cover.")
    ] = None,
    product: Annotated[str | None, typer.Option("--product", help="The product, instead of recognising it.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Tell what forcing files are, whether they serve an experiment, and what is missing."""
    from riftberg.ocean.doctor import NEEDED
    from riftberg.ocean.doctor import doctor as examine

    report = examine(
        files, lon=pair(lon, "--lon"), lat=pair(lat, "--lat"), time=dates(time), needed=[*NEEDED, *(need or ())],
        path=_path(run), product=product,
    )  # fmt: skip
    typer.echo(json.dumps(report.as_dict(), indent=1, default=str) if as_json else report.text())
    if not report.ready:
        raise typer.Exit(EXIT_LACKING)


def pair(text: str | None, where: str) -> tuple[float, float] | None:
    """Read two numbers with a comma between them."""
    if text is None:
        return None
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{text!r} is not two numbers", where=where, remedy=f"For example {where} -43,-33") from error
    return first, second


def dates(text: str | None, where: str = "--time") -> tuple[str, str] | None:
    """Read two dates with a comma between them."""
    if text is None:
        return None
    from riftberg.diagnostics.dates import parse_date

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise InputError(f"{text!r} is not two dates", where=where, remedy=f"For example {where} 2020-12-09,2020-12-25")
    first, last = (parse_date(part, where=where)[0].isoformat() for part in parts)
    return first, last


def _path(run: Path | None) -> list[tuple[float, float]] | None:
    """Return the daily positions of a run."""
    if run is None:
        return None
    from riftberg.io.run_file import open_run

    with open_run(run) as dataset:
        if "lon" not in dataset:
            raise InputError("this run is in metres", where=f"--along {run}", remedy="Name a run in degrees")
        every = max(1, dataset.sizes["time"] // 50)
        lon = dataset["lon"].mean("trajectory").values[::every]
        lat = dataset["lat"].mean("trajectory").values[::every]
    return list(zip(lon.tolist(), lat.tolist(), strict=True))
