"""Fracture in the sub-steps: overloaded bonds break, and the state keeps what each bond bore (equation 7.2)."""

from __future__ import annotations

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.explicit import tiles as tile
from riftberg.engines.explicit.contact import ContactPairs
from riftberg.engines.explicit.tiles import EMPTY, BondTiles, bond_lane
from riftberg.physics.bonds import exceeds, normal_force
from riftberg.physics.geometry import same_axes
from riftberg.state import Bonds, Floats, Ints


@kernel
def count_overloaded(bond: Floats, scratch: Floats) -> int:
    """Count the intact bonds of a tile whose stress is above their strength; one that is not a number is not."""
    count = 0  # a whole number, so that the loop vectorises
    for k in range(tile.LANES):
        torn = scratch[tile.NORMAL_STRESS + k] > bond[tile.NORMAL_LIMIT + k]
        sheared = scratch[tile.SHEAR_STRESS + k] > bond[tile.SHEAR_LIMIT + k]
        count += 1 if (torn | sheared) & (bond[tile.INTACT + k] > 0.0) else 0
    return count


@stage
def break_overloaded(
    bond_ids: Ints, bond: Floats, shape: Floats, scratch: Floats, ends: Floats, rotation: Floats, bonds: Bonds,
    aground: Floats, time: float,
) -> int:  # fmt: skip
    """Break the bonds of a tile that are overloaded: mark them, and replace their force. `record_breaks` does the rest.

    A bond that fails in shear while compressed still pushes (and damps) in the sub-step in which it fails (Q31);
    any other contributes nothing.
    """
    broken = 0
    for k in range(tile.LANES):
        tension, shear = scratch[tile.NORMAL_STRESS + k], scratch[tile.SHEAR_STRESS + k]
        over = exceeds(tension, shear, bond[tile.NORMAL_LIMIT + k], bond[tile.SHEAR_LIMIT + k], 1.0)
        if bond[tile.INTACT + k] == 0.0 or not over:
            continue
        b = bond_ids[k]
        i, j = bonds.first[b], bonds.second[b]
        store_bond(bonds, b, bond, scratch, k, rotation)
        bonds.break_time[b] = time
        bonds.break_grounded[b] = 1 if aground[i] > 0.0 or aground[j] > 0.0 else 0
        bonds.break_strength[b] = 1 if tension > bond[tile.NORMAL_LIMIT + k] else 2
        bond[tile.INTACT + k] = 0.0
        bond[tile.FX + k], bond[tile.FY + k] = _force_while_breaking(shape, scratch, ends, k)
        scratch[tile.TORQUE1 + k] = bond[tile.TORQUE2 + k] = 0.0
        broken += 1
    return broken


@kernel
def _force_while_breaking(shape: Floats, scratch: Floats, ends: Floats, k: int) -> tuple[float, float]:
    """Normal force and damping (N) of a bond that fails in shear under compression; zero otherwise."""
    if scratch[tile.NORMAL_STRESS + k] >= 0.0:
        return 0.0, 0.0
    damping, half = shape[tile.DAMPING + k], scratch[tile.HALF + k]
    u1, v1, u2, v2 = ends[tile.U + k], ends[tile.V + k], scratch[tile.U + k], scratch[tile.V + k]
    du, dv = same_axes(u1 - u2, v1 - v2, 0.5 * (u1 + u2), 0.5 * (v1 + v2), scratch[tile.TURN + k])
    push = normal_force(shape[tile.MODULUS + k], scratch[tile.WIDTH + k], scratch[tile.THICKNESS + k], half)
    return push * scratch[tile.NX + k] - damping * du, push * scratch[tile.NY + k] - damping * dv


@kernel
def record_breaks(
    tiles: BondTiles, bonds: Bonds, bond_count: Ints, pairs: ContactPairs, time: float, keep_contact: bool
) -> None:
    """Mark bonds that broke at ``time``, take them from the counts of their ends, list them as contact pairs, layer by layer."""
    for layer in range(tiles.layers):
        for i in range(bond_count.size):
            b = tiles.bond_ids[bond_lane(layer, i, tiles.layers)]
            if b == EMPTY or bonds.break_time[b] != time:
                continue
            bonds.status[b] = 1
            j = bonds.second[b]
            bond_count[i] -= 1
            bond_count[j] -= 1
            if keep_contact:
                n = pairs.used[0]
                pairs.first[n], pairs.second[n], pairs.bond[n] = i, j, -1
                pairs.used[0] = n + 1


@kernel
def store_bonds(bond_ids: Ints, bonds: Bonds, bond: Floats, scratch: Floats, rotation: Floats) -> None:
    """Write stresses, slip and length of the bonds of a tile to the state; broken ones keep those at which they broke."""
    for k in range(tile.LANES):
        if bond[tile.INTACT + k] > 0.0:
            store_bond(bonds, bond_ids[k], bond, scratch, k, rotation)


@kernel
def store_bond(bonds: Bonds, b: int, bond: Floats, scratch: Floats, k: int, rotation: Floats) -> None:
    """Write stresses, slip and length of bond ``b`` in lane ``k`` to the state."""
    slip = bond[tile.SLIP + k]
    bonds.shear_x[b], bonds.shear_y[b] = -slip * scratch[tile.NY + k], slip * scratch[tile.NX + k]
    bonds.normal_stress[b], bonds.shear_stress[b] = scratch[tile.NORMAL_STRESS + k], scratch[tile.SHEAR_STRESS + k]
    bonds.bond_length[b], bonds.peak_stress[b] = scratch[tile.LENGTH + k], bond[tile.PEAK_STRESS + k]
    bonds.relative_rotation[b] += rotation[bonds.first[b]] - rotation[bonds.second[b]]
