"""Numbers with units in input files and on the command line: ``18 kPa``, ``1.5 km``, ``30 min``, ``0.22 m/s``.

Only multiples of SI units that occur in iceberg modelling are known. The unit is checked against the one that the
parameter has; a plain number is taken in that unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

Powers = dict[str, int]


class Unit(NamedTuple):
    """A unit: size in base units and powers of these (m, kg, s, K, degree)."""

    factor: float
    powers: Powers


_UNITS: Final[Mapping[str, Unit]] = {
    "m": Unit(1.0, {"m": 1}),
    "km": Unit(1e3, {"m": 1}),
    "cm": Unit(1e-2, {"m": 1}),
    "mm": Unit(1e-3, {"m": 1}),
    "nmi": Unit(1852.0, {"m": 1}),
    "kg": Unit(1.0, {"kg": 1}),
    "t": Unit(1e3, {"kg": 1}),
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
    "1": Unit(1.0, {}),
    "%": Unit(1e-2, {}),
}

_NUMBER: Final = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
_FACTOR: Final = re.compile(r"([A-Za-z°%]+|1)(?:\^|\*\*)?([+-]?\d+)?$")


def _brief(text: str) -> str:
    return repr(text if len(text) <= 60 else f"{text[:56]} ...")


def parse_unit(text: str) -> Unit:
    """Read a unit such as ``kg m-3``, ``m/s`` or ``kPa``.

    Raises
    ------
    ValueError
        If a part of it is not known.
    """
    factor, powers, sign = 1.0, dict[str, int](), 1
    for piece in re.findall(r"/|[^\s/*·]+", text.replace("**", "^")):
        if piece == "/":
            sign = -1
            continue
        match = _FACTOR.match(piece)
        if match is None or match[1] not in _UNITS:
            raise ValueError(f"{_brief(piece)} is not a unit that Riftberg knows; it knows {', '.join(_UNITS)}")
        if len(match[2] or "") > 3:
            raise ValueError(f"{piece[:40]!r} is no power of a unit")
        power = sign * int(match[2] or 1)
        unit = _UNITS[match[1]]
        if abs(power) > 9:
            raise ValueError(f"{piece[:40]!r} is no power of a unit")
        factor *= unit.factor**power
        for base, exponent in unit.powers.items():
            powers[base] = powers.get(base, 0) + exponent * power
    return Unit(factor, {base: power for base, power in powers.items() if power})


def to_unit(text: str, unit: str) -> float:
    """Return the number that ``text`` means in ``unit``.

    Parameters
    ----------
    text : str
        A number, with or without a unit.
    unit : str
        Unit of the parameter; empty or ``"1"`` where it has none.

    Raises
    ------
    ValueError
        If it is not a number, or its unit measures something else.

    Examples
    --------
    >>> to_unit("18 kPa", "Pa"), to_unit("30 min", "s"), to_unit("5e6", "Pa")
    (18000.0, 1800.0, 5000000.0)
    """
    match = _NUMBER.match(text)
    if match is None:
        raise ValueError(f"{_brief(text)} is not a number")
    number = float(match[1])
    if not match[2]:
        return number
    pair, wanted = parse_unit(match[2]), parse_unit(unit or "1")
    if pair.powers != wanted.powers:
        raise ValueError(f"{_brief(text)} is in {match[2][:40]}, but this is measured in {unit or 'no unit'}")
    # Divide where the factor is below one: 5 mm is 5/1000 m exactly as a reader would write it.
    factor = pair.factor / wanted.factor
    return number * factor if factor >= 1.0 else number / (wanted.factor / pair.factor)


def looks_like_quantity(text: str) -> bool:
    """Whether a text begins with a number."""
    return _NUMBER.match(text) is not None
