"""Grid and forcing files of the driver's A68 test (dynamics, section 10.5; files, section 8.7).

The files hold hourly records; one record means forcing that is constant in time. Packed integers are unpacked in
double precision. A step uses the hour, counted from the start index, at which it begins; at half hours currents and wind
are the mean of two records and the sea level is the earlier one's.

Hourly files are read in blocks of a few MiB, so that a file is opened and unpacked once for many hours; records are
converted to double precision one by one. Blocks begin where the compressed chunks of the file begin, so that no chunk is
unpacked twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.kid.ncfile import missing, opened_dataset, raw_values, read_packing, read_shape, true_values, unpacked
from riftberg.kid.parameters import LATE_START, NamelistGroup, add_file_depth, date_after
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid, celsius, haversine, wind_from_stress
from riftberg.state import Floats
from riftberg.system.input_files import MEANT, extreme_allowed

BLOCK_BYTES: Final = 8 * 2**20
"""Stored bytes of one variable in a block, about; a block holds at least one chunk."""

LARGEST_CHUNK: Final = 32 * 2**20
"""Chunks above this many bytes are not kept whole: they are unpacked again for every block."""


STRESS: Final = 10.0
"""Largest plausible stress of the wind, Pa."""

LIMITS: Final = {"ua": 80.0, "va": 80.0, "uo": 5.0, "vo": 5.0, "SSH": 10.0}
"""Largest plausible magnitudes, m s-1 and m."""

HALF_CELL: Final = 0.56
"""Cells between the positions of a file and of the grid at most: files may give centres, the grid gives corners."""

AXES: Final = {"longitude": ("lon", "longitude"), "latitude": ("lat", "latitude")}
"""Names of positions in hourly files."""

UNITS: Final = {
    "m s-1": ("m s-1", "m/s", "m s**-1", "m s^-1", "meter/sec", "meters/second", "m.s-1", "metre second-1"),
    "Pa": ("pa", "n m-2", "n/m2", "n m**-2", "n/m^2"),
    "m": ("m", "meter", "meters", "metre", "metres"),
}
"""Ways to write the units of the fields."""


class HourlyFile:
    """Variables of shape (time, nj, ni) of one file; one block of their records is in memory.

    ``stress``: ``ua`` and ``va`` are the stress of the wind, Pa.
    """

    def __init__(
        self, path: Path, names: Sequence[str], grid: Grid, *, stamp: Callable[[int], str] = str, stress: bool = False,
        bare_gaps: bool = False,
    ) -> None:  # fmt: skip
        self.path, self.names, self._grid = path, tuple(names), grid
        self._stamp, self._stress, self._bare_gaps = stamp, stress, bare_gaps
        cells = (grid.arrays.nj, grid.arrays.ni)
        with opened_dataset(path) as dataset:
            shapes = {name: _check_shape(read_shape(dataset, path, name), cells, path, name) for name in self.names}
            self._packing = {name: read_packing(dataset, path, name) for name in self.names}
            self._block = min(_block_length(dataset.variables[name]) for name in self.names)
        self.count = min(shape[0] for shape in shapes.values())
        if any(shape[0] != self.count for shape in shapes.values()):
            sizes = ", ".join(f"{name} {shape[0]}" for name, shape in shapes.items())
            raise ForcingError(
                f"its variables have different numbers of records ({sizes})",
                where=str(path),
                remedy="Give all of them over the same hours",
            )
        self._first = 0
        self._held: dict[str, NDArray[Any]] = {}

    def record(self, number: int) -> dict[str, Floats]:
        """Return one record, counted from 0, of all variables; NaN where values are missing.

        A file of one record holds a field that is constant in time: its record is every record.
        """
        number = number if self.count > 1 else 0
        if not self._held or not self._first <= number < self._first + self._length():
            self._read(number // self._block * self._block)
        return {name: self._checked(name, raw[number - self._first], number) for name, raw in self._held.items()}

    def check(self, first: int, last: int) -> None:
        """Read the records of a run once, so that their faults are reported before its first step."""
        for number in range(first, last + 1) if self.count > 1 else (0,):
            self.record(number)

    def _checked(self, name: str, raw: NDArray[Any], number: int) -> Floats:
        """Return the values of a record, after a check that they can be."""
        packing, (unit, limit) = self._packing[name], self._plausible(name)
        values = true_values(raw, packing)
        with np.errstate(invalid="ignore"):
            bad = ~np.isfinite(values) | ((np.abs(values) > limit) & (not extreme_allowed()))
        if not bad.any():
            return values
        bad &= ~missing(raw, packing)
        if self._bare_gaps:
            bad &= ~np.isnan(values)
        hour = self._stamp(number) if self.count > 1 else "every hour"
        where = f"{self.path}, variable {name}, record {number + 1} ({hour})"
        if bad.any():
            j, i = (int(k[0]) for k in np.nonzero(bad))
            value, halo, g = float(values[j, i]), self._grid.arrays.halo, self._grid.arrays
            cell = f"in row {j + 1}, column {i + 1} ({g.lon[j + halo, i + halo]:g}, {g.lat[j + halo, i + halo]:g})"
            if math.isfinite(value):
                fault = f"{name} = {value:g} {cell} is not plausible: the most is {limit:g} {unit}"
                remedy = f"Check its units and write {name} in {unit}, declare what is missing as _FillValue, {MEANT}"
            else:
                fault = f"{name} = {value:g} {cell} is no number, and not declared as missing"
                remedy = (
                    "Write a number there, or declare it as _FillValue: declared gaps are still water, calm, no slope"
                )
            raise ForcingError(
                f"{fault}; {int(bad.sum())} of {bad.size} cells are like that", where=where, remedy=remedy
            )
        if np.isnan(values).all():
            raise ForcingError("holds no value at all, only gaps", where=where, remedy="Give the field of that hour")
        return values

    def _plausible(self, name: str) -> tuple[str, float]:
        """Return unit and largest magnitude of a variable."""
        if self._stress and name in ("ua", "va"):
            return "Pa", STRESS
        return "m" if name == "SSH" else "m s-1", LIMITS.get(name, math.inf)

    def check_place(self) -> bool:
        """Compare the positions that the file gives, if any, with the grid; returns whether there are some."""
        g, (rows, columns) = self._grid.arrays, self._grid.domain
        names = []
        with opened_dataset(self.path) as dataset:
            for axis, right, along in (
                ("longitude", g.lon[rows, columns], 1),
                ("latitude", g.lat[rows, columns], 0),
            ):
                name = next((n for n in AXES[axis] if n in dataset.variables), None)
                shape = () if name is None else read_shape(dataset, self.path, name)
                if name is None or shape not in (right.shape, (right.shape[along],)):
                    continue
                names.append(name)
                stored = unpacked(dataset, self.path, name)
                stored = stored if stored.ndim == 2 else np.broadcast_to(np.expand_dims(stored, 1 - along), right.shape)
                offset = np.abs((stored - right + 180.0) % 360.0 - 180.0)
                if not (offset <= HALF_CELL * float(np.median(np.abs(np.diff(right, axis=along))))).all():
                    raise ForcingError(
                        f"its {name} runs from {stored[0, 0]:g} to {stored[-1, -1]:g}, up to {np.max(offset):g} degrees away "
                        "from the grid's",
                        where=f"{self.path}, variable {name}",
                        remedy="It must lie on the grid, its rows and columns in the grid's order",
                    )
        return len(names) == 2

    def check_units(self) -> None:
        """Refuse units that say something else than how the driver takes the numbers."""
        with opened_dataset(self.path) as dataset:
            for name in self.names:
                unit = self._plausible(name)[0]
                stated = str(getattr(dataset.variables[name], "units", unit))
                if " ".join(stated.lower().split()) not in (*UNITS[unit], "", "1", "none"):
                    raise ForcingError(
                        f"its units are {stated!r}", where=f"{self.path}, variable {name}",
                        remedy=f"KID takes the numbers as {unit}, whatever the file says: write them so",
                    )  # fmt: skip

    def dates(self) -> list[str]:
        """Return the dates of the records by the file's own variable ``time``; none where it has no such dates."""
        with opened_dataset(self.path) as dataset:
            time = dataset.variables.get("time")
            units = "" if time is None else str(getattr(time, "units", ""))
            if time is None or self.count < 2 or " since " not in units or time.shape != (self.count,):
                return []
            values = unpacked(dataset, self.path, "time")
            calendar = str(getattr(time, "calendar", "standard"))
            try:
                dates: Any = netCDF4.num2date(values, units, calendar, only_use_cftime_datetimes=True)
            except (ValueError, OverflowError):  # no date of any calendar: then there is nothing to compare
                return []
        for k, (previous, following) in enumerate(pairwise(dates)):
            if abs((following - previous).total_seconds() - 3600.0) > 60.0:
                raise ForcingError(
                    f"record {k + 1} is of {previous}, record {k + 2} of {following}", where=f"{self.path}, variable time",
                    remedy="KID takes the records as hour after hour, whatever their dates: give each hour once, in order",
                )  # fmt: skip
        # The nearest minute: an hour counted in days is a little before or after itself.
        return [f"{date + timedelta(seconds=30):%Y-%m-%d %H:%M}" for date in dates]

    def _length(self) -> int:
        return len(next(iter(self._held.values())))

    def _read(self, first: int) -> None:
        self._held = {}  # let go of the old block before the new one is read
        hours = slice(first, min(first + self._block, self.count))
        with opened_dataset(self.path) as dataset:
            self._held = {name: raw_values(dataset, self.path, name, hours) for name in self.names}
        self._first = first


def _check_shape(shape: tuple[int, ...], cells: tuple[int, int], path: Path, name: str) -> tuple[int, ...]:
    if len(shape) != 3 or shape[0] < 1 or shape[1:] != cells:
        raise ForcingError(
            f"shape {shape} does not fit the grid of {cells[0]} x {cells[1]} cells",
            where=f"{path}, variable {name}",
            remedy=f"Give (time, {cells[0]}, {cells[1]})",
        )
    return shape


def _block_length(variable: Any) -> int:
    """Return how many records to read at once: whole chunks, about `BLOCK_BYTES`."""
    size: int = math.prod(variable.shape[1:]) * variable.dtype.itemsize
    records = max(1, BLOCK_BYTES // size)
    chunks = variable.chunking()
    chunk = int(chunks[0]) if isinstance(chunks, list) else 1
    if chunk == 1 or chunk * size > LARGEST_CHUNK:
        return records
    return max(chunk, records // chunk * chunk)


GRID_FILE: Final = "a68_experiment_ll_p125_grid.nc"
WIND_FILE: Final = "a68_experiment_wind_vel_ncep_10m_dec2020_HOURLY_ll_p125.nc"
OCEAN_FILE: Final = "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc"
SEA_LEVEL_FILE: Final = "a68_experiment_ssh_duacs_dec2020_HOURLY_ll_p125.nc"

HALF_HOUR: Final = 1800.0
"""A long step is a multiple of it: the driver has a rule for whole and half hours, s."""

CELL: Final = 0.125
"""Side of the driver's cells, degrees."""

UNKNOWN_DEPTH: Final = 1000.0
"""Depth where the driver sets none, m."""

VARIABLES: Final = {WIND_FILE: ("ua", "va"), OCEAN_FILE: ("uo", "vo"), SEA_LEVEL_FILE: ("SSH",)}
"""Files of the hourly fields and what is read of them."""


def case_data(driver: NamelistGroup, case: Path) -> Path:
    """Return the folder of the data; ``data_dir`` counts from the run folder."""
    return Path(case) / driver.text("data_dir")


def a68_grid(driver: NamelistGroup, case: Path, period: float) -> Grid:
    """Return the grid of the data file: corners at its longitudes + 360 and its latitudes.

    ``period``: zonal period, degrees. The driver fills its arrays in the domain alone: around it lies water, into which
    elements leave, with the sides of a cell at 0 degrees. Elements beyond an edge count in the cells along it.
    """
    radius = driver.number("REarth")
    grid = read_grid(case_data(driver, case) / GRID_FILE, radius=radius, period=period)
    g = grid.arrays
    rows, columns = (slice(s.start - 1, s.stop + 1) for s in grid.domain)
    g.mask[rows, columns] = 1.0
    outside = np.ones(g.mask.shape, bool)
    outside[grid.domain] = False
    g.dx[outside] = g.dy[outside] = haversine(-CELL, 0.0, 0.0, 0.0, radius)
    return grid


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

    # A single record is constant in time and limits nothing.
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
    if icebergs.number("cdrag_grounding") > 0 and not (icebergs.flag("A68_test") and icebergs.flag("mts")):
        raise icebergs.error(
            "cdrag_grounding > 0, but the driver's A68 test knows no depth",
            "Set A68_test = .true. with mts = .true. for the grounding zone, or cdrag_grounding = 0",
        )
    begin = float(LATE_START.get(start, 0))
    files = open_hours(
        case_data(driver, case),
        grid,
        stress=not icebergs.flag("tau_is_velocity"),
        stamp=lambda number: f"{date_after(begin + 3600.0 * (number + 1 - start))} of the run",
    )
    varying = [file for file in files if file.count > 1]
    if varying and dt % HALF_HOUR != 0.0:
        raise driver.error(
            f"ibdt = {dt} with hourly A68 data: steps begin between whole and half hours, for which the driver has no rule",
            f"Give a multiple of {HALF_HOUR}, such as 1800 or 3600",
        )
    # A step at a half hour takes the mean with the hour after it.
    last = start + math.ceil((steps - 1) * dt / 3600.0)
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
    dated = [(file, dates[start - 1]) for file in files if (dates := file.dates())]
    for file, date in dated[1:]:
        if date != dated[0][1]:
            raise ForcingError(
                f"its record {start} is of {date}, that of {dated[0][0].path.name} of {dated[0][1]}",
                where=f"{file.path}, variable time",
                remedy="KID takes the same record of all files as the same hour: let them begin together",
            )
    background = grid.fields(
        ui=driver.number("ibui"), vi=driver.number("ibvi"), sst=driver.number("sst"), depth=UNKNOWN_DEPTH
    )
    background = background._replace(sst=celsius(background.sst, grid.arrays.mask))
    background = add_file_depth(background, icebergs, case / icebergs.text("restart_input_dir"), grid)
    return hourly_records(files, Assembler(grid, background, icebergs.flag("tau_is_velocity"), "zero"), start)


class Assembler:
    """Makes `Fields` of the records of one hour; ice, temperature and depth are shared.

    ``beyond``: currents beyond the edges of the grid: ``zero``, as in the driver, or the ``nearest``.
    """

    def __init__(self, grid: Grid, background: Fields, is_velocity: bool = True, beyond: str = "nearest") -> None:
        self._grid, self._background, self._is_velocity, self._beyond = grid, background, is_velocity, beyond

    def __call__(self, hour: dict[str, Floats]) -> Fields:
        """Return the state of one hour from its records by name."""
        ua, va = self._wind(hour["ua"], hour["va"])
        extended = self._grid.extended
        return self._background._replace(
            uo=extended(np.nan_to_num(hour["uo"]), self._beyond),
            vo=extended(np.nan_to_num(hour["vo"]), self._beyond),
            ua=extended(ua, "zero"),
            va=extended(va, "zero"),
            ssh=extended(hour["SSH"], "zero"),
        )

    def _wind(self, tau_x: Floats, tau_y: Floats) -> tuple[Floats, Floats]:
        # The reference sets gaps in wind and currents to 0 as well (section 3.1, rule 5).
        tau_x, tau_y = np.nan_to_num(tau_x), np.nan_to_num(tau_y)
        return (tau_x, tau_y) if self._is_velocity else wind_from_stress(tau_x, tau_y)
