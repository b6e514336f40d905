"""Quantities as people write them: numbers with units that are read, and places, areas and lengths of time in messages.

Input files and the command line may say ``18 kPa``, ``1.5 km``, ``30 min``, ``0.22 m/s``. Only multiples of SI units that
occur in iceberg modelling are known. The unit is checked against the one that the parameter has; a plain number is taken
in that unit.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Final, NamedTuple

Powers = dict[str, Fraction]


class Unit(NamedTuple):
    """A unit: size in base units and powers of these (m, kg, s, K, degC, degree)."""

    factor: float
    powers: Mapping[str, int | Fraction]


_UNITS: Final[Mapping[str, Unit]] = {
    "m": Unit(1.0, {"m": 1}),
    "km": Unit(1e3, {"m": 1}),
    "cm": Unit(1e-2, {"m": 1}),
    "mm": Unit(1e-3, {"m": 1}),
    "nmi": Unit(1852.0, {"m": 1}),
    "kg": Unit(1.0, {"kg": 1}),
    "t": Unit(1e3, {"kg": 1}),
    "g": Unit(1e-3, {"kg": 1}),
    "Gt": Unit(1e12, {"kg": 1}),
    "s": Unit(1.0, {"s": 1}),
    "min": Unit(60.0, {"s": 1}),
    "h": Unit(3600.0, {"s": 1}),
    "hour": Unit(3600.0, {"s": 1}),
    "hours": Unit(3600.0, {"s": 1}),
    "d": Unit(86400.0, {"s": 1}),
    "day": Unit(86400.0, {"s": 1}),
    "days": Unit(86400.0, {"s": 1}),
    "Pa": Unit(1.0, {"kg": 1, "m": -1, "s": -2}),
    "hPa": Unit(1e2, {"kg": 1, "m": -1, "s": -2}),
    "kPa": Unit(1e3, {"kg": 1, "m": -1, "s": -2}),
    "MPa": Unit(1e6, {"kg": 1, "m": -1, "s": -2}),
    "GPa": Unit(1e9, {"kg": 1, "m": -1, "s": -2}),
    "N": Unit(1.0, {"kg": 1, "m": 1, "s": -2}),
    "kN": Unit(1e3, {"kg": 1, "m": 1, "s": -2}),
    "kn": Unit(1852.0 / 3600.0, {"m": 1, "s": -1}),
    "rad": Unit(57.29577951308232, {"degree": 1}),
    "deg": Unit(1.0, {"degree": 1}),
    "degree": Unit(1.0, {"degree": 1}),
    "degrees": Unit(1.0, {"degree": 1}),
    "°": Unit(1.0, {"degree": 1}),
    "K": Unit(1.0, {"K": 1}),
    "degC": Unit(1.0, {"degC": 1}),
    "1": Unit(1.0, {}),
    "1e-3": Unit(1e-3, {}),
    "%": Unit(1e-2, {}),
}

_NO_DECIMAL: Final[Mapping[str, Fraction]] = {"kn": Fraction(1852, 3600)}
"""Sizes that no decimal number is."""

_WORDS: Final[Mapping[str, str]] = {
    "metre": "m", "metres": "m", "meter": "m", "meters": "m",
    "kilometre": "km", "kilometres": "km", "kilometer": "km", "kilometers": "km",
    "second": "s", "seconds": "s", "sec": "s", "minute": "min", "minutes": "min", "hr": "h", "hrs": "h",
    "tonne": "t", "tonnes": "t", "knot": "kn", "knots": "kn", "°C": "degC", "degree_Celsius": "degC",
    "percent": "%", "psu": "1e-3",
}  # fmt: skip
"""Other words for units."""

_NUMBER: Final = re.compile(r"\s*([+\N{MINUS SIGN}-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+\N{MINUS SIGN}-]?\d+)?)\s*(.*?)\s*$")
_FACTOR: Final = re.compile(r"([A-Za-z_°%]+|1e-3|1)\^?([+-]?\d+(?:[.:]\d+)?)?$")
_ROOT: Final = re.compile(r"sqrt\(([A-Za-z]+)\)")
_PART: Final = re.compile(r"(?<=[A-Za-z])\^?\(?([+-]?\d+)/(\d+)\)?")
"""A power that is a fraction, such as that of m1/2, which the slash of m/s must not be taken for."""


def _brief(text: str) -> str:
    return repr(text if len(text) <= 60 else f"{text[:56]} ...")


def parse_unit(text: str) -> Unit:
    """Read a unit such as ``kg m-3``, ``m/s`` or ``kPa``."""
    factor, powers = _exact(text)
    return Unit(float(factor), powers)


def _exact(text: str) -> tuple[float | Fraction, Powers]:
    """Return the size of a unit, as a fraction unless a root is in it, and its powers."""
    factor: float | Fraction = Fraction(1)
    powers, sign = Powers(), 1
    plain = _PART.sub(r"^\1:\2", _ROOT.sub(r"\1^1:2", text.replace("**", "^")))
    for piece in re.findall(r"/|[^\s/*·]+", plain):
        if piece == "/":
            sign = -1
            continue
        match = _FACTOR.match(piece)
        name = "" if match is None else _WORDS.get(match[1], match[1])
        if match is None or name not in _UNITS:
            unknown = piece if match is None else match[1]
            close = difflib.get_close_matches(unknown, [*_UNITS, *_WORDS], n=1)
            meant = f" (did you mean {close[0]!r}?)" if close else ""
            raise ValueError(
                f"{_brief(unknown)} is not a unit that Riftberg knows{meant}; it knows {', '.join(_UNITS)}"
            )
        # A power is 2, -1, 0.5, or 1:2 for a half.
        over, _, under = (stated := match[2] or "1").partition(":")
        if len(stated) > 6 or (under and int(under) == 0) or abs(power := Fraction(over) / int(under or 1)) > 9:
            raise ValueError(f"{piece[:40]!r} is no power of a unit")
        power *= sign
        unit = _UNITS[name]
        size = _NO_DECIMAL.get(name) or Fraction(str(unit.factor))
        factor *= size ** int(power) if power.denominator == 1 else float(size) ** float(power)
        for base, exponent in unit.powers.items():
            powers[base] = powers.get(base, Fraction(0)) + exponent * power
    return factor, {base: power for base, power in powers.items() if power}


def to_unit(text: str, unit: str) -> float:
    """Return the number that ``text`` means in ``unit``.

    Examples
    --------
    >>> to_unit("18 kPa", "Pa"), to_unit("30 min", "s"), to_unit("5e6", "Pa")
    (18000.0, 1800.0, 5000000.0)

    """
    match = _NUMBER.match(text)
    if match is None:
        raise ValueError(f"{_brief(text)} is not a number")
    digits = match[1].replace("\N{MINUS SIGN}", "-")
    number = float(digits)
    if not match[2]:
        return number
    size, powers = _exact(match[2])
    fits = [wanted for wanted, asked in map(_exact, (unit or "1").split(" or ")) if powers == asked]
    if not fits:
        raise ValueError(f"{_brief(text)} is in {match[2][:40]}, but this is measured in {unit or 'no unit'}")
    factor = size / fits[0]
    if isinstance(factor, Fraction) and 1e-100 < abs(number) < 1e100:
        return float(Fraction(digits) * factor)  # 5 mm is 0.005 m, exactly as a reader would write it
    return number * float(factor)


def looks_like_quantity(text: str) -> bool:
    """Whether a text begins with a number."""
    return _NUMBER.match(text) is not None


POINTS: Final = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def place_text(lon: float, lat: float, *, latlon: bool, digits: int = 3) -> str:
    """Return a place such as ``55.02 S, 37.56 W``, or x and y of a Cartesian run in that order.

    ``lon``, ``lat``: degrees (a longitude on any turn), or x and y in m.
    """
    if latlon:
        lon = (lon + 180.0) % 360.0 - 180.0
        sides = "S" if lat < 0.0 else "N", "W" if lon < 0.0 else "E"
        return f"{abs(lat):.{digits}f} {sides[0]}, {abs(lon):.{digits}f} {sides[1]}"
    if max(abs(lon), abs(lat)) < 1e4:
        return f"x {lon:.6g} m, y {lat:.6g} m"
    return f"x {lon / 1e3:.6g} km, y {lat / 1e3:.6g} km"


def box_text(west: float, east: float, south: float, north: float, *, latlon: bool = True) -> str:
    """Return what a box covers: latitudes and longitudes in degrees, or x and y (m)."""
    if not latlon:
        return f"x {west:g} to {east:g} m, y {south:g} to {north:g} m"
    # More than once round has no letters; west of Greenwich comes before east of it.
    around = "all longitudes" if east - west >= 359.0 else f"{_degrees(west, 'WE')} to {_degrees(east, 'WE')}"
    return f"{_degrees(south, 'SN')} to {_degrees(north, 'SN')}, {around}"


def _degrees(value: float, letters: str) -> str:
    value = (value + 180.0) % 360.0 - 180.0 if letters == "WE" and value != 180.0 else value
    return f"{abs(value):g}{f' {letters[value > 0.0]}' if value else ''}"


def drift_text(east: float, north: float) -> str:
    """Return a way (m) as a distance and a point of the compass, such as ``12.3 km north-east``."""
    metres = math.hypot(east, north)
    towards = POINTS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]
    return f"{metres / 1e3:.3g} km {towards}" if metres >= 1e3 else f"{metres:.0f} m {towards}"


def area_text(area: float, *, squared: str = "2") -> str:
    """Return an area (m2) in km2, or in m2 where that is less than a hectare; ``squared`` is how the power is written."""
    km2 = area / 1e6
    if km2 >= 9.5:
        return f"{km2:,.0f} km{squared}" if squared != "2" else f"{km2:.0f} km{squared}"
    return f"{km2:.2g} km{squared}" if km2 >= 0.01 or area <= 0.0 else f"{area:.3g} m{squared}"


_LARGER: Final = {"Pa": (("MPa", 1e6), ("kPa", 1e3)), "m": (("km", 1e3),), "s": (("day", 86_400.0), ("h", 3600.0))}
"""Units in which people write large numbers, the largest first."""


def quantity_text(value: float, unit: str) -> str:
    """Return a number with its unit as people write it: ``16 kPa``, ``50 km``, ``3 day``; small numbers stay as they are."""
    for larger, factor in _LARGER.get(unit, ()):
        if abs(value) >= factor:
            return f"{value / factor:.6g} {larger}"
    return f"{value:.6g}" + ("" if unit in ("", "1") else f" {unit}")


def minute_text(moment: Any) -> str:
    """Return a date and time, ISO text or of NumPy, to the minute, as it stands in tables and titles."""
    return str(moment).replace("T", " ")[:16]


def count_text(number: int, thing: str) -> str:
    """Return how many of a thing there are: ``1 bond``, ``3 bonds``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def duration_text(days: float) -> str:
    """Return a length of time (days) in the unit that suits it: ``17 days``, ``8.33 h``, ``10 s``."""
    seconds = 86_400.0 * days
    if seconds >= 86_400.0 * 0.999:
        return f"{days:g} day" + ("s" if days != 1.0 else "")
    if seconds >= 3.0 * 3600.0:
        return f"{seconds / 3600.0:.3g} h"
    return f"{seconds / 60.0:.3g} min" if seconds > 180.0 else f"{seconds:.3g} s"
