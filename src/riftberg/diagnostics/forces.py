"""External forces on the elements of a run, recomputed from what its file recorded.

The laws are those of `riftberg.physics`; the composition is done here a second time, apart from the steppers, so that a
budget that closes says something (spec 4.1).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from riftberg.parameters import KernelParameters
from riftberg.physics.coriolis import coriolis_parameter
from riftberg.physics.drag import air_drag, draft_of, exposed_sides, ocean_drag, sea_ice_drag, side_width
from riftberg.physics.grounding import grounded_fraction, grounding_rate
from riftberg.physics.slope import slope_acceleration
from riftberg.physics.waves import wave_acceleration
from riftberg.state import Floats

FORCES: Final = ("ocean drag", "surface slope", "Coriolis", "wind drag", "waves", "sea floor", "sea ice")
"""External forces, in the order of all tables."""


def external_forces(run: xr.Dataset, record: int, p: KernelParameters) -> dict[str, Floats]:
    """Return the external forces on all elements at a record.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`.
    record : int
    p : KernelParameters

    Returns
    -------
    dict
        For each name of `FORCES` an array of shape (elements, 2): eastward and northward force, N. Sea ice is 0 in
        files that do not record it.
    """
    s = _State(run, record)
    mass, latitude = s("mass"), s("lat") if p.latlon else np.zeros(s.count)
    length, width, thickness = s("length"), s("width"), s("thickness")
    u, v, uo, vo, ua, va = (s(name) for name in ("u_sync", "v_sync", "uo", "vo", "ua", "va"))
    draft = _each(draft_of, thickness, p.rho_ice)
    ice = np.minimum(s("ice_thickness"), draft)
    hexagon = p.dem and p.hexagonal and p.radius_based
    side = _each(side_width, length, width, hexagon)
    exposed = _each(exposed_sides, s("bond_count"), p.max_sides, p.bonds_on and p.sides_by_bonds)
    water = _each(ocean_drag, mass, length, width, side, np.maximum(0.0, draft - ice), exposed, p.ocean_scale)
    air = _each(air_drag, mass, length, width, side, thickness - draft, exposed)
    frozen = _each(sea_ice_drag, mass, side, ice, exposed, s("ui"), s("vi"), p.frozen_sea_ice_drag)
    f = _each(coriolis_parameter, latitude, p.latlon, p.f_plane, p.reference_latitude)
    waves = _each(wave_acceleration, ua, va, uo, vo, mass, thickness - draft, side if hexagon else length, side)
    floor = _floor_rate(s, draft, p)
    accelerations = {
        "ocean drag": _drag(water, u, v, uo, vo),
        "surface slope": np.stack(_each(slope_acceleration, s("slope_x"), s("slope_y")), axis=-1),
        "Coriolis": np.stack([f * v, -f * u], axis=-1),
        "wind drag": _drag(air, u, v, ua, va),
        "waves": np.stack(waves, axis=-1),
        "sea floor": np.stack([-floor * u, -floor * v], axis=-1),
        "sea ice": _drag(frozen, u, v, s("ui"), s("vi")),
    }
    return {name: mass[:, None] * accelerations[name] for name in FORCES}


class _State:
    """Variables of the elements at a record, in double precision."""

    def __init__(self, run: xr.Dataset, record: int) -> None:
        self.run, self.record = run, record
        self.count = run.sizes["trajectory"]

    def __call__(self, name: str) -> Floats:
        if name not in self.run.variables:
            return np.zeros(self.count)
        variable = self.run[name]
        values = variable.isel(time=self.record) if "time" in variable.dims else variable
        return np.asarray(values.values, np.float64)


def _each(law: Any, *arguments: Any) -> Any:
    """Apply a law of one element to all."""
    return np.vectorize(law)(*arguments)


def _drag(coefficient: Floats, u: Floats, v: Floats, uk: Floats, vk: Floats) -> Floats:
    speed = np.hypot(u - uk, v - vk)
    return np.stack([-coefficient * speed * (u - uk), -coefficient * speed * (v - vk)], axis=-1)


def _floor_rate(s: _State, draft: Floats, p: KernelParameters) -> Floats:
    """Return the rate (s-1) at which the sea floor slows the elements; with the sizes that bonds see on sub-steps."""
    if p.ground_coefficient <= 0.0:
        return np.zeros(s.count)
    area, mass = s("length") * s("width"), s("mass")
    if p.ground_on_substeps and p.constant_size and p.constant_length > 0.0:
        area = np.full(s.count, p.constant_length * p.constant_width)
        mass = area * s("thickness") * p.rho_ice
    fraction = _each(grounded_fraction, s("depth"), draft, p.ground_ramp)
    return np.asarray(_each(grounding_rate, p.ground_coefficient, area, mass, fraction))


def accelerations(run: xr.Dataset, record: int, first: int, last: int) -> Floats:
    """Return accelerations (m s-2, east and north) by differences of the recorded velocities.

    Parameters
    ----------
    run : xarray.Dataset
    record : int
    first, last : int
        Records that may be used, first included, last included; central where both neighbours may be.

    Returns
    -------
    array, shape (elements, 2)
    """
    low, high = max(first, record - 1), min(last, record + 1)
    if low == high:
        return np.full((run.sizes["trajectory"], 2), np.nan)
    times = run["time"].values
    dt = float((times[high] - times[low]) / np.timedelta64(1, "s"))
    pair = run[["u_sync", "v_sync"]].isel(time=[low, high]).load()
    return np.stack([np.diff(pair[n].transpose("trajectory", "time").values, axis=1)[:, 0] / dt for n in pair], axis=-1)
