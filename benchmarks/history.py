"""What A68a cost at earlier commits, as ratios to this checkout, measured in turns in one run.

    python benchmarks/history.py HEAD~50 HEAD~100
    python benchmarks/history.py --every 100 --number 5
    python benchmarks/history.py --rounds 1 --folder F HEAD~50    first, to compile; with --rounds 3 to measure

Each commit is checked out beside this one and measured by a process of its own with a kernel cache of its own. A round
times every commit once; the least of all rounds counts, since other work on a machine only ever adds to it. The table of
docs/explanation/speed.md is one such run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

MEASURE = """
import json, time
from riftberg.experiments import Options, build
def days(model, number):
    steps = round(number * 86400.0 / model.parameters.time_step)
    began = time.process_time()
    for _ in range(steps):
        model.step()
    return (time.process_time() - began) / number
model, info = build("a68a", Options())
days(model, info.days)  # compiles, or loads what was compiled
figures = {name: days(build("a68a", Options())[0], n) for name, n in (("first day", 1.0), ("whole run", info.days))}
print(json.dumps(figures))
"""
"""Processor seconds per simulated day, of the first day and of the whole run."""


def git(*arguments: str) -> str:
    """Return what git prints."""
    return subprocess.run(
        ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True
    ).stdout.strip()


def measured(source: Path, cache: Path) -> dict[str, float] | None:
    """Measure a checkout; None where it does not run with the libraries installed here."""
    environment = {**os.environ, "PYTHONPATH": str(source), "RIFTBERG_CACHE": str(cache), "OMP_NUM_THREADS": "1"}
    run = subprocess.run([sys.executable, "-c", MEASURE], env=environment, capture_output=True, text=True, check=False)
    return json.loads(run.stdout.splitlines()[-1]) if run.returncode == 0 else None


def history(commits: list[str], rounds: int, folder: Path) -> list[dict[str, Any]]:
    """Measure commits and this checkout in turns; the least of each figure. Checkouts and machine code stand in a folder."""
    rows: dict[str, dict[str, Any]] = {}
    sources = {"this checkout": ROOT / "src"}
    for commit in commits:
        where = folder / commit
        where.mkdir(parents=True, exist_ok=True)
        archive = subprocess.run(["git", "-C", str(ROOT), "archive", commit, "src"], capture_output=True, check=True)
        subprocess.run(["tar", "-x", "-C", str(where)], input=archive.stdout, check=True)
        sources[commit] = where / "src"
    for _ in range(rounds):
        for name, source in sources.items():
            figures = measured(source, folder / f"cache {name}")
            row = rows.setdefault(name, {"commit": name})
            for key, value in (figures or {}).items():
                row[key] = min(value, row.get(key, value))
            print(row, file=sys.stderr, flush=True)
    return list(rows.values())


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table, oldest first; ratios are those to this checkout."""
    now = rows[0]
    lines = ["| commit | date | first day, s | ratio | whole run, s per day | ratio |", "|---|---|---:|---:|---:|---:|"]
    for row in (*rows[:0:-1], now):
        date = "" if row is now else git("show", "-s", "--format=%cs", row["commit"])
        cells = [row["commit"], date]
        for key in ("first day", "whole run"):
            cells += [f"{row[key]:.3f}", f"{row[key] / now[key]:.2f}"] if key in row else ["does not run", ""]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("commits", nargs="*", help="commits or tags to measure, newest first")
    parser.add_argument("--every", type=int, default=100, help="commits between those measured, if none is named")
    parser.add_argument("--number", type=int, default=5, help="how many are measured, if none is named")
    parser.add_argument("--rounds", type=int, default=3, help="times that each is measured")
    parser.add_argument("--folder", type=Path, help="where checkouts and machine code are kept; else they are removed")
    options = parser.parse_args()
    named = options.commits or [f"HEAD~{options.every * k}" for k in range(1, options.number + 1)]
    commits = [git("rev-parse", "--short", name) for name in named]
    with tempfile.TemporaryDirectory() as passing:
        print(markdown(history(commits, options.rounds, options.folder or Path(passing))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
