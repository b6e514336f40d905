"""The scripts of the page on job arrays: their lines run, a part is killed and goes on, and the result is that of the whole."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg import open_sweep

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "job-arrays.md"
SMALL = {"--members 40": "--members 6", "--days 8": "--days 0.5", "--workers 4": "--workers 0"}
"""What a test does with fewer members and shorter runs."""


def block(kind: str) -> str:
    found = re.findall(rf"^```{kind}\n(.*?)^```", PAGE.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    assert len(found) == 1
    return smaller(found[0])


def smaller(text: str) -> str:
    for there, here in SMALL.items():
        text = text.replace(there, here)
    return text


def shell(text: str, folder: Path, **variables: str) -> subprocess.Popen[bytes]:
    """Begin what a batch system begins, in a group of processes of its own."""
    words = ["bash", "-c", f'set -e\nriftberg() {{ "{sys.executable}" -m riftberg "$@"; }}\n{text}']
    environment = {**os.environ, **variables, "MPLBACKEND": "Agg"}
    return subprocess.Popen(words, cwd=folder, env=environment, start_new_session=True, stderr=subprocess.PIPE)


def ran(job: subprocess.Popen[bytes]) -> None:
    _, printed = job.communicate(timeout=800)
    assert job.returncode == 0, printed.decode()


def killed_in_a_member(job: subprocess.Popen[bytes], members: Path) -> None:
    """End a job, without any warning, once a member is done and not all are."""
    until = time.monotonic() + 600.0
    while not list(members.glob("*.json")):
        assert job.poll() is None, job.communicate()[1].decode()
        assert time.monotonic() < until
        time.sleep(0.02)
    os.killpg(job.pid, signal.SIGKILL)
    job.communicate()


def same(one: Path, other: Path) -> None:
    with open_sweep(one) as here, open_sweep(other) as there:
        assert (here["status"] == 0).all()
        assert set(here.variables) == set(there.variables)
        assert "control_lon" in here
        for name in set(here.variables) - {"wall_time"}:
            np.testing.assert_array_equal(here[name].values, there[name].values, err_msg=str(name))
    with xr.open_dataset(one / "control.nc") as here, xr.open_dataset(other / "control.nc") as there:
        np.testing.assert_array_equal(here["lon"].values, there["lon"].values)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The forecast in one piece."""
    folder = tmp_path_factory.mktemp("whole")
    ran(shell(smaller("riftberg forecast a68a --members 40 --days 8 -o whole --workers 4 --no-map -q"), folder))
    return folder / "whole"


@pytest.mark.slow
def test_an_array_with_a_killed_part_is_joined_to_the_forecast_in_one_piece(whole: Path, tmp_path: Path) -> None:
    script = block("sh")
    assert "--members 6 --days 0.5" in script
    number = re.search(r"--array=1-(\d+)", script)
    assert number is not None
    parts = range(1, int(number[1]) + 1)
    of_job = {"SLURM_CPUS_PER_TASK": "0"}
    victim = tmp_path / "forecast-of-a68a" / "part-2-of-4" / "members"
    killed_in_a_member(shell(script, tmp_path, SLURM_ARRAY_TASK_ID="2", **of_job), victim)
    assert len(list(victim.glob("*.json"))) < 2
    for k in parts:  # that of the killed part goes on
        ran(shell(script, tmp_path, SLURM_ARRAY_TASK_ID=str(k), **of_job))
    line = re.search(r'--wrap "(riftberg forecast --join [\w-]+)"', PAGE.read_text("utf-8"))
    assert line is not None
    ran(shell(f"{line[1]} --no-map", tmp_path))
    same(tmp_path / "forecast-of-a68a", whole)


@pytest.mark.slow
def test_the_rules_of_snakemake_make_the_same(whole: Path, tmp_path: Path) -> None:
    """Snakemake itself is not needed to run its shell lines, with its wildcards filled in."""
    rules = dict(re.findall(r"^rule (\w+):\n((?:    .*\n)+)", block("py") + "\n", flags=re.MULTILINE))
    lines = {name: "".join(re.findall(r'"(.*?)"', text.partition("shell:")[2])) for name, text in rules.items()}
    for k in range(1, 5):
        ran(shell(lines["part"].replace("{wildcards.k}", str(k)).replace("{threads}", "0"), tmp_path))
        assert (tmp_path / re.findall(r'output: "(.*?)"', rules["part"])[0].replace("{k}", str(k))).exists()
    ran(shell(lines["joined"], tmp_path))
    assert (tmp_path / re.findall(r'output: "(.*?)"', rules["joined"])[0]).exists()
    same(tmp_path / "forecast-of-a68a", whole)
