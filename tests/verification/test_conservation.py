"""Momentum, angular momentum and energy of lattices and of bergs that collide."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model
from verification.setups import (
    DENSITY,
    RADIUS,
    THICKNESS,
    angular_momentum,
    energy,
    inertia,
    lattice,
    momentum,
    parameters,
    shake,
    turn,
)

SIDE = 2 * RADIUS
ALONE = {"only_interactions": True, "time_step": 1800.0}


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("motion", ["rigid", "vibrating"])
def test_objective_damper_keeps_angular_momentum(below, packing, motion) -> None:
    """A day of a berg that turns freely, rigidly or with 10 cm/s of vibration and random spins."""
    p = parameters(stepping=ALONE, bonds={"packing": packing, "damping": 1.0})
    model = lattice(p, 6, 4)
    turn(model, 2e-5)
    if motion == "vibrating":
        shake(model, speed=0.1, spin=5e-5)
    before = angular_momentum(model)
    model.advance(1.0)
    change = abs(angular_momentum(model) / before - 1)
    below(f"free rotation, {packing}, {motion}: change of L in a day", 1e-10, change)


@pytest.mark.parametrize("damping", [0.3, 1.0])
def test_damper_of_the_reference_brakes_rotation(agrees, damping) -> None:
    """L decays as exp(-lambda t), lambda = c_d sum(l^2) / I (quirk Q43)."""
    p = parameters(stepping=ALONE, bonds={"damping": damping, "objective_damping": False})
    model = lattice(p, 12, 8)
    turn(model, 1e-5)
    el = model.elements
    plane = 2 * 5e6 / (3 * (1 - 0.3**2))
    damper = damping * math.sqrt(plane * el.mass[0] / 2)
    total = np.sum(el.mass * (el.lon**2 + el.lat**2)) + np.sum(inertia(model))
    rate = damper * model.bonds.first.size * SIDE**2 / total
    model.advance(0.25)
    before = angular_momentum(model)
    model.advance(0.5)
    got = -math.log(angular_momentum(model) / before) / 43_200.0
    agrees(f"rotation with the reference's damper {damping:g}: decay (1/s)", rate, got, rel=0.01)


def test_objective_damper_damps_vibration() -> None:
    model = lattice(parameters(stepping=ALONE, bonds={"damping": 1.0, "linear_bending": True}))
    shake(model, speed=0.1, spin=5e-5)
    _without_drift(model)
    before = energy(model)
    model.advance(1.0)
    assert energy(model) < 0.05 * before


def _without_drift(model):
    """Take momentum and angular momentum out."""
    el = model.elements
    for name in ("u", "v"):
        getattr(el, name)[:] -= getattr(el, name).mean()
    rate = angular_momentum(model) / (np.sum(el.mass * (el.lon**2 + el.lat**2)) + np.sum(inertia(model)))
    el.u[:] += rate * el.lat
    el.v[:] -= rate * el.lon
    el.spin[:] -= rate
    for name in ("u", "v"):
        getattr(el, f"{name}_sync")[:] = getattr(el, f"{name}_pair")[:] = getattr(el, name)


@pytest.mark.parametrize("objective", [True, False])
@pytest.mark.parametrize("damping", [0.2, 1.0])
def test_dampers_take_energy_in_every_step(objective, damping) -> None:
    p = parameters(
        stepping={**ALONE, "time_step": 300.0, "safety": 0.2},
        bonds={"damping": damping, "objective_damping": objective},
    )
    model = lattice(p)
    shake(model, speed=0.1, spin=5e-5)
    energies = [energy(model)]
    for _ in range(60):
        model.step()
        energies.append(energy(model))
    assert np.all(np.diff(energies[1:]) < 1e-9 * energies[0])
    assert energies[-1] < 0.7 * energies[0]


def test_energy_is_kept_without_dampers(below) -> None:
    """The leapfrog lets the energy swing, but it has no trend; the swing falls with the square of the sub-step."""
    swings = []
    for safety in (0.4, 0.2):
        p = parameters(stepping={**ALONE, "safety": safety, "time_step": 300.0}, bonds={"damping": 0.0})
        model = lattice(p)
        shake(model, speed=0.1, spin=5e-5)
        energies = []
        for _ in range(288):
            model.step()
            energies.append(energy(model))
        mean = np.array(energies).reshape(4, -1).mean(axis=1)
        below(f"energy, undamped, safety {safety:g}: trend in a day", 0.02, float(np.ptp(mean) / mean.mean()))
        swings.append(np.ptp(energies) / np.mean(energies))
    assert swings[1] < 0.4 * swings[0]


@pytest.mark.parametrize("ratio", [1.0, 3.0])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_collision_of_two_elements_keeps_momentum(below, ratio, angle) -> None:
    """KID's contact law with critical damping, iterated."""
    p = parameters(
        contact={
            "distance": 4000.0,
            "tolerance": 1e-13,
            "tangential_critical_damping": True,
            "on_substeps": False,
        },
        stepping=ALONE,
    )
    thickness = THICKNESS * np.array([1.0, ratio])
    berg = Iceberg.from_points(
        [0.0, 5000.0 * math.cos(angle)], [0.0, 5000.0 * math.sin(angle)], thickness=thickness, radius=RADIUS,
        density=DENSITY, velocity=(np.array([0.3, -0.1]), np.array([0.1, 0.0])), latlon=False,
    )  # fmt: skip
    model = Model(berg, Forcing.uniform(), p)
    before, approach = momentum(model), np.diff(model.elements.u)[0]
    touched = False
    for _ in range(60):
        model.step()
        touched |= bool(model.elements.in_contact.any())
    after = momentum(model, synchronised=True)
    assert touched
    assert np.diff(model.elements.u)[0] > 0.0 > approach
    size = float(np.sum(model.elements.mass * 0.3))
    below(f"collision, masses 1:{ratio:g}: change of momentum", 1e-10, float(np.abs(after - before).max() / size))


def test_collision_of_two_lattices_keeps_momentum(below) -> None:
    x, y = np.meshgrid(SIDE * np.arange(3), SIDE * np.arange(2))
    x, y = np.concatenate([x.ravel(), x.ravel() + 12_500.0]), np.concatenate([y.ravel(), y.ravel() + 1000.0])
    thickness = np.repeat([150.0, 250.0], 6)
    berg = Iceberg.from_points(
        x, y, thickness=thickness, radius=RADIUS, velocity=(np.repeat([0.4, 0.0], 6), np.zeros(12)), latlon=False
    )
    p = parameters(contact={"distance": 4000.0, "tolerance": 1e-13, "spring": 1e-6}, stepping=ALONE)
    model = Model(berg, Forcing.uniform(), p)
    before = momentum(model)
    model.advance(1.0)
    after = momentum(model)
    assert model.elements.u[6:].mean() > 0.1
    below("collision of lattices: change of momentum", 1e-9, float(np.abs(after - before).max() / before[0]))


def _crushed(packing: str, **compatibility: bool) -> float:
    """Energy of motion left of a broken lattice whose pieces are pressed together, relative to that of the start."""
    p = parameters(
        stepping={**ALONE, "interactions": False}, bonds={"packing": packing}, compatibility=compatibility,
        fracture={"enabled": True, "normal_strength": 1e12, "shear_strength": 1e12},
    )  # fmt: skip
    whole = lattice(p, 5, 5)
    model = Model(whole_berg(packing), Forcing.uniform(), p.changed(stepping={"substeps": whole.substeps}))
    shake(model, speed=0.01, spin=0.0)
    for name in ("lon", "lat"):
        getattr(model.elements, name)[:] *= 0.999
        getattr(model.elements, f"{name}_pair")[:] = getattr(model.elements, name)
    model.bonds.status[:] = 1
    spring = p.bonds.youngs_modulus / (DENSITY * SIDE**2)
    squeezed = 0.5 * spring * model.elements.mass[0] * model.bonds.first.size * (0.001 * SIDE) ** 2
    moving = 0.5 * np.sum(model.elements.mass * (model.elements.u**2 + model.elements.v**2))
    model.step()
    left = 0.5 * np.sum(model.elements.mass * (model.elements.u**2 + model.elements.v**2))
    return float(left / (moving + squeezed))


def whole_berg(packing: str) -> Iceberg:
    """Return the lattice of `_crushed`."""
    return Iceberg.rectangle(5 * SIDE, 5 * SIDE, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_pieces_in_contact_gain_no_energy(below, packing) -> None:
    """At the sub-step that the bonds allow, fully explicit damping of contacts blew broken bergs apart."""
    below(f"broken {packing} lattice pressed together: energy of motion left", 1.0, _crushed(packing))
    assert _crushed(packing, explicit_contact_damping=True) > 3.0
