"""What all ways to make a berg have in common: what it is made of, and how it is laid out.

The constructors of `riftberg.bergs.iceberg.Iceberg` take these by name, beside what is their own; names, types and
defaults stand here once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict

from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import nearest
from riftberg.parameters import Packing


class Material(NamedTuple):
    """What a berg is made of.

    Attributes
    ----------
    thickness : float or array
        Ice thickness, m.
    radius : float or array
        Radius of the inscribed circle of an element, m.
    packing : {"square", "hexagonal"}
        Packing of the lattice, which gives the area of an element.
    density : float
        Ice density, kg m-3.
    velocity : tuple
        Eastward and northward velocity, m s-1.
    spin : float
        Angular velocity, rad s-1, counter-clockwise.
    earth_radius : float
        Radius of the sphere, m.
    latlon : bool
        Positions are degrees, otherwise metres.
    pieces : array of int, optional
        Piece of each element; elements of different pieces are not bonded.
    """

    thickness: Any
    radius: Any = 1500.0
    packing: Packing = "square"
    density: float = 850.0
    velocity: tuple[Any, Any] = (0.0, 0.0)
    spin: float = 0.0
    earth_radius: float = EARTH_RADIUS_A68
    latlon: bool = True
    pieces: Any = None


class Placing(NamedTuple):
    """How a shape is filled and where the berg is put.

    Attributes
    ----------
    rotation : float
        Degrees by which the finished berg is turned counter-clockwise about its centroid.
    shift : tuple of float
        Degrees of longitude and latitude by which it is moved.
    placement : tuple of float, optional
        Longitude and latitude of the centroid, instead of where the shape was drawn.
    offset : tuple of float, optional
        Shift of the lattice as parts of its pitch; by default that with the smallest error of area.
    conformal : bool
        Bonds start without strain; False is the rule of the reference (spec 8.3.8).
    """

    rotation: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    placement: tuple[float, float] | None = None
    offset: tuple[float, float] | None = None
    conformal: bool = True


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


def sorted_options(options: Mapping[str, Any], kind: type, thickness: Any) -> tuple[Material, Placing]:
    """Return options of a kind as material and layout.

    Parameters
    ----------
    options : mapping
        As a constructor was given them.
    kind : type
        The typed dict that names what that constructor takes.
    thickness : float, array or map
        Thickness, m.

    Raises
    ------
    TypeError
        If one has another name, as for any argument.
    """
    known = kind.__annotations__
    for name in options:
        if name not in known:
            raise TypeError(f"unexpected keyword argument {name!r}. {nearest(name, known)}It may be {', '.join(known)}")
    material = {name: value for name, value in options.items() if name in Material._fields}
    layout = {name: value for name, value in options.items() if name in Placing._fields}
    return Material(thickness, **material), Placing(**layout)
