"""Twelve sanity tests of forces: sign, size and bounds in constant forcing (the table in docs/explanation/forces.md).

A berg of 6 km x 4 km x 200 m. Sizes are written out here from the equations, with numbers and not with the code's functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract import FORCES
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import GRAVITY
from scripts import table_rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "forces.md"

LENGTH, WIDTH, THICKNESS = 6e3, 4e3, 200.0
AREA, SIDE = LENGTH * WIDTH, 0.5 * (LENGTH + WIDTH)  # m2; a quarter of the perimeter, m
MASS = 850.0 * AREA * THICKNESS
DRAFT = THICKNESS * 850.0 / 1025.0
FREEBOARD = THICKNESS - DRAFT
COMPASS = [(math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8)]
"""Unit vectors towards east, north-east, north and so on."""

ALONG, ACROSS = (1025.0 * (0.5 * 0.9 * side * DRAFT + 0.0025 * AREA) for side in (WIDTH, LENGTH))
"""Drag of the water on sides and base, N for 1 m/s, along the berg and across it."""

AIR = 1.1 * (0.5 * 1.3 * SIDE * FREEBOARD + 0.0015 * AREA)
"""Drag of the air on freeboard and top, N for 1 m/s."""


class Swell(Forcing.uniform):
    """Waves given by height, period and the direction in which they travel."""

    def __init__(self, height: float, period: float, towards: Sequence[float], **others: Any) -> None:
        super().__init__(**others)
        self.swell = height, period, *towards

    def sample(self, elements: Any, time: float) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        env = elements.environment
        env.wave_height[:], env.wave_period[:], env.wave_x[:], env.wave_y[:] = self.swell


class Whirl(Forcing.uniform):
    """Still water that rotates at half of this vorticity, s-1."""

    def __init__(self, vorticity: float) -> None:
        super().__init__()
        self.vorticity = vorticity

    def sample(self, elements: Any, time: float) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.environment.vorticity[:] = self.vorticity


def afloat(
    forcing: Forcing, *, step: float = 1.0, latitude: float = 0.0, velocity: Sequence[float] = (0.0, 0.0),
    capture: str = "limited",
) -> Model:  # fmt: skip
    """Return the berg on a plane, whole, in the default scheme."""
    berg = Iceberg.rectangle(LENGTH, WIDTH, thickness=THICKNESS, radius=1e3, latlon=False, velocity=tuple(velocity))
    return Model(
        berg, forcing,
        Parameters(
            stepping={"time_step": step}, earth={"latlon": False, "reference_latitude": latitude}, fracture={"enabled": False},
            sea_ice={"capture": capture},
        ),
    )  # fmt: skip


def force(name: str, forcing: Forcing, **others: Any) -> Any:
    """Return the force (N, east and north) of one medium on the berg in the first second."""
    model = afloat(forcing, **others)
    model.step()
    return model.applied_forces().sum(axis=0)[FORCES.index(name)]


def drift(model: Model, hours: float) -> Any:
    """Return the velocity of the berg (m/s) after a time, and check that it has settled."""
    model.advance(f"{hours - 1} h")
    before = np.array([model.elements.motion.u.mean(), model.elements.motion.v.mean()])
    model.advance("1 h")
    after = np.array([model.elements.motion.u.mean(), model.elements.motion.v.mean()])
    np.testing.assert_allclose(after, before, atol=1e-3 * np.hypot(*after) + 1e-9)
    return after


def around(name: str, make: Callable[[Any], Forcing], size: float, *, towards: float = 1.0, **others: Any) -> float:
    """Check size and direction of a force for forcing in eight directions; return the size, N."""
    sizes = []
    for unit in COMPASS:
        got = force(name, make(np.array(unit)), **others)
        np.testing.assert_allclose(got, towards * size * np.array(unit), atol=2e-3 * size)
        sizes.append(float(np.hypot(*got)))
    return float(np.mean(sizes))


def note(number: int, expected: float, got: float) -> None:
    """Check that the page has the figures of this test."""
    rows = {row[0]: row for row in table_rows(PAGE, "forces")}
    assert rows[str(number)][4:6] == (f"{expected:.4g}", f"{got:.4g}"), f"{number} | {expected:.4g} | {got:.4g}"


def test_1_current_pushes_downstream() -> None:
    for unit in np.array(COMPASS):
        # Pressure is normal to sides, and its parts across them go by the square of the current across them.
        want = 1025.0 * 0.09 * (0.45 * DRAFT * np.array([WIDTH, LENGTH]) * abs(unit) + 0.0025 * AREA) * unit
        got = force("water", Forcing.uniform(current=0.3 * unit, slope=(0.0, 0.0)))
        np.testing.assert_allclose(got, want, atol=2e-3 * np.hypot(*want))
        assert got @ unit > 0.98 * np.hypot(*got)  # little across the current
    got = float(np.hypot(*force("water", Forcing.uniform(current=(0.3, 0.0), slope=(0.0, 0.0)))))
    twice = np.hypot(*force("water", Forcing.uniform(current=(0.6, 0.0), slope=(0.0, 0.0))))
    assert twice == pytest.approx(4.0 * got, rel=5e-3)
    broadside = np.hypot(*force("water", Forcing.uniform(current=(0.0, 0.3), slope=(0.0, 0.0))))
    assert broadside == pytest.approx(ACROSS * 0.09, rel=2e-3)
    assert broadside < 1025.0 * 0.09 * (LENGTH * DRAFT + 0.01 * AREA)  # full pressure on the longer side, rough base
    note(1, ALONG * 0.09, got)


def test_2_wind_pushes_downwind() -> None:
    got = around("air", lambda unit: Forcing.uniform(wind=10.0 * unit), AIR * 100.0)
    assert np.hypot(*force("air", Forcing.uniform(wind=(20.0, 0.0)))) == pytest.approx(4.0 * got, rel=1e-3)
    assert AIR < 0.01 * ALONG  # a thousandth of the density, a fifth of the height, a rougher top
    note(2, AIR * 100.0, got)


def test_3_wind_sea_pushes_downwind() -> None:
    amplitude = 0.010125 * 100.0
    size = 0.5 * 1025.0 * 0.06 * 9.8 * amplitude**2 * 2.0 * AREA / (LENGTH + WIDTH)
    got = around("waves", lambda unit: Forcing.uniform(wind=10.0 * unit), size)
    assert got < 0.5 * 1025.0 * 9.8 * amplitude**2 * WIDTH  # waves that are all thrown back
    assert got < AIR * 100.0
    note(3, size, got)


def test_4_swell_pushes_where_it_travels() -> None:
    """In calm air and against the wind; an error of direction "from" instead of "towards" turns the sign."""
    size = 0.5 * 1025.0 * 0.06 * 9.8 * 1.5**2 * 2.0 * AREA / (LENGTH + WIDTH)
    got = around("waves", lambda unit: Swell(3.0, 8.0, unit), size)
    against = force("waves", Swell(3.0, 8.0, (0.0, 1.0), wind=(0.0, -10.0)))
    np.testing.assert_allclose(against, (0.0, got), atol=1e-3 * got)
    note(4, size, got)


def test_5_sea_ice_takes_the_berg_along() -> None:
    size = 916.7 * 0.5 * 0.9 * SIDE * 1.0 * 0.2**2
    got = around(
        "sea_ice",
        lambda unit: Forcing.uniform(sea_ice=(0.2 * unit[0], 0.2 * unit[1], 1.0), ice_fraction=1.0),
        size,
        capture="none",
    )
    half = force("sea_ice", Forcing.uniform(sea_ice=(0.2, 0.0, 1.0), ice_fraction=0.5), capture="none")
    assert np.hypot(*half) == pytest.approx(0.5 * got, rel=2e-3)
    assert (
        np.hypot(*force("sea_ice", Forcing.uniform(sea_ice=(0.2, 0.0, 0.0), ice_fraction=1.0))) == 0.0
    )  # no ice, no force
    assert (
        np.hypot(*force("sea_ice", Forcing.uniform(sea_ice=(0.2, 0.0, 1.0), ice_fraction=0.1))) == 0.0
    )  # nor from single floes
    bears = np.hypot(*force("sea_ice", Forcing.uniform(sea_ice=(0.2, 0.0, 1.0), ice_fraction=0.9)))
    assert bears == pytest.approx(20e3 * math.exp(-2.0) * SIDE + 0.9 * size, rel=2e-3)
    note(5, size, got)


def test_6_berg_slides_down_the_sea_surface() -> None:
    size = MASS * 9.8 * 1e-6
    got = around("slope", lambda unit: Forcing.uniform(slope=1e-6 * unit), size, towards=-1.0)
    note(6, size, got)


@pytest.mark.parametrize(("latitude", "turn"), [(60.0, -1.0), (-60.0, 1.0)])
def test_7_coriolis_force_is_to_the_right_in_the_north(latitude: float, turn: float) -> None:
    size = MASS * 2.0 * 7.292e-5 * math.sin(math.radians(60.0)) * 0.2
    for unit in COMPASS:
        got = force(
            "coriolis",
            Forcing.uniform(current=0.2 * np.array(unit), slope=(0.0, 0.0)),
            latitude=latitude,
            velocity=0.2 * np.array(unit),
        )
        # A turn by -90 degrees is to the right.
        np.testing.assert_allclose(got, size * turn * np.array([-unit[1], unit[0]]), atol=2e-3 * size)
    note(7, size, float(np.hypot(*got)))


def test_8_sea_floor_holds_and_never_pushes() -> None:
    for unit in COMPASS:
        moving = 0.2 * np.array(unit)
        got = force("sea_floor", Forcing.uniform(current=moving, depth=DRAFT - 10.0, slope=(0.0, 0.0)), velocity=moving)
        assert got @ moving < 0.0
        assert abs(got[0] * unit[1] - got[1] * unit[0]) < 1e-6 * np.hypot(*got)
        assert np.hypot(*got) <= MASS * 0.2 / 1.0  # it takes no more momentum in a second than the berg has
    assert not force(
        "sea_floor", Forcing.uniform(current=(0.2, 0.0), depth=DRAFT + 1.0, slope=(0.0, 0.0)), velocity=(0.2, 0.0)
    ).any()
    # Sand bears the 10 m; within 0.1 m its friction, half of that load, is a spring: one step by the trapezoidal rule.
    swing = 0.5 * 1025.0 * GRAVITY * 10.0 * AREA / (0.1 * MASS) / 4.0
    size = MASS * 0.2 * 2.0 * swing / (1.0 + swing)
    assert np.hypot(*got) == pytest.approx(size, rel=0.02)
    note(8, size, float(np.hypot(*got)))


def test_9_berg_goes_with_the_water_but_for_the_drag_of_the_air() -> None:
    """Still air holds the freeboard back: the root of the balance of the two drags."""
    expected = 0.2 / (1.0 + math.sqrt(AIR / ACROSS))
    for unit in COMPASS[:3]:
        model = afloat(Forcing.uniform(current=0.2 * np.array(unit), slope=(0.0, 0.0)), step=3600.0)
        for _ in range(20):
            model.step()
            assert 0.0 < np.hypot(model.elements.motion.u.mean(), model.elements.motion.v.mean()) < 0.2  # never faster
    got = drift(model, 24.0 * 40)
    np.testing.assert_allclose(got, expected * np.array(unit), atol=0.005 * expected)
    note(9, expected, float(np.hypot(*got)))


def test_10_wind_drift_is_the_balance_of_air_waves_and_water() -> None:
    """The root of the balance without Coriolis force, by bisection."""
    wave = 0.5 * 1025.0 * 0.06 * 9.8 * 1.0125**2 * 2.0 * AREA / (LENGTH + WIDTH)
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if AIR * (10.0 - middle) ** 2 + wave > ACROSS * middle**2 else (low, middle)
    got = drift(afloat(Forcing.uniform(wind=(0.0, 10.0)), step=3600.0), 24.0 * 20)
    assert abs(got[0]) < 1e-9
    assert 0.0 < got[1] < 0.05 * 10.0  # a few hundredths of the wind
    assert got[1] == pytest.approx(low, rel=5e-3)
    note(10, low, got[1])


def test_11_wind_drift_is_right_of_the_wind_in_the_north_and_left_in_the_south() -> None:
    """A giant berg goes nearly across the wind: the Coriolis force is what balances it."""
    north, south = (
        drift(afloat(Forcing.uniform(wind=(0.0, 10.0)), step=1800.0, latitude=phi), 24.0 * 25) for phi in (60.0, -60.0)
    )
    wave = 0.5 * 1025.0 * 0.06 * 9.8 * 1.0125**2 * 2.0 * AREA / (LENGTH + WIDTH)
    f = 2.0 * 7.292e-5 * math.sin(math.radians(60.0))
    across = (AIR * 100.0 + wave) / (MASS * f)
    assert north[0] == pytest.approx(across, rel=0.05)
    assert 0.0 < north[1] < north[0]
    np.testing.assert_allclose(south, (-north[0], north[1]), rtol=1e-6)
    note(11, across, north[0])


@pytest.mark.quick(1)
@pytest.mark.parametrize("vorticity", [2e-4, -2e-4])
def test_12_rotating_water_turns_the_ice_its_own_way(vorticity: float) -> None:
    ice = Iceberg.from_points([0.0], [0.0], thickness=5.0, radius=1e3, latlon=False)
    model = Model(
        ice, Whirl(vorticity),
        Parameters(stepping={"time_step": 3600.0}, earth={"latlon": False}, fracture={"enabled": False}),
    )  # fmt: skip
    for _ in range(20):
        model.step()
        assert 0.0 < model.elements.motion.spin[0] / (0.5 * vorticity) < 1.0  # never faster than the water
    model.advance("40 days")
    got = float(model.elements.motion.spin[0])
    assert got == pytest.approx(0.5 * vorticity, rel=0.02)
    if vorticity > 0.0:
        note(12, 0.5 * vorticity, got)


def test_the_page_has_twelve_rows() -> None:
    assert [row[0] for row in table_rows(PAGE, "forces")] == [str(k) for k in range(1, 13)]
