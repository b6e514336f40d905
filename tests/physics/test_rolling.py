"""Rolling against its twin; what never changes."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.physics.floating import LEGACY, UPDATED, WEEKS_MELLOR, roll
from twins import rolling as twin


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", [UPDATED, WEEKS_MELLOR, LEGACY])
@pytest.mark.parametrize("tip", [0.0, 0.7, 1.3])
def test_rolling_equals_twin(scheme, tip):
    rolled = 0
    for seed in range(400):
        shape = tuple(10 ** np.random.default_rng(seed).uniform(1, 3, 3))
        got, expected = roll(*shape, scheme, tip, 850.0, True), twin.roll(*shape, scheme, tip, 850.0)
        assert got == pytest.approx(expected, rel=1e-14)
        rolled += got[0] != shape[0]
    assert 20 < rolled < 380


@pytest.mark.parametrize("scheme", [UPDATED, WEEKS_MELLOR, LEGACY])
def test_rolling_keeps_the_volume_and_the_three_sides(scheme):
    for seed in range(100):
        shape = 10 ** np.random.default_rng(seed).uniform(1, 3, 3)
        assert sorted(roll(*shape, scheme, 0.0, 850.0, False)) == sorted(shape)


def test_wide_bergs_stay_and_narrow_ones_roll():
    """By density: below 0.92 of the thickness for 850 kg m-3."""
    assert roll(200.0, 300.0, 400.0, UPDATED, 0.0, 850.0, False) == (200.0, 300.0, 400.0)
    assert roll(200.0, 150.0, 400.0, UPDATED, 0.0, 850.0, False) == (150.0, 200.0, 400.0)
    assert np.sqrt(6 * 850 / 1025 * 175 / 1025) == pytest.approx(0.9217, abs=1e-4)


def test_nothing_rolls_that_has_no_thickness_or_no_root():
    assert roll(0.0, 1.0, 2.0, UPDATED, 0.0, 850.0, False) == (0.0, 1.0, 2.0)
    assert roll(50.0, 1.0, 200.0, WEEKS_MELLOR, 0.0, 850.0, False) == (50.0, 1.0, 200.0)


@pytest.mark.parametrize("scheme", [UPDATED, WEEKS_MELLOR])
@pytest.mark.parametrize("density", [700.0, 800.0, 850.0])
def test_what_has_rolled_lies_still_however_light(scheme, density):
    """Below 808 kg m-3 the reference rolls 100 x 100.7 m at every step."""
    for seed in range(200):
        thickness = 10 ** np.random.default_rng(seed).uniform(1, 3.5)
        shape = (thickness, np.random.default_rng(seed + 1).uniform(0.5, 1.3) * thickness, 5e3)
        once = roll(*shape, scheme, 0.0, density, False)
        assert roll(*once, scheme, 0.0, density, False) == once
        if shape[1] > thickness:
            assert once == shape
    assert roll(100.0, 100.7, 300.0, UPDATED, 0.0, 800.0, True) == (100.7, 100.0, 300.0)
    assert roll(100.7, 100.0, 300.0, UPDATED, 0.0, 800.0, True) == (100.0, 100.7, 300.0)
    assert roll(100.0, 100.7, 300.0, UPDATED, 0.0, 800.0, False) == (100.0, 100.7, 300.0)
