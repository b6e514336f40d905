"""KID's spring and damper between two elements, and its sums over the partners of one element (equations 5.1, 5.2).

`pair_geometry` is the law of one pair as far as it hangs on positions, `pair_terms` the whole of it. Sums over the partners
of an element come in two ways, term by term in the same order: `interaction_terms` finds both at once; the outer half kick,
which is solved over and over until the velocities of all that touch have converged, finds what hangs on positions once
(`fill_contact_table`) and only the damping in each iteration (`contact_terms`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.parameters import KernelParameters
from riftberg.physics.contact import damping_coefficients, damping_tensor, pair_stiffness, spring_acceleration
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList

BONDED, SAME_BERG_CONTACT, COLLISION, PLAIN_CONTACT, PLAIN_BOND = 0, 1, 2, 3, 4
"""Kinds of pair. The plain kinds are those of branch B: repulsion by search, attraction by bond (Q40)."""


class PairLaw(NamedTuple):
    """Numbers of the pair law."""

    spring: float  # Stiffness of bonds over mass, s-2; negative: from the modulus
    modulus: float  # m2 s-2: stiffness times the square of the rest length
    contact_spring: float  # Stiffness of contact over mass, s-2; negative: from the modulus
    contact_stiffest: float  # Largest stiffness of contact, s-2
    contact_distance: float  # Distance (m) from which bergs repel each other, if larger than their radii
    critical: bool  # Damping is critical, along the pair
    tangential_critical: bool  # and across it
    radial: float  # Damping along the pair where it is not, s-1
    tangential: float  # and across it
    by_speed: bool  # Damping grows with the relative speed
    latlon: bool
    earth_radius: float  # m
    period: float  # Period of x, 0 for none


class PairView(NamedTuple):
    """What pair forces see of the elements."""

    x: Floats  # Position, degrees or m
    y: Floats
    u: Floats  # Velocity, m s-1
    v: Floats
    radius: Floats  # m
    mass: Floats  # kg
    bond_radius: Floats  # As bonds see them
    bond_mass: Floats


class Mover(NamedTuple):
    """Position and velocities of the element whose partners act on it."""

    x: float  # Degrees or m
    y: float
    u0: float  # Velocity at the start of the step, m s-1
    v0: float
    u1: float  # At the current iterate
    v1: float


class Terms(NamedTuple):
    """Sums over the partners of an element."""

    ix: float  # Acceleration by springs, m s-2
    iy: float
    p11: float  # Damping tensor P, s-1
    p12: float
    p22: float
    px: float  # P times the velocity of each partner, m s-2
    py: float


class ContactTable(NamedTuple):
    """Pairs of different bergs in reach of contact, with the terms that stay as long as they do not move."""

    start: Ints  # Those of element e are from ``start[e]`` to before ``start[e + 1]``
    partner: Ints
    nx: Floats  # Unit vector from the partner to the element
    ny: Floats
    radial: Floats  # Damping (s-1) times the ratio of masses
    tangential: Floats
    spring_x: Floats  # Sum of the springs on each element, m s-2
    spring_y: Floats


class NeighbourLists(NamedTuple):
    """Partners of each element by kind of pair."""

    bonded: PairList
    same_berg: PairList
    collision: PairList
    rest: Floats  # Rest length (m) of each entry of ``bonded``; empty where it is the sum of the present radii
    group: Ints  # Group of bergs that can meet to which each element belongs; empty where all are one


@kernel
def stiffness_and_reach(kind: int, sum_radii: float, law: PairLaw) -> tuple[float, float]:
    """Stiffness (s-2) and distance (m) at which the force vanishes, by kind of pair (equations 5.2)."""
    if kind in (COLLISION, PLAIN_CONTACT):
        stiffness = pair_stiffness(law.contact_spring, law.modulus, sum_radii, law.contact_stiffest)
        return stiffness, max(sum_radii, law.contact_distance)
    return pair_stiffness(law.spring, law.modulus, sum_radii, math.inf), sum_radii


@kernel
def pair_geometry(
    kind: int, rx: float, ry: float, sum_radii: float, mass_ratio: float, law: PairLaw
) -> tuple[float, float, float, float, float, float, bool]:
    """Spring (m s-2), direction and dampings (s-1, times the ratio of masses) of one pair, and whether it acts.

    ``rx``, ``ry``: vector from the partner to the element, m.
    """
    stiffness, reach = stiffness_and_reach(kind, sum_radii, law)
    d = math.sqrt(rx * rx + ry * ry)
    if kind == BONDED:
        acts = True
    elif kind == PLAIN_BOND:
        acts = d > reach
    else:
        acts = d < reach
    # Elements upon each other have no direction in which they could be pushed apart.
    if d == 0.0 or not acts:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False
    nx, ny = rx / d, ry / d
    ix, iy = spring_acceleration(nx, ny, d, reach, stiffness, mass_ratio)
    radial, tangential = damping_coefficients(
        stiffness, law.critical, law.tangential_critical, law.radial, law.tangential
    )
    return ix, iy, nx, ny, radial * mass_ratio, tangential * mass_ratio, True


@kernel
def pair_terms(
    kind: int, rx: float, ry: float, sum_radii: float, mass_ratio: float, du0: float, dv0: float, du1: float,
    dv1: float, law: PairLaw,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Spring acceleration (ix, iy; m s-2) and damping tensor (p11, p12, p22; s-1) of one pair; zeros if it does not act.

    ``du0``, ``dv0``, ``du1``, ``dv1``: partner's velocity minus the element's, at the start of the step and at the current
    iterate, m s-1; the others as in `pair_geometry`.
    """
    ix, iy, nx, ny, radial, tangential, acts = pair_geometry(kind, rx, ry, sum_radii, mass_ratio, law)
    if not acts:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    p11, p12, p22 = damping_tensor(nx, ny, radial, tangential, 1.0, law.by_speed, du0, dv0, du1, dv1)
    return ix, iy, p11, p12, p22


@kernel
def _sum_pairs(
    e: int, at: Mover, kind: int, pairs: PairList, rest: Floats, own_size: bool, view: PairView, law: PairLaw
) -> tuple[float, float, float, float, float, float, float]:  # fmt: skip
    """Sum the terms of one kind of pair; also P u of the partners.

    Arrays are taken out of the named tuples before the loop, because numba counts references at each access.
    """
    sx = sy = s11 = s12 = s22 = px = py = 0.0
    if pairs.start[e] == pairs.start[e + 1]:
        return sx, sy, s11, s12, s22, px, py
    partner, first, behind = pairs.partner, pairs.start[e], pairs.start[e + 1]
    others_x, others_y, others_u, others_v = view.x, view.y, view.u, view.v
    radius, mass = (view.radius, view.mass) if own_size else (view.bond_radius, view.bond_mass)
    by_sizes = rest.size == 0
    for k in range(first, behind):
        c = partner[k]
        radii, m1, m2 = radius[e] + radius[c], mass[e], mass[c]
        if not by_sizes:
            radii = rest[k]
        rx, ry = separation(at.x, at.y, others_x[c], others_y[c], law.latlon, law.earth_radius, law.period)
        uc, vc = others_u[c], others_v[c]
        ix, iy, p11, p12, p22 = pair_terms(
            kind, rx, ry, radii, min(m1, m2) / m1, uc - at.u0, vc - at.v0, uc - at.u1, vc - at.v1, law
        )
        sx += ix
        sy += iy
        s11 += p11
        s12 += p12
        s22 += p22
        px += p11 * uc + p12 * vc
        py += p12 * uc + p22 * vc
    return sx, sy, s11, s12, s22, px, py


@kernel
def interaction_terms(
    e: int, at: Mover, partners: NeighbourLists, plain: bool, bond_size: bool, view: PairView, law: PairLaw
) -> Terms:
    """Sum over all partners of element ``e``: I, P and P u of the partners (equations 5.1)."""
    bond, rest, present = PLAIN_BOND if plain else BONDED, partners.rest, partners.rest[:0]
    b = _sum_pairs(e, at, bond, partners.bonded, rest, not bond_size, view, law)
    s = _sum_pairs(e, at, SAME_BERG_CONTACT, partners.same_berg, present, True, view, law)
    collision_kind = PLAIN_CONTACT if plain else COLLISION
    c = _sum_pairs(e, at, collision_kind, partners.collision, present, True, view, law)
    return Terms(
        b[0] + s[0] + c[0], b[1] + s[1] + c[1], b[2] + s[2] + c[2], b[3] + s[3] + c[3], b[4] + s[4] + c[4],
        b[5] + s[5] + c[5], b[6] + s[6] + c[6],
    )  # fmt: skip


@kernel
def pair_view(el: Elements, sizes: Sizes) -> PairView:
    """Gather the positions, velocities and sizes that pair forces read."""
    shown = el.shown
    return PairView(
        shown.lon_pair,
        shown.lat_pair,
        shown.u_pair,
        shown.v_pair,
        sizes.radius,
        sizes.mass,
        sizes.bond_radius,
        sizes.bond_mass,
    )


@kernel
def pair_law(p: KernelParameters) -> PairLaw:
    """Pick the scalars of the pair law."""
    return PairLaw(
        p.spring,
        p.modulus,
        p.contact_spring,
        p.contact_stiffest,
        p.contact_distance,
        p.critical_damping,
        p.tangential_critical_damping,
        p.radial_damping,
        p.tangential_damping,
        p.damping_by_speed,
        p.latlon,
        p.earth_radius,
        p.period,
    )


def allocate_contact_table(count: int, most: int) -> ContactTable:
    """Return room for ``most`` pairs of ``count`` elements."""
    nx, ny, radial, tangential = np.zeros((4, most))
    spring_x, spring_y = np.zeros((2, count))
    start, partner = np.zeros(count + 1, np.int64), np.zeros(most, np.int64)
    return ContactTable(start, partner, nx, ny, radial, tangential, spring_x, spring_y)


@stage
def fill_contact_table(el: Elements, pairs: PairList, sizes: Sizes, law: PairLaw, table: ContactTable) -> None:
    """Find the part of contact that hangs on positions alone (equations 5.2)."""
    x, y, radius, mass = el.place.lon, el.place.lat, sizes.radius, sizes.mass
    others_x, others_y, begin, listed = el.shown.lon_pair, el.shown.lat_pair, pairs.start, pairs.partner
    start, partner, spring_x, spring_y = table.start, table.partner, table.spring_x, table.spring_y
    nx, ny, radial, tangential = table.nx, table.ny, table.radial, table.tangential
    start[0] = entry = 0
    for e in range(x.size):
        sum_x = sum_y = 0.0
        for k in range(begin[e], begin[e + 1]):
            c = listed[k]
            rx, ry = separation(x[e], y[e], others_x[c], others_y[c], law.latlon, law.earth_radius, law.period)
            ix, iy, nx[entry], ny[entry], radial[entry], tangential[entry], touches = pair_geometry(
                COLLISION, rx, ry, radius[e] + radius[c], min(mass[e], mass[c]) / mass[e], law
            )
            partner[entry] = c
            sum_x += ix
            sum_y += iy
            entry += 1 if touches else 0
        spring_x[e], spring_y[e], start[e + 1] = sum_x, sum_y, entry


@kernel
def contact_terms(
    e: int, u0: float, v0: float, u1: float, v1: float, table: ContactTable, u_shown: Floats, v_shown: Floats,
    by_speed: bool,
) -> Terms:  # fmt: skip
    """Sum over all partners of element ``e`` in the table: I, P and P u of the partners (equations 5.1).

    ``u0``, ``v0``, ``u1``, ``v1``: its velocity at the start of the step and at the current iterate, m s-1;
    ``u_shown``, ``v_shown``: velocities of the others as pair forces see them, m s-1.
    """
    first, behind = table.start[e], table.start[e + 1]
    s11 = s12 = s22 = px = py = 0.0
    if first < behind:
        partner, nx, ny, radial, tangential = (
            table.partner, table.nx, table.ny, table.radial, table.tangential,
        )  # fmt: skip
        for k in range(first, behind):
            c = partner[k]
            uc, vc = u_shown[c], v_shown[c]
            p11, p12, p22 = damping_tensor(
                nx[k], ny[k], radial[k], tangential[k], 1.0, by_speed, uc - u0, vc - v0, uc - u1, vc - v1
            )
            s11 += p11
            s12 += p12
            s22 += p22
            px += p11 * uc + p12 * vc
            py += p12 * uc + p22 * vc
    return Terms(table.spring_x[e], table.spring_y[e], s11, s12, s22, px, py)
