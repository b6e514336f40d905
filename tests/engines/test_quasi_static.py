"""Parts of the quasi-static scheme against plain twins and against what they must conserve."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from engines.test_elastic_cells import dense_matrix
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.quasi_static.bodies.dynamics import relative_increment
from riftberg.engines.quasi_static.bodies.pose import place_elements, split_bodies
from riftberg.engines.quasi_static.lattice import solver
from riftberg.errors import RunError
from scripts import loaded
from twins import equilibrium as twin
from verification.plates import Plate

square_berg = loaded("benchmarks/bench.py").square_berg

EARTH = 6_363_827.0


def drifting(
    latitude: float | None, size=(6e3, 4.5e3), *, dt: float = 1800.0, velocity=(0.0, 0.0), spin: float = 0.0,
    **groups,
) -> Model:  # fmt: skip
    """Return a berg of elements of 1.5 km on which nothing acts, on the sphere, or on a plane without a latitude."""
    latlon = latitude is not None
    berg = Iceberg.rectangle(
        *size, radius=750.0, thickness=200.0, latlon=latlon, placement=(-38.0, latitude) if latlon else (0.0, 0.0),
        velocity=velocity,
    )  # fmt: skip
    p = Parameters(
        earth={"latlon": latlon, "radius": EARTH, **({} if latlon else {"period": 0.0})}, fracture={"enabled": False},
        stepping={"time_step": dt, "only_interactions": True}, **groups,
    )  # fmt: skip
    model = Model(berg, Forcing.uniform(), p)
    el, metre = model.elements, EARTH * np.pi / 180.0 if latlon else 1.0
    x, y = metre * (el.lon - el.lon.mean()), metre * (el.lat - el.lat.mean())
    x = x * np.cos(np.radians(latitude)) if latlon else x
    el.spin[:] = spin
    for shown in ("", "_sync", "_pair"):
        getattr(el, f"u{shown}")[:], getattr(el, f"v{shown}")[:] = velocity[0] - spin * y, velocity[1] + spin * x
    return model


@pytest.mark.parametrize("latitude", [None, -57.0])
def test_a_berg_that_spins_goes_as_far_and_the_same_way(latitude) -> None:
    """Bug: on the sphere it turned while it moved, along an arc: a small berg that spun was put 300 m inside its neighbour."""
    straight, spun = (drifting(latitude, (1500.0, 1500.0), velocity=(0.5, 0.3), spin=spin) for spin in (0.0, 8e-4))
    for model in (straight, spun):
        model.step()
    for name in ("lon", "lat"):
        found, asked = (getattr(model.elements, name) for model in (spun, straight))
        np.testing.assert_allclose(found, asked, rtol=0, atol=1e-9 if latitude is None else 1e-12)
    assert np.hypot(*straight.velocity()) == pytest.approx(np.hypot(0.5, 0.3))
    assert spun.elements.rotation - straight.elements.rotation == pytest.approx(8e-4 * 1800.0, rel=1e-6)


def uneven(seed: int, packing: str, **options) -> tuple[Iceberg, np.ndarray]:
    """A berg of uneven thickness and unequal elements, and random forces (N, N, N m) on these."""
    r = np.random.default_rng(seed)
    berg = Iceberg.rectangle(16e3, 11e3, thickness=200.0, radius=1500.0, packing=packing, latlon=False, **options)
    el = berg.elements
    n = el.mass.size
    el.thickness[:] *= r.uniform(0.6, 1.4, n)
    el.length[:] *= r.uniform(0.8, 1.0, n)
    el.mass[:] = 850.0 * el.thickness * el.length * el.width
    return berg, np.column_stack([1e9 * r.standard_normal((n, 2)), 1e12 * r.standard_normal(n)])


def floating(seed: int, packing: str, youngs: float = 5e6) -> tuple[Plate, np.ndarray]:
    """The same in a model; nothing holds it."""
    berg, force = uneven(seed, packing)
    return Plate.of(berg, {"youngs_modulus": youngs}), force


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("seed", range(3))
def test_balanced_loads_are_those_of_the_plain_twin(seed, packing) -> None:
    """Of a berg that spins in wind and current, whose drag turns its elements too."""
    berg, force = uneven(seed, packing, spin=2e-5)
    p = Parameters(
        earth={"latlon": False, "period": 0.0, "reference_latitude": -55.0}, bonds={"packing": packing},
        fracture={"enabled": False}, stepping={"time_step": 600.0},
    )  # fmt: skip
    model = Model(berg, Forcing.uniform((0.4, -0.1), wind=(12.0, 2.0), slope=(0.0, 0.0)), p)
    el = model.elements
    el.load_x[:], el.load_y[:] = force[:, :2].T
    model.advance(steps=3)
    memory = model._stepper.memory  # type: ignore[attr-defined]
    (u, v, torque), (c, s) = memory.state.force.T, memory.state.operators.levers[:, 9:11].T
    turned = np.column_stack([c * u + s * v, c * v - s * u, torque])
    inertia = el.mass * (el.length**2 + el.width**2) / 12.0
    asked = twin.balanced(memory.lattice.xy, el.mass, inertia, turned, memory.bodies.twist[0, 2])
    scale = np.abs(turned).max(axis=0)
    assert scale[2] > 1e6
    np.testing.assert_allclose(memory.state.load / scale, asked / scale, rtol=0, atol=1e-11)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_held_elements_stay_and_the_ice_of_the_others_balances_the_load(packing) -> None:
    """Against the whole stiffness matrix, added up number by number and solved for the freedoms that are left."""
    berg, force = uneven(4, packing)
    el, n = berg.elements, berg.elements.mass.size
    el.static[np.argsort(el.lon)[:3]] = 1.0
    el.free_y[np.argsort(el.lon)[-1]] = 0.0
    lattice = Plate.of(berg, {"youngs_modulus": 5e6}).now
    got, of, matrix = lattice.displacements(force), lattice.topology, dense_matrix(lattice.cells)
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
        plate, force = floating(1, "square", youngs)
        stresses.append(plate.bearing(force).stress)
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=0, atol=1e-8 * np.abs(stresses[0]).max())


def test_a_load_out_of_balance_is_refused() -> None:
    """The springs that hold a fragment must carry nothing; that they do is a fault, not a stress."""
    plate, force = floating(1, "square")
    with pytest.raises(RunError, match="not in equilibrium"):
        plate.now.displacements(force)


def test_loads_that_are_round_off_alone_are_in_balance() -> None:
    """Bug: a berg that started with the velocity of a balanced current was refused, for a freedom that carried 1e-6 N."""
    plate, force = floating(1, "square")
    tiny = 1e-6 * np.sign(force) * np.array([1.0, 1.0, 0.0])
    assert np.abs(plate.now.displacements(tiny)).max() < 1e-9


def test_a_berg_that_goes_with_the_water_bears_nothing() -> None:
    sea = Forcing.uniform(current=(0.15, 0.0))
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.15, 0.0))
    model = Model(berg, sea, Parameters(stepping={"scheme": "quasi_static"}))
    model.advance(steps=2)
    assert model.bonds.peak_stress.max() < 1.0


def test_sides_that_melt_leave_bonds_as_they_formed() -> None:
    """Bug: levers of shorter sides and kept lengths did not add up to the bond, whose shear then turned the berg as a whole."""
    berg, _ = uneven(4, "square")
    berg.bonds.rest_length[:] = 3000.0
    plate = Plate.of(berg)
    before = plate.now
    plate.el.length[:] *= 0.97
    plate.el.width[:] *= 0.97
    plate.refresh()
    after, xy = plate.now, before.xy
    assert after is not before
    whole = np.column_stack([-xy[:, 1], xy[:, 0], np.ones(len(xy))])  # the berg turns as a whole
    for lattice in (before, after):
        assert lattice.moment(whole, whole).deformation == pytest.approx(0.0, abs=1e-9)
    for name in ("width", "thickness", "stiffness", "arm_first", "arm_second"):
        assert getattr(after.lattice, name) == pytest.approx(getattr(before.lattice, name), rel=1e-12), name


def test_a_melting_berg_goes_on() -> None:
    """Bug: it was refused after two hours ("a freedom that should be free carries 0.866 N")."""
    p = Parameters(stepping={"scheme": "quasi_static"}, melt={"enabled": True, "temperature": 6.0, "salinity": 34.0})
    sea = Forcing.uniform((0.4, -0.1), wind=(12.0, 2.0))
    model = Model(Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-37.0, -56.0)), sea, p)
    model.advance(days=3)
    assert model.elements.length.max() < 2995.0
    assert model.bonds_broken == 0


def distances(lon, lat):
    """Great-circle distances (m) between all pairs."""
    a, b = np.radians(lon), np.radians(lat)
    v = np.array([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])
    d = v[:, :, None] - v[:, None, :]
    return 2 * EARTH * np.arcsin(0.5 * np.sqrt((d**2).sum(axis=0)))


@pytest.mark.parametrize("latitude", [-75.0, -55.0, 0.0, 88.5])
def test_a_berg_at_rest_stays_where_it_is(latitude) -> None:
    model = drifting(latitude)
    lon, lat = model.elements.lon.copy(), model.elements.lat.copy()
    model.step()
    np.testing.assert_allclose(model.elements.lon, lon, rtol=0, atol=1e-11)
    np.testing.assert_allclose(model.elements.lat, lat, rtol=0, atol=1e-12)


@pytest.mark.parametrize("latitude", [-75.0, -55.0, 0.0, 88.5])
def test_a_rigid_berg_stays_rigid_over_weeks(latitude) -> None:
    """Distances in the lattice hold to a micrometre while it drifts, turns and crosses the pole."""
    model = drifting(latitude, velocity=(0.31, 0.17), spin=2e-6, bonds={"youngs_modulus": 1e12})
    el, before = model.elements, distances(model.elements.lon, model.elements.lat)
    model.advance(steps=48 * 21)
    assert np.abs(distances(model.elements.lon, model.elements.lat) - before).max() < 2e-6
    assert np.ptp(el.rotation) < 0.1


@pytest.mark.parametrize("latitude", [None, -60.0])
def test_velocities_of_the_elements_are_those_of_their_motion(latitude) -> None:
    """With the turn of the berg and that of the axes."""
    model, dt, places = drifting(latitude, dt=1e-2, velocity=(0.3, -0.2), spin=1e-4), 1e-2, []
    for n in range(3):
        model.step()
        places.append((model.elements.lon.copy(), model.elements.lat.copy()))
        if n == 1:
            (u, v), lat = model.velocity(), model.elements.lat.copy()
    per_unit = EARTH * np.pi / 180.0 if latitude else 1.0
    shrink = np.cos(np.radians(lat)) if latitude else 1.0
    # A difference of two longitudes has a round-off of some nanometres.
    np.testing.assert_allclose((places[2][0] - places[0][0]) / (2 * dt) * per_unit * shrink, u, rtol=0, atol=3e-6)
    np.testing.assert_allclose((places[2][1] - places[0][1]) / (2 * dt) * per_unit, v, rtol=0, atol=3e-6)
    assert np.ptp(u) > 0.02  # it turns


def parting(model: Model) -> np.ndarray:
    """Break all bonds between two thirds of a berg and the rest; returns which bonds."""
    el, b = model.elements, model.bonds
    behind = np.argsort(np.argsort(el.id)) // 4
    cut = behind[b.first] != behind[b.second]
    b.status[cut] = 1
    return cut


@pytest.mark.parametrize("latitude", [None, -60.0])
def test_pieces_that_part_go_on_as_they_went(latitude) -> None:
    model = drifting(latitude, velocity=(0.3, -0.2), spin=1e-5, dt=1e-3)
    model.step()
    before, spin = model.velocity(), model.elements.spin.copy()
    assert parting(model).any()
    model.step()
    assert 0 < (model.bonds.status == 0).sum() < model.bonds.status.size
    np.testing.assert_allclose(model.velocity(), before, rtol=0, atol=1e-8)
    np.testing.assert_allclose(model.elements.spin, spin, rtol=1e-6)


@pytest.mark.parametrize("turn", [0.0, 1.2])
@pytest.mark.parametrize("latitude", [None, -60.0])
def test_pieces_that_part_stay_where_they_were_without_the_load_that_bent_them(latitude, turn) -> None:
    """However the berg has turned since its start.

    Bug: poses took in what load had moved the pieces by, so faces of a crack stood metres apart or in each other in soft ice.
    """
    model = drifting(latitude, velocity=(0.3, -0.2), spin=turn / 1200.0, dt=60.0, bonds={"youngs_modulus": 1e6})
    el, b = model.elements, model.bonds
    el.load_x[:], el.load_y[:] = 1e8 * np.random.default_rng(1).normal(size=(2, el.size))

    def across(cut) -> np.ndarray:
        """Distances of the ends of bonds, m."""
        if latitude is None:
            return np.hypot(el.lon[b.first] - el.lon[b.second], el.lat[b.first] - el.lat[b.second])[cut]
        return distances(el.lon, el.lat)[b.first, b.second][cut]

    unbent = across(slice(None))
    model.advance(steps=20)
    cut = parting(model)
    assert np.abs(across(cut) - unbent[cut]).max() > 0.1
    el.load_x[:] = el.load_y[:] = 0.0
    for name in ("u", "v", "u_sync", "v_sync", "u_pair", "v_pair", "spin"):
        getattr(el, name)[:] = 0.0
    model.step()
    np.testing.assert_allclose(across(cut), unbent[cut], rtol=0, atol=1e-6)
    assert el.rotation[0] == pytest.approx(turn, abs=0.02)


@pytest.mark.parametrize("turn", [0.0, 1.2])
@pytest.mark.parametrize("latitude", [None, -60.0])
def test_pieces_take_what_load_had_moved_their_ice_by_along(latitude, turn) -> None:
    """A turn of 1e-4 over some km moves by metres; what a finite turn adds to them is of second order."""
    model = drifting(latitude, spin=turn / 1200.0, dt=60.0, bonds={"youngs_modulus": 1e6})
    el = model.elements
    el.load_x[:], el.load_y[:] = 1e8 * np.random.default_rng(1).normal(size=(2, el.size))
    model.advance(steps=20)
    whole = model._stepper.memory.bodies  # type: ignore[attr-defined]
    pieces = split_bodies(whole, np.arange(12) // 5, el.mass, latitude is not None, EARTH)
    places = []
    for bodies in (whole, pieces):
        places.append((el.lon.copy(), el.lat.copy()))
        place_elements(bodies, *places[-1], np.zeros(12), latitude is not None, EARTH, 0.0)
    (x, y), (x2, y2) = places
    assert np.abs(whole.displacement[:, :2]).max() > 0.1
    per_unit = EARTH * np.pi / 180.0 if latitude else 1.0
    assert np.abs(x2 - x).max() * per_unit < 2e-3
    assert np.abs(y2 - y).max() * per_unit < 2e-3


def test_a_spin_that_is_round_off_does_not_keep_the_velocities_from_settling() -> None:
    """Bug: a berg of 10,000 elements that does not turn was refused after 50 passes, for its spin changed by 1e-21 s-1."""
    inertia, now, settled = np.diag([1e14, 1e14, 1e23]), np.array([0.2, 0.0, 1e-20]), 1e-8
    assert relative_increment(np.array([1e-17, 1e-17, 1e-20]), now, inertia) <= settled
    # Half a micrometre a second at the radius of gyration (32 km), or of the centre, does count.
    assert relative_increment(np.array([0.0, 0.0, 1.6e-11]), now, inertia) > settled
    assert relative_increment(np.array([5e-7, 0.0, 0.0]), now, inertia) > settled
    # For a fragment that stands too, but not what is round-off of the forces on it.
    assert relative_increment(np.array([1e-12, 0.0, 0.0]), np.zeros(3), inertia) > settled
    assert relative_increment(np.array([1e-17, 0.0, 1e-22]), np.zeros(3), inertia) <= settled


def test_newtons_method_solves_the_half_kick_to_round_off() -> None:
    """Of one element in a current, by hand: it goes with w, and ends with w and half a step of the drag at the end."""
    sea = Forcing.uniform(current=(0.4, 0.0), slope=(0.0, 0.0))
    berg = Iceberg.rectangle(600.0, 600.0, radius=300.0, thickness=200.0, latlon=False)

    def step(dt: float) -> tuple[float, float]:
        p = Parameters(
            earth={"latlon": False, "period": 0.0, "reference_latitude": 0.0}, stepping={"time_step": dt},
            drag={"air_side": 0.0, "air_top": 0.0},
        )  # fmt: skip
        model = Model(berg, sea, p)
        model.step()
        return float(model.elements.lon[0]) / dt, float(model.elements.u[0])

    c = 2.0 * step(1e-3)[0] / 1e-3 / 0.4**2
    for dt in (600.0, 1800.0, 7200.0):
        w, u = step(dt)
        assert u == pytest.approx(w + 0.5 * dt * c * (0.4 - u) * abs(0.4 - u), abs=1e-11)
        assert w < u < 0.4


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
