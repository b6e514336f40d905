"""The built-in A68a tells the story with Riftberg's own numerics; its ocean is what its formulas say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from riftberg.diagnostics.track import berg_position
from riftberg.errors import ForcingError
from riftberg.experiments import Options, build
from riftberg.experiments.a68a import story_model
from riftberg.experiments.a68a_observed import A68A_OBSERVED
from riftberg.model import Model
from riftberg.ocean.story import OWN, StoryOcean

DAY = 86400.0
START = 9.0 + 13.0 / 24.0


def run(model: Model, days: float) -> Model:
    """Step a model for some days."""
    for _ in range(round(days * 48)):
        model.step()
    return model


def breakups(model: Model) -> list[tuple[float, float, bool]]:
    """Day of December, area (km2) and whether aground, of each fragment that broke off."""
    return [(START + f.birth_time / DAY, f.area / 1e6, f.grounded) for f in model.fragments.breakups]


def test_the_story() -> None:
    """Path, turn, tip aground on 16-18 December, finger afloat on 19-22 December, the rest whole."""
    model, _ = build("a68a")
    distance, turn = [], []
    for day in range(14):
        seen = A68A_OBSERVED[day]
        e = model.elements
        tips = [f.number for f in model.fragments.breakups if f.grounded]
        on = ~np.isin(e.berg, tips)
        if seen.day <= 21:
            p = berg_position(e.lon[on], e.lat[on], (e.length * e.width)[on])
            east = (p.lon - seen.lon) * math.cos(math.radians(seen.lat))
            distance.append(111.07 * math.hypot(east, p.lat - seen.lat))
            turn.append((p.azimuth - seen.azimuth + 90.0) % 180.0 - 90.0)
        run(model, 1.0)
    assert np.sqrt(np.mean(np.square(distance))) < 10.0  # km
    assert np.sqrt(np.mean(np.square(turn))) < 10.0  # degrees
    (tip_day, tip_area, tip_aground), (finger_day, finger_area, finger_aground) = breakups(model)
    assert tip_aground
    assert 16.0 <= tip_day < 19.0
    assert 80.0 <= tip_area <= 300.0
    assert not finger_aground
    assert 19.0 <= finger_day < 23.0
    assert 450.0 <= finger_area <= 900.0
    assert 4248.0 - tip_area - finger_area >= 2400.0
    assert model.bonds_broken < 0.05 * model.bonds.first.size


def test_without_the_shoal_only_the_finger_breaks_off() -> None:
    events = breakups(run(build("a68a", Options(without=frozenset({"shoal"})))[0], 14.0))
    assert len(events) == 1
    assert not events[0][2]
    assert events[0][0] > 19.0


def test_without_the_shear_the_finger_stays() -> None:
    events = breakups(run(build("a68a", Options(without=frozenset({"shear"})))[0], 14.0))
    assert len(events) == 1
    assert events[0][2]
    assert events[0][0] < 19.0


def test_the_numerics_of_the_reference_tell_the_same_story() -> None:
    """The shared description's own fit: 216 and 504 km2 in 13 bonds."""
    model = run(build("a68a", Options(numerics="reference"))[0], 14.0)
    assert [round(area) for _, area, _ in breakups(model)] == [216, 504]
    assert model.bonds_broken == 13


def point(lon: float, lat: float, time: float) -> tuple[float, float]:
    """Current at one point."""
    u, v = StoryOcean().currents(np.array([lon]), np.array([lat]), time)
    return float(u[0]), float(v[0])


@pytest.mark.parametrize("time", [0.0, 3.0 * DAY, 7.7 * DAY, 12.0 * DAY, 16.0 * DAY])
def test_currents_are_free_of_divergence_and_in_geostrophic_balance(time: float) -> None:
    """Differences on the sphere: d(u)/dx + d(v cos)/cos dy = 0; slope = f0/g rot(current) in the local plane."""
    h, radius, ocean = 1e-4, 6_363_827.0, StoryOcean()
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
        east = (ocean.sea_level(lon + h, lat, time) - ocean.sea_level(lon - h, lat, time)) / (2 * h * metre * cos)
        north = (ocean.sea_level(lon, lat + h, time) - ocean.sea_level(lon, lat - h, time)) / (2 * h * metre)
        assert model_berg.slope_x[0] == pytest.approx(east, rel=1e-6, abs=1e-13)
        assert model_berg.slope_y[0] == pytest.approx(north, rel=1e-6, abs=1e-13)


def test_the_controls_change_only_their_part() -> None:
    lon, lat = np.array([-37.176]), np.array([-54.925])
    assert StoryOcean().depth(lon, lat)[0] == pytest.approx(120.0)
    assert StoryOcean(shoal=False).depth(lon, lat)[0] == 250.0
    far = np.array([-37.0]), np.array([OWN.jet_latitude])
    with_jet, without = StoryOcean().currents(*far, 10 * DAY)[0], StoryOcean(shear=False).currents(*far, 10 * DAY)[0]
    assert with_jet[0] - without[0] == pytest.approx(0.75, rel=1e-3)


def test_real_currents_carry_the_berg_towards_the_shoal(shared: Path) -> None:
    """Monthly means: the berg drifts east and south, whole until it reaches the artificial shoal."""
    model, info = build("a68a-oras5", Options(data=shared / "data" / "a68a"))
    assert info.days == 18.0
    west, north = model.elements.lon.mean(), model.elements.lat.mean()
    run(model, 3.0)
    assert model.bonds_broken == 0
    assert 0.2 < model.elements.lon.mean() - west < 1.2
    assert abs(model.elements.lat.mean() - north) < 0.3


def test_missing_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RIFTBERG_DATA", raising=False)
    with pytest.raises(ForcingError, match="--data"):
        build("a68a-oras5")
    with pytest.raises(ForcingError, match=r"no icebergs.res.nc.*riftberg fetch a68a"):
        build("a68a-oras5", Options(data=tmp_path))
