"""Reading plain files needs the base installation alone: all that only an extra brings is out of reach here."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from products.test_odd_files import on_map, plain, shaken, written

ROOT = Path(__file__).parents[2]

PROGRAM = """
import sys

class Barred:
    def __init__(self, names):
        self.names = names
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

barred = set(sys.argv[2].split(","))
assert not barred & {name.partition(".")[0] for name in sys.modules}
sys.meta_path.insert(0, Barred(barred))
import datetime, pathlib
import numpy as np
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
for path in map(pathlib.Path, sys.argv[1].split(",")):
    report = doctor([str(path)])
    assert not report.unreadable, report.text()
    asked = FileForcing(kind="files", files=[path.name], longitude=(-41, -37), latitude=(-57.5, -53.5))
    forcing_from_files(asked, path.parent, Run.of(datetime.datetime(2020, 12, 16, 6), 0.1, np.array([200.0]), 850.0))
    print("read", path.parent.name, len(report.data))
"""


def plain_name(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def needed() -> set[str]:
    """Names of the distributions that the base installation brings."""
    from packaging.requirements import Requirement

    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    found: set[str] = set()
    while wanted:
        requirement = Requirement(wanted.pop())
        name = plain_name(requirement.name)
        if name in found or (requirement.marker is not None and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        try:
            wanted += metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
    return found


def barred() -> set[str]:
    """Modules that are installed here and that the base installation does not bring."""
    base = needed()
    modules = metadata.packages_distributions()
    allowed = {name for name, owners in modules.items() if base & {plain_name(owner) for owner in owners}}
    ground = {*sys.stdlib_module_names, "riftberg", "pip", "setuptools", "_distutils_hack", "pkg_resources"}
    return {name for name in modules if name not in allowed | ground and name.isidentifier()}


def test_plain_files_are_read_without_any_extra(tmp_path: Path) -> None:
    """On axes, scattered, and on a map; one process, for to start it takes most of the time."""
    names = barred()
    assert {"pytest", "hypothesis"} <= names
    assert not {"numpy", "xarray", "netCDF4", "pyproj", "cf_xarray", "dask"} & names
    ds = plain(names=("uo", "vo"))
    layouts = {
        "axes": ds,
        "scattered": shaken(ds, "scattered"),
        "map": on_map("Lambert", mapping=True, positions=False, flipped=False),
    }
    paths = []
    for name, layout in layouts.items():
        (tmp_path / name).mkdir()
        paths.append(str(written(tmp_path / name, layout)))
    command = [sys.executable, "-c", PROGRAM, ",".join(paths), ",".join(sorted(names))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout == "read axes 1\nread scattered 1\nread map 1\n", done.stderr
