"""Fetching: cut connections, wrong checksums, full disks, damaged parts, missing logins. No network is used."""

from __future__ import annotations

import errno
import hashlib
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import netCDF4
import numpy as np
import pytest

pytest.importorskip("pooch", reason="needs the extra riftberg[fetch]")
pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")
pytest.importorskip("cf_xarray", reason="needs the extra riftberg[products]")

from ocean.serving import Shelf, serving
from riftberg.errors import ForcingError
from riftberg.ocean import download, fetch, services
from riftberg.ocean.download import Resuming, fetch_one
from riftberg.ocean.fetch import FILES, HOURLY, Hourly, fetch_a68a, merge_hourly
from riftberg.ocean.products import open_product
from riftberg.ocean.services import fetch_product

CONTENT = bytes(range(256)) * 8000
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def shelf() -> Shelf:
    shelf = Shelf()
    shelf.files["/data/field.nc"] = CONTENT
    return shelf


@pytest.fixture
def base(shelf: Shelf) -> Iterator[str]:
    with serving(shelf) as address:
        yield address


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download.time, "sleep", lambda seconds: None)


def fetch_field(folder: Path, base: str, digest: str | None = DIGEST, **options: object) -> Path:
    return fetch_one("data/field.nc", digest, folder, base, Resuming(**options))  # type: ignore[arg-type]


def test_file_arrives_whole_and_is_not_fetched_twice(shelf: Shelf, base: str, tmp_path: Path) -> None:
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT
    fetch_field(tmp_path, base)
    assert len(shelf.requests) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["field.nc"]


def test_cut_connection_is_continued_where_it_was_cut(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.cut_after, shelf.cuts = 700_000, 2
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT
    starts = [asked for _, asked in shelf.requests]
    assert starts[0] == ""
    assert len(starts) == 3
    # What came before a cut is kept, whole blocks at least.
    kept = [int(asked.removeprefix("bytes=").rstrip("-")) for asked in starts[1:]]
    assert 500_000 <= kept[0] <= 700_000 < kept[1]


def test_connection_cut_more_often_than_attempts_still_arrives(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.cut_after, shelf.cuts = 300_000, 6
    assert fetch_field(tmp_path, base, attempts=2).read_bytes() == CONTENT


def test_interrupted_run_is_continued_by_the_next(shelf: Shelf, base: str, tmp_path: Path) -> None:
    (tmp_path / "field.nc.part").write_bytes(CONTENT[:1_000_000])
    fetch_field(tmp_path, base)
    assert shelf.requests == [("/data/field.nc", "bytes=1000000-")]


def test_part_that_was_complete_already(shelf: Shelf, base: str, tmp_path: Path) -> None:
    (tmp_path / "field.nc.part").write_bytes(CONTENT)
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT


def test_server_without_ranges_starts_anew(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.ranges = False
    (tmp_path / "field.nc.part").write_bytes(b"x" * 5000)
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT


def test_dead_connection_gives_up_and_keeps_what_came(shelf: Shelf, base: str, tmp_path: Path) -> None:
    (tmp_path / "field.nc.part").write_bytes(CONTENT[:1_000_000])
    shelf.cut_after, shelf.cuts = 0, 99
    with pytest.raises(ForcingError, match=r"3 attempts in a row brought nothing.*1\.0 MB are kept"):
        fetch_field(tmp_path, base, attempts=3)
    assert (tmp_path / "field.nc.part").read_bytes() == CONTENT[:1_000_000]
    assert not (tmp_path / "field.nc").exists()


def test_wrong_checksum_keeps_nothing(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.files["/data/field.nc"] = CONTENT[:-1] + b"?"
    with pytest.raises(ForcingError, match="its checksum is wrong"):
        fetch_field(tmp_path, base)
    assert list(tmp_path.iterdir()) == []


def test_changed_file_on_disk_is_fetched_again(base: str, tmp_path: Path) -> None:
    (tmp_path / "field.nc").write_bytes(b"old")
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT


def test_full_disk_while_writing(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Resuming, *arguments: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Resuming, "_write", full)
    with pytest.raises(ForcingError, match=r"the disk is full\. Free some space"):
        fetch_field(tmp_path, base)


def test_download_that_cannot_fit_is_not_begun(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download.shutil, "disk_usage", lambda folder: types.SimpleNamespace(free=1000))
    with pytest.raises(ForcingError, match="the disk is full"):
        fetch_field(tmp_path, base)
    assert not (tmp_path / "field.nc.part").exists()


def test_folder_that_cannot_be_written(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: Resuming, *arguments: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Resuming, "_write", refused)
    with pytest.raises(ForcingError, match="cannot be written"):
        fetch_field(tmp_path, base)


@pytest.mark.parametrize(("code", "words"), [(404, "is not there"), (403, "wants a login"), (500, "brought nothing")])
def test_refusals_say_what_they_mean(code: int, words: str, shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.status["/data/field.nc"] = code
    with pytest.raises(ForcingError, match=words):
        fetch_field(tmp_path, base, attempts=2)


def test_pointer_of_git_lfs_is_followed(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.files["/data/field.nc"] = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    shelf.files["/large/data/field.nc"] = CONTENT
    fetched = fetch_field(tmp_path, base, large_files=lambda url: url.replace("/data/", "/large/data/"))
    assert fetched.read_bytes() == CONTENT


def test_progress_is_told(base: str, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    fetch_field(tmp_path, base, progress=lambda *told: seen.append(told))
    assert seen[-1] == ("field.nc", len(CONTENT), len(CONTENT))
    assert [done for _, done, _ in seen] == sorted(done for _, done, _ in seen)


def test_bar_shows_one_file_after_another(capsys: pytest.CaptureFixture[str]) -> None:
    bar = download.Bar()
    for told in (("a.nc", 10, 20), ("a.nc", 20, 20), ("b.nc", 5, 0)):
        bar(*told)
    bar.close()
    assert "Traceback" not in capsys.readouterr().err


# ---- the paper's inputs ----------------------------------------------------------------------------------------------


def hourly_part(folder: Path, first: int, hours: int, value: float = 0.2) -> bytes:
    """Return the content of one part of an hourly file."""
    path = folder / f"part{first}.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as ds:
        ds.createDimension("time", None)
        ds.createDimension("lat", 2)
        ds.createDimension("lon", 3)
        ds.createVariable("lat", "f8", ("lat",))[:] = [-56.0, -55.875]
        ds.createVariable("lon", "f8", ("lon",))[:] = [-38.0, -37.875, -37.75]
        time = ds.createVariable("time", "f8", ("time",))
        time.units = "hours since 2020-12-01 00:00:00"
        time[:] = np.arange(first, first + hours)
        for sign, name in ((1.0, "uo"), (-1.0, "vo")):
            field = ds.createVariable(name, "f8", ("time", "lat", "lon"))
            field[:] = sign * (value + 1e-4 * np.arange(first, first + hours)[:, None, None] + np.zeros((hours, 2, 3)))
    content = path.read_bytes()
    path.unlink()
    return content


SMALL = Hourly("ocean", "currents_dec2020_HOURLY.nc", ("uo", "vo"), 24, 5.0, parts=4)


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
    right, shelf.files[name] = shelf.files[name], b"<html>maintenance</html>"
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


def test_full_disk_while_merging_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = []
    for number in range(2):
        parts.append(tmp_path / f"ocean{number}.nc")
        parts[-1].write_bytes(hourly_part(tmp_path, 12 * number, 12))

    def full(parts: object, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(fetch, "_join", full)
    with pytest.raises(ForcingError, match="Free some space"):
        merge_hourly(parts, tmp_path / "merged.nc", SMALL)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ocean0.nc", "ocean1.nc"]


def test_files_of_the_paper_have_the_stated_checksums(shared: Path) -> None:
    for name, digest in FILES.items():
        path = shared / "data" / "a68a" / name.rsplit("/", 1)[-1]
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest


def test_hourly_fields_of_the_paper_are_those_of_the_record() -> None:
    assert [(field.stem, field.records) for field in HOURLY] == [("ocean", 744), ("ssh", 744), ("wind", 739)]
    assert HOURLY[0].names[7] == "tests/a68/data/split_files/ocean000007.nc"


# ---- services --------------------------------------------------------------------------------------------------------

PLACE = {"lon": (-45.0, -30.0), "lat": (-60.0, -50.0), "time": ("2020-12-01", "2020-12-31")}


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Someone without any login: an empty home folder and no variables."""
    for name in ("EARTHDATA_TOKEN", "EARTHDATA_USERNAME", "EARTHDATA_PASSWORD", "NETRC", "CDSAPI_KEY"):
        monkeypatch.delenv(name, raising=False)
    for name in ("COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD", "CDSAPI_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(services.Path, "home", lambda: tmp_path / "home")


CLIENTS = [("oscar", "earthaccess"), ("glorys", "copernicusmarine"), ("duacs", "copernicusmarine"), ("era5", "cdsapi")]


@pytest.mark.parametrize(("name", "package"), CLIENTS)
def test_missing_client_is_named(name: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "find_spec", lambda package: None)
    with pytest.raises(ForcingError, match=rf"{package} is not installed.*pip install {package}"):
        fetch_product(name, tmp_path, **PLACE)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "package"), CLIENTS)
@pytest.mark.usefixtures("stranger")
def test_missing_login_says_where_to_get_one(
    name: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, "find_spec", lambda package: object())
    monkeypatch.setitem(sys.modules, package, types.ModuleType(package))
    with pytest.raises(ForcingError, match=r"wants a login and none was found.*Make a free account at https://"):
        fetch_product(name, tmp_path, **PLACE)  # type: ignore[arg-type]


@pytest.mark.usefixtures("stranger")
def test_copernicus_is_asked_for_box_days_and_depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, object] = {}
    client = types.ModuleType("copernicusmarine")
    client.subset = lambda **request: asked.update(request)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "copernicusmarine", client)
    monkeypatch.setattr(services, "find_spec", lambda package: object())
    monkeypatch.setenv("COPERNICUSMARINE_SERVICE_USERNAME", "someone")
    monkeypatch.setenv("COPERNICUSMARINE_SERVICE_PASSWORD", "something")
    paths = fetch_product("glorys", tmp_path, **PLACE, depth=200.0)
    assert asked["dataset_id"] == "cmems_mod_glo_phy_my_0.083deg_P1D-m"
    assert (asked["minimum_longitude"], asked["maximum_latitude"], asked["maximum_depth"]) == (-45.0, -50.0, 200.0)
    assert asked["start_datetime"] == "2020-12-01T00:00:00"
    assert paths == [tmp_path / "glorys_2020-12-01_2020-12-31.nc"]


@pytest.mark.usefixtures("stranger")
def test_earthdata_that_refuses_the_login(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    client = types.ModuleType("earthaccess")
    client.login = lambda **options: None  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "earthaccess", client)
    monkeypatch.setattr(services, "find_spec", lambda package: object())
    monkeypatch.setenv("EARTHDATA_TOKEN", "expired")
    with pytest.raises(ForcingError, match="refused the login"):
        fetch_product("oscar", tmp_path, **PLACE)


def test_ncep_needs_no_login_and_takes_whole_years(shelf: Shelf, base: str, tmp_path: Path) -> None:
    for year in (2020, 2021):
        for part in ("uwnd", "vwnd"):
            shelf.files[f"/{part}.10m.gauss.{year}.nc"] = CONTENT
    days = {**PLACE, "time": ("2020-12-25", "2021-01-05")}
    paths = fetch_product("ncep-r1", tmp_path, **days, ncep_url=base, progress=False)
    assert [path.name for path in paths] == [
        "uwnd.10m.gauss.2020.nc",
        "vwnd.10m.gauss.2020.nc",
        "uwnd.10m.gauss.2021.nc",
        "vwnd.10m.gauss.2021.nc",
    ]


def test_unknown_service(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="Choose one of: oscar, glorys"):
        fetch_product("hycom", tmp_path, **PLACE)  # type: ignore[arg-type]
