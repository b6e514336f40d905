"""Machine code kept for later runs, by several processes at once.

Numba numbers the files of a function's machine code (one for each signature) by an index, which it reads, adds to and
replaces. Two processes that compile different signatures at once take the same number, and the index that comes last
then gives the code of one signature to the callers of the other. Here a process adds to the index alone, a number once
used is never used again, and the code is there before the index names it, so that a process killed in between does no
harm either.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


class SharedFiles(IndexDataCacheFile):
    """Index and code files of one function."""

    def save(self, key: Any, data: Any) -> None:
        """Keep machine code under a key."""
        with _alone(f"{self._index_path}.lock"):
            known = self._load_index()
            name = known.get(key) or self._new_name()
            self._save_data(name, data)
            if key not in known:
                self._save_index({**known, key: name})

    def _new_name(self) -> str:
        names = (self._data_name(number) for number in itertools.count(1))
        return next(str(name) for name in names if not os.path.exists(self._data_path(name)))


class SharedCache(FunctionCache):
    """Numba's cache of one function, safe for several processes."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = SharedFiles(self._cache_path, self._impl.filename_base, locator.get_source_stamp())


@contextmanager
def _alone(mark: str) -> Iterator[None]:
    """Hold a file lock; where the file system has none, go on without."""
    handle = os.open(mark, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if fcntl is not None:
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
