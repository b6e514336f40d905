"""Velocities of a record belong to its positions."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg import A68A_2022, A68A_2022_KID, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters

RADIUS = A68A_2022.earth.radius


def inertial(parameters: Parameters, size: float = 6e3) -> Model:
    """A berg that the current sets off from rest: inertial motion, turning by 12 degrees in a step."""
    berg = Iceberg.rectangle(size, size, thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(0.5, 0.0), slope=(0.0, 0.0)), parameters)


def loose(scheme: str) -> Parameters:
    """Parameters of single elements for the single-step schemes."""
    return A68A_2022_MTS.changed(
        stepping={"scheme": scheme, "time_step": 900.0, "substeps": None},
        bonds={"law": "none"},
        fracture={"enabled": False},
    )


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("parameters", "size", "bound"),
    [(A68A_2022, 6e3, 0.05), (A68A_2022_KID, 6e3, 0.3), (loose("verlet"), 3e3, 0.3), (loose("runge_kutta"), 3e3, 0.3)],
    ids=["own", "reference", "verlet", "runge_kutta"],
)
def test_velocities_of_a_record_are_those_at_its_positions(parameters: Parameters, size: float, bound: float) -> None:
    """They were those of one long step before, 12 degrees off in inertial motion."""
    model = inertial(parameters, size)
    dt = parameters.time_step
    run = model.run(days=1, every_hours=dt / 3600.0).transpose("time", "trajectory", ...)
    north = np.radians(run["lat"].values) * RADIUS
    moved = (north[2:] - north[:-2]) / (2.0 * dt)  # centred on the records between
    velocity = run["v"].values
    right = np.abs(moved - velocity[1:-1])[4:].max()
    late = np.abs(moved - velocity[:-2])[4:].max()
    assert np.abs(velocity).max() > 0.05
    assert right < bound * late


def test_asking_for_velocities_changes_nothing() -> None:
    asked, other = inertial(A68A_2022), inertial(A68A_2022)
    for _ in range(10):
        asked.velocity()
        asked.step()
        other.step()
    for mine, theirs in zip(asked.elements, other.elements, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    u, v = inertial(A68A_2022).velocity()
    assert (u == 0.0).all()
    assert (v == 0.0).all()
