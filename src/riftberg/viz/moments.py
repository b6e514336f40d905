"""How pictures write moments: as dates, or in a short run as the time since its start; no two of a picture alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.constants import SECONDS_PER_DAY

Times = NDArray[np.datetime64]

SHORT: Final = 6.0 * 3600.0
"""Runs up to this length (s) are told by the time since their start: minutes of a date tell nothing of ten seconds."""

UNITS: Final = (("s", 1.0, 180.0), ("min", 60.0, 3.0 * 3600.0), ("h", 3600.0, math.inf))
"""Name, seconds, and the longest run that is told in it."""


def length_of(times: Times) -> float:
    """Return the length of a run, s."""
    return float((times[-1] - times[0]) / np.timedelta64(1, "ms")) / 1e3


def is_short(times: Times) -> bool:
    """Return whether moments of a run are told by the time since its start."""
    return length_of(times) <= SHORT


def day_text(moment: np.datetime64, *, year: bool = False, hour: bool = True) -> str:
    """Return a date such as ``17 Dec 13:00``."""
    when = moment.astype("datetime64[s]").item()
    text = f"{when.day} {when:%b}" + (f" {when.year}" if year else "")
    return text + (f" {when:%H:%M}" if hour else "")


def moment_text(times: Times, moment: np.datetime64, *, year: bool = False) -> str:
    """Return a moment of a run with these records: its date, or in a short run the time since the start."""
    if not is_short(times):
        return day_text(moment, year=year)
    name, size, _ = next(unit for unit in UNITS if length_of(times) <= unit[2])
    steps = np.diff(times) / np.timedelta64(1, "ms") / 1e3 / size
    least = float(steps.min()) if len(steps) else 1.0
    decimals = min(3, max(0, math.ceil(-math.log10(max(least, 1e-9)) - 1e-9)))
    since = float((moment - times[0]) / np.timedelta64(1, "ms")) / 1e3 / size
    return f"{since:.{decimals}f} {name}"


def moment_texts(times: Times, records: Sequence[int], *, hour: bool = True) -> list[str]:
    """Return the moments of records as texts that all differ: days, hours or seconds, as much as that needs."""
    moments = [times[record] for record in records]
    if is_short(times):
        return [moment_text(times, moment) for moment in moments]
    forms = [_without_hour, day_text, _with_second] if not hour else [day_text, _with_second]
    tried = [[form(moment) for moment in moments] for form in forms]
    return next((texts for texts in tried if len(set(texts)) == len(set(moments))), tried[-1])


def _without_hour(moment: np.datetime64) -> str:
    return day_text(moment, hour=False)


def _with_second(moment: np.datetime64) -> str:
    when = moment.astype("datetime64[s]").item()
    return f"{when.day} {when:%b %H:%M:%S}"


def span_text(times: Times) -> str:
    """Return from when to when a run goes, or how long it is."""
    if is_short(times):
        return f"{moment_text(times, times[-1])} long"
    begin, end = (day_text(times[k], year=True, hour=length_of(times) < 2.0 * SECONDS_PER_DAY) for k in (0, -1))
    return f"{begin} to {end}"
