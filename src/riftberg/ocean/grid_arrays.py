"""Arrays of a grid and of fields on it, as compiled code reads them."""

from __future__ import annotations

from typing import NamedTuple

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
