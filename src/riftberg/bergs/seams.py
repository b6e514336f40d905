"""Seams along which outlines were cut, at 180 degrees or at the edge of a tile, and the whole shapes without them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats, Ints

METRE: Final = 360.0 / 4.003e7
"""Degrees of latitude. Outlines that run along each other within this distance share an edge."""

ASKEW: Final = (math.cos(1.0), math.sin(1.0))
"""A direction in which no two points of a lattice lie at one distance."""

SHORTEST: Final = 20.0
"""Length (m) of an edge; polygons that run along each other over less touch at a corner."""


def whole_shapes(polygons: Sequence[Any], *, along_meridian: bool = False) -> list[tuple[list[int], Any]]:
    """Return the shapes that polygons make up, each with the rows of its polygons: those that share an edge or ice are one.

    Polygons may lie a turn of the globe apart; a shape has the longitudes of its first one.

    ``polygons``: shapely, degrees; ``along_meridian``: whether edges in other directions do not count.
    """
    narrow = max(math.cos(math.radians(float(np.mean(shapely.bounds(polygons)[:, 1::2])))), 1e-3)
    every = [*polygons, *(_turn_east(polygon, 1) for polygon in polygons)]
    flat = [shapely.transform(polygon, lambda lonlat: lonlat * (narrow, 1.0)) for polygon in every]
    count, valid = len(polygons), shapely.is_valid(flat)
    beside: list[list[tuple[int, int]]] = [[] for _ in polygons]  # rows and turns of those that share an edge
    for i, k in shapely.STRtree(flat).query(flat[:count], "dwithin", METRE).T.tolist():
        turns, j = divmod(k, count)
        if i != j and valid[i] and valid[j] and _share_an_edge(flat[i], flat[k], along_meridian):
            beside[i].append((j, turns))
            beside[j].append((i, -turns))
    turn: dict[int, int] = {}
    shapes = []
    for root in range(count):
        if root in turn:
            continue
        turn[root], members, shape = 0, [root], polygons[root]
        for i in members:  # which grow
            for j, turns in beside[i]:
                if j not in turn:
                    turn[j] = turn[i] + turns
                    members.append(j)
                    shape = _close_gaps(shapely.union(shape, _turn_east(polygons[j], turn[j])), narrow)
        shapes.append((members, shape))
    return shapes


TALLEST: Final = 20.0
"""Degrees of latitude, or as long along a parallel, that no berg spans; the longest ever seen had 3."""


NO_BERG: Final = "No berg is like that: look for a missing sign, or swapped longitude and latitude"


def ring_fault(ring: Any) -> str:
    """Return why no berg can have an outline (longitude and latitude, shape (n, 2)), empty where one can."""
    lon, lat = np.asarray(ring, float)[:, :2].T
    steps = np.diff(lon, append=lon[:1])
    path = np.unwrap(lon, period=360.0)  # whole also where longitudes jump at the date line
    if abs(((steps + 180.0) % 360.0 - 180.0).sum()) > 180.0 or np.abs(steps).max() > 359.999:
        return "an outline around a pole"
    if np.ptp(lat) > TALLEST:
        return f"an outline over {np.ptp(lat):.3g} degrees of latitude, from {lat.min():g} to {lat.max():g}"
    if np.ptp(path) * math.cos(math.radians(lat.mean())) > TALLEST:
        return f"an outline over {np.ptp(path):.3g} degrees of longitude, from {path.min():g} to {path.max():g}"
    if len(np.unique(ring, axis=0)) < 3:
        return f"an outline of {len(np.unique(ring, axis=0))} points"
    return (
        "an outline of no area" if shapely.make_valid(shapely.Polygon(np.stack([path, lat], 1))).area < METRE**2 else ""
    )


def _turn_east(polygon: Any, turns: int) -> Any:
    """Return a polygon some turns of the globe further east."""
    return shapely.transform(polygon, lambda lonlat: lonlat + np.array([360.0 * turns, 0.0])) if turns else polygon


def _share_an_edge(first: Any, second: Any, along_meridian: bool) -> bool:
    """Whether two polygons, on axes of equal scale, run along each other, or lie across each other as badly cut ones do."""
    if not along_meridian and shapely.overlaps(first, second) and shapely.intersection(first, second).area > METRE**2:
        return True
    (west, south), (east, north) = (
        np.maximum(first.bounds[:2], second.bounds[:2]),
        np.minimum(first.bounds[2:], second.bounds[2:]),
    )
    box = west - 2 * METRE, south - 2 * METRE, east + 2 * METRE, north + 2 * METRE
    first_edge, second_edge = (shapely.clip_by_rect(polygon.boundary, *box) for polygon in (first, second))
    seam = shapely.intersection(second_edge, shapely.buffer(first_edge, METRE))
    if seam.length < SHORTEST * METRE:
        return False
    return not along_meridian or seam.bounds[2] - seam.bounds[0] < 4.0 * METRE


def _close_gaps(shape: Any, narrow: float) -> Any:
    """Return a shape without the gaps that the ends of cuts leave where they differ in their last digits."""
    slit = shape.geom_type != "Polygon" or any(
        shapely.Polygon(hole).area < METRE * hole.length for hole in shape.interiors
    )
    if not slit:
        return shape
    flat = shapely.transform(shape, lambda lonlat: lonlat * (narrow, 1.0))
    filled = join_polygons([flat], METRE)
    return shapely.transform(filled, lambda lonlat: lonlat / (narrow, 1.0))


def join_polygons(polygons: Any, seam: float) -> Any:
    """Return the union of polygons (shapely), without the gaps between them that are narrower than twice ``seam``."""
    simple = (shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON) & (
        shapely.get_num_interior_rings(polygons) == 0
    )
    if len(polygons) > 1 and simple.all():
        corner, polygon = shapely.get_coordinates(shapely.orient_polygons(polygons), return_index=True)
        if (tiled := join_tiles(corner, polygon, seam)) is not None:
            return tiled
    return shrink(shapely.union_all(shapely.buffer(polygons, seam, join_style="mitre")), seam)


def join_tiles(corner: Floats, polygon: Ints, seam: float) -> Any | None:
    """Return the union of polygons that lie side by side, from the edges that no two of them share; None where some overlap.

    A general union looks for crossings of all edges, and takes twenty times as long.

    Parameters
    ----------
    corner : ndarray
        Corners of each polygon, anticlockwise and the first one at the end again; shape (corners, 2).
    polygon : ndarray
        To which polygon they belong; shape (corners,).
    seam : float
        Corners within this distance of each other are one.
    """
    order = np.argsort(ASKEW[0] * corner[:, 0] + ASKEW[1] * corner[:, 1])
    node = np.unique(_join_corners(corner, order, seam), return_inverse=True)[1]
    points = int(node.max()) + 1
    point = np.empty((points, 2))
    point[node] = corner
    follows = polygon[1:] == polygon[:-1]
    rim = _unshared_edges(np.column_stack([node[:-1], node[1:]])[follows], points)

    # A corner within an edge of a neighbour divides it.
    ends = np.unique(rim)
    edge, at = shapely.STRtree(shapely.points(point[ends])).query(shapely.linestrings(point[rim]), "dwithin", seam)
    at = ends[at]
    along = point[rim[edge, 1]] - point[rim[edge, 0]]
    share = ((point[at] - point[rim[edge, 0]]) * along).sum(axis=1) / (along**2).sum(axis=1)
    order = np.lexsort((share, edge))
    edge, at = edge[order], at[order]
    rim = _unshared_edges(np.column_stack([at[:-1], at[1:]])[edge[1:] == edge[:-1]], points)

    # In one order of corners and rings, which the library does not promise.
    joined = shapely.normalize(shapely.build_area(shapely.multilinestrings(shapely.linestrings(point[rim]))))
    x, y = (corner - corner[0]).T
    area = 0.5 * ((x[:-1] * y[1:] - x[1:] * y[:-1])[follows]).sum()
    return joined if abs(joined.area - area) < 0.5 * seam * joined.length else None


@kernel
def _join_corners(corner: Floats, order: Ints, seam: float) -> Ints:
    """Return for each corner the first one of its point, which are all corners that lie within the seam of another of them.

    ``order``: of the corners along `ASKEW`.
    """
    first = np.arange(order.size)
    for n in range(order.size):
        for m in range(n + 1, order.size):
            x, y = corner[order[m], 0] - corner[order[n], 0], corner[order[m], 1] - corner[order[n], 1]
            if ASKEW[0] * x + ASKEW[1] * y > 2.0 * seam:
                break
            if x * x + y * y <= seam * seam:
                i, j = order[n], order[m]
                while first[i] != i:
                    i = first[i]
                while first[j] != j:
                    j = first[j]
                first[max(i, j)] = min(i, j)
    for i in range(order.size):
        first[i] = first[first[i]]  # an earlier one, which has its own already
    return first


def _unshared_edges(edges: Any, points: int) -> Any:
    """Return the edges (first and last point, shape (edges, 2)) that are not passed in both directions."""
    first, last = edges[edges[:, 0] != edges[:, 1]].T
    edge, number = np.unique(np.minimum(first, last) * points + np.maximum(first, last), return_inverse=True)
    net = np.bincount(number, np.sign(last - first), edge.size)
    ends = np.column_stack(np.divmod(edge, points))[net != 0.0]
    return np.where((net[net != 0.0] > 0.0)[:, None], ends, ends[:, ::-1])


def shrink(shape: Any, width: float) -> Any:
    """Return a shape (shapely) without a margin of ``width``; its corners stay sharp."""
    least = 0.5 * (shape.area - width * shape.length)
    # GEOS 3.14 loses some outlines whole: one of 57 hexagons was nothing, a millionth less or more and it was right.
    for corners, change in itertools.product(("mitre", "bevel", "round"), (0.0, 1e-6, -1e-6)):
        smaller = shapely.buffer(shape, -width * (1.0 + change), join_style=corners)
        if smaller.area > least:
            break
    return smaller
