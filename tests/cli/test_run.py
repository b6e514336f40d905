"""``riftberg run`` from the outside: files, messages, exit codes."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import Options, build
from riftberg.cli.main import app
from riftberg.compiled import kernels
from riftberg.errors import ForcingError, InputError
from riftberg.experiments import Info
from riftberg.runs.restart import load_state


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that runs the command line in an empty folder, with the experiment ``fake``."""
    model = FakeModel()
    asked: list[Options] = []

    def build(name: str, options: Options | None = None) -> tuple[FakeModel, Info]:
        asked.append(options or Options())
        return model, Info("fake", title="A fake berg", days=2.0, output_every_hours=6.0)

    monkeypatch.setattr("riftberg.experiments.build", build)
    monkeypatch.setattr(kernels, "is_warm", lambda: True)
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> Any:
        return CliRunner().invoke(app, list(arguments))

    call.model, call.asked = model, asked  # type: ignore[attr-defined]
    return call


def test_a_run_writes_its_files_and_says_what_happened(invoke: Any) -> None:
    result = invoke("run", "fake")
    assert result.exit_code == 0, result.output
    folder = Path("riftberg-out/fake")
    assert sorted(path.name for path in folder.iterdir()) == ["map.png", "run.nc", "summary.json"]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["days"], summary["fragments"], summary["experiment"]) == (2.0, 2, "fake")
    assert len(summary["track"]) == 3
    with xr.open_dataset(folder / "run.nc") as ds:
        assert ds.sizes["time"] == 9
    assert "3 of 37 bonds broken" in result.output
    assert "54 km2 broke off aground (3 bonds)" in result.output
    assert "the berg drifted 31.9 km east to 55.020 S, 38.501 W, in 2 pieces (162, 54 km2)" in result.output


def test_places_are_told_between_180_west_and_east(invoke: Any) -> None:
    """Grids of the reference count longitudes to 360."""
    invoke.model.__init__(lon=321.0)
    assert re.search(
        r"broke off aground \(3 bonds\) at 55\.0\d+ S, 38\.\d+ W\n", invoke("run", "fake", "--no-map").output
    )


def test_options_reach_the_experiment(invoke: Any) -> None:
    result = invoke("run", "fake", "--days", "0.5", "--every", "1", "--set", "stepping.time_step=15 min",
                    "--without", "shoal", "--numerics", "reference", "-o", "here", "--no-map", "-q")  # fmt: skip
    assert result.exit_code == 0, result.output
    options = invoke.asked[0]
    assert options.changes == {"stepping": {"time_step": 900.0}}
    assert (options.days, options.without, options.numerics) == (0.5, frozenset({"shoal"}), "reference")
    assert sorted(path.name for path in Path("here").iterdir()) == ["run.nc", "summary.json"]
    assert xr.open_dataset("here/run.nc").sizes["time"] == 13
    assert result.stderr == ""


def test_an_earlier_run_is_not_overwritten_by_default(invoke: Any) -> None:
    invoke("run", "fake", "--no-map", "--days", "0.1")
    invoke.model.__init__()
    invoke("run", "fake", "--no-map", "--days", "0.1")
    assert Path("riftberg-out/fake/run.nc").exists()
    assert Path("riftberg-out/fake-2/run.nc").exists()


def test_progress_in_a_log_names_date_speed_fragments_and_bonds(invoke: Any) -> None:
    result = invoke("run", "fake", "--no-map")
    last = result.stderr.strip().splitlines()[-1]
    assert re.search(r"100\.0 %  2020-12-11 13:00  [\d.e-]+ s per day  2 fragments  3 bonds broken", last)


def test_compilation_is_announced_where_it_is_due(invoke: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "compiling" not in invoke("run", "fake", "--no-map", "--days", "0.1").stderr
    invoke.model.__init__()
    monkeypatch.setattr(kernels, "is_warm", lambda: False)
    assert "compiling takes three to four minutes" in invoke("run", "fake", "--no-map", "--days", "0.1").stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "fracture.normal_strength=2 kg"), "measured in Pa"),
        (("--numerics", "other"), "Use own or reference"),
        (("--days", "-1"), "Give a number above 0"),
        (("--data", "nowhere"), "no such folder"),
    ],
)
def test_mistakes_are_one_message_and_code_2(invoke: Any, arguments: tuple[str, ...], message: str) -> None:
    result = invoke("run", "fake", *arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith("Error: ")
    assert message in result.stderr
    assert "Traceback" not in result.output
    assert not Path("riftberg-out").exists()


def test_a_failure_saves_the_state_and_says_how_to_go_on(invoke: Any) -> None:
    invoke.model.fail_at = 86_400.0
    result = invoke("run", "fake")
    assert result.exit_code == 2
    assert "failed at 2020-12-10 13:00 (day 1.00): the contact iteration does not converge" in result.stderr
    assert "riftberg run fake --resume riftberg-out/fake/failed.restart.nc" in result.stderr
    assert load_state("riftberg-out/fake/failed.restart.nc").time == 86_400.0
    assert xr.open_dataset("riftberg-out/fake/run.nc").sizes["time"] == 5


def test_going_on_names_the_options_that_the_forcing_depends_on(invoke: Any) -> None:
    invoke.model.fail_at = 3600.0
    Path("my data").mkdir()
    result = invoke("run", "fake", "--without", "shoal", "--numerics", "own", "--data", "my data", "--no-map")
    asked = (
        "riftberg run fake --without shoal --numerics own --data 'my data' --no-map "
        "--resume riftberg-out/fake/failed.restart.nc"
    )
    assert asked in result.stderr


def test_an_unexpected_failure_saves_the_state_too(invoke: Any) -> None:
    invoke.model.fail_at, invoke.model.failure = 3600.0, ZeroDivisionError("oops")
    result = invoke("run", "fake")
    assert isinstance(result.exception, ZeroDivisionError)
    assert Path("riftberg-out/fake/failed.restart.nc").exists()


def test_a_run_that_is_refused_before_its_first_step_saves_nothing(invoke: Any) -> None:
    invoke.model.fail_at, invoke.model.failure = 0.0, ForcingError("no wind after 10 Dec")
    result = invoke("run", "fake")
    assert result.exit_code == 2
    assert "Error: no wind after 10 Dec" in result.stderr
    assert not list(Path().rglob("*.restart.nc"))


class _Pressed:
    """Stands in for a person who presses Ctrl-C during step ``when``."""

    def __init__(self, model: FakeModel, when: int) -> None:
        self.step, self.model, self.when = model.step, model, when

    def __call__(self) -> None:
        """Step, and be interrupted."""
        self.step()
        if self.model.step_number == self.when:
            os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupt_finishes_the_files(invoke: Any) -> None:
    invoke.model.step = _Pressed(invoke.model, 5)
    before = signal.getsignal(signal.SIGINT)
    result = invoke("run", "fake")
    assert result.exit_code == 130
    assert "Interrupted at 2020-12-09 15:30 (day 0.10)" in result.stderr
    assert "--resume riftberg-out/fake/interrupted.restart.nc" in result.stderr
    assert str(xr.open_dataset("riftberg-out/fake/run.nc").time.values[-1])[:16] == "2020-12-09T15:30"
    assert load_state("riftberg-out/fake/interrupted.restart.nc").step_number == 5
    assert json.loads(Path("riftberg-out/fake/summary.json").read_text())["steps"] == 5
    assert signal.getsignal(signal.SIGINT) is before


def test_settings_and_resume_exclude_each_other(invoke: Any) -> None:
    result = invoke("run", "fake", "--resume", "x.nc", "--set", "ice.density=900")
    assert result.exit_code == 2
    assert "keeps the parameters of its restart file" in result.stderr


def test_a_finished_run_cannot_be_resumed_for_nothing(invoke: Any) -> None:
    invoke.model.time = 3 * 86_400.0
    result = invoke("run", "fake")
    assert result.exit_code == 2
    assert "already 3 days old" in result.stderr


def test_experiments_are_listed() -> None:
    result = CliRunner().invoke(app, ["experiments"])
    listed = [line.split()[0] for line in result.output.splitlines()]
    with pytest.raises(InputError, match=f"Built in are {', '.join(listed)};"):
        build("nothing")
    assert "--without shoal | shear" in result.output


@pytest.mark.slow
def test_a_yaml_experiment_runs_for_real(tmp_path: Path) -> None:
    (tmp_path / "slab.yaml").write_text(
        "start: 2020-12-09\ndays: 0.25\n"
        "berg:\n  rectangle: {length: 12 km, width: 6 km}\n  placement: [-39, -55]\n"
        "forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}\n"
    )
    result = CliRunner().invoke(app, ["run", str(tmp_path / "slab.yaml"), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "slab: 6 h, 8 elements, 0 of 10 bonds broken" in result.output
    assert "Berg: 8 elements, 72 km2 in 1 piece at 55.000 S, 39.000 W\n" in result.output
    assert (tmp_path / "out" / "map.png").stat().st_size > 20_000


@pytest.mark.slow
def test_resumed_run_ends_like_the_run_that_never_stopped(tmp_path: Path) -> None:
    (tmp_path / "slab.yaml").write_text(
        "start: 2020-12-09\ndays: 0.25\n"
        "berg:\n  rectangle: {length: 12 km, width: 6 km}\n  placement: [-39, -55]\n"
        "forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}\n"
    )
    from riftberg import build

    half, _ = build(str(tmp_path / "slab.yaml"))
    half.advance(0.125)
    half.save(tmp_path / "half.restart.nc")
    common = ["run", str(tmp_path / "slab.yaml"), "--no-map", "-q"]
    assert CliRunner().invoke(app, [*common, "-o", str(tmp_path / "whole")]).exit_code == 0
    resumed = [*common, "--resume", str(tmp_path / "half.restart.nc"), "-o", str(tmp_path / "rest")]
    result = CliRunner().invoke(app, resumed)
    assert result.exit_code == 0, result.output
    with xr.open_dataset(tmp_path / "whole/run.nc") as whole, xr.open_dataset(tmp_path / "rest/run.nc") as rest:
        assert rest.time.values[0] == whole.time.values[3]
        assert (whole.lon[:, -1].values == rest.lon[:, -1].values).all()
        assert (whole.lat[:, -1].values == rest.lat[:, -1].values).all()


class _PressedInARealRun:
    """Presses Ctrl-C in a step of a run from the command line."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, when: int) -> None:
        from riftberg.runs.tracks import DailyTrack

        record, self.when = DailyTrack.record, when

        def pressing(track: Any, model: Any) -> None:
            record(track, model)
            if model.step_number == self.when:
                self.when = -1
                os.kill(os.getpid(), signal.SIGINT)

        monkeypatch.setattr(DailyTrack, "record", pressing)


@pytest.mark.quick(1)
@pytest.mark.parametrize("stop", [1, 3])
def test_the_command_that_is_printed_goes_on_with_all_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop: int
) -> None:
    """Followed to the letter it gives the records of the run that never stopped, with the same bits."""
    from runs.test_resumed_file import assert_goes_on

    (tmp_path / "a slab.yaml").write_text(
        "start: 2020-12-09\ndays: 9\noutput_every_hours: 7\n"
        "berg:\n  rectangle: {length: 9 km, width: 6 km}\n  placement: [-39, -55]\n"
        "forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}\n"
    )
    given = ["run", str(tmp_path / "a slab.yaml"), "--days", "0.15", "--every", "1", "--forces", "--no-map", "--quiet"]
    given += ["--set", "ice.density=870", "--set", "stepping.substeps=80", "--allow-large"]
    whole = CliRunner().invoke(app, [*given, "-o", str(tmp_path / "whole")])
    assert whole.exit_code == 0, whole.output
    _PressedInARealRun(monkeypatch, stop)
    stopped = CliRunner().invoke(app, [*given, "-o", str(tmp_path / "part")])
    assert stopped.exit_code == 130, stopped.output
    told = re.search(r"Go on with: riftberg (.*)", stopped.stderr)
    assert told is not None, stopped.stderr
    words = shlex.split(told[1])
    for option in ("--days", "--every", "--forces", "--no-map", "--quiet", "--allow-large"):
        assert option in words
    rest = CliRunner().invoke(app, words)
    assert rest.exit_code == 0, rest.output
    folder = Path(words[words.index("--output") + 1])
    assert_goes_on(tmp_path / "whole/run.nc", folder / "run.nc", first=1800.0 * stop)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "fake", "-o", ""], "Nothing stands after '-o'"),
        (["plot", "", "--kind", "map"], "Nothing stands after 'plot'"),
        (["score", "run.nc", "seen.csv", "--output", ""], "Nothing stands after '--output'"),
        ([""], "An empty word"),
    ],
)
def test_an_empty_word_is_no_folder(words: list[str], said: str) -> None:
    """Bug once: results went into the folder at hand where a script had not set its variable."""
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert said in result.stderr


def test_help_appears_at_once() -> None:
    code = (
        "import sys, riftberg.cli.main; "
        "print([m for m in ('numpy', 'numba', 'xarray', 'matplotlib', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    times = []
    for _ in range(3):  # time of the processor, not of the clock: other work on the machine does not count
        before = os.times()
        subprocess.run([sys.executable, "-m", "riftberg.cli.main", "--help"], capture_output=True, check=True)
        after = os.times()
        times.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert min(times) < 1.0  # 0.3 s
