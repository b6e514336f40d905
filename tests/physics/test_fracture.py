"""The stress criterion against its twin and at its edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from physics.agreement import between, quick
from riftberg.physics.bonds import exceeds
from twins import fracture as twin

stress = between(-40e3, 40e3)


@quick
@given(n=stress, s=between(0, 200e3), strength=between(0.1, 2))
def test_criterion_equals_twin(n, s, strength):
    """Spec 7."""
    assert bool(exceeds(n, s, 18e3, 100e3, strength)) == twin.breaks(n, s, 18e3, 100e3, strength)


@pytest.mark.parametrize("position", [0, 1])
def test_threshold_itself_does_not_break(position):
    """Strictly above, in tension and in shear."""
    at = [18e3, 100e3]
    assert not exceeds(*at, 18e3, 100e3, 1.0)
    at[position] = np.nextafter(at[position], np.inf)
    assert exceeds(*at, 18e3, 100e3, 1.0)


def test_compression_alone_never_breaks():
    """Q15."""
    assert not exceeds(-1e12, 0.0, 18e3, 100e3, 1.0)


def test_strength_weakens_both():
    """A rift of a tenth of the strength."""
    assert exceeds(2e3, 0.0, 18e3, 100e3, 0.1)
    assert exceeds(0.0, 11e3, 18e3, 100e3, 0.1)
    assert not exceeds(2e3, 11e3, 18e3, 100e3, 1.0)


def test_nan_stress_does_not_count_as_strength():
    """A poisoned stress compares false, as in the reference; it must show elsewhere."""
    assert not exceeds(np.nan, np.nan, 18e3, 100e3, 1.0)
