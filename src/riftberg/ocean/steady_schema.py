"""What can be said of a uniform, steady environment, in experiment files and in Python alike."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import model_validator

from riftberg.config.sections import Pair, Section, beyond, key, refuse_beyond
from riftberg.config.values import given, native, number
from riftberg.errors import ForcingError

MOST = {"current": 10.0, "wind": 150.0, "slope": 0.01, "sea_ice": 100.0}
"""What is larger than anything in nature."""

MOST_IN_PART = {**MOST, "velocity": 10.0}
"""The same in the sections of formulas."""


class ConstantForcing(Section):
    """A uniform, steady environment."""

    kind: Literal["constant"]
    current: Pair = key((0.0, 0.0), "m s-1", "eastward and northward ocean current")
    wind: Pair = key((0.0, 0.0), "m s-1", "eastward and northward wind")
    slope: Pair = key((0.0, 0.0), "1", "eastward and northward slope of the sea surface")
    sea_ice: tuple[float, float, float] = key((0.0, 0.0, 0.0), "", "velocity (m s-1) and thickness (m) of sea ice")
    depth: float = key(1e4, "m", "depth of water", gt=0, le=1e5)

    @model_validator(mode="after")
    def _possible(self) -> ConstantForcing:
        refuse_beyond(self, MOST)
        check_sea_ice(self.sea_ice)
        return self


def steady_value(part: type[Section], name: str, value: Any) -> Any:
    """Return a value of a section without unit, or refuse it in the words that an experiment file gets."""
    plain = given(_ice_in_units(value) if name == "sea_ice" else value, part, name, kind=ForcingError)
    if name in MOST_IN_PART:
        try:
            beyond(part, name, plain, MOST_IN_PART[name])
            check_sea_ice(plain if name == "sea_ice" else (0.0, 0.0, 0.0))
        except ValueError as error:
            raise ForcingError(str(error), where=name) from error
    return plain


def _ice_in_units(value: Any) -> Any:
    """Return velocity (m s-1) and thickness (m) of sea ice, each with its own unit, as plain numbers."""
    plain = native(value)
    if not isinstance(plain, list | tuple) or len(plain) != 3:
        return plain
    units = ("m s-1", "m s-1", "m")
    return [
        number(part, unit, where="sea_ice", kind=ForcingError) if isinstance(part, str) else part
        for part, unit in zip(plain, units, strict=True)
    ]


def check_sea_ice(sea_ice: tuple[float, float, float]) -> None:
    """Raise `ValueError` if sea ice has a thickness below 0."""
    if sea_ice[2] < 0.0:
        raise ValueError(f"sea_ice has a thickness of {sea_ice[2]:g} m; it is 0 or more")
