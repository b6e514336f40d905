"""Faces of broken bonds within one fragment that close again: they bear pressure, and no tension.

A broken bond frees the edges of triangles that belong to it. Such an edge is open by a gap (`triangles`); a gap below 0 would be
ice that passes through ice. So it closes: the elongation of the edge is that of the ice again. It slips freely, for its
squares stay away, and diagonals of squares stay free, for they meet at a corner alone.

Which edges of a triangle are closed follows from its displacements, so nothing is stored: each way of closing them gives gaps of
the open and pressures of the closed ones, and the energy is convex, so there is one way that leaves none of these below 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats, Ints
from riftberg.stepping.lattice.cells import Booleans
from riftberg.stepping.lattice.triangles import find_open_edges

WAYS = 4
"""Ways to close up to two faces of a triangle: bit 0 for the first, bit 1 for the second."""


class FaceTables(NamedTuple):
    """What compiled code needs of `ClosingFaces`; a row for each triangle."""

    row: Ints  # Number of the triangle
    at: Ints  # Its nine freedoms
    number: Ints  # Of its faces that may close, one or two
    # By ways of closing: gap of each open and pressure of each closed face, both as a length (m) by the freedoms
    signs: Floats  # shape (triangles, ways, 2, 9)
    stress: Floats  # Stress xx, yy, xy (Pa) by the freedoms; shape (triangles, ways, 3, 9)


class ClosingFaces:
    """Triangles with faces that may close; a row for each.

    ``row``: number of the triangle; ``at``: its nine freedoms; ``vertex``: m; ``freed``, ``faces``: its edges that are freed,
    and those of them that may close, one or two; ``volume``: m3.
    """

    def __init__(
        self, row: Ints, at: Ints, vertex: Floats, freed: Booleans, faces: Booleans, volume: Floats, youngs: float,
        poisson: float,
    ) -> None:  # fmt: skip
        count = row.size
        self.at = at
        self.tables = FaceTables(
            row, at, faces.sum(axis=1), np.zeros((count, WAYS, 2, 9)), np.zeros((count, WAYS, 3, 9))
        )
        self.columns = np.zeros((count, WAYS, 2, 9))  # w: closing adds the sum of w w^T to the stiffness
        if count == 0:
            return
        found, edges = find_open_edges(vertex, freed, youngs, poisson)
        every = np.arange(count)[:, None]
        edge = np.argsort(~faces, axis=1, kind="stable")[:, :2]  # the second one counts where there are two
        gap, give = edges.gap[every, edge], edges.give[every[:, :, None], edge[:, :, None], edge[:, None, :]]
        # A lone face has no second one: any number but 0 does for its give.
        give[self.tables.number == 1, 1, 1] += give[self.tables.number == 1, 0, 0]
        own = np.einsum("tii->ti", give)[:, :, None]
        by_pull = edges.stress @ np.take_along_axis(edges.give, edge[:, None, :], axis=2)
        for way in range(WAYS):
            shut = [n for n in range(2) if way >> n & 1]
            # Gap = gap of open faces - give times pull; the pull closes the faces that are shut.
            block = give[:, shut][:, :, shut]
            pull = np.zeros_like(gap)
            pull[:, shut] = np.linalg.solve(block, gap[:, shut])
            self.tables.signs[:, way] = gap - give @ pull
            self.tables.signs[:, way, shut] = (-own * pull)[:, shut]
            self.tables.stress[:, way] = found.stress + by_pull @ pull
            self.columns[:, way, shut] = (
                np.linalg.solve(np.linalg.cholesky(block), gap[:, shut]) * np.sqrt(volume)[:, None, None]
            )

    def closed(self, displacement: Floats) -> Ints:
        """Which faces are closed, as a way for each triangle; ``displacement``: of all nodes (m, m, rad)."""
        return closed_ways(self.tables, displacement)


@kernel
def put_closed_stress(faces: FaceTables, displacement: Floats, stress: Floats) -> None:
    """Put the stress (Pa; xx, yy, xy) of triangles with closed faces in the place of that with open ones."""
    row, at, by_way, moved = faces.row, faces.at, faces.stress, displacement.ravel()
    way = closed_ways(faces, displacement)
    for t in range(row.size):
        if way[t] == 0:
            continue
        for c in range(3):
            stress[row[t], c] = 0.0
            for a in range(9):
                stress[row[t], c] += by_way[t, way[t], c, a] * moved[at[t, a]]


@kernel
def closed_ways(faces: FaceTables, displacement: Floats) -> Ints:
    """The way of closing the faces of each triangle whose least gap or pressure is the largest: 0 or more but for round-off."""
    at, signs, number, moved = faces.at, faces.signs, faces.number, displacement.ravel()
    best = np.zeros(at.shape[0], np.int64)
    for t in range(at.shape[0]):
        highest = -np.inf
        for way in range(2 ** number[t]):
            least = np.inf
            for n in range(number[t]):
                value = 0.0
                for a in range(9):
                    value += signs[t, way, n, a] * moved[at[t, a]]
                least = min(least, value)
            if least > highest:
                best[t], highest = way, least
    return best
