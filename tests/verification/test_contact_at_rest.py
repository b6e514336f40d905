"""Bergs that rest against each other: they stay where they touch, and crush no more than what presses them gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.ocean.analytic import Steady
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from twins import crushing as twin

HALF = 500.0  # of the wall
PUSH = 2e-5  # m s-2


def against_wall(
    turn: float,
    dt: float,
    *,
    size: float = 60.0,
    aside: float = 0.0,
    mirrored: bool = False,
    gap: float = 0.0,
    **groups: Any,
) -> Model:
    """A block, turned (degrees), whose corner touches a berg that is held; ``aside`` along its face (m)."""
    c, s = np.cos(np.radians(turn)), abs(np.sin(np.radians(turn)))
    side = 1.0 if mirrored else -1.0
    wall = Iceberg.rectangle(2.0 * HALF, 2.0 * HALF, thickness=200.0, radius=HALF, latlon=False)
    block = Iceberg.rectangle(
        size, size, thickness=50.0, radius=0.5 * size, latlon=False, rotation=turn,
        placement=(side * (HALF + gap + 0.5 * size * (c + s)), aside),
    )  # fmt: skip
    stepping = {"time_step": dt, **groups.pop("stepping", {})}
    p = Parameters(earth={"latlon": False, "period": 0.0}, stepping=stepping, fracture={"enabled": False}, **groups)
    model = Model(Iceberg.join([wall, block]), Steady(), p)
    model.elements.body.static[0] = 1.0
    model.elements.load_x[1] = -side * PUSH * model.elements.mass[1]
    return model


def depth(model: Model, size: float = 60.0) -> float:
    """How deep (m) the flat side of the block stands in the wall."""
    return float(HALF + 0.5 * size - abs(model.elements.lon[1]))


@pytest.mark.parametrize(
    ("turn", "dt", "groups"),
    [(10.0, 600.0, {}), (10.0, 1800.0, {}), (-10.0, 1800.0, {}), (25.0, 1800.0, {}), (10.0, 1800.0, {"mirrored": True}),
     (10.0, 1800.0, {"size": 150.0}), (10.0, 1800.0, {"contact": {"friction": 0.0}}), (10.0, 1800.0, {"aside": -170.0})],
)  # fmt: skip
def test_a_small_berg_that_is_pressed_on_comes_to_rest_where_it_touches(
    turn: float, dt: float, groups: dict[str, Any]
) -> None:
    """Bug: it rocked for ever and came in by half a metre to a metre in 12 hours, without an end."""
    model = against_wall(turn, dt, **groups)
    size = groups.get("size", 60.0)
    start, mass = float(model.elements.lon[1]), float(model.elements.mass[1])
    model.advance(days=1.0 / 6.0)
    came = depth(model, size)
    model.advance(days=1.0 / 3.0)
    el = model.elements
    assert abs(depth(model, size)) < 0.05
    assert abs(depth(model, size) - came) < 1e-3
    assert abs(el.spin[1]) < 5e-8
    assert np.degrees(el.rotation[1]) == pytest.approx(-turn, abs=0.01)
    booked = float(model._stepper.state_dict()["meeting_dissipated"][0])
    assert 0.0 < booked < PUSH * mass * abs(el.lon[1] - start)


def test_a_block_flat_on_a_wall_goes_as_its_twin() -> None:
    """A push that swells and slackens in steps of ten seconds, each of which is one sub-step."""
    model = against_wall(0.0, 10.0, stepping={"only_interactions": True})
    el, law, mass = model.elements, model.parameters.contact, float(model.elements.mass[1])
    push = mass * PUSH * (1.0 + 0.9 * np.sin(0.3 * np.arange(60)))
    found = []
    for p in push:
        model.elements.load_x[1] = p
        model.advance(steps=1)
        found.append(depth(model))
    wanted, work = twin.pressed_flat(
        push, mass, 60.0, 50.0, float(law.crushing_strength), float(law.crushing_depth), 100.0, 10.0
    )
    assert el.size == 2
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-7)
    assert float(model._stepper.state_dict()["meeting_dissipated"][0]) == pytest.approx(work, rel=1e-3)
