"""Pressure, friction and bending stiffness of a bed of sediment, against slow sums."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import kei

from riftberg.physics import seabed

TRIANGLE = np.array([[0.0, 0.0, -0.4], [10.0, 0.0, 0.6], [2.0, 8.0, 0.2]])
DART = np.array([[0.0, 0.0, 0.3], [10.0, 0.0, -0.2], [3.0, 3.0, 0.1], [0.0, 10.0, 0.4]])
"""Not convex; its overlap is made linear below."""


def linear(corners: np.ndarray, a: float, b: float, c: float) -> np.ndarray:
    """Give the corners the overlap a + b x + c y."""
    return np.column_stack([corners[:, :2], a + b * corners[:, 0] + c * corners[:, 1]])


def slow(corners: np.ndarray, top: float, parts: int = 200) -> np.ndarray:
    """Sums over small triangles of a fan: the integrals of min(<d>, top), by x, by y, and the elastic area."""
    total = np.zeros(4)
    for n in range(1, len(corners) - 1):
        a, b, c = corners[0], corners[n], corners[n + 1]
        area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / parts**2
        for shift in (1.0 / 3.0, 2.0 / 3.0):  # triangles of both directions
            i, j = np.meshgrid(np.arange(parts) + shift, np.arange(parts) + shift, indexing="ij")
            inside = i + j < parts
            s, t = (i[inside] / parts)[:, None], (j[inside] / parts)[:, None]
            x, y, d = (a + s * (b - a) + t * (c - a)).T
            pressed = np.clip(d, 0.0, top)
            elastic = (d > 0.0) & (d < top)
            total += area * np.array([pressed.sum(), (pressed * x).sum(), (pressed * y).sum(), elastic.sum()])
    return total


@pytest.mark.parametrize("corners", [TRIANGLE, linear(DART, 0.3, -0.05, 0.02), linear(DART, -1.0, 0.05, 0.03)])
@pytest.mark.parametrize("top", [0.05, 0.3, 5.0])
def test_integrals_are_those_of_a_slow_sum(corners: np.ndarray, top: float) -> None:
    sums, room = np.zeros(10), np.zeros((20, 3))
    seabed.pressed(corners, len(corners), top, room, sums)
    expected = slow(corners, top)
    assert sums[:4] == pytest.approx(expected, rel=5e-3, abs=2e-3 * max(abs(expected).max(), 1.0))


def test_tangent_is_the_derivative_of_the_load() -> None:
    room, step = np.zeros((20, 3)), 1e-6
    at = [np.zeros(10) for _ in range(3)]
    for sums, rise in zip(at, (-step, 0.0, step), strict=True):
        seabed.pressed(TRIANGLE - np.array([0.0, 0.0, rise]), 3, 0.3, room, sums)
    low, here, high = at
    assert (low[0] - high[0]) / (2.0 * step) == pytest.approx(here[3], rel=1e-6)  # by heave
    assert (low[1] - high[1]) / (2.0 * step) == pytest.approx(here[4], rel=1e-6)
    assert (low[9] - high[9]) / (2.0 * step) == pytest.approx(here[0], rel=1e-6)  # energy by heave


def test_a_keel_clear_of_the_floor_bears_nothing() -> None:
    sums, room = np.ones(10), np.zeros((20, 3))
    seabed.pressed(TRIANGLE - np.array([0.0, 0.0, 1.0]), 3, 0.3, room, sums)
    assert not sums.any()


@pytest.mark.parametrize("seed", range(8))
def test_moments_are_integrals_over_the_polygon(seed: int) -> None:
    """All sums, of corners that are nowhere zero; corners, midpoints and centroid integrate cubes over a triangle exactly."""
    r = np.random.default_rng(seed)
    turns = np.sort(r.uniform(0.0, 2.0 * np.pi, 5))
    corners = np.column_stack([3.0 + 5.0 * np.cos(turns), -7.0 + 4.0 * np.sin(turns), r.uniform(-1.0, 2.0, 5)])
    level, sign, expected = 0.37, float(r.choice([-1.0, 1.0])), np.zeros(13)
    for n in range(1, 4):
        a, b, c = corners[0], corners[n], corners[n + 1]
        area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
        points = [
            (a, 3),
            (b, 3),
            (c, 3),
            (0.5 * (a + b), 8),
            (0.5 * (b + c), 8),
            (0.5 * (c + a), 8),
            ((a + b + c) / 3.0, 27),
        ]
        for (x, y, d), weight in points:
            e = d - level
            values = [e, e * x, e * y, 1.0, x, y, x * x, x * y, y * y, 0.5 * e * e, e * x * x, e * x * y, e * y * y]
            expected += sign * area * weight / 60.0 * np.array(values)
    for size in (10, 13):
        sums = np.zeros(size)
        seabed.add_moments(corners, 5, level, sign, sums)
        np.testing.assert_allclose(sums, expected[:size], rtol=1e-11, atol=1e-11)


def test_cut_parts_add_up() -> None:
    out, areas = np.zeros((20, 3)), []
    for sign in (1.0, -1.0):
        count = seabed.cut(DART, len(DART), 0, 2.5, sign, out)
        sums = np.zeros(10)
        seabed.add_moments(out, count, 0.0, 1.0, sums)
        areas.append(sums[3])
    sums = np.zeros(10)
    seabed.add_moments(DART, len(DART), 0.0, 1.0, sums)
    assert sum(areas) == pytest.approx(sums[3], rel=1e-12)
    assert min(areas) > 0.0


def test_deflection_is_the_kelvin_function() -> None:
    x = np.linspace(0.013, 9.9, 300)
    found = [seabed.plate_deflection(one) for one in x]
    np.testing.assert_allclose(found, -4.0 / np.pi * kei(x), atol=3e-4)
    assert (seabed.plate_deflection(0.0), seabed.plate_deflection(12.0)) == (1.0, 0.0)


def test_clay_shears_before_friction_is_reached() -> None:
    assert seabed.friction_depth(1e6, 1.2e5, 0.5, 2e4) == pytest.approx(0.04)
    assert seabed.friction_depth(1e7, 1e6, 0.5, 0.0) == pytest.approx(0.1)
