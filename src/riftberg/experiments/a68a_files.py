"""Where the files of the A68a publication lie: the folder, what is missing in it, and how they get there."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from riftberg.errors import ForcingError
from riftberg.experiments.options import Options
from riftberg.fetching.download import is_pointer

DATA: Final = "RIFTBERG_DATA"
"""Environment variable that names the folder of the files."""

FETCHED: Final = Path("riftberg-data") / "a68a"
"""Where ``riftberg fetch a68a`` puts them if it is not told another place."""

BERG: Final = "icebergs.res.nc"
GRID: Final = "a68_experiment_ll_p125_grid.nc"

REMEDY: Final = "delete it, and 'riftberg fetch a68a' gets the right one"


def named_folder(options: Options) -> Path:
    """Return the folder that was named with ``--data`` or the environment variable, else that of the fetch."""
    if options.data is not None:
        return options.data
    return Path(os.environ[DATA]) if os.environ.get(DATA) else FETCHED


def data_folder(options: Options, names: Iterable[str], experiment: str, *, hourly: bool) -> Path:
    """Return the folder of the files; fetch them first where that was asked for and some are missing."""
    folder, wanted = named_folder(options), list(names)
    if options.fetch and any(_fault_of_file(folder / name) for name in wanted):
        from riftberg.fetching import fetch

        fetch.fetch_a68a(folder, hourly=fetch.HOURLY if hourly else ())
    remedy = _remedy(options, folder, experiment)
    if not folder.is_dir():
        what = "no folder of data" if folder == FETCHED else "no such folder"
        raise ForcingError(what, where=f"{experiment}: {folder}", remedy=remedy)
    faults = [(name, fault) for name in wanted if (fault := _fault_of_file(folder / name))]
    if faults:
        name, fault = faults[0]
        more = f" ({len(faults)} of {len(wanted)} files are missing)" if len(faults) > 1 else ""
        raise ForcingError(f"{fault} {name}{more}", where=str(folder), remedy=remedy)
    return folder


def _fault_of_file(path: Path) -> str:
    if not path.is_file():
        return "no"
    return "only a pointer of Git LFS instead of" if is_pointer(path) else ""


def _remedy(options: Options, folder: Path, experiment: str) -> str:
    place, data = ("", "") if folder == FETCHED else (f" -o {folder}", f" --data {folder}")
    return (
        f"'riftberg fetch a68a{place}' gets the files, 'riftberg run {experiment}{data} --fetch' gets them and runs; "
        f"or name their folder with --data or {DATA}"
    )
