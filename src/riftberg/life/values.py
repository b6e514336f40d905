"""What the kernels of life read: parameters flattened into scalars."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from riftberg.parameters import Parameters
from riftberg.physics.basal_melt import ExchangeValues
from riftberg.physics.rolling import LEGACY, UPDATED, WEEKS_MELLOR

EXPOSED, BERG, SHELF, MIXED = range(4)
"""Modes of melt, in the order of `riftberg.config.parameter_groups.MeltMode`."""

_MODES: Final = {"exposed": EXPOSED, "berg": BERG, "shelf": SHELF, "mixed": MIXED}
_SCHEMES: Final = {"updated": UPDATED, "weeks_mellor": WEEKS_MELLOR, "legacy": LEGACY}


class LifeValues(NamedTuple):
    """Scalars that the kernels of life read; what is not given as a number is NaN."""

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
    most_bonds: int
    bonds_on: bool
    rolls: bool
    rolling_scheme: int
    tip: float
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
    """Flatten the groups ``melt``, ``rolling`` and ``footloose`` and what else they need."""
    melt, quirks = p.melt, p.compatibility
    exchange = ExchangeValues(
        three_equation=melt.base == "three_equation",
        const_gamma=melt.const_gamma,
        gamma_t=melt.gamma_t,
        least_friction=melt.least_friction,
        drag=melt.friction_drag,
        tide=melt.tide,
        as_reference=quirks.plain_basal_search,
    )
    return LifeValues(
        rho_ice=p.ice.density,
        dt=p.stepping.time_step,
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
        bits_melt_at_zero_rates=quirks.bits_melt_at_zero_rates and melt.enabled,
        keep_shape=melt.keep_shape,
        least_gap=_number(melt.least_gap),
        most_bonds=6 if p.bonds.packing == "hexagonal" else 4,
        bonds_on=p.bonds.law != "none",
        rolls=p.rolling.enabled,
        rolling_scheme=_SCHEMES[p.rolling.scheme],
        tip=p.rolling.tip,
        footloose=p.footloose.enabled,
        youngs=p.footloose.youngs,
        strength=p.footloose.strength,
        bits_always_roll=quirks.bits_always_roll,
        drop_orphan_bits=quirks.drop_orphan_bits,
        element_length=quirks.element_length_in_base_law,
        latlon=p.earth.latlon,
        f_plane=p.earth.f_plane,
        reference_latitude=p.earth.reference_latitude,
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value
