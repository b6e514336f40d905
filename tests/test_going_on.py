"""A run that was killed goes on from the last state that was kept: its files become those of the run that never stopped."""

from __future__ import annotations

import gc
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from forked import COMMAND, Program
from riftberg.cli.main import app
from riftberg.runs.model import StateKeeper
from riftberg.runs.restart import load_state
from runs.test_resumed_file import contents

EXPERIMENTS = {
    "breaks": """\
start: 2020-12-30 20:00
days: 3
output_every_hours: 2
berg:
  rectangle: {length: 24 km, width: 9 km}
  placement: [-39.0, -55.5]
forcing:
  kind: formula
  uniform: {current: [0.1, 0.0], wind: [8.0, 3.0]}
  eddy:
    - {centre: [-39.4, -55.4], radius: 15 km, speed: 1.0, velocity: [0.2, 0.0]}
parameters:
  fracture: {normal_strength: 0.15 kPa, shear_strength: 0.15 kPa}
  drag: {water_base: 0.0012, air_top: 0.0055}
  stepping: {time_step: 1800 s}
""",
    "melts": """\
start: 2020-12-30 20:00
days: 3
output_every_hours: 5
berg:
  rectangle: {length: 9 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing: {uniform: {current: [0.3, 0.1], wind: [12.0, 5.0], slope: [0, 0]}}
parameters: {melt: {enabled: true, temperature: 2, salinity: 34}, stepping: {time_step: 1800 s}}
""",
}
"""Experiments, whose parts are asked for by name; the year and the month end within each."""

ASKED = {"breaks": ["--forces"], "melts": ["--cells", "1"]}


def command(folder: Path, name: str, *words: str) -> list[str]:
    (folder / f"{name}.yaml").write_text(EXPERIMENTS[name])
    return ["run", str(folder / f"{name}.yaml"), "--no-map", "-q", *ASKED[name], *words]


def ended(words: list[str]) -> str:
    """Run the command line in this process to its good end; return what it said on the error stream."""
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return result.stderr


class Wholes(dict[str, Path]):
    """Folder of each experiment's run that never stopped; it runs when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __missing__(self, name: str) -> Path:
        ended(command(self.folder, name, "-o", str(self.folder / name)))
        self[name] = self.folder / name
        return self[name]


@pytest.fixture(scope="module")
def wholes(tmp_path_factory: pytest.TempPathFactory) -> Wholes:
    return Wholes(tmp_path_factory.mktemp("wholes"))


class Cut(BaseException):
    """The machine is lost: nothing is tidied up."""


def lost(words: list[str], after: int) -> None:
    """Run the command line up to the state that is kept after so many steps, and a few steps more; then all is lost."""
    from riftberg import model

    record = StateKeeper.record

    def cut(self: StateKeeper, run: model.BareModel) -> None:
        record(self, run)
        if run.step_number >= after:
            raise Cut

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StateKeeper, "record", cut)
        patch.setattr(model, "finish_all", lambda *_: None)  # a killed process finishes nothing
        with pytest.raises(Cut):
            pytest.fail(CliRunner().invoke(app, words, catch_exceptions=False).output)
    gc.collect()  # as the end of the process does, it lets go of the file


@pytest.fixture(scope="module")
def lost_part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that breaks and was lost in its 71st step; tests copy it."""
    folder = tmp_path_factory.mktemp("lost")
    lost([*command(folder, "breaks", "--keep-days", "0.45"), "-o", str(folder / "part")], 70)
    return folder / "part"


def assert_same_files(whole: Path, other: Path) -> None:
    """All files of a run are those of another one: every variable bit for bit, every attribute but dates of writing."""
    assert sorted(p.name for p in whole.iterdir()) == sorted(p.name for p in other.iterdir())
    a, b = contents(whole / "run.nc"), contents(other / "run.nc")
    assert (a[1], a[2]) == (b[1], b[2])
    assert [name for name in a[0] if a[0][name].tobytes() != b[0][name].tobytes()] == []
    told = [json.loads((folder / "summary.json").read_text()) for folder in (whole, other)]
    for summary in told:
        del summary["wall_seconds"], summary["seconds_per_day"]
    assert told[0] == told[1]
    for file in sorted(whole.glob("bergs-*.nc")):
        with xr.open_dataset(file) as one, xr.open_dataset(other / file.name) as another:
            xr.testing.assert_identical(one, another)
    with (
        xr.open_dataset(whole / "run.nc", group="background") as one,
        xr.open_dataset(other / "run.nc", group="background") as another,
    ):
        xr.testing.assert_identical(one, another)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize(
    "after", [70, pytest.param(101, marks=pytest.mark.slow), pytest.param(49, marks=pytest.mark.slow)]
)
def test_a_lost_run_goes_on_without_a_gap(tmp_path: Path, wholes: dict[str, Path], name: str, after: int) -> None:
    """Records, forces, months and moments on cells, the daily track: all of the part before are there."""
    words = command(tmp_path, name, "--keep-days", "0.3")  # 15 long steps
    lost([*words, "-o", str(tmp_path / "part")], after)
    kept = sorted(path.name for path in (tmp_path / "part").glob("*.restart.nc"))
    assert kept == ["kept-1.restart.nc", "kept-2.restart.nc"]
    ended([*words, "--resume", str(tmp_path / "part")])
    assert_same_files(wholes[name], tmp_path / "part")
    with xr.open_dataset(wholes[name] / "run.nc") as run:
        steps = (run.fragment_birth_time.values[1:] - run.time.values[0]) / np.timedelta64(30, "m")
        # Later ones are of ice that pieces crush where they touch.
        assert np.floor(steps).tolist()[:2] == ([] if name == "melts" else [25, 32])


@pytest.mark.quick(1)
@pytest.mark.parametrize("damage", ["cut", "garbage", "of another run"])
def test_a_damaged_newest_state_gives_way_to_the_older(
    tmp_path: Path, wholes: dict[str, Path], lost_part: Path, damage: str
) -> None:
    words = command(tmp_path, "breaks", "--keep-days", "0.45")
    shutil.copytree(lost_part, tmp_path / "part")
    states = {load_state(path).time: path for path in (tmp_path / "part").glob("*.restart.nc")}
    newest = states[max(states)]
    if damage == "of another run":
        lost([*command(tmp_path, "melts", "--keep-days", "1.5"), "-o", str(tmp_path / "other")], 72)
        shutil.copyfile(tmp_path / "other" / "kept-1.restart.nc", newest)
    else:
        newest.write_bytes(newest.read_bytes()[:3000] if damage == "cut" else b"garbage")
    said = ended([*words, "--resume", str(tmp_path / "part")])
    assert f"Notice: {newest.name} is passed over" in said
    assert_same_files(wholes["breaks"], tmp_path / "part")


@pytest.mark.slow
def test_a_state_whose_records_are_missing_gives_way_to_an_older_one(
    tmp_path: Path, wholes: dict[str, Path], lost_part: Path
) -> None:
    """As after a disk that was full: the state of the end was saved, but the run file ends before it."""
    words = command(tmp_path, "breaks", "--keep-days", "0.45")
    shutil.copytree(lost_part, tmp_path / "part")
    lost([*words, "-o", str(tmp_path / "later")], 95)
    for path in (tmp_path / "later").glob("*.restart.nc"):
        shutil.copyfile(path, tmp_path / "part" / f"later-{path.name}")
    said = ended([*words, "--resume", str(tmp_path / "part")])
    assert "its records end before" in said
    for path in (tmp_path / "part").glob("later-*"):
        path.unlink()
    assert_same_files(wholes["breaks"], tmp_path / "part")


@pytest.mark.slow
def test_lost_again_and_again(tmp_path: Path, wholes: dict[str, Path]) -> None:
    words = command(tmp_path, "melts", "--keep-days", "0.3")
    lost([*words, "-o", str(tmp_path / "part")], 30)
    for after in (31, 62, 113):
        lost([*words, "--resume", str(tmp_path / "part")], after)
    ended([*words, "--resume", str(tmp_path / "part")])
    assert_same_files(wholes["melts"], tmp_path / "part")


@pytest.mark.slow
def test_what_was_interrupted_goes_on_in_its_folder_too(
    tmp_path: Path, wholes: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The record that an interrupt makes between two others does not stay."""
    from cli.test_run import _PressedInARealRun

    with monkeypatch.context() as patch:
        _PressedInARealRun(patch, 41)
        words = command(tmp_path, "breaks", "-o", str(tmp_path / "part"))
        assert CliRunner().invoke(app, words).exit_code == 130
    ended(command(tmp_path, "breaks", "--resume", str(tmp_path / "part")))
    (tmp_path / "part" / "interrupted.restart.nc").unlink()
    assert_same_files(wholes["breaks"], tmp_path / "part")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--every", "3"], "the run had no records every 3 h"),
        (["--set", "ice.density=900"], "keeps the parameters of its restart file"),
        (["-o", "elsewhere"], "goes on there"),
        (["--days", "0.5"], "already"),
    ],
)
def test_what_does_not_fit_the_run_is_refused(tmp_path: Path, lost_part: Path, words: list[str], said: str) -> None:
    shutil.copytree(lost_part, tmp_path / "part")
    before = {path.name: path.read_bytes() for path in (tmp_path / "part").iterdir()}
    result = CliRunner().invoke(app, command(tmp_path, "breaks", "--resume", str(tmp_path / "part"), *words))
    assert result.exit_code == 2
    assert said in result.stderr
    assert {path.name: path.read_bytes() for path in (tmp_path / "part").iterdir()} == before


@pytest.mark.slow
def test_another_run_into_the_folder_is_not_gone_on_with(tmp_path: Path) -> None:
    """States of an earlier run lie there; the run file is that of a run with other parameters."""
    words = command(tmp_path, "breaks", "-o", str(tmp_path / "part"))
    lost([*words, "--keep-days", "0.7"], 36)
    ended([*words, "--days", "0.9", "--set", "ice.density=900"])
    result = CliRunner().invoke(app, command(tmp_path, "breaks", "--resume", str(tmp_path / "part")))
    assert result.exit_code == 2
    assert "other parameters" in result.stderr


def test_short_runs_keep_nothing_and_an_empty_folder_says_so(tmp_path: Path) -> None:
    ended(command(tmp_path, "melts", "--days", "0.2", "-o", str(tmp_path / "out")))
    assert not list((tmp_path / "out").glob("*.restart.nc"))
    (tmp_path / "lost").mkdir()
    (tmp_path / "lost" / "run.nc").write_bytes((tmp_path / "out" / "run.nc").read_bytes())
    for folder, said in (
        (tmp_path / "out", "the run has come to its end, and left no state to go on from. For a longer run start anew"),
        (tmp_path / "lost", "lost: no state to go on from. Start the run anew"),
        (tmp_path, "no such file"),
    ):
        result = CliRunner().invoke(app, command(tmp_path, "melts", "--resume", str(folder)))
        assert result.exit_code == 2
        assert said in " ".join(result.stderr.split())


@pytest.mark.slow
def test_states_are_kept_by_the_clock_and_a_full_disk_is_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is kept for a bad day does not end a good one."""
    from riftberg import Model

    save, tried = Model.save, []

    def full(self: Model, path: Path) -> Path:
        tried.append(self.step_number)
        if len(tried) % 2:
            raise OSError(28, "No space left on device")
        return save(self, path)

    monkeypatch.setattr(Model, "save", full)
    said = ended(command(tmp_path, "melts", "--days", "0.2", "--keep-minutes", "1e-9", "-o", str(tmp_path / "out")))
    assert len(tried) >= 9
    assert said.count("the state cannot be kept (the disk is full)") == (len(tried) + 1) // 2
    assert not list((tmp_path / "out").glob("*.restart.nc"))  # nobody needs them after a good end


def killed(words: list[str], folder: Path, records: int, wait: float) -> None:
    """Start the command line and kill it some time after its run file has so many records."""
    process = Program(COMMAND, *words)
    end = time.monotonic() + 300.0
    while time.monotonic() < end and not (folder / "kept-2.restart.nc").exists() and process.wait(0.01) is None:
        pass
    time.sleep(wait)
    process.kill()


WAITS = [0.2, *(pytest.param(0.03 * k, marks=pytest.mark.slow) for k in range(30))]


@pytest.mark.parametrize("wait", WAITS)
def test_kill_9(tmp_path: Path, wholes: dict[str, Path], wait: float) -> None:
    """In a process of its own, at any moment: in the step, in the flush, in the state that is kept (30 of them: ``-m slow``)."""
    whole, long = wholes["breaks"], list[str]()
    if wait > 0.2:  # it would be through by then
        whole, long = tmp_path / "whole", ["--days", "12"]
        ended(command(tmp_path, "breaks", *long, "-o", str(whole)))
    words = command(tmp_path, "breaks", *long, "--keep-days", "0.25")
    killed([*words, "-o", str(tmp_path / "part")], tmp_path / "part", 4, wait)
    if (tmp_path / "part" / "summary.json").exists():
        pytest.skip("it was through before it was killed")
    ended([*words, "--resume", str(tmp_path / "part")])
    for left in (tmp_path / "part").glob(".*"):
        left.unlink()
    assert_same_files(whole, tmp_path / "part")


@pytest.mark.slow
def test_steps_between_two_kept_states_are_those_asked_for(tmp_path: Path) -> None:
    lost(command(tmp_path, "breaks", "--keep-days", "0.5", "-o", str(tmp_path / "part")), 80)
    times = sorted(load_state(path).time / 86400.0 for path in (tmp_path / "part").glob("*.restart.nc"))
    np.testing.assert_allclose(np.diff(times), [0.5])
    assert os.path.exists(tmp_path / "part" / "run.nc")
