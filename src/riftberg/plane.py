"""A piece of the sphere laid flat: azimuthal planes that touch it at one point.

All three keep the direction from the point of contact and differ in how far from it a point at the angle c lies
(Snyder 1987, USGS PP 1395, chapters 20, 21, 24 and 25): `ConformalPlane` keeps shapes (squares stay square wherever the berg
is, poles included), `EqualAreaPlane` areas, `EquidistantPlane` distances from that point. The formulas are short and must give
the same digits everywhere, so they stand here; coordinate systems of data files are pyproj's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.physics.elementary import asin_array, atan2_array, cos_array, sin_array
from riftberg.state import Floats


def unit_vectors(lon: Floats, lat: Floats) -> Floats:
    """Return positions (degrees) as vectors of length 1 along a last axis of three."""
    east, north = np.deg2rad(np.asarray(lon, float)), np.deg2rad(np.asarray(lat, float))
    return np.stack([cos_array(north) * cos_array(east), cos_array(north) * sin_array(east), sin_array(north)], axis=-1)


def near(lon: Any, middle: Any, period: float = 360.0) -> Any:
    """Return longitudes on the branch of another: within half a turn, or half a ``period`` (m), of it."""
    return lon - period * np.round((lon - middle) / period)


@dataclass(frozen=True)
class AzimuthalPlane:
    """Base of the planes that touch the sphere at ``(lon0, lat0)``; the identity for positions in metres."""

    lon0: float  # Point of contact, degrees (metres where ``latlon`` is false)
    lat0: float  # Point of contact, degrees (metres where ``latlon`` is false)
    radius: float  # Radius of the sphere, m
    latlon: bool = True  # Positions are degrees

    def forward(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return metres east and north of the point of contact, on the plane."""
        if not self.latlon:
            return np.asarray(lon) - self.lon0, np.asarray(lat) - self.lat0
        dlon, phi, phi0 = (lon - self.lon0) * DEGREE, lat * DEGREE, self.lat0 * DEGREE
        cosine = sin_array(phi0) * sin_array(phi) + cos_array(phi0) * cos_array(phi) * cos_array(dlon)
        k = self.radius * self._stretch(cosine)
        x = k * cos_array(phi) * sin_array(dlon)
        y = k * (cos_array(phi0) * sin_array(phi) - sin_array(phi0) * cos_array(phi) * cos_array(dlon))
        return x, y

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude of points of the plane."""
        if not self.latlon:
            return np.asarray(x) + self.lon0, np.asarray(y) + self.lat0
        phi0 = self.lat0 * DEGREE
        rho = np.hypot(x, y) / self.radius
        c = self._angle(rho)
        ratio = np.where(rho > 0, sin_array(c) / np.where(rho > 0, rho, 1.0), 1.0) / self.radius
        up = cos_array(c) * sin_array(phi0) + y * ratio * cos_array(phi0)
        east, along = x * ratio, cos_array(phi0) * cos_array(c) - y * ratio * sin_array(phi0)
        # Not by the arc of the sine, which is flat at a pole: half of the digits would be lost there.
        phi, dlon = atan2_array(up, np.hypot(east, along)), atan2_array(east, along)
        return self.lon0 + dlon / DEGREE, phi / DEGREE

    def moved(self, dlon: float, dlat: float) -> Self:
        """Return the same plane with its point of contact moved by some degrees."""
        return replace(self, lon0=self.lon0 + dlon, lat0=self.lat0 + dlat)

    def _stretch(self, cosine: Floats) -> Floats:
        """Return the distance from the point of contact over the sine of the angle c, in radii, from the cosine of c."""
        raise NotImplementedError

    def _angle(self, rho: Floats) -> Floats:
        """Return the angle c (rad) of points at the distance ``rho`` (radii) from the point of contact."""
        raise NotImplementedError


@dataclass(frozen=True)
class ConformalPlane(AzimuthalPlane):
    """Stereographic plane: shapes exact, lengths within r**2 / 4 R**2."""

    def eastward(self, lon: Floats, lat: Floats) -> Floats:
        """Return the angle (rad, counter-clockwise) at which local east lies on the plane."""
        if not self.latlon:
            return np.zeros(np.shape(lon))
        a, b, b0 = np.radians(np.asarray(lon) - self.lon0), np.radians(lat), np.radians(self.lat0)
        # The great circle from the point of contact keeps its direction at the contact; its heading turns on the way.
        # With the half-angle formula of Gauss the turn is free of the singularity at the contact itself.
        turn: Floats = 2.0 * atan2_array(
            sin_array(0.5 * (b + b0)) * sin_array(0.5 * a), cos_array(0.5 * (b - b0)) * cos_array(0.5 * a)
        )
        return turn

    def scale(self, lon: Floats, lat: Floats) -> Floats:
        """Return lengths on the plane over lengths on the sphere."""
        if not self.latlon:
            return np.ones(np.shape(lon))
        a, b, b0 = np.radians(np.asarray(lon) - self.lon0), np.radians(lat), np.radians(self.lat0)
        return np.asarray(2.0 / (1.0 + sin_array(b0) * sin_array(b) + cos_array(b0) * cos_array(b) * cos_array(a)))

    def _stretch(self, cosine: Floats) -> Floats:
        return 2.0 / (1.0 + cosine)

    def _angle(self, rho: Floats) -> Floats:
        return np.asarray(2.0 * atan2_array(0.5 * rho, 1.0))


@dataclass(frozen=True)
class EqualAreaPlane(AzimuthalPlane):
    """Lambert's azimuthal plane: areas exact, lengths within r**2 / 8 R**2 (1.7e-5 at 75 km)."""

    def _stretch(self, cosine: Floats) -> Floats:
        # 1 + cos(c) >= 1 within a hemisphere, so the map is regular wherever a berg can reach.
        return np.asarray(np.sqrt(2.0 / (1.0 + cosine)))

    def _angle(self, rho: Floats) -> Floats:
        return np.asarray(2.0 * asin_array(0.5 * rho))


@dataclass(frozen=True)
class EquidistantPlane(AzimuthalPlane):
    """Plane on which the distance from the point of contact is that along the great circle."""

    def _stretch(self, cosine: Floats) -> Floats:
        # An angle too small for its cosine counts as 0, where the stretch is 1 all the same.
        return np.asarray(1.0 / np.sinc(np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi))

    def _angle(self, rho: Floats) -> Floats:
        return rho


def ellipse(lon: float, lat: float, major: float, minor: float, azimuth: float, corners: int = 72) -> Floats:
    """Return an ellipse as a closed line of longitude and latitude, shape (corners + 1, 2).

    ``lon``, ``lat``: its middle, degrees; ``major``, ``minor``: semi-axes, m; ``azimuth``: of the major axis, degrees
    clockwise from north.
    """
    angle, turn = np.linspace(0.0, 2.0 * np.pi, corners + 1), np.radians(azimuth)
    along, across = major * cos_array(angle), minor * sin_array(angle)
    x, y = along * sin_array(turn) - across * cos_array(turn), along * cos_array(turn) + across * sin_array(turn)
    return np.column_stack(EqualAreaPlane(lon, lat, EARTH_RADIUS_A68).inverse(x, y))


def ellipses(ds: Any, part: float) -> list[Floats]:
    """Return the ellipses of the position in a forecast as closed lines of longitude and latitude, NaN where there is none.

    ``part``: of the probability that they hold, one of its ``cone``.
    """
    sizes = (ds[name].sel(cone=part).values for name in ("cone_major", "cone_minor"))
    rows = np.column_stack([ds["cone_lon"], ds["cone_lat"], *sizes, ds["cone_azimuth"]]).tolist()
    return [ellipse(*row) for row in rows]


def ranges(ds: Any) -> list[Floats]:
    """Return the range of the members' positions in a forecast as closed lines of longitude and latitude, NaN for none."""
    rows = np.column_stack([ds[f"members_{side}"] for side in ("west", "south", "east", "north")])
    return [np.array([(w, s), (e, s), (e, n), (w, n), (w, s)]) for w, s, e, n in rows]
