"""The canonical quantities: names, units, CF names, signs; and the change of units into them."""

from __future__ import annotations

from dataclasses import dataclass

import xarray as xr

from riftberg.errors import ForcingError


@dataclass(frozen=True)
class Quantity:
    """One canonical variable."""

    name: str  # Name in the canonical dataset
    units: str  # CF units
    standard_name: str  # CF standard name and meaning in plain words
    long_name: str  # CF standard name and meaning in plain words
    sign: str  # What a positive value means
    limit: float  # Magnitude beyond which a value is not believable (in ``units``)
    lowest: float  # Value below which none is believable

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest believable value."""
        return max(-self.limit, self.lowest), self.limit


_ROWS = (
    ("uo", "m s-1", "eastward_sea_water_velocity", "eastward current", "towards the east", 5.0),
    ("vo", "m s-1", "northward_sea_water_velocity", "northward current", "towards the north", 5.0),
    ("ssh", "m", "sea_surface_height_above_geoid", "sea surface height above the geoid", "up", 10.0),
    ("sst", "degree_Celsius", "sea_surface_temperature", "sea surface temperature", "warmer", 45.0),
    ("sss", "1e-3", "sea_surface_salinity", "sea surface salinity", "saltier", 45.0),
    ("ua", "m s-1", "eastward_wind", "eastward wind at 10 m", "blowing towards the east", 80.0),
    ("va", "m s-1", "northward_wind", "northward wind at 10 m", "blowing towards the north", 80.0),
    ("taux", "Pa", "surface_downward_eastward_stress", "eastward wind stress", "pulling the sea eastward", 10.0),
    ("tauy", "Pa", "surface_downward_northward_stress", "northward wind stress", "pulling the sea northward", 10.0),
    ("ice_fraction", "1", "sea_ice_area_fraction", "sea ice area fraction", "more ice, 0 to 1", 1.01),
    ("ice_thickness", "m", "sea_ice_thickness", "sea ice thickness", "thicker", 30.0),
    ("ui", "m s-1", "eastward_sea_ice_velocity", "eastward drift of sea ice", "towards the east", 5.0),
    ("vi", "m s-1", "northward_sea_ice_velocity", "northward drift of sea ice", "towards the north", 5.0),
    ("wave_height", "m", "sea_surface_wave_significant_height", "significant wave height", "higher", 30.0),
    ("wave_period", "s", "sea_surface_wave_mean_period", "mean wave period", "longer", 60.0),
    (
        "wave_direction",
        "degree",
        "sea_surface_wave_from_direction",
        "direction FROM which the waves come, clockwise from north",
        "coming FROM that bearing (90 = waves travelling west)",
        360.0,
    ),
    (
        "depth_below_surface",
        "m",
        "sea_floor_depth_below_geoid",
        "depth of the sea floor below mean sea level",
        "down (deeper); land is missing",
        12000.0,
    ),
)
_LOWEST = {
    "sst": -5.0, "sss": -0.5, "ice_fraction": -0.01, "ice_thickness": -0.01, "wave_height": -0.01, "wave_period": -0.01,
}  # fmt: skip
"""Lowest believable values; those of interpolation and packing may lie a little below zero."""

FRESH = 0.06
"""Salinity (1e-3) that some point of a sea exceeds: 0.035 are kilograms of salt per kilogram under another unit."""

QUANTITIES: dict[str, Quantity] = {row[0]: Quantity(*row, _LOWEST.get(row[0], -float("inf"))) for row in _ROWS}
"""All canonical variables by name."""

PERCENT = ("%", "percent", "percentage", "1e-2", "0.01", "1.e-2")
"""Ways to write hundredths."""

_SAME = (1.0, 0.0)
_UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "m s-1": {
        **dict.fromkeys(
            (
                "m s-1",
                "m/s",
                "m s**-1",
                "m s^-1",
                "m.s-1",
                "ms-1",
                "meter/sec",
                "meter/second",
                "meters/second",
                "metre/second",
                "meter second-1",
                "m sec-1",
                "m/sec",
                "meters s-1",
                "metres s-1",
                "meter s-1",
                "metre s-1",
                "metre second-1",
                "meters second-1",
                "m s-1.",
                "m/s.",
            ),
            _SAME,
        ),
        **dict.fromkeys(("meters per second", "metres per second", "m per s", "m second-1"), _SAME),
        **dict.fromkeys(
            (
                "cm/s",
                "cm s-1",
                "cm s**-1",
                "cm/sec",
                "cm.s-1",
                "cm s^-1",
                "cm sec-1",
                "cm second-1",
                "centimeters/second",
                "centimeters per second",
                "centimeter/sec",
                "centimeter second-1",
            ),
            (0.01, 0.0),
        ),
        **dict.fromkeys(("mm/s", "mm s-1", "mm.s-1"), (0.001, 0.0)),
        **dict.fromkeys(("knots", "knot", "kt", "kts", "kn"), (1852.0 / 3600.0, 0.0)),
        **dict.fromkeys(("km/h", "km h-1", "km.h-1", "km hr-1", "km/hr", "kph"), (1.0 / 3.6, 0.0)),
        **dict.fromkeys(("km/day", "km day-1", "km/d", "km d-1", "km.day-1"), (1.0 / 86.4, 0.0)),
        **dict.fromkeys(("m/day", "m day-1", "m/d", "m d-1"), (1.0 / 86400.0, 0.0)),
        **dict.fromkeys(("ft/s", "ft s-1", "feet/second"), (0.3048, 0.0)),
        **dict.fromkeys(("mph", "miles/hour"), (0.44704, 0.0)),
    },
    "m": {
        **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), _SAME),
        **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), (0.01, 0.0)),
        **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), (1000.0, 0.0)),
        **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), (0.001, 0.0)),
        **dict.fromkeys(("dm", "decimeter", "decimeters"), (0.1, 0.0)),
        **dict.fromkeys(("ft", "feet", "foot"), (0.3048, 0.0)),
        **dict.fromkeys(("fathom", "fathoms"), (1.8288, 0.0)),
    },
    "degree_Celsius": {
        **dict.fromkeys(
            (
                "degree_celsius",
                "degc",
                "degrees_c",
                "degree_c",
                "celsius",
                "c",
                "degrees celsius",
                "deg c",
                "deg_c",
                "degree_c.",
                "degrees_celsius",
                "deg celsius",
                "degree celsius",
                "degree c",
                "degrees c",
                "\N{DEGREE SIGN}c",
            ),
            _SAME,
        ),
        **dict.fromkeys(("k", "kelvin", "degk", "deg_k", "deg k", "kelvins", "degree_k", "degrees_k"), (1.0, -273.15)),
        **dict.fromkeys(
            (
                "degf",
                "fahrenheit",
                "deg_f",
                "deg f",
                "degree_f",
                "degrees_f",
                "degree_fahrenheit",
                "degrees fahrenheit",
                "f",
                "\N{DEGREE SIGN}f",
            ),
            (5.0 / 9.0, -160.0 / 9.0),
        ),
    },
    "1e-3": {
        **dict.fromkeys(
            (
                "",  # values tell: a salinity of 0.035 is refused by `unlikely`
                "1e-3",
                "psu",
                "practical salinity units",
                "pss",
                "0.001",
                "g/kg",
                "g kg-1",
                "1",
                "pss-78",
                "pss78",
                "ppt",
                "practical salinity",
                "practical salinity unit",
                "practical_salinity_unit",
                "practical_salinity_units",
                "permil",
                "per mille",
                "\N{PER MILLE SIGN}",
            ),
            _SAME,
        ),
        **dict.fromkeys(("kg/kg", "kg kg-1"), (1000.0, 0.0)),
    },
    "Pa": {
        **dict.fromkeys(("pa", "n m-2", "n/m2", "n m**-2", "n/m^2", "n m^-2", "n.m-2", "pascal"), _SAME),
        **dict.fromkeys(("dyn/cm2", "dyne/cm2", "dyn cm-2", "dyne cm-2", "dyne/cm^2", "dyn/cm^2"), (0.1, 0.0)),
    },
    "1": {
        **dict.fromkeys(
            ("1", "", "1.0", "(0 - 1)", "0-1", "fraction", "none", "dimensionless", "unitless", "m2 m-2", "m2/m2"),
            _SAME,
        ),
        **dict.fromkeys(PERCENT, (0.01, 0.0)),
        **dict.fromkeys(("tenths", "tenth", "0.1", "1e-1"), (0.1, 0.0)),
    },
    "s": {
        **dict.fromkeys(("s", "second", "seconds", "sec"), _SAME),
        **dict.fromkeys(("min", "minute", "minutes"), (60.0, 0.0)),
    },
    "degree": {
        **dict.fromkeys(("degree", "degrees", "degree true", "degree_true", "degrees true", "deg", "degree_t"), _SAME),
        **dict.fromkeys(("rad", "radian", "radians"), (57.29577951308232, 0.0)),
    },
}


def conversion(quantity: Quantity, units: str, *, where: str) -> tuple[float, float]:
    """Return factor and offset that turn ``units`` into the units of ``quantity``."""
    table = _UNITS[quantity.units]
    key = " ".join(units.split()).lower()
    if key not in table:
        raise ForcingError(
            f"units {units!r} are not known for {quantity.name} ({quantity.long_name})"
            + ("" if key else ": the file gives none"),
            where=where,
            remedy=f"Convert it to {quantity.units} and write that into the file (read too: {', '.join(_ways(table))})",
        )
    return table[key]


def _ways(table: dict[str, tuple[float, float]]) -> list[str]:
    """Return one name of each unit that is read, without the many ways to write it."""
    seen = {_SAME}
    return [name for name, way in table.items() if not (way in seen or seen.add(way))]  # type: ignore[func-returns-value]


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
    """Return what is wrong with values of a field from ``low`` to ``high``; empty if they are believable."""
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
        return "nowhere is there water: it looks like a height, positive up"
    if name == "depth_below_surface" and -low > high > low:
        return f"from {low:.4g} to {high:.4g} m it looks like a height, positive up (of depths, leave land missing)"
    return ""


USUAL_MOST = {
    "uo": 2.0, "ui": 0.5, "ua": 50.0, "ssh": 3.0, "ice_fraction": 1.0, "ice_thickness": 10.0, "wave_height": 20.0,
}  # fmt: skip
"""Numbers up to these, under a smaller unit such as cm or per cent, may be meant in the canonical unit."""


DEEPEST_KM = 12.0
"""No sea is deeper than so many kilometres: sea floors of no larger numbers may be in kilometres."""


def doubtful_below(name: str, units: str) -> float:
    """Return the magnitude (canonical units) up to which all of a field leaves the unit of its file in doubt; 0 for none."""
    if name == "depth_below_surface":
        return DEEPEST_KM * conversion(QUANTITIES[name], units, where=name)[0]
    factor = conversion(QUANTITIES[name], units, where=name)[0] if name in USUAL_MOST else 1.0
    return factor * USUAL_MOST[name] * (1.0 + 1e-6) if factor < 0.2 else 0.0


def small_unit(name: str, low: float, high: float, units: str) -> str:
    """Return a doubt about the unit of a field with values from ``low`` to ``high``; empty if there is none."""
    largest = max(-low, high)
    if not 0.0 < largest <= doubtful_below(name, units):
        return ""
    numbers = largest / conversion(QUANTITIES[name], units, where=name)[0]
    meant = {"1": "shares of 1"}.get(QUANTITIES[name].units, QUANTITIES[name].units)
    meant = "km" if name == "depth_below_surface" else meant
    return f"{name} is at most {numbers:.3g} in magnitude although the file says {units}: are these {meant}?"
