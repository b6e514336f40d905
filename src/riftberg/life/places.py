"""Places for the newly born: beside the ice that is there, and not on it.

A berg that is born on another one would be thrown by contact, or would lie within it. So it goes to the nearest place that is
free, and where there is none it waits: ice of a flux in its store, a footloose piece among the bits of its parent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.parameters import Parameters
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
        earth, ways = self._earth, []
        metric = Metric(earth.latlon, earth.radius, earth.period)
        x, y = separations(metric, self._lon, self._lat, np.array([lon]), np.array([lat]))
        apart = SLACK * np.maximum(self._reach + reach, self.distance)
        near = np.hypot(x, y) < apart + farthest
        x, y, apart = x[near], y[near], apart[near]
        for k in range(DIRECTIONS):
            angle = 2.0 * np.pi * k / DIRECTIONS
            way = _way_out(x, y, apart, float(np.cos(angle)), float(np.sin(angle)), farthest)
            if way <= farthest:
                ways.append((way, k, float(way * np.cos(angle)), float(way * np.sin(angle))))
        for _, _, dx, dy in sorted(ways):
            place = move(lon, lat, dx, dy, 1.0, earth.latlon, earth.radius)
            if allowed(*place):
                return place
        return None


def _way_out(x: Floats, y: Floats, apart: Floats, c: float, s: float, farthest: float) -> float:
    """How far (m) along (c, s) one must go to be farther than ``apart`` from each of the points (x, y)."""
    way = 0.0
    along, across = c * x + s * y, c * y - s * x
    half_chord = np.sqrt(np.maximum(apart * apart - across * across, 0.0))
    enter, leave = along - half_chord, along + half_chord
    while way <= farthest:
        inside = (half_chord > 0.0) & (enter < way) & (way < leave)
        if not inside.any():
            return way
        way = float(leave[inside].max())
    return np.inf
