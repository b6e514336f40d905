"""A disk that is full is called so, gives back its room, and leaves whole files: on a small disk of its own."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from test_faults import EXPERIMENT, riftberg
from test_killed import WRITERS

HERE = Path(__file__).parent


def on_small_disk(program: str, folder: Path, megabytes: float, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program with a small disk of its own at ``folder``, which is seen by nobody else and gone with it."""
    mount = f'mount -t tmpfs -o size={int(megabytes * 1024)}k tmpfs {folder} && exec "$@"'
    alone = ["unshare", "-rm", "bash", "-c", mount, "bash"]
    if subprocess.run([*alone, "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("no small disk can be made here: unshare -rm and a tmpfs are needed")
    return subprocess.run(
        [*alone, sys.executable, "-c", program, str(folder), *arguments], capture_output=True, text=True, timeout=500,
        env={**os.environ, "MPLBACKEND": "Agg"}, check=False,
    )  # fmt: skip


FILLED = """
import gc, itertools, os, shutil, sys
from pathlib import Path
sys.path[:0] = [{here!r}]
from fakes import FakeModel
from riftberg.system.atomic_files import refusal
out, steps = Path(sys.argv[1]), 10**6
def tell():
    with open(out / "filler", "wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            pass
try:
{body}
except Exception as error:
    print("said", type(error).__name__, refusal(error) if isinstance(error, OSError) else error, flush=True)
gc.collect()
print("left", sorted(p.name for p in out.iterdir() if p.name.startswith(".") and p.name.endswith(".part")))
(out / "filler").unlink()
size = sum(p.stat().st_size for p in out.iterdir() if not p.name.startswith("."))
print("lost", shutil.disk_usage(out).used - size)
from test_killed import CHECKS
CHECKS[{name!r}](out, 0)
print("whole", flush=True)
"""


# These write as "summary" does, by `replacing`, or as "run.nc" does; each is killed in `test_killed`.
ALIKE = ("kid restart", "kid trajectories", "film", "forces", "picture", "replay", "score")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n in ALIKE else ()) for n in WRITERS])
def test_every_writer_calls_a_full_disk_a_full_disk(tmp_path: Path, name: str) -> None:
    """Once: "NetCDF: HDF error", "[Errno 13] Permission denied", a bare RuntimeError, a segmentation fault."""
    body = "\n".join(f"    {line}" for line in WRITERS[name].splitlines())
    result = on_small_disk(FILLED.format(here=str(HERE), body=body, name=name), tmp_path, 24)
    assert result.returncode == 0, result.stderr
    assert re.search(r"^said (OSError|RunError|InputError) .*the disk is full", result.stdout, re.M), result.stdout
    assert "left []" in result.stdout
    lost = re.search(r"^lost (\d+)", result.stdout, re.M)
    assert lost is not None
    assert int(lost[1]) < 200_000  # blocks of the files, and no copy that nobody sees
    assert "whole" in result.stdout


GROWING = """
import shutil, sys
from pathlib import Path
sys.path[:0] = [{here!r}]
from fakes import FakeModel
from riftberg.errors import RunError
from riftberg.runs.run_file import RunWriter, open_run
out = Path(sys.argv[1])
model = FakeModel(30, 20)
writer = RunWriter(out / "run.nc", every_hours=0.5, flush_seconds=0, background=False)
writer.start(model)
try:
    while True:
        model.step()
        writer.record(model)
except RunError as error:
    print(error)
try:
    writer.finish(model)
except RunError as error:
    print("again:", error)
size = (out / "run.nc").stat().st_size
print("room", shutil.disk_usage(out).used - size < 100_000)
model.save(out / "failed.restart.nc")
with open_run(out) as run:
    print("until", str(run.time.values[-1])[:16].replace("T", " "), run.sizes["time"])
"""


@pytest.mark.slow
def test_a_run_that_fills_the_disk_can_save_its_state(tmp_path: Path) -> None:
    """The room of the failed copy was taken until the process ended, and nothing could be saved."""
    result = on_small_disk(GROWING.format(here=str(HERE)), tmp_path, 3)
    assert result.returncode == 0, result.stderr
    said = re.search(r"run.nc \(the disk is full\); it holds good records up to (.*)", result.stdout)
    assert said is not None, result.stdout
    assert f"until {said[1]} " in result.stdout
    assert int(result.stdout.split()[-1]) > 10
    assert "room True" in result.stdout


@pytest.mark.slow
def test_the_error_of_the_end_does_not_hide_that_of_the_beginning(tmp_path: Path) -> None:
    """A file that may not grow any more: neither the next record, nor the last one, nor the state."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (420_000, 420_000))

    # The run file of 400 elements begins with 290 kB, and a restart file has 500 kB.
    long = EXPERIMENT.replace("days: 0.0625", "days: 40").replace(
        "length: 9 km, width: 6 km", "length: 60 km, width: 60 km"
    )
    (tmp_path / "long.yaml").write_text(long)
    result = riftberg(
        tmp_path, "run", "long.yaml", "-o", "out", "-q", "--no-map", "--every", "0.5", "--days", "40", limit=limit
    )
    assert result.returncode == 2, result.stderr
    said = "the file would become larger than it may"
    assert re.search(rf"the run failed at .*: cannot write out/run.nc \({said}.*good records up to 20", result.stderr)
    assert f"The state cannot be saved ({said}" in result.stderr
    assert "Traceback" not in result.stderr


ROOM = """
import sys
from pathlib import Path
from typer.testing import CliRunner
from riftberg.cli.main import app
out = Path(sys.argv[1])
words = ["run", sys.argv[2], "-o", str(out / "out"), "-q", "--no-map", "--keep-days", "3", *sys.argv[3:]]
result = CliRunner().invoke(app, words)
print(result.exit_code, result.stderr)
if result.exit_code:
    assert "the results take about" in result.stderr, result.stderr
"""


@pytest.mark.parametrize("megabytes", [3, *(pytest.param(s, marks=pytest.mark.slow) for s in (4, 5, 6, 7, 8, 10, 14))])
def test_a_run_is_refused_or_has_room_to_its_end(tmp_path: Path, megabytes: float) -> None:
    """The check of room once knew nothing of the copy that takes the next records: runs died at half."""
    disk = tmp_path / "disk"
    disk.mkdir()
    (tmp_path / "long.yaml").write_text(EXPERIMENT.replace("days: 0.0625", "days: 30"))
    arguments = [str(tmp_path / "long.yaml"), "--every", "0.5", "--forces"]
    result = on_small_disk(ROOM, disk, megabytes, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr
