"""Friction of a keel on the sea floor: Coulomb's law in each patch of the area on which an element stands.

The friction of an element, with its torque, is an elastic-plastic anchor at the centre of its load: what the keel moves and turns
on loads it with the stiffness C / anchor way, against spin times the radius of gyration of the area, up to what the patches hold;
C is their largest friction. The force is stored, not the way: where a load rises, a stored way would push the berg back, and make
energy.

Forces below are parts of the largest friction, lengths parts of the radius of gyration of the area, torques of their product.
A slip n, with its spin, meets the friction and dissipation

    P(n) = sum w_i B_i^T B_i n / |B_i n|,    D(n) = n P(n)

of the patches i, with their weights w_i and B_i n the slip of each. P is the surface of what can be held. A force f beyond it
gives way by the slip s n to its nearest point:

    f = s n + P(n),    s = max f n - D(n)

over the unit vectors n. Nothing slips where no n gives s > 0.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.physics.elementary import cos_array, sin_array
from riftberg.physics.geometry import solve, times
from riftberg.state import Floats
from riftberg.state.variables import Keel

ANCHORS: Final = 13
ANCHOR_X, ANCHOR_Y, ANCHOR_TORQUE, LARGEST, STIFFNESS, LIMIT, SLOPE_X, SLOPE_Y, ARM_X, ARM_Y = range(10)
BASE_XX, BASE_XY, BASE_YY = range(10, ANCHORS)
"""Columns of anchors, one for each element: its friction now (N) and the torque of that (N m), the largest that could hold it
since it touched (N), the stiffness (N m-1; 0 afloat), the largest friction now (N), the push by the slope of the floor (N), where
all these act, from the centre of the element (m, east and north), and the variances of the area that holds it at the start of
the step (m2, the same axes)."""

AROUND: Final = 8
"""Patches in each of three rings: bergs that slide and spin go within 1 to 5 % as on many small patches."""

SPREAD: Final = 0.05
"""Radius of a patch: it resists its own spin, which rounds the surface where a patch is the pole of the motion."""

SURELY_HELD: Final = 0.8
"""Torque that any area holds: its mean radius is no less than 0.866 of that of gyration, as of a line."""

MOST_TURNS: Final = 60
"""Of Newton's method for the direction of the slip; some five are usual."""


def _disc() -> Floats:
    """Patches of a disc with unit variances: place and weight; their mean of r^-1, r and r^2 is that of the disc."""
    # Gauss and Legendre's points by hand, and sines of our own: those of NumPy hang on the processor in their last digits.
    root, weight = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9.0
    r = np.repeat(0.5 * (root + 1.0), AROUND)
    angle = 2.0 * math.pi * (np.arange(r.size) % AROUND + 0.5 * (np.arange(r.size) // AROUND % 2)) / AROUND
    east, north = 2.0 * r * cos_array(angle), 2.0 * r * sin_array(angle)
    return np.column_stack([east, north, np.repeat(weight, AROUND) * r / AROUND])


DISC: Final = _disc()


@kernel
def allocate_patches() -> Floats:
    """Return a workspace of `give_way`: patches, six vectors and two matrices."""
    return np.empty((len(DISC) + 12, 3))


@borrower
def read_anchor(keel: Keel, e: int, anchor_way: float, anchor: Floats) -> None:
    """Take the anchor of an element from the state; ``anchor_way``: that of the bed, m."""
    anchor[ANCHOR_X], anchor[ANCHOR_Y], anchor[ANCHOR_TORQUE] = (
        keel.anchor_x[e],
        keel.anchor_y[e],
        keel.anchor_torque[e],
    )
    anchor[LARGEST], anchor[LIMIT] = keel.anchor_capacity[e], keel.floor_hold[e]
    anchor[STIFFNESS] = keel.anchor_capacity[e] / anchor_way
    anchor[SLOPE_X], anchor[SLOPE_Y] = keel.floor_x[e] - keel.anchor_x[e], keel.floor_y[e] - keel.anchor_y[e]
    anchor[ARM_X], anchor[ARM_Y] = keel.floor_arm_x[e], keel.floor_arm_y[e]
    anchor[BASE_XX], anchor[BASE_XY], anchor[BASE_YY] = keel.base_xx[e], keel.base_xy[e], keel.base_yy[e]


@borrower
def floor_force(anchor: Floats) -> tuple[float, float, float]:
    """Force of the floor on an element (N), with that of its slope, and its torque about the centre of the element (N m)."""
    x, y = anchor[SLOPE_X] + anchor[ANCHOR_X], anchor[SLOPE_Y] + anchor[ANCHOR_Y]
    return x, y, anchor[ARM_X] * y - anchor[ARM_Y] * x + anchor[ANCHOR_TORQUE]


@borrower
def present_friction(anchor: Floats, gyration: float) -> tuple[float, float, float]:
    """Friction of an anchor (N), and its torque over the radius of gyration of its area, ``gyration`` (m); a point has none."""
    return anchor[ANCHOR_X], anchor[ANCHOR_Y], anchor[ANCHOR_TORQUE] / gyration if gyration > 0.0 else 0.0


@borrower
def fill_keel_levers(anchor: Floats, gyration: float, m: Floats, lever: Floats) -> None:
    """Find the velocity of the keel where the floor carries it, and its spin times ``gyration`` (m), by the velocity of its body.

    ``m``: levers of the element.
    """
    for k in range(3):
        lever[0, k] = m[k] - anchor[ARM_Y] * m[6 + k]
        lever[1, k] = m[3 + k] + anchor[ARM_X] * m[6 + k]
        lever[2, k] = gyration * m[6 + k]


@borrower
def find_pull(anchor: Floats, gyration: float, lever: Floats, spring: float, v: Floats, pull: Floats) -> None:
    """Find the force (N) of an anchor that holds while its body moves, and its torque over ``gyration``.

    ``spring``: stiffness times the time for which it moves by ``v``, N s m-1.
    """
    (x, y, turn), (px, py, torque) = times(lever, v), present_friction(anchor, gyration)
    pull[0], pull[1], pull[2] = px - spring * x, py - spring * y, torque - spring * turn


@borrower
def lay_patches(base: Floats, c: float, s: float, patches: Floats) -> None:
    """Lay the patches (place, weight) of an ellipse with the variances xx, xy and yy of an area, turned by an angle.

    ``c``, ``s``: cosine and sine of the angle.
    """
    # The root of the matrix of variances stretches the disc to the ellipse.
    xx, xy, yy = base[0], base[1], base[2]
    gyration = math.sqrt(xx + yy)
    area = math.sqrt(max(xx * yy - xy * xy, 0.0))
    scale = 1.0 / (gyration * math.sqrt(xx + yy + 2.0 * area)) if gyration > 0.0 else 0.0  # a point has no torque
    for i in range(len(DISC)):
        x = scale * ((xx + area) * DISC[i, 0] + xy * DISC[i, 1])
        y = scale * (xy * DISC[i, 0] + (yy + area) * DISC[i, 1])
        patches[i, 0], patches[i, 1], patches[i, 2] = c * x - s * y, s * x + c * y, DISC[i, 2]


@borrower
def find_friction(patches: Floats, slip: Floats, secant: bool, friction: Floats, slope: Floats) -> float:
    """Find the friction against a slip (east, north, spin) and its derivative, or secant; returns the dissipation."""
    total, turns = 0.0, 0.0 if secant else 1.0  # whether the direction of the friction turns with the slip
    friction[:], slope[:, :] = 0.0, 0.0
    for i in range(len(patches)):
        x, y, weight = patches[i, 0], patches[i, 1], patches[i, 2]
        u, v, w = slip[0] - y * slip[2], slip[1] + x * slip[2], SPREAD * slip[2]
        size = math.sqrt(u * u + v * v + w * w)
        total += weight * size
        u, v, w = u / size, v / size, w / size
        turn, stiffness = x * v - y * u + SPREAD * w, weight / size
        friction[0] += weight * u
        friction[1] += weight * v
        friction[2] += weight * turn
        slope[0, 0] += stiffness * (1.0 - turns * u * u)
        slope[0, 1] -= stiffness * turns * u * v
        slope[0, 2] -= stiffness * (y + turns * u * turn)
        slope[1, 1] += stiffness * (1.0 - turns * v * v)
        slope[1, 2] += stiffness * (x - turns * v * turn)
        slope[2, 2] += stiffness * (x * x + y * y + SPREAD * SPREAD - turns * turn * turn)
    for i in range(3):
        for j in range(i):
            slope[i, j] = slope[j, i]
    return total


@borrower
def give_way(
    pull: Floats, limit: float, base: Floats, c: float, s: float, secant: bool, friction: Floats, slope: Floats, work: Floats
) -> bool:  # fmt: skip
    """Find what an element holds of a pull (N, N, and torque over its radius of gyration, N), and its slope by the pull.

    ``limit``: largest friction, N; ``base``: variances of the area, turned by cosine ``c`` and sine ``s``; ``work``: of
    `allocate_patches`. Returns whether it slips. A ``secant`` G gives the friction, ``G pull``, and no less energy than the law,
    ``pull G pull / 2`` and a constant, at any other pull: turns that take it from the last pull settle from any start.
    """
    count = len(DISC)
    patches, force, n, trial, turn = work[:count], work[count], work[count + 1], work[count + 2], work[count + 3]
    unit, surface, curvature, matrix = work[count + 4], work[count + 5], work[count + 6 : count + 9], work[count + 9 :]
    for k in range(3):
        force[k] = pull[k] / limit if limit > 0.0 else 0.0
        friction[k] = force[k] * limit
        for j in range(3):
            slope[k, j] = 1.0 if k == j and limit > 0.0 else 0.0
    if math.hypot(force[0], force[1]) + abs(force[2]) / SURELY_HELD <= 1.0:
        return limit <= 0.0
    lay_patches(base, c, s, patches)
    size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    for k in range(3):
        n[k] = force[k] / size
    slip = size - find_friction(patches, n, False, surface, curvature)
    for _ in range(MOST_TURNS):
        for i in range(3):
            turn[i] = force[i] - surface[i] - slip * n[i]
            for j in range(3):
                matrix[i, j] = curvature[i, j] + n[i] * n[j] + (max(slip, 1e-9) if i == j else 0.0)
        turn[0], turn[1], turn[2] = solve(matrix, turn)
        if math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2) < 1e-13:
            break
        share, previous_slip = 1.0, slip
        while True:
            for k in range(3):
                trial[k] = n[k] + share * turn[k]
            size = math.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
            for k in range(3):
                trial[k] /= size
            slip = force[0] * trial[0] + force[1] * trial[1] + force[2] * trial[2]
            slip -= find_friction(patches, trial, False, surface, curvature)
            if slip >= previous_slip - 1e-14 or share < 1e-6:
                break
            share *= 0.5
        for k in range(3):
            n[k] = trial[k]
    if slip <= 0.0:
        return False
    if secant:
        find_friction(patches, n, True, surface, curvature)
    # With the slope K of the patches by the slip: K / (K + s) = 1 - s / (K + s). The derivative K gives way along n without end.
    along = 0.0 if secant else 1.0
    for i in range(3):
        friction[i] = (force[i] - slip * n[i]) * limit
        for j in range(3):
            matrix[i, j] = curvature[i, j] + along * n[i] * n[j] + (slip if i == j else 0.0)
    for j in range(3):
        unit[:] = 0.0
        unit[j] = 1.0
        turn[0], turn[1], turn[2] = solve(matrix, unit)
        for i in range(3):
            slope[i, j] -= slip * turn[i] + along * n[i] * n[j] / (1.0 + slip)
    return True
