"""From a plane to the sphere: where lattice points lie in longitude and latitude, and what strain that causes.

The model measures the distance of two elements with the cosine of their mean latitude (equations 2.2). A berg whose
longitudes are laid out with each element's own latitude (the rule of the reference, files 8.3) therefore starts with
stretched bonds. Here a lattice is brought to the sphere with an equal-area map of the tangent plane, and then moved
by the smallest displacements (decimetres) that make bonded distances equal to their rest length. On a curved surface
this succeeds exactly for square packing, whose cells may shear a little, and nearly for hexagonal packing, which is
rigid: there 150 km x 50 km keep 3e-6, and 150 km x 150 km keep 3e-5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.constants import DEGREE
from riftberg.plane import EqualAreaPlane
from riftberg.state import Floats, Ints


class FillingPlane(Protocol):
    """A plane (m) that a berg is filled in, and its map to the sphere (degrees)."""

    def forward(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return x, y (m) of points (degrees)."""

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude (degrees) of points (m)."""

    def moved(self, dlon: float, dlat: float) -> FillingPlane:
        """Return the same map moved by some degrees."""


@dataclass(frozen=True)
class ReferencePlane:
    """The rule of the reference (files 8.3 and 8.3.8): one latitude on the way in, each element's own on the way out."""

    west: float  # Longitude and latitude (degrees) of the origin
    south: float  # Longitude and latitude (degrees) of the origin
    reference_latitude: float  # Latitude (degrees) whose cosine scales longitudes on the way in
    earth_radius: float  # Radius of the sphere, m

    def forward(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return x, y (m) of points (degrees)."""
        scale = DEGREE * self.earth_radius
        return scale * math.cos(self.reference_latitude * DEGREE) * (lon - self.west), scale * (lat - self.south)

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude (degrees) of points (m)."""
        scale = np.pi / 180 * self.earth_radius
        lat = self.south + y / scale
        return self.west + x / (scale * np.cos(np.radians(lat))), lat

    def moved(self, dlon: float, dlat: float) -> ReferencePlane:
        """Return the same map moved by some degrees."""
        return ReferencePlane(self.west + dlon, self.south + dlat, self.reference_latitude + dlat, self.earth_radius)


def filling_plane(
    bounds: tuple[float, float, float, float], centroid: tuple[float, float], conformal: bool, earth_radius: float
) -> FillingPlane:
    """Return the plane in which a figure of these bounds and centroid (degrees) is filled."""
    if conformal:
        return EqualAreaPlane(*centroid, earth_radius)
    west, south, _, north = bounds
    return ReferencePlane(west, south, 0.5 * (south + north), earth_radius)


def centroid_moved(
    plane: FillingPlane,
    centroid: tuple[float, float],
    placement: tuple[float, float] | None,
    shift: tuple[float, float],
) -> FillingPlane:
    """Return the plane after a move of the centroid (degrees) to ``placement`` and by ``shift``."""
    target = centroid if placement is None else placement
    return plane.moved(target[0] - centroid[0] + shift[0], target[1] - centroid[1] + shift[1])


def turned(x: Floats, y: Floats, degrees: float) -> tuple[Floats, Floats]:
    """Turn points counter-clockwise about the origin."""
    c, s = math.cos(degrees * DEGREE), math.sin(degrees * DEGREE)
    return c * x - s * y, s * x + c * y


ROUNDS = 5
"""Gauss-Newton rounds at most; the elongations are small, so two or three are enough."""

ITERATIONS = 600
"""Iterations of conjugate gradients in a round at most."""


def relax(lon: Floats, lat: Floats, first: Ints, second: Ints, rest: Floats, metric: Metric) -> tuple[Floats, Floats]:
    """Move elements by the least displacements that bring bonded distances to their rest length.

    Gauss-Newton rounds on the sum of squared elongations; each round solves for the displacements of least norm with
    conjugate gradients (CGLS), so translation and rotation of the berg are untouched.

    ``lon``, ``lat``: positions, degrees; ``rest``: rest length of each bond, m; returns ``lon, lat``: new positions,
    degrees.
    """
    scale = DEGREE * metric.radius
    for _ in range(ROUNDS):
        x, y = separations(metric, lon[first], lat[first], lon[second], lat[second])
        length = np.hypot(x, y)
        if np.max(np.abs(rest - length), initial=0.0) < 1e-6:
            break
        dx, dy = _least_squares(x / length, y / length, first, second, rest - length, len(lon))
        lon, lat = lon + dx / (scale * np.cos(lat * DEGREE)), lat + dy / scale
    return lon, lat


def _least_squares(
    nx: Floats, ny: Floats, first: Ints, second: Ints, missing: Floats, size: int
) -> tuple[Floats, Floats]:
    """Displacements of least norm whose bond elongations fit ``missing`` (m) best: CGLS, started from zero."""

    def gathered(r: Floats) -> Floats:
        out = np.empty((2, size))
        for k, n in enumerate((nx, ny)):
            out[k] = np.bincount(first, n * r, size) - np.bincount(second, n * r, size)
        return out

    move, residual = np.zeros((2, size)), missing.copy()
    gradient = gathered(residual)
    direction, norm = gradient, float(np.vdot(gradient, gradient))
    # Below 1e-8 m per element only round-off is left, and a rigid (hexagonal) lattice would follow it astray.
    target = max(1e-14 * norm, 1e-16 * size)
    for _ in range(ITERATIONS):
        if norm <= target:
            break
        stretch = nx * (direction[0, first] - direction[0, second]) + ny * (direction[1, first] - direction[1, second])
        step = norm / float(stretch @ stretch)
        move += step * direction
        residual -= step * stretch
        gradient = gathered(residual)
        norm, before = float(np.vdot(gradient, gradient)), norm
        direction = gradient + norm / before * direction
    return move[0], move[1]
