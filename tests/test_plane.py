"""The conformal plane of the replay."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.plane import Plane

PLANES = [
    Plane(-37.0, -56.0, 6.37e6),
    Plane(179.5, -70.0, 6.37e6),
    Plane(10.0, 85.0, 6.37e6),
    Plane(0.0, -90.0, 6.37e6),
]


@pytest.mark.parametrize("plane", PLANES)
def test_there_and_back(plane: Plane) -> None:
    x, y = np.meshgrid(np.linspace(-4e5, 4e5, 9), np.linspace(-4e5, 4e5, 9))
    back = plane.forward(*plane.inverse(x, y))
    np.testing.assert_allclose(back, (x, y), atol=1e-4)


@pytest.mark.parametrize("plane", PLANES[:3])
def test_directions_and_scale_are_those_of_small_steps(plane: Plane) -> None:
    lon = plane.lon0 + np.array([-3.0, 0.0, 2.0, 5.0])
    lat = plane.lat0 + np.array([1.0, 0.0, -2.0, 2.0])
    d = 1e-5
    here, east, north = (np.array(plane.forward(*p)) for p in ((lon, lat), (lon + d, lat), (lon, lat + d)))
    ex, ey = east - here
    nx, ny = north - here
    np.testing.assert_allclose(np.arctan2(ey, ex), plane.eastward(lon, lat), atol=1e-6)
    np.testing.assert_allclose(ex * nx + ey * ny, 0.0, atol=1e-5)  # conformal: north stays at right angles to east
    metre = np.radians(d) * plane.radius
    np.testing.assert_allclose(np.hypot(nx, ny) / metre, plane.scale(lon, lat), rtol=1e-6)
    np.testing.assert_allclose(np.hypot(ex, ey) / metre, plane.scale(lon, lat) * np.cos(np.radians(lat)), rtol=1e-6)


def test_metres_stay_metres() -> None:
    plane = Plane(1000.0, 2000.0, 6.37e6, latlon=False)
    assert plane.forward(np.array([3000.0]), np.array([2500.0])) == (np.array([2000.0]), np.array([500.0]))
