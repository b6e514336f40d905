"""The story of the built-in A68a and its controls: what breaks off, when, where, aground or afloat.

python benchmarks/story.py             print the table
python benchmarks/story.py --write     also put it into docs/explanation/a68a-story.md
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from riftberg.diagnostics.summary import breakups, fragment_areas
from riftberg.experiments import Options, build

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "a68a-story.md"
BEGIN, END = "<!-- story: begin -->", "<!-- story: end -->"
SMALL = 50.0
"""Pieces below this area (km2) are counted, not listed."""


@dataclass(frozen=True)
class Run:
    """One row of the table."""

    name: str
    without: frozenset[str] = frozenset()
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)
    numerics: str = "own"


def strength(pascal: float) -> dict[str, dict[str, Any]]:
    """Change the strength of the bonds."""
    return {"fracture": {"normal_strength": pascal}}


RUNS = (
    Run("`riftberg run a68a`"),
    Run("`--without shoal`", frozenset({"shoal"})),
    Run("`--without shear`", frozenset({"shear"})),
    Run("`--without shoal --without shear`", frozenset({"shoal", "shear"})),
    Run("strength 16 kPa", changes=strength(16e3)),
    Run("strength 20 kPa", changes=strength(20e3)),
    Run("strength 22 kPa", changes=strength(22e3)),
    Run("twice the sub-steps", changes={"stepping": {"substeps": 180}}),
    Run("half the long step", changes={"stepping": {"time_step": 900.0, "substeps": 45}}),
    Run("`--numerics reference`", numerics="reference"),
)
HEAD = (
    "run",
    "breaks off (area, day and hour of December, water)",
    "largest piece, km²",
    "bonds broken",
    "of them by 23 Dec",
)


def told(event: dict[str, Any]) -> str:
    """Return a break-up in words."""
    day, hour = event["time"][8:10], event["time"][11:16]
    return f"{event['area_km2']:.0f} km² {int(day)}. {hour} {'aground' if event['grounded'] else 'afloat'}"


def row(run: Run) -> tuple[str, ...]:
    """Run and return the cells of a row."""
    model, info = build("a68a", Options(without=run.without, changes=run.changes, numerics=run.numerics))  # type: ignore[arg-type]
    model.advance(info.days)
    events = breakups(model)
    large = [told(event) for event in events if event["area_km2"] >= SMALL]
    small = Counter(event["area_km2"] >= SMALL for event in events)[False]
    limit = (23 - model.start.day) * 86400.0 - model.start.hour * 3600.0
    early = int((model.bonds.break_time < limit).sum())
    words = ", ".join(large) or "nothing"
    return (
        run.name, words + (f" and {small} below {SMALL:g} km²" if small else ""), f"{fragment_areas(model)[0]:.0f}",
        str(model.bonds_broken), f"{early} = {100 * early / model.bonds.status.size:.1f} %",
    )  # fmt: skip


def main() -> int:
    """Run all, print the table and perhaps write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="put the table into the documentation")
    write = parser.parse_args().write
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    for run in RUNS:
        lines.append("| " + " | ".join(row(run)) + " |")
        print(run.name, file=sys.stderr, flush=True)
    text = "\n".join(lines)
    print(text)
    if write:
        before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.partition(END)[2]}", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
