"""Strengths of bonds: drawn from a distribution, given one by one, or read from a map.

`riftberg.state.Bonds.strength` multiplies the fracture thresholds of a bond (1 is nominal).
"""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

import numpy as np

from riftberg.bergs.raster import Raster, read_raster
from riftberg.errors import BergError
from riftberg.state import Bonds, Elements, Floats

Distribution = Literal["weibull", "normal", "uniform"]
DISTRIBUTIONS = get_args(Distribution)

LEAST_MODULUS = 0.05
"""Weibull modulus below which the mean of the distribution is lost in floating point."""


def listed(values: Any, size: int) -> Floats:
    """Return given relative strengths, one for each of ``size`` bonds, if they are that."""
    try:
        strengths = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BergError(f"{error}", where="strength", remedy=f"Give {size} numbers, one per bond") from error
    if strengths.shape != (size,):
        raise BergError(
            f"values of shape {strengths.shape} for {size} bonds",
            where="strength",
            remedy="Give one value per bond, in the order of berg.bonds, a map, or a distribution",
        )
    _check_strengths(strengths, [f"bond {k}" for k in range(size)])
    return strengths


def mapped(source: Any, elements: Elements, bonds: Bonds) -> Floats:
    """Return the values of a map (Raster, DataArray, file) at the middles of the bonds."""
    raster = source if isinstance(source, Raster) else read_raster(source)
    lon, lat = (0.5 * (a[bonds.first] + a[bonds.second]) for a in (elements.lon, elements.lat))
    values = raster.sample(lon, lat)
    places = [f"{x:.4f}, {y:.4f}" for x, y in zip(lon, lat, strict=True)]
    missing = np.isnan(values)
    if missing.any():
        raise BergError(
            f"no strength for {missing.sum()} of {len(values)} bonds, the first at {places[int(np.argmax(missing))]}",
            where=raster.name,
            remedy="Extend the map or fill its gaps",
        )
    _check_strengths(values, places, raster.name)
    return values


def _check_strengths(strengths: Floats, places: list[str], name: str = "strength") -> None:
    bad = ~(np.isfinite(strengths) & (strengths > 0.0))
    if bad.any():
        k = int(np.argmax(bad))
        raise BergError(
            f"strength {strengths[k]:g} ({bad.sum()} of {len(bad)} values are not positive numbers)",
            where=f"{name}, {places[k]}",
            remedy="Give positive factors, 1 where a bond is as strong as the parameters say",
        )


def scatter(size: int, distribution: Distribution, *, shape: float | None, spread: float | None, seed: int) -> Floats:
    """Draw relative strengths of mean 1."""
    generator = np.random.default_rng(seed)
    spread = 0.1 if spread is None else spread
    if distribution == "weibull":
        modulus = 10.0 if shape is None else shape
        if not LEAST_MODULUS <= modulus < math.inf:
            raise BergError(
                f"Weibull modulus {modulus:g}", where="strength", remedy=f"Give a shape of {LEAST_MODULUS:g} or more"
            )
        return generator.weibull(modulus, size) / math.gamma(1.0 + 1.0 / modulus)
    if not 0 <= spread < 1:
        raise BergError(f"spread {spread}", where="strength", remedy="Give a spread from 0 up to, not including, 1")
    if distribution == "uniform":
        return generator.uniform(1.0 - spread, 1.0 + spread, size)
    if distribution != "normal":
        raise BergError(f"distribution {distribution!r}", where="strength", remedy=f"Use {', '.join(DISTRIBUTIONS)}")
    values = generator.normal(1.0, spread, size)
    while (low := values <= 0).any():
        values[low] = generator.normal(1.0, spread, int(low.sum()))
    return values
