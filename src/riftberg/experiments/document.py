"""A YAML file with the lines of its keys, read so that nothing in it can hang, explode or pass for something else.

Before anything is built from the text its characters, depth, tags and aliases are looked at; each value is built by
itself, so that a date such as the 31st of February is reported with its line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import yaml

from riftberg.config.values import Place
from riftberg.errors import InputError, together
from riftberg.system.input_files import check_file, shown, value_shown
from riftberg.system.limits import MOST_YAML

REMEDY: Final = "Name a YAML file, as in the guide to experiments of one's own"
DEEPEST: Final = 20
"""Sections and lists within each other."""

MOST_NODES: Final = 50_000
"""Values of a file, those behind aliases counted as often as they are used."""

_CORE: Final = frozenset(
    f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "timestamp", "seq", "map", "merge")
)
_KEY_TAGS: Final = frozenset(f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "merge"))


def _line(part: Any) -> int:
    """Return the line in which an event or a node begins, from 1."""
    return int(part.start_mark.line) + 1 if part.start_mark else 1


class Document:
    """A YAML file with the lines of its keys."""

    def __init__(self, path: Path, sections: str = "") -> None:
        self.path, self._sections = path, sections
        self.lines: dict[Place, int] = {}
        self._nodes = 0
        self.values = self._load(self._text())

    def _text(self) -> str:
        check_file(self.path, remedy=REMEDY, most=MOST_YAML)
        try:
            text = self.path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(
                "not a text file in UTF-8", where=shown(self.path), remedy="Save it as UTF-8, or name another"
            ) from error
        bad = yaml.reader.Reader.NON_PRINTABLE.search(text)
        if bad:
            line = text.count("\n", 0, bad.start()) + 1
            raise self._wrong(f"the control character {bad.group()!a} stands there", line, "Remove it")
        return text

    def _wrong(self, what: str, line: int, remedy: str = "") -> InputError:
        return InputError(what, where=f"{shown(self.path)}, line {line}", remedy=remedy)

    def _load(self, text: str) -> dict[str, Any]:
        try:
            # Depth and tags are judged from the events alone, before nodes are built: nothing can explode yet.
            depth = 0
            for event in yaml.parse(text, Loader=yaml.SafeLoader):
                if isinstance(event, yaml.CollectionStartEvent):
                    depth += 1
                    if depth > DEEPEST:
                        raise self._wrong(
                            f"more than {DEEPEST} sections or lists within each other", _line(event),
                            "An experiment file has no more than 5",
                        )  # fmt: skip
                elif isinstance(event, yaml.CollectionEndEvent):
                    depth -= 1
                tag = getattr(event, "tag", None)
                if tag not in (None, "!") and tag not in _CORE:
                    raise self._wrong(f"the tag {value_shown(tag)} is not known", _line(event), "Write the plain value")
            node = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = f", line {mark.line + 1}" if mark else ""
            raise InputError(
                f"not valid YAML: {shown(error.problem or error.context)}", where=f"{shown(self.path)}{line}",
                remedy="Look at brackets, quotes, colons and the spaces before that line",
            ) from error  # fmt: skip
        except yaml.YAMLError as error:
            raise InputError(f"not valid YAML: {shown(error)}", where=shown(self.path), remedy=REMEDY) from error
        if not isinstance(node, yaml.MappingNode):
            raise InputError(
                "an experiment file is a list of sections", where=shown(self.path),
                remedy=f"It has {self._sections}" if self._sections else REMEDY,
            )  # fmt: skip
        self._mark(node, (), ())
        loader = yaml.SafeLoader("")
        try:
            self._check_scalars(node, loader, set())
            values: dict[str, Any] = loader.construct_document(node)
        except yaml.MarkedYAMLError as error:
            number = error.problem_mark.line + 1 if error.problem_mark else 1
            raise self._wrong(
                f"not valid YAML: {shown(error.problem)}", number, "Write plain keys and values"
            ) from error
        finally:
            loader.dispose()
        return values

    def _mark(self, node: yaml.Node, place: Place, above: tuple[int, ...]) -> None:
        """Note the line of every key; refuse keys that stand twice or are no words, and aliases that never end."""
        self._nodes += 1
        line = _line(node)
        if id(node) in above:
            raise self._wrong("an alias (*) that holds itself", line, "Write the values out")
        if self._nodes > MOST_NODES:
            raise self._wrong(
                f"more than {MOST_NODES} values, those behind aliases (*) counted each time", line, "Write fewer values"
            )
        above = (*above, id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self._mark_key(key, value, place, above)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self.lines[(*place, index)] = _line(value)
                self._mark(value, (*place, index), above)

    def _mark_key(self, key: yaml.Node, value: yaml.Node, place: Place, above: tuple[int, ...]) -> None:
        line = _line(key)
        if not isinstance(key, yaml.ScalarNode) or key.tag not in _KEY_TAGS:
            raise self._wrong("a key that is no word", line, "Keys are plain words, such as days")
        inner = (*place, str(key.value))
        if inner in self.lines:
            raise self._wrong(
                f"{'.'.join(map(str, inner))} stands twice, first in line {self.lines[inner]}", line, "Leave one out"
            )
        self.lines[inner] = line
        self._mark(value, inner, above)

    def _check_scalars(self, node: yaml.Node, loader: yaml.SafeLoader, seen: set[int]) -> None:
        """Build every plain value by itself, so that what cannot be built is reported with its line."""
        if id(node) in seen:
            return
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self._check_scalars(key, loader, seen)
                self._check_scalars(value, loader, seen)
        elif isinstance(node, yaml.SequenceNode):
            for value in node.value:
                self._check_scalars(value, loader, seen)
        else:
            self._check_scalar(node, loader)

    def _check_scalar(self, node: yaml.Node, loader: yaml.SafeLoader) -> None:
        text, line = str(node.value), _line(node)
        kind = node.tag.rpartition(":")[2]
        if kind in ("int", "float"):
            digits = text.lstrip("+-").replace("_", "")
            if ":" in text:
                raise self._wrong(
                    f"{value_shown(text)} would be read as a number to the base 60", line, "Write a plain number"
                )
            if kind == "int" and len(digits) > 1 and digits[0] == "0":
                raise self._wrong(
                    f"{value_shown(text)} would not be read as a decimal number",
                    line,
                    "Write it without the leading zero",
                )
        try:
            loader.construct_object(node)
        except (ValueError, OverflowError, KeyError, AttributeError, TypeError) as error:
            what = "no date that exists" if kind == "timestamp" else f"no {kind} that can be read"
            remedy = "Dates are such as 2020-12-09 13:00" if kind == "timestamp" else "Write a plain value"
            raise self._wrong(f"{value_shown(text)} is {what}", line, remedy) from error

    def _known(self, place: Place) -> Place:
        """Return the place, or the section around it, whose line is known."""
        known: Place = ()
        for part in place:
            if (*known, part) in self.lines:
                known = (*known, part)
            elif part != 0:  # one section may stand where a list of them may
                break
        return known

    def where(self, place: Place) -> str:
        """Return file, line and key of a place."""
        known = self._known(place)
        line = f", line {self.lines[known]}" if known else ""
        key = shown(".".join(str(part) for part in place))
        return f"{shown(self.path)}{line}" + (f", {key}" if key else "")

    def error(self, what: str, place: Place, remedy: str = "") -> InputError:
        """Return an error that names the place."""
        return InputError(what, where=self.where(place), remedy=remedy)

    def refusal(self, faults: list[tuple[Place, InputError]]) -> InputError:
        """Return one error for all faults, in the order of the file."""
        order = {place: number for number, place in enumerate(self.lines, start=1)}
        in_order = sorted(faults, key=lambda fault: order.get(self._known(fault[0]), 0))
        return together([self.error(fault.what, place, fault.remedy) for place, fault in in_order])
