"""What the person at the terminal sees when something is wrong: one clear message, and a code for scripts."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from typing import Final, ParamSpec, TypeVar

import typer

from riftberg.errors import RiftbergError
from riftberg.system.atomic_files import refusal
from riftberg.system.process import advice, insisting, when_stuck
from riftberg.system.process import say as say

P = ParamSpec("P")
R = TypeVar("R")

EXIT_ERROR: Final = 2
EXIT_INTERRUPTED: Final = 130


def reported(command: Callable[P, R]) -> Callable[P, R]:
    """Turn errors that Riftberg raises on purpose, and what the machine refuses, into a message and exit code 2.

    An interrupt has the code 130.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with insisting(), when_stuck(_give_up):
                return command(*args, **kwargs)
        except RiftbergError as error:
            say(f"Error: {error}")
            raise typer.Exit(EXIT_ERROR) from error
        except OSError as error:
            say(f"Error: {_refused(error)}")
            raise typer.Exit(EXIT_ERROR) from error
        except MemoryError as error:
            say(
                "Error: this needs more memory than there is (or than ulimit -v allows). "
                "Give larger elements (berg.radius), shorter or fewer records, or smaller files"
            )
            raise typer.Exit(EXIT_ERROR) from error
        except KeyboardInterrupt as error:
            say("Interrupted.")
            raise typer.Exit(EXIT_INTERRUPTED) from error

    return wrapped


def _give_up(path: str) -> None:
    """End the process, whose main thread will never come back from the library that opens this file."""
    say(f"Error: {path}: {advice()}")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(EXIT_ERROR)


def _refused(error: OSError) -> str:
    """Say what the machine refused, and for which file."""
    place = f"{error.filename}: " if error.filename is not None else ""
    return f"{place}{refusal(error)}. Name a place that can be used, with room on its disk"


def announce_compilation(quiet: bool = False) -> None:
    """Say beforehand that the first step takes long where nothing has been compiled yet."""
    from riftberg.compiled.kernels import is_warm

    if not quiet and not is_warm():
        say("First run with this version: compiling takes about a minute on a free core, once.")
