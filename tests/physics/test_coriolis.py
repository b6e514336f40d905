"""Coriolis parameter against its twin."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import assert_same, between, quick
from riftberg.physics.geometry import coriolis_parameter
from twins import coriolis as twin

latitude = between(-90, 90)


@quick
@given(lat=latitude, ref=latitude, latlon=st.booleans(), f_plane=st.booleans())
def test_coriolis_parameter_equals_twin(lat, ref, latlon, f_plane):
    """Spec 2.6."""
    assert_same(coriolis_parameter(lat, latlon, f_plane, ref), twin.parameter(lat, latlon, f_plane, ref))


def test_sign_follows_the_hemisphere():
    """Positive in the north, zero at the equator, odd; largest at the pole."""
    assert coriolis_parameter(90.0, True, False, 0.0) == pytest.approx(2 * 7.292e-5, rel=1e-15)
    assert coriolis_parameter(0.0, True, False, 45.0) == 0.0
    assert coriolis_parameter(-55.0, True, False, 45.0) == -coriolis_parameter(55.0, True, False, 45.0) < 0


@pytest.mark.parametrize(("latlon", "f_plane"), [(True, True), (False, False), (False, True)])
def test_reference_latitude_is_used_on_planes(latlon, f_plane):
    """The y of a Cartesian grid is metres and must not enter a sine."""
    assert coriolis_parameter(30.0, latlon, f_plane, -60.0) == coriolis_parameter(-60.0, True, False, 0.0)
    assert coriolis_parameter(151_000.0, False, f_plane, 0.0) == 0.0
