"""What is said before the first run, which compiles."""

from __future__ import annotations

from riftberg.cli.terminal import say

COMPILE_TIME = "about a minute on a free core"
"""About how long the first run compiles, as announced."""


def announce_compilation(quiet: bool = False) -> None:
    """Say beforehand that the first step takes long where nothing has been compiled yet."""
    from riftberg.compiled.kernels import is_warm

    if not quiet and not is_warm():
        say(f"First run with this version: compiling takes {COMPILE_TIME}, once.")
