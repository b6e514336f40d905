"""The tip of the built-in A68a on a bed of sediment: when it breaks, in tension or bending, after which run-up.

python benchmarks/grounded_tip.py             print the table
python benchmarks/grounded_tip.py --write     also put it into docs/evidence/ground.md

Strength of the ice in tension, flexural strength and friction of the bed are varied one beside the others.
"""

from __future__ import annotations

import argparse
import copy
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lattices import LEAST
from story import put, table

from riftberg import Model
from riftberg.diagnostics.summary import breakups
from riftberg.engines.quasi_static.fracture.criteria import FLEXURAL
from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "ground.md"
DAYS = 9.0
"""To 18 December 13:00: the tip touches on 16 December."""

SHORT = 120.0
"""Time step (s) after the tip has touched."""

WATCHED = 6 * 3600.0
"""How long it is kept, s."""

NEVER = 1e12
"""A strength (Pa) that nothing exceeds; bending stress is recorded with it."""

CASES = [
    (9e3, NEVER, 0.5),
    (11e3, NEVER, 0.5),
    (14e3, NEVER, 0.5),
    (9e3, 2e5, 0.5),
    (11e3, 2e5, 0.5),
    (14e3, 2e5, 0.5),
    (NEVER, 2e5, 0.5),
    (11e3, 4e5, 0.5),
]
CASES += [(11e3, NEVER, 0.2)]
"""Strength in tension (Pa), flexural strength (Pa), friction."""

HEAD = ("tension", "flexural", "friction", "tip", "run-up", "bending before", "broken in bending")


class Case(NamedTuple):
    """What came of one case."""

    tip: str
    run_up: float  # Way of the berg from touching to the break of the tip, or to its rest or the end, m
    bending: float  # Largest bending stress on that way, Pa
    chips: str


def with_step(model: Model, seconds: float) -> None:
    """Go on with another time step."""
    model.parameters = model.parameters.changed(stepping={"time_step": seconds})
    model.constants = model.parameters.kernel_values()


def outcome(normal: float, flexural: float, friction: float) -> Case:
    """Run one case: with short steps from just before the tip touches, for a day or until it breaks off."""
    model = story_model(
        Options({
            "grounding": {"law": "seabed", "friction": friction},
            "fracture": {"normal_strength": normal, "shear_strength": NEVER if normal == NEVER else 100e3,
                         "flexural_strength": flexural},
        })
    )  # fmt: skip
    while not model.elements.keel.floor_load.any() and not breakups(model):
        before = copy.deepcopy(model)
        model.step()
    model, way, bending, tip, last, touched = before, 0.0, 0.0, None, None, math.inf
    with_step(model, SHORT)
    while model.time < DAYS * 86400.0:
        if last is not None and model.parameters.time_step == SHORT and model.time > touched + WATCHED:
            with_step(model, 1800.0)
        model.step()
        el = model.elements
        if tip is not None or not (last or el.keel.floor_load.any() or breakups(model)):
            continue
        touched = min(touched, model.time)
        place = float(np.average(el.lon, weights=el.mass)), float(np.average(el.lat, weights=el.mass))
        if last:
            north = math.radians(1.0) * model.parameters.earth.radius
            east = north * math.cos(math.radians(place[1]))
            way += math.hypot(east * (place[0] - last[0]), north * (place[1] - last[1]))
        last = place
        bending = max(bending, float(model.bonds.flexural_stress.max()))
        if (tip := next((b for b in breakups(model) if b["area_km2"] >= LEAST["tip"]), None)) is not None:
            with_step(model, 1800.0)
    bent, pieces = int((model.bonds.break_strength == FLEXURAL).sum()), breakups(model)
    small = [b["area_km2"] for b in pieces if b["area_km2"] < LEAST["tip"]]
    chips = f"{bent} bond{'s' if bent > 1 else ''}" + (
        f", {len(small)} pieces of {np.mean(small):.0f} km² each" if small else ""
    )
    words = "stays" if tip is None else f"{tip['area_km2']:.0f} km², {tip['time'][8:10]} Dec {tip['time'][11:16]}"
    return Case(words, way, bending, chips if bent else "nothing")


def _kpa(strength: float) -> str:
    return "none" if strength == NEVER else f"{strength / 1e3:g} kPa"


def main() -> None:
    """Run all, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    write, rows = parser.parse_args().write, []
    for normal, flexural, friction in CASES:
        found = outcome(normal, flexural, friction)
        rows.append((
            _kpa(normal), _kpa(flexural), f"{friction:g}", found.tip, f"{found.run_up:.0f} m",
            f"{found.bending / 1e3:.0f} kPa", found.chips,
        ))  # fmt: skip
        print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    text = table(HEAD, rows)
    print(text)
    if write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "grounded tip", text), "utf-8")


if __name__ == "__main__":
    main()
