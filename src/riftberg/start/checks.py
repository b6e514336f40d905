"""What a model is made of agrees: berg, forcing, parameters and date of time zero."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any, Final

import numpy as np

from riftberg.bergs.iceberg import Iceberg
from riftberg.config.values import native, number
from riftberg.constants import SECONDS_PER_DAY
from riftberg.engines.common.run_state import RunState
from riftberg.errors import InputError
from riftberg.life.coming import coming
from riftberg.ocean.forcing import Forcing
from riftberg.ocean.needs import find_missing_water
from riftberg.parameters import Parameters
from riftberg.system.input_files import value_shown

DEFAULT_START: Final = datetime(2020, 12, 9, 13)
"""Date of time zero where neither the model nor its forcing has one."""


def check_arguments(berg: object, forcing: object, parameters: object) -> None:
    """Refuse arguments that are no berg, no forcing and no parameters: they are easily given in another order."""
    good = {
        "berg": (isinstance(berg, Iceberg), "an Iceberg, for example Iceberg.rectangle(...)"),
        "forcing": (
            isinstance(forcing, Forcing),
            "a forcing, for example Forcing.uniform(current=(0.2, 0.0))",
        ),
        "parameters": (isinstance(parameters, Parameters), "Parameters(...), or A68A_2022.changed(...)"),
    }
    for (name, (fits, expected)), value in zip(good.items(), (berg, forcing, parameters), strict=True):
        if not fits:
            raise InputError(f"{value_shown(value)} is no {name}", where=f"Model, {name}", remedy=f"Give {expected}")


def time_zero(forcing: Forcing, start: datetime | None) -> datetime:
    """Return the date of time zero: as given, or that from which the forcing counts."""
    forcing_start = forcing.start
    if start is not None and forcing_start is not None and forcing_start != start:
        raise InputError(
            f"the forcing counts its time from {forcing_start}, the model from {start}",
            where="start",
            remedy=f"Give both the same start, such as Forcing.from_dataset(ds, start='{start:%Y-%m-%d %H:%M}')",
        )
    return start or forcing_start or DEFAULT_START


def check_coordinates(berg: Iceberg, forcing: Forcing, p: Parameters) -> None:
    """Refuse a berg, a grid and parameters that do not agree whether positions are degrees or metres."""
    units_in_degrees = {"the berg": berg.latlon}
    if forcing.grid is not None:
        units_in_degrees["the grid of the forcing"] = forcing.grid.arrays.latlon
    if forcing.latlon is not None:
        units_in_degrees["the forcing"] = forcing.latlon
    for who, latlon in units_in_degrees.items():
        if latlon != p.earth.latlon:
            actual, expected = ("degrees", "metres") if latlon else ("metres", "degrees")
            raise InputError(
                f"positions of {who} are {actual}, those of the parameters {expected}",
                where=f"earth.latlon = {p.earth.latlon}",
                remedy=f"Set earth.latlon = {latlon}, or make {who} in {expected}",
            )
    if forcing.grid is not None and forcing.grid.arrays.period not in (0.0, p.earth.period):
        period = forcing.grid.arrays.period
        raise InputError(
            f"the grid of the forcing repeats after {period:g}, and earth.period is {p.earth.period:g}",
            where="earth.period",
            remedy=f"Set earth.period = {period:g}: bonds and contact go across the seam of the grid by it",
        )


def check_balance(forcing: Forcing, p: Parameters) -> None:
    """Refuse a current that is balanced for a Coriolis parameter other than the run's."""
    if forcing.latlon is None:
        return
    forcing_latitude = forcing.latitude
    plane = p.earth.f_plane or not p.earth.latlon
    run_latitude = p.earth.reference_latitude if plane else None
    if forcing_latitude != run_latitude:
        words = ["that of each place" if at is None else f"{at:g} degrees" for at in (forcing_latitude, run_latitude)]
        raise InputError(
            f"the forcing is balanced for the latitude {words[0]}, the parameters have {words[1]}",
            where="earth.reference_latitude" if plane else "forcing, latitude",
            remedy="Give the forcing latitude=earth.reference_latitude on an f-plane or in metres, and no latitude otherwise",
        )


def check_coverage(run: RunState, steps: int) -> None:
    """Raise `ForcingError` unless the forcing covers the bergs, of now and to come, for some steps from now."""
    if run.forcing.grid is not None and run.step_number == 0:
        run.forcing.grid.locate(run.elements)
    end = run.time + steps * run.parameters.time_step
    run.forcing.check(run.elements, run.time, end)
    times, later = coming(run.remembered)
    if (born := times <= end).any():
        late = later.taken(np.flatnonzero(born))
        if run.forcing.grid is not None:
            run.forcing.grid.locate(late)
        run.forcing.check(late, run.time, end)


def check_step_count(steps: Any) -> int:
    """Return a number of long steps, or refuse it."""
    steps = native(steps)
    if isinstance(steps, bool) or not isinstance(steps, int | float) or int(steps) != steps or steps < 1:
        raise InputError(f"{steps!r} steps", where="Model.run", remedy="Give a whole number from 1")
    return int(steps)


def check_length(days: float | str) -> float:
    """Return the length of a run in seconds, or refuse it."""
    length = number(days, "day", where="days")
    if not math.isfinite(length) or length <= 0.0:
        raise InputError(f"{length:g} days", where="Model.run", remedy="Give a finite number above 0")
    return length * SECONDS_PER_DAY


def whole_steps(seconds: float, step: float) -> int:
    """Return the number of steps (s) in a run, to the nearest one: 0.1 days are no exact multiple of any."""
    count = round(seconds / step)
    if count < 1:
        raise InputError(
            f"{seconds / SECONDS_PER_DAY:g} days are less than one long step of {step:g} s",
            where="Model.run",
            remedy="Run longer",
        )
    return count


def check_water(forcing: Forcing, p: Parameters) -> None:
    """Refuse melt without a temperature, or without a salinity where the law of the base needs one.

    Runs with the reference's numerics take the fields of their driver.
    """
    missing = {} if p.quirks.zero_start else find_missing_water(p, forcing.provides)
    if missing:
        fields = " and ".join(missing.values())
        raise InputError(
            f"bergs are to melt, but there is no {' and no '.join(missing)} of the sea",
            where=f"forcing: {forcing.describe()}",
            remedy=f"Give files with {fields}, or numbers: {' and '.join(f'melt.{name}' for name in missing)}; "
            "or set melt.enabled = false",
        )
