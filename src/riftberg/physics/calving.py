"""Bergs from the flux of ice that leaves the land, in size classes and stores (files 3); pieces from the edge of a berg."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY, PI, RHO_SEAWATER, SECONDS_PER_DAY

Floats = NDArray[np.float64]


@kernel
def mean_weights(time_scale: float, dt: float) -> tuple[float, float]:
    """Weights of the present flux and of the mean so far: ``1 - a`` and ``a = tau / (tau + dt)`` (files 3.2).

    Parameters
    ----------
    time_scale : float
        Smoothing time tau, s; 0 gives the present flux.
    dt : float
        Time step, s.
    """
    old = time_scale / (time_scale + dt)
    if old > 0.5:
        new = dt / (time_scale + dt)
        return new, 1.0 - new
    return 1.0 - old, old


@kernel
def class_width(mass: float, thickness: float, density: float, ratio: float) -> float:
    """Width (m) of a berg of a class: ``sqrt(m / (r rho T))`` with the ratio r of length to width (files 3.1)."""
    return math.sqrt(mass / (ratio * density * thickness))


@kernel
def fractions_by_mass(numbers: Floats, mass: Floats, fractions: Floats) -> None:
    """Turn parts of the number of bergs into parts of their mass: ``d_k m_k / sum d_l m_l`` (files 3.1).

    The last class that has a part gets what the others leave, so that all sum to one.
    """
    total = 0.0
    last = 0
    for k in range(mass.size):
        total += numbers[k] * mass[k]
    for k in range(mass.size):
        fractions[k] = numbers[k] * mass[k] / total
        if fractions[k] > 0.0:
            last = k
    rest = 1.0
    for k in range(last):
        rest -= fractions[k]
    fractions[last] = rest


@kernel
def fill_stores(
    ice: Floats, heat: Floats, flux: Floats, heat_flux: Floats, area: Floats, south: NDArray[np.bool_],
    fractions: tuple[Floats, Floats], dt: float, left: Floats, heat_left: Floats,
) -> None:  # fmt: skip
    """Put a flux of ice and its heat into the stores of the size classes of each cell (files 3.2).

    ``S_k += dt C d_k`` with the flux C of the cell; the part ``1 - sum d_k`` of ice and heat is left over.

    Parameters
    ----------
    ice : ndarray, shape (classes, nj, ni)
        Stored ice, kg.
    heat : ndarray, shape (nj, ni)
        Heat that comes with it, J.
    flux, heat_flux : ndarray
        Ice and heat that arrive, kg m-2 s-1 and W m-2.
    area : ndarray
        Of the cells, m2.
    south : ndarray of bool
        Whether the southern table holds.
    fractions : tuple of ndarray, shape (classes,)
        Parts of the mass, southern and northern table.
    dt : float
        Time step, s.
    left, heat_left : ndarray
        Written: what is left over, kg s-1 and W.
    """
    for j in range(flux.shape[0]):
        for i in range(flux.shape[1]):
            rate, power = flux[j, i] * area[j, i], heat_flux[j, i] * area[j, i]
            fraction = fractions[0] if south[j, i] else fractions[1]
            rest = 1.0
            for k in range(ice.shape[0]):
                ice[k, j, i] += dt * rate * fraction[k]
                rest -= fraction[k]
            left[j, i], heat_left[j, i] = rate * rest, power * rest
            heat[j, i] += dt * power * (1.0 - rest)


# ---- the footloose mechanism: the submerged foot that waves leave lifts the edge until a piece breaks off (files, 2) --------

# Source: England, Wagner and Eisenman (2020), Sci. Adv. 6; Huth, Adcroft and Sergienko (2022), J. Adv. Model. Earth Syst. 14.

POISSON: Final = 0.3
"""Poisson's ratio of the bending edge."""

STIFF: Final = 12.0 * (1.0 - POISSON * POISSON)

ASPECT: Final = 3.0
"""Length of a piece over its width."""


@kernel
def buoyancy_length(thickness: float, youngs: float) -> float:
    """Length over which a floating plate bends, m: ``(E T3 / (12 (1 - nu2) g rho_w))^(1/4)`` (files, 2.1)."""
    cube = thickness * thickness * thickness
    return math.sqrt(math.sqrt(1.0 / (GRAVITY * RHO_SEAWATER) * (youngs / STIFF) * cube))


@kernel
def piece_width(thickness: float, youngs: float) -> float:
    """Width of a piece that breaks off, m: ``pi / (2 sqrt 2)`` of the buoyancy length (files, 2.1)."""
    return PI / (2.0 * math.sqrt(2.0)) * buoyancy_length(thickness, youngs)


@kernel
def foot_length(thickness: float, youngs: float, strength: float, rho_ice: float) -> float:
    """Length of the foot at which its buoyancy breaks the edge, m (files, 2.1).

    Parameters
    ----------
    thickness : float
        m.
    youngs, strength : float
        Young's modulus and yield stress of the ice, Pa.
    rho_ice : float
        kg m-3.
    """
    weight = 6.0 * rho_ice * GRAVITY * (RHO_SEAWATER - rho_ice)
    return math.exp(PI / 4.0) * RHO_SEAWATER * strength / weight * thickness / buoyancy_length(thickness, youngs)


INSTANT_MODULUS: Final = 9e9
"""Young's modulus (Pa) of ice under loads of seconds to hours."""

LONGEST_LOAD: Final = 10.0 * 365.25 * SECONDS_PER_DAY
"""Age (s) beyond which a foot is not taken to relax further."""


@kernel
def relaxed_modulus(thickness: float, growth: float, strength: float, rho_ice: float, viscosity: float) -> float:
    """Young's modulus of an edge whose foot has grown until it breaks it, Pa: ``E / (1 + t E / eta)`` at the age t of the foot.

    The older the foot, the softer the edge and the longer the foot that breaks it (`foot_length`), so that t is found by
    bisection.

    Parameters
    ----------
    thickness : float
        m.
    growth : float
        Rate at which the foot grows, m s-1; where it does not, the age is ten years.
    strength : float
        Yield stress of the edge, Pa.
    rho_ice : float
        kg m-3.
    viscosity : float
        ``eta``, Pa s.
    """
    least, most = 0.0, LONGEST_LOAD
    for _ in range(50):
        age = 0.5 * (least + most)
        youngs = INSTANT_MODULUS / (1.0 + age * INSTANT_MODULUS / viscosity)
        if growth * age < foot_length(thickness, youngs, strength, rho_ice):
            least = age
        else:
            most = age
    return INSTANT_MODULUS / (1.0 + least * INSTANT_MODULUS / viscosity)


@kernel
def grow_foot(
    foot: float, thickness: float, length: float, by_waves: float, by_sides: float, youngs: float, rho_ice: float
) -> float:
    """Return the area of the foot (m2) after a step of melt; waves cut above water, convection below (files, 1.7).

    Parameters
    ----------
    foot : float
        Area before, m2.
    thickness : float
        After the melt, m.
    length : float
        Longer side before it, m; where it makes no piece, the foot does not grow.
    by_waves, by_sides : float
        Ice lost to waves and to convection at the sides, kg; of long sides alone where only they count.
    youngs, rho_ice : float
        Pa and kg m-3.
    """
    least = ASPECT * piece_width(thickness, youngs)
    freeboard = thickness * (1.0 - rho_ice / RHO_SEAWATER)
    keel = thickness - freeboard
    if length <= least or freeboard <= 0.0:
        return foot
    return max(foot + (by_waves / freeboard - by_sides / keel) / rho_ice, 0.0)


@kernel
def steps_to_least(side: float, least: float) -> float:
    """Pieces that a side can lose until it is not longer than a piece; a whole number."""
    return math.ceil((side - least) / least)


@kernel
def pieces_ready(
    foot: float, thickness: float, width: float, length: float, youngs: float, strength: float, rho_ice: float
) -> float:
    """Number of pieces that break off now, a whole number: as the foot has grown, and no more than there are (files, 2.3)."""
    wide = piece_width(thickness, youngs)
    long = ASPECT * wide
    shortest = (length - steps_to_least(length, long) * long) * (width - steps_to_least(width, long) * long)
    most = max(math.floor((length * width - shortest) / (long * wide)), 0.0)
    if most == 0.0:
        return 0.0
    return min(math.floor(foot / (foot_length(thickness, youngs, strength, rho_ice) * long)), most)


@kernel
def sides_without(pieces: float, thickness: float, width: float, length: float, youngs: float) -> tuple[float, float]:
    """Width and length (m) of a berg from which pieces have broken (files, 2.3).

    Both sides retreat alike, ``(L - d)(W - d) = L W - 3 k b2``; the width no further than to the part of it that makes no
    piece, and not at all where it is shorter than a piece.
    """
    wide = piece_width(thickness, youngs)
    long = ASPECT * wide
    steps = steps_to_least(width, long)
    if steps <= 0.0:
        return width, length - ASPECT * pieces * (wide * wide) / width
    both = length + width
    retreat = 0.5 * (both - math.sqrt(both * both - 4.0 * long * wide * pieces))
    shorter, narrower, least = length - retreat, width - retreat, width - steps * long
    # The rest of the area is taken from the length, so that the pieces have what they need.
    if narrower < least:
        return least, shorter * (1.0 - (least - narrower) / least)
    return narrower, shorter


@kernel
def rim_place(draw: float, width: float, length: float, half_west: bool) -> tuple[float, float]:
    """Place on the rim of a berg, m east and north of its centre: north, east, south, west side in turn (files, 2.4).

    Parameters
    ----------
    draw : float
        Random number from 0 to 1.
    width, length : float
        m; the length lies east-west.
    half_west : bool
        Only the middle half of the west side (quirk T11).
    """
    if draw < 0.25:
        return length * (4.0 * draw - 0.5), 0.5 * width
    if draw < 0.5:
        return 0.5 * length, width * (4.0 * (draw - 0.25) - 0.5)
    if draw < 0.75:
        return length * (4.0 * (draw - 0.5) - 0.5), -0.5 * width
    part = 0.5 if half_west else 1.0
    return -0.5 * length, part * width * (4.0 * (draw - 0.75) - 0.5)
