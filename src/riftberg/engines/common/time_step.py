"""The time step that a run takes where none is given: chosen once, before its first step.

Half an hour errs by tens of metres a day in the strongest eddies, one hour by a hundred for large bergs and more for small ones
(`docs/explanation/numerics.md`); currents err by kilometres. So bergs that need no more take one hour, at half the cost.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.config.usual_ranges import changes_in_time
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.fragments.tree import equivalent_rectangles
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import USUAL_STEP, Parameters
from riftberg.state import Bonds, Elements

LONG_STEP: Final = 3600.0
"""Time step (s) where every berg is long."""

LONG_BERG: Final = 10e3
"""Longest side (m) from which a berg is long."""


class StepLimit(NamedTuple):
    """The longest time step that serves a run."""

    seconds: float
    reason: str  # Why it is no longer

    def divide(self, interval: float) -> StepLimit:
        """Return the longest step up to this limit of which a whole number makes an interval (s)."""
        step = interval / math.ceil(interval / self.seconds * (1.0 - 1e-9))
        return self if step == self.seconds else StepLimit(step, f"it divides {interval / 3600.0:g} h; {self.reason}")


def longest_time_step(elements: Elements, bonds: Bonds, forcing: Forcing, parameters: Parameters) -> StepLimit:
    """Return the longest time step that the bergs and the forcing allow.

    ``elements``: all of the run, with those that come later.
    """
    longest, reason = USUAL_STEP, "half an hour serves bergs of any size"
    if parameters.stepping.scheme == "quasi_static" and _shortest_berg(elements, bonds, parameters) >= LONG_BERG:
        longest, reason = LONG_STEP, f"one hour serves bergs of {LONG_BERG / 1e3:g} km or more"
    for change, seconds, step in changes_in_time(forcing):
        if step < longest:
            longest, reason = step, f"it follows {change} {seconds / 3600.0:.4g} h"
    return StepLimit(longest, reason)


def _shortest_berg(elements: Elements, bonds: Bonds, parameters: Parameters) -> float:
    """Return the longest side (m) of the shortest berg; 0 where there are none."""
    if elements.size == 0:
        return 0.0
    body, earth = elements.body, parameters.earth
    component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    length, _ = equivalent_rectangles(
        elements.lon, elements.lat, body.length, body.width, component, int(component.max()) + 1, earth.latlon, earth.radius,
        earth.period,
    )  # fmt: skip
    return float(np.min(length))
