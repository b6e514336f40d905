"""How deep floating ice lies in the water (Archimedes; equations 4.1), and when a narrow berg rolls over (files, 1.11)."""

from __future__ import annotations

import math
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import RHO_SEAWATER

_Metres = TypeVar("_Metres", float, NDArray[np.float64])


@kernel
def draft_of(thickness: _Metres, rho_ice: float) -> _Metres:
    """Depth of the keel of floating ice, m: ``D = (rho_i / rho_w) T``.

    The one place where a draft is computed; it takes arrays of thickness too.

    Parameters
    ----------
    thickness : float or array
        Thickness of the ice, m.
    rho_ice : float
        Density of the ice, kg m-3.
    """
    return (rho_ice / RHO_SEAWATER) * thickness


UPDATED: Final = 1
"""Scheme: a berg rolls where it is narrower than a ratio times its thickness (Burton et al. 2012)."""

WEEKS_MELLOR: Final = 2
"""Scheme of Weeks and Mellor (1978)."""

LEGACY: Final = 3
"""Scheme of the reference's default, known to be wrong: it compares the longer side with the draft."""


@kernel
def roll(
    thickness: float, width: float, length: float, scheme: int, tip: float, rho_ice: float, rolls_on: bool
) -> tuple[float, float, float]:
    """Return thickness, width and length (m) of a berg after it has rolled, or has not; it rolls once at most.

    Rolling exchanges thickness and width; the longer side is the length then.

    Parameters
    ----------
    thickness, width, length : float
        m.
    scheme : int
        `UPDATED`: ``tip * T > W``; `WEEKS_MELLOR`: ``W < sqrt(6 q (1 - q) T2 - 72 q T)``; `LEGACY`:
        ``max(W, L) < sqrt(0.92 D2 + 58.32 D)``; with the draft ``D = q T``, ``q = rho_ice / rho_sea``.
    tip : float
        Ratio of the first scheme; 0 or less means ``sqrt(6 q (1 - q))``.
    rho_ice : float
        kg m-3.
    rolls_on : bool
        Whether a berg rolls that is wider than thick (quirk T53). Below 808 kg m-3 both rules hold for a section and for
        the same section lying on its side, and the berg would roll at every step.
    """
    draft, ratio = draft_of(thickness, rho_ice), draft_of(1.0, rho_ice)
    if draft <= 0.0:
        return thickness, width, length
    if scheme == LEGACY:
        if max(width, length) < math.sqrt(0.92 * (draft * draft) + 58.32 * draft):
            thickness, width = width, thickness
            if width > length:
                width, length = length, width
        return thickness, width, length
    if width > length:
        width, length = length, width
    steep = 6.0 * ratio * (1.0 - ratio)
    if scheme == UPDATED:
        rolls = (tip if tip > 0.0 else math.sqrt(steep)) * thickness > width
    else:
        squared = steep * (thickness * thickness) - 72.0 * ratio * thickness
        rolls = squared > 0.0 and width < math.sqrt(max(squared, 0.0))
    if rolls and (rolls_on or width < thickness):
        thickness, width = width, thickness
        if width > length:
            width, length = length, width
    return thickness, width, length
