"""Bergs of one element that meet nobody take quasi-static steps of their own: with the results of the general step."""

from __future__ import annotations

from time import sleep
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.quasi_static import lone_bergs
from riftberg.engines.quasi_static import stepper as general
from riftberg.engines.quasi_static.fracture import crack_paths
from riftberg.state import ELEMENT_VARIABLES

pytestmark = pytest.mark.compiled

PLANE = {"earth": {"latlon": False, "period": 0.0, "reference_latitude": -60.0}}
MELT = {"melt": {"enabled": True, "temperature": 1.0, "salinity": 34.0}}
OCEAN = {
    "current": (0.1, 0.05),
    "wind": (8.0, -3.0),
    "sea_ice": (0.05, 0.0, 0.6),
    "ice_fraction": 0.9,
    "slope": (1e-7, -2e-7),
}


@pytest.fixture(autouse=True)
def _however_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lone_bergs, "MIN_LONE_BERGS", 1)


def berg(x: float, y: float, latlon: bool, *, side: float = 400.0, **given: Any) -> Iceberg:
    """Return a berg of one element x and y km from the middle of all."""
    place = (x / 55.0 - 40.0, y / 111.0 - 60.0) if latlon else (1e3 * x, 1e3 * y)
    return Iceberg.rectangle(side, side, thickness=100.0, radius=0.5 * side, placement=place, latlon=latlon, **given)


def population(latlon: bool = True, *, meeting: bool = True, bonded: bool = True) -> Iceberg:
    """Return eight bergs that meet nobody, two that meet within minutes, and one of four bonded elements."""
    bergs = [berg(20.0 * k, 30.0 + 5.0 * k, latlon, side=200.0 + 100.0 * k, velocity=(0.05 * k, 0.1)) for k in range(8)]
    bergs += [berg(x, -40.0, latlon, velocity=(u, 0.0)) for x, u in ((0.0, 0.4), (0.45, 0.0))] if meeting else []
    place = (-41.0, -60.0) if latlon else (-60e3, 0.0)
    giant = Iceberg.rectangle(6e3, 6e3, thickness=150.0, radius=1500.0, placement=place, latlon=latlon)
    return Iceberg.join([*bergs, giant] if bonded else bergs)


def model_of(bergs: Iceberg, forcing: Any, *, dt: float = 600.0, **groups: Any) -> Model:
    """Return a model whose single bergs turn and bear loads."""
    model = Model(bergs, forcing, Parameters(**{"stepping": {"time_step": dt}, **groups}))
    model.elements.spin[:5], model.elements.body.load_x[3] = (1e-5, -2e-5, 0.0, 3e-5, 1e-6), 2e6
    return model


def state_of(model: Model) -> dict[str, np.ndarray]:
    """Return a copy of all variables, and the forces."""
    state = {v.name: getattr(model.elements, v.name).copy() for v in ELEMENT_VARIABLES}
    return {**state, "forces": model.applied_forces()}


@pytest.mark.parametrize("earth", [{}, PLANE], ids=["sphere", "plane"])
@pytest.mark.parametrize(
    "options",
    [{}, MELT, {"dt": 1800.0}],
    ids=["afloat", "melting", "drag that the step does not resolve"],
)  # fmt: skip
def test_lone_bergs_go_as_in_the_general_step(
    earth: dict[str, Any], options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    ocean = Forcing.uniform(**OCEAN, depth=1000.0)
    case = {**earth, **options}
    own, plain = (model_of(population(not earth), ocean, **case) for _ in range(2))
    own.advance(steps=4)
    found = general.find_lone_bergs(
        own, own._stepper.memory.bodies, interaction_sizes(own.elements, own.constants), own._stepper.memory.laws.faces
    )
    assert found is not None
    assert found[0].tolist() == list(range(8))
    monkeypatch.setattr(general, "find_lone_bergs", lambda *model: None)
    plain.advance(steps=4)
    assert len(own.contacts.rows) == len(plain.contacts.rows) == 1
    then = state_of(plain)
    for name, now in state_of(own).items():
        size = np.nanmax(np.abs(then[name]), initial=0.0)
        np.testing.assert_allclose(now, then[name], rtol=1e-11, atol=1e-13 * size, err_msg=name)


@pytest.mark.quick(2)
@pytest.mark.parametrize("earth", [{}, PLANE], ids=["sphere", "plane"])
@pytest.mark.parametrize("options", [{}, MELT], ids=["alone", "melting"])
def test_bergs_over_a_bed_of_sediment_go_as_in_the_general_step(
    earth: dict[str, Any], options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those near it with those that may meet, all others by themselves; one stands on it from the start."""
    case: dict[str, Any] = {**earth, **options, "grounding": {"law": "seabed"}, "dt": 1800.0}
    place = (60e3, 45e3) if earth else (60.0 / 55.0 - 40.0, 45.0 / 111.0 - 60.0)
    bank = Forcing.seamount(place, 900.0, 8e3, 981.5, latlon=not earth)
    sea = Forcing.uniform((0.1, 0.05), latlon=not earth, **({"latitude": -60.0} if earth else {}))
    own, plain = (model_of(population(not earth, bonded=False), sea + bank, **case) for _ in range(2))
    own.advance(steps=6)
    found = general.find_lone_bergs(
        own,
        own._stepper.memory.bodies,
        interaction_sizes(own.elements, own.constants),
        own._stepper.memory.laws.faces,
        own._stepper.memory.laws.seabed,
    )
    assert found is not None
    assert found[0].size == 7
    monkeypatch.setattr(general, "find_lone_bergs", lambda *model: None)
    plain.advance(steps=6)
    assert np.flatnonzero(own.elements.floor_load).tolist() == [3]
    then = state_of(plain)
    for name, now in state_of(own).items():
        size = np.nanmax(np.abs(then[name]), initial=0.0)
        np.testing.assert_allclose(now, then[name], rtol=1e-9, atol=1e-11 * size, err_msg=name)


def test_a_meeting_does_not_divide_the_step_of_bergs_elsewhere() -> None:
    """In steps of three hours, which a contact divides in six: lone bergs have the digits that they have without it."""
    together, apart = (
        model_of(population(meeting=meets), Forcing.uniform(**OCEAN), dt=10800.0) for meets in (True, False)
    )
    for model in (together, apart):
        model.advance(steps=3)
    assert together.contacts.rows
    for name in ("lon", "lat", "u", "v", "spin", "rotation"):
        np.testing.assert_array_equal(
            getattr(together.elements, name)[:8], getattr(apart.elements, name)[:8], err_msg=name
        )


def test_neither_blocks_nor_threads_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit. In steps of three hours the bergs south of 42 degrees ask for two parts, for all of them."""
    north = [berg(30.0 * k, 2400.0 - 45.0 * k, True) for k in range(8)]
    bergs = Iceberg.join([*north, population()], names=[f"north {k}" for k in range(8)] + ["south"])
    states = []
    for block, threads in ((8192, 1), (8192, 3), (3, 1), (3, 3)):
        monkeypatch.setattr(lone_bergs, "BLOCK", block)
        monkeypatch.setattr(lone_bergs.config, "NUMBA_NUM_THREADS", threads)
        model = model_of(bergs, Turned(**OCEAN), dt=10800.0, **MELT)
        model.advance(steps=3)
        states.append(state_of(model))
    for other in states[1:]:
        for name, values in states[0].items():
            np.testing.assert_array_equal(other[name], values, err_msg=name)


class Turned(Forcing.uniform):
    """A forcing that may not be asked by two threads at once, and must see all lone bergs together."""

    busy = False

    def sample(self, elements: Any, time: float) -> None:
        assert not Turned.busy
        Turned.busy = True
        super().sample(elements, time)
        elements.environment.uo[:] += 1e-4 * np.arange(elements.size)
        sleep(1e-3)
        Turned.busy = False


class Shoal(Forcing.uniform):
    """Deep water that a bank in the east rises from by 1 in 100, above keels of 83 m."""

    def depth(self, lon: Any, lat: Any) -> Any:
        return np.clip(80.0 + 0.01 * (-39.9 - np.asarray(lon)) * 55_660.0, 60.0, 1000.0)

    def sample(self, elements: Any, time: float) -> None:
        super().sample(elements, time)
        elements.environment.depth[:] = self.depth(elements.lon, elements.lat)


def test_a_berg_that_runs_aground_goes_as_it_would_alone() -> None:
    """The others are no part of it: its step alone is divided at the touch."""
    others = [berg(-40.0 - 20.0 * k, 10.0 * k, True) for k in range(6)]
    runs = [Model(Iceberg.join([berg(3.0, 0.0, True), *more]), Shoal(current=(0.6, 0.0), slope=(0.0, 0.0)), Parameters())
            for more in (others, others[:0])]  # fmt: skip
    for model in runs:
        model.advance(steps=6)
        assert model.elements.lon[0] < -39.88
        assert model.elements.keel.floor_load[0] > 0.0
    for name, alone in state_of(runs[1]).items():
        if name != "berg_length":
            np.testing.assert_allclose(state_of(runs[0])[name][:1], alone, rtol=1e-11, atol=1e-18, err_msg=name)


def test_a_berg_that_land_stops_goes_as_it_would_alone() -> None:
    lon, lat = np.meshgrid(np.linspace(-42.0, -38.0, 21), np.linspace(-61.0, -59.0, 11))
    mask = np.ones((10, 20))
    mask[:, 12:] = 0.0
    grid = ocean_grid(lon, lat, mask=mask)
    fields = {"uo": np.full((10, 20), 0.6) * mask}
    others = [berg(-10.0 - 10.0 * k, 5.0 * k, True) for k in range(6)]
    runs = [Model(Iceberg.join([berg(20.0, 0.0, True), *more]), OceanForcing(grid, grid.fields(**fields)))
            for more in (others, others[:0])]  # fmt: skip
    for model in runs:
        model.advance(steps=12)
    for name in ("lon", "lat", "u", "v"):
        now, alone = (getattr(model.elements, name)[0] for model in runs)
        assert now == pytest.approx(alone, rel=1e-10, abs=1e-15), name
    assert runs[0].elements.lon[0] == pytest.approx(lon[0, 12], abs=1e-3)


def test_a_population_goes_on_from_a_restart(tmp_path: Any) -> None:
    options = {"dt": 10800.0, **MELT, "rolling": {"enabled": True}}
    whole, part = (model_of(population(), Forcing.uniform(**OCEAN), **options) for _ in range(2))
    whole.advance(steps=4)
    part.advance(steps=2)
    part.save(tmp_path / "half.restart.nc")
    rest = Model.resume(tmp_path / "half.restart.nc", part.forcing)
    rest.advance(steps=2)
    for name, values in state_of(whole).items():
        np.testing.assert_array_equal(state_of(rest)[name], values, err_msg=name)
    assert rest.contacts.rows == whole.contacts.rows


@pytest.mark.parametrize("near", [True, False], ids=["rift meets", "rift alone"])
def test_tips_of_rifts_are_told_whichever_bergs_meet(near: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the general step, and by rings that are made once while the ice melts."""
    giant = Iceberg.rectangle(15e3, 15e3, thickness=150.0, radius=500.0, placement=(-41.0, -60.0))
    giant = giant.with_rifts([((-40.997, -60.02), (-40.997, -59.98))], broken=True)
    place = (-41.0, -60.0 - 8.55 / 111.0) if near else (-44.0, -60.0)
    others = [
        Iceberg.rectangle(2e3, 2e3, thickness=150.0, radius=500.0, placement=(place[0] + dx, place[1]))
        for dx in (0.0, 2.03 / 55.7)
    ]
    alone = [berg(8.0 * (k % 40), 30.0 + 8.0 * (k // 40), True) for k in range(300)]
    made, make = [], crack_paths.tip_ring
    monkeypatch.setattr(crack_paths, "tip_ring", lambda *a, **k: made.append(a[3]) or make(*a, **k))
    tips = []
    for least in (1, 10**6):
        monkeypatch.setattr(lone_bergs, "MIN_LONE_BERGS", least)
        made.clear()
        model = Model(Iceberg.join([*alone, giant, *others]), Forcing.uniform(**OCEAN), Parameters(**MELT))
        model.advance(steps=3)
        tips.append(model.rift_tips)
        assert len(made) == 2
    assert np.isfinite([tip.opening for tip in tips[0]]).tolist() == [True, True]
    for one, other in zip(*tips, strict=True):
        assert (one.opening, one.shearing) == pytest.approx((other.opening, other.shearing), rel=1e-6)
