"""Elements of different bergs that touch in a slow half kick: what does not change from pass to pass is found once.

The slow half kick is solved over and over until the velocities of all that touch have settled
(`riftberg.stepping.explicit.outer_kick`). Only velocities change between the passes, so direction, spring and size of
the damping of each pair are found before the first. The sums are those of `riftberg.stepping.forces.interactions`, term
by term in the same order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.contact import damping_coefficients, damping_tensor, spring_acceleration
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.stepping.forces.interactions import COLLISION, PairLaw, Terms, stiffness_and_reach
from riftberg.stepping.forces.sizes import Sizes


class Touching(NamedTuple):
    """Pairs in reach of contact; those of element e stand in the rows from ``start[e]`` to before ``start[e + 1]``.

    Of each pair: the partner, the unit vector from it to the element, radial and tangential damping (s-1) times the share
    of the masses. Of each element: the sum of the springs (m s-2).
    """

    start: Ints
    partner: Ints
    nx: Floats
    ny: Floats
    radial: Floats
    tangential: Floats
    spring_x: Floats
    spring_y: Floats


def allocate_touching(count: int, most: int) -> Touching:
    """Return room for ``most`` pairs of ``count`` elements."""
    nx, ny, radial, tangential = np.zeros((4, most))
    spring_x, spring_y = np.zeros((2, count))
    start, partner = np.zeros(count + 1, np.int64), np.zeros(most, np.int64)
    return Touching(start, partner, nx, ny, radial, tangential, spring_x, spring_y)


@stage
def find_touching(el: Elements, pairs: PairList, sizes: Sizes, law: PairLaw, touching: Touching) -> None:
    """Find what of contact depends on positions alone (equations 5.2)."""
    x, y, radius, mass = el.place.lon, el.place.lat, sizes.radius, sizes.mass
    others_x, others_y, begin, listed = el.shown.lon_pair, el.shown.lat_pair, pairs.start, pairs.partner
    start, partner, spring_x, spring_y = touching.start, touching.partner, touching.spring_x, touching.spring_y
    nx, ny, radial, tangential = touching.nx, touching.ny, touching.radial, touching.tangential
    start[0] = found = 0
    for e in range(x.size):
        sum_x = sum_y = 0.0
        for k in range(begin[e], begin[e + 1]):
            c = listed[k]
            rx, ry = separation(x[e], y[e], others_x[c], others_y[c], law.latlon, law.earth_radius, law.period)
            ix, iy, nx[found], ny[found], radial[found], tangential[found], touches = contact_of(
                rx, ry, radius[e] + radius[c], min(mass[e], mass[c]) / mass[e], law
            )
            partner[found] = c
            sum_x += ix
            sum_y += iy
            found += 1 if touches else 0
        spring_x[e], spring_y[e], start[e + 1] = sum_x, sum_y, found


@kernel
def contact_of(
    rx: float, ry: float, sum_radii: float, mass_ratio: float, law: PairLaw
) -> tuple[float, float, float, float, float, float, bool]:
    """Spring (m s-2), direction, dampings (s-1) of one pair of different bergs, and whether it is in reach of contact.

    ``rx``, ``ry``: vector from the partner to the element, m.
    """
    stiffness, reach = stiffness_and_reach(COLLISION, sum_radii, law)
    d = math.sqrt(rx * rx + ry * ry)
    if d == 0.0 or not d < reach:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False
    nx, ny = rx / d, ry / d
    ix, iy = spring_acceleration(nx, ny, d, reach, stiffness, mass_ratio)
    radial, tangential = damping_coefficients(
        stiffness, law.critical, law.tangential_critical, law.radial, law.tangential
    )
    return ix, iy, nx, ny, radial * mass_ratio, tangential * mass_ratio, True


@kernel
def contact_terms(e, u0, v0, u1, v1, touching, u_shown, v_shown, by_speed):
    """Sum over all that touch element ``e``: I, P and P u of the partners (equations 5.1).

    ``u0``, ``v0``, ``u1``, ``v1``: its velocity at the start of the step and at the current iterate, m s-1;
    ``u_shown``, ``v_shown``: velocities that the others show, m s-1.
    """
    first, behind = touching.start[e], touching.start[e + 1]
    s11 = s12 = s22 = px = py = 0.0
    if first < behind:
        partner, nx, ny, radial, tangential = (
            touching.partner, touching.nx, touching.ny, touching.radial, touching.tangential,
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
    return Terms(touching.spring_x[e], touching.spring_y[e], s11, s12, s22, px, py)
