"""Changes of parameters given as text: names looked up, units converted, values checked, mistakes explained."""

from __future__ import annotations

import types
from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from riftberg.errors import InputError, nearest
from riftberg.input_files import value_shown
from riftberg.parameters import A68A_2022_KID, Parameters
from riftberg.units import looks_like_quantity, to_unit

Changes = dict[str, dict[str, Any]]


def parse_settings(settings: Iterable[str]) -> Changes:
    """Read ``group.name=value`` as given to ``--set``.

    Parameters
    ----------
    settings : iterable of str
        For example ``stepping.time_step=900`` or ``fracture.normal_strength=18 kPa``.

    Returns
    -------
    dict
        Values by group and name, converted to the unit of the parameter, not yet checked against each other.

    Raises
    ------
    InputError
        Naming the setting, and what is allowed.
    """
    changes: Changes = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        group, dot, name = key.strip().partition(".")
        if not equals or not dot:
            raise InputError(
                f"{setting!r} is not of the form group.name=value",
                where="--set",
                remedy="For example --set stepping.time_step=900",
            )
        field = find_field(group, name, where=f"--set {setting}")
        try:
            changes.setdefault(group, {})[name] = plain_value(text.strip(), field)
        except ValueError as error:
            raise InputError(str(error), where=f"--set {setting}", remedy=allowed(field)) from error
    return changes


def find_field(group: str, name: str, *, where: str) -> FieldInfo:
    """Return the field of a parameter, or explain that there is none."""
    groups = Parameters.model_fields
    if group not in groups:
        raise InputError(
            f"no group of parameters is called {group!r}",
            where=where,
            remedy=f"{nearest(group, groups)}Groups are {', '.join(groups)}",
        )
    fields = fields_of(groups[group])
    if name not in fields:
        raise InputError(
            f"group {group} has no parameter {name!r}",
            where=where,
            remedy=f"{nearest(name, fields)}It has {', '.join(fields)}",
        )
    return fields[name]


def fields_of(group: FieldInfo) -> dict[str, FieldInfo]:
    """Return the fields of a group of parameters."""
    assert isinstance(group.annotation, type)
    assert issubclass(group.annotation, BaseModel)
    return group.annotation.model_fields


def unit_of(field: FieldInfo) -> str:
    """Return the unit of a field, empty where it has none."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def kinds_of(annotation: Any) -> tuple[Any, ...]:
    """Return the alternatives of an annotation, without None."""
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(kind for kind in get_args(annotation) if kind is not type(None))
    return (annotation,)


def plain_value(value: Any, field: FieldInfo) -> Any:
    """Turn a text into what the field holds: quantities into numbers in its unit, words into flags and lists.

    Raises
    ------
    ValueError
        If a quantity has a wrong unit, or is no number where one is needed.
    """
    if isinstance(value, list):
        if any(get_origin(kind) is list for kind in kinds_of(field.annotation)):
            return value  # names of files or of parts, and rows of whole numbers, carry no units
        return [_number_of_field(item, field) if isinstance(item, str) else item for item in value]
    if not isinstance(value, str):
        return value
    kinds = kinds_of(field.annotation)
    optional = type(None) in get_args(field.annotation)
    if optional and value.lower() in ("none", "null", "auto", ""):
        return None
    if bool in kinds:
        return _flag(value)
    if any(get_origin(kind) is tuple for kind in kinds):
        return [_number_of_field(part, field) for part in value.strip("()[] ").split(",")]
    if float in kinds or int in kinds:
        return _number_of_field(value, field)
    return value


def _flag(text: str) -> bool:
    words = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(f"{text!r} is neither true nor false")
    return words[text.lower()]


def _number_of_field(text: str, field: FieldInfo) -> float | int:
    if not looks_like_quantity(text):
        raise ValueError(f"{text!r} is not a number")
    number = to_unit(text, unit_of(field))
    return int(number) if int in kinds_of(field.annotation) and number.is_integer() else number


def allowed(field: FieldInfo) -> str:
    """Return in words what a field may hold."""
    limits = []
    for item in field.metadata:
        for name, sign in (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<=")):
            limit = getattr(item, name, None)
            if limit is not None:
                limits.append(f"{sign} {limit:g}")
    kinds = [_kind_name(kind) for kind in kinds_of(field.annotation)]
    text = "Allowed: " + " or ".join(kinds) + (" " + " and ".join(limits) if limits else "")
    unit = unit_of(field)
    text += f", in {unit}" if unit not in ("", "1") else ""
    return text + (f" ({field.description})" if field.description else "")


def _kind_name(kind: Any) -> str:
    plain = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", datetime: "a date"}
    if kind in plain:
        return plain[kind]
    if get_origin(kind) is tuple:
        return f"{len(get_args(kind))} numbers"
    if get_origin(kind) is list:
        return "a list"
    options = [repr(option) for option in get_args(kind)]
    return ", ".join(options) if options else str(getattr(kind, "__name__", kind))


def changed(parameters: Parameters, changes: Mapping[str, Mapping[str, Any]], *, where: str = "--set") -> Parameters:
    """Return parameters with changes made, or explain which is impossible.

    Raises
    ------
    InputError
        Naming group, parameter, value and what is allowed.
    """
    try:
        return parameters.changed(**{group: dict(values) for group, values in changes.items()})
    except ValidationError as error:
        raise InputError(**explained(error, where)) from error


def explained(error: ValidationError, where: str) -> dict[str, str]:
    """Turn the first error of pydantic into what, where and remedy."""
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    if len(first["loc"]) < 2:
        return {"what": str(first["msg"]).removeprefix("Value error, "), "where": where}
    field = find_field(str(first["loc"][0]), str(first["loc"][1]), where=where)
    return {
        "what": f"{place} = {value_shown(first['input'])} is not possible",
        "where": where,
        "remedy": allowed(field),
    }


def reference_numerics(parameters: Parameters) -> Parameters:
    """Return the same physics with the numerics and quirks of the reference, as `A68A_2022_KID` has them."""
    return parameters.changed(
        drag={"rotational": False},
        grounding={"implicit": False},
        bonds={"objective_damping": False},
        contact={"on_substeps": False},
        stepping={"skip_first_long_force": True},
        compatibility=A68A_2022_KID.compatibility.model_dump(),
    )
