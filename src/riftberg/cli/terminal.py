"""What the person at the terminal sees: one clear message and a code for scripts; with ``--verbose`` the log of the package."""

from __future__ import annotations

import functools
import inspect
import logging
import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, Final, ParamSpec, TypeVar

import typer

from riftberg.errors import RiftbergError
from riftberg.system.atomic_files import refusal
from riftberg.system.process import advice, insisting, when_stuck
from riftberg.system.process import say as say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

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


def console(width: int) -> Console:
    """Return where tables are printed: the terminal, or a file or pipe, which has no width of its own, as wide as given."""
    from rich.console import Console

    found = Console()
    return found if found.is_terminal else Console(width=width)


def table(title: str, columns: Iterable[str], texts: Collection[str] = ()) -> Table:
    """Return an empty table; ``texts``: columns that stand to the left, numbers stand to the right."""
    from rich.table import Table

    made = Table(title=title)
    for name in columns:
        made.add_column(name, justify="left" if name in texts else "right", no_wrap=name in texts)
    return made


Verbose = Annotated[
    int,
    typer.Option(
        "--verbose", "-v", count=True, help="Show the log; twice (-vv) to include each file that is opened or written."
    ),
]


def verbose(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that takes ``--verbose`` too."""

    @functools.wraps(command)
    def wrapped(*args: Any, verbose: int = 0, **kwargs: Any) -> Any:
        with listening(verbose):
            return command(*args, **kwargs)

    signature = inspect.signature(command, eval_str=True)
    added = inspect.Parameter("verbose", inspect.Parameter.KEYWORD_ONLY, default=0, annotation=Verbose)
    parameters = [*signature.parameters.values(), added]
    wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapped


@contextmanager
def listening(times: int) -> Iterator[None]:
    """Write the records of the package's loggers to the error stream: 1 for what happens, 2 for each file too."""
    if not times:
        yield
        return
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    logger = logging.getLogger("riftberg")
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if times == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
