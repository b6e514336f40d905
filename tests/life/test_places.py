"""Bergs that are born where other ice lies: beside it, or they wait; ledger, restarts, all schemes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contract import HEAT_CLOSES, MASS_CLOSES
from riftberg import Exchange, Forcing, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.life.births import Births
from riftberg.life.free_places import FreePlaces, corner_reach
from riftberg.state import new_elements

DIRECTIONS = 16

PLANE = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
SCHEMES: dict[str, dict[str, Any]] = {
    "quasi_static": {"stepping": {"scheme": "quasi_static", "time_step": 1800.0}},
    "mts": {"stepping": {"scheme": "mts", "time_step": 1800.0}, "bonds": {"youngs_modulus": 1e6}},
    "verlet": {"stepping": {"scheme": "verlet", "time_step": 20.0}, "bonds": {"law": "spring", "spring": 1e-4}},
    "runge_kutta": {"stepping": {"scheme": "runge_kutta", "time_step": 20.0}, "bonds": {"law": "spring", "spring": 1e-4}},
}  # fmt: skip
each_scheme = pytest.mark.parametrize("scheme", SCHEMES)


def sea() -> Forcing:
    return Forcing.uniform(
        current=(0.2, 0.1), wind=(5.0, 0.0), depth=500.0, temperature=3.0, salinity=34.0, slope=(0.0, 0.0)
    )


def parameters(scheme: str, style: str) -> Parameters:
    p = Parameters(
        earth=PLANE, fracture={"enabled": False}, melt={"enabled": True},
        footloose={"enabled": True, "style": style, "berg_mass": 1e8, "seed": 3},
    )  # fmt: skip
    return p.changed(**SCHEMES[scheme])


def parent(columns: int) -> Iceberg:
    """A berg of 3 km elements in rows of two, one element alone for ``columns = 1``; pieces are ready to break off."""
    i, j = (q.ravel() for q in np.meshgrid(np.arange(columns), np.arange(min(columns, 2))))
    berg = Iceberg.from_points(3000.0 * i, 3000.0 * j, thickness=200.0, latlon=False, radius=1500.0)
    berg.elements.life.fl_k[:] = 3e6
    return berg


def closes(model: Model) -> None:
    balance = model.life.balance(model)  # type: ignore[union-attr]
    assert abs(balance.error) <= MASS_CLOSES
    assert abs(balance.heat_error) <= HEAT_CLOSES


def overlapping(model: Model, first: int) -> int:
    """Pairs of elements, one of them from row ``first`` on, whose circles of contact overlap."""
    el = model.elements
    radius = 0.5 * np.sqrt(el.length * el.width)
    apart = np.hypot(np.subtract.outer(el.lon, el.lon), np.subtract.outer(el.lat, el.lat))
    near = np.triu(apart < np.add.outer(radius, radius), 1)
    return int(near[:, first:].sum())


@pytest.mark.quick(4)
@each_scheme
@pytest.mark.parametrize("style", ["bergs", "bits"])
@pytest.mark.parametrize("columns", [1, 3])
def test_children_lie_beside_their_parent_and_are_not_thrown(scheme: str, style: str, columns: int) -> None:
    model = Model(parent(columns), sea(), parameters(scheme, style))
    before = model.elements.size
    model.advance(steps=1)
    children = model.elements.size - before
    assert children > 0
    assert overlapping(model, before) == 0
    assert (model.elements.fl_k[before:] == -2.0).all()  # they take part in contact at once
    model.advance(steps=3)
    u, v = model.velocity()
    assert np.hypot(u, v).max() < 1.2 * np.hypot(0.2, 0.1) + 0.05
    closes(model)


def surrounded() -> Iceberg:
    """A berg of one element in the midst of ice that stands still."""
    i, j = (q.ravel() for q in np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)))
    order = np.argsort((i != 0) | (j != 0), kind="stable")
    berg = Iceberg.from_points(3200.0 * i[order], 3200.0 * j[order], thickness=200.0, latlon=False, radius=1500.0)
    berg.elements.life.fl_k[0] = 3e6
    berg.elements.body.static[1:] = 1.0
    return berg


@pytest.mark.parametrize("style", ["bergs", "bits"])
def test_where_there_is_no_room_a_piece_waits_among_the_bits(style: str, tmp_path: Path) -> None:
    p = parameters("verlet", style).changed(bonds={"law": "none"})
    model = Model(surrounded(), sea(), p)
    count, mass = model.elements.size, model.elements.mass[0]
    model.advance(steps=2)
    held = model.elements.mass_of_fl_bits[0]
    assert model.elements.size == count
    assert held > 0.0
    assert model.elements.mass[0] + held == pytest.approx(mass, rel=1e-4)  # the rest is melt water
    closes(model)
    # Once the ice around it is gone, the child is born, in a resumed run as well.
    again = Model.resume(model.save(tmp_path / "waiting.nc"), sea())
    for run in (model, again):
        run.remove(run.elements.id[1:])
        run.advance(steps=1)
        assert run.elements.size >= 2
        assert run.elements.mass_of_fl_bits[0] < held
        closes(run)
    for name, array in model.elements.arrays().items():
        np.testing.assert_array_equal(getattr(again.elements, name), array, err_msg=name)


CLASS = {"mass": (1e9, 2e9), "fraction": (1.0, 0.0), "scaling": (1.0, 1.0), "thickness": (200.0, 200.0)}
FLUX = {"land_ice_specific_mass_flux_due_to_calving": np.pad([[0.02]], ((2, 2), (2, 2)))}


def calving(read_elements: list[float], radius: float) -> Exchange:
    """An ocean of 5 x 5 cells of some 6 km, with ice in the middle one, into which land ice calves."""
    lon, lat = np.meshgrid(np.linspace(-40.0, -39.5, 6), np.linspace(-55.25, -55.0, 6))
    grid = ocean_grid(lon, lat)
    berg = Iceberg.from_points(read_elements[:1], read_elements[1:], thickness=200.0, radius=radius)
    berg.elements.body.static[:] = 1.0
    p = Parameters(
        melt={"enabled": True}, calving={"south": CLASS, "north": CLASS},
        stepping={"scheme": "mts", "time_step": 1800.0},
    )  # fmt: skip
    return Exchange(Model(berg, OceanForcing(grid, grid.fields(depth=500.0)), p), calving=True)


def calm(run: Exchange) -> None:
    still = dict.fromkeys(
        ("eastward_sea_water_velocity", "northward_sea_water_velocity", "eastward_wind", "northward_wind"), 0.0
    )
    run.step({**still, "sea_surface_temperature": (271.15, "K"), "sea_surface_salinity": (34.0, "psu"), **FLUX})


def test_a_berg_of_a_flux_is_born_beside_the_ice_in_its_cell_or_waits_in_its_store() -> None:
    free = calving([-39.6, -55.05], 300.0)
    calm(free)
    assert free.model.elements.size > 1
    spot = [float(q[1]) for q in (free.model.elements.lon, free.model.elements.lat)]
    # Ice lies where it would have been born.
    for radius, room in ((500.0, True), (9000.0, False)):
        run = calving(spot, radius)
        before = run.stocks()
        for _ in range(2):
            calm(run)
        el = run.model.elements
        if room:
            assert el.size > 1
            x, y = 63.8e3 * (el.lon[1:] - el.lon[0]), 111.2e3 * (el.lat[1:] - el.lat[0])
            assert np.hypot(x, y).min() > radius + 0.5 * np.sqrt(el.length[1] * el.width[1])
            assert (el.cell_i[1:] == el.cell_i[0]).all()
            assert (el.cell_j[1:] == el.cell_j[0]).all()
        else:
            assert el.size == 1
            assert run.calving is not None
            assert run.calving.stores.ice.sum() > 2.0 * CLASS["mass"][0]
            assert run.stocks()[0] > before[0]
        assert abs(run.balance().error) < 1e-12
        assert abs(run.balance().heat_error) < 1e-10
    run.model.remove(run.model.elements.id)
    calm(run)
    assert run.model.elements.size > 2  # all that has waited


def test_births_fill_the_middle_of_their_cell_evenly() -> None:
    born = calving([-39.6, -55.05], 300.0).calving
    assert born is not None
    places = []
    for number in range(1000):
        born.stores.counter[2, 2] = number
        places.append(born._spot(2, 2, 0.0, None)[2:])
    xi, eta = np.array(places).T
    for axis in (xi, eta):
        assert (axis.min(), axis.mean(), axis.max()) == pytest.approx((0.1, 0.5, 0.9), abs=2e-3)
    counts = np.histogram2d(xi, eta, bins=5, range=[[0.1, 0.9]] * 2)[0]
    assert (np.abs(counts - 40.0) < 8.0).all()


def test_room_beside_other_ice_is_looked_for_where_ice_meets_ice_and_not_with_the_reference() -> None:
    model: Any = SimpleNamespace(elements=new_elements(1))
    unused: Any = SimpleNamespace(growth=None)
    own = parameters("verlet", "bergs")
    others = (
        own.changed(stepping={"interactions": False}),
        own.changed(compatibility={"births_at_centre": True, "zero_start": True}),
    )
    looked_for = [Births(model, p, unused).free is not None for p in (own, *others)]
    assert looked_for == [True, False, False]


def test_a_child_tries_the_place_that_was_drawn_and_then_the_corners_of_its_parent() -> None:
    el, child, tried = new_elements(1), new_elements(1), []
    el.length[:], el.width[:], child.lon[:], child.lat[:] = 800.0, 300.0, 1000.0, 2000.0
    off_land = SimpleNamespace(
        el=el, p=Parameters(earth=PLANE), when=SimpleNamespace(grid=object()),
        _holds=lambda _child, x, y, _e: tried.append((x, y)),
    )  # fmt: skip
    Births._put(off_land, child, 0, (400.0, 120.0))  # type: ignore[arg-type]
    corners = [(600.0, 1850.0), (600.0, 2150.0), (1400.0, 2150.0), (1400.0, 1850.0)]
    assert tried == [(1400.0, 2120.0), *corners]
    assert (child.lon[0], child.lat[0]) == (1000.0, 2000.0)  # no sea anywhere: where the parent is


def test_the_rim_turns_with_the_berg() -> None:
    """The length of a berg counted as east, however it had turned."""
    model = Model(parent(1), sea(), parameters("verlet", "bergs"))
    body = model.elements.body
    body.length[:], body.width[:] = 4000.0, 1000.0
    for turn in (0.0, 0.5 * np.pi, 2.0):
        model.elements.motion.rotation[:] = turn
        for draw in np.linspace(0.0, 0.99, 12):
            when = SimpleNamespace(draws=SimpleNamespace(draw=lambda *_, d=draw: d), rank=lambda *_: 0, step=1)
            x, y = Births(model, model.parameters, when).draw_rim(0, 1000.0, 4000.0)  # type: ignore[arg-type]
            along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
            assert max(abs(along) / 2000.0, abs(across) / 500.0) == pytest.approx(1.0)


@pytest.mark.parametrize("style", ["bergs", "bits"])
def test_children_of_several_elements_bring_the_heat_of_all_their_ice(style: str) -> None:
    """They brought the heat of one element for the ice of all."""
    model = Model(parent(3), sea(), parameters("verlet", style))
    model.elements.life.heat_density[:] = -1e4 * np.arange(1.0, 7.0)
    before = model.elements.size
    model.advance(steps=2)
    assert model.elements.size > before
    closes(model)


@pytest.mark.quick(2)
@pytest.mark.parametrize("seed", range(5))
def test_the_free_place_is_the_nearest_and_free(seed: int) -> None:
    """Against a search over all places of a raster."""
    random = np.random.default_rng(seed)
    el = new_elements(30)
    el.lon[:], el.lat[:] = random.uniform(-6e3, 6e3, (2, 30))
    el.length[:], el.width[:] = random.uniform(300.0, 3000.0, (2, 30))
    free, reach = FreePlaces(el, Parameters(earth=PLANE)), 400.0
    apart = corner_reach(el.length, el.width) + reach

    def clear(x: Any, y: Any) -> Any:
        return (np.hypot(np.subtract.outer(x, el.lon), np.subtract.outer(y, el.lat)) >= apart).all(axis=-1)

    grid = np.meshgrid(np.arange(-12e3, 12e3, 60.0), np.arange(-12e3, 12e3, 60.0))
    nearest = np.hypot(*grid)[clear(*grid)].min()
    place = free.nearest(0.0, 0.0, reach, lambda x, y: True, 20e3)
    assert place is not None
    assert clear(*np.array(place))
    assert nearest - 90.0 < np.hypot(*place) < nearest / np.cos(np.pi / DIRECTIONS) + 0.6 * nearest
    # Nothing within reach, or no sea there: it waits.
    assert free.nearest(0.0, 0.0, reach, lambda x, y: True, 0.5 * float(np.hypot(*place))) is None
    assert free.nearest(0.0, 0.0, reach, lambda x, y: False, 20e3) is None
    east = free.nearest(0.0, 0.0, reach, lambda x, y: x > 0.0, 20e3)
    assert east is not None
    assert east[0] > 0.0
    assert clear(*np.array(east))
