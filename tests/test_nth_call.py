"""Whatever call of the system fails while a file is written, what was there before is whole; and file systems without locks.

The calls fail in a library that is loaded before all others (``preload/faults.c``): patches in Python never meet what HDF5
writes. A restart makes 1,800 writes, a run 730, of which each is a process of its own: with ``RIFTBERG_EVERY=8`` the slow
tests let every eighth of more than a hundred calls fail, which takes a tenth of the hour.
"""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from products.test_addresses import sea
from riftberg.cli.main import app
from riftberg.runs.run_file import RunWriter

fcntl = pytest.importorskip("fcntl", reason="needs POSIX")
HERE = Path(__file__).parent
CALLS = ("write", "pwrite", "ftruncate", "fsync", "rename", "close")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs Linux and a C compiler (cc)")
    made = tmp_path_factory.mktemp("preload") / "faults.so"
    subprocess.run(
        [compiler, "-shared", "-fPIC", str(HERE / "preload" / "faults.c"), "-o", str(made), "-ldl"], check=True
    )
    return made


def with_library(library: Path, program: str, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, str(HERE), *words], capture_output=True, text=True, check=False, timeout=3000,
        env={**os.environ, "LD_PRELOAD": str(library), "NUMBA_DISABLE_JIT": "1", **more},
    )  # fmt: skip


TRIALS = """
import ctypes, errno, faulthandler, os, shutil, sys
from pathlib import Path
sys.path[:0] = [sys.argv[1]]
from fakes import FakeModel
from test_plain_readers import result
from riftberg.ensembles.result import open_sweep, write_sweep
from riftberg.errors import RiftbergError
from riftberg.runs.restart import load_state
from riftberg.runs.run_file import RunWriter, open_run
faults = ctypes.CDLL(None)
most, home, calls = int(sys.argv[2]), Path(sys.argv[3]), sys.argv[5:]
every = int(os.environ.get("RIFTBERG_EVERY", "1"))

def run(folder):
    FakeModel().advance(0.2, recorders=[RunWriter(folder / "run.nc", every_hours=2, flush_seconds=0, background=False)])
def restart(folder):
    FakeModel().save(folder / "a.restart.nc")
def sweep(folder):
    write_sweep(result(0, ["one", "two"]), folder / "sweep.nc")
writers = {"run": run, "restart": restart, "sweep": sweep}
def check(kind, folder):
    if kind == "run":
        with open_run(folder) as ds:
            assert ds.sizes["time"] >= 1
            ds.load()
    elif kind == "restart":
        load_state(folder / "a.restart.nc")
    else:
        with open_sweep(folder) as ds:
            assert ds["message"].values.tolist() == ["one", "two"]

def trial(kind, call, n, number):
    folder, crash = home / f"{kind}-{n}", home / "crash"
    shutil.copytree(home / kind, folder)
    pid = os.fork()
    if pid == 0:
        faulthandler.enable(crash.open("w"))
        try:
            # A full disk stays full; an error of a disk may pass.
            faults.fault_arm(call.encode(), n, number, int(number == errno.ENOSPC), str(folder).encode())
            writers[kind](folder)
            code = 0
        except (RiftbergError, OSError):
            code = 3
        except BaseException as error:
            print(kind, call, n, type(error).__name__, error, flush=True)
            code = 4
        made = faults.fault_count()
        faults.fault_arm(b"", 0, 0, 0, b"")
        (home / "count").write_text(str(made))
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    check(kind, folder)
    shutil.rmtree(folder)
    if code == -11:
        # HDF5 still writes and closes once in `close`, after all has been written; netCDF dies where that one call fails.
        frames = crash.read_text().split("Current thread")[1].splitlines()
        code = "closing" if " in _close" in frames[1] else code
    return code

for kind in sys.argv[4].split(","):
    (home / kind).mkdir()
    writers[kind](home / kind)
    for call in calls:
        assert trial(kind, call, 0, 0) == 0  # none fails
        count = int((home / "count").read_text())
        numbers = range(1, count + 1, every if count > 100 else 1)
        if most and count > most:
            numbers = sorted({1 + k * (count - 1) // (most - 1) for k in range(most)})
        ended = []
        for k, n in enumerate(numbers):
            for number in (errno.ENOSPC, errno.EIO) if not most else ((errno.ENOSPC, errno.EIO)[k % 2],):
                ended.append(trial(kind, call, n, number))
                if ended[-1] not in (0, 3, "closing"):
                    print("bad", kind, call, n, number, ended[-1])
        print("met", kind, call, count, ended.count("closing"), len(ended), flush=True)
"""


@pytest.mark.timeout(3000)
@pytest.mark.parametrize(
    ("kinds", "most"),
    [
        ("run,restart,sweep", 2),
        *(pytest.param(kind, 0, marks=pytest.mark.slow) for kind in ("run", "restart", "sweep")),
    ],
)
def test_what_was_there_is_whole_after_any_call_that_fails(
    library: Path, tmp_path: Path, kinds: str, most: int
) -> None:
    """A disk that is full from a call on, and an error at one call, in turn or (slow) both at every call.

    The library itself dies of the last write and the close of a file, which it makes after all has been written, and of no
    other call.
    """
    ended = with_library(library, TRIALS, str(most), str(tmp_path), kinds, *CALLS)
    assert ended.returncode == 0, f"{ended.stdout}{ended.stderr}"
    assert "bad" not in ended.stdout, ended.stdout
    rows = [line.split()[1:] for line in ended.stdout.splitlines() if line.startswith("met ")]
    met = {(kind, call): [int(text) for text in numbers] for kind, call, *numbers in rows}
    assert set(met) == {(kind, call) for kind in kinds.split(",") for call in CALLS}
    for (kind, call), (count, closing, tried) in met.items():
        assert tried > 0 or call in ("write", "ftruncate", "fsync"), (kind, call)
        assert count > 10 or call != "pwrite"
        assert closing <= (met[kind, "rename"][0] * 2 if call in ("pwrite", "close") else 0), (kind, call)


UNLOCKED = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1]]
from fakes import FakeModel
from riftberg.runs.restart import load_state
from riftberg.runs.run_file import RunWriter, open_run
from riftberg.system.atomic_files import refusal
from test_plain_readers import result
from riftberg.ensembles.result import open_sweep, write_sweep
out, there = Path(sys.argv[2]), Path(sys.argv[3])
for name, work in (
    ("run", lambda: FakeModel().advance(0.1, recorders=[RunWriter(out / "run.nc")])),
    ("restart", lambda: FakeModel().save(out / "a.restart.nc")),
    ("sweep", lambda: write_sweep(result(0, ["one"]), out / "sweep.nc")),
    ("read a run", lambda: open_run(there / "run.nc").close()),
    ("read a restart", lambda: load_state(there / "a.restart.nc")),
):
    try:
        work()
    except Exception as error:
        print(name, refusal(error) if isinstance(error, OSError) else error)
    else:
        print(name, "good")
"""


@pytest.mark.quick(2)
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", ["ENOLCK", "EIO", "EACCES", "EPERM", "EOPNOTSUPP"])
def test_a_file_system_without_locks_is_called_so_with_the_way_out(library: Path, tmp_path: Path, name: str) -> None:
    """It was "permission denied", or a damaged file; a server of locks that is gone, or a sandbox, gives other numbers."""
    number = getattr(errno, name)
    there, out, free = (tmp_path / name for name in ("there", "out", "free"))
    for folder in (there, out, free):
        folder.mkdir()
    FakeModel().advance(0.1, recorders=[RunWriter(there / "run.nc")])
    FakeModel().save(there / "a.restart.nc")
    ended = with_library(library, UNLOCKED, str(out), str(there), FAULT_LOCKS=str(number))
    lines = ended.stdout.splitlines()
    assert len(lines) == 5, ended.stderr
    assert all("HDF5_USE_FILE_LOCKING=FALSE" in line and "no locks" in line for line in lines), lines
    ended = with_library(
        library, UNLOCKED, str(free), str(there), FAULT_LOCKS=str(number), HDF5_USE_FILE_LOCKING="FALSE"
    )
    assert ended.stdout.count("good") == 5, ended.stdout + ended.stderr
    assert not [path.name for path in free.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize(
    "words", [["doctor", "sea.nc"], ["plot", "run.nc"], ["run", "sea.yaml"]], ids=lambda words: words[0]
)
def test_a_file_that_a_program_has_open_for_writing_is_called_so(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was "not a NetCDF file, or a damaged one: fetch it again"."""
    FakeModel().advance(0.1, recorders=[RunWriter(tmp_path / "run.nc")])
    sea().to_netcdf(tmp_path / "sea.nc")
    (tmp_path / "sea.yaml").write_text(
        "start: 2020-12-09\ndays: 0.1\nforcing: [sea.nc]\n"
        "berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-38, -56]}\n"
    )
    monkeypatch.chdir(tmp_path)
    with open("run.nc", "rb") as run, open("sea.nc", "rb") as ocean:
        for file in (run, ocean):  # as HDF5 does where it opens a file to write it
            fcntl.flock(file, fcntl.LOCK_EX)
        result = CliRunner().invoke(app, words)
    assert result.exit_code in (1, 2)
    assert "it is open for writing in a program, which has to close it first" in " ".join(result.output.split())
