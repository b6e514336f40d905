"""Pads: footprints cut by squares that are fixed in the ice."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from riftberg.engines.quasi_static.ground import pads as cutter

SIDE = 300.0

OUTLINES = {
    "square on the raster": [(0, 0), (3000, 0), (3000, 3000), (0, 3000)],
    "turned rectangle": [(0, 0), (2600, 1500), (1600, 3232), (-1000, 1732)],
    "L": [(0, 0), (3000, 0), (3000, 1000), (1000, 1000), (1000, 3000), (0, 3000)],
    "U with a narrow slot": [(0, 0), (3000, 0), (3000, 2500), (1700, 2500), (1700, 400), (1400, 400), (1400, 2500), (0, 2500)],
    "arrow": [(0, 0), (3000, 700), (0, 1400), (900, 700)],
    "smaller than a pad": [(0, 0), (100, 0), (50, 80)],
}  # fmt: skip


def pads_of(corners: np.ndarray) -> Any:
    """Pads of a fragment of one element."""
    element: Any = np.zeros(1, np.int64)
    footprint: Any = SimpleNamespace(rows=element, owner=element, start=np.array([0, len(corners)]), corner=corners)
    return cutter.cut_into_pads(footprint, element, np.zeros((1, 2)), np.array([SIDE]))


def check(corners: np.ndarray) -> None:
    """All squares have the ice that shapely cuts out of the outline, and corners on their sides stand there to the last digit."""
    outline, pads = shapely.Polygon(corners), pads_of(corners)
    ice, low = shapely.affinity.translate(outline, *-pads.origin[0]), pads.low[0]
    rows, columns = pads.shape[0]
    for row in range(rows):
        for column in range(columns):
            west, south = low[0] + column * SIDE, low[1] + row * SIDE
            expected = ice.intersection(shapely.box(west, south, west + SIDE, south + SIDE))
            area, x, y = pads.ice[row * columns + column, :3]
            assert area == pytest.approx(expected.area, abs=1e-6 * SIDE**2)
            if expected.area > 1e-3 * SIDE**2:
                assert (x, y) == pytest.approx(expected.centroid.coords[0], abs=1e-6 * SIDE)
    lines = [low[k] + SIDE * np.arange(pads.shape[0, 1 - k] + 1) for k in (0, 1)]
    for k in (0, 1):
        distance = np.abs(pads.corner[:, k, None] - lines[k]).min(axis=1)
        assert not ((distance > 0.0) & (distance < 1e-9 * SIDE)).any()


@pytest.mark.parametrize("name", OUTLINES)
def test_squares_have_the_ice_of_the_outline(name: str) -> None:
    check(np.array(OUTLINES[name], float))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.2, 1.0), min_size=5, max_size=12), st.floats(0.0, 1.0), st.floats(400.0, 4000.0)
)  # fmt: skip
def test_squares_have_the_ice_of_any_star(radii: list[float], turn: float, size: float) -> None:
    """Outlines with bays, of all directions."""
    angle = 2.0 * np.pi * (np.arange(len(radii)) + turn) / len(radii)
    check(size * np.column_stack([radii * np.cos(angle), radii * np.sin(angle)]))


@pytest.mark.parametrize(("where", "share"), [((0.0, 0.0), 1.0), ((4500.0, 0.0), 0.5), ((4500.0, -4500.0), 0.25)])
def test_all_ice_lies_around_a_point_inside_half_of_it_at_an_edge_and_a_quarter_at_a_corner(
    where: tuple[float, float], share: float
) -> None:
    pads = pads_of(np.array([[0.0, 0.0], [9e3, 0.0], [9e3, 9e3], [0.0, 9e3]]))
    assert cutter.measure_ice_share(pads, 0, *where, 2500.0) == pytest.approx(share, rel=0.02)
