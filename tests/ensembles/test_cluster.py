"""Clients of dask: a sweep leaves those of the program alone, and no file waits for a scheduler."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest
import xarray as xr
from distributed import Client, LocalCluster

from riftberg import Iceberg, Model, Parameters, Steady, sweep
from riftberg.ensembles.cluster import connected
from riftberg.errors import InputError
from riftberg.system.netcdf_lock import open_lazily, write_dataset

ALONE = {"threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}
"""Settings of a cluster within this process."""


def drifting(speed: float) -> Model:
    """Return a model that costs nothing: one element in a current."""
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Steady(current=(speed, 0.0)), Parameters(), start="2020-12-09")


def written_and_summed(folder: Path) -> float:
    """Write a dataset, read it back in blocks and sum it up."""
    write_dataset(xr.Dataset({"thickness": ("x", np.arange(5.0))}), folder / "written.nc", encoding={})
    with open_lazily(folder / "written.nc", chunks={"x": 2}) as back:
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


@pytest.mark.parametrize("how", ["cluster", "address"])
def test_the_default_client_of_a_program_stays_its_default(how: str) -> None:
    with (
        LocalCluster(n_workers=1, **ALONE) as cluster,
        Client(cluster) as mine,
    ):
        options = {"workers": 1} if how == "cluster" else {"scheduler": cluster.scheduler_address}
        result = sweep(drifting, {"speed": [0.1]}, days="1 h", every_hours=1, **options)
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


def _told() -> tuple[bool, str, int]:
    """Tell of a worker whether it is deaf to interrupts, and by what it computes."""
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN, str(dask.config.get("scheduler", None)), os.getpid()


def test_workers_are_deaf_to_interrupts_also_those_in_the_place_of_lost_ones() -> None:
    """A worker that took the place of a lost one died of Ctrl-C, with its member."""
    with connected(workers=1) as client:
        deaf, computes_by, lost = client.submit(_told, pure=False).result()
        assert deaf
        assert computes_by == "synchronous"
        os.kill(lost, signal.SIGKILL)
        deaf, computes_by, number = client.submit(_told, pure=False).result(timeout=60)
        while number == lost:  # told before the loss was noticed
            deaf, computes_by, number = client.submit(_told, pure=False).result(timeout=60)
        assert deaf
        assert computes_by == "synchronous"


def test_two_sweeps_at_once_do_not_quarrel_about_a_port() -> None:
    """Each asked for port 8787, and the second one warned that it was taken; warnings are errors here."""
    with connected(workers=1) as one, connected(workers=1) as two:
        assert one.submit(abs, -1).result() == two.submit(abs, -1).result() == 1
