"""Runs side by side: events, distances by day, and which fragments count to the berg that was seen."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import netCDF4
import pytest

from fakes import FakeModel
from riftberg import Fix, Forcing, Iceberg, Model, Parameters, open_run, sweep
from riftberg.diagnostics.compare import (
    RealEvent,
    compare,
    compare_member,
    match_observed,
    read_compared,
    set_hours,
)
from riftberg.diagnostics.summary import summarize
from riftberg.errors import InputError
from riftberg.runs.accessor import align_breakups, own_dates
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.system.atomic_files import write_json

METRES = math.radians(1.0) * 6_363_827.0
WHOLE, REST, END = 216.0, 162.0, 54.0
"""Areas of the fake berg, of what is left of it, and of its end, which breaks off after a day, km2."""


def make_run(folder: Path, **changes: float) -> Path:
    """Write a run of four days."""
    model = FakeModel(**changes)  # type: ignore[arg-type]
    folder.mkdir(parents=True)
    model.advance(4, recorders=[RunWriter(folder / "run.nc", every_hours=3, experiment="fake")])
    write_json(summarize(model, experiment="fake"), folder / "summary.json")  # type: ignore[arg-type]
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("compare") / "one")


def fix(folder: Path, day: int, area: float, *, north: float = 0.0, turn: float = 0.0) -> Fix:
    """Return the place of the run's own berg after some days, moved north (m) and turned (degrees)."""
    with open_run(folder) as dataset:
        place = match_observed(Scene(dataset), 8 * day, area * 1e6)
    when = datetime(2020, 12, 9 + day, 13)
    return Fix("X", when, False, place.lon, place.lat + north / METRES, (place.azimuth + turn) % 180.0, area * 1e6)


def test_distance_and_turn_are_those_that_were_put_in(folder: Path) -> None:
    seen = [fix(folder, 0, WHOLE, north=3000.0, turn=20.0), fix(folder, 1, WHOLE, north=-4000.0, turn=-10.0)]
    told = read_compared(folder, "one", seen)
    assert [day.distance_km for day in told.days] == pytest.approx([3.0, 4.0], rel=1e-6)
    assert [day.azimuth_difference for day in told.days] == pytest.approx([-20.0, 10.0], abs=1e-6)
    assert told.rms() == pytest.approx((math.sqrt(12.5), math.sqrt(250.0)), rel=1e-6)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("area", "counted"), [(WHOLE, WHOLE), (190.0, WHOLE), (188.0, REST), (REST, REST), (50.0, REST), (math.nan, REST)]
)
def test_fragments_count_as_long_as_they_bring_the_area_closer(folder: Path, area: float, counted: float) -> None:
    """162 or 216 km2: the end counts to an outline above their mean of 189."""
    with open_run(folder) as dataset:
        made = match_observed(Scene(dataset), 16, area * 1e6)
    assert made.area == pytest.approx(counted * 1e6)


def test_neither_a_piece_left_far_behind_nor_another_berg_counts(folder: Path) -> None:
    """Bug: any ice whose area suited counted, so the middle of berg and tip lay where there was no ice."""
    with open_run(folder) as dataset:
        run = dataset.load()
    # The end is born in the run, and its elements are those of number 2 at the last record.
    behind = run.copy(deep=True)
    behind["lon"][run["berg"].isel(time=16).values == 2, 16] -= 2.0
    other = run.copy(deep=True)
    other["fragment_parent"][:] = 0
    for changed in (behind, other):
        made = match_observed(Scene(changed), 16, WHOLE * 1e6)
        assert made.area == pytest.approx(REST * 1e6)
    assert match_observed(Scene(run), 16, WHOLE * 1e6).area == pytest.approx(WHOLE * 1e6)


def test_days_outside_of_the_run_are_left_out(folder: Path) -> None:
    late = replace(fix(folder, 4, REST), when=datetime(2020, 12, 20, 13))
    assert [day.time for day in read_compared(folder, "one", [late, fix(folder, 4, REST)]).days] == [
        "2020-12-13T13:00:00"
    ]
    assert read_compared(folder, "one", [late]).rms() is None


def test_the_table_has_events_bonds_and_days(folder: Path, tmp_path: Path) -> None:
    other = make_run(tmp_path / "two", break_time=math.inf)
    seen = [fix(folder, 0, WHOLE, north=1000.0)]
    known = RealEvent({"break-up 1": "about then"}, {"break-up 2": "nobody's"}, seen)
    runs = [read_compared(folder, "one", seen), read_compared(other, "two", seen)]
    found = compare(runs, known)
    assert found.columns == ["", "published", "observed", "one", "two"]
    rows = dict(found.rows)
    assert rows["break-up 1"][0] == "about then"
    assert rows["break-up 1"][2].startswith("10 Dec 13:00 aground: 54 km², 3 bonds, at 55.0")
    assert rows["break-up 1"][2].endswith(" W")
    assert rows["break-up 1"][3] == "none"
    assert rows["break-up 2"] == ["", "nobody's", "", ""]
    assert rows["bonds broken"][2:] == ["3 of 37 = 8.1 %", "0 of 37 = 0.0 %"]
    assert rows["largest piece at the end"][2:] == ["162 km²", "216 km²"]
    assert rows["2020-12-09 13:00"][2:] == ["1.0 km off, +0°", "1.0 km off, +0°"]
    assert "S" in rows["2020-12-09 13:00"][1]
    assert [label for label, _ in found.rows][-2:] == ["2020-12-09 13:00", "rms of the days"]
    bare = [dataclasses.replace(seen[0], azimuth=math.nan)]  # a position alone has no turn
    rows = dict(compare([read_compared(folder, "one", bare)], RealEvent(fixes=bare)).rows)
    assert rows["rms of the days"][-1] == "1.0 km"
    told = json.loads(found.write(tmp_path / "c.json").read_text())
    assert told["runs"][0]["breakups"][0]["area_km2"] == 54.0
    assert told["runs"][1]["days"][0]["distance_km"] == pytest.approx(1.0, rel=1e-6)


def test_small_and_many_pieces_are_counted(folder: Path) -> None:
    told = read_compared(folder, "one", [])
    event = told.summary["breakups"][0]
    told.summary["breakups"] = [{**event, "area_km2": 9.0}] * 3 + [event] * 8
    rows = dict(compare([told]).rows)
    assert rows["smaller pieces"] == ["3 below 50 km²"]
    assert "break-up 6" in rows
    assert "break-up 7" not in rows
    assert rows["further break-ups"] == ["2"]


@pytest.mark.slow
def test_places_are_west_of_greenwich_or_in_kilometres(tmp_path: Path) -> None:
    """Grids of the reference count longitudes to 360."""
    told = read_compared(make_run(tmp_path / "east", lon=321.0), "east", [])
    assert dict(compare([told]).rows)["break-up 1"][0].endswith("38.60 W")  # 16.9 + 8.8 km east of 39 W
    plane = read_compared(make_run(tmp_path / "plane", latlon=False), "plane", [])
    assert re.search(r"at x 25.[67]\d* km, y -3.[45]\d* km$", dict(compare([plane]).rows)["break-up 1"][0])


def test_means_of_days_without_a_heading_leave_it_out(folder: Path) -> None:
    """Bug: members of a sweep, whose tracks have no heading, were "3.0 km, nan°" off."""
    run = read_compared(folder, "one", [fix(folder, 0, WHOLE, north=3000.0)])
    told = replace(run, days=[replace(run.days[0], azimuth_difference=None)])
    assert dict(compare([told]).rows)["rms of the days"] == ["3.0 km"]


def test_days_without_an_hour_get_one_and_interpolated_ones_are_left_out() -> None:
    noon = Fix("X", datetime(2020, 12, 9), True, -39.0, -55.0)
    found = set_hours([noon, replace(noon, interpolated=True), replace(noon, day_only=False)], 13.5)
    assert [f.when for f in found] == [datetime(2020, 12, 9, 13, 30), datetime(2020, 12, 9)]


def test_a_folder_without_a_summary_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file.*the folder that 'riftberg run' made"):
        read_compared(tmp_path, "x", [])


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({}, True), ({"time": "2020-12-14T12:00:00"}, True), ({"time": "2020-12-14T18:00:00"}, False),
        ({"lat": -55.0 + 149e3 / METRES}, True), ({"lat": -55.0 + 155e3 / METRES}, False), ({"area_km2": 210.0}, True),
        ({"area_km2": 220.0}, False), ({"grounded": False}, False),
    ],
)  # fmt: skip
def test_break_ups_are_the_same_within_four_days_150_km_and_four_times_the_area(
    changes: dict[str, Any], same: bool
) -> None:
    event = {"time": "2020-12-10T13:00:00", "lon": -38.6, "lat": -55.0, "area_km2": 54.0, "grounded": True}
    rows = align_breakups([[event], [event | changes]], {"latlon": True, "radius": 6_363_827.0})
    assert len(rows[0]) == (1 if same else 2)


def test_what_was_set_beside_the_parameters_is_told(folder: Path, tmp_path: Path) -> None:
    """Bug: a run with another thickness by --set berg.thickness stood beside the first without a word of it."""
    shutil.copytree(folder, tmp_path / "thick")
    with netCDF4.Dataset(tmp_path / "thick" / "run.nc", "a") as file:
        file.command = "riftberg run it.yaml --set berg.thickness=350m --set ice.density=850 -s 'berg.rotation=10'"
    runs = [read_compared(path, path.name, []) for path in (folder, tmp_path / "thick")]
    rows = dict(compare(runs).rows)
    assert rows["parameters that differ"] == [
        "berg.rotation as it was, berg.thickness as it was",
        "berg.rotation 10, berg.thickness 350m",
    ]


def drifting(speed: float) -> Model:
    """Return a model of one element in a current."""
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform((speed, 0.0), slope=(0.0, 0.0)), Parameters(), start="2020-12-09")


def test_a_member_of_a_sweep_is_compared_by_its_own_track_and_time() -> None:
    ds = sweep(drifting, {"speed": [0.1, 0.2]}, days=0.5, every_hours=6, workers=0)
    ds["wall_time"].values[:] = 3.0
    member = ds.sel(member=1)
    member = member.assign_coords(time=own_dates(member))
    lon, lat = (float(member[name].isel(fragment=0).values[-1]) for name in ("lon", "lat"))
    seen = Fix("X", datetime(2020, 12, 9, 12), False, lon, lat + 3000.0 / METRES, 0.0, 9e6)
    told = compare_member(member, "fast", [seen])
    assert told.summary["seconds_per_day"] == pytest.approx(6.0)
    assert (told.summary["bonds_broken"], told.summary["largest_km2"]) == (0, pytest.approx(9.0))
    assert [day.distance_km for day in told.days] == pytest.approx([3.0], rel=1e-4)
