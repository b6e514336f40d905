"""Hourly records of forcing files, read in blocks, so that a file is opened and unpacked once for many hours.

A block holds the stored numbers of all variables of a file over some hours, a few MiB; the records are converted to
double precision one by one, as they are asked for. Blocks begin where the compressed chunks of the file begin, so that
no chunk is unpacked twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.kid.ncfile import opened_dataset, packing_of, raw_values, shape_of, true_values
from riftberg.ocean.grid import Grid
from riftberg.state import Floats

BLOCK_BYTES: Final = 8 * 2**20
"""Stored bytes of one variable in a block, about; a block holds at least one chunk."""

LARGEST_CHUNK: Final = 32 * 2**20
"""Chunks above this many bytes are not kept whole: they are unpacked again for every block."""


class HourlyFile:
    """Variables of shape (time, nj, ni) of one file; one block of their records is in memory.

    Parameters
    ----------
    path : pathlib.Path
        NetCDF file.
    names : sequence of str
        Its variables.
    grid : Grid
        Grid whose domain the fields must have.

    Attributes
    ----------
    count : int
        Records of each variable.

    Raises
    ------
    InputError
        If the file or a variable is missing, or the file cannot be read.
    ForcingError
        If a variable does not fit the grid, or the variables differ in their number of records.
    """

    def __init__(self, path: Path, names: Sequence[str], grid: Grid) -> None:
        self.path, self.names = path, tuple(names)
        cells = (grid.arrays.nj, grid.arrays.ni)
        with opened_dataset(path) as dataset:
            shapes = {name: _fitting(shape_of(dataset, path, name), cells, path, name) for name in self.names}
            self._packing = {name: packing_of(dataset, name) for name in self.names}
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
        return {name: true_values(raw[number - self._first], self._packing[name]) for name, raw in self._held.items()}

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
