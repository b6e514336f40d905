"""What can be said of a berg, in experiment files and in Python alike: names, kinds, units and limits."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from riftberg.config.sections import Pair, Section, key, refuse_beyond
from riftberg.parameters import Packing

MOST: dict[str, float] = {"velocity": 10.0, "spin": 0.01}
"""What is larger than anything in nature."""


class BergKeys(Section):
    """Thickness, elements, place and motion of a berg of any shape."""

    thickness: float | str = key(200.0, "m", "ice thickness, or a file with a map of it")
    radius: float = key(1500.0, "m", "half the width of an element", gt=0, le=1e6)
    packing: Packing = key("square", "", "square or hexagonal elements")
    placement: Pair | None = key(None, "degree", "longitude and latitude of the centre")
    rotation: float = key(0.0, "degree", "turn of the finished berg, counter-clockwise")
    shift: Pair = key((0.0, 0.0), "degree", "longitude and latitude by which it is moved")
    velocity: Pair = key((0.0, 0.0), "m s-1", "eastward and northward velocity at the start")
    spin: float = key(0.0, "rad s-1", "angular velocity at the start, counter-clockwise")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        refuse_beyond(self, MOST)
        return self


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
