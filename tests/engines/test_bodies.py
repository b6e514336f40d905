"""Elements that move with their fragment: levers, paths, means and impulses, each against the plain formula."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contract import CORIOLIS, FORCES, SEA_FLOOR
from riftberg import Parameters
from riftberg.compiled.kernels import plain
from riftberg.engines.common.broad_phase import contact_cells
from riftberg.engines.common.forces.media import LIMIT, Medium
from riftberg.engines.common.fragments.connectivity import bridge_moments, find_bridges
from riftberg.engines.quasi_static.bodies.dynamics import ElementForcing, assemble_force_and_jacobian
from riftberg.engines.quasi_static.bodies.pose import mean_displacement, subtract_mean
from riftberg.engines.quasi_static.contact import anchors
from riftberg.engines.quasi_static.contact.islands import accumulate_floor_impulse, accumulate_impulse, element_path
from riftberg.ocean.grid import Grid


def levers(places: Any) -> np.ndarray:
    """Levers of elements of one body on a plane, at places about its centre (m)."""
    found = np.zeros((len(places), 11))
    found[:, [0, 4, 8, 9]] = 1.0
    found[:, 2], found[:, 5] = -places[:, 1], places[:, 0]
    return found


def test_elements_go_round_with_their_body() -> None:
    place, path, turn = np.array([3e3, -2e3]), np.array([40.0, -70.0, 0.3]), 0.3
    c, s = math.cos(turn), math.sin(turn)
    gone = np.array([c * place[0] - s * place[1], s * place[0] + c * place[1]]) - place + path[:2]
    np.testing.assert_allclose(element_path(levers(place[None])[0], path, c, s), gone, rtol=1e-12)


def forcing(count: int, **changes: Any) -> ElementForcing:
    zero = np.zeros(count)
    made = ElementForcing(
        np.zeros((count, len(FORCES) - 1, len(Medium._fields))), zero, zero + 1e9, zero + 1e14, *[zero] * 3,
        np.zeros((count, 0, 4)), zero, zero, zero, True,
    )  # fmt: skip
    return made._replace(**changes)


def test_coriolis_takes_the_momentum_of_the_way() -> None:
    """Its parameter times the displacement, turned to the right; the way is not that of the first velocity."""
    place = np.array([[3e3, -2e3], [-1e3, 4e3]])
    twist, way, f, time = (
        np.array([[0.3, 0.1, 1e-5]]),
        np.array([[500.0, -120.0, 0.01]]),
        np.array([1e-4, -1.2e-4]),
        600.0,
    )
    applied = np.zeros((2, len(FORCES), 2))
    island: Any = SimpleNamespace(body_of=np.zeros(2, int), levers=levers(place), forcing=forcing(2, coriolis=f))
    plain(accumulate_impulse)(island, SimpleNamespace(twist=twist, twist_integral=way), time, applied)
    east, north = way[0, 0] - way[0, 2] * place[:, 1], way[0, 1] + way[0, 2] * place[:, 0]
    np.testing.assert_allclose(applied[:, CORIOLIS], np.stack([f * north, -f * east], axis=1), rtol=1e-9)


def test_impulses_of_the_media_on_elements_add_up_to_that_on_their_body() -> None:
    """Both are linear about the same twist: time * G - S (way - time * twist)."""
    random = np.random.default_rng(6)
    where, body, count = levers(random.uniform(-1.0, 1.0, (3, 2))), np.zeros(3, np.int64), 3
    how = forcing(
        count, coriolis=random.normal(size=count), mass=random.uniform(1.0, 2.0, count),
        sides=random.uniform(0.2, 1.0, (count, 2, 4)), side_drag=random.uniform(0.5, 1.0, count),
    )  # fmt: skip
    how.media[:] = random.uniform(0.1, 0.5, how.media.shape)
    how.media[..., LIMIT] = 0.0
    twist, way, time = random.normal(size=(1, 3)), random.normal(size=(1, 3)), 3.0
    force, jacobian, applied = np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros((count, len(FORCES), 2))
    assemble_force_and_jacobian(body, where, twist, how, np.ones(1, bool), force, jacobian)
    island: Any = SimpleNamespace(body_of=body, levers=where, forcing=how)
    plain(accumulate_impulse)(island, SimpleNamespace(twist=twist, twist_integral=way), time, applied)
    wanted = time * force[0] - jacobian[0] @ (way[0] - time * twist[0])
    np.testing.assert_allclose(np.einsum("e,efi->i", how.mass, applied), wanted[:2], rtol=1e-10)


def test_the_floor_takes_the_momentum_that_its_friction_and_slope_give() -> None:
    anchor, applied = anchors.allocate_anchors(2), np.zeros((2, len(FORCES), 2))
    anchor[0, [anchors.ANCHOR_X, anchors.ANCHOR_Y, anchors.STIFFNESS, anchors.SLOPE_X]] = 3e6, -2e6, 1.0, 1e6
    island: Any = SimpleNamespace(body_of=np.zeros(2, int), forcing=forcing(2))
    plain(accumulate_floor_impulse)(island, anchor, 60.0, applied)
    np.testing.assert_allclose(applied[:, SEA_FLOOR], [[60.0 * 4e6 / 1e9, -60.0 * 2e6 / 1e9], [0.0, 0.0]], rtol=1e-12)


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


def test_a_rigid_motion_has_itself_as_mean_and_leaves_no_deformation() -> None:
    random = np.random.default_rng(2)
    body, xy = np.repeat([0, 1], 6), 1e3 * random.normal(size=(12, 2))
    mass, inertia = random.uniform(1e9, 2e9, 12), random.uniform(1e14, 2e14, 12)
    given = np.array([[0.3, -0.1, 2e-4], [-0.2, 0.5, -1e-4]])
    centre = np.stack([np.average(xy[body == b], axis=0, weights=mass[body == b]) for b in (0, 1)])
    away = xy - centre[body]
    moved = np.stack(
        [given[body, 0] - given[body, 2] * away[:, 1], given[body, 1] + given[body, 2] * away[:, 0], given[body, 2]],
        axis=1,
    )
    mean, moments = np.empty((2, 3)), np.empty((2, 4))
    mean_displacement(body, xy, moved, mass, inertia, mean, moments)
    np.testing.assert_allclose(mean, given, rtol=1e-12)
    np.testing.assert_allclose(moments[:, :2], centre, rtol=1e-12)
    subtract_mean(body, xy, moved, mean, moments)
    np.testing.assert_allclose(moved, 0.0, atol=1e-12)


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
