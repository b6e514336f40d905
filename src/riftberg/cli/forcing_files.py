"""Files before a run: ``riftberg doctor`` identifies forcing files and lists missing ones, ``riftberg fetch`` gets them.

``riftberg new`` writes an experiment file for a named berg on a date, from the tables that ``riftberg fetch`` gets.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, NamedTuple

import numpy as np
import typer

from riftberg.cli.options import (
    Names,
    Quiet,
    check_output,
    check_positive,
    check_range,
    dates,
    list_entries,
    match_names,
    pair,
    report_errors,
    results_folder,
    tell,
)
from riftberg.errors import InputError, RiftbergError
from riftberg.ocean.needs import EXPECTED, SEA_LEVEL, WIND
from riftberg.system.input_files import in_folder

if TYPE_CHECKING:
    from riftberg.diagnostics.observed import Sighting
    from riftberg.products.registry import Choice


EXIT_LACKING = 1


@report_errors
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

    requirements = _read_requirements(experiment, bool(files)) if experiment else Requirements()
    if not files and not requirements.files and not requirements.spared >= {*NEEDED}:
        remedy = requirements.remedy or "riftberg doctor 'data/*.nc', or --for my.yaml"
        raise InputError("no files were named", where="FILES", remedy=remedy)
    box, days = (
        (pair(lon, "--lon") or requirements.lon, pair(lat, "--lat") or requirements.lat),
        dates(time) or requirements.time,
    )
    chosen_files, choices = match_names(files or (), product, names)
    report = examine(
        chosen_files or requirements.files, lon=box[0], lat=box[1], time=days,
        needed=[*(name for name in NEEDED if name not in requirements.spared), *(need or ())],
        wished=[name for name in ASSUMED if name not in requirements.spared],
        path=_extreme_positions(run) or list(requirements.path), product=choices if names else product or requirements.products,
        max_gap=requirements.max_gap, hold=requirements.hold,
    ) if files or requirements.files else Report()  # fmt: skip
    # Another path, box or span than that of the experiment needs more than a run does.
    if experiment and not (run or lon or lat or time) and (not files or experiment.endswith(_YAML)):
        report.refusal, report.assumed, floor = _try_run(experiment, chosen_files, choices)
        report.notes += [floor] if floor else []
    elif not experiment and not run and box[0] and box[1] and days:
        report.refusal = _try_files(chosen_files, (box[0], box[1]), days, choices) or None
    tell(json.dumps(report.as_dict(), indent=1, default=str) if as_json else report.text())
    if not report.ready:
        raise typer.Exit(EXIT_LACKING)


class Requirements(NamedTuple):
    """Requirements of an experiment on its files: box (degrees), dates (UTC) and, if it names them, files and their products.

    ``path`` holds positions of the berg, ``spared`` fields that are not needed, ``max_gap`` and ``hold`` seconds, and
    ``remedy`` the advice where no files are named.
    """

    lon: tuple[float, float] | None = None
    lat: tuple[float, float] | None = None
    time: tuple[datetime, datetime] | None = None
    files: tuple[str, ...] = ()
    products: dict[str, Choice] | None = None
    path: tuple[tuple[float, float], ...] = ()
    spared: frozenset[str] = frozenset()
    max_gap: float | None = None
    hold: float | None = None
    remedy: str = ""


_YAML = (".yaml", ".yml")


def _try_run(experiment: str, files: Sequence[str], choices: Mapping[str, Choice]) -> tuple[str, list[str], str]:
    """Return why a run of an experiment does not start, the assumptions of ``riftberg run``, and keel and floor."""
    from riftberg.cli.run import check_start, collect_notices
    from riftberg.experiments import Options, build
    from riftberg.runs.groundings import keel_line

    options = Options(files=list_entries(files, choices))
    try:
        model, info = build(experiment, options)
        model.fit_time_step(3600.0 * info.output_every_hours)
        check_start(model, info.days, info.output_every_hours)
        notices, keel = collect_notices(info, model, options, info.output_every_hours), keel_line(model)
        if getattr(model.parameters.grounding, "start", "") == "refuse":
            model.step()  # The floor is asked for under the whole keel, not in the middle of elements, when it is lifted
    except RiftbergError as error:
        return str(error), [], ""
    return "", notices, keel


def _try_files(
    files: Sequence[str],
    box: tuple[tuple[float, float], tuple[float, float]],
    days: tuple[datetime, datetime],
    choices: Mapping[str, Choice],
) -> str:
    """Return why files do not suffice for a berg of usual draft in a box, wherever in it; empty if they do."""
    from riftberg.ocean.files_forcing import Run, forcing_from_files
    from riftberg.ocean.files_schema import FileForcing
    from riftberg.parameters import Ice

    entries = list(list_entries(files, choices))
    settings = FileForcing(kind="files", files=["any"], longitude=box[0], latitude=box[1])
    planned_run = Run(*days, np.array([200.0]), Ice().density)
    try:
        forcing_from_files(settings.model_copy(update={"files": entries}), Path(), planned_run)
    except RiftbergError as error:
        return str(error)
    return ""


def _read_requirements(name: str, files_named: bool) -> Requirements:
    """Return the requirements of an experiment on its files; ``files_named`` if others are named."""
    if name.endswith(_YAML):
        from riftberg.experiments.yaml_file import read_file
        from riftberg.ocean.files_schema import FileForcing

        experiment, _, _ = read_file(Path(name))
        forcing = experiment.forcing
        if not isinstance(forcing, FileForcing) and not files_named:
            return Requirements(spared=frozenset(EXPECTED))
        if not isinstance(forcing, FileForcing):
            raise InputError(
                f"its forcing is of kind {forcing.kind!r}", where=f"--for {name}", remedy="It needs no files"
            )
        end = experiment.start + timedelta(days=experiment.days)
        products = {in_folder(Path(name).parent, entry.file): entry.choice for entry in forcing.entries}
        left_out = set() if forcing.sea_level in ("auto", "files") else {*SEA_LEVEL.fields}
        left_out |= {*WIND.fields} if forcing.wind == "none" else set()
        max_gap, hold = (None if hours is None else 3600.0 * hours for hours in (forcing.max_gap, forcing.hold))
        return Requirements(
            forcing.longitude, forcing.latitude, (experiment.start, end), tuple(products), products,
            spared=frozenset(left_out), max_gap=max_gap, hold=hold,
        )  # fmt: skip
    from riftberg.experiments import Options, find
    from riftberg.experiments.a68a import A68A_OBSERVED, PARTIAL, REGION
    from riftberg.experiments.a68a_files import named_folder
    from riftberg.start.checks import DEFAULT_START

    if not files_named and not find(name).fetches:
        return Requirements(spared=frozenset(EXPECTED))
    end = DEFAULT_START + timedelta(days=18)
    path = tuple((seen.lon, seen.lat) for seen in A68A_OBSERVED if seen.day not in PARTIAL)
    requirements = Requirements(*REGION, (DEFAULT_START, end), path=path)
    folder = named_folder(Options())
    if any(folder.glob("*.nc")):
        return requirements._replace(files=(str(folder / "*.nc"),))
    return requirements._replace(remedy=f"None are in {folder}: 'riftberg fetch a68a' gets them, or name others")


def _extreme_positions(run: Path | None) -> list[tuple[float, float]] | None:
    """Return where the ice of a run reaches farthest west, east, south and north, at fifty records or so."""
    if run is None:
        return None
    from riftberg.plane import near
    from riftberg.runs.run_file import open_run

    with open_run(run) as dataset:
        if "lon" not in dataset:
            raise InputError("this run is in metres", where=f"--along {run}", remedy="Name a run in degrees")
        every = max(1, dataset.sizes["time"] // 50)
        records = dataset[["lon", "lat"]].isel(time=slice(None, None, every)).transpose("time", "trajectory")
        lon, lat = (records[name].values for name in ("lon", "lat"))
    positions = []
    for x, y in zip(lon, lat, strict=True):
        present = np.flatnonzero(np.isfinite(y))
        turned = near(x[present], float(x[present][0])) if present.size else x[present]
        ends = {int(present[f(axis)]) for f in (np.argmin, np.argmax) for axis in (turned, y[present]) if present.size}
        positions += [(float(x[k]), float(y[k])) for k in sorted(ends)]
    return positions


PRODUCTS = ("oscar", "glorys", "duacs", "era5", "ncep-r1", "gebco")


POSITIONS = ("byu", "usnic")


@report_errors
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
    check_positive(depth, "--depth", "m", most=12_000.0)
    folder = folder or Path("riftberg-data") / what
    if what == "a68a":
        from riftberg.fetching.fetch import HOURLY, fetch_a68a

        with results_folder(folder):
            paths = fetch_a68a(folder, hourly=() if small else HOURLY, progress=not quiet)
    elif what in POSITIONS:
        from riftberg.fetching.fetch import SOURCES, fetch_positions

        with results_folder(folder):
            paths = fetch_positions(what, folder, progress=not quiet)
        tell(f"{SOURCES[what].title}: {len(paths)} tables in {folder}; 'riftberg new BERG --date DAY' reads them")
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
        tell(path)


SPEED: Final = 60.0
"""Way of the fastest bergs, km a day: the box of the products holds the berg however it drifts."""

ELEMENTS: Final = 600
"""Elements that a berg gets, about."""

CORNERS: Final = 72
"""Corners of the outline of an ellipse."""

SUITABLE: Final = {"glorys": "", "era5": " --fields wind", "gebco": ""}
"""Products of a run, with the options of ``riftberg fetch``."""


@report_errors
def new(
    berg: Annotated[str, typer.Argument(help="Name of a berg, such as A23a.")],
    date: Annotated[str, typer.Option("--date", help="Day of the start, such as 2025-01-10.")],
    days: Annotated[float, typer.Option("--days", help="Length of the run.")] = 10.0,
    tables: Annotated[
        Path | None, typer.Option("--tables", help="Folder of tables.  [default: riftberg-data/byu, or .../usnic]")
    ] = None,
    shape: Annotated[str, typer.Option("--shape", help="ellipse or rectangle of the listed axes.")] = "ellipse",
    outline: Annotated[Path | None, typer.Option("--outline", help="Outline of the berg, instead of a shape.")] = None,
    size: Annotated[
        str | None,
        typer.Option("--size", metavar="LENGTH,WIDTH", help="Axes, such as '60 km,30 km', instead of those listed."),
    ] = None,
    azimuth: Annotated[
        float,
        typer.Option("--azimuth", help="Direction of the long axis, degrees clockwise from north; no table lists it."),
    ] = 90.0,
    thickness: Annotated[str, typer.Option("--thickness", help="Thickness of the ice; no table lists it.")] = "250 m",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File.  [default: BERG-DATE.yaml]")] = None,
) -> None:
    """Write an experiment file for a named berg: place, size, products to fetch."""
    from riftberg.bergs.outline import check_outline, read_features, select_outline
    from riftberg.config.values import number, parse_date
    from riftberg.diagnostics.observed import find_sighting, read_berg
    from riftberg.experiments.yaml_file import read_file
    from riftberg.system.atomic_files import write_text

    check_positive(days, "--days", "days", most=400.0)
    start = parse_date(date, where="--date")[0]
    if shape not in ("ellipse", "rectangle"):
        raise InputError(f"{shape!r} is no shape", where="--shape", remedy="Use ellipse or rectangle")
    metres = number(thickness, "m", where="--thickness")
    given_axes = None
    if size is not None:
        given_axes = _axes_given(size)
    check_range(azimuth, "--azimuth", -360.0, 360.0)
    if outline is not None:
        where = str(outline)
        check_outline(select_outline(read_features(outline), where=where).geometry, where=where)
    folder = tables or next((f for f in map(Path, ("riftberg-data/byu", "riftberg-data/usnic")) if f.is_dir()), None)
    if folder is None or not folder.is_dir():
        raise InputError(
            "no folder of tables" if folder is None else "no such folder", where="--tables",
            remedy="'riftberg fetch byu' or 'riftberg fetch usnic' gets them",
        )  # fmt: skip
    sighting = find_sighting(berg, read_berg(berg, folder), start, sized=given_axes is None and outline is None)
    file = output or Path(f"{berg.lower()}-{start:%Y%m%d}.yaml")
    check_output(file)
    axes = given_axes or (sighting.size.axes if sighting.size else None)
    text, ring = _experiment(berg, start, days, sighting, axes, shape, outline, azimuth, metres, file)
    if ring:
        write_text(ring_file(file), "lon,lat\n" + "".join(f"{x:.5f},{y:.5f}\n" for x, y in ring))
    write_text(file, text)
    read_file(file)
    tell(f"Written: {file}" + (f", {ring_file(file)}" if ring else ""))
    for line in text.splitlines():
        if line.startswith("# "):
            tell(line[2:])
    tell(f"Then: riftberg doctor --for {file}; riftberg run {file}")


def _axes_given(size: str) -> tuple[float, float]:
    """Return the axes (m) of ``--size``, the longer one first."""
    from riftberg.config.values import number
    from riftberg.diagnostics.observed import LONGEST

    remedy = "For example --size '60 km,30 km'"
    texts = size.split(",")
    if bare := [text for text in texts if not any(c.isalpha() for c in text)]:
        raise InputError(f"{bare[0].strip()!r} has no unit", where="--size", remedy=remedy)
    metres = [number(text, "m", where="--size") for text in texts]
    if len(metres) != 2 or min(metres) <= 0.0:
        raise InputError(f"{size!r} is not two lengths", where="--size", remedy=remedy)
    if max(metres) > LONGEST:
        raise InputError(f"{size!r}: no berg is that large", where="--size", remedy=remedy)
    return max(metres), min(metres)


def ring_file(file: Path) -> Path:
    """Return the file of the outline, beside the experiment file."""
    return file.with_name(f"{file.stem}-outline.csv")


def _experiment(
    berg: str, start: datetime, days: float, sighting: Sighting, axes: tuple[float, float] | None, shape: str,
    outline: Path | None, azimuth: float, thickness: float, file: Path,
) -> tuple[str, list[tuple[float, float]]]:  # fmt: skip
    """Return the text of the file, and the outline that goes beside it where the berg is an ellipse."""
    from riftberg.config.units import place_text

    fix, ring = sighting.fix, []
    position = place_text(fix.lon, fix.lat, latlon=True)
    notes = [f"{berg} at {position}, seen by {fix.sensor} on {fix.when:%Y-%m-%d}."]
    lines = [f"  name: {berg}", f"  thickness: {thickness:g} m"]
    if outline is not None:
        lines.append(f"  outline: {outline.resolve()}")
        reach = 100.0
    else:
        assert axes is not None
        long_axis, short_axis = max(axes), min(axes)
        listed = sighting.size is not None and sighting.size.axes == axes
        source = f"listed by NIC on {sighting.size.when:%Y-%m-%d}" if listed and sighting.size else "given"
        notes.append(
            f"Axes of {long_axis / 1e3:.0f} km and {short_axis / 1e3:.0f} km, {source}, as {'an' if shape == 'ellipse' else 'a'} "
            f"{shape}; long axis towards {azimuth:g} degrees and thickness of {thickness:g} m are not observed: change them."
        )
        area = long_axis * short_axis * (math.pi / 4.0 if shape == "ellipse" else 1.0)
        radius = max(100.0, round(0.5 * math.sqrt(area / ELEMENTS), -2))
        if shape == "ellipse":
            ring = _ellipse(fix.lon, fix.lat, long_axis, short_axis, azimuth)
            lines.append(f"  outline: {ring_file(file).name}")
        else:
            lines += [
                f"  rectangle: {{length: {long_axis:.0f} m, width: {short_axis:.0f} m}}",
                f"  placement: [{fix.lon:.4f}, {fix.lat:.4f}]", f"  rotation: {90.0 - azimuth:g}",
            ]  # fmt: skip
        lines.append(f"  radius: {radius:g} m")
        reach = 0.6 * long_axis / 1e3
    reach += SPEED * days
    north, south = min(fix.lat + reach / 111.2, 89.0), max(fix.lat - reach / 111.2, -89.0)
    half = min(reach / (111.2 * math.cos(math.radians(max(abs(north), abs(south))))), 180.0)
    box = [math.floor(fix.lon - half), math.ceil(fix.lon + half)], [math.floor(south), math.ceil(north)]
    last = start + timedelta(days=days)
    notes.append(f"Files to fetch (north, south, west and east: {SPEED:g} km a day around the berg):")
    for product, more in SUITABLE.items():
        time = (
            ""
            if product == "gebco"
            else f" --time {start - timedelta(days=1):%Y-%m-%d},{last + timedelta(days=2):%Y-%m-%d}"
        )
        notes.append(
            f"  riftberg fetch {product} --lon {box[0][0]},{box[0][1]} --lat {box[1][0]},{box[1][1]}{time}{more}"
        )
    files = ", ".join(f"riftberg-data/{product}/*.nc" for product in SUITABLE)
    text = [
        *(f"# {note}" for note in notes), f"name: {file.stem}", f"start: {start:%Y-%m-%d %H:%M}", f"days: {days:g}", "berg:",
        *lines, "forcing:", "  kind: files", f"  files: [{files}]", f"  longitude: [{box[0][0]}, {box[0][1]}]",
        f"  latitude: [{box[1][0]}, {box[1][1]}]", "",
    ]  # fmt: skip
    return "\n".join(text), ring


def _ellipse(lon: float, lat: float, long_axis: float, short_axis: float, azimuth: float) -> list[tuple[float, float]]:
    """Return the corners of an ellipse, degrees."""
    from riftberg.plane import ellipse

    # A polygon in an ellipse has less area than it: the corners stand a little outside.
    grown = math.sqrt(2.0 * math.pi / (CORNERS * math.sin(2.0 * math.pi / CORNERS)))
    ring = ellipse(lon, lat, 0.5 * grown * long_axis, 0.5 * grown * short_axis, azimuth, CORNERS)[:-1]
    return [(x, y) for x, y in ring.tolist()]
