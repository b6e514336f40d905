"""Downloading that survives cut connections: parts are kept and continued, checksums decide, errors say what to do.

Beside each unfinished part stands a record of the version of the file that it belongs to. A part is continued only if the
server says that the file is still the one that was begun: by its strong ETag or its date, sent back as ``If-Range``, and
by the size of the whole file. Anything else would splice two versions.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC
from email.utils import parsedate_to_datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from riftberg.errors import ForcingError
from riftberg.system.atomic_files import only_writer
from riftberg.system.input_files import is_of_macos, reading, value_shown
from riftberg.system.process import say

if TYPE_CHECKING:
    import requests

BLOCK = 1 << 18
Progress = Callable[[str, int, int], None]
"""Called with name, bytes so far and bytes in all (0 = unknown)."""
Tell = Callable[[str], None]
"""Called with a word for the person who fetches."""
_POINTER = b"version https://git-lfs.github.com/spec/v1"


def missing_package(package: str, extra: str, purpose: str) -> ForcingError:
    """Return the error that names the package that a purpose needs, and the extra of Riftberg that brings it."""
    return ForcingError(
        f"{package} is not installed, which is needed {purpose}", remedy=f"pip install 'riftberg[{extra}]' brings it"
    )


def tell_terminal(text: str) -> None:
    """Write a word to the person at the terminal, beside the results."""
    say(text)


WITHOUT_NETWORK: Final = 2
"""Attempts in a row without any connection, after which there is no network or no such server."""


def reached(error: Exception) -> bool:
    """Whether a server was reached at all before an attempt failed."""
    from urllib3.exceptions import NewConnectionError

    cause = error.args[0] if error.args else None
    return not isinstance(getattr(cause, "reason", cause), NewConnectionError)


def _describe_kept(partial: PartFile) -> str:
    """Describe the part that is kept of a file that could not be fetched whole."""
    version = partial.version
    continued = partial.size and version is not None and version.validator
    return f": {partial.size / 1e6:.1f} MB are kept and will be continued" if continued else ""


class Resuming:
    """Downloader that continues a part left by an earlier attempt."""

    def __init__(
        self,
        progress: Progress | None = None,
        attempts: int = 5,
        timeout: float = 60.0,
        large_files: Callable[[str], str] | None = None,
        pause: float = 1.0,
    ) -> None:
        self.progress, self.attempts, self.timeout = progress, attempts, timeout
        self.large_files, self.pause = large_files, pause

    def __call__(self, url: str, target: Path, *, checked: bool = False) -> None:
        """Fetch ``url`` into a file; ``checked``: the caller finds out whether it is whole, by a checksum or its content."""
        if find_spec("requests") is None or find_spec("tqdm") is None:
            raise missing_package("requests or tqdm", "fetch", "to fetch files")
        path = partial_path(target.parent, url)
        with only_writer(path):
            large = self.large_files(url) if self.large_files is not None else url
            partial = PartFile(path, large)
            if partial.version is None:
                partial = PartFile(path, url)
            else:  # an earlier run has followed the pointer already, and noted its checksum
                partial.sha256 = partial.version.sha256
            self.fetch(partial, checked=checked or bool(partial.sha256))
            # The server has sent the pointer instead of the file that it stands for.
            if partial.url != large and is_pointer(path):
                # The sha256 that a pointer of Git LFS names; empty where it names none.
                match = re.search(
                    r"^oid sha256:([0-9a-f]{64})$", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE
                )
                partial = PartFile(path, large, (match[1] if match else ""))
                partial.drop()
                self.fetch(partial, checked=checked or bool(partial.sha256))
            if message := _server_message(path):
                partial.drop()
                raise ForcingError(
                    f"the server sent {message} in place of the file", where=partial.url,
                    remedy="Run again later; if it stays so, the file is not to be had there, or not without a login",
                )  # fmt: skip
            if not partial.is_whole():
                partial.drop()
                raise ForcingError(
                    f"its checksum is wrong: the pointer at {url} names sha256 {partial.sha256[:12]}...", where=partial.url,
                    remedy="The file has changed at its source or on the way: run again; if it stays wrong, do not use it",
                )  # fmt: skip
            partial.finish(target)

    def fetch(self, partial: PartFile, *, checked: bool) -> None:
        """Fetch the whole of a part's file, continuing the part on disk if the server still has its version."""
        import requests

        version = partial.version
        if version is None or not version.validator:
            partial.drop()  # nothing says to which version it belongs
        vain = 0
        reason: object = "the connection was cut"
        while vain < self.attempts:
            previous = partial.size
            try:
                if self._continue(partial, checked=checked):
                    return
            except (requests.RequestException, ValueError) as error:  # the latter of a redirect to what is no address
                reason = error
                if not reached(error) and vain + 1 >= WITHOUT_NETWORK:
                    raise ForcingError(
                        f"could not be fetched, no connection is to be had ({reason})",
                        where=partial.url,
                        remedy=f"Check the network and run again{_describe_kept(partial)}",
                    ) from error
            except OSError as error:
                # The error that tells what the disk said.
                if error.errno in (errno.ENOSPC, errno.EDQUOT):
                    fault, remedy = (
                        "the disk is full",
                        "Free some space, or choose another folder; what was fetched is kept and continued",
                    )
                elif error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
                    fault, remedy = "the folder cannot be written", "Choose another folder"
                else:
                    fault, remedy = f"writing failed ({error})", "Check the disk"
                raise ForcingError(fault, where=str(partial.path.parent), remedy=remedy) from error
            # Attempts that brought something do not count: a slow line may be cut many times.
            vain = 0 if partial.size > previous else vain + 1
            time.sleep(self.pause * vain if vain < self.attempts else 0.0)
        raise ForcingError(
            f"could not be fetched, {self.attempts} attempts in a row brought nothing ({reason})",
            where=partial.url,
            remedy=f"Check the network and run again{_describe_kept(partial)}",
        )

    def changed(self, url: str, path: Path) -> str | None:
        """Ask the server whether it has another version of a file than the one that is there."""
        import requests

        asking = {"Accept-Encoding": "identity"}
        try:
            answer = requests.head(url, headers=asking, allow_redirects=True, timeout=min(self.timeout, 15.0))
            answer.raise_for_status()
            have, size = path.stat(), _length(answer)
        except (requests.RequestException, ValueError, ForcingError):
            return None
        dated = seconds(answer.headers.get("Last-Modified", ""))
        if size and size != have.st_size:
            return f"{size:,} bytes there, {have.st_size:,} here"
        if dated is not None and dated > have.st_mtime + 1.0:
            return f"it was written anew there on {answer.headers['Last-Modified']}"
        return "" if size or dated is not None else None

    def _continue(self, partial: PartFile, *, checked: bool) -> bool:
        """Fetch the rest of a file; tell whether it is complete."""
        import requests

        version = partial.version
        if version is None or not (version.validator or version.total):
            partial.drop()  # nothing would tell whether what is to come belongs to what is there
        have = partial.size
        headers = {"Accept-Encoding": "identity"}
        if have and version is not None:
            headers["Range"] = f"bytes={have}-"
            if version.validator:
                headers["If-Range"] = version.validator
        with requests.get(partial.url, headers=headers, stream=True, timeout=self.timeout) as answer:
            code = answer.status_code
            if version is not None and have and code in (206, 416):
                first, total = content_range(answer.headers)
                other = Version.told(partial.url, answer.headers, total).contradicts(version)
                # The range asked for begins behind the end: all bytes are there.
                if code == 416 and (total or version.total) == have and not other:
                    return True  # nothing is left to fetch
                if code == 416 or first != have or other:
                    partial.drop()
                    return self._continue(partial, checked=checked)
            _check_status(answer, partial.url, part_asked="Range" in headers)
            # A server that does not know ranges answers 200 with the whole file.
            start = have if code == 206 else 0
            length = _length(answer)
            if not checked and not _tells_end(answer):
                raise ForcingError(
                    "the server does not say where the file ends, so a cut connection would pass for its end",
                    where=partial.url, remedy="Fetch it with a browser or by hand, and compare its size with the source",
                )  # fmt: skip
            # A server may send less than the rest that was asked for.
            promised = [version.total, content_range(answer.headers)[1]] if start and version is not None else []
            total = max(start + length, *promised, 0) if length else max(promised, default=0)
            # Refuse a download that cannot fit before it fills the disk.
            free = shutil.disk_usage(partial.path.parent).free
            if length > free:
                raise OSError(errno.ENOSPC, f"{length / 1e6:.0f} MB are to come, {free / 1e6:.0f} MB are free")
            if start == 0:
                partial.begin(Version.told(partial.url, answer.headers, total))
            written = self._write(answer, partial.path, start, total)
        if not written:
            partial.drop()
            raise ForcingError("the server sent an empty file", where=partial.url, remedy="Run again later")
        return total == 0 or written >= total

    def _write(self, answer: requests.Response, path: Path, start: int, total: int) -> int:
        """Write the answer behind the first ``start`` bytes of ``path``; return the size reached."""
        written = start
        with open_partial(path, start) as stream:
            for block in answer.iter_content(BLOCK):
                stream.write(block)
                written += len(block)
                if self.progress is not None:
                    self.progress(path.name.removesuffix(".part"), written, total)
        return written


def open_partial(path: Path, start: int) -> BinaryIO:
    """Open a part for writing behind its first ``start`` bytes."""
    stream = path.open("r+b" if start else "wb")
    stream.seek(start)
    return stream


def _length(answer: requests.Response) -> int:
    """Return how many bytes are to come; 0 = not told."""
    stated = answer.headers.get("Content-Length", "0").strip()
    if not re.fullmatch("[0-9]{1,18}", stated):
        raise ForcingError(
            f"the server gives {value_shown(stated)} for the length of the file",
            where=answer.url,
            remedy="Run again later",
        )
    return 0 if _is_coded(answer) else int(stated)


def _is_coded(answer: requests.Response) -> bool:
    """Whether a server sends the file in another form, such as gzip, though none was asked for."""
    return answer.headers.get("Content-Encoding", "identity").strip().lower() not in ("", "identity")


def _tells_end(answer: requests.Response) -> bool:
    """Whether a cut connection can be told from the end of a file: by its length, or the last of its chunks."""
    if _is_coded(answer):  # these tell the end of the coded form, which may have been cut before
        return False
    chunked = "chunked" in answer.headers.get("Transfer-Encoding", "").lower()
    return chunked or "Content-Length" in answer.headers


def partial_path(folder: Path, url: str) -> Path:
    """Return where the unfinished part of ``url`` is kept."""
    return folder / f"{url.rsplit('/', 1)[-1].split('?')[0]}.part"


def is_pointer(path: Path) -> bool:
    """Tell whether a file is a Git LFS pointer instead of the data."""
    with path.open("rb") as stream:
        return stream.read(len(_POINTER)) == _POINTER


_PAGE: Final = re.compile(rb"(\xef\xbb\xbf)?\s*<(!doctype|!--|html|head|body|script|\?xml|error)\b", re.IGNORECASE)
_JSON: Final = re.compile(rb"(\xef\xbb\xbf)?\s*\{\s*\"")


def _server_message(path: Path) -> str:
    """Return the message of the server that has come in place of a file, with a status of success."""
    with path.open("rb") as stream:
        begin = stream.read(512)
    if begin.startswith(_POINTER):
        return "a pointer of Git LFS"
    return "a web page" if _PAGE.match(begin) else "a message" if _JSON.match(begin) else ""


def _check_status(answer: requests.Response, url: str, *, part_asked: bool) -> None:
    code = answer.status_code
    if code in (401, 403):
        raise ForcingError(
            f"the server wants a login (HTTP {code})", where=url, remedy="Give credentials for this service"
        )
    if code in (404, 410):
        raise ForcingError(
            f"the file is not there (HTTP {code})",
            where=url,
            remedy="Check the base address, or whether the source has moved",
        )
    answer.raise_for_status()
    if code != 200 and not (code == 206 and part_asked):
        content = "a part of the file that was not asked for" if code == 206 else "no file"
        raise ForcingError(f"the server sent {content} (HTTP {code})", where=url, remedy="Run again later")


class Bar:
    """Progress of downloads on one line of a terminal; silent when the output is no terminal."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._name = ""

    def __call__(self, name: str, received: int, total: int) -> None:
        """Show that ``received`` of ``total`` bytes of ``name`` are there."""
        from tqdm import tqdm  # type: ignore[import-untyped, unused-ignore]

        if name != self._name:
            self.close()
            self._name = name
            self._bar = tqdm(desc=name[-50:], total=total or None, unit="B", unit_scale=True, disable=None)
        self._bar.total = total or None  # another one where a fetch had to start anew
        self._bar.update(received - self._bar.n)

    def close(self) -> None:
        """End the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


@contextmanager
def show_progress(progress: Progress | bool) -> Iterator[Progress | None]:
    """Give a display of progress: a bar (True), the given one, or none (False); the bar ends with the block."""
    bar = Bar() if progress is True else None
    try:
        yield bar or (progress if callable(progress) else None)
    finally:
        if bar is not None:
            bar.close()


def made(folder: Path) -> Path:
    """Return the folder, made if absent."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ForcingError(
            f"the folder cannot be made ({error.strerror})", where=str(folder), remedy="Choose another"
        ) from error
    return folder


def fetch_one(
    name: str,
    digest: str | None,
    folder: Path,
    base_url: str,
    downloader: Resuming,
    *,
    renew: bool = False,
    tell: Tell = tell_terminal,
) -> Path:
    """Fetch one file unless it is there and right."""
    url, target = base_url + name, folder / name.rsplit("/", 1)[-1]
    if digest is None and target.exists():
        changed = downloader.changed(url, target) if renew else ""
        if changed is None:
            tell(f"{target.name}: its source cannot be asked whether it has changed; the file that is there is used")
        elif changed:  # the old one stays until the new one is complete
            tell(f"{target.name} has changed at its source ({changed}): it is fetched again")
            downloader(url, target)
        return target
    if digest is None or not target.exists() or checksum(target) != digest:
        downloader(url, target, checked=digest is not None)
    if digest is not None and (got := checksum(target)) != digest:
        target.unlink()
        raise ForcingError(
            f"its checksum is wrong: sha256 is {got[:12]}... and not {digest[:12]}...",
            where=url,
            remedy="The file has changed at its source or on the way: run again; if it stays wrong, do not use it",
        )
    return target


def unpacked(archive: Path, ending: str, most: float = math.inf) -> list[tuple[str, bytes]]:
    """Return names and contents of the files with an ending in a fetched zip archive; a useless one is removed.

    ``most``: bytes that they may have together.
    """
    remedy = "It was removed: run the same command again"
    try:
        with reading(archive, "a damaged zip archive", remedy, ForcingError), zipfile.ZipFile(archive) as opened:
            files = [m for m in opened.infolist() if not (m.is_dir() or is_of_macos(m.filename))]
            members = [member for member in files if member.filename.lower().endswith(ending)]
            size = sum(member.file_size for member in members)
            if not members or size > most:
                content = f"{size / 1e6:.0f} MB of {ending} files" if members else f"no {ending} files"
                raise ForcingError(f"the archive holds {content}", where=str(archive), remedy=remedy)
            return [(member.filename, opened.read(member)) for member in members]
    except ForcingError:
        archive.unlink(missing_ok=True)
        raise


def checksum(path: Path) -> str:
    """Return the checksum of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


_RANGE = re.compile(r"bytes\s+(?:(?P<first>\d+)-\d+|\*)/(?P<total>\d+|\*)")


@dataclass(frozen=True)
class Version:
    """Version of a file, as the server states it."""

    url: str  # Address
    etag: str = ""  # Its tag for this version; empty = not told
    modified: str = ""  # Its date of change, as told; empty = not told
    total: int = 0  # Size of the whole file (bytes); 0 = not told
    sha256: str = ""  # Of the whole file, where a pointer of Git LFS names it; empty = not told

    @classmethod
    def told(cls, url: str, headers: Mapping[str, str], total: int) -> Version:
        """Return the version that the headers of an answer name."""
        return cls(url, headers.get("ETag", ""), headers.get("Last-Modified", ""), total)

    @property
    def validator(self) -> str:
        """Value for ``If-Range``: a strong tag, else the date, else nothing (weak tags are not allowed there)."""
        return self.etag if self.etag and not self.etag.startswith("W/") else self.modified

    def contradicts(self, other: Version) -> bool:
        """Tell whether something of the two shows them to be different versions."""
        if self.url != other.url or (self.total and other.total and self.total != other.total):
            return True
        if self.etag and other.etag:
            return self.etag.removeprefix("W/") != other.etag.removeprefix("W/")
        return bool(self.modified and other.modified and self.modified != other.modified)


class PartFile:
    """An unfinished file and its record."""

    def __init__(self, path: Path, url: str, sha256: str = "") -> None:
        self.path, self.url, self.sha256 = path, url, sha256
        self.record = path.with_name(f"{path.name}.json")

    @property
    def size(self) -> int:
        """Bytes that are there."""
        return self.path.stat().st_size if self.path.exists() else 0

    @property
    def version(self) -> Version | None:
        """The version that the bytes belong to; None if that is not known, or the file of another address."""
        try:
            version = Version(**json.loads(self.record.read_text()))
        except (OSError, ValueError, TypeError):
            return None
        return version if version.url == self.url else None

    def begin(self, version: Version) -> None:
        """Drop the old part and note the version to come."""
        self.drop()
        self.record.write_text(json.dumps({**asdict(version), "sha256": self.sha256}))

    def is_whole(self) -> bool:
        """Whether the bytes have the checksum that was told for them, if one was."""
        return not self.sha256 or checksum(self.path) == self.sha256

    def drop(self) -> None:
        """Drop the part; its bytes first, so that no record is left beside bytes of another version."""
        self.path.unlink(missing_ok=True)
        self.record.unlink(missing_ok=True)

    def finish(self, target: Path) -> None:
        """Move the complete file to its place, with the date of change that the server told, as ``wget`` does."""
        version = self.version
        stamp = seconds(version.modified) if version else None
        if stamp is not None:
            os.utime(self.path, (stamp, stamp))
        shutil.move(self.path, target)
        self.record.unlink(missing_ok=True)


def content_range(headers: Mapping[str, str]) -> tuple[int | None, int]:
    """Return the first byte of a partial answer (None = not told) and the size of the whole file (0 = not told)."""
    match = _RANGE.fullmatch(headers.get("Content-Range", "").strip())
    if match is None:
        return None, 0
    first, total = match["first"], match["total"]
    return (None if first is None else int(first)), (0 if total == "*" else int(total))


def seconds(date: str) -> float | None:
    """Return a date of HTTP as seconds since 1970; None if it is none."""
    try:
        moment = parsedate_to_datetime(date)
    except (TypeError, ValueError):
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
