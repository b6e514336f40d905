"""Keels on the floor: the balance of water, bed and bending ice beside plain twins, and which pads are looked at.

Bergs are placed on the floor and take a first step of a millisecond, in which nothing moves; then their keels are asked.
"""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import root

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import GRAVITY, RHO_SEAWATER
from riftberg.physics.seabed import bending_length
from scripts import ROOT, loaded, table_rows

PLATE = loaded("benchmarks/plate_on_water.py")
PAGE = ROOT / "docs" / "evidence" / "plate-on-water.md"
THICKNESS = 250.0
DRAFT = 850.0 / 1025.0 * THICKNESS
WATER = RHO_SEAWATER * GRAVITY


class Floor(Forcing.uniform):
    """Still water over a floor, whose depth (m) is a function of positions; and a sea level (m) that may change with time."""

    def __init__(self, depth: Any, level: Any = lambda time: 0.0, dry: Any = lambda lon, lat: lon != lon) -> None:
        super().__init__(slope=(0.0, 0.0))
        for name, value in {"floor": depth, "level": level, "dry": dry, "asked": []}.items():
            object.__setattr__(self, name, value)

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the depth, and keep where it was asked for."""
        self.asked.append(np.stack([np.ravel(lon), np.ravel(lat)]))
        return np.broadcast_to(self.floor(np.asarray(lon), np.asarray(lat)), np.shape(lon)).astype(float)

    def land(self, lon: Any, lat: Any) -> Any:
        """Return which points are land."""
        return self.dry(np.asarray(lon), np.asarray(lat))

    def sea_level(self, lon: Any, lat: Any, time: float) -> Any:
        """Return the sea level."""
        return np.full(np.shape(lon), self.level(time))


def bed(*, stiffness: float = 2e4, strength: float = 1e4, shear: float | None = None, **how: Any) -> dict[str, Any]:
    """Return a bed whose friction is 0.4."""
    return {
        "sediment": "other", "stiffness": stiffness, "bearing_strength": strength, "friction": 0.4, "shear_strength": shear,
        **how,
    }  # fmt: skip


ROCK = {"sediment": "rock"}
SOFT = bed(stiffness=1e-3, strength=1e9)
"""A bed that lifts nothing: each element bears the stiffness times the integral of its overlap."""


UNBREAKABLE = {"normal_strength": 1e9, "flexural_strength": 1e12}


def aground(berg: Iceberg, sea: Forcing, how: dict[str, Any], **earth: Any) -> Model:
    """Place a berg on the floor."""
    p = Parameters(
        earth={"latlon": False, "period": 0.0} | earth, stepping={"time_step": 1e-3}, grounding=how,
        fracture=UNBREAKABLE if how.get("bending", True) else {"enabled": False},
    )  # fmt: skip
    model = Model(berg, sea, p)
    model.step()
    return model


class Berg:
    """A berg of square elements about the origin, turned (rad) and shifted (m), on a floor that is turned and shifted with it."""

    def __init__(
        self, columns: int, rows: int, cell: float, *, turn: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)
    ) -> None:  # fmt: skip
        self.size, self.cell, self.turn, self.shift = (columns * cell, rows * cell), cell, turn, shift

    def along(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return positions along the axes of the berg."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        x, y = np.asarray(x) - self.shift[0], np.asarray(y) - self.shift[1]
        return c * x + s * y, c * y - s * x

    def iceberg(self) -> Iceberg:
        """Return it as it is given to a model."""
        return Iceberg.rectangle(
            *self.size, radius=0.5 * self.cell, thickness=THICKNESS, latlon=False, rotation=math.degrees(self.turn),
            placement=self.shift,
        )  # fmt: skip

    def press(self, depth: Any, how: dict[str, Any], *, level: Any = lambda time: 0.0) -> Any:
        """Return what the elements bear, and where, along the axes of the berg."""
        model = aground(self.iceberg(), Floor(lambda x, y: depth(*self.along(x, y)), level), how)
        el, keel = model.elements, model.elements.keel
        return SimpleNamespace(
            model=model, total=keel.floor_load.sum(), centre=np.stack(self.along(el.lon, el.lat)), loads=keel.floor_load,
            hold=keel.floor_hold, lift=keel.floor_lift, yielded=keel.floor_yield, stress=keel.floor_stress,
            where=np.stack(self.along(el.lon + keel.floor_arm_x, el.lat + keel.floor_arm_y)),
        )  # fmt: skip


def pad_side(modulus: float) -> float:
    """Return the side of pads (m): a quarter of the characteristic length, rounded down to an eighth root of 2."""
    quarter = 0.25 * math.sqrt(2.0) * bending_length(modulus, 0.3, THICKNESS)
    return float(2.0 ** (math.floor(8.0 * math.log2(quarter)) / 8.0))


def tilted(x: Any, y: Any) -> Any:
    """A floor that meets one end of the berg of 4 by 2 km."""
    return DRAFT - 1.5 + 1e-3 * (x + 2000.0) + 4e-4 * (y + 1000.0)


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("cell", [200.0, 500.0, 900.0])
def test_pads_fill_the_footprint_and_belong_to_their_elements(cell: float, turn: float) -> None:
    """On a bed that lifts nothing each element bears its overlap, in its middle, and on a slope where its centroid lies."""
    area = cell**2
    flat = Berg(4, 3, cell, turn=turn).press(lambda x, y: DRAFT - 1.0, SOFT)
    np.testing.assert_allclose(flat.loads, 1e-3 * area, rtol=3e-6)
    np.testing.assert_allclose(flat.where, flat.centre, rtol=0, atol=1e-6 * cell)
    slope = Berg(4, 3, cell, turn=turn).press(lambda x, y: DRAFT - 4.0 - 1e-3 * x, SOFT)
    np.testing.assert_allclose(slope.loads, 1e-3 * area * (4.0 + 1e-3 * slope.centre[0]), rtol=3e-6)
    away = 1e-3 * cell**2 / 12.0 / (4.0 + 1e-3 * slope.centre[0])
    np.testing.assert_allclose(slope.where - slope.centre, [away, 0.0 * away], rtol=0, atol=1e-4 * away.max())


@pytest.mark.parametrize("radius", [400.0, 750.0])
def test_a_berg_of_any_outline_is_cut_to_its_ends(radius: float) -> None:
    """An L, unevenly about its centroid, and a disc, whose elements at the edge have many corners: area and moments."""
    metre = math.pi * 6_363_827.0 / 180.0
    around = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    disc = 2000.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    bar = 700.0 * np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 3.0], [4.0, 3.0], [4.0, 1.0], [0.0, 1.0]])
    for outline in (disc, bar):
        x, y = outline.T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        area, mx = 0.5 * cross.sum(), ((x + np.roll(x, -1)) * cross).sum() / 6.0
        berg = Iceberg.from_outline(outline / metre, thickness=THICKNESS, radius=radius)
        for gap, slope in ((1.0, 0.0), (5.0, 1e-4)):
            floor = Floor(lambda lon, lat, gap=gap, slope=slope: DRAFT - gap - slope * metre * lon)
            model = aground(berg, floor, SOFT, latlon=True, period=360.0)
            assert model.elements.keel.floor_load.sum() == pytest.approx(1e-3 * (gap * area + slope * mx), rel=1e-5)


@pytest.mark.parametrize(("length", "bends"), [(0.66, False), (0.95, True)])
def test_ice_bends_where_it_is_longer_than_a_quarter_of_pi_characteristic_lengths(length: float, bends: bool) -> None:
    """Rasters of pads are whole: a little shorter and longer than that."""
    size = length * math.sqrt(2.0) * bending_length(9e9, 0.3, THICKNESS)
    floor = lambda x, y: DRAFT - 0.5 + 2e-6 * (x * x + y * y)  # noqa: E731
    stiff, soft = (Berg(2, 2, 0.5 * size).press(floor, ROCK | {"bending": on}).total for on in (False, True))
    assert (soft < 0.99 * stiff) == bends
    assert bends or soft == stiff


def test_several_bergs_are_cut_as_each_alone() -> None:
    """A larger one, turned, and a small one, which is two pads."""
    floor, loads = Floor(lambda x, y: DRAFT - 1.0 - 1e-4 * x), []
    bergs = [
        Iceberg.rectangle(*size, radius=0.5 * cell, thickness=THICKNESS, latlon=False, rotation=turn, placement=place)
        for size, cell, turn, place in (
            ((1500.0, 1000.0), 500.0, 23.0, (0.0, 0.0)),
            ((400.0, 200.0), 200.0, 11.0, (9e3, 0.0)),
        )
    ]
    for berg in (*bergs, Iceberg.join(bergs)):
        keel = aground(berg, floor, bed()).elements.keel
        loads.append(np.stack([keel.floor_load, keel.floor_hold, keel.base_xx, keel.base_xy, keel.base_yy]))
    assert (loads[2][2] > 0.0).all()
    assert np.array_equal(loads[2], np.concatenate(loads[:2], axis=1))


def test_bergs_that_land_at_once_go_as_each_alone() -> None:
    """Friction and slope of the floor act on the elements of each, and they look at the floor together.

    Where Newton's method does not find the friction in a few passes, sub-steps are ten times as many.
    """
    floor, ways, looks = Floor(lambda x, y: DRAFT - 1e-3 * (x - 700.0) - 5e-5 * y), [], []
    bergs = [
        Iceberg.rectangle(
            1500.0, 1000.0, radius=250.0, thickness=THICKNESS, latlon=False, placement=(0.0, y), velocity=at
        )
        for y, at in ((0.0, (0.3, 0.1)), (-4e3, (0.2, 0.2)), (5e3, (0.0, 0.05)))
    ]
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=bed(bending=False),
        fracture={"enabled": False},
    )  # fmt: skip
    for berg in (*bergs, Iceberg.join(bergs)):
        floor.asked.clear()
        model = Model(berg, floor, p)
        model.advance(steps=2)
        looks.append(len(floor.asked))
        assert model.motion.balance(model, model.remembered).momentum_error < 1e-12
        el = model.elements
        ways.append(
            np.stack([el.lon, el.lat, el.u, el.v, el.spin, el.keel.floor_x, el.keel.floor_y, el.keel.floor_load])
        )
    assert all(way[7].any() for way in ways)
    assert max(looks[:3]) <= looks[3] < 150
    np.testing.assert_allclose(ways[3], np.concatenate(ways[:3], axis=1), rtol=1e-10, atol=1e-12)


def test_the_least_clearance_of_several_bergs_is_that_of_the_one_that_lands() -> None:
    bergs = [
        Iceberg.rectangle(
            1500.0, 1000.0, radius=250.0, thickness=THICKNESS, latlon=False, placement=at, velocity=(u, 0.0)
        )
        for at, u in (((0.0, 0.0), 0.3), ((-1e3, 4e3), 0.0))
    ]
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=bed(bending=False),
        fracture={"enabled": False},
    )  # fmt: skip
    alone, together = (
        Model(berg, Floor(lambda x, y: DRAFT - 1e-3 * (x - 800.0)), p) for berg in (bergs[1], Iceberg.join(bergs))
    )
    for model in (alone, together):
        model.step()
    assert alone.groundings.clearance == pytest.approx(1.05)
    assert together.groundings.clearance == 0.0
    assert (together.elements.keel.floor_load[6:] == 0.0).all()


def test_a_berg_that_is_struck_as_the_sea_rises_keeps_the_marks_of_low_water() -> None:
    """How deep the bed yielded, and how stiff the largest load made its anchors: contact takes it through the step."""
    floor = lambda x, y: DRAFT - 1.0 + 1e-4 * x  # noqa: E731
    size: dict[str, Any] = {"radius": 250.0, "latlon": False}
    one = Iceberg.rectangle(1000.0, 1000.0, thickness=THICKNESS, **size)
    two = Iceberg.rectangle(
        1000.0, 1000.0, thickness=THICKNESS - 10.0, placement=(1005.0, 100.0), velocity=(-0.2, 0.0), **size
    )
    low = aground(one, Floor(floor, lambda time: -0.5), bed(bending=False)).elements.keel
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 60.0}, grounding=bed(bending=False),
        fracture={"enabled": False},
    )  # fmt: skip
    model = Model(Iceberg.join([one, two]), Floor(floor, lambda time: -0.5 if time < 60.0 else 0.0), p)
    model.step()
    keel = model.elements.keel
    assert model.elements.u[4:].min() > 0.0
    assert (keel.floor_hold[:4] < 0.7 * low.floor_hold).all()
    np.testing.assert_allclose(keel.floor_yield[:4], low.floor_yield, rtol=1e-6)
    np.testing.assert_allclose(keel.anchor_capacity[:4], low.floor_hold, rtol=1e-6)


def test_melt_of_the_sides_takes_its_part_of_each_element() -> None:
    berg = Iceberg.rectangle(2700.0, 1800.0, radius=450.0, thickness=THICKNESS, latlon=False, rotation=17.0)
    model = aground(berg, Floor(lambda x, y: DRAFT - 1.0), SOFT)
    whole, share = model.elements.keel.floor_load.copy(), np.linspace(0.7, 1.0, 6)
    for name in ("length", "width"):
        getattr(model.elements, name)[:] *= share
    model.elements.mass[:] *= share**2
    model.step()
    np.testing.assert_allclose(model.elements.keel.floor_load, share**2 * whole, rtol=1e-6)


@pytest.mark.parametrize("latitude", [-75.0, 0.3, 60.0])
def test_the_floor_is_asked_for_where_the_elements_lie(latitude: float) -> None:
    """On a slope along both axes, whose loads tell where they were asked for."""
    berg = Iceberg.rectangle(12e3, 8e3, radius=1000.0, thickness=THICKNESS, placement=(10.0, latitude), rotation=20.0)
    floor = lambda lon, lat: DRAFT - 5.0 - 3.0 * (lon - 10.0) - 7.0 * (lat - latitude)  # noqa: E731
    model = aground(berg, Floor(floor), SOFT, latlon=True, period=360.0)
    el = model.elements
    ratio = el.keel.floor_load / (DRAFT - floor(el.lon, el.lat))
    assert np.ptp(ratio) < 5e-6 * ratio.mean()


def balanced(berg: Berg, depth: Any, stiffness: float, strength: float) -> Any:
    """Find the rise at which water and bed carry a rigid berg; returns overlaps (m) and area (m2) of points, by element."""
    n = 80
    middles = (np.arange(n) + 0.5) / n - 0.5
    columns, rows = (round(side / berg.cell) for side in berg.size)
    i, j, a, b = np.meshgrid(np.arange(columns), np.arange(rows), middles, middles, indexing="ij")
    x, y = (i + 0.5 + a - 0.5 * columns) * berg.cell, (j + 0.5 + b - 0.5 * rows) * berg.cell
    (long, wide), dry, each = berg.size, DRAFT - depth(x, y), (berg.cell / n) ** 2
    # Against heave the water plane, against tilt its second moments, less what the height of the ice takes.
    lean = long * wide * DRAFT * 0.5 * (THICKNESS - DRAFT)
    hull = WATER * np.array([long * wide, long * wide**3 / 12.0 - lean, wide * long**3 / 12.0 - lean])

    def overlap(q: Any) -> Any:
        return dry - (q[0] + q[1] * y - q[2] * x)

    def residual(q: Any) -> Any:
        p = np.clip(stiffness * overlap(q), 0.0, strength) * each
        return q - np.array([p.sum(), (p * y).sum(), -(p * x).sum()]) / hull

    found = root(residual, np.array([0.1, 0.0, 0.0]), tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9
    return overlap(found.x).reshape(columns * rows, -1), each


@pytest.mark.parametrize("where", [{}, {"turn": 0.3, "shift": (700.0, -300.0)}])
def test_water_and_bed_carry_the_weight_together(where: dict[str, Any]) -> None:
    """Loads are the overlap up to the strength of the bed, friction is up to its shear strength, and what lies deeper yields."""
    berg, stiffness, strength, shear = Berg(8, 4, 500.0, **where), 2e4, 1e4, 2e3
    now = berg.press(tilted, bed(shear=shear, bending=False))
    over, each = balanced(berg, tilted, stiffness, strength)
    stress = stiffness * np.maximum(over, 0.0)
    asked = np.minimum(stress, strength).sum(axis=1) * each
    np.testing.assert_allclose(now.loads, asked, rtol=2e-3, atol=1e-4 * asked.max())
    grip = 0.4 * np.minimum(stress, shear / 0.4).sum(axis=1) * each
    np.testing.assert_allclose(now.hold, grip, rtol=2e-3, atol=1e-4 * asked.max())
    np.testing.assert_allclose(now.yielded, np.maximum(over.max(axis=1) - strength / stiffness, 0.0), rtol=0, atol=5e-3)
    assert (now.yielded > 0.0).any()
    assert (now.loads == 0.0).any()
    assert ((now.lift > 0.0) == (now.loads > 0.0)).all()


def test_the_base_of_an_element_turns_with_its_berg() -> None:
    """Variances of where it is borne, east and north: after a berg has turned, those of one that is placed as it lies then."""
    floor, size = Floor(lambda x, y: DRAFT - 3e-3 * (0.6 * x + y)), (1800.0, 900.0)
    shape: dict[str, Any] = {"radius": 450.0, "thickness": THICKNESS, "latlon": False}
    berg = Iceberg.rectangle(*size, **shape)
    berg.elements.v[:] = 1e-4 * berg.elements.lon
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=SOFT, fracture={"enabled": False}
    )  # fmt: skip
    model = Model(berg, floor, p)
    model.advance(steps=10)
    el = model.elements
    turn = math.atan2(*(np.diff(axis)[0] for axis in (el.lat, el.lon)))
    there = Iceberg.rectangle(*size, **shape, rotation=math.degrees(turn), placement=(el.lon.mean(), el.lat.mean()))
    bases = [np.stack([keel.base_xx, keel.base_xy, keel.base_yy])
             for keel in (el.keel, aground(there, floor, SOFT).elements.keel)]  # fmt: skip
    assert turn > 0.3
    assert abs(bases[1][1]).max() > 0.1 * bases[1][0].max()
    np.testing.assert_allclose(*bases, rtol=1e-3)


@pytest.mark.parametrize(("width", "tilts"), [(1.28, False), (1.33, True)])
def test_a_bar_takes_tilt_where_the_water_rights_it_by_half_of_what_its_plane_does(width: float, tilts: bool) -> None:
    """Across; the height of the ice takes ``H^2 / 14.1`` per area of the ``W^2 / 12`` of its water plane: from 1.30 H on."""
    across = width * THICKNESS
    rising = lambda x, y: DRAFT - 1e-3 * y  # noqa: E731
    berg = Berg(6, 1, across)
    over, each = balanced(berg, rising, 2e4, 1e9)
    loads = 2e4 * np.maximum(over, 0.0).sum(axis=1) * each
    now = berg.press(rising, bed(strength=1e9, bending=False))
    assert (now.total == pytest.approx(loads.sum(), rel=0.01)) == tilts
    assert now.total > 0.99 * loads.sum()


def test_a_ridge_under_the_sides_of_pads_is_felt_where_their_middles_are_clear() -> None:
    """It rises by 5 %: nine metres below the keel under the middles beside it."""
    side = pad_side(9e9)
    ridge = lambda x, y: DRAFT - 1.0 + 0.05 * np.abs(x - 0.75 * side)  # noqa: E731
    assert Berg(2, 1, 8.0 * side).press(ridge, SOFT).total == pytest.approx(1e-3 * 20.0 * 8.0 * side, rel=1e-3)


@pytest.mark.parametrize(("stiffness", "strength"), [(2e4, 1e4), (5e4, 1e6)])
@pytest.mark.parametrize(("columns", "error"), [(8, 0.02), (40, 0.04)])
def test_the_balance_is_that_of_an_independent_plate(
    stiffness: float, strength: float, columns: int, error: float
) -> None:
    """Sums over points of Gauss, a finer plate, and another Newton; of a berg that is narrow, turned and tilts to both sides.

    Pads of 362 m bear some 3 % less than the plate where it is long (of 188 m: 1 %).
    """
    berg, half = Berg(columns, 4, 500.0, turn=0.3), 250.0 * columns
    now = berg.press(lambda x, y: tilted(x + half - 2000.0, y), bed(stiffness=stiffness, strength=strength))
    x, y = PLATE.graded(2.0 * half, 125.0, 2000.0), np.linspace(0.0, 2000.0, 9)
    zone = PLATE.Zone(PLATE.floating_plate(x, y, 9e9), (0.0, 2.0 * half), (0.0, 2000.0))
    alone = zone.press(DRAFT - tilted(zone.x - 2000.0, zone.y - 1000.0), PLATE.Bed(stiffness, strength, friction=0.4))
    # The height of the ice takes 1.3 % of its stiffness against tilt across, which the plate leaves out.
    assert now.total == pytest.approx(alone.load, rel=error)
    assert now.hold.sum() == pytest.approx(alone.friction, rel=error)


def test_ice_that_hardly_bends_rests_as_a_rigid_body() -> None:
    rigid, stiff = (
        Berg(8, 4, 500.0, turn=0.3).press(tilted, bed(**how)) for how in ({"bending": False}, {"ice_modulus": 1e22})
    )
    np.testing.assert_allclose(stiff.loads, rigid.loads, rtol=1e-3, atol=1e-4 * rigid.total)
    long, floor = Berg(40, 8, 500.0), lambda x, y: tilted(x + 8000.0, y)
    assert long.press(floor, bed()).total < 0.9 * long.press(floor, bed(bending=False)).total


def test_a_rising_sea_lifts_the_keel_by_its_level_at_the_end_of_the_step() -> None:
    """Of a steady level, and of one that falls and rises within a step; on a bed that lifts nothing."""
    for levels in ((0.25, 0.25, 0.25), (0.0, -0.5, 0.75), (0.5, 0.5, -0.25)):
        level = lambda time, levels=levels: levels[round(time / 5e-4)]  # noqa: E731
        now = Berg(4, 3, 500.0).press(lambda x, y: DRAFT - 1.0, SOFT, level=level)
        np.testing.assert_allclose(now.loads, 1e-3 * 500.0**2 * (1.0 - levels[-1]), rtol=3e-6)


@pytest.mark.parametrize("where", [{"turn": 1.1}, {"turn": -2.6}, {"shift": (4e4, -7e4)}, {"turn": math.pi}])
def test_the_balance_does_not_depend_on_how_the_berg_lies(where: dict[str, Any]) -> None:
    """Pads are fixed along the axes of the fragment, so turned axes cut them otherwise: within 1 %."""
    here, there = Berg(8, 4, 500.0).press(tilted, bed()), Berg(8, 4, 500.0, **where).press(tilted, bed())
    assert there.total == pytest.approx(here.total, rel=1e-9 if "shift" in where else 0.01)
    mirrored = Berg(8, 4, 500.0).press(lambda x, y: tilted(x, -y), bed())
    assert mirrored.total == pytest.approx(here.total, rel=0.01)


@pytest.mark.compiled
def test_the_balance_does_not_depend_on_what_was_pressed_before() -> None:
    """Nor on which pads are watched: a run that is resumed surveys the floor elsewhere, and has made no plate yet.

    Knolls come under the keel one after the other as the sea falls, and leave it again.
    """
    knolls = [(a, b) for a in (-3e3, 0.0, 3e3) for b in (-2e3, 0.0, 2e3)]

    def floor(x: Any, y: Any) -> Any:
        tops = (0.5 + 0.3 * n for n in range(len(knolls)))
        return (
            DRAFT
            + 3.0
            - sum(
                (2.0 + top) * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2.0 * 300.0**2))
                for (a, b), top in zip(knolls, tops, strict=True)
            )
        )

    falls = [0.2, -0.6, -1.5, -0.3, 0.6, -1.5]
    berg, pressed = Berg(16, 8, 1000.0), []
    used = berg.press(floor, ROCK, level=lambda time: falls[min(round(time / 1e-3), len(falls) - 1)])
    for n in range(1, len(falls)):
        fresh = berg.press(floor, ROCK, level=lambda time, n=n: falls[n])
        pressed.append(np.count_nonzero(fresh.loads))
        np.testing.assert_allclose(
            used.model.elements.keel.floor_load, fresh.loads, rtol=1e-10, atol=1e-10 * fresh.total
        )
        used.model.step()
    assert len(set(pressed)) > 2


@pytest.mark.compiled
def test_a_long_front_bears_the_same_when_it_is_pressed_anew() -> None:
    """Its plate has elements of two ``lambda``: the finer one that was tried first leaves nothing behind."""
    berg, how, level = Berg(15, 20, 2000.0), ROCK | {"ice_modulus": 1e9}, [0.0]
    floor = lambda x, y: DRAFT - 1.6 + 1e-3 * (x + 15e3)  # noqa: E731
    used = berg.press(floor, how, level=lambda time: level[0])
    for rise in (0.001, 0.0):
        level[0] = rise
        used.model.step()
        fresh = berg.press(floor, how, level=lambda time, rise=rise: rise)
        loads = used.model.elements.keel.floor_load
        np.testing.assert_allclose(loads, fresh.loads, rtol=1e-10, atol=1e-10 * fresh.total)


@pytest.mark.parametrize("turn", [0.0, 10.0, 25.0, 45.0])
def test_a_corner_is_borne_by_the_plate_there_whatever_the_pads(turn: float) -> None:
    """Bug: pads that bore nothing yet were taken to bear at the middle of their overlap, and then took half of the load.

    The plate by finite elements has 4.92e9 N after 556 m. Pads lie otherwise in a berg that is turned.
    """
    c, s, loads = math.cos(math.radians(30.0)), math.sin(math.radians(30.0)), []
    berg, reach = Berg(6, 3, 3000.0, turn=math.radians(turn)), 9000.0 * c + 4500.0 * s
    for way in (400.0, 554.0, 620.0):
        floor = lambda x, y, way=way: DRAFT - 1e-3 * (x * c + y * s - reach + way)  # noqa: E731
        loads.append(berg.press(floor, ROCK).total / (1e-3 * way))
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
        reach = 0.5 * length * (abs(a) + abs(b))
        floor = lambda x, y, reach=reach: DRAFT - 1e-3 * (x * a + y * b - reach + way)  # noqa: E731
        loads.append(Berg(3, 3, length / 3.0).press(floor, ROCK).total / (1.0 if b else length))
    assert max(loads) < 1.03 * min(loads)


def test_ice_far_from_all_edges_bends_alike_wherever_it_is_loaded() -> None:
    """Over a knoll that lies likewise to the elements of the plate, and to those of the lattice."""
    length = bending_length(1e8, 0.3, THICKNESS)
    element = 4.0 * pad_side(1e8)
    loads = []
    for x, y in ((0.0, 0.0), (2.0 * element, 0.0), (-2.0 * element, 2.0 * element)):
        knoll = lambda u, v, x=x, y=y: 4.0 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2.0 * (0.5 * length) ** 2))  # noqa: E731
        now = Berg(8, 8, 2.0 * element).press(
            lambda u, v, knoll=knoll: DRAFT + 1.0 - knoll(u, v), ROCK | {"ice_modulus": 1e8}
        )
        loads.append(now.total)
    assert loads == pytest.approx([loads[0]] * 3, rel=5e-3)


def test_a_bar_narrower_than_a_pad_bends_as_much_whichever_way_it_crosses_the_raster() -> None:
    """By the second moments of the ice in each square, of both signs: along a diagonal of squares all of them are cut."""
    ahead, *askew = (
        Berg(25, 1, 400.0, turn=turn)
        .press(lambda x, y: DRAFT - 1e-3 * (x - 5000.0 + 300.0), ROCK | {"ice_modulus": 5e10})
        .total
        for turn in (0.0, 0.25 * math.pi, -0.25 * math.pi)
    )
    assert askew == pytest.approx([ahead] * 2, rel=0.004)


def test_a_long_bar_bears_at_its_far_end_as_at_its_near_one() -> None:
    """Where the raster of elements ends, beyond the ice, hardly anything bears: else the far end is stiffer by 1 %."""
    length = 60_260.0
    near, far = (
        Berg(20, 1, length / 20.0).press(lambda x, y, a=a: DRAFT - 1e-3 * (a * x - 0.5 * length + 300.0), ROCK)
        for a in (-1.0, 1.0)
    )
    assert far.total == pytest.approx(near.total, rel=0.005)


@pytest.mark.parametrize("gap", [1e-3, 1.0])
def test_a_berg_wholly_on_a_flat_bed_is_borne_by_all_of_it(gap: float) -> None:
    """More pads than bend one by one, and few: the bed bears the water that the berg does not displace."""
    for columns, rows, cell in ((6, 3, 3000.0), (7, 3, 600.0)):
        now = Berg(columns, rows, cell).press(lambda x, y: DRAFT - gap, ROCK)
        assert now.total == pytest.approx(WATER * columns * rows * cell**2 * gap, rel=0.005)


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
    floor = lambda x, y: DRAFT - 1e-3 * (wide + x - 1e3 * columns)  # noqa: E731
    load = Berg(columns, 5, 2e3).press(floor, ROCK | {"ice_modulus": modulus}).total
    assert load == pytest.approx(of_plate(f"ramp {width:g} λ wide, {modulus / 1e9:g} GPa, rock"), rel=0.03)


@pytest.mark.quick(2)
@pytest.mark.compiled
@pytest.mark.parametrize("sediment", ["rock", "sand", "clay"])
@pytest.mark.parametrize("modulus", [9e9, 1e9])
def test_a_bank_bears_what_the_plate_does(modulus: float, sediment: str) -> None:
    """The end quarter of 40 x 30 km on a floor that rises by 1e-3: thousands of pads, in squares of 2 lambda, bear too little."""
    how = {"sediment": sediment, "ice_modulus": modulus}
    now = Berg(20, 15, 2e3, turn=0.5 * math.pi).press(lambda x, y: DRAFT - 1e-3 * (x - 10e3), how)
    assert now.total == pytest.approx(of_plate(f"bank, {modulus / 1e9:g} GPa, {sediment}"), rel=0.09)


@pytest.mark.compiled
@pytest.mark.parametrize("sediment", ["rock", "sand", "clay"])
def test_a_bank_that_ends_along_elements_is_borne_whichever_way_the_berg_lies(sediment: str) -> None:
    """Bug: a pad that the floor grazed by 6e-16 m along an edge had its load at 0 / 0, and the heave "did not settle"."""
    floor = lambda x, y: DRAFT - 1e-3 * (x - 10e3)  # noqa: E731
    ahead, askew, across = (
        Berg(20, 15, 2e3, turn=turn).press(floor, {"sediment": sediment}) for turn in (0.0, 0.05, 0.5 * math.pi)
    )
    assert ahead.total == pytest.approx(across.total, rel=1e-3)
    # Squares that bend as one lie askew to the edges.
    assert askew.total == pytest.approx(of_plate(f"bank, 9 GPa, {sediment}"), rel=0.09)
    for now in (ahead, askew, across):
        assert np.isfinite(now.where).all()


@pytest.mark.compiled
@pytest.mark.parametrize(("columns", "rows", "turn"), [(13, 14, 0.906), (12, 15, 1.44)])
def test_stiff_ice_deep_in_rock_finds_its_balance(columns: int, rows: int, turn: float) -> None:
    """Bug: almost all of the rock yielded at first, corrections overshot by hundreds of metres, and the heave "did not settle".

    Squares that bend as one lie askew to the edges of a berg that is turned.
    """
    floor = lambda x, y: DRAFT - 20.0 - 1e-3 * (x - 1e3 * columns)  # noqa: E731
    here, there = (
        Berg(columns, rows, 2e3, turn=angle).press(floor, ROCK | {"start": "aground"}) for angle in (0.0, turn)
    )
    assert there.total == pytest.approx(here.total, rel=0.06)


@pytest.mark.compiled
@pytest.mark.parametrize("seed", range(12))
def test_a_floor_that_rises_bears_more_by_no_more_than_it_rises(seed: int) -> None:
    """The energy of a press is convex and has one least value, however little of a pad grazes the floor.

    On slopes, dimples and cliffs, with ice of up to 50 GPa up to 20 m deep in rock and sand.
    """
    rng = np.random.default_rng(seed)
    columns, rows, deep = *rng.integers(4, 13, 2).tolist(), 10.0 ** rng.uniform(-1.0, 1.3)
    turn, modulus, sediment = rng.uniform(0.0, 1.5), rng.choice([1e9, 9e9, 5e10]), rng.choice(["rock", "sand"])
    shape = (
        lambda x, y: 1e-3 * x,
        lambda x, y: 0.3 * deep * np.cos(x / 700.0) * np.cos(y / 900.0),
        lambda x, y: np.where(x > 200.0 * columns, 0.0, -40.0),
    )[seed % 3]
    how = {"sediment": str(sediment), "ice_modulus": float(modulus), "start": "aground"}
    low, high = (
        Berg(columns, rows, 2e3, turn=turn).press(lambda x, y, up=up: DRAFT - up * deep - shape(x, y), how).total
        for up in (1.0, 1.1)
    )
    assert 1.0 < high / low < 1.1 * (1.0 + 1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_bank_under_the_whole_berg_bears_the_water_of_its_volume(turn: float) -> None:
    """A uniform and a linear overlap bend nothing, wherever the edges lie on the raster of elements."""
    now = Berg(6, 4, 1000.0, turn=turn).press(lambda x, y: DRAFT - 2.0 - 4e-4 * x + 3e-4 * y, ROCK)
    assert now.total == pytest.approx(WATER * 24e6 * 2.0, rel=0.002)
    assert now.stress.max() < 1e3


def test_a_floor_of_second_order_is_seen_between_the_corners_of_pads() -> None:
    """A knoll of 5 cm and 500 m under the middle of the berg: its top may lie at no corner. A bed 1 m below bears nothing."""
    for cell in (1000.0, 900.0, 800.0):
        now = Berg(3, 3, cell).press(lambda x, y: DRAFT - 0.05 + 2e-7 * (x * x + y * y), SOFT)
        assert now.total == pytest.approx(1e-3 * 0.5 * 0.05 * math.pi * 500.0**2, rel=0.01)
    below = Berg(3, 3, 1000.0).press(lambda x, y: DRAFT + 1.0, bed())
    assert below.total == 0.0
    assert below.model._stepper.clearance == pytest.approx(1.0)


@pytest.mark.parametrize("drop", [5.0, 50.0, 500.0])
@pytest.mark.parametrize("width", [0.0, 400.0])
def test_the_edge_of_a_plateau_lifts_no_higher_than_its_top(drop: float, width: float) -> None:
    """But for a floor of second order (25 cm). A plane of the mean slope stood up to sixty metres inside the keel."""
    for edge in (-150.0, -50.0, 50.0, 150.0):
        floor = lambda x, y, e=edge: DRAFT - 1.0 + (drop + 1.0) * np.clip((e - x) / max(width, 1e-9), 0.0, 1.0)  # noqa: E731
        now = Berg(8, 2, 500.0).press(floor, ROCK)
        assert 0.98 < now.lift.max() < 1.26
        assert 26e9 < now.total < 39e9  # a pad more or less


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_shelf_that_ends_in_a_cliff_bears_no_farther_than_to_its_edge(turn: float) -> None:
    """And less by no more than the pads of 362 m across which it ends; on a bed that lifts nothing."""
    for edge in (-225.0, 0.0, 75.0, 225.0):
        floor = lambda x, y, edge=edge: np.where(x > edge, DRAFT - 1.0, DRAFT + 1000.0)  # noqa: E731
        borne = Berg(8, 2, 500.0, turn=turn).press(floor, SOFT).total / (1e-3 * 1000.0)
        assert 2000.0 - edge - 362.0 < borne <= 2000.0 - edge


@pytest.mark.parametrize("where", [0, 1])
def test_the_largest_loads_of_a_step_in_which_nothing_moves_are_those_of_its_end(where: int) -> None:
    """A slope pushes one of three elements away from its side: its torque on that element opens or closes the bonds, too."""
    floor = lambda x, y: DRAFT + 3.0 - 5e-3 * x - 1e-2 * y + 20.0 * (1e-3 * x - where) ** 4  # noqa: E731
    now = Berg(3, 1, 1000.0).press(floor, ROCK)
    keel, bonds = now.model.elements.keel, now.model.bonds
    torque = keel.floor_arm_x * keel.floor_y - keel.floor_arm_y * keel.floor_x
    assert np.abs(torque).max() > 50.0 * np.hypot(keel.floor_x, keel.floor_y).max()
    np.testing.assert_allclose(bonds.peak_stress, np.maximum(bonds.normal_stress, 0.0), rtol=1e-5)
    assert bonds.normal_stress.max() > 100.0


def test_the_floor_of_a_plane_that_repeats_is_asked_for_within_its_period() -> None:
    """A bank was asked for at places beyond the channel. Three periods on a berg bears the same."""
    loads = []
    for lap in (0, 3):
        sea = Floor(lambda x, y: DRAFT - 0.5 + 1e-9 * (x - 20.0e3) ** 2)
        berg = Iceberg.rectangle(4e3, 2e3, radius=500.0, thickness=THICKNESS, latlon=False, placement=(20.0e3, 0.0))
        model = aground(berg, sea, bed(), period=40.3e3)
        model.elements.lon[:] += 40.3e3 * lap
        sea.asked.clear()
        model.step()
        loads.append(model.elements.keel.floor_load.copy())
        assert np.abs(np.concatenate(sea.asked, axis=1)[0] - 20e3).max() < 0.51 * 40.3e3
    np.testing.assert_allclose(loads[1], loads[0], rtol=1e-9)


def level_floor(depth: float) -> Floor:
    """Return a level floor, which the middles of elements know too."""
    sea = Floor(lambda x, y: depth + 0.0 * x)
    object.__setattr__(sea, "water", depth)
    return sea


def test_the_floor_is_asked_for_once_where_pads_of_an_element_meet() -> None:
    """It was asked for at each corner of each pad, twice as often in all."""
    sea = level_floor(DRAFT - 0.5)
    model = aground(Berg(1, 1, 3e3).iceberg(), sea, bed())
    sea.asked.clear()
    model.step()
    under_pads = max(sea.asked, key=lambda points: points.shape[1])
    assert 100 < under_pads.shape[1] == np.unique(under_pads, axis=1).shape[1]


@pytest.mark.parametrize("gap", [0.5, 1.5])
def test_a_berg_that_goes_close_above_the_floor_asks_for_it_twice_a_step(gap: float) -> None:
    """In the middle of the step, and at its end."""
    sea = level_floor(DRAFT + gap)
    berg = Iceberg.rectangle(2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, velocity=(0.3, 0.0))
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=bed(), fracture={"enabled": False}
    )  # fmt: skip
    model = Model(berg, sea, p)
    model.step()
    sea.asked.clear()
    model.step()
    looks = [points.shape[1] for points in sea.asked]
    assert looks.count(max(looks)) == 2


def test_a_lone_berg_high_above_the_floor_asks_for_it_no_more() -> None:
    """A crumb of A68a asked at two hundred pads in each step, as a floor with a slope of one half could come under it."""
    sea = level_floor(DRAFT + 100.0)
    model = aground(Berg(1, 1, 3e3).iceberg(), sea, bed())
    sea.asked.clear()
    model.step()
    assert all(points.shape[1] == 1 for points in sea.asked)
    assert model._stepper.clearance == pytest.approx(100.0)


def test_land_of_no_known_depth_is_dry_for_the_bed() -> None:
    """It was 10 km deep, as what lies beyond all data: a keel went over the coast as if nothing were there.

    Beyond the data it is as deep as the deepest that is known.
    """
    known = lambda x: np.where(x < -1.5e3, DRAFT - 1.0, 300.0)  # noqa: E731
    sea = Floor(lambda x, y: np.where(x < 0.0, known(x), np.nan), dry=lambda x, y: (x >= 0.0) & (x < 4e3))
    berg = Iceberg.rectangle(10e3, 3e3, radius=500.0, thickness=THICKNESS, latlon=False, placement=(2e3, 0.0))
    model = aground(berg, sea, SOFT)
    el = model.elements
    on_land = (el.lon > 1e3) & (el.lon < 3e3)
    np.testing.assert_allclose(el.keel.floor_load[on_land], 1e-3 * 1e6 * DRAFT, rtol=1e-3)
    np.testing.assert_allclose(el.keel.floor_load[el.lon < -2e3], 1e-3 * 1e6, rtol=1e-3)
    assert (el.keel.floor_load[el.lon > 5e3] == 0.0).all()


@pytest.mark.parametrize("thickness", [100.0, 250.0])
def test_ice_bends_over_the_length_of_a_floating_plate(thickness: float) -> None:
    """``(E H^3 / (12 (1 - nu^2) rho g))^(1/4)``."""
    rigidity = 2e9 * thickness**3 / (12.0 * (1.0 - 0.3**2))
    assert bending_length(2e9, 0.3, thickness) == pytest.approx((rigidity / WATER) ** 0.25, rel=1e-12)


def bent(
    *knolls: tuple[float, float], turn: float = 0.0, reach: float = 600.0, thicker: float = 0.0
) -> set[tuple[int, int]]:
    """Return the bonds that bend over knolls (m from the corner) under a berg of 6 by 5 elements of 500 m, 200 m thick.

    Elements are numbered along the rows; the ice bends over ``reach`` (m), the characteristic length lambda. ``thicker``: by how
    much the elements in the three columns at the other end are, over a deep floor, m.
    """
    c, s = math.cos(turn), math.sin(turn)
    shape: dict[str, Any] = {"radius": 250.0, "latlon": False, "rotation": math.degrees(turn)}
    draft = 850.0 / 1025.0 * 200.0

    def thick(lon: Any, lat: Any) -> Any:
        return np.where(c * lon + s * lat > -1.0, 200.0 + thicker, 200.0)

    def floor(lon: Any, lat: Any) -> Any:
        x, y = c * lon + s * lat + 1500.0, c * lat - s * lon + 1250.0
        return (
            draft
            + 1.0
            + np.where(x > 1400.0, thicker, 0.0)
            - sum(4.0 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2.0 * (0.1 * reach) ** 2)) for a, b in knolls)
        )

    el = Iceberg.rectangle(3000.0, 2500.0, thickness=200.0, **shape).elements
    berg = Iceberg.rectangle(3000.0, 2500.0, thickness=thick(el.lon, el.lat), **shape)
    mean = 200.0 + 0.5 * thicker
    stiffness = (reach / math.sqrt(2.0)) ** 4 * WATER * 12.0 * (1.0 - 0.3**2) / mean**3
    model = aground(berg, Floor(floor), ROCK | {"ice_modulus": stiffness})
    el, b = model.elements, model.bonds
    column = np.round((c * el.lon + s * el.lat + 1250.0) / 500.0).astype(int)
    row = np.round((c * el.lat - s * el.lon + 1000.0) / 500.0).astype(int)
    number = 6 * row + column
    ends = np.sort(np.stack([number[b.first], number[b.second]], axis=1)[b.flexural_stress > 0.0], axis=1)
    return set(map(tuple, ends.tolist()))


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_ice_over_a_knoll_is_stressed_most_at_a_corner_and_least_inside(turn: float) -> None:
    """A little less than by a force N at the tip, 3 N / H^2; at an edge by a quarter of that, inside by a fifth, off all axes."""
    stiffness = (600.0 / math.sqrt(2.0)) ** 4 * WATER * 12.0 * (1.0 - 0.3**2) / THICKNESS**3
    for x, y, low, high in ((1490.0, 1240.0, 0.8, 0.9), (1490.0, 500.0, 0.24, 0.28), (300.0, 400.0, 0.17, 0.21)):
        knoll = lambda u, v, x=x, y=y: 4.0 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2.0 * 60.0**2))  # noqa: E731
        berg = Berg(6, 5, 500.0, turn=turn)
        now = berg.press(lambda u, v, knoll=knoll: DRAFT + 1.0 - knoll(u, v), ROCK | {"ice_modulus": stiffness})
        assert low < now.stress.max() / (3.0 * now.total / THICKNESS**2) < high
        assert now.stress.max() == now.model.bonds.flexural_stress.max()
        assert ((now.stress > 0.0) == (now.loads > 0.0)).all()


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_loaded_corner_breaks_off_with_what_lies_within_the_largest_moment(turn: float) -> None:
    """To pi lambda / 4 (471 m) from the loads, or the loaded elements alone where they are larger than that."""
    assert bent((10.0, 10.0), turn=turn) == {(0, 1), (0, 6)}
    assert bent((10.0, 10.0), turn=turn, reach=200.0) == {(0, 1), (0, 6)}
    # A longer reach takes both neighbours along: their centres are 778 m away, at 0.99 km times pi / 4.
    assert bent((10.0, 10.0), turn=turn, reach=950.0) == {(0, 1), (0, 6)}
    assert bent((10.0, 10.0), turn=turn, reach=1000.0) == {(1, 2), (1, 7), (6, 7), (6, 12)}


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.1])
def test_a_corner_of_a_berg_that_is_thicker_elsewhere_breaks_off_where_it_is_loaded(turn: float) -> None:
    """The centre of its mass lies 375 m beside the middle of its footprint."""
    for thicker in (0.0, 400.0):
        assert bent((10.0, 10.0), turn=turn, thicker=thicker) == {(0, 1), (0, 6)}


def test_a_front_breaks_off_along_its_length_and_groups_by_themselves() -> None:
    assert bent(*((250.0 + 500.0 * n, 10.0) for n in range(6))) == {(n, n + 6) for n in range(6)}
    assert bent((10.0, 10.0), (2990.0, 2490.0)) == {(0, 1), (0, 6), (28, 29), (23, 29)}


def test_a_load_inside_cracks_the_ice_along_its_line() -> None:
    """Under it and a characteristic length beyond its ends; no piece is cut out of the berg."""
    assert bent((1150.0, 990.0), (1350.0, 990.0)) == {(n, n + 6) for n in (7, 8, 9)}


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_load_inside_cracks_the_ice_along_its_line_whatever_that_crosses(turn: float) -> None:
    """Two knolls askew to the lattice: the bonds across their line, as far as a characteristic length beyond them."""
    assert bent((1100.0, 1350.0), (1400.0, 1650.0), turn=turn, reach=450.0) == {(13, 14), (14, 20), (20, 21)}


def test_ice_cracks_along_its_loads_where_three_quarters_of_what_lies_around_is_ice() -> None:
    """Else the edge beside them breaks off.

    Of the weights ``(1 - r^2)^2`` on a half plane, r over the reach, 0.73 lie on the ice of an edge at 0.24, 0.77 at 0.29; of
    its squares here 0.69 and 0.81.
    """
    reach = 1000.0
    near, far = (bent((1150.0, share * reach), (1850.0, share * reach), reach=reach) for share in (0.24, 0.29))
    across, behind = {(n, n + 6) for n in (1, 2, 3, 4)}, {(n, n + 6) for n in (7, 8, 9)}
    assert across <= far
    assert not far & behind
    assert behind <= near
    assert not near & across


def test_a_flat_floor_bears_each_element_in_its_middle() -> None:
    """Also of a berg whose centre of mass lies beside the middle of its footprint, along either side."""
    for turn in (0.0, 0.5 * math.pi, 0.7):
        thickness = lambda x, y, turn=turn: THICKNESS + 20.0 * (math.sin(turn) * x + math.cos(turn) * y > 0.0)  # noqa: E731
        berg = Iceberg.rectangle(2e3, 2e3, radius=250.0, thickness=THICKNESS, latlon=False)
        el = berg.elements
        berg = Iceberg.rectangle(2e3, 2e3, radius=250.0, thickness=thickness(el.lon, el.lat), latlon=False)
        keel = aground(berg, Floor(lambda x, y: DRAFT - 1.0), SOFT).elements.keel
        assert (keel.floor_load > 0.0).all()
        np.testing.assert_allclose([keel.floor_arm_x, keel.floor_arm_y], 0.0, atol=1e-3)


def test_friction_takes_the_same_whichever_way_a_berg_slides() -> None:
    """By the ledger, on a flat floor."""
    works = []
    for turn in (0.0, 0.5 * math.pi, 0.7):
        berg = Iceberg.rectangle(
            2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, rotation=math.degrees(turn),
            velocity=(0.3 * math.cos(turn), 0.3 * math.sin(turn)),
        )  # fmt: skip
        p = Parameters(
            earth={"latlon": False, "period": 0.0}, stepping={"time_step": 60.0}, grounding=bed(bending=False),
            fracture={"enabled": False},
        )  # fmt: skip
        model = Model(berg, Floor(lambda x, y: DRAFT - 0.01), p)
        model.advance(steps=4)
        ledger = model.motion.balance(model, model.remembered)
        assert ledger.rubbed == pytest.approx(-ledger.work["sea_floor"], rel=0.02)
        works.append(ledger.rubbed)
    np.testing.assert_allclose(works, works[0], rtol=1e-6)


def test_a_berg_lands_alike_whichever_way_it_goes() -> None:
    """Ways, loads and sub-steps, from before the touch until it stands."""
    runs = []
    for turn in (0.0, 0.5 * math.pi, 0.7):
        c, s = math.cos(turn), math.sin(turn)
        berg = Iceberg.rectangle(
            1800.0, 900.0, radius=450.0, thickness=THICKNESS, latlon=False, rotation=math.degrees(turn),
            velocity=(0.3 * c, 0.3 * s),
        )  # fmt: skip
        p = Parameters(
            earth={"latlon": False, "period": 0.0}, stepping={"time_step": 60.0}, grounding=bed(bending=False),
            fracture={"enabled": False},
        )  # fmt: skip
        model = Model(berg, Floor(lambda x, y, c=c, s=s: DRAFT - 5e-3 * (c * x + s * y - 930.0)), p)
        steps = []
        for _ in range(30):
            model.step()
            el = model.elements
            steps.append([c * el.lon.mean() + s * el.lat.mean(), el.keel.floor_load.sum(), el.keel.floor_substep.max()])
        runs.append(np.array(steps))
    _, load, substep = runs[0].T
    assert load[0] == 0.0 < load[1]
    assert substep[-1] == 1e9 > substep[load > 0.0].min()
    for run in runs[1:]:
        np.testing.assert_allclose(run, runs[0], rtol=1e-5)


def test_the_bed_keeps_how_deep_it_yielded_as_the_sea_rises() -> None:
    """Under a berg that stands, and under one that slides on."""
    for speed in (0.0, 0.3):
        berg = Iceberg.rectangle(2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, velocity=(speed, 0.0))
        p = Parameters(
            earth={"latlon": False, "period": 0.0}, stepping={"time_step": 60.0}, fracture={"enabled": False},
            grounding=bed(strength=2e3, bending=False),
        )  # fmt: skip
        model = Model(berg, Floor(lambda x, y: DRAFT - 1.0, lambda time: 1e-3 * time), p)
        model.step()
        low = model.elements.keel.floor_yield.copy()
        assert (low > 0.0).all()
        for _ in range(5):
            model.step()
        np.testing.assert_array_equal(model.elements.keel.floor_yield, low)


@pytest.mark.parametrize("depth", [100.0, 110.0, 120.0, 140.0])
def test_the_least_clearance_is_that_under_the_berg_near_and_far_from_the_floor(depth: float) -> None:
    """Over a slope that some pads or none come near: by their corners, or by the middles of elements, half of one aside."""
    slope, side = 2e-3, 3000.0
    berg = Iceberg.rectangle(6e3, 6e3, thickness=100.0, placement=(0.0, -76.0), radius=0.5 * side)
    model = Model(berg, Forcing.uniform((0.08, 0.0)) + Forcing.slope((0.0, -76.0), 90.0, slope, depth), Parameters())
    model.advance(days=0.25)
    edge = (
        depth - slope * side - 100.0 * 850.0 / 1025.0
    )  # at the start, half an element beside the middles of the last ones
    assert edge < model.groundings.clearance < edge + 0.5 * slope * side + 0.05


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


@pytest.mark.parametrize("towards", [0.0, 90.0, 180.0, 270.0])
def test_a_knoll_some_kilometres_aside_leaves_the_way_open_on_whichever_side_it_lies(towards: float) -> None:
    """The soundings around the berg reach it, its pads need no look: the clearance is that under the berg."""
    x, y = 12e3 * math.cos(math.radians(towards)), 12e3 * math.sin(math.radians(towards))
    knoll = Forcing.seamount((x, y), height=650.0, width=1e3, depth=700.0, latlon=False)
    berg = Iceberg.rectangle(2e3, 2e3, radius=500.0, thickness=THICKNESS, latlon=False)
    model = aground(berg, Forcing.uniform(latlon=False, latitude=0.0) + knoll, bed())
    assert model.groundings.clearance == pytest.approx(700.0 - DRAFT, rel=1e-9)


@pytest.mark.parametrize(("gradient", "rise"), [(1e-3, 0.0), (1e-2, 0.0), (1e-3, 1e-5)])
def test_a_berg_comes_to_rest_in_some_tens_of_looks_at_the_floor(gradient: float, rise: float) -> None:
    """From 0.3 m/s by tenths of its speed down to millimetres a second; held, it needs the end of a step alone.

    So it does where the sea rises (m s-1).
    """
    sea = Floor(lambda x, y: DRAFT - gradient * (x - 1e3), level=lambda time: rise * time)
    berg = Iceberg.rectangle(2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, velocity=(0.3, 0.0))
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=bed(bending=False),
        fracture={"enabled": False},
    )  # fmt: skip
    model = Model(berg, sea, p)
    model.advance(steps=4)
    assert np.abs(model.elements.u).max() < 1e-5
    assert len(sea.asked) < 2.0 * math.log(0.3 / 1e-3) / math.log(1.1)
    looks = len(sea.asked)
    model.step()
    assert len(sea.asked) - looks == 1


def test_a_sliding_berg_bears_what_one_bears_that_is_placed_there() -> None:
    """Its loads at the end of a step are those of where it is then."""
    floor = lambda x, y: DRAFT - 1e-3 * (x - 1e3)  # noqa: E731
    berg = Iceberg.rectangle(2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, velocity=(0.3, 0.0))
    how = bed(bending=False)
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 300.0}, grounding=how, fracture={"enabled": False}
    )  # fmt: skip
    model, loads = Model(berg, Floor(floor), p), []
    for _ in range(3):
        model.step()
        el = model.elements
        there = Iceberg.rectangle(
            2e3, 1e3, radius=250.0, thickness=THICKNESS, latlon=False, placement=(float(el.lon.mean()), 0.0)
        )
        placed = aground(there, Floor(floor), how)
        np.testing.assert_allclose(el.keel.floor_load, placed.elements.keel.floor_load, rtol=1e-5)
        loads.append(el.keel.floor_load.sum())
    assert loads[0] < loads[1] < loads[2]


@pytest.mark.parametrize("change", ["nothing", "level", "thickness", "thickness of a bar", "sides", "neighbour"])
def test_a_berg_that_stands_still_bears_what_it_bears_pressed_anew(change: str) -> None:
    """The last press is kept: a model without one goes the same way to the last digit, whatever changes of a held berg."""
    rise = 0.02 if change == "level" else 0.0
    # On a flat floor they change no depth that is asked for.
    gradient = 5e-4 if change in ("nothing", "thickness", "neighbour") else 0.0
    sea = Floor(lambda x, y: DRAFT - 1.0 + gradient * (x - 2e3), level=lambda time: rise * math.sin(time / 7e3))
    berg = Iceberg.rectangle(4e3, 2e3, radius=500.0, thickness=THICKNESS, latlon=False)
    if change == "thickness of a bar":  # that the water does not right: its hull hangs on its area alone
        berg = Iceberg.rectangle(4e3, 250.0, radius=125.0, thickness=THICKNESS, latlon=False)
    if change == "neighbour":  # whose pads come before and behind it on the way
        light = Iceberg.rectangle(2e3, 2e3, radius=500.0, thickness=THICKNESS + 0.5, latlon=False, placement=(5e3, 0.0))
        berg = Iceberg.join([light, berg])
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, stepping={"time_step": 600.0}, grounding=ROCK, fracture={"enabled": False}
    )  # fmt: skip

    def melt(model: Model) -> None:
        body = model.elements.body
        if "thickness" in change:
            body.thickness[:] -= 0.01
            body.mass[:] *= body.thickness / (body.thickness + 0.01)
        elif change == "sides":
            for side in (body.length, body.width, body.mass):
                side *= 0.999

    def run(*, forgets: bool) -> list[np.ndarray]:
        """Return the keels in twelve steps, of a model that looks at the floor anew in each where it ``forgets``."""
        model, keels = Model(berg, sea, p), []
        model.after_step.append(melt)
        for _ in range(12):
            model.step()
            keels.append(np.array(model.elements.keel))
            if forgets:
                copy.deepcopy(model)  # a model that is copied or saved goes on as its copy does
        return keels

    kept, anew = run(forgets=False), run(forgets=True)
    np.testing.assert_array_equal(kept, anew)
    loads = [float(keel[0].sum()) for keel in kept[6:]]
    assert loads[0] > 0.0
    assert (np.ptp(loads) > 0.0) == (change not in ("nothing", "neighbour"))
