"""From a caller's fields to the model's: staggering, stress, land and gaps (equations 3.1)."""

from __future__ import annotations

import numpy as np
import pytest

from ocean.grids import bent, random_fields, square_lakes
from ocean.seas import meet, sea
from riftberg import Grid, GriddedForcing
from riftberg.errors import ForcingError
from riftberg.ocean.grid import at_corners, celsius
from riftberg.state import new_elements


def corner_by_hand(grid, u, v, i, j, staggering):
    """Spec 3.1 rules 1 and 2 at one corner, array indices."""
    m = min(grid.arrays.mask[b, a] for a in (i, i + 1) for b in (j, j + 1))
    if staggering == "C":
        return m * 0.5 * (u[j, i] + u[j + 1, i]), m * 0.5 * (v[j, i] + v[j, i + 1])
    return tuple(m * 0.25 * (q[j, i] + q[j + 1, i + 1] + q[j, i + 1] + q[j + 1, i]) for q in (u, v))


@pytest.mark.parametrize("staggering", ["A", "C"])
@pytest.mark.parametrize("make", [square_lakes, bent])
def test_staggered_values_come_to_the_corners(staggering, make):
    """Random values among random land: corner means with the smallest of the four masks, as written in the spec."""
    rng = np.random.default_rng(41)
    grid = make(rng)
    u, v = rng.normal(size=grid.arrays.mask.shape), rng.normal(size=grid.arrays.mask.shape)
    ub, vb = at_corners(u, v, grid, staggering)
    for j in range(3, 3 + grid.arrays.nj):
        for i in range(3, 3 + grid.arrays.ni):
            np.testing.assert_allclose((ub[j, i], vb[j, i]), corner_by_hand(grid, u, v, i, j, staggering), rtol=1e-12)


def test_linear_fields_survive_every_staggering():
    """A field a + b x + c y sampled on east faces, on centres or on corners gives the same corner values at sea."""
    grid = Grid.cartesian(8, 8, 100.0, mask=np.ones((16, 16)))
    a = grid.arrays

    def f(x, y):
        return 30.0 + 1e-3 * x - 2e-3 * y

    corner = f(a.lon, a.lat)
    inner = np.s_[2:-2, 2:-2]
    places = {"A": ((-50, -50), (-50, -50)), "B": ((0, 0), (0, 0)), "C": ((0, -50), (-50, 0))}
    for staggering, ((ux, uy), (vx, vy)) in places.items():
        u, v = at_corners(f(a.lon + ux, a.lat + uy), f(a.lon + vx, a.lat + vy), grid, staggering)
        np.testing.assert_allclose(u[inner], corner[inner], rtol=1e-12)
        np.testing.assert_allclose(v[inner], corner[inner], rtol=1e-12)


def test_corners_that_touch_land_are_still():
    """One land cell stills its four corners on A- and C-grids, none on a B-grid."""
    mask = np.ones((8, 8))
    mask[3, 3] = 0.0
    grid = Grid.cartesian(8, 8, 100.0, mask=mask)
    ones = np.ones(grid.arrays.mask.shape)
    inside = np.s_[4:11, 4:11]
    for staggering, still in (("A", 4), ("C", 4), ("B", 0)):
        u, v = at_corners(ones, ones, grid, staggering)
        assert np.sum(u[inside] == 0.0) == np.sum(v[inside] == 0.0) == still


def test_stress_becomes_wind_and_back():
    """The stress 0.0015 |U| U gives the wind U again; no stress, no wind, no warning (quirk Q24)."""
    rng = np.random.default_rng(42)
    u, v = rng.normal(size=50), rng.normal(size=50)
    u[0] = v[0] = 0.0
    speed = np.hypot(u, v)
    lon, lat = np.arange(10.0), np.arange(-60.0, -55.0)
    tau = {name: (0.0015 * speed * q).reshape(5, 10) for name, q in (("taux", u), ("tauy", v))}
    with np.errstate(all="raise"):
        e = meet(sea(lon, lat, **tau), *(q.ravel() for q in np.meshgrid(lon, lat)))
    np.testing.assert_allclose(e.ua, u, rtol=1e-12)
    np.testing.assert_allclose(e.va, v, rtol=1e-12)
    assert e.ua[0] == e.va[0] == 0.0


def test_kelvin_is_recognised_over_water_only():
    """272 in water means kelvin, 272 on land alone does not."""
    mask = np.array([[1.0, 0.0]])
    np.testing.assert_allclose(celsius(np.array([[272.15, 0.0]]), mask), [[-1.0, -273.15]])
    np.testing.assert_allclose(celsius(np.array([[-1.0, 272.0]]), mask), [[-1.0, 272.0]])


def test_land_is_still_and_cold_and_gaps_are_zero():
    """Vectors at the corner of a land cell, temperature, salt and ice are 0; sea level and depth stay (rule 5)."""
    rng = np.random.default_rng(43)
    grid = square_lakes(rng)
    land = grid.arrays.mask < 0.5
    fields = random_fields(grid, rng)
    fields.uo[6, 6] = fields.depth[7, 7] = np.nan
    clean = GriddedForcing(grid, fields).fields_at(0.0)
    for name in fields._fields:
        q, raw = getattr(clean, name), getattr(fields, name)
        assert not np.isnan(q).any()
        if name in ("ssh", "depth"):
            same = ~np.isnan(raw)
        else:
            assert np.all(q[land] == 0.0)
            same = ~land & ~np.isnan(raw)
        np.testing.assert_array_equal(q[same], raw[same])
    assert clean.depth[7, 7] == 0.0


def test_a_clean_field_is_not_copied():
    """Fields that are already usable are taken as they are; single precision, gaps and read-only arrays are copied."""
    grid = Grid.cartesian(3, 3, 100.0)

    def usable(values):
        return GriddedForcing(grid, grid.fields()._replace(depth=values)).fields_at(0.0).depth

    good = np.ones(grid.arrays.mask.shape)
    assert usable(good) is good
    frozen = good.copy()
    frozen.flags.writeable = False
    for bad in (good.astype(np.float32), np.asfortranarray(np.arange(float(good.size)).reshape(good.shape)), frozen):
        copy = usable(bad)
        assert copy is not bad
        assert copy.flags.writeable
        assert copy.flags.c_contiguous
        np.testing.assert_array_equal(copy, bad)
    hole = good.copy()
    hole[5, 5] = np.nan
    assert usable(hole)[5, 5] == 0.0
    assert np.isnan(hole[5, 5])


def test_gaps_count_over_water_only():
    """NaN on land or in the halo is no gap; the first over water is found with its column and row."""
    mask = np.ones((4, 4))
    mask[1, 1] = 0.0
    grid = Grid.cartesian(4, 4, 100.0, mask=mask)
    depth, halo = np.ones(grid.arrays.mask.shape), grid.arrays.halo
    depth[halo + 1, halo + 1] = depth[0, 3] = np.nan
    e = new_elements(1)
    e.lon[:], e.lat[:] = 350.0, 350.0
    grid.locate(e)
    GriddedForcing(grid, grid.fields()._replace(depth=depth)).check(e, 0.0, 1.0)
    depth[halo + 3, halo + 2] = np.nan
    with pytest.raises(ForcingError, match=r"depth is NaN over water in cell \(3, 4\)"):
        GriddedForcing(grid, grid.fields()._replace(depth=depth)).check(e, 0.0, 1.0)
