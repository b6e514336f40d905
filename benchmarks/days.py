"""What the days of A68a cost, with the bed and without a floor: each day of one lattice, and the mean of all twenty.

python benchmarks/days.py                 the days of the built-in lattice, the second run of each law
python benchmarks/days.py --lattices      also the means of the twenty lattices of `lattices.py`

Processor milliseconds. Trials of a step are counted: each day while the berg is whole takes 24.
"""

from __future__ import annotations

import argparse
import time
from statistics import mean, median

from ground import a68a
from lattices import LATTICES, STRENGTH, lattice_model

from riftberg import Model
from riftberg.experiments.a68a import DAYS

LAWS = ("none", "seabed")


def cost_days(model: Model) -> list[float]:
    """Return the processor milliseconds of each day of the story."""
    costs = []
    for _ in range(int(DAYS)):
        began = time.process_time()
        model.advance(days=1.0)
        costs.append(1e3 * (time.process_time() - began))
    return costs


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--lattices", action="store_true", help="also run the twenty lattices")
    given = parser.parse_args()
    print("| A68a, ms a day | mean | whole (days 2 to 7) | dearest three |\n|---|---:|---:|---:|")
    for law in LAWS:
        cost_days(a68a(law))
        costs = cost_days(a68a(law))
        dearest = ", ".join(f"{cost:.0f}" for cost in sorted(costs, reverse=True)[:3])
        print(f"| {law} | {mean(costs):.1f} | {mean(costs[2:7]):.1f} | {dearest} |", flush=True)
    if not given.lattices:
        return
    print("\n| lattice | none | seabed | ratio |\n|---|---:|---:|---:|")
    means: dict[str, list[float]] = {law: [] for law in LAWS}
    for lattice in LATTICES:
        for law in LAWS:
            changes = {"fracture": {"normal_strength": 1e3 * STRENGTH}, "grounding": {"law": law}}
            means[law].append(mean(cost_days(lattice_model(*lattice, **changes))))
        none, bed = (means[law][-1] for law in LAWS)
        print(f"| {lattice[0]} {lattice[1]:g} | {none:.1f} | {bed:.1f} | {bed / none:.1f} |", flush=True)
    ratios = [bed / none for none, bed in zip(means["none"], means["seabed"], strict=True)]
    for word, take in (("mean", mean), ("median", median)):
        print(f"| {word} | {take(means['none']):.1f} | {take(means['seabed']):.1f} | {take(ratios):.1f} |")


if __name__ == "__main__":
    main()
