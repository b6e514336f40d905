"""A berg that runs onto a seamount: the load of the landing and the pieces, quasi-static against explicit with short steps.

python benchmarks/landing.py             print the tables
python benchmarks/landing.py --write     also put them into docs/explanation/numerics.md

A berg of 30 km by 18 km drifts at 0.4 m/s. The explicit runs have long steps of 10 s and as many sub-steps as they need:
with the stiffness of ice (9 GPa) less than half a second each.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from story import put, table

from riftberg import Forcing, Iceberg, Model, Parameters

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "numerics.md"
SPEED = 0.4
"""Of current and berg, m s-1."""

BEFORE, HOUR = 7.5 * 3600.0, 3600.0
"""Start of the comparison, s since the start: the first element touches at 8.24 h."""

EXPLICIT_STEP = 10.0
"""Long step of the explicit runs, s."""


@dataclass(frozen=True)
class Run:
    """One row: a scheme and what it depends on."""

    name: str
    scheme: str
    landing_steps: int = 8
    youngs_modulus: float = 9e9

    def model(self, strength: float = 0.0, spring: float | None = None) -> Model:
        """Build the model; without a strength (Pa) nothing breaks, ``spring`` is that of contact (s-2)."""
        stepping: dict[str, Any] = {"scheme": self.scheme, "landing_steps": self.landing_steps}
        if self.scheme == "mts":
            stepping["time_step"] = EXPLICIT_STEP
        fracture = {"enabled": strength > 0.0, "normal_strength": strength}
        parameters = Parameters(
            stepping=stepping, fracture=fracture, contact={"spring": spring}, bonds={"youngs_modulus": self.youngs_modulus}
        )
        berg = Iceberg.rectangle(30e3, 18e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(SPEED, 0.0))
        sea = Forcing.uniform(current=(SPEED, 0.0))
        sea = sea + Forcing.seamount((-36.4, -55.97), height=400.0, width=20e3, depth=500.0)
        return Model(berg, sea, parameters)


LANDINGS = (
    *(Run(f"`quasi_static`, `landing_steps` {parts}", "quasi_static", parts) for parts in (1, 2, 8, 32)),
    Run("`quasi_static`, `landing_steps` 8, 5 MPa", "quasi_static", 8, 5e6),
    *(
        Run(f"explicit, {name}", "mts", youngs_modulus=youngs)
        for name, youngs in (("9 GPa", 9e9), ("90 MPa", 9e7), ("5 MPa", 5e6))
    ),
)
LANDING_HEAD = ("scheme, 1800 s or (explicit) 10 s", "largest tension in three hours", "speed an hour after the touch", "way since then")
BREAKS = ((18e3, 1e-7), (18e3, None), (8e3, 1e-7), (8e3, None))
"""Strength (Pa) and stiffness of contact (s-2; none: that of the ice)."""

BREAKING = (LANDINGS[2], LANDINGS[4], LANDINGS[5], LANDINGS[7])
BREAK_HEAD = ("scheme", *(f"{1e-3 * s:.0f} kPa, contact {'of the ice' if k is None else 'soft'}" for s, k in BREAKS))


def landing(run: Run) -> tuple[str, ...]:
    """Run the berg onto the seamount without breaks, and return the cells of a row."""
    model = run.model()
    model.advance(BEFORE / 86400.0)
    largest, speed, way = 0.0, 0.0, 0.0
    start = float(model.elements.lon.mean())
    while model.time < BEFORE + 3.0 * HOUR - 1.0:
        model.step()
        largest = max(largest, float(model.bonds.peak_stress.max()))
        if abs(model.time - BEFORE - 2.0 * HOUR) < 1.0:
            speed = float((model.elements.u_sync**2 + model.elements.v_sync**2).mean() ** 0.5)
            way = float(model.elements.lon.mean() - start) * 62.1e3
    return run.name, f"{1e-3 * largest:.1f} kPa", f"{100.0 * speed:.1f} cm/s", f"{way:.0f} m"


def broken(run: Run) -> tuple[str, ...]:
    """Run it with breaks for twelve hours, and return the cells of a row: bonds and pieces."""
    cells = []
    for strength, spring in BREAKS:
        model = run.model(strength, spring)
        model.advance(0.5)
        cells.append(f"{model.bonds_broken} bonds, {model.fragment_count} pieces")
    return run.name, *cells


def tables() -> Iterator[tuple[str, str]]:
    """Names and texts of both tables."""
    yield "landing", table(LANDING_HEAD, [landing(run) for run in LANDINGS])
    yield "landing-breaks", table(BREAK_HEAD, [broken(run) for run in BREAKING])


def main() -> None:
    """Run all, print the tables, write them where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    write = parser.parse_args().write
    for name, text in tables():
        print(text, end="\n\n", flush=True)
        if write:
            PAGE.write_text(put(PAGE.read_text("utf-8"), name, text), "utf-8")


if __name__ == "__main__":
    main()
