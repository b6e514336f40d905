"""The dates of a field: found among its coordinates whatever they are called, in the file's heading as a last resort."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.records import MEAN_OF
from riftberg.products.roles import bounds_of, coordinates_of, holds_dates, role_of_name, standard_name, units_of
from riftberg.products.stated import HEADINGS, MEAN_WORDS, iso_seconds
from riftberg.products.text_dates import CALENDARS

_NOT_VALID = re.compile(r"reference|initial|issue|creation|production|analysis")
_COVERAGE = (
    ("time_coverage_start", "time_coverage_end"), ("start_date", "stop_date"), ("start_time", "stop_time"),
    ("StartTime", "StopTime"), ("RangeBeginningDate", "RangeEndingDate"), ("first_date", "last_date"),
)  # fmt: skip
_LONGEST = np.timedelta64(32, "D")
_SECOND = np.timedelta64(1, "s")
_POINT = re.compile(r"\btime\s*:\s*(\w+\s*:\s*)*point\b")
_MEAN = re.compile(r"\b(\w*time\w*|t)\s*:\s*(\w+\s*:\s*)*mean\b", re.I)
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
    """Return a field with its dates on the dimension ``time``, or without any if the file tells none."""
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
        undated = field.sizes[dims[0]] == 1 and (chosen is None or bool(ds[chosen].isnull().all()))
        if undated and (covered := _covered(ds)) is not None:  # of one record the heading may say when it was
            field = field.drop_vars("time", errors="ignore").rename({dims[0]: "time"})
            return _with_dates(field, xr.DataArray([covered], dims="time"))
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
        values, means = _valid(ds, chosen, name)
        if dims[0] != "time":  # a single date of that name is when a forecast was issued
            field = field.drop_vars("time", errors="ignore").rename({dims[0]: "time"})
        return _with_dates(field, values, means)
    single = _best(ds, [c for c in stamps if ds[c].ndim == 0], "")
    if single is not None:
        value, means = _valid(ds, single, name)
        bare = field.drop_vars("time", errors="ignore").expand_dims("time")
        return _with_dates(bare, value.expand_dims("time"), means)
    covered = _covered(ds)
    bare = field.drop_vars("time", errors="ignore")
    return bare if covered is None else _with_dates(bare.expand_dims("time"), xr.DataArray([covered], dims="time"))


def _stamps(ds: xr.Dataset, name: str, where: str) -> list[str]:
    """Return the coordinates of a field that hold dates; numbers like 20201216 are turned into dates in place."""
    stamps: list[str] = []
    faults: dict[str, tuple[str, str]] = {}
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
            calendar = str(variable.attrs.get("calendar", "standard")).lower()
            if not early and calendar not in CALENDARS:
                fault = f"in a calendar {calendar!r} that nobody knows: CF has {', '.join(CALENDARS)}"
            faults[other] = (
                f"{other} counts {units_of(variable)!r}, {fault}",
                f"Write {other} in days or hours since a date, or as dates in Python: ds.assign_coords({other}=dates)",
            )
        elif variable.ndim == 1 and declared and variable.dims == (other,):
            faults[other] = (
                f"time has no units that say since when it counts ({other} reads {units_of(variable)!r})",
                f"Write units such as 'hours since 2020-12-01 00:00:00' on {other}",
            )
    for other, (what, remedy) in faults.items():  # another variable may date the same records (time_centered of XIOS)
        if not any(ds[stamp].dims == (other,) for stamp in stamps):
            raise ForcingError(what, where=where, remedy=remedy)
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


def _valid(ds: xr.Dataset, name: str, field: str) -> tuple[xr.DataArray, Any]:
    """Return dates of validity, and the time (s) that each is a mean of; a forecast's issue gets its length added."""
    dates, means = _middles(ds, ds[name], field)
    if not _NOT_VALID.search(f"{standard_name(dates)} {name.lower()}"):
        return dates, means
    for other in ("step", "forecast_period", "leadtime", "lead_time", "forecast_hour"):
        if other in ds.variables and ds[other].ndim == 0:
            ahead: Any = ds[other].values
            if ahead.dtype.kind != "m":
                unit = units_of(ds[other]).lower().strip()
                seconds = _PERIODS.get(unit, _PERIODS.get(unit.rstrip("s"), 3600.0))
                ahead = np.timedelta64(round(float(ahead) * seconds), "s")
            # In microseconds, so that a length beyond all years is met as such and does not come back as another.
            return dates.copy(data=dates.values.astype("datetime64[us]") + ahead.astype("timedelta64[us]")), means
    return dates, means


def _middles(ds: xr.Dataset, dates: xr.DataArray, field: str) -> tuple[xr.DataArray, Any]:
    """Return dates in the middle of their bounds, and the length (s) of these; None where values are no means over them.

    Bounds that do not hold their dates are not believed. Bounds without width (the first record of some models) stay.
    """
    bounds = bounds_of(ds, dates)
    kinds = {dates.dtype.kind, bounds.dtype.kind} if bounds is not None else set()
    if bounds is None or kinds not in ({"M"}, {"O"}) or _POINT.search(str(ds[field].attrs.get("cell_methods", ""))):
        return dates, None
    first, last = bounds.values[..., 0], bounds.values[..., 1]
    wide = np.asarray(last > first, bool)
    inside = (first <= dates.values) & (dates.values <= last)
    if not wide.any() or not inside[wide].all():
        return dates, None
    lengths = last - first
    seconds = np.reshape(
        [getattr(d, "total_seconds", lambda d=d: d / _SECOND)() for d in np.ravel(lengths)], wide.shape
    )
    return dates.copy(data=np.where(wide, first + lengths // 2, dates.values)), np.where(wide, seconds, 0.0)


def declared_mean(ds: xr.Dataset, name: str) -> str:
    """Return how a variable, or the heading of its file, says that its records are means over time; empty if none does."""
    methods, step = (str(ds[name].attrs.get(key, "")) for key in ("cell_methods", "GRIB_stepType"))
    if _MEAN.search(methods):
        return f"cell_methods {methods.strip()!r}"
    if step.startswith("avg"):
        return f"GRIB_stepType {step}"
    headed = {key: str(ds.attrs.get(key, "")) for key in HEADINGS} if not (_POINT.search(methods) or step) else {}
    return next((f"{key} {text[:60]!r}" for key, text in headed.items() if MEAN_WORDS.search(text)), "")


def _with_dates(field: xr.DataArray, dates: xr.DataArray, means: Any = None) -> xr.DataArray:
    others = [name for name, c in field.coords.items() if "time" in c.dims and name != "time"]
    field = field.drop_vars(others).assign_coords(time=("time", np.atleast_1d(dates.values), dates.attrs))
    return field if means is None else field.assign_coords({MEAN_OF: ("time", np.atleast_1d(means), {"units": "s"})})


def _covered(ds: xr.Dataset) -> Any:
    """Return the middle of the time that the heading of the file says it covers, if that is a month at most."""
    for first, last in _COVERAGE:
        if first in ds.attrs:
            start, end = _moment_of_text(ds.attrs[first]), _moment_of_text(ds.attrs.get(last, ""))
            if start is not None and last not in ds.attrs:
                length = iso_seconds(str(ds.attrs.get("time_coverage_duration", "")))
                end = start + np.timedelta64(round(length), "s")
            if start is not None and end is not None and np.timedelta64(0) <= end - start <= _LONGEST:
                return start + (end - start) / 2
    return None


def _moment_of_text(text: Any) -> Any:
    match = re.match(r"^\s*(\d{4})-?(\d{2})-?(\d{2})(?:[T ]?(\d{2}):?(\d{2}))?", str(text))
    if match is None:
        return None
    year, month, day, hour, minute = match.groups()
    try:
        return np.datetime64(f"{year}-{month}-{day}T{hour or '00'}:{minute or '00'}", "us")
    except ValueError:
        return None
