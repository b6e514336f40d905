"""Changes of an experiment: given as text, looked up, checked and explained, written as text again; and of its berg at the start.

Runs and sweeps keep the command that made them with its changes, so that ``riftberg rerun`` can make them again.
"""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from pydantic.fields import FieldInfo

from riftberg.bergs.bonding import Metric, give_velocity, separations, turn_rigidly
from riftberg.bergs.iceberg import Iceberg
from riftberg.bergs.keys import BergKeys
from riftberg.bergs.regions import turned
from riftberg.config.values import absent_key, field_extra, given, nested_sections, section_fields
from riftberg.errors import InputError, nearest, together, without_secrets
from riftberg.parameters import (
    A68A_2022,
    GROUPS,
    ExplicitParameters,
    Parameters,
    choose_a68a_preset,
    group_classes,
    kid_quirks,
)
from riftberg.plane import EqualAreaPlane
from riftberg.runs.layout import COMMAND, FILE, PLACE
from riftberg.state import copy_state
from riftberg.system.input_files import value_shown

if TYPE_CHECKING:
    from riftberg.runs.model import Model


Changes = dict[str, dict[str, Any]]

BERG: Final = "berg"
"""Group of the changes of an experiment's berg; all others are groups of parameters."""

SETTABLE: Final[dict[str, tuple[Any, ...]]] = {**{name: group_classes(name) for name in GROUPS}, BERG: (BergKeys,)}
"""Sections of each group that ``--set`` and ``--vary`` know: of a group of parameters, the section of each engine."""


OF_NAMELISTS: Final = "Leave it out, or set it in input.nml and run that folder with 'riftberg kid'"


def is_file_key(name: str) -> bool:
    """Whether a name is a path in an experiment file, such as ``forcing.eddy.speed`` or ``start``, and no parameter."""
    group, _, key = name.partition(".")
    return name == "start" or (group in ("bergs", "forcing") and bool(key)) or (group == BERG and "." in key)


def file_field(name: str) -> FieldInfo | None:
    """Return the field at a path in an experiment file, such as ``forcing.eddy.speed``; None where there is none.

    Of an item of a list of numbers (``forcing.uniform.current.0``) it is the field of the list. Kinds of forcing that have
    keys of the same name give them the same unit.
    """
    from riftberg.experiments.schema import Experiment

    sections: list[Any] = [Experiment]
    fields: list[FieldInfo] = []
    for key in name.split("."):
        if key.isdigit():  # the place in a list of sections
            continue
        fields = [section_fields(section)[key] for section in sections if key in section_fields(section)]
        sections = [inner for field in fields for inner in nested_sections(field.annotation)]
    return fields[0] if fields else None


def file_value(text: str, where: str) -> Any:
    """Return a value as an experiment file has it: a number, a text with a unit, a date as text, a list."""
    import yaml

    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(f"{value_shown(text)} is no value of an experiment file", where=where) from error
    return value if isinstance(value, bool | int | float | list | dict) else text


def _deep_copy(value: Any) -> Any:
    """Copy the contents of an experiment file; a value shared by an alias of YAML gets its own copy, so that it changes alone."""
    if isinstance(value, dict):
        return {key: _deep_copy(inner) for key, inner in value.items()}
    return [_deep_copy(inner) for inner in value] if isinstance(value, list) else value


def changed_document(values: dict[str, Any], changes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the contents of an experiment file with changed keys; ``berg`` means each of several bergs."""
    values = _deep_copy(values)
    for group, inner in changes.items():
        if group in GROUPS:
            continue
        for key, value in inner.items():
            path = [group, *key.split(".")] if key else [group]
            many_bergs = group == BERG and BERG not in values and isinstance(values.get("bergs"), list)
            for at in [["bergs", k, *path[1:]] for k in range(len(values["bergs"]))] if many_bergs else [path]:
                _set_value(values, at, value)
    return values


def _set_value(values: Any, path: list[Any], value: Any) -> None:
    *parents, last = path
    inside = values
    for key in parents:
        inside = inside[0] if isinstance(inside, list) and len(inside) == 1 and not str(key).isdigit() else inside
        try:
            inside = inside[int(key) if isinstance(inside, list) else key]
        except (KeyError, IndexError, ValueError, TypeError) as error:
            dotted = ".".join(map(str, path))
            raise InputError(
                f"the experiment file has no {key!r} there", where=dotted, remedy="Write the section first"
            ) from error
    inside = inside[0] if isinstance(inside, list) and len(inside) == 1 and not str(last).isdigit() else inside
    try:
        inside[int(last) if isinstance(inside, list) else last] = value
    except (TypeError, ValueError, IndexError) as error:
        raise InputError("no section that has keys stands there", where=".".join(map(str, path))) from error


def parse_settings(settings: Iterable[str], settable: Mapping[str, tuple[Any, ...]] = SETTABLE) -> Changes:
    """Read ``group.name=value`` as given to ``--set``; ``settable``: the sections of each group."""
    changes: Changes = {}
    faults = []
    for setting in settings:
        key, equals, text = (piece.strip() for piece in setting.partition("="))
        group, dot, name = key.partition(".")
        where = f"--set {setting}"
        try:
            if equals and is_file_key(key):
                value = file_value(text, where)
            elif equals and dot:
                value = checked_value(text, group, name, where=where, settable=settable)
            else:
                problem = f"{setting!r} is not of the form group.name=value"
                raise InputError(problem, where="--set", remedy="For example --set stepping.time_step=900")
            changes.setdefault(group, {})[name] = value
        except InputError as error:
            faults.append(error)
    if faults:
        raise together(faults)
    return changes


def checked_value(
    value: Any, group: str, name: str, *, where: str, settable: Mapping[str, tuple[Any, ...]] = SETTABLE
) -> Any:
    """Return a value as a parameter of either engine holds it, or explain why none does."""
    sections = parameter_sections(group, name, where=where, settable=settable)
    for section in sections[:-1]:
        try:
            return given(value, section, name, where=where)
        except InputError:  # a choice that the other engine has
            continue
    return given(value, sections[-1], name, where=where)


def parameter_sections(
    group: str, name: str, *, where: str, settable: Mapping[str, tuple[Any, ...]] = SETTABLE
) -> list[Any]:
    """Return the sections of a group that have a parameter, or explain that there is none."""
    if group not in settable:
        raise InputError(
            f"no group of parameters is called {group!r}",
            where=where,
            remedy=f"{nearest(group, settable)}Groups are {', '.join(settable)}",
        )
    sections = [section for section in settable[group] if name in section_fields(section)]
    if not sections:
        gone = [replacement for section in settable[group] if (replacement := absent_key(section, name)[1])]
        if gone:
            raise InputError(f"group {group} has no parameter {name!r} any more", where=where, remedy=gone[0])
        fields = [item for section in settable[group] for item in section_fields(section).items()]
        listed = list(dict.fromkeys(key for key, field in fields if not field_extra(field, "hidden")))
        raise InputError(
            f"group {group} has no parameter {name!r}",
            where=where,
            remedy=f"{nearest(name, listed)}It has {', '.join(listed)}",
        )
    if field_extra(section_fields(sections[0])[name], "hidden"):
        raise InputError(f"{group}.{name} is an option of KID's namelists", where=where, remedy=OF_NAMELISTS)
    return sections


def changed(
    parameters: Parameters, changes: Mapping[str, Mapping[str, Any]], *, where: str = "--set", notices: list[str] | None = None
) -> Parameters:  # fmt: skip
    """Return parameters with changes made, or explain which is impossible.

    ``notices``: takes a sentence that names the keys that another scheme lacks, which are left out.
    """
    groups = {group: dict(values) for group, values in changes.items() if group in GROUPS}
    if parameters == A68A_2022:
        parameters = choose_a68a_preset(groups)
    try:
        adapted, left_out = parameters.adapted(**groups)
    except InputError as error:
        sign = ":" if error.what.startswith("it is") else " ="
        key_text = f"{error.where}{sign} " if error.where and error.where != where else ""
        raise InputError(key_text + error.what, where=where, remedy=error.remedy) from error
    if left_out and notices is not None:
        notices.append(_left_out(adapted, left_out))
    return adapted


def _left_out(parameters: Parameters, paths: Sequence[str]) -> str:
    return f"stepping.scheme = {parameters.stepping.scheme!r} has no {', '.join(paths)}: left out"


def reference_numerics(
    parameters: Parameters, *, springs: Mapping[str, Any] = MappingProxyType({}), notices: list[str] | None = None
) -> Parameters:
    """Return the same physics with the numerics and quirks of the reference, as `A68A_2022_KID` has them.

    ``springs``: groups that parameters of the other engine do not say, such as `PUBLISHED_SPRINGS`. ``notices``: takes a
    sentence that names the keys that the explicit engine lacks.
    """
    springs = {} if isinstance(parameters, ExplicitParameters) else springs
    explicit, left_out = parameters.adapted(**{**springs, "stepping": {"scheme": "mts"}})
    if left_out and notices is not None:
        notices.append(_left_out(explicit, left_out))
    return explicit.changed(**{
        **kid_quirks(), "drag": {"rotational": False}, "grounding": {"implicit": False}, "contact": {"on_substeps": False},
        "bonds": {"objective_damping": False}, "stepping": {"time_step": explicit.time_step, "skip_first_long_force": True},
    })  # fmt: skip


def origin(
    experiment: str, words: Sequence[str], settings: Sequence[str], data: Path | None, folder: Path
) -> dict[str, str]:
    """Return the attributes of a file in a folder: the command, the experiment file if there is one, and where its data are.

    ``words``: options of the command; ``settings``: further settings, as ``group.name=value``.
    """
    path = Path(experiment)
    setting_words = [word for setting in settings for word in ("--set", setting)]
    attributes = {COMMAND: shlex.join(["riftberg", "run", path.name, *words, *setting_words])}
    home = data
    if path.suffix in (".yaml", ".yml"):
        attributes[FILE], home = path.read_text("utf-8-sig"), home or path.parent
    if home is not None:
        attributes[PLACE] = os.path.relpath(home.resolve(), folder.resolve())
    # Nobody else is to find passwords in a file.
    return {name: without_secrets(text) for name, text in attributes.items()}


def setting(name: str, value: Any) -> str:
    """Return ``name=value`` as ``--set`` reads it again with the same digits."""
    if isinstance(value, float):
        return f"{name}={int(value)}" if value.is_integer() else f"{name}={value!r}"
    return f"{name}={value if isinstance(value, str) else json.dumps(value)}"


def format_settings(changes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return changes by group and name as ``--set`` takes them; a group without a name is a key of the file by itself."""
    return [
        setting(f"{group}.{name}" if name else group, value)
        for group, values in changes.items()
        for name, value in values.items()
    ]


# ---- the berg of a built experiment, which has no file to change it in --------------------------------------------------


def started(
    model: Model, *, east: float = 0.0, north: float = 0.0, turn: float = 0.0, size: float = 1.0, thickness: float = 1.0,
    strength: float = 1.0, to: tuple[float, float] | None = None,
) -> Model:  # fmt: skip
    """Return a model anew with its berg moved (m), turned (degrees), and with factors on size, thickness and strength.

    ``to``: where its centre comes to lie (degrees or m), in place of ``east`` and ``north``.
    """
    p = model.parameters
    e, bonds = copy_state(model.elements, model.bonds)
    metric = Metric(p.earth.latlon, p.earth.radius, p.earth.period)
    first, second = bonds.first, bonds.second

    def lengths() -> Any:
        return np.hypot(*separations(metric, e.lon[first], e.lat[first], e.lon[second], e.lat[second]))

    old_lengths, share = lengths(), e.mass / e.mass.sum()
    lon0, lat0 = float(share @ e.lon), float(share @ e.lat)
    start_plane = EqualAreaPlane(lon0, lat0, p.earth.radius, p.earth.latlon)
    # A step of some kilometres on the plane of the old place gives the new point of contact.
    lon1, lat1 = to or tuple(float(a[0]) for a in start_plane.inverse(np.array([east]), np.array([north])))
    target_plane = replace(start_plane, lon0=lon1, lat0=lat1)

    def moved(lon: Any, lat: Any) -> tuple[Any, Any]:
        x, y = turned(*start_plane.forward(lon, lat), turn)
        return target_plane.inverse(size * x, size * y)

    e.lon[:], e.lat[:] = moved(e.lon, e.lat)
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    for when in ("", "_sync", "_pair"):  # its own motion about its centre turns and grows with it
        u, v = getattr(e, f"u{when}"), getattr(e, f"v{when}")
        du, dv = u - share @ u, v - share @ v
        east_of, north_of = turned(du, dv, turn)
        u += size * east_of - du
        v += size * north_of - dv
    if bonds.bond_length.size:
        # Strains stay as they were: rest lengths follow the distances.
        bonds.bond_length[:] *= lengths() / old_lengths
    e.length[:] *= size
    e.width[:] *= size
    e.thickness[:] *= thickness
    e.mass[:] *= thickness * size**2
    bonds.strength[:] *= strength
    return _again(model, e, bonds, moved)


def _again(model: Model, e: Any, bonds: Any, moved: Callable[[Any, Any], tuple[Any, Any]]) -> Model:
    """Return a model of changed elements and bonds; ``moved`` is where points of the outlines went."""
    p = model.parameters

    def along(points: Any) -> Any:
        return np.column_stack(moved(points[:, 0], points[:, 1]))

    berg = Iceberg(
        e, bonds, p.bonds.packing, math.sqrt(float(e.length[0] * e.width[0])) / 2.0, latlon=p.earth.latlon,
        earth_radius=p.earth.radius, bergs=model.fragments.bergs,
        outlines=tuple(shapely.transform(polygon, along) for polygon in model.outlines),
    )  # fmt: skip
    again = type(model)(berg, model.forcing, p, model.start)
    again.after_step = model.after_step
    return again


def change_berg(model: Model, keys: Mapping[str, Any]) -> Model:
    """Return a model with another thickness, placement, rotation, shift, velocity or spin of its berg, as files give them.

    ``rotation`` turns it from where the experiment has it; ``velocity`` and ``spin`` take the place of those that it has.
    """
    p = model.parameters
    thickness = keys.get("thickness")
    if isinstance(thickness, str):
        raise InputError("a built-in experiment takes no map", where="berg.thickness", remedy="Give a thickness in m")
    e = model.elements
    share = e.mass / e.mass.sum()
    lon, lat = float(share @ e.lon), float(share @ e.lat)
    to, shift = keys.get("placement") or (lon, lat), keys.get("shift", (0.0, 0.0))
    changed = started(model, to=(to[0] + shift[0], to[1] + shift[1]), turn=keys.get("rotation", 0.0))
    e, bonds = copy_state(changed.elements, changed.bonds)
    if thickness is not None:
        e.mass[:] *= thickness / e.thickness
        e.thickness[:] = thickness
    if "velocity" in keys:
        east, north = keys["velocity"]
        give_velocity(e, east - float(share @ e.u), north - float(share @ e.v))
    if "spin" in keys:
        turn_rigidly(e, keys["spin"] - e.spin, Metric(p.earth.latlon, p.earth.radius, p.earth.period))
        e.spin[:] = keys["spin"]  # to the last digit
    return _again(changed, e, bonds, lambda x, y: (x, y))
