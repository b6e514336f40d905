"""Bergs in a channel of Veros: water and heat of both together close, drag arrives, and bad set-ups are refused."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from riftberg import Forcing, Model, VerosBergs, veros_forcing
from riftberg.errors import InputError
from scripts import loaded

HEAT_CAPACITY = 3991.868

pytest.importorskip("veros", reason="needs the extra riftberg[veros]")


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return loaded("docs/examples/veros_channel.py")


@pytest.fixture(scope="module")
def after_hours(example):
    """Ocean and bergs after six hours, and what the last step gave."""
    channel, bergs = example.coupled()
    example.run(channel, bergs, 0.15)
    given = bergs.step()
    channel.step(channel.state)
    return channel, bergs, given


def arrived(closure, bergs) -> tuple[float, float]:
    """What did not arrive as part of what left the ice."""
    stock, density = bergs.stock(), float(bergs.state.settings.rho_0)
    water = bergs._volume.sum() * density + stock.ice
    return abs(closure.water_error * water / closure.water), abs(
        closure.heat_error * max(abs(stock.ice_heat), abs(stock.ocean_heat)) / closure.heat
    )


def closed(bergs, heat_within: float):
    """The closure of water and heat, once both are found to close."""
    closure = bergs.closure()
    assert abs(closure.water_error) < 1e-13
    assert abs(closure.heat_error) < heat_within
    water, heat = arrived(closure, bergs)
    assert water < 1e-6
    assert heat < 1e-6
    assert abs(bergs.exchange.balance().error) < 1e-12
    return closure


@pytest.mark.slow
def test_what_the_bergs_lose_arrives_in_the_ocean(after_hours) -> None:
    closure = closed(after_hours[1], heat_within=1e-13)
    assert closure.water > 1e9
    assert closure.heat < -1e14


def test_drag_on_the_bergs_arrives_as_momentum(after_hours) -> None:
    channel, bergs, given = after_hours
    vs, density = channel.state.variables, channel.state.settings.rho_0
    area = bergs.exchange.grid.arrays.area[bergs.exchange.grid.domain]
    for name, source, at in (("ibtaux", vs.u_source, vs.area_u), ("ibtauy", vs.v_source, vs.area_v)):
        force = density * (np.asarray(source * vs.dzt).sum(axis=-1) * at)[2:-2, 2:-2].sum()
        on_water = given[name].values * area
        assert force == pytest.approx(float(on_water.sum()), abs=1e-12 * float(np.abs(on_water).sum()))
        assert force != 0.0


def test_sources_are_those_fluxes_of_their_column(after_hours) -> None:
    channel, _, given = after_hours
    vs, density = channel.state.variables, channel.state.settings.rho_0
    for name, source, factor in (
        ("hfibthermds2d", vs.temp_source, density * HEAT_CAPACITY),
        ("ficeberg", vs.salt_source, None),
    ):
        scale = factor or -density / given_salinity(after_hours)
        column = (np.asarray(source) * np.asarray(vs.dzt)).sum(axis=-1)[2:-2, 2:-2].T * scale
        np.testing.assert_allclose(column, given[name].values, rtol=1e-12, atol=1e-25)
        assert np.asarray(source)[2:-2, 2:-2, :-5].any() == np.False_  # nothing below the keel


def given_salinity(after_hours) -> float:
    return float(after_hours[1].salinity)


def test_bergs_take_means_over_their_keel(after_hours) -> None:
    channel, bergs, _ = after_hours
    vs = channel.state.variables
    thick = np.asarray(vs.dzt)
    upper = np.array([max(0.0, min(d, 200.0 - (thick[k + 1 :]).sum())) for k, d in enumerate(thick)])
    assert upper.sum() == pytest.approx(200.0)
    column = np.asarray(vs.temp)[10, 12, :, int(vs.tau)]
    taken = bergs.taken()["sea_surface_temperature"]
    assert taken[10, 8] == pytest.approx((column * upper).sum() / 200.0, rel=1e-13)
    assert bergs.taken()["sea_surface_height_above_geoid"].std() > 0.01


def test_the_large_berg_drifts_with_the_wind_and_the_front(after_hours) -> None:
    _, bergs, _ = after_hours
    elements = bergs.exchange.model.elements
    assert elements.environment.uo[0] > 0.05
    assert elements.u[:200].mean() > 0.0
    assert elements.size > 200


@pytest.mark.slow
@pytest.mark.timeout(3600)  # 22 minutes on a busy machine
def test_thirty_days_close_in_a_channel_that_stays_steady(example) -> None:
    """With layers whose middles Veros did not find the current burst after four days, with and without bergs."""
    channel, bergs = example.coupled()
    for _ in range(6):
        example.run(channel, bergs, 5.0)
        vs = channel.state.variables
        fastest = max(float(np.abs(np.asarray(a)[2:-2, 2:-2, :, int(vs.tau)]).max()) for a in (vs.u, vs.v))
        assert 0.05 < fastest < 0.5
    assert closed(bergs, heat_within=1e-12).water > 1e13
    assert abs(bergs.exchange.balance().heat_error) < 1e-10


def test_the_layers_of_the_channel_lie_apart(example) -> None:
    """Distances between the middles that Veros finds, which came out below zero."""
    channel = example.Channel()
    channel.setup()
    apart, thick = np.asarray(channel.state.variables.dzw), np.asarray(channel.state.variables.dzt)
    assert (apart > 0.5 * thick).all()
    np.testing.assert_allclose(np.diff(np.asarray(channel.state.variables.zt)), apart[:-1], rtol=1e-12)


def test_a_set_up_without_sources_is_refused(example) -> None:
    channel = example.Channel(override={"enable_tempsalt_sources": False})
    channel.setup()
    model = Model(example.bergs(), veros_forcing(channel.state), example.PARAMETERS)
    with pytest.raises(InputError, match=r"enable_tempsalt_sources is off.*settings.enable_tempsalt_sources = True"):
        VerosBergs(channel.state, model)


def test_another_grid_and_a_keel_above_the_water_are_refused(after_hours, example) -> None:
    channel, bergs, _ = after_hours
    with pytest.raises(InputError, match=r"not of the grid of Veros.*veros_forcing"):
        VerosBergs(
            channel.state, Model(example.bergs(), Forcing.uniform(temperature=1.0, salinity=34.0), example.PARAMETERS)
        )
    for keel in (0.0, -5.0, np.nan):
        with pytest.raises(InputError, match="keel"):
            VerosBergs(channel.state, bergs.exchange.model, keel=keel)


def test_the_grid_is_that_of_the_ocean(after_hours) -> None:
    channel, bergs, _ = after_hours
    grid, vs = bergs.exchange.grid, channel.state.variables
    assert grid.arrays.cyclic
    np.testing.assert_allclose(grid.bounds(), ((-0.5, 29.5), (-62.25, -54.25)), rtol=1e-12)
    assert (grid.arrays.mask[grid.domain] == 1.0).all()
    np.testing.assert_array_equal(grid.arrays.area[grid.domain], np.asarray(vs.area_t)[2:-2, 2:-2].T)
