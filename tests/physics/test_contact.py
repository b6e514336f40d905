"""KID's pair law against its twin: parts, the composed law of equations 5.2, and what the law must obey."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import MIRROR, SEEDS, angle, assert_same, between, quick, speed, turn, unit
from riftberg.physics import contact
from twins import contact as twin

coefficient = between(0, 1e-2)
flag = st.booleans()


def composed(r, rest, stiffness, masses, options, u2, u0, u1):
    """Spring acceleration, tensor P and vector p of element 1, composed from the kernels (equations 5.2)."""
    critical, tangential_critical, radial, tangential, by_speed = options
    d = float(np.hypot(*r))
    nx, ny = r[0] / d, r[1] / d
    ratio = min(masses) / masses[0]
    damping = contact.damping_coefficients(stiffness, critical, tangential_critical, radial, tangential)
    spring = contact.spring_acceleration(nx, ny, d, rest, stiffness, ratio)
    relative = (u2[0] - u0[0], u2[1] - u0[1], u2[0] - u1[0], u2[1] - u1[1])
    p11, p12, p22 = contact.damping_tensor(nx, ny, *damping, ratio, by_speed, *relative)
    tensor = np.array([[p11, p12], [p12, p22]])
    return np.array(spring), tensor, tensor @ u2


def random_pair(seed):
    """A pair with all its options, seeded."""
    r = np.random.default_rng(seed)
    masses = tuple(10 ** r.uniform(8, 13, 2))
    options = (bool(r.integers(2)), bool(r.integers(2)), *r.uniform(0, 1e-3, 2), bool(r.integers(2)))
    velocities = r.normal(0, 1, (3, 2))
    position = r.uniform(10, 5000) * unit(r.uniform(-np.pi, np.pi))
    return position, r.uniform(10, 5000), 10 ** r.uniform(-9, -2), masses, options, *velocities


def test_composed_pair_law_equals_twin_on_random_pairs():
    """Spec 5.2 as a whole."""
    for seed in SEEDS:
        r, rest, stiffness, masses, options, u2, u0, u1 = random_pair(seed)
        spring, tensor, vector = composed(r, rest, stiffness, masses, options, u2, u0, u1)
        damping = twin.coefficients(stiffness, *options[:4])
        want = twin.pair(r, rest, stiffness, masses, damping, options[4], u2, u0, u1)
        d = np.linalg.norm(r)
        assert_same(spring, want[0], scale=stiffness * max(d, rest) * min(masses) / masses[0])
        assert_same(tensor, want[1])
        assert_same(vector, want[2], scale=np.abs(want[1]).max() * np.abs(u2).max())


@quick
@given(k=coefficient, critical=flag, tangential_critical=flag, radial=coefficient, tangential=coefficient)
def test_damping_coefficients_equal_twin(k, critical, tangential_critical, radial, tangential):
    """Spec 5.2, both switches."""
    got = contact.damping_coefficients(k, critical, tangential_critical, radial, tangential)
    assert_same(got, twin.coefficients(k, critical, tangential_critical, radial, tangential))


def test_tangential_switch_needs_the_critical_one():
    """Spec 0.2: tang_crit_int_damp_on acts where critical damping is on."""
    assert contact.damping_coefficients(1e-4, True, True, 7.0, 8.0) == pytest.approx((2e-2, 5e-3))
    assert contact.damping_coefficients(1e-4, True, False, 7.0, 8.0) == pytest.approx((2e-2, 8.0))
    assert contact.damping_coefficients(1e-4, False, True, 7.0, 8.0) == (7.0, 8.0)


@quick
@given(a=angle, overlap=between(-500, 500), k=coefficient)
def test_spring_pushes_apart_when_pressed_and_pulls_when_stretched(a, overlap, k):
    """Sign on each axis: element 1 lies along n from element 2."""
    n = unit(a)
    got = np.array(contact.spring_acceleration(*n, 3000.0 - overlap, 3000.0, k, 1.0))
    np.testing.assert_allclose(got, k * overlap * n, rtol=1e-11, atol=1e-13 * k * 3000)


def test_spring_at_rest_length_is_silent():
    """Limit."""
    assert contact.spring_acceleration(1.0, 0.0, 3000.0, 3000.0, 1e-7, 1.0) == (0.0, 0.0)


def test_action_equals_reaction_with_unequal_masses():
    """m_1 I_1 = -m_2 I_2, and P_1 m_1 = P_2 m_2, also with quadratic damping."""
    for seed in SEEDS:
        r, rest, stiffness, masses, options, u2, u1, _ = random_pair(seed)
        one = composed(r, rest, stiffness, masses, options, u2, u1, u1)
        two = composed(-r, rest, stiffness, masses[::-1], options, u1, u2, u2)
        force1, force2 = masses[0] * one[0], masses[1] * two[0]
        assert_same(force1 + force2, (0, 0), scale=np.abs(force1).max())
        damper1 = masses[0] * one[1] @ (u2 - u1)
        damper2 = masses[1] * two[1] @ (u1 - u2)
        assert_same(damper1 + damper2, (0, 0), scale=np.abs(damper1).max())


@quick
@given(a=angle, u=speed, v=speed, radial=coefficient, tangential=coefficient, by_speed=flag, ratio=between(0, 1))
def test_dampers_never_gain_energy(a, u, v, radial, tangential, by_speed, ratio):
    """P is positive semidefinite: the power (u_1 - u_2) . P (u_2 - u_1) is never positive."""
    p11, p12, p22 = contact.damping_tensor(*unit(a), radial, tangential, ratio, by_speed, u, v, u, v)
    w = np.array([u, v])
    tensor = np.array([[p11, p12], [p12, p22]])
    assert -(w @ tensor @ w) <= 1e-16 * (np.abs(tensor).max() * (w @ w) + 1e-300)
    assert p11 >= 0
    assert p22 >= 0


@quick
@given(a=angle, b=angle, u=speed, v=speed, by_speed=flag)
def test_tensor_turns_and_mirrors_with_the_pair(a, b, u, v, by_speed):
    """P' = Q P Q^T for rotations and reflections Q."""
    n, w = unit(a), np.array([u, v])
    p11, p12, p22 = contact.damping_tensor(*n, 2e-3, 5e-4, 0.7, by_speed, *w, *(2 * w))
    tensor = np.array([[p11, p12], [p12, p22]])
    for q in (turn(b), MIRROR):
        q11, q12, q22 = contact.damping_tensor(*(q @ n), 2e-3, 5e-4, 0.7, by_speed, *(q @ w), *(2 * q @ w))
        np.testing.assert_allclose(
            [[q11, q12], [q12, q22]], q @ tensor @ q.T, rtol=0, atol=1e-14 * max(np.abs(tensor).max(), 1e-3)
        )


def test_radial_and_tangential_parts_by_hand():
    """Along x the radial coefficient is P11, the tangential one P22."""
    assert contact.damping_tensor(1.0, 0.0, 3.0, 5.0, 0.5, False, 0.0, 0.0, 0.0, 0.0) == (1.5, 0.0, 2.5)
    assert contact.damping_tensor(0.0, 1.0, 3.0, 5.0, 0.5, False, 0.0, 0.0, 0.0, 0.0) == (2.5, 0.0, 1.5)


def test_damping_by_speed_is_quadratic_and_uses_the_mean_of_both_speeds():
    """Each coefficient gets the mean of its own projected speeds."""
    got = contact.damping_tensor(1.0, 0.0, 3.0, 5.0, 1.0, True, 0.2, -0.3, 0.4, 0.1)
    np.testing.assert_allclose(got, (3.0 * 0.3, 0.0, 5.0 * 0.2), rtol=1e-15)
    twice = contact.damping_tensor(1.0, 0.0, 3.0, 5.0, 1.0, True, 0.4, -0.6, 0.8, 0.2)
    np.testing.assert_allclose(twice, 2 * np.array(got), rtol=1e-15)


def test_no_relative_motion_no_damping_by_speed():
    """Limit."""
    assert contact.damping_tensor(0.6, 0.8, 3.0, 5.0, 1.0, True, 0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)


@given(between(1e-9, 1e-2), between(1.0, 1e5), between(1.0, 5e3))
@quick
def test_stiffness_of_a_pair_equals_twin(given_stiffness, modulus, distance):
    for value in (given_stiffness, -1.0):
        for most in (np.inf, 1e-6):
            got = contact.pair_stiffness(value, modulus, distance, most)
            assert got == pytest.approx(twin.stiffness(value, modulus, distance, most), rel=1e-12)


def test_stiffness_from_the_elements_is_that_of_the_bar_of_ice_between_them():
    """Squares of 3 km, 5 MPa, 850 kg m-3: the value of A68a's namelist; a tenth of the size is 100 times stiffer."""
    modulus = 5e6 / 850.0
    assert contact.pair_stiffness(-1.0, modulus, 3000.0, np.inf) == pytest.approx(6.535947712418301e-4, rel=1e-14)
    assert contact.pair_stiffness(-1.0, modulus, 300.0, np.inf) == pytest.approx(6.535947712418301e-2, rel=1e-14)
    assert contact.pair_stiffness(1e-7, modulus, 3000.0, 1e-9) == 1e-7  # a given one stands as it is
