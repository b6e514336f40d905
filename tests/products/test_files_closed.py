"""Files are closed once a reader has refused them, and files with texts do not end the process."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.test_odd_files import by_run, on_level, plain
from riftberg import Options, build, open_product
from riftberg.errors import ForcingError, RiftbergError
from riftberg.ocean.doctor import doctor
from riftberg.products import open_all, recognise
from riftberg.system.netcdf_lock import open_lazily

FILE = "odd.nc"
EXPERIMENT = """
start: 2020-12-16 06:00
days: 0.1
berg: {rectangle: {length: 12 km, width: 6 km}, placement: [-39.0, -55.5], thickness: 200 m}
forcing: {kind: files, files: [odd.nc], longitude: [-41, -37], latitude: [-57.5, -53.5], hold: 24 h}
"""


def currents() -> xr.Dataset:
    return plain(names=("uo", "vo"))


BAD: dict[str, Callable[[], xr.Dataset]] = {
    "no field": lambda: currents().rename(uo="a", vo="b").map(lambda field: field.assign_attrs(standard_name="x")),
    "no currents": lambda: plain(names=("ua", "va")),
    "dates in words": lambda: currents().assign_coords(time=("time", ["monday", "tuesday", "friday", "sunday"])),
    "a level far below": lambda: on_level(currents(), ("uo", "vo"), "depth", 900.0, units="m", positive="down"),
    "another year": lambda: currents().assign_coords(time=currents()["time"] - np.timedelta64(3650, "D")),
    "nothing at the berg": lambda: currents().where(currents()["lon"] > -38.0),
}


def by_experiment(path: Path) -> Any:
    experiment = path.with_name("own.yaml")
    experiment.write_text(EXPERIMENT)
    return build(str(experiment), Options())


def still_open(path: Path) -> list[str]:
    places = [f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd")]
    return [place for place in places if os.path.exists(place) and os.path.realpath(place) == os.path.realpath(path)]


@pytest.mark.quick(8)
@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux lists the open files of a process so")
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("way", [recognise, open_all, open_product, doctor, by_experiment])
def test_a_refused_file_is_closed_while_its_error_is_kept(tmp_path: Path, bad: str, way: Callable[[Path], Any]) -> None:
    """An error keeps the frames that it went through: a notebook could not write the file again that it had refused."""
    path = tmp_path / FILE
    BAD[bad]().to_netcdf(path)
    assert not still_open(path)
    kept: Any = None
    try:
        kept = way(path)
    except RiftbergError as error:
        kept = error
    if isinstance(kept, RiftbergError) or way in (recognise, doctor):
        assert not still_open(path)
        currents().to_netcdf(path, mode="w")
        by_run(path)


def test_what_is_closed_by_an_error_elsewhere_is_read_on(tmp_path: Path) -> None:
    """A file that a run has open stays readable when another one is refused."""
    currents().to_netcdf(tmp_path / "good.nc")
    good = open_product(tmp_path / "good.nc")
    BAD["dates in words"]().to_netcdf(tmp_path / "bad.nc")
    for _ in range(2):
        with pytest.raises(ForcingError, match="monday"):
            open_all([tmp_path / "good.nc", tmp_path / "bad.nc"])
    np.testing.assert_array_equal(good["uo"], currents()["uo"])


TEXTS = """
import sys
from riftberg.system.netcdf_lock import open_lazily, open_netcdf
paths, kept = sys.argv[1:], []
for _ in range(30):
    kept = [open_lazily(path, decode_times=False, drop_variables=["station"]) for path in paths]
    for ds in kept:
        ds["uo"].load()
    for path in paths:
        with open_netcdf(path) as file:
            file["vo"][:]
print("whole")
"""


@pytest.mark.slow
def test_files_with_texts_do_not_end_the_process(tmp_path: Path) -> None:
    """A file with texts of any length that is closed while another is open leaves the library with types that are gone."""
    for name in ("one.nc", "two.nc"):
        names = {f"name_{k}": ("station", ["a", "bc"]) for k in range(4)}
        currents().assign(names).assign_coords(station=["north", "south"]).to_netcdf(tmp_path / name)
    paths = [str(tmp_path / name) for name in ("one.nc", "two.nc")]
    done = subprocess.run([sys.executable, "-c", TEXTS, *paths], capture_output=True, text=True, check=False)
    assert done.stdout == "whole\n", done.stderr[-2000:]


def test_a_file_with_texts_that_was_closed_for_another_is_opened_again(tmp_path: Path) -> None:
    for number in (1.0, 2.0):
        (number * currents()).assign(name=("lat", list("abcdefghijklm"))).to_netcdf(tmp_path / f"{number:g}.nc")
    one, two = (open_lazily(tmp_path / f"{number}.nc") for number in (1, 2))
    for _ in range(2):
        np.testing.assert_array_equal(2.0 * one["uo"][0].values, two["uo"][0].values)
        assert one["name"].values.tolist() == two["name"].values.tolist()
        one, two = (open_lazily(tmp_path / f"{number}.nc") for number in (1, 2))
