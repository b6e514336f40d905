"""Cell test, coordinates in a cell, search, land and periodicity against plain twins and against theory (equations 2, 8)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ocean.grids import ALL, bent, cap, degrees, scattered, square_lakes
from riftberg import Grid, Parameters
from riftberg.errors import BergError
from riftberg.ocean.cells import adjust_cell, round_trip, search_nearby, settle_elements
from riftberg.physics.geometry import inverse_bilinear, wrap_around
from riftberg.state import new_elements
from twins import cells as twin


def located(grid, x, y):
    """Return elements at positions, in their cells."""
    e = new_elements(np.size(x))
    e.lon[:], e.lat[:] = x, y
    grid.locate(e)
    return e


def cell_of(grid, e, n):
    """Return the cell of an element as the reference counts: from 1 in the domain."""
    return int(e.cell_i[n]) - grid.arrays.halo + 1, int(e.cell_j[n]) - grid.arrays.halo + 1


def cell_at(grid, x, y):
    """Return the cell of a position, None where it is refused as one outside of the grid."""
    try:
        return cell_of(grid, located(grid, [x], [y]), 0)
    except BergError:
        return None


PARAMS = Parameters().kernel_values()

TWENTIETH = Parameters(stepping={"scheme": "mts"}, compatibility={"elements_stopped_alone": True}).kernel_values()


def lake(ni=8, nj=8, land=(), period=0.0, mask=None):
    """Cartesian grid of 1 km cells; ``land`` lists reference cells (i, j)."""
    mask = np.ones((nj, ni)) if mask is None else mask
    for i, j in land:
        mask[j - 1, i - 1] = 0.0
    return Grid.cartesian(ni, nj, 1000.0, period=period, mask=mask)


def copy(elements):
    """Independent copy of elements."""
    return elements.copy()


def test_wrap_around_is_the_image_within_half_a_period():
    """Images differ by whole periods and lie in [centre - L/2, centre + L/2); no period, no change."""
    for x in (-725.0, -180.0, 0.0, 179.9, 180.0, 541.0):
        image = wrap_around(x, 0.0, 360.0)
        assert -180.0 <= image < 180.0
        turns = (image - x) / 360.0
        assert turns == pytest.approx(round(turns), abs=1e-12)
        assert wrap_around(x, 5.0, 0.0) == x
        assert image == twin.modulo(x, 0.0, 360.0)


def test_fast_path_of_wrap_around_has_the_same_bits():
    """Leaving out the remainder for numbers in range changes no bit (needed for the KID round trip)."""
    rng = np.random.default_rng(1)
    for x, centre in zip(rng.uniform(0, 20e3, 500), rng.uniform(0, 20e3, 500), strict=True):
        assert wrap_around(x, centre, 20e3) == twin.modulo(x, centre, 20e3)


@pytest.mark.parametrize("make", ALL)
def test_cells_and_coordinates_agree_with_twin(make):
    """Random points in cells, also of images a period away: the cell that the twin's scan finds, with the twin's (xi, eta)."""
    rng = np.random.default_rng(2)
    grid = make(rng, land=-1.0)
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    spread = scattered(grid, 400, rng, wet=False)
    x = spread.lon + (a.period * (np.arange(400) % 3 - 1) if a.period > 0 else 0.0)
    e = located(grid, x, spread.lat)
    for n in range(400):
        assert cell_of(grid, e, n) in twin.scan(plain, x[n], spread.lat[n], a.ni, a.nj)
        xi, eta, flag = twin.position(plain, x[n], spread.lat[n], *cell_of(grid, e, n))
        assert flag
        np.testing.assert_allclose((e.xi[n], e.eta[n]), (xi, eta), rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("make", ALL)
def test_cells_tile_the_domain(make):
    """Corners of cells, and points on their edges, lie in the one cell that the twin finds (half-open cells)."""
    rng = np.random.default_rng(3)
    grid = make(rng, land=-1.0)
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    for j, i in rng.integers(5, 10, (30, 2)):
        for share in (0.0, 0.5) if make is not bent else (0.0,):
            x, y = a.lon[j, i] + share * (a.lon[j, i + 1] - a.lon[j, i]), a.lat[j, i]
            (cell,) = twin.scan(plain, x, y, a.ni, a.nj)
            e = located(grid, [x], [y])
            assert cell_of(grid, e, 0) == cell


@settings(max_examples=300, deadline=None)
@example(shift=(0.0,) * 6 + (1.192092896e-07, 0.0), xi=0.0, eta=1.0, turn=0.0, size=-3.0)  # small, and nearly straight
@given(
    st.tuples(*[st.floats(-0.3, 0.3)] * 8), st.floats(0, 1), st.floats(0, 1), st.floats(0, 6.283), st.floats(-3, 5),
)  # fmt: skip
def test_inverse_bilinear_undoes_bilinear(shift, xi, eta, turn, size):
    """Convex quadrilaterals of any size and direction: position -> (xi, eta) -> position comes back."""
    corners = (np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) + np.reshape(shift, (4, 2))) * 10.0**size
    c, s = np.cos(turn), np.sin(turn)
    corners = corners @ np.array([[c, s], [-s, c]])
    weights = np.array([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta])
    x, y = weights @ corners
    found = inverse_bilinear(x, y, 0.0, *map(tuple, corners))
    a, b = found
    back = np.array([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b]) @ corners
    np.testing.assert_allclose(back, (x, y), rtol=0, atol=1e-9 * 10.0**size)


def test_inverse_bilinear_of_almost_parallel_edges_in_metres_keeps_its_digits():
    """A trapezium of 5 km whose edges diverge by a micrometre: the textbook root formula loses all digits here."""
    corners = np.array([(4e5, 3e5), (4.05e5, 3e5 + 1e-6), (4.05e5, 3.05e5), (4e5, 3.05e5 + 2e-6)])
    for xi, eta in ((0.1, 0.9), (0.7, 0.2)):
        weights = np.array([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta])
        found = inverse_bilinear(*(weights @ corners), 0.0, *map(tuple, corners))
        np.testing.assert_allclose(found, (xi, eta), atol=1e-12)


def test_inverse_bilinear_of_a_cell_turned_by_ninety_degrees():
    """Edges along the other axis up to round-off: no division by the rounding error of cos 90 degrees."""
    c, s = np.cos(np.pi / 2), np.sin(np.pi / 2)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) @ np.array([[c, s], [-s, c]]) * 1000.0
    weights = np.array([0.7 * 0.4, 0.3 * 0.4, 0.3 * 0.6, 0.7 * 0.6])
    np.testing.assert_allclose(
        inverse_bilinear(*(weights @ corners), 0.0, *map(tuple, corners)), (0.3, 0.6), rtol=1e-13
    )


def test_search_in_a_grid_bent_to_a_half_circle():
    """Found here: on strongly curved grids the walk lost its way and every search scanned all cells."""
    radius, turn = np.meshgrid(100.0 + np.arange(61), np.linspace(0.0, 3.0, 90))
    grid = Grid.from_corners(
        radius * np.cos(turn), radius * np.sin(turn), latlon=False, regular=False, period=0.0, includes_southwest=True
    )
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    e = scattered(grid, 300, np.random.default_rng(11))
    for n in range(300):
        assert search_nearby(e.lon[n], e.lat[n], a) == (e.cell_i[n], e.cell_j[n])
    assert twin.scan(plain, e.lon[0], e.lat[0], a.ni, a.nj) == [(e.cell_i[0] - 3, e.cell_j[0] - 3)]
    assert search_nearby(0.0, 10.0, a) == (-1, -1)
    assert cell_at(grid, 0.0, 10.0) is None


@pytest.mark.compiled  # the whole part of NaN is a number there, and an error in Python
def test_search_outside_the_domain_finds_nothing():
    """Points south, north, west and east of a closed grid have no cell."""
    for x, y in ((4000, -1), (4000, 8001), (-1, 4000), (8001, 4000), (1e9, 0), (np.nan, 0)):
        assert cell_at(lake(), float(x), float(y)) is None
    assert cell_at(lake(), 4000.0, 4000.0) == (5, 5)


def test_polar_cells_agree_with_twin_and_hold_every_point_once():
    """Around the pole every point lies in one cell, (xi, eta) stays in the unit box and equals the twin's."""
    rng = np.random.default_rng(6)
    grid = cap(rng)
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    x, y = rng.uniform(-180, 180, 200), 90.0 - 3.0 * rng.random(200) ** 2
    e = located(grid, x, y)
    for n in range(200):
        assert [cell_of(grid, e, n)] == twin.scan(plain, x[n], y[n], a.ni, a.nj)
        xi, eta, _ = twin.position(plain, x[n], y[n], *cell_of(grid, e, n))
        assert 0.0 <= e.xi[n] < 1.0
        assert 0.0 <= e.eta[n] < 1.0
        # The cell is a triangle: xi is known to round-off over the width that is left at eta. The sines and cosines of the
        # twin are those of the C library, which round the last bit otherwise.
        left = 1.0 - e.eta[n] if y[n] > 88.0 else 1.0
        np.testing.assert_allclose((left * e.xi[n], e.eta[n]), (left * xi, eta), rtol=1e-12, atol=3e-12)


def test_points_between_chord_and_parallel_of_a_wedge_at_the_pole_have_coordinates():
    """Found here: the second root, the pole itself, was taken for points just south of the chord, and gave NaN."""
    grid = cap(np.random.default_rng(0))
    a = grid.arrays
    j = a.halo + a.nj - 1
    e = located(grid, [0.5 * (a.lon[j, 8] + a.lon[j, 9])], [a.lat[j - 1, 9] + 0.01])
    assert (e.cell_i[0], e.cell_j[0]) == (9, j)
    assert 0.0 <= e.eta[0] < 0.05
    assert e.xi[0] == pytest.approx(0.5)


@pytest.mark.parametrize("pole", ["NE", "NW", "SW", "SE"])
def test_one_polar_corner_makes_a_pentagon(pole):
    """Cells with the pole at any one corner (tripolar grids): verdict as the twin's, some points in, some out."""
    around = ["SW", "SE", "NE", "NW"]
    first = around.index(pole)
    places = [(123.0, 90.0), (-10.0, 89.2), (30.0, 88.0), (70.0, 89.0)]
    corners = {around[(first + k) % 4]: place for k, place in enumerate(places)}
    x, y = np.zeros((2, 2)), np.zeros((2, 2))
    for name, (j, i) in {"SW": (0, 0), "SE": (0, 1), "NE": (1, 1), "NW": (1, 0)}.items():
        x[j, i], y[j, i] = corners[name]
    grid = Grid.from_corners(x, y, regular=False, cyclic=False, includes_southwest=True)
    plain, rng = twin.PlainGrid.of(grid.arrays), np.random.default_rng(7)
    seen = set()
    for lon_, lat_ in zip(rng.uniform(-30, 130, 300), rng.uniform(87.5, 90.0, 300), strict=True):
        flag = cell_at(grid, lon_, lat_) == (1, 1)
        assert flag == twin.in_cell(plain, lon_, lat_, 1, 1)
        if lat_ > 89.2:
            assert flag == (-10.0 < lon_ < 70.0)
        seen.add(flag)
    assert seen == {True, False}


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_mesh_across_the_pole_is_bilinear_in_the_plane_of_the_pole(turn):
    """Four cells that run along no meridian meet at the pole: every corner counts with its own longitude and latitude.

    Bug: points beside the pole at longitudes beyond those of all corners were taken to be outside of the grid.
    """
    rng = np.random.default_rng(12)
    x, y = np.meshgrid(np.arange(-2.0, 2.5), np.arange(-2.0, 2.5))
    shift = rng.uniform(-0.2, 0.2, (2, 5, 5))
    shift[:, 2, 2] = 0.0
    x, y = 0.5 * (x + shift[0]), 0.5 * (y + shift[1])
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    lon, lat = np.degrees(np.arctan2(y, x)), 90.0 - np.hypot(x, y)
    grid = Grid.from_corners(lon, lat, regular=False, cyclic=False, includes_southwest=True)
    for _ in range(100):
        (j, i), (xi, eta) = rng.integers(1, 3, 2), rng.uniform(0.02, 0.98, 2)
        weights = np.array([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta])
        rows, columns = [j, j, j + 1, j + 1], [i, i + 1, i + 1, i]
        px, py = weights @ x[rows, columns], weights @ y[rows, columns]
        e = located(grid, [np.degrees(np.arctan2(py, px))], [90.0 - np.hypot(px, py)])
        assert cell_of(grid, e, 0) == (i + 1, j + 1)
        np.testing.assert_allclose((e.xi[0], e.eta[0]), (xi, eta), atol=1e-9)
        e.xi[:], e.eta[:] = xi, eta
        round_trip(e, grid.arrays)
        np.testing.assert_allclose(twin.plane(e.lon[0], e.lat[0]), (px, py), atol=1e-9)


def test_position_in_a_polar_cell_lies_in_the_plane_of_the_pole():
    """The middle of a wedge at the pole is the mean of its corners in the polar plane, not of its longitudes."""
    a = cap(np.random.default_rng(0)).arrays
    e = new_elements(1)
    e.cell_i[:], e.cell_j[:], e.xi[:], e.eta[:] = a.halo + 3, a.halo + a.nj - 1, 0.5, 0.5
    round_trip(e, a)
    x, y = e.lon[0], e.lat[0]
    corners = [twin.plane(lon, lat) for lon, lat in twin.PlainGrid.of(a).corners(4, a.nj)]
    np.testing.assert_allclose(twin.plane(x, y), np.mean(corners, axis=0), atol=1e-12)


@pytest.mark.quick(1)
@pytest.mark.parametrize("make", [square_lakes, bent, degrees])
def test_moves_between_cells_agree_with_twin(make):
    """Random moves of up to six cells among random land: position, cell and bounce as in the plain twin."""
    rng = np.random.default_rng(8)
    grid = make(rng, land=0.15)
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    e = scattered(grid, 600, rng)
    width, bounces, far = float(a.lon[8, 8] - a.lon[8, 7]), 0, 0
    for n in range(600):
        reach = 6.0 if n % 5 == 0 else 1.3
        x, y = e.lon[n] + width * rng.uniform(-reach, reach), e.lat[n] + width * rng.uniform(-reach, reach)
        try:
            expected = twin.adjust(plain, x, y, e.cell_i[n] - a.halo + 1, e.cell_j[n] - a.halo + 1)
        except ValueError:
            continue  # the reference stops there: no real root far outside a bent cell
        found = adjust_cell(x, y, e.cell_i[n], e.cell_j[n], a, 0.05)
        assert (found[2] - a.halo + 1, found[3] - a.halo + 1, found[6]) == (expected[2], expected[3], expected[6])
        np.testing.assert_allclose(found[:2], expected[:2], rtol=1e-12)
        np.testing.assert_allclose(found[4:6], expected[4:6], rtol=1e-12, atol=1e-10)
        bounces += found[6]
        far += abs(found[2] - e.cell_i[n]) > 2
    assert bounces > 50
    assert far > 5


def test_land_stops_an_element_five_percent_inside_its_cell():
    """A step east into land ends at xi = 0.95, a step south-west into land at (0.05, 0.05) (equations 8.1)."""
    a = lake(land=[(5, 4), (3, 4), (4, 3), (3, 3)]).arrays
    i = j = a.halo + 3
    x, y, i1, j1, xi, eta, bounced = adjust_cell(4200.0, 3500.0, i, j, a, 0.05)
    assert (i1, j1, bounced) == (i, j, True)
    np.testing.assert_allclose((x, y, xi, eta), (3950.0, 3500.0, 0.95, 0.5), rtol=1e-12)
    x, y, i1, j1, xi, eta, bounced = adjust_cell(2900.0, 2900.0, i, j, a, 0.05)
    assert (i1, j1, bounced) == (i, j, True)
    np.testing.assert_allclose((x, y, xi, eta), (3050.0, 3050.0, 0.05, 0.05), rtol=1e-12)


def test_ring_of_a_closed_domain_is_land():
    """An element pushed over the northern end of the domain stays inside, since land lies beyond by default."""
    a = lake().arrays
    _, y, _, j, _, _, bounced = adjust_cell(3500.0, 8300.0, a.halo + 3, a.halo + 7, a, 0.05)
    assert bounced
    assert j == a.halo + 7
    assert y == pytest.approx(7950.0)


def test_more_than_four_cells_end_in_the_fourth():
    """Quirk Q42: a move over seven cells is clipped 5 % inside the fourth cell on the way, without a bounce."""
    a = lake(ni=12).arrays
    x, y, i, j, xi, eta, bounced = adjust_cell(500.0 + 7000.0, 3500.0, a.halo, a.halo + 3, a, 0.05)
    assert (i, j, bounced) == (a.halo + 4, a.halo + 3, False)
    np.testing.assert_allclose((x, y, xi, eta), (4950.0, 3500.0, 0.95, 0.5), rtol=1e-12)
    assert adjust_cell(500.0 + 4000.0, 3500.0, a.halo, a.halo + 3, a, 0.05)[0] == 4500.0


def test_settling_wraps_positions_and_pair_positions_by_one_period():
    """An element that crossed the eastern end comes back in the west; positions and pair positions shift alike."""
    grid = lake(ni=8, period=8000.0)
    a = grid.arrays
    e = new_elements(2)
    e.lon[:], e.lat[:] = (7900.0, 100.0), (3500.0, 3500.0)
    grid.locate(e)
    e.lon[:] += (300.0, -300.0)
    e.lon_pair[:] = e.lon - (20.0, -20.0)
    settle_elements(e, a, PARAMS)
    np.testing.assert_allclose(e.lon, (200.0, 7800.0), rtol=1e-13)
    np.testing.assert_allclose(e.lon_pair, (180.0, 7820.0), rtol=1e-13)
    assert list(e.cell_i) == [a.halo, a.halo + 7]
    np.testing.assert_allclose(e.xi, (0.2, 0.8), rtol=1e-12)


def test_settling_matches_moving_each_element_and_skips_static_ones():
    """The loop over elements gives what `adjust_cell` gives one by one; static elements keep all values."""
    rng = np.random.default_rng(9)
    grid = degrees(rng)
    e = scattered(grid, 200, rng)
    e.static[::7] = 1.0
    e.lon[:] += rng.uniform(-0.2, 0.2, 200)
    e.lat[:] += rng.uniform(-0.2, 0.2, 200)
    before = copy(e)
    stopped = settle_elements(e, grid.arrays, TWENTIETH)
    count = 0
    for n in range(200):
        if before.static[n] >= 0.5:
            assert all(
                np.array_equal(after[n], old[n], equal_nan=True)
                for after, old in zip(e.arrays().values(), before.arrays().values(), strict=True)
            )
            continue
        x, y, i, j, xi, eta, hit = adjust_cell(
            before.lon[n], before.lat[n], before.cell_i[n], before.cell_j[n], grid.arrays, 0.05
        )
        assert (e.lon[n], e.lat[n], e.cell_i[n], e.cell_j[n], e.xi[n], e.eta[n]) == (x, y, i, j, xi, eta)
        count += hit
    assert stopped == count > 0


def test_settling_leaves_velocities_alone():
    """Quirk Q4: a bounce on land does not touch the velocity."""
    grid = lake(land=[(5, 4)])
    e = new_elements(1)
    e.lon[:], e.lat[:], e.u[:] = 3900.0, 3500.0, 2.0
    grid.locate(e)
    e.lon[:] = 4100.0
    assert settle_elements(e, grid.arrays, TWENTIETH) == 1
    assert e.u[0] == 2.0
    assert e.lon[0] == pytest.approx(3950.0)


def test_round_trip_has_the_operation_order_of_the_specification():
    """Quirk Q40: positions after the round trip equal the plain formula bit for bit, and shift pair positions alike."""
    rng = np.random.default_rng(10)
    grid = Grid.cartesian(20, 20, 1000.0, period=20_000.0)
    a, plain = grid.arrays, twin.PlainGrid.of(grid.arrays)
    e = new_elements(300)
    e.lon[:], e.lat[:] = rng.uniform(0, 20e3, 300), rng.uniform(0, 20e3, 300)
    grid.locate(e)
    e.lon_pair[:], e.lat_pair[:] = e.lon + rng.normal(size=300), e.lat + rng.normal(size=300)
    old = copy(e)
    round_trip(e, a)
    for n in range(300):
        i, j = old.cell_i[n] - a.halo + 1, old.cell_j[n] - a.halo + 1
        x, y = (twin.bilinear(plain, q, i, j, float(old.xi[n]), float(old.eta[n])) for q in (a.lon, a.lat))
        assert (e.lon[n], e.lat[n]) == (x, y)
        assert e.lon_pair[n] == x - (old.lon[n] - old.lon_pair[n])
        assert e.lat_pair[n] == y - (old.lat[n] - old.lat_pair[n])
        assert (e.xi[n], e.eta[n]) == twin.position(plain, x, y, i, j)[:2]
    assert np.any(e.lon != old.lon)
    np.testing.assert_allclose(e.lon, old.lon, rtol=1e-15, atol=1e-11)


@pytest.mark.parametrize("west", [0.0, -180.0, 185.0])
def test_points_are_found_on_a_grid_nearly_once_round_the_earth(west: float) -> None:
    """It does not close, so that a longitude must come to the one turn on which the grid lies."""
    lon, lat = np.meshgrid(west + np.arange(0.0, 351.0, 10.0), np.arange(-70.0, -49.0, 5.0))
    grid = Grid.from_corners(lon, lat, includes_southwest=True)
    x = np.concatenate([west + np.arange(1.0, 350.0, 7.0) + turn for turn in (-360.0, 0.0, 360.0)])
    e = located(grid, x, np.full(x.size, -61.0))
    np.testing.assert_allclose(e.xi, ((x - west) % 10.0) / 10.0, atol=1e-9)
