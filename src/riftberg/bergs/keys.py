"""Options of a berg, in experiment files and in Python alike: names, kinds, units and limits.

The constructors of `riftberg.bergs.iceberg.Iceberg` take `BergOptions` by name, beside their own; the typed dicts list
which each of them takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
from pydantic import AfterValidator, ValidationError, field_validator, model_validator

from riftberg.config.units import looks_like_quantity
from riftberg.config.values import (
    PLACE,
    Pair,
    Position,
    Section,
    Shift,
    UnfitError,
    Velocity,
    at_most,
    check_names,
    explained,
    given,
    key,
    moment,
    numbers,
    says_metres,
)
from riftberg.constants import EARTH_RADIUS_A68, RHO_SEAWATER
from riftberg.errors import BergError, InputError
from riftberg.parameters import Packing


def _within_a_pitch(offset: Pair) -> Pair:
    """Refuse a longer shift of the lattice, which would leave a strip of the outline empty."""
    if not all(0.0 <= fraction <= 1.0 for fraction in offset):
        raise UnfitError(
            f"({offset[0]:g}, {offset[1]:g}) is no shift within one pitch of the lattice",
            "Allowed: 2 numbers from 0 to 1, parts of the distance between neighbouring elements",
        )
    return offset


LATTICE = frozenset({"lattice_angle", "offset"})
"""Keys that say how the lattice lies in an outline."""


class LatticeKeys(Section):
    """Elements that fill a shape: a result should not depend on them."""

    radius: float = key(
        1500.0,
        "m",
        "half the width of an element; a berg smaller than one of the default size is one element, if no radius is given",
        gt=0,
        le=1e6,
    )
    packing: Packing = key("square", "", "square or hexagonal elements")
    lattice_angle: float = key(0.0, "degree", "rotation of the lattice inside the outline, counter-clockwise")
    # By default the shift with which the centre of the elements comes nearest to the centre of the outline.
    offset: Annotated[Pair, AfterValidator(_within_a_pitch)] | None = key(
        None, "", "shift of the lattice inside of the outline, in parts of the distance between its rows"
    )


class BergKeys(LatticeKeys):
    """Thickness, elements, place and motion of a berg of any shape."""

    thickness: float | str = key(200.0, "m", "ice thickness, or a file with a map of it")
    placement: Position | None = key(None, "degree", "longitude and latitude of the centre", **PLACE)
    rotation: float = key(0.0, "degree", "rotation of the finished berg, counter-clockwise")
    shift: Shift = key((0.0, 0.0), "degree", "longitude and latitude by which it is moved")
    velocity: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward velocity at the start")
    # A turn in ten minutes: a slip of units, such as degrees a day taken for rad/s.
    spin: Annotated[float, at_most(0.01, "rad s-1")] = key(
        0.0, "rad s-1", "angular velocity about the centre of mass at the start, counter-clockwise"
    )


class BergOptions(BergKeys):
    """Options of the constructors of a berg beside its shape."""

    # m; also one for each element, or a map that is sampled
    thickness: Any = None
    density: float = key(850.0, "kg m-3", "ice density", gt=0, lt=RHO_SEAWATER)
    earth_radius: float = key(EARTH_RADIUS_A68, "m", "radius of the sphere", gt=0)
    latlon: bool = key(True, "", "positions are degrees, otherwise metres")
    pieces: Any = None  # piece of each element; elements of different pieces are not bonded
    conformal: bool = key(True, "", "bonds start without strain; false is the rule of the reference (files 8.3)")


class MaterialOptions(TypedDict, total=False):
    """Options of every constructor."""

    radius: float
    packing: Packing
    density: float
    velocity: tuple[float, float]
    spin: float
    earth_radius: float


class ShapeOptions(MaterialOptions, total=False):
    """Options of the constructors that fill a shape drawn in degrees."""

    rotation: float
    shift: tuple[float, float]
    placement: tuple[float, float] | None
    offset: tuple[float, float] | None
    lattice_angle: float
    conformal: bool


class TableOptions(MaterialOptions, total=False):
    """Options of `Iceberg.from_table`."""

    rotation: float
    lattice_angle: float
    offset: tuple[float, float] | None
    conformal: bool
    latlon: bool


class PointOptions(TypedDict, total=False):
    """Options of `Iceberg.from_points`; arrays hold one value per element."""

    radius: Any
    packing: Packing
    density: float
    velocity: tuple[Any, Any]
    spin: float
    earth_radius: float
    latlon: bool
    pieces: Any


class FieldOptions(TypedDict, total=False):
    """Options of `Iceberg.field` beside those that make a field."""

    density: float
    velocity: tuple[Any, Any]
    latlon: bool
    earth_radius: float


class CloudOptions(FieldOptions, total=False):
    """Options of `Iceberg.cloud` beside those that make a cloud."""

    length: float | None
    width: float | None
    gap: float
    between: tuple[float, float]
    overlap: bool
    dates: Any


def berg_options(options: Mapping[str, Any], kind: type, thickness: Any, **further: Any) -> BergOptions:
    """Return options without units; a typed dict lists those that are known, and ``further`` are further ones."""
    check_names(options, kind, "thickness", *further)
    thickness, metres = _thickness(thickness), says_metres(options.get("latlon"))
    # Arrays with one value for each element pass by the section, whose limits hold for one number.
    each = {name: _each(name, value) for name, value in options.items() if _one_per_element(name, value)}
    scalars = {name: value for name, value in options.items() if name not in each} | further
    if "placement" in further and further["placement"] is None:
        raise BergError("no place", where="placement", remedy="Give longitude and latitude (x and y in metres)")
    try:
        settings = BergOptions.model_validate(scalars, context={"metres": metres})
    except ValidationError as error:
        raise explained(error, BergOptions, kind=BergError, metres=metres) from error
    return settings.model_copy(update={**each, "thickness": thickness})


def _thickness(thickness: Any) -> Any:
    """Return a thickness with a unit, or a Series or list of thicknesses, in metres; maps and paths pass unchanged."""
    if (
        isinstance(thickness, bool)
        or thickness is None
        or (isinstance(thickness, str) and looks_like_quantity(thickness))
    ):
        return given(thickness, BergKeys, "thickness", kind=BergError)
    if isinstance(thickness, list | tuple) or type(thickness).__module__.startswith("pandas"):
        return numbers(thickness, "m", where="thickness", kind=BergError)
    return thickness


def _one_per_element(name: str, value: Any) -> bool:
    if name == "velocity":
        return isinstance(value, tuple | list) and any(np.ndim(component) > 0 for component in value)
    return name in ("radius", "spin", "pieces") and not isinstance(value, str) and np.ndim(value) > 0


def _each(name: str, value: Any) -> Any:
    if name == "pieces":
        return value
    unit = {"radius": "m", "velocity": "m s-1", "spin": "rad s-1"}[name]
    components = [
        numbers(component, unit, where=name, kind=BergError) for component in (value if name == "velocity" else [value])
    ]
    return tuple(components) if name == "velocity" else components[0]


class Rectangle(Section):
    """Idealised shape."""

    length: float = key(..., "m", "extent to the east before rotation", gt=0, le=1e8)
    width: float = key(..., "m", "extent to the north before rotation", gt=0, le=1e8)


class CloudOfBergs(Section):
    """Bergs of one element each around a place, which do not touch each other."""

    number: int = key(..., "", "number of bergs", ge=1)
    radius: float = key(..., "m", "distance from the place within which they lie", gt=0, le=1e7)
    length: float | None = key(None, "m", "length of each berg; by default sizes are drawn", gt=0, le=1e6)
    width: float | None = key(None, "m", "width of each berg; by default its length", gt=0, le=1e6)
    sizes: Literal["gladstone", "tournadre"] = key("gladstone", "", "distribution of the sizes, without a length")
    between: Pair = key((0.1e6, 10e6), "m2", "least and largest area of the power law (tournadre)")
    gap: float = key(0.0, "m", "least distance between bergs", ge=0)
    overlap: bool = key(False, "", "draw places without a look at the other bergs, for stepping.interactions: false")
    dates: list[datetime] | None = key(
        None,
        "",
        "first and last date (UTC) between which the bergs come into being evenly; one in a list for all of them",
    )
    seed: int = key(1, "", "the same seed gives the same cloud", ge=0)

    @field_validator("dates", mode="before")
    @classmethod
    def _as_dates(cls, dates: Any) -> Any:
        try:
            return [moment(date, where="") for date in dates] if isinstance(dates, list) else dates
        except InputError as error:
            raise UnfitError(error.what, error.remedy) from error

    @model_validator(mode="after")
    def _one_kind_of_size(self) -> CloudOfBergs:
        if self.width is not None and self.length is None:
            raise ValueError("a width without a length")
        if self.length is not None and "sizes" in self.model_fields_set:
            raise ValueError("give either length or sizes")
        if "between" in self.model_fields_set and self.sizes != "tournadre":
            raise ValueError(f"between is that of sizes: tournadre; {self.sizes} has sizes of its own")
        return self


class FieldOfBergs(Section):
    """Many bergs of one element each, at random places that do not overlap."""

    number: int = key(..., "", "number of bergs", ge=1)
    area: tuple[float, float, float, float] = key(..., "degree", "west, east, south and north (m in metres)")
    sizes: Literal["gladstone", "tournadre"] = key("gladstone", "", "distribution of the sizes")
    between: Pair = key((0.1e6, 10e6), "m2", "least and largest area of the power law (tournadre)")
    gap: float = key(0.0, "m", "least distance between bergs", ge=0)
    seed: int = key(1, "", "the same seed gives the same field", ge=0)

    @model_validator(mode="after")
    def _sizes_between(self) -> FieldOfBergs:
        if "between" in self.model_fields_set and self.sizes != "tournadre":
            raise ValueError(f"between is that of sizes: tournadre; {self.sizes} has sizes of its own")
        return self


class LatticeRows(Section):
    """Shape from the rows of a square lattice."""

    rows: list[tuple[int, int, int]] = key(..., "", "row, first column and last column, from south to north")
    cell_radius: float = key(1500.0, "m", "half the side of a cell of these rows", gt=0)
