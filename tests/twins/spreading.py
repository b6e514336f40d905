"""Twin of the spreading on ocean cells: polygons of shapely, and the reference's rules written out (files 4)."""

from __future__ import annotations

import numpy as np
from shapely.geometry import Polygon, box

WIDE = 1e3
"""Half a side of the squares that stand for quadrants."""


def corners(shape, length, width, angle):
    """Corners of a rectangle or a hexagon with one flat side across its axis."""
    if shape == "rectangle":
        points = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [0.5 * length, 0.5 * width]
    else:
        apothem = np.sqrt(length * width / (2 * np.sqrt(3)))
        turns = np.pi / 6 + np.pi / 3 * np.arange(6)
        points = 2 * apothem / np.sqrt(3) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def shares(centre, points, cells, wet):
    """Shares of a footprint by number of cell: areas in common over the wet area in common; ``cells`` are 4 x 2 corners."""
    polygon = Polygon(points + np.asarray(centre))
    areas = np.array([polygon.intersection(Polygon(c)).area if w else 0.0 for c, w in zip(cells, wet)])
    return areas / areas.sum()


def rectangle_shares(x, y, reach, mask):
    """Nine shares as a 3 x 3 array [row, column]; ``mask`` likewise."""

    def along(q):
        low = min(0.5, max(0.0, 0.5 - q / reach))
        high = min(0.5, max(0.0, q / reach + 0.5 - 1 / reach))
        return np.array([low, max(0.0, 1 - low - high), high])

    w = np.outer(along(y), along(x)) * mask
    w[1, 1] = 0.0
    w[1, 1] = 1.0 - w.sum()
    return w


def hexagon(apothem, x, y, degrees):
    """Hexagon with corners on its axis, turned clockwise."""
    turns = np.pi / 3 * np.arange(6) - np.radians(degrees)
    return Polygon(2 * apothem / np.sqrt(3) * np.stack([np.cos(turns), np.sin(turns)], axis=1) + [x, y])


def quadrants(apothem, x, y, degrees):
    """Areas in the four quadrants and the whole."""
    shape = hexagon(apothem, x, y, degrees)
    boxes = [box(0, 0, WIDE, WIDE), box(-WIDE, 0, 0, WIDE), box(-WIDE, -WIDE, 0, 0), box(0, -WIDE, WIDE, 0)]
    return [*(shape.intersection(b).area for b in boxes), shape.area]


def hexagon_shares(x, y, apothem, degrees):
    """Nine shares as a 3 x 3 array, by the areas in the cells around."""
    shape = hexagon(apothem, x, y, degrees)
    return np.array(
        [[shape.intersection(box(i, j, i + 1, j + 1)).area / shape.area for i in (-1, 0, 1)] for j in (-1, 0, 1)]
    )
