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
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import llvmlite.binding as llvm
import numba
from llvmlite import __version__ as llvm_version
from numba.core import config
from platformdirs import user_cache_path

from riftberg.compiled.cache import ENDING, KernelCache

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
"""Folder of the machine code that a wheel brings along; see `riftberg.compiled.machine_code`."""


def digest_of(processor: str) -> str:
    """Return the name of the folder for machine code made by exactly these tools for a processor; see `compiled.sources`."""
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
    base = os.environ.get("RIFTBERG_CACHE")
    home = Path(base) if base else user_cache_path("riftberg")
    return _writable(home / "kernels" / digest_of(f"{name} {features}"))


@cache
def shipped_folder() -> Path | None:
    """Folder of machine code that came with the wheel, if it is of these sources and tools and this processor can run it."""
    level, needed = LEVELS.get(platform.machine().lower(), ("", ()))
    if not level or not SHIPPED.is_dir() or config.CPU_NAME is not None:  # type: ignore[attr-defined]
        return None
    folder = SHIPPED / digest_of(f"{level} ")
    has = llvm.get_host_cpu_features()
    return folder if folder.is_dir() and all(has.get(feature, False) for feature in needed) else None


def code_folders() -> list[Path]:
    """Folders of machine code, in the order in which they are looked through; what is new is kept in the last."""
    shipped = shipped_folder()
    return [*([shipped] if shipped else []), cache_folder()]


def _writable(folder: Path) -> Path:
    """Return a folder if files can be kept in it; else a passing one: read-only places, full disks, users without a home."""
    try:
        if not folder.is_absolute() and folder.parts[:1] == ("~",):
            raise OSError("no home")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"riftberg")
        return folder
    except OSError:
        passing = Path(tempfile.mkdtemp(prefix="riftberg-kernels-"))
        atexit.register(shutil.rmtree, passing, ignore_errors=True)
        with contextlib.suppress(OSError, shutil.Error):
            shutil.copytree(folder, passing, dirs_exist_ok=True)
        return passing


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
