"""Fields at the elements against plain twins and against theory (equations 3.2)."""

from __future__ import annotations

import numpy as np
import pytest

from ocean.grids import ALL, bent, random_fields, scattered, square_lakes
from riftberg import FieldRules, Grid, GriddedForcing
from riftberg.state import new_elements
from twins import cells as plain_cells
from twins import fields as twin

SAMPLED = (
    "uo", "vo", "ui", "vi", "ua", "va", "slope_x", "slope_y", "depth", "sst", "sss", "ice_fraction", "ice_thickness",
)  # fmt: skip

RULES = {"cell": 0, "biquadratic": 1, "zone": 2}
"""Rules of the depth by their numbers in the twin."""


def sampled(grid, fields, elements, **rules):
    """Sample one state with these rules, by default with the depth of the cell, and return the elements."""
    forcing = GriddedForcing(grid, fields, rules=FieldRules(**{"depth_rule": "cell", **rules}))
    forcing.sample(elements, 0.0)
    return elements


def expected(grid, fields, e, n, **options):
    """Values of the twin for element ``n``."""
    plain, halo = plain_cells.PlainGrid.of(grid.arrays), grid.arrays.halo
    where = e.lon[n], e.lat[n], int(e.cell_i[n]) - halo + 1, int(e.cell_j[n]) - halo + 1, e.xi[n], e.eta[n]
    prepared = GriddedForcing(grid, fields).fields_at(0.0)  # nothing on land
    return twin.sample(plain, prepared, *(float(q) if isinstance(q, np.floating) else q for q in where), **options)


def assert_twin(grid, fields, e, **options):
    """All elements agree with the twin."""
    for n in range(e.lon.size):
        values = expected(grid, fields, e, n, **options)
        for name in SAMPLED:
            np.testing.assert_allclose(getattr(e, name)[n], values[name], rtol=1e-12, atol=1e-12, err_msg=name)


def from_positions(grid, function):
    """Cell field with the value of ``function(x, y)`` at every cell centre, halo included."""
    return np.ascontiguousarray(function(grid.arrays.lon_centre, grid.arrays.lat_centre))


@pytest.mark.quick(3)
@pytest.mark.parametrize("make", ALL)
@pytest.mark.parametrize("rule", ["cell", "biquadratic"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_sampling_agrees_with_twin(make, rule, mirrored):
    """Random fields, random land, drift near the coast, turned grids: all variables as in the plain twin."""
    rng = np.random.default_rng(21)
    grid = make(rng)
    fields, e = random_fields(grid, rng), scattered(grid, 60, rng, wet=False)
    sampled(grid, fields, e, depth_rule=rule, coastal_drift=0.4, mirrored=mirrored)
    assert_twin(grid, fields, e, rule=RULES[rule], coastal=0.4, mirrored=mirrored)


def test_depth_stencil_of_the_other_parity_agrees_with_twin():
    """Quirk Q20: with even parity the anchors are the even cells, and the depth differs."""
    rng = np.random.default_rng(22)
    grid = square_lakes(rng)
    fields, e = random_fields(grid, rng), scattered(grid, 60, rng)
    odd = sampled(grid, fields, e, depth_rule="biquadratic").depth.copy()
    sampled(grid, fields, e, depth_rule="biquadratic", even_parity=True)
    assert_twin(grid, fields, e, rule=RULES["biquadratic"], odd=0)
    assert np.abs(odd - e.depth).max() > 0.1


def test_linear_currents_are_exact_and_vorticity_is_their_curl():
    """A field a + b x + c y at the corners is met exactly at the elements, and vorticity = dv/dx - du/dy everywhere."""
    rng = np.random.default_rng(23)
    grid = Grid.cartesian(9, 9, 500.0, mask=np.ones((17, 17)))  # water outside too
    x, y = grid.arrays.lon, grid.arrays.lat
    fields = grid.fields()._replace(uo=0.1 + 2e-5 * x - 3e-5 * y, vo=-0.2 + 7e-5 * x + 1e-5 * y)
    e = sampled(grid, fields, scattered(grid, 100, rng))
    np.testing.assert_allclose(e.uo, 0.1 + 2e-5 * e.lon - 3e-5 * e.lat, rtol=1e-12)
    np.testing.assert_allclose(e.vo, -0.2 + 7e-5 * e.lon + 1e-5 * e.lat, rtol=1e-11)
    np.testing.assert_allclose(e.vorticity, 7e-5 + 3e-5, rtol=1e-10)


def test_vorticity_varies_linearly_within_a_cell():
    """dv/dx grows northward if v has an xy term: vorticity = c y at the element, not a mean of the cell."""
    grid = Grid.cartesian(9, 9, 500.0)
    x, y = grid.arrays.lon, grid.arrays.lat
    fields = grid.fields()._replace(vo=1e-8 * x * y)
    e = sampled(grid, fields, scattered(grid, 50, np.random.default_rng(24)))
    np.testing.assert_allclose(e.vorticity, 1e-8 * e.lat, rtol=1e-10)


@pytest.mark.parametrize("make", [square_lakes, bent])
def test_a_plane_sea_surface_has_its_slope(make):
    """Without land a plane sea surface gives its gradient (bent grids: along the boxes only), a flat one nothing."""
    rng = np.random.default_rng(25)
    grid = Grid.cartesian(9, 9, 500.0) if make is square_lakes else make(rng, land=0.0)
    e = scattered(grid, 60, rng)
    inner = (np.abs(e.cell_i - 8) < 3) & (np.abs(e.cell_j - 8) < 3)
    assert inner.sum() > 10
    ssh = from_positions(grid, lambda x, y: 1e-6 * x - 3e-6 * y)
    if make is square_lakes:
        sampled(grid, grid.fields()._replace(ssh=ssh), e)
        np.testing.assert_allclose(e.slope_x[inner], 1e-6, rtol=1e-9)
        np.testing.assert_allclose(e.slope_y[inner], -3e-6, rtol=1e-9)
    sampled(grid, grid.fields(ssh=2.5), e)
    assert np.all(e.slope_x[inner] == 0.0)
    assert np.all(e.slope_y[inner] == 0.0)


def test_land_carries_no_slope():
    """Faces to land have slope 0, whatever sea level stands on land, NaN included."""
    mask = np.ones((9, 9))
    mask[:, 4:] = 0.0
    grid = Grid.cartesian(9, 9, 1000.0, mask=mask)
    ssh = from_positions(grid, lambda x, y: 1e-6 * x)
    ssh[grid.arrays.mask == 0.0] = np.nan
    e = new_elements(2)
    e.lon[:], e.lat[:] = (3999.0, 3500.0), (4500.0, 4500.0)
    grid.locate(e)
    sampled(grid, grid.fields()._replace(ssh=ssh), e)
    # xi = 0.999 and 0.5 in the cell west of land: the east face has slope 0, the west face 1e-6.
    np.testing.assert_allclose(e.slope_x, (1e-9, 5e-7), rtol=1e-9)
    assert np.all(e.slope_y == 0.0)


@pytest.mark.parametrize("even", [False, True])
def test_quadratic_depth_is_exact(even):
    """Biquadratic interpolation reproduces any biquadratic sea floor, sea level included (equations 3.2)."""
    rng = np.random.default_rng(26)
    grid = Grid.cartesian(12, 12, 1000.0)

    def floor(x, y):
        p, q = x / 1e3 - 6.0, y / 1e3 - 5.0
        return (300.0 + 7.0 * p + 2.0 * p * p) * (1.0 - 0.02 * q + 0.01 * q * q)

    fields = grid.fields()._replace(depth=from_positions(grid, floor), ssh=from_positions(grid, lambda x, y: 1e-4 * x))
    e = sampled(grid, fields, scattered(grid, 200, rng), depth_rule="biquadratic", even_parity=even)
    np.testing.assert_allclose(e.depth, floor(e.lon, e.lat) + 1e-4 * e.lon, rtol=1e-12)


def test_biquadratic_depth_is_continuous_across_cells():
    """Random depth, points a hair on both sides of cell edges and of cell centres: no jump (quirk Q20: C0)."""
    rng = np.random.default_rng(27)
    grid = Grid.cartesian(12, 12, 1000.0)
    fields = grid.fields(depth=rng.uniform(100, 1000, (12, 12)))
    e = new_elements(400)
    e.lon[:], e.lat[:] = rng.uniform(2e3, 10e3, 400), 500.0 * rng.integers(5, 20, 400)
    depths = []
    for side in (-1e-7, 1e-7):
        e.lat[:] += side
        grid.locate(e)
        depths.append(sampled(grid, fields, e, depth_rule="biquadratic").depth.copy())
    np.testing.assert_allclose(*depths, atol=1e-5)


def test_depth_of_cell_is_floor_plus_sea_level():
    """Quirk Q19: the STS depth is the same everywhere in a cell."""
    rng = np.random.default_rng(28)
    grid = square_lakes(rng)
    fields, e = random_fields(grid, rng), scattered(grid, 50, rng)
    sampled(grid, fields, e)
    np.testing.assert_array_equal(e.depth, (fields.depth + fields.ssh)[e.cell_j, e.cell_i])


def test_dry_zone_is_a_quadrant():
    """Quirk Q18: all that lies north-east of the point is dry, in longitudes of 0..360 (+360 rule) and -180..180."""
    lon, lat = np.meshgrid(np.arange(-180.0, 180.0, 10.0) + 10.0, np.arange(-70.0, 31.0, 10.0))
    zone = FieldRules(depth_rule="zone", zone=(-37.51, -55.2166))
    grid = Grid.from_corners(lon, lat)
    forcing = GriddedForcing(grid, grid.fields(depth=500.0), rules=zone)
    x = np.array([-37.50, -37.52, -37.50, 60.0, -37.51])
    y = np.array([-55.2, -55.2, -55.3, 10.0, -55.2])
    for turn in (0.0, 360.0):
        np.testing.assert_array_equal(forcing.depth(x[:4] + turn, y[:4]), [0.0, 1000.0, 1000.0, 0.0])
    np.testing.assert_array_equal(forcing.depth(x[4:] + 360.0, y[4:]), [1000.0])


def test_dry_zone_agrees_with_twin():
    """On the A68a longitudes the rule equals the reference's comparison with zone + 360."""
    rng = np.random.default_rng(29)
    grid = ALL[2](rng)
    fields, e = random_fields(grid, rng), scattered(grid, 100, rng)
    zone = (-37.3, -55.2166)
    sampled(grid, fields, e, depth_rule="zone", zone=zone)
    assert_twin(grid, fields, e, rule=RULES["zone"], zone=zone)
    assert set(e.depth) == {0.0, 1000.0}


def test_coastal_drift_pushes_away_from_land():
    """Land in the east makes a westward current of the drift speed, land on both sides or none leaves it alone."""
    mask = np.ones((9, 9))
    mask[:, 6] = 0.0
    mask[3, 3] = mask[3, 1] = 0.0
    grid = Grid.cartesian(9, 9, 1000.0, mask=mask)
    e = new_elements(3)
    e.lon[:], e.lat[:] = (5500.0, 2500.0, 4500.0), (6500.0, 3500.0, 6500.0)
    grid.locate(e)
    fields = grid.fields(uo=0.1, ui=0.2, ua=5.0)
    uo, vo, ui, ua = (getattr(sampled(grid, fields, e), name).copy() for name in ("uo", "vo", "ui", "ua"))
    sampled(grid, fields, e, coastal_drift=0.4)
    np.testing.assert_allclose(e.uo, uo - (0.4, 0.0, 0.0), rtol=1e-14)
    np.testing.assert_allclose(e.ui, ui - (0.4, 0.0, 0.0), rtol=1e-14)
    np.testing.assert_array_equal([e.vo, e.ua], [vo, ua])


def test_turned_grids_give_eastward_and_northward_values():
    """A current along the grid's axis, on a grid turned by 30 degrees: u' = C u + S v, v' = C v - S u (equations 3.2)."""
    x, y = np.meshgrid(np.arange(1.0, 9.0) * 1000.0, np.arange(1.0, 9.0) * 1000.0)
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    grid = Grid.from_corners(x, y, latlon=False, period=0.0, mask=np.ones((16, 16)), cos_angle=c, sin_angle=s)
    e = scattered(grid, 20, np.random.default_rng(30))
    sampled(grid, grid.fields(uo=1.0, vo=0.5), e)
    np.testing.assert_allclose(e.uo, c + 0.5 * s, rtol=1e-13)
    np.testing.assert_allclose(e.vo, 0.5 * c - s, rtol=1e-13)


def draws(grid, fields, e):
    """Random numbers of the elements by the published generator: MT19937 seeded per cell, two words each, last row first."""
    halo, words, out = grid.arrays.halo, {}, np.empty((2, e.lon.size))
    ssh = GriddedForcing(grid, fields).fields_at(0.0).ssh
    for n in reversed(range(e.lon.size)):
        i, j = int(e.cell_i[n]), int(e.cell_j[n])
        mine = words.setdefault(
            (i, j), iter(twin.mersenne_words(twin.seed(i - halo + 1, j - halo + 1, ssh[j, i]), 2 * e.lon.size))
        )
        out[:, n] = [2.0 * (next(mine) / (2.0**32 - 1.0)) - 1.0 for _ in range(2)]
    return out


@pytest.mark.parametrize("make", ALL)
def test_tidal_drift_agrees_with_twin(make):
    """Random land: currents of ocean and ice with tidal and coastal drift as in the twin, also on turned grids."""
    rng = np.random.default_rng(32)
    grid = make(rng, land=0.4)
    fields, e = random_fields(grid, rng), scattered(grid, 80, rng)
    still = sampled(grid, fields, e, coastal_drift=0.4).uo.copy()
    sampled(grid, fields, e, coastal_drift=0.4, tidal_drift=0.3)
    tide = 0.3 * draws(grid, fields, e)
    assert max(np.unique(np.stack([e.cell_i, e.cell_j]), axis=1, return_counts=True)[1]) > 1  # several in one cell
    for n in range(80):
        values = expected(grid, fields, e, n, coastal=0.4, tidal=tuple(tide[:, n]))
        for name in ("uo", "vo", "ui", "vi", "ua"):
            np.testing.assert_allclose(getattr(e, name)[n], values[name], rtol=1e-12, atol=1e-14)
    assert np.any(e.uo != still)


def test_tidal_drift_is_the_same_in_every_repetition_and_absent_at_sea():
    """The seed depends on cell and sea level only; away from land there is no random current."""
    grid = Grid.cartesian(9, 9, 1000.0)
    fields, e = grid.fields(uo=0.1, ssh=0.3), new_elements(2)
    e.lon[:], e.lat[:] = (4500.0, 200.0), (4500.0, 4500.0)
    grid.locate(e)
    results = []
    for _ in range(2):
        sampled(grid, fields, e, tidal_drift=0.3)
        results.append((e.uo.copy(), e.vo.copy()))
    np.testing.assert_array_equal(results[0], results[1])
    assert e.uo[0] == 0.1
    assert abs(e.vo[1]) > 0.0


def test_between_two_records_stands_the_weighted_mean_around_the_elements():
    """In the cells that their stencils read; a field that is held is that of the earlier record, and not copied."""
    rng = np.random.default_rng(33)
    grid = square_lakes(rng, land=0.0)
    first, second = random_fields(grid, rng), random_fields(grid, rng)
    forcing = GriddedForcing(grid, [first, second], [0.0, 100.0], FieldRules(stepwise=("ssh",)))
    before, after = forcing.fields_at(0.0), forcing.fields_at(100.0)
    between = forcing.fields_at(25.0, np.array([6, 8]), np.array([7, 7]))
    box = np.s_[5:10, 4:11]
    for name, a, b, q in zip(first._fields, before, after, between, strict=True):
        if name == "ssh":
            assert q is a
        else:
            np.testing.assert_allclose(q[box], 0.75 * a[box] + 0.25 * b[box], rtol=1e-12, atol=1e-15)
