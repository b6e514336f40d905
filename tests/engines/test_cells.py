"""Triangles through the cells: uniform states exactly, three rigid motions a piece whatever is broken, beams as in theory."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import csgraph, csr_matrix, diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from engines.lattices import stiffness_matrix
from riftberg.bergs.lattice import lattice_points
from riftberg.engines.common.lattices import outline_cells
from riftberg.engines.quasi_static.lattice.cells import cell_mesh, freed_edges
from riftberg.engines.quasi_static.lattice.triangles import (
    Neighbourhoods,
    find_triangles,
    freedoms,
    mean_stresses,
    triangle_stresses,
    volumes,
)
from riftberg.errors import BergError

RADIUS = 0.5
"""Centres are at distance 1, as are modulus and thickness: forces are in parts of E H."""

ANGLES = (0.0, 15.0, 22.5, 30.0, 45.0)
LATTICES = [(packing, angle) for packing in ("square", "hexagonal") for angle in ANGLES]
SHAPES = {
    "L": shapely.Polygon([(0, 0), (12, 0), (12, 5), (5, 5), (5, 10), (0, 10)]),
    "disc": shapely.Point(0, 0).buffer(6.0, quad_segs=32),
    "hole": shapely.box(0, 0, 12, 12).difference(shapely.box(4, 4, 7, 8)),
    "inlet": shapely.box(0, 0, 12, 9).difference(shapely.box(5.9, 3, 6.1, 10)),
}


def filled(outline: shapely.Polygon, packing: str, angle: float):
    """Centres of a turned lattice inside of an outline, and its bonds.

    Those that lie less than 0.6 radii inside are left out, so that no triangle is a sliver.
    """
    x0, y0, x1, y1 = outline.bounds
    if angle == 0.0:
        points = lattice_points(outline.bounds, RADIUS, packing)
        xy = np.column_stack([points.x, points.y])
    else:
        middle, reach = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)]), round(np.hypot(x1 - x0, y1 - y0))
        points = lattice_points((-reach, -reach, reach, reach), RADIUS, packing)
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        xy = middle + np.column_stack([c * points.x - s * points.y, s * points.x + c * points.y])
    points = shapely.points(xy)
    xy = xy[shapely.contains(outline, points) & (shapely.distance(outline.boundary, points) >= 0.6 * RADIUS)]
    pairs = cKDTree(xy).query_pairs(2.5 * RADIUS, output_type="ndarray")
    first, second = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
    joined = shapely.covers(outline, shapely.linestrings(np.stack([xy[first], xy[second]], axis=1)))
    return xy, first[joined], second[joined]


def mesh_of(outline: shapely.Polygon, packing: str, angle: float):
    """Mesh of an outline, and how many bonds it has."""
    xy, first, second = filled(outline, packing, angle)
    return cell_mesh(xy, first, second, outline, 2 * RADIUS, both_diagonals=packing == "square"), first, second


def node_area(mesh):
    """Area that each node bears: a third of its triangles."""
    return np.bincount(mesh.triangle.ravel(), np.repeat(mesh.weight * mesh.area / 3.0, 3), mesh.owner.size)


def box(length: float, width: float) -> shapely.Polygon:
    return shapely.box(-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width)


def found(mesh, broken, thickness=1.0, poisson: float = 0.3, drilling: float = 0.3):
    """Unknowns of the triangles, their matrices, and the stiffness of the whole."""
    at, volume = freedoms(mesh.triangle, mesh.owner[mesh.triangle]), volumes(mesh, thickness * np.ones(mesh.cells))
    vertex = mesh.xy[mesh.triangle]
    triangles = find_triangles(vertex, freed_edges(mesh, broken), 1.0, poisson, drilling)
    return at, triangles, stiffness_matrix(at, volume[:, None, None] * triangles.stiffness, len(mesh.owner))


def whole(mesh, **material):
    """The same without broken bonds."""
    return found(mesh, np.zeros(int(mesh.edge_bond.max()) + 1, bool), **material)


def used(mesh):
    """Unknowns that are any: nodes on the outline have no rotation of their own."""
    every = np.arange(3 * len(mesh.owner))
    return every[(every < 3 * mesh.cells) | (every % 3 < 2)]


def eigenvalues(mesh, stiffness):
    return np.linalg.eigvalsh(stiffness.toarray()[np.ix_(used(mesh), used(mesh))])


def field(mesh, gradient):
    """Displacements in a uniform gradient, in which every cell rotates with the ice."""
    turn = np.where(np.arange(len(mesh.owner)) < mesh.cells, 0.5 * (gradient[1][0] - gradient[0][1]), 0.0)
    return np.column_stack([mesh.xy @ np.transpose(gradient), turn])


def solved(mesh, stiffness, along_x, along_y):
    """Displacements under loads per area, less what would move the ice as a whole; the cell in the middle is held."""
    area, (x, y) = node_area(mesh), mesh.xy.T
    one, none = np.ones_like(x), np.zeros_like(x)
    rigid = np.concatenate([np.stack([one, none, -y]), np.stack([none, one, x])], axis=1).T
    push, mass = np.concatenate([along_x + none, along_y + none]), np.tile(area, 2)
    push -= rigid @ np.linalg.solve((rigid * mass[:, None]).T @ rigid, rigid.T @ (mass * push))
    load = np.column_stack([*(mass * push).reshape(2, -1), none]).ravel()
    held = np.zeros(3 * len(x))
    centre = np.argmin(np.hypot(*(mesh.xy[: mesh.cells] - mesh.xy[: mesh.cells].mean(axis=0)).T))
    held[3 * centre : 3 * centre + 3] = 1.0
    held[3 * mesh.cells + 2 :: 3] = 1.0
    displacement = splu((stiffness + diags(held)).tocsc()).solve(load)
    assert abs(held * displacement).max() < 1e-9 * abs(displacement).max()
    return displacement.reshape(-1, 3)


def principal(stress):
    """Largest principal stress."""
    return 0.5 * (stress[:, 0] + stress[:, 1]) + np.hypot(0.5 * (stress[:, 0] - stress[:, 1]), stress[:, 2])


def at_bonds_of(mesh, bonds, stress):
    """Mean stress at the bonds of ice without broken ones."""
    triangle = np.repeat(np.arange(len(mesh.triangle)), 3)
    near = Neighbourhoods.of_pairs(mesh, mesh.edge_bond.ravel(), triangle)
    return mean_stresses(near, stress, bonds)


@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_triangles_fill_the_outline_and_are_no_slivers(packing, angle) -> None:
    mesh, first, _ = mesh_of(box(30, 15), packing, angle)
    assert (mesh.weight * mesh.area).sum() == pytest.approx(450.0, rel=1e-12)
    assert (mesh.area > 0.0).all()
    assert not freed_edges(mesh, np.zeros(first.size, bool)).any()
    for i in range(3):
        a, b, c = (mesh.xy[mesh.triangle[:, (i + k) % 3]] for k in range(3))
        cosine = ((b - a) * (c - a)).sum(axis=1) / np.hypot(*(b - a).T) / np.hypot(*(c - a).T)
        assert np.degrees(np.arccos(cosine)).min() > 15.0


@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_uniform_gradients_leave_no_forces_inside_and_store_the_energy_of_the_solid(packing, angle) -> None:
    """A bar of this ice is thus exactly as stiff as E, and thins as nu says: the field of the solid is its equilibrium."""
    mesh, first, _ = mesh_of(box(12, 7), packing, angle)
    at, triangles, stiffness = whole(mesh)
    shear = 0.5 / 1.3
    for gradient, stress, energy in (
        ([[1.0, 0.0], [0.0, -0.3]], [1.0, 0.0, 0.0], 0.5),
        ([[-0.3, 0.0], [0.0, 1.0]], [0.0, 1.0, 0.0], 0.5),
        ([[0.0, 1.4], [-0.4, 0.0]], [0.0, 0.0, shear], 0.5 * shear),
        ([[0.0, -1.0], [1.0, 0.0]], [0.0, 0.0, 0.0], 0.0),
    ):
        d = field(mesh, gradient)
        force = stiffness @ d.ravel()
        # Nodes on the outline bear the traction of the ice beyond; all other unknowns are free.
        assert abs(force[: 3 * mesh.cells]).max() < 2e-14
        assert 0.5 * d.ravel() @ force == pytest.approx(energy * 84.0, rel=1e-12, abs=1e-11)
        got = triangle_stresses(at, triangles.stress, d)
        np.testing.assert_allclose(got, np.tile(stress, (len(got), 1)), rtol=0, atol=1e-13)
        at_bonds = at_bonds_of(mesh, first.size, got)
        np.testing.assert_allclose(at_bonds, np.tile(stress, (first.size, 1)), rtol=0, atol=1e-13)


@pytest.mark.quick(3)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 22.5), ("hexagonal", 30.0)])
def test_bays_curves_holes_and_narrow_inlets_are_filled(shape, packing, angle) -> None:
    outline = SHAPES[shape]
    mesh, _, _ = mesh_of(outline, packing, angle)
    assert (mesh.weight * mesh.area).sum() == pytest.approx(outline.area, rel=3e-3 if shape == "disc" else 1e-12)
    _, _, stiffness = whole(mesh)
    assert abs((stiffness @ field(mesh, [[0.2, 0.7], [-0.4, 0.5]]).ravel())[: 3 * mesh.cells]).max() < 2e-14
    values = eigenvalues(mesh, stiffness)
    assert (abs(values) < 1e-10 * values[-1]).sum() == 3
    if shape == "inlet":  # an outline node belongs to a cell on its own side of the water
        left = mesh.xy[mesh.cells :, 0] < 6.0
        at_inlet = (abs(mesh.xy[mesh.cells :, 0] - 6.0) < 0.2) & (mesh.xy[mesh.cells :, 1] > 3.0)
        owner = mesh.owner[mesh.cells :]
        assert at_inlet.sum() > 8
        np.testing.assert_array_equal(mesh.xy[owner[at_inlet], 0] < 6.0, left[at_inlet])


def test_an_outline_of_crumpled_sides_is_refused() -> None:
    sliver = shapely.Polygon([(0, 0), (6, 0), (6, 3), (0, 3), (0, 1.5 + 1e-13), (5, 1.5), (0, 1.5 - 1e-13)])
    xy, first, second = filled(shapely.box(0, 0, 6, 3), "square", 0.0)
    with pytest.raises(BergError, match="cannot be filled with triangles"):
        cell_mesh(xy, first, second, sliver, 1.0, both_diagonals=True)


def test_diagonals_of_squares_hold_as_long_as_a_way_of_two_bonds_is_left() -> None:
    mesh, first, second = mesh_of(box(2, 2), "square", 0.0)
    assert first.size == 4
    tie = (mesh.edge_tie >= 0) & (mesh.triangle.max(axis=1) < 4)[:, None]
    assert tie.sum() == 4  # two diagonals, each an edge of two triangles
    ends = {frozenset(mesh.triangle[t, [i - 2, i - 1]].tolist()) for t, i in np.argwhere(tie)}

    def freed(*bonds):
        broken = np.isin(np.arange(4), bonds)
        loose = freed_edges(mesh, broken) & tie
        return {frozenset(mesh.triangle[t, [i - 2, i - 1]].tolist()) for t, i in np.argwhere(loose)}

    for b in range(4):
        assert freed(b) == set()
        for other in range(b + 1, 4):
            cell = {first[b], second[b]} & {first[other], second[other]}
            assert freed(b, other) == ({e for e in ends if cell <= e} if cell else ends)


@pytest.mark.quick(4)
@pytest.mark.parametrize("drilling", [0.1, 1.0])
@pytest.mark.parametrize(("packing", "angle"), [(p, a) for p in ("square", "hexagonal") for a in (0.0, 22.5, 45.0)])
def test_each_piece_keeps_three_rigid_motions_down_to_single_cells(packing, angle, drilling) -> None:
    mesh, first, second = mesh_of(box(6, 5), packing, angle)
    broken, thickness = np.zeros(first.size, bool), np.random.default_rng(3).uniform(0.5, 1.5, mesh.cells)
    before = None
    for n, bond in enumerate(np.random.default_rng(int(angle) + len(packing)).permutation(first.size)):
        broken[bond] = True
        if n % 3 and n < first.size - 1:
            continue
        _, _, stiffness = found(mesh, broken, thickness, drilling=drilling)
        graph = csr_matrix((np.ones((~broken).sum()), (first[~broken], second[~broken])), shape=(mesh.cells,) * 2)
        pieces, piece = csgraph.connected_components(graph, directed=False)
        values = eigenvalues(mesh, stiffness)
        assert values[0] > -1e-13
        assert (values < 1e-9).sum() == 3 * pieces
        for number in range(pieces):  # pieces feel nothing of each other
            moved = field(mesh, [[0.0, -1.0], [1.0, 0.0]])
            moved[:, 0] += 3.0
            moved[piece[mesh.owner] != number] = 0.0
            assert abs(stiffness @ moved.ravel()).max() < 1e-12
        if before is not None:  # what breaks releases energy, whatever the state
            assert eigenvalues(mesh, before - stiffness)[0] > -1e-13
        before = stiffness
    assert broken.all()


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_neither_the_ends_of_bonds_nor_their_order_matter(packing) -> None:
    outline, rng = box(7, 6), np.random.default_rng(1)
    xy, first, second = filled(outline, packing, 15.0)
    order, swapped = rng.permutation(first.size), rng.random(first.size) < 0.5
    other_first, other_second = np.where(swapped, second, first)[order], np.where(swapped, first, second)[order]
    broken = rng.random(first.size) < 0.3
    matrices = []
    for a, b, gone in ((first, second, broken), (other_first, other_second, broken[order])):
        mesh = cell_mesh(xy, a, b, outline, 1.0, both_diagonals=packing == "square")
        matrices.append(found(mesh, gone)[2].toarray())
    np.testing.assert_array_equal(*matrices)


def bent(packing: str, angle: float, across: int, poisson: float = 0.3) -> tuple[float, float]:
    """Deflection and edge stress of a free beam under a load q cos(2 pi x / L) along it, over those of a Timoshenko beam.

    The stress is that of the nodes: the mean over their triangles.
    """
    length, width = 6.0 * across, float(across)
    mesh, _, _ = mesh_of(box(length, width), packing, angle)
    at, triangles, stiffness = whole(mesh, poisson=poisson)
    k = 2.0 * np.pi / length
    displacement = solved(mesh, stiffness, 0.0, np.cos(k * mesh.xy[:, 0]))
    deflection = displacement[: mesh.cells, 1]
    x, y = mesh.xy[: mesh.cells].T
    bending = width / (k**2 * width**3 / 12.0) * (np.cos(k * x) / k**2 - 0.5 * x**2)
    shear_factor = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)
    shear = 2.0 * (1.0 + poisson) * np.cos(k * x) / (k**2 * shear_factor)
    columns = np.column_stack([bending + shear, np.ones_like(x), x])
    near = abs(y) < 0.2 * width
    share = (mesh.weight * mesh.area)[:, None] * np.ones(3)
    weighted = share * triangle_stresses(at, triangles.stress, displacement)[:, :1]
    nodal = np.bincount(mesh.triangle.ravel(), weighted.ravel()) / np.bincount(mesh.triangle.ravel(), share.ravel())
    edge = 12.0 / (k**2 * width)  # 2 q / k^2 over the section modulus, with q = width
    return float(np.linalg.lstsq(columns[near], deflection[near], rcond=None)[0][0]), float(nodal.max() / edge)


def test_means_take_triangles_with_a_freed_edge_only_where_there_are_no_others() -> None:
    """Against sums place by place."""
    rng = np.random.default_rng(4)
    place, triangle = np.divmod(np.unique(rng.integers(0, 12 * 20, 60)), 20)
    near, whole = Neighbourhoods(place, triangle, rng.uniform(1.0, 2.0, place.size)), rng.random(20) < 0.4
    stress, seen = rng.normal(size=(20, 3)), set()
    found = mean_stresses(near.exclude_freed(whole), stress, 13)
    for k in range(13):
        of_place = place == k
        counts = of_place & whole[triangle] if (of_place & whole[triangle]).any() else of_place
        share = near.share[counts]
        expected = share @ stress[triangle[counts]] / share.sum() if counts.any() else np.zeros(3)
        np.testing.assert_allclose(found[k], expected, rtol=1e-13)
        seen.add(
            (bool(of_place.any()), bool((of_place & whole[triangle]).any()), int(counts.sum()) < int(of_place.sum()))
        )
    assert len(seen) >= 3


@pytest.mark.quick(2)
@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_a_beam_of_eight_cells_sags_as_beam_theory_says(packing, angle) -> None:
    sag, edge = bent(packing, angle, 8)
    assert 0.95 < sag < 1.0
    assert edge == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.33])
@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_beams_of_sixteen_and_32_cells_converge(packing, angle, poisson) -> None:
    sag, edge = bent(packing, angle, 16, poisson)
    assert sag == pytest.approx(1.0, abs=0.015)
    assert edge == pytest.approx(1.0, abs=0.04)
    sag, edge = bent(packing, angle, 32, poisson)
    assert sag == pytest.approx(1.0, abs=0.006)
    assert edge == pytest.approx(1.0, abs=0.03)


def test_stress_at_bonds_is_alike_on_all_lattices() -> None:
    """A plate pulled apart from its middle: the largest tension over the force there, within 0.2 % on ten lattices."""
    got = []
    for packing, angle in LATTICES:
        mesh, first, _ = mesh_of(box(30, 15), packing, angle)
        at, triangles, stiffness = whole(mesh)
        k = np.pi / 30.0
        displacement = solved(mesh, stiffness, np.sin(k * mesh.xy[:, 0]), 0.0)
        stress = at_bonds_of(mesh, first.size, triangle_stresses(at, triangles.stress, displacement))
        got.append(principal(stress).max() * k)
    assert np.ptp(got) < 0.002
    assert np.mean(got) == pytest.approx(1.025, abs=0.002)


@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 22.5), ("hexagonal", 15.0)])
def test_a_disc_that_spins_bears_in_its_middle_what_theory_says(packing, angle) -> None:
    """A curved outline, loads that grow outwards: tension (3 + nu) / 8 rho omega^2 R^2 in the middle."""
    radius = 8.0
    mesh, first, second = mesh_of(shapely.Point(0.13, 0.21).buffer(radius, quad_segs=64), packing, angle)
    assert (mesh.weight * mesh.area).sum() == pytest.approx(np.pi * radius**2, rel=3e-3)
    at, triangles, stiffness = whole(mesh)
    out = mesh.xy - [0.13, 0.21]
    displacement = solved(mesh, stiffness, *out.T)
    stress = principal(at_bonds_of(mesh, first.size, triangle_stresses(at, triangles.stress, displacement)))
    near = np.hypot(*(0.5 * (out[first] + out[second])).T) < 1.5
    assert stress[near].mean() == pytest.approx(3.3 / 8.0 * radius**2, rel=0.015)


@pytest.mark.parametrize(("packing", "angle"), LATTICES)
def test_a_bar_of_uneven_thickness_stretches_as_its_sections_say(packing, angle) -> None:
    """Thickness from 1 to 2 along the bar: du/dx = N / (E W H), so that u goes as the logarithm of the thickness."""
    mesh, first, _ = mesh_of(box(32, 8), packing, angle)
    thickness = 1.5 + mesh.xy[: mesh.cells, 0] / 32.0
    _, _, stiffness = found(mesh, np.zeros(first.size, bool), thickness)
    ends = [mesh.xy[:, 0] > 14.0, mesh.xy[:, 0] < -14.0]
    pull = sum(sign * end / node_area(mesh)[end].sum() for sign, end in zip((1.0, -1.0), ends, strict=True))
    along = solved(mesh, stiffness, pull, 0.0)[: mesh.cells, 0]
    inner = abs(mesh.xy[: mesh.cells, 0]) < 10.0
    columns = np.column_stack([4.0 * np.log(thickness), np.ones(mesh.cells)])
    assert np.linalg.lstsq(columns[inner], along[inner], rcond=None)[0][0] == pytest.approx(1.0, rel=0.003)


@pytest.mark.parametrize(("packing", "area"), [("square", 1.0), ("hexagonal", 0.5 * np.sqrt(3.0))])
def test_without_an_outline_the_cells_themselves_make_one(packing, area) -> None:
    xy, first, second = filled(box(6, 5), packing, 30.0)
    angle = np.arctan2(*(xy[second[0]] - xy[first[0]])[::-1])
    outline = outline_cells(xy, RADIUS, packing, angle)
    assert outline.geom_type == "Polygon"
    assert outline.area == pytest.approx(len(xy) * area, rel=1e-4)
    mesh = cell_mesh(xy, first, second, outline, 1.0, both_diagonals=packing == "square")
    assert (mesh.weight * mesh.area).sum() == pytest.approx(outline.area, rel=1e-10)
    _, _, stiffness = whole(mesh)
    assert (eigenvalues(mesh, stiffness) < 1e-10).sum() == 3
