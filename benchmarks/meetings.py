"""Cost of contact by scheme and law: a field of single bergs, and a berg in pieces that all lie beside each other.

python benchmarks/meetings.py
"""

from __future__ import annotations

import time

import numpy as np
from field import field, ocean

from riftberg import Forcing, Iceberg, Model, Parameters

CASES = {
    "`mts`, springs as published": Parameters(stepping={"scheme": "mts"}, contact={"spring": 1e-7}),
    "`mts`, springs as stiff as the ice": Parameters(stepping={"scheme": "mts"}),
    "`mts`, crushing": Parameters(stepping={"scheme": "mts"}, contact={"law": "crushing"}),
    "`quasi_static`": Parameters(stepping={"scheme": "quasi_static"}),
}


def pieces() -> tuple[Iceberg, Forcing]:
    """Return a berg of 22 x 22 elements without bonds, at the rim of an eddy."""
    berg = Iceberg.rectangle(66e3, 66e3, thickness=250.0, radius=1500.0, placement=(-37.0, -56.0))
    berg.bonds.status[:] = 2
    berg.elements.bond_count[:] = 0
    berg.elements.berg[:] = np.arange(berg.elements.size)
    return berg, ocean(-37.3, -56.0)


def milliseconds(berg: Iceberg, sea: Forcing, parameters: Parameters, steps: int = 24) -> float:
    """Return processor time of a long step of half an hour, ms, after the first four."""
    model = Model(berg, sea, parameters.changed(stepping={"time_step": 1800.0}))
    model.advance(steps=4)
    began = time.process_time()
    model.advance(steps=steps)
    return 1e3 * (time.process_time() - began) / steps


def main() -> None:
    """Print a row for each case."""
    print("| ms a long step | field of 300 bergs | 484 pieces side by side |\n|---|---:|---:|")
    for name, parameters in CASES.items():
        costs = [milliseconds(berg, sea, parameters) for berg, sea in (field(300), pieces())]
        print(f"| {name} | {costs[0]:.1f} | {costs[1]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
