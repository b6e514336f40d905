"""Fields of the ice at the tip of a crack, and how a crack of mixed mode goes on.

Near the tip stress grows as ``K / sqrt(2 pi r)``. ``K_I`` opens the crack, ``K_II`` shears it; x runs along the crack, out of its
tip, and y to the left. Source: Williams (1957), J. Appl. Mech. 24, in the potentials of Muskhelishvili: with ``k = K_I - i K_II``

    Phi = k / (2 sqrt(2 pi z)),    Psi = (conj(k) - k) / (2 sqrt(2 pi z)) - z Phi'

    s_xx + s_yy = 4 Re Phi,    s_yy - s_xx + 2 i s_xy = 2 (conj(z) Phi' + Psi)
    2 mu d(a_x + i a_y)/dx = kappa Phi - conj(Phi) - z conj(Phi') - conj(Psi),    kappa = (3 - nu) / (1 + nu)

in plane stress, with displacements ``a``.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.physics.elementary import atan2, cos, sin

Floats = NDArray[np.float64]


@kernel
def crack_tip_fields(x: Floats, y: Floats, poisson: float) -> tuple[Floats, Floats]:
    """Stress at a crack tip, and how displacements change along the crack, for ``K_I = 1`` and for ``K_II = 1`` Pa m1/2.

    Parameters
    ----------
    x, y : Floats
        Places, m: along the crack beyond its tip, and to the left of it; shape (n,).
    poisson : float
        Poisson's ratio.

    Returns
    -------
    stress : Floats
        xx, yy and xy, Pa; shape (2, n, 3).
    gradient : Floats
        Young's modulus times the derivatives of both displacements along x, Pa; shape (2, n, 2).
    """
    stress, gradient = np.empty((2, x.size, 3)), np.empty((2, x.size, 2))
    for n in range(x.size):
        z = complex(x[n], y[n])
        root = cmath.sqrt(2.0 * math.pi * z)
        for mode in range(2):
            k = complex(1.0, 0.0) if mode == 0 else complex(0.0, -1.0)
            phi = 0.5 * k / root
            slope = -0.5 * phi / z
            psi = 0.5 * (k.conjugate() - k) / root - z * slope
            mean, deviator = 2.0 * phi.real, z.conjugate() * slope + psi
            stress[mode, n, 0], stress[mode, n, 1] = mean - deviator.real, mean + deviator.real
            stress[mode, n, 2] = deviator.imag
            potential = phi.conjugate() + z * slope.conjugate() + psi.conjugate()
            moved = (3.0 - poisson) * phi - (1.0 + poisson) * potential
            gradient[mode, n, 0], gradient[mode, n, 1] = moved.real, moved.imag
    return stress, gradient


def hoop_intensity(opening: float, shearing: float) -> tuple[float, float]:
    """Where a crack of mixed mode goes on, and with which intensity: normal to the largest hoop stress at its tip.

    Source: Erdogan and Sih (1963), J. Basic Eng. 85: the angle ``t`` at which ``cos(t/2) [K_I cos^2(t/2) - 3/2 K_II sin t]`` is
    largest, and that value. It is what the toughness is compared with.

    Parameters
    ----------
    opening, shearing : float
        ``K_I``, ``K_II``, Pa m1/2.

    Returns
    -------
    angle : float
        To the left of the way of the crack so far, rad.
    intensity : float
        Pa m1/2; 0 where ``K_I`` is negative: faces that press on each other do not go on.
    """
    if opening < 0.0 or opening == shearing == 0.0:
        return 0.0, 0.0
    half = atan2(-2.0 * shearing, opening + math.hypot(opening, math.sqrt(8.0) * shearing))
    return 2.0 * half, cos(half) * (opening * cos(half) ** 2 - 1.5 * shearing * sin(2.0 * half))
