"""KID's calendar of 30-day months."""

from __future__ import annotations

import pytest

from riftberg.kid.parameters import Clock

DAY = 86_400.0
CLOCK = Clock(1800.0, 100, 0.0)


@pytest.mark.parametrize(
    ("seconds", "date"),
    [
        (0.0, (1, 1, 1, 0, 0, 0)),
        (29 * DAY + 3661.0, (1, 1, 30, 1, 1, 1)),
        (30 * DAY, (1, 2, 1, 0, 0, 0)),
        (360 * DAY - 1, (1, 12, 30, 23, 59, 59)),
        (360 * DAY, (2, 1, 1, 0, 0, 0)),
        (6 * DAY + 5 * 3600, (1, 1, 7, 5, 0, 0)),
    ],
)
def test_date(seconds: float, date: tuple[int, ...]) -> None:
    assert tuple(CLOCK.date(seconds)) == date
    assert tuple(Clock(1800.0, 100, 3 * DAY).date(seconds - 3 * DAY)) == date


def test_year_day_counts_31_days_for_every_month() -> None:
    """Quirk T2: the day of the year jumps by one at the end of a 30-day month."""
    assert CLOCK.date(29 * DAY + DAY / 2).year_day() == 29.5
    assert CLOCK.date(30 * DAY).year_day() == 31.0
