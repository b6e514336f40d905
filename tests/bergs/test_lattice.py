"""Packing of plane regions: counts and places known from geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg.bergs.lattice import (
    Region,
    cells_region,
    element_area,
    expand_rows,
    fill,
    lattice_points,
    rectangle_region,
)
from riftberg.errors import BergError


def test_square_rectangle_is_filled_completely():
    lattice = fill(rectangle_region(30e3, 12e3), 1500.0, "square")[0]
    assert len(lattice) == 10 * 4
    assert lattice.x.min() == -15e3 + 1500.0
    assert lattice.y.max() == 6e3 - 1500.0


def test_hexagonal_lattice_is_that_of_the_grounding_case():
    """Spec 10.4: columns of 12, 11, 12, 11, 12, 11 elements in 15 km by 35 km."""
    lattice = lattice_points((42500.0, 32500.0, 57500.0, 67500.0), 1500.0, "hexagonal")
    assert np.bincount(lattice.column).tolist() == [12, 11, 12, 11, 12, 11]
    assert lattice.x.min() == pytest.approx(42500 + 2 / math.sqrt(3) * 1500, abs=1e-9)
    assert lattice.x.max() == pytest.approx(57222.43, abs=0.01)


def test_hexagonal_lattice_is_that_of_the_collision_case():
    """Spec 10.2: eight elements on a 2 km square of ice whose corner is (4 km, 4 km) of the thickness grid."""
    radius = math.sqrt(3) / 2 * 0.45 * 1000
    everywhere = lattice_points((0.0, 0.0, 2e4, 2e4), radius, "hexagonal")
    i, j = everywhere.x // 1000, everywhere.y // 1000
    kept = everywhere.where((i >= 4) & (i <= 5) & (j >= 4) & (j <= 5))
    expected = [
        (4500, 4286.825748732971), (4500, 5066.248612138966), (4500, 5845.67147554496), (5175, 4676.537180435968),
        (5175, 5455.960043841963), (5850, 4286.825748732971), (5850, 5066.248612138966), (5850, 5845.67147554496),
    ]  # fmt: skip
    # The first x is one ulp below 4500 and falls into cell 4 either way.
    np.testing.assert_allclose(np.stack([kept.x, kept.y], axis=1), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("packing", "neighbours", "distance"), [("square", 4, 2.0), ("hexagonal", 6, 2.0)])
def test_interior_elements_have_all_neighbours_at_two_radii(packing, neighbours, distance):
    lattice, radius = fill(rectangle_region(20.0, 20.0), 1.0, packing, (0.0, 0.0))
    distance *= radius
    d = np.hypot(lattice.x[:, None] - lattice.x, lattice.y[:, None] - lattice.y)
    touching = (np.abs(d - distance) < 1e-9).sum(axis=1)
    assert touching.max() == neighbours
    assert d[d > 0].min() == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_elements_tile_the_plane(packing):
    """A disc holds as many elements as its area says, of a size near the one that was asked for."""
    disc = Region((-50.0, -50.0, 50.0, 50.0), math.pi * 2500, (0.0, 0.0), lambda x, y: x * x + y * y < 2500)
    lattice, radius = fill(disc, 0.5, packing)
    assert len(lattice) * element_area(radius, packing) == pytest.approx(disc.area, rel=1e-12)
    assert radius == pytest.approx(0.5, rel=1e-2)
    assert math.hypot(lattice.x.mean(), lattice.y.mean()) < 0.3


def test_best_offset_is_at_least_as_good_as_none():
    region = rectangle_region(31e3, 13.5e3)
    cell = element_area(1500.0, "square")
    plain, best = (fill(region, 1500.0, "square", offset)[0] for offset in ((0.0, 0.0), None))
    assert abs(len(best) * cell - region.area) <= abs(len(plain) * cell - region.area)


def test_elements_are_sorted_across_the_short_side_first():
    wide = fill(rectangle_region(30e3, 9e3), 1500.0, "square")[0]
    tall = fill(rectangle_region(9e3, 30e3), 1500.0, "square")[0]
    assert np.all(np.diff(wide.column) >= 0)
    assert np.all(np.diff(tall.row) >= 0)


def test_cells_give_themselves_back():
    column, row = expand_rows([(0, 1, 3), (1, 0, 0), (1, 2, 4)])
    region = cells_region(column, row, 3000.0)
    lattice = fill(region, 1500.0, "square")[0]
    assert region.centroid == pytest.approx((lattice.x.mean(), lattice.y.mean()), rel=1e-12)
    got = set(zip((lattice.x // 3000).tolist(), (lattice.y // 3000).tolist(), strict=True))
    assert got == set(zip(column.tolist(), row.tolist(), strict=True))


@pytest.mark.parametrize("rows", [[(0, 3, 1)], [(-1, 0, 1)], [(0, 0, 2), (0, 2, 3)]])
def test_impossible_rows_are_refused(rows):
    with pytest.raises(BergError, match="table of rows"):
        expand_rows(rows)


@pytest.mark.parametrize(
    ("size", "fault", "count"),
    [((2000.0, 1000.0), "smaller than one element", 4), ((100e3, 300.0), "too narrow for one element", 100)],
)
def test_a_region_that_holds_no_element_is_refused_with_a_radius_that_fits(size, fault, count):
    """30 km2 of ice in 300 m of width were "smaller than one element (9 km2)" too."""
    region = rectangle_region(*size)
    with pytest.raises(BergError, match=fault) as caught:
        fill(region, 1500.0, "square")
    fitting = float(caught.value.remedy.split("below ")[1].split(" m")[0])
    assert len(fill(region, fitting, "square")[0]) >= count


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_impossible_radius_is_refused(radius):
    with pytest.raises(BergError, match="radius"):
        fill(rectangle_region(1.0, 1.0), radius, "square")


@pytest.mark.quick(6)
@pytest.mark.parametrize("angle", [0.0, 15.0, 30.0, 45.0, -70.0])
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("shape", [(30e3, 15e3), (61e3, 31.7e3), (20e3, 9e3)])
def test_a_turned_lattice_has_the_area_of_its_outline(shape, packing, angle):
    """Lattices held 0.80 to 1.09 of the area of a 30 x 15 km berg, by packing, turn and size of the elements."""
    region = rectangle_region(*shape)
    lattice, radius = fill(region, 1500.0, packing, angle=angle)
    assert len(lattice) * element_area(radius, packing) == pytest.approx(region.area, rel=1e-12)
    assert radius == pytest.approx(1500.0, rel=0.1)
    assert np.hypot(lattice.x.mean(), lattice.y.mean()) < radius
    # Rows lie along the angle: the neighbours of an element lie at multiples of the angle between its sides from there.
    dx, dy = lattice.x[:, None] - lattice.x, lattice.y[:, None] - lattice.y
    near = np.abs(np.hypot(dx, dy) - 2.0 * radius) < 1e-6 * radius
    sector = 90.0 if packing == "square" else 60.0
    start = 90.0 + angle  # both packings have neighbours along the columns
    turn = (np.degrees(np.arctan2(dy[near], dx[near])) - start + 0.5 * sector) % sector - 0.5 * sector
    np.testing.assert_allclose(turn, 0.0, atol=1e-6)


def test_an_outline_that_fits_keeps_its_elements():
    lattice, radius = fill(rectangle_region(30e3, 15e3), 1500.0, "square")
    assert (len(lattice), radius) == (50, 1500.0)
