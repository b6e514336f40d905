"""Which elements are bonded: a rule on the distance of their centres, among the pairs that `riftberg.state.neighbours` finds.

Source: equations 1.3 (and quirk Q14 for the factor 1.25).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.state import Bonds, Elements, Floats, Ints, new_bonds
from riftberg.state.neighbours import ANY, find_pairs

RADII_FACTOR = 1.25
"""Elements are bonded when closer than this times the sum of their radii."""

SEARCH_MARGIN = 1e-3
"""Part by which candidates are searched farther than bonds reach."""


@dataclass(frozen=True)
class BondRule:
    """When two elements are bonded; both inequalities are strict."""

    length: float | None = None  # Bonded when the centres are closer than this, m; None means the rule on radii
    packing: Packing = "square"  # Shape of the elements, which gives their inscribed radius
    radii_factor: float = RADII_FACTOR  # Bonded when closer than this times the sum of the radii

    def reaches(self, elements: Elements) -> Floats:
        """Return the reach of each element (m): two are bonded when closer than the sum of their reaches."""
        if self.length is not None:
            return np.full(len(elements.lon), 0.5 * self.length)
        radii: Floats = np.sqrt(elements.length * elements.width * inscribed_share(elements, self.packing))
        return self.radii_factor * radii


@dataclass(frozen=True)
class Metric:
    """How differences of position become metres (equations 2.2)."""

    latlon: bool  # Positions in degrees; otherwise metres
    radius: float = 1.0  # Radius of the sphere, m
    period: float = -1.0  # Zonal period in units of the positions; 0 or less where there is none


def inscribed_share(elements: Elements, packing: Packing) -> Floats:
    """Square of the radius of the inscribed circle over the area, of each element; ``packing`` counts where none is said."""
    sides = np.where(elements.body.sides == 0, 6 if packing == "hexagonal" else 4, elements.body.sides)
    return np.where(sides == 6, 1.0 / (2.0 * math.sqrt(3.0)), 0.25)


def form_bonds(elements: Elements, rule: BondRule, metric: Metric) -> Bonds:
    """Bond all pairs of elements that the rule joins.

    Distances use the metric of the mean latitude of the pair, and the nearest image in a periodic domain.
    """
    first, second, distance = _pairs(elements, rule.reaches(elements), metric)
    bonds = new_bonds(first, second)
    bonds.bond_length[:] = distance
    count_bonds(elements, bonds)
    return bonds


def count_bonds(elements: Elements, bonds: Bonds) -> None:
    """Set ``bond_count`` of the elements from the unbroken bonds."""
    unbroken = bonds.status == 0
    ends = np.concatenate([bonds.first[unbroken], bonds.second[unbroken]])
    elements.bond_count[:] = np.bincount(ends, minlength=len(elements.id))


def separations(metric: Metric, lon_a: Floats, lat_a: Floats, lon_b: Floats, lat_b: Floats) -> tuple[Floats, Floats]:
    """Return eastward and northward metres from points b to points a, with the metric of the mean latitude."""
    dx, dy = lon_a - lon_b, lat_a - lat_b
    if metric.period > 0:
        dx = np.where(np.abs(dx) > 0.5 * metric.period, dx - metric.period * np.round(dx / metric.period), dx)
    if not metric.latlon:
        return dx, dy
    mean = 0.5 * (lat_a + lat_b)
    return dx * (DEGREE * metric.radius * np.cos(mean * DEGREE)), dy * (DEGREE * metric.radius)


def _pairs(elements: Elements, reaches: Floats, metric: Metric) -> tuple[Ints, Ints, Floats]:
    """Return rows of bonded pairs, sorted, and their distances."""
    size = len(elements.lon)
    if size < 2 or reaches.max() <= 0.0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    _check_reaches(elements, reaches)
    # The search measures distances with a fast cosine; a margin keeps all that the exact distance below may join.
    reach = 2.0 * float(reaches.max()) * (1.0 + SEARCH_MARGIN)
    lon, lat = elements.place.lon, elements.place.lat
    near = find_pairs(lon, lat, elements.body.berg, reach, ANY, metric.latlon, metric.radius, metric.period)
    first, second = np.repeat(np.arange(size), np.diff(near.start)), near.partner
    once = first < second
    first, second = first[once], second[once]
    dx, dy = separations(metric, lon[first], lat[first], lon[second], lat[second])
    distance = np.sqrt(dx * dx + dy * dy)
    joined = distance < reaches[first] + reaches[second]
    return first[joined], second[joined], distance[joined]


def _check_reaches(elements: Elements, reaches: Floats) -> None:
    bad = ~(np.isfinite(elements.lon) & np.isfinite(elements.lat) & np.isfinite(reaches))
    if bad.any():
        k = int(np.argmax(bad))
        raise BergError(
            f"position ({elements.lon[k]}, {elements.lat[k]}) or size {elements.length[k]} x {elements.width[k]} "
            "is no number",
            where=f"element {elements.id[k]}",
            remedy="Bonds need finite positions and sizes",
        )
