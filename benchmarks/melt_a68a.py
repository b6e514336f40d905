"""What A68a loses in three months by each melt law, against what was seen: the table of the how-to page.

``python benchmarks/melt_a68a.py [--radius 3000]``; some minutes for all rows.
"""

from __future__ import annotations

import argparse
from typing import Any

from riftberg.experiments.a68a_melt import DAYS, FRESH_WATER, THICKNESS, THINNING, TrackSea, melting_a68a
from riftberg.experiments.options import Options

LAWS: dict[str, dict[str, Any]] = {
    "base turbulent": {"base": "turbulent"},
    "base by two equations": {"base": "two_equation"},
    "base by three equations": {},
    "base by three equations, exchange by the layer": {"const_gamma": False},
    "tide 0.05 m/s": {"tide": 0.05},
    "tide 0.2 m/s": {"tide": 0.2},
    "all sides, as KID does": {"mode": "berg", "base": "turbulent"},
}
SEAS = {"a degree warmer": TrackSea(warmest=4.3), "a degree colder": TrackSea(warmest=2.3)}


def row(name: str, melt: dict[str, Any], radius: float, sea: TrackSea | None = None) -> str:
    """Run once; a row of the table."""
    model = melting_a68a(Options(changes={"melt": melt} if melt else {}), radius=radius, sea=sea)
    model.advance(days=DAYS)
    assert model.life is not None
    balance = model.life.balance(model)
    water = {process: mass / 1e12 for process, mass in balance.water.items()}
    total, body = sum(water.values()), model.elements.body
    area = body.length * body.width
    thinned = THICKNESS - float((body.thickness * area).sum() / area.sum())
    return (
        f"| {name} | {total:.0f} | {water['base']:.0f} | {water['waves']:.0f} | {water['sides']:.1f} | {thinned:.1f} | "
        f"{total / FRESH_WATER[0]:.2f} | {thinned / THINNING[0]:.2f} | {abs(balance.error):.0e} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--radius", type=float, default=1500.0)
    radius = parser.parse_args().radius
    print("| law | Gt | base | waves | sides | thinner by, m | Gt / observed | thinning / observed | ledger |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, melt in LAWS.items():
        print(row(name, melt, radius), flush=True)
    for name, sea in SEAS.items():
        print(row(f"three equations, {name}", {}, radius, sea), flush=True)


if __name__ == "__main__":
    main()
