"""Bending at fronts and feet against the figures of strength and bending (5) and against a beam by finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.physics.edge_bending import (
    FOOT_AT_CORNER,
    FRONT_AT_CORNER,
    corner_factor,
    flexural_length,
    foot_moment,
    front_moment,
    surface_stress,
)


@pytest.mark.parametrize(
    ("thickness", "rho_ice", "kilopascal"), [(150, 850, 70), (200, 850, 94), (250, 870, 112), (300, 880, 131), (350, 890, 148)]
)  # fmt: skip
def test_a_front_bends_as_the_pressure_on_it_says(thickness, rho_ice, kilopascal):
    """By the closed form, and by the integral of ice less water pressure over its height about its middle."""
    moment = front_moment(thickness, rho_ice)
    assert surface_stress(moment, thickness) / 1e3 == pytest.approx(kilopascal, abs=0.5)
    z = (np.arange(40000) + 0.5) * thickness / 40000
    outward = rho_ice * 9.81 * (thickness - z) - 1025.0 * 9.81 * np.maximum(rho_ice / 1025.0 * thickness - z, 0.0)
    arm = z - 0.5 * thickness
    assert (outward * arm).sum() * thickness / 40000 == pytest.approx(moment, rel=2e-3)


def test_lambda_and_a_foot_of_the_specification():
    length = flexural_length(9e9, 200.0)
    assert length == pytest.approx(1273.0, abs=1.0)
    moment, inland = foot_moment(14.0, 200.0, 850.0, length)
    assert surface_stress(moment, 200.0) == pytest.approx(247e3, rel=0.01)
    assert inland == pytest.approx(1000.0, abs=10.0)


@pytest.mark.parametrize(
    ("youngs", "foot", "inland"), [(9e9, 14.1, 993), (1e9, 23.9, 565), (1e8, 40, 305), (3.8e7, 48, 232), (1e7, 61, 156)]
)
def test_the_foot_that_breaks_an_edge(youngs, foot, inland):
    """250 kPa, 200 m: within 1.5 % of its length, where the specification says."""
    moment, there = foot_moment(foot, 200.0, 850.0, flexural_length(youngs, 200.0))
    assert surface_stress(moment, 200.0) == pytest.approx(250e3, rel=0.015)
    assert there == pytest.approx(inland, rel=0.01)


@pytest.mark.parametrize(
    ("width", "factor"), [(1, 0.77), (1.5, 1.11), (2, 1.35), (2.5, 1.42), (3, 1.30), (4, 1.02), (5, 0.98), (8, 1.0), (400, 1.0)]
)  # fmt: skip
def test_strips(width, factor):
    length = flexural_length(9e9, 200.0)
    (strip, inland), (half_plane, _) = (foot_moment(1e-3, 200.0, 850.0, length, w * length) for w in (width, np.inf))
    assert strip / half_plane == pytest.approx(factor, abs=0.008)
    if width <= 3:
        assert inland == pytest.approx(0.5 * width * length)


def test_a_strip_is_a_beam_on_water_by_finite_differences():
    """With a foot of 30 m and its couple, 2.7 lambda wide."""
    length, foot, h = flexural_length(9e9, 150.0), 30.0, 150.0
    width, n = 2.7 * length, 2001
    x, step = np.linspace(0.0, width, n, retstep=True)
    lift = (1025.0 - 850.0) * 9.81 * 850.0 / 1025.0 * h * foot
    rigidity, k = 9e9 * h**3 / (12.0 * 0.91), 1025.0 * 9.81
    # The work of both feet, and of a couple that turns the edges, on w; stiffness of curvature and of the water.
    curve = (np.diag(np.ones(n - 1), 1) - 2.0 * np.eye(n) + np.diag(np.ones(n - 1), -1))[1:-1] / step**2
    stiffness = rigidity * step * curve.T @ curve + np.diag(k * step * np.r_[0.5, np.ones(n - 2), 0.5])
    load = np.zeros(n)
    load[[0, -1]] += lift
    for edge, beside in ((0, 1), (-1, -2)):
        load[edge] += 0.5 * lift * foot / step
        load[beside] -= 0.5 * lift * foot / step
    moment = rigidity * curve @ np.linalg.solve(stiffness, load)
    largest, inland = foot_moment(foot, h, 850.0, length, width)
    assert abs(moment).max() == pytest.approx(largest, rel=0.01)
    assert abs(x[1 + abs(moment).argmax()] - 0.5 * width) == pytest.approx(0.5 * width - inland, abs=0.02 * width)


def test_corners():
    assert [corner_factor(FOOT_AT_CORNER, a) for a in (30, 90, 180, 270)] == [2.2, 1.15, 1.0, 1.06]
    assert [corner_factor(FRONT_AT_CORNER, a) for a in (60, 90, 135, 180)] == pytest.approx([1.10, 1.05, 1.025, 1.0])
