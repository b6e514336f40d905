"""Grounding drag against its twin; the ramp at both ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from physics.agreement import SEEDS, assert_same, between, quick
from riftberg.physics import seabed as grounding
from twins import grounding as twin

depth = between(0, 1000)


@quick
@given(water=depth, draft=between(1, 500), ramp=between(0, 200))
def test_grounded_fraction_equals_twin(water, draft, ramp):
    """Spec 4.1; a ratio of differences, so round-off is relative to the depths."""
    got = grounding.grounded_fraction(water, draft, ramp)
    want = twin.fraction(water, draft, ramp)
    if ramp > 0:
        assert abs(got - want) <= 4e-16 * (1 + (water + draft) / ramp)
    else:
        assert got == want
    assert 0 <= got <= 1


@pytest.mark.parametrize(
    ("clearance", "expected"), [(-50.0, 1.0), (0.0, 1.0), (25.0, 0.75), (100.0, 0.0), (500.0, 0.0)]
)
def test_ramp_at_both_ends_and_between(clearance, expected):
    """From the keel on the floor to h_g above it."""
    assert grounding.grounded_fraction(165.0 + clearance, 165.0, 100.0) == pytest.approx(expected, abs=1e-15)


def test_step_without_ramp_is_strict():
    """A keel that just touches is not aground (equations 4.1: D > od)."""
    assert grounding.grounded_fraction(165.0, 165.0, 0.0) == 0.0
    assert grounding.grounded_fraction(np.nextafter(165.0, 0.0), 165.0, 0.0) == 1.0
    assert grounding.grounded_fraction(np.nextafter(165.0, 200.0), 165.0, 0.0) == 0.0


def test_rates_equal_their_twins_on_random_elements():
    """Spec 4.1, 6.4."""
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        c, area, mass, chi = r.uniform(0, 1e5), r.uniform(1e4, 1e8), r.uniform(1e8, 1e13), r.uniform()
        assert_same(grounding.grounding_rate(c, area, mass, chi), twin.rate(c, area, mass, chi))
        assert_same(grounding.grounding_spin_rate(c, area, mass, chi), twin.spin_rate(c, area, mass, chi))


def test_quadratic_coefficient_equals_its_twin_and_scales():
    """Linear in coefficient, base area and draft in excess of the depth, inverse in mass; none while the keel is clear."""
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        k, area, mass = r.uniform(0, 1e5), r.uniform(1e4, 1e8), r.uniform(1e8, 1e13)
        water, keel = r.uniform(0, 300, 2)
        got = grounding.quadratic_grounding(k, area, mass, keel - water)
        assert_same(got, twin.quadratic(k, area, mass, water, keel))
        assert got >= 0.0
    one = grounding.quadratic_grounding(2e3, 9e6, 1.5e12, 10.0)
    assert one == pytest.approx(2e3 * 9e6 * 10.0 / 1.5e12, rel=1e-15)
    assert grounding.quadratic_grounding(4e3, 18e6, 3e12, 5.0) == pytest.approx(one, rel=1e-14)
    assert grounding.quadratic_grounding(2e3, 9e6, 1.5e12, 0.0) == 0.0
    assert grounding.quadratic_grounding(2e3, 9e6, 1.5e12, -1.0) == 0.0


def test_afloat_means_no_drag_and_rates_scale():
    """Linear in coefficient, area and fraction, inverse in mass; spin with the area of the disc."""
    assert grounding.grounding_rate(1e4, 9e6, 1.5e12, 0.0) == 0.0
    assert grounding.grounding_spin_rate(1e4, 1500.0, 1.5e12, 0.0) == 0.0
    one = grounding.grounding_rate(1e4, 9e6, 1.5e12, 1.0)
    assert one == pytest.approx(1e4 * 9e6 / 1.5e12, rel=1e-15)
    assert grounding.grounding_rate(2e4, 18e6, 3e12, 0.5) == pytest.approx(one, rel=1e-14)
    spin = grounding.grounding_spin_rate(1e4, 1500.0, 1.5e12, 1.0)
    assert grounding.grounding_spin_rate(1e4, 3000.0, 1.5e12, 1.0) == pytest.approx(4 * spin, rel=1e-14)
