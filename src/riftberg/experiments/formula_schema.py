"""What an experiment file may say about forcing by formula (section ``forcing``, ``kind: formula``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from pydantic import model_validator

from riftberg.ocean import formulas
from riftberg.sections import Pair, Section, key

_CENTRE = "longitude and latitude (x and y in m where positions are metres)"
_TOWARDS = "direction, clockwise from north: 90 is eastward"


class UniformPart(Section):
    """The same current, wind and sea ice everywhere."""

    current: Pair = key((0.0, 0.0), "m s-1", "eastward and northward ocean current, in geostrophic balance")
    wind: Pair = key((0.0, 0.0), "m s-1", "eastward and northward wind")
    sea_ice: tuple[float, float, float] = key((0.0, 0.0, 0.0), "", "velocity (m s-1) and thickness (m) of sea ice")
    depth: float | None = key(None, "m", "depth of water", gt=0, le=1e5)


class EddyPart(Section):
    """A round eddy, which may travel."""

    centre: Pair = key(..., "degree", _CENTRE)
    radius: float = key(..., "m", "distance of the fastest water from the centre", gt=0)
    speed: float = key(..., "m s-1", "its speed, positive counter-clockwise", ge=-10, le=10)
    velocity: Pair = key((0.0, 0.0), "m s-1", "eastward and northward velocity of the centre")


class JetPart(Section):
    """A straight jet."""

    point: Pair = key(..., "degree", "a point of its middle, " + _CENTRE)
    towards: float = key(..., "degree", _TOWARDS)
    speed: float = key(..., "m s-1", "speed in the middle", ge=-10, le=10)
    width: float = key(..., "m", "scale of the profile across", gt=0)


class ShearPart(JetPart):
    """A shear layer: water flows one way on the left of a line, the other way on its right."""


class FrontPart(Section):
    """A step of the sea surface across a line, with the current along it."""

    point: Pair = key(..., "degree", "a point of the line, " + _CENTRE)
    along: float = key(..., "degree", "direction of the line, clockwise from north")
    step: float = key(..., "m", "sea level on the left of the line above that on its right", ge=-10, le=10)
    width: float = key(..., "m", "scale of the profile across", gt=0)
    temperature: Pair | None = key(None, "", "temperature of the water on the left and on the right, degrees Celsius")


class TidePart(Section):
    """A tidal current, the same everywhere."""

    major: float = key(..., "m s-1", "largest speed", ge=0, le=10)
    minor: float = key(0.0, "m s-1", "smallest speed, positive turns counter-clockwise", ge=-10, le=10)
    towards: float = key(90.0, "degree", "direction of the largest speed, clockwise from north")
    period: float = key(formulas.Tide.M2, "s", "period; M2 by default", gt=0)
    phase: float = key(0.0, "degree", "part of the period after the start at which the speed is largest")


class SeamountPart(Section):
    """A bell on the sea floor."""

    centre: Pair = key(..., "degree", _CENTRE)
    height: float = key(..., "m", "height of the summit above the plain", ge=-1e4, le=1e4)
    width: float = key(..., "m", "standard deviation of the bell", gt=0)
    depth: float = key(..., "m", "depth of the plain", gt=0, le=1e5)


class SlopePart(Section):
    """A sea floor that deepens steadily in one direction."""

    point: Pair = key(..., "degree", "where the water is as deep as told, " + _CENTRE)
    towards: float = key(..., "degree", "direction in which it deepens, clockwise from north")
    gradient: float = key(..., "1", "metres of depth per metre", ge=-1, le=1)
    depth: float = key(..., "m", "depth at that point", gt=0, le=1e5)
    between: Pair = key((1.0, 5000.0), "m", "least and largest depth")


class TurningWindPart(Section):
    """A wind whose direction turns steadily."""

    speed: float = key(..., "m s-1", "speed", ge=0, le=150)
    towards: float = key(90.0, "degree", "direction to which it blows at the start, clockwise from north")
    turning: float = key(15.0, "", "degrees per hour, positive clockwise")


class FormulaForcing(Section):
    """Forcing by formulas, which are added."""

    kind: Literal["formula"]
    uniform: UniformPart | None = None
    eddy: list[EddyPart] = key([], "", "eddies, a list of sections")
    jet: list[JetPart] = key([], "", "jets, a list of sections")
    shear: list[ShearPart] = key([], "", "shear layers, a list of sections")
    front: list[FrontPart] = key([], "", "fronts, a list of sections")
    tide: list[TidePart] = key([], "", "tides, a list of sections")
    seamount: list[SeamountPart] = key([], "", "seamounts, a list of sections; the shallowest sea floor counts")
    slope: list[SlopePart] = key([], "", "sloping sea floors, a list of sections")
    turning_wind: list[TurningWindPart] = key([], "", "winds that turn, a list of sections")

    @model_validator(mode="after")
    def _something(self) -> FormulaForcing:
        if not self.model_fields_set - {"kind"}:
            raise ValueError(f"no formula is given; give one or more of {', '.join(_CLASSES)}")
        return self


_CLASSES: dict[str, Callable[..., formulas.Formula]] = {
    "uniform": formulas.Uniform,
    "eddy": formulas.Eddy,
    "jet": formulas.Jet,
    "shear": formulas.Shear,
    "front": formulas.Front,
    "tide": formulas.Tide,
    "seamount": formulas.Seamount,
    "slope": formulas.Slope,
    "turning_wind": formulas.TurningWind,
}


def formula_parts() -> list[tuple[str, type[Section]]]:
    """Return the sections of the formulas by name, for the documentation."""
    parts = (UniformPart, EddyPart, JetPart, ShearPart, FrontPart, TidePart, SeamountPart, SlopePart, TurningWindPart)
    return list(zip(_CLASSES, parts, strict=True))


def sum_of(forcing: FormulaForcing, *, latlon: bool, latitude: float | None) -> formulas.Sum:
    """Return the forcing that a section describes.

    Parameters
    ----------
    forcing : FormulaForcing
    latlon : bool
        Positions are degrees.
    latitude : float or None
        Latitude (degrees) of the Coriolis parameter; None for that of each place.
    """
    parts = []
    for name, kind in _CLASSES.items():
        value = getattr(forcing, name)
        for section in value if isinstance(value, list) else [value] if value is not None else []:
            values: dict[str, Any] = {k: v for k, v in section.model_dump().items() if v is not None}
            parts.append(kind(**values, latlon=latlon, latitude=latitude))
    return formulas.Sum(parts)
