"""Outlines of bergs, and lines of rifts, from GeoJSON, shapefile, CSV, KML or geometry objects.

Projected coordinates need pyproj, shapefiles pyshp: the optional packages of the extra ``outline``, imported when first
used.
"""

from __future__ import annotations

import io
import json
import logging
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import repeat
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import shapely
import shapely.errors
from shapely.geometry import shape

from riftberg.bergs.seams import NO_BERG, ring_fault, whole_shapes
from riftberg.errors import BergError, line_of_fault
from riftberg.state import Floats
from riftberg.system.input_files import (
    MOST_TEXT,
    check_archive,
    check_file,
    needed,
    read_csv_rows,
    reading,
    value_shown,
)

DATES_BY_BELIEF: Final = (
    ("acquired", "acq_date", "acqdate", "img_date", "image_date", "obs_date", "sensing"),
    ("date", "datetime", "date_time", "when", "timestamp", "time"),
    ("begin", "time_coverage_start"),
)
"""Attributes that hold the date of an outline: when a picture was taken, of whatever, and since when it holds."""

DATE_KEYS: Final = tuple(key for keys in DATES_BY_BELIEF for key in keys)
"""The same, best first; small and capital letters are alike."""

NAMES: Final = ("berg", "iceberg", "name", "variable", "outline", "label", "id")
"""Attributes that name an outline, best first."""


@dataclass(frozen=True)
class Feature:
    """One feature of a file: a shapely geometry in longitude and latitude, and its properties."""

    geometry: Any
    properties: dict[str, Any] = field(default_factory=dict)

    @property
    def date(self) -> str:
        """Date of the feature as text, empty if it has none."""
        for key in DATE_KEYS:
            for name, value in self.properties.items():
                if name.lower() == key and value not in (None, ""):
                    return str(value)
        return ""

    @property
    def name(self) -> str:
        """Name of the feature, empty if it has none."""
        small = {
            str(key).lower(): str(value).strip() for key, value in self.properties.items() if value not in (None, "")
        }
        return next((small[key] for key in NAMES if key in small), "")

    def label(self) -> str:
        """Return date and other short properties, for messages."""
        return ", ".join(f"{k}={v}" for k, v in self.properties.items() if len(str(v)) < 40) or "no properties"


def polygon(shell: Any, holes: list[Any], where: str) -> Any:
    """Return a shapely polygon of a shell and holes, or refuse faulty vertices."""
    # Each ring by itself first: shapely names neither the file nor the ring.
    rings = [_ring(ring, where) for ring in (shell, *holes)]
    return shapely.Polygon(rings[0], rings[1:])


def _ring(ring: Any, where: str) -> Any:
    """Return a ring as an array (n, 2), or refuse a faulty one."""
    try:
        vertices = np.asarray(ring, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise BergError(
            "vertices that are no numbers", where=where, remedy="Give longitude and latitude each"
        ) from error
    if vertices.ndim != 2 or vertices.shape[1] < 2 or len(vertices) < 3:
        raise BergError(
            f"a ring of shape {vertices.shape}",
            where=where,
            remedy="A ring needs at least 3 vertices of longitude and latitude",
        )
    if not np.isfinite(vertices).all():
        raise BergError("vertices that are not numbers", where=where, remedy="Remove them")
    # Heights and measures, as of KML, say nothing about an outline on the sea.
    return vertices[:, :2]


_WGS84 = ("CRS84", "EPSG::4326", "EPSG:4326", "OGC:CRS84")


def read_features(source: Any, crs: str | None = None, *, lines: bool = False) -> list[Feature]:
    """Read all features of a file or object.

    ``source``: ``.geojson``/``.json``, ``.shp``/``.zip``, ``.csv``/``.txt``, ``.kml``/``.kmz``.
    """
    where = str(source) if isinstance(source, str | Path) else type(source).__name__
    features, own_crs = _read_source(source, lines)
    crs = crs or own_crs
    if crs and not any(name in crs for name in _WGS84):
        features = [Feature(_to_lonlat(f.geometry, crs, where), f.properties) for f in features]
    if not features:
        raise BergError("no geometry found", where=where, remedy="Give a file that holds at least one polygon or line")
    return close_seams(features)


def _read_source(source: Any, lines: bool) -> tuple[list[Feature], str | None]:
    if isinstance(source, str | Path):
        path = check_file(
            source, most=MOST_TEXT, kind=BergError, missing="file not found",
            remedy=f"Name a file {', '.join(sorted((*_READERS, *_TABLES)))}",
        )  # fmt: skip
        if path.suffix.lower() in _TABLES:
            return read_csv_features(path, lines=lines), None
        reader = _READERS.get(path.suffix.lower())
        if reader is None:
            raise BergError(
                f"unknown kind of file '{path.suffix}'",
                where=str(path),
                remedy=f"Use one of {', '.join(sorted((*_READERS, *_TABLES)))}",
            )
        with reading(path, "no outline that can be read", "Export the outline again", BergError):
            return reader(path)  # type: ignore[no-any-return]
    if hasattr(source, "__geo_interface__"):
        return _from_geojson(dict(source.__geo_interface__))
    if isinstance(source, dict):
        return _from_geojson(source)
    return [Feature(polygon(np.asarray(source, dtype=float), [], "array of vertices"))], None


def _from_geojson(data: dict[str, Any], where: str = "GeoJSON") -> tuple[list[Feature], str | None]:
    crs = _named_crs(data, where)
    if data.get("type") == "FeatureCollection":
        features = data.get("features", [])
        if not isinstance(features, list) or not all(isinstance(f, dict) for f in features):
            raise BergError("its features are no list of features", where=where, remedy=_RFC)
    else:
        features = [data if data.get("type") == "Feature" else {"geometry": data}]
    drawn = []
    for number, feature in enumerate(features):
        location = f"{where}, feature {number}"
        try:
            # Tools of mapping write features without a geometry for rows that were never drawn; these are skipped.
            if _holds_anything(feature.get("geometry")):
                with np.errstate(invalid="ignore"):  # a vertex that is no number is told where the outline is taken
                    drawn.append(Feature(shape(feature["geometry"]), dict(feature.get("properties") or {})))
        except (KeyError, TypeError, AttributeError) as error:  # their texts speak of Python
            raise BergError(
                "not a GeoJSON geometry: members or numbers are missing", where=location, remedy=_RFC
            ) from error
        except (ValueError, shapely.errors.ShapelyError) as error:
            raise BergError(
                "not a GeoJSON geometry: its type is another, or a ring has not at least 4 positions",
                where=location,
                remedy=_RFC,
            ) from error
    return drawn, crs


_RFC = "Write GeoJSON as in RFC 7946"


def _named_crs(data: dict[str, Any], where: str) -> str | None:
    """Return the coordinate system that an old GeoJSON names."""
    crs = data.get("crs")
    for key in ("properties", "name"):
        if crs is None:
            return None
        if not isinstance(crs, dict):
            raise BergError("a member crs that names no coordinate system", where=where, remedy="Leave it out")
        crs = crs.get(key)
    if crs is not None and not isinstance(crs, str):
        raise BergError("a member crs that names no coordinate system", where=where, remedy="Leave it out")
    return crs


def _holds_anything(geometry: Any) -> bool:
    if geometry and geometry.get("type") == "GeometryCollection":
        return any(_holds_anything(member) for member in geometry.get("geometries") or ())
    return bool(geometry and geometry.get("coordinates"))


def _from_geojson_file(path: Path) -> tuple[list[Feature], str | None]:
    content = path.read_bytes()
    try:
        try:
            data = json.loads(content)  # with or without a mark of its encoding
        except UnicodeDecodeError:  # an 8-bit set, as in tables
            data = json.loads(content.decode("latin-1"))
    except (ValueError, RecursionError) as error:
        raise BergError(f"not JSON{line_of_fault(error)}", where=str(path), remedy=_RFC) from error
    if not isinstance(data, dict):
        raise BergError("no GeoJSON object", where=str(path), remedy=_RFC)
    return _from_geojson(data, str(path))


def _from_shapefile(path: Path) -> tuple[list[Feature], str | None]:
    files = _shapefile_members(path)
    logging.getLogger("shapefile").addHandler(logging.NullHandler())  # or its notices go to the error stream
    streams = {end[1:]: io.BytesIO(files[end]) for end in (".shp", ".shx", ".dbf") if end in files}
    encoding = _attribute_encoding(files)
    with needed("shapefile").Reader(**streams, encoding=encoding, encodingErrors="replace") as reader:
        rows = (dict(row.as_dict()) for row in reader.iterRecords()) if "dbf" in streams else repeat({})
        # Shapes of kind 0 are null shapes.
        features = [
            Feature(shape(drawn.__geo_interface__), row)
            for drawn, row in zip(reader.iterShapes(), rows, strict=False)
            if drawn.shapeType != 0
        ]
    crs = files[".prj"].decode("utf-8-sig", errors="replace") if ".prj" in files else None
    geographic = crs is not None and crs.lstrip().upper().startswith(("GEOGCS", "GEOGCRS"))
    return features, None if geographic else crs


def _shapefile_members(path: Path) -> dict[str, bytes]:
    """Return the files of a shapefile, from a folder or an archive of one, by their endings in small letters."""
    if path.suffix.lower() == ".zip":
        remedy = "Zip the parts of one shapefile (.shp, .shx, .dbf)"
        names = check_archive(path, MOST_TEXT, remedy=remedy, kind=BergError)
        shapes = [name for name in names if name.lower().endswith(".shp")]
        if len(shapes) != 1:
            problem = f"an archive of {len(shapes)} shapefiles" if shapes else "an archive without a shapefile"
            remedy = "Unzip it and name one of them" if shapes else remedy
            raise BergError(f"{problem}; it holds {', '.join((shapes or names)[:5])}", where=str(path), remedy=remedy)
        with zipfile.ZipFile(path) as archive:
            return {n[-4:].lower(): archive.read(n) for n in names if n[:-4].lower() == shapes[0][:-4].lower()}
    files = {}
    # Of names that differ in capitals those written like the file that was named count.
    for file in sorted(path.parent.iterdir(), key=lambda file: file.stem == path.stem):
        end = file.suffix.lower()
        if file.stem.lower() == path.stem.lower() and end in (".shx", ".dbf", ".prj", ".cpg") and file.stat().st_size:
            files[end] = check_file(file, most=MOST_TEXT, remedy="Leave it out", kind=BergError).read_bytes()
    return {**files, ".shp": path.read_bytes()}


def _attribute_encoding(files: dict[str, bytes]) -> str:
    """Return the encoding of a table of attributes: as stated, else UTF-8, or the encoding of Windows where that fails."""
    stated = files.get(".cpg", b"").decode("latin-1").strip()
    table = files.get(".dbf", b"")
    for encoding in filter(None, (stated, "utf-8")):
        try:
            table[int.from_bytes(table[8:10], "little") :].decode(encoding)
        except (LookupError, ValueError):
            continue
        return encoding
    return "cp1252"


def _to_lonlat(geometry: Any, crs: str, where: str) -> Any:
    pyproj = needed("pyproj")
    try:
        transformer = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.CRSError as error:
        raise BergError(
            f"unknown coordinate system '{crs[:60]}'", where=where, remedy="Name it like EPSG:3031"
        ) from error
    moved = shapely.transform(geometry, transformer.transform, interleaved=False)
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise BergError(
            f"vertices that do not exist in the coordinate system '{crs[:60]}'", where=where,
            remedy="Name the coordinate system of the file",
        )  # fmt: skip
    try:  # no edge of a projected outline jumps from 180 to -180; that around a pole cannot be laid open
        return shapely.transform(
            moved, lambda lonlat: np.stack([np.unwrap(lonlat[:, 0], period=360.0), lonlat[:, 1]], 1)
        )
    except shapely.errors.GEOSException:
        return moved


_READERS: dict[str, Any] = {
    ".geojson": _from_geojson_file,
    ".json": _from_geojson_file,
    ".shp": _from_shapefile,
    ".zip": _from_shapefile,
    ".kml": lambda path: (read_kml_features(path), None),
    ".kmz": lambda path: (read_kml_features(path), None),
}
_TABLES = (".csv", ".txt")


def select_outline(
    features: list[Feature], *, where: str, feature: int | str | None = None, date: str | None = None
) -> Feature:
    """Choose the one polygon feature that is meant."""
    polygons = [Feature(area, f.properties) for f in features if (area := join_polygons(f.geometry)) is not None]
    chosen = polygons
    if isinstance(feature, int):
        chosen = polygons[feature : feature + 1] if feature >= 0 else []
    elif feature is not None:
        chosen = [f for f in polygons if feature in (str(v) for v in f.properties.values())]
    if date is not None:
        chosen = [f for f in chosen if f.date.startswith(str(date)[:10])]
    if len(chosen) == 1:
        return chosen[0]
    listed = "; ".join(f"{n}: {f.label()}" for n, f in enumerate(polygons[:40]))
    raise BergError(
        f"{len(chosen)} of {len(polygons)} outlines fit feature={feature!r}, date={date!r}",
        where=where,
        remedy=f"Choose exactly one with feature= or date= among [{listed}]",
    )


def _parts(geometry: Any) -> Iterator[Any]:
    """Yield the single polygons, lines and points of a geometry, however deep they lie in collections."""
    if hasattr(geometry, "geoms"):
        for member in geometry.geoms:
            yield from _parts(member)
    else:
        yield geometry


def join_polygons(geometry: Any) -> Any:
    """Return the polygons of a geometry as one, None if it has none."""
    polygons = _polygons(geometry)
    return _collect(polygons, []) if polygons else None


def _polygons(geometry: Any) -> list[Any]:
    """Return the single polygons of a geometry; rings of no area are left out beside others."""
    polygons = [single for single in _parts(geometry) if single.geom_type == "Polygon"]
    solid = [polygon for polygon in polygons if polygon.area > 0.0] or polygons[:1]
    holes = [[hole for hole in polygon.interiors if shapely.Polygon(hole).area > 0.0] for polygon in solid]
    return [
        polygon if len(rings) == len(polygon.interiors) else shapely.Polygon(polygon.exterior, rings)
        for polygon, rings in zip(solid, holes, strict=True)
    ]


def _collect(polygons: list[Any], others: list[Any]) -> Any:
    """Return polygons and other geometries as one."""
    if others:
        return shapely.GeometryCollection([*polygons, *others])
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def close_seams(features: list[Feature]) -> list[Feature]:
    """Return the features as whole shapes: the seams along which they were cut, as at 180 degrees, are closed.

    Polygons of one feature that share an edge are one shape. Those of several features are joined only along a meridian, and
    under one name and date: two bergs may touch.
    """
    drawn = [_polygons(feature.geometry) for feature in features]
    changed: dict[int, list[Any]] = {}
    same_name: dict[tuple[str, str], list[int]] = {}
    for k, (feature, polygons) in enumerate(zip(features, drawn, strict=True)):
        shapes = whole_shapes(polygons) if len(polygons) > 1 else []
        if shapes and len(shapes) < len(polygons):
            drawn[k] = changed[k] = [shape for _, shape in shapes]
        if feature.name and polygons:
            same_name.setdefault((feature.name, feature.date), []).append(k)
    for rows in same_name.values():
        owner = [k for k in rows for _ in drawn[k]]
        shapes = whole_shapes([area for k in rows for area in drawn[k]], along_meridian=True) if len(rows) > 1 else []
        if shapes and len(shapes) < len(owner):
            changed |= {k: [shape for members, shape in shapes if owner[members[0]] == k] for k in rows}
    for k, polygons in changed.items():
        others = [single for single in _parts(features[k].geometry) if single.geom_type != "Polygon"]
        geometry = _collect(polygons, others) if polygons or others else None
        features[k] = replace(features[k], geometry=geometry)
    # A piece that belongs to a feature on the other side of a seam is no feature.
    return [feature for feature in features if feature.geometry is not None]


def check_outline(geometry: Any, *, where: str, repair: bool = False) -> Any:
    """Return the outline if it can be filled, else raise `BergError`.

    ``geometry``: longitude and latitude in degrees.
    """
    points = shapely.get_coordinates(geometry)
    if len(points) == 0 or not np.isfinite(points).all():
        raise BergError("the outline is empty or has vertices that are not numbers", where=where, remedy="Remove them")
    if abs(points[:, 1]).max() > 90 or abs(points[:, 0]).max() > 540:
        worst = points[np.argmax(abs(points[:, 1]) / 90 + abs(points[:, 0]) / 540)]
        raise BergError(
            f"vertex ({worst[0]:g}, {worst[1]:g}) is not longitude and latitude in degrees",
            where=where,
            remedy="Name the coordinate system with crs=, for example crs='EPSG:3031'",
        )
    areas = getattr(geometry, "geoms", [geometry])
    if fault := next(filter(None, (ring_fault(area.exterior.coords) for area in areas)), ""):
        raise BergError(fault, where=where, remedy=NO_BERG)
    for ring in (np.asarray(ring.coords) for area in areas for ring in (area.exterior, *area.interiors)):
        if abs(np.diff(ring[:, 0])).max() > 180:
            raise BergError(
                "the outline jumps by more than 180 degrees of longitude",
                where=where,
                remedy="Let its longitudes go on: 179, 181 across the date line, and -1, 1 across Greenwich",
            )
    if not geometry.is_valid:
        if not repair:
            raise BergError(
                f"the outline crosses itself ({shapely.is_valid_reason(geometry)})",
                where=where,
                remedy="Mend it there, or pass repair=True",
            )
        mended = shapely.make_valid(geometry)
        areas = [p for p in getattr(mended, "geoms", [mended]) if p.geom_type in ("Polygon", "MultiPolygon")]
        geometry = shapely.unary_union(areas)
    return geometry


def line_strings(source: Any, crs: str | None = None) -> list[Any]:
    """Return the lines of a file, geometry or array as arrays of shape (n, 2) of longitude and latitude.

    A table (CSV) holds open lines; polygons of other files count with their rings. Points are passed over.
    """
    if isinstance(source, np.ndarray | list | tuple):
        if len(source) and hasattr(source[0], "__geo_interface__"):
            return [line for item in source for line in line_strings(item, crs)]
        try:
            nested = source if np.ndim(source[0]) == 2 else [source]
            lines = [np.asarray(line, dtype=float) for line in nested]
        except (IndexError, TypeError, ValueError) as error:
            raise BergError(
                "lines that are no numbers",
                where="lines",
                remedy="Give arrays (n, 2) of longitude and latitude",
            ) from error
        for line in lines:
            if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 or not np.isfinite(line).all():
                raise BergError(
                    f"a line of shape {line.shape}",
                    where="lines",
                    remedy="Give at least two points of longitude and latitude each",
                )
        if crs is None:
            return lines
        return line_strings(shapely.MultiLineString(lines), crs)
    out = []
    for feature in read_features(source, crs, lines=True):
        for single in _parts(feature.geometry):
            if single.geom_type == "Polygon":
                out += [np.asarray(ring.coords, dtype=float)[:, :2] for ring in (single.exterior, *single.interiors)]
            elif single.geom_type != "Point":
                out.append(np.asarray(single.coords, dtype=float)[:, :2])
    return out


LON_NAMES = ("lon", "longitude", "long", "x", "easting")
LAT_NAMES = ("lat", "latitude", "y", "northing")
FEATURE_COLUMNS = ("date", "time", "id", "name", "feature", "fragment", "variable")
RING_COLUMNS = ("ring", "part", "polygon")
LINE_COLUMNS = ("line", "rift", "segment")
"""Columns that part the vertices of rifts into lines, besides those of features and rings."""

Points = list[tuple[float, float]]


def read_csv_features(path: Path, *, lines: bool = False) -> list[Feature]:
    """Return the features of a table of vertices, one row each."""
    rows, separator = read_csv_rows(path, BergError)
    columns = {(name or "").strip().lower(): name for name in (rows[0] if rows else {})}
    lon, lat = (next((columns[n] for n in names if n in columns), None) for names in (LON_NAMES, LAT_NAMES))
    if lon is None or lat is None:
        raise BergError(
            f"no columns of longitude and latitude among {', '.join(columns) or 'none'}",
            where=str(path),
            remedy="Name them lon and lat in the first line",
        )
    keys = [columns[n] for n in FEATURE_COLUMNS if n in columns]
    ring_columns = [columns[n] for n in (*RING_COLUMNS, *(LINE_COLUMNS if lines else ())) if n in columns]
    groups: dict[tuple[str, ...], dict[tuple[str, ...], Points]] = {}
    for number, row in enumerate(rows, start=2):
        try:
            point = (_read_number(row[lon], separator), _read_number(row[lat], separator))
        except (TypeError, ValueError, AttributeError) as error:
            raise BergError(
                f"{value_shown(row[lon])}, {value_shown(row[lat])} are not numbers",
                where=f"{path}, line {number}",
                remedy="Write decimal degrees",
            ) from error
        key, ring_key = tuple(row[k] for k in keys), tuple(row[k] for k in ring_columns)
        groups.setdefault(key, {}).setdefault(ring_key, []).append(point)
    combined = _combine_lines if lines else _combine_rings
    return [Feature(combined(list(g.values()), path), dict(zip(keys, key, strict=True))) for key, g in groups.items()]


def read_points(path: Path) -> dict[str, Floats]:
    """Return ``lon`` and ``lat`` (degrees; m of bergs in metres), ``length``, ``width`` and ``thickness`` (m) of a table.

    Raises
    ------
    BergError
        If there is no place in it, or a number is none.
    """
    rows, separator = read_csv_rows(path, BergError)
    columns = {(name or "").strip().lower(): name for name in (rows[0] if rows else {})}
    names = {"lon": LON_NAMES, "lat": LAT_NAMES, **{size: (size,) for size in ("length", "width", "thickness")}}
    read = {key: next((columns[n] for n in spellings if n in columns), None) for key, spellings in names.items()}
    if read["lon"] is None or read["lat"] is None:
        raise BergError(
            f"no columns of longitude and latitude among {', '.join(columns) or 'none'}", where=str(path),
            remedy="Name them lon and lat in the first line; length, width and thickness may follow",
        )  # fmt: skip
    table: dict[str, list[float]] = {key: [] for key, column in read.items() if column is not None}
    for number, row in enumerate(rows, start=2):
        for key, values in table.items():
            text = row[str(read[key])]
            try:
                values.append(_read_number(text, separator))
            except (TypeError, ValueError, AttributeError) as error:
                raise BergError(
                    f"the {key} {value_shown(text)} is no number", where=f"{path}, line {number}",
                    remedy="Write decimal degrees, and sizes in metres without a unit",
                ) from error  # fmt: skip
    return {key: np.array(values) for key, values in table.items()}


def _read_number(text: str, separator: str) -> float:
    """Return a number; where commas do not separate columns they may stand for the decimal point."""
    return float(text if separator == "," else text.replace(",", "."))


def whole_polygons(rings: list[Points], path: Path) -> list[Any]:
    """Return the polygons of the rings of one outline: a ring inside of another is a hole, seams are closed."""
    return _polygons(close_seams([Feature(_combine_rings(rings, path))])[0].geometry)


def _combine_rings(rings: list[Points], path: Path) -> Any:
    """Combine rings by the even-odd rule, so that a ring inside a ring is a hole."""
    geometry: Any = None
    for ring in rings:
        area = polygon(ring, [], str(path))
        if geometry is not None and not (area.is_valid and geometry.is_valid):
            raise BergError("a ring crosses itself", where=str(path), remedy="Repair the ring or leave it out")
        geometry = area if geometry is None else geometry.symmetric_difference(area)
    return geometry


def _combine_lines(lines: list[Points], path: Path) -> Any:
    for line in lines:
        if len(line) < 2:
            raise BergError(
                "a line of 1 vertex",
                where=str(path),
                remedy="A line needs at least 2 rows; rows of a line are alike in "
                + ", ".join((*FEATURE_COLUMNS, *RING_COLUMNS, *LINE_COLUMNS)),
            )
        if not np.isfinite(line).all():
            raise BergError("vertices that are not numbers", where=str(path), remedy="Remove them")
    return shapely.MultiLineString(lines)


def read_kml_features(path: Path) -> list[Feature]:
    """Return the placemarks of a file that are polygons or lines."""
    try:
        if path.suffix.lower() == ".kmz":
            names = check_archive(path, MOST_TEXT, remedy="Export the outline again as KML", kind=BergError)
            kml_files = [n for n in names if n.lower().endswith(".kml")]
            inside = [n for n in kml_files if n.lower() == "doc.kml"] or kml_files
            if len(inside) != 1:
                problem = f"an archive of {len(kml_files)} KML files" if kml_files else "an archive without KML"
                remedy = "Unzip it and name one of them" if kml_files else "Export the outline again as KML"
                raise BergError(
                    f"{problem}; it holds {', '.join((kml_files or names)[:5])}", where=str(path), remedy=remedy
                )
            with zipfile.ZipFile(path) as archive:
                text = archive.read(inside[0])
        else:
            text = path.read_bytes()
        if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
            raise BergError("a document type or entities, which KML has not", where=str(path), remedy="Remove them")
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, zipfile.BadZipFile, ValueError, LookupError, RuntimeError) as error:
        raise BergError(
            f"not KML{line_of_fault(error)}", where=str(path), remedy="Export the outline again as KML"
        ) from error
    return list(_placemarks(root, {}, str(path)))


def _tag(node: ElementTree.Element) -> str:
    return node.tag.rpartition("}")[2]


def _placemarks(node: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    """Yield the placemarks below a node; the name and the time of a folder hold for its placemarks."""
    for child in node:
        if _tag(child) == "Placemark":
            yield from _placemark(child, above, where)
        elif _tag(child) in ("Folder", "Document"):
            tags = [n for n in child if _tag(n) in ("name", "TimeStamp", "TimeSpan")]
            times = {_tag(n): (n.text or "").strip() for tag in tags for n in tag.iter() if _tag(n) in _KML_TOLD}
            if _tag(child) == "Folder" and times.get("name"):
                times["folder"] = times["name"]
            times.pop("name", None)
            yield from _placemarks(child, {**above, **times}, where)


_KML_TOLD = ("name", "when", "begin")


def _placemark(mark: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    # Name, time and the attributes that other programs keep as extended data.
    attributes: dict[str, Any] = {}
    for node in mark.iter():
        text = (node.text or "").strip()
        if _tag(node) in _KML_TOLD or (node in list(mark) and _tag(node) == "description"):
            attributes[_tag(node)] = text
        elif _tag(node) == "SimpleData":
            attributes[node.get("name", "")] = text
        elif _tag(node) == "Data":
            attributes[node.get("name", "")] = next(((n.text or "").strip() for n in node if _tag(n) == "value"), "")
    properties = {**above, **attributes}
    polygons, lines = [], []
    for node in mark.iter():
        if _tag(node) == "Polygon":
            shell: list[Any] = []
            holes: list[Any] = []
            for border in node.iter():
                if _tag(border) in ("outerBoundaryIs", "innerBoundaryIs"):
                    (shell if _tag(border).startswith("outer") else holes).append(_points(border, where))
            polygons.append(polygon(shell[0] if shell else [], holes, where))
        elif _tag(node) == "LineString":
            points = _points(node, where)
            if len(points) < 2:
                raise BergError(f"a line of {len(points)} vertices", where=where, remedy="A line needs at least 2")
            lines.append(shapely.LineString(points))
    if polygons:
        yield Feature(polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons), properties)
    if lines:
        yield Feature(lines[0] if len(lines) == 1 else shapely.MultiLineString(lines), properties)


def _points(node: ElementTree.Element, where: str) -> list[tuple[float, float]]:
    """Return the vertices of a ring or line.

    KML parts vertices by white space and the numbers of one by commas alone. Hand-made files also have a space after
    the comma; they are read where two or three numbers to a vertex remain.
    """
    text = next((n.text or "" for n in node.iter() if _tag(n) == "coordinates"), "")
    for written in (text, re.sub(r"\s*,\s*", ",", text)):
        try:
            vertices = [[float(word) for word in point.rstrip(",").split(",")] for point in written.split()]
        except ValueError:
            continue
        if all(len(vertex) in (2, 3) for vertex in vertices):
            return [(vertex[0], vertex[1]) for vertex in vertices]
    raise BergError(
        f"coordinates that cannot be read: '{text.strip()[:60]}'",
        where=where,
        remedy="Write longitude,latitude without a space after the comma, and a space between vertices",
    )
