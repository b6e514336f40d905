"""A second command that would write what a first one is writing is refused, and takes nothing of the first away."""

from __future__ import annotations

import ast
import hashlib
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from forked import COMMAND, Program
from kid.conftest import write_case
from riftberg.cli.main import app
from riftberg.runs.run_file import RunWriter
from riftberg.system.atomic_files import only_writer

SLAB = """\
start: 2020-12-09 13:00
days: 30
berg:
  rectangle: {length: 9 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}
"""
SEEN = "date,lat,lon\n2020-12-10,-55.0,-39.0\n"


@contextmanager
def started(folder: Path, *words: str) -> Iterator[Program]:
    """Give a command in a process of its own, whose errors go into a file of a folder."""
    process = Program(COMMAND, *words, errors=folder / "errors.txt")
    try:
        yield process
    finally:
        process.kill()


def waited_for(path: Path, process: Program) -> None:
    end = time.monotonic() + 300.0
    while not path.exists() and process.wait(0.02) is None and time.monotonic() < end:
        pass
    assert path.exists()


def refused(first: Program, *words: str) -> None:
    """Try a second command here while the first one, in its process, holds its breath: it would compute meanwhile."""
    first.send_signal(signal.SIGSTOP)
    try:
        result = CliRunner().invoke(app, words)
    finally:
        first.send_signal(signal.SIGCONT)
    assert result.exit_code == 2, result.output
    assert "is writing this file" in result.stderr, result.stderr


def ended(process: Program, folder: Path) -> None:
    """End a run by a request to terminate; it writes all that it has to write."""
    process.send_signal(signal.SIGTERM)
    assert process.wait(120) == 128 + signal.SIGTERM
    assert "cannot" not in (folder / "errors.txt").read_text()


@pytest.mark.parametrize("times", [2])
def test_a_second_kid_leaves_the_first_alone(tmp_path: Path, times: int) -> None:
    """The second one was refused, and its clean-up removed the files of the first, which died then: 7 of 7 tries."""
    import netCDF4

    # At rest and with sub-steps short enough for its springs, so that the first is still running when the others come.
    case = write_case(tmp_path / "case", {"ibhrs": 10**6, "nmax": 10**8, "ibuo": 0.0}, {"mts_sub_steps": 60})
    words = ("kid", str(case), "--output", str(tmp_path / "KID.nc"), "--quiet")
    with started(tmp_path, *words) as first:
        waited_for(tmp_path / "KID_bonds.nc", first)
        for _ in range(times):
            refused(first, *words)
        ended(first, tmp_path)
    for name in ("KID.nc", "KID_bonds.nc", "KID_restart.nc", "KID_bonds_restart.nc"):
        with netCDF4.Dataset(tmp_path / name) as file:
            assert len(file.dimensions["i"]) >= 2


def test_a_second_run_or_one_that_goes_on_leaves_the_first_alone(tmp_path: Path) -> None:
    from riftberg import open_run

    (tmp_path / "slab.yaml").write_text(SLAB)
    words = ("run", str(tmp_path / "slab.yaml"), "--days", "80000", "--allow-large", "--every", "24", "--no-map", "-q")
    out = tmp_path / "out"
    with started(tmp_path, *words, "-o", str(out), "--keep-days", "5") as first:
        waited_for(out / "kept-2.restart.nc", first)
        refused(first, *words, "-o", str(out))
        refused(first, *words, "--resume", str(out))
        ended(first, tmp_path)
    with open_run(out) as run:
        assert run.sizes["time"] > 5
    assert {"run.nc", "summary.json", "interrupted.restart.nc", "kept-1.restart.nc", "kept-2.restart.nc"} == {
        path.name for path in out.iterdir()
    }


def test_a_second_sweep_leaves_the_first_alone(tmp_path: Path) -> None:
    """It took away the file that asks members to stop, and wrote the members' files beside the first."""
    (tmp_path / "slab.yaml").write_text(SLAB)
    out = tmp_path / "sweep"
    words = ("sweep", str(tmp_path / "slab.yaml"), "--vary", "ice.density=850,870", "--days", "20000", "--workers", "0")
    with started(tmp_path, *words, "--allow-large", "-q", "--no-map", "-o", str(out)) as first:
        waited_for(out / "sweep.json", first)
        refused(first, "sweep", "--resume", str(out), "--allow-large", "-q", "--no-map")
        ended(first, tmp_path)
    assert (out / "sweep.nc").exists()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    model = FakeModel()
    model.advance(1.0, recorders=[RunWriter(folder / "run.nc", every_hours=6.0)])
    (folder / "seen.csv").write_text(SEEN)
    return folder


OTHERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "plot": ("map.png", ("plot", "{run}", "--kind", "map", "-o", "{out}")),
    "replay": ("page.html", ("replay", "{run}", "-o", "{out}/page.html")),
    "animate": ("film.gif", ("animate", "{run}", "-o", "{out}/film.gif", "-q")),
    "score": ("score.json", ("score", "{run}", "{run}/seen.csv", "-o", "{out}", "--no-figure")),
    "why": ("why.json", ("why", "{run}", "-o", "{out}", "--no-figure")),
    "compare": ("comparison.json", ("compare", "{run}", "-o", "{out}")),
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", OTHERS)
def test_every_command_is_refused_what_another_one_writes(finished: Path, tmp_path: Path, name: str) -> None:
    """The file of the first stays as it is, to the last bit; nothing else is written or left."""
    file, words = OTHERS[name]
    if name == "compare":
        (finished / "summary.json").write_text(_summary())
    (tmp_path / file).write_bytes(b"half of it")
    filled = [word.format(run=finished, out=tmp_path) for word in words]
    with only_writer(tmp_path / file):
        result = CliRunner().invoke(app, filled)
        assert result.exit_code == 2, result.output
        assert f"(process {os.getpid()}) is writing this file" in result.stderr
        assert {path.name for path in tmp_path.iterdir()} == {file, f".{file}.lock"}
        assert (tmp_path / file).read_bytes() == b"half of it"
    result = CliRunner().invoke(app, filled)
    assert result.exit_code == 0, result.output  # it is free again


SOURCES = Path(__file__).resolve().parents[1] / "src" / "riftberg"
DOORS = {"system/netcdf_lock.py": "the door itself", "system/atomic_files.py": "the writer itself"}
OTHER_WRITERS = {
    "compiled/kernels.py": "machine code, which another process may write at the same time",
    "fetching/download.py": "parts of downloads, which stay and are gone on with",
}
OPENERS = {"Dataset", "MFDataset", "open_dataset", "open_mfdataset", "open_dataarray", "load_dataset", "to_netcdf"}
WRITERS = {"write_text", "write_bytes", "tofile", "copyfile", "copy", "copy2", "move", "save", "savez", "savetxt"}


def round_the_doors(text: str, file: str) -> list[str]:
    """Return the lines of a source in which NetCDF is opened, or a file written, otherwise than all of them are."""
    found = []
    for call in (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)):
        words = ast.unparse(call.func).split(".")
        name, owner = words[-1], words[-2] if len(words) > 1 else ""
        modes = [ast.literal_eval(word) for word in [*call.args, *(k.value for k in call.keywords)]
                 if isinstance(word, ast.Constant) and isinstance(word.value, str)]  # fmt: skip
        opens = name in OPENERS and owner in ("netCDF4", "xr", "xarray", "h5netcdf", "") and name != "Dataset"
        opens |= (name, owner) in (("Dataset", "netCDF4"), ("File", "h5py")) or name == "to_netcdf"
        modules = name in ("write_text", "write_bytes", "tofile") or owner in ("np", "numpy", "shutil")
        writes = name in WRITERS and owner not in ("part", "temporary") and modules and owner != ""
        writes |= name == "to_csv" and bool(call.args)
        writes |= name in ("open", "ZipFile") and any(
            set(mode) & set("wax+") and set(mode) <= set("rwaxbt+") for mode in modes
        )
        if (opens and file not in DOORS) or (writes and file not in {**DOORS, **OTHER_WRITERS}):
            found.append(f"{file}:{call.lineno} {ast.unparse(call)[:60]}")
    return found


WAYS_ROUND = (
    "netCDF4.Dataset(path)", "xr.open_dataset(path)", "ds.to_netcdf(path)", "path.write_text(text)", "path.write_bytes(raw)",
    "open(path, 'w')", "path.open('ab')", "shutil.copyfile(a, b)", "np.save(path, array)",
    "h5py.File(path, 'a')", "zipfile.ZipFile(path, 'w')", "gzip.open(path, 'wt')", "table.to_csv(path)",
)  # fmt: skip


@pytest.mark.parametrize("line", WAYS_ROUND)
def test_a_way_round_the_door_and_the_writer_is_seen(line: str) -> None:
    assert round_the_doors(line, "cli/run.py")


def test_all_netcdf_is_opened_by_the_door_and_all_files_written_by_the_writer() -> None:
    """Two commands and three openings went round them: half a file was left, and libraries were called by two threads."""
    files = {path.relative_to(SOURCES).as_posix(): path.read_text("utf-8") for path in SOURCES.rglob("*.py")}
    allowed = {
        "viz/style.py",
        "cli/ensembles.py",
        "ensembles/sweep.py",
        "system/process.py",
    }  # into `part`, or a stream
    found = [line for file, text in files.items() for line in round_the_doors(text, file) if "copy)" not in line]
    assert [line for line in found if line.split(":")[0] not in allowed] == []


def test_a_command_that_is_stopped_while_it_writes_leaves_the_file_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`riftberg rerun` and `riftberg new` wrote in place."""
    from riftberg.cli.compare import run_again
    from riftberg.errors import RiftbergError

    run = tmp_path / "run"
    run.mkdir()
    kept = {"command": "riftberg run slab.yaml", "experiment_file": SLAB}

    def full(self: Path, *_: Any, **__: Any) -> int:
        self.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises((OSError, RiftbergError)):
        run_again(run / "run.nc", kept, tmp_path / "again", [], {})
    assert not (tmp_path / "again").exists()


def _summary() -> str:
    import json

    from riftberg.diagnostics.summary import summarize

    model = FakeModel()
    model.advance(0.5)
    return json.dumps(summarize(model))


@pytest.mark.parametrize("fault", ["a recorder that starts before", "the disk"])
def test_what_an_earlier_run_wrote_is_not_taken_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    """A run that fails before it has made its file leaves the one that is there."""
    (tmp_path / "slab.yaml").write_text(SLAB)
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.nc").write_bytes(b"the result of last year")
    before = hashlib.sha256((out / "run.nc").read_bytes()).digest()

    def fails(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    where = "record_file.define_run" if fault == "the disk" else "run_file.RunWriter.start"
    monkeypatch.setattr(f"riftberg.runs.{where}", fails)
    result = CliRunner().invoke(app, ["run", str(tmp_path / "slab.yaml"), "-o", str(out), "-q", "--no-map"])
    assert result.exit_code == 2, result.output
    assert "the disk is full" in result.stderr
    assert hashlib.sha256((out / "run.nc").read_bytes()).digest() == before
    assert [path.name for path in out.iterdir()] == ["run.nc"]


def test_a_part_that_another_process_fetches_is_not_thrown_away(tmp_path: Path) -> None:
    """A second fetch began with dropping what the first had so far."""
    from riftberg.errors import InputError
    from riftberg.fetching.download import Resuming, partial_path

    url = "http://127.0.0.1:9/big.nc"
    part = partial_path(tmp_path, url)
    part.write_bytes(b"the first megabytes")
    with only_writer(part), pytest.raises(InputError, match="is writing this file"):
        Resuming(attempts=1)(url, tmp_path / "big.nc")
    assert part.read_bytes() == b"the first megabytes"
