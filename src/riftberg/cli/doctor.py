"""``riftberg doctor``: what forcing files are, and what a run still lacks."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from riftberg.cli.failures import reported
from riftberg.errors import InputError

EXIT_LACKING = 1


@reported
def doctor(
    files: Annotated[
        list[str] | None, typer.Argument(metavar="FILES...", help="Files, patterns in quotes, or Zarr stores.")
    ] = None,
    experiment: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="EXPERIMENT",
            help="Experiment whose place and dates the files must cover: a name, or a YAML file, whose own files are "
            "examined if no others are named.",
        ),
    ] = None,
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

    asked = _asked(experiment) if experiment else Asked()
    if not files and not asked.files:
        raise InputError("no files were named", where="FILES", remedy="riftberg doctor 'data/*.nc', or --for my.yaml")
    report = examine(
        files or asked.files, lon=pair(lon, "--lon") or asked.lon, lat=pair(lat, "--lat") or asked.lat,
        time=dates(time) or asked.time, needed=[*NEEDED, *(need or ())], path=_path(run), product=product,
    )  # fmt: skip
    typer.echo(json.dumps(report.as_dict(), indent=1, default=str) if as_json else report.text())
    if not report.ready:
        raise typer.Exit(EXIT_LACKING)


class Asked(NamedTuple):
    """What an experiment asks of its files: box (degrees), dates (UTC) and, if it names them, files."""

    lon: tuple[float, float] | None = None
    lat: tuple[float, float] | None = None
    time: tuple[str, str] | None = None
    files: tuple[str, ...] = ()


def _asked(name: str) -> Asked:
    """Return what an experiment asks of its files."""
    if name.endswith((".yaml", ".yml")):
        from riftberg.experiments.schema import FileForcing
        from riftberg.experiments.yaml_file import read_file

        experiment, _, _ = read_file(Path(name))
        given = experiment.forcing
        if not isinstance(given, FileForcing):
            raise InputError(
                f"its forcing is of kind {given.kind!r}", where=f"--for {name}", remedy="It needs no files"
            )
        end = experiment.start + timedelta(days=experiment.days)
        files = tuple(str(Path(name).parent / file) for file in given.files)
        return Asked(given.longitude, given.latitude, (experiment.start.isoformat(), end.isoformat()), files)
    from riftberg.experiments import find
    from riftberg.experiments.a68a_observed import REGION
    from riftberg.model import DEFAULT_START

    if not find(name).name.startswith("a68a"):
        raise InputError(f"{name} is nowhere on Earth", where="--for", remedy="Name a68a, or a YAML file")
    end = DEFAULT_START + timedelta(days=18)
    return Asked(*REGION, (DEFAULT_START.isoformat(), end.isoformat()))


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
