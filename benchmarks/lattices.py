"""The built-in A68a on twenty lattices: turned, shifted, of squares and of hexagons. What breaks off, and how far it spreads.

python benchmarks/lattices.py                      print the table

The strength is that of the ice, whatever the lattice.

python benchmarks/lattices.py --strength 10 12     for other strengths (kPa)
python benchmarks/lattices.py --tips 90            for strengths at the tips of crevasses (kPa), with a table of their own
python benchmarks/lattices.py --write              also put it into docs/evidence/a68a.md
"""

from __future__ import annotations

import argparse
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from story import put, table

from riftberg import Model
from riftberg.diagnostics.summary import breakups
from riftberg.errors import RunError
from riftberg.experiments import Options
from riftberg.experiments.a68a import DAYS, story_model

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "a68a.md"
STRENGTH = 11.0
"""Of the ice, kPa: with it tip and finger break off within the days on which they did, on all of the lattices."""

SHIFTS = [(k * 0.37 % 1.0, k * 0.61 % 1.0) for k in range(20)]
LATTICES = [("square", 9.0 * k, SHIFTS[2 * k] if k else None) for k in range(10)]
LATTICES += [("hexagonal", 6.0 * k, SHIFTS[2 * k + 1] if k else None) for k in range(10)]
"""Packing, angle (degrees), and shift in parts of the spacing (none: the one that fills the outline best)."""

TIP = datetime(2020, 12, 15), datetime(2020, 12, 19)
FINGER = datetime(2020, 12, 19), datetime(2020, 12, 24)
LEAST = {"tip": 60.0, "finger": 300.0}
"""Area (km2) from which a piece counts as one of both."""


class Outcome(NamedTuple):
    """What breaks off on a lattice: pieces with date and area (km2), by date."""

    pieces: list[tuple[datetime, float]]

    def first(self, name: str) -> tuple[datetime, float] | None:
        """First piece of the time and the size of the tip or the finger."""
        begin, end = TIP if name == "tip" else FINGER
        return next((p for p in self.pieces if begin <= p[0] < end and p[1] >= LEAST[name]), None)


def lattice_model(packing: Any, angle: float, shift: tuple[float, float] | None, **changes: Any) -> Model:
    """Return the story on a lattice, with other parameters."""
    lattice: dict[str, Any] = {"lattice_angle": angle}
    if shift is not None:
        lattice["offset"] = shift
    return story_model(Options({"berg": lattice, **changes}), packing=packing)


def outcome(packing: Any, angle: float, shift: tuple[float, float] | None, fracture: dict[str, float]) -> Outcome:
    """Run one lattice with a strength (Pa) of the ice, or one at the tips of its crevasses."""
    model = lattice_model(packing, angle, shift, fracture=fracture)
    try:
        model.advance(DAYS)
    except RunError as error:
        print(packing, angle, error, file=sys.stderr)
    return Outcome([(datetime.fromisoformat(e["time"][:16]), e["area_km2"]) for e in breakups(model)])


def row(of: str, found: list[Outcome], name: str) -> tuple[str, ...]:
    """Median and range over the lattices."""
    pieces = [piece for piece in (o.first(name) for o in found) if piece is not None]
    if not pieces:
        return (of, name, f"0 of {len(found)}", "", "", "", "")
    areas = np.array([area for _, area in pieces])
    zero = min(when for when, _ in pieces)
    hours = np.array([(when - zero) / timedelta(hours=1) for when, _ in pieces])
    dates = [f"{zero + timedelta(hours=float(h)):%d Dec %H:%M}" for h in np.percentile(hours, [50, 5, 95])]
    low, high = np.percentile(areas, [5, 95])
    return (
        of, name, f"{len(pieces)} of {len(found)}", dates[0], f"{dates[1]} to {dates[2]}", f"{np.median(areas):.0f} km²",
        f"{low:.0f} to {high:.0f} km²",
    )  # fmt: skip


def main() -> None:
    """Run all, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--strength", type=float, nargs="+", default=[STRENGTH], help="strengths, kPa")
    parser.add_argument(
        "--tips", type=float, nargs="+", default=[], help="strengths at the tips of crevasses instead, kPa"
    )
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    asked = parser.parse_args()
    rows = []
    key, mark = ("crevasse_strength", "crevasses") if asked.tips else ("normal_strength", "lattices")
    for strength in asked.tips or asked.strength:
        found = []
        for packing, angle, shift in LATTICES:
            found.append(outcome(packing, angle, shift, {key: 1e3 * strength}))
            pieces = ", ".join(f"{area:.0f} km² {when:%d. %H:%M}" for when, area in found[-1].pieces)
            print(strength, packing, angle, pieces or "nothing", file=sys.stderr, flush=True)
        of = f"{strength:g} kPa"
        rows += [row(of, found, name) for name in ("tip", "finger")]
    head = ("strength", "piece", "breaks off on", "median date", "5 to 95 %", "median area", "5 to 95 %")
    text = table(head, rows)
    print(text)
    if asked.write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), mark, text), "utf-8")


if __name__ == "__main__":
    main()
