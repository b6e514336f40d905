"""Bergs of one element that come into being during a run, each at its date (`riftberg.bergs.iceberg.Iceberg.cloud`).

They are part of the memory of a run, so a restart file holds them: a row for each, with the time of its birth (s) and
the variables of its element.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.config.units import count_text, minute_text
from riftberg.errors import InputError
from riftberg.state import ELEMENT_VARIABLES, Elements, Floats, new_elements

COMING: Final = "coming_bergs"
"""Name among what a run remembers."""


def split_by_date(
    elements: Elements, dates: tuple[datetime, ...], start: datetime, bergs: tuple[tuple[str, int], ...]
) -> tuple[Elements, tuple[tuple[str, int], ...], dict[str, Floats]]:
    """Return the bergs that exist at the start, with their names, and the rows of the others for the memory of a run.

    Raises
    ------
    InputError
        If none exists at the start.
    """
    seconds = np.array([(date - start).total_seconds() for date in dates])
    later = seconds > 0.0
    if not later.any():
        return elements, bergs, {}
    if later.all():
        raise InputError(
            f"no berg is there at the start, {minute_text(start.isoformat())}: the first comes at "
            f"{minute_text(min(dates).isoformat())}",
            where="dates", remedy="Start the run with the first date, or give an earlier one",
        )  # fmt: skip
    rows = np.column_stack([getattr(elements, v.name)[later].astype(np.float64) for v in ELEMENT_VARIABLES])
    names = (
        tuple(name for name, present in zip(bergs, ~later, strict=True) if present) if len(bergs) == later.size else ()
    )
    present = elements.taken(np.flatnonzero(~later))
    present.body.id[:] = present.body.berg[:] = np.arange(1, present.size + 1)
    return present, names, {COMING: np.column_stack([seconds[later], rows])}


def coming(remembered: Mapping[str, Floats]) -> tuple[Floats, Elements]:
    """Return the bergs to come, with the times of their births (s)."""
    rows = remembered.get(COMING, np.zeros((0, 1 + len(ELEMENT_VARIABLES))))
    elements = new_elements(len(rows))
    for k, v in enumerate(ELEMENT_VARIABLES, start=1):
        getattr(elements, v.name)[:] = rows[:, k]
    return rows[:, 0], elements


def bear(model: Any) -> None:
    """Add the bergs whose time has come; where bergs act on each other, one waits until its place is free."""
    if COMING not in model.remembered:
        return
    times, elements = coming(model.remembered)
    due = np.flatnonzero(times <= model.time + 1e-6)
    if not due.size:
        return
    if model.parameters.stepping.interactions:
        due = _select_free(model, elements, due)
    if due.size:
        model.append(elements.taken(due))
        left = np.delete(model.remembered[COMING], due, axis=0)
        rest = {name: value for name, value in model.remembered.items() if name != COMING}
        model.remembered = {**rest, COMING: left} if len(left) else rest


def _select_free(model: Any, elements: Elements, due: np.ndarray) -> np.ndarray:
    """Return which of the elements find their position free."""
    earth, el = model.parameters.earth, model.elements
    metric = Metric(earth.latlon, earth.radius, earth.period)
    lon, lat = np.append(el.lon, elements.lon[due]), np.append(el.lat, elements.lat[due])
    reach = np.append(*(0.5 * np.hypot(e.length, e.width) for e in (el, elements.taken(due))))
    stands = np.arange(reach.size) < el.size
    for n in range(el.size, reach.size):
        distance = np.hypot(*separations(metric, lon[stands], lat[stands], lon[n], lat[n]))
        stands[n] = bool((distance > reach[stands] + reach[n]).all())
    return np.asarray(due[stands[el.size :]])


def coming_text(remembered: Mapping[str, Floats], start: datetime) -> str:
    """Return how many bergs are to come, and until when; empty if none."""
    times = remembered.get(COMING, np.zeros((0, 1)))[:, 0]
    if not times.size:
        return ""
    last = np.datetime64(start, "s") + np.timedelta64(round(float(times.max())), "s")
    return f"{count_text(times.size, 'more berg')} until {minute_text(str(last))}"
