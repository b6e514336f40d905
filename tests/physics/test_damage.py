"""Damage of a bond against its twin, its closed forms, and what must hold for any history of stress."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import assert_same, between, quick
from riftberg.physics.bonds import LARGEST_DAMAGE, damage_rate, grown_damage, stress_ratio
from twins import damage as twin

STRENGTH = 18e3, 100e3
DAY = 86400.0

damaged = between(0.0, 0.999)
threshold = between(0.0, 0.95)
exponent = between(0.2, 8.0)
ratio = between(-2.0, 3.0)


def step(damage, normal, shear, law, dt):
    """One step as the sub-step makes it: ratio to what is left, rate, growth."""
    left = 1.0 - damage
    r = stress_ratio(normal, shear, left * STRENGTH[0], left * STRENGTH[1])
    rate = damage_rate(r, law.damage_threshold, law.damage_time, law.damage_exponent)
    return grown_damage(damage, rate, dt)


def law(r0=0.0, tau=DAY, m=2.0):
    """Parameters of the law."""
    return SimpleNamespace(damage_threshold=r0, damage_time=tau, damage_exponent=m)


def history(r, p, dt, steps):
    """Damage after ``steps`` steps under a constant tension of ``r`` times the strength."""
    damage = 0.0
    for _ in range(steps):
        damage = step(damage, r * STRENGTH[0], 0.0, p, dt)
    return damage


@quick
@given(damage=damaged, n=ratio, s=between(0, 3), r0=threshold, m=exponent, dt=between(1.0, 1e5))
def test_a_step_equals_the_twin(damage, n, s, r0, m, dt):
    p = law(r0, DAY, m)
    want = twin.grow(damage, n * STRENGTH[0], s * STRENGTH[1], *STRENGTH, p, dt)
    # A bracket that is the difference of nearly equal numbers carries their round-off, whatever the power of it.
    near = abs(max(n, s) / (1 - damage) - r0) < 1e-6
    assert_same(step(damage, n * STRENGTH[0], s * STRENGTH[1], p, dt), want, scale=1e12 if near else 1.0)


@quick
@given(damage=damaged, n=ratio, s=between(0, 3), r0=threshold, m=exponent, dt=between(0.0, 1e7))
def test_damage_never_decreases_and_never_reaches_one(damage, n, s, r0, m, dt):
    after = step(damage, n * STRENGTH[0], s * STRENGTH[1], law(r0, DAY, m), dt)
    assert damage <= after <= LARGEST_DAMAGE < 1.0


@quick
@given(r=between(-2.0, 1.0), r0=threshold, m=exponent)
def test_nothing_happens_up_to_the_threshold(r, r0, m):
    rate = damage_rate(r * r0, r0, DAY, m)
    assert rate == 0.0
    assert damage_rate(r0, r0, DAY, m) == 0.0
    assert damage_rate(r0 + 0.01 * (1.0 - r0), r0, DAY, m) > 0.0


def test_the_rate_at_the_strength_is_that_of_the_time_scale():
    """There, and beyond, where the bond breaks in the same sub-step."""
    for r in (1.0, 1.5, np.inf):
        assert damage_rate(r, 0.3, DAY, 2.7) == 1.0 / DAY


@quick
@given(r=between(0.4, 1.0), r0=between(0.0, 0.3), m=exponent, factor=between(0.01, 100))
def test_the_time_scale_scales_time(r, r0, m, factor):
    assert_same(damage_rate(r, r0, factor * DAY, m) * factor, damage_rate(r, r0, DAY, m))


@quick
@given(pair=st.tuples(between(-1.0, 1.5), between(-1.0, 1.5)), r0=threshold, m=exponent, damage=damaged)
def test_more_stress_takes_no_less(pair, r0, m, damage):
    low, high = sorted(pair)
    p = law(r0, DAY, m)
    assert step(damage, low * STRENGTH[0], 0.0, p, 60.0) <= step(damage, high * STRENGTH[0], 0.0, p, 60.0)


@pytest.mark.parametrize("m", [0.5, 1.0, 2.0, 4.3])
def test_exponent_of_the_stress(m):
    assert damage_rate(0.6, 0.0, DAY, m) / damage_rate(0.3, 0.0, DAY, m) == pytest.approx(2.0**m, rel=1e-12)
    # With a threshold it is the stress above it that counts.
    assert damage_rate(0.8, 0.2, DAY, m) / damage_rate(0.5, 0.2, DAY, m) == pytest.approx(2.0**m, rel=1e-12)


def test_the_more_loaded_direction_counts():
    assert stress_ratio(9e3, 20e3, *STRENGTH) == 0.5
    assert stress_ratio(9e3, 80e3, *STRENGTH) == 0.8
    assert stress_ratio(-1e9, 80e3, *STRENGTH) == 0.8


def test_units_of_stress_do_not_matter():
    kilo = [x / 1e3 for x in (9e3, 80e3, *STRENGTH)]
    assert stress_ratio(*kilo) == pytest.approx(stress_ratio(9e3, 80e3, *STRENGTH), rel=1e-15)


def test_compression_and_nonsense_take_nothing():
    assert damage_rate(stress_ratio(-1e12, 0.0, *STRENGTH), 0.0, DAY, 2.0) == 0.0
    assert damage_rate(np.nan, 0.0, DAY, 2.0) == 0.0
    assert damage_rate(stress_ratio(*np.zeros(4)), 0.0, DAY, 2.0) == 0.0


@pytest.mark.parametrize("m", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("r", [0.3, 0.6])
def test_damage_under_constant_stress_tends_to_the_closed_form(r, m):
    """``D = 1 - (1 - (m + 1) r^m t / tau)^(1 / (m + 1))`` without threshold, at first order in the step."""
    end = 0.8 * DAY * (1.0 - r ** (m + 1)) / ((m + 1) * r**m)
    exact = 1.0 - (1.0 - (m + 1) * r**m * end / DAY) ** (1.0 / (m + 1))
    errors = [abs(history(r, law(m=m), end / n, n) - exact) for n in (200, 400, 800, 1600)]
    assert errors[-1] < 1e-3
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, rel=0.05)


def life(r, p, dt):
    """Time until what is left of the strength is no more than the stress."""
    damage, time = 0.0, 0.0
    while r <= 1.0 - damage:
        damage = step(damage, r * STRENGTH[0], 0.0, p, dt)
        time += dt
    return time


@pytest.mark.parametrize("m", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("r", [0.3, 0.6, 0.9])
def test_life_under_constant_stress_tends_to_the_closed_form(r, m):
    """``t_f = tau (1 - r^(m + 1)) / ((m + 1) r^m)`` without threshold: failure is at D = 1 - r, not at D = 1."""
    exact = DAY * (1.0 - r ** (m + 1)) / ((m + 1) * r**m)
    for n, within in ((100, 0.03), (1000, 0.003), (10000, 0.0003)):
        assert life(r, law(m=m), exact / n) == pytest.approx(exact, rel=within)


@pytest.mark.parametrize(("r", "r0"), [(0.6, 0.3), (0.35, 0.3), (0.9, 0.5)])
def test_life_with_a_threshold_tends_to_the_closed_form(r, r0):
    """``t_f = tau (1 - r0) (r / r0^2 ln(r (1 - r0) / (r - r0)) - (1 - r) / r0)`` for m = 1 and r > r0."""
    exact = DAY * (1 - r0) * (r / r0**2 * np.log(r * (1 - r0) / (r - r0)) - (1 - r) / r0)
    for n, within in ((100, 0.05), (1000, 0.005), (10000, 0.0005)):
        assert life(r, law(r0, DAY, 1.0), exact / n) == pytest.approx(exact, rel=within)
