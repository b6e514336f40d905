"""Where results go: found out before any work whether they can, and cleared away again where there are none.

A run may take hours; that its file cannot be written is to be said first. A folder that was made for a run that was
refused is removed. Two commands that write one file are kept apart (`riftberg.system.atomic_files`).
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from riftberg.errors import InputError
from riftberg.system.atomic_files import only_writer
from riftberg.system.input_files import shown
from riftberg.system.limits import human

LEAST_SPACE: Final = 2e6
"""Bytes that must be free at least."""


def check_folder(
    folder: Path, names: Iterable[str] = (), *, option: str = "--output", needed: float = LEAST_SPACE
) -> None:
    """Refuse a folder that cannot be made or written into, before any work.

    Parameters
    ----------
    folder : pathlib.Path
        Where results go.
    names : iterable of str
        Files that will be written there.
    option : str
        Option that named it, for messages.
    needed : float
        Bytes that will be written, about.
    """
    where = f"{option} {shown(folder)}"
    remedy = "Name another folder"
    try:
        nearest = folder
        while not nearest.exists():
            nearest = nearest.parent
        if not nearest.is_dir():
            what = "a file, not a folder" if nearest == folder else f"{shown(nearest)} is a file, not a folder"
            raise InputError(what, where=where, remedy=remedy)
        taken = next((name for name in names if (folder / name).is_dir()), None)
        if taken is not None:
            raise InputError(f"{taken} is a folder there, where a file goes", where=where, remedy=remedy)
        # A test of the rights alone misses what is mounted read-only.
        with tempfile.TemporaryFile(dir=nearest) as file:
            file.write(b"riftberg")
        free = shutil.disk_usage(nearest).free
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be written ({reason.lower()})", where=where, remedy=remedy) from error
    if free < max(needed, LEAST_SPACE):
        raise InputError(
            f"the results take about {human(max(needed, LEAST_SPACE))}, and {human(free)} are free", where=where,
            remedy="Make room, name a folder on another disk, or write fewer records (--every)",
        )  # fmt: skip


def check_output(path: Path, *, option: str = "--output", inputs: Iterable[Path | None] = ()) -> None:
    """Refuse a file that cannot be written, or that is one of those read."""
    where = f"{option} {shown(path)}"
    with suppress(OSError, ValueError):
        if path.is_dir():
            raise InputError("a folder, where a file goes", where=where, remedy="Name a file in it")
        if path.exists() and any(other is not None and other.exists() and path.samefile(other) for other in inputs):
            raise InputError("the output is one of the inputs", where=where, remedy="Name another file")
    check_folder(path.parent, [], option=option)


@contextmanager
def results_folder(
    folder: Path, names: Iterable[str] = (), *, option: str = "--output", needed: float = LEAST_SPACE,
    taken: Iterable[str] = (),
) -> Iterator[Path]:  # fmt: skip
    """Make a folder; remove what was made where an error leaves it empty.

    Parameters
    ----------
    folder, names, option, needed
        As in `check_folder`.
    taken : iterable of str
        Files there that nobody else may write meanwhile.
    """
    check_folder(folder, names, option=option, needed=needed)
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with only_writer(*(folder / name for name in taken)):
            yield folder
    except BaseException:
        for parent in made:
            with suppress(OSError):  # one with something in it stays
                parent.rmdir()
        raise
