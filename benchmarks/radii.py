"""The built-in A68a on finer and finer lattices, with a strength over a distance: what breaks off, and at which stress.

python benchmarks/radii.py             print the table
python benchmarks/radii.py --write     also put it into docs/explanation/numerics.md

Each lattice runs on two sea floors: that of the story, which holds an element at once, and one whose drag sets in over a
clearance of 20 m. On each it runs without breaks, to see how far the mean stress rises while the tip is aground (until
18 December) and while the current loads the finger (from 19 December on), and with a strength.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

from story import SMALL, put, table

from riftberg.diagnostics.summary import breakups
from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model
from riftberg.parameters import Packing
from riftberg.runs.model import Model
from riftberg.stepping.fracture.criteria import Equilibrium, residual_strengths
from riftberg.stepping.quasi_static import step as quasi_static

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "numerics.md"
DISTANCE = 10.7e3
"""Of the mean, m: its disc has a radius of 1.75 spacings of the coarsest lattice, and is of one size for all."""

FLOORS = ((0.0, 8e3), (20.0, 2.5e3))
"""Clearance (m) over which the drag of the floor sets in, and strength (Pa)."""

LATTICES: tuple[tuple[Packing, float], ...] = (
    *(("square", radius) for radius in (1500.0, 1000.0, 750.0, 500.0)),
    *(("hexagonal", radius) for radius in (1500.0, 1000.0, 750.0)),
)
DAYS = 12.5
"""Length of the runs: to 22 December."""

LANDED, LOADED = (18.0 - 9.5) * 86400.0, (19.0 - 9.5) * 86400.0
"""End of the landing of the tip and start of the load of the finger, s since the start."""

NO_LIMIT = 1e9
"""A strength (Pa) at which nothing breaks."""

HEAD = (
    "lattice",
    "elements",
    "largest mean stress: finger",
    *(
        words
        for clearance, strength in FLOORS
        for words in (
            f"tip, floor {f'over {clearance:g} m' if clearance else 'at once'}",
            f"breaks off at {1e-3 * strength:g} kPa (day and hour of December)",
        )
    ),
)


class Watched(quasi_static.TimeStep):
    """A long step that notes the largest mean stress (Pa) of all its parts, and when (s since the start)."""

    seen: list[tuple[float, float]] = []  # noqa: RUF012

    def _record_peaks(self, *moments: Equilibrium | None) -> None:
        super()._record_peaks(*moments)
        self._note(self._equilibrium(self.state))

    def _store(self, now: Equilibrium) -> None:
        super()._store(now)
        self._note(now)

    def _note(self, now: Equilibrium) -> None:
        lattice = self.lattice
        ratio = lattice.criterion.most_critical(now, residual_strengths(self.bonds, lattice.intact, self.c))[1]
        Watched.seen.append((self.state.time, NO_LIMIT * ratio))


def model_of(packing: Packing, radius: float, clearance: float, strength: float) -> Model:
    """Build A68a on a floor, with a strength (Pa) over the distance."""
    fracture: dict[str, Any] = {"criterion": "averaged", "distance": DISTANCE, "normal_strength": strength}
    if strength == NO_LIMIT:
        fracture["shear_strength"] = NO_LIMIT
    changes = {
        "stepping": {"scheme": "quasi_static"}, "grounding": {"ramp_height": clearance}, "fracture": fracture
    }  # fmt: skip
    return story_model(Options(changes), radius=radius, packing=packing)


def largest(packing: Packing, radius: float, clearance: float) -> tuple[float, float]:
    """Largest mean stress (Pa) of the landing of the tip, and of the finger under its load."""
    model = model_of(packing, radius, clearance, NO_LIMIT)
    Watched.seen.clear()
    usual, quasi_static.TimeStep = quasi_static.TimeStep, Watched  # type: ignore[misc]
    try:
        model.advance(DAYS)
    finally:
        quasi_static.TimeStep = usual  # type: ignore[misc]
    return (
        max(stress for time, stress in Watched.seen if time < LANDED),
        max(stress for time, stress in Watched.seen if time > LOADED),
    )


def told(model: Model) -> str:
    """Run and return what breaks off, in words."""
    model.advance(DAYS)
    words = [
        f"{event['area_km2']:.0f} km² {int(event['time'][8:10])}. {event['time'][11:16]}"
        for event in breakups(model)
        if event["area_km2"] >= SMALL
    ]
    small = [event["area_km2"] for event in breakups(model) if event["area_km2"] < SMALL]
    pieces = ", ".join(words) or "nothing"
    return pieces + (f" and {math.fsum(small):.0f} km² in {len(small)} below {SMALL:g} km²" if small else "")


def row(packing: Packing, radius: float) -> tuple[str, ...]:
    """Run a lattice on both floors and return the cells of a row."""
    cells: list[str] = []
    for clearance, strength in FLOORS:
        tip, finger = largest(packing, radius, clearance)
        model = model_of(packing, radius, clearance, strength)
        cells += [f"{1e-3 * tip:.1f} kPa", told(model)]
        if clearance == 0.0:
            loaded = f"{1e-3 * finger:.1f} kPa"
    print(packing, radius, cells, file=sys.stderr, flush=True)
    return (f"{packing}, radius {1e-3 * radius:g} km", f"{model.elements.size}", loaded, *cells)


def main() -> None:
    """Run all, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    write = parser.parse_args().write
    text = table(HEAD, [row(*lattice) for lattice in LATTICES])
    print(text)
    if write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "radii", text), "utf-8")


if __name__ == "__main__":
    main()
