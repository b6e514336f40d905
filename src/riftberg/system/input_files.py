"""What may be opened as an input file, and how whatever goes wrong in reading it becomes one sentence.

A path may be missing, a folder, a device that never ends, a pipe that never begins, or as large as the disk; the
libraries that read formats raise errors of every kind on a damaged file. Every reader of the house passes through here.
"""

from __future__ import annotations

import importlib
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from riftberg.errors import InputError, RiftbergError
from riftberg.system.limits import human, refuse_large

_KINDS: Final = (
    (stat.S_ISDIR, "a folder, not a file"),
    (stat.S_ISCHR, "a device, not a file"),
    (stat.S_ISBLK, "a device, not a file"),
    (stat.S_ISFIFO, "a pipe, not a file"),
    (stat.S_ISSOCK, "a socket, not a file"),
)

_MOST_MEMBERS: Final = 1000
"""Files in an archive."""


def check_file(
    path: str | Path,
    *,
    remedy: str,
    most: float | None = None,
    kind: type[InputError] = InputError,
    missing: str = "no such file",
) -> Path:
    """Return the path of a plain file that is there, not empty and not too large; else raise ``kind``."""
    path = Path(path)
    where = shown(path)
    try:
        status = path.stat()
    except FileNotFoundError as error:
        raise kind(missing, where=where, remedy=remedy) from error
    except (OSError, ValueError) as error:  # a part of it is a file, a name too long, a zero byte, a circle of links
        raise kind(f"cannot be opened ({_reason(error)})", where=where, remedy=remedy) from error
    if what := _odd_kind(status.st_mode):
        raise kind(what, where=where, remedy=remedy)
    if status.st_size == 0:
        raise kind("the file is empty", where=where, remedy=remedy)
    if most is not None:
        refuse_large(
            status.st_size, most, f"bytes of input ({human(status.st_size)})", where=where, remedy=remedy, kind=kind
        )
    try:
        with path.open("rb") as file:
            file.read(1)
    except OSError as error:
        raise kind(f"cannot be opened ({_reason(error)})", where=where, remedy=remedy) from error
    return path


def _odd_kind(mode: int) -> str:
    return next((what for is_kind, what in _KINDS if is_kind(mode)), "")


def no_plain_file(path: str | Path) -> str:
    """Return what a path is that is there but no plain file, such as a pipe that would be waited for; else nothing."""
    try:
        return _odd_kind(Path(path).stat().st_mode)
    except (OSError, ValueError):
        return ""


def is_address(path: object) -> bool:
    """Whether a text names something on the network, which no path of this machine is made of."""
    return "://" in str(path)


def in_folder(folder: Path, name: str) -> str:
    """Return a file that is named from a folder; an address stays as it is."""
    return name if is_address(name) else str(folder / name)


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; a path that cannot be looked at is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


@contextmanager
def reading(where: object, what: str, remedy: str, kind: type[InputError] = InputError) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into one sentence that names the file."""
    try:
        yield
    except RiftbergError:
        raise
    except MemoryError as error:
        raise kind("asks for more memory than there is", where=shown(where), remedy=remedy) from error
    except (TypeError, AttributeError, IndexError) as error:  # their texts speak of Python
        raise kind(what, where=shown(where), remedy=remedy) from error
    except Exception as error:  # libraries raise what they like: struct.error, KeyError, zlib.error, UnicodeError ...
        reason = _reason(error)
        # What xarray says where no reader knows a file is a list of its own parts.
        raise kind(what if "xarray's" in reason else f"{what} ({reason})", where=shown(where), remedy=remedy) from error


def check_archive(path: Path, most: float, *, remedy: str, kind: type[InputError] = InputError) -> list[str]:
    """Return the names in a zip archive that may be unpacked: few, small, and inside the archive's own folder."""
    with reading(path, "not a zip archive, or a damaged one", remedy, kind), zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if not members:
        raise kind("an empty archive", where=shown(path), remedy=remedy)
    if len(members) > _MOST_MEMBERS:
        raise kind(f"an archive of {len(members)} files", where=shown(path), remedy=remedy)
    for member in members:
        if member.filename.startswith(("/", "\\")) or ".." in Path(member.filename.replace("\\", "/")).parts:
            raise kind(
                f"the archive holds a path outside itself, {member.filename!r}", where=shown(path), remedy=remedy
            )
        if member.flag_bits & 1:
            raise kind(f"{member.filename} in the archive is encrypted", where=shown(path), remedy=remedy)
    size = sum(member.file_size for member in members)
    refuse_large(size, most, f"bytes once unpacked ({human(size)})", where=shown(path), remedy=remedy, kind=kind)
    return [member.filename for member in members]


def shown(path: object) -> str:
    """Return a path or text as it may stand in a message: one line, not too long, without control characters."""
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(path))
    return text if len(text) <= 300 else f"{text[:140]} ... {text[-140:]}"


def shortened(text: str, most: int) -> str:
    """Return a text, or its beginning with an ellipsis."""
    return text if len(text) <= most else f"{text[: most - 4]} ..."


def value_shown(value: object) -> str:
    """Return a value as it may stand in a message: on one line, and short."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a whole number of more than 4300 digits, a list that holds itself
        text = f"a {type(value).__name__} that is too long to show"
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:60]} ... {text[-15:]}"


def _reason(error: BaseException) -> str:
    """Return the reason of an error in one short line."""
    if isinstance(error, OSError) and error.strerror and not (error.errno or 0) < 0:
        return shown(error.strerror.lower())
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = shown(lines[0] if lines else type(error).__name__)
    text = text if len(text) <= 160 else f"{text[:157]}..."
    return text.rstrip(".")


def needed(module: str, why: str = "outlines need it", extra: str = "outline") -> Any:
    """Import an optional package or say which extra holds it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RiftbergError(
            f"{module.split('.')[0]} is not installed but {why}: pip install 'riftberg[{extra}]'"
        ) from error
