"""From the fields of a caller to the fields of the model: staggering, stress to wind, land and gaps (equations 3.1)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import STRESS_INVERSION_DRAG
from riftberg.ocean.grid import Grid
from riftberg.ocean.grid_arrays import CORNER_FIELDS, Fields
from riftberg.state import Floats

Staggering = Literal["A", "B", "C"]

ZERO_ON_LAND = (*CORNER_FIELDS, "sst", "sss", "ice_fraction", "ice_thickness")
"""Fields set to 0 in (or at the north-east corner of) land cells (equations 3.1 rule 5)."""

KELVIN_ABOVE = 120.0
"""A sea-surface temperature above this, in whatever unit, is taken as kelvin (equations 3.1 rule 4)."""


def _shifted(q: Floats, rows: int, columns: int) -> Floats:
    """Value of the cell that many rows north and columns east; beyond the array the last value is repeated."""
    return np.pad(q, ((0, rows), (0, columns)), mode="edge")[rows:, columns:]


def corner_mask(mask: Floats) -> Floats:
    """Return 1 at north-east corners that no land cell touches, else 0 (equations 3.1 rule 1)."""
    parts = (mask, _shifted(mask, 0, 1), _shifted(mask, 1, 0), _shifted(mask, 1, 1))
    return np.asarray(np.minimum.reduce(parts))


def at_corners(u: Floats, v: Floats, grid: Grid, staggering: Staggering) -> tuple[Floats, Floats]:
    """Return a vector field at north-east corners (B-grid) from any of the usual staggerings (equations 3.1)."""
    if staggering == "B":
        return u.copy(), v.copy()
    wet = corner_mask(grid.arrays.mask)
    if staggering == "C":
        return wet * (0.5 * (u + _shifted(u, 1, 0))), wet * (0.5 * (v + _shifted(v, 0, 1)))
    mean_u, mean_v = (0.25 * ((q + _shifted(q, 1, 1)) + (_shifted(q, 0, 1) + _shifted(q, 1, 0))) for q in (u, v))
    return wet * mean_u, wet * mean_v


def wind_from_stress(tau_x: Floats, tau_y: Floats) -> tuple[Floats, Floats]:
    """Return the wind (m s-1) that the reference makes of a stress: tau / sqrt(0.0015 |tau|) (equations 3.1, quirk Q24)."""
    scale = np.sqrt(STRESS_INVERSION_DRAG * np.sqrt(tau_x**2 + tau_y**2))
    safe = np.where(scale > 0.0, scale, 1.0)
    return np.where(scale > 0.0, tau_x / safe, 0.0), np.where(scale > 0.0, tau_y / safe, 0.0)


def celsius(sst: Floats, mask: Floats) -> Floats:
    """Return a sea-surface temperature in degree Celsius; kelvin is recognised by its size (equations 3.1 rule 4)."""
    wet = sst[(mask > 0.5) & np.isfinite(sst)]
    kelvin = wet.size > 0 and float(wet.max()) > KELVIN_ABOVE
    return sst - 273.15 if kelvin else sst.copy()


@kernel
def _is_clean(values: Floats, mask: Floats, zero_on_land: bool) -> bool:
    for j in range(values.shape[0]):
        for i in range(values.shape[1]):
            q = values[j, i]
            if q != q or (zero_on_land and mask[j, i] < 0.5 and q != 0.0):
                return False
    return True


@kernel
def first_gap(values: Floats, mask: Floats, halo: int) -> tuple[int, int]:
    """Return (i, j) of the first cell of the domain, array indices, that is water but holds NaN; else (-1, -1)."""
    for j in range(halo, values.shape[0] - halo):
        for i in range(halo, values.shape[1] - halo):
            if values[j, i] != values[j, i] and mask[j, i] >= 0.5:
                return i, j
    return -1, -1


def usable(values: Floats, mask: Floats, zero_on_land: bool) -> Floats:
    """Return a field as the kernels need it: float64, contiguous, writeable, no NaN, 0 on land where asked.

    The array itself comes back if it is already so.
    """
    q: Floats = np.require(values, dtype=np.float64, requirements=["C", "W"])
    if _is_clean(q, mask, zero_on_land):
        return q
    q = np.where(np.isnan(q), 0.0, q)
    if zero_on_land:
        q[mask < 0.5] = 0.0
    return q


def without_gaps(fields: Fields, mask: Floats) -> Fields:
    """Return fields without NaN, and 0 on land (sea level and depth keep their values there) (equations 3.1 rule 5)."""
    pairs = zip(Fields._fields, fields, strict=True)
    return Fields(**{name: usable(values, mask, name in ZERO_ON_LAND) for name, values in pairs})
