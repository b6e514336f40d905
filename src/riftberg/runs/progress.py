"""How far a run is: a bar on a terminal and in a notebook, lines in a log."""

from __future__ import annotations

import html
import sys
import time as clock
from collections.abc import Mapping
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

from riftberg.constants import SECONDS_PER_DAY
from riftberg.system.process import say

if TYPE_CHECKING:
    from riftberg.model import BareModel

REFRESH_SECONDS: Final = 0.2
LOG_SECONDS: Final = 10.0


class ProgressRecorder:
    """Recorder that shows model date, speed, fragments and broken bonds.

    ``days``: length of this run, days.
    """

    def __init__(self, days: float, *, quiet: bool = False) -> None:
        self.days, self.quiet = days, quiet
        self._notebook = in_notebook()
        self.terminal = sys.stderr.isatty() or self._notebook
        self._bar: Any = None
        self._shown = self._began = 0.0
        self._first_day = self._speed_day = 0.0

    def start(self, model: BareModel) -> None:
        """Note the time, and put up the bar."""
        self._began = self._shown = clock.monotonic()
        self._first_day = self._speed_day = model.time / SECONDS_PER_DAY
        if self.terminal and not self.quiet:
            self._bar = NotebookBar(self.days) if self._notebook else TerminalBar(self.days)

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

    def _show(self, model: BareModel) -> None:
        done = model.time / SECONDS_PER_DAY - self._first_day
        if self._bar is not None:
            self._bar.show(done, self.line(model))
        else:
            say(f"{100.0 * done / self.days:5.1f} %  {self.line(model)}")

    def line(self, model: BareModel) -> str:
        """Return the state in one line."""
        date = model.start + timedelta(seconds=model.time)
        days, spent = model.time / SECONDS_PER_DAY - self._speed_day, clock.monotonic() - self._began
        # The pace of a run of seconds or hours is not given in seconds per day.
        if days <= 0.0 or spent <= 0.0:
            speed = "first step"
        else:
            speed = f"{spent / days:.3g} s per day" if self.days >= 0.5 else f"{spent:.3g} s"
        count, broken = model.fragment_count, model.bonds_broken
        return (
            f"{date:%Y-%m-%d %H:%M}  {speed}  {count} fragment{'s' if count != 1 else ''}  "
            f"{broken} bond{'s' if broken != 1 else ''} broken"
        )


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

    def show(self, done: Mapping[int, str]) -> None:
        """Show how many members have a status."""
        failed = sum(status == "failed" for status in done.values())
        text = f"{len(done)} of {self.total} members" + (f", {failed} failed" if failed else "") + self._left(len(done))
        if self._bar is not None:
            self._bar.show(len(done), text)
        elif (now := clock.monotonic()) - self._shown >= LOG_SECONDS or len(done) == self.total:
            self._shown = now
            say(text)

    def _left(self, done: int) -> str:
        """Return how long the other members will take if they take as long as those that were done since the bar was shown."""
        now = clock.monotonic()
        began, before = self._first = self._first or (now, done)
        if done == before or done >= self.total:
            return ""
        minutes = (now - began) / (done - before) * (self.total - done) / 60.0
        return f", {minutes:.0f} min left" if minutes >= 1.5 else f", {60.0 * minutes:.0f} s left"

    def stop(self) -> None:
        """Leave the bar as it stands."""
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

    def show(self, done: float, text: str) -> None:
        """Draw what is done."""
        self._bar.update(self._task, completed=done, description=text, refresh=True)

    def stop(self) -> None:
        """Leave the bar as it stands."""
        self._bar.stop()


class NotebookBar:
    """A bar in a notebook: plain HTML that is exchanged in place, without widgets."""

    def __init__(self, total: float) -> None:
        from IPython import display

        shown: Any = display  # it has no types
        self._html, self.total = shown.HTML, total
        self._handle: Any = shown.display(shown.HTML(self._page(0.0, "")), display_id=True)

    def _page(self, done: float, text: str) -> str:
        return (
            f'<progress value="{done:g}" max="{self.total:g}" style="width:16em"></progress> '
            f"{100.0 * done / self.total:.0f} % &nbsp; {html.escape(text)}"
        )

    def show(self, done: float, text: str) -> None:
        """Exchange the bar for one that shows what is done."""
        if self._handle is not None:
            self._handle.update(self._html(self._page(done, text)))

    def stop(self) -> None:
        """Leave the bar as it stands."""
