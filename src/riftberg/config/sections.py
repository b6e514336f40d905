"""Sections of what users set, in files and in Python alike: keys with a default, a unit, a meaning and limits."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from riftberg.config.values import UnfitError, check_degrees, check_place, fields_of, in_metres, plain_value
from riftberg.errors import InputError
from riftberg.system.input_files import value_shown

Pair = tuple[float, float]


class Section(BaseModel):
    """Base of all sections: values may carry units, unknown keys are refused, numbers are finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such key", "Allowed here: ")

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, values: Any) -> Any:
        """Take the name of a file for a section with nothing else (``outline: berg.geojson``)."""
        fields = fields_of(cls)
        if isinstance(values, str) and "file" in fields and values not in fields:
            return {"file": values}
        if not isinstance(values, dict | cls):
            raise cls._no_section(values)
        return {str(name): value for name, value in values.items()} if isinstance(values, dict) else values

    @classmethod
    def _no_section(cls, value: Any) -> UnfitError:
        """Return the refusal of what is no section."""
        return UnfitError(f"{value_shown(value)} is not a section", f"It has the keys {', '.join(fields_of(cls))}")

    @field_validator("*", mode="before")
    @classmethod
    def _plain(cls, value: Any, info: ValidationInfo) -> Any:
        return plain_value(value, fields_of(cls)[str(info.field_name)], metres=in_metres(info))


def about(unit: str, meaning: str, **options: Any) -> Any:
    """Describe an argument whose default stands behind it: unit, meaning, limits, and what `key` has under ``extra``."""
    extra: dict[str, Any] = {name: options.pop(name) for name in ("place", "units", "hidden") if name in options}
    return Field(description=meaning, json_schema_extra={"unit": unit, **extra}, **options)


def key(default: Any, unit: str, meaning: str, **options: Any) -> Any:
    """Describe one key of a section: default and what `about` takes."""
    extra: dict[str, Any] = {name: options.pop(name) for name in ("place", "units", "hidden") if name in options}
    return Field(default, description=meaning, json_schema_extra={"unit": unit, **extra}, **options)


PLACE: dict[str, Any] = {"place": True}
"""Marks a key as a place: longitude and latitude, or x and y in m where positions are metres."""


def _sea(place: Pair, info: ValidationInfo) -> Pair:
    if not in_metres(info):
        try:
            check_place(place, where="")
        except InputError as error:
            raise UnfitError(error.what, error.remedy) from error
    return place


Position = Annotated[Pair, AfterValidator(_sea)]
"""A place, which no swapped longitude and latitude can be."""


def _degrees(shift: Pair) -> Pair:
    try:
        check_degrees(shift, where="")
    except InputError as error:
        raise UnfitError(error.what, error.remedy) from error
    return shift


Shift = Annotated[Pair, AfterValidator(_degrees)]


def at_most(limit: float, unit: str) -> AfterValidator:
    """Return the check of one value, or each of several, against what is larger than anything in nature."""

    def check(value: Any) -> Any:
        if any(abs(part) > limit for part in (value if isinstance(value, tuple) else (value,))):
            raise UnfitError(f"{value} is not possible; the most is {limit:g} {unit}")
        return value

    return AfterValidator(check)


# Faster than any current, wind or ice that was ever measured: a slip of units, or km/h taken for m/s.
Velocity = Annotated[Pair, at_most(10.0, "m s-1")]
Wind = Annotated[Pair, at_most(150.0, "m s-1")]


def _thick(ice: tuple[float, float, float]) -> tuple[float, float, float]:
    if ice[2] < 0.0:
        raise UnfitError(f"sea_ice has a thickness of {ice[2]:g} m; it is 0 or more")
    return ice


SeaIce = Annotated[tuple[float, float, float], at_most(100.0, "m s-1 and m"), AfterValidator(_thick)]
"""Eastward and northward velocity, and thickness."""

ICE_UNITS: dict[str, Any] = {"units": ["m s-1", "m s-1", "m"]}
