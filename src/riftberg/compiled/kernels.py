"""The one decorator that compiles numerical kernels, and where their machine code is kept.

Decisions, with their reasons
-----------------------------
* No fast-math: results must not change with the compiler, and NaN must stay visible.
* ``error_model="numpy"``: a division does not branch, so loops vectorise.
* The cache of numba looks only at the file of the outer function, so a change in a law called by a stepper would go
  unnoticed. Here machine code goes by a digest of all sources that a kernel can take anything from, of the versions of numba
  and Python, and of the processor.
* No kernel that Python calls returns a named tuple. To make one, compiled code must run Python code, and where a signal
  waits (Ctrl-C) that code raises instead, which numba does not expect: the process dies of a segmentation fault. Plain
  tuples, numbers and arrays are made without Python code. A named tuple is put together by the Python function around
  the kernel; compiled code may hand named tuples to compiled code as it likes.
* LLVM gives up vectorising a loop that reads and writes some twenty arrays, because it would have to prove or test
  that none overlap; the threshold of that run-time test is raised.

The cache of machine code
-------------------------
It is kept for later runs, by several processes at once: one file for each kernel and each signature.

Numba freezes what a kernel reads into its code: laws that it calls, constants, fields of named tuples. All of them come from
the module itself or from modules that it imports, so code goes by a digest of these, and of what they import in turn. A
changed source asks for new code of its own kernels and of those that can call them, and of no others.

A file is written beside its place and moved there, so that a process that is killed in between does no harm, and two that
compile the same at once write the same. Each ends with a checksum of its content: a flipped bit in machine code would else
be run. What is damaged is compiled anew, and what cannot be written is done without.

Machine code is run as whoever loads it. So a folder counts only if nobody but the user and root can put files into it: owner and
mode of the folder and of all above it, as ssh judges its keys. Else the user's own folder is taken, or a passing one, with a
notice. The code in an installed wheel must not be open to more people than the package beside it.

An installed wheel may bring files of its own (``benchmarks/machine_code.py``). They are looked up first, and are used by
whoever has the same Python, numba and kind of processor; how other functions are compiled does not change.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import multiprocessing
import os
import pickle
import platform
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache, cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import llvmlite.binding as llvm
import numba
from llvmlite import __version__ as llvm_version
from llvmlite.binding import address_of_symbol, parse_assembly
from numba.core import config, serialize
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.types import BaseTuple
from platformdirs import user_cache_path

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(r"^(?:from (riftberg[\w.]*) import (\([^)]*\)|.*)|import (riftberg[\w.]*))", flags=re.MULTILINE)


@cache
def _modules() -> dict[str, Path]:
    """Files of this package by the names of their modules; to ask the disk for each name took five times as long."""
    found = {}
    for folder, _, files in os.walk(_PACKAGE):
        for file in files:
            if file.endswith(".py"):
                path = Path(folder, file)
                parts = path.relative_to(_PACKAGE).with_suffix("").parts
                found[".".join(parts).removesuffix(".__init__")] = path
    return found


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
            above = accumulate(name.split(".")[1:], "{}.{}".format)
            imported.update(_modules()[one] for one in above if one in _modules())
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
            with suppress(Exception), (folder / self._name(sig)).open("rb") as file:
                if not as_closed(os.fstat(file.fileno()), folder.stat()):
                    continue
                data = file.read()
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
            path.touch(mode=0o644)  # no group may write it, whatever the umask says
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


_F = TypeVar("_F", bound=Callable[..., Any])

KNOWN_NUMBA: Final = ("0.68.",)
"""Versions of numba for whose inside `riftberg.compiled.parts` is written; with others compiling takes three times as long."""

for _option in ("runtime-memory-check-threshold", "memory-check-merge-threshold", "vectorize-memory-check-threshold"):
    llvm.set_option("riftberg", f"--{_option}=4096")


PLAIN: Final = frozenset(("Floats", "Ints", "Booleans", "NDArray[np.bool_]", "float", "int", "bool"))
"""Annotations of arguments that are no tuples."""

LEVELS: Final = {
    "x86_64": ("x86-64-v3", ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")),
    "amd64": ("x86-64-v3", ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")),
    "aarch64": ("generic", ()),
    "arm64": ("generic", ()),
}
"""By kind of machine the processor that machine code in a wheel is made for, and what a processor needs to run it.

The level of x86 (2013 and later) is as fast as native code here, for no kernel uses wider vectors to advantage, and gives the
same digits, for numba contracts no products and sums.
"""

SHIPPED: Final = Path(__file__).with_name("machine_code")
"""Folder of the machine code that a wheel brings along; see ``benchmarks/machine_code.py``."""


def toolchain_digest(processor: str) -> str:
    """Return the name of the folder for machine code made by exactly these tools for a processor."""
    tools = numba.__version__, llvm_version, sys.implementation.cache_tag, llvm.get_process_triple(), processor
    digest = hashlib.sha256(" ".join(map(str, tools)).encode())
    for source in ("kernels.py", "parts.py"):  # the way in which kernels are compiled
        digest.update(Path(__file__).with_name(source).read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_folder() -> Path:
    """Folder in which kernels are kept that this machine has compiled."""
    name, features = config.CPU_NAME, config.CPU_FEATURES  # type: ignore[attr-defined]
    if name is None:
        name = llvm.get_host_cpu_name()
    if features is None:
        features = llvm.get_host_cpu_features().flatten()
    below = Path("kernels", toolchain_digest(f"{name} {features}"))
    named, home = os.environ.get("RIFTBERG_CACHE"), user_cache_path("riftberg")
    doubts: list[str] = []
    folder = _usable([*([Path(named)] if named else []), home], below, doubts)
    if doubts and multiprocessing.parent_process() is None:  # workers say nothing: who started them has said it
        from riftberg.system.process import say

        say(
            f"Notice: machine code is not taken from {'; '.join(doubts)}: whoever can write there could run programs as you. "
            f"It is kept in {folder} instead. To use yours, take the right to write from others (chmod -R go-w)"
        )
    return folder


def _usable(bases: Sequence[Path], below: Path, doubts: list[str]) -> Path:
    """Return the folder below the first base that can be trusted and written, else a passing one; note why others were refused.

    A passing one serves in read-only places, on full disks and for users without a home, with what is kept there already.
    """
    trusted = None
    for folder in (base / below for base in bases):
        try:
            if not folder.is_absolute() and folder.parts[:1] == ("~",):
                raise OSError("no home")
            for place in reversed((folder, *folder.parents)):
                if not place.is_dir():
                    place.mkdir(mode=0o755, exist_ok=True)
            real = folder.resolve()  # what was judged is used: a link could be turned meanwhile
            if doubt := _doubt(real):
                doubts.append(doubt)
                continue
            trusted = real
            with tempfile.TemporaryFile(dir=real) as file:
                file.write(b"riftberg")
            return real
        except OSError:
            break
    passing = Path(tempfile.mkdtemp(prefix="riftberg-kernels-"))
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    if trusted is not None:
        with contextlib.suppress(OSError, shutil.Error):
            shutil.copytree(trusted, passing, dirs_exist_ok=True)
    return passing


def as_closed(about: os.stat_result, like: os.stat_result) -> bool:
    """Whether a file or folder is root's, the user's own or its like's owner's, and is not open to more people than its like."""
    user = getattr(os, "geteuid", int)()
    return about.st_uid in (user, 0, like.st_uid) and not about.st_mode & ~like.st_mode & 0o022


def _doubt(folder: Path) -> str:
    """Return why others than the user and root can put files into a folder without links in its path; empty if they cannot."""
    for place in (folder, *folder.parents) if os.name == "posix" else ():
        about = place.stat()
        if about.st_uid not in (os.geteuid(), 0):
            return f"{folder} ({place} belongs to another user)"
        # In a sticky folder nobody puts something in the place of what is another's.
        if about.st_mode & 0o022 and (place == folder or not about.st_mode & stat.S_ISVTX):
            return f"{folder} (others may write to {place})"
    return ""


@cache
def shipped_folder() -> Path | None:
    """Folder of machine code that came with the wheel, if it is of these sources and tools and this processor can run it."""
    level, needed = LEVELS.get(platform.machine().lower(), ("", ()))
    if not level or not SHIPPED.is_dir() or config.CPU_NAME is not None:  # type: ignore[attr-defined]
        return None
    folder = SHIPPED / toolchain_digest(f"{level} ")
    if not folder.is_dir() or not all(as_closed(one.stat(), SHIPPED.parent.stat()) for one in (SHIPPED, folder)):
        return None
    has = llvm.get_host_cpu_features()
    return folder if all(has.get(feature, False) for feature in needed) else None


def code_folders() -> list[Path]:
    """Folders of machine code, in the order in which they are looked through; what is new is kept in the last."""
    shipped = shipped_folder()
    return [*([shipped] if shipped else []), cache_folder()]


def is_warm() -> bool:
    """Whether there is machine code of these sources, kept by an earlier run or brought by the wheel."""
    return any(next(folder.glob(f"*{ENDING}"), None) for folder in code_folders())


def kernel(function: _F) -> _F:
    """Compile ``function`` on first call and keep the machine code."""
    return _compiled(function)


def borrower(function: _F) -> _F:
    """Compile a kernel that makes no arrays, and calls nothing that does: it borrows those of its caller.

    Numba then counts no references, which is a large part of the code of a kernel of the whole state. It refuses to compile
    a borrower that makes an array.
    """
    return _compiled(function, _nrt=False)


def stage(function: _F) -> _F:
    """Compile ``function`` as a part of the one kernel that calls it.

    For functions that take the whole state and are called in one place: as kernels of their own they would each unpack
    fifty arrays, get a wrapper for Python and be optimised twice, which made up half of the time of the first compile.
    Called from Python (in tests) a stage is compiled like any kernel. Not for the loops that must vectorise: inlined
    by numba, the laws that they call are not yet inlined by LLVM when it looks for loops to vectorise.
    """
    return _compiled(function, inline="always")


def plain(function: _F) -> _F:
    """Return the Python function that a kernel was compiled from, for a kernel that returns a named tuple."""
    python: _F = getattr(function, "py_func", function)  # uncompiled with NUMBA_DISABLE_JIT
    return python


def _compiled(function: _F, **options: Any) -> _F:
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    # Without the last option each kernel is compiled for C, too.
    wanted = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True, **options}
    in_parts = numba.__version__.startswith(KNOWN_NUMBA)
    compiled = _in_parts(function, wanted) if in_parts else _whole(function, wanted)
    # Ours stands in for numba's cache, whose files go by times and paths, and which two processes could mix up.
    compiled._cache = KernelCache(function, code_folders, linked=not in_parts)
    return cast("_F", compiled)


def _in_parts(function: _F, options: dict[str, Any]) -> Any:
    from riftberg.compiled.parts import Kernel, TupleKernel

    asked = {str(kind) for name, kind in function.__annotations__.items() if name != "return"}
    kind = Kernel if asked <= PLAIN else TupleKernel
    return kind(function, targetoptions={"nopython": True, "boundscheck": None, **options})


def _whole(function: _F, options: dict[str, Any]) -> Any:
    """Compile as numba does it, each function with code of its own."""
    decorate: Any = numba.njit  # its types do not know all options
    return decorate(**{name: value for name, value in options.items() if name != "_nrt"})(function)
