"""A68a told by what is measured: 170 m of ice, drag of the textbook, a rift at the neck of the finger, on twenty lattices.

The ocean of the built-in story was fitted with 17.8 times the drag of the water; here its shoal, eddy, surge and shear are
fitted once more, with the strength of the neck. The fit goes by `FITTED` lattices; the others only report, and `UNSEEN` ones too,
on which no fit was ever tried.

python benchmarks/weak_neck.py                                the five lattices of the fit
python benchmarks/weak_neck.py --all --write                  all twenty, and elements of 2 and 1.5 km, into the page
python benchmarks/weak_neck.py --search fits.jsonl --hours 1  look for a better fit around the best of a file, and add to it
python benchmarks/weak_neck.py --tip 83 --neck 5              another fit

What came out is in docs/evidence/a68a.md.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from lattices import LATTICES, PAGE
from story import print_tables, table

from riftberg import Model, Parameters
from riftberg.bergs.bonding import Metric, turn_rigidly
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, SECONDS_PER_DAY
from riftberg.diagnostics.summary import breakups
from riftberg.errors import RunError
from riftberg.experiments.a68a import DAYS, TURN, a68a_berg
from riftberg.ocean.story import OWN, StoryOcean
from riftberg.physics.crevasses import prestress, reserve

FITTED = (3, 12, 7, 16, 0)
"""Lattices by which the ocean is fitted, of `LATTICES`; in the search the hardest come first."""

TURNS = [pair for n in range(10) for pair in (("square", 4.5 + 9.0 * n), ("hexagonal", 3.0 + 6.0 * n))]
UNSEEN = [
    (packing, angle, ((k * 0.7549 + east) % 1.0, (k * 0.5698 + 0.77) % 1.0))
    for east in (0.0, 0.31)
    for k, (packing, angle) in enumerate(TURNS)
]
"""Forty other lattices, turned half-way between those: packing, angle (degrees), and shift in parts of the spacing."""

THICKNESS = 170.0
"""Of A68a by altimetry, m (Braakmann-Folgmann et al. 2022)."""

NECK = [(-38.665, -55.15), (-38.665, -54.88)]
"""Line across the neck of the finger on 9 December, degrees."""

SOUTH, NORTH = -55.102, -54.927
"""Edges of the ice there, degrees."""

NO_FINGER = 3.0
"""Penalty of a run without a finger."""

MARGIN = 0.3
"""Logarithm of the ratio between the strengths of the line within which the finger comes off, beyond which more is no better."""

PIECES = 6
"""Pieces of 50 km2 and more with which a berg has broken up, and a run ends."""


class Fit(NamedTuple):
    """What is fitted, and what is given."""

    east: float = -1.536  # How far the shoal is moved from that of the built-in ocean, km
    north: float = -1.286  # The same, northward
    length: float = 1.168  # Factor on the length of the shoal
    rise: float = 21.9  # By how much its summit and floor are higher, m
    eddy: float = 1.069  # Factor on the spin of the eddy
    surge: float = 0.197  # Factor on the surge that brings the tip to the shoal
    shear: float = 1.45  # Factor on jet, counter-current and their uniform flow
    neck: float = 5.35  # Strength of the weakened line, kPa
    tip: float = 90.0  # Strength at the tips of crevasses, kPa
    open: float = 0.0  # Part of the neck that an open rift cuts, from the south; 0: a weakened line across it instead
    toughness: float = 0.3  # Of the ice where the rift is open, MPa m1/2


FREE = {
    "east": 0.5, "north": 0.5, "length": 0.05, "rise": 2.5, "eddy": 0.025, "surge": 0.12, "shear": 0.05, "tip": 2.0,
}  # fmt: skip
"""Numbers that are fitted, and by how much a step of the search changes each (standard deviation)."""

FASTEST_SHEAR = 1.5
"""Largest factor on the shear that the search may take."""

FIT = Fit()


class Piece(NamedTuple):
    """A piece that broke off."""

    day: float  # Of December
    area: float  # km2
    aground: bool


def is_tip(piece: Piece) -> bool:
    """Say whether a piece is the tip as it was observed."""
    return 16.0 <= piece.day < 19.0 and 80.0 <= piece.area <= 300.0 and piece.aground


def is_finger(piece: Piece) -> bool:
    """Say whether a piece is the finger as it was observed."""
    return 19.0 <= piece.day < 23.0 and 450.0 <= piece.area <= 900.0 and not piece.aground


class Told(NamedTuple):
    """What a run tells, and whether it is what happened."""

    pieces: str
    tip: bool
    finger: bool
    alone: bool  # No other piece of 100 km2 or more


def ice(fit: Fit) -> Parameters:
    """Return the parameters: the drag of the textbook, and the strengths."""
    fracture: dict[str, Any] = {"crevasse_strength": 1e3 * fit.tip, "shear_strength": 100e3}
    if fit.open > 0.0:
        fracture |= {"criterion": "toughness", "toughness": 1e6 * fit.toughness}
    return Parameters(
        sea_ice={"capture": "none"}, bonds={"constant_size": True}, fracture=fracture, stepping={"time_step": 1800.0}
    )


def ocean_of(fit: Fit) -> StoryOcean:
    """Return the built-in ocean with the numbers of a fit."""
    lon, lat, length, height, floor = OWN.shoal
    degree = 1e-3 * DEGREE * EARTH_RADIUS_A68
    lon, lat = lon + fit.east / (degree * math.cos(lat * DEGREE)), lat + fit.north / degree
    return StoryOcean(
        OWN._replace(
            eddy_spin=fit.eddy * OWN.eddy_spin,
            surge=fit.surge * OWN.surge,
            jet_speed=fit.shear * OWN.jet_speed,
            counter_speed=fit.shear * OWN.counter_speed,
            shear_flow=fit.shear * OWN.shear_flow,
            shoal=(lon, lat, fit.length * length, height, floor - fit.rise),
        )
    )


def model_of(fit: Fit, packing: Any, radius: float, angle: float, shift: tuple[float, float] | None) -> Model:
    """Return the model on one lattice."""
    p = ice(fit)
    berg = a68a_berg(radius, packing, lattice_angle=angle, offset=shift, thickness=THICKNESS, density=p.ice.density)
    if fit.open == 0.0:
        whole = reserve(1e3 * fit.tip, prestress(THICKNESS, p.ice.density))
        berg = berg.with_rifts(np.array(NECK), strength=min(1.0, 1e3 * fit.neck / whole))
    else:
        line = [(NECK[0][0], SOUTH - 0.02), (NECK[0][0], SOUTH + fit.open * (NORTH - SOUTH))]
        berg = berg.with_rifts(np.array(line), broken=True)
    turn_rigidly(berg.elements, math.radians(TURN) / SECONDS_PER_DAY, Metric(True, berg.earth_radius))
    return Model(berg, ocean_of(fit), p)


def broken_off(model: Model, load: NeckLoad | None = None) -> list[Piece]:
    """Run a model to 26 December, and return the pieces of 50 km2 and more, by date.

    ``load``: records the line; the run ends with the days of the finger, or with those of the tip if it has not come off.
    """
    pieces: list[Piece] = []
    for eighth in range(1, 1 + int(8 * DAYS)):
        day = 0.125 * eighth
        try:
            model.advance(0.125, recorders=[load] if load else [])
        except RunError as error:
            print(error, file=sys.stderr)
            day = DAYS
        events = [(e["time"], e["area_km2"], bool(e["grounded"])) for e in breakups(model) if e["area_km2"] >= 50.0]
        pieces = [
            Piece(int(t[8:10]) + int(t[11:13]) / 24 + int(t[14:16]) / 1440, area, held) for t, area, held in events
        ]
        decided = load and (day >= 13 or (day >= 10 and not any(p.area <= 400.0 for p in pieces)))
        if day == DAYS or len(pieces) >= PIECES or decided:
            break
    return pieces


def told(pieces: list[Piece]) -> Told:
    """Say what pieces tell."""
    tips, fingers = [p for p in pieces if is_tip(p)], [p for p in pieces if is_finger(p)]
    others = [p for p in pieces if p.area >= 100.0 and p not in (*tips[:1], *fingers[:1])]
    words = [
        f"{p.area:.0f} km² {int(p.day)}. {int(p.day % 1 * 24 + 1e-6):02d} h {'aground' if p.aground else 'afloat'}"
        for p in pieces
    ]
    return Told(", ".join(words) or "nothing", bool(tips), bool(fingers), not others)


# ---- the search -----------------------------------------------------------------------------------------------------


def excess(value: float, low: float, high: float) -> float:
    """Return how far a value lies outside of a range; with the half that a miss costs in any case."""
    out = max(low - value, value - high, 0.0)
    return out + 0.5 * (out > 0.0)


def penalty(pieces: list[Piece]) -> float:
    """Return how far pieces are from what happened: 0 for all as asked and in the middle of the ranges.

    Areas count by their logarithm, dates in days. Without a tip it is 6, without a finger 3; other pieces cost 1 and more.
    """
    tips = {
        p: excess(math.log(p.area), math.log(80.0), math.log(300.0)) * 3.0 + 0.3 * math.log(p.area / 170.0) ** 2
        + excess(p.day, 16.0, 19.0) + (not p.aground)
        for p in pieces if p.day < 19.5
    }  # fmt: skip
    tip = min(tips, key=lambda p: tips[p]) if tips else None
    fingers = {
        p: excess(math.log(p.area), math.log(450.0), math.log(900.0)) * 3.0 + excess(p.day, 19.0, 23.0) + p.aground
        for p in pieces if p is not tip and p.day >= 17.5 and 225.0 <= p.area <= 1800.0
    }  # fmt: skip
    finger = min(fingers, key=lambda p: fingers[p]) if fingers else None
    others = [
        1.0 + 0.3 * math.log(p.area / 100.0) if p.area >= 100.0 else 0.1 for p in pieces if p not in (tip, finger)
    ]
    missed = min(tips[tip], 6.0) if tip else 6.0
    return missed + (min(fingers[finger], NO_FINGER) if finger else NO_FINGER) + min(sum(others), 4.0)


class NeckLoad:
    """Recorder of the largest tension (kPa) of the weakened line before 19 December, and on the days of the finger."""

    def __init__(self) -> None:
        self.early = self.late = 0.0

    def start(self, model: Model) -> None:
        """Note the line."""
        self._line = model.bonds.strength < 1.0

    def record(self, model: Model) -> None:
        """Take the tension of a step."""
        tension, day = 1e-3 * float(model.bonds.peak_stress[self._line].max()), model.date.day
        self.early, self.late = max(self.early, tension * (day < 19)), max(self.late, tension * (day >= 19))

    def finish(self, model: Model) -> None:
        """Leave the tensions."""


class Attempt(NamedTuple):
    """How well a fit does on its lattices, with the strength of the line that does best."""

    penalty: float
    marks: int  # Of 15
    fit: Fit


def attempt(fit: Fit, limit: float) -> Attempt:
    """Try a fit on its lattices; stop where its penalty is beyond a limit.

    The line does not break here. Its tension until the 18th and from the 19th on says between which strengths the finger
    comes off on its days, and the line gets the middle of them.
    """
    total, marks, loads = 0.0, 0, []
    whole = fit._replace(neck=0.99e-3 * reserve(1e3 * fit.tip, prestress(THICKNESS, 850.0)))
    for k in FITTED:
        load = NeckLoad()
        pieces = broken_off(model_of(whole, LATTICES[k][0], 1500.0, *LATTICES[k][1:]), load)
        loads.append((max(load.early, 0.1), max(load.late, 0.1)))
        early, late = (edge(load[n] for load in loads) for n, edge in ((0, max), (1, min)))
        total += penalty(pieces) - (NO_FINGER if not any(p.area > 450.0 for p in pieces) else 0.0)
        marks += told(pieces).tip + told(pieces).alone
        words = f"{k}: {total:.2f}, line {load.early:.1f} and {load.late:.1f} kPa, {told(pieces).pieces}"
        print(" ", words, file=sys.stderr, flush=True)
        if total + 2.0 * max(0.0, MARGIN - math.log(late / early)) > limit:
            return Attempt(math.inf, marks, fit)
    neck = round(math.sqrt(early * late), 2)
    marks += sum(low < neck < high for low, high in loads)
    return Attempt(round(total + 2.0 * max(0.0, MARGIN - math.log(late / early)), 3), marks, fit._replace(neck=neck))


def read_fits(path: Path) -> list[Attempt]:
    """Return the fits of a file of the search, the best first."""
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.exists() else []
    return sorted(Attempt(row["penalty"], row["marks"], Fit(**row["fit"])) for row in rows)


def search(first: Fit, path: Path, seed: int, hours: float) -> None:
    """Try fits around the best ones of a file, and add to it those that were run on all lattices of the fit."""
    rng, end = random.Random(seed), time.monotonic() + 3600.0 * hours
    fits, fit = read_fits(path), first
    while time.monotonic() < end:
        if fits:
            base = fits[min(int(rng.expovariate(1.5)), len(fits) - 1)].fit
            step = {name: size * rng.gauss(0.0, 1.0) * (rng.random() < 0.6) for name, size in FREE.items()}
            fit = base._replace(**{name: round(getattr(base, name) + change, 3) for name, change in step.items()})
            fit = fit._replace(shear=min(fit.shear, FASTEST_SHEAR), surge=max(fit.surge, 0.0))
        tried = attempt(fit, fits[0].penalty + 0.2 if fits else math.inf)
        print(*tried, flush=True)
        if math.isfinite(tried.penalty):
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**tried._asdict(), "fit": tried.fit._asdict()}) + "\n")
            fits = sorted([*fits, tried])


# ---- tables -----------------------------------------------------------------------------------------------------------


def marks(result: Told) -> list[str]:
    """Return the marks of a run in words."""
    return ["yes" if mark else "no" for mark in result[1:]]


def lattices_table(fit: Fit, *, everything: bool) -> str:
    """Run the lattices, and return a row for each; ``everything``: all twenty, and squares of 2 and 1.5 km."""
    rows, count = [], {use: np.zeros(4, int) for use in ("fitted", "", "unseen")}
    for k, (packing, angle, shift) in enumerate((*LATTICES, *UNSEEN)):
        use = "fitted" if k in FITTED else "unseen" if k >= len(LATTICES) else ""
        if everything or use == "fitted":
            result = told(broken_off(model_of(fit, packing, 1500.0, angle, shift)))
            count[use] += (*result[1:], 1)
            name = f"{'squares' if packing == 'square' else 'hexagons'}, {angle:g}°"
            rows.append((name, use, result.pieces, *marks(result)))
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    for radius in (1000.0, 750.0) if everything else ():
        result = told(broken_off(model_of(fit, "square", radius, 0.0, None)))
        rows.append((f"squares of {2e-3 * radius:g} km, 0°", "", result.pieces, *marks(result)))
        print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    totals = {
        "all that were seen": count["fitted"] + count[""], "without those of the fit": count[""], "unseen": count["unseen"],
    }  # fmt: skip
    for name, (*reached, number) in totals.items():
        if number:
            rows.append((f"**{name}**", "", f"of {number} lattices of 3 km", *map(str, reached)))
    return table(("lattice", "", "breaks off", "tip", "finger", "nothing else"), rows)


def main() -> None:
    """Run the lattices, print what they tell, and write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    for name, value in FIT._asdict().items():
        parser.add_argument(f"--{name}", type=float, default=value)
    parser.add_argument("--all", action="store_true", help="all twenty lattices, and elements of 2 and 1.5 km")
    parser.add_argument("--search", type=Path, metavar="FILE", help="look for a better fit, and add it to a file")
    parser.add_argument("--hours", type=float, default=1.0, help="how long to search")
    parser.add_argument("--seed", type=int, default=1, help="of the search")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    asked = parser.parse_args()
    fit = Fit(**{name: getattr(asked, name) for name in Fit._fields})
    if asked.search:
        search(fit, asked.search, asked.seed, asked.hours)
    else:
        print_tables(PAGE, {"weak neck": lattices_table(fit, everything=asked.all)}, write=asked.write and asked.all)


if __name__ == "__main__":
    main()
