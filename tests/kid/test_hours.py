"""Hourly files read in blocks: the same numbers as record by record, few openings, little memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import Grid
from riftberg.errors import ForcingError, InputError
from riftberg.kid import a68
from riftberg.kid.a68 import HourlyFile
from riftberg.kid.ncfile import opened_dataset, unpacked

NJ, NI, RECORDS = 6, 8, 60


@pytest.fixture
def grid() -> Grid:
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(NI), -60.0 + 0.125 * np.arange(NJ))
    return Grid.from_corners(lon, lat)


def write(path: Path, *, kind: str = "i2", chunk: int = 0, records: int = RECORDS, form: str = "NETCDF4") -> Path:
    """Write two variables of random numbers, the integers packed and with gaps."""
    rng = np.random.default_rng(5)
    with netCDF4.Dataset(path, "w", format=form) as dataset:
        dataset.createDimension("time", None if form != "NETCDF4" else records)
        dataset.createDimension("lat", NJ)
        dataset.createDimension("lon", NI)
        for name in ("uo", "vo"):
            how: dict[str, Any] = {"zlib": True, "chunksizes": (chunk, NJ, NI)} if chunk else {}
            if kind == "i2":
                how["fill_value"] = -999
            variable = dataset.createVariable(name, kind, ("time", "lat", "lon"), **how)
            variable.set_auto_maskandscale(False)
            values = rng.integers(-900, 900, (records, NJ, NI)).astype(kind)
            if kind == "i2":
                variable.scale_factor, variable.add_offset = 0.001, 0.25
            else:
                values, variable.missing_value = values / 256.0, np.array(np.nan, kind)
            values[3, 2, 1] = -999 if kind == "i2" else np.nan
            variable[:] = values
    return path


LAYOUTS = {
    "packed, chunks of a day": {"chunk": 24},
    "packed, chunks of a record": {"chunk": 1},
    "packed, contiguous": {},
    "double, records of a classic file": {"kind": "f8", "form": "NETCDF3_64BIT_OFFSET"},
    "single precision": {"kind": "f4", "chunk": 7},
}


@pytest.mark.quick(6)
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=list(LAYOUTS))
@pytest.mark.parametrize("block_bytes", [1, 700, 5000, 2**22])
def test_blocks_give_what_records_give(
    tmp_path: Path, grid: Grid, monkeypatch: pytest.MonkeyPatch, layout: dict[str, Any], block_bytes: int
) -> None:
    """Bit for bit, forwards, backwards and at random, whatever the length of the blocks."""
    monkeypatch.setattr(a68, "BLOCK_BYTES", block_bytes)
    path = write(tmp_path / "hours.nc", **layout)
    file = HourlyFile(path, ("uo", "vo"), grid)
    assert file.count == RECORDS
    order = [*range(RECORDS), *range(RECORDS - 1, -1, -1), *np.random.default_rng(1).integers(0, RECORDS, 30)]
    with opened_dataset(path) as dataset:
        for number in order:
            for name, values in file.record(int(number)).items():
                np.testing.assert_array_equal(values, unpacked(dataset, path, name, int(number)))
    assert np.isnan(file.record(3)["uo"][2, 1])
    assert np.isfinite(file.record(4)["uo"][2, 1])


def test_records_are_the_callers_own(tmp_path: Path, grid: Grid) -> None:
    file = HourlyFile(write(tmp_path / "hours.nc", kind="f8"), ("uo",), grid)
    before = file.record(7)["uo"].copy()
    file.record(7)["uo"][:] = 0.0
    np.testing.assert_array_equal(file.record(7)["uo"], before)


def test_a_file_is_opened_once_a_block(tmp_path: Path, grid: Grid, monkeypatch: pytest.MonkeyPatch) -> None:
    count = []
    monkeypatch.setattr(a68, "opened_dataset", lambda path: count.append(path) or opened_dataset(path))
    monkeypatch.setattr(a68, "BLOCK_BYTES", 24 * NJ * NI * 2)
    file = HourlyFile(write(tmp_path / "hours.nc", chunk=12), ("uo", "vo"), grid)
    for number in range(RECORDS):
        file.record(number)
    assert len(count) == 1 + 3  # the header, and blocks of 24, 24 and 12 records


def test_blocks_are_whole_chunks_and_small(tmp_path: Path, grid: Grid, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk that straddled two blocks would be unpacked twice."""
    monkeypatch.setattr(a68, "BLOCK_BYTES", 30 * NJ * NI * 2)
    file = HourlyFile(write(tmp_path / "hours.nc", chunk=12), ("uo", "vo"), grid)
    starts = set()
    for number in range(RECORDS):
        file.record(number)
        starts.add(file._first)
        assert sum(raw.nbytes for raw in file._held.values()) <= 2 * a68.BLOCK_BYTES
    assert starts == {0, 24, 48}


def test_chunks_too_large_to_keep_are_read_in_part(tmp_path: Path, grid: Grid, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(a68, "BLOCK_BYTES", 5 * NJ * NI * 2)
    monkeypatch.setattr(a68, "LARGEST_CHUNK", 20 * NJ * NI * 2)
    file = HourlyFile(write(tmp_path / "hours.nc", chunk=RECORDS), ("uo",), grid)
    file.record(17)
    assert {name: len(raw) for name, raw in file._held.items()} == {"uo": 5}


def test_one_record_is_every_record(tmp_path: Path, grid: Grid) -> None:
    with netCDF4.Dataset(tmp_path / "one.nc", "w") as dataset:
        for name, size in (("time", 1), ("lat", NJ), ("lon", NI)):
            dataset.createDimension(name, size)
        dataset.createVariable("SSH", "f8", ("time", "lat", "lon"))[:] = 0.3
    file = HourlyFile(tmp_path / "one.nc", ("SSH",), grid)
    np.testing.assert_array_equal(file.record(500)["SSH"], np.full((NJ, NI), 0.3))


def test_wrong_files_are_explained(tmp_path: Path, grid: Grid) -> None:
    path = write(tmp_path / "hours.nc")
    with pytest.raises(InputError, match=r"no variable 'SSH' \(found: uo, vo\)"):
        HourlyFile(path, ("SSH",), grid)
    other = Grid.from_corners(*np.meshgrid(np.arange(5.0), np.arange(4.0)))
    with pytest.raises(ForcingError, match=r"shape \(60, 6, 8\) does not fit the grid of 4 x 5 cells"):
        HourlyFile(path, ("uo",), other)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset.createDimension("hours", 3)
        dataset.createVariable("wo", "f8", ("hours", "lat", "lon"))[:] = 0.0
    with pytest.raises(ForcingError, match=r"different numbers of records \(uo 60, wo 3\)"):
        HourlyFile(path, ("uo", "wo"), grid)
