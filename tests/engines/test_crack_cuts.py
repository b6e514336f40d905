"""Polygons that the line of a crack divides: against a geometry library, whose last digits are its own."""

import numpy as np
import pytest
import shapely
from shapely.ops import split

from riftberg.engines.quasi_static.lattice import crack_cuts


def polygon(rng: np.random.Generator) -> np.ndarray:
    """Corners of a convex polygon, anticlockwise."""
    hull = shapely.orient_polygons(shapely.convex_hull(shapely.multipoints(rng.uniform(-1.0, 1.0, (12, 2)))))
    return np.asarray(hull.exterior.coords)[:-1]


@pytest.mark.parametrize("seed", range(60))
def test_a_line_divides_a_polygon_as_a_geometry_library_does(seed: int) -> None:
    """Also a line that bends within it, enters it twice or ends in it; the pieces are convex, and fill it."""
    rng = np.random.default_rng(seed)
    corner, line = polygon(rng), rng.uniform(-1.5, 1.5, (rng.integers(2, 6), 2))
    line = line[np.argsort(line[:, seed % 2])]  # a crack does not cross itself
    crack = shapely.LineString(line)
    pieces = [shapely.Polygon(piece) for piece in crack_cuts.divide_polygon(corner, line)]
    assert all(piece.exterior.is_ccw for piece in pieces)
    np.testing.assert_allclose(shapely.area(shapely.convex_hull(pieces)), shapely.area(pieces), rtol=1e-9)
    assert shapely.area(pieces).sum() == pytest.approx(shapely.Polygon(corner).area, rel=1e-12)
    parts = list(split(shapely.Polygon(corner), crack).geoms)
    for piece in pieces:
        inside = shapely.area(shapely.intersection(piece, parts))
        assert inside.max() == pytest.approx(piece.area, abs=1e-9)  # it lies within one of them
    assert (len(pieces) == 1) == (len(parts) == 1)


@pytest.mark.parametrize("seed", range(20))
def test_crossings_and_distances_are_those_of_a_geometry_library(seed: int) -> None:
    rng = np.random.default_rng(seed)
    line, (start, end) = rng.uniform(-1.0, 1.0, (5, 2)), rng.uniform(-1.0, 1.0, (2, 2))
    segments = shapely.linestrings(np.stack([line[:-1], line[1:]], axis=1))
    crossed = shapely.intersects(segments, shapely.LineString([start, end])).sum()
    assert crack_cuts.count_crossings(start, end, line) == crossed
    distance = shapely.distance(shapely.LineString(line), shapely.Point(start))
    assert crack_cuts.distances_to_line(start[None], line)[0] == pytest.approx(distance, rel=1e-12)
    ring = polygon(rng)
    area, *middle = crack_cuts.area_and_centroid(ring, 0, len(ring))
    assert area == pytest.approx(shapely.Polygon(ring).area, rel=1e-12)
    np.testing.assert_allclose(middle, shapely.Polygon(ring).centroid.coords[0], rtol=1e-10, atol=1e-12)


def test_a_way_through_a_corner_of_the_line_crosses_once() -> None:
    line = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.3]])
    assert crack_cuts.count_crossings(np.array([0.0, -1.0]), np.array([0.0, 1.0]), line) == 1


@pytest.mark.parametrize("seed", range(20))
def test_pieces_share_the_side_along_which_they_were_cut(seed: int) -> None:
    """Whichever comes first, and a gap apart; and nothing where they meet in a corner."""
    rng = np.random.default_rng(seed)
    corner, (start, end) = polygon(rng), rng.uniform(-0.3, 0.3, (2, 2))
    start, end = start + 10.0 * (start - end), end + 10.0 * (end - start)
    one, two = crack_cuts.divide_polygon(corner, np.array([start, end]))
    length = shapely.intersection(shapely.LineString([start, end]), shapely.Polygon(corner)).length
    across = np.array([start[1] - end[1], end[0] - start[0]]) / np.hypot(*(end - start))
    for gap in (0.0, 0.9e-3, -0.9e-3):
        assert crack_cuts.shared_side(one + gap * across, two, 1e-3) == pytest.approx(length, rel=1e-3)
        assert crack_cuts.shared_side(two, one + gap * across, 1e-3) == pytest.approx(length, rel=1e-3)
    assert crack_cuts.shared_side(one + 1.1e-3 * across, two, 1e-3) < 1e-2 * length
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert crack_cuts.shared_side(square, square + 1.0, 1e-6) == 0.0
    assert crack_cuts.shared_side(square, square + np.array([1.0, 0.4]), 1e-6) == pytest.approx(0.6)
