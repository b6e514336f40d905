"""A68a from its published initial state in the mean currents of December 2020 (ORAS5), with JRA-55 wind.

Monthly means smooth away the eddies that turned and broke the real berg, so only the drift can be compared, and only
roughly. The sea floor is the artificial shoal of the publication: all water north-east of one corner.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.bergs.iceberg import Iceberg
from riftberg.errors import ForcingError
from riftberg.experiments.a68a_files import BERG, GRID, data_folder
from riftberg.experiments.options import Info, Options
from riftberg.kid.ncfile import opened_dataset
from riftberg.kid.restart import read_restart
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.parameters import A68A_2022, A68A_2022_KID
from riftberg.state import Floats

if TYPE_CHECKING:
    from riftberg.runs.model import Model

FILES = {
    "berg": BERG,
    "grid": GRID,
    "currents": "a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc",
    "sea level": "a68_experiment_ssh_oras5_dec2020_ll_p125.nc",
    "wind": "a68_experiment_wind_vel_jra55_dec2020_ll_p125.nc",
}
"""Files of the published repository that the experiment reads."""

ZONE = (-37.51, -55.2166)
"""Corner (degrees) of the publication's grounding zone, all of the water to its north and east."""


def _field_of_file(path: Path, name: str) -> Floats:
    """Read one two-dimensional field; gaps become NaN."""
    with opened_dataset(path) as file:
        if name not in file.variables:
            raise ForcingError(f"no variable {name!r}", where=str(path), remedy=f"It holds {', '.join(file.variables)}")
        values = np.ma.filled(np.ma.asarray(file.variables[name][:], dtype=np.float64), np.nan).squeeze()
    return np.asarray(values, np.float64)


def forcing_of(folder: Path) -> GriddedForcing:
    """Return the mean forcing on the publication's grid, whose corners carry the currents and the wind."""
    lon, lat = _field_of_file(folder / FILES["grid"], "longitude"), _field_of_file(folder / FILES["grid"], "latitude")
    grid = Grid.from_corners(lon + 360.0, lat)
    currents, wind = folder / FILES["currents"], folder / FILES["wind"]
    fields = grid.fields(
        uo=_field_of_file(currents, "uo"),
        vo=_field_of_file(currents, "vo"),
        ua=_field_of_file(wind, "ua"),
        va=_field_of_file(wind, "va"),
        ssh=_field_of_file(folder / FILES["sea level"], "SSH"),
    )
    rules = FieldRules(depth_rule="zone", zone=ZONE)
    return GriddedForcing(grid, fields, rules=rules, source="ORAS5 and JRA-55, means of December 2020")


def build(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    from riftberg.runs.model import Model

    folder = data_folder(options, FILES.values(), "a68a-oras5", hourly=False)
    forcing = forcing_of(folder)
    assert forcing.grid is not None
    elements = read_restart(folder / FILES["berg"], forcing.grid)
    parameters = options.apply(A68A_2022 if options.own else A68A_2022_KID)
    earth = parameters.earth
    bonds = form_bonds(elements, BondRule(packing="square"), Metric(True, earth.radius, earth.period))
    berg = Iceberg(elements, bonds, packing="square", radius=1500.0, report={"source": FILES["berg"]})
    title = "A68a in the mean currents of December 2020 (ORAS5)"
    return Model(berg, forcing, parameters), Info("a68a-oras5", title, days=18.0, output_every_hours=1.0)
