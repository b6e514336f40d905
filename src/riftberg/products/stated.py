"""What a file says itself about the time between its records, or that one record stands for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import xarray as xr

DAY_SECONDS = 86400.0
MONTH_SECONDS = 30.4 * DAY_SECONDS

_UNITS = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": DAY_SECONDS}
_FREQUENCIES = {
    "1hr": 3600.0, "3hr": 3 * 3600.0, "6hr": 6 * 3600.0, "day": DAY_SECONDS, "mon": MONTH_SECONDS,
}  # fmt: skip
_WORDS = (
    (re.compile(r"\bmonth(ly)?[ _-](mean|average)|_p1m-m|\bp1m\b"), MONTH_SECONDS),
    (re.compile(r"\b(daily|day)[ _-](mean|average)|_p1d-m|\bp1d\b"), DAY_SECONDS),
)
HEADINGS = ("title", "id", "source", "product", "comment", "summary", "description")
"""Attributes of a file that say in words what its records are."""

MEAN_WORDS = re.compile(r"\b(month|monthly|day|daily)[ _-](mean|average)|_p1[md]-m", re.I)
"""Words of a heading by which records are means."""
_NAMES = (
    (re.compile(r"p1m-m|_mean_\d{6}(?!\d)|monthly"), MONTH_SECONDS),
    (re.compile(r"p1d-m|_mean_\d{8}(?!\d)|daily"), DAY_SECONDS),
)
_ISO = re.compile(r"^P(?:(\d+)Y)?(?:(\d+)M)?(?:(\d+)W)?(?:(\d+)D)?(?:T(?:(\d+)H)?(?:(\d+)M)?(?:(\d+)S)?)?$")
_ISO_SECONDS = (12 * MONTH_SECONDS, MONTH_SECONDS, 7 * DAY_SECONDS, DAY_SECONDS, 3600.0, 60.0, 1.0)


def stated_interval(raw: xr.Dataset, path: str) -> float:
    """Return the interval (s) that a file states; 0 if it states none.

    Looked at are, in this order: bounds of the time, the attributes ``time_coverage_resolution`` (ISO 8601),
    ``frequency`` (CMIP) and ``delta_t`` (NOAA), headings that say daily or monthly mean, and the name of the file.
    ``cell_methods`` tell that a value is a mean, not over which time.
    """
    ways = (
        _bounds(raw),
        iso_seconds(str(raw.attrs.get("time_coverage_resolution", ""))),
        _FREQUENCIES.get(str(raw.attrs.get("frequency", "")), 0.0),
        _delta(raw),
        _told(" ".join(str(raw.attrs.get(k, "")) for k in HEADINGS), _WORDS),
        _told(Path(path).name, _NAMES),
    )
    return next((seconds for seconds in ways if seconds > 0.0), 0.0)


def _bounds(raw: xr.Dataset) -> float:
    """Return the usual width of the bounds of the time, whatever it is called."""
    for time in raw.variables.values():
        bounds = raw.variables.get(str(time.attrs.get("bounds", "")))
        units = str(time.attrs.get("units", ""))
        unit = units.split(" ")[0].lower().rstrip("s")
        if bounds is None or " since " not in units or time.ndim != 1:
            continue
        if unit in _UNITS and bounds.ndim == 2 and bounds.shape[1] == 2 and bounds.size:
            widths = np.abs(np.diff(np.asarray(bounds.values, float), axis=1))
            return float(np.median(widths)) * _UNITS[unit]
    return 0.0


_NEAR = re.compile(
    r"analysis[ _-]?forecast|_anfc|forecast|near[ _-]real[ _-]time|(?<![a-z])nrt(?![a-z])|operational|interim|preliminary",
    re.I,
)
_PAST = re.compile(r"re-?analysis|multi-?year|hindcast|delayed[ _-]time|(?<![a-z])(my|rep|dt)(?![a-z])", re.I)


def told_kind(raw: xr.Dataset, path: str) -> str:
    """Return a remark where heading or name of a file say that it is an analysis, a forecast or near real time."""
    keys = (
        "title",
        "id",
        "source",
        "product",
        "product_id",
        "processing_level",
        "experiment",
        "summary",
        "field_type",
        "name",
    )
    for text in (*(str(raw.attrs.get(key, "")) for key in keys), Path(path).name):
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


def _delta(raw: xr.Dataset) -> float:
    """Return NOAA's ``delta_t``: year-month-day hour:minute:second."""
    text = str(raw.variables["time"].attrs.get("delta_t", "")) if "time" in raw.variables else ""
    match = re.match(r"^(\d+)-(\d+)-(\d+) (\d+):(\d+):(\d+)", text)
    if match is None:
        return 0.0
    years, months, days, hours, minutes, seconds = map(int, match.groups())
    return float((12 * years + months) * MONTH_SECONDS + days * DAY_SECONDS + 3600 * hours + 60 * minutes + seconds)


def _told(text: str, words: tuple[tuple[re.Pattern[str], float], ...]) -> float:
    return next((seconds for pattern, seconds in words if pattern.search(text.lower())), 0.0)
