"""How slender a berg is, and whether it has elements enough across to bend as the ice does."""

from __future__ import annotations

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.parameters import Parameters
from riftberg.state import Elements, Floats

SAG = {1: "0.5", 2: "0.6 to 0.7", 3: "0.8 to 0.9"}
"""Deflection of a free beam over that of theory by elements across, both packings; from 6 on it is above 0.92."""

ENOUGH = 6
"""Elements across from which a beam bends within 8 % of theory."""

SLENDER = 2.5
"""Length over width from which a berg bends more than it shears."""


def spread(x: Floats, y: Floats, area: Floats) -> tuple[float, float]:
    """Smallest and largest root mean square distance (m) of the ice from its centre, along a line."""
    # Each element spreads by its own width too: a twelfth of its area, as of a square about its centre.
    square = np.cov(np.vstack([x, y]), bias=True) + np.eye(2) * float(area.mean()) / 12.0
    small, large = np.sqrt(np.linalg.eigvalsh(square))
    return float(small), float(large)


def narrow_warning(elements: Elements, parameters: Parameters) -> str:
    """Return a warning where a slender berg of elastic cells is one to three elements across, else nothing."""
    p, place, body = parameters, elements.place, elements.body
    if p.stepping.scheme != "quasi_static" or p.bonds.law == "none":
        return ""
    metric, narrowest = Metric(p.earth.latlon, p.earth.radius, p.earth.period), max(SAG) + 1
    numbers, counts = np.unique(body.berg, return_counts=True)
    for number in numbers[counts >= SLENDER]:  # of fewer elements none is as slender
        members = body.berg == number
        lon, lat, area = place.lon[members], place.lat[members], body.length[members] * body.width[members]
        across, along = spread(
            *separations(metric, lon, lat, np.full_like(lon, lon[0]), np.full_like(lat, lat[0])), area
        )
        # A rectangle is as wide as the root of 12 times its spread.
        cells = round(float(np.sqrt(12.0 * across**2 / area.mean())))
        if along > SLENDER * across and cells < narrowest:
            narrowest, thinnest, width = max(cells, 1), int(number), float(np.sqrt(12.0)) * across
    if narrowest > max(SAG):
        return ""
    return (
        f"berg {thinnest} is {narrowest} element{'s' if narrowest > 1 else ''} across: with so few elastic cells it bends by "
        f"{SAG[narrowest]} of what the ice does, and its stress is as uncertain. Elements of {width / ENOUGH:.3g} m are small "
        "enough, and stepping.scheme=mts bends single rows as beams"
    )
