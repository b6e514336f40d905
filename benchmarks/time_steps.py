"""Error and cost of the time step for bergs of four sizes: what `stepping.time_step` is chosen by.

python benchmarks/time_steps.py             print the table
python benchmarks/time_steps.py --write     also put it into docs/evidence/stress-and-step.md

A berg of 18 elements is released at rest in an eddy of 0.4 m/s with 8 m/s of wind. The error is the largest distance of its
centroid in four days from the run with steps of 225 s; the way is that run's.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from story import put, table

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.state import Floats

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "stress-and-step.md"

SIZES = ((60e3, 10e3, 250.0), (6e3, 1e3, 250.0), (600.0, 100.0, 150.0), (100.0, 16.7, 40.0))
"""Length, radius of the elements and thickness, m."""

STEPS = (900.0, 1800.0, 3600.0, 7200.0)
FINE, DAYS, EVERY = 225.0, 4, 7200.0


def model_of(size: tuple[float, float, float], step: float) -> Model:
    """The berg at rest beside the middle of an eddy."""
    length, radius, thickness = size
    berg = Iceberg.rectangle(length, length / 2.0, thickness=thickness, radius=0.5 * radius, placement=(-38.0, -56.0))
    sea = Forcing.uniform((0.0, 0.0), wind=(8.0, 0.0)) + Forcing.eddy((-37.4, -56.2), 60e3, 0.4)
    return Model(berg, sea, Parameters(stepping={"time_step": step}, fracture={"enabled": False}))


def drift(size: tuple[float, float, float], step: float) -> tuple[Floats, float]:
    """Positions of the centroid (m) every two hours, and processor time, s: the least of four runs."""
    costs = []
    for _ in range(4):  # the first one loads what was compiled
        model, track = model_of(size, step), []
        began = time.thread_time()
        for _ in range(round(DAYS * 86400.0 / EVERY)):
            for _ in range(round(EVERY / step)):
                model.step()
            e = model.elements
            track.append([np.average(e.lon, weights=e.mass), np.average(e.lat, weights=e.mass)])
        costs.append(time.thread_time() - began)
    scale = EARTH_RADIUS_A68 * DEGREE * np.array([np.cos(np.radians(56.0)), 1.0])
    return np.array(track) * scale, min(costs)


def rows() -> Iterator[list[str]]:
    """Rows of the table."""
    for size in SIZES:
        fine, _ = drift(size, FINE)
        way = float(np.hypot(*np.diff(fine, axis=0).T).sum())
        cells, usual = [], drift(size, 1800.0)[1]
        for step in STEPS:
            track, cost = drift(size, step)
            error = float(np.hypot(*(track - fine).T).max())
            cells.append(f"{error:.0f} m, {cost / usual:.2f}")
        name = f"{size[0] / 1e3:g} km" if size[0] >= 1e3 else f"{size[0]:g} m"
        yield [name, f"{way / 1e3:.0f} km", *cells]


def main() -> None:
    """Print the table, and write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    asked = parser.parse_args()
    text = table(["length of the berg", "way in four days", *(f"{step:.0f} s" for step in STEPS)], list(rows()))
    print(text)
    if asked.write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "time-steps", text), "utf-8")


if __name__ == "__main__":
    main()
