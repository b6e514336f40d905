"""The canonical quantities: names, units, CF names, signs, limits; and the change of units into them.

A new quantity is a row of `QUANTITIES`: how it is found in files, its believable values and its sources follow.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

import xarray as xr

from riftberg.config.units import parse_unit
from riftberg.errors import ForcingError

TO_DIRECTION: Final = "sea_surface_wave_to_direction"
"""Standard name of the direction into which waves travel; the canonical one is that from which they come."""


@dataclass(frozen=True)
class Quantity:
    """One canonical variable."""

    name: str  # Name in the canonical dataset
    units: str  # CF units
    standard_name: str  # CF standard name
    long_name: str  # Meaning in plain words
    sign: str  # What a positive value means
    limit: float  # Magnitude beyond which a value is not believable (in ``units``)
    usual: tuple[str, ...]  # Names that files usually give it, the preferred one first
    also: tuple[str, ...] = ()  # Other standard names that mean the same
    along: tuple[str, ...] = ()  # Standard names of the component along an axis of the grid
    on_levels: tuple[
        str, ...
    ] = ()  # Standard names on levels from the surface down; taken if nothing is of the surface alone
    lowest: float = -math.inf  # Value below which none is believable; round-off of packing lies a little below zero
    usual_most: float = (
        0.0  # Numbers up to this, under a smaller unit such as cm or per cent, may be meant in ``units``
    )
    moves: bool = True  # Whether it changes by the day; without dates it is then a mean or a snapshot
    source: str = ""  # Where to get it

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest believable value."""
        return max(-self.limit, self.lowest), self.limit


_PERIOD = "sea_surface_wave_mean_period_from_variance_spectral_density"
_CURRENTS = "ocean currents: OSCAR v2 (free Earthdata login) or GLORYS12 (free Copernicus Marine login)"

QUANTITIES: Final = {quantity.name: quantity for quantity in (
    Quantity(
        "uo", "m s-1", "eastward_sea_water_velocity", "eastward current", "towards the east", 5.0,
        ("uo", "water_u", "u_eastward", "uoe", "ugo", "unod", "ssu"), ("surface_eastward_sea_water_velocity",),
        ("sea_water_x_velocity", "surface_sea_water_x_velocity"), usual_most=2.0, source=_CURRENTS,
    ),
    Quantity(
        "vo", "m s-1", "northward_sea_water_velocity", "northward current", "towards the north", 5.0,
        ("vo", "water_v", "v_northward", "von", "vgo", "vnod", "ssv"), ("surface_northward_sea_water_velocity",),
        ("sea_water_y_velocity", "surface_sea_water_y_velocity"), source=_CURRENTS,
    ),
    Quantity(
        "ssh", "m", "sea_surface_height_above_geoid", "sea surface height above the geoid", "up", 10.0,
        ("ssh", "zos", "zeta", "surf_el", "SSH"), usual_most=3.0,
        source="sea level: DUACS adt or GLORYS12 zos (free Copernicus Marine login)",
    ),
    Quantity(
        "sst", "degree_Celsius", "sea_surface_temperature", "sea surface temperature", "warmer", 45.0,
        ("sst", "tos", "analysed_sst"), ("sea_water_surface_temperature",),
        on_levels=("sea_water_potential_temperature", "sea_water_temperature", "sea_water_conservative_temperature"),
        lowest=-5.0, moves=False, source="sea surface temperature: GLORYS12 thetao or ERA5 sst",
    ),
    Quantity(
        "sss", "1e-3", "sea_surface_salinity", "sea surface salinity", "saltier", 45.0, ("sss", "sos"),
        on_levels=("sea_water_salinity", "sea_water_practical_salinity"),
        lowest=-0.5, moves=False, source="salinity: GLORYS12 so",
    ),
    Quantity(
        "ua", "m s-1", "eastward_wind", "eastward wind at 10 m", "blowing towards the east", 80.0,
        ("ua", "u10", "U10", "uas", "eastward_wind"), along=("x_wind", "grid_eastward_wind"), usual_most=50.0,
        source="wind: NCEP/NCAR R1 uwnd.10m.gauss.YEAR.nc (no login) or ERA5 u10",
    ),
    Quantity(
        "va", "m s-1", "northward_wind", "northward wind at 10 m", "blowing towards the north", 80.0,
        ("va", "v10", "V10", "vas", "northward_wind"), along=("y_wind", "grid_northward_wind"),
        source="wind: NCEP/NCAR R1 vwnd.10m.gauss.YEAR.nc (no login) or ERA5 v10",
    ),
    Quantity(
        "taux", "Pa", "surface_downward_eastward_stress", "eastward wind stress", "pulling the sea eastward", 10.0,
        ("taux", "tauuo"), along=("surface_downward_x_stress",), moves=False,
    ),
    Quantity(
        "tauy", "Pa", "surface_downward_northward_stress", "northward wind stress", "pulling the sea northward", 10.0,
        ("tauy", "tauvo"), along=("surface_downward_y_stress",), moves=False,
    ),
    Quantity(
        "ice_fraction", "1", "sea_ice_area_fraction", "sea ice area fraction", "more ice, 0 to 1", 1.01,
        ("siconc", "aice", "ice_conc", "ice_fraction"), lowest=-0.01, usual_most=1.0, moves=False,
        source="sea ice: GLORYS12 siconc, OSI SAF ice_conc or ERA5 siconc",
    ),
    Quantity(
        "ice_thickness", "m", "sea_ice_thickness", "sea ice thickness", "thicker", 30.0,
        ("sithick", "hice", "ice_thickness"), lowest=-0.01, usual_most=10.0, moves=False,
        source="sea ice thickness: GLORYS12 sithick",
    ),
    Quantity(
        "ui", "m s-1", "eastward_sea_ice_velocity", "eastward drift of sea ice", "towards the east", 5.0,
        ("usi", "ui"), along=("sea_ice_x_velocity",), usual_most=0.5, source="sea ice drift: GLORYS12 usi",
    ),
    Quantity(
        "vi", "m s-1", "northward_sea_ice_velocity", "northward drift of sea ice", "towards the north", 5.0,
        ("vsi", "vi"), along=("sea_ice_y_velocity",), source="sea ice drift: GLORYS12 vsi",
    ),
    Quantity(
        "wave_height", "m", "sea_surface_wave_significant_height", "significant wave height", "higher", 30.0,
        ("VHM0", "swh", "hs"), lowest=-0.01, usual_most=20.0, source="waves: ERA5 swh",
    ),
    Quantity(
        "wave_period", "s", "sea_surface_wave_mean_period", "mean wave period", "longer", 60.0,
        ("VTM02", "mwp", "VTM10", "mean_wave_period", "t02", "tm02", "Tm02", "mp2", "t01", "tm01", "Tm01", "mp1", "t0m1", "tmm10",
         "Tmm10", "VTM01", "mwsper", "mwspersfc"),
        (f"{_PERIOD}_second_frequency_moment", f"{_PERIOD}_inverse_frequency_moment", f"{_PERIOD}_first_frequency_moment",
         "sea_surface_wave_zero_upcrossing_period"), lowest=-0.01,
    ),
    Quantity(
        "wave_direction", "degree", "sea_surface_wave_from_direction",
        "direction FROM which the waves come, clockwise from north",
        "coming FROM that bearing (90 = waves travelling west)", 360.0, ("VMDR", "mwd"), (TO_DIRECTION,),
    ),
    Quantity(
        "depth_below_surface", "m", "sea_floor_depth_below_geoid", "depth of the sea floor below mean sea level",
        "down (deeper); land is missing", 12000.0, ("deptho", "depth_below_surface", "bathymetry", "elevation"),
        ("sea_floor_depth_below_mean_sea_level", "sea_floor_depth_below_sea_level", "sea_floor_depth"),
        moves=False, source="sea floor: GEBCO grid (`riftberg fetch gebco`), IBCSO south of 50 S",
    ),
)}  # fmt: skip
"""All canonical variables by name."""

FRESH: Final = 0.06
"""Salinity (1e-3) that some point of a sea exceeds: 0.035 are kilograms of salt per kilogram under another unit."""

PERCENT: Final = ("%", "percent", "percentage", "1e-2", "0.01", "1.e-2")
"""Ways to write hundredths."""

_SAME = (1.0, 0.0)
_NAMED: Final[dict[str, tuple[tuple[tuple[str, ...], tuple[float, float]], ...]]] = {
    "degree_Celsius": (
        ((
            "degree_celsius", "degc", "degrees_c", "degree_c", "celsius", "c", "degrees celsius", "deg c", "deg_c", "degree_c.",
            "degrees_celsius", "deg celsius", "degree celsius", "degree c", "degrees c", "\N{DEGREE SIGN}c",
        ), _SAME),
        (("k", "kelvin", "degk", "deg_k", "deg k", "kelvins", "degree_k", "degrees_k"), (1.0, -273.15)),
        ((
            "degf", "fahrenheit", "deg_f", "deg f", "degree_f", "degrees_f", "degree_fahrenheit", "degrees fahrenheit", "f",
            "\N{DEGREE SIGN}f",
        ), (5.0 / 9.0, -160.0 / 9.0)),
    ),
    "1e-3": (
        ((
            # Without units the values speak for themselves: `unlikely` refuses a salinity of 0.035.
            "", "1e-3", "psu", "practical salinity units", "pss", "0.001", "g/kg", "g kg-1", "1", "pss-78", "pss78", "ppt",
            "practical salinity", "practical salinity unit", "practical_salinity_unit", "practical_salinity_units", "permil",
            "per mille", "\N{PER MILLE SIGN}",
        ), _SAME),
        (("kg/kg", "kg kg-1"), (1000.0, 0.0)),
    ),
    "1": (
        (("1", "", "1.0", "(0 - 1)", "0-1", "fraction", "none", "dimensionless", "unitless", "m2 m-2", "m2/m2"), _SAME),
        (PERCENT, (0.01, 0.0)),
        (("tenths", "tenth", "0.1", "1e-1"), (0.1, 0.0)),
    ),
    # A capital W after a number is a longitude everywhere else.
    "W m-2": ((("w/m2", "w/m^2", "w/m**2", "w m^-2", "w m**-2", "w.m-2", "watt/m2", "watt m-2", "j m-2 s-1", "j/m2/s"), _SAME),),
    "degree": ((("degree true", "degree_true", "degrees true", "degree_t"), _SAME),),
}  # fmt: skip
"""Units that are no powers of others, or are written as none, with the factor and offset into the canonical one."""

_SPELLED: Final = {"n": "N", "pa": "Pa", "ms": "m s"}
"""Words of files, in lower case, for units that `riftberg.config.units` knows in capitals."""

_READ_TOO: Final = {
    "m s-1": "cm/s, mm/s, knots, km/h, km/day, m/day, ft/s, mph", "m": "cm, km, mm, dm, ft, fathom",
    "degree_Celsius": "k, degf", "1e-3": "kg/kg", "Pa": "dyn/cm2", "1": "%, tenths", "s": "min", "degree": "rad",
}  # fmt: skip


def unit_change(units: str, target: str) -> tuple[float, float] | None:
    """Return factor and offset that turn units, however a file writes them, into those that are wanted; None for others."""
    key = " ".join(units.split()).lower()
    if key == target.lower():
        return _SAME
    for names, change in _NAMED.get(target, ()):
        if key in names:
            return change
    number = re.match(r"(?:(\d+\.?\d*(?:e[-+]?\d+)?)|10(?:\^|\*\*)?([-+]\d+))\s*\*?\s*(?=[a-z])", key)
    scale = 1.0 if number is None else float(number[1] or f"1e{number[2]}")  # of "100 km" and "1e-2 m/s"
    key = key[number.end() :] if number else key
    try:
        # "m.s-1" and "meters per second" are those of "m s-1", and a full stop at the end is none of a number.
        text = re.sub(r"(?<=[a-z])\.(?=[a-z])", " ", key.rstrip(".").replace(" per ", "/"))
        given, ours = (
            parse_unit(re.sub(r"[a-z]+", lambda word: _SPELLED.get(word[0], word[0]), text)),
            parse_unit(target),
        )
    except ValueError:
        return None
    return (scale * given.factor / ours.factor, 0.0) if key and given.powers == ours.powers else None


def conversion(quantity: Quantity, units: str, *, where: str) -> tuple[float, float]:
    """Return factor and offset that turn ``units`` into the units of ``quantity``; refuse units that are none of its."""
    change = unit_change(units, quantity.units)
    if change is None:
        read_too = f"(read too: {_READ_TOO[quantity.units]})"
        if units.strip():
            fault, remedy = (
                f"units {units!r} are not known",
                f"Convert it to {quantity.units} and write that into the file",
            )
        else:
            fault = "the file gives no units"
            remedy = f"If it is in {quantity.units}, write that into the file: ncatted -a units,NAME,c,c,'{quantity.units}' FILE"
        raise ForcingError(
            f"{fault} for {quantity.name} ({quantity.long_name})", where=where, remedy=f"{remedy} {read_too}"
        )
    return change


def canonicalise(data: xr.DataArray, quantity: Quantity, units: str, *, where: str) -> xr.DataArray:
    """Return ``data`` in canonical units with canonical attributes; nothing is computed where the units agree already."""
    factor, offset = conversion(quantity, units, where=where)
    if factor != 1.0:
        data = data * factor
    if offset != 0.0:
        data = data + offset
    return labelled(data, quantity)


def labelled(data: xr.DataArray, quantity: Quantity) -> xr.DataArray:
    """Return ``data`` under its canonical name, with the CF attributes of ``quantity`` and no others."""
    data = data.rename(quantity.name).copy(deep=False)
    data.attrs = {
        "standard_name": quantity.standard_name,
        "long_name": quantity.long_name,
        "units": quantity.units,
        "positive_means": quantity.sign,
    }
    return data


def unlikely(name: str, low: float, high: float) -> str:
    """Return the fault of values of a field from ``low`` to ``high``; empty if they are believable."""
    quantity = QUANTITIES[name]
    least, most = quantity.range
    if name == "ice_fraction" and most < high <= 100.5:
        return f"up to {high:.3g} it looks like per cent, and the file does not say so"
    if high > most or low < -most:
        return f"beyond {most:g} it is not believable"
    if name == "sss" and 0.0 < high <= FRESH:
        return "no sea is so fresh: it looks like kg of salt per kg"
    if low < least:
        return f"below {least:g} it is not believable"
    if name == "depth_below_surface" and low < high <= 0.0:
        return "nowhere is there water: it looks like a height, positive up (then give it the attribute positive: up)"
    if name == "depth_below_surface" and -low > high > low:
        return f"from {low:.4g} to {high:.4g} m it looks like a height, positive up (of depths, leave land missing)"
    return ""


DEEPEST_KM: Final = 12.0
"""No sea is deeper than so many kilometres: sea floors of no larger numbers may be in kilometres."""


def doubtful_below(name: str, units: str) -> float:
    """Return the magnitude (canonical units) up to which all of a field leaves the unit of its file in doubt; 0 for none."""
    if name == "depth_below_surface":
        return DEEPEST_KM * conversion(QUANTITIES[name], units, where=name)[0]
    most = QUANTITIES[name].usual_most
    factor = conversion(QUANTITIES[name], units, where=name)[0] if most else 1.0
    # Only of units as small as these can numbers look like those of the canonical one; 1e-6 is round-off of packing.
    return factor * most * (1.0 + 1e-6) if factor < 0.2 else 0.0


def small_unit(name: str, low: float, high: float, units: str) -> str:
    """Return a doubt about the unit of a field with values from ``low`` to ``high``; empty if there is none."""
    largest = max(-low, high)
    if not 0.0 < largest <= doubtful_below(name, units):
        return ""
    numbers = largest / conversion(QUANTITIES[name], units, where=name)[0]
    meant = {"1": "shares of 1"}.get(QUANTITIES[name].units, QUANTITIES[name].units)
    meant = "km" if name == "depth_below_surface" else meant
    return f"{name} is at most {numbers:.3g} in magnitude although the file says {units}: are these {meant}?"
