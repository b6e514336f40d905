"""External forces on the elements of a run, from what its file recorded.

The forces are those of the media table (`riftberg.stepping.forces.media`) at the recorded state and velocity, each row one force;
no law is known here by name. In runs that recorded the forces as they were applied, these are taken instead.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from riftberg.parameters import KernelParameters
from riftberg.runs.applied import force_variables
from riftberg.state import ELEMENT_VARIABLES, Elements, Floats, new_elements
from riftberg.stepping.forces import media
from riftberg.stepping.forces.implicit_velocity import apply_at_velocities
from riftberg.stepping.forces.media import allocate_surroundings, find_surroundings
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.outline import measure_outlines

_WORDS: Final = {
    "water": "ocean drag",
    "slope": "surface slope",
    "coriolis": "Coriolis",
    "air": "wind drag",
    "waves": "waves",
    "sea_floor": "sea floor",
    "sea_ice": "sea ice",
}
"""What the forces are called in tables, in the order of all tables; others go by their own name and follow."""

_ROWS: Final = {
    _WORDS.get(name, name.replace("_", " ")): media.FORCES.index(name)
    for name in (*_WORDS, *(n for n in media.FORCES if n not in _WORDS))
}

FORCES: Final = tuple(_ROWS)
"""External forces, in the order of all tables."""


def external_forces(run: xr.Dataset, record: int, p: KernelParameters) -> dict[str, Floats]:
    """Return the external forces on all elements at a record: as applied where the run recorded that, else by the table.

    Applied forces are means between records; at a record it is the mean of those before and after, about which the
    acceleration by central differences is taken too.

    Returns for each name of `FORCES` an array of shape (elements, 2): eastward and northward force, N.
    """
    if forces_recorded(run):
        sides = [applied_forces(run, k) for k in (record, record + 1) if 0 < k < run.sizes["time"]]
        return {name: np.mean([side[name] for side in sides], axis=0) for name in FORCES}
    el = elements_at(run, record, p)
    around = allocate_surroundings(el.mass.size)
    find_surroundings(el, interaction_sizes(el, p), around, p)
    around.acts[:] = True  # the sub-steps' part too
    apply_at_velocities(el, around)
    return {name: el.mass[:, None] * around.applied[:, row] for name, row in _ROWS.items()}


def forces_recorded(run: xr.Dataset) -> bool:
    """Whether a run holds the forces as they were applied (`riftberg.runs.applied`)."""
    return run.sizes["time"] > 1 and all(v.name in run.variables for v in force_variables())


def applied_forces(run: xr.Dataset, record: int) -> dict[str, Floats]:
    """Return the mean forces between the record before and this one, as applied; see `external_forces`."""
    names = {name: f"force_{media.FORCES[row]}" for name, row in _ROWS.items()}
    now = run.isel(time=record)
    return {
        name: np.stack([now[f"{stored}_{axis}"].values.astype(np.float64) for axis in "xy"], axis=-1)
        for name, stored in names.items()
    }


def elements_at(run: xr.Dataset, record: int, p: KernelParameters) -> Elements:
    """Return the elements of a run at a record, as far as its file holds them, at their synchronised velocity."""
    el = new_elements(run.sizes["trajectory"])
    names = {"lon": "x", "lat": "y"} if not p.latlon else {}
    for v in ELEMENT_VARIABLES:
        name = names.get(v.name, v.name)
        if name in run.variables:
            stored = run[name].isel(time=record) if "time" in run[name].dims else run[name]
            getattr(el, v.name)[:] = stored.values
    el.u[:], el.v[:] = el.u_sync, el.v_sync
    measure_outlines(el, p)
    return el


def accelerations(run: xr.Dataset, record: int, first: int, last: int) -> Floats:
    """Return accelerations (m s-2, east and north) by differences of the recorded velocities."""
    low, high = max(first, record - 1), min(last, record + 1)
    if low == high:
        return np.full((run.sizes["trajectory"], 2), np.nan)
    times = run["time"].values
    dt = float((times[high] - times[low]) / np.timedelta64(1, "s"))
    pair = run[["u_sync", "v_sync"]].isel(time=[low, high]).load()
    return np.stack([np.diff(pair[n].transpose("trajectory", "time").values, axis=1)[:, 0] / dt for n in pair], axis=-1)
