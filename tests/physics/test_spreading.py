"""Shares of footprints on ocean cells against twins of shapely: conservation, turns, land, the periodic line, the pole."""

from __future__ import annotations

import numpy as np
import pytest

from physics.agreement import SEEDS, assert_same
from riftberg import Grid
from riftberg.physics import spreading
from riftberg.state import new_elements
from twins import spreading as twin

SHAPES = {"rectangle": spreading.RECTANGLE, "hexagon": spreading.HEXAGON}


def scratch() -> np.ndarray:
    return np.zeros((8, 16))


def bent_grid(seed: int, ni: int = 12, nj: int = 10, spacing: float = 1000.0) -> Grid:
    """Cartesian grid of quadrilaterals, every corner moved by up to a quarter of a cell."""
    r = np.random.default_rng(seed)
    x, y = np.meshgrid(spacing * np.arange(ni + 1), spacing * np.arange(nj + 1))
    x, y = x + r.uniform(-0.25, 0.25, x.shape) * spacing, y + r.uniform(-0.25, 0.25, y.shape) * spacing
    return Grid.from_corners(x, y, latlon=False, regular=False, period=0.0, includes_southwest=True)


def covered(grid: Grid, lon, lat, shape, length, width, angle):
    """Field of shares of one footprint."""
    g = grid.arrays
    e = new_elements(1)
    e.lon[:], e.lat[:] = lon, lat
    grid.locate(e)
    one = np.ones(1)
    bergs = spreading.ElementShapes(e.lon, e.lat, e.cell_i, e.cell_j, shape, length * one, width * one, angle * one)
    on = spreading.Cells(g.lon, g.lat, g.mask, g.ni, g.nj, g.halo, g.latlon, g.cyclic, grid.earth_radius, g.period)
    room = 64
    while True:
        first, cells, part = np.zeros(2, np.int64), np.zeros(room, np.int64), np.zeros(room)
        count = spreading.cover_all(bergs, on, first, cells, part)
        if count <= room:
            break
        room = count
    out = np.zeros(g.lon.size)
    spreading.add_shares(first, cells, part, one, out)
    return out.reshape(g.lon.shape)[grid.domain]


def cell_polygons(grid: Grid):
    g = grid.arrays
    rows, columns = grid.domain
    return [
        np.array([[g.lon[b, a], g.lat[b, a]] for b, a in ((j - 1, i - 1), (j - 1, i), (j, i), (j, i - 1))])
        for j in range(rows.start, rows.stop)
        for i in range(columns.start, columns.stop)
    ]


@pytest.mark.parametrize("shape", SHAPES)
def test_shares_on_any_quadrilaterals_equal_twin(shape: str) -> None:
    for seed in range(40):
        r = np.random.default_rng(seed)
        grid = bent_grid(seed % 5)
        grid.arrays.mask[grid.domain] = r.uniform(size=(10, 12)) > 0.2
        centre = r.uniform(3500, 6500, 2)
        length, width, angle = *10 ** r.uniform(2, 3.7, 2), r.uniform(-np.pi, np.pi)
        probe = new_elements(1)
        probe.lon[:], probe.lat[:] = centre
        dry = grid.arrays.mask.copy()
        grid.arrays.mask[:] = 1.0
        grid.locate(probe)
        dry[probe.cell_j, probe.cell_i] = 1.0
        grid.arrays.mask[:] = dry
        got = covered(grid, *centre, SHAPES[shape], length, width, angle)
        wet = grid.arrays.mask[grid.domain].ravel() > 0.5
        want = twin.shares(centre, twin.corners(shape, length, width, angle), cell_polygons(grid), wet)
        assert_same(got.ravel(), want)
        assert abs(got.sum() - 1.0) < 4e-16


def test_a_point_and_a_small_berg_stay_in_their_cell() -> None:
    grid = bent_grid(1)
    for shape, side in ((spreading.POINT, 1e5), (spreading.HEXAGON, 1.0), (spreading.RECTANGLE, 1.0)):
        got = covered(grid, 5000.0, 5010.0, shape, side, side, 0.3)
        assert sorted(got[got != 0.0]) == [1.0]


@pytest.mark.parametrize(("shape", "folds"), [("hexagon", 6), ("rectangle", 2)])
def test_shares_do_not_change_by_a_turn_into_itself(shape: str, folds: int) -> None:
    grid = bent_grid(2)
    for angle in (0.0, 0.3, -1.1):
        before = covered(grid, 5230.0, 4870.0, SHAPES[shape], 2000.0, 1300.0, angle)
        after = covered(grid, 5230.0, 4870.0, SHAPES[shape], 2000.0, 1300.0, angle + 2 * np.pi / folds)
        np.testing.assert_allclose(after, before, atol=1e-13)


def test_a_turn_of_the_hexagon_by_thirty_degrees_changes_shares() -> None:
    grid = bent_grid(2)
    before = covered(grid, 5230.0, 4870.0, spreading.HEXAGON, 2000.0, 2000.0, 0.0)
    after = covered(grid, 5230.0, 4870.0, spreading.HEXAGON, 2000.0, 2000.0, np.pi / 6)
    assert np.abs(after - before).max() > 1e-3


def test_shares_scale_with_metres() -> None:
    """The same picture in metres and in a unit a thousand times as large."""
    small, large = bent_grid(3), bent_grid(3, spacing=1e6)
    a = covered(small, 5230.0, 4870.0, spreading.HEXAGON, 2000.0, 1300.0, 0.4)
    b = covered(large, 5230e3, 4870e3, spreading.HEXAGON, 2000e3, 1300e3, 0.4)
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)


def test_a_berg_across_the_periodic_line_is_whole() -> None:
    lon, lat = np.meshgrid(np.arange(0.0, 361.0, 5.0), np.arange(-70.0, -59.0, 1.0))
    grid = Grid.from_corners(lon[:, 1:][1:], lat[:, 1:][1:], latlon=True, period=360.0)
    far = covered(grid, 180.0, -65.2, spreading.RECTANGLE, 3e5, 1e5, 0.4)
    for there in (0.0, 360.0, -360.0):
        got = covered(grid, there, -65.2, spreading.RECTANGLE, 3e5, 1e5, 0.4)
        assert abs(got.sum() - 1.0) < 4e-16
        np.testing.assert_allclose(np.roll(got, 36, axis=1), far, atol=1e-12)
    assert (got[:, 0] > 0).any()
    assert (got[:, -1] > 0).any()


def test_mass_bound_for_land_and_beyond_closed_ends_goes_to_wet_cells() -> None:
    x, y = np.meshgrid(1000.0 * np.arange(5), 1000.0 * np.arange(5))
    mask = np.ones((4, 4))
    mask[1, 2] = 0.0
    grid = Grid.from_corners(x, y, latlon=False, period=0.0, includes_southwest=True, mask=mask)
    got = covered(grid, 1990.0, 1500.0, spreading.RECTANGLE, 1000.0, 500.0, 0.0)
    assert got[1, 1] == 1.0  # half of it was for the land
    got = covered(grid, 10.0, 10.0, spreading.RECTANGLE, 4000.0, 4000.0, 0.0)
    assert abs(got.sum() - 1.0) < 4e-16
    assert got[1, 2] == 0.0


def test_a_berg_at_the_pole_keeps_its_shares() -> None:
    """At the pole meridians are no parallels: every image is finite, and all is given to cells."""
    lon, lat = np.meshgrid(np.arange(10.0, 361.0, 10.0), np.arange(86.5, 90.1, 0.5))
    grid = Grid.from_corners(lon[1:], lat[1:], latlon=True, period=360.0)
    got = covered(grid, 40.0, 89.4, spreading.HEXAGON, 8e4, 8e4, 0.0)
    assert abs(got.sum() - 1.0) < 4e-16
    turned = covered(grid, 130.0, 89.4, spreading.HEXAGON, 8e4, 8e4, 0.0)
    np.testing.assert_allclose(np.roll(got, 9, axis=1), turned, atol=1e-12)


@pytest.mark.parametrize("latlon", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_small_bergs_beside_each_edge_of_a_straight_cell_equal_twin(shape: str, latlon: bool) -> None:
    """Cells along meridians and parallels have a short cut, which may not take a berg for one that lies within."""
    turn = 180.0 / np.pi / 6.371e6 if latlon else 1.0
    corner = np.arange(0.0, 5001.0, 1000.0)
    x, y = np.meshgrid(corner * turn, corner * turn)
    grid = Grid.from_corners(
        x, y, latlon=latlon, regular=True, period=0.0, includes_southwest=True, radius_for_metrics=6.371e6
    )
    plane = [1000.0 * np.array([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]) for j in range(5) for i in range(5)]
    for east, north in [(0.5, 0.5), (0.05, 0.5), (0.95, 0.5), (0.5, 0.05), (0.5, 0.95), (0.05, 0.95), (0.95, 0.05)]:
        centre = 1000.0 * np.array([2.0 + east, 2.0 + north])
        got = covered(grid, *(centre * turn), SHAPES[shape], 200.0, 150.0, 0.3)
        want = twin.shares(centre, twin.corners(shape, 200.0, 150.0, 0.3), plane, np.ones(25, bool))
        np.testing.assert_allclose(got.ravel(), want, atol=1e-6)  # near the equator a degree is as long either way
        assert (got > 1e-9).sum() == (1 if east == north else 4 if 0.5 not in (east, north) else 2)


def seen_from_above(points: np.ndarray, at: tuple[float, float]) -> np.ndarray:
    """Metres east and north of a place (degrees), as seen from far above it."""
    east, north = np.radians(points).T
    from_centre = 6.371e6 * np.stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])
    a, b = np.radians(at)
    to_east, to_north = [-np.sin(a), np.cos(a), 0.0], [-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)]
    return np.stack([to_east @ from_centre, to_north @ from_centre], axis=-1)


def shares_seen_from_above(grid: Grid, at: tuple[float, float], shape: str, *sides: float) -> np.ndarray:
    cells = [seen_from_above(corners, at) for corners in cell_polygons(grid)]
    return twin.shares((0.0, 0.0), twin.corners(shape, *sides), cells, np.ones(len(cells), bool))


@pytest.mark.parametrize("hemisphere", [1.0, -1.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_shares_beside_a_pole_equal_twin(shape: str, hemisphere: float) -> None:
    """A mesh that is square on the plane of the pole; the axis of a berg counts from the east at its centre."""
    radius, spacing = 6.371e6, 20e3
    corner = spacing * (np.arange(9) - 4.0) + 3e3
    x, y = np.meshgrid(corner, corner if hemisphere > 0.0 else corner[::-1])
    lon, lat = np.degrees(np.arctan2(y, x)), hemisphere * (90.0 - np.degrees(np.hypot(x, y) / radius))
    grid = Grid.from_corners(
        lon, lat, latlon=True, regular=False, cyclic=False, includes_southwest=True, radius_for_metrics=radius
    )
    for seed in range(12):
        r = np.random.default_rng(seed)
        centre = r.uniform(12e3, 45e3, 2) * r.choice([-1.0, 1.0], 2)
        at = np.degrees(np.arctan2(centre[1], centre[0])), hemisphere * (90.0 - np.degrees(np.hypot(*centre) / radius))
        sides = 40e3, 9e3, r.uniform(-np.pi, np.pi)
        got = covered(grid, *at, SHAPES[shape], *sides)
        np.testing.assert_allclose(got.ravel(), shares_seen_from_above(grid, at, shape, *sides), atol=1e-9)


@pytest.mark.parametrize("latitude", [-81.0, 85.0, -88.0, 88.8])
def test_shares_of_cells_of_a_quarter_degree_near_the_poles_equal_twin(latitude: float) -> None:
    """Straight meridians would give shares that are 1e-3 to 1e-2 off here."""
    lon, lat = np.meshgrid(np.arange(0.0, 60.1, 1.0), latitude + 0.25 * np.arange(-4.4, 4.5))
    grid = Grid.from_corners(
        lon, lat, latlon=True, period=360.0, cyclic=False, includes_southwest=True, radius_for_metrics=6.371e6
    )
    at, sides = (30.3, latitude + 0.04), (30e3, 30e3, 0.4)
    got = covered(grid, *at, spreading.RECTANGLE, *sides)
    np.testing.assert_allclose(got.ravel(), shares_seen_from_above(grid, at, "rectangle", *sides), atol=1e-9)


def test_reference_rectangle_equals_twin() -> None:
    w = np.zeros(9)
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        x, y, reach = *r.uniform(0, 1, 2), (1.0 if seed % 3 == 0 else r.uniform(0.01, 1))
        mask = (r.uniform(size=(3, 3)) > 0.3).astype(float)
        spreading.rectangle_shares(x, y, reach, mask, 1, 1, w)
        assert_same(w.reshape(3, 3), twin.rectangle_shares(x, y, reach, mask))


def test_reference_hexagon_equals_twin() -> None:
    w = np.zeros(9)
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        x, y, apothem, degrees = *r.uniform(0, 1, 2), r.uniform(0.01, 0.43), r.uniform(-180, 180)
        got = spreading.quadrant_areas(apothem, x - 0.5, y - 0.5, degrees, scratch())
        assert_same(got, twin.quadrants(apothem, x - 0.5, y - 0.5, degrees))
        assert_same(sum(got[:4]), got[4])
        spreading.hexagon_shares(x, y, apothem, degrees, w, scratch())
        assert_same(w.reshape(3, 3), twin.hexagon_shares(x, y, apothem, degrees))
        spreading.hexagon_shares(x, y, apothem, degrees + 60.0, w, scratch())
        assert_same(w.reshape(3, 3), twin.hexagon_shares(x, y, apothem, degrees))


def test_wet_part_has_the_power_of_quirk_t19() -> None:
    w = np.full(9, 0.1)
    w[4] = 0.2
    mask = np.ones((3, 3))
    assert spreading.wet_part(w, mask, 1, 1) == pytest.approx(1.0)
    mask[1, 1] = 0.0
    assert spreading.wet_part(w, mask, 1, 1) == pytest.approx(1.8)
    mask[0, 0] = 0.0
    assert spreading.wet_part(w, mask, 1, 1) == pytest.approx(1.7)


@pytest.mark.parametrize("folds", [4, 6])
def test_axis_of_a_lattice_is_found_from_any_of_its_bonds(folds: int) -> None:
    for turn in (0.0, 0.2, -0.25, np.pi / folds - 1e-9):
        ways = turn + 2 * np.pi / folds * np.array([0, 1, folds - 1])
        first, second = np.zeros(4, np.int64), np.array([1, 2, 3, 4])
        status = np.array([0, 0, 0, 1])
        dx, dy = np.append(np.cos(ways), 1.0), np.append(np.sin(ways), 0.3)
        angle = np.empty(5)
        spreading.lattice_angle(first, second, status, dx, dy, folds, np.zeros((2, 5)), np.full(5, 0.7), angle)
        off = (angle[:4] - turn) * folds
        np.testing.assert_allclose(np.cos(off), 1.0, atol=1e-12)
        assert angle[4] == 0.7  # its only bond is broken
