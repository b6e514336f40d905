"""One step of melt: the loss of each element by process and the remaining ice; bergs become smaller, roll, or are gone.

Source: files 1.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.parameters import Parameters
from riftberg.physics.calving import ASPECT, grow_foot, piece_width
from riftberg.physics.floating import LEGACY, UPDATED, WEEKS_MELLOR, draft_of, roll
from riftberg.physics.geometry import coriolis_parameter
from riftberg.physics.melting import (
    ExchangeValues,
    basal_melt_rate,
    base_melt_rate,
    melt_bits,
    melt_block,
    melt_edge,
    side_melt_rate,
    wave_erosion_rate,
)
from riftberg.state import Elements, Floats, Ints, Place
from riftberg.state.population import numbered

EXPOSED, BERG, SHELF, MIXED = range(4)
"""Modes of melt, in the order of `riftberg.config.parameter_groups.MeltMode`."""

_MODES: Final = {"exposed": EXPOSED, "berg": BERG, "shelf": SHELF, "mixed": MIXED}
_SCHEMES: Final = {"updated": UPDATED, "weeks_mellor": WEEKS_MELLOR, "legacy": LEGACY}


class LifeValues(NamedTuple):
    """Scalars that the kernels of life read; NaN stands for no number."""

    rho_ice: float
    dt: float
    mode: int
    turbulent: bool
    exchange: ExchangeValues
    temperature: float
    salinity: float
    salinity_from_ocean: bool
    split: bool
    sea_ice_shift: float
    bits_fraction: float
    zero_rates: bool
    bits_melt_at_zero_rates: bool
    keep_shape: bool
    least_gap: float
    by_front: bool
    most_bonds: int
    bonds_on: bool
    rolls: bool
    rolling_scheme: int
    tip: float
    rolls_on: bool
    footloose: bool
    youngs: float
    strength: float
    bits_always_roll: bool
    drop_orphan_bits: bool
    element_length: bool
    latlon: bool
    f_plane: bool
    reference_latitude: float


def life_values(p: Parameters) -> LifeValues:
    """Flatten the groups ``melt``, ``rolling`` and ``footloose`` and the other scalars that they need."""
    melt = p.melt
    exchange = ExchangeValues(
        three_equation=melt.base == "three_equation",
        const_gamma=melt.const_gamma,
        gamma_t=melt.gamma_t,
        least_friction=melt.least_friction,
        drag=melt.friction_drag,
        tide=melt.tide,
        as_reference=melt.plain_basal_search,
        scaled_laminar=melt.scaled_laminar_layer,
    )
    return LifeValues(
        rho_ice=p.ice.density,
        dt=p.time_step,
        mode=_MODES[melt.mode],
        turbulent=melt.base == "turbulent",
        exchange=exchange,
        temperature=_number(melt.temperature),
        salinity=_number(melt.salinity),
        salinity_from_ocean=melt.salinity_from_ocean,
        split=melt.split,
        sea_ice_shift=melt.sea_ice_shift,
        bits_fraction=melt.bits_fraction,
        zero_rates=melt.zero_rates or not melt.enabled,
        bits_melt_at_zero_rates=melt.bits_melt_at_zero_rates and melt.enabled,
        keep_shape=melt.keep_shape,
        least_gap=_number(melt.least_gap),
        by_front=melt.mode == "exposed" and not p.quirks.forces_by_element,
        most_bonds=6 if p.bonds.packing == "hexagonal" else 4,
        bonds_on=p.bonds.law != "none",
        rolls=p.rolling.enabled,
        rolling_scheme=_SCHEMES[p.rolling.scheme],
        tip=p.rolling.tip,
        rolls_on=p.rolling.rolls_on,
        footloose=p.footloose.enabled,
        youngs=p.footloose.youngs,
        strength=p.footloose.strength,
        bits_always_roll=p.footloose.bits_always_roll,
        drop_orphan_bits=melt.drop_orphan_bits,
        element_length=melt.element_length_in_base_law,
        latlon=p.earth.latlon,
        f_plane=p.earth.f_plane,
        reference_latitude=p.earth.reference_latitude,
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value


class Melted(NamedTuple):
    """Losses and remains of the elements in one step; arrays of shape (elements,), for one of the bergs each stands for."""

    base: Floats  # Ice that the berg lost by each process, kg; ``waves`` holds what became bergy bits too
    sides: Floats  # Ice that the berg lost by each process, kg; ``waves`` holds what became bergy bits too
    waves: Floats  # Ice that the berg lost by each process, kg; ``waves`` holds what became bergy bits too
    loss: Floats  # Ice that the berg lost, kg; the sum of the three where they act one after the other
    bits_born: Floats  # Bergy bits that waves broke off, and those that melted, kg
    bits_melt: Floats  # Bergy bits that waves broke off, and those that melted, kg
    fl_loss: Floats  # The same of footloose bits
    fl_base: Floats  # The same of footloose bits
    fl_sides: Floats  # The same of footloose bits
    fl_waves: Floats  # The same of footloose bits
    fl_bits_born: Floats  # The same of their bergy bits
    fl_bits_melt: Floats  # The same of their bergy bits
    mass: Floats  # Of the berg after melt and rolling (kg, m)
    thickness: Floats  # Of the berg after melt and rolling (kg, m)
    width: Floats  # Of the berg after melt and rolling (kg, m)
    length: Floats  # Of the berg after melt and rolling (kg, m)
    bits: Floats  # Mass of bits after it, kg
    fl_bits: Floats  # Mass of bits after it, kg
    fl_bergy_bits: Floats  # Mass of bits after it, kg
    foot: Floats  # Area of the foot after it, m2
    fl_thickness: Floats  # Of one footloose bit after it, m; 0 where there are none
    fl_width: Floats  # Of one footloose bit after it, m; 0 where there are none
    fl_length: Floats  # Of one footloose bit after it, m; 0 where there are none
    dropped: Floats  # Bits that vanish without melt water (quirk T44), kg
    retreat: Floats  # How far each side melted back, m

    @property
    def water(self) -> Floats:
        """Melt water that the ocean gets from each berg, kg: the loss of the berg, less the bits that have not melted yet."""
        net_loss = self.loss - (self.bits_born - self.bits_melt)
        return net_loss + self.fl_loss - (self.fl_bits_born - self.fl_bits_melt)


COLUMNS = len(Melted._fields)

NO_RATES: Final = np.zeros((3, 0))
"""No melt law of one's own."""


class _Sea(NamedTuple):
    """The sea at one element: speeds past the ice (m s-1), temperatures (degrees Celsius), salinity, sea ice."""

    speed: float
    wind: float
    surface: float
    temperature: float
    salinity: float
    ice: float


@kernel
def covered_sides(bonds: int, static: float, values: LifeValues) -> int:
    """Sides of an element that bonds cover; all sides of a static element in the modes of the reference (files, 1.3)."""
    if values.mode != EXPOSED and static >= 0.5:
        return values.most_bonds
    return min(bonds, values.most_bonds) if values.bonds_on else 0


@kernel
def _shelf_rate(sea: _Sea, lat: float, thickness: float, depth: float, values: LifeValues) -> float:
    """Melt of the base as under an ice shelf, m s-1; no ice freezes on (files, 1.4)."""
    f = coriolis_parameter(lat, values.latlon, values.f_plane, values.reference_latitude)
    salinity = sea.salinity if values.salinity_from_ocean else 35.0
    rate = basal_melt_rate(sea.speed, f, salinity, sea.temperature, thickness, values.rho_ice, values.exchange)
    gap = depth - draft_of(thickness, values.rho_ice)
    # Where the keel all but touches the floor, no water passes under it.
    if values.least_gap >= 0.0 and gap < values.least_gap:
        return 0.0
    return max(rate, 0.0)


@kernel
def melt_rates(
    sea: _Sea, lat: float, thickness: float, span: float, depth: float, covered: int, front: float, values: LifeValues
) -> tuple[float, float, float]:
    """Rates (m s-1) at which base, sides and waves take from an element (files, 1.2 to 1.4).

    ``span``: length that the law of the base takes, m; ``front``: length along which its sides melt, m, not negative where
    that is known.
    """
    if values.zero_rates:
        return 0.0, 0.0, 0.0
    sides = side_melt_rate(sea.temperature)
    waves = wave_erosion_rate(sea.wind, sea.surface, min(1.0, sea.ice + values.sea_ice_shift))
    # Sides with a bond face other ice and not the sea.
    open_part = (values.most_bonds - covered) / values.most_bonds
    if values.mode == BERG:
        return base_melt_rate(sea.speed, sea.temperature, span), sides, waves
    if values.mode == EXPOSED:
        # The law of bergs has no tide of its own; it is added to the speed as in the law of shelves.
        if values.turbulent:
            speed = math.sqrt(sea.speed * sea.speed + values.exchange.tide * values.exchange.tide)
            base = base_melt_rate(speed, sea.temperature, span)
        else:
            base = _shelf_rate(sea, lat, thickness, depth, values)
        if front >= 0.0:
            return base, sides, waves
        return base, open_part * sides, open_part * waves
    shelf = _shelf_rate(sea, lat, thickness, depth, values)
    if values.mode == MIXED:
        base = open_part * base_melt_rate(sea.speed, sea.temperature, span)
        return base + covered / values.most_bonds * shelf, 0.0, open_part * (sides + waves)
    return shelf, 0.0, 0.0


@kernel
def bit_shape(thickness: float, values: LifeValues) -> tuple[float, float, float]:
    """Thickness, width and length (m) of one footloose bit of a berg (files, 2.5)."""
    width = piece_width(thickness, values.youngs)
    if not (values.rolls or values.bits_always_roll):
        return thickness, width, ASPECT * width
    return roll(thickness, width, ASPECT * width, values.rolling_scheme, values.tip, values.rho_ice, values.rolls_on)


@kernel
def _foot_after(
    foot: float, thin: float, sides_before: tuple[float, float], sides_between: tuple[float, float],
    sides_after: tuple[float, float], by_sides: float, by_waves: float, values: LifeValues,
) -> float:  # fmt: skip
    """Area of the foot after the melt (files, 1.7); sides are pairs of width and length, m."""
    width, length = sides_before
    least = ASPECT * piece_width(thin, values.youngs)
    if not values.footloose or foot < 0.0 or length <= least:
        return foot
    if width <= least:  # only the long sides make pieces
        by_sides *= (sides_between[0] + width) / (2.0 * (sides_between[1] + width))
        by_waves *= (sides_after[0] + sides_between[0]) / (2.0 * (sides_after[1] + sides_between[0]))
    return grow_foot(foot, thin, length, by_waves, by_sides, values.youngs, values.rho_ice)


@kernel
def melt_one(
    row: Floats, ice: tuple[float, float, float], shape: tuple[float, float, float], rates: tuple[float, float, float],
    span: float, front: float, sea: _Sea, covered: int, values: LifeValues,
) -> None:  # fmt: skip
    """Melt the berg of one element and its bergy bits into a row of `Melted` (files, 1.6 to 1.9, 1.11).

    ``ice``: mass of the element and of its bergy bits (kg), length of its foot (m). ``span`` (m) is the size of the berg that the
    element belongs to: by it, pieces are small enough to break from an edge. ``front`` (m) is the length of the outline of that
    berg along which the element melts; negative: it melts as a block.
    """
    mass, bits, foot = ice
    thickness, width, length = shape
    base, sides, waves = rates
    if front >= 0.0:
        left, thin, wide, long, by_base, by_sides, by_waves, wide_between, long_between = melt_edge(
            mass, thickness, width, length, front, base, sides, waves, values.dt, values.split
        )
    else:
        left, thin, wide, long, by_base, by_sides, by_waves, wide_between, long_between = melt_block(
            mass, thickness, width, length, base, sides, waves, values.dt, values.split
        )
    row[0], row[1], row[2], row[3] = by_base, by_sides, by_waves, mass - left
    row[24] = 0.5 * (sides + waves) * values.dt
    sides_before = (max(width, span), max(length, span)) if span > length else (width, length)
    sides_between, sides_after = (wide_between, long_between), (wide, long)
    row[19] = _foot_after(foot, thin, sides_before, sides_between, sides_after, by_sides, by_waves, values)
    row[12], row[13], row[14], row[15], row[16] = left, thin, wide, long, bits
    if values.bits_fraction > 0.0 and (values.bits_melt_at_zero_rates or not values.zero_rates):
        row[4] = values.bits_fraction * by_waves
        row[16], row[5] = melt_bits(
            bits, row[4], min(min(length, width), thickness), sea.speed, sea.surface, values.rho_ice, values.dt,
            left == 0.0,
        )  # fmt: skip
    if values.rolls and covered == 0:
        row[13], row[14], row[15] = roll(
            thin, wide, long, values.rolling_scheme, values.tip, values.rho_ice, values.rolls_on
        )


@kernel
def melt_footloose_bits(
    row: Floats, thickness: float, bits: float, bergy: float, sea: _Sea, values: LifeValues
) -> None:
    """Melt the footloose bits of one element and their bergy bits into a row of `Melted` (files, 1.8, 1.9)."""
    row[17], row[18] = bits, bergy
    active = values.bits_fraction > 0.0
    no_melt = values.zero_rates and not values.bits_melt_at_zero_rates
    if bits <= 0.0:
        if active and not no_melt:  # what is left of bits of bits without any: dropped, or melted
            row[18] = 0.0
            row[23 if values.drop_orphan_bits else 11] = bergy
        return
    t, w, length = bit_shape(thickness, values)
    base, sides, waves = 0.0, 0.0, 0.0
    if not no_melt:
        base = base_melt_rate(sea.speed, sea.temperature, length)
        sides = side_melt_rate(sea.temperature)
        waves = wave_erosion_rate(sea.wind, sea.surface, min(1.0, sea.ice + values.sea_ice_shift))
    left, thin, wide, long, by_base, by_sides, by_waves, _, _ = melt_block(
        bits, t, w, length, base, sides, waves, values.dt, values.split
    )
    row[6], row[7], row[8], row[9], row[17] = bits - left, by_base, by_sides, by_waves, left
    row[20], row[21], row[22] = thin, wide, long
    if active and not no_melt:
        row[10] = values.bits_fraction * by_waves
        row[18], row[11] = melt_bits(
            bergy, row[10], min(min(length, w), t), sea.speed, sea.surface, values.rho_ice, values.dt, left == 0.0
        )


@kernel
def _melt_all(el: Elements, span: Floats, depth: Floats, user_rates: Floats, values: LifeValues) -> Floats:
    """Melt all elements; rows are the columns of `Melted`. Arrays are taken out first: each access counts references.

    ``depth``: of the floor under the elements, m; ``user_rates``: rates (m s-1) by the law of a user, shape (3, elements) or
    (3, 0); NaN where the built-in law holds.
    """
    body, life, environment, u, v, lat = el.body, el.life, el.environment, el.motion.u, el.motion.v, el.place.lat
    mass, thickness, width, length = body.mass, body.thickness, body.width, body.length
    bond_count, static, ice = body.bond_count, body.static, environment.ice_fraction
    uo, vo, ua, va, sst, sss = (
        environment.uo,
        environment.vo,
        environment.ua,
        environment.va,
        environment.sst,
        environment.sss,
    )
    keel, keel_salinity = environment.keel_temperature, environment.keel_salinity
    bits, foot, fl_bits, bergy = life.mass_of_bits, life.fl_k, life.mass_of_fl_bits, life.mass_of_fl_bergy_bits
    front = life.front
    out, row = np.zeros((COLUMNS, mass.size)), np.zeros(COLUMNS)
    for e in range(mass.size):
        # Numbers of the parameters stand for fields of the forcing; without values at the keel those of the surface hold.
        surface, salinity = sst[e], keel_salinity[e] if not math.isnan(keel_salinity[e]) else sss[e]
        below = keel[e] if not math.isnan(keel[e]) else surface
        if not math.isnan(values.temperature):
            surface = below = values.temperature
        if not math.isnan(values.salinity):
            salinity = values.salinity
        du, dv, wx, wy = u[e] - uo[e], v[e] - vo[e], ua[e] - uo[e], va[e] - vo[e]
        current, wind = math.sqrt(du * du + dv * dv), math.sqrt(wx * wx + wy * wy)
        sea = _Sea(current, wind, surface, below, salinity, ice[e])
        shape = thickness[e], width[e], length[e]
        covered = covered_sides(bond_count[e], static[e], values)
        bears = front[e] if values.by_front else -1.0
        rates = melt_rates(sea, lat[e], shape[0], span[e], depth[e], covered, bears, values)
        if user_rates.shape[1] > 0:
            base, sides, waves = rates
            base = base if math.isnan(user_rates[0, e]) else user_rates[0, e]
            sides = sides if math.isnan(user_rates[1, e]) else user_rates[1, e]
            waves = waves if math.isnan(user_rates[2, e]) else user_rates[2, e]
            rates = base, sides, waves
        row[:] = 0.0
        melt_one(row, (mass[e], bits[e], foot[e]), shape, rates, span[e], bears, sea, covered, values)
        melt_footloose_bits(row, shape[0], fl_bits[e], bergy[e], sea, values)
        for k in range(COLUMNS):
            out[k, e] = row[k]
    return out


def compute_melt(
    elements: Elements, values: LifeValues, user_rates: Floats = NO_RATES, depth: Floats | None = None
) -> Melted:
    """Return the effect of one long step of melt on the elements, which stay unchanged."""
    depth = elements.environment.depth if depth is None else depth
    return Melted(*_melt_all(elements, base_spans(elements, values), depth, user_rates, values))


def base_spans(elements: Elements, values: LifeValues) -> Floats:
    """Length (m) along which water flows under each element: of its berg, so that it does not depend on the lattice."""
    body = elements.body
    if values.element_length or elements.size == 0:
        return body.length
    number, berg = numbered(body.berg)
    area = np.bincount(berg, body.length * body.width)[berg]
    # Ice that was born in this step has no number yet: each piece is a berg of its own.
    alone = (body.berg == 0) | (np.bincount(berg, minlength=number.size)[berg] == 1)
    return np.where(alone, body.length, np.sqrt(area))


class MeltStep(NamedTuple):
    """Input to the ocean in one step; rows are the elements before any was removed."""

    id: Ints  # Elements
    place: Place  # Where they were: positions, cells, places in the cells
    scaling: Floats  # Number of bergs that each stands for: everything in ``melted`` is for one of them
    heat_density: Floats  # Heat that the ice brings with it, J kg-1
    start_mass: Floats  # Mass at calving, kg
    u: Floats  # Velocity, m s-1
    v: Floats  # Velocity, m s-1
    melted: Melted  # Losses and remains
    gone: NDArray[np.bool_]  # Elements of which nothing is left; they are removed

    @property
    def water(self) -> Floats:
        """Melt water of all bergs of each element, kg."""
        return self.melted.water * self.scaling


def melt_step(
    elements: Elements,
    values: LifeValues,
    born: tuple[int, float],
    user_rates: Floats = NO_RATES,
    depth: Floats | None = None,
) -> MeltStep:
    """Melt all elements by one long step and change them; elements of which nothing is left are marked, not removed.

    ``depth``: of the floor under the elements, m, where it differs from the depth in their environment.
    """
    body, life = elements.body, elements.life
    result = compute_melt(elements, values, user_rates, depth)
    positions = Place(*(getattr(elements, name).copy() for name in Place._fields))
    step = MeltStep(
        body.id.copy(), positions, life.mass_scaling.copy(), life.heat_density.copy(), life.start_mass.copy(),
        elements.motion.u.copy(), elements.motion.v.copy(), result, np.zeros(body.id.size, bool),
    )  # fmt: skip
    life.fl_k[:] = result.foot
    life.retreat[:] += np.where(life.front >= 0.0, result.retreat, 0.0)
    if values.keep_shape:
        return step
    # The longer side is the length (files, 1.12).
    body.mass[:], body.thickness[:] = result.mass, result.thickness
    body.width[:] = np.minimum(result.width, result.length)
    body.length[:] = np.maximum(result.width, result.length)
    life.mass_of_bits[:], life.mass_of_fl_bits[:] = result.bits, result.fl_bits
    life.mass_of_fl_bergy_bits[:] = result.fl_bergy_bits
    empty = result.mass <= 0.0
    if empty.any():
        from riftberg.life.ice_fronts import hand_on_feet  # with shapely and scipy.spatial, half a second

        hand_on_feet(elements, empty)
    replaced = empty & (life.mass_of_fl_bits > 0.0)
    if replaced.any():
        _let_bits_replace(elements, result, replaced, values.rho_ice, born)
    step.gone[:] = empty & ~replaced
    return step


def _let_bits_replace(
    elements: Elements, result: Melted, rows: NDArray[np.bool_], rho_ice: float, born: tuple[int, float]
) -> None:
    """Where a berg has melted but its footloose bits have not, replace it by them (files, 1.12)."""
    body, life = elements.body, elements.life
    thickness, width, length = (a[rows] for a in (result.fl_thickness, result.fl_width, result.fl_length))
    mass = length * width * thickness * rho_ice
    old_scaling = life.mass_scaling[rows]
    scaling = result.fl_bits[rows] * old_scaling / mass
    body.mass[rows], body.thickness[rows], body.width[rows], body.length[rows] = mass, thickness, width, length
    life.mass_of_bits[rows] = result.fl_bergy_bits[rows] * old_scaling / scaling
    life.mass_of_fl_bits[rows] = life.mass_of_fl_bergy_bits[rows] = 0.0
    life.mass_scaling[rows], life.fl_k[rows] = scaling, -1.0
    life.start_year[rows], life.start_day[rows] = born
