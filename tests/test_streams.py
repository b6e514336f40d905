"""A run outlives its terminal and its listeners: closed streams, readers that go, hang-ups."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr

from test_faults import EXPERIMENT

RUN = f"{sys.executable} -m riftberg run berg.yaml --no-map -o"


def shell(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Run a line in bash, whose last word says the exit code of the first command of a pipe."""
    (folder / "berg.yaml").write_text(EXPERIMENT)
    return subprocess.run(
        ["bash", "-c", text], cwd=folder, capture_output=True, text=True, timeout=300,
        env={**os.environ, "MPLBACKEND": "Agg"}, check=False,
    )  # fmt: skip


WAYS = {
    "closed error stream": "{run} out 2>&-; echo code $? >&1",
    "closed output": "{run} out >&-; echo code $?",
    "all closed": "{run} out <&- >&- 2>&-; echo code $?",
    "reader of the errors goes": "{run} out 2>&1 >/dev/null | true; echo code ${{PIPESTATUS[0]}}",
    "reader of the output goes": "{run} out 2>/dev/null | true; echo code ${{PIPESTATUS[0]}}",
    "reader of both goes": "{run} out 2>&1 | head -1 >/dev/null; echo code ${{PIPESTATUS[0]}}",
    "log on a full disk": "{run} out 2>/dev/full; echo code $?",
}


@pytest.mark.quick(1)
@pytest.mark.parametrize("way", WAYS)
def test_a_run_goes_on_where_nobody_listens(tmp_path: Path, way: str) -> None:
    """It ended without a word at its first line of progress; with a closed stream a file of results took its number."""
    result = shell(tmp_path, WAYS[way].format(run=RUN))
    assert result.stdout.endswith("code 0\n"), result.stdout + result.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["run.nc", "summary.json"]
    with xr.open_dataset(tmp_path / "out" / "run.nc") as run:
        assert run.sizes["time"] == 3
    assert "Traceback" not in result.stderr


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("{python} -m riftberg run nothing.yaml 2>&-", 2),  # a mistake keeps its code
        ("{python} -m riftberg run nothing.yaml 2>&1 | true", 2),
        ("{python} -m riftberg experiments | true", 0),
        ("{python} -m riftberg experiments >/dev/full", 1),  # results that are lost are no success
    ],
)
def test_exit_codes_are_right_where_nobody_listens(tmp_path: Path, line: str, code: int) -> None:
    result = shell(tmp_path, line.format(python=sys.executable) + "; echo code ${PIPESTATUS[0]}")
    said = int(result.stdout.split()[-1])
    assert said == code if code != 1 else said != 0


def hung_up(folder: Path, *before: str) -> subprocess.Popen[str]:
    """Start a long run, and hang up after its first records."""
    (folder / "berg.yaml").write_text(EXPERIMENT)
    words = [sys.executable, "-m", "riftberg", "run", "berg.yaml", "--no-map", "-q", "-o", "out", "--every", "1"]
    process = subprocess.Popen(
        [*before, *words, "--days", "3000", "--allow-large"], cwd=folder, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
        # Tests that run in the background may ignore hang-ups, and what they start would inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )  # fmt: skip
    end = time.monotonic() + 300.0
    while not (folder / "out" / "run.nc").exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(1.0)
    process.send_signal(signal.SIGHUP)
    return process


def test_a_hang_up_ends_a_run_like_a_request_to_terminate(tmp_path: Path) -> None:
    """A closed terminal, or a connection that drops: the state is saved, and the code is that of the signal."""
    process = hung_up(tmp_path)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 128 + signal.SIGHUP, said
    assert "Go on with: riftberg run" in said
    assert (tmp_path / "out" / "interrupted.restart.nc").exists()


@pytest.mark.slow
def test_a_hang_up_is_nothing_to_a_run_that_ignores_it(tmp_path: Path) -> None:
    """As ``nohup`` asks for."""
    process = hung_up(tmp_path, "nohup")
    time.sleep(2.0)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert process.returncode == 128 + signal.SIGTERM
