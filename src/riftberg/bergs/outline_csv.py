"""Outlines and lines from tables of vertices (CSV)."""

from __future__ import annotations

import codecs
import csv
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from riftberg.bergs.feature import Feature, polygon
from riftberg.errors import BergError
from riftberg.system.input_files import check_file, reading, value_shown
from riftberg.system.limits import MOST_TEXT

LON_NAMES = ("lon", "longitude", "long", "x", "easting")
LAT_NAMES = ("lat", "latitude", "y", "northing")
FEATURE_COLUMNS = ("date", "time", "id", "name", "feature", "fragment", "variable")
RING_COLUMNS = ("ring", "part", "polygon")
LINE_COLUMNS = ("line", "rift", "segment")
"""Columns that part the vertices of rifts into lines, besides those of features and rings."""

Points = list[tuple[float, float]]


def features_of_csv(path: Path, *, lines: bool = False) -> list[Feature]:
    """Return the features of a table of vertices, one row each."""
    rows, separator = rows_of_csv(path)
    columns = {(name or "").strip().lower(): name for name in (rows[0] if rows else {})}
    lon, lat = (next((columns[n] for n in names if n in columns), None) for names in (LON_NAMES, LAT_NAMES))
    if lon is None or lat is None:
        raise BergError(
            f"no columns of longitude and latitude among {', '.join(columns) or 'none'}",
            where=str(path),
            remedy="Name them lon and lat in the first line",
        )
    keys = [columns[n] for n in FEATURE_COLUMNS if n in columns]
    parts = [columns[n] for n in (*RING_COLUMNS, *(LINE_COLUMNS if lines else ())) if n in columns]
    groups: dict[tuple[str, ...], dict[tuple[str, ...], Points]] = {}
    for number, row in enumerate(rows, start=2):
        try:
            point = (_number_of_text(row[lon], separator), _number_of_text(row[lat], separator))
        except (TypeError, ValueError, AttributeError) as error:
            raise BergError(
                f"{value_shown(row[lon])}, {value_shown(row[lat])} are not numbers",
                where=f"{path}, line {number}",
                remedy="Write decimal degrees",
            ) from error
        key, part = tuple(row[k] for k in keys), tuple(row[k] for k in parts)
        groups.setdefault(key, {}).setdefault(part, []).append(point)
    combined = _lines_of_rows if lines else _polygons_of_rings
    return [Feature(combined(list(g.values()), path), dict(zip(keys, key, strict=True))) for key, g in groups.items()]


def rows_of_csv(path: Path) -> tuple[list[dict[str, str]], str]:
    """Return the rows of a table by column, and its separator: comma, semicolon or tab. Empty lines are passed over."""
    check_file(path, most=MOST_TEXT, remedy=_TABLE, kind=BergError)
    lines = [line for line in _decoded(path.read_bytes()).splitlines() if line.strip(" ,;\t")]
    if any("\0" in line for line in lines[:100]):
        raise BergError("bytes that are no text", where=str(path), remedy=_TABLE)
    if len(lines) < 2:
        what = "no rows below the line of names" if lines else "no rows"
        raise BergError(what, where=str(path), remedy=_TABLE)
    separator = max(",;\t", key=lines[0].count)
    with reading(path, "no table that can be read", _TABLE, BergError):
        reader = csv.DictReader(lines, delimiter=separator)
        names = [(name or "").strip().lower() for name in reader.fieldnames or ()]
        twice = next((name for name in names if name and names.count(name) > 1), None)
        if twice is not None:
            raise BergError(f"two columns are called {twice!r}", where=str(path), remedy="Give each its own name")
        return list(reader), separator


_TABLE = "Give a table with a line of names and rows below, separated by commas, semicolons or tabs"


def _decoded(content: bytes) -> str:
    """Decode a table; programs that do not write UTF-8 write UTF-16 with a mark, or an 8-bit set (names only)."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _number_of_text(text: str, separator: str) -> float:
    """Return a number; where commas do not separate columns they may stand for the decimal point."""
    return float(text if separator == "," else text.replace(",", "."))


def _polygons_of_rings(rings: list[Points], path: Path) -> Any:
    """Combine rings by the even-odd rule, so that a ring inside a ring is a hole."""
    geometry: Any = None
    for ring in rings:
        area = polygon(ring, [], str(path))
        if geometry is not None and not (area.is_valid and geometry.is_valid):
            raise BergError("a ring crosses itself", where=str(path), remedy="Repair the ring or leave it out")
        geometry = area if geometry is None else geometry.symmetric_difference(area)
    return geometry


def _lines_of_rows(lines: list[Points], path: Path) -> Any:
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
