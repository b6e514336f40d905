"""The shape of iceberg A68a on 9 December 2020, as rows of a square lattice of 3 km.

The rows are those of the 472 elements of the published run: Huth, Adcroft, Sergienko and Khan (2022), Science
Advances 8, eabq6974, whose `icebergs.res.nc` (github.com/alex-huth/iKID_iceberg_A68a, b0bfa83) follows from the outline
of 9 December by the rules of equations 10.5. They stand 0.1 degree south of the observed berg there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from riftberg.bergs.iceberg import Iceberg
from riftberg.bergs.lattice import Lattice, along, cells_of_rows, cells_region, fill
from riftberg.bergs.placement import ReferencePlane
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.parameters import Packing
from riftberg.plane import EqualAreaPlane
from riftberg.state import Floats

A68A_RADIUS = 1500.0
"""Radius of the elements of the table, m."""

A68A_ROWS: list[tuple[int, int, int]] = [
    (0, 20, 24), (1, 17, 25), (2, 16, 25), (3, 11, 26), (4, 9, 30), (4, 41, 44), (5, 8, 30), (5, 40, 47), (6, 3, 31),
    (6, 37, 47), (7, 1, 46), (8, 1, 45), (9, 0, 43), (10, 0, 42), (11, 1, 37), (12, 1, 35), (13, 2, 3), (13, 5, 33),
    (14, 5, 30), (15, 10, 24), (16, 10, 21), (17, 13, 13),
]  # fmt: skip
"""(row, first column, last column), rows from south to north, columns from west to east."""

_FIRST_COLUMN, _FIRST_ROW = 10, 12
_WEST, _SOUTH = 319.2578125, -55.7015625
_NORTHWARD = 0.1

Position = Literal["observed", "published"]


def a68a_berg(
    radius: float = A68A_RADIUS,
    packing: Packing = "square",
    *,
    lattice_angle: float = 0.0,
    offset: tuple[float, float] | None = None,
    thickness: Any = 200.0,
    density: float = 850.0,
    velocity: tuple[float, float] = (0.22, 0.0),
    position: Position = "observed",
    conformal: bool = True,
    west: float = -180.0,
) -> Iceberg:
    """Return A68a as it was on 9 December 2020, 13:00.

    ``radius``: radius of the elements, m; ``thickness``, ``density``, ``velocity``: ice thickness (m), density (kg m-3)
    and velocity (m s-1), by default those of the paper.

    Examples
    --------
    >>> len(a68a_berg().elements.id)
    472

    """
    column, row = cells_of_rows(A68A_ROWS)
    region = cells_region(column, row, 2.0 * A68A_RADIUS)
    body = {"thickness": thickness, "packing": packing, "density": density, "velocity": velocity}
    if conformal:
        lon0, lat0 = _centre(column, row, position)
        berg = Iceberg.from_table(
            A68A_ROWS, placement=(_into(lon0, west), lat0), table_radius=A68A_RADIUS, radius=radius,
            lattice_angle=lattice_angle, offset=offset, **body,
        )  # fmt: skip
    else:
        lattice, _ = fill(region, radius, packing, offset, lattice_angle, stretched=False)
        lon, lat = _published_positions(along(lattice), position, column, row)
        berg = Iceberg.from_points(_into(lon, west), lat, radius=radius, **body)
    made = {
        "source": "A68a, 9 December 2020 (Huth et al. 2022)",
        "position": position,
        "outline_area": region.area,
        "area_error": berg.area / region.area - 1.0,
    }
    return replace(berg, report=made)


def _cell_corners(column: Any, row: Any) -> Lattice:
    side = 2.0 * A68A_RADIUS
    return Lattice(side * (column + 0.5), side * (row + 0.5), column, row)


def _published_positions(lattice: Lattice, position: Position, column: Any, row: Any) -> tuple[Floats, Floats]:
    """Longitude (0 to 360) and latitude of plane points by the rules of the published run."""
    lon, lat = _published(lattice)
    if position == "published":
        return lon, lat
    middle = float(_published(_cell_corners(column, row))[0].mean())
    north = lat + _NORTHWARD
    return middle + (lon - middle) * np.cos(lat * DEGREE) / np.cos(north * DEGREE), north


def _centre(column: Any, row: Any, position: Position) -> tuple[float, float]:
    """Point of contact of the tangent plane that gives the elements the mean position of the published ones."""
    table = _cell_corners(column, row)
    lon, lat = (a.mean() for a in _published_positions(table, position, column, row))
    x, y = table.x - table.x.mean(), table.y - table.y.mean()
    # Rows are great circles now, whose ends lie nearer to the equator than the parallel at their middle.
    placed = [a.mean() for a in EqualAreaPlane(lon, lat, EARTH_RADIUS_A68).inverse(x, y)]
    return float(2 * lon - placed[0]), float(2 * lat - placed[1])


def _published(lattice: Lattice) -> tuple[Floats, Floats]:
    side = 2.0 * A68A_RADIUS
    plane = ReferencePlane(_WEST, _SOUTH, 0.0, EARTH_RADIUS_A68)
    return plane.inverse(lattice.x + _FIRST_COLUMN * side, lattice.y + _FIRST_ROW * side)


def _into(lon: Any, west: float) -> Any:
    """Bring longitudes into [west, west + 360)."""
    turns = np.floor((lon - west) / 360.0)
    return lon - 360.0 * turns
