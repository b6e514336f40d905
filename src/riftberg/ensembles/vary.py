"""What is varied in a sweep: parameters and their values, read and checked before the first run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from riftberg.config.units import looks_like_quantity
from riftberg.config.values import allowed, given, kinds_of, native, required, unit_of
from riftberg.errors import InputError
from riftberg.experiments.changes import SETTABLE, find_field
from riftberg.parameters import group_now
from riftberg.system.input_files import value_shown
from riftberg.system.limits import refuse_large

MOST_MEMBERS: Final = 10_000
"""Members of a sweep, unless more are allowed."""

EXAMPLE: Final = "For example --vary fracture.normal_strength=14..24kPa:11, or --vary damage.enabled=true,false"

_RANGE: Final = re.compile(r"(.+?)\.\.([^:]+)(?::(.*))?$")
_UNIT: Final = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*(.*)$")


@dataclass(frozen=True)
class Varied:
    """One parameter that is varied."""

    name: str  # ``group.name`` of a parameter, or the name of an argument where a function makes the models
    values: tuple[Any, ...]  # Its values, in the unit of the parameter
    unit: str = ""  # That unit, empty where there is none
    meaning: str = ""  # What the parameter is


def varied_of(vary: Mapping[str, Any] | Iterable[str], *, free: bool = False) -> tuple[Varied, ...]:
    """Read what is to be varied."""
    pairs = vary.items() if isinstance(vary, Mapping) else [_split(text) for text in _texts(vary)]
    varied: list[Varied] = []
    for name, values in pairs:
        where = f"--vary {name}={values}" if isinstance(values, str) else f"vary, {name}"
        if any(other.name == name for other in varied):
            raise InputError(f"{name} is varied twice", where=where, remedy="Name each parameter once")
        varied.append(_free(name, values, where) if free else _of_parameter(name, values, where))
    if not varied:
        raise InputError("nothing is varied", where="--vary", remedy=EXAMPLE)
    return tuple(varied)


def _texts(vary: Any) -> list[str]:
    required(vary, Iterable, "a dict of names and lists of values", where="vary")
    texts = [vary] if isinstance(vary, str) else list(vary)
    for text in texts:
        if not isinstance(text, str):
            raise InputError(f"{value_shown(text)} is no text", where="vary", remedy="Give a dict of names and values")
    return texts


def _split(text: str) -> tuple[str, str]:
    name, equals, values = text.partition("=")
    if not equals or not name.strip() or not values.strip():
        raise InputError("not of the form group.name=values", where=f"--vary {text}", remedy=EXAMPLE)
    return name.strip(), values.strip()


def _free(name: str, values: Any, where: str) -> Varied:
    """Take the values of an argument of a function as they are."""
    if isinstance(values, str):
        raise InputError("a text, not a list of values", where=where, remedy="Give a list or an array")
    return Varied(name, _distinct(native(list(values)), where))


def _of_parameter(name: str, values: Any, where: str) -> Varied:
    group, dot, key = name.partition(".")
    if not dot:
        raise InputError(f"{name!r} is not of the form group.name", where=where, remedy=EXAMPLE)
    group = group_now(group, key)
    field = find_field(group, key, where=where)
    if any(get_origin(kind) is tuple for kind in kinds_of(field.annotation)) and isinstance(values, str):
        raise InputError("this parameter holds several numbers", where=where, remedy="Vary it in Python, or by --set")
    several = _read(values, field, where) if isinstance(values, str) else _listed(values, where)
    plain = [given(value, SETTABLE[group], key, where=where) for value in several]
    return Varied(f"{group}.{key}", _distinct(plain, where), unit_of(field), field.description or "")


def _listed(values: Any, where: str) -> list[Any]:
    plain = native(values)
    if not isinstance(plain, list | tuple):
        raise InputError(f"{value_shown(values)} is no list of values", where=where, remedy="Give a list or an array")
    return list(plain)


def _read(text: str, field: FieldInfo, where: str) -> list[Any]:
    """Read a range ``LOW..HIGH:COUNT`` or a list with commas; a unit at the end is that of all."""
    bounds = _RANGE.match(text)
    if bounds is None:
        parts = [part.strip() for part in text.split(",")]
        return _with_unit_of_last(parts)
    low, high, count = bounds.groups()
    low, high = _with_unit_of_last([low.strip(), high.strip()])
    if count is None or not count.strip().isdigit() or not 2 <= int(count) <= 1_000_000:
        said = "does not say how many values" if count is None else f"{value_shown(count)} is no number of values"
        raise InputError(said, where=where, remedy=f"Write the number, 2 or more, behind a colon: {low}..{high}:11")
    whole = int in kinds_of(field.annotation) and float not in kinds_of(field.annotation)
    if not whole and float not in kinds_of(field.annotation):
        raise InputError("a range of what is no number", where=where, remedy=f"{allowed(field)}. Give them with commas")
    return _spaced(low, high, int(count), field, whole, where)


def _spaced(low: str, high: str, count: int, field: FieldInfo, whole: bool, where: str) -> list[Any]:
    """Return evenly spaced values between two ends."""
    from riftberg.config.values import number

    first, last = (number(end, unit_of(field), where=where) for end in (low, high))
    if not first < last:
        raise InputError(f"{low} is not below {high}", where=where, remedy="The smaller number stands first")
    refuse_large(count, MOST_MEMBERS, "members", where=where, remedy="Give fewer values", kind=InputError)
    values = np.linspace(first, last, count)
    if whole and not (values == np.round(values)).all():
        raise InputError("a range with steps that are no whole numbers", where=where, remedy=f"{allowed(field)}")
    return [int(value) if whole else float(value) for value in values]


def _with_unit_of_last(parts: Sequence[str]) -> list[str]:
    """Give numbers without a unit that of the last one: ``14..24kPa`` is not 14 Pa to 24 kPa."""
    last = _UNIT.match(parts[-1])
    unit = last[1].strip() if last else ""
    if not unit:
        return list(parts)
    # Only bare numbers take the unit of the last one; a part with a unit of its own keeps it.
    plain = [looks_like_quantity(part) and not (_UNIT.match(part) or ["", "x"])[1] for part in parts]
    return [f"{part} {unit}" if bare else part for part, bare in zip(parts, plain, strict=True)]


def _distinct(values: Sequence[Any], where: str) -> tuple[Any, ...]:
    """Refuse no value, and the same value twice."""
    if not len(values):
        raise InputError("no values", where=where, remedy=EXAMPLE)
    for k, value in enumerate(values):
        # True and 1 are equal in Python, and no such pair.
        if any(type(value) is type(other) and value == other for other in values[:k]):
            raise InputError(f"{value_shown(value)} stands twice", where=where, remedy="Give each value once")
    return tuple(values)


def members_of(varied: Sequence[Varied]) -> list[dict[str, Any]]:
    """Return every combination of the values, the last parameter changing fastest."""
    count = int(np.prod([len(v.values) for v in varied], dtype=float))
    refuse_large(count, MOST_MEMBERS, "members", where="--vary", remedy="Give fewer values", kind=InputError)
    names = [v.name for v in varied]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*(v.values for v in varied))]


def grouped(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return values by ``group.name`` as values by group and name."""
    result: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        group, _, key = name.partition(".")
        result.setdefault(group, {})[key] = value
    return result
