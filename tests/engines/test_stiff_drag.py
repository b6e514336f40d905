"""Drag that stops an element in the water within a part of a step: small bergs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from contract import FORCES
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.compiled.kernels import plain
from riftberg.engines.common.forces.media import Medium
from riftberg.engines.quasi_static.bodies.dynamics import EXPLICIT_PART, accumulate_excess, add_excess_drag, excess_rate

WATER, AIR = (0.8, 0.0), (15.0, 0.0)


def made(
    length: float,
    thickness: float,
    time_step: float,
    *,
    turned: float = 0.0,
    depth: float = 1e4,
    water: tuple[float, float] = WATER,
    **changes: Any,
) -> Model:
    """Return a berg of one element in current and wind, at rest."""
    c, s = np.cos(turned), np.sin(turned)
    ocean = Forcing.uniform(
        current=(c * water[0], s * water[0]), wind=(c * AIR[0], s * AIR[0]), depth=depth, slope=(0.0, 0.0)
    )
    berg = Iceberg.rectangle(
        length,
        length,
        radius=0.5 * length,
        thickness=thickness,
        placement=(0.0, 0.0),
        latlon=False,
        **changes.pop("berg", {}),
    )
    plane = {"latlon": False, "period": 0.0, "reference_latitude": -60.0}
    return Model(berg, ocean, Parameters(earth=plane, stepping={"time_step": time_step}, **changes))


def way(model: Model, hours: float) -> np.ndarray:
    """Return how far a berg has come east and north (m) after each step."""
    places = []
    for _ in range(round(3600.0 * hours / model.parameters.time_step)):
        model.step()
        places.append([model.elements.lon.mean(), model.elements.lat.mean()])
    return np.array(places)


@pytest.mark.quick(3)
@pytest.mark.parametrize(("length", "thickness"), [(30.0, 25.0), (60.0, 50.0), (200.0, 100.0)])
@pytest.mark.parametrize("time_step", [600.0, 1800.0, 7200.0])
def test_a_small_berg_is_not_flung_past_the_water(length: float, thickness: float, time_step: float) -> None:
    """A berg of 30 m went 20 km in its first half hour, at 11 m/s, and 14 km back in the next."""
    coarse, every = way(made(length, thickness, time_step), 4.0), round(time_step / 20.0)
    fine = way(made(length, thickness, 20.0), 4.0)
    in_a_step = every * np.hypot(*(fine[-1] - fine[-2]))
    assert np.hypot(*(coarse - fine[every - 1 :: every]).T).max() < 0.3 * in_a_step


def test_it_goes_the_same_way_in_all_directions() -> None:
    east, turned = made(60.0, 50.0, 1800.0), made(60.0, 50.0, 1800.0, turned=2.0)
    (x, y), c, s = way(east, 1.0)[-1], np.cos(2.0), np.sin(2.0)
    np.testing.assert_allclose(way(turned, 1.0)[-1], [c * x - s * y, s * x + c * y], rtol=1e-9)


def test_the_ledger_of_momentum_closes() -> None:
    """Each medium has its part of what it gives implicitly."""
    model = made(60.0, 50.0, 1800.0)
    model.advance(steps=4)
    assert model.motion.balance(model, model.remembered).momentum_error < 1e-10


def test_excess_drag_is_the_plain_sum_over_the_media() -> None:
    """And what the ledger takes from it is what it takes from the berg."""
    model = made(60.0, 50.0, 1800.0)
    model.step()
    state = model._stepper.memory.state
    op, terms, half_dt, before, media = (
        state.operators,
        state.terms,
        900.0,
        state.bodies.twist,
        Medium(*state.operators.forcing.media[0].T),
    )
    slow, acceleration = np.zeros((1, 3, 3)), np.empty((1, 3))
    plain(add_excess_drag)(op, before, terms, half_dt, acceleration, slow)
    pushed = np.hypot(*terms.net_force[0, :2]) / model.elements.mass[0]
    np.testing.assert_allclose(np.hypot(*acceleration[0, :2]), pushed, rtol=1e-12)
    least = np.sqrt(pushed / media.quadratic.sum())
    speed = np.hypot(before[0, 0] - media.u, before[0, 1] - media.v)
    rate = (media.linear + media.quadratic * np.maximum(speed, least)).sum()
    excess = rate - EXPLICIT_PART / half_dt
    assert excess > 0.0
    np.testing.assert_allclose(slow[0, :2, :2], excess * model.elements.mass[0] * np.eye(2), rtol=1e-12)
    applied = np.zeros((1, len(FORCES), 2))
    plain(accumulate_excess)(op.forcing, 0, tuple(before[0, :2]), (0.3, -0.5), (rate, least), half_dt, 1.0, applied)
    np.testing.assert_allclose(applied.sum(axis=1)[0], [-0.3 * excess, 0.5 * excess], rtol=1e-9)
    assert plain(excess_rate)(EXPLICIT_PART / half_dt, half_dt) == 0.0


def test_a_berg_at_rest_in_still_water_is_not_blown_past_its_speed() -> None:
    """At the start water holds nothing back: by its drag at rest a berg of 60 m went 17 km in two hours, not 2 km."""
    coarse, fine = (made(60.0, 40.0, dt, water=(0.0, 0.0)) for dt in (7200.0, 20.0))
    one, other = way(coarse, 2.0)[-1], way(fine, 2.0)[-1]
    assert np.hypot(*(one - other)) < 0.5 * np.hypot(*other)
