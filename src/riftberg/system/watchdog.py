"""Files whose opening never ends: damaged bytes can send the HDF5 library round in a circle for ever.

Nothing stops a C library in mid-call, no signal and no other thread. So a clock runs beside each opening of a file. When
it has run out, a program is warned in its log, and the command line gives up in one sentence.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

_LOG = logging.getLogger(__name__)

STUCK_AFTER: Final = 60.0
"""Seconds within which a file on a disk has opened; only its header is read."""


def _warn(path: str) -> None:
    _LOG.warning("%s: %s", path, advice())


_action: list[Callable[[str], None]] = [_warn]


def advice() -> str:
    """Return what is wrong with a file that does not open, and what helps."""
    return f"has not opened within {STUCK_AFTER:.0f} seconds, as if damaged. Copy or fetch the file again"


@contextmanager
def when_stuck(action: Callable[[str], None]) -> Iterator[None]:
    """Name what is done when a file does not open within this block; it is called in a thread of its own, with the path."""
    before, _action[0] = _action[0], action
    try:
        yield
    finally:
        _action[0] = before


@contextmanager
def opening(path: object) -> Iterator[None]:
    """Watch a block that opens a file."""
    clock = threading.Timer(STUCK_AFTER, lambda: _action[0](str(path)))
    clock.daemon = True
    clock.start()
    try:
        yield
    finally:
        clock.cancel()
