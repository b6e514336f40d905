"""Seconds per simulated day of KID run directories, output off.

    python benchmarks/kid_cases.py FOLDER a68_synthetic a68_story a68_oras5

FOLDER holds the run directories. The reference is another program: what it takes can be set beside these figures only where both
are timed in turn on one machine, so no ratio is printed here.
"""

from __future__ import annotations

import sys
from pathlib import Path

from bench import measure

from riftberg.kid.run import load_case

DAYS = 10.0
"""Days that are timed: several blocks of hourly records, so that their reading counts in full."""


def main() -> int:
    """Time the cases named on the command line."""
    folder, names = Path(sys.argv[1]), sys.argv[2:]
    print("| case | elements | s per day |\n|---|---:|---:|")
    for name in names:
        speed = min(measure(load_case(folder / name).model, days=DAYS)["seconds_per_day"] for _ in range(3))
        print(f"| {name} | {len(load_case(folder / name).model.elements.id)} | {speed:.3f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
