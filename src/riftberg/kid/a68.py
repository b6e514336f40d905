"""Grid and forcing files of the driver's A68 test (dynamics, section 10.5; files, section 8.7).

The files hold hourly records; one record means forcing that is constant in time. Packed integers are unpacked in
double precision. Step n, counted from 1, uses hour (n - 1) / 2 after the start index; at half hours currents and wind
are the mean of two records and the sea level is that of the earlier one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from riftberg.errors import ForcingError
from riftberg.kid.calendar import LATE_START, date_after
from riftberg.kid.hours import HourlyFile
from riftberg.kid.namelist import NamelistGroup
from riftberg.kid.ncfile import opened_dataset, unpacked
from riftberg.ocean.grid import Grid
from riftberg.ocean.grid_arrays import Fields
from riftberg.ocean.loading import celsius, wind_from_stress
from riftberg.state import Floats

GRID_FILE: Final = "a68_experiment_ll_p125_grid.nc"
WIND_FILE: Final = "a68_experiment_wind_vel_ncep_10m_dec2020_HOURLY_ll_p125.nc"
OCEAN_FILE: Final = "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc"
SEA_LEVEL_FILE: Final = "a68_experiment_ssh_duacs_dec2020_HOURLY_ll_p125.nc"

HALF_HOUR: Final = 1800.0
"""The long step for which the rule of half hours is made, s."""

UNKNOWN_DEPTH: Final = 1000.0
"""Depth where the driver sets none, m."""

VARIABLES: Final = {WIND_FILE: ("ua", "va"), OCEAN_FILE: ("uo", "vo"), SEA_LEVEL_FILE: ("SSH",)}
"""Files of the hourly fields and what is read of them."""


def case_data(driver: NamelistGroup, case: Path) -> Path:
    """Return the folder of the data; ``data_dir`` counts from the run folder."""
    return Path(case) / driver.text("data_dir")


def a68_grid(driver: NamelistGroup, case: Path, period: float) -> Grid:
    """Return the grid of the data file: corners at its longitudes + 360 and its latitudes.

    ``period``: zonal period, degrees.
    """
    return read_grid(case_data(driver, case) / GRID_FILE, radius=driver.number("REarth"), period=period)


def read_grid(path: Path, *, radius: float, period: float = 360.0) -> Grid:
    """Return the grid of a file with ``longitude`` and ``latitude``, as the driver makes it.

    ``radius``: radius of the sphere for the metrics, m; ``period``: zonal period, degrees.
    """
    with opened_dataset(path) as dataset:
        lon, lat = unpacked(dataset, path, "longitude"), unpacked(dataset, path, "latitude")
    if lon.ndim != 2 or lon.shape != lat.shape or min(lon.shape) < 2:
        raise ForcingError(
            f"longitude {lon.shape} and latitude {lat.shape} are no grid",
            where=str(path),
            remedy="Give (lat, lon) arrays, at least 2 x 2",
        )
    _check_axes(lon, lat, path)
    return Grid.from_corners(
        lon + 360.0, lat, latlon=True, regular=False, period=period, radius_for_metrics=radius, cyclic=False
    )


def _check_axes(lon: Floats, lat: Floats, path: Path) -> None:
    """Refuse corners whose longitude does not rise along the rows or latitude along the columns: cells inside out."""
    for name, values, axis, most in (("longitude", lon, 1, 180.0), ("latitude", lat, 0, 90.0)):
        step = np.diff(values, axis=axis)
        with np.errstate(invalid="ignore"):
            wrong = ~((step > 0.0) & (step < most)) & np.isfinite(step)
        if wrong.any():
            j, i = (int(k[0]) for k in np.nonzero(wrong))
            after = values[j, i + 1] if axis else values[j + 1, i]
            line, along = ("row", "column") if axis else ("column", "row")
            at = (j, i) if axis else (i, j)
            raise ForcingError(
                f"{name} goes from {values[j, i]:g} to {after:g} at {along} {at[1] + 1} of {line} {at[0] + 1}",
                where=f"{path}, variable {name}",
                remedy=f"It must rise from each {along} to the next, in degrees, without a jump of 360",
            )
    beyond = np.abs(lat) > 90.0
    if beyond.any():
        raise ForcingError(f"latitude = {lat[beyond][0]:g}", where=f"{path}, variable latitude", remedy="Give degrees")


def open_hours(folder: Path, grid: Grid, **options: Any) -> list[HourlyFile]:
    """Return the files of wind, currents and sea level, with their headers checked; options as of `HourlyFile`."""
    return [HourlyFile(folder / file, names, grid, **options) for file, names in VARIABLES.items()]


def place_note(driver: NamelistGroup, case: Path, grid: Grid) -> list[str]:
    """Say that rows are taken in the grid's order where the hourly files do not say where they lie."""
    bare = [file.path.name for file in open_hours(case_data(driver, case), grid) if not file.check_place()]
    if not bare:
        return []
    return [f"{', '.join(bare)}: no positions in the file; rows and columns are taken in the order of {GRID_FILE}"]


def _check_dates(files: Sequence[HourlyFile], start: int) -> None:
    """Compare the dates that the files give the first record of a run, where they give some."""
    dated = [(file, dates[start - 1]) for file in files if (dates := file.dates())]
    for file, date in dated[1:]:
        if date != dated[0][1]:
            raise ForcingError(
                f"its record {start} is of {date}, that of {dated[0][0].path.name} of {dated[0][1]}",
                where=f"{file.path}, variable time",
                remedy="KID takes the same record of all files as the same hour: let them begin together",
            )


def hourly_records(
    files: Sequence[HourlyFile], assemble: Assembler, start: int
) -> tuple[Fields | Callable[[int], Fields], Floats | None]:
    """Return forcing as `riftberg.ocean.gridded.GriddedForcing` takes it; arguments as `open_hours` gives them.

    Returns ``times``: times of the hours since the start of the run, s.
    """

    def load(k: int) -> Fields:
        hour: dict[str, Floats] = {}
        for file in files:
            hour.update(file.record(start - 1 + k))
        return assemble(hour)

    varying = [file.count for file in files if file.count > 1]
    if not varying:
        return load(0), None
    return load, np.arange(min(varying) - start + 1) * np.float64(3600.0)


def a68_records(
    driver: NamelistGroup, icebergs: NamelistGroup, grid: Grid, case: Path, dt: float, steps: int
) -> tuple[Fields | Callable[[int], Fields], Floats | None]:
    """Return the forcing of the A68 test as `hourly_records` does."""
    start = driver.whole("transient_a68_data_start_ind")
    if start < 1:
        raise driver.error(f"transient_a68_data_start_ind = {start} with a68_test", "Give the first record, from 1")
    _check_depth(icebergs)
    begin = float(LATE_START.get(start, 0))
    files = open_hours(
        case_data(driver, case),
        grid,
        stress=not icebergs.flag("tau_is_velocity"),
        stamp=lambda number: f"{date_after(begin + 3600.0 * (number + 1 - start))} of the run",
    )
    varying = [file for file in files if file.count > 1]
    if varying and dt != HALF_HOUR:
        remedy = f"The driver's rule of half hours needs ibdt = {HALF_HOUR}"
        raise driver.error(f"ibdt = {dt} with hourly A68 data", remedy)
    last = start + steps // 2
    for file in varying:
        if last > file.count:
            raise ForcingError(
                f"{file.count} hourly records, but {steps} steps from record {start} need {last}",
                where=f"{file.path}, variable {file.names[0]}",
                remedy="Shorten the run (ibhrs, nmax) or start earlier (transient_a68_data_start_ind)",
            )
    for file in files:
        file.check_units()
        file.check(start - 1, last - 1)
    _check_dates(files, start)
    still = grid.fields(
        ui=driver.number("ibui"), vi=driver.number("ibvi"), sst=driver.number("sst"), depth=UNKNOWN_DEPTH
    )
    still = still._replace(sst=celsius(still.sst, grid.arrays.mask))
    return hourly_records(files, Assembler(grid, still, icebergs.flag("tau_is_velocity")), start)


def _check_depth(icebergs: NamelistGroup) -> None:
    if icebergs.number("cdrag_grounding") > 0 and not (icebergs.flag("A68_test") and icebergs.flag("mts")):
        raise icebergs.error(
            "cdrag_grounding > 0, but the driver's A68 test knows no depth",
            "Set A68_test = .true. with mts = .true. for the grounding zone, or cdrag_grounding = 0",
        )


class Assembler:
    """Makes `Fields` of the records of one hour; ice, temperature and depth are shared."""

    def __init__(self, grid: Grid, still: Fields, is_velocity: bool = True) -> None:
        self._grid, self._still, self._is_velocity = grid, still, is_velocity

    def __call__(self, hour: dict[str, Floats]) -> Fields:
        """Return the state of one hour from its records by name."""
        ua, va = self._wind(hour["ua"], hour["va"])
        extended = self._grid.extended
        return self._still._replace(
            uo=extended(np.nan_to_num(hour["uo"])),
            vo=extended(np.nan_to_num(hour["vo"])),
            ua=extended(ua, "zero"),
            va=extended(va, "zero"),
            ssh=extended(hour["SSH"], "zero"),
        )

    def _wind(self, tau_x: Floats, tau_y: Floats) -> tuple[Floats, Floats]:
        # The reference sets gaps in wind and currents to 0 as well (section 3.1, rule 5).
        tau_x, tau_y = np.nan_to_num(tau_x), np.nan_to_num(tau_y)
        return (tau_x, tau_y) if self._is_velocity else wind_from_stress(tau_x, tau_y)
