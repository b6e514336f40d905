"""The built-in A68a tells the story with Riftberg's own numerics; its ocean is what its formulas say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Model, Options, build
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.experiments.a68a import A68A_OBSERVED, story_model
from riftberg.ocean.story import OWN, REFERENCE, StoryNumbers, StoryOcean, stream
from riftberg.runs.tracks import berg_position

LATITUDE = -55.8
LONGITUDE = -37.4

DAY = 86400.0
START = 9.0 + 13.0 / 24.0


def run(model: Model, days: float) -> Model:
    """Step a model for some days."""
    for _ in range(round(days * DAY / model.parameters.time_step)):
        model.step()
    return model


def breakups(model: Model, least: float = 50.0) -> list[tuple[float, float, bool]]:
    """Day of December, area (km2) and whether aground, of each fragment of at least an area that broke off the berg.

    What a piece loses later does not count: from a start 3 km farther south the stranded tip loses 72 km2 half a day later.
    """
    all_ = model.fragments.breakups
    events = [(START + f.birth_time / DAY, f.area / 1e6, f.grounded) for f in all_ if f.parent == all_[0].parent]
    return [event for event in events if event[1] >= least]


def assert_tip_and_finger(
    model: Model, finger: tuple[float, float] = (450.0, 900.0), tip: tuple[float, float] = (80.0, 300.0)
) -> None:
    """Tip aground on 16 to 18 December, then the finger afloat on 19 to 22 December, the rest whole."""
    (tip_day, tip_area, tip_aground), (finger_day, finger_area, finger_aground) = breakups(model)
    assert tip_aground
    assert 16.0 <= tip_day < 19.0
    assert tip[0] <= tip_area <= tip[1]
    assert not finger_aground
    assert 19.0 <= finger_day < 23.0
    assert finger[0] <= finger_area <= finger[1]
    e = model.elements
    areas = np.bincount(e.berg.astype(int), weights=e.length * e.width) / 1e6
    assert areas.max() >= 2400.0
    assert model.bonds_broken < 0.05 * model.bonds.first.size


def off(model: Model, seen: Any, gone: list[int]) -> tuple[float, float]:
    """Distance (km) and difference of azimuth (degrees) from an observed day, without pieces that are gone."""
    e = model.elements
    on = ~np.isin(e.berg, gone)
    p = berg_position(e.lon[on], e.lat[on], (e.length * e.width)[on])
    east = ((p.lon - seen.lon + 180.0) % 360.0 - 180.0) * math.cos(math.radians(seen.lat))
    return 111.07 * math.hypot(east, p.lat - seen.lat), (p.azimuth - seen.azimuth + 90.0) % 180.0 - 90.0


def assert_another_tip_and_the_finger(model: Model) -> None:
    """Pieces above 150 km2: the first on 16 or 17 December, at most twice the tip; the last, on 20 December, the finger."""
    events = [event for event in breakups(model) if event[1] > 150.0]
    assert 2 <= len(events) <= 3
    assert 16.0 <= events[0][0] < 18.0
    assert 190.0 <= events[0][1] <= 480.0
    day, area, aground = events[-1]
    assert 20.0 <= day < 21.0
    assert 500.0 <= area <= 700.0
    assert not aground


def test_the_story() -> None:
    """Path and turn to 26 December, tip aground, finger afloat, the rest whole; the tip stays behind."""
    model, info = build("a68a")
    assert info.days == 17.0
    distance, turn, late = [], [], []
    for seen in A68A_OBSERVED:
        # The finger belongs to what was observed until 23 December.
        gone = [f.number for f in model.fragments.breakups if f.grounded or seen.day > 23]
        apart, turned = off(model, seen, gone)
        if seen.day <= 21:
            distance.append(apart)
            turn.append(turned)
        elif seen.day != 24:  # that day only a part was seen
            late.append(apart)
        if seen.day == 23:
            assert model.bonds_broken < 0.05 * model.bonds.first.size
        if seen.day < 26:
            run(model, 1.0)
    assert np.sqrt(np.mean(np.square(distance))) < 10.0  # km
    assert np.sqrt(np.mean(np.square(turn))) < 10.0  # degrees
    assert max(late) < 10.0  # km
    assert_tip_and_finger(model)
    # 5.3 h with steps of 900 s. It came free after 2 h when it took steps of one hour on the bed too.
    assert 5.0 <= model.groundings.rows[0].seconds / 3600.0 <= 6.5
    tip = next(f.number for f in model.fragments.breakups if f.grounded and f.area > 5e7)
    there = model.elements.berg == tip
    # A68D on 26 December: 55.56 S, 36.72 W (outlines of the publication's repository). Free, it would be at 57 S by then. Sand
    # holds it longer than it was held.
    lat, lon = float(model.elements.lat[there].mean()), float(model.elements.lon[there].mean())
    east = ((lon + 36.72 + 180.0) % 360.0 - 180.0) * math.cos(math.radians(55.56))
    assert 111.07 * math.hypot(east, lat + 55.56) < 70.0  # km
    assert model.elements.lat[~there].mean() < -56.8


@pytest.mark.quick(1)
@pytest.mark.parametrize("scheme", ["quasi_static", "mts"])
def test_pieces_part_where_they_stand(scheme: str) -> None:
    """Bug: held by the last bonds of the crack, in equilibrium, the tip was 10 km off and turned by 30 degrees in its step."""
    model = run(build("a68a", Options({"stepping": {"scheme": scheme, "time_step": 1800.0}}))[0], 7.0)
    e, dt = model.elements, model.parameters.time_step
    while not breakups(model):
        at, turned = (e.lon.copy(), e.lat.copy()), e.rotation.copy()
        model.step()
    for _ in range(2):
        speed = np.hypot(e.u_sync, e.v_sync)
        way = 111.07e3 * np.hypot((e.lon - at[0]) * math.cos(math.radians(55.0)), e.lat - at[1])
        assert way.max() < 0.3 * dt
        # The tip pivots about where it stands, its far end no faster than the berg: 16 to 20 km away that makes 1.5 to 2 degrees.
        assert np.abs(e.rotation - turned).max() < math.radians(2.0)
        assert speed.max() < 0.3
        at, turned = (e.lon.copy(), e.lat.copy()), e.rotation.copy()
        model.step()


@pytest.mark.slow
def test_without_the_shoal_only_the_finger_breaks_off() -> None:
    events = breakups(run(build("a68a", Options(without=frozenset({"shoal"})))[0], 14.0))
    assert len(events) == 1
    assert not events[0][2]
    assert events[0][0] > 19.0


@pytest.mark.slow
def test_without_the_shear_the_finger_stays() -> None:
    events = breakups(run(build("a68a", Options(without=frozenset({"shear"})))[0], 17.0))
    assert len(events) == 1
    assert events[0][2]
    assert events[0][0] < 19.0


@pytest.mark.slow
@pytest.mark.parametrize("time_step", [900.0, 3600.0])
def test_the_story_does_not_need_the_long_step(time_step: float) -> None:
    """The same pieces at the same times: half the long step gave a finger of 783 km2 in place of 504, when stress rang."""
    told = [
        breakups(run(build("a68a", Options({"stepping": {"time_step": dt}}))[0], 12.0)) for dt in (1800.0, time_step)
    ]
    assert len(told[0]) == 2
    assert [area for _, area, _ in told[1]] == pytest.approx([area for _, area, _ in told[0]])
    tip, finger = zip(*([day for day, *_ in events] for events in told), strict=True)
    assert tip[1] == pytest.approx(tip[0], abs=2.0 / 1440.0)
    # The tip that the bed holds is struck by the rest in steps of contact: the finger parts 14 minutes sooner or later.
    assert finger[1] == pytest.approx(finger[0], abs=20.0 / 1440.0)


@pytest.mark.slow
def test_the_story_is_told_with_the_stiffness_of_ice() -> None:
    assert_tip_and_finger(run(build("a68a", Options({"bonds": {"youngs_modulus": 9e9}}))[0], 14.0))


@pytest.mark.slow
def test_the_explicit_scheme_tells_the_story_with_short_long_steps() -> None:
    """With the strength of its bonds, which is not that of the ice."""
    changes = {"fracture": {"normal_strength": 16e3}, "stepping": {"scheme": "mts", "time_step": 600.0, "substeps": 30}}
    assert_tip_and_finger(run(build("a68a", Options(changes))[0], 14.0))


@pytest.mark.slow
@pytest.mark.parametrize("strength", [9e3, 10e3, 12e3, 12.8e3])
def test_the_story_bears_other_strengths(strength: float) -> None:
    assert_tip_and_finger(run(build("a68a", Options({"fracture": {"normal_strength": strength}}))[0], 14.0))


@pytest.mark.slow
def test_the_margin_of_the_strength_is_what_the_page_says() -> None:
    """Equilibrium reaches more than 14 kPa at the neck of the finger once the tip is off; at 15 kPa the finger stays on."""
    strengths = ({"fracture": {"normal_strength": p}} for p in (14e3, 15e3))
    told = [breakups(run(build("a68a", Options(changes))[0], 14.0), least=150.0) for changes in strengths]
    assert [[aground for _, _, aground in events] for events in told] == [[True, False], [True]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("east", "north"),
    [(0.02, 0.0), (-0.02, 0.0), (0.0, 0.015), (0.0, -0.015), (0.045, 0.0), (-0.045, 0.0), (0.0, 0.027), (0.0, -0.027)],
)
def test_the_story_bears_another_start(east: float, north: float) -> None:
    """1.3 to 3 km to each side: a tip of another size, which may go on to break, and the same finger on the same day."""
    model = story_model(Options())
    model.elements.lon[:] += east
    model.elements.lat[:] += north
    assert_another_tip_and_the_finger(run(model, 14.0))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_the_story_bears_another_eddy(factor: float) -> None:
    ocean = StoryOcean(OWN._replace(eddy_spin=factor * OWN.eddy_spin))
    assert_another_tip_and_the_finger(run(story_model(Options(), ocean=ocean), 14.0))


@pytest.mark.slow
@pytest.mark.parametrize("radius", [1000.0, 500.0])
def test_finer_lattices_tell_the_same_story(radius: float) -> None:
    """The tip within 10 % of 270 km2, the finger within 10 % of 530 km2.

    With elements of 500 m the finger strikes the rest six hours later, which then breaks up: that is not held here.
    """
    model = run(story_model(Options(), radius=radius), 14.0)
    (tip_day, tip_area, tip_aground), (finger_day, finger_area, finger_aground), *others = breakups(model)
    assert (tip_aground, finger_aground) == (True, False)
    assert 16.0 <= tip_day < 19.0
    assert 19.0 <= finger_day < 23.0
    assert (tip_area, finger_area) == pytest.approx((270.0, 530.0), rel=0.1)
    assert not others or radius == 500.0


@pytest.mark.slow
def test_hexagons_tell_the_same_story() -> None:
    """Dates and finger as observed; the tip, larger than observed, within 5 to 95 % of twenty lattices (evidence/a68a.md)."""
    assert_tip_and_finger(run(story_model(Options(), packing="hexagonal"), 14.0), tip=(234.0, 389.0))


def test_currents_are_no_faster_than_products_show() -> None:
    """About 0.5 m/s is the largest that products show (shared description of the story); 0.75 + 0.1 was its own fit.

    Hourly on 5 km, which misses less than 1e-3 m/s of the 0.565 m/s near 56.67 S 35.41 W on day 11.4: the second derivatives
    there are those of the jet, sech2 of 26 km, and of its growth, tanh of half a day.
    """
    fastest, ocean = (0.0, 0.0), StoryOcean()
    for hour in range(24 * 17 + 1):
        seen = A68A_OBSERVED[hour // 24]
        lon, lat = np.meshgrid(seen.lon + np.linspace(-2.5, 2.5, 63), seen.lat + np.linspace(-1.4, 1.4, 63))
        fastest = max(fastest, (float(np.hypot(*ocean.currents(lon, lat, 3600.0 * hour)).max()), hour / 24.0))
    assert 0.564 < fastest[0] < 0.5651
    assert fastest[1] == pytest.approx(11.40, abs=0.1)
    there = np.hypot(*ocean.currents(np.array([-35.407310]), np.array([-56.672316]), 11.401514 * DAY))
    assert fastest[0] <= float(there[0]) + 1e-6 < 0.5651


@pytest.mark.slow
def test_the_numerics_of_the_reference_tell_the_same_story() -> None:
    """The shared description's own fit: 216 and 504 km2 in 13 bonds."""
    model = run(build("a68a", Options(numerics="reference"))[0], 14.0)
    assert [round(area) for _, area, _ in breakups(model)] == [216, 504]
    assert model.bonds_broken == 13


def point(lon: float, lat: float, time: float) -> tuple[float, float]:
    """Current at one point."""
    u, v = StoryOcean().currents(np.array([lon]), np.array([lat]), time)
    return float(u[0]), float(v[0])


def geostrophic_level(ocean: StoryOcean, lon: float, lat: float, time: float) -> float:
    """Sea level (m) in geostrophic balance with the stream function at one point."""
    metre = EARTH_RADIUS_A68 * DEGREE
    x, y = metre * math.cos(LATITUDE * DEGREE) * (lon - LONGITUDE), metre * (lat - LATITUDE)
    psi = stream(x, y, ocean.instant(time))[0]
    return 2.0 * EARTH_ROTATION * math.sin(LATITUDE * DEGREE) * psi / GRAVITY


@pytest.mark.quick(1)
@pytest.mark.parametrize("time", [0.0, 7.7 * DAY, 12.0 * DAY])
@pytest.mark.parametrize("gradient_wind", [False, True])
def test_currents_are_free_of_divergence_and_in_balance_with_the_sea_surface(time: float, gradient_wind: bool) -> None:
    """Differences on the sphere: d(u)/dx + d(v cos)/cos dy = 0; slope = f0/g rot(current) - Du/Dt / g in the local plane."""
    h, radius, ocean = 1e-4, 6_363_827.0, StoryOcean(OWN._replace(gradient_wind=gradient_wind))
    metre = radius * math.pi / 180.0
    rng = np.random.default_rng(3)
    for lon, lat in zip(rng.uniform(-40, -35, 8), rng.uniform(-57.5, -54.5, 8), strict=True):
        cos = math.cos(math.radians(lat))
        du = (point(lon + h, lat, time)[0] - point(lon - h, lat, time)[0]) / (2 * h * metre * cos)
        up, down = (point(lon, lat + s * h, time)[1] * math.cos(math.radians(lat + s * h)) for s in (1, -1))
        assert du + (up - down) / (2 * h * metre * cos) == pytest.approx(0.0, abs=1e-11)
        model_berg = story_model(Options(), ocean=ocean).elements
        model_berg.lon[:], model_berg.lat[:] = lon, lat
        ocean.sample(model_berg, time)
        east = (geostrophic_level(ocean, lon + h, lat, time) - geostrophic_level(ocean, lon - h, lat, time)) / (
            2 * h * metre * cos
        )
        north = (geostrophic_level(ocean, lon, lat + h, time) - geostrophic_level(ocean, lon, lat - h, time)) / (
            2 * h * metre
        )
        if gradient_wind:
            (u, v), later = point(lon, lat, time), 30.0
            for k, slope in ((0, "east"), (1, "north")):
                change = (point(lon, lat, time + later)[k] - point(lon, lat, time - later)[k]) / (2 * later)
                change += u * (point(lon + h, lat, time)[k] - point(lon - h, lat, time)[k]) / (2 * h * metre * cos)
                change += v * (point(lon, lat + h, time)[k] - point(lon, lat - h, time)[k]) / (2 * h * metre)
                if slope == "east":
                    east -= change / 9.8
                else:
                    north -= change / 9.8
        assert model_berg.slope_x[0] == pytest.approx(east, rel=1e-5, abs=1e-11)
        assert model_berg.slope_y[0] == pytest.approx(north, rel=1e-5, abs=1e-11)


@pytest.mark.parametrize("numbers", [OWN, REFERENCE], ids=["own", "reference"])
@pytest.mark.parametrize("time", [0.5 * DAY, 7.7 * DAY, 11.3 * DAY, 16.5 * DAY])
def test_slopes_and_curl_are_those_of_the_stream_function(numbers: StoryNumbers, time: float) -> None:
    """Against differences of psi itself."""
    now, h = StoryOcean(numbers).instant(time), 20.0
    rng = np.random.default_rng(5)
    for x, y in rng.uniform(-120e3, 120e3, (10, 2)):
        _, psi_x, psi_y, curl = stream(x, y, now)
        (east, north), (west, south) = [[stream(x + s * h, y, now), stream(x, y + s * h, now)] for s in (1.0, -1.0)]
        assert psi_x == pytest.approx((east[0] - west[0]) / (2 * h), abs=1e-6)
        assert psi_y == pytest.approx((north[0] - south[0]) / (2 * h), abs=1e-6)
        laplacian = (east[1] - west[1] + north[2] - south[2]) / (2 * h)
        assert curl == pytest.approx(laplacian, abs=1e-10)


def test_the_stream_function_is_that_of_the_docstring() -> None:
    """A plain twin of the formula, up to a constant."""
    time, n = 11.3 * DAY, OWN
    now = StoryOcean(n).instant(time)
    s, metre = time / DAY, 6_363_827.0 * math.pi / 180.0
    a = 0.25 * (1 + math.tanh((n.shear_end - s) / 0.5)) * (1 + math.tanh((s - n.shear_start) / 0.5))
    yj, yc = metre * (n.jet_latitude + 55.8), metre * (n.counter_latitude + 55.8)

    def psi(east: float, north: float) -> float:
        x, y = east - now.x, north - now.y
        r2 = x * x + y * y
        drift = (now.v * x - now.u * y) * math.exp(-((math.sqrt(r2) / n.drift_radius) ** 4))
        eddy = 0.5 * now.spin * n.eddy_radius**2 * (1 - math.exp(-r2 / n.eddy_radius**2))
        jet = n.jet_speed * n.jet_width * math.tanh((north - yj) / n.jet_width)
        counter = n.counter_speed * n.counter_width * math.tanh((north - yc) / n.counter_width)
        return drift + eddy - a * (n.shear_flow * north + jet - counter)

    for east, north in [(0.0, 0.0), (50e3, -80e3), (-90e3, 30e3)]:
        assert stream(east, north, now)[0] == pytest.approx(psi(east, north), rel=1e-12)
    # The gain makes the drift faster than its centre.
    step = 60.0 / DAY
    there, here = (1e3 * np.array([np.polyval(p, s + k * step) for p in (n.path_x, n.path_y)]) for k in (1, -1))
    assert np.array([now.u, now.v]) == pytest.approx(n.drift_gain * (there - here) / 120.0, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("day", [2.0, 7.5, 8.1, 15.0])
def test_the_drift_is_that_of_its_centre(day: float) -> None:
    """With the surge of day 7.8; the gain makes the drift faster than its centre."""
    h = 30.0
    here, now, there = (StoryOcean().instant(day * DAY + s * h) for s in (-1.0, 0.0, 1.0))
    for speed, way in ((now.u, there.x - here.x), (now.v, there.y - here.y)):
        assert speed == pytest.approx(OWN.drift_gain * way / (2.0 * h), rel=1e-4, abs=1e-5)


def test_longitudes_may_count_to_360() -> None:
    lat = np.array([-55.5, -56.2])
    west, east = (
        StoryOcean().currents(lon, lat, 3.0 * DAY) for lon in (np.array([-39.0, -37.5]), np.array([321.0, 322.5]))
    )
    np.testing.assert_allclose(west, east, rtol=1e-9)
    assert np.hypot(*west).min() > 0.01


def test_the_controls_change_only_their_part() -> None:
    lon, lat = np.array([OWN.shoal[0]]), np.array([OWN.shoal[1]])
    assert StoryOcean().depth(lon, lat)[0] == pytest.approx(120.0)
    assert StoryOcean(shoal=False).depth(lon, lat)[0] == 250.0
    far = np.array([-37.0]), np.array([OWN.jet_latitude])
    time = 11.3 * DAY
    with_shear, without = StoryOcean().currents(*far, time)[0], StoryOcean(shear=False).currents(*far, time)[0]
    counter = 1.013 / math.cosh((OWN.counter_latitude - OWN.jet_latitude) * 111.07e3 / 25.4e3) ** 2
    grown = 0.25 * (1 + math.tanh((11.895 - 11.3) / 0.5)) * (1 + math.tanh((11.3 - 10.876) / 0.5))
    assert with_shear[0] - without[0] == pytest.approx(grown * (0.335 + 0.26 - counter), rel=1e-3)
    early = 5 * DAY  # before it has grown
    assert StoryOcean().currents(*far, early)[0] == pytest.approx(
        StoryOcean(shear=False).currents(*far, early)[0], abs=1e-4
    )


@pytest.mark.slow
def test_real_currents_carry_the_berg_towards_the_shoal(shared: Path) -> None:
    """Monthly means: the berg drifts east and south, whole until it reaches the artificial shoal."""
    model, info = build("a68a-oras5", Options(data=shared / "data" / "a68a"))
    assert info.days == 18.0
    west, north = model.elements.lon.mean(), model.elements.lat.mean()
    run(model, 3.0)
    assert model.bonds_broken == 0
    assert 0.2 < model.elements.lon.mean() - west < 1.2
    assert abs(model.elements.lat.mean() - north) < 0.3


def test_the_density_of_the_ice_is_that_of_the_mass_of_published_bergs_too(shared: Path) -> None:
    """The draft followed `ice.density`, and the mass stayed that of 850 kg m-3 in the file."""
    data = Options(data=shared / "data" / "a68a", changes={"ice": {"density": 900.0}})
    e = build("a68a-oras5", data)[0].elements
    np.testing.assert_allclose(e.mass / (e.thickness * e.length * e.width), 900.0, rtol=1e-9)


def test_missing_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RIFTBERG_DATA", raising=False)
    with pytest.raises(ForcingError, match="--data"):
        build("a68a-oras5")
    with pytest.raises(ForcingError, match=r"no icebergs.res.nc.*riftberg fetch a68a"):
        build("a68a-oras5", Options(data=tmp_path))


def test_what_a_run_should_not_be_taken_for_is_told_before_it() -> None:
    assert build("a68a")[1].notices == ()
    (late,) = build("a68a", Options(days=20.0))[1].notices
    assert "until 26 December" in late
    (other,) = build("a68a", Options(numerics="reference"))[1].notices
    assert "another one" in other
    model, _ = build("a68a", Options(numerics="reference"))
    assert (
        model.run(steps=1).attrs["forcing_title"]
        == "currents fitted to the observed drift with the reference's numerics, not measured"
    )


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", ["mts", "quasi_static", "verlet", "runge_kutta"])
def test_elements_that_a_user_moves_are_moved(scheme: str) -> None:
    """They showed each other their old places, from which an explicit step went on: a moved berg stood where it had been."""
    long = scheme in ("mts", "quasi_static")
    stepping = {"scheme": scheme} if long else {"scheme": scheme, "time_step": 10.0}
    law = {} if long else {"bonds": {"law": "spring"}, "fracture": {"enabled": False}}
    runs = [story_model(Options({"stepping": stepping, **law})) for _ in range(2)]
    for model in runs[1:]:
        model.elements.lat[:] += 3.0
    for _ in range(2):
        for model in runs:
            model.step()
        here, there = (model.elements for model in runs)
        assert np.abs(there.lat - here.lat - 3.0).max() < 0.03
        assert np.abs(there.lat_pair - there.lat).max() < 1e-6
        there.lat[:] += 1.0
        here.lat[:] += 1.0
