"""Sides melt along the outline of the berg, moved inwards: what is lost is that of theory, whatever the lattice."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from contract import HEAT_CLOSES, MASS_CLOSES
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.errors import InputError
from riftberg.life.ice_fronts import hand_on_feet
from riftberg.plane import ConformalPlane
from riftberg.state import new_elements

ALONE = -1.0
REACH = 0.05
SHAPES = "front_shapes"

LENGTH, WIDTH, RADIUS, PLACE = 60e3, 30e3, 30e3, (-40.0, -56.0)
SEA = Forcing.uniform(wind=(10.0, 0.0), temperature=6.0, salinity=34.0)
CHANGES: dict[str, Any] = {
    "melt": {"enabled": True, "base": "turbulent", "tide": 0.0}, "fracture": {"enabled": False},
    "stepping": {"time_step": 86400.0},
}  # fmt: skip


def on_sphere(x: Any, y: Any) -> Any:
    return ConformalPlane(*PLACE, 6378e3).inverse(x, y)


def berg_of(shape: str, size: float, packing: str = "square", angle: float = 0.0) -> Iceberg:
    lattice: dict[str, Any] = {"thickness": 200.0, "radius": 0.5 * size, "packing": packing, "lattice_angle": angle}
    if shape == "rectangle":
        return Iceberg.rectangle(LENGTH, WIDTH, placement=PLACE, **lattice)
    turn = np.linspace(0.0, 2.0 * np.pi, 257)
    ring = np.column_stack(on_sphere(RADIUS * np.cos(turn), RADIUS * np.sin(turn)))
    return Iceberg.from_outline(ring, **lattice)


def left_by_theory(shape: str, retreat: float) -> float:
    """Area of the outline moved inwards, m2."""
    if shape == "rectangle":
        return (LENGTH - 2.0 * retreat) * (WIDTH - 2.0 * retreat)
    return float(np.pi * (RADIUS - retreat) ** 2)


def area_of(model: Model) -> float:
    return float((model.elements.length * model.elements.width).sum())


def standing(berg: Iceberg, changes: dict[str, Any] | None = None, retreat: float = 20.0) -> Model:
    """Return a model that stands still and whose sides melt back by a distance (m) at each call of `melt`."""
    model = Model(berg, SEA, Parameters().changed(**(changes or CHANGES)))
    model._long_step.begin(model)
    model.life.act(model)
    by_day = float(model.life.last.melt.melted.retreat.max())
    model = Model(berg, SEA, Parameters().changed(**(changes or CHANGES)))
    model.life.values = model.life.values._replace(dt=model.life.values.dt * retreat / by_day)
    model._long_step.begin(model)
    return model


def melt(model: Model, steps: int = 1) -> None:
    for _ in range(steps):
        model.life.act(model)
        model._long_step.follow_changes(model)


def worst_ratio(shape: str, size: float, packing: str, angle: float) -> tuple[Model, float]:
    """Melt until half is gone; the largest error of the lost area, as part of that of theory."""
    berg, step = berg_of(shape, size, packing, angle), min(size / 40.0, 40.0)
    model, start, retreat, worst = standing(berg, retreat=step), berg.area, 0.0, 0.0
    whole = left_by_theory(shape, 0.0)
    while left_by_theory(shape, retreat + step) > 0.5 * whole:
        melt(model)
        retreat += step
        lost = (start - area_of(model)) / (whole - left_by_theory(shape, retreat))
        worst = max(worst, abs(lost - 1.0))
    assert area_of(model) < 0.51 * start
    balance = model.life.balance(model)
    assert abs(balance.error) <= MASS_CLOSES
    assert abs(balance.heat_error) <= HEAT_CLOSES
    return model, worst


QUICK = [
    ("rectangle", 6e3, "square", 0.0), ("rectangle", 3e3, "square", 20.0), ("rectangle", 3e3, "hexagonal", 45.0),
    ("disc", 6e3, "square", 20.0), ("disc", 3e3, "square", 0.0), ("disc", 6e3, "hexagonal", 0.0),
]  # fmt: skip
ALL = [
    (shape, size, packing, angle) for shape in ("rectangle", "disc") for size in (6e3, 3e3, 1.5e3, 600.0)
    for packing in ("square", "hexagonal") for angle in (0.0, 20.0, 45.0)
]  # fmt: skip


@pytest.mark.quick(2)
@pytest.mark.parametrize(("shape", "size", "packing", "angle"), QUICK)
def test_lost_area_is_that_of_the_outline_moved_inwards(shape, size, packing, angle):
    """Bug once: 0.995 of it with elements of 6 km, 0.869 with 0.6 km, and 0.6 to 0.7 once rows of the edge were gone."""
    assert worst_ratio(shape, size, packing, angle)[1] < 0.01


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize(("shape", "size", "packing", "angle"), ALL)
def test_lost_area_on_all_lattices(shape, size, packing, angle):
    worst = worst_ratio(shape, size, packing, angle)[1]
    print(f"{shape}, {size:g} m, {packing}, {angle:g} degrees: {100.0 * worst:.2f} %")
    assert worst < 0.01


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 45.0), ("hexagonal", 20.0)])
def test_what_is_left_lies_within_the_outline_moved_inwards(packing, angle):
    """Area alone could be right while the corners go first: no element farther out than its own size, none missing inside."""
    model, _ = worst_ratio("rectangle", 2e3, packing, angle)
    retreat = 0.25 * (LENGTH + WIDTH - np.sqrt((LENGTH + WIDTH) ** 2 - 2.0 * LENGTH * WIDTH))
    start = berg_of("rectangle", 2e3, packing, angle).elements
    x, y = ConformalPlane(*PLACE, 6378e3).forward(start.lon, start.lat)
    inside = np.minimum(0.5 * LENGTH - abs(x), 0.5 * WIDTH - abs(y)) - retreat
    alive = np.isin(start.id, model.elements.id)
    assert not alive[inside < -1.5e3].any()
    assert alive[inside > 1.5e3].all()
    whole = model.elements.length * model.elements.width / (start.length * start.width)[alive]
    assert (whole[inside[alive] > 2e3] == 1.0).all()


@pytest.mark.quick(4)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("angle", [0.0, 22.5, 45.0])
@pytest.mark.parametrize(("shape", "length"), [("rectangle", 180e3), ("disc", 2.0 * np.pi * RADIUS)])
def test_the_fronts_of_a_berg_add_up_to_its_perimeter(shape, length, packing, angle):
    """Counted sides are 1.41 times too many on a turned lattice, 1.27 on a disc."""
    front = standing(berg_of(shape, 3e3, packing, angle)).elements.front
    assert front.sum() == pytest.approx(length, rel=0.005)
    assert (front >= 0.0).all()


def cut_in_two(model: Model) -> None:
    el, bonds = model.elements, model.bonds
    middle = 0.5 * (el.lon.min() + el.lon.max())
    cut = (el.lon[bonds.first] < middle) != (el.lon[bonds.second] < middle)
    bonds.status[cut], bonds.break_time[cut] = 2, model.time
    for side in (bonds.first, bonds.second):
        np.subtract.at(el.bond_count, side[cut], 1)
    model.fragments.update(el, bonds, model.time, model.constants)


def test_pieces_have_fronts_along_the_crack():
    """After a retreat of 1 km the halves are 29 x 28 km each, and melt along all of that."""
    model = standing(berg_of("rectangle", 3e3), retreat=50.0)
    melt(model, 20)
    cut_in_two(model)
    melt(model)
    el = model.elements
    assert np.unique(el.berg).tolist() == [1, 2]
    for number in (1, 2):
        assert el.front[el.berg == number].sum() == pytest.approx(2.0 * (29e3 + 28e3), rel=0.01)
    start = area_of(model)
    melt(model, 10)
    assert start - area_of(model) == pytest.approx(2.0 * (29e3 * 28e3 - 28e3 * 27e3), rel=0.02)


def test_an_element_that_breaks_off_alone_melts_as_a_block():
    model = standing(Iceberg.rectangle(9e3, 3e3, thickness=200.0, placement=PLACE, radius=1500.0))
    assert (model.elements.front > 0.0).all()
    model.bonds.status[0], model.bonds.break_time[0] = 2, 0.0
    model.elements.bond_count[[model.bonds.first[0], model.bonds.second[0]]] -= 1
    model.fragments.update(model.elements, model.bonds, model.time, model.constants)
    before = model.elements.copy()
    melt(model)
    alone = np.bincount(before.berg)[before.berg] == 1
    assert alone.sum() == 1
    assert model.elements.front[alone] == ALONE
    assert before.length[alone] - model.elements.length[alone] == pytest.approx(2.0 * 20.0, rel=1e-9)


def test_where_the_sea_is_cold_the_outline_stays():
    """Rates differ along the outline: half of the berg lies in water that melts nothing."""
    model = standing(berg_of("rectangle", 3e3), retreat=50.0)
    model.elements.sst[:] = np.where(model.elements.lon > PLACE[0], 6.0, -2.0)
    for _ in range(60):
        melt(model)
        model.elements.sst[:] = np.where(model.elements.lon > PLACE[0], 6.0, -2.0)
    el = model.elements
    x = ConformalPlane(*PLACE, 6378e3).forward(el.lon, el.lat)[0]
    area = el.length * el.width
    rate = 50.0 * (area_of(standing(berg_of("rectangle", 3e3))) - area_of(model))
    assert area[x < -4.5e3].min() == pytest.approx(9e6, rel=1e-3)
    # 3 km from the end and from both sides of the warm half; the retreat is that of 6 degrees, 50 m a step.
    assert area[x > 0.0].sum() == pytest.approx(27e3 * 24e3, rel=0.02)
    assert rate > 0.0


def everything(model: Model) -> dict[str, bytes]:
    arrays = {**model.elements.arrays(), **model.bonds.arrays(), **model.remembered}
    return {name: np.asarray(array).tobytes() for name, array in arrays.items()}


@pytest.mark.quick(1)
@pytest.mark.parametrize("piece", ["whole", "broken"])
def test_a_resumed_run_goes_on_bit_for_bit(piece: str, tmp_path: Path):
    """It moves and draws the outline anew after the restart."""
    berg = Iceberg.rectangle(9e3, 6e3, thickness=200.0, placement=PLACE, radius=750.0, lattice_angle=20.0)
    p = Parameters().changed(**{**CHANGES, "stepping": {"time_step": 21600.0}, "melt": {"enabled": True}})
    sea = Forcing.uniform(current=(0.2, 0.1), wind=(40.0, 20.0), temperature=30.0, salinity=34.0, slope=(0.0, 0.0))
    whole = Model(berg, sea, p)
    whole.advance(steps=4)
    if piece == "broken":
        cut_in_two(whole)
        whole.step()
    file = whole.save(tmp_path / "r.nc")
    resumed, seen = Model.resume(file, sea), whole.remembered[SHAPES]
    for model in (whole, resumed):
        model.advance(steps=12)
    assert seen is not whole.remembered[SHAPES]
    theirs, ours = everything(resumed), everything(whole)
    assert [name for name in ours if ours[name] != theirs[name]] == []


def test_outlines_that_cannot_be_read_are_refused(tmp_path: Path):
    model = standing(berg_of("rectangle", 6e3))
    model.remembered[SHAPES] = np.zeros(40, np.uint8)
    model.elements.retreat[:] = 1e4
    with pytest.raises(InputError, match="outlines that cannot be read"):
        melt(model)


def test_a_berg_that_is_born_has_an_outline_of_its_own():
    model = standing(berg_of("rectangle", 6e3))
    young = Iceberg.rectangle(12e3, 6e3, thickness=150.0, placement=(-38.0, -56.0), radius=1500.0)
    model.append(young.elements, young.bonds)
    model._long_step.follow_changes(model)
    melt(model)
    el = model.elements
    assert el.front[el.berg == 2].sum() == pytest.approx(36e3, rel=0.02)
    assert el.front[el.berg == 1].sum() == pytest.approx(180e3, rel=0.02)


def test_feet_follow_the_outline():
    """What breaks off moves the outline as melt does, and the foot of an element that is gone goes to its neighbours."""
    feet = {**CHANGES, "footloose": {"enabled": True, "youngs": 1e7, "strength": 2e6, "style": "bits"}}
    lost = []
    for size in (3e3, 1.5e3, 1e3):
        berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=PLACE, radius=0.5 * size)
        model = standing(berg, feet, retreat=15.0)
        while area_of(model) > 0.5 * 72e6:
            melt(model)
        life = model.elements.life
        outline = shapely.get_parts(shapely.from_wkb(model.remembered[SHAPES].tobytes()))[0]
        assert area_of(model) == pytest.approx(outline.area, rel=0.05)
        water = model.life.balance(model).water
        bits = (life.mass_of_fl_bits * life.mass_scaling).sum() + water["footloose_bits"]
        lost.append([float(bits), water["waves"]])
        assert abs(model.life.balance(model).error) <= MASS_CLOSES
    lost = np.array(lost)
    assert (lost > 0.0).all()
    np.testing.assert_allclose(lost / lost[0], 1.0, rtol=0.05)


def test_the_feet_of_what_has_melted_go_to_what_is_left_of_the_same_berg():
    """By the lengths of its fronts; what lies inside of a berg, another berg, and bits at sea (negative foot) get nothing."""
    el = new_elements(6)
    life, gone = el.life, np.arange(6) == 0
    el.body.berg[:] = [1, 1, 1, 1, 2, 1]
    life.front[:] = [500.0, 300.0, 100.0, 0.0, 700.0, 900.0]
    life.fl_k[:] = [8.0, 1.0, 2.0, 3.0, 4.0, -1.0]
    life.mass_of_fl_bits[:], life.mass_of_fl_bergy_bits[:] = [16.0] + 5 * [1.0], [4.0] + 5 * [2.0]
    hand_on_feet(el, gone)
    assert life.fl_k.tolist() == [0.0, 7.0, 4.0, 3.0, 4.0, -1.0]
    assert life.mass_of_fl_bits.tolist() == [0.0, 13.0, 5.0, 1.0, 1.0, 1.0]
    assert life.mass_of_fl_bergy_bits.tolist() == [0.0, 5.0, 3.0, 2.0, 2.0, 2.0]


def test_runs_with_forces_by_element_keep_the_law_of_the_reference():
    """A side that no bond covers takes from the length and the width of its element."""
    model = standing(
        berg_of("rectangle", 3e3),
        {**CHANGES, "stepping": {"scheme": "mts", "time_step": 86400.0}, "compatibility": {"forces_by_element": True}},
    )
    assert (model.elements.front == ALONE).all()
    assert SHAPES not in model.remembered
    before = model.elements.copy()
    melt(model)
    ratio = (before.length - model.elements.length) / (1.0 - before.bond_count / 4.0 + 1e-300)
    np.testing.assert_allclose(ratio[before.bond_count < 4], ratio[before.bond_count == 3][0], rtol=1e-9)


def test_the_outline_is_drawn_anew_after_a_small_part_of_an_element():
    model = standing(berg_of("rectangle", 3e3), retreat=0.3 * REACH * 3e3)
    seen = [model.remembered[SHAPES]]
    for _ in range(8):
        melt(model)
        seen.append(model.remembered[SHAPES])
    drawn = [a is not b for a, b in pairwise(seen)]
    assert drawn == [False] * 4 + [True] + [False] * 3
