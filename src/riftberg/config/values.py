"""Values as people give them, in Python, in files and on the command line: one check and one wording for all.

A parameter, a key of an experiment file and an argument of a constructor are each described by a field: kind, unit, limits,
meaning. What is given for it may be a number, a text with a unit (``"25 kPa"``), a number of NumPy or pandas, a date as
text. Here it becomes the plain value, or is refused in a sentence that says what is allowed.
"""

from __future__ import annotations

import re
import types
from collections.abc import Mapping
from datetime import UTC, date, datetime, timedelta
from functools import cache
from typing import Annotated, Any, ClassVar, Final, NamedTuple, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from riftberg.config.units import looks_like_quantity, to_unit
from riftberg.errors import InputError, nearest, together, visible
from riftberg.system.input_files import value_shown

DATE_REMEDY: Final = "Write it like 2020-12-09 13:00"

SOUTHERNMOST, NORTHERNMOST = -86.0, 88.0
"""Latitudes (degrees) between which there is sea, and a berg of an experiment file can be placed."""


Place = tuple[str | int, ...]
"""Names of keys and numbers of list items on the way to a value."""


class UnfitError(ValueError):
    """A value that a field cannot hold."""

    def __init__(self, what: str, remedy: str = "", *, where: str = "") -> None:
        self.what, self.remedy, self.where = what, remedy, where  # the field says where, unless it is stated
        super().__init__(what)


def in_utc(moment: datetime) -> datetime:
    """Return a date as UTC without zone."""
    try:
        return moment if moment.tzinfo is None else moment.astimezone(UTC).replace(tzinfo=None)
    except OverflowError as error:
        raise ValueError(f"{moment} lies outside the years 1 to 9999 in UTC") from error


def finding_text(finding: Any) -> str:
    """Return a finding of pydantic in our words: its own ("Input should be ...") are for programmers."""
    kind = finding["type"]
    if kind == "value_error":
        return str(finding["ctx"]["error"])
    if kind == "missing":
        return "this key is missing" if isinstance(finding["loc"][-1], str) else "a number is missing"
    return f"{value_shown(finding['input'])} is {'no finite number' if kind == 'finite_number' else 'not possible'}"


def field_extra(field: FieldInfo, name: str) -> Any:
    """Return something else that is said of a field, such as its usual range; None where nothing is."""
    extra = field.json_schema_extra
    return extra.get(name) if isinstance(extra, dict) else None


def field_unit(field: FieldInfo) -> str:
    """Return the unit of a field, empty where it has none."""
    return str(field_extra(field, "unit") or "")


def section_fields(section: Any) -> dict[str, FieldInfo]:
    """Return the fields of a section: a model or a dataclass of pydantic."""
    fields: dict[str, FieldInfo] = section.__pydantic_fields__
    return fields


def nested_sections(annotation: Any) -> list[Any]:
    """Return the sections that an annotation names, also as items of lists."""
    if hasattr(annotation, "__pydantic_fields__"):
        return [annotation]
    return [section for argument in get_args(annotation) for section in nested_sections(argument)]


def value_kinds(annotation: Any) -> tuple[Any, ...]:
    """Return the alternatives of an annotation, without None and without checks."""
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(
            kind for argument in get_args(annotation) for kind in value_kinds(argument) if kind is not type(None)
        )
    return value_kinds(get_args(annotation)[0]) if get_origin(annotation) is Annotated else (annotation,)


def native(value: Any) -> Any:
    """Return numbers, dates and lists of NumPy, pandas and xarray as plain values of Python.

    Texts, paths and everything else pass unchanged.

    Examples
    --------
    >>> import numpy as np
    >>> native(np.float32(2.0)), native(np.array([1, 2]))
    (2.0, [1, 2])
    >>> native(np.datetime64("2020-12-09T13"))
    datetime.datetime(2020, 12, 9, 13, 0)

    """
    if isinstance(value, np.datetime64):
        moment = value.astype("datetime64[us]").item()
        return moment if isinstance(moment, datetime) else value
    if isinstance(value, datetime) and type(value) is not datetime:  # a Timestamp of pandas
        return value.to_pydatetime(warn=False) if hasattr(value, "to_pydatetime") else value
    if isinstance(value, np.timedelta64):
        return value.astype("timedelta64[us]").item()
    if isinstance(value, timedelta) and type(value) is not timedelta:  # a Timedelta of pandas
        return timedelta(seconds=value.total_seconds())
    if isinstance(value, np.generic):
        return value.item()
    if hasattr(value, "__array__") and not isinstance(value, type):
        array = np.asarray(value)
        return native(array[()]) if array.ndim == 0 else [native(item) for item in array]
    if type(value) is tuple or type(value) is list:
        return type(value)(native(item) for item in value)
    return value


def plain_value(value: Any, field: FieldInfo, *, metres: bool = False) -> Any:
    """Return a value as its field takes it: no units, plain kinds, one section as a list of one.

    ``metres``: places are x and y in m, not longitude and latitude.
    """
    value, kinds = native(value), value_kinds(field.annotation)
    # What would silently pass for something else: true for 1, a number for a date, a section for a value.
    if isinstance(value, dict) and not all(isinstance(name, str) for name in value):
        raise UnfitError("a key that is no word", "Keys are plain words, such as fracture")
    for item in value if isinstance(value, list | tuple) else [value]:
        if isinstance(item, bool) and not any(kind in (bool, Any) for kind in kinds):
            raise UnfitError(f"{str(item).lower()} is no number, word or date", allowed(field))
        if isinstance(item, str) and visible(item) != item:
            raise UnfitError(f"control characters stand in {visible(item[:60])!r}", "Remove them")
    if datetime in kinds and isinstance(value, str) and (str not in kinds or _DATED.match(value)):
        try:
            return parse_date(value.strip(), model_years=True)[0]
        except InputError as error:
            raise UnfitError(error.what, f"{allowed(field)}. {error.remedy}") from error
    if datetime in kinds and not isinstance(value, date):
        raise UnfitError(f"{value_shown(value)} is not a date", f"{allowed(field)}. {DATE_REMEDY}")
    if isinstance(value, date) and datetime not in kinds:
        raise UnfitError(f"{value} is a date", f"{allowed(field)}. Write it in quotes if it is meant as a text")
    try:
        return _without_unit(value, field, metres)
    except UnfitError:
        raise
    except ValueError as error:
        raise UnfitError(str(error), allowed(field, metres=metres)) from error


def _without_unit(value: Any, field: FieldInfo, metres: bool) -> Any:
    kinds = value_kinds(field.annotation)
    lists = [kind for kind in kinds if get_origin(kind) is list]
    if isinstance(value, dict | str) and any(nested_sections(kind) or get_args(kind) == (str,) for kind in lists):
        value = [value]
    elif lists == list(kinds) and nested_sections(lists[0]) and not isinstance(value, list | tuple):
        keys = ", ".join(section_fields(nested_sections(lists[0])[0]))
        raise UnfitError(f"{value_shown(value)} is no section and no list of sections", f"Each has the keys {keys}")
    if isinstance(value, list | tuple):
        if lists:
            return value  # names of files or of parts, and rows of whole numbers, carry no units
        units = _item_units(field, len(value), metres)
        return [_number(item, field, *unit) for item, unit in zip(value, units, strict=True)]
    if isinstance(value, timedelta):
        return to_unit(f"{value.total_seconds()!r} s", field_unit(field))
    if not isinstance(value, str):
        return value
    if str in kinds:  # a name; where a number may stand too (a thickness), what begins like one is one
        return _number(value, field, field_unit(field)) if float in kinds and looks_like_quantity(value) else value
    if type(None) in get_args(field.annotation) and value.lower() in words_for_nothing(field):
        return None
    if bool in kinds:
        return _flag(value)
    if any(get_origin(kind) is tuple for kind in kinds):
        return _without_unit(value.strip("()[] ").split(","), field, metres)
    if float in kinds or int in kinds:
        return _number(value, field, field_unit(field), "NS" if "latitude" in (field.description or "") else "")
    return value


def words_for_nothing(field: FieldInfo) -> tuple[str, ...]:
    """Words that leave a field to the others, the usual one first; "none" may be a choice of its own."""
    choices = [choice for kind in value_kinds(field.annotation) for choice in get_args(kind)]
    return ("auto", "null", "") if "none" in choices else ("none", "null", "auto", "")


def _item_units(field: FieldInfo, size: int, metres: bool) -> list[tuple[str, str]]:
    """Return the unit of each of several numbers, and the letters that may stand behind it."""
    units = field_extra(field, "units")
    if units and len(units) == size:  # velocity and thickness of sea ice
        return [(unit, "") for unit in units]
    if metres and field_extra(field, "place"):
        return [("m", "")] * size
    letters = _COMPASS.get(size) if field_unit(field) == "degree" else None
    return [(field_unit(field), letter) for letter in letters or ("",) * size]


def _flag(text: str) -> bool:
    words = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(f"{value_shown(text)} is neither true nor false")
    return words[text.lower()]


def flag(value: Any, *, where: str, kind: type[InputError] = InputError) -> bool:
    """Return true or false, also from the words that a file may have for it."""
    plain = native(value)
    try:
        if isinstance(plain, str):
            return _flag(plain)
    except ValueError as error:
        raise kind(str(error), where=where, remedy="Allowed: true or false") from error
    if not isinstance(plain, bool):
        raise kind(f"{value_shown(plain)} is neither true nor false", where=where, remedy="Allowed: true or false")
    return plain


_COMPASS: Final = {2: ("EW", "NS"), 4: ("EW", "EW", "NS", "NS")}
"""Letters behind longitudes and latitudes: of a place, and of west, east, south and north."""

_LETTERED: Final = re.compile(r"\s*(\d+\.?\d*)\s*(?:°|deg|degrees?)?\s*([NSEW])\s*$")


def _number(text: Any, field: FieldInfo, unit: str, letters: str = "") -> Any:
    """Return the number that a text means; ``letters`` may stand behind it for its sign, as in 56 S."""
    if not isinstance(text, str):
        return text
    lettered = _LETTERED.match(text) if letters else None
    if lettered is not None:
        if lettered[2] not in letters:
            kinds = ("latitude", "longitude") if letters == "EW" else ("longitude", "latitude")
            raise ValueError(f"{text!r} is a {kinds[0]} where a {kinds[1]} belongs: longitude stands first")
        return float(lettered[1]) * (-1.0 if lettered[2] in "SW" else 1.0)
    if not looks_like_quantity(text):
        raise ValueError(f"{value_shown(text)} is not a number")
    number = to_unit(text, unit)
    return int(number) if int in value_kinds(field.annotation) and number.is_integer() else number


def allowed(field: FieldInfo, *, metres: bool = False) -> str:
    """Return in words the values that a field may hold."""
    limits = []
    for item in field.metadata:
        for name, sign in (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<=")):
            limit = getattr(item, name, None)
            if limit is not None:
                limits.append(f"{sign} {limit:g}")
        if most := getattr(item, "max_length", None):
            limits.append(f"of at most {most} letters")
        if getattr(item, "min_length", None):
            limits.append("not empty")
    kinds = [_kind_name(kind) for kind in value_kinds(field.annotation)]
    text = "Allowed: " + " or ".join(kinds) + (" " + " and ".join(limits) if limits else "")
    unit = "m" if metres and field_extra(field, "place") else field_unit(field)
    text += f", in {unit}" if unit not in ("", "1") else ""
    text += f" or {words_for_nothing(field)[0]}" if type(None) in get_args(field.annotation) else ""
    # What follows a semicolon is about special cases, which are hard to read in brackets.
    return text + (f" ({field.description.split(';')[0]})" if field.description else "")


def _kind_name(kind: Any) -> str:
    plain = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", datetime: "a date"}
    if kind in plain:
        return plain[kind]
    if get_origin(kind) is tuple:
        return "numbers" if ... in get_args(kind) else f"{len(get_args(kind))} numbers"
    if get_origin(kind) is list:
        return "a list"
    if get_origin(kind) is dict or hasattr(kind, "__pydantic_fields__"):
        return "keys with values"
    options = [repr(option) for option in get_args(kind)]
    return ", ".join(options) if options else str(getattr(kind, "__name__", kind))


def given(
    value: Any, section: Any, name: str, *, where: str = "", kind: type[InputError] = InputError, metres: bool = False
) -> Any:
    """Return a value as the field ``name`` of a section holds it."""
    try:
        return _adapter(section, name).validate_python(value, context={"metres": metres})
    except ValidationError as error:
        finding = error.errors()[0]
        field = section_fields(section)[name]
        text, remedy = finding_text(finding), allowed(field, metres=metres)
        if finding["type"] == "value_error":
            remedy = getattr(finding["ctx"]["error"], "remedy", "")
        elif finding["type"] != "finite_number":
            text = f"{value_shown(plain_value(value, field, metres=metres))} is not possible"
        raise kind(text, where=where or name, remedy=remedy) from error


@cache
def _adapter(section: Any, name: str) -> TypeAdapter[Any]:
    field = section_fields(section)[name]

    def plain(value: Any, info: ValidationInfo) -> Any:
        return plain_value(value, field, metres=in_metres(info))

    annotation: Any = Annotated[(field.annotation, *field.metadata, BeforeValidator(plain))]
    inner = isinstance(field.annotation, type) and bool(nested_sections(field.annotation))  # it has a config of its own
    return TypeAdapter(annotation, config=None if inner else {"allow_inf_nan": False})


def in_metres(info: ValidationInfo) -> bool:
    """Whether places are x and y in m where a value is checked."""
    return bool((info.context or {}).get("metres"))


def says_metres(latlon: Any) -> bool:
    """Whether an argument ``latlon`` says that places are metres; a value neither true nor false is refused in its turn."""
    try:
        return latlon is not None and not flag(latlon, where="latlon")
    except InputError:
        return False


def findings(error: ValidationError, section: Any, *, metres: bool = False) -> list[tuple[Place, InputError]]:
    """Return the findings of pydantic in a section, in our words, each with its place.

    Consequences of another fault are left out: of an entry that may be a text or a section, the fault of the
    section says more: it lies deeper, or is a sentence of ours; a key that is misspelt is not missing too.
    """
    errors: dict[int, tuple[Place, InputError]] = {}
    reported: list[Place] = []
    deepest = sorted(
        enumerate(error.errors()),
        key=lambda item: (-len(item[1]["loc"]), item[1]["type"] == "missing", item[1]["type"] != "value_error"),
    )
    for number, finding in deepest:
        unknown = finding["type"] in ("extra_forbidden", "unexpected_keyword_argument")
        path, inner, field = _locate_finding(finding["loc"], section, unknown=unknown)
        text, remedy = finding_text(finding), "" if field is None else allowed(field, metres=metres)
        if finding["type"] == "value_error":
            remedy = getattr(finding["ctx"]["error"], "remedy", "")
        elif unknown:
            text, remedy, suggested = _unknown(path, inner, section)
            reported += suggested
        elif (
            finding["type"] == "literal_error"
            and (elsewhere := absent_key(inner, f"{path[-1]} = {finding['input']!r}"))[0]
        ):
            text, remedy = elsewhere
        elif field is not None and finding["type"].startswith("union_tag"):
            sections = nested_sections(field.annotation)
            kinds = [kind for branch in sections for kind in get_args(section_fields(branch)["kind"].annotation)]
            value = finding["input"].get("kind") if isinstance(finding["input"], dict) else None
            text = f"kind = {value_shown(value)} is not known" if value else "the kind of forcing is missing"
            remedy = f"{nearest(str(value), kinds)}Use kind: {', '.join(kinds)}"
            path = (*path, "kind")
        if any(other[: len(path)] == path or path[: len(other)] == other for other in reported):
            continue
        reported.append(path)
        errors[number] = path, InputError(text, where=".".join(map(str, path)), remedy=remedy)
    return [errors[number] for number in sorted(errors)]


def _locate_finding(
    loc: tuple[str | int, ...], section: Any, *, unknown: bool = False
) -> tuple[Place, Any, FieldInfo | None]:
    """Return the place of a finding without pydantic's names of alternatives, the section around it, and its field."""
    path: Place = ()
    sections, inner, field = [section], section, None
    remaining = list(loc)
    while remaining:
        entry = remaining.pop(0)
        holder = next((branch for branch in sections if entry in _named_fields(branch)), None)
        if isinstance(entry, int):
            path = (*path, entry)
        elif holder is not None:
            inner, field, path = holder, _named_fields(holder)[entry], (*path, entry)
            sections = nested_sections(field.annotation)
            if field.discriminator and remaining:  # the next one is the kind, not a key
                kind = remaining.pop(0)
                sections = [
                    branch for branch in sections if kind in get_args(section_fields(branch)["kind"].annotation)
                ]
        elif unknown and not remaining and sections:  # the key that is not known
            return (*path, entry), sections[0], None
    return path, inner, field


def _named_fields(section: Any) -> dict[str, FieldInfo]:
    """Return the fields of a section by the names that a person gives them."""
    return {field.alias or name: field for name, field in section_fields(section).items()}


def absent_key(section: Any, name: str) -> tuple[str, str]:
    """Return why a section has no such key any more, or where it is, and the remedy; empty for any other name."""
    if replacement := getattr(section, "_gone", {}).get(name):
        return "there is no such parameter any more", replacement
    return getattr(section, "_foreign", {}).get(name, ""), ""


def _unknown(path: Place, section: Any, outer: Any) -> tuple[str, str, list[Place]]:
    """Say that a key is not known, and return the places that may have been meant by it."""
    names = [name for name, field in _named_fields(section).items() if not field_extra(field, "hidden")]
    why, replacement = absent_key(section, str(path[-1]))
    if why:
        return why, replacement, []
    text, has = getattr(section, "_unknown_key", ("there is no such key", "Allowed here: "))
    hint = nearest(str(path[-1]), names)
    holder = str(path[-2]) if len(path) > 1 else section.__name__
    suggested = [(*path[:-1], name) for name in names if repr(name) in hint]
    return text, f"{hint}{has.format(holder)}{', '.join(names)}", suggested


def explained(
    error: ValidationError, section: Any, *, name: str = "", kind: type[InputError] = InputError, metres: bool = False
) -> InputError:
    """Return the findings of pydantic in a section as one error, each place below the section's name."""
    faults = []
    for path, fault in findings(error, section, metres=metres):
        where = ".".join([*([name] if name and path else []), *map(str, path)])
        faults.append(kind(fault.what, where=where, remedy=fault.remedy))
    return together(faults)


def required(
    value: Any, kinds: type | tuple[type, ...], expected: str, *, where: str, kind: type[InputError] = InputError
) -> None:
    """Refuse an argument of another kind than is wanted, in words."""
    if not isinstance(value, kinds) or isinstance(value, bool):
        raise kind(f"{value_shown(value)} cannot be used here", where=where, remedy=f"Give {expected}")


def check_names(options: Mapping[str, Any], kind: type, *also: str) -> None:
    """Refuse arguments by name that a typed dict of options (and ``also``) does not list, as Python does for a function.

    Examples
    --------
    >>> from typing import TypedDict
    >>> class Size(TypedDict, total=False):
    ...     length: float
    >>> check_names({"lenght": 2.0}, Size)
    Traceback (most recent call last):
    TypeError: unexpected keyword argument 'lenght'. Did you mean 'length'? It may be length

    """
    names = (*also, *kind.__annotations__)
    for name in options:
        if name not in names:
            raise TypeError(f"unexpected keyword argument {name!r}. {nearest(name, names)}It may be {', '.join(names)}")


def moment(value: Any, *, where: str) -> datetime:
    """Return a date as UTC without zone: from a date, a text, a datetime64 or a Timestamp.

    Examples
    --------
    >>> moment("2020-12-09 13:00", where="start")
    datetime.datetime(2020, 12, 9, 13, 0)

    """
    plain = native(value)
    if isinstance(plain, str):
        return parse_date(plain.strip(), where=where, model_years=True)[0]
    if not isinstance(plain, date) or plain != plain:  # NaT differs from itself
        raise InputError(f"{value_shown(value)} is not a date", where=where, remedy=DATE_REMEDY)
    if not isinstance(plain, datetime):
        return datetime(plain.year, plain.month, plain.day)
    try:
        return in_utc(plain)
    except ValueError as error:
        raise InputError(str(error), where=where, remedy=DATE_REMEDY) from error


def parse_date(text: str, *, where: str = "", model_years: bool = False) -> tuple[datetime, bool]:
    """Read ISO dates with or without time, YYYY/MM/DD, YYYYMMDD and YYYYDDD; tell whether it is a day alone."""
    day_only = True
    try:
        if text.isdigit() and len(text) == 7:
            when = datetime(int(text[:4]), 1, 1) + timedelta(days=int(text[4:]) - 1)
            if when.year != int(text[:4]):
                fault = f"{text!r}: {text[:4]} has no day {int(text[4:])}"
                raise InputError(fault, where=where, remedy="Write the year and its day, such as 2020352")
        elif text.isdigit() and len(text) == 8:
            when = datetime.strptime(text, "%Y%m%d")
        else:
            plain = text.replace("/", "-") if re.match(r"\d{4}/\d\d/\d\d", text) else text
            hours = _HOURS.fullmatch(plain)
            if hours is not None:  # "6:00", "06:00 UTC", "09:00 +03:00"
                day, hour, rest, zone = hours.groups(default="")
                plain = (
                    f"{day}T{int(hour):02d}{rest or ':00'}{'+00:00' if zone.upper() in ('Z', 'UTC', 'GMT') else zone}"
                )
            when, day_only = datetime.fromisoformat(plain), len(plain) <= 10
    except (ValueError, OverflowError) as error:
        raise InputError(f"{value_shown(text)} is not a date", where=where, remedy=DATE_REMEDY) from error
    when = moment(when, where=where)
    if not model_years:  # it must be comparable with the dates of a run, which are kept so
        nanoseconds(when, where=where)
    return when, day_only


_DATED: Final = re.compile(r"\s*\d{4}[-/]\d\d[-/]\d\d(\D|$)")
_HOURS: Final = re.compile(
    r"(\d{4}-\d\d-\d\d)(?:\s*T\s*|\s+)(\d{1,2})(:\d\d(?::\d\d(?:[.,]\d+)?)?)?\s*(Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?",
    re.IGNORECASE,
)
"""A day and a time on it as people write them; other forms of ISO 8601 are left to Python."""

FIRST_YEAR: Final = 1678
LAST_YEAR: Final = 2261
"""Whole years that dates to the nanosecond, as xarray keeps them, can hold; numpy turns others into years of these."""


def nanoseconds(
    dates: Any, *, where: str, kind: type[InputError] = InputError, remedy: str = "Give dates of these years"
) -> NDArray[np.datetime64]:
    """Return dates as ``datetime64[ns]``; refuse years that would come back as others.

    Examples
    --------
    >>> nanoseconds(["2020-12-09T13"], where="time")
    array(['2020-12-09T13:00:00.000000000'], dtype='datetime64[ns]')

    """
    moments = np.asarray(dates)
    moments = moments if moments.dtype.kind == "M" else moments.astype("datetime64[us]")
    years = moments.astype("datetime64[Y]").astype(np.int64) + 1970
    beyond = ~np.isnat(moments) & ((years < FIRST_YEAR) | (years > LAST_YEAR))
    if beyond.any():
        wrong = moments[beyond].ravel()
        summary = (
            f"{wrong.size} of {moments.size} dates, the first {wrong[0]}, lie"
            if moments.size > 1
            else f"{wrong[0]} lies"
        )
        raise kind(
            f"{summary} outside the years {FIRST_YEAR} to {LAST_YEAR} that dates can be kept in", where=where,
            remedy=remedy,
        )  # fmt: skip
    return moments.astype("datetime64[ns]")


def check_degrees(
    position: tuple[float, float], *, where: str = "", kind: type[InputError] | type[UnfitError] = UnfitError
) -> None:
    """Refuse two numbers that cannot be degrees of longitude and latitude."""
    if not (abs(position[0]) <= 540.0 and abs(position[1]) <= 180.0):
        raise kind(
            f"{list(position)} is no longitude and latitude in degrees", where=where, remedy="Longitude stands first"
        )


def check_place(
    position: tuple[float, float], *, where: str = "", kind: type[InputError] | type[UnfitError] = UnfitError,
    south: float = -90.0, north: float = 90.0,
) -> None:  # fmt: skip
    """Refuse a place that is none on Earth, where only swapped coordinates put a berg.

    ``position``: longitude and latitude, degrees.
    """
    check_degrees(position, where=where, kind=kind)
    if not south <= position[1] <= north:
        raise kind(
            f"latitude {position[1]:g} has no sea for a berg: are longitude and latitude swapped?", where=where,
            remedy=f"Write [longitude, latitude], with a latitude from {south:g} to {north:g}",
        )  # fmt: skip


def number(value: Any, unit: str, *, where: str, kind: type[InputError] = InputError) -> float:
    """Return one number in a unit; a text with a unit and numbers of NumPy are taken."""
    try:
        return _parse_number(value, unit)
    except ValueError as error:
        measured = f", in {unit}" if unit not in ("", "1") else ""
        raise kind(str(error), where=where, remedy=f"Allowed: a number{measured}") from error


def duration(value: Any, *, where: str, kind: type[InputError] = InputError) -> float:
    """Return a length of time in seconds, 0 or more; a text with a unit and a timedelta are taken."""
    seconds = number(value, "s", where=where, kind=kind)
    if not seconds >= 0.0:
        raise kind(f"{value_shown(value)} is no length of time", where=where, remedy="Give 0 s or more")
    return seconds


def numbers(value: Any, unit: str, *, where: str, kind: type[InputError] = InputError) -> np.ndarray[Any, Any]:
    """Return a number or an array of numbers in a unit, NaN where masked; texts with units, Series and DataArrays are taken."""
    try:
        if isinstance(value, str):
            return np.asarray(_parse_number(value, unit))
        try:
            array = np.asarray(value)
        except ValueError:  # of NumPy: rows of different lengths
            raise ValueError(f"{value_shown(value)} is no array of numbers") from None
        if array.dtype.kind in "OUS":
            array = np.array([_parse_number(item, unit) for item in array.ravel().tolist()]).reshape(array.shape)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"{value_shown(value)} is no number")
        floats = array.astype(np.float64)
        if isinstance(value, np.ma.MaskedArray):
            floats[np.ma.getmaskarray(value)] = np.nan
        return floats
    except ValueError as error:
        measured = f", in {unit}" if unit not in ("", "1") else ""
        raise kind(str(error), where=where, remedy=f"Allowed: a number or an array of numbers{measured}") from error


def _parse_number(value: Any, unit: str) -> float:
    plain = native(value)
    if isinstance(plain, str):
        return to_unit(plain, unit)
    if isinstance(plain, timedelta):
        return to_unit(f"{plain.total_seconds()!r} s", unit)
    if isinstance(plain, bool) or not isinstance(plain, int | float):
        raise ValueError(f"{value_shown(plain)} is no number")
    return float(plain)


# Sections of what users set, in files and in Python alike: keys with a default, a unit, a meaning and limits.


class Usual(NamedTuple):
    """Smallest and largest usual value, their unit where no field has it, and where the range comes from.

    A value of 0 that leaves a law out (``off``) is as usual.
    """

    low: float
    high: float
    source: str
    unit: str = ""
    off: bool = False


Pair = tuple[float, float]


class Section(BaseModel):
    """Base of all sections: values may carry units, unknown keys are refused, numbers are finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such key", "Allowed here: ")

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, values: Any) -> Any:
        """Take the name of a file for a section with nothing else (``outline: berg.geojson``)."""
        fields = section_fields(cls)
        if isinstance(values, str) and "file" in fields and values not in fields:
            return {"file": values}
        if not isinstance(values, dict | cls):
            raise cls._no_section(values)
        return {str(name): value for name, value in values.items()} if isinstance(values, dict) else values

    @classmethod
    def _no_section(cls, value: Any) -> UnfitError:
        """Return the refusal of a value that is no section."""
        return UnfitError(f"{value_shown(value)} is not a section", f"It has the keys {', '.join(section_fields(cls))}")

    @field_validator("*", mode="before")
    @classmethod
    def _plain(cls, value: Any, info: ValidationInfo) -> Any:
        return plain_value(value, section_fields(cls)[str(info.field_name)], metres=in_metres(info))


def about(unit: str, meaning: str, **options: Any) -> Any:
    """Describe an argument whose default stands behind it: unit, meaning, limits, and what `key` has under ``extra``."""
    return key(PydanticUndefined, unit, meaning, **options)


def key(default: Any, unit: str, meaning: str, **options: Any) -> Any:
    """Describe one key of a section: default and what `about` takes."""
    extra: dict[str, Any] = {
        name: options.pop(name)
        for name in ("place", "units", "hidden", "source", "usual", "kernel", "trial", "quirk")
        if name in options
    }
    return Field(default, description=meaning, json_schema_extra={"unit": unit, **extra}, **options)


PLACE: dict[str, Any] = {"place": True}
"""Marks a key as a place: longitude and latitude, or x and y in m where positions are metres."""


def _sea(position: Pair, info: ValidationInfo) -> Pair:
    if not in_metres(info):
        check_place(position)
    return position


Position = Annotated[Pair, AfterValidator(_sea)]
"""A place, which no swapped longitude and latitude can be."""


def _shift_in_degrees(shift: Pair) -> Pair:
    check_degrees(shift)
    return shift


Shift = Annotated[Pair, AfterValidator(_shift_in_degrees)]


def at_most(limit: float, unit: str) -> AfterValidator:
    """Return the check of one value, or each of several, against a limit that nothing in nature exceeds."""

    def check(value: Any) -> Any:
        if any(abs(item) > limit for item in (value if isinstance(value, tuple) else (value,))):
            raise UnfitError(f"{value} is not possible; the most is {limit:g} {unit}")
        return value

    return AfterValidator(check)


# Faster than any current, wind or ice that was ever measured: a slip of units, or km/h taken for m/s.
Velocity = Annotated[Pair, at_most(10.0, "m s-1")]
Wind = Annotated[Pair, at_most(150.0, "m s-1")]
# A metre in a hundred: 1e-5 is steep for a current.
SurfaceSlope = Annotated[Pair, at_most(0.01, "m m-1")]


def _thick(ice: tuple[float, float, float]) -> tuple[float, float, float]:
    if ice[2] < 0.0:
        raise UnfitError(f"sea_ice has a thickness of {ice[2]:g} m; it is 0 or more")
    return ice


SeaIce = Annotated[tuple[float, float, float], at_most(100.0, "m s-1 and m"), AfterValidator(_thick)]
"""Eastward and northward velocity, and thickness."""

ICE_UNITS: dict[str, Any] = {"units": ["m s-1", "m s-1", "m"]}
