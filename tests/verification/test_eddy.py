"""A small berg in a round eddy: it stays on the circle of the water; in still air it drifts off as its balance of forces says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from riftberg import Iceberg, Model, Parameters
from riftberg.constants import (
    EARTH_ROTATION,
    RHO_AIR,
    RHO_SEAWATER,
)
from riftberg.ocean.formulas import Eddy
from riftberg.state import Elements

SIDE, THICKNESS, LATITUDE, RADIUS, START = 600.0, 250.0, -56.0, 40e3, 30e3
F = 2.0 * EARTH_ROTATION * math.sin(math.radians(LATITUDE))


class WithTheAir(Eddy):
    """The eddy under air that moves with the water, which thus drags no berg."""

    def add_to(self, elements: Elements, time: float) -> None:
        """Add current, slope and wind."""
        super().add_to(elements, time)
        e = elements.environment
        e.ua[:], e.va[:] = e.uo, e.vo


DRAG = Parameters().drag


def rate(speed: float, r: float) -> float:
    """Angular speed (s-1) of the water at a radius."""
    return speed / RADIUS * math.exp(0.5 * (1.0 - (r / RADIUS) ** 2))


def radius_after_ten_days(kind: type[Eddy], speed: float, **stepping: Any) -> float:
    """Distance (km) from the centre of a berg that starts with the water."""
    berg = Iceberg.rectangle(
        SIDE, SIDE, thickness=THICKNESS, radius=0.5 * SIDE, latlon=False, placement=(START, 0.0),
        velocity=(0.0, rate(speed, START) * START),
    )  # fmt: skip
    eddy = kind((0.0, 0.0), RADIUS, speed, latlon=False, latitude=LATITUDE)
    p = Parameters(
        earth={"latlon": False, "period": 0.0, "reference_latitude": LATITUDE, "f_plane": True}, stepping=stepping
    )
    model = Model(berg, eddy, p)
    model.advance(10.0)
    return float(np.hypot(model.elements.lon[0], model.elements.lat[0])) / 1e3


def integrated(speed: float) -> float:
    """The same by the balance of forces on one body, integrated to 1e-9."""
    mass = 850.0 * SIDE * SIDE * THICKNESS
    draft = THICKNESS * 850.0 / RHO_SEAWATER
    water = RHO_SEAWATER * (0.5 * DRAG.water_side * SIDE * draft + DRAG.water_base * SIDE * SIDE) / mass
    air = RHO_AIR * (0.5 * DRAG.air_side * SIDE * (THICKNESS - draft) + DRAG.air_top * SIDE * SIDE) / mass

    def motion(_: float, now: np.ndarray) -> list[float]:
        x, y, u, v = now
        turning = rate(speed, math.hypot(x, y))
        uo, vo = -turning * y, turning * x
        through_water, through_air = math.hypot(uo - u, vo - v), math.hypot(u, v)
        # The water's own acceleration is to the centre: -turning^2 (x, y); the slope gives it to all that floats there.
        ax = F * (v - vo) - turning**2 * x + water * through_water * (uo - u) - air * through_air * u
        ay = -F * (u - uo) - turning**2 * y + water * through_water * (vo - v) - air * through_air * v
        return [u, v, ax, ay]

    begin = [START, 0.0, 0.0, rate(speed, START) * START]
    end = solve_ivp(motion, (0.0, 864_000.0), begin, rtol=1e-9, atol=1e-9).y[:, -1]
    return math.hypot(end[0], end[1]) / 1e3


@pytest.mark.quick(2)
@pytest.mark.parametrize("speed", [0.5, -0.5, 1.0, -1.0])
@pytest.mark.compiled
def test_a_berg_that_starts_with_the_water_stays_on_its_circle(speed: float) -> None:
    """Bug once: flung out from 30 to 49 km at 0.5 m/s, for the sea surface balanced Coriolis alone."""
    assert radius_after_ten_days(WithTheAir, speed, time_step=900.0) == pytest.approx(30.0, rel=0.005)


@pytest.mark.quick(2)
@pytest.mark.parametrize(("speed", "known"), [(0.5, 30.5), (-0.5, 29.7), (1.0, 32.6), (-1.0, 28.8)])
@pytest.mark.compiled
def test_in_still_air_it_drifts_off_as_the_balance_of_forces_says(speed: float, known: float) -> None:
    own = integrated(speed)
    assert own == pytest.approx(known, abs=0.25)
    assert radius_after_ten_days(Eddy, speed, time_step=900.0) == pytest.approx(own, rel=0.01)
