"""Digest of all sources that decide on the machine code of a module's kernels.

Numba freezes what a kernel reads into its code: laws that it calls, constants, fields of named tuples. All of them come from
the module itself or from modules that it imports, so the digest covers these, and what they import in turn. A changed source
then asks for new code of its own kernels and of those that can call them, and of no others.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

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
