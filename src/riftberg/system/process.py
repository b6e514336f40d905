"""Resources of the whole process: settings shared by its threads, standard streams, files that do not open, signals.

Settings: Python's filters of warnings and the settings of dask are put back at the end of a block to the state at its
beginning. Where two blocks overlap, the second one puts back the settings of the first one, for good.

Streams: standard streams may be closed, or their terminal or reader may go; nothing ends for want of a reader.

Files: damaged bytes can send the HDF5 library into an endless loop, and a server may never answer. So files are opened in a
thread of their own, for which the others wait: as long as they like, and no longer than a minute (a server: five).

Signals: Ctrl-C and requests to terminate are held back until the work under way has come to an end that can be gone on from. A
signal that meets a long step in its middle would leave a state of which half has moved. It is noted instead, and comes into
force where the outermost `held` block ends, or where a loop asks (`Hold.requested`). A second one comes into force at once.
Python gives signals to the main thread only, so in other threads there is nothing to hold back.
"""

from __future__ import annotations

import _thread
import atexit
import errno
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from types import FrameType
from typing import Any, Final, TypeVar, cast

from riftberg.errors import visible, without_secrets
from riftberg.system.input_files import is_address

SETTINGS: Final = threading.RLock()
"""Held by whoever changes such a setting for a while."""


@contextmanager
def own_filters() -> Iterator[None]:
    """Let a block set filters of warnings, which end with it.

    Other libraries' `warnings.catch_warnings` may begin or end in other threads meanwhile and put another list in place of
    the one that the block began with; its own filters are then taken out of both.
    """
    with SETTINGS:
        active, previous = cast("list[Any]", warnings.filters), list(warnings.filters)
        try:
            yield
        finally:
            # By identity: two filters may be equal, and one of them belong to somebody else.
            added = [entry for entry in active if all(entry is not entry_before for entry_before in previous)]
            if warnings.filters is active:
                active[:] = previous
            else:
                for filters in (active, cast("list[Any]", warnings.filters)):
                    filters[:] = [entry for entry in filters if entry not in added]
            # Python remembers which warnings it has shown, until it is said that the filters have changed.
            getattr(warnings, "_filters_mutated", lambda: None)()


_GONE: Final = (errno.EPIPE, errno.EIO)
"""What the system says when the reader of a pipe, or a terminal, has gone."""


class GuardedStream:
    """Stream whose listener may go; later output goes nowhere.

    Parameters
    ----------
    stream : text file
        Standard output or the error stream.
    is_report : bool
        The output only reports the work, so that no failure counts.
    """

    def __init__(self, stream: Any, *, is_report: bool) -> None:
        self._stream, self._is_report = stream, is_report

    def write(self, text: str) -> int:
        """Write a text."""
        try:
            self._stream.write(text)
        except OSError as error:
            self._failed(error)
        return len(text)

    def flush(self) -> None:
        """Write the waiting text."""
        try:
            self._stream.flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        """Let the file go nowhere where its listener has gone; else the error counts for results alone."""
        if error.errno in _GONE:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            # In place of the stream's own file, so that writers that know only its number lose their listener too.
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
            self._stream.flush()
        elif not self._is_report:
            raise error

    def __getattr__(self, name: str) -> Any:
        """Return whatever else the stream has."""
        return getattr(self._stream, name)


def make_streams_last() -> None:
    """Open streams that were closed at the start, so that no file of results takes their place, and let listeners go."""
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
            setattr(sys, name, GuardedStream(stream, is_report=number == 2))


STUCK_AFTER: Final = 60.0
"""Seconds within which a file on a disk has opened; only its header is read."""

SILENT_AFTER: Final = 300.0
"""Seconds within which a server has answered."""

GRACE: Final = 1.0
"""Seconds for which an interrupt waits for the file that is being opened."""

T = TypeVar("T")


class _Opener:
    """A thread that opens files one after another, and the file that it has not come back from."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]]]
        self._process = 0
        self._waiting: Future[Any] | None = None
        self._path = ""
        self._code = 0

    def open(self, path: str, call: Callable[[], T]) -> T:
        """Return the result of a call, or give it up."""
        limit, fault = STUCK_AFTER, "has not opened within {:.0f} seconds, as if damaged. Copy or fetch the file again"
        if is_address(path):
            limit, fault = SILENT_AFTER, "has not answered within {:.0f} seconds"
            path = without_secrets(path)
        if self._stuck():
            raise OSError(
                errno.EBUSY, f"cannot be opened, because {self._path} never opened. Begin anew without that file", path
            )
        if self._process != os.getpid():  # a child that was forked has not got the thread
            self._process, self._calls = os.getpid(), SimpleQueue()
            threading.Thread(target=self._work, daemon=True, name="opens files").start()
        opened: Future[T] = Future()
        self._waiting, self._path = opened, path
        self._calls.put((opened, call))
        try:
            _wait(opened, limit)
        except TimeoutError:
            self._code = 2
            raise TimeoutError(errno.ETIMEDOUT, fault.format(limit), path) from None
        except BaseException:
            with suppress(KeyboardInterrupt, TimeoutError):  # a file that opens is not left half open
                opened.exception(GRACE)
            raise
        self._waiting = None
        return opened.result()

    def _work(self) -> None:
        while True:
            opened, call = self._calls.get()
            try:
                opened.set_result(call())
            except BaseException as error:
                opened.set_exception(error)
            del opened, call  # nothing that was opened stays open for this thread

    def _stuck(self) -> bool:
        return self._waiting is not None and not self._waiting.done()

    def leave(self) -> None:
        """End a process whose library is still in its loop: taken down in the middle of it, it would crash."""
        if self._stuck():
            for stream in (sys.stdout, sys.stderr):
                with suppress(AttributeError, OSError, ValueError):
                    stream.flush()
            os._exit(self._code or 128 + signal.SIGINT)


def _wait(opened: Future[Any], limit: float) -> None:
    """Wait for a file, ``limit`` s at most, in pieces of a second: an interrupt that comes just as one begins is then heard."""
    end = time.monotonic() + limit
    while True:
        try:
            opened.exception(max(min(AGAIN, end - time.monotonic()), 0.0))
        except TimeoutError:
            if time.monotonic() >= end:
                raise
        else:
            return


_OPENER: Final = _Opener()
atexit.register(_OPENER.leave)


def interruptible(path: object, call: Callable[[], T]) -> T:
    """Return the result of a call that opens a file; Ctrl-C, or too long a time, ends it.

    Damaged bytes can send the HDF5 library into an endless loop, and nothing stops a C library in mid-call. So another thread
    makes the call, and this one waits. Whoever calls holds the lock of the library (`riftberg.system.netcdf_lock`).
    """
    return _OPENER.open(str(path), call)


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
            if handler in (signal.SIG_DFL, signal.default_int_handler) or isinstance(
                getattr(handler, "__self__", None), _Insistence
            ):
                self._before[number] = handler
                signal.signal(number, self._note)

    def then(self, action: Callable[[], None]) -> None:
        """Set the action to take as soon as a signal comes: something short, such as making a file."""
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
        """Send no more; interrupts on their way are not heard."""
        self._over = True
        self._ended.set()
        with self._sending:
            pass


@contextmanager
def insisting() -> Iterator[None]:
    """Let one Ctrl-C end this block, also where a library loses it.

    The compiled parts of netCDF4 throw about one in a hundred away, and matplotlib turns them into errors of
    its own ("Invalid bounding box"). So the interrupt comes again until the block has ended, and any error that follows it
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

    A stream that is closed, or whose terminal or reader has gone, ends nothing: there is no reader.
    """
    if sys.stderr is not None:
        with suppress(RuntimeError, OSError, ValueError):
            print(visible(without_secrets(text)), file=sys.stderr, flush=True)


_holding: Hold | None = None


def in_charge() -> bool:
    """Whether a call comes straight from a program: not from a thread, a worker, or a block that already minds signals."""
    alone = threading.current_thread() is threading.main_thread() and multiprocessing.parent_process() is None
    return alone and _holding is None


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
