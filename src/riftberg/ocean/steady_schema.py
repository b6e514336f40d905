"""What can be said of a uniform, steady environment, in experiment files and in Python alike."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from riftberg.config.sections import ICE_UNITS, Pair, SeaIce, Section, Velocity, Wind, at_most, key
from riftberg.config.values import given
from riftberg.errors import ForcingError


class ConstantForcing(Section):
    """A uniform, steady environment."""

    kind: Literal["constant"]
    current: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward ocean current")
    wind: Wind = key((0.0, 0.0), "m s-1", "eastward and northward wind")
    # A metre in a hundred: 1e-5 is steep for a current.
    slope: Annotated[Pair, at_most(0.01, "m m-1")] = key(
        (0.0, 0.0), "1", "eastward and northward slope of the sea surface"
    )
    sea_ice: SeaIce = key((0.0, 0.0, 0.0), "", "velocity (m s-1) and thickness (m) of sea ice", **ICE_UNITS)
    depth: float = key(1e4, "m", "depth of water", gt=0, le=1e5)


def steady_value(part: Any, name: str, value: Any, *, metres: bool = False) -> Any:
    """Return a value of a section without unit, or refuse it in the words that an experiment file gets."""
    return given(value, part, name, kind=ForcingError, metres=metres)
