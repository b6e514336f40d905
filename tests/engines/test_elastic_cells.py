"""Elastic cells in the default scheme: factors after breaks, frames of fragments, melt and births, beams, restarts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from engines.lattices import stiffness_matrix
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.crack_tips import NO_TIPS
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.quasi_static.bodies.pose import bodies_from_elements, tangent_coordinates
from riftberg.engines.quasi_static.fracture.crack_paths import CrackPaths, Crossing, Tip
from riftberg.engines.quasi_static.fracture.criteria import Equilibrium, IceStress, Strengths
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellStiffness
from riftberg.engines.quasi_static.lattice.cells import add_new_cells
from riftberg.engines.quasi_static.lattice.equilibrium import Supports, balanced_loads, find_lattice
from riftberg.engines.quasi_static.lattice.solver import StiffnessSolver
from riftberg.errors import InputError, RunError
from riftberg.state.population import Population

RADIUS = 750.0
THICKNESS = 200.0
FLAT = {"latlon": False, "period": 0.0}


def turned_beam(packing: str, angle: float, length: float, width: float) -> Iceberg:
    """A rectangle filled by a turned lattice (degrees)."""
    return Iceberg.rectangle(
        length, width, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
    )


def parameters(packing: str = "square", **groups) -> Parameters:
    """Elastic cells on a plane."""
    bonds = {"packing": packing, **groups.pop("bonds", {})}
    return Parameters(**{"earth": FLAT, "bonds": bonds, "fracture": {"enabled": False}, **groups})


def stiffness_of(el, bonds, cells, p):
    """Stiffness, lattice, supports and gauge springs of elements as they lie, a body for each piece; and their coordinates."""
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    bodies = bodies_from_elements(el.lon, el.lat, body, el.mass, False, 1.0, 0.0)
    xy = tangent_coordinates(bodies.reference, False, 1.0)
    sizes, supports = interaction_sizes(el, p), Supports(el.static, el.free_y)
    intact = np.flatnonzero(bonds.status == 0)
    with np.errstate(all="ignore"):  # ends of broken bonds lie in frames of their own
        lattice = find_lattice(bonds, xy, el.thickness, sizes, p)
    given = lattice, intact, supports, supports.gauge_springs(body, xy)
    return CellStiffness(cells, el, bonds, body, xy, p), given, body, xy


def dense_matrix(stiffness):
    """Stiffness of all nodes, added up number by number."""
    of = stiffness.topology
    return stiffness_matrix(of.at, stiffness._triangles.stiffness, of.nodes).toarray()


def loads(el, body, xy, force):
    """Balanced loads on elements."""
    turn = np.tile([1.0, 0.0], (el.size, 1))
    inertia = 0.5 * el.mass * RADIUS**2
    return balanced_loads(body, xy, turn, force, el.mass, inertia, np.zeros(int(body.max()) + 1))


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 22.5), ("hexagonal", 15.0)])
def test_factors_after_breaks_are_those_without_the_bonds_and_every_break_gives_way(packing, angle) -> None:
    berg, p = turned_beam(packing, angle, 9000.0, 6000.0), parameters(packing).kernel_values()
    el, bonds, rng = berg.elements, berg.bonds, np.random.default_rng(2)
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    stiffness, given, body, xy = stiffness_of(el, bonds, cells, p)
    solver = StiffnessSolver(stiffness, *given)
    load = loads(el, body, xy, rng.normal(size=(el.size, 3)) * [1e8, 1e8, 1e10])
    yielded = [(solver.solve(load) * load).sum()]
    for bond in rng.permutation(bonds.first.size):
        bonds.status[bond] = 1
        if connected_parts(el.size, bonds.first, bonds.second, bonds.status).max() > 0:
            bonds.status[bond] = 0  # as it parts the berg; the others go on
            continue
        solver.downdate(bond)
        displacement = solver.solve(load)
        yielded.append((displacement * load).sum())
    assert (np.diff(yielded) > -1e-9 * yielded[-1]).all()
    assert solver.update_rank > 50
    fresh_stiffness, given, *_ = stiffness_of(el, bonds, cells, p)
    fresh = StiffnessSolver(fresh_stiffness, *given).solve(load)
    size = abs(fresh).max(axis=0)
    np.testing.assert_allclose(displacement / size, fresh / size, rtol=0, atol=1e-6)
    intact = given[1]
    stress = fresh_stiffness.stresses(given[0], intact, fresh, load).tensor
    scale = abs(stress).max()
    np.testing.assert_allclose(
        stiffness.stresses(given[0], intact, fresh, load).tensor / scale, stress / scale, rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_stress_is_read_in_the_frame_of_the_fragment_however_the_berg_has_turned(packing) -> None:
    berg, p = turned_beam(packing, 15.0, 15000.0, 9000.0), parameters(packing).kernel_values()
    el, bonds = berg.elements, berg.bonds
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    x, y, (c, s) = el.lon.copy(), el.lat.copy(), (np.cos(0.7), np.sin(0.7))
    el.lon[:], el.lat[:] = 1e5 + c * x - s * y, 3e4 + s * x + c * y
    stiffness, given, _, xy = stiffness_of(el, bonds, cells, p)
    displacement = np.column_stack([1e-3 * xy[:, 0], -3e-4 * xy[:, 1], np.zeros(el.size)])
    stress = stiffness.stresses(*given[:2], displacement, np.zeros((el.size, 3))).tensor
    inner = (abs(x) < 4000.0) & (abs(y) < 2000.0)
    inner = inner[bonds.first] & inner[bonds.second]
    assert inner.sum() > 10
    wanted = np.tile([1e-3 * p.youngs_modulus, 0.0, 0.0], (inner.sum(), 1))
    np.testing.assert_allclose(stress[inner], wanted, rtol=0, atol=1e-8 * wanted.max())


def test_ice_that_has_melted_away_holds_nothing_and_the_rest_is_as_if_its_bonds_had_broken() -> None:
    berg, p = turned_beam("hexagonal", 15.0, 9000.0, 6000.0), parameters("hexagonal").kernel_values()
    cells = add_new_cells(None, berg.elements, berg.bonds, berg.outlines, p)
    gone = np.array([3, 11])
    rest = np.setdiff1d(np.arange(berg.elements.size), gone)
    broken = berg.bonds.copy()
    broken.status[np.isin(broken.first, gone) | np.isin(broken.second, gone)] = 1
    left = Population(berg.elements.copy(), berg.bonds.copy())
    left.remove(berg.elements.id[gone])
    assert left.elements.size == rest.size
    force = np.random.default_rng(0).normal(size=(rest.size, 3)) * [1e8, 1e8, 1e10]
    stiffness, given, body, xy = stiffness_of(left.elements, left.bonds, cells, p)
    load = loads(left.elements, body, xy, force)
    displacement = StiffnessSolver(stiffness, *given).solve(load)

    other, given, body, here = stiffness_of(berg.elements, broken, cells, p)
    every = np.zeros((berg.elements.size, 3))
    every[rest] = load
    held = StiffnessSolver(other, *given).solve(every)[rest]
    # Both differ by a rigid motion, as their gauge springs hold other elements.
    assert body[rest].max() == body[rest].min()
    x, y = here[rest].T
    one, none = np.ones(rest.size), np.zeros(rest.size)
    rigid = (
        np.stack([np.stack([one, none, none]), np.stack([none, one, none]), np.stack([-y, x, one])]).reshape(3, -1).T
    )
    apart = (displacement - held).T.ravel()
    apart -= rigid @ np.linalg.lstsq(rigid, apart, rcond=None)[0]
    assert abs(apart).max() < 1e-8 * abs(held).max()


def test_newly_born_get_cells_of_their_own_unless_they_hang_on_older_ice() -> None:
    p = parameters().kernel_values()
    berg = turned_beam("square", 0.0, 6000.0, 3000.0)
    cells = add_new_cells(None, berg.elements, berg.bonds, berg.outlines, p)
    born = Iceberg.rectangle(3000.0, 1500.0, thickness=THICKNESS, radius=RADIUS, latlon=False, placement=(9e4, 0.0))
    population = Population(berg.elements.copy(), berg.bonds.copy())
    population.append(born.elements, born.bonds)
    more = add_new_cells(cells, population.elements, population.bonds, (), p)
    assert more.mesh.cells == berg.elements.size + 2
    assert (more.mesh.weight * more.mesh.area).sum() == pytest.approx(6000.0 * 3000.0 + 3000.0 * 1500.0, rel=1e-9)
    assert add_new_cells(more, population.elements, population.bonds, (), p) is more
    hanging = population.bonds.copy()
    hanging.first[-1] = 0
    with pytest.raises(RunError, match="bonded to older ones"):
        add_new_cells(cells, population.elements, hanging, (), p)


def test_rifts_that_are_there_from_the_start_part_the_ice() -> None:
    p = parameters().kernel_values()
    berg = turned_beam("square", 0.0, 12000.0, 3000.0)
    cut = berg.with_rifts([[(0.0, -2000.0), (0.0, 2000.0)]], broken=True)
    cells = add_new_cells(None, cut.elements, cut.bonds, cut.outlines, p)
    assert (cells.mesh.weight * cells.mesh.area).sum() == pytest.approx(12000.0 * 3000.0, rel=1e-12)
    stiffness, _, body, _ = stiffness_of(cut.elements, cut.bonds, cells, p)
    assert body.max() == 1
    matrix = dense_matrix(stiffness)
    left, right = (3 * np.flatnonzero(body == b)[:, None] + np.arange(3) for b in (0, 1))
    assert abs(matrix[np.ix_(left.ravel(), right.ravel())]).max() == 0.0
    # Bonds that are not even in the list part it too: elements of two pieces of one outline.
    none = cut.bonds.taken(cut.bonds.status == 0)
    again = add_new_cells(None, cut.elements, none, cut.outlines, p)
    other = stiffness_of(cut.elements, none, again, p)[0]
    np.testing.assert_allclose(dense_matrix(other), matrix, rtol=0, atol=1e-12 * abs(matrix).max())


def test_without_an_outline_the_ice_ends_where_its_elements_do() -> None:
    p = parameters().kernel_values()
    berg = turned_beam("square", 0.0, 9000.0, 4500.0)
    with_outline, without = (
        stiffness_of(berg.elements, berg.bonds, add_new_cells(None, berg.elements, berg.bonds, outlines, p), p)[0]
        for outlines in (berg.outlines, ())
    )
    wanted = dense_matrix(with_outline)
    assert np.linalg.norm(dense_matrix(without)) == pytest.approx(np.linalg.norm(wanted), rel=1e-3)
    scattered = Iceberg.from_points(
        [0.0, 1800.0, 3600.0], [0.0, 0.0, 0.0], thickness=THICKNESS, radius=RADIUS, latlon=False
    )
    joined = add_new_cells(None, scattered.elements, scattered.bonds, (), p).mesh
    assert (joined.weight * joined.area).sum() == pytest.approx(5100.0 * 1500.0, rel=1e-6)


def zero_modes(stiffness) -> int:
    """How many motions of all nodes meet no resistance."""
    matrix = dense_matrix(stiffness)
    used = np.diag(matrix) > 0.0
    scale = np.column_stack([np.ones((used.size // 3, 2)), np.full(used.size // 3, 1.0 / RADIUS)]).ravel()[used]
    values = np.linalg.eigvalsh(matrix[np.ix_(used, used)] * np.outer(scale, scale))
    return int((values < 1e-9 * values[-1]).sum())


@pytest.mark.parametrize("kind", ["degrees", "apart", "inlet"])
def test_every_bond_joins_ice_and_pieces_have_three_zero_modes_whatever_is_broken(kind) -> None:
    """Bug once: cells on meridians that converge did not touch, and a corner on its last bond was held by nothing."""
    rows, columns = (a.ravel() for a in np.indices((3, 5)))
    outline, step = None, 2.0 * RADIUS * (1.15 if kind == "apart" else 1.0)
    if kind == "inlet":
        outline = shapely.box(-RADIUS, -RADIUS, 4.5 * step, 2.5 * step) - shapely.box(2250.0, -800.0, 2350.0, 1000.0)
    degree = np.pi * 6.371e6 / 180.0
    if kind == "degrees":
        x, y = -38.7 + columns * step / degree / np.cos(np.radians(82.0)), -82.0 + rows * step / degree
    else:
        x, y = columns * step, rows * step
    berg = Iceberg.from_points(
        x, y, thickness=THICKNESS, radius=RADIUS, latlon=kind == "degrees", **({"outline": outline} if outline else {})
    )
    el, bonds, rng = berg.elements, berg.bonds, np.random.default_rng(3)
    assert bonds.first.size == 22
    p = parameters(earth={"latlon": kind == "degrees"}).kernel_values()
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    for broken in (0, 1, 3, 6, 12, 22):
        bonds.status[:] = 0
        bonds.status[rng.permutation(22)[:broken]] = 1
        body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
        bodies = bodies_from_elements(el.lon, el.lat, body, el.mass, p.latlon, p.earth_radius, p.period)
        xy = tangent_coordinates(bodies.reference, p.latlon, p.earth_radius)
        stiffness = CellStiffness(cells, el, bonds, body, xy, p)
        held = (
            np.diag(dense_matrix(stiffness)).reshape(-1, 3)[: el.size].max(axis=1) > 0.0
        )  # a lone cell has no triangles
        assert zero_modes(stiffness) == 3 * np.unique(body[held]).size, broken
        assert held[np.isin(np.arange(15), bonds.first[bonds.status == 0])].all()


def test_elements_that_nearly_stand_on_the_outline_are_taken_in() -> None:
    outline = shapely.box(0.0, 0.0, 8000.0, 4600.0)
    x, y = (a.ravel() for a in np.meshgrid(1500.0 * np.arange(6) + 40.0, 1500.0 * np.arange(4) + 1.0))
    berg = Iceberg.from_points(x, y, thickness=THICKNESS, radius=RADIUS, latlon=False, outline=outline)
    p = parameters().kernel_values()
    cells = add_new_cells(None, berg.elements, berg.bonds, berg.outlines, p)
    area = (cells.mesh.weight * cells.mesh.area).sum()
    assert outline.area < area < 1.02 * outline.area
    stiffness, given, body, xy = stiffness_of(berg.elements, berg.bonds, cells, p)
    load = loads(berg.elements, body, xy, np.random.default_rng(0).normal(size=(x.size, 3)) * 1e8)
    assert np.isfinite(StiffnessSolver(stiffness, *given).solve(load)).all()


def test_of_the_bonds_of_a_place_the_one_in_line_with_the_tension_breaks() -> None:
    berg, p = turned_beam("square", 0.0, 9000.0, 4500.0), parameters().kernel_values()
    el, bonds = berg.elements, berg.bonds
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    stiffness, (lattice, intact, *_), _, xy = stiffness_of(el, bonds, cells, p)
    for gradient, along in (([1e-3, -3e-4], 0), ([-3e-4, 1e-3], 1)):
        displacement = np.column_stack([xy * gradient, np.zeros(el.size)])
        moment = Equilibrium(lattice, intact, displacement, displacement, stiffness, None)
        strengths = Strengths(np.full(intact.size, 4e3), np.full(intact.size, 1e6))
        row, ratio = IceStress().most_critical(moment, strengths)
        assert ratio > 1.2
        assert abs((lattice.nx, lattice.ny)[along][row]) == pytest.approx(1.0)
        # A strong bond stays whole, however well it lies in line.
        strengths.normal[:] = np.where(abs((lattice.nx, lattice.ny)[along][intact]) > 0.5, 1e6, 4e3)
        row, ratio = IceStress().most_critical(moment, strengths)
        assert ratio > 1.2
        assert abs((lattice.nx, lattice.ny)[1 - along][row]) == pytest.approx(1.0)


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("packing", "angle"), [("square", 0.0), ("square", 22.5), ("square", 45.0), ("hexagonal", 15.0)]
)
@pytest.mark.parametrize("held", ["clamped", "supported"])
def test_beams_bend_as_theory_says_whatever_the_direction_of_the_lattice(packing, angle, held) -> None:
    """Ten cells across: within 5 % of a Timoshenko beam, where bonds on a turned lattice bend up to 2.5 times too far."""
    width, load = 20.0 * RADIUS, 1e6
    length = 6.0 * width
    berg = turned_beam(packing, angle, length, width)
    el = berg.elements
    x, y = el.lon.copy(), el.lat.copy()
    if held == "clamped":
        el.static[x < -0.5 * length + 2.2 * RADIUS] = 1.0
        end = x > 0.5 * length - 3.0 * RADIUS
        el.load_y[end] = -load / end.sum()
    else:
        supports = [np.argmin(np.hypot(x - side * 0.45 * length, y)) for side in (-1, 1)]
        el.free_y[supports] = 0.0
        el.static[supports[0]] = 0.0
        middle = abs(x) < 1.6 * RADIUS
        el.load_y[middle] = -load / middle.sum()
    model = Model(berg, Forcing.uniform(), parameters(packing, stepping={"time_step": 1.0}))
    model.step()
    model.step()
    down = y - model.elements.lat
    modulus, second_moment = model.parameters.bonds.youngs_modulus, THICKNESS * width**3 / 12.0
    shear = modulus / 2.6 * THICKNESS * width * 13.0 / 15.63  # 10 (1 + nu) / (12 + 11 nu), of Cowper
    if held == "clamped":
        span = x[end].mean() - x[el.static > 0.5].max()
        theory = load * span**3 / (3.0 * modulus * second_moment) + load * span / shear
        found = down[end].mean()
    else:
        span = abs(np.diff(x[supports]))[0]
        theory = load * span**3 / (48.0 * modulus * second_moment) + load * span / (4.0 * shear)
        # A support presses in the cell that it holds: the sag is taken from the ice beside it.
        beside = [(abs(x - x[s]) < 2.5 * RADIUS) & (abs(y) > 4.0 * RADIUS) for s in supports]
        found = down[middle].mean() - 0.5 * sum(down[near].mean() for near in beside)
    assert found == pytest.approx(theory, rel=0.05)


def pulled(packing: str = "square", strength: float = 1e3) -> Model:
    """A bar that is pulled towards both ends, with most tension in its middle: a little more than it bears."""
    berg = turned_beam(packing, 0.0, 18000.0, 4500.0)
    el = berg.elements
    pull = np.sin(np.pi * el.lon / 18000.0)
    el.load_x[:] = 1.02 * strength * THICKNESS * 4500.0 / pull[el.lon > 0.0].sum() * pull
    fracture = {"enabled": True, "normal_strength": strength, "shear_strength": 1e6}
    return Model(berg, Forcing.uniform(), parameters(packing, fracture=fracture, stepping={"time_step": 60.0}))


def test_a_bar_that_is_pulled_apart_parts_across_and_the_pieces_are_free_of_each_other() -> None:
    model = pulled()
    model.step()
    assert model.bonds_broken == 3
    assert model.fragment_count == 2
    broken = np.isfinite(model.bonds.break_time)
    x = model.elements.lon
    assert (abs(x[model.bonds.first] - x[model.bonds.second])[broken] > RADIUS).all()
    before = np.sort(np.unique(model.elements.berg, return_counts=True)[1])
    model.advance(steps=3)
    np.testing.assert_array_equal(np.sort(np.unique(model.elements.berg, return_counts=True)[1]), before)
    assert model.bonds.normal_stress[model.bonds.status == 0].max() < 1e3


@pytest.mark.quick(1)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_a_resumed_run_goes_on_bit_for_bit(packing, tmp_path) -> None:
    model = pulled(packing)
    model.elements.load_y[:4] = 1e8  # so that the pieces turn
    start = model.save(tmp_path / "start.nc")
    model.step()
    assert model.fragment_count > 1
    middle = model.save(tmp_path / "middle.nc")
    model.advance(steps=3)
    for path, steps in ((start, 4), (middle, 3)):
        again = Model.resume(path, Forcing.uniform())
        again.advance(steps=steps)
        for table, other in ((model.elements, again.elements), (model.bonds, again.bonds)):
            for name, array in table.arrays().items():
                np.testing.assert_array_equal(getattr(other, name), array, err_msg=name)


def test_criteria_of_the_ice_are_refused_where_stress_is_that_of_bonds() -> None:
    for criterion in ("ice", "toughness"):
        fracture = {"criterion": criterion, "toughness": 1e5}
        assert Parameters(fracture=fracture).fracture.criterion == criterion
        with pytest.raises(InputError, match=r"fracture\.criterion: it is of quasi_static: leave it out"):
            Parameters(fracture=fracture, stepping={"scheme": "mts"})
    for toughness in (0.0, -1.0):
        with pytest.raises(InputError, match="toughness"):
            Parameters(fracture={"criterion": "toughness", "toughness": toughness})


@pytest.mark.quick(2)
@pytest.mark.parametrize("angle", [0.0, 30.0])
@pytest.mark.parametrize("shape", ["rectangle", "rectangle in metres", "table", "outline"])
def test_a_berg_knows_the_outline_that_was_asked_for(shape, angle) -> None:
    options = {"thickness": 200.0, "rotation": 20.0, "lattice_angle": angle, "placement": (-38.0, -56.0)}
    latlon = shape != "rectangle in metres"
    if shape == "table":
        berg = Iceberg.from_table([(0, 0, 6), (1, 0, 6), (2, 3, 6)], **options)
    elif shape == "outline":
        corners = [(-38.3, -56.1), (-37.7, -56.1), (-37.7, -55.95), (-38.0, -56.0), (-38.3, -55.9)]
        berg = Iceberg.from_outline(corners, **options)
    elif latlon:
        berg = Iceberg.rectangle(20e3, 8e3, **options)
    else:
        berg = Iceberg.rectangle(20e3, 8e3, **{**options, "placement": (4e4, 2e4)}, latlon=False)
    assert len(berg.outlines) == 1
    assert shapely.contains_xy(
        berg.outlines[0].buffer(1e-4 if latlon else 1.0), berg.elements.lon, berg.elements.lat
    ).all()
    p = Parameters(earth={"latlon": latlon}).kernel_values()
    cells = add_new_cells(None, berg.elements, berg.bonds, berg.outlines, p)
    # Ice that reaches beyond elements close to the outline is little.
    area = (cells.mesh.weight * cells.mesh.area).sum()
    assert area == pytest.approx(berg.report["outline_area"], rel=3e-3)
    far = Iceberg.rectangle(
        3e3, 3e3, thickness=200.0, placement=(-30.0, -56.0) if latlon else (0.0, 0.0), latlon=latlon
    )
    assert len(Iceberg.join([berg, far]).outlines) == 2


@pytest.mark.quick(1)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_blocks_and_nodes_on_the_outline_are_those_of_the_matrix_added_up_number_by_number(packing) -> None:
    berg, p = turned_beam(packing, 20.0, 9000.0, 6000.0), parameters(packing).kernel_values()
    el, bonds, rng = berg.elements, berg.bonds, np.random.default_rng(5)
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    stiffness, *_ = stiffness_of(el, bonds, cells, p)
    for bond in (None, 4, 17):
        if bond is not None:
            stiffness.break_bond(bond, np.ones(3 * stiffness.topology.nodes))
        matrix = dense_matrix(stiffness)
        of, (diagonal, between) = stiffness.topology, stiffness.blocks()
        found = np.zeros((of.nodes, 3, of.nodes, 3))
        found[np.arange(of.nodes), :, np.arange(of.nodes)] = diagonal
        found[of.first, :, of.second] = between
        found[of.second, :, of.first] = between.transpose(0, 2, 1)
        np.testing.assert_allclose(found.reshape(matrix.shape), matrix, rtol=0, atol=1e-12 * matrix.max())
        displacement = rng.normal(size=(el.size, 3)) * [1.0, 1.0, 1e-3]
        every = stiffness.displacements(displacement)
        np.testing.assert_array_equal(every[: el.size], displacement)
        force = (matrix @ every.ravel()).reshape(-1, 3)
        assert abs(force[el.size :, :2]).max() < 1e-9 * abs(force).max()


def test_the_last_bond_between_two_parts_bends_as_a_beam_as_high_as_its_facet() -> None:
    """Two opposite moments on a bar that hangs together by one bond; the stress grows with the moment, and with 1 / (H w2)."""
    berg, p = turned_beam("square", 0.0, 9000.0, 3000.0), parameters().kernel_values()
    el, bonds, moment = berg.elements, berg.bonds, 3e12
    crossing = np.flatnonzero(np.sign(el.lon[bonds.first]) != np.sign(el.lon[bonds.second]))
    assert crossing.size == 2
    bonds.status[crossing[0]] = 1
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    stiffness, (lattice, intact, *_), *_ = stiffness_of(el, bonds, cells, p)
    load = np.zeros((el.size, 3))
    load[np.argmin(el.lon), 2], load[np.argmax(el.lon), 2] = moment, -moment
    found, still = stiffness.stresses(lattice, intact, 0.0 * load, load), np.zeros_like(load)
    assert intact[found.bridge].tolist() == [crossing[1]]
    side, tension = 2.0 * RADIUS, found.bond[:, 0]
    assert tension[found.bridge] == pytest.approx(moment / (THICKNESS * side**2 / 6.0), rel=1e-9)
    assert np.count_nonzero(tension) == 1
    assert stiffness.stresses(lattice, intact.copy(), still, -2.0 * load).bond[found.bridge, 0] == pytest.approx(
        2.0 * tension[found.bridge], rel=1e-12
    )


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_the_disc_ahead_of_a_tip_is_full_inside_and_half_full_at_a_straight_edge(packing) -> None:
    """The share is that of the weight exp(-d2 / 2 r2) up to 3 r, whose integral over a whole disc is 2 pi r2 (1 - exp(-4.5))."""
    berg, p = turned_beam(packing, 0.0, 45e3, 45e3), parameters(packing).kernel_values()
    el, bonds = berg.elements, berg.bonds
    stiffness, *_, xy = stiffness_of(el, bonds, add_new_cells(None, el, bonds, berg.outlines, p), p)
    nothing, radius, ahead = np.zeros((stiffness._mesh.area.size, 3)), 5000.0, np.array([1.0, 0.0])
    centre = 0.5 * (xy.min(axis=0) + xy.max(axis=0))
    edge = np.array([xy[:, 0].min() - RADIUS, centre[1]])
    assert stiffness.mean_ahead(nothing, 0, centre, ahead, radius)[1] == pytest.approx(1.0, abs=1e-3)
    assert stiffness.mean_ahead(nothing, 0, edge, ahead, radius)[1] == pytest.approx(0.5, abs=0.02)


def test_a_topology_counts_as_long_as_only_the_ice_melts() -> None:
    berg, p = turned_beam("square", 20.0, 9000.0, 6000.0), parameters().kernel_values()
    el, bonds = berg.elements, berg.bonds
    cells = add_new_cells(None, el, bonds, berg.outlines, p)
    stiffness, given, body, xy = stiffness_of(el, bonds, cells, p)
    load = loads(el, body, xy, np.random.default_rng(0).normal(size=(el.size, 3)) * [1e8, 1e8, 1e10])
    el.thickness[:] *= np.linspace(0.8, 1.0, el.size)
    thinner = CellStiffness(cells, el, bonds, body, xy, p, stiffness.topology)
    assert thinner.topology is stiffness.topology
    anew = CellStiffness(cells, el, bonds, body, xy, p)
    np.testing.assert_array_equal(
        StiffnessSolver(thinner, *given).solve(load), StiffnessSolver(anew, *given).solve(load)
    )
    assert (
        abs(StiffnessSolver(stiffness, *given).solve(load) - StiffnessSolver(thinner, *given).solve(load)).max() > 0.0
    )
    for change in (bonds.status, el.static, el.free_y):
        change[3] = 1 - change[3]
        assert CellStiffness(cells, el, bonds, body, xy, p, stiffness.topology).topology is not stiffness.topology
        change[3] = 1 - change[3]
    other = add_new_cells(None, el, bonds, berg.outlines, p)
    assert CellStiffness(other, el, bonds, body, xy, p, stiffness.topology).topology is not stiffness.topology


@pytest.mark.parametrize(("away", "goes_on"), [(0.6, True), (2.4, True), (2.6, False)])
def test_a_bond_that_fails_near_a_tip_is_the_tips_and_farther_off_begins_a_crack(away: float, goes_on: bool) -> None:
    """A row of elements 100 m apart; the bond from the first to the second fails, ``away`` elements from the tip."""
    bonds: Any = SimpleNamespace(first=np.arange(4), second=np.arange(1, 5))
    row, unused = np.column_stack([100.0 * np.arange(5), np.zeros(5)]), np.zeros(0)
    paths: Any = CrackPaths(NO_TIPS, bonds, np.arange(5), np.zeros(5, np.int64), row, unused)  # type: ignore[arg-type]
    tip = Tip(0, 0, np.array([50.0 + 100.0 * away, 0.0]), np.array([0.0, 1.0]), 100.0)
    told: list[str] = []
    paths.standing = lambda: [tip]
    paths.find_crossing = lambda tip, stress, intensity: Crossing(2, 0.5, tip)
    paths._step, paths._drop = (lambda *_: told.append("on")), lambda ended: None
    paths._start = lambda *_: told.append("new")
    bond = paths.next_bond(0, False, np.zeros(3), unused, np.full(4, 2.0), np.ones(4))
    assert (bond, told) == ((2, ["on"]) if goes_on else (0, ["new"]))
