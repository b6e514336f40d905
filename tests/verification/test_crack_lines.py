"""What breaks, and where the crack goes, whatever the lattice: criteria of the ice and crack lines in elastic cells.

Plates are pulled apart from their middle, by forces that grow as sin(pi x / L): the tension is largest on the middle line, and
1.025 of the mean there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.fragments.connectivity import bridge_moments, connected_parts, find_bridges
from riftberg.state import Floats
from verification.plates import RADIUS, SPACING, STRENGTH, THICKNESS, Plate
from verification.test_cracks_in_cells import edge_factor

ANGLES = (0.0, 15.0, 22.5, 30.0, 45.0)
LATTICES = [(packing, angle) for packing in ("square", "hexagonal") for angle in ANGLES]
SOME = [("square", 22.5), ("hexagonal", 15.0)]
QUICK = [pytest.param(*one, marks=() if one in SOME else pytest.mark.slow) for one in LATTICES]
DEAR = [pytest.param(*one, marks=() if one == ("hexagonal", 15.0) else pytest.mark.slow) for one in LATTICES]


def pulled_from_the_middle(plate: Plate, length: float) -> Floats:
    return plate.el.mass * np.sin(np.pi * plate.x / length)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_last_bond_bears_is_the_balance_of_the_part_beyond_it(seed) -> None:
    """Against taking each bond out and adding up the loads on one side, with supports in some of the graphs."""
    rng = np.random.default_rng(seed)
    count = 24
    first = np.array([int(rng.integers(0, n)) for n in range(1, count)] + [2, 7, 5])
    second = np.array([*range(1, count), 9, 20, 11])
    intact = np.flatnonzero(rng.random(first.size) < 0.9)
    xy, load = rng.normal(size=(count, 2)), rng.normal(size=(count, 3))
    held = rng.random(count) < (0.1 if seed % 2 else 0.0)
    shift = rng.normal(size=intact.size)  # of the faces along themselves
    whole = np.ones(first.size, np.int64)
    whole[intact] = 0
    found, moments, bridges = (
        find_bridges(first, second, intact, count),
        np.zeros(intact.size),
        np.zeros(intact.size, bool),
    )
    moments[found.bond], bridges[found.bond] = bridge_moments(found, first, second, intact, xy, load, held, shift), True
    seen = 0
    for k, bond in enumerate(intact):
        parted = whole.copy()
        parted[bond] = 1
        part = connected_parts(count, first, second, parted)
        sides = [part == part[first[bond]], part == part[second[bond]]]
        free = [side for side in sides if not held[side].any()]
        assert bridges[k] == (part[first[bond]] != part[second[bond]])
        if not bridges[k] or not free:
            assert moments[k] == 0.0
            continue
        way = xy[second[bond]] - xy[first[bond]]
        arm = xy - 0.5 * (xy[first[bond]] + xy[second[bond]]) - shift[k] * np.array([-way[1], way[0]])
        about = load[:, 2] + arm[:, 0] * load[:, 1] - arm[:, 1] * load[:, 0]
        assert any(moments[k] == pytest.approx(about[side].sum(), rel=1e-10) for side in free)
        seen += 1
    assert seen > 3


@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_strength_is_the_same_on_every_lattice(packing, angle) -> None:
    """A plate of 48 x 16 cells breaks where its tension reaches the strength, within 3 %, at the middle line."""
    plate = Plate(packing, angle, 72e3, 24e3)
    pull = pulled_from_the_middle(plate, 72e3)
    moment = plate.under(pull)
    bond, ratio = plate.critical(moment)
    mean = pull[plate.x > 0.0].sum() / (24e3 * THICKNESS)
    assert ratio * STRENGTH / mean == pytest.approx(1.025, rel=0.03)
    assert abs(plate.x[[plate.bonds.first[bond], plate.bonds.second[bond]]].mean()) < 4.0 * SPACING
    # Pushed together it bears any load.
    assert plate.critical(plate.under(-pull))[1] < 0.5 * ratio


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_plate_that_fails_parts_straight_across(packing, angle) -> None:
    """At 1.02 of the load of its first break: a line within 2 degrees of the middle line, no crumbs."""
    plate = Plate(packing, angle, 72e3, 24e3)
    pull = pulled_from_the_middle(plate, 72e3)
    pull *= 1.02 / plate.critical(plate.under(pull))[1]
    breaks = 0
    while breaks < 50:
        moment = plate.under(pull)
        bond, ratio = plate.critical(moment)
        if ratio <= 1.0:
            break
        plate.break_next(moment, bond)
        breaks += 1
    sizes = np.sort(np.bincount(plate.body))[::-1]
    assert sizes[1] > 0.45 * plate.el.size
    assert sizes.size == 2
    # A straight cut takes 16 bonds of squares in line, and 31 of hexagons.
    assert breaks <= (23 if packing == "square" else 38)
    ends = plate.line(1)[[0, -1]]
    along = (ends[1] - ends[0]) * np.sign((ends[1] - ends[0])[1])
    assert np.degrees(np.arctan2(*along)) == pytest.approx(0.0, abs=2.0)


def cracked_plate(packing: str, angle: float, inclined: float, **fracture: Any) -> Plate:
    """A plate of 48 x 48 cells with a crack of 8 cells in its middle, ``inclined`` (degrees) to the normal of the pull."""
    berg = Iceberg.rectangle(
        72e3, 72e3, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
    )
    t = np.radians(inclined)
    half = 4.0 * SPACING * np.array([np.sin(t), np.cos(t)])
    # Beside the middle, where a row of elements may lie.
    line = np.array([half, -half]) + np.array([0.21 * SPACING, 0.13 * SPACING])
    cut = berg.with_rifts([line], broken=True)
    return Plate(packing, angle, 72e3, 72e3, cut, **fracture)


@pytest.mark.slow
@pytest.mark.parametrize(
    "inclined", [0.0, pytest.param(30.0, marks=pytest.mark.slow), pytest.param(45.0, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(("packing", "angle"), DEAR)
def test_a_crack_goes_on_normal_to_the_tension(packing, angle, inclined) -> None:
    """Both tips advance in turn, 8 cells each: the chord is within 3 degrees of the normal, inclined cracks within 5."""
    plate = cracked_plate(packing, angle, inclined)
    assert plate.tips.crack.size == 2
    began = [tip.place.copy() for tip in plate.now.paths.standing()]
    pull = plate.el.mass * np.sign(plate.x) * (abs(plate.x) > 33e3)
    while True:
        moment = plate.under(pull)
        paths = moment.paths
        standing = paths.standing()
        ways = [float(np.hypot(*(tip.place - start))) for tip, start in zip(standing, began, strict=True)]
        if min(ways) >= 8.0 * SPACING:
            break
        tip = standing[int(np.argmin(ways))]
        crossing = paths.find_crossing(tip, moment.triangle_stress, moment.intensities.get(tip.row))
        assert crossing is not None
        paths._step(crossing.tip, crossing.bond, crossing.fraction)
        plate.without(crossing.bond)
    for tip, start in zip(standing, began, strict=True):
        along = (tip.place - start) * np.sign((tip.place - start)[1])
        assert np.degrees(np.arctan2(along[0], along[1])) == pytest.approx(0.0, abs=3.0 if inclined == 0.0 else 5.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_long_crack_runs_at_its_toughness(packing, angle) -> None:
    """K = s sqrt(pi a) in a wide plate, with the factor of its width: within 16 % for a crack of 8 cells in the middle."""
    plate, twice = (
        cracked_plate(
            packing, angle, 0.0, criterion="toughness", toughness=k, normal_strength=1e12, shear_strength=1e12
        )
        for k in (1e5, 2e5)
    )
    pull = plate.el.mass * np.sign(plate.x) * (abs(plate.x) > 33e3)
    remote = pull[plate.x > 0.0].sum() / (72e3 * THICKNESS)
    half = 0.5 * float(plate.tips.length[0]) + 0.5 * SPACING
    share = 2.0 * half / 72e3
    intensity = remote * np.sqrt(np.pi * half) * np.sqrt(1.0 / np.cos(0.5 * np.pi * share))
    ratio = plate.critical(plate.under(pull))[1]
    assert intensity / (1e5 * ratio) == pytest.approx(1.0, abs=0.16)
    # Twice the toughness bears twice the load; the strength has no part in it.
    assert twice.critical(twice.under(2.0 * pull))[1] == pytest.approx(ratio)


EDGES = [
    pytest.param(
        packing, angle, cells, limit, marks=() if (packing, angle, cells) == ("square", 22.5, 8) else pytest.mark.slow
    )
    for packing, angle in LATTICES
    for cells, limit in ((8, 0.04), (16, 0.04))
]


@pytest.mark.slow
@pytest.mark.parametrize(("packing", "angle", "cells", "limit"), EDGES)
def test_a_crack_from_the_edge_runs_at_the_k_of_the_handbook(packing, angle, cells, limit) -> None:
    """Width W = 3.75 a, length 3 W, free ends: mean over four advances, from 8 cells on within 4 % of K (`edge_factor`)."""
    width = 3.75 * cells * SPACING
    length, found = 3.0 * width, []
    for depth in (cells + np.arange(4)) * SPACING:
        whole = Iceberg.rectangle(
            length, width, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
        )
        # Beside the middle, where a row of elements may lie.
        line = [(0.21 * SPACING, -0.6 * width), (0.21 * SPACING, depth - 0.5 * width)]
        plate = Plate(
            packing, angle, length, width, whole.with_rifts([line], broken=True),
            criterion="toughness", toughness=1e5, normal_strength=1e12, shear_strength=1e12,
        )  # fmt: skip
        pull = np.zeros(plate.el.size)
        for sign in (-1.0, 1.0):  # without a moment about the middle line, over the last three cells
            mass = plate.el.mass * (sign * plate.x > 0.5 * length - 3.0 * SPACING)
            mass *= 1.0 - (mass * plate.y).sum() / (mass * plate.y**2).sum() * plate.y
            pull += sign * mass * (1e3 * width * THICKNESS / mass.sum())
        # The crack ends where the facet of its last broken bond does.
        b = plate.bonds
        across = abs(plate.x[b.first] - plate.x[b.second]) * plate.now.cells.facet[b.first]
        ends = 0.5 * (plate.y[b.first] + plate.y[b.second] + across)
        a = float(ends[b.status != 0].max()) + 0.5 * width
        intensity = 1e3 * np.sqrt(np.pi * a) * edge_factor(a / width)
        bond, ratio = plate.critical(plate.under(pull))
        found.append(1e5 * ratio / intensity)
        near = plate.y[[b.first[bond], b.second[bond]]].mean() + 0.5 * width
        assert abs(near - a) < 1.5 * SPACING  # at the tip, not elsewhere
    assert np.mean(found) == pytest.approx(1.0, abs=limit)


def test_a_tip_at_a_crack_or_at_the_outline_has_run_out() -> None:
    plate = Plate("square", 0.0, 15e3, 15e3)
    first, second = plate.bonds.first, plate.bonds.second
    # A crack along x = 0.3 from edge to edge but for its last bond, and a tip that comes upon it.
    crossed = (plate.x[first] - 0.3) * (plate.x[second] - 0.3) < 0.0
    rows = np.flatnonzero(crossed & (plate.y[first] < plate.y.max()))
    plate.bonds.crack[rows] = 7
    for bond in rows:
        plate.bonds.status[bond] = 1
    start = int(np.flatnonzero((plate.y[first] == plate.y[second]) & (plate.x[first] < -2e3))[0])
    tip_rows = (
        np.array([[plate.el.body.id[first[start]], plate.el.body.id[second[start]]]]),
        np.array([[750.0, 10.0]]),
    )
    along = np.array([plate.x[second[start]] - plate.x[first[start]], 0.0])
    direction = np.array([[np.sign(along[0]), 0.0]])
    plate.refresh()
    tips = type(plate.tips)(*tip_rows, direction, np.array([1]), np.array([1]), np.array([3e3]), np.zeros((1, 3)))
    plate.now.follow_cracks(plate.memory.bodies, tips)
    paths = plate.now.paths
    (tip,) = paths.standing()
    flat = tip._replace(place=tip.place + np.array([100.0, 100.0]), direction=np.array([1.0, 0.0]))
    calm = np.zeros((len(plate.now.cells._middle), 3))
    seen = 0
    while (crossing := paths.find_crossing(flat, calm)) is not None:
        assert plate.bonds.status[crossing.bond] == 0
        flat = flat._replace(place=flat.place + np.array([0.5 * SPACING, 0.0]))
        seen += 1
        assert seen < 12
    # Upright bonds do not lie in the way of a level ray, and the level ones end at the crack.
    assert flat.place[0] < 0.3
    away = tip._replace(direction=np.array([-1.0, 0.0]), place=np.array([-7.4e3, 0.1]))
    assert paths.find_crossing(away, calm) is None


def test_tips_go_on_from_a_restart_bit_for_bit(tmp_path) -> None:
    """A rift that is there from the start, toughness, and a run that is cut while its tips stand in the ice."""
    berg = Iceberg.rectangle(
        30e3, 30e3, thickness=THICKNESS, radius=RADIUS, latlon=False, lattice_angle=10.0
    ).with_rifts([[(100.0, -9e3), (100.0, 9e3)]], broken=True)
    assert berg.bonds.crack.max() == 1
    parameters = Parameters(
        earth={"latlon": False, "period": 0.0},
        fracture={"criterion": "toughness", "toughness": 1e8},
        stepping={"time_step": 600.0},
    )
    run = Model(berg, Forcing.uniform(), parameters)
    run.advance(days=600.0 / 86400.0)
    again = Model.resume(run.save(tmp_path / "tips.nc"), Forcing.uniform())
    before, after = run._stepper.state_dict(), again._stepper.state_dict()
    assert before["crack_tip_crack"].size == 2
    for name in (name for name in before if name.startswith("crack_tip")):
        np.testing.assert_array_equal(before[name], after[name])
    for name in ("crack", "crack_order", "crack_part"):
        np.testing.assert_array_equal(getattr(run.bonds, name), getattr(again.bonds, name))


@pytest.mark.slow
def test_a_tip_keeps_its_place_in_ice_that_drifts_and_turns() -> None:
    plate = cracked_plate("hexagonal", 15.0, 30.0)
    there, was = [tip.place for tip in plate.now.paths.standing()], plate.now.xy.mean(axis=0)
    x, y, (c, s) = plate.el.lon.copy(), plate.el.lat.copy(), (np.cos(0.7), np.sin(0.7))
    plate.el.lon[:], plate.el.lat[:] = 1e5 + c * x - s * y, 3e4 + s * x + c * y
    plate.refresh()
    moved = [tip.place for tip in plate.now.paths.standing()]
    middle = plate.now.xy.mean(axis=0)
    for before, after in zip(there, moved, strict=True):
        assert np.hypot(*(after - middle)) == pytest.approx(np.hypot(*(before - was)), rel=1e-9)
    # Pieces that part take their tips with them; a tip between two of them has nowhere to go.
    between = plate.tips.beside[0]
    of_tip = np.isin(plate.el.body.id, between)
    ends = of_tip[plate.bonds.first] | of_tip[plate.bonds.second]
    plate.bonds.status[ends] = 1
    plate.refresh()
    assert [tip.row for tip in plate.now.paths.standing()] == [1]


def test_each_crack_has_a_number_of_its_own_beside_rifts_that_are_there() -> None:
    """Three cracks far from each other, in a plate with a rift: rifts keep their numbers, cracks count on, both tips alike."""
    plate = Plate("square", 0.0, 45e3, 9e3)
    first, second = plate.bonds.first, plate.bonds.second
    along = np.flatnonzero(np.abs(plate.y[first] - plate.y[second]) < 1.0)
    middle = 0.5 * (plate.x[first] + plate.x[second])
    rift = along[np.argmin(np.abs(middle[along] - 19e3))]
    plate.bonds.crack[rift] = 4
    plate.without(rift)
    broken = []
    for x in (-18e3, -6e3, 6e3):
        moment = plate.under(pulled_from_the_middle(plate, 45e3))
        near = along[np.argsort(np.hypot(middle[along] - x, 0.5 * (plate.y[first] + plate.y[second])[along]))]
        broken.append(plate.break_next(moment, int(near[0])))
    assert plate.bonds.crack[broken].tolist() == [5, 6, 7]
    assert plate.bonds.crack[rift] == 4
    assert plate.tips.crack.tolist() == [5, 5, 6, 6, 7, 7]
