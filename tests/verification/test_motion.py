"""Single elements in steady surroundings: closed forms and balances solved with scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

from riftberg import Forcing
from riftberg.errors import RunError
from verification.setups import DENSITY, RADIUS, THICKNESS, single

SIDE = 2 * RADIUS
MASS = DENSITY * THICKNESS * SIDE**2
DRAFT = THICKNESS * DENSITY / 1025.0


class Whirl(Forcing.uniform):
    """Still water that turns."""

    def __init__(self, vorticity: float) -> None:
        super().__init__()
        self.whirl = vorticity

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.vorticity[:] = self.whirl


def coriolis(latitude: float) -> float:
    """Coriolis parameter, s-1."""
    return 2 * 7.292e-5 * math.sin(math.radians(latitude))


@pytest.mark.quick(2)
@pytest.mark.parametrize("latitude", [55.0, -55.0])
@pytest.mark.parametrize("scheme", ["mts", "verlet"])
def test_inertial_circle(agrees, latitude, scheme) -> None:
    """So slow that the quadratic drag of air does not matter."""
    f, speed, dt = coriolis(latitude), 1e-4, 300.0
    model = single(
        velocity=(speed, 0.0), drag={"ocean_scale": 0.0}, earth={"reference_latitude": latitude, "f_plane": True},
        stepping={"time_step": dt, "scheme": scheme},
    )  # fmt: skip
    places, angles = [], []
    for _ in range(round(2 * 2 * math.pi / abs(f) / dt)):
        model.step()
        places.append([model.elements.lon[0], model.elements.lat[0]])
        angles.append(math.atan2(model.elements.v[0], model.elements.u[0]))
    rate = np.polyfit(dt * np.arange(len(angles)), np.unwrap(angles), 1)[0]
    hemisphere = "north" if latitude > 0 else "south"
    agrees(f"inertial circle, {hemisphere}, {scheme}: period (s)", 2 * math.pi / f, -2 * math.pi / rate, rel=1e-3)
    width = np.ptp(np.array(places), axis=0)
    agrees(f"inertial circle, {hemisphere}, {scheme}: radius (m)", speed / abs(f), width.mean() / 2, rel=1e-3)


def balance(velocity, current, wind, sea_ice, slope, f, scale):
    """Sum of all external accelerations on an element at rest in its drift (equations 4.1)."""
    u = np.asarray(velocity)
    uo, ua, ui = np.array(current), np.array(wind), np.array(sea_ice[:2])
    ice = sea_ice[2]
    c_o = 1025.0 / MASS * scale * (0.5 * 0.9 * SIDE * (DRAFT - ice) + 0.0025 * SIDE**2)
    c_a = 1.1 / MASS * (0.5 * 1.3 * SIDE * (THICKNESS - DRAFT) + 0.0015 * SIDE**2)
    c_i = 916.7 / MASS * 0.5 * 0.9 * SIDE * ice
    total = sum(c * np.linalg.norm(w - u) * (w - u) for c, w in ((c_o, uo), (c_a, ua), (c_i, ui)))
    q = np.sum((ua - uo) ** 2)
    amplitude, cutoff, top = 0.5 * 0.02025 * q, 0.125 * 0.32 * q, 0.25 * 0.32 * q
    if q > 0 and np.any(ua != 0.0):
        coefficient = 0.06 * np.clip((SIDE - cutoff) / (top - cutoff), 0.0, 1.0)
        push = 0.5 * 1025.0 / MASS * coefficient * 9.8 * amplitude * min(amplitude, THICKNESS - DRAFT) * SIDE
        total = total + push * ua / np.linalg.norm(ua)
    return total - 9.8 * np.array(slope) + f * np.array([u[1], -u[0]])


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("what", "current", "wind", "sea_ice", "slope", "latitude"),
    [
        ("wind", (0.0, 0.0), (12.0, -5.0), (0.0, 0.0, 0.0), (0.0, 0.0), 0.0),
        ("wind and current", (0.25, 0.1), (-8.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0), 0.0),
        ("wind, current, Coriolis", (0.25, 0.1), (-8.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0), -55.0),
        ("all with sea ice and slope", (-0.2, 0.1), (6.0, 9.0), (0.3, -0.1, 2.0), (2e-7, -3e-7), -60.0),
    ],
)
@pytest.mark.parametrize("scheme", ["mts", "verlet", "runge_kutta"])
def test_terminal_drift(agrees, what, current, wind, sea_ice, slope, latitude, scheme) -> None:
    forcing = Forcing.uniform(current=current, wind=wind, sea_ice=sea_ice, slope=slope)
    model = single(
        forcing, drag={"ocean_scale": 17.8}, earth={"reference_latitude": latitude},
        stepping={"scheme": scheme, "time_step": 900.0},
    )  # fmt: skip
    model.advance(8.0)
    start = model.elements.lon[0], model.elements.lat[0]
    model.advance(1.0)
    got = (np.array([model.elements.lon[0], model.elements.lat[0]]) - start) / 86400.0
    asked = fsolve(balance, current, args=(current, wind, sea_ice, slope, coriolis(latitude), 17.8), xtol=1e-13)
    for axis, name in enumerate("xy"):
        agrees(f"drift, {what}, {scheme}: {name} (m/s)", asked[axis], got[axis], abs=1e-6 * np.linalg.norm(asked))


@pytest.mark.quick(1)
@pytest.mark.parametrize("latitude", [-55.0, 70.0])
def test_geostrophic_balance(agrees, latitude) -> None:
    """In a current balanced by its slope, with air that moves along, the berg goes with the current."""
    f, current = coriolis(latitude), (0.3, -0.15)
    slope = (f * current[1] / 9.8, -f * current[0] / 9.8)
    model = single(
        Forcing.uniform(current=current, wind=current, slope=slope), earth={"reference_latitude": latitude},
        stepping={"time_step": 900.0}, drag={"ocean_scale": 1e4},
    )  # fmt: skip
    # The last of a quadratic drag dies away as 1 / t: a large coefficient shortens the wait.
    model.advance(20.0)
    agrees(f"geostrophic flow at {latitude:g}: u (m/s)", current[0], model.elements.u[0], rel=1e-4)
    agrees(f"geostrophic flow at {latitude:g}: v (m/s)", current[1], model.elements.v[0], rel=1e-4)


@pytest.mark.parametrize("vorticity", [0.0, 4e-5, -3e-5])
def test_water_brings_a_loose_element_to_half_its_vorticity(agrees, vorticity) -> None:
    """``(w - z/2)`` decays as 1 / (1 + c t |w - z/2|) with c = (2 pi / 5) rho C R^5 / I, whatever the step."""
    spin = 2e-3
    c = 2 * math.pi / 5 * 1025.0 * 0.0025 * RADIUS**5 / (0.5 * MASS * RADIUS**2)
    for dt, steps in ((600.0, 100), (60_000.0, 1)):
        model = single(Whirl(vorticity), spin=spin, stepping={"time_step": dt})
        model.advance(steps=steps)
        relative = spin - vorticity / 2
        asked = vorticity / 2 + relative / (1 + c * dt * steps * abs(relative))
        agrees(f"spin in vorticity {vorticity:g}, step {dt:g} s (1/s)", asked, model.elements.spin[0], rel=1e-12)
    model = single(Whirl(vorticity), spin=spin, stepping={"time_step": 1e9})
    model.advance(steps=3)
    assert model.elements.spin[0] == pytest.approx(vorticity / 2, abs=1e-3 * spin)


def aground(rate_times_step, *, implicit, steps=40):
    """Speed of an element on the sea floor after 40 sub-steps, relative to that at the start."""
    dt = 60.0
    coefficient = rate_times_step / dt * DENSITY * THICKNESS
    model = single(
        Forcing.uniform(depth=0.0), velocity=(1e-3, 0.0), grounding={"coefficient": coefficient, "implicit": implicit},
        stepping={"time_step": steps * dt, "substeps": steps, "only_interactions": True},
    )  # fmt: skip
    try:
        model.step()
    except RunError:
        return math.inf
    return abs(model.elements.u[0]) / 1e-3


@pytest.mark.parametrize("rate_times_step", [0.1, 1.0, 3.0, 1e3, 1e9])
def test_implicit_drag_of_the_floor_is_stable_for_any_rate(agrees, rate_times_step) -> None:
    asked = (1 + rate_times_step) ** -40.0
    got = aground(rate_times_step, implicit=True)
    agrees(f"floor, implicit, rate x step {rate_times_step:g}: speed left", asked, got, abs=1e-12)


def test_explicit_drag_of_the_floor_blows_up_beyond_two() -> None:
    assert aground(1.9, implicit=False, steps=400) < 1e-3
    assert aground(2.1, implicit=False, steps=400) > 1e3


def test_implicit_and_explicit_drag_of_the_floor_converge_to_each_other() -> None:
    """Both to exp(-rate t), with first order; the explicit one acts at the velocity before the sub-step."""
    errors = []
    for steps in (40, 80, 160):
        left = [aground(4.0 / steps, implicit=implicit, steps=steps) for implicit in (True, False)]
        errors.append(np.abs(np.array(left) / math.exp(-4.0) - 1.0))
    assert np.all(errors[-1] < 0.12)
    assert np.all(np.abs(np.log2(np.array(errors[1:-1]) / errors[2:]) - 1.0) < 0.15)
