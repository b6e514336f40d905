"""Drag that stops an element in the water within a part of a step: small bergs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters

WATER, AIR = (0.8, 0.0), (15.0, 0.0)


def made(
    length: float,
    thickness: float,
    time_step: float,
    *,
    turned: float = 0.0,
    depth: float = 1e4,
    water: tuple[float, float] = WATER,
    air: tuple[float, float] = AIR,
    latitude: float = -60.0,
    **changes: Any,
) -> Model:
    """Return a berg of one element in current and wind, at rest."""
    c, s = np.cos(turned), np.sin(turned)
    ocean = Forcing.uniform(
        current=(c * water[0], s * water[0]), wind=(c * air[0], s * air[0]), depth=depth, slope=(0.0, 0.0)
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
    plane = {"latlon": False, "period": 0.0, "reference_latitude": latitude}
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


@pytest.mark.parametrize("push", [0.0, 3.0])
def test_in_the_first_half_step_drag_acts_implicitly_beyond_a_quarter(push: float) -> None:
    """Of a berg at rest, by hand: ``w = h a / (1 + h D)``, D the drag at the speed ``(a / c)^(1/2)`` less ``1 / (4 h)``.

    It goes with w through the whole step. ``push``: a force beside that of the water, in parts of it.
    """

    def first_way(time_step: float, load: float) -> float:
        still_air = {"air_side": 0.0, "air_top": 0.0}
        model = made(60.0, 50.0, time_step, air=(0.0, 0.0), latitude=0.0, drag=still_air)
        model.elements.load_x[:] = load
        return float(way(model, time_step / 3600.0)[0, 0])

    mass = float(made(60.0, 50.0, 1.0).elements.mass[0])
    a = 2.0 * first_way(1e-3, 0.0) / 1e-6  # c U^2
    c = a / 0.8**2
    a *= 1.0 + push
    for time_step in (20.0, 1800.0, 7200.0):
        h = 0.5 * time_step
        excess = max(c * max(0.8, np.sqrt(a / c)) - 0.25 / h, 0.0)
        assert (excess > 0.0) == (time_step > 20.0)
        found = first_way(time_step, push * c * 0.8**2 * mass)
        assert found == pytest.approx(time_step * h * a / (1.0 + h * excess), rel=1e-5)


def test_a_berg_at_rest_in_still_water_is_not_blown_past_its_speed() -> None:
    """At the start water holds nothing back: by its drag at rest a berg of 60 m went 17 km in two hours, not 2 km."""
    coarse, fine = (made(60.0, 40.0, dt, water=(0.0, 0.0)) for dt in (7200.0, 20.0))
    one, other = way(coarse, 2.0)[-1], way(fine, 2.0)[-1]
    assert np.hypot(*(one - other)) < 0.5 * np.hypot(*other)
