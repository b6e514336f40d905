"""``riftberg doctor``: what forcing files are, and what a run lacks; ``riftberg fetch`` gets them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from riftberg.cli.options import Names, Quiet, as_named, dates, entries_of, pair, positive, results_folder
from riftberg.cli.terminal import reported
from riftberg.errors import InputError, RiftbergError
from riftberg.system.input_files import in_folder

if TYPE_CHECKING:
    from riftberg.products.registry import Choice

EXIT_LACKING = 1


@reported
def doctor(
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="FILES...", help="Files, patterns in quotes, Zarr stores, or addresses."),
    ] = None,
    experiment: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="EXPERIMENT",
            help="Experiment whose region and dates the files must cover: a name, or a YAML file, whose own files are "
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
        Path | None, typer.Option("--along", metavar="RUN.nc", help="A run whose track the files must cover.")
    ] = None,
    product: Annotated[
        str | None, typer.Option("--product", help="Name of the product, instead of recognising it.")
    ] = None,
    names: Names = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Identify forcing files, check that they are sufficient for an experiment, list what is missing."""
    from riftberg.ocean.doctor import ASSUMED, NEEDED, Report
    from riftberg.ocean.doctor import doctor as examine

    asked = _asked(experiment, bool(files)) if experiment else Asked()
    if not files and not asked.files and not asked.spared >= {*NEEDED}:
        remedy = asked.remedy or "riftberg doctor 'data/*.nc', or --for my.yaml"
        raise InputError("no files were named", where="FILES", remedy=remedy)
    box, days = (pair(lon, "--lon") or asked.lon, pair(lat, "--lat") or asked.lat), dates(time) or asked.time
    named, choices = as_named(files or (), product, names)
    report = examine(
        named or asked.files, lon=box[0], lat=box[1], time=days,
        needed=[*(name for name in NEEDED if name not in asked.spared), *(need or ())],
        wished=[name for name in ASSUMED if name not in asked.spared],
        path=_path_of_run(run) or list(asked.path), product=choices if names else product or asked.products,
        max_gap=asked.max_gap, hold=asked.hold,
    ) if files or asked.files else Report()  # fmt: skip
    # Another path, box or span than that of the experiment needs more than a run does.
    if experiment and not (run or lon or lat or time) and (not files or experiment.endswith(_YAML)):
        report.refusal, report.assumed = _tried(experiment, named, choices)
    elif not experiment and not run and box[0] and box[1] and days:
        report.refusal = _served(named, (box[0], box[1]), days, choices) or None
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
    products: dict[str, Choice] | None = None
    path: tuple[tuple[float, float], ...] = ()
    spared: frozenset[str] = frozenset()
    max_gap: float | None = None
    hold: float | None = None
    remedy: str = ""


_YAML = (".yaml", ".yml")


def _tried(experiment: str, files: Sequence[str], choices: Mapping[str, Choice]) -> tuple[str, list[str]]:
    """Return why a run of an experiment does not start, and what would be assumed, as ``riftberg run`` has it."""
    from riftberg.cli.run import check_start, notices_of
    from riftberg.experiments import Options, build

    options = Options(files=entries_of(files, choices))
    try:
        model, info = build(experiment, options)
        check_start(model, info.days, info.output_every_hours)
    except RiftbergError as error:
        return str(error), []
    return "", notices_of(info, model, options, info.output_every_hours)


def _served(
    files: Sequence[str],
    box: tuple[tuple[float, float], tuple[float, float]],
    days: tuple[str, str],
    choices: Mapping[str, Choice],
) -> str:
    """Return why files do not suffice for a berg of usual draft in a box, wherever in it; empty if they do."""
    from riftberg.ocean.files_forcing import Run, forcing_from_files
    from riftberg.ocean.files_schema import FileForcing
    from riftberg.parameters import Ice

    entries = list(entries_of(files, choices))
    settings = FileForcing(kind="files", files=["any"], longitude=box[0], latitude=box[1])
    first, last = (datetime.fromisoformat(day) for day in days)
    asked = Run(first, last, np.array([200.0]), Ice().density)
    try:
        forcing_from_files(settings.model_copy(update={"files": entries}), Path(), asked)
    except RiftbergError as error:
        return str(error)
    return ""


def _asked(name: str, named: bool) -> Asked:
    """Return what an experiment asks of its files; ``named`` if others are named."""
    if name.endswith(_YAML):
        from riftberg.experiments.yaml_file import read_file
        from riftberg.ocean.files_schema import FileForcing

        experiment, _, _ = read_file(Path(name))
        forcing = experiment.forcing
        if not isinstance(forcing, FileForcing) and not named:
            return Asked(spared=_ALL)
        if not isinstance(forcing, FileForcing):
            raise InputError(
                f"its forcing is of kind {forcing.kind!r}", where=f"--for {name}", remedy="It needs no files"
            )
        end = experiment.start + timedelta(days=experiment.days)
        products = {in_folder(Path(name).parent, entry.file): entry.choice for entry in forcing.entries}
        left_out = set() if forcing.sea_level == "files" else {"ssh"}
        left_out |= {"ua", "va"} if forcing.wind == "none" else set()
        max_gap, hold = (None if hours is None else 3600.0 * hours for hours in (forcing.max_gap, forcing.hold))
        return Asked(
            forcing.longitude, forcing.latitude, (experiment.start.isoformat(), end.isoformat()), tuple(products), products,
            spared=frozenset(left_out), max_gap=max_gap, hold=hold,
        )  # fmt: skip
    from riftberg.experiments import Options, find
    from riftberg.experiments.a68a import A68A_OBSERVED, PARTIAL, REGION
    from riftberg.experiments.a68a_files import named_folder
    from riftberg.model import DEFAULT_START

    entry = find(name).name
    if not named and not find(name).fetches:
        return Asked(spared=_ALL)
    if not entry.startswith("a68a"):
        raise InputError(f"{name} is nowhere on Earth", where="--for", remedy="Name a68a, or a YAML file")
    end = DEFAULT_START + timedelta(days=18)
    path = tuple((seen.lon, seen.lat) for seen in A68A_OBSERVED if seen.day not in PARTIAL)
    asked = Asked(*REGION, (DEFAULT_START.isoformat(), end.isoformat()), path=path)
    folder = named_folder(Options())
    if any(folder.glob("*.nc")):
        return asked._replace(files=(str(folder / "*.nc"),))
    return asked._replace(remedy=f"None are in {folder}: 'riftberg fetch a68a' gets them, or name others")


_ALL = frozenset(("uo", "vo", "ssh", "ua", "va"))
"""What is spared where the ocean is one of formulas: all that files give otherwise."""


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


PRODUCTS = ("oscar", "glorys", "duacs", "era5", "ncep-r1", "gebco")


POSITIONS = ("byu", "usnic")


@reported
def fetch(
    what: Annotated[
        str,
        typer.Argument(
            help=f"a68a (inputs of the published run, 1.3 GB), {', '.join(PRODUCTS)}, or positions of bergs: byu, usnic."
        ),
    ],
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder.  [default: riftberg-data/NAME]")
    ] = None,
    lon: Annotated[str | None, typer.Option("--lon", metavar="WEST,EAST", help="Longitudes, for products.")] = None,
    lat: Annotated[str | None, typer.Option("--lat", metavar="SOUTH,NORTH", help="Latitudes, for products.")] = None,
    time: Annotated[
        str | None, typer.Option("--time", metavar="FIRST,LAST", help="Days, for products; gebco needs none.")
    ] = None,
    fields: Annotated[
        str | None,
        typer.Option(
            "--fields",
            metavar="FIELD,...",
            help="era5: wind, waves, ice; glorys: currents, ssh, ice; duacs: ssh, currents.  "
            "[default: wind; currents,ssh; ssh]",
        ),
    ] = None,
    depth: Annotated[float, typer.Option("--depth", help="Deepest level (m), for products with levels.")] = 250.0,
    small: Annotated[bool, typer.Option("--small", help="a68a: only the small files, no hourly fields.")] = False,
    quiet: Quiet = False,
) -> None:
    """Download forcing files; an interrupted download resumes where it stopped."""
    positive(depth, "--depth", "m", most=12_000.0)
    folder = folder or Path("riftberg-data") / what
    if what == "a68a":
        from riftberg.fetching.fetch import HOURLY, fetch_a68a

        with results_folder(folder):
            paths = fetch_a68a(folder, hourly=() if small else HOURLY, progress=not quiet)
    elif what in POSITIONS:
        from riftberg.fetching.fetch import SOURCES, fetch_positions

        with results_folder(folder):
            paths = fetch_positions(what, folder, progress=not quiet)
        typer.echo(f"{SOURCES[what].title}: {len(paths)} tables in {folder}; 'riftberg new BERG --date DAY' reads them")
        return
    elif what in PRODUCTS:
        from riftberg.fetching.services import fetch_product

        box, span = (pair(lon, "--lon"), pair(lat, "--lat")), dates(time)
        if box[0] is None or box[1] is None:
            raise InputError("a box is needed", where=f"fetch {what}", remedy="For example --lon -43,-33 --lat -59,-53")
        if span is None and what != "gebco":
            raise InputError(
                "days are needed", where=f"fetch {what}", remedy="For example --time 2020-12-09,2020-12-25"
            )
        chosen = tuple(field.strip() for field in fields.split(",")) if fields else ()
        with results_folder(folder):
            paths = fetch_product(what, folder, *box, span, fields=chosen, depth=depth, progress=not quiet)  # type: ignore[arg-type]
    else:
        raise InputError(
            f"{what!r} is not known", where="fetch", remedy=f"Use a68a, {', '.join((*PRODUCTS, *POSITIONS))}"
        )
    for path in paths:
        typer.echo(path)
