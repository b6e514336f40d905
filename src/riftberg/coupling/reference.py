"""One step of exchange as in the reference: its order, its fields, its stocks.

Source: files 4.6 and 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.constants import LATENT_HEAT
from riftberg.coupling.forcing import OceanForcing
from riftberg.coupling.nine_cells import NineCellRules, Spread, bergs_of, gather, orientations, spread_nine
from riftberg.errors import InputError
from riftberg.life.calving import FluxCalving
from riftberg.life.process import LifeModel, LifeProcess
from riftberg.life.thermodynamics import MeltStep, scaled_mass
from riftberg.life.values import life_values
from riftberg.model import BareModel
from riftberg.ocean.grid_arrays import Fields
from riftberg.physics.floating import draft_of
from riftberg.state import Floats


class ReturnRules(NamedTuple):
    """What the reference returns; names of its namelist in brackets."""

    nine: NineCellRules
    weight: bool  # Mass on the ocean is returned (``add_weight_to_ocean``)
    fields: bool  # Area and friction velocity are returned (``pass_fields_to_ocean_model``)
    passive: bool  # Nothing is returned (``passive_mode``)
    melt_by_mass: bool  # Melt water is what the spread mass has lost (``find_melt_using_spread_mass``)
    # Water under the mean keel of a cell below which nothing melts there, m; negative for none
    # (``apply_thickness_cutoff_to_gridded_melt``)
    least_gap: float


class Returned(NamedTuple):
    """What one step gives to the ocean; arrays over the cells of the domain."""

    calving: Floats  # Fresh water, kg m-2 s-1: melt and what no size class took
    calving_hflx: Floats  # Heat, W m-2
    mass_berg: Floats  # Mass on the ocean, kg m-2, and by the separate call
    ustar_berg: Floats  # Friction velocity at the base, m s-1
    area_berg: Floats  # Part of the cell that bergs cover
    incr_mass: Floats  # Mass on the ocean, kg m-2, and by the separate call
    stock_water: float  # Ice in stores and bergs, kg, and the heat it lacks, J
    stock_heat: float  # Ice in stores and bergs, kg, and the heat it lacks, J


class ReferenceExchange:
    """Bergs beside an ocean, stepped and returned as in the reference."""

    def __init__(self, model: BareModel, calving: FluxCalving, rules: ReturnRules) -> None:
        if model.life is None or not isinstance(model.forcing, OceanForcing):
            raise InputError("a model without melt or without the fields of an ocean", where="ReferenceExchange")
        self.model, self.calving, self.rules = model, calving, rules
        self.forcing: OceanForcing = model.forcing
        self.life: LifeProcess = model.life
        self.grid = model.forcing.ocean_grid
        self.values = life_values(model.parameters)
        self._before = np.zeros_like(self.grid.arrays.area)
        self._fields: Fields | None = None
        self._look, self.life.look_around = self.life.look_around, self._look_around

    def step(self, fields: Fields, flux: Floats, heat_flux: Floats, born: tuple[int, float]) -> Returned:
        """Take one step with the ocean (files, 5.2).

        ``flux``, ``heat_flux``: ice (kg m-2 s-1) and heat (W m-2) that leave the land (shape (nj, ni)).
        """
        dt = self.model.parameters.stepping.time_step
        self._fields = self.forcing.put(fields)
        taken = self.calving.take(flux, heat_flux, dt)
        births = self.calving.bear(*born, dt)
        if births.ids.size:
            self.model.append(births.elements, ids=births.ids)
        self.model.step()
        assert self.life.last is not None
        area = self.grid.arrays.area[self.grid.domain]
        melt, heat = self._melt(self.life.last.melt, dt)
        mass, cover, ustar, melt, heat = self._derived(melt, heat + taken.heat_left / area, dt)
        water = taken.left / area + melt
        if self.rules.passive:
            smooth = self.model.parameters.calving.smoothing_time > 0.0
            water, heat = (taken.flux, taken.heat_flux) if smooth else (flux.copy(), heat_flux.copy())
            mass, cover, ustar = np.zeros_like(mass), np.zeros_like(cover), np.zeros_like(ustar)
        on_ocean = mass if self.rules.weight else np.zeros_like(mass)
        stock = float(self.calving.stores.ice.sum()) + float(
            scaled_mass(self.model.elements.life, self.model.elements.body.mass).sum()
        )
        return Returned(water, heat, on_ocean, ustar, cover, on_ocean.copy(), stock, -stock * LATENT_HEAT)

    def _look_around(self, model: LifeModel) -> None:
        """Before the melt: see to the environment, and note the mass on the ocean where the melt is found from it."""
        if self._look is not None:
            self._look(model)
        if self.rules.melt_by_mass:
            self._before = gather(self._parts(self._bergs())[0], self.grid)

    def _bergs(self) -> Spread:
        earth = self.model.parameters.earth
        metric = earth.latlon, earth.radius, earth.period
        turn = orientations(self.model.elements, self.model.bonds, self.rules.nine, metric)
        return bergs_of(self.model.elements, turn)

    def _parts(self, bergs: Spread) -> Floats:
        assert self._fields is not None
        g = self.grid.arrays
        out = np.zeros((4, 9, *g.area.shape))
        spread_nine(bergs, self.rules.nine, self.values, self._fields.depth, self._fields.ssh, g.area, g.mask, out)
        return out

    def _melt(self, step: MeltStep, dt: float) -> tuple[Floats, Floats]:
        """Melt water (kg m-2 s-1) and its heat (W m-2), in the cells of the bergs (files, 1.10)."""
        g, place = self.grid.arrays, step.place
        rate = step.water / dt / g.area[place.cell_j, place.cell_i]
        melt, heat = np.zeros_like(g.area), np.zeros_like(g.area)
        np.add.at(melt, (place.cell_j, place.cell_i), rate)
        np.add.at(heat, (place.cell_j, place.cell_i), rate * step.heat_density)
        return melt[self.grid.domain], heat[self.grid.domain]

    def _derived(self, melt: Floats, heat: Floats, dt: float) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Mass, covered part and friction velocity, and melt and heat with the options of the reference (files, 4.6)."""
        rules, domain, p = self.rules, self.grid.domain, self.model.parameters
        shape = melt.shape
        mass, cover, ustar = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        u, v = np.zeros(shape), np.zeros(shape)
        if rules.weight or rules.melt_by_mass:
            parts = self._parts(self._bergs())
            mass = gather(parts[0], self.grid)[domain]
            if rules.fields:
                cover = np.minimum(gather(parts[1], self.grid)[domain], 1.0)
                u, v = (gather(q, self.grid)[domain] for q in parts[2:])
        if rules.melt_by_mass:
            after = self._after_melt() if p.melt.keep_shape else mass
            melt = np.maximum((self._before[domain] - after) / dt, 0.0)
            heat = melt * LATENT_HEAT
        if rules.fields:
            assert self._fields is not None
            du, dv = u - self._fields.uo[domain], v - self._fields.vo[domain]
            speed = np.sqrt(p.melt.friction_drag * (du * du + dv * dv + p.melt.tide**2))
            ustar = np.where(cover != 0.0, np.maximum(p.melt.least_friction, speed), 0.0)
        if rules.least_gap >= 0.0:
            assert self._fields is not None
            some = cover > 0.0
            thick = np.where(some, mass / (np.where(some, cover, 1.0) * p.ice.density), 0.0)
            shallow = some & (self._fields.depth[domain] - draft_of(thick, p.ice.density) < rules.least_gap)
            melt, heat = np.where(shallow, 0.0, melt), np.where(shallow, 0.0, heat)
        return mass, cover, ustar, melt, heat

    def _after_melt(self) -> Floats:
        """Mass (kg m-2) of bergs as they would be after the melt, where they do not decay (files, 1.12)."""
        assert self.life.last is not None
        m, bergs = self.life.last.melt.melted, self._bergs()
        left = m.mass > 0.0
        bits_only = ~left & (m.fl_bits > 0.0)
        one = m.fl_length * m.fl_width * m.fl_thickness * self.values.rho_ice
        scaling = np.where(bits_only, m.fl_bits * bergs.scaling / np.where(bits_only, one, 1.0), bergs.scaling)
        zero = np.zeros_like(m.mass)
        changed = bergs._replace(
            mass=np.where(left, m.mass, one), bits=m.bits, fl_bits=np.where(left, m.fl_bits, zero),
            fl_bergy_bits=np.where(left, m.fl_bergy_bits, zero), scaling=scaling,
            area=np.where(left, m.length * m.width, m.fl_length * m.fl_width),
            thickness=np.where(left, m.thickness, m.fl_thickness),
        )  # fmt: skip
        rows = np.flatnonzero(left | bits_only)
        some = Spread(**{name: np.ascontiguousarray(a[rows]) for name, a in changed._asdict().items()})
        return gather(self._parts(some)[0], self.grid)[self.grid.domain]
