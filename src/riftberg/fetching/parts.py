"""The unfinished part of a download, and the record beside it of the version of the file that it belongs to.

A part is continued only if the server says that the file is still the one that was begun: by its strong ETag or its
date, sent back as ``If-Range``, and by the size of the whole file. Anything else would splice two versions.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC
from email.utils import parsedate_to_datetime
from pathlib import Path

_RANGE = re.compile(r"bytes\s+(?:(?P<first>\d+)-\d+|\*)/(?P<total>\d+|\*)")


@dataclass(frozen=True)
class Version:
    """What a server tells of the version of a file."""

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
        """What ``If-Range`` may carry: a strong tag, else the date, else nothing (weak tags are not allowed there)."""
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
        """Throw away what is there and note the version that is to come."""
        self.drop()
        self.record.write_text(json.dumps({**asdict(version), "sha256": self.sha256}))

    def is_whole(self) -> bool:
        """Whether the bytes have the checksum that was told for them, if one was."""
        if not self.sha256:
            return True
        with self.path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == self.sha256

    def drop(self) -> None:
        """Throw away what is there; the bytes first, so that no record is left beside bytes of another version."""
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
