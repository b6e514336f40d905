"""A file that is being written is taken: whoever else wants to write it, a second run for example, is refused.

The mark is a lock that the system gives back when the process ends, however it ends, on a hidden file beside it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from riftberg.errors import InputError

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
        if self._handle is not None:
            with suppress(OSError):
                self.mark.unlink()
            os.close(self._handle)
            self._handle = None

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
