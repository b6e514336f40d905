"""Stiffness and stress of linear triangles in natural modes, with a rotation for each cell and edges that may be freed.

Edge ``i`` of a triangle lies opposite vertex ``i`` and runs from ``j`` to ``k``; t is its direction, n = (-t_y, t_x), l its
length:

    elongation  q = t . (u_k - u_j)              of the three follows the strain: t' eps t = q / l, so eps = Q q
    turn        r = n . (u_k - u_j) / l
    energy      W = 1/2 z' k z + c sum over unfreed edges, over both ends v, of (theta_v - r + m)^2

with k = w A H Q' C Q (natural modes; Argyris 1964), C of plane stress, w the weight of the triangle, A its area, H its thickness,
m = n' eps(z) t, theta_v the rotation of the cell that owns v, and c = beta mu w A H / 12. An unfreed edge has z = q. A freed
one has a z of its own, an inner unknown at which W is least, and its squares drop out of the sum. In an unbroken triangle
r - m is the rotation of the material, whatever the edge, so that the sum is the drilling term of Hughes and Brezzi (1989, Comput.
Methods Appl. Mech. Eng. 72): zero in uniform strain and rigid motion.

A freed edge is open by q - z. A crack through a triangle is open by the part of these gaps along its normal; less than 0 would
be ice that passes through ice. So its faces close: they bear pressure, and no tension, and slip freely along the crack.

To free an edge adds an unknown to the minimum and drops squares, so the stiffness can only fall: the energy that a break
releases is never negative, and the order of breaks does not matter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.quasi_static.lattice.cells import Booleans, CellMesh
from riftberg.physics.geometry import invert_matrix
from riftberg.state import Floats, Ints

DRILLING = 0.3
"""beta: stiffness of a cell's rotation relative to its ice, in parts of the shear modulus.

The sag of a beam of eight cells hardly depends on it, but it alone resists bending in a neck of one bond. More would lock the
rotations to the ice of coarse lattices.
"""


class Triangles(NamedTuple):
    """Matrices of the triangles for their six displacements (x and y of each vertex) and the rotations of their owners."""

    stiffness: (
        Floats  # Per volume of the ice, which it is proportional to: N m-4, N m-3, N m-2; shape (triangles, 9, 9)
    )
    stress: Floats  # Stress xx, yy, xy (Pa) by displacements and rotations; shape (triangles, 3, 9)


class OpenEdges(NamedTuple):
    """Matrices to close freed edges of triangles again."""

    gap: Floats  # Gaps (m) by displacements and rotations; shape (triangles, 3, 9)
    give: Floats  # By how much a pull on an edge from within (N per volume, of each column) stretches the ice; (triangles, 3, 3)
    stress: Floats  # Stress xx, yy, xy (Pa) by such a stretch (m) of each edge; shape (triangles, 3, 3)


def plane_stress(youngs: float, poisson: float) -> Floats:
    """Stress xx, yy, xy (Pa) by strain xx, yy and twice xy."""
    c = np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - poisson)]])
    return youngs / (1.0 - poisson**2) * c


def find_triangles(
    vertex: Floats, freed: Booleans, youngs: float, poisson: float, drilling: float = DRILLING
) -> Triangles:
    """Find the matrices of triangles with their freed edges condensed out.

    ``vertex``: positions of the vertices, m, shape (triangles, 3, 2); ``freed``: shape (triangles, 3).
    """
    triangles = Triangles(np.empty((len(vertex), 9, 9)), np.empty((len(vertex), 3, 9)))
    _fill_triangles(vertex, freed, *_elasticity(youngs, poisson, drilling), triangles.stiffness, triangles.stress)
    return triangles


def _elasticity(youngs: float, poisson: float, drilling: float) -> tuple[Floats, float]:
    """Return plane stress by strain (Pa), and 2 c of the energy without weight, area and thickness (Pa)."""
    return plane_stress(youngs, poisson), drilling * 0.5 * youngs / (1.0 + poisson) / 6.0


class LaidTriangles(NamedTuple):
    """Triangles of a mesh in the frames of their fragments."""

    number: Ints  # Rows of the mesh, sorted
    vertex: Floats  # m; shape (triangles, 3, 2)
    freed: Booleans  # Edges; shape (triangles, 3)
    matrices: Triangles

    @classmethod
    def find(
        cls, number: Ints, vertex: Floats, freed: Booleans, youngs: float, poisson: float, earlier: LaidTriangles | None
    ) -> LaidTriangles:  # fmt: skip
        """Find the matrices of those that have changed since; returns the ``earlier`` ones where none has."""
        same = np.zeros(number.size, bool)
        if earlier is not None and earlier.number.size:
            row = np.minimum(np.searchsorted(earlier.number, number), earlier.number.size - 1)
            same = (earlier.vertex[row] == vertex).all(axis=(1, 2)) & (earlier.freed[row] == freed).all(axis=1)
            if same.all() and row.size == earlier.number.size:
                return earlier
        if earlier is None or not same.any():
            return cls(number, vertex, freed, find_triangles(vertex, freed, youngs, poisson))
        matrices, new = Triangles(*(array[row] for array in earlier.matrices)), np.flatnonzero(~same)
        for array, values in zip(matrices, find_triangles(vertex[new], freed[new], youngs, poisson), strict=True):
            array[new] = values
        return cls(number, vertex, freed, matrices)


def find_open_edges(vertex: Floats, freed: Booleans, youngs: float, poisson: float) -> tuple[Triangles, OpenEdges]:
    """Find the matrices of triangles, and how their freed edges close; arguments as of `find_triangles`."""
    count = len(vertex)
    triangles = Triangles(np.empty((count, 9, 9)), np.empty((count, 3, 9)))
    edges = OpenEdges(np.empty((count, 3, 9)), np.empty((count, 3, 3)), np.empty((count, 3, 3)))
    _fill_open_edges(vertex, freed, *_elasticity(youngs, poisson, DRILLING), *triangles, *edges)
    return triangles, edges


class _Condensation(NamedTuple):
    """One triangle while its freed edges are condensed out; x: its nine freedoms, s: the inner unknowns of freed edges."""

    elongation: Floats  # q by x; shape (3, 9)
    turn: Floats  # r by x; shape (3, 9)
    strain: Floats  # xx, yy and twice xy by q; shape (3, 3)
    pull: Floats  # Stress xx, yy, xy by q; shape (3, 3)
    natural: Floats  # k by z; shape (3, 3)
    z: Floats  # By x and s; shape (3, 12)
    drilled: Floats  # theta - r + m of one end of an edge, by x and s; shape (12,)
    energy: Floats  # Twice W by x and s; shape (12, 12)
    least: Floats  # s by x where W is least; shape (3, 9)
    stretch: Floats  # z by x then; shape (3, 9)
    give: Floats  # Inverse of the stiffness of s; shape (3, 3)


@kernel
def _allocate_condensation() -> _Condensation:
    return _Condensation(
        np.empty((3, 9)), np.empty((3, 9)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 12)), np.empty(12),
        np.empty((12, 12)), np.empty((3, 9)), np.empty((3, 9)), np.empty((3, 3)),
    )  # fmt: skip


@kernel
def _describe_edges(vertex: Floats, elastic: Floats, t: _Condensation) -> None:
    """Find elongations and turns of the edges of a triangle, and its strain, stress and stiffness by the elongations."""
    t.elongation[:, :], t.turn[:, :] = 0.0, 0.0
    along, length = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        x, y = vertex[k, 0] - vertex[j, 0], vertex[k, 1] - vertex[j, 1]
        length[i] = math.sqrt(x * x + y * y)
        x, y = x / length[i], y / length[i]
        t.elongation[i, 2 * j], t.elongation[i, 2 * j + 1], t.elongation[i, 2 * k], t.elongation[i, 2 * k + 1] = (
            -x,
            -y,
            x,
            y,
        )
        t.turn[i, 2 * j], t.turn[i, 2 * j + 1] = y / length[i], -x / length[i]
        t.turn[i, 2 * k], t.turn[i, 2 * k + 1] = -y / length[i], x / length[i]
        along[i, 0], along[i, 1], along[i, 2] = x * x, y * y, x * y
    invert_matrix(along, t.strain, np.empty(3))
    for i in range(3):
        for n in range(3):
            t.strain[i, n] /= length[n]
    for i in range(3):
        for n in range(3):
            t.pull[i, n] = (
                elastic[i, 0] * t.strain[0, n] + elastic[i, 1] * t.strain[1, n] + elastic[i, 2] * t.strain[2, n]
            )
    for i in range(3):
        for n in range(3):
            t.natural[i, n] = (
                t.strain[0, i] * t.pull[0, n] + t.strain[1, i] * t.pull[1, n] + t.strain[2, i] * t.pull[2, n]
            )


@kernel
def _add_square(v: Floats, size: int, factor: float, energy: Floats) -> None:
    """Add the square of a linear form to the energy."""
    for a in range(size):
        if v[a] != 0.0:
            for b in range(size):
                energy[a, b] += factor * v[a] * v[b]


@kernel
def _fill_energy(freed: Booleans, drill: float, t: _Condensation) -> int:
    """Find the energy of a triangle by its freedoms and those of its freed edges; returns how many there are."""
    size = 12 if freed[0] or freed[1] or freed[2] else 9
    t.z[:, :], t.energy[:, :] = 0.0, 0.0
    for i in range(3):  # z = q for unfreed edges, z = s for freed ones
        if freed[i]:
            t.z[i, 9 + i] = 1.0
        else:
            for a in range(9):
                t.z[i, a] = t.elongation[i, a]
    for i in range(3):
        for j in range(3):
            for a in range(size):
                factor = t.z[i, a] * t.natural[i, j]
                if factor != 0.0:
                    for b in range(size):
                        t.energy[a, b] += factor * t.z[j, b]
    for i in range(3):
        if freed[i]:
            continue
        x, y = t.elongation[i, 2 * ((i + 2) % 3)], t.elongation[i, 2 * ((i + 2) % 3) + 1]
        for a in range(size):  # m - r of the edge
            t.drilled[a] = 0.0 if a >= 9 else -t.turn[i, a]
        for n in range(3):
            shear = x * y * (t.strain[1, n] - t.strain[0, n]) + 0.5 * (x * x - y * y) * t.strain[2, n]
            for a in range(size):
                t.drilled[a] += shear * t.z[n, a]
        for end in ((i + 1) % 3, (i + 2) % 3):
            t.drilled[6 + end] += 1.0
            _add_square(t.drilled, size, drill, t.energy)
            t.drilled[6 + end] -= 1.0
    return size


@kernel
def _condense_edges(
    vertex: Floats, freed: Booleans, elastic: Floats, drill: float, t: _Condensation, stiffness: Floats, stress: Floats
) -> None:  # fmt: skip
    """Find the stiffness and the stress of one triangle with its freed edges condensed out."""
    _describe_edges(vertex, elastic, t)
    size = _fill_energy(freed, drill, t)
    energy, trace = t.energy, t.natural[0, 0] + t.natural[1, 1] + t.natural[2, 2]
    t.least[:, :] = 0.0
    if size > 9:
        # s = -ss^-1 xs' x. Unfreed edges have no inner unknown; the mean stiffness stands in their place.
        for i in range(3):
            energy[9 + i, 9 + i] += 0.0 if freed[i] else trace
        invert_matrix(energy[9:, 9:], t.give, np.empty(3))
        for i in range(3):
            for a in range(9):
                for j in range(3):
                    t.least[i, a] -= t.give[i, j] * energy[a, 9 + j]
    for i in range(3):
        for a in range(9):
            t.stretch[i, a] = t.z[i, a] + (t.least[i, a] if freed[i] else 0.0)
    for a in range(9):
        for b in range(9):
            stiffness[a, b] = energy[a, b]
            for i in range(3 if size > 9 else 0):
                stiffness[a, b] += energy[a, 9 + i] * t.least[i, b]
    for a in range(9):
        for b in range(a):
            stiffness[a, b] = stiffness[b, a] = 0.5 * (stiffness[a, b] + stiffness[b, a])
    for c in range(3):
        for a in range(9):
            stress[c, a] = 0.0
            for i in range(3):
                stress[c, a] += t.pull[c, i] * t.stretch[i, a]


@kernel
def _fill_triangles(
    vertex: Floats, freed: Booleans, elastic: Floats, drill: float, stiffness: Floats, stress: Floats
) -> None:  # fmt: skip
    """Find the matrices of triangles."""
    t = _allocate_condensation()
    for k in range(len(vertex)):
        _condense_edges(vertex[k], freed[k], elastic, drill, t, stiffness[k], stress[k])


# Many arguments: the fields of both results.
@kernel
def _fill_open_edges(
    vertex: Floats, freed: Booleans, elastic: Floats, drill: float, stiffness: Floats, stress: Floats, gap: Floats, give: Floats,
    pull: Floats,
) -> None:  # fmt: skip
    """Find the matrices of triangles of which edges are freed, and those to close these again."""
    t = _allocate_condensation()
    for k in range(len(vertex)):
        _condense_edges(vertex[k], freed[k], elastic, drill, t, stiffness[k], stress[k])
        for i in range(3):
            for a in range(9):
                gap[k, i, a] = t.elongation[i, a] - t.stretch[i, a]
            for j in range(3):
                give[k, i, j] = t.give[i, j] if freed[k, i] and freed[k, j] else 0.0
                pull[k, i, j] = t.pull[i, j]


class FaceTables(NamedTuple):
    """Arrays of `ClosingFaces` for compiled code; a row for each triangle."""

    row: Ints  # Number of the triangle
    at: Ints  # Its nine freedoms
    gap: Floats  # Gap (m) of the open crack by the freedoms; shape (triangles, 9)
    stress: Floats  # Stress xx, yy, xy (Pa) by the freedoms where the crack is closed; shape (triangles, 3, 9)


class ClosingFaces:
    """Triangles with a crack through them whose faces may close; a row for each.

    Whether it is closed follows from the displacements, so nothing is stored. The energy is convex, so one set of closed cracks
    leaves no gap and no pressure below 0.

    ``row``: number of the triangle; ``at``: its nine freedoms; ``vertex``: m; ``freed``: its edges that are freed, one or two;
    ``across``: growth of the gap of the crack with the gap of each edge, shape (triangles, 3); ``volume``: m3.
    """

    def __init__(
        self, row: Ints, at: Ints, vertex: Floats, freed: Booleans, across: Floats, volume: Floats, youngs: float,
        poisson: float,
    ) -> None:  # fmt: skip
        triangles, edges = find_open_edges(vertex, freed, youngs, poisson)
        # Closed: a pull across the crack takes away the gap that there is without it.
        gap = np.einsum("te,tef->tf", across, edges.gap)
        stretch = np.einsum("tef,tf->te", edges.give, across)
        give = np.einsum("te,te->t", across, stretch)[:, None]
        stress = (
            triangles.stress + np.einsum("tce,te->tc", edges.stress, stretch)[:, :, None] * (gap / give)[:, None, :]
        )
        self.at, self.tables = at, FaceTables(row, at, gap, stress)
        self.columns = gap * np.sqrt(volume[:, None] / give)  # w: closing adds w w^T to the stiffness

    def closed(self, displacement: Floats) -> Booleans:
        """Which of them are closed; ``displacement``: of all nodes (m, m, rad)."""
        return closed_faces(self.tables, displacement)


@kernel
def put_closed_stress(faces: FaceTables, displacement: Floats, stress: Floats) -> None:
    """Replace the stress (Pa; xx, yy, xy) of triangles with closed faces."""
    row, at, if_closed, freedom = faces.row, faces.at, faces.stress, displacement.ravel()
    closed = closed_faces(faces, displacement)
    for t in range(row.size):
        if not closed[t]:
            continue
        for c in range(3):
            stress[row[t], c] = 0.0
            for a in range(9):
                stress[row[t], c] += if_closed[t, c, a] * freedom[at[t, a]]


@kernel
def closed_faces(faces: FaceTables, displacement: Floats) -> Booleans:
    """Which cracks through triangles would be open by less than nothing."""
    at, gap, freedom = faces.at, faces.gap, displacement.ravel()
    closed = np.empty(at.shape[0], np.bool_)
    for t in range(at.shape[0]):
        value = 0.0
        for a in range(9):
            value += gap[t, a] * freedom[at[t, a]]
        closed[t] = value < 0.0
    return closed


def find_gap_shares(vertex: Floats, freed: Booleans, faces: Booleans, normal: Floats) -> Floats:
    """Find the growth of the gap of a crack with the gap of each freed edge of its triangle, shape (triangles, 3).

    ``vertex``: m; ``freed``: one or two edges of each triangle; ``faces``: freed edges that belong to broken bonds;
    ``normal``: of the crack where it crosses each edge, to either side, or 0 where unknown; shape (triangles, 3, 2).

    A crack through two edges parts the vertex that they share from the other two. The gap is taken along the normal of the
    crack, so its faces slip freely, while edge by edge they would lock like the teeth of the lattice that they are made of.
    """
    shares, rows = freed.astype(np.float64), np.flatnonzero(freed.sum(axis=1) == 2)
    edge = np.argsort(~freed[rows], axis=1, kind="stable")[:, :2]  # the two, shape (rows, 2)
    parted = (3 - edge.sum(axis=1))[:, None]
    # Along each of them to the parted vertex, from the one that is opposite the other.
    toward = vertex[rows[:, None], parted] - vertex[rows[:, None], edge[:, ::-1]]
    toward /= np.hypot(toward[..., 0], toward[..., 1])[..., None]
    counts, crack = faces[rows[:, None], edge][..., None], normal[rows[:, None], edge]
    crack = np.where((crack * toward.sum(axis=1, keepdims=True)).sum(axis=2, keepdims=True) < 0.0, -crack, crack)
    mean = (crack * counts).sum(axis=1)
    mean = np.where(mean.any(axis=1, keepdims=True), mean, (toward * counts).sum(axis=1))
    mean /= np.hypot(*mean.T)[:, None]
    # No share below 0: without a gap on one edge alone there is none on both, so that no break stores energy.
    (x0, y0), (x1, y1), (mx, my) = toward[:, 0].T, toward[:, 1].T, mean.T
    both_shares = np.column_stack([mx * y1 - x1 * my, x0 * my - mx * y0]) / (x0 * y1 - x1 * y0)[:, None]
    shares[rows[:, None], edge] = np.maximum(both_shares, 0.0)
    return shares


def volumes(mesh: CellMesh, thickness: Floats) -> Floats:
    """Volume (m3) of the ice of each triangle, with its weight; ``thickness`` (m) of the cells is linear between nodes.

    It is not a number for cells that are gone: then the other vertices count.
    """
    return np.asarray(mesh.weight * mesh.area * np.nanmean(thickness[mesh.owner[mesh.triangle]], axis=1))


def freedoms(node: Ints, owner: Ints) -> Ints:
    """Unknowns of triangles in the order of the matrices of `Triangles`, from the nodes of their vertices and their owners.

    Each node has three: displacements along x and y, and a rotation, which the nodes on the outline do not use. ``node``,
    ``owner``: shape (triangles, 3); the result: (triangles, 9).
    """
    displacements = 3 * node[:, :, None] + np.arange(2)
    return np.concatenate([displacements.reshape(-1, 6), 3 * owner + 2], axis=1)


@kernel
def triangle_stresses(at: Ints, stress: Floats, displacement: Floats) -> Floats:
    """Stress (Pa; xx, yy, xy) of each triangle; ``stress``: of `Triangles`; ``displacement``: of all nodes (m, m, rad)."""
    result, freedom = np.empty((at.shape[0], 3)), displacement.ravel()
    for t in range(at.shape[0]):
        xx = yy = xy = 0.0  # three sums side by side: each by itself would wait for its last addition
        for a in range(9):
            d = freedom[at[t, a]]
            xx += stress[t, 0, a] * d
            yy += stress[t, 1, a] * d
            xy += stress[t, 2, a] * d
        result[t, 0], result[t, 1], result[t, 2] = xx, yy, xy
    return result


class Neighbourhoods(NamedTuple):
    """Triangles whose stress is averaged at each of some points; a row for each triangle of a point, point by point."""

    point: Ints
    triangle: Ints
    share: Floats  # Area with its weight, m2

    @classmethod
    def of_pairs(cls, mesh: CellMesh, point: Ints, triangle: Ints) -> Neighbourhoods:
        """Take each pair of a point and a triangle once; points below 0 are none."""
        count, is_valid = len(mesh.triangle), point >= 0
        pairs = np.unique(point[is_valid] * count + triangle[is_valid])
        point, triangle = np.divmod(pairs, count)
        return cls(point, triangle, (mesh.weight * mesh.area)[triangle])

    def exclude_freed(self, is_unfreed: Booleans) -> Neighbourhoods:
        """Return those without a freed edge (``is_unfreed``: of the triangles), at points that have any.

        Freed edges carry nothing, so a mean that takes their triangles in sees the relief of the flanks of a crack and hardly
        notices that a short one goes on.
        """
        unfreed = is_unfreed[self.triangle]
        has_unfreed = np.bincount(self.point, self.share * unfreed) > 0.0
        counts = unfreed | ~has_unfreed[self.point]
        return Neighbourhoods(self.point[counts], self.triangle[counts], self.share[counts])


@kernel
def mean_stresses(neighbourhoods: Neighbourhoods, stress: Floats, count: int) -> Floats:
    """Stress (Pa; xx, yy, xy) at each point: mean over its triangles by area; 0 where there are none."""
    point, triangle, share = neighbourhoods.point, neighbourhoods.triangle, neighbourhoods.share
    mean, n = np.zeros((count, 3)), 0
    while n < point.size:
        k, total, xx, yy, xy = point[n], 0.0, 0.0, 0.0, 0.0
        while n < point.size and point[n] == k:
            t, area = triangle[n], share[n]
            total += area
            xx, yy, xy = xx + area * stress[t, 0], yy + area * stress[t, 1], xy + area * stress[t, 2]
            n += 1
        if total > 0.0:
            mean[k, 0], mean[k, 1], mean[k, 2] = xx / total, yy / total, xy / total
    return mean
