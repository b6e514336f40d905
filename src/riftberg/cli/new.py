"""``riftberg new``: an experiment file for a named berg on a date, from the tables that ``riftberg fetch`` gets."""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from riftberg.cli.options import check_output, positive, within
from riftberg.cli.terminal import reported
from riftberg.errors import InputError

if TYPE_CHECKING:
    from riftberg.diagnostics.observed import Known

SPEED: Final = 60.0
"""Way of the fastest bergs, km a day: the box of the products holds the berg however it drifts."""

ELEMENTS: Final = 600
"""Elements that a berg gets, about."""

CORNERS: Final = 72
"""Corners of the outline of an ellipse."""

PRODUCTS: Final = {"glorys": "", "era5": " --fields wind", "gebco": ""}
"""Products of a run, with the options of ``riftberg fetch``."""


@reported
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
    from riftberg.diagnostics.observed import known_at, read_berg
    from riftberg.experiments.yaml_file import read_file

    positive(days, "--days", "days", most=400.0)
    start = parse_date(date, where="--date")[0]
    if shape not in ("ellipse", "rectangle"):
        raise InputError(f"{shape!r} is no shape", where="--shape", remedy="Use ellipse or rectangle")
    metres = number(thickness, "m", where="--thickness")
    given = None
    if size is not None:
        given = _axes_given(size)
    within(azimuth, "--azimuth", -360.0, 360.0)
    if outline is not None:
        where = str(outline)
        check_outline(select_outline(read_features(outline), where=where).geometry, where=where)
    folder = tables or next((f for f in map(Path, ("riftberg-data/byu", "riftberg-data/usnic")) if f.is_dir()), None)
    if folder is None or not folder.is_dir():
        raise InputError(
            "no folder of tables" if folder is None else "no such folder", where="--tables",
            remedy="'riftberg fetch byu' or 'riftberg fetch usnic' gets them",
        )  # fmt: skip
    known = known_at(berg, read_berg(berg, folder), start, sized=given is None and outline is None)
    file = output or Path(f"{berg.lower()}-{start:%Y%m%d}.yaml")
    check_output(file)
    axes = given or (known.size.axes if known.size else None)
    text, ring = _experiment(berg, start, days, known, axes, shape, outline, azimuth, metres, file)
    if ring:
        ring_file(file).write_text("lon,lat\n" + "".join(f"{x:.5f},{y:.5f}\n" for x, y in ring), encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    read_file(file)
    typer.echo(f"Written: {file}" + (f", {ring_file(file)}" if ring else ""))
    for line in text.splitlines():
        if line.startswith("# "):
            typer.echo(line[2:])
    typer.echo(f"Then: riftberg doctor --for {file}; riftberg run {file}")


def _axes_given(size: str) -> tuple[float, float]:
    """Return the axes (m) of ``--size``, the longer one first."""
    from riftberg.config.values import number
    from riftberg.diagnostics.observed import LONGEST

    remedy = "For example --size '60 km,30 km'"
    parts = size.split(",")
    if bare := [part for part in parts if not any(c.isalpha() for c in part)]:
        raise InputError(f"{bare[0].strip()!r} has no unit", where="--size", remedy=remedy)
    metres = [number(part, "m", where="--size") for part in parts]
    if len(metres) != 2 or min(metres) <= 0.0:
        raise InputError(f"{size!r} is not two lengths", where="--size", remedy=remedy)
    if max(metres) > LONGEST:
        raise InputError(f"{size!r}: no berg is that large", where="--size", remedy=remedy)
    return max(metres), min(metres)


def ring_file(file: Path) -> Path:
    """Return the file of the outline beside that of the experiment."""
    return file.with_name(f"{file.stem}-outline.csv")


def _experiment(
    berg: str, start: datetime, days: float, known: Known, axes: tuple[float, float] | None, shape: str, outline: Path | None,
    azimuth: float, thickness: float, file: Path,
) -> tuple[str, list[tuple[float, float]]]:  # fmt: skip
    """Return the text of the file, and the outline that goes beside it where the berg is an ellipse."""
    from riftberg.config.units import place_text

    fix, ring = known.fix, []
    place = place_text(fix.lon, fix.lat, latlon=True)
    notes = [f"{berg} at {place}, seen by {fix.sensor} on {fix.when:%Y-%m-%d}."]
    lines = [f"  name: {berg}", f"  thickness: {thickness:g} m"]
    if outline is not None:
        lines.append(f"  outline: {outline.resolve()}")
        reach = 100.0
    else:
        assert axes is not None
        long_axis, short_axis = max(axes), min(axes)
        listed = known.size is not None and known.size.axes == axes
        source = f"listed by NIC on {known.size.when:%Y-%m-%d}" if listed and known.size else "given"
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
    for product, more in PRODUCTS.items():
        time = (
            ""
            if product == "gebco"
            else f" --time {start - timedelta(days=1):%Y-%m-%d},{last + timedelta(days=2):%Y-%m-%d}"
        )
        notes.append(
            f"  riftberg fetch {product} --lon {box[0][0]},{box[0][1]} --lat {box[1][0]},{box[1][1]}{time}{more}"
        )
    files = ", ".join(f"riftberg-data/{product}/*.nc" for product in PRODUCTS)
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
