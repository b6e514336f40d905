"""Machine code kept for later runs, by several processes at once.

Numba numbers the files of a function's machine code (one for each signature) by an index, which it reads, adds to and
replaces. Two processes that compile different signatures at once take the same number, and the index that comes last
then gives the code of one signature to the callers of the other. Here a process adds to the index alone, a number once
used is never used again, and the code is there before the index names it, so that a process killed in between does no
harm either.

Each file ends with a checksum of its content: a flipped bit in machine code would else be run. What is damaged is
compiled anew, and what cannot be written is done without.
"""

from __future__ import annotations

import hashlib
import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from llvmlite.binding import address_of_symbol
from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.runtime.nrt import rtsys

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_DIGEST: Final = hashlib.sha256().digest_size


class SharedFiles(IndexDataCacheFile):
    """Index and code files of one function."""

    def save(self, key: Any, data: Any) -> None:
        """Keep machine code under a key."""
        # From reading the index to writing it nobody else may take a number.
        with _alone(f"{self._index_path}.lock"):
            known = self._load_index()
            name = known.get(key) or self._new_name()
            # The code before the index: a process that dies in between leaves a file that nothing names.
            self._save_data(name, data)
            if key not in known:
                self._save_index({**known, key: name})

    def _dump(self, content: Any) -> bytes:
        data: bytes = super()._dump(content)
        return data + hashlib.sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        data = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(data[:-_DIGEST]).digest() != data[-_DIGEST:]:
            raise ValueError(f"{name} is damaged")
        return super()._load_data(name)

    def _new_name(self) -> str:
        names = (self._data_name(number) for number in itertools.count(1))
        return next(str(name) for name in names if not os.path.exists(self._data_path(name)))


class SharedCache(NullCache):
    """Numba's cache of one function, made when machine code is asked for: most functions are parts of few that are."""

    def __init__(self, function: Callable[..., Any], folder: Callable[[], Path]) -> None:
        self._function, self._folder = function, folder

    @cached_property
    def _kept(self) -> _KeptCode:
        before = config.CACHE_DIR  # type: ignore[attr-defined]
        # numba reads the setting when a cache is made; other packages must not inherit ours.
        config.CACHE_DIR = str(self._folder())  # type: ignore[attr-defined]
        try:
            return _KeptCode(self._function)
        finally:
            config.CACHE_DIR = before  # type: ignore[attr-defined]

    @property
    def cache_path(self) -> Any:
        """Folder of the files."""
        return self._kept.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature, None if nothing was."""
        return self._kept.load_overload(sig, target_context)

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what was compiled for a signature."""
        self._kept.save_overload(sig, cres)

    def flush(self) -> None:
        """Forget what is kept."""
        self._kept.flush()


class _WithNeeds(CompileResultCacheImpl):
    """Machine code beside the names that it expects to find outside."""

    def reduce(self, cres: Any) -> Any:
        """Return what is kept of compiled code.

        Of the environments of the functions in it those are left out that hold no objects of Python: nothing asks for them,
        and to bring them back loads the modules of NumPy's functions, and SciPy with them.
        """
        *kept, environments = super().reduce(cres)
        needed = tuple(environment for environment in environments if environment.consts)
        return _names_outside(cres.library._final_module), (*kept, needed)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return compiled code from what was kept.

        To load all that numba can compile takes half a second, and code that was compiled needs none of it: only its
        reference counts, unless something else is not there that it calls.
        """
        needs, kept = payload
        rtsys.initialize(target_context)
        if any(address_of_symbol(name) is None for name in needs):
            target_context.refresh()
        return super().rebuild(target_context, kept)


def _names_outside(module: Any) -> list[str]:
    """Return the names of functions and variables that a module declares and does not hold."""
    names = [one.name for kind in (module.functions, module.global_variables) for one in kind if one.is_declaration]
    return [name for name in names if not name.startswith("llvm.")]


class _KeptCode(FunctionCache):
    """The files of one function, safe for several processes."""

    _impl_class = _WithNeeds

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = SharedFiles(self._cache_path, self._impl.filename_base, locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature, None if nothing was."""
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    @contextmanager
    def _guard_against_spurious_io_errors(self) -> Iterator[None]:
        """Let numba compile anew whatever goes wrong with a file; it has this place for faults of the file system."""
        try:
            yield
        except Exception:  # a damaged file makes the reader raise whatever it likes
            with suppress(Exception):
                self._cache_file.flush()


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
