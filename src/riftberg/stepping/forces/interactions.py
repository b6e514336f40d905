"""Sum of KID's spring and damper over the partners of one element (equations 5.1, 5.2)."""

from __future__ import annotations

import math
from typing import NamedTuple

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.contact import damping_coefficients, damping_tensor, pair_stiffness, spring_acceleration
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.stepping.forces.sizes import Sizes

BONDED, SAME_BERG_CONTACT, COLLISION, PLAIN_CONTACT, PLAIN_BOND = 0, 1, 2, 3, 4
"""Kinds of pair. The plain kinds are those of branch B: repulsion by search, attraction by bond (Q40)."""


class PairLaw(NamedTuple):
    """Scalars of the pair law."""

    spring: float
    modulus: float
    contact_spring: float
    contact_stiffest: float
    contact_distance: float
    critical: bool
    tangential_critical: bool
    radial: float
    tangential: float
    by_speed: bool
    latlon: bool
    earth_radius: float
    period: float


class PairView(NamedTuple):
    """What other elements see of an element: position, velocity, radius (m) and mass (kg)."""

    x: Floats
    y: Floats
    u: Floats
    v: Floats
    radius: Floats
    mass: Floats
    bond_radius: Floats
    bond_mass: Floats


class Terms(NamedTuple):
    """Sums over the partners of an element: spring acceleration (m s-2), damping tensor (s-1), and P u of the partners."""

    ix: float
    iy: float
    p11: float
    p12: float
    p22: float
    px: float
    py: float


class Partners(NamedTuple):
    """Partners of each element by kind of pair.

    ``rest`` is the rest length (m) of each entry of ``bonded``; empty where it is the sum of the present radii.
    ``group`` is the number of the group of bergs that can meet to which each element belongs; empty where all are one.
    """

    bonded: PairList
    same_berg: PairList
    collision: PairList
    rest: Floats
    group: Ints


@kernel
def stiffness_and_reach(kind: int, sum_radii: float, law: PairLaw) -> tuple[float, float]:
    """Stiffness (s-2) and distance (m) at which the force vanishes, by kind of pair (equations 5.2)."""
    if kind in (COLLISION, PLAIN_CONTACT):
        stiffness = pair_stiffness(law.contact_spring, law.modulus, sum_radii, law.contact_stiffest)
        return stiffness, max(sum_radii, law.contact_distance)
    return pair_stiffness(law.spring, law.modulus, sum_radii, math.inf), sum_radii


@kernel
def pair_terms(
    kind: int,
    rx: float,
    ry: float,
    sum_radii: float,
    mass_ratio: float,
    du0: float,
    dv0: float,
    du1: float,
    dv1: float,
    law: PairLaw,
) -> tuple[float, float, float, float, float]:
    """Spring acceleration (ix, iy; m s-2) and damping tensor (p11, p12, p22; s-1) of one pair; zeros if it does not act.

    ``rx``, ``ry``: vector from the partner to the element, m; ``du0``, ``dv0``, ``du1``, ``dv1``: partner's velocity
    minus the element's, at the start of the step and at the current iterate, m s-1.
    """
    stiffness, reach = stiffness_and_reach(kind, sum_radii, law)
    d = math.sqrt(rx * rx + ry * ry)
    in_reach = d < reach
    if kind == BONDED:
        acts = True
    elif kind == PLAIN_BOND:
        acts = d > reach
    else:
        acts = in_reach
    if d == 0.0 or not acts:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    nx, ny = rx / d, ry / d
    ix, iy = spring_acceleration(nx, ny, d, reach, stiffness, mass_ratio)
    radial, tangential = damping_coefficients(
        stiffness, law.critical, law.tangential_critical, law.radial, law.tangential
    )
    p11, p12, p22 = damping_tensor(nx, ny, radial, tangential, mass_ratio, law.by_speed, du0, dv0, du1, dv1)
    return ix, iy, p11, p12, p22


@kernel
def _sum_over(e, x, y, u0, v0, u1, v1, kind, pairs, rest, own_size, view, law):
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
        rx, ry = separation(x, y, others_x[c], others_y[c], law.latlon, law.earth_radius, law.period)
        uc, vc = others_u[c], others_v[c]
        ix, iy, p11, p12, p22 = pair_terms(
            kind, rx, ry, radii, min(m1, m2) / m1, uc - u0, vc - v0, uc - u1, vc - v1, law
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
def interaction_terms(e, x, y, u0, v0, u1, v1, partners, plain, bond_size, view, law):
    """Sum over all partners of element ``e`` at (x, y): I, P and P u of the partners (equations 5.1).

    ``x``, ``y``: its position, degrees or m; ``u0``, ``v0``, ``u1``, ``v1``: its velocity at the start of the step and
    at the current iterate, m s-1.
    """
    bond, rest, present = PLAIN_BOND if plain else BONDED, partners.rest, partners.rest[:0]
    b = _sum_over(e, x, y, u0, v0, u1, v1, bond, partners.bonded, rest, not bond_size, view, law)
    s = _sum_over(e, x, y, u0, v0, u1, v1, SAME_BERG_CONTACT, partners.same_berg, present, True, view, law)
    apart = PLAIN_CONTACT if plain else COLLISION
    c = _sum_over(e, x, y, u0, v0, u1, v1, apart, partners.collision, present, True, view, law)
    return Terms(
        b[0] + s[0] + c[0],
        b[1] + s[1] + c[1],
        b[2] + s[2] + c[2],
        b[3] + s[3] + c[3],
        b[4] + s[4] + c[4],
        b[5] + s[5] + c[5],
        b[6] + s[6] + c[6],
    )


@kernel
def pair_view(el: Elements, sizes: Sizes) -> PairView:
    """Gather what the elements show to each other."""
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
