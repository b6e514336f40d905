"""Connected parts of the lattice, joined by intact bonds, and the bonds that no longer count (equations 1.5, 7.1)."""

from __future__ import annotations

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.fracture import exceeds
from riftberg.state import Bonds, Elements, Ints
from riftberg.state.neighbours import partners_over_bonds


@kernel
def connected_parts(count: int, first: Ints, second: Ints, status: Ints) -> Ints:
    """Number the connected parts 0, 1, ... in order of their first element.

    ``first``, ``second``, ``status``: ends of the bonds (shape (bonds,)).
    """
    start, partner, _ = partners_over_bonds(first, second, status, count)
    part = np.full(count, -1, np.int64)
    stack = np.empty(count, np.int64)
    parts = 0
    for seed in range(count):
        if part[seed] >= 0:
            continue
        part[seed] = parts
        # A stack of its own: recursion would go as deep as the berg has elements.
        stack[0] = seed
        depth = 1
        while depth > 0:
            depth -= 1
            e = stack[depth]
            for k in range(start[e], start[e + 1]):
                c = partner[k]
                if part[c] < 0:
                    part[c] = parts
                    stack[depth] = c
                    depth += 1
        parts += 1
    return part


@kernel
def drop_parted_bonds(bonds: Bonds, part: Ints) -> None:
    """Retire broken bonds whose ends now belong to different parts (status 2): contact between fragments takes over."""
    for b in range(bonds.first.size):
        if bonds.status[b] == 1 and part[bonds.first[b]] != part[bonds.second[b]]:
            bonds.status[b] = 2


@kernel
def drop_broken_bonds(bonds: Bonds) -> None:
    """Retire all broken bonds, where they are not kept as contact pairs."""
    for b in range(bonds.first.size):
        if bonds.status[b] == 1:
            bonds.status[b] = 2


@stage
def break_after_step(el: Elements, bonds: Bonds, normal_strength: float, shear_strength: float, time: float) -> int:
    """Break and drop the bonds whose stored stress is above a threshold; a threshold <= 0 never breaks (equations 7.1)."""
    first, second, status, count = bonds.first, bonds.second, bonds.status, el.body.bond_count
    normal_stress, shear_stress, break_time = bonds.normal_stress, bonds.shear_stress, bonds.break_time
    own_strength, damage, broken_at = bonds.strength, bonds.damage, bonds.break_strength
    normal = normal_strength if normal_strength > 0.0 else np.inf
    shear = shear_strength if shear_strength > 0.0 else np.inf
    broken = 0
    for b in range(first.size):
        strength = own_strength[b] * (1.0 - damage[b])
        if status[b] == 0 and exceeds(normal_stress[b], shear_stress[b], normal, shear, strength):
            status[b] = 2
            break_time[b] = time
            broken_at[b] = 1 if normal_stress[b] > normal * strength else 2
            count[first[b]] -= 1
            count[second[b]] -= 1
            broken += 1
    return broken
