"""Packing of plane regions: counts and places known from geometry."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.bergs.lattice import lattice_points
from riftberg.errors import BergError
from riftberg.state import Floats


def block(length: float, width: float, **options: Any) -> Iceberg:
    """Return a rectangle of ice about the origin of a plane."""
    return Iceberg.rectangle(length, width, **{"thickness": 200.0, "latlon": False, "radius": 1500.0, **options})


def place(berg: Iceberg) -> tuple[Floats, Floats]:
    return berg.elements.lon, berg.elements.lat


def test_square_rectangle_is_filled_completely():
    x, y = place(block(30e3, 12e3))
    assert len(x) == 10 * 4
    assert x.min() == -15e3 + 1500.0
    assert y.max() == 6e3 - 1500.0


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


@pytest.mark.parametrize(("packing", "neighbours"), [("square", 4), ("hexagonal", 6)])
def test_interior_elements_have_all_neighbours_at_two_radii(packing, neighbours):
    berg = block(20.0, 20.0, radius=1.0, packing=packing, offset=(0.0, 0.0))
    x, y = place(berg)
    d = np.hypot(x[:, None] - x, y[:, None] - y)
    touching = (np.abs(d - 2.0 * berg.radius) < 1e-9).sum(axis=1)
    assert touching.max() == neighbours
    assert d[d > 0].min() == pytest.approx(2.0 * berg.radius, abs=1e-9)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_elements_tile_the_plane(packing):
    """A disc holds as many elements as its area says, of a size near the one that was asked for."""
    degree = math.radians(1.0) * 6_371_229.0
    turn = np.radians(np.arange(0.0, 360.0, 0.5))
    disc = np.column_stack([np.cos(turn) / math.cos(math.radians(56.0)), np.sin(turn)]) * 50e3 / degree + [-37.0, -56.0]
    berg = Iceberg.from_outline(disc, thickness=200.0, radius=500.0, packing=packing)
    assert berg.area == pytest.approx(berg.report["outline_area"], rel=1e-12)
    assert berg.area == pytest.approx(math.pi * 50e3**2, rel=0.01)
    assert berg.radius == pytest.approx(500.0, rel=3e-2)
    east, north = (berg.centroid[0] + 37.0) * math.cos(math.radians(56.0)), berg.centroid[1] + 56.0
    assert math.hypot(east, north) * degree < 300.0


def test_best_offset_is_at_least_as_good_as_none():
    """Before the lattice is stretched to the area, which both reach: by less the better."""
    plain, best = (block(31e3, 13.5e3, offset=offset) for offset in ((0.0, 0.0), None))
    assert plain.area == pytest.approx(best.area) == pytest.approx(31e3 * 13.5e3)
    assert abs(best.radius - 1500.0) <= abs(plain.radius - 1500.0)


def test_elements_are_sorted_across_the_short_side_first():
    wide, tall = block(30e3, 9e3), block(9e3, 30e3)
    assert np.all(np.diff(place(wide)[0]) >= 0.0)
    assert np.all(np.diff(place(tall)[1]) >= 0.0)


def test_cells_give_themselves_back():
    berg = Iceberg.from_table([(0, 1, 3), (1, 0, 0), (1, 2, 4)], thickness=200.0, placement=(0.0, 0.0), latlon=False)
    x, y = place(berg)
    cells = np.array([(1, 0), (2, 0), (3, 0), (0, 1), (2, 1), (3, 1), (4, 1)])
    assert berg.centroid == pytest.approx((0.0, 0.0), abs=1e-9)
    got = np.column_stack([x, y]) / 3000.0
    np.testing.assert_allclose(got[np.lexsort(got.round(6).T)], cells - cells.mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("rows", [[(0, 3, 1)], [(-1, 0, 1)], [(0, 0, 2), (0, 2, 3)]])
def test_impossible_rows_are_refused(rows):
    with pytest.raises(BergError, match=r"table of rows|rows"):
        Iceberg.from_table(rows, thickness=200.0, placement=(0.0, 0.0))


@pytest.mark.parametrize(
    ("size", "fault", "count"),
    [((2000.0, 1000.0), "smaller than one element", 4), ((100e3, 300.0), "too narrow for one element", 100)],
)
def test_a_region_that_holds_no_element_is_refused_with_a_radius_that_fits(size, fault, count):
    """30 km2 of ice in 300 m of width were "smaller than one element (9 km2)" too."""
    with pytest.raises(BergError, match=fault) as caught:
        block(*size)
    fitting = float(caught.value.remedy.split("below ")[1].split(" m")[0])
    assert block(*size, radius=fitting).elements.size >= count


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_impossible_radius_is_refused(radius):
    with pytest.raises(BergError, match="radius"):
        block(1.0, 1.0, radius=radius)


@pytest.mark.quick(6)
@pytest.mark.parametrize("angle", [0.0, 15.0, 30.0, 45.0, -70.0])
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("shape", [(30e3, 15e3), (61e3, 31.7e3), (20e3, 9e3)])
def test_a_turned_lattice_has_the_area_of_its_outline(shape, packing, angle):
    """Lattices held 0.80 to 1.09 of the area of a 30 x 15 km berg, by packing, turn and size of the elements."""
    berg = block(*shape, packing=packing, lattice_angle=angle)
    assert berg.area == pytest.approx(shape[0] * shape[1], rel=1e-12)
    assert berg.radius == pytest.approx(1500.0, rel=0.1)
    x, y = place(berg)
    assert np.hypot(x.mean(), y.mean()) < berg.radius
    # Rows lie along the angle: the neighbours of an element lie at multiples of the angle between its sides from there.
    dx, dy = x[:, None] - x, y[:, None] - y
    near = np.abs(np.hypot(dx, dy) - 2.0 * berg.radius) < 1e-6 * berg.radius
    sector = 90.0 if packing == "square" else 60.0
    start = 90.0 + angle  # both packings have neighbours along the columns
    turn = (np.degrees(np.arctan2(dy[near], dx[near])) - start + 0.5 * sector) % sector - 0.5 * sector
    np.testing.assert_allclose(turn, 0.0, atol=1e-6)


def test_an_outline_that_fits_keeps_its_elements():
    berg = block(30e3, 15e3)
    assert (berg.elements.size, berg.radius) == (50, 1500.0)
