"""A whole run does not depend on where the axes point, where their origin is, or on which hand they are."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from riftberg import Forcing, Iceberg, Model
from verification.setups import RADIUS, parameters

SIDE = 2 * RADIUS
FEW = settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def final(transform: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, int]:
    """Places, spins and broken bonds after a run in transformed axes: drift, collision, grounding drag, fracture."""
    x, y = np.meshgrid(SIDE * np.arange(3), SIDE * np.arange(3))
    places = np.array([[*x.ravel(), *(x.ravel() + 3.5 * SIDE)], [*y.ravel(), *(y.ravel() + 0.4 * SIDE)]])
    places += 0.3 * np.random.default_rng(2).standard_normal(places.shape)
    velocity = transform @ np.array([np.repeat([0.5, -0.2], 9), np.repeat([0.1, 0.0], 9)])
    hand = np.linalg.det(transform)
    sea = Forcing.uniform(
        current=tuple(transform @ [0.3, 0.1]), wind=tuple(transform @ [-9.0, 4.0]), slope=tuple(transform @ [1e-7, 2e-7]),
        sea_ice=(*(transform @ [0.2, -0.1]), 1.0), depth=160.0,
    )  # fmt: skip
    lon, lat = transform @ places
    berg = Iceberg.from_points(
        lon + shift[0], lat + shift[1], thickness=200.0, radius=RADIUS, velocity=tuple(velocity), spin=hand * 2e-5,
        latlon=False,
    )  # fmt: skip
    p = parameters(
        earth={"latlon": False, "period": 0.0, "reference_latitude": -55.0 * hand},
        grounding={"coefficient": 20.0, "ramp_height": 50.0},
        contact={"distance": 4000.0, "tolerance": 1e-13, "spring": 1e-7, "on_substeps": False},
        drag={"ocean_scale": 17.8},
        fracture={"enabled": True, "normal_strength": 6000.0, "shear_strength": 1e9},
        stepping={"time_step": 900.0, "only_interactions": False},
    )
    model = Model(berg, sea, p)
    model.advance(steps=12)
    el = model.elements
    return np.array([el.lon - shift[0], el.lat - shift[1]]), el.spin.copy(), model.bonds_broken


def agree(transform: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)) -> None:
    """Check a run in transformed axes against that in the original ones."""
    places, spins, broken = final(np.eye(2))
    other, other_spins, other_broken = final(transform, shift)
    assert broken == other_broken > 0
    assert np.abs(transform.T @ other - places).max() < 1e-4
    assert np.abs(np.linalg.det(transform) * other_spins - spins).max() < 1e-6 * np.abs(spins).max()


def rotation(angle: float) -> np.ndarray:
    """Matrix of a rotation."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@given(angle=st.floats(0.1, 6.2))
@FEW
def test_rotation(angle) -> None:
    agree(rotation(angle))


@given(angle=st.floats(0.0, 6.2))
@FEW
def test_reflection(angle) -> None:
    agree(rotation(angle) @ np.diag([1.0, -1.0]))


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6))
@FEW
def test_translation(x, y) -> None:
    agree(np.eye(2), (x, y))


def test_the_run_breaks_but_does_not_shatter() -> None:
    assert 1 <= final(np.eye(2))[2] <= 18
