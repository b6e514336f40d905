"""Bonds by a rule on distance, against a search of all pairs."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from riftberg.bergs.bonding import BondRule, Metric, form_bonds, separations
from riftberg.errors import BergError
from riftberg.state import Elements, new_elements

PLANE = Metric(latlon=False)
EARTH = Metric(latlon=True, radius=6_363_827.0, period=360.0)


def all_pairs(elements: Elements, rule: BondRule, metric: Metric) -> list[tuple[int, int]]:
    reach, found = rule.reaches(elements), []
    for a in range(len(reach)):
        b = np.arange(a + 1, len(reach))
        lon, lat = np.full(len(b), elements.lon[a]), np.full(len(b), elements.lat[a])
        dx, dy = separations(metric, lon, lat, elements.lon[b], elements.lat[b])
        found += [(a, int(k)) for k in b[np.hypot(dx, dy) < reach[a] + reach[b]]]
    return found


def scattered(size: int, metric: Metric, seed: int) -> Elements:
    rng, e = np.random.default_rng(seed), new_elements(size)
    if metric.latlon:
        e.lon[:], e.lat[:] = rng.uniform(-2, 2, size) % 360.0, rng.uniform(-57, -55, size)
        e.length[:] = e.width[:] = rng.uniform(3e3, 9e3, size)
        return e
    e.lon[:] = rng.uniform(0, metric.period if metric.period > 0 else 30.0, size)
    e.lat[:] = rng.uniform(0, 20, size)
    e.length[:], e.width[:] = rng.uniform(0.5, 2, size), 1.0
    return e


@pytest.mark.quick(6)
@pytest.mark.parametrize("size", [2, 3, 50, 300])
@pytest.mark.parametrize(
    "metric", [PLANE, Metric(False, 1.0, 1000.0), Metric(False, 1.0, 3.0), Metric(False, 1.0, 7.0), EARTH], ids=str
)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_same_as_all_pairs(size: int, metric: Metric, packing: str) -> None:
    for rule in (BondRule(packing=packing), BondRule(length=9e3 if metric.latlon else 1.5)):
        e = scattered(size, metric, seed=size)
        bonds = form_bonds(e, rule, metric)
        expected = all_pairs(e, rule, metric)
        assert list(zip(bonds.first.tolist(), bonds.second.tolist(), strict=True)) == expected
        assert e.bond_count.sum() == 2 * len(expected)


def pair(distance: float, size: float = 1.0) -> Elements:
    e = new_elements(2)
    e.lon[1] = distance
    e.length[:] = e.width[:] = size
    return e


def test_inequalities_are_strict() -> None:
    """Centres exactly at the limit are not bonded (quirk Q14 for the factor)."""
    for rule, limit in ((BondRule(), 1.25), (BondRule(length=0.75), 0.75)):
        assert len(form_bonds(pair(limit), rule, PLANE).first) == 0
        assert len(form_bonds(pair(math.nextafter(limit, 0.0)), rule, PLANE).first) == 1


def test_radius_of_hexagons() -> None:
    limit = 1.25 * 2.0 * math.sqrt(1.0 / (2.0 * math.sqrt(3.0)))
    rule = BondRule(packing="hexagonal")
    assert len(form_bonds(pair(limit * (1 - 1e-12)), rule, PLANE).first) == 1
    assert len(form_bonds(pair(limit * (1 + 1e-12)), rule, PLANE).first) == 0


def test_negative_length_means_no_bonds() -> None:
    assert len(form_bonds(pair(0.1), BondRule(length=-1000.0), PLANE).first) == 0


def test_distance_uses_the_mean_latitude() -> None:
    e = pair(0.02, size=1000.0)
    e.lat[:] = -60.0, -60.004
    degree = math.pi / 180.0 * EARTH.radius
    expected = math.hypot(0.02 * degree * math.cos(math.radians(60.002)), 0.004 * degree)
    bonds = form_bonds(e, BondRule(length=5000.0), EARTH)
    assert bonds.bond_length[0] == pytest.approx(expected, rel=1e-12)


def test_bonds_across_the_end_of_a_periodic_domain() -> None:
    e = pair(99.5)
    assert len(form_bonds(e, BondRule(), Metric(False, 1.0, 100.0)).first) == 1
    assert len(form_bonds(e, BondRule(), PLANE).first) == 0


def test_a_position_that_is_no_number_is_refused() -> None:
    e = pair(1.0)
    e.lat[1] = np.nan
    with pytest.raises(BergError, match="element 2"):
        form_bonds(e, BondRule(), PLANE)


@pytest.mark.compiled
def test_a_large_lattice_is_quick() -> None:
    e = new_elements(100_000)
    column, row = np.divmod(np.arange(100_000), 400)
    e.lon[:], e.lat[:] = 3000.0 * column, 3000.0 * row
    e.length[:] = e.width[:] = 3000.0
    form_bonds(pair(1.0), BondRule(), PLANE)
    began = time.perf_counter()
    bonds = form_bonds(e, BondRule(), PLANE)
    assert time.perf_counter() - began < 3.0
    assert len(bonds.first) == 250 * 399 + 249 * 400
    assert e.bond_count.max() == 4
