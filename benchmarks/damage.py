"""What damage does to the built-in A68a: break-ups by strength and time scale, what wears the bonds.

python benchmarks/damage.py             print table and figures
python benchmarks/damage.py --write     also put them into docs/evidence/damage.md
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from story import SMALL, print_tables, table

from riftberg.constants import SECONDS_PER_DAY
from riftberg.diagnostics.summary import breakups
from riftberg.experiments import Options
from riftberg.experiments.a68a import DAYS, story_model
from riftberg.runs.model import Model
from riftberg.state import Floats

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "damage.md"
STRENGTHS = (11.0, 13.0, 14.0, 16.0, 18.0, 21.0)
"""Normal strengths, kPa."""

TIMES = {"off": None, "10 days": 10.0, "3 days": 3.0, "1 day": 1.0, "6 hours": 0.25}
"""Time scales of the damage, days."""


def worn_model(kilopascal: float, days: float | None) -> Model:
    """Return the built-in run with another strength (kPa) and time scale of the damage (days; None is without)."""
    changes: dict[str, dict[str, Any]] = {"fracture": {"normal_strength": 1e3 * kilopascal}}
    if days is not None:
        changes["damage"] = {"enabled": True, "time_scale": days * SECONDS_PER_DAY}
    return story_model(Options(changes))


def told(model: Model) -> str:
    """Return when the tip (aground) and the finger (afloat) broke off: day and hour of December."""
    words = [
        f"{'tip' if event['grounded'] else 'finger'} {int(event['time'][8:10])}. {event['time'][11:16]}"
        for event in breakups(model)
        if event["area_km2"] >= SMALL
    ]
    return ", ".join(words) or "nothing"


def rows() -> Iterator[list[str]]:
    """Run all strengths with all time scales; a row for each strength."""
    for kilopascal in STRENGTHS:
        cells = []
        for days in TIMES.values():
            model = worn_model(kilopascal, days)
            model.advance(DAYS)
            cells.append(told(model))
        yield [f"{kilopascal:g} kPa", *cells]
        print(f"{kilopascal:g} kPa", file=sys.stderr, flush=True)


def ratios(model: Model) -> Floats:
    """Stress of every bond over its undamaged strength: the larger of tension and shear; 0 where it is broken."""
    fracture, bonds = model.parameters.fracture, model.bonds
    found = np.maximum(bonds.normal_stress / fracture.normal_strength, bonds.shear_stress / fracture.shear_strength)
    return np.where(bonds.status == 0, np.maximum(found, 0.0), 0.0)


def records(model: Model) -> Iterator[Floats]:
    """Run to the end and give the stress ratios after every long step."""
    for _ in range(round(DAYS * SECONDS_PER_DAY / model.parameters.time_step)):
        model.step()
        yield ratios(model)


def borne() -> str:
    """Say how much the bonds bear in the run without damage."""
    model = worn_model(11.0, None)
    by_step = np.array(list(records(model)))[:, model.bonds.status == 0]
    threshold = model.parameters.damage.threshold
    return (
        f"At the ends of the long steps of the run at 11 kPa without damage, the bonds that last bear less than "
        f"{np.quantile(by_step, 0.99):.2f} of their strength in 99 of 100 cases, {by_step.max():.2f} at most, "
        f"and more than the threshold of {threshold:g} in {100.0 * (by_step > threshold).mean():.2f} %."
    )


def main() -> int:
    """Run all, print table and sentences, and perhaps write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="put them into the documentation")
    write = parser.parse_args().write
    print_tables(PAGE, {"damage": table(("strength", *TIMES), rows()), "borne": borne()}, write=write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
