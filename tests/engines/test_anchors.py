"""Friction of the sea floor in the sub-steps of contact, against a slow twin: root finding on the law as it is written."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize, root

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.compiled.kernels import plain
from riftberg.engines.quasi_static.contact import anchors
from riftberg.engines.quasi_static.keel_friction import lay_patches
from riftberg.state import new_elements

MASS = np.diag([3e12, 3e12, 4e19])
ANCHOR_WAY = 0.1  # m


def levers(places: np.ndarray) -> np.ndarray:
    """Levers of elements of one body on a plane, at places about its centre (m)."""
    found = np.zeros((len(places), 11))
    found[:, [0, 4, 8, 9]] = 1.0
    found[:, 2], found[:, 5] = -places[:, 1], places[:, 0]
    return found


@cache
def find_seabed() -> Any:
    """The bed of a model, which knows how far anchors stretch."""
    berg = Iceberg.rectangle(1500.0, 1500.0, thickness=200.0, radius=750.0, latlon=False)
    parameters = Parameters(
        earth={"latlon": False, "period": 0.0},
        grounding={"law": "seabed", "anchor_way": ANCHOR_WAY},
        stepping={"only_interactions": True},
    )
    return Model(berg, Forcing.uniform(), parameters)._stepper.memory.laws.seabed  # type: ignore[attr-defined]


def standing(seed: int, scale: float = 1.0) -> tuple[Any, np.ndarray]:
    """Keels of five elements of one body, one of them afloat, and their levers."""
    random = np.random.default_rng(seed)
    keel, places = new_elements(5).keel, random.uniform(-5e3, 5e3, (5, 2))
    keel.floor_hold[:4] = keel.anchor_capacity[:4] = scale * random.uniform(1e8, 4e8, 4)
    keel.anchor_x[:4], keel.anchor_y[:4] = scale * random.uniform(-5e7, 5e7, (4, 2)).T
    keel.floor_arm_x[:4], keel.floor_arm_y[:4] = random.uniform(-400.0, 400.0, (4, 2)).T
    keel.base_xx[:4], keel.base_yy[:4] = random.uniform(1e4, 9e4, (2, 4))
    keel.base_xy[:4] = 0.5 * np.sqrt(keel.base_xx[:4] * keel.base_yy[:4]) * random.uniform(-1.0, 1.0, 4)
    keel.base_xx[0] = keel.base_xy[0] = 0.0  # a line
    keel.base_yy[1] = keel.base_xx[1] = keel.base_xy[1] = 0.0  # a point
    keel.anchor_torque[2:4] = scale * random.uniform(-1e10, 1e10, 2)
    keel.floor_x[:], keel.floor_y[:] = keel.anchor_x, keel.anchor_y
    keel.floor_x[:4] += scale * 1e7  # by the slope of the floor
    return keel, levers(places)


def held(pull: np.ndarray, limit: float, base: np.ndarray) -> np.ndarray:
    """What an area holds of a pull (N, N, and torque over its radius of gyration), by the slip z of least energy.

    It is |pull - z|^2 / 2 + the dissipation of the patches in z.
    """
    patches, radius = np.empty((24, 3)), 0.05  # of a patch
    lay_patches(base, 1.0, 0.0, patches)
    (x, y, weight), round_off = patches.T, 1e-12

    def energy(z: np.ndarray) -> tuple[float, np.ndarray]:
        slip = np.array([z[0] - y * z[2], z[1] + x * z[2], radius * z[2] + 0.0 * x])
        size = np.sqrt((slip**2).sum(axis=0) + round_off**2)
        u, v, w = slip / size * weight
        slope = np.array([u.sum(), v.sum(), (x * v - y * u + radius * w).sum()])
        return float(0.5 * ((pull / limit - z) ** 2).sum() + weight @ size), slope - (pull / limit - z)

    best = minimize(energy, pull / limit, jac=True, method="BFGS", options={"gtol": 1e-10})
    return np.asarray(pull - limit * best.x)


def friction(keel: Any, m: np.ndarray, h: float, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force on the body (N, N, N m) and friction of each anchor (N, N, N m) by the law."""
    total, forces = np.zeros(3), np.zeros((len(m), 3))
    for e in range(len(m)):
        if keel.anchor_capacity[e] == 0.0:
            continue
        arm = np.array([m[e, 5] + keel.floor_arm_x[e], -m[e, 2] + keel.floor_arm_y[e]])
        u = v[:2] + v[2] * np.array([-arm[1], arm[0]])
        base = np.array([keel.base_xx[e], keel.base_xy[e], keel.base_yy[e]])
        r, spring = math.sqrt(base[0] + base[2]), h * keel.anchor_capacity[e] / ANCHOR_WAY
        turn = keel.anchor_torque[e] / r - spring * r * v[2] if r > 0.0 else 0.0
        x, y, turn = held(
            np.array([*([keel.anchor_x[e], keel.anchor_y[e]] - spring * u), turn]), keel.floor_hold[e], base
        )
        forces[e] = x, y, r * turn
        total += [x, y, arm[0] * y - arm[1] * x + r * turn]
    return total, forces


def by_turns(
    a: np.ndarray, m: np.ndarray, h: float, old: np.ndarray, pushed: np.ndarray
) -> tuple[np.ndarray, int, np.ndarray]:
    """Velocity after a sub-step, how many turns it took, and the grip of the last of them."""
    body, guess = np.zeros(len(a), np.int64), old[None].copy()
    now, force, drag, arm = np.zeros((1, 3)), np.empty((1, 3)), np.empty((1, 3, 3)), np.full(1, 3.6e3)
    grip, patches, scratch = np.empty((len(a), 3, 3)), np.empty((36, 3)), np.empty((4, 3, 3))
    plain(anchors.add_floor_force)(a, body, m, now)
    for turn in range(anchors.MOST_TURNS):
        assert plain(anchors.find_grip)(
            a, body, m, h, old[None], guess, np.zeros(1, np.int64), force, drag, grip, patches, scratch
        )
        new = old + np.linalg.solve(MASS + h * drag[0], h * (now[0] + force[0] + pushed))
        if plain(anchors.agree)(guess, new[None], arm):
            return new, turn + 1, grip
        guess = new[None].copy()
    return new, anchors.MOST_TURNS, grip


@pytest.mark.parametrize("h", [0.2, 10.0, 60.0])
@pytest.mark.parametrize("push", [0.0, 0.5, 0.9, 1.3, 4.0])
def test_turns_find_the_velocity_of_the_law(h: float, push: float) -> None:
    """Held and sliding, with and without speed at first."""
    for seed in range(4):
        for speed in (0.0, 0.05):
            keel, m = standing(seed)
            old = np.array([speed, -0.3 * speed, speed * 1e-5])
            pushed = push * keel.floor_hold.sum() * np.array([0.8, 0.6, 100.0])
            downhill = keel.floor_x - keel.anchor_x
            slope = np.array([downhill.sum(), 0.0, -((-m[:, 2] + keel.floor_arm_y) * downhill).sum()])
            found, turns, _ = by_turns(find_seabed().anchors(keel), m, h, old, pushed)

            def rest(q: np.ndarray, keel=keel, m=m, old=old, pushed=pushed, slope=slope) -> np.ndarray:
                v = q * [1.0, 1.0, 1e-4]
                force = friction(keel, m, h, v)[0] + pushed + slope
                return (v - old - h * np.linalg.solve(MASS, force)) * [1.0, 1.0, 1e4]

            exact = root(rest, found * [1.0, 1.0, 1e4], tol=1e-14)
            assert np.abs(exact.fun).max() < 1e-9
            error = np.abs(exact.x - found * [1.0, 1.0, 1e4])
            assert error.max() < 2e-2 * np.abs(exact.x).max() + 2e-5, (seed, speed, turns)


def test_friction_after_a_sub_step_is_that_of_the_law_and_takes_energy() -> None:
    keel, m = standing(1)
    a, old, pushed = find_seabed().anchors(keel), np.array([0.05, 0.0, 0.0]), np.zeros(3)
    new, _, grip = by_turns(a, m, 60.0, old, pushed)
    rubbed, scratch = np.zeros(1), np.empty((4, 3, 3))
    plain(anchors.drag_anchors)(a, np.zeros(5, np.int64), m, 60.0, grip, new[None], new[None], rubbed, scratch)
    _, forces = friction(keel, m, 60.0, new)
    after = a[:, :3]
    np.testing.assert_allclose(after[:, :2], forces[:, :2], rtol=1e-3, atol=1e4)
    np.testing.assert_allclose(after[:, 2], forces[:, 2], rtol=1e-3, atol=1e6)
    assert (np.hypot(*after.T[:2]) <= keel.floor_hold * 1.002).all()
    assert np.abs(after[2:4, 2]).min() > 1e7
    assert rubbed[0] > 0.0
    assert not a[4].any()  # afloat


def test_friction_does_not_depend_on_axes_or_on_the_unit_of_force() -> None:
    keel, m = standing(2)
    old, pushed = np.array([0.02, 0.01, 1e-6]), np.array([3e8, -2e8, 1e11])
    one, *_ = by_turns(find_seabed().anchors(keel), m, 30.0, old, pushed)
    turned, _ = standing(2)
    for name in ("anchor", "floor", "floor_arm"):
        getattr(turned, f"{name}_x")[:], getattr(turned, f"{name}_y")[:] = (
            -getattr(keel, f"{name}_y"), getattr(keel, f"{name}_x"),
        )  # fmt: skip
    turned.base_xx[:], turned.base_yy[:], turned.base_xy[:] = keel.base_yy, keel.base_xx, -keel.base_xy
    places = np.column_stack([m[:, 5], -m[:, 2]])
    two, *_ = by_turns(
        find_seabed().anchors(turned), levers(np.column_stack([-places[:, 1], places[:, 0]])), 30.0,
        np.array([-old[1], old[0], old[2]]), np.array([-pushed[1], pushed[0], pushed[2]]),
    )  # fmt: skip
    np.testing.assert_allclose(two, [-one[1], one[0], one[2]], rtol=1e-9)


def test_sub_steps_of_a_sliding_body_are_a_part_of_its_stopping_time() -> None:
    """Unless it stops within the way by which its anchors stretch, or does not stop."""
    a = find_seabed().anchors(standing(1)[0])
    body = np.zeros(len(a), np.int64)

    def longest(speed: float, stop: float, last: float = 1e3) -> float:
        twist = np.array([[0.6 * speed, 0.8 * speed, 0.0]])
        return float(plain(anchors.longest_sliding_step)(a, body, twist, np.array([0.0]), np.array([stop]), last))

    assert longest(0.1, 50.0) == pytest.approx(anchors.SLIDING_STEP * 50.0)
    assert longest(0.1, 50.0, last=3.0) == 6.0
    assert longest(0.5 * ANCHOR_WAY / 50.0, 50.0) == math.inf
    assert longest(0.1, math.inf) == math.inf
