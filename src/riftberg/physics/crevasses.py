"""Tension that floating ice bears beside its own: pre-stress, stable crevasses, and the reserve that they leave.

The water on the fronts of floating ice is lighter than the ice above it, so statics alone puts the ice under a tension in all
directions, ``sigma_0``. It opens crevasses from the surface (dry) and the base (filled with sea water). They go on where the
tension at their tips, over the pressure of the water, exceeds a strength ``s``. A section of thickness ``H`` that is crevassed
over the part ``x`` carries a further tension ``T``, mean over ``H``, up to

    T_max(x) = (1 - x) [ s - sigma_0 (1 - x) ],    largest at  x* = max(0, 1 - s / (2 sigma_0))

and ``T_max(x*)`` is its reserve: ``s^2 / (4 sigma_0)`` for s <= 2 sigma_0, ``s - sigma_0`` above. Without ``s`` it is zero, the
limit of an unbuttressed ice shelf (Coffey and Lai 2025); the term with ``s`` is an extension of it. Ice of one density is
assumed: firn of the same mean takes 15 to 35 % off sigma_0. A crevasse filled with water from the surface has no reserve.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY, RHO_SEAWATER

_Metres = TypeVar("_Metres", float, NDArray[np.float64])


@kernel
def prestress(thickness: _Metres, rho_ice: float) -> _Metres:
    """Pre-stress of floating ice, Pa: ``sigma_0 = rho_i g H (1 - rho_i / rho_w) / 2``; it takes arrays too.

    Parameters
    ----------
    thickness : float or array
        ``H``, m.
    rho_ice : float
        ``rho_i``, kg m-3.
    """
    return 0.5 * rho_ice * GRAVITY * (1.0 - rho_ice / RHO_SEAWATER) * thickness


@kernel
def stable_depth(crevasse_strength: float, sigma: float) -> float:
    """Part ``x*`` of the thickness down to which ice is crevassed before it parts.

    Parameters
    ----------
    crevasse_strength : float
        ``s``, Pa.
    sigma : float
        Pre-stress, Pa.
    """
    return max(0.0, 1.0 - crevasse_strength / (2.0 * sigma))


@kernel
def tension_at_depth(depth: float, crevasse_strength: float, sigma: float) -> float:
    """Largest tension ``T_max(x)``, Pa, of ice crevassed over the part ``depth`` of its thickness; see `stable_depth`."""
    return (1.0 - depth) * (crevasse_strength - sigma * (1.0 - depth))


@kernel
def reserve(crevasse_strength: float, sigma: float) -> float:
    """Tension, Pa, that ice bears beside its pre-stress: ``T_max(x*)``; see `stable_depth`."""
    return tension_at_depth(stable_depth(crevasse_strength, sigma), crevasse_strength, sigma)


@kernel
def implied_crevasse_strength(strength: float, sigma: float) -> float:
    """Strength ``s`` at the tips of crevasses, Pa, of which ``strength`` (Pa) is the reserve.

    ``2 sqrt(strength sigma_0)``, or ``strength + sigma_0`` where that exceeds ``2 sigma_0``.
    """
    return 2.0 * math.sqrt(strength * sigma) if strength <= sigma else strength + sigma


@kernel
def rift_factor(depth: float, crevasse_strength: float, sigma: float) -> float:
    """Tension that a rift through the part ``depth`` bears over the reserve: 1 where crevasses reach as deep."""
    deepest = max(depth, stable_depth(crevasse_strength, sigma))
    return tension_at_depth(deepest, crevasse_strength, sigma) / reserve(crevasse_strength, sigma)


@kernel
def reserves(thickness: NDArray[np.float64], rho_ice: float, crevasse_strength: float) -> NDArray[np.float64]:
    """`reserve` (Pa) of ice of some thicknesses (m), shape (n,), and one density (kg m-3)."""
    tension = np.empty(thickness.size)
    for k in range(thickness.size):
        tension[k] = reserve(crevasse_strength, prestress(thickness[k], rho_ice))
    return tension
