"""Observations of a berg: outlines from images, or positions and sizes from tracks; columns are known by their names.

Outlines come as GeoJSON (polygons with a property ``date``), as CSV with one vertex per row (``date``, ``vertex``,
``lat``, ``lon``, optionally ``berg``), as KML or shapefile, or as gridded masks in NetCDF. Positions come as CSV: the
tracks of BYU and NIC (``<sensor>_1`` latitude, ``<sensor>_2`` longitude, ``<sensor>_3`` 1 where observed, date as
YYYYDDD; or ``<sensor>_lat``, ``<sensor>_lon``, ``<sensor>_observed``), or any table with ``lat`` and ``lon`` or
``centroid_lat`` and ``centroid_lon``, such as the weekly ones of the US National Ice Center (``Iceberg``, ``Latitude``,
``Longitude``, ``Last Update``). Both list axes in nautical miles. Commas, semicolons or tabs separate the columns. Their
order does not matter, and those not known are left alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import product
from pathlib import Path
from typing import Any, Final

from riftberg.bergs.outline import DATE_KEYS, NAMES, RING_COLUMNS, whole_polygons
from riftberg.config.values import parse_date
from riftberg.diagnostics.outlines import (
    NoBergError,
    Outline,
    checked_ring,
    find_attribute_date,
    read_drawing,
    read_grid_outlines,
)
from riftberg.errors import InputError, nearest
from riftberg.state import Floats
from riftberg.system.input_files import check_file, is_seen, read_csv_rows, reading, value_shown

SENSORS: Final = ("ascat", "qscat", "oscat", "seawinds", "ers", "nscat", "sass", "nic")
"""Sources of positions in the BYU/NIC tables, the ones preferred first; NIC positions are given once a week."""

_DRAWINGS: Final = (".geojson", ".json", ".kml", ".kmz", ".shp", ".zip")
_GRIDS: Final = (".nc", ".nc4", ".cdf")
_TABLES: Final = (".csv", ".txt", "")

KINDS: Final = (*_DRAWINGS, *_GRIDS, ".csv")
"""Endings of the files that can be read."""

_UPDATED: Final = ("last update", "last_update")
"""Columns of the US National Ice Center, with dates as month/day/year."""

_DATES: Final = (*DATE_KEYS, "day", *_UPDATED)
_WHEN: Final = {*_DATES, *(key.replace("date", "time") for key in DATE_KEYS)}
_VERTEX: Final = ("vertex", "vertex_index", "point", "order")
_SIZES: Final = (("size_1", "size_2"), ("length (nm)", "width (nm)"))
_PLAIN: Final = (("centroid_lat", "centroid_lon"), *product(("lat", "latitude"), ("lon", "longitude", "long")))


@dataclass(frozen=True)
class Fix:
    """One position."""

    name: str  # As in `Outline`
    when: datetime  # As in `Outline`
    day_only: bool  # As in `Outline`
    lon: float  # Degrees
    lat: float  # Degrees
    azimuth: float = math.nan  # Long axis, degrees clockwise from north, 0 to 180; NaN where not given
    area: float = math.nan  # m2; NaN where not given
    interpolated: bool = False  # The table says that nobody saw the berg that day
    sensor: str = ""  # Name of the instrument, or of the model
    axes: tuple[float, float] | None = None  # m; of NIC


@dataclass(frozen=True)
class Observations:
    """Outlines and positions of a file."""

    source: str
    outlines: list[Outline] = field(default_factory=list)
    fixes: list[Fix] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)  # Entries of the file that were left out, and why

    def rings_by_day(self) -> dict[str, list[Floats]]:
        """Return the outlines by ISO day, as maps take them."""
        days: dict[str, list[Floats]] = {}
        for outline in self.outlines:
            days.setdefault(outline.when.date().isoformat(), []).append(outline.ring)
        return days


def read_observed(path: str | Path, *, date: str | None = None, variable: str | None = None) -> Observations:
    """Read outlines or positions."""
    if (trajectories := _trajectories(path)) is not None:
        return trajectories
    path = check_file(path, most=_MOST, remedy=f"Name a file {', '.join(KINDS)}")
    with reading(path, "no observations that can be read", f"Give outlines or positions: {', '.join(KINDS)}"):
        kind = path.suffix.lower()
        if kind in _DRAWINGS:
            return _collect_outlines(path, read_drawing(path, date))
        if kind in _GRIDS:
            return _collect_outlines(path, read_grid_outlines(path, date, variable))
        if kind not in _TABLES:
            raise InputError(
                f"unknown kind of file {kind!r}", where=str(path), remedy=f"Name a file {', '.join(KINDS)}"
            )
        table = read_csv_rows(path)[0]
        names = {k: str(k).strip().lower() for k in (table[0] if table else ()) if k is not None}
        rows = [{name: row[k].strip() for k, name in names.items() if row[k] is not None} for row in table]
        if not rows:
            raise InputError("no rows", where=str(path), remedy="A table needs a line of names and rows below")
        dated = next((name for name in _DATES if name in rows[0]), "")
        if not dated:
            raise _unknown(path, rows[0], "no column of dates")
        if any(name in rows[0] for name in _VERTEX):
            return _collect_outlines(path, _vertices(path, rows, dated))
        unseen: list[str] = []
        once = {(f.name, f.when, f.lon, f.lat, f.interpolated): f for f in _fixes(path, rows, dated, unseen)}
        fixes = list(once.values())
        others = f", and {len(unseen) - 1} more" if len(unseen) > 1 else ""
        if not fixes:
            raise InputError(
                "no position that is a number", where=str(path), remedy="Give latitude and longitude in degrees"
            )
        return Observations(path.name, [], fixes, [f"left out {unseen[0]}{others}"] if unseen else [])


def _trajectories(path: str | Path) -> Observations | None:
    """Return the positions of a trajectory file of OpenDrift or TrajAn, a name for each trajectory; None of another file."""
    if ".nc" not in str(path):
        return None
    from riftberg.runs.opendrift import file_and_number, trajectories_if_any

    trajectories, file = trajectories_if_any(path), file_and_number(path)[0]
    if trajectories is None:
        return None
    fixes = [
        Fix(f"{file.stem} {trajectory.number}" if len(trajectories) > 1 else file.stem, when, False, *position,
            sensor=trajectory.program)
        for trajectory in trajectories for when, position in trajectory.observed().items()
    ]  # fmt: skip
    return Observations(file.name, [], fixes)


_MOST: Final = 2**31
"""Bytes of a file of observations, grids among them."""


def _unknown(path: Path, row: Mapping[str, str], problem: str) -> InputError:
    return InputError(
        problem,
        where=str(path),
        remedy=f"It has {', '.join(row)}; needed are date (or Last Update) and lat, lon (tracks), and vertex (outlines)",
    )


def _collect_outlines(path: Path, outlines: Iterable[Outline | NoBergError]) -> Observations:
    """Return the observations in the outlines of a file, without impossible outlines and those given twice on their day."""
    unique: dict[tuple[Any, ...], Outline] = {}
    faults = []
    for outline in outlines:
        if isinstance(outline, NoBergError):
            faults.append(outline)
        else:
            unique.setdefault((outline.when, outline.ring.shape, outline.ring.tobytes()), outline)
    if faults and not unique:
        raise faults[0]
    others = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
    return Observations(path.name, list(unique.values()), [], [f"left out {faults[0]}{others}"] if faults else [])


def _vertices(path: Path, rows: list[dict[str, str]], date: str) -> Iterator[Outline | NoBergError]:
    lat, lon = _plain_columns(path, rows[0])
    name, vertex, ring_column = (
        next((n for n in names if n in rows[0]), "") for names in (NAMES, _VERTEX, RING_COLUMNS)
    )
    groups: dict[tuple[tuple[tuple[str, str], ...], str], dict[str, list[Corner]]] = {}
    for number, row in enumerate(rows):
        dates = tuple((column, text) for column, text in row.items() if column in _WHEN)
        rings = groups.setdefault((dates, row.get(name, "")), {})
        rings.setdefault(row.get(ring_column, ""), []).append(
            (row.get(vertex, ""), _read_row_number(row, lon, path, number), _read_row_number(row, lat, path, number))
        )
    for (dates, berg), rings in groups.items():
        when, day_only = _read_row_date(dict(dates), date, str(path))
        day = dict(dates).get(date, "")
        where = f"{path}, {' '.join(filter(None, [day, berg]))}"
        drawn: list[Any] = [_sort_corners(corners, where) for corners in rings.values()]
        if len(drawn) > 1:
            drawn = [area.exterior.coords for area in whole_polygons(drawn, path)]
        for points in drawn:
            try:
                yield Outline(berg, when, day_only, checked_ring(points, where))
            except NoBergError as fault:  # another one may be meant
                yield fault


Corner = tuple[str, float, float]
"""Number of a corner as written, longitude and latitude."""


def _sort_corners(corners: list[Corner], where: str) -> list[tuple[float, float]]:
    """Return the positions of corners in the order of their numbers; without numbers in the order of the file."""
    corners = list(dict.fromkeys(corners))  # a row that stands twice, as the one that closes the ring
    try:
        numbers = [float(number) for number, _, _ in corners]
    except ValueError:
        return [(lon, lat) for _, lon, lat in corners]
    if len(set(numbers)) < len(numbers):
        raise InputError(
            "two corners of one outline have the same number", where=where,
            remedy="Number them in their order; several outlines of a date need a column 'berg'",
        )  # fmt: skip
    return [(lon, lat) for _, (_, lon, lat) in sorted(zip(numbers, corners, strict=True))]


def _read_row_date(row: Mapping[str, str], column: str, where: str) -> tuple[datetime, bool]:
    """Read a date; only in a column of the US National Ice Center is ``12/10/2020`` known to be the tenth of December."""
    text = row.get(column, "")
    if column in DATE_KEYS and text and (dated := find_attribute_date(row, where=where)) is not None:
        return dated
    if column not in _UPDATED or not re.fullmatch(r"\d\d?/\d\d?/\d{4}", text):
        return parse_date(text, where=where)
    try:
        return datetime.strptime(text, "%m/%d/%Y"), True
    except ValueError as error:
        raise InputError(f"{text!r} is no date of the form month/day/year", where=where) from error


def _plain_columns(path: Path, row: Mapping[str, str]) -> tuple[str, str]:
    for lat, lon in _PLAIN:
        if lat in row and lon in row:
            return lat, lon
    raise _unknown(path, row, "no columns of latitude and longitude")


def _read_row_number(row: Mapping[str, str], column: str, path: Path, number: int) -> float:
    text = row.get(column, "")
    try:
        return float(text) if text else math.nan
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} is not a number", where=f"{path}, line {number + 2}, {column}",
            remedy="Give a decimal number, or leave it empty",
        ) from error  # fmt: skip


def _fixes(path: Path, rows: list[dict[str, str]], date: str, unseen: list[str]) -> Iterator[Fix]:
    """Yield the positions of a table; rows that say by a number that there is none are added to ``unseen``."""
    columns = ("_1", "_2", "_3"), ("_lat", "_lon", "_observed")  # latitude, longitude and flag of a sensor
    sensors = [
        (sensor + lat, sensor + lon, sensor + flag)
        for sensor in SENSORS for lat, lon, flag in columns if {sensor + lat, sensor + lon} <= rows[0].keys()
    ]  # fmt: skip
    plain = None if sensors else _plain_columns(path, rows[0])
    listed = next(
        (pair for pair in _SIZES if set(pair) <= rows[0].keys()), ("", "")
    )  # a column of no name reads as NaN
    name = next((n for n in NAMES if n in rows[0]), "")
    azimuth = min((c for c in rows[0] if "azimuth" in c), key=len, default="")  # not the column of its error
    for number, row in enumerate(rows):
        where = f"{path}, line {number + 2}"
        when, day_only = _read_row_date(row, date, where)
        if plain:
            lat, lon = (_read_row_number(row, column, path, number) for column in plain)
            interpolated, sensor = False, "nic" if date in _UPDATED else path.name
        else:
            lat, lon, interpolated, sensor = _best_sensor(row, sensors, path, number)
        if not is_seen(lon, lat):
            if math.isfinite(lat) and math.isfinite(lon):
                unseen.append(f"{where}: latitude {lat:g}, longitude {lon:g} stand for a berg that was not seen")
            continue
        if abs(lat) > 90.0 or abs(lon) > 540.0:
            raise InputError(
                f"latitude {lat:g}, longitude {lon:g} are no place on Earth", where=where, remedy="Give decimal degrees"
            )
        area = _read_row_number(row, "area_km2", path, number) * 1e6
        if area <= 0.0 or math.isinf(area):
            raise InputError(
                f"an area of {area / 1e6:g} km2", where=where, remedy="Leave it empty where it is not known"
            )
        length, width = (_read_row_number(row, column, path, number) for column in listed)
        yield Fix(
            row.get(name) or path.stem.upper(), when, day_only, lon, lat,
            _read_row_number(row, azimuth, path, number) % 180.0 if azimuth else math.nan, area, interpolated, sensor,
            _axes_in_metres(length, width, where),
        )  # fmt: skip


def _best_sensor(
    row: Mapping[str, str], sensors: list[tuple[str, str, str]], path: Path, number: int
) -> tuple[float, float, bool, str]:
    """Return the position of the first sensor that saw the berg, else the first interpolated one, and the sensor."""
    second = math.nan, math.nan, True, ""
    for lat_name, lon_name, flag in sensors:
        lat, lon = _read_row_number(row, lat_name, path, number), _read_row_number(row, lon_name, path, number)
        if not is_seen(lon, lat):
            continue
        if row.get(flag, "1") in ("1", "1.0", ""):
            return lat, lon, False, lat_name.partition("_")[0]
        if not math.isfinite(second[0]):
            second = lat, lon, True, lat_name.partition("_")[0]
    return second


NAUTICAL_MILE: Final = 1852.0  # m

LONGEST: Final = 500e3
"""Axis (m) that no berg has: the longest ever listed, B15, had 295 km."""


def _axes_in_metres(length: float, width: float, where: str) -> tuple[float, float] | None:
    """Return the axes in m of those that are listed in nautical miles; None where none are."""
    if not min(length, width) > 0.0:
        return None
    if max(length, width) * NAUTICAL_MILE > LONGEST:
        raise InputError(
            f"axes of {length:g} and {width:g} nautical miles: no berg is that large", where=where,
            remedy="Give them in nautical miles",
        )  # fmt: skip
    return length * NAUTICAL_MILE, width * NAUTICAL_MILE


def read_berg(berg: str, folder: str | Path) -> list[Fix]:
    """Return the fixes of a berg in a folder of tables: in a table of its own (BYU), or in the rows with its name."""
    folder, name = Path(folder), berg.strip().lower()
    berg_table = folder / f"{name}.csv"
    if berg_table.is_file():
        return read_observed(berg_table).fixes
    tables = sorted(folder.glob("*.csv")) + sorted(folder.glob("DownloadCurrent*"))
    name_tables = []  # with a column of names
    for path in tables:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            if "iceberg" in file.readline().lower():
                name_tables.append(path)
    fixes = [fix for path in name_tables for fix in read_observed(path).fixes if fix.name.lower() == name]
    if not fixes:
        stems = sorted({path.stem for path in tables if path not in name_tables})
        raise InputError(
            f"no berg {berg!r} in {len(tables)} tables" if tables else "no tables of bergs",
            where=str(folder),
            remedy=f"{nearest(name, stems)}'riftberg fetch byu' or 'riftberg fetch usnic' gets tables",
        )
    return sorted(fixes, key=lambda fix: fix.when)


FIX_WITHIN: Final = timedelta(days=3)
SIZE_WITHIN: Final = timedelta(days=60)


@dataclass(frozen=True)
class Sighting:
    """Position and size of a berg nearest to a date."""

    fix: Fix
    size: Fix | None  # With its axes


def find_sighting(berg: str, fixes: list[Fix], date: datetime, *, sized: bool = True) -> Sighting:
    """Return the fix and, if ``sized``, the size nearest to a date, or say which the nearest are."""
    seen, sizes = [s for s in fixes if not s.interpolated], [s for s in fixes if s.axes is not None]
    if not seen:
        raise InputError(
            f"no position of {berg} was seen; all are interpolated", where=f"new {berg}", remedy="Name another berg"
        )
    fix = min(seen, key=lambda s: abs(s.when - date))
    if abs(fix.when - date) > FIX_WITHIN:
        nearest = [max((s for s in seen if s.when <= date), key=lambda s: s.when, default=None),
                min((s for s in seen if s.when > date), key=lambda s: s.when, default=None)]  # fmt: skip
        dates_text = " and ".join(f"{s.when:%Y-%m-%d}" for s in nearest if s)
        raise InputError(
            f"{berg} was not seen within {FIX_WITHIN.days} days of {date:%Y-%m-%d}",
            where="--date",
            remedy=f"The nearest dates are {dates_text}",
        )
    # Later break-ups make a berg smaller: the last size before the date counts, then the next one.
    size = min(
        sizes, key=lambda s: (not timedelta(0) <= date - s.when <= SIZE_WITHIN, abs(s.when - date)), default=None
    )
    if sized and (size is None or abs(size.when - date) > SIZE_WITHIN):
        when = "none is listed at all"
        if size is not None and size.axes is not None:
            axes = " x ".join(f"{axis / 1e3:.0f} km" for axis in size.axes)
            when = f"the nearest is of {size.when:%Y-%m-%d}: {axes}"
        raise InputError(
            f"no size of {berg} within {SIZE_WITHIN.days} days of {date:%Y-%m-%d}; {when}", where="--date",
            remedy="Give --size 'LENGTH,WIDTH', such as --size '60 km,30 km', or --outline FILE",
        )  # fmt: skip
    return Sighting(fix, size)
