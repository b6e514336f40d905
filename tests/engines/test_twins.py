"""Whole steps of the kernels against the slow plain twins, on small random lattices."""

from __future__ import annotations

import numpy as np
import pytest

from engines.lattices import lattice, long_step, settings, step
from riftberg.state import copy_state
from riftberg.state.population import listed
from twins import drag as twin_drag
from twins import stepping as twin
from twins import velocity as twin_velocity
from twins.elements import column, unpack

SEEDS = range(3)
STATE = ("lon", "lat", "u", "v", "u_sync", "v_sync", "u_pair", "v_pair", "lon_pair", "lat_pair", "ax", "ay", "bx", "by")
FAST = (*STATE, "ax_fast", "ay_fast", "spin", "spin_rate", "rotation")
MOTION = ("lon", "lat", "u", "v", "spin", "rotation")
BOND = ("shear_x", "shear_y", "normal_stress", "shear_stress", "peak_stress", "bond_length")


def compare(arrays, twins, names, *, rtol=1e-12, floor=None):
    """Each variable agrees to ``rtol`` of its largest value over the lattice, or of ``floor[name]``.

    Accelerations of elements that never move are nobody's business; their motion is.
    """
    moving = np.array([getattr(t, "static", 0.0) < 0.5 for t in twins])
    for name in names:
        rows = slice(None) if name in MOTION else moving
        got, want = getattr(arrays, name)[rows], column(twins, name)[rows]
        size = max(float(np.max(np.abs(want))), (floor or {}).get(name, 0.0))
        np.testing.assert_allclose(got, want, rtol=0, atol=rtol * size, err_msg=name)


# Bond stresses of a few MPa push elements of 1e12 kg: accelerations carry the round-off of a sum of forces that
# nearly cancel, so they are compared to 1e-12 of a bond force over a mass rather than of their own size.
DEM_FLOOR = {"ax_fast": 1e-3, "ay_fast": 1e-3, "ax": 1e-3, "ay": 1e-3, "spin_rate": 1e-6}

PLOUGH = {"law": "quadratic", "quadratic_coefficient": 200.0, "ramp_height": 0.0}

VERLET = {
    "quadratic-ground": {"grounding": PLOUGH},
    "branch-A": {},
    "branch-A-speed-damping": {
        "contact": {"tangential_critical_damping": True},
        "compatibility": {"damping_by_speed": True},
    },
    "branch-B": {"compatibility": {"plain_kid_branch": True}, "contact": {"spring": 1e-5, "distance": 0.0}},
    "no-bonds": {"bonds": {"law": "none"}},
    "no-interactions": {"stepping": {"interactions": False}},
    "interactions-only": {"stepping": {"only_interactions": True}},
    "cartesian-f-plane": {"earth": {"latlon": False, "period": 0.0, "reference_latitude": 60.0}},
    "hexagons": {"bonds": {"packing": "hexagonal"}, "compatibility": {"radius_based": True}},
    "frozen-ice": {"compatibility": {"frozen_sea_ice_drag": True}, "drag": {"sides_by_bonds": False}},
    "step-of-grounding": {"grounding": {"ramp_height": 0.0}},
    "constant-size": {"bonds": {"constant_size": True, "constant_length": 2900.0, "constant_width": 3100.0}},
}


def merged(base, options):
    """Groups of options, those of ``options`` over those of ``base``."""
    return {g: {**base.get(g, {}), **options.get(g, {})} for g in {*base, *options}}


def settings_of(options, scheme, **stepping):
    """Parameters of a single-step scheme: spring bonds of KID unless told otherwise."""
    base = {
        "bonds": {"law": "spring", "spring": 1e-5},
        "stepping": {"scheme": scheme, "time_step": 60.0, **stepping},
        "compatibility": {"rest_length_from_sizes": True},  # as the twin has it
    }
    return settings(**merged(base, options))


@pytest.mark.parametrize("options", VERLET.values(), ids=VERLET.keys())
def test_verlet_step_equals_twin(options):
    """Spec 4.2, 5.1, 5.2, 6.2."""
    chosen = settings_of(options, "verlet")
    p = chosen.kernel_values()
    for seed in SEEDS:
        el, bonds = lattice(seed, p)
        el.static[3] = float(seed % 2)
        want = twin.verlet_step(unpack(el), unpack(bonds), p, 60.0)
        step(el, bonds, chosen)
        compare(el, want, ("lon", "lat", "u", "v", "ax", "ay", "bx", "by", "u_sync", "v_sync"))


@pytest.mark.quick(8)
@pytest.mark.parametrize("mean_speeds", [False, True], ids=["mean-velocity", "mean-speeds"])
@pytest.mark.parametrize("options", VERLET.values(), ids=VERLET.keys())
def test_runge_kutta_step_equals_twin(options, mean_speeds):
    """Spec 4.2 (variant), 6.3, with the environment of the start."""
    chosen = settings_of(options, "runge_kutta", predictor_corrector=mean_speeds)
    p = chosen.kernel_values()
    for seed in SEEDS:
        el, bonds = lattice(seed, p)
        el.static[3] = float(seed % 2)
        want = twin.runge_kutta_step(unpack(el), unpack(bonds), p, 60.0, mean_speeds=mean_speeds)
        step(el, bonds, chosen)
        compare(el, want, ("lon", "lat", "u", "v", "ax", "ay", "bx", "by"))


DEM = {
    "riftberg": {},
    "quadratic-ground": {"grounding": PLOUGH},
    "quadratic-explicit-ground": {"grounding": {**PLOUGH, "implicit": False}},
    "quadratic-ground-in-long-step": {"grounding": {**PLOUGH, "on_substeps": False}},
    "reference-damper": {"bonds": {"objective_damping": False, "linear_bending": False}},
    "explicit-ground": {"grounding": {"implicit": False}},
    "ground-in-long-step": {"grounding": {"on_substeps": False}},
    "ground-torque": {"grounding": {"torque": True, "ramp_height": 0.0}},
    "constant-size": {"bonds": {"constant_size": True, "constant_length": 2900.0, "constant_width": 3100.0}},
    "hexagons": {"bonds": {"packing": "hexagonal"}, "compatibility": {"radius_based": True}},
    "no-shear": {"bonds": {"no_shear": True}},
    "one-pass": {"contact": {"iterate": False}},
    "sticky": {"compatibility": {"sticky_collision_flags": True}},
    "interactions-only": {"stepping": {"only_interactions": True}},
    "cartesian": {"earth": {"latlon": False, "period": 0.0, "reference_latitude": -55.0}},
    "contact-as-stiff-as-ice": {"contact": {"spring": None}},
    "search": {"fracture": {"broken_as_contact": False}},
    "search-explicit-contact": {
        "fracture": {"broken_as_contact": False},
        "compatibility": {"explicit_contact_damping": True},
    },
    "speed-damping": {
        "contact": {"critical_damping": False, "radial_damping": 1e-4},
        "compatibility": {"damping_by_speed": True},
    },
}


@pytest.mark.quick(10)
@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("options", DEM.values(), ids=DEM.keys())
def test_long_step_with_dem_bonds_equals_twin(options, substeps):
    """Spec 4.3, 5.3, 5.4, 6.4: closing and opening half kick with contact iteration, then sub-steps."""
    p = settings(**options)
    for seed in SEEDS:
        el, bonds = lattice(seed, p.kernel_values())
        el.static[2] = float(seed % 2)
        el.load_y[4], el.free_y[0] = -1e9, 0.0
        want, want_bonds, *_ = twin.multiple_step(
            unpack(el), unpack(bonds), p.kernel_values(), 20.0 * substeps, substeps
        )
        long_step(el, bonds, p, 20.0 * substeps, substeps)
        compare(el, want, FAST, rtol=1e-11, floor=DEM_FLOOR)
        compare(bonds, want_bonds, BOND, rtol=1e-11)


@pytest.mark.parametrize("quirk", ["shared_shear_lever", "bond_thickness_of_second"])
def test_pair_order_quirks_equal_twin(quirk):
    """Q10 and Q11: the end that is processed first counts as element 1."""
    p = settings(compatibility={quirk: True}, bonds={"objective_damping": False})
    for seed in SEEDS:
        el, bonds = lattice(seed, p.kernel_values())
        el.start_lon[:] = np.random.default_rng(seed).permutation(el.mass.size)  # by which elements are listed
        rank = np.argsort(listed(el))
        items = unpack(bonds)
        for b in items:
            if rank[b.first] > rank[b.second]:
                b.first, b.second = b.second, b.first
                b.shear_x, b.shear_y = -b.shear_x, -b.shear_y
        want, _, _, _ = twin.multiple_step(unpack(el), items, p.kernel_values(), 40.0, 2)
        long_step(el, bonds, p, 40.0, 2)
        compare(el, want, FAST, rtol=1e-11, floor=DEM_FLOOR)


SPRINGS: dict[str, dict[str, str]] = {"stepping": {"scheme": "mts"}}
"""Contact by springs belongs to the explicit schemes."""


@pytest.mark.parametrize("touching", [True, False])
def test_skipped_and_contact_free_steps_equal_twin(touching):
    """Spec 6.4, skip_first_outer_mts_step, and the exit after one pass."""
    p = settings(**SPRINGS)
    for seed in SEEDS:
        el, bonds = lattice(seed, p.kernel_values(), touching=touching)
        other, other_bonds = copy_state(el, bonds)
        want, _, _, iterations = twin.multiple_step(unpack(el), unpack(bonds), p.kernel_values(), 40.0, 2)
        assert (iterations > 1) == touching
        long_step(el, bonds, p, 40.0, 2)
        compare(el, want, FAST, rtol=1e-11, floor=DEM_FLOOR)
        want, _, _, _ = twin.multiple_step(
            unpack(other), unpack(other_bonds), p.kernel_values(), 40.0, 2, skip_outer=True
        )
        long_step(other, other_bonds, p, 40.0, 2, skip_outer=True)
        compare(other, want, FAST, rtol=1e-11, floor=DEM_FLOOR)


def test_flags_left_from_earlier_steps_enter_the_norm():
    """Q2: with the flags kept, an element that is no longer in contact still counts."""
    p = settings(compatibility={"sticky_collision_flags": True}, contact={"tolerance": 1e-3}, **SPRINGS)
    counts = set()
    for flagged in (0.0, 1.0):
        el, bonds = lattice(3, p.kernel_values())
        el.in_contact[:4] = flagged
        el.u[:4] += 10.0
        want, _, _, iterations = twin.multiple_step(
            unpack(el), unpack(bonds), p.kernel_values(), 1800.0, 90, skip_outer=False
        )
        long_step(el, bonds, p, 1800.0, 90)
        np.testing.assert_array_equal(el.in_contact, column(want, "in_contact"))
        counts.add(iterations)
    assert len(counts) == 2


@pytest.mark.quick(2)
@pytest.mark.parametrize("keep", [True, False], ids=["broken-as-contact", "search"])
@pytest.mark.parametrize("objective", [True, False], ids=["objective", "reference-damper"])
def test_breaking_inside_the_long_step_equals_twin(keep, objective):
    """Spec 7.2 with Q31: which bonds break, when, what they still do, and contact of their ends afterwards."""
    p = settings(
        fracture={"enabled": True, "broken_as_contact": keep, "normal_strength": 60e3, "shear_strength": 20e3},
        bonds={"objective_damping": objective},
    )
    broken = crushed = 0
    for seed in range(12):
        el, bonds = lattice(seed, p.kernel_values())
        want, want_bonds, count, _ = twin.multiple_step(
            unpack(el), unpack(bonds), p.kernel_values(), 80.0, 4, may_break=True
        )
        assert long_step(el, bonds, p, 80.0, 4, may_break=True) == count
        np.testing.assert_array_equal(bonds.status != 0, column(want_bonds, "status") != 0)
        np.testing.assert_array_equal(bonds.break_time, column(want_bonds, "break_time"))
        np.testing.assert_array_equal(bonds.break_grounded, column(want_bonds, "break_grounded"))
        np.testing.assert_array_equal(el.bond_count, column(want, "bond_count"))
        compare(el, want, FAST, rtol=1e-10, floor=DEM_FLOOR)
        compare(bonds, want_bonds, BOND, rtol=1e-10)
        broken += count
        crushed += int(np.sum((bonds.status != 0) & (bonds.normal_stress < 0)))
    assert broken > 10
    assert crushed > 2


def test_peak_stress_is_that_of_one_long_step():
    """It starts from the stress at hand, not from the peak of the step before, and is no less than any later one."""
    p = settings()
    el, bonds = lattice(1, p.kernel_values())
    bonds.normal_stress[::3], bonds.peak_stress[:] = 1e9, 1e12
    _, want_bonds, _, _ = twin.multiple_step(unpack(el), unpack(bonds), p.kernel_values(), 80.0, 4)
    long_step(el, bonds, p, 80.0, 4)
    compare(bonds, want_bonds, BOND, rtol=1e-10)
    assert (bonds.peak_stress[::3] == 1e9).all()
    assert (bonds.peak_stress >= bonds.normal_stress).all()
    assert (bonds.peak_stress > bonds.normal_stress)[1::3].any()


SPRING = {
    "explicit": {},
    "explicit-one-pass": {"contact": {"iterate": False}},
    "explicit-speed-damping": {
        "contact": {"tangential_critical_damping": True},
        "compatibility": {"damping_by_speed": True},
    },
    "uncentred-half-kicks": {"compatibility": {"uncentred_half_kicks": True}},
    "implicit": {"stepping": {"explicit_substeps": False}},
    "implicit-quadratic-ground": {"stepping": {"explicit_substeps": False}, "grounding": PLOUGH},
    "implicit-Q1": {"stepping": {"explicit_substeps": False}, "compatibility": {"swapped_implicit_velocity": True}},
    "implicit-one-pass": {"stepping": {"explicit_substeps": False}, "contact": {"iterate": False}},
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("options", SPRING.values(), ids=SPRING.keys())
def test_long_step_with_spring_bonds_equals_twin(options):
    """Spec 4.3 (part 3), 5.3 without DEM, 6.4: bergs act on each other in the long step, bonds in the sub-steps."""
    base = {
        "bonds": {"law": "spring", "spring": 1e-5}, "grounding": {"on_substeps": False},
        "compatibility": {"rest_length_from_sizes": True},  # as the twin has it
    }  # fmt: skip
    p = settings(**merged(base, options))
    for seed in SEEDS:
        el, bonds = lattice(seed, p.kernel_values())
        want, _, _, _ = twin.multiple_step(unpack(el), unpack(bonds), p.kernel_values(), 120.0, 2)
        long_step(el, bonds, p, 120.0, 2)
        compare(el, want, (*STATE, "ax_fast", "ay_fast", "bx_fast", "by_fast"), rtol=1e-11)


def test_twin_of_the_slow_solve_satisfies_its_own_equation():
    """The twin is not only a copy: its matrix equation holds for the acceleration that it gives (equations 4.3)."""
    p = settings(stepping={"only_interactions": True})
    el, bonds = lattice(1, p.kernel_values())
    items, links = unpack(el), unpack(bonds)
    for k in range(len(items)):
        s = twin_velocity.slow_acceleration(k, items, links, p.kernel_values(), 1800.0)
        u0 = np.array([items[k].u, items[k].v])
        u1 = u0 + 1800.0 * s.A
        spring, tensor, vec = twin_velocity.kid_terms(
            k, items, links, p.kernel_values(), u0, u1, inside=False, outside=True, multiple=True
        )
        residual = s.A - spring / 2 - (vec - tensor @ u1) / 2
        assert np.abs(residual).max() <= 1e-14 * (np.abs(s.A).max() + np.abs(spring).max() + 1e-12)


def test_spring_bonds_act_in_the_sub_steps_only():
    """Bug once: with spring bonds the slow half kicks held the bonded pairs, and the sub-steps the collisions (5.1)."""
    p = settings(
        bonds={"law": "spring", "spring": 1e-5}, stepping={"only_interactions": True}, grounding={"on_substeps": False},
        compatibility={"rest_length_from_sizes": True},
    )  # fmt: skip
    el, bonds = lattice(1, p.kernel_values(), touching=False)
    u, v = el.u.copy(), el.v.copy()
    long_step(el, bonds, p, 1e-9, 1)
    np.testing.assert_array_equal(el.u_sync, u)
    np.testing.assert_array_equal(el.v_sync, v)
    assert np.abs(el.ax_fast).max() > 1e-5
    p = p.changed(bonds={"spring": 0.0})
    el, bonds = lattice(1, p.kernel_values())
    long_step(el, bonds, p, 1e-9, 1)
    assert np.abs(el.ax_fast).max() == 0.0
    assert np.abs(el.u_sync - u).max() > 0.0


def test_runge_kutta_pair_forces_are_equal_and_opposite():
    """Bug once: each element saw itself at its stage but its partner at the start, so momentum was made (5.2)."""
    chosen = settings_of(
        {
            "contact": {"critical_damping": False},
            "stepping": {"only_interactions": True, "time_step": 600.0},
            "earth": {"latlon": False, "period": 0.0},
        },
        "runge_kutta",
    )
    el, bonds = lattice(2, chosen.kernel_values())
    el.ax[:] = el.ay[:] = 0.0
    before = np.array([el.mass @ el.u, el.mass @ el.v])
    own = np.abs(el.mass * el.u).sum()
    start = el.u.copy()
    step(el, bonds, chosen)
    assert np.abs(el.u - start).max() > 1e-3
    np.testing.assert_allclose([el.mass @ el.u, el.mass @ el.v], before, rtol=0, atol=1e-13 * own)


def test_long_step_near_the_pole_equals_twin():
    """Spec 2.3 in the sub-steps: positions on the tangent plane; longitudes stay on the branch of the start."""
    p = settings()
    for seed in SEEDS:
        el, bonds = lattice(seed, p.kernel_values(), latitude=89.5)
        start = el.lon.copy()
        want, want_bonds, _, _ = twin.multiple_step(unpack(el), unpack(bonds), p.kernel_values(), 60.0, 3)
        long_step(el, bonds, p, 60.0, 3)
        compare(el, want, ("lat", "u", "v", "spin"), rtol=1e-9)
        np.testing.assert_allclose(el.lon % 360.0, column(want, "lon") % 360.0, rtol=0, atol=1e-9)
        assert np.abs(el.lon - start).max() < 5.0
        compare(bonds, want_bonds, BOND, rtol=1e-6)


def test_water_brakes_spin_towards_half_its_vorticity():
    """Riftberg's rotational drag over a long step, against many small steps of its differential equation."""
    p = settings(drag={"rotational": True}, bonds={"law": "dem", "youngs_modulus": 0.0})
    el, bonds = lattice(4, p.kernel_values())
    el.spin[:] = np.random.default_rng(4).normal(0, 1e-3, el.mass.size)
    el.vorticity[:] = np.random.default_rng(5).normal(0, 1e-4, el.mass.size)
    spin, water = el.spin.copy(), el.vorticity / 2
    for k in range(el.mass.size):
        radius = np.sqrt(el.length[k] * el.width[k]) / 2
        kernel = p.kernel_values()
        c = twin_drag.spin(0.5 * el.mass[k] * radius**2, radius, kernel.ocean_scale, kernel.water_base_drag)
        for _ in range(20_000):
            spin[k] -= 1800.0 / 20_000 * c * abs(spin[k] - water[k]) * (spin[k] - water[k])
    before = el.spin.copy()
    long_step(el, bonds, p, 1800.0, 1)
    assert np.abs(el.spin - before).max() > 1e-6
    np.testing.assert_allclose(el.spin - before, spin - before, rtol=1e-4)
