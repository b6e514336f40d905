"""What A68a loses in three months by each melt law, against what was seen: the table in docs/evidence/melt.md.

``python benchmarks/melt_a68a.py``; a minute or two. The lattice is coarse (radius 6 km); with that of `a68a-melt` the first
three rows differ by 1 Gt at most. The berg is carried along its track with the water and melted every six hours; how it
moves in the water is left out, so that rows differ by their law alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from riftberg.bergs.bonding import count_bonds
from riftberg.experiments.a68a import MELT_DAYS, MELT_START, MELT_THICKNESS, TrackSea, melting_a68a
from riftberg.experiments.registry import Options
from riftberg.life.ledger import Ledger
from riftberg.life.melt import melt_step
from riftberg.life.process import water_by_process

FRESH_WATER = (152.0, 61.0)
"""Observed loss and its error, Gt."""

THINNING = (21.6, 6.9)
"""Observed melt of the base and its error in three months at the rate of the peak, m."""

STEP = 21600.0
RADIUS = 6000.0
LAWS: dict[str, dict[str, Any]] = {
    "base turbulent": {"base": "turbulent"},
    "base by two equations": {"base": "two_equation"},
    "base by three equations (`a68a-melt`)": {},
    "three equations, exchange by the layer": {"const_gamma": False},
    "three equations, tide 0.05 m/s": {"tide": 0.05},
    "three equations, tide 0.2 m/s": {"tide": 0.2},
    "all sides of all elements (`mode: berg`), base turbulent": {"mode": "berg", "base": "turbulent"},
}
SEAS = {"a degree warmer": TrackSea(warmest=4.3), "a degree colder": TrackSea(warmest=2.3)}


def row(name: str, melt: dict[str, Any], sea: TrackSea | None = None) -> str:
    """Melt once; a row of the table."""
    changes = {"stepping": {"time_step": STEP}, "melt": melt}
    model = melting_a68a(Options(changes=changes), radius=RADIUS, sea=sea)
    assert model.life is not None
    e, water_around = model.elements, model.forcing
    assert isinstance(water_around, TrackSea)
    count_bonds(e, model.bonds)
    e.body.berg[:] = 1
    ledger = Ledger(e)
    for step in range(round(MELT_DAYS * 86400.0 / STEP)):
        lon, lat = water_around.place(step * STEP)
        e.lon[:] += lon - e.lon.mean()
        e.lat[:] += lat - e.lat.mean()
        water_around.sample(e, step * STEP)
        e.u[:], e.v[:] = e.uo, e.vo
        model.life.follow_outlines(model)
        melted = melt_step(e, model.life.values, (MELT_START.year, 0.0))
        ledger.melted(melted, water_by_process(melted))
    balance, area = ledger.balance(e), e.length * e.width
    water = {process: mass / 1e12 for process, mass in balance.water.items()}
    total = sum(water.values())
    thinned = MELT_THICKNESS - float(np.average(e.thickness, weights=area))
    return (
        f"| {name} | {total:.0f} | {water['base']:.0f} | {water['waves']:.1f} | {water['sides']:.2f} | {thinned:.1f} | "
        f"{total / FRESH_WATER[0]:.2f} | {thinned / THINNING[0]:.2f} | {abs(balance.error):.0e} |"
    )


def main() -> None:
    """Print the table."""
    print(
        "| law | Gt | base | waves | sides | thinner by, m | Gt / observed | thinning / observed | ledger closes to |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, melt in LAWS.items():
        print(row(name, melt), flush=True)
    for name, sea in SEAS.items():
        print(row(f"three equations, {name}", {}, sea), flush=True)


if __name__ == "__main__":
    main()
