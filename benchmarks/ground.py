"""What the bed of sediment costs: processor time with it and without any floor, by turns in one process.

python benchmarks/ground.py [NAME ...]       rows by the words below; all without
python benchmarks/ground.py --profile NAME   where the time of one row goes
"""

from __future__ import annotations

import cProfile
import os
import pstats
import sys
import time
from collections.abc import Callable
from typing import Any

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model

PLANE: dict[str, Any] = {"latlon": False, "latitude": 0.0}

TIDES = ((0.4, 44_714.0), (0.2, 43_200.0), (0.1, 86_164.0))
"""Amplitude (m) and period (s) of three constituents."""


def tides(**plane: Any) -> Forcing:
    """Return three constituents of a tide without currents."""
    first, *others = (Forcing.tide(0.0, level=level, period=period, **plane) for level, period in TIDES)
    return sum(others, start=first)


def a68a(law: str, **changes: Any) -> Model:
    """Return A68a in the currents of the story, with the shoal or over the deep sea."""
    return story_model(Options({"grounding": {"law": law}, **changes}, without=frozenset()))


def whole(law: str) -> Model:
    """Return A68a that does not break and meets no shoal."""
    return story_model(
        Options({"grounding": {"law": law}, "fracture": {"enabled": False}}, without=frozenset({"shoal"}))
    )


def knoll(law: str, *, tidal: bool = False) -> Model:
    """Return a berg of 72 x 54 km and 280 m on a knoll that reaches 0.9 m above its keel."""
    berg = Iceberg.rectangle(
        72e3, 54e3, thickness=280.0, radius=3000.0, placement=(0.0, 0.0), density=850.0, latlon=False
    )
    sea = Forcing.uniform((0.08, 0.03), **PLANE)
    sea = sea + Forcing.seamount((9e3, 6e3), 120.0, 4e3, 280.0 * 850.0 / 1025.0 + 119.1, latlon=False)
    sea = sea + tides(**PLANE) if tidal else sea
    return Model(
        berg, sea,
        Parameters(
            ice={"density": 850.0}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0},
            grounding={"law": law}, fracture={"enabled": False},
        ),
    )  # fmt: skip


def held(law: str, *, tidal: bool = False) -> Model:
    """Return a berg of 66 x 54 km and 300 m that comes to rest on a slope after eight days."""
    berg = Iceberg.rectangle(66e3, 54e3, thickness=300.0, radius=1500.0, placement=(-39.0, -56.0))
    sea = Forcing.uniform((0.25, 0.05), wind=(6.0, 2.0)) + Forcing.slope((-38.0, -56.0), 270.0, 5e-4, 320.0)
    sea = sea + tides() if tidal else sea
    return Model(berg, sea, Parameters(grounding={"law": law}, fracture={"enabled": False}))


def landing(law: str) -> Model:
    """Return a berg of 18 x 9 km and 200 m that comes to rest on a slope within three hours."""
    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, radius=750.0, latlon=False, velocity=(0.3, 0.0))
    sea = Forcing.slope((9e3, 0.0), 270.0, 1e-3, 200.0 * 850.0 / 1025.0 + 0.2, **PLANE)
    return Model(
        berg, sea,
        Parameters(
            ice={"density": 850.0}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0},
            grounding={"law": law, "sediment": "rock"} if law == "seabed" else {"law": law}, fracture={"enabled": False},
        ),
    )  # fmt: skip


def lone(law: str, number: int, depth: float, *, melt: bool) -> Model:
    """Return single bergs in a field over a flat floor."""
    side = 4.0 * (number / 1000.0) ** 0.5
    berg = Iceberg.field(number, (-40.0, -40.0 + side, -58.0, -58.0 + 0.5 * side), seed=1)
    sea = Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0), depth=depth)
    return Model(
        berg, sea, Parameters(grounding={"law": law}, melt={"enabled": melt, "temperature": 1.0, "salinity": 34.0})
    )


ROWS: dict[str, tuple[Callable[[str], Model], float, float]] = {
    # Model, days before those that are timed, and days that are.
    "open": (whole, 1.0, 8.0),
    "story": (a68a, 0.0, 17.0),
    "landing": (landing, 0.0, 0.25),
    "knoll": (knoll, 0.0, 2.0),
    "tides": (lambda law: knoll(law, tidal=True), 0.0, 2.0),
    "held": (held, 10.0, 4.0),
    "held, tides": (lambda law: held(law, tidal=True), 12.0, 4.0),
    "aground": (lambda law: lone(law, 300, 150.0, melt=True), 1.0, 1.0),
    "deep": (lambda law: lone(law, 4000, 2000.0, melt=False), 0.5, 0.5),
    "deep melt": (lambda law: lone(law, 4000, 2000.0, melt=True), 0.5, 0.5),
}


def seconds(row: str, law: str) -> tuple[float, int]:
    """Return processor seconds per day, and elements aground at the end."""
    build, first, days = ROWS[row]
    model = build(law)
    if first:
        model.advance(days=first)
    began = time.process_time()
    model.advance(days=days)
    return (time.process_time() - began) / days, int((model.elements.keel.floor_load > 0.0).sum())


def main(words: list[str]) -> None:
    """Print a row for each case, or a profile of one."""
    if words[:1] == ["--profile"]:
        build, first, days = ROWS[words[1]]
        build("seabed").advance(days=max(0.1 * days, 0.1))
        model, profile = build("seabed"), cProfile.Profile(time.process_time)
        if first:
            model.advance(days=first)
        profile.runcall(model.advance, days=days)
        pstats.Stats(profile).sort_stats("tottime").print_stats(45)
        return
    print("| case | aground | bed, s a day | none, s a day | over | load |\n|---|---:|---:|---:|---:|---:|")
    for row in words or ROWS:
        found: dict[str, list[float]] = {"seabed": [], "none": []}
        for turn in range(3):
            for law, costs in found.items():
                cost, count = seconds(row, law)
                if turn:
                    costs.append(cost)
                if law == "seabed":
                    aground = count
        bed, none = (min(costs) for costs in found.values())
        print(
            f"| {row} | {aground} | {bed:.4f} | {none:.4f} | {bed / none:.2f} | {os.getloadavg()[0]:.1f} |", flush=True
        )


if __name__ == "__main__":
    main(sys.argv[1:])
