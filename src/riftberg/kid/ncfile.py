"""KID's NetCDF files: reading with errors that name file and variable, restarts, and files that grow by blocks of records.

Source: files 6.1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError, RunError
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import refusal, replacing
from riftberg.system.input_files import MOST_VALUES, because, check_file, reading, refuse_large, value_shown
from riftberg.system.netcdf_lock import open_netcdf, whole_size

_UNPACK: Final = ("scale_factor", "add_offset", "_FillValue", "missing_value")


class Column(NamedTuple):
    """One variable of a KID file: name, NetCDF type (``"f8"`` or ``"i4"``), long name and units."""

    name: str
    dtype: str
    long_name: str
    units: str


@contextmanager
def opened_dataset(path: Path) -> Iterator[netCDF4.Dataset]:
    """Open a NetCDF file for reading; errors of the library become `InputError` with the file's name."""
    check_file(path, remedy="Put it there, or correct the path in the namelist")
    with reading(path, "cannot be read", _AGAIN):
        # The library reads zeros beyond the end of a classic file that was cut short; a run would start from them.
        if (short := (whole_size(str(path)) or 0) - path.stat().st_size) > 0:
            raise _unreadable(path, EOFError(f"the file is at least {short} bytes short"))
        with open_netcdf(path) as dataset:
            yield dataset


_AGAIN: Final = "Not NetCDF, damaged or cut short: copy or write it again"

FILL: Final = 1e30
"""Numbers at least this large are fill values."""

MOST_RECORDS: Final = 20_000_000
"""Elements or bonds of a file."""


def _unreadable(path: Path, error: Exception, name: str = "") -> InputError:
    where = f"{path}, variable {name}" if name else str(path)
    return InputError(f"cannot be read{because(error)}", where=where, remedy=_AGAIN)


def count_records(dataset: netCDF4.Dataset, path: Path) -> int:
    """Return the number of elements or bonds, the size of dimension ``i``."""
    if "i" not in dataset.dimensions:
        names = ", ".join(dataset.dimensions) or "none"
        raise InputError(f"no dimension 'i' (found: {names})", where=str(path), remedy="KID files have it")
    size = len(dataset.dimensions["i"])
    refuse_large(
        size, MOST_RECORDS, "records", size=500.0, where=str(path), kind=InputError,
        remedy="The header is damaged, or give a smaller file",
    )  # fmt: skip
    return size


def read_shape(dataset: netCDF4.Dataset, path: Path, name: str) -> tuple[int, ...]:
    """Return the shape of a variable that must be there, and hold numbers."""
    if name not in dataset.variables:
        present = ", ".join(sorted(dataset.variables))
        raise InputError(f"no variable '{name}' (found: {present})", where=str(path), remedy=f"Add '{name}'")
    variable = dataset.variables[name]
    kind = variable.dtype if isinstance(variable.dtype, np.dtype) else np.dtype(object)
    if kind.kind not in "iuf":
        text = "text" if kind.kind in "OSU" else str(kind)
        raise InputError(f"holds {text}, not numbers", where=f"{path}, variable {name}", remedy="Write it as numbers")
    return tuple(variable.shape)


def raw_values(dataset: netCDF4.Dataset, path: Path, name: str, selection: Any = slice(None)) -> NDArray[Any]:
    """Return the stored numbers of a variable, without mask or scaling."""
    shape = read_shape(dataset, path, name)
    variable = dataset.variables[name]
    variable.set_auto_maskandscale(False)
    if selection == slice(None):
        refuse_large(
            math.prod(shape), MOST_VALUES, "numbers", size=8.0, where=f"{path}, variable {name}", kind=InputError,
            remedy="The header is damaged, or give a smaller file",
        )  # fmt: skip
    try:
        return np.asarray(variable[selection])
    except (RuntimeError, OSError, IndexError) as error:
        raise _unreadable(path, error, name) from error


def read_packing(dataset: netCDF4.Dataset, path: Path, name: str) -> dict[str, NDArray[Any]]:
    """Return the attributes of a variable that say how its numbers are stored."""
    variable = dataset.variables[name]
    packing: dict[str, NDArray[Any]] = {}
    for key in _UNPACK:
        if key not in variable.ncattrs():
            continue
        packing[key] = value = np.atleast_1d(np.asarray(variable.getncattr(key)))
        scales = key in ("scale_factor", "add_offset")
        bad = value.dtype.kind not in "iuf" or (scales and (value.size != 1 or not np.isfinite(value).all()))
        if bad or (key == "scale_factor" and value[0] == 0.0):
            raise InputError(
                f"its attribute {key} = {value_shown(variable.getncattr(key))} says nothing",
                where=f"{path}, variable {name}",
                remedy=f"Write {key} as a finite number" + (" that is not 0" if key == "scale_factor" else ""),
            )
    return packing


def missing(raw: NDArray[Any], packing: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Whether stored numbers are those that the file declares as missing."""
    gone = np.zeros(raw.shape, np.bool_)
    for key in ("_FillValue", "missing_value"):
        for fill in packing.get(key, ()):
            # A fill of another precision than the numbers is meant in theirs.
            gone |= (
                np.isnan(raw) if np.isnan(fill) else raw == (raw.dtype.type(fill) if raw.dtype.kind == "f" else fill)
            )
    return gone


def true_values(raw: NDArray[Any], packing: Mapping[str, NDArray[Any]]) -> Floats:
    """Return stored numbers in double precision, integer x ``scale_factor`` + ``add_offset``; missing ones are NaN."""
    values = raw.astype(np.float64)
    if "scale_factor" in packing:
        values = values * np.float64(packing["scale_factor"][0])
    if "add_offset" in packing:
        values = values + np.float64(packing["add_offset"][0])
    values[missing(raw, packing)] = np.nan
    return values


def unpacked(dataset: netCDF4.Dataset, path: Path, name: str, selection: Any = slice(None)) -> Floats:
    """Return a variable in double precision, as `true_values` does."""
    raw = raw_values(dataset, path, name, selection)
    return true_values(raw, read_packing(dataset, path, name))


def column(dataset: netCDF4.Dataset, path: Path, name: str, size: int, default: float | None = None) -> Floats:
    """Return one real number per element or bond."""
    if default is not None and name not in dataset.variables:
        return np.full(size, default)
    values = _sized(unpacked(dataset, path, name), path, name, size)
    bad = ~(np.abs(values) < FILL)
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"{name} = {values[k]:g} of record {k + 1} is a fill value, not a finite number",
            where=f"{path}, variable {name}",
            remedy="Correct the record, or remove it",
        )
    return values


def whole_column(dataset: netCDF4.Dataset, path: Path, name: str, size: int, default: int | None = None) -> Ints:
    """Return one whole number per element or bond; arguments as in `column`."""
    if default is not None and name not in dataset.variables:
        return np.full(size, default, dtype=np.int64)
    values = _sized(raw_values(dataset, path, name), path, name, size)
    # KID's whole numbers have 32 bits; the least of them, which stands for none, is one of them.
    with np.errstate(invalid="ignore"):
        bad = ~((values >= -(2.0**31)) & (values < 2.0**31) & (values == np.floor(values)))
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"{name} = {values[k]:g} of record {k + 1} is no whole number of 32 bits",
            where=f"{path}, variable {name}",
            remedy="Correct the record, or remove it",
        )
    return values.astype(np.int64)


def _sized(values: NDArray[Any], path: Path, name: str, size: int) -> NDArray[Any]:
    where = f"{path}, variable {name}"
    if values.shape != (size,):
        raise InputError(
            f"shape {values.shape}, expected ({size},)",
            where=where,
            remedy="All variables run over dimension i",
        )
    return values


def checksum(values: NDArray[Any]) -> str:
    """Return KID's checksum of a variable: 64-bit wrapped sum of bit patterns (reals) or of values (whole numbers)."""
    # The bits of reals, the values of whole numbers; unsigned sums wrap as Fortran's do.
    bits = values.astype(np.float64).view(np.uint64) if values.dtype.kind == "f" else values.astype(np.int64)
    total = int(bits.astype(np.uint64).sum(dtype=np.uint64)) if bits.size else 0
    return f"{total:>16X}".ljust(32)


def write_restart_file(path: Path, columns: list[tuple[Column, NDArray[Any]]], size: int, *, counter: bool) -> None:
    """Write a file in the layout of KID's restarts."""
    with (
        replacing(path, to_disk=True) as temporary,
        open_netcdf(temporary, "w", format="NETCDF3_64BIT_OFFSET") as dataset,
    ):
        dataset.setncatts(
            {
                "file_format_major_version": np.int32(0),
                "file_format_minor_version": np.int32(1),
                "time_axis": np.int32(0),
                "NumFilesInSet": np.int32(1),
            }
        )
        dataset.createDimension("i", None)
        if counter:
            dataset.createVariable("i", "i4", ())[...] = size
        for item, values in columns:
            variable = dataset.createVariable(item.name, item.dtype, ("i",))
            if item.dtype == "i4":
                variable.packing = np.int32(0)
            variable.setncatts({"long_name": item.long_name, "units": item.units, "checksum": checksum(values)})
        for item, values in columns:
            dataset.variables[item.name][:size] = values


BLOCK_RECORDS: Final = 150_000
"""Records held in memory at most, some 30 MB, as long as writing them takes little time; each block copies the file."""

CHUNK: Final = 4096
"""Records that lie together in the file."""

BLOCK_SECONDS: Final = 10.0
"""Wall-clock time between writes at most, s, as long as records come in."""

PATIENCE: Final = 20.0
"""After a write, which begins with a copy of the file, records are held this many times as long as it took: a small part."""


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
            with replacing(self.path) as temporary, open_netcdf(temporary, "w", format="NETCDF4_CLASSIC") as dataset:
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
                with replacing(self.path, copy=True) as temporary, open_netcdf(temporary, "a") as dataset:
                    end = self._written + self._waiting_size
                    for item in self.columns:
                        block = np.concatenate([records[item.name] for records in self._waiting])
                        dataset.variables[item.name][self._written : end] = block
            except OSError as error:
                raise RunError(
                    f"cannot write {self.path} ({refusal(error)}); it holds {self._good or 'no records yet'}"
                ) from error
            last = self._waiting[-1]
            if "day" in last:
                self._good = f"good records up to day {last['day'][-1]:g} of year {last['year'][-1]}"
            self._written, self._waiting, self._waiting_size = self._written + self._waiting_size, [], 0
        self._last = time.monotonic()
        self._pause = PATIENCE * (self._last - began)

    def close(self) -> None:
        """Write the waiting records."""
        self._write()
