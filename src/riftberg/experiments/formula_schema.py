"""What an experiment file may say about forcing by formula (section ``forcing``, ``kind: formula``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from pydantic import model_validator

from riftberg.config.sections import Section, key
from riftberg.ocean import formulas
from riftberg.ocean.formula_schema import (
    EddyPart,
    FrontPart,
    JetPart,
    SeamountPart,
    ShearPart,
    SlopePart,
    TidePart,
    TurningWindPart,
    UniformPart,
)


class FormulaForcing(Section):
    """Forcing by formulas, which are added; each may be a section or a list of sections."""

    kind: Literal["formula"]
    uniform: list[UniformPart] = key([], "", "the same everywhere, a section or a list of sections")
    eddy: list[EddyPart] = key([], "", "eddies, a section or a list of sections")
    jet: list[JetPart] = key([], "", "jets, a section or a list of sections")
    shear: list[ShearPart] = key([], "", "shear layers, a section or a list of sections")
    front: list[FrontPart] = key([], "", "fronts, a section or a list of sections")
    tide: list[TidePart] = key([], "", "tides, a section or a list of sections")
    seamount: list[SeamountPart] = key(
        [], "", "seamounts, a section or a list of sections; the shallowest sea floor counts"
    )
    slope: list[SlopePart] = key([], "", "sloping sea floors, a section or a list of sections")
    turning_wind: list[TurningWindPart] = key([], "", "winds that turn, a section or a list of sections")

    @model_validator(mode="after")
    def _something(self) -> FormulaForcing:
        if not any(getattr(self, name) for name in _CLASSES):
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

    ``latitude``: latitude (degrees) of the Coriolis parameter.
    """
    parts = []
    for name, kind in _CLASSES.items():
        for section in getattr(forcing, name):
            values: dict[str, Any] = {k: v for k, v in section.model_dump().items() if v is not None}
            parts.append(kind(**values, latlon=latlon, latitude=latitude))
    return formulas.Sum(parts)
