"""Cost of contact in both schemes: a field of single bergs, and a berg in pieces that all lie beside each other.

python benchmarks/meetings.py
"""

from __future__ import annotations

import time

import numpy as np
from field import field, ocean

from riftberg import Forcing, Iceberg, Model, Parameters

CASES = (
    ("field of 300 bergs", None),
    ("484 pieces side by side, soft", 1e-7),
    ("484 pieces side by side, stiff", None),
)
"""Names, and stiffness of contact (s-2; none: that of the ice)."""


def pieces() -> tuple[Iceberg, Forcing]:
    """Return a berg of 22 x 22 elements without bonds, at the rim of an eddy."""
    berg = Iceberg.rectangle(66e3, 66e3, thickness=250.0, radius=1500.0, placement=(-37.0, -56.0))
    berg.bonds.status[:] = 2
    berg.elements.bond_count[:] = 0
    berg.elements.berg[:] = np.arange(berg.elements.size)
    return berg, ocean(-37.3, -56.0)


def milliseconds(scheme: str, berg: Iceberg, sea: Forcing, spring: float | None, steps: int = 24) -> float:
    """Return processor time of a long step, ms, after the first four."""
    model = Model(berg, sea, Parameters(stepping={"scheme": scheme, "time_step": 1800.0}, contact={"spring": spring}))
    model.advance(steps=4)
    began = time.process_time()
    model.advance(steps=steps)
    return 1e3 * (time.process_time() - began) / steps


def main() -> None:
    """Print a row for each case."""
    print("| case | `mts`, ms a long step | `quasi_static` | ratio |\n|---|---:|---:|---:|")
    for name, spring in CASES:
        costs = []
        for scheme in ("mts", "quasi_static"):
            berg, sea = field(300) if name.startswith("field") else pieces()
            costs.append(milliseconds(scheme, berg, sea, spring))
        print(f"| {name} | {costs[0]:.1f} | {costs[1]:.1f} | {costs[1] / costs[0]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
