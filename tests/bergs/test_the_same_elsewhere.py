"""A berg made elsewhere is the same berg: across the date line, on another branch of longitude, on the other hemisphere."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Iceberg

RADIUS = 6.378e6
STEPS = np.linspace(-0.6, 0.6, 61)


def chart(lon0: float, lat0: float, field: Any) -> xr.DataArray:
    """A map about a place, in longitudes from 0 to 360; northward on the berg is towards the equator."""
    values = field(*np.meshgrid(STEPS, -np.copysign(1.0, lat0) * STEPS))
    lon = (lon0 + STEPS) % 360.0
    return xr.DataArray(values, {"lat": lat0 + STEPS, "lon": lon}, ("lat", "lon"), "map")


def seen(berg: Iceberg, lon0: float, lat0: float) -> np.ndarray:
    """Place (m), thickness, mass and velocities of the elements in the frame of the berg, shape (elements, 7)."""
    e, side = berg.elements, np.copysign(1.0, lat0)
    east = (e.lon - lon0 + 180.0) % 360.0 - 180.0
    x, y = (np.radians(a) * RADIUS for a in (east * np.cos(np.radians(lat0)), -side * (e.lat - lat0)))
    return np.column_stack([x, y, e.thickness, e.mass, e.u, -side * e.v, -side * e.spin])


def paired(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The rows of another berg that lie where those of one do."""
    apart = np.hypot(*(np.subtract.outer(one[:, k], other[:, k]) for k in (0, 1)))
    nearest = apart.argmin(axis=1)
    assert np.unique(nearest).size == len(other)
    return other[nearest]


def made(lon0: float, lat0: float, *, points: bool = False, turn: float = 0.0) -> Iceberg:
    """A berg whose thickness follows a map, which drifts and turns."""
    side = -np.copysign(1.0, lat0)
    x, y = 0.2 * np.array([-1, 1, 1, -1, -1]), 0.06 * np.array([-1, -1, 1, 1, -1])
    motion = {"velocity": (0.2, side * 0.1), "spin": side * 1e-5, "earth_radius": RADIUS}
    thickness = chart(lon0, lat0, lambda a, b: 200.0 + 50.0 * a + 80.0 * b)
    berg = Iceberg.from_outline(
        np.column_stack([lon0 + x, lat0 + y]), thickness=thickness, radius=800.0, rotation=turn, **motion
    )  # type: ignore[misc]
    if not points:
        return berg
    e = berg.elements
    lon = (e.lon + 180.0) % 360.0 - 180.0
    return Iceberg.from_points(lon, e.lat, thickness=e.thickness, radius=berg.radius, **motion)  # type: ignore[misc]


def cracked(berg: Iceberg, lon: float, lat: float) -> list[Any]:
    """What an oblique rift, a mask and a map of strength do to a berg."""
    side = -np.copysign(1.0, lat)
    west, east = ((lon + a + 180.0) % 360.0 - 180.0 for a in (-0.013, 0.017))
    lines = berg.with_rifts([[west, lat - side * 0.2], [east, lat + side * 0.2]], broken=True)
    masks = berg.with_rifts(chart(lon, lat, lambda a, _: np.abs(a - 0.1) < 0.03), broken=True)
    strong = berg.with_strength(chart(lon, lat, lambda a, b: 1.0 + a + 2.0 * b)).bonds.strength
    return [(cut.bonds.status != 0).sum() for cut in (lines, masks)] + [np.sort(strong), lines.elements.berg.max()]


ELSEWHERE = [(180.0, -55.0, False), (180.0, -55.0, True), (-180.0, -55.0, True), (321.0, -55.0, False)]


@pytest.mark.quick(2)
@pytest.mark.parametrize(("lon0", "lat0", "points"), ELSEWHERE)
def test_a_berg_made_elsewhere_is_the_same(lon0: float, lat0: float, points: bool) -> None:
    """From points on both sides of the date line its centre was on the other side of the Earth, and rifts cut it twice."""
    here, there = made(-39.0, -55.0), made(lon0, lat0, points=points)
    one, other = seen(there, lon0, lat0), seen(here, -39.0, -55.0)
    np.testing.assert_allclose(one, paired(one, other), rtol=1e-6, atol=1e-5)
    assert there.bonds.bond_length.size == here.bonds.bond_length.size
    east = (np.array([there.centroid[0] - lon0, here.centroid[0] + 39.0]) + 180.0) % 360.0 - 180.0
    assert east[0] == pytest.approx(east[1], abs=1e-9)
    extents = [re.findall(r"extents: ([\d.]+ km x [\d.]+ km)", berg.describe()) for berg in (there, here)]
    assert extents[0] == extents[1] != []

    for one, other in zip(cracked(there, lon0, lat0), cracked(here, -39.0, -55.0), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)


def test_a_turned_berg_has_its_profile_turned_and_its_motion_not() -> None:
    """A map of thickness is drawn on the ice before it is turned; drift is that of east and north; the spin is the same."""
    here, turned = (seen(made(-39.0, -55.0, turn=a), -39.0, -55.0) for a in (0.0, 180.0))
    back = turned * [-1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    pair = paired(back, here)
    np.testing.assert_allclose(back[:, :2], pair[:, :2], atol=50.0)  # this test lays the sphere flat in another way
    np.testing.assert_allclose(back[:, 2:4], pair[:, 2:4], rtol=1e-6)
    np.testing.assert_allclose(turned[:, 4:], paired(turned, here)[:, 4:], atol=5e-3)


def test_a_berg_on_the_other_hemisphere_is_the_mirror_image() -> None:
    """Drift and spin given as in a mirror make the mirrored velocities of all elements; rifts and maps cut the same."""
    south, north = (
        Iceberg.rectangle(
            24e3, 12e3, thickness=np.where(np.arange(32) % 8 < 4, 200.0, 250.0), radius=1500.0, placement=(-39.0, lat),
            velocity=(0.2, side * 0.1), spin=side * 1e-5, earth_radius=RADIUS,
        )
        for lat, side in ((-55.0, 1.0), (55.0, -1.0))
    )  # fmt: skip
    one, other = seen(north, -39.0, 55.0), seen(south, -39.0, -55.0)
    np.testing.assert_allclose(one, paired(one, other), rtol=1e-9, atol=1e-6)
    for one, other in zip(cracked(north, -39.0, 55.0), cracked(south, -39.0, -55.0), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
