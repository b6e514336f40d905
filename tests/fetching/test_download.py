"""Downloading: cut connections, files that change, wrong checksums, full disks. No network is used."""

from __future__ import annotations

import contextlib
import errno
import gc
import gzip
import hashlib
import io
import shutil
import time
import types
import warnings
from pathlib import Path
from typing import BinaryIO

import pytest

pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")

from fetching.serving import Shelf, answering
from riftberg.errors import ForcingError
from riftberg.fetching import download
from riftberg.fetching.download import Resuming, fetch_one

CONTENT = bytes(range(256)) * 8000
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def shelf() -> Shelf:
    shelf = Shelf()
    shelf.files["/data/field.nc"] = CONTENT
    return shelf


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


def stop(name: str, done: int, total: int) -> None:
    """Stop a fetch as Ctrl-C does, once something has come that is no pointer."""
    if done > 1000:
        raise KeyboardInterrupt


def interrupt(
    folder: Path, base: str, shelf: Shelf, content: bytes, after: int = 1_000_000, *, at: str = "/data/field.nc",
    **options: object,
) -> None:  # fmt: skip
    """Fetch ``content`` with the tag and date that the shelf has now, and stop when so many bytes have come."""
    there, shelf.files[at] = shelf.files[at], content
    with pytest.raises(KeyboardInterrupt):
        fetch_field(folder, base, digest=None, progress=stop, **options)
    shelf.files[at] = there
    shelf.requests.clear()
    (folder / "field.nc.part").write_bytes(content[:after])


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
    kept = []

    def stop_behind(name: str, done: int, total: int) -> None:
        if done >= 500_000:
            kept.append(done)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fetch_field(tmp_path, base, progress=stop_behind)
    assert (tmp_path / "field.nc.part").read_bytes() == CONTENT[: kept[0]]
    assert 500_000 <= kept[0] < len(CONTENT)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests[-1][1] == f"bytes={kept[0]}-"


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
    # One that looks at If-Range sends the whole at once; the other's answer is seen to be of another version.
    assert [asked for _, asked in shelf.requests] == [f"bytes={after}-", *([] if obeys else [""])]


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
    monkeypatch.setattr(time, "sleep", lambda _: shelf.files.__setitem__("/data/field.nc", CONTENT))
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
    truly = download.open_partial
    monkeypatch.setattr(download, "open_partial", lambda path, start: FullDisk(truly(path, start), room))
    with pytest.raises(
        ForcingError, match=r"the disk is full\. Free some space.*what was fetched is kept and continued"
    ):
        fetch_field(tmp_path, base)
    assert not (tmp_path / "field.nc").exists()
    assert (tmp_path / "field.nc.part").read_bytes() == CONTENT[:room]
    monkeypatch.setattr(download, "open_partial", truly)
    assert fetch_field(tmp_path, base, digest=None).read_bytes() == CONTENT
    assert shelf.requests[1:] == [("/data/field.nc", f"bytes={room}-" if room else "")]


@pytest.mark.usefixtures("little_room")
def test_a_write_that_the_system_refuses_keeps_what_was_written(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.etag["/data/field.nc"] = '"first"'
    with pytest.raises(ForcingError, match=r"writing failed .*File too large"):
        fetch_field(tmp_path, base)
    kept = (tmp_path / "field.nc.part").read_bytes()
    assert kept
    assert kept == CONTENT[: len(kept)]


def test_download_that_cannot_fit_is_not_begun(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: types.SimpleNamespace(free=1000))
    with pytest.raises(ForcingError, match="the disk is full"):
        fetch_field(tmp_path, base)
    assert not (tmp_path / "field.nc.part").exists()


def test_folder_that_cannot_be_written(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(path: Path, start: int) -> BinaryIO:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(download, "open_partial", refused)
    with pytest.raises(ForcingError, match=r"cannot be written\. Choose another folder"):
        fetch_field(tmp_path, base)


@pytest.mark.parametrize(("code", "words"), [(404, "is not there"), (403, "wants a login"), (500, "brought nothing")])
def test_refusals_say_what_they_mean(code: int, words: str, shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.status["/data/field.nc"] = code
    with pytest.raises(ForcingError, match=words):
        fetch_field(tmp_path, base, attempts=2)


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:%s\nsize 1\n" % (b"0" * 64)
PAGE, JSON = b"\n <!DOCTYPE html><html>login</html>", b'{"error": "quota"}'
XML = b'<?xml version="1.0"?><Error><Code>NoSuchKey</Code></Error>'
CODED = gzip.compress(CONTENT)[:-50]  # cut before it was sent: the length is right
WRONG_ANSWERS = {
    "unasked part": (
        b"206 OK\r\nContent-Length: 3\r\nContent-Range: bytes 5-7/8\r\n\r\nabc",
        "part of the file that was not",
    ),
    "unasked part, no span": (b"206 OK\r\nContent-Length: 3\r\n\r\nabc", "part of the file that was not"),
    "no content": (b"204 OK\r\n\r\n", r"no file \(HTTP 204"),
    "reset content": (b"205 OK\r\nContent-Length: 0\r\n\r\n", r"no file \(HTTP 205"),
    "accepted": (b"202 OK\r\nContent-Length: 5\r\n\r\nwait.", r"no file \(HTTP 202"),
    "not modified": (b"304 OK\r\n\r\n", r"no file \(HTTP 304"),
    "empty": (b"200 OK\r\nContent-Length: 0\r\n\r\n", "an empty file"),
    "empty in chunks": (b"200 OK\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", "an empty file"),
    "no end": (b"200 OK\r\n\r\nabc", "does not say where the file ends"),
    "length a word": (b"200 OK\r\nContent-Length: abc\r\n\r\nabc", "'abc' for the length"),
    "length below 0": (b"200 OK\r\nContent-Length: -5\r\n\r\nabc", "'-5' for the length"),
    "length a fraction": (b"200 OK\r\nContent-Length: 3.0\r\n\r\nabc", "'3.0' for the length"),
    "gzip that was cut": (
        b"200 OK\r\nContent-Encoding: gzip\r\nContent-Length: %d\r\n\r\n%s" % (len(CODED), CODED),
        "does not say where the file ends",
    ),
    "coding unknown": (
        b"200 OK\r\nContent-Encoding: aes128gcm\r\nContent-Length: 3\r\n\r\nabc",
        "does not say where the file ends",
    ),
    "page": (b"200 OK\r\nContent-Length: %d\r\n\r\n%s" % (len(PAGE), PAGE), "a web page in place of the file"),
    "XML": (b"200 OK\r\nContent-Length: %d\r\n\r\n%s" % (len(XML), XML), "a web page in place of the file"),
    "JSON": (b"200 OK\r\nContent-Length: %d\r\n\r\n%s" % (len(JSON), JSON), "a message in place of the file"),
    "pointer": (b"200 OK\r\nContent-Length: %d\r\n\r\n%s" % (len(POINTER), POINTER), "a pointer of Git LFS in place"),
}


@pytest.mark.parametrize("kind", WRONG_ANSWERS)
def test_an_answer_that_is_not_the_whole_file_is_not_taken_for_it(kind: str, tmp_path: Path) -> None:
    """Bug: each was kept as the file where no checksum is known, or ended in a bare ValueError."""
    answer, words = WRONG_ANSWERS[kind]
    with answering(b"HTTP/1.1 " + answer) as base, pytest.raises(ForcingError, match=words):
        fetch_one("field.nc", None, tmp_path, base, Resuming(attempts=2, pause=0.0, timeout=5.0))
    assert not (tmp_path / "field.nc").exists()


@pytest.mark.parametrize("place", [b"http://[::1", b"http://a..b/", b"http://\xff/", b"//[x/", b"file:///etc/passwd"])
def test_a_redirect_to_what_is_no_address_is_told(place: bytes, tmp_path: Path) -> None:
    """Bug: a bare ValueError, in asking for a newer version too."""
    answer = b"HTTP/1.1 302 OK\r\nLocation: %s\r\nContent-Length: 0\r\n\r\n" % place
    there = tmp_path / "there.nc"
    there.write_bytes(CONTENT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # the client leaves the connection to the collector
        with answering(answer) as base:
            with pytest.raises(ForcingError, match="could not be fetched"):
                fetch_one("field.nc", None, tmp_path, base, Resuming(attempts=2, pause=0.0, timeout=5.0))
            told: list[str] = []
            assert fetch_one("there.nc", None, tmp_path, base, Resuming(), renew=True, tell=told.append) == there
        gc.collect()
    assert "cannot be asked" in told[0]
    assert not (tmp_path / "field.nc").exists()


def test_an_answer_without_an_end_is_taken_where_a_checksum_decides(tmp_path: Path) -> None:
    with answering(b"HTTP/1.0 200 OK\r\n\r\n" + CONTENT) as base:
        assert fetch_one("field.nc", DIGEST, tmp_path, base, Resuming()).read_bytes() == CONTENT


@pytest.mark.parametrize("control", ["\x1b]0;pwned\x07", "\x1b[2J", "\x9b31m"])
def test_what_a_server_says_does_not_steer_the_terminal(control: str, tmp_path: Path) -> None:
    answer = f"HTTP/1.1 500 {control}BAD\r\nContent-Length: 0\r\n\r\n".encode("latin-1")
    with answering(answer) as base, pytest.raises(ForcingError, match="BAD") as caught:
        fetch_one("field.nc", None, tmp_path, base, Resuming(attempts=1))
    assert str(caught.value).isprintable()


def test_a_server_that_sends_less_than_the_rest_is_asked_for_more(
    shelf: Shelf, base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bug: a part of the rest, as some servers send it at a time, was taken for all of it."""
    shelf.etag["/data/field.nc"] = '"first"'
    interrupt(tmp_path, base, shelf, CONTENT)
    shelf.most = 300_000
    assert fetch_field(tmp_path, base, digest=None, pause=0.0).read_bytes() == CONTENT
    assert [asked for _, asked in shelf.requests] == [f"bytes={1_000_000 + 300_000 * k}-" for k in range(4)]


def test_pointer_of_git_lfs_is_followed(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.files["/data/field.nc"] = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    shelf.files["/large/data/field.nc"] = CONTENT
    fetched = fetch_field(tmp_path, base, large_files=lambda url: url.replace("/data/", "/large/data/"))
    assert fetched.read_bytes() == CONTENT


def test_large_file_behind_a_pointer_is_continued_by_the_next_run(shelf: Shelf, base: str, tmp_path: Path) -> None:
    """Its pointer has another address, tag and size: asked for the rest of that, a server answered 416."""
    shelf.files["/data/field.nc"] = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    shelf.files["/large/data/field.nc"] = CONTENT
    shelf.etag = {"/data/field.nc": '"pointer"', "/large/data/field.nc": '"large"'}
    interrupt(tmp_path, base, shelf, CONTENT, at="/large/data/field.nc", large_files=large)
    fetched = fetch_field(tmp_path, base, digest=None, large_files=lambda url: url.replace("/data/", "/large/data/"))
    assert fetched.read_bytes() == CONTENT
    assert shelf.requests == [("/large/data/field.nc", "bytes=1000000-")]


def pointer_to(content: bytes) -> bytes:
    digest = hashlib.sha256(content).hexdigest()
    return f"version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize {len(content)}\n".encode()


def large(url: str) -> str:
    return url.replace("/data/", "/large/data/")


def test_a_large_file_must_have_the_checksum_that_its_pointer_names(shelf: Shelf, base: str, tmp_path: Path) -> None:
    """The hourly fields of the paper were fetched without any: one changed byte of 150 MB went unnoticed."""
    shelf.files["/data/field.nc"] = pointer_to(CONTENT)
    shelf.files["/large/data/field.nc"] = CONTENT[:-1] + b"?"
    with pytest.raises(ForcingError, match=r"its checksum is wrong: the pointer at .*/data/field\.nc names sha256"):
        fetch_field(tmp_path, base, digest=None, large_files=large)
    assert list(tmp_path.iterdir()) == []
    shelf.files["/large/data/field.nc"] = CONTENT
    assert fetch_field(tmp_path, base, digest=None, large_files=large).read_bytes() == CONTENT


def test_a_large_file_whose_first_part_was_damaged_on_the_disk_is_found_out(
    shelf: Shelf, base: str, tmp_path: Path
) -> None:
    """The checksum of the pointer is kept with the part, for the run that continues it."""
    shelf.files["/data/field.nc"] = pointer_to(CONTENT)
    shelf.files["/large/data/field.nc"] = CONTENT
    shelf.etag = {"/large/data/field.nc": '"large"'}
    interrupt(tmp_path, base, shelf, CONTENT, at="/large/data/field.nc", large_files=large)
    (tmp_path / "field.nc.part").write_bytes(b"?" + CONTENT[1:1_000_000])
    with pytest.raises(ForcingError, match="its checksum is wrong"):
        fetch_field(tmp_path, base, digest=None, large_files=large)
    assert shelf.requests == [("/large/data/field.nc", "bytes=1000000-")]
    assert list(tmp_path.iterdir()) == []


def test_a_large_file_cut_on_its_way_is_continued_and_has_its_checksum(shelf: Shelf, base: str, tmp_path: Path) -> None:
    shelf.files["/data/field.nc"] = pointer_to(CONTENT)
    shelf.files["/large/data/field.nc"] = CONTENT
    shelf.etag = {"/large/data/field.nc": '"large"'}
    shelf.cut_after, shelf.cuts = 900_000, 1
    assert fetch_field(tmp_path, base, digest=None, large_files=large).read_bytes() == CONTENT


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
