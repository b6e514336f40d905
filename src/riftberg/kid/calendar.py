"""The clock of KID's stand-alone driver: a calendar with months of 30 days from the year 1 (dynamics, section 10.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

MONTH: Final = 30 * 86_400
"""Length of a month, s."""

YEAR: Final = 12 * MONTH
"""Length of a year, s."""

LATE_START: Final = {355: 6 * 86_400 + 5 * 3600}
"""Start index of the A68 data -> start of the run after 0001-01-01 00:00, s (files, section 8.7)."""


class Date(NamedTuple):
    """A date of the 30-day calendar; year, month and day count from 1."""

    year: int
    month: int
    day: int
    hour: int
    minute: int
    second: float

    def year_day(self) -> float:
        """Return KID's day of the year, which counts 31 days for every month (files, section 0.3, quirk T2)."""
        hours = self.hour + (self.minute + self.second / 60.0) / 60.0
        return (self.month - 1) * 31 + (self.day - 1) + hours / 24.0

    def seconds_of_month(self) -> float:
        """Return 86400 day + seconds of the day, by which trajectories are sampled (dynamics, section 12)."""
        return 86_400 * self.day + 3600 * self.hour + 60 * self.minute + self.second

    def __str__(self) -> str:
        """Return the date as text."""
        return f"{self.year:04d}-{self.month:02d}-{self.day:02d} {self.hour:02d}:{self.minute:02d}:{self.second:02.0f}"


def date_after(seconds: float) -> Date:
    """Return the date that many seconds after 0001-01-01 00:00."""
    year, rest = divmod(seconds, YEAR)
    month, rest = divmod(rest, MONTH)
    day, rest = divmod(rest, 86_400)
    hour, rest = divmod(rest, 3600)
    minute, second = divmod(rest, 60)
    return Date(int(year) + 1, int(month) + 1, int(day) + 1, int(hour), int(minute), second)


def is_sampled(date: Date, hours: float) -> bool:
    """Whether a step that starts at a date gives a record every so many hours; -1 means every step."""
    return hours == -1.0 or date.seconds_of_month() % (3600.0 * hours) == 0.0


@dataclass(frozen=True)
class Clock:
    """Length of the run and its calendar."""

    dt: float  # Long step, s
    steps: int  # Number of long steps
    offset: float  # Start of the run after 0001-01-01 00:00, s

    def date(self, time: float) -> Date:
        """Return the date at a time (s) after the start of the run."""
        return date_after(self.offset + time)
