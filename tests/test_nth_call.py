"""Whatever call of the system fails while a file is written, what was there before is whole; and file systems without locks.

The calls fail in a library that is loaded before all others (``preload/faults.c``): patches in Python never meet what HDF5
writes.
"""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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
        env={**os.environ, "LD_PRELOAD": str(library), **more},
    )  # fmt: skip


TRIALS = """
import ctypes, errno, os, shutil, sys
from pathlib import Path
sys.path[:0] = [sys.argv[1]]
from fakes import FakeModel
from test_plain_readers import result
from riftberg.ensembles.result import open_sweep, write_sweep
from riftberg.errors import RiftbergError
from riftberg.runs.restart import load_state
from riftberg.runs.run_file import RunWriter, open_run
faults = ctypes.CDLL(None)
kind, most, home = sys.argv[2], int(sys.argv[3]), Path(sys.argv[4])

def run(folder):
    FakeModel().advance(0.2, recorders=[RunWriter(folder / "run.nc", every_hours=2, flush_seconds=0, background=False)])
def restart(folder):
    FakeModel().save(folder / "a.restart.nc")
def sweep(folder):
    write_sweep(result(0, ["one", "two"]), folder / "sweep.nc")
write = {"run": run, "restart": restart, "sweep": sweep}[kind]
def check(folder):
    if kind == "run":
        with open_run(folder) as ds:
            assert ds.sizes["time"] >= 1
            ds.load()
    elif kind == "restart":
        load_state(folder / "a.restart.nc")
    else:
        assert open_sweep(folder)["message"].values.tolist() == ["one", "two"]

before = home / "before"
before.mkdir()
write(before)
def trial(call, n, number):
    folder = home / f"{n}"
    shutil.copytree(before, folder)
    pid = os.fork()
    if pid == 0:
        try:
            faults.fault_arm(call.encode(), n, number, str(folder).encode())
            write(folder)
            code = 0
        except (RiftbergError, OSError):
            code = 3
        except BaseException as error:
            print(n, type(error).__name__, error, flush=True)
            code = 4
        made = faults.fault_count()
        faults.fault_arm(b"", 0, 0, b"")
        (home / "count").write_text(str(made))
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    check(folder)
    shutil.rmtree(folder)
    return code
for call in sys.argv[5:]:
    assert trial(call, 0, 0) == 0  # none fails
    count = int((home / "count").read_text())
    numbers = range(1, count + 1)
    if most and count > most:
        numbers = sorted({1 + k * (count - 1) // (most - 1) for k in range(most)})
    for k, n in enumerate(numbers):
        for number in (errno.ENOSPC, errno.EIO) if not most else ((errno.ENOSPC, errno.EIO)[k % 2],):
            code = trial(call, n, number)
            if code not in (0, 3, -11):  # HDF5 itself may end in a segmentation fault where a file cannot be closed
                print("bad", call, n, number, code)
    print("met", call, count, flush=True)
"""


@pytest.mark.timeout(3000)
@pytest.mark.parametrize("most", [4, pytest.param(0, marks=pytest.mark.slow)], ids=["some", "all"])
@pytest.mark.parametrize("kind", ["run", "restart", "sweep"])
def test_what_was_there_is_whole_after_any_call_that_fails(library: Path, tmp_path: Path, kind: str, most: int) -> None:
    """A full disk and an I/O error, in turn or (slow) both at every call."""
    ended = with_library(library, TRIALS, kind, str(most), str(tmp_path), *CALLS)
    assert ended.returncode == 0, f"{ended.stdout}{ended.stderr}"
    assert "bad" not in ended.stdout
    met = dict(line.split()[1:] for line in ended.stdout.splitlines() if line.startswith("met"))
    assert set(met) == set(CALLS)
    assert int(met["pwrite"]) > 10
    assert int(met["rename"]) > 0


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


@pytest.mark.timeout(300)
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP], ids=["ENOLCK", "EOPNOTSUPP"])
def test_a_file_system_without_locks_is_called_so_with_the_way_out(library: Path, tmp_path: Path, number: int) -> None:
    """It was "permission denied"."""
    there, out, free = (tmp_path / name for name in ("there", "out", "free"))
    for folder in (there, out, free):
        folder.mkdir()
    good = with_library(library, UNLOCKED, str(there), str(there))
    assert good.stdout.count("good") == 5, good.stdout + good.stderr
    ended = with_library(library, UNLOCKED, str(out), str(there), FAULT_LOCKS=str(number))
    lines = ended.stdout.splitlines()
    assert len(lines) == 5, ended.stderr
    assert all("HDF5_USE_FILE_LOCKING=FALSE" in line and "no locks" in line for line in lines), lines
    ended = with_library(
        library, UNLOCKED, str(free), str(there), FAULT_LOCKS=str(number), HDF5_USE_FILE_LOCKING="FALSE"
    )
    assert ended.stdout.count("good") == 5, ended.stdout + ended.stderr
    assert not [path.name for path in free.iterdir() if path.name.startswith(".")]
