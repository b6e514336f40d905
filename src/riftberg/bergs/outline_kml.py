"""Outlines and lines from KML and KMZ."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import shapely

from riftberg.bergs.feature import Feature, polygon
from riftberg.errors import BergError
from riftberg.system.input_files import check_archive
from riftberg.system.limits import MOST_TEXT


def features_of_kml(path: Path) -> list[Feature]:
    """Return the placemarks of a file that are polygons or lines."""
    try:
        if path.suffix.lower() == ".kmz":
            names = check_archive(path, MOST_TEXT, remedy="Export the outline again as KML", kind=BergError)
            inside = next((n for n in names if n.lower().endswith(".kml")), None)
            if inside is None:
                raise BergError(
                    f"an archive without KML; it holds {', '.join(names[:5])}", where=str(path),
                    remedy="Export the outline again as KML",
                )  # fmt: skip
            with zipfile.ZipFile(path) as archive:
                text = archive.read(inside)
        else:
            text = path.read_bytes()
        if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
            raise BergError("a document type or entities, which KML has not", where=str(path), remedy="Remove them")
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, zipfile.BadZipFile, ValueError, LookupError, RuntimeError) as error:
        raise BergError(f"not KML ({error})", where=str(path), remedy="Export the outline again as KML") from error
    return list(_placemarks(root, {}, str(path)))


def _tag(node: ElementTree.Element) -> str:
    return node.tag.rpartition("}")[2]


def _placemarks(node: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    """Yield the placemarks below a node; the name and the time of a folder hold for what lies in it."""
    for child in node:
        if _tag(child) == "Placemark":
            yield from _placemark(child, above, where)
        elif _tag(child) in ("Folder", "Document"):
            own = [n for n in child if _tag(n) in ("name", "TimeStamp", "TimeSpan")]
            times = {_tag(n): (n.text or "").strip() for part in own for n in part.iter() if _tag(n) in _KML_TOLD}
            if _tag(child) == "Folder" and times.get("name"):
                times["folder"] = times["name"]
            times.pop("name", None)
            yield from _placemarks(child, {**above, **times}, where)


_KML_TOLD = ("name", "when", "begin")


def _kml_properties(mark: ElementTree.Element) -> dict[str, Any]:
    """Return name, time and the attributes that other programs keep as extended data."""
    attributes: dict[str, Any] = {}
    for node in mark.iter():
        text = (node.text or "").strip()
        if _tag(node) in _KML_TOLD or (node in list(mark) and _tag(node) == "description"):
            attributes[_tag(node)] = text
        elif _tag(node) == "SimpleData":
            attributes[node.get("name", "")] = text
        elif _tag(node) == "Data":
            attributes[node.get("name", "")] = next(((n.text or "").strip() for n in node if _tag(n) == "value"), "")
    return attributes


def _placemark(mark: ElementTree.Element, above: dict[str, Any], where: str) -> Iterator[Feature]:
    properties = {**above, **_kml_properties(mark)}
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
            vertices = [[float(part) for part in point.rstrip(",").split(",")] for point in written.split()]
        except ValueError:
            continue
        if all(len(vertex) in (2, 3) for vertex in vertices):
            return [(vertex[0], vertex[1]) for vertex in vertices]
    raise BergError(
        f"coordinates that cannot be read: '{text.strip()[:60]}'",
        where=where,
        remedy="Write longitude,latitude without a space after the comma, and a space between vertices",
    )
