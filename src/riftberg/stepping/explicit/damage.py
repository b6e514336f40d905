"""Damage of the bonds in a sub-step: what the stress just found takes from the strength of each row.

It is done in the sub-steps, where stresses are found and tested, and before the test: stresses in a lattice ring with
periods of minutes, and a long step that looked only at its end would see one phase of that. The limits of the rows hold
what is left of the strengths, so the test itself does not change. Where no row is above the threshold, which is most of
the time with a threshold of some tenths, nothing but one vectorised loop is run.
"""

from __future__ import annotations

from riftberg.compiled.kernels import kernel
from riftberg.physics.damage import damage_rate, grown_damage, stress_ratio
from riftberg.stepping.explicit import bond_blocks as row
from riftberg.stepping.fracture.strengths import residual_strength


@kernel
def damage_rows(block, sheet, dt, p):
    """Let the damage of the unbroken rows of a block grow over ``dt`` (s), and lower their limits accordingly."""
    if loaded(block, sheet, p.damage_threshold) > 0:
        _grow(block, sheet, dt, p)


@kernel
def loaded(block, sheet, threshold):
    """Number of unbroken rows of a block whose stress is above this part of their strength.

    A whole number, so that the loop vectorises.

    Rows without stress and strength, and those whose stress is not a number, are not among them.
    """
    count = 0
    for k in range(row.LANES):
        torn = sheet[row.NORMAL_STRESS + k] > threshold * block[row.NORMAL_LIMIT + k]
        sheared = sheet[row.SHEAR_STRESS + k] > threshold * block[row.SHEAR_LIMIT + k]
        count += 1 if (torn | sheared) & (block[row.ALIVE + k] > 0.0) else 0
    return count


@kernel
def _grow(block, sheet, dt, p):
    """Raise the damage of the rows above the threshold."""
    threshold = p.damage_threshold
    for k in range(row.LANES):
        tension, shear = sheet[row.NORMAL_STRESS + k], sheet[row.SHEAR_STRESS + k]
        normal, sliding = block[row.NORMAL_LIMIT + k], block[row.SHEAR_LIMIT + k]
        over = tension > threshold * normal or shear > threshold * sliding
        if block[row.ALIVE + k] == 0.0 or not over:
            continue
        ratio = stress_ratio(tension, shear, normal, sliding)
        rate = damage_rate(ratio, threshold, p.damage_time, p.damage_exponent)
        damage = grown_damage(block[row.DAMAGE + k], rate, dt)
        block[row.DAMAGE + k] = damage
        block[row.NORMAL_LIMIT + k], block[row.SHEAR_LIMIT + k] = residual_strength(
            p.normal_strength, p.shear_strength, block[row.STRENGTH + k], damage
        )
