"""Damage inside the long step: against the twin, in any order of the bonds, and without any trace where it is off."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.state import Bonds, copy_state
from stepping.lattices import lattice, long_step, parameters
from stepping.test_twins import BOND, DEM_FLOOR, FAST, compare
from twins import stepping as twin
from twins.elements import column, unpack

WEAK = {"enabled": True, "normal_strength": 300e3, "shear_strength": 60e3}
LAWS = {
    "no threshold": {"threshold": 0.0, "time_scale": 200.0, "exponent": 2.0},
    "threshold": {"threshold": 0.4, "time_scale": 100.0, "exponent": 1.3},
    "at once": {"threshold": 0.2, "time_scale": 1e-3, "exponent": 2.0},
}


@pytest.mark.parametrize("keep", [True, False], ids=["broken-as-contact", "search"])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_a_long_step_with_damage_equals_the_twin(law, keep):
    """Damage, which bonds break and when, and the motion afterwards; bonds start with some damage."""
    p = parameters(fracture={**WEAK, "broken_as_contact": keep}, damage={"enabled": True, **law})
    broken = worn = spared = 0
    for seed in range(6):
        el, bonds = lattice(seed, p)
        bonds.damage[:] = np.random.default_rng(seed).uniform(0.0, 0.3, bonds.damage.size)
        before = bonds.damage.copy()
        want, want_bonds, count, _ = twin.multiple_step(
            unpack(el), unpack(bonds), p, 80.0, 4, may_break=True, grow_damage=True
        )
        assert long_step(el, bonds, p, 80.0, 4, may_break=True, grow_damage=True).broken == count
        np.testing.assert_array_equal(bonds.status != 0, column(want_bonds, "status") != 0)
        np.testing.assert_array_equal(bonds.break_time, column(want_bonds, "break_time"))
        np.testing.assert_allclose(bonds.damage, column(want_bonds, "damage"), rtol=0, atol=1e-9)
        compare(el, want, FAST, rtol=1e-10, floor=DEM_FLOOR)
        compare(bonds, want_bonds, BOND, rtol=1e-10)
        assert (bonds.damage >= before).all()
        broken += count
        worn += int(np.sum((bonds.damage > before) & (bonds.status == 0)))
        spared += int(np.sum(bonds.damage == before))
    assert broken > 10
    assert worn > 3 or law is LAWS["at once"]
    assert spared > 3 or law is LAWS["no threshold"]


def test_damage_makes_bonds_break_that_else_hold():
    counts = []
    for grow_damage in (False, True):
        p = parameters(fracture=WEAK, damage={"enabled": True, **LAWS["no threshold"]})
        states = [lattice(seed, p) for seed in range(6)]
        counts.append(sum(long_step(*s, p, 80.0, 4, may_break=True, grow_damage=grow_damage).broken for s in states))
    assert counts[1] > counts[0] > 0


def test_without_it_damage_that_is_there_stays_and_counts():
    """Off, nothing grows; what a bond has lost before is lost."""
    p = parameters(fracture=WEAK)
    el, bonds = lattice(1, p)
    other, weak = copy_state(el, bonds)
    worn, strong = copy_state(el, bonds)
    weak.strength[:] *= 0.25
    strong.damage[:] = 0.75
    assert long_step(other, weak, p, 80.0, 4, may_break=True).broken == (
        long_step(worn, strong, p, 80.0, 4, may_break=True).broken
    )
    np.testing.assert_array_equal(strong.break_time, weak.break_time)
    assert (strong.damage == 0.75).all()
    for name in FAST:
        np.testing.assert_array_equal(getattr(worn, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("law", [LAWS["no threshold"], LAWS["threshold"]])
def test_the_order_of_the_bonds_does_not_matter(law):
    """Forces are summed in another order then, so all but the last digits."""
    p = parameters(fracture=WEAK, damage={"enabled": True, **law})
    for seed in range(4):
        el, bonds = lattice(seed, p)
        order = np.random.default_rng(seed).permutation(bonds.first.size)
        other, _ = copy_state(el, bonds)
        shuffled = Bonds._make(a[order].copy() for a in bonds)
        long_step(el, bonds, p, 80.0, 4, may_break=True, grow_damage=True)
        long_step(other, shuffled, p, 80.0, 4, may_break=True, grow_damage=True)
        np.testing.assert_array_equal(shuffled.break_time, bonds.break_time[order])
        np.testing.assert_allclose(shuffled.damage, bonds.damage[order], rtol=0, atol=1e-10)
        assert bonds.damage.max() > 0.05
