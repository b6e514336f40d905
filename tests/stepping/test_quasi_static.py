"""Parts of the quasi-static scheme against plain twins and against what they must conserve."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.diagnostics.speed import square_berg
from riftberg.errors import RunError
from riftberg.ocean.ready_made import Forcing
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from riftberg.stepping.bodies.pose import element_motion, flat_shape, free_bodies, moved_frames, place, regrouped
from riftberg.stepping.bodies.dynamics import CLOSE_ENOUGH, _change, allocate_body_room, close_step, newton_step
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.lattice.equilibrium import (
    Factors,
    Holds,
    balanced_loads,
    bond_stresses,
    deformed,
    elastic_energy,
    find_lattice,
)
from twins import equilibrium as twin

EARTH = 6_363_827.0


def floating(seed: int, packing: str):
    """A lattice of uneven thickness and unequal sizes, with random forces; nothing holds it."""
    r = np.random.default_rng(seed)
    berg = Iceberg.rectangle(16e3, 11e3, thickness=200.0, radius=1500.0, packing=packing, latlon=False)
    el = berg.elements
    n = el.mass.size
    el.thickness[:] *= r.uniform(0.6, 1.4, n)
    el.length[:] *= r.uniform(0.9, 1.1, n)
    el.mass[:] = 850.0 * el.thickness * el.length * el.width
    force = np.column_stack([1e9 * r.standard_normal((n, 2)), 1e12 * r.standard_normal(n)])
    p = Parameters(earth={"latlon": False, "period": 0.0}, bonds={"packing": packing}).kernel_values()
    return berg, force, p


def solved(berg, force, p, spin: float = 0.0):
    """Flat places, lattice, factors, loads and sizes of a berg that floats freely."""
    el, bonds = berg.elements, berg.bonds
    body = np.zeros(el.mass.size, np.int64)
    bodies = free_bodies(el.lon, el.lat, body, el.mass, False, 1.0, 0.0)
    sizes = interaction_sizes(el, p)
    flat = flat_shape(bodies.shape, False, 1.0)
    lattice = find_lattice(bonds, flat, el.thickness, sizes, p)
    alive = np.arange(bonds.first.size)
    holds = Holds(el.static, el.free_y)
    inertia = 0.5 * el.mass * sizes.bond_radius**2
    turn = np.tile([1.0, 0.0], (el.mass.size, 1))
    load = balanced_loads(body, flat, turn, force, el.mass, inertia, np.array([spin]))
    return flat, lattice, alive, holds, load, sizes, inertia, body


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("seed", range(3))
def test_equilibrium_is_that_of_the_plain_twin(seed, packing) -> None:
    berg, force, p = floating(seed, packing)
    flat, lattice, alive, holds, load, sizes, inertia, body = solved(berg, force, p, spin=1e-5)
    asked_load = twin.balanced(flat, berg.elements.mass, inertia, force, 1e-5)
    scale = np.abs(force).max(axis=0)
    np.testing.assert_allclose(load / scale, asked_load / scale, rtol=0, atol=1e-11)
    factors = Factors(lattice, alive, holds, holds.springs(body, flat))
    got = bond_stresses(lattice, alive, factors.solve(load), p)
    pairs = list(zip(berg.bonds.first, berg.bonds.second, strict=True))
    _, asked = twin.equilibrium(
        flat, pairs, sizes.bond_radius, berg.elements.thickness, asked_load, p.youngs_modulus, p.poisson
    )
    np.testing.assert_allclose(got, asked, rtol=0, atol=1e-7 * np.abs(asked).max())


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_corrected_factors_are_those_without_the_bonds(packing) -> None:
    berg, force, p = floating(5, packing)
    flat, lattice, alive, holds, load, *_, body = solved(berg, force, p)
    springs = holds.springs(body, flat)
    corrected = Factors(lattice, alive, holds, springs)
    gone = [3, 10, 17]
    for bond in gone:
        corrected.without(bond)
    left = np.setdiff1d(alive, gone)
    fresh = Factors(lattice, left, holds, springs)
    got = bond_stresses(lattice, left, corrected.solve(load), p)
    asked = bond_stresses(lattice, left, fresh.solve(load), p)
    np.testing.assert_allclose(got, asked, rtol=0, atol=1e-8 * np.abs(asked).max())


def test_stress_does_not_depend_on_youngs_modulus() -> None:
    stresses = []
    for youngs in (5e6, 9e9):
        berg, force, _ = floating(1, "square")
        p = Parameters(earth={"latlon": False, "period": 0.0}, bonds={"youngs_modulus": youngs}).kernel_values()
        flat, lattice, alive, holds, load, *_, body = solved(berg, force, p)
        factors = Factors(lattice, alive, holds, holds.springs(body, flat))
        stresses.append(bond_stresses(lattice, alive, factors.solve(load), p))
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=0, atol=1e-8 * np.abs(stresses[0]).max())


def test_a_load_out_of_balance_is_refused() -> None:
    """The springs that hold a fragment must carry nothing; that they do is a fault, not a stress."""
    berg, force, p = floating(1, "square")
    flat, lattice, alive, holds, *_, body = solved(berg, force, p)
    factors = Factors(lattice, alive, holds, holds.springs(body, flat))
    with pytest.raises(RunError, match="not in equilibrium"):
        factors.solve(force)


def test_loads_that_are_round_off_alone_are_in_balance() -> None:
    """Bug: a berg that started with the velocity of a balanced current was refused, for a freedom that carried 1e-6 N."""
    berg, force, p = floating(1, "square")
    flat, lattice, alive, holds, *_, body = solved(berg, force, p)
    factors = Factors(lattice, alive, holds, holds.springs(body, flat))
    tiny = 1e-6 * np.sign(force) * np.array([1.0, 1.0, 0.0])
    assert np.abs(factors.solve(tiny)).max() < 1e-9


def test_a_berg_that_goes_with_the_water_bears_nothing() -> None:
    sea = Forcing.uniform(current=(0.15, 0.0))
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.15, 0.0))
    model = Model(berg, sea, Parameters(stepping={"scheme": "quasi_static"}))
    model.advance(steps=2)
    assert model.bonds.peak_stress.max() < 1.0


def test_energy_is_that_of_the_springs() -> None:
    berg, force, p = floating(2, "square")
    flat, lattice, alive, holds, load, sizes, *_, body = solved(berg, force, p)
    bend = Factors(lattice, alive, holds, holds.springs(body, flat)).solve(load)
    stored = 0.0
    for i, j in zip(berg.bonds.first, berg.bonds.second, strict=True):
        t = berg.elements.thickness
        k, rows, *_ = twin.bond_matrix(
            flat[i], flat[j], sizes.bond_radius[i], sizes.bond_radius[j], t[i], t[j], p.youngs_modulus, p.poisson
        )
        stored += 0.5 * k @ (rows @ np.concatenate([bend[i], bend[j]])) ** 2
    assert elastic_energy(bend, load) == pytest.approx(stored, rel=1e-8)


def test_sides_that_melt_leave_bonds_as_they_formed() -> None:
    """Bug: levers of shorter sides and kept lengths did not add up to the bond, whose shear then turned the berg as a whole."""
    berg, force, p = floating(4, "square")
    berg.bonds.rest_length[:] = 3000.0
    before = solved(berg, force, p)
    berg.elements.length[:] *= 0.97
    berg.elements.width[:] *= 0.97
    after = solved(berg, force, p)
    load, bends = before[4], []
    for flat, lattice, alive, holds, *_, body in (before, after):
        bends.append(Factors(lattice, alive, holds, holds.springs(body, flat)).solve(load))
        whole = np.column_stack([-flat[:, 1], flat[:, 0], np.ones(len(flat))])  # the berg turns as a whole
        for b in alive:
            assert deformed(lattice, whole, int(b)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    for name in ("width", "thickness", "stiffness", "arm_first", "arm_second"):
        assert getattr(after[1], name) == pytest.approx(getattr(before[1], name), rel=1e-12), name
    assert bends[1] == pytest.approx(bends[0], rel=1e-9, abs=1e-12 * np.abs(bends[0]).max())


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
    bodies = free_bodies(lon, lat, np.zeros(12, np.int64), mass, True, EARTH, 360.0)
    x, y = lon.copy(), lat.copy()
    place(bodies, x, y, np.zeros(12), True, EARTH, 360.0)
    np.testing.assert_allclose(x, lon, rtol=0, atol=1e-11)
    np.testing.assert_allclose(y, lat, rtol=0, atol=1e-12)


@pytest.mark.parametrize("latitude", [-75.0, -55.0, 0.0, 88.5])
def test_a_rigid_berg_stays_rigid_over_weeks(latitude) -> None:
    """Distances in the lattice hold to a micrometre while it drifts, turns and crosses the pole."""
    lon, lat, mass = sphere(2, latitude)
    before = distances(lon, lat)
    bodies = free_bodies(lon, lat, np.zeros(12, np.int64), mass, True, EARTH, 360.0)
    pose, rate = bodies.pose, np.array([[0.31, 0.17, 2e-6]])
    for _ in range(48 * 21):
        pose = moved_frames(pose, rate, 1800.0, True, EARTH)
    place(bodies._replace(pose=pose), lon, lat, np.zeros(12), True, EARTH, 360.0)
    assert np.abs(distances(lon, lat) - before).max() < 1e-6


@pytest.mark.parametrize("latlon", [True, False])
def test_velocities_of_the_elements_are_those_of_the_frame(latlon) -> None:
    """What `element_motion` says is what a short move does, with the turn of the axes."""
    lon, lat, mass = sphere(3, -60.0)
    if not latlon:
        lon, lat = 1e5 * lon, 1e5 * lat
    bodies = free_bodies(lon, lat, np.zeros(12, np.int64), mass, latlon, EARTH, 360.0 if latlon else 0.0)
    rate, dt = np.array([0.3, -0.2, 1e-5]), 1e-2
    motion = element_motion(bodies, latlon, EARTH)
    ends = []
    for sign in (1.0, -1.0):
        x, y = lon.copy(), lat.copy()
        there = bodies._replace(pose=moved_frames(bodies.pose, rate[None], sign * dt, latlon, EARTH))
        place(there, x, y, np.zeros(12), latlon, EARTH, 0.0)
        ends.append((x, y, element_motion(there, latlon, EARTH)))
    per_unit = EARTH * np.pi / 180.0 if latlon else 1.0
    shrink = np.cos(np.radians(lat)) if latlon else 1.0
    got_u = (ends[0][0] - ends[1][0]) / (2 * dt) * per_unit * shrink
    got_v = (ends[0][1] - ends[1][1]) / (2 * dt) * per_unit
    # A difference of two longitudes has a round-off of some nanometres.
    np.testing.assert_allclose(got_u, motion[:, 0:3] @ rate, rtol=0, atol=3e-6)
    np.testing.assert_allclose(got_v, motion[:, 3:6] @ rate, rtol=0, atol=3e-6)


@pytest.mark.parametrize("latlon", [True, False])
def test_pieces_that_part_stay_where_they_are_and_go_on_as_they_went(latlon) -> None:
    lon, lat, mass = sphere(4, -60.0)
    if not latlon:
        lon, lat = 1e5 * lon, 1e5 * lat
    inertia = 0.5 * mass * 1500.0**2
    bodies = free_bodies(lon, lat, np.zeros(12, np.int64), mass, latlon, EARTH, 360.0 if latlon else 0.0)
    bend = np.random.default_rng(1).standard_normal((12, 3)) * [3.0, 3.0, 1e-4]
    bodies = bodies._replace(rate=np.array([[0.3, -0.2, 1e-5]]))
    x, y = lon.copy(), lat.copy()
    place(bodies._replace(bend=bend), x, y, np.zeros(12), latlon, EARTH, 0.0)
    before = element_motion(bodies, latlon, EARTH)[:, :9].reshape(12, 3, 3) @ bodies.rate[0]
    pieces = regrouped(bodies._replace(bend=bend), np.arange(12) // 5, mass, inertia, latlon, EARTH)
    x2, y2 = lon.copy(), lat.copy()
    place(pieces, x2, y2, np.zeros(12), latlon, EARTH, 0.0)
    per_unit = EARTH * np.pi / 180.0 if latlon else 1.0
    # A turn of 1e-4 over 50 km moves by metres; what a finite turn adds to them is of second order.
    assert np.abs(x2 - x).max() * per_unit < 2e-3
    assert np.abs(y2 - y).max() * per_unit < 2e-3
    pieces = regrouped(bodies, np.arange(12) // 5, mass, inertia, latlon, EARTH)
    motion = element_motion(pieces, latlon, EARTH)[:, :9].reshape(12, 3, 3)
    after = np.einsum("eij,ej->ei", motion, pieces.rate[pieces.body])
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-10)


def test_a_berg_of_single_elements_is_in_equilibrium_whatever_the_rounding_of_its_loads() -> None:
    """A berg whose last bond had broken was taken for a mechanism: all loads were rounding, and the springs carried them."""
    berg, force, p = floating(1, "square")
    flat, lattice, alive, holds, *_ = solved(berg, force, p)
    count = berg.elements.mass.size
    factors = Factors(lattice, alive[:0], holds, holds.springs(np.arange(count), flat))
    bend = factors.solve(np.full((count, 3), 6e-8))
    assert np.isfinite(bend).all()
    assert np.abs(bend).max() < 1e-6


def test_a_spin_that_is_round_off_does_not_keep_the_velocities_from_settling() -> None:
    """Bug: a berg of 10,000 elements that does not turn was refused after 50 passes, for its spin changed by 1e-21 s-1."""
    inertia, now = np.diag([1e14, 1e14, 1e23]), np.array([0.2, 0.0, 1e-20])
    assert _change(np.array([1e-17, 1e-17, 1e-20]), now, inertia) <= CLOSE_ENOUGH
    # Half a micrometre a second at the radius of gyration (32 km), or of the centre, does count.
    assert _change(np.array([0.0, 0.0, 1.6e-11]), now, inertia) > CLOSE_ENOUGH
    assert _change(np.array([5e-7, 0.0, 0.0]), now, inertia) > CLOSE_ENOUGH
    # For a fragment that stands too, but not what is round-off of the forces on it.
    assert _change(np.array([1e-12, 0.0, 0.0]), np.zeros(3), inertia) > CLOSE_ENOUGH
    assert _change(np.array([1e-17, 0.0, 1e-22]), np.zeros(3), inertia) <= CLOSE_ENOUGH


@pytest.mark.parametrize("guess", [1e-4, 1e-2, 0.3, 10.0])
def test_newtons_method_ends_where_another_pass_would_bring_nothing(guess) -> None:
    """It ends without the pass that the last two say would change the velocities by less than 1e-11 of them."""
    model = square_berg(30, lambda p: p.changed(stepping={"scheme": "quasi_static"}))
    model.forcing = Forcing.uniform(current=(0.2, -0.1), wind=(9.0, 4.0))
    model.advance(steps=2)
    now = model._stepper._now  # type: ignore[attr-defined]
    m, opened, room = now.motion, now.bodies.rate, allocate_body_room(1)
    rate = opened + guess * np.array([[0.1, -0.3, 1e-6]])
    known = m.body, m.elements, m.load
    room.sought[:] = True
    passes = close_step(*known, m.inertia, m.mobility, m.floor, opened, rate, 900.0, room)
    assert 1 < passes < 8
    room.sought[:] = True
    newton_step(*known, opened, rate, 900.0, room)
    assert _change(room.step[0], rate[0], m.inertia[0]) < 1e-10


def test_a_large_berg_that_does_not_turn_is_stepped() -> None:
    model = square_berg(2500, lambda p: p.changed(stepping={"scheme": "quasi_static"}))
    model.advance(steps=2)
    assert model.elements.u.min() > 0.0
    assert np.ptp(model.elements.u) < 1e-9


@pytest.mark.parametrize("where", ["process", "forcing"])
def test_a_step_that_was_taken_back_is_taken_again_as_if_it_had_not_failed(where, monkeypatch) -> None:
    """It was lost: bodies and what was known of the lattice stayed those of the failed step."""
    weak = {"enabled": True, "normal_strength": 40.0, "not_in_first_step": False}
    smooth, rough = (
        square_berg(30, lambda p: p.changed(stepping={"scheme": "quasi_static"}, fracture=weak)) for _ in range(2)
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
