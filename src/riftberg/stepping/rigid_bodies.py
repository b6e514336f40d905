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
Newton's method; fragments that touch are solved together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.errors import RunError
from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import spin_drag
from riftberg.physics.geometry import separation
from riftberg.physics.grounding import grounding_spin_rate
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.stepping.conglomerates import connected_parts
from riftberg.stepping.interactions import COLLISION, PairLaw, pair_terms
from riftberg.stepping.media import (
    CORIOLIS,
    LINEAR,
    PUSH_X,
    PUSH_Y,
    QUADRATIC,
    SEA_FLOOR,
    Surroundings,
    U,
    V,
    find_surroundings,
    grounded_part,
)
from riftberg.stepping.sizes import Sizes

MOST_PASSES = 50
"""Passes of Newton's method after which a step is given up; two to four are usual."""

CLOSE_ENOUGH = 1e-13
"""Relative change of the velocities at which Newton's method ends."""


class Loading(NamedTuple):
    """What acts on the elements at one place and time, before velocities are known.

    ``media`` and ``coriolis`` are those of `riftberg.stepping.media.Surroundings`, less the linear drag of the sea floor:
    ``floor`` and ``floor_spin`` are its rates (s-1), ``aground`` tells how far an element touches it (0 to 1).
    ``spinning`` is the rotational drag (rad-1) and ``water_spin`` the rotation of the water (s-1); ``push_x``, ``push_y``
    are steady forces (N). ``surrounded`` tells whether the media act, ``touches`` whether the sea floor does.
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


def find_loading(el: Elements, sizes: Sizes, around: Surroundings, p: KernelParameters) -> Loading:
    """Take the coefficients of all forces from the environment that the elements carry."""
    return Loading(*_find_loading(el, sizes, around, p))


@kernel
def _find_loading(
    el: Elements, sizes: Sizes, around: Surroundings, p: KernelParameters
) -> tuple[
    Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, bool, bool
]:  # fmt: skip
    """Return the fields of `Loading`; see `riftberg.kernels` why no named tuple."""
    body = el.body
    count = body.mass.size
    find_surroundings(el, sizes, around, p)
    media = around.media.copy()
    inertia, floor, floor_spin, aground = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    spinning = np.zeros(count)
    mass, thickness, depth = body.mass, body.thickness, el.environment.depth
    radius, bond_mass = sizes.bond_radius, sizes.bond_mass
    touches = p.ground_on_substeps or not p.only_interactions
    for e in range(count):
        inertia[e] = 0.5 * mass[e] * radius[e] ** 2
        aground[e] = grounded_part(thickness[e], depth[e], p)
        if touches:
            # The linear drag of the sea floor is the one stiff force: it is met implicitly, apart from the others.
            floor[e] = media[e, SEA_FLOOR, LINEAR]
        media[e, SEA_FLOOR, LINEAR] = 0.0
        if p.ground_torque:
            floor_spin[e] = grounding_spin_rate(p.ground_coefficient, radius[e], bond_mass[e], aground[e])
        if p.rotational_drag and not p.only_interactions:
            spinning[e] = spin_drag(inertia[e], radius[e], p.ocean_scale)
    return (
        media, around.coriolis.copy(), mass, inertia, floor, floor_spin, aground, spinning,
        0.5 * el.environment.vorticity, body.load_x, body.load_y, not p.only_interactions, touches,
    )  # fmt: skip


def touching_pairs(el: Elements, partners: PairList, sizes: Sizes, law: PairLaw) -> Touching:
    """Find the pairs of different fragments that touch: the law of contact between bergs, as a force on each pair."""
    return Touching(*_touching_pairs(el, partners, sizes, law))


@kernel
def _touching_pairs(el: Elements, partners: PairList, sizes: Sizes, law: PairLaw) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the fields of `Touching`; see `riftberg.kernels` why no named tuple."""
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
def inertia_and_floor(bodies_body: Ints, count: int, motion: Floats, load: Loading) -> tuple[Floats, Floats]:
    """Matrices of inertia and of the drag of the sea floor of each fragment, shape (fragments, 3, 3)."""
    inertia, floor = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    for e in range(bodies_body.size):
        b, m = bodies_body[e], motion[e]
        u, v, w = m[0:3], m[3:6], m[6:9]
        _add_outer(inertia[b], load.mass[e], u, u)
        _add_outer(inertia[b], load.mass[e], v, v)
        _add_outer(inertia[b], load.inertia[e], w, w)
        if load.floor[e] > 0.0:
            _add_outer(floor[b], load.mass[e] * load.floor[e], u, u)
            _add_outer(floor[b], load.mass[e] * load.floor[e], v, v)
        if load.floor_spin[e] > 0.0:
            _add_outer(floor[b], load.inertia[e] * load.floor_spin[e], w, w)
    return inertia, floor


@kernel
def _drag(row: Floats, u: float, v: float) -> tuple[float, float, float, float, float]:
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
def keep_body_forces(
    load: Loading, u: Floats, v: Floats, u_held: Floats, v_held: Floats, part: float, applied: Floats
) -> None:
    """Add ``part`` of the accelerations by all forces of `riftberg.stepping.media.FORCES` at these velocities.

    ``u_held`` and ``v_held`` are those at which the sea floor has acted (`BodyMotion.held`).
    """
    for e in range(u.size):
        for m in range(load.media.shape[1]):
            if load.surrounded or (m == SEA_FLOOR and load.touches):
                ax, ay, _, _, _ = _drag(load.media[e, m], u[e], v[e])
                applied[e, m, 0] += part * ax
                applied[e, m, 1] += part * ay
        if load.surrounded:
            applied[e, CORIOLIS, 0] += part * load.coriolis[e] * v[e]
            applied[e, CORIOLIS, 1] -= part * load.coriolis[e] * u[e]
        applied[e, SEA_FLOOR, 0] -= part * load.floor[e] * u_held[e]
        applied[e, SEA_FLOOR, 1] -= part * load.floor[e] * v_held[e]


@kernel
def forces_and_slope(body: Ints, motion: Floats, rate: Floats, load: Loading) -> tuple[Floats, Floats, Floats]:
    """Forces on all elements but those of sea floor and contact, their sums for each fragment, and minus the derivatives.

    Returns
    -------
    force : array of float, shape (elements, 3)
        East and north (N), and torque about the vertical (N m).
    total : array of float, shape (fragments, 3)
        Force on the centre east and north, and the moment.
    slope : array of float, shape (fragments, 3, 3)
        Minus the derivative of ``total`` by the velocities.
    """
    count = rate.shape[0]
    force, total, slope = np.zeros((body.size, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    media, mass = load.media, load.mass
    for e in range(body.size):
        b, m = body[e], motion[e]
        q = rate[b]
        u = m[0] * q[0] + m[1] * q[1] + m[2] * q[2]
        v = m[3] * q[0] + m[4] * q[1] + m[5] * q[2]
        w = m[6] * q[0] + m[7] * q[1] + m[8] * q[2]
        ax = ay = jxx = jxy = jyy = f = 0.0
        if load.surrounded:
            f = load.coriolis[e]
            ax, ay = f * v, -f * u
        for k in range(media.shape[1]):
            if load.surrounded or (k == SEA_FLOOR and load.touches):
                dx, dy, dxx, dxy, dyy = _drag(media[e, k], u, v)
                ax += dx
                ay += dy
                jxx += dxx
                jxy += dxy
                jyy += dyy
        spin = w - load.water_spin[e]
        torque = -load.inertia[e] * load.spinning[e] * abs(spin) * spin
        fx, fy = mass[e] * ax + load.push_x[e], mass[e] * ay + load.push_y[e]
        force[e, 0], force[e, 1], force[e, 2] = fx, fy, torque
        turning = 2.0 * load.inertia[e] * load.spinning[e] * abs(spin)
        for i in range(3):
            total[b, i] += m[i] * fx + m[3 + i] * fy + m[6 + i] * torque
            x = mass[e] * (jxx * m[i] + (jxy + f) * m[3 + i])
            y = mass[e] * ((jxy - f) * m[i] + jyy * m[3 + i])
            z = turning * m[6 + i]
            # x, y, z are rows of B^T J; transposed, because J of the Coriolis force is antisymmetric.
            for j in range(3):
                slope[b, i, j] += x * m[j] + y * m[3 + j] + z * m[6 + j]
    return force, total, slope


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


@kernel
def contact_slope(body: Ints, motion: Floats, touching: Touching, row: Ints, size: int) -> Floats:
    """Minus the derivative of the forces of contact by the velocities of the fragments that have a row."""
    matrix = np.zeros((3 * size, 3 * size))
    for k in range(touching.first.size):
        i, j = touching.first[k], touching.second[k]
        if row[body[i]] < 0:
            continue
        c = touching.damping[k]
        for first in range(2):
            e = i if first == 0 else j
            for second in range(2):
                o = i if second == 0 else j
                sign = 1.0 if first == second else -1.0
                at, to = 3 * row[body[e]], 3 * row[body[o]]
                for a in range(3):
                    x = c[0] * motion[e, a] + c[1] * motion[e, 3 + a]
                    y = c[1] * motion[e, a] + c[2] * motion[e, 3 + a]
                    for b in range(3):
                        matrix[at + a, to + b] += sign * (x * motion[o, b] + y * motion[o, 3 + b])
    return matrix


@kernel
def island_steps(
    members: Ints, start: Ints, body: Ints, motion: Floats, touching: Touching, w: Floats, p: Floats, slope: Floats,
    miss: Floats, half: float,
) -> Floats:  # fmt: skip
    """One step of Newton's method for all islands of fragments that touch each other, shape (members, 3).

    Parameters
    ----------
    members, start : array of int
        Fragments of all islands one after the other, and where each island begins in them; ``start`` ends with their number.
    body, motion, touching
        See `BodyMotion`.
    w, p, slope : array of float, shape (fragments, 3, 3)
        W and P M^-1 of the module's text, and minus the derivative of the forces without contact.
    miss : array of float, shape (fragments, 3)
        By how much the velocities miss their equation.
    half : float
        Half the step, s.
    """
    step, row = np.zeros((members.size, 3)), np.full(w.shape[0], -1, np.int64)
    for k in range(start.size - 1):
        first, size = start[k], start[k + 1] - start[k]
        for n in range(size):
            row[members[first + n]] = n
        force = contact_slope(body, motion, touching, row, size)
        matrix, right = np.zeros((3 * size, 3 * size)), np.empty(3 * size)
        for n in range(size):
            b, at = members[first + n], 3 * n
            row[b] = -1
            for i in range(3):
                right[at + i] = miss[b, i]
                for j in range(3):
                    force[at + i, at + j] += slope[b, i, j]
            for i in range(3):
                for c in range(3 * size):
                    for j in range(3):
                        matrix[at + i, c] += half * p[b, i, j] * force[at + j, c]
                for j in range(3):
                    matrix[at + i, at + j] += w[b, i, j]
        found = np.linalg.solve(matrix, right)
        for n in range(3 * size):
            step[first + n // 3, n % 3] = found[n]
    return step


class BodyMotion(NamedTuple):
    """What one place and time give for the motion of all fragments, before velocities are known.

    ``elements`` are the columns of `riftberg.stepping.frames.element_motion`; ``mobility`` is the inverse inertia,
    without the freedoms that supports hold; ``floor`` the drag of the sea floor.
    """

    body: Ints
    elements: Floats
    load: Loading
    touching: Touching
    inertia: Floats
    mobility: Floats
    floor: Floats

    def forces(self, rate: Floats) -> tuple[Floats, Floats, Floats]:
        """Forces on the elements, on the fragments, and minus the derivatives of those without contact."""
        force, total, slope = forces_and_slope(self.body, self.elements, rate, self.load)
        add_contact(self.body, self.elements, rate, self.touching, force, total)
        return force, total, slope

    def _floor_factors(self, half: float) -> tuple[Floats, Floats]:
        """W and P M^-1 of the module's text over half a step of ``half`` seconds."""
        one = np.eye(3)
        z = half * (self.mobility @ self.floor)
        return one + z + 0.5 * (z @ z), (one + 0.5 * z) @ self.mobility

    def opened(self, rate: Floats, half: float) -> Floats:
        """Velocities in the middle of the step, from those at its start."""
        w, p = self._floor_factors(half)
        _, total, _ = self.forces(rate)
        ahead = rate + half * each_times(p, total)
        return np.asarray(np.linalg.solve(w, ahead[:, :, None])[:, :, 0])

    def closed(self, rate: Floats, half: float) -> Floats:
        """Velocities at the end of the step, from those in its middle: Newton's method.

        Raises
        ------
        RunError
            If the velocities do not settle.
        """
        w, p = self._floor_factors(half)
        members, start = self._islands()
        new = rate.copy()
        for _ in range(MOST_PASSES):
            _, total, slope = self.forces(new)
            miss = rate + half * each_times(p, total) - each_times(w, new)
            step: Floats = np.asarray(np.linalg.solve(w + half * (p @ slope), miss[:, :, None])[:, :, 0], np.float64)
            if members.size:
                step[members] = island_steps(
                    members, start, self.body, self.elements, self.touching, w, p, slope, miss, half
                )
            new = new + step
            if np.abs(step).max() <= CLOSE_ENOUGH * (np.abs(new).max() + 1e-30) or _small(step, new):
                return new
        raise RunError(f"the velocities of the fragments did not settle within {MOST_PASSES} passes")

    def held(self, rate: Floats, after: Floats, half: float) -> Floats:
        """Velocities at which the sea floor has acted in half a step that ended with ``after``, other forces at ``rate``.

        What `opened` and `closed` solve, ``W v' = v + h P F``, is ``M (v' - v) = h (F - D (v' + z v' / 2 - h M^-1 F / 2))``
        with ``z = h M^-1 D``: the momentum that the floor takes is that of its drag D at the velocities in the brackets.
        """
        _, total, _ = self.forces(rate)
        z = half * (self.mobility @ self.floor)
        return after + 0.5 * each_times(z, after) - 0.5 * half * each_times(self.mobility, total)

    def _islands(self) -> tuple[Ints, Ints]:
        """Fragments that touch others, island by island, and where each island begins."""
        if self.touching.first.size == 0:
            return np.zeros(0, np.int64), np.zeros(1, np.int64)
        a, b = self.body[self.touching.first], self.body[self.touching.second]
        count = self.mobility.shape[0]
        part = connected_parts(count, a, b, np.zeros(a.size, np.int64))
        inside = np.flatnonzero(np.isin(part, part[a]))
        members = inside[np.argsort(part[inside], kind="stable")]
        _, sizes = np.unique(part[members], return_counts=True)
        return members, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def each_times(matrices: Floats, vectors: Floats) -> Floats:
    """Product of each matrix with its vector."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _small(step: Floats, rate: Floats) -> bool:
    """Whether a step of Newton's method changes velocities and spins by nothing that counts."""
    speed, spin = np.abs(rate[:, :2]).max() + 1e-9, np.abs(rate[:, 2]).max() + 1e-15
    return bool(np.abs(step[:, :2]).max() <= CLOSE_ENOUGH * speed and np.abs(step[:, 2]).max() <= 1e-11 * spin)


def element_velocities(body: Ints, motion: Floats, rate: Floats) -> tuple[Floats, Floats, Floats]:
    """Eastward and northward velocity (m s-1) and spin (rad s-1) of all elements."""
    q = rate[body]
    return (
        np.asarray((motion[:, 0:3] * q).sum(axis=1)),
        np.asarray((motion[:, 3:6] * q).sum(axis=1)),
        np.asarray((motion[:, 6:9] * q).sum(axis=1)),
    )
