"""Wave radiation force against its twin; direction, exponents and limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from physics.agreement import MIRROR, SEEDS, angle, assert_same, between, quick, turn
from riftberg.physics import drag as waves
from twins import waves as twin

wind = between(-25, 25)
current = between(-1, 1)
BERG = (1.5e12, 34.0, 3000.0, 3000.0)
"""Mass, freeboard, length, width of an element of A68a."""


def test_wave_force_equals_twin_on_random_elements():
    """Lengths from far below to far above the wave length, so that the whole ramp of Cr is met."""
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        ua, va, uo, vo = *r.normal(0, 10, 2), *r.normal(0, 0.5, 2)
        mass, freeboard, length, width = r.uniform(1e5, 1e12), r.uniform(0.1, 60), *10 ** r.uniform(0, 3.5, 2)
        got = waves.wave_acceleration(ua, va, uo, vo, mass, freeboard, length, width)
        assert_same(got, twin.acceleration((ua, va), (uo, vo), mass, freeboard, length, width))


@quick
@given(ua=wind, va=wind, uo=current, vo=current, length=between(1, 200))
def test_wave_force_equals_twin(ua, va, uo, vo, length):
    """Spec 4.1, drawn by hypothesis."""
    got = waves.wave_acceleration(ua, va, uo, vo, 1e9, 20.0, length, 100.0)
    assert_same(got, twin.acceleration((ua, va), (uo, vo), 1e9, 20.0, length, 100.0))


def test_no_wind_no_wave_force():
    """Even over a current, which alone would give q > 0."""
    assert waves.wave_acceleration(0.0, 0.0, 1.0, -1.0, *BERG) == (0.0, 0.0)


def test_wind_that_goes_with_the_current_raises_no_waves():
    """Limit q = 0 with wind: finite, and zero."""
    assert waves.wave_acceleration(0.5, 0.2, 0.5, 0.2, *BERG) == (0.0, 0.0)


@pytest.mark.parametrize(("ua", "va"), [(10.0, 0.0), (-10.0, 0.0), (0.0, 10.0), (0.0, -10.0)])
def test_wave_force_points_along_the_wind(ua, va):
    """Sign on each axis."""
    got = np.array(waves.wave_acceleration(ua, va, 0.0, 0.0, *BERG))
    assert np.sign(got).tolist() == np.sign([ua, va]).tolist()


@quick
@given(ua=wind, va=wind, uo=current, vo=current, a=angle)
def test_wave_force_turns_and_mirrors_with_wind_and_current(ua, va, uo, vo, a):
    """Invariance."""
    got = np.array(waves.wave_acceleration(ua, va, uo, vo, *BERG))
    for matrix in (turn(a), MIRROR):
        turned = waves.wave_acceleration(*(matrix @ [ua, va]), *(matrix @ [uo, vo]), *BERG)
        np.testing.assert_allclose(turned, matrix @ got, rtol=0, atol=1e-11 * np.linalg.norm(got))


def test_wave_force_grows_with_the_square_of_the_amplitude_until_it_overtops_the_freeboard():
    """Amplitude goes with q: the force with q^2 below the freeboard, with q above."""

    def force(speed, freeboard):
        return waves.wave_acceleration(speed, 0.0, 0.0, 0.0, 1.5e12, freeboard, 3000.0, 3000.0)[0]

    assert force(2.0, 100.0) == pytest.approx(16 * force(1.0, 100.0), rel=1e-13)
    assert force(2.0, 1e-3) == pytest.approx(4 * force(1.0, 1e-3), rel=1e-13)
    assert force(2.0, 2e-3) == pytest.approx(2 * force(2.0, 1e-3), rel=1e-13)


def test_wave_coefficient_ramp_at_both_ends():
    """Cr is 0 up to an eighth of the wave length, 0.06 from a quarter on, half of it half way."""
    wave_length = 0.32 * 100.0

    def per_width(length):
        return waves.wave_acceleration(10.0, 0.0, 0.0, 0.0, 1.0, 1e9, length, length)[0] / length

    full = 0.5 * 1025.0 * 0.06 * 9.8 * (0.5 * 0.02025 * 100.0) ** 2
    assert per_width(wave_length / 8) == 0.0
    assert per_width(wave_length / 16) == 0.0
    assert per_width(wave_length / 4) == pytest.approx(full, rel=1e-12)
    assert per_width(wave_length * 4) == pytest.approx(full, rel=1e-12)
    assert per_width(wave_length * 3 / 16) == pytest.approx(full / 2, rel=1e-12)


def test_wave_force_is_inverse_in_the_mass():
    """A force per mass."""
    one = waves.wave_acceleration(9.0, 3.0, 0.0, 0.0, 1e12, 34.0, 3000.0, 2000.0)
    two = waves.wave_acceleration(9.0, 3.0, 0.0, 0.0, 2e12, 34.0, 3000.0, 2000.0)
    assert_same(2 * np.array(two), one)
