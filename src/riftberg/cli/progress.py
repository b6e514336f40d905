"""How far a run is: a bar on a terminal, lines in a log; and the interrupt that lets a step finish."""

from __future__ import annotations

import sys
import time as clock
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

from riftberg.cli.failures import say
from riftberg.constants import SECONDS_PER_DAY
from riftberg.interrupts import Hold

if TYPE_CHECKING:
    from riftberg.model import BareModel

REFRESH_SECONDS: Final = 0.2
LOG_SECONDS: Final = 10.0


class ProgressRecorder:
    """Recorder that shows model date, speed, fragments and broken bonds.

    Parameters
    ----------
    days : float
        Length of this run, days.
    quiet : bool, optional
        Show nothing.
    terminal : bool, optional
        Draw a bar instead of lines; by default where the error stream is a terminal.
    """

    def __init__(self, days: float, *, quiet: bool = False, terminal: bool | None = None) -> None:
        self.days, self.quiet = days, quiet
        self.terminal = sys.stderr.isatty() if terminal is None else terminal
        self._bar: Any = None
        self._task: Any = None
        self._shown = self._began = 0.0
        self._first_day = self._speed_day = 0.0

    def start(self, model: BareModel) -> None:
        """Note the time, and put up the bar."""
        self._began = self._shown = clock.monotonic()
        self._first_day = self._speed_day = model.time / SECONDS_PER_DAY
        if self.terminal and not self.quiet:
            self._put_up_bar()

    def record(self, model: BareModel) -> None:
        """Show the state where the last look is long enough ago."""
        now = clock.monotonic()
        if self._speed_day == self._first_day:
            # The first step may have compiled for a minute; it says nothing about speed.
            self._began, self._speed_day = now, model.time / SECONDS_PER_DAY
        wait = REFRESH_SECONDS if self.terminal else LOG_SECONDS
        if not self.quiet and now - self._shown >= wait:
            self._shown = now
            self._show(model)

    def finish(self, model: BareModel) -> None:
        """Show the last state and take the bar down."""
        if self.quiet:
            return
        self._show(model)
        if self._bar is not None:
            self._bar.stop()

    def _put_up_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True), auto_refresh=False)
        self._task = self._bar.add_task("", total=self.days)
        self._bar.start()

    def _show(self, model: BareModel) -> None:
        done = model.time / SECONDS_PER_DAY - self._first_day
        if self._bar is not None:
            self._bar.update(self._task, completed=done, description=self.line(model), refresh=True)
        else:
            say(f"{100.0 * done / self.days:5.1f} %  {self.line(model)}")

    def line(self, model: BareModel) -> str:
        """Return the state in one line."""
        date = model.start + timedelta(seconds=model.time)
        days, spent = model.time / SECONDS_PER_DAY - self._speed_day, clock.monotonic() - self._began
        # A run of seconds or hours is not told in seconds per day.
        rate = f"{spent / days:.3g} s per day" if self.days >= 0.5 else f"{spent:.3g} s"
        speed = rate if days > 0.0 and spent > 0.0 else "first step"
        count, broken = model.fragment_count, model.bonds_broken
        return (
            f"{date:%Y-%m-%d %H:%M}  {speed}  {count} fragment{'s' if count != 1 else ''}  "
            f"{broken} bond{'s' if broken != 1 else ''} broken"
        )


class Interrupt:
    """Recorder that ends a run between two steps after Ctrl-C or a request to terminate.

    Give it last, so that the other recorders have seen the step.
    """

    def __init__(self, hold: Hold) -> None:
        self.hold = hold

    def start(self, model: BareModel) -> None:
        """Do nothing: the signals are held already."""

    def record(self, model: BareModel) -> None:
        """End the run if this was asked for."""
        self.hold.check()

    def finish(self, model: BareModel) -> None:
        """Do nothing."""
