"""``riftberg hazard``: limits of ice, positions with error radius and probabilities of a forecast, for charts and ships."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Annotated, Any

import typer

from riftberg.cli.options import check_folder, results_folder
from riftberg.cli.terminal import reported
from riftberg.errors import InputError

FILES = ("hazard.geojson", "hazard.kml", "hazard.nc", "hazard.csv", "near.csv")
"""Files of a folder of hazards; the last one where a place is named."""


@reported
def hazard(
    folder: Annotated[Path, typer.Argument(help="Folder of a forecast, or its forecast.nc.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files.  [default: folder hazard of the forecast]")
    ] = None,
    near: Annotated[
        Path | None,
        typer.Option("--near", metavar="FILE", help="Points, routes or areas (GeoJSON, shapefile, KML) that ice may come near."),
    ] = None,
    within: Annotated[
        str, typer.Option("--within", metavar="DISTANCE", help="How near: 5nm are nautical miles; 10km.")
    ] = "5nm",
) -> None:  # fmt: skip
    """Write limits of ice, positions with error radius and probabilities of a forecast as GeoJSON, KML, netCDF and CSV."""
    from riftberg.ensembles import hazard as products
    from riftberg.ensembles.result import open_sweep
    from riftberg.system.atomic_files import write_text
    from riftberg.system.netcdf_lock import write_dataset

    result = open_sweep(folder)
    if "cone_lon" not in result:
        raise InputError("holds no forecast in degrees with members that are done", where=str(folder),
                         remedy="Name a folder that 'riftberg forecast' made")  # fmt: skip
    distance = _distance(within)
    places = [] if near is None else _places(near)
    out = output or (folder if folder.is_dir() else folder.parent) / "hazard"
    check_folder(out, FILES)
    with results_folder(out, FILES, taken=FILES):
        limits = products.ice_limits(result)
        features = products.geojson(result, limits)
        write_text(out / "hazard.geojson", json.dumps(features) + "\n")
        write_text(out / "hazard.kml", products.kml(features))
        write_text(out / "hazard.csv", _table(products.positions(result)))
        gridded = products.gridded(result)
        encoding: dict[str, Any] = {str(n): {"zlib": True} for n, v in gridded.data_vars.items() if v.ndim > 1}
        # Coordinates have no missing values, and so no number that stands for one (CF, 2.5.1).
        encoding |= {str(n): {"_FillValue": None} for n in gridded.coords}
        write_dataset(gridded, out / "hazard.nc", encoding=encoding)
        files = list(FILES[:-1])
        for limit in limits:
            if limit.date is None:
                typer.echo(f"{limit.percent} % limit of ice, whole time: {products.area_km2(limit.line):.0f} km2, "
                           f"all ice of {100 * limit.inside:.0f} % of the members inside")  # fmt: skip
        if places:
            rows = []
            for name, shape in places:
                found = products.approach(result, name, shape, distance)
                typer.echo(found.told())
                rows += found.rows()
            write_text(out / "near.csv", _table(rows))
            files.append("near.csv")
        typer.echo(f"Not covered: {result.attrs.get('not_covered', 'ice smaller than an element')}")
        typer.echo(f"Written to {out}: {', '.join(files)}")


def _distance(text: str) -> float:
    from riftberg.config.values import number

    plain = text.strip()
    # A ship's nm is the nautical mile; nanometres come near nothing.
    plain = plain[:-2].strip() + " nmi" if plain.endswith("nm") else plain
    if plain.replace(".", "", 1).isdigit():
        raise InputError("a number without a unit", where=f"--within {text}", remedy=f"Give {plain}nm or {plain}km")
    metres = number(plain, "m", where=f"--within {text}")
    if not 0.0 <= metres < 2e7:
        raise InputError(f"{metres:g} m", where=f"--within {text}", remedy="Give a distance, such as 5nm or 10km")
    return metres


def _places(path: Path) -> list[tuple[str, Any]]:
    """Return names and shapes (degrees) of a file."""
    from riftberg.bergs.outline import read_features
    from riftberg.errors import BergError
    from riftberg.system.input_files import check_file

    remedy = "Give points, lines or areas in longitude and latitude as GeoJSON, shapefile or KML"
    check_file(path, remedy=remedy)
    try:
        features = read_features(path, lines=True)
    except BergError as error:
        raise InputError(error.what, where=str(path), remedy=remedy) from error
    found = [(str(feature.properties.get("name") or ""), feature.geometry) for feature in features]
    if any(shape.is_empty for _, shape in found):
        raise InputError("holds an empty shape", where=str(path), remedy=remedy)
    for _, shape in found:
        west, south, east, north = shape.bounds
        if south < -90.0 or north > 90.0 or west < -360.0 or east > 540.0:
            raise InputError("positions are no degrees", where=str(path), remedy=remedy)
    return [(name or f"{path.stem} {k + 1}", shape) for k, (name, shape) in enumerate(found)]


def _table(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
