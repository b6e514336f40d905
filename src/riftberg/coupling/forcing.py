"""The state of an ocean model as the forcing of bergs: put anew before each step."""

from __future__ import annotations

from typing import Any, Final

from riftberg.ocean.grid import Grid
from riftberg.ocean.grid_arrays import Fields
from riftberg.ocean.gridded import GriddedForcing


class OceanForcing(GriddedForcing):
    """Fields on the grid of an ocean model; each step of the exchange puts new ones in their place.

    Parameters
    ----------
    grid : Grid
        Of the ocean model.
    fields : Fields
        At the start.
    **options
        How fields reach the elements, see `riftberg.ocean.gridded.GriddedForcing`.

    Attributes
    ----------
    provides : frozenset of str
        What each step brings of the water; `Exchange.step` sees to it.
    """

    provides: Final = frozenset({"sst", "sss"})

    def __init__(self, grid: Grid, fields: Fields, **options: Any) -> None:
        super().__init__(grid, fields, **options)
        self.ocean_grid = grid

    def put(self, fields: Fields) -> Fields:
        """Take the fields of a step; return them as the bergs see them: without gaps, 0 on land."""
        self.replace(fields)
        return self.fields_at(0.0)
