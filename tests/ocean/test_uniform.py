"""A sea that is the same everywhere: balanced by its surface or with a slope of its own, with water that melts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cases import Converging
from riftberg import A68A_2022, Forcing, Iceberg, Model, Parameters
from riftberg.errors import ForcingError, InputError


def sampled(sea: Any, *, latlon: bool = True, latitude: float = -56.0) -> Any:
    """Return the environment of a lone berg in this sea."""
    place = (-37.0, latitude) if latlon else (0.0, 0.0)
    berg = Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=place, latlon=latlon)
    sea.sample(berg.elements, 0.0)
    return berg.elements.environment


@pytest.mark.parametrize("latitude", [-56.0, 70.0])
def test_a_free_berg_follows_a_balanced_current(latitude: float) -> None:
    """Without wind nothing else acts; with a level sea the berg drifts off at half the speed (seen in the README's example)."""
    current = (0.2, 0.05)
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, latitude))
    speeds = []
    for sea in (Forcing.uniform(current), Forcing.uniform(current, slope=(0.0, 0.0))):
        model = Model(berg, sea, A68A_2022)  # its large drag brings the berg to the speed of the water within days
        model.advance(4)
        speeds.append([float(v.mean()) for v in model.velocity()])
    np.testing.assert_allclose(speeds[0], current, atol=0.01)
    assert math.hypot(speeds[1][0] - current[0], speeds[1][1] - current[1]) > 0.05


def test_the_slope_has_the_sign_of_the_hemisphere() -> None:
    """An eastward current has high water on its left in the south, on its right in the north."""
    assert sampled(Forcing.uniform((0.2, 0.0)), latitude=-56.0).slope_y[0] > 0.0
    assert sampled(Forcing.uniform((0.2, 0.0)), latitude=56.0).slope_y[0] < 0.0
    assert sampled(Forcing.uniform((0.0, 0.2)), latitude=56.0).slope_x[0] > 0.0
    f = 2.0 * 7.292e-5 * math.sin(math.radians(-56.0))
    e = sampled(Forcing.uniform((0.2, 0.1), wind=(1.0, 2.0)), latitude=-56.0)
    assert (e.slope_x[0], e.slope_y[0]) == pytest.approx((f * 0.1 / 9.8, -f * 0.2 / 9.8), rel=1e-3)
    assert (e.ua[0], e.va[0]) == (1.0, 2.0)


def test_a_slope_that_is_given_holds_for_any_current_and_positions() -> None:
    for latlon in (True, False):
        e = sampled(Forcing.uniform((0.2, 0.1), slope=(1e-6, -2e-6)), latlon=latlon)
        assert (e.uo[0], e.slope_x[0], e.slope_y[0]) == (0.2, 1e-6, -2e-6)
        berg = Iceberg.rectangle(
            3e3, 3e3, thickness=200.0, placement=(-37.0, -56.0) if latlon else (0.0, 0.0), latlon=latlon
        )
        Model(berg, Forcing.uniform(wind=(5.0, 0.0)), Parameters(earth={"latlon": latlon})).step()
    with pytest.raises(ForcingError, match="positions in metres have no latitude"):
        Forcing.uniform((0.2, 0.1), latlon=False)
    with pytest.raises(InputError, match=r"earth\.latlon"):  # a balance in degrees, and a berg in metres
        Model(berg, Forcing.uniform((0.2, 0.1)), Parameters(earth={"latlon": False}))


def test_the_slope_that_is_given_stays_beside_the_sea_level_of_data() -> None:
    """A level that comes without currents replaces the balance of formulas, and no slope that was asked for."""

    class Level(Forcing):
        provides = frozenset(("slope_x", "slope_y"))

        def add_to(self, elements: Any, time: float) -> None:
            elements.environment.slope_x[:] += 4e-6

    balanced, level = Forcing.uniform((0.2, 0.1)), Forcing.uniform((0.2, 0.1), slope=(1e-6, 0.0))
    assert sampled(Level() + balanced).slope_x[0] == 4e-6
    assert sampled(Level() + level).slope_x[0] == pytest.approx(5e-6)


def test_temperature_and_salinity_are_known_where_they_are_given() -> None:
    sea = Forcing.uniform(temperature="2 degC", salinity=34.0)
    assert sea.provides == {"sst", "sss"}
    assert (sampled(sea).sst[0], sampled(sea).sss[0]) == (2.0, 34.0)
    assert Forcing.uniform().provides == frozenset()
    with pytest.raises(ForcingError, match=r"kelvin\? Then give 1\.85"):
        Forcing.uniform(temperature=275.0)
    for wrong in ({"salinity": -1.0}, {"slope": (0.5, 0.0)}, {"depth": -1.0}):
        with pytest.raises(ForcingError, match="is not possible"):
            Forcing.uniform(**wrong)


def test_the_vorticity_of_converging_water_is_the_slope_of_its_northward_current() -> None:
    """``dv/dx`` is the speed over the ramp where the convergence sets in, the opposite where it ends, 0 between and outside."""
    x = np.array([500.0, 5e3, 10.5e3, 15e3])
    for y, sign in ((5e3, 1.0), (15e3, -1.0)):
        berg = Iceberg.from_points(x, np.full(4, y), thickness=100.0, radius=50.0, latlon=False)
        Converging().sample(berg.elements, 0.0)
        np.testing.assert_allclose(
            berg.elements.vorticity, sign * 0.2 / 1e3 * np.array([1.0, 0.0, -1.0, 0.0]), atol=1e-12
        )
        np.testing.assert_allclose(berg.elements.vo, sign * 0.2 * np.array([0.5, 1.0, 0.5, 0.0]), atol=1e-12)
