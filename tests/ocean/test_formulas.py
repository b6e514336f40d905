"""Forcing by formula: every current with its sea surface, its curl and its sum with others."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import DatasetForcing, Forcing, Iceberg, Model, Parameters
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.formulas import Flow
from riftberg.state import Elements, new_elements

G, OMEGA, RADIUS = 9.8, 7.292e-5, 6363827.0
CENTRE = (-37.0, -56.0)

FLOWS: dict[str, Any] = {
    "uniform": lambda **k: Forcing.uniform((0.2, -0.1), **k),
    "eddy": lambda **k: Forcing.eddy(CENTRE if k.get("latlon", True) else (0.0, 0.0), 40e3, -0.6, **k),
    "travelling eddy": lambda **k: Forcing.eddy(
        CENTRE if k.get("latlon", True) else (0.0, 0.0), 40e3, 0.6, (0.2, 0.1), **k
    ),
    "jet": lambda **k: Forcing.jet(CENTRE if k.get("latlon", True) else (0.0, 0.0), 60.0, 0.7, 30e3, **k),
    "shear": lambda **k: Forcing.shear(CENTRE if k.get("latlon", True) else (0.0, 0.0), 200.0, 0.4, 25e3, **k),
    "front": lambda **k: Forcing.front(CENTRE if k.get("latlon", True) else (0.0, 0.0), 100.0, 0.4, 30e3, **k),
}


def points(seed: int = 1, count: int = 40, latlon: bool = True) -> Elements:
    """Return elements at random places around the centre."""
    r, e = np.random.default_rng(seed), new_elements(count)
    if latlon:
        e.lon[:], e.lat[:] = CENTRE[0] + r.uniform(-1.5, 1.5, count), CENTRE[1] + r.uniform(-0.8, 0.8, count)
    else:
        e.lon[:], e.lat[:] = r.uniform(-9e4, 9e4, (2, count))
    return e


def moved(e: Elements, east: float, north: float, latlon: bool) -> Elements:
    """Return elements some metres away."""
    out = new_elements(e.size)
    scale = np.pi / 180.0 * RADIUS if latlon else 1.0
    out.lon[:] = e.lon + east / (scale * (np.cos(np.radians(e.lat)) if latlon else 1.0))
    out.lat[:] = e.lat + north / scale
    return out


@pytest.mark.parametrize(
    "options", [{}, {"latitude": -56.0}, {"latlon": False, "latitude": 70.0}], ids=["f", "f-plane", "metres"]
)
@pytest.mark.parametrize("name", FLOWS)
def test_a_current_is_in_balance_with_its_sea_surface(name: str, options: dict[str, Any]) -> None:
    """That is Du/Dt - f v = -g d(eta)/dx and Dv/Dt + f u = -g d(eta)/dy, f of the place or of the plane."""
    latlon, time = options.get("latlon", True), 7200.0
    flow, e = FLOWS[name](**options), points(latlon=latlon)
    flow.sample(e, time)
    f = 2.0 * OMEGA * np.sin(np.radians(options.get("latitude", e.lat))) * np.ones(e.size)
    assert np.hypot(e.uo, e.vo).max() > 0.05
    change = material_change(flow, e, time, latlon)
    if name == "uniform":
        np.testing.assert_allclose(G * e.slope_x, f * e.vo, rtol=1e-12, atol=1e-18)
    size = abs(f * np.hypot(e.uo, e.vo)).max()
    np.testing.assert_allclose(G * e.slope_x, f * e.vo - change[0], rtol=0, atol=1e-5 * size)
    np.testing.assert_allclose(G * e.slope_y, -f * e.uo - change[1], rtol=0, atol=1e-5 * size)
    for shown, own in zip(flow.currents(e.lon, e.lat, time), (e.uo, e.vo), strict=True):
        np.testing.assert_array_equal(shown, own)


def material_change(flow: Any, e: Elements, time: float, latlon: bool) -> list[Any]:
    """Return du/dt + u du/dx + v du/dy, and the same of v, from differences in place and time."""
    size, at = 50.0, {}
    for key, (east, north, later) in {
        "e": (size, 0.0, 0.0), "w": (-size, 0.0, 0.0), "n": (0.0, size, 0.0), "s": (0.0, -size, 0.0),
        "later": (0.0, 0.0, size), "before": (0.0, 0.0, -size),
    }.items():  # fmt: skip
        there = moved(e, east, north, latlon)
        at[key] = flow.currents(there.lon, there.lat, time + later)
    return [
        (at["later"][k] - at["before"][k] + e.uo * (at["e"][k] - at["w"][k]) + e.vo * (at["n"][k] - at["s"][k])) / (2.0 * size)
        for k in (0, 1)
    ]  # fmt: skip


def test_an_eddy_has_the_gradient_wind() -> None:
    """The slope is g d(eta)/dr = f v + v^2 / r at rest, and what is left of it for one that travels at c: - (u - c) . grad u."""
    for velocity in ((0.0, 0.0), (0.3, -0.1)):
        eddy = Forcing.eddy((0.0, 0.0), 40e3, 0.8, velocity, latlon=False, latitude=-56.0)
        e = points(latlon=False)
        eddy.sample(e, 0.0)
        x, y, f = e.lon, e.lat, 2.0 * OMEGA * np.sin(np.radians(-56.0))
        turning = 0.8 / 40e3 * np.exp(0.5 * (1.0 - (x * x + y * y) / 40e3**2))
        rise = -turning / 40e3**2
        u, v = -turning * y - velocity[0], turning * x - velocity[1]
        change_x = u * (-rise * x * y) + v * (-turning - rise * y * y)
        change_y = u * (turning + rise * x * x) + v * (rise * x * y)
        np.testing.assert_allclose(G * e.slope_x, f * e.vo - change_x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(G * e.slope_y, -f * e.uo - change_y, rtol=0, atol=1e-9)


def test_the_water_of_a_sum_goes_with_all_currents() -> None:
    """A uniform current that carries the water through an eddy at rest: the change along its path, not that of each alone."""
    at = {"latlon": False, "latitude": -56.0}
    eddy, flow = Forcing.eddy((0.0, 0.0), 40e3, 0.5, **at), Forcing.uniform((0.4, 0.2), **at)
    together, alone, e, one = eddy + flow, (eddy, flow), points(latlon=False), points(latlon=False)
    together.sample(e, 0.0)
    slope = np.zeros(e.size)
    for part in alone:
        part.sample(one, 0.0)
        slope += one.slope_x
    change = material_change(together, e, 0.0, False)
    f = 2.0 * OMEGA * np.sin(np.radians(-56.0))
    np.testing.assert_allclose(G * e.slope_x, f * e.vo - change[0], rtol=0, atol=1e-9)
    assert abs(e.slope_x - slope).max() > 1e-7


@pytest.mark.parametrize("latlon", [True, False])
@pytest.mark.parametrize("name", FLOWS)
def test_vorticity_is_the_curl_of_the_current(name: str, latlon: bool) -> None:
    options = {} if latlon else {"latlon": False, "latitude": -56.0}
    flow, e = FLOWS[name](**options), points(2, latlon=latlon)
    flow.sample(e, 3600.0)
    size, ends = 5.0, []
    for east, north in ((size, 0.0), (-size, 0.0), (0.0, size), (0.0, -size)):
        at = moved(e, east, north, latlon)
        flow.sample(at, 3600.0)
        ends.append((at.uo.copy(), at.vo.copy()))
    curl = (ends[0][1] - ends[1][1] - ends[2][0] + ends[3][0]) / (2.0 * size)
    # On the sphere the formulas use the plane of the mean latitude, f varies along a front: a few percent of the largest.
    np.testing.assert_allclose(
        e.vorticity, curl, rtol=0, atol=(0.05 if latlon else 1e-4) * max(np.abs(curl).max(), 1e-9)
    )


def test_shapes_are_what_their_words_say() -> None:
    flat: dict[str, Any] = {"latlon": False, "latitude": -56.0}
    at = np.array([[0.0, 0.0], [40e3, 0.0], [0.0, 40e3]])
    u, v = Forcing.eddy((0.0, 0.0), 40e3, 0.5, **flat).currents(*at.T, 0.0)
    np.testing.assert_allclose(u, [0.0, 0.0, -0.5], atol=1e-15)  # counter-clockwise
    np.testing.assert_allclose(v, [0.0, 0.5, 0.0], atol=1e-15)
    u, v = Forcing.eddy((0.0, 0.0), 40e3, 0.5, (1.0, 0.0), **flat).currents(*at[:1].T, 40e3)
    np.testing.assert_allclose(v, -0.5)  # it has gone east and leaves the point on its western side
    u, v = Forcing.jet((0.0, 0.0), 90.0, 0.5, 10e3, **flat).currents(*at.T, 0.0)
    np.testing.assert_allclose(u, [0.5, 0.5, 0.5 / np.cosh(4.0) ** 2])
    np.testing.assert_allclose(v, 0.0, atol=1e-16)
    u, v = Forcing.shear((0.0, 0.0), 0.0, 0.5, 10e3, **flat).currents(*at.T, 0.0)
    np.testing.assert_allclose(v, [0.0, -0.5 * np.tanh(4.0), 0.0], atol=1e-16)  # northward on the left, the west
    # High water on the left of an eastward line in the south drives an eastward current.
    u, _ = Forcing.front((0.0, 0.0), 90.0, 0.3, 10e3, **flat).currents(*at.T, 0.0)
    assert u[0] > 0.05


def test_the_sea_level_of_a_front_steps_by_what_was_asked() -> None:
    front, e = Forcing.front((0.0, 0.0), 90.0, 0.3, 10e3, latlon=False, latitude=-56.0), new_elements(4001)
    e.lat[:] = np.linspace(-100e3, 100e3, 4001)
    front.sample(e, 0.0)
    assert np.trapezoid(e.slope_y, e.lat) == pytest.approx(0.3, rel=1e-6)
    with pytest.raises(ForcingError, match="near the equator"):
        Forcing.front((0.0, 0.0), 90.0, 0.3, 10e3).sample(new_elements(1), 0.0)


def test_a_front_sets_the_temperature_of_its_sides() -> None:
    front, e = Forcing.front(CENTRE, 90.0, 0.3, 10e3, temperature=(-1.0, 3.0)), new_elements(2)
    e.lon[:], e.lat[:] = CENTRE[0], (-55.0, -57.0)
    front.sample(e, 0.0)
    np.testing.assert_allclose(e.sst, [-1.0, 3.0], atol=1e-6)


def test_water_is_free_in_a_tide() -> None:
    """du/dt - f v = -g d(eta)/dx: the slopes move the water itself."""
    tide, e = Forcing.tide(0.3, 0.1, towards=30.0, phase=40.0), points(3)
    step, time = 1.0, 9000.0
    now = []
    for t in (time - step, time, time + step):
        tide.sample(e, t)
        now.append([a.copy() for a in (e.uo, e.vo, e.slope_x, e.slope_y)])
    f = 2.0 * OMEGA * np.sin(np.radians(e.lat))
    du, dv = ((now[2][k] - now[0][k]) / (2.0 * step) for k in (0, 1))
    np.testing.assert_allclose(du - f * now[1][1], -G * now[1][2], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(dv + f * now[1][0], -G * now[1][3], rtol=1e-6, atol=1e-12)
    speeds = [np.hypot(*tide.currents(0.0, 0.0, t)) for t in np.linspace(0.0, tide.period, 721)]
    assert (max(speeds), min(speeds)) == pytest.approx((0.3, 0.1), rel=1e-4)


def test_the_shallowest_sea_floor_counts() -> None:
    floor = Forcing.slope(CENTRE, 90.0, 0.001, 400.0) + Forcing.seamount(CENTRE, 300.0, 10e3, 500.0)
    e = new_elements(3)
    e.lon[:], e.lat[:] = (CENTRE[0], CENTRE[0] + 1.0, CENTRE[0] - 1.0), CENTRE[1]
    floor.sample(e, 0.0)
    away = RADIUS * np.radians(1.0) * np.cos(np.radians(CENTRE[1]))
    np.testing.assert_allclose(e.depth, [200.0, 400.0 + 0.001 * away, 400.0 - 0.001 * away])
    np.testing.assert_array_equal(floor.depth(e.lon, e.lat), e.depth)
    (Forcing.uniform() + Forcing.eddy(CENTRE, 1e4, 0.1)).sample(e, 0.0)
    np.testing.assert_array_equal(e.depth, 1e4)  # no part has a sea floor


def test_sums_add_and_do_not_depend_on_the_order() -> None:
    parts = [make() for make in FLOWS.values()]
    wind = Forcing.turning_wind(10.0, towards=0.0, turning=90.0)
    one = parts[0] + parts[1] + parts[2] + wind + Forcing.uniform(wind=(1.0, 0.0), depth=300.0)
    other = Forcing.uniform(wind=(1.0, 0.0), depth=300.0) + (wind + parts[2]) + (parts[1] + parts[0])
    a, b, total = points(4), points(4), points(4)
    one.sample(a, 3600.0)
    other.sample(b, 3600.0)
    np.testing.assert_allclose(a.ua, 11.0)  # blew to the north, and has turned to the east in an hour
    np.testing.assert_allclose(a.va, 0.0, atol=1e-14)
    u = np.zeros(a.size)
    for part in parts[:3]:
        part.sample(total, 3600.0)
        u += total.uo
    for name in ("uo", "vo", "slope_x", "slope_y", "vorticity", "ua", "depth"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=1e-15)
    np.testing.assert_allclose(a.uo, u, atol=1e-15)
    one.sample(a, 3600.0)  # nothing is left from before
    np.testing.assert_array_equal(a.depth, 300.0)
    np.testing.assert_allclose(a.uo, b.uo, atol=1e-15)


def test_a_berg_follows_a_balanced_jet() -> None:
    """Without the slope it would drift off to the left at half the speed."""
    berg = Iceberg.rectangle(9e3, 9e3, thickness=200.0, placement=CENTRE, velocity=(0.3, 0.0))
    model = Model(berg, Forcing.jet(CENTRE, 90.0, 0.3, 200e3), Parameters(stepping={"time_step": 3600.0}))
    model.advance(3)
    u, v = (a.mean() for a in model.velocity())
    assert u == pytest.approx(0.3, abs=0.02)
    assert abs(v) < 0.02


def test_values_may_carry_units() -> None:
    """Bug: formulas in Python took plain numbers alone, and "30 km" ended in a TypeError."""
    eddy = Forcing.eddy(("-37 deg", -56.0), radius="30 km", speed="50 cm/s", velocity=np.array([0.1, 0.0]))
    assert (eddy.centre, eddy.radius, eddy.speed, eddy.velocity) == ((-37.0, -56.0), 30e3, 0.5, (0.1, 0.0))
    assert Forcing.uniform(current=("20 cm/s", 0), depth="0.5 km").water == 500.0
    assert Forcing.jet(CENTRE, 90, "1 m/s", "20 km").width == 20e3
    assert Forcing.shear(CENTRE, 90, "1 m/s", "20 km").speed == 1.0
    assert Forcing.front(CENTRE, 90, "20 cm", "20 km", temperature=(1, 2)).step == 0.2
    assert Forcing.tide("10 cm/s", period="12 h").period == 43_200.0
    assert Forcing.seamount(CENTRE, "300 m", "10 km", "0.5 km").plain == 500.0
    assert Forcing.slope(CENTRE, 90, 0.01, "0.4 km", between=("10 m", "2 km")).between == (10.0, 2000.0)
    assert Forcing.turning_wind("10 m/s").speed == 10.0
    assert Forcing.eddy(("3 km", 0), 1e4, 0.1, latlon=False, latitude=-56).centre == (3000.0, 0.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Forcing.eddy(CENTRE, "30 s", 0.1), "radius: '30 s' is in s"),
        (lambda: Forcing.eddy((-37.0, -156.0), 3e4, 0.1), "centre: latitude -156"),
        (lambda: Forcing.eddy((-37.0,), 3e4, 0.1), "centre.1: a number is missing"),
        (
            lambda: Forcing.eddy((1.0, 2.0, 3.0), 3e4, 0.1, latlon=False, latitude=-56),
            "centre: .* is not possible. Allowed: 2 numbers, in m",
        ),
        (lambda: Forcing.uniform(current=0.1), "current: 0.1 is not possible"),
        (lambda: Forcing.uniform(depth=-3.0), "depth: -3.0 is not possible"),
        (lambda: Forcing.uniform(latitude="north"), "latitude: 'north' is not a number"),
        (lambda: Forcing.jet(CENTRE, "east", 1.0, 2e4), "towards: 'east' is not a number"),
        (lambda: Forcing.shear(CENTRE, 90, True, 2e4), "speed: true is no number"),
        (lambda: Forcing.front(CENTRE, 90, np.nan, 2e4), "step: nan is no finite number"),
        (lambda: Forcing.tide(0.1, period=0.0), "period: 0.0 is not possible"),
        (lambda: Forcing.seamount(CENTRE, 300.0, -3e3, 500.0), "width: -3000.0 is not possible"),
        (lambda: Forcing.slope(CENTRE, 90, 20.0, 500.0), "gradient: 20.0 is not possible"),
        (lambda: Forcing.turning_wind("fast"), "speed: 'fast' is not a number"),
    ],
)
def test_values_that_are_none_are_refused_in_the_words_of_a_file(make: Callable[[], Forcing], words: str) -> None:
    with pytest.raises(ForcingError, match=words):
        make()


def test_what_does_not_go_together_is_refused() -> None:
    with pytest.raises(ForcingError, match="metres have no latitude"):
        Forcing.eddy((0.0, 0.0), 1e4, 0.1, latlon=False)
    with pytest.raises(ForcingError, match="disagree on latitude"):
        Forcing.uniform((0.1, 0.0), latitude=-50.0) + Forcing.uniform((0.1, 0.0), latitude=-60.0)
    with pytest.raises(ForcingError, match=r"radius: 0\.0 is not possible"):
        Forcing.eddy(CENTRE, 0.0, 0.1)
    berg = Iceberg.rectangle(9e3, 9e3, thickness=200.0, placement=CENTRE)
    with pytest.raises(InputError, match="balanced for the latitude -56 degrees"):
        Model(berg, Forcing.uniform((0.1, 0.0), latitude=-56.0))
    with pytest.raises(InputError, match="positions of the forcing are metres"):
        Model(berg, Forcing.uniform((0.1, 0.0), latlon=False, latitude=-56.0))
    with pytest.raises(TypeError):
        Forcing.uniform() + 3  # type: ignore[operator]
    plane = Parameters(earth={"latlon": False, "period": 0.0, "reference_latitude": -56.0})
    flat = Iceberg.rectangle(9e3, 9e3, thickness=200.0, latlon=False)
    Model(flat, Forcing.uniform((0.1, 0.0), latlon=False, latitude=-56.0), plane)
    with pytest.raises(InputError, match="balanced for the latitude -50"):
        Model(flat, Forcing.uniform((0.1, 0.0), latlon=False, latitude=-50.0), plane)


def currents(year: int = 2005) -> xr.Dataset:
    """Return a dataset of currents with CF names."""
    lon, lat = np.arange(-40.0, -33.9, 0.5), np.arange(-58.0, -53.9, 0.5)
    times = np.array([f"{year}-03-01", f"{year}-03-02", f"{year}-03-03"], "datetime64[ns]")
    shape = (3, lat.size, lon.size)
    names = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    return xr.Dataset(
        {
            name: (("time", "lat", "lon"), np.full(shape, 0.1), {"standard_name": words, "units": "m s-1"})
            for name, words in names.items()
        },
        {"time": times, "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
         "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"})},
    )  # fmt: skip


def test_datasets_are_forcing_with_their_own_start() -> None:
    forcing = Forcing.from_xarray(currents())
    assert isinstance(forcing, DatasetForcing)
    berg = Iceberg.rectangle(9e3, 9e3, thickness=200.0, placement=CENTRE)
    model = Model(berg, forcing + Forcing.tide(0.2) + Forcing.seamount(CENTRE, 100.0, 5e3, 400.0))
    assert model.start == datetime(2005, 3, 1)
    model.advance(steps=1)
    assert model.elements.uo.max() > 0.25
    assert model.elements.depth.min() < 320.0
    with pytest.raises(InputError, match="counts its time from 2005-03-01"):
        Model(berg, forcing, start=datetime(2006, 3, 1))
    with pytest.raises(ForcingError, match="no dataset has dates"):
        Forcing.from_xarray(currents().isel(time=0, drop=True))


def test_a_dataset_in_memory_is_called_by_its_title() -> None:
    """The title of a map said "Forcing: dataset 1"."""
    assert Forcing.from_xarray(currents()).title == "dataset 1"
    named = currents().assign_attrs(title="ebb and flow,  in m/s")
    assert Forcing.from_xarray(named).title == "ebb and flow, in m s"


class Own(Forcing):
    """A class of one's own, as the documentation has it."""

    def add_to(self, elements: Elements, time: float) -> None:
        """Add a current that grows to the east."""
        elements.environment.uo[:] += 0.01 * (elements.place.lon - CENTRE[0])


def test_a_class_of_ones_own_needs_one_method() -> None:
    own, e = Own() + Forcing.uniform(wind=(5.0, 0.0)), points(5)
    own.sample(e, 0.0)
    np.testing.assert_allclose(e.uo, 0.01 * (e.lon - CENTRE[0]))
    with pytest.raises(NotImplementedError, match="Bare has no add_to"):
        type("Bare", (Forcing,), {})().sample(e, 0.0)
    assert not issubclass(Own, Flow)


@pytest.mark.parametrize(
    ("forcing", "words"),
    [
        (Forcing.uniform(current=(0.15, 0.0)), "uniform: current (0.15, 0) m/s"),
        (Forcing.uniform(), "uniform: still water and air"),
        (
            Forcing.uniform(wind=(5.0, -2.0), sea_ice=(0.1, 0.0, 0.5), depth=300.0),
            "uniform: wind (5, -2) m/s, sea ice of 0.5 m at (0.1, 0) m/s, 300 m deep",
        ),
        (Forcing.eddy((-36.8, -56.3), 25e3, 0.6), "eddy at 56.30 S, 36.80 W: 0.6 m/s at 25 km"),
        (
            Forcing.jet((-37.0, -57.0), 90.0, 1.2, 2e4),
            "jet of 1.2 m/s through 57.00 S, 37.00 W towards east, 20 km wide",
        ),
        (
            Forcing.front((-37.0, -57.0), 100.0, 0.2, 2e4, (-1.0, 2.0)),
            "front of 0.2 m from 2 to -1 °C through 57.00 S, 37.00 W towards 100 degrees, 20 km wide",
        ),
        (
            Forcing.slope((1e4, 0.0), 180.0, 0.01, 500.0, latlon=False),
            "sea floor that deepens by 10 m per km towards south, 500 m at x 10 km, y 0 km",
        ),
        (
            Forcing.uniform(current=(0.0, 0.0), depth=0.0, slope=(0.0, 0.0)),
            "uniform: still water and air, 0 m deep",
        ),
    ],
    ids=lambda value: "" if isinstance(value, str) else type(value).__name__,
)
def test_a_forcing_says_all_that_it_is_and_nothing_that_it_is_not(forcing: Forcing, words: str) -> None:
    """It stands in the titles of all pictures: wind (0.0, 0.0) m/s is no news there, and a jet without its speed is none."""
    assert forcing.describe() == words


def test_one_part_alone_gives_the_temperature() -> None:
    """The last of two temperatures counted, in silence."""
    front = Forcing.front(CENTRE, 90.0, 0.3, 10e3, temperature=(-1.0, 3.0))
    for one, other in (
        (front, front),
        (front, Forcing.uniform(temperature=2.0)),
        (Forcing.uniform(temperature=2.0), Forcing.uniform(temperature=2.0)),
    ):
        with pytest.raises(ForcingError, match=r"two parts give the temperature of the water: .*; and "):
            one + other
    with pytest.raises(ForcingError, match="give the salinity"):
        Forcing.uniform(salinity=34.0) + front + Forcing.uniform(salinity=34.0)
    assert (Forcing.uniform(salinity=34.0) + front).provides == {"sst", "sss"}


def test_a_temperature_by_formula_counts_at_the_keel_too() -> None:
    """Melt of base and sides went by the water at the keel that another part had said, and not by what was set over it."""
    elements = new_elements(1)
    elements.keel_temperature[:] = elements.keel_salinity[:] = 3.0
    Forcing.uniform(temperature=8.0).add_to(elements, 0.0)
    assert np.isnan(elements.keel_temperature).all()
    assert elements.keel_salinity[0] == 3.0
