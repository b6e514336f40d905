"""How far a run is: a bar on a terminal and in a notebook, lines in a log."""

from __future__ import annotations

import html
import math
import sys
import time as clock
from collections.abc import Mapping
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

from numba.core.event import TimingListener, register, unregister

from riftberg.config.units import count_text
from riftberg.constants import SECONDS_PER_DAY
from riftberg.runs.groundings import GroundTeller
from riftberg.system.process import say

if TYPE_CHECKING:
    from riftberg.model import BareModel

REFRESH_SECONDS: Final = 0.2
LOG_SECONDS: Final = 10.0

PATIENCE: Final = {True: 2.0, False: 60.0}
"""Seconds after which a script that did not ask for it shows a bar in a terminal, and between its lines elsewhere."""


class Stopwatch:
    """Recorder that measures how fast the run is.

    ``wall_seconds``: wall time from the first call to the last one, s.
    """

    def __init__(self) -> None:
        self.wall_seconds, self.steps = 0.0, 0
        self._compiling = TimingListener()  # type: ignore[no-untyped-call]
        self._began = self._after_first = clock.monotonic()
        self._time_after_first = self._time = self._compiled_first = 0.0

    def start(self, model: BareModel) -> None:
        """Start the clock."""
        self.__init__()  # type: ignore[misc]
        self._time = self._time_after_first = model.time
        register("numba:compile", self._compiling)  # type: ignore[no-untyped-call]

    def record(self, model: BareModel) -> None:
        """Note the time; the first step is kept apart, because it may compile."""
        now = clock.monotonic()
        self.steps, self._time, self.wall_seconds = self.steps + 1, model.time, now - self._began
        if self.steps == 1:
            self._after_first, self._time_after_first = now, model.time
            self._compiled_first = self._compiled

    def finish(self, model: BareModel) -> None:
        """Stop the clock."""
        self.wall_seconds = clock.monotonic() - self._began
        unregister("numba:compile", self._compiling)  # type: ignore[no-untyped-call]

    @property
    def _compiled(self) -> float:
        """Seconds of compilation so far: a crack or a landing may need code late in a run."""
        return float(self._compiling.duration) if self._compiling.done else 0.0

    @property
    def seconds_per_day(self) -> float:
        """Wall seconds per simulated day after the first step, without compilation; NaN before the second."""
        days = (self._time - self._time_after_first) / SECONDS_PER_DAY
        spent = self._began + self.wall_seconds - self._after_first - (self._compiled - self._compiled_first)
        return spent / days if days > 0.0 else math.nan


class ProgressRecorder:
    """Recorder that shows model date, speed, fragments and broken bonds, and reports at once bergs that touch the sea floor.

    ``days``: length of this run, days; ``patient``: says nothing in a run of seconds, and elsewhere than on a terminal a line a
    minute.
    """

    def __init__(self, days: float, *, quiet: bool = False, patient: bool = False) -> None:
        self.days, self.quiet, self.patient = days, quiet, patient
        self._notebook = in_notebook()
        self.terminal = sys.stderr.isatty() or self._notebook
        self._bar: Any = None
        self._told = False
        self._shown = self._first_day = 0.0
        self._watch, self._ground = Stopwatch(), GroundTeller()

    def start(self, model: BareModel) -> None:
        """Note the time, and put up the bar."""
        self._watch.start(model)
        self._ground.start(model)
        self._shown, self._first_day = clock.monotonic(), model.time / SECONDS_PER_DAY
        self._put_up(now=not self.patient)

    def _put_up(self, *, now: bool) -> None:
        """Put up the bar where there is a place for it."""
        if now and self.terminal and not self.quiet and self._bar is None:
            self._bar = NotebookBar(self.days) if self._notebook else TerminalBar(self.days)

    def record(self, model: BareModel) -> None:
        """Show the state where the last look is long enough ago."""
        now = clock.monotonic()
        self._watch.record(model)
        if self.quiet:
            return
        if not self.patient:
            self._ground.say(model)
        wait = REFRESH_SECONDS if self.terminal else LOG_SECONDS
        if self.patient and (self._bar is None or not self.terminal):
            wait = PATIENCE[self.terminal]
        if now - self._shown >= wait:
            self._put_up(now=True)
            self._shown, self._told = now, True
            self._show(model)

    def finish(self, model: BareModel) -> None:
        """Show the last state and take the bar down."""
        self._watch.finish(model)
        if self.quiet or (self.patient and not self._told):
            return
        self._show(model)
        if self._bar is not None:
            self._bar.stop()

    def _show(self, model: BareModel) -> None:
        days_done = model.time / SECONDS_PER_DAY - self._first_day
        if self._bar is not None:
            self._bar.show(days_done, self.line(model))
        else:
            say(f"{100.0 * days_done / self.days:5.1f} %  {self.line(model)}")

    def line(self, model: BareModel) -> str:
        """Return the state in one line."""
        date = model.start + timedelta(seconds=model.time)
        # A run of seconds or hours is not given in seconds per day.
        if math.isnan(self._watch.seconds_per_day):
            speed = "first step"
        else:
            speed = (
                f"{self._watch.seconds_per_day:.3g} s per day"
                if self.days >= 0.5
                else f"{self._watch.wall_seconds:.3g} s"
            )
        pieces, broken = count_text(model.fragment_count, "fragment"), count_text(model.bonds_broken, "bond")
        return f"{date:%Y-%m-%d %H:%M}  {speed}  {pieces}  {broken} broken"


class SweepBar:
    """How many members of a sweep are done: a bar on a terminal and in a notebook, lines in a log."""

    def __init__(self, total: int) -> None:
        self.total, self._shown = total, 0.0
        self._first: tuple[float, int] | None = None  # When the bar was shown first, and how many were done then
        self._bar: Any = None
        if in_notebook():
            self._bar = NotebookBar(total)
        elif sys.stderr.isatty():
            self._bar = TerminalBar(total)

    def show(self, statuses_by_member: Mapping[int, str]) -> None:
        """Show how many members have a status."""
        statuses = list(statuses_by_member.values())
        failures = "".join(f", {n} {word}" for word in ("failed", "unfinished") if (n := statuses.count(word)))
        text = f"{len(statuses_by_member)} of {self.total} members{failures}{self._left(len(statuses_by_member))}"
        if self._bar is not None:
            self._bar.show(len(statuses_by_member), text)
        elif (now := clock.monotonic()) - self._shown >= LOG_SECONDS or len(statuses_by_member) == self.total:
            self._shown = now
            say(text)

    def _left(self, completed: int) -> str:
        """Return how long the other members will take if they take as long as those that were done since the bar was shown."""
        now = clock.monotonic()
        began, completed_first = self._first = self._first or (now, completed)
        if completed == completed_first or completed >= self.total:
            return ""
        minutes = (now - began) / (completed - completed_first) * (self.total - completed) / 60.0
        return f", {minutes:.0f} min left" if minutes >= 1.5 else f", {60.0 * minutes:.0f} s left"

    def stop(self) -> None:
        """Leave the bar unchanged on the screen."""
        if self._bar is not None:
            self._bar.stop()


def in_notebook() -> bool:
    """Whether this runs in a notebook: IPython is loaded and its shell talks to a page."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return shell is not None and type(shell).__name__ not in ("TerminalInteractiveShell", "NoneType")


class TerminalBar:
    """A bar that is drawn over itself in a terminal."""

    def __init__(self, total: float) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True), auto_refresh=False)
        self._task = self._bar.add_task("", total=total)
        self._bar.start()

    def show(self, completed: float, text: str) -> None:
        """Draw the completed share."""
        self._bar.update(self._task, completed=completed, description=text, refresh=True)

    def stop(self) -> None:
        """Leave the bar unchanged on the screen."""
        self._bar.stop()


class NotebookBar:
    """A bar in a notebook: plain HTML that is exchanged in place, without widgets."""

    def __init__(self, total: float) -> None:
        from IPython import display

        display_module: Any = display  # it has no types
        self._html, self.total = display_module.HTML, total
        self._handle: Any = display_module.display(display_module.HTML(self._page(0.0, "")), display_id=True)

    def _page(self, completed: float, text: str) -> str:
        return (
            f'<progress value="{completed:g}" max="{self.total:g}" style="width:16em"></progress> '
            f"{100.0 * completed / self.total:.0f} % &nbsp; {html.escape(text)}"
        )

    def show(self, completed: float, text: str) -> None:
        """Replace the bar by one that shows the completed share."""
        if self._handle is not None:
            self._handle.update(self._html(self._page(completed, text)))

    def stop(self) -> None:
        """Leave the bar unchanged on the screen."""
