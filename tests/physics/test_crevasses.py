"""Pre-stress, stable crevasses and reserve: tables, limits, and a column that is integrated layer by layer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from physics.agreement import between, quick
from riftberg.physics.crevasses import (
    implied_crevasse_strength,
    prestress,
    reserve,
    reserves,
    rift_factor,
    stable_depth,
    tension_at_depth,
)
from twins import crevasses as twin

TABLE = {
    (150, 850): (106.7, 5.9, 14.6, 23.4, 52.7),
    (170, 850): (121, 5.2, 12.9, 20.7, 46.5),
    (200, 850): (142, 4.4, 11.0, 17.6, 39.5),
    (250, 870): (161, 3.9, 9.7, 15.5, 34.9),
    (300, 880): (183, 3.4, 8.5, 13.6, 30.7),
    (350, 890): (201, 3.1, 7.8, 12.4, 28.0),
    (400, 890): (230, 2.7, 6.8, 10.9, 24.5),
}  # thickness, density: pre-stress, reserve for 50, 79, 100 and 150 kPa at the tips; kPa

STRONG = {(150, 850): (95, 156), (200, 850): (72, 121), (300, 880): (56, 94), (400, 890): (44, 75)}  # for 202, 263 kPa


@pytest.mark.parametrize("ice", TABLE)
def test_the_reserve_is_that_of_the_table(ice: tuple[int, int]) -> None:
    """With g of 9.8 m s-2, where the table has 9.81."""
    sigma = prestress(float(ice[0]), float(ice[1]))
    expected, *weak = TABLE[ice]
    assert sigma / 1e3 == pytest.approx(expected, abs=0.5)
    assert [reserve(1e3 * s, sigma) / 1e3 for s in (50, 79, 100, 150)] == pytest.approx(weak, abs=0.1)
    if ice in STRONG:
        assert [reserve(1e3 * s, sigma) / 1e3 for s in (202, 263)] == pytest.approx(STRONG[ice], abs=1.0)


@pytest.mark.parametrize(
    ("depth", "thinner", "thicker"),
    [(0.8, (35.6, 47.8), (34.7, 46.9)), (0.9, (19.0, 25.1), (18.8, 24.9)), (0.95, (9.8, 12.8), (9.7, 12.8)),
     (0.97, (6.0, 7.8), (5.9, 7.8)), (0.98, (4.0, 5.2), (4.0, 5.2))],
)  # fmt: skip
def test_a_rift_bears_what_the_table_says(depth: float, thinner: tuple[float], thicker: tuple[float]) -> None:
    """Ice of 170 and 200 m, 202 and 263 kPa."""
    for thickness, expected in ((170.0, thinner), (200.0, thicker)):
        sigma = prestress(thickness, 850.0)
        borne = [tension_at_depth(depth, s, sigma) / 1e3 for s in (202e3, 263e3)]
        assert borne == pytest.approx(expected, abs=0.1)
        assert [rift_factor(depth, s, sigma) * reserve(s, sigma) / 1e3 for s in (202e3, 263e3)] == pytest.approx(borne)


@pytest.mark.parametrize("rho", [780.0, 850.0, 910.0])
def test_reserve_and_its_slope_have_no_step_where_crevasses_close(rho: float) -> None:
    """At s = 2 sigma_0 both branches meet in value and slope; there no crevasse is left."""
    sigma = prestress(230.0, rho)
    at, step = 2.0 * sigma, 1e-4 * sigma
    below, above = reserve(at - step, sigma), reserve(at + step, sigma)
    assert below == pytest.approx(reserve(at, sigma), rel=1e-3)
    assert (reserve(at, sigma) - below) / step == pytest.approx(1.0, abs=1e-3)
    assert (above - reserve(at, sigma)) / step == pytest.approx(1.0, abs=1e-3)
    assert stable_depth(at + step, sigma) == 0.0 < stable_depth(at - step, sigma)


@quick
@given(s=between(1e3, 400e3), thickness=between(60, 450), rho=between(750, 917))
def test_reserve_is_what_ice_bears_at_the_depth_of_stable_crevasses(s: float, thickness: float, rho: float) -> None:
    """The closed forms of both branches; no depth bears more."""
    sigma = prestress(thickness, rho)
    closed = s * s / (4.0 * sigma) if s <= 2.0 * sigma else s - sigma
    assert reserve(s, sigma) == pytest.approx(closed, rel=1e-9)
    assert tension_at_depth(stable_depth(s, sigma), s, sigma) == reserve(s, sigma)
    assert max(tension_at_depth(x, s, sigma) for x in np.linspace(0.0, 1.0, 101)) <= closed * (1.0 + 1e-12)


@quick
@given(strength=between(1e2, 400e3), thickness=between(60, 450))
def test_the_strength_at_the_tips_is_the_inverse_of_the_reserve(strength: float, thickness: float) -> None:
    """On both branches: crevassed ice, and ice without crevasses."""
    sigma = prestress(thickness, 850.0)
    assert reserve(implied_crevasse_strength(strength, sigma), sigma) == pytest.approx(strength, rel=1e-9)


def test_the_fitted_strength_of_a68a_means_79_kpa_at_200_m() -> None:
    """And 73 kPa at 170 m: 11 kPa of both are not the same ice."""
    assert implied_crevasse_strength(11e3, prestress(200.0, 850.0)) == pytest.approx(79e3, abs=500.0)
    assert implied_crevasse_strength(11e3, prestress(170.0, 850.0)) == pytest.approx(73e3, abs=500.0)


@pytest.mark.parametrize(("thickness", "rho"), [(130.0, 820.0), (200.0, 850.0), (360.0, 890.0)])
def test_a_column_integrated_over_its_depth_bears_the_same(thickness: float, rho: float) -> None:
    """Layer by layer, within a thousandth of the pre-stress."""
    sigma = prestress(thickness, rho)
    assert sigma == pytest.approx(twin.prestress(thickness, rho), rel=1e-3)
    for s in (40e3, 90e3, 150e3):
        for depth in (0.1, 0.5, 0.8, 0.95):
            borne = twin.column_tension(depth, s, thickness, rho)
            assert tension_at_depth(depth, s, sigma) == pytest.approx(borne, abs=1e-3 * sigma)
        assert reserve(s, sigma) == pytest.approx(twin.reserve(s, thickness, rho), abs=1e-3 * sigma)


def test_a_rift_in_crevasses_that_reach_deeper_changes_nothing() -> None:
    """The factor is 1 to the last digit down to the stable depth, and falls beyond."""
    sigma = prestress(250.0, 870.0)
    deep = stable_depth(90e3, sigma)
    assert rift_factor(0.9 * deep, 90e3, sigma) == rift_factor(deep, 90e3, sigma) == 1.0
    assert 0.99 < rift_factor(deep + 0.01, 90e3, sigma) < 1.0
    assert rift_factor(0.999, 90e3, sigma) < 0.02


def test_reserves_of_many_places_are_those_of_each() -> None:
    """One thickness after the other; as a force per width all bear the same."""
    thickness = np.array([90.0, 200.0, 410.0])
    many = reserves(thickness, 850.0, 79e3)
    assert many.tolist() == [reserve(79e3, prestress(h, 850.0)) for h in thickness.tolist()]
    assert many * thickness == pytest.approx(np.full(3, many[1] * 200.0))
