"""How far two runs are apart: by time, across the date line, for members of a sweep, in Python and on the command line."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from diagnostics.test_compare import METRES, make_run
from fakes import EXPLICIT, FakeModel
from riftberg import open_run, open_sweep
from riftberg.cli.main import app
from riftberg.diagnostics.compare import compare, read_compared
from riftberg.errors import InputError
from riftberg.runs.accessor import Course, align_breakups, compare_courses, find_course
from riftberg.runs.run_file import memory_run

YAML = """start: 2020-12-09
days: 0.5
forcing: {uniform: {current: [0.3, 0.1], slope: [0, 0]}}
berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39, -55], thickness: 200 m, name: X1, velocity: [0.2, 0.0]}
"""


def call(*arguments: str) -> Any:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return result


def course(hours: list[float], lon: Any = 0.0, azimuth: Any = 10.0) -> Course:
    times = np.datetime64("2020-12-09T00", "ns") + (np.array(hours) * 3.6e12).astype("timedelta64[ns]")
    x, y, turn, area = (np.zeros(times.size) + a for a in (lon, -60.0, azimuth, 1e8))
    return Course("", times, x, y, turn, area, [], True, 6.371e6)


def test_distance_and_rotation_are_between_the_records_of_the_other_and_turn_the_short_way() -> None:
    one, other = course([0, 1, 2], lon=[0.0, 1.0, 2.0], azimuth=175.0), course([-1, 3], lon=[-1.0, 3.0], azimuth=5.0)
    found = compare_courses(one, other)
    np.testing.assert_allclose(found["distance"], 0.0, atol=1.0)
    np.testing.assert_allclose(found["rotation"], 10.0)
    half = np.radians(0.5) * 6.371e6 * 0.5
    moved = compare_courses(one, course([-1, 3], lon=[-0.5, 3.5]))
    np.testing.assert_allclose(moved["distance"], half, rtol=1e-4)
    assert compare_courses(one, course([1.5, 9.0]))["time"].tolist() == one.times[2:].tolist()


def test_a_periodic_channel_is_measured_the_short_way_round() -> None:
    """Bug: bergs at 10 and 99 km of a channel of 100 km were 89 km apart, and one that went round came from the other end."""
    earth = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 100e3}
    model = FakeModel(latlon=False, break_time=math.inf, parameters=EXPLICIT.changed(earth=earth))
    with memory_run(None, 3.0) as writer:
        model.advance(1, recorders=[writer])
        run = writer.dataset()
    # As in files of 0.2.0, in which positions were taken back at the seam.
    here, there = (run.assign(x=((run["x"] + x) % 100e3).assign_attrs(comment="")) for x in (10e3, 99e3))
    np.testing.assert_allclose(here.riftberg.compare(there)["distance"], 11e3, rtol=1e-6)
    assert np.ptp(find_course(there).x) == pytest.approx(0.2 * 86400.0, rel=1e-3)
    event = {"time": "2020-12-10T13:00:00", "lat": 0.0, "area_km2": 54.0, "grounded": False}
    rows = align_breakups(
        [[{**event, "lon": 1e3}], [{**event, "lon": 399e3}]], {**earth, "radius": 6.371e6, "period": 400e3}
    )
    assert [len(row) for row in rows] == [1, 1]  # one event of both


def test_only_records_that_both_have_count_where_there_are_some() -> None:
    """Bug: between the positions of a member, six hours apart, a berg that oscillates was said to be a kilometre away."""
    swings = [0.0, 0.1, 0.0, -0.1, 0.0]
    found = compare_courses(course([0, 3, 6, 9, 12], lon=swings), course([0, 6, 12], lon=swings[::2]))
    assert found["time"].size == 3
    np.testing.assert_allclose(found["distance"], 0.0, atol=1e-6)


def test_runs_without_a_common_date_are_refused() -> None:
    with pytest.raises(InputError, match="no date in common: 2020-12-09T00:00 to 2020-12-09T01:00 and 2020-12-10"):
        compare_courses(course([0, 1]), course([24, 25]))


def test_a_table_shows_whole_days_and_the_last_record(tmp_path: Path) -> None:
    run = read_compared(make_run(tmp_path / "one"), "one", [])

    def shown(hours: list[float]) -> list[float]:
        """Return the days of the rows of two runs with such records."""
        same = replace(run, course=course(hours))
        dates = [np.datetime64(label.replace(" ", "T")) for label, _ in compare([same, same]).apart_rows()]
        return [(date - np.datetime64("2020-12-09T00:00")) / np.timedelta64(1, "D") for date in dates]

    assert shown(list(range(0, 24 * 30 + 5))) == [*range(0, 31, 3), 30 + 4 / 24]
    assert len(shown([0, 1, 2])) == 3
    assert shown([0]) == [0.0]


def test_the_same_break_up_of_two_runs_stands_in_one_column(tmp_path: Path) -> None:
    with open_run(make_run(tmp_path / "one")) as one, open_run(make_run(tmp_path / "two", break_time=2e5)) as two:
        found = one.riftberg.compare(two)
        assert found.sizes["breakup"] == 1
        lag = found["breakup_time"].diff("run").values.item() / 1e9
        assert lag == pytest.approx(2e5 - 86400.0, abs=3 * 3600.0)
        np.testing.assert_allclose(found["breakup_area"], 54e6)
        assert found["distance"].attrs["units"] == "m"
        assert (found["distance"].values[found["area"][0] == found["area"][1]] < 1.0).all()
        assert found["distance"].max() > 1000.0  # while one has lost its end and the other not
        with pytest.raises(InputError, match="no berg 'A'"):
            one.riftberg.compare(two, berg="A")
        with pytest.raises(InputError, match="is no run"):
            one.riftberg.compare(xr.Dataset())


def test_the_date_line_is_no_distance(tmp_path: Path) -> None:
    with (
        open_run(make_run(tmp_path / "west", lon=-179.99)) as one,
        open_run(make_run(tmp_path / "east", lon=180.01, lat=-54.9)) as two,
    ):
        assert one.riftberg.compare(two)["distance"].values[0] == pytest.approx(0.1 * METRES, rel=2e-3)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("apart")
    (folder / "it.yaml").write_text(YAML)
    light = ("--set", "ice.density=700")
    for name, more in (("a", ()), ("b", light)):
        call("run", str(folder / "it.yaml"), "-o", str(folder / name), "-q", "--no-map", *more)
    call("sweep", str(folder / "it.yaml"), "--vary", "ice.density=850,700", "-o", str(folder / "s"), "--workers", "0")
    return folder


@pytest.mark.slow
def test_runs_and_members_of_a_sweep_are_compared_alike(runs: Path, tmp_path: Path) -> None:
    """The second member is the second run. Its centroid is the mean of longitudes and latitudes, a metre from that of a run."""
    member = f"{runs / 's' / 'sweep.nc'}#1"
    result = call("compare", str(runs / "a"), str(runs / "b"), member, "-o", str(tmp_path / "out"))
    for words in ("apart", "b from a", "sweep.nc#1 from a", "55.00 S, 39.00 W", "ice.density 700"):
        assert words in result.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["comparison.json", "tracks.png"]
    run, other = json.loads((tmp_path / "out" / "comparison.json").read_text())["apart"]
    assert run["berg"] == "X1"
    assert run["distance_km"][-1] > 0.05
    assert other["distance_km"][-1] == pytest.approx(run["distance_km"][-1], abs=2e-3)
    assert other["rotation"] == [None] * len(other["time"])
    with open_run(runs / "a") as one:
        found = one.riftberg.compare(open_sweep(runs / "s").isel(member=1))
        assert found["distance"].values[-1] == pytest.approx(1e3 * run["distance_km"][-1], abs=2.0)


@pytest.mark.slow
def test_observations_stand_beside_runs_of_their_dates_alone(runs: Path, tmp_path: Path) -> None:
    (tmp_path / "seen.csv").write_text("name,date,lat,lon\nX1,2020-12-09 06:00,-55.0,-39.0\nX1,2020-12-20,-56,-39\n")
    (tmp_path / "late.csv").write_text("name,date,lat,lon\nX1,2020-12-20,-56,-39\n")
    both = str(runs / "a"), f"{runs / 's' / 'sweep.nc'}#0"
    seen = json.loads(call("compare", *both, "--observed", str(tmp_path / "seen.csv"), "--json").output)
    assert seen["columns"][:2] == ["", "observed"]
    assert [len(run["days"]) for run in seen["runs"]] == [1, 1]
    assert seen["runs"][0]["days"][0]["distance_km"] == pytest.approx(
        seen["runs"][1]["days"][0]["distance_km"], abs=2e-3
    )
    late = CliRunner().invoke(app, ["compare", *both, "--observed", str(tmp_path / "late.csv"), "--json"])
    assert late.exit_code == 2
    assert "no position during the runs" in late.output


def test_a_member_that_is_not_there_is_refused(runs: Path) -> None:
    result = CliRunner().invoke(app, ["compare", str(runs / "a"), f"{runs / 's' / 'sweep.nc'}#7"])
    assert result.exit_code == 2
    assert "no member 7" in result.output
    assert "It has 2, counted from 0" in result.output
