"""Damage of the bonds in a sub-step: what the stress just found takes from the strength of each row.

It is done in the sub-steps, where stresses are found and tested, and before the test: stresses in a lattice ring with
periods of minutes, and a long step that looked only at its end would see one phase of that. The limits of the rows hold
what is left of the strengths, so the test itself does not change. Where no row is above the threshold, which is most of
the time with a threshold of some tenths, nothing but one vectorised loop is run.
"""

from __future__ import annotations

from riftberg.kernels import kernel
from riftberg.physics.damage import damage_rate, grown_damage, stress_ratio
from riftberg.stepping import bond_blocks as row


@kernel
def damage_rows(rows, count, dt, p):
    """Let the damage of unbroken rows 0 ... count - 1 grow over ``dt`` (s), and lower their limits accordingly."""
    if _loaded(rows, count, p.damage_threshold) > 0.0:
        _grow(rows, count, dt, p)


@kernel
def _loaded(rows, count, threshold):
    """Number of unbroken rows whose stress is above the threshold.

    Rows without stress and strength, and those whose stress is not a number, are not among them.
    """
    loaded = 0
    for b in range(row.blocks_of(count)):
        loaded += _loaded_of(rows.block[b * row.BLOCK : (b + 1) * row.BLOCK], threshold)
    return loaded


@kernel
def _loaded_of(block, threshold):
    """As `_loaded`, for one block; a whole number, so that the loop vectorises."""
    loaded = 0
    for k in range(row.LANES):
        torn = block[row.NORMAL_STRESS + k] > threshold * block[row.NORMAL_LIMIT + k]
        sheared = block[row.SHEAR_STRESS + k] > threshold * block[row.SHEAR_LIMIT + k]
        loaded += 1 if (torn | sheared) & (block[row.ALIVE + k] > 0.0) else 0
    return loaded


@kernel
def _grow(rows, count, dt, p):
    """Raise the damage of the rows above the threshold."""
    block, threshold = rows.block, p.damage_threshold
    for r in range(count):
        at = row.place_of(r)
        tension, shear = block[at + row.NORMAL_STRESS], block[at + row.SHEAR_STRESS]
        normal, sliding = block[at + row.NORMAL_LIMIT], block[at + row.SHEAR_LIMIT]
        over = tension > threshold * normal or shear > threshold * sliding
        if block[at + row.ALIVE] == 0.0 or not over:
            continue
        ratio = stress_ratio(tension, shear, normal, sliding)
        rate = damage_rate(ratio, threshold, p.damage_time, p.damage_exponent)
        damage = grown_damage(block[at + row.DAMAGE], rate, dt)
        block[at + row.DAMAGE] = damage
        block[at + row.NORMAL_LIMIT], block[at + row.SHEAR_LIMIT] = limits_left(
            p.normal_strength, p.shear_strength, block[at + row.STRENGTH], damage
        )


@kernel
def limits_left(normal_strength, shear_strength, strength, damage):
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)
