"""The dates of a field: found among its coordinates whatever they are called, in the file's heading as a last resort."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.roles import bounds_of, coordinates_of, holds_dates, role_of_name, standard_name, units_of

_NOT_VALID = re.compile(r"reference|initial|issue|creation|production|analysis")
_COVERAGE = (
    ("time_coverage_start", "time_coverage_end"), ("start_date", "stop_date"), ("start_time", "stop_time"),
    ("StartTime", "StopTime"), ("RangeBeginningDate", "RangeEndingDate"), ("first_date", "last_date"),
)  # fmt: skip
_LONGEST = np.timedelta64(32, "D")
_PERIODS = {
    "s": 1.0,
    "second": 1.0,
    "minute": 60.0,
    "min": 60.0,
    "h": 3600.0,
    "hr": 3600.0,
    "hour": 3600.0,
    "day": 86400.0,
}


def dated(ds: xr.Dataset, name: str, *, where: str, moves: bool) -> xr.DataArray:
    """Return a field with its dates on the dimension ``time``, or without any if the file tells none.

    Parameters
    ----------
    ds : xarray.Dataset
        Decoded file.
    name : str
        Variable.
    where : str
        File, for messages.
    moves : bool
        Whether the field changes by the day; one that does not (the sea floor) loses its time.

    Raises
    ------
    ForcingError
        If a dimension of time has no dates, or dates are written in a way that is not understood.
    """
    field = ds[name]
    stamps = _stamps(ds, name, where)
    stamped = [c for c in stamps if ds[c].ndim == 1]
    dims = [str(dim) for dim in field.dims if any(ds[c].dims == (dim,) for c in stamped) or role_of_name(dim) == "time"]
    if not moves:
        return field.isel({dim: 0 for dim in dims}, drop=True).drop_vars("time", errors="ignore")
    if len(dims) > 1:
        raise ForcingError(
            f"{name} has {len(dims)} dimensions of time ({', '.join(dims)})",
            where=where,
            remedy=f"Choose one entry first, in Python: ds.isel({dims[-1]}=0)",
        )
    if dims:
        chosen = _best(ds, [c for c in stamped if ds[c].dims == (dims[0],)], dims[0])
        if chosen is None and (text := dict(ds.encoding.get("texts", {})).get(dims[0])):
            raise ForcingError(
                f"the dates of {name} are text that is not understood: {text}", where=where,
                remedy=f"Write them like 2020-12-16T06:00, or as dates in Python: ds.assign_coords({dims[0]}=dates)",
            )  # fmt: skip
        if chosen is None:
            raise ForcingError(
                f"the dimension {dims[0]} of {name} ({field.sizes[dims[0]]} records) has no variable with dates",
                where=where,
                remedy=f"Write one, in Python: ds.assign_coords({dims[0]}=dates).to_netcdf('dated.nc')",
            )
        values = _valid(ds, chosen)
        if dims[0] != "time":  # a single date of that name is when a forecast was issued
            field = field.drop_vars("time", errors="ignore").rename({dims[0]: "time"})
        return _with_dates(field, values)
    single = _best(ds, [c for c in stamps if ds[c].ndim == 0], "")
    if single is not None:
        value = _valid(ds, single).expand_dims("time")
        return _with_dates(field.drop_vars("time", errors="ignore").expand_dims("time"), value)
    covered = _covered(ds)
    bare = field.drop_vars("time", errors="ignore")
    return bare if covered is None else _with_dates(bare.expand_dims("time"), xr.DataArray([covered], dims="time"))


def _stamps(ds: xr.Dataset, name: str, where: str) -> list[str]:
    """Return the coordinates of a field that hold dates; numbers like 20201216 are turned into dates in place."""
    stamps = []
    for other, role, declared in list(coordinates_of(ds, name)):
        variable = ds[other]
        if role != "time" or variable.ndim > 1:
            continue
        if holds_dates(variable):
            stamps.append(other)
        elif (dates := _counted(variable)) is not None:
            ds[other] = (variable.dims, dates, variable.attrs)
            stamps.append(other)
        elif variable.ndim == 1 and declared and variable.dims == (other,) and " since " in units_of(variable):
            early = re.search(r"since\s+(-|0{1,4}-)", units_of(variable))
            fault = (
                "which begins before the year 1" if early else "which is no length of time that can be added to a date"
            )
            raise ForcingError(
                f"{other} counts {units_of(variable)!r}, {fault}",
                where=where,
                remedy=f"Write {other} in days or hours since a date, or as dates in Python: ds.assign_coords({other}=dates)",
            )
        elif variable.ndim == 1 and declared and variable.dims == (other,):
            raise ForcingError(
                f"time has no units that say since when it counts ({other} reads {units_of(variable)!r})",
                where=where,
                remedy=f"Write units such as 'hours since 2020-12-01 00:00:00' on {other}",
            )
    return stamps


def _counted(variable: xr.DataArray) -> Any:
    """Return dates of numbers that read like 20201216 or 2020121618; None if they do not."""
    if variable.dtype.kind not in "iuf" or "since" in units_of(variable):
        return None
    values = np.atleast_1d(np.asarray(variable.values, float))
    if not values.size or not np.isfinite(values).all():
        return None
    whole = np.floor(values)
    texts = [f"{value:.0f}" for value in whole]
    if not all(
        re.fullmatch(r"(18|19|20|21)\d{2}(0[1-9]|1[0-2])([0-2]\d|3[01])([01]\d|2[0-3])?", text) for text in texts
    ):
        return None
    try:
        days = [np.datetime64(f"{t[:4]}-{t[4:6]}-{t[6:8]}T{t[8:10] or '00'}", "ns") for t in texts]
    except ValueError:
        return None
    if variable.dtype.itemsize < 8 and variable.dtype.kind == "f" and values.max() > 2.0**24:
        return None  # its steps are 2 days and more: 9 December cannot be told from 10 December
    parts = values - whole  # GrADS and OSI SAF write day as %Y%m%d.%f, good to a third of a millisecond
    dates = np.array(days) + np.round(parts * 86400.0).astype("timedelta64[s]")
    return dates.astype("datetime64[ns]").reshape(variable.shape)


def _best(ds: xr.Dataset, names: list[str], dim: str) -> str | None:
    """Return the coordinate that says when a field is valid, rather than when its forecast was issued."""

    def rank(name: str) -> tuple[bool, bool, bool, bool]:
        metadata_name = standard_name(ds[name])
        issued = bool(_NOT_VALID.search(f"{metadata_name} {name.lower()}"))
        return issued, metadata_name != "time", name != dim, name != "time"

    return min(names, key=rank, default=None)


def _valid(ds: xr.Dataset, name: str) -> xr.DataArray:
    """Return dates of validity: those of a forecast's issue get the length of the forecast added."""
    dates = _middles(ds, ds[name])
    if not _NOT_VALID.search(f"{standard_name(dates)} {name.lower()}"):
        return dates
    for other in ("step", "forecast_period", "leadtime", "lead_time", "forecast_hour"):
        if other in ds.variables and ds[other].ndim == 0:
            ahead: Any = ds[other].values
            if ahead.dtype.kind != "m":
                unit = units_of(ds[other]).lower().strip()
                seconds = _PERIODS.get(unit, _PERIODS.get(unit.rstrip("s"), 3600.0))
                ahead = np.timedelta64(round(float(ahead) * seconds), "s")
            return dates.copy(data=dates.values + ahead.astype("timedelta64[ns]"))
    return dates


def _middles(ds: xr.Dataset, dates: xr.DataArray) -> xr.DataArray:
    """Return dates in the middle of their bounds where the file stamps all its means at their beginnings or all at their ends."""
    bounds = bounds_of(ds, dates)
    if bounds is None or dates.dtype.kind != "M" or bounds.dtype.kind != "M":
        return dates
    first, last = bounds.values[..., 0], bounds.values[..., 1]
    at_an_end = bool((dates.values == first).all() or (dates.values == last).all())
    return dates.copy(data=first + (last - first) // 2) if at_an_end and bool((last > first).all()) else dates


def _with_dates(field: xr.DataArray, dates: xr.DataArray) -> xr.DataArray:
    others = [name for name, c in field.coords.items() if "time" in c.dims and name != "time"]
    return field.drop_vars(others).assign_coords(time=("time", np.atleast_1d(dates.values), dates.attrs))


def _covered(ds: xr.Dataset) -> Any:
    """Return the middle of the time that the heading of the file says it covers, if that is a month at most."""
    for first, last in _COVERAGE:
        if first in ds.attrs:
            start = _moment_of_text(ds.attrs[first])
            end = _moment_of_text(ds.attrs.get(last, ds.attrs[first]))
            if start is not None and end is not None and np.timedelta64(0) <= end - start <= _LONGEST:
                return start + (end - start) / 2
    return None


def _moment_of_text(text: Any) -> Any:
    match = re.match(r"^\s*(\d{4})-?(\d{2})-?(\d{2})(?:[T ]?(\d{2}):?(\d{2}))?", str(text))
    if match is None:
        return None
    year, month, day, hour, minute = match.groups()
    try:
        return np.datetime64(f"{year}-{month}-{day}T{hour or '00'}:{minute or '00'}", "ns")
    except ValueError:
        return None
