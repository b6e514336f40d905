"""The table of media: one row each, read by all schemes; and the forces that were applied."""

from __future__ import annotations

import numpy as np
import pytest

from contract import FORCES, SEA_FLOOR
from engines.lattices import lattice, parameters, surroundings_of
from riftberg import A68A_2022_MTS, Forcing, Iceberg, Laws, Model
from riftberg.engines.common.forces import media
from riftberg.engines.common.forces.media import Medium
from twins import velocity as twin
from twins.elements import unpack

PLANE = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
SEA = {"current": (0.3, -0.1), "wind": (9.0, -4.0), "slope": (2e-6, -1e-6), "sea_ice": (0.1, 0.05, 1.5)}
KID = {"law": "spring", "constant_size": False}
SCHEMES = {
    "mts": {},
    "explicit floor": {"grounding": {"implicit": False}},
    "floor in the long step": {"grounding": {"on_substeps": False}},
    "uncentred": {"compatibility": {"uncentred_half_kicks": True}},
    "unbonded": {"bonds": {"law": "none"}},
    "implicit sub-steps": {
        "bonds": {**KID, "spring": 0.0},
        "stepping": {"explicit_substeps": False, "time_step": 600.0},
    },
    "verlet": {"bonds": {"law": "none"}, "stepping": {"scheme": "verlet", "time_step": 60.0}},
    "runge_kutta": {"bonds": {"law": "none"}, "stepping": {"scheme": "runge_kutta", "time_step": 60.0}},
}
"""Every way in which a medium acts on an element, with bonds that keep momentum to round-off, or none."""


PLOUGH = {"law": "quadratic", "quadratic_coefficient": 2e3}
LAWS = {"linear": {}, "quadratic": {"grounding": PLOUGH}}


def uneven(elements, time):
    """A force of one's own, another one on each element, so that bonds have to share it."""
    return 3e5 * elements.body.id, -2e5 * elements.body.id


def model(scheme, *, depth=150.0, **changes):
    """Return a berg of two by two elements adrift in everything, aground unless the water is deep."""
    p = A68A_2022_MTS.changed(
        earth=PLANE, bonds={"constant_size": False}, fracture={"enabled": False}, stepping={"substeps": 40, "time_step": 600.0},
    )  # fmt: skip
    p = p.changed(**SCHEMES[scheme])
    for group, values in changes.items():
        p = p.changed(**{group: values})
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, latlon=False, offset=(0.0, 0.0), velocity=(0.5, 0.2))
    return Model(berg, Forcing.uniform(**SEA, depth=depth), p, laws=Laws(force=uneven))


def momentum(m):
    """Momentum (N s) with what the last explicit accelerations still have to give."""
    el, p = m.elements, m.parameters.stepping
    if p.scheme == "mts":
        half = 0.5 * p.time_step / m.substeps
        carried = [el.ax_fast + el.bx_fast, el.ay_fast + el.by_fast]
    else:
        half, carried = 0.5 * p.time_step, [el.ax, el.ay]
    return np.array([el.mass @ (el.u + half * carried[0]), el.mass @ (el.v + half * carried[1])])


@pytest.mark.parametrize("multiple", [True, False])
def test_rows_equal_the_twin(multiple):
    """Spec 4.1."""
    scheme = {"scheme": "mts" if multiple else "verlet"}
    p = parameters(stepping=scheme, grounding={"on_substeps": False}, fracture={"enabled": False})
    el, _ = lattice(3, p)
    by_name, around = surroundings_of(el, p)
    for e, item in enumerate(unpack(el)):
        want = twin.surroundings(item, p, latitude=item.lat, multiple=multiple)
        rows = {name: Medium(*(column[e] for column in row)) for name, row in by_name.items()}
        drags = [(rows["water"], want.ocean, "o"), (rows["air"], want.air, "a"), (rows["sea_ice"], want.ice, "i")]
        for row, quadratic, letter in drags:
            np.testing.assert_allclose(row.quadratic, quadratic, rtol=1e-12)
            assert (row.u, row.v) == (getattr(item, f"u{letter}"), getattr(item, f"v{letter}"))
        np.testing.assert_allclose(rows["sea_floor"].linear, want.floor, rtol=1e-12)
        push = np.sum([[row.push_x, row.push_y] for row in rows.values()], axis=0)
        np.testing.assert_allclose(push, want.push, rtol=1e-12)
        np.testing.assert_allclose(around.coriolis[e], want.f, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_applied_forces_are_what_changed_the_momentum(scheme, law):
    """The sum of all forces kept is the change of momentum to round-off: no medium is forgotten, none counted twice."""
    m = model(scheme, **LAWS[law])
    m.step()
    for _ in range(3):
        before = momentum(m)
        m.step()
        forces = m.applied_forces()
        change = (momentum(m) - before) / m.parameters.time_step
        np.testing.assert_allclose(forces.sum(axis=(0, 1)), change, rtol=0, atol=1e-9 * np.abs(forces).sum())
        for name in FORCES[:-1]:
            assert np.abs(forces[:, FORCES.index(name)]).min() > 0.0, name


@pytest.mark.parametrize("scheme", [name for name in SCHEMES if name != "explicit floor"])
def test_forces_of_the_first_step_are_what_changed_the_momentum_too(scheme):
    """A proper start has one half kick of the slow forces, which were told as if there were two.

    Left out: an explicit floor under a berg that starts aground acts for half a sub-step before the first.
    """
    m = model(scheme)
    before = momentum(m)
    m.step()
    forces = m.applied_forces()
    change = (momentum(m) - before) / m.parameters.time_step
    np.testing.assert_allclose(forces.sum(axis=(0, 1)), change, rtol=0, atol=1e-9 * np.abs(forces).sum())


def test_a_medium_that_is_not_there_applies_no_force():
    m = model("mts", depth=1e4)
    m.forcing = Forcing.uniform(current=(0.3, 0.0), depth=1e4, slope=(0.0, 0.0))
    m.step()
    acting = {name for k, name in enumerate(FORCES) if np.abs(m.applied_forces()[:, k]).max() > 0.0}
    assert acting == {"water", "air", "coriolis"}


def test_nothing_is_applied_where_forces_are_left_out_or_velocities_imposed():
    still = model("mts", stepping={"only_interactions": True}, grounding={"coefficient": 0.0})
    imposed = model("verlet", stepping={"fixed_velocity": (0.1, 0.0)})
    for m in (still, imposed):
        m.step()
        assert (m.applied_forces() == 0.0).all()


def test_asking_for_the_velocity_changes_no_applied_force():
    """The half kick that completes the velocity for a record is done on copies."""
    for scheme in ("mts", "verlet", "runge_kutta"):
        m = model(scheme)
        m.step()
        before = m.applied_forces()
        m.forcing = Forcing.uniform(current=(-1.0, 0.0), depth=150.0, slope=(0.0, 0.0))
        m.velocity()
        np.testing.assert_array_equal(m.applied_forces(), before)


def test_the_mean_force_of_the_floor_over_the_sub_steps_is_that_of_its_law():
    """One element on the floor alone: what is kept is the momentum it lost, whatever the velocity was at the record."""
    changes = {"stepping": {"only_interactions": True}, "bonds": {"law": "none"}}
    m = model("mts", **changes)
    before = m.elements.mass * m.elements.u
    m.step()
    lost = (m.elements.mass * m.elements.u - before) / m.parameters.time_step
    np.testing.assert_allclose(m.applied_forces()[:, SEA_FLOOR, 0], lost, rtol=1e-11)


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_quadratic_floor_slows_by_its_closed_form(scheme):
    """``u = u0 / (1 + c u0 t)``, ``c = k_g A (D - d) / m``: force by speed squared and by the draft in excess of the depth.

    The work of the force that was applied is the kinetic energy lost.
    """
    floor = {**PLOUGH, "quadratic_coefficient": 20.0}
    steps = {"time_step": 60.0, "substeps": 4}
    alone = {"drag": {"ocean_scale": 0.0}, "earth": {"reference_latitude": 0.0}, "bonds": {"law": "none"}}
    m = model(scheme, depth=200.0 * 850.0 / 1025.0 - 8.0, grounding=floor, stepping=steps, **alone)
    m.forcing = Forcing.uniform(depth=m.forcing.water)
    m.elements.v[:] = 0.0
    m.step()
    el, work = m.elements, 0.0
    start = el.u.copy()
    for _ in range(59):
        before = el.u.copy()
        m.step()
        work += (m.applied_forces()[:, SEA_FLOOR, 0] * 0.5 * (before + el.u)).sum() * 60.0
    c = 20.0 * 9e6 * 8.0 / el.mass
    np.testing.assert_allclose(el.u, 0.5 / (1.0 + c * 0.5 * 3600.0), rtol=0.02)
    lost = 0.5 * (el.mass * (start**2 - el.u**2)).sum()
    assert -work == pytest.approx(lost, rel=0.02)


def test_implicit_sub_steps_leave_no_berg_without_a_floor():
    """Bug once: spring bonds with implicit sub-steps passed over the sea floor as if it were not there."""
    left = {}
    for explicit in (True, False):
        m = model("implicit sub-steps", stepping={"explicit_substeps": explicit, "only_interactions": False})
        for _ in range(3):
            m.step()
        left[explicit] = np.abs(m.velocity()[0]).max()
    assert left[False] < 0.1
    assert left[True] < 0.1


def test_aground_under_the_quadratic_law():
    p = parameters(grounding={**PLOUGH, "coefficient": 0.0, "ramp_height": 0.0})
    got = media.on_the_floor(np.array([200.0, 193.0, 180.0]), np.full(3, 160.0), 0.0, p)
    np.testing.assert_array_equal(got, [True, True, False])


@pytest.mark.parametrize(("thickness", "coefficient", "ramp", "touches"), [
    (200.0, 1e4, 0.0, True), (180.0, 1e4, 0.0, False), (180.0, 1e4, 20.0, True), (200.0, 0.0, 0.0, False)
])  # fmt: skip
def test_aground_is_where_the_floor_acts(thickness, coefficient, ramp, touches):
    """The one answer for breaking bonds, fragments, why, plots and replay: a drag that acts, at 160 m of water."""
    p = parameters(grounding={"coefficient": coefficient, "ramp_height": ramp})
    shape = (2, 3)
    got = media.on_the_floor(np.full(shape, thickness), np.full(shape, 160.0), 0.0, p)
    assert got.shape == shape
    assert (got == touches).all()
