"""Seconds per simulated day of KID run directories, output off, beside those of the reference.

    python benchmarks/kid_cases.py FOLDER a68_synthetic a68_story a68_oras5

FOLDER holds the run directories. The reference's figures are those that came with these cases: Fortran, -O3, one core,
serial, output off.
"""

from __future__ import annotations

import sys
from pathlib import Path

from riftberg.diagnostics.speed import measure
from riftberg.kid.run import load_case

REFERENCE = {"a68_synthetic": 0.72, "a68_oras5": 1.53}
"""Wall seconds per simulated day of the reference."""

DAYS = 10.0
"""Days that are timed: several blocks of hourly records, so that their reading counts in full."""


def main() -> int:
    """Time the cases named on the command line."""
    folder, names = Path(sys.argv[1]), sys.argv[2:]
    print("| case | elements | reference, s per day | Riftberg, s per day | ratio |\n|---|---:|---:|---:|---:|")
    for name in names:
        speed = min(measure(load_case(folder / name).model, days=DAYS)["seconds_per_day"] for _ in range(3))
        elements = len(load_case(folder / name).model.elements.id)
        theirs = REFERENCE.get(name, float("nan"))
        print(f"| {name} | {elements} | {theirs:.2f} | {speed:.3f} | {theirs / speed:.1f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
