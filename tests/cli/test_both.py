"""``riftberg run --numerics both``, ``riftberg run --fetch`` and ``riftberg compare``, on the published run's stand-ins."""

from __future__ import annotations

import functools
import hashlib
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from experiments.paper_files import stand_ins
from fetching.serving import Shelf, serving
from riftberg import Options, experiments
from riftberg.cli.main import app
from riftberg.fetching import fetch

BERG = "icebergs.res.nc"
GRID = "a68_experiment_ll_p125_grid.nc"

BOX = np.s_[18:38, 8:40]
"""Cells around the berg's first day."""


def call(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture(scope="module")
def files(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("both") / "files"
    return stand_ins(shared / "reference" / "a68_story", folder, days=1.0, box=BOX)


@pytest.fixture(scope="module")
def kept(files: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folder of a run of each numerics."""
    folder = tmp_path_factory.mktemp("kept")
    for numerics in ("reference", "own"):
        words = ("--days", "0.1", "-q", "--no-map", "--numerics", numerics, "-o", str(folder / numerics))
        assert call("run", "a68a-paper", "--data", str(files), *words).exit_code == 0
    return {numerics: folder / numerics for numerics in ("reference", "own")}


def test_both_numerics_side_by_side_in_one_command(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = call("run", "a68a-paper", "--data", str(files), "--days", "0.1", "--numerics", "both", "-q")
    assert result.exit_code == 0, result.output
    folder = Path("riftberg-out/a68a-paper-both")
    assert sorted(path.name for path in folder.iterdir()) == ["comparison.json", "own", "reference", "tracks.png"]
    found = json.loads((folder / "comparison.json").read_text())
    assert found["columns"] == ["", "published", "observed", "reference", "own"]
    reference, own = (
        json.loads((folder / name / "summary.json").read_text())["numerics"] for name in ("reference", "own")
    )
    assert reference["bonds"]["objective_damping"] is False
    assert own["stepping"]["scheme"] == "quasi_static"
    assert [run["days"][0]["time"] for run in found["runs"]] == ["2020-12-09T13:00:00"] * 2
    for words in ("around 17 Dec, aground", "0 of 874 = 0.0 %", "2020-12-09 13:00", "km off"):
        assert words in result.output
    assert (folder / "tracks.png").stat().st_size > 5000
    assert call("run", "a68a-paper", "--data", str(files), "--days", "0.05", "--numerics", "both", "-q",
                "--no-map").exit_code == 0  # fmt: skip
    assert Path("riftberg-out/a68a-paper-both-2/comparison.json").exists()


def test_two_runs_do_not_go_on_from_one_state(files: Path) -> None:
    result = call("run", "a68a-paper", "--data", str(files), "--numerics", "both", "--resume", "x.nc")
    assert result.exit_code == 2
    assert "two runs cannot go on from one state" in result.stderr


@pytest.mark.slow
def test_runs_that_are_there_are_compared(
    kept: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, numerics in (("a", "reference"), ("b", "own")):
        Path(name).symlink_to(kept[numerics])
    result = call("compare", "a", "b/run.nc", "-o", "here")
    assert result.exit_code == 0, result.output
    assert [path.name for path in Path("here").iterdir()] == ["comparison.json", "tracks.png"]  # no maps
    assert json.loads((tmp_path / "here" / "comparison.json").read_text())["columns"][-2:] == ["a", "b"]
    Path("seen.csv").write_text("date,lat,lon\n2020-12-09,-55.0,-39.0\n")
    told = json.loads(call("compare", "a", "--observed", "seen.csv", "--json").output)
    assert told["runs"][0]["days"][0]["azimuth_difference"] is None
    # Bug: positions of another year were passed over without a word.
    Path("late.csv").write_text("date,lat,lon\n2021-12-09,-55.0,-39.0\n")
    late = call("compare", "a", "--observed", "late.csv")
    assert late.exit_code == 2
    assert "--observed late.csv: no position during the runs. They go from 2020-12-09" in late.stderr
    nothing = call("compare", "a", "nowhere")
    assert nothing.exit_code == 2
    assert "no run.nc" in nothing.stderr


@pytest.mark.slow
def test_controls_keep_the_numerics_and_the_files_of_the_run(
    files: Path, kept: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sea level of a control must be read as that of the run was."""
    asked: list[Options] = []
    true_build = experiments.build

    def build(name: str, options: Options) -> Any:
        asked.append(options)
        return true_build(name, options)

    monkeypatch.setattr(experiments, "build", build)
    for folder in kept.values():
        result = call("why", str(folder), "--controls", "--data", str(files), "-q", "--no-figure")
        assert result.exit_code == 0, result.output + result.stderr
    assert [options.numerics for options in asked] == ["reference"] * 2 + ["own"] * 2
    assert [options.without for options in asked] == [frozenset({"shoal"}), frozenset()] * 2


# ---- fetched first ---------------------------------------------------------------------------------------------------


@pytest.fixture
def shelf() -> Shelf:
    pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")
    return Shelf()


@pytest.fixture
def source(shelf: Shelf, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shelf]:
    """Serve the stand-ins as the repository does: small files with checksums, hourly fields in parts."""
    small = {}
    for name in (f"tests/a68/INPUT/{BERG}", f"tests/a68/data/{GRID}"):
        content = (files / Path(name).name).read_bytes()
        shelf.files[f"/{name}"], small[name] = content, hashlib.sha256(content).hexdigest()
    hourly = tuple(replace(field, split_files=3) for field in fetch.HOURLY)
    for field in hourly:
        with xr.open_dataset(files / field.merged, decode_times=False) as whole:
            for name, hours in zip(field.names, np.array_split(np.arange(field.records), 3), strict=True):
                path = tmp_path / "part.nc"
                whole.isel(time=hours).to_netcdf(path, format="NETCDF3_64BIT", unlimited_dims=["time"])
                shelf.files[f"/{name}"] = path.read_bytes()
                path.unlink()
    with serving(shelf) as base:
        local = functools.partial(fetch.fetch_a68a, base_url=base, large_files_url=base, files=small, progress=False)
        monkeypatch.setattr(fetch, "fetch_a68a", local)
        monkeypatch.setattr(fetch, "HOURLY", hourly)
        monkeypatch.setattr(time, "sleep", lambda seconds: None)
        monkeypatch.chdir(tmp_path)
        yield shelf


@pytest.mark.slow
def test_the_published_run_in_one_command(source: Shelf, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is there: the files are fetched, merged, checked, and the run is that from the files themselves."""
    monkeypatch.delenv("RIFTBERG_DATA", raising=False)
    common = ("run", "a68a-paper", "--days", "0.25", "--no-map", "-q")
    result = call(*common, "--fetch", "-o", "fetched")
    assert result.exit_code == 0, result.output + result.stderr
    folder = Path("riftberg-data/a68a")
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in files.iterdir())
    assert call(*common, "--data", str(files), "-o", "given").exit_code == 0
    with xr.open_dataset("fetched/run.nc") as ours, xr.open_dataset("given/run.nc") as theirs:
        np.testing.assert_array_equal(ours.lon.values, theirs.lon.values)
    asked = len(source.requests)
    assert call(*common, "--fetch", "-o", "again").exit_code == 0
    assert len(source.requests) == asked


@pytest.mark.slow
def test_fetching_goes_where_the_data_are_named(source: Shelf, tmp_path: Path) -> None:
    there = tmp_path / "elsewhere"
    refused = call("run", "a68a-paper", "--data", str(there))
    assert refused.exit_code == 2
    assert "no such folder" in refused.stderr
    there.mkdir()
    hourly = fetch.HOURLY[0].merged
    (there / hourly).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    result = call("run", "a68a-paper", "--data", str(there), "--fetch", "--days", "0.1", "--no-map", "-q")
    assert result.exit_code == 0, result.output + result.stderr
    assert (there / hourly).stat().st_size > 1_000_000  # the pointer gave way


def test_a_fetch_that_fails_says_so_and_runs_nothing(source: Shelf) -> None:
    source.status[f"/{fetch.HOURLY[1].names[0]}"] = 404
    result = call("run", "a68a-paper", "--fetch", "--days", "0.1", "-q", "-o", "out")
    assert result.exit_code == 2
    assert "is not there" in result.stderr
    assert not Path("out").exists()


def test_experiments_without_files_fetch_nothing() -> None:
    result = call("run", "a68a-melt", "--fetch")
    assert result.exit_code == 2
    assert "a68a-melt needs no files" in result.stderr
    assert "a68a-paper" in result.stderr
    own = call("run", "slab.yaml", "--fetch")
    assert own.exit_code == 2
    assert "names its own files" in own.stderr
