"""Fragments as rigid bodies under the forces on their elements: one long step of second order, stable aground.

With the velocity q of a fragment (east, north, spin) and that of its elements ``v_k = B_k q``, virtual work gives

    M dq/dt = G(q) - L q,   M = sum m B^T B + I b b^T,   G = sum B^T f,   L = sum m c B^T B

where f are all forces on an element but the drag c of the sea floor (s-1). A step of h seconds is velocity Verlet:

    W q(1/2) = q(0) + (h/2) P M^-1 G(x0, q0)      with z = (h/2) M^-1 L(x0)
    x1       = x0 moved by h q(1/2)
    W q(1)   = q(1/2) + (h/2) P M^-1 G(x1, q1)    with z = (h/2) M^-1 L(x1)

``W = 1 + z + z^2 / 2`` and ``P = 1 + z / 2`` are the Pade approximants of exp(z) and of the mean of exp: the sea floor,
which stops an element within a minute, is met implicitly (L-stable) and still with second order where the step resolves
it. Drag of water, air and ice and the Coriolis force are centred by both halves together. The second half is solved by
Newton's method. Fragments that touch others go through the step in `riftberg.stepping.contact.islands`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import spin_drag
from riftberg.physics.geometry import separation
from riftberg.physics.grounding import grounding_spin_rate
from riftberg.state import Elements, Floats, Ints, Shown
from riftberg.state import Motion as ElementMotion  # what was called Motion here is `BodyMotion` now
from riftberg.state.neighbours import PairList
from riftberg.stepping.forces.interactions import COLLISION, PairLaw, pair_terms
from riftberg.stepping.forces.media import (
    CORIOLIS,
    LINEAR,
    MEDIA,
    PUSH_X,
    PUSH_Y,
    QUADRATIC,
    SEA_FLOOR,
    Seen,
    Surroundings,
    U,
    V,
    find_surroundings,
    grounded_part,
)
from riftberg.stepping.forces.sizes import Sizes

Booleans = NDArray[np.bool_]

MOST_PASSES = 50
"""Passes of Newton's method after which a step is given up; two to four are usual."""

CLOSE_ENOUGH = 1e-8
"""Relative change of the velocities at which Newton's method ends: what is left is of the order of its square."""

NOTHING_LEFT = 1e-11
"""Relative change that the next pass would bring, by how the last two went, at which Newton's method ends without it."""

CREEPING = 1e-6
"""Speed (m s-1) below which changes count as parts of this one: they would be parts of round-off."""


class Loading(NamedTuple):
    """What acts on the elements at one place and time, before velocities are known.

    ``media`` and ``coriolis`` are those of `riftberg.stepping.forces.media.Surroundings`, less the linear drag of the
    sea floor: ``floor`` and ``floor_spin`` are its rates (s-1), ``aground`` tells how far an element touches it (0 to
    1). ``spinning`` is the rotational drag (rad-1) and ``water_spin`` the rotation of the water (s-1); ``push_x``,
    ``push_y`` are steady forces (N). ``surrounded`` tells whether the media act, ``touches`` whether the sea floor
    does.
    """

    media: Floats
    coriolis: Floats
    mass: Floats
    inertia: Floats
    floor: Floats
    floor_spin: Floats
    aground: Floats
    spinning: Floats
    water_spin: Floats
    push_x: Floats
    push_y: Floats
    surrounded: bool
    touches: bool


class Touching(NamedTuple):
    """Pairs of elements of different fragments in contact: springs (N) and damping (kg s-1) on the first of each pair."""

    first: Ints
    second: Ints
    spring: Floats
    damping: Floats


def allocate_loading(el: Elements, p: KernelParameters) -> Loading:
    """Return room for what acts on the elements, kept as long as the moment is that it tells of."""
    count, body = el.size, el.body
    inertia, floor, floor_spin, aground, spinning, water_spin = np.zeros((6, count))
    return Loading(
        np.empty((count, len(MEDIA), PUSH_Y + 1)), np.empty(count), body.mass, inertia, floor, floor_spin, aground, spinning,
        water_spin, body.load_x, body.load_y, not p.only_interactions, p.ground_on_substeps or not p.only_interactions,
    )  # fmt: skip


@kernel
def fill_loading(el: Seen, sizes: Sizes, p: KernelParameters, acts: Booleans, nothing: Floats, load: Loading) -> None:
    """Take the coefficients of all forces from the environment that the elements carry.

    ``acts``:  (shape (media,)); ``nothing``: in place of what a solve would keep: nothing is solved for or applied here
    (shape (1, 0, 0)).
    """
    media, mass, inertia, floor, floor_spin = load.media, load.mass, load.inertia, load.floor, load.floor_spin
    find_surroundings(el, sizes, Surroundings(media, load.coriolis, acts, nothing[0], nothing), p)
    thickness, depth, vorticity = el.body.thickness, el.environment.depth, el.environment.vorticity
    radius, bond_mass, aground = sizes.bond_radius, sizes.bond_mass, load.aground
    for e in range(mass.size):
        inertia[e] = 0.5 * mass[e] * radius[e] ** 2
        aground[e] = grounded_part(thickness[e], depth[e], p)
        load.water_spin[e] = 0.5 * vorticity[e]
        if load.touches:
            # The linear drag of the sea floor is the one stiff force: it is met implicitly, apart from the others.
            floor[e] = media[e, SEA_FLOOR, LINEAR]
        media[e, SEA_FLOOR, LINEAR] = 0.0
        if p.ground_torque:
            floor_spin[e] = grounding_spin_rate(p.ground_coefficient, radius[e], bond_mass[e], aground[e])
        if p.rotational_drag and not p.only_interactions:
            load.spinning[e] = spin_drag(inertia[e], radius[e], p.ocean_scale)


def touching_pairs(el: Elements, partners: PairList, sizes: Sizes, law: PairLaw) -> Touching:
    """Find the pairs of different fragments that touch: the law of contact between bergs, as a force on each pair."""
    if partners.partner.size == 0:
        return Touching(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 3)))
    return Touching(*_touching_pairs(el, partners, sizes, law))


@kernel
def _touching_pairs(el: Elements, partners: PairList, sizes: Sizes, law: PairLaw) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the fields of `Touching`; see `riftberg.compiled.kernels` why no named tuple."""
    size = partners.partner.size // 2 + 1
    first, second = np.empty(size, np.int64), np.empty(size, np.int64)
    spring, damping = np.empty((size, 2)), np.empty((size, 3))
    lon, lat, us, vs = el.shown.lon_pair, el.shown.lat_pair, el.shown.u_pair, el.shown.v_pair
    count = 0
    for i in range(partners.start.size - 1):
        for n in range(partners.start[i], partners.start[i + 1]):
            j = partners.partner[n]
            if j <= i:
                continue
            rx, ry = separation(lon[i], lat[i], lon[j], lat[j], law.latlon, law.earth_radius, law.period)
            du, dv = us[j] - us[i], vs[j] - vs[i]
            ix, iy, p11, p12, p22 = pair_terms(
                COLLISION,
                rx,
                ry,
                sizes.radius[i] + sizes.radius[j],
                min(sizes.mass[i], sizes.mass[j]),
                du,
                dv,
                du,
                dv,
                law,
            )
            if ix == 0.0 and iy == 0.0 and p11 == 0.0 and p22 == 0.0:
                continue
            first[count], second[count] = i, j
            spring[count, 0], spring[count, 1] = ix, iy
            damping[count, 0], damping[count, 1], damping[count, 2] = p11, p12, p22
            count += 1
    return first[:count], second[:count], spring[:count], damping[:count]


@kernel
def _add_outer(into: Floats, factor: float, a: Floats, b: Floats) -> None:
    """Add ``factor a b^T`` of three-vectors."""
    for i in range(3):
        for j in range(3):
            into[i, j] += factor * a[i] * b[j]


@kernel
def _add_inertia(into: Floats, mass: float, inertia: float, m: Floats) -> None:
    """Add ``mass (u u^T + v v^T) + inertia w w^T``, with u, v and w one after the other in ``m``."""
    for i in range(3):
        for j in range(3):
            # In one expression: each number is read and written once.
            into[i, j] = into[i, j] + mass * m[i] * m[j] + mass * m[3 + i] * m[3 + j] + inertia * m[6 + i] * m[6 + j]


@kernel
def add_inertia_and_floor(body: Ints, motion: Floats, load: Loading, inertia: Floats, floor: Floats) -> None:
    """Add to the matrices of inertia and of the drag of the sea floor of each fragment, shape (fragments, 3, 3)."""
    for e in range(body.size):
        b, m = body[e], motion[e]
        u, v, w = m[0:3], m[3:6], m[6:9]
        _add_inertia(inertia[b], load.mass[e], load.inertia[e], m)
        if load.floor[e] > 0.0:
            _add_outer(floor[b], load.mass[e] * load.floor[e], u, u)
            _add_outer(floor[b], load.mass[e] * load.floor[e], v, v)
        if load.floor_spin[e] > 0.0:
            _add_outer(floor[b], load.inertia[e] * load.floor_spin[e], w, w)


@kernel
def drag_and_slope(row: Floats, u: float, v: float) -> tuple[float, float, float, float, float]:
    """Acceleration (m s-2) by one medium, and minus its derivatives (s-1): xx, xy, yy."""
    du, dv = u - row[U], v - row[V]
    linear, c = row[LINEAR], row[QUADRATIC]
    if linear == 0.0 and c == 0.0:
        return row[PUSH_X], row[PUSH_Y], 0.0, 0.0, 0.0
    speed = math.sqrt(du * du + dv * dv)
    rate, inverse = linear + c * speed, (c / speed if speed > 0.0 else 0.0)
    return (
        row[PUSH_X] - rate * du,
        row[PUSH_Y] - rate * dv,
        rate + du * du * inverse,
        du * dv * inverse,
        rate + dv * dv * inverse,
    )


@kernel
def _velocity(m: Floats, q: Floats) -> tuple[float, float, float]:
    """Velocity (m s-1) and spin (rad s-1) of an element by the row of its motion and the velocity of its fragment."""
    return (
        m[0] * q[0] + m[1] * q[1] + m[2] * q[2],
        m[3] * q[0] + m[4] * q[1] + m[5] * q[2],
        m[6] * q[0] + m[7] * q[1] + m[8] * q[2],
    )


@kernel
def keep_forces(
    body: Ints, motion: Floats, acted: Floats, floor: Floats, held: Floats, part: float, applied: Floats
) -> None:
    """Add ``part`` of the accelerations by all forces of `riftberg.stepping.forces.media.FORCES`.

    ``acted``: `Acting.acted` (shape (elements, forces, 2)); ``floor``: rate of the drag of the sea floor, s-1 (shape
    (elements,)); ``held``: velocities at which it has acted (`BodyMotion.held`) (shape (fragments, 3)).
    """
    # As rows of numbers, so that the loop vectorises.
    one, other = acted.reshape(acted.size), applied.reshape(applied.size)
    for k in range(one.size):
        other[k] += part * one[k]
    for e in range(body.size):
        if floor[e] > 0.0:
            u, v, _ = _velocity(motion[e], held[body[e]])
            applied[e, SEA_FLOOR, 0] -= part * floor[e] * u
            applied[e, SEA_FLOOR, 1] -= part * floor[e] * v


@kernel
def _torque(load: Loading, e: int, w: float) -> tuple[float, float]:
    """Torque (N m) of the water on an element that spins, and minus its derivative."""
    spin = w - load.water_spin[e]
    drag = load.inertia[e] * load.spinning[e] * abs(spin)
    return -drag * spin, 2.0 * drag


@kernel
def add_forces(
    body: Ints, motion: Floats, rate: Floats, load: Loading, acted: Floats, force: Floats, total: Floats
) -> None:
    """Find the forces on all elements but those of contact and the linear drag of the sea floor.

    ``acted``: takes the accelerations (m s-2) by each of `riftberg.stepping.forces.media.FORCES` (shape (elements,
    forces, 2)); ``force``: takes the force east and north (N), and the torque about the vertical (N m) (shape
    (elements, 3)); ``total``: the force on the centre east and north, and the moment, are added to it (shape
    (fragments, 3)).
    """
    media, mass = load.media, load.mass
    for e in range(body.size):
        b, m = body[e], motion[e]
        u, v, w = _velocity(m, rate[b])
        ax = ay = 0.0
        if load.surrounded:
            ax, ay = load.coriolis[e] * v, -load.coriolis[e] * u
            acted[e, CORIOLIS, 0], acted[e, CORIOLIS, 1] = ax, ay
        for k in range(len(MEDIA)):
            if load.surrounded or (k == SEA_FLOOR and load.touches):
                dx, dy, _, _, _ = drag_and_slope(media[e, k], u, v)
                acted[e, k, 0], acted[e, k, 1] = dx, dy
                ax += dx
                ay += dy
        fx, fy, torque = mass[e] * ax + load.push_x[e], mass[e] * ay + load.push_y[e], _torque(load, e, w)[0]
        force[e, 0], force[e, 1], force[e, 2] = fx, fy, torque
        for i in range(3):
            total[b, i] += m[i] * fx + m[3 + i] * fy + m[6 + i] * torque


@kernel
def take_velocities(
    body: Ints, motion: Floats, rate: Floats, load: Loading, force: Floats, own: ElementMotion, shown: Shown
) -> None:
    """Give the elements the velocities of their fragments, and ``force`` the linear drag of the sea floor at these, in place."""
    for e in range(body.size):
        u, v, w = _velocity(motion[e], rate[body[e]])
        own.u[e] = own.u_sync[e] = shown.u_pair[e] = u
        own.v[e] = own.v_sync[e] = shown.v_pair[e] = v
        own.spin[e] = w
        force[e, 0] -= load.mass[e] * load.floor[e] * u
        force[e, 1] -= load.mass[e] * load.floor[e] * v
        force[e, 2] -= load.inertia[e] * load.floor_spin[e] * w


@kernel
def add_totals_and_slopes(
    body: Ints, motion: Floats, rate: Floats, load: Loading, sought: Booleans, total: Floats, slope: Floats
) -> None:
    """Add up the forces of `add_forces` for each fragment, and minus their derivatives by the velocities.

    The matrices are written out, and all is read before anything is written: the compiler cannot know that the arrays are
    apart, and would read the motion of an element again for each number.

    ``sought``: the others are left out (shape (fragments,)); ``total``: force on the centre east and north, and the
    moment (shape (fragments, 3)); ``slope``:  (shape (fragments, 3, 3)).
    """
    media, mass = load.media, load.mass
    for e in range(body.size):
        b, m, q = body[e], motion[e], rate[body[e]]
        if not sought[b]:
            continue
        m0, m1, m2, m3, m4, m5, m6, m7, m8 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]
        u, v = m0 * q[0] + m1 * q[1] + m2 * q[2], m3 * q[0] + m4 * q[1] + m5 * q[2]
        ax = ay = jxx = jxy = jyy = f = 0.0
        if load.surrounded:
            f = load.coriolis[e]
            ax, ay = f * v, -f * u
        for k in range(len(MEDIA)):
            if load.surrounded or (k == SEA_FLOOR and load.touches):
                dx, dy, dxx, dxy, dyy = drag_and_slope(media[e, k], u, v)
                ax += dx
                ay += dy
                jxx += dxx
                jxy += dxy
                jyy += dyy
        torque, turning = _torque(load, e, m6 * q[0] + m7 * q[1] + m8 * q[2])
        fx, fy, weight = mass[e] * ax + load.push_x[e], mass[e] * ay + load.push_y[e], mass[e]
        t, s = total[b], slope[b]
        t0, t1, t2 = m0 * fx + m3 * fy + m6 * torque, m1 * fx + m4 * fy + m7 * torque, m2 * fx + m5 * fy + m8 * torque
        # x, y, z are rows of B^T J; transposed, because J of the Coriolis force is antisymmetric.
        x0, y0, z0 = weight * (jxx * m0 + (jxy + f) * m3), weight * ((jxy - f) * m0 + jyy * m3), turning * m6
        x1, y1, z1 = weight * (jxx * m1 + (jxy + f) * m4), weight * ((jxy - f) * m1 + jyy * m4), turning * m7
        x2, y2, z2 = weight * (jxx * m2 + (jxy + f) * m5), weight * ((jxy - f) * m2 + jyy * m5), turning * m8
        s00, s01, s02 = x0 * m0 + y0 * m3 + z0 * m6, x0 * m1 + y0 * m4 + z0 * m7, x0 * m2 + y0 * m5 + z0 * m8
        s10, s11, s12 = x1 * m0 + y1 * m3 + z1 * m6, x1 * m1 + y1 * m4 + z1 * m7, x1 * m2 + y1 * m5 + z1 * m8
        s20, s21, s22 = x2 * m0 + y2 * m3 + z2 * m6, x2 * m1 + y2 * m4 + z2 * m7, x2 * m2 + y2 * m5 + z2 * m8
        t[0], t[1], t[2] = t[0] + t0, t[1] + t1, t[2] + t2
        s[0, 0], s[0, 1], s[0, 2] = s[0, 0] + s00, s[0, 1] + s01, s[0, 2] + s02
        s[1, 0], s[1, 1], s[1, 2] = s[1, 0] + s10, s[1, 1] + s11, s[1, 2] + s12
        s[2, 0], s[2, 1], s[2, 2] = s[2, 0] + s20, s[2, 1] + s21, s[2, 2] + s22


@kernel
def add_contact(body: Ints, motion: Floats, rate: Floats, touching: Touching, force: Floats, total: Floats) -> None:
    """Add the forces of contact between fragments at these velocities, in place."""
    for k in range(touching.first.size):
        i, j = touching.first[k], touching.second[k]
        p, q, m, n = rate[body[i]], rate[body[j]], motion[i], motion[j]
        du = n[0] * q[0] + n[1] * q[1] + n[2] * q[2] - (m[0] * p[0] + m[1] * p[1] + m[2] * p[2])
        dv = n[3] * q[0] + n[4] * q[1] + n[5] * q[2] - (m[3] * p[0] + m[4] * p[1] + m[5] * p[2])
        c = touching.damping[k]
        fx = touching.spring[k, 0] + c[0] * du + c[1] * dv
        fy = touching.spring[k, 1] + c[1] * du + c[2] * dv
        force[i, 0] += fx
        force[i, 1] += fy
        force[j, 0] -= fx
        force[j, 1] -= fy
        for a in range(3):
            total[body[i], a] += m[a] * fx + m[3 + a] * fy
            total[body[j], a] -= n[a] * fx + n[3 + a] * fy


class BodyRoom(NamedTuple):
    """Room for Newton's method: matrices (fragments, 3, 3), vectors (fragments, 3), and four matrices of 3 by 3.

    ``change`` is the last relative change of the velocities of each fragment, ``sought`` whether they are still to be
    found.
    """

    w: Floats
    p: Floats
    slope: Floats
    total: Floats
    miss: Floats
    step: Floats
    change: Floats
    sought: Booleans
    small: Floats


def allocate_body_room(count: int) -> BodyRoom:
    """Return room for ``count`` fragments."""
    w, p, slope = np.empty((3, count, 3, 3))
    total, miss, step = np.empty((3, count, 3))
    return BodyRoom(w, p, slope, total, miss, step, np.empty(count), np.empty(count, np.bool_), np.empty((4, 3, 3)))


@kernel
def solve_three(a: Floats, x: Floats) -> tuple[float, float, float]:
    """Solve three equations ``a`` with the right-hand side ``x`` by elimination with pivots; both are used up."""
    for k in range(3):
        best = k
        for i in range(k + 1, 3):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        for j in range(3):
            a[k, j], a[best, j] = a[best, j], a[k, j]
        x[k], x[best] = x[best], x[k]
        for i in range(k + 1, 3):
            factor = a[i, k] / a[k, k]
            for j in range(k, 3):
                a[i, j] -= factor * a[k, j]
            x[i] -= factor * x[k]
    z = x[2] / a[2, 2]
    y = (x[1] - a[1, 2] * z) / a[1, 1]
    return (x[0] - a[0, 1] * y - a[0, 2] * z) / a[0, 0], y, z


@kernel
def _times(matrix: Floats, x: Floats) -> tuple[float, float, float]:
    """Product of a 3 by 3 matrix and a vector."""
    return (
        matrix[0, 0] * x[0] + matrix[0, 1] * x[1] + matrix[0, 2] * x[2],
        matrix[1, 0] * x[0] + matrix[1, 1] * x[1] + matrix[1, 2] * x[2],
        matrix[2, 0] * x[0] + matrix[2, 1] * x[1] + matrix[2, 2] * x[2],
    )


@kernel
def _product(a: Floats, b: Floats, out: Floats) -> None:
    """Product of two 3 by 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def invert(matrices: Floats, out: Floats, small: Floats) -> None:
    """Find the inverse of each 3 by 3 matrix; ``small`` is room for two of them."""
    a, unit = small[0], small[1, 0]
    for b in range(matrices.shape[0]):
        for j in range(3):
            for i in range(3):
                unit[i] = 1.0 if i == j else 0.0
                for k in range(3):
                    a[i, k] = matrices[b, i, k]
            out[b, 0, j], out[b, 1, j], out[b, 2, j] = solve_three(a, unit)


@kernel
def floor_factors(mobility: Floats, floor: Floats, half: float, room: BodyRoom) -> None:
    """Find W and P M^-1 of the module's text over half a step of ``half`` seconds, for each fragment."""
    z, square, ahead = room.small[0], room.small[1], room.small[2]
    for b in range(floor.shape[0]):
        _product(mobility[b], floor[b], z)
        for i in range(3):
            for j in range(3):
                z[i, j] *= half
        _product(z, z, square)
        for i in range(3):
            for j in range(3):
                one = 1.0 if i == j else 0.0
                room.w[b, i, j], ahead[i, j] = one + z[i, j] + 0.5 * square[i, j], one + 0.5 * z[i, j]
        _product(ahead, mobility[b], room.p[b])


@kernel
def open_step(
    mobility: Floats, floor: Floats, rate: Floats, total: Floats, half: float, new: Floats, room: BodyRoom
) -> None:
    """Find velocities ``new`` in the middle of the step, from those at its start, at which the forces are ``total``."""
    floor_factors(mobility, floor, half, room)
    ahead = room.small[0, 0]
    for b in range(rate.shape[0]):
        x, y, z = _times(room.p[b], total[b])
        ahead[0], ahead[1], ahead[2] = rate[b, 0] + half * x, rate[b, 1] + half * y, rate[b, 2] + half * z
        new[b, 0], new[b, 1], new[b, 2] = solve_three(room.w[b], ahead)


@kernel
def newton_step(
    body: Ints, motion: Floats, load: Loading, rate: Floats, new: Floats, half: float, room: BodyRoom
) -> None:
    """Find the step of Newton's method for each fragment by itself, from the velocities ``new`` at the end of a step.

    ``room.w`` and ``room.p`` are those of `floor_factors`; fragments that are not ``room.sought`` are left out.
    """
    room.total[:, :] = 0.0
    room.slope[:, :, :] = 0.0
    add_totals_and_slopes(body, motion, new, load, room.sought, room.total, room.slope)
    matrix, right = room.small[0], room.small[1, 0]
    for b in range(new.shape[0]):
        if not room.sought[b]:
            continue
        pushed, gone = _times(room.p[b], room.total[b]), _times(room.w[b], new[b])
        for i in range(3):
            room.miss[b, i] = right[i] = rate[b, i] + half * pushed[i] - gone[i]
        _product(room.p[b], room.slope[b], matrix)
        for i in range(3):
            for j in range(3):
                matrix[i, j] = room.w[b, i, j] + half * matrix[i, j]
        room.step[b, 0], room.step[b, 1], room.step[b, 2] = solve_three(matrix, right)


@kernel
def _change(step: Floats, new: Floats, inertia: Floats) -> float:
    """How much a step of Newton's method changes the velocities at the rim of a fragment, as a part of them.

    A spin counts by the speed that it gives at the radius of gyration: that of a berg that does not turn is round-off. A
    fragment that all but stands counts as one that creeps at `CREEPING`.
    """
    arm = math.sqrt(inertia[2, 2] / inertia[0, 0])
    change = max(abs(step[0]), abs(step[1]), arm * abs(step[2]))
    return float(change / max(abs(new[0]), abs(new[1]), arm * abs(new[2]), CREEPING))


@kernel
def close_step(
    body: Ints, motion: Floats, load: Loading, inertia: Floats, mobility: Floats, floor: Floats, rate: Floats,
    new: Floats, half: float, room: BodyRoom,
) -> int:  # fmt: skip
    """Find the velocities ``new`` at the end of the step from those in its middle, ``rate``: Newton's method from a guess.

    Fragments that are not ``room.sought``, because they touch others, are left out
    (`riftberg.stepping.contact.islands`). Each goes its own number of passes: where it gets to does not depend, to the
    last digit, on which others there are.
    """
    floor_factors(mobility, floor, half, room)
    room.change[:] = 0.0
    for n in range(MOST_PASSES):
        newton_step(body, motion, load, rate, new, half, room)
        if not _take_steps(new, inertia, room):
            return n + 1
    return -1


@kernel
def _take_steps(new: Floats, inertia: Floats, room: BodyRoom) -> bool:
    """Take the step of Newton's method with each fragment whose velocities are sought; returns whether any still are."""
    more = False
    for b in range(new.shape[0]):
        if not room.sought[b]:
            continue
        for i in range(3):
            new[b, i] += room.step[b, i]
        before, change = room.change[b], _change(room.step[b], new[b], inertia[b])
        room.change[b] = change
        # As ``change (change / before)^2``, and false in the first pass, which has nothing before it.
        settled = change <= CLOSE_ENOUGH or change**3 <= NOTHING_LEFT * before**2
        # What is no number stays none: the search ends, and who looks at loads and places says where it came from.
        room.sought[b] = not settled and np.isfinite(new[b, 0] + new[b, 1] + new[b, 2])
        more = more or room.sought[b]
    return more


@kernel
def find_held(
    mobility: Floats, floor: Floats, total: Floats, after: Floats, half: float, held: Floats, small: Floats
) -> None:
    """Find the velocities at which the sea floor has acted in half a step to ``after``, under other forces ``total``.

    What `open_step` and `close_step` solve, ``W v' = v + h P F``, is ``M (v' - v) = h (F - D (v' + z v' / 2 - h M^-1 F
    / 2))`` with ``z = h M^-1 D``: the momentum that the floor takes is that of its drag D at the velocities in the
    brackets.
    """
    z = small[0]
    for b in range(after.shape[0]):
        _product(mobility[b], floor[b], z)
        slowed, pushed = _times(z, after[b]), _times(mobility[b], total[b])
        for i in range(3):
            held[b, i] = after[b, i] + 0.5 * half * slowed[i] - 0.5 * half * pushed[i]


class Acting(NamedTuple):
    """The forces at the velocities of one moment, without the linear drag of the sea floor.

    ``acted`` are the accelerations by medium (m s-2), without contact; ``total`` the forces on fragments (N, N, N m),
    with it.
    """

    acted: Floats
    total: Floats


class BodyMotion(NamedTuple):
    """What one place and time give for the motion of all fragments, before velocities are known.

    ``elements`` are the columns of `riftberg.stepping.bodies.pose.element_motion`; ``mobility`` is the inverse inertia,
    without the freedoms that supports hold; ``floor`` the drag of the sea floor.
    """

    body: Ints
    elements: Floats
    load: Loading
    touching: Touching
    inertia: Floats
    mobility: Floats
    floor: Floats


def check_passes(passes: int) -> None:
    """Refuse velocities that have not settled."""
    if passes < 0:
        raise RunError(f"the velocities of the fragments did not settle within {MOST_PASSES} passes")
