"""Files that are whole or not there: written under a passing name beside their own, which they take when complete.

Whoever opens the file meets a complete one, and a process killed at any moment leaves at most a hidden ``.part``, which
the next writer of the same file removes. Passing names are unique, so that two processes or threads never share one.
"""

from __future__ import annotations

import itertools
import logging
import os
import platform
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

_LOG = logging.getLogger(__name__)
_COUNTER: Final = itertools.count(1)


@contextmanager
def replacing(path: str | Path, *, copy: bool = False, to_disk: bool = False, ending: bool = False) -> Iterator[Path]:
    """Give the passing name of a file, which takes its own name if the block ends well.

    Parameters
    ----------
    path : path
        The file; an earlier one stands until it is replaced.
    copy : bool, optional
        Begin with a copy of the earlier file.
    to_disk : bool, optional
        Wait until the disk has it, so that it survives a failure of power too.
    ending : bool, optional
        Let the passing name end as the file's own, for writers that go by it.
    """
    path = Path(path)
    remove_leftovers(path)
    part = path.with_name(f".{path.name}.{_node()}-{os.getpid()}-{next(_COUNTER)}.part{path.suffix if ending else ''}")
    try:
        if copy:
            shutil.copyfile(path, part)
        yield part
        if to_disk:
            with part.open("r+b") as handle:
                os.fsync(handle.fileno())
        os.replace(part, path)
        _LOG.debug("wrote %s", path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8) that is whole or not there."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def remove_leftovers(path: Path) -> None:
    """Remove what a killed process of this machine left of a file."""
    name, node, ending = re.escape(path.name), re.escape(_node()), re.escape(path.suffix)
    mine = re.compile(rf"\.{name}(?:\.(?:{node}-)?(\d+)(?:-\d+)?)?\.part(?:{ending})?")
    # Not a pattern for glob: the name may hold its special characters.
    with suppress(OSError), os.scandir(path.parent) as entries:
        for entry in entries:
            leftover = mine.fullmatch(entry.name)
            if leftover and not (leftover[1] and _runs(int(leftover[1]))):
                with suppress(OSError):
                    os.unlink(entry.path)


def _node() -> str:
    return re.sub(r"[^\w]", "_", platform.node())


def _runs(pid: int) -> bool:
    """Tell whether a process is there."""
    if os.name != "posix":
        return True  # asking would end it
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
