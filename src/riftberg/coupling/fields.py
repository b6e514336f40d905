"""Fields that are exchanged: names, units and limits (CF standard names where the table has one), and the forcing they make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError, nearest
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid, first_gap
from riftberg.ocean.gridded import GriddedForcing
from riftberg.state import Floats


class Exchanged(NamedTuple):
    """An exchanged field."""

    field: str  # Short name here; of what comes in, the field of `riftberg.ocean.cells.Fields` where there is one
    units: str  # Units in which it is handed over unless others are stated
    meaning: str  # In plain words
    low: float = -np.inf  # Limits of what can be
    high: float = np.inf  # Limits of what can be
    short: str = ""  # Name in files: that of CMIP where there is one
    standard: bool = True  # Whether its name is one of CF's table


TAKEN: Final[dict[str, Exchanged]] = {
    "eastward_sea_water_velocity": Exchanged(
        "uo", "m s-1", "current at the surface, along the rows of the grid", -20, 20
    ),
    "northward_sea_water_velocity": Exchanged("vo", "m s-1", "current at the surface, across the rows", -20, 20),
    "eastward_sea_ice_velocity": Exchanged("ui", "m s-1", "sea-ice velocity along the rows", -20, 20),
    "northward_sea_ice_velocity": Exchanged("vi", "m s-1", "sea-ice velocity across the rows", -20, 20),
    "eastward_wind": Exchanged("ua", "m s-1", "wind along the rows", -150, 150),
    "northward_wind": Exchanged("va", "m s-1", "wind across the rows", -150, 150),
    "surface_downward_eastward_stress": Exchanged(
        "taux", "Pa", "stress of the wind along the rows, in place of it", -20, 20
    ),
    "surface_downward_northward_stress": Exchanged("tauy", "Pa", "stress of the wind across the rows", -20, 20),
    "sea_surface_height_above_geoid": Exchanged("ssh", "m", "sea level", -100, 100),
    "sea_surface_temperature": Exchanged("sst", "degree_Celsius", "temperature of the water", -5, 60),
    "sea_surface_salinity": Exchanged("sss", "1e-3", "salinity of the water", 0, 60),
    "sea_ice_area_fraction": Exchanged("ice_fraction", "1", "part of the sea that sea ice covers", 0, 1),
    "sea_ice_thickness": Exchanged("ice_thickness", "m", "thickness of sea ice", 0, 100),
    "sea_floor_depth_below_geoid": Exchanged("depth", "m", "depth of the sea floor", 0, 2e4),
    "land_ice_specific_mass_flux_due_to_calving": Exchanged(
        "calving", "kg m-2 s-1", "ice that leaves the land", 0, 1e3
    ),
    "heat_flux_of_calved_ice": Exchanged(
        "calving_heat", "W m-2", "heat that this ice brings, from ice at its melting point", -1e9, 1e9, standard=False
    ),
}
"""What the ocean hands over in a step, by name."""

GIVEN: Final[dict[str, Exchanged]] = {
    "water_flux_into_sea_water_from_icebergs": Exchanged("melt", "kg m-2 s-1", "melt water of bergs", short="ficeberg"),
    "heat_flux_into_sea_water_due_to_iceberg_thermodynamics": Exchanged(
        "heat", "W m-2", "heat that melting brings to the sea; negative", short="hfibthermds2d"
    ),
    "water_flux_into_sea_water_from_land_ice": Exchanged(
        "left", "kg m-2 s-1", "land ice that became no berg", short="flandice"
    ),
    "heat_flux_into_sea_water_due_to_land_ice": Exchanged(
        "left_heat", "W m-2", "heat that this ice brings to the sea; negative", short="hflandice", standard=False
    ),
    "iceberg_mass_on_sea_water": Exchanged(
        "mass", "kg m-2", "mass of bergs that the water bears", short="ibmass", standard=False
    ),
    "grounded_iceberg_mass": Exchanged(
        "grounded", "kg m-2", "mass of bergs that the sea floor bears", short="ibmassgrd", standard=False
    ),
    "iceberg_area_fraction": Exchanged(
        "area", "1", "part of the cell that bergs cover", short="ibarea", standard=False
    ),
    "iceberg_friction_velocity": Exchanged(
        "ustar", "m s-1", "friction velocity of the water under bergs", short="ibustar", standard=False
    ),
    "downward_eastward_stress_from_icebergs": Exchanged(
        "stress_x", "Pa", "drag of bergs on the water, along the rows", short="ibtaux", standard=False
    ),
    "downward_northward_stress_from_icebergs": Exchanged(
        "stress_y", "Pa", "drag of bergs on the water, across the rows", short="ibtauy", standard=False
    ),
}
"""What the ocean gets back, by name."""


def taken(
    given: Mapping[str, Any], shapes: Mapping[str, tuple[tuple[int, int], ...]], mask: Floats
) -> dict[str, Floats]:
    """Check the fields from an ocean, and return arrays by short name in the units used here."""
    arrays = {}
    for name, value in given.items():
        if name not in TAKEN:
            raise InputError(
                f"unknown field {name!r}",
                where="exchange",
                remedy=f"{nearest(name, TAKEN)}Fields are {', '.join(TAKEN)}",
            )
        from riftberg.products.quantities import unit_change  # with xarray, half a second; KID runs exchange nothing

        quantity = TAKEN[name]
        values, units = _split(value, quantity.units)
        change = unit_change(units, quantity.units)
        if change is None:
            raise InputError(f"units are {units!r}", where=f"exchange, {name}", remedy=f"Give it in {quantity.units}")
        values = change[0] * values + change[1]
        if values.ndim and values.shape not in shapes[quantity.field]:
            raise InputError(
                f"shape {values.shape}, expected {' or '.join(map(str, shapes[quantity.field]))}",
                where=f"exchange, {name}", remedy="Give it on the grid of the exchange",
            )  # fmt: skip
        _check_limits(values, mask, name, quantity)
        arrays[quantity.field] = values
    return arrays


def _split(value: Any, units: str) -> tuple[Floats, str]:
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], str):
        return np.asarray(value[0], dtype=float), value[1]
    stated = getattr(value, "attrs", {}).get("units", units)
    return np.asarray(value, dtype=float), str(stated)


def _check_limits(values: Floats, mask: Floats, name: str, q: Exchanged) -> None:
    wet: NDArray[np.bool_] = mask >= 0.5 if values.shape == mask.shape else np.ones(values.shape, bool)
    with np.errstate(invalid="ignore"):
        bad = wet & ~((values >= q.low) & (values <= q.high))
    if values.ndim and values.shape != mask.shape:
        bad &= ~np.isnan(values)  # land may lack a value: `OceanForcing.put` knows where it is, also beyond the cells
    if bad.any():
        at = tuple(int(k) for k in np.argwhere(bad)[0])
        cell = f" in cell ({at[1] + 1}, {at[0] + 1})" if at else ""
        hint = "It looks like kelvin: state units='K'" if q.field == "sst" and values[at] > 200.0 else "Check its units"
        raise InputError(
            f"{values[at]:g} {q.units}{cell}", where=f"exchange, {name}",
            remedy=f"Values from {q.low:g} to {q.high:g} can be. {hint}",
        )  # fmt: skip


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
        Fields of the water that each step brings; `Exchange.step` sees to it.
    given : bool
        Whether a step has put its fields; until then a resumed run keeps the fields that its bergs met last.
    """

    provides = frozenset({"sst", "sss"})

    def __init__(self, grid: Grid, fields: Fields, **options: Any) -> None:
        super().__init__(grid, fields, **options)
        self.ocean_grid = grid
        self.given = False
        self._refuse_gaps(fields)

    def put(self, fields: Fields) -> Fields:
        """Take the fields of a step, unless they have gaps (NaN) over water; return them as bergs see them: 0 on land."""
        self._refuse_gaps(fields)
        self.replace(fields)
        self.given = True
        return self.fields_at(0.0)

    def _refuse_gaps(self, fields: Fields) -> None:
        g = self.ocean_grid.arrays
        for name, values in zip(Fields._fields, fields, strict=True):
            if name == "ssh" and self.rules.sea_level_gaps:
                continue
            i, j = first_gap(values, g.mask, g.halo - 1)  # with the cells beyond an open edge
            if i >= 0:
                raise self._gap_error(0, name, i, j)
