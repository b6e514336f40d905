"""The way of a current from a CF file to a bond: functions that it passes, and calls that climb from a room to one above.

    NUMBA_DISABLE_JIT=1 python benchmarks/way_of_a_field.py [--list]

A run from a YAML file with one file of currents on a straight grid is built and taken one long step; without compilation
every function of the package shows. Functions are counted once, and so is every pair of functions of which one calls the
other from a lower floor (the floors are those of the import contract in ``pyproject.toml``).
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

os.environ.setdefault("NUMBA_DISABLE_JIT", "1")

import numpy as np
import xarray as xr

FLOORS = (
    "cli", "experiments", "viz", "diagnostics", "kid", "runs", "model", "stepping", "ocean", "fetching", "products",
    "bergs", "parameters", "parameter_groups", "plane", "state", "physics",
)  # fmt: skip
"""Rooms from the top to the bottom; whatever is not named lies below them."""

FORMER = {"io/kid": "kid", "io": "runs", "ocean/products": "products"}
"""Rooms of older versions by what they are called now."""

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.125
berg:
  rectangle: {length: 9 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  kind: files
  files: [currents.nc]
  longitude: [-41, -37]
  latitude: [-57, -54]
"""


def write_case(folder: Path) -> Path:
    """Write an experiment and its file of hourly currents."""
    lon, lat = np.arange(-45.0, -32.9, 0.25), np.arange(-60.0, -50.9, 0.25)
    time = np.datetime64("2020-12-09T00", "ns") + np.arange(48) * np.timedelta64(1, "h")
    coords = {
        "time": ("time", time, {"standard_name": "time"}),
        "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "lon": ("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    wave = (
        np.sin(np.arange(48) / 9.0)[:, None, None] * np.cos(np.radians(9.0 * lon))[None, None, :] + 0.0 * lat[:, None]
    )
    fields = {
        name: (("time", "lat", "lon"), 0.2 * wave, {"units": "m s-1", "standard_name": f"{way}_sea_water_velocity"})
        for name, way in (("uo", "eastward"), ("vo", "northward"))
    }
    xr.Dataset(fields, coords=coords).to_netcdf(folder / "currents.nc")
    path = folder / "way.yaml"
    path.write_text(EXPERIMENT)
    return path


class Walk:
    """Takes note of the functions of the package that are called, and of calls that climb."""

    def __init__(self, root: Path) -> None:
        self.root = str(root)
        self.functions: dict[CodeType, str] = {}
        self.climbs: dict[tuple[str, str], None] = {}

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Be called by Python at every call."""
        if event != "call" or not self._name(frame.f_code):
            return
        self.functions.setdefault(frame.f_code, self._name(frame.f_code))
        caller = frame.f_back
        while caller is not None and not self._name(caller.f_code):
            caller = caller.f_back
        if caller is not None and _floor(self._name(frame.f_code)) < _floor(self._name(caller.f_code)):
            self.climbs[self._name(caller.f_code), self._name(frame.f_code)] = None

    def _name(self, code: CodeType) -> str:
        """Return file and function, below the package; empty for what is no function of it."""
        if not code.co_filename.startswith(self.root) or code.co_name.startswith("<"):
            return ""
        return f"{code.co_filename[len(self.root) + 1 :]}:{code.co_qualname}"


def _floor(name: str) -> int:
    folder = name.rpartition("/")[0] or name.partition(".py")[0]
    room = next((now for old, now in FORMER.items() if f"{folder}/".startswith(f"{old}/")), folder.partition("/")[0])
    return FLOORS.index(room) if room in FLOORS else len(FLOORS)


def main() -> None:
    """Print the figures."""
    import riftberg
    from riftberg.experiments import build, yaml_file

    root = Path(riftberg.__file__).parent
    walks = {name: Walk(root) for name in ("file to forcing", "forcing to elements", "elements to bonds")}
    make = yaml_file.build_forcing

    def built(*given: Any) -> Any:
        make(*given)  # imports what is imported at its first use, which is no step on the way
        sys.setprofile(walks["file to forcing"])
        try:
            return make(*given)
        finally:
            sys.setprofile(None)

    yaml_file.build_forcing = built
    with tempfile.TemporaryDirectory() as folder:
        model, _ = build(str(write_case(Path(folder))))
        forcing, sample = model.forcing, model.forcing.sample
        sys.setprofile(walks["forcing to elements"])
        forcing.check(model.elements, 0.0, 10_800.0)
        sample(model.elements, 1800.0)
        sys.setprofile(None)
        model._first_visit()
        sys.setprofile(walks["elements to bonds"])
        model.step()
        sys.setprofile(None)
    counted: set[CodeType] = set()
    for name, walk in walks.items():
        fresh = set(walk.functions) - counted
        counted |= fresh
        print(f"{name:22s} {len(fresh):4d} functions {len(walk.climbs):3d} climbs")
        if "--list" in sys.argv:
            print(*(f"    {walk.functions[code]}" for code in walk.functions if code in fresh), sep="\n")
            print(*(f"    climb: {caller} -> {called}" for caller, called in walk.climbs), sep="\n")
    way = [walks[name] for name in list(walks)[:2]]
    climbs = {pair for walk in way for pair in walk.climbs}
    print(f"{'file to elements':22s} {len({c for w in way for c in w.functions}):4d} functions {len(climbs):3d} climbs")
    both = {pair for walk in walks.values() for pair in walk.climbs}
    print(f"{'file to bonds':22s} {len(counted):4d} functions {len(both):3d} climbs")


if __name__ == "__main__":
    main()
