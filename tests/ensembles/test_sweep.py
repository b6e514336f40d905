"""Sweeps: members side by side, each restartable; what fails is kept, what is lost is done again with the same result."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import riftberg
from riftberg import Forcing, Iceberg, Model, Options, Parameters, draw_sweep, open_cells, open_run, open_sweep, sweep
from riftberg.cli.ensembles import summary_lines
from riftberg.cli.main import app
from riftberg.ensembles.result import write_sweep
from riftberg.errors import InputError, RunError
from riftberg.verification.sightings import berg_offsets

from .made import forecast_of, outcome

MOST_LISTED = 64

SPEEDS = [0.1, 0.2, 0.3]


def drifting(speed: float, fail: bool = False) -> Model:
    """Return a model that costs nothing: one element in a current."""
    if fail:
        raise RunError("this member cannot be")
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0)), Parameters(), start="2020-12-09")


def halting(speed: float, folder: str) -> Model:
    """Return a model whose sweep is told to stop at its sixth step, once."""
    model = drifting(speed)

    def halt(now: Any) -> None:
        marker = Path(folder) / "halted"
        if speed == SPEEDS[1]:
            with (Path(folder) / "steps").open("a") as steps:
                steps.write("x")
        if now.step_number == 5 and speed == SPEEDS[1] and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGINT)

    model.after_step.append(halt)
    return model


def dying(speed: float, folder: str) -> Model:
    """Return a model whose process is killed once, in the middle of the run."""
    model = drifting(speed)

    def die(now: Any) -> None:
        marker = Path(folder) / "died"
        if now.step_number == 5 and speed == SPEEDS[1] and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    model.after_step.append(die)
    return model


def same(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Whether two results agree to the last digit, but for wall times and arguments that are no physics."""
    names = set(first.variables) - {"wall_time", "folder"}
    assert names == set(second.variables) - {"wall_time", "folder"}
    for name in names:
        a, b = first[name].values, second[name].values
        text = a.dtype.kind in "OUT"
        assert a.astype(str).tolist() == b.astype(str).tolist() if text else np.array_equal(a, b, equal_nan=True), name
    return True


@pytest.fixture(scope="module")
def alone() -> xr.Dataset:
    """The sweep in this process."""
    return sweep(drifting, {"speed": SPEEDS}, days="6 h", every_hours=1, workers=0)


def test_members_are_what_single_runs_are(alone: xr.Dataset) -> None:
    assert dict(alone.sizes) == {"member": 3, "fragment": 1, "time": 7}
    for k, speed in enumerate(SPEEDS):
        run = drifting(speed).run("6 h", every_hours=1)
        assert alone["lon"].values[k, 0] == pytest.approx(run["lon"].values[0], abs=1e-12)
        assert alone["lat"].values[k, 0] == pytest.approx(run["lat"].values[0], abs=1e-12)
    assert alone["speed"].values.tolist() == SPEEDS
    assert alone["status"].values.tolist() == [0, 0, 0]
    assert alone["time"].values[-1] == np.datetime64("2020-12-09T06:00")


def test_a_failed_member_is_kept_with_its_message(tmp_path: Path) -> None:
    result = sweep(
        drifting, {"speed": [0.1, 0.2], "fail": [False, True]}, days="1 h", every_hours=1, workers=0, output=tmp_path
    )
    assert result["status"].values.tolist() == [0, 1, 0, 1]
    assert result["message"].values.tolist() == ["", "this member cannot be", "", "this member cannot be"]
    assert np.isfinite(result["lon"].values[[0, 2]]).all()
    assert np.isnan(result["lon"].values[[1, 3]]).all()
    assert same(open_sweep(tmp_path), result)


def test_the_file_speaks_cf(alone: xr.Dataset, tmp_path: Path) -> None:
    path = write_sweep(alone, tmp_path / "sweep.nc")
    with xr.open_dataset(path, decode_times=False) as raw:
        assert raw.attrs["Conventions"] == "CF-1.11"
        assert raw["member"].attrs["standard_name"] == "realization"
        assert raw["time"].attrs["units"].startswith("seconds since 2020-12-09")
        assert raw["lon"].attrs["standard_name"] == "longitude"
        assert {"fragment_lat", "fragment_lon"} < set(raw["fragment_area"].coords)  # as the checker of CF asks
        assert not any("_FillValue" in raw[name].encoding for name in ("member", "fragment", "time"))  # CF, 2.5.1
        for name, variable in raw.data_vars.items():
            assert "long_name" in variable.attrs or "standard_name" in variable.attrs, name
            if variable.dtype.kind == "f":
                assert "units" in variable.attrs, name
    assert same(open_sweep(path), alone)
    zarr = write_sweep(alone, tmp_path / "sweep.zarr")
    assert np.array_equal(open_sweep(zarr)["lon"], alone["lon"], equal_nan=True)


@pytest.mark.parametrize("damaged", [False, True])
def test_a_sweep_goes_on_and_keeps_what_is_done(damaged: bool, alone: xr.Dataset, tmp_path: Path) -> None:
    """Ctrl-C in the middle of the second member: it goes on from its state, unless this is damaged; the first is not run again.

    Bug: tracks had grown by two columns, each state counted as damaged, and every member began anew, with the same digits.
    """
    vary = {"speed": SPEEDS, "folder": [str(tmp_path)]}
    options: dict[str, Any] = {"days": "6 h", "every_hours": 1, "workers": 0, "output": tmp_path / "out"}
    with pytest.raises(KeyboardInterrupt):
        sweep(halting, vary, **options)
    members = tmp_path / "out" / "members"
    assert sorted(path.name for path in members.iterdir()) == ["00000.json", "00001.restart.nc"]
    assert open_sweep(tmp_path / "out")["status"].values.tolist() == [0, 2, 2]
    first = (members / "00000.json").stat().st_mtime_ns
    with pytest.raises(InputError, match="holds a sweep already"):
        sweep(halting, vary, **options)
    before = len((tmp_path / "steps").read_text())
    if damaged:
        (members / "00001.restart.nc").write_bytes(b"no state")
    result = sweep(halting, vary, **options, resume=True)
    whole = drifting(SPEEDS[1])
    whole.advance("6 h")
    assert len((tmp_path / "steps").read_text()) == whole.step_number + (before if damaged else 0)
    assert (members / "00000.json").stat().st_mtime_ns == first
    assert same(result, alone)
    assert sorted(path.suffix for path in members.iterdir()) == [".json"] * 3


class Slow:
    """Clock by which each step of one member takes a minute and those of the others nothing."""

    now = 0.0

    def monotonic(self) -> float:
        """Return seconds."""
        return self.now

    perf_counter = monotonic

    def model(self, speed: float) -> Model:
        """Return a model that costs nothing by the clock of the wall."""
        made = drifting(speed)
        if speed == SPEEDS[1]:
            made.after_step.append(lambda _: setattr(self, "now", self.now + 60.0))
        return made


@pytest.mark.slow
def test_a_member_that_takes_too_long_is_left_told_and_goes_on_when_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = sweep(drifting, {"speed": SPEEDS}, days=1, every_hours=1, workers=0)
    slow = Slow()
    monkeypatch.setattr("riftberg.ensembles.member.clock", slow)
    run = partial(sweep, slow.model, {"speed": SPEEDS}, days=1, every_hours=1, workers=0, output=tmp_path / "s")
    result = run(member_time="10 min")
    assert result["status"].values.tolist() == [0, 3, 0]
    message = result["message"].values[1]
    assert message.startswith("unfinished after 10 min, at day 0.")
    assert summary_lines(result)[0].endswith("0 failed, 1 unfinished")
    assert summary_lines(result)[2].endswith(message)
    known = np.isfinite(result["area"].values[1, 0])
    assert 0 < known.sum() < known.size  # what it came to until then is there
    assert np.array_equal(result["lon"].values[1, 0, known], whole["lon"].values[1, 0, known])
    again = run(resume=True)  # from the state that it saved
    assert again["status"].values.tolist() == [0, 0, 0]
    for name in ("lon", "lat", "area", "pieces"):
        assert np.array_equal(again[name].values, whole[name].values)
    with pytest.raises(InputError, match="member_time: 0 s"):
        sweep(drifting, {"speed": SPEEDS}, days=1, member_time=0)


@pytest.mark.slow
def test_the_control_of_a_forecast_takes_the_time_that_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow()
    monkeypatch.setattr("riftberg.ensembles.member.clock", slow)
    result = riftberg.forecast(
        partial(slow.model, SPEEDS[1]), {"current_error.speed": ["0.1 m/s"]}, members=2, days=1, workers=0,
        default_errors=False, output=tmp_path / "f", member_time="10 min",
    )  # fmt: skip
    assert result["status"].values.tolist() == [3, 3]
    assert open_run(tmp_path / "f" / "control.nc").sizes["time"] > 1


def test_another_sweep_in_the_folder_is_not_gone_on_with(tmp_path: Path) -> None:
    sweep(drifting, {"speed": [0.1]}, days="1 h", every_hours=1, workers=0, output=tmp_path)
    with pytest.raises(InputError, match="holds another sweep: vary is"):
        sweep(drifting, {"speed": [0.2]}, days="1 h", every_hours=1, workers=0, output=tmp_path, resume=True)
    with pytest.raises(InputError, match="holds no sweep"):
        sweep(drifting, {"speed": [0.2]}, days="1 h", every_hours=1, output=tmp_path / "new", resume=True)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"days": None}, "the length of the runs is missing"),
        ({"days": "3 kPa"}, "days: '3 kPa' is in kPa"),
        ({"days": -1}, "-1 days"),
        ({"every_hours": 0}, "a position every 0 h"),
        ({"every_hours": 100}, "a position every 100 h"),
        ({"scheduler": "nowhere"}, "no scheduler of dask answers there"),
    ],
)
def test_a_bad_sweep_is_refused_before_its_first_run(options: dict[str, Any], message: str, tmp_path: Path) -> None:
    given = {"days": 0.1, "every_hours": 1, "output": tmp_path / "out", **options}
    with pytest.raises(InputError, match=message):
        sweep(drifting, {"speed": [0.1, 0.2]}, **given)
    assert not (tmp_path / "out").exists()


def test_an_option_of_a_sweep_that_there_is_not_is_refused_by_name() -> None:
    with pytest.raises(TypeError, match=r"'worker'\. Did you mean 'workers'\?"):
        sweep(drifting, {"speed": [0.1]}, days=0.1, worker=0)  # type: ignore[call-arg]


HEXAGONS = """\
start: 2020-12-09 13:00
days: 1
berg:
  rectangle: {length: 9 km, width: 6 km}
  packing: hexagonal
  placement: [-39.0, -55.5]
forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}
"""


def test_impossible_combinations_and_what_an_experiment_keeps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"member with .*grounding.law = 'quadratic' is of the explicit schemes.*seabed"
    ):
        sweep("a68a", ["grounding.law=seabed,quadratic"])
    with pytest.raises(
        InputError, match=r"grounding.coefficient: it is of the explicit schemes: .*grounding.law: none"
    ):
        sweep("a68a", ["grounding.coefficient=0,1e4"])
    with pytest.raises(InputError, match=r"member with bonds.packing = 'hexagonal': .*the berg has square elements"):
        sweep("a68a", ["bonds.packing=square,hexagonal"])
    (tmp_path / "hexagons.yaml").write_text(HEXAGONS)
    with pytest.raises(InputError, match=r"hexagons.yaml keeps bonds.packing = 'hexagonal' whatever is given"):
        sweep(tmp_path / "hexagons.yaml", ["bonds.packing=square,hexagonal"])
    with pytest.raises(InputError, match="no experiment of this name"):
        sweep("a86a", ["fracture.normal_strength=14,18kPa"])


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Return the file of a small experiment."""
    file = tmp_path / "mine.yaml"
    file.write_text(
        "start: 2020-12-15\ndays: 0.05\nberg: {rectangle: {length: 6 km, width: 3 km}, placement: [-37, -56], thickness: 200}\n"
        "forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}\n"
    )
    return file


def changed(file: Path, old: str) -> None:
    file.write_text(file.read_text().replace(old, old.replace("2", "3").replace("5", "6")))


@pytest.mark.parametrize("old", ["0.2, 0.0", "thickness: 200", "days: 0.05"])
def test_an_experiment_that_changes_on_the_way_is_not_mixed_with_what_is_done(
    old: str, experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file is written anew while the first of two members runs."""
    step, options = Model.step, {"every_hours": 1, "workers": 0, "output": tmp_path / "out"}

    def step_and_change(model: Model) -> None:
        step(model)
        changed(experiment, old)

    with monkeypatch.context() as patched:
        patched.setattr(Model, "step", step_and_change)
        result = sweep(experiment, ["fracture.normal_strength=14,18kPa"], **options)
    assert result["status"].values.tolist() == [0, 1]
    assert "this file has changed since the sweep began" in result["message"].values[1]
    with pytest.raises(InputError, match=r"mine\.yaml has changed since the sweep began"):
        sweep(experiment, ["fracture.normal_strength=14,18kPa"], days=0.05, resume=True, **options)


def ran(experiment: Path, vary: str, out: Path, part: str) -> str:
    """Run a part of a sweep on the command line, and return what it prints."""
    words = ["sweep", str(experiment), "--vary", vary, "--every", "1", "--part", part, "-o", str(out), "--workers", "0"]
    return CliRunner().invoke(app, [*words, "--no-map"]).output


@pytest.mark.parametrize("there", ["fracture.normal_strength=14,18,30kPa", "start.east=1,2"])
def test_parts_are_not_joined_into_another_sweep(there: str, experiment: Path, tmp_path: Path) -> None:
    sweep(experiment, [there], every_hours=1, workers=0, output=tmp_path / "out")
    ran(experiment, "fracture.normal_strength=14,18,24kPa", tmp_path / "out", "1/1")
    before = (tmp_path / "out" / "sweep.json").read_text()
    said = CliRunner().invoke(app, ["sweep", "--join", str(tmp_path / "out"), "--no-map"])
    assert said.exit_code == 2
    assert "holds another sweep than its parts" in said.output
    assert (tmp_path / "out" / "sweep.json").read_text() == before


def test_members_of_other_parts_wait_and_have_not_failed(experiment: Path, tmp_path: Path) -> None:
    ran(experiment, "fracture.normal_strength=14,16,18kPa", tmp_path, "1/3")
    said = CliRunner().invoke(app, ["sweep", "--join", str(tmp_path), "--no-map"]).output
    assert "0 failed" in said
    assert said.count("waits") == 2
    assert "failed:" not in said


FASTEST = "stepping.speed_limit=0.0010,10,0.0011,11,12,13"
"""Of six members numbers 0 and 2 fail: nothing may move faster than a millimetre a second."""


def test_parts_that_are_joined_keep_failures_and_cells_and_say_what_is_missing(
    experiment: Path, tmp_path: Path
) -> None:
    """Failed members had become waiting ones, and files on cells stayed in the parts."""
    for k, member in ((1, 0), (3, 2)):
        ran(experiment, FASTEST, tmp_path, f"{k}/4")
        cells = tmp_path / f"part-{k}-of-4" / "cells"
        cells.mkdir()
        (cells / f"{member:05d}-monthly.nc").touch()
    said = CliRunner().invoke(app, ["sweep", "--join", str(tmp_path), "--no-map"])
    assert "Missing: parts 2, 4; 5 members wait" in said.output
    result = open_sweep(tmp_path)
    assert result["status"].values.tolist() == [1, 2, 1, 2, 0, 2]
    assert "speed" in result["message"].values[0]
    assert [file.name for file in sorted((tmp_path / "cells").iterdir())] == ["00000-monthly.nc", "00002-monthly.nc"]
    # What failed is tried again when it goes on, and a part goes on as a part.
    done = {path: path.stat().st_mtime_ns for path in (tmp_path / "members").iterdir()}
    again = CliRunner().invoke(app, ["sweep", "--resume", str(tmp_path), "--no-map", "--workers", "0"])
    assert "2 failed" in again.output
    assert open_sweep(tmp_path)["status"].values.tolist() == [1, 0, 1, 0, 0, 0]
    anew = {int(path.stem) for path, time in done.items() if path.stat().st_mtime_ns != time}
    assert anew == {0, 2}
    CliRunner().invoke(app, ["sweep", "--resume", str(tmp_path / "part-3-of-4"), "--no-map", "--workers", "0"])
    assert open_sweep(tmp_path / "part-3-of-4")["status"].values.tolist() == [2, 2, 1, 2, 2, 2]


def test_a_part_without_members_has_not_failed(experiment: Path, tmp_path: Path) -> None:
    """Job arrays may have more jobs than there are members."""
    words = ["sweep", str(experiment), "--vary", "fracture.normal_strength=14,18kPa", "--part", "3/4"]
    said = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out"), "--no-map", "--workers", "0"])
    assert said.exit_code == 0, said.output


def test_the_command_refuses_in_one_sentence(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    for words, said in [
        (["a68a", "--vary", "fracture.normal_strength=24..14kPa:3"], "is not below"),
        (["a68a"], "nothing is varied"),
        ([], "no experiment is named"),
        (
            ["a68a", "--vary", "fracture.normal_strength=14,18kPa", "--workers", "-1"],
            "'-1' is not possible. Give a number from 0",
        ),
        (
            ["a68a", "--vary", "fracture.normal_strength=14,18kPa", "--numerics", "both"],
            "one kind of numerics is needed",
        ),
    ]:
        result = CliRunner().invoke(app, ["sweep", *words, "--output", out])
        assert result.exit_code == 2, words
        assert said in result.stderr
        assert "Traceback" not in result.stderr
    assert not Path(out).exists()


def test_many_fragments_are_listed_by_size() -> None:
    member, count = outcome(0, [-37.0] * 2, [-56.0] * 2), MOST_LISTED + 20
    first = {name: values[0] for name, values in member.fragments.items()}
    member.fragments.update({name: [value] * count for name, value in first.items()})
    member.fragments["number"] = [float(k + 1) for k in range(count)]
    member.fragments["parent"] = [0.0] + [1.0] * (count - 1)
    member.fragments["area"] = [float(k) for k in range(count)]
    area = forecast_of([member], 1)["fragment_area"].values[0]
    # The berg at the start stays, however small; of the others the largest.
    assert area.tolist() == [0.0, *range(21, count)]
    assert len(area) == MOST_LISTED


@pytest.mark.slow
def test_the_picture_is_drawn(alone: xr.Dataset, tmp_path: Path) -> None:
    for ending in ("png", "pdf", "svg"):
        assert draw_sweep(alone, tmp_path / f"sweep.{ending}").stat().st_size > 5000
    failed = alone.assign(status=("member", np.ones(3, dtype="i4")))
    with pytest.raises(InputError, match="no member of this sweep is done"):
        draw_sweep(failed, tmp_path / "none.png")


@pytest.mark.slow
def test_a_lost_worker_costs_time_and_nothing_else(alone: xr.Dataset, tmp_path: Path) -> None:
    """Two processes; one is killed in the middle of a member, which another one does again with the same digits."""
    vary = {"speed": SPEEDS, "folder": [str(tmp_path)]}
    result = sweep(dying, vary, days="6 h", every_hours=1, workers=2, output=tmp_path / "out")
    assert (tmp_path / "died").exists()
    assert same(result, alone)


def melting(west: float, folder: str = "") -> Model:
    """Return one of two parts of a population, whose process is killed once where a folder is named."""
    small = Iceberg.from_points(
        west + np.array([0.1, 0.9, 1.3]), [-56.1, -55.6, -56.2], thickness=120.0, radius=300.0, pieces=[0, 1, 2]
    )
    parameters = Parameters(melt={"enabled": True, "temperature": 3.0, "salinity": 34.0})
    model = Model(
        small,
        Forcing.uniform(current=(0.2, 0.1), wind=(8.0, 0.0), slope=(0.0, 0.0)),
        parameters,
        start="2020-12-31 18:00",
    )
    if folder and west == WESTS[1]:
        model.after_step.append(_killer(Path(folder)))
    return model


def _killer(folder: Path) -> Any:
    def die(now: Any) -> None:
        if now.step_number == 9 and not (folder / "died").exists():
            (folder / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)

    return die


WESTS = [-40.0, -38.5]


@pytest.fixture(scope="module")
def on_cells(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Fresh water of the parts of a population, computed in this process."""
    folder = tmp_path_factory.mktemp("parts")
    sweep(melting, {"west": WESTS, "folder": [""]}, days="12 h", workers=0, output=folder, cells=0.5)
    found = open_cells(folder)
    found.encoding["folder"] = str(folder)
    return found


@pytest.mark.slow
def test_parts_of_a_population_sum_up_to_the_whole(on_cells: xr.Dataset, tmp_path: Path) -> None:
    """The fresh water of each part, over its cells, is that of its bergs, by month and process."""
    assert on_cells.sizes["member"] == 2
    assert on_cells.sizes["time"] == 2  # December and January
    total = (on_cells["ficeberg_process"] * on_cells["areacello"]).sum(["lat", "lon", "process"])
    seconds = (on_cells["time_bnds"][:, 1] - on_cells["time_bnds"][:, 0]) / np.timedelta64(1, "s")
    for k, west in enumerate(WESTS):
        model = melting(west)
        before = model.elements.mass.sum()
        model.advance("12 h")
        given = float((total.isel(member=k) * seconds).sum())
        np.testing.assert_allclose(given, before - model.elements.mass.sum(), rtol=1e-9)
    whole = on_cells.sum("member")
    np.testing.assert_allclose(
        (whole["ficeberg"] * on_cells["areacello"]).sum(),
        float((on_cells["ficeberg"] * on_cells["areacello"]).sum()),
        rtol=1e-12,
    )


@pytest.mark.slow
def test_a_lost_part_of_a_population_is_done_again_with_the_same_fresh_water(
    on_cells: xr.Dataset, tmp_path: Path
) -> None:
    """A worker that is killed in the middle of a part."""
    (tmp_path / "out").mkdir()
    result = sweep(
        melting, {"west": WESTS, "folder": [str(tmp_path)]}, days="12 h", workers=1, output=tmp_path / "out", cells=0.5
    )
    assert (tmp_path / "died").exists()
    assert result["status"].values.tolist() == [0, 0]
    xr.testing.assert_identical(open_cells(tmp_path / "out"), on_cells)


def test_members_from_100000_on_keep_their_numbers_and_their_order(on_cells: xr.Dataset, tmp_path: Path) -> None:
    """Bug: of a number only five digits were read, and its file came before that of member 99999."""
    (tmp_path / "cells").mkdir()
    for k, number in enumerate((99999, 100000)):
        copy = tmp_path / "cells" / f"{number}-monthly.nc"
        shutil.copyfile(Path(on_cells.encoding["folder"]) / "cells" / f"{k:05d}-monthly.nc", copy)
    found = open_cells(tmp_path)
    assert found["member"].values.tolist() == [99999, 100000]
    assert found["ficeberg"].values == pytest.approx(on_cells["ficeberg"].values)


def test_cells_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    for cells, output, words in (
        (0.5, None, "need a folder"),
        (0.0, tmp_path, "0.01 to 10"),
        ("wide", tmp_path, "cells"),
    ):
        with pytest.raises(InputError, match=words):
            sweep(melting, {"west": WESTS}, days="1 h", every_hours=1, workers=0, output=output, cells=cells)
    with pytest.raises(InputError, match="holds no monthly files"):
        open_cells(tmp_path)
    sweep(melting, {"west": WESTS[:1]}, days="1 h", every_hours=1, workers=0, output=tmp_path / "b")
    for width, words in (
        (0.0099, "0.01 to 10"),
        (0.01, "holds a sweep"),
        (10.0, "holds a sweep"),
        (10.1, "0.01 to 10"),
    ):
        with pytest.raises(InputError, match=words):
            sweep(melting, {"west": WESTS}, days="1 h", every_hours=1, workers=0, output=tmp_path / "b", cells=width)


def test_a_failed_part_leaves_no_cells(tmp_path: Path) -> None:
    result = sweep(broken_off, {"west": WESTS}, days="3 h", every_hours=1, workers=0, output=tmp_path, cells=0.5)
    assert result["status"].values.tolist() == [0, 1]
    assert {path.name[:5] for path in (tmp_path / "cells").iterdir()} == {"00000"}


def broken_off(west: float) -> Model:
    """Return a part of a population that fails in its third step, the second one."""
    model = melting(west)

    def fail(now: Any) -> None:
        if now.step_number == 3 and west == WESTS[1]:
            raise RunError("this part cannot be")

    model.after_step.append(fail)
    return model


def test_members_run_on_the_workers_of_a_scheduler(alone: xr.Dataset) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        result = sweep(
            drifting, {"speed": SPEEDS}, days="6 h", every_hours=1, scheduler=cluster.scheduler_address, progress=True
        )
    assert same(result, alone)


@pytest.mark.slow
def test_a_script_without_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import riftberg\nriftberg.sweep('a68a', ['fracture.normal_strength=14,18kPa'], days=0.1, every_hours=1)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", "import multiprocessing as m; m.current_process()._inheriting = True; "
         f"exec(open({str(script)!r}).read())"], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert 'if __name__ == "__main__":' in done.stderr


@pytest.mark.slow
def test_the_command_runs_is_interrupted_and_goes_on(tmp_path: Path) -> None:
    """`riftberg sweep` of the collision on two processes; Ctrl-C after the first member, then --resume."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "riftberg", "sweep"]
    new = ["a68a", "--vary", "fracture.normal_strength=16..20kPa:6", "--days", "2", "--workers", "2", "-o", str(out)]
    running = subprocess.Popen([*command, *new], stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 600
    while not list((out / "members").glob("*.json")) and time.monotonic() < limit:
        time.sleep(0.2)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=120)
    assert running.returncode == 130
    assert f"riftberg sweep --resume {out}" in said
    before = len(list((out / "members").glob("*.json")))
    assert 1 <= before < 6
    subprocess.run([*command, "--resume", str(out)], check=True, timeout=600)
    result = open_sweep(out)
    assert (result["status"] == 0).all()
    assert (out / "sweep.png").stat().st_size > 20_000
    single = riftberg.experiments.build("a68a", Options({"fracture": {"normal_strength": 16e3}}))[0]  # type: ignore[attr-defined]
    tracks = single.run(days=2, every_hours=6).riftberg.tracks
    assert result["lon"].values[0, 0] == pytest.approx(tracks["lon"].values[: result.sizes["time"]], abs=1e-9)
    assert json.loads((out / "sweep.json").read_text())["days"] == 2.0


def test_stress_of_a_member_is_held_against_the_strength_that_damage_has_left() -> None:
    """Bug: bonds that damage had worn to four tenths were told by their whole strength, less than the tracks of the run say."""
    result = sweep(worn, {"damage": [0.0, 0.6]}, days="1 h", every_hours=1, workers=0)
    whole, less = result["stress_ratio"].values
    assert 0.0 < whole == pytest.approx(0.4 * less)


def worn(damage: float) -> Model:
    """Return a berg whose bonds are damaged, in a current that shears."""
    berg = Iceberg.rectangle("12 km", "6 km", thickness=200.0, placement=(-37.0, -56.0))
    berg.bonds.damage[:] = damage
    sea = Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)) + Forcing.eddy((-37.0, -55.9), radius=9e3, speed=0.5)
    return Model(berg, sea, Parameters(), start="2020-12-09")


def begun(start: str) -> Model:
    berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(0.3, 0.0), slope=(0.0, 0.0)), start=datetime.fromisoformat(start))


@pytest.mark.slow
def test_members_that_start_at_other_dates_have_their_own(tmp_path: Path) -> None:
    """Bug: all had the dates of member 0; member 1 lay 14 km beside its own rerun."""
    starts = ["2020-12-01 00:00:00", "2020-12-03 00:00:00"]
    ds = sweep(begun, {"start": starts}, days=3, every_hours=6, workers=0, output=tmp_path / "s")
    assert ds["start_after"].values.tolist() == [0.0, 2 * 86400.0]
    run = begun(starts[1]).run(days=3, every_hours=6)
    for later in (slice(None), slice(4, None)):  # also of a part of the tracks
        compared = run.riftberg.compare(ds.isel(member=1, time=later))
        assert compared["time"].values[-1] == np.datetime64("2020-12-06")
        assert compared["distance"].values == pytest.approx(0.0, abs=1.0)
    with pytest.raises(InputError, match="members that start at different dates"):
        berg_offsets(ds, datetime(2020, 12, 3), (-37.0, -56.0))
    east, north = berg_offsets(ds.isel(member=[1]), datetime(2020, 12, 3), (-37.0, -56.0))[0]
    assert (east, north) == pytest.approx((0.0, 0.0), abs=0.1)
    draw_sweep(ds, tmp_path / "s.png")
