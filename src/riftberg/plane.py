"""A conformal plane for pictures: squares stay square and north stays north wherever the berg is, poles included.

Stereographic projection from the point opposite the centre of the run (Snyder 1987, USGS PP 1395, equations 21-2 to
21-5); lengths are true at the centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from riftberg.state import Floats


@dataclass(frozen=True)
class Plane:
    """Stereographic plane that touches the sphere at ``(lon0, lat0)``; the identity for positions in metres.

    Attributes
    ----------
    lon0, lat0 : float
        Point of contact, degrees (metres where ``latlon`` is false).
    radius : float
        Radius of the sphere, m.
    latlon : bool
        Positions are degrees.
    """

    lon0: float
    lat0: float
    radius: float
    latlon: bool = True

    def forward(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return metres east and north of the point of contact, on the plane."""
        if not self.latlon:
            return np.asarray(lon) - self.lon0, np.asarray(lat) - self.lat0
        a, b, b0 = np.radians(np.asarray(lon) - self.lon0), np.radians(lat), np.radians(self.lat0)
        k = 2.0 * self.radius / (1.0 + np.sin(b0) * np.sin(b) + np.cos(b0) * np.cos(b) * np.cos(a))
        return k * np.cos(b) * np.sin(a), k * (np.cos(b0) * np.sin(b) - np.sin(b0) * np.cos(b) * np.cos(a))

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude of points of the plane."""
        if not self.latlon:
            return np.asarray(x) + self.lon0, np.asarray(y) + self.lat0
        b0 = np.radians(self.lat0)
        rho = np.hypot(x, y)
        c = 2.0 * np.arctan2(rho, 2.0 * self.radius)
        # At the point of contact the direction does not matter.
        safe = np.where(rho == 0.0, 1.0, rho)
        lat = np.arcsin(np.clip(np.cos(c) * np.sin(b0) + np.asarray(y) * np.sin(c) * np.cos(b0) / safe, -1.0, 1.0))
        lon = np.arctan2(
            np.asarray(x) * np.sin(c), safe * np.cos(b0) * np.cos(c) - np.asarray(y) * np.sin(b0) * np.sin(c)
        )
        return self.lon0 + np.degrees(lon), np.degrees(lat)

    def eastward(self, lon: Floats, lat: Floats) -> Floats:
        """Return the angle (rad, counter-clockwise) at which local east lies on the plane."""
        if not self.latlon:
            return np.zeros(np.shape(lon))
        a, b, b0 = np.radians(np.asarray(lon) - self.lon0), np.radians(lat), np.radians(self.lat0)
        # The great circle from the point of contact keeps its direction at the contact; its heading turns on the way.
        # With the half-angle formula of Gauss the turn is free of the singularity at the contact itself.
        turn: Floats = 2.0 * np.arctan2(
            np.sin(0.5 * (b + b0)) * np.sin(0.5 * a), np.cos(0.5 * (b - b0)) * np.cos(0.5 * a)
        )
        return turn

    def scale(self, lon: Floats, lat: Floats) -> Floats:
        """Return lengths on the plane over lengths on the sphere."""
        if not self.latlon:
            return np.ones(np.shape(lon))
        a, b, b0 = np.radians(np.asarray(lon) - self.lon0), np.radians(lat), np.radians(self.lat0)
        return np.asarray(2.0 / (1.0 + np.sin(b0) * np.sin(b) + np.cos(b0) * np.cos(b) * np.cos(a)))
