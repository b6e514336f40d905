"""Forcing from gridded records in time: interpolation, refusals, maps, description."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from ocean.grids import degrees, random_fields, scattered, square_lakes
from riftberg import FieldRules, Grid, GriddedForcing
from riftberg.errors import ForcingError
from riftberg.state import Environment

ENVIRONMENT = tuple(
    name for name in Environment._fields if not name.startswith("keel_")
)  # from forcing with levels alone


def environment(e):
    """All sampled variables as one array."""
    return np.array([getattr(e, name) for name in ENVIRONMENT])


def by_hand(grid, fields, e, **rules):
    """Environment of one state."""
    GriddedForcing(grid, fields, rules=FieldRules(**rules)).sample(e, 0.0)
    return environment(e)


def mean(a, b, w):
    """Weighted mean of two states."""
    return type(a)(*((1.0 - w) * p + w * q for p, q in zip(a, b, strict=True)))


@pytest.fixture
def scene():
    """Grid with land, three random states at 0, 3600 and 7200 s, elements in water."""
    rng = np.random.default_rng(51)
    grid = degrees(rng)
    return grid, [random_fields(grid, rng) for _ in range(3)], scattered(grid, 40, rng)


def test_constant_state_holds_for_ever(scene):
    """One record: the same environment at any time, equal to the plain interpolation."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states[0])
    expected = by_hand(grid, states[0], e).copy()
    for time in (0.0, 1e9):
        forcing.check(e, 0.0, time)
        forcing.sample(e, time)
        np.testing.assert_array_equal(environment(e), expected)


@pytest.mark.parametrize("time", [0.0, 900.0, 1800.0, 3600.0, 5000.0, 7200.0])
def test_linear_interpolation_in_time(scene, time):
    """Between records the environment is that of the weighted mean of the states, at a record that of the record."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0])
    k = min(int(time // 3600), 1)
    expected = by_hand(grid, mean(states[k], states[k + 1], time / 3600 - k), e).copy()
    forcing.sample(e, time)
    np.testing.assert_allclose(environment(e), expected, rtol=1e-11, atol=1e-13)


def test_records_may_be_held(scene):
    """interpolation='previous': each record holds until the next begins."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0], FieldRules(interpolation="previous"))
    for time, k in ((0.0, 0), (3599.0, 0), (3600.0, 1), (7200.0, 2)):
        expected = by_hand(grid, states[k], e).copy()
        forcing.sample(e, time)
        np.testing.assert_array_equal(environment(e), expected)


def test_single_fields_may_be_held(scene):
    """The A68a run averages wind and current between hours but not sea level (equations 10.5)."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0], FieldRules(stepwise=("ssh",)))
    between = mean(states[0], states[1], 0.5)._replace(ssh=states[0].ssh)
    expected = by_hand(grid, between, e).copy()
    forcing.sample(e, 1800.0)
    np.testing.assert_allclose(environment(e), expected, rtol=1e-11, atol=1e-13)
    assert "held until the next record: ssh" in forcing.describe()


def test_records_from_a_function_equal_records_from_a_list(scene):
    """States loaded on demand give the same environment, in any order of times, and are not all kept."""
    grid, states, e = scene
    loaded = []

    def load(k):
        loaded.append(k)
        return states[k]

    times = [0.0, 3600.0, 7200.0]
    lazy, eager = GriddedForcing(grid, load, times), GriddedForcing(grid, states, times)
    for time in (0.0, 1800.0, 3000.0, 5400.0, 600.0, 7200.0):
        eager.sample(e, time)
        expected = environment(e)
        lazy.sample(e, time)
        np.testing.assert_array_equal(environment(e), expected)
    assert loaded[:3] == [0, 1, 2]
    assert 3 < len(loaded) < 8


def test_moving_elements_always_see_fresh_fields(scene):
    """Only the box around the elements is blended: elements that jump elsewhere must not meet old values."""
    grid, states, _ = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0])
    rng = np.random.default_rng(52)
    for time in (100.0, 200.0, 3700.0, 3800.0):
        e = scattered(grid, 3, rng)
        k = int(time // 3600)
        expected = by_hand(grid, mean(states[k], states[k + 1], time / 3600 - k), e).copy()
        forcing.sample(e, time)
        np.testing.assert_allclose(environment(e), expected, rtol=1e-11, atol=1e-13)


def test_shared_arrays_stay_shared(scene):
    """Fields that are one object in all records are neither copied nor blended."""
    grid, states, _ = scene
    clean = GriddedForcing(grid, states[0]).fields_at(0.0)
    records = [clean, clean._replace(uo=2.0 * clean.uo)]
    middle = GriddedForcing(grid, records, [0.0, 10.0]).fields_at(5.0)
    for name in clean._fields:
        assert (getattr(middle, name) is getattr(clean, name)) == (name != "uo")
    np.testing.assert_allclose(middle.uo, 1.5 * clean.uo)


def test_depth_rules_by_name(scene):
    """cell, biquadratic and zone select the three rules of the spec."""
    grid, states, e = scene
    GriddedForcing(grid, states[0], rules=FieldRules(depth_rule="cell")).sample(e, 0.0)
    np.testing.assert_array_equal(e.depth, (states[0].depth + states[0].ssh)[e.cell_j, e.cell_i])
    GriddedForcing(grid, states[0], rules=FieldRules(depth_rule="zone", zone=(-37.3, -55.4))).sample(e, 0.0)
    dry = (e.lon > 360.0 - 37.3) & (e.lat > -55.4)
    np.testing.assert_array_equal(e.depth, np.where(dry, 0.0, 1000.0))
    assert 0 < dry.sum() < dry.size


def test_times_outside_the_records_are_refused_with_dates(scene):
    """Sampling and checking name what is needed and what is there, in seconds and dates."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0], start=datetime(2020, 12, 9))
    forcing.check(e, 0.0, 7200.0)
    text = r"needs 0 s \(2020-12-09 00:00:00\) to 7300 s .* cover 0 s .* to 7200 s \(2020-12-09 02:00:00\)"
    with pytest.raises(ForcingError, match=text):
        forcing.check(e, 0.0, 7300.0)
    with pytest.raises(ForcingError, match=r"needs 7201 s"):
        forcing.sample(e, 7201.0)
    forcing.sample(e, 7200.0 + 1e-7)


def test_gaps_in_the_sea_level_make_no_slope_where_that_is_asked_for(scene):
    """Spec 3.2: a slope that needs a missing value is 0; elsewhere nothing changes, and currents are still checked."""
    grid, states, e = scene
    g, zone = grid.arrays, FieldRules(depth_rule="zone", zone=(0.0, 89.0))
    with_gaps = replace(zone, sea_level_gaps=True)
    GriddedForcing(grid, states[0], rules=zone).sample(e, 0.0)
    whole = environment(e)
    j, i = int(e.cell_j[0]), int(e.cell_i[0])
    ssh = states[0].ssh.copy()
    ssh[j, i] = np.nan
    gappy = states[0]._replace(ssh=ssh)
    with pytest.raises(ForcingError, match="ssh is NaN over water"):
        GriddedForcing(grid, gappy, rules=zone).check(e, 0.0, 0.0)
    forcing = GriddedForcing(grid, gappy, rules=with_gaps)
    forcing.check(e, 0.0, 0.0)
    forcing.sample(e, 0.0)
    assert e.slope_x[0] == e.slope_y[0] == 0.0
    far = (np.abs(e.cell_j - j) > 2) | (np.abs(e.cell_i - i) > 2)
    np.testing.assert_array_equal(environment(e)[:, far], whole[:, far])
    slopes = [ENVIRONMENT.index("slope_x"), ENVIRONMENT.index("slope_y")]
    others = np.setdiff1d(np.arange(len(ENVIRONMENT)), slopes)
    np.testing.assert_array_equal(environment(e)[others], whole[others])
    assert "no slope of the sea surface beside gaps" in forcing.describe()
    uo = states[0].uo.copy()
    uo[g.mask >= 0.5] = np.nan
    with pytest.raises(ForcingError, match="uo is NaN over water"):
        GriddedForcing(grid, gappy._replace(uo=uo), rules=with_gaps).check(e, 0.0, 0.0)
    with pytest.raises(ForcingError, match="a depth that needs the sea level"):
        FieldRules(sea_level_gaps=True)


@pytest.mark.parametrize("lazy", [False, True])
def test_gaps_over_water_are_refused_with_name_place_and_remedy(scene, lazy):
    """A NaN in water in a needed record is named; on land, or in a record that is not needed, it does no harm."""
    grid, states, e = scene
    rows, columns = np.nonzero(grid.arrays.mask[grid.domain] > 0.5)
    j, i = rows[5] + 4, columns[5] + 4
    states[2].va[j, i] = np.nan
    states[0].uo[grid.arrays.mask < 0.5] = np.nan
    forcing = GriddedForcing(grid, states.__getitem__ if lazy else states, [0.0, 3600.0, 7200.0])
    forcing.check(e, 0.0, 3600.0)
    forcing.sample(e, 0.0)
    assert np.isfinite(environment(e)).all()
    text = rf"va is NaN over water in cell \({i - 3}, {j - 3}\).*record 2.*Fill the gap"
    with pytest.raises(ForcingError, match=text):
        forcing.check(e, 0.0, 3601.0)


def test_elements_on_land_or_not_located_are_refused(scene):
    """The check names the element and what to do."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states[0])
    good = int(e.cell_i[7])
    e.cell_i[7] = 0
    with pytest.raises(ForcingError, match=r"element 8 .* in no cell of the domain.*locate"):
        forcing.check(e, 0.0, 1.0)
    e.cell_i[7] = good
    rows, columns = np.nonzero(grid.arrays.mask[grid.domain] < 0.5)
    e.cell_j[3], e.cell_i[3] = rows[0] + 4, columns[0] + 4
    with pytest.raises(ForcingError, match=r"element 4 .* is on land"):
        forcing.check(e, 0.0, 1.0)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"times": [0.0, 3600.0]}, "2 times for 3 records"),
        ({"times": [0.0, 3600.0, 3600.0]}, "rising"),
        ({}, "records without times"),
    ],
)
def test_impossible_times_are_refused(scene, options, text):
    """What is wrong with the times is named in the message."""
    grid, states, _ = scene
    with pytest.raises(ForcingError, match=text):
        GriddedForcing(grid, states, **options)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"depth_rule": "deep"}, "depth_rule = 'deep'"),
        ({"depth_rule": "zone"}, "without a zone"),
        ({"interpolation": "cubic"}, "interpolation = 'cubic'"),
        ({"stepwise": ["wind"]}, "stepwise names 'wind'"),
    ],
)
def test_impossible_rules_are_refused(options, text):
    """Each wrong rule is named in the message."""
    with pytest.raises(ForcingError, match=text):
        FieldRules(**options)


def test_fields_of_the_wrong_shape_are_refused(scene):
    """A field without the halo is named with both shapes."""
    grid, states, _ = scene
    with pytest.raises(ForcingError, match=r"vo has shape \(10, 12\), the grid \(18, 20\)"):
        GriddedForcing(grid, states[0]._replace(vo=np.zeros((10, 12))))
    with pytest.raises(ForcingError, match="no records"):
        GriddedForcing(grid, [], [])


def test_maps_agree_with_sampling(scene):
    """Currents and depth at points are what elements at those points are given; NaN outside and on land."""
    grid, states, e = scene
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0])
    forcing.sample(e, 1234.0)
    u, v = forcing.currents(e.lon.reshape(8, 5), e.lat.reshape(8, 5), 1234.0)
    assert u.shape == (8, 5)
    np.testing.assert_allclose(u.ravel(), e.uo, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(v.ravel(), e.vo, rtol=1e-9, atol=1e-9)
    # The sea level of the first record stood in the depth, and a bed of sediment took it for the whole run.
    forcing.sample(e, 0.0)
    level = forcing.sea_level(e.lon, e.lat, 0.0)
    assert (level != forcing.sea_level(e.lon, e.lat, 1234.0)).all()
    np.testing.assert_allclose(forcing.depth(e.lon, e.lat) + level, e.depth, rtol=1e-9, atol=1e-9)
    rows, columns = np.nonzero(grid.arrays.mask[grid.domain] < 0.5)
    x, y = grid.arrays.lon_centre[grid.domain][rows, columns], grid.arrays.lat_centre[grid.domain][rows, columns]
    u, v = forcing.currents(np.append(x, [300.0, 323.0]), np.append(y, [-55.5, -70.0]), 0.0)
    assert np.isnan(u).all()
    assert np.isnan(v).all()
    assert np.isnan(forcing.depth(x, y)).all()


def test_maps_of_periodic_grids_know_all_images():
    """Points one period away show the same current."""
    rng = np.random.default_rng(53)
    grid = square_lakes(rng, land=0.0)
    forcing = GriddedForcing(grid, random_fields(grid, rng))
    x, y = rng.uniform(0, 11e3, 50), rng.uniform(0, 9e3, 50)
    here, there = forcing.currents(x, y, 0.0), forcing.currents(x + 11e3, y, 0.0)
    np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-9)
    assert np.isfinite(here).all()


def test_no_elements_no_trouble(scene):
    """A run whose last element is gone goes on."""
    grid, states, e = scene
    none = e.taken(slice(0))
    forcing = GriddedForcing(grid, states, [0.0, 3600.0, 7200.0])
    forcing.check(none, 0.0, 10.0)
    forcing.sample(none, 10.0)


def test_description_says_what_it_is_and_covers():
    """Source, time, depth rule, drift and grid in plain words."""
    grid = Grid.cartesian(6, 6, 10.0)
    fields = grid.fields()
    text = GriddedForcing(
        grid, [fields, fields], [0.0, 60.0], FieldRules(coastal_drift=0.4), source="a test", start=datetime(2020, 1, 1)
    ).describe()
    assert text.startswith("gridded fields from a test\n2 records from 0 s (2020-01-01 00:00:00) to 60 s")
    assert "coastal drift 0.4 m/s" in text
    assert "6 x 6 cells" in text
    assert "constant in time" in GriddedForcing(grid, fields).describe()
