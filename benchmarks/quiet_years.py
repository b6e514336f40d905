"""Five quiet years of giants: bergs that lived for years must not break in the currents of years without an event.

python benchmarks/quiet_years.py             print the table
python benchmarks/quiet_years.py --write     also put it into docs/evidence/strength.md

A test of a strength that needs no event. The sea is a field of eddies by formula, without end in space or time: `MODES` waves
with random directions and phases, lengths of 80 to 400 km and periods of 40 to 200 days, in geostrophic balance, with a tide
and a wind that turns. The open Southern Ocean has 0.1 to 0.2 m/s. Coarse lattices, steps of six hours.
"""

from __future__ import annotations

import argparse
import sys
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from story import print_tables, table

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import GRAVITY, SECONDS_PER_DAY
from riftberg.diagnostics.summary import breakups
from riftberg.physics.crevasses import prestress, reserve
from riftberg.state import Elements

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "strength.md"

YEARS, MODES, CORIOLIS = 5.0, 40, -1.26e-4
CASES = ((1.0, 0.15, 90e3), (1.0, 0.3, 90e3), (17.8, 0.15, 79e3))
"""Factor on the drag of the water, speed of the eddies (rms, m s-1) and strength at the tips of crevasses (Pa).

The last one is that of the built-in A68a: 79 kPa is what its 11 kPa mean.
"""


class Giant(NamedTuple):
    """Size of a berg."""

    name: str
    length: float  # km
    width: float
    thickness: float  # m
    density: float  # kg m-3
    radius: float  # Of its elements, km


GIANTS = (
    Giant("A23a", 66.0, 54.0, 300.0, 880.0, 3.0),
    Giant("D28", 51.0, 32.0, 210.0, 850.0, 2.0),
    Giant("A76a", 135.0, 26.0, 250.0, 870.0, 3.25),
)
"""3,590, 1,630 and 3,510 km2 as rectangles; thicknesses are assumed from their ice shelves."""


class EddySea(Forcing.uniform):
    """Eddies by waves of a stream function, a tide and a turning wind; on a plane.

    ``rms``: speed of the eddies, m s-1.
    """

    def __init__(self, rms: float, seed: int = 1) -> None:
        super().__init__()
        draw = np.random.default_rng(seed)
        angle, length = draw.uniform(0.0, 2.0 * np.pi, MODES), draw.uniform(80e3, 400e3, MODES)
        self.wave = 2.0 * np.pi / length * np.array([np.cos(angle), np.sin(angle)])
        self.rate = 2.0 * np.pi / (SECONDS_PER_DAY * draw.uniform(40.0, 200.0, MODES))
        self.phase = draw.uniform(0.0, 2.0 * np.pi, MODES)
        self.speed = rms * np.sqrt(2.0 / MODES) * np.array([-np.sin(angle), np.cos(angle)])

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        e = elements
        at = np.outer(e.lon, self.wave[0]) + np.outer(e.lat, self.wave[1]) + self.rate * time + self.phase
        u, v = self.speed @ np.cos(at).T
        tide, day = 2.0 * np.pi * time / 44714.0, 2.0 * np.pi * time / SECONDS_PER_DAY
        e.uo[:], e.vo[:] = u + 0.05 * np.cos(tide), v + 0.05 * np.sin(tide)
        e.slope_x[:], e.slope_y[:] = CORIOLIS * e.vo / GRAVITY, -CORIOLIS * e.uo / GRAVITY
        e.ua[:], e.va[:] = 10.0 * np.cos(day / 4.3), 10.0 * np.sin(day / 4.3)


def lived(giant: Giant, scale: float, rms: float, tips: float, years: float = YEARS) -> tuple[str, ...]:
    """Return the row of a berg that lives for some years: its largest tension over strength, and what breaks off."""
    p = Parameters(
        earth={"latlon": False, "f_plane": True, "reference_latitude": -60.0}, ice={"density": giant.density},
        drag={"ocean_scale": scale}, fracture={"crevasse_strength": tips}, stepping={"time_step": 21600.0},
    )  # fmt: skip
    berg = Iceberg.rectangle(
        1e3 * giant.length, 1e3 * giant.width, thickness=giant.thickness, density=giant.density, radius=1e3 * giant.radius,
        placement=(0.0, 0.0), latlon=False, lattice_angle=15.0,
    )  # fmt: skip
    model = Model(berg, EddySea(rms), p)
    largest, bears = 0.0, reserve(tips, prestress(giant.thickness, giant.density))

    def watch(run: Any) -> None:
        nonlocal largest
        largest = max(largest, float(run.bonds.normal_stress.max()))

    model.after_step.append(watch)
    model.advance(365.25 * years)
    days = [(datetime.fromisoformat(e["time"]) - model.start).days for e in breakups(model)]
    off = ", ".join(f"{e['area_km2']:.0f} km² on day {day}" for e, day in zip(breakups(model), days, strict=True))
    return (
        giant.name, f"{giant.length:g} x {giant.width:g} km, {giant.thickness:g} m", f"{scale:g}",
        f"{rms:g} m/s", f"{1e-3 * tips:g} kPa",
        f"{1e-3 * bears:.1f} kPa", f"{1e-3 * largest:.1f} kPa", off or "nothing",
    )  # fmt: skip


HEAD = ("berg", "size", "drag times", "eddies, rms", "strength at tips", "reserve", "largest tension", "breaks off")


def main() -> int:
    """Run all, print the table and perhaps write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    asked = parser.parse_args()
    rows = []
    for giant in GIANTS:
        for scale, rms, tips in CASES:
            rows.append(lived(giant, scale, rms, tips))
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    print_tables(PAGE, {"quiet years": table(HEAD, rows)}, write=asked.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
