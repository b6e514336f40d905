"""Clients of dask: a sweep leaves those of the program alone, and no file waits for a scheduler."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest
import xarray as xr
from distributed import Client, LocalCluster

from riftberg import Forcing, Iceberg, Model, Parameters, sweep
from riftberg.ensembles.cluster import run_pool
from riftberg.errors import InputError
from riftberg.system.netcdf_lock import open_lazily, write_dataset
from riftberg.system.process import Hold

ALONE = {"threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}
"""Settings of a cluster within this process."""


def drifting(speed: float) -> Model:
    """Return a model that costs nothing: one element in a current."""
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0)), Parameters(), start="2020-12-09")


def written_and_summed(folder: Path) -> float:
    """Write a dataset, read it back through dask and sum it up."""
    write_dataset(xr.Dataset({"thickness": ("x", np.arange(5.0))}), folder / "written.nc", encoding={})
    with open_lazily(folder / "written.nc", chunks={"x": 5}) as back:
        return float(back["thickness"].sum())


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1:1"])
def test_a_scheduler_that_does_not_answer_does_not_become_the_default_of_dask(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever kept the error, as notebooks do, could write and compute nothing any more: 'missing port number'."""
    monkeypatch.setattr("distributed.Client", Hasty)
    with pytest.raises(InputError, match="no scheduler of dask answers there") as kept:
        sweep(drifting, {"speed": [0.1]}, days=0.1, every_hours=1, scheduler=address)
    assert kept.value.__cause__ is not None  # and with it the client, in the frames of its traceback
    with pytest.raises(ValueError, match="No clients found"):
        Client.current()
    assert dask.config.get("scheduler", None) is None
    assert written_and_summed(tmp_path) == 10.0


class Hasty(Client):
    """A client of dask with less patience."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **{**options, "timeout": "1s"})


def test_a_client_that_is_not_the_default_is_used_and_left_as_it_was() -> None:
    """So far the sweep looked for its members with the default client of dask, and there was none."""
    with (
        LocalCluster(n_workers=1, **ALONE) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        result = sweep(drifting, {"speed": [0.1, 0.2]}, days="2 h", every_hours=1, scheduler=client)
        assert result["status"].values.tolist() == [0, 0]
        assert client.status == "running"


def test_the_default_client_of_a_program_stays_its_default() -> None:
    with (
        LocalCluster(n_workers=1, **ALONE) as cluster,
        Client(cluster) as mine,
    ):
        result = sweep(drifting, {"speed": [0.1]}, days="1 h", every_hours=1, scheduler=cluster.scheduler_address)
        assert result["status"].values.tolist() == [0]
        assert Client.current() is mine


def test_a_file_is_written_where_the_scheduler_is_gone(tmp_path: Path) -> None:
    """Xarray takes a lock that the scheduler gives; with a lost one, hours of a run ended in an error at the last file."""
    with (
        LocalCluster(n_workers=0, **ALONE) as cluster,
        Client(cluster, timeout="1s") as client,
    ):
        cluster.close()
        write_dataset(xr.Dataset({"thickness": ("x", np.arange(5.0))}), tmp_path / "written.nc")
        client.close()
    assert written_and_summed(tmp_path) == 10.0


def test_an_unlimited_dimension_and_an_encoding_are_written(tmp_path: Path) -> None:
    """Blocks of dask are computed first."""
    ds = xr.Dataset({"thickness": (("time", "x"), np.arange(6.0).reshape(2, 3))}).chunk(time=1)
    encoding = {"thickness": {"dtype": "f4", "zlib": True, "_FillValue": -1.0}}
    write_dataset(ds, tmp_path / "written.nc", encoding=encoding, unlimited_dims=["time"])
    with open_lazily(tmp_path / "written.nc") as back:
        assert back.encoding["unlimited_dims"] == {"time"}
        assert back["thickness"].encoding["dtype"] == np.dtype("f4")
        assert back["thickness"].encoding["zlib"]
        np.testing.assert_array_equal(back["thickness"], ds["thickness"])


def _told(folder: str) -> tuple[bool, str, str, int]:
    """Tell of a worker whether it is deaf to interrupts and by what it computes; the first one is killed."""
    first = Path(folder) / "first"
    if not first.exists():
        first.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    deaf = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    return deaf, str(dask.config.get("scheduler", None)), os.environ["NUMBA_NUM_THREADS"], os.getpid()


def test_workers_are_deaf_to_interrupts_also_those_in_the_place_of_lost_ones(tmp_path: Path) -> None:
    """A worker that took the place of a lost one died of Ctrl-C, with its member."""
    before = dict(os.environ)
    found = [future.result() for future, _ in run_pool(_told, [str(tmp_path)] * 3, 1, Hold())]
    assert len(found) == 3
    assert {row[:3] for row in found} == {(True, "synchronous", "1")}
    assert os.getpid() not in {row[3] for row in found}
    assert dict(os.environ) == before


def _ends(job: str) -> str:
    """Return a path at which a byte says that it was begun, or end the process."""
    with Path(job).open("a") as begun:
        begun.write(".")
    if job.endswith("1"):
        os._exit(3)
    return job


@pytest.mark.slow
def test_a_job_that_ends_its_process_four_times_has_failed_and_the_others_are_done(tmp_path: Path) -> None:
    jobs = [str(tmp_path / str(k)) for k in range(4)]
    ended = {job: future.exception() for future, job in run_pool(_ends, jobs, 2, Hold())}
    assert sorted(ended) == jobs
    assert type(ended[jobs[1]]).__name__ == "BrokenProcessPool"
    assert [ended[jobs[k]] for k in (0, 2, 3)] == [None] * 3
    assert Path(jobs[1]).stat().st_size == 1 + 3  # and three times more


@pytest.mark.slow
def test_nothing_begins_after_a_signal() -> None:
    hold = Hold()
    made: list[int] = []
    coming = run_pool(abs, (made.append(k) or -k for k in range(1, 100)), 1, hold)
    assert next(coming)[0].result() == 1
    assert len(made) <= 2  # members are made when a process is free for them
    hold.requested = signal.SIGINT
    assert len(list(coming)) <= 1  # what was under way


def test_a_function_that_cannot_travel_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def local(job: int) -> int:
        return job

    ((future, _),) = run_pool(local, [1], 1, Hold())
    assert future.result() == 1  # by cloudpickle, which is beside dask
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(InputError, match="cannot be sent to other processes"):
        list(run_pool(local, [1], 1, Hold()))


PLAIN = """
import sys
sys.modules["cloudpickle"] = None
"""
"""Of a script that has not got cloudpickle."""

OF_ELSEWHERE = """
import math
from riftberg.ensembles.cluster import run_pool
from riftberg.system.process import Hold
print("script", flush=True)
print(sorted(future.result() for future, _ in run_pool(math.sqrt, [4.0, 9.0], 2, Hold())))
"""
OF_ITS_OWN = """
from riftberg.ensembles.cluster import run_pool
from riftberg.system.process import Hold
print("script", flush=True)
def half(x):
    return x / 2
{}print(sorted(future.result() for future, _ in run_pool(half, [4.0, 6.0], 2, Hold())))
"""
UNGUARDED, GUARDED = OF_ITS_OWN.format(""), OF_ITS_OWN.format('if __name__ == "__main__": ')
MEMBERS = """
import riftberg
print("script", flush=True)
vary = {"fracture.normal_strength": ["16 kPa", "24 kPa"]}
ds = riftberg.sweep("e.yaml", vary, workers=2, output="sweep")
print(ds["status"].values.tolist())
ds = riftberg.forecast("e.yaml", {"start.thickness": "normal(1, 5 %)"}, members=2, workers=2, output="forecast")
print(ds["status"].values.tolist())
"""


def ran(script: str, folder: Path, how: str) -> subprocess.CompletedProcess[str]:
    """Run a script of a user: a file, a module, from a pipe, or as words of the command line."""
    (folder / "script.py").write_text(script)
    words, given = {
        "file": (["script.py"], ""), "module": (["-m", "script"], ""), "pipe": (["-"], script), "words": (["-c", script], ""),
    }[how]  # fmt: skip
    return subprocess.run(
        [sys.executable, *words], input=given, cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("script", "how"),
    [
        pytest.param(UNGUARDED, "file", id="file"),
        pytest.param(UNGUARDED, "module", id="module", marks=pytest.mark.slow),
        pytest.param(UNGUARDED, "pipe", id="pipe", marks=pytest.mark.slow),
        pytest.param(PLAIN + OF_ELSEWHERE, "words", id="words", marks=pytest.mark.slow),
    ],
)
def test_a_script_without_a_main_guard_is_run_once(script: str, how: str, tmp_path: Path) -> None:
    """Bug: each worker ran the script anew and died of it, and after minutes all members were 'killed, or out of memory'."""
    done = ran(script, tmp_path, how)
    assert done.stdout.split("\n")[:-1] == ["script", "[2.0, 3.0]"], done.stderr
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "words"), [("file", "no worker has begun"), pytest.param("pipe", "in no file", marks=pytest.mark.slow)]
)
def test_a_script_that_workers_must_read_is_told_at_once_to_guard_its_call(
    how: str, words: str, tmp_path: Path
) -> None:
    """Without cloudpickle processes find a function of the script in the script alone."""
    done = ran(PLAIN + UNGUARDED, tmp_path, how)
    assert done.returncode == 1
    assert words in done.stderr.splitlines()[-1]
    assert "install cloudpickle, or give workers=0" in done.stderr.splitlines()[-1]
    assert done.stdout.count("script") <= 3


@pytest.mark.slow
def test_a_script_with_a_main_guard_needs_nothing_else(tmp_path: Path) -> None:
    done = ran(PLAIN + GUARDED, tmp_path, "file")
    assert "[2.0, 3.0]" in done.stdout, done.stderr


@pytest.mark.slow
def test_a_sweep_and_a_forecast_in_a_script_without_a_main_guard(tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(
        "name: e\nstart: 2020-12-09\ndays: 0.05\nforcing: {uniform: {current: [0.1, 0.0], slope: [0, 0]}}\n"
        "berg: {thickness: 200, rectangle: {length: 9 km, width: 6 km}, placement: [-37, -56]}\n"
    )
    done = ran(MEMBERS, tmp_path, "file")
    assert done.stdout.split("\n")[:-1] == ["script", "[0, 0]", "[0, 0]"], done.stderr
