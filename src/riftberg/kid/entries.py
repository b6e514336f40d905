"""Look-up of KID's namelist entries: names, types, and what Riftberg does with what a file sets."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any, Final

from riftberg.errors import NamelistError
from riftberg.kid.entry_table import COUPLED, DRIVER, ICEBERGS, INTEGER, LOGICAL, REAL, REALS, REFUSED, Entry, Value
from riftberg.system.input_files import value_shown

GROUPS: Final[dict[str, tuple[Entry, ...]]] = {
    "icebergs_nml": ICEBERGS,
    "icebergs_driver_nml": DRIVER,
    "drv_nml": COUPLED,
}
"""The groups that matter, with their entries."""

_BY_NAME: Final = {group: {e.name.lower(): e for e in entries} for group, entries in GROUPS.items()}

REALS_SIZE: Final = 10
"""Length of the tables of size classes."""


def find_entry(group: str, name: str, where: str = "") -> Entry:
    """Return the entry ``name`` (any case) of a group."""
    known = _BY_NAME[group]
    entry = known.get(name.lower())
    if entry is not None:
        return entry
    other = next((g for g, names in _BY_NAME.items() if g != group and name.lower() in names), None)
    if other:
        remedy = f"It belongs to &{other}"
    else:
        near = difflib.get_close_matches(name.lower()[:80], known, n=1, cutoff=0.5)
        remedy = f"Did you mean '{known[near[0]].name}'?" if near else "Delete it, or see the list of KID's entries"
    raise NamelistError(f"unknown entry '{name}'", where=where, remedy=remedy)


def _wrong(entry: Entry, raw: object, where: str, expected: str) -> NamelistError:
    what = f"{entry.name} = {value_shown(raw)} is not {expected}"
    return NamelistError(what, where=where, remedy=f"KID's default is {entry.default!r}")


def _logical(entry: Entry, raw: object, where: str) -> bool:
    if isinstance(raw, bool):
        return raw
    if isinstance(raw, str) and raw.strip().lstrip(".")[:1].lower() in ("t", "f"):
        return raw.strip().lstrip(".")[0].lower() == "t"
    raise _wrong(entry, raw, where, "a logical (.true. or .false.)")


def _real(entry: Entry, raw: object, where: str) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not math.isfinite(raw):
        raise _wrong(entry, raw, where, "a finite number")
    return float(raw)


def _integer(entry: Entry, raw: object, where: str) -> int:
    if isinstance(raw, int) and not isinstance(raw, bool):
        return raw
    if isinstance(raw, float) and math.isfinite(raw) and raw.is_integer():
        return int(raw)
    raise _wrong(entry, raw, where, "a whole number")


def _reals(entry: Entry, raw: object, where: str, start: int) -> tuple[float, ...]:
    items = raw if isinstance(raw, list) else [raw]
    values = list(entry.default) if isinstance(entry.default, tuple) else []
    if start < 1 or start - 1 + len(items) > REALS_SIZE:
        raise _wrong(entry, raw, where, f"a list of at most {REALS_SIZE} numbers")
    for k, item in enumerate(items):
        if item is not None:
            values[start - 1 + k] = _real(entry, item, where)
    return tuple(values)


def convert(entry: Entry, raw: Any, where: str = "", start: int = 1) -> Value:
    """Return a raw namelist value as the entry's type."""
    if raw is None:
        return entry.default
    if entry.kind == REALS:
        return _reals(entry, raw, where, start)
    if isinstance(raw, list):
        raise _wrong(entry, raw, where, "a single value")
    if entry.kind == LOGICAL:
        return _logical(entry, raw, where)
    if entry.kind == INTEGER:
        return _integer(entry, raw, where)
    if entry.kind == REAL:
        return _real(entry, raw, where)
    if not isinstance(raw, str):
        raise _wrong(entry, raw, where, "a text in quotes")
    return raw.strip()


def refused(entries: Iterable[Entry], values: dict[str, Value]) -> list[tuple[Entry, Value]]:
    """Return the entries that are refused at the value they have, with that value."""
    return [(e, values[e.name]) for e in entries if e.treatment == REFUSED and values[e.name] != e.accepted]
