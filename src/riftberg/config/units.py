"""Quantities as people write them: numbers with units that are read, and places, areas and lengths of time in messages.

Input files and the command line may say ``18 kPa``, ``1.5 km``, ``30 min``, ``0.22 m/s``, ``5 nmi``, ``300 ft``. Known are
multiples of SI units that occur in iceberg modelling, and what people at sea write; a ``mile`` is the statute mile, as for
UDUNITS. The unit is checked against the one that the parameter has; a plain number is taken in that unit.
"""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import product
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
    "dm": Unit(0.1, {"m": 1}),
    "nmi": Unit(1852.0, {"m": 1}),
    "mile": Unit(1609.344, {"m": 1}),
    "ft": Unit(0.3048, {"m": 1}),
    "fathom": Unit(1.8288, {"m": 1}),
    "kg": Unit(1.0, {"kg": 1}),
    "t": Unit(1e3, {"kg": 1}),
    "g": Unit(1e-3, {"kg": 1}),
    "Mt": Unit(1e9, {"kg": 1}),
    "Gt": Unit(1e12, {"kg": 1}),
    "s": Unit(1.0, {"s": 1}),
    "min": Unit(60.0, {"s": 1}),
    "h": Unit(3600.0, {"s": 1}),
    "hour": Unit(3600.0, {"s": 1}),
    "hours": Unit(3600.0, {"s": 1}),
    "d": Unit(86400.0, {"s": 1}),
    "day": Unit(86400.0, {"s": 1}),
    "days": Unit(86400.0, {"s": 1}),
    "week": Unit(604800.0, {"s": 1}),
    "Pa": Unit(1.0, {"kg": 1, "m": -1, "s": -2}),
    "hPa": Unit(1e2, {"kg": 1, "m": -1, "s": -2}),
    "kPa": Unit(1e3, {"kg": 1, "m": -1, "s": -2}),
    "MPa": Unit(1e6, {"kg": 1, "m": -1, "s": -2}),
    "GPa": Unit(1e9, {"kg": 1, "m": -1, "s": -2}),
    "N": Unit(1.0, {"kg": 1, "m": 1, "s": -2}),
    "kN": Unit(1e3, {"kg": 1, "m": 1, "s": -2}),
    "MN": Unit(1e6, {"kg": 1, "m": 1, "s": -2}),
    "dyn": Unit(1e-5, {"kg": 1, "m": 1, "s": -2}),
    "kn": Unit(1852.0 / 3600.0, {"m": 1, "s": -1}),
    "mph": Unit(0.44704, {"m": 1, "s": -1}),
    "kph": Unit(1.0 / 3.6, {"m": 1, "s": -1}),
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

_NO_DECIMAL: Final[Mapping[str, Fraction]] = {"kn": Fraction(1852, 3600), "kph": Fraction(10, 36)}
"""Sizes that no decimal number is."""

_PREFIXES: Final = {
    "milli": "m",
    "centi": "c",
    "deci": "d",
    "": "",
    "hecto": "h",
    "kilo": "k",
    "mega": "M",
    "giga": "G",
}
_WORDS: Final[Mapping[str, str]] = {
    f"{prefix}{word}{ending}": f"{letter}{symbol}"
    for prefix, letter in _PREFIXES.items()
    for word, symbol in (
        ("metre", "m"), ("meter", "m"), ("gram", "g"), ("tonne", "t"), ("newton", "N"), ("pascal", "Pa"), ("radian", "rad")
    )
    for ending in ("", "s")
    if f"{letter}{symbol}" in _UNITS
} | {
    "second": "s", "seconds": "s", "sec": "s", "secs": "s", "minute": "min", "minutes": "min", "mins": "min",
    "hr": "h", "hrs": "h", "weeks": "week", "knot": "kn", "knots": "kn", "kt": "kn", "kts": "kn", "kmh": "kph",
    "foot": "ft", "feet": "ft", "fathoms": "fathom", "miles": "mile", "mi": "mile", "kelvin": "K",
    "celsius": "degC", "C": "degC", "dyne": "dyn",
    "percent": "%", "psu": "1e-3",
}  # fmt: skip
"""Other words for units."""

_SPACED: Final = (
    (re.compile(r"(?:\bdeg(?:rees?)?[ _]?|°)C(?:elsius)?\b", re.IGNORECASE), "degC"),
    (re.compile(r"(?:\bdeg(?:rees?)?[ _]?|°)K(?:elvin)?\b", re.IGNORECASE), "K"),
    (re.compile(r"\bNM\b|\b[Nn]autical[ _][Mm]iles?\b"), "nmi"),
)
"""Units of two words, or with a sign."""

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


def _unit_name(word: str) -> str:
    """Return the unit that a word stands for, empty for none; long words may have capitals, in symbols these have a meaning."""
    spellings = [word, word.lower()] if len(word) > 3 else [word]
    return next((name for name in (_WORDS.get(spelling, spelling) for spelling in spellings) if name in _UNITS), "")


def _alike(word: str) -> list[str]:
    """Return words for units that may have been meant by one that is none: in other case, or a long one with a slip.

    None of another magnitude: m and M are not taken for each other before a unit, nor kilo for centi.
    """
    words, lower = [*_UNITS, *_WORDS], word.lower()
    matches = [
        name
        for name in words
        if name.lower() == lower and not ({name[0], word[0]} == {"m", "M"} and name[1:] in _UNITS)
    ]
    if len(word) > 2 and not matches:
        prefix = _PREFIX.match(lower)
        long = [name for name in words if len(name) > 3 and name.startswith(prefix[0] if prefix else lower[0])]
        matches = difflib.get_close_matches(lower[:40], long, n=1, cutoff=0.85)
    return matches


_PREFIX: Final = re.compile("milli|centi|dec[ai]|deka|hecto|kilo|mega|giga|tera|peta|micro|nano|pico")


def _meant(text: str, dimensions: Sequence[Powers]) -> str:
    """Return the question whether a known unit was meant by one that is none, never one of another dimension."""
    words = re.findall("[A-Za-z]+", text)[:6]
    for names in product(*([word] if _unit_name(word) else _alike(word) for word in words)):
        candidate = text
        for word, name in zip(words, names, strict=True):
            candidate = re.sub(rf"(?<![A-Za-z]){word}(?![A-Za-z])", name, candidate)
        with suppress(ValueError):
            if candidate != text and (not dimensions or _exact(candidate)[1] in dimensions):
                return f" (did you mean {candidate[:40]!r}?)"
    return ""


def _exact(text: str, dimensions: Sequence[Powers] = ()) -> tuple[float | Fraction, Powers]:
    """Return the size of a unit, as a fraction unless a root is in it, and its powers; ``dimensions``: the ones asked for."""
    factor: float | Fraction = Fraction(1)
    powers, sign = Powers(), 1
    # Superscripts become digits, and the minus of word processors that of keyboards.
    plain = unicodedata.normalize("NFKC", text.replace("º", "°")).replace("\N{MINUS SIGN}", "-")
    for spaced, name in _SPACED:
        plain = spaced.sub(name, plain)
    plain = _PART.sub(r"^\1:\2", _ROOT.sub(r"\1^1:2", plain.replace("**", "^")))
    for piece in re.findall(r"/|[^\s/*·]+", plain):
        if piece == "/":
            sign = -1
            continue
        match = _FACTOR.match(piece)
        name = "" if match is None else _unit_name(match[1])
        if match is None or not name:
            unknown = piece if match is None else match[1]
            raise ValueError(
                f"{_brief(unknown)} is not a unit that Riftberg knows{_meant(text, dimensions)}; it knows {', '.join(_UNITS)}"
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
    alternatives = [_exact(alternative) for alternative in (unit or "1").split(" or ")]
    size, powers = _exact(match[2], [dimension for _, dimension in alternatives])
    fits = [factor for factor, dimension in alternatives if powers == dimension]
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
    """Return the extent of a box: latitudes and longitudes in degrees, or x and y (m)."""
    if not latlon:
        return f"x {west:g} to {east:g} m, y {south:g} to {north:g} m"
    # More than once round has no letters; west of Greenwich comes before east of it.
    longitudes = "all longitudes" if east - west >= 359.0 else f"{_degrees(west, 'WE')} to {_degrees(east, 'WE')}"
    return f"{_degrees(south, 'SN')} to {_degrees(north, 'SN')}, {longitudes}"


def _degrees(value: float, letters: str) -> str:
    value = (value + 180.0) % 360.0 - 180.0 if letters == "WE" and value != 180.0 else value
    return f"{abs(value):g}{f' {letters[value > 0.0]}' if value else ''}"


def drift_text(east: float, north: float) -> str:
    """Return a way (m) as a distance and a point of the compass, such as ``12.3 km north-east``."""
    metres = math.hypot(east, north)
    towards = POINTS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]
    return (
        f"{metres / 1e3:.3g} km {towards}" if metres >= 1e3 else f"{metres:.{0 if metres >= 9.5 else 2}f} m {towards}"
    )


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
