"""Inputs that a sweep varies: parameters, start and errors, their values or distributions, checked before the first run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from riftberg.config.values import allowed, field_unit, native, number, required, section_fields, value_kinds
from riftberg.ensembles.distributions import EXAMPLE as EXAMPLE_DRAWN
from riftberg.ensembles.distributions import (
    OF_VALUES,
    POINTS,
    Distribution,
    Limits,
    is_distribution,
    member_seed,
    read_distribution,
    refuse_bare_numbers,
    shares,
    with_unit_of_last,
)
from riftberg.ensembles.uncertain import SEED, UNCERTAIN, has_fields, is_uncertain, read_starts
from riftberg.errors import InputError
from riftberg.experiments.changes import (
    SETTABLE,
    checked_value,
    file_field,
    file_value,
    is_file_key,
    parameter_sections,
)
from riftberg.system.input_files import read_csv_rows, refuse_large, value_shown

MOST_MEMBERS: Final = 10_000
"""Members of a sweep, unless more are allowed."""

EXAMPLE: Final = "For example --vary fracture.normal_strength=14..24kPa:11, or --vary damage.enabled=true,false"

_POSITIVE: Final = ("normal_strength", "shear_strength", "thickness")
"""Keys without limits of their own (the reference takes any strength, a berg a map of thickness), above 0 for all ice."""

STARTS: Final = "starts"
"""Name of a table of starts among what is varied."""

_RANGE: Final = re.compile(r"(.+?)\.\.([^:]+)(?::(.*))?$")


@dataclass(frozen=True)
class Varied:
    """One parameter that is varied."""

    name: str  # ``group.name`` of a parameter, or the name of an argument where a function makes the models
    values: tuple[Any, ...]  # Its values, in the unit of the parameter
    unit: str = ""  # That unit, empty where there is none
    meaning: str = ""  # What the parameter is
    distribution: Distribution | None = None  # From which its values are drawn, in place of ``values``
    components: int = 1  # Numbers that it consists of, each of them drawn

    def plain(self) -> list[Any] | str:
        """Return the values as a plan stores them."""
        return list(self.values) if self.distribution is None else "~" + self.distribution.text

    def told(self) -> str:
        """Describe it in a few words."""
        if self.distribution is None:
            return f"{len(self.values)} of {self.name}"
        return f"{self.name} ({self.distribution.described(self.unit)})"


def order_line(names: Sequence[str]) -> str:
    """Return that members follow the order in which inputs are varied, where there are several; else nothing."""
    if len(names) < 2:
        return ""
    return f"Members follow the order of --vary ({', '.join(names)}): another order gives other members"


def read_varied(vary: Mapping[str, Any] | Iterable[str], *, free: bool = False) -> tuple[Varied, ...]:
    """Read the inputs to vary."""
    pairs = vary.items() if isinstance(vary, Mapping) else [_split(text) for text in _texts(vary)]
    varied: list[Varied] = []
    for name, values in pairs:
        # Behind a name of its own a distribution needs no mark.
        if isinstance(vary, Mapping) and isinstance(values, str) and is_distribution(values):
            values = f"~{values}"
        drawn = isinstance(values, str) and values.startswith("~")
        where = f"--vary {name}{'' if drawn else '='}{values}" if isinstance(values, str) else f"vary, {name}"
        if any(other.name == name for other in varied):
            raise InputError(f"{name} is varied twice", where=where, remedy="Name each parameter once")
        varied.append(
            _free(name, values, where) if free and not is_uncertain(name) else _read_parameter(name, values, where)
        )
    if not varied:
        raise InputError("nothing is varied", where="--vary", remedy=EXAMPLE)
    return tuple(varied)


def vary_with_file(
    experiment: object, vary: Mapping[str, Any] | Iterable[str], data: Path | None = None
) -> dict[str, Any]:
    """Return the varied inputs by name: the user's, then those under ``vary`` in the experiment file.

    ``starts`` is a table of starts, which becomes the names that its columns vary.
    """
    file_values = _read_vary_section(Path(str(experiment)), data) if str(experiment).endswith((".yaml", ".yml")) else {}
    if isinstance(vary, Mapping):
        given = dict(vary)
        tables = [given.pop(STARTS)] if STARTS in given and not callable(experiment) else []
    else:
        texts = _texts(vary)
        tables = [text.partition("=")[2].strip() for text in texts if text.partition("=")[0].strip() == STARTS]
        texts = [text for text in texts if text.partition("=")[0].strip() != STARTS]
        given = {v.name: v.plain() for v in (read_varied(texts, free=callable(experiment)) if texts else ())}
    starts = {name: value for path in tables for name, value in read_starts(path).items()}
    return {**file_values, **starts, **given}


def _read_vary_section(path: Path, data: Path | None) -> dict[str, Any]:
    """Return the section ``vary`` of an experiment file; all that is wrong with it is reported with its lines."""
    from riftberg.experiments.yaml_file import read_file

    experiment, _, document = read_file(path, data=data)
    values_by_name: dict[str, Any] = {}
    faults: list[tuple[Any, InputError]] = []
    for name, values in experiment.vary.items():
        try:
            if name == STARTS:
                values_by_name |= read_starts(path.parent / str(values))
                continue
            (v,) = read_varied({name: [values] if isinstance(values, float) else values})
            values_by_name[v.name] = v.plain()
        except InputError as error:
            faults.append((("vary", name), error))
    if faults:
        raise document.refusal(faults)
    return values_by_name


def _texts(vary: Any) -> list[str]:
    required(vary, Iterable, "a dict of names and lists of values", where="vary")
    texts = [vary] if isinstance(vary, str) else list(vary)
    for text in texts:
        if not isinstance(text, str):
            raise InputError(f"{value_shown(text)} is no text", where="vary", remedy="Give a dict of names and values")
    return texts


def _split(text: str) -> tuple[str, str]:
    drawn = re.match(r"([\w.\s]+)~", text)
    name, equals, values = text.partition("~" if drawn else "=")
    if not equals or not name.strip() or not values.strip():
        raise InputError("not of the form group.name=values", where=f"--vary {text}", remedy=EXAMPLE)
    return name.strip(), ("~" if drawn else "") + values.strip()


def _free(name: str, values: Any, where: str) -> Varied:
    """Take the values of an argument of a function unchanged."""
    if isinstance(values, str) and values.startswith("~"):
        return Varied(name, (), distribution=read_distribution(
            values[1:], where=where, number=lambda text: number(text, "1", where=where), value=str, limits=Limits()
        ))  # fmt: skip
    if isinstance(values, str):
        raise InputError("a text, not a list of values", where=where, remedy="Give a list or an array")
    return Varied(name, _distinct(native(list(values)), where))


SECTIONS: Final = {**SETTABLE, **{group: (kind,) for group, kind in UNCERTAIN.items()}}
"""Sections of all groups of which something can be varied."""


def _find_field(name: str, where: str) -> FieldInfo:
    """Return the field of a parameter."""
    group, dot, key = name.partition(".")
    if not dot:
        raise InputError(f"{name!r} is not of the form group.name", where=where, remedy=EXAMPLE)
    section = parameter_sections(group, key, where=where, settable=SECTIONS)[0]
    return section_fields(section)[key]


def _read_parameter(name: str, values: Any, where: str) -> Varied:
    group, _, key = name.partition(".")
    if is_file_key(name):
        if isinstance(values, str) and values.startswith("~"):
            # Read the distribution of a key of an experiment file; one of values has them as the file would.
            field = file_field(name)
            if field is None:
                raise InputError(
                    f"an experiment file has no key {name}", where=where,
                    remedy="Name it as the file has it, such as forcing.eddy.speed",
                )  # fmt: skip
            return _drawn(name, values[1:], field, lambda text: file_value(text, where), where)
        return Varied(name, _distinct(_read_file_values(values, where), where), meaning="key of the experiment file")
    field = _find_field(name, where)
    if isinstance(values, str) and values.startswith("~"):

        def value(text: str) -> Any:  # a place in brackets, as the file has it, or a number with its unit
            text = file_value(text, where) if text[:1] == "[" else text
            return checked_value(text, group, key, where=where, settable=SECTIONS)

        return _drawn(f"{group}.{key}", values[1:], field, value, where)
    if any(get_origin(kind) is tuple for kind in value_kinds(field.annotation)) and isinstance(values, str):
        values = _read_file_values(values, where)  # such as [-39, -55],[-38, -55]
    several = _read(values, field, where) if isinstance(values, str) else _listed(values, where)
    plain = [checked_value(value, group, key, where=where, settable=SECTIONS) for value in several]
    return Varied(f"{group}.{key}", _distinct(plain, where), field_unit(field), field.description or "")


def _read_file_values(values: Any, where: str) -> list[Any]:
    """Read values of a key of the experiment file: a range, or a list with commas, in which lists stand in brackets."""
    if not isinstance(values, str):
        return _listed(values, where)
    texts, count = _parts(values, where)
    if not count:
        return [file_value(text, where) for text in texts]
    unit = re.sub(r"^[-+.\deE]+\s*", "", texts[1])
    first, last = (number(end.removesuffix(unit).strip(), "1", where=where) for end in texts)
    spaced = np.linspace(first, last, count).tolist()
    return [f"{value:.12g} {unit}" if unit else value for value in spaced]


def _parts(text: str, where: str) -> tuple[list[str], int]:
    """Return the values of a list with commas and 0, or the ends of a range ``LOW..HIGH:COUNT`` and its number of values.

    A unit at the end holds for all; lists stand in brackets.
    """
    bounds = _RANGE.match(text)
    if bounds is None:
        return with_unit_of_last([item.strip() for item in re.split(r",(?![^\[{]*[\]}])", text)], where), 0
    low, high, count = bounds.groups()
    if count is None or not count.strip().isdigit() or not 2 <= int(count) <= 1_000_000:
        message = "does not say how many values" if count is None else f"{value_shown(count)} is no number of values"
        raise InputError(message, where=where, remedy=f"Write the number, 2 or more, behind a colon: {low}..{high}:11")
    refuse_large(int(count), MOST_MEMBERS, "members", where=where, remedy="Give fewer values", kind=InputError)
    return with_unit_of_last([low.strip(), high.strip()], where), int(count)


def _drawn(name: str, text: str, field: FieldInfo, value: Callable[[str], Any], where: str) -> Varied:
    """Read the distribution of a parameter; one of several numbers has each of them drawn.

    ``value``: reads one of the values of a choice.
    """
    unit = field_unit(field)
    kinds = value_kinds(field.annotation)
    item = name.rpartition(".")[2].isdecimal()  # one of a list, such as forcing.uniform.current.0
    several = [len(get_args(kind)) for kind in kinds if get_origin(kind) is tuple and not item]
    limits = Limits.of(field.metadata)
    if name.rpartition(".")[2] in _POSITIVE and not np.isfinite(limits.low):
        limits = Limits(0.0, limits.high)
    of_values = text.partition("(")[0].strip().lower() in OF_VALUES
    if not of_values and not several and float not in (_numbers(field.annotation) if item else kinds):
        raise InputError(
            "a distribution of what is no number with decimals", where=where, remedy="Use choice(value, value, ...)"
        )
    if not of_values and several and unit == "degree":
        raise InputError(
            "one distribution for longitude and latitude", where=where,
            remedy=f"Give each its own, {name}.0 and {name}.1, or vary start.east and start.north",
        )  # fmt: skip
    distribution = read_distribution(
        text, where=where, limits=limits,
        number=lambda entry: number(entry, unit, where=where), value=value,
    )  # fmt: skip
    return Varied(name, (), unit, field.description or "", distribution, 1 if of_values or not several else several[0])


def _numbers(annotation: Any) -> Iterator[Any]:
    """Give the plain kinds of an annotation, those of items of lists too."""
    for kind in value_kinds(annotation):
        yield kind
        for item in get_args(kind):
            yield from _numbers(item) if item is not Ellipsis else ()


def _listed(values: Any, where: str) -> list[Any]:
    plain = native(values)
    if not isinstance(plain, list | tuple):
        raise InputError(f"{value_shown(values)} is no list of values", where=where, remedy="Give a list or an array")
    return list(plain)


def _read(text: str, field: FieldInfo, where: str) -> list[Any]:
    """Read evenly spaced values of a range, or the values of a list."""
    texts, count = _parts(text, where)
    if not count:
        return list(texts)
    is_integer = int in value_kinds(field.annotation) and float not in value_kinds(field.annotation)
    if not is_integer and float not in value_kinds(field.annotation):
        raise InputError("a range of what is no number", where=where, remedy=f"{allowed(field)}. Give them with commas")
    first, last = (number(end, field_unit(field), where=where) for end in texts)
    if not first < last:
        raise InputError(f"{texts[0]} is not below {texts[1]}", where=where, remedy="The smaller number stands first")
    values = np.linspace(first, last, count)
    if is_integer and not (values == np.round(values)).all():
        raise InputError("a range with steps that are no whole numbers", where=where, remedy=f"{allowed(field)}")
    return [int(value) if is_integer else float(value) for value in values]


def _distinct(values: Sequence[Any], where: str) -> tuple[Any, ...]:
    """Refuse no value, and the same value twice."""
    if not len(values):
        raise InputError("no values", where=where, remedy=EXAMPLE)
    for k, value in enumerate(values):
        # True and 1 are equal in Python, and no such pair.
        if any(type(value) is type(other) and value == other for other in values[:k]):
            raise InputError(f"{value_shown(value)} stands twice", where=where, remedy="Give each value once")
    return tuple(values)


@dataclass(frozen=True)
class Draws:
    """How members are drawn where something has a distribution, or an error is a random field."""

    number: int = 0  # Draws of each combination of listed values; 0 where nothing is drawn
    plan: str = "sobol"
    seed: int = 1


def check_draws(varied: Sequence[Varied], draws: Draws) -> None:
    """Refuse distributions without a number of members, and a number where nothing is drawn."""
    random = [v.name for v in varied if v.distribution is not None] or [v.name for v in varied if has_fields([v.name])]
    if random and draws.number < 1:
        raise InputError(
            f"{random[0]} is drawn, but not how often", where="members", remedy="Give --members 200, or members=200"
        )
    if draws != Draws() and not random:
        raise InputError(
            "nothing is drawn", where="members" if draws.number else "plan, seed",
            remedy=f"Leave it out, or give a distribution. {EXAMPLE_DRAWN}",
        )  # fmt: skip


def _rows(columns: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Turn columns of values by name into one mapping for each member."""
    return [dict(zip(columns, map(native, row), strict=True)) for row in zip(*columns.values(), strict=True)]


def list_members(varied: Sequence[Varied], draws: Draws | None = None) -> list[dict[str, Any]]:
    """Return every combination of the listed values, the last parameter changing fastest, for each draw in turn.

    So a member does not change when further ones are drawn.
    """
    draws = draws or Draws()
    check_draws(varied, draws)
    listed, drawn = [v for v in varied if v.distribution is None], [v for v in varied if v.distribution is not None]
    count = float(np.prod([len(v.values) for v in listed], dtype=float)) * max(draws.number, 1)
    if draws.plan in POINTS:
        if count > draws.number:
            raise InputError("lists of values", where=f"plan {draws.plan}", remedy="Use choice(value, value, ...)")
        count *= len(drawn) + POINTS[draws.plan] + has_fields([v.name for v in listed])
    refuse_large(int(count), MOST_MEMBERS, "members", where="--vary", remedy="Give fewer values", kind=InputError)
    combinations = list(itertools.product(*(v.values for v in listed)))
    order = [v.name for v in varied]
    seeded = bool(draws.number) and has_fields(order) and SEED not in order
    columns, seeds = _columns(drawn, draws, seeded) if draws.number else ({}, [0])
    columns_by_name = {v.name: [row[k] for _ in seeds for row in combinations] for k, v in enumerate(listed)}
    columns_by_name |= {name: [value for value in values for _ in combinations] for name, values in columns.items()}
    seed_column = {SEED: [seed for seed in seeds for _ in combinations]} if seeded else {}
    return _rows({name: columns_by_name[name] for name in order} | seed_column)


def read_design(path: Path) -> dict[str, list[str]]:
    """Return the columns of a plan made elsewhere: a table (CSV) with a name on top of each column and a member in each row."""
    remedy = "Give names such as fracture.normal_strength in the first line, and one member in each further line"
    rows = read_csv_rows(path)[0]
    names = [name.strip() for name in rows[0] if name is not None]  # None holds values beyond the last name
    if "" in names:
        raise InputError(
            f"column {names.index('') + 1} has no name",
            where=f"{path}, line 1",
            remedy="Leave out a column of row numbers",
        )
    for number_, row in enumerate(rows, start=2):
        if None in row or not all((value or "").strip() for value in row.values()):
            raise InputError(
                f"not one value for each of {len(names)} names", where=f"{path}, line {number_}", remedy=remedy
            )
    return {name.strip(): [row[name].strip() for row in rows] for name in rows[0]}


def plan_from_design(
    columns: Mapping[str, Sequence[Any]], *, free: bool = False
) -> tuple[tuple[Varied, ...], list[dict[str, Any]]]:
    """Return the inputs that a plan made elsewhere varies, and its members: one of each row.

    ``free``: a function makes the models, whose arguments take any value.
    """
    varied = []
    for name, values in columns.items():
        if free and not is_uncertain(name):
            varied.append(Varied(name, tuple(values)))
            continue
        where, key = f"--design, {name}", name.rpartition(".")[2]
        if is_file_key(name):
            file_values = [file_value(value, where) if isinstance(value, str) else value for value in values]
            varied.append(Varied(name, tuple(file_values), meaning="key of the experiment file"))
            continue
        field, (group, _, key) = _find_field(name, where), name.partition(".")
        refuse_bare_numbers([str(value) for value in values], where)
        plain = tuple(checked_value(value, group, key, where=where, settable=SECTIONS) for value in values)
        varied.append(Varied(name, plain, field_unit(field), field.description or ""))
    names = [v.name for v in varied]
    values_by_name: dict[str, Any] = {v.name: v.values for v in varied}
    count = len(varied[0].values)
    # Without seeds of its own a design would have one random field for all members.
    if has_fields(names) and SEED not in names:
        values_by_name[SEED] = [member_seed(Draws().seed, k) for k in range(count)]
    refuse_large(count, MOST_MEMBERS, "members", where="--design", remedy="Give fewer rows", kind=InputError)
    return tuple(varied), _rows(values_by_name)


def _columns(drawn: Sequence[Varied], draws: Draws, seeded: bool) -> tuple[dict[str, list[Any]], list[int]]:
    """Return the drawn values of each parameter, and the seed of the random fields of each row."""
    fields = seeded and draws.plan in POINTS  # there the random fields are one more input
    # What is taken in turn needs no draws of its own, but for plans that move one input after another.
    turns = [
        v for v in drawn if v.distribution is not None and v.distribution.name == "each" and draws.plan not in POINTS
    ]
    widths = [v.components for v in drawn if v not in turns] + [1] * fields
    share = shares(draws.number, sum(widths), draws.plan, draws.seed, widths)
    seeds = [int(row[-1] * 2**52) if fields else member_seed(draws.seed, k) for k, row in enumerate(share)]
    columns: dict[str, list[Any]] = {}
    first = 0
    for v in drawn:
        assert v.distribution is not None
        if v in turns:
            columns[v.name] = v.distribution.in_turn(len(share), draws.seed)
            continue
        components = [v.distribution.quantiles(share[:, first + k]) for k in range(v.components)]
        columns[v.name] = components[0] if v.components == 1 else list(zip(*components, strict=True))
        first += v.components
    for name, values in columns.items():
        if is_file_key(name):
            columns[name] = [list(value) if isinstance(value, tuple) else value for value in values]
            continue
        group, _, key = name.partition(".")
        if key and group in SECTIONS:
            columns[name] = [
                checked_value(value, group, key, where=f"--vary {name}", settable=SECTIONS) for value in values
            ]
    return columns, seeds


def grouped(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the parameters among values by ``group.name``, by group and name."""
    result: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if is_uncertain(name):
            continue
        group, _, key = name.partition(".")
        result.setdefault(group, {})[key] = value
    return result
