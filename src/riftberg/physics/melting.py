"""How fast a berg melts and what that leaves of it: sides, base, waves, and the bits that waves break off (files, 1).

Rates are metres of ice per second; a side that melts at a rate takes that much from the length and from the width.
"""

from __future__ import annotations

import math
from typing import Final

from riftberg.compiled.kernels import kernel
from riftberg.constants import PI, SECONDS_PER_DAY

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
    return max(0.58 * speed**0.8 * (temperature + 4.0) / length**0.2, 0.0) * PER_DAY


@kernel
def bit_melt_rate(speed: float, temperature: float, size: float) -> float:
    """Melt of bergy bits, m s-1: as `base_melt_rate`, with ``t + 2`` (files, 1.9)."""
    return max(0.58 * speed**0.8 * (temperature + 2.0) / size**0.2, 0.0) * PER_DAY


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
    damped = 1.0 + math.cos(PI * (ice_fraction * ice_fraction * ice_fraction))
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
