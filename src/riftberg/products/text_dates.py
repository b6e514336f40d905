"""Dates that a file writes as text, turned into numbers that xarray decodes; and units of time in plain spelling."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr

from riftberg.products.roles import role_of_name, standard_name

_ISO = re.compile(
    r"^(\d{4})[-/.]?(\d{2})[-/.]?(\d{2})(?:[T _]?(\d{2})(?::?(\d{2})(?::?(\d{2})(?:\.(\d+))?)?)?)?"
    r"\s*(Z|UTC|GMT|[+-]\d{2}:?\d{2})?$"
)
_NAMED = re.compile(r"^(\d{1,2})[- ]([A-Za-z]{3})[a-z]*[- ](\d{4})(?:[ T:](\d{2}):(\d{2})(?::(\d{2}))?)?$")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_SINCE = re.compile(r"^\s*([A-Za-z]+)\s+since\s+(.*?)\s*$", re.I)
_UNITS = {"units": "seconds since 1970-01-01 00:00:00", "calendar": "proleptic_gregorian"}
_MOST = 1_000_000

CALENDARS = (
    "standard", "gregorian", "proleptic_gregorian", "julian", "noleap", "365_day", "all_leap", "366_day", "360_day",
)  # fmt: skip
"""Calendars of CF."""
_CALENDARS = {"gregorianproleptic": "proleptic_gregorian"} | {name.replace("_", ""): name for name in CALENDARS}


def with_text_dates(ds: xr.Dataset) -> xr.Dataset:
    """Return a dataset, decoded or not, with numbers since 1970 in place of texts that are the dates of its fields.

    Text that belongs to a dimension and is no date is noted in ``encoding["texts"]``, by dimension.
    """
    written: dict[str, tuple[tuple[Any, ...], Any, dict[str, Any]]] = {}
    noted: dict[str, str] = dict(ds.encoding.get("texts", {}))
    listed = _listed(ds)
    for name in map(str, ds.variables):
        variable = ds.variables[name]
        if variable.dtype.kind not in "OSU" or not 0 < variable.size <= _MOST or not _says_when(ds, name, listed):
            continue
        dims_and_texts = _texts(variable)
        if dims_and_texts is None or not dims_and_texts[1]:
            continue
        dims, texts = dims_and_texts
        seconds = [_seconds(text) for text in texts]
        if None not in seconds:
            values = np.array(seconds, np.float64)
            kept = {
                key: value for key, value in variable.attrs.items() if key in ("standard_name", "long_name", "axis")
            }
            written[name] = dims, values if dims else values[0], {**kept, **_UNITS}
        elif len(dims) == 1:
            noted[str(dims[0])] = f"{name} begins with {texts[0][:40]!r}"
    encoding = dict(ds.encoding)
    if written:
        coords = [name for name in written if name in ds.coords or name in ds.dims]
        ds = ds.drop_vars(list(written)).assign(written).set_coords(coords)
    ds.encoding = {**encoding, "texts": noted, "written": [*encoding.get("written", ()), *written]}
    return ds


def _listed(ds: xr.Dataset) -> set[str]:
    """Return what the attributes ``coordinates`` name, of the fields and of the file."""
    places = [
        ds.attrs,
        ds.encoding,
        *(v.attrs for v in ds.variables.values()),
        *(v.encoding for v in ds.variables.values()),
    ]
    return {name for place in places for name in str(place.get("coordinates", "")).split()}


def _says_when(ds: xr.Dataset, name: str, listed: set[str]) -> bool:
    declared = name in ds.dims or name in ds.coords or name in listed
    return declared or role_of_name(name) == "time" or standard_name(ds.variables[name]) == "time"


def _texts(variable: xr.Variable) -> tuple[tuple[Any, ...], list[str]] | None:
    """Return dimensions and texts of a variable with one text for each record; None if it holds something else."""
    try:
        values = np.asarray(variable.values)
    except (OSError, RuntimeError, ValueError, UnicodeDecodeError):  # a damaged file; it is told where it matters
        return None
    dims = variable.dims
    while values.dtype == np.dtype("S1") and values.ndim > 1 and values.shape[-1] == 1:  # letters in boxes of one
        values, dims = values[..., 0], dims[:-1]
    if values.dtype == np.dtype("S1") and values.ndim:
        values, dims = np.ascontiguousarray(values).view(f"S{values.shape[-1]}")[..., 0], dims[:-1]
    if values.ndim > 1 or not all(isinstance(value, (str, bytes)) for value in values.ravel().tolist()):
        return None
    plain = [v.decode("latin-1") if isinstance(v, bytes) else v for v in values.ravel().tolist()]
    return dims, [text.strip(" \0") for text in plain]


def _seconds(text: str) -> float | None:
    """Return a date in words as seconds since 1970 (UTC); None if it is none."""
    match, zone = _ISO.match(text), ""
    if match is not None:
        year, month, day, hour, minute, second, fraction, zone = match.groups()
    elif (match := _NAMED.match(text)) is not None and match[2].lower() in _MONTHS:
        day, _, year, hour, minute, second = match.groups()
        month, day, fraction = f"{_MONTHS.index(match[2].lower()) + 1:02d}", f"{int(day):02d}", None
    else:
        return None
    try:
        date = np.datetime64(f"{year}-{month}-{day}T{hour or '00'}:{minute or '00'}:{second or '00'}", "s")
    except ValueError:
        return None
    ahead = 0.0
    if zone and zone[0] in "+-":
        ahead = float(f"{zone[0]}1") * (3600.0 * float(zone[1:3]) + 60.0 * float(zone[-2:]))
    return float(date.astype(np.int64)) + float(f"0.{fraction or 0}") - ahead


def with_plain_time_units(ds: xr.Dataset) -> xr.Dataset:
    """Return a dataset whose units of time read ``hours since DATE`` in a calendar of CF, however they were written."""
    for variable in ds.variables.values():
        units = variable.attrs.get("units")
        match = _SINCE.match(units) if isinstance(units, str) else None
        if match is not None:
            plain = f"{match[1].lower()} since {match[2]}"
            if plain != units:
                variable.attrs["units"] = plain
            written = re.sub(r"[^a-z0-9]", "", str(variable.attrs.get("calendar", "")).lower()).removesuffix("s")
            if written in _CALENDARS:
                variable.attrs["calendar"] = _CALENDARS[written]
    return ds
