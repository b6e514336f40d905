"""How fast a berg melts and what that leaves of it: sides, base, waves, and the bits that waves break off (files, 1).

Rates are metres of ice per second; a side that melts at a rate takes that much from the length and from the width.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY, LATENT_HEAT, PI, RHO_SEAWATER, SECONDS_PER_DAY
from riftberg.physics.elementary import cos, fifth_root, log

PER_DAY: Final = 1.0 / SECONDS_PER_DAY
"""One per day in s-1; rates are multiplied by it, as in the reference."""

TWELFTH: Final = 1.0 / 12.0

LARGEST_BIT: Final = 40.0
"""No bergy bit is larger than this, m (files, 1.9)."""


@kernel
def side_melt_rate(temperature: float) -> float:
    """Melt of the sides by buoyant convection, m s-1: ``max(7.62e-3 t + 1.29e-3 t2, 0)`` per day (files, 1.2).

    Parameters
    ----------
    temperature : float
        Of the sea water, degrees Celsius.
    """
    return max(7.62e-3 * temperature + 1.29e-3 * (temperature * temperature), 0.0) * PER_DAY


@kernel
def base_melt_rate(speed: float, temperature: float, length: float) -> float:
    """Turbulent melt of the base, m s-1: ``max(0.58 q^0.8 (t + 4) / L^0.2, 0)`` per day (files, 1.2).

    Parameters
    ----------
    speed : float
        Of the water past the ice, m s-1.
    temperature : float
        Of the sea water, degrees Celsius.
    length : float
        Along which the boundary layer grows, m.
    """
    return max(0.58 * fifth_root(speed) ** 4 * (temperature + 4.0) / fifth_root(length), 0.0) * PER_DAY


@kernel
def bit_melt_rate(speed: float, temperature: float, size: float) -> float:
    """Melt of bergy bits, m s-1: as `base_melt_rate`, with ``t + 2`` (files, 1.9)."""
    return max(0.58 * fifth_root(speed) ** 4 * (temperature + 2.0) / fifth_root(size), 0.0) * PER_DAY


@kernel
def sea_state(wind: float) -> float:
    """Sea state that a wind raises: ``1.5 sqrt(q) + 0.1 q`` (files, 1.2).

    Parameters
    ----------
    wind : float
        Speed of the wind over the moving water, m s-1.
    """
    return 1.5 * math.sqrt(wind) + 0.1 * wind


@kernel
def wave_erosion_rate(wind: float, temperature: float, ice_fraction: float) -> float:
    """Erosion of the sides by waves, m s-1: ``max((t + 2) S (1 + cos(pi c3)) / 12, 0)`` per day (files, 1.2).

    Parameters
    ----------
    wind : float
        Speed of the wind over the moving water, m s-1.
    temperature : float
        Of the sea water, degrees Celsius.
    ice_fraction : float
        Part of the sea that sea ice covers, which damps the waves: half the erosion is left at 0.79, none at 1.
    """
    damped = 1.0 + cos(PI * (ice_fraction * ice_fraction * ice_fraction))
    return max(TWELFTH * (temperature + 2.0) * sea_state(wind) * damped, 0.0) * PER_DAY


@kernel
def melt_block(
    mass: float, thickness: float, width: float, length: float, base: float, sides: float, waves: float, dt: float,
    split: bool,
) -> tuple[float, float, float, float, float, float, float, float, float]:  # fmt: skip
    """Melt a block for a time; return what is left and what each process took (files, 1.6).

    Mass goes with volume, so a block keeps its density. Split, the processes act one after the other: base, sides, waves;
    their losses add up to the total. Unsplit, each loss is that of the block as it was, and they do not.

    Parameters
    ----------
    mass : float
        kg.
    thickness, width, length : float
        m.
    base, sides, waves : float
        Rates, m s-1.
    dt : float
        s.
    split : bool
        Whether the processes act one after the other.

    Returns
    -------
    tuple of float
        Mass (kg), thickness, width, length (m) that are left; loss at the base, at the sides, by waves (kg); width and
        length (m) between the work of the sides and that of the waves.
    """
    volume = thickness * width * length
    if volume <= 0.0:
        return mass, thickness, width, length, 0.0, 0.0, 0.0, width, length
    thin = max(thickness - base * dt, 0.0)
    if split:
        after_base = thin * width * length / volume * mass
        long, wide = max(length - sides * dt, 0.0), max(width - sides * dt, 0.0)
        after_sides = thin * wide * long / volume * mass
        longer, wider = max(long - waves * dt, 0.0), max(wide - waves * dt, 0.0)
        left = thin * wider * longer / volume * mass
        return left, thin, wider, longer, mass - after_base, after_base - after_sides, after_sides - left, wide, long
    longer, wider = max(length - (sides + waves) * dt, 0.0), max(width - (sides + waves) * dt, 0.0)
    left = thin * wider * longer / volume * mass
    per_volume = mass / volume
    walls = per_volume * (thickness * (width + length))
    return (
        left, thin, wider, longer, per_volume * (width * length) * base * dt, walls * sides * dt, walls * waves * dt,
        width, length,
    )  # fmt: skip


@kernel
def melt_edge(
    mass: float, thickness: float, width: float, length: float, front: float, base: float, sides: float, waves: float,
    dt: float, split: bool,
) -> tuple[float, float, float, float, float, float, float, float, float]:  # fmt: skip
    """Melt an element at the edge of a berg; as `melt_block`, but its sides melt along a given length of the outline.

    A block loses ``(W + L) d`` of its area where its sides melt by d, half of its perimeter; so an element loses ``front d / 2``.
    Width and length shrink alike.

    Parameters
    ----------
    mass, thickness, width, length, base, sides, waves, dt, split : float, bool
        As in `melt_block`.
    front : float
        Length of the outline at which the element melts, m; 0 inside of a berg.
    """
    area = width * length
    volume = thickness * area
    if volume <= 0.0:
        return mass, thickness, width, length, 0.0, 0.0, 0.0, width, length
    thin = max(thickness - base * dt, 0.0)
    between = max(area - 0.5 * front * sides * dt, 0.0)
    after = max(between - 0.5 * front * waves * dt, 0.0)
    first, last = math.sqrt(between / area), math.sqrt(after / area)
    left = thin * after / volume * mass
    if split:
        after_base, after_sides = thin * area / volume * mass, thin * between / volume * mass
        by_base, by_sides, by_waves = mass - after_base, after_base - after_sides, after_sides - left
    else:
        per_volume = mass / volume
        by_base = per_volume * area * base * dt
        by_sides, by_waves = per_volume * thickness * (area - between), per_volume * thickness * (between - after)
    return left, thin, last * width, last * length, by_base, by_sides, by_waves, first * width, first * length


@kernel
def melt_bits(
    bits: float, born: float, shortest: float, speed: float, temperature: float, rho_ice: float, dt: float, gone: bool
) -> tuple[float, float]:
    """Melt bergy bits; return the mass left and the mass that melted, kg (files, 1.9).

    Parameters
    ----------
    bits, born : float
        Mass of bits before the step, and of those that waves broke off in it, kg.
    shortest : float
        Shortest side of the berg before the step, m; bits are not larger, nor than `LARGEST_BIT`.
    speed, temperature : float
        Of the water, m s-1 and degrees Celsius.
    rho_ice : float
        kg m-3.
    dt : float
        s.
    gone : bool
        Whether nothing is left of the berg; then all its bits melt.
    """
    present = bits + born
    if gone:
        return 0.0, present
    size = min(shortest, LARGEST_BIT)
    area = bits / rho_ice / size
    melt = min(rho_ice * area * bit_melt_rate(speed, temperature, size) * dt, present)
    return present - melt, melt


# ---- melt at the base as under an ice shelf: exchange of heat and salt through a boundary layer (files, 1.5) --------------

# Sources: Holland and Jenkins (1999), J. Phys. Oceanogr. 29; McPhee et al. (1987), J. Geophys. Res. 92.

MIXED_LAYER: Final = 10.0
VON_KARMAN: Final = 0.40
ZETA: Final = 0.052
CRITICAL_RICHARDSON: Final = 0.20
VISCOSITY: Final = 1.95e-6
HEAT_DIFFUSIVITY: Final = 1.41e-7
SALT_DIFFUSIVITY: Final = 8.02e-10
HEAT_CAPACITY: Final = 3974.0

ATMOSPHERE: Final = 101325.0
DENSITY_BY_TEMPERATURE: Final = -0.038357
DENSITY_BY_SALINITY: Final = 0.805876
DENSITY_FRESH_COLD: Final = 999.910681

FREEZING_FRESH: Final = 0.0832
FREEZING_BY_SALINITY: Final = -0.0573
FREEZING_BY_PRESSURE: Final = -7.53e-8

MOLECULAR_HEAT: Final = 12.5 * (VISCOSITY / HEAT_DIFFUSIVITY) ** (2.0 / 3.0) - 6.0
MOLECULAR_SALT: Final = 12.5 * (VISCOSITY / SALT_DIFFUSIVITY) ** (2.0 / 3.0) - 6.0

PASSES: Final = 20
"""Passes of the search for the salinity at the ice in the reference."""

HALVINGS: Final = 50
"""Halvings of the search for the flux of buoyancy: what is left is round-off."""


class ExchangeValues(NamedTuple):
    """How heat and salt pass through the boundary layer.

    Attributes
    ----------
    three_equation : bool
        Solve for the salinity at the ice too; else the ice is at the freezing point of the water of the ocean.
    const_gamma : bool
        Constant exchange coefficients; else by the theory of the boundary layer. In the three-equation law only.
    gamma_t : float
        That coefficient for heat; for salt it is divided by 35.
    least_friction : float
        Smallest friction velocity, m s-1.
    drag : float
        Drag coefficient between water and ice.
    tide : float
        Speed of tides that the current lacks, m s-1.
    as_reference : bool
        Search as the reference does: the flux of buoyancy evaluated once (quirk T6), plain iteration (T7).
    scaled_laminar : bool
        Divide the term of the laminar sublayer by the constant of von Karman, as the reference does (T52).
    """

    three_equation: bool
    const_gamma: bool
    gamma_t: float
    least_friction: float
    drag: float
    tide: float
    as_reference: bool
    scaled_laminar: bool


@kernel
def freezing_point(salinity: float, pressure: float) -> float:
    """Temperature at which sea water freezes, degrees Celsius.

    Parameters
    ----------
    salinity, pressure : float
        In 1e-3 and Pa.
    """
    return (FREEZING_FRESH + FREEZING_BY_SALINITY * salinity) + FREEZING_BY_PRESSURE * pressure


@kernel
def friction_velocity(speed: float, drag: float, tide: float, least: float) -> float:
    """Friction velocity at the base, m s-1: ``max(u0, sqrt(Cd (q2 + tide2)))``."""
    return max(least, math.sqrt(drag * (speed * speed + tide * tide)))


@kernel
def _layer_depth(friction: float, coriolis: float) -> float:
    """Depth of the mixed layer, m: not deeper than rotation lets it become."""
    f = abs(coriolis)
    # Also at the equator, where rotation sets no depth and the quotient would be infinite.
    if f == 0.0 or f * MIXED_LAYER <= VON_KARMAN * friction:
        return MIXED_LAYER
    return VON_KARMAN * friction / f


@kernel
def _resistance(friction: float, depth: float, stability: float, scaled_laminar: bool) -> float:
    """Turbulent part of the resistance of the layer; ``stability`` 1 without a flux of buoyancy, larger with one.

    Holland and Jenkins (1999, eq. 15): ``(ln r - 2 ln s) / k + s / (2 zeta) - 1 / k`` with the ratio r of the depth of the
    layer to that of its laminar part, the stability s and the constant k of von Karman.
    """
    ratio = ZETA * ((depth * friction) / (5.0 * VISCOSITY))
    # A strong flux of buoyancy leaves no logarithmic part of the layer.
    turbulent = log(ratio) - 2.0 * log(stability) if ratio > 1.0 and ratio > stability * stability else 0.0
    laminar = 0.5 * stability / ZETA
    if scaled_laminar:
        return (1.0 / VON_KARMAN) * (turbulent + (laminar - 1.0))
    return (1.0 / VON_KARMAN) * (turbulent - 1.0) + laminar


@kernel
def _steady_coefficients(friction: float, depth: float, exchange: ExchangeValues) -> tuple[float, float]:
    """Exchange coefficients of heat and salt without a flux of buoyancy."""
    if exchange.const_gamma:
        return exchange.gamma_t, exchange.gamma_t / 35.0
    plain = _resistance(friction, depth, 1.0, exchange.scaled_laminar)
    return 1.0 / (MOLECULAR_HEAT + plain), 1.0 / (MOLECULAR_SALT + plain)


@kernel
def _stable_coefficients(friction: float, depth: float, flux: float, scaled_laminar: bool) -> tuple[float, float]:
    """Exchange coefficients of heat and salt with a stabilising flux of buoyancy (m2 s-3)."""
    cube = friction * friction * friction
    stability = math.sqrt(1.0 + (ZETA / CRITICAL_RICHARDSON) * (depth * VON_KARMAN) / cube * flux)
    turbulent = _resistance(friction, depth, stability, scaled_laminar)
    return 1.0 / (MOLECULAR_HEAT + turbulent), 1.0 / (MOLECULAR_SALT + turbulent)


@kernel
def _buoyancy_flux(heat: float, salt: float, gammas: tuple[float, float], density: float) -> float:
    """Flux of buoyancy, m2 s-3, of excesses of heat and salt times the friction velocity."""
    lift, sink = GRAVITY / density * DENSITY_BY_SALINITY, GRAVITY / density * DENSITY_BY_TEMPERATURE
    return lift * (salt * gammas[1]) + sink * (heat * gammas[0])


@kernel
def _interface(
    at_ice: float, salinity: float, temperature: float, pressure: float, friction: float, depth: float, density: float,
    exchange: ExchangeValues,
) -> tuple[float, float]:  # fmt: skip
    """Melt (kg m-2 s-1) where the water at the ice has a salinity, and the salinity that this melt would leave there.

    The flux of buoyancy is that of the steady coefficients (quirk T6).
    """
    heat, salt = (temperature - freezing_point(at_ice, pressure)) * friction, (salinity - at_ice) * friction
    gammas = _steady_coefficients(friction, depth, exchange)
    if not exchange.const_gamma:
        flux = _buoyancy_flux(heat, salt, gammas, density)
        if flux > 0.0:
            gammas = _stable_coefficients(friction, depth, flux, exchange.scaled_laminar)
    melt = RHO_SEAWATER * HEAT_CAPACITY * (heat * gammas[0]) / LATENT_HEAT
    salt_exchange = friction * gammas[1] * RHO_SEAWATER
    return melt, (salinity * salt_exchange) / (salt_exchange + melt)


@kernel
def _reference_search(
    salinity: float, temperature: float, pressure: float, friction: float, depth: float, density: float,
    exchange: ExchangeValues,
) -> tuple[bool, float]:  # fmt: skip
    """Plain iteration of the reference for the salinity at the ice; whether it did not fail, and the melt (kg m-2 s-1)."""
    at_ice, melt, low, high = salinity, 0.0, math.nan, math.nan
    for _ in range(PASSES):
        melt, found = _interface(at_ice, salinity, temperature, pressure, friction, depth, density, exchange)
        change = found - at_ice
        if abs(change) < 1e-4 * (0.5 * (salinity + at_ice + 1e-10)):
            return True, melt
        if change < 0.0:
            # The reference gives up where the salinity leaves the bracket that it has found, and takes the other law.
            if at_ice > high:
                return False, melt
            high = at_ice
        else:
            if at_ice < low:
                return False, melt
            low = at_ice
        at_ice = found
    return True, melt


@kernel
def _salinity_at_ice(
    salinity: float, temperature: float, pressure: float, friction: float, gammas: tuple[float, float]
) -> float:
    """Salinity at the ice with given coefficients: the positive root of the balance of salt, which is a quadratic."""
    melt = RHO_SEAWATER * HEAT_CAPACITY * friction * gammas[0] / LATENT_HEAT
    salt = friction * gammas[1] * RHO_SEAWATER
    square, line = -melt * FREEZING_BY_SALINITY, salt + melt * (temperature - freezing_point(0.0, pressure))
    root = math.sqrt(line * line + 4.0 * square * (salinity * salt))
    # Both are the positive root; each form avoids the difference of two nearly equal numbers on its side.
    if line > 0.0:
        return 2.0 * (salinity * salt) / (line + root)
    return (root - line) / (2.0 * square)


@kernel
def _balanced(
    salinity: float, temperature: float, pressure: float, friction: float, density: float, gammas: tuple[float, float]
) -> tuple[float, float]:
    """Excess of heat at the ice, times the friction velocity, and the flux of buoyancy, with given coefficients."""
    at_ice = _salinity_at_ice(salinity, temperature, pressure, friction, gammas)
    heat = (temperature - freezing_point(at_ice, pressure)) * friction
    return heat, _buoyancy_flux(heat, (salinity - at_ice) * friction, gammas, density)


@kernel
def _own_search(
    salinity: float, temperature: float, pressure: float, friction: float, depth: float, density: float,
    exchange: ExchangeValues,
) -> float:  # fmt: skip
    """Melt (kg m-2 s-1) with salinity at the ice and flux of buoyancy in balance with each other.

    A stabilising flux of buoyancy hinders the exchange that makes it, so there is one flux that makes itself; it is found
    between none and that of the steady coefficients by halving.
    """
    gammas = _steady_coefficients(friction, depth, exchange)
    heat, flux = _balanced(salinity, temperature, pressure, friction, density, gammas)
    if not exchange.const_gamma and flux > 0.0:
        low, high = 0.0, flux
        for _ in range(HALVINGS):
            assumed = 0.5 * (low + high)
            gammas = _stable_coefficients(friction, depth, assumed, exchange.scaled_laminar)
            heat, flux = _balanced(salinity, temperature, pressure, friction, density, gammas)
            if flux > assumed:
                low = assumed
            else:
                high = assumed
    return RHO_SEAWATER * HEAT_CAPACITY * (heat * gammas[0]) / LATENT_HEAT


@kernel
def basal_melt_rate(
    speed: float, coriolis: float, salinity: float, temperature: float, thickness: float, rho_ice: float,
    exchange: ExchangeValues,
) -> float:  # fmt: skip
    """Melt of the base in m of ice per second; may be negative, where water would freeze on (files, 1.5).

    Parameters
    ----------
    speed : float
        Of the water past the ice, m s-1.
    coriolis : float
        Coriolis parameter, s-1.
    salinity, temperature : float
        Of the water, 1e-3 and degrees Celsius.
    thickness : float
        Of the ice, m, for the pressure at its base.
    rho_ice : float
        kg m-3.
    exchange : ExchangeValues
        Law of the boundary layer.
    """
    pressure = ATMOSPHERE + GRAVITY * thickness * rho_ice
    density = DENSITY_FRESH_COLD + DENSITY_BY_TEMPERATURE * temperature + DENSITY_BY_SALINITY * salinity
    friction = friction_velocity(speed, exchange.drag, exchange.tide, exchange.least_friction)
    # Still water without tides: nothing carries heat to the ice.
    if friction <= 0.0:
        return 0.0
    depth = _layer_depth(friction, coriolis)
    if exchange.three_equation and exchange.as_reference:
        settled, melt = _reference_search(salinity, temperature, pressure, friction, depth, density, exchange)
        if settled:
            return melt / rho_ice
    elif exchange.three_equation:
        return _own_search(salinity, temperature, pressure, friction, depth, density, exchange) / rho_ice
    gamma = 1.0 / (MOLECULAR_HEAT + _resistance(friction, depth, 1.0, exchange.scaled_laminar))
    heat = friction * gamma * (temperature - freezing_point(salinity, pressure))
    return RHO_SEAWATER * HEAT_CAPACITY * heat / LATENT_HEAT / rho_ice
