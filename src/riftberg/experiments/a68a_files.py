"""A68a from the files of its publication (Huth et al. 2022): where they lie, the published run, and one in mean currents.

``a68a-paper``: hourly OSCAR currents, DUACS sea level and NCEP wind of December 2020 on the 1/8 degree grid, the 472 elements
of the published initial state, and the artificial shoal: all water north-east of one corner. 432 hours from 9 December
13:00, with the reference's numerics by default. Source: equations 10.5.

``a68a-oras5``: the same berg and shoal in the mean currents of December 2020 (ORAS5), with JRA-55 wind. Monthly means smooth
away the eddies that turned and broke the real berg, so only the drift can be compared, and only roughly.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from datetime import timedelta
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.registry import Info, Options
from riftberg.fetching.download import is_pointer
from riftberg.kid.a68 import (
    UNKNOWN_DEPTH,
    VARIABLES,
    Assembler,
    HourlyFile,
    hourly_records,
    open_hours,
    read_grid,
)
from riftberg.kid.ncfile import opened_dataset
from riftberg.kid.restart import read_restart
from riftberg.model import DEFAULT_START
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.parameters import A68A_2022, A68A_2022_KID, Parameters
from riftberg.runs.model import Model
from riftberg.state import Floats

DATA: Final = "RIFTBERG_DATA"
"""Environment variable that names the folder of the files."""

FETCHED: Final = Path("riftberg-data") / "a68a"
"""Where ``riftberg fetch a68a`` puts them if it is not told another place."""

BERG: Final = "icebergs.res.nc"
GRID: Final = "a68_experiment_ll_p125_grid.nc"

REMEDY: Final = "delete it, and 'riftberg fetch a68a' gets the right one"


def named_folder(options: Options) -> Path:
    """Return the folder that was named with ``--data`` or the environment variable, else that of the fetch."""
    if options.data is not None:
        return options.data
    return Path(os.environ[DATA]) if os.environ.get(DATA) else FETCHED


def data_folder(options: Options, names: Iterable[str], experiment: str, *, hourly: bool) -> Path:
    """Return the folder of the files; fetch them first where that was asked for and some are missing."""
    folder, wanted = named_folder(options), list(names)
    if options.fetch and any(_fault_of_file(folder / name) for name in wanted):
        from riftberg.fetching import fetch

        fetch.fetch_a68a(folder, hourly=fetch.HOURLY if hourly else ())
    place, data = ("", "") if folder == FETCHED else (f" -o {folder}", f" --data {folder}")
    remedy = (
        f"'riftberg fetch a68a{place}' gets the files, 'riftberg run {experiment}{data} --fetch' gets them and runs; "
        f"or name their folder with --data or {DATA}"
    )
    if not folder.is_dir():
        what = "no folder of data" if folder == FETCHED else "no such folder"
        raise ForcingError(what, where=f"{experiment}: {folder}", remedy=remedy)
    faults = [(name, fault) for name in wanted if (fault := _fault_of_file(folder / name))]
    if faults:
        name, fault = faults[0]
        more = f" ({len(faults)} of {len(wanted)} files are missing)" if len(faults) > 1 else ""
        raise ForcingError(f"{fault} {name}{more}", where=str(folder), remedy=remedy)
    return folder


def _fault_of_file(path: Path) -> str:
    if not path.is_file():
        return "no"
    return "only a pointer of Git LFS instead of" if is_pointer(path) else ""


def published_berg(folder: Path, grid: Grid, parameters: Parameters) -> Iceberg:
    """Return the berg of the published initial state."""
    elements, earth = read_restart(folder / BERG, grid), parameters.earth
    bonds = form_bonds(elements, BondRule(packing="square"), Metric(True, earth.radius, earth.period))
    return Iceberg(elements, bonds, packing="square", radius=1500.0, report={"source": BERG})


# ---- the published run ------------------------------------------------------------------------------------------------

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
    parameters = options.apply(A68A_2022 if own else A68A_2022_KID)
    berg = published_berg(folder, forcing.grid, parameters)
    return Model(berg, forcing, parameters, DEFAULT_START)


def build_paper(options: Options) -> tuple[Model, Info]:
    """Build the published run (see `riftberg.experiments.build`)."""
    folder = data_folder(options, FILES, NAME, hourly=True)
    whose = "Riftberg's numerics" if options.numerics == "own" else "the reference's numerics"
    left_out = "".join(f", without {part}" for part in sorted(options.without))
    title = f"A68a as published (Huth et al. 2022), {whose}{left_out}"
    zone = None if "shoal" in options.without else ZONE
    return paper_model(folder, options, zone=zone), Info(NAME, title, days=DAYS, output_every_hours=1.0)


# ---- mean currents -----------------------------------------------------------------------------------------------------

ORAS5_FILES = {
    "berg": BERG,
    "grid": GRID,
    "currents": "a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc",
    "sea level": "a68_experiment_ssh_oras5_dec2020_ll_p125.nc",
    "wind": "a68_experiment_wind_vel_jra55_dec2020_ll_p125.nc",
}
"""Files of the published repository that the experiment reads."""


def _field_of_file(path: Path, name: str) -> Floats:
    """Read one two-dimensional field; gaps become NaN."""
    with opened_dataset(path) as file:
        if name not in file.variables:
            raise ForcingError(f"no variable {name!r}", where=str(path), remedy=f"It holds {', '.join(file.variables)}")
        values = np.ma.filled(np.ma.asarray(file.variables[name][:], dtype=np.float64), np.nan).squeeze()
    return np.asarray(values, np.float64)


def mean_forcing_of(folder: Path) -> GriddedForcing:
    """Return the mean forcing on the publication's grid, whose corners carry the currents and the wind."""
    lon, lat = (
        _field_of_file(folder / ORAS5_FILES["grid"], "longitude"),
        _field_of_file(folder / ORAS5_FILES["grid"], "latitude"),
    )
    grid = Grid.from_corners(lon + 360.0, lat)
    currents, wind = folder / ORAS5_FILES["currents"], folder / ORAS5_FILES["wind"]
    fields = grid.fields(
        uo=_field_of_file(currents, "uo"),
        vo=_field_of_file(currents, "vo"),
        ua=_field_of_file(wind, "ua"),
        va=_field_of_file(wind, "va"),
        ssh=_field_of_file(folder / ORAS5_FILES["sea level"], "SSH"),
    )
    rules = FieldRules(depth_rule="zone", zone=ZONE)
    return GriddedForcing(grid, fields, rules=rules, source="ORAS5 and JRA-55, means of December 2020")


def build_oras5(options: Options) -> tuple[Model, Info]:
    """Build A68a in the mean currents of ORAS5 (see `riftberg.experiments.build`)."""
    folder = data_folder(options, ORAS5_FILES.values(), "a68a-oras5", hourly=False)
    forcing = mean_forcing_of(folder)
    assert forcing.grid is not None
    parameters = options.apply(A68A_2022 if options.own else A68A_2022_KID)
    berg = published_berg(folder, forcing.grid, parameters)
    title = "A68a in the mean currents of December 2020 (ORAS5)"
    return Model(berg, forcing, parameters), Info("a68a-oras5", title, days=18.0, output_every_hours=1.0)
