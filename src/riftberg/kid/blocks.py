"""Files that grow by blocks of records, so that an interrupted run loses little and a killed one leaves a whole file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError, RunError
from riftberg.kid.ncfile import Column
from riftberg.system.atomic_files import refusal, replacing
from riftberg.system.netcdf_lock import open_netcdf

BLOCK_RECORDS: Final = 20_000
"""Records held in memory at most, as long as writing them takes little time."""

CHUNK: Final = 4096
"""Records that lie together in the file."""

BLOCK_SECONDS: Final = 10.0
"""Wall-clock time between writes at most, s, as long as records come in."""

QUICK: Final = 1.0
"""Writes that take less than this wall-clock time (s) may follow each other at once, as long as the file is small."""

SMALL: Final = 4_000_000
"""Bytes of a file that is copied in no time; each write begins with a copy of the file."""

PATIENCE: Final = 20.0
"""After another one records are held this many times as long as it took, so that writing stays a small part."""


class BlockWriter:
    """A NetCDF file with one unlimited dimension ``i``, to which records are appended in blocks.

    A block goes into a copy of the file, which then takes its name (`riftberg.system.atomic_files`). The container is NetCDF-4
    with the classic data model: KID's own classic files take ten times as long to write.
    """

    def __init__(self, path: Path, columns: list[Column]) -> None:
        self.path, self.columns = Path(path), columns
        self._waiting: list[dict[str, NDArray[Any]]] = []
        self._waiting_size = 0
        self._written = 0
        self._good = ""
        self._pause = 0.0
        self._last = time.monotonic()
        try:
            with replacing(self.path) as part, open_netcdf(part, "w", format="NETCDF4_CLASSIC") as dataset:
                self._define(dataset)
        except OSError as error:
            raise InputError(
                f"cannot be written ({refusal(error)})", where=str(path), remedy="Choose another output file"
            ) from error

    def _define(self, dataset: netCDF4.Dataset) -> None:
        dataset.setncatts({"file_format_major_version": np.int32(0), "file_format_minor_version": np.int32(1)})
        dataset.createDimension("i", None)
        for item in self.columns:
            variable = dataset.createVariable(item.name, item.dtype, ("i",), chunksizes=(CHUNK,))
            attributes = {"long_name": item.long_name, "units": item.units}
            variable.setncatts({name: text for name, text in attributes.items() if text})

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
        """Write the waiting records to the disk, unless that has just taken long."""
        if time.monotonic() - self._last >= self._pause:
            self._write()

    def _write(self) -> None:
        began = time.monotonic()
        if self._waiting:
            try:
                with replacing(self.path, copy=True) as part, open_netcdf(part, "a") as dataset:
                    self._write_block(dataset)
            except OSError as error:
                raise RunError(
                    f"cannot write {self.path} ({refusal(error)}); it holds {self._good or 'no records yet'}"
                ) from error
            last = self._waiting[-1]
            if "day" in last:
                self._good = f"good records up to day {last['day'][-1]:g} of year {last['year'][-1]}"
            self._written, self._waiting, self._waiting_size = self._written + self._waiting_size, [], 0
        self._last = time.monotonic()
        took = self._last - began
        dear = took > QUICK or self.path.stat().st_size > SMALL
        self._pause = PATIENCE * took if dear else 0.0

    def _write_block(self, dataset: netCDF4.Dataset) -> None:
        end = self._written + self._waiting_size
        for item in self.columns:
            block = np.concatenate([records[item.name] for records in self._waiting])
            dataset.variables[item.name][self._written : end] = block

    def close(self) -> None:
        """Write what waits."""
        self._write()
