"""The replay: what is packed, and how the page behaves in a browser."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread

from ensembles.made import forecast_of, outcome
from fakes import FakeModel
from riftberg import build, open_run
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.viz.ensemble import choose_tracks
from riftberg.viz.replay import ForecastMembers, ReplayContent, chosen_records, quantise, write_replay
from viz.browser import drawn, opened, unpack, until

LAND = "#D3CBBB"

RING = np.array([[-39.2, -55.1], [-38.8, -55.1], [-38.8, -54.9], [-39.2, -54.9]])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Run four days with a break on the second."""
    path = tmp_path_factory.mktemp("replay") / "run.nc"
    model = FakeModel(16, 5)
    model.advance(4, recorders=[RunWriter(path, every_hours=3, experiment="fake </script> & berg")])
    return open_run(path)


@pytest.fixture(scope="module")
def page(run: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the page."""
    return write_replay(run, tmp_path_factory.mktemp("page") / "replay.html", observed={"2020-12-11": [RING]})


def data_of(page: Path) -> dict[str, Any]:
    """Return what the page was given."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found is not None
    content: dict[str, Any] = json.loads(found.group(1))
    return content


@pytest.mark.parametrize("kind", ["int16", "uint16", "uint8"])
def test_packing_keeps_values_to_half_a_step_and_gaps(kind: str) -> None:
    values = np.array([[-3.0, np.nan, 5.5], [1e-3, 2.0, 7.0]])
    packed = quantise(values, kind)
    np.testing.assert_allclose(unpack(packed), values, atol=0.501 * packed["scale"])


def test_packing_of_whole_numbers_and_of_constants_is_exact() -> None:
    numbers = np.array([0.0, 3.0, 65_000.0])
    np.testing.assert_array_equal(unpack(quantise(numbers, "uint16", step=1.0)), numbers)
    np.testing.assert_allclose(unpack(quantise(np.full(4, 200.0))), 200.0)


def test_positions_on_the_page_are_true_to_metres(run: xr.Dataset, page: Path) -> None:
    elements = data_of(page)["elements"]
    x, y = unpack(elements["x"]), unpack(elements["y"])
    model = FakeModel(16, 5)
    # Neighbours in the fake berg are 3 km apart; the page shows them so at its scale.
    bonds = model.bonds
    whole = run["status"].values == 0
    apart = np.hypot(x[:, bonds.first] - x[:, bonds.second], y[:, bonds.first] - y[:, bonds.second])[:, whole]
    np.testing.assert_allclose(apart, 3000.0, rtol=0.006)
    turned = np.arctan2(y[-1, 5] - y[-1, 0], x[-1, 5] - x[-1, 0])
    assert np.degrees(turned) == pytest.approx(-48.0, abs=0.6)


def test_stress_is_the_peak_of_bonds_that_held_at_the_record_before(run: xr.Dataset) -> None:
    content = ReplayContent(run, title="", observed={})
    stress = content._largest_bond_value(content.scene.bonds.tension()[content.records])
    lonely = np.setdiff1d(np.arange(80), np.r_[run["bond_first"].values, run["bond_second"].values])
    assert not len(lonely)
    np.testing.assert_allclose(stress[0], 1000.0)
    np.testing.assert_allclose(stress[-1], run["peak_stress"].values[0, -1], rtol=1e-6)
    cut = run.isel(bond=slice(0, 0))
    assert Scene(cut).bonds.tension().max(initial=0.0) == 0.0


def test_the_page_needs_nothing_from_elsewhere(page: Path) -> None:
    text = page.read_text()
    assert not re.search(r"""(src|href)\s*=\s*["']""", text)
    assert "default-src 'none'" in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|import)\s*\(", text)


def test_the_title_says_what_the_currents_are(page: Path) -> None:
    content = data_of(page)
    assert content["note"] == "uniform current of 0.2 m/s"
    assert "<title>fake &lt;/script&gt; &amp; berg replay</title>" in page.read_text()
    assert [(f["number"], f["parent"], f["grounded"]) for f in content["fragments"]] == [(1, 0, False), (2, 1, True)]


def test_a_large_run_is_thinned_to_the_size_asked_for(run: xr.Dataset, tmp_path: Path) -> None:
    chosen = chosen_records(1000, 10_000, 10e6)
    assert chosen[0] == 0
    assert chosen[-1] == 999
    small = write_replay(run, tmp_path / "small.html", largest=1.3e4)
    whole = write_replay(run, tmp_path / "whole.html")
    assert small.stat().st_size < whole.stat().st_size
    assert data_of(small)["skipped"] > 0
    assert data_of(whole)["skipped"] == 0


@pytest.fixture(scope="module")
def a68a(tmp_path_factory: pytest.TempPathFactory) -> tuple[xr.Dataset, Path]:
    """Run the built-in experiment, with a record every hour as on the command line, and write its page."""
    folder = tmp_path_factory.mktemp("a68a")
    model, info = build("a68a")
    model.run(info.days, output=folder / "run.nc", every_hours=1.0)
    run = open_run(folder / "run.nc")
    return run, write_replay(run, folder / "replay.html")


@pytest.mark.slow
def test_a68a_by_the_hour_stays_below_ten_megabytes(a68a: tuple[xr.Dataset, Path]) -> None:
    """Real page, all records, and the estimate from which records would be left out is near it."""
    run, page = a68a
    records, elements = run.sizes["time"], run.sizes["trajectory"]
    assert (records, elements) == (17 * 24 + 1, 472)
    size = page.stat().st_size
    assert 2e6 < size < 10e6
    content = data_of(page)
    assert content["skipped"] == 0
    assert unpack(content["elements"]["x"]).size == records * elements
    # The page would just be thinned at less than its size, so that the limit given is kept.
    thinned = write_replay(run, page.with_name("thinned.html"), largest=0.8 * size)
    assert data_of(thinned)["skipped"] > 0
    assert thinned.stat().st_size < 0.8 * size


@pytest.mark.slow
def test_the_a68a_page_plays_to_the_end_in_a_browser(a68a: tuple[xr.Dataset, Path], tmp_path: Path) -> None:
    run, page = a68a
    with opened(page) as browser:
        drawn(browser)
        browser.execute_script("replay.state.speed = 60")  # hours a second
        browser.find_element("id", "play").click()
        until(browser, "replay.state.t >= replay.span && !replay.state.playing")
        drawn(browser)
        assert browser.find_element("id", "date").text == "26 Dec 2020 13:00"
        told = browser.find_element("id", "sea").get_attribute("aria-label")
        rows = [row.text for row in browser.find_elements("css selector", "#list button")]
        assert errors(browser) == []
        browser.save_screenshot(str(tmp_path / "end.png"))
    number, index = np.unique(run["berg"].transpose("time", "trajectory").values[-1], return_inverse=True)
    areas = np.bincount(index, weights=(run["length"] * run["width"]).values) / 1e6
    broken = int((~np.isnat(run["break_time"].values)).sum())
    assert told == f"Map of the iceberg at 26 Dec 2020 13:00: {len(number)} pieces, {broken} bonds broken"
    assert len(number) == 4  # as the story tells them: 3321, 657, 261 and 9 km2
    shown = {int(re.search(r"(?:Berg|Fragment) (\d+)", row)[1]): row for row in rows}  # type: ignore[index]
    assert set(shown) == set(number.tolist())
    for n, area in zip(number.tolist(), areas.tolist(), strict=True):
        assert f"{area:,.0f}" in shown[n].replace("\u2009", ",").replace("\u202f", ",").replace("\u00a0", ",")


def test_a_run_without_water_bonds_or_degrees_still_has_a_page(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run.nc", every_hours=6, background=False)
    FakeModel(latlon=False).advance(0.5, recorders=[writer])
    with open_run(tmp_path / "run.nc") as run:
        content = data_of(write_replay(run.isel(bond=slice(0, 0)), tmp_path / "replay.html"))
    assert content["water"] is None
    assert content["floor"] is None
    assert content["graticule"] == []


def errors(browser: Any) -> list[Any]:
    """Return what the page complained about."""
    return [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def test_the_page_plays_in_a_browser(page: Path, tmp_path: Path) -> None:
    with opened(page) as browser:
        assert browser.execute_script("return replay.state.t") == 0
        drawn(browser)
        first = browser.find_element("id", "date").text
        browser.find_element("id", "play").click()
        until(browser, "replay.state.t > 3600")
        browser.execute_script("replay.toggle(false)")
        drawn(browser)
        assert browser.find_element("id", "date").text != first
        browser.execute_script("replay.go(replay.span)")
        drawn(browser)
        assert browser.find_element("id", "date").text == "13 Dec 2020 13:00"
        picture = tmp_path / "page.png"
        browser.save_screenshot(str(picture))
        assert errors(browser) == []
    shades = imread(picture)[..., :3].reshape(-1, 3)
    assert len(np.unique((shades * 31).astype(int), axis=0)) > 40


@pytest.mark.slow
def test_keys_zoom_and_settings_work_in_a_browser(page: Path) -> None:
    with opened(page, 480, 800) as browser:

        def state(name: str) -> Any:
            return browser.execute_script(f"return replay.state.{name}")

        body = browser.find_element("tag name", "body")
        drawn(browser)
        body.send_keys("n")
        assert state("t") == 86_400
        # Not ``text``: that is empty before the message has faded in, and again 4 s later, when it has faded out.
        assert "aground" in browser.find_element("id", "said").get_property("textContent")
        scale = state("view.s")
        body.send_keys("+")
        assert state("view.s") > scale
        body.send_keys("0")
        assert state("view.s") == pytest.approx(scale)
        browser.execute_script("replay.state.speed = 0.001")  # so that the end is not reached before it is asked for
        body.send_keys(" ")
        assert state("playing") is True
        body.send_keys(" ")
        for value in ("fragment", "speed", "thickness", "stress"):
            browser.execute_script(
                "const s = document.getElementById('ice'); s.value = arguments[0]; s.onchange()", value
            )
        browser.execute_script("document.getElementById('theme').click()")
        browser.execute_script("const s = document.getElementById('back'); s.value = 'floor'; s.onchange()")
        browser.find_elements("css selector", "#list button")[1].click()
        assert state("follow") == 2
        drawn(browser)
        assert errors(browser) == []


@pytest.mark.slow
def test_the_page_draws_every_shape_and_place(tmp_path: Path) -> None:
    """Hexagons, metres, no water: no browser error either."""
    from riftberg import A68A_2022

    hexagonal = A68A_2022.changed(bonds={"packing": "hexagonal"})
    writer = RunWriter(tmp_path / "run.nc", every_hours=6, background=False)
    FakeModel(latlon=False, parameters=hexagonal).advance(1.5, recorders=[writer])
    with open_run(tmp_path / "run.nc") as run:
        page = write_replay(run, tmp_path / "replay.html")
    with opened(page) as browser:
        browser.execute_script("replay.go(replay.span)")
        drawn(browser)
        assert errors(browser) == []


def members_at(k: int) -> Any:
    """Return a member around the fake berg: of each four two drift north of it and break up on the second day."""
    north, broken = 0.1 * (k % 4), 1 if k % 4 > 1 else None
    return outcome(k, [-39.0, -38.9, -38.7], [-55.0, -55.0 + north, -55.0 + 3.0 * north], broken=broken)


@pytest.fixture(scope="module")
def forecast() -> xr.Dataset:
    """Four members."""
    return forecast_of([members_at(k) for k in range(4)], 2)


def test_members_and_probabilities_are_where_the_forecast_has_them(run: xr.Dataset, forecast: xr.Dataset) -> None:
    scenarios = [(0, 0.5, "no piece breaks off"), (1, 0.5, "breaks off 30 km2")]
    content = ReplayContent(run, title="", observed={}, members=ForecastMembers(forecast, scenarios, "what is likely"))
    found = content.data()["members"]
    # The forecast starts at midnight, the run at 13:00.
    assert found["seconds"] == pytest.approx([-46800.0, 39600.0, 126000.0])
    x, y = unpack(found["x"]), unpack(found["y"])
    lon, lat = content.plane.inverse(x, y)
    np.testing.assert_allclose(lon, forecast["lon"].values[:, 0], atol=2e-4)
    np.testing.assert_allclose(lat, forecast["lat"].values[:, 0], atol=2e-4)
    assert found["p_broken"] == [0.0, 0.5, 0.5]
    assert found["scenario"] == forecast["scenario"].values.tolist()
    presence = found["presence"]
    share = unpack(presence["share"])
    for k, (at_x, at_y) in enumerate(zip(x.T, y.T, strict=True)):
        for m in range(4):
            i, j = (round((v - a[0]) / (a[1] - a[0]) * (share.shape[2 - n] - 1))
                    for n, (v, a) in enumerate(((at_x[m], presence["x"]), (at_y[m], presence["y"]))))  # fmt: skip
            there = forecast["presence"].isel(time=k).sel(cell_lon=lon[m, k], cell_lat=lat[m, k], method="nearest")
            assert share[k, j, i] == pytest.approx(100.0 * float(there), abs=0.3)
    assert set(share[0].ravel().tolist()) == {0.0, 100.0}  # all at one place at first
    # The ellipse of 90 % around the places of the second day: as far north as two of them are from their mean.
    many = forecast_of([members_at(k) for k in range(12)], 2)  # four do not make one
    content = ReplayContent(run, title="", observed={}, members=ForecastMembers(many, scenarios, "what is likely"))
    found = content.data()["members"]
    y = unpack(found["y"])
    line = np.reshape(found["ellipses"][1][2], (-1, 2))
    assert np.abs(line[:, 1] - y[:, 2].mean()).max() == pytest.approx(
        np.sqrt(-2 * np.log(0.1)) * y[:, 2].std(), rel=0.01
    )


def test_members_that_sightings_rule_out_are_not_drawn(run: xr.Dataset, forecast: xr.Dataset) -> None:
    """Bug: after `riftberg update` members of no weight were drawn like the others."""
    weighted = forecast.assign_coords(weight=("member", [0.0, 2.0, 1e-9, 2.0]))
    content = ReplayContent(run, title="", observed={}, members=ForecastMembers(weighted, [], ""))
    assert content.data()["members"]["scenario"] == forecast["scenario"].values[[1, 3]].tolist()
    assert choose_tracks(weighted).tolist() == [1, 3]
    assert choose_tracks(forecast).tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_a_page_with_members_works_in_a_browser(run: xr.Dataset, forecast: xr.Dataset, tmp_path: Path) -> None:
    scenarios = [(0, 0.5, "no piece breaks off"), (1, 0.5, "breaks off 30 km2")]
    page = write_replay(run, tmp_path / "replay.html", members=ForecastMembers(forecast, scenarios, "what is likely"))
    with opened(page) as browser:
        assert browser.find_element("id", "note").text == "what is likely"
        browser.execute_script("replay.go(39600)")
        drawn(browser)
        assert "50 % (" in browser.find_element("id", "facts").text
        buttons = browser.find_elements("css selector", "#scenarios button")
        assert [b.text.split("\n") for b in buttons] == [["50 %", "no piece breaks off"], ["50 %", "breaks off 30 km2"]]
        buttons[1].click()
        assert browser.execute_script("return replay.state.scenario") == 1
        browser.execute_script("document.getElementById('members').click()")
        drawn(browser)
        assert errors(browser) == []


def test_land_is_on_the_plane_of_the_page(tmp_path: Path) -> None:
    """Bug: all maps had coasts but the replay."""
    from shapely import Point, Polygon

    FakeModel(lon=-37.5, lat=-54.9).advance(
        2, recorders=[RunWriter(tmp_path / "run.nc", every_hours=12, experiment="fake")]
    )
    content = ReplayContent(open_run(tmp_path / "run.nc"), title="", observed={})
    coast = content._coast()
    shapes = [Polygon(np.reshape(ring, (-1, 2))) for area in coast for ring in area["rings"] if len(ring) >= 8]
    inland, sea = (
        content.plane.forward(np.array(lon), np.array(lat)) for lon, lat in ((-36.4, -54.55), (-38.5, -55.2))
    )
    assert any(shape.contains(Point(*map(float, inland))) for shape in shapes)
    assert not any(shape.contains(Point(*map(float, sea))) for shape in shapes)
    assert {area["colour"] for area in coast} == {LAND}
    FakeModel(latlon=False).advance(1, recorders=[RunWriter(tmp_path / "metres.nc", every_hours=12, experiment="fake")])
    assert not ReplayContent(open_run(tmp_path / "metres.nc"), title="", observed={})._coast()
