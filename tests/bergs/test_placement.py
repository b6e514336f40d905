"""Maps between plane and sphere, and the strain they leave in the bonds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.plane import EqualAreaPlane

EARTH = 6363827.0


def test_reference_plane_uses_the_own_latitude_of_each_point():
    """Elements of a column stand at one distance (m) from the middle, along the parallel of each."""
    berg = Iceberg.rectangle(60e3, 60e3, thickness=200.0, placement=(-60.0, -60.0), radius=1500.0, conformal=False)
    lon, lat = berg.elements.lon, berg.elements.lat
    metres = np.radians(lon + 60.0) * EARTH * np.cos(np.radians(lat))
    np.testing.assert_allclose(metres / 1500.0, np.round(metres / 1500.0), atol=1e-9)
    np.testing.assert_allclose(np.unique(np.round(metres / 1500.0)), np.arange(-19.0, 20.0, 2.0))


def test_turning_is_counter_clockwise():
    berg = Iceberg.rectangle(9e3, 3e3, thickness=200.0, radius=1500.0, latlon=False, rotation=90.0)
    eastern = np.argmax(Iceberg.rectangle(9e3, 3e3, thickness=200.0, radius=1500.0, latlon=False).elements.lon)
    assert (berg.elements.lon[eastern], berg.elements.lat[eastern]) == pytest.approx((0.0, 3e3))


@pytest.mark.parametrize("latitude", [0.0, -55.0, -75.0])
@pytest.mark.parametrize("width", [48e3, 150e3])
def test_square_lattice_starts_without_strain(latitude, width):
    berg = Iceberg.rectangle(150e3, width, thickness=200.0, placement=(-39.0, latitude))
    assert abs(berg.initial_strain) < 1e-9


def test_hexagonal_tabular_berg_starts_nearly_without_strain():
    berg = Iceberg.rectangle(150e3, 50e3, thickness=200.0, placement=(-39.0, -55.0), packing="hexagonal")
    assert 0 < abs(berg.initial_strain) < 5e-6


def test_relaxation_moves_elements_by_less_than_two_metres():
    """The lattice keeps its place: only the curvature of the sphere is shared out."""
    berg = Iceberg.rectangle(150e3, 48e3, thickness=200.0, placement=(-39.0, -55.0), offset=(0.0, 0.0))
    x, y = EqualAreaPlane(-39.0, -55.0, berg.earth_radius).forward(berg.elements.lon, berg.elements.lat)
    nearest_x, nearest_y = (np.round((a / 3000.0) - 0.5) * 3000.0 + 1500.0 for a in (x, y))
    assert np.hypot(x - nearest_x, y - nearest_y).max() < 2.0


def test_rule_of_the_reference_stretches_columns():
    """Spec 10.5: +0.77 m at 100 km from the western edge at 55 S."""
    berg = Iceberg.rectangle(201e3, 9e3, thickness=200.0, placement=(-39.0, -55.2), conformal=False)
    strain_at_100_km = 0.5 * (100e3 / EARTH * math.tan(math.radians(55.2))) ** 2
    assert berg.initial_strain == pytest.approx(strain_at_100_km, rel=0.05)
    assert berg.initial_strain * 3000 == pytest.approx(0.77, abs=0.03)


@pytest.mark.parametrize("conformal", [True, False])
def test_rotated_berg_keeps_shape_and_place(conformal):
    made = {"thickness": 200.0, "placement": (-39.0, -55.0), "conformal": conformal}
    plain, rotated = (Iceberg.rectangle(60e3, 15e3, rotation=angle, **made) for angle in (0.0, 90.0))
    assert len(plain.elements.id) == len(rotated.elements.id) == 100
    assert len(plain.bonds.first) == len(rotated.bonds.first) == 175
    assert rotated.centroid == pytest.approx(plain.centroid, abs=1e-3)
    assert np.ptp(rotated.elements.lat) == pytest.approx(math.degrees(57e3 / EARTH), rel=1e-3)
