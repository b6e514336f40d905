"""Bergs beside an ocean of any staggering: what leaves the bergs arrives in the cells; ledgers close; bad input is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg import Exchange, FieldRules, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.constants import LATENT_HEAT, RHO_SEAWATER
from riftberg.errors import ForcingError, InputError
from riftberg.life.ledger import scaled_mass

NI, NJ = 16, 12
ALONE = Parameters(
    bonds={"law": "none"}, fracture={"enabled": False}, contact={"iterate": False},
    stepping={"scheme": "verlet", "time_step": 1800.0, "interactions": False, "explicit_substeps": True},
    melt={"enabled": True, "mode": "berg", "base": "turbulent", "bits_fraction": 0.3}, rolling={"enabled": True},
)  # fmt: skip


def grid(mask=None, area=None):
    lon, lat = np.meshgrid(np.linspace(-40.0, -36.0, NI + 1), np.linspace(-58.0, -55.0, NJ + 1))
    return ocean_grid(lon, lat, mask=mask, area=area)


def loose(count: int = 12) -> Iceberg:
    """Bergs of one element, here and there, of many sizes."""
    r = np.random.default_rng(3)
    lon, lat = r.uniform(-39, -37, count), r.uniform(-57.4, -55.6, count)
    berg = Iceberg.from_points(lon, lat, thickness=200.0, radius=500.0)
    e = berg.elements
    e.body.length[:], e.body.width[:] = 10 ** r.uniform(2, 4.2, count), 10 ** r.uniform(2, 3, count)
    e.body.thickness[:] = r.uniform(50, 300, count)
    e.body.mass[:] = 850.0 * e.thickness * e.length * e.width
    e.life.mass_scaling[:] = r.integers(1, 20, count)
    return berg


def exchange(parameters: Parameters = ALONE, berg: Iceberg | None = None, the_grid=None, **options) -> Exchange:
    g = grid() if the_grid is None else the_grid
    return Exchange(Model(berg or loose(), OceanForcing(g, g.fields(depth=500.0)), parameters), **options)


def ocean(**more):
    return {
        "eastward_sea_water_velocity": 0.3,
        "northward_sea_water_velocity": -0.1,
        "eastward_wind": (20.0, "km h-1"),
        "northward_wind": 3.0,
        "sea_surface_temperature": (np.full((NJ, NI), 276.15), "K"),
        "sea_surface_salinity": (34.0, "psu"),
        **more,
    }


def ice_flux(value: float = 0.02):
    flux = np.zeros((NJ, NI))
    flux[3:8, 5] = value
    return {
        "land_ice_specific_mass_flux_due_to_calving": flux,
        "heat_flux_of_calved_ice": np.where(flux > 0, -50.0, 0.0),
    }


def test_what_bergs_lose_arrives_and_the_ledger_closes_to_round_off() -> None:
    run = exchange(ocean_step=3600.0)
    area = run.grid.arrays.area[run.grid.domain]
    for _ in range(20):
        before = run.stocks()
        given = run.step(ocean(**ice_flux(0.05)))
        came = 0.05 * area[3:8, 5].sum() * 3600.0
        went = float(((given["ficeberg"] + given["flandice"]).values * area).sum() * 3600.0)
        after = run.stocks()
        assert abs(before[0] + came - went - after[0]) < 1e-12 * before[0]
    assert abs(run.balance().error) < 1e-12
    assert abs(run.balance().heat_error) < 1e-10
    assert run.model.elements.size > 12  # some were born
    np.testing.assert_allclose(given["ficeberg_process"].sum("process"), given["ficeberg"], rtol=1e-9, atol=1e-18)


def test_cells_hold_the_mass_of_the_bergs_that_cover_them() -> None:
    run = exchange()
    given = run.step(ocean())
    area = run.grid.arrays.area[run.grid.domain]
    elements = run.model.elements
    total = scaled_mass(elements.life, elements.body.mass).sum()
    assert float(((given["ibmass"] + given["ibmassgrd"]).values * area).sum()) == pytest.approx(total, rel=1e-13)
    assert float(given["ibarea"].max()) <= 1.0
    assert ((given["ibustar"].values > 0) == (given["ibarea"].values > 0)).all()


def drifting_west(edge: str, berg: Iceberg, lon=-40.0, **more) -> Exchange:
    corners = np.meshgrid(np.linspace(lon, lon + 4.0, NI + 1), np.linspace(-58.0, -55.0, NJ + 1))
    g = ocean_grid(*corners, edge=edge)
    p = Parameters(melt={"enabled": True, "base": "turbulent", **more}, stepping={"time_step": 1800.0})
    return Exchange(Model(berg, OceanForcing(g, g.fields(depth=500.0)), p), staggering="A")


WEST = {**ocean(), "eastward_sea_water_velocity": -0.5, "northward_sea_water_velocity": 0.0, "northward_wind": 0.0}
WEST["eastward_wind"] = -15.0


@pytest.mark.compiled
def test_a_berg_leaves_an_open_edge_whole_is_counted_and_handed_over() -> None:
    """The ledgers close on both sides; a closed edge holds the berg."""
    large = Iceberg.rectangle(9e3, 6e3, thickness=200.0, radius=1500.0, placement=(-39.91, -56.5))
    berg = Iceberg.join([large, Iceberg.rectangle(2e3, 2e3, thickness=100.0, radius=1e3, placement=(-37.0, -56.5))])
    here, beyond = (
        drifting_west("open", berg),
        drifting_west("closed", Iceberg.from_points([-42.0], [-56.5], thickness=90.0, radius=300.0), lon=-43.5),
    )
    ice, elements = here.stocks(), here.model.elements.size
    while not here.departed:
        assert here.model.time < 86400.0
        here.step(WEST)
    ((gone, bonds),) = here.departed
    assert (gone.size, bonds.first.size) == (large.elements.size, large.bonds.first.size)
    assert gone.place.lon.min() < -40.0 < gone.place.lon.max()
    assert here.model.elements.size == elements - gone.size
    balance = here.balance()
    # Both bergs melt on the way to the edge, within a day.
    for ice_before in (ice[0] - here.stocks()[0], large.elements.mass.sum()):
        assert 0.0 < ice_before - balance.left < 2e-3 * balance.left
    assert balance.heat_left == pytest.approx(-LATENT_HEAT * balance.left, rel=1e-12)
    assert abs(balance.error) < 1e-12
    assert abs(balance.heat_error) < 1e-12
    beyond.model.append(gone, bonds)
    before = beyond.model.elements.place.lon.max()
    beyond.step(WEST)
    assert beyond.model.elements.place.lon.max() < before
    here.step(WEST)
    assert here.departed == []
    assert here.balance().left == balance.left


@pytest.mark.compiled
def test_currents_do_not_fade_towards_an_open_edge_and_a_closed_one_holds_bergs() -> None:
    berg = Iceberg.from_points([-39.97], [-56.5], thickness=100.0, radius=300.0)
    closed, opened = drifting_west("closed", berg), drifting_west("open", berg)
    for run in (closed, opened):
        run.step({**WEST, "eastward_sea_water_velocity": np.full((NJ, NI), -0.5)})
    assert opened.model.elements.environment.uo[0] == pytest.approx(-0.5, rel=1e-12)
    assert -0.3 < closed.model.elements.environment.uo[0] < 0.0
    for run in (closed, opened):
        for _ in range(8):
            run.step({**WEST, "eastward_sea_water_velocity": np.full((NJ, NI), -0.5)})
    assert closed.model.elements.size == 1
    assert closed.model.elements.place.lon[0] >= -40.0
    assert closed.balance().left == 0.0
    assert opened.model.elements.size == 0
    assert opened.balance().left > 0.99 * opened.balance().start
    assert abs(opened.balance().error) < 1e-12


def test_beyond_a_pole_and_across_a_period_there_is_no_edge() -> None:
    lon, lat = np.meshgrid(np.linspace(0.0, 360.0, 13), np.linspace(60.0, 90.0, 7))
    mask = np.ones((6, 12))
    mask[0, 3] = 0.0
    g = ocean_grid(lon, lat, mask=mask).arrays
    h = g.halo
    assert g.cyclic
    assert (g.mask[h + 6 :] == 0.0).all()
    np.testing.assert_array_equal(g.mask[h - 1, h : h + 12], mask[0])
    assert (ocean_grid(lon, lat, mask=mask, edge="closed").arrays.mask[h - 1] == 0.0).all()
    with pytest.raises(InputError, match="Use open or closed"):
        ocean_grid(lon, lat, edge="wall")


def test_heat_is_the_latent_heat_of_the_melt_water() -> None:
    given = exchange().step(ocean())
    np.testing.assert_allclose(given["hfibthermds2d"], -LATENT_HEAT * given["ficeberg"], rtol=1e-12)
    assert float(given["ficeberg"].max()) > 0.0


def test_drag_on_the_water_is_what_the_water_does_to_the_bergs_turned_round() -> None:
    run = exchange(ALONE.changed(melt={"enabled": False}, rolling={"enabled": False}))
    given = run.step(ocean())
    area = run.grid.arrays.area[run.grid.domain]
    for k, name in enumerate(("ibtaux", "ibtauy")):
        force = run.model.applied_forces()[:, 0, k] * run.model.elements.life.mass_scaling
        assert float((given[name].values * area).sum()) == pytest.approx(-force.sum(), rel=1e-12)


def test_a_berg_aground_weighs_on_the_floor() -> None:
    g = grid()
    berg = loose(3)
    run = Exchange(Model(berg, OceanForcing(g, g.fields(depth=20.0)), ALONE.changed(melt={"enabled": False})))
    given = run.step(ocean())
    share = float(given["ibmassgrd"].sum() / (given["ibmassgrd"] + given["ibmass"]).sum())
    assert 0.5 < share < 1.0
    area = run.grid.arrays.area[run.grid.domain]
    carried = float((given["ibmassgrd"].values * area).sum())
    e = run.model.elements
    afloat = 20.0 * RHO_SEAWATER / (850.0 * e.body.thickness)  # share of the weight that 20 m of water bear
    assert carried == pytest.approx(float((e.body.mass * (1.0 - afloat) * e.life.mass_scaling).sum()), rel=1e-9)


@pytest.mark.parametrize("staggering", ["A", "B", "C"])
def test_a_uniform_current_is_the_same_in_every_staggering(staggering: str) -> None:
    run = exchange(staggering=staggering)  # type: ignore[arg-type]
    run.step(ocean())
    np.testing.assert_allclose(run.model.elements.environment.uo, 0.3, rtol=1e-12)


def test_stress_in_place_of_wind_gives_the_wind_of_the_reference() -> None:
    run = exchange()
    taken = ocean(surface_downward_eastward_stress=0.15, surface_downward_northward_stress=0.0)
    for name in ("eastward_wind", "northward_wind"):
        del taken[name]
    run.step(taken)
    np.testing.assert_allclose(run.model.elements.environment.ua, 0.15 / np.sqrt(0.0015 * 0.15), rtol=1e-12)


def test_a_dataset_with_standard_names_is_taken() -> None:
    cells = ("j", "i"), np.full((NJ, NI), 2.0), {"standard_name": "sea_surface_temperature", "units": "degC"}
    run = exchange()
    run.step(xr.Dataset({"tos": cells}))
    assert (run.model.elements.environment.sst == 2.0).all()


def test_areas_of_the_ocean_model_are_those_that_fluxes_are_of() -> None:
    area = np.full((NJ, NI), 5e8)
    run = exchange(the_grid=grid(area=area))
    before = run.stocks()[0]
    given = run.step(ocean())
    assert float((given["ficeberg"] * 5e8 * 1800.0).sum()) == pytest.approx(before - run.stocks()[0], rel=1e-9)


def test_a_running_mean_of_the_flux_loses_nothing() -> None:
    run = exchange(ALONE.changed(calving={"smoothing_time": 86400.0}))
    for k in range(10):
        run.step(ocean(**ice_flux(0.01 if k < 5 else 0.0)))
    assert abs(run.balance().error) < 1e-12
    assert abs(run.balance().heat_error) < 1e-10


def test_a_run_that_stopped_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole, first = exchange(), exchange()
    for _ in range(6):
        last = whole.step(ocean(**ice_flux()))
    for _ in range(3):
        first.step(ocean(**ice_flux()))
    first.model.save(tmp_path / "r.nc")
    g = grid()
    model = Model.resume(tmp_path / "r.nc", OceanForcing(g, g.fields(depth=500.0)))
    second = Exchange(model)
    for _ in range(3):
        again = second.step(ocean(**ice_flux()))
    assert second.stocks() == whole.stocks()
    xr.testing.assert_identical(again, last)
    assert second.balance() == whole.balance()


@pytest.mark.parametrize(("shift", "wider"), [((0.5, 0.0), 0.0), ((0.0, -0.5), 0.0), ((0.0, 0.0), 0.1)])
def test_a_restart_on_a_grid_of_as_many_cells_elsewhere_is_refused(
    shift: tuple[float, float], wider: float, tmp_path: Path
) -> None:
    """Its stores of ice, and what a coupler is still to get, would lie in other cells."""
    exchange().model.save(tmp_path / "r.nc")
    west, south = -40.0 + shift[0], -58.0 + shift[1]
    lon, lat = np.linspace(west, west + 4.0, NI + 1), np.linspace(south, south + 3.0, NJ + 1)
    lat[-1] += wider
    moved = ocean_grid(*np.meshgrid(lon, lat))
    with pytest.raises(InputError, match="the grid of the exchange reached from"):
        Exchange(Model.resume(tmp_path / "r.nc", OceanForcing(moved, moved.fields(depth=500.0))))


@pytest.mark.parametrize("step", [0.0, -1800.0, float("nan"), float("inf"), "soon"])
def test_a_step_of_the_ocean_that_is_none_is_refused_by_name(step: float | str) -> None:
    """A step that is no number ended in an error of Python."""
    with pytest.raises(InputError, match=r"Exchange, ocean_step: .*(Give a finite number above 0|Allowed: a number)"):
        exchange(ocean_step=step)


def test_a_step_of_the_ocean_may_have_a_unit() -> None:
    assert exchange(ocean_step="2 h").steps * exchange().ocean_step == 7200.0


def test_steps_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"ocean steps by 2000 s, the bergs by 1800 s.*whole number"):
        exchange(ocean_step=2000.0)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"sea_surface_temperature": np.full((NJ, NI), 275.0)}, "looks like kelvin"),
        ({"sea_surface_temperature": (1.0, "m")}, "units are 'm'"),
        ({"eastward_wind": (1.0, "kg")}, "units are 'kg'"),
        ({"sea_surface_temprature": 1.0}, "Did you mean 'sea_surface_temperature'"),
        ({"sea_surface_height_above_geoid": np.zeros((3, 3))}, r"shape \(3, 3\)"),
        ({"land_ice_specific_mass_flux_due_to_calving": np.full((NJ, NI), -1e-3)}, "-0.001"),
        ({"sea_ice_area_fraction": 40.0}, "Check its units"),
        ({"land_ice_specific_mass_flux_due_to_calving": np.zeros((NJ + 2, NI + 2))}, r"shape \(14, 18\), expected"),
        ({"sea_surface_salinity": np.full((NJ, NI), np.nan)}, "nan"),
        ({"surface_downward_eastward_stress": 0.1}, "alone"),
    ],
)
def test_bad_fields_are_refused_before_anything_is_stepped(more, message: str) -> None:
    run = exchange()
    with pytest.raises(InputError, match=message):
        run.step(ocean(**more))
    assert run.model.step_number == 0


def test_melt_without_temperature_and_calving_into_land_are_refused() -> None:
    with pytest.raises(ForcingError, match="no sea_surface_temperature"):
        exchange().step({})
    mask = np.ones((NJ, NI))
    mask[4, 5] = 0.0
    run = exchange(the_grid=grid(mask=mask), berg=loose(1))
    with pytest.raises(InputError, match=r"cell \(6, 5\), which is land"):
        run.step(ocean(**ice_flux()))


@pytest.mark.parametrize(
    "name", ["sea_surface_temperature", "sea_surface_salinity", "sea_floor_depth_below_geoid", "eastward_wind"]
)
@pytest.mark.parametrize("shape", [(), (NJ + 2, NI + 2)])
def test_missing_values_over_water_are_refused_in_every_step(name: str, shape: tuple[int, ...]) -> None:
    """From the second step on they became 0, with a number or a ring around the cells."""
    run = exchange()
    run.step(ocean())
    values = np.full(shape, 1.0)
    values[(7, 8) if shape else ...] = np.nan
    with pytest.raises(InputError, match=r"nan|NaN over water in cell"):
        run.step(ocean(**{name: values}))
    assert run.model.step_number == 1


def test_land_may_lack_values_and_the_sea_beyond_an_open_edge_may_not() -> None:
    mask = np.ones((NJ, NI))
    mask[:3, 2:] = 0.0
    run = exchange(the_grid=grid(mask=mask), berg=loose(1))
    around = np.pad(np.where(mask > 0.0, 3.0, np.nan), 1, mode="edge")
    for _ in range(2):
        run.step(ocean(sea_surface_temperature=around))
    around[0, 0] = np.nan
    with pytest.raises(InputError, match=r"sst is NaN over water in cell \(0, 0\)"):
        run.step(ocean(sea_surface_temperature=around))
    assert run.model.step_number == 2


def test_the_sea_floor_at_the_start_has_no_gaps_over_water() -> None:
    depth = np.full((NJ, NI), 500.0)
    depth[4, 5] = np.nan
    g = grid()
    with pytest.raises(ForcingError, match=r"depth is NaN over water in cell \(6, 5\)"):
        OceanForcing(g, g.fields(depth=depth))


def test_gaps_that_the_rules_let_through_are_those_of_the_sea_level() -> None:
    gaps = np.zeros((NJ, NI))
    gaps[4, 5] = np.nan
    rules = FieldRules(depth_rule="zone", zone=(-38.0, -56.0), sea_level_gaps=True)
    g = grid()
    OceanForcing(g, g.fields(ssh=gaps), rules=rules)
    with pytest.raises(ForcingError, match="sst is NaN over water"):
        OceanForcing(g, g.fields(sst=gaps), rules=rules)


@pytest.mark.parametrize("turn", [0.5, 0.5 * np.pi])
def test_drag_on_the_water_is_along_the_rows_of_a_turned_grid(turn: float) -> None:
    """It was east and north whatever the grid."""

    def stress(turn: float) -> tuple[float, float]:
        x, y = np.meshgrid(np.linspace(-1e5, 1e5, 21), np.linspace(-1e5, 1e5, 21))
        c, s = np.cos(turn), np.sin(turn)
        angles = {"cos_angle": np.full((20, 20), c), "sin_angle": np.full((20, 20), -s)}
        g = ocean_grid(c * x - s * y, s * x + c * y, latlon=False, regular=turn == 0.0, **angles)
        berg = Iceberg.rectangle(3e3, 3e3, thickness=200.0, latlon=False)
        p = Parameters(earth={"latlon": False, "reference_latitude": -60.0})
        run = Exchange(Model(berg, OceanForcing(g, g.fields()), p), staggering="A")
        given = run.step({"eastward_sea_water_velocity": 0.3, "northward_sea_water_velocity": 0.0})
        return float(given["ibtaux"].sum()), float(given["ibtauy"].sum())

    assert stress(turn) == pytest.approx(stress(0.0), rel=1e-6)


def test_a_resumed_exchange_meets_the_ocean_that_it_left(tmp_path: Path) -> None:
    """Its first step was one in an ocean at rest, and fields that had been handed over once were gone."""
    whole = exchange(Parameters(melt={"enabled": True}), loose(1))
    whole.step(ocean(sea_floor_depth_below_geoid=120.0))
    whole.step(ocean())
    whole.model.save(tmp_path / "r.nc")
    g = grid()
    again = Exchange(Model.resume(tmp_path / "r.nc", OceanForcing(g, g.fields())))
    with pytest.raises(InputError, match=r"no sea_floor_depth_below_geoid, which the run had before its restart"):
        again.step(ocean())
    given = ocean(sea_floor_depth_below_geoid=120.0)
    xr.testing.assert_identical(again.step(given), whole.step(given))
    for run in (whole, again):
        given = run.step(ocean())
    assert again.model.elements.u[0] == whole.model.elements.u[0]
    assert again.model.elements.depth[0] == pytest.approx(120.0)


def test_births_count_once_in_the_ledger_of_life() -> None:
    """Those of the first step stood in the stock at the start, too, and what others added before births was not entered."""
    run = exchange(ALONE, loose(1))
    more = loose(1).elements

    def add(model) -> None:
        if model.step_number == 2:
            model.append(more)

    run.model.after_step.append(add)
    for _ in range(4):
        run.step(ocean(**ice_flux(1.0)))
        assert run.model.elements.size > 1
        assert abs(run.model.life.balance(run.model).error) < 1e-12
    gained = run.model.life.balance(run.model).gained
    assert gained["calved"] > 0.0
    assert gained["other"] == pytest.approx(scaled_mass(more.life, more.body.mass).sum(), rel=1e-9)


def test_missing_calving_on_land_is_no_ice() -> None:
    """It went into stores, budget and what the ocean gets, as NaN."""
    mask = np.ones((NJ, NI))
    mask[0] = 0.0
    run = exchange(the_grid=grid(mask=mask), berg=loose(1))
    given = ice_flux()
    for values in given.values():
        values[0] = np.nan
    back = run.step(ocean(**given))
    assert np.isfinite(back["flandice"]).all()
    assert abs(run.balance().error) < 1e-12
    assert abs(run.balance().heat_error) < 1e-10


def test_ice_that_a_process_adds_lies_in_its_own_cells() -> None:
    """It was put under another berg in the step in which it came."""
    berg = Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=(-39.0, -57.0))
    run = exchange(Parameters(melt={"enabled": True}), berg)
    run.step(ocean())
    added = Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=(-37.0, -56.0)).elements

    def add(model) -> None:
        if model.elements.size == 1:
            model.append(added)

    run.model.after_step.append(add)
    given = run.step(ocean())
    area = run.grid.arrays.area[run.grid.domain]
    assert float((given["ibmass"].values * area)[7:9, 11:13].sum()) == pytest.approx(added.mass.sum(), rel=1e-12)


def test_a_berg_that_calves_gives_the_ocean_all_its_drag() -> None:
    """The mass that it had left was counted, not that with which it was moved."""
    p = Parameters(melt={"enabled": True}, footloose={"enabled": True, "style": "bits"})
    run = exchange(p, loose(1), staggering="A")
    run.step(ocean())
    run.model.elements.life.fl_k[:] = 2e6
    area, before = run.grid.arrays.area[run.grid.domain], run.model.elements.mass[0]
    impulse = [run.model.motion.balance(run.model, run.model.remembered).impulse["water"]]
    given = run.step(ocean())
    impulse.append(run.model.motion.balance(run.model, run.model.remembered).impulse["water"])
    assert run.model.elements.mass[0] < 0.9 * before
    for k, name in enumerate(("ibtaux", "ibtauy")):
        to_ocean = float((given[name].values * area).sum()) * run.ocean_step
        assert to_ocean == pytest.approx(-(impulse[1][k] - impulse[0][k]), rel=1e-9)


@pytest.mark.parametrize("fails_in", [1, 3, 4])
def test_a_step_that_fails_is_taken_back_with_births_and_stores(fails_in: int) -> None:
    """Newborn bergs stayed, and the ice that they had come from was in the stores no more and in no budget."""
    settings = ALONE.changed(calving={"smoothing_time": 86400.0})
    run, other = (exchange(settings, loose(1), ocean_step=3600.0) for _ in range(2))
    given, fail = ocean(**ice_flux(1.0)), [True]

    def fails(model) -> None:
        if fail[0] and model.step_number == fails_in:
            raise RuntimeError

    run.model.after_step.append(fails)
    other.model.after_step.append(lambda model: None)
    for _ in range((fails_in - 1) // 2):
        run.step(given)
        other.step(given)
    with pytest.raises(RuntimeError):
        run.step(given)
    assert run.balance() == other.balance()
    assert run.model.time == other.model.time
    assert run.model.elements.size == other.model.elements.size
    fail[0] = False
    for _ in range(2):
        xr.testing.assert_identical(run.step(given), other.step(given))
    assert run.balance() == other.balance()
    assert abs(run.balance().error) < 1e-12
    np.testing.assert_array_equal(run.model.elements.id, other.model.elements.id)


def test_a_berg_that_leaves_gives_the_ocean_its_last_drag_at_the_edge() -> None:
    """What it did to the water in the step in which it left was given to nobody."""
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-39.95, -56.6), velocity=(-1.0, 0.0))
    run = drifting_west("open", berg)
    area = run.grid.arrays.area[run.grid.domain]
    while not run.departed:
        before = run.model.motion.balance(run.model, run.model.remembered).impulse["water"]
        given = run.step(WEST)
    after = run.model.motion.balance(run.model, run.model.remembered).impulse["water"]
    assert run.model.elements.size == 0
    for k, name in enumerate(("ibtaux", "ibtauy")):
        force = given[name].values * area
        assert float(force.sum()) * run.ocean_step == pytest.approx(-(after[k] - before[k]), rel=1e-9)
        assert force[5:7, 0].sum() == pytest.approx(force.sum(), rel=1e-12)


def test_an_ocean_without_a_sea_level_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    """Bergs of 15 km stood still beside a coupled ocean that handed over its currents alone, in silence."""
    for more, count in (({}, 1), ({"sea_surface_height_above_geoid": 0.1}, 0)):
        caplog.clear()
        beside = exchange()
        for _ in range(3):
            beside.step(ocean(**more))
        assert len([text for text in caplog.messages if "the ocean gives no sea level" in text]) == count


def test_recorders_follow_an_exchange_from_what_was_shown_to_the_bergs_at_their_start() -> None:
    """With an ocean at rest in the place of the one that is handed over, the first step took half of either."""
    lon, lat = np.meshgrid(np.linspace(-40, -36, 17), np.linspace(-58, -55, 13))
    ocean = {
        "eastward_sea_water_velocity": 0.3,
        "northward_sea_water_velocity": 0.1,
        "sea_surface_height_above_geoid": 0.0,
    }
    ends, times = [], []

    class Recorder:
        def start(self, model: Model) -> None:
            times.append((model.time, float(model.elements.uo.mean())))

        def record(self, model: Model) -> None:
            times.append((model.time, float(model.elements.uo.mean())))

        def finish(self, model: Model) -> None: ...

    for recorded in (False, True):
        grid = ocean_grid(lon, lat)
        berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-38.0, -56.5))
        model = Model(berg, OceanForcing(grid, grid.fields()), Parameters(stepping={"time_step": 1800.0}))
        exchange = Exchange(model, 3600.0, staggering="A")
        if recorded:
            exchange.show(ocean)
            model.advance(steps=4, recorders=[Recorder()], step=lambda exchange=exchange: exchange.step(ocean))
        else:
            for _ in range(2):
                exchange.step(ocean)
        ends.append((model.elements.lon.tolist(), model.elements.u.tolist()))
    assert ends[0] == ends[1]
    assert times == [(0.0, pytest.approx(0.3)), (3600.0, pytest.approx(0.3)), (7200.0, pytest.approx(0.3))]
