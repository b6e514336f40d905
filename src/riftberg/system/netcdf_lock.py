"""One lock for everything that touches NetCDF and HDF5, whose C libraries must be called by one thread at a time.

All files are opened here: `open_netcdf` for blocks of reading and writing, `open_lazily` for datasets of xarray, whose
later reads take the same lock, `write_dataset` for a dataset of xarray that becomes a file. The lock includes xarray's own,
so that datasets that a program opened itself stay apart from ours too. A program that has not loaded xarray has opened
none, and does not wait here until it is loaded.

Nothing that waits for other threads may stand in a locked block, such as the computation of dask arrays: the threads
that it waits for want the lock.

`whole_size` says how large a file says it is: a classic file that was cut short reads as zeros beyond its end.
"""

from __future__ import annotations

import errno
import logging
import os
import struct
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import netCDF4
import numpy as np

from riftberg.errors import RiftbergError, without_secrets
from riftberg.system.atomic_files import FULL, lock_fault, refused, replacing
from riftberg.system.input_files import is_address, no_plain_file
from riftberg.system.process import interruptible

if TYPE_CHECKING:
    import xarray as xr

_LOG = logging.getLogger(__name__)

_NETCDF: Final = (b"CDF", b"\x89HDF")
_LOCKED: Final = ("netcdf4", "h5netcdf")
"""Engines of xarray that call the libraries which this lock is for."""


class NetcdfLock:
    """Lock that its holder may take again, held together with xarray's lock; there is one in a process.

    Pickled, for example with a dataset on its way to another process, it becomes the lock of that process.
    """

    def __init__(self) -> None:
        self._ours = threading.RLock()
        self._theirs: Any = None
        self._depth = 0

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Take the lock; return whether it was had."""
        if not self._ours.acquire(blocking, timeout):
            return False
        # Ours before theirs, always: two threads that took them in different orders would wait for each other.
        if self._depth == 0:
            # None as long as nobody has loaded xarray.
            self._theirs = getattr(sys.modules.get("xarray.backends.netCDF4_"), "NETCDF4_PYTHON_LOCK", None)
            if self._theirs is not None and not self._theirs.acquire(blocking):
                self._ours.release()
                return False
        self._depth += 1
        return True

    def release(self) -> None:
        """Give the lock back."""
        self._depth -= 1
        if self._depth == 0 and self._theirs is not None:
            self._theirs.release()
        self._ours.release()

    def locked(self) -> bool:
        """Return whether anybody holds the lock."""
        return self._depth > 0

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *error: object) -> None:
        self.release()

    def __reduce__(self) -> tuple[Callable[[], NetcdfLock], tuple[()]]:
        return _the_lock, ()


NETCDF: Final = NetcdfLock()
"""The lock of this process."""


def _the_lock() -> NetcdfLock:
    return NETCDF


if hasattr(os, "register_at_fork"):
    # A child made while another thread reads would inherit a lock that nobody gives back, and a library in mid-call.
    os.register_at_fork(before=NETCDF.acquire, after_in_parent=NETCDF.release, after_in_child=NETCDF.release)


@contextmanager
def open_netcdf(path: str | Path, mode: str = "r", **options: Any) -> Iterator[netCDF4.Dataset]:
    """Open a NetCDF file for a block in which this thread alone uses NetCDF."""
    _LOG.debug("opening %s (%s)", path, mode)
    if mode == "r":
        with NETCDF, _read(path, **options) as file:
            yield file
        return
    with _raise_true_reason(path), NETCDF, _written(path, mode, **options) as file:
        yield file


@contextmanager
def _raise_true_reason(path: str | Path) -> Iterator[None]:
    """Re-raise a failure to write with the system's reason: the libraries say "HDF error" or -101 to a full disk."""
    try:
        yield
    except (RuntimeError, OSError) as error:
        if isinstance(error, RiftbergError) or getattr(error, "errno", None) in FULL:
            raise
        reason = lock_fault(path) if isinstance(error, OSError) else None
        if reason is None or isinstance(
            reason, BlockingIOError
        ):  # the library holds the lock of what it failed to write
            reason = refused(path)
        if reason is not None:
            raise reason from error
        if not str(error).startswith("NetCDF") and "[Errno -" not in str(error):
            raise
        raise OSError(errno.EIO, f"cannot be written ({error})", str(path)) from error


@contextmanager
def _written(path: str | Path, mode: str, **options: Any) -> Iterator[netCDF4.Dataset]:
    _close_texts()
    file = interruptible(path, partial(netCDF4.Dataset, str(path), mode, **options))  # type: ignore[arg-type]
    try:
        yield file
        _fix_attributes(file)
    except BaseException:
        with suppress(RuntimeError, OSError):  # what failed first is what is reported
            _close(file, path)
        raise
    _close(file, path)


def _fix_attributes(group: netCDF4.Dataset) -> None:
    """Store all texts as characters: of texts of any length (NC_STRING) other programs die, see `_WITH_TEXTS`.

    netCDF4 makes such of lists, and of texts that are not ASCII.
    """
    holders: list[Any] = [group, *group.variables.values()] if group.data_model == "NETCDF4" else []
    for holder in holders:
        for name in holder.ncattrs():
            value = holder.getncattr(name)
            if isinstance(value, list):
                value = ("; " if any(" " in text for text in value) else " ").join(value)
                holder.setncattr(name, value.encode())
            elif isinstance(value, str) and not value.isascii():
                holder.setncattr(name, value.encode())
    for inner in group.groups.values():
        _fix_attributes(inner)


def fixed_texts(dataset: xr.Dataset, width: int = 1) -> xr.Dataset:
    """Return a dataset whose texts are characters, as many as the longest one of each has, or more (``width``, bytes)."""
    fixed = {}
    for name, variable in dataset.variables.items():
        values = variable.values if variable.dtype.kind in "OTU" else np.zeros(0)
        if values.size and all(isinstance(text, str) for text in values.flat):
            coded = np.char.encode(values.astype(str), "utf-8")
            coded = coded.astype(f"S{max(width, coded.dtype.itemsize)}")
            fixed[name] = (variable.dims, coded, {**variable.attrs, "_Encoding": "utf-8"})
    return dataset.assign(fixed)


def _close(file: netCDF4.Dataset, path: str | Path) -> None:
    """Close a file once, if all of it can be written; a file that cannot stays open in the library till the process ends.

    To close a file that cannot be written ends the process: HDF5 gives up in mid-close, and netCDF lists its contents,
    in memory that is free by then. netCDF4 would do so again as the object goes.
    """
    try:
        file.sync()
        os.close(os.open(path, os.O_WRONLY))  # file systems of a network write, or refuse, when a file is closed
        file.close()
    finally:
        with suppress(KeyError):  # set in the usual way it would become an attribute in the file
            vars(netCDF4.Dataset)["_isopen"].__set__(file, 0)


def _read(path: str | Path, **options: Any) -> netCDF4.Dataset:
    if "memory" in options:
        return netCDF4.Dataset(str(path), **options)
    _refuse_odd(path)
    return _opened(os.fspath(path), "r", **options)


def _opened(path: str, mode: str, **options: Any) -> netCDF4.Dataset:
    """Open a file to read it."""
    _close_texts()
    try:
        return interruptible(path, partial(netCDF4.Dataset, path, mode, **options))  # type: ignore[arg-type]
    except OSError as error:
        if (reason := lock_fault(path)) is not None:
            raise reason from error
        raise


def _refuse_odd(path: Any) -> None:
    """Refuse a path that would be waited for, such as a pipe; a folder may be Zarr and is left to who opens it."""
    fault = no_plain_file(os.fspath(path)) if isinstance(path, str | os.PathLike) and not os.path.isdir(path) else ""
    if fault:
        raise OSError(errno.EINVAL, fault, str(path))


def open_lazily(source: Any, **options: Any) -> xr.Dataset:
    """Open a dataset whose values are read when they are asked for, each read under the lock."""
    import xarray as xr
    from xarray.backends.plugins import guess_engine

    is_path = isinstance(source, str | os.PathLike)
    _LOG.debug("opening %s", without_secrets(str(source)) if is_path else type(source).__name__)
    _refuse_odd(source)
    engine = options.pop("engine", None) or ("netcdf4" if _is_netcdf(source) else guess_engine(source))
    if engine not in _LOCKED:
        return noted_as_open(xr.open_dataset(source, engine=engine, **options))
    # Left to itself xarray would take its own lock, which is part of ours and cannot be taken twice.
    options["lock"] = NETCDF
    with NETCDF:
        if engine != "netcdf4" or not is_path:
            return noted_as_open(xr.open_dataset(source, engine=engine, **options))
        from xarray.backends import CachingFileManager, NetCDF4DataStore

        del options["lock"]
        files: Any = CachingFileManager(_opened, os.fspath(source), mode="r", lock=NETCDF)
        store = NetCDF4DataStore(files, group=options.pop("group", None), lock=NETCDF)  # type: ignore[no-untyped-call]
        if _holds_texts(files.acquire()):
            _WITH_TEXTS.add(files)
        ds = xr.open_dataset(store, engine="store", **options)
        ds.encoding["source"] = str(source) if is_address(source) else os.path.abspath(source)
        return noted_as_open(ds)


_WITH_TEXTS: Final[weakref.WeakSet[Any]] = weakref.WeakSet()
"""Managers of files of xarray that hold texts of any length (NC_STRING).

A file with such texts that is closed while another one is open leaves HDF5 with types of a file that is gone; after a few of
them the process ends in a segmentation fault (netcdf-c issue 2510). So one of them at most is open at a time: xarray opens a
file again by itself that was closed.
"""


def _close_texts() -> None:
    for files in list(_WITH_TEXTS):
        files.close()


def _holds_texts(group: netCDF4.Dataset) -> bool:
    return any(variable.dtype is str for variable in group.variables.values()) or any(
        _holds_texts(inner) for inner in group.groups.values()
    )


_OPENED: ContextVar[list[xr.Dataset] | None] = ContextVar("datasets opened in a block of closing", default=None)


def noted_as_open(ds: xr.Dataset) -> xr.Dataset:
    """Return a dataset that was just opened, noted for the block of `closing_files` in which that happened."""
    if (opened := _OPENED.get()) is not None:
        opened.append(ds)
    return ds


@contextmanager
def closing_files(*, only_if_refused: bool = False) -> Iterator[None]:
    """Close at its end the files opened lazily in this block, in all cases or only if it ends in an error.

    An error keeps the frames in which it was raised, and with them the files open there: a notebook holds its last error,
    so that a refused file could not be written anew. A dataset that is still in use opens its file again by itself.
    """
    outer, opened = _OPENED.get(), list[Any]()
    _OPENED.set(opened)
    try:
        yield
    except BaseException:
        only_if_refused = False
        raise
    finally:
        _OPENED.set(outer)
        if not only_if_refused:
            for ds in opened:
                ds.close()
        elif outer is not None:
            outer.extend(opened)


def write_dataset(dataset: xr.Dataset, path: str | Path, *, more: bool = False, **options: Any) -> None:
    """Write a dataset of xarray as a NetCDF file, which is there as a whole or not at all.

    ``more``: add its variables to those in a file that nobody else knows yet.
    """
    from xarray.backends import NetCDF4DataStore

    dataset = fixed_texts(dataset.compute())
    for name, variable in dataset.variables.items():
        if variable.ndim:  # a reader is told of a bit that has flipped
            for encoding in (variable.encoding, options.get("encoding", {}).get(name, {})):
                encoding["fletcher32"] = True
    with (
        nullcontext(Path(path)) if more else replacing(Path(path)) as temporary,
        open_netcdf(temporary, "a" if more else "w") as file,
    ):
        # `to_netcdf` takes a lock of its own choice. Where a program has a client of dask, that is one which the client's
        # scheduler gives: a file on this machine would wait for another, and fail with a scheduler that is gone.
        dataset.dump_to_store(NetCDF4DataStore(file, mode="a", lock=NETCDF), **options)  # type: ignore[no-untyped-call]


def _is_netcdf(source: Any) -> bool:
    if not isinstance(source, str | os.PathLike) or not Path(source).is_file():
        return False
    with open(source, "rb") as file:
        return file.read(4).startswith(_NETCDF)


_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
_STREAMING = 0xFFFFFFFF


def whole_size(path: str) -> int | None:
    """Return the size (bytes) that the header of a file states; None if it states none that can be read."""
    with Path(path).open("rb") as file:
        head = file.read(48)
        try:
            if head.startswith(b"\x89HDF\r\n\x1a\n"):
                version = head[8]
                width, offset = (head[13], {0: 40, 1: 44}[version]) if version < 2 else (head[9], 28)
                if width != 8 or offset + 8 > len(head):
                    return None
                end = int(struct.unpack_from("<Q", head, offset)[0])
                return end if end < 2**62 else None
            if head[:3] == b"CDF" and head[3] in (1, 2, 5):
                file.seek(0)
                return _Classic(file).size()
        except (struct.error, ValueError, KeyError, MemoryError, OverflowError, IndexError):
            return None
    return None


class _Classic:
    """Header of a classic netCDF file (CDF-1, 2, 5), as far as sizes need it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        version = file.read(4)[3]
        self._count = ">Q" if version == 5 else ">I"
        self._offset = ">I" if version == 1 else ">Q"

    def _number(self, kind: str) -> int:
        return int(struct.unpack(kind, self._file.read(struct.calcsize(kind)))[0])

    def _skip(self, size: int) -> None:
        if size > 1 << 40:
            raise ValueError("not a header")
        self._file.seek(-(-size // 4) * 4, 1)

    def _entries(self) -> int:
        self._number(">I")
        return self._number(self._count)

    def _attributes(self) -> None:
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            kind = self._number(">I")
            self._skip(_WIDTHS[kind] * self._number(self._count))

    def size(self) -> int | None:
        """Return where the last value ends."""
        records = self._number(self._count)
        lengths = []
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            lengths.append(self._number(self._count))
        self._attributes()
        ends, rows = [0], []
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            shape = [lengths[self._number(self._count)] for _ in range(self._number(self._count))]
            self._attributes()
            width = _WIDTHS[self._number(">I")]
            self._number(self._count)
            begin = self._number(self._offset)
            moving = bool(shape) and shape[0] == 0
            size = width
            for length in shape[1:] if moving else shape:
                size *= length
            if moving:
                rows.append((begin, size))
            else:
                ends.append(begin + size)
        if rows and 0 < records < _STREAMING:
            padded = sum(-(-size // 4) * 4 for _, size in rows) if len(rows) > 1 else rows[0][1]
            ends += [begin + (records - 1) * padded + size for begin, size in rows]
        return max(ends)
