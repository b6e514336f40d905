"""Files that are whole or not there: written under a passing name beside their own, which they take when complete.

Whoever opens the file meets a complete one, and a process killed at any moment leaves at most a hidden ``.part``, which
the next writer of the same file removes. Passing names are unique, so that two processes or threads never share one.

A file that is being written is taken: whoever else wants to write it, a second run for example, is refused. The mark is a
lock that the system gives back when the process ends, however it ends, on a hidden file beside it.
"""

from __future__ import annotations

import errno
import itertools
import json
import logging
import os
import platform
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from riftberg.errors import InputError

_LOG = logging.getLogger(__name__)
_COUNTER: Final = itertools.count(1)

FULL: Final = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the quota of the disk is used up",
    errno.EFBIG: "the file would become larger than it may (ulimit -f)",
    errno.EROFS: "the place is read-only",
    errno.EMFILE: "too many files are open (ulimit -n)",
    errno.ENOLCK: "its file system keeps no locks, which HDF5 asks for. Set the environment variable "
    "HDF5_USE_FILE_LOCKING=FALSE, or use another disk",
}


def refusal(error: Exception) -> str:
    """Return in words why the machine refuses a file."""
    number, text = getattr(error, "errno", None), getattr(error, "strerror", None)
    return FULL.get(number or 0) or (text or str(error) or "cannot be used").lower()


def refused(path: str | Path) -> OSError | None:
    """Return the system's error on one more megabyte behind a file, None where it takes it.

    For libraries that do not say why they could not write: the disk is still full when they have given up.
    """
    left = 1 << 20
    try:
        with open(path, "ab", buffering=0) as file:
            while left:
                left -= file.write(bytes(left))
            os.fsync(file.fileno())
    except OSError as error:
        return OSError(error.errno, refusal(error), str(path))
    return None


def lock_fault(path: str | Path) -> OSError | None:
    """Return why a file cannot be locked to be read, which HDF5 calls a permission that is denied; None where it can."""
    if fcntl is None:
        return None
    with suppress(OSError), open(path, "rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return BlockingIOError(
                errno.EAGAIN, "it is open for writing in a program, which has to close it first", str(path)
            )
        except OSError:  # whatever number a file system or a sandbox gives
            return OSError(errno.ENOLCK, FULL[errno.ENOLCK], str(path))
    return None


@contextmanager
def replacing(path: str | Path, *, copy: bool = False, to_disk: bool = False, ending: bool = False) -> Iterator[Path]:
    """Give the passing name of a file, which takes its own name if the block ends well."""
    path = Path(path)
    remove_leftovers(path)
    temporary = path.with_name(
        f".{path.name}.{_node()}-{os.getpid()}-{next(_COUNTER)}.part{path.suffix if ending else ''}"
    )
    try:
        if copy:
            shutil.copyfile(path, temporary)
        yield temporary
        if to_disk:
            with temporary.open("r+b") as handle:
                os.fsync(handle.fileno())
        os.replace(temporary, path)
        _LOG.debug("wrote %s", path)
    except BaseException:
        # HDF5 keeps a file that it could not write open until the process ends, and with it its room on the disk.
        with suppress(OSError):
            os.truncate(temporary, 0)
        raise
    finally:
        with suppress(OSError):  # what failed first is what is reported
            temporary.unlink()


def copy_file(source: str | Path, path: str | Path) -> None:
    """Copy a file to one that is whole or not there."""
    with replacing(path) as temporary:
        shutil.copyfile(source, temporary)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8) that is whole or not there."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(content: dict[str, Any], path: str | Path) -> Path:
    """Write a dictionary as JSON."""
    path = Path(path)
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return path


def remove_leftovers(path: Path) -> None:
    """Remove leftovers of a file from a killed process of this machine."""
    name, node, ending = re.escape(path.name), re.escape(_node()), re.escape(path.suffix)
    mine = re.compile(rf"\.{name}(?:\.(?:{node}-)?(\d+)(?:-\d+)?)?\.part(?:{ending})?")
    # Not a pattern for glob: the name may hold its special characters.
    with suppress(OSError), os.scandir(path.parent) as entries:
        for entry in entries:
            leftover = mine.fullmatch(entry.name)
            if leftover and not (leftover[1] and _runs(int(leftover[1]))):
                with suppress(OSError):
                    os.unlink(entry.path)


def _node() -> str:
    return re.sub(r"[^\w]", "_", platform.node())


def _runs(pid: int) -> bool:
    """Tell whether a process is there."""
    if os.name != "posix":
        return True  # asking would end it
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


try:
    import fcntl
except ImportError:  # Windows: no such locks, runs are not kept apart there
    fcntl = None  # type: ignore[assignment]


class OneWriter:
    """Holds a file for one writer."""

    def __init__(self, path: str | Path) -> None:
        self._handle: int | None = None  # first, for it is asked for when this object goes, however far it came
        self.path = Path(path)
        if not self.path.name:
            raise InputError(f"{str(path)!r} has no name", where="output", remedy="Name a file, for example run.nc")
        self.mark = self.path.with_name(f".{self.path.name}.lock")

    def take(self) -> None:
        """Take the file."""
        if fcntl is None:
            return
        while True:
            handle = os.open(self.mark, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                who = os.read(handle, 20).decode("ascii", "replace").strip()
                os.close(handle)
                raise InputError(
                    f"another run{f' (process {who})' if who else ''} is writing this file",
                    where=str(self.path),
                    remedy="Wait for its end or stop it, or give this run another place",
                ) from None
            except OSError:  # a file system without locks
                self.mark.unlink(missing_ok=True)
                os.close(handle)
                return
            if self._is_mark(handle):
                break
            os.close(handle)  # its last holder removed it meanwhile
        self._handle = handle
        with suppress(OSError):  # a full disk; the number is a courtesy to whoever is refused
            os.ftruncate(handle, 0)
            os.write(handle, str(os.getpid()).encode())

    def _is_mark(self, handle: int) -> bool:
        try:
            return os.path.samestat(os.fstat(handle), os.stat(self.mark))
        except FileNotFoundError:
            return False

    def give_back(self) -> None:
        """Let others have the file."""
        handle, self._handle = self._handle, None  # given back once: a second time the number may be another file's
        if handle is not None:
            with suppress(OSError):
                self.mark.unlink()
            with suppress(OSError):
                os.close(handle)

    def __del__(self) -> None:
        self.give_back()


@contextmanager
def only_writer(*paths: str | Path) -> Iterator[None]:
    """Hold files for a block."""
    writers = [OneWriter(path) for path in paths]
    try:
        for writer in writers:
            writer.take()
        yield
    finally:
        for writer in writers:
            writer.give_back()
