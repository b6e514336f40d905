"""Stresses in a beam with a notch: the theory that lattices are held against, over the whole section and not only at the tip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

TERMS = 48
"""Of each of the two polynomials: the intensity at the tip is right to half a percent with them."""


class NotchedBeam:
    """A beam of height 1 with a crack from its lower edge; the tip is the origin, and the crack runs along negative x.

    Potentials of Muskhelishvili (1953, *Some Basic Problems of the Mathematical Theory of Elasticity*): with
    ``Phi = p / sqrt(z) + q`` and ``Omega = p / sqrt(z) - q``, p and q real polynomials, no traction acts on the crack.
    Least squares of the tractions on the other sides give the polynomials (boundary collocation, Gross and Srawley 1965).

    Parameters
    ----------
    depth : float
        Of the crack.
    half : float
        Half the length of the beam.
    lower, upper : float
        Stress at the ends of the beam at its lower and its upper edge; linear between.
    """

    def __init__(self, depth: float, half: float, lower: float, upper: float) -> None:
        self._middle, self._reach = 0.5 - depth, 0.9j * half
        part = 0.5 - 0.5 * np.cos(np.pi * (np.arange(300) + 0.5) / 300)
        above, end, below = (1.0 - depth + 1j * half * part, part - depth + 1j * half, 1j * half * part - depth)
        self._factors = np.eye(2 * TERMS)
        terms = np.array(self._stress(np.concatenate([above, end, below])))
        (xx, _, xy), (_, yy, xy_end), (xx_below, _, xy_below) = np.split(terms, 3, axis=2)
        asked = np.zeros((6, 300))
        asked[2] = lower + (upper - lower) * part
        matrix = np.hstack([xx, xy, yy, xy_end, xx_below, xy_below]).T
        size = np.linalg.norm(matrix, axis=0)
        self._factors = (np.linalg.lstsq(matrix / size, asked.ravel(), rcond=1e-12)[0] / size)[None]

    def _polynomials(self, z: Any) -> tuple[Any, Any]:
        """Chebyshev polynomials along the beam, real on the real axis, and their derivatives."""
        w, turn = (z - self._middle) / self._reach, (-1j) ** np.arange(TERMS)[:, None]
        value, slope = chebyshev.chebvander(w, TERMS - 1).T, np.zeros((TERMS, z.size), complex)
        slope[1] = 1.0
        for n in range(2, TERMS):
            slope[n] = 2.0 * value[n - 1] + 2.0 * w * slope[n - 1] - slope[n - 2]
        return turn * value, turn * slope / self._reach

    def _stress(self, z: Any) -> tuple[Any, Any, Any]:
        """Stresses xx, yy, xy at some points, one row for each row of factors."""
        value, slope = self._polynomials(z)
        of_p, of_q = self._factors[:, :TERMS], self._factors[:, TERMS:]
        root = np.sqrt(z)
        p, q = of_p @ value / root, of_q @ value
        prime = of_p @ slope / root - 0.5 * p / z + of_q @ slope
        both = p + q + np.conj(p - q) + (z - np.conj(z)) * np.conj(prime)
        return 4.0 * (p + q).real - both.real, both.real, -both.imag

    @property
    def intensity(self) -> float:
        """Stress intensity factor, in units of the stress and the root of the height."""
        at_tip = self._polynomials(np.zeros(1, complex))[0][:, 0].real
        return float(2.0 * math.sqrt(2.0 * math.pi) * (self._factors[0, :TERMS] @ at_tip))

    def stress(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Stresses along and across the line of the crack."""
        z = np.asarray(x) + 1j * np.asarray(y)
        xx, yy, _ = self._stress(z.ravel())
        return xx.reshape(z.shape), yy.reshape(z.shape)
