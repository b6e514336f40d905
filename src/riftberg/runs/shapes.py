"""True outlines of elements on a map: squares or hexagons of their size, turned by their rotation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg import constants
from riftberg.parameters import Packing
from riftberg.state import Floats


def corner_offsets(packing: Packing) -> Floats:
    """Return the corners of an element of area 1, shape (corners, 2), metres east and north.

    Squares have sides along the axes. The lattice of hexagons has columns along y, so a hexagon has flat sides in the
    north and south and corners in the east and west.
    """
    if packing == "square":
        return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    angle = np.arange(6) * math.pi / 3.0
    corner = math.sqrt(2.0 / (3.0 * math.sqrt(3.0)))  # distance to a corner of a hexagon of area 1
    return corner * np.column_stack([np.cos(angle), np.sin(angle)])


def element_polygons(
    lon: Floats, lat: Floats, rotation: Floats, area: Floats, packing: Packing, *, latlon: bool, radius: float
) -> NDArray[np.float64]:
    """Return the corners of elements in the units of their positions.

    ``lon``, ``lat``: centres, degrees (metres where ``latlon`` is false) (shape (n,)); ``rotation``: angle turned since
    the start, counter-clockwise, rad (shape (n,)); ``area``: plan areas, m2 (shape (n,)); ``radius``: radius of the
    sphere, m.
    """
    offset = corner_offsets(packing)
    c, s = np.cos(rotation)[:, None], np.sin(rotation)[:, None]
    size = np.sqrt(area)[:, None]
    east = size * (c * offset[:, 0] - s * offset[:, 1])
    north = size * (s * offset[:, 0] + c * offset[:, 1])
    if latlon:
        metres = constants.DEGREE * radius
        north = north / metres
        east = east / (metres * np.cos(np.radians(lat))[:, None])
    return np.stack([lon[:, None] + east, lat[:, None] + north], axis=-1)
