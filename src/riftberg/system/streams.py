"""Standard streams that may be closed, or whose terminal or reader may go: nothing ends because nobody listens."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from typing import Any, Final

_GONE: Final = (errno.EPIPE, errno.EIO)
"""What the system says when the reader of a pipe, or a terminal, has gone."""


class Stream:
    """Stream whose listener may go; what is written from then on goes nowhere.

    Parameters
    ----------
    stream : text file
        Standard output or the error stream.
    told : bool
        What is written only tells of the work, so that no failure counts.
    """

    def __init__(self, stream: Any, *, told: bool) -> None:
        self._stream, self._told = stream, told

    def write(self, text: str) -> int:
        """Write a text."""
        try:
            self._stream.write(text)
        except OSError as error:
            self._failed(error)
        return len(text)

    def flush(self) -> None:
        """Write what waits."""
        try:
            self._stream.flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        """Let the file go nowhere where its listener has gone; else the error counts for results alone."""
        if error.errno in _GONE:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
            self._stream.flush()
        elif not self._told:
            raise error

    def __getattr__(self, name: str) -> Any:
        """Return whatever else the stream has."""
        return getattr(self._stream, name)


def make_streams_last() -> None:
    """Open what was closed at the start, so that no file of results takes its place, and let listeners go."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            stream = open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115  it is open as long as the process
        with suppress(AttributeError, ValueError, OSError):  # not a stream of the system
            stream.fileno()
            setattr(sys, name, Stream(stream, told=number == 2))
