"""Places for the newly born: beside the ice that is there.

One that is born on another berg would be thrown by contact. Where no place is free it waits: ice of a flux in its store, a
footloose piece among the bits of its parent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.parameters import Parameters
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import move
from riftberg.state import Elements, Floats

DIRECTIONS: Final = 16
"""Directions in which a free place is looked for."""

SLACK: Final = 1.001
"""Factor on the distance of two that do not touch: a newborn must not touch by round-off."""


def corner_reach(length: Floats | float, width: Floats | float) -> Floats:
    """Distance of the corners of an element from its centre, m: a square of its area; hexagons and discs reach less far."""
    return np.asarray(np.sqrt(0.5 * np.asarray(length) * np.asarray(width)))


class FreePlaces:
    """Where ice lies, so that newborn elements find room beside it."""

    def __init__(self, elements: Elements, p: Parameters) -> None:
        self._earth = p.earth
        self.distance = p.contact_distance
        self._lon, self._lat = elements.lon.copy(), elements.lat.copy()
        self._reach = corner_reach(elements.length, elements.width)

    def take(self, lon: float, lat: float, reach: float) -> None:
        """Count a newborn element at (lon, lat) from now on."""
        self._lon, self._lat = np.append(self._lon, lon), np.append(self._lat, lat)
        self._reach = np.append(self._reach, reach)

    def nearest(
        self, lon: float, lat: float, reach: float, allowed: Callable[[float, float], bool], farthest: float
    ) -> tuple[float, float] | None:
        """Return the free place nearest to (lon, lat) for an element whose corners are ``reach`` m away; None without any.

        Looked for along `DIRECTIONS` up to ``farthest`` m away; ``allowed(lon, lat)`` says where there is sea.
        """
        earth, candidates = self._earth, []
        metric = Metric(earth.latlon, earth.radius, earth.period)
        x, y = separations(metric, self._lon, self._lat, np.array([lon]), np.array([lat]))
        clearance = SLACK * np.maximum(self._reach + reach, self.distance)
        in_reach = np.hypot(x, y) < clearance + farthest
        x, y, clearance = x[in_reach], y[in_reach], clearance[in_reach]
        for k in range(DIRECTIONS):
            angle = 2.0 * np.pi * k / DIRECTIONS
            distance = _exit_distance(x, y, clearance, float(cos(angle)), float(sin(angle)), farthest)
            if distance <= farthest:
                candidates.append((distance, k, float(distance * cos(angle)), float(distance * sin(angle))))
        for _, _, dx, dy in sorted(candidates):
            position = move(lon, lat, dx, dy, 1.0, earth.latlon, earth.radius)
            if allowed(*position):
                return position
        return None


def _exit_distance(x: Floats, y: Floats, clearance: Floats, c: float, s: float, farthest: float) -> float:
    """Distance (m) along (c, s) at which all points (x, y) are farther than ``clearance``."""
    distance = 0.0
    along, across = c * x + s * y, c * y - s * x
    half_chord = np.sqrt(np.maximum(clearance * clearance - across * across, 0.0))
    enter, leave = along - half_chord, along + half_chord
    while distance <= farthest:
        inside = (half_chord > 0.0) & (enter < distance) & (distance < leave)
        if not inside.any():
            return distance
        distance = float(leave[inside].max())
    return np.inf
