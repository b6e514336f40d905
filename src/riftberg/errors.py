"""Errors for the reader: what, where, and what would be right."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

_LONG: Final = re.compile(r"\S{400,}")
"""Words that a person would not read to their end; paths may be long."""


CUT: Final = "***"
"""What stands in addresses in the place of what nobody else is to know."""

_USER: Final = re.compile(r"(://|\w\w:/+)(?:[^\s/:'\"<>]+:(?!\d+/)[^\s<>]*|[^\s/'\"<>]*)@(?=[\w\[])")
"""A password may hold a slash or a quotation mark, and an address too few or too many slashes."""
_QUERY: Final = re.compile(r"(\w://[^\s?#;'\"<>]*)([?#;][^\s'\"<>]*[^\s'\"<>\])},.:;])")
_HARMLESS: Final = re.compile(r"#mode=[\w,]+")
_SECRET: Final = re.compile(
    r"((?:authorization|passw(?:or)?d|secret|(?:access|api|account)[_-]?key|token|signature|credentials?)\w*[\"']?\s*[:=]\s*"
    r"[\"']?(?!(?:(?:bearer|basic)\s+)?\*\*\*)(?:(?:bearer|basic)\s+)?)[^\s\"',;&)}\]]+",
    re.IGNORECASE,
)


def without_secrets(text: str) -> str:
    """Return a text without what addresses in it hold of user names, passwords, tokens and signatures, for files and messages.

    Cut are user information, the values of a query and the fragment of an address, and what is called a password, token or
    the like elsewhere.
    """
    text = _QUERY.sub(lambda found: found[1] + _cut_query(found[2]), _USER.sub(rf"\1{CUT}@", text))
    return _SECRET.sub(rf"\1{CUT}", text)


def _cut_query(query: str) -> str:
    """Return a query and a fragment with the names of their values alone; ``#mode=bytes`` tells netCDF how to read."""
    parts = re.split(r"([?&;#])", query)
    pairs = zip(parts[1::2], parts[2::2], strict=True)
    return "".join(
        sign + (value if _HARMLESS.fullmatch(sign + value) else f"{name}={CUT}" if equals else CUT if name else "")
        for sign, value in pairs
        for name, equals, _ in [value.partition("=")]
    )


def _ends(word: re.Match[str]) -> str:
    return f"{word[0][:60]} ... {word[0][-15:]}"


_CONTROL: Final = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]")
"""Characters that steer a terminal, or turn the direction of a line; ends of lines and tabs are not among them."""


def visible(text: str) -> str:
    r"""Return a text whose control characters are written out, so that no server and no file steers the terminal.

    Examples
    --------
    >>> visible("\x1b[2JBAD")
    '\\x1b[2JBAD'
    """
    return _CONTROL.sub(lambda control: ascii(control[0])[1:-1], text)


class RiftbergError(Exception):
    """Base of all errors that Riftberg raises on purpose."""

    def __init__(self, text: str = "") -> None:
        super().__init__(visible(text))


class InputError(RiftbergError):
    """An input file or value cannot be used.

    Parameters
    ----------
    what : str
        What is wrong, with the value met.
    where : str
        File, variable, element or date.
    remedy : str
        What would be right.

    Attributes
    ----------
    faults : list of InputError
        This one, or all that it lists (`together`).
    """

    def __init__(self, what: str, *, where: str = "", remedy: str = "") -> None:
        what, where, remedy = (_LONG.sub(_ends, without_secrets(part)) for part in (what, where, remedy))
        self.what, self.where, self.remedy = what, where, remedy
        self.faults: list[InputError] = [self]
        text = f"{where}: {what}" if where else what
        end = "" if text.endswith((".", "?")) else "."
        super().__init__(f"{text}{end} {remedy}" if remedy else text)


class ForcingError(InputError):
    """The forcing lacks something that the run needs."""


class BergError(InputError):
    """An iceberg is impossible or badly placed."""


class NamelistError(InputError):
    """A KID namelist holds something unknown, wrong or not supported."""


MOST_TOLD: Final = 10
"""Faults that are reported at once; more say nothing new."""


def together(errors: Sequence[InputError]) -> InputError:
    """Return one error that reports all of several, each on a line of its own; a single one stays as it is.

    What would be right for several of them (the keys of a section) stands once, behind the last of these.
    """
    if len(errors) == 1:
        return errors[0]
    lines: list[str] = []
    said: set[str] = set()
    for error in reversed(errors[:MOST_TOLD]):
        hint, question, rest = error.remedy.rpartition("? ")  # "Did you mean 'days'? " belongs to this one alone
        text = str(InputError(error.what, where=error.where, remedy=f"{hint}{question}".rstrip()))
        lines.insert(0, f"  {text if rest in said else error}")
        said |= {rest}
    more = [f"  and {len(errors) - MOST_TOLD} more"] if len(errors) > MOST_TOLD else []
    whole = InputError("\n".join([f"{len(errors)} things are wrong:", *lines, *more]))
    whole.faults = list(errors)
    return whole


@contextmanager
def placed_in(where: str) -> Iterator[None]:
    """Give errors about input that name no place the file that the input came from."""
    try:
        yield
    except InputError as error:
        if error.where:
            raise
        raise type(error)(error.what, where=where, remedy=error.remedy) from error


class RunError(RiftbergError):
    """A run failed after its start; the message says where the state was saved."""


class SpeedError(RunError):
    """An element has become faster than any ice, or is nowhere.

    Parameters
    ----------
    what : str
        What is wrong, and what would be right.
    element : int
        Identifier of the first element.
    """

    def __init__(self, what: str, element: int) -> None:
        self.element = element
        super().__init__(what)


def nearest(name: str, choices: Iterable[str]) -> str:
    """Return a question that names the most similar choice, or nothing where none is similar."""
    alike = difflib.get_close_matches(name, list(choices), n=1, cutoff=0.6)
    return f"Did you mean {alike[0]!r}? " if alike else ""


def line_of_fault(error: Exception) -> str:
    """Return where a parser of JSON, XML or another text stopped, as " (line 3, column 5)"; empty if it does not say."""
    line, column = getattr(error, "position", (getattr(error, "lineno", None), getattr(error, "colno", None)))
    if line is None:
        return ""
    return f" (line {line})" if column is None else f" (line {line}, column {column})"
