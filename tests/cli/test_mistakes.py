"""Mistakes at the terminal that ended in a traceback once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import Options, draw_map, open_run
from riftberg.cli.main import app
from riftberg.experiments import Info
from riftberg.runs.run_file import RunWriter


def call(*arguments: object) -> Any:
    """Run the command line."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize("command", ["plot", "replay", "why"])
def test_a_file_that_is_no_run_is_told_as_such(command: str, tmp_path: Path) -> None:
    (tmp_path / "notes.nc").write_text("not a run")
    result = call(command, tmp_path / "notes.nc")
    assert result.exit_code == 2
    assert "not a NetCDF file" in result.stderr
    assert "notes.nc" in result.stderr


def test_a_folder_that_cannot_be_made_is_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riftberg.experiments.build", lambda name, options=None: (FakeModel(), Info("fake", days=1.0)))
    (tmp_path / "file").write_text("")
    result = call("run", "fake", "--output", tmp_path / "file" / "out", "-q")
    assert result.exit_code == 2
    assert str(tmp_path / "file") in result.stderr


@pytest.mark.slow
def test_a_berg_that_shatters_still_has_its_map(tmp_path: Path) -> None:
    """All bonds break when a strength is given in the wrong unit; no fragment is large enough to be named then."""
    model = FakeModel(30, 4)
    writer = RunWriter(tmp_path / "run.nc", every_hours=1.0)
    writer.start(model)
    model.step()
    model.elements.berg[:] = range(1, 1 + model.elements.berg.size)
    for _ in range(5):
        model.step()
        writer.record(model)
    writer.finish(model)
    with open_run(tmp_path) as run:
        draw_map(run, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000


@pytest.mark.slow
def test_controls_run_the_experiment_that_the_run_keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, Options]] = []

    def build(name: str, options: Options | None = None) -> tuple[FakeModel, Info]:
        assert options is not None
        asked.append((Path(name).read_text(), options))
        return FakeModel(), Info("my-berg")

    FakeModel().advance(2, recorders=[RunWriter(tmp_path / "bare" / "run.nc", every_hours=3, experiment="my-berg")])
    result = call("why", tmp_path / "bare", "--controls", "--no-figure", "-q")
    assert result.exit_code == 2
    assert "keeps no experiment" in result.stderr
    kept = {"command": "riftberg run berg.yaml", "experiment_file": "name: my-berg\n"}
    FakeModel().advance(2, recorders=[RunWriter(tmp_path / "run.nc", every_hours=3, experiment="my-berg", origin=kept)])
    monkeypatch.setattr("riftberg.experiments.build", build)
    result = call("why", tmp_path, "--controls", "--no-figure", "-q")
    assert result.exit_code == 0, result.output
    assert [(text, o.changes["stepping"]["time_step"]) for text, o in asked] == [("name: my-berg\n", 900.0)]
    assert "With half the long step it still breaks off" in " ".join(result.output.split())
