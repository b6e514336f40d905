"""KID's calendar of 30-day months, and which steps are recorded."""

from __future__ import annotations

import itertools

import pytest

from riftberg.kid.parameters import Date, date_after, is_sampled

DAY = 86_400.0


@pytest.mark.parametrize(
    ("seconds", "date"),
    [
        (0.0, Date(1, 1, 1, 0, 0, 0)),
        (29 * DAY + 3661.0, Date(1, 1, 30, 1, 1, 1)),
        (30 * DAY, Date(1, 2, 1, 0, 0, 0)),
        (360 * DAY - 1, Date(1, 12, 30, 23, 59, 59)),
        (360 * DAY, Date(2, 1, 1, 0, 0, 0)),
        (6 * DAY + 5 * 3600, Date(1, 1, 7, 5, 0, 0)),
    ],
)
def test_date(seconds: float, date: Date) -> None:
    assert date_after(seconds) == date


def test_year_day_counts_31_days_for_every_month() -> None:
    """Quirk T2: the day of the year jumps by one at the end of a 30-day month."""
    assert date_after(29 * DAY + DAY / 2).year_day() == 29.5
    assert date_after(30 * DAY).year_day() == 31.0


def test_sampling_counts_from_the_month() -> None:
    """Quirk T23: 7 hours do not divide a month, so the rhythm starts anew."""
    sampled = [h for h in range(29 * 24, 32 * 24) if is_sampled(date_after(3600.0 * h), 7.0)]
    gaps = {b - a for a, b in itertools.pairwise(sampled)}
    assert gaps != {7}
    assert all((24 * date_after(3600.0 * h).day + date_after(3600.0 * h).hour) % 7 == 0 for h in sampled)


@pytest.mark.parametrize(
    ("dt", "hours", "first"),
    [
        (60.0, 1.0, [0, 3600, 7200]),
        (100.0, 0.05, [0, 900, 1800]),
        (1800.0, 1.0, [0, 3600, 7200]),
        (7.0, -1.0, [0, 7, 14]),
    ],
)
def test_sampling(dt: float, hours: float, first: list[float]) -> None:
    starts = [n * dt for n in range(200) if is_sampled(date_after(n * dt), hours)]
    assert starts[:3] == first
