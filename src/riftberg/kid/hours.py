"""Hourly records of forcing files, read in blocks, so that a file is opened and unpacked once for many hours.

A block holds the stored numbers of all variables of a file over some hours, a few MiB; the records are converted to
double precision one by one, as they are asked for. Blocks begin where the compressed chunks of the file begin, so that
no chunk is unpacked twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.kid.ncfile import missing, opened_dataset, packing_of, raw_values, shape_of, true_values, unpacked
from riftberg.ocean.grid import Grid
from riftberg.state import Floats
from riftberg.system.limits import MEANT, extreme_allowed

BLOCK_BYTES: Final = 8 * 2**20
"""Stored bytes of one variable in a block, about; a block holds at least one chunk."""

LARGEST_CHUNK: Final = 32 * 2**20
"""Chunks above this many bytes are not kept whole: they are unpacked again for every block."""


STRESS: Final = 10.0
"""Largest stress of the wind that is believed, Pa."""

LIMITS: Final = {"ua": 80.0, "va": 80.0, "uo": 5.0, "vo": 5.0, "SSH": 10.0}
"""Largest magnitudes that are believed, m s-1 and m."""

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
            shapes = {name: _fitting(shape_of(dataset, path, name), cells, path, name) for name in self.names}
            self._packing = {name: packing_of(dataset, path, name) for name in self.names}
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
        """Read the records of a run once, so that what is wrong with them is said before its first step."""
        for number in range(first, last + 1) if self.count > 1 else (0,):
            self.record(number)

    def _checked(self, name: str, raw: NDArray[Any], number: int) -> Floats:
        """Return the values of a record, after a check that they can be."""
        packing, (unit, limit) = self._packing[name], self._believed(name)
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
            place = f"in row {j + 1}, column {i + 1} ({g.lon[j + halo, i + halo]:g}, {g.lat[j + halo, i + halo]:g})"
            if math.isfinite(value):
                what = f"{name} = {value:g} {place} is not believed: the most is {limit:g} {unit}"
                remedy = f"Write {name} in {unit}, declare what is missing as _FillValue, {MEANT}"
            else:
                what = f"{name} = {value:g} {place} is no number, and not declared as missing"
                remedy = (
                    "Write a number there, or declare it as _FillValue: declared gaps are still water, calm, no slope"
                )
            raise ForcingError(
                f"{what}; {int(bad.sum())} of {bad.size} cells are like that", where=where, remedy=remedy
            )
        if np.isnan(values).all():
            raise ForcingError("holds no value at all, only gaps", where=where, remedy="Give the field of that hour")
        return values

    def _believed(self, name: str) -> tuple[str, float]:
        """Return unit and largest magnitude of a variable."""
        if self._stress and name in ("ua", "va"):
            return "Pa", STRESS
        return "m" if name == "SSH" else "m s-1", LIMITS.get(name, math.inf)

    def check_place(self) -> bool:
        """Compare the positions that the file gives, if any, with those of the grid; returns whether there are some."""
        g, (rows, columns) = self._grid.arrays, self._grid.domain
        found = []
        with opened_dataset(self.path) as dataset:
            for axis, right, along in (
                ("longitude", g.lon[rows, columns], 1),
                ("latitude", g.lat[rows, columns], 0),
            ):
                name = next((n for n in AXES[axis] if n in dataset.variables), None)
                shape = () if name is None else shape_of(dataset, self.path, name)
                if name is None or shape not in (right.shape, (right.shape[along],)):
                    continue
                found.append(name)
                stored = unpacked(dataset, self.path, name)
                stored = stored if stored.ndim == 2 else np.broadcast_to(np.expand_dims(stored, 1 - along), right.shape)
                away = np.abs((stored - right + 180.0) % 360.0 - 180.0)
                if not (away <= HALF_CELL * float(np.median(np.abs(np.diff(right, axis=along))))).all():
                    raise ForcingError(
                        f"its {name} runs from {stored[0, 0]:g} to {stored[-1, -1]:g}, up to {np.max(away):g} degrees away "
                        "from the grid's",
                        where=f"{self.path}, variable {name}",
                        remedy="It must lie on the grid, its rows and columns in the grid's order",
                    )
        return len(found) == 2

    def check_units(self) -> None:
        """Refuse units that say something else than how the driver takes the numbers."""
        with opened_dataset(self.path) as dataset:
            for name in self.names:
                unit = self._believed(name)[0]
                given = str(getattr(dataset.variables[name], "units", unit))
                if " ".join(given.lower().split()) not in (*UNITS[unit], "", "1", "none"):
                    raise ForcingError(
                        f"its units are {given!r}", where=f"{self.path}, variable {name}",
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
        for k, (one, other) in enumerate(pairwise(dates)):
            if abs((other - one).total_seconds() - 3600.0) > 60.0:
                raise ForcingError(
                    f"record {k + 1} is of {one}, record {k + 2} of {other}", where=f"{self.path}, variable time",
                    remedy="KID takes the records as hour after hour, whatever their dates: give each hour once, in order",
                )  # fmt: skip
        return [f"{date:%Y-%m-%d %H:%M}" for date in dates]

    def _length(self) -> int:
        return len(next(iter(self._held.values())))

    def _read(self, first: int) -> None:
        self._held = {}  # let go of the old block before the new one is read
        hours = slice(first, min(first + self._block, self.count))
        with opened_dataset(self.path) as dataset:
            self._held = {name: raw_values(dataset, self.path, name, hours) for name in self.names}
        self._first = first


def _fitting(shape: tuple[int, ...], cells: tuple[int, int], path: Path, name: str) -> tuple[int, ...]:
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
    wanted = max(1, BLOCK_BYTES // size)
    chunks = variable.chunking()
    chunk = int(chunks[0]) if isinstance(chunks, list) else 1
    if chunk == 1 or chunk * size > LARGEST_CHUNK:
        return wanted
    return max(chunk, wanted // chunk * chunk)
