"""Whether the stress in the bonds of a run rings, because its slow forces act in two kicks of a long step."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.config.places import duration_text
from riftberg.constants import SECONDS_PER_DAY
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Elements, Floats

STEADY: Final = 12.0
"""Long steps in a swing of the berg from which on the stress is within 1 kPa of that in equilibrium (numerics page)."""

CALM: Final = 24.0
"""Long steps in a swing that are chosen where none is named: what rings goes with the square of the step."""

LONG_STEPS: Final = tuple(1800.0 / n for n in (1, 2, 3, 4, 5, 6, 8, 9, 10, 12, 15, 18, 20, 24, 25, 30))
"""Long steps (s) to choose from, longest first: parts of half an hour, so that records every hour fall on them."""

FIRST_MODE: Final = 22.373
"""Square of the first eigenvalue of a free beam, ``cos(k) cosh(k) = 1``."""


def swing(elements: Elements, parameters: Parameters) -> float:
    """Return the period (s) in which the largest berg swings when it bends in its plane.

    That of a free beam with the spread of the berg along and across, ``T = 2 pi / 22.4 L^2 sqrt(rho A / (E I))`` with
    ``L^2 = 12 s1^2`` and ``I / A = s2^2``. It says how long, not more: a compact berg is no beam, and shears too.
    """
    p, place = parameters, elements.place
    numbers, counts = np.unique(elements.berg, return_counts=True)
    own = elements.berg == numbers[counts.argmax()]
    lon, lat = place.lon[own], place.lat[own]
    metric = Metric(p.earth.latlon, p.earth.radius, p.earth.period)
    x, y = separations(metric, lon, lat, np.full_like(lon, lon[0]), np.full_like(lat, lat[0]))
    across, along = _spread(x, y, elements.body.length[own] * elements.body.width[own])
    speed = math.sqrt(p.bonds.youngs_modulus / p.ice.density)
    return 2.0 * math.pi / FIRST_MODE * 12.0 * along**2 / (speed * across) if speed > 0.0 else math.inf


def _spread(x: Floats, y: Floats, area: Floats) -> tuple[float, float]:
    """Smallest and largest root mean square distance (m) of the ice from its centre, along a line."""
    square = np.cov(np.vstack([x, y]), bias=True) + np.eye(2) * float(area.mean()) / 12.0
    small, large = np.sqrt(np.linalg.eigvalsh(square))
    return float(small), float(large)


def ringing(elements: Elements, bonds: Bonds, parameters: Parameters) -> str:
    """Return what to know of the stress in the bonds of a run, empty where there is nothing.

    Between two kicks no drag and no slope act on a lattice that was bent under them, so it swings by as much, and by
    more where a swing takes a whole number of steps.
    """
    p = parameters
    period = swing(elements, p) if _may_ring(bonds, p) else math.inf
    if p.stepping.time_step * STEADY <= period:
        return ""
    breaks = ", so bonds may break that would hold" if p.fracture.enabled else ""
    return (
        f"the stress in the bonds rings: water and air push in two kicks of each long step of {p.stepping.time_step:g} s, "
        f"which is long beside the {duration_text(period / SECONDS_PER_DAY)} of a swing of the berg{breaks}. "
        "stepping.scheme=quasi_static gives the stress that the ice has to bear"
    )


def with_steady_step(elements: Elements, bonds: Bonds, parameters: Parameters) -> Parameters:
    """Return the parameters with a long step with which the stress in the bonds does not ring, where they name none.

    It is the longest of `LONG_STEPS` that has `CALM` of its kind in a swing of the largest berg, and the shortest of them
    where none has. A long step that is named, or a number of sub-steps in it, stays as it is.
    """
    p = parameters
    named = "time_step" in p.stepping.model_fields_set or p.stepping.substeps is not None
    if named or not _may_ring(bonds, p):
        return p
    period = swing(elements, p)
    step = next((step for step in LONG_STEPS if step * CALM <= period), LONG_STEPS[-1])
    return p.changed(stepping={"time_step": step})


def _may_ring(bonds: Bonds, p: Parameters) -> bool:
    """Whether long kicks act on bonds that hold; the reference's numerics are asked for as they are."""
    s = p.stepping
    pushed = not (s.only_interactions or s.frozen or s.fixed_velocity)
    explicit = s.scheme == "mts" and p.bonds.law == "dem" and not p.compatibility.zero_start
    return explicit and pushed and bool((bonds.status == 0).any())
