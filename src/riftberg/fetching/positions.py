"""Positions and sizes of named Antarctic bergs: the databases of BYU with NIC, and of the US National Ice Center.

Tables are read by the names of their columns; one whose columns are others is refused. A fix is a position that a sensor or an
analyst saw; interpolated ones are marked. Sizes are the axes that NIC lists, in nautical miles.
"""

from __future__ import annotations

import csv
import io
import math
import re
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from riftberg.errors import InputError, nearest
from riftberg.fetching.download import Progress, Resuming, fetch_one, made, progressing

NAUTICAL_MILE: Final = 1852.0  # m

LARGEST_ZIP: Final = 200e6
"""Bytes that a database may have when it is unpacked: a thousand tables have 40 MB."""


@dataclass(frozen=True)
class Source:
    """Where positions come from."""

    title: str
    base: str  # Address
    name: str  # File below it
    tried: str  # What of it has been read here


SOURCES: Final = {
    "byu": Source(
        "BYU/NIC consolidated database (Budge and Long 2018)", "https://www.scp.byu.edu/data/iceberg/",
        "consolidated_database_v8.0.zip", "version 5 was read; version 8, which is fetched, was not tried",
    ),
    "usnic": Source(
        "US National Ice Center, current week", "https://usicecenter.gov/File/", "DownloadCurrent?pId=134", "not tried"
    ),
}  # fmt: skip
"""Sources by the name that ``riftberg fetch`` takes."""

SENSORS: Final = ("ascat", "qscat", "oscat", "seawinds", "ers", "nscat", "sass", "nic")
"""Sensors of the BYU tables, the ones preferred first."""

LONGEST: Final = 500e3
"""Axis (m) that no berg has: the longest ever listed, B15, had 295 km."""

FIX_WITHIN: Final = timedelta(days=3)
SIZE_WITHIN: Final = timedelta(days=60)


@dataclass(frozen=True)
class Sighting:
    """One row of a table: what is known of a berg on a day."""

    date: datetime
    lon: float  # Degrees
    lat: float  # Degrees
    sensor: str
    seen: bool  # Not interpolated
    axes: tuple[float, float] | None = None  # m; of NIC


def fetch_positions(what: str, folder: str | Path, *, progress: Progress | bool = True) -> list[Path]:
    """Fetch a database of positions; returns its tables."""
    source, folder = SOURCES[what], made(Path(folder))
    with progressing(progress) as show:
        path = fetch_one(source.name, None, folder, source.base, Resuming(show), renew=True)
    return unpacked(path, folder) if zipfile.is_zipfile(path) else [path]


def unpacked(path: Path, folder: Path) -> list[Path]:
    """Unpack the tables of a database, all into one folder."""
    tables = []
    with zipfile.ZipFile(path) as archive:
        members = [m for m in archive.infolist() if not m.is_dir() and m.filename.lower().endswith(".csv")]
        if not members or sum(m.file_size for m in members) > LARGEST_ZIP:
            raise InputError(
                "not a database of bergs: no tables, or far too many bytes", where=str(path), remedy="Fetch it again"
            )
        for member in members:
            target = folder / Path(member.filename).name.lower()
            target.write_bytes(archive.read(member))
            tables.append(target)
    return tables


def read_berg(berg: str, folder: str | Path) -> list[Sighting]:
    """Return what a folder of tables knows of a berg, in order of date."""
    folder, name = Path(folder), berg.strip().lower()
    own = folder / f"{name}.csv"
    tables = sorted(folder.glob("*.csv")) + sorted(folder.glob("DownloadCurrent*"))
    if own.is_file():
        return _of_byu(own)
    found = [sighting for path in tables if "iceberg" in _columns(path) for sighting in _of_usnic(path, name)]
    if not found:
        known = sorted({path.stem for path in tables if _is_byu(_columns(path))})
        what = f"no berg {berg!r} in {len(tables)} tables" if tables else "no tables of bergs"
        raise InputError(
            what,
            where=str(folder),
            remedy=f"{nearest(name, known)}'riftberg fetch byu' or 'riftberg fetch usnic' gets tables",
        )
    return sorted(found, key=lambda sighting: sighting.date)


def _rows(path: Path) -> list[dict[str, str]]:
    text = path.read_text("utf-8-sig", errors="replace")
    rows = csv.DictReader(io.StringIO(text))
    return [
        {
            str(k).strip().lower(): (v or "").strip()
            for k, v in row.items()
            if k is not None and isinstance(v, str | None)
        }
        for row in rows
    ]


def _columns(path: Path) -> list[str]:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return [name.strip().lower() for name in file.readline().split(",")]


def _is_byu(columns: Iterable[str]) -> bool:
    names = set(columns)
    return "date" in names and any({f"{s}_1", f"{s}_2"} <= names for s in SENSORS)


def _of_byu(path: Path) -> list[Sighting]:
    columns = _columns(path)
    if not _is_byu(columns):
        raise InputError(
            f"has the columns {', '.join(columns)[:120]}, which are not those of the BYU database", where=str(path),
            remedy="Needed are date (YYYYDDD), SENSOR_1 (latitude), SENSOR_2 (longitude) and, for sizes, size_1 and size_2",
        )  # fmt: skip
    found = []
    for number, row in enumerate(_rows(path), start=2):
        where = f"{path}, line {number}"
        if not re.fullmatch(r"\d{7}", row["date"]):
            raise InputError(
                f"{row['date']!r} is no date of the form YYYYDDD", where=where, remedy="Get the table again"
            )
        date = _day_of_year(row["date"], where)
        length, width = (_number(row.get(name, "0") or "0", where) for name in ("size_1", "size_2"))
        axes = _axes_of(length, width, where)
        places = []
        for rank, sensor in enumerate(SENSORS):
            lat, lon, flag = (
                _number(row.get(f"{sensor}_{k}", "") or ("0" if k < 3 else "1"), where) for k in (1, 2, 3)
            )
            if lat or lon:  # 0, 0 stands for no data
                _check_place(lon, lat, where)
                places.append((flag != 1.0, rank, lon, lat, sensor))
        if places:
            interpolated, _, lon, lat, sensor = min(places)
            found.append(Sighting(date, lon, lat, sensor, not interpolated, axes))
    return found


def _of_usnic(path: Path, name: str) -> list[Sighting]:
    rows = [(number, row) for number, row in enumerate(_rows(path), start=2) if row["iceberg"].lower() == name]
    columns = _columns(path)
    needed = ("iceberg", "length (nm)", "width (nm)", "latitude", "longitude", "last update")
    missing = [column for column in needed if column not in columns]
    if missing and rows:
        raise InputError(
            f"lacks the columns {', '.join(missing)} of the US National Ice Center", where=str(path),
            remedy=f"It has {', '.join(columns)[:120]}",
        )  # fmt: skip
    found = []
    for number, row in rows:
        where = f"{path}, line {number}"
        match = re.fullmatch(r"(\d\d?)/(\d\d?)/(\d{4})", row["last update"])
        if match is None:
            raise InputError(f"{row['last update']!r} is no date of the form month/day/year", where=where)
        length, width, lat, lon = (_number(row[key], where) for key in needed[1:5])
        try:
            date = datetime(int(match[3]), int(match[1]), int(match[2]))
        except ValueError as error:
            raise InputError(f"{row['last update']!r} is no date of the form month/day/year", where=where) from error
        _check_place(lon, lat, where)
        found.append(Sighting(date, lon, lat, "nic", True, _axes_of(length, width, where)))
    return found


def _day_of_year(text: str, where: str) -> datetime:
    """Return the date of YYYYDDD."""
    date = datetime(max(int(text[:4]), 1), 1, 1) + timedelta(days=int(text[4:]) - 1)
    if date.year != int(text[:4]):
        raise InputError(
            f"{text!r}: {int(text[:4])} has no day {int(text[4:])}", where=where, remedy="Get the table again"
        )
    return date


def _check_place(lon: float, lat: float, where: str) -> None:
    if abs(lat) > 90.0 or abs(lon) > 360.0:
        raise InputError(
            f"latitude {lat:g}, longitude {lon:g} are no place on Earth",
            where=where,
            remedy="Latitude comes first there",
        )


def _axes_of(length: float, width: float, where: str) -> tuple[float, float] | None:
    """Return the axes in m of those that are listed in nautical miles; None where none are."""
    if min(length, width) <= 0.0:
        return None
    if max(length, width) * NAUTICAL_MILE > LONGEST:
        raise InputError(
            f"axes of {length:g} and {width:g} nautical miles: no berg is that large", where=where,
            remedy="Give them in nautical miles",
        )  # fmt: skip
    return length * NAUTICAL_MILE, width * NAUTICAL_MILE


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise InputError(f"{text!r} is no number", where=where, remedy="Get the table again") from error
    if not math.isfinite(value):
        raise InputError(f"{text!r} is no number", where=where, remedy="Get the table again")
    return value


@dataclass(frozen=True)
class Known:
    """What is known of a berg at a date."""

    fix: Sighting
    size: Sighting | None  # With its axes


def known_at(berg: str, sightings: list[Sighting], date: datetime, *, sized: bool = True) -> Known:
    """Return the fix and, if ``sized``, the size nearest to a date, or say which the nearest are."""
    fixes = [s for s in sightings if s.seen]
    sizes = [s for s in sightings if s.axes is not None]
    if not fixes:
        raise InputError(
            f"no position of {berg} was seen; all are interpolated", where=f"new {berg}", remedy="Name another berg"
        )
    fix = min(fixes, key=lambda s: abs(s.date - date))
    if abs(fix.date - date) > FIX_WITHIN:
        near = [max((s for s in fixes if s.date <= date), key=lambda s: s.date, default=None),
                min((s for s in fixes if s.date > date), key=lambda s: s.date, default=None)]  # fmt: skip
        said = " and ".join(f"{s.date:%Y-%m-%d}" for s in near if s)
        raise InputError(
            f"{berg} was not seen within {FIX_WITHIN.days} days of {date:%Y-%m-%d}",
            where="--date",
            remedy=f"The nearest dates are {said}",
        )
    # What breaks off later makes a berg smaller: the last size before the date counts, then the next one.
    size = min(
        sizes, key=lambda s: (not timedelta(0) <= date - s.date <= SIZE_WITHIN, abs(s.date - date)), default=None
    )
    if sized and (size is None or abs(size.date - date) > SIZE_WITHIN):
        when = "none is listed at all" if size is None else f"the nearest is of {size.date:%Y-%m-%d}: {_axes(size)}"
        raise InputError(
            f"no size of {berg} within {SIZE_WITHIN.days} days of {date:%Y-%m-%d}; {when}", where="--date",
            remedy="Give --size 'LENGTH,WIDTH', such as --size '60 km,30 km', or --outline FILE",
        )  # fmt: skip
    return Known(fix, size)


def _axes(sighting: Sighting) -> str:
    assert sighting.axes is not None
    return f"{sighting.axes[0] / 1e3:.0f} km x {sighting.axes[1] / 1e3:.0f} km"
