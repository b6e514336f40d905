"""Square and hexagonal packing of a plane region with equal elements.

Files 8.2: positions are relative to the lower-left corner of the region; the first column stands
half an element inside. Coordinates are metres in a plane; `riftberg.bergs.regions` brings them to the sphere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.physics.elementary import cos, sin
from riftberg.state import Floats, Ints
from riftberg.system.input_files import check_elements

Booleans = NDArray[np.bool_]

OFFSETS_TRIED = 5
"""Shifts of the lattice tried along each axis when the best fit to an outline is sought."""


@dataclass(frozen=True)
class Region:
    """A plane figure to be filled."""

    bounds: tuple[float, float, float, float]  # x_min, y_min, x_max, y_max in m
    area: float  # Area in m2
    centroid: tuple[float, float]  # x and y in m
    # Takes arrays x, y (m) and returns whether each point lies in the figure
    inside: Callable[[Floats, Floats], Booleans]
    # Takes arrays x, y (m) of points of the figure and returns numbers of the separate pieces in which they lie, from
    # 1; None where the figure is one piece
    piece: Callable[[Floats, Floats], Ints] | None = None
    pieces: int = 1  # Number of separate pieces

    def piece_numbers(self, lattice: Lattice) -> Ints | None:
        """Return the number of the piece of each point of a lattice, None where there is one piece."""
        return None if self.piece is None or self.pieces == 1 else self.piece(lattice.x, lattice.y)


@dataclass(frozen=True)
class Lattice:
    """Centres of elements in a plane."""

    x: Floats  # Positions in m
    y: Floats  # Positions in m
    column: Ints  # Place in the lattice, from 0
    row: Ints  # Place in the lattice, from 0

    def __len__(self) -> int:
        """Return the number of elements."""
        return len(self.x)

    def where(self, chosen: Booleans | Ints) -> Lattice:
        """Return the chosen elements, in the order given."""
        return Lattice(self.x[chosen], self.y[chosen], self.column[chosen], self.row[chosen])


def element_area(radius: float, packing: Packing) -> float:
    """Plan area (m2) of an element whose inscribed circle has this radius (m); equations 8.2.

    Examples
    --------
    >>> element_area(1500.0, "square")
    9000000.0

    """
    return 2.0 * math.sqrt(3.0) * radius**2 if packing == "hexagonal" else (2.0 * radius) ** 2


def pitch(radius: float, packing: Packing) -> tuple[float, float]:
    """Distance (m) between columns and between the elements of a column."""
    return (math.sqrt(3.0) * radius if packing == "hexagonal" else 2.0 * radius), 2.0 * radius


def lattice_points(
    bounds: tuple[float, float, float, float],
    radius: float,
    packing: Packing,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Lattice:
    """Return all lattice points strictly inside a rectangle, column by column from the lower-left corner.

    ``bounds``: x_min, y_min, x_max, y_max in m; ``radius``: radius of the inscribed circle of an element, m.
    """
    x0, y0, x1, y1 = bounds
    dx, dy = pitch(radius, packing)
    # From before the corner, since an offset or the slant of a hexagonal lattice may bring such a point inside.
    columns = np.arange(-1, math.ceil((x1 - x0) / dx) + 1)
    rows = np.arange(-2, math.ceil((y1 - y0) / dy) + 1)
    column, row = (a.ravel() for a in np.meshgrid(columns, rows, indexing="ij"))
    first_x = 2.0 / math.sqrt(3.0) * radius if packing == "hexagonal" else radius
    x = first_x + column * dx + offset[0] * dx
    y = radius + row * dy + offset[1] * dy
    if packing == "hexagonal":
        # Every other column of a hexagonal lattice stands half an element higher.
        y = y + (column % 2) * radius
    inside = (x > 0) & (x < x1 - x0) & (y > 0) & (y < y1 - y0)
    positions = (np.asarray(x0 + x, np.float64), np.asarray(y0 + y, np.float64))
    return Lattice(*positions, column.astype(np.int64), row.astype(np.int64)).where(inside)


def fill(
    region: Region, radius: float, packing: Packing, offset: tuple[float, float] | None = None, angle: float = 0.0
) -> tuple[Lattice, float]:
    """Fill a region with the elements whose centres lie in it, and with its area.

    The lattice is turned by ``angle`` (degrees, counter-clockwise), shifted by ``offset`` (parts of its pitch; by default the
    shift that fits best), and stretched until the area of the elements equals the region. Returns the lattice and the
    radius (m) of its elements, which is ``radius`` where that fits already.
    """
    if not radius > 0 or not math.isfinite(radius):
        raise BergError(f"radius is {radius} m", remedy="Give a positive radius in metres, for example 1500")
    # Elements, or places in their box, that are too many are refused before any is made.
    x0, y0, x1, y1 = region.bounds
    size = element_area(radius, packing)
    if not (math.isfinite(region.area) and size > 0.0 and math.isfinite((x1 - x0) * (y1 - y0))):
        raise BergError(
            f"an area of {region.area:g} m2 for elements of {size:g} m2",
            remedy="Give a finite outline and a radius in metres, for example 1500",
        )
    check_elements(region.area / size, kind=BergError)
    check_elements((x1 - x0) * (y1 - y0) / size / _SPARSE, kind=BergError)
    fractions = [k / OFFSETS_TRIED for k in range(OFFSETS_TRIED)]
    tried = [(a, b) for a in fractions for b in fractions] if offset is None else [offset]
    fits: list[tuple[float, int]] = []
    for k, shift in enumerate(tried):  # one lattice at a time: of a million elements all of them would take 800 MB
        lattice = _fill_region(region, radius, packing, shift, angle)
        if len(lattice):
            # Equal fits keep the first shift.
            fits.append((round(_misfit(lattice, region, radius, packing), 9), k))
    element_size = element_area(radius, packing)
    if not fits or region.area < element_size:
        x0, y0, x1, y1 = region.bounds
        fault, wide = f"is smaller than one element ({element_size / 1e6:.4g} km2)", math.sqrt(region.area)
        if region.area >= element_size:
            fault, wide = "is too narrow for one element", region.area / math.hypot(x1 - x0, y1 - y0)
        raise BergError(
            f"the outline ({region.area / 1e6:.4g} km2) {fault}", remedy=f"Give a radius below {0.2 * wide:.3g} m"
        )
    # All shifts of a small lattice are stretched, the three that fit best of a large one.
    most = max(3, int(MOST_STRETCHED * element_size / region.area))
    stretched = [_stretch_to_area(region, radius, packing, tried[k], angle) for _, k in sorted(fits)[:most]]
    lattice, fitted_radius = min(stretched, key=lambda fit: round(_misfit(fit[0], region, fit[1], packing), 9))
    return along(lattice), fitted_radius


LONGEST_LONE = 3.0
"""Greatest extent of a region that one element may stand for, in sides of a square of its area."""


def is_lone(region: Region, radius: float, packing: Packing) -> bool:
    """Return whether a region is smaller than an element, and of a shape that one element can stand for."""
    x0, y0, x1, y1 = region.bounds
    compact = math.hypot(x1 - x0, y1 - y0) <= math.sqrt(2.0) * LONGEST_LONE * math.sqrt(region.area)
    return region.pieces == 1 and compact and region.area < element_area(radius, packing)


def lone_element(region: Region, packing: Packing) -> tuple[Lattice, float]:
    """Return one element at the centroid of a region, and the radius (m) with which it has the region's area."""
    x, y = (np.array([coordinate]) for coordinate in region.centroid)
    cell = np.zeros(1, np.int64)
    return Lattice(x, y, cell, cell), math.sqrt(region.area / element_area(1.0, packing))


def _fill_region(region: Region, radius: float, packing: Packing, shift: tuple[float, float], angle: float) -> Lattice:
    """Return the lattice points in a region, the lattice turned by an angle (degrees) about the middle of its box."""
    if angle == 0.0:
        lattice = lattice_points(region.bounds, radius, packing, shift)
    else:
        x0, y0, x1, y1 = region.bounds
        x, y, c, s = 0.5 * (x0 + x1), 0.5 * (y0 + y1), cos(math.radians(angle)), sin(math.radians(angle))
        # The box of the region as the turned lattice sees it.
        wide, high = 0.5 * (abs(c) * (x1 - x0) + abs(s) * (y1 - y0)), 0.5 * (abs(s) * (x1 - x0) + abs(c) * (y1 - y0))
        turned = lattice_points((-wide, -high, wide, high), radius, packing, shift)
        lattice = replace(turned, x=x + c * turned.x - s * turned.y, y=y + s * turned.x + c * turned.y)
    return lattice.where(region.inside(lattice.x, lattice.y))


MOST_STRETCHED = 100_000
"""Elements of all shifts together that are stretched to the area of the outline before the best is chosen."""

MOST_STRETCH = 0.1
"""Part by which the distance of elements may be changed so that they have the area of the outline."""

STRETCH_STEP = 0.005
"""Part by which it is changed at first, until the area changes from too large to too small or back."""


def _stretch_to_area(
    region: Region, radius: float, packing: Packing, shift: tuple[float, float], angle: float
) -> tuple[Lattice, float]:
    """Return the lattice whose elements have the area of the region, and their radius, the nearest to ``radius`` (m).

    Area over radius is a saw: it grows as elements grow, and drops where one leaves the outline. Between a radius with too small
    and one with too large an area bisection therefore ends on a slope, where the number of elements gives the radius. Where
    none is found (an outline one or two elements wide), the lattice stays unchanged.
    """

    def excess(count: int, r: float) -> float:
        return count * element_area(r, packing) / region.area - 1.0

    lattice = _fill_region(region, radius, packing, shift, angle)
    start = excess(len(lattice), radius)
    if abs(start) < 1e-9:
        return lattice, radius
    inner, many, step = radius, len(lattice), -STRETCH_STEP if start > 0.0 else STRETCH_STEP
    # Step by step first: area over radius is a saw, and bisection from far away would end at another tooth.
    for k in range(1, round(MOST_STRETCH / STRETCH_STEP) + 1):
        outer = radius * (1.0 + k * step)
        few = len(_fill_region(region, outer, packing, shift, angle))
        if (excess(few, outer) > 0.0) != (start > 0.0):
            break
        inner, many = outer, few
    else:
        return lattice, radius
    # Forty halvings of a step of 0.5 % leave a ten thousand millionth of the radius.
    for _ in range(40):
        if many == few:
            fitting = math.sqrt(region.area / (many * element_area(1.0, packing)))
            fitted = _fill_region(region, fitting, packing, shift, angle)
            # Between two teeth the number of elements stays, and the radius follows from the area.
            if len(fitted) == many:
                return fitted, fitting
        middle = 0.5 * (inner + outer)
        count = len(_fill_region(region, middle, packing, shift, angle))
        if (excess(count, middle) > 0.0) == (start > 0.0):
            inner, many = middle, count
        else:
            outer, few = middle, count
    return lattice, radius


_SPARSE = 50
"""How many times as many places as elements may be looked at: a region may fill little of its box."""


def _misfit(lattice: Lattice, region: Region, radius: float, packing: Packing) -> float:
    """Relative error of the area plus distance of the centroids relative to the size of the region."""
    area = element_area(radius, packing)
    off_centre = math.hypot(lattice.x.mean() - region.centroid[0], lattice.y.mean() - region.centroid[1])
    return abs(len(lattice) * area / region.area - 1.0) + off_centre / math.sqrt(region.area)


def along(lattice: Lattice) -> Lattice:
    """Sort elements so that bonded neighbours are close in memory: across the short side first."""
    wide = np.ptp(lattice.x) >= np.ptp(lattice.y)
    # Bonded neighbours are then at most one short side apart, and lie in the cache together.
    order = np.lexsort((lattice.row, lattice.column) if wide else (lattice.column, lattice.row))
    return lattice.where(order)


def rectangle_region(length: float, width: float) -> Region:
    """Rectangle of ``length`` along x and ``width`` along y (m), centred on the origin."""
    bounds = (-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width)
    return Region(bounds, length * width, (0.0, 0.0), lambda x, y: (abs(x) < 0.5 * length) & (abs(y) < 0.5 * width))


def cells_region(column: Ints, row: Ints, side: float) -> Region:
    """Union of square cells, for example the elements of another square lattice.

    ``side``: side of a cell, m.
    """
    filled = np.zeros((column.max() + 1, row.max() + 1), dtype=bool)
    filled[column, row] = True

    def inside(x: Floats, y: Floats) -> Booleans:
        i = np.clip(np.floor(x / side).astype(np.int64), -1, filled.shape[0])
        j = np.clip(np.floor(y / side).astype(np.int64), -1, filled.shape[1])
        # A rim of empty cells: indices beyond the table, clipped to it, find nothing there.
        padded = np.pad(filled, 1)
        is_filled: Booleans = padded[i + 1, j + 1]
        return is_filled

    bounds = (0.0, 0.0, side * filled.shape[0], side * filled.shape[1])
    centroid = (side * (float(column.mean()) + 0.5), side * (float(row.mean()) + 0.5))
    return Region(bounds, float(filled.sum()) * side**2, centroid, inside)


def expand_rows(rows: list[tuple[int, int, int]]) -> tuple[Ints, Ints]:
    """Expand lattice rows (row, first column, last column) to the columns and rows of the cells.

    A row may occur several times (a notch or a hole splits it).
    """
    if not rows:
        raise BergError("no rows", where="table of rows", remedy="Write (row, first column, last column) for each row")
    for row, first, last in rows:
        if first > last or min(row, first) < 0:
            raise BergError(
                f"row {row} runs from column {first} to {last}",
                where="table of rows",
                remedy="Write (row, first column, last column) with 0 <= first <= last",
            )
    check_elements(sum(last - first + 1 for _, first, last in rows), where="table of rows", kind=BergError)
    # The table of cells is as large as its box; a single far entry would ask for gigabytes.
    box = (1 + max(last for _, _, last in rows)) * (1 + max(row for row, _, _ in rows))
    check_elements(box / _SPARSE, where="table of rows", kind=BergError)
    column = np.concatenate([np.arange(first, last + 1) for _, first, last in rows])
    row_of = np.concatenate([np.full(last - first + 1, row) for row, first, last in rows])
    pairs = np.stack([column, row_of], axis=1)
    if len(np.unique(pairs, axis=0)) != len(pairs):
        raise BergError(
            "two entries cover the same cell", where="table of rows", remedy="Let the runs of a row not overlap"
        )
    return column.astype(np.int64), row_of.astype(np.int64)
