"""Dynamics of fragments as rigid bodies under the forces on their elements: a step of second order.

With the velocity q of a fragment (east, north, spin) and the velocities of its elements ``v_k = B_k q``, virtual work gives

    M dq/dt = G(q),   M = sum m B^T B + I b b^T,   G = sum B^T f

where f are all forces on an element except contact and the sea floor, which act in sub-steps. A step of h seconds is
velocity Verlet:

    q(1/2) = q(0) + (h/2) M^-1 G(x0, q0)
    x1     = x0 moved by h q(1/2)
    q(1)   = q(1/2) + (h/2) M^-1 G(x1, q1)

Drag and the Coriolis force are centred by both halves together. The second half is solved by Newton's method. Fragments in
contact go through the step in `riftberg.engines.quasi_static.contact.islands`, those on the sea floor in
`riftberg.engines.quasi_static.ground`.

The first half takes drag at the speed of the start. A berg of 30 m has its speed in the water within minutes: in half a
step of a quarter of an hour it would be flung past it by ten times as much. So any loss of an element's speed through a
medium beyond `EXPLICIT_PART` in the half step is taken implicitly, with the drag D of that excess:

    (1 + (h/2) M^-1 D) q(1/2) = q(0) + (h/2) M^-1 (G(x0, q0) + D q0)

Drag c |v| v per mass has the rate c |v|: at the speed v of the start through the medium, or, where that is less, at
sqrt(a / c), to which the acceleration a of the start can bring it (`drag_rates`). So a berg that drag alone stops goes on, and
v(1/2) is sqrt(a / c) in a long step of one that is pushed. Spin is seldom driven: of its drag, all is implicit from twice
`EXPLICIT_PART` on, so that w(1/2) is w0 / (1 + h c w0 / 2), as it should be of a lone berg that its sides brake.
The second half takes all drag implicitly. Where the step resolves drag, D is 0.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.constants import DEGREE, EARTH_ROTATION
from riftberg.engines.common.forces.media import (
    CORIOLIS,
    LIMIT,
    LINEAR,
    MEDIA,
    PUSH_X,
    PUSH_Y,
    QUADRATIC,
    SEA_ICE,
    SPIN,
    SPIN_QUADRATIC,
    WATER,
    YIELD,
    ForcedElements,
    Medium,
    Surroundings,
    U,
    V,
    find_surroundings,
    grounded_part,
    ice_depth,
)
from riftberg.engines.common.forces.pack import corner_slope, find_fragments_in_pack, is_any, next_direction
from riftberg.engines.common.forces.sizes import Sizes, rectangle_inertia
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import ocean_drag, outline_drag
from riftberg.physics.elementary import sin
from riftberg.physics.floating import draft_of
from riftberg.physics.geometry import multiply, solve, times
from riftberg.physics.sea_ice import yield_rate
from riftberg.state import Elements, Floats, Ints, Shown
from riftberg.state import Motion as ElementMotion

Booleans = NDArray[np.bool_]

MAX_ITERATIONS = 50
"""Iterations of Newton's method after which a step is given up; two to four are usual."""

NEWTON_RTOL = 1e-8
"""Relative change of the velocities at which Newton's method ends: the error left is of the order of its square."""

NEWTON_PREDICTED_RTOL = 1e-11
"""Relative change that the next iteration would bring, judged by the last two, at which it is spared."""

INERTIAL_PART = 1.0 / 6.0
"""Longest trial step as a part of the inertial period, 2.3 h at 60 degrees."""

EXPLICIT_PART = 0.25
"""Largest part of its speed through the media that the drag at the start of a step may take from an element in the first half
kick; drag beyond that is taken implicitly. At 1 it would come to rest in them, beyond 2 it would be flung to the other side."""

VELOCITY_SCALE = 1e-6
"""Least speed (m s-1) that changes are measured by: at rest they would be parts of round-off."""


class ElementForcing(NamedTuple):
    """Coefficients of all forces on the elements at one place and time, before velocities are known.

    Media and Coriolis parameter: see `riftberg.engines.common.forces.media.Surroundings`.
    """

    media: Floats  # Rows of the media; shape (elements, media, columns)
    coriolis: Floats  # Coriolis parameter, s-1; shape (elements,), as all below
    mass: Floats  # kg
    inertia: Floats  # Moment of inertia of an element about its own centre, kg m2
    aground: Floats  # How far an element is aground, 0 to 1
    spin_drag: Floats  # Rotational drag of the water, rad-1
    water_spin: Floats  # Rotation of the water, rad s-1
    # Points on the outlines of fragments, element by element (`SIDE_NORMAL_X` ...), then zeros; shape
    # (elements, points, 4)
    sides: Floats
    side_drag: Floats  # Drag of the water by length (in sides of the element) and (normal speed)^2, kg m-1
    push_x: Floats  # Given force, east, N
    push_y: Floats  # Given force, north, N
    media_act: bool  # Whether the media act at all


class ForceTerms(NamedTuple):
    """The forces at the velocities of one moment, without contact and the sea floor."""

    accelerations: (
        Floats  # By each of `riftberg.engines.common.forces.media.FORCES`, m s-2; shape (elements, forces, 2)
    )
    net_force: Floats  # On the fragments, N, N, N m; shape (fragments, 3)
    # Drag of all media per velocity through them, the same of the spin (s-1), and the growth of the first with the velocity
    # (m-1); shape (elements, 3)
    drag_rate: Floats


class HalfKick(NamedTuple):
    """A first half kick of all fragments."""

    twist: Floats  # Velocities at mid-step; shape (fragments, 3)
    drag: Floats  # On elements of which a part is taken implicitly, see `drag_rates`; 0 on others; shape (elements, 2)


class BodyMatrices(NamedTuple):
    """Inertia of the fragments: the matrices of the equation of motion."""

    inertia: Floats  # M; shape (fragments, 3, 3)
    mobility: Floats  # Inverse of M, without the freedoms that supports take; shape (fragments, 3, 3)


class BodyOperators(NamedTuple):
    """Operators of the motion of all fragments at one place and time, before velocities are known."""

    body: Ints  # Fragment of each element; shape (elements,)
    levers: Floats  # See `riftberg.engines.quasi_static.bodies.pose.fill_levers`; shape (elements, 11)
    forcing: ElementForcing
    matrices: BodyMatrices


def longest_trial_step(forcing: ElementForcing, dt: float) -> float:
    """Return the longest trial step (s) of a time step of ``dt`` s, by the Coriolis force if it acts."""
    if not forcing.media_act or dt <= INERTIAL_PART * math.pi / EARTH_ROTATION:  # the period at the poles, the shortest
        return dt
    coriolis = float(np.abs(forcing.coriolis).max(initial=0.0))
    return min(dt, INERTIAL_PART * 2.0 * math.pi / coriolis) if coriolis > 0.0 else dt


def allocate_forcing(el: Elements, p: KernelParameters, sides: Floats | None = None) -> ElementForcing:
    """Return arrays for the forces on the elements at one moment; ``sides``: of `ElementForcing`, if any."""
    count, body = el.size, el.body
    inertia, aground, drag, water_spin, side_drag = np.zeros((5, count))
    if sides is None:
        sides = np.zeros((count, 0, 4))
    return ElementForcing(
        np.empty((count, len(MEDIA), len(Medium._fields))), np.empty(count), body.mass, inertia, aground, drag, water_spin,
        sides, side_drag, body.load_x, body.load_y, not p.only_interactions,
    )  # fmt: skip


@kernel
def take_elements(f: ElementForcing, rows: Any) -> ElementForcing:
    """Forcing of some elements; ``rows``: their numbers, or a slice."""
    return ElementForcing(
        f.media[rows], f.coriolis[rows], f.mass[rows], f.inertia[rows], f.aground[rows], f.spin_drag[rows], f.water_spin[rows],
        f.sides[rows], f.side_drag[rows], f.push_x[rows], f.push_y[rows], f.media_act,
    )  # fmt: skip


@kernel
def evaluate_forcing(
    el: ForcedElements, sizes: Sizes, p: KernelParameters, acts: Booleans, nothing: Floats, forcing: ElementForcing
) -> None:
    """Take the coefficients of all forces from the environment that the elements carry.

    ``acts`` (media,) and ``nothing`` (1, 0, 0) stand in for the results of a velocity solve: none is made here.
    """
    media, mass, inertia, aground = forcing.media, forcing.mass, forcing.inertia, forcing.aground
    find_surroundings(el, sizes, Surroundings(media, forcing.coriolis, acts, nothing[0], nothing), p)
    for e in range(mass.size):  # by a sine that is the same on every processor: KID's is that of the C library
        latitude = el.place.lat[e] if p.latlon and not p.f_plane else p.reference_latitude
        forcing.coriolis[e] = 2.0 * EARTH_ROTATION * sin(latitude * DEGREE)
    thickness, length, width, depth = el.body.thickness, el.body.length, el.body.width, el.environment.depth
    bonds, ice, fraction, own_drag = (
        el.body.bond_count, el.environment.ice_thickness, el.environment.ice_fraction, el.environment.own_water_drag
    )  # fmt: skip
    for e in range(mass.size):
        if forcing.sides.shape[1] > 0 and bonds[e] > 0 and own_drag[e] < 0.0:
            # In place of the element's share of a mean over all directions.
            draft = draft_of(thickness[e], p.rho_ice)
            wet, area = draft - ice_depth(ice[e], min(fraction[e], 1.0), draft, p), length[e] * width[e]
            forcing.side_drag[e] = outline_drag(wet, p.ocean_scale, p.water_side_drag) * math.sqrt(area)
            media[e, WATER, QUADRATIC] = ocean_drag(
                mass[e], length[e], width[e], 0.0, 0.0, 0.0, p.ocean_scale, p.water_side_drag, p.water_base_drag
            )
        inertia[e] = rectangle_inertia(mass[e], length[e], width[e])
        aground[e] = grounded_part(thickness[e], depth[e], p)
        forcing.water_spin[e] = media[e, WATER, SPIN]
        if forcing.media_act:
            forcing.spin_drag[e] = media[e, WATER, SPIN_QUADRATIC]


@kernel
def _add_outer(matrix: Floats, factor: float, a: Floats, b: Floats) -> None:
    """Add ``factor a b^T`` of three-vectors."""
    for i in range(3):
        for j in range(3):
            matrix[i, j] += factor * a[i] * b[j]


@kernel
def _add_element_inertia(matrix: Floats, mass: float, inertia: float, m: Floats) -> None:
    """Add ``mass (u u^T + v v^T) + inertia w w^T``, with u, v and w one after the other in ``m``."""
    for i in range(3):
        for j in range(3):
            # In one expression: each number is read and written once.
            matrix[i, j] = (
                matrix[i, j] + mass * m[i] * m[j] + mass * m[3 + i] * m[3 + j] + inertia * m[6 + i] * m[6 + j]
            )


@kernel
def add_inertia(body: Ints, levers: Floats, forcing: ElementForcing, inertia: Floats) -> None:
    """Add the inertia of the elements to the matrices of their fragments, shape (fragments, 3, 3)."""
    for e in range(body.size):
        _add_element_inertia(inertia[body[e]], forcing.mass[e], forcing.inertia[e], levers[e])


@kernel
def drag_and_jacobian(row: Floats, u: float, v: float) -> tuple[float, float, float, float, float, float]:
    """Acceleration (m s-2) by one medium, minus its derivatives xx, xy, yy, and the drag per velocity through it (s-1).

    For a hold that yields, the derivatives take its rate alone (`riftberg.engines.common.forces.pack`).
    """
    du, dv = u - row[U], v - row[V]
    linear, c, limit = row[LINEAR], row[QUADRATIC], row[LIMIT]
    if linear == 0.0 and c == 0.0 and limit == 0.0:
        return row[PUSH_X], row[PUSH_Y], 0.0, 0.0, 0.0, 0.0
    speed = math.sqrt(du * du + dv * dv)
    rate, inverse = linear + c * speed, (c / speed if speed > 0.0 else 0.0)
    if limit > 0.0:
        rate += yield_rate(limit, speed, row[YIELD])
    return (
        row[PUSH_X] - rate * du,
        row[PUSH_Y] - rate * dv,
        rate + du * du * inverse,
        du * dv * inverse,
        rate + dv * dv * inverse,
        rate,
    )


SIDE_NORMAL_X, SIDE_NORMAL_Y, SIDE_ARM, SIDE_LENGTH = range(4)
"""Columns of a point on the outline of a fragment: the normal to it (along the axes of the fragment), the lever of a force along
that about the centre of its element (m), and the length of outline that it stands for, in sides of the element."""


@kernel
def outline_force(
    forcing: ElementForcing, e: int, c: float, s: float, u: float, v: float, w: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Force and torque (N, N, N m) of the water on the outline at an element, minus their derivatives xx, xy, yy, xw, yw, ww.

    ``c``, ``s``: cosine and sine of the angle of the axis of the fragment from local east; ``u``, ``v``, ``w``: velocity (m s-1)
    and spin (rad s-1) of the element.
    """
    fx = fy = torque = xx = xy = yy = xw = yw = ww = 0.0
    if forcing.side_drag[e] == 0.0 or not forcing.media_act:
        return fx, fy, torque, xx, xy, yy, xw, yw, ww
    points, water = forcing.sides[e], forcing.media[e, WATER]
    u, v, w = u - water[U], v - water[V], w - forcing.water_spin[e]
    for i in range(points.shape[0]):
        if points[i, SIDE_LENGTH] == 0.0:
            break
        x = c * points[i, SIDE_NORMAL_X] - s * points[i, SIDE_NORMAL_Y]
        y = s * points[i, SIDE_NORMAL_X] + c * points[i, SIDE_NORMAL_Y]
        arm = points[i, SIDE_ARM]
        normal = x * u + y * v + arm * w
        drag = forcing.side_drag[e] * points[i, SIDE_LENGTH] * abs(normal)
        fx, fy, torque = fx - drag * normal * x, fy - drag * normal * y, torque - drag * normal * arm
        xx, xy, yy = xx + 2.0 * drag * x * x, xy + 2.0 * drag * x * y, yy + 2.0 * drag * y * y
        xw, yw, ww = xw + 2.0 * drag * x * arm, yw + 2.0 * drag * y * arm, ww + 2.0 * drag * arm * arm
    return fx, fy, torque, xx, xy, yy, xw, yw, ww


@kernel
def outline_quadratic(forcing: ElementForcing, e: int) -> float:
    """Drag of the water on the outline at an element by (speed)^2, m-1: of the half of it that lies along the flow at most."""
    if forcing.side_drag[e] == 0.0 or not forcing.media_act:
        return 0.0
    length, points = 0.0, forcing.sides[e]
    for i in range(points.shape[0]):
        if points[i, SIDE_LENGTH] == 0.0:
            break
        length += points[i, SIDE_LENGTH]
    return float(0.5 * forcing.side_drag[e] * length / forcing.mass[e])


@kernel
def element_velocity(m: Floats, q: Floats) -> tuple[float, float, float]:
    """Velocity (m s-1) and spin (rad s-1) of an element: B q, from its levers and the velocity of its fragment."""
    return (
        m[0] * q[0] + m[1] * q[1] + m[2] * q[2],
        m[3] * q[0] + m[4] * q[1] + m[5] * q[2],
        m[6] * q[0] + m[7] * q[1] + m[8] * q[2],
    )


@kernel
def accumulate_forces(accelerations: Floats, weight: float, applied: Floats) -> None:
    """Add ``weight`` of the accelerations by all forces to ``applied`` (elements, forces, 2)."""
    # As rows of numbers, so that the loop vectorises.
    source, target = accelerations.reshape(accelerations.size), applied.reshape(applied.size)
    for k in range(source.size):
        target[k] += weight * source[k]


@kernel
def spin_torque(forcing: ElementForcing, e: int, w: float) -> tuple[float, float]:
    """Torque (N m) of the water on an element that spins, and minus its derivative."""
    spin = w - forcing.water_spin[e]
    drag = forcing.inertia[e] * forcing.spin_drag[e] * abs(spin)
    return -drag * spin, 2.0 * drag


@borrower
def add_forces(
    body: Ints,
    levers: Floats,
    twist: Floats,
    forcing: ElementForcing,
    accelerations: Floats,
    drag_rate: Floats,
    force: Floats,
    net_force: Floats,
) -> None:
    """Find the forces on all elements except contact and the sea floor.

    ``accelerations`` and ``drag_rate``: see `ForceTerms`; ``force`` (elements, 3) takes the force and the torque about
    the vertical (N, N, N m); sums over the fragments are added to ``net_force`` (fragments, 3).
    """
    media, mass = forcing.media, forcing.mass
    for e in range(body.size):
        b, m = body[e], levers[e]
        u, v, w = element_velocity(m, twist[b])
        ax = ay = rate = quadratic = 0.0
        if forcing.media_act:
            ax, ay = forcing.coriolis[e] * v, -forcing.coriolis[e] * u
            accelerations[e, CORIOLIS, 0], accelerations[e, CORIOLIS, 1] = ax, ay
        for k in range(len(MEDIA)):
            if forcing.media_act:
                dx, dy, _, _, _, medium_rate = drag_and_jacobian(media[e, k], u, v)
                accelerations[e, k, 0], accelerations[e, k, 1] = dx, dy
                ax += dx
                ay += dy
                rate += medium_rate
                quadratic += media[e, k, QUADRATIC]
        torque, turning = spin_torque(forcing, e, w)
        if forcing.side_drag[e] > 0.0:
            side_force = outline_force(forcing, e, m[9], m[10], u, v, w)
            dx, dy, c = side_force[0] / mass[e], side_force[1] / mass[e], outline_quadratic(forcing, e)
            accelerations[e, WATER, 0] += dx
            accelerations[e, WATER, 1] += dy
            ax, ay, torque = ax + dx, ay + dy, torque + side_force[2]
            rate += c * math.hypot(u - media[e, WATER, U], v - media[e, WATER, V])
            quadratic += c
        drag_rate[e, 0], drag_rate[e, 1], drag_rate[e, 2] = rate, 0.5 * turning / forcing.inertia[e], quadratic
        fx, fy = mass[e] * ax + forcing.push_x[e], mass[e] * ay + forcing.push_y[e]
        force[e, 0], force[e, 1], force[e, 2] = fx, fy, torque
        for i in range(3):
            net_force[b, i] += m[i] * fx + m[3 + i] * fy + m[6 + i] * torque


@kernel
def scatter_velocities(
    body: Ints,
    levers: Floats,
    twist: Floats,
    motion: ElementMotion,
    shown: Shown,
) -> None:
    """Give the elements the velocities of their fragments."""
    for e in range(body.size):
        u, v, w = element_velocity(levers[e], twist[body[e]])
        motion.u[e] = motion.u_sync[e] = shown.u_pair[e] = u
        motion.v[e] = motion.v_sync[e] = shown.v_pair[e] = v
        motion.spin[e] = w


@borrower
def assemble_force_and_jacobian(
    body: Ints,
    levers: Floats,
    twist: Floats,
    forcing: ElementForcing,
    active: Booleans,
    net_force: Floats,
    jacobian: Floats,
) -> None:
    """Add to each active fragment ``sum B^T f`` of the forces of `add_forces`, and the Jacobian ``sum B^T J B``.

    B are the levers of an element as a matrix of 3 by 3, with its rows m0 m1 m2 (u), m3 m4 m5 (v) and m6 m7 m8 (spin), and
    J is minus the derivative of its force by its velocity:

        J = [ weight (jxx      jxy - f)        0 ]   [ oxx oxy oxw ]
            [ weight (jxy + f  jyy    )        0 ] + [ oxy oyy oyw ]
            [         0        0         turning ]   [ oxw oyw oww ]

    with the second part by the outline (`outline_force`).

    The loop over the entries of both products is written out, and all is read before anything is written: the compiler
    cannot know that the arrays do not overlap, and would read the levers again for each number.
    """
    media, mass = forcing.media, forcing.mass
    for e in range(body.size):
        b, m, q = body[e], levers[e], twist[body[e]]
        if not active[b]:
            continue
        m0, m1, m2, m3, m4, m5, m6, m7, m8 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]
        u, v = m0 * q[0] + m1 * q[1] + m2 * q[2], m3 * q[0] + m4 * q[1] + m5 * q[2]
        ax = ay = jxx = jxy = jyy = f = 0.0
        if forcing.media_act:
            f = forcing.coriolis[e]
            ax, ay = f * v, -f * u
        for k in range(len(MEDIA)):
            if forcing.media_act:
                dx, dy, dxx, dxy, dyy, _ = drag_and_jacobian(media[e, k], u, v)
                ax += dx
                ay += dy
                jxx += dxx
                jxy += dxy
                jyy += dyy
        w = m6 * q[0] + m7 * q[1] + m8 * q[2]
        torque, turning = spin_torque(forcing, e, w)
        ox, oy, turned, oxx, oxy, oyy, oxw, oyw, oww = outline_force(forcing, e, m[9], m[10], u, v, w)
        fx, fy, weight = mass[e] * ax + forcing.push_x[e] + ox, mass[e] * ay + forcing.push_y[e] + oy, mass[e]
        torque, turning = torque + turned, turning + oww
        xx, yy, xy, yx = weight * jxx + oxx, weight * jyy + oyy, weight * (jxy - f) + oxy, weight * (jxy + f) + oxy
        t, s = net_force[b], jacobian[b]
        t0, t1, t2 = m0 * fx + m3 * fy + m6 * torque, m1 * fx + m4 * fy + m7 * torque, m2 * fx + m5 * fy + m8 * torque
        # (xn, yn, zn) is row n of B^T J. It takes J by columns, and J is not symmetric: f enters with both signs.
        x0, y0, z0 = xx * m0 + yx * m3 + oxw * m6, xy * m0 + yy * m3 + oyw * m6, oxw * m0 + oyw * m3 + turning * m6
        x1, y1, z1 = xx * m1 + yx * m4 + oxw * m7, xy * m1 + yy * m4 + oyw * m7, oxw * m1 + oyw * m4 + turning * m7
        x2, y2, z2 = xx * m2 + yx * m5 + oxw * m8, xy * m2 + yy * m5 + oyw * m8, oxw * m2 + oyw * m5 + turning * m8
        s00, s01, s02 = x0 * m0 + y0 * m3 + z0 * m6, x0 * m1 + y0 * m4 + z0 * m7, x0 * m2 + y0 * m5 + z0 * m8
        s10, s11, s12 = x1 * m0 + y1 * m3 + z1 * m6, x1 * m1 + y1 * m4 + z1 * m7, x1 * m2 + y1 * m5 + z1 * m8
        s20, s21, s22 = x2 * m0 + y2 * m3 + z2 * m6, x2 * m1 + y2 * m4 + z2 * m7, x2 * m2 + y2 * m5 + z2 * m8
        t[0], t[1], t[2] = t[0] + t0, t[1] + t1, t[2] + t2
        s[0, 0], s[0, 1], s[0, 2] = s[0, 0] + s00, s[0, 1] + s01, s[0, 2] + s02
        s[1, 0], s[1, 1], s[1, 2] = s[1, 0] + s10, s[1, 1] + s11, s[1, 2] + s12
        s[2, 0], s[2, 1], s[2, 2] = s[2, 0] + s20, s[2, 1] + s21, s[2, 2] + s22


class BodyWorkspace(NamedTuple):
    """Workspace of the two half kicks and of Newton's method."""

    jacobian: Floats  # Minus the derivatives of the forces; shape (fragments, 3, 3)
    net_force: Floats  # N, N, N m; shape (fragments, 3)
    residual: Floats  # Of the equation of the second half kick; shape (fragments, 3)
    increment: Floats  # Of Newton's method; shape (fragments, 3)
    last_change: Floats  # Relative size of the last increment; shape (fragments,)
    active: Booleans  # Fragments whose velocities have not converged; shape (fragments,)
    scratch: Floats  # shape (4, 3, 3)
    in_pack: Booleans  # Fragments that a pack of sea ice holds; shape (fragments,)
    direction: Floats  # Of that force on each element (`riftberg.engines.common.forces.pack`); shape (elements, 2)
    sums: Floats  # Over fragments; shape (fragments, 7)
    moments: Floats  # Of fragments, see `mean_displacement`; shape (fragments, 4)
    supported: Booleans  # Fragments with supports; shape (fragments,)


def allocate_body_workspace(count: int, elements: int = 0) -> BodyWorkspace:
    """Return a workspace for ``count`` fragments of ``elements`` elements."""
    jacobian = np.empty((count, 3, 3))
    net_force, residual, increment = np.empty((3, count, 3))
    return BodyWorkspace(
        jacobian, net_force, residual, increment, np.empty(count), np.empty(count, np.bool_),
        np.empty((4, 3, 3)), np.zeros(count, np.bool_), np.empty((elements, 2)), np.empty((count, 7)),
        np.empty((count, 4)), np.zeros(count, np.bool_),
    )  # fmt: skip


@kernel
def _is_zero(drag: Floats) -> bool:
    """Whether a drag takes nothing from a fragment: it is positive semi-definite, so its diagonal says it."""
    return bool(drag[0, 0] == 0.0 and drag[1, 1] == 0.0 and drag[2, 2] == 0.0)


@kernel
def excess_rate(rate: float, half_dt: float) -> float:
    """Rate (s-1) of the drag that is taken implicitly in a first half kick, of a drag of ``rate`` (s-1)."""
    return max(rate - EXPLICIT_PART / half_dt, 0.0)


@kernel
def excess_spin_rate(rate: float, half_dt: float) -> float:
    """`excess_rate` of the drag on spin: all of it where it takes twice `EXPLICIT_PART` in the half kick, or more."""
    return min(2.0 * excess_rate(rate, half_dt), rate)


@kernel
def medium_drag_rate(row: Floats, u: float, v: float, least: float) -> float:
    """Drag (s-1) of a medium per velocity through it, at ``least`` m s-1 or more; a hold that yields takes the true speed."""
    if row[LINEAR] == 0.0 and row[QUADRATIC] == 0.0 and row[LIMIT] == 0.0:  # most media, which need no root
        return 0.0
    speed = math.hypot(u - row[U], v - row[V])
    rate = row[LINEAR] + row[QUADRATIC] * max(speed, least)
    if row[LIMIT] > 0.0:
        rate += yield_rate(row[LIMIT], speed, row[YIELD])
    return float(rate)


@kernel
def element_drag_rate(forcing: ElementForcing, e: int, k: int, u: float, v: float, least: float) -> float:
    """`medium_drag_rate` of the ``k``-th medium at an element, with the drag of the water on the outline."""
    row = forcing.media[e, k]
    rate = medium_drag_rate(row, u, v, least)
    if k == WATER:
        rate += outline_quadratic(forcing, e) * max(math.hypot(u - row[U], v - row[V]), least)
    return float(rate)


@kernel
def is_resolved(rate: float, quadratic: float, ax: float, ay: float, half_dt: float) -> bool:
    """Whether a half step resolves drag of ``rate`` (s-1), which grows by ``quadratic`` (m-1), under an acceleration (m s-2).

    That is ``rate + sqrt(quadratic |a|) <= EXPLICIT_PART / half_dt``, without the roots.
    """
    margin = EXPLICIT_PART / half_dt - rate
    return bool(margin >= 0.0 and quadratic * quadratic * (ax * ax + ay * ay) <= margin * margin * margin * margin)


@kernel
def drag_rates(
    forcing: ElementForcing, e: int, u: float, v: float, acceleration: float, quadratic: float
) -> tuple[float, float]:
    """Drag (s-1) of all media per velocity through them in a half step from (u, v), and the least speed (m s-1) that it is for.

    ``acceleration``: by all forces, m s-2; ``quadratic``: see `is_resolved`.
    """
    least, rate = math.sqrt(acceleration / quadratic) if quadratic > 0.0 else 0.0, 0.0
    for k in range(len(MEDIA)):
        if forcing.media_act:
            rate += element_drag_rate(forcing, e, k, u, v, least)
    return rate, least


@kernel
def accumulate_excess(
    forcing: ElementForcing, e: int, velocity: tuple[float, float], change: tuple[float, float], rates: tuple[float, float],
    half_dt: float, weight: float, applied: Floats,
) -> None:  # fmt: skip
    """Add to ``applied`` the loss of excess drag of an element by the ``change`` of its velocity in a first half kick.

    Each medium takes its share, by ``rates`` (see `drag_rates`).
    """
    (rate, least), (u, v) = rates, velocity
    excess = excess_rate(rate, half_dt)
    if excess == 0.0:
        return
    for k in range(len(MEDIA)):
        if forcing.media_act:
            medium_rate = weight * excess * element_drag_rate(forcing, e, k, u, v, least) / rate
            applied[e, k, 0] -= medium_rate * change[0]
            applied[e, k, 1] -= medium_rate * change[1]


@kernel
def add_excess_drag(
    op: BodyOperators, twist: Floats, terms: ForceTerms, half_dt: float, acceleration: Floats, excess_drag: Floats,
    element_drag: Floats,
) -> None:  # fmt: skip
    """Add D of the text above to the matrices of the fragments, shape (fragments, 3, 3).

    Fill their ``acceleration``, and ``element_drag`` as `HalfKick` has it.
    """
    forcing, limit = op.forcing, EXPLICIT_PART / half_dt
    for b in range(twist.shape[0]):
        acceleration[b, 0], acceleration[b, 1], acceleration[b, 2] = times(op.matrices.mobility[b], terms.net_force[b])
    for e in range(op.body.size):
        b, m, drag = op.body[e], op.levers[e], terms.drag_rate[e]
        rate_at_start, spin_rate_at_start, quadratic = drag[0], drag[1], drag[2]
        au, av, aw = element_velocity(m, acceleration[b])
        element_drag[e, 0] = element_drag[e, 1] = 0.0
        if (
            is_resolved(rate_at_start, quadratic, au, av, half_dt)
            and spin_rate_at_start <= limit
            and forcing.spin_drag[e] * abs(aw) <= limit * limit
        ):
            continue
        u, v, _ = element_velocity(m, twist[b])
        rate, least = drag_rates(forcing, e, u, v, math.hypot(au, av), quadratic)
        element_drag[e, 0], element_drag[e, 1] = rate, least
        spin_rate = max(spin_rate_at_start, math.sqrt(forcing.spin_drag[e] * abs(aw)))
        mass, inertia = forcing.mass[e], forcing.inertia[e]
        if rate > limit:
            _add_outer(excess_drag[b], mass * (rate - limit), m[0:3], m[0:3])
            _add_outer(excess_drag[b], mass * (rate - limit), m[3:6], m[3:6])
        if spin_rate > limit:
            _add_outer(excess_drag[b], inertia * excess_spin_rate(spin_rate, half_dt), m[6:9], m[6:9])


@kernel
def accumulate_excess_drag(
    op: BodyOperators, twist: Floats, kick: HalfKick, half_dt: float, weight: float, applied: Floats
) -> None:
    """Add `accumulate_excess` of all elements by a first half kick from ``twist``."""
    for e in range(op.body.size):
        rate, least = kick.drag[e, 0], kick.drag[e, 1]
        if rate == 0.0:  # nearly all elements of a large berg
            continue
        b, m = op.body[e], op.levers[e]
        (u, v, _), (u_new, v_new, _) = element_velocity(m, twist[b]), element_velocity(m, kick.twist[b])
        accumulate_excess(op.forcing, e, (u, v), (u_new - u, v_new - v), (rate, least), half_dt, weight, applied)


@kernel
def first_half_kick(
    op: BodyOperators, twist: Floats, terms: ForceTerms, half_dt: float, kick: HalfKick, work: BodyWorkspace
) -> None:
    """Fill a first half ``kick`` from the velocities at the start, at which the forces are ``terms``."""
    matrices, net_force, excess_drag, new = op.matrices, work.net_force, work.jacobian, kick.twist
    excess_drag[:, :, :] = 0.0
    add_excess_drag(op, twist, terms, half_dt, work.increment, excess_drag, kick.drag)
    matrix, right = work.scratch[0], work.scratch[1, 0]
    for b in range(twist.shape[0]):
        resolved = _is_zero(excess_drag[b])
        drag_force = times(excess_drag[b], twist[b])
        for i in range(3):
            net_force[b, i] = terms.net_force[b, i] if resolved else terms.net_force[b, i] + drag_force[i]
        x, y, z = times(matrices.mobility[b], net_force[b])
        right[0], right[1], right[2] = twist[b, 0] + half_dt * x, twist[b, 1] + half_dt * y, twist[b, 2] + half_dt * z
        if resolved:
            new[b, 0], new[b, 1], new[b, 2] = right[0], right[1], right[2]
            continue
        multiply(matrices.mobility[b], excess_drag[b], matrix)
        for i in range(3):
            for j in range(3):
                matrix[i, j] = (1.0 if i == j else 0.0) + half_dt * matrix[i, j]
        new[b, 0], new[b, 1], new[b, 2] = solve(matrix, right)


@kernel
def subtract_corner_slopes(
    op: BodyOperators, twist: Floats, active: Booleans, direction: Floats, jacobian: Floats
) -> None:
    """Subtract from the Jacobians of active fragments the loss of the force of a pack by its limit."""
    for e in range(op.body.size):
        b, m, row = op.body[e], op.levers[e], op.forcing.media[e, SEA_ICE]
        if row[LIMIT] == 0.0 or not active[b]:
            continue
        u, v, _ = element_velocity(m, twist[b])
        factor, dx, dy = corner_slope(row, u, v)
        factor *= op.forcing.mass[e]
        for i in range(3):
            along = factor * (direction[e, 0] * m[i] + direction[e, 1] * m[3 + i])
            for j in range(3):
                jacobian[b, i, j] -= along * (dx * m[j] + dy * m[3 + j])


@kernel
def turn_directions(op: BodyOperators, twist: Floats, increment: Floats, active: Booleans, direction: Floats) -> None:
    """Take the directions of the force of a pack on active fragments on, with the ``increment`` of their velocities."""
    for e in range(op.body.size):
        b, m, row = op.body[e], op.levers[e], op.forcing.media[e, SEA_ICE]
        if row[LIMIT] > 0.0 and active[b]:
            u, v, _ = element_velocity(m, twist[b])
            du, dv, _ = element_velocity(m, increment[b])
            old_direction = direction[e, 0], direction[e, 1]
            direction[e, 0], direction[e, 1] = next_direction(row, old_direction, (u, v), (du, dv))


@kernel
def newton_increment(op: BodyOperators, middle: Floats, new: Floats, half_dt: float, work: BodyWorkspace) -> None:
    """Find the increment of Newton's method for each active fragment, from the velocities ``new``.

    ``middle`` are the velocities at mid-step.
    """
    work.net_force[:, :] = 0.0
    work.jacobian[:, :, :] = 0.0
    assemble_force_and_jacobian(op.body, op.levers, new, op.forcing, work.active, work.net_force, work.jacobian)
    if is_any(work.in_pack):
        subtract_corner_slopes(op, new, work.active, work.direction, work.jacobian)
    matrix, right = work.scratch[0], work.scratch[1, 0]
    for b in range(new.shape[0]):
        if not work.active[b]:
            continue
        # residual = q(1/2) + h/2 M^-1 G(q) - q, and minus its derivative 1 + h/2 M^-1 J.
        kicked = times(op.matrices.mobility[b], work.net_force[b])
        for i in range(3):
            work.residual[b, i] = right[i] = middle[b, i] + half_dt * kicked[i] - new[b, i]
        multiply(op.matrices.mobility[b], work.jacobian[b], matrix)
        for i in range(3):
            for j in range(3):
                matrix[i, j] = (1.0 if i == j else 0.0) + half_dt * matrix[i, j]
        work.increment[b, 0], work.increment[b, 1], work.increment[b, 2] = solve(matrix, right)


@kernel
def relative_increment(increment: Floats, new: Floats, inertia: Floats) -> float:
    """Relative change of the speeds at the rim of a fragment by an increment of its velocities."""
    # A spin counts by the speed that it gives at the radius of gyration: the spin of a berg that does not turn is round-off.
    arm = math.sqrt(inertia[2, 2] / inertia[0, 0])
    return relative_change(increment[0], increment[1], increment[2], new[0], new[1], new[2], arm)


@kernel
def relative_change(du: float, dv: float, dw: float, u: float, v: float, w: float, arm: float) -> float:
    """Return the largest of the changes of a velocity and of a spin at ``arm`` m, by the largest of both."""
    change = max(abs(du), abs(dv), arm * abs(dw))
    return float(change / max(abs(u), abs(v), arm * abs(w), VELOCITY_SCALE))


@kernel
def has_converged(change: float, previous: float) -> bool:
    """Whether Newton's method may end after a relative change, ``previous`` the one before it (0 at first)."""
    # Convergence is superlinear, so the next change is at most change (change / previous)^2: where that is
    # nothing, the iteration that would find it is spared. False at first, with nothing before it.
    return change <= NEWTON_RTOL or change**3 <= NEWTON_PREDICTED_RTOL * previous**2


@borrower
def half_kick_newton(op: BodyOperators, middle: Floats, new: Floats, half_dt: float, work: BodyWorkspace) -> int:
    """Second half kick: velocities ``new`` at the end from those at mid-step, by Newton's method from a first guess.

    Only ``work.active`` fragments take part. Each goes its own number of iterations, so its result does not depend, to
    the last digit, on which others there are. Returns the most iterations, -1 where they do not converge.
    """
    active, last_change = work.active, work.last_change
    last_change[:] = 0.0
    find_fragments_in_pack(op.body, op.forcing.media, work.in_pack)
    any_in_pack = is_any(work.in_pack)
    if any_in_pack:
        work.direction[:, :] = 0.0
    for n in range(MAX_ITERATIONS):
        newton_increment(op, middle, new, half_dt, work)
        if any_in_pack:
            turn_directions(op, new, work.increment, active, work.direction)
        is_unfinished = False
        for b in range(new.shape[0]):
            if not active[b]:
                continue
            for i in range(3):
                new[b, i] += work.increment[b, i]
            previous, change = last_change[b], relative_increment(work.increment[b], new[b], op.matrices.inertia[b])
            # Beside a corner one small change tells nothing of the next.
            last_change[b] = 0.0 if work.in_pack[b] else change
            converged = has_converged(change, previous)
            # Velocities that are not numbers end the iteration; the checks of loads and places then say where they came from.
            active[b] = not converged and np.isfinite(new[b, 0] + new[b, 1] + new[b, 2])
            is_unfinished = is_unfinished or active[b]
        if not is_unfinished:
            return n + 1
    return -1


def check_converged(iterations: int) -> None:
    """Refuse velocities that have not converged."""
    if iterations < 0:
        raise RunError(f"the velocities of the fragments did not converge within {MAX_ITERATIONS} passes")
