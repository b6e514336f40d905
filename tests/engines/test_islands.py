"""Fragments that meet in the quasi-static scheme: only they take short steps, and contact does what its law says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import FieldRules, Forcing, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.compiled.kernels import plain
from riftberg.engines.quasi_static.contact.islands import approach_bound, find_islands
from riftberg.engines.quasi_static.step import TimeStep

NEWBORN_CHILD = -1.0

SIZE = 3000.0
BARE: dict[str, Any] = {"only_interactions": True}


def parameters(stepping: dict[str, Any] | None = None, **groups: Any) -> Parameters:
    """Quasi-static on a plane."""
    return Parameters(
        **{"earth": {"latlon": False, "period": 0.0}, **groups}, stepping={"scheme": "quasi_static", **(stepping or {})}
    )


def single(x: float, u: float, y: float = 0.0) -> Iceberg:
    """A berg of one element."""
    return Iceberg.rectangle(
        SIZE, SIZE, thickness=200.0, radius=1500.0, placement=(x, y), latlon=False, velocity=(u, 0.0)
    )


def bonded(x: float, u: float, side: float = 18e3) -> Iceberg:
    """A berg of three rows that lies across the way of others."""
    return Iceberg.rectangle(
        9e3, side, thickness=200.0, radius=1500.0, placement=(x, 0.0), latlon=False, velocity=(u, 0.0)
    )


class Counting(Forcing.uniform):
    """A uniform environment that counts how often it is asked."""

    asked = 0

    def sample(self, elements, time) -> None:
        """Count, and answer."""
        Counting.asked += 1
        super().sample(elements, time)


def test_two_bergs_that_meet_do_not_cut_the_step_of_others() -> None:
    """Bug: the whole model took the step of the stiffest contact: forcing was sampled anew, and bergs far away went otherwise."""
    sea = Counting(current=(0.2, 0.05), wind=(8.0, -3.0), slope=(0.0, 0.0))
    p = parameters()
    crowd = Model(Iceberg.join([single(0.0, 0.3), single(3300.0, -0.1), single(90e3, 0.2)]), sea, p)
    alone = Model(single(90e3, 0.2), Forcing.uniform(current=(0.2, 0.05), wind=(8.0, -3.0), slope=(0.0, 0.0)), p)
    crowd.advance(steps=1)  # begins with a look around
    Counting.asked = 0
    crowd.advance(steps=5)
    alone.advance(steps=6)
    assert crowd.contacts.rows
    assert Counting.asked <= 6
    for name in ("lon", "lat", "u", "v"):
        assert getattr(crowd.elements, name)[2] == getattr(alone.elements, name)[0]


def test_bergs_that_pass_each_other_go_as_if_nobody_were_near() -> None:
    sea = Forcing.uniform(current=(0.2, 0.05), wind=(8.0, -3.0), slope=(0.0, 0.0))
    bergs = Iceberg.join([single(0.0, 0.3), single(4000.0, 0.1, 3100.0)])
    near, far = (Model(bergs, sea, parameters(stepping={"interactions": yes})) for yes in (True, False))
    for model in (near, far):
        model.advance(steps=4)
    assert near.contacts.rows == []
    np.testing.assert_array_equal(near.elements.u, far.elements.u)
    np.testing.assert_array_equal(near.elements.lon, far.elements.lon)


def test_a_newborn_child_of_footloose_calving_does_not_push_its_parent() -> None:
    """Bug: it lies on the rim of its parent until it has drifted off, and the quasi-static scheme took that for contact."""
    bergs = Iceberg.join([single(0.0, 0.1), single(3050.0, -0.1)])
    newborn, far, other = (
        Model(bergs, Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)), parameters(stepping={"interactions": yes}))
        for yes in (True, False, True)
    )
    newborn.elements.fl_k[1] = NEWBORN_CHILD
    for model in (newborn, far, other):
        model.elements.lon[1] = model.elements.lon_pair[1] = 2500.0  # on the rim of its parent
        model.advance(steps=2)
    assert newborn.contacts.rows == []
    np.testing.assert_array_equal(newborn.elements.u, far.elements.u)
    assert other.contacts.rows  # as contact it would be a push
    assert (other.elements.u != far.elements.u).all()


def test_a_trial_step_that_is_taken_back_leaves_no_velocities_behind() -> None:
    """Bug: the velocities that bergs show each other stayed those of the trial, and the next search looked by them."""
    model = Model(
        Iceberg.join([single(0.0, 0.3), single(3300.0, -0.1)]),
        Forcing.uniform(current=(0.2, 0.05), slope=(0.0, 0.0)),
        parameters(),
    )
    model.advance(steps=1)
    step = TimeStep(model)
    was = {name: getattr(model.elements, name).copy() for name in ("lon", "lat", "u_pair", "v_pair", "rotation")}
    step._checkpoint()
    step.motion.trial(step.state, 900.0)
    assert (model.elements.u_pair != was["u_pair"]).any()
    step._rollback()
    for name, values in was.items():
        np.testing.assert_array_equal(getattr(model.elements, name), values, err_msg=name)


@pytest.mark.parametrize("other", [bonded(9400.0, -0.1), single(6400.0, -0.5, 7400.0)], ids=["head on", "turning"])
def test_the_ledger_of_bergs_that_meet_closes(other: Iceberg) -> None:
    """All that changes the momentum of both is what the media gave; contact is equal and opposite."""
    sea = Forcing.uniform(current=(0.2, 0.05), wind=(8.0, -3.0), slope=(0.0, 0.0))
    model = Model(Iceberg.join([bonded(0.0, 0.3), other]), sea, parameters())
    el = model.elements
    for _ in range(6):
        before = el.mass @ el.u, el.mass @ el.v
        model.advance(steps=1)
        given = model.parameters.time_step * np.einsum("e,emi->i", el.mass, model._stepper.applied)
        assert el.mass @ el.u - before[0] == pytest.approx(given[0], rel=1e-9)
        assert el.mass @ el.v - before[1] == pytest.approx(given[1], rel=1e-9)
    assert model.contacts.rows


@pytest.mark.quick(1)
@pytest.mark.parametrize("dt", [900.0, 450.0])
def test_the_load_of_a_blow_and_the_moment_of_its_break_do_not_depend_on_the_long_step(dt) -> None:
    found = []
    for step in (1800.0, dt):
        for strength in (1e12, 5e3):
            p = parameters(
                stepping={"time_step": step}, fracture={"normal_strength": strength, "shear_strength": 1e12}
            )  # fmt: skip
            model = Model(Iceberg.join([bonded(0.0, 0.0, 21e3), single(7000.0, -0.3)]), Forcing.uniform(), p)
            peak = 0.0
            for _ in range(round(7200.0 / step)):
                model.advance(steps=1)
                peak = max(peak, float(model.bonds.peak_stress.max()))
            broken = model.bonds.status != 0
            found.append((peak, float(model.bonds.break_time[broken].min()) if broken.any() else np.nan))
    assert found[0][0] == pytest.approx(found[2][0], rel=0.1)
    assert np.isnan(found[0][1])
    assert found[1][1] == pytest.approx(found[3][1], abs=20.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "sea",
    [
        Forcing.uniform(current=(0.2, 0.05), wind=(8.0, -3.0), slope=(0.0, 0.0)),
        Forcing.uniform(current=(0.05, -0.2), slope=(0.0, 0.0)),
    ],
)
def test_a_meeting_does_not_depend_on_the_order_of_the_bergs(sea: Forcing) -> None:
    """Nor does the moment when one breaks. What its pieces do then does: each blow makes a last digit forty times as large."""
    # What the sweeps over faces make of friction, which one of two is first, and edges of millimetres are not to show.
    bergs = [bonded(0.0, 0.3), single(6300.0, -0.1, 2000.0), single(9500.0, -0.2, 2500.0), single(6300.0, -0.1, 5100.0)]
    ends, moments = [], []
    for order in ([0, 1, 2, 3], [2, 3, 0, 1], [3, 2, 1, 0]):
        for fracture in ({"enabled": False}, {"enabled": True}):
            model = Model(Iceberg.join([bergs[k] for k in order]), sea, parameters(fracture=fracture))
            model.advance(steps=6)
            el = model.elements
            if fracture["enabled"]:
                moments.append(np.nanmin(model.bonds.break_time, initial=np.inf))
            else:
                ends.append(np.array(sorted(zip(el.lon, el.lat, el.u, el.v, strict=True))))
    for end in ends[1:]:
        np.testing.assert_allclose(end[:, :2], ends[0][:, :2], rtol=0.0, atol=2e-6)  # m
        np.testing.assert_allclose(end[:, 2:], ends[0][:, 2:], rtol=0.0, atol=2e-9)  # m s-1
    np.testing.assert_allclose(moments, moments[0], rtol=0.0, atol=1e-6)  # s


def test_a_lone_berg_has_its_own_face_wherever_it_stands_in_the_list() -> None:
    """Footprints of bergs of one element come before those of lattices, whatever the order of the elements."""
    lone = Iceberg.from_points([6300.0], [2000.0], radius=1500.0, thickness=200.0, latlon=False, velocity=(-0.1, 0.0))
    ends = []
    for bergs in ([lone, bonded(0.0, 0.3)], [bonded(0.0, 0.3), lone]):
        model = Model(Iceberg.join(bergs), Forcing.uniform(), parameters(stepping={"time_step": 900.0}))
        model.advance(steps=3)
        assert model.contacts.rows
        el = model.elements
        ends.append(np.array(sorted(zip(el.lon, el.lat, el.u, el.v, strict=True))))
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=2e-6)


def test_the_load_of_a_blow_does_not_depend_on_which_berg_comes_first() -> None:
    """Force and torque of a contact go to the elements of both sides, here off the middle of one of them."""
    bergs, peaks = [bonded(0.0, 0.0, 21e3), single(6500.0, -0.3, 5300.0)], []
    for order in ((0, 1), (1, 0)):
        p = parameters(stepping={"time_step": 900.0}, fracture={"normal_strength": 1e12, "shear_strength": 1e12})
        model = Model(Iceberg.join([bergs[k] for k in order]), Forcing.uniform(), p)
        peak = np.zeros(model.bonds.peak_stress.shape)
        for _ in range(8):
            model.advance(steps=1)
            peak = np.maximum(peak, model.bonds.peak_stress)
        peaks.append(peak)
    assert peaks[0].max() > 1e3
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=1e-6, atol=1e-3)


def test_pairs_far_apart_meet_as_if_each_were_alone() -> None:
    """Bodies, elements and faces of each group that touches are its own."""
    sea, ends = Forcing.uniform((0.2, 0.05), slope=(0.0, 0.0)), []
    pairs = [[single(x, 0.3), single(x + 3300.0, -0.1, 800.0 * (k + 1))] for k, x in enumerate((0.0, 60e3, 120e3))]
    for bergs in ([berg for pair in pairs for berg in pair], *pairs):
        model = Model(Iceberg.join(bergs), sea, parameters(stepping={"time_step": 900.0}))
        model.advance(steps=4)
        el = model.elements
        ends.append(np.column_stack([el.lon, el.lat, el.u, el.v, el.spin]))
        assert len(model.contacts.rows) == len(bergs) // 2
    np.testing.assert_allclose(np.vstack(ends[1:]), ends[0], rtol=1e-9, atol=1e-9)


def test_no_points_of_two_bodies_approach_faster_than_the_bound() -> None:
    """And it does not grow where all move along."""
    random = np.random.default_rng(4)
    for _ in range(50):
        twist, arm = random.normal(size=(4, 3)) * [0.3, 0.3, 1e-4], random.uniform(100.0, 9e3, 4)
        bound = plain(approach_bound)(twist, arm)
        angle = random.uniform(0.0, 2.0 * np.pi, (200, 4))
        velocity = twist[:, 0] + 1j * twist[:, 1] + 1j * twist[:, 2] * arm * np.exp(1j * angle)
        assert np.abs(velocity[:, :, None] - velocity[:, None, :]).max() <= bound
        assert plain(approach_bound)(np.add(twist, [0.7, -0.4, 0.0]), arm) == pytest.approx(bound)


def test_islands_are_those_that_hang_together() -> None:
    body = np.array([0, 0, 1, 2, 3, 3, 4])
    i = find_islands(body, 5, np.array([3, 1]), np.array([6, 2]))
    assert [set(i.members[a:b]) for a, b in zip(i.start[:-1], i.start[1:], strict=True)] == [{0, 1}, {2, 4}]
    for k in range(2):
        rows = i.rows[i.row_start[k] : i.row_start[k + 1]]
        body_of = i.body_of[i.row_start[k] : i.row_start[k + 1]]
        np.testing.assert_array_equal(i.members[i.start[k] + body_of], body[rows])
        pairs = slice(i.pair_start[k], i.pair_start[k + 1])
        assert set(body[rows[i.first[pairs]]]) | set(body[rows[i.second[pairs]]]) == set(
            i.members[i.start[k] : i.start[k + 1]]
        )


def test_bergs_that_land_stops_are_not_thrown_apart() -> None:
    """A berg shifted back from land alone got hundreds of metres deep into the one behind it, and left it at metres a second."""
    mask = np.ones((8, 16))
    mask[:, 10:] = 0.0
    grid = Grid.cartesian(16, 8, 5000.0, mask=mask)
    fields = grid.fields(uo=np.full((8, 16), 0.3))
    sea = GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())
    bergs = Iceberg.join([single(x, 0.3, 20e3) for x in (47.5e3, 44.4e3, 41.3e3)])
    model = Model(
        bergs, sea, parameters(earth={"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": 0.0})
    )
    for _ in range(24):
        model.advance(steps=1)
        assert np.abs(model.elements.u).max() < 0.6
        assert np.diff(np.sort(model.elements.lon)).min() > 0.6 * SIZE
    assert model.elements.lon.max() <= 50e3


def test_slender_bergs_that_press_against_each_other_are_not_thrown_apart() -> None:
    """Bug: contact saw displacements, which lag by one step: bars bent out of it and deeper into it, to 3 m/s and 20 MPa."""
    bars = [
        Iceberg.rectangle(SIZE, 24e3, thickness=thick, radius=1500.0, placement=(x, 0.0), latlon=False)
        for x, thick in ((0.0, 100.0), (SIZE, 200.0), (2.0 * SIZE, 300.0))  # the current takes along the thin one first
    ]
    p = parameters(
        {"time_step": 1800.0}, earth={"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": 0.0},
        fracture={"enabled": False},
    )  # fmt: skip
    # Broadside on: the drag of 0.3 m/s on the mean of their sides.
    model = Model(Iceberg.join(bars), Forcing.uniform(current=(0.225, 0.0), slope=(0.0, 0.0)), p)
    el, bonds = model.elements, model.bonds
    for _ in range(8):
        model.advance(steps=1)
        assert np.hypot(el.u, el.v).max() < 0.1
        assert bonds.peak_stress.max() < 200.0
        x = np.sort(el.lon.reshape(3, -1).mean(axis=1))
        assert np.abs(np.diff(x) - SIZE).max() < 6.0
    assert model.contacts.rows


def advanced(berg: Iceberg, step: float, **groups: Any) -> Model:
    """A model after three hours in steps of ``step`` s."""
    model = Model(
        berg,
        Forcing.uniform(current=(0.2, 0.05), slope=(0.0, 0.0)),
        parameters({"time_step": step, **groups.pop("stepping", {})}, **groups),
    )
    model.advance(steps=round(10_800.0 / step))
    return model


def test_a_step_of_hours_in_which_bergs_meet_is_divided() -> None:
    """Bug: steps of two hours shattered what half an hour left whole, and those of three hurled pieces out of the box."""
    bergs = Iceberg.join([bonded(0.0, 0.3), bonded(11e3, 0.0)])
    groups: dict[str, Any] = {"stepping": BARE, "fracture": {"enabled": False}}
    long, short = advanced(bergs, 10_800.0, **groups), advanced(bergs, 1800.0, **groups)
    assert short.elements.u[-1] > 0.05  # they have met
    np.testing.assert_allclose(long.elements.lon, short.elements.lon, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(long.elements.u, short.elements.u, rtol=0.0, atol=1e-9)


def test_a_step_is_divided_by_the_inertial_period() -> None:
    """13.8 hours at 60 degrees, of which a step is a sixth at most."""
    earth = {"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": -60.0}
    one, two = advanced(single(0.0, 0.3), 10_800.0, earth=earth), advanced(single(0.0, 0.3), 5400.0, earth=earth)
    np.testing.assert_allclose(one.elements.lon, two.elements.lon, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(one.elements.u, two.elements.u, rtol=0.0, atol=1e-9)


def test_a_small_berg_does_not_jump_through_a_larger_one() -> None:
    """Bug: half an hour took a berg of 49 m through one of 285 m that its sub-steps never touched, or left it inside.

    It takes up the speed of the water within minutes; a step of half an hour swings about that, and goes 1.7 km in place of 0.3.
    """
    shape = {"latlon": False, "placement": (-467.0, 0.0), "velocity": (-0.1, 0.0)}
    small = Iceberg.rectangle(49.0, 49.0, thickness=40.0, radius=24.5, **shape)
    large = Iceberg.rectangle(285.0, 285.0, thickness=175.0, radius=142.5, latlon=False, velocity=(0.3, 0.0))
    model = Model(Iceberg.join([small, large]), Forcing.uniform(current=(0.3, 0.0), slope=(0.0, 0.0)), parameters())
    for _ in range(4):
        model.advance(steps=1)
        assert np.diff(model.elements.lon) > 467.0


def test_a_meeting_on_the_sphere_is_the_same_across_the_seam() -> None:
    """Bergs that meet at the date line go as those that meet elsewhere."""

    def apart(east: float) -> tuple[float, float]:
        bergs = [
            Iceberg.rectangle(
                400.0, 400.0, thickness=100.0, radius=200.0, placement=(east + d, -60.0), velocity=(u, 0.0)
            )
            for d, u in ((-0.004, 0.3), (0.004, 0.0))
        ]
        model = Model(Iceberg.join(bergs), Forcing.uniform())
        model.advance(steps=4)
        assert len(model.contacts.rows) == 1
        el = model.elements
        return float((el.lon[1] - el.lon[0] + 180.0) % 360.0 - 180.0), float(el.u[1])

    np.testing.assert_allclose(apart(180.0), apart(20.0), rtol=1e-7)
