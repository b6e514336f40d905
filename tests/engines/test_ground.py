"""Keels on the floor: pads, the balance of water, bed and bending ice beside a plain twin, and which pads are looked at."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.config.quasi_static_groups import Seabed
from riftberg.constants import GRAVITY, RHO_SEAWATER
from riftberg.engines.common.bed import Bed, make_bed
from riftberg.engines.quasi_static.bodies.pose import Bodies, bodies_from_elements, place_elements, tangent_coordinates
from riftberg.engines.quasi_static.ground.pads import (
    Pads,
    choose_pad_sides,
    cut_into_pads,
    fill_hulls,
    measure_ice_share,
    melt_pads,
    place_points,
)
from riftberg.engines.quasi_static.ground.plate import unmade_plates
from riftberg.engines.quasi_static.ground.press import HOLD, LIFT, LOAD, LOAD_X, LOAD_Y, PRESSED, YIELD, press
from riftberg.engines.quasi_static.ground.seabed import bent_bonds, make_depth_sampler
from riftberg.engines.quasi_static.lattice.footprints import BodyFootprint
from riftberg.physics.seabed import bending_length
from scripts import ROOT, loaded, table_rows

PLATE = loaded("benchmarks/plate_on_water.py")
PAGE = ROOT / "docs" / "evidence" / "plate-on-water.md"
RADIUS = 6_371_229.0
THICKNESS = 250.0
DRAFT = 850.0 / 1025.0 * THICKNESS
WATER = RHO_SEAWATER * GRAVITY


class Berg:
    """A berg of square elements about the origin, cut into pads."""

    def __init__(
        self, columns: int, rows: int, cell: float, *, turn: float = 0.0, shift: tuple[float, float] = (0.0, 0.0),
        mirror: float = 1.0, side: float | None = None, modulus: float = 9e9,
    ) -> None:  # fmt: skip
        i, j = (q.ravel() for q in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
        unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[:: int(mirror)]
        middle = np.array([columns / 2, rows / 2])
        self.flat = ((np.stack([i, j], axis=1)[:, None] + unit).reshape(-1, 2) - middle) * cell
        c, s = math.cos(turn), math.sin(turn)
        self.axes, self.mirror, self.shift = np.array([[c, s], [-s, c]]), np.array([1.0, mirror]), np.array(shift)
        corner, xy = self.turned(self.flat), self.turned((np.stack([i, j], axis=1) + 0.5 - middle) * cell)
        footprint = BodyFootprint(np.arange(i.size), np.arange(i.size), 4 * np.arange(i.size + 1), corner)
        self.length = bending_length(modulus, 0.3, THICKNESS)
        sides = np.array([side]) if side else choose_pad_sides(modulus, 0.3, np.full(1, THICKNESS))
        self.pads = cut_into_pads(footprint, np.zeros(i.size, np.int64), 1, xy, sides)
        self.thickness, self.draft = np.full(i.size, THICKNESS), np.full(i.size, DRAFT)
        hull = np.empty((1, 3, 3))
        fill_hulls(self.pads, self.thickness, self.draft, modulus, 0.3, hull, np.empty(1), np.empty(1))
        self.hull, self.plates = hull[0], unmade_plates(self.pads)

    def turned(self, points: Any) -> Any:
        return (points * self.mirror) @ self.axes + self.shift

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners and middles of the pads, along the axes of the berg before it is turned."""
        points = np.concatenate([self.pads.corner, self.pads.centre]) + self.pads.frame[0, :2] - self.shift
        return tuple((points @ self.axes.T * self.mirror).T)

    def press(self, depth: Any, bed: Bed, *, bends: bool = True, level: float = 0.0, polygons: Any = None) -> Any:
        every = np.arange(self.pads.owner.size)
        values, count = depth(*self.points()), len(self.pads.corner)
        if polygons is not None:
            own = np.concatenate([np.arange(self.pads.start[k], self.pads.start[k + 1]) for k in polygons])
            values = values[np.concatenate([own, count + polygons])]
        q, found = np.zeros(3), np.zeros((self.draft.size, PRESSED))
        some = every if polygons is None else polygons
        bent, length = np.zeros((some.size, 5)), self.length if bends else 0.0
        steps, largest = press(
            self.pads, self.plates, 0, some, values, self.draft, level, bed, self.hull, length, THICKNESS, q, found, bent,
        )  # fmt: skip
        assert steps >= 0
        return SimpleNamespace(q=q, found=found, bent=bent, largest=largest, load=found[:, LOAD].sum())


def ring(pads: Pads, k: int) -> Any:
    return shapely.Polygon(pads.corner[pads.start[k] : pads.start[k + 1]])


def bed(*, stiffness: float = 2e4, strength: float = 1e4, shear: float = 0.0) -> Bed:
    grip = min(strength / stiffness, shear / (0.4 * stiffness)) if shear else strength / stiffness
    return Bed(stiffness, strength, 0.4, shear, grip, 1.0, 9e9, 0.3)


ROCK = make_bed(Seabed(sediment="rock"))


def tilted(x: Any, y: Any) -> Any:
    """A floor that meets one end of the berg of 4 by 2 km."""
    return DRAFT - 1.5 + 1e-3 * (x + 2000.0) + 4e-4 * (y + 1000.0)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_pads_fill_the_footprint_without_a_gap_and_belong_to_their_elements(turn: float) -> None:
    berg = Berg(8, 4, 500.0, turn=turn)
    pads, elements = berg.pads, berg.turned(berg.flat).reshape(-1, 4, 2)
    area = np.zeros(32)
    for k, e in enumerate(pads.owner):
        piece = shapely.transform(ring(pads, k), lambda p: p + pads.frame[0, :2])
        area[e] += piece.area
        assert shapely.Polygon(elements[e]).buffer(1e-6).contains(piece)
        assert shapely.get_coordinates(piece.centroid)[0] == pytest.approx(pads.centre[k] + pads.frame[0, :2], abs=1e-6)
        west, south, east, north = piece.bounds
        assert max(east - west, north - south) <= pads.frame[0, 2] * (1.0 + 1e-9)
    np.testing.assert_allclose(area, 500.0**2, rtol=1e-9)
    assert pads.ice[:, 0].sum() == pytest.approx(8e6, rel=1e-9)
    # Against heave the water plane, against tilt its second moments, less what the height of the ice takes.
    assert berg.hull[0, 0] == pytest.approx(WATER * 8e6, rel=1e-9)
    lean = 8e6 * DRAFT * 0.5 * (THICKNESS - DRAFT)
    assert np.linalg.eigvalsh(berg.hull[1:, 1:]) == pytest.approx(
        [WATER * (4e3 * 2e3**3 / 12.0 - lean), WATER * (2e3 * 4e3**3 / 12.0 - lean)], rel=1e-9
    )


def test_a_berg_that_lies_unevenly_about_its_centroid_is_cut_to_its_ends() -> None:
    cells = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [4, 1], [4, 2]])
    corner = ((cells[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) * 700.0).reshape(-1, 2)
    footprint = BodyFootprint(np.arange(7), np.arange(7), 4 * np.arange(8), corner)
    pads = cut_into_pads(footprint, np.zeros(7, np.int64), 1, (cells + 0.5) * 700.0, np.full(1, 300.0))
    area = np.zeros(7)
    for k, e in enumerate(pads.owner):
        area[e] += ring(pads, k).area
    np.testing.assert_allclose(area, 700.0**2, rtol=1e-9)


@pytest.mark.parametrize(("share", "bends"), [(0.98, False), (1.02, True)])
def test_ice_bends_where_it_is_longer_than_a_quarter_of_pi_characteristic_lengths(share: float, bends: bool) -> None:
    side = share * 0.25 * math.pi * math.sqrt(2.0) * bending_length(9e9, 0.3, THICKNESS) / 11.0
    berg, length = Berg(2, 2, 5.3 * side, side=side), np.empty(1)
    fill_hulls(berg.pads, berg.thickness, berg.draft, 9e9, 0.3, np.empty((1, 3, 3)), np.empty(1), length)
    assert (length[0] > 0.0) == bends


def test_several_bergs_are_cut_as_each_alone_and_a_small_one_is_one_pad() -> None:
    one, small = Berg(3, 2, 500.0, turn=0.4), Berg(1, 1, 200.0, turn=0.2)
    body, xy = np.array([0] * 6 + [1]), np.vstack([one.pads.element + one.pads.frame[0, :2], [[0.0, 0.0]]])
    corner = np.vstack([one.turned(one.flat), small.turned(small.flat)])
    footprint = BodyFootprint(np.arange(7), np.arange(7), 4 * np.arange(8), corner)
    both = cut_into_pads(footprint, body, 2, xy, np.full(2, one.pads.frame[0, 2]))
    assert np.array_equal(both.corner[: len(one.pads.corner)], one.pads.corner)
    assert np.array_equal(both.ice[: len(one.pads.ice)], one.pads.ice)
    assert both.polygon_start.tolist() == [0, one.pads.owner.size, one.pads.owner.size + 1]
    assert small.pads.owner.size == 1


def test_melt_of_the_sides_leaves_the_cut_and_takes_its_part_of_each_element() -> None:
    berg = Berg(3, 2, 900.0, turn=0.3)
    pads = melt_pads(berg.pads, np.linspace(0.7, 1.0, 6))
    area = np.zeros(6)
    for k in range(pads.owner.size):
        area[pads.owner[k]] += ring(pads, k).area
    np.testing.assert_allclose(area, (900.0 * np.linspace(0.7, 1.0, 6)) ** 2, rtol=1e-9)
    assert melt_pads(berg.pads, np.ones(6)) is berg.pads


@pytest.mark.parametrize("part", [0.15, 0.25])
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_the_share_of_ice_at_corners_edges_and_inside(part: float, turn: float) -> None:
    reach = math.sqrt(2.0) * bending_length(9e9, 0.3, THICKNESS)
    berg = Berg(4, 4, 2000.0, turn=turn, side=part * reach)
    for x, y, share in ((0.0, 0.0, 1.0), (4000.0, 300.0, 0.5), (0.0, -4000.0, 0.5), (4000.0, 4000.0, 0.25)):
        px, py = berg.turned(np.array([x, y])) - berg.pads.frame[0, :2]
        assert measure_ice_share(berg.pads, 0, px, py, reach) == pytest.approx(share, abs=0.015)


@pytest.mark.parametrize("latitude", [-75.0, 0.3, 60.0])
def test_points_of_a_berg_lie_where_its_elements_do(latitude: float) -> None:
    lon, lat = np.array([10.0, 10.1, 10.4]), latitude + np.array([0.0, 0.2, -0.1])
    whole = bodies_from_elements(lon, lat, np.zeros(3, np.int64), np.ones(3), True, RADIUS, 0.0)
    bodies: Bodies = whole._replace(displacement=np.zeros((3, 3)))
    place_elements(bodies, lon, lat, np.zeros(3), True, RADIUS, 0.0)
    for e, (x, y) in enumerate(tangent_coordinates(bodies.reference, True, RADIUS)):
        found = place_points(x, y, bodies.pose[0], True, RADIUS)
        assert found == pytest.approx((lon[e], lat[e]), abs=1e-9)


@pytest.mark.parametrize("bends", [False, True])
def test_water_and_floor_carry_the_weight_together(bends: bool) -> None:
    """Load and moments of the floor are those that heave and tilts take from the water."""
    berg = Berg(8, 4, 500.0, turn=0.3, shift=(700.0, -300.0))
    now = berg.press(tilted, bed(), bends=bends)
    load, (x, y) = now.found[:, LOAD], now.found[:, [LOAD_X, LOAD_Y]].T - berg.pads.frame[0, :2, None]
    given = [load.sum(), (load * y).sum(), -(load * x).sum()]
    np.testing.assert_allclose(berg.hull @ now.q, given, rtol=1e-6, atol=1e-3 * load.sum())
    assert load.sum() > 1e8
    assert now.largest == pytest.approx(1.5, abs=1e-9)
    assert (now.found[:, LIFT] > 0.0).any() == (load > 0.0).any()


@pytest.mark.parametrize(("stiffness", "strength"), [(2e4, 1e4), (5e4, 1e6)])
@pytest.mark.parametrize("columns", [8, 40])
def test_the_balance_is_that_of_an_independent_plate(stiffness: float, strength: float, columns: int) -> None:
    """Sums over points of Gauss, a finer plate, and another Newton; of a berg that is narrow, turned and tilts to both sides."""
    berg, half = Berg(columns, 4, 500.0, turn=0.3, side=188.0), 250.0 * columns
    now = berg.press(lambda x, y: tilted(x + half - 2000.0, y), bed(stiffness=stiffness, strength=strength))
    x, y = PLATE.graded(2.0 * half, 125.0, 2000.0), np.linspace(0.0, 2000.0, 9)
    zone = PLATE.Zone(PLATE.floating_plate(x, y, 9e9), (0.0, 2.0 * half), (0.0, 2000.0))
    alone = zone.press(DRAFT - tilted(zone.x - 2000.0, zone.y - 1000.0), PLATE.Bed(stiffness, strength, friction=0.4))
    # The height of the ice takes 1.3 % of its stiffness against tilt across, which the plate leaves out.
    assert now.load == pytest.approx(alone.load, rel=0.02)
    assert now.found[:, HOLD].sum() == pytest.approx(alone.friction, rel=0.02)


def test_a_round_element_of_many_corners_rests_like_any() -> None:
    """A disc of 90 corners, on a slope."""
    around = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    corner = 600.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    footprint = BodyFootprint(np.arange(1), np.zeros(1, np.int64), np.array([0, 90]), corner)
    berg = Berg(1, 1, 100.0)
    berg.pads = cut_into_pads(footprint, np.zeros(1, np.int64), 1, np.zeros((1, 2)), np.array([2000.0]))
    hull = np.empty((1, 3, 3))
    fill_hulls(berg.pads, berg.thickness, berg.draft, 9e9, 0.3, hull, np.empty(1), np.empty(1))
    berg.hull = hull[0]
    now = berg.press(lambda x, y: DRAFT - 0.5 - 1e-3 * x, bed(), bends=False)
    assert berg.hull[0] @ now.q == pytest.approx(now.load, rel=1e-9)
    assert now.found[0, LOAD_X] > 100.0
    assert now.found[0, LOAD_Y] == pytest.approx(0.0, abs=1e-3)


def test_loads_are_the_overlap_up_to_the_strength_of_the_bed() -> None:
    berg, how = Berg(8, 4, 500.0), bed(shear=2e3)
    now = berg.press(tilted, how, bends=False)
    middles = (np.arange(200) + 0.5) / 200.0 * 500.0
    for e, (a, _) in enumerate(pairwise([*range(0, 129, 4)])):
        low = berg.flat[a : a + 4].min(axis=0)
        x, y = np.meshgrid(low[0] + middles, low[1] + middles)
        over = DRAFT - tilted(x, y) - (now.q[0] + now.q[1] * y - now.q[2] * x)
        stress = how.stiffness * np.maximum(over, 0.0)
        each, most = 500.0**2 / x.size, now.found[:, LOAD].max()
        assert now.found[e, LOAD] == pytest.approx(
            np.minimum(stress, how.strength).sum() * each, rel=2e-3, abs=1e-4 * most
        )
        grip = how.friction * np.minimum(stress, how.shear_strength / how.friction)
        assert now.found[e, HOLD] == pytest.approx(grip.sum() * each, rel=2e-3, abs=1e-4 * most)
        assert now.found[e, YIELD] == pytest.approx(max(over.max() - 0.5, 0.0), abs=5e-3)
    assert (now.found[:, YIELD] > 0.0).any()
    assert (now.found[:, LOAD] == 0.0).any()


def test_ice_that_hardly_bends_rests_as_a_rigid_body() -> None:
    rigid = Berg(8, 4, 500.0, turn=0.3, side=400.0).press(tilted, bed(), bends=False)
    stiff = Berg(8, 4, 500.0, turn=0.3, side=400.0, modulus=1e22).press(tilted, bed())
    np.testing.assert_allclose(stiff.found[:, LOAD], rigid.found[:, LOAD], rtol=1e-3, atol=1e-4 * rigid.load)
    long, floor = Berg(40, 8, 500.0), lambda x, y: tilted(x + 8000.0, y)
    assert long.press(floor, bed()).load < 0.9 * long.press(floor, bed(), bends=False).load


@pytest.mark.parametrize(
    "where", [{"turn": 1.1}, {"turn": -2.6}, {"shift": (4e4, -7e4)}, {"mirror": -1.0}, {"turn": math.pi}]
)
def test_the_balance_does_not_depend_on_how_the_berg_lies(where: dict[str, Any]) -> None:
    """Pads are fixed along the axes of the fragment, so turned axes cut them otherwise: within 1 %."""
    here, there = Berg(8, 4, 500.0).press(tilted, bed()), Berg(8, 4, 500.0, **where).press(tilted, bed())
    assert there.load == pytest.approx(here.load, rel=1e-9 if "shift" in where else 0.01)


@pytest.mark.compiled
def test_the_balance_does_not_depend_on_which_pads_are_watched() -> None:
    """Nor on what was pressed before: a run that is resumed surveys the floor elsewhere, and has made no plate yet."""

    def floor(x: Any, y: Any, rise: float = 0.0) -> Any:
        return DRAFT - rise + 2e-3 * (x + 10e3)

    berg, every, ahead = Berg(20, 8, 1000.0), [], np.flatnonzero(Berg(20, 8, 1000.0).points()[0] < -7000.0)
    for rise in (0.5, 1.0, 2.0):
        every.append(berg.press(lambda x, y, rise=rise: floor(x, y, rise), ROCK).found)
    watched = Berg(20, 8, 1000.0)
    some = ahead[ahead >= len(watched.pads.corner)] - len(watched.pads.corner)
    for rise, found in ((2.0, every[2]), (0.5, every[0])):
        again = watched.press(lambda x, y, rise=rise: floor(x, y, rise), ROCK, polygons=some)
        assert np.array_equal(again.found, found)


@pytest.mark.compiled
def test_the_balance_does_not_depend_on_what_was_pressed_before() -> None:
    """A resumed run has no plate from before: one with loads in other elements, and the same ice around them, is another."""

    def knolls(*middles: tuple[float, float]) -> Any:
        def floor(x: Any, y: Any) -> Any:
            return (
                DRAFT + 3.0 - sum(4.0 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2.0 * 300.0**2)) for a, b in middles)
            )

        return floor

    lattice = 16, 8, 1000.0
    full = [(a, b) for a in (-3e3, 0.0, 3e3) for b in (-3e3, 0.0, 3e3)]
    ring = [middle for middle in full if middle != (0.0, 0.0)]
    floors = [knolls(*middles) for middles in (ring, full, [(6e3, 0.0)], [(6e3, 0.0), (-6e3, 2e3)], ring)]
    used = Berg(*lattice)
    for floor in floors:
        assert np.array_equal(used.press(floor, ROCK).found, Berg(*lattice).press(floor, ROCK).found)


@pytest.mark.parametrize("side", [150.0, 226.0, 362.0, 376.0])
def test_a_corner_is_borne_by_the_plate_there_whatever_the_pads(side: float) -> None:
    """Bug: pads that bore nothing yet were taken to bear at the middle of their overlap, and then took half of the load.

    The plate by finite elements has 4.92e9 N after 556 m.
    """
    turn, berg = math.radians(30.0), Berg(6, 3, 3000.0, side=side)
    c, s, loads = math.cos(turn), math.sin(turn), []
    reach = 9000.0 * c + 4500.0 * s
    for way in (400.0, 554.0, 620.0):
        near = np.flatnonzero(berg.pads.centre @ (c, s) > reach - way - 1000.0)
        floor = lambda x, y, way=way: DRAFT - 1e-3 * (x * c + y * s - reach + way)  # noqa: E731
        loads.append(berg.press(floor, ROCK, polygons=near).load / (1e-3 * way))
    assert loads == pytest.approx([4.92e9 / 0.556] * 3, rel=0.055)
    assert loads[1] == pytest.approx(4.92e9 / 0.556, rel=0.04)


@pytest.mark.parametrize("towards", [(1.0, 1.0), (-1.0, 1.0), (1.0, 0.0), (-1.0, 0.0)])
def test_ice_is_as_stiff_at_each_of_its_edges_wherever_the_raster_ends(towards: tuple[float, float]) -> None:
    """Bug: of a plate element with little ice in it, one point a pad missed the bending, and a corner was twice as soft there.

    The bed carried half of the load; when a piece broke off A68a's tip, which begins the raster elsewhere, it took 2.5 times as
    much at once.
    """
    way, (a, b), loads = 300.0, np.array(towards) / np.hypot(*towards), []
    for length in 10e3 + 60.0 * np.arange(6):  # the last pads are whole, or cut anywhere
        berg = Berg(3, 3, length / 3.0)
        reach = 0.5 * length * (abs(a) + abs(b))
        floor = lambda x, y, reach=reach: DRAFT - 1e-3 * (x * a + y * b - reach + way)  # noqa: E731
        near = np.flatnonzero(np.stack(berg.points(), axis=1)[len(berg.pads.corner) :] @ (a, b) > reach - way - 1000.0)
        loads.append(berg.press(floor, ROCK, polygons=near).load / (1.0 if b else length))
    assert max(loads) < 1.03 * min(loads)


@pytest.mark.parametrize("gap", [1e-3, 1.0])
def test_a_berg_wholly_on_a_flat_bed_is_borne_by_all_of_it(gap: float) -> None:
    """More pads than bend one by one, and few: the bed bears the water that the berg does not displace."""
    for columns, rows, cell in ((6, 3, 3000.0), (7, 3, 600.0)):
        now = Berg(columns, rows, cell).press(lambda x, y: np.full(np.shape(x), DRAFT - gap), ROCK)
        assert now.load == pytest.approx(WATER * columns * rows * cell**2 * gap, rel=0.005)


def of_plate(case: str) -> float:
    """Load (N) that the independent plate by finite elements bears (docs/evidence/plate-on-water.md)."""
    rows = {row[0]: row[3] for row in table_rows(PAGE, "plate on a bed")}
    return float(rows[case].removesuffix(" N"))


@pytest.mark.compiled
@pytest.mark.parametrize("modulus", [9e9, 1e9])
@pytest.mark.parametrize("width", PLATE.WIDTHS)
def test_a_ramp_of_any_width_bears_what_the_plate_does(width: float, modulus: float) -> None:
    """Bug: with one Green's function everywhere ramps of 2 to 10 lambda bore from 29 % too little to 14 % too much."""
    wide = width * math.sqrt(2.0) * bending_length(modulus, 0.3, THICKNESS)
    columns = math.ceil(max(20e3, wide / width * (width + 8.0)) / 2e3)
    berg = Berg(columns, 5, 2e3, modulus=modulus)
    near = np.flatnonzero(berg.points()[0][len(berg.pads.corner) :] > 1e3 * columns - wide - 500.0)
    load = berg.press(lambda x, y: DRAFT - 1e-3 * (wide + x - 1e3 * columns), ROCK, polygons=near).load
    assert load == pytest.approx(of_plate(f"ramp {width:g} λ wide, {modulus / 1e9:g} GPa, rock"), rel=0.03)


@pytest.mark.quick(2)
@pytest.mark.compiled
@pytest.mark.parametrize("sediment", ["rock", "sand", "clay"])
@pytest.mark.parametrize("modulus", [9e9, 1e9])
def test_a_bank_bears_what_the_plate_does(modulus: float, sediment: str) -> None:
    """The end quarter of 40 x 30 km on a floor that rises by 1e-3: thousands of pads, in squares of 2 lambda, bear too little."""
    berg, how = Berg(20, 15, 2e3, modulus=modulus), make_bed(Seabed(sediment=sediment))
    near = np.flatnonzero(berg.points()[0][len(berg.pads.corner) :] > 10e3 - 500.0)
    now = berg.press(lambda x, y: DRAFT - 1e-3 * (x - 10e3), how, polygons=near)
    assert now.load == pytest.approx(of_plate(f"bank, {modulus / 1e9:g} GPa, {sediment}"), rel=0.09)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_bank_under_the_whole_berg_bears_the_water_of_its_volume(turn: float) -> None:
    """A uniform and a linear overlap bend nothing, wherever the edges lie on the raster of elements."""
    berg = Berg(6, 4, 1000.0, turn=turn)
    now = berg.press(lambda x, y: DRAFT - 2.0 - 4e-4 * x + 3e-4 * y, ROCK)
    assert now.load == pytest.approx(WATER * 24e6 * 2.0, rel=0.002)
    assert now.bent[:, 1] == pytest.approx(0.0, abs=0.03)


def test_a_floor_of_second_order_is_seen_between_the_corners_of_pads() -> None:
    """A knoll under a pad that is whole: its top lies at no corner."""
    berg = Berg(3, 3, 1000.0, side=300.0)
    loads = []
    for side in (300.0, 75.0):
        fine = Berg(3, 3, 1000.0, side=side)
        loads.append(fine.press(lambda x, y: DRAFT - 0.05 + 2e-7 * (x * x + y * y), bed(), bends=False).load)
    assert loads[0] == pytest.approx(loads[1], rel=0.02)
    assert berg.press(lambda x, y: np.full(np.shape(x), DRAFT + 1.0), bed()).largest == pytest.approx(-1.0)


@pytest.mark.parametrize("edge", [-150.0, 50.0])
def test_a_cliff_under_a_pad_lifts_no_higher_than_its_top(edge: float) -> None:
    """Through a drop of 500 m within a pad a plane would stand a hundred metres inside the keel, or far below it."""
    berg = Berg(1, 1, 400.0)
    now = berg.press(lambda x, y: np.where(x > edge, DRAFT - 1.0, DRAFT + 500.0), ROCK)
    assert now.load > 0.0
    assert now.largest <= 1.0 + 1e-9


def test_the_floor_of_a_plane_that_repeats_is_asked_for_within_its_period() -> None:
    """A bank was asked for at places beyond the channel."""
    asked: list[float] = []

    def depth(x: Any, y: Any) -> Any:
        asked.extend(np.atleast_1d(x).tolist())
        return 205.0 + 1e-6 * x * x

    floor = make_depth_sampler(SimpleNamespace(depth=depth), 0.0, 40.3e3)  # type: ignore[arg-type]
    x = np.linspace(-2e3, 2e3, 9)
    np.testing.assert_allclose(floor(x + 3 * 40.3e3, x), floor(x, x), atol=1e-6)
    assert np.abs(asked).max() <= 0.51 * 40.3e3


def test_land_of_no_known_depth_is_dry_for_the_bed() -> None:
    """It was 10 km deep, as what lies beyond all data: a keel went over the coast as if nothing were there.

    Beyond the data it is as deep as at its edge.
    """
    sea = SimpleNamespace(
        depth=lambda x, y: np.where(x < 0.0, 300.0, np.nan), land=lambda x, y: (x >= 0.0) & (x < 10.0)
    )
    sample_depth = make_depth_sampler(sea)  # type: ignore[arg-type]
    assert sample_depth(np.array([-1.0, 5.0, 20.0]), np.zeros(3)).tolist() == [300.0, 0.0, 300.0]


@pytest.mark.parametrize("thickness", [100.0, 250.0])
def test_ice_bends_over_the_length_of_a_floating_plate(thickness: float) -> None:
    """``(E H^3 / (12 (1 - nu^2) rho g))^(1/4)`` with Poisson's ratio 0.3, as in the plate for which edges were found."""
    given = make_bed(Seabed(ice_modulus=2e9))
    rigidity = 2e9 * thickness**3 / (12.0 * (1.0 - 0.3**2))
    asked = (rigidity / (RHO_SEAWATER * GRAVITY)) ** 0.25
    assert bending_length(given.modulus, given.poisson, thickness) == pytest.approx(asked, rel=1e-12)


def grid(turn: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places and bonds of 6 columns and 5 rows of elements of 500 m, numbered along the rows."""
    number = np.arange(30).reshape(5, 6)
    xy = np.stack([number.ravel() % 6, number.ravel() // 6], axis=1) * 500.0
    c, s = math.cos(turn), math.sin(turn)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return xy @ np.array([[c, s], [-s, c]]), first, second


def bent(
    owner: list[int], share: float, places: Any, turn: float = 0.0, reach: float = 600.0
) -> list[set[tuple[int, int]]]:
    """Bonds that the loads on pads of some elements act on, of each group of these."""
    xy, first, second = grid(turn)
    c, s = math.cos(turn), math.sin(turn)
    found = np.column_stack([
        np.full(len(owner), 1e8), np.linspace(0.1, 0.2, len(owner)), np.full(len(owner), share),
        np.asarray(places) @ np.array([[c, s], [-s, c]]),
    ])  # fmt: skip
    cuts = bent_bonds(np.array(owner), found, reach / math.sqrt(2.0), 200.0, xy, first, second)
    return [set(zip(first[cut].tolist(), second[cut].tolist(), strict=True)) for cut, _ in cuts]


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_loaded_corner_breaks_off_with_what_lies_within_the_largest_moment(turn: float) -> None:
    """To pi lambda / 4 (471 m) from the loads, or the loaded elements alone where they are larger than that."""
    corner = [[-240.0, -240.0]]
    assert bent([0], 0.25, corner, turn) == [{(0, 1), (0, 6)}]
    assert bent([0], 0.25, corner, turn, 200.0) == [{(0, 1), (0, 6)}]
    # A longer reach takes both neighbours along: their centres are 778 m away.
    assert bent([0], 0.25, corner, turn, 1000.0) == [{(1, 2), (1, 7), (6, 7), (6, 12)}]


def test_a_front_breaks_off_along_its_length_and_groups_by_themselves() -> None:
    front = [[500.0 * n, -240.0] for n in range(6)]
    assert bent(list(range(6)), 0.5, front) == [{(n, n + 6) for n in range(6)}]
    both = bent([0, 29], 0.25, [[-240.0, -240.0], [2740.0, 2240.0]])
    assert both == [{(0, 1), (0, 6)}, {(28, 29), (23, 29)}]


def test_a_load_inside_cracks_the_ice_along_its_line() -> None:
    """Under it and a characteristic length beyond its ends; no piece is cut out of the berg."""
    assert bent([8, 8], 1.0, [[900.0, 740.0], [1100.0, 740.0]]) == [{(n, n + 6) for n in (7, 8, 9)}]


@pytest.mark.parametrize("tide", [False, True])
def test_open_water_costs_one_survey_in_kilometres_of_way(monkeypatch: pytest.MonkeyPatch, tide: bool) -> None:
    """Elements of 3 km were looked at as near a floor of 700 m in every step: a slope might rise to the keel within them."""
    sea = Forcing.uniform(current=(0.5, 0.2)) + Forcing.seamount((5.0, 5.0), height=100.0, width=4e3, depth=700.0)
    sea = sea + Forcing.tide(0.0, level=0.4, period="8 h") if tide else sea
    asked, depth = [0], type(sea).depth

    def counted(self: Any, lon: Any, lat: Any) -> Any:
        asked[0] += 1
        return depth(self, lon, lat)

    berg = Iceberg.rectangle(18e3, 12e3, thickness=THICKNESS, placement=(0.0, -60.0), velocity=(0.5, 0.2))
    model = Model(berg, sea, Parameters(grounding={"law": "seabed"}, fracture={"enabled": False}))
    monkeypatch.setattr(type(sea), "depth", counted)
    start = model.elements.lon.mean(), model.elements.lat.mean()
    model.advance(days=1)
    east, north = model.elements.lon.mean() - start[0], model.elements.lat.mean() - start[1]
    way = math.hypot(55.6e3 * east, 111.2e3 * north)
    assert way > 25e3
    assert 1 <= asked[0] <= way / 5e3
