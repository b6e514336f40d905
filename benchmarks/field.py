"""Cost of a field of bergs of one element each, without bonds: processor seconds per simulated day of 48 long steps.

python benchmarks/field.py [NUMBER ...]
"""

from __future__ import annotations

import sys
import time

from riftberg import Forcing, Iceberg, Model, Parameters


def ocean(lon: float, lat: float) -> Forcing:
    """Return a current, a wind and an eddy about a point."""
    return Forcing.uniform(current=(0.1, 0.0), wind=(5.0, 0.0)) + Forcing.eddy((lon, lat), radius=60e3, speed=0.4)


def field(number: int) -> tuple[Iceberg, Forcing]:
    """Return bergs of one element each, as dense whatever their number, and their ocean."""
    side = 4.0 * (number / 1000.0) ** 0.5
    return Iceberg.field(number, (-40.0, -40.0 + side, -58.0, -58.0 + 0.5 * side), seed=1), ocean(-38.0, -57.0)


def seconds_per_day(number: int, days: int = 4, *, contact: bool = True) -> tuple[float, int, int]:
    """Return processor seconds of the quickest day after the first, meetings in all days, and bergs."""
    bergs, sea = field(number)
    model = Model(bergs, sea, Parameters(stepping={"interactions": contact}))
    model.advance(1)
    costs = []
    for _ in range(days):
        began = time.process_time()
        model.advance(1)
        costs.append(time.process_time() - began)
    return min(costs), len(model.contacts.rows), bergs.elements.size


def main(numbers: list[int]) -> None:
    """Print a row for each number of bergs."""
    heads = "| bergs | s per day of 48 steps | ms per step | the same without contact | meetings |"
    print(heads + "\n|---:|---:|---:|---:|---:|")
    for number in numbers:
        cost, met, count = seconds_per_day(number)
        bare, _, _ = seconds_per_day(number, contact=False)
        print(f"| {count:,} | {cost:.3f} | {1e3 * cost / 48.0:.2f} | {1e3 * bare / 48.0:.2f} | {met} |", flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [100, 1000, 5000])
