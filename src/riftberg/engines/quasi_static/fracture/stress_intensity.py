"""Stress intensity at the tips of cracks in elastic cells, by an interaction integral over a ring around each tip.

With the weight w(r) = 1 up to half of the radius of the ring, falling to 0 at its radius (linear between nodes), and the fields
S, a of a crack of K_m = 1 (`riftberg.physics.crack_tip`)

    K_m = E / 2H [ sum over triangles of the ring  V < (s_ij a_i,x + S_ij u_i,x - S_ik e_ik delta_xj) dw/dx_j >
                   - sum over elements  w F_i a_i,x ]

with stress s, strain e and displacements u of a triangle, V the volume of its ice, < > the mean over the middles of its edges,
F the load of an element, and H the thickness at the tip (Moran and Shih 1987, Eng. Fract. Mech. 27). Triangles that a break has
freed are left out: their displacements have a jump, and they lie along the crack, whose faces bear nothing.

So K is linear in displacements and loads. Its weights stay the same until a bond breaks: what melts are H and V, which come in
when K is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.quasi_static.lattice.dense import multiply
from riftberg.physics.crack_tip import crack_tip_fields
from riftberg.state import Floats, Ints

if TYPE_CHECKING:
    from riftberg.engines.quasi_static.lattice.cell_stiffness import NearTriangles

NONE = np.zeros(0, np.int64)

MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
"""Middles of the edges of a triangle, by its vertices."""


class RingWeights(NamedTuple):
    """Weights by which K follows from volumes, displacements and loads."""

    triangle: Ints  # Rows of those of the ring
    vertex: Ints  # Their vertices, as rows of ``node``; shape (triangles, 3)
    by_displacement: Floats  # For each m3 of them, Pa m-5/2, shape (2, triangles, 3, 2): K_I and K_II
    node: Ints
    rotation: Floats  # How a rotation moves the nodes, with 1 as the sum of all squares; shape (nodes, 2)
    element: Ints
    by_load: Floats  # m-1/2, shape (2, elements, 2)
    disc: Ints  # Rows of the triangles at the tip, whose mean thickness is H
    area: Floats  # Of these, m2


class TipRing(NamedTuple):
    """The ring around a tip."""

    weights: RingWeights
    end: Floats  # Where the crack ends, m
    radius: float  # m
    reliable: bool  # Whether the ring is wide enough for K to be told
    beside: Ints  # Rows of the intact bonds beside the tip


@kernel
def ring_intensities(ring: RingWeights, volume: Floats, displacement: Floats, load: Floats) -> tuple[float, float]:
    """Return K_I and K_II (Pa m1/2).

    ``volume``: of all triangles, m3; ``displacement``: of all nodes (m, m, rad); ``load``: of the elements (N, N, N m).
    """
    triangle, vertex, by_displacement, node, rotation = (
        ring.triangle, ring.vertex, ring.by_displacement, ring.node, ring.rotation
    )  # fmt: skip
    element, by_load, disc, area = ring.element, ring.by_load, ring.disc, ring.area
    # A rigid rotation has no part in K. Left to round-off of the integral it would: bergs turn more than they strain.
    turned = 0.0
    for n in range(node.size):
        turned += rotation[n, 0] * displacement[node[n], 0] + rotation[n, 1] * displacement[node[n], 1]
    opening = shearing = 0.0
    for t in range(triangle.size):
        first = second = 0.0
        for v in range(3):
            n = vertex[t, v]
            for c in range(2):
                moved = displacement[node[n], c] - turned * rotation[n, c]
                first += by_displacement[0, t, v, c] * moved
                second += by_displacement[1, t, v, c] * moved
        opening += volume[triangle[t]] * first
        shearing += volume[triangle[t]] * second
    for n in range(element.size):
        for c in range(2):
            opening -= by_load[0, n, c] * load[element[n], c]
            shearing -= by_load[1, n, c] * load[element[n], c]
    ice = extent = 0.0
    for n in range(disc.size):
        ice += volume[disc[n]]
        extent += area[n]
    half = 0.5 * extent / ice  # m-1, by the thickness at the tip, where it changes evenly
    return half * opening, half * shearing


def tip_ring(
    ice: NearTriangles, element: Ints, centre: Floats, position: Floats, direction: Floats, radius: float,
    elastic: tuple[float, float], *, reliable: bool = True, beside: Ints = NONE,
) -> TipRing:  # fmt: skip
    """Find the weights of the ring around a tip.

    ``ice``: the triangles around it; ``element``, ``centre``: rows and places (m) of the elements there; ``position``: of the
    tip, m; ``direction``: unit vector in which the crack ends; ``radius``: m; ``elastic``: modulus (Pa) and Poisson's ratio;
    ``reliable``, ``beside``: see `TipRing`.
    """
    from riftberg.engines.quasi_static.lattice.triangles import plane_stress  # with scipy.spatial, half a second

    youngs, poisson = elastic
    axes = np.array([direction, [-direction[1], direction[0]]])
    vertex = multiply(ice.vertex - position, axes.T)
    disc = np.hypot(*vertex.mean(axis=1).T) < 0.5 * radius
    weight = np.clip(2.0 - 2.0 * np.hypot(vertex[..., 0], vertex[..., 1]) / radius, 0.0, 1.0)
    rows = np.flatnonzero(ice.whole & (weight.max(axis=1) > 0.0) & (weight.min(axis=1) < 1.0))
    vertex, weight, count = vertex[rows], weight[rows], rows.size
    run = vertex[:, [2, 0, 1]] - vertex[:, [1, 2, 0]]
    twice = run[:, 0, 0] * run[:, 1, 1] - run[:, 0, 1] * run[:, 1, 0]
    slope = np.stack([-run[..., 1], run[..., 0]], axis=2) / twice[:, None, None]  # of the share of each vertex, m-1
    falls = np.einsum("tv,tvj->tj", weight, slope)

    # Strain xx, yy, xy by the displacements along and across; the mean of the fields over the middles of the edges.
    strain = np.zeros((count, 3, 3, 2))
    strain[:, 0, :, 0], strain[:, 1, :, 1] = slope[..., 0], slope[..., 1]
    strain[:, 2, :, 0], strain[:, 2, :, 1] = 0.5 * slope[..., 1], 0.5 * slope[..., 0]
    stress = np.einsum("ij,tjvc->tivc", plane_stress(1.0, poisson) * [1.0, 1.0, 2.0], strain)
    middle = np.einsum("ij,tjc->tic", MIDDLES, vertex).reshape(-1, 2)
    by_displacement = np.zeros((2, count, 3, 2))
    for mode, (s, gradient) in enumerate(zip(*crack_tip_fields(middle[:, 0], middle[:, 1], poisson), strict=True)):
        s, gradient = s.reshape(count, 3, 3).mean(axis=1), gradient.reshape(count, 3, 2).mean(axis=1)
        for c in range(2):  # s_ij a_i,x dw/dx_j
            across = np.column_stack(
                [
                    gradient[:, 0] * falls[:, 0],
                    gradient[:, 1] * falls[:, 1],
                    gradient[:, 0] * falls[:, 1] + gradient[:, 1] * falls[:, 0],
                ]
            )
            by_displacement[mode, :, :, c] += np.einsum("ti,tiv->tv", across, stress[..., c])
            # S_ij u_i,x dw/dx_j
            pulled = s[:, [c, 2] if c == 0 else [2, 1]]
            by_displacement[mode, :, :, c] += np.einsum("tj,tj->t", pulled, falls)[:, None] * slope[:, :, 0]
            energy = np.einsum("ti,tiv->tv", s * [1.0, 1.0, 2.0], strain[..., c])
            by_displacement[mode, :, :, c] -= energy * falls[:, :1]
    node, at = np.unique(ice.node[rows], return_inverse=True)
    at, where = at.reshape(-1, 3), np.zeros((node.size, 2))
    where[at] = ice.vertex[rows]
    arm = where - where.mean(axis=0)
    rotation = np.column_stack([-arm[:, 1], arm[:, 0]])

    centre = multiply(centre - position, axes.T)
    weight = np.clip(2.0 - 2.0 * np.hypot(*centre.T) / radius, 0.0, 1.0)
    loaded = np.flatnonzero(weight > 0.0)
    _, gradient = crack_tip_fields(centre[loaded, 0], centre[loaded, 1], poisson)
    weights = RingWeights(
        ice.row[rows], at, youngs * multiply(by_displacement, axes), node, rotation / np.sqrt((rotation**2).sum()),
        element[loaded], multiply(weight[loaded, None] * gradient, axes), ice.row[disc], ice.area[disc],
    )  # fmt: skip
    return TipRing(weights, position, radius, reliable, beside)
