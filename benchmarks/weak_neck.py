"""A68a told by what is measured: 170 m of ice, drag of the textbook, a rift at the neck of the finger, on twenty lattices.

The ocean of the built-in story was fitted with 17.8 times the drag of the water; here its shoal and its eddy are moved once
more. The fit goes by `FITTED` lattices; the others only report.

python benchmarks/weak_neck.py                                           the five lattices of the fit
python benchmarks/weak_neck.py --all                                     all twenty, and elements of 2 and 1.5 km
python benchmarks/weak_neck.py --shoal -10 -3 --rise 25 --open 0.67      another fit

What was tried is in docs/evidence/a68a.md.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any, NamedTuple

import numpy as np
from lattices import LATTICES

from riftberg import Model, Parameters
from riftberg.bergs.bonding import Metric, turn_rigidly
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, SECONDS_PER_DAY
from riftberg.diagnostics.summary import breakups
from riftberg.errors import RunError
from riftberg.experiments.a68a import DAYS, TURN, a68a_berg
from riftberg.ocean.story import OWN, StoryOcean
from riftberg.physics.crevasses import prestress, reserve

FITTED = (0, 3, 7, 12, 16)
"""Lattices by which the ocean is fitted, of `LATTICES`."""

THICKNESS = 170.0
"""Of A68a by altimetry, m (Braakmann-Folgmann et al. 2022)."""

NECK = [(-38.665, -55.15), (-38.665, -54.88)]
"""Line across the neck of the finger on 9 December, degrees."""

SOUTH, NORTH = -55.102, -54.927
"""Edges of the ice there, degrees."""


class Fit(NamedTuple):
    """What is fitted, and what is given."""

    shoal: tuple[float, float] = (
        0.0,
        0.0,
    )  # How far the shoal is moved from that of the built-in ocean, km east and north
    rise: float = 0.0  # By how much its summit and floor are higher, m
    eddy: float = 1.0  # Factor on the spin of the eddy
    tip: float = 90.0  # Strength at the tips of crevasses, kPa
    open: float = 0.5  # Part of the neck that an open rift cuts, from the south; 0: a weakened line across it instead
    neck: float = 7.5  # Strength of that line, kPa
    toughness: float = 0.3  # Of the ice where the rift is open, MPa m1/2


FIT = Fit()


class Told(NamedTuple):
    """What a run tells, and whether it is what happened."""

    pieces: str
    tip: bool  # 80 to 300 km2, aground, 16 to 18 December
    finger: bool  # 450 to 900 km2, afloat, 19 to 22 December
    alone: bool  # No other piece of 100 km2 or more


def ice(fit: Fit) -> Parameters:
    """Return the parameters: the drag of the textbook, and the strengths."""
    fracture: dict[str, Any] = {"crevasse_strength": 1e3 * fit.tip, "shear_strength": 100e3}
    if fit.open > 0.0:
        fracture |= {"criterion": "toughness", "toughness": 1e6 * fit.toughness}
    return Parameters(
        sea_ice={"capture": "none"}, bonds={"constant_size": True}, fracture=fracture, stepping={"time_step": 1800.0}
    )


def model_of(fit: Fit, packing: Any, radius: float, **lattice: Any) -> Model:
    """Return the model on one lattice."""
    p = ice(fit)
    berg = a68a_berg(radius, packing, thickness=THICKNESS, density=p.ice.density, **lattice)
    if fit.open == 0.0:
        whole = reserve(1e3 * fit.tip, prestress(THICKNESS, p.ice.density))
        berg = berg.with_rifts(np.array(NECK), strength=min(1.0, 1e3 * fit.neck / whole))
    else:
        line = [(NECK[0][0], SOUTH - 0.02), (NECK[0][0], SOUTH + fit.open * (NORTH - SOUTH))]
        berg = berg.with_rifts(np.array(line), broken=True)
    turn_rigidly(berg.elements, math.radians(TURN) / SECONDS_PER_DAY, Metric(True, berg.earth_radius))
    lon, lat, length, height, floor = OWN.shoal
    degree = 1e-3 * DEGREE * EARTH_RADIUS_A68
    lon, lat = lon + fit.shoal[0] / (degree * math.cos(lat * DEGREE)), lat + fit.shoal[1] / degree
    ocean = OWN._replace(eddy_spin=fit.eddy * OWN.eddy_spin, shoal=(lon, lat, length, height, floor - fit.rise))
    return Model(berg, StoryOcean(ocean), p)


def told(model: Model) -> Told:
    """Run a model, and say what breaks off."""
    try:
        model.advance(DAYS)
    except RunError as error:
        print(error, file=sys.stderr)
    events = [(int(e["time"][8:10]), e["area_km2"], bool(e["grounded"]), e["time"][11:16]) for e in breakups(model)]
    tips = [e for e in events if 16 <= e[0] <= 18 and 80.0 <= e[1] <= 300.0 and e[2]]
    fingers = [e for e in events if 19 <= e[0] <= 22 and 450.0 <= e[1] <= 900.0 and not e[2]]
    others = [e for e in events if e[1] >= 100.0 and e not in (*tips[:1], *fingers[:1])]
    pieces = ", ".join(
        f"{area:.0f} km² {day}. {hour} {'aground' if held else 'afloat'}"
        for day, area, held, hour in events
        if area >= 50.0
    )
    return Told(pieces or "nothing", bool(tips), bool(fingers), not others)


def main() -> None:
    """Run the lattices and print what they tell."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--shoal", type=float, nargs=2, default=FIT.shoal, help="km east and north")
    for name in ("rise", "eddy", "tip", "open", "neck", "toughness"):
        parser.add_argument(f"--{name}", type=float, default=getattr(FIT, name))
    parser.add_argument("--all", action="store_true", help="all twenty lattices, and elements of 2 and 1.5 km")
    asked = parser.parse_args()
    fit = Fit(tuple(asked.shoal), asked.rise, asked.eddy, asked.tip, asked.open, asked.neck, asked.toughness)
    print(fit, flush=True)
    count = np.zeros(3, int)
    for k, (packing, angle, shift) in enumerate(LATTICES):
        if not asked.all and k not in FITTED:
            continue
        lattice: dict[str, Any] = {"lattice_angle": angle} | ({} if shift is None else {"offset": shift})
        result = told(model_of(fit, packing, 1500.0, **lattice))
        count += result[1:]
        print("fit" if k in FITTED else "report", packing, f"{angle:g}°", *result, sep=" | ", flush=True)
    print("tip, finger, nothing else:", *count.tolist(), flush=True)
    for radius in (1000.0, 750.0) if asked.all else ():
        print(f"squares of {2e-3 * radius:g} km", *told(model_of(fit, "square", radius)), sep=" | ", flush=True)


if __name__ == "__main__":
    main()
