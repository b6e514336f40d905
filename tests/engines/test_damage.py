"""Damage that bonds bring along into a scheme in which none grows."""

from __future__ import annotations

import numpy as np

from engines.lattices import lattice, long_step, settings
from engines.test_twins import FAST
from riftberg.state import copy_state

WEAK = {"enabled": True, "normal_strength": 300e3, "shear_strength": 60e3}


def test_damage_that_is_there_stays_and_counts():
    """Nothing grows; what a bond has lost before is lost."""
    p = settings(fracture=WEAK)
    el, bonds = lattice(1, p.kernel_values())
    other, weak = copy_state(el, bonds)
    worn, strong = copy_state(el, bonds)
    weak.strength[:] *= 0.25
    strong.damage[:] = 0.75
    assert long_step(other, weak, p, 80.0, 4, may_break=True) == long_step(worn, strong, p, 80.0, 4, may_break=True)
    np.testing.assert_array_equal(strong.break_time, weak.break_time)
    assert (strong.damage == 0.75).all()
    for name in FAST:
        np.testing.assert_array_equal(getattr(worn, name), getattr(other, name), err_msg=name)
