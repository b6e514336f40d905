"""The state: elements and bonds as structs of arrays, and the one registry of variables.

Output, restart files, the documentation and the coupling interface take names, units and meaning from `ELEMENT_VARIABLES`
and `BOND_VARIABLES`; nothing is listed a second time anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Variable:
    """One variable of the state.

    Attributes
    ----------
    name : str
        Field of `Elements` or `Bonds`.
    units : str
        CF units.
    long_name : str
        Meaning in plain words.
    standard_name : str
        CF standard name where one exists, else empty.
    dtype : str
        ``"f8"`` or ``"i8"``.
    restart : bool
        Whether a restart file must hold it.
    output : bool
        Whether a run file holds it by default.
    """

    name: str
    units: str
    long_name: str
    standard_name: str = ""
    dtype: str = "f8"
    restart: bool = True
    output: bool = False


def _v(name: str, units: str, long_name: str, **extra: Any) -> Variable:
    return Variable(name, units, long_name, **extra)


ELEMENT_VARIABLES: tuple[Variable, ...] = (
    _v("id", "1", "identifier of the element", dtype="i8", output=True),
    _v("lon", "degrees_east", "longitude (x in m on a Cartesian grid)", standard_name="longitude", output=True),
    _v("lat", "degrees_north", "latitude (y in m on a Cartesian grid)", standard_name="latitude", output=True),
    _v("u", "m s-1", "eastward velocity, with the fast kicks and the first slow half kick of the step"),
    _v("v", "m s-1", "northward velocity, with the fast kicks and the first slow half kick of the step"),
    _v("u_sync", "m s-1", "eastward velocity at the time of the position", output=True),
    _v("v_sync", "m s-1", "northward velocity at the time of the position", output=True),
    _v("u_pair", "m s-1", "eastward velocity that other elements see"),
    _v("v_pair", "m s-1", "northward velocity that other elements see"),
    _v("lon_pair", "degrees_east", "longitude that other elements see"),
    _v("lat_pair", "degrees_north", "latitude that other elements see"),
    _v("ax", "m s-2", "explicit eastward acceleration of the long step"),
    _v("ay", "m s-2", "explicit northward acceleration of the long step"),
    _v("bx", "m s-2", "implicit eastward acceleration of the long step"),
    _v("by", "m s-2", "implicit northward acceleration of the long step"),
    _v("ax_fast", "m s-2", "explicit eastward acceleration of the sub-step"),
    _v("ay_fast", "m s-2", "explicit northward acceleration of the sub-step"),
    _v("bx_fast", "m s-2", "implicit eastward acceleration of the sub-step"),
    _v("by_fast", "m s-2", "implicit northward acceleration of the sub-step"),
    _v("spin", "rad s-1", "angular velocity, counter-clockwise", output=True),
    _v("spin_rate", "rad s-2", "angular acceleration, counter-clockwise"),
    _v("rotation", "rad", "angle turned since the start, counter-clockwise", output=True),
    _v("mass", "kg", "mass of the element"),
    _v("thickness", "m", "ice thickness", standard_name="land_ice_thickness", output=True),
    _v("length", "m", "length of the element"),
    _v("width", "m", "width of the element"),
    _v("static", "1", "1 where the element never moves"),
    _v("in_contact", "1", "1 where the element takes part in the contact iteration (quirk Q2)"),
    _v("load_x", "N", "steady eastward load added to the bond forces"),
    _v("load_y", "N", "steady northward load added to the bond forces"),
    _v("free_y", "1", "0 where a roller support takes the northward bond force, else 1"),
    _v("berg", "1", "number of the conglomerate (fragment) that the element belongs to", dtype="i8", output=True),
    _v("bond_count", "1", "unbroken bonds of the element", dtype="i8", output=True),
    _v("cell_i", "1", "array column of the grid cell", dtype="i8"),
    _v("cell_j", "1", "array row of the grid cell", dtype="i8"),
    _v("xi", "1", "position in the cell, west to east"),
    _v("eta", "1", "position in the cell, south to north"),
    _v("uo", "m s-1", "eastward ocean current", standard_name="eastward_sea_water_velocity", output=True),
    _v("vo", "m s-1", "northward ocean current", standard_name="northward_sea_water_velocity", output=True),
    _v("ui", "m s-1", "eastward sea-ice velocity", standard_name="eastward_sea_ice_velocity", output=True),
    _v("vi", "m s-1", "northward sea-ice velocity", standard_name="northward_sea_ice_velocity", output=True),
    _v("ua", "m s-1", "eastward wind", standard_name="eastward_wind", output=True),
    _v("va", "m s-1", "northward wind", standard_name="northward_wind", output=True),
    _v("slope_x", "1", "eastward slope of the sea surface", output=True),
    _v("slope_y", "1", "northward slope of the sea surface", output=True),
    _v(
        "depth", "m", "depth of water under the element", standard_name="sea_floor_depth_below_sea_surface", output=True
    ),
    _v("sst", "degree_Celsius", "sea-surface temperature", standard_name="sea_surface_temperature"),
    _v("sss", "1e-3", "sea-surface salinity", standard_name="sea_surface_salinity"),
    _v("ice_fraction", "1", "sea-ice area fraction", standard_name="sea_ice_area_fraction"),
    _v("ice_thickness", "m", "sea-ice thickness", standard_name="sea_ice_thickness", output=True),
    _v("vorticity", "s-1", "relative vorticity of the ocean current", restart=True),
)
"""Registry of the variables of an element, in the order of the fields of `Elements`."""

BOND_VARIABLES: tuple[Variable, ...] = (
    _v("first", "1", "row of the first element", dtype="i8"),
    _v("second", "1", "row of the second element", dtype="i8"),
    _v("shear_x", "m", "accumulated eastward tangential displacement of the first element"),
    _v("shear_y", "m", "accumulated northward tangential displacement of the first element"),
    _v("normal_stress", "Pa", "largest tensile stress across the bond, negative in compression", output=True),
    _v("shear_stress", "Pa", "shear stress across the bond", output=True),
    _v("peak_stress", "Pa", "largest normal_stress of the last long step", output=True),
    _v("bond_length", "m", "distance between the centres"),
    _v("relative_rotation", "rad", "accumulated relative rotation"),
    _v("status", "1", "0 unbroken, 1 broken but still a contact pair, 2 gone", dtype="i8"),
    _v("strength", "1", "strength of the bond relative to the fracture thresholds"),
    _v("damage", "1", "part of the strength that the stress history has taken; in run files with damage", output=True),
    _v("break_time", "s", "time of breaking since the start, NaN while unbroken", output=True),
    _v("break_grounded", "1", "1 where an end was aground when the bond broke", dtype="i8"),
)
"""Registry of the variables of a bond, in the order of the fields of `Bonds`."""


class Elements(NamedTuple):
    """Arrays of shape (number of elements,); meaning and units in `ELEMENT_VARIABLES`."""

    id: Ints
    lon: Floats
    lat: Floats
    u: Floats
    v: Floats
    u_sync: Floats
    v_sync: Floats
    u_pair: Floats
    v_pair: Floats
    lon_pair: Floats
    lat_pair: Floats
    ax: Floats
    ay: Floats
    bx: Floats
    by: Floats
    ax_fast: Floats
    ay_fast: Floats
    bx_fast: Floats
    by_fast: Floats
    spin: Floats
    spin_rate: Floats
    rotation: Floats
    mass: Floats
    thickness: Floats
    length: Floats
    width: Floats
    static: Floats
    in_contact: Floats
    load_x: Floats
    load_y: Floats
    free_y: Floats
    berg: Ints
    bond_count: Ints
    cell_i: Ints
    cell_j: Ints
    xi: Floats
    eta: Floats
    uo: Floats
    vo: Floats
    ui: Floats
    vi: Floats
    ua: Floats
    va: Floats
    slope_x: Floats
    slope_y: Floats
    depth: Floats
    sst: Floats
    sss: Floats
    ice_fraction: Floats
    ice_thickness: Floats
    vorticity: Floats


class Bonds(NamedTuple):
    """Arrays of shape (number of bonds,); each physical bond is stored once. Meaning and units in `BOND_VARIABLES`."""

    first: Ints
    second: Ints
    shear_x: Floats
    shear_y: Floats
    normal_stress: Floats
    shear_stress: Floats
    peak_stress: Floats
    bond_length: Floats
    relative_rotation: Floats
    status: Ints
    strength: Floats
    damage: Floats
    break_time: Floats
    break_grounded: Ints


_DEFAULTS: dict[str, float] = {"free_y": 1.0, "depth": 1e4, "strength": 1.0, "break_time": np.nan, "sss": -1.0}


def _arrays(variables: Iterable[Variable], size: int) -> dict[str, NDArray[Any]]:
    return {v.name: np.full(size, _DEFAULTS.get(v.name, 0), dtype=v.dtype) for v in variables}


def new_elements(size: int) -> Elements:
    """Return ``size`` elements at rest with default values and identifiers 1, 2, ..."""
    elements = Elements(**_arrays(ELEMENT_VARIABLES, size))
    elements.id[:] = np.arange(1, size + 1)
    return elements


def new_bonds(first: Ints, second: Ints) -> Bonds:
    """Return unbroken, unstressed bonds between the elements in rows ``first`` and ``second``."""
    bonds = Bonds(**_arrays(BOND_VARIABLES, len(first)))
    bonds.first[:] = first
    bonds.second[:] = second
    return bonds


def copy_state(elements: Elements, bonds: Bonds) -> tuple[Elements, Bonds]:
    """Return copies that share no memory with the originals."""
    return Elements._make(a.copy() for a in elements), Bonds._make(a.copy() for a in bonds)
