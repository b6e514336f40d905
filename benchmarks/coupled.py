"""What bergs cost beside an ocean, coupled by YAC: processor seconds per hour of the model, as a share of the ocean's own.

    python benchmarks/coupled.py                A68a and 1000 lone bergs, on cells of 1 and 1/4 degree
    python benchmarks/coupled.py --radius 3000 --long-step 3600     larger elements and longer steps

Needs the extras ``yac`` and ``tests``. Rank 0 holds the bergs, rank 1 an ocean that computes nothing on the cells of a global
one. A rank that waits for the other uses its processor all the time, so each grid runs twice: with an ocean that is always
ahead, which tells what bergs and their side of the exchange cost; and with one that sleeps until the bergs are ahead, which
tells what the exchange costs the ocean.

What real oceans cost is published for ACCESS-OM2 (MOM5 and CICE5, Kiss et al. 2020, doi:10.5194/gmd-13-401-2020) on Gadi: at
1 degree 824 s on 241 cores for a year (github.com/COSIMA/access-om2/issues/202), at 1/4 degree 3600 core hours on 1817 for a year
with output (github.com/COSIMA/access-om3/issues/148). Both are without biogeochemistry, other processors than these.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from riftberg import Iceberg, Model, Parameters
from riftberg.coupling.fields import GIVEN, TAKEN, OceanForcing
from riftberg.coupling.sections import Box

HOURS_PER_YEAR = 8760.0
CORES = {1.0: 241, 0.25: 1817}
CORE_SECONDS = {1.0: 241 * 824.0 / HOURS_PER_YEAR, 0.25: 3600 * 3600.0 / HOURS_PER_YEAR}
"""Of the ocean in an hour of the model, by the width of its cells, degrees."""

BOX = {"west": -70, "east": 20, "south": -65, "north": -45}
LONE = 1000
LEFT_OUT = ("stress", "sea_floor")
"""Parts of names of fields that the ocean does not hand over: the wind itself comes, and the floor is deep."""

STATE = {
    "eastward_sea_water_velocity": 0.2, "northward_sea_water_velocity": 0.05, "sea_surface_temperature": 0.5,
    "sea_surface_salinity": 34.0, "eastward_wind": 8.0, "northward_wind": 2.0,
}  # fmt: skip
NAMES = [name for name in TAKEN if not any(text in name for text in LEFT_OUT)]


def coupling_file(folder: Path, cell: float, hours: int) -> Path:
    """Write the coupling file: every field, once in an hour, without a lag."""

    def coupled(source: str, target: str, name: str, stack: list[dict]) -> dict:
        return {
            "src_component": source, "src_grid": f"{source}_grid", "tgt_component": target, "tgt_grid": f"{target}_grid",
            "field": name, "coupling_period": 3600, "time_reduction": "none", "interpolation": stack,
        }  # fmt: skip

    inward = [{"conservative": {"order": 1, "normalisation": "fracarea", "partial_coverage": True}}]
    outward = [{"source_to_target_map": {"scale": "fracarea"}}, {"fixed": {"user_value": 0.0}}]
    columns, rows = round((BOX["east"] - BOX["west"]) / cell), round((BOX["north"] - BOX["south"]) / cell)
    end = np.datetime64("2020-12-09T00:00:00") + np.timedelta64(hours, "h")
    said = {
        "calendar": "proleptic-gregorian", "start_date": "2020-12-09T00:00:00", "end_date": str(end), "timestep_unit": "second",
        "riftberg": {"grid": {**BOX, "columns": columns, "rows": rows}, "step": 3600},
        "coupling": [coupled("ocean", "riftberg", name, inward) for name in NAMES]
        + [coupled("riftberg", "ocean", name, outward) for name in GIVEN],
    }  # fmt: skip
    path = folder / "coupling.yaml"
    path.write_text(yaml.safe_dump(said, sort_keys=False))
    return path


def bergs(lone: int, radius: float) -> Iceberg:
    """Return a berg as large as A68a in December 2020, and lone bergs of 200 m to 2 km here and there around it."""
    random = np.random.default_rng(1)
    giant = Iceberg.rectangle("110 km", "38 km", thickness="230 m", radius=radius, placement=(-38.0, -56.0))
    lon, lat = random.uniform(BOX["west"] + 1, BOX["east"] - 1, lone), random.uniform(-64.0, -46.0, lone)
    free = (abs(lon + 38.0) > 2.0) | (abs(lat + 56.0) > 1.0)
    length = 10.0 ** random.uniform(2.3, 3.3, lone)
    small = Iceberg.from_points(lon[free], lat[free], thickness=200.0, length=length[free], width=length[free] / 1.5)
    return Iceberg.join([giant, small], names=["A68a", "lone"])


def run_bergs(said: dict) -> dict:
    """Run the bergs; return processor seconds in each step, in all and without the coupler."""
    from riftberg.coupling.yac import YacComponent, ending_all_ranks, read_coupling

    with ending_all_ranks():
        coupling = read_coupling(said["coupling"])
        box = coupling.settings.grid
        assert box is not None
        grid = Box.model_validate(box.model_dump()).cells()
        parameters = Parameters(melt={"enabled": True}, stepping={"time_step": said["long_step"]})
        model = Model(
            bergs(said["lone"], said["radius"]), OceanForcing(grid, grid.fields(depth=4000.0)), parameters, "2020-12-09"
        )
        component = YacComponent(model, coupling)
        without, alone = [], component.exchange.step

        def timed(given):
            begin = time.process_time()
            fluxes = alone(given)
            without.append(time.process_time() - begin)
            return fluxes

        component.exchange.step = timed
        steps = []
        for _ in range(said["hours"]):
            begin = time.process_time()
            component.step()
            steps.append(time.process_time() - begin)
        component.close()
    return {"steps": steps, "bergs": without, "elements": int(model.elements.size)}


def run_ocean(said: dict) -> dict:
    """Hand fields over and get others in each hour; return processor seconds of that."""
    import yac

    coupler = yac.YAC()
    coupler.read_config_yaml(said["coupling"])
    component = coupler.def_comp("ocean")
    cell = said["cell"]
    x, y = np.radians(np.arange(-180.0, 180.0, cell)), np.radians(np.arange(-80.0, 90.0 + cell / 2, cell))
    grid = yac.Reg2dGrid("ocean_grid", x, y, [True, False])
    points = grid.def_points(yac.Location.CELL, x + np.radians(cell) / 2, 0.5 * (y[1:] + y[:-1]))
    fields = {
        name: yac.Field.create(name, component, points, 1, "3600", yac.TimeUnit.SECOND) for name in (*NAMES, *GIVEN)
    }
    coupler.enddef()
    size = x.size * (y.size - 1)
    values = {name: np.full((1, size), STATE.get(name, 0.0)) for name in NAMES}
    steps = []
    for _ in range(said["hours"]):
        begin = time.process_time()
        for name in NAMES:
            fields[name].put(values[name])
        time.sleep(said["pause"])
        for name in GIVEN:
            fields[name].get()
        steps.append(time.process_time() - begin)
    return {"steps": steps, "cells": size}


def measured(cell: float, asked: argparse.Namespace, pause: float) -> tuple[dict, dict]:
    """Run both side by side; return what each measured."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(coupling_file(Path(folder), cell, asked.hours))
        said = {**vars(asked), "rank": None, "coupling": path, "cell": cell, "pause": pause}
        (Path(folder) / "said.json").write_text(json.dumps(said))
        words = [str(Path(sys.executable).with_name("mpirun")), "--oversubscribe", "--bind-to", "none", "-n", "2"]
        allowed = {
            "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "OMPI_MCA_mpi_yield_when_idle": "1",
        }
        environment = {**os.environ, **allowed, "NUMBA_NUM_THREADS": "1"}
        subprocess.run([*words, sys.executable, __file__, "--rank", folder], check=True, env=environment)
        told = [json.loads((Path(folder) / f"{rank}.json").read_text()) for rank in (0, 1)]
    return told[0], told[1]


def rank_in(folder: Path) -> None:
    """Be one of the ranks."""
    from mpi4py import MPI

    said = json.loads((folder / "said.json").read_text())
    number = MPI.COMM_WORLD.rank
    told = run_ocean(said) if number else run_bergs(said)
    (folder / f"{number}.json").write_text(json.dumps(told))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=int, default=48)
    parser.add_argument("--lone", type=int, default=LONE)
    parser.add_argument("--radius", type=float, default=1500.0, help="of the elements of A68a, m")
    parser.add_argument("--long-step", type=float, default=1800.0, help="of the bergs, s")
    parser.add_argument("--rank", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.rank is not None:
        rank_in(asked.rank)
        return
    print(
        "| ocean | elements | bergs, s/h | their exchange, s/h | its exchange, s/h | ocean, core s/h | share | ocean, wall s/h |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for cell, ocean in CORE_SECONDS.items():
        ahead, _ = measured(cell, asked, 0.0)
        _, behind = measured(cell, asked, 2.0 * float(np.median(ahead["steps"])))
        # Medians: the first step loads or compiles what it calls, and other work may share the cores.
        bergs_alone, steps, exchange = (float(np.median(q)) for q in (ahead["bergs"], ahead["steps"], behind["steps"]))
        print(
            f"| {cell:g}° | {ahead['elements']} | {bergs_alone:.3f} | {steps - bergs_alone:.3f} | {exchange:.3f} "
            f"| {ocean:.0f} | {(steps + exchange) / ocean:.2%} | {ocean / CORES[cell]:.2f} |"
        )


if __name__ == "__main__":
    main()
