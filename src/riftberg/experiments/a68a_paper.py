"""The published run of A68a (Huth et al. 2022) from its own files, with the reference's numerics by default.

Hourly OSCAR currents, DUACS sea level and NCEP wind of December 2020 on the 1/8 degree grid, the 472 elements of the
published initial state, and the artificial shoal: all water north-east of one corner. 432 hours from 9 December 13:00.
Source: equations 10.5.
"""

from __future__ import annotations

import math
from datetime import timedelta
from pathlib import Path
from typing import Final

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.a68a_files import BERG, GRID, REMEDY, data_folder
from riftberg.experiments.options import Info, Options
from riftberg.kid.a68 import (
    UNKNOWN_DEPTH,
    VARIABLES,
    Assembler,
    HourlyFile,
    hourly_records,
    open_hours,
    read_grid,
)
from riftberg.kid.restart import read_restart
from riftberg.model import DEFAULT_START
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.parameters import A68A_2022, A68A_2022_KID
from riftberg.runs.model import Model

NAME: Final = "a68a-paper"
DAYS: Final = 18.0
START_RECORD: Final = 206
"""Record of the start, 9 December 13:00, counted from 1; record 1 is 1 December 00:00."""

ZONE: Final = (-37.51, -55.2166)
"""Corner (degrees) of the grounding zone, all of the water to its north and east."""

FILES: Final = (BERG, GRID, *VARIABLES)


def forcing_of(
    folder: Path, days: float = DAYS, *, own: bool = False, zone: tuple[float, float] | None = ZONE
) -> GriddedForcing:
    """Return the hourly forcing, checked for the length of the run.

    ``zone``: corner of the grounding zone, degrees.
    """
    try:
        grid = read_grid(folder / GRID, radius=EARTH_RADIUS_A68)
        # NaN stands for land and gaps there, declared or not; the files are known by their checksums.
        files = open_hours(folder, grid, stamp=_date, bare_gaps=True)
    except InputError as error:
        raise ForcingError(error.what, where=error.where, remedy=f"{error.remedy}; {REMEDY}") from error
    last = START_RECORD + math.ceil(days * 24.0)
    for file in files:
        _check_file(file, days, last)
    still = grid.fields(depth=UNKNOWN_DEPTH)
    records, times = hourly_records(files, Assembler(grid, still), START_RECORD)
    return GriddedForcing(
        grid,
        records,
        times,
        FieldRules(
            depth_rule="zone",
            zone=(0.0, 90.0) if zone is None else (zone[0] + 360.0, zone[1]),  # nothing lies north of the pole
            stepwise=() if own else ("ssh",),
            sea_level_gaps=True,
        ),
        start=DEFAULT_START,
        source="hourly OSCAR currents, DUACS sea level and NCEP wind of December 2020",
    )


def _check_file(file: HourlyFile, days: float, last: int) -> None:
    """Refuse a file that is too short, of another place, or without believable values."""
    if file.count < last:
        raise ForcingError(
            f"{file.count} hourly records, but {days:g} days from record {START_RECORD} (9 December 13:00) need {last}",
            where=f"{file.path}, variable {file.names[0]}",
            remedy=f"The published file has 744 (wind 739); {REMEDY}; or shorten the run with --days",
        )
    try:
        file.check_place()
        file.check(START_RECORD - 1, last - 1)
    except ForcingError as error:
        remedy = f"It must lie on the grid of {GRID}, in m and m/s; {REMEDY}"
        raise ForcingError(error.what, where=error.where, remedy=remedy) from error


def _date(number: int) -> str:
    """Return the date of a record, counted from 0."""
    return f"{DEFAULT_START + timedelta(hours=number + 1 - START_RECORD):%Y-%m-%d %H:%M}"


def paper_model(folder: Path, options: Options, *, zone: tuple[float, float] | None = ZONE) -> Model:
    """Return the model of the published run from the files of a folder.

    ``zone``: corner of the grounding zone, degrees.
    """
    own = options.numerics == "own"
    forcing = forcing_of(folder, DAYS if options.days is None else options.days, own=own, zone=zone)
    assert forcing.grid is not None
    elements = read_restart(folder / BERG, forcing.grid)
    parameters = options.apply(A68A_2022 if own else A68A_2022_KID)
    earth = parameters.earth
    bonds = form_bonds(elements, BondRule(packing="square"), Metric(True, earth.radius, earth.period))
    berg = Iceberg(elements, bonds, packing="square", radius=1500.0, report={"source": BERG})
    return Model(berg, forcing, parameters, DEFAULT_START)


def build(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    folder = data_folder(options, FILES, NAME, hourly=True)
    whose = "Riftberg's numerics" if options.numerics == "own" else "the reference's numerics"
    left_out = "".join(f", without {part}" for part in sorted(options.without))
    title = f"A68a as published (Huth et al. 2022), {whose}{left_out}"
    zone = None if "shoal" in options.without else ZONE
    return paper_model(folder, options, zone=zone), Info(NAME, title, days=DAYS, output_every_hours=1.0)
