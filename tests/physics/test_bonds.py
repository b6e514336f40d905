"""The DEM bond against its twin: parts, the composed law of equations 5.4 on both ends, and what the law must obey."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import MIRROR, SEEDS, angle, assert_same, between, quick, speed, turn, unit
from riftberg.physics import bonds
from twins import bonds as twin

E = 5e6
length = between(500, 5000)
thickness = between(1, 400)
spin = between(-1e-2, 1e-2)
LAW = SimpleNamespace(
    E=E,
    nu=0.3,
    gamma=1.0,
    no_shear=False,
    linear_bending=False,
    objective=False,
    shared_lever=False,
    thickness_of_second=False,
)


def law(**changes):
    """The default law with some options changed."""
    return SimpleNamespace(**{**vars(LAW), **changes})


def composed(one, two, s, law, dt):
    """The bond law put together from the kernels in the order of equations 5.4; same result as `twins.bonds.pair`."""
    rx, ry = one.r - two.r
    dist = float(np.hypot(rx, ry))
    nx, ny = rx / dist, ry / dist
    rest = one.radius + two.radius
    half = bonds.bond_overlap(rest, dist)
    small, other = (one, two) if one.radius < two.radius else (two, one)
    gap = abs(one.thickness - two.thickness) if law.thickness_of_second else other.thickness - small.thickness
    w, h = bonds.bond_section(small.radius, abs(one.radius - two.radius), small.thickness, gap, half, 1 / dist)
    lever1, lever2 = one.radius - half, two.radius - half
    n, t = np.array([nx, ny]), np.array([-ny, nx])
    push = bonds.normal_force(law.E / rest, w, h, half)
    parting, across = bonds.along_and_across(*(one.u - two.u), nx, ny)
    sliding = bonds.slip_speed(across, lever1 * one.spin + lever2 * two.spin)
    slip = bonds.advance_slip(bonds.signed_slip(*s, nx, ny), sliding, dt)
    shear = 0.0 if law.no_shear else -bonds.shear_stiffness(law.E / rest, law.nu, w, h) * slip
    torque1 = bonds.torque_of(lever1, shear)
    torque2 = torque1 if law.shared_lever else bonds.torque_of(lever2, shear)
    turned = one.rotation - two.rotation
    theta = turned if law.linear_bending else float(np.sin(turned))
    bend = bonds.bending_torque(law.E / rest, w, h, theta)
    c_d = bonds.damping_constant(law.E, law.nu, law.gamma, one.mass, two.mass)
    spin_damping = -c_d * (one.spin - two.spin)
    drag = -c_d * (sliding if law.objective else across)
    lever_torque = [bonds.torque_of(x, drag) if law.objective else 0.0 for x in (lever1, lever2)]
    return SimpleNamespace(
        s=slip * t,
        length=dist,
        sigma_n=bonds.tensile_stress(law.E / rest, half, theta, w),
        sigma_s=0.0 if law.no_shear else bonds.shear_stress_of(law.E / rest, law.nu, abs(slip)),
        force=push * n + shear * t,
        force_d=-c_d * parting * n + drag * t,
        torque=(torque1 + bend, torque2 - bend),
        torque_d=(lever_torque[0] + spin_damping, lever_torque[1] - spin_damping),
        normal=push * n,
    )


def random_pair(seed, *, equal=False):
    """Two neighbouring elements in general motion, and the tangential displacement of their bond."""
    r = np.random.default_rng(seed)
    radii = [1500.0, 1500.0] if equal else r.uniform(500, 3000, 2)
    heights = [200.0, 200.0] if equal else r.uniform(50, 400, 2)
    ends = [
        SimpleNamespace(
            u=r.normal(0, 0.5, 2),
            spin=r.normal(0, 1e-4),
            rotation=r.normal(0, 0.3),
            radius=float(radii[k]),
            thickness=float(heights[k]),
            mass=float(850 * heights[k] * 4 * radii[k] ** 2),
        )
        for k in (0, 1)
    ]
    ends[1].r = r.normal(0, 1e4, 2)
    ends[0].r = ends[1].r + sum(radii) * r.uniform(0.9, 1.1) * unit(r.uniform(-np.pi, np.pi))
    return ends[0], ends[1], r.normal(0, 5.0, 2)


def moved(end, matrix, shift=(0.0, 0.0), drift=(0.0, 0.0)):
    """The same element seen in other axes; a reflection turns spins round."""
    sense = np.linalg.det(matrix)
    return SimpleNamespace(
        **{
            **vars(end),
            "r": matrix @ end.r + shift,
            "u": matrix @ end.u + drift,
            "spin": sense * end.spin,
            "rotation": sense * end.rotation,
        }
    )


def assert_same_bond(got, want, *, rtol=1e-12):
    """Force, torques, stresses and displacement agree to ``rtol`` of the largest part of each sum."""
    stiff = np.abs(want.force).max() + np.abs(want.normal).max() + 1e-300
    np.testing.assert_allclose(got.force, want.force, rtol=0, atol=rtol * stiff)
    np.testing.assert_allclose(got.force_d, want.force_d, rtol=0, atol=rtol * (np.abs(want.force_d).max() + 1e-300))
    for name in ("torque", "torque_d"):
        size = np.abs(getattr(want, name)).max() + 1e-300
        np.testing.assert_allclose(getattr(got, name), getattr(want, name), rtol=0, atol=100 * rtol * size)
    np.testing.assert_allclose(got.s, want.s, rtol=0, atol=rtol * (np.abs(want.s).max() + 1e-300))
    assert got.sigma_s == pytest.approx(want.sigma_s, rel=rtol)
    assert got.sigma_n == pytest.approx(want.sigma_n, rel=rtol, abs=rtol * E)


OPTIONS = [
    {},
    {"objective": True},
    {"shared_lever": True},
    {"thickness_of_second": True},
    {"no_shear": True},
    {"linear_bending": True, "objective": True, "nu": 0.1, "gamma": 0.3},
]


@pytest.mark.quick(4)
@pytest.mark.parametrize("options", OPTIONS, ids=lambda o: "-".join(o) or "default")
@pytest.mark.parametrize("equal", [True, False], ids=["equal", "unequal"])
def test_composed_bond_law_equals_twin_on_random_pairs(options, equal):
    """Spec 5.4 as a whole: displacement, force, torques and stresses on both elements."""
    for seed in SEEDS:
        one, two, s = random_pair(seed, equal=equal)
        got = composed(one, two, s, law(**options), 20.0)
        assert_same_bond(got, twin.pair(one, two, s, law(**options), 20.0))


@quick
@given(sx=between(-9, 9), sy=between(-9, 9), a=angle, cx=speed, cy=speed, dt=between(0.01, 20))
def test_shear_displacement_equals_twin_and_is_tangential(sx, sy, a, cx, cy, dt):
    """Spec 5.4; drawn by hypothesis, away from s parallel to n where the direction of the turned s is round-off."""
    n = unit(a)
    if abs(n[0] * sy - n[1] * sx) < 1e-3 * np.hypot(sx, sy):
        sx, sy = 0.0, 0.0
    across = bonds.along_and_across(cx, cy, *n)[1]
    got = bonds.advance_slip(bonds.signed_slip(sx, sy, *n), across, dt) * np.array([-n[1], n[0]])
    want = twin.shear_displacement(np.array([sx, sy]), n, np.array([cx, cy]), dt)
    scale = np.hypot(sx, sy) + dt * np.hypot(cx, cy) + 1e-300
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-11 * scale)
    assert abs(got @ n) <= 1e-11 * scale


@quick
@given(size=between(-9, 9), a=angle, b=between(-0.5, 0.5))
def test_shear_displacement_keeps_its_size_when_the_bond_turns(size, a, b):
    """Rigid rotation must neither create nor lose elastic displacement."""
    t = turn(a) @ [0.0, size]
    got = bonds.signed_slip(*t, *unit(a + b))
    assert got == pytest.approx(size, rel=1e-12, abs=1e-30)


def test_no_displacement_and_no_slip_stay_nothing():
    """Limit s = 0: no division by zero."""
    assert bonds.signed_slip(0.0, 0.0, 0.6, 0.8) == 0.0
    assert bonds.signed_slip(3.0, 0.0, 1.0, 0.0) == 0.0
    assert bonds.advance_slip(0.0, 0.0, 20.0) == 0.0


@quick
@given(r1=length, r2=length, t1=thickness, t2=thickness, stretch=between(0.9, 1.1), quirk=st.booleans())
def test_section_equals_twin(r1, r2, t1, t2, stretch, quirk):
    """Spec 5.4, width and thickness at the contact, with and without Q11."""
    rest = r1 + r2
    dist = stretch * rest
    half = bonds.bond_overlap(rest, dist)
    (small, t_small), (_, t_other) = ((r1, t1), (r2, t2)) if r1 < r2 else ((r2, t2), (r1, t1))
    gap = abs(t1 - t2) if quirk else t_other - t_small
    got = bonds.bond_section(small, abs(r1 - r2), t_small, gap, half, 1 / dist)
    want = twin.section([(r1, t1), (r2, t2)], half, dist, thickness_of_second=quirk)
    assert_same(got, want)


def test_section_of_equal_elements_is_their_own():
    """W = 2 R and H = T (equations 5.4), pressed or stretched."""
    for dist in (2700.0, 3000.0, 3300.0):
        assert bonds.bond_section(1500.0, 0.0, 200.0, 0.0, bonds.bond_overlap(3000.0, dist), 1 / dist) == (
            3000.0,
            200.0,
        )


@quick
@given(t1=thickness, t2=thickness, stretch=between(0.9, 1.1))
def test_thickness_of_equal_radii_is_the_mean_whichever_comes_first(t1, t2, stretch):
    """Riftberg's linear rule: the contact of equal radii lies half way."""
    dist = 3000.0 * stretch
    half = bonds.bond_overlap(3000.0, dist)
    _, forward = bonds.bond_section(1500.0, 0.0, t2, t1 - t2, half, 1 / dist)
    _, backward = bonds.bond_section(1500.0, 0.0, t1, t2 - t1, half, 1 / dist)
    assert forward == pytest.approx(0.5 * (t1 + t2), rel=1e-13)
    assert backward == pytest.approx(0.5 * (t1 + t2), rel=1e-13)


def test_sign_of_the_normal_force_and_stress():
    """Pressed: pushes apart, stress negative. Stretched: pulls together, stress positive. At rest: nothing."""
    for sign in (-1, 1):
        half = bonds.bond_overlap(3000.0, 3000.0 + sign * 30.0)
        assert np.sign(bonds.normal_force(E / 3000.0, 3000.0, 200.0, half)) == -sign
        assert np.sign(bonds.tensile_stress(E / 3000.0, half, 0.0, 3000.0)) == sign
    assert bonds.normal_force(E / 3000.0, 3000.0, 200.0, 0.0) == 0.0
    assert bonds.tensile_stress(E / 3000.0, 0.0, 0.0, 3000.0) == 0.0


@quick
@given(e=between(1e3, 1e9), w=length, h=thickness, rest=length, half=between(-50, 50), theta=between(-0.5, 0.5))
def test_stiffness_is_linear_in_modulus_and_thickness(e, w, h, rest, half, theta):
    """Force, shear stiffness and bending moment all double with E and with H; stresses with E only."""
    for f in (
        lambda e, h: bonds.normal_force(e / rest, w, h, half),
        lambda e, h: bonds.shear_stiffness(e / rest, 0.3, w, h),
        lambda e, h: bonds.bending_torque(e / rest, w, h, theta),
    ):
        assert f(2 * e, h) == pytest.approx(2 * f(e, h), rel=1e-14)
        assert f(e, 2 * h) == pytest.approx(2 * f(e, h), rel=1e-14)
    stress = bonds.tensile_stress(e / rest, half, theta, w)
    assert bonds.tensile_stress(2 * e / rest, half, theta, w) == pytest.approx(2 * stress, rel=1e-13)


@quick
@given(w=length, h=thickness, rest=length, theta=between(-0.5, 0.5))
def test_bending_torque_is_that_of_a_beam(w, h, rest, theta):
    """-E J theta / l with J = H w^3 / 12: against the angle, odd, cubic in the width."""
    torque = bonds.bending_torque(E / rest, w, h, theta)
    assert torque == pytest.approx(-E * h * w**3 / 12 * theta / rest, rel=1e-13)
    assert torque * theta <= 0
    assert bonds.bending_torque(E / rest, w, h, -theta) == -torque
    assert bonds.bending_torque(E / rest, 2 * w, h, theta) == pytest.approx(8 * torque, rel=1e-13)


@quick
@given(half=between(-50, 50), theta=between(-0.5, 0.5))
def test_bending_always_adds_tension(half, theta):
    """Q15."""
    straight = bonds.tensile_stress(E / 3000.0, half, 0.0, 3000.0)
    bent = bonds.tensile_stress(E / 3000.0, half, theta, 3000.0)
    assert bent >= straight
    assert bent == bonds.tensile_stress(E / 3000.0, half, -theta, 3000.0)
    assert bent - straight == pytest.approx(E * abs(theta) / 2, rel=1e-9, abs=1e-6)


@quick
@given(e=between(1e3, 1e9), nu=between(-0.5, 0.49), gamma=between(0, 2), m1=between(1e8, 1e13), m2=between(1e8, 1e13))
def test_damping_constant_is_symmetric_and_scales(e, nu, gamma, m1, m2):
    """Root of modulus and of mass, linear in the ratio."""
    c = bonds.damping_constant(e, nu, gamma, m1, m2)
    assert c >= 0
    assert c == pytest.approx(bonds.damping_constant(e, nu, gamma, m2, m1), rel=1e-14)
    assert bonds.damping_constant(4 * e, nu, gamma, m1, m2) == pytest.approx(2 * c, rel=1e-13)
    assert bonds.damping_constant(e, nu, gamma, 4 * m1, 4 * m2) == pytest.approx(2 * c, rel=1e-13)
    assert bonds.damping_constant(e, nu, 3 * gamma, m1, m2) == pytest.approx(3 * c, rel=1e-13)


def test_contact_velocity_by_hand():
    """Both ends spin counter-clockwise: at the contact the eastern element 1 moves down, the western one up."""
    assert bonds.slip_speed(0.0, 2.0) == -2.0
    assert bonds.along_and_across(0.0, -2.0, 1.0, 0.0) == (0.0, -2.0)
    assert bonds.along_and_across(2.0, 0.0, 0.0, 1.0) == (0.0, -2.0)
    assert bonds.slip_speed(0.4, 0.0) == 0.4


@quick
@given(a=angle, w=spin, r1=length, r2=length, dist=length)
def test_rigid_rotation_has_no_contact_velocity(a, w, r1, r2, dist):
    """Levers add up to the distance, so spins w and centres turning at w cancel at the contact."""
    n = unit(a)
    half = bonds.bond_overlap(r1 + r2, dist)
    du, dv = w * dist * np.array([-n[1], n[0]])
    parting, across = bonds.along_and_across(du, dv, *n)
    c = [parting, bonds.slip_speed(across, (r1 - half + r2 - half) * w)]
    np.testing.assert_allclose(c, 0.0, atol=1e-12 * (abs(w) * (dist + r1 + r2) + 1e-300))


def test_torque_by_hand():
    """A northward force on element 1 at a contact to its west turns it clockwise, and so does the reaction on 2."""
    assert bonds.torque_of(1500.0, bonds.along_and_across(0.0, 2.0, 1.0, 0.0)[1]) == -3000.0
    assert bonds.torque_of(1500.0, bonds.along_and_across(2.0, 0.0, 0.0, 1.0)[1]) == 3000.0
    assert bonds.torque_of(1500.0, bonds.along_and_across(6.0, 8.0, 0.6, 0.8)[1]) == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("objective", [True, False])
@quick
@given(seed=st.integers(0, 10**6), a=angle, shift=between(-1e4, 1e4), drift=speed)
def test_bond_turns_mirrors_shifts_and_drifts_with_its_ends(objective, seed, a, shift, drift):
    """Invariance of the composed law under rotation, reflection, translation and a common velocity."""
    one, two, s = random_pair(seed)
    rule = law(objective=objective)
    plain = composed(one, two, s, rule, 20.0)
    for q in (turn(a), MIRROR):
        sense = np.linalg.det(q)
        ends = [moved(end, q, (shift, -shift), (drift, 2 * drift)) for end in (one, two)]
        got = composed(*ends, q @ s, rule, 20.0)
        want = SimpleNamespace(
            s=q @ plain.s,
            force=q @ plain.force,
            normal=q @ plain.normal,
            force_d=q @ plain.force_d,
            torque=sense * np.array(plain.torque),
            torque_d=sense * np.array(plain.torque_d),
            sigma_n=plain.sigma_n,
            sigma_s=plain.sigma_s,
        )
        # differences of positions of 1e4 m and stresses of strains of 1e-2 cost two to four digits
        assert_same_bond(got, want, rtol=1e-9)


@pytest.mark.parametrize("objective", [True, False])
@quick
@given(seed=st.integers(0, 10**6))
def test_action_equals_reaction(objective, seed):
    """Exchange of the ends: opposite forces and displacement, exchanged torques, equal stresses."""
    one, two, s = random_pair(seed)
    rule = law(objective=objective)
    forward, backward = composed(one, two, s, rule, 20.0), composed(two, one, -s, rule, 20.0)
    want = SimpleNamespace(
        s=-forward.s,
        force=-forward.force,
        normal=-forward.normal,
        force_d=-forward.force_d,
        torque=forward.torque[::-1],
        torque_d=forward.torque_d[::-1],
        sigma_n=forward.sigma_n,
        sigma_s=forward.sigma_s,
    )
    assert_same_bond(backward, want)


@quick
@given(seed=st.integers(0, 10**6), objective=st.booleans())
def test_bond_keeps_angular_momentum(seed, objective):
    """Couple of the forces plus both torques is zero, except for the non-objective damper (Q43)."""
    one, two, s = random_pair(seed)
    bond = composed(one, two, s, law(objective=objective), 20.0)
    arm = one.r - two.r
    elastic = twin.cross(arm, bond.force) + sum(bond.torque)
    assert abs(elastic) <= 1e-9 * (np.linalg.norm(arm) * np.linalg.norm(bond.force) + abs(bond.torque[0]))
    damped = twin.cross(arm, bond.force_d) + sum(bond.torque_d)
    couple = twin.cross(arm, bond.force_d)
    size = np.linalg.norm(arm) * np.linalg.norm(bond.force_d)
    assert abs(damped - (0.0 if objective else couple)) <= 1e-9 * size


@quick
@given(seed=st.integers(0, 10**6), objective=st.booleans())
def test_bond_damper_never_gains_energy(seed, objective):
    """Power of damping forces and torques on both ends."""
    one, two, s = random_pair(seed)
    bond = composed(one, two, s, law(objective=objective), 20.0)
    power = bond.force_d @ (one.u - two.u) + bond.torque_d[0] * one.spin + bond.torque_d[1] * two.spin
    assert power <= 0


@quick
@given(seed=st.integers(0, 10**6), w=spin)
def test_objective_damper_leaves_rigid_rotation_free_and_the_reference_does_not(seed, w):
    """Q43: the reference brakes rigid rotation, Riftberg does not."""
    one, two, s = random_pair(seed)
    for end in (one, two):
        end.spin = w
        end.u = w * np.array([-end.r[1], end.r[0]])
    free = composed(one, two, s, law(objective=True), 20.0)
    braked = composed(one, two, s, law(objective=False), 20.0)
    size = np.linalg.norm(braked.force_d)
    # velocities are those of rotation about the far origin
    assert np.linalg.norm(free.force_d) <= 1e-10 * size
    arm = np.linalg.norm(one.r - two.r)
    assert size == pytest.approx(bonds.damping_constant(E, 0.3, 1.0, one.mass, two.mass) * abs(w) * arm, rel=1e-9)


def test_shear_opposes_slip_and_turns_both_ends_the_same_way():
    """Element 1, north of 2, slips east: it is pulled back west, and both ends turn clockwise to follow."""
    one, two, _ = random_pair(1, equal=True)
    for end in (one, two):
        end.u, end.spin, end.rotation = np.zeros(2), 0.0, 0.0
    two.r, one.r = np.zeros(2), np.array([0.0, 3000.0])
    one.u = np.array([0.1, 0.0])
    bond = composed(one, two, np.zeros(2), LAW, 20.0)
    assert bond.s[0] == pytest.approx(2.0)
    assert bond.force[0] < 0
    assert bond.torque[0] == bond.torque[1] < 0


def test_shared_lever_quirk_gives_the_partner_the_wrong_torque_only_if_radii_differ():
    """Q10."""
    one, two, s = random_pair(5, equal=True)
    own, shared = (composed(one, two, s, law(shared_lever=x), 20.0) for x in (False, True))
    assert own.torque == shared.torque
    one, two, s = random_pair(5)
    own, shared = (composed(one, two, s, law(shared_lever=x), 20.0) for x in (False, True))
    assert own.torque[0] == shared.torque[0]
    assert own.torque[1] != shared.torque[1]


@quick
@given(e=between(1e3, 1e9), nu=between(-0.5, 0.49), w=length, h=thickness, rest=length, slip=between(0, 50))
def test_shear_stress_is_the_shear_force_over_the_section(e, nu, w, h, rest, slip):
    """Spec 5.4: |F_s| / (w H), whatever the section."""
    force = bonds.shear_stiffness(e / rest, nu, w, h) * slip
    assert bonds.shear_stress_of(e / rest, nu, slip) == pytest.approx(force / (w * h), rel=1e-13)


def test_no_shear_leaves_only_the_normal_force():
    """Option ignore_tangential_force."""
    one, two, s = random_pair(7)
    bond = composed(one, two, s, law(no_shear=True), 20.0)
    assert bond.sigma_s == 0.0
    assert_same(bond.force, bond.normal)
