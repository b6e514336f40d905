"""One step of exchange as in the reference: its order, its fields, its stocks, and its spreading over nine cells.

Source: files 4.1 to 4.6 and 5.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE, LATENT_HEAT_KID
from riftberg.coupling.fields import OceanForcing
from riftberg.errors import InputError
from riftberg.life.calving import FluxCalving
from riftberg.life.ledger import scaled_mass
from riftberg.life.melt import LifeValues, MeltStep, bit_shape, life_values
from riftberg.life.process import LifeModel, LifeProcess
from riftberg.model import BareModel
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import GriddedForcing
from riftberg.physics.floating import draft_of
from riftberg.physics.geometry import separation
from riftberg.physics.spreading import hexagon_shares, rectangle_shares, wet_part
from riftberg.state import Bonds, Elements, Floats, Ints

RHO_SPREADING: Final = 1035.0
"""Density of sea water that the reference takes here and nowhere else, kg m-3 (quirk T1)."""


class NineCellRules(NamedTuple):
    """How the reference spreads; names of its namelist in brackets."""

    hexagonal: bool  # Elements are hexagons (``hexagonal_icebergs``)
    one_cell_wide: bool  # Every rectangular berg counts as one cell wide (``use_old_spreading``)
    orientation: float  # Reference angle of hexagons, degrees (``initial_orientation``)
    turned_by_bonds: bool  # Hexagons turn with their bonds (``rotate_icebergs_for_mass_spreading`` and bonds on)
    grounding_fraction: float  # Part of the depth of water to which a keel weighs on the ocean; 0 for no limit


class Spread(NamedTuple):
    """Bergs to be spread; arrays of shape (bergs,)."""

    cell_i: Ints  # Cells and places in them
    cell_j: Ints  # Cells and places in them
    xi: Floats  # Cells and places in them
    eta: Floats  # Cells and places in them
    mass: Floats  # Of one berg, kg
    bits: Floats  # Of one berg, kg
    fl_bits: Floats  # Of one berg, kg
    fl_bergy_bits: Floats  # Of one berg, kg
    scaling: Floats  # Number of bergs
    area: Floats  # Of one berg, m2 and m
    thickness: Floats  # Of one berg, m2 and m
    u: Floats  # Velocity, m s-1
    v: Floats  # Velocity, m s-1
    static: Floats  # 1 where an element never moves
    orientation: Floats  # Turn of a hexagon, as the reference takes it


def orientations(elements: Elements, bonds: Bonds, rules: NineCellRules, earth: tuple[bool, float, float]) -> Floats:
    """Return the turn of each hexagon as the reference finds it from its bonds, radians taken for degrees (quirk T18).

    ``earth``: whether positions are degrees, radius (m), period.
    """
    value = np.full(elements.size, rules.orientation)
    if not rules.turned_by_bonds:
        return value
    third = math.pi / 3.0
    angles: list[list[float]] = [[] for _ in range(elements.size)]
    for b in np.flatnonzero(bonds.status == 0):
        for row, other in ((bonds.first[b], bonds.second[b]), (bonds.second[b], bonds.first[b])):
            e = elements.place
            dx, dy = separation(e.lon[other], e.lat[other], e.lon[row], e.lat[row], *earth)
            if dx == 0.0:
                angles[row].append(math.pi / 2.0)
            else:
                turn = (math.pi / 2.0 - rules.orientation * DEGREE) - math.atan(dy / dx)
                angles[row].append(turn % third)
    for e_row, turns in enumerate(angles):
        value[e_row] = (sum(turns) / len(turns) if turns else 0.0) % third
    return value


@kernel
def _afloat(thickness: float, water: float, rho_ice: float) -> float:
    """Part of the weight of a berg that the ocean bears, by the reference: depth of water over draft, at most 1."""
    draft = (rho_ice / RHO_SPREADING) * thickness
    return min(1.0, water / draft) if draft > water else 1.0


@kernel
def spread_nine(
    b: Spread,
    rules: NineCellRules,
    values: LifeValues,
    depth: Floats,
    ssh: Floats,
    area: Floats,
    mask: Floats,
    out: Floats,
) -> None:
    """Add mass (kg), area (m2) and area times velocity of bergs to the nine cells around each.

    ``out`` has the shape (4, 9, rows, columns): shares that the bergs of a cell give to its neighbour number n, counted row by
    row from the south-west.
    """
    w, scratch = np.zeros(9), np.zeros((8, 16))
    for e in range(b.mass.size):
        i, j, cell = b.cell_i[e], b.cell_j[e], area[b.cell_j[e], b.cell_i[e]]
        mass, fl_bits = b.mass[e], b.fl_bits[e]
        if rules.grounding_fraction > 0.0:
            water = rules.grounding_fraction * (depth[j, i] + ssh[j, i])
            mass = mass * _afloat(b.thickness[e], water, values.rho_ice)
            if fl_bits > 0.0:
                thin, _, _ = bit_shape(b.thickness[e], values)
                fl_bits = fl_bits * _afloat(thin, water, values.rho_ice)
        factor = 1.0
        if rules.hexagonal:
            reach = math.sqrt(3.0) / 2.0 * 0.49
            if cell > 0.0:
                reach = min(math.sqrt(b.area[e] / (2.0 * math.sqrt(3.0))) / math.sqrt(cell), 1.0)
            hexagon_shares(b.xi[e], b.eta[e], reach, b.orientation[e], w, scratch)
            if b.static[e] < 0.5:
                factor = 1.0 / wet_part(w, mask, i, j)
            for k in range(9):
                if k != 4:
                    w[k] *= mask[j + k // 3 - 1, i + k % 3 - 1]
        else:
            reach = 1.0
            if not rules.one_cell_wide and cell > 0.0:
                reach = min(math.sqrt(b.area[e] / cell), 1.0)
            rectangle_shares(b.xi[e], b.eta[e], reach, mask, i, j, w)
        weight = (((mass + fl_bits) + b.bits[e]) + b.fl_bergy_bits[e]) * b.scaling[e]
        plan = b.area[e] * b.scaling[e]
        for k in range(9):
            out[0, k, j, i] += (w[k] * weight) * factor
            out[1, k, j, i] += (w[k] * plan) * factor
            out[2, k, j, i] += (w[k] * (b.u[e] * plan)) * factor
            out[3, k, j, i] += (w[k] * (b.v[e] * plan)) * factor


def gather(shares: Floats, grid: Grid) -> Floats:
    """Return the sum that each cell gets from the nine around it, over its area; shape of the grid with its halo (files, 4.4).

    ``shares``: as `spread_nine` fills it (shape (9, rows, columns)).
    """
    g, h = grid.arrays, grid.arrays.halo
    c = np.zeros_like(shares)
    rows, columns = grid.domain
    c[:, rows, columns] = shares[:, rows, columns]
    if g.cyclic:
        c[:, :, :h], c[:, :, h + g.ni :] = c[:, :, g.ni : g.ni + h], c[:, :, h : 2 * h]

    def at(k: int, di: int, dj: int) -> Floats:
        neighbour: Floats = c[k, rows.start + dj : rows.stop + dj, columns.start + di : columns.stop + di]
        return neighbour

    total = at(4, 0, 0) + (
        ((at(8, -1, -1) + at(0, 1, 1)) + (at(6, 1, -1) + at(2, -1, 1)))
        + ((at(5, -1, 0) + at(3, 1, 0)) + (at(7, 0, -1) + at(1, 0, 1)))
    )
    field = np.zeros_like(g.area)
    area, mask = g.area[grid.domain], g.mask[grid.domain]
    field[grid.domain] = np.where(area > 0.0, total / np.where(area > 0.0, area, 1.0) * mask, 0.0)
    return field


class ReturnRules(NamedTuple):
    """Fields that the reference returns; names of its namelist in brackets."""

    nine: NineCellRules
    weight: bool  # Mass on the ocean is returned (``add_weight_to_ocean``)
    fields: bool  # Area and friction velocity are returned (``pass_fields_to_ocean_model``)
    passive: bool  # Nothing is returned (``passive_mode``)
    melt_by_mass: bool  # Melt water is what the spread mass has lost (``find_melt_using_spread_mass``)
    # Water under the mean keel of a cell below which nothing melts there, m; negative for none
    # (``apply_thickness_cutoff_to_gridded_melt``)
    least_gap: float


class Returned(NamedTuple):
    """Fields of one step to the ocean; arrays over the cells of the domain."""

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
        forcing = model.forcing
        if model.life is None or not isinstance(forcing, GriddedForcing) or forcing.grid is None:
            raise InputError("a model without melt or without fields on a grid", where="ReferenceExchange")
        self.model, self.calving, self.rules = model, calving, rules
        self.forcing: GriddedForcing = forcing
        self.life: LifeProcess = model.life
        self.grid = forcing.grid
        self._held: Ints = np.zeros(0, np.int64)  # born in this step, and not moved by it
        self.values = life_values(model.parameters)
        self._before = np.zeros_like(self.grid.arrays.area)
        self._fields: Fields | None = None
        self._look, self.life.look_around = self.life.look_around, self._look_around

    def step(self, fields: Fields, flux: Floats, heat_flux: Floats, born: tuple[int, float]) -> Returned:
        """Take one step with the ocean (files, 5.2).

        ``fields``: of this step; ``flux``, ``heat_flux``: ice (kg m-2 s-1) and heat (W m-2) that leave the land (shape
        (nj, ni)).
        """
        dt = self.model.parameters.time_step
        self._fields = self.forcing.put(fields) if isinstance(self.forcing, OceanForcing) else fields
        taken = self.calving.take(flux, heat_flux, dt)
        elements, ids = self.calving.bear(*born, dt)
        if ids.size:
            self.model.append(elements, ids=ids)
            # With multiple time steps a berg belongs to no conglomerate, and does not move, until the end of the step in which
            # it is born; in the first step conglomerates are found after the births (files, 5.2).
            if self.model.parameters.stepping.has_substeps and self.model.step_number > 0:
                self._held = ids
                self.model.elements.static[-ids.size :] = 1.0
        try:
            self.model.step()
        finally:
            self._let_go()
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
        return Returned(water, heat, on_ocean, ustar, cover, on_ocean.copy(), stock, -stock * LATENT_HEAT_KID)

    def _let_go(self) -> None:
        """Let bergs move that were held in the step of their birth."""
        if self._held.size:
            self.model.elements.static[np.isin(self.model.elements.id, self._held)] = 0.0
            self._held = self._held[:0]

    def _look_around(self, model: LifeModel) -> None:
        """Before the melt: see to the environment, and note the mass on the ocean where the melt is found from it."""
        self._let_go()
        if self._look is not None:
            self._look(model)
        if self.rules.melt_by_mass:
            self._before = gather(self._parts(self._bergs())[0], self.grid)

    def _bergs(self) -> Spread:
        earth = self.model.parameters.earth
        metric = earth.latlon, earth.radius, earth.period
        turn = orientations(self.model.elements, self.model.bonds, self.rules.nine, metric)
        # All elements as they stand, to be spread.
        place, body, life = self.model.elements.place, self.model.elements.body, self.model.elements.life
        return Spread(
            place.cell_i, place.cell_j, place.xi, place.eta, body.mass, life.mass_of_bits, life.mass_of_fl_bits,
            life.mass_of_fl_bergy_bits, life.mass_scaling, body.length * body.width, body.thickness, self.model.elements.motion.u,
            self.model.elements.motion.v, body.static, turn,
        )  # fmt: skip

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
            sums = self._parts(self._bergs())
            mass = gather(sums[0], self.grid)[domain]
            if rules.fields:
                cover = np.minimum(gather(sums[1], self.grid)[domain], 1.0)
                u, v = (gather(q, self.grid)[domain] for q in sums[2:])
        if rules.melt_by_mass:
            after = self._after_melt() if p.melt.keep_shape else mass
            melt = np.maximum((self._before[domain] - after) / dt, 0.0)
            heat = melt * LATENT_HEAT_KID
        if rules.fields:
            assert self._fields is not None
            du, dv = u - self._fields.uo[domain], v - self._fields.vo[domain]
            speed = np.sqrt(p.melt.friction_drag * (du * du + dv * dv + p.melt.tide**2))
            ustar = np.where(cover != 0.0, np.maximum(p.melt.least_friction, speed), 0.0)
        if rules.least_gap >= 0.0:
            assert self._fields is not None
            covered = cover > 0.0
            thick = np.where(covered, mass / (np.where(covered, cover, 1.0) * p.ice.density), 0.0)
            shallow = covered & (self._fields.depth[domain] - draft_of(thick, p.ice.density) < rules.least_gap)
            melt, heat = np.where(shallow, 0.0, melt), np.where(shallow, 0.0, heat)
        return mass, cover, ustar, melt, heat

    def _after_melt(self) -> Floats:
        """Mass (kg m-2) of bergs as they would be after the melt, where they do not decay (files, 1.12)."""
        assert self.life.last is not None
        m, bergs = self.life.last.melt.melted, self._bergs()
        left = m.mass > 0.0
        bits_only = ~left & (m.fl_bits > 0.0)
        bit_mass = m.fl_length * m.fl_width * m.fl_thickness * self.values.rho_ice
        scaling = np.where(bits_only, m.fl_bits * bergs.scaling / np.where(bits_only, bit_mass, 1.0), bergs.scaling)
        zero = np.zeros_like(m.mass)
        changed = bergs._replace(
            mass=np.where(left, m.mass, bit_mass), bits=m.bits, fl_bits=np.where(left, m.fl_bits, zero),
            fl_bergy_bits=np.where(left, m.fl_bergy_bits, zero), scaling=scaling,
            area=np.where(left, m.length * m.width, m.fl_length * m.fl_width),
            thickness=np.where(left, m.thickness, m.fl_thickness),
        )  # fmt: skip
        rows = np.flatnonzero(left | bits_only)
        remaining = Spread(**{name: np.ascontiguousarray(a[rows]) for name, a in changed._asdict().items()})
        return gather(self._parts(remaining)[0], self.grid)[self.grid.domain]
