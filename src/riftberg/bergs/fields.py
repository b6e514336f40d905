"""Fields of many small bergs: sizes from a distribution of the literature, places drawn without overlap.

``"gladstone"`` has the ten classes of length, thickness and frequency of Gladstone, Bigg and Nicholls (2001, JGR Oceans
106, 19903, table 1) as most models of iceberg drift use them. ``"tournadre"`` has areas by the power law of Tournadre
et al. (2016, JGR Oceans 121, 327), who find the exponent -1.52 (+-0.32) for areas of 0.1 to 10 000 km2 around Antarctica,
near the -3/2 of brittle fragmentation. Thickness follows the length as in the classes of Gladstone et al.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.bergs.keys import FieldOfBergs
from riftberg.config.values import check_place, given, native, numbers
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.state import Floats
from riftberg.system.input_files import value_shown

LENGTHS: Final = np.array([60.0, 100.0, 200.0, 350.0, 500.0, 700.0, 900.0, 1200.0, 1600.0, 2200.0])
"""Lengths of the classes, m."""

THICKNESSES: Final = np.array([40.0, 67.0, 133.0, 175.0, 250.0, 250.0, 250.0, 250.0, 250.0, 250.0])
"""Thicknesses of the classes, m."""

SHARES: Final = np.array([0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02])
"""Parts of the number of bergs in the classes; they are scaled to 1."""

ASPECT: Final = 1.5
"""Length over width of the bergs of these classes."""

EXPONENT: Final = 1.52
"""Exponent of the power law of areas."""

TRIES: Final = 2000
"""Places that are tried for a berg before the area counts as full."""

SIZES: Final = ("gladstone", "tournadre")


def aspect_of(sizes: Any) -> float:
    """Return the length over the width of bergs of a distribution: the classes are of long bergs, all others of squares."""
    return ASPECT if isinstance(sizes, str) and sizes == "gladstone" else 1.0


def areas(count: int, sizes: Any, random: np.random.Generator, between: tuple[float, float]) -> Floats:
    """Return plan areas of bergs, m2.

    ``sizes``: the distribution, or areas (m2) to draw from; ``between``: least and largest area (m2) of the power law.
    """
    if isinstance(sizes, str):
        if sizes == "gladstone":
            length = random.choice(LENGTHS, count, p=SHARES / SHARES.sum())
            return np.asarray(length * length / ASPECT)
        if sizes == "tournadre":
            return power_law(random.random(count), *between)
        raise BergError(f"sizes {sizes!r}", where="Iceberg.field", remedy=f"Use {', '.join(SIZES)}, or areas in m2")
    choices = numbers(sizes, "m2", where="sizes", kind=BergError).ravel()
    if choices.size == 0 or not (np.isfinite(choices) & (choices > 0.0)).all():
        raise BergError("sizes that are no areas", where="Iceberg.field", remedy="Give areas in m2, above 0")
    return np.asarray(random.choice(choices, count))


def checked_area(area: Any, *, latlon: bool) -> tuple[float, float, float, float]:
    """Return west, east, south and north of a field (degrees; m if not ``latlon``), or refuse what is no such box."""
    if latlon:
        west, east, south, north = given(area, FieldOfBergs, "area", kind=BergError)
        for latitude in (south, north):
            check_place((0.5 * (west + east), latitude), where="area", kind=BergError)
        return west, east, south, north
    metres = numbers(native(area), "m", where="area", kind=BergError)
    if metres.shape != (4,):
        raise BergError(
            f"{value_shown(area)} is no area", where="area", remedy="Give west, east, south and north in metres"
        )
    return tuple(metres.tolist())


def power_law(share: Floats, least: float, largest: float, exponent: float = EXPONENT) -> Floats:
    """Return the areas below which these shares (0 to 1) of a power law between two areas lie: its inverse distribution."""
    if not 0.0 < least < largest:
        raise BergError(
            f"areas between {least:g} and {largest:g} m2",
            where="Iceberg.field",
            remedy="Give a smaller one above 0 first",
        )
    a, b = least ** (1.0 - exponent), largest ** (1.0 - exponent)
    return np.asarray((a + share * (b - a)) ** (1.0 / (1.0 - exponent)))


def thickness_of(area: Floats) -> Floats:
    """Return the thickness (m) that goes with plan areas (m2), by the length of bergs of the usual aspect."""
    return np.asarray(np.interp(np.sqrt(ASPECT * area), LENGTHS, THICKNESSES), np.float64)


def places(
    radius: Floats, box: tuple[float, float, float, float], gap: float, metric: Metric, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return places in a box at which discs of these radii (m) keep a gap (m), the largest first placed.

    ``radius``: half of the greatest extent of each berg, m; ``box``: west, east, south and north (degrees; ``gap``:
    least distance of the rims, m.
    """
    west, east, south, north = box
    if not (west < east and south < north and all(np.isfinite(box))):
        raise BergError(
            f"area {list(box)}", where="Iceberg.field", remedy="Give west, east, south and north, the smaller one first"
        )
    # The largest first: they find no place once small ones stand everywhere.
    order = np.argsort(-radius, kind="stable")
    lon, lat = np.full(radius.size, np.nan), np.full(radius.size, np.nan)
    for n, k in enumerate(order):
        done = order[:n]
        for _ in range(TRIES):
            x, y = _drawn(west, east, south, north, metric.latlon, random)
            dx, dy = separations(metric, lon[done], lat[done], np.asarray(x), np.asarray(y))
            if n == 0 or (np.hypot(dx, dy) > radius[done] + radius[k] + gap).all():
                lon[k], lat[k] = x, y
                break
        else:
            raise BergError(
                f"no place is left for berg {n + 1} of {radius.size}", where="Iceberg.field",
                remedy="Take a larger area, fewer bergs, or a smaller gap",
            )  # fmt: skip
    return lon, lat


def _drawn(
    west: float, east: float, south: float, north: float, latlon: bool, random: np.random.Generator
) -> tuple[float, float]:
    """Return a point of a box, each square metre as likely as any other."""
    x, share = west + (east - west) * random.random(), random.random()
    if not latlon:
        return x, south + (north - south) * share
    # The area of a belt grows with the sine of latitude.
    low, high = np.sin(south * DEGREE), np.sin(north * DEGREE)
    return x, float(np.arcsin(low + (high - low) * share) / DEGREE)
