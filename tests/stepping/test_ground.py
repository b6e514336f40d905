"""Keels on the floor: cutting by its cells, gouges, and the balance of water, bed and bending ice."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from riftberg.config.parameter_groups import Grounding
from riftberg.constants import GRAVITY, RHO_SEAWATER
from riftberg.physics.seabed import bending_length
from riftberg.stepping.ground.balance import Bed, Bending, column_stiffness, hull_of, press, share_of_ice
from riftberg.stepping.ground.floor import Floor, Patches
from riftberg.stepping.ground.landing import _impulse_of, bed_of, bent_bonds, depth_of_bed
from riftberg.stepping.lattice.footprints import BodyFootprint

RADIUS = 6_371_229.0
SIDE = 1100.0
DRAFT = np.array([207.0, 211.0])


def footprint(turn: float = 0.4) -> BodyFootprint:
    """Two square elements side by side, turned."""
    c, s = math.cos(turn), math.sin(turn)
    ring = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    corner = np.vstack([ring, ring + np.array([1.0, 0.0])]) * SIDE @ np.array([[c, s], [-s, c]])
    return BodyFootprint(np.arange(2), np.arange(2), np.array([0, 4, 8]), corner)


def sloping(east: float, north: float, twist: float, scale: tuple[float, float] = (1.0, 1.0)) -> Any:
    """A floor about 205 m deep; ``scale``: metres per unit of the coordinates."""

    def depth(lon: Any, lat: Any) -> Any:
        x, y = lon * scale[0], lat * scale[1]
        return 205.0 + east * x + north * y + twist * x * y

    return depth


@pytest.mark.parametrize("latitude", [None, 0.01, -55.0, 72.0])
@pytest.mark.parametrize(("east", "north", "twist"), [(0.002, -0.003, 0.0), (0.0, 0.003, 2e-7)])
def test_keels_are_cut_by_the_cells_without_a_gap_and_lie_over_the_depth_there(
    latitude: float | None, east: float, north: float, twist: float
) -> None:
    """A floor of one plane counts block by block, a twisted one cell by cell; on the sphere rows of cells end anywhere."""
    body, latlon = footprint(), latitude is not None
    metre = math.radians(1.0) * RADIUS if latlon else 1.0
    along = metre * math.cos(math.radians(latitude)) if latitude is not None else 1.0
    lon0, lat0 = (-37.3, latitude) if latitude is not None else (150.0, -40.0)
    plane = sloping(east, north, twist, (along, metre))

    def depth(lon: Any, lat: Any) -> Any:
        return plane((lon - lon0 + 180.0) % 360.0 - 180.0 if latlon else lon - lon0, lat - lat0)

    floor = Floor(100.0, depth, latlon, RADIUS)
    lon, lat = lon0 + body.corner[:, 0] / along, lat0 + body.corner[:, 1] / metre
    cut = floor.patches(body, lon, lat, DRAFT, np.ones(2, bool), 0.5)
    assert (cut.cell[:, 1] < 0).all() == (twist == 0.0)
    area = np.zeros(2)
    for k, (a, b) in enumerate(pairwise(cut.start.tolist())):
        ring = shapely.Polygon(cut.corner[a:b, :2])
        area[cut.owner[k]] += ring.area
        west, south, east_end, north_end = ring.bounds
        longest = 100.0 if cut.cell[k, 1] >= 0 else 800.0
        assert max(east_end - west, north_end - south) < 1.06 * longest
        x, y = cut.corner[a:b, 0], cut.corner[a:b, 1]
        expected = DRAFT[cut.owner[k]] - 0.5 - plane(x / along, y / metre)
        # A twisted cell is the plane that fits it.
        np.testing.assert_allclose(cut.corner[a:b, 2], expected, atol=1e-6 + 1e4 * twist)
        mean_x, mean_y = x.mean(), y.mean()
        slope = (east + twist * mean_y, north + twist * mean_x)
        np.testing.assert_allclose(cut.gradient[k], slope, atol=2e-5 + 100.0 * twist)
    np.testing.assert_allclose(area, SIDE**2, rtol=1e-9)


@pytest.mark.timeout(120)  # the missed blocks were asked for without end
@pytest.mark.parametrize("lat0", [-60.0, 70.0])
def test_a_keel_across_greenwich_over_an_uneven_floor_is_cut_as_elsewhere(lat0: float) -> None:
    """Bug: north of the equator cells moved the search for the next block, and blocks numbered anew at Greenwich were missed."""
    body, metre = footprint(0.4), math.radians(1.0) * RADIUS
    metre_east = metre * math.cos(math.radians(lat0))

    def area_at(lon0: float) -> float:
        def depth(lon: Any, lat: Any) -> Any:
            return 205.0 + 1e-6 * (metre_east * ((lon - lon0 + 180.0) % 360.0 - 180.0)) ** 2

        lon, lat = (lon0 + body.corner[:, 0] / metre_east + 180.0) % 360.0 - 180.0, lat0 + body.corner[:, 1] / metre
        floor = Floor(100.0, depth, True, RADIUS)
        assert floor.near(body, lon, lat, DRAFT, np.ones(2, bool), 0.0, 500.0).tolist() == [True, True]
        cut = floor.patches(body, lon, lat, DRAFT, np.ones(2, bool), 0.0)
        assert floor.plough(cut, np.ones(cut.owner.size))  # gouged cells are found again
        cut = floor.patches(body, lon, lat, DRAFT, np.ones(2, bool), 0.0)
        return sum(shapely.Polygon(cut.corner[a:b, :2]).area for a, b in pairwise(cut.start.tolist()))

    assert area_at(0.0) == pytest.approx(area_at(100.0), rel=0.02)
    assert area_at(0.0) > SIDE**2


@pytest.mark.parametrize("turn", [0.4, 2.0])
def test_a_keel_across_the_date_line_is_cut_as_elsewhere(turn: float) -> None:
    """Longitudes of its corners jump by a turn there."""
    body, metre = footprint(turn), math.radians(1.0) * RADIUS
    metre_east = metre * math.cos(math.radians(-60.0))

    def cut_at(lon0: float) -> Patches:
        def depth(lon: Any, lat: Any) -> Any:
            return 205.0 + 2e-3 * metre_east * ((lon - lon0 + 180.0) % 360.0 - 180.0)

        lon = (lon0 + body.corner[:, 0] / metre_east + 180.0) % 360.0 - 180.0
        return Floor(100.0, depth, True, RADIUS).patches(
            body, lon, -60.0 + body.corner[:, 1] / metre, DRAFT, np.ones(2, bool), 0.0
        )  # fmt: skip

    def area(cut: Patches) -> float:
        return sum(shapely.Polygon(cut.corner[a:b, :2]).area for a, b in pairwise(cut.start.tolist()))

    assert area(cut_at(180.0)) == pytest.approx(area(cut_at(100.0)), rel=1e-9)
    assert area(cut_at(180.0)) > SIDE**2


@pytest.mark.parametrize("latitude", [None, -55.0])
def test_elements_that_may_reach_the_floor_are_found_before_they_are_cut(latitude: float | None) -> None:
    """All that have a polygon after a way of 300 m, and none that is far from any."""
    body, latlon = footprint(), latitude is not None
    metre = math.radians(1.0) * RADIUS if latlon else 1.0
    along = metre * math.cos(math.radians(latitude)) if latitude is not None else 1.0

    def depth(lon: Any, lat: Any) -> Any:  # a bank in the east, 1.5 m below the deeper keel
        return np.where(((lon + 180.0) % 360.0 - 180.0 if latlon else lon) * along > 2200.0, 212.5, 400.0)

    floor = Floor(50.0, depth, latlon, RADIUS)
    both = np.ones(2, bool)
    for x in np.linspace(-1500.0, 3500.0, 26):
        lon, lat = (x + body.corner[:, 0]) / along, (latitude or 0.0) + body.corner[:, 1] / metre
        near = floor.near(body, lon, lat, DRAFT, both, 0.0, 300.0)
        for way in (-300.0, 0.0, 300.0):
            cut = floor.patches(body, lon + way / along, lat, DRAFT, both, 0.0)
            assert near[np.unique(cut.owner)].all()
        east = [x + body.corner[4 * e : 4 * e + 4, 0].max() for e in (0, 1)]
        assert not near[np.array(east) + 300.0 + 2 * 8 * 50.0 < 2200.0].any()
        assert not floor.near(body, lon, lat, DRAFT, ~both, 0.0, 300.0).any()


def test_gouges_hold_the_volume_that_was_ploughed() -> None:
    """A block that counts as one cell is looked at by cells first."""
    body, plane = footprint(), sloping(0.002, -0.003, 0.0)
    floor = Floor(100.0, plane, False, RADIUS)

    def patches() -> Patches:
        return floor.patches(body, *body.corner.T, DRAFT, np.ones(2, bool), 0.0)

    whole = patches()
    assert (whole.cell[:, 1:] == -1).all()
    assert floor.plough(whole, np.full(whole.owner.size, 50.0)) == 0.0
    assert all((gouge == 0.0).all() for gouge in floor.gouges.values())
    cells = patches()
    assert (cells.cell[:, 1:] >= 0).all()
    volume = np.linspace(1.0, 300.0, cells.owner.size)
    assert floor.plough(cells, volume) == pytest.approx(volume.sum())
    assert sum(gouge.sum() for gouge in floor.gouges.values()) * 100.0**2 == pytest.approx(volume.sum(), rel=1e-12)
    # The overlap over each cell is less by its gouge.
    after = patches()
    for k, (a, b) in enumerate(pairwise(after.start.tolist())):
        slot, j, i = cells.cell[k].tolist()
        sunk = floor.gouges[int(floor.keys_of(np.array(slot)))][j, i]
        np.testing.assert_allclose(after.corner[a:b, 2], cells.corner[a:b, 2] - sunk, atol=1e-12)
    assert floor.plough(cells, np.zeros(cells.owner.size)) == 0.0


def patch(share: float, *, inside: list[int], area: Any, length: float = 600.0, count: int = 30) -> Bending:
    """A loaded patch of a lattice of 6 by 5 elements of 500 m, its line eastward."""
    own = np.zeros(count, bool)
    own[inside] = True
    return Bending(0.1, 2e5, share, length, (1.0, 0.0), area, own)


def grid(turn: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places and bonds of 6 columns and 5 rows, numbered along the rows."""
    number = np.arange(30).reshape(5, 6)
    xy = np.stack([number.ravel() % 6, number.ravel() // 6], axis=1) * 500.0
    c, s = math.cos(turn), math.sin(turn)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return xy @ np.array([[c, s], [-s, c]]), first, second


def pairs(xy: np.ndarray, first: np.ndarray, second: np.ndarray, where: Bending) -> set[tuple[int, int]]:
    cut = bent_bonds(where, xy, first, second)
    return set(zip(first[cut].tolist(), second[cut].tolist(), strict=True))


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_loaded_corner_breaks_off_with_what_lies_within_the_largest_moment(turn: float) -> None:
    """To pi lambda / 4 (471 m) from the loaded area, or the loaded elements alone where they are larger than that."""
    xy, first, second = grid(turn)
    corner = shapely.Point(xy[0] - 0.4 * (xy[7] - xy[0])).buffer(1.0)
    assert pairs(xy, first, second, patch(0.25, inside=[0], area=corner)) == {(0, 1), (0, 6)}
    assert pairs(xy, first, second, patch(0.25, inside=[0], area=corner, length=200.0)) == {(0, 1), (0, 6)}
    # A longer reach takes both neighbours along: their centres are 733 m away.
    assert pairs(xy, first, second, patch(0.25, inside=[0], area=corner, length=1000.0)) == {
        (1, 2), (1, 7), (6, 7), (6, 12),
    }  # fmt: skip


def test_a_front_breaks_off_along_its_length() -> None:
    xy, first, second = grid()
    front = shapely.LineString([(-250.0, -240.0), (2750.0, -240.0)]).buffer(5.0)
    assert pairs(xy, first, second, patch(0.5, inside=list(range(6)), area=front)) == {(n, n + 6) for n in range(6)}


def test_a_load_inside_cracks_the_ice_along_its_line() -> None:
    """Under it and a characteristic length beyond its ends; no piece is cut out of the berg."""
    xy, first, second = grid()
    line = shapely.LineString([(900.0, 740.0), (1100.0, 740.0)]).buffer(5.0)
    found = pairs(xy, first, second, patch(1.0, inside=[8], area=line))
    assert found == {(n, n + 6) for n in (7, 8, 9)}


CELL, COLUMNS, ROWS = 500.0, 8, 4
THICKNESS = 250.0


def lattice(turn: float = 0.0, shift: tuple[float, float] = (0.0, 0.0), mirror: float = 1.0) -> tuple[Any, ...]:
    """A berg of 4 by 2 km over a floor that meets one of its ends: hull, polygons and bonds."""
    i, j = (q.ravel() for q in np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij"))
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[:: int(mirror)]
    flat = (np.stack([i, j], axis=1)[:, None] + unit).reshape(-1, 2) * CELL
    overlap = 1.5 - 1e-3 * flat[:, 0] - 4e-4 * flat[:, 1]
    flat = flat * (1.0, mirror)
    c, s = math.cos(turn), math.sin(turn)
    corner = flat @ np.array([[c, s], [-s, c]]) + shift
    start, owner = 4 * np.arange(i.size + 1), np.arange(i.size)
    thickness = np.full(i.size, THICKNESS)
    hull = hull_of(corner, start, owner, thickness, 0.83 * thickness)
    zero = np.zeros((i.size, 2))
    patches = Patches(start, np.column_stack([corner, overlap]), owner, zero, np.zeros((i.size, 3), np.int64))
    number = np.arange(i.size).reshape(COLUMNS, ROWS)
    first = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    second = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    return patches, hull, thickness, first, second


def bed(*, bends: bool = True, modulus: float = 9e9, shear_strength: float = 0.0) -> Bed:
    return Bed(2e4, 1e4, 0.4, shear_strength, 1.0, bends, modulus, 0.3)


def pressure(how: Bed, **where: Any) -> tuple[Any, Any]:
    patches, hull, thickness, first, second = lattice(**where)
    return press(patches, thickness.size, hull, how, thickness, first, second, np.zeros(3)), hull


def test_the_share_of_ice_is_the_area_within_its_outline() -> None:
    """Beside shapely, for two pieces of ice, one of them with a bay and a hole, and polygons inside, outside and across."""
    bay = shapely.Polygon(
        [(0, 0), (9, 1), (8, 4), (4, 3), (8, 8), (1, 7)], [[(2, 2), (2, 4), (3.5, 4.5), (3, 2)]]
    )  # fmt: skip
    ice = shapely.orient_polygons(shapely.MultiPolygon([bay, shapely.box(11, 0, 14, 9)]))
    rings = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(shapely.get_parts(ice))]
    start, ring = np.cumsum([0, *(len(line) for line in rings)]), np.vstack(rings)
    rng, seen = np.random.default_rng(3), []
    for _ in range(200):
        convex = shapely.orient_polygons(
            shapely.MultiPoint(rng.uniform(-2, 15, 2) + rng.normal(0, 3, (7, 2))).convex_hull
        )
        share = share_of_ice(shapely.get_coordinates(convex)[:-1], start, ring)
        assert share == pytest.approx(shapely.intersection(convex, ice).area / convex.area, abs=1e-12)
        seen.append(share)
    assert min(seen) < 1e-12 < 0.3 < max(seen)


def test_columns_give_way_by_their_line_their_ends_and_the_deepest_point() -> None:
    """Beside the sums of the law: the line and its ends, or the point if that is stiffer, less what heave and tilt do."""
    line, width, first_end, last_end = 3.0, 2.0, 5.0, 7.0
    u, load, out = np.array([0.0, 1.0, 3.0, 2.0, 0.0]), np.array([0.0, 4.0, 8.0, 1.0, 0.0]), np.empty(5)
    total = line * width * u.sum()
    ends = first_end * (1.5 * 1.0 - 0.5 * 3.0) + last_end * (1.5 * 2.0 - 0.5 * 3.0)
    for point, factor in [(1.0, (total + ends) / total), (40.0, 40.0 * 3.0 / total)]:
        patch = factor * total / ((u @ load) / load.sum())
        for rigid in (0.0, 0.3 / patch):
            column_stiffness(line, width, point, first_end, last_end, rigid, u, load, out)
            np.testing.assert_allclose(out, line * width * factor / (1.0 - rigid * patch), rtol=1e-14)
    column_stiffness(line, width, 1e5, first_end, last_end, 0.0, u, 0.0 * load, out)
    assert (out == 100.0).all()


@pytest.mark.parametrize("bends", [False, True])
def test_water_and_floor_carry_the_weight_together(bends: bool) -> None:
    """Load and moments of the floor are those that heave and tilts take from the water."""
    found, hull = pressure(bed(bends=bends), turn=0.3, shift=(700.0, -300.0))
    x, y = found.x - hull.centre[0], found.y - hull.centre[1]
    given = [found.load.sum(), (found.load * y).sum(), -(found.load * x).sum()]
    np.testing.assert_allclose(hull.stiffness @ found.rise, given, rtol=1e-6, atol=1e-6 * given[0] * 1e3)
    assert found.load.sum() > 1e8


def test_a_round_element_of_many_corners_rests_like_any() -> None:
    """A disc of 90 corners, more than between two cuts, on a slope."""
    around = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    corner, start, owner = (
        600.0 * np.stack([np.cos(around), np.sin(around)], axis=1),
        np.array([0, 90]),
        np.zeros(1, int),
    )
    hull = hull_of(corner, start, owner, np.full(1, THICKNESS), np.full(1, 0.83 * THICKNESS))
    overlap = np.column_stack([corner, 0.5 + 1e-3 * corner[:, 0]])
    patches = Patches(start, overlap, owner, np.zeros((1, 2)), np.zeros((1, 3), np.int64))
    none = np.zeros(0, np.int64)
    found = press(patches, 1, hull, bed(bends=False), np.full(1, THICKNESS), none, none, np.zeros(3))
    np.testing.assert_allclose(hull.stiffness[0] @ found.rise, found.load.sum(), rtol=1e-9)
    assert found.x[0] > 100.0
    assert found.y[0] == pytest.approx(0.0, abs=1e-3)


def test_loads_are_the_overlap_up_to_the_strength_of_the_bed() -> None:
    how = bed(bends=False, shear_strength=2e3)
    found, hull = pressure(how)
    patches = found.patches
    middles = (np.arange(200) + 0.5) / 200.0 * CELL
    for k, (a, b) in enumerate(pairwise(patches.start.tolist())):
        low = patches.corner[a:b, :2].min(axis=0)
        x, y = np.meshgrid(low[0] + middles, low[1] + middles)
        over = 1.5 - 1e-3 * x - 4e-4 * y
        rise = found.rise[0] + found.rise[1] * (y - hull.centre[1]) - found.rise[2] * (x - hull.centre[0])
        stress = how.stiffness * np.maximum(over - rise, 0.0)
        borne = np.minimum(stress, how.strength)
        each = CELL**2 / x.size
        assert found.load[k] == pytest.approx(borne.sum() * each, rel=2e-3, abs=1e-4 * found.load.max())
        grip = how.friction * np.minimum(stress, how.shear_strength / how.friction)
        assert found.capacity[k] == pytest.approx(grip.sum() * each, rel=2e-3, abs=1e-4 * found.load.max())
        beyond = (stress - borne).sum() * each / how.stiffness
        assert found.excess[k] == pytest.approx(beyond, rel=5e-3, abs=5.0)
    assert (found.excess > 0.0).any()
    assert (found.load == 0.0).any()


def test_ice_that_hardly_bends_rests_as_a_rigid_body() -> None:
    rigid, stiff = (pressure(how, turn=0.3)[0] for how in (bed(bends=False), bed(modulus=1e22)))
    np.testing.assert_allclose(stiff.load, rigid.load, rtol=1e-3, atol=1e-4 * rigid.load.max())
    soft = pressure(bed(), turn=0.3)[0]
    assert soft.load.sum() < 0.9 * rigid.load.sum()


@pytest.mark.parametrize(
    "where", [{"turn": 1.1}, {"turn": -2.6}, {"shift": (4e4, -7e4)}, {"mirror": -1.0}, {"turn": math.pi}]
)
def test_the_balance_does_not_depend_on_where_the_berg_lies(where: dict[str, Any]) -> None:
    """Nor on which end of the line of contact is the first, nor on where polygons are cut: round-off alone is left."""
    here, there = pressure(bed())[0], pressure(bed(), **where)[0]
    np.testing.assert_allclose(there.load, here.load, rtol=1e-8, atol=1e-9 * here.load.max())


@pytest.mark.parametrize("thickness", [100.0, 250.0])
def test_ice_bends_over_the_length_of_a_floating_plate(thickness: float) -> None:
    """``(E H^3 / (12 (1 - nu^2) rho g))^(1/4)`` with Poisson's ratio 0.3, as in the plate for which edges were found."""
    bed = bed_of(Grounding(law="seabed", ice_modulus=2e9))
    rigidity = 2e9 * thickness**3 / (12.0 * (1.0 - 0.3**2))
    asked = (rigidity / (RHO_SEAWATER * GRAVITY)) ** 0.25
    assert bending_length(bed.modulus, bed.poisson, thickness) == pytest.approx(asked, rel=1e-12)


def test_the_impulse_of_contact_is_that_of_the_fragment_itself() -> None:
    contact: Any = SimpleNamespace(bodies=np.array([3, 5]), impulse=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    found = [_impulse_of(contact, 5), _impulse_of(contact, 3), _impulse_of(contact, 1), _impulse_of(None, 3)]
    assert np.array(found).tolist() == [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0], [0.0] * 3, [0.0] * 3]


def test_cells_repeat_with_the_period_of_a_plane() -> None:
    """A gouge was not there for a keel one period on; a bank was asked for at places beyond the channel."""
    body, period, asked = footprint(), 40.3e3, []

    def depth(x: Any, y: Any) -> Any:
        asked.extend(np.atleast_1d(x).tolist())
        return 205.0 + 1e-6 * x * x  # curved, so that cells count

    floor = Floor(100.0, depth, False, RADIUS, middle=0.0, period=period)

    def cut_at(x0: float) -> Patches:
        return floor.patches(body, x0 + body.corner[:, 0], body.corner[:, 1], DRAFT, np.ones(2, bool), 0.0)

    here = cut_at(500.0)
    assert floor.plough(here, np.ones(here.owner.size))
    here, there = cut_at(500.0), cut_at(500.0 + period)
    assert set(map(tuple, there.cell.tolist())) == set(map(tuple, here.cell.tolist()))
    for many in (np.max, np.min):
        assert many(there.corner, axis=0) == pytest.approx(many(here.corner, axis=0), abs=1e-6)
    middle = [np.mean([c.corner[a:b, 2].mean() for a, b in pairwise(c.start.tolist())]) for c in (here, there)]
    assert middle[0] == pytest.approx(middle[1], abs=1e-5)
    assert np.abs(asked).max() <= 0.51 * period


def test_land_of_no_known_depth_is_dry_for_the_bed() -> None:
    """It was 10 km deep, as what lies beyond all data: a keel went over the coast as if nothing were there."""
    sea = SimpleNamespace(
        depth=lambda x, y: np.where(x < 0.0, 300.0, np.nan), land=lambda x, y: (x >= 0.0) & (x < 10.0)
    )
    assert depth_of_bed(sea)(np.array([-1.0, 5.0, 20.0]), np.zeros(3)).tolist() == [300.0, 0.0, 1e4]  # type: ignore[arg-type]
