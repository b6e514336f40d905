"""Fetching: cut connections, wrong checksums, full disks, damaged parts, missing logins. No network is used."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import netCDF4
import numpy as np
import pytest

pytest.importorskip("pooch", reason="needs the extra riftberg[fetch]")
pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")
pytest.importorskip("cf_xarray", reason="needs the extra riftberg[products]")

import requests

from ocean.serving import Shelf, serving
from riftberg.errors import ForcingError
from riftberg.ocean import download, fetch, services
from riftberg.ocean.download import Resuming, fetch_one
from riftberg.ocean.parts import Part, Version
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


OLD = bytes(reversed(range(256))) * 8000
"""An earlier version of the file, of the same length."""


def interrupt(folder: Path, base: str, shelf: Shelf, content: bytes, after: int = 1_000_000) -> None:
    """Leave what a fetch of ``content`` that was cut for good leaves, with the tag and date that the shelf has now."""
    part = Part(folder / "field.nc.part", f"{base}data/field.nc")
    told = {"ETag": shelf.etag.get("/data/field.nc", ""), "Last-Modified": shelf.modified.get("/data/field.nc", "")}
    part.begin(Version.told(part.url, told, len(content)))
    part.path.write_bytes(content[:after])


TAGS = {"etag": '"first"', "modified": "Wed, 16 Dec 2020 12:00:00 GMT"}


@pytest.mark.parametrize("kind", TAGS)
def test_interrupted_run_is_continued_by_the_next(kind: str, shelf: Shelf, base: str, tmp_path: Path) -> None:
    getattr(shelf, kind)["/data/field.nc"] = TAGS[kind]
    interrupt(tmp_path, base, shelf, CONTENT)
    assert fetch_field(tmp_path, base).read_bytes() == CONTENT
    assert shelf.requests == [("/data/field.nc", "bytes=1000000-")]
    assert [path.name for path in tmp_path.iterdir()] == ["field.nc"]


def test_a_cut_fetch_leaves_a_record_with_which_the_next_continues(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    shelf.cut_after, shelf.cuts = 900_000, 1
    part = Part(tmp_path / "field.nc.part", f"{base}data/field.nc")
    with contextlib.suppress(requests.RequestException):
        Resuming()._continue(part)
    assert 500_000 < part.size <= 900_000
    assert part.version == Version(part.url, '"first"', "", len(CONTENT))
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests[-1][1].startswith("bytes=")


@pytest.mark.parametrize("spans", [True, False])
@pytest.mark.parametrize("kind", TAGS)
def test_part_that_was_complete_already(kind: str, spans: bool, shelf: Shelf, base: str, tmp_path: Path) -> None:
    getattr(shelf, kind)["/data/field.nc"] = TAGS[kind]
    shelf.spans = spans
    interrupt(tmp_path, base, shelf, CONTENT, after=len(CONTENT))
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests == [("/data/field.nc", f"bytes={len(CONTENT)}-")]


def test_server_without_ranges_starts_anew(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    shelf.ranges = False
    interrupt(tmp_path, base, shelf, CONTENT)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests == [("/data/field.nc", "bytes=1000000-")]


@pytest.mark.parametrize("size", [400, 2_048_000, 4_000_000])
def test_part_without_a_record_is_not_trusted(size: int, shelf: Shelf, base: str, tmp_path: Path) -> None:
    """Longer than the file it got 416 and passed for complete; shorter its bytes were spliced to the new tail."""
    (tmp_path / "field.nc.part").write_bytes(b"G" * size)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests == [("/data/field.nc", "")]


@pytest.mark.parametrize("obeys", [True, False])
@pytest.mark.parametrize("kind", TAGS)
@pytest.mark.parametrize("old", [OLD, OLD + OLD[:1000], OLD[:1_500_000]])
@pytest.mark.parametrize("after", [400, 1_499_000])
def test_part_of_an_older_version_starts_anew(
    after: int, old: bytes, kind: str, obeys: bool, shelf: Shelf, base: str, tmp_path: Path
) -> None:
    """Whether the server looks at If-Range or not, and whether the size has changed or not."""
    getattr(shelf, kind)["/data/field.nc"] = TAGS[kind]
    interrupt(tmp_path, base, shelf, old, after)
    getattr(shelf, kind)["/data/field.nc"] = {"etag": '"second"', "modified": "Thu, 17 Dec 2020 12:00:00 GMT"}[kind]
    shelf.if_range = obeys
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests[0] == ("/data/field.nc", f"bytes={after}-")


@pytest.mark.parametrize("obeys", [True, False])
@pytest.mark.parametrize("spans", [True, False])
def test_part_longer_than_the_file_starts_anew(
    spans: bool, obeys: bool, shelf: Shelf, base: str, tmp_path: Path
) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    interrupt(tmp_path, base, shelf, OLD + OLD, after=3_000_000)
    shelf.etag["/data/field.nc"] = '"second"'
    shelf.if_range, shelf.spans = obeys, spans
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT


def test_server_that_tells_no_span_is_not_trusted_with_the_rest(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    shelf.spans = False
    interrupt(tmp_path, base, shelf, CONTENT)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert [asked for _, asked in shelf.requests] == ["bytes=1000000-", ""]


@pytest.mark.parametrize("tag", ["", 'W/"weak"'])
def test_server_without_a_strong_tag_or_date_begins_anew_in_the_next_run(
    tag: str, shelf: Shelf, base: str, tmp_path: Path
) -> None:
    if tag:
        shelf.etag["/data/field.nc"] = tag
    interrupt(tmp_path, base, shelf, OLD)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests == [("/data/field.nc", "")]


def test_file_that_changes_between_two_cuts_is_not_spliced(
    shelf: Shelf, base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a tag the size alone tells, within a run."""
    shelf.files["/data/field.nc"] = OLD + OLD[:1000]
    shelf.cut_after, shelf.cuts = 900_000, 1
    monkeypatch.setattr(download.time, "sleep", lambda _: shelf.files.__setitem__("/data/field.nc", CONTENT))
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert len(shelf.requests) == 3


def test_a_fetched_file_bears_the_date_of_its_source(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.modified["/data/field.nc"] = TAGS["modified"]
    assert fetch_field(tmp_path, base).stat().st_mtime == 1608120000.0


def test_dead_connection_gives_up_and_keeps_what_came(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    interrupt(tmp_path, base, shelf, CONTENT)
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


class FullDisk:
    """A stream to a disk that takes ``room`` bytes: as the system does, it writes what fits, then refuses."""

    def __init__(self, stream: BinaryIO, room: int) -> None:
        self.stream, self.room = stream, room

    def write(self, block: bytes) -> int:
        fits = min(self.room, len(block))
        self.stream.write(block[:fits])
        self.room -= fits
        if fits < len(block):
            raise OSError(errno.ENOSPC, "No space left on device")
        return fits

    def __enter__(self) -> FullDisk:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stream.close()


@pytest.mark.parametrize("room", [0, 700_001])
def test_full_disk_keeps_what_was_written_and_the_next_run_continues(
    room: int, shelf: Shelf, base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    truly = download.opened
    monkeypatch.setattr(download, "opened", lambda path, start: FullDisk(truly(path, start), room))
    with pytest.raises(
        ForcingError, match=r"the disk is full\. Free some space.*what was fetched is kept and continued"
    ):
        fetch_field(tmp_path, base)
    assert not (tmp_path / "field.nc").exists()
    assert (tmp_path / "field.nc.part").read_bytes() == CONTENT[:room]
    monkeypatch.setattr(download, "opened", truly)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests[1:] == [("/data/field.nc", f"bytes={room}-" if room else "")]


@pytest.fixture
def little_room() -> Iterator[None]:
    """Let no file of this process grow beyond 300 kB: writes that the system itself refuses."""
    resource = pytest.importorskip("resource", reason="needs limits of the system")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("little_room")
def test_a_write_that_the_system_refuses_keeps_what_was_written(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    with pytest.raises(ForcingError, match=r"writing failed .*File too large"):
        fetch_field(tmp_path, base)
    kept = (tmp_path / "field.nc.part").read_bytes()
    assert kept
    assert kept == CONTENT[: len(kept)]


def test_download_that_cannot_fit_is_not_begun(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download.shutil, "disk_usage", lambda folder: types.SimpleNamespace(free=1000))
    with pytest.raises(ForcingError, match="the disk is full"):
        fetch_field(tmp_path, base)
    assert not (tmp_path / "field.nc.part").exists()


def test_folder_that_cannot_be_written(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(path: Path, start: int) -> BinaryIO:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(download, "opened", refused)
    with pytest.raises(ForcingError, match=r"cannot be written\. Choose another folder"):
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


class Terminal(io.StringIO):
    """What a terminal was told."""

    def isatty(self) -> bool:
        return True


def shown(*told: tuple[str, int, int]) -> str:
    """Return what a bar writes to a terminal."""
    terminal = Terminal()
    with contextlib.redirect_stderr(terminal):
        bar = download.Bar()
        for name, done, total in told:
            bar(name, done, total)
        bar.close()
    return terminal.getvalue()


def test_bar_shows_one_file_after_another() -> None:
    text = shown(("a.nc", 1000, 4000), ("a.nc", 4000, 4000), ("b.nc", 5000, 0))
    first, second = (line.split("\r")[-1] for line in text.rstrip("\n").split("\n"))
    assert first.startswith("a.nc: 100%")
    assert "4.00k/4.00k" in first
    assert second.startswith("b.nc: 5.00kB")  # no share where the size is not told


def test_bar_follows_a_fetch_that_starts_anew() -> None:
    text = shown(("a.nc", 3000, 4000), ("a.nc", 100, 2000), ("a.nc", 2000, 2000))
    assert "2.00k/2.00k" in text.split("\r")[-1]


def test_bar_is_silent_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    bar = download.Bar()
    bar("a.nc", 1000, 4000)
    bar.close()
    assert capsys.readouterr().err == ""


# ---- the paper's inputs ----------------------------------------------------------------------------------------------


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
    assert fetch._in_order(parts) == parts  # its header and stamps are well
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


EXTRAS = {"earthaccess": "oscar", "copernicusmarine": "copernicus", "cdsapi": "era5"}
CLIENTS = [("oscar", "earthaccess"), ("glorys", "copernicusmarine"), ("duacs", "copernicusmarine"), ("era5", "cdsapi")]


@pytest.mark.parametrize(("name", "package"), CLIENTS)
def test_missing_client_is_named(name: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "find_spec", lambda package: None)
    with pytest.raises(ForcingError, match=rf"{package} is not installed.*pip install 'riftberg\[{EXTRAS[package]}\]'"):
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
