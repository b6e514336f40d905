"""Metric, polar plane, nearest image, fast sine and cosine against their twins and against theory."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import assert_same, between, latitude, quick, speed
from riftberg.physics import geometry
from twins import geometry as twin

RADIUS = 6_363_827.0
polar_latitude = between(89.001, 89.999)
longitude = between(-179.9, 179.9)


def test_fast_sine_error_is_below_3e_16_in_the_first_period():
    """The claim in the module's docstring, against extended precision; half an ulp of 1 is 1.1e-16."""
    x = np.linspace(-np.pi, np.pi, 20_001)
    exact = np.sin(x.astype(np.longdouble))
    got = np.array([geometry.fast_sin(a) for a in x])
    assert float(np.max(np.abs(got - exact))) < 3e-16


@pytest.mark.parametrize("magnitude", [1e-300, 1e-9, 1e-3, 1.0, 10.0, 1e2, 1e3, 1e5])
def test_fast_sine_of_elements_that_turned_many_times(magnitude):
    """Bug once: pi was split into two full doubles, so their products rounded and the error grew with the angle."""
    x = np.random.default_rng(1).uniform(-magnitude, magnitude, 4000)
    got = np.array([geometry.fast_sin(a) for a in x])
    np.testing.assert_allclose(got, np.sin(x), rtol=0, atol=4e-16)


def test_fast_sine_keeps_relative_accuracy_near_zero():
    """A relative rotation of 1e-12 rad still bends a bond."""
    x = np.geomspace(1e-18, 0.1, 500)
    np.testing.assert_allclose([geometry.fast_sin(a) for a in x], np.sin(x), rtol=4e-16)


def test_fast_sine_is_odd_and_nan_stays_nan():
    """No angle gets a preferred sign, and a poisoned angle is not hidden."""
    x = np.random.default_rng(2).uniform(0, 50, 1000)
    assert all(geometry.fast_sin(-a) == -geometry.fast_sin(a) for a in x)
    assert math.isnan(geometry.fast_sin(math.nan))


def test_fast_sine_at_multiples_of_half_pi():
    """Where range reduction switches."""
    for k in range(-9, 10):
        assert geometry.fast_sin(k * np.pi / 2) == pytest.approx(math.sin(k * np.pi / 2), abs=3e-16)


def test_sine_of_small_angles_is_the_sine():
    """Up to its limit as good as the one for all angles; beyond it still to 1e-12 at 0.3 rad; odd."""
    x = np.concatenate([np.geomspace(1e-18, geometry.SMALL_ANGLE, 2000), [0.0]])
    np.testing.assert_allclose([geometry.sin_small(a) for a in x], np.sin(x), rtol=4e-16)
    assert geometry.sin_small(0.3) == pytest.approx(math.sin(0.3), rel=1e-12)
    assert all(geometry.sin_small(-a) == -geometry.sin_small(a) for a in x)


def test_cosine_near_a_known_one():
    """At any latitude, over more than a berg drifts in a long step (0.02 rad are 127 km)."""
    for at in np.radians([-90.0, -60.0, 0.0, 30.0, 89.0]):
        for turn in (-0.02, -1e-5, 0.0, 3e-4, 0.02):
            got = geometry.cos_near(math.cos(at), math.sin(at), turn)
            assert got == pytest.approx(math.cos(at + turn), abs=2e-13)


def test_fast_cosine_of_latitude_over_its_range():
    """From pole to pole, and even."""
    degrees = np.linspace(0, 90, 10_001)
    got = np.array([geometry.fast_cos_latitude(d) for d in degrees])
    np.testing.assert_allclose(got, np.cos(np.radians(degrees)), rtol=0, atol=4e-16)
    np.testing.assert_array_equal(got, [geometry.fast_cos_latitude(-d) for d in degrees])


@quick
@given(lat=between(-89.9, 89.9), radius=between(1e6, 7e6), latlon=st.booleans())
def test_metric_equals_twin(lat, radius, latlon):
    """Spec 2.2."""
    assert_same(geometry.metres_per_unit(lat, latlon, radius), twin.metric(lat, latlon, radius))


def test_a_degree_of_latitude_is_111_km_and_longitude_shrinks():
    """By hand."""
    x, y = geometry.metres_per_unit(60.0, True, RADIUS)
    assert y == pytest.approx(111_069.7, abs=0.1)
    assert x == pytest.approx(y / 2, rel=1e-14)


@quick
@given(difference=between(-2000, 2000), period=st.sampled_from([360.0, 20_000.0, 7.3, 0.0, -1.0]))
def test_nearest_image_equals_twin(difference, period):
    """Spec 8.2; near the seam either side is right up to round-off."""
    got = geometry.nearest_image(difference, period)
    want = twin.nearest_image(difference, period)
    if period > 0 and abs(got - want) > period / 2:
        want += math.copysign(period, got - want)
    assert got == pytest.approx(want, abs=1e-12 * max(abs(difference), 1.0) * 4)
    if period > 0:
        assert abs(got) <= period / 2 * (1 + 1e-12)


@pytest.mark.parametrize(
    ("difference", "expected"),
    [(0.0, 0.0), (180.0, -180.0), (-180.0, -180.0), (181.0, -179.0), (-181.0, 179.0), (359.0, -1.0), (-725.0, -5.0)],
)
def test_nearest_image_by_hand(difference, expected):
    """The interval is [-180, 180), closed at the west end as the docstring says."""
    assert geometry.nearest_image(difference, 360.0) == expected


def test_nearest_image_leaves_small_differences_bit_for_bit():
    """Inside the interval nothing may be lost: neighbours are 1e-2 degrees apart on a sphere of 360."""
    for d in np.random.default_rng(3).uniform(-170, 170, 500):
        assert geometry.nearest_image(d, 360.0) == d


@quick
@given(x=longitude, y=latitude, dx=between(-1, 1), dy=between(-1, 1), latlon=st.booleans())
def test_separation_equals_twin_and_is_antisymmetric(x, y, dx, dy, latlon):
    """Spec 2.2: the metric of the mean latitude makes the vector the same for both partners."""
    got = geometry.separation(x + dx, y + dy, x, y, latlon, RADIUS, 360.0 if latlon else 0.0)
    want = twin.separation((x + dx, y + dy), (x, y), latlon, RADIUS, 360.0 if latlon else 0.0)
    assert_same(got, want)
    back = geometry.separation(x, y, x + dx, y + dy, latlon, RADIUS, 360.0 if latlon else 0.0)
    assert (back[0], back[1]) == (-got[0], -got[1])


def test_separation_points_from_second_to_first():
    """Sign on each axis."""
    assert geometry.separation(5.0, 7.0, 2.0, 3.0, False, RADIUS, 0.0) == (3.0, 4.0)


@quick
@given(lon=between(-500, 500), lat=latitude, dx=between(-1, 1), dy=between(-1, 1), wraps=st.integers(-2, 2))
def test_separation_does_not_see_the_seam(lon, lat, dx, dy, wraps):
    """Whole periods more or less on either side change nothing but round-off of the longitudes."""
    near = geometry.separation(lon + dx, lat + dy, lon, lat, True, RADIUS, 360.0)
    far = geometry.separation(lon + dx + 360.0 * wraps, lat + dy, lon, lat, True, RADIUS, 360.0)
    np.testing.assert_allclose(far, near, rtol=0, atol=1e-6)


@quick
@given(lon=longitude, lat=polar_latitude)
def test_polar_plane_equals_twin_and_comes_back(lon, lat):
    """Spec 2.3, to and from."""
    plane = geometry.to_tangent_plane(lon, lat, RADIUS)
    assert_same(plane, twin.to_plane(lon, lat, RADIUS))
    back = geometry.from_tangent_plane(*plane, RADIUS)
    # the arc cosine of equations 2.3 loses half the digits where the cosine is near 1
    assert back[0] == pytest.approx(lon, abs=3e-6)
    assert back[1] == pytest.approx(lat, abs=1e-12)


@quick
@given(lon=longitude, u=speed, v=speed)
def test_polar_vectors_equal_twin_and_come_back(lon, u, v):
    """The turn is orthogonal."""
    plane = geometry.vector_to_plane(lon, u, v)
    assert_same(plane, twin.rotation(lon) @ [u, v])
    assert_same(geometry.vector_from_plane(lon, *plane), (u, v))
    assert math.hypot(*plane) == pytest.approx(math.hypot(u, v), rel=1e-14)


def test_polar_axes_by_hand():
    """At longitude 0 east is +Y, and north is towards the pole, -X."""
    np.testing.assert_allclose(geometry.vector_to_plane(0.0, 1.0, 0.0), (0.0, 1.0), atol=1e-16)
    np.testing.assert_allclose(geometry.vector_to_plane(0.0, 0.0, 1.0), (-1.0, 0.0), atol=1e-16)
    x, y = geometry.to_tangent_plane(90.0, 89.5, RADIUS)
    assert y > 0
    assert abs(x) < 1e-6 * y


@quick
@given(lon=longitude, lat=between(-88, 88.9), u=speed, v=speed, dt=between(1, 3600), latlon=st.booleans())
def test_move_equals_twin(lon, lat, u, v, dt, latlon):
    """Spec 6.2, 6.4 away from the pole."""
    got = geometry.move(lon, lat, u, v, dt, latlon, RADIUS)
    want = twin.move(lon, lat, (u, v), dt, latlon, RADIUS)
    assert_same(got, want)


@quick
@given(lon=between(1, 179), lat=between(89.01, 89.9), u=speed, v=speed, sign=st.sampled_from([-1.0, 1.0]))
def test_move_near_the_pole_equals_twin(lon, lat, u, v, sign):
    """On the polar plane; away from longitudes 0 and 180, where an arc cosine loses digits."""
    got = geometry.move(sign * lon, lat, u, v, 600.0, True, RADIUS)
    want = twin.move(sign * lon, lat, (u, v), 600.0, True, RADIUS)
    # The kernel keeps the branch of the longitude, so that a berg that crosses 180 degrees does not jump.
    turns = round((got[0] - want[0]) / 360.0)
    assert abs(got[0] - sign * lon) <= 180.0
    assert got[0] == pytest.approx(want[0] + 360.0 * turns, abs=1e-9)
    assert got[1] == pytest.approx(want[1], abs=1e-12)


def test_move_goes_east_and_north():
    """Sign on each axis, on the sphere and on the polar plane."""
    for lat in (-60.0, 89.5):
        east = geometry.move(30.0, lat, 1.0, 0.0, 100.0, True, RADIUS)
        north = geometry.move(30.0, lat, 0.0, 1.0, 100.0, True, RADIUS)
        assert east[0] > 30.0
        assert north[1] > lat


def test_move_across_the_pole_comes_down_the_other_side():
    """Due north for twice the distance to the pole ends at the same latitude on the opposite meridian."""
    distance = math.radians(0.5) * RADIUS
    lon, lat = geometry.move(30.0, 89.5, 0.0, 2 * distance / 1000.0, 1000.0, True, RADIUS)
    assert lat == pytest.approx(89.5, abs=1e-9)
    assert lon == pytest.approx(-150.0, abs=1e-6)


def test_move_agrees_on_both_sides_of_89_degrees():
    """The two formulas for the same small move differ by the curvature of the step only."""
    plane = np.array(geometry.move(30.0, 89.0000001, 0.3, -0.2, 10.0, True, RADIUS)) - (30.0, 89.0000001)
    sphere = np.array(geometry.move(30.0, 88.9999999, 0.3, -0.2, 10.0, True, RADIUS)) - (30.0, 88.9999999)
    np.testing.assert_allclose(plane, sphere, rtol=1e-3)


@quick
@given(lon=longitude, lat=between(88, 90), u=speed, v=speed, ax=speed, ay=speed, latlon=st.booleans())
def test_velocity_update_equals_twin(lon, lat, u, v, ax, ay, latlon):
    """Spec 2.3: an identity turned there and back."""
    got = geometry.add_velocity(lon, lat, u, v, ax, ay, 20.0, latlon)
    assert_same(got, twin.add_velocity(lon, lat, (u, v), (ax, ay), 20.0, latlon), scale=abs(u) + abs(v))
    assert_same(got, (u + 20.0 * ax, v + 20.0 * ay), scale=abs(u) + abs(v) + 20 * (abs(ax) + abs(ay)))


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_elimination_takes_the_largest_pivot_wherever_it_stands(order):
    """Entries of which each but the right one would lose all digits of the result, in the first and in the second column."""
    a = np.array([[1e-20, 1.0, 2.0], [3.0, 1e-20, -1.0], [1e-20, 1e-20, 5.0]])[list(order)]
    a[:, 1] += a[:, 0]  # so that the second pivot is found after the first elimination
    given, right = a.copy(), a @ np.array([1.0, -2.0, 3.0])
    kept = right.copy()
    np.testing.assert_allclose(geometry.solve(a, right), [1.0, -2.0, 3.0], rtol=1e-14)
    assert (a == given).all()
    assert (right == kept).all()
    out = np.empty((1, 3, 3))
    geometry.invert(a[None], out, np.empty((1, 3, 3)))
    np.testing.assert_allclose(out[0] @ a, np.eye(3), atol=1e-14)
