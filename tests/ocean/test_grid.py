"""Corners, halo, metrics, land and fields of a grid (equations 2.1, 10.1, 10.5)."""

from __future__ import annotations

import numpy as np
import pytest

from ocean.grids import ALL, bent, degrees, square_lakes
from riftberg import FieldRules, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.errors import BergError, InputError
from riftberg.ocean.grid import haversine
from riftberg.state import new_elements
from twins.cells import great_circle

RADIUS = 6_363_827.0


def placed(*points):
    """Elements at the given points."""
    e = new_elements(len(points))
    e.lon[:], e.lat[:] = np.transpose(points)
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    return e


def test_cartesian_corners_are_those_of_the_test_cases():
    """Corner (i, j) stands at (G i, G j), counted from 1, and so on in the halo (equations 10.1); dx = dy = G exactly."""
    a = Grid.cartesian(20, 15, 1000.0, period=20_000.0).arrays
    i, j = np.arange(1 - 4, 20 + 4 + 1), np.arange(1 - 4, 15 + 4 + 1)
    np.testing.assert_array_equal(a.lon, np.broadcast_to(1000.0 * i, a.lon.shape))
    np.testing.assert_array_equal(a.lat, np.broadcast_to(1000.0 * j[:, None], a.lat.shape))
    assert np.all(a.dx == 1000.0)
    assert np.all(a.dy == 1000.0)
    assert np.all(a.area == 1e6)
    np.testing.assert_array_equal(a.lon_centre[4, 4:8], (500.0, 1500.0, 2500.0, 3500.0))
    assert (a.ni, a.nj, a.halo, a.cyclic, a.period) == (20, 15, 4, True, 20_000.0)


def test_offset_moves_all_corners():
    """The grounding test shifts corners by -0.45 m in x and y and leaves lengths alone (equations 10.4)."""
    a = Grid.cartesian(45, 45, 5000.0, period=225_000.0, offset=-0.45).arrays
    np.testing.assert_array_equal(a.lon[0, 4:49], 5000.0 * np.arange(1, 46) - 0.45)
    np.testing.assert_allclose(a.lat[:4, 0], 5000.0 * np.arange(-3, 1) - 0.45, atol=1e-9)
    assert np.all(a.dx == 5000.0)
    assert a.cyclic


def test_cyclic_halo_holds_copies_shifted_by_the_period():
    """Corners and land in the western and eastern halo repeat the other end; rows beyond the ends are land."""
    rng = np.random.default_rng(1)
    a = square_lakes(rng).arrays
    np.testing.assert_allclose(a.lon[:, :4], a.lon[:, 11:15] - 11_000.0)
    np.testing.assert_allclose(a.lon[:, 15:], a.lon[:, 4:8] + 11_000.0)
    np.testing.assert_array_equal(a.mask[:, :4], a.mask[:, 11:15])
    np.testing.assert_array_equal(a.mask[:, 15:], a.mask[:, 4:8])
    assert np.all(a.mask[:4] == 0.0)
    assert np.all(a.mask[-4:] == 0.0)


def test_a_halo_wider_than_the_grid_wraps_several_times():
    """Three cells and a halo of four: copies of copies, still evenly spaced."""
    a = Grid.cartesian(3, 5, 10.0, period=30.0).arrays
    np.testing.assert_allclose(np.diff(a.lon, axis=1), 10.0)


def test_closed_halo_is_extrapolated_linearly():
    """Uneven spacing goes on with the outermost spacing; the south keeps the longitudes of its northern row."""
    x, y = np.meshgrid([0.0, 1.0, 3.0, 6.0], [0.0, 2.0, 3.0])
    x += 0.1 * y
    a = Grid.from_corners(x, y, latlon=False, regular=False, period=0.0).arrays
    np.testing.assert_allclose(a.lon[5, :4], 0.2 - np.arange(4.0, 0.0, -1.0))
    np.testing.assert_allclose(a.lon[5, 8:], 6.2 + 3.0 * np.arange(1.0, 5.0))
    np.testing.assert_allclose(a.lat[:4, 5], -2.0 * np.arange(4.0, 0.0, -1.0))
    np.testing.assert_allclose(a.lat[7:, 5], 3.0 + np.arange(1.0, 5.0))
    for row in range(4):
        np.testing.assert_array_equal(a.lon[row], a.lon[4])
    assert not a.cyclic


def test_a_regional_grid_has_a_period_without_being_cyclic():
    """The A68a grid knows that longitudes repeat after 360 degrees, but its ends are closed (equations 10.5)."""
    a = degrees(np.random.default_rng(0)).arrays
    assert a.period == 360.0
    assert not a.cyclic
    assert np.all(a.mask[:, :4] == 0.0)


def test_a_global_grid_is_cyclic():
    """360 one-degree columns close."""
    lon, lat = np.meshgrid(np.arange(0.5, 360.0), np.arange(-79.0, -59.0))
    assert Grid.from_corners(lon, lat).arrays.cyclic
    assert not Grid.from_corners(lon, lat, cyclic=False).arrays.cyclic


def test_southwest_corners_can_be_given():
    """With the outermost lines given, cells are those between the corners and nothing is extrapolated there."""
    x, y = np.meshgrid([0.0, 1.0, 3.0], [0.0, 5.0, 6.0, 7.0])
    a = Grid.from_corners(x, y, latlon=False, period=0.0, includes_southwest=True).arrays
    assert (a.ni, a.nj) == (2, 3)
    np.testing.assert_array_equal(a.lon[3:7, 3:6], x)
    np.testing.assert_array_equal(a.lat[3:7, 3:6], y)


def test_lengths_follow_the_haversine_of_the_a68_run():
    """North edge dx, east edge dy of eighth-degree cells are great-circle distances with the given radius."""
    a = degrees(np.random.default_rng(0)).arrays
    for j, i in ((4, 4), (8, 9), (13, 15)):
        west, here = (a.lon[j, i - 1], a.lat[j, i - 1]), (a.lon[j, i], a.lat[j, i])
        south = (a.lon[j - 1, i], a.lat[j - 1, i])
        assert a.dx[j, i] == pytest.approx(great_circle(*west, *here, RADIUS), rel=1e-9)
        assert a.dy[j, i] == pytest.approx(great_circle(*south, *here, RADIUS), rel=1e-9)


def test_haversine_of_a_quarter_meridian_and_of_antipodes():
    """Pole to equator is a quarter, antipodes are half of a great circle."""
    assert float(haversine(10.0, 0.0, 99.0, 90.0, 1.0)) == pytest.approx(np.pi / 2)
    assert float(haversine(0.0, 0.0, 180.0, 0.0, 1.0)) == pytest.approx(np.pi)


def test_areas_of_regular_cells_are_exact():
    """Area = (pi/180) R2 |sin lat_n - sin lat_s| dlon, as in the A68 driver; all cells of the globe give 4 pi R2."""
    a = degrees(np.random.default_rng(0)).arrays
    sines = np.sin(np.radians(a.lat))
    exact = np.pi / 180.0 * RADIUS**2 * np.abs(sines[1:, 1:] - sines[:-1, 1:]) * 0.125
    np.testing.assert_allclose(a.area[1:, 1:], exact, rtol=1e-11)
    lon, lat = np.meshgrid(np.linspace(-180, 180, 19), np.linspace(-90, 90, 10))
    globe = Grid.from_corners(lon, lat, includes_southwest=True, radius_for_metrics=1.0)
    assert globe.arrays.area[globe.domain].sum() == pytest.approx(4.0 * np.pi)


def test_areas_of_bent_cells_fill_the_domain():
    """In the plane the areas of the quadrilaterals add up to the area of their outline (shoelace)."""
    a = bent(np.random.default_rng(3)).arrays
    x, y = a.lon[3:13, 3:14], a.lat[3:13, 3:14]
    sides = (np.s_[0, :-1], np.s_[:-1, -1], np.s_[-1, :0:-1], np.s_[:0:-1, 0])
    px, py = (np.concatenate([q[side] for side in sides]) for q in (x, y))
    outline = 0.5 * abs(np.sum(px * np.roll(py, -1) - py * np.roll(px, -1)))
    assert a.area[4:13, 4:14].sum() == pytest.approx(outline, rel=1e-12)


@pytest.mark.parametrize("make", ALL)
def test_locating_finds_cells_and_coordinates(make):
    """Every located element is where bilinear interpolation of the corners at (xi, eta) says."""
    grid = make(np.random.default_rng(4), land=0.0)
    a = grid.arrays
    rng = np.random.default_rng(5)
    i, j, x, y = rng.integers(4, 4 + a.ni, 50), rng.integers(4, 4 + a.nj, 50), rng.random(50), rng.random(50)

    def blend(q):
        return (q[j, i] * x + q[j, i - 1] * (1 - x)) * y + (q[j - 1, i] * x + q[j - 1, i - 1] * (1 - x)) * (1 - y)

    e = placed(*zip(blend(a.lon), blend(a.lat), strict=True))
    grid.locate(e)
    np.testing.assert_array_equal(e.cell_i, i)
    np.testing.assert_array_equal(e.cell_j, j)
    np.testing.assert_allclose(e.xi, x, atol=1e-9)
    np.testing.assert_allclose(e.eta, y, atol=1e-9)


def test_locating_brings_longitudes_to_those_of_the_grid():
    """A berg at 37 W on a grid that counts to 360: longitudes and pair longitudes move by one turn."""
    grid = degrees(np.random.default_rng(0), land=0.0)
    e = placed((-37.3, -55.5), (322.7, -55.5))
    e.lon_pair[0] = -37.31
    grid.locate(e)
    np.testing.assert_allclose(e.lon, 322.7)
    np.testing.assert_allclose(e.lon_pair, (322.69, 322.7))
    assert e.cell_i[0] == e.cell_i[1]


def test_an_element_outside_is_refused_with_its_place():
    """The message names element, position and what the grid covers."""
    with pytest.raises(BergError, match=r"element 2 at x -5 m, y 30 m lies outside the grid.*covers x 0 to 80 m"):
        Grid.cartesian(8, 8, 10.0).locate(placed((5.0, 5.0), (-5.0, 30.0)))


def test_an_element_on_land_is_refused():
    """The message says that it lies on land."""
    mask = np.ones((8, 8))
    mask[2, 1] = 0.0
    with pytest.raises(BergError, match=r"element 1 at x 15 m, y 25 m lies on land"):
        Grid.cartesian(8, 8, 10.0, mask=mask).locate(placed((15.0, 25.0)))


def test_fields_stand_still_beyond_closed_ends_except_wind_and_sea_level():
    """Wind is 0 on the outermost west and south corner line, currents go on."""
    a = Grid.cartesian(6, 6, 10.0)
    fields = a.fields(uo=0.2, ua=5.0, ssh=0.4, depth=300.0)
    assert fields.uo[3, 6] == 0.2
    assert fields.ua[3, 6] == fields.ua[6, 3] == 0.0
    assert fields.ua[4, 4] == 5.0
    assert fields.ssh[3, 6] == 0.0
    assert fields.depth[3, 6] == 300.0
    assert np.all(fields.sss == -1.0)
    assert np.all(fields.sst == 0.0)


def test_wind_wraps_in_cyclic_grids():
    """In a cyclic grid the westernmost corner line is the easternmost one, so the wind blows there."""
    fields = Grid.cartesian(6, 6, 10.0, period=60.0).fields(ua=5.0)
    assert np.all(fields.ua[4:10] == 5.0)
    assert np.all(fields.ua[3] == 0.0)


@pytest.mark.parametrize("shape", [(6, 7), (7, 8), (8, 9), (14, 15)])
def test_values_may_come_with_ring_or_halo(shape):
    """Given values always stand where they belong: the domain is the same whatever surrounds it."""
    grid = Grid.cartesian(7, 6, 10.0)
    full = np.random.default_rng(6).normal(size=(14, 15))
    lines = {(6, 7): np.s_[4:10, 4:11], (7, 8): np.s_[3:10, 3:11], (8, 9): np.s_[3:11, 3:12], (14, 15): np.s_[:, :]}
    placed_values = grid.extended(full[lines[shape]])
    np.testing.assert_array_equal(placed_values[lines[shape]], full[lines[shape]])


def test_a_ring_of_the_mask_is_kept():
    """The first ring of land and sea is the caller's, further rings are land (equations 2.1)."""
    a = Grid.cartesian(4, 4, 10.0, mask=np.ones((6, 6))).arrays
    assert np.all(a.mask[3:9, 3:9] == 1.0)
    assert a.mask.sum() == 36.0


def test_fields_are_as_the_kernels_need_them():
    """All twelve fields: full shape, float64, contiguous, writeable, none sharing memory with the input."""
    grid = Grid.cartesian(6, 6, 10.0)
    given = np.ones((6, 6))
    fields = grid.fields(uo=given)
    assert len(fields) == 12
    for q in fields:
        assert q.shape == grid.arrays.lon.shape
        assert q.dtype == np.float64
        assert q.flags.c_contiguous
        assert q.flags.writeable
    assert not np.shares_memory(fields.uo, given)


@pytest.mark.parametrize(
    ("action", "text"),
    [
        (lambda g: g.fields(wind=3.0), "unknown field 'wind'.*Fields are uo"),
        (lambda g: g.extended(np.ones((5, 5))), r"array of shape \(5, 5\) does not fit a grid of 6 x 6 cells"),
        (lambda g: g.extended(1.0, outside="mirror"), "outside = 'mirror'"),
        (lambda g: Grid.from_corners([[0.0, 1.0]], [[0.0, 1.0]]), "corner arrays of shapes"),
        (lambda g: Grid.from_corners(np.full((3, 3), np.nan), np.ones((3, 3))), "not all finite"),
        (lambda g: Grid.cartesian(5, 5, 1.0, halo=1), "halo = 1"),
    ],
)
def test_impossible_input_is_refused(action, text):
    """Wrong names, shapes and numbers are named in the message."""
    with pytest.raises(InputError, match=text):
        action(Grid.cartesian(6, 6, 10.0))


def test_description_says_what_the_grid_is():
    """Size, kind, extent and land in plain words."""
    text = degrees(np.random.default_rng(0), land=0.0).describe()
    assert "12 x 10 cells, general, longitude and latitude, closed" in text
    assert "from 56.125 S to 54.875 S, 38.125 W to 36.625 W" in text
    assert "0.0 % land" in text
    assert "cyclic, period 11000 m" in square_lakes(np.random.default_rng(0)).describe()


AXES = np.meshgrid(np.linspace(-40.0, -30.0, 11), np.linspace(-60.0, -55.0, 6))


@pytest.mark.parametrize(
    ("lon", "lat"),
    [
        (AXES[0], AXES[1][::-1]),
        (AXES[0][:, ::-1], AXES[1]),
        (AXES[0].T, AXES[1].T),
        (AXES[0], AXES[1][np.random.default_rng(3).permutation(6)]),
    ],
    ids=["southward", "westward", "transposed", "shuffled"],
)
@pytest.mark.parametrize("latlon", [True, False])
def test_cells_that_lie_inside_out_are_refused(lon: np.ndarray, lat: np.ndarray, latlon: bool) -> None:
    """They gave a run that was wrong in silence: the area of a cell has no sign."""
    with pytest.raises(InputError, match=r"cells lie inside out, the first in row \d+, column \d+ at -"):
        Grid.from_corners(lon, lat, latlon=latlon, period=0.0)


def test_grids_of_the_whole_earth_keep_their_orientation() -> None:
    """Periodic, across the date line, to the pole, around it, and with the rows of a fold twice."""
    lon, lat = np.meshgrid(np.linspace(0.0, 357.5, 144), np.linspace(-90.0, 90.0, 73))
    Grid.from_corners(lon, lat)
    Grid.from_corners((lon + 250.0) % 360.0, lat)
    Grid.from_corners(*np.meshgrid(np.linspace(170.0, 190.0, 21), np.linspace(-80.0, -60.0, 21)))
    x, y = np.meshgrid(np.linspace(-1e6, 1e6, 40), np.linspace(-1e6, 1e6, 40))  # over the north pole
    around = np.degrees(np.arctan2(x, -y)), 90.0 - np.degrees(np.hypot(x, y) / 6.4e6)
    Grid.from_corners(*around, regular=False, cyclic=False)
    folded = np.concatenate([lat, lat[-2:-4:-1]]), np.concatenate([lon, lon[-2:-4:-1, ::-1]])
    Grid.from_corners(folded[1], folded[0], regular=False)


def test_a_grid_that_repeats_needs_the_period_of_the_run() -> None:
    """Positions went round and bonds did not: a bond over the seam was 37 km long."""
    grid = Grid.cartesian(40, 40, 1000.0, period=40e3)
    berg = Iceberg.rectangle(9e3, 3e3, thickness=200.0, latlon=False, placement=(38e3, 20e3))
    forcing = GriddedForcing(grid, [grid.fields(depth=1000.0)] * 2, np.array([0.0, 1e6]), FieldRules())
    with pytest.raises(InputError, match=r"repeats after 40000, and earth.period is 0"):
        Model(berg, forcing, Parameters(earth={"latlon": False, "reference_latitude": -60.0}))
