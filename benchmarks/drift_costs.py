"""What the laws of drift, and the tips of rifts, cost: processor time with each of them and without, by turns in one process.

python benchmarks/drift_costs.py [NAME ...]       rows by the words of ROWS; all without
python benchmarks/drift_costs.py --profile NAME   where the time with the law goes
"""

from __future__ import annotations

import cProfile
import os
import pstats
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import xarray as xr

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.quasi_static.fracture.crack_paths import CrackPaths
from riftberg.engines.quasi_static.lattice.sides import FragmentSides
from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model

TURNS = 24
"""Pairs that are timed, after one that is not: a step of the days of one run, and of the other, and so on."""

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


def on_files(level: bool, forcing: Forcing | None = None) -> Model:
    """Return a giant in hourly files; with a forcing: that which others have read before."""
    return Model(giant(), forcing or Forcing.from_xarray(DATA[level]), Parameters(**WHOLE))


SHARED = {level: Forcing.from_xarray(DATA[level]) for level in (True, False)}


def further(level: bool) -> Model:
    """Return a further member of an ensemble: its forcing has been read before."""
    if level not in READ:
        on_files(level, SHARED[level]).advance(days=10.5)
        READ.add(level)
    return on_files(level, SHARED[level])


READ: set[bool] = set()


def in_pack(berg: Iceberg, capture: str) -> Model:
    """Return a berg or a field of bergs in a pack."""
    pack = Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0), **PACK)
    return Model(berg, pack, Parameters(sea_ice={"capture": capture}, **WHOLE))


def a68a(**changes: Any) -> Model:
    """Return A68a in the currents of its story, whole and over the deep sea."""
    return story_model(Options({**WHOLE, **changes}, without=frozenset({"shoal"})))


def open_sea(berg: Iceberg) -> Model:
    """Return bergs in a current and a wind."""
    return Model(berg, Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0)), Parameters(**WHOLE))


def cloud(number: int = 10_000) -> Iceberg:
    """Return bergs of 200 x 150 x 80 m around a position, none of which touch."""
    return Iceberg.cloud(number, (-38.0, -57.0), 150e3, length=200.0, width=150.0, thickness=80.0, seed=1)


def by_radius() -> Iceberg:
    """Return elements of the area and at the places of the cloud, as bergs of one element had to be given before."""
    el = cloud().elements
    return Iceberg.from_points(
        el.lon, el.lat, thickness=80.0, radius=0.5 * (200.0 * 150.0) ** 0.5, pieces=np.arange(el.size)
    )


def by_directions() -> AbstractContextManager[Any]:
    """Drag on the sides of bonded bergs by a mean over all directions, as before the outline had a law."""
    return patch.object(FragmentSides, "find", lambda *_: None)


def rifted(*, melt: bool) -> Model:
    """Return a giant with a rift of 24 km inside, both tips of which stand, in warm or in cold water."""
    berg = Iceberg.rectangle(60e3, 40e3, thickness=200.0, radius=1500.0, placement=(-38.0, -56.0))
    berg = berg.with_rifts([((-38.19, -56.01), (-37.81, -56.01))], broken=True)
    water = {"enabled": melt, "temperature": 2.0, "salinity": 34.0}
    strong = {"criterion": "toughness", "toughness": 5e5, "normal_strength": 1e6}
    return Model(berg, Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0)), Parameters(melt=water, fracture=strong))


def without_tips() -> AbstractContextManager[Any]:
    """Rifts without tips, whose stress intensity nobody asks for."""
    return patch.object(CrackPaths, "standing", lambda *_: [])


class Row(NamedTuple):
    """A law: a model with it and one without, and days of a turn."""

    title: str
    with_it: Callable[[], Model]
    without: Callable[[], Model]
    days: float
    other: Callable[[], AbstractContextManager[Any]] = nullcontext  # Holds while the model without it runs


ROWS = {
    "auto": Row(
        "slope of the current, for a level in hourly files: 60 x 20 km", lambda: on_files(False), lambda: on_files(True), 0.4
    ),
    "member": Row("the same, a further member", lambda: further(False), lambda: further(True), 0.4),
    "pack": Row(
        "pack `limited`, for `none`: 60 x 20 km", lambda: in_pack(giant(), "limited"), lambda: in_pack(giant(), "none"), 0.25
    ),
    "bergs in pack": Row(
        "the same, 2,000 single bergs", lambda: in_pack(lone(2000), "limited"), lambda: in_pack(lone(2000), "none"), 1 / 48
    ),
    "A68a, pack": Row(
        "pack `limited`, for `none`, in open water: A68a", a68a, lambda: a68a(sea_ice={"capture": "none"}), 0.4
    ),
    "A68a, sides": Row("sides by the outline, for a mean over directions: A68a", a68a, a68a, 0.4, by_directions),
    "cloud": Row(
        "10,000 bergs by length and width, for as many by radius",
        lambda: open_sea(cloud()), lambda: open_sea(by_radius()), 1 / 48
    ),
    "tips": Row(
        "two tips of a rift, for none: 60 x 40 km", lambda: rifted(melt=False), lambda: rifted(melt=False), 1.0, without_tips
    ),
    "tips, melt": Row(
        "the same in ice that melts", lambda: rifted(melt=True), lambda: rifted(melt=True), 0.4, without_tips
    ),
}  # fmt: skip


def seconds(model: Model, days: float) -> float:
    """Return processor seconds of some days."""
    began = time.process_time()
    model.advance(days=days)
    return time.process_time() - began


def main(words: list[str]) -> None:
    """Print a row for each case, or a profile of one."""
    if words[:1] == ["--profile"]:
        row, profile = ROWS[words[1]], cProfile.Profile(time.process_time)
        model = row.with_it()
        model.advance(days=row.days)
        profile.runcall(model.advance, days=TURNS * row.days)
        pstats.Stats(profile).sort_stats("tottime").print_stats(45)
        return
    print(
        "| | with, s a day | without, s a day | ratio: median of the pairs, quartiles | load |\n|---|---:|---:|---|---:|"
    )
    for name in words or ROWS:
        row = ROWS[name]
        models = row.with_it(), row.without()
        pairs = []
        for _ in range(TURNS + 1):
            one = seconds(models[0], row.days)
            with row.other():
                pairs.append((one, seconds(models[1], row.days)))
        costs = np.array(pairs[1:])
        ratios = np.percentile(costs[:, 0] / costs[:, 1], [50, 25, 75])
        one, other = np.median(costs, axis=0) / row.days
        print(
            f"| {row.title} | {one:.3f} | {other:.3f} | {ratios[0]:.2f} ({ratios[1]:.2f} to {ratios[2]:.2f}) "
            f"| {os.getloadavg()[0]:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
