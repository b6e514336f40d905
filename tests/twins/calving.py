"""Twin of calving from a flux of land ice (files 3), with whole arrays and without loops over cells."""

from __future__ import annotations

import numpy as np


def weights(tau, dt):
    """Of the present flux and of the mean so far."""
    return dt / (tau + dt), tau / (tau + dt)


def mass_fractions(numbers, mass):
    """Parts of the mass, the last class with a part getting the rest."""
    d = np.asarray(numbers) * np.asarray(mass)
    d = d / d.sum()
    last = np.flatnonzero(d > 0)[-1]
    d[last] = 1.0 - d[:last].sum()
    return d


def fill(ice, heat, flux, heat_flux, area, south, fractions, dt):
    """New stores of ice and heat, and what is left over (kg s-1, W)."""
    share = np.where(south[..., None], fractions[0], fractions[1])
    rate, power = flux * area, heat_flux * area
    rest = 1.0 - share.sum(axis=-1)
    return (
        ice + dt * rate * np.moveaxis(share, -1, 0),
        heat + dt * power * (1.0 - rest),
        rate * rest,
        power * rest,
    )
