"""One berg of 300 x 200 x 100 m in a steady current, in OpenBerg and here: why their drifts differ.

python benchmarks/coming_from_opendrift.py             print the table
python benchmarks/coming_from_opendrift.py --write     also put it into docs/evidence/coming-from-opendrift.md

OpenBerg (OpenDrift 1.14) integrates the balance of Keghouche et al. (2010) over each time step from the velocity of the
water, not from the berg's own, and moves the berg with the velocity at the end of the step. The balance is written down here
from the publication, and integrated both ways.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from story import put, table

from riftberg import Forcing, Iceberg, Model, Parameters

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "coming-from-opendrift.md"
LENGTH, WIDTH, SAIL, DRAFT = 300.0, 200.0, 12.4, 87.6
CURRENT, LATITUDE, DAYS = 0.2, -56.0, 5.0
FORM_DRAG, SKIN_DRAG = 0.25, 0.0055
AIR_FORM_DRAG, AIR_SKIN_DRAG = 0.8, 0.0022


def openberg(step: float, *, remembers: bool) -> complex:
    """Way (km, east + i north) in OpenBerg's balance, from the velocity of the water in each step or from that of the berg."""
    area, mass = LENGTH * WIDTH, 900.0 * LENGTH * WIDTH * (SAIL + DRAFT)
    water = 1027.0 * (0.5 * FORM_DRAG * LENGTH * DRAFT + SKIN_DRAG * area) / mass
    air = 1.293 * (0.5 * AIR_FORM_DRAG * LENGTH * SAIL + AIR_SKIN_DRAG * area) / mass
    coriolis = 2.0 * 7.2921e-5 * math.sin(math.radians(LATITUDE))
    # Still air takes its part of the speed at which a step begins.
    ratio = math.sqrt(1.293 * AIR_FORM_DRAG * SAIL / (1027.0 * FORM_DRAG * DRAFT))
    begin = CURRENT / (1.0 + ratio) + 0.0j

    def rate(v: complex) -> complex:
        return water * abs(CURRENT - v) * (CURRENT - v) - air * abs(v) * v - 1j * coriolis * v

    velocity, way, parts = begin, 0.0j, math.ceil(step / 60.0)
    dt = step / parts
    for _ in range(round(DAYS * 86_400.0 / step)):
        if not remembers:
            velocity = begin
        for _ in range(parts):
            k1 = rate(velocity)
            k2 = rate(velocity + 0.5 * dt * k1)
            k3 = rate(velocity + 0.5 * dt * k2)
            velocity += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(velocity + dt * k3))
        way += 1e-3 * step * velocity
    return way


def riftberg(step: float) -> complex:
    """Way (km) here: a square of the same area, without a slope of the sea surface."""
    berg = Iceberg.from_points(
        [-39.0], [LATITUDE], length=math.sqrt(LENGTH * WIDTH), width=math.sqrt(LENGTH * WIDTH), thickness=SAIL + DRAFT
    )
    model = Model(
        berg, Forcing.uniform(current=(CURRENT, 0.0), slope=(0.0, 0.0)), Parameters(stepping={"time_step": step})
    )
    model.advance(days=DAYS)
    lon, lat = float(model.elements.lon[0]), float(model.elements.lat[0])
    return 111.0 * complex((lon + 39.0) * math.cos(math.radians(0.5 * (lat + LATITUDE))), lat - LATITUDE)


def main() -> None:
    """Print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    write = parser.parse_args().write
    steps = (600.0, 1800.0, 3600.0, 10_800.0)
    rows = [
        ("OpenBerg: each step from the water's velocity", *(_km(openberg(step, remembers=False)) for step in steps)),
        ("the same balance, from the berg's velocity", *(_km(openberg(step, remembers=True)) for step in steps)),
        ("Riftberg", *(_km(riftberg(step)) for step in steps)),
    ]
    text = table(("km east, north, with steps of", "10 min", "30 min", "1 h", "3 h"), rows)
    print(text)
    if write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "OpenBerg", text), "utf-8")


def _km(way: complex) -> str:
    return f"{way.real:.1f}, {way.imag:.1f}"


if __name__ == "__main__":
    main()
