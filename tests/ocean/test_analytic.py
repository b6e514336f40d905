"""Forcing by formulas: the sea surface that balances a current."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg import A68A_2022, Iceberg, Model, Steady
from riftberg.ocean.analytic import Convergence


@pytest.mark.parametrize("latitude", [-56.0, 70.0])
def test_a_free_berg_follows_a_balanced_current(latitude: float) -> None:
    """Without wind nothing else acts; with a level sea the berg drifts off at half the speed (seen in the README's example)."""
    current = (0.2, 0.05)
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, latitude))
    speeds = []
    for ocean in (Steady.balanced(current, latitude), Steady(current)):
        model = Model(berg, ocean, A68A_2022)  # its large drag brings the berg to the speed of the water within days
        model.advance(4)
        speeds.append([float(v.mean()) for v in model.velocity()])
    np.testing.assert_allclose(speeds[0], current, atol=0.01)
    assert math.hypot(speeds[1][0] - current[0], speeds[1][1] - current[1]) > 0.05


def test_the_slope_has_the_sign_of_the_hemisphere() -> None:
    """An eastward current has high water on its left in the south, on its right in the north."""
    assert Steady.balanced((0.2, 0.0), -56.0).slope[1] > 0.0
    assert Steady.balanced((0.2, 0.0), 56.0).slope[1] < 0.0
    assert Steady.balanced((0.0, 0.2), 56.0).slope[0] > 0.0
    np.testing.assert_allclose(Steady.balanced((0.2, 0.1), 0.0).slope, 0.0)
    f = 2.0 * 7.292e-5 * math.sin(math.radians(-56.0))
    assert Steady.balanced((0.2, 0.1), -56.0, wind=(1.0, 2.0)).slope == pytest.approx((f * 0.1 / 9.8, -f * 0.2 / 9.8))
    assert Steady.balanced((0.2, 0.1), -56.0, wind=(1.0, 2.0)).wind == (1.0, 2.0)


def test_the_vorticity_of_converging_water_is_the_slope_of_its_northward_current() -> None:
    """``dv/dx`` is the speed over the ramp where the convergence sets in, the opposite where it ends, 0 between and outside."""
    water = Convergence((0.1, 0.0), 0.2, 0.0, (10e3, 30e3), 5e3, 100e3)
    x = np.array([12.5e3, 20e3, 32.5e3, 50e3])
    for y, sign in ((-10e3, 1.0), (10e3, -1.0)):
        berg = Iceberg.from_points(x, np.full(4, y), thickness=100.0, radius=500.0, latlon=False)
        water.sample(berg.elements, 0.0)
        np.testing.assert_allclose(
            berg.elements.vorticity, sign * 0.2 / 5e3 * np.array([1.0, 0.0, -1.0, 0.0]), atol=1e-12
        )
        np.testing.assert_allclose(berg.elements.vo, sign * 0.2 * np.array([0.5, 1.0, 0.5, 0.0]), atol=1e-12)
