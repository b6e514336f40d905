"""Several observed starts of a forecast: positions with error and age, outlines, earlier dates."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from riftberg.bergs.outline import rows_of_csv
from riftberg.diagnostics.dates import parse_date
from riftberg.errors import InputError

COLUMNS: Final = ("date", "lon", "lat", "error_km", "age_hours", "outline")
"""Columns of a table of starts; `lon` with `lat`, all others by themselves."""

SPEED_OF_AGE: Final = 0.12
"""Speed (m s-1, along each axis) by which the error of a position grows with its age.

Half of the giant bergs north of 60 S are 12.4 km away after a day (`riftberg verify-tracks`, staying put): the median of a
normal distribution in two dimensions with a standard deviation of 10.5 km along each axis.
"""


def read_starts(path: str | Path) -> dict[str, str]:
    """Return what a table of starts varies, row after row in turn, as `riftberg.forecast` takes it.

    Parameters
    ----------
    path : path
        Table (CSV) with some of the columns ``date`` (members start then; at or before the start of the experiment), ``lon``
        and ``lat`` (degrees, of the middle of the berg), ``error_km`` (standard deviation along each axis), ``age_hours``
        (how old the position is at the start: the error grows by 0.12 m/s) and ``outline`` (file, as ``berg.outline.file``).

    Returns
    -------
    dict of str
        Distributions by name.

    Raises
    ------
    InputError
        If the table has none of these columns, or a row that cannot be read.
    """
    rows = [
        {str(key).strip().lower(): (value or "").strip() for key, value in row.items()}
        for row in rows_of_csv(Path(path))[0]
    ]
    held = [name for name in COLUMNS if name in rows[0]]
    other = [name for name in rows[0] if name not in COLUMNS]
    if not held or other or ("lon" in held) != ("lat" in held):
        what = f"a column {other[0]!r}" if other else "no column of a start" if not held else "lon without lat"
        raise InputError(what, where=str(path), remedy=f"Columns are {', '.join(COLUMNS)}")
    found: dict[str, list[str]] = {}
    for number, row in enumerate(rows, start=2):
        for name, value in _of_row(row, f"{path}, line {number}").items():
            found.setdefault(name, []).append(value)
    varied = {name: f"~each({', '.join(values)})" for name, values in found.items()}
    if "start.error" in varied:
        varied |= dict.fromkeys(("start.east", "start.north"), "~normal(0 m, 1 m)")
    return varied


def _of_row(row: dict[str, str], where: str) -> dict[str, str]:
    """Return the values of one start by the names of `--vary`."""

    def number(name: str, low: float, high: float) -> float:
        try:
            value = float(row[name])
        except ValueError as error:
            raise InputError(f"{name}: no number", where=where, remedy="Give a number in every row") from error
        if not low <= value <= high:
            raise InputError(f"{name}: {value:g}", where=where, remedy=f"Give {low:g} to {high:g}")
        return value

    values: dict[str, Any] = {}
    if "date" in row:
        values["start"] = parse_date(row["date"], where=where)[0].isoformat(sep=" ")
    if "lon" in row:
        values["berg.placement"] = f"[{number('lon', -540.0, 540.0):.10g}, {number('lat', -90.0, 90.0):.10g}]"
    if "error_km" in row or "age_hours" in row:
        error = 1e3 * number("error_km", 0.0, 500.0) if "error_km" in row else 0.0
        age = 3600.0 * number("age_hours", 0.0, 2400.0) if "age_hours" in row else 0.0
        values["start.error"] = f"{math.hypot(error, SPEED_OF_AGE * age):.6g}"
    if "outline" in row:
        if not row["outline"]:
            raise InputError("outline: no file", where=where, remedy="Name a file in every row")
        values["berg.outline.file"] = row["outline"]
    return values
