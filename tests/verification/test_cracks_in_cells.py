"""Energy that cracks in elastic cells release, against fracture mechanics: G = K^2 / E, whatever the direction of the lattice.

Straight cuts through turned lattices, advanced four times by the distance of the cells; a crack ends where the facet of its last
broken bond does. K: Tada, Paris and Irwin, The Stress Analysis of Cracks Handbook.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from engines.lattices import stiffness_matrix
from riftberg.bergs.lattice import lattice_points
from riftberg.engines.quasi_static.lattice.cells import cell_mesh, freed_edges
from riftberg.engines.quasi_static.lattice.triangles import find_triangles, freedoms, volumes

ANGLES = (0.0, 15.0, 22.5, 30.0, 45.0)
FACET = {"square": 1.0, "hexagonal": 1.0 / np.sqrt(3.0)}


def edge_factor(share: float) -> float:
    """K / (sigma sqrt(pi a)) of a crack of length a = share W from the edge of a strip of width W."""
    return 0.265 * (1.0 - share) ** 4 + (0.857 + 0.265 * share) / (1.0 - share) ** 1.5


def centre_factor(share: float) -> float:
    """The same for a crack of length 2 a = share W in the middle of it."""
    return (1.0 - 0.025 * share**2 + 0.06 * share**4) * np.sqrt(1.0 / np.cos(0.5 * np.pi * share))


class Strip:
    """A strip of ice along y, pulled at its ends, with cells at distance 1, modulus and thickness 1."""

    def __init__(self, packing: str, angle: float, width: float) -> None:
        self.facet, length = FACET[packing], 3.0 * width
        outline = shapely.box(-0.5 * width, -0.5 * length, 0.5 * width, 0.5 * length)
        reach = round(length)
        box = outline.bounds if angle == 0.0 else (-reach, -reach, reach, reach)
        points, (c, s) = lattice_points(box, 0.5, packing), (np.cos(np.radians(angle)), np.sin(np.radians(angle)))
        xy = np.column_stack([c * points.x - s * points.y, s * points.x + c * points.y])
        places = shapely.points(xy)
        xy = xy[shapely.contains(outline, places) & (shapely.distance(outline.boundary, places) >= 0.3)]
        pairs = cKDTree(xy).query_pairs(1.25, output_type="ndarray")
        self.ends = xy[pairs]
        self.mesh = mesh = cell_mesh(xy, *pairs.T, outline, 1.0, both_diagonals=packing == "square")
        self._at, self._volume = freedoms(mesh.triangle, mesh.owner[mesh.triangle]), volumes(mesh, np.ones(mesh.cells))
        # Strips of three cells at both ends bear the load, which is in balance (of forces and of moments).
        x, y = mesh.xy.T
        load, third = np.zeros((x.size, 3)), np.repeat(mesh.weight * mesh.area / 3.0, 3)
        node_area = np.bincount(mesh.triangle.ravel(), third, x.size)
        for sign in (-1.0, 1.0):
            end = sign * y > 0.5 * length - 3.0
            area = node_area * end
            first, second = (area * x).sum(), (area * x * x).sum()
            slope = -first / second
            pull = area * (1.0 + slope * x)
            load[:, 1] += sign * width * pull / pull.sum()
        self.load = load.ravel()
        self._held = np.zeros(self.load.size)
        centre = int(np.argmin(np.hypot(x[: mesh.cells] - 0.25 * width, y[: mesh.cells] - 0.25 * length)))
        self._held[3 * centre : 3 * centre + 3] = 1.0
        self._held[3 * mesh.cells + 2 :: 3] = 1.0

    def cut(self, left: float, right: float) -> tuple[float, tuple[float, float]]:
        """Work of unit stress on the strip with a cut along x, and where the crack ends."""
        # Beside the middle, where a row of cells may lie.
        (ax, ay), (bx, by) = (self.ends[:, 0] - [0.0, 0.25]).T, (self.ends[:, 1] - [0.0, 0.25]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = ax + (bx - ax) * (-ay / (by - ay))
        broken = (ay * by < 0.0) & (crossing > left) & (crossing < right)
        freed = freed_edges(self.mesh, broken)
        vertex = self.mesh.xy[self.mesh.triangle]
        triangles = find_triangles(vertex, freed, 1.0, 0.3)
        matrix = stiffness_matrix(self._at, self._volume[:, None, None] * triangles.stiffness, self.mesh.owner.size)
        displacement = splu((matrix + diags(self._held)).tocsc()).solve(self.load)
        # A facet lies across its bond, in the middle of it.
        middle, across = 0.5 * (ax + bx), 0.5 * self.facet * abs(by - ay)
        return float(self.load @ displacement), ((middle - across)[broken].min(), (middle + across)[broken].max())


def released(packing: str, angle: float, cells: int, kind: str) -> float:
    """Released energy over four advances, in parts of the integral of K^2 / E."""
    factor = edge_factor if kind == "edge" else centre_factor
    width = cells * (45.0 / 12.0 if kind == "edge" else 54.0 / 12.0)
    strip = Strip(packing, angle, width)
    half = 0.5 * cells

    def state(n: int) -> tuple[float, float]:
        if kind == "edge":
            work, (_, right) = strip.cut(-0.5 * width - 1.0, -0.5 * width + cells + n)
            return work, right + 0.5 * width
        work, (left, right) = strip.cut(-half - 0.5 * n, half + 0.5 * n)
        return work, 0.5 * (right - left)

    (before, short), (after, long) = state(0), state(4)
    lengths = np.linspace(short, long, 101)
    share = lengths / width if kind == "edge" else 2.0 * lengths / width
    tips = 1.0 if kind == "edge" else 2.0
    theory = tips * np.trapezoid(np.pi * lengths * np.array([factor(a) for a in share]) ** 2, lengths)
    return 0.5 * (after - before) / theory


@pytest.mark.quick(3)
@pytest.mark.parametrize("kind", ["edge", "centre"])
@pytest.mark.parametrize("angle", ANGLES)
def test_four_cells(angle, kind) -> None:
    assert released("square", angle, 4, kind) == pytest.approx(1.0, abs=0.05)
    assert released("hexagonal", angle, 4, kind) == pytest.approx(1.0, abs=0.14)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["edge", "centre"])
@pytest.mark.parametrize("angle", ANGLES)
def test_eight_cells(angle, kind) -> None:
    assert released("square", angle, 8, kind) == pytest.approx(1.0, abs=0.05)
    # The crack acts 0.2 to 0.35 cells longer than to the end of the facet: 9.4 % at most.
    assert released("hexagonal", angle, 8, kind) == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["edge", "centre"])
@pytest.mark.parametrize("angle", ANGLES)
def test_sixteen_cells(angle, kind) -> None:
    assert released("square", angle, 16, kind) == pytest.approx(1.0, abs=0.03)
    assert released("hexagonal", angle, 16, kind) == pytest.approx(1.0, abs=0.06)
