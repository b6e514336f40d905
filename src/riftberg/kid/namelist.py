"""Reading of KID's ``input.nml``, with the leniencies of Intel's compiler; and the clock of its driver.

Only the groups ``icebergs_nml`` and ``icebergs_driver_nml`` (or ``drv_nml``) matter; others (of FMS) are named in the
report and not read. Accepted beyond the standard: texts without quotes (``traj_name=KID.nc``), whole numbers written as reals
(``mts_sub_steps=1e5``), any of ``T``, ``.true.``, ``true`` for logicals (files 7.1).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import f90nml

from riftberg.errors import NamelistError
from riftberg.kid.entries import (
    CALVING,
    GROUPS,
    HONOURED,
    OCEAN,
    REFUSED,
    REPORTED,
    TEXT,
    Value,
    convert,
    find_entry,
    lacking,
    refused,
)
from riftberg.system.input_files import check_file, reading
from riftberg.system.limits import MOST_YAML
from riftberg.system.process import own_filters

MONTH: Final = 30 * 86_400
"""Length of a month, s."""

YEAR: Final = 12 * MONTH
"""Length of a year, s."""

LATE_START: Final = {355: 6 * 86_400 + 5 * 3600}
"""Start index of the A68 data -> start of the run after 0001-01-01 00:00, s (files, section 8.7)."""


class Date(NamedTuple):
    """A date of the 30-day calendar; year, month and day count from 1."""

    year: int
    month: int
    day: int
    hour: int
    minute: int
    second: float

    def year_day(self) -> float:
        """Return KID's day of the year, which counts 31 days for every month (files, section 0.3, quirk T2)."""
        hours = self.hour + (self.minute + self.second / 60.0) / 60.0
        return (self.month - 1) * 31 + (self.day - 1) + hours / 24.0

    def seconds_of_month(self) -> float:
        """Return 86400 day + seconds of the day, by which trajectories are sampled (dynamics, section 12)."""
        return 86_400 * self.day + 3600 * self.hour + 60 * self.minute + self.second

    def __str__(self) -> str:
        """Return the date as text."""
        return f"{self.year:04d}-{self.month:02d}-{self.day:02d} {self.hour:02d}:{self.minute:02d}:{self.second:02.0f}"


def date_after(seconds: float) -> Date:
    """Return the date that many seconds after 0001-01-01 00:00."""
    year, rest = divmod(seconds, YEAR)
    month, rest = divmod(rest, MONTH)
    day, rest = divmod(rest, 86_400)
    hour, rest = divmod(rest, 3600)
    minute, second = divmod(rest, 60)
    return Date(int(year) + 1, int(month) + 1, int(day) + 1, int(hour), int(minute), second)


def is_sampled(date: Date, hours: float) -> bool:
    """Whether a step that starts at a date gives a record every so many hours; -1 means every step."""
    return hours == -1.0 or date.seconds_of_month() % (3600.0 * hours) == 0.0


@dataclass(frozen=True)
class Clock:
    """Length of the run and its calendar."""

    dt: float  # Long step, s
    steps: int  # Number of long steps
    offset: float  # Start of the run after 0001-01-01 00:00, s

    def date(self, time: float) -> Date:
        """Return the date at a time (s) after the start of the run."""
        return date_after(self.offset + time)


_FOLDERS: Final = ("restart_input_dir", "data_dir")

_REMEDY: Final = "A KID run folder holds input.nml"
_MARK: Final = "\xef\xbb\xbf"
"""Byte order mark of UTF-8, as the file is read, which editors of Windows write."""
_CONTROL: Final = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_ASSIGNED: Final = re.compile(r"(?:^|[\s,])([A-Za-z]\w*)\s*(?:\([^()=]*\)\s*)?=", re.MULTILINE)
_REPEATED: Final = re.compile(r"(?<![\w.])(\d{3,})\*")


@dataclass(frozen=True)
class NamelistGroup:
    """Values of one group, defaults where the file is silent."""

    name: str  # Name of the group
    values: dict[str, Value]  # Value of every entry, by KID's spelling of the name
    given: frozenset[str]  # Entries that the file sets
    where: str  # File and group, for messages

    def _get(self, name: str, *types: type) -> Any:
        value = self.values[name]
        if not isinstance(value, types):
            raise TypeError(f"{name} is {type(value).__name__}")
        return value

    def flag(self, name: str) -> bool:
        """Return a logical entry."""
        return bool(self._get(name, bool))

    def whole(self, name: str) -> int:
        """Return an integer entry."""
        return int(self._get(name, int))

    def number(self, name: str) -> float:
        """Return a real entry."""
        return float(self._get(name, float))

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return an entry of ten reals."""
        return tuple(self._get(name, tuple))

    def text(self, name: str) -> str:
        """Return a text entry."""
        return str(self._get(name, str))

    def error(self, what: str, remedy: str = "") -> NamelistError:
        """Return an error that names the file and the group."""
        return NamelistError(what, where=self.where, remedy=remedy)


@dataclass(frozen=True)
class KidNamelist:
    """The two groups of a KID namelist file that matter."""

    path: Path  # The file
    icebergs: NamelistGroup  # Group ``icebergs_nml``
    driver: NamelistGroup  # Group ``icebergs_driver_nml``; in cases that exchange with an ocean ``drv_nml``
    ignored_groups: tuple[str, ...]  # Other groups in the file

    @property
    def coupled(self) -> bool:
        """Whether the case exchanges with an ocean."""
        return self.driver.name == "drv_nml"

    def report(self) -> list[str]:
        """Return one line for each entry of the file, each refused or noteworthy default, and each ignored group."""
        lines = [line for group in (self.driver, self.icebergs) for line in _group_report(group, self.coupled)]
        return lines + [f"&{name}: ignored, it is not about icebergs" for name in self.ignored_groups]


def _group_report(group: NamelistGroup, coupled: bool) -> Iterator[str]:
    for entry in GROUPS[group.name]:
        if entry.name in group.given or entry.name == "add_weight_to_ocean":
            known = entry
            if entry.note in (CALVING, OCEAN):  # of effect only with an ocean and a flux of land ice
                known = replace(entry, note="") if coupled else replace(entry, treatment=REPORTED)
            if known.treatment == HONOURED and (lack := lacking(entry.name, group.values)):
                known = replace(entry, treatment=REPORTED, note=lack)
            value = group.values[known.name]
            accepted = known.treatment == REFUSED and value == known.accepted
            state = {REPORTED: "no effect here", REFUSED: "accepted" if accepted else "refused"}
            origin = "" if known.name in group.given else " (default)"
            note = f": {known.note}" if known.note and not accepted else ""
            yield f"{known.name} = {value!r}{origin}: {state.get(known.treatment, 'honoured')}{note}"


def read_namelist(path: Path) -> KidNamelist:
    """Read a KID namelist file."""
    path = check_file(path, most=MOST_YAML, remedy=_REMEDY, kind=NamelistError)
    with reading(path, "cannot be read", _REMEDY, NamelistError):
        text = path.read_text(encoding="latin-1").removeprefix(_MARK)
    odd = _CONTROL.search(text)
    if odd:
        line = text.count("\n", 0, odd.start()) + 1
        raise NamelistError(
            f"the control character {odd.group()!a} stands there", where=f"{path}, line {line}", remedy="Remove it"
        )
    if many := _REPEATED.search(text):
        raise NamelistError(
            f"a value repeated {many[1][:20]} times",
            where=str(path),
            remedy="Lists of a namelist have 10 values at most",
        )
    groups = split_groups(text, path)
    names = [name for name, _ in groups]
    return KidNamelist(
        path=path,
        icebergs=_read_group("icebergs_nml", groups, path),
        driver=_read_group("drv_nml" if "drv_nml" in names else "icebergs_driver_nml", groups, path),
        ignored_groups=tuple(name for name in names if name not in GROUPS),
    )


def check_supported(namelist: KidNamelist) -> None:
    """Raise `NamelistError` if an active entry asks for something that Riftberg does not do, naming all of them."""
    group = namelist.icebergs
    refusals = refused(GROUPS[group.name], group.values)
    if refusals:
        written = {True: ".true.", False: ".false."}
        shown = [(e, written[value] if isinstance(value, bool) else value) for e, value in refusals]
        what = "; ".join(f"{e.name} = {value}: {e.note}" for e, value in shown)
        remedy = "; ".join(f"{e.name}: {e.remedy}" for e, _ in refusals)
        raise group.error(what, f"Remedy: {remedy}")


def _read_group(name: str, groups: list[tuple[str, str]], path: Path) -> NamelistGroup:
    bodies = [body for group, body in groups if group == name]
    where = f"{path}, &{name}"
    if not bodies:
        others = ", ".join(f"&{group}" for group, _ in groups) or "no group at all"
        raise NamelistError(
            f"group &{name} is missing (the file has {others})",
            where=str(path),
            remedy=f"A run of the stand-alone driver needs &{name} ... /",
        )
    _check_names(name, bodies[0], where)
    raw = _parse(name, bodies[0], where)
    # Where lists begin that the file gives number by number, ``name(3) = 1.0``.
    starts = raw.pop("_start_index", {})
    values: dict[str, Value] = {entry.name: entry.default for entry in GROUPS[name]}
    names = set()
    for key, value in raw.items():
        entry = find_entry(name, key, where)
        first = starts.get(key.lower(), [1])[0]
        values[entry.name] = convert(entry, value, where, 1 if first is None else int(first))
        names.add(entry.name)
    return NamelistGroup(name, values, frozenset(names), where)


MOST_ASSIGNMENTS: Final = 1000
"""Values of a group: it has some 200 entries, and lists may be given number by number."""


def _check_names(name: str, body: str, where: str) -> None:
    """Refuse an unknown entry, or the same ones again and again, before the parser, which takes minutes over many."""
    # Without texts and comments, in which anything may look like an assignment.
    code = "\n".join(_mask_texts(name, line[: _comment_start(line)]) for line in body.split("\n"))
    names = _ASSIGNED.findall(code)
    for entry in dict.fromkeys(names):
        find_entry(name, entry, where)
    if len(names) > MOST_ASSIGNMENTS:
        most = max(set(names), key=names.count)
        raise NamelistError(
            f"{len(names)} assignments, {names.count(most)} of them to {most}", where=where,
            remedy=f"The group has {len(GROUPS[name])} entries: give each once",
        )  # fmt: skip


def _parse(name: str, body: str, where: str) -> dict[str, Any]:
    source = f"&{name}\n{quote_texts(name, body)}\n/\n"
    try:
        with own_filters():
            # The parser warns of values that it leaves out.
            warnings.filterwarnings("error", module=r"f90nml\b")
            return dict(f90nml.reads(source).todict().get(name, {}))
    except Exception as error:  # the parser raises bare StopIteration, ValueError, AssertionError and more
        reason = " ".join(f"{error or type(error).__name__}".split())[:120]
        raise NamelistError(
            f"cannot be parsed ({reason})", where=where, remedy="Look for a missing quote, comma, sign or value"
        ) from error


def quote_texts(group: str, body: str) -> str:
    """Put quotes around texts that lack them, as Intel's compiler accepts them."""
    names = "|".join(e.name for e in GROUPS[group] if e.kind == TEXT)
    if not names:
        return body
    pattern = re.compile(rf"(?i)(?<![\w'\"])({names})(\s*=\s*)([^\s'\",!][^\s,!'\"]*)")
    lines = ((line, _comment_start(line)) for line in body.split("\n"))
    return "\n".join(pattern.sub(lambda m: f"{m[1]}{m[2]}'{m[3]}'", line[:end]) + line[end:] for line, end in lines)


def _comment_start(line: str) -> int:
    quote = ""
    for k, char in enumerate(line):
        if quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        elif char == "!":
            return k
    return len(line)


def split_groups(text: str, path: Path) -> list[tuple[str, str]]:
    """Return names (lower case) and bodies of the groups of a namelist file, in order."""
    groups: list[tuple[str, str]] = []
    name, body = "", ""
    for line in text.splitlines():
        code = line[: _comment_start(line)]
        if not name:
            start = re.match(r"\s*[&$](\w+)", code)
            if start is None:
                continue
            name, body = start[1].lower(), ""
            code = code[start.end() :]
        bare = _mask_texts(name, code)
        # A slash within a text ends nothing, so texts are masked first.
        end = re.search(r"(?i)/|[&$]end\b", bare)
        part, closed = (code[: end.start()], True) if end else (code, False)
        body += part + "\n"
        if closed:
            groups.append((name, body))
            name = ""
    if name:
        raise NamelistError(f"group &{name} has no end", where=str(path), remedy="Close it with a line '/'")
    return groups


def _mask_texts(group: str, code: str) -> str:
    """Blank out quoted texts, and unquoted texts that may hold a slash, keeping the length of the line."""
    masked = re.sub(r"'[^']*'|\"[^\"]*\"", lambda m: " " * len(m[0]), code)
    names = "|".join(e.name for e in GROUPS.get(group, ()) if e.kind == TEXT)
    if not names:
        return masked
    pattern = re.compile(rf"(?i)(?<!\w)({names})\s*=\s*[^\s'\",!]+")

    def blank(match: re.Match[str]) -> str:
        # A slash that closes an unquoted file name is the end of the group; one that closes a folder is not.
        keep = match[0].endswith("/") and match[1].lower() not in _FOLDERS
        return " " * (len(match[0]) - 1) + ("/" if keep else " ")

    return pattern.sub(blank, masked)
