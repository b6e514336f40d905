"""The keys of an experiment file, walked from the file down through its sections: a new one is tried at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic.fields import FieldInfo

from riftberg.experiments.yaml_file import sections

Path = tuple[str, ...]


def nested(annotation: Any) -> list[type]:
    """Return the sections that a key may hold, also as items of lists."""
    if hasattr(annotation, "__pydantic_fields__"):
        return [annotation]
    return [section for argument in get_args(annotation) for section in nested(argument)]


def keys(section: type) -> Mapping[str, FieldInfo]:
    """Return the keys of a section."""
    return section.__pydantic_fields__  # type: ignore[attr-defined, no-any-return]


def extra(field: FieldInfo, name: str) -> Any:
    """Return what else is said of a key or a parameter, such as its unit or its usual range; None where nothing is."""
    said = field.json_schema_extra
    return said.get(name) if isinstance(said, dict) else None


def walk(fields: Mapping[str, FieldInfo], path: Path = ()) -> Iterator[tuple[Path, type]]:
    """Give the sections below some keys, each with its path in the file."""
    for name, field in fields.items():
        for section in nested(field.annotation):
            yield (*path, name), section
            yield from walk(keys(section), (*path, name))


TOP: Mapping[str, FieldInfo] = dict(sections())[""]
"""Keys of the file itself."""

SECTIONS: dict[type, Path] = {section: path for path, section in reversed(list(walk(TOP)))}
"""Sections of a file by class, each with the first path to it: ``("berg", "rectangle")``."""
