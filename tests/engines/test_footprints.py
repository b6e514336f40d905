"""Footprints: they fill the outline whatever the lattice and its angle, and are convex."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import connected_components

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.lattices import outline_cells
from riftberg.engines.quasi_static.bodies.pose import split_bodies
from riftberg.engines.quasi_static.ground.pads import place_points
from riftberg.engines.quasi_static.lattice import cells, footprints
from riftberg.state.population import find_rows


def model(rotation: float, packing: str) -> Model:
    berg = Iceberg.rectangle(
        12e3, 9e3, thickness=200.0, radius=1000.0, placement=(19e3, 4e3), latlon=False, rotation=rotation, packing=packing
    )  # fmt: skip
    return Model(
        berg, Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}, bonds={"packing": packing})
    )


@pytest.mark.quick(2)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("rotation", [0.0, 10.0, 20.0, 45.0, 77.7])
def test_footprints_fill_the_outline_and_are_convex(rotation: float, packing: str) -> None:
    """Bug: round-off on a square lattice turned by 20 degrees gave one element the whole berg."""
    run = model(rotation, packing)
    found = footprints.FootprintBook(run).follow(run)
    rings = [shapely.Polygon(found.corner[a:b]) for a, b in zip(found.start[:-1], found.start[1:], strict=True)]
    area = np.bincount(found.owner, shapely.area(rings))
    assert area.sum() == pytest.approx(108e6, rel=1e-6)
    assert area.max() < 3.0 * area.min()
    # Bug: edges of millimetres, whose direction is round-off, made depths of contact depend on which of two bergs came first.
    assert min(np.hypot(*(np.roll(c, 1, axis=0) - c).T).min() for c in (r.exterior.coords[:-1] for r in rings)) > 0.01
    np.testing.assert_allclose(shapely.area(shapely.convex_hull(rings)), shapely.area(rings), rtol=1e-9)


def test_footprints_turn_with_their_fragments() -> None:
    """Two fragments at once lie as each by itself."""
    run = model(20.0, "square")
    el, found = run.elements, footprints.FootprintBook(run).follow(run)
    turn = np.exp(0.3j) * ((el.lon - el.lon.mean()) + 1j * (el.lat - el.lat.mean()))
    xy, body = np.column_stack([turn.real, turn.imag]), (np.arange(el.size) >= 20).astype(np.int64)
    both = footprints.body_footprint(found, el, np.arange(el.size), xy, body)
    for b in (0, 1):
        rows = np.flatnonzero(body == b)
        one = footprints.body_footprint(found, el, rows, xy)
        mine = np.isin(both.owner, rows)
        corner = np.repeat(mine, np.diff(both.start))
        np.testing.assert_allclose(both.corner[corner], one.corner, atol=1e-6)
        away = one.corner - xy[rows][np.repeat(one.owner, np.diff(one.start))]
        assert np.hypot(*away.T).max() < 3e3


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0, -1.57])
def test_footprints_of_a_fragment_that_moved_as_a_whole_have_moved_with_it(turn: float) -> None:
    """To the micrometre, whatever the way: corners keep their places about the elements."""
    run = model(20.0, "square")
    el, found = run.elements, footprints.FootprintBook(run).follow(run)
    rows, way = np.arange(el.size), 3e4 - 7e3j
    there = np.exp(1j * turn) * (found.centre @ (1.0, 1.0j)) + way
    laid = footprints.body_footprint(
        found, el, rows, np.column_stack([there.real, there.imag])[np.argsort(found.element)]
    )
    asked = np.exp(1j * turn) * (found.corner @ (1.0, 1.0j)) + way
    assert laid.corner.shape == found.corner.shape
    np.testing.assert_allclose(laid.corner @ (1.0, 1.0j), asked, rtol=0, atol=1e-6)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_bergs_of_one_element_have_the_cells_of_a_lattice(packing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All at once, as one by one they took 0.23 ms each: a quarter of a minute for a population."""
    bergs = Iceberg.field(30, (-40.0, -38.0, -58.0, -57.0), seed=2)
    bergs.elements.sides[:] = 6 if packing == "hexagonal" else 4
    run = Model(bergs, Forcing.uniform((0.1, 0.0)), Parameters())
    one_by_one = [
        outline_cells(np.zeros((1, 2)), r, packing, 0.0) for r in interaction_sizes(run.elements, run.constants).radius
    ]
    monkeypatch.setattr(footprints, "lattices", lambda *_: [])
    found = footprints.FootprintBook(run).follow(run)
    row = find_rows(run.elements.id, found.element)[0]
    assert sorted(row) == list(range(30))
    for ring, owner in zip(np.split(found.corner, found.start[1:-1]), found.owner, strict=True):
        one, other = shapely.Polygon(ring + found.centre[owner]), one_by_one[row[owner]]
        assert one.exterior.is_ccw
        assert shapely.symmetric_difference(one, other).area < 1e-9 * other.area


def test_without_contact_and_sediment_no_footprints_are_made() -> None:
    bergs = Iceberg.field(30, (-40.0, -38.0, -58.0, -57.0), seed=2)
    run = Model(bergs, Forcing.uniform((0.1, 0.0)), Parameters(stepping={"interactions": False}))
    run.step()
    assert footprints.FootprintBook(run).state_dict() == {}


def test_a_child_born_inside_the_outline_of_the_start_has_a_footprint_of_its_own() -> None:
    """Bug: a footloose child took its parent's outline, lay in all of its elements at once, and a day took minutes."""
    p = Parameters(
        stepping={"time_step": 1800.0}, footloose={"enabled": True, "style": "bergs"},
        melt={"enabled": True, "temperature": 8.0, "salinity": 34.0},
    )  # fmt: skip
    berg = Iceberg.rectangle(6e3, 6e3, thickness=150.0, radius=1500.0, placement=(-37.0, -56.0), velocity=(0.6, 0.0))
    berg.elements.fl_k[:] = 3e5
    run = Model(berg, Forcing.uniform((0.6, 0.0), wind=(10.0, 0.0)), p)
    for _ in range(6):  # 6 km: who is born in the west is born where the outline was
        run.step()
    el = run.elements
    children = np.flatnonzero(el.life.fl_k < 0.0)
    assert children.size > 1
    found = run._stepper.memory.footprints.follow(run)  # type: ignore[attr-defined]
    xy = np.column_stack([el.lon, el.lat])
    laid = footprints.body_footprint(found, el, children, xy, np.arange(children.size))
    rings = [shapely.Polygon(laid.corner[a:b]) for a, b in zip(laid.start[:-1], laid.start[1:], strict=True)]
    area = np.bincount(laid.owner, shapely.area(rings))
    np.testing.assert_allclose(area, el.body.length[children] * el.body.width[children], rtol=1e-6)


def test_members_that_begin_with_the_same_berg_share_the_work_and_no_arrays() -> None:
    """Footprints and elastic cells take most of the set-up; they hang on the berg alone."""
    before = [cache.cache_info().hits for cache in (footprints._divide_ice, cells._cell_mesh)]
    one, two = (model(31.0, "square") for _ in range(2))
    assert [cache.cache_info().hits for cache in (footprints._divide_ice, cells._cell_mesh)] == [n + 1 for n in before]
    for mine, theirs in ((one._stepper.memory.cells.mesh, two._stepper.memory.cells.mesh),
                         (one._stepper.memory.footprints.follow(one), two._stepper.memory.footprints.follow(two))):  # fmt: skip
        for name, array in mine._asdict().items():
            np.testing.assert_array_equal(array, getattr(theirs, name))
            assert np.isscalar(array) or not np.shares_memory(array, getattr(theirs, name))


LATTICES = [("square", 0.0), ("square", 27.0), ("square", 45.0), ("hexagonal", 10.0)]


def parted(packing: str, angle: float, line: list[tuple[float, float]], **options: object) -> Iceberg:
    """A berg of 24 x 12 km on a turned lattice that a rift has parted."""
    berg = Iceberg.rectangle(
        24e3, 12e3, thickness=200.0, radius=1000.0, latlon=False, packing=packing, lattice_angle=angle, **options
    )  # fmt: skip
    return berg.with_rifts([line], broken=True)


@pytest.mark.parametrize("line", [[(650.0, -7e3), (650.0, 7e3)], [(-3e3, -7e3), (-1e3, 0.0), (2e3, 7e3)]])
@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_a_crack_divides_the_ice_along_its_line(packing: str, angle: float, line: list[tuple[float, float]]) -> None:
    """Bug: it divided it along the sides of cells, so that both faces had teeth, at 45 degrees as high as half a cell.

    A line with a bend, as one without; the ends, which no crossing bears witness of, may be off by a part of a cell.
    """
    run = Model(parted(packing, angle, line), Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}))
    el, found = run.elements, footprints.FootprintBook(run).follow(run)
    corner = found.corner - found.centre.mean(axis=0) + (el.lon.mean(), el.lat.mean())
    rings = [shapely.Polygon(corner[a:b]) for a, b in zip(found.start[:-1], found.start[1:], strict=True)]
    np.testing.assert_allclose(shapely.area(shapely.convex_hull(rings)), shapely.area(rings), rtol=1e-9)
    assert all(ring.exterior.is_ccw for ring in rings)
    assert shapely.area(rings).sum() == pytest.approx(288e6, rel=1e-6)
    berg = el.berg[find_rows(el.id, found.element)[0]][found.owner]
    one, other = (shapely.union_all([r for r, b in zip(rings, berg, strict=True) if b == n]) for n in np.unique(berg))
    middle = shapely.box(-2e4, -3.5e3, 2e4, 3.5e3)
    face = shapely.intersection(shapely.intersection(one.buffer(1.0), other.boundary), middle)
    assert face.length > 7e3
    # It stays clear of centres by 200 m.
    assert face.hausdorff_distance(shapely.intersection(shapely.LineString(line), middle)) < 210.0


def test_a_crack_along_the_sides_of_cells_leaves_no_needles() -> None:
    """Bug: centimetres of ice went over to the other piece, a kilometre long, and stood half a kilometre in others later."""
    line = [(0.02 * (-1) ** n, 2e3 * n - 7e3) for n in range(8)]
    run = Model(parted("square", 0.0, line), Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}))
    found = footprints.FootprintBook(run).follow(run)
    assert np.unique(run.elements.berg).size == 2
    assert found.owner.size == found.element.size
    rings = [shapely.Polygon(ring) for ring in np.split(found.corner, found.start[1:-1])]
    assert shapely.area(rings).min() > 0.99 * 4e6


@pytest.mark.parametrize(("packing", "seed"), [("square", 2), ("square", 5), ("hexagonal", 3), ("hexagonal", 7)])
def test_what_a_crack_cuts_off_goes_to_elements_that_it_adjoins(packing: str, seed: int) -> None:
    """Bug: it went to the nearest centre, past the ice of others: each fourth crack of A68a left up to 1.7 km2 alone."""
    rng = np.random.default_rng(seed)
    line = [(2e3 * n - 14e3 + rng.uniform(-900.0, 900.0), rng.uniform(-1.5e3, 1.5e3)) for n in range(15)]
    run = Model(parted(packing, 20.0, line), Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}))
    found = footprints.FootprintBook(run).follow(run)
    rings = [shapely.Polygon(ring) for ring in np.split(found.corner, found.start[1:-1])]
    assert shapely.area(rings).sum() == pytest.approx(288e6, rel=1e-6)
    for element in np.unique(found.owner):
        mine = [ring for ring, owner in zip(rings, found.owner, strict=True) if owner == element]
        shared = [[a.exterior.intersection(b.buffer(0.1)).length > 1.0 for a in mine] for b in mine]
        assert connected_components(np.array(shared), directed=False)[0] == 1, element


@pytest.mark.compiled
@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_ice_that_slides_along_a_crack_breaks_nothing_whatever_the_lattice(packing: str, angle: float) -> None:
    """Bug: the cells beside a crack of A68a bore on each other like the teeth of a rack.

    Its tip stood aground, the rest slid past it, and on a lattice turned by 45 degrees shattered on it.
    """
    berg = parted(packing, angle, [(650.0, -7e3), (650.0, 7e3)])
    el = berg.elements
    west = el.lon < 650.0
    el.static[west] = 1.0
    el.v[~west], el.u[~west] = 0.2, 0.02  # along the crack, and away from it as slowly as a current parts ice
    run = Model(
        berg, Forcing.uniform(), Parameters(
            earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0, "only_interactions": True},
            fracture={"normal_strength": "11 kPa"},
        ),
    )  # fmt: skip
    before = run.bonds_broken
    run.advance(steps=18)
    assert run.bonds_broken == before
    np.testing.assert_allclose(run.elements.v[~west], 0.2, rtol=0.02)


@pytest.mark.parametrize("latitude", [-78.0, -56.0, 30.0])
def test_the_ice_of_an_element_stays_where_it_is_as_its_fragment_parts(latitude: float) -> None:
    """Bug: a piece of one element took the direction of the meridian at the corner of its berg, a degree from its own.

    Its corners lay up to 115 m inside the rest. Pieces of several elements, then one of a single one off these.
    """
    berg = Iceberg.rectangle(150e3, 50e3, thickness=250.0, radius=2500.0, placement=(-40.0, latitude), rotation=17.0)
    run = Model(berg, Forcing.uniform(), Parameters())
    run.step()
    el, book, c, whole = run.elements, footprints.FootprintBook(run), run.constants, run._stepper.memory.bodies  # type: ignore[attr-defined]
    lone = int(el.lon.argmax())
    pieces = (el.lon > np.quantile(el.lon, 0.7)).astype(np.int64)
    crumb = pieces.copy()
    crumb[lone] = 2

    def corners(bodies: Any) -> np.ndarray:
        """Corners of all footprints on the sphere, m."""
        xy = 2.0 * c.earth_radius / (1.0 + bodies.reference[:, 2:]) * bodies.reference[:, :2]
        laid = footprints.body_footprint(book.follow(run), el, np.arange(el.size), xy, bodies.body)
        body = np.repeat(bodies.body[laid.owner], np.diff(laid.start))
        points = [
            place_points(*at, bodies.pose[b], True, c.earth_radius) for at, b in zip(laid.corner, body, strict=True)
        ]
        lon, lat = np.radians(np.array(points).T)
        return c.earth_radius * np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])

    start, parted = corners(whole), split_bodies(whole, pieces, el.mass, c.latlon, c.earth_radius)
    for bodies in (parted, split_bodies(parted, crumb, el.mass, c.latlon, c.earth_radius)):
        # Of elements of 5 km; the scale of a plane differs by 1e-4 in 150 km.
        np.testing.assert_allclose(corners(bodies), start, rtol=0.0, atol=0.4)


def test_a_crack_that_goes_on_leaves_the_ice_of_pieces_that_it_parted_earlier() -> None:
    """Bug: it was divided anew between these, which had moved since: faces lay metres inside each other, loaded or not."""
    line = [(-3e3, -7e3), (-1e3, 0.0), (2e3, 7e3)]
    run = Model(parted("square", 27.0, line), Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}))
    el, bonds, book = run.elements, run.bonds, footprints.FootprintBook(run)
    divided = book.follow(run)
    # The crack goes on through the piece in the east, from where it has ended.
    east = el.berg == el.berg[el.lon.argmax()]
    inside = (bonds.status == 0) & east[bonds.first] & east[bonds.second]
    crossed = np.flatnonzero(inside & ((el.lat[bonds.first] < 2e3) != (el.lat[bonds.second] < 2e3)))
    crossed = crossed[np.argsort(el.lon[bonds.first[crossed]])]
    order = bonds.crack_order[bonds.crack > 0].max() + 1 + np.arange(crossed.size)
    bonds.status[crossed], bonds.crack[crossed], bonds.crack_order[crossed] = 1, bonds.crack[bonds.crack > 0][0], order
    bonds.crack_part[crossed] = 0.3
    run.fragments.update(el, bonds, run.time, run.constants)
    west = np.unique(el.body.id[~east])
    after = book.follow(run)

    def ice(found: footprints.Footprints) -> Any:
        mine = np.isin(found.element[found.owner], west)
        return shapely.union_all(
            [shapely.Polygon(r) for r, m in zip(np.split(found.corner, found.start[1:-1]), mine, strict=True) if m]
        )

    assert after is not divided
    assert np.unique(el.berg).size == 3
    assert shapely.symmetric_difference(ice(divided), ice(after)).area < 1.0


@pytest.mark.parametrize("column", [-11e3, 11e3])
@pytest.mark.parametrize("side", [0.8, 1.2])
def test_an_element_keeps_its_ice_where_a_crack_ends_at_its_centre(column: float, side: float) -> None:
    """Bug: a crack that turned around an element ended within the cell of another, between its centre and its centroid.

    All of that ice went to its neighbours, and the run ended once the element parted from them.
    """
    berg = Iceberg.rectangle(24e3, 12e3 * side, thickness=200.0, radius=1000.0, latlon=False)
    run = Model(berg, Forcing.uniform(), Parameters(earth={"latlon": False, "period": 0.0}))
    el, bonds = run.elements, run.bonds
    whole = footprints.FootprintBook(run).follow(run)
    rim = np.flatnonzero(np.abs(el.lon - column) < 500.0)
    rim = rim[np.argsort(el.lat[rim])]
    inner = [int(np.argmin(np.hypot(el.lon - 0.8 * column - 100.0 * np.sign(column), el.lat - el.lat[e]))) for e in rim]
    pairs = [(rim[1], rim[2], 0.4), (rim[0], rim[1], 0.9), (inner[1], rim[1], 0.95), (inner[2], rim[2], 0.5)]
    pairs += [(inner[n], rim[n], 0.05) for n in range(3, rim.size)]
    for order, (one, other, share) in enumerate(pairs):
        forward = np.flatnonzero((bonds.first == one) & (bonds.second == other))
        backward = np.flatnonzero((bonds.first == other) & (bonds.second == one))
        (bond,) = np.concatenate([forward, backward])
        bonds.status[bond], bonds.crack[bond], bonds.crack_order[bond] = 1, 1, order
        bonds.crack_part[bond] = share if forward.size else 1.0 - share
    run.fragments.update(el, bonds, run.time, run.constants)
    assert np.unique(el.berg).size == 3
    divided = footprints.FootprintBook(run).follow(run)

    def ice(found: footprints.Footprints) -> np.ndarray:
        """Area of each element, m2."""
        rings = [shapely.Polygon(ring) for ring in np.split(found.corner, found.start[1:-1])]
        return np.bincount(found.owner, shapely.area(rings), found.element.size)

    np.testing.assert_array_equal(whole.element, el.id)
    assert (ice(divided) > 0.1 * ice(whole)).all()
    assert (ice(divided)[rim[3:]] > 0.4 * ice(whole)[rim[3:]]).all()
    assert ice(divided).sum() == pytest.approx(ice(whole).sum(), rel=1e-9)
