"""What can be said of the ready-made formulas, in experiment files and in Python alike: kinds, units, limits."""

from __future__ import annotations

from typing import Any, Final

from riftberg.config.sections import ICE_UNITS, PLACE, Pair, Position, SeaIce, Section, Velocity, Wind, key
from riftberg.config.values import flag, given
from riftberg.errors import ForcingError
from riftberg.ocean.steady_schema import steady_value
from riftberg.parameters import Earth

M2: Final = 12.4206012 * 3600.0
"""Period of the principal lunar tide, s."""

_CENTRE = "longitude and latitude (x and y in m where positions are metres)"
_TOWARDS = "direction, clockwise from north: 90 is eastward"


class UniformPart(Section):
    """The same current, wind and sea ice everywhere."""

    current: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward ocean current, in geostrophic balance")
    wind: Wind = key((0.0, 0.0), "m s-1", "eastward and northward wind")
    sea_ice: SeaIce = key((0.0, 0.0, 0.0), "", "velocity (m s-1) and thickness (m) of sea ice", extra=ICE_UNITS)
    depth: float | None = key(None, "m", "depth of water", gt=0, le=1e5)


class EddyPart(Section):
    """A round eddy, which may travel."""

    centre: Position = key(..., "degree", _CENTRE, **PLACE)
    radius: float = key(..., "m", "distance of the fastest water from the centre", gt=0)
    speed: float = key(..., "m s-1", "its speed, positive counter-clockwise", ge=-10, le=10)
    velocity: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward velocity of the centre")


class JetPart(Section):
    """A straight jet."""

    point: Position = key(..., "degree", "a point of its middle, " + _CENTRE, **PLACE)
    towards: float = key(..., "degree", _TOWARDS)
    speed: float = key(..., "m s-1", "speed in the middle", ge=-10, le=10)
    width: float = key(..., "m", "scale of the profile across", gt=0)


class ShearPart(JetPart):
    """A shear layer: water flows one way on the left of a line, the other way on its right."""


class FrontPart(Section):
    """A step of the sea surface across a line, with the current along it."""

    point: Position = key(..., "degree", "a point of the line, " + _CENTRE, **PLACE)
    along: float = key(..., "degree", "direction of the line, clockwise from north")
    step: float = key(..., "m", "sea level on the left of the line above that on its right", ge=-10, le=10)
    width: float = key(..., "m", "scale of the profile across", gt=0)
    temperature: Pair | None = key(None, "degC", "temperature of the water on the left and on the right")


class TidePart(Section):
    """A tidal current, the same everywhere."""

    major: float = key(..., "m s-1", "largest speed", ge=0, le=10)
    minor: float = key(0.0, "m s-1", "smallest speed, positive turns counter-clockwise", ge=-10, le=10)
    towards: float = key(90.0, "degree", "direction of the largest speed, clockwise from north")
    period: float = key(M2, "s", "period; M2 by default", gt=0)
    phase: float = key(0.0, "degree", "part of the period after the start at which the speed is largest")


class SeamountPart(Section):
    """A bell on the sea floor."""

    centre: Position = key(..., "degree", _CENTRE, **PLACE)
    height: float = key(..., "m", "height of the summit above the plain", ge=-1e4, le=1e4)
    width: float = key(..., "m", "standard deviation of the bell", gt=0)
    depth: float = key(..., "m", "depth of the plain", gt=0, le=1e5)


class SlopePart(Section):
    """A sea floor that deepens steadily in one direction."""

    point: Position = key(..., "degree", "where the water is as deep as told, " + _CENTRE, **PLACE)
    towards: float = key(..., "degree", "direction in which it deepens, clockwise from north")
    gradient: float = key(..., "1", "metres of depth per metre", ge=-1, le=1)
    depth: float = key(..., "m", "depth at that point", gt=0, le=1e5)
    between: Pair = key((1.0, 5000.0), "m", "least and largest depth")


class TurningWindPart(Section):
    """A wind whose direction turns steadily."""

    speed: float = key(..., "m s-1", "speed", ge=0, le=150)
    towards: float = key(90.0, "degree", "direction to which it blows at the start, clockwise from north")
    turning: float = key(15.0, "degree h-1", "how fast it turns, positive clockwise")


def checked(part: type[Section], latlon: bool | None, **values: Any) -> list[Any]:
    """Return values of a formula without units, or refuse them in the words that an experiment file gets."""
    metres = latlon is False
    return [None if value is None else steady_value(part, name, value, metres=metres) for name, value in values.items()]


def checked_latlon(latlon: Any) -> bool:
    """Return whether positions are degrees."""
    return flag(latlon, where="latlon", kind=ForcingError)


def checked_latitude(latitude: Any) -> Any:
    """Return the latitude (degrees) of a Coriolis parameter, or None where it is that of each place."""
    return (
        None if latitude is None else given(latitude, Earth, "reference_latitude", where="latitude", kind=ForcingError)
    )
