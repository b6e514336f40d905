"""Repairs of metadata that xarray does not look at: packing and dates as text, valid values, masks."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.cf import role_by_name, standard_name

VALID = "valid"
"""Attribute that notes which values of a field are valid by its file."""

_PACKING = ("scale_factor", "add_offset")

_SEA, _LAND = ("sea_binary_mask", "sea_area_fraction"), ("land_binary_mask", "land_area_fraction")
"""Standard names of masks: above 0 there is sea, from 1 on there is land alone."""

_WATER = ("water", "sea", "ocean")
"""Words by which masks themselves say that a value stands for the sea."""


_OPEN = re.compile(r"^(open_?|ice_?free_?)?(water|sea|ocean)$|^(ice_?free|no_ice|open)", re.I)
"""Meanings of flags that are values all the same: no ice."""


def with_plain_packing(raw: xr.Dataset, where: str) -> xr.Dataset:
    """Return an undecoded dataset whose scale factors and offsets are numbers, also where the file writes them as text."""
    for name, variable in raw.variables.items():
        for key in _PACKING:
            value = variable.attrs.get(key)
            if isinstance(value, np.ndarray) and value.size > 1:
                raise ForcingError(
                    f"{key} of {name} has {value.size} numbers", where=where,
                    remedy=f"Give one: ncatted -a {key},{name},o,d,NUMBER FILE",
                )  # fmt: skip
            if value is None:
                continue
            correct = f"Correct it: ncatted -a {key},{name},o,d,NUMBER FILE"
            try:
                scale = float(np.ravel(value)[0])
            except ValueError:
                raise ForcingError(
                    f"{key} of {name} is {value[:40]!r}, which is no number", where=where, remedy=correct
                ) from None
            if not np.isfinite(scale) or (scale == 0.0 and key == "scale_factor"):
                raise ForcingError(
                    f"{key} of {name} is {scale:g}, which leaves nothing of its values", where=where, remedy=correct
                )
            if isinstance(value, str):
                variable.attrs[key] = scale
    return raw


def without_land(ds: xr.Dataset, field: xr.DataArray) -> xr.DataArray:
    """Return a field of the sea without the values where a mask of its file says land, which files write as zeros."""
    for name, mask in ds.variables.items():
        if mask.ndim > 1 and set(mask.dims) <= set(field.dims) and (standard := standard_name(mask)) in (*_SEA, *_LAND):
            meaning = _read_meaning(mask)
            of_sea = standard in _SEA if meaning not in (*_WATER, "land") else meaning in _WATER
            field = field.where(ds[name] > 0 if of_sea else ~(ds[name] >= 1))
    return field


def _read_meaning(mask: xr.Variable) -> str:
    """Return the word that a mask itself gives for its value 1, in lower case; empty if it gives none.

    CROCO writes ``option_1 = "water"`` beside the standard name ``land_binary_mask``.
    """
    flags, words = np.ravel(mask.attrs.get("flag_values", ())), str(mask.attrs.get("flag_meanings", "")).split()
    meant = dict(zip(flags.tolist(), words, strict=False)) if flags.dtype.kind in "iuf" else {}
    return str(mask.attrs.get("option_1", meant.get(1, ""))).strip().lower()


def within_valid_range(ds: xr.Dataset) -> xr.Dataset:
    """Return a decoded dataset without the values that its attributes ``valid_min``, ``valid_max``, ``valid_range`` rule out.

    As CF says, limits that are whole numbers beside packed whole numbers are packed too, other limits are not.
    """
    masked: dict[Any, xr.DataArray] = {}
    for name in ds.data_vars:
        limits = _limits(ds[name])
        if limits is not None:
            low, high = limits
            masked[name] = ds[name].where((ds[name] >= low) & (ds[name] <= high))
            masked[name].encoding = ds[name].encoding
            masked[name].attrs = {**ds[name].attrs, VALID: f"{low:.3g} to {high:.3g}"}
    return ds.assign(masked) if masked else ds


def without_flags(original: xr.DataArray, field: xr.DataArray) -> xr.DataArray:
    """Return a field without the values that its original calls flags, of land or no data; open water is a value."""
    flags, words = original.attrs.get("flag_values", ()), str(original.attrs.get("flag_meanings", "")).split()
    flags = re.findall(r"-?\d+(?:\.\d+)?", flags) if isinstance(flags, str) else np.ravel(flags)
    if original.dtype.kind not in "iuf" or np.asarray(flags).dtype.kind not in "iufU":
        return field
    numbers = np.asarray(flags, float)
    if str(original.encoding.get("_Unsigned", "")).lower() == "true":
        numbers = np.where(numbers < 0.0, numbers + 256.0 ** np.dtype(original.encoding["dtype"]).itemsize, numbers)
    scale, offset = (float(original.encoding.get(key, usual)) for key, usual in zip(_PACKING, (1.0, 0.0), strict=True))
    for number, meaning in zip(numbers * scale + offset, [*words, *[""] * numbers.size], strict=False):
        # Packed values lie a step apart, others are flags to the last digit of single precision.
        tolerance = 0.1 * abs(scale) if scale != 1.0 else 1e-6 * abs(number) + 1e-9
        field = field if _OPEN.search(meaning) else field.where(abs(field - number) > tolerance)
    return field


def _limits(field: xr.DataArray) -> tuple[float, float] | None:
    """Return the limits of valid values as decoded, a little wider for round-off; None where the file gives none."""
    if field.dtype.kind != "f":
        return None
    pair = np.ravel(field.attrs.get("valid_range", ()))
    if pair.size != 2:
        pair = np.array([np.ravel(field.attrs.get(key, np.nan))[0] for key in ("valid_min", "valid_max")])
    if pair.dtype.kind not in "iuf" or not np.isfinite(pair.astype(float)).any():
        return None
    low, high = (float(limit) for limit in pair)
    stored = np.dtype(field.encoding.get("dtype", field.dtype)).kind
    limits = [field.attrs[key] for key in ("valid_range", "valid_min", "valid_max") if key in field.attrs]
    # Limits that are whole numbers, as the packed values are, are meant of these.
    if stored in "iu" and all(np.asarray(limit).dtype.kind in "iu" for limit in limits):
        ends = [
            limit * float(field.encoding.get("scale_factor", 1.0)) + float(field.encoding.get("add_offset", 0.0))
            for limit in (low, high)
        ]
        # A negative scale factor turns the limits round.
        low, high = (ends[1], ends[0]) if ends[0] > ends[1] else (ends[0], ends[1])
    elif stored == "f" and "scale_factor" in field.encoding:
        return None  # whether the limits are packed is not told
    low, high = (-np.inf if np.isnan(low) else low), (np.inf if np.isnan(high) else high)
    # Limits in single precision, or packed, do not survive decoding to the last digit.
    slack = 1e-5 * max(abs(limit) for limit in (low, high) if np.isfinite(limit))
    return (low - slack, high + slack) if low < high else None


# Dates that a file writes as text, turned into numbers that xarray decodes; and units of time in plain spelling.


_ISO = re.compile(
    r"^(\d{4})[-/.]?(\d{2})[-/.]?(\d{2})(?:[T _]?(\d{2})(?::?(\d{2})(?::?(\d{2})(?:\.(\d+))?)?)?)?"
    r"\s*(Z|UTC|GMT|[+-]\d{2}:?\d{2})?$"
)
_NAMED = re.compile(r"^(\d{1,2})[- ]([A-Za-z]{3})[a-z]*[- ](\d{4})(?:[ T:](\d{2}):(\d{2})(?::(\d{2}))?)?$")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_SINCE = re.compile(r"^\s*([A-Za-z]+)\s+since\s+(.*?)\s*$", re.I)
_ZONE = re.compile(r"^-?\d+-\d+-\d+(?:[T ]+\d+(?::\d+)*(?:\.\d*)?)?\s*(?!T\d)(\(?[A-Za-z].*)$")
"""A date of reference with letters behind it."""
_SINCE_1970 = {"units": "seconds since 1970-01-01 00:00:00", "calendar": "proleptic_gregorian"}
_MOST = 1_000_000

CALENDARS = (
    "standard", "gregorian", "proleptic_gregorian", "julian", "noleap", "365_day", "all_leap", "366_day", "360_day",
)  # fmt: skip
"""Calendars of CF."""
_CALENDARS = {"gregorianproleptic": "proleptic_gregorian"} | {name.replace("_", ""): name for name in CALENDARS}


def with_text_dates(ds: xr.Dataset, where: str = "") -> xr.Dataset:
    """Return a dataset, decoded or not, with numbers since 1970 in place of texts that are the dates of its fields.

    Text that belongs to a dimension and is no date is noted in ``encoding["texts"]``, by dimension.
    """
    written: dict[str, tuple[tuple[Any, ...], Any, dict[str, Any]]] = {}
    notes: dict[str, str] = dict(ds.encoding.get("texts", {}))
    # The list of coordinates may stand at a variable, at the file, or, decoded already, in an encoding.
    attribute_sets = [ds.attrs, ds.encoding, *(attrs for v in ds.variables.values() for attrs in (v.attrs, v.encoding))]
    listed = {name for attributes in attribute_sets for name in str(attributes.get("coordinates", "")).split()}
    for name in map(str, ds.variables):
        variable = ds.variables[name]
        declared = name in ds.dims or name in ds.coords or name in listed
        says_when = declared or role_by_name(name) == "time" or standard_name(variable) == "time"
        if variable.dtype.kind not in "OSU" or not 0 < variable.size <= _MOST or not says_when:
            continue
        dims_and_texts = _texts(variable)
        if dims_and_texts is None or not dims_and_texts[1]:
            continue
        dims, texts = dims_and_texts
        seconds = [date_in_seconds(text) for text in texts]
        if None not in seconds:
            values = np.array(seconds, np.float64)
            descriptive = {
                key: value for key, value in variable.attrs.items() if key in ("standard_name", "long_name", "axis")
            }
            written[name] = dims, values if dims else values[0], {**descriptive, **_SINCE_1970}
        elif len(dims) == 1:
            notes[str(dims[0])] = f"{name} begins with {texts[0][:40]!r}"
    encoding = dict(ds.encoding)
    if written:
        coords = [name for name in written if name in ds.coords or name in ds.dims]
        ds = ds.drop_vars(list(written)).assign(written).set_coords(coords)
    ds.encoding = {**encoding, "texts": notes, "written": [*encoding.get("written", ()), *written]}
    return ds


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
    # Latin-1 reads any byte; dates have ASCII alone.
    plain = [v.decode("latin-1") if isinstance(v, bytes) else v for v in values.ravel().tolist()]
    return dims, [text.strip(" \0") for text in plain]


def date_in_seconds(text: str) -> float | None:
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


_JULIAN_DAY = re.compile(r"days? since -471(?:3-11-24|2-0?1-0?1)(?:[ T](0?0|12)(?::00)*(?:\.0*)?(?: ?(?:Z|UTC))?)?$")
"""Units of Julian days, by the proleptic Gregorian and the Julian calendar."""

EARLY = re.compile(r"since\s+(-|0{1,4}-)")


def with_plain_time_units(ds: xr.Dataset, where: str) -> xr.Dataset:
    """Return a dataset whose units of time read ``hours since DATE`` in a calendar of CF, however they were written."""
    for name, variable in ds.variables.items():
        units = variable.attrs.get("units")
        match = _SINCE.match(units) if isinstance(units, str) else None
        if match is not None:
            zone = _ZONE.match(match[2])
            if zone is not None and zone[1].strip("() ").lower() not in ("z", "ut", "utc", "gmt"):
                raise ForcingError(  # the decoder leaves names out, and counts UTC+3 westward
                    f"{name} counts {units!r}, in a zone whose distance from UTC is not plain", where=where,
                    remedy=f"Write it in numbers, such as -05:00: ncatted -a units,{name},o,c,'hours since DATE -05:00' FILE",
                )  # fmt: skip
            plain = f"{match[1].lower()} since {match[2]}"
            if (day := _JULIAN_DAY.match(plain)) is not None and variable.dtype.kind in "iuf":
                first = 2400000.5 + (12 - int(day[1] or 0)) / 24.0
                attributes = {key: value for key, value in variable.attrs.items() if key != "calendar"}
                ds = ds.assign(
                    {name: (variable.dims, variable.values - first, {**attributes, "units": "days since 1858-11-17"})}
                )
                continue
            if EARLY.search(plain):  # years before 1 are counted in two ways, and libraries take one of them
                plain += " BC"
            if plain != units:
                variable.attrs["units"] = plain
            # "Gregorian", "gregorian_proleptic" and "365 days" name calendars of CF too.
            written = re.sub(r"[^a-z0-9]", "", str(variable.attrs.get("calendar", "")).lower()).removesuffix("s")
            if written in _CALENDARS:
                variable.attrs["calendar"] = _CALENDARS[written]
    return ds


def without_unwritten_dates(ds: xr.Dataset, where: str) -> xr.Dataset:
    """Make those dates and bounds of dates missing that were never written, whether the file says so or not.

    Files announce records and leave the fill value of the library in their dates; others write -9999.
    """
    counted = [n for n, v in ds.variables.items() if " since " in str(v.attrs.get("units", "")) and v.ndim <= 1]
    bounds = [ds.variables[n].attrs.get("bounds", "") for n in counted]
    for name in [n for n in (*counted, *bounds) if n in ds.variables]:
        variable = ds.variables[name]
        if variable.dtype.kind not in "iuf" or not 0 < variable.size <= _MOST or "scale_factor" in variable.attrs:
            continue
        values = np.asarray(variable.values)
        lost = _unwritten(values)
        if lost.any():
            attributes = {key: value for key, value in variable.attrs.items() if key not in _FILLS}
            declared = [np.ravel(variable.attrs[key])[0] for key in _FILLS if key in variable.attrs]
            dates = np.where(lost | np.isin(values, declared), np.nan, values.astype(float))
            ds = ds.assign({name: (variable.dims, dates, attributes)})
    return ds


_FILLS = ("_FillValue", "missing_value")


def _unwritten(values: Any) -> Any:
    """Tell which numbers are fill values of libraries, or rows of nines out of the order of the others."""
    if values.dtype.kind == "f":
        lost = np.abs(values) > 1e19  # nanoseconds of our age are 1e18
    else:
        limits = np.iinfo(values.dtype)
        fills = [limits.min + k if limits.min else limits.max - k for k in range(3)]
        lost = np.isin(values, fills) & (values.dtype.itemsize >= 4)
    if values.ndim == 1:
        nines = np.isin(np.abs(values), [10**digits - 1 for digits in range(3, 16)])
        steps, sound = np.diff(values[~lost]), np.diff(values[~(lost | nines)])
        if nines.any() and sound.size and (sound > 0).all() and not (steps > 0).all():
            lost |= nines
    return lost


def with_scalar_mappings(ds: xr.Dataset, where: str = "") -> xr.Dataset:
    """Return a dataset whose grid mappings are scalars: their values mean nothing, and some programs write text there."""
    listed = " ".join(
        str(v.attrs.get("grid_mapping", v.encoding.get("grid_mapping", ""))) for v in ds.variables.values()
    )
    mappings = [
        name for name, v in ds.variables.items()
        if v.ndim and name not in ds.dims and "grid_mapping" not in v.attrs
        and (str(name) in re.split(r"[\s:]+", listed) or ("grid_mapping_name" in v.attrs and v.dtype.kind in "SUO"))
    ]  # fmt: skip
    if not mappings:
        return ds
    encoding = {**ds.encoding, "written": [*ds.encoding.get("written", ()), *mappings]}
    ds = ds.drop_vars(mappings).assign({name: ((), 0, ds.variables[name].attrs) for name in mappings})
    ds.encoding = encoding
    return ds


def without_false_fill(raw: xr.Dataset, where: str) -> xr.Dataset:
    """Drop a NaN fill value from integer variables: it can never occur in them and stops the decoding."""
    for variable in raw.variables.values():
        fill = variable.attrs.get("_FillValue")
        if variable.dtype.kind in "iu" and isinstance(fill, (float, np.floating)) and np.isnan(fill):
            variable.attrs.pop("_FillValue")
    return raw


# Texts become numbers with units of time before these units are put in order.
REPAIRS = (
    with_plain_packing, with_scalar_mappings, with_text_dates, with_plain_time_units, without_false_fill,
    without_unwritten_dates,
)  # fmt: skip
"""What is repaired in an undecoded file before xarray decodes it; each takes the dataset and its place in messages."""
