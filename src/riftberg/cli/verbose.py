"""``--verbose``: what the package logs under the name ``riftberg``, on the error stream; every command takes it."""

from __future__ import annotations

import functools
import inspect
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

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
