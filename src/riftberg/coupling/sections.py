"""Sections of the files of couplings."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from riftberg.config.values import Section, explained, key
from riftberg.coupling.exchange import Edge, ocean_grid
from riftberg.errors import InputError
from riftberg.ocean.grid import Grid

Kind = TypeVar("Kind", bound=Section)


class Box(Section):
    """Cells of longitude and latitude in a box, as files of couplings give it in their section ``grid``."""

    west: float = key(..., "degree", "western edge", ge=-360, le=360)
    east: float = key(..., "degree", "eastern edge", ge=-360, le=720)
    south: float = key(..., "degree", "southern edge", ge=-90, le=90)
    north: float = key(..., "degree", "northern edge", ge=-90, le=90)
    columns: int = key(..., "", "cells from west to east", ge=1, le=10_000)
    rows: int = key(..., "", "cells from south to north", ge=1, le=10_000)
    edge: Edge = key("open", "", "open: bergs leave over it; closed: a coast")

    def cells(self, **options: Any) -> Grid:
        """Return its grid; options as of `ocean_grid`."""
        if not (self.west < self.east and self.south < self.north):
            raise InputError(
                f"no cells from {self.west:g} to {self.east:g} and {self.south:g} to {self.north:g} degrees", where="grid",
                remedy="Give west below east and south below north",
            )  # fmt: skip
        lon, lat = (
            np.linspace(self.west, self.east, self.columns + 1),
            np.linspace(self.south, self.north, self.rows + 1),
        )
        return ocean_grid(*np.meshgrid(lon, lat), edge=self.edge, **options)


def read_section(kind: type[Kind], values: Any, *, where: str) -> Kind:
    """Return a section of a file; refuse values that cannot be, each by its key."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise explained(error, kind, name=where) from error
