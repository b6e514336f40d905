"""Laws of calving against their twins, and what they must obey: sums, limits, units."""

from __future__ import annotations

import numpy as np
import pytest

from physics.agreement import SEEDS, assert_same
from riftberg.config.parameter_groups import NORTHERN_CLASSES, SOUTHERN_CLASSES
from riftberg.physics import calving
from twins import calving as twin


def test_weights_of_the_running_mean_equal_twin_and_their_limits() -> None:
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        tau, dt = 10 ** r.uniform(0, 9), 10 ** r.uniform(1, 5)
        got = calving.mean_weights(tau, dt)
        assert_same(got, twin.weights(tau, dt))
        assert sum(got) == 1.0
        assert min(got) > 0.0
    assert calving.mean_weights(0.0, 60.0) == (1.0, 0.0)


def test_class_width_gives_the_mass_back() -> None:
    for table in (SOUTHERN_CLASSES, NORTHERN_CLASSES):
        for mass, thickness in zip(table.mass, table.thickness, strict=True):
            width = calving.class_width(mass, thickness, 850.0, 1.5)
            assert 1.5 * width * width * thickness * 850.0 == pytest.approx(mass, rel=1e-14)


def test_number_fractions_become_mass_fractions() -> None:
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        mass, numbers = 10 ** r.uniform(8, 12, 10), r.uniform(0.01, 1, 10)
        if seed % 2:
            numbers[9] = 0.0
        got = np.zeros(10)
        calving.fractions_by_mass(numbers, mass, got)
        assert_same(got, twin.mass_fractions(numbers, mass), scale=1.0)
        assert got.sum() == pytest.approx(1.0, abs=1e-15)


def test_stores_equal_twin_and_lose_nothing() -> None:
    for seed in range(20):
        r = np.random.default_rng(seed)
        shape = (4, 5)
        ice, heat = r.uniform(0, 1e9, (10, *shape)), r.normal(0, 1e12, shape)
        flux, heat_flux = r.uniform(0, 1e-2, shape), -r.uniform(0, 1e3, shape)
        area, south, dt = r.uniform(1e6, 1e8, shape), r.uniform(size=shape) > 0.5, 3600.0
        fractions = np.array(SOUTHERN_CLASSES.fraction), np.array(NORTHERN_CLASSES.fraction)
        want = twin.fill(ice, heat, flux, heat_flux, area, south, fractions, dt)
        before = ice.sum(), heat.sum()
        left, heat_left = np.zeros(shape), np.zeros(shape)
        calving.fill_stores(ice, heat, flux, heat_flux, area, south, fractions, dt, left, heat_left)
        for got, expected in zip((ice, heat, left, heat_left), want, strict=True):
            assert_same(got, expected)
        arrived = (flux * area).sum() * dt
        assert ice.sum() - before[0] + left.sum() * dt == pytest.approx(arrived, rel=1e-9)
        assert heat.sum() - before[1] + heat_left.sum() * dt == pytest.approx((heat_flux * area).sum() * dt, rel=1e-9)
