"""What an exchange gives to the ocean: water, heat and stress of bergs by cell, and the ice that lies on each."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from riftberg.constants import LATENT_HEAT
from riftberg.coupling.fields import GIVEN, OceanForcing
from riftberg.coupling.ledger import Settling
from riftberg.coupling.shelf import Shares, compute_shares
from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.fragments.grounding_log import mass_on_floor
from riftberg.life.ledger import PROCESSES, scaled_mass
from riftberg.life.process import LifeModel
from riftberg.model import BareModel
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import interpolate_corners
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows


class AfterMotion(NamedTuple):
    """Elements after their motion and before the melt."""

    ids: Ints
    shares: Shares
    scaling: Floats
    drag: Floats  # Of the water on the elements, N, along and across the rows of the grid; shape (2, elements)


class OceanFluxes:
    """Fluxes from bergs to the ocean in one of its steps, of so many ``steps`` of the bergs."""

    def __init__(self, model: BareModel, forcing: OceanForcing, ocean_step: float, steps: int) -> None:
        self.model, self.forcing, self.grid = model, forcing, forcing.ocean_grid
        self.ocean_step, self.steps = ocean_step, steps
        self._after_motion: AfterMotion | None = None
        self.begin()

    def begin(self) -> None:
        """Begin a step of the ocean."""
        shape = self.grid.arrays.nj, self.grid.arrays.ni
        names = ("melt", "heat", "left", "left_heat", "stress_x", "stress_y")
        self.fields = {name: np.zeros(shape) for name in names}
        self.by_process = np.zeros((len(PROCESSES), *shape))

    def look(self, model: LifeModel) -> None:
        """Note the positions of the elements and the forces on them, before the melt."""
        m = self.model
        shares = compute_shares(m.elements, m.bonds, self.grid, m.parameters)
        scaling = m.elements.life.mass_scaling.copy()
        self._after_motion = AfterMotion(m.elements.body.id.copy(), shares, scaling, self._drag(m.elements))

    def step_bergs(self) -> tuple[Elements, Bonds] | None:
        """Let the bergs take one of their steps, add its fluxes, and return what left the grid over an open edge."""
        self._after_motion = None
        self.model.step()
        if self.model.departed is not None:
            self._add_departed(self.model.departed[0])
        # A model without melt has no process that looks around between motion and melt.
        if self._after_motion is None:
            self.look(self.model)
        self._add_step()
        return self.model.departed

    def _drag(self, elements: Elements) -> Floats:
        """Return the mean drag of the water (N) in the last step of the bergs, along and across the rows of the grid."""
        east, north = self.model.applied_forces(elements)[:, FORCES.index("water")].T
        g, mirrored = self.grid.arrays, bool(self.forcing.rules.mirrored)
        c, s = (interpolate_corners(angle, elements, mirrored) for angle in (g.cos_angle, g.sin_angle))
        return np.stack([c * east - s * north, s * east + c * north])

    def _add_departed(self, elements: Elements) -> None:
        """Add the drag of departed bergs in one step: to their cells, or to the nearest ones if they lie beyond the edge."""
        inside, place, g = elements.copy(), elements.place, self.grid.arrays
        for index, size, name in ((place.cell_i, g.ni, "cell_i"), (place.cell_j, g.nj, "cell_j")):
            getattr(inside.place, name)[:] = np.clip(index, g.halo, g.halo + size - 1)
        np.clip(place.xi, 0.0, 1.0, out=inside.place.xi)
        np.clip(place.eta, 0.0, 1.0, out=inside.place.eta)
        cells = inside.place.cell_j - g.halo, inside.place.cell_i - g.halo
        area = g.area[self.grid.domain][cells]
        for name, drag in zip(("stress_x", "stress_y"), self._drag(inside), strict=True):
            np.add.at(self.fields[name], cells, -drag * inside.life.mass_scaling / area / self.steps)

    def _add_step(self) -> None:
        """Add the fluxes of one step of the bergs."""
        assert self._after_motion is not None
        after, per_second = self._after_motion, 1.0 / self.ocean_step
        # The ocean gets the opposite of what it did to the bergs.
        for name, drag in zip(("stress_x", "stress_y"), after.drag, strict=True):
            self.fields[name] += after.shares.per_area(-drag * after.scaling) / self.steps
        life = self.model.life
        if life is None or life.last is None:
            return
        step = life.last.melt
        self.fields["melt"] += after.shares.per_area(step.water * per_second)
        self.fields["heat"] += after.shares.per_area(step.water * (step.heat_density - LATENT_HEAT) * per_second)
        for k, water in enumerate(life.last.water):
            self.by_process[k] += after.shares.per_area(water * per_second)

    def _end_state(self, settling: Settling) -> dict[str, Floats]:
        """Mass, area and friction velocity at the end of the step."""
        assert self._after_motion is not None
        el, p = self.model.elements, self.model.parameters
        # Melt may have removed elements since their shares were found: rows are matched by identifier.
        rows, matched = find_rows(self._after_motion.ids, el.body.id)
        # Processes of the user may have added ice since.
        shares = self._after_motion.shares.taken(rows) if matched.all() else find_shares(self.model, self.grid)
        scaling = el.life.mass_scaling
        mass, plan = scaled_mass(el.life, el.body.mass), el.body.length * el.body.width * scaling
        on_floor = grounded_mass(self.model, el)
        speed = np.hypot(el.motion.u - el.environment.uo, el.motion.v - el.environment.vo)
        friction = np.maximum(p.melt.least_friction, np.sqrt(p.melt.friction_drag * (speed**2 + p.melt.tide**2)))
        covered = shares.sum(plan)
        ustar = np.divide(shares.sum(plan * friction), covered, out=np.zeros_like(covered), where=covered > 0.0)
        return {
            "mass": settling.settled(shares.sum(mass - on_floor)) / self.grid.arrays.area[self.grid.domain],
            "grounded": shares.per_area(on_floor),
            "area": np.minimum(shares.per_area(plan), 1.0),
            "ustar": ustar,
        }

    def dataset(self, settling: Settling) -> xr.Dataset:
        """Return the fields to the ocean with their attributes."""
        g, fields = self.grid.arrays, {**self.fields, **self._end_state(settling)}
        data: dict[str, Any] = {}
        for name, q in GIVEN.items():
            attributes = {"units": q.units, "long_name": q.meaning}
            attributes |= {"standard_name": name} if q.standard else {}
            data[q.short] = (("j", "i"), fields[q.field], attributes)
        data["ficeberg_process"] = (
            ("process", "j", "i"), self.by_process, {"units": "kg m-2 s-1", "long_name": "melt water of bergs by process"}
        )  # fmt: skip
        lon, lat = g.lon_centre[self.grid.domain], g.lat_centre[self.grid.domain]
        coordinates = {"process": list(PROCESSES), "lon": (("j", "i"), lon), "lat": (("j", "i"), lat)}
        return xr.Dataset(data, coordinates)


def find_shares(model: BareModel, grid: Grid) -> Shares:
    """Return the shares of the elements in cells as they lie now."""
    elements = model.elements.copy()
    grid.locate(elements)
    return compute_shares(elements, model.bonds, grid, model.parameters)


def grounded_mass(model: BareModel, el: Elements) -> Floats:
    """Return the mass of each element that the sea floor bears, kg."""
    return np.asarray(mass_on_floor(el, model.constants) * el.life.mass_scaling)


def mass_on_cells(model: BareModel, grid: Grid) -> tuple[Floats, Floats]:
    """Return the mass of bergs on cells, and the part that the floor bears, kg."""
    shares = find_shares(model, grid)
    mass = scaled_mass(model.elements.life, model.elements.body.mass)
    return shares.sum(mass), shares.sum(grounded_mass(model, model.elements))
