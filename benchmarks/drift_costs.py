"""What the laws of drift cost: processor time with each of them and without, by turns in one process.

python benchmarks/drift_costs.py [NAME ...]       rows by the words of ROWS; all without
python benchmarks/drift_costs.py --profile NAME   where the time of the dearer one goes
"""

from __future__ import annotations

import cProfile
import os
import pstats
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
import xarray as xr

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model

TURNS = 3
"""Pairs that are timed, after one that is not."""

WHOLE: dict[str, Any] = {"fracture": {"enabled": False}}
PACK: dict[str, Any] = {"sea_ice": (0.1, 0.0, 1.0), "ice_fraction": 0.9}


def sea(*, level: bool, days: int = 11) -> xr.Dataset:
    """Return hourly currents and winds on a twelfth of a degree around 38 W, 56 S, with or without their sea level."""
    lon, lat = np.arange(-42.0, -34.0, 1.0 / 12.0), np.arange(-59.0, -53.0, 1.0 / 12.0)
    times = np.datetime64("2020-12-01", "ns") + np.arange(24 * days + 1) * np.timedelta64(1, "h")
    x, y = np.meshgrid(lon, lat)
    surface = 0.15 * np.sin(1.3 * x) * np.cos(1.7 * y)
    f, north, east = 1.2e-4, 111e3, 62e3
    v = 9.81 / f * np.gradient(surface, lon, axis=1) / east
    u = 9.81 / f * np.gradient(surface, lat, axis=0) / north
    fields = {
        "uo": ("eastward_sea_water_velocity", "m s-1", u), "vo": ("northward_sea_water_velocity", "m s-1", -v),
        "uas": ("eastward_wind", "m s-1", np.full_like(x, 6.0)), "vas": ("northward_wind", "m s-1", np.full_like(x, 2.0)),
        **({"zos": ("sea_surface_height_above_geoid", "m", surface)} if level else {}),
    }  # fmt: skip
    swing = 1.0 + 0.1 * np.sin(np.arange(times.size))[:, None, None]
    return xr.Dataset(
        {
            name: (("time", "lat", "lon"), swing * values[None], {"standard_name": standard, "units": units})
            for name, (standard, units, values) in fields.items()
        },
        {
            "time": times,
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    )


DATA = {level: sea(level=level) for level in (True, False)}


def giant() -> Iceberg:
    """Return a berg of 60 x 20 km."""
    return Iceberg.rectangle(60e3, 20e3, thickness=200.0, radius=1500.0, placement=(-38.0, -56.0))


def lone(number: int) -> Iceberg:
    """Return single bergs in a field, as dense whatever their number."""
    side = 4.0 * (number / 1000.0) ** 0.5
    return Iceberg.field(number, (-40.0, -40.0 + side, -58.0, -58.0 + 0.5 * side), seed=1)


def timed(model: Model, days: float, first: float = 0.05) -> float:
    """Return processor seconds of some days, after the first steps."""
    model.advance(days=first)
    began = time.process_time()
    model.advance(days=days)
    return time.process_time() - began


def in_files(level: bool) -> float:
    """Return processor seconds of ten days in hourly files, their reading among them."""
    began = time.process_time()
    Model(giant(), Forcing.from_xarray(DATA[level]), Parameters(**WHOLE)).advance(days=10)
    return time.process_time() - began


SHARED = {level: Forcing.from_xarray(DATA[level]) for level in (True, False)}


def further(level: bool) -> float:
    """Return processor seconds of ten days of a member whose forcing others have read before."""
    return timed(Model(giant(), SHARED[level], Parameters(**WHOLE)), 9.0)


def in_pack(berg: Iceberg, capture: str, days: float) -> float:
    """Return processor seconds of a berg or a field of bergs in a pack."""
    sea_of = Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0), **PACK)
    return timed(Model(berg, sea_of, Parameters(sea_ice={"capture": capture}, **WHOLE)), days)


def a68a(**changes: Any) -> float:
    """Return processor seconds of A68a in the currents of its story, whole and over the deep sea."""
    return timed(story_model(Options({**WHOLE, **changes}, without=frozenset({"shoal"}))), 8.0, 1.0)


def open_sea(berg: Iceberg, days: float, **changes: Any) -> float:
    """Return processor seconds in a current and a wind."""
    return timed(
        Model(berg, Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0)), Parameters(**{**WHOLE, **changes})), days
    )


def cloud(number: int = 10_000) -> Iceberg:
    """Return bergs of 200 x 150 x 80 m around a position, none of which touch."""
    return Iceberg.cloud(number, (-38.0, -57.0), 50e3, length=200.0, width=150.0, thickness=80.0, seed=1)


BY_ELEMENT = {"compatibility": {"forces_by_element": True}}

ROWS: dict[str, tuple[str, Callable[[], float], Callable[[], float]]] = {
    "auto": ("slope of the current, for a level in hourly files, 60 x 20 km, 10 days", lambda: in_files(False),
             lambda: in_files(True)),
    "member": ("the same, a further member", lambda: further(False), lambda: further(True)),
    "pack": ("pack limited, for none, 60 x 20 km, 5 days", lambda: in_pack(giant(), "limited", 5.0),
             lambda: in_pack(giant(), "none", 5.0)),
    "bergs in pack": ("the same, 4,000 single bergs, a day", lambda: in_pack(lone(4000), "limited", 1.0),
                      lambda: in_pack(lone(4000), "none", 1.0)),
    "A68a, pack": ("A68a without sea ice, pack limited, for none, 8 days", a68a, lambda: a68a(sea_ice={"capture": "none"})),
    "A68a, sides": ("sides by the outline, for those by elements, A68a, 8 days", a68a, lambda: a68a(**BY_ELEMENT)),
    "bergs, sides": ("the same, 4,000 single bergs, a day", lambda: open_sea(lone(4000), 1.0),
                     lambda: open_sea(lone(4000), 1.0, **BY_ELEMENT)),
    "cloud": ("10,000 of a cloud, for as many of `Iceberg.field`, a day", lambda: open_sea(cloud(), 1.0),
              lambda: open_sea(lone(10_000), 1.0)),
}  # fmt: skip
"""What it is, and processor seconds with a law and without it."""


def main(words: list[str]) -> None:
    """Print a row for each case, or a profile of one."""
    if words[:1] == ["--profile"]:
        profile = cProfile.Profile(time.process_time)
        _, dearer, _ = ROWS[words[1]]
        dearer()
        profile.runcall(dearer)
        pstats.Stats(profile).sort_stats("tottime").print_stats(45)
        return
    print("| case | with, s | without, s | median ratio of pairs | of the quickest | load |\n|---|---:|---:|---:|---:|---:|")
    for row in words or ROWS:
        title, dearer, cheaper = ROWS[row]
        pairs = [(dearer(), cheaper()) for _ in range(TURNS + 1)][1:]
        one, other = (min(costs) for costs in zip(*pairs, strict=True))
        ratio = median(a / b for a, b in pairs)
        print(
            f"| {title} | {one:.3f} | {other:.3f} | {ratio:.3f} | {one / other:.3f} | {os.getloadavg()[0]:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
