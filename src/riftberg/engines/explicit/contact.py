"""Contact in the sub-steps: broken bonds and bergs that touch (equation 5.5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.common.forces.pair_law import COLLISION, SAME_BERG_CONTACT, PairLaw, pair_terms
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints, zeros
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
