"""How cost and memory grow with the number of elements: 500 to 100,000, each in processes of its own, the best of three.

    python benchmarks/scaling.py                 the table, as Markdown
    python benchmarks/scaling.py --json          the raw measurements
    python benchmarks/scaling.py --sizes 500 2000 --scheme quasi_static

Predicted is 25 ns for each element and sub-step: 11 microseconds for 440 elements, measured for gather, law and sum alone
while the layout of the bonds was designed. It knows nothing of the long step, nor of caches.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

SIZES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
PREDICTED = 25e-9
"""Seconds for an element and a sub-step."""
REPEATS = 3
"""Runs of each size."""
LONG_STEP = 1800.0
"""Long step of these runs, s."""


def measure(size: int, scheme: str) -> dict[str, Any]:
    """Time a rectangular berg of ``size`` elements in fresh processes; the fastest run counts."""
    command = [
        sys.executable,
        str(Path(__file__).with_name("bench.py")),
        "--scaling",
        f"{size}..{size}",
        "--json",
        "--set",
        f"stepping.scheme={scheme}",
    ]
    runs = [subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(REPEATS)]
    row: dict[str, Any] = min(
        (json.loads(run.stdout)[0] for run in runs), key=lambda row: float(row["seconds_per_day"])
    )
    row["seconds_per_long_step"] = row["seconds_per_day"] * LONG_STEP / 86400.0
    row["predicted_seconds_per_day"] = PREDICTED * row["elements"] * row["substeps_per_day"]
    row["load"] = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return row


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table."""
    head = ("elements", "bonds", "sub-steps a day", "s per long step", "s per day", "predicted", "yardsticks", "MiB")
    lines = ["| " + " | ".join(head) + " |", "|" + "---:|" * len(head)]
    for r in rows:
        cells = (
            f"{r['elements']:,}", f"{r['bonds']:,}", f"{r['substeps_per_day']:.0f}", f"{r['seconds_per_long_step']:.2g}",
            f"{r['seconds_per_day']:.3g}", f"{r['predicted_seconds_per_day']:.3g}", f"{r['relative_to_yardstick']:.2f}",
            f"{r['memory_mb']:.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print the raw measurements")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of elements")
    parser.add_argument("--scheme", default="mts", help="scheme of the runs")
    options = parser.parse_args()
    rows = []
    for size in options.sizes:
        rows.append(measure(size, options.scheme))
        print(f"{size} elements: {rows[-1]['seconds_per_day']:.3g} s per day", file=sys.stderr, flush=True)
    print(json.dumps(rows, indent=1) if options.json else markdown(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
