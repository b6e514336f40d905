"""Ctrl-C and requests to terminate, held back until the work at hand has come to an end that can be gone on from.

A signal that meets a long step in its middle would leave a state of which half has moved. It is noted instead, and comes
into force where the outermost `held` block ends, or where a loop asks (`Hold.requested`). A second one comes into force
at once.

Python gives signals to the main thread only, so in other threads there is nothing to hold back.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Final

SIGNALS: Final = (signal.SIGINT, *(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)))
"""Ctrl-C, what batch systems send before they kill, and what comes when a terminal is closed or a connection drops."""

AGAIN: Final = 1.0
"""Seconds after which a Ctrl-C that a library has lost comes again."""


class Hold:
    """Whether a signal waits."""

    def __init__(self) -> None:
        self.requested = 0
        self._before: dict[int, Any] = {}
        self._then: Callable[[], None] | None = None

    def take(self) -> None:
        """Take over the signals; a program that ignores them (``nohup``), or handles them itself, goes on doing so."""
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if handler in (signal.SIG_DFL, signal.default_int_handler) or _insists(handler):
                self._before[number] = handler
                signal.signal(number, self._note)

    def then(self, action: Callable[[], None]) -> None:
        """Name what is to be done as soon as a signal comes: something short, such as making a file."""
        self._then = action

    def give_back(self) -> None:
        """Hand the signals back to whom they belonged."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def check(self) -> None:
        """Let the signal that came take effect."""
        if self.requested == signal.SIGINT:
            raise KeyboardInterrupt
        if self.requested:
            raise SystemExit(128 + self.requested)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = number
        if self._then is not None:
            self._then()
        say("Stopping after this step; press Ctrl-C again to stop at once.")


class _Insistence:
    """A Ctrl-C that comes again every second until the block that it is to end has ended."""

    def __init__(self) -> None:
        self.came = False
        self._over = False
        self._ended = threading.Event()
        self._sending = threading.Lock()

    def handle(self, number: int, frame: FrameType | None) -> None:
        if self._over:
            return
        if not self.came:
            self.came = True
            threading.Thread(target=self._again, daemon=True).start()
        raise KeyboardInterrupt

    def _again(self) -> None:
        while not self._ended.wait(AGAIN):
            with self._sending:
                if not self._over:
                    _thread.interrupt_main(signal.SIGINT)

    def end(self) -> None:
        """Send no more; what is on its way is not heard."""
        self._over = True
        self._ended.set()
        with self._sending:
            pass


def _insists(handler: Any) -> bool:
    return isinstance(getattr(handler, "__self__", None), _Insistence)


@contextmanager
def insisting() -> Iterator[None]:
    """Let one Ctrl-C end this block, also where a library loses it.

    The compiled parts of netCDF4 throw about one in a hundred away, and those of matplotlib make errors of their own of
    them ("Invalid bounding box"). So the interrupt comes again until the block has ended, and any error that follows it
    counts as the interrupt.
    """
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    insistence = _Insistence()
    signal.signal(signal.SIGINT, insistence.handle)
    try:
        yield
    except Exception as error:
        if insistence.came:
            raise KeyboardInterrupt from error
        raise
    finally:
        insistence.end()
        signal.signal(signal.SIGINT, signal.default_int_handler)


def say(text: str) -> None:
    """Write to the error stream, from a signal handler too, which may have come in the middle of another line.

    A stream that is closed, or whose terminal or reader has gone, ends nothing: there is nobody to be told.
    """
    if sys.stderr is not None:
        with suppress(RuntimeError, OSError, ValueError):
            print(text, file=sys.stderr, flush=True)


_holding: Hold | None = None


@contextmanager
def held() -> Iterator[Hold]:
    """Hold Ctrl-C and termination back in this block; an inner block leaves that to the outer one.

    Examples
    --------
    >>> with held() as hold:
    ...     for step in range(3):
    ...         if hold.requested:
    ...             break

    """
    global _holding
    if threading.current_thread() is not threading.main_thread():
        yield Hold()
        return
    if _holding is not None:
        yield _holding
        return
    _holding = hold = Hold()
    try:
        hold.take()
        yield hold
    finally:
        _holding = None
        hold.give_back()
    hold.check()
