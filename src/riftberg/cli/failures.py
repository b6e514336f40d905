"""What the person at the terminal sees when something is wrong: one clear message, and a code for scripts."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final, ParamSpec, TypeVar

import typer

from riftberg.errors import RiftbergError
from riftberg.interrupts import say as say

P = ParamSpec("P")
R = TypeVar("R")

EXIT_ERROR: Final = 2
EXIT_INTERRUPTED: Final = 130


def reported(command: Callable[P, R]) -> Callable[P, R]:
    """Turn errors that Riftberg raises on purpose, and files that cannot be used, into a message and exit code 2.

    An interrupt has the code 130.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except RiftbergError as error:
            say(f"Error: {error}")
            raise typer.Exit(EXIT_ERROR) from error
        except OSError as error:
            if error.filename is None:
                raise
            say(
                f"Error: {error.filename}: {(error.strerror or 'cannot be used').lower()}. Name a place that can be used"
            )
            raise typer.Exit(EXIT_ERROR) from error
        except KeyboardInterrupt as error:
            say("Interrupted.")
            raise typer.Exit(EXIT_INTERRUPTED) from error

    return wrapped
