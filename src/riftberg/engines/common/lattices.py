"""Which elements form a lattice, and the ice that it fills on a plane of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.bergs.seams import shrink
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.parameters import KernelParameters
from riftberg.physics.elementary import atan2, cos, cos_array, sin_array
from riftberg.physics.geometry import nearest_image
from riftberg.plane import ConformalPlane
from riftberg.state import Bonds, Elements, Floats, Ints

DISC = 0.2
"""Part of its radius by which the ice reaches beyond the centre of a cell at least, also where the outline does not."""


def outline_cells(xy: Floats, radius: float, packing: str, angle: float) -> shapely.Polygon:
    """Union of the cells themselves (m), for a piece whose outline is not known.

    ``radius``: of the inscribed circle, m; ``angle``: of the direction in which cells touch, rad.
    """
    sides = 6 if packing == "hexagonal" else 4
    corner = angle + (np.arange(sides) + 0.5) * (2.0 * math.pi / sides)
    # Cells reach over their sides at first: those of a lattice in degrees do not fit exactly, for meridians converge.
    over = 0.05 * radius
    ring = (radius + over) / cos(math.pi / sides) * np.column_stack([cos_array(corner), sin_array(corner)])
    return shrink(shapely.unary_union(shapely.polygons(xy[:, None, :] + ring)), over)


def lattices(el: Elements, bonds: Bonds, new: NDArray[np.bool_], outlines: Sequence[Any]) -> list[tuple[Ints, Any]]:
    """Return the rows of each lattice that has ``new`` elements, and the outline that it fills; None where none is known."""
    # An outline holds its elements, bonded or not; all others hang together by bonds, also by those that have broken.
    group = connected_parts(el.size, bonds.first, bonds.second, np.zeros(bonds.first.size, np.int64))
    ring: dict[int, Any] = {}
    rows = np.flatnonzero(new)
    for outline in outlines:
        inside = rows[shapely.contains_xy(outline, el.lon[rows], el.lat[rows])]
        if inside.size:
            joins = np.isin(group, group[inside])
            group[joins] = group[inside[0]]
            ring[int(group[inside[0]])] = outline
    order = np.argsort(group, kind="stable")
    numbers, begin = np.unique(group[order], return_index=True)
    of = dict(zip(numbers.tolist(), np.split(order, begin[1:]), strict=True))
    return [(of[number], ring.get(number)) for number in dict.fromkeys(group[rows].tolist())]


def laid_flat(el: Elements, rows: Ints, p: KernelParameters) -> tuple[ConformalPlane, Floats]:
    """Return a plane at the first of some elements, and their places (m) on it."""
    lon, lat = el.lon[rows].copy(), el.lat[rows]
    if not p.latlon:
        lon = np.array([lon[0] + nearest_image(x - lon[0], p.period) for x in lon])
    plane = ConformalPlane(float(lon[0]), float(lat[0]), p.earth_radius, p.latlon)
    return plane, np.column_stack(plane.forward(lon, lat))


def ice_on_plane(
    plane: ConformalPlane, xy: Floats, radius: Floats, outline: Any, along: Floats, *, hexagonal: bool
) -> Any:
    """Return the ice (shapely) of a lattice on its plane: its outline, or the cells themselves where none is known.

    ``along``: from a cell to a neighbour, m.
    """
    if outline is None:
        angle = atan2(along[1], along[0])
        return outline_cells(xy, float(radius.mean()), "hexagonal" if hexagonal else "square", angle)
    ice = shapely.transform(outline, plane.forward, interleaved=False)
    discs = shapely.buffer(shapely.points(xy), DISC * radius, quad_segs=2)
    outside = ~shapely.covers(ice, discs)
    return shapely.unary_union([ice, *discs[outside]])
