"""Pose of a fragment: where its elements lie in it, on a sphere or a plane, and how it moves as one.

A rigid motion on a sphere is a rotation of the sphere, so the pose of a fragment is one rotation matrix: great-circle
distances between its elements never change, at any latitude, the pole included. On a plane the pose is the matrix of a
rotation and a translation. In both cases the motion is a twist of three numbers: eastward and northward velocity of the
centre of mass and the spin about the vertical through it.

The axes of an element within its fragment are the axes of the centre, carried along the great circle to the element
(parallel transport); on a plane they are the axes of the fragment.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.constants import DEGREE
from riftberg.physics.elementary import atan2, cos, sin
from riftberg.physics.geometry import multiply, nearest_image
from riftberg.state import Floats, Ints


class Bodies(NamedTuple):
    """All fragments as bodies: the variables of a step with rigid bodies beside the state."""

    body: Ints  # Fragment of each element: 0, 1, ...; shape (elements,)
    # Coordinates of each element in its fragment without load: a unit vector on a sphere, (x, y, 0) in metres on a plane.
    # The centre of mass is at (0, 0, 1) or (0, 0, 0).
    reference: Floats  # shape (elements, 3)
    # A rotation matrix on a sphere; on a plane the columns are both axes and the centre (m).
    pose: Floats  # shape (fragments, 3, 3)
    twist: (
        Floats  # Velocity of the centre, east and north (m s-1), and spin (rad s-1, counter-clockwise); (fragments, 3)
    )
    displacement: Floats  # By load, along the axes of the fragment (m), and the rotation (rad); shape (elements, 3)


@kernel
def unit_vector(lon: float, lat: float) -> tuple[float, float, float]:
    """Unit vector from the centre of the sphere to a point in degrees."""
    a, b = lon * DEGREE, lat * DEGREE
    return cos(b) * cos(a), cos(b) * sin(a), sin(b)


@kernel
def local_axes(r: Floats) -> tuple[float, float, float, float, float]:
    """East (ex, ey, 0) and north (nx, ny, nz) at a unit vector, as (ex, ey, nx, ny, nz); at the pole as at longitude 0."""
    return local_axes_from_components(r[0], r[1], r[2])


@kernel
def local_axes_from_components(x: float, y: float, z: float) -> tuple[float, float, float, float, float]:
    """See `local_axes`."""
    across = math.sqrt(x * x + y * y)
    c, s = (x / across, y / across) if across > 0.0 else (1.0, 0.0)
    return -s, c, -c * z, -s * z, across


@kernel
def _rotate_vector(q: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """``q (x, y, z)``: a vector of a frame in the axes that the frame is given in."""
    return (
        q[0, 0] * x + q[0, 1] * y + q[0, 2] * z,
        q[1, 0] * x + q[1, 1] * y + q[1, 2] * z,
        q[2, 0] * x + q[2, 1] * y + q[2, 2] * z,
    )


@kernel
def parallel_transport(reference: Floats) -> tuple[float, float, float, float, float, float]:
    """Both axes at the centre (0, 0, 1), carried along the great circle to a unit vector of the frame."""
    x, y, z = reference[0], reference[1], reference[2]
    k = 1.0 / (1.0 + z)
    return 1.0 - x * x * k, -x * y * k, -x, -x * y * k, 1.0 - y * y * k, -y


@kernel
def tangent_coordinates(reference: Floats, latlon: bool, radius: float) -> Floats:
    """Coordinates on the plane tangent to the sphere at the centre (stereographic: angles are kept), m, shape (n, 2)."""
    xy = np.empty((reference.shape[0], 2))
    for e in range(reference.shape[0]):
        k = 2.0 * radius / (1.0 + reference[e, 2]) if latlon else 1.0
        xy[e, 0], xy[e, 1] = k * reference[e, 0], k * reference[e, 1]
    return xy


@borrower
def fill_levers(bodies: Bodies, latlon: bool, radius: float, levers: Floats) -> None:
    """Find how each element moves with its fragment, and how its axes lie; ``levers`` has shape (elements, 11).

    Columns, read by number in all kernels of rigid bodies:

        0  1  2   eastward velocity of the element by the twist of its fragment: u    = m0 q0 + m1 q1 + m2 q2
        3  4  5   northward velocity:                                            v    = m3 q0 + m4 q1 + m5 q2
        6  7  8   spin about its own vertical:                                   spin = m6 q0 + m7 q1 + m8 q2
        9  10     cosine and sine of the angle of its axis in the fragment, from local east
    """
    body, reference, pose = bodies.body, bodies.reference, bodies.pose
    for e in range(body.size):
        q, m = pose[body[e]], levers[e]
        if not latlon:
            rx = q[0, 0] * reference[e, 0] + q[0, 1] * reference[e, 1]
            ry = q[1, 0] * reference[e, 0] + q[1, 1] * reference[e, 1]
            m[:] = 0.0
            m[0], m[2], m[4], m[5], m[8], m[9], m[10] = 1.0, -ry, 1.0, rx, 1.0, q[0, 0], q[1, 0]
            continue
        ax, ay, az, _, _, _ = parallel_transport(reference[e])
        x, y, z = _rotate_vector(q, reference[e, 0], reference[e, 1], reference[e, 2])
        ux, uy, uz = _rotate_vector(q, ax, ay, az)
        ex, ey, nx, ny, nz = local_axes_from_components(x, y, z)
        cex, cey, cnx, cny, cnz = local_axes(q[:, 2])
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
def _rotate_about(q: Floats, x: float, y: float, z: float) -> None:
    """Rotate a frame by a rotation vector (rad), in place (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return
    a, b = sin(angle) / angle, 2.0 * (sin(0.5 * angle) / angle) ** 2
    for k in range(3):
        v0, v1, v2 = q[0, k], q[1, k], q[2, k]
        c0, c1, c2 = y * v2 - z * v1, z * v0 - x * v2, x * v1 - y * v0
        q[0, k] = v0 + a * c0 + b * (y * c2 - z * c1)
        q[1, k] = v1 + a * c1 + b * (z * c0 - x * c2)
        q[2, k] = v2 + a * c2 + b * (x * c1 - y * c0)


@kernel
def _orthonormalise(q: Floats) -> None:
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
def _shift(q: Floats, along: Floats, u: float, v: float, dt: float, radius: float) -> None:
    """Move a frame over ``dt`` s along a great circle, with the velocity (m s-1) east and north at the unit vector ``along``."""
    ex, ey, nx, ny, nz = local_axes(along)
    u, v = dt * u / radius, dt * v / radius
    _rotate_about(q, u * nx - v * ex, u * ny - v * ey, u * nz)


@kernel
def _spin(q: Floats, angle: float) -> None:
    """Turn a frame about its own vertical."""
    _rotate_about(q, angle * q[0, 2], angle * q[1, 2], angle * q[2, 2])


@borrower
def move_poses(
    pose: Floats, twist: Floats, dt: float, latlon: bool, radius: float, new: Floats, midpoint: Floats
) -> None:
    """Find the poses after ``dt`` s of steady twist; ``midpoint`` is room for one pose.

    On a sphere by the midpoint rule, of second order: east and north are taken at the pose half a step on. Half of the
    spin comes before and half behind: turned while it moves, a berg that spins would go along an arc.
    """
    for k in range(pose.shape[0]):
        for i in range(3):
            for j in range(3):
                new[k, i, j] = midpoint[i, j] = pose[k, i, j]
        if latlon:
            _shift(midpoint, pose[k, :, 2], twist[k, 0], twist[k, 1], 0.5 * dt, radius)
            _spin(new[k], 0.5 * dt * twist[k, 2])
            _shift(new[k], midpoint[:, 2], twist[k, 0], twist[k, 1], dt, radius)
            _spin(new[k], 0.5 * dt * twist[k, 2])
            _orthonormalise(new[k])
            continue
        c, s = cos(dt * twist[k, 2]), sin(dt * twist[k, 2])
        size = math.sqrt(pose[k, 0, 0] ** 2 + pose[k, 1, 0] ** 2)
        x, y = pose[k, 0, 0] / size, pose[k, 1, 0] / size
        new[k, 0, 0], new[k, 1, 0] = c * x - s * y, s * x + c * y
        new[k, 0, 1], new[k, 1, 1] = -new[k, 1, 0], new[k, 0, 0]
        new[k, 0, 2] += dt * twist[k, 0]
        new[k, 1, 2] += dt * twist[k, 1]


@borrower
def place_elements(
    bodies: Bodies, lon: Floats, lat: Floats, static: Floats, latlon: bool, radius: float, period: float
) -> None:
    """Set the positions of the elements from pose, reference coordinates and displacement.

    Longitudes stay on their branch; elements that never move stay where they are.
    """
    body, reference, pose, displacement = bodies.body, bodies.reference, bodies.pose, bodies.displacement
    for e in range(body.size):
        if static[e] >= 0.5:
            continue
        q = pose[body[e]]
        if not latlon:
            x, y = reference[e, 0] + displacement[e, 0], reference[e, 1] + displacement[e, 1]
            new_lon = q[0, 2] + q[0, 0] * x + q[0, 1] * y
            lon[e] += nearest_image(new_lon - lon[e], period)
            lat[e] = q[1, 2] + q[1, 0] * x + q[1, 1] * y
            continue
        ax, ay, az, bx, by, bz = parallel_transport(reference[e])
        da, db = displacement[e, 0] / radius, displacement[e, 1] / radius
        x, y, z = (
            reference[e, 0] + da * ax + db * bx,
            reference[e, 1] + da * ay + db * by,
            reference[e, 2] + da * az + db * bz,
        )
        rx = q[0, 0] * x + q[0, 1] * y + q[0, 2] * z
        ry = q[1, 0] * x + q[1, 1] * y + q[1, 2] * z
        rz = q[2, 0] * x + q[2, 1] * y + q[2, 2] * z
        new_lon = atan2(ry, rx) / DEGREE
        lon[e] += nearest_image(new_lon - lon[e], 360.0)
        lat[e] = atan2(rz, math.sqrt(rx * rx + ry * ry)) / DEGREE


@kernel
def _make_frame(x: float, y: float, z: float) -> Floats:
    """Frame at the unit vector (x, y, z) of an old frame: its axes, carried there along the great circle."""
    k = 1.0 / (1.0 + z)
    return np.array([[1.0 - x * x * k, -x * y * k, x], [-x * y * k, 1.0 - y * y * k, y], [-x, -y, z]])


def split_bodies(bodies: Bodies, body: Ints, mass: Floats, latlon: bool, radius: float) -> Bodies:
    """Make a body of each piece of fragments that have parted; nothing moves.

    A piece takes the pose of its ice in the unloaded fragment, so the faces of a crack lie on each other however soft the
    ice is; its shift by load stays in the displacements of its elements. Its twist is taken at its centre. ``body``: new
    fragment of each element; ``mass``: of the elements, kg.
    """
    return Bodies(*_split_bodies(bodies, body, mass, latlon, radius))


@kernel
def _count_fragments(body: Ints) -> int:
    """How many fragments there are: one more than the largest of their numbers."""
    count = 0
    for b in body:
        count = max(count, b + 1)
    return count


@kernel
def _split_bodies(
    bodies: Bodies, body: Ints, mass: Floats, latlon: bool, radius: float
) -> tuple[Ints, Floats, Floats, Floats, Floats]:
    """Return the fields of `Bodies` (no named tuple: see `riftberg.compiled.kernels`)."""
    count = _count_fragments(body)
    reference, displacement = bodies.reference.copy(), bodies.displacement.copy()
    pose, twist = np.zeros((count, 3, 3)), np.zeros((count, 3))
    total, centre, old = np.zeros(count), np.zeros((count, 3)), np.full(count, -1, np.int64)
    for e in range(body.size):
        b = body[e]
        total[b] += mass[e]
        old[b] = bodies.body[e]
        for i in range(3):
            centre[b, i] += mass[e] * bodies.reference[e, i]
    for b in range(count):
        q = bodies.pose[old[b]]
        c = centre[b, 0] / total[b], centre[b, 1] / total[b], centre[b, 2] / total[b]
        r0 = bodies.twist[old[b]]
        if not latlon:
            for i in range(3):
                centre[b, i] = c[i]
                for k in range(3):
                    pose[b, i, k] = q[i, k]
            dx, dy = q[0, 0] * c[0] + q[0, 1] * c[1], q[1, 0] * c[0] + q[1, 1] * c[1]
            pose[b, 0, 2], pose[b, 1, 2] = q[0, 2] + dx, q[1, 2] + dy
            twist[b, 0], twist[b, 1], twist[b, 2] = r0[0] - r0[2] * dy, r0[1] + r0[2] * dx, r0[2]
            continue
        size = math.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)
        for i in range(3):
            centre[b, i] = c[i] / size
        multiply(q, _make_frame(c[0] / size, c[1] / size, c[2] / size), pose[b])
        _transfer_twist(q[:, 2], pose[b, :, 2], r0, twist[b], radius)
    for e in range(body.size):
        b = body[e]
        if not latlon:
            for i in range(3):
                reference[e, i] = bodies.reference[e, i] - centre[b, i]
            continue
        frame = _make_frame(centre[b, 0], centre[b, 1], centre[b, 2])
        for i in range(3):
            reference[e, i] = (
                frame[0, i] * bodies.reference[e, 0]
                + frame[1, i] * bodies.reference[e, 1]
                + frame[2, i] * bodies.reference[e, 2]
            )
        _change_axes(bodies.reference[e], reference[e], frame, displacement[e])
    return body, reference, pose, twist, displacement


@kernel
def _transfer_twist(old_centre: Floats, new_centre: Floats, twist: Floats, new: Floats, radius: float) -> None:
    """Twist of the same rigid motion about another centre: from ``old_centre`` to ``new_centre``."""
    ex, ey, nx, ny, nz = local_axes(old_centre)
    fx, fy, mx, my, mz = local_axes(new_centre)
    u, v = twist[0] / radius, twist[1] / radius
    x = u * nx - v * ex + twist[2] * old_centre[0]
    y = u * ny - v * ey + twist[2] * old_centre[1]
    z = u * nz + twist[2] * old_centre[2]
    new[0] = radius * (x * mx + y * my + z * mz)
    new[1] = -radius * (x * fx + y * fy)
    new[2] = x * new_centre[0] + y * new_centre[1] + z * new_centre[2]


@kernel
def _change_axes(old_reference: Floats, new_reference: Floats, frame: Floats, displacement: Floats) -> None:
    """Turn a displacement from the transported axes of one frame to the axes of another, in place."""
    ax, ay, az, bx, by, bz = parallel_transport(old_reference)
    cx, cy, cz, dx, dy, dz = parallel_transport(new_reference)
    x, y, z = (
        displacement[0] * ax + displacement[1] * bx,
        displacement[0] * ay + displacement[1] * by,
        displacement[0] * az + displacement[1] * bz,
    )
    p = frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z
    q = frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z
    r = frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z
    displacement[0], displacement[1] = p * cx + q * cy + r * cz, p * dx + q * dy + r * dz


@kernel
def mean_displacement(
    body: Ints, xy: Floats, displacement: Floats, mass: Floats, inertia: Floats, mean: Floats, moments: Floats
) -> None:
    """Find the mean displacement (m, m) and rotation (rad) of each fragment by the load of its elements.

    ``xy`` are coordinates on the tangent plane (elements, 2), m; ``mean`` takes the result (fragments, 3), ``moments`` centre
    of mass (m), mass (kg) and moment of inertia (kg m2) of the fragments (fragments, 4).
    """
    mean[:, :] = 0.0
    moments[:, :] = 0.0
    for e in range(body.size):
        b = body[e]
        moments[b, 2] += mass[e]
        for i in range(2):
            mean[b, i] += mass[e] * displacement[e, i]
            moments[b, i] += mass[e] * xy[e, i]
    for b in range(mean.shape[0]):
        for i in range(2):
            mean[b, i] /= moments[b, 2]
            moments[b, i] /= moments[b, 2]
    for e in range(body.size):
        b = body[e]
        x, y = xy[e, 0] - moments[b, 0], xy[e, 1] - moments[b, 1]
        moments[b, 3] += mass[e] * (x * x + y * y) + inertia[e]
        mean[b, 2] += mass[e] * (x * displacement[e, 1] - y * displacement[e, 0]) + inertia[e] * displacement[e, 2]
    for b in range(mean.shape[0]):
        mean[b, 2] /= moments[b, 3]


@kernel
def subtract_mean(body: Ints, xy: Floats, displacement: Floats, mean: Floats, moments: Floats) -> None:
    """Subtract the mean displacement and rotation (`mean_displacement`) in place, which leaves the deformation."""
    for e in range(body.size):
        b = body[e]
        x, y = xy[e, 0] - moments[b, 0], xy[e, 1] - moments[b, 1]
        displacement[e, 0] -= mean[b, 0] - mean[b, 2] * y
        displacement[e, 1] -= mean[b, 1] + mean[b, 2] * x
        displacement[e, 2] -= mean[b, 2]


def bodies_from_elements(
    lon: Floats, lat: Floats, body: Ints, mass: Floats, latlon: bool, radius: float, period: float
) -> Bodies:
    """Make bodies of elements free of load, with the axes east and north at the centre of mass; velocities are zero.

    ``body``: fragment of each element, 0, 1, ...; positions in degrees or m, ``mass`` in kg.
    """
    return Bodies(*_bodies_from_elements(lon, lat, body, mass, latlon, radius, period))


@kernel
def _bodies_from_elements(
    lon: Floats, lat: Floats, body: Ints, mass: Floats, latlon: bool, radius: float, period: float
) -> tuple[Ints, Floats, Floats, Floats, Floats]:
    """Return the fields of `Bodies` (no named tuple: see `riftberg.compiled.kernels`)."""
    count = _count_fragments(body)
    reference, pose, total = np.zeros((body.size, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    anchor = np.full(count, -1, np.int64)
    for e in range(body.size):
        b = body[e]
        if anchor[b] < 0:
            anchor[b] = e
        if latlon:
            reference[e, 0], reference[e, 1], reference[e, 2] = unit_vector(lon[e], lat[e])
        else:
            reference[e, 0], reference[e, 1] = lon[anchor[b]] + nearest_image(lon[e] - lon[anchor[b]], period), lat[e]
        total[b] += mass[e]
        for i in range(3):
            pose[b, i, 2] += mass[e] * reference[e, i]
    for b in range(count):
        for i in range(3):
            pose[b, i, 2] /= total[b]
        if latlon:
            size = math.sqrt(pose[b, 0, 2] ** 2 + pose[b, 1, 2] ** 2 + pose[b, 2, 2] ** 2)
            for i in range(3):
                pose[b, i, 2] /= size
            pose[b, 0, 0], pose[b, 1, 0], _, _, _ = local_axes(pose[b, :, 2])
            _orthonormalise(pose[b])
        else:
            pose[b, 0, 0] = pose[b, 1, 1] = 1.0
    for e in range(body.size):
        q, x, y, z = pose[body[e]], reference[e, 0], reference[e, 1], reference[e, 2]
        if latlon:
            for i in range(3):
                reference[e, i] = q[0, i] * x + q[1, i] * y + q[2, i] * z
        else:
            reference[e, 0], reference[e, 1] = x - q[0, 2], y - q[1, 2]
    return (body, reference, pose, np.zeros((count, 3)), np.zeros((body.size, 3)))
