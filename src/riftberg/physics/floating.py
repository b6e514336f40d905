"""How deep floating ice lies in the water (Archimedes; equations 4.1)."""

from __future__ import annotations

from typing import TypeVar

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
