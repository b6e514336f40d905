"""Damage of the bonds in a sub-step: what the stress just found takes from the strength of each row.

It is done in the sub-steps, where stresses are found and tested, and before the test: stresses in a lattice ring with
periods of minutes, and a long step that looked only at its end would see one phase of that. The limits of the rows hold
what is left of the strengths, so the test itself does not change. Where no row is above the threshold, which is most of
the time with a threshold of some tenths, nothing but one vectorised loop is run.
"""

from __future__ import annotations

from riftberg.kernels import kernel
from riftberg.physics.damage import damage_rate, grown_damage, stress_ratio


@kernel
def damage_rows(rows, count, dt, p):
    """Let the damage of unbroken rows 0 ... count - 1 grow over ``dt`` (s), and lower their limits accordingly."""
    if _loaded(rows, count, p.damage_threshold) > 0.0:
        _grow(rows, count, dt, p)


@kernel
def _loaded(rows, count, threshold):
    """Number of unbroken rows whose stress is above the threshold; a loop that vectorises.

    Rows without stress and strength, and those whose stress is not a number, are not among them.
    """
    loaded = 0
    for r in range(count):
        tension, shear = threshold * rows.normal_limit[r], threshold * rows.shear_limit[r]
        over = (rows.normal_stress[r] > tension) | (rows.shear_stress[r] > shear)
        loaded += 1 if over & (rows.alive[r] > 0.0) else 0
    return loaded


@kernel
def _grow(rows, count, dt, p):
    """Raise the damage of the rows above the threshold; arrays are taken out of the named tuple first (see `kernels`)."""
    normal_stress, shear_stress, normal, shear = (
        rows.normal_stress, rows.shear_stress, rows.normal_limit, rows.shear_limit,
    )  # fmt: skip
    alive, damage, strength, threshold = rows.alive, rows.damage, rows.strength, p.damage_threshold
    for r in range(count):
        over = normal_stress[r] > threshold * normal[r] or shear_stress[r] > threshold * shear[r]
        if alive[r] == 0.0 or not over:
            continue
        ratio = stress_ratio(normal_stress[r], shear_stress[r], normal[r], shear[r])
        rate = damage_rate(ratio, threshold, p.damage_time, p.damage_exponent)
        damage[r] = grown_damage(damage[r], rate, dt)
        normal[r], shear[r] = limits_left(p.normal_strength, p.shear_strength, strength[r], damage[r])


@kernel
def limits_left(normal_strength, shear_strength, strength, damage):
    """Stresses (Pa) above which a bond of this relative strength and damage breaks: ``(1 - D)`` of both strengths."""
    left = 1.0 - damage
    return left * (normal_strength * strength), left * (shear_strength * strength)
