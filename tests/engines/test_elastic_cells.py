"""Elastic cells in the default scheme: factors after breaks, frames of fragments, melt and births, beams, restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from engines.lattices import stiffness_matrix
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.errors import InputError, RunError
from verification.plates import RADIUS, THICKNESS, Plate

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


def dense_matrix(stiffness):
    """Stiffness of all nodes, added up number by number."""
    of = stiffness.topology
    return stiffness_matrix(of.at, stiffness._triangles.stiffness, of.nodes).toarray()


def random_forces(plate: Plate, seed: int):
    """Forces (N, N, N m) on the elements, without order."""
    return np.random.default_rng(seed).normal(size=(plate.el.size, 3)) * [1e8, 1e8, 1e10]


def count_pieces(plate: Plate) -> int:
    """Pieces that the intact bonds leave."""
    b = plate.bonds
    intact = b.status == 0
    graph = coo_matrix((np.ones(intact.sum()), (b.first[intact], b.second[intact])), shape=(plate.el.size,) * 2)
    return int(connected_components(graph, directed=False)[0])


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 22.5), ("hexagonal", 15.0)])
def test_factors_after_breaks_are_those_without_the_bonds_and_every_break_gives_way(packing, angle) -> None:
    plate = Plate(packing, angle, 9000.0, 6000.0)
    lattice, status, load = plate.now, plate.bonds.status, plate.loads(random_forces(plate, 2))
    yielded = [(lattice.displacements(load) * load).sum()]
    for bond in np.random.default_rng(3).permutation(status.size):
        status[bond] = 1
        if count_pieces(plate) > 1:
            status[bond] = 0  # as it parts the berg; the others go on
            continue
        lattice.remove(bond)
        displacement = lattice.displacements(load)
        yielded.append((displacement * load).sum())
    assert (np.diff(yielded) > -1e-9 * yielded[-1]).all()
    assert lattice.update_rank > 50
    plate.refresh()
    fresh = plate.now.displacements(load)
    assert plate.now.update_rank == 0
    size = abs(fresh).max(axis=0)
    np.testing.assert_allclose(displacement / size, fresh / size, rtol=0, atol=1e-6)
    stress = plate.now.moment(fresh, load).tensor
    scale = abs(stress).max()
    np.testing.assert_allclose(lattice.moment(fresh, load).tensor / scale, stress / scale, rtol=0, atol=1e-9)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_stress_is_read_in_the_frame_of_the_fragment_however_the_berg_has_turned(packing) -> None:
    plate = Plate(packing, 15.0, 15000.0, 9000.0)
    el, bonds, x, y, (c, s) = plate.el, plate.bonds, plate.x, plate.y, (np.cos(0.7), np.sin(0.7))
    el.lon[:], el.lat[:] = 1e5 + c * x - s * y, 3e4 + s * x + c * y
    plate.refresh()
    xy = plate.now.xy
    np.testing.assert_allclose(xy[:, 0] - xy[0, 0], (c * x - s * y) - (c * x - s * y)[0], rtol=0, atol=1e-6)
    displacement = np.column_stack([1e-3 * xy[:, 0], -3e-4 * xy[:, 1], np.zeros(el.size)])
    stress = plate.now.moment(displacement, np.zeros((el.size, 3))).tensor
    inner = (abs(x) < 4000.0) & (abs(y) < 2000.0)
    inner = inner[bonds.first] & inner[bonds.second]
    assert inner.sum() > 10
    tension = 1e-3 * plate.model.parameters.bonds.youngs_modulus
    np.testing.assert_allclose(
        stress[inner], np.tile([tension, 0.0, 0.0], (inner.sum(), 1)), rtol=0, atol=1e-8 * tension
    )


def test_ice_that_has_melted_away_holds_nothing_and_the_rest_is_as_if_its_bonds_had_broken() -> None:
    melted, plate = (Plate("hexagonal", 15.0, 9000.0, 6000.0) for _ in range(2))
    gone, bonds = np.array([3, 11]), plate.bonds
    rest = np.setdiff1d(np.arange(plate.el.size), gone)
    melted.model.remove(plate.el.id[gone])
    melted.el, melted.bonds = melted.model.elements, melted.model.bonds
    assert melted.el.size == rest.size
    melted.refresh()
    load = melted.loads(random_forces(melted, 0))
    displacement = melted.now.displacements(load)

    bonds.status[np.isin(bonds.first, gone) | np.isin(bonds.second, gone)] = 1
    plate.refresh()
    every = np.zeros((plate.el.size, 3))
    every[rest] = load
    held = plate.now.displacements(every)[rest]
    # Both differ by a rigid motion, as their gauge springs hold other elements.
    assert np.ptp(plate.body[rest]) == 0
    x, y = plate.now.xy[rest].T
    one, none = np.ones(rest.size), np.zeros(rest.size)
    rigid = (
        np.stack([np.stack([one, none, none]), np.stack([none, one, none]), np.stack([-y, x, one])]).reshape(3, -1).T
    )
    apart = (displacement - held).T.ravel()
    apart -= rigid @ np.linalg.lstsq(rigid, apart, rcond=None)[0]
    assert abs(apart).max() < 1e-8 * abs(held).max()


def test_newly_born_get_cells_of_their_own_unless_they_hang_on_older_ice() -> None:
    plate, hanging = (Plate("square", 0.0, 6000.0, 3000.0) for _ in range(2))
    born = Iceberg.rectangle(3000.0, 1500.0, thickness=THICKNESS, radius=RADIUS, latlon=False, placement=(9e4, 0.0))
    for model in (plate.model, hanging.model):
        model.append(born.elements, born.bonds)
    plate.refresh()
    cells = plate.memory.cells
    assert cells.mesh.cells == plate.el.size + 2
    assert plate.area == pytest.approx(6000.0 * 3000.0 + 3000.0 * 1500.0, rel=1e-9)
    plate.refresh(topology=None)
    assert plate.memory.cells is cells
    hanging.model.bonds.first[-1] = 0
    with pytest.raises(RunError, match="bonded to older ones"):
        hanging.refresh()


def test_rifts_that_are_there_from_the_start_part_the_ice() -> None:
    cut = turned_beam("square", 0.0, 12000.0, 3000.0).with_rifts([[(0.0, -2000.0), (0.0, 2000.0)]], broken=True)
    plate = Plate.of(cut)
    assert plate.area == pytest.approx(12000.0 * 3000.0, rel=1e-12)
    assert plate.body.max() == 1
    matrix = dense_matrix(plate.now.cells)
    left, right = (3 * np.flatnonzero(plate.body == b)[:, None] + np.arange(3) for b in (0, 1))
    assert abs(matrix[np.ix_(left.ravel(), right.ravel())]).max() == 0.0
    # Bonds that are not even in the list part it too: elements of two pieces of one outline.
    other = Plate.of(replace(cut, bonds=cut.bonds.taken(cut.bonds.status == 0))).now.cells
    np.testing.assert_allclose(dense_matrix(other), matrix, rtol=0, atol=1e-12 * abs(matrix).max())


def test_without_an_outline_the_ice_ends_where_its_elements_do() -> None:
    berg = turned_beam("square", 0.0, 9000.0, 4500.0)
    with_outline, without = (dense_matrix(Plate.of(b).now.cells) for b in (berg, replace(berg, outlines=())))
    assert np.linalg.norm(without) == pytest.approx(np.linalg.norm(with_outline), rel=1e-3)
    scattered = Iceberg.from_points(
        [0.0, 1800.0, 3600.0], [0.0, 0.0, 0.0], thickness=THICKNESS, radius=RADIUS, latlon=False
    )
    assert Plate.of(replace(scattered, outlines=())).area == pytest.approx(5100.0 * 1500.0, rel=1e-6)


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
    plate, rng = Plate.of(berg), np.random.default_rng(3)
    bonds = plate.bonds
    assert bonds.first.size == 22
    for broken in (0, 1, 3, 6, 12, 22):
        bonds.status[:] = 0
        bonds.status[rng.permutation(22)[:broken]] = 1
        plate.refresh()
        stiffness = plate.now.cells
        if broken == 22:  # lone cells have no triangles
            assert stiffness is None
            break
        held = np.diag(dense_matrix(stiffness)).reshape(-1, 3)[: plate.el.size].max(axis=1) > 0.0
        assert zero_modes(stiffness) == 3 * np.unique(plate.body[held]).size, broken
        assert held[np.isin(np.arange(15), bonds.first[bonds.status == 0])].all()


def test_elements_that_nearly_stand_on_the_outline_are_taken_in() -> None:
    outline = shapely.box(0.0, 0.0, 8000.0, 4600.0)
    x, y = (a.ravel() for a in np.meshgrid(1500.0 * np.arange(6) + 40.0, 1500.0 * np.arange(4) + 1.0))
    plate = Plate.of(Iceberg.from_points(x, y, thickness=THICKNESS, radius=RADIUS, latlon=False, outline=outline))
    assert outline.area < plate.area < 1.02 * outline.area
    assert np.isfinite(plate.bearing(random_forces(plate, 0)).displacement).all()


def test_of_the_bonds_of_a_place_the_one_in_line_with_the_tension_breaks() -> None:
    for gradient, along in (([1e-3, -3e-4], 0), ([-3e-4, 1e-3], 1)):
        plate = Plate("square", 0.0, 9000.0, 4500.0, normal_strength=4e3, shear_strength=1e6)
        way = abs(np.array([plate.now.lattice.nx, plate.now.lattice.ny]))
        displacement = np.column_stack([plate.now.xy * gradient, np.zeros(plate.el.size)])
        moment = plate.now.moment(displacement, displacement)
        bond, ratio = plate.critical(moment)
        assert ratio > 1.2
        assert way[along, bond] == pytest.approx(1.0)
        # A strong bond stays whole, however well it lies in line.
        plate.bonds.strength[way[along] > 0.5] = 250.0
        bond, ratio = plate.critical(moment)
        assert ratio > 1.2
        assert way[1 - along, bond] == pytest.approx(1.0)


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
    # Ice that reaches beyond elements close to the outline is little.
    assert Plate.of(berg).area == pytest.approx(berg.report["outline_area"], rel=3e-3)
    far = Iceberg.rectangle(
        3e3, 3e3, thickness=200.0, placement=(-30.0, -56.0) if latlon else (0.0, 0.0), latlon=latlon
    )
    assert len(Iceberg.join([berg, far]).outlines) == 2


@pytest.mark.quick(1)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_blocks_and_nodes_on_the_outline_are_those_of_the_matrix_added_up_number_by_number(packing) -> None:
    plate, rng = Plate(packing, 20.0, 9000.0, 6000.0), np.random.default_rng(5)
    stiffness, elements = plate.now.cells, plate.el.size
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
        displacement = rng.normal(size=(elements, 3)) * [1.0, 1.0, 1e-3]
        every = stiffness.displacements(displacement)
        np.testing.assert_array_equal(every[:elements], displacement)
        force = (matrix @ every.ravel()).reshape(-1, 3)
        assert abs(force[elements:, :2]).max() < 1e-9 * abs(force).max()


def test_the_last_bond_between_two_parts_bends_as_a_beam_as_high_as_its_facet() -> None:
    """Two opposite moments on a bar that hangs together by one bond; the stress grows with the moment, and with 1 / (H w2)."""
    plate, moment = Plate("square", 0.0, 9000.0, 3000.0), 3e12
    x, bonds = plate.x, plate.bonds
    crossing = np.flatnonzero(np.sign(x[bonds.first]) != np.sign(x[bonds.second]))
    assert crossing.size == 2
    bonds.status[crossing[0]] = 1
    plate.refresh()
    load = np.zeros((x.size, 3))
    load[np.argmin(x), 2], load[np.argmax(x), 2] = moment, -moment
    found, twice = (plate.now.moment(0.0 * load, factor * load) for factor in (1.0, -2.0))
    assert found.intact[found.bridges].tolist() == [crossing[1]]
    side, tension = 2.0 * RADIUS, found.stress[:, 0]
    assert tension[found.bridges] == pytest.approx(moment / (THICKNESS * side**2 / 6.0), rel=1e-9)
    assert np.count_nonzero(tension) == 1
    assert twice.stress[found.bridges, 0] == pytest.approx(2.0 * tension[found.bridges], rel=1e-12)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_the_disc_ahead_of_a_tip_is_full_inside_and_half_full_at_a_straight_edge(packing) -> None:
    """The share is that of the weight exp(-d2 / 2 r2) up to 3 r, whose integral over a whole disc is 2 pi r2 (1 - exp(-4.5))."""
    plate = Plate(packing, 0.0, 45e3, 45e3)
    cells, xy, radius, ahead = plate.now.cells, plate.now.xy, 5000.0, np.array([1.0, 0.0])
    nothing = np.zeros((cells._mesh.area.size, 3))
    centre = 0.5 * (xy.min(axis=0) + xy.max(axis=0))
    edge = np.array([xy[:, 0].min() - RADIUS, centre[1]])
    assert cells.mean_ahead(nothing, 0, centre, ahead, radius)[1] == pytest.approx(1.0, abs=1e-3)
    assert cells.mean_ahead(nothing, 0, edge, ahead, radius)[1] == pytest.approx(0.5, abs=0.02)


def test_a_topology_counts_as_long_as_only_the_ice_melts() -> None:
    plate, other = (Plate("square", 20.0, 9000.0, 6000.0) for _ in range(2))
    thick, topology, load = plate.now, plate.now.topology, plate.loads(random_forces(plate, 0))
    plate.el.thickness[:] *= np.linspace(0.8, 1.0, plate.el.size)
    plate.refresh()
    thinner = plate.now
    assert thinner.topology is topology
    plate.refresh(topology=None)
    assert plate.now.topology is not topology
    np.testing.assert_array_equal(thinner.displacements(load), plate.now.displacements(load))
    assert abs(thick.displacements(load) - thinner.displacements(load)).max() > 0.0
    for change in (plate.bonds.status, plate.el.static, plate.el.free_y):
        topology = plate.now.topology
        change[3] = 1 - change[3]
        plate.refresh()
        assert plate.now.topology is not topology
    topology = plate.now.topology
    plate.refresh(cells=other.memory.cells)
    assert plate.now.topology is not topology


@pytest.mark.parametrize(("away", "goes_on"), [(0.6, True), (2.4, True), (2.6, False)])
def test_a_bond_that_fails_near_a_tip_is_the_tips_and_farther_off_begins_a_crack(away: float, goes_on: bool) -> None:
    """A rift in squares, whose upper tip is put ``away`` elements below the bond that fails."""
    berg = turned_beam("square", 0.0, 18e3, 18e3).with_rifts([[(100.0, -3e3), (100.0, 3e3)]], broken=True)
    plate = Plate.of(berg)
    bonds, tips = plate.bonds, plate.tips
    first, second = bonds.first, bonds.second
    failing = int(np.argmin(np.hypot(plate.x[first] + plate.x[second], plate.y[first] + plate.y[second] - 13.5e3)))
    upper = max(plate.now.paths.standing(), key=lambda tip: tip.place[1])
    i, j = plate.model.population.rows(tips.beside[upper.row])
    along = np.array([plate.x[j] - plate.x[i], plate.y[j] - plate.y[i]]) / (2.0 * RADIUS)
    place = tips.place.copy()
    rise = 6750.0 - away * 2.0 * RADIUS - upper.place[1]
    place[upper.row] += [along[1] * rise, along[0] * rise]
    plate.refresh(tips=tips._replace(place=place))
    bond = plate.now.next_bond(plate.under(plate.el.mass * plate.x), failing)
    assert bonds.crack[bond] == (1 if goes_on else 2)
    assert plate.now.tips.crack.tolist() == ([1, 1] if goes_on else [1, 1, 2, 2])
    assert (bond == failing) == (away == 0.6 or not goes_on)
