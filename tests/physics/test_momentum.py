"""Mean speed and the 2 x 2 solve against their twins."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given

from physics.agreement import angle, assert_same, between, quick, speed, turn
from riftberg.engines.common.forces import implicit_velocity
from twins import momentum as twin

entry = between(-2, 2)


@quick
@given(u1=speed, v1=speed, u0=speed, v0=speed, uk=speed, vk=speed, a=angle)
def test_mean_speed_equals_twin_and_does_not_turn(u1, v1, u0, v0, uk, vk, a):
    """Spec 4.2, drag speeds; also unchanged when all velocities turn or share a drift."""
    got = implicit_velocity.mean_speed(u1, v1, u0, v0, uk, vk)
    assert_same(got, twin.mean_speed((u1, v1), (u0, v0), (uk, vk)))
    m = turn(a)
    turned = implicit_velocity.mean_speed(*(m @ [u1, v1]), *(m @ [u0, v0]), *(m @ [uk, vk]))
    np.testing.assert_allclose(turned, got, rtol=1e-12, atol=1e-14)
    drifted = implicit_velocity.mean_speed(u1 + 1, v1 - 2, u0 + 1, v0 - 2, uk + 1, vk - 2)
    np.testing.assert_allclose(drifted, got, rtol=1e-12, atol=1e-14)


@quick
@given(u=speed, v=speed)
def test_no_relative_motion_no_speed(u, v):
    """Moving with the water."""
    assert implicit_velocity.mean_speed(u, v, u, v, u, v) == 0.0


@quick
@given(p=entry, q=entry, r=entry, s=entry, x=entry, y=entry)
def test_solution_equals_twin(p, q, r, s, x, y):
    """Matrices of the stepping are diagonally dominant: 1 + dt (drag) on the diagonal, f dt beside it."""
    a = np.array([[3.1 + p, q / 2], [r / 2, 3.1 + s]])  # with 3 the ends of the ranges would meet in a singular matrix
    got = implicit_velocity.solve_two_by_two(*a.ravel(), x, y)
    assert_same(got, twin.solve(a, (x, y)), scale=abs(x) + abs(y))


@quick
@given(p=entry, q=entry, r=entry, s=entry, x=entry, y=entry)
def test_solution_solves(p, q, r, s, x, y):
    """Put back into the equations, for any matrix that is not near singular."""
    assume(abs(p * s - q * r) > 0.1)
    ax, ay = implicit_velocity.solve_two_by_two(p, q, r, s, x, y)
    size = (abs(ax) + abs(ay) + abs(x) + abs(y)) * 10 + 1e-30
    assert abs(p * ax + q * ay - x) <= 1e-14 * size / abs(p * s - q * r)
    assert abs(r * ax + s * ay - y) <= 1e-14 * size / abs(p * s - q * r)


def test_components_are_not_swapped():
    """Diagonal and purely skew matrices by hand."""
    assert implicit_velocity.solve_two_by_two(2.0, 0.0, 0.0, 4.0, 2.0, 2.0) == (1.0, 0.5)
    assert implicit_velocity.solve_two_by_two(0.0, 1.0, -1.0, 0.0, 3.0, 5.0) == (-5.0, 3.0)
