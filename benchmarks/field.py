"""Cost of bergs without bonds: fields of bergs of one element each, and a berg in pieces that all lie beside each other.

python benchmarks/field.py [NUMBER ...]

Each by the default scheme and by ``mts``, with the contact that either has by default.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from riftberg import Forcing, Iceberg, Model, Parameters

STEPS = 48
"""Steps of a day."""


def ocean(lon: float, lat: float) -> Forcing:
    """Return a current, a wind and an eddy about a point."""
    return Forcing.uniform(current=(0.1, 0.0), wind=(5.0, 0.0)) + Forcing.eddy((lon, lat), radius=60e3, speed=0.4)


def field(number: int) -> tuple[Iceberg, Forcing]:
    """Return bergs of one element each, as dense whatever their number, and their ocean."""
    side = 4.0 * (number / 1000.0) ** 0.5
    return Iceberg.field(number, (-40.0, -40.0 + side, -58.0, -58.0 + 0.5 * side), seed=1), ocean(-38.0, -57.0)


def pieces() -> tuple[Iceberg, Forcing]:
    """Return a berg of 22 x 22 elements without bonds, at the rim of an eddy."""
    berg = Iceberg.rectangle(66e3, 66e3, thickness=250.0, radius=1500.0, placement=(-37.0, -56.0))
    berg.bonds.status[:] = 2
    berg.elements.bond_count[:] = 0
    berg.elements.berg[:] = np.arange(berg.elements.size)
    return berg, ocean(-37.3, -56.0)


def seconds_per_day(bergs: Iceberg, sea: Forcing, scheme: str, days: int = 4) -> tuple[float, int]:
    """Return processor seconds of the quickest day after the first, and meetings in all days."""
    model = Model(bergs, sea, Parameters(stepping={"scheme": scheme, "time_step": 86400.0 / STEPS}))
    model.advance(1)
    costs = []
    for _ in range(days):
        began = time.process_time()
        model.advance(1)
        costs.append(time.process_time() - began)
    return min(costs), len(model.contacts.rows)


def main(numbers: list[int]) -> None:
    """Print a row for each number of bergs, and one for the pieces."""
    print("| bergs | `quasi_static`, s per day | meetings | `mts`, s per day | meetings |\n|---|---:|---:|---:|---:|")
    for number in (*numbers, None):
        cells = []
        for scheme in ("quasi_static", "mts"):
            cost, met = seconds_per_day(*(pieces() if number is None else field(number)), scheme)
            cells += [f"{cost:.3f}", str(met)]
        name = "484 pieces side by side" if number is None else f"{number:,} single bergs"
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [100, 1000, 5000])
