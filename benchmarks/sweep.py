"""What a sweep costs beside single runs: 200 members of A68a should cost no more than 1.15 times 200 single runs over the cores.

    python benchmarks/sweep.py [--days 4] [--members 8] [--workers 2]

Two sweeps of a shorter case, one of twice the members, give the time to start the workers and the time of a member. From these
and one single run of the whole 17 days the ratio of the full sweep is predicted; those of the short sweeps are measured.
A single run is timed in this process, compiled and loaded: the hardest one to keep up with.
"""

from __future__ import annotations

import argparse
import time

from riftberg import sweep
from riftberg.experiments import Options, build

FULL_DAYS, FULL_MEMBERS = 17.0, 200
"""The case that is asked for."""


def single(days: float, strength: float = 18e3) -> float:
    """Return the wall time (s) of one run."""
    began = time.perf_counter()
    build("a68a", Options({"fracture": {"normal_strength": strength}}))[0].advance(days)
    return time.perf_counter() - began


def swept(days: float, members: int, workers: int) -> float:
    """Return the wall time (s) of a sweep, the start of its workers included."""
    began = time.perf_counter()
    sweep("a68a", [f"fracture.normal_strength=16..20kPa:{members}"], days=days, workers=workers)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--days", type=float, default=4.0, help="length of the short runs")
    parser.add_argument(
        "--members", type=int, default=8, help="members of the first sweep; the second has twice as many"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes, not more than there are cores")
    given = parser.parse_args()
    single(0.1)  # compiles, or loads what was compiled
    one = min(single(given.days) for _ in range(3))
    whole = single(FULL_DAYS)
    counts = given.members, 2 * given.members
    walls = [swept(given.days, count, given.workers) for count in counts]
    member = (walls[1] - walls[0]) / given.members * given.workers
    start = max(walls[0] - counts[0] * member / given.workers, 0.0)
    print(f"one run of {given.days:g} days: {one:.3f} s; of {FULL_DAYS:g} days: {whole:.3f} s; {given.workers} workers")
    for count, wall in zip(counts, walls, strict=True):
        print(
            f"{count} members: {wall:.2f} s, {wall / (count * one / given.workers):.2f} times single runs over workers"
        )
    share = member / one
    print(f"a member costs {share:.2f} single runs; starting the workers {start:.2f} s")
    full = (start + FULL_MEMBERS * whole * share / given.workers) / (FULL_MEMBERS * whole / given.workers)
    print(
        f"predicted for {FULL_MEMBERS} members of {FULL_DAYS:g} days: {full:.3f} times single runs over workers (asked: 1.15)"
    )


if __name__ == "__main__":
    main()
