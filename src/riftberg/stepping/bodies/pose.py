"""Rigid frames: how the elements of a fragment sit in it, on a sphere or a plane, and how it moves as one.

A rigid motion on a sphere is a rotation of the sphere, so a fragment is placed there by one rotation matrix: great-circle
distances between its elements stay what they are, for ever and at any latitude, the pole included. On a plane the frame
is the matrix of a turn and a shift. In both cases three numbers tell the motion: eastward and northward velocity of the
centre of mass and the spin about the vertical through it.

The axes of an element within its fragment are those of the centre, carried along the great circle to the element
(parallel transport); on a plane they are those of the fragment.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.physics.geometry import nearest_image
from riftberg.state import Floats, Ints


class Bodies(NamedTuple):
    """All fragments as bodies; what a step with rigid bodies needs beside the state."""

    body: Ints  # Fragment of each element, 0, 1, ; shape (elements,)
    # Place of each element in the frame of its fragment without load: a unit vector on a sphere, (x, y, 0) in metres on
    # a plane. The centre of mass stands at (0, 0, 1) or (0, 0); shape (elements, 3)
    shape: Floats
    # Frame of each fragment: rotation matrix on a sphere; on a plane the columns are both axes and the centre (m);
    # shape (fragments, 3, 3)
    pose: Floats
    # Velocity of the centre east and north (m s-1), and spin (rad s-1, counter-clockwise); shape (fragments, 3)
    rate: Floats
    # Displacement of each element by its load along the axes of the fragment (m), and its turn (rad); shape (elements,
    # 3)
    bend: Floats


@kernel
def unit_vector(lon: float, lat: float) -> tuple[float, float, float]:
    """Unit vector from the centre of the sphere to a point in degrees."""
    a, b = lon * DEGREE, lat * DEGREE
    return math.cos(b) * math.cos(a), math.cos(b) * math.sin(a), math.sin(b)


@kernel
def axes_at(r: Floats) -> tuple[float, float, float, float, float]:
    """East (ex, ey, 0) and north (nx, ny, nz) at a unit vector, as (ex, ey, nx, ny, nz); at the pole those of longitude 0."""
    return axes_at_point(r[0], r[1], r[2])


@kernel
def axes_at_point(x: float, y: float, z: float) -> tuple[float, float, float, float, float]:
    """See `axes_at`."""
    across = math.sqrt(x * x + y * y)
    c, s = (x / across, y / across) if across > 0.0 else (1.0, 0.0)
    return -s, c, -c * z, -s * z, across


@kernel
def _turned(q: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of a frame, in the axes that the frame is given in."""
    return (
        q[0, 0] * x + q[0, 1] * y + q[0, 2] * z,
        q[1, 0] * x + q[1, 1] * y + q[1, 2] * z,
        q[2, 0] * x + q[2, 1] * y + q[2, 2] * z,
    )


@kernel
def transported(shape: Floats) -> tuple[float, float, float, float, float, float]:
    """Axes of the frame at the pole carried along the great circle to a unit vector of the frame."""
    x, y, z = shape[0], shape[1], shape[2]
    k = 1.0 / (1.0 + z)
    return 1.0 - x * x * k, -x * y * k, -x, -x * y * k, 1.0 - y * y * k, -y


@kernel
def flat_shape(shape: Floats, latlon: bool, radius: float) -> Floats:
    """Places on the plane that touches the sphere at the centre (stereographic, so that angles hold), m, shape (n, 2)."""
    flat = np.empty((shape.shape[0], 2))
    for e in range(shape.shape[0]):
        k = 2.0 * radius / (1.0 + shape[e, 2]) if latlon else 1.0
        flat[e, 0], flat[e, 1] = k * shape[e, 0], k * shape[e, 1]
    return flat


@kernel
def element_motion(bodies: Bodies, latlon: bool, radius: float) -> Floats:
    """How each element moves with its fragment, and how its own axes lie in it.

    Returns columns 0 to 2 and 3 to 5: eastward and northward velocity of the element by those of the centre and the
    spin.
    """
    motion = np.empty((bodies.body.size, 11))
    find_element_motion(bodies, latlon, radius, motion)
    return motion


@kernel
def find_element_motion(bodies: Bodies, latlon: bool, radius: float, motion: Floats) -> None:
    """Fill what `element_motion` returns."""
    body, shape, pose = bodies.body, bodies.shape, bodies.pose
    for e in range(body.size):
        q, m = pose[body[e]], motion[e]
        if not latlon:
            rx = q[0, 0] * shape[e, 0] + q[0, 1] * shape[e, 1]
            ry = q[1, 0] * shape[e, 0] + q[1, 1] * shape[e, 1]
            m[:] = 0.0
            m[0], m[2], m[4], m[5], m[8], m[9], m[10] = 1.0, -ry, 1.0, rx, 1.0, q[0, 0], q[1, 0]
            continue
        ax, ay, az, _, _, _ = transported(shape[e])
        x, y, z = _turned(q, shape[e, 0], shape[e, 1], shape[e, 2])
        ux, uy, uz = _turned(q, ax, ay, az)
        ex, ey, nx, ny, nz = axes_at_point(x, y, z)
        cex, cey, cnx, cny, cnz = axes_at(q[:, 2])
        m[0] = cnx * nx + cny * ny + cnz * nz
        m[1] = -(cex * nx + cey * ny)
        m[2] = radius * (q[0, 2] * nx + q[1, 2] * ny + q[2, 2] * nz)
        m[3] = -(cnx * ex + cny * ey)
        m[4] = cex * ex + cey * ey
        m[5] = -radius * (q[0, 2] * ex + q[1, 2] * ey)
        m[6] = (cnx * x + cny * y + cnz * z) / radius
        m[7] = -(cex * x + cey * y) / radius
        m[8] = q[0, 2] * x + q[1, 2] * y + q[2, 2] * z
        m[9] = ex * ux + ey * uy
        m[10] = nx * ux + ny * uy + nz * uz


@kernel
def _turn_about(q: Floats, x: float, y: float, z: float) -> None:
    """Turn a frame by a rotation vector (rad), in place (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return
    a, b = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    for k in range(3):
        v0, v1, v2 = q[0, k], q[1, k], q[2, k]
        c0, c1, c2 = y * v2 - z * v1, z * v0 - x * v2, x * v1 - y * v0
        q[0, k] = v0 + a * c0 + b * (y * c2 - z * c1)
        q[1, k] = v1 + a * c1 + b * (z * c0 - x * c2)
        q[2, k] = v2 + a * c2 + b * (x * c1 - y * c0)


@kernel
def _make_square(q: Floats) -> None:
    """Make the columns of a frame orthogonal unit vectors again, in place; the last one keeps its direction."""
    for k in (2, 0):
        if k == 0:
            dot = q[0, 0] * q[0, 2] + q[1, 0] * q[1, 2] + q[2, 0] * q[2, 2]
            for i in range(3):
                q[i, 0] -= dot * q[i, 2]
        size = math.sqrt(q[0, k] ** 2 + q[1, k] ** 2 + q[2, k] ** 2)
        for i in range(3):
            q[i, k] /= size
    q[0, 1] = q[1, 2] * q[2, 0] - q[2, 2] * q[1, 0]
    q[1, 1] = q[2, 2] * q[0, 0] - q[0, 2] * q[2, 0]
    q[2, 1] = q[0, 2] * q[1, 0] - q[1, 2] * q[0, 0]


@kernel
def _turn_by_rate(q: Floats, along: Floats, rate: Floats, dt: float, radius: float) -> None:
    """Turn a frame over ``dt`` s by the motion of a centre that stands at the unit vector ``along``."""
    ex, ey, nx, ny, nz = axes_at(along)
    u, v = rate[0] / radius, rate[1] / radius
    _turn_about(
        q,
        dt * (u * nx - v * ex + rate[2] * along[0]),
        dt * (u * ny - v * ey + rate[2] * along[1]),
        dt * (u * nz + rate[2] * along[2]),
    )


@kernel
def moved_frames(pose: Floats, rate: Floats, dt: float, latlon: bool, radius: float) -> Floats:
    """Frames after ``dt`` s of steady eastward and northward velocity and spin; of second order on a sphere."""
    new = np.empty(pose.shape)
    move_frames(pose, rate, dt, latlon, radius, new, np.empty((3, 3)))
    return new


@kernel
def move_frames(
    pose: Floats, rate: Floats, dt: float, latlon: bool, radius: float, new: Floats, middle: Floats
) -> None:
    """Fill what `moved_frames` returns; ``middle`` is room for a frame."""
    for k in range(pose.shape[0]):
        for i in range(3):
            for j in range(3):
                new[k, i, j] = middle[i, j] = pose[k, i, j]
        if latlon:
            _turn_by_rate(middle, pose[k, :, 2], rate[k], 0.5 * dt, radius)
            _turn_by_rate(new[k], middle[:, 2], rate[k], dt, radius)
            _make_square(new[k])
            continue
        c, s = math.cos(dt * rate[k, 2]), math.sin(dt * rate[k, 2])
        size = math.sqrt(pose[k, 0, 0] ** 2 + pose[k, 1, 0] ** 2)
        x, y = pose[k, 0, 0] / size, pose[k, 1, 0] / size
        new[k, 0, 0], new[k, 1, 0] = c * x - s * y, s * x + c * y
        new[k, 0, 1], new[k, 1, 1] = -new[k, 1, 0], new[k, 0, 0]
        new[k, 0, 2] += dt * rate[k, 0]
        new[k, 1, 2] += dt * rate[k, 1]


@kernel
def place(bodies: Bodies, lon: Floats, lat: Floats, static: Floats, latlon: bool, radius: float, period: float) -> None:
    """Set the positions of the elements: their place in the frame and their displacement by load.

    Longitudes stay on the branch that they are on; elements that never move stay where they are.
    """
    body, shape, pose, bend = bodies.body, bodies.shape, bodies.pose, bodies.bend
    for e in range(body.size):
        if static[e] >= 0.5:
            continue
        q = pose[body[e]]
        if not latlon:
            x, y = shape[e, 0] + bend[e, 0], shape[e, 1] + bend[e, 1]
            there = q[0, 2] + q[0, 0] * x + q[0, 1] * y
            lon[e] += nearest_image(there - lon[e], period)
            lat[e] = q[1, 2] + q[1, 0] * x + q[1, 1] * y
            continue
        ax, ay, az, bx, by, bz = transported(shape[e])
        da, db = bend[e, 0] / radius, bend[e, 1] / radius
        x, y, z = shape[e, 0] + da * ax + db * bx, shape[e, 1] + da * ay + db * by, shape[e, 2] + da * az + db * bz
        rx = q[0, 0] * x + q[0, 1] * y + q[0, 2] * z
        ry = q[1, 0] * x + q[1, 1] * y + q[1, 2] * z
        rz = q[2, 0] * x + q[2, 1] * y + q[2, 2] * z
        there = math.atan2(ry, rx) / DEGREE
        lon[e] += nearest_image(there - lon[e], 360.0)
        lat[e] = math.atan2(rz, math.sqrt(rx * rx + ry * ry)) / DEGREE


@kernel
def _centred_frame(x: float, y: float, z: float) -> Floats:
    """Frame whose last axis is the direction (x, y, z) and whose first lies towards the first axis at hand."""
    q = np.zeros((3, 3))
    q[0, 2], q[1, 2], q[2, 2] = x, y, z
    q[0, 0] = 1.0
    _make_square(q)
    return q


def regrouped(bodies: Bodies, body: Ints, mass: Floats, inertia: Floats, latlon: bool, radius: float) -> Bodies:
    """Give the pieces of fragments that have parted frames of their own; nothing moves.

    A piece takes over the mean displacement and turn that its load had given it, and the velocity that its centre had.

    ``body``: the new number of the fragment of each element (shape (elements,)); ``mass``, ``inertia``: kg and kg m2
    (shape (elements,)).
    """
    return Bodies(*_regrouped(bodies, body, mass, inertia, latlon, radius))


@kernel
def _regrouped(
    bodies: Bodies, body: Ints, mass: Floats, inertia: Floats, latlon: bool, radius: float
) -> tuple[Ints, Floats, Floats, Floats, Floats]:
    """Return the fields of `Bodies`; see `riftberg.compiled.kernels` why no named tuple."""
    count = body.max() + 1
    shape, bend = bodies.shape.copy(), bodies.bend.copy()
    pose, rate = np.zeros((count, 3, 3)), np.zeros((count, 3))
    total, centre, old = np.zeros(count), np.zeros((count, 3)), np.full(count, -1, np.int64)
    for e in range(body.size):
        b = body[e]
        total[b] += mass[e]
        old[b] = bodies.body[e]
        for i in range(3):
            centre[b, i] += mass[e] * bodies.shape[e, i]
    for b in range(count):
        q, c = bodies.pose[old[b]], centre[b] / total[b]
        r0 = bodies.rate[old[b]]
        if not latlon:
            pose[b] = q
            dx, dy = q[0, 0] * c[0] + q[0, 1] * c[1], q[1, 0] * c[0] + q[1, 1] * c[1]
            pose[b, 0, 2], pose[b, 1, 2] = q[0, 2] + dx, q[1, 2] + dy
            rate[b, 0], rate[b, 1], rate[b, 2] = r0[0] - r0[2] * dy, r0[1] + r0[2] * dx, r0[2]
            centre[b] = c
            continue
        size = math.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)
        centre[b] = c / size
        pose[b] = _product(q, _centred_frame(c[0] / size, c[1] / size, c[2] / size))
        _carry_rate(q[:, 2], pose[b, :, 2], r0, rate[b], radius)
    for e in range(body.size):
        b = body[e]
        if not latlon:
            shape[e] = bodies.shape[e] - centre[b]
            continue
        to = _centred_frame(centre[b, 0], centre[b, 1], centre[b, 2])
        for i in range(3):
            shape[e, i] = to[0, i] * bodies.shape[e, 0] + to[1, i] * bodies.shape[e, 1] + to[2, i] * bodies.shape[e, 2]
        _turn_axes(bodies.shape[e], shape[e], to, bend[e])
    new = Bodies(body, shape, pose, rate, bend)
    _take_over_mean(new, mass, inertia, latlon, radius)
    return new.body, new.shape, new.pose, new.rate, new.bend


@kernel
def _product(a: Floats, b: Floats) -> Floats:
    """Product of two 3 by 3 matrices, in a fixed order of sums."""
    c = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return c


@kernel
def _carry_rate(there: Floats, here: Floats, rate: Floats, new: Floats, radius: float) -> None:
    """Velocity and spin at another centre of the same rigid motion."""
    ex, ey, nx, ny, nz = axes_at(there)
    fx, fy, mx, my, mz = axes_at(here)
    u, v = rate[0] / radius, rate[1] / radius
    x = u * nx - v * ex + rate[2] * there[0]
    y = u * ny - v * ey + rate[2] * there[1]
    z = u * nz + rate[2] * there[2]
    new[0] = radius * (x * mx + y * my + z * mz)
    new[1] = -radius * (x * fx + y * fy)
    new[2] = x * here[0] + y * here[1] + z * here[2]


@kernel
def _turn_axes(before: Floats, after: Floats, to: Floats, bend: Floats) -> None:
    """Give a displacement along the transported axes of one frame along those of another, in place."""
    ax, ay, az, bx, by, bz = transported(before)
    cx, cy, cz, dx, dy, dz = transported(after)
    x, y, z = bend[0] * ax + bend[1] * bx, bend[0] * ay + bend[1] * by, bend[0] * az + bend[1] * bz
    p = to[0, 0] * x + to[1, 0] * y + to[2, 0] * z
    q = to[0, 1] * x + to[1, 1] * y + to[2, 1] * z
    r = to[0, 2] * x + to[1, 2] * y + to[2, 2] * z
    bend[0], bend[1] = p * cx + q * cy + r * cz, p * dx + q * dy + r * dz


@kernel
def mean_bend(
    body: Ints, flat: Floats, bend: Floats, mass: Floats, inertia: Floats, mean: Floats, first: Floats
) -> None:
    """Find the mean displacement (m) and turn (rad) of each fragment by the load of its elements.

    ``body``: fragment of each element (shape (elements,)); ``flat``: places in the fragments (`flat_shape`), m (shape
    (elements, 2)); ``bend``: displacements, m, m and rad (shape (elements, 3)); ``mass``, ``inertia``: kg and kg m2
    (shape (elements,)); ``mean``: takes them (shape (fragments, 3)); ``first``: takes the centre of mass (m), the mass
    (kg) and the moment of inertia (kg m2) (shape (fragments, 4)).
    """
    mean[:, :] = 0.0
    first[:, :] = 0.0
    for e in range(body.size):
        b = body[e]
        first[b, 2] += mass[e]
        for i in range(2):
            mean[b, i] += mass[e] * bend[e, i]
            first[b, i] += mass[e] * flat[e, i]
    for b in range(mean.shape[0]):
        for i in range(2):
            mean[b, i] /= first[b, 2]
            first[b, i] /= first[b, 2]
    for e in range(body.size):
        b = body[e]
        x, y = flat[e, 0] - first[b, 0], flat[e, 1] - first[b, 1]
        first[b, 3] += mass[e] * (x * x + y * y) + inertia[e]
        mean[b, 2] += mass[e] * (x * bend[e, 1] - y * bend[e, 0]) + inertia[e] * bend[e, 2]
    for b in range(mean.shape[0]):
        mean[b, 2] /= first[b, 3]


@kernel
def without_mean(body: Ints, flat: Floats, bend: Floats, mean: Floats, first: Floats) -> None:
    """Take the mean displacement and turn (`mean_bend`) off, in place: what is left is deformation alone."""
    for e in range(body.size):
        b = body[e]
        x, y = flat[e, 0] - first[b, 0], flat[e, 1] - first[b, 1]
        bend[e, 0] -= mean[b, 0] - mean[b, 2] * y
        bend[e, 1] -= mean[b, 1] + mean[b, 2] * x
        bend[e, 2] -= mean[b, 2]


@kernel
def _take_over_mean(bodies: Bodies, mass: Floats, inertia: Floats, latlon: bool, radius: float) -> None:
    """Move the frames by the mean displacement and turn of their elements, and take those off the elements."""
    flat = flat_shape(bodies.shape, latlon, radius)
    mean, first = np.empty((bodies.pose.shape[0], 3)), np.empty((bodies.pose.shape[0], 4))
    mean_bend(bodies.body, flat, bodies.bend, mass, inertia, mean, first)
    without_mean(bodies.body, flat, bodies.bend, mean, first)
    for b in range(mean.shape[0]):
        q, dx, dy, turn = bodies.pose[b], mean[b, 0], mean[b, 1], mean[b, 2]
        if latlon:
            x, y = -dy / radius, dx / radius
            _turn_about(
                q,
                q[0, 0] * x + q[0, 1] * y + q[0, 2] * turn,
                q[1, 0] * x + q[1, 1] * y + q[1, 2] * turn,
                q[2, 0] * x + q[2, 1] * y + q[2, 2] * turn,
            )
            _make_square(q)
            continue
        q[0, 2] += q[0, 0] * dx + q[0, 1] * dy
        q[1, 2] += q[1, 0] * dx + q[1, 1] * dy
        c, s = math.cos(turn), math.sin(turn)
        x, y = q[0, 0], q[1, 0]
        q[0, 0], q[1, 0] = c * x - s * y, s * x + c * y
        q[0, 1], q[1, 1] = -q[1, 0], q[0, 0]


def free_bodies(
    lon: Floats, lat: Floats, body: Ints, mass: Floats, latlon: bool, radius: float, period: float
) -> Bodies:
    """Make bodies of elements that stand free of load: first axis east, second north, at the centre of mass.

    ``lon``, ``lat``: degrees or m (shape (elements,)); ``body``: fragment of each element, 0, 1,  (shape (elements,));
    ``mass``: kg (shape (elements,)).
    """
    return Bodies(*_gathered(lon, lat, body, mass, latlon, radius, period))


@kernel
def _gathered(
    lon: Floats, lat: Floats, body: Ints, mass: Floats, latlon: bool, radius: float, period: float
) -> tuple[Ints, Floats, Floats, Floats, Floats]:
    """Return the fields of `Bodies`; see `riftberg.compiled.kernels` why no named tuple."""
    count = body.max() + 1
    shape, pose, total = np.zeros((body.size, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    first = np.full(count, -1, np.int64)
    for e in range(body.size):
        b = body[e]
        if first[b] < 0:
            first[b] = e
        if latlon:
            shape[e, 0], shape[e, 1], shape[e, 2] = unit_vector(lon[e], lat[e])
        else:
            shape[e, 0], shape[e, 1] = lon[first[b]] + nearest_image(lon[e] - lon[first[b]], period), lat[e]
        total[b] += mass[e]
        for i in range(3):
            pose[b, i, 2] += mass[e] * shape[e, i]
    for b in range(count):
        for i in range(3):
            pose[b, i, 2] /= total[b]
        if latlon:
            size = math.sqrt(pose[b, 0, 2] ** 2 + pose[b, 1, 2] ** 2 + pose[b, 2, 2] ** 2)
            for i in range(3):
                pose[b, i, 2] /= size
            pose[b, 0, 0], pose[b, 1, 0], _, _, _ = axes_at(pose[b, :, 2])
            _make_square(pose[b])
        else:
            pose[b, 0, 0] = pose[b, 1, 1] = 1.0
    for e in range(body.size):
        q, x, y, z = pose[body[e]], shape[e, 0], shape[e, 1], shape[e, 2]
        if latlon:
            for i in range(3):
                shape[e, i] = q[0, i] * x + q[1, i] * y + q[2, i] * z
        else:
            shape[e, 0], shape[e, 1] = x - q[0, 2], y - q[1, 2]
    return (body, shape, pose, np.zeros((count, 3)), np.zeros((body.size, 3)))
