"""Breaking of bonds inside a sub-step, and the contact of broken bonds and of bergs (equations 7.2, 5.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.common.forces.pair_law import COLLISION, SAME_BERG_CONTACT, PairLaw, pair_terms
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.explicit import tiles as tile
from riftberg.engines.explicit.tiles import EMPTY, BondTiles, bond_lane
from riftberg.physics.bonds import exceeds, normal_force
from riftberg.physics.geometry import same_axes, separation
from riftberg.state import Bonds, Elements, Floats, Ints, zeros
from riftberg.state.neighbours import PairList

OTHER_BERGS, TOUCHED = -2, -3
"""What stands for a bond in pairs of elements of two bergs."""


class ContactPairs(NamedTuple):
    """Pairs that may touch in the sub-steps."""

    first: Ints
    second: Ints
    # Of pairs of one berg, the bond that joins both (they do not touch as long as it is intact) or -1. `OTHER_BERGS` for
    # elements of two bergs, and `TOUCHED` once they have touched in this long step
    bond: Ints
    used: Ints  # How many rows are in use, in ``used[0]``


def allocate_pairs(size: int) -> ContactPairs:
    """Return rows for ``size`` pairs."""
    first, second, bond = zeros(3 * size, np.int64).reshape(3, size)
    return ContactPairs(first, second, bond, np.zeros(1, np.int64))


@kernel
def pairs_from_list(pairs: ContactPairs, candidates: PairList, bonded: PairList, bond_of: Ints) -> None:
    """Fill ``pairs`` with the candidates of a search, each once, with the bond that still joins them or -1."""
    k = 0
    for e in range(candidates.start.size - 1):
        for n in range(candidates.start[e], candidates.start[e + 1]):
            c = candidates.partner[n]
            if c <= e:
                continue
            pairs.first[k], pairs.second[k], pairs.bond[k] = e, c, -1
            for q in range(bonded.start[e], bonded.start[e + 1]):
                if bonded.partner[q] == c:
                    pairs.bond[k] = bond_of[q]
            k += 1
    pairs.used[0] = k


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


@stage
def add_contacts(
    pairs: ContactPairs, status: Ints, el: Elements, sizes: Sizes, law: PairLaw, ax: Floats, ay: Floats,
    by_search: bool, max_bonds: int, dt: float,
) -> None:  # fmt: skip
    """Add the accelerations (m s-2) of pairs of one berg, or of two, that touch (equations 5.5, 5.2).

    ``dt``: sub-step (s) by which damping is softened. With ``by_search`` an element with all its bonds touches no other of
    its berg.
    """
    first, second, bond = pairs.first, pairs.second, pairs.bond
    x, y, bond_count = el.shown.lon_pair, el.shown.lat_pair, el.body.bond_count
    u, v, u_shown, v_shown = el.motion.u, el.motion.v, el.shown.u_pair, el.shown.v_pair
    radius, mass, own_radius, own_mass = sizes.bond_radius, sizes.bond_mass, sizes.radius, sizes.mass
    for k in range(pairs.used[0]):
        i, j = first[k], second[k]
        if by_search and bond[k] >= 0 and status[bond[k]] == 0:
            continue
        rx, ry = separation(x[i], y[i], x[j], y[j], law.latlon, law.earth_radius, law.period)
        two_bergs = bond[k] <= OTHER_BERGS
        radii = own_radius[i] + own_radius[j] if two_bergs else radius[i] + radius[j]
        reach = max(radii, law.contact_distance) if two_bergs else radii
        if rx * rx + ry * ry >= reach * reach:
            continue
        on_first = on_second = True
        if two_bergs:
            bond[k] = TOUCHED
            kind, m1, m2 = COLLISION, own_mass[i], own_mass[j]
        else:
            kind, m1, m2 = SAME_BERG_CONTACT, mass[i], mass[j]
            if by_search:
                on_first = bond_count[i] != max_bonds and bond_count[j] < max_bonds
                on_second = bond_count[j] != max_bonds and bond_count[i] < max_bonds
        pair = Touch(kind, i, j, rx, ry, radii, m1, m2, on_first, on_second)
        add_contact(pair, u, v, u_shown, v_shown, law, dt * max_bonds, ax, ay)


class Touch(NamedTuple):
    """Two elements that touch."""

    kind: int  # `COLLISION` or `SAME_BERG_CONTACT`
    i: int
    j: int
    rx: float  # Vector from j to i, m
    ry: float
    radii: float  # Sum of the radii, m
    m1: float  # Mass of i, kg
    m2: float  # Mass of j, kg
    on_first: bool  # Whether i is pushed
    on_second: bool  # Whether j is


@stage
def add_contact(
    t: Touch, u: Floats, v: Floats, u_shown: Floats, v_shown: Floats, law: PairLaw, span: float, ax: Floats, ay: Floats
) -> None:
    """Add the accelerations (m s-2) by spring and damper of two elements that touch.

    Critical damping of stiff contacts is too fast for the sub-steps that the bonds allow, and would drive pieces apart.
    Divided by ``1 + 2 span c``, with ``span`` the sub-step times the contacts that an element can have, it is stable with
    its spring up to ``0.57 / sqrt(k)``, equal on both sides, and tends to the law for short sub-steps.
    """
    for end in range(2):  # one loop and not two calls, each of which would be compiled for itself
        if not (t.on_first if end == 0 else t.on_second):
            continue
        e, c, sign, m_e, m_c = (t.i, t.j, 1.0, t.m1, t.m2) if end == 0 else (t.j, t.i, -1.0, t.m2, t.m1)
        du, dv = u_shown[c] - u[e], v_shown[c] - v[e]
        least = min(m_e, m_c)
        ix, iy, p11, p12, p22 = pair_terms(t.kind, sign * t.rx, sign * t.ry, t.radii, least / m_e, du, dv, du, dv, law)
        wu, wv = u_shown[c] - u_shown[e], v_shown[c] - v_shown[e]
        soft = 1.0 / (1.0 + 2.0 * span * (p11 + p22) * (m_e / least))
        ax[e] += ix + soft * (p11 * wu + p12 * wv)
        ay[e] += iy + soft * (p12 * wu + p22 * wv)
