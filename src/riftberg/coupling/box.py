"""A box of longitude and latitude with its cells, as configuration files of couplings give it."""

from __future__ import annotations

from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import ValidationError, model_validator

from riftberg.config.values import Section, UnfitError, explained, key
from riftberg.state import Floats

Kind = TypeVar("Kind", bound=Section)


class Box(Section):
    """Section ``grid``."""

    west: float = key(..., "degree", "western edge", ge=-360, le=360)
    east: float = key(..., "degree", "eastern edge", ge=-360, le=720)
    south: float = key(..., "degree", "southern edge", ge=-90, le=90)
    north: float = key(..., "degree", "northern edge", ge=-90, le=90)
    columns: int = key(..., "", "cells from west to east", ge=1, le=10_000)
    rows: int = key(..., "", "cells from south to north", ge=1, le=10_000)
    edge: Literal["open", "closed"] = key("open", "", "open: bergs leave over it; closed: a coast")

    @model_validator(mode="after")
    def _wide(self) -> Box:
        if not (self.west < self.east and self.south < self.north):
            raise UnfitError(
                f"no cells from {self.west:g} to {self.east:g} and {self.south:g} to {self.north:g} degrees",
                "Give west below east and south below north",
            )
        return self

    def corners(self) -> tuple[Floats, Floats]:
        """Return longitude and latitude (degrees) of the corners of the cells."""
        lon, lat = (
            np.linspace(self.west, self.east, self.columns + 1),
            np.linspace(self.south, self.north, self.rows + 1),
        )
        x, y = np.meshgrid(lon, lat)
        return x, y


def section(kind: type[Kind], values: Any, *, where: str) -> Kind:
    """Return a section of a file; refuse values that cannot be, each by its key."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise explained(error, kind, name=where) from error
