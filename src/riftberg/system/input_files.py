"""Checks of input files, one sentence for every failure of reading, and limits to the size of a run.

A path may be missing, a folder, a device that never ends, a pipe that never begins, or as large as the disk; the
libraries that read formats raise errors of every kind on a damaged file. Every reader of the house passes through here.

Limits are set to elements, steps, sub-steps and bytes of input. A slip of units (a radius of 1.5 instead of 1500 m) asks for
terabytes or for months of computing. Such a wish is refused before any work begins, unless it is allowed: on the command
line by ``--allow-large``, in Python by

>>> from riftberg.system.input_files import allow_large
>>> with allow_large():
...     pass
"""

from __future__ import annotations

import codecs
import csv
import importlib
import os
import re
import stat
import traceback
import zipfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from glob import glob
from pathlib import Path
from typing import Any, Final

from riftberg.errors import CUT, InputError, RiftbergError, without_secrets
from riftberg.system.atomic_files import refusal

MOST_ELEMENTS: Final = 1_000_000
"""Elements of a berg."""

MOST_STEPS: Final = 10_000_000
"""Long steps of a run."""

MOST_SUBSTEPS: Final = 1_000_000
"""Sub-steps in a long step."""

MOST_WORK: Final = 1e13
"""Elements times sub-steps of a whole run: some ten days of computing."""

MOST_TEXT: Final = 64 * 2**20
"""Bytes of a table, drawing or other text."""

MOST_YAML: Final = 500_000
"""Bytes of an experiment file or a namelist."""

MOST_VALUES: Final = 1_000_000_000
"""Numbers that are read from a grid or a run file at once (8 GB)."""

BYTES_PER_ELEMENT: Final = 2500
"""Memory of an element with its bonds, about."""

MEANT: Final = "or allow it by --allow-extreme (in Python: riftberg.system.input_files.allow_extreme())"

ANYWAY: Final = "or allow it by --allow-large (in Python: riftberg.system.input_files.allow_large())"

_ALLOWED: ContextVar[bool] = ContextVar("riftberg_large_allowed", default=False)
_EXTREME: ContextVar[bool] = ContextVar("riftberg_extreme_allowed", default=False)


@contextmanager
def _allow(flag: ContextVar[bool], allowed: bool) -> Iterator[None]:
    """Raise a flag within a ``with`` block; one that an outer block has raised stays raised."""
    token = flag.set(allowed or flag.get())
    try:
        yield
    finally:
        flag.reset(token)


def allow_extreme(allowed: bool = True) -> AbstractContextManager[None]:
    """Allow KID runs in currents, wind and sea level that no sea has, and ice of any speed below 1000 m/s."""
    return _allow(_EXTREME, allowed)


def extreme_allowed() -> bool:
    """Whether currents, wind and sea level beyond belief are allowed here."""
    return _EXTREME.get()


def allow_large(allowed: bool = True) -> AbstractContextManager[None]:
    """Allow runs and files beyond the limits within a ``with`` block."""
    return _allow(_ALLOWED, allowed)


def large_allowed() -> bool:
    """Whether runs and files beyond the limits are allowed here; for work that goes to another process."""
    return _ALLOWED.get()


def refuse_large(
    count: float, most: float, items: str, *, size: float = 0.0, where: str = "", remedy: str, kind: type[InputError]
) -> None:
    """Raise an error where more is asked for than the most."""
    if count <= most or (_ALLOWED.get() and count < 1e18):
        return
    about = f", about {human(count * size)}" if size else ""
    raise kind(
        f"this asks for {number_text(count)} {items}{about}; the most is {number_text(most)}",
        where=where,
        remedy=f"{remedy}, {ANYWAY}",
    )


def number_text(count: float) -> str:
    """Return a count in words that can be read: plain up to ten digits."""
    return f"{count:.0f}" if abs(count) < 1e10 else f"{count:.3g}"


def human(size: float) -> str:
    """Return bytes as MB or GB."""
    return f"{size / 1e6:.3g} MB" if size < 1e9 else f"{size / 1e9:.3g} GB"


def check_elements(count: float, *, where: str = "", kind: type[InputError] = InputError) -> None:
    """Refuse more elements than are allowed, before any is made."""
    refuse_large(
        count,
        MOST_ELEMENTS,
        "elements",
        size=BYTES_PER_ELEMENT,
        where=where,
        remedy="Give a larger radius or a smaller berg",
        kind=kind,
    )


def check_work(steps: float, substeps: int, elements: int, *, where: str) -> None:
    """Refuse a run of more steps, sub-steps or work than is allowed, before its first step."""
    refuse_large(
        steps,
        MOST_STEPS,
        "long steps",
        where=where,
        remedy="Run shorter, or give a longer stepping.time_step",
        kind=InputError,
    )
    refuse_large(
        substeps, MOST_SUBSTEPS, "sub-steps in a long step", where=where, kind=InputError,
        remedy="Look at thickness, radius and stiffness (bonds.youngs_modulus), give a shorter stepping.time_step",
    )  # fmt: skip
    refuse_large(
        steps * substeps * elements, MOST_WORK,
        f"updates of elements ({number_text(steps)} steps of {substeps} sub-steps for {elements} elements, "
        f"about {number_text(steps * substeps * elements / 1e7 / 86400.0)} days of computing)",
        where=where, remedy="Run shorter, or with fewer and larger elements", kind=InputError,
    )  # fmt: skip


_KINDS: Final = (
    (stat.S_ISDIR, "a folder, not a file"),
    (stat.S_ISCHR, "a device, not a file"),
    (stat.S_ISBLK, "a device, not a file"),
    (stat.S_ISFIFO, "a pipe, not a file"),
    (stat.S_ISSOCK, "a socket, not a file"),
)

_HERE: Final = Path()

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
        remedy = "Write the home folder out: ~ is one only in a shell" if where.startswith("~") else remedy
        raise kind(missing, where=where, remedy=remedy) from error
    except (OSError, ValueError) as error:  # a part of it is a file, a name too long, a zero byte, a circle of links
        raise kind(f"cannot be opened{because(error)}", where=where, remedy=remedy) from error
    if fault := _odd_kind(status.st_mode):
        raise kind(fault, where=where, remedy=remedy)
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
        raise kind(f"cannot be opened{because(error)}", where=where, remedy=remedy) from error
    return path


def _odd_kind(mode: int) -> str:
    return next((description for is_kind, description in _KINDS if is_kind(mode)), "")


def no_plain_file(path: str | Path) -> str:
    """Name the kind of a path that exists but is no plain file, such as a pipe that would be waited for; else empty."""
    try:
        return _odd_kind(Path(path).stat().st_mode)
    except (OSError, ValueError):
        return ""


def is_address(path: object) -> bool:
    """Whether a text names something on the network, which no path of this machine is made of."""
    return "://" in str(path)


ADDRESSES: Final = "RIFTBERG_ADDRESSES"
"""Environment variable with whole addresses, separated by blanks, of which files and messages have but a part."""

_WHOLE: Final[dict[str, str]] = {}


def hidden(path: str) -> str:
    """Return an address without its secrets, which `whole_address` gives back in this process."""
    if not is_address(path) or (cut := without_secrets(path)) == path:
        return path
    _WHOLE[cut] = path
    return cut


def whole_address(path: str) -> str:
    """Return an address with its secrets: as given in this process, or from the environment."""
    if not is_address(path) or CUT not in path:
        return path
    stored = {without_secrets(address): address for address in os.environ.get(ADDRESSES, "").split()}
    if (full_address := _WHOLE.get(path) or stored.get(path)) is None:
        raise InputError(
            f"user name, password, query or fragment ({CUT}) were cut from this address when it was stored", where=path,
            remedy=f"Put the whole address into the environment variable {ADDRESSES}",
        )  # fmt: skip
    return full_address


def at_home(name: str) -> str:
    """Return a name with ``~`` written out, as a shell does; one that is called so stays."""
    return os.path.expanduser(name) if name.startswith("~") and not os.path.lexists(name) else name


def in_folder(folder: Path, name: str) -> str:
    """Return a file that is named from a folder; an address stays as it is, and ``~`` is written out."""
    if is_address(name):
        return name
    return str(folder / name if os.path.lexists(folder / name) else folder / at_home(name))


def files_matching(name: str, folder: Path = _HERE) -> list[str]:
    """Return the file of that name, or else those that the pattern matches from the folder; an address stays as it is.

    An existing file, or folder on the way to it, is never a pattern; brackets that match nothing are letters.
    """
    path = in_folder(folder, name)
    if is_address(name) or os.path.lexists(path):
        return [path]
    root = next((parent for parent in Path(path).parents if is_folder(parent)), _HERE)
    pattern = os.path.relpath(path, root)
    matches = glob(pattern, root_dir=root) or glob(pattern.replace("[", "[[]"), root_dir=root)
    return sorted(str(root / match) for match in matches)


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; a path that cannot be looked at is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


@contextmanager
def reading(where: object, fault: str, remedy: str, kind: type[InputError] = InputError) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into one sentence that names the file."""
    try:
        yield
    except RiftbergError:
        raise
    except MemoryError as error:
        raise kind("asks for more memory than there is", where=shown(where), remedy=remedy) from error
    except (TypeError, AttributeError, IndexError) as error:  # their texts speak of Python
        raise kind(fault, where=shown(where), remedy=remedy) from error
    except Exception as error:  # libraries raise what they like: struct.error, KeyError, zlib.error, UnicodeError ...
        failure = kind(f"{fault}{because(error)}", where=shown(where), remedy=remedy)
        # A traceback would show what the library said of an address, password and all.
        raise failure from (error if without_secrets(str(error)) == str(error) else None)


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
    return [member.filename for member in members if not is_of_macos(member.filename)]


def is_of_macos(name: str) -> bool:
    """Whether a file in an archive is what macOS knows of another one, which it packs beside that under the same name."""
    return name.startswith("__MACOSX/") or Path(name).name.startswith("._")


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


PACKAGE = Path(__file__).parents[1]
"""Folder of our own code."""


def because(error: BaseException) -> str:
    """Return in brackets why the machine or our own code refused something, and in which line; nothing of a library's text."""
    if isinstance(error, OSError) and error.strerror and (error.errno or 0) > 0:
        return f" ({shown(refusal(error))})"
    frames = traceback.extract_tb(error.__traceback__)
    # The environment of a clone lies in a folder of the same name, and with it every library.
    ours = not frames or (
        Path(frames[-1].filename).is_relative_to(PACKAGE) and str(frames[-1].line).startswith("raise")
    )
    if ours and (lines := [line.strip() for line in str(error).splitlines() if line.strip()]):
        return f" ({shortened(shown(lines[0]), 160).rstrip('.')})"
    line = getattr(error, "lineno", None)
    return f" (line {line})" if isinstance(line, int) else ""


def needed(module: str, why: str = "outlines need it", extra: str = "outline") -> Any:
    """Import an optional package or say which extra holds it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RiftbergError(
            f"{module.split('.')[0]} is not installed but {why}: pip install 'riftberg[{extra}]'"
        ) from error


def read_csv_rows(path: Path, kind: type[InputError] = InputError) -> tuple[list[dict[str, str]], str]:
    """Return the rows of a table by column, and its separator: comma, semicolon or tab. Empty lines are passed over."""
    check_file(path, most=MOST_TEXT, remedy=_TABLE, kind=kind)
    lines = [line for line in _decoded(path.read_bytes()).splitlines() if line.strip(" ,;\t")]
    if any("\0" in line for line in lines[:100]):
        raise kind("bytes that are no text", where=str(path), remedy=_TABLE)
    if len(lines) < 2:
        fault = "no rows below the line of names" if lines else "no rows"
        raise kind(fault, where=str(path), remedy=_TABLE)
    separator = max(",;\t", key=lines[0].count)
    with reading(path, "no table that can be read", _TABLE, kind):
        reader = csv.DictReader(lines, delimiter=separator)
        names = [(name or "").strip().lower() for name in reader.fieldnames or ()]
        twice = next((name for name in names if name and names.count(name) > 1), None)
        if twice is not None:
            raise kind(f"two columns are called {twice!r}", where=str(path), remedy="Give each its own name")
        rows = list(reader)
    for line, row in enumerate(rows, start=2):
        beyond = [cell for cell in row.get(None, ()) if cell.strip()]
        if beyond:
            raise kind(
                f"{value_shown(beyond[0])} has no name: {len(names)} columns are named", where=f"{path}, line {line}",
                remedy="Name all columns; numbers with a decimal comma are separated by semicolons or tabs",
            )  # fmt: skip
    return rows, separator


def is_seen(lon: float, lat: float) -> bool:
    """Whether a table says where something is (degrees): 0, 0 and fill values such as -999 or 1e20 stand for no position."""
    return not (lon == lat == 0.0 or _is_fill(lon, 540.0) or _is_fill(lat, 90.0))


def _is_fill(value: float, most: float) -> bool:
    """Whether a number stands for no value; one up to ``most`` in size can be a value."""
    beyond = not abs(value) <= most
    return beyond and (not abs(value) < 1e10 or _FILLS.fullmatch(f"{abs(value):.10g}") is not None)


_FILLS: Final = re.compile(r"(9{2,}|8{3,}|327)(\.9+|\.8+|6[78])?")


_TABLE = "Give a table with a line of names and rows below, separated by commas, semicolons or tabs"


def _decoded(content: bytes) -> str:
    """Decode a table; programs that do not write UTF-8 write UTF-16 with a mark, or an 8-bit set (names only)."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")
