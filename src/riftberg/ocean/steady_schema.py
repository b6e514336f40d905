"""What can be said of a uniform, steady environment, in experiment files and in Python alike."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from riftberg.sections import Pair, Section, key, refuse_beyond

MOST = {"current": 10.0, "wind": 150.0, "slope": 0.01, "sea_ice": 100.0}
"""What is larger than anything in nature."""


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


def check_sea_ice(sea_ice: tuple[float, float, float]) -> None:
    """Raise `ValueError` if sea ice has a thickness below 0."""
    if sea_ice[2] < 0.0:
        raise ValueError(f"sea_ice has a thickness of {sea_ice[2]:g} m; it is 0 or more")
