"""A toy ocean as a component of YAC, on any number of ranks: a slab that bergs cool, freshen and push. And the bergs beside it.

Run by ``mpirun -n N python toy_ocean.py SETTINGS.json``: rank 0 has the bergs, unless ``"bergs": false`` (`riftberg couple` is
another program then). The rows of the ocean are split among the other ranks.
"""

from __future__ import annotations

import json
import os
import sys
import time
from datetime import datetime
from pathlib import Path

import numpy as np
import yac
import yaml
from mpi4py import MPI

from riftberg.constants import EARTH_RADIUS_A68
from riftberg.coupling.fields import GIVEN, TAKEN

DENSITY, HEAT_CAPACITY, LAYER = 1025.0, 3990.0, 40.0

START = {
    "eastward_sea_water_velocity": 0.2,
    "northward_sea_water_velocity": -0.05,
    "sea_surface_height_above_geoid": 0.0,
    "sea_surface_temperature": 1.5,
    "sea_surface_salinity": 34.0,
}
"""State of the ocean at the start."""

STEADY = {
    "eastward_wind": 8.0,
    "northward_wind": 2.0,
    "sea_ice_area_fraction": 0.1,
    "sea_ice_thickness": 0.5,
    "eastward_sea_ice_velocity": 0.1,
    "northward_sea_ice_velocity": 0.0,
    "land_ice_specific_mass_flux_due_to_calving": 0.0,
    "heat_flux_of_calved_ice": 0.0,
}
"""What the ocean hands on from others."""


class Ocean:
    """The slab on one of the ranks."""

    def __init__(self, said: dict) -> None:
        self.said = said
        if said.get("calendar"):
            yac.def_calendar(yac.Calendar[said["calendar"]])
        self.yac = yac.YAC()
        self.yac.read_config_yaml(said["coupling"])
        if said.get("fault") == "never defines":
            time.sleep(600)
        self.component = self.yac.def_comp("ocean")
        self.names = [name for name in (*START, *STEADY) if name not in said.get("without", ())]
        self._define_grid()
        self._define_fields()
        self.yac.enddef()
        self.step = float(said["step"])
        dates = (datetime.fromisoformat(str(d)) for d in (self.yac.start_datetime, self.yac.end_datetime))
        start, end = dates
        self.count = round((end - start).total_seconds() / self.step)
        self.totals: list[list[float]] = []
        self.calved = 0.0
        self.got: dict[str, np.ndarray] = {}

    def _define_grid(self) -> None:
        west, east, south, north = self.said["box"]
        columns, rows = self.said["columns"], self.said["rows"]
        sheared, ring = self.said.get("sheared", 0.0), east - west == 360.0
        first, last = (south, north) if self.said.get("northwards", True) else (north, south)
        lon, lat = np.meshgrid(np.linspace(west, east, columns + 1), np.linspace(first, last, rows + 1))
        lon = lon + sheared * (lat - 0.5 * (south + north))
        lat = lat + 0.3 * sheared * (lon - 0.5 * (west + east))
        corners = np.arange(lon.size).reshape(lon.shape)
        if ring:
            corners[:, -1] = corners[:, 0]
        around = [corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]]
        cells = np.stack(around, axis=-1).reshape(-1, 4)
        middle = [0.25 * (q[:-1, :-1] + q[:-1, 1:] + q[1:, 1:] + q[1:, :-1]).ravel() for q in (lon, lat)]
        self.cells = np.flatnonzero(self._owner(rows, columns) == self.component.rank)
        used, local = np.unique(cells[self.cells], return_inverse=True)
        x, y = np.radians(lon.ravel()[used]), np.radians(lat.ravel()[used])
        sides = np.full(self.cells.size, 4, np.intc)
        along_circles = sheared == 0.0  # of longitude and latitude run the sides of cells
        grid = yac.UnstructuredGrid("ocean_grid", sides, x, y, local.astype(np.intc).ravel(), along_circles)
        grid.set_global_index(self.cells, yac.Location.CELL)
        grid.set_global_index(used, yac.Location.CORNER)
        self.lon, self.lat = (q[self.cells] for q in middle)
        self.points = grid.def_points(yac.Location.CELL, np.radians(self.lon), np.radians(self.lat))
        if "land" in self.said:
            x, y, radius = self.said["land"]
            wet = np.hypot((self.lon - x) * np.cos(np.radians(y)), self.lat - y) > radius
            self.points.set_mask(wet.astype(np.intc))
        self.area = np.array(grid.compute_grid_cell_areas()) * EARTH_RADIUS_A68**2

    def _owner(self, rows: int, columns: int) -> np.ndarray:
        """Return the rank of each cell: rows side by side, or cells here and there, of each rank another number."""
        size = self.component.size
        if self.said.get("scattered"):
            parts = np.arange(1.0, size + 1.0)
            return np.random.default_rng(3).choice(size, rows * columns, p=parts / parts.sum())
        return np.repeat(np.arange(rows) * size // rows, columns)

    def _define_fields(self) -> None:
        layers = self.said.get("layers", 1)
        step = str(int(self.said["step"]))
        self.fields = {}
        for name in [*self.names, *GIVEN]:
            size = layers if "sea_water_velocity" in name else 1
            called = self.said.get("names", {}).get(name, name)
            self.fields[name] = yac.Field.create(called, self.component, self.points, size, step, yac.TimeUnit.SECOND)
            units = self.said.get("units", {}).get(name)
            if units:
                self.yac.def_field_metadata("ocean", "ocean_grid", called, yaml.safe_dump({"units": units}).encode())

    def begin(self) -> None:
        """Begin as at the start, or where a restart ended."""
        pattern = 1.0 + 0.3 * np.sin(np.radians(40.0 * self.lon)) * np.cos(np.radians(30.0 * self.lat))
        self.state = {name: START[name] * pattern for name in START}
        self.state["sea_surface_height_above_geoid"] = 0.1 * pattern
        self.state["sea_surface_salinity"] = 33.0 + pattern
        self.held = {name: np.full(self.lon.size, value) for name, value in STEADY.items()}
        near = (abs(self.lon + 39.0) < 0.3) & (abs(self.lat + 57.4) < 0.2)
        self.held["land_ice_specific_mass_flux_due_to_calving"][near] = self.said.get("calving", 0.0)
        if self.said.get("resume"):
            with np.load(self.said["resume"]) as kept:
                self.state = {name: kept[name][self.cells] for name in START}

    def run(self) -> None:
        """Take all steps: hand over, get, move on."""
        for number in range(self.count):
            fault = self.said.get("fault") if number == self.said.get("fault_at", 1) else None
            if fault == "killed":
                os.kill(os.getpid(), 9)
            if fault == "hangs":
                time.sleep(600)
            if fault == "leaves":
                return
            self._hand_over()
            self._get()
            self._move_on()

    def _hand_over(self) -> None:
        for name in self.names:
            if self.said.get("silent") == name:
                continue
            values = {**self.state, **self.held}[name]
            if self.said.get("units", {}).get(name) == "K":
                values = values + 273.15
            size = self.fields[name].collection_size
            # Currents fade with depth: half as fast from layer to layer.
            layers = np.stack([values * 0.5**k for k in range(size)])
            if self.fields[name].role == yac.ExchangeType.SOURCE:
                self.fields[name].put(np.ascontiguousarray(layers))
        calving = self.held["land_ice_specific_mass_flux_due_to_calving"]
        self.calved += float((calving * self.area).sum()) * self.step

    def _get(self) -> None:
        for name in GIVEN:
            field = self.fields[name]
            self.got[name] = np.zeros(self.lon.size)
            if field.role == yac.ExchangeType.TARGET:
                field.get(self.got[name].reshape(1, -1))
        self.totals.append([float((values * self.area).sum()) for values in self.got.values()])

    def _move_on(self) -> None:
        """Let heat, melt water and stress act on the slab, as they would on its upper metres."""
        per_layer = self.step / (DENSITY * LAYER)
        s = self.state
        heat = self.got["heat_flux_into_sea_water_due_to_iceberg_thermodynamics"]
        water = self.got["water_flux_into_sea_water_from_icebergs"]
        s["sea_surface_temperature"] = s["sea_surface_temperature"] + heat * per_layer / HEAT_CAPACITY
        s["sea_surface_salinity"] = s["sea_surface_salinity"] * (1.0 - water * per_layer)
        u, v = s["eastward_sea_water_velocity"], s["northward_sea_water_velocity"]
        turn = 1.2e-4 * self.step  # inertial, so that the state has a memory
        u, v = np.cos(turn) * u - np.sin(turn) * v, np.sin(turn) * u + np.cos(turn) * v
        s["eastward_sea_water_velocity"] = u + self.got["downward_eastward_stress_from_icebergs"] * per_layer
        s["northward_sea_water_velocity"] = v + self.got["downward_northward_stress_from_icebergs"] * per_layer

    def save(self) -> None:
        """Write state, what was got last and totals by step, of all ranks."""
        comm = self.component.comp_comm
        of_all = comm.gather((self.cells, {**self.state, **self.got}, np.array(self.totals), self.calved))
        if comm.rank == 0:
            order = np.argsort(np.concatenate([part[0] for part in of_all]))
            fields = {name: np.concatenate([part[1][name] for part in of_all])[order] for name in of_all[0][1]}
            totals, calved = sum(part[2] for part in of_all), sum(part[3] for part in of_all)
            np.savez(self.said["output"], totals=totals, calved=calved, **fields)


def run_bergs(said: dict) -> None:
    """Run the bergs by the interface in Python; keep what they gave by step."""
    from riftberg import Model, Options, YacComponent, build, read_coupling
    from riftberg.coupling.yac import ending_all_ranks, ocean_beside

    with ending_all_ranks():
        coupling = read_coupling(said["coupling"])
        model, _ = build(said["experiment"], Options(ocean=lambda f, p: ocean_beside(f, coupling, p)))
        if said.get("resume_bergs"):
            model = Model.resume(said["resume_bergs"], model.forcing)
        component = YacComponent(model, coupling)
        given, taken = [], []

        class Recorder:
            def start(self, model: Model) -> None: ...

            def record(self, model: Model) -> None:
                given.append([model.remembered["yac_given"][k] for k in range(len(GIVEN))])
                taken.append([np.array(value) for value, _ in component.taken.values()])

            def finish(self, model: Model) -> None: ...

        component.run([Recorder()])
        model.save(Path(said["output"]).with_suffix(".restart.nc"))
        g, b = component.exchange.grid, component.exchange.balance()
        np.savez(
            Path(said["output"]).with_suffix(".bergs.npz"), given=np.array(given), taken=np.array(taken),
            names=list(component.taken), area=g.arrays.area[g.domain], lon=model.elements.lon, lat=model.elements.lat,
            mass=model.elements.mass, melted=b.given, calved=b.taken, errors=[b.error, b.heat_error],
        )  # fmt: skip
        component.close()


if __name__ == "__main__":
    settings = json.loads(Path(sys.argv[1]).read_text())
    assert set(START) | set(STEADY) <= set(TAKEN)
    if settings.get("bergs", True) and MPI.COMM_WORLD.rank < settings.get("ranks of bergs", 1):
        run_bergs(settings)
    else:
        ocean = Ocean(settings)
        ocean.begin()
        ocean.run()
        ocean.save()
        del ocean
