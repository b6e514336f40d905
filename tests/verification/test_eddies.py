"""Bergs in an eddy of 40 km at 56 S whose sea surface holds its curvature: ten days from 30 km off its centre."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from riftberg import Forcing, Iceberg, Model
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.state import Elements
from twins import drag, waves

CENTRE, EDDY, START = (-37.0, -56.0), 40e3, 30e3
SIDE, THICKNESS, DENSITY, DAYS = 600.0, 250.0, 850.0, 10
G, OMEGA = 9.8, 7.292e-5


class AirThatMovesWithTheWater(Forcing):
    """Neither drag of the air nor waves."""

    def add_to(self, elements: Elements, time: float) -> None:
        """Add the current to the wind."""
        elements.environment.ua[:] += elements.environment.uo
        elements.environment.va[:] += elements.environment.vo


def radii(forcing: Forcing, speed: float) -> list[float]:
    """Return how far a berg that starts with the water is from the centre after each day, m."""
    placement = CENTRE[0] + math.degrees(START / (EARTH_RADIUS_A68 * math.cos(math.radians(CENTRE[1])))), CENTRE[1]
    water = speed / EDDY * math.exp(0.5 * (1.0 - (START / EDDY) ** 2)) * START
    berg = Iceberg.rectangle(
        SIDE, SIDE, thickness=THICKNESS, placement=placement, velocity=(0.0, water), radius=0.5 * SIDE, density=DENSITY
    )
    model, found = Model(berg, forcing), []
    for _ in range(DAYS):
        model.advance(steps=round(86400.0 / model.parameters.stepping.time_step))
        lon, lat, lon0, lat0 = map(math.radians, (float(model.elements.lon[0]), float(model.elements.lat[0]), *CENTRE))
        cosine = math.sin(lat) * math.sin(lat0) + math.cos(lat) * math.cos(lat0) * math.cos(lon - lon0)
        found.append(EARTH_RADIUS_A68 * math.acos(cosine))
    return found


@pytest.mark.parametrize("speed", [0.5, -0.5, 1.0, -1.0])
def test_without_air_a_berg_stays_on_its_circle(speed: float) -> None:
    """With the slope that balances Coriolis alone it was flung from 30 to 38 km at 0.5 m/s, and to 43 km in one day at 1 m/s."""
    eddy: Any = Forcing.eddy(CENTRE, EDDY, speed)
    found = radii(eddy + AirThatMovesWithTheWater(), speed)
    assert found == pytest.approx([START] * DAYS, rel=0.005)
    if speed == 1.0:
        old: Any = Forcing.eddy(CENTRE, EDDY, speed, balance="geostrophic")
        assert radii(old + AirThatMovesWithTheWater(), speed)[0] > 1.3 * START


@pytest.mark.parametrize(("speed", "end"), [(0.5, 30.6), (-0.5, 29.6), (1.0, 32.7), (-1.0, 28.7)])
def test_in_still_air_a_berg_drifts_as_its_equation_of_motion_says(speed: float, end: float) -> None:
    mass = DENSITY * THICKNESS * SIDE**2
    draft = drag.draft(THICKNESS, DENSITY)
    c_water = drag.ocean(mass, SIDE, SIDE, SIDE, draft, 1.0, 1.0)
    c_air = drag.air(mass, SIDE, SIDE, SIDE, THICKNESS - draft, 1.0)

    def rate(_: float, state: np.ndarray) -> tuple[float, ...]:
        x, y, u, v = state
        spin = speed / EDDY * math.exp(0.5 * (1.0 - (x * x + y * y) / EDDY**2))
        uo, vo = -spin * y, spin * x
        f = 2.0 * OMEGA * math.sin(math.radians(CENTRE[1]) + y / EARTH_RADIUS_A68)
        water, air = c_water * math.hypot(u - uo, v - vo), c_air * math.hypot(u, v)
        wave_x, wave_y = waves.acceleration((0.0, 0.0), (uo, vo), mass, THICKNESS - draft, SIDE, SIDE)
        # The sea surface moves the water: f (v - vo) is what it leaves of Coriolis, spin^2 (x, y) the way round.
        du = f * (v - vo) - spin**2 * x - water * (u - uo) - air * u + wave_x
        dv = -f * (u - uo) - spin**2 * y - water * (v - vo) - air * v + wave_y
        return u, v, du, dv

    water = speed / EDDY * math.exp(0.5 * (1.0 - (START / EDDY) ** 2)) * START
    days = np.arange(1, DAYS + 1) * 86400.0
    path = solve_ivp(rate, (0.0, days[-1]), (START, 0.0, 0.0, water), t_eval=days, rtol=1e-9, atol=1e-6)
    found, expected = radii(Forcing.eddy(CENTRE, EDDY, speed), speed), np.hypot(*path.y[:2])
    print(speed, found[-1] / 1e3, expected[-1] / 1e3)
    np.testing.assert_allclose(found, expected, rtol=0.01)
    assert found[-1] / 1e3 == pytest.approx(end, abs=0.06)
