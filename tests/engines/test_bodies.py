"""Elements that move with their fragment: impulses, displacements and moments, and the derivative of the forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from contract import FORCES
from riftberg import Forcing, Grid, Iceberg, Model, Parameters
from riftberg.engines.common.broad_phase import contact_cells
from riftberg.engines.common.forces.media import Medium
from riftberg.engines.common.fragments.connectivity import bridge_moments, find_bridges
from riftberg.engines.quasi_static.bodies.dynamics import ElementForcing, assemble_force_and_jacobian


def forcing(count: int, **changes: Any) -> ElementForcing:
    zero = np.zeros(count)
    made = ElementForcing(
        np.zeros((count, len(FORCES) - 1, len(Medium._fields))), zero, zero + 1e9, zero + 1e14, *[zero] * 3,
        np.zeros((count, 0, 4)), zero, zero, zero, True,
    )  # fmt: skip
    return made._replace(**changes)


class Shoal(Forcing.uniform):
    """Everything that pushes, over a bank from 4 km east on."""

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the depth (m)."""
        return np.where(np.asarray(lon) > 4e3, 165.0, 1000.0) - 1e-4 * np.asarray(lat)


def test_impulses_on_elements_in_contact_and_aground_add_up_to_the_motion_of_their_bergs() -> None:
    """To round-off: media and Coriolis force by the way of each element, sides by the turn, the floor by friction and slope.

    In the sub-steps forces are linear about a twist of each body; elements have their parts of the same.
    """
    plane = {"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": -60.0}
    shape = {"thickness": 200.0, "radius": 750.0, "latlon": False}
    bergs = [
        Iceberg.rectangle(6e3, 3e3, velocity=(0.3, 0.05), rotation=10.0, **shape),
        Iceberg.rectangle(3e3, 6e3, placement=(6e3, 400.0), rotation=25.0, **shape),
    ]
    sea = Shoal(current=(0.4, 0.1), wind=(12.0, -5.0), slope=(1e-6, -2e-6), sea_ice=(0.2, 0.1, 1.0), ice_fraction=0.6)
    p = Parameters(earth=plane, stepping={"time_step": 600.0}, fracture={"enabled": False})
    model = Model(Iceberg.join(bergs), sea, p)
    for _ in range(10):
        model.step()
        assert model.motion.balance(model, model.remembered).momentum_error < 1e-13, model.time
    assert model.contacts.rows
    assert model.elements.keel.floor_load.sum() > 0.0
    impulse = model.motion.balance(model, model.remembered).impulse
    assert all(np.hypot(*impulse[name]) > 1e8 for name in FORCES if name != "own")


def test_loads_bend_a_berg_and_neither_shift_nor_turn_it() -> None:
    """Soft and stiff bergs go the same way: displacements have no mean momentum, and no mean moment of it."""
    moved = []
    for modulus in (1e7, 1e11):
        berg = Iceberg.rectangle(12e3, 4.5e3, thickness=200.0, radius=750.0, latlon=False, rotation=30.0)
        p = Parameters(
            earth={"latlon": False, "period": 0.0}, bonds={"youngs_modulus": modulus}, fracture={"enabled": False},
            stepping={"only_interactions": True},
        )  # fmt: skip
        model = Model(berg, Forcing.uniform(), p)
        model.elements.load_x[:], model.elements.load_y[:] = 1e8 * np.random.default_rng(2).normal(
            size=(2, model.elements.size)
        )
        model.advance(steps=3)
        moved.append(model.elements)
    soft, stiff = moved
    (x, y), mass = np.array([soft.lon - stiff.lon, soft.lat - stiff.lat]), stiff.mass
    bent = np.abs(soft.rotation - stiff.rotation).max()
    assert bent > 3e-5
    assert abs(np.average(x, weights=mass)) < 1e-8
    assert abs(np.average(y, weights=mass)) < 1e-8
    arm_x, arm_y = (a - np.average(a, weights=mass) for a in (stiff.lon, stiff.lat))
    turned = mass @ (arm_x * y - arm_y * x) + mass @ (1500.0**2 / 6.0 * (soft.rotation - stiff.rotation))
    assert abs(turned) < 1e-3 * bent * (mass @ (arm_x**2 + arm_y**2))


def test_the_jacobian_is_the_derivative_of_the_force() -> None:
    """For any levers: on the sphere all nine of an element count."""
    random = np.random.default_rng(5)
    m = np.zeros((3, 11))
    m[:] = random.normal(size=(3, 11))
    how = forcing(
        3, coriolis=random.normal(size=3), mass=random.uniform(1.0, 2.0, 3), inertia=random.uniform(1.0, 2.0, 3),
        spin_drag=random.uniform(0.5, 1.0, 3), water_spin=random.normal(size=3) * 0.1,
        sides=random.uniform(0.2, 1.0, (3, 2, 4)), side_drag=random.uniform(0.5, 1.0, 3),
    )  # fmt: skip
    how.media[:] = random.uniform(0.1, 0.5, how.media.shape)
    how.media[..., Medium._fields.index("limit")] = 0.0  # a pack that yields has a corner there
    body, active = np.zeros(3, np.int64), np.ones(1, bool)

    def at(twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        force, jacobian = np.zeros((1, 3)), np.zeros((1, 3, 3))
        assemble_force_and_jacobian(body, m, twist[None].copy(), how, active, force, jacobian)
        return force[0], jacobian[0]

    twist, h = np.array([0.7, -0.4, 0.9]), 1e-6
    slope = np.stack([(at(twist + h * e)[0] - at(twist - h * e)[0]) / (2.0 * h) for e in np.eye(3)], axis=1)
    np.testing.assert_allclose(-at(twist)[1], slope, rtol=1e-5, atol=1e-7)


def test_the_only_bond_between_two_parts_bears_their_moment() -> None:
    """Two pairs of forces on a bar of three elements that lies askew: the moment about the middle of each bond."""
    xy = np.array([[0.0, 0.0], [3e3, 1e3], [6e3, 2e3]])
    force = np.array([[1e6, 2e6], [-4e6, -1e6], [3e6, -1e6]])
    turn = np.array([5e9, 0.0, 0.0])
    turn[2] = -turn[0] - (xy[:, 0] * force[:, 1] - xy[:, 1] * force[:, 0]).sum()
    load = np.column_stack([force, turn])
    first, second, rows = np.array([0, 1]), np.array([1, 2]), np.array([0, 1])
    bridges = find_bridges(first, second, rows, 3)
    moment = np.zeros(2)
    moment[bridges.bond] = bridge_moments(bridges, first, second, rows, xy, load, np.zeros(3, bool), np.zeros(2))
    assert sorted(bridges.bond) == [0, 1]
    for k in (0, 1):
        away = xy[: k + 1] - 0.5 * (xy[k] + xy[k + 1])
        of_part = (away[:, 0] * force[: k + 1, 1] - away[:, 1] * force[: k + 1, 0] + turn[: k + 1]).sum()
        assert abs(moment[k]) == pytest.approx(abs(of_part), rel=1e-12)


@pytest.mark.parametrize(("distance", "cells"), [(900.0, 1), (1900.0, 2), (2500.0, 3)])
def test_contact_by_cells_looks_as_far_as_the_distance_of_contact(distance: float, cells: int) -> None:
    p = Parameters(
        stepping={"scheme": "mts"},
        earth={"latlon": False, "period": 0.0},
        contact={"distance": distance},
        compatibility={"contact_by_cells": True},
    )
    x, y = np.meshgrid(np.arange(0.0, 12_001.0, 1000.0), np.arange(0.0, 9001.0, 1000.0))
    grid = Grid.from_corners(x, y, latlon=False)
    found = contact_cells(p, grid)
    assert found is not None
    assert (found.columns, found.rows) == (cells, cells)
