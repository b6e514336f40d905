"""Machine code kept for later runs, by several processes at once: one file for each kernel and each signature.

Numba freezes what a kernel reads into its code: laws that it calls, constants, fields of named tuples. All of them come from
the module itself or from modules that it imports, so code goes by a digest of these, and of what they import in turn. A
changed source asks for new code of its own kernels and of those that can call them, and of no others.

A file is written beside its place and moved there, so that a process that is killed in between does no harm, and two that
compile the same at once write the same. Each ends with a checksum of its content: a flipped bit in machine code would else
be run. What is damaged is compiled anew, and what cannot be written is done without.

An installed wheel may bring files of its own (`riftberg.compiled.machine_code`). They are looked up first, and are used by
whoever has the same Python, numba and kind of processor; how other functions are compiled does not change.
"""

from __future__ import annotations

import hashlib
import pickle
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

from llvmlite.binding import address_of_symbol, parse_assembly
from numba.core import serialize
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.types import BaseTuple

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(r"^(?:from (riftberg[\w.]*) import (\([^)]*\)|.*)|import (riftberg[\w.]*))", flags=re.MULTILINE)


@cache
def _read(path: Path) -> tuple[bytes, frozenset[Path]]:
    """Return the digest of a module's text, and the modules of this package that it imports at its top.

    Imports for types and those inside of functions do not count: kernels see the module's globals alone.
    """
    text = path.read_bytes()
    imported: set[Path] = set()
    for module, names, whole in _IMPORT.findall(text.decode("utf-8")):
        for name in [module or whole, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]:
            # Importing a module runs the packages above it, too.
            parts = name.split(".")[1:]
            for depth in range(1, len(parts) + 1):
                place = _PACKAGE.joinpath(*parts[:depth])
                imported.update(file for file in (place / "__init__.py", place.with_suffix(".py")) if file.is_file())
    return hashlib.sha256(text).digest(), frozenset(imported)


@cache
def digest_of_sources(path: Path) -> str:
    """Return one digest of a module and all modules of this package that it imports, by whichever way.

    Raises
    ------
    OSError
        If the module stands in no file.
    """
    known: set[Path] = set()
    new = {path}
    while new:
        known |= new
        new = {module for one in new for module in _read(one)[1]} - known
    if _PACKAGE not in path.parents:  # what somebody else's kernel calls may stand in any file beside it
        known.update(path.parent.glob("*.py"))
    found = hashlib.sha256()
    for module in sorted(known):
        found.update(_read(module)[0])
    return found.hexdigest()


ENDING: Final = ".code"
"""Ending of the files."""

_DIGEST: Final = hashlib.sha256().digest_size


class KernelCache(NullCache):
    """What numba asks for the kept code of one function.

    ``folders``: gives the folders to look in; code is kept in the last of them. ``linked``: callers take up the code that is
    kept, which needs that of LLVM beside the machine code. ``caller``: source of a function that calls this one, where its
    code is kept.
    """

    def __init__(
        self, function: Callable[..., Any], folders: Callable[[], list[Path]], *, linked: bool, caller: str = ""
    ) -> None:
        self._function, self._folders, self._linked, self._caller = function, folders, linked, caller

    def of_caller(self, text: str) -> KernelCache:
        """Return the cache of a function of this source that calls this one."""
        return KernelCache(self._function, self._folders, linked=self._linked, caller=text)

    @cached_property
    def _source(self) -> str | None:
        """Which function this is; none where it stands in no file: the next one of that name may be another."""
        code = self._function.__code__
        try:
            sources = digest_of_sources(Path(code.co_filename))
        except OSError:
            return None
        within = [cell.cell_contents for cell in self._function.__closure__ or ()]
        body = hashlib.sha256(code.co_code + serialize.dumps(within)).hexdigest()
        return f"{self._function.__module__} {self._function.__qualname__} {code.co_firstlineno} {sources} {body}"

    def _name(self, sig: Any) -> str:
        digest = hashlib.sha256(f"{self._source} {self._caller} {sig} {_fields(sig)}".encode()).hexdigest()[:24]
        return f"{self._function.__module__}.{self._function.__name__}-{digest}{ENDING}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature, None if nothing was or it is damaged."""
        if self._source is None:
            return None
        for folder in self._folders():
            # A damaged file makes the reader raise whatever it likes.
            with suppress(Exception):
                data = (folder / self._name(sig)).read_bytes()
                if hashlib.sha256(data[:-_DIGEST]).digest() == data[-_DIGEST:]:
                    return _rebuilt(pickle.loads(data[:-_DIGEST]), target_context)
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what was compiled for a signature, unless it holds addresses of this process or cannot be written."""
        if self._source is None or cres.lifted or cres.library.has_dynamic_globals:
            return
        from riftberg.system.atomic_files import replacing  # not at the top: its sources do not decide on machine code

        data = serialize.dumps(_reduced(cres, self._linked))
        with suppress(OSError), replacing(self._folders()[-1] / self._name(sig)) as path:
            path.write_bytes(data + hashlib.sha256(data).digest())


def _fields(kinds: Iterable[Any]) -> list[Any]:
    """Return the names of the fields of named tuples among types: their order is frozen into code, and types alone hide it."""
    tuples: list[Any] = [kind for kind in kinds if isinstance(kind, BaseTuple)]
    return [(getattr(kind, "fields", ()), _fields(kind)) for kind in tuples]


def _reduced(cres: Any, linked: bool) -> Any:
    """Return what is kept of compiled code, beside the names that it expects to find outside.

    Of the environments of the functions in it those are left out that hold no objects of Python: nothing asks for them,
    and to bring them back loads the modules of NumPy's functions, and SciPy with them. To read LLVM's code takes half of the
    time of loading; where it is not ``linked`` numba asks it but for the names that the machine code defines.
    """
    library, *kept, environments = cres._reduce()
    if not linked:
        name, kind, (machine_code, _) = library
        defined = cres.fndesc.llvm_func_name, cres.fndesc.llvm_cpython_wrapper_name
        names_alone = "\n".join(f'define void @"{one}"() {{ ret void }}' for one in defined)
        library = name, kind, (machine_code, parse_assembly(names_alone).as_bitcode())
    needed = tuple(environment for environment in environments if environment.consts)
    module = cres.library._final_module
    names = [one.name for kind in (module.functions, module.global_variables) for one in kind if one.is_declaration]
    return [name for name in names if not name.startswith("llvm.")], (library, *kept, needed)


def _rebuilt(payload: Any, target_context: Any) -> Any:
    """Return compiled code from what was kept.

    To load all that numba can compile takes half a second, and code that was compiled needs none of it: only its
    reference counts, unless something else is not there that it calls.
    """
    needs, kept = payload
    rtsys.initialize(target_context)
    if any(address_of_symbol(name) is None for name in needs):
        target_context.refresh()
    return CompileResult._rebuild(target_context, *kept)
