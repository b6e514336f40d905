"""The long form of the fuzzer: ``python tests/fuzz/long.py --kinds 2000`` prints how many kinds had which verdict.

It runs damaged input of every class, the families of faults with values that are known, and the layouts of forcing
files; ``--damaged``, ``--faults`` and ``--layouts`` take one of the three. ``--only TEXT`` takes the families (or
layouts) whose names hold TEXT, ``--part 1/4`` every fourth kind; ``--show`` prints the message of every kind. With
``--results FILE`` the verdicts are kept there, and a second call goes on where the first was stopped. The process
may not take more than `MEMORY`; if it is killed all the same, ``now.txt`` in its folder names the kind that it was at.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import sys
from collections import Counter
from pathlib import Path
from tempfile import mkdtemp

os.environ.setdefault("MPLBACKEND", "Agg")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from fuzz.base_files import store
from fuzz.families import faults
from fuzz.judging import BAD, GOOD, Kind, Verdict, judge_apart
from fuzz.kid_kinds import good_ends
from fuzz.kinds import kinds
from fuzz.layouts import layouts
from fuzz.more_kinds import more

MEMORY = 8 * 2**30
"""Address space of the process, bytes: a kind that asks for more is found out, and the machine lives on."""


def main() -> int:
    """Run the kinds and print the counts; the exit code is 1 where one was not met well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", type=int, default=2000, help="at least so many kinds of damaged input")
    parser.add_argument("--damaged", action="store_true", help="damaged input alone")
    parser.add_argument("--faults", action="store_true", help="families of faults alone")
    parser.add_argument("--layouts", action="store_true", help="layouts of forcing files alone")
    parser.add_argument("--only", default="", help="families whose names hold this")
    parser.add_argument("--part", default="1/1", help="k/n: every n-th kind, for several processes")
    parser.add_argument(
        "--results", type=Path, help="file of verdicts, one a line: kinds that stand there are not judged again"
    )
    parser.add_argument("--show", action="store_true", help="print the message of every kind")
    given = parser.parse_args()
    part, parts = (int(number) for number in given.part.split("/"))
    chosen = [kind for kind in _asked(given) if given.only in f"{kind.family}: {kind.name}"]
    random.Random(1).shuffle(chosen)
    chosen = chosen[part - 1 :: parts]
    judged: dict[str, tuple[str, float]] = {}
    if given.results and given.results.exists():
        rows = [json.loads(line) for line in given.results.read_text().splitlines()]
        judged = {name: (what, seconds) for name, what, seconds, _ in rows}
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    store()  # what is compiled and loaded here is ready in every process that is forked from this one
    good_ends()
    folder = Path(mkdtemp(prefix="riftberg-kinds-"))
    counts: Counter[str] = Counter()
    longest = 0.0
    for number, kind in enumerate(chosen):
        name = f"{kind.family}: {kind.name}"
        if name in judged:
            counts[judged[name][0]] += 1
            longest = max(longest, judged[name][1])
            continue
        (folder / "now.txt").write_text(f"{name}\n")
        verdict = judge_apart(kind, folder / str(number))
        counts[verdict.what] += 1
        longest = max(longest, verdict.seconds)
        if given.results:
            with given.results.open("a") as file:
                file.write(json.dumps([name, verdict.what, verdict.seconds, verdict.message]) + "\n")
        if verdict.what in BAD or given.show:
            _print(verdict)
        shutil.rmtree(folder / str(number), ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)
    bad = sum(counts[what] for what in BAD)
    print(f"{len(chosen)} kinds, {len({kind.family for kind in chosen})} classes, the longest {longest:.1f} s")
    for what in (*GOOD, *BAD):
        print(f"  {what:30} {counts[what]}")
    print(f"  bad: {bad}")
    return 1 if bad else 0


def _asked(given: argparse.Namespace) -> list[Kind]:
    """Return the kinds that the options ask for: all, or one of the three sorts."""
    everything = not (given.damaged or given.faults or given.layouts)
    chosen: list[Kind] = []
    if given.damaged or everything:
        fixed = sum(1 for _ in (*kinds(0), *more(0)))
        seeds = max(20, -(-(given.kinds - fixed) // 17))
        chosen += [*kinds(seeds), *more(seeds)]
    if given.faults or everything:
        chosen += faults()
    if given.layouts or everything:
        chosen += layouts()
    return chosen


def _print(verdict: Verdict) -> None:
    print(
        f"[{verdict.what}] {verdict.kind.family}: {verdict.kind.name} ({verdict.seconds:.1f} s)\n    {verdict.message.strip()}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
