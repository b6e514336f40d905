"""Parts of the quasi-static scheme against plain twins and against what they must conserve."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from engines.test_elastic_cells import dense_matrix, loads, stiffness_of
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.quasi_static.bodies.dynamics import (
    NEWTON_RTOL,
    allocate_body_workspace,
    half_kick_newton,
    newton_increment,
    relative_increment,
)
from riftberg.engines.quasi_static.bodies.pose import (
    bodies_from_elements,
    fill_levers,
    move_poses,
    place_elements,
    split_bodies,
)
from riftberg.engines.quasi_static.lattice import solver
from riftberg.engines.quasi_static.lattice.cells import add_new_cells
from riftberg.engines.quasi_static.lattice.equilibrium import balanced_loads, bond_deformations, find_lattice
from riftberg.engines.quasi_static.lattice.solver import StiffnessSolver
from riftberg.errors import RunError
from scripts import loaded
from twins import equilibrium as twin

square_berg = loaded("benchmarks/bench.py").square_berg

EARTH = 6_363_827.0


def levers_of(bodies, latlon: bool):
    """Levers of all elements."""
    levers = np.empty((bodies.body.size, 11))
    fill_levers(bodies, latlon, EARTH, levers)
    return levers


def moved(pose, twist, dt: float, latlon: bool):
    """Poses after a steady twist."""
    new = np.empty_like(pose)
    move_poses(pose, twist, dt, latlon, EARTH, new, np.empty((3, 3)))
    return new


@pytest.mark.parametrize("latlon", [False, True])
def test_a_berg_that_spins_goes_as_far_and_the_same_way(latlon: bool) -> None:
    """Bug: on the sphere it turned while it moved, along an arc: a small berg that spun was put 300 m inside its neighbour."""
    if latlon:
        pose = bodies_from_elements(
            np.array([-38.0]), np.array([-57.0]), np.zeros(1, np.int64), np.ones(1), True, EARTH, 360.0
        ).pose
    else:
        pose = np.eye(3)[None].copy()
    straight = moved(pose, np.array([[0.5, 0.3, 0.0]]), 1800.0, latlon)[0]
    spun = moved(pose, np.array([[0.5, 0.3, 8e-4]]), 1800.0, latlon)[0]
    np.testing.assert_allclose(spun[:, 2], straight[:, 2], rtol=0, atol=1e-13 if latlon else 1e-9)
    turn = np.arctan2(
        np.cross(straight[:, 0], spun[:, 0]) @ (straight[:, 2] if latlon else [0, 0, 1]), straight[:, 0] @ spun[:, 0]
    )
    assert turn == pytest.approx(8e-4 * 1800.0, rel=1e-6)


def floating(seed: int, packing: str, youngs: float = 5e6):
    """A lattice of uneven thickness and unequal sizes, with random forces; nothing holds it."""
    r = np.random.default_rng(seed)
    berg = Iceberg.rectangle(16e3, 11e3, thickness=200.0, radius=1500.0, packing=packing, latlon=False)
    el = berg.elements
    n = el.mass.size
    el.thickness[:] *= r.uniform(0.6, 1.4, n)
    el.length[:] *= r.uniform(0.9, 1.1, n)
    el.mass[:] = 850.0 * el.thickness * el.length * el.width
    force = np.column_stack([1e9 * r.standard_normal((n, 2)), 1e12 * r.standard_normal(n)])
    bonds = {"packing": packing, "youngs_modulus": youngs}
    p = Parameters(earth={"latlon": False, "period": 0.0}, bonds=bonds).kernel_values()
    return berg, force, p


def solver_of(berg, p):
    """Stiffness of the cells of a berg, its lattice, intact bonds and supports, their solver, and coordinates."""
    cells = add_new_cells(None, berg.elements, berg.bonds, berg.outlines, p)
    stiffness, given, body, xy = stiffness_of(berg.elements, berg.bonds, cells, p)
    return stiffness, given, StiffnessSolver(stiffness, *given), body, xy


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("seed", range(3))
def test_balanced_loads_are_those_of_the_plain_twin(seed, packing) -> None:
    berg, force, p = floating(seed, packing)
    *_, body, xy = solver_of(berg, p)
    el = berg.elements
    inertia = 0.5 * el.mass * interaction_sizes(el, p).bond_radius ** 2
    turn = np.tile([1.0, 0.0], (el.mass.size, 1))
    load = balanced_loads(body, xy, turn, force, el.mass, inertia, np.array([1e-5]))
    asked = twin.balanced(xy, el.mass, inertia, force, 1e-5)
    scale = np.abs(force).max(axis=0)
    np.testing.assert_allclose(load / scale, asked / scale, rtol=0, atol=1e-11)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_held_elements_stay_and_the_ice_of_the_others_balances_the_load(packing) -> None:
    """Against the whole stiffness matrix, added up number by number and solved for the freedoms that are left."""
    berg, force, p = floating(4, packing)
    el, n = berg.elements, berg.elements.mass.size
    el.static[np.argsort(el.lon)[:3]] = 1.0
    el.free_y[np.argsort(el.lon)[-1]] = 0.0
    stiffness, _, solver, *_ = solver_of(berg, p)
    got, of, matrix = solver.solve(force), stiffness.topology, dense_matrix(stiffness)
    held = np.zeros((of.nodes, 3), bool)
    held[:n] = (el.static >= 0.5)[:, None]
    held[:n, 1] |= el.free_y < 0.5
    held[n:, :2] = of.static[n:, None]
    left = ~held.ravel() & (np.diag(matrix) > 0.0)
    load, asked = np.zeros((of.nodes, 3)), np.zeros(3 * of.nodes)
    load[:n] = force
    asked[left] = np.linalg.solve(matrix[np.ix_(left, left)], load.ravel()[left])
    assert not got[held[:n]].any()
    size = np.abs(got).max(axis=0)
    np.testing.assert_allclose(got / size, asked.reshape(-1, 3)[:n] / size, rtol=0, atol=1e-7)


def test_stress_does_not_depend_on_youngs_modulus() -> None:
    stresses = []
    for youngs in (5e6, 9e9):
        berg, force, p = floating(1, "square", youngs)
        stiffness, given, solver, body, xy = solver_of(berg, p)
        load = loads(berg.elements, body, xy, force)
        stresses.append(stiffness.stresses(given[0], given[1], solver.solve(load), load).bond)
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=0, atol=1e-8 * np.abs(stresses[0]).max())


def test_a_load_out_of_balance_is_refused() -> None:
    """The springs that hold a fragment must carry nothing; that they do is a fault, not a stress."""
    berg, force, p = floating(1, "square")
    with pytest.raises(RunError, match="not in equilibrium"):
        solver_of(berg, p)[2].solve(force)


def test_loads_that_are_round_off_alone_are_in_balance() -> None:
    """Bug: a berg that started with the velocity of a balanced current was refused, for a freedom that carried 1e-6 N."""
    berg, force, p = floating(1, "square")
    tiny = 1e-6 * np.sign(force) * np.array([1.0, 1.0, 0.0])
    assert np.abs(solver_of(berg, p)[2].solve(tiny)).max() < 1e-9


def test_a_berg_that_goes_with_the_water_bears_nothing() -> None:
    sea = Forcing.uniform(current=(0.15, 0.0))
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.15, 0.0))
    model = Model(berg, sea, Parameters(stepping={"scheme": "quasi_static"}))
    model.advance(steps=2)
    assert model.bonds.peak_stress.max() < 1.0


def test_sides_that_melt_leave_bonds_as_they_formed() -> None:
    """Bug: levers of shorter sides and kept lengths did not add up to the bond, whose shear then turned the berg as a whole."""
    berg, _, p = floating(4, "square")
    berg.bonds.rest_length[:] = 3000.0
    *_, xy = solver_of(berg, p)
    el, intact = berg.elements, np.arange(berg.bonds.first.size)
    before = find_lattice(berg.bonds, xy, el.thickness, interaction_sizes(el, p), p)
    el.length[:] *= 0.97
    el.width[:] *= 0.97
    after = find_lattice(berg.bonds, xy, el.thickness, interaction_sizes(el, p), p)
    whole = np.column_stack([-xy[:, 1], xy[:, 0], np.ones(len(xy))])  # the berg turns as a whole
    for lattice in (before, after):
        assert bond_deformations(lattice, intact, whole) == pytest.approx(0.0, abs=1e-9)
    for name in ("width", "thickness", "stiffness", "arm_first", "arm_second"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-12), name


def test_a_melting_berg_goes_on() -> None:
    """Bug: it was refused after two hours ("a freedom that should be free carries 0.866 N")."""
    p = Parameters(stepping={"scheme": "quasi_static"}, melt={"enabled": True, "temperature": 6.0, "salinity": 34.0})
    sea = Forcing.uniform((0.4, -0.1), wind=(12.0, 2.0))
    model = Model(Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-37.0, -56.0)), sea, p)
    model.advance(days=3)
    assert model.elements.length.max() < 2995.0
    assert model.bonds_broken == 0


def sphere(seed: int, latitude: float):
    """Positions (degrees) and masses of elements about a point at a latitude."""
    r = np.random.default_rng(seed)
    lon = -38.0 + r.uniform(-0.6, 0.6, 12) / np.cos(np.radians(latitude))
    return lon, latitude + r.uniform(-0.4, 0.4, 12), r.uniform(1e12, 2e12, 12)


def distances(lon, lat):
    """Great-circle distances (m) between all pairs."""
    a, b = np.radians(lon), np.radians(lat)
    v = np.array([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])
    d = v[:, :, None] - v[:, None, :]
    return 2 * EARTH * np.arcsin(0.5 * np.sqrt((d**2).sum(axis=0)))


@pytest.mark.parametrize("latitude", [-75.0, -55.0, 0.0, 88.5])
def test_a_frame_puts_its_elements_where_they_were(latitude) -> None:
    lon, lat, mass = sphere(1, latitude)
    bodies = bodies_from_elements(lon, lat, np.zeros(12, np.int64), mass, True, EARTH, 360.0)
    x, y = lon.copy(), lat.copy()
    place_elements(bodies, x, y, np.zeros(12), True, EARTH, 360.0)
    np.testing.assert_allclose(x, lon, rtol=0, atol=1e-11)
    np.testing.assert_allclose(y, lat, rtol=0, atol=1e-12)


@pytest.mark.parametrize("latitude", [-75.0, -55.0, 0.0, 88.5])
def test_a_rigid_berg_stays_rigid_over_weeks(latitude) -> None:
    """Distances in the lattice hold to a micrometre while it drifts, turns and crosses the pole."""
    lon, lat, mass = sphere(2, latitude)
    before = distances(lon, lat)
    bodies = bodies_from_elements(lon, lat, np.zeros(12, np.int64), mass, True, EARTH, 360.0)
    pose, twist = bodies.pose, np.array([[0.31, 0.17, 2e-6]])
    for _ in range(48 * 21):
        pose = moved(pose, twist, 1800.0, True)
    place_elements(bodies._replace(pose=pose), lon, lat, np.zeros(12), True, EARTH, 360.0)
    assert np.abs(distances(lon, lat) - before).max() < 1e-6


@pytest.mark.parametrize("latlon", [True, False])
def test_velocities_of_the_elements_are_those_of_the_frame(latlon) -> None:
    """What `fill_levers` says is what a short move does, with the turn of the axes."""
    lon, lat, mass = sphere(3, -60.0)
    if not latlon:
        lon, lat = 1e5 * lon, 1e5 * lat
    bodies = bodies_from_elements(lon, lat, np.zeros(12, np.int64), mass, latlon, EARTH, 360.0 if latlon else 0.0)
    twist, dt = np.array([0.3, -0.2, 1e-5]), 1e-2
    motion = levers_of(bodies, latlon)
    ends = []
    for sign in (1.0, -1.0):
        x, y = lon.copy(), lat.copy()
        there = bodies._replace(pose=moved(bodies.pose, twist[None], sign * dt, latlon))
        place_elements(there, x, y, np.zeros(12), latlon, EARTH, 0.0)
        ends.append((x, y, levers_of(there, latlon)))
    per_unit = EARTH * np.pi / 180.0 if latlon else 1.0
    shrink = np.cos(np.radians(lat)) if latlon else 1.0
    got_u = (ends[0][0] - ends[1][0]) / (2 * dt) * per_unit * shrink
    got_v = (ends[0][1] - ends[1][1]) / (2 * dt) * per_unit
    # A difference of two longitudes has a round-off of some nanometres.
    np.testing.assert_allclose(got_u, motion[:, 0:3] @ twist, rtol=0, atol=3e-6)
    np.testing.assert_allclose(got_v, motion[:, 3:6] @ twist, rtol=0, atol=3e-6)


@pytest.mark.parametrize("turn", [0.0, 1.2])
@pytest.mark.parametrize("latlon", [True, False])
def test_pieces_that_part_stay_where_they_are_and_go_on_as_they_went(latlon, turn) -> None:
    """However the berg has turned since its start."""
    lon, lat, mass = sphere(4, -60.0)
    if not latlon:
        lon, lat = 1e5 * lon, 1e5 * lat
    bodies = bodies_from_elements(lon, lat, np.zeros(12, np.int64), mass, latlon, EARTH, 360.0 if latlon else 0.0)
    displacement = np.random.default_rng(1).standard_normal((12, 3)) * [3.0, 3.0, 1e-4]
    bodies = bodies._replace(
        pose=moved(bodies.pose, np.array([[0.0, 0.0, turn]]), 1.0, latlon), twist=np.array([[0.3, -0.2, 1e-5]])
    )
    x, y = lon.copy(), lat.copy()
    place_elements(bodies, x, y, np.zeros(12), latlon, EARTH, 0.0)  # the images of longitudes nearest to where they are
    place_elements(bodies._replace(displacement=displacement), x, y, np.zeros(12), latlon, EARTH, 0.0)
    before = levers_of(bodies, latlon)[:, :9].reshape(12, 3, 3) @ bodies.twist[0]
    pieces = split_bodies(bodies._replace(displacement=displacement), np.arange(12) // 5, mass, latlon, EARTH)
    x2, y2 = lon.copy(), lat.copy()
    place_elements(pieces, x2, y2, np.zeros(12), latlon, EARTH, 0.0)
    per_unit = EARTH * np.pi / 180.0 if latlon else 1.0
    # A turn of 1e-4 over 50 km moves by metres; what a finite turn adds to them is of second order.
    assert np.abs(x2 - x).max() * per_unit < 2e-3
    assert np.abs(y2 - y).max() * per_unit < 2e-3
    # Bug: poses took in what load had moved the pieces by, so faces of a crack stood metres apart or in each other in soft ice.
    for parts, a, b in ((bodies, x, y), (pieces, x2, y2)):
        place_elements(parts._replace(displacement=np.zeros((12, 3))), a, b, np.zeros(12), latlon, EARTH, 0.0)
    assert np.abs(x2 - x).max() * per_unit < 1e-6
    assert np.abs(y2 - y).max() * per_unit < 1e-6
    pieces = split_bodies(bodies, np.arange(12) // 5, mass, latlon, EARTH)
    motion = levers_of(pieces, latlon)[:, :9].reshape(12, 3, 3)
    after = np.einsum("eij,ej->ei", motion, pieces.twist[pieces.body])
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-10)


def test_a_spin_that_is_round_off_does_not_keep_the_velocities_from_settling() -> None:
    """Bug: a berg of 10,000 elements that does not turn was refused after 50 passes, for its spin changed by 1e-21 s-1."""
    inertia, now = np.diag([1e14, 1e14, 1e23]), np.array([0.2, 0.0, 1e-20])
    assert relative_increment(np.array([1e-17, 1e-17, 1e-20]), now, inertia) <= NEWTON_RTOL
    # Half a micrometre a second at the radius of gyration (32 km), or of the centre, does count.
    assert relative_increment(np.array([0.0, 0.0, 1.6e-11]), now, inertia) > NEWTON_RTOL
    assert relative_increment(np.array([5e-7, 0.0, 0.0]), now, inertia) > NEWTON_RTOL
    # For a fragment that stands too, but not what is round-off of the forces on it.
    assert relative_increment(np.array([1e-12, 0.0, 0.0]), np.zeros(3), inertia) > NEWTON_RTOL
    assert relative_increment(np.array([1e-17, 0.0, 1e-22]), np.zeros(3), inertia) <= NEWTON_RTOL


@pytest.mark.quick(1)
@pytest.mark.parametrize("guess", [1e-4, 1e-2, 0.3, 10.0])
def test_newtons_method_ends_where_another_pass_would_bring_nothing(guess) -> None:
    """It ends without the pass that the last two say would change the velocities by less than 1e-11 of them."""
    model = square_berg(30, lambda p: p.adapted(stepping={"scheme": "quasi_static"})[0])
    model.forcing = Forcing.uniform(current=(0.2, -0.1), wind=(9.0, 4.0))
    model.advance(steps=2)
    now = model._stepper.memory.state  # type: ignore[attr-defined]
    op, middle, work = now.operators, now.bodies.twist, allocate_body_workspace(1)
    twist = middle + guess * np.array([[0.1, -0.3, 1e-6]])
    work.active[:] = True
    iterations = half_kick_newton(op, middle, twist, 900.0, work)
    assert 1 < iterations < 8
    work.active[:] = True
    newton_increment(op, middle, twist, 900.0, work)
    assert relative_increment(work.increment[0], twist[0], op.matrices.inertia[0]) < 1e-10


def test_a_large_berg_that_does_not_turn_is_stepped() -> None:
    model = square_berg(2500, lambda p: p.adapted(stepping={"scheme": "quasi_static"})[0])
    model.advance(steps=2)
    assert model.elements.u.min() > 0.0
    assert np.ptp(model.elements.u) < 1e-9


@pytest.mark.quick(1)
@pytest.mark.parametrize("where", ["process", "forcing"])
def test_a_step_that_was_taken_back_is_taken_again_as_if_it_had_not_failed(where, monkeypatch) -> None:
    """It was lost: bodies and what was known of the lattice stayed those of the failed step."""
    weak = {"enabled": True, "normal_strength": 40.0}
    smooth, rough = (
        square_berg(30, lambda p: p.adapted(stepping={"scheme": "quasi_static"}, fracture=weak)[0]) for _ in range(2)
    )
    smooth.advance(steps=6)
    rough.advance(steps=3)

    def fail(*args: object) -> None:
        raise RuntimeError("it failed")

    if where == "process":
        rough.after_step.append(fail)
    else:
        monkeypatch.setattr(type(rough.forcing), "sample", fail)
    with pytest.raises(RuntimeError, match="it failed"):
        rough.step()
    rough.after_step.clear()
    monkeypatch.undo()
    rough.advance(steps=3)
    assert smooth.bonds_broken > 0
    for name, array in smooth.elements.arrays().items():
        np.testing.assert_array_equal(array, getattr(rough.elements, name), err_msg=name)
    np.testing.assert_array_equal(smooth.bonds.status, rough.bonds.status)


class Stretching(Forcing.uniform):
    """A current that pulls a berg apart along x."""

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.uo[:] = elements.lon / 60e3


@pytest.mark.slow
@pytest.mark.compiled
def test_a_crack_runs_through_thin_ice_up_to_its_last_bond(monkeypatch) -> None:
    """Bug: ice 10 m thick ended in a RunError. On their last bond the halves turn far, and round-off with them."""
    berg = Iceberg.rectangle(240e3, 22.5e3, thickness=10.0, radius=750.0, latlon=False)
    e, b = berg.elements, berg.bonds
    across = (e.lon[b.first] < -1.0) != (e.lon[b.second] < -1.0)
    b.status[across & (0.5 * (e.lat[b.first] + e.lat[b.second]) > 5e3)] = 1

    def pulled() -> Model:
        p = Parameters(
            earth={"latlon": False, "period": 0.0}, fracture={"normal_strength": "3 kPa"},
            stepping={"time_step": 1800.0},
        )  # fmt: skip
        model = Model(berg, Stretching(), p)
        model.step()
        return model

    model = pulled()
    broken = model.bonds.status != 0
    assert broken[across].all()
    monkeypatch.setattr(solver, "ROUND_OFF", 0.0)
    with pytest.raises(RunError, match="not in equilibrium"):
        pulled()


def test_fragments_see_each_other_without_the_displacements_of_their_loads() -> None:
    """Seen bent, a slender piece came out of contact in one step and deeper into it in the next."""
    plane = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
    parameters = Parameters(earth=plane, bonds={"youngs_modulus": 1e6}, fracture={"enabled": False})
    made = [
        Iceberg.rectangle(12e3, 3e3, thickness=200.0, radius=750.0, latlon=False, placement=(x, 0.0))
        for x in (0.0, 20e3)
    ]
    eddy = Forcing.eddy((0.0, 4e3), radius=8e3, speed=0.5, latlon=False, latitude=-55.0)
    for bergs in (made, made[:1]):
        model = Model(Iceberg.join(bergs), eddy, parameters)
        model.advance(steps=3)
        el, b = model.elements, model.bonds
        bent, seen = (
            np.abs(np.hypot(x[b.first] - x[b.second], y[b.first] - y[b.second]) - 1500.0).max()
            for x, y in ((el.lon, el.lat), (el.lon_pair, el.lat_pair))
        )
        assert bent > 1e-3
        assert (seen < 1e-6) == (len(bergs) == 2)


def test_a_model_that_is_needed_no_more_goes_at_once() -> None:
    """Bug: it and its lattice held each other until Python looked for cycles, 1 to 2 MiB of each member of an ensemble."""
    berg = Iceberg.rectangle("12 km", "6 km", thickness=200.0, placement=(-37.0, -56.0))
    model = Model(berg, Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)))
    model.step()
    gone = weakref.ref(model)
    was_on = gc.isenabled()
    gc.disable()
    try:
        del model
        assert gone() is None
    finally:
        if was_on:
            gc.enable()
