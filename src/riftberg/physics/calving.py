"""Bergs from the flux of ice that leaves the land: smoothing in time, size classes, stores (files 3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel

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
) -> tuple[float, float]:  # fmt: skip
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

    Returns
    -------
    float, float
        Ice (kg) and heat (J) put into the stores.
    """
    stored, warmth = 0.0, 0.0
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
            stored += dt * rate * (1.0 - rest)
            warmth += dt * power * (1.0 - rest)
    return stored, warmth
