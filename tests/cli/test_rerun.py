"""``riftberg rerun``: a run again from what its own file keeps, wherever the experiment file is by then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import build, open_run, open_sweep, sweep
from riftberg.cli.main import app
from riftberg.ensembles.uncertain import with_errors

YAML = """start: 2020-12-09
days: 0.25
forcing: {uniform: {current: [0.3, 0.1], slope: [0, 0]}}
berg: {outline: {file: shape.csv}, thickness: 200 m, name: X1}
"""
SHAPE = "lon,lat\n-39.1,-55.05\n-38.9,-55.05\n-38.9,-54.95\n-39.1,-54.95\n"


def call(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run whose experiment file reads an outline beside it, from another folder."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "it.yaml").write_text(YAML)
    (tmp_path / "here" / "shape.csv").write_text(SHAPE)
    monkeypatch.chdir(tmp_path)
    result = call("run", "here/it.yaml", "-o", "a", "-q", "--no-map", "--set", "ice.density=820")
    assert result.exit_code == 0, result.output
    return tmp_path


def test_a_run_is_repeated_with_the_same_digits_and_with_changes(first: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (first / "here" / "it.yaml").write_text("days: 99")  # what the run was made from is in its file
    monkeypatch.chdir(first / "here")
    for folder, more in (("same", ()), ("other", ("--set", "ice.density=800", "--days", "0.125"))):
        result = call("rerun", "../a", "-o", folder, "-q", "--no-map", *more)
        assert result.exit_code == 0, result.output
        assert not (Path(folder) / "it.yaml").exists()  # it would lack the changes; the run file keeps both
    with open_run("../a") as a, open_run("same") as same, open_run("other") as other:
        np.testing.assert_array_equal(same["lon"], a["lon"])
        assert same.attrs["parameters_json"] == a.attrs["parameters_json"]
        assert '"density":800.0' in other.attrs["parameters_json"]
        assert other["time"].values[-1] - other["time"].values[0] == np.timedelta64(3, "h")
    # A rerun of a rerun has the changes of both.
    monkeypatch.chdir(first)
    result = call("rerun", "here/other", "-o", "third", "-q", "--no-map", "--set", "bonds.poisson=0.3")
    assert result.exit_code == 0, result.output
    with open_run("third") as third:
        assert '"density":800.0' in third.attrs["parameters_json"]
        assert third.attrs["command"].endswith(
            "--days 0.125 --set ice.density=820 --set stepping.time_step=3600 --set ice.density=800 --set bonds.poisson=0.3"
        )
        assert third.sizes["time"] == 4


def test_a_rerun_takes_the_time_step_of_the_first_run(first: Path) -> None:
    """A berg of 12 km takes steps of an hour, and one of 6 km half of it, but not as a change of the first."""
    (first / "large.yaml").write_text(
        YAML.replace("{file: shape.csv}, thickness", "{file: here/shape.csv}, thickness").replace(
            "outline: {file: here/shape.csv}", "rectangle: {length: 12 km, width: 6 km}, placement: [-39, -55]"
        )
    )
    assert call("run", "large.yaml", "-o", "large", "--no-map", "-v").exit_code == 0
    for folder, more, step in (
        ("smaller", ("--set", "berg.rectangle.length=6 km"), 3600.0),
        ("denser", ("--every", "0.75"), 2700.0),  # which an hour does not divide
        ("asked", ("--set", "stepping.time_step=900"), 900.0),
    ):
        result = call("rerun", "large", "-o", folder, "--no-map", *more)
        assert result.exit_code == 0, result.output
        assert "riftberg.model" not in result.output  # the log was asked for the first run alone
        with open_run(folder) as run:
            assert f'"time_step":{step}' in run.attrs["parameters_json"]


def test_a_rerun_is_checked_bit_by_bit(first: Path) -> None:
    same = call("rerun", "a", "-o", "same", "-q", "--no-map", "--check")
    assert (same.exit_code, same.stdout.splitlines()[-1]) == (0, "The same bits in all 7 records")
    other = call(
        "rerun", "a", "-o", "other", "-q", "--no-map", "--check", "--days", "0.125", "--set", "drag.air_top=0.0016"
    )
    assert other.exit_code == 1
    assert other.stdout.splitlines()[-1] == "Other bits from 2020-12-09 01:00 on, record 2 of 4"
    with open_run("a") as run:
        run.drop_vars("state_digest").to_netcdf("old.nc")
    refused = call("rerun", "old.nc", "-o", "third", "--check")
    assert refused.exit_code == 2
    assert "keeps no digest of its state" in refused.output


def test_a_refused_rerun_leaves_nothing_behind(first: Path) -> None:
    result = call("rerun", "a", "-o", "b", "-q", "--set", "ice.densty=1")
    assert result.exit_code == 2
    assert "Did you mean 'density'?" in result.output
    assert not Path("b").exists()


@pytest.mark.slow
def test_a_run_that_was_resumed_keeps_what_it_was_made_from(first: Path) -> None:
    """A state of other parameters than those of the experiment file has its own."""
    model, _ = build("here/it.yaml")
    state = model.save("it.restart.nc")
    assert call("run", "here/it.yaml", "--resume", str(state), "-o", "r", "-q", "--no-map").exit_code == 0
    with open_run("r") as run:
        assert run.attrs["command"] == "riftberg run it.yaml"
    (first / "here" / "other.yaml").write_text(YAML + "parameters: {ice: {density: 900}}\n")
    assert call("run", "here/other.yaml", "--resume", str(state), "-o", "s", "-q", "--no-map").exit_code == 0
    with open_run("s") as run:
        assert run.attrs["command"] == "riftberg run other.yaml --set ice.density=850"
    assert call("rerun", "s", "-o", "t", "-q", "--no-map").exit_code == 0
    with open_run("s") as one, open_run("t") as other:
        assert one.attrs["parameters_json"] == other.attrs["parameters_json"]


@pytest.fixture
def swept(first: Path) -> Path:
    """A sweep over a parameter, a key of the file, the start and a random error, with a parameter set for all members."""
    vary = (
        "bonds.poisson=0.25,0.3",
        "forcing.current=[0.2, 0.1],[0.3, 0.1]",
        "start.turn=20",
        "current_error.speed=0.1",
    )
    told = [part for name in vary for part in ("--vary", name)]
    result = call("sweep", "here/it.yaml", *told, "--members", "1", "--set", "ice.density=820", "--every", "1", "-o", "all",
                  "-q", "--no-map", "--workers", "0")  # fmt: skip
    assert result.exit_code == 0, result.output
    return first


@pytest.mark.slow
def test_a_member_of_a_sweep_is_run_by_itself(swept: Path) -> None:
    (swept / "here" / "it.yaml").write_text("days: 99")  # what the sweep was made from is in its file
    result = call("rerun", "all/sweep.nc#1", "-o", "two", "-q", "--no-map")
    assert result.exit_code == 0, result.output
    member = open_sweep("all").sel(member=1)
    with xr.open_dataset("two/run.nc", group="tracks") as tracks:
        first = slice(int(tracks["rowsize"][0]))
        for name in ("lon", "lat"):
            np.testing.assert_allclose(tracks[name][first], member[name].isel(fragment=0), rtol=0.0, atol=1e-9)
    with open_run("two") as run:
        for said in ("bonds.poisson=0.25", "'forcing.current=[0.3, 0.1]'", "start.turn=20", "current_error.speed=0.1"):
            assert f"--set {said}" in run.attrs["command"]
    # A rerun of that, half a turn further on.
    result = call("rerun", "two", "-o", "three", "-q", "--no-map", "--set", "start.turn=200")
    assert result.exit_code == 0, result.output
    with open_run("two") as two, open_run("three") as three:
        middle = [float(run["lon"].isel(time=0).mean()) for run in (two, three)]
        assert middle[0] == pytest.approx(middle[1], abs=1e-4)
        assert float(abs(two["lon"] - three["lon"]).isel(time=0).max()) > 0.01


@pytest.mark.slow
def test_a_member_that_is_not_there_and_a_sweep_that_keeps_nothing_are_refused(swept: Path) -> None:
    result = call("rerun", "all/sweep.nc#9", "-o", "b", "-q")
    assert result.exit_code == 2
    assert "no member 9" in result.output
    for number in ("-1", "x"):
        for words in (["rerun", f"all/sweep.nc#{number}"], ["compare", f"all/sweep.nc#{number}", "all/sweep.nc#0"]):
            result = call(*words)
            assert result.exit_code == 2
            assert f"no member {number}. They are counted from 0" in " ".join(result.output.split())
    sweep(lambda **_: build("a68a")[0], {"errors.seed": [1]}, days=0.001, workers=0, output="own")
    result = call("rerun", "own/sweep.nc#0", "-o", "b", "-q")
    assert result.exit_code == 2
    assert "keeps no experiment" in result.output
    assert not Path("b").exists()


@pytest.mark.slow
def test_a_run_with_errors_goes_on_with_them(first: Path) -> None:
    """The restart knows the state; that the sea has errors, the command line must say again."""
    (first / "here" / "it.yaml").write_text(YAML)
    told = ("--set", "current_error.speed=0.3", "--set", "start.north=2 km")
    assert call("run", "here/it.yaml", "-o", "whole", "-q", "--no-map", *told).exit_code == 0
    model, _ = build("here/it.yaml")
    half = with_errors(model, {"current_error.speed": 0.3, "start.north": 2000.0})
    half.advance(0.125)
    state = half.save("half.restart.nc")
    assert call("run", "here/it.yaml", "-o", "rest", "-q", "--no-map", "--resume", str(state), *told).exit_code == 0
    with open_run("whole") as whole, open_run("rest") as rest:
        np.testing.assert_array_equal(rest["lon"].isel(time=-1), whole["lon"].isel(time=-1))
    refused = call("run", "here/it.yaml", "-o", "odd", "-q", "--no-map", "--resume", str(state))
    assert refused.exit_code == 2, refused.output


def test_a_run_is_not_repeated_into_itself(first: Path) -> None:
    """Bug: the run that others are compared with was lost."""
    before = (first / "a" / "run.nc").read_bytes()
    done = call("rerun", "a", "--days", "0.5", "-o", str(first / "here" / ".." / "a"))
    assert done.exit_code == 2
    assert "the run that is repeated would be lost. Name another folder" in done.output
    assert (first / "a" / "run.nc").read_bytes() == before


def test_a_rerun_leaves_the_experiment_files_of_others_alone(first: Path) -> None:
    """Bug: an edited file of the same name in the folder of the results was written over, or removed."""
    (first / "b").mkdir()
    other = first / "b" / "it.yaml"
    other.write_text("# edited\n" + YAML)
    done = call("rerun", "a", "-o", "b", "--days", "0.1")
    assert done.exit_code == 2
    assert "it.yaml: another experiment has this file. Name another folder by --output" in done.output
    assert other.read_text() == "# edited\n" + YAML
    other.write_text(YAML)  # the same one may stand there, and stays where the run is refused
    assert call("rerun", "a", "-o", "b", "--days", "-1").exit_code == 2
    assert other.read_text() == YAML
