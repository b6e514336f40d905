"""Friction of an area that slides and spins, beside sums over many small patches of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg.engines.quasi_static.keel_friction import give_way, lay_patches


def turned(xx: float, yy: float, angle: float) -> np.ndarray:
    """Variances along turned axes."""
    c, s = math.cos(angle), math.sin(angle)
    axes = np.array([[c, -s], [s, c]])
    return np.asarray(axes @ np.diag([xx, yy]) @ axes.T)


def friction_of_rectangle(length: float, width: float, slip: np.ndarray, count: int = 200) -> np.ndarray:
    """Friction of a rectangle against a slip (east, north, spin), with lengths in radii of gyration."""
    x, y = np.meshgrid(*((np.arange(count) + 0.5) / count - 0.5,) * 2)
    gyration = math.sqrt((length**2 + width**2) / 12.0)
    x, y = length * x / gyration, width * y / gyration
    u, v = slip[0] - slip[2] * y, slip[1] + slip[2] * x
    size = np.hypot(u, v)
    return np.array([(u / size).mean(), (v / size).mean(), ((x * v - y * u) / size).mean()])


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
@pytest.mark.parametrize("axes", [0.0, 0.7, -1.9])
def test_patches_have_the_variances_of_the_area_as_it_is_turned(angle: float, axes: float) -> None:
    own = turned(4.0, 1.0, angle)
    patches = np.empty((24, 3))
    lay_patches(variances(own), math.cos(axes), math.sin(axes), patches)
    place, weight = patches[:, :2], patches[:, 2]
    assert weight.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weight @ place, 0.0, atol=1e-12)
    np.testing.assert_allclose((weight[:, None] * place).T @ place * 5.0, turned(4.0, 1.0, angle + axes), atol=1e-12)


def variances(own: np.ndarray) -> np.ndarray:
    return np.array([own[0, 0], own[0, 1], own[1, 1]])


def give_way_to(base: np.ndarray, force: np.ndarray, secant: bool = False) -> tuple[bool, np.ndarray, np.ndarray]:
    """Whether it slips, what is left of a force, and its slope."""
    friction, slope = np.empty(3), np.empty((3, 3))
    slips = give_way(force, 1.0, base, 1.0, 0.0, secant, friction, slope, np.empty((36, 3)))
    return bool(slips), friction, slope


@pytest.mark.parametrize(("length", "width"), [(1.0, 1.0), (1.5, 1.0), (4.0, 1.0)])
def test_patches_hold_what_many_small_ones_do(length: float, width: float) -> None:
    """Against slips of any kind, within 1.5 % of the largest friction on average; each alone, too."""
    base, rng, errors = np.array([length**2 / 12.0, 0.0, width**2 / 12.0]), np.random.default_rng(0), []
    for slip in [*np.eye(3), *rng.normal(size=(60, 3))]:
        slides, friction, _ = give_way_to(base, 1e3 * slip)
        assert slides
        errors.append(abs(friction - friction_of_rectangle(length, width, 1e3 * slip - friction)).max())
    assert max(errors[:3]) < 0.015
    assert np.mean(errors) < 0.015


@pytest.mark.parametrize("seed", range(8))
def test_a_force_gives_way_to_the_nearest_that_is_held(seed: int) -> None:
    """It is held then, as all between it and none; and no other that is held is nearer: a slip does the most work."""
    rng = np.random.default_rng(seed)
    own, force = turned(*rng.uniform(0.1, 1.0, 2), rng.uniform(0.0, 3.0)), rng.normal(size=3)
    force *= rng.uniform(1.2, 5.0) / np.linalg.norm(force)
    base = variances(own)
    slides, friction, tangent = give_way_to(base, force)
    assert slides
    slip = force - friction
    for held in (0.0, 0.5, 1.0 - 1e-9):
        slides, left, slope = give_way_to(base, held * friction)
        assert not slides
        np.testing.assert_array_equal(left, held * friction)
        np.testing.assert_array_equal(slope, np.eye(3))
    for other in rng.normal(size=(50, 3)):
        assert give_way_to(base, 100.0 * other)[1] @ slip <= friction @ slip + 1e-9
    for k in range(3):
        change = 1e-6 * np.eye(3)[k]
        above, below = (give_way_to(base, force + sign * change)[1] for sign in (1.0, -1.0))
        np.testing.assert_allclose(tangent[:, k], (above - below) / 2e-6, atol=1e-5)


def stored(base: np.ndarray, force: np.ndarray) -> float:
    """Energy whose derivative the friction is: from none to a force."""
    steps = (np.arange(400) + 0.5) / 400
    return float(np.mean([give_way_to(base, share * force)[1] @ force for share in steps]))


@pytest.mark.parametrize("seed", range(4))
def test_a_secant_gives_the_friction_and_has_no_less_energy_than_the_law_elsewhere(seed: int) -> None:
    """By which the turns of contact settle from any start."""
    rng = np.random.default_rng(seed)
    base = variances(turned(*rng.uniform(0.1, 1.0, 2), rng.uniform(0.0, 3.0)))
    force = 3.0 * rng.normal(size=3)
    slides, friction, secant = give_way_to(base, force, True)
    assert slides
    np.testing.assert_allclose(secant @ force, friction, rtol=1e-9)
    np.testing.assert_allclose(secant, secant.T, atol=1e-12)
    assert np.linalg.eigvalsh(secant).min() > 0.0
    there = stored(base, force)
    for other in [*rng.normal(size=(20, 3)), *(3.0 * rng.normal(size=(20, 3))), 0.1 * force, 1.01 * force]:
        rise = 0.5 * (other @ secant @ other - force @ secant @ force)
        assert stored(base, other) - there <= rise + 2e-3


@pytest.mark.parametrize("base", [(0.0, 0.0, 0.0), (4e4, 0.0, 0.0), (1e4, 1e4, 1e4)])
@pytest.mark.parametrize("secant", [False, True])
def test_a_point_and_a_line_hold_what_coulomb_says(base: tuple[float, float, float], secant: bool) -> None:
    """Along and across; a point has no torque."""
    for angle in (0.3, 2.0):
        along = np.array([math.cos(angle), math.sin(angle), 0.0])
        slides, friction, slope = give_way_to(np.array(base), 5.0 * along, secant)
        assert slides
        assert math.hypot(friction[0], friction[1]) == pytest.approx(1.0, rel=0.02)
        assert np.isfinite(slope).all()
        if not any(base):
            np.testing.assert_allclose(friction, along, atol=1e-9)
    assert not give_way(
        np.zeros(3), 1.0, np.array(base), 1.0, 0.0, secant, np.empty(3), np.empty((3, 3)), np.empty((36, 3))
    )


def test_a_keel_that_can_hold_nothing_holds_nothing() -> None:
    friction, slope = np.empty(3), np.empty((3, 3))
    pull, base = np.array([3.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])
    assert give_way(pull, 0.0, base, 1.0, 0.0, False, friction, slope, np.empty((36, 3)))
    assert not friction.any()
    assert not slope.any()
