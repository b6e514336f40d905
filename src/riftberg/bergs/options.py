"""What all ways to make a berg have in common: what it is made of, and how it is laid out.

The constructors of `riftberg.bergs.iceberg.Iceberg` take these by name, beside what is their own; names, types and
defaults stand here once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict

import numpy as np

from riftberg.bergs.keys import BergKeys
from riftberg.config.units import looks_like_quantity
from riftberg.config.values import check_names, flag, given, native, number, numbers
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import BergError
from riftberg.parameters import Earth, Ice, Packing
from riftberg.system.input_files import value_shown


class Material(NamedTuple):
    """What a berg is made of."""

    thickness: Any  # Ice thickness, m
    radius: Any = 1500.0  # Radius of the inscribed circle of an element, m
    packing: Packing = "square"  # Packing of the lattice, which gives the area of an element
    density: float = 850.0  # Ice density, kg m-3
    velocity: tuple[Any, Any] = (0.0, 0.0)  # Eastward and northward velocity, m s-1
    spin: float = 0.0  # Angular velocity, rad s-1, counter-clockwise
    earth_radius: float = EARTH_RADIUS_A68  # Radius of the sphere, m
    latlon: bool = True  # Positions are degrees, otherwise metres
    pieces: Any = None  # Piece of each element; elements of different pieces are not bonded


class Placing(NamedTuple):
    """How a shape is filled and where the berg is put."""

    rotation: float = 0.0  # Degrees by which the finished berg is turned counter-clockwise about its centroid
    shift: tuple[float, float] = (0.0, 0.0)  # Degrees of longitude and latitude by which it is moved
    # Longitude and latitude of the centroid, instead of where the shape was drawn
    placement: tuple[float, float] | None = None
    # Shift of the lattice as parts of its pitch; by default that with the smallest error of area
    offset: tuple[float, float] | None = None
    conformal: bool = True  # Bonds start without strain; False is the rule of the reference (files 8.3)


class MaterialOptions(TypedDict, total=False):
    """Fields of `Material` that every constructor takes."""

    radius: float
    packing: Packing
    density: float
    velocity: tuple[float, float]
    spin: float
    earth_radius: float


class ShapeOptions(MaterialOptions, total=False):
    """What the constructors take that fill a shape drawn in degrees."""

    rotation: float
    shift: tuple[float, float]
    placement: tuple[float, float] | None
    offset: tuple[float, float] | None
    conformal: bool


class TableOptions(MaterialOptions, total=False):
    """What `Iceberg.from_table` takes."""

    rotation: float
    conformal: bool
    latlon: bool


class RectangleOptions(TableOptions, total=False):
    """What `Iceberg.rectangle` takes."""

    offset: tuple[float, float] | None


class PointOptions(TypedDict, total=False):
    """What `Iceberg.from_points` takes; arrays hold one value per element."""

    radius: Any
    packing: Packing
    density: float
    velocity: tuple[Any, Any]
    spin: float
    earth_radius: float
    latlon: bool
    pieces: Any


class FieldOptions(TypedDict, total=False):
    """What `Iceberg.field` takes beside what makes a field."""

    density: float
    velocity: tuple[Any, Any]
    latlon: bool
    earth_radius: float


def sorted_options(options: Mapping[str, Any], kind: type, thickness: Any) -> tuple[Material, Placing]:
    """Return options of a kind as material and layout.

    ``thickness``: thickness, m.
    """
    check_names(options, kind)
    plain = {name: option(name, value, bool(options.get("latlon", True))) for name, value in options.items()}
    material = {name: value for name, value in plain.items() if name in Material._fields}
    layout = {name: value for name, value in plain.items() if name in Placing._fields}
    return Material(plain_thickness(thickness), **material), Placing(**layout)


def plain_thickness(thickness: Any) -> Any:
    """Return a thickness with a unit, or a Series or list of thicknesses, in metres; maps and paths pass as they are."""
    if isinstance(thickness, bool) or thickness is None:
        return given(thickness, BergKeys, "thickness", kind=BergError)
    if isinstance(thickness, str):
        return given(thickness, BergKeys, "thickness", kind=BergError) if looks_like_quantity(thickness) else thickness
    if isinstance(thickness, list | tuple) or type(thickness).__module__.startswith("pandas"):
        return numbers(thickness, "m", where="thickness", kind=BergError)
    return thickness


def given_place(value: Any, latlon: bool) -> Any:
    """Return the place of a centre that must be given."""
    if value is None:
        raise BergError("no place", where="placement", remedy="Give longitude and latitude (x and y in metres)")
    return option("placement", value, latlon)


def option(name: str, value: Any, latlon: bool = True) -> Any:
    """Return an option of a constructor without unit and of a plain kind, or refuse it."""
    if name == "pieces" or (value is None and name in ("placement", "offset")):
        return value
    if name == "offset":
        return _part_of_pitch(name, value)
    if name in ("latlon", "conformal"):
        return flag(value, where=name, kind=BergError)
    if name == "density":
        return given(value, Ice, "density", where=name, kind=BergError)
    if name == "earth_radius":
        return given(value, Earth, "radius", where=name, kind=BergError)
    return _of_berg(name, value, latlon)


def _of_berg(name: str, value: Any, latlon: bool) -> Any:
    if name in ("radius", "velocity", "spin") and _one_per_element(value, name):
        unit = {"radius": "m", "velocity": "m s-1", "spin": "rad s-1"}[name]
        parts = [numbers(part, unit, where=name, kind=BergError) for part in (value if name == "velocity" else [value])]
        return tuple(parts) if name == "velocity" else parts[0]
    return given(value, BergKeys, name, kind=BergError, metres=not latlon)


def _pair(name: str, value: Any, unit: str) -> tuple[float, float]:
    """Return two numbers in a unit."""
    plain = native(value)
    if not isinstance(plain, list | tuple) or len(plain) != 2:
        measured = "" if unit == "1" else f", in {unit}"
        raise BergError(f"{value_shown(value)} is not two numbers", where=name, remedy=f"Allowed: 2 numbers{measured}")
    first, second = (number(part, unit, where=name, kind=BergError) for part in plain)
    return first, second


def _part_of_pitch(name: str, value: Any) -> tuple[float, float]:
    """Return a shift of the lattice; a longer one would leave a strip of the outline empty."""
    parts = _pair(name, value, "1")
    if not all(0.0 <= part <= 1.0 for part in parts):
        raise BergError(
            f"({parts[0]:g}, {parts[1]:g}) is no shift within one pitch of the lattice", where=name,
            remedy="Allowed: 2 numbers from 0 to 1, parts of the distance between neighbouring elements",
        )  # fmt: skip
    return parts


def _one_per_element(value: Any, name: str) -> bool:
    """Whether an option holds one value for each element."""
    if name == "velocity":
        return isinstance(value, tuple | list) and any(np.ndim(part) > 0 for part in value)
    return not isinstance(value, str) and np.ndim(value) > 0
