"""The journey of one value through the package: which functions get it handed on, and which calls climb to a folder above.

    NUMBA_DISABLE_JIT=1 python benchmarks/journey.py [--list]

Two values are followed, each recognised by its digits: ``fracture.normal_strength`` from the command line to the law that
tests a bond, and an eastward current from a CF file to the force on an element. A function counts when one of its arguments is
the value, a text with it, an array or dataset that holds it, or a plain list, tuple or dictionary of these; objects of the
package that hold many values (parameters, state) do not count. Compilation is off, so that laws are seen too. To measure another
checkout, put its ``src`` on PYTHONPATH.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import tempfile
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

os.environ["NUMBA_DISABLE_JIT"] = "1"

import numpy as np
import xarray as xr

# What an empty array is made of may have held the value before: a workspace is not handed it.
np.empty, np.empty_like = np.zeros, np.zeros_like

FLOORS = (
    "cli", "ensembles", "experiments", "viz", "diagnostics", "kid", "coupling", "runs", "model", "life", "stepping",
    "ocean", "fetching", "products", "bergs", "parameters", "plane", "state", "physics", "config",
)  # fmt: skip
"""Folders from the top to the bottom, as in the import contract; whatever is not named lies below them."""

STRENGTH, CURRENT = 18123.0, 0.123456
"""The values that are followed (Pa, m s-1): digits that nothing else has."""

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
    fields = {
        name: (
            ("time", "lat", "lon"),
            np.full((48, lat.size, lon.size), speed),
            {"units": "m s-1", "standard_name": f"{way}_sea_water_velocity"},
        )
        for name, way, speed in (("uo", "eastward", CURRENT), ("vo", "northward", 0.05))
    }
    xr.Dataset(fields, coords=coords).to_netcdf(folder / "currents.nc")
    path = folder / "journey.yaml"
    path.write_text(EXPERIMENT)
    return path


def holds(thing: Any, value: float, depth: int = 3) -> bool:
    """Return whether an argument is the value or a plain container of it."""
    if isinstance(thing, float | np.floating):
        return abs(thing - value) <= 1e-6 * value
    if isinstance(thing, str):
        return f"{value:g}" in thing and len(thing) < 200
    if isinstance(thing, np.ndarray):
        return thing.dtype.kind == "f" and bool(np.isclose(thing, value, rtol=1e-6, atol=0.0).any())
    if isinstance(thing, xr.DataArray | xr.Variable):
        return isinstance(
            thing.variable._data if isinstance(thing, xr.DataArray) else thing._data, np.ndarray
        ) and holds(thing.values, value)
    if isinstance(thing, xr.Dataset):
        # Its fields may not be read yet: a dataset with the current counts for the current, and for no other value.
        return value == CURRENT and any(name in thing for name in ("uo", "vo"))
    if depth and type(thing) in (list, tuple):
        return any(holds(item, value, depth - 1) for item in thing)
    if depth and type(thing) is dict:
        return any(holds(item, value, depth - 1) for item in thing.values())
    return False


class Journey:
    """Notes the functions of the package that get a value, and the calls among them that climb."""

    def __init__(self, root: Path, value: float) -> None:
        self.root, self.value = str(root), value
        self.functions: dict[CodeType, str] = {}
        self.climbs: dict[tuple[str, str], None] = {}

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Be called by Python at every call."""
        code = frame.f_code
        if event != "call" or code in self.functions or not code.co_filename.startswith(self.root):
            return
        if code.co_name.startswith("<"):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        sys.setprofile(None)
        try:
            found = any(holds(frame.f_locals.get(name), self.value) for name in names if name not in ("self", "cls"))
        finally:
            sys.setprofile(self)
        if not found:
            return
        self.functions[code] = f"{self._file(code)}:{code.co_name}"
        caller = frame.f_back.f_code if frame.f_back else None
        if caller is not None and caller.co_filename.startswith(self.root) and self._floor(caller) > self._floor(code):
            self.climbs[f"{self._file(caller)}:{caller.co_name}", self.functions[code]] = None

    def _file(self, code: CodeType) -> str:
        return str(Path(code.co_filename).relative_to(self.root))

    def _floor(self, code: CodeType) -> int:
        folder = self._file(code).split(os.sep)[0].removesuffix(".py")
        return FLOORS.index(folder) if folder in FLOORS else len(FLOORS)


def follow(value: float, command: list[str]) -> Journey:
    """Run a command of the package and return the journey of a value through it."""
    import riftberg
    from riftberg.cli.main import app

    journey = Journey(Path(riftberg.__file__).parent, value)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        sys.setprofile(journey)
        try:
            app(command, standalone_mode=False)
        finally:
            sys.setprofile(None)
    return journey


def main() -> None:
    """Print both journeys."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--list", action="store_true", help="print the functions, in the order in which they are reached"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = write_case(Path(folder))
        run = ["run", str(path), "--no-map", "--output"]
        change = ["--set", f"fracture.normal_strength={STRENGTH:g}"]
        journeys = {
            "fracture.normal_strength": follow(STRENGTH, [*run, f"{folder}/a", *change]),
            "uo": follow(CURRENT, [*run, f"{folder}/b"]),
        }
    for name, journey in journeys.items():
        print(f"{name:>26}  {len(journey.functions)} functions get it, {len(journey.climbs)} calls climb")
        for entry in journey.functions.values() if options.list else ():
            print(f"      {entry}")


if __name__ == "__main__":
    main()
