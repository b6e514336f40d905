"""Grid and forcing files of the driver's A68 test (dynamics, section 10.5; files, section 8.7).

The files hold hourly records; one record means forcing that is constant in time. Packed integers are unpacked in
double precision. Step n, counted from 1, uses hour (n - 1) / 2 after the start index; at half hours currents and wind
are the mean of two records and the sea level is that of the earlier one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.errors import ForcingError
from riftberg.io.kid.namelist import NamelistGroup
from riftberg.io.kid.ncfile import opened, shape_of, unpacked
from riftberg.ocean.grid import Fields, Grid
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

_VARIABLES: Final = {"ua": WIND_FILE, "va": WIND_FILE, "uo": OCEAN_FILE, "vo": OCEAN_FILE, "SSH": SEA_LEVEL_FILE}


def data_folder(driver: NamelistGroup, case: Path) -> Path:
    """Return the folder of the data; ``data_dir`` counts from the run folder."""
    return Path(case) / driver.text("data_dir")


def a68_grid(driver: NamelistGroup, case: Path, period: float) -> Grid:
    """Return the grid of the data file: corners at its longitudes + 360 and its latitudes.

    Parameters
    ----------
    driver : NamelistGroup
        Its ``REarth`` gives the metrics.
    case : pathlib.Path
        Run folder.
    period : float
        Zonal period, degrees; the domain itself is not cyclic.
    """
    path = data_folder(driver, case) / GRID_FILE
    with opened(path) as dataset:
        lon, lat = unpacked(dataset, path, "longitude"), unpacked(dataset, path, "latitude")
    if lon.ndim != 2 or lon.shape != lat.shape:
        raise ForcingError(
            f"longitude {lon.shape} and latitude {lat.shape} are no grid",
            where=str(path),
            remedy="Give (lat, lon) arrays",
        )
    radius = driver.number("REarth")
    return Grid.from_corners(
        lon + 360.0, lat, latlon=True, regular=False, period=period, radius_for_metrics=radius, cyclic=False
    )


class _Hours:
    """Records of one variable; only one is held in memory."""

    def __init__(self, path: Path, name: str, grid: Grid) -> None:
        self.path, self.name = path, name
        with opened(path) as dataset:
            found = shape_of(dataset, path, name)
        expected = (grid.arrays.nj, grid.arrays.ni)
        if len(found) != 3 or found[0] < 1 or found[1:] != expected:
            raise ForcingError(
                f"shape {found} does not fit the grid of {expected[0]} x {expected[1]} cells",
                where=f"{path}, variable {name}",
                remedy=f"Give (time, {expected[0]}, {expected[1]})",
            )
        self.count = int(found[0])
        self._constant = self._read(0) if self.count == 1 else None

    def _read(self, record: int) -> Floats:
        with opened(self.path) as dataset:
            return unpacked(dataset, self.path, self.name, record)

    def __getitem__(self, record: int) -> Floats:
        return self._read(record) if self._constant is None else self._constant


def a68_records(
    driver: NamelistGroup, icebergs: NamelistGroup, grid: Grid, case: Path, dt: float, steps: int
) -> tuple[Fields | Callable[[int], Fields], Floats | None]:
    """Return the forcing of the A68 test as `riftberg.ocean.gridded.GriddedForcing` takes it.

    Returns
    -------
    records : Fields or callable
        The one state of constant forcing, or a function of the number of hours since the start.
    times : ndarray or None
        Times of the hours since the start of the run, s; None for constant forcing.

    Raises
    ------
    ForcingError
        If a file is missing, has the wrong size, or ends before the run does.
    """
    start = driver.whole("transient_a68_data_start_ind")
    if start < 1:
        raise driver.error(f"transient_a68_data_start_ind = {start} with a68_test", "Give the first record, from 1")
    _check_depth(icebergs)
    folder = data_folder(driver, case)
    hours = {name: _Hours(folder / file, name, grid) for name, file in _VARIABLES.items()}
    as_fields = _Assembler(driver, icebergs, grid)
    varying = [h for h in hours.values() if h.count > 1]
    if not varying:
        return as_fields({name: h[0] for name, h in hours.items()}), None
    if dt != HALF_HOUR:
        remedy = f"The driver's rule of half hours needs ibdt = {HALF_HOUR}"
        raise driver.error(f"ibdt = {dt} with hourly A68 data", remedy)
    last = start + steps // 2
    short = min(varying, key=lambda h: h.count)
    if last > short.count:
        raise ForcingError(
            f"{short.count} hourly records, but {steps} steps from record {start} need {last}",
            where=f"{short.path}, variable {short.name}",
            remedy="Shorten the run (ibhrs, nmax) or start earlier (transient_a68_data_start_ind)",
        )

    def load(k: int) -> Fields:
        return as_fields({name: h[start - 1 + k] for name, h in hours.items()})

    return load, np.arange(short.count - start + 1) * np.float64(3600.0)


def _check_depth(icebergs: NamelistGroup) -> None:
    if icebergs.number("cdrag_grounding") > 0 and not (icebergs.flag("A68_test") and icebergs.flag("mts")):
        raise icebergs.error(
            "cdrag_grounding > 0, but the driver's A68 test knows no depth",
            "Set A68_test = .true. with mts = .true. for the grounding zone, or cdrag_grounding = 0",
        )


class _Assembler:
    """Makes `Fields` of the records of one hour; ice, temperature and depth are shared."""

    def __init__(self, driver: NamelistGroup, icebergs: NamelistGroup, grid: Grid) -> None:
        self._grid = grid
        self._is_velocity = icebergs.flag("tau_is_velocity")
        still = grid.fields(
            ui=driver.number("ibui"), vi=driver.number("ibvi"), sst=driver.number("sst"), depth=UNKNOWN_DEPTH
        )
        self._still = still._replace(sst=celsius(still.sst, grid.arrays.mask))

    def __call__(self, hour: dict[str, Floats]) -> Fields:
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
