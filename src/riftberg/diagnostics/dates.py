"""Dates of observations: how they are written, and where a file keeps them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta
from typing import Any, Final

from riftberg.bergs.outline import DATE_KEYS
from riftberg.config.values import in_utc, nanoseconds
from riftberg.errors import InputError

NAME_KEYS: Final = ("berg", "iceberg", "name", "label", "variable", "outline", "id", "folder", "description")
"""Attributes in whose text a date may stand, such as ``A68A 2020-12-17``."""

_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NUMBERS: Final = re.compile(
    r"(?<!\d)((?:19|20)\d\d)([-_./]?)(0[1-9]|1[0-2])\2(0[1-9]|[12]\d|3[01])"
    r"(?:T(\d\d):?(\d\d)(?::?(\d\d))?Z?|[ _](\d\d):(\d\d)(?::(\d\d))?)?(?!\d)",
    re.IGNORECASE,
)
_WORDS: Final = re.compile(
    rf"(?<!\d)(\d?\d)[-_. ]?({'|'.join(_MONTHS)})[a-z]*[-_., ]*((?:19|20)\d\d)(?!\d)", re.IGNORECASE
)


def minute_text(text: str) -> str:
    """Return an ISO date and time to the minute, as it stands in tables and titles."""
    return text.replace("T", " ")[:16]


def parse_date(text: str, *, where: str = "") -> tuple[datetime, bool]:
    """Read ISO dates with or without time, YYYY/MM/DD, YYYYMMDD and YYYYDDD."""
    try:
        if text.isdigit() and len(text) == 7:
            return _kept(datetime(int(text[:4]), 1, 1) + timedelta(days=int(text[4:]) - 1), where), True
        if text.isdigit() and len(text) == 8:
            return _kept(datetime.strptime(text, "%Y%m%d"), where), True
        if re.match(r"\d{4}/\d\d/\d\d", text):
            text = text.replace("/", "-")
        when = in_utc(datetime.fromisoformat(text.replace("Z", "+00:00")))
    except (ValueError, OverflowError) as error:
        raise InputError(f"{text!r} is not a date", where=where, remedy="Use 2020-12-17 or 2020-12-17T13:00") from error
    return _kept(when, where), len(text) <= 10


def _kept(when: datetime, where: str) -> datetime:
    """Return a date that can be compared with those of a run, which are kept to the nanosecond."""
    nanoseconds(when, where=where)
    return when


def date_in_text(text: str) -> tuple[datetime, bool] | None:
    """Find the date in a name, such as ``a68a_2020-12-17``, ``S1A_EW_20201217T081533`` or ``17 Dec 2020``."""
    dates: set[tuple[datetime, bool]] = set()
    for match in _NUMBERS.finditer(text):
        year, _, month, day, *clock = match.groups()
        hour, minute, second = clock[:3] if clock[0] else clock[3:]
        dates |= _moment(year, month, day, hour, minute, second)
    for match in _WORDS.finditer(text):
        dates |= _moment(match[3], str(_MONTHS.index(match[2].lower()) + 1), match[1], None, None, None)
    return dates.pop() if len(dates) == 1 else None


def _moment(*parts: str | None) -> set[tuple[datetime, bool]]:
    """Return a moment as a set of one; an impossible one gives an empty set."""
    year, month, day, hour, minute, second = (int(part or 0) for part in parts)
    try:
        return {(datetime(year, month, day, hour, minute, second), parts[3] is None)}
    except ValueError:
        return set()


def find_date(
    properties: Mapping[str, Any], names: Iterable[str], *, where: str, stated: str | None = None
) -> tuple[datetime, bool]:
    """Find the date of an outline: in its attributes, in its names, in the name of its file."""
    small = {str(key).lower(): value for key, value in properties.items()}
    for key in DATE_KEYS:
        if small.get(key) not in (None, ""):
            when, day_only = parse_date(_text_of_value(small[key]), where=f"{where}, {key}")
            # The time of day may stand beside the date: acq_time beside acq_date.
            beside = _text_of_value(small.get(key.replace("date", "time"), ""))
            clock = re.fullmatch(r"(\d\d?):(\d\d)(?::(\d\d))?(?: ?UTC| ?Z)?", beside, re.IGNORECASE)
            if not (day_only and clock):
                return when, day_only
            hour, minute, second = (int(part or 0) for part in clock.groups())
            return when + timedelta(hours=hour, minutes=minute, seconds=second), False
    for text in (*(str(small[key]) for key in NAME_KEYS if small.get(key)), *names):
        dated = date_in_text(text)
        if dated is not None:
            return dated
    if stated:
        return parse_date(stated, where="--date")
    has = f"it has {', '.join(map(str, properties))}" if properties else "it has none"
    raise InputError(
        "no date",
        where=where,
        remedy=f"Looked for an attribute {', '.join(DATE_KEYS)} ({has}), and for one date such as 2020-12-17 in its "
        "name and in the name of the file. Add one there, or give --date",
    )


def _text_of_value(value: Any) -> str:
    """Return a value of a table as text; numbers without the point that tables give them."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return str(value).strip()
