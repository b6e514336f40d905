"""Measurements of speed, and their yardstick."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from fakes import FakeModel
from riftberg.errors import InputError
from riftberg.experiments import Info
from riftberg.state import copy_state
from scripts import loaded

bench = loaded("benchmarks/bench.py")


def measured(*arguments: str, capsys: pytest.CaptureFixture[str]) -> Any:
    """Return what the script prints as JSON."""
    assert bench.main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeModel:
    """Make every experiment a fake one."""
    model = FakeModel()
    monkeypatch.setattr(bench, "build", lambda name, options: (model, Info("fake")))
    return model


def test_json_has_every_documented_key(fake: FakeModel, capsys: pytest.CaptureFixture[str]) -> None:
    row: dict[str, Any] = measured("fake", "--days", "1", capsys=capsys)
    text = bench.__doc__.partition("----\n")[2]
    keys = {name.strip() for line in text.splitlines() if " : " in line for name in line.split(" : ")[0].split(",")}
    assert set(row) == keys
    assert (row["elements"], row["bonds"], row["days"]) == (24, 37, 1.0)
    assert row["substeps_per_day"] == 90 * 48
    assert row["seconds_per_day"] > 0.0
    assert 20.0 < row["memory_mb"] < 5000.0
    assert row["relative_to_yardstick"] == pytest.approx(row["seconds_per_day"] / row["yardstick_seconds_per_day"])


@pytest.mark.slow
def test_a_whole_run_is_timed_day_by_day_and_with_output(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "REPEATS", 2)
    monkeypatch.setattr(bench, "WHOLE_SECONDS", float("inf"))  # a busy machine
    whole = measured("a68a", "--days", "2", capsys=capsys)["whole_run"]
    assert 0.0 < whole["seconds_per_day"] <= whole["slowest"]
    assert whole["seconds_per_day"] < whole["with_output"]["seconds_per_day"] <= whole["with_output"]["slowest"]
    dearest = whole["dearest_days"]
    assert sum(day["seconds"] for day in dearest) <= whole["slowest"] * whole["days"]
    assert [day["seconds"] for day in dearest] == sorted((day["seconds"] for day in dearest), reverse=True)
    assert "dearest: day" in bench.whole_line(whole)


def test_days_of_a_whole_run_follow_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A day that costs more stands first, with its own number, and the last may be a part of a day."""
    model, spent = FakeModel(), [0.0]
    dt = model.parameters.time_step

    def step() -> None:
        spent[0] += 5.0 if 86_400.0 <= model.time < 2 * 86_400.0 else 1.0
        model.time += dt

    monkeypatch.setattr(model, "step", step)
    monkeypatch.setattr(bench.clock, "process_time", lambda: spent[0])
    a_day = 86_400.0 / dt
    assert bench._processor_days(model, 2.5) == pytest.approx([a_day, 5 * a_day, a_day / 2])  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_scheme_is_set_and_told(capsys: pytest.CaptureFixture[str]) -> None:
    row = measured("a68a", "--set", "stepping.scheme=mts", "--days", "0.1", capsys=capsys)
    assert row["scheme"] == "mts"
    assert row["substeps_per_day"] > 1000.0
    with pytest.raises(SystemExit, match="2"):
        bench.main(["a68a", "--set", "stepping.scheme=fast"])
    assert "quasi_static" in capsys.readouterr().err


@pytest.mark.slow
def test_the_other_scheme_stands_beside_unless_one_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    """What a scheme costs is half of what to know before one is chosen."""
    told: dict[str, list[str]] = {}
    for asked in ("", "mts"):
        settings = ["--set", f"stepping.scheme={asked}"] if asked else []
        row = measured("a68a", *settings, "--days", "0.02", capsys=capsys)
        told[asked] = [row["scheme"], *(other["scheme"] for other in row["other_schemes"])]
    assert told == {"": ["quasi_static", "mts"], "mts": ["mts"]}


@pytest.mark.slow
def test_sizes_are_timed_with_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    rows = measured("--scaling", "20", "--set", "stepping.time_step=900", "--days", "0.02", capsys=capsys)
    assert [row["time_step"] for row in rows] == [900.0]


def test_the_yardstick_is_the_same_for_all_schemes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.clock, "perf_counter", iter(range(100)).__next__)  # type: ignore[attr-defined]
    few = FakeModel()
    few.substeps = 10
    rows = [bench.yardstick_seconds_per_day(model, seconds=5.0, repeats=1) for model in (FakeModel(), few)]
    assert rows[0] == rows[1] > 0.0


def test_line_for_people(fake: FakeModel, capsys: pytest.CaptureFixture[str]) -> None:
    bench.main(["fake", "--days", "1"])
    out = capsys.readouterr().out
    assert "fake: 24 elements, 37 bonds" in out
    assert "yardstick" in out


def test_yardstick_grows_with_the_number_of_bonds() -> None:
    small, large = FakeModel(20, 10), FakeModel(80, 40)
    ratio = len(large.bonds.first) / len(small.bonds.first)
    times = [bench.yardstick_seconds_per_day(model, seconds=0.1) for model in (small, large)]
    assert 0.4 * ratio < times[1] / times[0] < 2.5 * ratio


def test_yardstick_leaves_the_model_alone_and_stays_finite() -> None:
    model = FakeModel()
    before = copy_state(model.elements, model.bonds)
    bench.yardstick_seconds_per_day(model, seconds=0.01, repeats=1)
    for old, new in zip(before, (model.elements, model.bonds), strict=True):
        for name, array in new.arrays().items():
            np.testing.assert_array_equal(getattr(old, name), array, err_msg=name)
    state, rest = bench._start(model)
    bench._loop(model.bonds.first, model.bonds.second, state, np.zeros((3, 24)), rest, 1.0, 1000)
    assert np.isfinite(state).all()


def test_sizes_of_scaling() -> None:
    assert bench.sizes_between("500..5000") == [500, 1000, 2000, 5000]
    assert bench.sizes_between("700..900") == [700, 900]
    assert bench.sizes_between("300") == [300]
    for wrong in ("many", "10..5", "0..5", "..5"):
        with pytest.raises(InputError, match="is not a range"):
            bench.sizes_between(wrong)


def test_scaling_bergs_have_about_the_number_asked_for() -> None:
    for size in (500, 1000):
        assert len(bench.square_berg(size).elements.id) == pytest.approx(size, rel=0.05)
