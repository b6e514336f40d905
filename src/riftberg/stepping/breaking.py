"""Breaking of bonds inside a sub-step, and what a broken bond does until its ends part (equations 7.2, 5.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.kernels import kernel, stage
from riftberg.physics.bonds import bond_section, normal_force, overlap
from riftberg.physics.fracture import exceeds
from riftberg.physics.geometry import same_axes, separation
from riftberg.state import Ints
from riftberg.stepping import bond_blocks as row
from riftberg.stepping.interactions import COLLISION, SAME_BERG_CONTACT, pair_terms

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


@kernel
def any_exceeds(rows, count):
    """Number of unbroken rows whose stress is above their strength."""
    overloaded = 0
    for b in range(row.blocks_of(count)):
        overloaded += _exceeding(rows.block[b * row.BLOCK : (b + 1) * row.BLOCK])
    return overloaded


@kernel
def _exceeding(block):
    """Number of rows of a block that are overloaded; a whole number, so that the loop vectorises."""
    overloaded = 0
    for k in range(row.LANES):
        torn = block[row.NORMAL_STRESS + k] > block[row.NORMAL_LIMIT + k]
        sheared = block[row.SHEAR_STRESS + k] > block[row.SHEAR_LIMIT + k]
        overloaded += 1 if (torn | sheared) & (block[row.ALIVE + k] > 0.0) else 0
    return overloaded


@stage
def break_overloaded(rows, count, el, bonds, pairs, aground, time, youngs, keep_contact):
    """Break the bonds that are overloaded: mark them, replace their force, and list them as contact pairs.

    A bond that fails in shear while compressed still pushes (and damps) in the sub-step in which it fails (Q31);
    any other contributes nothing.

    Returns
    -------
    int
        Bonds broken.
    """
    body, block = el.body, rows.block
    broken = 0
    for r in range(count):
        at = row.place_of(r)
        over = exceeds(
            block[at + row.NORMAL_STRESS],
            block[at + row.SHEAR_STRESS],
            block[at + row.NORMAL_LIMIT],
            block[at + row.SHEAR_LIMIT],
            1.0,
        )
        if block[at + row.ALIVE] == 0.0 or not over:
            continue
        b = rows.bond[r]
        bonds.status[b] = 1
        bonds.break_time[b] = time
        bonds.break_grounded[b] = 1 if aground[rows.first[r]] > 0.0 or aground[rows.second[r]] > 0.0 else 0
        bonds.shear_x[b], bonds.shear_y[b] = block[at + row.SX], block[at + row.SY]
        bonds.normal_stress[b], bonds.shear_stress[b] = block[at + row.NORMAL_STRESS], block[at + row.SHEAR_STRESS]
        bonds.bond_length[b], bonds.relative_rotation[b] = block[at + row.LENGTH], block[at + row.RELATIVE_ROTATION]
        bonds.peak_stress[b], bonds.damage[b] = block[at + row.PEAK_STRESS], block[at + row.DAMAGE]
        body.bond_count[rows.first[r]] -= 1
        body.bond_count[rows.second[r]] -= 1
        block[at + row.ALIVE] = 0.0
        _force_while_breaking(block, at, youngs)
        block[at + row.TORQUE1] = block[at + row.TORQUE2] = 0.0
        broken += 1
        if keep_contact:
            k = pairs.count[0]
            pairs.first[k], pairs.second[k], pairs.bond[k] = rows.first[r], rows.second[r], -1
            pairs.count[0] = k + 1
    return broken


@stage
def _force_while_breaking(block, at, youngs):
    """Normal force and damping of a bond that fails in shear under compression; zero otherwise."""
    block[at + row.FX] = block[at + row.FY] = 0.0
    if block[at + row.NORMAL_STRESS] >= 0.0:
        return
    half = overlap(block[at + row.REST], block[at + row.LENGTH])
    width, thickness = bond_section(
        block[at + row.RADIUS_SMALL],
        block[at + row.RADIUS_GAP],
        block[at + row.THICKNESS_SMALL],
        block[at + row.THICKNESS_GAP],
        half,
        block[at + row.LENGTH],
    )
    fn = normal_force(youngs, width, thickness, block[at + row.REST], half)
    zonal = block[at + row.LENGTH] * block[at + row.NX]
    du, dv = same_axes(
        block[at + row.DU],
        block[at + row.DV],
        block[at + row.U_MEAN],
        block[at + row.V_MEAN],
        zonal,
        block[at + row.CONVERGENCE],
    )
    block[at + row.FX] = fn * block[at + row.NX] - block[at + row.DAMPING] * du
    block[at + row.FY] = fn * block[at + row.NY] - block[at + row.DAMPING] * dv


@stage
def add_contacts(pairs, status, el, sizes, law, ax, ay, search, max_bonds, skip_full, dt):
    """Add the accelerations (m s-2) of pairs of one berg, or of two, that touch (equations 5.5, 5.2).

    Parameters
    ----------
    pairs : ContactPairs
    status : array of int
        Of the bonds.
    search : bool
        The pairs are candidates of a search: a pair acts only while unbonded and while the partner has fewer than
        ``max_bonds`` bonds (Q21); with ``skip_full`` an element with exactly ``max_bonds`` bonds does not look at all.
    dt : float
        Sub-step (s) by which damping is softened; 0 for fully explicit damping, as in the reference.
    """
    first, second, bond = pairs.first, pairs.second, pairs.bond
    x, y, bond_count = el.shown.lon_pair, el.shown.lat_pair, el.body.bond_count
    u, v, u_shown, v_shown = el.motion.u, el.motion.v, el.shown.u_pair, el.shown.v_pair
    radius, mass, own_radius, own_mass = sizes.bond_radius, sizes.bond_mass, sizes.radius, sizes.mass
    for k in range(pairs.count[0]):
        i, j = first[k], second[k]
        if search and bond[k] >= 0 and status[bond[k]] == 0:
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
            if search and not looks and not apart:
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
