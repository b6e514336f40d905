"""The planes that touch the sphere: against pyproj, there and back, and what each of them keeps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from riftberg.plane import AzimuthalPlane, ConformalPlane, EqualAreaPlane, EquidistantPlane

RADIUS = 6.37e6
KINDS = {ConformalPlane: "stere", EqualAreaPlane: "laea", EquidistantPlane: "aeqd"}
CONTACTS = [(-37.0, -56.0), (179.5, -70.0), (10.0, 85.0), (0.0, -90.0)]
PLANES = [ConformalPlane(*contact, RADIUS) for contact in CONTACTS]
offsets = st.floats(-1.5e5, 1.5e5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("contact", CONTACTS)
def test_as_pyproj_has_it(kind: type[AzimuthalPlane], contact: tuple[float, float]) -> None:
    pyproj = pytest.importorskip("pyproj")
    lon0, lat0 = contact
    other = pyproj.Proj(proj=KINDS[kind], lon_0=lon0, lat_0=lat0, R=RADIUS)
    lon, lat = np.meshgrid(lon0 + np.linspace(-3.0, 3.0, 7), np.clip(lat0 + np.linspace(-3.0, 3.0, 7), -90.0, 90.0))
    np.testing.assert_allclose(kind(lon0, lat0, RADIUS).forward(lon, lat), other(lon, lat), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@given(lon0=st.floats(-180.0, 180.0), lat0=st.floats(-90.0, 90.0), x=offsets, y=offsets)
def test_there_and_back(kind: type[AzimuthalPlane], lon0: float, lat0: float, x: float, y: float) -> None:
    plane = kind(lon0, lat0, RADIUS)
    back = plane.forward(*plane.inverse(np.array([x]), np.array([y])))
    np.testing.assert_allclose(back, ([x], [y]), atol=1e-3)


def test_equal_area_plane_keeps_areas() -> None:
    """A box of longitude and latitude has the area R**2 dlon (sin lat2 - sin lat1)."""
    west, east, south, north = -40.0, -38.0, -56.0, -54.5
    part = np.linspace(0, 1, 2001)
    lon = np.concatenate(
        [west + part * (east - west), np.full(2001, east), east - part * (east - west), np.full(2001, west)]
    )
    lat = np.concatenate(
        [np.full(2001, south), south + part * (north - south), np.full(2001, north), north - part * (north - south)]
    )
    x, y = EqualAreaPlane(-39.0, -55.2, RADIUS).forward(lon, lat)
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    exact = RADIUS**2 * math.radians(east - west) * abs(math.sin(math.radians(north)) - math.sin(math.radians(south)))
    assert area == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("plane", PLANES[:3])
def test_directions_and_scale_are_those_of_small_steps(plane: ConformalPlane) -> None:
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
    plane = ConformalPlane(1000.0, 2000.0, 6.37e6, latlon=False)
    assert plane.forward(np.array([3000.0]), np.array([2500.0])) == (np.array([2000.0]), np.array([500.0]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lat0", [90.0, -90.0, 89.9999])
def test_points_beside_a_pole_come_back(kind: type[AzimuthalPlane], lat0: float) -> None:
    """Bug: by the arc of the sine a point 1.25 m from a pole came back 1.5 mm off."""
    y = np.array([-20.0, -1.25, 1e-3, 1.25, 20.0])
    plane = kind(0.0, lat0, RADIUS)
    np.testing.assert_allclose(plane.forward(*plane.inverse(0.3 * y, y)), (0.3 * y, y), rtol=0, atol=1e-8)
