"""Outlines of bergs, and lines of rifts, from GeoJSON, shapefile, CSV, KML or geometry objects.

Needs the optional packages of the extra ``outline`` (shapely; pyproj for projected coordinates; pyshp for shapefiles).
They are imported when first used.
"""

from __future__ import annotations

import csv
import importlib
import json
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from riftberg.errors import BergError, RiftbergError

LON_NAMES = ("lon", "longitude", "long", "x", "easting")
LAT_NAMES = ("lat", "latitude", "y", "northing")
FEATURE_COLUMNS = ("date", "time", "id", "name", "feature", "fragment", "variable")
RING_COLUMNS = ("ring", "part", "polygon")
DATE_KEYS = (
    "date", "datetime", "date_time", "when", "timestamp", "begin", "acquired", "acq_date", "acqdate", "img_date",
    "image_date", "obs_date", "sensing", "time_coverage_start", "time",
)  # fmt: skip
"""Attributes that hold the date of an outline, best first; small and capital letters are alike."""
_WGS84 = ("CRS84", "EPSG::4326", "EPSG:4326", "OGC:CRS84")


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

    def label(self) -> str:
        """Return date and other short properties, for messages."""
        return ", ".join(f"{k}={v}" for k, v in self.properties.items() if len(str(v)) < 40) or "no properties"


def needed(module: str) -> Any:
    """Import an optional package or say which extra holds it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RiftbergError(
            f"{module.split('.')[0]} is not installed but outlines need it: pip install 'riftberg[outline]'"
        ) from error


def read_features(source: Any, crs: str | None = None) -> list[Feature]:
    """Read all features of a file or object.

    Parameters
    ----------
    source : path, geometry, dict or array_like
        ``.geojson``/``.json``, ``.shp``/``.zip``, ``.csv``/``.txt``, ``.kml``/``.kmz``; or a shapely geometry (anything
        with ``__geo_interface__``), a GeoJSON dictionary, or an array of shape (n, 2) of longitude and latitude.
    crs : str, optional
        Coordinate system of the coordinates where the file does not say it, for example ``"EPSG:3031"``.

    Raises
    ------
    BergError
        If the file is missing, of an unknown kind or holds no geometry.
    """
    where = str(source) if isinstance(source, str | Path) else type(source).__name__
    features, found = _read(source)
    crs = crs or found
    if crs and not any(name in crs for name in _WGS84):
        features = [Feature(_to_lonlat(f.geometry, crs, where), f.properties) for f in features]
    if not features:
        raise BergError("no geometry found", where=where, remedy="Give a file that holds at least one polygon or line")
    return features


def _read(source: Any) -> tuple[list[Feature], str | None]:
    if isinstance(source, str | Path):
        path = Path(source)
        if not path.exists():
            raise BergError("file not found", where=str(path), remedy="Check the path")
        reader = _READERS.get(path.suffix.lower())
        if reader is None:
            raise BergError(
                f"unknown kind of file '{path.suffix}'",
                where=str(path),
                remedy=f"Use one of {', '.join(sorted(_READERS))}",
            )
        return reader(path)  # type: ignore[no-any-return]
    if hasattr(source, "__geo_interface__"):
        return _from_geojson(dict(source.__geo_interface__))
    if isinstance(source, dict):
        return _from_geojson(source)
    return [Feature(_polygon(np.asarray(source, dtype=float), [], "array of vertices"))], None


def _polygon(shell: Any, holes: list[Any], where: str) -> Any:
    shell = np.asarray(shell, dtype=float)
    if shell.ndim != 2 or shell.shape[1] < 2 or len(shell) < 3:
        raise BergError(
            f"a ring of shape {shell.shape}",
            where=where,
            remedy="A ring needs at least 3 vertices of longitude and latitude",
        )
    if not all(np.isfinite(np.asarray(ring, dtype=float)).all() for ring in (shell, *holes)):
        raise BergError("vertices that are not numbers", where=where, remedy="Remove them")
    return needed("shapely").Polygon(shell[:, :2], [np.asarray(h, dtype=float)[:, :2] for h in holes])


def _from_geojson(data: dict[str, Any], where: str = "GeoJSON") -> tuple[list[Feature], str | None]:
    shape = needed("shapely.geometry").shape
    crs = ((data.get("crs") or {}).get("properties") or {}).get("name")
    if data.get("type") == "FeatureCollection":
        items = [(f.get("geometry"), f.get("properties") or {}) for f in data.get("features", [])]
    elif data.get("type") == "Feature":
        items = [(data.get("geometry"), data.get("properties") or {})]
    else:
        items = [(data, {})]
    try:
        return [Feature(shape(g), dict(p)) for g, p in items if g and g.get("coordinates")], crs
    except (KeyError, TypeError, ValueError, AttributeError, needed("shapely.errors").ShapelyError) as error:
        raise BergError(
            f"not a GeoJSON geometry ({error})", where=where, remedy="Write GeoJSON as in RFC 7946"
        ) from error


def _from_geojson_file(path: Path) -> tuple[list[Feature], str | None]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BergError(f"not JSON ({error})", where=str(path), remedy="Write GeoJSON as in RFC 7946") from error
    if not isinstance(data, dict):
        raise BergError("no GeoJSON object", where=str(path), remedy="Write GeoJSON as in RFC 7946")
    return _from_geojson(data, str(path))


def _from_shapefile(path: Path) -> tuple[list[Feature], str | None]:
    shape = needed("shapely.geometry").shape
    crs = _projection(path)
    with needed("shapefile").Reader(str(path)) as reader:
        features = [
            Feature(shape(item.shape.__geo_interface__), dict(item.record.as_dict()))
            for item in reader.iterShapeRecords()
            if item.shape.shapeType != 0
        ]
    geographic = crs is not None and crs.lstrip().upper().startswith(("GEOGCS", "GEOGCRS"))
    return features, None if geographic else crs


def _projection(path: Path) -> str | None:
    """Return the content of the .prj file beside a shapefile, or in its zip archive."""
    if path.suffix.lower() == ".zip":
        with zipfile.ZipFile(path) as archive:
            name = next((n for n in archive.namelist() if n.lower().endswith(".prj")), None)
            return archive.read(name).decode() if name else None
    beside = path.with_suffix(".prj")
    return beside.read_text() if beside.exists() else None


def _from_csv(path: Path) -> tuple[list[Feature], str | None]:
    text = path.read_text(encoding="utf-8-sig")
    header = text.partition("\n")[0]
    separator = max(",;\t", key=header.count)
    lines = [line for line in text.splitlines() if line.strip(" ,;\t")]
    rows = list(csv.DictReader(lines, delimiter=separator))
    columns = {(name or "").strip().lower(): name for name in (rows[0] if rows else {})}
    lon, lat = (next((columns[n] for n in names if n in columns), None) for names in (LON_NAMES, LAT_NAMES))
    if lon is None or lat is None:
        raise BergError(
            f"no columns of longitude and latitude among {', '.join(columns) or 'none'}",
            where=str(path),
            remedy="Name them lon and lat in the first line",
        )
    keys = [columns[n] for n in FEATURE_COLUMNS if n in columns]
    parts = [columns[n] for n in RING_COLUMNS if n in columns]
    groups: dict[tuple[str, ...], dict[tuple[str, ...], list[tuple[float, float]]]] = {}
    for number, row in enumerate(rows, start=2):
        try:
            point = (float(row[lon]), float(row[lat]))
        except (TypeError, ValueError) as error:
            raise BergError(
                f"'{row[lon]}', '{row[lat]}' are not numbers",
                where=f"{path}, line {number}",
                remedy="Write decimal degrees",
            ) from error
        key, part = tuple(row[k] for k in keys), tuple(row[k] for k in parts)
        groups.setdefault(key, {}).setdefault(part, []).append(point)
    return [Feature(_rings(g.values(), path), dict(zip(keys, key, strict=True))) for key, g in groups.items()], None


def _rings(rings: Iterable[list[tuple[float, float]]], path: Path) -> Any:
    """Combine rings by the even-odd rule, so that a ring inside a ring is a hole."""
    geometry: Any = None
    for ring in rings:
        polygon = _polygon(ring, [], str(path))
        if geometry is not None and not (polygon.is_valid and geometry.is_valid):
            raise BergError("a ring crosses itself", where=str(path), remedy="Repair the ring or leave it out")
        geometry = polygon if geometry is None else geometry.symmetric_difference(polygon)
    return geometry


def _from_kml(path: Path) -> tuple[list[Feature], str | None]:
    try:
        if path.suffix.lower() == ".kmz":
            with zipfile.ZipFile(path) as archive:
                text = archive.read(next(n for n in archive.namelist() if n.lower().endswith(".kml")))
        else:
            text = path.read_bytes()
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, zipfile.BadZipFile, StopIteration) as error:
        raise BergError(f"not KML ({error})", where=str(path), remedy="Export the outline again as KML") from error
    return list(_placemarks(root, {}, str(path))), None


def _tag(node: ElementTree.Element) -> str:
    return node.tag.rpartition("}")[2]


def _placemarks(node: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    """Yield the placemarks below a node; the name and the time of a folder hold for what lies in it."""
    for child in node:
        if _tag(child) == "Placemark":
            yield from _placemark(child, above, where)
        elif _tag(child) in ("Folder", "Document"):
            own = [n for n in child if _tag(n) in ("name", "TimeStamp", "TimeSpan")]
            told = {_tag(n): (n.text or "").strip() for part in own for n in part.iter() if _tag(n) in _KML_TOLD}
            if _tag(child) == "Folder" and told.get("name"):
                told["folder"] = told["name"]
            told.pop("name", None)
            yield from _placemarks(child, {**above, **told}, where)


_KML_TOLD = ("name", "when", "begin")


def _kml_properties(mark: ElementTree.Element) -> dict[str, Any]:
    """Return name, time and the attributes that other programs keep as extended data."""
    told: dict[str, Any] = {}
    for node in mark.iter():
        text = (node.text or "").strip()
        if _tag(node) in _KML_TOLD or (node in list(mark) and _tag(node) == "description"):
            told[_tag(node)] = text
        elif _tag(node) == "SimpleData":
            told[node.get("name", "")] = text
        elif _tag(node) == "Data":
            told[node.get("name", "")] = next(((n.text or "").strip() for n in node if _tag(n) == "value"), "")
    return told


def _placemark(mark: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    shapely = needed("shapely")
    properties = {**above, **_kml_properties(mark)}
    polygons, lines = [], []
    for node in mark.iter():
        if _tag(node) == "Polygon":
            shell: list[Any] = []
            holes: list[Any] = []
            for border in node.iter():
                if _tag(border) in ("outerBoundaryIs", "innerBoundaryIs"):
                    (shell if _tag(border).startswith("outer") else holes).append(_kml_points(border))
            polygons.append(_polygon(shell[0] if shell else [], holes, where))
        elif _tag(node) == "LineString":
            lines.append(shapely.LineString(_kml_points(node)))
    if polygons:
        yield Feature(polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons), properties)
    if lines:
        yield Feature(lines[0] if len(lines) == 1 else shapely.MultiLineString(lines), properties)


def _kml_points(node: ElementTree.Element) -> list[tuple[float, float]]:
    text = next((n.text or "" for n in node.iter() if _tag(n) == "coordinates"), "")
    return [(float(lon), float(lat)) for lon, lat, *_ in (point.split(",") for point in text.split())]


def _to_lonlat(geometry: Any, crs: str, where: str) -> Any:
    pyproj = needed("pyproj")
    try:
        transformer = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.CRSError as error:
        raise BergError(
            f"unknown coordinate system '{crs[:60]}'", where=where, remedy="Name it like EPSG:3031"
        ) from error
    return needed("shapely").transform(geometry, transformer.transform, interleaved=False)


_READERS: dict[str, Any] = {
    ".geojson": _from_geojson_file,
    ".json": _from_geojson_file,
    ".shp": _from_shapefile,
    ".zip": _from_shapefile,
    ".csv": _from_csv,
    ".txt": _from_csv,
    ".kml": _from_kml,
    ".kmz": _from_kml,
}


def select_outline(
    features: list[Feature], *, where: str, feature: int | str | None = None, date: str | None = None
) -> Feature:
    """Choose the one polygon feature that is meant.

    Parameters
    ----------
    features : list of Feature
        As read.
    where : str
        File, for messages.
    feature : int or str, optional
        Number (from 0) among the polygons, or the value of any of its properties (such as its name).
    date : str, optional
        Date; compared with the start of the feature's date.
    """
    polygons = [f for f in features if f.geometry.geom_type in ("Polygon", "MultiPolygon")]
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


def check_outline(geometry: Any, *, where: str, repair: bool = False) -> Any:
    """Return the outline if it can be filled, else raise `BergError`.

    Parameters
    ----------
    geometry : shapely Polygon or MultiPolygon
        Longitude and latitude in degrees.
    where : str
        File and feature, for messages.
    repair : bool
        Mend an outline that crosses itself instead of refusing it.
    """
    shapely = needed("shapely")
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
    for ring in _ring_coordinates(geometry):
        if abs(np.diff(ring[:, 0])).max() > 180:
            raise BergError(
                "the outline jumps across the date line", where=where, remedy="Write its longitudes from 0 to 360"
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


def _ring_coordinates(geometry: Any) -> Iterator[Any]:
    for polygon in getattr(geometry, "geoms", [geometry]):
        for ring in (polygon.exterior, *polygon.interiors):
            yield np.asarray(ring.coords)


def line_strings(source: Any, crs: str | None = None) -> list[Any]:
    """Return the lines of a file, geometry or array as arrays of shape (n, 2) of longitude and latitude."""
    if isinstance(source, np.ndarray) or (isinstance(source, list | tuple) and not isinstance(source, str)):
        return _arrays(source)
    out = []
    for feature in read_features(source, crs):
        for part in getattr(feature.geometry, "geoms", [feature.geometry]):
            rings = (part.exterior, *part.interiors) if part.geom_type == "Polygon" else (part,)
            out += [np.asarray(ring.coords, dtype=float)[:, :2] for ring in rings]
    return out


def _arrays(source: Any) -> list[Any]:
    if len(source) and hasattr(source[0], "__geo_interface__"):
        return [line for item in source for line in line_strings(item)]
    nested = source if np.ndim(source[0]) == 2 else [source]
    lines = [np.asarray(line, dtype=float) for line in nested]
    for line in lines:
        if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 or not np.isfinite(line).all():
            raise BergError(
                f"a line of shape {line.shape}",
                where="lines",
                remedy="Give at least two points of longitude and latitude each",
            )
    return lines
