"""What may be uncertain beside the parameters: where the berg starts and what it is like, and the errors of its surroundings.

These are keys of `--vary` like the parameters, and hold for any experiment: they change a model at its start.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from riftberg.config.values import Section, key, parse_date
from riftberg.errors import InputError
from riftberg.experiments.changes import started
from riftberg.ocean.errors import Errors, FieldError, UncertainForcing
from riftberg.system.input_files import rows_of_csv

if TYPE_CHECKING:
    from riftberg.runs.model import Model


class Start(Section):
    """The berg at the start, against what the experiment says."""

    east: float = key(0.0, "m", "distance by which the berg starts farther east", ge=-1e6, le=1e6)
    north: float = key(0.0, "m", "distance by which the berg starts farther north", ge=-1e6, le=1e6)
    error: float = key(1.0, "1", "factor on east and north, so that starts may differ in their errors", ge=0, le=1e6)
    turn: float = key(0.0, "degree", "turn of the berg at the start, counter-clockwise", ge=-360, le=360)
    thickness: float = key(1.0, "1", "factor on the thickness, and so on the mass", gt=0, le=10)
    size: float = key(1.0, "1", "factor on length and width of the outline and of each element", gt=0, le=10)
    strength: float = key(1.0, "1", "factor on the strength of all bonds", gt=0, le=100)


class CurrentError(Section):
    """Error of the current: a factor, and a random error of the sea level with the current that balances it."""

    scale: float = key(1.0, "1", "factor on the current and the slope of the sea surface everywhere", ge=0, le=10)
    speed: float = key(0.0, "m s-1", "standard deviation of each component of the current's error", ge=0, le=10)
    length: float = key(50e3, "m", "length L of the correlation exp(-r2 / 2 L2) of the level's error", gt=0, le=1e7)
    time: float = key(3 * 86400.0, "s", "time T of the correlation exp(-t / T)", gt=0, le=1e9)
    field: str | None = key(
        None, "", "file of a product that states its own error of the current: its size by place, in place of speed"
    )


class WindError(Section):
    """Error of the wind: a factor, and a random error without divergence."""

    scale: float = key(1.0, "1", "factor on the wind everywhere", ge=0, le=10)
    speed: float = key(0.0, "m s-1", "standard deviation of each component of the wind's error", ge=0, le=100)
    length: float = key(300e3, "m", "length L of the correlation exp(-r2 / 2 L2) of the stream function", gt=0, le=1e7)
    time: float = key(86400.0, "s", "time T of the correlation exp(-t / T)", gt=0, le=1e9)


class FloorError(Section):
    """Error of the depth of water."""

    offset: float = key(0.0, "m", "depth that is added everywhere", ge=-1e4, le=1e4)
    scale: float = key(1.0, "1", "factor on the depth everywhere", gt=0, le=10)
    spread: float = key(0.0, "m", "standard deviation of a random field on the depth, at least", ge=0, le=1e4)
    share: float = key(0.0, "1", "the same in parts of the depth; the larger of both counts", ge=0, le=1)
    length: float = key(10e3, "m", "length L of the correlation exp(-r2 / 2 L2) of that field", gt=0, le=1e7)


class Seed(Section):
    """Seed of the random fields."""

    seed: int = key(1, "", "seed of the random fields of a member, drawn unless it is given", ge=0)


UNCERTAIN: Final[dict[str, Any]] = {
    "start": Start, "current_error": CurrentError, "wind_error": WindError, "floor_error": FloorError, "errors": Seed
}  # fmt: skip
"""Groups that are no parameters."""

SEED: Final = "errors.seed"


def is_uncertain(name: str) -> bool:
    """Whether a name is one of these, and no parameter."""
    return "." in name and name.partition(".")[0] in UNCERTAIN  # ``start`` alone is the date in an experiment file


def has_fields(names: Any) -> bool:
    """Whether members with these inputs have random fields."""
    return any(name.endswith(("_error.speed", "_error.spread", "_error.share", "_error.field")) for name in names)


def check_sizes(names: Collection[str]) -> None:
    """Refuse the length or time of a random error that has no size: it would do nothing."""
    sizes = {"current_error": ("speed", "field"), "wind_error": ("speed",), "floor_error": ("spread", "share")}
    for group, own in sizes.items():
        scales = [name for name in names if name in (f"{group}.length", f"{group}.time")]
        if scales and not any(f"{group}.{size}" in names for size in own):
            raise InputError(
                "the scale of an error that has no size", where=f"--vary {scales[0]}",
                remedy=f"Give {' or '.join(f'{group}.{size}' for size in own)} too, or leave it out",
            )  # fmt: skip


def with_errors(model: Model, values: Mapping[str, Any]) -> Model:
    """Return a model at its start with what is uncertain changed."""
    keys: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if is_uncertain(name):
            group, _, key_ = name.partition(".")
            keys.setdefault(group, {})[key_] = value
    if not keys:
        return model
    sections: dict[str, Any] = {group: kind(**keys.get(group, {})) for group, kind in UNCERTAIN.items()}
    begun = _started(model, sections["start"])
    errors = _errors(sections)
    if errors != Errors(seed=errors.seed):
        earth = model.parameters.earth
        plane = earth.f_plane or not earth.latlon
        begun.forcing = UncertainForcing(
            begun.forcing, errors, begun.elements, latlon=earth.latlon,
            latitude=earth.reference_latitude if plane else None,
        )  # fmt: skip
    return begun


def _errors(sections: Mapping[str, Any]) -> Errors:
    c, w, f = sections["current_error"], sections["wind_error"], sections["floor_error"]
    size = None
    if c.field is not None:
        from riftberg.ensembles.product_errors import stated_error

        size = stated_error(c.field)
    speed = c.speed if size is None else 1.0  # the field holds the size
    return Errors(
        current=FieldError(speed, c.length, c.time) if speed > 0.0 else None, current_size=size,
        wind=FieldError(w.speed, w.length, w.time) if w.speed > 0.0 else None,
        floor=FieldError(1.0, f.length) if f.spread > 0.0 or f.share > 0.0 else None,
        floor_offset=f.offset, floor_scale=f.scale, floor_spread=f.spread, floor_share=f.share,
        current_scale=c.scale, wind_scale=w.scale, seed=sections["errors"].seed,
    )  # fmt: skip


def _started(model: Model, start: Start) -> Model:
    """Return the model anew with its berg moved, turned and changed."""
    if start == Start():
        return model
    if model.life is not None and start.size != 1.0:
        raise InputError(
            "melt of a berg whose size is varied is not possible", where="start.size", remedy="Vary start.thickness"
        )
    return started(
        model, east=start.error * start.east, north=start.error * start.north, turn=start.turn, size=start.size,
        thickness=start.thickness,
        strength=start.strength,
    )  # fmt: skip


# --- several observed starts ---------------------------------------------------------------------------------------------

COLUMNS: Final = ("date", "lon", "lat", "error_km", "age_hours", "outline")
"""Columns of a table of starts; `lon` with `lat`, all others by themselves."""

SPEED_OF_AGE: Final = 0.12
"""Speed (m s-1, along each axis) by which the error of a position grows with its age.

Half of the giant bergs north of 60 S are 12.4 km away after a day (`riftberg verify-tracks`, staying put): the median of a
normal distribution in two dimensions with a standard deviation of 10.5 km along each axis.
"""


def read_starts(path: str | Path) -> dict[str, str]:
    """Return what a table of starts varies, row after row in turn, as `riftberg.forecast` takes it.

    Parameters
    ----------
    path : path
        Table (CSV) with some of the columns ``date`` (members start then; at or before the start of the experiment), ``lon``
        and ``lat`` (degrees, of the middle of the berg), ``error_km`` (standard deviation along each axis), ``age_hours``
        (how old the position is at the start: the error grows by 0.12 m/s) and ``outline`` (file, as ``berg.outline.file``).

    Returns
    -------
    dict of str
        Distributions by name.

    Raises
    ------
    InputError
        If the table has none of these columns, or a row that cannot be read.
    """
    rows = [
        {str(key).strip().lower(): (value or "").strip() for key, value in row.items()}
        for row in rows_of_csv(Path(path))[0]
    ]
    held = [name for name in COLUMNS if name in rows[0]]
    other = [name for name in rows[0] if name not in COLUMNS]
    if not held or other or ("lon" in held) != ("lat" in held):
        what = f"a column {other[0]!r}" if other else "no column of a start" if not held else "lon without lat"
        raise InputError(what, where=str(path), remedy=f"Columns are {', '.join(COLUMNS)}")
    found: dict[str, list[str]] = {}
    for number, row in enumerate(rows, start=2):
        for name, value in _of_row(row, f"{path}, line {number}").items():
            found.setdefault(name, []).append(value)
    varied = {name: f"~each({', '.join(values)})" for name, values in found.items()}
    if "start.error" in varied:
        varied |= dict.fromkeys(("start.east", "start.north"), "~normal(0 m, 1 m)")
    return varied


def _of_row(row: dict[str, str], where: str) -> dict[str, str]:
    """Return the values of one start by the names of `--vary`."""

    def number(name: str, low: float, high: float) -> float:
        try:
            value = float(row[name])
        except ValueError as error:
            raise InputError(f"{name}: no number", where=where, remedy="Give a number in every row") from error
        if not low <= value <= high:
            raise InputError(f"{name}: {value:g}", where=where, remedy=f"Give {low:g} to {high:g}")
        return value

    values: dict[str, Any] = {}
    if "date" in row:
        values["start"] = parse_date(row["date"], where=where)[0].isoformat(sep=" ")
    if "lon" in row:
        values["berg.placement"] = f"[{number('lon', -540.0, 540.0):.10g}, {number('lat', -90.0, 90.0):.10g}]"
    if "error_km" in row or "age_hours" in row:
        error = 1e3 * number("error_km", 0.0, 500.0) if "error_km" in row else 0.0
        age = 3600.0 * number("age_hours", 0.0, 2400.0) if "age_hours" in row else 0.0
        values["start.error"] = f"{math.hypot(error, SPEED_OF_AGE * age):.6g}"
    if "outline" in row:
        if not row["outline"]:
            raise InputError("outline: no file", where=where, remedy="Name a file in every row")
        values["berg.outline.file"] = row["outline"]
    return values
