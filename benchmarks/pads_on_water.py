"""What the law of the ground gives where an independent plate on water is known (`plate_on_water.py`).

python benchmarks/pads_on_water.py             print the table
python benchmarks/pads_on_water.py --write     also put it into docs/evidence/plate-on-water.md
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from typing import Any

from plate_on_water import BEDS, PAGE, WIDTHS
from story import print_tables, table

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.physics.seabed import POISSON, bending_length

THICKNESS, DENSITY = 250.0, 850.0
DRAFT = DENSITY / 1025.0
"""Over the thickness."""

MODULI = 9e9, 1e9
PLACES = (0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)
"""Of the top of a knoll, in parts of a pad."""


def model(
    length: float, width: float, cell: float, floor: Any, bed: str, modulus: float, *, thickness: float = THICKNESS,
    velocity: tuple[float, float] = (0.0, 0.0), step: float = 600.0,
) -> Model:  # fmt: skip
    """Return a berg about the origin, in still water over a floor."""
    berg = Iceberg.rectangle(
        length, width, thickness=thickness, radius=0.5 * cell, placement=(0.0, 0.0), density=DENSITY, latlon=False,
        velocity=velocity,
    )  # fmt: skip
    parameters = Parameters(
        ice={"density": DENSITY}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0},
        grounding={"law": "seabed", "sediment": bed, "ice_modulus": modulus}, fracture={"enabled": False},
        stepping={"time_step": step},
    )  # fmt: skip
    return Model(berg, Forcing.uniform((0.0, 0.0), latlon=False, latitude=0.0) + floor, parameters)


def rising(reach: float, towards: float = 0.0) -> Any:
    """Return a floor that rises by 1e-3 towards a direction (degrees from the long axis), to the keel at ``reach`` m."""
    a = math.radians(towards)
    at = reach * math.cos(a), reach * math.sin(a)
    return Forcing.slope(at, 90.0 - towards, -1e-3, DRAFT * THICKNESS, (1.0, 5000.0), latlon=False)


def landing(bed: str, modulus: float, towards: float, speed: float) -> tuple[float, float]:
    """Way (m) of a berg of 18 x 9 km up a slope from the touch to the rest, and its load then (N)."""
    a, ahead = math.radians(towards), 20.0
    floor = rising(9e3 * math.cos(a) + 4.5e3 * math.sin(a) + ahead, towards)
    velocity = speed * math.cos(a), speed * math.sin(a)
    run, previous = model(18e3, 9e3, 3e3, floor, bed, modulus, velocity=velocity), -math.inf
    while True:
        run.step()
        el = run.elements
        way = float(el.lon.mean() * math.cos(a) + el.lat.mean() * math.sin(a)) - ahead
        if way > 0.0 and way - previous < 1.0:
            return way, float(el.floor_load.sum())
        previous = way


def load(run: Model) -> float:
    """Load (N) of a berg where it is placed."""
    run.step()
    return float(run.elements.floor_load.sum())


def ramp(modulus: float, width: float) -> float:
    """Load (N) of a berg with its end on a ramp of rock, ``width`` lambda wide."""
    reach = math.sqrt(2.0) * bending_length(modulus, POISSON, THICKNESS)
    length = 2e3 * math.ceil(max(20e3, (width + 8.0) * reach) / 2e3)
    return load(model(length, 10e3, 2e3, rising(0.5 * length - width * reach), "rock", modulus, step=1e-3))


def knoll(bed: str, height: float) -> list[float]:
    """Loads (N) of ice of 280 m on a knoll, for places of its top against the pads."""
    pad, loads = 0.25 * math.sqrt(2.0) * bending_length(9e9, POISSON, 280.0), []
    for x, y in PLACES:
        top = Forcing.seamount((9e3 + x * pad, 6e3 + y * pad), 120.0, 4e3, 280.0 * DRAFT + 120.0 - height, latlon=False)
        loads.append(load(model(72e3, 54e3, 6e3, top, bed, 9e9, thickness=280.0, step=1e-3)))
    return loads


def plate() -> dict[str, tuple[float, float]]:
    """Return way in still water (m) and load (N) of the plate, by the words of a case."""
    block = (
        PAGE.read_text("utf-8").partition("<!-- plate on a bed: begin -->")[2].partition("<!-- plate on a bed: end")[0]
    )
    found = {}
    for line in block.splitlines():
        cells = [cell.strip() for cell in line[1:-1].split("|")]
        if line.startswith("|") and cells[3].endswith(" N"):
            found[cells[0]] = float(cells[2].removesuffix(" m") or "nan"), float(cells[3].removesuffix(" N"))
    return found


def rows() -> Iterator[tuple[str, ...]]:
    """Work all cases; way and load, more or less than the plate."""
    known = plate()

    def row(case: str, *loads: float, way: float | None = None) -> tuple[str, ...]:
        asked_way, asked = known[case]
        parts = sorted(100.0 * (each / asked - 1.0) for each in loads)
        text = " to ".join(dict.fromkeys(f"{part:+.1f}" for part in (parts[0], parts[-1]))) + " %"
        if way is None:
            return case, "", f"{loads[0]:.3e} N", text
        return case, f"{way:.0f} m, {100.0 * (way / asked_way - 1.0):+.1f} %", f"{loads[0]:.3e} N", text

    for modulus in MODULI:
        for bed in BEDS:
            way, end = landing(bed, modulus, 0.0, 0.3)
            yield row(f"front, {modulus / 1e9:g} GPa, {bed}", end, way=way)
    for modulus in MODULI:
        way, end = landing("rock", modulus, 30.0, 0.2)
        yield row(f"corner, {modulus / 1e9:g} GPa, rock", end, way=way)
    for modulus in MODULI:
        for width in WIDTHS:
            yield row(f"ramp {width:g} λ wide, {modulus / 1e9:g} GPa, rock", ramp(modulus, width))
    for height in (0.9, 5.0):
        for bed in BEDS:
            yield row(f"knoll {height:g} m above the keel, {bed}", *knoll(bed, height))
    for modulus in MODULI:
        for bed in BEDS:
            run = model(40e3, 30e3, 2e3, rising(10e3), bed, modulus, step=1e-3)
            yield row(f"bank, {modulus / 1e9:g} GPa, {bed}", load(run))
    for bed in BEDS:
        floor = Forcing.uniform((0.0, 0.0), depth=DRAFT * THICKNESS - 1.0, latlon=False, latitude=0.0)
        yield row(f"flat floor, {bed}", load(model(40e3, 30e3, 2e3, floor, bed, 9e9, step=1e-3)))


def main() -> None:
    """Work all cases, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    write, found = parser.parse_args().write, []
    for each in rows():
        found.append(each)
        print(" | ".join(each), file=sys.stderr, flush=True)
    tables = {"pads against the plate": table(("case", "way", "load", "load over that of the plate"), found)}
    print_tables(PAGE, tables, write=write)


if __name__ == "__main__":
    main()
