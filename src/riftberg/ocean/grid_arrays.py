"""Arrays of a grid and of fields on it as compiled code reads them, and how a caller's fields become these (equations 3.1)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import STRESS_INVERSION_DRAG
from riftberg.ocean.grid import Grid
from riftberg.state import Floats


class GridArrays(NamedTuple):
    """What compiled code reads of a grid; 2-D arrays of shape (nj + 2 halo, ni + 2 halo)."""

    lon: Floats  # North-east corners, degrees or m
    lat: Floats  # North-east corners, degrees or m
    lon_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    lat_centre: Floats  # Mean of the four corners; row 0 and column 0 are no cells
    dx: Floats  # Length of the north edge and of the east edge, m
    dy: Floats  # Length of the north edge and of the east edge, m
    area: Floats  # Area of the cell, m2
    mask: Floats  # 1 ocean, 0 land
    cos_angle: Floats  # Turn of the grid at the corners: eastward = cos u + sin v, northward = cos v - sin u
    sin_angle: Floats  # Turn of the grid at the corners: eastward = cos u + sin v, northward = cos v - sin u
    ni: int  # Cells of the domain and width of the halo around it
    nj: int  # Cells of the domain and width of the halo around it
    halo: int  # Cells of the domain and width of the halo around it
    latlon: bool  # Degrees or metres; edges along the axes; western and eastern end joined
    regular: bool  # Degrees or metres; edges along the axes; western and eastern end joined
    cyclic: bool  # Degrees or metres; edges along the axes; western and eastern end joined
    # Zonal period of the coordinate, 0 or less if none. A regional grid in degrees has 360 without being cyclic
    period: float


class Fields(NamedTuple):
    """One state of ocean, air and ice on the grid; float64 arrays of the grid's full shape.

    ``uo vo ui vi ua va`` (m s-1) are values at north-east corners along the axes of the grid, the others of cells:
    ``ssh`` (m), ``sst`` (degree Celsius), ``sss`` (1e-3), ``ice_fraction`` (1), ``ice_thickness`` (m),
    ``depth`` of the sea floor below the geoid (m).
    """

    uo: Floats
    vo: Floats
    ui: Floats
    vi: Floats
    ua: Floats
    va: Floats
    ssh: Floats
    sst: Floats
    sss: Floats
    ice_fraction: Floats
    ice_thickness: Floats
    depth: Floats


CORNER_FIELDS = ("uo", "vo", "ui", "vi", "ua", "va")
"""Fields at north-east corners; all others are values of cells."""

ZERO_OUTSIDE = ("ua", "va", "ssh")
"""Fields that are 0 beyond a closed boundary (equations 3.1 rule 2, quirk Q23); the others repeat the outermost value."""

FIELD_DEFAULTS = {"sss": -1.0, "depth": 1e4, "wave_height": -1.0}
"""Values of fields that are not given, where not 0 (equations 3.1 rule 4)."""


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
