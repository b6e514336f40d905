"""Fields at a crack tip: twin, free faces, balance, the energy that a crack releases; and the way of a crack of mixed mode."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

from physics.agreement import between, quick
from riftberg.physics.crack_tip import crack_tip_fields, hoop_intensity
from twins import stress_intensity as twin


@quick
@given(x=between(-3.0, 3.0), y=between(0.01, 3.0), side=between(-1.0, 1.0), poisson=between(0.0, 0.45))
def test_the_fields_are_those_of_the_twin(x: float, y: float, side: float, poisson: float) -> None:
    y = math.copysign(y, side)
    stress, gradient = crack_tip_fields(np.array([x]), np.array([y]), poisson)
    for mode in (1, 2):
        assert stress[mode - 1, 0] == pytest.approx(twin.stress(x, y, mode), rel=1e-12, abs=1e-13)
        expected = twin.gradient(x, y, mode, 1.0, poisson)
        assert gradient[mode - 1, 0] == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_the_faces_of_a_crack_bear_nothing_and_open_or_slip() -> None:
    x, side = -np.array([0.1, 1.0, 7.0]), 1e-12
    for y in (side, -side):
        stress, _ = crack_tip_fields(x, np.full(3, y), 0.3)
        np.testing.assert_allclose(stress[:, :, 1:], 0.0, atol=1e-9)
    # Ahead of the tip a crack of K_I is pulled across, and one of K_II sheared: the material to the left of it along x.
    ahead = crack_tip_fields(np.array([0.5 / math.pi]), np.zeros(1), 0.3)[0][:, 0]
    np.testing.assert_allclose(ahead, [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)


def test_the_released_energy_is_that_of_both_modes() -> None:
    """J on a circle: K^2 / E, for each mode and, without a mixed term, for both; for K as its square, whatever the radius."""
    youngs, poisson = 9e9, 0.3
    t = (np.arange(4000) + 0.5) * (2.0 * math.pi / 4000) - math.pi
    for radius in (1.0, 2500.0):
        x, y = radius * np.cos(t), radius * np.sin(t)
        stress, gradient = crack_tip_fields(x, y, poisson)
        for k in ((1.0, 0.0), (0.0, 1.0), (3.0, -2.0)):
            s, g = np.tensordot(k, stress, 1), np.tensordot(k, gradient, 1) / youngs
            strain = (
                s[:, 0] ** 2 + s[:, 1] ** 2 - 2.0 * poisson * s[:, 0] * s[:, 1] + 2.0 * (1.0 + poisson) * s[:, 2] ** 2
            )
            pull = np.column_stack([
                s[:, 0] * np.cos(t) + s[:, 2] * np.sin(t), s[:, 2] * np.cos(t) + s[:, 1] * np.sin(t)
            ])  # fmt: skip
            density = 0.5 * strain / youngs * np.cos(t) - (pull * g).sum(axis=1)
            released = float(density.sum()) * radius * 2.0 * math.pi / t.size
            assert released == pytest.approx((k[0] ** 2 + k[1] ** 2) / youngs, rel=1e-5)


@quick
@given(opening=between(0.0, 5.0), shearing=between(-5.0, 5.0))
def test_a_crack_goes_on_where_the_hoop_stress_is_largest(opening: float, shearing: float) -> None:
    angle, intensity = hoop_intensity(opening, shearing)
    others = [twin.hoop(opening, shearing, t) for t in np.linspace(-math.pi, math.pi, 721)]
    assert intensity == pytest.approx(twin.hoop(opening, shearing, angle), rel=1e-12, abs=1e-12)
    assert intensity >= max(others) - 1e-12
    # The mirror image turns to the other side; more of both turns as far.
    assert hoop_intensity(opening, -shearing) == pytest.approx((-angle, intensity))
    assert hoop_intensity(3.0 * opening, 3.0 * shearing) == pytest.approx((angle, 3.0 * intensity))


def test_the_kinks_of_erdogan_and_sih() -> None:
    """Pure shear: 70.5 degrees and 1.155 K_II, away from the side that is sheared forward; closed faces do not go on."""
    assert hoop_intensity(2.0, 0.0) == (0.0, 2.0)
    angle, intensity = hoop_intensity(0.0, 1.0)
    assert (math.degrees(angle), intensity) == pytest.approx((-70.53, 1.1547), abs=1e-2)
    assert math.degrees(hoop_intensity(1.0, 1.0)[0]) == pytest.approx(-53.13, abs=0.01)
    assert hoop_intensity(-1.0, 5.0) == (0.0, 0.0)
    assert hoop_intensity(0.0, 0.0) == (0.0, 0.0)
