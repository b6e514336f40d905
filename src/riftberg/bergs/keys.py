"""What can be said of a berg, in experiment files and in Python alike: names, kinds, units and limits."""

from __future__ import annotations

from typing import Annotated, Literal

from riftberg.config.sections import PLACE, Pair, Position, Section, Shift, Velocity, at_most, key
from riftberg.parameters import Packing


class BergKeys(Section):
    """Thickness, elements, place and motion of a berg of any shape."""

    thickness: float | str = key(200.0, "m", "ice thickness, or a file with a map of it")
    radius: float = key(1500.0, "m", "half the width of an element", gt=0, le=1e6)
    packing: Packing = key("square", "", "square or hexagonal elements")
    placement: Position | None = key(None, "degree", "longitude and latitude of the centre", **PLACE)
    rotation: float = key(0.0, "degree", "turn of the finished berg, counter-clockwise")
    shift: Shift = key((0.0, 0.0), "degree", "longitude and latitude by which it is moved")
    velocity: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward velocity at the start")
    # A turn in ten minutes: a slip of units, such as degrees a day taken for rad/s.
    spin: Annotated[float, at_most(0.01, "rad s-1")] = key(
        0.0, "rad s-1", "angular velocity at the start, counter-clockwise"
    )


class Rectangle(Section):
    """Idealised shape."""

    length: float = key(..., "m", "extent to the east before rotation", gt=0, le=1e8)
    width: float = key(..., "m", "extent to the north before rotation", gt=0, le=1e8)


class FieldOfBergs(Section):
    """Many bergs of one element each, at random places that do not overlap."""

    number: int = key(..., "", "number of bergs", ge=1)
    area: tuple[float, float, float, float] = key(..., "degree", "west, east, south and north (m in metres)")
    sizes: Literal["gladstone", "tournadre"] = key("gladstone", "", "distribution of the sizes")
    between: Pair = key((0.1e6, 10e6), "m2", "least and largest area of the power law (tournadre)")
    gap: float = key(0.0, "m", "least distance between bergs", ge=0)
    seed: int = key(1, "", "the same seed gives the same field", ge=0)


class LatticeRows(Section):
    """Shape from the rows of a square lattice."""

    rows: list[tuple[int, int, int]] = key(..., "", "row, first column and last column, from south to north")
    cell_radius: float = key(1500.0, "m", "half the side of a cell of these rows", gt=0)
