"""What one step of melt does to each element: losses by process, and what is left; nothing of the state is changed here.

Source: files 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.life.values import BERG, EXPOSED, MIXED, LifeValues
from riftberg.physics.basal_melt import basal_melt_rate
from riftberg.physics.coriolis import coriolis_parameter
from riftberg.physics.floating import draft_of
from riftberg.physics.footloose import ASPECT, grow_foot, piece_width
from riftberg.physics.melting import (
    base_melt_rate,
    melt_bits,
    melt_block,
    side_melt_rate,
    wave_erosion_rate,
)
from riftberg.physics.rolling import roll
from riftberg.state import Elements, Floats
from riftberg.state.numbering import numbered


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

    @property
    def water(self) -> Floats:
        """Melt water that the ocean gets from each berg, kg: what the berg lost, less the bits that have not melted yet."""
        own = self.loss - (self.bits_born - self.bits_melt)
        return own + self.fl_loss - (self.fl_bits_born - self.fl_bits_melt)


COLUMNS = len(Melted._fields)


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
    """Sides of an element that bonds cover; all of those of a static element in the modes of the reference (files, 1.3)."""
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
    if values.least_gap >= 0.0 and gap < values.least_gap:
        return 0.0
    return max(rate, 0.0)


@kernel
def melt_rates(
    sea: _Sea, lat: float, thickness: float, span: float, depth: float, covered: int, values: LifeValues
) -> tuple[float, float, float]:
    """Rates (m s-1) at which base, sides and waves take from an element (files, 1.2 to 1.4).

    ``span``: length that the law of the base takes, m.
    """
    if values.zero_rates:
        return 0.0, 0.0, 0.0
    sides = side_melt_rate(sea.temperature)
    waves = wave_erosion_rate(sea.wind, sea.surface, min(1.0, sea.ice + values.sea_ice_shift))
    open_part = (values.most_bonds - covered) / values.most_bonds
    if values.mode == BERG:
        return base_melt_rate(sea.speed, sea.temperature, span), sides, waves
    if values.mode == EXPOSED:
        if values.turbulent:
            speed = math.sqrt(sea.speed * sea.speed + values.exchange.tide * values.exchange.tide)
            base = base_melt_rate(speed, sea.temperature, span)
        else:
            base = _shelf_rate(sea, lat, thickness, depth, values)
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
    return roll(thickness, width, ASPECT * width, values.rolling_scheme, values.tip, values.rho_ice)


@kernel
def _foot_after(
    foot: float, thin: float, before: tuple[float, float], between: tuple[float, float], after: tuple[float, float],
    by_sides: float, by_waves: float, values: LifeValues,
) -> float:  # fmt: skip
    """Area of the foot after the melt (files, 1.7); sides are pairs of width and length, m."""
    width, length = before
    least = ASPECT * piece_width(thin, values.youngs)
    if not values.footloose or foot < 0.0 or length <= least:
        return foot
    if width <= least:  # only the long sides make pieces
        by_sides *= (between[0] + width) / (2.0 * (between[1] + width))
        by_waves *= (after[0] + between[0]) / (2.0 * (after[1] + between[0]))
    return grow_foot(foot, thin, length, by_waves, by_sides, values.youngs, values.rho_ice)


@kernel
def melt_one(
    row: Floats, mass: float, shape: tuple[float, float, float], bits: float, foot: float, rates: tuple[float, float, float],
    span: float, sea: _Sea, covered: int, values: LifeValues,
) -> None:  # fmt: skip
    """Melt the berg of one element and its bergy bits into a row of `Melted` (files, 1.6 to 1.9, 1.11).

    ``span`` (m) is the size of the berg that the element belongs to: by it, pieces are small enough to break from an edge.
    """
    thickness, width, length = shape
    base, sides, waves = rates
    left, thin, wide, long, by_base, by_sides, by_waves, wide_between, long_between = melt_block(
        mass, thickness, width, length, base, sides, waves, values.dt, values.split
    )
    row[0], row[1], row[2], row[3] = by_base, by_sides, by_waves, mass - left
    before = (max(width, span), max(length, span)) if span > length else (width, length)
    between, after = (wide_between, long_between), (wide, long)
    row[19] = _foot_after(foot, thin, before, between, after, by_sides, by_waves, values)
    row[12], row[13], row[14], row[15], row[16] = left, thin, wide, long, bits
    if values.bits_fraction > 0.0 and (values.bits_melt_at_zero_rates or not values.zero_rates):
        row[4] = values.bits_fraction * by_waves
        row[16], row[5] = melt_bits(
            bits, row[4], min(min(length, width), thickness), sea.speed, sea.surface, values.rho_ice, values.dt,
            left == 0.0,
        )  # fmt: skip
    if values.rolls and covered == 0:
        row[13], row[14], row[15] = roll(thin, wide, long, values.rolling_scheme, values.tip, values.rho_ice)


@kernel
def melt_footloose_bits(
    row: Floats, thickness: float, bits: float, bergy: float, sea: _Sea, values: LifeValues
) -> None:
    """Melt the footloose bits of one element and their bergy bits into a row of `Melted` (files, 1.8, 1.9)."""
    row[17], row[18] = bits, bergy
    active = values.bits_fraction > 0.0
    still = values.zero_rates and not values.bits_melt_at_zero_rates
    if bits <= 0.0:
        if active and not still:  # what is left of bits of bits without any: dropped, or melted
            row[18] = 0.0
            row[23 if values.drop_orphan_bits else 11] = bergy
        return
    t, w, length = bit_shape(thickness, values)
    base, sides, waves = 0.0, 0.0, 0.0
    if not still:
        base = base_melt_rate(sea.speed, sea.temperature, length)
        sides = side_melt_rate(sea.temperature)
        waves = wave_erosion_rate(sea.wind, sea.surface, min(1.0, sea.ice + values.sea_ice_shift))
    left, thin, wide, long, by_base, by_sides, by_waves, _, _ = melt_block(
        bits, t, w, length, base, sides, waves, values.dt, values.split
    )
    row[6], row[7], row[8], row[9], row[17] = bits - left, by_base, by_sides, by_waves, left
    row[20], row[21], row[22] = thin, wide, long
    if active and not still:
        row[10] = values.bits_fraction * by_waves
        row[18], row[11] = melt_bits(
            bergy, row[10], min(min(length, w), t), sea.speed, sea.surface, values.rho_ice, values.dt, left == 0.0
        )


@kernel
def _sea_at(
    u: float, v: float, uo: float, vo: float, ua: float, va: float, surface: float, salinity: float, keel: float,
    keel_salinity: float, ice: float, values: LifeValues,
) -> _Sea:  # fmt: skip
    """What the sea is like at an element; numbers of the parameters stand for fields of the forcing."""
    salinity = keel_salinity if not math.isnan(keel_salinity) else salinity
    keel = keel if not math.isnan(keel) else surface
    if not math.isnan(values.temperature):
        surface = keel = values.temperature
    if not math.isnan(values.salinity):
        salinity = values.salinity
    du, dv, wx, wy = u - uo, v - vo, ua - uo, va - vo
    return _Sea(math.sqrt(du * du + dv * dv), math.sqrt(wx * wx + wy * wy), surface, keel, salinity, ice)


@kernel
def _melt_all(el: Elements, span: Floats, values: LifeValues) -> Floats:
    """Melt all elements; rows are the columns of `Melted`. Arrays are taken out first: each access counts references."""
    body, life, around, u, v, lat = el.body, el.life, el.environment, el.motion.u, el.motion.v, el.place.lat
    mass, thickness, width, length = body.mass, body.thickness, body.width, body.length
    bond_count, static, depth, ice = body.bond_count, body.static, around.depth, around.ice_fraction
    uo, vo, ua, va, sst, sss = around.uo, around.vo, around.ua, around.va, around.sst, around.sss
    keel, keel_salinity = around.keel_temperature, around.keel_salinity
    bits, foot, fl_bits, bergy = life.mass_of_bits, life.fl_k, life.mass_of_fl_bits, life.mass_of_fl_bergy_bits
    out, row = np.zeros((COLUMNS, mass.size)), np.zeros(COLUMNS)
    for e in range(mass.size):
        sea = _sea_at(
            u[e], v[e], uo[e], vo[e], ua[e], va[e], sst[e], sss[e], keel[e], keel_salinity[e], ice[e], values
        )  # fmt: skip
        shape = thickness[e], width[e], length[e]
        covered = covered_sides(bond_count[e], static[e], values)
        rates = melt_rates(sea, lat[e], shape[0], span[e], depth[e], covered, values)
        row[:] = 0.0
        melt_one(row, mass[e], shape, bits[e], foot[e], rates, span[e], sea, covered, values)
        melt_footloose_bits(row, shape[0], fl_bits[e], bergy[e], sea, values)
        for k in range(COLUMNS):
            out[k, e] = row[k]
    return out


def melted(elements: Elements, values: LifeValues) -> Melted:
    """Return what one long step of melt does to the elements, which stay as they are."""
    return Melted(*_melt_all(elements, base_spans(elements, values), values))


def base_spans(elements: Elements, values: LifeValues) -> Floats:
    """Length (m) along which water flows under each element: of its berg, so that it does not depend on the lattice."""
    body = elements.body
    if values.element_length or elements.size == 0:
        return body.length
    number, berg = numbered(body.berg)
    area = np.bincount(berg, body.length * body.width)[berg]
    alone = np.bincount(berg, minlength=number.size)[berg] == 1
    return np.where(alone, body.length, np.sqrt(area))
