"""Files that grow by blocks of records, so that an interrupted run loses little."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError
from riftberg.kid.ncfile import Column

BLOCK_RECORDS: Final = 20_000
"""Records held in memory at most."""

CHUNK: Final = 4096
"""Records that lie together in the file."""

BLOCK_SECONDS: Final = 10.0
"""Wall-clock time between writes at most, s, as long as records come in."""


class BlockWriter:
    """A NetCDF file with one unlimited dimension ``i``; records are appended in blocks and flushed to the disk.

    The container is NetCDF-4 with the classic data model: KID's own classic files take ten times as long to write.

    Parameters
    ----------
    path : pathlib.Path
        File to make; an existing one is replaced.
    columns : list of Column
        Variables in their order.
    """

    def __init__(self, path: Path, columns: list[Column]) -> None:
        self.path, self.columns = Path(path), columns
        self._waiting: list[dict[str, NDArray[Any]]] = []
        self._waiting_size = 0
        self._written = 0
        self._last = time.monotonic()
        try:
            self._dataset = netCDF4.Dataset(str(path), "w", format="NETCDF4_CLASSIC")
        except OSError as error:
            raise InputError(
                f"cannot be written ({error.strerror or error})", where=str(path), remedy="Choose another output file"
            ) from error
        self._define()

    def _define(self) -> None:
        dataset = self._dataset
        dataset.setncatts({"file_format_major_version": np.int32(0), "file_format_minor_version": np.int32(1)})
        dataset.createDimension("i", None)
        for item in self.columns:
            variable = dataset.createVariable(item.name, item.dtype, ("i",), chunksizes=(CHUNK,))
            variable.setncatts({"long_name": item.long_name, "units": item.units})
        dataset.sync()

    def append(self, records: dict[str, NDArray[Any]]) -> None:
        """Add records; all arrays have one length. They reach the disk with the block."""
        size = len(records[self.columns[0].name])
        if size == 0:
            return
        self._waiting.append({item.name: np.array(records[item.name]) for item in self.columns})
        self._waiting_size += size
        if self._waiting_size >= BLOCK_RECORDS or time.monotonic() - self._last > BLOCK_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the waiting records to the disk."""
        self._last = time.monotonic()
        if not self._waiting:
            return
        end = self._written + self._waiting_size
        for item in self.columns:
            block = np.concatenate([records[item.name] for records in self._waiting])
            self._dataset.variables[item.name][self._written : end] = block
        self._dataset.sync()
        self._written, self._waiting, self._waiting_size = end, [], 0

    def close(self) -> None:
        """Write what waits and close the file."""
        self.flush()
        self._dataset.close()
