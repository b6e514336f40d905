"""Drag coefficients against their twins; exponents, limits and bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics.agreement import SEEDS, assert_same, between, quick, speed
from riftberg.physics import drag, floating
from twins import drag as twin

size = between(100, 10_000)
WATER, AIR, SEA_ICE = (0.9, 0.0012), (1.3, 0.0055), 0.9
"""Drag coefficients of the sides and of base or top (equations 0.1)."""

thickness = between(1, 500)
mass = between(1e8, 1e14)


def test_all_coefficients_equal_their_twins_on_random_elements():
    """Spec 4.1."""
    for seed in SEEDS:
        r = np.random.default_rng(seed)
        m, length, width, side = r.uniform(1e9, 1e13), *r.uniform(100, 5000, 3)
        draft, freeboard, ice, exposed, scale = *r.uniform(0, 300, 2), r.uniform(0, 3), r.uniform(), r.uniform(0, 20)
        ui, vi = r.normal(size=2)
        assert_same(
            drag.ocean_drag(m, length, width, side, draft, exposed, scale, *WATER),
            twin.ocean(m, length, width, side, draft, exposed, scale, *WATER),
        )
        assert_same(
            drag.air_drag(m, length, width, side, freeboard, exposed, *AIR),
            twin.air(m, length, width, side, freeboard, exposed, *AIR),
        )
        assert_same(
            drag.sea_ice_drag(m, side, ice, exposed, ui, vi, bool(seed % 2), SEA_ICE),
            twin.sea_ice(m, side, ice, exposed, ui, vi, bool(seed % 2), SEA_ICE),
        )
        assert_same(drag.spin_drag(m, length, scale, WATER[1]), twin.spin(m, length, scale, WATER[1]))
        assert_same(
            drag.side_spin_drag(m, length, width, draft, scale, WATER[0]),
            twin.side_spin(m, length, width, draft, scale, WATER[0]),
        )


@quick
@given(height=thickness, rho=between(500, 1024))
def test_draft_equals_twin_and_is_below_the_thickness(height, rho):
    """Floating ice."""
    assert_same(floating.draft_of(height, rho), twin.draft(height, rho))
    assert 0 < floating.draft_of(height, rho) < height


def test_draft_of_a68a():
    """Spec 10.5 names 165.85 m for 200 m of ice of 850 kg m-3."""
    assert floating.draft_of(200.0, 850.0) == pytest.approx(165.85, abs=0.005)


@quick
@given(sides=st.sampled_from([4, 6]), count=st.integers(0, 4), by_bonds=st.booleans())
def test_exposed_sides_equal_twin(sides, count, by_bonds):
    """Spec 4.1, side fraction."""
    assert_same(drag.exposed_sides(count, sides, by_bonds), twin.exposed(count, sides, by_bonds))


def test_exposed_sides_at_both_ends():
    """A loose element has all sides open, an interior one none."""
    assert drag.exposed_sides(0, 6, True) == 1.0
    assert drag.exposed_sides(6, 6, True) == 0.0
    assert drag.exposed_sides(6, 6, False) == 1.0


@quick
@given(length=size, width=size, by_radius=st.booleans())
def test_side_width_equals_twin(length, width, by_radius):
    """Spec 4, radius_based_drag."""
    assert_same(drag.side_width(length, width, by_radius), twin.side(length, width, by_radius))


def test_side_width_of_a_hexagon_is_twice_its_inradius():
    """A hexagon of inradius R has area 2 sqrt(3) R^2."""
    edge = np.sqrt(2 * np.sqrt(3)) * 1500.0
    assert drag.side_width(edge, edge, True) == pytest.approx(3000.0, rel=1e-14)


@quick
@given(m=mass, length=size, width=size, draft=thickness, exposed=between(0, 1), scale=between(0.1, 20))
def test_ocean_drag_scales_as_its_formula(m, length, width, draft, exposed, scale):
    """Linear in the scale, inverse in the mass, affine in draft and exposure."""
    c = drag.ocean_drag(m, length, width, width, draft, exposed, scale, *WATER)
    assert drag.ocean_drag(m, length, width, width, draft, exposed, 2 * scale, *WATER) == pytest.approx(
        2 * c, rel=1e-14
    )
    assert drag.ocean_drag(2 * m, length, width, width, draft, exposed, scale, *WATER) == pytest.approx(
        c / 2, rel=1e-14
    )
    base = drag.ocean_drag(m, length, width, width, 0.0, exposed, scale, *WATER)
    twice = drag.ocean_drag(m, length, width, width, 2 * draft, exposed, scale, *WATER)
    assert twice - base == pytest.approx(2 * (c - base), rel=1e-9, abs=1e-12 * c)
    assert base == pytest.approx(drag.ocean_drag(m, length, width, width, draft, 0.0, scale, *WATER), rel=1e-14)


@quick
@given(length=size, draft=thickness, scale=between(0.1, 20), m=mass)
def test_lengths_scale_as_areas(length, draft, scale, m):
    """Twice as large in every length: four times the drag force."""
    small = drag.ocean_drag(m, length, length, length, draft, 1.0, scale, *WATER)
    large = drag.ocean_drag(m, 2 * length, 2 * length, 2 * length, 2 * draft, 1.0, scale, *WATER)
    assert large == pytest.approx(4 * small, rel=1e-13)
    small = drag.air_drag(m, length, length, length, draft, 1.0, *AIR)
    assert drag.air_drag(m, 2 * length, 2 * length, 2 * length, 2 * draft, 1.0, *AIR) == pytest.approx(
        4 * small, rel=1e-13
    )


def test_effective_coefficients_of_the_paper():
    """Spec 10.5: c_{o,h} = 0.02136 and c_{o,v} = 16.02 with the scale 17.8."""
    base = drag.ocean_drag(1025.0, 1.0, 1.0, 0.0, 0.0, 1.0, 17.8, *WATER)
    face = drag.ocean_drag(1025.0, 0.0, 0.0, 1.0, 1.0, 1.0, 17.8, *WATER)
    assert base == pytest.approx(0.02136, rel=1e-12)
    assert face == pytest.approx(16.02 / 2, rel=1e-12)


@quick
@given(u=speed, v=speed, uo=speed, vo=speed, m=mass, length=size, draft=thickness)
def test_drag_force_quadruples_with_twice_the_speed_and_takes_energy(u, v, uo, vo, m, length, draft):
    """The force -c |w| w of the relative velocity w: quadratic, against w, never a gain in the water's frame."""
    c = drag.ocean_drag(m, length, length, length, draft, 1.0, 1.0, *WATER)
    w = np.array([u - uo, v - vo])

    def force(w):
        return -c * np.linalg.norm(w) * w

    assert_same(force(2 * w), 4 * force(w))
    assert force(w) @ w <= 0


def test_no_sea_ice_no_drag():
    """Limit h_i = 0, and motionless ice under the quirk only (Q36)."""
    assert drag.sea_ice_drag(1e12, 3000.0, 0.0, 1.0, 0.1, 0.1, False, SEA_ICE) == 0.0
    assert drag.sea_ice_drag(1e12, 3000.0, 1.0, 1.0, 0.0, 0.0, True, SEA_ICE) == 0.0
    moving = drag.sea_ice_drag(1e12, 3000.0, 1.0, 1.0, 0.1, 0.0, True, SEA_ICE)
    assert moving > 0
    assert drag.sea_ice_drag(1e12, 3000.0, 1.0, 1.0, 0.0, 0.0, False, SEA_ICE) == moving
    assert drag.sea_ice_drag(1e12, 3000.0, 1.0, 1.0, 0.0, -0.1, True, SEA_ICE) == moving


def test_sea_ice_drag_is_linear_in_ice_thickness_and_exposure():
    """No base term (Q33)."""
    one = drag.sea_ice_drag(1e12, 3000.0, 1.0, 1.0, 0.1, 0.0, False, SEA_ICE)
    assert drag.sea_ice_drag(1e12, 3000.0, 3.0, 0.5, 0.1, 0.0, False, SEA_ICE) == pytest.approx(1.5 * one, rel=1e-14)


@quick
@given(inertia=between(1e10, 1e20), radius=size, scale=between(0.1, 20))
def test_spin_drag_scales_as_the_fifth_power_of_the_radius(inertia, radius, scale):
    """Stress grows with r^2, the lever with r, the area with r^2."""
    c = drag.spin_drag(inertia, radius, scale, WATER[1])
    assert drag.spin_drag(inertia, 2 * radius, scale, WATER[1]) == pytest.approx(32 * c, rel=1e-13)
    assert drag.spin_drag(2 * inertia, radius, scale, WATER[1]) == pytest.approx(c / 2, rel=1e-13)
    assert drag.spin_drag(inertia, radius, 3 * scale, WATER[1]) == pytest.approx(3 * c, rel=1e-13)


@quick
@given(inertia=between(1e10, 1e20), length=size, width=size, draft=thickness, scale=between(0.1, 20))
def test_drag_of_the_sides_on_spin_scales_as_the_fourth_power_of_the_sides(inertia, length, width, draft, scale):
    """Pressure grows with x^2, the lever with x; no draft, no drag; which side is called the length makes no difference."""
    c = drag.side_spin_drag(inertia, length, width, draft, scale, WATER[0])
    assert drag.side_spin_drag(inertia, 2 * length, 2 * width, draft, scale, WATER[0]) == pytest.approx(
        16 * c, rel=1e-13
    )
    assert drag.side_spin_drag(inertia, width, length, draft, scale, WATER[0]) == pytest.approx(c, rel=1e-13)
    assert drag.side_spin_drag(2 * inertia, length, width, draft, 3 * scale, WATER[0]) == pytest.approx(
        1.5 * c, rel=1e-13
    )
    assert drag.side_spin_drag(inertia, length, width, 2 * draft, scale, WATER[0]) == pytest.approx(2 * c, rel=1e-13)
    assert drag.side_spin_drag(inertia, length, width, 0.0, scale, WATER[0]) == 0.0


@pytest.mark.parametrize(
    ("length", "width", "draft", "torque"),
    [(60.0, 40.0, 33.2, 6.20e3 + 1.23e3), (1000.0, 700.0, 190.0, 2.74e9 + 6.6e8), (3e3, 3e3, 166.0, 2 * 1.94e11)],
)
def test_torque_of_the_sides_is_that_of_panels(length, width, draft, torque):
    """N m at 1e-3 s-1, found with panels by others."""
    assert drag.side_spin_drag(1.0, length, width, draft, 1.0, WATER[0]) * 1e-6 == pytest.approx(torque, rel=0.005)
