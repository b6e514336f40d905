"""The summary of a run."""

from __future__ import annotations

import ast
import json
import time as clock
from pathlib import Path

import pytest

from fakes import FakeModel
from riftberg import __version__
from riftberg.diagnostics.summary import summarize
from riftberg.runs.progress import Stopwatch
from riftberg.runs.tracks import DailyTrack
from riftberg.system.atomic_files import write_json
from scripts import ROOT


@pytest.fixture
def result() -> dict[str, object]:
    """Summary of a run of two days in which a piece of 6 elements breaks off on the first."""
    model, track, stopwatch = FakeModel(), DailyTrack(), Stopwatch()
    model.advance(2, recorders=[track, stopwatch])
    return summarize(model, experiment="fake", track=track.rows, stopwatch=stopwatch)


def test_numbers(result: dict[str, object]) -> None:
    assert (result["start"], result["end"]) == ("2020-12-09T13:00:00", "2020-12-11T13:00:00")
    assert (result["days"], result["steps"], result["elements"]) == (2.0, 96, 24)
    assert (result["bonds_total"], result["bonds_broken"], result["fragments"]) == (37, 3, 2)
    assert result["areas_km2"] == [162.0, 54.0]
    assert result["largest_km2"] == 162.0
    assert result["riftberg"] == __version__
    assert result["numerics"]["fracture"]["normal_strength"] == 18e3


def test_breakup(result: dict[str, object]) -> None:
    (event,) = result["breakups"]
    assert event["time"] == "2020-12-10T13:00:00"
    assert (event["area_km2"], event["bonds"], event["grounded"]) == (54.0, 3, True)
    assert (event["fragment"], event["parent"]) == (2, 1)


def test_track_is_daily_and_speed_is_measured(result: dict[str, object]) -> None:
    assert [row["time"][8:13] for row in result["track"]] == ["09T13", "10T13", "11T13"]
    assert 0.0 < result["seconds_per_day"] < result["wall_seconds"]


def test_every_key_is_documented(result: dict[str, object]) -> None:
    source = ROOT / "src" / "riftberg" / "diagnostics" / "summary.py"
    text = ast.get_docstring(ast.parse(source.read_text("utf-8"))) or ""
    keys = {name.strip() for line in text.splitlines() if " : " in line for name in line.split(" : ")[0].split(",")}
    assert set(result) == keys


def test_json_comes_back(result: dict[str, object], tmp_path: Path) -> None:
    assert json.loads(write_json(result, tmp_path / "summary.json").read_text()) == result


def test_a_run_of_one_step_has_no_speed() -> None:
    model, stopwatch = FakeModel(), Stopwatch()
    model.advance(1800 / 86400, recorders=[stopwatch])
    assert summarize(model, stopwatch=stopwatch)["seconds_per_day"] is None


def test_a_stopwatch_counts_the_seconds_since_its_start():
    """Wall time so far, also before the run ends."""
    began = clock.perf_counter()
    stopwatch = Stopwatch()
    stopwatch.start(FakeModel())
    clock.sleep(0.02)
    stopwatch.record(FakeModel())
    assert 0.02 <= stopwatch.wall_seconds <= clock.perf_counter() - began
