"""Cost of the quasi-static scheme: A68a and square bergs, processor time of a day, and where the solve and the factors stand.

python benchmarks/quasi_static.py [NUMBER ...]
"""

from __future__ import annotations

import sys
import time
from typing import Any

from riftberg.diagnostics.speed import square_berg, yardstick_seconds_per_day
from riftberg.experiments import build
from riftberg.experiments.registry import Options

CHANGES: dict[str, Any] = {"stepping": {"scheme": "quasi_static"}}


def seconds_per_day(model: Any, steps: int, repeats: int = 3) -> float:
    """Return processor seconds of a day: the quickest of some spells of ``steps`` long steps, after the first two."""
    model.advance(steps=2)
    costs = []
    for _ in range(repeats):
        began = time.process_time()
        model.advance(steps=steps)
        costs.append((time.process_time() - began) * 48.0 / steps)
    return min(costs)


def row(name: str, model: Any, steps: int) -> str:
    """Return a row of the table for one model with long steps of 1800 s."""
    cost = seconds_per_day(model, steps)
    stick = yardstick_seconds_per_day(model)
    factors = model._stepper._lattice.solver._ldl.factors
    size = sum(a.nbytes for a in factors[:5]) / 2**20
    return (
        f"| {name} | {model.elements.size:,} | {cost:.4f} | {cost / stick:.2f} | {1e3 * cost / 48:.2f} | {size:.1f} |"
    )


def main(numbers: list[int]) -> None:
    """Print a row for A68a and one for each number of elements of a square berg."""
    print("| berg | elements | s per day | yardsticks | ms per step | factors, MiB |\n|---|---:|---:|---:|---:|---:|")
    a68a, _ = build("a68a", Options(changes=CHANGES))
    print(row("A68a", a68a, 48), flush=True)
    for number in numbers:
        print(row("square", square_berg(number, lambda p: p.changed(**CHANGES)), 10), flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [1000, 10_000])
