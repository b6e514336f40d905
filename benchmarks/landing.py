"""A berg that runs onto a seamount: the load of the landing, quasi-static against explicit with short steps.

python benchmarks/landing.py             print the table
python benchmarks/landing.py --write     also put it into docs/explanation/numerics.md

A berg of 30 km by 18 km drifts at 0.4 m/s. The explicit runs have long steps of 10 s and as many sub-steps as they need:
with the stiffness of ice (9 GPa) less than half a second each.
"""

from __future__ import annotations

import argparse
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

    def model(self) -> Model:
        """Build the model; nothing breaks."""
        stepping: dict[str, Any] = {"scheme": self.scheme, "landing_steps": self.landing_steps}
        if self.scheme == "mts":
            stepping["time_step"] = EXPLICIT_STEP
        parameters = Parameters(
            stepping=stepping, fracture={"enabled": False}, bonds={"youngs_modulus": self.youngs_modulus}
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
HEAD = (
    "scheme, 1800 s or (explicit) 10 s",
    "largest tension in three hours",
    "speed 1.3 hours after the first touch",
    "way east in the two hours around it",
)


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


def main() -> None:
    """Run all, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    write = parser.parse_args().write
    text = table(HEAD, [landing(run) for run in LANDINGS])
    print(text)
    if write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "landing", text), "utf-8")


if __name__ == "__main__":
    main()
