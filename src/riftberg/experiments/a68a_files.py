"""A68a near South Georgia from the files of its publication: ``a68a-paper`` and ``a68a-oras5``.

The files belong to the publication (Huth et al. 2022).

``a68a-paper``: hourly OSCAR currents, DUACS sea level and NCEP wind of December 2020 on the 1/8 degree grid, the 472 elements
of the published initial state, and the artificial shoal: all water north-east of one corner. 432 hours from 9 December
13:00, with the reference's numerics by default. Source: equations 10.5. With Riftberg's numerics the shoal is a bank of sand 1 m
above the keel that falls off by 1 in 100: the published one is a cliff up to the surface.

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
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
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
from riftberg.ocean.cells import ZONE_DEPTH
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.parameters import A68A_2022, A68A_2022_KID, Parameters
from riftberg.physics.floating import draft_of
from riftberg.runs.model import Model
from riftberg.start.checks import DEFAULT_START
from riftberg.state import Elements, Floats

DATA: Final = "RIFTBERG_DATA"
"""Environment variable that names the folder of the files."""

FETCHED: Final = Path("riftberg-data") / "a68a"
"""Where ``riftberg fetch a68a`` puts them if it is not told another place."""

BERG: Final = "icebergs.res.nc"
GRID: Final = "a68_experiment_ll_p125_grid.nc"

REMEDY: Final = "delete it, and 'riftberg fetch a68a' gets the right one"


def named_folder(options: Options) -> Path:
    """Return the folder that was named with ``--data`` or the environment variable, else the folder of the fetch."""
    if options.data is not None:
        return options.data
    return Path(os.environ[DATA]) if os.environ.get(DATA) else FETCHED


def data_folder(options: Options, names: Iterable[str], experiment: str, *, hourly: bool) -> Path:
    """Return the folder of the files; fetch them first where that was asked for and some are missing."""
    folder, required = named_folder(options), list(names)
    if options.fetch and any(_file_fault(folder / name) for name in required):
        from riftberg.fetching import fetch

        fetch.fetch_a68a(folder, hourly=fetch.HOURLY if hourly else ())
    output_option, data = ("", "") if folder == FETCHED else (f" -o {folder}", f" --data {folder}")
    remedy = (
        f"'riftberg fetch a68a{output_option}' gets the files, 'riftberg run {experiment}{data} --fetch' gets them and runs; "
        f"or name their folder with --data or {DATA}"
    )
    if not folder.is_dir():
        problem = "no folder of data" if folder == FETCHED else "no such folder"
        raise ForcingError(problem, where=f"{experiment}: {folder}", remedy=remedy)
    faults = [(name, fault) for name in required if (fault := _file_fault(folder / name))]
    if faults:
        name, fault = faults[0]
        more = f" ({len(faults)} of {len(required)} files are missing)" if len(faults) > 1 else ""
        raise ForcingError(f"{fault} {name}{more}", where=str(folder), remedy=remedy)
    return folder


def _file_fault(path: Path) -> str:
    if not path.is_file():
        return "no"
    return "only a pointer of Git LFS instead of" if is_pointer(path) else ""


def published_berg(folder: Path, grid: Grid, parameters: Parameters) -> Iceberg:
    """Return the berg of the published initial state."""
    elements, earth = read_restart(folder / BERG, grid), parameters.earth
    # The masses of the file go with the publication's density; the draft goes with the density that was asked for.
    elements.mass[:] *= parameters.ice.density / A68A_2022_KID.ice.density
    bonds = form_bonds(elements, BondRule(packing="square"), Metric(True, earth.radius, earth.period))
    return Iceberg(elements, bonds, packing="square", radius=1500.0, report={"source": BERG})


# ---- the published run ------------------------------------------------------------------------------------------------

NAME: Final = "a68a-paper"
PAPER_DAYS: Final = 18.0
START_RECORD: Final = 206
"""Record of the start, 9 December 13:00, counted from 1; record 1 is 1 December 00:00."""

ZONE: Final = (-37.51, -55.2166)
"""Corner (degrees) of the grounding zone, all of the water to its north and east."""

ABOVE_KEEL: Final = 1.0
"""How far above the keel the bank lies that is the grounding zone with Riftberg's numerics, m."""

FALLS: Final = 0.01
"""Slope by which that bank falls off outside of the zone."""

FILES: Final = (BERG, GRID, *VARIABLES)


def hourly_forcing(
    folder: Path, days: float = PAPER_DAYS, *, own_numerics: bool = False, zone: tuple[float, float] | None = ZONE
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
    base_fields = grid.fields(depth=UNKNOWN_DEPTH)
    records, times = hourly_records(files, Assembler(grid, base_fields), START_RECORD)
    return GriddedForcing(
        grid,
        records,
        times,
        FieldRules(
            depth_rule="zone",
            zone=(0.0, 90.0) if zone is None else (zone[0] + 360.0, zone[1]),  # nothing lies north of the pole
            stepwise=() if own_numerics else ("ssh",),
            sea_level_gaps=True,
        ),
        start=DEFAULT_START,
        source="hourly OSCAR currents, DUACS sea level and NCEP wind of December 2020",
    )


class Bank(WrappedForcing):
    """The grounding zone of the publication as a bank on which a bed of sediment can carry the berg.

    The published zone is a cliff from 1000 m to the surface, which stops by its drag whatever comes into it. The bank lies
    `ABOVE_KEEL` above the keel, and falls off outside of the zone by `FALLS`.
    """

    def __init__(self, forcing: GriddedForcing, draft: float) -> None:
        assert forcing.rules.zone is not None
        self.forcing, self._top, self._corner = forcing, draft - ABOVE_KEEL, forcing.rules.zone

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points; NaN outside and on land."""
        degree = DEGREE * EARTH_RADIUS_A68
        west, south = self._corner
        east = (np.asarray(lon, np.float64) - west + 180.0) % 360.0 - 180.0
        distance = (
            np.hypot(np.minimum(east * np.cos(np.asarray(lat) * DEGREE), 0.0), np.minimum(lat - south, 0.0)) * degree
        )
        bank = np.minimum(self._top + FALLS * distance, ZONE_DEPTH)
        return np.asarray(np.where(np.isfinite(self.forcing.depth(lon, lat)), bank, np.nan))

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        self.forcing.sample(elements, time)
        here = self.depth(elements.lon, elements.lat)
        elements.depth[:] = np.where(np.isfinite(here), here, elements.depth)

    def describe(self) -> str:
        """Return a description of this forcing."""
        return f"{self.forcing.describe()}\ngrounding zone: a bank {self._top:.1f} m deep that falls off by {FALLS:g}"


def add_bank(forcing: GriddedForcing, berg: Iceberg, density: float) -> Forcing:
    """Return the forcing with a bank in place of the cliff of its grounding zone; ``density``: of the ice, kg m-3."""
    return Bank(forcing, float(draft_of(berg.elements.thickness, density).max()))


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
    own_numerics = options.numerics == "own"
    forcing = hourly_forcing(
        folder, PAPER_DAYS if options.days is None else options.days, own_numerics=own_numerics, zone=zone
    )
    assert forcing.grid is not None
    parameters = options.apply(A68A_2022 if own_numerics else A68A_2022_KID)
    berg = published_berg(folder, forcing.grid, parameters)
    floor = add_bank(forcing, berg, parameters.ice.density) if own_numerics and zone is not None else forcing
    return Model(berg, floor, parameters, DEFAULT_START)


def build_paper(options: Options) -> tuple[Model, Info]:
    """Build the published run (see `riftberg.experiments.build`)."""
    folder = data_folder(options, FILES, NAME, hourly=True)
    whose = "Riftberg's numerics" if options.numerics == "own" else "the reference's numerics"
    left_out = "".join(f", without {name}" for name in sorted(options.without))
    title = f"A68a as published (Huth et al. 2022), {whose}{left_out}"
    zone = None if "shoal" in options.without else ZONE
    return paper_model(folder, options, zone=zone), Info(NAME, title, days=PAPER_DAYS, output_every_hours=1.0)


# ---- mean currents -----------------------------------------------------------------------------------------------------

ORAS5_FILES = {
    "berg": BERG,
    "grid": GRID,
    "currents": "a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc",
    "sea level": "a68_experiment_ssh_oras5_dec2020_ll_p125.nc",
    "wind": "a68_experiment_wind_vel_jra55_dec2020_ll_p125.nc",
}
"""Files of the published repository that the experiment reads."""


def _read_field(path: Path, name: str) -> Floats:
    """Read one two-dimensional field; gaps become NaN."""
    with opened_dataset(path) as file:
        if name not in file.variables:
            raise ForcingError(f"no variable {name!r}", where=str(path), remedy=f"It holds {', '.join(file.variables)}")
        values = np.ma.filled(np.ma.asarray(file.variables[name][:], dtype=np.float64), np.nan).squeeze()
    return np.asarray(values, np.float64)


def mean_forcing(folder: Path) -> GriddedForcing:
    """Return the mean forcing on the publication's grid, whose corners carry the currents and the wind."""
    lon, lat = (
        _read_field(folder / ORAS5_FILES["grid"], "longitude"),
        _read_field(folder / ORAS5_FILES["grid"], "latitude"),
    )
    grid = Grid.from_corners(lon + 360.0, lat)
    currents, wind = folder / ORAS5_FILES["currents"], folder / ORAS5_FILES["wind"]
    fields = grid.fields(
        uo=_read_field(currents, "uo"),
        vo=_read_field(currents, "vo"),
        ua=_read_field(wind, "ua"),
        va=_read_field(wind, "va"),
        ssh=_read_field(folder / ORAS5_FILES["sea level"], "SSH"),
    )
    rules = FieldRules(depth_rule="zone", zone=ZONE)
    return GriddedForcing(grid, fields, rules=rules, source="ORAS5 and JRA-55, means of December 2020")


def build_oras5(options: Options) -> tuple[Model, Info]:
    """Build A68a in the mean currents of ORAS5 (see `riftberg.experiments.build`)."""
    folder = data_folder(options, ORAS5_FILES.values(), "a68a-oras5", hourly=False)
    forcing = mean_forcing(folder)
    assert forcing.grid is not None
    parameters = options.apply(A68A_2022 if options.own else A68A_2022_KID)
    berg = published_berg(folder, forcing.grid, parameters)
    title = "A68a in the mean currents of December 2020 (ORAS5)"
    floor = add_bank(forcing, berg, parameters.ice.density) if options.own else forcing
    return Model(berg, floor, parameters), Info("a68a-oras5", title, days=18.0, output_every_hours=1.0)
