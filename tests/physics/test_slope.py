"""Slope force against its twin."""

from __future__ import annotations

from hypothesis import given

from physics.agreement import assert_same, between, quick
from riftberg.physics.drag import slope_acceleration
from twins import slope as twin

slope = between(-1e-4, 1e-4)


@quick
@given(x=slope, y=slope)
def test_slope_acceleration_equals_twin(x, y):
    """Spec 4.1."""
    assert_same(slope_acceleration(x, y), twin.acceleration((x, y)))


def test_downhill():
    """A surface that rises eastward pushes west; a flat one not at all; components do not mix; linear."""
    assert slope_acceleration(1e-6, 0.0)[0] < 0
    assert slope_acceleration(1e-6, 0.0)[1] == 0
    assert slope_acceleration(0.0, -1e-6)[1] > 0
    assert slope_acceleration(0.0, 0.0) == (0.0, 0.0)
    assert_same(slope_acceleration(2e-6, 4e-6), (-2 * 9.8e-6, -4 * 9.8e-6))
