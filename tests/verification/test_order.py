"""Order of accuracy, measured by halving steps: position differences fall by 2^order."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing
from riftberg.parameters import PUBLISHED_DRAG
from verification.setups import lattice, parameters, shake, single


def order(results: list[Any]) -> float:
    """Order from a sequence of results with steps that halve; the mean over the sequence."""
    errors = [np.abs(a - b).max() for a, b in pairwise(results)]
    return float(np.mean(np.log2(np.array(errors[:-1]) / errors[1:])))


def moved(substeps: int, **groups: Any) -> Any:
    """Places (m) of a shaken lattice after 400 s."""
    p = parameters(
        stepping={"only_interactions": True, "time_step": 400.0, "substeps": substeps},
        bonds={"linear_bending": True, "damping": 0.0, **groups.pop("bonds", {})},
        **groups,
    )
    model = lattice(p, 3, 3)
    shake(model, speed=0.1, spin=1e-4, stretch=1.0)
    model.step()
    return np.concatenate([model.elements.lon, model.elements.lat])


@pytest.mark.parametrize(
    ("what", "groups", "asked"),
    [
        ("no damper", {}, 2.0),
        ("no damper, bending by the sine", {"bonds": {"linear_bending": False}}, 2.0),
        ("no damper, reference's start (Q6)", {"compatibility": {"zero_start": True}}, 1.0),
        ("objective damper", {"bonds": {"damping": 1.0}}, 1.0),
        ("damper of the reference", {"bonds": {"damping": 1.0, "objective_damping": False}}, 1.0),
    ],
)
def test_order_in_the_substep(agrees, what, groups, asked) -> None:
    """Leapfrog is of second order; dampers act at the velocity half a sub-step before: first order."""
    got = order([moved(n, **groups) for n in (640, 1280, 2560, 5120)])
    agrees(f"order in the sub-step, {what}", asked, got, abs=0.2)


class Tide(Forcing.uniform):
    """A current that turns once in twelve hours."""

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        phase = 2 * math.pi * time / 43_200.0
        elements.uo[:], elements.vo[:] = 0.3 * math.cos(phase), 0.3 * math.sin(phase)


HEAVY_DRAG = {**PUBLISHED_DRAG, "ocean_scale": 17.8}


def drifted(dt: float, forcing: Forcing, latitude: float, scheme: str = "mts", **groups: Any) -> Any:
    """Place (m) of an element after two days."""
    model = single(
        forcing, velocity=(0.2, -0.3), drag=HEAVY_DRAG, earth={"reference_latitude": latitude},
        stepping={"time_step": dt, "scheme": scheme}, **groups,
    )  # fmt: skip
    model.advance(steps=round(2 * 86_400.0 / dt))
    return np.array([model.elements.lon[0], model.elements.lat[0]])


@cache
def finely_drifted() -> Any:
    return drifted(12.5, WIND, -55.0)


STEPS = (400.0, 200.0, 100.0, 50.0)
WIND = Forcing.uniform(current=(0.3, 0.1), wind=(8.0, 3.0), slope=(0.0, 0.0))


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("what", "forcing", "latitude", "scheme", "groups", "asked"),
    [
        ("drag", WIND, 0.0, "mts", {}, 2.0),
        ("drag and Coriolis", WIND, -55.0, "mts", {}, 2.0),
        (
            "drag and Coriolis, uncentred",
            WIND,
            -55.0,
            "mts",
            {"compatibility": {"uncentred_half_kicks": True}},
            1.0,
        ),
        ("tide", Tide(), -55.0, "mts", {}, 2.0),
        ("tide, lagged forcing (Q5)", Tide(), -55.0, "mts", {"compatibility": {"forcing_lag": True}}, 1.0),
        pytest.param("drag and Coriolis", WIND, -55.0, "runge_kutta", {}, 1.0, marks=pytest.mark.slow),
        ("drag and Coriolis", WIND, -55.0, "verlet", {}, 1.0),
        ("drag and Coriolis", WIND, -55.0, "quasi_static", {}, 2.0),
        ("tide", Tide(), -55.0, "quasi_static", {}, 2.0),
    ],
)
def test_order_in_the_long_step(agrees, what, forcing, latitude, scheme, groups, asked) -> None:
    # Runge-Kutta with its half implicit drag shows its order at small steps only.
    shorter = 8.0 if scheme == "runge_kutta" else 1.0
    got = order([drifted(dt / shorter, forcing, latitude, scheme, **groups) for dt in STEPS])
    agrees(f"order in the long step, {scheme}, {what}", asked, got, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "most"), [("quasi_static", 55.0), ("mts", 25.0), ("verlet", 130.0), ("runge_kutta", 20.0)]
)
def test_all_schemes_come_to_the_place_of_a_fine_step(agrees, scheme, most) -> None:
    """Steps of 450 s against one of 12.5 s with `mts`, two days, 53 km; the table of the numerics page."""
    fine, coarse = finely_drifted(), drifted(450.0, WIND, -55.0, scheme)
    assert math.hypot(*fine) == pytest.approx(53.7e3, rel=0.01)
    agrees(f"two days by steps of 450 s, {scheme}: error (m)", 0.0, math.hypot(*(coarse - fine)), abs=most)
