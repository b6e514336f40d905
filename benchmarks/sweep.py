"""What a sweep costs beside single runs: 200 members of A68a should cost no more than 1.15 times 200 single runs over the cores.

    python benchmarks/sweep.py [--days 4] [--members 8] [--workers 2] [--pairs 3]

Two sweeps of a shorter case, one of twice the members, give the time to start the workers and the time of a member. The same
members are run as plain processes, as many at a time as there are workers, and one after the other; the three stand in pairs.
From these and one single run of the whole 17 days the ratio of the full sweep is predicted.
"""

from __future__ import annotations

import argparse
import time
from multiprocessing import get_context
from statistics import median

from riftberg import sweep
from riftberg.experiments import Options, build

FULL_DAYS, FULL_MEMBERS = 17.0, 200
"""The case that is asked for."""


def single(days: float, strength: float = 18e3) -> float:
    """Return the wall time (s) of one run."""
    began = time.perf_counter()
    build("a68a", Options({"fracture": {"normal_strength": strength}}))[0].advance(days)
    return time.perf_counter() - began


def _strengths(members: int) -> list[float]:
    return [16e3 + 4e3 * k / (members - 1) for k in range(members)]


def alone(days: float, members: int) -> float:
    """Return the wall time (s) of the members one after the other."""
    return sum(single(days, strength) for strength in _strengths(members))


def plain(days: float, members: int, workers: int) -> float:
    """Return the wall time (s) of the members as plain processes that have compiled and loaded all."""
    with get_context("spawn").Pool(workers) as pool:
        pool.map(single, [0.1] * workers, chunksize=1)
        began = time.perf_counter()
        pool.starmap(single, [(days, strength) for strength in _strengths(members)], chunksize=1)
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
    parser.add_argument("--pairs", type=int, default=3, help="how often all is timed")
    given = parser.parse_args()
    days, members, workers = given.days, given.members, given.workers
    single(0.1)  # compiles, or loads what was compiled
    whole = single(FULL_DAYS)
    ratios = []
    for _ in range(given.pairs):
        one, two = alone(days, members) / workers, plain(days, members, workers)
        first, second = swept(days, members, workers), swept(days, 2 * members, workers)
        more, start = second - first, max(2.0 * first - second, 0.0)
        full = FULL_MEMBERS * whole / workers
        ratios.append((more / one, more / two, more / two + start / full))
        print(
            f"{members} members of {days:g} days: one after the other over {workers} workers {one:.2f} s, as plain "
            f"processes {two:.2f} s, in a sweep {more:.2f} s and {start:.2f} s for its start", flush=True,
        )  # fmt: skip
    for name, row in zip(
        ("single runs over workers", "plain processes", f"plain processes, {FULL_MEMBERS} members of 17 days"),
        zip(*ratios, strict=True),
        strict=True,
    ):
        print(f"a member costs {median(row):.2f} times {name} (asked: 1.15)")


if __name__ == "__main__":
    main()
