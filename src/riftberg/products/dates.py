"""The dates of a field: which coordinate holds them, the interval that its file states, and the moments at which means hold."""

from __future__ import annotations

import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.products.cf import (
    NAMED,
    find_bounds,
    find_coordinates,
    holds_dates,
    read_units,
    role_by_name,
    standard_name,
)
from riftberg.products.product import noted
from riftberg.products.quantities import unit_change
from riftberg.products.records import MEAN_OF, named, usual_interval
from riftberg.products.repair import CALENDARS, EARLY, date_in_seconds

_ISSUED = re.compile(
    r"\b(ref|ref(erence)?_?(time|date)?|init\w*|issue\w*|creat\w*|production|produced|analys[ie]s|base|base_?(time|date)|run|"
    r"run_?(time|date)|cycle|processing|processed|origin|launch|publi\w*|updated?|generat\w*|received|written)\b"
)
"""Words of dates at which something was made rather than holds."""
_VALID = re.compile(r"\b(valid\w*|val|valtime|verif\w*|utc|gmt)\b")
_LOCAL = re.compile(r"\b(local|lst|lmt)\b")
_START = re.compile(r"\b(start\w*|begin\w*|first|lower|from|t0|t1)\b")
_END = re.compile(r"\b(end\w*|stop\w*|last|upper|to|until|t2)\b")
_LEAD = re.compile(r"^(step|tau|lead|lead_?times?|forecast_?(period|hours?|lead|lead_?time|time\d*)|fhour)$")
"""Names of the time by which a forecast runs ahead of its date of issue."""
_IN_DAY = re.compile(r"^(date_?)?(sec|seconds?|hours?|hh|utc_?hours?)(_of_day)?$")
"""Names of the time of day beside dates without one, such as datesec of CESM."""
_COVERAGE = (
    ("time_coverage_start", "time_coverage_end"), ("start_date", "stop_date"), ("start_time", "stop_time"),
    ("StartTime", "StopTime"), ("RangeBeginningDate", "RangeEndingDate"), ("first_date", "last_date"),
)  # fmt: skip
_LONGEST = np.timedelta64(32, "D")
_SECOND = np.timedelta64(1, "s")
_POINT = re.compile(r"\btime\s*:\s*(\w+\s*:\s*)*point\b")
_MEAN = re.compile(r"\b(\w*time\w*|t)\s*:\s*(\w+\s*:\s*)*mean\b", re.I)


def date_field(ds: xr.Dataset, name: str, *, where: str, moves: bool) -> tuple[xr.DataArray, str]:
    """Return a field with its dates on the dimension ``time``, or without any if the file tells none, and a remark."""
    for dim in _spare(ds, name):
        ds = ds.isel({dim: 0})
    field = ds[name]
    stamps = _stamps(ds, name, where)
    stamped = [c for c in stamps if ds[c].ndim == 1]
    dims = [str(dim) for dim in field.dims if any(ds[c].dims == (dim,) for c in stamped) or role_by_name(dim) == "time"]
    if not moves:
        return field.isel({dim: 0 for dim in dims}, drop=True).drop_vars("time", errors="ignore"), ""
    if len(dims) > 1:
        raise ForcingError(
            f"{name} has {len(dims)} dimensions of time ({', '.join(dims)})",
            where=where,
            remedy=f"Choose one entry first, in Python: ds.isel({dims[-1]}=0)",
        )
    if dims:
        along = [c for c in stamped if ds[c].dims == (dims[0],)]
        undated = field.sizes[dims[0]] == 1 and all(bool(ds[c].isnull().all()) for c in along)
        if undated and (covered := _covered(ds)) is not None:  # of one record the heading may say when it was
            field = field.drop_vars("time", errors="ignore").rename({dims[0]: "time"})
            return _with_dates(field, xr.DataArray([covered], dims="time")), ""
        if not along and (text := dict(ds.encoding.get("texts", {})).get(dims[0])):
            raise ForcingError(
                f"the dates of {name} are text that is not understood: {text}", where=where,
                remedy=f"Write them like 2020-12-16T06:00, or as dates in Python: ds.assign_coords({dims[0]}=dates)",
            )  # fmt: skip
        if not along:
            raise ForcingError(
                f"the dimension {dims[0]} of {name} ({field.sizes[dims[0]]} records) has no variable with dates",
                where=where,
                remedy=f"Write one, in Python: ds.assign_coords({dims[0]}=dates).to_netcdf('dated.nc')",
            )
        values, means, remark = _valid(ds, along, name, where)
        if dims[0] != "time":  # a single date of that name is when a forecast was issued
            field = field.drop_vars("time", errors="ignore").rename({dims[0]: "time"})
        return _with_dates(field, values, means), remark
    bare = field.drop_vars("time", errors="ignore")
    if single := [c for c in stamps if ds[c].ndim == 0]:
        value, means, remark = _valid(ds, single, name, where)
        return _with_dates(bare.expand_dims("time"), value.expand_dims("time"), means), remark
    if (covered := _covered(ds)) is None:
        return bare, ""
    return _with_dates(bare.expand_dims("time"), xr.DataArray([covered], dims="time")), ""


def _spare(ds: xr.Dataset, name: str) -> list[str]:
    """Return dimensions of one entry of dates that a file gives by issue and lead: valid_time(time, step)."""
    tables = [
        c for c, role, _ in find_coordinates(ds, name) if role == "time" and ds[c].ndim == 2 and holds_dates(ds[c])
    ]
    single = [[str(dim) for dim in ds[c].dims if ds.sizes[dim] == 1] for c in tables]
    return next((dims[-1:] for dims in single if dims), [])


def _stamps(ds: xr.Dataset, name: str, where: str) -> list[str]:
    """Return the coordinates of a field that hold dates; numbers like 20201216 are turned into dates in place."""
    stamps: list[str] = []
    faults: dict[str, tuple[str, str]] = {}
    for other, role, declared in list(find_coordinates(ds, name)):
        variable = ds[other]
        if role != "time" or variable.ndim > 1:
            continue
        if holds_dates(variable):
            stamps.append(other)
        elif (dates := _counted(variable)) is not None:
            ds[other] = (variable.dims, dates + _into_day(ds, variable), variable.attrs)
            stamps.append(other)
        elif variable.ndim == 1 and declared and variable.dims == (other,) and " since " in read_units(variable):
            early = EARLY.search(read_units(variable))
            fault = (
                "which begins before the year 1" if early else "which is no length of time that can be added to a date"
            )
            calendar = str(variable.attrs.get("calendar", "standard")).lower()
            if not early and calendar not in CALENDARS:
                fault = f"in a calendar {calendar!r} that nobody knows: CF has {', '.join(CALENDARS)}"
            faults[other] = (
                f"{other} counts {read_units(variable)!r}, {fault}",
                f"Write {other} in days or hours since a date, or as dates in Python: ds.assign_coords({other}=dates)",
            )
        elif variable.ndim == 1 and declared and variable.dims == (other,):
            faults[other] = (
                f"time has no units that say since when it counts ({other} reads {read_units(variable)!r})",
                f"Write units such as 'hours since 2020-12-01 00:00:00' on {other}",
            )
    for other, (
        problem,
        remedy,
    ) in faults.items():  # another variable may date the same records (time_centered of XIOS)
        if not any(ds[stamp].dims == (other,) for stamp in stamps):
            raise ForcingError(problem, where=where, remedy=remedy)
    return stamps


def _into_day(ds: xr.Dataset, dates: xr.DataArray) -> Any:
    """Return the time of day that stands in a variable of its own beside dates like 20201216, where there is one."""
    if np.any(dates.values % 1) or np.any(dates.values > 99999999):
        return np.timedelta64(0, "ns")
    for name, variable in ds.variables.items():
        if variable.dims == dates.dims and variable.dtype.kind in "iuf" and (match := _IN_DAY.match(str(name).lower())):
            seconds = _unit_seconds(read_units(variable)) or (1.0 if match[2].startswith("s") else 3600.0)
            values = np.nan_to_num(np.asarray(variable.values, float)) * seconds
            if values.min(initial=0.0) >= 0.0 and values.max(initial=0.0) < SECONDS_PER_DAY:
                return np.round(1e3 * values).astype("timedelta64[ms]")
    return np.timedelta64(0, "ns")


def _counted(variable: xr.DataArray) -> Any:
    """Return dates of numbers that read like 20201216 or 2020121618; None if they do not."""
    if variable.dtype.kind not in "iuf" or "since" in read_units(variable):
        return None
    values = np.atleast_1d(np.asarray(variable.values, float))
    if not values.size or not np.isfinite(values).all():
        return None
    integers = np.floor(values)
    texts = [f"{value:.0f}" for value in integers]
    if not all(
        re.fullmatch(r"(18|19|20|21)\d{2}(0[1-9]|1[0-2])([0-2]\d|3[01])([01]\d|2[0-3])?", text) for text in texts
    ):
        return None
    seconds = [date_in_seconds(text) for text in texts]
    if None in seconds:
        return None
    if variable.dtype.itemsize < 8 and variable.dtype.kind == "f" and values.max() > 2.0**24:
        return None  # its steps are 2 days and more: 9 December cannot be told from 10 December
    fractions = values - integers  # GrADS and OSI SAF write day as %Y%m%d.%f, good to a third of a millisecond
    dates = np.array(seconds, float) + np.round(fractions * 86400.0)
    return dates.astype("datetime64[s]").astype("datetime64[ns]").reshape(variable.shape)


def _valid(ds: xr.Dataset, names: list[str], field: str, where: str) -> tuple[xr.DataArray, Any, str]:
    """Return the dates at which the records of a field hold, the time (s) that each is a mean of, and a remark on the choice.

    Of several coordinates with dates the one counts that the user names, then the one that metadata and names call valid.
    One that lies ahead of another by the length of the forecast is that other's date of validity; start and end are bounds.
    """
    names = [name for name in names if not ds[name].isnull().all()] or names
    lead = _lead(ds, ds[names[0]])
    ahead = [] if lead is None else [a for a in names for b in names if a != b and _same(_later(ds[a], lead), ds[b])]

    def doubts(name: str) -> tuple[bool, ...]:
        standard, words = standard_name(ds[name]), _words(ds[name], name)
        issued = name in ahead or standard == "forecast_reference_time" or bool(_ISSUED.search(words))
        axis = name in ds.dims or ds[name].attrs.get("axis") == "T"
        return (
            NAMED not in ds[name].attrs, issued, any(kind.search(words) for kind in (_START, _END, _LOCAL)),
            not _VALID.search(words), standard != "time", not axis, name != "time",
        )  # fmt: skip

    best, *others = sorted(names, key=doubts)
    others = [name for name in others if not _same(ds[name], ds[best])]
    start, end = ([name for name in names if kind.search(_words(ds[name], name))] for kind in (_START, _END))
    bounds = find_bounds(ds, ds[best])
    remark = f"the dates of the records are those of {best}, not of {', '.join(others)}" if others else ""
    edges = (
        bounds is None
        and NAMED not in ds[best].attrs
        and len(start) == len(end) == 1
        and _follow(ds[start[0]], ds[end[0]])
    )
    if edges:
        pair = np.stack([ds[start[0]].values, ds[end[0]].values], axis=-1)
        bounds = xr.Variable((*ds[best].dims, "bounds"), pair)
    dates, means = _middles(ds, ds[best], bounds, field)
    if edges and means is not None:
        remark = f"the records are means from {start[0]} to {end[0]}, and hold in the middle of these"
    elif rivals := [name for name in others if doubts(name) == doubts(best)]:
        first = [str(np.ravel(ds[name].values)[0])[:16] for name in (best, rivals[0])]
        raise ForcingError(
            f"{best} and {rivals[0]} both hold dates of the records of {field}, the first {first[0]} and {first[1]}, and nothing "
            "says which of them the values hold at", where=where,
            remedy=f"Name it: names: {{time: {best}}}, or --names time={best}, or give it the standard name time",
        )  # fmt: skip
    if not doubts(best)[1] or standard_name(dates) == "time":
        return dates, means, remark
    if lead is not None:
        return _later(dates, lead), means, remark
    if "analys" not in _words(ds[best], best):
        remark = remark or f"the dates of the records are those of {best}, and nothing says how far ahead they hold"
    return dates, means, remark


def _words(variable: xr.DataArray, name: str) -> str:
    """Return the description of a coordinate, in words, without its date of reference."""
    title = re.split(r"\b(since|after|relative)\b", str(variable.attrs.get("long_name", "")).lower())[0]
    return " ".join(re.split(r"[\W_]+", f"{standard_name(variable)} {name.lower()} {title}"))


def _lead(ds: xr.Dataset, dates: xr.DataArray) -> Any:
    """Return how far ahead of their issue the dates of a forecast are, as the file says; None if it does not, or by nothing."""
    for name, variable in ds.variables.items():
        if standard_name(variable) != "forecast_period" and not _LEAD.search(str(name).lower()):
            continue
        if variable.dtype.kind not in "iufm" or not (variable.size == 1 or variable.dims == dates.dims):
            continue
        ahead: Any = np.asarray(variable.values)
        if ahead.dtype.kind != "m":
            # Without a unit that is known the length of a forecast is in hours.
            seconds = _unit_seconds(read_units(variable).split(" since ")[0]) or 3600.0
            ahead = np.round(np.where(np.isfinite(ahead), ahead, 0.0) * seconds).astype("timedelta64[s]")
        # In microseconds, so that a length beyond all years is met as such and does not come back as another.
        ahead = ahead.astype("timedelta64[us]")
        if ahead.any():
            return ahead if variable.dims == dates.dims else ahead.ravel()[0]
    return None


def _later(dates: xr.DataArray, lead: Any) -> xr.DataArray:
    """Return dates that lie later by a length of time."""
    if dates.dtype == object:
        return dates.copy(data=dates.values + np.asarray(lead).astype(object))
    return dates.copy(data=dates.values.astype("datetime64[us]") + lead)


def _same(a: xr.DataArray, b: xr.DataArray) -> bool:
    """Tell whether two coordinates hold the same dates, to the second."""
    if (a.dtype.kind == "M") != (b.dtype.kind == "M") or a.shape != b.shape:
        return False
    return bool(np.all(np.abs(a.values - b.values) < _rounding(a)))


def _rounding(dates: xr.DataArray) -> Any:
    """Return a second, by which dates that are meant to be the same may differ."""
    return timedelta(seconds=1) if dates.dtype == object else np.timedelta64(1, "s")


def _follow(start: xr.DataArray, end: xr.DataArray) -> bool:
    """Tell whether records that begin and end at these dates follow one another, as means do, rather than all begin at once."""
    first, last = start.values, end.values
    return first.dtype == last.dtype and bool(
        (last > first).all() and (np.ndim(first) == 0 or (first[1:] > first[:-1]).all())
    )


def _middles(ds: xr.Dataset, dates: xr.DataArray, bounds: xr.Variable | None, field: str) -> tuple[xr.DataArray, Any]:
    """Return dates in the middle of their bounds, and the length (s) of these; None where values are no means over them.

    Bounds that do not hold their dates are not believed. Bounds without width (the first record of some models) stay.
    """
    kinds = {dates.dtype.kind, bounds.dtype.kind} if bounds is not None else set()
    if bounds is None or kinds not in ({"M"}, {"O"}) or _POINT.search(str(ds[field].attrs.get("cell_methods", ""))):
        return dates, None
    first, last = bounds.values.min(axis=-1), bounds.values.max(axis=-1)  # some files write the end first
    wide = np.asarray(last > first, bool)
    inside = (first - _rounding(dates) < dates.values) & (dates.values < last + _rounding(dates))
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
            start, end = _parse_moment(ds.attrs[first]), _parse_moment(ds.attrs.get(last, ""))
            if start is not None and last not in ds.attrs:
                length = iso_seconds(str(ds.attrs.get("time_coverage_duration", "")))
                end = start + np.timedelta64(round(length), "s")
            if start is not None and end is not None and np.timedelta64(0) <= end - start <= _LONGEST:
                return start + (end - start) / 2
    return None


def _parse_moment(text: Any) -> Any:
    seconds = date_in_seconds(str(text).strip())
    return None if seconds is None else np.datetime64(round(1e6 * seconds), "us")


# What a file says itself about the time between its records, or that one record stands for.


MONTH_SECONDS = 30.4 * SECONDS_PER_DAY

_FREQUENCIES = {
    "1hr": 3600.0, "3hr": 3 * 3600.0, "6hr": 6 * 3600.0, "day": SECONDS_PER_DAY, "mon": MONTH_SECONDS,
}  # fmt: skip
_WORDS = (
    (re.compile(r"\bmonth(ly)?[ _-](mean|average)|_p1m-m|\bp1m\b"), MONTH_SECONDS),
    (re.compile(r"\b(daily|day)[ _-](mean|average)|_p1d-m|\bp1d\b"), SECONDS_PER_DAY),
)
TITLES = ("title", "id", "source", "product", "comment")
HEADINGS = (*TITLES, "summary", "description")
"""Attributes of a file that say in words what its records are; the last two speak of what they were made from, too."""

MEAN_WORDS = re.compile(r"\b(month|monthly|day|daily)[ _-](mean|average)|_p1[md]-m", re.I)
"""Words of a heading by which records are means."""
_FILE_NAMES = (
    (re.compile(r"p1m-m|_mean_\d{6}(?!\d)|monthly"), MONTH_SECONDS),
    (re.compile(r"p1d-m|_mean_\d{8}(?!\d)|daily"), SECONDS_PER_DAY),
)
_ISO = re.compile(r"^P(?:(\d+)Y)?(?:(\d+)M)?(?:(\d+)W)?(?:(\d+)D)?(?:T(?:(\d+)H)?(?:(\d+)M)?(?:(\d+)S)?)?$")
_ISO_SECONDS = (12 * MONTH_SECONDS, MONTH_SECONDS, 7 * SECONDS_PER_DAY, SECONDS_PER_DAY, 3600.0, 60.0, 1.0)


def stated_interval(raw: xr.Dataset, path: str) -> float:
    """Return the interval (s) that a file states; 0 if it states none.

    Looked at are, in this order: bounds of the time, the attributes ``time_coverage_resolution`` (ISO 8601),
    ``frequency`` (CMIP) and ``delta_t`` (NOAA), headings that say daily or monthly mean, and the name of the file.
    ``cell_methods`` tell that a value is a mean, not over which time.
    """
    text = str(raw.variables["time"].attrs.get("delta_t", "")) if "time" in raw.variables else ""
    match = re.match(r"^(\d+)-(\d+)-(\d+) (\d+):(\d+):(\d+)", text)  # years, months, days, hours, minutes, seconds
    sizes = (12 * MONTH_SECONDS, MONTH_SECONDS, SECONDS_PER_DAY, 3600.0, 60.0, 1.0)
    candidates = (
        _bounds(raw),
        iso_seconds(str(raw.attrs.get("time_coverage_resolution", ""))),
        _FREQUENCIES.get(str(raw.attrs.get("frequency", "")), 0.0),
        sum(int(count) * size for count, size in zip(match.groups(), sizes, strict=True)) if match else 0.0,
        _stated_length(" ".join(str(raw.attrs.get(k, "")) for k in TITLES), _WORDS),
        _stated_length(Path(path).name, _FILE_NAMES),
    )
    return next((seconds for seconds in candidates if seconds > 0.0), 0.0)


def _bounds(raw: xr.Dataset) -> float:
    """Return the usual width of the bounds of the time, whatever it is called."""
    for time in raw.variables.values():
        bounds = raw.variables.get(str(time.attrs.get("bounds", "")))
        units = str(time.attrs.get("units", ""))
        if bounds is None or " since " not in units or time.ndim != 1:
            continue
        unit = _unit_seconds(units.split(" ")[0])
        if unit and bounds.ndim == 2 and bounds.shape[1] == 2 and bounds.size:
            widths = np.abs(np.diff(np.asarray(bounds.values, float), axis=1))
            return float(np.median(widths)) * unit
    return 0.0


def _unit_seconds(unit: str) -> float:
    """Return the seconds in a unit of time; 0 if it is none."""
    change = unit_change(unit, "s")
    return 0.0 if change is None else change[0]


_NEAR = re.compile(
    r"analysis[ _-]?forecast|_anfc|forecast|near[ _-]real[ _-]time|(?<![a-z])nrt(?![a-z])|operational|interim|preliminary",
    re.I,
)
_PAST = re.compile(r"re-?analysis|multi-?year|hindcast|delayed[ _-]time|(?<![a-z])(my|rep|dt)(?![a-z])", re.I)


def describe_kind(raw: xr.Dataset, path: str) -> str:
    """Return a remark where heading or name of a file say that it is an analysis, a forecast or near real time."""
    more = ("product_id", "processing_level", "experiment", "summary", "field_type", "name")
    keys = ("title", "id", "source", "product", *more)
    for text in (*(str(raw.attrs.get(key, "")) for key in keys), Path(path).name):
        # "Reanalysis" holds "analysis", and a title may name both what it is and what it is not.
        match = _NEAR.search(text)
        if match and not _PAST.search(text):
            return f"analysis, forecast or near real time, no reanalysis: the file says {text.strip()[:80]!r}"
    return ""


def iso_seconds(text: str) -> float:
    """Return the length of an ISO 8601 duration (``P1D``, ``PT6H``) in seconds; 0 if it is none."""
    match = _ISO.match(text.strip().upper())
    if match is None:
        return 0.0
    return sum(int(count) * unit for count, unit in zip(match.groups(), _ISO_SECONDS, strict=True) if count)


def _stated_length(text: str, words: tuple[tuple[re.Pattern[str], float], ...]) -> float:
    return next((seconds for pattern, seconds in words if pattern.search(text.lower())), 0.0)


# Means whose file states no bounds: where in time they hold, and for how long; what cannot be known is told.


MONTH = (28 * SECONDS_PER_DAY, 31 * SECONDS_PER_DAY)
"""Lengths (s) of months."""


def in_mid_month(ds: xr.Dataset) -> xr.Dataset:
    """Return monthly means with their stamps in the middle of the month, whatever day the file wrote."""
    months = ds["time"].values.astype("datetime64[M]")
    start, end = months.astype("datetime64[ns]"), (months + 1).astype("datetime64[ns]")
    return _centre_means(ds, (end - start) / np.timedelta64(1, "s"), start + (end - start) / 2)


def _centre_means(ds: xr.Dataset, seconds: NDArray[np.float64], dates: Any) -> xr.Dataset:
    """Return means of so many seconds each, in the middle of them."""
    ds = ds.assign_coords({"time": ("time", dates, ds["time"].attrs), MEAN_OF: ("time", seconds, {"units": "s"})})
    return ds.assign_attrs(averaging_seconds=float(np.median(seconds)))


def place_means(ds: xr.Dataset, *, known: bool = False) -> xr.Dataset:
    """Put means without bounds where they hold, and say so, once all records of all files are known.

    Months stamped on their first or last day are put in mid-month, days stamped 00:00 at noon of the day that begins there:
    thus the common services and tools write them. As values of the stamp they would be half an interval off in any case.
    """
    means = str(ds.attrs.get("means", ""))
    if MEAN_OF in ds.coords or float(ds.attrs.get("averaging_seconds", 0.0)) > 0.0:
        return ds
    records = ds["time"].values
    interval = usual_interval(records)
    # The shorter of what the records show and what the file states: gaps make the first too long.
    step = min((s for s in (interval, float(ds.attrs.get("stated_seconds", 0.0))) if s > 0.0), default=0.0)
    of_months = bool(re.fullmatch(r"GRIB_stepType avg\w+", means))  # the hourly kind is plain "avg"
    days = records.astype("datetime64[D]")
    months = records.astype("datetime64[M]")
    first = bool((days == months.astype(days.dtype)).all())
    # The day after it is the first of a month.
    last = bool((days + 1 == (months + 1).astype(days.dtype)).all())
    stamp = f"on the {'first' if first else 'last'} of the month"
    by_month = MONTH[0] <= step <= MONTH[1] or (of_months and not step)
    if not means:
        if first and by_month and records.size > 1 and not known and "longest_step" not in ds.attrs:
            return noted(
                ds, doubt=f"records {stamp}, taken as values of these dates: are they means? Then write bounds of time"
            )
        return ds
    if of_months and 0.0 < interval <= SECONDS_PER_DAY:
        raise ForcingError(
            f"monthly means by hour of the day ({means}), which are no course in time", where=named(ds),
            remedy="Give the monthly means of all hours, or hourly data",
        )  # fmt: skip
    if by_month and (first or last):
        return noted(
            in_mid_month(ds), told=f"monthly means ({means}) without bounds, stamped {stamp}, are put in mid-month"
        )
    # Seconds into the day; a stamp in the middle of its interval needs no change.
    into = np.asarray((records - days.astype(records.dtype)) / np.timedelta64(1, "s"))
    middle = np.full(records.size, 0.5 * step)
    if by_month and step:  # a stamp within two days of the middle is meant as such
        into = np.asarray((records - months.astype(records.dtype)) / np.timedelta64(1, "s"))
        if bool((np.clip(into, 13.0 * SECONDS_PER_DAY, 17.0 * SECONDS_PER_DAY) == into).all()):
            return in_mid_month(ds)
        middle[:] = np.nan
    elif step == SECONDS_PER_DAY and not into.any():
        ds = _centre_means(ds, np.full(records.size, step), records + np.timedelta64(12, "h"))
        return noted(
            ds,
            told=f"daily means ({means}) without bounds, stamped 00:00, are put at noon of the day that begins there",
        )
    elif 0.0 < step < SECONDS_PER_DAY:
        into = into % step
    if step and bool((into == middle).all()):
        return _centre_means(ds, np.full(records.size, step), records)
    over = f"over about {step / 3600.0:.3g} h" if step else "over a time that nothing says"
    return noted(ds, doubt=f"means ({means}) {over} without bounds are taken as values of their stamps")
