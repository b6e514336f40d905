"""Which elements are bonded: a rule on the distance of their centres, searched on a uniform hash grid.

Source: specification of the dynamics, section 1.3 (and quirk Q14 for the factor 1.25).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.kernels import kernel
from riftberg.parameters import Packing
from riftberg.state import Bonds, Elements, Floats, Ints, new_bonds

RADII_FACTOR = 1.25
"""Elements are bonded when closer than this times the sum of their radii."""

_CELLS_PER_ELEMENT = 4


@dataclass(frozen=True)
class BondRule:
    """When two elements are bonded; both inequalities are strict.

    Attributes
    ----------
    length : float or None
        Bonded when the centres are closer than this, m; None means the rule on radii.
    packing : {"square", "hexagonal"}
        Shape of the elements, which gives their inscribed radius.
    radii_factor : float
        Bonded when closer than this times the sum of the radii.
    """

    length: float | None = None
    packing: Packing = "square"
    radii_factor: float = RADII_FACTOR

    def reaches(self, elements: Elements) -> Floats:
        """Return the reach of each element (m): two are bonded when closer than the sum of their reaches."""
        if self.length is not None:
            return np.full(len(elements.lon), 0.5 * self.length)
        shape = 1.0 / (2.0 * math.sqrt(3.0)) if self.packing == "hexagonal" else 0.25
        radii: Floats = np.sqrt(elements.length * elements.width * shape)
        return self.radii_factor * radii


@dataclass(frozen=True)
class Metric:
    """How differences of position become metres (specification, section 2.2).

    Attributes
    ----------
    latlon : bool
        Positions in degrees; otherwise metres.
    radius : float
        Radius of the sphere, m.
    period : float
        Zonal period in units of the positions; 0 or less where there is none.
    """

    latlon: bool
    radius: float = 1.0
    period: float = -1.0


def form_bonds(elements: Elements, rule: BondRule, metric: Metric) -> Bonds:
    """Bond all pairs of elements that the rule joins.

    Distances use the metric of the mean latitude of the pair, and the nearest image in a periodic domain.

    Parameters
    ----------
    elements : Elements
        Their ``lon``, ``lat``, ``length`` and ``width`` are read; ``bond_count`` is set.
    rule : BondRule
        When two elements are bonded.
    metric : Metric
        Coordinates.

    Returns
    -------
    Bonds
        Each pair once, ``first < second`` (rows), sorted; unstressed, with their present length.
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


def separation(metric: Metric, lon_a: Floats, lat_a: Floats, lon_b: Floats, lat_b: Floats) -> tuple[Floats, Floats]:
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
    column, row, columns, rows, wraps = _hash_cells(elements, 2.0 * float(reaches.max()), metric)
    order = np.lexsort((np.arange(size), column, row))
    starts = np.searchsorted((row * columns + column)[order], np.arange(columns * rows + 1))
    pairs = np.zeros((size * 8, 2), dtype=np.int64)
    arguments = (column, row, columns, rows, wraps, order, starts)
    scale = (metric.latlon, metric.radius, metric.period)
    count = _search(elements.lon, elements.lat, reaches, *arguments, *scale, pairs)
    if count > len(pairs):
        pairs = np.zeros((count, 2), dtype=np.int64)
        _search(elements.lon, elements.lat, reaches, *arguments, *scale, pairs)
    pairs = pairs[:count]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    first, second = pairs[:, 0].copy(), pairs[:, 1].copy()
    lon, lat = elements.lon, elements.lat
    dx, dy = separation(metric, lon[first], lat[first], lon[second], lat[second])
    return first, second, np.sqrt(dx * dx + dy * dy)


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


def _hash_cells(elements: Elements, reach: float, metric: Metric) -> tuple[Ints, Ints, int, int, bool]:
    """Return column and row of each element, the numbers of columns and rows, and whether columns wrap around.

    Cells are at least one reach wide everywhere, so partners lie in the same or in neighbouring cells.
    """
    size = len(elements.lon)
    reach *= 1.0 + 1e-9  # round-off must not put partners two cells apart
    width, height = reach, reach
    if metric.latlon:
        height = reach / (metric.radius * DEGREE)
        polar = max(float(np.abs(elements.lat).max()) + height, 0.0)
        width = height / max(math.cos(min(polar, 90.0) * DEGREE), 1e-12)
    wraps = metric.period > 0
    west, south = float(elements.lon.min()), float(elements.lat.min())
    span = metric.period if wraps else float(elements.lon.max()) - west
    limit = max(_CELLS_PER_ELEMENT * size, 16)
    rows = _number_of_cells(float(elements.lat.max()) - south, height, limit)
    columns = _number_of_cells(span, width, max(limit // rows, 1))
    x = np.mod(elements.lon - west, metric.period) if wraps else elements.lon - west
    column = _cell_numbers(x, span, columns)
    row = _cell_numbers(elements.lat - south, float(elements.lat.max()) - south, rows)
    return column, row, columns, rows, wraps


def _number_of_cells(span: float, width: float, limit: int) -> int:
    return int(min(max(math.floor(span / width), 1), limit))


def _cell_numbers(offset: Floats, span: float, number: int) -> Ints:
    if number == 1:
        return np.zeros(len(offset), dtype=np.int64)
    return np.clip(np.floor(offset * (number / span)), 0, number - 1).astype(np.int64)


@kernel
def _search(
    lon: Any,
    lat: Any,
    reaches: Any,
    column: Any,
    row: Any,
    columns: Any,
    rows: Any,
    wraps: Any,
    order: Any,
    starts: Any,
    latlon: Any,
    radius: Any,
    period: Any,
    pairs: Any,
) -> Any:
    count = 0
    for a in range(lon.size):
        for r in range(max(row[a] - 1, 0), min(row[a] + 2, rows)):
            for shift in range(-1, 2):
                c = column[a] + shift
                if wraps:
                    # With few columns a neighbour would be met twice.
                    if (columns == 1 and shift != 0) or (columns == 2 and shift == 1):
                        continue
                    c = (c + columns) % columns
                elif c < 0 or c >= columns:
                    continue
                for k in range(starts[r * columns + c], starts[r * columns + c + 1]):
                    b = order[k]
                    if b <= a:
                        continue
                    dx = lon[a] - lon[b]
                    dy = lat[a] - lat[b]
                    if wraps and abs(dx) > 0.5 * period:
                        dx -= period * round(dx / period)
                    if latlon:
                        dx *= DEGREE * radius * math.cos(0.5 * (lat[a] + lat[b]) * DEGREE)
                        dy *= DEGREE * radius
                    if math.sqrt(dx * dx + dy * dy) < reaches[a] + reaches[b]:
                        if count < pairs.shape[0]:
                            pairs[count, 0] = a
                            pairs[count, 1] = b
                        count += 1
    return count
