"""Breaking of bonds inside a sub-step, and what a broken bond does until its ends part (equations 7.2, 5.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.bonds import normal_force
from riftberg.physics.fracture import exceeds
from riftberg.physics.geometry import same_axes, separation
from riftberg.state import Ints
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.forces.interactions import COLLISION, SAME_BERG_CONTACT, pair_terms

OTHER_BERGS, TOUCHED = -2, -3
"""What stands for a bond in pairs of elements of two bergs."""


class ContactPairs(NamedTuple):
    """Pairs of one berg that may touch in the sub-steps: ends of broken bonds, or candidates of a search.

    ``count[0]`` of the rows are in use. ``bond`` is the number of the bond between both (as long as it is unbroken they
    do not touch), or -1; `OTHER_BERGS` for elements of two bergs, and `TOUCHED` once they have touched in this long step.
    """

    first: Ints
    second: Ints
    bond: Ints
    count: Ints


def allocate_pairs(size: int) -> ContactPairs:
    """Return room for ``size`` pairs."""
    return ContactPairs(*(np.zeros(size, np.int64) for _ in range(3)), np.zeros(1, np.int64))


@stage
def break_overloaded(bond_ids, bond, scratch, ends, rotation, bonds, aground, time):
    """Break the bonds of a block that are overloaded: mark them, and replace their force.

    A bond that fails in shear while compressed still pushes (and damps) in the sub-step in which it fails (Q31);
    any other contributes nothing.
    """
    broken = 0
    for k in range(tile.LANES):
        over = exceeds(
            scratch[tile.NORMAL_STRESS + k],
            scratch[tile.SHEAR_STRESS + k],
            bond[tile.NORMAL_LIMIT + k],
            bond[tile.SHEAR_LIMIT + k],
            1.0,
        )
        if bond[tile.INTACT + k] == 0.0 or not over:
            continue
        b = bond_ids[k]
        i, j = bonds.first[b], bonds.second[b]
        store_bond(bonds, b, bond, scratch, k, rotation)
        bonds.status[b] = 1
        bonds.break_time[b] = time
        bonds.break_grounded[b] = 1 if aground[i] > 0.0 or aground[j] > 0.0 else 0
        bond[tile.INTACT + k] = 0.0
        bond[tile.FX + k], bond[tile.FY + k] = _force_while_breaking(bond, scratch, ends, k)
        scratch[tile.TORQUE1 + k] = bond[tile.TORQUE2 + k] = 0.0
        broken += 1
    return broken


@kernel
def record_breaks(tiles, bonds, bond_count, pairs, time, keep_contact):
    """Take the bonds that broke at ``time`` from the counts of their ends, and list them as contact pairs, in order of row."""
    for r in range(tiles.bond_ids.size):
        b = tiles.bond_ids[r]
        if b < 0 or bonds.status[b] == 0 or bonds.break_time[b] != time:
            continue
        i, j = bonds.first[b], bonds.second[b]
        bond_count[i] -= 1
        bond_count[j] -= 1
        if keep_contact:
            n = pairs.count[0]
            pairs.first[n], pairs.second[n], pairs.bond[n] = i, j, -1
            pairs.count[0] = n + 1


@kernel
def store_bond(bonds, b, bond, scratch, k, rotation):
    """Write to the state what bond ``b`` in lane ``k`` bears now."""
    slip = bond[tile.SLIP + k]
    bonds.shear_x[b], bonds.shear_y[b] = -slip * scratch[tile.NY + k], slip * scratch[tile.NX + k]
    bonds.normal_stress[b], bonds.shear_stress[b] = scratch[tile.NORMAL_STRESS + k], scratch[tile.SHEAR_STRESS + k]
    bonds.bond_length[b], bonds.peak_stress[b] = scratch[tile.LENGTH + k], bond[tile.PEAK_STRESS + k]
    bonds.relative_rotation[b] += rotation[bonds.first[b]] - rotation[bonds.second[b]]
    bonds.damage[b] = bond[tile.DAMAGE + k]


@kernel
def store_bonds(bond_ids, bonds, bond, scratch, rotation):
    """Write to the state what the bonds of a block bear; of those that broke in this long step it keeps what held then."""
    for k in range(tile.LANES):
        if bond[tile.INTACT + k] > 0.0:
            store_bond(bonds, bond_ids[k], bond, scratch, k, rotation)


@kernel
def _force_while_breaking(bond, scratch, ends, k):
    """Normal force and damping (N) of a bond that fails in shear under compression; zero otherwise."""
    if scratch[tile.NORMAL_STRESS + k] >= 0.0:
        return 0.0, 0.0
    damping = bond[tile.DAMPING + k]
    u1, v1, u2, v2 = ends[tile.U + k], ends[tile.V + k], scratch[tile.U + k], scratch[tile.V + k]
    du, dv = same_axes(u1 - u2, v1 - v2, 0.5 * (u1 + u2), 0.5 * (v1 + v2), scratch[tile.TURN + k])
    push = normal_force(
        bond[tile.MODULUS + k], scratch[tile.WIDTH + k], scratch[tile.THICKNESS + k], scratch[tile.HALF + k]
    )
    return push * scratch[tile.NX + k] - damping * du, push * scratch[tile.NY + k] - damping * dv


@stage
def add_contacts(pairs, status, el, sizes, law, ax, ay, by_search, max_bonds, skip_full, dt):
    """Add the accelerations (m s-2) of pairs of one berg, or of two, that touch (equations 5.5, 5.2).

    ``dt``: sub-step (s) by which damping is softened.
    """
    first, second, bond = pairs.first, pairs.second, pairs.bond
    x, y, bond_count = el.shown.lon_pair, el.shown.lat_pair, el.body.bond_count
    u, v, u_shown, v_shown = el.motion.u, el.motion.v, el.shown.u_pair, el.shown.v_pair
    radius, mass, own_radius, own_mass = sizes.bond_radius, sizes.bond_mass, sizes.radius, sizes.mass
    for k in range(pairs.count[0]):
        i, j = first[k], second[k]
        if by_search and bond[k] >= 0 and status[bond[k]] == 0:
            continue
        rx, ry = separation(x[i], y[i], x[j], y[j], law.latlon, law.earth_radius, law.period)
        apart = bond[k] <= OTHER_BERGS
        radii = own_radius[i] + own_radius[j] if apart else radius[i] + radius[j]
        reach = max(radii, law.contact_distance) if apart else radii
        if rx * rx + ry * ry >= reach * reach:
            continue
        if apart:
            bond[k] = TOUCHED
        for end in range(2):
            e, c = (i, j) if end == 0 else (j, i)
            looks = not (skip_full and bond_count[e] == max_bonds) and bond_count[c] < max_bonds
            if by_search and not looks and not apart:
                continue
            s = 1.0 if end == 0 else -1.0
            m1, m2 = (own_mass[e], own_mass[c]) if apart else (mass[e], mass[c])
            ix, iy = contact_acceleration(
                COLLISION if apart else SAME_BERG_CONTACT, e, c, s * rx, s * ry, radii, u, v, u_shown, v_shown, m1, m2,
                law, dt * max_bonds,
            )  # fmt: skip
            ax[e] += ix
            ay[e] += iy


@stage
def contact_acceleration(kind, e, c, rx, ry, radii, u, v, u_shown, v_shown, m1, m2, law, span):
    """Acceleration (m s-2) of element e by its contact with c of the same berg, or of another: spring and damper.

    Critical damping of stiff contacts is too fast for the sub-steps that the bonds allow, and would drive pieces apart.
    Divided by ``1 + 2 span c``, with ``span`` the sub-step times the contacts that an element can have, it is stable with
    its spring up to ``0.57 / sqrt(k)``, equal on both sides, and tends to the law for short sub-steps.
    """
    du, dv = u_shown[c] - u[e], v_shown[c] - v[e]
    ix, iy, p11, p12, p22 = pair_terms(kind, rx, ry, radii, min(m1, m2) / m1, du, dv, du, dv, law)
    wu, wv = u_shown[c] - u_shown[e], v_shown[c] - v_shown[e]
    soft = 1.0 / (1.0 + 2.0 * span * (p11 + p22) * (m1 / min(m1, m2)))
    return ix + soft * (p11 * wu + p12 * wv), iy + soft * (p12 * wu + p22 * wv)
