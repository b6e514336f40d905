"""``riftberg doctor``: what forcing files are, and what a run still lacks."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from riftberg.cli.failures import reported
from riftberg.cli.spans import dates, pair
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
    from riftberg.products.doctor import NEEDED
    from riftberg.products.doctor import doctor as examine

    asked = _asked(experiment) if experiment else Asked()
    if not files and not asked.files:
        remedy = asked.remedy or "riftberg doctor 'data/*.nc', or --for my.yaml"
        raise InputError("no files were named", where="FILES", remedy=remedy)
    report = examine(
        files or asked.files, lon=pair(lon, "--lon") or asked.lon, lat=pair(lat, "--lat") or asked.lat,
        time=dates(time) or asked.time, needed=[name for name in (*NEEDED, *(need or ())) if name not in asked.spared],
        path=_path_of_run(run) or list(asked.path), product=product or asked.products,
        max_gap=asked.max_gap, hold=asked.hold,
    )  # fmt: skip
    typer.echo(json.dumps(report.as_dict(), indent=1, default=str) if as_json else report.text())
    if not report.ready:
        raise typer.Exit(EXIT_LACKING)


class Asked(NamedTuple):
    """What an experiment asks of its files: box (degrees), dates (UTC) and, if it names them, files and their products.

    ``path`` holds positions of the berg, ``spared`` fields that are not needed, ``max_gap`` and ``hold`` seconds, and
    ``remedy`` what to do without files.
    """

    lon: tuple[float, float] | None = None
    lat: tuple[float, float] | None = None
    time: tuple[str, str] | None = None
    files: tuple[str, ...] = ()
    products: dict[str, str | None] | None = None
    path: tuple[tuple[float, float], ...] = ()
    spared: frozenset[str] = frozenset()
    max_gap: float | None = None
    hold: float | None = None
    remedy: str = ""


def _asked(name: str) -> Asked:
    """Return what an experiment asks of its files."""
    if name.endswith((".yaml", ".yml")):
        from riftberg.experiments.yaml_file import read_file
        from riftberg.ocean.files_schema import FileForcing

        experiment, _, _ = read_file(Path(name))
        forcing = experiment.forcing
        if not isinstance(forcing, FileForcing):
            raise InputError(
                f"its forcing is of kind {forcing.kind!r}", where=f"--for {name}", remedy="It needs no files"
            )
        end = experiment.start + timedelta(days=experiment.days)
        products = {str(Path(name).parent / entry.file): entry.product for entry in forcing.entries}
        left_out = {"ssh"} if forcing.sea_level == "none" else set()
        left_out |= {"ua", "va"} if forcing.wind == "none" else set()
        max_gap, hold = (None if hours is None else 3600.0 * hours for hours in (forcing.max_gap, forcing.hold))
        return Asked(
            forcing.longitude, forcing.latitude, (experiment.start.isoformat(), end.isoformat()), tuple(products), products,
            spared=frozenset(left_out), max_gap=max_gap, hold=hold,
        )  # fmt: skip
    return _asked_a68a(name)


def _asked_a68a(name: str) -> Asked:
    """Return what a run of A68a asks of its files: of those with files of their own, the fetched ones."""
    from riftberg.experiments import Options, find
    from riftberg.experiments.a68a_files import named_folder
    from riftberg.experiments.a68a_observed import A68A_OBSERVED, PARTIAL, REGION
    from riftberg.model import DEFAULT_START

    entry = find(name).name
    if not entry.startswith("a68a"):
        raise InputError(f"{name} is nowhere on Earth", where="--for", remedy="Name a68a, or a YAML file")
    end = DEFAULT_START + timedelta(days=18)
    path = tuple((seen.lon, seen.lat) for seen in A68A_OBSERVED if seen.day not in PARTIAL)
    asked = Asked(*REGION, (DEFAULT_START.isoformat(), end.isoformat()), path=path)
    if entry == "a68a":
        return asked._replace(remedy="a68a has an ocean of its own and needs none: name those that you want to look at")
    folder = named_folder(Options())
    if any(folder.glob("*.nc")):
        return asked._replace(files=(str(folder / "*.nc"),))
    return asked._replace(remedy=f"None are in {folder}: 'riftberg fetch a68a' gets them, or name others")


def _path_of_run(run: Path | None) -> list[tuple[float, float]] | None:
    """Return the daily positions of a run."""
    if run is None:
        return None
    from riftberg.runs.run_file import open_run

    with open_run(run) as dataset:
        if "lon" not in dataset:
            raise InputError("this run is in metres", where=f"--along {run}", remedy="Name a run in degrees")
        every = max(1, dataset.sizes["time"] // 50)
        lon = dataset["lon"].mean("trajectory").values[::every]
        lat = dataset["lat"].mean("trajectory").values[::every]
    return list(zip(lon.tolist(), lat.tolist(), strict=True))
