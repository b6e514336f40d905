"""Fetching of the paper's inputs: parts merged and checked, damaged parts, full disks. No network is used."""

from __future__ import annotations

import hashlib
from pathlib import Path

import netCDF4
import numpy as np
import pytest

pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")
pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")

from fetching.serving import Shelf
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.fetching.fetch import FILES, HOURLY, Hourly, fetch_a68a, merge_hourly

CONTENT = bytes(range(256)) * 8000
DIGEST = hashlib.sha256(CONTENT).hexdigest()


def hourly_part(folder: Path, first: int, hours: int, value: float = 0.2, points: int = 3) -> bytes:
    """Return the content of one part of an hourly file."""
    path = folder / f"part{first}.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as ds:
        ds.createDimension("time", None)
        ds.createDimension("lat", 2)
        ds.createDimension("lon", points)
        ds.createVariable("lat", "f8", ("lat",))[:] = [-56.0, -55.875]
        ds.createVariable("lon", "f8", ("lon",))[:] = -38.0 + 0.125 * np.arange(points)
        time = ds.createVariable("time", "f8", ("time",))
        time.units = "hours since 2020-12-01 00:00:00"
        time[:] = np.arange(first, first + hours)
        for sign, name in ((1.0, "uo"), (-1.0, "vo")):
            field = ds.createVariable(name, "f8", ("time", "lat", "lon"))
            field[:] = sign * (
                value + 1e-4 * np.arange(first, first + hours)[:, None, None] + np.zeros((hours, 2, points))
            )
    content = path.read_bytes()
    path.unlink()
    return content


SMALL = Hourly("ocean", "currents_dec2020_HOURLY.nc", ("uo", "vo"), 24, 5.0, split_files=4)


def stock(shelf: Shelf, folder: Path, hours: int = 6) -> None:
    """Put the parts of `SMALL` on the shelf, in an order of numbers that is not that of time."""
    for number, first in zip(range(4), (6, 0, 12, 18), strict=True):
        shelf.files[f"/tests/a68/data/split_files/ocean{number:06d}.nc"] = hourly_part(folder, first, hours)


def test_parts_are_merged_in_time_checked_and_readable(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path)
    shelf.files["/small.nc"] = CONTENT
    folder = tmp_path / "a68a"
    paths = fetch_a68a(
        folder, base_url=base, large_files_url=base, hourly=[SMALL], files={"small.nc": DIGEST}, progress=False
    )
    assert [path.name for path in paths] == ["small.nc", "currents_dec2020_HOURLY.nc"]
    assert sorted(path.name for path in folder.iterdir()) == ["currents_dec2020_HOURLY.nc", "small.nc"]
    ds = open_product(paths[1])
    assert ds.attrs["product"] == "a68a"
    assert ds["time"].values[13] == np.datetime64("2020-12-01T13:00")
    np.testing.assert_allclose(ds["uo"].values[:, 0, 0], 0.2 + 1e-4 * np.arange(24))
    asked = len(shelf.requests)
    fetch_a68a(folder, base_url=base, hourly=[SMALL], files={"small.nc": DIGEST}, progress=False)
    assert len(shelf.requests) == asked


def test_a_short_part_is_found_by_the_record_count(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path, hours=5)
    with pytest.raises(ForcingError, match="holds 20 records instead of 24"):
        fetch_a68a(tmp_path / "a", base_url=base, hourly=[SMALL], files={}, progress=False)
    assert not (tmp_path / "a" / SMALL.merged).exists()


def test_texts_of_any_length_in_the_parts_do_not_reach_the_merged_file(tmp_path: Path) -> None:
    """Along the hours, as ERA5 names the version of each, or alone: plain xarray dies of them."""
    parts = [tmp_path / f"{first}.nc" for first in (12, 0)]
    for part in parts:
        part.write_bytes(hourly_part(tmp_path, int(part.stem), 12))
        with netCDF4.Dataset(part) as classic, netCDF4.Dataset(tmp_path / "texts.nc", "w") as ds:
            for name, dimension in classic.dimensions.items():
                ds.createDimension(name, len(dimension))
            for name, variable in classic.variables.items():
                copy = ds.createVariable(name, variable.dtype, variable.dimensions)
                copy.setncatts(variable.__dict__)
                copy[:] = variable[:]
            ds.createVariable("expver", str, ("time",))[:] = np.array(["0001"] * 11 + ["0005"], dtype=object)
            ds.createVariable("centre", str, ())[...] = "Größe"
            ds.setncattr("history", ["fetched", "cut in two"])
        (tmp_path / "texts.nc").rename(part)
    merge_hourly(parts, tmp_path / "merged.nc", SMALL)
    with netCDF4.Dataset(tmp_path / "merged.nc") as merged:
        assert list(merged.variables) == ["lat", "lon", "time", "uo", "vo"]
        assert merged["time"][:].tolist() == list(range(24))
        assert merged.history == "fetched; cut in two"


def test_a_doubled_part_is_found_by_its_hours(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path)
    shelf.files["/tests/a68/data/split_files/ocean000003.nc"] = shelf.files[
        "/tests/a68/data/split_files/ocean000002.nc"
    ]
    with pytest.raises(ForcingError, match="not evenly spaced: a part is missing or doubled"):
        fetch_a68a(tmp_path / "a", base_url=base, hourly=[SMALL], files={}, progress=False)


def test_values_out_of_range_are_refused(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path)
    shelf.files["/tests/a68/data/split_files/ocean000003.nc"] = hourly_part(tmp_path, 18, 6, value=20.0)
    with pytest.raises(ForcingError, match=r"uo runs from 0\.2 to 20"):
        fetch_a68a(tmp_path / "a", base_url=base, hourly=[SMALL], files={}, progress=False)


def test_damaged_part_is_removed_and_fetched_again(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path)
    name = "/tests/a68/data/split_files/ocean000002.nc"
    right, shelf.files[name] = shelf.files[name], b"\x89HDF, cut"
    folder = tmp_path / "a"
    with pytest.raises(ForcingError, match="this part is damaged"):
        fetch_a68a(folder, base_url=base, hourly=[SMALL], files={}, progress=False)
    assert sorted(path.name for path in folder.iterdir()) == ["ocean000000.nc", "ocean000001.nc", "ocean000003.nc"]
    shelf.files[name] = right
    assert fetch_a68a(folder, base_url=base, hourly=[SMALL], files={}, progress=False)[0].exists()


def test_a_pointer_of_git_lfs_in_the_place_of_a_merged_file_gives_way(shelf: Shelf, base: str, tmp_path: Path) -> None:
    """As a copy of the repository without its large files leaves it."""
    stock(shelf, tmp_path)
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / SMALL.merged).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    (path,) = fetch_a68a(folder, base_url=base, hourly=[SMALL], files={}, progress=False)
    with netCDF4.Dataset(path) as ds:
        assert len(ds.dimensions["time"]) == 24


def test_a_merged_file_that_cannot_be_read_is_explained(base: str, tmp_path: Path) -> None:
    (tmp_path / SMALL.merged).write_text("<html>maintenance</html>")
    with pytest.raises(ForcingError, match=r"cannot be read.*Delete it and fetch again"):
        fetch_a68a(tmp_path, base_url=base, hourly=[SMALL], files={}, progress=False)


def test_full_disk_while_merging_leaves_no_half_file_and_keeps_the_parts(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """The limit of the system stops the NetCDF library itself, in the middle of the file."""
    parts = []
    for number in range(2):
        parts.append(tmp_path / f"ocean{number}.nc")
        parts[-1].write_bytes(hourly_part(tmp_path, 12 * number, 12, points=4000))
    whole = [part.read_bytes() for part in parts]
    request.getfixturevalue("little_room")
    with pytest.raises(ForcingError, match="Free some space"):
        merge_hourly(parts, tmp_path / "merged.nc", SMALL)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ocean0.nc", "ocean1.nc"]
    assert [part.read_bytes() for part in parts] == whole


def test_a_part_damaged_in_its_middle_is_removed_and_told_from_a_full_disk(tmp_path: Path) -> None:
    parts = []
    for number in range(2):
        parts.append(tmp_path / f"ocean{number}.nc")
        with netCDF4.Dataset(parts[-1], "w") as ds:
            ds.createDimension("time", 12)
            for name in ("time", "uo", "vo"):
                ds.createVariable(name, "f8", ("time",), zlib=True, fletcher32=True)[:] = 12 * number + np.arange(12.0)
    content = bytearray(parts[1].read_bytes())
    content[-60:-20] = bytes(40)
    parts[1].write_bytes(content)
    with pytest.raises(ForcingError, match="this part is damaged"):
        merge_hourly(parts, tmp_path / "merged.nc", SMALL)
    assert list(tmp_path.iterdir()) == [parts[0]]


def test_files_of_the_paper_have_the_stated_checksums(shared: Path) -> None:
    for name, digest in FILES.items():
        path = shared / "data" / "a68a" / name.rsplit("/", 1)[-1]
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_hourly_fields_of_the_paper_are_those_of_the_record() -> None:
    assert [(field.stem, field.records) for field in HOURLY] == [("ocean", 744), ("ssh", 744), ("wind", 739)]
    assert HOURLY[0].names[7] == "tests/a68/data/split_files/ocean000007.nc"
